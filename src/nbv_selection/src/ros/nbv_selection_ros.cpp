// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection_ros/nbv_selection_ros.h"

#include <cmath>
#include <limits>
#include <stdexcept>

#include <base_navigation_ros/conversions.h>
#include <depth_camera_ros/conversions.h>
#include <interactive_mapping_common/formatted.h>
#include <interactive_mapping_common/geometry/polygon.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_enums/selection_outcome.h>
#include <motion_planning/arm_kinematics.h>
#include <motion_planning_ros/robot_description.h>
#include <mp700_ur5e_description/base_profile.h>
#include <mp700_ur5e_description/robot_names.h>
#include <ros/console.h>

#include "nbv_selection_ros/conversions.h"

namespace nbv_selection_ros {
namespace {

using interactive_mapping::formatted;
using interactive_mapping_msgs::ReportFailure;
using interactive_mapping_msgs::SelectionOutcome;
using nbv_selection::SelectionStatus;

constexpr char kLog[] = "nbv_selection";
constexpr double kDiagnosticsPeriod_s = 1.0;  // wall time
/// A newer map is one whose stamp is later by more than what a double keeps of ROS time.
const ros::Duration kStampStep(1e-3);
/// tf of this moment comes a little later than what is reported of it.
const ros::Duration kTfWait(0.2);
const ros::Duration kClockSkew(0.1);  // between the clocks of two nodes

/// What `load` gives; its complaint names the parameter that the file is from.
template <typename Load>
auto loadedFrom(const char* key, const std::string& file, Load&& load) -> decltype(load(file)) {
  try {
    return load(file);
  } catch (const std::exception& error) {
    throw std::invalid_argument(std::string(key) + " = '" + file + "':\n" + error.what());
  }
}

nbv_selection::RobotBody bodyFrom(const ros::NodeHandle& nh, const NbvSelectionParams& params) {
  nbv_selection::RobotBody body;
  body.footprint = loadedFrom("base_profile_file", params.base_profile_file, mp700_ur5e_description::loadBaseProfile)
                       .body.footprint_m;
  if (params.sectors_file.empty()) return body;  // no arm is known, none is needed
  const auto kinematics = motion_planning_ros::kinematicsFromServer(nh);
  body.sectors = loadedFrom("sectors_file", params.sectors_file, [&](const std::string& file) {
    return motion_planning::ManipulabilitySectors::load(file, kinematics->robot());
  });
  const auto at_rest = kinematics->robotPositions(motion_planning::ArmVector::Zero());
  body.T_base_armbase = kinematics->robot().framePose(mp700_ur5e_description::kArmBaseFrame, at_rest);
  body.T_base_camera = kinematics->robot().framePose(mp700_ur5e_description::kColorFrame, at_rest);
  return body;
}

geometry_msgs::Pose poseOfNan() {
  geometry_msgs::Pose pose;
  pose.position.x = pose.position.y = pose.position.z = std::numeric_limits<double>::quiet_NaN();
  pose.orientation.x = pose.orientation.y = pose.orientation.z = pose.orientation.w = pose.position.x;
  return pose;
}

}  // namespace

NbvSelectionRos::NbvSelectionRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : params_(loadNbvSelectionParams(private_nh)),
      robot_(bodyFrom(nh, params_)),
      loader_("nbv_selection", "nbv_selection_ros::Strategy"),
      markers_(private_nh),
      ground_(params_.map_frame, params_.input.occupied_from),
      failures_(params_.failures.cell_m) {
  ROS_INFO_STREAM_NAMED(kLog, "configuration:\n" << interactive_mapping::toYaml(params_));
  for (const std::string& name : params_.strategies) {
    const ros::NodeHandle handle(private_nh, name);
    std::string plugin;
    if (!handle.getParam("plugin", plugin)) {
      throw std::invalid_argument("strategies holds '" + name + "', but " + handle.resolveName("plugin") +
                                  " is not set: its class, such as nbv_selection/Gpis");
    }
    Loaded loaded;
    loaded.name = name;
    try {
      loaded.strategy = loader_.createUniqueInstance(plugin);
    } catch (const pluginlib::PluginlibException& error) {
      std::string known;
      for (const std::string& declared : loader_.getDeclaredClasses()) known += (known.empty() ? "" : ", ") + declared;
      throw std::invalid_argument(handle.resolveName("plugin") + " = '" + plugin + "', must be one of " + known + ": " +
                                  error.what());
    }
    StrategyContext context;
    context.name = name;
    context.nh = nh;
    context.private_nh = handle;
    context.map_frame = params_.map_frame;
    context.robot = robot_;
    context.map_wait_s = params_.input.map_wait_s;
    context.stall_s = params_.cost.stall_s;
    context.answer_timeout_s = params_.input.answer_timeout_s;
    loaded.strategy->initialize(context);
    ROS_INFO_STREAM_NAMED(kLog, "strategy " << name << ":\n" << loaded.strategy->configuration());
    strategies_.push_back(std::move(loaded));
  }
  // After the plugins: dlopen() and a first warning of tf2 would wait for each other's locks.
  tf_listener_.emplace(tf_, true, ros::TransportHints().tcpNoDelay());

  ros::NodeHandle handle(nh);
  ros::NodeHandle private_handle(private_nh);
  selection_publisher_ = private_handle.advertise<interactive_mapping_msgs::NbvSelection>("selection", 1, true);
  failure_publisher_ = private_handle.advertise<visualization_msgs::MarkerArray>("markers/failures", 1, true);
  grid_subscriber_ = handle.subscribe("grid", 1, &NbvSelectionRos::onGrid, this);
  grid_update_subscriber_ =
      handle.subscribe(grid_subscriber_.getTopic() + "_updates", 20, &NbvSelectionRos::onGridUpdate, this);
  failure_server_ = private_handle.advertiseService("report_failure", &NbvSelectionRos::onFailure, this);
  forget_server_ = private_handle.advertiseService("forget_failures", &NbvSelectionRos::onForget, this);
  diagnostics_.setHardwareID("none");
  diagnostics_.add("inputs", this, &NbvSelectionRos::diagnoseInputs);
  diagnostics_.add("selections", this, &NbvSelectionRos::diagnoseSelections);
  diagnostics_timer_ = handle.createWallTimer(ros::WallDuration(kDiagnosticsPeriod_s),
                                              [this](const ros::WallTimerEvent&) { diagnostics_.force_update(); });
  server_ = std::make_unique<Server>(private_handle, "select",
                                     [this](const auto& goal, const auto& started, const auto& is_cancelled,
                                            const auto& tell) { return select(goal, started, is_cancelled, tell); });
}

NbvSelectionRos::~NbvSelectionRos() {
  server_.reset();
}

NbvSelectionRos::Loaded& NbvSelectionRos::strategyOf(const std::string& name) {
  if (name.empty()) return strategies_.front();
  std::string known;
  for (Loaded& loaded : strategies_) {
    if (loaded.name == name) return loaded;
    known += (known.empty() ? "" : ", ") + loaded.name;
  }
  throw Refused{SelectionOutcome::BAD_GOAL, "strategy = '" + name + "', must be one of " + known};
}

base_navigation::Pose2d NbvSelectionRos::whereTheRobotIs() {
  try {
    const geometry_msgs::TransformStamped transform =
        tf_.lookupTransform(params_.map_frame, params_.base_frame, ros::Time(0));
    const ros::Duration age = ros::Time::now() - transform.header.stamp;
    if (-age.toSec() > params_.input.max_pose_age_s) {
      tf_.clear();  // as long as this one is there, tf2 takes all that is newer for too old
      throw Refused{SelectionOutcome::NO_POSE,
                    "tf's pose of " + params_.base_frame + " is " +
                        formatted("%.2f s ahead of ROS time: of before the clock ran back", -age.toSec())};
    }
    // Static transforms have stamp 0: always true.
    if (!transform.header.stamp.isZero() && age.toSec() > params_.input.max_pose_age_s) {
      throw Refused{SelectionOutcome::NO_POSE,
                    "where " + params_.base_frame + " is in " + params_.map_frame + " is known for " +
                        formatted("%.2f s ago, ", age.toSec()) +
                        formatted("must be within %.2f s (input/max_pose_age_s)", params_.input.max_pose_age_s)};
    }
    depth_camera_ros::Refusal refusal;
    const auto T = depth_camera_ros::toIsometry(transform.transform, &refusal);
    if (!T) throw Refused{SelectionOutcome::NO_POSE, "tf: " + refusal.message};
    return base_navigation_ros::toPlane(*T);
  } catch (const tf2::TransformException& error) {
    throw Refused{SelectionOutcome::NO_POSE, std::string("tf: ") + error.what()};
  }
}

nbv_selection::SelectionRequest NbvSelectionRos::makeRequest(const Server::Goal& goal) {
  nbv_selection::SelectionRequest request;
  request.now_s = ros::Time::now().toSec();
  if (request.now_s < last_request_s_) {  // those of before would not fade for as long as that took
    ROS_WARN_NAMED(kLog, "time ran back by %.1f s: %s", last_request_s_ - request.now_s, forgetFailures().c_str());
  }
  last_request_s_ = request.now_s;
  request.T_map_base = whereTheRobotIs();

  Eigen::Isometry3d T_map_zones = Eigen::Isometry3d::Identity();
  const std::string frame = interactive_mapping_ros::withoutSlash(goal.frame_id);
  if (!frame.empty() && frame != params_.map_frame) {
    try {
      const auto T =
          interactive_mapping_ros::toIsometry(tf_.lookupTransform(params_.map_frame, frame, ros::Time(0)).transform);
      if (!T) throw Refused{SelectionOutcome::BAD_GOAL, "frame_id '" + frame + "': no rigid transform"};
      T_map_zones = *T;
    } catch (const tf2::TransformException& error) {
      throw Refused{SelectionOutcome::BAD_GOAL, "frame_id '" + frame + "': " + error.what()};
    }
  }
  for (const geometry_msgs::Point& corner : goal.workspace) {
    request.workspace_map.push_back((T_map_zones * Eigen::Vector3d(corner.x, corner.y, corner.z)).head<2>());
  }
  if (!request.workspace_map.empty()) {
    std::string problem = interactive_mapping::problemOfPolygon(request.workspace_map);
    if (!robot_.T_base_camera) problem = "needs the camera's pose: give sectors_file";
    if (!problem.empty()) throw Refused{SelectionOutcome::BAD_GOAL, "workspace " + problem};
  }
  for (const interactive_mapping_msgs::ExcludedZone& message : goal.excluded) {
    nbv_selection::ExcludedZone zone;
    zone.center_map = (T_map_zones * Eigen::Vector3d(message.center.x, message.center.y, message.center.z)).head<2>();
    zone.radius_m = message.radius;
    if (!zone.center_map.allFinite() || !std::isfinite(zone.radius_m) || zone.radius_m < 0.0) {
      throw Refused{SelectionOutcome::BAD_GOAL, "an excluded zone has centre (" + formatted("%g, ", message.center.x) +
                                                    formatted("%g) ", message.center.y) +
                                                    formatted("and radius %g m", message.radius) +
                                                    ", must be finite, the radius at least 0"};
    }
    request.excluded.push_back(zone);
  }

  request.may_stay = goal.may_stay != 0;

  const std::lock_guard<std::mutex> lock(mutex_);
  if (!grid_ && !grid_problem_.empty()) throw Refused{SelectionOutcome::BAD_INPUT, grid_problem_};
  if (!grid_) throw Refused{SelectionOutcome::STALE_GROUND, "no grid has come on " + grid_subscriber_.getTopic()};
  const double age_s = (ros::Time::now() - grid_stamp_).toSec();
  if (isTooOld(age_s)) {
    throw Refused{SelectionOutcome::STALE_GROUND,
                  "the grid on " + grid_subscriber_.getTopic() + " is " + formatted("%.2f s old, ", age_s) +
                      formatted("must be within %.2f s (input/max_grid_age_s)", params_.input.max_grid_age_s)};
  }
  request.ground = grid_;
  request.seed = static_cast<std::uint64_t>(params_.seed) + num_selections_;
  return request;
}

NbvSelectionRos::Server::Result NbvSelectionRos::select(const Server::Goal& goal, const ros::Time& started,
                                                        const IsCancelled& is_cancelled,
                                                        const std::function<void(const Server::Feedback&)>& tell) {
  const ros::WallTime wall_start = ros::WallTime::now();
  Server::Result result;
  result.standing.header.frame_id = params_.map_frame;
  result.standing.header.stamp = ros::Time::now();
  result.standing.pose = poseOfNan();
  result.selection.header = result.standing.header;
  result.selection.strategy = goal.strategy;
  result.selection.best = -1;
  nbv_selection::Selection selection;
  try {
    Loaded& loaded = strategyOf(goal.strategy);
    result.selection.strategy = loaded.name;
    const auto tell_stage = [&tell](const std::string& stage, std::size_t segments) {
      Server::Feedback feedback;
      feedback.stage = stage;
      feedback.segments = static_cast<std::uint32_t>(segments);
      tell(feedback);
    };
    ros::Time min_map_stamp = goal.min_map_stamp;
    for (int attempt = 1; attempt <= params_.max_attempts; ++attempt) {
      const nbv_selection::SelectionRequest request = makeRequest(goal);
      std::unique_ptr<nbv_selection::FailureMemory> failures;
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        failures = std::make_unique<nbv_selection::FailureMemory>(failures_);
      }
      selection = loaded.strategy->select(request, *failures, min_map_stamp, tell_stage, is_cancelled);
      if (selection.status != SelectionStatus::kMapChanged) break;
      min_map_stamp = ros::Time(selection.map_stamp_s) + kStampStep;
    }
    result.selection = toMessage(selection, loaded.name, result.standing.header);
    if (selection.best) {
      result.standing.pose = result.selection.segments[*selection.best].standing;
    }
  } catch (const Refused& refused) {
    result.selection.outcome.status = refused.status;
    result.selection.outcome.message = refused.message;
  } catch (const SelectionCancelled& error) {
    result.selection.outcome.status = SelectionOutcome::CANCELLED;
    result.selection.outcome.message = error.what();
  } catch (const MapUnusable& error) {
    result.selection.outcome.status = SelectionOutcome::BAD_INPUT;
    result.selection.outcome.message = error.what();
  } catch (const std::invalid_argument& error) {  // a parameter that does not go with the map
    result.selection.outcome.status = SelectionOutcome::BAD_INPUT;
    result.selection.outcome.message = error.what();
  } catch (const std::exception& error) {  // MapUnavailable; the map stopped answering; out of memory; a plugin's own
    result.selection.outcome.status = SelectionOutcome::STALE_MAP;
    result.selection.outcome.message = error.what();
  }
  result.outcome = result.selection.outcome;
  result.wall_ms = static_cast<float>(1000.0 * (ros::WallTime::now() - wall_start).toSec());
  note(result.selection.strategy, result.outcome, result.wall_ms);
  selection_publisher_.publish(result.selection);
  markers_.show(selection, robot_, result.selection.header);
  result.cost = ros::Time::isSystemTime() ? 0.0 : params_.cost.select_s;
  if (!interactive_mapping_ros::charge(params_.cost.select_s, started, params_.cost.stall_s, is_cancelled)) {
    ROS_WARN_NAMED(kLog,
                   "the clock has stood still for %.1f s: a selection is not held back for its cost of %.2f s. Is the "
                   "clock's rule for selecting shorter than cost/select_s?",
                   params_.cost.stall_s, params_.cost.select_s);
  }
  return result;
}

