// SPDX-License-Identifier: BSD-3-Clause
#include "support/exact_motion.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <mp700_ur5e_description/robot_names.h>

namespace motion_planning {
namespace {

namespace description = mp700_ur5e_description;

std::vector<double> steps(double from, double to, double spacing) {
  const int parts = std::max(1, static_cast<int>(std::ceil((to - from) / spacing)));
  std::vector<double> values;
  for (int k = 0; k <= parts; ++k) values.push_back(from + (to - from) * k / parts);
  return values;
}

std::vector<Eigen::Vector3d> surfacePoints(const description::Shape& shape, double spacing_m) {
  std::vector<Eigen::Vector3d> points;
  if (const auto* box = std::get_if<description::Box>(&shape)) {
    const Eigen::Vector3d h = 0.5 * box->size_m;
    for (int axis = 0; axis < 3; ++axis) {
      const int a = (axis + 1) % 3;
      const int b = (axis + 2) % 3;
      for (const double u : steps(-h[a], h[a], spacing_m)) {
        for (const double v : steps(-h[b], h[b], spacing_m)) {
          for (const double sign : {-1.0, 1.0}) {
            Eigen::Vector3d p;
            p[axis] = sign * h[axis];
            p[a] = u;
            p[b] = v;
            points.push_back(p);
          }
        }
      }
    }
    return points;
  }
  const auto* cylinder = std::get_if<description::Cylinder>(&shape);
  if (cylinder == nullptr) return {Eigen::Vector3d::Zero()};  // the arm has no spheres
  const double r = cylinder->radius_m;
  const double h = 0.5 * cylinder->length_m;
  for (const double angle : steps(0.0, 2.0 * M_PI, spacing_m / r)) {
    const Eigen::Vector3d radial(std::cos(angle), std::sin(angle), 0.0);
    for (const double z : steps(-h, h, spacing_m)) points.push_back(r * radial + z * Eigen::Vector3d::UnitZ());
    for (const double rho : steps(0.0, r, spacing_m)) {
      points.push_back(rho * radial + h * Eigen::Vector3d::UnitZ());
      points.push_back(rho * radial - h * Eigen::Vector3d::UnitZ());
    }
  }
  return points;
}

}  // namespace

ExactMotion::ExactMotion(const ArmKinematics& arm, const PickWorld& pick, double spacing_m)
    : arm_(arm), pick_(pick), spacing_m_(spacing_m) {
  for (const description::BodyShape& shape : arm.robot().shapes()) {
    const auto& joints = arm.jointIndices();
    const bool moves = std::any_of(joints.begin(), joints.end(), [&](std::size_t j) { return shape.body == j + 1; });
    if (!moves) continue;
    for (const Eigen::Vector3d& p : surfacePoints(shape.shape, spacing_m)) {
      points_.push_back(
          {shape.body, shape.T_body_shape * p, shape.link.c_str(), shape.link == description::kMagnetLink});
    }
  }
}

void ExactMotion::setTarget(std::optional<std::size_t> box, bool is_gone) {
  target_ = box;
  is_gone_ = is_gone;
}

void ExactMotion::setHeld(const std::optional<HeldBrick>& held) {
  held_points_tip_.clear();
  if (!held) return;
  for (const Eigen::Vector3d& p : surfacePoints(description::Box{held->size_m}, spacing_m_)) {
    held_points_tip_.push_back(held->T_tip_brick * p);
  }
}

double ExactMotion::clearance(const ArmVector& joints_rad, double held_shrink_m, std::string* what) const {
  std::vector<Eigen::Isometry3d> T_base_body;
  arm_.robot().bodyPoses(arm_.robotPositions(joints_rad), &T_base_body);
  double least_m = std::numeric_limits<double>::infinity();
  const auto look = [&](const Eigen::Vector3d& p_base, const char* name, bool is_tool, double extra_m) {
    const auto note = [&](double distance_m, const std::string& other) {
      if (distance_m + extra_m >= least_m) return;
      least_m = distance_m + extra_m;
      if (what != nullptr) *what = std::string(name) + " and " + other;
    };
    note(p_base.z(), "ground");
    const Eigen::Vector3d p_map = pick_.T_map_base * p_base;
    for (std::size_t i = 0; i < pick_.world.boxes.size(); ++i) {
      if (target_ == i && (is_tool || is_gone_)) continue;
      note(signedDistance(pick_.world.boxes[i], p_map), "box " + std::to_string(i));
    }
  };
  for (const Point& point : points_) look(T_base_body[point.body] * point.p_body, point.link, point.is_tool, 0.0);
  const Eigen::Isometry3d T_base_tip = T_base_body[arm_.robot().bodyOf(description::kMagnetTipFrame)] *
                                       arm_.robot().poseInBody(description::kMagnetTipFrame);
  for (const Eigen::Vector3d& p_tip : held_points_tip_) look(T_base_tip * p_tip, "held brick", true, held_shrink_m);
  return least_m;
}

std::string ExactMotion::complaint(const JointTrajectory& trajectory, double held_shrink_m) const {
  constexpr double kStep_rad = 0.0035;
  double time_s = 0.0;
  for (;;) {
    const ArmVector q = trajectory.sample(time_s).position_rad;
    std::string what;
    const double distance_m = clearance(q, held_shrink_m, &what);
    if (distance_m < 0.0) {
      return what + " are " + std::to_string(-distance_m) + " m inside each other at " + std::to_string(time_s) + " s";
    }
    if (time_s >= trajectory.duration()) return "";
    double step_s = 0.05;
    while (step_s > 1e-5 &&
           (trajectory.sample(time_s + step_s).position_rad - q).lpNorm<Eigen::Infinity>() > kStep_rad) {
      step_s *= 0.5;
    }
    time_s = std::min(trajectory.duration(), time_s + step_s);
  }
}

std::vector<Eigen::Vector3d> ExactMotion::points(const ArmVector& joints_rad) const {
  std::vector<Eigen::Isometry3d> T_base_body;
  arm_.robot().bodyPoses(arm_.robotPositions(joints_rad), &T_base_body);
  std::vector<Eigen::Vector3d> points_base;
  for (const Point& point : points_) points_base.push_back(T_base_body[point.body] * point.p_body);
  const Eigen::Isometry3d T_base_tip = arm_.tipPose(joints_rad);
  for (const Eigen::Vector3d& p_tip : held_points_tip_) points_base.push_back(T_base_tip * p_tip);
  return points_base;
}

}  // namespace motion_planning
