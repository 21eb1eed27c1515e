// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning_ros/motion_planning_ros.h"

#include <algorithm>
#include <filesystem>
#include <limits>
#include <stdexcept>

#include <geometry_msgs/PoseStamped.h>
#include <interactive_mapping_common/formatted.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_msgs/BrickFace.h>
#include <mp700_ur5e_description/arm_pose.h>
#include <mp700_ur5e_description/robot_names.h>
#include <ros/console.h>

#include "motion_planning_ros/conversions.h"
#include "motion_planning_ros/robot_description.h"

namespace motion_planning_ros {
namespace {

using interactive_mapping::formatted;
using interactive_mapping_msgs::PathMonitorState;
using interactive_mapping_msgs::PlanOutcome;
using interactive_mapping_msgs::WatchTrajectory;
using motion_planning::ArmKinematics;
using motion_planning::ArmVector;
using motion_planning::JointTrajectory;
using motion_planning::PlanFailure;
using motion_planning::PlanStatus;
using mp700_ur5e_description::BrickFace;
using mp700_ur5e_description::RobotModel;
using ArmGoalMessage = interactive_mapping_msgs::ArmGoal;

constexpr double kQuietMap_s = 10.0;          // wall time without a mesh, after which the diagnostics warn
constexpr double kDiagnosticsPeriod_s = 1.0;  // wall time
constexpr int kLooksPerWarning = 5;           // at that period, while something is missing

std::map<std::string, ArmVector> loadPostures(const std::string& folder) {
  std::map<std::string, ArmVector> postures;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    if (entry.path().extension() != ".yaml") continue;
    postures[entry.path().stem().string()] = mp700_ur5e_description::loadArmPose(entry.path().string());
  }
  if (error) throw std::invalid_argument("postures_dir = '" + folder + "': " + error.message());
  if (postures.empty()) throw std::invalid_argument("postures_dir = '" + folder + "' holds no *.yaml");
  return postures;
}

/// Feedback that only has a stage.
template <typename Server>
std::function<void(const std::string&)> tellStage(const std::function<void(const typename Server::Feedback&)>& tell) {
  return [tell](const std::string& stage) {
    typename Server::Feedback feedback;
    feedback.stage = stage;
    tell(feedback);
  };
}

double msSince(const ros::WallTime& start) {
  return 1000.0 * (ros::WallTime::now() - start).toSec();
}

/// What `plan` returns, or the failure that it throws. Other exceptions are of the request: what it asks for cannot be.
template <typename Plan>
auto orFailure(Plan&& plan) -> decltype(plan()) {
  try {
    return plan();
  } catch (const PlanFailure& why) {
    return {why};
  } catch (const std::exception& error) {
    return {PlanFailure{PlanStatus::kBadRequest, error.what()}};
  }
}

/// What `load` gives; its complaint names the parameter that the file is from.
template <typename Load>
auto loadedFrom(const char* key, const std::string& file, Load&& load) -> decltype(load(file)) {
  try {
    return load(file);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(std::string(key) + " = '" + file + "':\n" + error.what());
  }
}

/// Frames that a brick can be placed at: they do not move against the robot's root.
std::string fixedFramesOf(const RobotModel& robot) {
  std::string names;
  for (const std::string& frame : robot.frameNames()) {
    if (robot.bodyOf(frame) == 0) names += (names.empty() ? "" : ", ") + frame;
  }
  return names;
}

std::string namesOf(const std::map<std::string, ArmVector>& postures) {
  std::string names;
  for (const auto& [name, joints] : postures) names += (names.empty() ? "" : ", ") + name;
  return names;
}

}  // namespace

