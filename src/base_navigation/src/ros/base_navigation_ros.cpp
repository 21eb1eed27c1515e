// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation_ros/base_navigation_ros.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <thread>

#include <geometry_msgs/Twist.h>
#include <interactive_mapping_common/formatted.h>
#include <interactive_mapping_common_ros/cancel_asked.h>
#include <interactive_mapping_common_ros/poses.h>
#include <ros/console.h>

#include "base_navigation_ros/conversions.h"

namespace base_navigation_ros {
namespace {

using base_navigation::BasePlan;
using base_navigation::BasePlanStatus;
using base_navigation::BaseStop;
using base_navigation::compose;
using base_navigation::NavigationGrid;
using base_navigation::NavigationInput;
using base_navigation::NavigationOutput;
using base_navigation::NavigationPhase;
using base_navigation::NavigationStatus;
using base_navigation::Pose2d;
using base_navigation::Scan;
using interactive_mapping::formatted;
using interactive_mapping_msgs::NavigationOutcome;
using interactive_mapping_msgs::NavigationState;
using interactive_mapping_ros::isCancelAsked;
using interactive_mapping_ros::toIsometry;
using interactive_mapping_ros::withoutSlash;

constexpr char kLog[] = "base_navigation";
constexpr std::size_t kMaxWaitingScans = 20;  // of 25 Hz, while no odometry comes
constexpr double kMaxScanAge_s = 1.0;         // an older scan is not entered in the grid
constexpr double kMaxAhead_s = 0.2;           // of scan and ground, of another computer's clock
constexpr double kShowPeriod_s = 0.2;         // of markers and feedback
constexpr double kPathStep_m = 0.05;          // between the poses of ~path
constexpr double kGoalTfWait_s = 0.5;  // how far a goal's stamp may be ahead of tf, and wall time it is waited for
constexpr double kMaxOrigin_m =
    4e4;  // of odometry and localisation from their origins: the grid's indices end at 100 km
constexpr double kMaxSilence_s = 3.0;  // wall time without a step, after which the diagnostics complain
constexpr std::chrono::microseconds kPollPeriod(500);

double toSec(const ros::Time& stamp) {
  return stamp.isZero() ? -1.0 : stamp.toSec();
}

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr Pose2d kNoPose{kNan, kNan, kNan};

}  // namespace

BaseNavigationRos::BaseNavigationRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : params_(loadBaseNavigationParams(private_nh)),
      profile_(mp700_ur5e_description::loadBaseProfile(params_.base_profile_file)),
      tf_listener_(tf_, true, ros::TransportHints().tcpNoDelay()),
      fusion_(params_.grid, profile_.body.footprint_m),
      navigator_(params_.navigator, params_.planner, params_.follower, params_.guard, params_.limitsOf(profile_),
                 profile_.body.footprint_m),
      ground_(params_.map_frame, params_.ground.occupied_from),
      markers_(private_nh, params_.map_frame, profile_.body.footprint_m),
      diagnostics_(nh, private_nh) {
  ROS_DEBUG_NAMED(kLog, "parameters:\n%s", interactive_mapping::toYaml(params_).c_str());
  ros::NodeHandle handle(private_nh);
  ros::NodeHandle outer(nh);
  command_publisher_ = outer.advertise<geometry_msgs::Twist>("cmd_vel", 1);
  state_publisher_ = handle.advertise<NavigationState>("state", 50);
  outcome_publisher_ = handle.advertise<NavigationOutcome>("outcome", 10, true);
  path_publisher_ = handle.advertise<nav_msgs::Path>("path", 1, true);
  grid_publisher_ = handle.advertise<nav_msgs::OccupancyGrid>("grid", 1, true);

  server_ = std::make_unique<Server>(
      outer, "move_base", [this](GoalHandle goal) { onGoal(goal); }, interactive_mapping_ros::NoCancelCallback(),
      false);
  goal_publisher_ = outer.advertise<move_base_msgs::MoveBaseActionGoal>("move_base/goal", 1);
  simple_goal_subscriber_ = outer.subscribe("move_base_simple/goal", 1, &BaseNavigationRos::onSimpleGoal, this);
  live_ = std::make_unique<interactive_mapping_ros::LiveParams<BaseNavigationParams>>(
      private_nh, params_, [this](const BaseNavigationParams& params) {
        interactive_mapping::refuseIfAny("impossible:", params.problemsFor(profile_));
        const std::lock_guard<std::mutex> lock(goal_mutex_);
        tuned_ = params;
      });
  plan_server_ = handle.advertiseService("make_plan", &BaseNavigationRos::onMakePlan, this);
  forget_server_ = handle.advertiseService("forget_scans", &BaseNavigationRos::onForget, this);

  diagnostics_.setHardwareID("none");
  diagnostics_.add("inputs", this, &BaseNavigationRos::diagnoseInputs);
  diagnostics_.add("goals", this, &BaseNavigationRos::diagnoseGoals);
  // By the wall clock: a clock that stands still is something to report.
  diagnostics_timer_ = handle.createWallTimer(ros::WallDuration(1.0),
                                              [this](const ros::WallTimerEvent&) { diagnostics_.force_update(); });

  ros::NodeHandle control(nh);
  control.setCallbackQueue(&control_queue_);
  // What is acted on must not be held back by Nagle's algorithm.
  const ros::TransportHints no_delay = ros::TransportHints().tcpNoDelay();
  odometry_subscriber_ = control.subscribe("odom", 20, &BaseNavigationRos::onOdometry, this, no_delay);
  scan_subscriber_ = control.subscribe("scan", 5, &BaseNavigationRos::onScan, this, no_delay);
  ground_subscriber_ = control.subscribe("map/ground", 2, &BaseNavigationRos::onGround, this);
  // As costmap_2d names it.
  ground_update_subscriber_ =
      control.subscribe(ground_subscriber_.getTopic() + "_updates", 20, &BaseNavigationRos::onGroundUpdate, this);
  emergency_stop_subscriber_ =
      control.subscribe("emergency_stop_state", 10, &BaseNavigationRos::onEmergencyStop, this, no_delay);
  stop_subscriber_ = control.subscribe("base_stop", 10, &BaseNavigationRos::onStop, this, no_delay);
  if (params_.navigator.max_heartbeat_age_s > 0.0) {
    heartbeat_subscriber_ = control.subscribe("heartbeat", 10, &BaseNavigationRos::onHeartbeat, this, no_delay);
  }
  watchdog_ = std::make_unique<interactive_mapping_ros::ClockTimer>(
      control, ros::Duration(1.0 / params_.output.watchdog_rate_hz), [this] { onWatchdog(); });
  control_spinner_ = std::make_unique<ros::AsyncSpinner>(1, &control_queue_);
  control_spinner_->start();
  server_->start();
}

BaseNavigationRos::~BaseNavigationRos() {
  {
    const std::lock_guard<std::mutex> lock(goal_mutex_);
    is_stopping_ = true;  // ends a plan that is being made
  }
  control_spinner_->stop();
  diagnostics_timer_.stop();
  plan_server_.shutdown();
  forget_server_.shutdown();
}

void BaseNavigationRos::stop(ros::WallDuration timeout) {
  std::unique_lock<std::mutex> lock(goal_mutex_);
  is_stopping_ = true;
  idle_.wait_for(lock, std::chrono::nanoseconds(timeout.toNSec()), [this] { return !has_current_; });
}

// ---------------------------------------------------------------------------------------------------------- goals

void BaseNavigationRos::onGoal(GoalHandle goal) {
  // Answered at once, so that a client knows, before time goes on, that the next odometry begins it.
  goal.setAccepted();
  std::optional<GoalHandle> replaced;
  bool is_refused = false;
  {
    const std::lock_guard<std::mutex> lock(goal_mutex_);
    is_refused = is_stopping_;
    if (!is_refused) {
      replaced = next_;
      next_ = goal;
    }
  }
  if (is_refused) refuse(goal, NavigationStatus::kCancelled, "the node is shutting down");
  if (replaced) refuse(*replaced, NavigationStatus::kCancelled, "replaced by a newer goal before it was begun");
}

void BaseNavigationRos::onSimpleGoal(const geometry_msgs::PoseStampedConstPtr& message) {
  // To the own server, as any other client's: one way for all goals.
  move_base_msgs::MoveBaseActionGoal goal;
  goal.header.stamp = ros::Time::now();
  goal.goal.target_pose = *message;
  goal_publisher_.publish(goal);
}

void BaseNavigationRos::refuse(GoalHandle& goal, Status status, const std::string& message) {
  publishOutcome(goal, kNoPose, status, message, 0);
  if (status == NavigationStatus::kCancelled) {
    goal.setCanceled(move_base_msgs::MoveBaseResult(), message);
  } else {
    goal.setAborted(move_base_msgs::MoveBaseResult(), std::string(toString(status)) + ": " + message);
  }
}

void BaseNavigationRos::takeRequests() {
  std::optional<GoalHandle> newest;
  bool is_forget = false;
  bool is_stopping = false;
  std::optional<BaseNavigationParams> tuned;
  {
    const std::lock_guard<std::mutex> lock(goal_mutex_);
    newest.swap(next_);
    tuned.swap(tuned_);
    is_forget = is_forget_asked_;
    is_forget_asked_ = false;
    is_stopping = is_stopping_;
  }
  if (is_forget) forgetScans();
  if (tuned) navigator_.retune(tuned->guard, tuned->limitsOf(profile_));
  if (newest) {
    if (waiting_) refuse(*waiting_, NavigationStatus::kCancelled, "replaced by a newer goal before it was begun");
    waiting_ = newest;
    waiting_since_ = std::chrono::steady_clock::now();
  }
  if (waiting_ && (is_stopping || isCancelAsked(*waiting_))) {
    refuse(*waiting_, NavigationStatus::kCancelled,
           is_stopping ? "the node is shutting down" : "cancelled before it was begun");
    waiting_.reset();
  }
  if (current_ && (is_stopping || isCancelAsked(*current_))) navigator_.cancel();
  if (!waiting_) return;

  // tf may be a little behind the goal's stamp. Control goes on meanwhile.
  const geometry_msgs::PoseStamped& target = waiting_->getGoal()->target_pose;
  const bool is_late =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - waiting_since_).count() > kGoalTfWait_s;
  const std::string frame = withoutSlash(target.header.frame_id);
  if (!is_late && frame != params_.map_frame && !target.header.stamp.isZero() &&
      !tf_.canTransform(params_.map_frame, frame, target.header.stamp)) {
    return;
  }
  std::optional<GoalHandle> goal;
  goal.swap(waiting_);
  std::string why_not;
  const std::optional<Pose2d> goal_map = poseInMap(target, "goal", &why_not);
  if (!goal_map) {
    // What is being driven to goes on: a goal that makes no sense replaces nothing.
    ROS_WARN_NAMED(kLog, "goal refused: %s", why_not.c_str());
    refuse(*goal, NavigationStatus::kBadGoal, why_not);
    return;
  }
  if (current_) finish(NavigationStatus::kCancelled, "replaced by a newer goal");
  current_ = goal;
  current_goal_map_ = *goal_map;
  {
    const std::lock_guard<std::mutex> lock(goal_mutex_);
    has_current_ = true;
  }
  navigator_.setGoal(*goal_map);
  is_grid_old_ = true;
}

