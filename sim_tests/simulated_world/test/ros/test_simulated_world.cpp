// SPDX-License-Identifier: BSD-3-Clause
// The node simulated_world as its clients see it. Every test starts a world of its own.
#include <unistd.h>
#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <thread>

#include <actionlib/client/simple_action_client.h>
#include <control_msgs/FollowJointTrajectoryAction.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <geometry_msgs/Twist.h>
#include <geometry_msgs/TwistStamped.h>
#include <geometry_msgs/WrenchStamped.h>
#include <gtest/gtest.h>
#include <interactive_mapping_msgs/PickBrickActionGoal.h>
#include <nav_msgs/Odometry.h>
#include <nlohmann/json.hpp>
#include <ros/ros.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/JointState.h>
#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <std_msgs/Bool.h>
#include <std_msgs/Header.h>
#include <std_msgs/String.h>
#include <std_srvs/Trigger.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>
#include <ur_dashboard_msgs/RobotMode.h>
#include <ur_dashboard_msgs/SafetyMode.h>
#include <ur_msgs/SetIO.h>
#include <visualization_msgs/MarkerArray.h>

#include <interactive_mapping_common/testing/process.h>
#include "simulated_world/Advance.h"
#include "simulated_world/InjectFault.h"
#include "simulated_world/JudgeState.h"
#include "simulated_world/robot_mjcf.h"
#include "simulated_world/testing/robot_in_world.h"

namespace simulated_world_ros {
namespace {

namespace fs = std::filesystem;
using control_msgs::FollowJointTrajectoryResult;
using node_tests::Process;
using FollowClient = actionlib::SimpleActionClient<control_msgs::FollowJointTrajectoryAction>;
using actionlib::SimpleClientGoalState;

constexpr double kDeadline_s = 60.0;  // wall time of every wait; a loaded machine is slow

bool waitFor(const std::function<bool()>& condition) {
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(kDeadline_s);
  while (ros::ok() && ros::WallTime::now() < end) {
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.001));
    if (condition()) {
      return true;
    }
  }
  return false;
}

/// The last message of a topic.
template <typename Message>
class Latest {
 public:
  explicit Latest(const std::string& topic)
      : subscriber_(nh_.subscribe<Message>(topic, 100, [this](const boost::shared_ptr<const Message>& message) {
          message_ = message;
          ++count;
        })) {}

  explicit operator bool() const { return message_ != nullptr; }
  const Message& operator*() const { return *message_; }
  const Message* operator->() const { return message_.get(); }
  bool isConnected() const { return subscriber_.getNumPublishers() > 0; }

  int count{0};

 private:
  ros::NodeHandle nh_;
  boost::shared_ptr<const Message> message_;
  ros::Subscriber subscriber_;
};

/// A place of the container whose brick lies along the robot, in the map.
Eigen::Vector3d containerOfRobotAt(double x_m) {
  const simulated_world::RobotMjcfOptions options;
  const simulated_world::ModelPtr model = simulated_world::compileModel(
      "<mujoco><compiler angle=\"radian\"/><worldbody>" +
      simulated_world::robotMjcfFromFile(simulated_world::descriptionFiles().urdf, options) + "</worldbody></mujoco>");
  const simulated_world::DataPtr data = simulated_world::makeData(*model);
  mj_kinematics(model.get(), data.get());
  const mjtNum* const drop = data->xpos + 3 * mj_name2id(model.get(), mjOBJ_BODY, "container_place_3");
  return {x_m + drop[0], drop[1], drop[2]};
}

class SimulatedWorldTest : public testing::Test {
 protected:
  SimulatedWorldTest() {
    std::string name = (fs::temp_directory_path() / "world_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) {
      throw std::runtime_error("no temporary folder");
    }
    folder_ = name;
    node_ = std::string("/") + testing::UnitTest::GetInstance()->current_test_info()->name();
    const simulated_world::DescriptionFiles files = simulated_world::descriptionFiles();
    set("description/urdf", files.urdf);
    set("description/base_profile", files.base_profile);
    set("description/bricks", files.bricks);
    set("description/arm_pose", files.arm_pose);
    set("scene", std::string(SIMULATED_WORLDS) + "/single_brick.yaml");
    set("clock/mode", std::string("stepped"));
    set("camera/rate_hz", 0.0);
  }

  ~SimulatedWorldTest() override {
    world_.reset();
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }

  template <typename Value>
  void set(const std::string& key, const Value& value) {
    ros::param::set(node_ + "/" + key, value);
  }

  void launch() {
    world_ = std::make_unique<Process>(std::vector<std::string>{SIMULATED_WORLD_NODE, "__name:=" + node_.substr(1)},
                                       (folder_ / "log").string());
  }

  // Starts the node and waits until it serves.
  void start() {
    launch();
    const bool is_there =
        waitFor([this] { return world_->hasEnded() || ros::service::exists(node_ + "/advance", false); });
    ASSERT_TRUE(is_there && !world_->hasEnded()) << world_->output();
  }

  void stop() {
    world_->signal(SIGINT);
    ASSERT_TRUE(waitFor([this] { return world_->hasEnded(); }));
  }

