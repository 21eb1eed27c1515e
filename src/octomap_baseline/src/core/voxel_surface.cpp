// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline/voxel_surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <unordered_map>
#include <utility>
#include <vector>

#include "octomap_baseline/placed_nodes.h"
#include "octomap_baseline/tree_projection.h"

namespace octomap_baseline {

using gpis_mapping::SpaceState;
using octomap::OcTreeKey;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// A side of an occupied voxel.
struct Side {
  OcTreeKey key;
  int axis;   // 0 x, 1 y, 2 z
  int front;  // +1 or -1: the neighbour it is shared with
};

/// A node of the octree while the nearest side is searched.
struct Candidate {
  double squared_m2;  // from the point to its box
  PlacedNode placed;
  bool operator<(const Candidate& other) const { return squared_m2 > other.squared_m2; }  // the top is the nearest
};

SpaceState stateOf(const octomap::OcTree& tree, const octomap::OcTreeNode* node) {
  if (node == nullptr) return SpaceState::kUnknown;
  return tree.isNodeOccupied(node) ? SpaceState::kOccupied : SpaceState::kFree;
}

/// Calls `visit` with each outer side of a leaf.
template <typename Visit>
void forEachSide(const octomap::OcTree& tree, const PlacedNode& leaf, const Visit& visit) {
  const unsigned width = leaf.width(tree);
  for (int axis = 0; axis < 3; ++axis) {
    for (const int front : {-1, 1}) {
      OcTreeKey key = leaf.first;
      if (front > 0) key[axis] = static_cast<octomap::key_type>(key[axis] + width - 1);
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      for (unsigned i = 0; i < width; ++i) {
        for (unsigned j = 0; j < width; ++j) {
          key[u] = static_cast<octomap::key_type>(leaf.first[u] + i);
          key[v] = static_cast<octomap::key_type>(leaf.first[v] + j);
          visit(Side{key, axis, front});
        }
      }
    }
  }
}

/// Whether a leaf is left out.
bool isLeftOut(const octomap::OcTree& tree, const PlacedNode& leaf, bool without_specks) {
  return without_specks && leaf.depth == tree.getTreeDepth() && isSpeck(tree, leaf.first);
}

bool isFreeBefore(const octomap::OcTree& tree, const Side& side) {
  OcTreeKey before = side.key;
  before[side.axis] = static_cast<octomap::key_type>(before[side.axis] + side.front);
  return stateOf(tree, tree.search(before)) == SpaceState::kFree;
}

Eigen::Vector3d middleOf(const octomap::OcTree& tree, const Side& side) {
  Eigen::Vector3d middle = centerOf(tree, side.key);
  middle[side.axis] += 0.5 * side.front * tree.getResolution();
  return middle;
}

class MeshOfSides {
 public:
  explicit MeshOfSides(const octomap::OcTree& tree) : tree_(tree) {}

  void add(const Side& side) {
    const Eigen::Vector3d middle = middleOf(tree_, side);
    const int axis = side.axis, u = (axis + 1) % 3, v = (axis + 2) % 3;
    std::array<std::uint32_t, 4> corners{};
    constexpr std::array<std::array<int, 2>, 4> kTurn = {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}};  // about +axis
    for (std::size_t k = 0; k < 4; ++k) {
      std::array<std::uint64_t, 3> lattice{};
      lattice[axis] = side.key[axis] + (side.front > 0 ? 1U : 0U);
      lattice[u] = side.key[u] + static_cast<unsigned>(kTurn[k][0]);
      lattice[v] = side.key[v] + static_cast<unsigned>(kTurn[k][1]);
      const auto [at, is_new] = vertex_of_.emplace(lattice[0] | lattice[1] << 20U | lattice[2] << 40U,
                                                   static_cast<std::uint32_t>(mesh_.vertices_map.size()));
      if (is_new) {
        Eigen::Vector3d corner = middle;
        corner[u] += (kTurn[k][0] - 0.5) * tree_.getResolution();
        corner[v] += (kTurn[k][1] - 0.5) * tree_.getResolution();
        mesh_.vertices_map.push_back(corner);
        mesh_.normals_map.emplace_back(Eigen::Vector3f::Zero());
      }
      mesh_.normals_map[at->second][axis] += static_cast<float>(side.front);
      corners[k] = at->second;
    }
    if (side.front < 0) std::swap(corners[1], corners[3]);
    mesh_.triangles.push_back({corners[0], corners[1], corners[2]});
    mesh_.triangles.push_back({corners[0], corners[2], corners[3]});
  }

  gpis_mapping::TriangleMesh take() {
    for (Eigen::Vector3f& normal : mesh_.normals_map) normal.normalize();
    mesh_.variance_m2.assign(mesh_.vertices_map.size(), std::numeric_limits<float>::quiet_NaN());
    return std::move(mesh_);
  }

 private:
  const octomap::OcTree& tree_;
  gpis_mapping::TriangleMesh mesh_;
  std::unordered_map<std::uint64_t, std::uint32_t> vertex_of_;  // corner of the lattice -> vertex
};

/// Finds the side nearest to a point: nodes of the octree, the nearest first.
class NearestSide {
 public:
  NearestSide(const octomap::OcTree& tree, bool without_specks) : tree_(tree), without_specks_(without_specks) {}

