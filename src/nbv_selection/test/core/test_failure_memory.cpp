// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/failure_memory.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <random>
#include <set>
#include <stdexcept>
#include <utility>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

namespace nbv_selection {
namespace {

using test_support::messageOf;
using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// The same without a tree: a time for each cell.
class CellByCell {
 public:
  explicit CellByCell(double cell_m) : cell_m_(cell_m) {}

  void add(const Eigen::Vector2d& center_map, double radius_m, double stamp_s) {
    raise(indexOf(center_map.x()), indexOf(center_map.y()), stamp_s);
    for (auto x = indexOf(center_map.x() - radius_m) - 1; x <= indexOf(center_map.x() + radius_m) + 1; ++x) {
      for (auto y = indexOf(center_map.y() - radius_m) - 1; y <= indexOf(center_map.y() + radius_m) + 1; ++y) {
        const Eigen::Vector2d offset = center(x, y) - center_map;
        if (offset.x() * offset.x() + offset.y() * offset.y() <= radius_m * radius_m) raise(x, y, stamp_s);
      }
    }
  }
  void clear() { cells_.clear(); }
  double lastFailure(const Eigen::Vector2d& p_map) const {
    const auto cell = cells_.find({indexOf(p_map.x()), indexOf(p_map.y())});
    return cell == cells_.end() ? -kInfinity : cell->second;
  }
  Eigen::Vector2d center(std::int64_t x, std::int64_t y) const {
    return {(static_cast<double>(x) + 0.5) * cell_m_, (static_cast<double>(y) + 0.5) * cell_m_};
  }
  const std::map<std::pair<std::int64_t, std::int64_t>, double>& cells() const { return cells_; }

 private:
  std::int64_t indexOf(double coordinate_m) const {
    return static_cast<std::int64_t>(std::floor(coordinate_m / cell_m_));
  }
  void raise(std::int64_t x, std::int64_t y, double stamp_s) {
    const auto [cell, is_new] = cells_.emplace(std::make_pair(x, y), stamp_s);
    if (!is_new) cell->second = std::max(cell->second, stamp_s);
  }