  simulated_world::Advance::Response advance(double seconds) {
    simulated_world::Advance call;
    call.request.duration_s = seconds;
    EXPECT_TRUE(ros::service::call(node_ + "/advance", call)) << world_->output();
    EXPECT_TRUE(call.response.success) << call.response.message;
    return call.response;
  }

  simulated_world::InjectFault::Response inject(const simulated_world::InjectFault::Request& request) {
    simulated_world::InjectFault call;
    call.request = request;
    EXPECT_TRUE(ros::service::call(node_ + "/inject_fault", call));
    return call.response;
  }

  simulated_world::InjectFault::Response inject(const std::string& kind, double duration_s = 0.0) {
    simulated_world::InjectFault::Request request;
    request.kind = kind;
    request.duration_s = duration_s;
    return inject(request);
  }

  static control_msgs::FollowJointTrajectoryGoal goalFor(const simulated_world::ArmVector& arm_rad, double seconds) {
    control_msgs::FollowJointTrajectoryGoal goal;
    goal.trajectory.joint_names.assign(simulated_world::kArmJoints.begin(), simulated_world::kArmJoints.end());
    trajectory_msgs::JointTrajectoryPoint point;
    point.positions.assign(arm_rad.data(), arm_rad.data() + arm_rad.size());
    point.velocities.assign(point.positions.size(), 0.0);
    point.time_from_start = ros::Duration(seconds);
    goal.trajectory.points.push_back(point);
    return goal;
  }

  // Sends a goal and waits until the server has answered, so that the clock may go on.
  static SimpleClientGoalState send(FollowClient* client, const control_msgs::FollowJointTrajectoryGoal& goal) {
    EXPECT_TRUE(waitFor([client] { return client->isServerConnected(); }));
    client->sendGoal(goal);
    EXPECT_TRUE(waitFor([client] { return client->getState() != SimpleClientGoalState::PENDING; }));
    return client->getState();
  }

  // Runs the world until the goal has ended.
  SimpleClientGoalState finish(FollowClient* client, double at_most_s) {
    for (double waited_s = 0.0; waited_s < at_most_s && !client->getState().isDone(); waited_s += 0.1) {
      advance(0.1);
      waitFor([this, client] { return client->getState().isDone() || settled(); });
    }
    return client->getState();
  }

  // Everything that was sent before this call has been received: a round trip through the node.
  bool settled() {
    simulated_world::Advance nothing;
    nothing.request.duration_s = -1.0;
    ros::service::call(node_ + "/advance", nothing);
    ros::spinOnce();
    return true;
  }

  fs::path folder_;
  std::string node_;
  std::unique_ptr<Process> world_;
  ros::NodeHandle nh_;
};

TEST_F(SimulatedWorldTest, StandsWhereTheDriversStand) {
  set("camera/rate_hz", 5.0);
  start();
  const Latest<sensor_msgs::JointState> joints("joint_states");
  const Latest<sensor_msgs::JointState> wheels("drives/joint_states");
  const Latest<nav_msgs::Odometry> odometry("odom");
  const Latest<sensor_msgs::LaserScan> scan("lidar_1/scan");
  const Latest<sensor_msgs::Image> color("camera/color/image_raw");
  const Latest<sensor_msgs::Image> depth("camera/aligned_depth_to_color/image_raw");
  const Latest<sensor_msgs::CameraInfo> info("camera/aligned_depth_to_color/camera_info");
  const Latest<geometry_msgs::WrenchStamped> wrench("wrench");
  const Latest<std_msgs::Bool> running("ur_hardware_interface/robot_program_running");
  const Latest<ur_dashboard_msgs::RobotMode> robot_mode("ur_hardware_interface/robot_mode");
  const Latest<ur_dashboard_msgs::SafetyMode> safety_mode("ur_hardware_interface/safety_mode");
  const Latest<tf2_msgs::TFMessage> transforms("/tf");  // by the connection that the listener has, too
  tf2_ros::Buffer tf;
  const tf2_ros::TransformListener listener(tf, nh_, false);
  ASSERT_TRUE(waitFor([&] {
    return transforms.isConnected() && joints.isConnected() && wheels.isConnected() && odometry.isConnected() &&
           scan.isConnected() && color.isConnected() && depth.isConnected() && info.isConnected() &&
           wrench.isConnected();
  }));
  const ros::Time now = advance(0.5).now;
  ASSERT_TRUE(waitFor([&] {
    return joints && wheels && odometry && scan && color && depth && info && wrench && running && robot_mode &&
           safety_mode && tf.canTransform("map", "base_link", ros::Time(0)) &&
           tf.canTransform("ur5e_base", "ur5e_tool0_controller", ros::Time(0));
  }));
  EXPECT_EQ(joints->name, (std::vector<std::string>{"elbow_joint", "shoulder_lift_joint", "shoulder_pan_joint",
                                                    "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"}));
  ASSERT_TRUE(waitFor([&] { return joints->header.stamp == now && odometry->header.stamp == now; }));
  EXPECT_NEAR(joints->position[0], 2.4, 1e-3) << "elbow of the stowed arm";
  EXPECT_EQ(wheels->name.size(), 2U);
  EXPECT_EQ(odometry->header.frame_id, "odom");
  EXPECT_EQ(odometry->child_frame_id, "base_link");
  EXPECT_EQ(scan->header.frame_id, "lidar_1_link");
  EXPECT_EQ(scan->ranges.size(), 381U);
  EXPECT_EQ(color->encoding, "rgb8");
  EXPECT_EQ(depth->encoding, "16UC1");
  EXPECT_EQ(depth->header.frame_id, "camera_color_optical_frame");
  EXPECT_EQ(depth->header.stamp, color->header.stamp);
  EXPECT_EQ(info->width, 640U);
  EXPECT_EQ(info->K[0], 525.0);
  EXPECT_TRUE(running->data);
  EXPECT_EQ(static_cast<int>(robot_mode->mode), static_cast<int>(ur_dashboard_msgs::RobotMode::RUNNING));
  EXPECT_EQ(static_cast<int>(safety_mode->mode), static_cast<int>(ur_dashboard_msgs::SafetyMode::NORMAL));
  EXPECT_EQ(wrench->header.frame_id, "ur5e_tool0_controller");
  EXPECT_NEAR(tf.lookupTransform("map", "base_link", ros::Time(0)).transform.translation.x, -3.0, 1e-3);
}

