// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/base_navigator.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <iomanip>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace base_navigation {
namespace {

constexpr double kMaxStep_s = 0.5;    // between two steps of the control that it can brake in
constexpr double kFuture_s = 0.1;     // a stamp may be so far ahead of the clock: two computers, one clock
constexpr double kStands_m_s = 0.01;  // odometry tells less: the base stands
constexpr double kStands_rad_s = 0.02;
constexpr double kBlocked_m_s = 0.01;  // the guard leaves less: the base is blocked
constexpr double kBlocked_rad_s = 0.01;
constexpr double kStandPatience_s = 5.0;  // told to stand: from 0.8 m/s it takes 4 s, told or not
constexpr double kArrival_s = 0.3;        // the pose at the goal is the mean over so long: its noise is not the base's
// Farther between two steps than odometry reports: the localisation has jumped.
constexpr double kMaxPoseStep_m = 0.25;
constexpr double kMaxPoseStep_rad = 0.2;
// Stuck: less than this share of the commanded motion was measured. Less motion than this within stuck_s is not judged.
constexpr double kStuckShare = 0.2;
constexpr double kStuckMin_m = 0.05;
constexpr double kStuckMin_rad = 0.1;
constexpr int kMaxMisses = 1;            // of the goal, that are tried again
constexpr double kStoppingMore_m = 0.2;  // the arc of the present twist is looked at so much beyond the stop

bool isFinite(const Pose2d& pose) {
  return std::isfinite(pose.x_m) && std::isfinite(pose.y_m) && std::isfinite(pose.yaw_rad);
}

bool isZero(const Twist2d& twist) {
  return twist.linear_m_s == 0.0 && twist.angular_rad_s == 0.0;
}

std::string number(double value, int digits = 2) {
  std::ostringstream out;
  out << std::fixed << std::setprecision(digits) << value;
  return out.str();
}

std::string place(const Eigen::Vector2d& p) {
  return "(" + number(p.x()) + ", " + number(p.y()) + ")";
}

NavigationStatus statusOf(BasePlanStatus status) {
  switch (status) {
    case BasePlanStatus::kSolved:
      return NavigationStatus::kSuccess;
    case BasePlanStatus::kStartOccupied:
    case BasePlanStatus::kStartUnknown:
      return NavigationStatus::kStartBlocked;
    case BasePlanStatus::kGoalOccupied:
      return NavigationStatus::kGoalOccupied;
    case BasePlanStatus::kGoalUnknown:
      return NavigationStatus::kGoalUnknown;
    case BasePlanStatus::kNoApproach:
      return NavigationStatus::kNoApproach;
    case BasePlanStatus::kNoPath:
      return NavigationStatus::kNoPath;
    case BasePlanStatus::kIterations:
      return NavigationStatus::kIterations;
    case BasePlanStatus::kCancelled:
      return NavigationStatus::kCancelled;
  }
  return NavigationStatus::kNoPath;
}

/// A source of data: its newest stamp that can be true, and what is wrong with what came since.
struct Source {
  const char* article;
  const char* noun;
  double stamp_s{-1.0};
  std::string refused{};
  std::string problem{};  // of what came last, told by who hears it

  std::string name() const { return std::string(article) + noun; }

  void reset() {
    stamp_s = -1.0;
    refused.clear();
  }

  /// Whether something new has come.
  bool accept(double stamp, double now_s, bool is_finite) {
    if (stamp < 0.0) return false;
    if (!is_finite || !std::isfinite(stamp)) {
      refused = name() + " is not finite";
    } else if (stamp > now_s + kFuture_s) {
      refused =
          name() + " is stamped " + number(stamp - now_s) + " s ahead of the clock, may be " + number(kFuture_s) + " s";
    } else if (stamp < stamp_s) {
      refused = "the stamps of " + name() + " ran back by " + number(stamp_s - stamp) + " s";
    } else {
      refused.clear();
      const bool is_new = stamp > stamp_s;
      stamp_s = stamp;
      return is_new;
    }
    return false;
  }

  /// Why it cannot be used; empty: it can. `max_age_s` infinite: once it has come, it can.
  std::string stale(double now_s, double max_age_s) const {
    if (stamp_s >= 0.0 && now_s - stamp_s <= max_age_s) return {};
    if (!problem.empty()) return problem;
    if (!refused.empty()) return refused;
    if (stamp_s < 0.0) return std::string("no ") + noun + " has come yet";
    return name() + " is " + number(now_s - stamp_s) + " s old, may be " + number(max_age_s) + " s";
  }
};

enum class Mode {
  kIdle,
  kPlanning,  // brakes, waits for data, plans
  kPlanned,   // is charged for the plan
  kDriving,
  kArriving,  // stands at the end of the way, and looks where that is
  kEnding,    // brakes, and ends
};

}  // namespace