MotionPlanningRos::MotionPlanningRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : params_(loadMotionPlanningParams(private_nh)),
      catalogue_(loadedFrom("bricks_file", params_.bricks_file, mp700_ur5e_description::loadBrickTypes)),
      postures_(loadPostures(params_.postures_dir)),
      kinematics_(kinematicsFromServer(nh)),
      sectors_(loadedFrom("sectors_file", params_.sectors_file,
                          [this](const std::string& file) {
                            return motion_planning::ManipulabilitySectors::load(file, kinematics_->robot());
                          })),
      planner_(std::make_shared<const motion_planning::MotionPlanner>(kinematics_, sectors_, params_.planner)),
      robot_(nh, kinematics_, params_, maxHeldEdge(catalogue_)),
      path_monitor_(params_.path_monitor),
      markers_([&] {
        ros::NodeHandle handle(private_nh);
        return PlanningMarkers(handle, params_.map_frame, kinematics_, params_.output.arm_markers);
      }()),
      diagnostics_(nh, private_nh) {
  const RobotModel& robot = kinematics_->robot();
  if (!robot.hasFrame(params_.view.camera_frame)) {
    throw std::invalid_argument("view/camera_frame = '" + params_.view.camera_frame + "', must be a link of the URDF");
  }
  if (!robot.hasFrame(params_.stow) && postures_.count(params_.stow) == 0) {
    throw std::invalid_argument("stow = '" + params_.stow +
                                "', must be a link of the URDF or a posture: " + namesOf(postures_));
  }
  if (postures_.count(params_.inspect_posture) == 0) {
    throw std::invalid_argument("inspect_posture = '" + params_.inspect_posture +
                                "', must be a posture: " + namesOf(postures_));
  }
  ROS_DEBUG_NAMED(kLog, "parameters:\n%s", interactive_mapping::toYaml(params_).c_str());

  ros::NodeHandle handle(private_nh);
  monitor_publisher_ = handle.advertise<PathMonitorState>("path_monitor", 10, true);
  scenes_ = std::make_unique<SceneKeeper>(nh, robot_, params_, [this](const MapScene& scene) {
    markers_.show(scene);
    monitor();
  });
  scenes_->start();
  watch_server_ = handle.advertiseService("watch", &MotionPlanningRos::onWatch, this);
  emptied_server_ = handle.advertiseService("container_emptied", &MotionPlanningRos::onContainerEmptied, this);
  monitor_timer_ = std::make_unique<interactive_mapping_ros::ClockTimer>(
      handle, ros::Duration(1.0 / params_.monitor.rate_hz), [this] {
        monitor();
        markers_.clearOldPlan(robot_);
        markers_.showLoad(robot_.load());
      });
  monitor();

  diagnostics_.setHardwareID("none");
  diagnostics_.add("map", this, &MotionPlanningRos::diagnoseMap);
  diagnostics_.add("robot", this, &MotionPlanningRos::diagnoseRobot);
  diagnostics_.add("plans", this, &MotionPlanningRos::diagnosePlans);
  // By the wall clock: a clock that stands still is something to report.
  diagnostics_timer_ =
      handle.createWallTimer(ros::WallDuration(kDiagnosticsPeriod_s), [this](const ros::WallTimerEvent&) {
        reportReadiness();
        diagnostics_.update();
      });

  live_ = std::make_unique<interactive_mapping_ros::LiveParams<MotionPlanningParams>>(
      private_nh, params_, [this](const MotionPlanningParams& params) {
        auto next = std::make_shared<const motion_planning::MotionPlanner>(kinematics_, sectors_, params.planner);
        const std::lock_guard<std::mutex> lock(planner_mutex_);
        planner_ = std::move(next);
      });
  pick_server_ = std::make_unique<PickServer>(
      handle, "plan_pick", [this](const auto& goal, const auto& started, const auto& is_cancelled, const auto& tell) {
        return planPick(goal, started, is_cancelled, tellStage<PickServer>(tell));
      });
  arm_server_ = std::make_unique<ArmServer>(
      handle, "plan_arm", [this](const auto& goal, const auto& started, const auto& is_cancelled, const auto& tell) {
        return planArm(goal, started, is_cancelled, tellStage<ArmServer>(tell));
      });
}

