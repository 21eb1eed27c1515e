// SPDX-License-Identifier: BSD-3-Clause
// A client's view of the simulated driver. One thread turns the robot, the driver and the clients' callbacks.
#include "simulated_world_ros/ur_driver_ros.h"

#include <chrono>
#include <future>

#include <actionlib/client/simple_action_client.h>
#include <geometry_msgs/WrenchStamped.h>
#include <gtest/gtest.h>
#include <ros/ros.h>
#include <std_msgs/Bool.h>
#include <std_msgs/Float64.h>
#include <std_srvs/Trigger.h>
#include <ur_dashboard_msgs/GetProgramState.h>
#include <ur_dashboard_msgs/GetSafetyMode.h>
#include <ur_dashboard_msgs/Load.h>
#include <ur_msgs/SetIO.h>
#include <ur_msgs/SetPayload.h>
#include <ur_msgs/SetSpeedSliderFraction.h>

namespace simulated_world_ros {
namespace {

using actionlib::SimpleClientGoalState;
using simulated_world::JointLimits;
using simulated_world::UrController;
using FollowClient = actionlib::SimpleActionClient<control_msgs::FollowJointTrajectoryAction>;
using SetModeClient = actionlib::SimpleActionClient<ur_dashboard_msgs::SetModeAction>;

constexpr double kDt_s = 0.002;

std::vector<JointLimits> armJoints() {
  std::vector<JointLimits> joints;
  for (const char* name : {"shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint",
                           "wrist_3_joint"}) {
    joints.push_back({name, -3.14, 3.14, 3.14, 150.0});
  }
  return joints;
}

/// The last message of a topic.
template <typename Message>
class Latest {
 public:
  Latest(ros::NodeHandle& nh, const std::string& topic)
      : subscriber_(nh.subscribe<Message>(
            topic, 10, [this](const boost::shared_ptr<const Message>& message) { message_ = message; })) {}

  explicit operator bool() const { return message_ != nullptr; }
  const Message& operator*() const { return *message_; }
  const Message* operator->() const { return message_.get(); }

 private:
  boost::shared_ptr<const Message> message_;
  ros::Subscriber subscriber_;
};

class UrDriverRosTest : public testing::Test {
 public:
  UrDriverRosTest() {
    measured.position_rad = Eigen::VectorXd::Zero(6);
    measured.velocity_rad_s = Eigen::VectorXd::Zero(6);
    measured.current_A = Eigen::VectorXd::LinSpaced(6, 0.0, 0.5);
  }

  /// One cycle of an arm that follows at once.
  void step() {
    now += ros::Duration(kDt_s);
    {
      const std::lock_guard<std::mutex> lock(mutex);
      const simulated_world::JointMotion& setpoint =
          robot.update(now.toSec(), kDt_s, measured.position_rad, measured.velocity_rad_s);
      measured.position_rad = setpoint.position_rad;
      measured.velocity_rad_s = setpoint.velocity_rad_s;
    }
    driver.publish(now, measured);
    ros::spinOnce();
  }

  /// Whether the condition comes true; the limit is wall time and long, for loaded machines.
  bool stepUntil(const std::function<bool()>& condition) {
    const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (!condition()) {
      if (!ros::ok() || std::chrono::steady_clock::now() > limit) return false;
      step();
    }
    return true;
  }

  template <typename Service>
  typename Service::Response call(const std::string& name, const typename Service::Request& request = {}) {
    Service service;
    service.request = request;
    auto called = std::async(std::launch::async, [&] {
      return ros::service::waitForService(name, ros::Duration(20.0)) && ros::service::call(name, service);
    });
    EXPECT_TRUE(stepUntil([&] { return called.wait_for(std::chrono::seconds(0)) == std::future_status::ready; }))
        << name;
    EXPECT_TRUE(called.get()) << name;
    return service.response;
  }

  std_srvs::TriggerResponse trigger(const std::string& name) {
    return call<std_srvs::Trigger>("ur_hardware_interface/" + name);
  }