struct BaseNavigator::State {
  State(const BaseNavigatorConfig& config_, const BasePlannerConfig& planner_, const PathFollowerConfig& follower_,
        const ObstacleGuardConfig& guard_, const MotionLimits& limits_, const Polygon& footprint_)
      : config(config_),
        follower_config(follower_),
        footprint(footprint_),
        limits(limits_),
        planner(planner_, limits_, footprint_),
        follower(follower_, limits_),
        guard(guard_, limits_, footprint_) {}

  const BaseNavigatorConfig config;
  const PathFollowerConfig follower_config;
  const Polygon footprint;
  MotionLimits limits;  // of the path that is driven
  std::optional<MotionLimits> next_limits;
  BasePlanner planner;
  PathFollower follower;
  ObstacleGuard guard;

  Mode mode{Mode::kIdle};
  Pose2d goal_map;
  BasePlan way;                  // being driven; without motions: none
  std::uint64_t num_plans{0};    // ever
  int plans{0};                  // for this goal
  bool has_been_patient{false};  // since the last plan: a plan that failed waits once for what may go away
  std::optional<double> patience_until_s;
  std::string patience_reason;
  int misses{0};
  std::string replan_reason;       // of the plan that comes next
  bool is_obstacle_reason{false};  // it is the scanner's obstacle
  NavigationStatus end_status{NavigationStatus::kSuccess};
  std::string end_message;

  // Data, as far as it can be true.
  Source odometry{"", "odometry"};
  Source pose{"the ", "pose in the map"};
  Source scan{"the ", "scan"};
  Source grid{"the ", "map"};
  Source heartbeat{"the ", "heartbeat"};
  Pose2d T_odom_base;
  Twist2d odometry_twist;
  Pose2d T_map_base;          // at the newest odometry
  bool is_pose_known{false};  // since the clock last ran back, a new goal or not; then when the localisation came:
  Pose2d T_map_base_at_pose;
  Pose2d T_odom_base_at_pose;
  bool was_odometry_fresh_at_pose{false};
  std::deque<std::pair<double, Pose2d>> odometry_history;
  std::shared_ptr<const Scan> scan_now;
  std::shared_ptr<const NavigationGrid> grid_now;
  std::shared_ptr<const NavigationGrid> grid_checked;
  std::string jump;  // of localisation or odometry, in this step
  bool has_jumped{false};
  double jumped_s{-std::numeric_limits<double>::infinity()};  // the last time

  std::optional<BaseStop> stop;  // of the base itself
  std::optional<double> stopped_since_s;
  std::string pressed_unheard;  // what was pressed while there was no goal to end by it

  double last_now_s{std::numeric_limits<double>::quiet_NaN()};
  std::optional<double> stale_since_s;
  std::optional<double> blocked_since_s;
  std::optional<double> braking_since_s;
  std::optional<double> ended_s;
  double planned_s{0.0};
  double at_m{0.0};
  bool is_off_path{false};       // it was stopped without looking, or the localisation has jumped
  bool is_asked_to_stop{false};  // by a cancel, or by a heartbeat that stays away: brakes harder
  NavigationOutput last_output;

  // Arrival.
  double arrived_s{0.0};
  int num_poses{0};
  Eigen::Vector2d position_sum{Eigen::Vector2d::Zero()};
  Eigen::Vector2d heading_sum{Eigen::Vector2d::Zero()};
  double last_pose_stamp_s{-1.0};

  struct Motion {
    double now_s;
    Pose2d commanded;
    double commanded_rad;
    Pose2d T_odom_base;
    Pose2d T_map_base;
  };
  std::deque<Motion> motions;  // commanded and measured, since the base was told to move
  Pose2d commanded;
  double commanded_rad{0.0};

  // ---------------------------------------------------------------------------------------------------------- data

  void takeOdometry(const NavigationInput& input) {
    const double before_s = odometry.stamp_s;
    const bool is_finite = isFinite(input.T_odom_base) && std::isfinite(input.odometry_twist.linear_m_s) &&
                           std::isfinite(input.odometry_twist.angular_rad_s);
    if (!odometry.accept(input.odometry_stamp_s, input.now_s, is_finite)) return;
    if (before_s >= 0.0) {
      const double elapsed_s = input.odometry_stamp_s - before_s;
      const double step_m = (input.T_odom_base.position() - T_odom_base.position()).norm();
      const double step_rad = std::abs(wrapAngle(input.T_odom_base.yaw_rad - T_odom_base.yaw_rad));
      const double max_m = kMaxPoseStep_m + limits.forward_m_s * elapsed_s;
      const double max_rad = kMaxPoseStep_rad + limits.turn_rad_s * elapsed_s;
      if (step_m > max_m || step_rad > max_rad) {
        has_jumped = true;
        jump = "odometry has jumped by " + number(step_m) + " m and " + number(step_rad) + " rad within " +
               number(elapsed_s) + " s, may be " + number(max_m) + " m and " + number(max_rad) + " rad";
        odometry_history.clear();
      }
    }
    T_odom_base = input.T_odom_base;
    odometry_twist = input.odometry_twist;
    odometry_history.push_back({input.odometry_stamp_s, T_odom_base});
    while (odometry_history.back().first - odometry_history.front().first > kOdometryHistory_s)
      odometry_history.pop_front();
  }