MotionPlanningRos::~MotionPlanningRos() {
  pick_server_.reset();
  arm_server_.reset();
  monitor_timer_.reset();
  watch_server_.shutdown();
  scenes_->stop();  // before it goes: its thread calls monitor(), which asks it
}

std::shared_ptr<const motion_planning::MotionPlanner> MotionPlanningRos::plannerInUse() const {
  const std::lock_guard<std::mutex> lock(planner_mutex_);
  return planner_;
}

motion_planning::PlanningContext MotionPlanningRos::makeContext(const std::vector<double>& start_rad,
                                                                const ros::Time& min_map_stamp,
                                                                const IsCancelled& is_cancelled,
                                                                std::uint64_t* map_update) {
  motion_planning::PlanningContext context;
  context.is_cancelled = is_cancelled;
  context.seed = failed_searches_;
  std::string why_not;
  const auto refuseMap = [&] {
    throw PlanFailure{is_cancelled() ? PlanStatus::kCancelled : PlanStatus::kNoMap, why_not};
  };
  // First: where arm and base are has to be as new as the map when planning begins.
  if (!awaitMap(min_map_stamp, is_cancelled, &why_not)) refuseMap();
  if (start_rad.empty()) {
    const std::optional<ArmVector> joints = robot_.arm(&why_not);
    if (!joints) throw PlanFailure{PlanStatus::kNoRobotState, why_not};
    context.start_rad = *joints;
  } else {
    context.start_rad = toArmVector(start_rad, "start");
  }
  const std::optional<Eigen::Isometry3d> T_map_base = robot_.base(&why_not);
  if (!T_map_base) throw PlanFailure{PlanStatus::kNoRobotState, why_not};
  context.T_map_base = *T_map_base;

  const std::string held_problem = robot_.heldProblem();
  if (!held_problem.empty()) {
    throw PlanFailure{PlanStatus::kNoRobotState, "what the magnet holds is not known: " + held_problem};
  }
  if (const std::optional<RobotState::Held> held = robot_.held()) {
    context.held = held->brick;
    for (const auto& type : catalogue_.types) {
      if (type.name == held->type) context.held->mass_kg = type.mass_kg;
    }
    context.vacated = held->vacated;
  }
  context.load = robot_.load();

  const std::shared_ptr<const MapScene> scene = scenes_->current(*T_map_base, is_cancelled, &why_not);
  if (!scene) refuseMap();
  if (scene->stamp < min_map_stamp) {  // loaded, or cleared, meanwhile
    why_not = "the map's newest image is of " + formatted("%.3f s", scene->stamp.toSec()) + ", asked for is one of " +
              formatted("%.3f s", min_map_stamp.toSec()) + " or later: it was newer before";
    refuseMap();
  }
  context.scene = scene->scene;
  *map_update = scene->map_update;
  return context;
}

bool MotionPlanningRos::awaitMap(const ros::Time& min_stamp, const IsCancelled& is_cancelled, std::string* why_not) {
  if (min_stamp.isZero() || scenes_->imageStamp() >= min_stamp) return true;
  const ros::Time due = ros::Time::now() + ros::Duration(params_.state.map_wait_s);
  const bool clock_runs = interactive_mapping_ros::waitUntil(due, params_.cost.stall_s, [&] {
    return scenes_->imageStamp() >= min_stamp || (is_cancelled && is_cancelled());
  });
  const ros::Time newest = scenes_->imageStamp();
  if (newest >= min_stamp) return true;
  if (is_cancelled && is_cancelled()) {
    *why_not = "cancelled while waiting for a newer map";
    return false;
  }
  *why_not = newest.isZero() ? "the map has taken in no image (" + scenes_->updateTopic() + ")"
                             : "the map's newest image is of " + formatted("%.3f s", newest.toSec());
  *why_not += ", asked for is one of " + formatted("%.3f s", min_stamp.toSec()) + " or later";
  *why_not += clock_runs ? " (waited " + formatted("%.3f s", params_.state.map_wait_s) + ", state/map_wait_s)"
                         : " (the clock has stood still for " + formatted("%.1f s", params_.cost.stall_s) + ")";
  return false;
}