void BaseNavigationRos::publishOutcome(const GoalHandle& goal, const Pose2d& goal_map, Status status,
                                       const std::string& message, int plans) {
  NavigationOutcome outcome;
  outcome.header.stamp = ros::Time::now();
  outcome.header.frame_id = params_.map_frame;
  outcome.goal_id = goal.getGoalID().id;
  outcome.status = static_cast<std::uint8_t>(status);
  outcome.message = message;
  outcome.goal = toPose(goal_map);
  outcome.plans = static_cast<std::uint32_t>(plans);
  {
    const std::lock_guard<std::mutex> lock(shared_mutex_);
    outcome.base = toPose(T_map_base_.value_or(kNoPose));
    ++outcomes_[toString(status)];
    if (status != NavigationStatus::kSuccess) {
      last_failure_ = std::string(toString(status)) + ": " + message;
    }
  }
  outcome_publisher_.publish(outcome);
}

void BaseNavigationRos::finish(Status status, const std::string& message) {
  publishOutcome(*current_, current_goal_map_, status, message, navigator_.plansForGoal());
  GoalHandle goal = *current_;
  current_.reset();
  {
    const std::lock_guard<std::mutex> lock(goal_mutex_);
    has_current_ = false;
  }
  const move_base_msgs::MoveBaseResult result;
  if (status == NavigationStatus::kSuccess) {
    goal.setSucceeded(result);
  } else if (status == NavigationStatus::kCancelled) {
    goal.setCanceled(result, message);
  } else {
    ROS_WARN_NAMED(kLog, "%s: %s", toString(status), message.c_str());
    goal.setAborted(result, std::string(toString(status)) + ": " + message);
  }
  idle_.notify_all();
}