  void take(const NavigationInput& input) {
    jump.clear();
    has_jumped = false;
    odometry.problem = input.odometry_problem;
    pose.problem = input.pose_problem;
    scan.problem = input.scan_problem;
    grid.problem = input.grid_problem;
    takeOdometry(input);
    // What odometry told while it was not there is nothing to drive by, and no reason to stop.
    const bool is_odometry_fresh = isOdometryFresh(input.now_s);
    const bool can_compare = is_odometry_fresh && was_odometry_fresh_at_pose;
    const Pose2d expected = compose(T_map_base_at_pose, compose(inverse(T_odom_base_at_pose), T_odom_base));
    if (pose.accept(input.pose_stamp_s, input.now_s, isFinite(input.T_map_base))) {
      const double step_m = (input.T_map_base.position() - expected.position()).norm();
      const double step_rad = std::abs(wrapAngle(input.T_map_base.yaw_rad - expected.yaw_rad));
      if (is_pose_known && (step_m > kMaxPoseStep_m || step_rad > kMaxPoseStep_rad)) {
        has_jumped = true;
        if (can_compare && jump.empty()) {
          jump = "the localisation has jumped by " + number(step_m) + " m and " + number(step_rad) +
                 " rad against odometry, may be " + number(kMaxPoseStep_m) + " m and " + number(kMaxPoseStep_rad) +
                 " rad";
        }
      }
      T_map_base = T_map_base_at_pose = input.T_map_base;
      T_odom_base_at_pose = T_odom_base;
      was_odometry_fresh_at_pose = is_odometry_fresh;
      is_pose_known = true;
    } else if (can_compare) {
      T_map_base = expected;
    }
    if (has_jumped) jumped_s = input.now_s;
    if (input.scan && scan.accept(input.scan_stamp_s, input.now_s, true)) scan_now = input.scan;
    if (input.grid) {
      const bool is_newer = grid.accept(input.grid_stamp_s, input.now_s, true);
      // Equal stamps: the scanner's part of it is newer.
      if (is_newer || input.grid_stamp_s == grid.stamp_s) grid_now = input.grid;
    }
    heartbeat.accept(input.heartbeat_stamp_s, input.now_s, true);
  }

  /// What cannot be driven with, and why.
  std::optional<std::pair<NavigationStatus, std::string>> stale(double now_s) const {
    const auto one = [&](const Source& source, double max_age_s,
                         NavigationStatus status) -> std::optional<std::pair<NavigationStatus, std::string>> {
      std::string reason = source.stale(now_s, max_age_s);
      if (reason.empty()) return std::nullopt;
      // What comes and is wrong is not late; a pose that tf cannot give is.
      const bool is_bad = !source.problem.empty() && status != NavigationStatus::kStalePose;
      return std::make_pair(is_bad ? NavigationStatus::kBadInput : status, std::move(reason));
    };
    if (auto found = one(odometry, config.max_odometry_age_s, NavigationStatus::kStaleOdometry)) return found;
    if (auto found = one(pose, config.max_pose_age_s, NavigationStatus::kStalePose)) return found;
    if (auto found = one(scan, config.max_scan_age_s, NavigationStatus::kStaleScan)) return found;
    const double max_grid_age_s =
        config.max_grid_age_s > 0.0 ? config.max_grid_age_s : std::numeric_limits<double>::infinity();
    if (auto found = one(grid, max_grid_age_s, NavigationStatus::kStaleGrid)) return found;
    if (config.max_heartbeat_age_s <= 0.0) return std::nullopt;
    return one(heartbeat, config.max_heartbeat_age_s, NavigationStatus::kStaleHeartbeat);
  }

  bool isOdometryFresh(double now_s) const { return odometry.stale(now_s, config.max_odometry_age_s).empty(); }
  bool isPoseFresh(double now_s) const { return pose.stale(now_s, config.max_pose_age_s).empty(); }
  /// Told to stand, and odometry says that it does.
  bool stands(double now_s) const {
    return isZero(follower.lastCommand()) && isOdometryFresh(now_s) &&
           std::abs(odometry_twist.linear_m_s) < kStands_m_s && std::abs(odometry_twist.angular_rad_s) < kStands_rad_s;
  }