void MotionPlanningRos::reportReadiness() {
  if (is_ready_) return;
  std::string missing;
  const auto lack = [&missing](const std::string& what) { missing += (missing.empty() ? "" : "; ") + what; };
  std::string why_not;
  if (!robot_.arm(&why_not)) lack(why_not);
  if (!robot_.base(&why_not)) lack(why_not);
  const std::shared_ptr<const MapScene> scene = scenes_->last();
  if (!scene) {
    const SceneKeeper::Counters counters = scenes_->counters();
    if (counters.images == 0) {
      lack("the map has taken in no image (" + scenes_->updateTopic() + ")");
    } else {
      lack("no scene of the map" + (counters.last_failure.empty() ? " yet" : ": " + counters.last_failure));
    }
  }
  if (missing.empty()) {
    is_ready_ = true;
    ROS_INFO_NAMED(kLog, "motion_planning is ready: arm and base are known, the map has %lu images and %zu triangles",
                   static_cast<unsigned long>(scene->map_update), scene->statistics.triangles);
  } else if (++looks_not_ready_ % kLooksPerWarning == 0) {
    ROS_WARN_NAMED(kLog, "motion_planning is not ready: %s", missing.c_str());
  }
}

Eigen::Isometry3d MotionPlanningRos::poseInMap(const geometry_msgs::PoseStamped& message, const std::string& what,
                                               const IsCancelled& is_cancelled) const {
  const std::optional<Eigen::Isometry3d> T_frame_pose = toIsometry(message.pose);
  if (!T_frame_pose) {
    throw PlanFailure{PlanStatus::kBadRequest, what + ": its pose is not finite or no rotation"};
  }
  std::string why_not;
  const std::optional<Eigen::Isometry3d> T_map_frame =
      robot_.frameInMap(message.header.frame_id, message.header.stamp, is_cancelled, &why_not);
  if (!T_map_frame) {
    const bool was_cancelled = is_cancelled && is_cancelled();
    throw PlanFailure{was_cancelled ? PlanStatus::kCancelled : PlanStatus::kBadRequest, what + ": " + why_not};
  }
  return *T_map_frame * *T_frame_pose;
}

motion_planning::ArmGoal MotionPlanningRos::placeGoal(const std::string& frame) const {
  const RobotModel& robot = kinematics_->robot();
  if (!robot.hasFrame(frame) || robot.bodyOf(frame) != 0) {
    throw PlanFailure{PlanStatus::kBadRequest, "place_frame = '" + frame + "', must be a link fixed to " +
                                                   robot.rootFrame() + ": " + fixedFramesOf(robot)};
  }
  motion_planning::ArmGoal goal;
  goal.place = motion_planning::PlaceGoal{robot.poseInBody(frame), params_.place_above_m};
  return goal;
}

motion_planning::ArmGoal MotionPlanningRos::toArmGoal(const ArmGoalMessage& message,
                                                      const IsCancelled& is_cancelled) const {
  motion_planning::ArmGoal goal;
  switch (message.kind) {
    case ArmGoalMessage::POSTURE: {
      const auto found = postures_.find(message.posture);
      if (found == postures_.end()) {
        throw PlanFailure{PlanStatus::kBadRequest,
                          "posture = '" + message.posture + "', must be one of: " + namesOf(postures_)};
      }
      goal.joints_rad = found->second;
      break;
    }
    case ArmGoalMessage::JOINTS:
      goal.joints_rad = toArmVector(message.joints, "a goal");
      break;
    case ArmGoalMessage::TIP:
      goal.T_map_tip = poseInMap(message.tip, "tip", is_cancelled);
      break;
    case ArmGoalMessage::PLACE:
      goal = placeGoal(withoutSlash(message.place_frame));
      break;
    default:
      throw PlanFailure{PlanStatus::kBadRequest,
                        "kind = " + std::to_string(message.kind) + " of a goal, must be in [0, 3]"};
  }
  goal.keep_level = message.any_tilt == 0;
  return goal;
}

