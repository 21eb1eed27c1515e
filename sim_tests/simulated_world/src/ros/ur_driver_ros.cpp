// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world_ros/ur_driver_ros.h"

#include <stdexcept>

#include <geometry_msgs/WrenchStamped.h>
#include <std_msgs/Bool.h>
#include <std_msgs/Float64.h>
#include <std_srvs/Trigger.h>
#include <ur_dashboard_msgs/AddToLog.h>
#include <ur_dashboard_msgs/GetLoadedProgram.h>
#include <ur_dashboard_msgs/GetProgramState.h>
#include <ur_dashboard_msgs/GetRobotMode.h>
#include <ur_dashboard_msgs/GetSafetyMode.h>
#include <ur_dashboard_msgs/IsInRemoteControl.h>
#include <ur_dashboard_msgs/IsProgramRunning.h>
#include <ur_dashboard_msgs/IsProgramSaved.h>
#include <ur_dashboard_msgs/Load.h>
#include <ur_dashboard_msgs/Popup.h>
#include <ur_msgs/SetIO.h>
#include <ur_msgs/SetPayload.h>
#include <ur_msgs/SetSpeedSliderFraction.h>

namespace simulated_world_ros {

using simulated_world::CommandAnswer;
using simulated_world::GoalAnswer;
using simulated_world::GoalError;
using simulated_world::GoalOutcome;
using simulated_world::GoalResult;
using simulated_world::UrController;

namespace {

constexpr const char* kController = "scaled_pos_joint_traj_controller/";
constexpr const char* kHardware = "ur_hardware_interface/";
constexpr const char* kDashboard = "ur_hardware_interface/dashboard/";
constexpr double kFeedbackPeriod_s = 0.05;  // the controller's action_monitor_rate is 20 Hz
constexpr double kIoPeriod_s = 0.1;

control_msgs::FollowJointTrajectoryResult toResult(GoalError error, const std::string& text) {
  control_msgs::FollowJointTrajectoryResult result;
  result.error_code = static_cast<int>(error);
  result.error_string = text;
  return result;
}

ur_dashboard_msgs::RobotMode toMessage(simulated_world::RobotMode mode) {
  ur_dashboard_msgs::RobotMode message;
  message.mode = static_cast<std::int8_t>(mode);
  return message;
}

ur_dashboard_msgs::SafetyMode toMessage(simulated_world::SafetyMode mode) {
  ur_dashboard_msgs::SafetyMode message;
  message.mode = static_cast<std::uint8_t>(mode);
  return message;
}

geometry_msgs::Vector3 toMessage(const Eigen::Vector3d& vector) {
  geometry_msgs::Vector3 message;
  message.x = vector.x();
  message.y = vector.y();
  message.z = vector.z();
  return message;
}

template <typename Response>
void answerWith(const CommandAnswer& answer, Response& response) {
  response.success = answer.success;
  response.answer = answer.text;
}

/// Of the services whose answer is a bool alone: the reason goes to the log, as in the driver.
template <typename Response>
void answerSilently(const std::string& name, const CommandAnswer& answer, Response& response) {
  response.success = answer.success;
  if (!answer.success) {
    ROS_ERROR_STREAM_NAMED("ur_driver", name << ": " << answer.text);
  }
}

}  // namespace

UrDriverRos::UrDriverRos(const ros::NodeHandle& nh, UrController& robot, std::mutex& robot_mutex,
                         const std::string& tf_prefix)
    : nh_(nh),
      robot_(robot),
      robot_mutex_(robot_mutex),
      tf_prefix_(tf_prefix),
      follow_server_(
          nh_, std::string(kController) + "follow_joint_trajectory",
          [this](const FollowServer::GoalHandle& handle) { followGoal(handle); },
          [this](const FollowServer::GoalHandle& handle) { followCancel(handle); }, false),
      set_mode_server_(
          nh_, std::string(kHardware) + "set_mode",
          [this](const SetModeServer::GoalHandle& handle) { setModeGoal(handle); },
          [this](const SetModeServer::GoalHandle& handle) { setModeCancel(handle); }, false) {
  offerTopics();
  offerDriverServices();
  offerDashboard();
  follow_server_.start();
  set_mode_server_.start();
}

std::size_t UrDriverRos::publish(const ros::Time& now, const ArmMeasurement& measured) {
  std::unique_lock<std::mutex> lock(robot_mutex_);
  const std::vector<simulated_world::JointLimits>& joints = robot_.follower().joints();
  const auto count = static_cast<Eigen::Index>(joints.size());
  if (measured.position_rad.size() != count || measured.velocity_rad_s.size() != count ||
      measured.current_A.size() != count) {
    throw std::invalid_argument("UrDriverRos: measured positions, velocities and currents must have " +
                                std::to_string(count) + " entries each");
  }
  stepModeGoal();
  const std::vector<simulated_world::GoalResult> results = robot_.takeResults();
  endGoals(results);
  publishChanges();
  if (!robot_.driverConnected()) {
    return results.size();
  }
  const control_msgs::JointTrajectoryControllerState state = toMessage(now, robot_.follower());
  publishFeedback(now, state);
  std_msgs::Float64 speed_scaling;
  speed_scaling.data = robot_.speedScaling();
  const ur_msgs::IOStates io = toMessage(robot_.io());
  lock.unlock();

  joint_states_pub_.publish(toMessage(now, joints, measured));
  state_pub_.publish(state);
  speed_scaling_pub_.publish(speed_scaling);
  if (now - io_time_ >= ros::Duration(kIoPeriod_s) || now < io_time_) {
    io_time_ = now;
    io_states_pub_.publish(io);
  }
  geometry_msgs::WrenchStamped wrench;
  wrench.header.stamp = now;
  wrench.header.frame_id = tf_prefix_ + "tool0_controller";
  wrench.wrench.force = toMessage(measured.force_tool_N);
  wrench.wrench.torque = toMessage(measured.torque_tool_Nm);
  wrench_pub_.publish(wrench);
  return results.size();
}

geometry_msgs::TransformStamped UrDriverRos::toolTransform(const ros::Time& now,
                                                           const Eigen::Isometry3d& T_base_tool) const {
  geometry_msgs::TransformStamped tool;
  tool.header.stamp = now;
  tool.header.frame_id = tf_prefix_ + "base";
  tool.child_frame_id = tf_prefix_ + "tool0_controller";
  tool.transform.translation = toMessage(Eigen::Vector3d(T_base_tool.translation()));
  const Eigen::Quaterniond rotation(T_base_tool.linear());
  tool.transform.rotation.x = rotation.x();
  tool.transform.rotation.y = rotation.y();
  tool.transform.rotation.z = rotation.z();
  tool.transform.rotation.w = rotation.w();
  return tool;
}

void UrDriverRos::offerTopics() {
  joint_states_pub_ = nh_.advertise<sensor_msgs::JointState>(
      "joint_states", 10,
      [this](const ros::SingleSubscriberPublisher& node) { joint_state_subscribers_.insert(node.getSubscriberName()); },
      [this](const ros::SingleSubscriberPublisher& node) {
        const auto one = joint_state_subscribers_.find(node.getSubscriberName());
        if (one != joint_state_subscribers_.end()) joint_state_subscribers_.erase(one);
      });
  wrench_pub_ = nh_.advertise<geometry_msgs::WrenchStamped>("wrench", 10);
  speed_scaling_pub_ = nh_.advertise<std_msgs::Float64>("speed_scaling_factor", 10);
  state_pub_ = nh_.advertise<control_msgs::JointTrajectoryControllerState>(std::string(kController) + "state", 10);
  io_states_pub_ = nh_.advertise<ur_msgs::IOStates>(std::string(kHardware) + "io_states", 1);
  robot_mode_pub_ = nh_.advertise<ur_dashboard_msgs::RobotMode>(std::string(kHardware) + "robot_mode", 1, true);
  safety_mode_pub_ = nh_.advertise<ur_dashboard_msgs::SafetyMode>(std::string(kHardware) + "safety_mode", 1, true);
  program_running_pub_ = nh_.advertise<std_msgs::Bool>(std::string(kHardware) + "robot_program_running", 1, true);
  command_sub_ = nh_.subscribe(std::string(kController) + "command", 1, &UrDriverRos::followCommand, this);
}

template <typename Service>
void UrDriverRos::offer(
    const std::string& name,
    const std::function<void(typename Service::Request&, typename Service::Response&, UrController&)>& serve) {
  using Callback = boost::function<bool(typename Service::Request&, typename Service::Response&)>;
  const Callback callback = [this, serve](typename Service::Request& request, typename Service::Response& response) {
    const std::lock_guard<std::mutex> lock(robot_mutex_);
    serve(request, response, robot_);
    return true;  // an answer is given also where the robot refuses
  };
  services_.push_back(nh_.advertiseService(name, callback));
}

void UrDriverRos::offerTrigger(const std::string& name, const Command& command) {
  offer<std_srvs::Trigger>(name, [command](auto&, auto& response, UrController& robot) {
    const CommandAnswer answer = command(robot);
    response.success = answer.success;
    response.message = answer.text;
  });
}

void UrDriverRos::offerDriverServices() {
  const std::string hardware = kHardware;
  offerTrigger(hardware + "zero_ftsensor", &UrController::zeroFtSensor);
  offerTrigger(hardware + "hand_back_control", &UrController::handBackControl);
  offerTrigger(hardware + "resend_robot_program", &UrController::resendRobotProgram);
  offer<ur_msgs::SetIO>(hardware + "set_io", [](auto& request, auto& response, UrController& robot) {
    answerSilently("set_io", robot.setIo(request.fun, request.pin, request.state), response);
  });
  offer<ur_msgs::SetPayload>(hardware + "set_payload", [](auto& request, auto& response, UrController& robot) {
    const auto& center = request.center_of_gravity;
    answerSilently("set_payload", robot.setPayload({request.mass, {center.x, center.y, center.z}}), response);
  });
  offer<ur_msgs::SetSpeedSliderFraction>(
      hardware + "set_speed_slider", [](auto& request, auto& response, UrController& robot) {
        answerSilently("set_speed_slider", robot.setSpeedSlider(request.speed_slider_fraction), response);
      });
}

void UrDriverRos::offerDashboard() {
  const std::string dashboard = kDashboard;
  offerTrigger(dashboard + "power_on", &UrController::powerOn);
  offerTrigger(dashboard + "power_off", &UrController::powerOff);
  offerTrigger(dashboard + "brake_release", &UrController::brakeRelease);
  offerTrigger(dashboard + "play", &UrController::play);
  offerTrigger(dashboard + "pause", &UrController::pause);
  offerTrigger(dashboard + "stop", &UrController::stop);
  offerTrigger(dashboard + "unlock_protective_stop", &UrController::unlockProtectiveStop);
  offerTrigger(dashboard + "restart_safety", &UrController::restartSafety);
  offerTrigger(dashboard + "close_popup", &UrController::closePopup);
  offerTrigger(dashboard + "close_safety_popup", &UrController::closeSafetyPopup);

  using namespace ur_dashboard_msgs;
  offer<Load>(dashboard + "load_program", [](auto& request, auto& response, UrController& robot) {
    answerWith(robot.loadProgram(request.filename), response);
  });
  offer<Popup>(dashboard + "popup", [](auto&, auto& response, UrController& robot) {
    answerWith({robot.driverConnected(), "showing popup"}, response);
  });
  offer<AddToLog>(dashboard + "add_to_log", [](auto&, auto& response, UrController& robot) {
    answerWith({robot.driverConnected(), "Added log message"}, response);
  });
  offer<GetRobotMode>(dashboard + "get_robot_mode", [](auto&, auto& response, UrController& robot) {
    response.robot_mode = toMessage(robot.robotMode());
    answerWith({robot.driverConnected(), std::string("Robotmode: ") + toString(robot.robotMode())}, response);
  });
  offer<GetSafetyMode>(dashboard + "get_safety_mode", [](auto&, auto& response, UrController& robot) {
    response.safety_mode = toMessage(robot.safetyMode());
    answerWith({robot.driverConnected(), std::string("Safetymode: ") + toString(robot.safetyMode())}, response);
  });
  offer<GetLoadedProgram>(dashboard + "get_loaded_program", [](auto&, auto& response, UrController& robot) {
    response.program_name = robot.loadedProgram();
    answerWith({robot.driverConnected(), "Loaded program: " + robot.loadedProgram()}, response);
  });
  offer<GetProgramState>(dashboard + "program_state", [](auto&, auto& response, UrController& robot) {
    response.state.state = toString(robot.programState());
    response.program_name = robot.loadedProgram();
    answerWith({robot.driverConnected(), response.state.state + " " + robot.loadedProgram()}, response);
  });
  offer<IsProgramRunning>(dashboard + "program_running", [](auto&, auto& response, UrController& robot) {
    response.program_running = robot.programState() == simulated_world::ProgramState::kPlaying;
    answerWith({robot.driverConnected(), response.program_running ? "Program running: true" : "Program running: false"},
               response);
  });
  offer<IsProgramSaved>(dashboard + "program_saved", [](auto&, auto& response, UrController& robot) {
    response.program_saved = true;
    response.program_name = robot.loadedProgram();
    answerWith({robot.driverConnected(), "true " + robot.loadedProgram()}, response);
  });
  offer<IsInRemoteControl>(dashboard + "is_in_remote_control", [](auto&, auto& response, UrController& robot) {
    response.in_remote_control = robot.isInRemoteControl();
    answerWith({robot.driverConnected(), robot.isInRemoteControl() ? "true" : "false"}, response);
  });
}

void UrDriverRos::followGoal(FollowServer::GoalHandle handle) {
  // One lock over question and answer: publish() must not end a goal that is not yet accepted.
  const std::lock_guard<std::mutex> lock(robot_mutex_);
  const std::string id = handle.getGoalID().id;
  const GoalAnswer answer = robot_.acceptGoal(fromMessage(id, *handle.getGoal()));
  if (!answer.accepted) {
    ROS_ERROR_STREAM_NAMED("ur_driver", "trajectory goal refused: " << answer.text);
    handle.setRejected(toResult(answer.error, answer.text), answer.text);
    return;
  }
  handle.setAccepted();
  follow_goals_[id] = handle;
}

void UrDriverRos::followCancel(const FollowServer::GoalHandle& handle) {
  const std::lock_guard<std::mutex> lock(robot_mutex_);
  robot_.cancelGoal(handle.getGoalID().id);
}

void UrDriverRos::followCommand(const trajectory_msgs::JointTrajectory& trajectory) {
  const std::lock_guard<std::mutex> lock(robot_mutex_);
  const GoalAnswer answer = robot_.acceptGoal(fromMessage("topic command", trajectory));
  if (!answer.accepted) {
    ROS_ERROR_STREAM_NAMED("ur_driver", "trajectory command refused: " << answer.text);
  }
}

void UrDriverRos::setModeGoal(SetModeServer::GoalHandle handle) {
  const std::lock_guard<std::mutex> lock(robot_mutex_);
  if (mode_goal_) {
    ur_dashboard_msgs::SetModeResult result;
    result.message = "replaced by another goal";
    mode_goal_->handle.setCanceled(result, result.message);
  }
  handle.setAccepted();
  const auto goal = handle.getGoal();
  mode_goal_.emplace(ModeGoal{handle,
                              {static_cast<simulated_world::RobotMode>(goal->target_robot_mode.mode),
                               goal->stop_program != 0, goal->play_program != 0}});
}

void UrDriverRos::setModeCancel(const SetModeServer::GoalHandle& handle) {
  const std::lock_guard<std::mutex> lock(robot_mutex_);
  if (mode_goal_ && mode_goal_->handle == handle) {
    mode_goal_->handle.setCanceled();
    mode_goal_.reset();
  }
}

void UrDriverRos::stepModeGoal() {
  if (!mode_goal_) {
    return;
  }
  const std::optional<CommandAnswer> answer = mode_goal_->request.step(robot_);
  if (!answer) {
    return;
  }
  ur_dashboard_msgs::SetModeResult result;
  result.success = answer->success;
  result.message = answer->text;
  if (answer->success) {
    mode_goal_->handle.setSucceeded(result, result.message);
  } else {
    mode_goal_->handle.setAborted(result, result.message);
  }
  mode_goal_.reset();
}

void UrDriverRos::endGoals(const std::vector<GoalResult>& results) {
  for (const GoalResult& ended : results) {
    const auto found = follow_goals_.find(ended.goal_id);
    if (found == follow_goals_.end()) {
      continue;  // from the topic
    }
    const control_msgs::FollowJointTrajectoryResult result = toResult(ended.error, ended.text);
    switch (ended.outcome) {
      case GoalOutcome::kSucceeded:
        found->second.setSucceeded(result, ended.text);
        break;
      case GoalOutcome::kAborted:
        found->second.setAborted(result, ended.text);
        break;
      case GoalOutcome::kPreempted:
      case GoalOutcome::kCanceled:
        found->second.setCanceled(result, ended.text);
        break;
    }
    if (ended.outcome == GoalOutcome::kAborted) {
      ROS_WARN_STREAM_NAMED("ur_driver", "trajectory aborted: " << ended.text);
    }
    follow_goals_.erase(found);
  }
}

void UrDriverRos::publishChanges() {
  if (program_running_ != robot_.robotProgramRunning()) {
    program_running_ = robot_.robotProgramRunning();
    std_msgs::Bool message;
    message.data = *program_running_ ? 1 : 0;
    program_running_pub_.publish(message);
  }
  if (!robot_.driverConnected()) {
    return;
  }
  if (robot_mode_ != robot_.robotMode()) {
    robot_mode_ = robot_.robotMode();
    robot_mode_pub_.publish(toMessage(*robot_mode_));
    ROS_INFO_STREAM_NAMED("ur_driver", "robot mode " << toString(*robot_mode_));
  }
  if (safety_mode_ != robot_.safetyMode()) {
    safety_mode_ = robot_.safetyMode();
    safety_mode_pub_.publish(toMessage(*safety_mode_));
    ROS_INFO_STREAM_NAMED("ur_driver", "safety mode " << toString(*safety_mode_));
  }
}

void UrDriverRos::publishFeedback(const ros::Time& now, const control_msgs::JointTrajectoryControllerState& state) {
  if (now - feedback_time_ < ros::Duration(kFeedbackPeriod_s) && now >= feedback_time_) {
    return;
  }
  const auto active = robot_.follower().activeGoal();
  const auto found = active ? follow_goals_.find(*active) : follow_goals_.end();
  if (found != follow_goals_.end()) {
    feedback_time_ = now;
    control_msgs::FollowJointTrajectoryFeedback feedback;
    feedback.header = state.header;
    feedback.joint_names = state.joint_names;
    feedback.desired = state.desired;
    feedback.actual = state.actual;
    feedback.error = state.error;
    found->second.publishFeedback(feedback);
  }
  if (mode_goal_) {
    feedback_time_ = now;
    ur_dashboard_msgs::SetModeFeedback feedback;
    feedback.current_robot_mode = static_cast<std::int8_t>(robot_.robotMode());
    feedback.current_safety_mode = static_cast<std::int8_t>(robot_.safetyMode());
    mode_goal_->handle.publishFeedback(feedback);
  }
}

}  // namespace simulated_world_ros
