// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning_ros/planning_markers.h"

#include <algorithm>

#include <interactive_mapping_common_ros/markers.h>

#include "motion_planning/scene_view.h"
#include "motion_planning_ros/conversions.h"

namespace motion_planning_ros {
namespace {

using interactive_mapping_ros::color;
using interactive_mapping_ros::toPoint;
using motion_planning::ArmVector;
using motion_planning::JointTrajectory;
using motion_planning::LoadedBrick;
using visualization_msgs::Marker;
using visualization_msgs::MarkerArray;

constexpr double kWayStep_s = 0.05;  // between points of a drawn way
// Of a plan that is carried out: what the arm's bridge allows between arm and trajectory.
constexpr double kArmTolerance_rad = 0.02;
// More than localisation corrects, less than any drive.
constexpr double kBaseMoved_m = 0.05;
constexpr double kBaseMoved_rad = 0.05;

/// A failure, or no plan at all, has no end.
std::optional<ArmVector> endOf(const JointTrajectory& trajectory) {
  if (trajectory.empty()) return std::nullopt;
  return trajectory.points.back().position_rad;
}

}  // namespace

ShownPlan::ShownPlan(const ArmVector& start_rad, const std::optional<ArmVector>& end_rad,
                     const Eigen::Isometry3d& T_map_base)
    : start_rad_(start_rad), end_rad_(end_rad), T_map_base_(T_map_base) {}

bool ShownPlan::isOver(const std::optional<ArmVector>& joints_rad, const std::optional<Eigen::Isometry3d>& T_map_base) {
  if (T_map_base) {
    const Eigen::Isometry3d moved = T_map_base_.inverse() * *T_map_base;
    if (moved.translation().norm() > kBaseMoved_m) return true;
    if (Eigen::AngleAxisd(moved.linear()).angle() > kBaseMoved_rad) return true;
  }
  if (!joints_rad || !end_rad_) return false;
  const auto isAt = [&](const ArmVector& goal_rad) {
    return (*joints_rad - goal_rad).lpNorm<Eigen::Infinity>() <= kArmTolerance_rad;
  };
  // A pick may end where it starts: the arm has to have left first.
  if (!isAt(start_rad_)) has_begun_ = true;
  return has_begun_ && isAt(*end_rad_);
}

PlanningMarkers::PlanningMarkers(ros::NodeHandle& private_nh, std::string map_frame,
                                 std::shared_ptr<const motion_planning::ArmKinematics> arm, int num_arms)
    : map_frame_(std::move(map_frame)), arm_(std::move(arm)), num_arms_(num_arms) {
  scene_publisher_ = private_nh.advertise<MarkerArray>("scene", 1, true);
  plan_publisher_ = private_nh.advertise<MarkerArray>("plan", 1, true);
  load_publisher_ = private_nh.advertise<MarkerArray>("load", 1, true);
}

Marker PlanningMarkers::marker(const std::string& ns, int id, int type) const {
  std_msgs::Header header;
  header.frame_id = map_frame_;  // stamp zero: shown where it is, whatever tf's age
  return interactive_mapping_ros::makeMarker(header, ns, id, type);
}

MarkerArray PlanningMarkers::cleared() const {
  MarkerArray array;
  array.markers.push_back(marker("", 0, Marker::CUBE));
  array.markers.back().action = Marker::DELETEALL;
  return array;
}

void PlanningMarkers::show(const MapScene& scene) {
  if (!isSceneShown()) return;
  MarkerArray array = cleared();

  const motion_planning::Surface surface = motion_planning::obstacleSurface(*scene.scene);
  Marker shell = marker("surface with margin", 0, Marker::TRIANGLE_LIST);
  shell.scale.x = shell.scale.y = shell.scale.z = 1.0;
  shell.color = color(0.95, 0.45, 0.15, 0.3);
  shell.points.reserve(3 * surface.triangles.size());
  for (const auto& triangle : surface.triangles) {
    for (const std::uint32_t vertex : triangle) shell.points.push_back(toPoint(surface.vertices_map[vertex]));
  }
  if (!shell.points.empty()) array.markers.push_back(std::move(shell));

  Marker unknown = marker("unknown", 0, Marker::CUBE_LIST);
  const double edge_m = motion_planning::blockSize(*scene.scene);
  unknown.scale.x = unknown.scale.y = unknown.scale.z = 0.9 * edge_m;  // single blocks can be told
  unknown.color = color(0.35, 0.35, 0.75, 0.25);
  for (const Eigen::Vector3d& centre : motion_planning::unknownBlocks(*scene.scene)) {
    unknown.points.push_back(toPoint(centre));
  }
  if (!unknown.points.empty()) array.markers.push_back(std::move(unknown));
  scene_publisher_.publish(array);
}

void PlanningMarkers::addWay(const JointTrajectory& trajectory, const Eigen::Isometry3d& T_map_base, int id,
                             const std_msgs::ColorRGBA& rgba, MarkerArray* array) const {
  if (trajectory.points.size() < 2) return;
  Marker way = marker("path of the tip", id, Marker::LINE_STRIP);
  way.scale.x = 0.008;
  way.color = rgba;
  for (double t = 0.0; t < trajectory.duration() + kWayStep_s; t += kWayStep_s) {
    way.points.push_back(toPoint(T_map_base * arm_->tipPose(trajectory.sample(t).position_rad).translation()));
  }
  array->markers.push_back(std::move(way));
}

void PlanningMarkers::addArm(const ArmVector& joints_rad, const Eigen::Isometry3d& T_map_base, int number, float alpha,
                             MarkerArray* array) const {
  const mp700_ur5e_description::RobotModel& robot = arm_->robot();
  std::vector<Eigen::Isometry3d> T_base_body;
  robot.bodyPoses(arm_->robotPositions(joints_rad), &T_base_body);
  const auto isOfArm = [&](std::size_t body) {  // with what is on its flange
    while (body != 0 && body != arm_->jointIndices()[0] + 1) body = robot.parentBody(body);
    return body != 0;
  };
  int id = 1000 * number;
  for (const mp700_ur5e_description::BodyShape& shape : robot.shapes()) {
    if (!isOfArm(shape.body)) continue;
    Marker part = marker("arms", id++, Marker::CYLINDER);
    part.pose = toPose(T_map_base * T_base_body[shape.body] * shape.T_body_shape);
    if (const auto* box = std::get_if<mp700_ur5e_description::Box>(&shape.shape)) {
      part.type = Marker::CUBE;
      part.scale.x = box->size_m.x();
      part.scale.y = box->size_m.y();
      part.scale.z = box->size_m.z();
    } else if (const auto* cylinder = std::get_if<mp700_ur5e_description::Cylinder>(&shape.shape)) {
      part.scale.x = part.scale.y = 2.0 * cylinder->radius_m;
      part.scale.z = cylinder->length_m;
    } else {
      part.type = Marker::SPHERE;
      part.scale.x = part.scale.y = part.scale.z = 2.0 * std::get<mp700_ur5e_description::Sphere>(shape.shape).radius_m;
    }
    part.color = color(0.35, 0.75, 0.95, alpha);
    array->markers.push_back(std::move(part));
  }
}

void PlanningMarkers::show(const motion_planning::PickPlan& plan, const Eigen::Isometry3d& T_map_base) {
  if (plan_publisher_.getNumSubscribers() == 0) return publishPlan(cleared(), std::nullopt);
  MarkerArray array = cleared();
  addWay(plan.approach, T_map_base, 0, color(0.2, 0.8, 1.0, 1.0), &array);
  addWay(plan.contact, T_map_base, 1, color(1.0, 0.9, 0.1, 1.0), &array);
  addWay(plan.lift, T_map_base, 2, color(0.2, 1.0, 0.3, 1.0), &array);
  addWay(plan.stow, T_map_base, 3, color(0.9, 0.3, 0.9, 1.0), &array);
  for (int i = 0; i < num_arms_; ++i) {
    const double t = plan.approach.duration() * i / std::max(1, num_arms_ - 1);
    addArm(plan.approach.sample(t).position_rad, T_map_base, i, 0.12F, &array);
  }
  addArm(plan.contact.points.back().position_rad, T_map_base, num_arms_, 0.8F, &array);
  Marker contact = marker("contact", 0, Marker::ARROW);
  const double length_m = 0.15;
  contact.points = {toPoint(plan.T_map_contact * Eigen::Vector3d(0.0, 0.0, -length_m)),
                    toPoint(plan.T_map_contact.translation())};
  contact.scale.x = 0.012;  // shaft's diameter, head's diameter, head's length
  contact.scale.y = 0.030;
  contact.scale.z = 0.035;
  contact.color = color(1.0, 0.2, 0.2, 1.0);
  array.markers.push_back(std::move(contact));
  // The stow comes last, if the goal asked for one.
  const JointTrajectory& last = plan.stow.empty() ? plan.lift : plan.stow;
  publishPlan(array, ShownPlan(plan.approach.points.front().position_rad, endOf(last), T_map_base));
}

void PlanningMarkers::show(const JointTrajectory& plan, const Eigen::Isometry3d& T_map_base) {
  if (plan_publisher_.getNumSubscribers() == 0) return publishPlan(cleared(), std::nullopt);
  MarkerArray array = cleared();
  addWay(plan, T_map_base, 0, color(0.2, 0.8, 1.0, 1.0), &array);
  for (int i = 0; i < num_arms_; ++i) {
    const double t = plan.duration() * i / std::max(1, num_arms_ - 1);
    addArm(plan.sample(t).position_rad, T_map_base, i, i + 1 == num_arms_ ? 0.8F : 0.12F, &array);
  }
  publishPlan(array, ShownPlan(plan.points.front().position_rad, endOf(plan), T_map_base));
}

void PlanningMarkers::showFailure(const std::string& reason, const Eigen::Isometry3d& T_map_base) {
  if (plan_publisher_.getNumSubscribers() == 0) return publishPlan(cleared(), std::nullopt);
  MarkerArray array = cleared();
  Marker text = marker("failure", 0, Marker::TEXT_VIEW_FACING);
  constexpr double kOverTheMast_m = 2.0;
  text.pose = toPose(T_map_base * Eigen::Translation3d(0.0, 0.0, kOverTheMast_m));
  text.scale.z = 0.06;
  text.text = reason;
  text.color = color(1.0, 0.4, 0.3, 1.0);
  array.markers.push_back(std::move(text));
  publishPlan(array, ShownPlan(ArmVector::Zero(), std::nullopt, T_map_base));
}

void PlanningMarkers::showLoad(const std::vector<LoadedBrick>& load) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto is_same = [](const LoadedBrick& a, const LoadedBrick& b) {
    return a.T_base_brick.matrix() == b.T_base_brick.matrix() && a.size_m == b.size_m;
  };
  if (std::equal(load.begin(), load.end(), shown_load_.begin(), shown_load_.end(), is_same)) return;
  shown_load_ = load;
  MarkerArray array = cleared();
  for (std::size_t i = 0; i < load.size(); ++i) {
    Marker brick = marker("load", static_cast<int>(i), Marker::CUBE);
    brick.header.frame_id = arm_->robot().rootFrame();
    brick.frame_locked = 1;  // it drives along
    brick.pose = toPose(load[i].T_base_brick);
    brick.scale.x = load[i].size_m.x();
    brick.scale.y = load[i].size_m.y();
    brick.scale.z = load[i].size_m.z();
    brick.color = color(0.9, 0.6, 0.2, 0.5);
    array.markers.push_back(std::move(brick));
  }
  load_publisher_.publish(array);
}

void PlanningMarkers::publishPlan(const MarkerArray& array, std::optional<ShownPlan> shown) {
  const std::lock_guard<std::mutex> lock(mutex_);
  // Latched: an old plan would come back with the next rviz.
  if (shown || shown_) plan_publisher_.publish(array);
  shown_ = std::move(shown);
}

void PlanningMarkers::clearOldPlan(const RobotState& robot) {
  const std::lock_guard<std::mutex> lock(mutex_);
  std::string why_not;
  if (!shown_ || !shown_->isOver(robot.arm(&why_not), robot.base(&why_not))) return;
  plan_publisher_.publish(cleared());
  shown_.reset();
}

}  // namespace motion_planning_ros