  double cell_m_;
  std::map<std::pair<std::int64_t, std::int64_t>, double> cells_;
};

void expectSame(const FailureMemory& memory, const CellByCell& oracle) {
  for (const auto& [index, stamp_s] : oracle.cells()) {
    ASSERT_EQ(memory.lastFailure(oracle.center(index.first, index.second)), stamp_s)
        << index.first << " " << index.second;
  }
  // And nothing but these: leaves do not overlap, and together are as large.
  double num_cells = 0.0;
  for (const FailureMemory::Cell& cell : memory.cells()) {
    const double side = std::round(cell.size_m / memory.cellSize());
    ASSERT_EQ(std::exp2(std::round(std::log2(side))), side) << "a power of two";
    ASSERT_EQ(oracle.lastFailure(cell.center_map + Eigen::Vector2d::Constant(1e-4)), cell.stamp_s);
    num_cells += side * side;
  }
  ASSERT_EQ(num_cells, static_cast<double>(oracle.cells().size()));
}

TEST(FailureMemory, KnowsWhatATableOfCellsKnows) {
  std::mt19937 rng(1);
  const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(rng); };
  std::size_t num_failures = 0, num_asked_inside = 0;
  for (int sequence = 0; sequence < 1000; ++sequence) {
    const double cell_m = uniform(0.0, 1.0) < 0.5 ? 0.25 : uniform(0.05, 1.0);
    FailureMemory memory(cell_m);
    CellByCell oracle(cell_m);
    const double extent_m = uniform(0.5, 8.0);
    const Eigen::Vector2d around(uniform(-20.0, 20.0), uniform(-20.0, 20.0));
    const auto somewhere = [&] {
      Eigen::Vector2d p(around + Eigen::Vector2d(uniform(-extent_m, extent_m), uniform(-extent_m, extent_m)));
      // On borders, corners and middles of cells, too: there middles lie on the disc's rim.
      if (uniform(0.0, 1.0) < 0.1) {
        return Eigen::Vector2d((p.array() / cell_m).floor() * cell_m + 0.5 * cell_m);
      }
      if (uniform(0.0, 1.0) < 0.3) p.x() = std::round(p.x() / cell_m) * cell_m;
      if (uniform(0.0, 1.0) < 0.3) p.y() = std::round(p.y() / cell_m) * cell_m;
      return p;
    };
    const int num_steps = 1 + sequence % 20;
    for (int step = 0; step < num_steps; ++step) {
      const double what = uniform(0.0, 1.0);
      if (what < 0.97) {
        const Eigen::Vector2d p = somewhere();
        const double kind = uniform(0.0, 1.0);
        const double radius_m = kind < 0.2 ? 0.0 : kind < 0.4 ? 2.0 * cell_m : uniform(0.0, 12.0 * cell_m);
        const double stamp_s = std::floor(uniform(-5.0, 5.0));  // of few values, so that times meet
        memory.add(p, std::min(radius_m, 10.0), stamp_s);
        oracle.add(p, std::min(radius_m, 10.0), stamp_s);
        ++num_failures;
      } else {
        memory.clear();
        oracle.clear();
      }
      for (int i = 0; i < 10; ++i) {
        const Eigen::Vector2d p = somewhere();
        const double expected = oracle.lastFailure(p);
        num_asked_inside += std::isfinite(expected) ? 1 : 0;
        ASSERT_EQ(memory.lastFailure(p), expected) << p.transpose() << " in sequence " << sequence;
      }
    }
    ASSERT_NO_FATAL_FAILURE(expectSame(memory, oracle)) << "in sequence " << sequence;
    if (oracle.cells().empty()) {
      ASSERT_EQ(memory.numNodes(), 0u);
    }
  }
  EXPECT_GT(num_failures, 5000u);
  EXPECT_GT(num_asked_inside, 10000u);
}

TEST(FailureMemory, BigDiscIsTheTableOfItsCells) {
  FailureMemory memory(0.05);
  CellByCell oracle(0.05);
  memory.add({-3.3, 4.1}, 10.0, 7.0);
  oracle.add({-3.3, 4.1}, 10.0, 7.0);
  memory.add({4.0, 4.0}, 3.0, 5.0);
  oracle.add({4.0, 4.0}, 3.0, 5.0);
  expectSame(memory, oracle);
}

TEST(FailureMemory, MergesWhatFailedAtOneTime) {
  FailureMemory memory(0.05);
  memory.add({0.0, 0.0}, 10.0, 1.0);
  // A circle of radius r meets at most 8 r / s squares of side s. Of those only are split, from two cells up: twice as
  // many as of the smallest, each into four.
  EXPECT_LT(memory.numNodes(), 4.0 * 2.0 * 8.0 * 10.0 / 0.1);
  EXPECT_GT(memory.numNodes(), 100u);
  // One cell after the other until a square is full: one leaf.
  FailureMemory square(0.1);
  for (int x = -8; x < 0; ++x) {
    for (int y = 8; y < 16; ++y) square.add({0.1 * (x + 0.5), 0.1 * (y + 0.5)}, 0.0, 3.0);
  }
  ASSERT_THAT(square.cells(), SizeIs(1));
  EXPECT_NEAR(square.cells()[0].size_m, 0.8, 1e-12);
  EXPECT_NEAR(square.cells()[0].center_map.x(), -0.4, 1e-12);
  EXPECT_NEAR(square.cells()[0].center_map.y(), 1.2, 1e-12);
  EXPECT_EQ(square.cells()[0].stamp_s, 3.0);
  // A later failure in it splits it down to its cell: three levels of three more leaves, and the nodes above them.
  const std::size_t before = square.numNodes();
  square.add({-0.05, 0.85}, 0.0, 4.0);
  EXPECT_THAT(square.cells(), SizeIs(10));
  EXPECT_EQ(square.numNodes(), before + 12);
}

TEST(FailureMemory, TreeDependsOnWhatFailedNotOnHow) {
  // Discs, or all of their cells one by one: no node is left split that need not be. Both trees reach as far.
  std::mt19937 rng(2);
  const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(rng); };
  for (int i = 0; i < 50; ++i) {
    FailureMemory discs(0.1), cells(0.1);
    CellByCell oracle(0.1);
    for (const Eigen::Vector2d& corner : {Eigen::Vector2d(-5.0, -5.0), Eigen::Vector2d(5.0, 5.0)}) {
      discs.add(corner, 0.0, -1.0);
      cells.add(corner, 0.0, -1.0);
    }
    for (int j = 0; j < 60; ++j) {
      const Eigen::Vector2d p(uniform(-1.0, 1.0), uniform(-1.0, 1.0));
      const double radius_m = uniform(0.0, 0.5), stamp_s = j < 40 ? 1.0 : 2.0;
      discs.add(p, radius_m, stamp_s);
      oracle.add(p, radius_m, stamp_s);
    }
    for (const auto& [index, stamp_s] : oracle.cells())
      cells.add(oracle.center(index.first, index.second), 0.0, stamp_s);
    EXPECT_EQ(discs.numNodes(), cells.numNodes());
  }
}

