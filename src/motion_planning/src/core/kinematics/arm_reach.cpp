// SPDX-License-Identifier: BSD-3-Clause
#include "kinematics/arm_reach.h"

#include <mp700_ur5e_description/robot_names.h>

namespace motion_planning {
namespace {

namespace description = mp700_ur5e_description;

/// Farthest point of a shape from the origin of the frame that it is given in.
double extent(const Eigen::Isometry3d& T_frame_shape, const description::Shape& shape) {
  double half_m = 0.0;
  if (const auto* box = std::get_if<description::Box>(&shape)) {
    half_m = 0.5 * box->size_m.norm();
  } else if (const auto* cylinder = std::get_if<description::Cylinder>(&shape)) {
    half_m = std::hypot(0.5 * cylinder->length_m, cylinder->radius_m);
  } else {
    half_m = std::get<description::Sphere>(shape).radius_m;
  }
  return T_frame_shape.translation().norm() + half_m;
}

}  // namespace

ArmVector armReach(const ArmKinematics& arm, const std::optional<HeldBrick>& held) {
  const description::RobotModel& robot = arm.robot();
  // From the tip to the foot: what a body and all behind it reach from the origin of the body's joint.
  const std::size_t tip_body = robot.bodyOf(description::kMagnetTipFrame);
  const Eigen::Isometry3d& T_body_tip = robot.poseInBody(description::kMagnetTipFrame);
  std::vector<Eigen::Isometry3d> T_base_body;
  robot.bodyPoses(arm.robotPositions(ArmVector::Zero()), &T_base_body);
  double behind_m = 0.0;
  ArmVector reach_m;
  for (int joint = 5; joint >= 0; --joint) {
    const std::size_t body = arm.jointIndices()[static_cast<std::size_t>(joint)] + 1;
    double farthest_m = 0.0;
    for (const description::BodyShape& shape : robot.shapes()) {
      if (shape.body == body) farthest_m = std::max(farthest_m, extent(shape.T_body_shape, shape.shape));
    }
    if (held && body == tip_body) {
      farthest_m = std::max(farthest_m, extent(T_body_tip * held->T_tip_brick, description::Box{held->size_m}));
    }
    if (joint < 5) {
      // The next joint's origin in this body does not depend on the angles.
      const std::size_t next = arm.jointIndices()[static_cast<std::size_t>(joint) + 1] + 1;
      const double offset_m = (T_base_body[next].translation() - T_base_body[body].translation()).norm();
      farthest_m = std::max(farthest_m, offset_m + behind_m);
    }
    behind_m = farthest_m;
    reach_m[joint] = farthest_m;
  }
  return reach_m;
}

}  // namespace motion_planning