void MotionPlanningRos::charge(double cost_s, const ros::Time& started, const IsCancelled& is_cancelled) {
  if (!interactive_mapping_ros::charge(cost_s, started, params_.cost.stall_s, is_cancelled)) {
    ROS_WARN_NAMED(kLog,
                   "the clock has stood still for %.1f s: a plan is not held back for its cost of %.2f s. Is the "
                   "clock's rule for planning shorter than cost/pick_s or cost/arm_s?",
                   params_.cost.stall_s, cost_s);
  }
}

void MotionPlanningRos::note(const std::string& what, const PlanOutcome& outcome, double wall_ms) {
  const bool is_success = outcome.status == PlanOutcome::SUCCESS;
  // Asked again, the same search would fail again.
  if (outcome.status == PlanOutcome::ITERATIONS) ++failed_searches_;
  if (is_success) failed_searches_ = 0;
  const std::string status = toString(static_cast<PlanStatus>(outcome.status));
  {
    const std::lock_guard<std::mutex> lock(report_mutex_);
    ++outcomes_[status];
    slowest_ms_ = std::max(slowest_ms_, wall_ms);
    if (!is_success) last_failure_ = what + ": " + status + ", " + outcome.message;
  }
  if (is_success) {
    ROS_INFO_NAMED(kLog, "%s: planned in %.0f ms", what.c_str(), wall_ms);
  } else {
    ROS_INFO_NAMED(kLog, "%s: %s, %s (%.0f ms)", what.c_str(), status.c_str(), outcome.message.c_str(), wall_ms);
  }
}

template <class Plan, class Result>
void MotionPlanningRos::finish(const std::string& what, const Plan& plan,
                               const std::optional<Eigen::Isometry3d>& T_map_base, const ros::WallTime& wall_start,
                               double cost_s, Result* result) {
  if (!plan) result->outcome = toMessage(plan.failure());
  if (T_map_base && plan) markers_.show(*plan, *T_map_base);
  if (T_map_base && !plan) markers_.showFailure(plan.failure().message, *T_map_base);
  const double wall_ms = msSince(wall_start);
  result->wall_ms = static_cast<float>(wall_ms);
  result->cost = ros::Time::isSystemTime() ? 0.0 : cost_s;
  note(what, result->outcome, wall_ms);
}

/// That of the parameter `stow`.
motion_planning::ArmGoal MotionPlanningRos::defaultStowGoal() const {
  const auto posture = postures_.find(params_.stow);
  if (posture == postures_.end()) return placeGoal(params_.stow);
  motion_planning::ArmGoal goal;
  goal.joints_rad = posture->second;
  return goal;
}

