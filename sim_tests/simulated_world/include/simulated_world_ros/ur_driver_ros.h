// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <actionlib/server/action_server.h>
#include <control_msgs/FollowJointTrajectoryAction.h>
#include <geometry_msgs/TransformStamped.h>
#include <ros/ros.h>
#include <ur_dashboard_msgs/SetModeAction.h>

#include "simulated_world/ur_controller.h"
#include "simulated_world/ur_mode_request.h"
#include "simulated_world_ros/ur_messages.h"

namespace simulated_world_ros {

/// The ROS interface of ur_robot_driver on a simulated robot: topics, services and actions by the driver's names, below
/// the node handle's namespace. No threads: callbacks run in the node handle's queue and take the robot's mutex;
/// publish() is called by the simulation. The robot's time is ROS time. After robot.setDriverConnected(false) services
/// answer with a refusal and publish() sends robot_program_running and the ends of goals only.
class UrDriverRos {
 public:
  /// `robot_mutex` guards `robot`; both must outlive this object. Frames get `tf_prefix`.
  UrDriverRos(const ros::NodeHandle& nh, simulated_world::UrController& robot, std::mutex& robot_mutex,
              const std::string& tf_prefix);
  UrDriverRos(const UrDriverRos&) = delete;
  UrDriverRos& operator=(const UrDriverRos&) = delete;

  /// Sends the robot's state after an update at `now`, and answers goals; returns how many trajectory goals ended. The
  /// caller must not hold the mutex.
  /// Throws std::invalid_argument if an array of `measured` has not got one entry per joint.
  std::size_t publish(const ros::Time& now, const ArmMeasurement& measured);

  /// What the driver sends to tf: the tool in the controller's base. For the caller to send along with other transforms.
  geometry_msgs::TransformStamped toolTransform(const ros::Time& now, const Eigen::Isometry3d& T_base_tool) const;

  /// Nodes that hear the joint states, once for each connection.
  const std::multiset<std::string>& jointStateSubscribers() const { return joint_state_subscribers_; }

 private:
  using FollowServer = actionlib::ActionServer<control_msgs::FollowJointTrajectoryAction>;
  using SetModeServer = actionlib::ActionServer<ur_dashboard_msgs::SetModeAction>;
  using Command = std::function<simulated_world::CommandAnswer(simulated_world::UrController&)>;
  struct ModeGoal {
    SetModeServer::GoalHandle handle;
    simulated_world::UrModeRequest request;
  };

  void offerTopics();
  void offerDriverServices();
  void offerDashboard();
  void offerTrigger(const std::string& name, const Command& command);
  template <typename Service>
  void offer(const std::string& name, const std::function<void(typename Service::Request&, typename Service::Response&,
                                                               simulated_world::UrController&)>& serve);
  void followGoal(FollowServer::GoalHandle handle);
  void followCancel(const FollowServer::GoalHandle& handle);
  void followCommand(const trajectory_msgs::JointTrajectory& trajectory);
  void setModeGoal(SetModeServer::GoalHandle handle);
  void setModeCancel(const SetModeServer::GoalHandle& handle);
  void stepModeGoal();
  void endGoals(const std::vector<simulated_world::GoalResult>& results);
  void publishChanges();
  void publishFeedback(const ros::Time& now, const control_msgs::JointTrajectoryControllerState& state);

  ros::NodeHandle nh_;
  simulated_world::UrController& robot_;
  std::mutex& robot_mutex_;  // guards robot_ and the goals below
  std::string tf_prefix_;
  std::vector<ros::ServiceServer> services_;
  ros::Subscriber command_sub_;
  std::multiset<std::string> joint_state_subscribers_;
  ros::Publisher joint_states_pub_, wrench_pub_, speed_scaling_pub_, state_pub_, io_states_pub_;
  ros::Publisher robot_mode_pub_, safety_mode_pub_, program_running_pub_;
  FollowServer follow_server_;
  SetModeServer set_mode_server_;
  std::map<std::string, FollowServer::GoalHandle> follow_goals_;
  std::optional<ModeGoal> mode_goal_;
  // What was published last; touched by publish() only.
  std::optional<simulated_world::RobotMode> robot_mode_;
  std::optional<simulated_world::SafetyMode> safety_mode_;
  std::optional<bool> program_running_;
  ros::Time feedback_time_, io_time_;
};

}  // namespace simulated_world_ros
