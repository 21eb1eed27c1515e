// SPDX-License-Identifier: BSD-3-Clause
#include "planning_problems/exact_checker.h"

#include <algorithm>
#include <stdexcept>

#include <mp700_ur5e_description/robot_names.h>

#include "simulated_world/world_observation.h"

namespace experiments {
namespace {

namespace description = mp700_ur5e_description;

constexpr const char* kHeld = "held";
// Solids nearer than this are taken to touch: alternating projections slow down where two faces just meet.
constexpr double kTouching_m = 2e-5;
constexpr double kDepthTolerance_m = 1e-4;

/// Solids that overlap have a point in common, which alternating projections find. Until it is found, or a plane between
/// the two, the question is open; what is open at the end has been shown to be no more than nearly touching.
bool areTouching(const Solid& a, const Solid& b) {
  constexpr int kMaxIterations = 5000;
  return convexDistance(a, b, 0.0, 0.0, kTouching_m, kMaxIterations).lower_m <= 0.0;
}

}  // namespace

ExactChecker::ExactChecker(std::shared_ptr<const description::RobotModel> robot,
                           const std::vector<simulated_world::BrickPlacement>& bricks,
                           const Eigen::Isometry3d& T_map_base)
    : robot_(std::move(robot)),
      tip_body_(robot_->bodyOf(description::kMagnetTipFrame)),
      T_body_tip_(robot_->poseInBody(description::kMagnetTipFrame)),
      positions_(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(robot_->joints().size()))) {
  for (const char* joint : description::kArmJoints) arm_joints_.push_back(robot_->jointIndex(joint));
  const auto isArm = [&](std::size_t body) {
    return std::any_of(arm_joints_.begin(), arm_joints_.end(), [&](std::size_t joint) { return body == joint + 1; });
  };
  for (const description::BodyShape& shape : robot_->shapes()) {
    parts_.push_back({shape.link,
                      shape.body,
                      shape.shape,
                      shape.T_body_shape,
                      boundingRadius(shape.shape),
                      isArm(shape.body),
                      {shape.shape, Eigen::Isometry3d::Identity()}});
  }
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (!mayTouch(parts_[i], parts_[j])) self_pairs_.emplace_back(i, j);
    }
  }
  const Eigen::Isometry3d T_base_map = T_map_base.inverse();
  for (const simulated_world::BrickPlacement& brick : bricks) {
    const Solid solid{description::Box{brick.type.size_m}, T_base_map * brick.T_map_brick};
    bricks_.push_back({brick.id, brick.type.size_m, solid, boundingRadius(solid.shape)});
  }
}

bool ExactChecker::mayTouch(const Part& a, const Part& b) const {
  if (!a.is_moving && !b.is_moving) return true;
  return a.body == b.body || robot_->parentBody(a.body) == b.body || robot_->parentBody(b.body) == a.body;
}

void ExactChecker::hold(int brick_id, const Eigen::Isometry3d& T_tip_brick) {
  const auto brick = std::find_if(bricks_.begin(), bricks_.end(), [&](const Brick& b) { return b.id == brick_id; });
  if (brick == bricks_.end() || held_id_) throw std::logic_error("hold: no such brick, or one is held already");
  const description::Shape shape = description::Box{brick->size_m};
  parts_.push_back({kHeld, tip_body_, shape, T_body_tip_ * T_tip_brick, boundingRadius(shape), true, {shape, {}}});
  for (std::size_t j = 0; j + 1 < parts_.size(); ++j) {
    if (parts_[j].body != tip_body_) self_pairs_.emplace_back(parts_.size() - 1, j);
  }
  held_id_ = brick_id;
}

void ExactChecker::bend(const motion_planning::ArmVector& joints_rad) {
  for (std::size_t i = 0; i < arm_joints_.size(); ++i) {
    positions_[static_cast<Eigen::Index>(arm_joints_[i])] = joints_rad[static_cast<Eigen::Index>(i)];
  }
  robot_->bodyPoses(positions_, &T_base_body_);
  for (Part& part : parts_) part.solid.T_world_shape = T_base_body_[part.body] * part.T_body_shape;
}

Eigen::Isometry3d ExactChecker::tipInBase(const motion_planning::ArmVector& joints_rad) {
  bend(joints_rad);
  return T_base_body_[tip_body_] * T_body_tip_;
}

Eigen::Isometry3d ExactChecker::heldPose(const motion_planning::ArmVector& joints_rad) {
  if (!held_id_) throw std::logic_error("heldPose: nothing is held");
  bend(joints_rad);
  return parts_.back().solid.T_world_shape;
}

double ExactChecker::depth(const Solid& part, const Brick& brick) {
  double apart_m = 0.5 * brick.size_m.minCoeff();
  double overlapping_m = 0.0;
  while (apart_m - overlapping_m > kDepthTolerance_m) {
    const double shrinkage_m = 0.5 * (apart_m + overlapping_m);
    Solid smaller = brick.solid;
    smaller.shape = description::Box{brick.size_m - Eigen::Vector3d::Constant(2.0 * shrinkage_m)};
    (!areTouching(part, smaller) ? apart_m : overlapping_m) = shrinkage_m;
  }
  return apart_m;
}

std::vector<Overlap> ExactChecker::overlaps(const motion_planning::ArmVector& joints_rad) {
  bend(joints_rad);
  std::vector<Overlap> result;
  for (const Part& part : parts_) {
    if (!part.is_moving) continue;
    const Eigen::Vector3d middle = part.solid.T_world_shape.translation();
    for (const Brick& brick : bricks_) {
      if (held_id_ == brick.id) continue;
      if ((nearestPoint(brick.solid, middle) - middle).norm() > part.radius_m) continue;
      if (!areTouching(part.solid, brick.solid)) continue;
      result.push_back({part.link, simulated_world::brickBodyName(brick.id), brick.id, depth(part.solid, brick)});
    }
    const double lowest_m = -support(part.solid, -Eigen::Vector3d::UnitZ());
    if (lowest_m < 0.0) result.push_back({part.link, "ground", -1, -lowest_m});
  }
  for (const auto& [i, j] : self_pairs_) {
    const Part& a = parts_[i];
    const Part& b = parts_[j];
    const double between_m = (a.solid.T_world_shape.translation() - b.solid.T_world_shape.translation()).norm();
    if (between_m > a.radius_m + b.radius_m) continue;
    if (!areTouching(a.solid, b.solid)) continue;
    result.push_back({a.link, b.link, -1, 0.0});
  }
  return result;
}

double ExactChecker::clearance(const motion_planning::ArmVector& joints_rad, double limit_m, int except_id) {
  bend(joints_rad);
  double smallest_m = limit_m;
  for (const Part& part : parts_) {
    if (!part.is_moving) continue;
    const Eigen::Vector3d middle = part.solid.T_world_shape.translation();
    for (const Brick& brick : bricks_) {
      if (held_id_ == brick.id || brick.id == except_id) continue;
      if ((nearestPoint(brick.solid, middle) - middle).norm() > part.radius_m + smallest_m) continue;
      const ConvexDistance distance = convexDistance(part.solid, brick.solid, 1e-4, smallest_m, kTouching_m);
      if (distance.lower_m < smallest_m) smallest_m = std::max(0.0, distance.lower_m);
    }
  }
  return smallest_m;
}

}  // namespace experiments
