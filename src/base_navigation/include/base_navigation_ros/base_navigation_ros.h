// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include <actionlib/server/action_server.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <interactive_mapping_common_ros/clock_timer.h>
#include <interactive_mapping_common_ros/live_params.h>
#include <interactive_mapping_msgs/NavigationOutcome.h>
#include <interactive_mapping_msgs/NavigationState.h>
#include <map_msgs/OccupancyGridUpdate.h>
#include <move_base_msgs/MoveBaseAction.h>
#include <mp700_ur5e_description/base_profile.h>
#include <nav_msgs/GetPlan.h>
#include <nav_msgs/OccupancyGrid.h>
#include <nav_msgs/Odometry.h>
#include <neo_msgs/EmergencyStopState.h>
#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>
#include <ros/wall_timer.h>
#include <sensor_msgs/LaserScan.h>
#include <std_msgs/Bool.h>
#include <std_msgs/Header.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include "base_navigation/base_navigator.h"
#include "base_navigation/grid_fusion.h"
#include "base_navigation_ros/base_navigation_params.h"
#include "base_navigation_ros/ground_input.h"
#include "base_navigation_ros/navigation_markers.h"
#include "base_navigation_ros/odometry_history.h"

namespace base_navigation_ros {

/// The base's navigation as a ROS node: a move_base server over odometry, tf, scan and the map's ground. The README lists
/// topics and services. All control runs on one thread of its own, stepped by odometry. So it depends on stamps and not
/// on the machine. Goals, services and diagnostics come on the caller's threads. Long: each topic, service and
/// diagnostic is a few lines, and the work is in the core.
class BaseNavigationRos {
 public:
  /// Throws std::invalid_argument listing every impossible parameter, or what is wrong with the base profile.
  BaseNavigationRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  ~BaseNavigationRos();
  BaseNavigationRos(const BaseNavigationRos&) = delete;
  BaseNavigationRos& operator=(const BaseNavigationRos&) = delete;

  /// Cancels what is driven to and waits, at most `timeout` of wall time, until the base has been braked: before ROS is
  /// shut down. Goals that come later are refused.
  void stop(ros::WallDuration timeout);

 private:
  using Server = actionlib::ActionServer<move_base_msgs::MoveBaseAction>;
  using GoalHandle = Server::GoalHandle;
  using Status = base_navigation::NavigationStatus;