  /// The base now, in base_link when the scan was taken.
  Pose2d motionSinceScan() const {
    for (auto it = odometry_history.rbegin(); it != odometry_history.rend(); ++it) {
      if (it->first > scan.stamp_s) continue;
      if (it == odometry_history.rbegin()) return {};
      // Between two messages: evenly.
      const auto next = std::prev(it);
      const double share = (scan.stamp_s - it->first) / (next->first - it->first);
      const Pose2d step = compose(inverse(it->second), next->second);
      const Pose2d at_scan = compose(it->second, Pose2d{share * step.x_m, share * step.y_m, share * step.yaw_rad});
      return compose(inverse(at_scan), T_odom_base);
    }
    if (odometry_history.empty()) return {};
    return compose(inverse(odometry_history.front().second), T_odom_base);
  }

  // -------------------------------------------------------------------------------------------------------- control

  void brake(double now_s, double dt_s) {
    if (is_asked_to_stop) {
      is_off_path = true;
      follower.stop(dt_s);
    } else if (follower.isActive() && !is_off_path && isPoseFresh(now_s)) {
      at_m = follower.update(T_map_base, dt_s, 0.0).at_m;
    } else {
      is_off_path = true;
      follower.pause(dt_s);
    }
  }

  void planAnew(const std::string& reason, bool is_obstacle) {
    replan_reason = reason;
    is_obstacle_reason = is_obstacle;
    blocked_since_s.reset();
    braking_since_s.reset();
    patience_until_s.reset();
    mode = Mode::kPlanning;
  }

  void endWith(NavigationStatus status, const std::string& message) {
    end_status = status;
    end_message = message;
    if (status == NavigationStatus::kCancelled) is_asked_to_stop = true;
    braking_since_s.reset();
    mode = Mode::kEnding;
  }

  void plan(double now_s, const std::function<bool()>& is_cancelled) {
    if (plans >= config.max_plans) {
      const std::string message = "planned " + std::to_string(plans) + " times, may be " +
                                  std::to_string(config.max_plans) + ": " + replan_reason;
      return endWith(is_obstacle_reason ? NavigationStatus::kObstacle : NavigationStatus::kTooManyPlans, message);
    }
    ++plans;
    if (next_limits) {  // the base stands
      limits = *next_limits;
      planner = BasePlanner(planner.config(), limits, footprint);
      follower = PathFollower(follower_config, limits);
      next_limits.reset();
    }
    BasePlan made = planner.plan(grid_now, T_map_base, goal_map, is_cancelled);
    grid_checked = grid_now;
    if (made.status != BasePlanStatus::kSolved) {
      way = {};
      ++num_plans;
      std::string message = made.message;
      if (!replan_reason.empty()) message = replan_reason + "; planning anew: " + message;
      const bool is_cancel = made.status == BasePlanStatus::kCancelled;
      // What came into the way may go again: once more after a while.
      if (!replan_reason.empty() && !is_cancel && !has_been_patient) {
        has_been_patient = true;
        patience_until_s = now_s + config.blocked_patience_s;
        patience_reason = message;
        return;
      }
      return endWith(is_obstacle_reason && !is_cancel ? NavigationStatus::kObstacle : statusOf(made.status), message);
    }
    way = std::move(made);
    has_been_patient = false;
    ++num_plans;
    follower.start(way.path);
    is_off_path = false;
    at_m = 0.0;
    planned_s = now_s;
    motions.clear();
    mode = Mode::kPlanned;
  }

  /// Looks at a new grid, once. False: the way ahead is not free any more.
  bool isWayFree() {
    if (grid_now == grid_checked) return true;
    grid_checked = grid_now;
    const FootprintVerdict verdict = planner.recheck(way, at_m, grid_now);
    if (verdict.isFree()) return true;
    replan_reason = std::string("the ground ahead is ") +
                    (verdict.state == SpaceState::kOccupied ? "occupied" : "unknown") + " at " +
                    place(verdict.where_map) + ", " + number(std::max(0.0, verdict.at_m - at_m)) + " m ahead";
    return false;
  }

