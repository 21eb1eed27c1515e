// SPDX-License-Identifier: BSD-3-Clause
// What the tests of node ur_driver_bridge share: the simulated arm, a brick before it, trajectories made by hand, and a
// mission's heartbeat. The world goes on only while a test lets it: each odometry waits for the test's answer, so that
// faults begin and goals are sent at a known step.
#pragma once

#include <cmath>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <actionlib/client/action_client.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include <interactive_mapping_msgs/ArmBridgeState.h>
#include <interactive_mapping_msgs/ArmOutcome.h>
#include <interactive_mapping_msgs/AttachedBrick.h>
#include <interactive_mapping_msgs/LetGoBrickAction.h>
#include <interactive_mapping_msgs/MoveArmAction.h>
#include <interactive_mapping_msgs/PathMonitorState.h>
#include <interactive_mapping_msgs/PickBrickAction.h>
#include <interactive_mapping_msgs/RecoverArmAction.h>
#include <interactive_mapping_msgs/WatchTrajectory.h>
#include <motion_planning/joint_trajectory.h>
#include <motion_planning_ros/conversions.h>
#include <mp700_ur5e_description/robot_names.h>
#include <nav_msgs/Odometry.h>
#include <sensor_msgs/JointState.h>
#include <std_msgs/Header.h>
#include <std_msgs/Int32.h>
#include <std_msgs/String.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>
#include <ur_msgs/SetSpeedSliderFraction.h>

#include "simulated_world/InjectFault.h"
#include "simulated_world/JudgeState.h"

namespace integration_tests {

using node_tests::call;
using node_tests::has;
using node_tests::waitUntil;

using interactive_mapping_msgs::ArmBridgeState;
using interactive_mapping_msgs::ArmOutcome;
using interactive_mapping_msgs::LetGoBrickAction;
using interactive_mapping_msgs::MoveArmAction;
using interactive_mapping_msgs::PickBrickAction;
using interactive_mapping_msgs::RecoverArmAction;
using motion_planning::ArmVector;
using motion_planning::JointTrajectory;

// Wall time that a busy machine may take for what the simulated time limits, which is the one that tells.
constexpr double kWall_s = 300.0;
constexpr double kHeartbeat_s = 0.05;
constexpr double kJointStatePeriod_s = 0.01;  // of the simulated driver

/// An action of the bridge: one goal at a time.
template <typename Action>
class BridgeAction {
 public:
  using Client = actionlib::ActionClient<Action>;
  using Goal = typename Action::_action_goal_type::_goal_type;
  using Result = typename Action::_action_result_type::_result_type;

  explicit BridgeAction(const std::string& name) : client_("/ur_driver_bridge/" + name) {}
  bool isConnected() { return client_.isServerConnected(); }
  /// The world stands still meanwhile: the next step begins the goal.
  void send(const Goal& goal) {
    handle_ = client_.sendGoal(goal);
    EXPECT_TRUE(waitUntil([this] { return handle_.getCommState() != actionlib::CommState::WAITING_FOR_GOAL_ACK; }))
        << "nobody takes the goal";
  }
  void cancel() { handle_.cancel(); }
  bool isDone() { return !handle_.isExpired() && handle_.getCommState() == actionlib::CommState::DONE; }
  bool isOpen() { return !handle_.isExpired() && handle_.getCommState() != actionlib::CommState::DONE; }
  Result result() {
    const auto result = handle_.getResult();
    return result ? *result : Result();
  }

 private:
  Client client_;
  typename Client::GoalHandle handle_;
};

class BridgeWorld {
 public:
  BridgeWorld() : move("move"), pick("pick"), let_go("let_go"), recover("recover") {
    odometry_ = nh_.subscribe<nav_msgs::Odometry>(
        "/odom", 200, [this](const nav_msgs::Odometry::ConstPtr& message) { steps_.push_back(message->header); });
    subscribers_.push_back(nh_.subscribe("/joint_states", 200, &BridgeWorld::onJoints, this));
    subscribers_.push_back(nh_.subscribe<ArmBridgeState>(
        "/ur_driver_bridge/state", 100, [this](const ArmBridgeState::ConstPtr& message) { state = *message; }));
    subscribers_.push_back(nh_.subscribe<simulated_world::JudgeState>(
        "/simulated_world/judge", 100,
        [this](const simulated_world::JudgeState::ConstPtr& message) { judge = *message; }));
    subscribers_.push_back(nh_.subscribe<interactive_mapping_msgs::AttachedBrick>(
        "/attached_brick", 10,
        [this](const interactive_mapping_msgs::AttachedBrick::ConstPtr& message) { attached = *message; }));
    subscribers_.push_back(nh_.subscribe<std_msgs::String>(
        "/simulated_world/incidents", 100,
        [this](const std_msgs::String::ConstPtr& message) { incidents += message->data + "\n"; }));
    heartbeat_ = nh_.advertise<std_msgs::Header>("/pick_mission/heartbeat", 10);
    target_ = nh_.advertise<std_msgs::Int32>("/simulated_world/target", 1, true);
    watch_server_ = nh_.advertiseService("/motion_planning/watch", &BridgeWorld::onWatch, this);
    monitor_ = nh_.advertise<interactive_mapping_msgs::PathMonitorState>("/motion_planning/path_monitor", 10, true);
    std::string urdf;
    if (nh_.getParam("/robot_description", urdf)) {
      arm_ = std::make_shared<motion_planning::ArmKinematics>(
          mp700_ur5e_description::RobotModel::parse(urdf, "/robot_description"));
    }
  }

