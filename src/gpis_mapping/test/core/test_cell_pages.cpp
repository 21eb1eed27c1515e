// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/cell_pages.h"

#include <array>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <vector>

#include <gtest/gtest.h>

namespace gpis_mapping {
namespace {

std::shared_ptr<const CellGp> makeCell(const LatticeKey& key, std::size_t num_own = 1) {
  const GpisConfig config;
  SurfacePoint point;
  point.position_map = config.cells.center(key);
  point.normal_map = {0.0f, 0.0f, 1.0f};
  point.variance_m2 = 1e-6f;
  const std::vector<const SurfacePoint*> points(num_own, &point);
  return std::make_shared<const CellGp>(key, config, points, num_own, num_own);
}

using Oracle = std::map<LatticeKey, std::shared_ptr<const CellGp>>;

void expectSame(const CellPages& pages, const Oracle& oracle) {
  ASSERT_EQ(pages.size(), oracle.size());
  EXPECT_EQ(pages.empty(), oracle.empty());
  std::size_t points = 0;
  std::set<LatticeKey> seen;
  for (const auto& [key, cell] : pages) {
    const auto expected = oracle.find(key);
    ASSERT_NE(expected, oracle.end());
    EXPECT_EQ(cell, expected->second);
    EXPECT_TRUE(seen.insert(key).second) << "twice";
    points += cell->numOwn();
  }
  EXPECT_EQ(seen.size(), oracle.size());
  EXPECT_EQ(pages.numPoints(), points);
  for (const auto& [key, cell] : oracle) {
    EXPECT_EQ(pages.get(key), cell.get());
    std::array<const CellGp*, 27> around;
    pages.getAround(key, &around);
    for (int d = 0; d < 27; ++d) {
      const auto neighbour = oracle.find(key.offset(d / 9 - 1, d / 3 % 3 - 1, d % 3 - 1));
      EXPECT_EQ(around[static_cast<std::size_t>(d)], neighbour == oracle.end() ? nullptr : neighbour->second.get());
    }
  }
}

TEST(CellPages, HoldsWhatAMapWouldHoldThroughManyChanges) {
  std::mt19937 rng(1);
  // Over the borders of pages and books, on both sides of zero.
  std::uniform_int_distribution<int> place(-34, 34);
  CellPages pages;
  Oracle oracle;
  std::vector<std::pair<CellPages, Oracle>> kept;
  for (int round = 0; round < 40; ++round) {
    std::vector<CellPages::value_type> changes;
    for (int i = 0; i < 60; ++i) {
      LatticeKey key{place(rng), place(rng) / 8, place(rng) / 16};
      const bool is_removal = round % 3 == 2 && !oracle.empty();
      if (is_removal) {
        auto victim = oracle.lower_bound(key);
        if (victim != oracle.end()) key = victim->first;
      }
      changes.emplace_back(key, is_removal ? nullptr : makeCell(key, 1 + static_cast<std::size_t>(i) % 3));
      if (is_removal) {
        oracle.erase(key);
      } else {
        oracle[key] = changes.back().second;
      }
    }
    pages.replace(changes);
    expectSame(pages, oracle);
    kept.emplace_back(pages, oracle);
  }
  for (const auto& [before, expected] : kept) expectSame(before, expected);  // what came later has not touched them
  std::vector<CellPages::value_type> all;
  for (const auto& entry : pages) all.emplace_back(entry.first, nullptr);
  pages.replace(all);
  expectSame(pages, {});
  EXPECT_TRUE(pages.begin() == pages.end());
}

TEST(CellPages, OrderDoesNotDependOnHistory) {
  std::vector<CellPages::value_type> cells;
  for (int x = -6; x < 6; ++x) {
    for (int y = -6; y < 6; ++y) cells.emplace_back(LatticeKey{x, y, 0}, makeCell({x, y, 0}));
  }
  const CellPages at_once(cells);
  CellPages one_by_one;
  const LatticeKey far{100, 0, 0};
  for (auto cell = cells.rbegin(); cell != cells.rend(); ++cell) {
    one_by_one.replace({*cell});
    one_by_one.replace({CellPages::value_type(far, makeCell(far))});
  }
  one_by_one.replace({CellPages::value_type(far, nullptr)});
  ASSERT_EQ(at_once.size(), one_by_one.size());
  auto other = one_by_one.begin();
  for (const auto& entry : at_once) EXPECT_EQ(entry, *other++);
}

TEST(CellPages, FarCornersOfTheLattice) {
  CellPages pages;
  constexpr int kFar = 1 << 30;
  const std::vector<LatticeKey> keys = {{kFar, -kFar, kFar}, {-kFar, -kFar, -kFar}, {-1, -1, -1}, {0, 0, 0}};
  for (const LatticeKey& key : keys) pages.replace({CellPages::value_type(key, makeCell(key))});
  for (const LatticeKey& key : keys) {
    ASSERT_NE(pages.get(key), nullptr);
    EXPECT_EQ(pages.get(key)->key(), key);
    const CellGp* const beyond = key == keys[2] ? pages.get(keys[3]) : nullptr;
    EXPECT_EQ(pages.get(key.offset(1, 1, 1)), beyond);
  }
}

}  // namespace
}  // namespace gpis_mapping
