// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <visualization_msgs/MarkerArray.h>

#include "motion_planning/motion_planner.h"
#include "motion_planning_ros/robot_state.h"
#include "motion_planning_ros/scene_keeper.h"

namespace motion_planning_ros {

/// Says when a plan on display is out of date: the arm has carried it out, or the base has moved.
class ShownPlan {
 public:
  /// `start_rad`, `end_rad`: of the whole plan; no end: nothing will be carried out.
  ShownPlan(const motion_planning::ArmVector& start_rad, const std::optional<motion_planning::ArmVector>& end_rad,
            const Eigen::Isometry3d& T_map_base);
  /// With the robot's newest state. What is not known of it changes nothing.
  bool isOver(const std::optional<motion_planning::ArmVector>& joints_rad,
              const std::optional<Eigen::Isometry3d>& T_map_base);

 private:
  motion_planning::ArmVector start_rad_;
  std::optional<motion_planning::ArmVector> end_rad_;
  Eigen::Isometry3d T_map_base_;
  bool has_begun_{false};
};

/// What rviz shows of planning: `~scene` (the surface with its margins, unknown space) and `~plan` (the tip's way by
/// phases, arms along it, the contact). Nothing is made without a subscriber. Any thread.
class PlanningMarkers {
 public:
  PlanningMarkers(ros::NodeHandle& private_nh, std::string map_frame,
                  std::shared_ptr<const motion_planning::ArmKinematics> arm, int num_arms);

  void show(const MapScene& scene);
  bool isSceneShown() const { return scene_publisher_.getNumSubscribers() > 0; }
  void show(const motion_planning::PickPlan& plan, const Eigen::Isometry3d& T_map_base);
  void show(const motion_planning::JointTrajectory& plan, const Eigen::Isometry3d& T_map_base);
  /// A plan that failed: the last one's markers go, the reason stands over the robot.
  void showFailure(const std::string& reason, const Eigen::Isometry3d& T_map_base);
  /// Clears `~plan` once it is out of date. To be called a few times a second.
  void clearOldPlan(const RobotState& robot);
  /// What the planner takes to lie in the container, if that is not what `~load` shows already.
  void showLoad(const std::vector<motion_planning::LoadedBrick>& load);

 private:
  using MarkerArray = visualization_msgs::MarkerArray;

  visualization_msgs::Marker marker(const std::string& ns, int id, int type) const;
  void addWay(const motion_planning::JointTrajectory& trajectory, const Eigen::Isometry3d& T_map_base, int id,
              const std_msgs::ColorRGBA& color, MarkerArray* array) const;
  void addArm(const motion_planning::ArmVector& joints_rad, const Eigen::Isometry3d& T_map_base, int number,
              float alpha, MarkerArray* array) const;
  MarkerArray cleared() const;
  void publishPlan(const MarkerArray& array, std::optional<ShownPlan> shown);

  const std::string map_frame_;
  const std::shared_ptr<const motion_planning::ArmKinematics> arm_;
  const int num_arms_;
  ros::Publisher scene_publisher_, plan_publisher_, load_publisher_;

  std::mutex mutex_;  // guards what follows, and the order of what is published of plans
  std::optional<ShownPlan> shown_;
  std::vector<motion_planning::LoadedBrick> shown_load_;
};

}  // namespace motion_planning_ros