  /// The share of speed that the scanner leaves: along the way planned, and along the arcs that the base is on and is
  /// about to take, which corrections bend.
  GuardVerdict askGuard() const {
    const Twist2d wanted = follower.wanted(T_map_base);
    const std::vector<BaseMotion> ahead = follower.ahead();
    GuardVerdict verdict;
    if (ahead.empty() || isZero(wanted)) return verdict;
    const Pose2d T_scan_base = motionSinceScan();
    verdict = guard.check(wanted, ahead, *scan_now, T_scan_base);
    if (ahead.front().isTurn()) return verdict;

    double left_m = 0.0;
    for (const BaseMotion& motion : ahead) left_m += std::abs(motion.length_m);
    const double share = guard.config().braking_share;
    const Twist2d& last = follower.lastCommand();
    const double speed_m_s = std::abs(last.linear_m_s);
    const double curved_s =
        std::max(speed_m_s / limits.linear_m_s2, std::abs(last.angular_rad_s) / limits.turn_rad_s2) / share;
    const double stopping_m = speed_m_s * (guard.config().latency_s + 0.5 * curved_s);
    const auto alongArc = [&](const Twist2d& twist, double length_m) {
      const double duration_s = length_m / std::abs(twist.linear_m_s);
      return guard.check(twist, {{twist.linear_m_s * duration_s, twist.angular_rad_s * duration_s}}, *scan_now,
                         T_scan_base);
    };
    const auto worse = [&](GuardVerdict other, double speed) {
      other.speed_factor = std::min(1.0, other.speed_factor * speed / std::abs(wanted.linear_m_s));
      if (other.speed_factor < verdict.speed_factor) verdict = other;
    };
    if (wanted.linear_m_s != 0.0) {
      worse(alongArc(wanted, std::min(left_m, stopping_m + kStoppingMore_m)), std::abs(wanted.linear_m_s));
      if (speed_m_s > 0.0) {
        const GuardVerdict moving = alongArc(last, stopping_m);
        if (moving.speed_factor < 1.0) worse(moving, speed_m_s);
      }
    }
    return verdict;
  }

  /// Enters what was commanded and measured.
  void watchMotion(double now_s, double dt_s, const Twist2d& command) {
    commanded = moveAlongArc(commanded, command.linear_m_s * dt_s, command.angular_rad_s * dt_s);
    commanded_rad += command.angular_rad_s * dt_s;
    // As the localisation told it: what odometry has carried on since says nothing of slip.
    motions.push_back({now_s, commanded, commanded_rad, T_odom_base, T_map_base_at_pose});
    while (motions.size() > 1 && now_s - motions[1].now_s >= config.stuck_s) motions.pop_front();
  }

  /// In words: what is stuck, by so long at least; empty: nothing.
  std::string stuck(double now_s, double least_s) const {
    if (motions.empty() || now_s - motions.front().now_s < least_s) return {};
    const Motion& first = motions.front();
    // What was commanded last need not be seen yet: drives lag, and poses are as old as they may be.
    const Motion* last = &first;
    for (const Motion& one : motions) {
      if (one.now_s <= now_s - config.max_pose_age_s) last = &one;
    }
    const double told_m = (last->commanded.position() - first.commanded.position()).norm();
    const double told_rad = std::abs(last->commanded_rad - first.commanded_rad);
    const auto judge = [&](const char* by, const char* what, Pose2d Motion::*measured) -> std::string {
      // The farthest that it came: who was told to turn and then back has done so.
      double seen_m = 0.0;
      double seen_rad = 0.0;
      for (const Motion& one : motions) {
        seen_m = std::max(seen_m, ((one.*measured).position() - (first.*measured).position()).norm());
        seen_rad = std::max(seen_rad, std::abs(wrapAngle((one.*measured).yaw_rad - (first.*measured).yaw_rad)));
      }
      const std::string within = " within " + number(now_s - first.now_s, 1) + " s, ";
      if (told_m >= kStuckMin_m && seen_m < kStuckShare * told_m) {
        return std::string(what) + ": told to move " + number(told_m, 3) + " m" + within + by + " tells of " +
               number(seen_m, 3) + " m, must be at least " + number(kStuckShare * told_m, 3) + " m";
      }
      // Half a turn and more cannot be told from what remains of a whole one.
      if (told_rad >= kStuckMin_rad && told_rad < 0.9 * M_PI && seen_rad < kStuckShare * told_rad) {
        return std::string(what) + ": told to turn " + number(told_rad, 3) + " rad" + within + by + " tells of " +
               number(seen_rad, 3) + " rad, must be at least " + number(kStuckShare * told_rad, 3) + " rad";
      }
      return {};
    };
    std::string found = judge("odometry", "the wheels do not turn as told", &Motion::T_odom_base);
    if (found.empty()) found = judge("the localisation", "the wheels slip", &Motion::T_map_base);
    return found;
  }

  // ---------------------------------------------------------------------------------------------------------- modes

  /// Too old data: stops, waits, gives up. True: there is nothing else to do in this step.
  bool waitForData(double now_s, double dt_s, NavigationOutput* output) {
    const auto missing = stale(now_s);
    if (!missing) {
      stale_since_s.reset();
      is_asked_to_stop = false;
      return false;
    }
    if (!stale_since_s) stale_since_s = now_s;
    is_asked_to_stop = missing->first == NavigationStatus::kStaleHeartbeat;
    brake(now_s, dt_s);
    motions.clear();
    output->phase = NavigationPhase::kWaitingForData;
    output->reason = missing->second;
    if (now_s - *stale_since_s >= config.stale_patience_s) {
      endWith(missing->first, missing->second + ", after waiting " + number(now_s - *stale_since_s, 1) + " s");
    }
    return true;
  }

