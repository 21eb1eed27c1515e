// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline/voxel_surface.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <unordered_map>
#include <vector>

#include <flann/algorithms/dist.h>
#include <flann/algorithms/kdtree_single_index.h>

#include "octomap_baseline/tree_projection.h"

namespace octomap_baseline {

using gpis_mapping::SpaceState;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

struct Side {
  Eigen::Vector3d middle;
  int axis;   // 0 x, 1 y, 2 z
  int front;  // +1 or -1: where the free voxel is
};

SpaceState stateOf(const octomap::OcTree& tree, const octomap::OcTreeNode* node) {
  if (node == nullptr) return SpaceState::kUnknown;
  return tree.isNodeOccupied(node) ? SpaceState::kOccupied : SpaceState::kFree;
}

}  // namespace

struct VoxelSurface::Impl {
  Impl(std::shared_ptr<const octomap::OcTree> shared_tree, bool without_specks)
      : owner(std::move(shared_tree)), tree(*owner), half_m(0.5 * tree.getResolution()) {
    for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
      if (!tree.isNodeOccupied(*leaf)) continue;
      const bool is_smallest = leaf.getDepth() == tree.getTreeDepth();
      if (without_specks && is_smallest && isSpeck(tree, leaf.getKey())) continue;
      addSidesOf(leaf.getIndexKey(), 1U << (tree.getTreeDepth() - leaf.getDepth()));
    }
    for (Eigen::Vector3f& normal : mesh.normals_map) normal.normalize();
    mesh.variance_m2.assign(mesh.vertices_map.size(), std::numeric_limits<float>::quiet_NaN());
    if (sides.empty()) return;
    index.emplace(flann::Matrix<double>(sides[0].middle.data(), sides.size(), 3, sizeof(Side)),
                  flann::KDTreeSingleIndexParams(12));
    index->buildIndex();
  }

  /// Of a leaf as wide as `width` voxels; `first`: that of its lowest corner.
  void addSidesOf(const octomap::OcTreeKey& first, unsigned width) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const int front : {-1, 1}) {
        octomap::OcTreeKey key = first;
        if (front > 0) key[axis] = static_cast<octomap::key_type>(first[axis] + width - 1);
        const int u = (axis + 1) % 3, v = (axis + 2) % 3;
        for (unsigned i = 0; i < width; ++i) {
          for (unsigned j = 0; j < width; ++j) {
            key[u] = static_cast<octomap::key_type>(first[u] + i);
            key[v] = static_cast<octomap::key_type>(first[v] + j);
            octomap::OcTreeKey before = key;
            before[axis] = static_cast<octomap::key_type>(key[axis] + front);
            if (stateOf(tree, tree.search(before)) == SpaceState::kFree) addSide(key, axis, front);
          }
        }
      }
    }
  }

  void addSide(const octomap::OcTreeKey& key, int axis, int front) {
    Side side{{}, axis, front};
    for (int k = 0; k < 3; ++k) side.middle[k] = tree.keyToCoord(key[k]);
    side.middle[axis] += front * half_m;
    sides.push_back(side);
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    std::array<std::uint32_t, 4> corners{};
    constexpr std::array<std::array<int, 2>, 4> kTurn = {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}};  // about +axis
    for (std::size_t k = 0; k < 4; ++k) {
      std::array<std::uint64_t, 3> lattice{};
      lattice[axis] = key[axis] + (front > 0 ? 1U : 0U);
      lattice[u] = key[u] + static_cast<unsigned>(kTurn[k][0]);
      lattice[v] = key[v] + static_cast<unsigned>(kTurn[k][1]);
      const auto [at, is_new] = vertex_of.emplace(lattice[0] | lattice[1] << 20U | lattice[2] << 40U,
                                                  static_cast<std::uint32_t>(mesh.vertices_map.size()));
      if (is_new) {
        Eigen::Vector3d corner = side.middle;
        corner[u] += (2 * kTurn[k][0] - 1) * half_m;
        corner[v] += (2 * kTurn[k][1] - 1) * half_m;
        mesh.vertices_map.push_back(corner);
        mesh.normals_map.emplace_back(Eigen::Vector3f::Zero());
      }
      mesh.normals_map[at->second][axis] += static_cast<float>(front);
      corners[k] = at->second;
    }
    if (front < 0) std::swap(corners[1], corners[3]);
    mesh.triangles.push_back({corners[0], corners[1], corners[2]});
    mesh.triangles.push_back({corners[0], corners[2], corners[3]});
  }

  Eigen::Vector3d nearestOn(const Side& side, const Eigen::Vector3d& x) const {
    Eigen::Vector3d at = x.cwiseMax(side.middle - Eigen::Vector3d::Constant(half_m))
                             .cwiseMin(side.middle + Eigen::Vector3d::Constant(half_m));
    at[side.axis] = side.middle[side.axis];
    return at;
  }

  /// The nearest side and its nearest point.
  std::pair<const Side*, Eigen::Vector3d> nearest(const Eigen::Vector3d& x) const {
    flann::KNNSimpleResultSet<double> closest(1);
    index->findNeighbors(closest, x.data(), flann::SearchParams(flann::FLANN_CHECKS_UNLIMITED));
    std::size_t first = 0;
    double squared = 0.0;
    closest.copy(&first, &squared, 1);
    // No corner of a side is farther from its middle than this: the nearest side's middle cannot lie beyond.
    const double reach_m = std::sqrt(squared) + std::sqrt(2.0) * half_m;
    flann::RadiusResultSet<double> within(reach_m * reach_m);
    index->findNeighbors(within, x.data(), flann::SearchParams(flann::FLANN_CHECKS_UNLIMITED));
    std::vector<std::size_t> candidates(within.size());
    std::vector<double> distances(within.size());
    within.copy(candidates.data(), distances.data(), within.size(), false);
    std::pair<const Side*, Eigen::Vector3d> best{&sides[first], nearestOn(sides[first], x)};
    for (const std::size_t i : candidates) {
      const Eigen::Vector3d at = nearestOn(sides[i], x);
      if ((at - x).squaredNorm() < (best.second - x).squaredNorm()) best = {&sides[i], at};
    }
    return best;
  }

  std::shared_ptr<const octomap::OcTree> owner;
  const octomap::OcTree& tree;
  double half_m;
  gpis_mapping::TriangleMesh mesh;
  std::vector<Side> sides;
  std::unordered_map<std::uint64_t, std::uint32_t> vertex_of;  // corner of the lattice -> vertex
  std::optional<flann::KDTreeSingleIndex<flann::L2_3D<double>>> index;
};

