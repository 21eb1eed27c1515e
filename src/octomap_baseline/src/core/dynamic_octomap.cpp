// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline/dynamic_octomap.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>

#include <interactive_mapping_common/formatted.h>
#include <interactive_mapping_common/geometry/rigid_motion.h>
#include <interactive_mapping_common/stopwatch.h>
#include <interactive_mapping_common/threads/parallel_for.h>

#include "octomap_baseline/placed_nodes.h"

namespace octomap_baseline {

using gpis_mapping::PixelKind;
using interactive_mapping::Stopwatch;
using octomap::OcTreeKey;

namespace {

constexpr unsigned kBlockDepth = 14;  // of the octree's 16 levels: nodes of 4 x 4 x 4 voxels

octomap::point3d toOctomap(const Eigen::Vector3d& p) {
  return {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())};
}

std::string text(const Eigen::Vector3d& p) {
  return interactive_mapping::formatted("[%g, %g, %g]", p.x(), p.y(), p.z());
}

std::unique_ptr<octomap::OcTree> makeTree(const OctomapConfig& config) {
  auto tree = std::make_unique<octomap::OcTree>(config.resolution_m);
  tree->setProbHit(config.occupancy.prob_hit);
  tree->setProbMiss(config.occupancy.prob_miss);
  tree->setClampingThresMin(config.occupancy.clamp_min);
  tree->setClampingThresMax(config.occupancy.clamp_max);
  tree->setOccupancyThres(config.occupancy.threshold);
  return tree;
}

void requireUsablePose(const Eigen::Isometry3d& pose, double stamp_s, double max_range_m, double resolution_m) {
  if (!std::isfinite(stamp_s)) throw std::invalid_argument("stamp is not finite");
  interactive_mapping::requireRigid(pose, "camera pose");
  const double reach_m = (kKeyOrigin - 4) * resolution_m - max_range_m;
  if (pose.translation().cwiseAbs().maxCoeff() > reach_m) {
    std::ostringstream out;
    out << "camera position " << text(pose.translation()) << " m, must be within +-" << reach_m
        << " m: the octree has 2^16 voxels of " << resolution_m << " m along each axis";
    throw std::invalid_argument(out.str());
  }
}

}  // namespace

/// One image, seen from one place.
struct DynamicOctomap::View {
  gpis_mapping::ClassifiedFrame frame;
  Eigen::Isometry3d T_map_camera;
  Eigen::Isometry3d T_camera_map;
};

DynamicOctomap::DynamicOctomap(const OctomapConfig& config) : config_(config) {
  requireValid(config_);
  threads_ = interactive_mapping::resolveThreadCount(config_.threads);
  hits_.resize(threads_);
  ends_.resize(threads_);
  misses_.resize(threads_);
  classifier_config_.sensor = config_.sensor;
  classifier_config_.frame_map.wall_range_m =
      std::max(classifier_config_.frame_map.wall_range_m, 10.0 * config_.sensor.max_range_m);
  tree_ = makeTree(config_);
  // A voxel is in the region when its centre is.
  for (unsigned axis = 0; axis < 3; ++axis) {
    const auto key = [&](double voxels) {
      return static_cast<octomap::key_type>(
          std::min(2.0 * kKeyOrigin - 1.0, std::max(0.0, std::floor(voxels) + kKeyOrigin)));
    };
    region_min_[axis] = key(config_.region.min_m[axis] / config_.resolution_m + 0.5);
    region_max_[axis] = key(config_.region.max_m[axis] / config_.resolution_m - 0.5);
  }
}

void DynamicOctomap::clear() {
  tree_ = makeTree(config_);
  stamp_s_ = 0.0;
  num_updates_ = 0;
  num_occupied_ = 0;
}

void DynamicOctomap::prepareCamera(const gpis_mapping::CameraModel& camera) {
  if (classifier_ && camera == camera_) return;
  const std::vector<std::string> problems = camera.validate();
  if (!problems.empty()) throw std::invalid_argument("impossible camera: " + problems.front());
  classifier_ = std::make_unique<gpis_mapping::DepthClassifier>(camera, classifier_config_);
  camera_ = camera;
}

