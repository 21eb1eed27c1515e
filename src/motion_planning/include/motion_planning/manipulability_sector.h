// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <interactive_mapping_common/enums/enum_names.h>

#include "motion_planning/arm_kinematics.h"

namespace motion_planning {

/// How the tool comes to a face.
enum class ApproachKind { kTop, kSide };
inline constexpr interactive_mapping::Names<ApproachKind> kApproachKindNames = {{"top", ApproachKind::kTop},
                                                                                {"side", ApproachKind::kSide}};
constexpr const char* toString(ApproachKind kind) {
  return interactive_mapping::nameOf(kind, kApproachKindNames);
}

/// The part of a hollow cylinder about the arm's vertical axis that is good for picking from the top or from a
/// side, one sector each (method section 8, eqs 12-13). Frame: ur5e_base_link, x as base_link's.
struct AnnulusSector {
  double min_radius_m{0.0};    // r
  double max_radius_m{0.0};    // R
  double min_height_m{0.0};    // h, of the tip above the arm's foot
  double max_height_m{0.0};    // H
  double half_angle_rad{0.0};  // about straight ahead

  bool contains(const Eigen::Vector3d& p_armbase) const;  // false for NaN
  double volume() const;                                  // [m^3]
};

struct ManipulabilityConfig {
  double joint_step_rad{0.17453292519943295};  // of the sampled joint space; wrist_3 does not matter and is not sampled
  /// m_thres of Yoshikawa's measure: a fifth of the largest that postures with the tool on a face have, 0.12 m^3. The
  /// measure is a product of the sines of elbow and wrist 2 and the wrist's distance from the pan axis. So none of them
  /// is within a fifth (12 degrees) of its singularity. A third of the postures on top faces have less, two of side
  /// faces.
  double min_manipulability_m3{0.025};
  double cone_rad{0.5235987755982988};    // tool axis within this of straight down (top), of the horizontal (side)
  double facing_rad{0.7853981633974483};  // and (side) its heading of outward: of four sides one is within 45 degrees
  /// Sectors are not wider. The robot faces what it picks; behind the arm is the robot itself. A sector that reaches
  /// round it loses the heights beside the base where bricks lie.
  double max_half_angle_rad{1.5707963267948966};
  double cell_m{0.05};      // of the grid that reach is counted on
  double min_density{0.1};  // of the median cell's samples: cells with fewer count as not reached
  double min_fill{0.7};     // share reached of whatever the sector is extended by

  std::vector<std::string> validate() const;
};

struct ReachSample {
  Eigen::Vector3d tip_armbase;
  double manipulability_m3;
  ApproachKind kind;
};

/// What configurations reach. Steps through joint space (eq 12) and keeps those whose tool can touch a face from above
/// or from the arm's side with enough manipulability. `is_free` rejects self and base collision. `progress`, if any,
/// gets the share done. Throws std::invalid_argument for a bad config.
std::vector<ReachSample> sampleReach(const ArmKinematics& arm, const ManipulabilityConfig& config,
                                     const std::function<bool(const ArmVector&)>& is_free,
                                     const std::function<void(double)>& progress = {});

struct SectorFit {
  AnnulusSector sector;
  double fill{0.0};            // share of the sector's volume that is reached
  double share_of_reach{0.0};  // share of all that is reached that is in the sector
};

/// The sector that samples of one kind fill (eq 13), on a grid over radius, height and bearing. It has the largest sum
/// over cells of volume x (reached - min_fill). A layer of cells is added on any side as long as at least `min_fill` of
/// it is reached. So no outlier stretches a bound and no hole breaks the sector. Within it, at least `min_fill` is
/// reached. Left and right count alike. Throws std::runtime_error if the samples fill none.
SectorFit fitSector(const std::vector<ReachSample>& samples, ApproachKind kind, const ManipulabilityConfig& config);

/// Both sectors with the URDF they came from.
class ManipulabilitySectors {
 public:
  AnnulusSector top;
  AnnulusSector side;
  ManipulabilityConfig config;
  std::string urdf_checksum;

  const AnnulusSector& of(ApproachKind kind) const { return kind == ApproachKind::kTop ? top : side; }

  /// Whether a face can be touched: `point` its contact point, `normal` its outward unit normal, both in base_link. A
  /// normal within the cone of up must be in the top sector. One within the cone of level must be in the side sector
  /// and face the arm. One between is in both, and looks towards the arm within twice `facing_rad`. `T_base_armbase` is
  /// fixed by the URDF. `why_not`, if not null, gets a sentence when false.
  bool admits(const Eigen::Vector3d& point_base, const Eigen::Vector3d& normal_base,
              const Eigen::Isometry3d& T_base_armbase, std::string* why_not = nullptr) const;

  std::string toYaml() const;
  /// Throws std::invalid_argument listing everything wrong with the text; a checksum that is not `robot`'s is refused with
  /// the command that makes a new file.
  static ManipulabilitySectors parse(const std::string& yaml, const std::string& name,
                                     const mp700_ur5e_description::RobotModel& robot);
  static ManipulabilitySectors load(const std::string& path, const mp700_ur5e_description::RobotModel& robot);
};

}  // namespace motion_planning