  /// False: the map has no side.
  bool find(const Eigen::Vector3d& x) {
    const bool has_last = std::isfinite(squared_m2_);
    squared_m2_ = std::numeric_limits<double>::infinity();
    if (has_last) consider(x, side_);  // neighbours are asked for one after the other: hardly any is nearer
    nodes_.clear();
    const PlacedNode root = placedRoot(tree_);
    if (root.node != nullptr) consider(x, root);
    while (!nodes_.empty() && nodes_.front().squared_m2 < squared_m2_) {
      const PlacedNode nearest = nodes_.front().placed;
      std::pop_heap(nodes_.begin(), nodes_.end());
      nodes_.pop_back();
      if (tree_.nodeHasChildren(nearest.node)) {
        forEachChild(tree_, nearest, [&](const PlacedNode& child) { consider(x, child); });
      } else if (!isLeftOut(tree_, nearest, without_specks_)) {
        forEachSide(tree_, nearest, [&](const Side& side) { consider(x, side); });
      }
    }
    return std::isfinite(squared_m2_);
  }

  const Side& side() const { return side_; }
  const Eigen::Vector3d& point() const { return point_; }  // of it, the nearest

 private:
  void consider(const Eigen::Vector3d& x, const PlacedNode& placed) {
    if (!isOccupied(tree_, placed)) return;
    const double squared_m2 = placed.box(tree_).squaredExteriorDistance(x);
    if (squared_m2 >= squared_m2_) return;
    nodes_.push_back({squared_m2, placed});
    std::push_heap(nodes_.begin(), nodes_.end());
  }

  void consider(const Eigen::Vector3d& x, const Side& side) {
    const Eigen::Vector3d middle = middleOf(tree_, side);
    const Eigen::Vector3d half = Eigen::Vector3d::Constant(0.5 * tree_.getResolution());
    Eigen::Vector3d at = x.cwiseMax(middle - half).cwiseMin(middle + half);
    at[side.axis] = middle[side.axis];
    const double squared_m2 = (at - x).squaredNorm();
    if (squared_m2 >= squared_m2_ || !isFreeBefore(tree_, side)) return;
    squared_m2_ = squared_m2;
    side_ = side;
    point_ = at;
  }

  const octomap::OcTree& tree_;
  bool without_specks_;
  std::vector<Candidate> nodes_;                                // a heap
  double squared_m2_{std::numeric_limits<double>::infinity()};  // to the side found
  Side side_{};
  Eigen::Vector3d point_ = Eigen::Vector3d::Zero();
};

}  // namespace

gpis_mapping::TriangleMesh meshOfSides(const octomap::OcTree& tree, bool without_specks,
                                       const Eigen::AlignedBox3d& box_map) {
  MeshOfSides mesh(tree);
  const auto isOccupiedInBox = [&](const PlacedNode& placed) {
    return isOccupied(tree, placed) && placed.box(tree).intersects(box_map);
  };
  forEachLeaf(tree, placedRoot(tree), isOccupiedInBox, [&](const PlacedNode& leaf) {
    if (isLeftOut(tree, leaf, without_specks)) return;
    forEachSide(tree, leaf, [&](const Side& side) {
      if (isFreeBefore(tree, side)) mesh.add(side);
    });
  });
  return mesh.take();
}

gpis_mapping::QueryResult querySides(const octomap::OcTree& tree, bool without_specks,
                                     const gpis_mapping::Points3d& points_map,
                                     const gpis_mapping::QueryOptions& options) {
  const Eigen::Index count = points_map.cols();
  gpis_mapping::QueryResult result;
  result.distance = result.euclidean_distance = result.surface_std = Eigen::VectorXd::Constant(count, kNaN);
  result.gradient = result.euclidean_gradient = gpis_mapping::Points3d::Constant(3, count, kNaN);
  if (options.variance) result.variance = result.occupancy = Eigen::VectorXd::Constant(count, kNaN);
  if (options.variance_gradient) result.variance_gradient = gpis_mapping::Points3d::Constant(3, count, kNaN);
  result.state.assign(static_cast<std::size_t>(count), SpaceState::kUnknown);
  NearestSide nearest(tree, without_specks);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Vector3d x = points_map.col(i);
    if (!x.allFinite()) continue;
    const octomap::OcTreeNode* node = tree.search(x.x(), x.y(), x.z());
    const SpaceState state = stateOf(tree, node);
    result.state[static_cast<std::size_t>(i)] = state;
    if (options.variance && node != nullptr) result.occupancy[i] = node->getOccupancy();
    if (!nearest.find(x)) continue;
    Eigen::Vector3d normal = Eigen::Vector3d::Zero();
    normal[nearest.side().axis] = nearest.side().front;
    const Eigen::Vector3d way = x - nearest.point();
    const double distance_m = way.norm();
    const bool is_behind = state == SpaceState::kOccupied || (state == SpaceState::kUnknown && way.dot(normal) < 0.0);
    const double sign = is_behind ? -1.0 : 1.0;
    const Eigen::Vector3d away = distance_m > 0.0 ? Eigen::Vector3d(way / distance_m) : Eigen::Vector3d(sign * normal);
    result.euclidean_distance[i] = distance_m;
    result.euclidean_gradient.col(i) = away;
    result.distance[i] = sign * distance_m;
    result.gradient.col(i) = sign * away;
    result.surface_std[i] = tree.getResolution() / std::sqrt(12.0);
  }
  return result;
}

}  // namespace octomap_baseline