// ---------------------------------------------------------------------------------------------------------- inputs

void BaseNavigationRos::onOdometry(const nav_msgs::OdometryConstPtr& message) {
  const std::optional<Eigen::Isometry3d> T = toIsometry(message->pose.pose);
  const auto& twist = message->twist.twist;
  std::string problem;
  if (withoutSlash(message->header.frame_id) != params_.odom_frame ||
      withoutSlash(message->child_frame_id) != params_.base_frame) {
    problem = "odometry of '" + message->child_frame_id + "' in '" + message->header.frame_id + "', must be of '" +
              params_.base_frame + "' in '" + params_.odom_frame + "'";
  } else if (!T || !std::isfinite(twist.linear.x) || !std::isfinite(twist.angular.z)) {
    problem = "odometry with a pose or twist that is not finite, or no rotation";
  } else if (T->translation().norm() > kMaxOrigin_m) {
    problem =
        formatted("odometry %.3g m from its origin, must be at most %.0f m", T->translation().norm(), kMaxOrigin_m);
  } else if (message->header.stamp.isZero()) {
    problem = "odometry without a stamp";
  }
  {
    const std::lock_guard<std::mutex> lock(shared_mutex_);
    odometry_problem_ = problem;
    if (problem.empty()) odometry_seen_ = message->header.stamp;
  }
  if (!problem.empty()) {
    ROS_WARN_THROTTLE_NAMED(10.0, kLog, "%s: ignored", problem.c_str());
    return;  // as if none had come: the watchdog sees to the rest
  }

  const ros::Time stamp = message->header.stamp;
  if (!odometry_.add(stamp, toPlane(*T))) {
    ROS_WARN_NAMED(kLog, "time ran back to %.3f s: scans and the driven path are forgotten", stamp.toSec());
    forgetScans();
    new_scans_.clear();
    new_ground_.clear();
    scan_ = {};
    ground_stamp_ = jumped_ = grid_published_ = markers_published_ = feedback_published_ = ros::Time();
    localisation_stamp_ = last_step_ = ros::Time();
    tf_.clear();
  }
  odometry_twist_ = {twist.linear.x, twist.angular.z};
  // The watchdog may have gone ahead of messages that wait here, after a long plan: time does not run back for that.
  step(std::max(stamp, last_step_));
}