TEST_F(SimulatedWorldTest, SteppedClockGoesOnlyWhenAsked) {
  start();
  const ros::Time begin = advance(0.025).now;
  EXPECT_EQ(begin, ros::Time(10.03)) << "rounded up to whole ticks";
  for (const double impossible : {0.0, -1.0, 1e4, std::nan("")}) {
    simulated_world::Advance call;
    call.request.duration_s = impossible;
    ASSERT_TRUE(ros::service::call(node_ + "/advance", call));
    EXPECT_FALSE(call.response.success) << impossible;
    EXPECT_NE(call.response.message.find("must be in (0, 600] s"), std::string::npos) << call.response.message;
    EXPECT_EQ(call.response.now, begin);
  }
}

TEST_F(SimulatedWorldTest, ArmFollowsATrajectory) {
  start();
  FollowClient client("scaled_pos_joint_traj_controller/follow_joint_trajectory", false);
  const Latest<sensor_msgs::JointState> joints("joint_states");
  simulated_world::ArmVector goal;
  goal << 0.5, -1.5, 1.8, -1.8, -1.5, 0.3;
  ASSERT_EQ(send(&client, goalFor(goal, 2.0)), SimpleClientGoalState::ACTIVE);
  EXPECT_EQ(finish(&client, 4.0), SimpleClientGoalState::SUCCEEDED) << client.getResult()->error_string;
  ASSERT_TRUE(waitFor([&] { return joints && std::abs(joints->position[2] - 0.5) < 1e-3; })) << "the pan is third";
  EXPECT_NEAR(joints->position[0], 1.8, 1e-3);
}

TEST_F(SimulatedWorldTest, ArmRefusesWhatTheDriverWouldRefuse) {
  start();
  FollowClient client("scaled_pos_joint_traj_controller/follow_joint_trajectory", false);
  simulated_world::ArmVector stowed;
  stowed << 0.0, -2.0, 2.4, -1.97, -1.57, 0.0;
  control_msgs::FollowJointTrajectoryGoal unknown = goalFor(stowed, 2.0);
  unknown.trajectory.joint_names[2] = "knee_joint";
  EXPECT_EQ(send(&client, unknown), SimpleClientGoalState::REJECTED);
  EXPECT_EQ(client.getResult()->error_code, FollowJointTrajectoryResult::INVALID_JOINTS);
  EXPECT_NE(client.getResult()->error_string.find("knee_joint"), std::string::npos);

  simulated_world::ArmVector beyond = stowed;
  beyond[2] = 3.5;  // the elbow's limit is pi
  EXPECT_EQ(send(&client, goalFor(beyond, 2.0)), SimpleClientGoalState::REJECTED);
  EXPECT_EQ(client.getResult()->error_code, FollowJointTrajectoryResult::INVALID_GOAL);
  EXPECT_NE(client.getResult()->error_string.find("elbow_joint"), std::string::npos)
      << client.getResult()->error_string;

  simulated_world::ArmVector far = stowed;
  far[0] = 3.0;
  EXPECT_EQ(send(&client, goalFor(far, 0.2)), SimpleClientGoalState::REJECTED) << "15 rad/s";
}

