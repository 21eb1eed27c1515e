// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "motion_planning/arm_kinematics.h"

namespace motion_planning {

/// How the tool comes to a face.
enum class ApproachKind { kTop, kSide };
const char* toString(ApproachKind kind);  // "top", "side"

/// The part of a hollow cylinder about the arm's vertical axis that is good for picking with one kind of approach
/// (method section 8, eqs 12-13). Frame: ur5e_base_link, x as base_link's.
struct AnnulusSector {
  double min_radius_m{0.0};    // r
  double max_radius_m{0.0};    // R
  double min_height_m{0.0};    // h, of the tip above the arm's foot
  double max_height_m{0.0};    // H
  double half_angle_rad{0.0};  // about straight ahead
  double cone_rad{0.0};        // tool axis within this of straight down (top) or of the horizontal (side)

  bool contains(const Eigen::Vector3d& p_armbase) const;
};

struct ManipulabilityConfig {
  double joint_step_rad{0.2617993877991494};  // of the sampled joint space; wrist_3 does not matter and is not sampled
  double min_manipulability_m3{0.02};         // m_thres of Yoshikawa's measure
  double cone_rad{0.5235987755982988};
  double min_fill{0.5};  // share of a cell's neighbourhood that must be reached; see fitSector
  double cell_m{0.05};

  std::vector<std::string> validate() const;
};

struct ReachSample {
  Eigen::Vector3d tip_armbase;
  Eigen::Vector3d tool_axis_armbase;  // unit
  double manipulability_m3;
  ApproachKind kind;
};

/// What configurations reach: steps through joint space (eq 12). `is_free` rejects self and base collision.
std::vector<ReachSample> sampleReach(const ArmKinematics& arm, const ManipulabilityConfig& config,
                                     const std::function<bool(const ArmVector&)>& is_free);

/// The sector that samples of one kind fill (eq 13): robust, a few outliers change nothing, and inside the sector at least
/// `min_fill` of the volume is reached. Throws std::runtime_error if the samples fill none.
AnnulusSector fitSector(const std::vector<ReachSample>& samples, ApproachKind kind, const ManipulabilityConfig& config);

/// Both sectors with the URDF they came from.
class ManipulabilitySectors {
 public:
  AnnulusSector top;
  AnnulusSector side;
  ManipulabilityConfig config;
  std::string urdf_checksum;

  const AnnulusSector& of(ApproachKind kind) const { return kind == ApproachKind::kTop ? top : side; }

  /// Whether a face can be touched: `point` its contact point, `normal` its outward unit normal, both in base_link.
  /// `T_base_armbase` is fixed by the URDF.
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