MotionPlanningRos::PickServer::Result MotionPlanningRos::planPick(const PickServer::Goal& goal,
                                                                  const ros::Time& started,
                                                                  const IsCancelled& is_cancelled,
                                                                  const std::function<void(const std::string&)>& tell) {
  const ros::WallTime wall_start = ros::WallTime::now();
  PickServer::Result result;
  std::optional<Eigen::Isometry3d> T_map_base;
  const auto [plan, tried] = orFailure([&, planner = plannerInUse()] {
    motion_planning::PickTarget target;
    target.brick_id = goal.brick_id;
    target.type = &catalogue_.type(goal.type);
    for (const std::uint8_t face : goal.faces) {
      if (face >= mp700_ur5e_description::kNumBrickFaces) {
        throw PlanFailure{PlanStatus::kBadRequest, "face " + std::to_string(face) + ", must be in [0, 5]"};
      }
      target.faces.push_back(static_cast<BrickFace>(face));
    }
    target.T_map_brick = poseInMap(goal.brick, "brick", is_cancelled);
    std::vector<motion_planning::ArmGoal> stow;
    for (const ArmGoalMessage& message : goal.stow) stow.push_back(toArmGoal(message, is_cancelled));
    if (stow.empty()) stow.push_back(defaultStowGoal());
    tell("waiting for the newest map");
    motion_planning::PlanningContext context =
        makeContext(goal.start, goal.min_map_stamp, is_cancelled, &result.map_update);
    T_map_base = context.T_map_base;
    const std::optional<RobotState::Held> held = robot_.held();
    if (held && goal.after_let_go == 0) {
      throw PlanFailure{PlanStatus::kBadRequest, "the magnet holds brick " + std::to_string(held->id) +
                                                     ": it has to be let go before another is picked"};
    }
    if (held) addToLoad(*kinematics_, context.start_rad, held->brick, &context.load);
    context.held.reset();  // by then it is let go, and the map has seen past its old place
    context.vacated.reset();
    tell("planning");
    return planner->planPick(context, target, stow);
  });
  for (const auto& [face, failure] : tried) {
    interactive_mapping_msgs::FaceOutcome outcome;
    outcome.face = static_cast<std::uint8_t>(face);
    outcome.outcome = toMessage(failure);
    result.tried.push_back(outcome);
  }
  if (plan) {
    result.face = static_cast<std::uint8_t>(plan->face);
    result.contact.header.frame_id = params_.map_frame;
    result.contact.header.stamp = started.isZero() ? ros::Time::now() : started;
    result.contact.pose = toPose(plan->T_map_contact);
    result.held = toPose(plan->held.T_tip_brick);
    result.approach = toMessage(plan->approach);
    result.touch = toMessage(plan->contact);
    result.lift = toMessage(plan->lift);
    result.stow = toMessage(plan->stow);
  }
  const std::string face = plan ? std::string(" by face ") + toString(plan->face) : "";
  finish("pick of brick " + std::to_string(goal.brick_id) + face, plan, T_map_base, wall_start, params_.cost.pick_s,
         &result);
  charge(params_.cost.pick_s, started, is_cancelled);
  return result;
}

MotionPlanningRos::ArmServer::Result MotionPlanningRos::planArm(const ArmServer::Goal& goal, const ros::Time& started,
                                                                const IsCancelled& is_cancelled,
                                                                const std::function<void(const std::string&)>& tell) {
  const ros::WallTime wall_start = ros::WallTime::now();
  ArmServer::Result result;
  result.goal = -1;
  std::optional<Eigen::Isometry3d> T_map_base;
  const auto plan = orFailure([&, planner = plannerInUse()]() -> motion_planning::Result<JointTrajectory> {
    if (!goal.inspect && goal.goals.empty()) {
      throw PlanFailure{PlanStatus::kBadRequest, "no goals, must be at least one unless inspect is set"};
    }
    std::vector<motion_planning::ArmGoal> goals;
    for (const ArmGoalMessage& message : goal.goals) goals.push_back(toArmGoal(message, is_cancelled));
    tell("waiting for the newest map");
    const motion_planning::PlanningContext context =
        makeContext(goal.start, goal.min_map_stamp, is_cancelled, &result.map_update);
    T_map_base = context.T_map_base;
    if (goal.inspect) {
      tell("planning to a posture out of the camera's view");
      motion_planning::ViewFrustum view;
      view.T_base_camera =
          kinematics_->robot().framePose(params_.view.camera_frame, kinematics_->robotPositions(context.start_rad));
      view.half_width_rad = params_.view.half_width_rad;
      view.half_height_rad = params_.view.half_height_rad;
      view.max_range_m = params_.view.range_m;
      return planner->planInspect(context, view, {postures_.at(params_.inspect_posture)});
    }
    for (std::size_t i = 0;; ++i) {
      tell("planning to goal " + std::to_string(i + 1) + " of " + std::to_string(goals.size()));
      auto found = planner->planArm(context, goals[i]);
      if (found) result.goal = static_cast<std::int32_t>(i);
      // What is wrong with the start is wrong with all goals.
      if (found || i + 1 == goals.size() || found.failure().status == PlanStatus::kCancelled ||
          found.failure().status == PlanStatus::kStartInCollision) {
        return found;
      }
    }
  });
  if (plan) result.trajectory = toMessage(*plan);
  finish(goal.inspect ? "inspect" : "arm", plan, T_map_base, wall_start, params_.cost.arm_s, &result);
  charge(params_.cost.arm_s, started, is_cancelled);
  return result;
}