VoxelSurface::VoxelSurface(std::shared_ptr<const octomap::OcTree> tree, bool without_specks)
    : impl_(std::make_unique<Impl>(std::move(tree), without_specks)) {}

VoxelSurface::~VoxelSurface() = default;

const gpis_mapping::TriangleMesh& VoxelSurface::mesh() const {
  return impl_->mesh;
}

gpis_mapping::QueryResult VoxelSurface::query(const gpis_mapping::Points3d& points_map,
                                              const gpis_mapping::QueryOptions& options) const {
  const Eigen::Index count = points_map.cols();
  gpis_mapping::QueryResult result;
  result.distance = result.euclidean_distance = result.surface_std = Eigen::VectorXd::Constant(count, kNaN);
  result.gradient = result.euclidean_gradient = gpis_mapping::Points3d::Constant(3, count, kNaN);
  if (options.variance) result.variance = result.occupancy = Eigen::VectorXd::Constant(count, kNaN);
  if (options.variance_gradient) result.variance_gradient = gpis_mapping::Points3d::Constant(3, count, kNaN);
  result.state.assign(static_cast<std::size_t>(count), SpaceState::kUnknown);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Vector3d x = points_map.col(i);
    if (!x.allFinite()) continue;
    const octomap::OcTreeNode* node = impl_->tree.search(x.x(), x.y(), x.z());
    const SpaceState state = stateOf(impl_->tree, node);
    result.state[static_cast<std::size_t>(i)] = state;
    if (options.variance && node != nullptr) result.occupancy[i] = node->getOccupancy();
    if (impl_->sides.empty()) continue;
    const auto [side, at] = impl_->nearest(x);
    Eigen::Vector3d normal = Eigen::Vector3d::Zero();
    normal[side->axis] = side->front;
    const Eigen::Vector3d way = x - at;
    const double distance_m = way.norm();
    const bool is_behind = state == SpaceState::kOccupied || (state == SpaceState::kUnknown && way.dot(normal) < 0.0);
    const double sign = is_behind ? -1.0 : 1.0;
    const Eigen::Vector3d away = distance_m > 0.0 ? Eigen::Vector3d(way / distance_m) : Eigen::Vector3d(sign * normal);
    result.euclidean_distance[i] = distance_m;
    result.euclidean_gradient.col(i) = away;
    result.distance[i] = sign * distance_m;
    result.gradient.col(i) = sign * away;
    result.surface_std[i] = 2.0 * impl_->half_m / std::sqrt(12.0);
  }
  return result;
}

}  // namespace octomap_baseline
