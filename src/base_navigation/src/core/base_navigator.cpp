// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/base_navigator.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>

#include "driving/arrival.h"
#include "driving/base_stop_input.h"
#include "driving/drive_data.h"
#include "driving/look_ahead.h"
#include "driving/path_drive.h"
#include "driving/plan_attempts.h"
#include "driving/stuck_detector.h"
#include "text.h"

namespace base_navigation {
namespace {

constexpr double kFirstStep_s = 0.02;  // when no time has passed that counts
constexpr double kMaxStep_s = 0.5;     // between two steps of the control that it can brake in
constexpr double kBlocked_m_s = 0.01;  // the guard leaves less: the base is blocked
constexpr double kBlocked_rad_s = 0.01;
constexpr double kStandPatience_s = 5.0;  // told to stand: from 0.8 m/s it takes 4 s, told or not
constexpr int kMaxMisses = 1;             // of the goal, that are tried again

bool isMoving(const Twist2d& command) {
  return std::abs(command.linear_m_s) >= kBlocked_m_s || std::abs(command.angular_rad_s) >= kBlocked_rad_s;
}

/// ", for 3.1 s, may be 3.0 s"
std::string forLong(double passed_s, double limit_s) {
  return ", for " + text(passed_s, 1) + " s, may be " + text(limit_s, 1) + " s";
}

enum class Mode {
  kIdle,
  kPlanning,  // brakes, waits for data, plans
  kPlanned,   // is charged for the plan
  kDriving,
  kArriving,  // stands at the end of the way, and looks where that is
  kEnding,    // brakes, and ends
};

struct Goal {
  Pose2d pose_map;
  int misses{0};
};

std::string offGoal(double off_m, double off_rad, const BasePlannerConfig& allowed) {
  return text(off_m, 3) + " m and " + text(off_rad, 3) + " rad from the goal, may be " +
         text(allowed.position_tolerance_m, 3) + " m and " + text(allowed.yaw_tolerance_rad, 3) + " rad";
}

/// Since when [s]. Nothing: it is not so.
struct Since {
  std::optional<double> stopped, stale, blocked, ended;
};

/// The guard leaves nothing to speak of, and the base has come to it.
bool isBlocked(double factor, const Twist2d& wanted, const Twist2d& command) {
  return factor < 1.0 && factor * std::abs(wanted.linear_m_s) < kBlocked_m_s &&
         factor * std::abs(wanted.angular_rad_s) < kBlocked_rad_s && !isMoving(command);
}

std::string groundAhead(const FootprintVerdict& verdict, double at_m) {
  return std::string("the ground ahead is ") + (verdict.state == SpaceState::kOccupied ? "occupied" : "unknown") +
         " at " + text(verdict.where_map) + ", " + text(std::max(0.0, verdict.at_m - at_m)) + " m ahead";
}

}  // namespace

/// A step of the mode that it is in, or is changed to before.
/// Long: each mode uses planner, guard, follower and data; those are classes of their own.
struct BaseNavigator::State {
  State(const BaseNavigatorConfig& config_, const BasePlannerConfig& planner_, const PathFollowerConfig& follower_,
        const ObstacleGuardConfig& guard_, const MotionLimits& limits_, const Polygon& footprint_)
      : config(config_),
        footprint(footprint_),
        limits(limits_),
        planner(planner_, limits_, footprint_),
        drive(follower_, limits_),
        guard(guard_, limits_, footprint_) {}

  const BaseNavigatorConfig config;
  const Polygon footprint;
  MotionLimits limits;  // of the path that is driven
  std::optional<MotionLimits> next_limits;
  BasePlanner planner;
  PathDrive drive;
  ObstacleGuard guard;
  DriveData data{config, limits};
  StuckDetector stuck{config};
  PlanAttempts attempts{config};
  BaseStopInput stop;
  Arrival arrival;

  // This step.
  double now_s{std::numeric_limits<double>::quiet_NaN()};
  double dt_s{0.0};
  NavigationOutput output;

  // This goal.
  Mode mode{Mode::kIdle};
  Goal goal;
  Since since;
  Ending ending;

  // The way being driven.
  BasePlan way;                // without motions: none
  std::uint64_t num_plans{0};  // ever
  std::shared_ptr<const NavigationGrid> grid_checked;
  double planned_s{0.0};

  double passedSince(std::optional<double>* since_s) const {
    if (!*since_s) *since_s = now_s;
    return now_s - **since_s;
  }

  void report(NavigationPhase phase, const std::string& reason) {
    output.phase = phase;
    output.reason = reason;
  }

  bool isActive() const { return mode != Mode::kIdle && mode != Mode::kEnding; }

  /// Brakes. True: the base stands.
  bool comeToStand() {
    if (drive.comeToStand(data)) return true;
    output.phase = NavigationPhase::kBraking;
    return false;
  }

