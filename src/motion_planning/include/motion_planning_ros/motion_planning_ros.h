// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <diagnostic_updater/diagnostic_updater.h>
#include <interactive_mapping_msgs/PathMonitorState.h>
#include <interactive_mapping_msgs/PlanArmAction.h>
#include <interactive_mapping_msgs/PlanPickAction.h>
#include <interactive_mapping_msgs/WatchTrajectory.h>
#include <mp700_ur5e_description/brick_types.h>
#include <ros/node_handle.h>
#include <ros/service_server.h>
#include <ros/wall_timer.h>
#include <std_srvs/Trigger.h>

#include <interactive_mapping_common_ros/clock_timer.h>
#include <interactive_mapping_common_ros/live_params.h>
#include <interactive_mapping_common_ros/worker_action_server.h>
#include "motion_planning/motion_planner.h"
#include "motion_planning/path_monitor.h"
#include "motion_planning_ros/motion_planning_params.h"
#include "motion_planning_ros/planning_markers.h"
#include "motion_planning_ros/robot_state.h"
#include "motion_planning_ros/scene_keeper.h"

namespace motion_planning_ros {

/// The planner as a ROS node: the map's mesh, joint states and tf in; plans, the path monitor's word, markers and
/// diagnostics out. The README lists them. Callbacks may run concurrently; each action plans on a thread of its own, the
/// scene is made on SceneKeeper's.
/// Long: each topic, service and diagnostic is a few lines, and the work is in the core.
class MotionPlanningRos {
 public:
  /// Throws std::invalid_argument listing every impossible parameter, or what is wrong with a file or the URDF.
  MotionPlanningRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  ~MotionPlanningRos();
  MotionPlanningRos(const MotionPlanningRos&) = delete;
  MotionPlanningRos& operator=(const MotionPlanningRos&) = delete;

 private:
  using PickServer = interactive_mapping_ros::WorkerActionServer<interactive_mapping_msgs::PlanPickAction>;
  using ArmServer = interactive_mapping_ros::WorkerActionServer<interactive_mapping_msgs::PlanArmAction>;
  using IsCancelled = std::function<bool()>;

  PickServer::Result planPick(const PickServer::Goal& goal, const ros::Time& started, const IsCancelled& is_cancelled,
                              const std::function<void(const std::string&)>& tell);
  ArmServer::Result planArm(const ArmServer::Goal& goal, const ros::Time& started, const IsCancelled& is_cancelled,
                            const std::function<void(const std::string&)>& tell);
  /// What all requests begin with. Throws PlanFailure, or std::invalid_argument for a bad start.
  motion_planning::PlanningContext makeContext(const std::vector<double>& start_rad, const ros::Time& min_map_stamp,
                                               const IsCancelled& is_cancelled, std::uint64_t* map_update);
  /// Waits, up to state/map_wait_s, until a mesh as new as `min_stamp` has come. False, and why: it has not.
  bool awaitMap(const ros::Time& min_stamp, const IsCancelled& is_cancelled, std::string* why_not);
  /// The next four throw PlanFailure, toArmGoal() also std::invalid_argument. Frames are looked up at the message's stamp.
  motion_planning::ArmGoal toArmGoal(const interactive_mapping_msgs::ArmGoal& message,
                                     const IsCancelled& is_cancelled) const;
  motion_planning::ArmGoal placeGoal(const std::string& frame) const;
  motion_planning::ArmGoal defaultStowGoal() const;
  Eigen::Isometry3d poseInMap(const geometry_msgs::PoseStamped& message, const std::string& what,
                              const IsCancelled& is_cancelled) const;
  /// Simulated time that a plan is charged: its result is held back until then.
  void charge(double cost_s, const ros::Time& started, const IsCancelled& is_cancelled);
  /// With the live values. A request asks once, so a change waits for the next one.
  std::shared_ptr<const motion_planning::MotionPlanner> plannerInUse() const;
  /// Fills in what the results of both actions have, shows plan or failure at `T_map_base` if that is known, and notes it.
  template <class Plan, class Result>
  void finish(const std::string& what, const Plan& plan, const std::optional<Eigen::Isometry3d>& T_map_base,
              const ros::WallTime& wall_start, double cost_s, Result* result);
  void note(const std::string& what, const interactive_mapping_msgs::PlanOutcome& outcome, double wall_ms);

  bool onWatch(interactive_mapping_msgs::WatchTrajectory::Request& request,
               interactive_mapping_msgs::WatchTrajectory::Response& response);
  bool onContainerEmptied(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  /// Logs once that all inputs have come, and now and then what is missing until they have. By diagnostics_timer_ alone.
  void reportReadiness();
  /// Judges the running trajectory and publishes the verdict.
  void monitor();

  void diagnoseMap(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseRobot(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnosePlans(diagnostic_updater::DiagnosticStatusWrapper& status);

  const MotionPlanningParams params_;
  const mp700_ur5e_description::BrickCatalogue catalogue_;
  const std::map<std::string, motion_planning::ArmVector> postures_;
  const std::shared_ptr<const motion_planning::ArmKinematics> kinematics_;
  const motion_planning::ManipulabilitySectors sectors_;
  mutable std::mutex planner_mutex_;  // guards planner_
  std::shared_ptr<const motion_planning::MotionPlanner> planner_;
  RobotState robot_;

  struct Watch {
    std::uint32_t id{0};
    ros::Time start;
    double duration_s{0.0};
    std::optional<motion_planning::OrientedBox> target;
    std::vector<motion_planning::ArmVector> first_rad;  // postures: the start, and what may still be among others
  };
  std::mutex monitor_mutex_;  // guards what follows, up to the blank line
  motion_planning::PathMonitor path_monitor_;
  std::optional<Watch> watch_;
  std::uint32_t num_watches_{0};
  ros::Publisher monitor_publisher_;

  std::mutex report_mutex_;                        // guards what follows, up to the blank line
  std::map<std::string, std::uint64_t> outcomes_;  // how often each
  std::string last_failure_;
  double slowest_ms_{0.0};
  std::atomic<std::uint64_t> failed_searches_{0};  // since the last plan

  bool is_ready_{false};
  int looks_not_ready_{0};

  PlanningMarkers markers_;
  std::unique_ptr<SceneKeeper> scenes_;
  ros::ServiceServer watch_server_, emptied_server_;
  std::unique_ptr<interactive_mapping_ros::ClockTimer> monitor_timer_;
  diagnostic_updater::Updater diagnostics_;
  ros::WallTimer diagnostics_timer_;
  std::unique_ptr<interactive_mapping_ros::LiveParams<MotionPlanningParams>> live_;
  std::unique_ptr<PickServer> pick_server_;  // last: their threads use the rest
  std::unique_ptr<ArmServer> arm_server_;
};

}  // namespace motion_planning_ros
