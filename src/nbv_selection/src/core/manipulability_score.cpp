// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/manipulability_score.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <unordered_map>

namespace nbv_selection {
namespace {

using gpis_mapping::LatticeKey;
using motion_planning::AnnulusSector;

/// Agreement of a surface's normal with a direction the tool comes in.
double agreement(const Eigen::Vector3d& normal, const Eigen::Vector3d& approach) {
  return std::max(0.0, -normal.dot(approach));
}

/// A set of lattice points, most of them next to each other: flags in blocks.
class LatticeSet {
 public:
  /// The point's flag; it stays where it is.
  bool& at(const LatticeKey& key) {
    const LatticeKey block{blockOf(key.x), blockOf(key.y), blockOf(key.z)};
    // A mesh's neighbours follow each other: hardly ever another block.
    if (last_ == nullptr || block != last_block_) {
      last_block_ = block;
      last_ = &blocks_[block];
    }
    const std::int32_t x = key.x - block.x * kSide, y = key.y - block.y * kSide, z = key.z - block.z * kSide;
    return (*last_)[static_cast<std::size_t>((z * kSide + y) * kSide + x)];
  }

  /// All that are set, in the lattice's order.
  std::vector<LatticeKey> keys() const {
    std::vector<LatticeKey> result;
    for (const auto& [block, flags] : blocks_) {
      for (std::size_t i = 0; i < flags.size(); ++i) {
        if (!flags[i]) continue;
        const auto index = static_cast<std::int32_t>(i);
        result.push_back({block.x * kSide + index % kSide, block.y * kSide + index / kSide % kSide,
                          block.z * kSide + index / (kSide * kSide)});
      }
    }
    std::sort(result.begin(), result.end());  // the hash map's order is the library's
    return result;
  }

 private:
  static constexpr std::int32_t kSide = 16;
  using Block = std::array<bool, kSide * kSide * kSide>;

  static std::int32_t blockOf(std::int32_t index) { return (index >= 0 ? index : index - kSide + 1) / kSide; }