  /// Begins the world's time, which waits for whoever answers the steps. False if a node does not come up.
  bool begin() {
    const bool is_connected = arm_ && waitUntil(
                                          [this] {
                                            return odometry_.getNumPublishers() > 0 && move.isConnected() &&
                                                   pick.isConnected() && let_go.isConnected() &&
                                                   recover.isConnected() && judge.bricks_total > 0 &&
                                                   heartbeat_.getNumSubscribers() > 0;
                                          },
                                          60.0);
    answer_ = nh_.advertise<std_msgs::Header>("/bridge_test/step", 100, true);
    return is_connected && waitUntil([this] { return !steps_.empty(); }) &&
           goOn(60.0, [this] { return state.may_move != 0; });
  }

  /// Lets the world go on until the condition holds, which is asked after each step, or `at_most_s` of simulated time have
  /// passed: then false. `each_step` is called before. The world stands still between two calls.
  bool goOn(double at_most_s, const std::function<bool()>& condition, const std::function<void()>& each_step = {}) {
    const ros::Time end = now() + ros::Duration(at_most_s);
    bool holds = false;
    const auto ask = [&] {
      if (each_step) each_step();
      holds = condition();
      return holds || now() >= end;
    };
    release();
    const bool has_ended = waitUntil(
        [&] {
          while (!steps_.empty()) {
            takeStep();
            hearTheStep();
            if (ask()) return true;
            release();
          }
          return false;
        },
        kWall_s);
    EXPECT_TRUE(has_ended) << "the world stands still at " << now();
    return holds;
  }

  void goOn(double duration_s) {
    goOn(duration_s, [] { return false; });
  }

  template <typename Action>
  typename BridgeAction<Action>::Result finish(BridgeAction<Action>& action, double at_most_s,
                                               const std::function<void()>& each_step = {}) {
    if (!goOn(
            at_most_s, [&] { return action.isDone(); }, each_step)) {
      typename BridgeAction<Action>::Result none;
      none.outcome.status = ArmOutcome::NUM_STATUS;
      none.outcome.message = "no outcome in stage " + state.stage + "\n" + incidents;
      return none;
    }
    return action.result();
  }

  std::string inject(const std::string& kind, double duration_s = 0.0, double value = 0.0) {
    simulated_world::InjectFault fault;
    fault.request.kind = kind;
    fault.request.duration_s = duration_s;
    fault.request.value = value;
    EXPECT_TRUE(call("/simulated_world/inject_fault", fault));
    return fault.response.success ? "" : fault.response.message;
  }

  std::string trigger(const std::string& service) {
    std_srvs::Trigger asked;
    EXPECT_TRUE(call(service, asked)) << service;
    return asked.response.success ? "" : "refused: " + asked.response.message;
  }

  void setSpeed(double share) {
    ur_msgs::SetSpeedSliderFraction slider;
    slider.request.speed_slider_fraction = share;
    EXPECT_TRUE(call("/ur_hardware_interface/set_speed_slider", slider));
    EXPECT_TRUE(slider.response.success);
  }

  void setTarget(int brick_id) {
    std_msgs::Int32 message;
    message.data = brick_id;
    target_.publish(message);
  }

  /// T_map_base by tf, the truth here.
  Eigen::Isometry3d robotInMap() const {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    EXPECT_TRUE(waitUntil([&] { return tf_.canTransform("map", "base_link", ros::Time(0)); }));
    const auto found =
        interactive_mapping_ros::toIsometry(tf_.lookupTransform("map", "base_link", ros::Time(0)).transform);
    return found.value_or(T);
  }

  double speed() const { return velocity_rad_s.cwiseAbs().maxCoeff(); }
  ros::Time now() const { return ros::Time::now(); }
  const motion_planning::ArmKinematics& arm() const { return *arm_; }

  /// Joint angles for the tip at (x, y, z) of base_link, the tool straight down.
  ArmVector above(double x_m, double y_m, double z_m, const ArmVector& near_rad) const {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() << x_m, y_m, z_m;
    T.linear() = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()).toRotationMatrix();
    const std::vector<ArmVector> solutions = arm_->inverse(T, near_rad);
    EXPECT_FALSE(solutions.empty()) << x_m << ", " << y_m << ", " << z_m;
    return solutions.empty() ? near_rad : solutions.front();
  }