  void bringUp() {
    SetModeClient client(nh, "ur_hardware_interface/set_mode", false);
    ASSERT_TRUE(stepUntil([&] { return client.isServerConnected(); }));
    ur_dashboard_msgs::SetModeGoal goal;
    goal.target_robot_mode.mode = ur_dashboard_msgs::RobotMode::RUNNING;
    goal.play_program = 1;
    client.sendGoal(goal);
    ASSERT_TRUE(stepUntil([&] { return client.getState().isDone(); }));
    ASSERT_EQ(client.getState(), SimpleClientGoalState::SUCCEEDED) << client.getResult()->message;
    ASSERT_TRUE(client.getResult()->success);
  }

  static control_msgs::FollowJointTrajectoryGoal turnTo(double pan_rad, double time_s) {
    control_msgs::FollowJointTrajectoryGoal goal;
    goal.trajectory.joint_names = {"elbow_joint",   "shoulder_lift_joint", "shoulder_pan_joint",
                                   "wrist_1_joint", "wrist_2_joint",       "wrist_3_joint"};
    goal.trajectory.points.resize(1);
    goal.trajectory.points[0].positions = {0.0, 0.0, pan_rad, 0.0, 0.0, 0.0};
    goal.trajectory.points[0].velocities.assign(6, 0.0);
    goal.trajectory.points[0].time_from_start = ros::Duration(time_s);
    return goal;
  }

  void send(FollowClient& client, const control_msgs::FollowJointTrajectoryGoal& goal) {
    ASSERT_TRUE(stepUntil([&] { return client.isServerConnected(); }));
    client.sendGoal(goal);
  }