TEST_F(SimulatedWorldTest, BaseFollowsVelocityCommands) {
  start();
  const Latest<geometry_msgs::TwistStamped> taken(node_ + "/command_taken");
  const Latest<nav_msgs::Odometry> odometry("odom");
  ros::Publisher publisher = nh_.advertise<geometry_msgs::Twist>("cmd_vel", 10);
  ASSERT_TRUE(
      waitFor([&] { return publisher.getNumSubscribers() > 0 && taken.isConnected() && odometry.isConnected(); }));
  geometry_msgs::Twist command;
  command.linear.x = 0.4;
  for (int i = 1; i <= 4; ++i) {
    publisher.publish(command);
    ASSERT_TRUE(waitFor([&] { return taken.count == i; }));
    advance(0.5);
  }
  // v t - v^2 / 2a
  const double expected_m = 0.4 * 2.0 - 0.4 * 0.4 / (2 * 2.4);
  ASSERT_TRUE(waitFor([&] { return odometry && std::abs(odometry->pose.pose.position.x - expected_m) < 0.003; }))
      << odometry->pose.pose.position.x << ", not " << expected_m;
  command.linear.x = std::nan("");
  publisher.publish(command);
  command.linear.x = 0.0;
  publisher.publish(command);
  ASSERT_TRUE(waitFor([&] { return taken.count == 5; })) << "the one that is not finite was not taken";
  advance(1.0);
  ASSERT_TRUE(waitFor([&] { return std::abs(odometry->twist.twist.linear.x) < 1e-9; }));
}

TEST_F(SimulatedWorldTest, PicksABrickThroughTheDrivers) {
  set("judge/pick_action", std::string("/bridge/pick"));
  start();
  const Latest<simulated_world::JudgeState> judge(node_ + "/judge");
  const Latest<std_msgs::String> incidents(node_ + "/incidents");
  ros::Publisher target = nh_.advertise<interactive_mapping_msgs::PickBrickActionGoal>("/bridge/pick/goal", 1, true);
  FollowClient client("scaled_pos_joint_traj_controller/follow_joint_trajectory", false);
  simulated_world::RobotMjcfOptions options;
  const std::string mjcf = "<mujoco><compiler angle=\"radian\"/><worldbody>" +
                           simulated_world::robotMjcfFromFile(simulated_world::descriptionFiles().urdf, options) +
                           "</worldbody></mujoco>";
  const simulated_world::ModelPtr model = simulated_world::compileModel(mjcf);
  simulated_world::ToolDown tool(*model);
  const auto move = [&](const simulated_world::ArmVector& goal, double seconds) {
    EXPECT_EQ(send(&client, goalFor(goal, seconds)), SimpleClientGoalState::ACTIVE);
    EXPECT_EQ(finish(&client, seconds + 2.0), SimpleClientGoalState::SUCCEEDED) << client.getResult()->error_string;
  };
  const auto magnet = [](bool is_on) {
    ur_msgs::SetIO io;
    io.request.fun = ur_msgs::SetIO::Request::FUN_SET_DIGITAL_OUT;
    io.request.pin = 0;
    io.request.state = is_on ? 1.0F : 0.0F;
    return ros::service::call("ur_hardware_interface/set_io", io) && io.response.success;
  };
  ASSERT_TRUE(
      waitFor([&] { return target.getNumSubscribers() > 0 && judge.isConnected() && incidents.isConnected(); }));

  // A brick under the tool, which is where the robot stands (-3, 0) and 0.75 m before its axle.
  const Eigen::Vector3d tip = tool.tip(tool.angles(0.75, 0.3));
  simulated_world::InjectFault::Request there;
  there.kind = "move_brick";
  there.brick_id = 0;
  there.pose.position.x = -3.0 + tip.x();
  there.pose.position.y = tip.y();
  there.pose.position.z = 0.1;
  there.pose.orientation.w = 1.0;
  ASSERT_TRUE(inject(there).success);
  interactive_mapping_msgs::PickBrickActionGoal goal;
  goal.goal.brick_id = 0;
  target.publish(goal);
  advance(3.0);

  move(tool.angles(0.75, 0.3), 2.5);
  move(tool.angles(0.75, 0.1995), 2.0);
  ASSERT_TRUE(magnet(true));
  advance(0.2);
  move(tool.angles(0.75, 0.9), 3.0);
  const Eigen::Vector3d over = tool.tip(tool.angles(0.68, 0.85));
  move(tool.angles(0.68, 0.85, -M_PI - std::atan2(over.y(), over.x() - 0.186)), 5.0);
  ASSERT_TRUE(magnet(false));
  advance(2.0);
  ASSERT_TRUE(waitFor([&] { return judge && judge->stowed == 1; })) << world_->output();
  EXPECT_EQ(judge->bricks_total, 1);
  EXPECT_EQ(judge->falls, 0);
  EXPECT_EQ(judge->drops, 0);
  EXPECT_EQ(judge->collisions, 0) << world_->output();
  EXPECT_GT(incidents.count, 0);
}