  /// From one place to the next, each nearest to the one before.
  JointTrajectory straight(const ArmVector& from_rad, double x_m, double y_m, double from_z_m, double to_z_m,
                           double speed_m_s) const {
    motion_planning::JointPath path;
    constexpr double kStep_m = 0.005;
    const int steps = std::max(1, static_cast<int>(std::ceil(std::abs(to_z_m - from_z_m) / kStep_m)));
    ArmVector near_rad = from_rad;
    for (int i = 0; i <= steps; ++i) {
      near_rad = above(x_m, y_m, from_z_m + (to_z_m - from_z_m) * i / steps, near_rad);
      path.push_back(near_rad);
    }
    motion_planning::MotionLimits limits;
    return motion_planning::timeParametrize(path, limits, {}, motion_planning::tipSpeedLimit(arm_, speed_m_s));
  }

  JointTrajectory way(const motion_planning::JointPath& path, double speed_rad_s = 1.0) const {
    motion_planning::MotionLimits limits;
    limits.velocity_rad_s.setConstant(speed_rad_s);
    return motion_planning::timeParametrize(path, limits);
  }

  BridgeAction<MoveArmAction> move;
  BridgeAction<PickBrickAction> pick;
  BridgeAction<LetGoBrickAction> let_go;
  BridgeAction<RecoverArmAction> recover;

  /// The path monitor says what it says.
  void speak() {
    if (!is_monitor_alive) return;
    word_.header.stamp = now();
    // As the planner's: it watches until the trajectory's time is over.
    if (word_.is_watching && now() >= watch_end_) {
      word_.is_watching = 0;
      word_.watch_id = 0;
    }
    word_.must_stop = must_stop.empty() ? 0 : 1;
    word_.reason = must_stop;
    monitor_.publish(word_);
  }

  // As of the last step.
  ArmVector position_rad{ArmVector::Zero()};
  ArmVector velocity_rad_s{ArmVector::Zero()};
  ArmBridgeState state;
  simulated_world::JudgeState judge;
  interactive_mapping_msgs::AttachedBrick attached;
  std::string incidents;

  // Set by a test that makes it so.
  bool is_mission_alive{true};
  bool is_monitor_alive{true};
  std::string must_stop;      // what the path monitor says
  std::string watch_refusal;  // empty: it takes what it is given

 private:
  bool onWatch(interactive_mapping_msgs::WatchTrajectory::Request& request,
               interactive_mapping_msgs::WatchTrajectory::Response& response) {
    response.success = watch_refusal.empty() ? 1 : 0;
    response.message = watch_refusal;
    if (watch_refusal.empty()) {
      word_.is_watching = request.trajectory.points.empty() ? 0 : 1;
      word_.watch_id = request.trajectory.points.empty() ? 0 : ++watches_;
      must_stop.clear();
      if (word_.is_watching) {
        const ros::Time start = request.start.isZero() ? now() : request.start;
        watch_end_ = start + request.trajectory.points.back().time_from_start;
      }
    }
    response.watch_id = word_.watch_id;
    speak();
    return true;
  }

  void onJoints(const sensor_msgs::JointState::ConstPtr& joints) {
    for (std::size_t k = 0; k < mp700_ur5e_description::kArmJoints.size(); ++k) {
      for (std::size_t i = 0; i < joints->name.size(); ++i) {
        if (joints->name[i] != mp700_ur5e_description::kArmJoints[k]) continue;
        joints_stamp_ = joints->header.stamp;
        position_rad[static_cast<Eigen::Index>(k)] = joints->position[i];
        velocity_rad_s[static_cast<Eigen::Index>(k)] = joints->velocity[i];
      }
    }
  }

  void takeStep() {
    unanswered_ = steps_.front();
    steps_.pop_front();
  }

  /// Each topic has its own connection: waits for the joint states and the bridge's state as of the step. A driver that
  /// has fallen silent is waited for once.
  void hearTheStep() {
    const ros::Time stamp = unanswered_.stamp - ros::Duration(1.5 * kJointStatePeriod_s);
    const auto isHeard = [&] { return joints_stamp_ >= stamp && state.header.stamp >= stamp; };
    is_silent_ = is_silent_ ? !isHeard() : !waitUntil(isHeard, 2.0);
  }

  /// The mission lives, and the monitor looks.
  void beat() {
    if ((now() - beaten_).toSec() < kHeartbeat_s) return;
    beaten_ = now();
    speak();
    if (!is_mission_alive) return;
    std_msgs::Header header;
    header.stamp = beaten_;
    heartbeat_.publish(header);
  }

  void release() {
    beat();
    if (unanswered_.stamp.isZero()) return;
    answer_.publish(unanswered_);
    unanswered_ = std_msgs::Header();
  }

  ros::NodeHandle nh_;
  tf2_ros::Buffer tf_;
  tf2_ros::TransformListener listener_{tf_};
  std::shared_ptr<const motion_planning::ArmKinematics> arm_;
  ros::Subscriber odometry_;
  std::vector<ros::Subscriber> subscribers_;
  ros::Publisher answer_, heartbeat_, target_, monitor_;
  ros::ServiceServer watch_server_;
  interactive_mapping_msgs::PathMonitorState word_;
  std::uint32_t watches_{0};
  ros::Time watch_end_;
  std::deque<std_msgs::Header> steps_;
  std_msgs::Header unanswered_;
  ros::Time beaten_;
  ros::Time joints_stamp_;
  bool is_silent_{false};
};

}  // namespace integration_tests