void NbvSelectionRos::note(const std::string& strategy, const SelectionOutcome& outcome, double wall_ms) {
  const std::string name = toString(static_cast<interactive_mapping::SelectionStatus>(outcome.status));
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++num_selections_;
    ++outcomes_[name];
    last_outcome_ = strategy + ": " + name + (outcome.message.empty() ? "" : ": " + outcome.message);
    last_ms_ = wall_ms;
  }
  if (outcome.status == SelectionOutcome::SUCCESS || outcome.status == SelectionOutcome::CANCELLED) {
    ROS_INFO_NAMED(kLog, "selection by %s: %s (%.0f ms) %s", strategy.c_str(), name.c_str(), wall_ms,
                   outcome.message.c_str());
  } else {
    ROS_WARN_NAMED(kLog, "selection by %s: %s (%.0f ms): %s", strategy.c_str(), name.c_str(), wall_ms,
                   outcome.message.c_str());
  }
}

void NbvSelectionRos::onGrid(const nav_msgs::OccupancyGridConstPtr& message) {
  std::string problem;
  const auto grid = ground_.take(*message, &problem);
  enterGrid(grid, message->header.stamp, problem);
}

void NbvSelectionRos::onGridUpdate(const map_msgs::OccupancyGridUpdateConstPtr& message) {
  std::string problem;
  const auto grid = ground_.take(*message, &problem);
  enterGrid(grid, message->header.stamp, problem);
}