TEST_F(SimulatedWorldTest, FaultsComeOnCommand) {
  start();
  const simulated_world::InjectFault::Response unknown = inject("earthquake");
  EXPECT_FALSE(unknown.success);
  EXPECT_NE(unknown.message.find("must be one of protective_stop"), std::string::npos) << unknown.message;
  simulated_world::InjectFault::Request nowhere;
  nowhere.kind = "move_brick";
  nowhere.brick_id = 0;  // and a pose whose quaternion is zero
  EXPECT_FALSE(inject(nowhere).success);

  const Latest<ur_dashboard_msgs::SafetyMode> safety_mode("ur_hardware_interface/safety_mode");
  const Latest<std_msgs::Bool> running("ur_hardware_interface/robot_program_running");
  FollowClient client("scaled_pos_joint_traj_controller/follow_joint_trajectory", false);
  simulated_world::ArmVector goal;
  goal << 0.5, -1.5, 1.8, -1.8, -1.5, 0.3;
  ASSERT_EQ(send(&client, goalFor(goal, 4.0)), SimpleClientGoalState::ACTIVE);
  advance(1.0);
  ASSERT_TRUE(inject("protective_stop").success);
  EXPECT_EQ(finish(&client, 2.0), SimpleClientGoalState::ABORTED);
  ASSERT_TRUE(
      waitFor([&] { return safety_mode && safety_mode->mode == ur_dashboard_msgs::SafetyMode::PROTECTIVE_STOP; }));
  ASSERT_TRUE(waitFor([&] { return running && !running->data; }));
  advance(5.1);
  std_srvs::Trigger trigger;
  ASSERT_TRUE(ros::service::call("ur_hardware_interface/dashboard/unlock_protective_stop", trigger));
  ASSERT_TRUE(trigger.response.success) << trigger.response.message;
  advance(0.1);
  ASSERT_TRUE(ros::service::call("ur_hardware_interface/dashboard/play", trigger));
  ASSERT_TRUE(trigger.response.success) << trigger.response.message;
  advance(0.5);
  ASSERT_TRUE(waitFor([&] { return running->data; }));
  ASSERT_EQ(send(&client, goalFor(goal, 3.0)), SimpleClientGoalState::ACTIVE);
  EXPECT_EQ(finish(&client, 5.0), SimpleClientGoalState::SUCCEEDED);
}

TEST_F(SimulatedWorldTest, BaseScannerAndLocalisationGoSilentEachForItself) {
  start();
  const Latest<sensor_msgs::JointState> wheels("drives/joint_states");
  const Latest<nav_msgs::Odometry> odometry("odom");
  const Latest<sensor_msgs::LaserScan> scan("lidar_1/scan");
  const Latest<visualization_msgs::MarkerArray> truth(node_ + "/truth");
  const Latest<tf2_msgs::TFMessage> transforms("/tf");
  // The clock of the world before showed a later time: tf's buffer would forget all when it hears of this one's.
  ros::Time now = advance(0.1).now;
  ASSERT_TRUE(waitFor([&] { return ros::Time::now() == now; }));
  tf2_ros::Buffer tf;
  const tf2_ros::TransformListener listener(tf, nh_, false);
  const auto latest = [&tf](const char* parent, const char* child) {
    return tf.canTransform(parent, child, ros::Time(0)) ? tf.lookupTransform(parent, child, ros::Time(0)).header.stamp
                                                        : ros::Time(0);
  };
  ASSERT_TRUE(waitFor([&] {
    return transforms.isConnected() && wheels.isConnected() && odometry.isConnected() && scan.isConnected() &&
           truth.isConnected();
  }));
  now = advance(0.5).now;
  ASSERT_TRUE(waitFor([&] { return odometry && odometry->header.stamp == now && latest("map", "odom") == now; }));

  ASSERT_TRUE(inject("odometry_gone", 0.5).success);
  const ros::Time silent_since = now;
  now = advance(0.4).now;
  ASSERT_TRUE(waitFor([&] { return latest("map", "odom") == now && scan->header.stamp > silent_since; }));
  EXPECT_EQ(odometry->header.stamp, silent_since);
  EXPECT_LE(wheels->header.stamp, silent_since);
  EXPECT_EQ(latest("odom", "base_link"), silent_since);

  now = advance(0.2).now;
  ASSERT_TRUE(waitFor([&] { return odometry->header.stamp == now && wheels->header.stamp > silent_since; }));
  ASSERT_TRUE(inject("localisation_gone", 1.0).success);
  ASSERT_TRUE(inject("scanner_gone", 1.0).success);
  const ros::Time since = now;
  now = advance(0.9).now;
  ASSERT_TRUE(waitFor([&] { return odometry->header.stamp == now && latest("odom", "base_link") == now; }));
  EXPECT_EQ(latest("map", "odom"), since);
  EXPECT_LE(scan->header.stamp, since);

  simulated_world::InjectFault::Request obstacle;
  obstacle.kind = "obstacle";
  EXPECT_FALSE(inject(obstacle).success) << "a quaternion of zero";
  obstacle.pose.orientation.w = 1.0;
  obstacle.pose.position.x = 1.5;
  ASSERT_TRUE(inject(obstacle).success);
  advance(0.2);
  EXPECT_TRUE(waitFor([&] {
    return truth && std::any_of(truth->markers.begin(), truth->markers.end(), [](const auto& marker) {
             return marker.ns == "obstacles" && marker.pose.position.x == 1.5;
           });
  }));
  obstacle.pose.position.x = -3.0;  // where the robot stands
  const simulated_world::InjectFault::Response refused = inject(obstacle);
  EXPECT_FALSE(refused.success);
  EXPECT_NE(refused.message.find("must be free"), std::string::npos) << refused.message;
}

