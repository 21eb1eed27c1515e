// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge_ros/ur_driver_bridge_ros.h"

#include <algorithm>
#include <limits>
#include <stdexcept>

#include <interactive_mapping_common_ros/cancel_asked.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_msgs/AttachedBrick.h>
#include <interactive_mapping_msgs/WatchTrajectory.h>
#include <motion_planning_ros/conversions.h>
#include <motion_planning_ros/robot_description.h>
#include <mp700_ur5e_description/robot_names.h>

#include "ur_driver_bridge_ros/bridge_markers.h"

namespace ur_driver_bridge_ros {
namespace {

using interactive_mapping_msgs::ArmBridgeState;
using interactive_mapping_msgs::ArmOutcome;
using interactive_mapping_msgs::AttachedBrick;
using interactive_mapping_msgs::WatchTrajectory;
using interactive_mapping_ros::toIsometry;
using motion_planning_ros::fromMessage;
using ur_driver_bridge::ArmCall;
using ur_driver_bridge::ArmModel;
using ur_driver_bridge::ArmState;
using ur_driver_bridge::ArmStatus;
using ur_driver_bridge::ArmVector;
using ur_driver_bridge::Finished;
using ur_driver_bridge::Verdict;

namespace names = mp700_ur5e_description;

constexpr const char* kLog = "bridge";
constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();
constexpr double kMaxSilence_s = 2.0;   // wall time without a step that diagnostics call an error
constexpr double kSetBack_s = 1.0;      // of the clock against the last step: it has begun anew
constexpr double kMinSilence_s = 0.05;  // without joint states, before the watchdog steps in their place
constexpr double kFeedbackPeriod_s = 0.1;
constexpr double kDueShare = 0.6;  // of a word's allowed age: later, the next one is on its way
constexpr std::chrono::milliseconds kWordWait{50};

double steadyNow() {
  return ros::SteadyTime::now().toSec();
}

/// All that hangs on the tool's flange, by the URDF.
ur_driver_bridge::Payload toolOf(const names::RobotModel& robot) {
  ur_driver_bridge::Payload tool;
  Eigen::Vector3d moment_kg_m = Eigen::Vector3d::Zero();
  const std::size_t body = robot.bodyOf(names::kToolFrame);
  const Eigen::Isometry3d T_tool_body = robot.poseInBody(names::kToolFrame).inverse();
  for (const auto& [name, element] : robot.tree().getSegments()) {
    bool is_tool = false;
    for (auto at = robot.tree().getSegment(name); !is_tool && at->first != robot.rootFrame();) {
      at = GetTreeElementParent(at->second);
      is_tool = at->first == names::kToolFrame;
    }
    if (!is_tool || robot.bodyOf(name) != body) continue;
    const KDL::RigidBodyInertia& inertia = GetTreeElementSegment(element).getInertia();
    const Eigen::Vector3d centre_m(inertia.getCOG().x(), inertia.getCOG().y(), inertia.getCOG().z());
    tool.mass_kg += inertia.getMass();
    moment_kg_m += inertia.getMass() * (T_tool_body * robot.poseInBody(name) * centre_m);
  }
  if (tool.mass_kg > 0.0) tool.centre_m = moment_kg_m / tool.mass_kg;
  return tool;
}

ArmModel modelFrom(const ros::NodeHandle& nh, const UrDriverBridgeParams& params) {
  ArmModel model;
  model.kinematics = motion_planning_ros::kinematicsFromServer(nh);
  const motion_planning::ArmLimits& limits = model.kinematics->limits();
  model.limits.joints.assign(names::kArmJoints.begin(), names::kArmJoints.end());
  model.limits.lower_rad = limits.lower_rad;
  model.limits.upper_rad = limits.upper_rad;
  model.limits.velocity_rad_s = limits.velocity_rad_s;
  model.tool = toolOf(model.kinematics->robot());
  model.max_payload_kg = params.max_payload_kg;
  return model;
}

names::BrickCatalogue catalogueFrom(const std::string& file) {
  try {
    return names::loadBrickTypes(file);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument("bricks_file = '" + file + "':\n" + error.what());
  }
}

geometry_msgs::Vector3 toVector(const Eigen::Vector3d& v) {
  geometry_msgs::Vector3 message;
  message.x = v.x();
  message.y = v.y();
  message.z = v.z();
  return message;
}

}  // namespace

UrDriverBridgeRos::UrDriverBridgeRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : params_(loadUrDriverBridgeParams(private_nh)),
      catalogue_(catalogueFrom(params_.bricks_file)),
      model_(modelFrom(nh, params_)),
      executor_(params_.executor, model_),
      nh_(nh),
      watch_service_(nh_.resolveName("planner/watch")),
      attached_memory_(private_nh),
      attached_before_(attached_memory_.recall()),
      diagnostics_(nh, private_nh) {
  ROS_DEBUG_NAMED(kLog, "parameters:\n%s", interactive_mapping::toYaml(params_).c_str());
  ros::NodeHandle handle(private_nh);
  state_publisher_ = handle.advertise<ArmBridgeState>("state", 50);
  marker_publisher_ = handle.advertise<visualization_msgs::MarkerArray>("markers", 1, true);
  outcome_publisher_ = handle.advertise<ArmOutcome>("outcome", 10, true);
  attached_publisher_ = nh_.advertise<AttachedBrick>("attached_brick", 1, true);
  startGripper(ros::NodeHandle(private_nh, "gripper/own"));
  // After the plugin: dlopen() and a first warning of tf2 would wait for each other's locks.
  tf_listener_.emplace(tf_, true, ros::TransportHints().tcpNoDelay());
  startCalls();
  subscribeAll();
  hold_server_ = handle.advertiseService("hold", &UrDriverBridgeRos::onHold, this);
  release_server_ = handle.advertiseService("release", &UrDriverBridgeRos::onRelease, this);
  stop_server_ = handle.advertiseService("stop", &UrDriverBridgeRos::onStop, this);
  startActions(handle);
  diagnostics_.setHardwareID("none");
  diagnostics_.add("arm", this, &UrDriverBridgeRos::diagnoseArm);
  diagnostics_.add("requests", this, &UrDriverBridgeRos::diagnoseRequests);
  // By the wall clock: a clock that stands still is something to report.
  diagnostics_timer_ = handle.createWallTimer(ros::WallDuration(1.0),
                                              [this](const ros::WallTimerEvent&) { diagnostics_.force_update(); });
}

void UrDriverBridgeRos::startGripper(const ros::NodeHandle& own_nh) {
  const std::string& type = params_.executor.gripper.type;
  try {
    gripper_ = gripper_loader_.createUniqueInstance(type);
  } catch (const pluginlib::PluginlibException& error) {
    std::string known;
    for (const std::string& declared : gripper_loader_.getDeclaredClasses()) {
      known += (known.empty() ? "" : ", ") + declared;
    }
    throw std::invalid_argument("gripper/type = '" + type + "', must be one of " + known + ": " + error.what());
  }
  ros::NodeHandle control(nh_);
  control.setCallbackQueue(&control_queue_);
  gripper_->start(control, own_nh, [this](const ur_driver_bridge::GripperState& state) { onGripper(state); });
}

void UrDriverBridgeRos::startCalls() {
  planner_calls_ = std::make_unique<CallThread>();
  driver_ = std::make_unique<UrDriver>(
      nh_, *gripper_,
      [this](const ur_driver_bridge::CallReply& reply) {
        const std::lock_guard<std::mutex> lock(answers_mutex_);
        replies_.push_back(reply);
        answered_.notify_all();
      },
      [this](const ur_driver_bridge::TrajectoryEvent& event) {
        const std::lock_guard<std::mutex> lock(answers_mutex_);
        events_.push_back(event);
        answered_.notify_all();
      });
}

void UrDriverBridgeRos::subscribeAll() {
  ros::NodeHandle control(nh_);
  control.setCallbackQueue(&control_queue_);
  // What is acted on must not be held back by Nagle's algorithm.
  const ros::TransportHints no_delay = ros::TransportHints().tcpNoDelay();
  const auto subscribe = [&](const std::string& topic, std::uint32_t queue, auto callback) {
    subscribers_.push_back(control.subscribe(topic, queue, callback, this, no_delay));
  };
  subscribe("scaled_pos_joint_traj_controller/state", 10, &UrDriverBridgeRos::onControllerState);
  subscribe("wrench", 10, &UrDriverBridgeRos::onWrench);
  subscribe("map/update", 10, &UrDriverBridgeRos::onMapUpdate);
  subscribers_.push_back(control.subscribe<std_msgs::Float64>(
      "speed_scaling_factor", 10,
      [this](const std_msgs::Float64ConstPtr& message) {
        // Without a stamp of its own: as old as its arrival.
        inputs_.arm.speed_scaling = {timeOfArrival().toSec(), message->data};
      },
      ros::VoidConstPtr(), no_delay));
  subscribers_.push_back(control.subscribe<std_msgs::Bool>(
      "ur_hardware_interface/robot_program_running", 5,
      [this](const std_msgs::BoolConstPtr& message) { inputs_.arm.is_program_running = message->data != 0; }));
  subscribers_.push_back(control.subscribe<ur_dashboard_msgs::RobotMode>(
      "ur_hardware_interface/robot_mode", 5,
      [this](const ur_dashboard_msgs::RobotModeConstPtr& message) { inputs_.arm.robot_mode = message->mode; }));
  subscribers_.push_back(control.subscribe<ur_dashboard_msgs::SafetyMode>(
      "ur_hardware_interface/safety_mode", 5,
      [this](const ur_dashboard_msgs::SafetyModeConstPtr& message) { inputs_.arm.safety_mode = message->mode; }));
  subscribe("joint_states", 20, &UrDriverBridgeRos::onJointStates);
  watchdog_ = std::make_unique<interactive_mapping_ros::ClockTimer>(
      control, ros::Duration(1.0 / params_.watchdog_rate_hz), [this] { onWatchdog(); });
  control_spinner_ = std::make_unique<ros::AsyncSpinner>(1, &control_queue_);
  control_spinner_->start();
  // A thread of its own: in lock step, control waits for what is on its way.
  ros::NodeHandle mission(nh_);
  mission.setCallbackQueue(&mission_queue_);
  subscribers_.push_back(mission.subscribe("heartbeat", 10, &UrDriverBridgeRos::onHeartbeat, this, no_delay));
  subscribers_.push_back(mission.subscribe("planner/path_monitor", 10, &UrDriverBridgeRos::onMonitor, this, no_delay));
  mission_spinner_ = std::make_unique<ros::AsyncSpinner>(1, &mission_queue_);
  mission_spinner_->start();
}

void UrDriverBridgeRos::startActions(ros::NodeHandle handle) {
  using namespace interactive_mapping_msgs;
  move_server_ = std::make_unique<Server<MoveArmAction>>(
      handle, "move",
      [this](auto goal) {
        onGoal<MoveArmAction>(goal, "move", [this](const MoveArmGoal& wanted) {
          Request request;
          const auto trajectory = fromMessage(wanted.trajectory);
          request.begin = [this, trajectory] { executor_.move(trajectory); };
          return request;
        });
      },
      interactive_mapping_ros::NoCancelCallback(), false);
  pick_server_ = std::make_unique<Server<PickBrickAction>>(
      handle, "pick",
      [this](auto goal) {
        onGoal<PickBrickAction>(goal, "pick", [this](const PickBrickGoal& wanted) { return preparePick(wanted); });
      },
      interactive_mapping_ros::NoCancelCallback(), false);
  let_go_server_ = std::make_unique<Server<LetGoBrickAction>>(
      handle, "let_go",
      [this](auto goal) {
        onGoal<LetGoBrickAction>(goal, "let_go", [this](const LetGoBrickGoal&) {
          Request request;
          request.begin = [this] { executor_.letGo(); };
          return request;
        });
      },
      interactive_mapping_ros::NoCancelCallback(), false);
  recover_server_ = std::make_unique<Server<RecoverArmAction>>(
      handle, "recover",
      [this](auto goal) {
        onGoal<RecoverArmAction>(goal, "recover", [this](const RecoverArmGoal& wanted) {
          Request request;
          const ur_driver_bridge::RecoveryPermit permit{wanted.unlock_protective_stop != 0, wanted.restart_safety != 0};
          request.begin = [this, permit] { executor_.recover(permit); };
          return request;
        });
      },
      interactive_mapping_ros::NoCancelCallback(), false);
  move_server_->start();
  pick_server_->start();
  let_go_server_->start();
  recover_server_->start();
}

UrDriverBridgeRos::~UrDriverBridgeRos() {
  {
    const std::lock_guard<std::mutex> lock(requests_mutex_);
    is_stopping_ = true;
  }
  answered_.notify_all();
  diagnostics_timer_.stop();
  hold_server_.shutdown();
  release_server_.shutdown();
  stop_server_.shutdown();
  control_spinner_->stop();
  mission_spinner_->stop();
  planner_calls_.reset();
  driver_.reset();
}

void UrDriverBridgeRos::stop(ros::WallDuration timeout) {
  std::unique_lock<std::mutex> lock(requests_mutex_);
  is_stopping_ = true;
  idle_.wait_for(lock, std::chrono::nanoseconds(timeout.toNSec()), [this] { return !is_busy_; });
}

// ---------------------------------------------------------------------------------------------------------- requests

template <typename Action, typename Prepare>
void UrDriverBridgeRos::onGoal(typename Server<Action>::GoalHandle goal, const char* name, Prepare prepare) {
  using Result = typename Action::_action_result_type::_result_type;
  using Feedback = typename Action::_action_feedback_type::_feedback_type;
  const auto refuse = [&](ArmStatus status, const std::string& why) {
    Result result;
    result.outcome.header.stamp = ros::Time::now();
    result.outcome.status = static_cast<std::uint8_t>(status);
    result.outcome.message = why;
    ROS_WARN_NAMED(kLog, "%s refused: %s", name, why.c_str());
    {
      const std::lock_guard<std::mutex> lock(shared_mutex_);
      ++outcomes_[std::string(name) + " refused"];
      last_failure_ = std::string(name) + " refused: " + why;
    }
    outcome_publisher_.publish(result.outcome);
    goal.setRejected(result, why);
  };
  Request request;
  try {
    request = prepare(*goal.getGoal());
  } catch (const std::exception& error) {
    refuse(ArmStatus::kBadRequest, error.what());
    return;
  }
  request.goal_id = goal.getGoalID().id;
  request.name = name;
  request.isCancelAsked = [goal] { return interactive_mapping_ros::isCancelAsked(goal); };
  request.tell = [goal](const std::string& stage, double progress) mutable {
    Feedback feedback;
    feedback.stage = stage;
    if constexpr (std::is_same_v<Feedback, interactive_mapping_msgs::MoveArmFeedback> ||
                  std::is_same_v<Feedback, interactive_mapping_msgs::PickBrickFeedback>) {
      feedback.progress = static_cast<float>(progress);
    }
    static_cast<void>(progress);
    goal.publishFeedback(feedback);
  };
  request.end = [this, goal](const Finished& finished) mutable {
    Result result;
    result.outcome = toMessage(finished);
    if constexpr (std::is_same_v<Result, interactive_mapping_msgs::PickBrickResult>) {
      result.contact_travel = static_cast<float>(finished.figures.contact_travel_m);
      result.contact_force = static_cast<float>(finished.figures.contact_force_N);
      result.load = static_cast<float>(finished.figures.load_kg);
    }
    if constexpr (std::is_same_v<Result, interactive_mapping_msgs::RecoverArmResult>) {
      result.done = finished.recovery_commands;
    }
    outcome_publisher_.publish(result.outcome);
    const std::string text = finished.verdict.isFine()
                                 ? ""
                                 : std::string(toString(finished.verdict.status)) + ": " + finished.verdict.message;
    if (finished.verdict.isFine()) {
      goal.setSucceeded(result);
    } else if (finished.verdict.status == ArmStatus::kCancelled) {
      goal.setCanceled(result, text);
    } else {
      goal.setAborted(result, text);
    }
  };
  {
    const std::lock_guard<std::mutex> lock(requests_mutex_);
    if (!is_stopping_ && !is_busy_) {
      is_busy_ = true;
      goal.setAccepted();  // at once, so that a client knows, before time goes on, that the next joint state begins it
      next_ = std::move(request);
      return;
    }
  }
  refuse(ArmStatus::kBusy,
         is_stopping_ ? "the node is shutting down" : "the arm is busy with another request: wait for it, or stop it");
}

UrDriverBridgeRos::Request UrDriverBridgeRos::preparePick(const interactive_mapping_msgs::PickBrickGoal& goal) {
  const names::BrickType& type = catalogue_.type(goal.type);
  const std::optional<Eigen::Isometry3d> T_tip_brick = toIsometry(goal.held);
  const std::optional<Eigen::Isometry3d> T_frame_contact = toIsometry(goal.contact.pose);
  if (!T_tip_brick) throw std::invalid_argument("held: a pose that is not finite, or no rotation");
  if (!T_frame_contact) throw std::invalid_argument("contact: a pose that is not finite, or no rotation");
  if (!toIsometry(goal.brick.pose)) throw std::invalid_argument("brick: a pose that is not finite, or no rotation");

  ur_driver_bridge::PickRequest pick;
  pick.brick_mass_kg = type.mass_kg;
  pick.T_tip_brick = *T_tip_brick;
  pick.lets_go = goal.let_go != 0;
  const auto read = [](const char* stage, const trajectory_msgs::JointTrajectory& message) {
    try {
      if (message.points.empty()) throw std::invalid_argument("has 0 points, must have at least 1");
      return fromMessage(message);
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument(std::string(stage) + ": " + error.what());
    }
  };
  pick.approach = read("approach", goal.approach);
  pick.touch = read("touch", goal.touch);
  pick.lift = read("lift", goal.lift);
  if (!goal.stow.points.empty()) pick.stow = read("stow", goal.stow);
  if (pick.lets_go && pick.stow.empty()) throw std::invalid_argument("let_go without stow: the brick would fall");

  Eigen::Isometry3d T_base_contact = *T_frame_contact;
  const std::string frame = interactive_mapping_ros::withoutSlash(goal.contact.header.frame_id);
  if (frame != params_.base_frame) {
    try {
      const auto T = toIsometry(tf_.lookupTransform(params_.base_frame, frame, ros::Time(0)).transform);
      if (!T) throw std::invalid_argument("contact: tf's pose of its frame is not finite, or no rotation");
      T_base_contact = *T * *T_frame_contact;
    } catch (const tf2::TransformException& error) {
      throw std::invalid_argument(std::string("contact: ") + error.what());
    }
  }
  const Eigen::Isometry3d T_base_start = model_.kinematics->tipPose(pick.touch.points.front().position_rad);
  pick.contact_travel_m = (T_base_contact.translation() - T_base_start.translation()).norm();
  const Eigen::Isometry3d T_base_end = model_.kinematics->tipPose(pick.touch.points.back().position_rad);
  const double way_m = (T_base_end.translation() - T_base_start.translation()).norm();
  if (pick.contact_travel_m > way_m + params_.executor.pick.early_m) {
    throw std::invalid_argument("contact is " + std::to_string(pick.contact_travel_m) +
                                " m from the touch's start, the touch goes only " + std::to_string(way_m) + " m");
  }

  Request request;
  request.begin = [this, pick] {
    if (is_magnet_on_ || executor_.isHolding()) {
      throw std::invalid_argument("the magnet is on: let go first of what may hang there");
    }
    executor_.pick(pick);
  };
  request.target = goal.brick;
  request.target_size = toVector(type.size_m);
  request.setAttached = [this, goal, size = request.target_size] {
    AttachedBrick attached;
    attached.header.stamp = timeOfArrival();
    attached.header.frame_id = names::kMagnetTipFrame;
    attached.is_attached = 1;
    attached.id = goal.brick_id;
    attached.type = goal.type;
    attached.size = size;
    attached.pose = goal.held;
    tellAttached(attached);
  };
  return request;
}

bool UrDriverBridgeRos::onHold(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  const std::lock_guard<std::mutex> lock(requests_mutex_);
  is_held_ = true;
  response.success = 1;
  response.message = "held: nothing moves until ~release";
  ROS_WARN_NAMED(kLog, "the operator holds the arm");
  return true;
}

bool UrDriverBridgeRos::onRelease(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  const std::lock_guard<std::mutex> lock(requests_mutex_);
  response.message = is_held_ ? "released" : "was not held";
  if (is_held_) ROS_WARN_NAMED(kLog, "the operator has released the arm");
  is_held_ = false;
  response.success = 1;
  return true;
}

bool UrDriverBridgeRos::onStop(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  const std::lock_guard<std::mutex> lock(requests_mutex_);
  response.success = 1;
  if (is_busy_) {
    is_stop_asked_ = true;
    response.message = "stopping";
  } else {
    // At once: it must not fall upon a request that comes after it.
    driver_->cancel();
    response.message = "no request runs here; any goal of the controller is cancelled";
  }
  return true;
}

void UrDriverBridgeRos::takeRequests() {
  std::optional<Request> next;
  bool is_stop_asked = false;
  bool is_ending = false;
  {
    const std::lock_guard<std::mutex> lock(requests_mutex_);
    next.swap(next_);
    is_stop_asked = is_stop_asked_;
    is_stop_asked_ = false;
    is_ending = is_stopping_;
    inputs_.is_held = is_held_;
  }
  if (next) {
    current_ = std::move(next);
    try {
      current_->begin();
    } catch (const std::exception& error) {
      Finished refused;
      refused.verdict.status = ArmStatus::kBadRequest;
      refused.verdict.message = error.what();
      finish(refused);
    }
  }
  if (current_ && current_->isCancelAsked()) executor_.stop({ArmStatus::kCancelled, "cancelled by its sender"});
  if (is_stop_asked) executor_.stop({ArmStatus::kCancelled, "stopped by the operator"});
  if (is_ending) executor_.stop({ArmStatus::kCancelled, "the node ends"});
}

// ---------------------------------------------------------------------------------------------------------- topics

void UrDriverBridgeRos::onJointStates(const sensor_msgs::JointStateConstPtr& message) {
  ur_driver_bridge::JointState joints;
  for (std::size_t k = 0; k < names::kArmJoints.size(); ++k) {
    const auto found = std::find(message->name.begin(), message->name.end(), names::kArmJoints[k]);
    if (found == message->name.end()) return;  // of the wheels, for instance
    const auto i = static_cast<std::size_t>(found - message->name.begin());
    const auto row = static_cast<Eigen::Index>(k);
    if (message->position.size() <= i || message->velocity.size() <= i) {
      ROS_WARN_THROTTLE_NAMED(10.0, kLog, "joint states without positions or velocities: ignored");
      return;
    }
    joints.position_rad[row] = message->position[i];
    joints.velocity_rad_s[row] = message->velocity[i];
  }
  if (!joints.position_rad.allFinite() || !joints.velocity_rad_s.allFinite()) {
    ROS_WARN_THROTTLE_NAMED(10.0, kLog, "joint states that are not finite: ignored");
    return;
  }
  inputs_.arm.joints = {message->header.stamp.toSec(), joints};
  step(std::max(message->header.stamp, ros::Time::now()));
}

void UrDriverBridgeRos::onControllerState(const control_msgs::JointTrajectoryControllerStateConstPtr& message) {
  ArmVector commanded_rad;
  for (std::size_t k = 0; k < names::kArmJoints.size(); ++k) {
    const auto found = std::find(message->joint_names.begin(), message->joint_names.end(), names::kArmJoints[k]);
    const auto i = static_cast<std::size_t>(found - message->joint_names.begin());
    if (found == message->joint_names.end() || message->desired.positions.size() <= i) return;
    commanded_rad[static_cast<Eigen::Index>(k)] = message->desired.positions[i];
  }
  if (commanded_rad.allFinite()) inputs_.arm.commanded_rad = {message->header.stamp.toSec(), commanded_rad};
}

void UrDriverBridgeRos::onWrench(const geometry_msgs::WrenchStampedConstPtr& message) {
  const auto vector = [](const geometry_msgs::Vector3& v) { return Eigen::Vector3d(v.x, v.y, v.z); };
  inputs_.arm.force = {message->header.stamp.toSec(), {vector(message->wrench.force), vector(message->wrench.torque)}};
}

void UrDriverBridgeRos::onGripper(const ur_driver_bridge::GripperState& state) {
  // Without a stamp of its own: as old as its arrival.
  inputs_.arm.gripper = {timeOfArrival().toSec(), state};
  is_magnet_on_ = state.is_on;
  if (is_attached_known_) return;
  is_attached_known_ = true;
  if (is_magnet_on_ && attached_before_) {
    // Its stamp of then: nobody is to take where it is now for the place that it was taken from.
    ROS_WARN_NAMED(kLog, "the magnet is on: brick %d hung there before this node was restarted", attached_before_->id);
    tellAttached(*attached_before_);
  } else if (is_magnet_on_) {
    // What others were told of it before still holds.
    ROS_WARN_NAMED(kLog, "the magnet is on: what hangs there is not known. Let go of it where it can lie");
  } else {
    publishAttached(false);
  }
}

void UrDriverBridgeRos::onMapUpdate(const interactive_mapping_msgs::MapUpdateConstPtr& message) {
  if (message->status == interactive_mapping_msgs::MapUpdate::ACCEPTED) {
    inputs_.map_stamp_s = message->header.stamp.toSec();
  }
}

void UrDriverBridgeRos::onMonitor(const interactive_mapping_msgs::PathMonitorStateConstPtr& message) {
  const std::lock_guard<std::mutex> lock(answers_mutex_);
  monitor_ = ur_driver_bridge::MonitorWord{message->header.stamp.toSec(), message->is_watching != 0, message->watch_id,
                                           message->must_stop != 0, message->reason};
  if (watch_id_ && monitor_->watch_id == *watch_id_) is_watch_heard_ = true;
  answered_.notify_all();
}

void UrDriverBridgeRos::onHeartbeat(const std_msgs::HeaderConstPtr& message) {
  const std::lock_guard<std::mutex> lock(answers_mutex_);
  heartbeat_s_ = message->stamp.toSec();
  heartbeat_wall_s_ = steadyNow();
  answered_.notify_all();
}

/// A simulated clock comes by a topic of its own: on a busy machine it may be far behind the joint states.
ros::Time UrDriverBridgeRos::timeOfArrival() const {
  return std::max(ros::Time::now(), last_step_);
}

void UrDriverBridgeRos::onWatchdog() {
  const ros::Time now = ros::Time::now();
  // A simulated clock comes by a topic of its own and may be behind the joint states: that is no step back.
  const bool is_set_back = (last_step_ - now).toSec() > kSetBack_s;
  if (last_step_.isZero() || is_set_back || (now - last_step_).toSec() >= kMinSilence_s) step(now);
}

// ---------------------------------------------------------------------------------------------------------- control

void UrDriverBridgeRos::step(const ros::Time& now) {
  last_step_ = now;
  takeRequests();
  inputs_.now_s = now.toSec();
  inputs_.wall_s = steadyNow();
  inputs_.arm.is_controller_there = driver_->isControllerThere();
  takeWords();
  const ros::WallTime deadline = ros::WallTime::now() + ros::WallDuration(params_.lockstep_wait_s);
  while (true) {
    ur_driver_bridge::ExecutorInputs inputs;
    inputs.gate = inputs_;
    {
      const std::lock_guard<std::mutex> lock(answers_mutex_);
      inputs.replies.swap(replies_);
      inputs.events.swap(events_);
    }
    const ur_driver_bridge::ExecutorOutput output = executor_.step(inputs);
    for (const ArmCall& call : output.calls) carryOut(call);
    if (output.finished) finish(*output.finished);
    // In lock step the clock waits for this step's answer, and the answer for what was asked.
    if (!executor_.isWaitingForReply() || params_.lockstep_wait_s <= 0.0) break;
    std::unique_lock<std::mutex> lock(answers_mutex_);
    const double left_s = (deadline - ros::WallTime::now()).toSec();
    const bool is_answered = answered_.wait_for(lock, std::chrono::duration<double>(std::max(left_s, 0.0)),
                                                [this] { return !replies_.empty() || !events_.empty(); });
    if (!is_answered) break;
  }
  publishState(now);
}

void UrDriverBridgeRos::takeWords() {
  std::unique_lock<std::mutex> lock(answers_mutex_);
  const ur_driver_bridge::SafetyGateConfig& gate = params_.executor.gate;
  const auto isRecent = [&](double stamp_s, double max_age_s) {
    return inputs_.now_s - stamp_s < kDueShare * max_age_s;
  };
  const auto isHeartbeatDue = [&] {
    return gate.max_heartbeat_age_s > 0.0 && !(heartbeat_s_ && isRecent(*heartbeat_s_, gate.max_heartbeat_age_s));
  };
  const auto isMonitorDue = [&] {
    if (gate.max_monitor_age_s <= 0.0 || !watch_id_ || executor_.isIdle()) return false;
    if (!is_watch_heard_) return true;
    const bool is_on = monitor_->is_watching && monitor_->watch_id == *watch_id_;  // else it has ended by itself
    return is_on && !isRecent(monitor_->stamp_s, gate.max_monitor_age_s);
  };
  if (params_.lockstep_wait_s > 0.0) {
    // In lock step a hundred seconds pass in one: what has been sent in time must not be late for that.
    answered_.wait_for(lock, kWordWait, [&] { return !isHeartbeatDue() && !isMonitorDue(); });
  }
  inputs_.heartbeat_s = heartbeat_s_;
  inputs_.heartbeat_wall_s = heartbeat_wall_s_;
  inputs_.monitor = monitor_;
}

void UrDriverBridgeRos::carryOut(const ArmCall& call) {
  using namespace ur_driver_bridge;
  const std::uint64_t id = call.id;
  if (const auto* watched = std::get_if<WatchCall>(&call.what)) {
    watch(id, *watched);
  } else if (const auto* sent = std::get_if<SendCall>(&call.what)) {
    driver_->send(id, sent->trajectory);
  } else if (std::holds_alternative<CancelCall>(call.what)) {
    driver_->cancel();
  } else if (const auto* magnet = std::get_if<MagnetCall>(&call.what)) {
    driver_->setMagnet(id, magnet->is_on);
  } else if (std::holds_alternative<ZeroForceCall>(call.what)) {
    driver_->zeroForce(id);
  } else if (const auto* payload = std::get_if<PayloadCall>(&call.what)) {
    driver_->setPayload(id, payload->payload);
  } else if (const auto* dashboard = std::get_if<DashboardCall>(&call.what)) {
    driver_->dashboard(id, dashboard->command);
  } else if (const auto* attach = std::get_if<AttachCall>(&call.what)) {
    publishAttached(attach->is_attached);
  }
}

void UrDriverBridgeRos::watch(std::uint64_t id, const ur_driver_bridge::WatchCall& call) {
  WatchTrajectory service;
  if (!call.trajectory.empty()) {
    service.request.trajectory = motion_planning_ros::toMessage(call.trajectory);
    service.request.start = ros::Time(call.start_s);
    service.request.phase = static_cast<std::uint8_t>(call.phase);
    if (current_) {
      service.request.target = current_->target;
      service.request.target_size = current_->target_size;
    }
  }
  planner_calls_->post([this, id, service]() mutable {
    ur_driver_bridge::CallReply reply;
    reply.id = id;
    ros::ServiceClient client = ros::NodeHandle(nh_).serviceClient<WatchTrajectory>(watch_service_, true);
    if (client.isValid() && client.call(service)) {
      reply.success = service.response.success != 0;
      reply.message = service.response.message;
      reply.watch_id = service.response.watch_id;
    } else {
      reply.is_gone = true;
      reply.message = "service " + watch_service_ + " does not answer";
    }
    const std::lock_guard<std::mutex> lock(answers_mutex_);
    watch_id_.reset();
    if (reply.success && !service.request.trajectory.points.empty()) watch_id_ = reply.watch_id;
    is_watch_heard_ = monitor_ && watch_id_ && monitor_->watch_id == *watch_id_;
    replies_.push_back(reply);
    answered_.notify_all();
  });
}

void UrDriverBridgeRos::publishAttached(bool is_attached) {
  if (is_attached && current_ && current_->setAttached) {
    current_->setAttached();
    return;
  }
  AttachedBrick nothing;
  nothing.header.stamp = timeOfArrival();
  nothing.header.frame_id = names::kMagnetTipFrame;
  tellAttached(nothing);
}

void UrDriverBridgeRos::tellAttached(const AttachedBrick& attached) {
  attached_publisher_.publish(attached);
  attached_memory_.keep(attached);
}

void UrDriverBridgeRos::publishState(const ros::Time& now) {
  ArmBridgeState state;
  state.header.stamp = now;
  state.phase = static_cast<std::uint8_t>(executor_.phase());
  if (current_) state.goal_id = current_->goal_id;
  state.stage = executor_.stage();
  state.progress = static_cast<float>(executor_.progress());
  const Verdict gate = executor_.gate();
  state.may_move = gate.isFine() ? 1 : 0;
  state.gate = static_cast<std::uint8_t>(gate.status);
  state.reason = gate.message;
  state.is_held = inputs_.is_held ? 1 : 0;
  state.is_magnet_on = is_magnet_on_ ? 1 : 0;
  state.is_holding = executor_.isHolding() ? 1 : 0;
  state.force_along_tool = inputs_.arm.force ? static_cast<float>(inputs_.arm.force->value.force_N.z()) : kUnknown;
  const std::optional<double> load_kg = executor_.load();
  state.load = load_kg ? static_cast<float>(*load_kg) : kUnknown;
  state.speed_scaling = inputs_.arm.speed_scaling ? static_cast<float>(inputs_.arm.speed_scaling->value) : kUnknown;
  state_publisher_.publish(state);
  if ((now - told_).toSec() >= kFeedbackPeriod_s || now < told_) {
    told_ = now;
    if (current_) current_->tell(state.stage, executor_.progress());
    if (marker_publisher_.getNumSubscribers() > 0) marker_publisher_.publish(toMarkers(state));
  }
  const std::lock_guard<std::mutex> lock(shared_mutex_);
  shown_ = state;
  stepped_ = ros::WallTime::now();
  const ArmState& arm = inputs_.arm;
  modes_ = "robot mode " + (arm.robot_mode ? ur_driver_bridge::robotModeName(*arm.robot_mode) : "unknown") +
           ", safety mode " + (arm.safety_mode ? ur_driver_bridge::safetyModeName(*arm.safety_mode) : "unknown") +
           ", program " + (arm.is_program_running ? (*arm.is_program_running ? "running" : "stopped") : "unknown");
}

ArmOutcome UrDriverBridgeRos::toMessage(const Finished& finished) const {
  ArmOutcome outcome;
  outcome.header.stamp = ros::Time::now();
  outcome.status = static_cast<std::uint8_t>(finished.verdict.status);
  outcome.message = finished.verdict.message;
  outcome.stage = finished.stage;
  outcome.is_holding = executor_.isHolding() ? 1 : 0;
  return outcome;
}

void UrDriverBridgeRos::finish(const Finished& finished) {
  if (!current_) return;
  const Request ended = std::move(*current_);
  current_.reset();
  {
    const std::lock_guard<std::mutex> lock(shared_mutex_);
    const std::string status = toString(finished.verdict.status);
    ++outcomes_[std::string(ended.name) + " " + status];
    if (!finished.verdict.isFine()) last_failure_ = status + ": " + finished.verdict.message;
  }
  if (!finished.verdict.isFine()) {
    ROS_WARN_NAMED(kLog, "%s ended in stage %s: %s: %s", ended.name, finished.stage.c_str(),
                   toString(finished.verdict.status), finished.verdict.message.c_str());
  }
  {
    // Before its sender hears of it, who may send the next one at once.
    const std::lock_guard<std::mutex> lock(requests_mutex_);
    is_busy_ = false;
  }
  ended.end(finished);
  idle_.notify_all();
}

// ---------------------------------------------------------------------------------------------------------- diagnostics

void UrDriverBridgeRos::diagnoseArm(diagnostic_updater::DiagnosticStatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const std::lock_guard<std::mutex> lock(shared_mutex_);
  const double silence_s = (ros::WallTime::now() - stepped_).toSec();
  if (stepped_.isZero() || silence_s > kMaxSilence_s) {
    status.summary(DiagnosticStatus::ERROR, "no joint states, and ROS time does not advance");
  } else if (shown_.may_move == 0) {
    status.summary(DiagnosticStatus::WARN, std::string("does not move: ") +
                                               toString(static_cast<ArmStatus>(shown_.gate)) + ": " + shown_.reason);
  } else {
    status.summary(DiagnosticStatus::OK, "may move");
  }
  status.add("modes", modes_);
  status.add("speed scaling", shown_.speed_scaling);
  status.add("magnet", shown_.is_magnet_on != 0 ? "on" : "off");
  status.add("holds a brick", shown_.is_holding != 0);
  status.add("force along the tool, N", shown_.force_along_tool);
}

void UrDriverBridgeRos::diagnoseRequests(diagnostic_updater::DiagnosticStatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const std::lock_guard<std::mutex> lock(shared_mutex_);
  status.summary(DiagnosticStatus::OK, shown_.stage.empty() ? "idle" : shown_.stage);
  for (const auto& [name, count] : outcomes_) status.add(name, count);
  if (!last_failure_.empty()) status.add("last failure", last_failure_);
}

}  // namespace ur_driver_bridge_ros
