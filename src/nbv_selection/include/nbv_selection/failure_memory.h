// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include <Eigen/Core>

namespace nbv_selection {

/// When picking, detecting or planning last failed, per cell of the ground (method section 6: t_f), in a quad-tree.
/// Cells that failed at one time are one node, however many they are. The tree grows to wherever failures come.
/// Segments may be cut again at will. Not thread-safe.
class FailureMemory {
 public:
  /// Throws std::invalid_argument unless cell_size_m is in [0.01, 1].
  explicit FailureMemory(double cell_size_m);
  ~FailureMemory();
  FailureMemory(const FailureMemory& other);
  FailureMemory& operator=(const FailureMemory&) = delete;

  /// Cells whose middle is within `radius_m` of `center_map`, and the one that holds it, failed at `stamp_s`. An
  /// earlier time is overwritten, a later one stays. Throws std::invalid_argument if a number is not finite, or the
  /// centre is farther than 1e5 m from the origin. So it does for a radius that is not in [0, 10].
  void add(const Eigen::Vector2d& center_map, double radius_m, double stamp_s);

  /// t_f at a point; -infinity: never failed, or the point is not finite.
  double lastFailure(const Eigen::Vector2d& p_map) const;

  /// The latest t_f of the points.
  double lastFailure(const std::vector<Eigen::Vector2d>& points_map) const;

  void clear();

  struct Cell {
    Eigen::Vector2d center_map;
    double size_m;  // of a node: a power of two of cells
    double stamp_s;
  };
  /// The leaves that hold a failure, in the tree's order.
  std::vector<Cell> cells() const;
  std::size_t numNodes() const;
  double cellSize() const;

 private:
  struct Node;
  struct Tree;
  std::unique_ptr<Tree> tree_;
};

}  // namespace nbv_selection
