// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/failure_memory.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace nbv_selection {
namespace {

constexpr double kNever_s = -std::numeric_limits<double>::infinity();
constexpr double kMinCell_m = 0.01;
constexpr double kMaxCell_m = 1.0;
constexpr double kMaxReported_m = 1e5;
constexpr double kMaxRadius_m = 10.0;

void require(const char* key, double value, double low, double high, const char* unit) {
  if (value >= low && value <= high) return;  // false for NaN
  std::ostringstream text;
  text << key << " = " << value << " " << unit << ", must be in [" << low << ", " << high << "] " << unit;
  throw std::invalid_argument(text.str());
}

/// A square of cells: columns x to x + size - 1, rows likewise; size is a power of two.
struct Square {
  std::int64_t x;
  std::int64_t y;
  std::int64_t size;

  Square quarter(std::size_t i) const {
    const std::int64_t half = size / 2;
    return {x + (i % 2 == 1 ? half : 0), y + (i >= 2 ? half : 0), half};
  }
  /// Which quarter holds the cell.
  std::size_t quarterOf(std::int64_t column, std::int64_t row) const {
    return (column >= x + size / 2 ? 1u : 0u) + (row >= y + size / 2 ? 2u : 0u);
  }
  bool contains(std::int64_t column, std::int64_t row) const {
    return column >= x && row >= y && column < x + size && row < y + size;
  }
};

/// Cells whose middle is within the radius.
class Disc {
 public:
  Disc(const Eigen::Vector2d& center_m, double radius_m, double cell_m)
      : center_m_(center_m), radius2_m2_(radius_m * radius_m), cell_m_(cell_m) {}

  /// Rounding never decides between these and a cell taken alone: all ask for the middles' distances in the same way,
  /// and rounded sums and products keep their order.
  bool isClearOf(const Square& square) const {
    const double x = nearest(square.x, square.size, center_m_.x());
    const double y = nearest(square.y, square.size, center_m_.y());
    return x * x + y * y > radius2_m2_;
  }
  bool covers(const Square& square) const {
    const double x = farthest(square.x, square.size, center_m_.x());
    const double y = farthest(square.y, square.size, center_m_.y());
    return x * x + y * y <= radius2_m2_;
  }

 private:
  double offset(std::int64_t index, double center_m) const {
    return (static_cast<double>(index) + 0.5) * cell_m_ - center_m;
  }
  double nearest(std::int64_t first, std::int64_t count, double center_m) const {
    return std::max({0.0, offset(first, center_m), -offset(first + count - 1, center_m)});
  }
  double farthest(std::int64_t first, std::int64_t count, double center_m) const {
    return std::max(std::abs(offset(first, center_m)), std::abs(offset(first + count - 1, center_m)));
  }

  Eigen::Vector2d center_m_;
  double radius2_m2_;
  double cell_m_;
};

}  // namespace

struct FailureMemory::Node {
  double stamp_s{kNever_s};                         // of a leaf: of all of its cells
  std::unique_ptr<std::array<Node, 4>> quarters{};  // null: a leaf

  Node() = default;
  Node(Node&&) = default;
  Node& operator=(Node&&) = default;
  Node(const Node& other)
      : stamp_s(other.stamp_s),
        quarters(other.isLeaf() ? nullptr : std::make_unique<std::array<Node, 4>>(*other.quarters)) {}

  bool isLeaf() const { return quarters == nullptr; }

  void split() {
    quarters = std::make_unique<std::array<Node, 4>>();
    for (Node& quarter : *quarters) quarter.stamp_s = stamp_s;
  }
  /// Four equal leaves become one.
  void merge() {
    const double stamp = quarters->front().stamp_s;
    for (const Node& quarter : *quarters) {
      if (!quarter.isLeaf() || quarter.stamp_s != stamp) return;
    }
    stamp_s = stamp;
    quarters.reset();
  }

  void raise(double stamp) {
    if (isLeaf()) {
      stamp_s = std::max(stamp_s, stamp);
      return;
    }
    for (Node& quarter : *quarters) quarter.raise(stamp);
    merge();
  }
  void raiseDisc(const Square& square, const Disc& disc, double stamp) {
    if ((isLeaf() && stamp_s >= stamp) || disc.isClearOf(square)) return;
    if (disc.covers(square)) {
      raise(stamp);
      return;
    }
    // A square of one cell is clear or covered: not to be split.
    if (isLeaf()) split();
    for (std::size_t i = 0; i < 4; ++i) (*quarters)[i].raiseDisc(square.quarter(i), disc, stamp);
    merge();
  }
  void raiseCell(const Square& square, std::int64_t column, std::int64_t row, double stamp) {
    if (isLeaf()) {
      if (stamp_s >= stamp) return;
      if (square.size == 1) {
        stamp_s = stamp;
        return;
      }
      split();
    }
    const std::size_t i = square.quarterOf(column, row);
    (*quarters)[i].raiseCell(square.quarter(i), column, row, stamp);
    merge();
  }
  std::size_t count() const {
    std::size_t sum = 1;
    if (!isLeaf()) {
      for (const Node& quarter : *quarters) sum += quarter.count();
    }
    return sum;
  }
  void collect(const Square& square, double cell_m, std::vector<Cell>* cells) const {
    if (isLeaf()) {
      if (stamp_s == kNever_s) return;
      const Eigen::Vector2d corner(static_cast<double>(square.x), static_cast<double>(square.y));
      const double size_m = static_cast<double>(square.size) * cell_m;
      cells->push_back({corner * cell_m + Eigen::Vector2d::Constant(0.5 * size_m), size_m, stamp_s});
      return;
    }
    for (std::size_t i = 0; i < 4; ++i) (*quarters)[i].collect(square.quarter(i), cell_m, cells);
  }
};