void NbvSelectionRos::enterGrid(const base_navigation_ros::GroundInput::Grid& grid, const ros::Time& stamp,
                                std::string problem) {
  if (!problem.empty()) {
    problem = "the grid on " + grid_subscriber_.getTopic() + ": " + problem;
    ROS_WARN_THROTTLE_NAMED(10.0, kLog, "%s", problem.c_str());
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  grid_problem_ = problem;
  if (!grid) return;  // the last good one ages
  grid_ = grid;
  grid_stamp_ = stamp;
}

bool NbvSelectionRos::isTooOld(double grid_age_s) const {
  const double most_s = params_.input.max_grid_age_s;
  return most_s > 0.0 && std::abs(grid_age_s) > most_s;  // 0: a static grid
}

bool NbvSelectionRos::onFailure(ReportFailure::Request& request, ReportFailure::Response& response) {
  const ros::Time now = ros::Time::now();
  ros::Time stamp = request.pose.header.stamp;
  if (stamp.isZero() || (stamp > now && stamp - now < kClockSkew)) stamp = now;
  const std::string frame = interactive_mapping_ros::withoutSlash(request.pose.header.frame_id);
  Eigen::Vector3d p(request.pose.pose.position.x, request.pose.pose.position.y, request.pose.pose.position.z);
  try {
    if (!frame.empty() && frame != params_.map_frame) {
      const auto T = interactive_mapping_ros::toIsometry(
          tf_.lookupTransform(params_.map_frame, frame, request.pose.header.stamp, kTfWait).transform);
      if (!T) throw std::invalid_argument("frame '" + frame + "': no rigid transform");
      p = *T * p;
    }
    if (stamp > now) {
      throw std::invalid_argument("stamp " + formatted("%.3f s", stamp.toSec()) + " lies ahead of ROS time, " +
                                  formatted("%.3f s", now.toSec()));
    }
    const double radius_m = request.radius == 0.0 ? params_.failures.radius_m : request.radius;
    visualization_msgs::MarkerArray markers;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      failures_.add(p.head<2>(), radius_m, stamp.toSec());
      ++num_failures_;
      std_msgs::Header header;
      header.frame_id = params_.map_frame;
      header.stamp = now;
      markers = toMarkers(failures_, header);
    }
    failure_publisher_.publish(markers);
    ROS_INFO_NAMED(kLog, "failed at (%.2f, %.2f): %s", p.x(), p.y(), request.reason.c_str());
    response.success = 1;
  } catch (const tf2::TransformException& error) {
    response.message = "frame '" + frame + "': " + error.what();
  } catch (const std::exception& error) {
    response.message = error.what();
  }
  if (!response.success) {
    ROS_WARN_NAMED(kLog, "failure report rejected: %s", response.message.c_str());
  }
  return true;
}