  void setGoal(const Pose2d& goal_map) {
    // A source that was rejected may have restarted since.
    if (mode == Mode::kIdle) data.forget();
    goal = {goal_map};
    since = {};
    drive.setHard(false);
    attempts.start();
    planAnew("");
  }

  void planAnew(const std::string& reason, bool is_obstacle = false) {
    attempts.request(reason, is_obstacle);
    since.blocked.reset();
    drive.restartBraking();
    mode = Mode::kPlanning;
  }

  void brakeToPlanAnew(const std::string& reason) {
    planAnew(reason);
    drive.brake(data);
    report(NavigationPhase::kBraking, reason);
  }

  void arrive() {
    mode = Mode::kArriving;
    drive.restartBraking();
    arrival.start(now_s);
  }

  void endWith(NavigationStatus status, const std::string& message) {
    ending = {status, message};
    if (status == NavigationStatus::kCancelled) drive.setHard(true);
    drive.restartBraking();
    mode = Mode::kEnding;
  }

  NavigationOutput step(const NavigationInput& input, const std::function<bool()>& is_cancelled) {
    if (!std::isfinite(input.now_s)) throw std::invalid_argument("now_s is not finite");
    const double elapsed_s = std::isfinite(now_s) ? input.now_s - now_s : kFirstStep_s;
    if (elapsed_s == 0.0) {  // twice at one time: nothing new to command
      output.ended.reset();
      output.has_jumped = false;
      return output;
    }
    now_s = input.now_s;
    dt_s = elapsed_s < 0.0 ? kFirstStep_s : std::min(elapsed_s, kMaxStep_s);
    output = {};
    drive.setTime(now_s, dt_s);
    if (elapsed_s < 0.0) clockRanBack(-elapsed_s);
    data.take(input);
    if (!heedStop(input.stop)) stepMode(is_cancelled);
    output.command = drive.command();
    output.has_jumped = data.has_jumped;
    output.remaining_m = way.path.motions.empty() ? 0.0 : std::max(0.0, way.path.length() - drive.at());
    return output;
  }

  void clockRanBack(double by_s) {
    data.forgetTimes();
    drive.halt();
    since.stale.reset();
    since.stopped.reset();
    if (mode != Mode::kIdle) {
      endWith(NavigationStatus::kStaleOdometry, "the clock ran back by " + text(by_s) + " s");
    }
    if (since.ended) since.ended = now_s;
  }

  /// The base's own stop. True: there is nothing else to do in this step.
  bool heedStop(const std::optional<BaseStop>& reported) {
    stop.take(reported);
    if (isActive() && stop.endsGoal()) {
      endWith(NavigationStatus::kBaseStopped, stop.words());
      stop.goalHasEnded();
    }
    if (!stop.isActive()) {
      since.stopped.reset();
      return false;
    }
    // It stands by itself: what is commanded now would be driven at its release.
    drive.halt();
    drive.leavePath();
    stuck.reset();
    if (!isActive()) return false;
    const double stopped_s = passedSince(&since.stopped);
    report(NavigationPhase::kBlocked, stop.words());
    since.blocked.reset();
    since.stale.reset();
    if (!data.jump.empty()) planAnew(data.jump);
    if (mode == Mode::kArriving) arrive();
    if (stopped_s >= config.scanner_patience_s) {
      endWith(NavigationStatus::kBaseStopped, stop.words() + forLong(stopped_s, config.scanner_patience_s));
    }
    return true;
  }

  /// Too old data: stops, waits, gives up. True: there is nothing else to do in this step.
  bool waitForData() {
    const std::optional<Ending> missing = data.stale(now_s);
    if (!missing) {
      since.stale.reset();
      drive.setHard(false);
      return false;
    }
    const double stale_s = passedSince(&since.stale);
    drive.setHard(missing->status == NavigationStatus::kStaleHeartbeat);
    drive.brake(data);
    stuck.reset();
    report(NavigationPhase::kWaitingForData, missing->message);
    if (stale_s >= config.stale_patience_s) {
      endWith(missing->status, missing->message + ", after waiting " + text(stale_s, 1) + " s");
    }
    return true;
  }

  /// Looks at a new grid, once. Nothing: the way ahead is free.
  std::optional<std::string> blockedWay() {
    if (data.grid == grid_checked) return std::nullopt;
    grid_checked = data.grid;
    const FootprintVerdict verdict = planner.recheck(way, drive.at(), data.grid);
    if (verdict.isFree()) return std::nullopt;
    return groundAhead(verdict, drive.at());
  }

  void stepMode(const std::function<bool()>& is_cancelled) {
    switch (mode) {
      case Mode::kIdle:
        return stepIdle();
      case Mode::kPlanning:
        return stepPlanning(is_cancelled);
      case Mode::kPlanned:
        return stepPlanned();
      case Mode::kDriving:
        return stepDriving();
      case Mode::kArriving:
        return stepArriving();
      case Mode::kEnding:
        return stepEnding();
    }
  }