  std::unordered_map<LatticeKey, Block, gpis_mapping::LatticeKeyHash> blocks_;  // its values stay where they are
  LatticeKey last_block_;
  Block* last_{nullptr};
};

/// Lattice points within the band of the surface and above the ground, in the lattice's order.
std::vector<LatticeKey> latticeNear(const MappedSurface& surface, const gpis_mapping::GroundPlane& ground,
                                    double min_height_m, const ManipulabilityScoreConfig& config) {
  LatticeSet near;
  // Cells whose middles are in reach along an axis; a nanometre, so that rounding loses none at the border.
  const Eigen::Vector3d reach_m = Eigen::Vector3d::Constant(config.band_m - 0.5 * config.cell_m + 1e-9);
  for (const Eigen::Vector3d& p_map : surface.points_map) {
    if (!p_map.allFinite() || ground.heightOf(p_map) < min_height_m - config.band_m) continue;
    const LatticeKey low = LatticeKey::of(p_map - reach_m, config.cell_m);
    const LatticeKey high = LatticeKey::of(p_map + reach_m, config.cell_m);
    for (LatticeKey key = low; key.x <= high.x; ++key.x) {
      for (key.y = low.y; key.y <= high.y; ++key.y) {
        for (key.z = low.z; key.z <= high.z; ++key.z) {
          const Eigen::Vector3d center_map = key.center(config.cell_m);
          if ((center_map - p_map).squaredNorm() > config.band_m * config.band_m) continue;
          bool& is_near = near.at(key);
          if (!is_near) is_near = ground.heightOf(center_map) >= min_height_m;
        }
      }
    }
  }
  return near.keys();
}

}  // namespace

double countSamples(const motion_planning::ManipulabilitySectors& sectors, const Eigen::Isometry3d& T_base_armbase,
                    double cell_m) {
  // The sectors are inside a ball about the arm's foot.
  double reach_m = 0.0;
  for (const AnnulusSector* sector : {&sectors.top, &sectors.side}) {
    const double height_m = std::max(std::abs(sector->min_height_m), std::abs(sector->max_height_m));
    reach_m = std::max(reach_m, std::hypot(sector->max_radius_m, height_m));
  }
  const Eigen::Vector3d foot_base = T_base_armbase.translation();
  const LatticeKey low = LatticeKey::of(foot_base - Eigen::Vector3d::Constant(reach_m), cell_m);
  const LatticeKey high = LatticeKey::of(foot_base + Eigen::Vector3d::Constant(reach_m), cell_m);
  const Eigen::Isometry3d T_armbase_base = T_base_armbase.inverse(Eigen::Isometry);
  double count = 0.0;
  for (LatticeKey key = low; key.x <= high.x; ++key.x) {
    for (key.y = low.y; key.y <= high.y; ++key.y) {
      for (key.z = low.z; key.z <= high.z; ++key.z) {
        const Eigen::Vector3d p_armbase = T_armbase_base * key.center(cell_m);
        if (sectors.top.contains(p_armbase) || sectors.side.contains(p_armbase)) count += 1.0;
      }
    }
  }
  return count;
}

ManipulabilityScore::ManipulabilityScore(const SceneModel& scene, const MappedSurface& surface,
                                         const gpis_mapping::GroundPlane& ground, double min_height_m,
                                         const motion_planning::ManipulabilitySectors& sectors,
                                         const Eigen::Isometry3d& T_base_armbase,
                                         const ManipulabilityScoreConfig& config, std::optional<double> num_samples)
    : ground_(ground), sectors_(sectors), T_base_armbase_(T_base_armbase), config_(config) {
  std::vector<std::string> problems = interactive_mapping::problemsOf(config_);
  if (!std::isfinite(min_height_m)) {
    problems.push_back("min_height_m = " + std::to_string(min_height_m) + " m, must be finite");
  }
  if (!T_base_armbase_.matrix().allFinite()) problems.emplace_back("T_base_armbase is not finite, must be a pose");
  interactive_mapping::refuseIfAny("impossible manipulability:", problems);
  num_samples_ = num_samples ? *num_samples : countSamples(sectors_, T_base_armbase_, config_.cell_m);

  const std::vector<LatticeKey> keys = latticeNear(surface, ground, min_height_m, config_);
  num_asked_ = keys.size();
  if (keys.empty()) return;
  gpis_mapping::Points3d asked_map(3, static_cast<Eigen::Index>(keys.size()));
  for (std::size_t i = 0; i < keys.size(); ++i) {
    asked_map.col(static_cast<Eigen::Index>(i)) = keys[i].center(config_.cell_m);
  }
  const OccupancyField field = scene.occupancy(asked_map);
  if (field.is_supported.size() != keys.size() || field.probability.size() != asked_map.cols() ||
      field.normal.cols() != asked_map.cols()) {
    throw std::runtime_error("the map answered for " + std::to_string(field.is_supported.size()) + " of " +
                             std::to_string(keys.size()) + " points");
  }
  for (std::size_t i = 0; i < keys.size(); ++i) {
    const auto column = static_cast<Eigen::Index>(i);
    if (!field.is_supported[i]) continue;
    if (!(field.probability[column] > 0.0) || std::isinf(field.probability[column])) continue;
    points_map_.emplace_back(asked_map.col(column));
    normals_map_.emplace_back(field.normal.col(column));
    probability_.push_back(field.probability[column]);
  }
}

double ManipulabilityScore::at(const base_navigation::Pose2d& T_map_base,
                               std::vector<ManipulabilitySample>* samples) const {
  if (samples != nullptr) samples->clear();
  if (!(num_samples_ > 0.0)) return 0.0;
  const Eigen::Isometry3d T_armbase_map = (standOn(ground_, T_map_base) * T_base_armbase_).inverse(Eigen::Isometry);
  double sum = 0.0;
  for (std::size_t i = 0; i < points_map_.size(); ++i) {
    const Eigen::Vector3d p_armbase = T_armbase_map * points_map_[i];
    const bool is_top = sectors_.top.contains(p_armbase), is_side = sectors_.side.contains(p_armbase);
    if (!is_top && !is_side) continue;
    const Eigen::Vector3d normal_armbase = T_armbase_map.linear() * normals_map_[i];
    double weight = 0.0;  // w_j
    if (config_.weight == ApproachWeight::kFromArmBase) {
      weight = agreement(normal_armbase, p_armbase.normalized());
    } else {
      if (is_top) weight = agreement(normal_armbase, -Eigen::Vector3d::UnitZ());
      const Eigen::Vector3d from_axis(p_armbase.x(), p_armbase.y(), 0.0);
      if (is_side) weight = std::max(weight, agreement(normal_armbase, from_axis.normalized()));
    }
    const double share = weight * probability_[i];
    if (!(share > 0.0)) continue;
    sum += share;
    if (samples != nullptr) samples->push_back({points_map_[i], static_cast<float>(share)});
  }
  // The number of lattice points in the sectors varies by a few with where they stand; N does not.
  return std::min(1.0, sum / num_samples_);
}

Eigen::Isometry3d standOn(const gpis_mapping::GroundPlane& ground, const base_navigation::Pose2d& pose) {
  const Eigen::Vector3d up = ground.normal_map.normalized();
  // The direction in the plane that lies above or below the heading.
  const Eigen::Vector3d heading(std::cos(pose.yaw_rad), std::sin(pose.yaw_rad), 0.0);
  const Eigen::Vector3d ahead = (heading - up.dot(heading) / up.z() * Eigen::Vector3d::UnitZ()).normalized();
  Eigen::Isometry3d T_map_base = Eigen::Isometry3d::Identity();
  T_map_base.linear() << ahead, up.cross(ahead), up;
  T_map_base.translation() << pose.x_m, pose.y_m, ground.zAt(pose.x_m, pose.y_m);
  return T_map_base;
}

}  // namespace nbv_selection
