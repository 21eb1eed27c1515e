// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <actionlib/server/action_server.h>
#include <control_msgs/JointTrajectoryControllerState.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <geometry_msgs/WrenchStamped.h>
#include <interactive_mapping_common_ros/clock_timer.h>
#include <interactive_mapping_msgs/ArmBridgeState.h>
#include <interactive_mapping_msgs/ArmOutcome.h>
#include <interactive_mapping_msgs/LetGoBrickAction.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <interactive_mapping_msgs/MoveArmAction.h>
#include <interactive_mapping_msgs/PathMonitorState.h>
#include <interactive_mapping_msgs/PickBrickAction.h>
#include <interactive_mapping_msgs/RecoverArmAction.h>
#include <mp700_ur5e_description/brick_types.h>
#include <pluginlib/class_loader.hpp>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <sensor_msgs/JointState.h>
#include <std_msgs/Bool.h>
#include <std_msgs/Float64.h>
#include <std_msgs/Header.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>
#include <ur_dashboard_msgs/RobotMode.h>
#include <ur_dashboard_msgs/SafetyMode.h>

#include "ur_driver_bridge_ros/attached_memory.h"
#include "ur_driver_bridge_ros/gripper.h"
#include "ur_driver_bridge_ros/ur_driver.h"
#include "ur_driver_bridge_ros/ur_driver_bridge_params.h"

namespace ur_driver_bridge_ros {

/// The node: actions in, the arm's driver out, the executor in between. One thread (control) has the executor and all
/// topics; it acts with each joint state, and by a timer when none come. Actions and services have the global queue and
/// hand their requests over. Calls to driver and planner have threads of their own, so that nothing holds up the gate.
/// Long: each topic, service and diagnostic is a few lines, and the work is in the core.
class UrDriverBridgeRos {
 public:
  /// Throws std::invalid_argument for impossible parameters, a missing robot_description or bricks file.
  UrDriverBridgeRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  ~UrDriverBridgeRos();

  /// Stops the arm, if it moves, and waits until it stands. The magnet stays as it is.
  void stop(ros::WallDuration timeout);

 private:
  /// Of whichever action a request came by.
  struct Request {
    std::string goal_id;
    const char* name;  // of the action
    std::function<bool()> isCancelAsked;
    std::function<void()> begin;  // hands it to the executor; throws std::invalid_argument
    std::function<void(const std::string& stage, double progress)> tell;
    std::function<void(const ur_driver_bridge::Finished&)> end;
    std::function<void()> setAttached;  // what AttachCall{true} tells; picks only
    geometry_msgs::PoseStamped target;  // for the watch; picks only
    geometry_msgs::Vector3 target_size;
  };

  void startGripper(const ros::NodeHandle& own_nh);
  void startCalls();
  void subscribeAll();
  void startActions(ros::NodeHandle handle);