OctomapUpdateStatistics DynamicOctomap::update(const gpis_mapping::DepthImage& image,
                                               const gpis_mapping::CameraModel& camera,
                                               const Eigen::Isometry3d& T_map_camera, double stamp_s) {
  OctomapUpdateStatistics statistics;
  Stopwatch timer;
  requireUsablePose(T_map_camera, stamp_s, config_.sensor.max_range_m, config_.resolution_m);
  prepareCamera(camera);
  const View view{classifier_->classify(image, threads_), T_map_camera, T_map_camera.inverse()};
  statistics.points_in = view.frame.num_surface;
  statistics.view_box_map = classifier_->viewBox(view.frame, T_map_camera);
  statistics.classify_ms = timer.lapMs();

  VoxelSet& hits = hits_.front();
  VoxelSet& ends = ends_.front();
  VoxelSet& misses = misses_.front();
  collectEnds(view, &hits, &ends);
  castRays(view, ends, &misses, &statistics);
  statistics.cast_ms = timer.lapMs();

  applyMisses(view, misses, hits, &statistics);
  applyHits(hits, &statistics);
  stamp_s_ = stamp_s;
  ++num_updates_;
  num_occupied_ += statistics.inserted;
  num_occupied_ -= statistics.freed;
  statistics.occupied = num_occupied_;
  statistics.nodes = tree_->size();
  statistics.update_ms = timer.lapMs();
  statistics.total_ms = statistics.classify_ms + statistics.cast_ms + statistics.update_ms;
  return statistics;
}

void DynamicOctomap::collectEnds(const View& view, VoxelSet* hits, VoxelSet* ends) {
  const double max_range = config_.sensor.max_range_m;
  // Two voxels beyond the last one that can be hit, or that one could never be cleared.
  const double wall_range = max_range + 2.0 * config_.resolution_m;
  const Eigen::Matrix3d R_map_camera = view.T_map_camera.linear();
  const Eigen::Vector3d origin = view.T_map_camera.translation();
  const int rows_each = (camera_.height + threads_ - 1) / threads_;
  const auto collectRows = [&](int first_row, int last_row, VoxelSet* own_hits, VoxelSet* own_ends) {
    for (int v = first_row; v < last_row; ++v) {
      for (int u = 0; u < camera_.width; ++u) {
        const std::size_t i = view.frame.index(u, v);
        const PixelKind kind = view.frame.kind[i];
        if (kind == PixelKind::kNoInformation || (kind != PixelKind::kSurface && !config_.dynamic.virtual_wall)) {
          continue;
        }
        const Eigen::Vector3d ray =
            R_map_camera * Eigen::Vector3d((u - camera_.cx) / camera_.fx, (v - camera_.cy) / camera_.fy, 1.0);
        const double length = classifier_->rayLength(u, v);
        const double range = kind == PixelKind::kSurface ? length / view.frame.inverse_depth[i]
                                                         : std::numeric_limits<double>::infinity();
        const OcTreeKey key = tree_->coordToKey(toOctomap(origin + ray * (std::min(range, wall_range) / length)));
        const bool is_hit = range <= max_range;
        own_ends->insert(key);
        if (is_hit) own_hits->insert(key);
      }
    }
  };
  interactive_mapping::parallelFor(hits_.size(), threads_, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t w = begin; w < end; ++w) {
      hits_[w].clear();
      ends_[w].clear();
      const int first_row = static_cast<int>(w) * rows_each;
      collectRows(first_row, std::min(camera_.height, first_row + rows_each), &hits_[w], &ends_[w]);
    }
  });
  for (std::size_t w = 1; w < hits_.size(); ++w) {
    hits->merge(hits_[w]);
    ends->merge(ends_[w]);
  }
}

void DynamicOctomap::castRays(const View& view, const VoxelSet& ends, VoxelSet* misses,
                              OctomapUpdateStatistics* statistics) {
  std::vector<octomap::point3d> targets;
  for (const VoxelSet::Block& block : ends.sortedBlocks()) {
    for (std::uint64_t bits = block.bits; bits != 0; bits &= bits - 1) {
      targets.push_back(tree_->keyToCoord(VoxelSet::keyOf(block.id, static_cast<unsigned>(__builtin_ctzll(bits)))));
    }
  }
  statistics->rays = targets.size();
  const octomap::point3d origin = toOctomap(view.T_map_camera.translation());
  interactive_mapping::parallelFor(misses_.size(), threads_, 1, [&](std::size_t begin, std::size_t end) {
    octomap::KeyRay ray;
    for (std::size_t w = begin; w < end; ++w) {
      misses_[w].clear();
      for (std::size_t i = w; i < targets.size(); i += misses_.size()) {
        if (!tree_->computeRayKeys(origin, targets[i], ray)) continue;
        for (const OcTreeKey& key : ray) {
          if (inRegion(key)) misses_[w].insert(key);
        }
      }
    }
  });
  for (std::size_t w = 1; w < misses_.size(); ++w) misses->merge(misses_[w]);
}

