// SPDX-License-Identifier: BSD-3-Clause
// Where the robot's files are, and how its tool gets to a place: for tests of the simulated world.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>

#include <Eigen/LU>

#include "simulated_world/simulation.h"
#include "simulated_world/world.h"

namespace simulated_world {

inline DescriptionFiles descriptionFiles() {
  const std::string folder = MP700_UR5E_DESCRIPTION_DIR;
  return {folder + "/urdf/mp700_ur5e.urdf", folder + "/config/base_profile.yaml", folder + "/config/bricks.yaml",
          folder + "/config/arm_poses/stowed.yaml"};
}

/// Arm angles for a tool that points straight down in the arm's vertical plane, turned by `pan_rad`: lift, elbow and
/// wrist 1 share the vertical, and two of them are found by Newton's method with finite differences of the model's own
/// kinematics. `reach_m`: of the tip before base_link while the pan is zero. Converges within the arm's reach only: the
/// caller looks at tipError().
class ToolDown {
 public:
  explicit ToolDown(const mjModel& model) : model_(model), data_(makeData(model)) {}

  ArmVector angles(double reach_m, double height_m, double pan_rad = 0.0) {
    double lift = -1.5;
    double elbow = 1.8;
    for (int i = 0; i < 60; ++i) {
      const Eigen::Vector3d p = tip(joints(lift, elbow, 0.0));
      const Eigen::Vector2d error(reach_m - p.x(), height_m - p.z());
      error_m_ = error.norm();
      if (error_m_ < 1e-7) {
        break;
      }
      constexpr double kStep = 1e-6;
      const Eigen::Vector3d by_lift = (tip(joints(lift + kStep, elbow, 0.0)) - p) / kStep;
      const Eigen::Vector3d by_elbow = (tip(joints(lift, elbow + kStep, 0.0)) - p) / kStep;
      Eigen::Matrix2d J;
      J << by_lift.x(), by_elbow.x(), by_lift.z(), by_elbow.z();
      const Eigen::Vector2d change = J.partialPivLu().solve(error);
      const double scale = std::min(1.0, 0.2 / change.norm());
      lift += scale * change.x();
      elbow += scale * change.y();
    }
    return joints(lift, elbow, pan_rad);
  }

  double tipError() const { return error_m_; }

  /// Tip of the magnet with the robot at the map's origin.
  Eigen::Vector3d tip(const ArmVector& arm_rad) {
    mj_resetData(&model_, data_.get());
    for (int i = 0; i < kNumArmJoints; ++i) {
      const int joint = requireId(model_, mjOBJ_JOINT, kArmJoints[static_cast<std::size_t>(i)]);
      data_->qpos[model_.jnt_qposadr[joint]] = arm_rad[i];
    }
    mj_kinematics(&model_, data_.get());
    return Eigen::Map<const Eigen::Vector3d>(data_->site_xpos + 3 * requireId(model_, mjOBJ_SITE, "magnet_tip"));
  }

 private:
  static ArmVector joints(double lift, double elbow, double pan) {
    return (ArmVector() << pan, lift, elbow, -M_PI_2 - lift - elbow, -M_PI_2, 0.0).finished();
  }

  const mjModel& model_;
  DataPtr data_;
  double error_m_{0.0};
};

}  // namespace simulated_world