  // On the threads of the caller's queue.
  void onGoal(GoalHandle goal);
  void onSimpleGoal(const geometry_msgs::PoseStampedConstPtr& message);
  bool onMakePlan(nav_msgs::GetPlan::Request& request, nav_msgs::GetPlan::Response& response);
  bool onForget(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  void diagnoseInputs(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseGoals(diagnostic_updater::DiagnosticStatusWrapper& status);

  // On the control thread.
  void onOdometry(const nav_msgs::OdometryConstPtr& message);
  void onScan(const sensor_msgs::LaserScanConstPtr& message);
  void onGround(const nav_msgs::OccupancyGridConstPtr& message);
  void onGroundUpdate(const map_msgs::OccupancyGridUpdateConstPtr& message);
  void enterGround(GroundInput::Grid grid, const ros::Time& stamp, std::string problem);
  /// Of ROS time, by more than clocks may differ; then `problem` says so.
  bool isAhead(const ros::Time& stamp, std::string* problem) const;
  bool isGroundStatic() const { return params_.navigator.max_grid_age_s == 0.0; }
  void onEmergencyStop(const neo_msgs::EmergencyStopStateConstPtr& message);
  void onStop(const std_msgs::BoolConstPtr& message);
  void tellStop();
  void onHeartbeat(const std_msgs::HeaderConstPtr& message);
  void onWatchdog();
  void step(const ros::Time& now);
  void lookUpLocalisation(const ros::Time& stamp);
  void enterScans(const ros::Time& before);
  /// What was entered with poses that were wrong: scans and the way driven.
  void forgetScans();
  void takeRequests();
  /// Ends the current goal: outcome and the action's status.
  void finish(Status status, const std::string& message);
  void refuse(GoalHandle& goal, Status status, const std::string& message);
  void publishOutcome(const GoalHandle& goal, const base_navigation::Pose2d& goal_map, Status status,
                      const std::string& message, int plans);
  void publish(const base_navigation::NavigationOutput& output, const ros::Time& stamp);

  /// The goal's pose in the map; nothing, and why.
  std::optional<base_navigation::Pose2d> poseInMap(const geometry_msgs::PoseStamped& pose, const char* what,
                                                   std::string* why_not) const;
  std::optional<Eigen::Isometry3d> transformToMap(const std::string& frame, const ros::Time& stamp,
                                                  std::string* why_not) const;

  const BaseNavigationParams params_;
  const mp700_ur5e_description::BaseProfile profile_;
  tf2_ros::Buffer tf_;
  tf2_ros::TransformListener tf_listener_;

  // Of the control thread alone, up to the blank line.
  base_navigation::GridFusion fusion_;
  base_navigation::BaseNavigator navigator_;
  OdometryHistory odometry_;
  base_navigation::Twist2d odometry_twist_;
  base_navigation::Pose2d T_map_odom_;
  ros::Time localisation_stamp_;  // zero: none has come
  ros::Time jumped_;              // of the step in which localisation or odometry last did
  bool is_localisation_late_{false};
  std::deque<std::pair<ros::Time, std::shared_ptr<const base_navigation::Scan>>> new_scans_;
  std::pair<ros::Time, std::shared_ptr<const base_navigation::Scan>> scan_;
  GroundInput ground_;
  std::deque<std::pair<ros::Time, GroundInput::Grid>> new_ground_;
  bool has_static_ground_{false};
  std::optional<base_navigation::BaseStop> relay_stop_, signal_stop_, told_stop_;  // nothing: not reported
  ros::Time last_step_, ground_stamp_, heartbeat_stamp_, grid_built_, grid_published_, markers_published_,
      feedback_published_;
  bool is_grid_old_{true};
  std::map<std::string, Eigen::Isometry3d> scanners_;  // T_base_scanner by frame
  std::optional<GoalHandle> waiting_;                  // for tf at its stamp
  std::chrono::steady_clock::time_point waiting_since_;
  std::optional<GoalHandle> current_;
  base_navigation::Pose2d current_goal_map_;
  std::uint64_t shown_plans_{0};

  mutable std::mutex goal_mutex_;  // guards what follows, up to the blank line; never held while a goal handle is used
  std::condition_variable idle_;
  std::optional<GoalHandle> next_;
  bool has_current_{false};
  bool is_forget_asked_{false};
  bool is_stopping_{false};
  std::optional<BaseNavigationParams> tuned_;  // for the next step

  mutable std::mutex shared_mutex_;  // guards what follows, up to the blank line
  std::shared_ptr<const base_navigation::NavigationGrid> grid_;
  std::optional<base_navigation::Pose2d> T_map_base_;
  ros::WallTime stepped_{ros::WallTime::now()};
  ros::Time odometry_seen_, localisation_seen_, scan_seen_, ground_seen_, heartbeat_seen_;
  std::string scan_problem_, ground_problem_, odometry_problem_, localisation_problem_;
  std::string stop_;                               // why the base stands by itself; empty: it does not
  std::map<std::string, std::uint64_t> outcomes_;  // how often each
  std::string last_failure_;
  base_navigation::NavigationPhase phase_{base_navigation::NavigationPhase::kIdle};
  std::string reason_;

  NavigationMarkers markers_;
  ros::Publisher command_publisher_, state_publisher_, outcome_publisher_, path_publisher_, grid_publisher_,
      goal_publisher_;
  ros::Subscriber simple_goal_subscriber_;
  diagnostic_updater::Updater diagnostics_;
  ros::WallTimer diagnostics_timer_;
  std::unique_ptr<Server> server_;
  std::unique_ptr<interactive_mapping_ros::LiveParams<BaseNavigationParams>> live_;
  ros::ServiceServer plan_server_, forget_server_;

  ros::CallbackQueue control_queue_;
  ros::Subscriber odometry_subscriber_, scan_subscriber_, ground_subscriber_, heartbeat_subscriber_,
      ground_update_subscriber_, emergency_stop_subscriber_, stop_subscriber_;
  std::unique_ptr<interactive_mapping_ros::ClockTimer> watchdog_;
  std::unique_ptr<ros::AsyncSpinner> control_spinner_;  // last: its thread uses the rest
};

}  // namespace base_navigation_ros