  void stepIdle() {
    drive.halt();
    // Zeros until the base stands, or nobody can tell.
    if (!since.ended || drive.stands(data) || now_s - *since.ended >= kStandPatience_s) return since.ended.reset();
    report(NavigationPhase::kBraking, data.isOdometryFresh(now_s)
                                          ? "commanded to stop, and moves by odometry"
                                          : "commanded to stop; without odometry it is not known whether it has");
  }

  void stepPlanning(const std::function<bool()>& is_cancelled) {
    if (!data.jump.empty()) drive.leavePath();
    if (waitForData()) return;
    output.reason = attempts.reason();
    if (!comeToStand()) {
      if (drive.brakingTime() < kStandPatience_s) return;
      const Twist2d& twist = data.odometry_twist;
      return endWith(NavigationStatus::kStuck, "the base moves at " + text(twist.linear_m_s) + " m/s and " +
                                                   text(twist.angular_rad_s) + " rad/s by odometry, " +
                                                   text(kStandPatience_s, 1) + " s after the command to stop");
    }
    if (const auto reason = attempts.waiting(now_s)) return report(NavigationPhase::kBlocked, *reason);
    output.phase = NavigationPhase::kPlanning;
    if (data.isScanFromBeforeJump()) {
      output.reason = "localisation or odometry has jumped: waits for the next scan";
      return;
    }
    plan(is_cancelled);
  }

  void plan(const std::function<bool()>& is_cancelled) {
    if (const auto end = attempts.begin()) return endWith(end->status, end->message);
    if (next_limits) {  // the base stands
      limits = *next_limits;
      planner = BasePlanner(planner.config(), limits, footprint);
      drive.setLimits(limits);
      next_limits.reset();
    }
    BasePlan made = planner.plan(data.grid, data.T_map_base, goal.pose_map, is_cancelled);
    grid_checked = data.grid;
    ++num_plans;
    if (made.status == BasePlanStatus::kSolved) return begin(std::move(made));
    way = {};
    if (const auto end = attempts.fail(made, now_s)) endWith(end->status, end->message);
  }

  void begin(BasePlan plan) {
    way = std::move(plan);
    attempts.succeed();
    drive.start(way.path);
    planned_s = now_s;
    stuck.reset();
    mode = Mode::kPlanned;
  }

  void stepPlanned() {
    if (waitForData()) return;
    report(NavigationPhase::kPlanning, attempts.reason());
    if (!data.jump.empty()) return planAnew(data.jump);
    if (const auto reason = blockedWay()) return planAnew(*reason);
    if (now_s - planned_s >= config.plan_cost_s) mode = Mode::kDriving;
  }

  void stepDriving() {
    if (!data.jump.empty()) {
      drive.leavePath();
      return brakeToPlanAnew(data.jump);
    }
    if (waitForData()) return;
    if (drive.isOffPath()) {  // the data is back
      if (!comeToStand()) {
        output.reason = "stops where data was missing";
        return;
      }
      if (!drive.resume(data.T_map_base)) return planAnew("the base left its path while data was missing");
    }
    if (const auto reason = blockedWay()) return brakeToPlanAnew(*reason);
    if (!drive.isActive()) return arrive();  // came to the end while it braked
    driveOn();
  }

  void driveOn() {
    output.phase = NavigationPhase::kDriving;
    output.guard = lookAhead(guard, drive.follower(), limits, data);
    const Twist2d wanted = drive.follower().wanted(data.T_map_base);
    output.follow = drive.follow(data.T_map_base, output.guard.speed_factor);
    if (output.follow.status == FollowStatus::kReached) return arrive();
    if (output.follow.status == FollowStatus::kLost) return leaveWay();
    const Twist2d& command = output.follow.twist;
    if (isBlocked(output.guard.speed_factor, wanted, command)) return waitForObstacle();
    if (isMoving(command)) since.blocked.reset();
    stuck.add(now_s, dt_s, command, data);
    const std::string found = stuck.find(now_s, config.stuck_s);
    if (!found.empty()) endWith(NavigationStatus::kStuck, found);
  }

  void leaveWay() {
    // Carried on with wheels that slip, the pose may be far off before stuck_s are over.
    const std::string slips = stuck.find(now_s, 0.0);
    if (!slips.empty()) return endWith(NavigationStatus::kStuck, slips);
    const FollowCommand& follow = output.follow;
    planAnew("the base is " + text(std::hypot(follow.error_across_m, follow.error_along_m)) + " m and " +
             text(std::abs(follow.error_yaw_rad)) + " rad off its path");
    report(NavigationPhase::kBraking, attempts.reason());
  }

