// SPDX-License-Identifier: BSD-3-Clause
#include "collision/camera_view.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <mp700_ur5e_description/robot_names.h>

namespace motion_planning {
namespace {

namespace description = mp700_ur5e_description;

/// Points with normal * p + offset >= 0 are on the view's side. Camera's optical frame.
struct Plane {
  Eigen::Vector3d normal;  // unit
  double offset_m;
};

std::array<Plane, 6> planesOf(const ViewFrustum& view) {
  const double cw = std::cos(view.half_width_rad);
  const double sw = std::sin(view.half_width_rad);
  const double ch = std::cos(view.half_height_rad);
  const double sh = std::sin(view.half_height_rad);
  return {Plane{{-cw, 0.0, sw}, 0.0}, Plane{{cw, 0.0, sw}, 0.0},   Plane{{0.0, -ch, sh}, 0.0},
          Plane{{0.0, ch, sh}, 0.0},  Plane{{0.0, 0.0, 1.0}, 0.0}, Plane{{0.0, 0.0, -1.0}, view.max_range_m}};
}

/// Farthest that the shape reaches from its middle in the direction `n` (unit, in the shape's frame).
double reach(const description::Shape& shape, const Eigen::Vector3d& n) {
  if (const auto* box = std::get_if<description::Box>(&shape)) return 0.5 * box->size_m.dot(n.cwiseAbs());
  if (const auto* cylinder = std::get_if<description::Cylinder>(&shape)) {
    return 0.5 * cylinder->length_m * std::abs(n.z()) + cylinder->radius_m * std::hypot(n.x(), n.y());
  }
  return std::get<description::Sphere>(shape).radius_m;
}

bool isInView(const std::array<Plane, 6>& planes, const Eigen::Isometry3d& T_camera_shape,
              const description::Shape& shape, double clear_m) {
  return std::none_of(planes.begin(), planes.end(), [&](const Plane& plane) {
    const Eigen::Vector3d n_shape = T_camera_shape.linear().transpose() * plane.normal;
    return plane.normal.dot(T_camera_shape.translation()) + plane.offset_m + reach(shape, n_shape) <= -clear_m;
  });
}

}  // namespace

bool blocksView(const ArmKinematics& arm, const ArmVector& joints_rad, const std::optional<HeldBrick>& held,
                const ViewFrustum& view, double clear_m) {
  const description::RobotModel& robot = arm.robot();
  std::vector<Eigen::Isometry3d> T_base_body;
  robot.bodyPoses(arm.robotPositions(joints_rad), &T_base_body);
  const Eigen::Isometry3d T_camera_base = view.T_base_camera.inverse();
  const std::array<Plane, 6> planes = planesOf(view);
  const auto moves = [&](std::size_t body) {  // with the arm; the wheels do not
    return std::any_of(arm.jointIndices().begin(), arm.jointIndices().end(),
                       [body](std::size_t joint) { return body == joint + 1; });
  };
  for (const description::BodyShape& shape : robot.shapes()) {
    if (!moves(shape.body)) continue;
    if (isInView(planes, T_camera_base * T_base_body[shape.body] * shape.T_body_shape, shape.shape, clear_m))
      return true;
  }
  if (!held) return false;
  const Eigen::Isometry3d T_base_tip =
      T_base_body[robot.bodyOf(description::kMagnetTipFrame)] * robot.poseInBody(description::kMagnetTipFrame);
  return isInView(planes, T_camera_base * T_base_tip * held->T_tip_brick, description::Box{held->size_m}, clear_m);
}

}  // namespace motion_planning