  ros::NodeHandle nh;
  std::mutex mutex;
  UrController robot{armJoints(), {}};
  UrDriverRos driver{nh, robot, mutex, "ur5e_"};
  ArmMeasurement measured;
  ros::Time now{100.0};
  FollowClient follow{nh, "scaled_pos_joint_traj_controller/follow_joint_trajectory", false};
};

TEST_F(UrDriverRosTest, FollowsATrajectoryAndReportsTheJointsAlphabetically) {
  Latest<sensor_msgs::JointState> joints(nh, "joint_states");
  Latest<control_msgs::JointTrajectoryControllerState> state(nh, "scaled_pos_joint_traj_controller/state");
  bringUp();
  send(follow, turnTo(0.5, 1.0));
  ASSERT_TRUE(stepUntil([&] { return follow.getState().isDone(); }));
  EXPECT_EQ(follow.getState(), SimpleClientGoalState::SUCCEEDED);
  EXPECT_EQ(follow.getResult()->error_code, control_msgs::FollowJointTrajectoryResult::SUCCESSFUL);
  const ros::Time done = now;
  ASSERT_TRUE(stepUntil([&] { return joints && state && joints->header.stamp > done && state->header.stamp > done; }));
  EXPECT_EQ(joints->name, (std::vector<std::string>{"elbow_joint", "shoulder_lift_joint", "shoulder_pan_joint",
                                                    "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"}));
  EXPECT_NEAR(joints->position[2], 0.5, 1e-9);  // rounding
  // Currents 0.0, 0.1, 0.2 of pan, lift, elbow.
  EXPECT_NEAR(joints->effort[0], 0.2, 1e-9);
  EXPECT_NEAR(joints->effort[2], 0.0, 1e-9);
  EXPECT_EQ(state->joint_names.front(), "shoulder_pan_joint");
  EXPECT_NEAR(state->desired.positions.front(), 0.5, 1e-9);
}

TEST_F(UrDriverRosTest, RejectsAGoalWithTheReason) {
  send(follow, turnTo(0.5, 1.0));
  ASSERT_TRUE(stepUntil([&] { return follow.getState().isDone(); }));
  EXPECT_EQ(follow.getState(), SimpleClientGoalState::REJECTED);
  EXPECT_EQ(follow.getResult()->error_string, "Can't accept new action goals. Controller is not running.");
  bringUp();
  control_msgs::FollowJointTrajectoryGoal goal = turnTo(0.5, 1.0);
  goal.trajectory.joint_names[0] = "ellbow_joint";
  send(follow, goal);
  ASSERT_TRUE(stepUntil([&] { return follow.getState().isDone(); }));
  EXPECT_EQ(follow.getState(), SimpleClientGoalState::REJECTED);
  EXPECT_EQ(follow.getResult()->error_code, control_msgs::FollowJointTrajectoryResult::INVALID_JOINTS);
}

TEST_F(UrDriverRosTest, TellsTheOldGoalThatANewOneCame) {
  bringUp();
  FollowClient other(nh, "scaled_pos_joint_traj_controller/follow_joint_trajectory", false);
  send(follow, turnTo(1.0, 60.0));
  ASSERT_TRUE(stepUntil([&] { return follow.getState() == SimpleClientGoalState::ACTIVE; }));
  send(other, turnTo(0.2, 1.0));
  ASSERT_TRUE(stepUntil([&] { return follow.getState().isDone() && other.getState().isDone(); }));
  EXPECT_EQ(follow.getState(), SimpleClientGoalState::PREEMPTED);
  EXPECT_EQ(other.getState(), SimpleClientGoalState::SUCCEEDED);
}

TEST_F(UrDriverRosTest, CancelsAGoal) {
  bringUp();
  send(follow, turnTo(1.0, 60.0));
  ASSERT_TRUE(stepUntil([&] { return follow.getState() == SimpleClientGoalState::ACTIVE; }));
  follow.cancelGoal();
  ASSERT_TRUE(stepUntil([&] { return follow.getState().isDone(); }));
  EXPECT_EQ(follow.getState(), SimpleClientGoalState::PREEMPTED);
  EXPECT_FALSE(robot.follower().activeGoal());
}

TEST_F(UrDriverRosTest, AProtectiveStopAbortsAndIsSeenByWhoComesLater) {
  bringUp();
  send(follow, turnTo(1.0, 60.0));
  ASSERT_TRUE(stepUntil([&] { return follow.getState() == SimpleClientGoalState::ACTIVE; }));
  robot.protectiveStop("collision");
  ASSERT_TRUE(stepUntil([&] { return follow.getState().isDone(); }));
  EXPECT_EQ(follow.getState(), SimpleClientGoalState::ABORTED);
  EXPECT_EQ(follow.getResult()->error_string, "protective stop: collision");
  Latest<ur_dashboard_msgs::SafetyMode> safety(nh, "ur_hardware_interface/safety_mode");
  Latest<ur_dashboard_msgs::RobotMode> mode(nh, "ur_hardware_interface/robot_mode");
  Latest<std_msgs::Bool> running(nh, "ur_hardware_interface/robot_program_running");
  ASSERT_TRUE(stepUntil([&] { return safety && mode && running; })) << "not latched";
  EXPECT_EQ(safety->mode, ur_dashboard_msgs::SafetyMode::PROTECTIVE_STOP);
  EXPECT_EQ(mode->mode, ur_dashboard_msgs::RobotMode::RUNNING);
  EXPECT_FALSE(running->data);
  EXPECT_EQ(call<ur_dashboard_msgs::GetSafetyMode>("ur_hardware_interface/dashboard/get_safety_mode").answer,
            "Safetymode: PROTECTIVE_STOP");
  EXPECT_FALSE(trigger("dashboard/play").success);
  const ros::Time unlockable = now + ros::Duration(5.0);
  ASSERT_TRUE(stepUntil([&] { return now > unlockable; }));
  EXPECT_EQ(trigger("dashboard/unlock_protective_stop").message, "Protective stop releasing");
  EXPECT_TRUE(trigger("dashboard/play").success);
  EXPECT_TRUE(stepUntil([&] { return running->data; }));
}

TEST_F(UrDriverRosTest, SetsOutputsSpeedAndPayload) {
  Latest<ur_msgs::IOStates> io(nh, "ur_hardware_interface/io_states");
  Latest<std_msgs::Float64> scaling(nh, "speed_scaling_factor");
  bringUp();
  ur_msgs::SetIORequest request;
  request.fun = ur_msgs::SetIORequest::FUN_SET_DIGITAL_OUT;
  request.pin = ur_msgs::SetIORequest::PIN_TOOL_DOUT0;
  request.state = ur_msgs::SetIORequest::STATE_ON;
  EXPECT_TRUE(call<ur_msgs::SetIO>("ur_hardware_interface/set_io", request).success);
  EXPECT_TRUE(stepUntil([&] { return io && io->digital_out_states.at(16).state; }));
  EXPECT_EQ(io->digital_out_states.at(16).pin, 16);
  request.fun = ur_msgs::SetIORequest::FUN_SET_FLAG;
  EXPECT_FALSE(call<ur_msgs::SetIO>("ur_hardware_interface/set_io", request).success);
  ur_msgs::SetSpeedSliderFractionRequest slider;
  slider.speed_slider_fraction = 0.5;
  EXPECT_TRUE(call<ur_msgs::SetSpeedSliderFraction>("ur_hardware_interface/set_speed_slider", slider).success);
  EXPECT_TRUE(stepUntil([&] { return scaling && scaling->data == 0.5; }));
  ur_msgs::SetPayloadRequest payload;
  payload.mass = 1.5F;
  payload.center_of_gravity.z = 0.1;
  EXPECT_TRUE(call<ur_msgs::SetPayload>("ur_hardware_interface/set_payload", payload).success);
  EXPECT_EQ(robot.payload().mass_kg, 1.5);
  EXPECT_EQ(robot.payload().center_of_gravity_m.z(), 0.1);
}

TEST_F(UrDriverRosTest, SendsWrenchAndToolPoseInTheControllersFrames) {
  Latest<geometry_msgs::WrenchStamped> wrench(nh, "wrench");
  measured.force_tool_N = Eigen::Vector3d(1.0, 2.0, 3.0);
  ASSERT_TRUE(stepUntil([&] { return static_cast<bool>(wrench); }));
  EXPECT_EQ(wrench->header.frame_id, "ur5e_tool0_controller");
  EXPECT_EQ(wrench->wrench.force.z, 3.0);
  const auto tool = driver.toolTransform(ros::Time(3.0), Eigen::Isometry3d(Eigen::Translation3d(0.4, 0.5, 0.6)));
  EXPECT_EQ(tool.header.stamp, ros::Time(3.0));
  EXPECT_EQ(tool.header.frame_id, "ur5e_base");
  EXPECT_EQ(tool.child_frame_id, "ur5e_tool0_controller");
  EXPECT_EQ(tool.transform.translation.y, 0.5);
  EXPECT_EQ(tool.transform.rotation.w, 1.0);
}

TEST_F(UrDriverRosTest, ADriverThatIsGoneRefusesAndFallsSilent) {
  Latest<sensor_msgs::JointState> joints(nh, "joint_states");
  Latest<std_msgs::Bool> running(nh, "ur_hardware_interface/robot_program_running");
  bringUp();
  ASSERT_TRUE(stepUntil([&] { return joints && running && running->data; }));
  robot.setDriverConnected(false);
  const ros::Time gone = now;
  ASSERT_TRUE(stepUntil([&] { return !running->data; }));
  EXPECT_FALSE(trigger("dashboard/play").success);  // turns the driver many times
  EXPECT_LE(joints->header.stamp, gone);
  robot.setDriverConnected(true);
  EXPECT_TRUE(trigger("dashboard/play").success);
  EXPECT_TRUE(stepUntil([&] { return running->data && joints->header.stamp > gone; }));
}

TEST_F(UrDriverRosTest, TakesTrajectoriesFromTheCommandTopic) {
  bringUp();
  ros::Publisher command =
      nh.advertise<trajectory_msgs::JointTrajectory>("scaled_pos_joint_traj_controller/command", 1);
  ASSERT_TRUE(stepUntil([&] { return command.getNumSubscribers() > 0; }));
  command.publish(turnTo(0.3, 0.5).trajectory);
  EXPECT_TRUE(stepUntil([&] { return measured.position_rad[0] > 0.3 - 1e-9; }));
}

TEST_F(UrDriverRosTest, AnswersForTheProgram) {
  EXPECT_EQ(call<ur_dashboard_msgs::GetProgramState>("ur_hardware_interface/dashboard/program_state").state.state,
            ur_dashboard_msgs::ProgramState::STOPPED);
  ur_dashboard_msgs::LoadRequest load;
  load.filename = "nothing.urp";
  EXPECT_FALSE(call<ur_dashboard_msgs::Load>("ur_hardware_interface/dashboard/load_program", load).success);
  bringUp();
  EXPECT_EQ(call<ur_dashboard_msgs::GetProgramState>("ur_hardware_interface/dashboard/program_state").state.state,
            ur_dashboard_msgs::ProgramState::PLAYING);
}

TEST_F(UrDriverRosTest, RefusesMeasurementsOfAnotherArm) {
  measured.current_A = Eigen::VectorXd::Zero(5);
  EXPECT_THROW(driver.publish(now, measured), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world_ros