void BaseNavigationRos::onScan(const sensor_msgs::LaserScanConstPtr& message) {
  std::string problem;
  const std::string frame = withoutSlash(message->header.frame_id);
  auto scanner = scanners_.find(frame);
  if (scanner == scanners_.end()) {
    try {
      const auto T = toIsometry(tf_.lookupTransform(params_.base_frame, frame, ros::Time(0)).transform);
      if (T) {
        scanner = scanners_.emplace(frame, *T).first;
      } else {
        problem = "tf's pose of scanner '" + frame + "' is not finite or no rotation";
      }
    } catch (const tf2::TransformException& error) {
      problem = "where scanner '" + frame + "' sits on " + params_.base_frame + " is not in tf: " + error.what();
    }
  }
  if (scanner != scanners_.end()) {
    std::optional<Scan> scan = toScan(*message, scanner->second, &problem);
    if (scan && !isAhead(message->header.stamp, &problem)) {
      new_scans_.emplace_back(message->header.stamp, std::make_shared<const Scan>(std::move(*scan)));
      if (new_scans_.size() > kMaxWaitingScans) new_scans_.pop_front();
    }
  }
  if (!problem.empty()) ROS_WARN_THROTTLE_NAMED(10.0, kLog, "scan ignored: %s", problem.c_str());
  const std::lock_guard<std::mutex> lock(shared_mutex_);
  scan_problem_ = problem;
  if (problem.empty()) scan_seen_ = message->header.stamp;
}

bool BaseNavigationRos::isAhead(const ros::Time& stamp, std::string* problem) const {
  // It would wait for its time, and then count as new. Odometry may be ahead of a simulated clock.
  const double ahead_s = (stamp - std::max(ros::Time::now(), last_step_)).toSec();
  if (ahead_s <= kMaxAhead_s) return false;
  *problem = formatted("its stamp is %.3g s ahead of ROS time, must be at most %.1f s: do the clocks agree?", ahead_s,
                       kMaxAhead_s);
  return true;
}

void BaseNavigationRos::onGround(const nav_msgs::OccupancyGridConstPtr& message) {
  std::string problem;
  const GroundInput::Grid grid = ground_.take(*message, &problem);
  enterGround(grid, message->header.stamp, problem);
}

void BaseNavigationRos::onGroundUpdate(const map_msgs::OccupancyGridUpdateConstPtr& message) {
  std::string problem;
  const GroundInput::Grid grid = ground_.take(*message, &problem);
  enterGround(grid, message->header.stamp, problem);
}

void BaseNavigationRos::enterGround(GroundInput::Grid grid, const ros::Time& stamp, std::string problem) {
  if (grid && !isGroundStatic() && isAhead(stamp, &problem)) grid.reset();
  if (grid && isGroundStatic()) {
    fusion_.setMap(grid);  // whatever its stamp
    has_static_ground_ = true;
    is_grid_old_ = true;
  } else if (grid) {
    new_ground_.emplace_back(stamp, grid);
    if (new_ground_.size() > 2) new_ground_.pop_front();
  } else {
    has_static_ground_ = false;  // it was to be replaced, and never grows old
    ROS_WARN_THROTTLE_NAMED(10.0, kLog, "the map's ground ignored: %s", problem.c_str());
  }
  const std::lock_guard<std::mutex> lock(shared_mutex_);
  ground_problem_ = problem;
  if (grid) ground_seen_ = isGroundStatic() ? ros::Time::now() : stamp;
}