  template <typename Action>
  using Server = actionlib::ActionServer<Action>;
  template <typename Action, typename Prepare>
  void onGoal(typename Server<Action>::GoalHandle goal, const char* name, Prepare prepare);
  Request preparePick(const interactive_mapping_msgs::PickBrickGoal& goal);
  bool onHold(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool onRelease(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool onStop(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);

  void onJointStates(const sensor_msgs::JointStateConstPtr& message);
  void onControllerState(const control_msgs::JointTrajectoryControllerStateConstPtr& message);
  void onWrench(const geometry_msgs::WrenchStampedConstPtr& message);
  void onGripper(const ur_driver_bridge::GripperState& state);
  void onMapUpdate(const interactive_mapping_msgs::MapUpdateConstPtr& message);
  void onMonitor(const interactive_mapping_msgs::PathMonitorStateConstPtr& message);
  void onHeartbeat(const std_msgs::HeaderConstPtr& message);
  ros::Time timeOfArrival() const;
  void onWatchdog();

  void step(const ros::Time& now);
  void takeWords();
  void takeRequests();
  void carryOut(const ur_driver_bridge::ArmCall& call);
  void watch(std::uint64_t id, const ur_driver_bridge::WatchCall& call);
  void publishAttached(bool is_attached);
  void tellAttached(const interactive_mapping_msgs::AttachedBrick& attached);
  void publishState(const ros::Time& now);
  void finish(const ur_driver_bridge::Finished& finished);
  interactive_mapping_msgs::ArmOutcome toMessage(const ur_driver_bridge::Finished& finished) const;

  void diagnoseArm(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseRequests(diagnostic_updater::DiagnosticStatusWrapper& status);

  const UrDriverBridgeParams params_;
  const mp700_ur5e_description::BrickCatalogue catalogue_;
  const ur_driver_bridge::ArmModel model_;
  ur_driver_bridge::Executor executor_;  // control thread

  ros::NodeHandle nh_;
  tf2_ros::Buffer tf_;
  std::optional<tf2_ros::TransformListener> tf_listener_;
  std::string watch_service_;

  AttachedMemory attached_memory_;
  const std::optional<interactive_mapping_msgs::AttachedBrick> attached_before_;  // by the process before this one

  // Control thread.
  ur_driver_bridge::GateInputs inputs_;
  std::optional<Request> current_;
  bool is_magnet_on_{false};
  bool is_attached_known_{false};  // something has been told about what hangs on the magnet
  ros::Time last_step_, told_;

  std::mutex requests_mutex_;  // what other threads hand over
  std::optional<Request> next_;
  bool is_busy_{false};  // a request is waiting or being carried out
  bool is_stop_asked_{false};
  bool is_held_{false};
  bool is_stopping_{false};
  std::condition_variable idle_;

  std::mutex answers_mutex_;
  std::condition_variable answered_;
  std::vector<ur_driver_bridge::CallReply> replies_;
  std::vector<ur_driver_bridge::TrajectoryEvent> events_;
  std::optional<double> heartbeat_s_, heartbeat_wall_s_;
  std::optional<ur_driver_bridge::MonitorWord> monitor_;
  std::optional<std::uint32_t> watch_id_;  // the path monitor has begun it last
  bool is_watch_heard_{false};             // the monitor has spoken of it

  std::mutex shared_mutex_;  // for diagnostics
  interactive_mapping_msgs::ArmBridgeState shown_;
  std::string modes_;
  std::map<std::string, int> outcomes_;
  std::string last_failure_;
  ros::WallTime stepped_;

  ros::Publisher state_publisher_, outcome_publisher_, marker_publisher_, attached_publisher_;
  ros::ServiceServer hold_server_, release_server_, stop_server_;
  std::unique_ptr<Server<interactive_mapping_msgs::MoveArmAction>> move_server_;
  std::unique_ptr<Server<interactive_mapping_msgs::PickBrickAction>> pick_server_;
  std::unique_ptr<Server<interactive_mapping_msgs::LetGoBrickAction>> let_go_server_;
  std::unique_ptr<Server<interactive_mapping_msgs::RecoverArmAction>> recover_server_;
  diagnostic_updater::Updater diagnostics_;
  ros::WallTimer diagnostics_timer_;

  ros::CallbackQueue control_queue_, mission_queue_;
  std::vector<ros::Subscriber> subscribers_;
  std::unique_ptr<interactive_mapping_ros::ClockTimer> watchdog_;
  std::unique_ptr<CallThread> planner_calls_;
  pluginlib::ClassLoader<Gripper> gripper_loader_{"ur_driver_bridge", "ur_driver_bridge_ros::Gripper"};
  pluginlib::UniquePtr<Gripper> gripper_;
  std::unique_ptr<UrDriver> driver_;
  std::unique_ptr<ros::AsyncSpinner> control_spinner_, mission_spinner_;
};

}  // namespace ur_driver_bridge_ros