  /// The base's own stop. True: there is nothing else to do in this step.
  bool heedStop(double now_s, const std::optional<BaseStop>& told, NavigationOutput* output) {
    const auto isPressed = [](const std::optional<BaseStop>& one) {
      return one == BaseStop::kButton || one == BaseStop::kSignal;
    };
    // Pressed when it is first heard of: who starts the robot knows.
    if (isPressed(told) && stop && !isPressed(stop)) pressed_unheard = toString(*told);
    stop = told;
    const bool is_active = mode != Mode::kIdle && mode != Mode::kEnding;
    if (is_active && (isPressed(stop) || !pressed_unheard.empty())) {
      endWith(NavigationStatus::kBaseStopped,
              isPressed(stop)
                  ? std::string("the base is stopped: ") + toString(*stop)
                  : "the base was stopped before this goal (" + pressed_unheard + "): look, and send the goal again");
      pressed_unheard.clear();
    }
    if (!stop || stop == BaseStop::kNone) {
      stopped_since_s.reset();
      return false;
    }
    // It stands by itself: what is commanded now would be driven at its release.
    follower.halt();
    is_off_path = true;
    motions.clear();
    if (mode == Mode::kIdle || mode == Mode::kEnding) return false;
    if (!stopped_since_s) stopped_since_s = now_s;
    output->phase = NavigationPhase::kBlocked;
    output->reason = std::string("the base is stopped: ") + toString(*stop);
    blocked_since_s.reset();
    stale_since_s.reset();
    if (!jump.empty()) planAnew(jump, false);
    if (mode == Mode::kArriving) arrive(now_s);
    if (now_s - *stopped_since_s >= config.scanner_patience_s) {
      endWith(NavigationStatus::kBaseStopped, output->reason + ", for " + number(now_s - *stopped_since_s, 1) +
                                                  " s, may be " + number(config.scanner_patience_s, 1) + " s");
    }
    return true;
  }

  /// Brakes. True: the base stands. Ends the goal if it does not come to stand.
  bool comeToStand(double now_s, double dt_s, NavigationOutput* output) {
    if (stands(now_s)) {
      braking_since_s.reset();
      return true;
    }
    if (!braking_since_s) braking_since_s = now_s;
    if (!isZero(follower.lastCommand())) {
      brake(now_s, dt_s);
      if (!isZero(follower.lastCommand())) braking_since_s = now_s;
    }
    output->phase = NavigationPhase::kBraking;
    return false;
  }

  void stepPlanning(double now_s, double dt_s, const std::function<bool()>& is_cancelled, NavigationOutput* output) {
    if (!jump.empty()) is_off_path = true;
    if (waitForData(now_s, dt_s, output)) return;
    output->reason = replan_reason;
    if (!comeToStand(now_s, dt_s, output)) {
      if (now_s - *braking_since_s >= kStandPatience_s) {
        endWith(NavigationStatus::kStuck, "the base moves at " + number(odometry_twist.linear_m_s) + " m/s and " +
                                              number(odometry_twist.angular_rad_s) + " rad/s by odometry, " +
                                              number(kStandPatience_s, 1) + " s after it was told to stand");
      }
      return;
    }
    if (patience_until_s && now_s < *patience_until_s) {
      output->phase = NavigationPhase::kBlocked;
      output->reason = patience_reason;
      return;
    }
    patience_until_s.reset();
    output->phase = NavigationPhase::kPlanning;
    if (scan.stamp_s <= jumped_s) {
      // What was seen before is in the wrong place, and where it has been forgotten nothing is known yet.
      output->reason = "localisation or odometry has jumped: waits for the next scan";
      return;
    }
    plan(now_s, is_cancelled);
  }

  void stepPlanned(double now_s, double dt_s, NavigationOutput* output) {
    if (waitForData(now_s, dt_s, output)) return;
    output->phase = NavigationPhase::kPlanning;
    output->reason = replan_reason;
    if (!jump.empty()) return planAnew(jump, false);
    if (!isWayFree()) return planAnew(replan_reason, false);
    if (now_s - planned_s >= config.plan_cost_s) mode = Mode::kDriving;
  }