void BaseNavigationRos::onEmergencyStop(const neo_msgs::EmergencyStopStateConstPtr& message) {
  if (message->emergency_button_stop) {
    relay_stop_ = BaseStop::kButton;
  } else if (message->scanner_stop) {
    relay_stop_ = BaseStop::kScanner;
  } else if (message->emergency_state == neo_msgs::EmergencyStopState::EMFREE) {
    relay_stop_ = BaseStop::kNone;
  } else if (!relay_stop_ || relay_stop_ == BaseStop::kNone) {
    relay_stop_ = BaseStop::kButton;  // stopped, and it does not tell by what
  }                                   // else being released: still what it was
  tellStop();
}

void BaseNavigationRos::onStop(const std_msgs::BoolConstPtr& message) {
  signal_stop_ = message->data != 0 ? BaseStop::kSignal : BaseStop::kNone;
  tellStop();
}

void BaseNavigationRos::tellStop() {
  const std::optional<BaseStop> stop = std::max(relay_stop_, signal_stop_);  // nothing is less than any
  if (stop == told_stop_) return;
  told_stop_ = stop;
  const bool is_stopped = stop != BaseStop::kNone;
  if (is_stopped) ROS_WARN_NAMED(kLog, "the base is stopped: %s", toString(*stop));
  const std::lock_guard<std::mutex> lock(shared_mutex_);
  stop_ = is_stopped ? toString(*stop) : "";
}

void BaseNavigationRos::onHeartbeat(const std_msgs::HeaderConstPtr& message) {
  heartbeat_stamp_ = message->stamp;
  const std::lock_guard<std::mutex> lock(shared_mutex_);
  heartbeat_seen_ = message->stamp;
}

void BaseNavigationRos::lookUpLocalisation(const ros::Time& stamp) {
  // After a wait that failed it does not wait again until a localisation has come in time.
  const double wait_s = is_localisation_late_ ? 0.0 : params_.pose.wait_s;
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(wait_s);
  while (wait_s > 0.0 && !tf_.canTransform(params_.map_frame, params_.odom_frame, stamp) &&
         std::chrono::steady_clock::now() < deadline) {
    std::this_thread::sleep_for(kPollPeriod);  // tf's buffer has no event that one thread can wait for
  }
  std::string problem;
  try {
    const bool at_stamp = tf_.canTransform(params_.map_frame, params_.odom_frame, stamp);
    is_localisation_late_ = !at_stamp;
    const auto message = tf_.lookupTransform(params_.map_frame, params_.odom_frame, at_stamp ? stamp : ros::Time(0));
    const std::optional<Eigen::Isometry3d> T = toIsometry(message.transform);
    if (T && T->translation().norm() > kMaxOrigin_m) {
      problem = formatted("%s is %.3g m from %s in tf, must be at most %.0f m", params_.odom_frame.c_str(),
                          T->translation().norm(), params_.map_frame.c_str(), kMaxOrigin_m);
    } else if (T) {
      T_map_odom_ = toPlane(*T);
      // Static: as new as the odometry. Localisations date theirs ahead, so that others need not wait.
      localisation_stamp_ = message.header.stamp.isZero() ? stamp : std::min(message.header.stamp, stamp);
    } else {
      problem = "tf's pose of " + params_.odom_frame + " in " + params_.map_frame + " is not finite or no rotation";
    }
  } catch (const tf2::TransformException& error) {
    problem = error.what();
  }
  const std::lock_guard<std::mutex> lock(shared_mutex_);
  localisation_problem_ = problem;
  localisation_seen_ = localisation_stamp_;
}

void BaseNavigationRos::enterScans(const ros::Time& before) {
  // What has the odometry's own stamp may come before or after it: it waits for the next one, so that the order of
  // arrival changes nothing.
  while (!new_scans_.empty() && new_scans_.front().first < before) {
    const auto& [stamp, scan] = new_scans_.front();
    if (scan_.second == nullptr || stamp >= scan_.first) scan_ = new_scans_.front();
    // From before a jump: odometry and localisation of one time need not go together.
    const std::optional<Pose2d> T_odom_base = stamp < jumped_ ? std::nullopt : odometry_.at(stamp);
    if (T_odom_base && !localisation_stamp_.isZero() && (before - stamp).toSec() <= kMaxScanAge_s) {
      fusion_.addScan(*scan, compose(T_map_odom_, *T_odom_base), stamp.toSec());
      is_grid_old_ = true;
    }
    new_scans_.pop_front();
  }
  while (!new_ground_.empty() && new_ground_.front().first < before) {
    fusion_.setMap(new_ground_.front().second);
    ground_stamp_ = new_ground_.front().first;
    new_ground_.pop_front();
    is_grid_old_ = true;
  }
}

