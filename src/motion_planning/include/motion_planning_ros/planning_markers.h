// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>

#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <visualization_msgs/MarkerArray.h>

#include "motion_planning/motion_planner.h"
#include "motion_planning_ros/scene_keeper.h"

namespace motion_planning_ros {

/// What rviz shows of planning: `~scene` (the surface with its margins, unknown space) and `~plan` (the tip's way by
/// phases, arms along it, the contact). Nothing is made while nobody looks. Any thread.
class PlanningMarkers {
 public:
  PlanningMarkers(ros::NodeHandle& private_nh, std::string map_frame,
                  std::shared_ptr<const motion_planning::ArmKinematics> arm, int num_arms);

  void show(const MapScene& scene);
  void show(const motion_planning::PickPlan& plan, const Eigen::Isometry3d& T_map_base);
  void show(const motion_planning::ArmPlan& plan, const Eigen::Isometry3d& T_map_base);
  /// A plan that failed: the last one's markers go, the reason stands over the robot.
  void showFailure(const std::string& reason, const Eigen::Isometry3d& T_map_base);

 private:
  using MarkerArray = visualization_msgs::MarkerArray;

  visualization_msgs::Marker marker(const std::string& ns, int id, int type) const;
  void addWay(const motion_planning::JointTrajectory& trajectory, const Eigen::Isometry3d& T_map_base, int id,
              const std_msgs::ColorRGBA& color, MarkerArray* array) const;
  void addArm(const motion_planning::ArmVector& joints_rad, const Eigen::Isometry3d& T_map_base, int number,
              float alpha, MarkerArray* array) const;
  MarkerArray cleared() const;

  const std::string map_frame_;
  const std::shared_ptr<const motion_planning::ArmKinematics> arm_;
  const int num_arms_;
  ros::Publisher scene_publisher_, plan_publisher_;
};

}  // namespace motion_planning_ros