void DynamicOctomap::applyMisses(const View& view, const VoxelSet& misses, const VoxelSet& hits,
                                 OctomapUpdateStatistics* statistics) {
  const float miss = tree_->getProbMissLog();
  const float least = tree_->getClampingThresMinLog();
  std::vector<OcTreeKey> occupied;
  const auto isSettled = [&](const octomap::OcTreeNode* node) {
    return node != nullptr && !tree_->nodeHasChildren(node) && node->getLogOdds() <= least;
  };
  for (const VoxelSet::Block& block : misses.sortedBlocks()) {
    const std::uint64_t bits = block.bits & ~hits.bitsOf(block.id);
    statistics->missed_voxels += static_cast<std::size_t>(__builtin_popcountll(bits));
    // Most of the space in view has been free for long: one look at the node answers for the whole block.
    const OcTreeKey block_key = VoxelSet::keyOf(block.id, 0);
    if (isSettled(tree_->search(block_key, kBlockDepth))) continue;
    for (unsigned octant = 0; octant < 8; ++octant) {
      const unsigned voxels = static_cast<unsigned>(bits >> (8 * octant) & 0xFF);
      if (voxels == 0) continue;
      // Looked up anew: pruning and expanding replace nodes.
      const octomap::OcTreeNode* node = tree_->search(block_key, kBlockDepth);
      if (node != nullptr && tree_->nodeChildExists(node, octant) && isSettled(tree_->getNodeChild(node, octant))) {
        continue;
      }
      for (unsigned i = 0; i < 8; ++i) {
        if ((voxels >> i & 1) == 0) continue;
        const OcTreeKey key = VoxelSet::keyOf(block.id, 8 * octant + i);
        const octomap::OcTreeNode* leaf = tree_->search(key);
        if (leaf != nullptr && tree_->isNodeOccupied(leaf)) {
          occupied.push_back(key);
        } else if (leaf == nullptr || leaf->getLogOdds() > least) {
          tree_->updateNode(key, miss);
        }
      }
    }
  }
  if (!config_.dynamic.enabled) return;

  // So little below the threshold that one hit makes it occupied again.
  const float freed = tree_->getOccupancyThresLog() + 0.5f * miss;
  std::vector<std::uint8_t> is_empty(occupied.size(), 0);
  if (config_.dynamic.policy == ForgetPolicy::kSeenThrough) {
    interactive_mapping::parallelFor(occupied.size(), threads_, 256, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) is_empty[i] = isSeenThrough(view, occupied[i]);
    });
  }
  for (std::size_t i = 0; i < occupied.size(); ++i) {
    const octomap::OcTreeNode* leaf =
        is_empty[i] ? tree_->setNodeValue(occupied[i], freed) : tree_->updateNode(occupied[i], miss);
    statistics->freed += !tree_->isNodeOccupied(leaf);
  }
}

void DynamicOctomap::applyHits(const VoxelSet& hits, OctomapUpdateStatistics* statistics) {
  const float hit = tree_->getProbHitLog();
  for (const VoxelSet::Block& block : hits.sortedBlocks()) {
    for (std::uint64_t bits = block.bits; bits != 0; bits &= bits - 1) {
      const OcTreeKey key = VoxelSet::keyOf(block.id, static_cast<unsigned>(__builtin_ctzll(bits)));
      if (!inRegion(key)) continue;
      ++statistics->hit_voxels;
      const octomap::OcTreeNode* before = tree_->search(key);
      const bool was_occupied = before != nullptr && tree_->isNodeOccupied(before);
      const octomap::OcTreeNode* after = tree_->updateNode(key, hit);
      statistics->inserted += !was_occupied && tree_->isNodeOccupied(after);
    }
  }
}