TEST_F(SimulatedWorldTest, ImagesOnDemandWhileTheCameraIsThere) {
  start();
  const Latest<sensor_msgs::Image> depth("camera/aligned_depth_to_color/image_raw");
  ASSERT_TRUE(waitFor([&] { return depth.isConnected(); }));
  advance(1.0);
  std_srvs::Trigger capture;
  ASSERT_TRUE(ros::service::call("camera/capture", capture));
  ASSERT_TRUE(capture.response.success);
  advance(0.1);
  ASSERT_TRUE(waitFor([&] { return depth.count == 1; }));
  ASSERT_TRUE(inject("camera_gone", 1.0).success);
  advance(0.1);
  ASSERT_TRUE(ros::service::call("camera/capture", capture));
  EXPECT_FALSE(capture.response.success);
  EXPECT_NE(capture.response.message.find("gone"), std::string::npos);
  advance(1.0);
  ASSERT_TRUE(ros::service::call("camera/capture", capture));
  EXPECT_TRUE(capture.response.success);
}

// A cloud on the faces of the brick that can be seen, in steps of 1 cm.
sensor_msgs::PointCloud2 cloudOfSingleBrick(const ros::Time& stamp) {
  std::vector<Eigen::Vector3f> points;
  for (float a = -0.15F; a <= 0.1501F; a += 0.01F) {
    for (float b = 0.0F; b <= 0.2001F; b += 0.01F) {
      points.emplace_back(a, b - 0.1F, 0.2F);
      points.emplace_back(a, -0.1F, b);
      points.emplace_back(a, 0.1F, b);
    }
  }
  for (float a = -0.1F; a <= 0.1001F; a += 0.01F) {
    for (float b = 0.0F; b <= 0.2001F; b += 0.01F) {
      points.emplace_back(-0.15F, a, b);
      points.emplace_back(0.15F, a, b);
    }
  }
  sensor_msgs::PointCloud2 cloud;
  cloud.header.frame_id = "map";
  cloud.header.stamp = stamp;
  sensor_msgs::PointCloud2Modifier modifier(cloud);
  modifier.setPointCloud2FieldsByString(1, "xyz");
  modifier.resize(points.size());
  sensor_msgs::PointCloud2Iterator<float> out(cloud, "x");
  for (const Eigen::Vector3f& point : points) {
    std::copy_n(point.data(), 3, &out[0]);
    ++out;
  }
  return cloud;
}

// Whoever else looks at the images: the first one is for the node that has to answer it.
TEST_F(SimulatedWorldTest, ClockBeginsWhenTheNamedSubscriberHearsTheImages) {
  set("clock/mode", std::string("lockstep"));
  set("camera/rate_hz", 5.0);
  XmlRpc::XmlRpcValue rules;
  rules[0]["topic"] = std::string("/answer");
  rules[0]["after"] = std::string("image");
  rules[0]["subscriber"] = std::string("/hearer");
  ros::param::set(node_ + "/clock/wait_for", rules);
  const ros::Publisher answer = ros::NodeHandle().advertise<std_msgs::Header>("/answer", 1);
  const Latest<sensor_msgs::Image> depth("camera/aligned_depth_to_color/image_raw");
  int reports_while_connected = 0;
  const ros::Subscriber diagnostics = ros::NodeHandle().subscribe<diagnostic_msgs::DiagnosticArray>(
      "/diagnostics", 10, [&](const diagnostic_msgs::DiagnosticArray::ConstPtr&) {
        reports_while_connected += depth.isConnected() && answer.getNumSubscribers() > 0 ? 1 : 0;
      });
  start();
  // The world reports once a second of wall time; with us alone at its camera it does not go on meanwhile.
  ASSERT_TRUE(waitFor([&] { return reports_while_connected >= 2; }));
  EXPECT_EQ(depth.count, 0);
  const Process hearer(
      {"rosrun", "topic_tools", "relay", "camera/aligned_depth_to_color/image_raw", "elsewhere", "__name:=hearer"},
      (folder_ / "hearer").string());
  EXPECT_TRUE(waitFor([&] { return depth.count == 1; }));
}

TEST_F(SimulatedWorldTest, JudgeComparesTheStrategysSurface) {
  set("judge/surface_topic", std::string("/surface"));
  start();
  const Latest<simulated_world::JudgeState> judge(node_ + "/judge");
  ros::Publisher surface = nh_.advertise<sensor_msgs::PointCloud2>("/surface", 10);
  ASSERT_TRUE(waitFor([&] { return surface.getNumSubscribers() > 0 && judge.isConnected(); }));
  const ros::Time now = advance(1.0).now;
  sensor_msgs::PointCloud2 cloud = cloudOfSingleBrick(now);
  cloud.header.frame_id = "odom";
  surface.publish(cloud);
  cloud.header.frame_id = "map";
  for (std::size_t i = 0; i < 3; ++i) {
    advance(0.5);
  }
  ASSERT_TRUE(waitFor([&] { return judge && judge->header.stamp > now; }));
  EXPECT_FALSE(judge->coverage > 0.0) << "of another frame";
  surface.publish(cloud);
  ASSERT_TRUE(waitFor([&] {
    advance(0.5);
    return judge->coverage > 0.0;
  }));
  EXPECT_GT(judge->coverage, 0.98);
  EXPECT_GT(judge->precision, 0.98);
  stop();
  EXPECT_NE(world_->output().find("frame 'odom', must be 'map'"), std::string::npos) << world_->output();
}