void BaseNavigationRos::forgetScans() {
  fusion_.forget();
  is_grid_old_ = true;
  grid_built_ = ros::Time();  // at once, idle too: ~make_plan uses it
}

// ------------------------------------------------------------------------------------------------------------ steps

void BaseNavigationRos::onWatchdog() {
  const ros::Time now = ros::Time::now();
  if (!odometry_.isEmpty() && (now - odometry_.newestStamp()).toSec() <= params_.navigator.max_odometry_age_s) return;
  step(now);
}

void BaseNavigationRos::step(const ros::Time& now) {
  last_step_ = now;
  lookUpLocalisation(now);
  const Pose2d T_odom_base = odometry_.isEmpty() ? Pose2d() : odometry_.newest();
  const Pose2d T_map_base = compose(T_map_odom_, T_odom_base);
  const bool is_pose_known = !odometry_.isEmpty() && !localisation_stamp_.isZero();
  enterScans(now);
  {
    const std::lock_guard<std::mutex> lock(shared_mutex_);
    T_map_base_ = is_pose_known ? std::make_optional(T_map_base) : std::nullopt;
    stepped_ = ros::WallTime::now();
  }
  takeRequests();

  if (is_pose_known) {
    const bool is_due = navigator_.isActive() || grid_ == nullptr ||
                        (now - grid_built_).toSec() * params_.output.grid_rate_hz >= 1.0 || now < grid_built_;
    if (is_grid_old_ && is_due) {
      fusion_.addFootprint(T_map_base);
      std::shared_ptr<const NavigationGrid> grid = fusion_.build(T_map_base, now.toSec());
      is_grid_old_ = false;
      grid_built_ = now;
      const std::lock_guard<std::mutex> lock(shared_mutex_);
      grid_ = std::move(grid);
    }
  }

  NavigationInput input;
  input.now_s = now.toSec();
  input.T_map_base = T_map_base;
  input.pose_stamp_s = is_pose_known ? toSec(localisation_stamp_) : -1.0;
  input.T_odom_base = T_odom_base;
  input.odometry_twist = odometry_twist_;
  input.odometry_stamp_s = odometry_.isEmpty() ? -1.0 : odometry_.newestStamp().toSec();
  input.scan = scan_.second;
  input.scan_stamp_s = scan_.second ? scan_.first.toSec() : -1.0;
  input.grid = grid_;
  if (!params_.ground.required) {
    input.grid_stamp_s = input.scan_stamp_s;
  } else if (isGroundStatic()) {
    input.grid_stamp_s = has_static_ground_ ? 0.0 : -1.0;
  } else {
    input.grid_stamp_s = toSec(ground_stamp_);
  }
  input.stop = told_stop_;
  {
    const std::lock_guard<std::mutex> lock(shared_mutex_);
    input.odometry_problem = odometry_problem_;
    input.pose_problem = localisation_problem_;
    if (!scan_problem_.empty()) input.scan_problem = "the scan: " + scan_problem_;
    if (!ground_problem_.empty()) input.grid_problem = "the map's ground: " + ground_problem_;
  }
  input.heartbeat_stamp_s = toSec(heartbeat_stamp_);
  const NavigationOutput output = navigator_.step(input, [this] {
    if (current_ && isCancelAsked(*current_)) return true;
    const std::lock_guard<std::mutex> lock(goal_mutex_);
    return is_stopping_;
  });
  if (output.has_jumped) {
    ROS_WARN_THROTTLE_NAMED(1.0, kLog, "localisation or odometry has jumped: scans and the driven path are forgotten");
    jumped_ = now;
    forgetScans();
  }
  publish(output, now);
  if (output.ended && current_) finish(*output.ended, output.message);
}