bool NbvSelectionRos::onForget(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  response.message = forgetFailures();
  response.success = 1;
  return true;
}

std::string NbvSelectionRos::forgetFailures() {
  std_msgs::Header header;
  header.frame_id = params_.map_frame;
  header.stamp = ros::Time::now();
  visualization_msgs::MarkerArray markers;
  std::string told;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    told = std::to_string(num_failures_) + " failures forgotten";
    failures_.clear();
    num_failures_ = 0;
    markers = toMarkers(failures_, header);
  }
  failure_publisher_.publish(markers);
  return told;
}

void NbvSelectionRos::diagnoseInputs(diagnostic_updater::DiagnosticStatusWrapper& status) {
  status.summary(diagnostic_msgs::DiagnosticStatus::OK, "ready");
  for (const Loaded& loaded : strategies_) {
    diagnostic_updater::DiagnosticStatusWrapper of_strategy;
    loaded.strategy->diagnose(of_strategy);
    if (of_strategy.level != diagnostic_msgs::DiagnosticStatus::OK) {
      status.mergeSummary(of_strategy.level, loaded.name + ": " + of_strategy.message);
    }
    for (const diagnostic_msgs::KeyValue& value : of_strategy.values)
      status.add(loaded.name + ": " + value.key, value.value);
  }
  try {
    whereTheRobotIs();
  } catch (const Refused& refused) {
    status.mergeSummary(diagnostic_msgs::DiagnosticStatus::WARN, refused.message);
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!grid_problem_.empty()) {
    status.mergeSummary(diagnostic_msgs::DiagnosticStatus::ERROR, grid_problem_);
  } else if (!grid_) {
    status.mergeSummary(diagnostic_msgs::DiagnosticStatus::WARN, "no grid has come on " + grid_subscriber_.getTopic());
  } else {
    const double age_s = (ros::Time::now() - grid_stamp_).toSec();
    status.add("grid: age [s]", age_s);
    if (isTooOld(age_s)) {
      status.mergeSummary(diagnostic_msgs::DiagnosticStatus::WARN, "the grid is too old");
    }
  }
}

void NbvSelectionRos::diagnoseSelections(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const std::lock_guard<std::mutex> lock(mutex_);
  status.summary(diagnostic_msgs::DiagnosticStatus::OK, last_outcome_.empty() ? "none yet" : last_outcome_);
  status.add("selections", num_selections_);
  status.add("last: wall time [ms]", last_ms_);
  for (const auto& [name, count] : outcomes_) status.add("outcome: " + name, count);
  status.add("failures reported", num_failures_);
}

}  // namespace nbv_selection_ros