TEST_F(SimulatedWorldTest, LeavesItsRunInAFolder) {
  const fs::path run = folder_ / "run";
  set("judge/run_folder", run.string());
  set("judge/pictures", true);
  start();
  advance(2.0);
  // A brick stowed by hand: put into the container of the robot, which stands at (-3, 0).
  simulated_world::InjectFault::Request into_container;
  into_container.kind = "move_brick";
  into_container.brick_id = 0;
  const Eigen::Vector3d container = containerOfRobotAt(-3.0);
  into_container.pose.position.x = container.x();
  into_container.pose.position.y = container.y();
  into_container.pose.position.z = container.z() + 0.05;
  into_container.pose.orientation.w = 1.0;
  ASSERT_TRUE(inject(into_container).success);
  advance(4.0);
  stop();
  EXPECT_EQ(world_->exitCode(), 0) << world_->output();
  std::ifstream report_file(run / "judge.json");
  ASSERT_TRUE(report_file.good());
  const nlohmann::json report = nlohmann::json::parse(report_file);
  EXPECT_EQ(report.at("bricks_total"), 1);
  EXPECT_TRUE(fs::exists(run / "judge.csv"));
  EXPECT_EQ(report.at("stowed"), 1) << world_->output();
  std::vector<std::string> pictures;
  for (const fs::directory_entry& entry : fs::directory_iterator(run / "pictures")) {
    pictures.push_back(entry.path().filename().string());
  }
  std::sort(pictures.begin(), pictures.end());
  ASSERT_EQ(pictures.size(), 3U) << "at the start, after the brick, at the end";
  EXPECT_EQ(pictures[0], "world_00010.000_000.png");
  EXPECT_EQ(pictures[1].substr(pictures[1].size() - 8), "_001.png");
  EXPECT_EQ(pictures[2], "world_00016.000_001.png");
  launch();
  ASSERT_TRUE(waitFor([this] { return world_->hasEnded(); }));
  EXPECT_EQ(world_->exitCode(), 1) << "an earlier run is not written over";
  EXPECT_NE(world_->output().find(run.string()), std::string::npos) << world_->output();
}

TEST_F(SimulatedWorldTest, ImpossibleParametersStopTheNode) {
  set("clock/mode", std::string("fast"));
  set("camera/rate_hz", -1.0);
  set("magnet/radius_m", std::string("big"));
  set("physics/timestep_s", 0.5);
  set("gravity", 9.0);
  set("base/traction_N", -5.0);
  set("judge/surface_topic", std::string("no topic"));
  set("judge/pick_action", std::string("no action"));
  XmlRpc::XmlRpcValue rules;
  rules[0]["topic"] = "no topic";
  rules[0]["after"] = "dawn";
  rules[0]["cost_s"] = 61.0;
  rules[0]["colour"] = "red";
  rules[1]["topic"] = "/answer";
  rules[1]["after"] = "action_result";
  rules[1]["subscriber"] = "/hearer";
  rules[2] = "/answer";
  ros::param::set(node_ + "/clock/wait_for", rules);
  XmlRpc::XmlRpcValue computing;
  computing[0]["cost_s"] = "1";
  ros::param::set(node_ + "/clock/computing", computing);
  launch();
  ASSERT_TRUE(waitFor([this] { return world_->hasEnded(); }));
  EXPECT_EQ(world_->exitCode(), 1);
  const std::string output = world_->output();
  for (const char* words :
       {"clock/mode = 'fast', must be one of lockstep, realtime, stepped", "camera/rate_hz = -1", "magnet/radius_m",
        "physics/timestep_s = 0.5", "gravity", "base/traction_N = -5", "judge/surface_topic = 'no topic'",
        "judge/pick_action = 'no action'", "clock/wait_for[0]/topic = 'no topic', must be a name",
        "clock/wait_for[0]/after = 'dawn', must be one of image, odometry, joint_states, scan",
        "clock/wait_for[0]/cost_s = 61 s, must be in [0, 60] s",
        "clock/wait_for[0]/colour is unknown; known here: after, cost_s, subscriber, topic, while",
        "clock/wait_for[1]/subscriber = '/hearer' after action_result, must be after image",
        "clock/wait_for[2] = '/answer', must be a section with keys",
        "clock/computing[0]/action is empty, must be given", "clock/computing[0]/cost_s = '1', must be a number"}) {
    EXPECT_NE(output.find(words), std::string::npos) << words << " is not in:\n" << output;
  }
}