TEST(FailureMemory, LaterTimesStayAndEarlierOnesGo) {
  FailureMemory memory(0.1);
  memory.add({1.0, 1.0}, 0.5, 10.0);
  memory.add({1.0, 1.0}, 0.3, 20.0);
  memory.add({1.0, 1.0}, 1.0, 5.0);
  EXPECT_EQ(memory.lastFailure(Eigen::Vector2d(1.05, 1.05)), 20.0);
  EXPECT_EQ(memory.lastFailure(Eigen::Vector2d(1.05, 1.45)), 10.0);
  EXPECT_EQ(memory.lastFailure(Eigen::Vector2d(1.05, 1.85)), 5.0);
  EXPECT_EQ(memory.lastFailure(Eigen::Vector2d(1.05, 2.15)), -kInfinity);
  EXPECT_EQ(memory.lastFailure({Eigen::Vector2d(1.05, 2.15), {1.05, 1.85}, {1.05, 1.45}}), 10.0);
  EXPECT_EQ(memory.lastFailure(std::vector<Eigen::Vector2d>{}), -kInfinity);
}

TEST(FailureMemory, AtLeastTheCellOfAFailureIsMarked) {
  FailureMemory memory(1.0);
  memory.add({-0.95, 0.95}, 0.1, 1.0);  // its cell's middle is 0.64 m away
  EXPECT_EQ(memory.lastFailure(Eigen::Vector2d(-0.01, 0.01)), 1.0);
  EXPECT_THAT(memory.cells(), SizeIs(1));
}

TEST(FailureMemory, FarFailuresNeedFewNodes) {
  FailureMemory memory(0.01);
  const std::vector<Eigen::Vector2d> corners{{-1e5, -1e5}, {1e5, -1e5}, {-1e5, 1e5}, {1e5, 1e5}, {0.0, 0.0}};
  for (std::size_t i = 0; i < corners.size(); ++i) memory.add(corners[i], 0.0, static_cast<double>(i));
  for (std::size_t i = 0; i < corners.size(); ++i) EXPECT_EQ(memory.lastFailure(corners[i]), static_cast<double>(i));
  EXPECT_THAT(memory.cells(), SizeIs(5));
  // 2e7 cells from side to side: 25 levels or one more, each of four nodes, for each failure.
  EXPECT_LE(memory.numNodes(), 1u + 5u * 4u * 26u);
  EXPECT_EQ(memory.lastFailure(Eigen::Vector2d(1e300, 0.0)), -kInfinity);
  EXPECT_EQ(memory.lastFailure(Eigen::Vector2d(0.0, -1e300)), -kInfinity);
}

TEST(FailureMemory, WorksOnAfterClear) {
  FailureMemory memory(0.05);
  EXPECT_EQ(memory.numNodes(), 0u);
  memory.add({0.3, -0.2}, 0.2, 100.0);
  memory.clear();
  EXPECT_EQ(memory.numNodes(), 0u);
  EXPECT_EQ(memory.lastFailure(Eigen::Vector2d(0.3, -0.2)), -kInfinity);
  memory.add({-7.0, 7.0}, 0.0, 1.0);
  EXPECT_THAT(memory.cells(), SizeIs(1));
}

TEST(FailureMemory, RefusesWhatIsNoPlaceOrTime) {
  EXPECT_THROW(FailureMemory(0.0099), std::invalid_argument);
  EXPECT_THROW(FailureMemory(1.01), std::invalid_argument);
  EXPECT_THROW(FailureMemory{kNaN}, std::invalid_argument);
  FailureMemory memory(0.05);
  EXPECT_EQ(memory.cellSize(), 0.05);
  const std::vector<std::pair<std::pair<Eigen::Vector2d, double>, double>> bad{
      {{{kNaN, 0.0}, 0.1}, 1.0},      {{{0.0, kInfinity}, 0.1}, 1.0}, {{{1.1e5, 0.0}, 0.1}, 1.0},
      {{{0.0, -1.1e5}, 0.1}, 1.0},    {{{0.0, 0.0}, -0.1}, 1.0},      {{{0.0, 0.0}, 10.1}, 1.0},
      {{{0.0, 0.0}, kNaN}, 1.0},      {{{0.0, 0.0}, 0.1}, kNaN},      {{{0.0, 0.0}, 0.1}, kInfinity},
      {{{0.0, 0.0}, 0.1}, -kInfinity}};
  for (const auto& [where, stamp_s] : bad) {
    EXPECT_THROW(memory.add(where.first, where.second, stamp_s), std::invalid_argument)
        << where.first.transpose() << " " << where.second << " " << stamp_s;
  }
  EXPECT_EQ(memory.numNodes(), 0u);
  EXPECT_THAT(messageOf<std::invalid_argument>([&] {
                memory.add({0.0, 0.0}, 11.0, 1.0);
              }),
              HasSubstr("radius_m = 11 m, must be in [0, 10] m"));
  memory.add({0.0, 0.0}, 1.0, 1.0);
  EXPECT_EQ(memory.lastFailure(Eigen::Vector2d(kNaN, 0.0)), -kInfinity);
  EXPECT_EQ(memory.lastFailure(Eigen::Vector2d(0.0, kNaN)), -kInfinity);
  EXPECT_EQ(memory.lastFailure(Eigen::Vector2d(kInfinity, 0.0)), -kInfinity);
}

}  // namespace
}  // namespace nbv_selection