  void stepDriving(double now_s, double dt_s, NavigationOutput* output) {
    if (!jump.empty()) {
      is_off_path = true;
      planAnew(jump, false);
      brake(now_s, dt_s);
      output->phase = NavigationPhase::kBraking;
      output->reason = replan_reason;
      return;
    }
    if (waitForData(now_s, dt_s, output)) return;
    if (is_off_path) {  // the data is back
      if (!comeToStand(now_s, dt_s, output)) {
        output->reason = "stops where data was missing";
        return;
      }
      if (!follower.resume(T_map_base)) {
        return planAnew("the base came off its way while data was missing", false);
      }
      is_off_path = false;
    }
    if (!isWayFree()) {
      planAnew(replan_reason, false);
      brake(now_s, dt_s);
      output->phase = NavigationPhase::kBraking;
      output->reason = replan_reason;
      return;
    }
    if (!follower.isActive()) {  // came to the end while it braked
      return arrive(now_s);
    }

    output->phase = NavigationPhase::kDriving;
    output->guard = askGuard();
    const Twist2d wanted = follower.wanted(T_map_base);
    output->follow = follower.update(T_map_base, dt_s, output->guard.speed_factor);
    at_m = output->follow.at_m;
    const Twist2d command = output->follow.twist;
    if (output->follow.status == FollowStatus::kReached) return arrive(now_s);
    if (output->follow.status == FollowStatus::kLost) {
      // Carried on with wheels that slip, the pose may be far off before stuck_s are over.
      const std::string slips = stuck(now_s, 0.0);
      if (!slips.empty()) return endWith(NavigationStatus::kStuck, slips);
      planAnew("the base is " + number(std::hypot(output->follow.error_across_m, output->follow.error_along_m)) +
                   " m and " + number(std::abs(output->follow.error_yaw_rad)) + " rad off its way",
               false);
      output->phase = NavigationPhase::kBraking;
      output->reason = replan_reason;
      return;
    }

    const double factor = output->guard.speed_factor;
    const bool is_blocked = factor < 1.0 && factor * std::abs(wanted.linear_m_s) < kBlocked_m_s &&
                            factor * std::abs(wanted.angular_rad_s) < kBlocked_rad_s &&
                            std::abs(command.linear_m_s) < kBlocked_m_s &&
                            std::abs(command.angular_rad_s) < kBlocked_rad_s;
    if (is_blocked) {
      if (!blocked_since_s) blocked_since_s = now_s;
      const Eigen::Vector2d obstacle =
          transform(T_map_base, output->guard.obstacle_base.value_or(Eigen::Vector2d::Zero()));
      const std::string reason = "the scanner sees an obstacle at " + place(obstacle);
      output->phase = NavigationPhase::kBlocked;
      output->reason = reason;
      motions.clear();
      if (now_s - *blocked_since_s >= config.blocked_patience_s) {
        planAnew(reason + ", for " + number(now_s - *blocked_since_s, 1) + " s", true);
      }
      return;
    }
    if (std::abs(command.linear_m_s) >= kBlocked_m_s || std::abs(command.angular_rad_s) >= kBlocked_rad_s) {
      blocked_since_s.reset();
    }
    watchMotion(now_s, dt_s, command);
    const std::string found = stuck(now_s, config.stuck_s);
    if (!found.empty()) endWith(NavigationStatus::kStuck, found);
  }

  void arrive(double now_s) {
    mode = Mode::kArriving;
    arrived_s = now_s;
    braking_since_s.reset();
    num_poses = 0;
    position_sum.setZero();
    heading_sum.setZero();
  }

  void stepArriving(double now_s, double dt_s, NavigationOutput* output) {
    if (!jump.empty()) {
      is_off_path = true;
      return planAnew(jump, false);
    }
    if (waitForData(now_s, dt_s, output)) return;
    if (!comeToStand(now_s, dt_s, output)) {
      arrive(now_s);
      return;
    }
    output->phase = NavigationPhase::kDriving;
    if (pose.stamp_s != last_pose_stamp_s) {
      last_pose_stamp_s = pose.stamp_s;
      position_sum += T_map_base.position();
      heading_sum += Eigen::Vector2d(std::cos(T_map_base.yaw_rad), std::sin(T_map_base.yaw_rad));
      ++num_poses;
    }
    if (now_s - arrived_s < kArrival_s || num_poses == 0) return;
    const double off_m = (position_sum / num_poses - goal_map.position()).norm();
    const double off_rad = std::abs(wrapAngle(std::atan2(heading_sum.y(), heading_sum.x()) - goal_map.yaw_rad));
    const BasePlannerConfig& wanted = planner.config();
    const std::string where = number(off_m, 3) + " m and " + number(off_rad, 3) + " rad from the goal";
    const std::string allowed =
        "may be " + number(wanted.position_tolerance_m, 3) + " m and " + number(wanted.yaw_tolerance_rad, 3) + " rad";
    if (off_m <= wanted.position_tolerance_m && off_rad <= wanted.yaw_tolerance_rad) {
      return endWith(NavigationStatus::kSuccess, "stands " + where + ", " + allowed);
    }
    const std::string missed = "came to the end of the way " + where + ", " + allowed;
    if (misses >= kMaxMisses) {
      return endWith(NavigationStatus::kGoalMissed, missed + ", " + std::to_string(misses + 1) + " times");
    }
    ++misses;
    planAnew(missed, false);
  }