TEST_F(SimulatedWorldTest, ImpossibleSceneStopsTheNode) {
  const fs::path scene = folder_ / "near.yaml";
  std::ofstream(scene) << "brick_type: brick\nrobot_start: {xy_m: [-1.0, 0.0], yaw_rad: 0.0}\n"
                          "bricks:\n  - {id: 0, xyz_m: [0.0, 0.0, 0.1]}\n  - {id: 1, xyz_m: [0.05, 0.0, 0.1]}\n";
  set("scene", scene.string());
  launch();
  ASSERT_TRUE(waitFor([this] { return world_->hasEnded(); }));
  EXPECT_EQ(world_->exitCode(), 1);
  EXPECT_NE(world_->output().find("overlap"), std::string::npos) << world_->output();
  EXPECT_NE(world_->output().find("2.5"), std::string::npos) << world_->output();
}

// One run in lock step: the client answers every image, and commands at some of them before it does. Returns the
// judge's digests by time.
class LockstepTest : public SimulatedWorldTest {
 protected:
  std::map<double, std::string> runOnce(int seed) {
    set("seed", seed);
    const fs::path scene = folder_ / "pyramid.yaml";
    std::ofstream(scene) << "brick_type: brick\nrobot_start: {xy_m: [-3.0, 0.0], yaw_rad: 0.0}\n"
                            "position_jitter_m: 0.02\nyaw_jitter_rad: 0.05\nbricks:\n"
                            "  - {id: 0, xyz_m: [0.0, -0.16, 0.1]}\n  - {id: 1, xyz_m: [0.0, 0.16, 0.1]}\n"
                            "  - {id: 2, xyz_m: [0.0, 0.0, 0.3], yaw_rad: 1.5708}\n";
    set("scene", scene.string());
    set("clock/mode", std::string("lockstep"));
    set("camera/rate_hz", 5.0);
    set("base/odometry_walk_m_per_sqrt_m", 0.01);
    XmlRpc::XmlRpcValue rules;
    rules[0]["topic"] = "/answer";
    rules[0]["after"] = "image";
    ros::param::set(node_ + "/clock/wait_for", rules);

    std::map<double, std::string> digests;
    ros::Subscriber judge = nh_.subscribe<simulated_world::JudgeState>(
        node_ + "/judge", 1000, [&digests](const simulated_world::JudgeState::ConstPtr& state) {
          digests[state->header.stamp.toSec()] = state->digest;
        });
    const Latest<sensor_msgs::Image> image("camera/aligned_depth_to_color/image_raw");
    const Latest<geometry_msgs::TwistStamped> taken(node_ + "/command_taken");
    ros::Publisher cmd_vel = nh_.advertise<geometry_msgs::Twist>("cmd_vel", 10);
    FollowClient client("scaled_pos_joint_traj_controller/follow_joint_trajectory", false);
    start();
    EXPECT_TRUE(waitFor([&] {
      return image.isConnected() && taken.isConnected() && cmd_vel.getNumSubscribers() > 0 &&
             judge.getNumPublishers() > 0;
    }));
    // The clock begins with the one who answers.
    ros::Publisher answer = nh_.advertise<std_msgs::Header>("/answer", 10);
    EXPECT_TRUE(waitFor([&] { return answer.getNumSubscribers() > 0; }));
    constexpr int kImages = 20;
    for (int i = 1; i <= kImages; ++i) {
      if (!waitFor([&] { return image.count == i; })) {
        ADD_FAILURE() << "image " << i << " did not come: " << world_->output();
        break;
      }
      EXPECT_EQ(std::lround(image->header.stamp.toSec() * 100.0), 1000 + 20 * i) << "the clock waits at each image";
      if (i == 3) {
        simulated_world::ArmVector goal;
        goal << 0.5, -1.5, 1.8, -1.8, -1.5, 0.3;
        EXPECT_EQ(send(&client, goalFor(goal, 2.0)), SimpleClientGoalState::ACTIVE);
      }
      if (i >= 5) {
        geometry_msgs::Twist command;
        command.linear.x = 0.3;
        command.angular.z = 0.05 * i;
        const int before = taken.count;
        cmd_vel.publish(command);
        EXPECT_TRUE(waitFor([&] { return taken.count > before; }));
      }
      std_msgs::Header header;
      header.stamp = image->header.stamp;
      answer.publish(header);
    }
    EXPECT_TRUE(waitFor([&] { return !digests.empty() && digests.rbegin()->first >= 13.99; }));
    world_.reset();
    return digests;
  }
};

TEST_F(LockstepTest, RunsOfOneSeedAreEqualWhateverTheLoad) {
  const std::map<double, std::string> idle = runOnce(1);
  std::map<double, std::string> busy;
  {
    std::atomic<bool> is_over{false};
    std::vector<std::thread> load;
    for (unsigned i = 0; i < std::max(1U, std::thread::hardware_concurrency()); ++i) {
      load.emplace_back([&is_over] {
        double x = 1.0;
        while (!is_over) {
          x = std::sin(x) + 1.0;
        }
      });
    }
    busy = runOnce(1);
    is_over = true;
    for (std::thread& thread : load) {
      thread.join();
    }
  }
  ASSERT_GE(idle.size(), 8U);
  EXPECT_EQ(idle, busy);
  const std::map<double, std::string> other = runOnce(2);
  EXPECT_NE(idle.rbegin()->second, other.rbegin()->second) << "another seed, another pile";
}

}  // namespace
}  // namespace simulated_world_ros