bool MotionPlanningRos::onContainerEmptied(std_srvs::Trigger::Request& /*request*/,
                                           std_srvs::Trigger::Response& response) {
  robot_.emptied();
  response.success = 1;
  return true;
}

bool MotionPlanningRos::onWatch(WatchTrajectory::Request& request, WatchTrajectory::Response& response) {
  try {
    motion_planning::JointTrajectory trajectory;
    if (!request.trajectory.points.empty()) trajectory = fromMessage(request.trajectory);
    Watch watch;
    watch.start = request.start.isZero() ? ros::Time::now() : request.start;
    if (request.phase > WatchTrajectory::Request::LIFT) {
      throw std::invalid_argument("phase = " + std::to_string(request.phase) + ", must be in [0, 2]");
    }
    const double ago_s = (ros::Time::now() - watch.start).toSec();
    if (!trajectory.empty() && ago_s > trajectory.duration()) {
      throw std::invalid_argument("start is " + formatted("%.3f s", ago_s) + " ago, the trajectory lasts " +
                                  formatted("%.3f s", trajectory.duration()) + ": it has ended");
    }
    if (request.phase != WatchTrajectory::Request::FREE) {
      motion_planning::OrientedBox target;
      target.T_map_box = poseInMap(request.target, "target", nullptr);
      target.size_m = {request.target_size.x, request.target_size.y, request.target_size.z};
      if (!target.size_m.allFinite() || target.size_m.minCoeff() <= 0.0) {
        throw std::invalid_argument("target_size must be three lengths above 0 m");
      }
      watch.target = target;
    }
    if (!trajectory.empty() && !scenes_->follow(true)) {  // the last scene may be of long ago
      std::string why_not;
      const std::optional<Eigen::Isometry3d> T_map_base = robot_.base(&why_not);
      if (T_map_base) scenes_->current(*T_map_base, nullptr, &why_not);  // what fails, monitor() tells
    }
    {
      const std::lock_guard<std::mutex> lock(monitor_mutex_);
      if (trajectory.empty()) {
        path_monitor_.stop();
        watch_.reset();
      } else {
        watch.id = ++num_watches_;
        watch.duration_s = trajectory.duration();
        watch.first_rad = motion_planning::firstPostures(*kinematics_, trajectory);
        path_monitor_.start(std::move(trajectory), kinematics_);
        watch_ = watch;
        response.watch_id = watch.id;
      }
    }
    monitor();
    response.success = 1;
  } catch (const PlanFailure& why) {
    response.message = why.message;
  } catch (const std::invalid_argument& error) {
    response.message = error.what();
  }
  if (response.success == 0) {
    // What runs while its successor is refused is still in need of a watch.
    const std::lock_guard<std::mutex> lock(monitor_mutex_);
    response.watch_id = watch_ ? watch_->id : 0;
    response.message += watch_ ? "; watch " + std::to_string(watch_->id) + " continues" : "; nothing is watched";
  }
  return true;
}

