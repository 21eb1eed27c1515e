// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <base_navigation/planar.h>
#include <gpis_mapping/ground_projection.h>
#include <interactive_mapping_common/config/schema.h>
#include <motion_planning/manipulability_sector.h>

#include "nbv_selection/scene_model.h"

namespace nbv_selection {

/// How much a sample counts by the direction its surface looks.
enum class ApproachWeight {
  kSector,  // max(0, -n . a), a: down in the top sector, away from the arm's axis in the side sector; the better one
  kFromArmBase,  // the paper's n . p / |p|, p from the arm's foot: a top face at shoulder height counts nothing
};

inline constexpr interactive_mapping::Names<ApproachWeight> kApproachWeightNames = {
    {"sector", ApproachWeight::kSector}, {"from_arm_base", ApproachWeight::kFromArmBase}};

struct ManipulabilityScoreConfig {
  double cell_m{0.05};
  double band_m{0.05};
  ApproachWeight weight{ApproachWeight::kSector};

  static void fields(ManipulabilityScoreConfig& c, interactive_mapping::Fields& f) {
    f("approach", c.weight, kApproachWeightNames,
      "samples are weighted by the directions that the sectors allow, or by the direction from the arm's foot as in "
      "the paper, where a top face at shoulder height counts nothing");
    f("cell_m", c.cell_m, 0.02, 0.2, "m", "cell of the lattice of samples");
    // With less, a level surface between two layers of the lattice is missed.
    f("band_m", c.band_m, 0.5 * c.cell_m, 0.2, "m",
      "samples farther from the surface count 0; at least half of cell_m");
  }
};

/// One of the samples of a standing place, for those who look.
struct ManipulabilitySample {
  Eigen::Vector3d p_map{Eigen::Vector3d::Zero()};
  float share{0.0F};  // w_j p_j, in [0, 1]
};

/// N of eq 14: lattice points in the union of both sectors, of a base at the map's origin. Depends on the robot and the
/// lattice alone.
double countSamples(const motion_planning::ManipulabilitySectors& sectors, const Eigen::Isometry3d& T_base_armbase,
                    double cell_m);

/// The manipulability of standing places (eq 14): m = (1 / N) sum_j w_j p(o = 1 | p_j) over the samples of both annulus
/// sectors, N their number. Samples are the middles of cells of one lattice of the map. So neighbouring poses share
/// them, and the map is asked once for each. Only those near the surface are asked; the rest counts 0.
class ManipulabilityScore {
 public:
  /// Asks `scene` about all lattice points near `surface` that are above the ground by at least `min_height_m`.
  /// `T_base_armbase`: foot of the arm in base_link, from the URDF. Throws std::invalid_argument for an impossible config,
  /// std::runtime_error if the map does not answer. `num_samples`: what countSamples() gives, for callers that have counted before,
  /// which takes as long as asking a small map.
  ManipulabilityScore(const SceneModel& scene, const MappedSurface& surface, const gpis_mapping::GroundPlane& ground,
                      double min_height_m, const motion_planning::ManipulabilitySectors& sectors,
                      const Eigen::Isometry3d& T_base_armbase, const ManipulabilityScoreConfig& config,
                      std::optional<double> num_samples = std::nullopt);

  /// m in [0, 1] of a base that stands on the ground plane at this pose (upright on the plane, tilted with it).
  /// `samples`, if not null, gets all of the sectors' samples with a share above 0. 0 for a pose that is not finite.
  double at(const base_navigation::Pose2d& T_map_base, std::vector<ManipulabilitySample>* samples = nullptr) const;

  /// Lattice points that the map was asked about.
  std::size_t numAsked() const { return num_asked_; }

 private:
  std::vector<Eigen::Vector3d> points_map_;  // with a probability above 0
  std::vector<Eigen::Vector3d> normals_map_;
  std::vector<double> probability_;
  std::size_t num_asked_{0};
  double num_samples_{0.0};
  gpis_mapping::GroundPlane ground_;
  motion_planning::ManipulabilitySectors sectors_;
  Eigen::Isometry3d T_base_armbase_;
  ManipulabilityScoreConfig config_;
};

/// Pose in the map of a base that stands on the plane at `pose`: z along the plane's normal, x above the heading.
Eigen::Isometry3d standOn(const gpis_mapping::GroundPlane& ground, const base_navigation::Pose2d& pose);

}  // namespace nbv_selection