bool DynamicOctomap::isSeenThrough(const View& view, const OcTreeKey& key) const {
  const octomap::point3d center = tree_->keyToCoord(key);
  const Eigen::Vector3d p_camera = view.T_camera_map * Eigen::Vector3d(center.x(), center.y(), center.z());
  const double half_diagonal = 0.5 * std::sqrt(3.0) * config_.resolution_m;
  const double z = p_camera.z();
  if (z <= half_diagonal) return false;
  const double sigma = config_.sensor.noise.sigma(z);
  const double tolerance = std::max(config_.dynamic.min_tolerance_m,
                                    config_.dynamic.tolerance_sigmas * std::hypot(sigma, config_.sensor.pose_std_m));
  const double range = p_camera.norm();
  const double far = 1.0 / (range + half_diagonal + tolerance);
  const double near = 1.0 / std::max(1e-3, range - half_diagonal - tolerance);

  const double u = camera_.fx * p_camera.x() / z + camera_.cx;
  const double v = camera_.fy * p_camera.y() / z + camera_.cy;
  const double last_u = camera_.width - 1;
  const double last_v = camera_.height - 1;
  if (!(u > -0.5 && v > -0.5 && u < last_u + 0.5 && v < last_v + 0.5)) return false;
  // Every pixel that a surface anywhere in the voxel can be seen by; at least the four around its centre.
  const double radius_u = std::max(1.0, camera_.fx * half_diagonal / z);
  const double radius_v = std::max(1.0, camera_.fy * half_diagonal / z);
  const int first_column = static_cast<int>(std::ceil(std::max(0.0, u - radius_u)));
  const int last_column = static_cast<int>(std::floor(std::min(last_u, u + radius_u)));
  const int first_row = static_cast<int>(std::ceil(std::max(0.0, v - radius_v)));
  const int last_row = static_cast<int>(std::floor(std::min(last_v, v + radius_v)));
  const std::size_t middle = view.frame.index(static_cast<int>(std::lround(std::min(last_u, std::max(0.0, u)))),
                                              static_cast<int>(std::lround(std::min(last_v, std::max(0.0, v)))));
  std::size_t all = 0;
  std::size_t past = 0;
  bool middle_past = false;
  for (int row = first_row; row <= last_row; ++row) {
    for (int column = first_column; column <= last_column; ++column) {
      const std::size_t i = view.frame.index(column, row);
      ++all;
      const PixelKind kind = view.frame.kind[i];
      if (kind == PixelKind::kNoInformation) continue;
      const double inverse_range = view.frame.inverse_range[i];
      if (inverse_range <= far) {
        ++past;
        middle_past = middle_past || i == middle;
      } else if (inverse_range < near) {
        return false;  // ends in the voxel, or as good as
      }
    }
  }
  return middle_past && static_cast<double>(past) >= config_.dynamic.least_share * static_cast<double>(all);
}

std::size_t DynamicOctomap::clearBox(const Eigen::Vector3d& min_map, const Eigen::Vector3d& max_map) {
  if (!min_map.allFinite() || !max_map.allFinite() || (min_map.array() > max_map.array()).any()) {
    throw std::invalid_argument("box from " + text(min_map) + " m to " + text(max_map) +
                                " m: corners must be finite, and min not above max on any axis");
  }
  const Eigen::AlignedBox3d box(min_map, max_map);
  const auto intersects = [&](const PlacedNode& node) { return node.box(*tree_).intersects(box); };
  std::vector<OcTreeKey> known;
  std::size_t freed = 0;
  // A pruned leaf may reach out of the box: its voxels are looked at one by one.
  forEachLeaf(*tree_, placedRoot(*tree_), intersects, [&](const PlacedNode& leaf) {
    if (leaf.node->getLogOdds() <= tree_->getClampingThresMinLog()) return;
    const std::uint64_t across = leaf.width(*tree_);
    for (std::uint64_t i = 0; i < across * across * across; ++i) {
      OcTreeKey key = leaf.first;
      key[0] = static_cast<octomap::key_type>(key[0] + i / across / across);
      key[1] = static_cast<octomap::key_type>(key[1] + i / across % across);
      key[2] = static_cast<octomap::key_type>(key[2] + i % across);
      if (!box.contains(centerOf(*tree_, key))) continue;
      known.push_back(key);
      freed += isOccupied(*tree_, leaf);
    }
  });
  for (const OcTreeKey& key : known) tree_->setNodeValue(key, tree_->getClampingThresMinLog());
  num_occupied_ -= freed;
  return freed;
}

}  // namespace octomap_baseline