struct FailureMemory::Tree {
  double cell_m{0.0};
  std::unique_ptr<Node> root{};  // null: nothing ever failed
  Square square{0, 0, 1};        // the root's

  std::int64_t indexOf(double coordinate_m) const {
    return static_cast<std::int64_t>(std::floor(coordinate_m / cell_m));
  }

  /// Makes the root twice as large, towards the cell, until it holds it.
  void reach(std::int64_t column, std::int64_t row) {
    if (root == nullptr) {
      root = std::make_unique<Node>();
      square = {column, row, 1};
    }
    while (!square.contains(column, row)) {
      const Square grown{column < square.x ? square.x - square.size : square.x,
                         row < square.y ? square.y - square.size : square.y, 2 * square.size};
      const std::size_t i = grown.quarterOf(square.x, square.y);
      auto parent = std::make_unique<Node>();
      parent->split();
      (*parent->quarters)[i] = std::move(*root);
      parent->merge();
      root = std::move(parent);
      square = grown;
    }
  }
};

FailureMemory::FailureMemory(double cell_size_m) : tree_(std::make_unique<Tree>()) {
  require("cell_size_m", cell_size_m, kMinCell_m, kMaxCell_m, "m");
  tree_->cell_m = cell_size_m;
}

FailureMemory::FailureMemory(const FailureMemory& other) : tree_(std::make_unique<Tree>()) {
  tree_->cell_m = other.tree_->cell_m;
  if (other.tree_->root) tree_->root = std::make_unique<Node>(*other.tree_->root);
  tree_->square = other.tree_->square;
}

FailureMemory::~FailureMemory() = default;

void FailureMemory::add(const Eigen::Vector2d& center_map, double radius_m, double stamp_s) {
  require("center_map.x", center_map.x(), -kMaxReported_m, kMaxReported_m, "m");
  require("center_map.y", center_map.y(), -kMaxReported_m, kMaxReported_m, "m");
  require("radius_m", radius_m, 0.0, kMaxRadius_m, "m");
  if (!std::isfinite(stamp_s)) {
    throw std::invalid_argument("stamp_s = " + std::to_string(stamp_s) + " s, must be finite");
  }
  Tree& tree = *tree_;
  for (const double side : {-radius_m, radius_m}) {
    tree.reach(tree.indexOf(center_map.x() + side), tree.indexOf(center_map.y() + side));
  }
  tree.root->raiseDisc(tree.square, Disc(center_map, radius_m, tree.cell_m), stamp_s);
  tree.root->raiseCell(tree.square, tree.indexOf(center_map.x()), tree.indexOf(center_map.y()), stamp_s);
}

double FailureMemory::lastFailure(const Eigen::Vector2d& p_map) const {
  const Tree& tree = *tree_;
  // Far outside of what add() takes the index might not fit into an integer.
  if (tree.root == nullptr || !(p_map.cwiseAbs().maxCoeff() <= 2.0 * kMaxReported_m) || !p_map.allFinite()) {
    return kNever_s;
  }
  const std::int64_t column = tree.indexOf(p_map.x()), row = tree.indexOf(p_map.y());
  if (!tree.square.contains(column, row)) return kNever_s;
  const Node* node = tree.root.get();
  Square square = tree.square;
  while (!node->isLeaf()) {
    const std::size_t i = square.quarterOf(column, row);
    node = &(*node->quarters)[i];
    square = square.quarter(i);
  }
  return node->stamp_s;
}

double FailureMemory::lastFailure(const std::vector<Eigen::Vector2d>& points_map) const {
  double last_s = kNever_s;
  for (const Eigen::Vector2d& p_map : points_map) last_s = std::max(last_s, lastFailure(p_map));
  return last_s;
}

void FailureMemory::clear() {
  tree_->root.reset();
}

std::vector<FailureMemory::Cell> FailureMemory::cells() const {
  std::vector<Cell> result;
  if (tree_->root != nullptr) tree_->root->collect(tree_->square, tree_->cell_m, &result);
  return result;
}

std::size_t FailureMemory::numNodes() const {
  return tree_->root == nullptr ? 0 : tree_->root->count();
}

double FailureMemory::cellSize() const {
  return tree_->cell_m;
}

}  // namespace nbv_selection
