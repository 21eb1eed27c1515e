// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission_ros/mission_actions.h"

#include <cmath>
#include <stdexcept>
#include <utility>

#include <interactive_mapping_common_ros/poses.h>
#include <motion_planning_ros/conversions.h>
#include <motion_planning_ros/robot_description.h>
#include <mp700_ur5e_description/robot_names.h>
#include <ros/console.h>

namespace pick_mission_ros {

using interactive_mapping_msgs::MapUpdate;
using interactive_mapping_msgs::NavigationOutcome;
using interactive_mapping_msgs::NbvSegment;
using interactive_mapping_ros::withoutSlash;
using pick_mission::ArmResult;
using pick_mission::ArmStatus;
using pick_mission::Hand;
using pick_mission::PlanResult;
using pick_mission::PlanStatus;
namespace command = pick_mission::command;

namespace {

/// What a result is followed by comes on another topic; wall time until it is done without.
constexpr double kFollowUp_s = 2.0;
/// Share of the way to the container after which arm and brick hide little of the pile: they began above it.
constexpr double kAway = 0.25;
constexpr double kMagnetLag_s = 0.5;  // ROS time; a driver tells of its outputs at 10 Hz or more
/// That clocks of two computers, or of two nodes that hear a simulated one, may differ.
constexpr double kClocksApart_s = 0.5;
/// Goals are told back as they were given, but for the rounding of yaw to a quaternion.
constexpr double kSameGoal_m = 1e-3;

std::shared_ptr<const motion_planning::ArmKinematics> kinematicsOf(const ros::NodeHandle& nh) {
  return motion_planning_ros::kinematicsFromServer(nh);
}

/// Of a goal that has not succeeded, with an outcome that has.
std::string contradiction(bool is_cancelled, const std::string& why) {
  return "the goal has " + std::string(is_cancelled ? "been cancelled" : "failed") +
         ", and its outcome gives no reason" + (why.empty() ? "" : ": " + why);
}

ros::NodeHandle withQueue(const ros::NodeHandle& nh, ros::CallbackQueue* queue) {
  ros::NodeHandle handle(nh);
  handle.setCallbackQueue(queue);
  return handle;
}

}  // namespace

MissionActions::MissionActions(const ros::NodeHandle& nh, const PickMissionParams& params, ros::CallbackQueue* queue,
                               std::shared_ptr<Inbox> inbox, Post post, OnSelection on_selection)
    : params_(params),
      arm_(kinematicsOf(nh)),
      sectors_(motion_planning::ManipulabilitySectors::load(params.sectors_file, arm_->robot())),
      T_base_armbase_(arm_->robot().framePose(mp700_ur5e_description::kArmBaseFrame,
                                              arm_->robotPositions(motion_planning::ArmVector::Zero()))),
      post_(std::move(post)),
      on_selection_(std::move(on_selection)),
      tf_listener_(tf_, true, ros::TransportHints().tcpNoDelay()),
      plan_arm_(nh, params.nodes.planner + "/plan_arm", queue),
      plan_pick_(nh, params.nodes.planner + "/plan_pick", queue),
      move_arm_(nh, params.nodes.bridge + "/move", queue),
      pick_(nh, params.nodes.bridge + "/pick", queue),
      let_go_(nh, params.nodes.bridge + "/let_go", queue),
      recover_(nh, params.nodes.bridge + "/recover", queue),
      select_(nh, params.nodes.selection + "/select", queue),
      drive_(nh, params.nodes.move_base, queue),
      detect_(nh, params.nodes.detection + "/detect", inbox),
      report_(nh, params.nodes.selection + "/report_failure", inbox),
      hold_(nh, params.nodes.bridge + "/hold", inbox),
      release_(nh, params.nodes.bridge + "/release", inbox) {
  ros::NodeHandle handle = withQueue(nh, queue);
  const ros::TransportHints no_delay = ros::TransportHints().tcpNoDelay();
  subscribers_ = {
      handle.subscribe(params.nodes.bridge + "/state", 10, &MissionActions::onBridgeState, this, no_delay),
      handle.subscribe("attached_brick", 5, &MissionActions::onAttached, this, no_delay),
      handle.subscribe(params.nodes.map + "/update", 20, &MissionActions::onMapUpdate, this, no_delay),
      handle.subscribe(params.nodes.detection + "/bricks", 2, &MissionActions::onBricks, this, no_delay),
      handle.subscribe(params.nodes.navigation + "/outcome", 5, &MissionActions::onNavigationOutcome, this, no_delay),
      handle.subscribe(params.nodes.move_base + "/status", 5, &MissionActions::onDriveStatus, this, no_delay),
  };
  // Of a process before this one: nobody would hear how they end, nor stop them. Letting go and recovering do not move the
  // arm, and are better finished; their server says that it is busy until then.
  drive_.cancelAll();
  move_arm_.cancelAll();
  pick_.cancelAll();
}

bool MissionActions::areOldGoalsCancelled() const {
  return !drive_.isCancelAllWanted() && !move_arm_.isCancelAllWanted() && !pick_.isCancelAllWanted() &&
         !may_base_drive_;
}

// --- The robot as it is -----------------------------------------------------------------------------------------------

Eigen::Isometry3d MissionActions::baseInMap() const {
  geometry_msgs::TransformStamped transform;
  try {
    transform = tf_.lookupTransform(params_.map_frame, params_.base_frame, ros::Time(0));
  } catch (const tf2::TransformException& error) {
    throw std::runtime_error(std::string("tf has no pose of the robot: ") + error.what());
  }
  const double age_s = (ros::Time::now() - transform.header.stamp).toSec();
  if (age_s < -params_.input.max_tf_age_s) {
    // On its way when the clock jumped back, it came after tf2 had forgotten what was before. As long as it is there, tf2 takes
    // all that is newer for too old.
    tf_.clear();
    throw std::runtime_error("tf from " + params_.map_frame + " to " + params_.base_frame + " is from the future, by " +
                             std::to_string(-age_s) + " s: of before the clock jumped back");
  }
  if (age_s > params_.input.max_tf_age_s) {
    throw std::runtime_error("tf from " + params_.map_frame + " to " + params_.base_frame + " is " +
                             std::to_string(age_s) + " s old, must be at most " +
                             std::to_string(params_.input.max_tf_age_s) + " s (input/max_tf_age_s)");
  }
  const auto T = interactive_mapping_ros::toIsometry(transform.transform);
  if (!T) throw std::runtime_error("tf from " + params_.map_frame + " to " + params_.base_frame + " is not finite");
  return *T;
}

Hand MissionActions::hand() const {
  if (!bridge_) return Hand::kUnknown;
  // From the future: of before the clock jumped back.
  if (std::abs((ros::Time::now() - bridge_->header.stamp).toSec()) > params_.input.max_bridge_age_s) {
    return Hand::kUnknown;
  }
  return bridge_->is_holding || bridge_->is_magnet_on ? Hand::kHolding : Hand::kEmpty;
}

pick_mission::event::Start MissionActions::start() const {
  pick_mission::event::Start start;
  start.T_map_base = interactive_mapping_ros::toPlane(baseInMap());
  start.hand = hand();
  if (attached_ && attached_->is_attached) start.brick_in_hand = attached_->id;
  return start;
}

std::optional<pick_mission::Pose2d> MissionActions::place() const {
  try {
    return interactive_mapping_ros::toPlane(baseInMap());
  } catch (const std::runtime_error&) {
    return std::nullopt;
  }
}

std::vector<std::string> MissionActions::missing() {
  std::vector<std::string> missing;
  try {
    baseInMap();
  } catch (const std::runtime_error& error) {
    missing.emplace_back(error.what());
  }
  if (hand() == Hand::kUnknown) missing.emplace_back("the state of the arm's bridge");
  if (map_stamp_.isZero()) missing.emplace_back("a first image in the map");
  // Another mission would not know of it, and not release it.
  if (is_hold_lost_ || (is_hold_wanted_ && hold_.isActive())) {
    missing.emplace_back("a resume after the hold that the arm's bridge has not taken");
  }
  const auto need = [&missing](auto& server, bool is_there) {
    if (!is_there) missing.push_back("the server " + server.name());
  };
  forActions([&](auto& action) { need(action, action.isConnected()); });
  forServices([&](auto& service) { need(service, service.exists()); });
  return missing;
}

void MissionActions::tellHand() {
  const Hand now = hand();
  if (now == told_hand_) return;
  told_hand_ = now;
  pick_mission::event::HandReport report;
  report.hand = now;
  if (now == Hand::kHolding && attached_ && attached_->is_attached) report.brick_in_hand = attached_->id;
  post_(report);
}

// --- Answers ----------------------------------------------------------------------------------------------------------

void MissionActions::reply(std::uint64_t id, pick_mission::Result result, std::string message,
                           std::optional<Hand> hand) {
  if (carrying_ == id) {
    carrying_.reset();
    pending_arm_.reset();
  } else if (running_ == id) {
    forgetWork();
  } else {
    return;
  }
  pick_mission::event::Reply reply;
  reply.id = id;
  reply.result = std::move(result);
  reply.message = std::move(message);
  reply.hand = hand;
  post_(reply);
}

void MissionActions::cancel() {
  forActions([](auto& action) { action.cancel(); });
  // These have nothing to cancel; what they would answer is not wanted.
  if (look_) {
    reply(pick_mission::LookResult{pick_mission::LookStatus::kCancelled, look_->map_stamp_s}, "cancelled");
  } else if (wait_) {
    reply(pick_mission::WaitResult{pick_mission::WaitStatus::kCancelled}, "cancelled", hand());
  } else if (detect_.isActive() || pending_detection_) {
    detect_.forget();
    noAnswer("cancelled");
  } else if (report_.isActive()) {
    report_.forget();
    noAnswer("cancelled");
  }
}

/// Whatever an earlier action still does, it ends, and does not answer for the next one.
void MissionActions::abandon(bool keeps_pick) {
  if (keeps_pick && !carrying_) carrying_ = running_;
  if (!keeps_pick) carrying_.reset();
  forActions([&](auto& action) {
    if (!keeps_pick || static_cast<const void*>(&action) != &pick_) action.abandon();
  });
  detect_.forget();
  report_.forget();
  forgetWork();
}

void MissionActions::forgetWork() {
  running_.reset();
  if (!carrying_) pending_arm_.reset();
  pending_detection_.reset();
  pending_drive_.reset();
  look_.reset();
  wait_.reset();
  drive_goal_.reset();
  drive_outcome_.reset();
}

void MissionActions::watch() {
  forActions([&](auto& action) { action.watch(ros::WallDuration(params_.servers.timeout_s)); });
  forServices([](auto& service) { service.watch(); });

  const ros::Time now = ros::Time::now();
  // A clock that was set back: from now on, once more.
  if (look_ && now < look_->since) {
    look_->deadline -= look_->since - now;
    look_->since = now;
    look_->seen = 0;
  }
  if (wait_ && now < wait_->since) {
    wait_->deadline -= wait_->since - now;
    wait_->since = now;
  }
  if (look_ && now >= look_->deadline) {
    reply(pick_mission::LookResult{pick_mission::LookStatus::kNoImage, look_->map_stamp_s},
          std::to_string(look_->seen) + " of " + std::to_string(look_->images) + " images came into the map within " +
              std::to_string((look_->deadline - look_->since).toSec()) + " s" +
              (look_->refused.empty() ? "" : "; the last one was refused: " + look_->refused));
  }
  using pick_mission::WaitUntil;
  if (wait_ && wait_->until == WaitUntil::kPlaceKnown && now >= wait_->since + wait_->at_least && place()) {
    reply(pick_mission::WaitResult{pick_mission::WaitStatus::kSuccess}, "", hand());
  }
  if (wait_ && now >= wait_->deadline) {
    if (wait_->until == WaitUntil::kArmReady) {
      reply(pick_mission::WaitResult{pick_mission::WaitStatus::kNotReady},
            bridge_ ? "the arm may not move: " + bridge_->reason : "the arm's bridge reports nothing", hand());
    } else {
      const bool is_lost = wait_->until == WaitUntil::kPlaceKnown;
      reply(pick_mission::WaitResult{pick_mission::WaitStatus::kSuccess},
            is_lost ? "still not known where the robot is" : "", hand());
    }
  }
  const ros::SteadyTime wall = ros::SteadyTime::now();
  if (pending_arm_ && (wall - pending_arm_->since).toSec() > kFollowUp_s) {
    // The bridge has fallen silent: what hangs on the magnet is not known.
    const PendingArm arm = *pending_arm_;
    told_hand_ = Hand::kUnknown;
    reply(arm.id, ArmResult{arm.status, arm.is_lost_over_robot}, arm.message, Hand::kUnknown);
  }
  if (pending_detection_ && (wall - pending_detection_->since).toSec() > kFollowUp_s) {
    noAnswer("the detection has looked, but its list of bricks does not come");
  }
  if (pending_drive_ && (wall - pending_drive_->since).toSec() > kFollowUp_s) finishDrive(nullptr);
  tellHand();
}

void MissionActions::shiftTimes(ros::Duration by) {
  if (look_) {
    look_->since += by;
    look_->deadline += by;
  }
  if (wait_) {
    wait_->since += by;
    wait_->deadline += by;
  }
}

// --- Commands ---------------------------------------------------------------------------------------------------------

void MissionActions::carryOut(const pick_mission::Command& next) {
  if (!pick_mission::isControl(next)) {
    abandon(next.is_beside_pick);
    running_ = next.id;
  }
  std::visit([this](const auto& body) { begin(body); }, next.body);
}

template <typename Action, typename OnResult>
void MissionActions::sendPlan(ActionCaller<Action>* caller, const typename ActionCaller<Action>::Goal& goal,
                              OnResult on_result) {
  const std::uint64_t id = *running_;
  caller->send(goal, [this, id, on_result](const typename ActionCaller<Action>::End& end) {
    const auto noAnswer = [&](const std::string& why) { reply(id, pick_mission::NoAnswer{}, why); };
    if (!end.result) return noAnswer(end.why);
    // Results that nobody filled in, as of a goal that was dropped for another, have the value of success.
    if (end.result->outcome.status == 0 && !end.is_succeeded) return noAnswer(contradiction(end.is_cancelled, end.why));
    try {
      on_result(*end.result);
    } catch (const std::invalid_argument& error) {
      noAnswer(std::string("an invalid answer: ") + error.what());
    }
  });
}

void MissionActions::begin(const command::PlanArm& plan) {
  interactive_mapping_msgs::PlanArmGoal goal;
  goal.inspect = plan.place.empty();
  if (!goal.inspect) goal.goals = {placeGoal(plan.place)};
  const std::uint64_t id = *running_;
  sendPlan(&plan_arm_, goal, [this, id](const interactive_mapping_msgs::PlanArmResult& result) {
    arm_plan_ = result;
    arm_plan_id_ = id;
    const auto status =
        statusFrom<PlanStatus>(result.outcome.status, interactive_mapping::kNumPlanStatus, "outcome of plan_arm");
    reply(PlanResult{status}, result.outcome.message);
  });
}

void MissionActions::begin(const command::PlanPick& plan) {
  const std::uint64_t id = *running_;
  interactive_mapping_msgs::PlanPickGoal goal = toGoal(plan, params_.map_frame);
  if (plan.is_after_pick) {
    goal.start = pick_end_rad_;
    goal.after_let_go = 1;
  }
  sendPlan(&plan_pick_, goal, [this, id](const interactive_mapping_msgs::PlanPickResult& result) {
    pick_plan_ = result;
    pick_plan_id_ = id;
    const auto status =
        statusFrom<PlanStatus>(result.outcome.status, interactive_mapping::kNumPlanStatus, "outcome of plan_pick");
    reply(PlanResult{status, result.face}, result.outcome.message);
  });
}

template <typename Action>
void MissionActions::sendArm(ActionCaller<Action>* caller, const typename ActionCaller<Action>::Goal& goal,
                             bool lets_go) {
  const std::uint64_t id = *running_;
  sendPlan(caller, goal, [this, id, lets_go](const auto& result) {
    const ArmOutcome& outcome = result.outcome;
    PendingArm arm;
    arm.id = id;
    arm.status = statusFrom<ArmStatus>(outcome.status, interactive_mapping::kNumArmStatus, "outcome of the arm");
    arm.message = outcome.message;
    const bool is_at_pile =
        outcome.stage == "payload" || outcome.stage == "lift";  // the stages of a pick before "stow"
    arm.is_lost_over_robot = arm.status == ArmStatus::kLostOnTheWay && !is_at_pile;
    arm.stamp = outcome.header.stamp;
    arm.since = ros::SteadyTime::now();
    arm.lets_go = lets_go;
    pending_arm_ = arm;
    finishArm();
  });
}

/// What hangs on the magnet, the bridge tells with each step: one that is newer than the outcome, for one as old may be
/// of just before it.
void MissionActions::finishArm() {
  if (!pending_arm_ || !bridge_ || bridge_->header.stamp <= pending_arm_->stamp) return;
  const PendingArm arm = *pending_arm_;
  // The driver tells that the magnet's output is off some steps after it was switched.
  const bool has_let_go = arm.lets_go && arm.status == ArmStatus::kSuccess;
  const double after_s = (bridge_->header.stamp - arm.stamp).toSec();
  if (has_let_go && hand() == Hand::kHolding && after_s < kMagnetLag_s) return;
  const Hand now = hand();
  told_hand_ = now;
  reply(arm.id, ArmResult{arm.status, arm.is_lost_over_robot}, arm.message, now);
}

void MissionActions::begin(const command::MoveArm& move) {
  if (move.plan != arm_plan_id_) {
    return reply(ArmResult{ArmStatus::kBadRequest}, "plan " + std::to_string(move.plan) + " is not kept");
  }
  interactive_mapping_msgs::MoveArmGoal goal;
  goal.trajectory = arm_plan_.trajectory;
  sendArm(&move_arm_, goal, false);
}

void MissionActions::begin(const command::Pick& pick) {
  if (pick.plan != pick_plan_id_) {
    return reply(ArmResult{ArmStatus::kBadRequest}, "plan " + std::to_string(pick.plan) + " is not kept");
  }
  const auto& stow = pick_plan_.stow.points;
  pick_end_rad_ = stow.empty() ? std::vector<double>() : stow.back().positions;
  sendArm(&pick_, toGoal(pick.brick, params_.map_frame, pick_plan_), true);
}

void MissionActions::begin(const command::LetGo& /*let_go*/) {
  sendArm(&let_go_, interactive_mapping_msgs::LetGoBrickGoal(), true);
}

void MissionActions::begin(const command::Recover& recover) {
  interactive_mapping_msgs::RecoverArmGoal goal;
  goal.unlock_protective_stop = recover.unlocks_protective_stop;
  sendArm(&recover_, goal, false);
}

void MissionActions::begin(const command::Look& look) {
  LookWork work;
  work.images = look.images;
  work.since = ros::Time::now();
  work.deadline = work.since + ros::Duration(look.timeout_s);
  look_ = work;
}

void MissionActions::begin(const command::Wait& wait) {
  WaitWork work;
  work.until = wait.until;
  work.since = ros::Time::now();
  work.deadline = work.since + ros::Duration(wait.limit_s);
  work.at_least = ros::Duration(wait.at_least_s);
  wait_ = work;
}

void MissionActions::begin(const command::Detect& detect) {
  bricks_.reset();  // an older list is not of this look
  interactive_mapping_msgs::DetectBricks::Request request;
  request.timeout.fromSec(detect.timeout_s);
  detect_.call(request, ros::WallDuration(params_.servers.detect_stall_s),
               [this](const interactive_mapping_msgs::DetectBricks* service, const std::string& why) {
                 if (service == nullptr) return noAnswer(why);
                 pending_detection_ = PendingDetection{service->response, ros::SteadyTime::now()};
                 finishDetection();
               });
}

void MissionActions::finishDetection() {
  if (!pending_detection_) return;
  const auto& response = pending_detection_->response;
  pick_mission::DetectionResult result;
  try {
    result.status = statusFrom<pick_mission::DetectionStatus>(response.status, interactive_mapping::kNumDetectionStatus,
                                                              "status of the detection");
    if (result.status == pick_mission::DetectionStatus::kOk) {
      // The answer holds what this look shows; what is known beside it is in the list of all.
      if (!bricks_ || bricks_->header.stamp < response.update.header.stamp) return;
      const Reach reach{&sectors_, T_base_armbase_, baseInMap()};
      std::vector<std::string> complaints;
      std::vector<int> seen_now(response.update.bricks_seen.begin(), response.update.bricks_seen.end());
      result.bricks = toSeenBricks(*bricks_, seen_now, params_.map_frame, reach, &complaints);
      for (const std::string& complaint : complaints) ROS_WARN_STREAM_NAMED(kLog, complaint);
    }
  } catch (const std::exception& error) {
    return noAnswer(error.what());
  }
  reply(result, response.message);
}

void MissionActions::begin(const command::ReportFailure& report) {
  interactive_mapping_msgs::ReportFailure::Request request;
  request.pose.header.frame_id = params_.map_frame;
  request.pose.header.stamp.fromSec(std::max(report.stamp_s, 0.0));
  request.pose.pose.position.x = report.position.x();
  request.pose.pose.position.y = report.position.y();
  request.pose.pose.position.z = report.position.z();
  request.pose.pose.orientation.w = 1.0;
  request.reason = report.reason;
  report_.call(request, ros::WallDuration(params_.servers.service_timeout_s),
               [this](const interactive_mapping_msgs::ReportFailure* service, const std::string& why) {
                 if (service == nullptr) return noAnswer(why);
                 const bool is_taken = service->response.success != 0;
                 reply(pick_mission::ReportResult{is_taken ? pick_mission::ReportStatus::kSuccess
                                                           : pick_mission::ReportStatus::kRefused},
                       service->response.message);
               });
}

void MissionActions::begin(const command::SelectView& select) {
  interactive_mapping_msgs::SelectNextBestViewGoal goal;
  goal.strategy = select.strategy;
  goal.frame_id = params_.map_frame;
  for (const command::Zone& zone : select.excluded) {
    interactive_mapping_msgs::ExcludedZone message;
    message.center.x = zone.center.x();
    message.center.y = zone.center.y();
    message.radius = zone.radius_m;
    goal.excluded.push_back(message);
  }
  for (const Eigen::Vector2d& corner : select.workspace) {
    geometry_msgs::Point message;
    message.x = corner.x();
    message.y = corner.y();
    goal.workspace.push_back(message);
  }
  goal.may_stay = select.may_stay ? 1 : 0;
  goal.min_map_stamp.fromSec(std::max(select.min_map_stamp_s, 0.0));
  sendPlan(&select_, goal, [this](const interactive_mapping_msgs::SelectNextBestViewResult& result) {
    pick_mission::SelectionResult selection;
    selection.status = statusFrom<pick_mission::SelectionStatus>(
        result.outcome.status, interactive_mapping::kNumSelectionStatus, "outcome of the selection");
    if (result.selection.best >= 0) {
      if (withoutSlash(result.standing.header.frame_id) != params_.map_frame) {
        throw std::invalid_argument("a standing pose in frame '" + result.standing.header.frame_id + "', must be in '" +
                                    params_.map_frame + "'");
      }
      selection.T_map_base = toPose2d(result.standing.pose);
      const auto best = static_cast<std::size_t>(result.selection.best);
      selection.stays =
          best < result.selection.segments.size() && result.selection.segments[best].kind == NbvSegment::HERE;
    }
    if (std::isfinite(result.selection.unseen_area)) selection.unseen_m2 = result.selection.unseen_area;
    for (const NbvSegment& segment : result.selection.segments) {
      if (segment.kind != NbvSegment::REAL && segment.kind != NbvSegment::HERE) selection.has_unseen = true;
    }
    if (selection.status == pick_mission::SelectionStatus::kSuccess && !selection.T_map_base) {
      throw std::invalid_argument("a selection that succeeded, without a standing pose");
    }
    on_selection_(result.selection);
    reply(selection, result.outcome.message);
  });
}

void MissionActions::begin(const command::Drive& drive) {
  drive_goal_ = drive.T_map_base;
  drive_since_ = ros::Time::now();
  move_base_msgs::MoveBaseGoal goal;
  goal.target_pose.header.frame_id = params_.map_frame;
  goal.target_pose.header.stamp = ros::Time::now();
  goal.target_pose.pose = interactive_mapping_ros::toPose(drive.T_map_base);
  drive_.send(goal, [this](const ActionCaller<move_base_msgs::MoveBaseAction>::End& end) {
    if (!end.result) return noAnswer(end.why);
    pending_drive_ = PendingDrive{end.is_succeeded, end.is_cancelled, end.why, ros::SteadyTime::now()};
    if (drive_outcome_) finishDrive(&*drive_outcome_);
  });
}

/// Without an outcome, as of another navigation than ours, the action's own end has to do.
void MissionActions::finishDrive(const NavigationOutcome* outcome) {
  pick_mission::NavigationResult result;
  std::string message = pending_drive_->why;
  try {
    if (outcome != nullptr) {
      result.status = statusFrom<pick_mission::NavigationStatus>(
          outcome->status, interactive_mapping::kNumNavigationStatus, "outcome of the drive");
      if (result.status == pick_mission::NavigationStatus::kSuccess && !pending_drive_->is_succeeded) {
        return noAnswer(contradiction(pending_drive_->is_cancelled, pending_drive_->why));
      }
      message = outcome->message;
      if (withoutSlash(outcome->header.frame_id) == params_.map_frame) result.T_map_base = toPose2d(outcome->base);
    } else if (pending_drive_->is_cancelled) {
      result.status = pick_mission::NavigationStatus::kCancelled;
    } else if (!pending_drive_->is_succeeded) {
      result.status = pick_mission::NavigationStatus::kNoPath;
    }
  } catch (const std::invalid_argument& error) {
    return noAnswer(error.what());
  }
  reply(result, message);
}

void MissionActions::begin(const command::Cancel& /*cancel*/) {
  cancel();
}

// Hold and release are called by threads, which may overtake each other: the next is called when the last has ended, and
// a hold at once, and again after a release that was still under way.

void MissionActions::begin(const command::Hold& /*hold*/) {
  cancelDrives();
  is_hold_wanted_ = true;
  callHold();
}

void MissionActions::begin(const command::Release& /*release*/) {
  is_hold_wanted_ = false;
  is_hold_lost_ = false;
  if (!hold_.isActive()) callRelease();
}

void MissionActions::callHold() {
  hold_.call(std_srvs::Trigger::Request(), ros::WallDuration(params_.servers.service_timeout_s),
             [this](const std_srvs::Trigger* service, const std::string& why) {
               if (!is_hold_wanted_) return callRelease();
               if (service != nullptr && service->response.success) return;
               // Without a heartbeat the bridge stops the arm, too.
               is_hold_lost_ = true;
               ROS_ERROR_STREAM_NAMED(kLog, "the arm's bridge did not take the hold ("
                                                << (service != nullptr ? service->response.message : why)
                                                << "): the mission's heartbeat stops until it is released");
             });
}

void MissionActions::callRelease() {
  release_.call(std_srvs::Trigger::Request(), ros::WallDuration(params_.servers.service_timeout_s),
                [this](const std_srvs::Trigger* service, const std::string& why) {
                  if (is_hold_wanted_) return callHold();
                  if (service != nullptr && service->response.success) return;
                  ROS_ERROR_STREAM_NAMED(kLog, "the arm's bridge did not release its hold: "
                                                   << (service != nullptr ? service->response.message : why));
                });
}

// --- Topics -----------------------------------------------------------------------------------------------------------

void MissionActions::onBridgeState(const interactive_mapping_msgs::ArmBridgeStateConstPtr& message) {
  bridge_ = message;
  finishArm();
  tellPileLeft();
  using pick_mission::WaitUntil;
  const bool is_idle = bridge_->phase == interactive_mapping_msgs::ArmBridgeState::IDLE;
  const bool is_for_arm = wait_ && (wait_->until == WaitUntil::kArmReady || wait_->until == WaitUntil::kArmIdle);
  if (is_for_arm && is_idle && bridge_->header.stamp >= wait_->since &&
      (bridge_->may_move || wait_->until == WaitUntil::kArmIdle)) {
    const Hand now = hand();
    told_hand_ = now;
    reply(pick_mission::WaitResult{pick_mission::WaitStatus::kSuccess}, "", now);
  }
  tellHand();
}

void MissionActions::tellPileLeft() {
  const bool is_away = bridge_->stage == "stow" && bridge_->progress >= kAway && bridge_->is_holding;
  if (!is_away || !pick_.isActive() || !running_ || carrying_ || pile_left_by_ == *running_) return;
  pile_left_by_ = *running_;
  post_(pick_mission::event::PileLeft{*running_});
}

void MissionActions::onAttached(const interactive_mapping_msgs::AttachedBrickConstPtr& message) {
  attached_ = message;
}

void MissionActions::onMapUpdate(const interactive_mapping_msgs::MapUpdateConstPtr& message) {
  const ros::Time stamp = message->header.stamp;
  if (message->status == MapUpdate::ACCEPTED) map_stamp_ = stamp;
  if (!look_ || stamp <= look_->since) return;
  if (message->status != MapUpdate::ACCEPTED) {
    look_->refused = message->message;
    return;
  }
  look_->map_stamp_s = stamp.toSec();
  if (++look_->seen < look_->images) return;
  reply(pick_mission::LookResult{pick_mission::LookStatus::kSuccess, look_->map_stamp_s}, "");
}

void MissionActions::onBricks(const interactive_mapping_msgs::BrickArrayConstPtr& message) {
  bricks_ = message;
  finishDetection();
}

void MissionActions::onNavigationOutcome(const NavigationOutcome::ConstPtr& message) {
  if (!drive_goal_) return;
  // Latched: it may be of an earlier goal, also of one to the same place. One that was refused does not tell its goal.
  if ((message->header.stamp - drive_since_).toSec() < -kClocksApart_s) return;
  if (std::isfinite(message->goal.position.x) &&
      std::hypot(message->goal.position.x - drive_goal_->x_m, message->goal.position.y - drive_goal_->y_m) >
          kSameGoal_m) {
    return;
  }
  drive_outcome_ = *message;
  if (pending_drive_) finishDrive(&*drive_outcome_);
}

void MissionActions::onDriveStatus(const actionlib_msgs::GoalStatusArrayConstPtr& message) {
  using actionlib_msgs::GoalStatus;
  may_base_drive_ = false;
  for (const GoalStatus& goal : message->status_list) {
    if (goal.status == GoalStatus::PENDING || goal.status == GoalStatus::ACTIVE) may_base_drive_ = true;
  }
}

}  // namespace pick_mission_ros