void BaseNavigationRos::publish(const NavigationOutput& output, const ros::Time& stamp) {
  geometry_msgs::Twist command;
  command.linear.x = output.command.linear_m_s;
  command.angular.z = output.command.angular_rad_s;
  // Idle, somebody else may drive.
  if (output.phase != NavigationPhase::kIdle || output.ended) command_publisher_.publish(command);

  std::optional<Pose2d> T_map_base;
  std::shared_ptr<const NavigationGrid> grid;
  {
    const std::lock_guard<std::mutex> lock(shared_mutex_);
    phase_ = output.phase;
    reason_ = output.reason;
    T_map_base = T_map_base_;
    grid = grid_;
  }
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = params_.map_frame;
  const auto isDue = [&stamp](ros::Time* last, double period_s) {
    if (!last->isZero() && stamp >= *last && (stamp - *last).toSec() < period_s) return false;
    *last = stamp;
    return true;
  };

  if (navigator_.numPlans() != shown_plans_) {
    shown_plans_ = navigator_.numPlans();
    path_publisher_.publish(toMessage(navigator_.path(), kPathStep_m, header));
  }
  if (grid && grid_publisher_.getNumSubscribers() > 0 && isDue(&grid_published_, 1.0 / params_.output.grid_rate_hz)) {
    grid_publisher_.publish(toMessage(*grid, header));
  }
  if (T_map_base && markers_.isWatched() && isDue(&markers_published_, kShowPeriod_s)) {
    markers_.show(output, *T_map_base, current_ ? std::optional<Pose2d>(current_goal_map_) : std::nullopt, stamp);
  }
  if (T_map_base && current_ && isDue(&feedback_published_, kShowPeriod_s)) {
    move_base_msgs::MoveBaseFeedback feedback;
    feedback.base_position.header = header;
    feedback.base_position.pose = toPose(*T_map_base);
    current_->publishFeedback(feedback);
  }

  // Last: who waits for it may rely on all the rest having been sent.
  NavigationState state;
  state.header = header;
  state.phase = static_cast<std::uint8_t>(output.phase);
  state.reason = output.reason;
  state.command = command;
  state.speed_factor = output.guard.speed_factor;
  state.free_m = output.guard.free_m;
  state.remaining_m = output.remaining_m;
  state.error_across_m = output.follow.error_across_m;
  state.error_yaw_rad = output.follow.error_yaw_rad;
  state_publisher_.publish(state);
}

// --------------------------------------------------------------------------------------------------------- requests

std::optional<Eigen::Isometry3d> BaseNavigationRos::transformToMap(const std::string& name, const ros::Time& stamp,
                                                                   std::string* why_not) const {
  const std::string frame = withoutSlash(name);
  if (frame == params_.map_frame) return Eigen::Isometry3d::Identity();
  if (frame.empty()) {
    *why_not = "no frame is given";
    return std::nullopt;
  }
  try {
    const auto T = toIsometry(tf_.lookupTransform(params_.map_frame, frame, stamp).transform);
    if (!T) *why_not = "tf's pose of '" + frame + "' in " + params_.map_frame + " is not finite or no rotation";
    return T;
  } catch (const tf2::TransformException& error) {
    *why_not = "no pose of frame '" + frame + "' in " + params_.map_frame +
               (stamp.isZero() ? "" : formatted(" at %.3f s", stamp.toSec())) + ": " + error.what();
    return std::nullopt;
  }
}

std::optional<Pose2d> BaseNavigationRos::poseInMap(const geometry_msgs::PoseStamped& pose, const char* what,
                                                   std::string* why_not) const {
  const std::optional<Eigen::Isometry3d> T_frame_goal = toIsometry(pose.pose);
  const auto& p = pose.pose.position;
  const auto& q = pose.pose.orientation;
  if (!T_frame_goal) {
    *why_not = formatted(
        "the %s's position (%.3g, %.3g, %.3g) or quaternion (%.3g, %.3g, %.3g, %.3g) is not finite, or the "
        "quaternion's "
        "length is not 1",
        what, p.x, p.y, p.z, q.x, q.y, q.z, q.w);
    return std::nullopt;
  }
  if (T_frame_goal->translation().norm() > kMaxOrigin_m) {
    *why_not = formatted("the %s (%.3g, %.3g, %.3g) is farther than %.0f m from the origin of '%s'", what, p.x, p.y,
                         p.z, kMaxOrigin_m, pose.header.frame_id.c_str());
    return std::nullopt;
  }
  const std::optional<Eigen::Isometry3d> T_map_frame = transformToMap(pose.header.frame_id, pose.header.stamp, why_not);
  if (!T_map_frame) return std::nullopt;
  const Eigen::Isometry3d T_map_goal = *T_map_frame * *T_frame_goal;
  if (tilt(T_map_goal) > params_.pose.max_tilt_rad) {
    *why_not = formatted("the %s is tilted by %.3f rad against %s, must be at most %.3f rad", what, tilt(T_map_goal),
                         params_.map_frame.c_str(), params_.pose.max_tilt_rad);
    return std::nullopt;
  }
  return toPlane(T_map_goal);
}