void MotionPlanningRos::monitor() {
  const std::lock_guard<std::mutex> lock(monitor_mutex_);
  PathMonitorState state;
  state.header.frame_id = params_.map_frame;
  state.header.stamp = ros::Time::now();
  state.clearance = std::numeric_limits<float>::quiet_NaN();
  state.time_to_contact = std::numeric_limits<float>::infinity();
  if (watch_) {
    const double elapsed_s = (state.header.stamp - watch_->start).toSec();
    state.watch_id = watch_->id;
    if (elapsed_s > watch_->duration_s) {
      path_monitor_.stop();
      watch_.reset();
    } else {
      state.is_watching = 1;
      const std::shared_ptr<const MapScene> scene = scenes_->last();
      std::string why_not = scene ? scenes_->problem() : "no map has come";
      const std::optional<Eigen::Isometry3d> T_map_base = robot_.base(&why_not);
      if (why_not.empty()) {
        motion_planning::Watched watched;
        watched.target = watch_->target;
        watched.first_rad = watch_->first_rad;
        if (const std::optional<RobotState::Held> held = robot_.held()) {
          watched.held = held->brick;
          watched.vacated = held->vacated;
        }
        const motion_planning::WatchCheckers checkers =
            motion_planning::watchCheckers(kinematics_, scene->watched, *T_map_base, params_.watchedRobot(), watched);
        const motion_planning::PathVerdict verdict = path_monitor_.check(std::max(0.0, elapsed_s), checkers.from_start,
                                                                         checkers.beyond ? &*checkers.beyond : nullptr);
        state.must_stop = verdict.must_stop ? 1 : 0;
        state.reason = verdict.reason;
        state.clearance = static_cast<float>(verdict.clearance_m);
        state.time_to_contact = static_cast<float>(verdict.time_to_contact_s);
        state.map_update = scene->map_update;
      } else {
        // Not knowing is no reason to go on.
        state.must_stop = 1;
        state.reason = why_not;
        state.time_to_contact = 0.0F;
      }
    }
  }
  scenes_->follow(watch_.has_value() || markers_.isSceneShown());
  // Also when nothing is watched: a simulated clock may wait for it.
  monitor_publisher_.publish(state);
}

void MotionPlanningRos::diagnoseMap(diagnostic_updater::DiagnosticStatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const SceneKeeper::Counters counters = scenes_->counters();
  const std::string problem = scenes_->problem();
  const std::shared_ptr<const MapScene> last = scenes_->last();
  if (counters.images == 0) {
    status.summary(DiagnosticStatus::WARN, "the map has taken in no image");
  } else if (!problem.empty()) {
    status.summary(DiagnosticStatus::ERROR, problem);
  } else if (const double age_s = (ros::WallTime::now() - counters.last_image).toSec(); age_s > kQuietMap_s) {
    status.summary(DiagnosticStatus::WARN, formatted("the map took in its last image %.0f s ago", age_s));
  } else {
    status.summary(DiagnosticStatus::OK, "follows the map");
  }
  status.add("images since the start", counters.images);
  status.add("scenes", counters.scenes);
  if (!last) return;
  status.add("images in the map", last->map_update);
  status.add("chunks", last->statistics.chunks);
  status.add("chunks rebuilt", last->statistics.chunks_rebuilt);
  status.add("triangles", last->statistics.triangles);
  status.add("bad triangles", last->statistics.degenerate);
  status.add("unknown blocks", last->statistics.blocks_unknown);
  status.add("surface, ms", last->statistics.mesh_ms);
  status.add("lattice, ms", last->statistics.lattice_ms);
}

void MotionPlanningRos::diagnoseRobot(diagnostic_updater::DiagnosticStatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  std::string why_not;
  const std::string held_problem = robot_.heldProblem();
  const std::optional<RobotState::Held> held = robot_.held();
  if (!robot_.arm(&why_not) || !robot_.base(&why_not)) {
    status.summary(DiagnosticStatus::WARN, why_not);
  } else if (!held_problem.empty()) {
    status.summary(DiagnosticStatus::ERROR, "attached brick: " + held_problem);
  } else {
    status.summary(DiagnosticStatus::OK, held ? "holds brick " + std::to_string(held->id) : "arm and base are known");
  }
}

void MotionPlanningRos::diagnosePlans(diagnostic_updater::DiagnosticStatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const std::lock_guard<std::mutex> lock(report_mutex_);
  status.summary(DiagnosticStatus::OK, outcomes_.empty() ? "nothing planned yet" : "ready");
  for (const auto& [outcome, count] : outcomes_) status.add(outcome, count);
  status.add("slowest, ms", slowest_ms_);
  if (!last_failure_.empty()) status.add("last failure", last_failure_);
}

}  // namespace motion_planning_ros