  void stepEnding(double now_s, double dt_s, NavigationOutput* output) {
    if (!jump.empty()) is_off_path = true;
    output->reason = end_message;
    bool has_ended = comeToStand(now_s, dt_s, output);
    // Without odometry nobody knows; and what does not stand when told so is not waited for.
    if (!has_ended && isZero(follower.lastCommand())) {
      has_ended = !isOdometryFresh(now_s) || now_s - *braking_since_s >= kStandPatience_s;
    }
    if (!has_ended) return;
    output->ended = end_status;
    output->message = end_message;
    output->reason.clear();
    output->phase = stands(now_s) ? NavigationPhase::kIdle : NavigationPhase::kBraking;
    follower.brake(dt_s);  // no path any more
    way = {};
    ++num_plans;
    ended_s = now_s;
    mode = Mode::kIdle;
  }

  NavigationOutput step(const NavigationInput& input, const std::function<bool()>& is_cancelled) {
    if (!std::isfinite(input.now_s)) throw std::invalid_argument("now_s is not finite");
    const double now_s = input.now_s;
    const double elapsed_s = std::isfinite(last_now_s) ? now_s - last_now_s : 0.02;
    if (elapsed_s == 0.0) {  // twice at one time: nothing new to command
      last_output.ended.reset();
      last_output.has_jumped = false;
      return last_output;
    }
    last_now_s = now_s;
    if (elapsed_s < 0.0) {
      // What all stamps and times meant is void: a bag or a simulation began again.
      forgetData();
      is_pose_known = was_odometry_fresh_at_pose = false;
      jumped_s = -std::numeric_limits<double>::infinity();
      follower.halt();
      stale_since_s.reset();
      stopped_since_s.reset();
      if (mode != Mode::kIdle) {
        endWith(NavigationStatus::kStaleOdometry, "the clock ran back by " + number(-elapsed_s) + " s");
      }
      if (ended_s) ended_s = now_s;
    }
    const double dt_s = elapsed_s < 0.0 ? 0.02 : std::min(elapsed_s, kMaxStep_s);
    take(input);

    NavigationOutput output;
    const bool is_stopped = heedStop(now_s, input.stop, &output);
    if (!is_stopped) stepMode(now_s, dt_s, is_cancelled, &output);
    output.command = follower.lastCommand();
    output.has_jumped = has_jumped;
    output.remaining_m = way.path.motions.empty() ? 0.0 : std::max(0.0, way.path.length() - at_m);
    last_output = output;
    return output;
  }

  void stepMode(double now_s, double dt_s, const std::function<bool()>& is_cancelled, NavigationOutput* output) {
    switch (mode) {
      case Mode::kIdle:
        follower.halt();
        // Zeros until the base stands, or nobody can tell.
        if (ended_s && !stands(now_s) && now_s - *ended_s < kStandPatience_s) {
          output->phase = NavigationPhase::kBraking;
          output->reason = isOdometryFresh(now_s) ? "told to stand, and moves by odometry"
                                                  : "told to stand, and without odometry nobody knows whether it does";
        } else {
          ended_s.reset();
        }
        break;
      case Mode::kPlanning:
        stepPlanning(now_s, dt_s, is_cancelled, output);
        break;
      case Mode::kPlanned:
        stepPlanned(now_s, dt_s, output);
        break;
      case Mode::kDriving:
        stepDriving(now_s, dt_s, output);
        break;
      case Mode::kArriving:
        stepArriving(now_s, dt_s, output);
        break;
      case Mode::kEnding:
        stepEnding(now_s, dt_s, output);
        break;
    }
  }

  void forgetData() {
    for (Source* source : {&odometry, &pose, &scan, &grid, &heartbeat}) source->reset();
    odometry_history.clear();
    scan_now.reset();
    grid_now.reset();
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
  if (!isFinite(goal_map)) {
    throw std::invalid_argument("goal (" + number(goal_map.x_m) + ", " + number(goal_map.y_m) + ", " +
                                number(goal_map.yaw_rad) + ") must be finite");
  }
  State& state = *state_;
  // A source that was refused may have begun anew since.
  if (state.mode == Mode::kIdle) state.forgetData();
  state.goal_map = goal_map;
  state.plans = 0;
  state.has_been_patient = false;
  state.misses = 0;
  state.stale_since_s.reset();
  state.ended_s.reset();
  state.stopped_since_s.reset();
  state.is_asked_to_stop = false;
  state.planAnew("", false);
}

void BaseNavigator::cancel() {
  if (state_->mode == Mode::kIdle) return;
  if (state_->mode == Mode::kEnding && state_->end_status != NavigationStatus::kSuccess) return;
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
  return state_->plans;
}

std::uint64_t BaseNavigator::numPlans() const {
  return state_->num_plans;
}

}  // namespace base_navigation