bool BaseNavigationRos::onMakePlan(nav_msgs::GetPlan::Request& request, nav_msgs::GetPlan::Response& response) {
  std::shared_ptr<const NavigationGrid> grid;
  std::optional<Pose2d> start;
  {
    const std::lock_guard<std::mutex> lock(shared_mutex_);
    grid = grid_;
    start = T_map_base_;
  }
  std::string why_not;
  std::optional<Pose2d> goal;
  if (!grid) {
    why_not = "no ground is known yet: odometry, localisation, scan or map are missing";
  } else {
    goal = poseInMap(request.goal, "goal", &why_not);
    if (goal && !request.start.header.frame_id.empty()) {  // as with move_base: empty is where the robot stands
      start = poseInMap(request.start, "start", &why_not);
    } else if (goal && !start) {
      why_not = "the robot's pose is not known: odometry or localisation are missing";
    }
  }
  if (!goal || !start) {
    ROS_WARN_NAMED(kLog, "make_plan: %s", why_not.c_str());
    return false;
  }
  const base_navigation::BasePlanner planner(params_.planner, live_->get().limitsOf(profile_),
                                             profile_.body.footprint_m);
  const BasePlan plan = planner.plan(grid, *start, *goal, [this] {
    const std::lock_guard<std::mutex> lock(goal_mutex_);
    return is_stopping_;
  });
  std_msgs::Header header;
  header.stamp = ros::Time::now();
  header.frame_id = params_.map_frame;
  response.plan.header = header;
  if (plan.status == BasePlanStatus::kSolved) {
    response.plan = toMessage(plan.path, kPathStep_m, header);
    if (response.plan.poses.empty()) {  // there already; no poses would say that there is no way
      geometry_msgs::PoseStamped pose;
      pose.header = header;
      pose.pose = toPose(plan.path.start);
      response.plan.poses.push_back(pose);
    }
  } else {
    ROS_WARN_NAMED(kLog, "make_plan: %s: %s", toString(plan.status), plan.message.c_str());
  }
  return true;  // an empty plan says that there is none
}

bool BaseNavigationRos::onForget(std_srvs::Trigger::Request& /*request*/, std_srvs::Trigger::Response& response) {
  const std::lock_guard<std::mutex> lock(goal_mutex_);
  is_forget_asked_ = true;  // by the control thread, with its next step
  response.success = 1;
  response.message = "with the next odometry, what the scanner has seen and where the robot has been is forgotten";
  return true;
}

// ------------------------------------------------------------------------------------------------------- diagnostics

void BaseNavigationRos::diagnoseInputs(diagnostic_updater::DiagnosticStatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const ros::Time now = ros::Time::now();
  const std::lock_guard<std::mutex> lock(shared_mutex_);
  struct Input {
    const char* name;
    const ros::Time& seen;
    const std::string& problem;
    double max_age_s;
    bool is_needed;
  };
  const std::string none;
  const Input inputs[] = {
      {"odometry", odometry_seen_, odometry_problem_, params_.navigator.max_odometry_age_s, true},
      {"localisation", localisation_seen_, localisation_problem_, params_.navigator.max_pose_age_s, true},
      {"scan", scan_seen_, scan_problem_, params_.navigator.max_scan_age_s, true},
      {"ground", ground_seen_, ground_problem_,
       isGroundStatic() ? std::numeric_limits<double>::infinity() : params_.navigator.max_grid_age_s,
       params_.ground.required},
      {"heartbeat", heartbeat_seen_, none, params_.navigator.max_heartbeat_age_s,
       params_.navigator.max_heartbeat_age_s > 0.0}};
  status.summary(DiagnosticStatus::OK, "all inputs come");
  const double silence_s = (ros::WallTime::now() - stepped_).toSec();
  if (silence_s > kMaxSilence_s) {
    status.summary(DiagnosticStatus::ERROR,
                   formatted("no odometry for %.0f s, and ROS time does not advance", silence_s));
  }
  for (const Input& input : inputs) {
    if (!input.is_needed && input.problem.empty()) continue;
    if (!input.problem.empty()) {
      status.mergeSummary(DiagnosticStatus::ERROR, std::string(input.name) + ": " + input.problem);
    } else if (input.seen.isZero()) {
      status.mergeSummary(DiagnosticStatus::WARN, std::string("no ") + input.name + " has come");
    } else if ((now - input.seen).toSec() > input.max_age_s) {
      status.mergeSummary(DiagnosticStatus::WARN, formatted("%s is %.2f s old, allowed are %.2f s", input.name,
                                                            (now - input.seen).toSec(), input.max_age_s));
    }
    if (!input.seen.isZero()) status.add(std::string(input.name) + " age, s", (now - input.seen).toSec());
  }
  if (!stop_.empty()) status.mergeSummary(DiagnosticStatus::WARN, "the base is stopped: " + stop_);
}

void BaseNavigationRos::diagnoseGoals(diagnostic_updater::DiagnosticStatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const std::lock_guard<std::mutex> lock(shared_mutex_);
  const bool stands = phase_ == NavigationPhase::kBlocked || phase_ == NavigationPhase::kWaitingForData;
  status.summary(stands ? DiagnosticStatus::WARN : DiagnosticStatus::OK,
                 toString(phase_) + (reason_.empty() ? std::string() : ": " + reason_));
  for (const auto& [name, count] : outcomes_) status.add(name, count);
  if (!last_failure_.empty()) status.add("last failure", last_failure_);
}

}  // namespace base_navigation_ros