  void waitForObstacle() {
    const double blocked_s = passedSince(&since.blocked);
    const Eigen::Vector2d obstacle =
        transform(data.T_map_base, output.guard.obstacle_base.value_or(Eigen::Vector2d::Zero()));
    report(NavigationPhase::kBlocked, "the scanner sees an obstacle at " + text(obstacle));
    stuck.reset();
    if (blocked_s >= config.blocked_patience_s) {
      planAnew(output.reason + ", for " + text(blocked_s, 1) + " s", true);
    }
  }

  void stepArriving() {
    if (!data.jump.empty()) {
      drive.leavePath();
      return planAnew(data.jump);
    }
    if (waitForData()) return;
    if (!comeToStand()) return arrive();
    output.phase = NavigationPhase::kDriving;
    const std::optional<Pose2d> stands_at = arrival.add(now_s, data.poseStamp(), data.T_map_base);
    if (!stands_at) return;
    const double off_m = (stands_at->position() - goal.pose_map.position()).norm();
    const double off_rad = std::abs(wrapAngle(stands_at->yaw_rad - goal.pose_map.yaw_rad));
    const BasePlannerConfig& wanted = planner.config();
    const std::string where = offGoal(off_m, off_rad, wanted);
    if (off_m <= wanted.position_tolerance_m && off_rad <= wanted.yaw_tolerance_rad) {
      return endWith(NavigationStatus::kSuccess, "is " + where);
    }
    const std::string missed = "reached the end of the path " + where;
    if (goal.misses >= kMaxMisses) {
      return endWith(NavigationStatus::kGoalMissed, missed + ", " + std::to_string(goal.misses + 1) + " times");
    }
    ++goal.misses;
    planAnew(missed);
  }

  void stepEnding() {
    if (!data.jump.empty()) drive.leavePath();
    output.reason = ending.message;
    bool has_ended = comeToStand();
    // Without odometry nobody knows; and what does not stand when told so is not waited for.
    if (!has_ended && isZero(drive.command())) {
      has_ended = !data.isOdometryFresh(now_s) || drive.brakingTime() >= kStandPatience_s;
    }
    if (!has_ended) return;
    output.ended = ending.status;
    output.message = ending.message;
    report(drive.stands(data) ? NavigationPhase::kIdle : NavigationPhase::kBraking, "");
    drive.finish();
    way = {};
    ++num_plans;
    since.ended = now_s;
    mode = Mode::kIdle;
  }
};

BaseNavigator::BaseNavigator(const BaseNavigatorConfig& config, const BasePlannerConfig& planner,
                             const PathFollowerConfig& follower, const ObstacleGuardConfig& guard,
                             const MotionLimits& limits, Polygon footprint) {
  std::vector<std::string> problems = interactive_mapping::problemsOf(config);
  for (const std::vector<std::string>& more :
       {interactive_mapping::problemsOf(planner), interactive_mapping::problemsOf(follower),
        interactive_mapping::problemsOf(guard), limits.validate(), guard.problemsFor(limits)}) {
    problems.insert(problems.end(), more.begin(), more.end());
  }
  interactive_mapping::refuseIfAny("impossible navigator:", problems);
  state_ = std::make_unique<State>(config, planner, follower, guard, limits, footprint);
}

BaseNavigator::~BaseNavigator() = default;

void BaseNavigator::setGoal(const Pose2d& goal_map) {
  if (!std::isfinite(goal_map.x_m) || !std::isfinite(goal_map.y_m) || !std::isfinite(goal_map.yaw_rad)) {
    throw std::invalid_argument("goal (" + text(goal_map.x_m) + ", " + text(goal_map.y_m) + ", " +
                                text(goal_map.yaw_rad) + ") must be finite");
  }
  state_->setGoal(goal_map);
}

void BaseNavigator::cancel() {
  if (state_->mode == Mode::kIdle) return;
  if (state_->mode == Mode::kEnding && state_->ending.status != NavigationStatus::kSuccess) return;
  state_->endWith(NavigationStatus::kCancelled, "cancelled");
}

void BaseNavigator::retune(const ObstacleGuardConfig& guard, const MotionLimits& limits) {
  state_->guard = ObstacleGuard(guard, limits, state_->footprint);
  state_->next_limits = limits;
}

bool BaseNavigator::isActive() const {
  return state_->mode != Mode::kIdle;
}

NavigationOutput BaseNavigator::step(const NavigationInput& input, const std::function<bool()>& is_cancelled) {
  return state_->step(input, is_cancelled);
}

const BasePath& BaseNavigator::path() const {
  return state_->way.path;
}

int BaseNavigator::plansForGoal() const {
  return state_->attempts.count();
}

std::uint64_t BaseNavigator::numPlans() const {
  return state_->num_plans;
}

}  // namespace base_navigation
