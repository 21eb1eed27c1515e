// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission_ros/pick_mission_ros.h"

#include <cmath>
#include <stdexcept>
#include <utility>

#include <std_msgs/Header.h>
#include <visualization_msgs/MarkerArray.h>

#include "pick_mission_ros/mission_markers.h"

namespace pick_mission_ros {

using interactive_mapping_msgs::MissionFailure;
using interactive_mapping_msgs::MissionState;
using pick_mission::MissionMachine;
using pick_mission::State;
namespace event = pick_mission::event;

namespace {

constexpr std::size_t kShownFailures = 10;
constexpr double kIdle_s = 0.005;       // that spinOnce() waits for something to come
constexpr double kWatchPeriod_s = 0.1;  // wall time
constexpr double kPublishPeriod_s = 1.0;
constexpr double kAskPeriod_s = 0.5;  // whether all is there to start; each time asks the master
constexpr double kTickPeriod_s = 1.0;
/// Wall time that the heart waits for old goals to be cancelled. Without it base and arm stand; more than the navigation's
/// patience with that (2 s), so that what has not been cancelled by then has been given up.
constexpr double kOldGoals_s = 3.0;
constexpr double kClockJump_s = 3.0;  // that a clock is set by; less is no matter for any limit of time
constexpr double kCallsEnd_s = 2.0;   // for what ROS's end breaks off; takes milliseconds

mp700_ur5e_description::BrickCatalogue catalogueFrom(const std::string& file) {
  try {
    return mp700_ur5e_description::loadBrickTypes(file);
  } catch (const std::exception& error) {
    throw std::invalid_argument("bricks_file: " + std::string(error.what()));
  }
}

nlohmann::json summaryOf(const MissionMachine& machine, double wall_s) {
  nlohmann::json json = toJson(machine.summary(wall_s));
  // The truth is the simulator's judge's to tell, not the mission's.
  for (const char* judged : {"map_coverage", "map_precision", "falls", "collisions"}) json[judged] = nullptr;
  return json;
}

}  // namespace

PickMissionRos::PickMissionRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : params_(loadPickMissionParams(private_nh)),
      catalogue_(catalogueFrom(params_.bricks_file)),
      inbox_(std::make_shared<Inbox>()) {
  ROS_INFO_STREAM_NAMED(kLog, "configuration:\n" << interactive_mapping::toYaml(params_));
  makeMachine();
  actions_ = std::make_unique<MissionActions>(
      nh, params_, &queue_, inbox_, [this](const pick_mission::Event& event) { step(event); },
      [this](const interactive_mapping_msgs::NbvSelection& selection) { onSelection(selection); });

  if (!params_.nodes.unload.empty()) {
    unload_ = std::make_unique<ServiceCaller<std_srvs::Trigger>>(nh, params_.nodes.unload, inbox_);
  }
  container_emptied_ =
      std::make_unique<ServiceCaller<std_srvs::Trigger>>(nh, params_.nodes.planner + "/container_emptied", inbox_);
  ros::NodeHandle handle(private_nh);
  handle.setCallbackQueue(&queue_);
  state_publisher_ = handle.advertise<MissionState>("state", 10, true);
  marker_publisher_ = handle.advertise<visualization_msgs::MarkerArray>("markers", 1, true);
  const std::pair<const char*, Service> services[] = {
      {"start", &PickMissionRos::onStart},   {"pause", &PickMissionRos::onPause},
      {"resume", &PickMissionRos::onResume}, {"hold", &PickMissionRos::onHold},
      {"stop", &PickMissionRos::onStop},     {"unloaded", &PickMissionRos::onUnloaded}};
  for (const auto& [name, service] : services) servers_.push_back(handle.advertiseService(name, service, this));
  diagnostics_.setHardwareID("none");
  diagnostics_.add("mission", this, &PickMissionRos::diagnose);
  // By the wall clock: a clock that stands still is something to report.
  diagnostics_timer_ = handle.createWallTimer(ros::WallDuration(1.0),
                                              [this](const ros::WallTimerEvent&) { diagnostics_.force_update(); });

  ros::NodeHandle heart(private_nh);
  heart.setCallbackQueue(&heart_queue_);
  heartbeat_publisher_ = heart.advertise<std_msgs::Header>("heartbeat", 10);
  heart_timer_ = std::make_unique<interactive_mapping_ros::ClockTimer>(
      heart, ros::Duration(1.0 / params_.heartbeat.rate_hz), [this] { beat(); });
  heart_ = std::make_unique<ros::AsyncSpinner>(1, &heart_queue_);
  heart_->start();
  publishState();
}

PickMissionRos::~PickMissionRos() {
  heart_->stop();
  // Threads that call services must not outlive the process's statics. ROS's end breaks their calls off.
  if (!ros::ok()) inbox_->awaitAll(std::chrono::duration<double>(kCallsEnd_s));
}

/// Below that of the run; the first mission's is that itself.
std::string PickMissionRos::folderOf(int mission) const {
  return mission == 1 ? params_.run_folder : params_.run_folder + "/mission_" + std::to_string(mission);
}

void PickMissionRos::makeMachine() {
  // The last one that was begun: an earlier one has ended.
  while (!params_.run_folder.empty() && RunRecorder::exists(folderOf(num_missions_ + 1))) ++num_missions_;
  recorder_ = std::make_unique<RunRecorder>(params_.run_folder.empty() ? "" : folderOf(num_missions_));
  const std::optional<nlohmann::json> saved = recorder_->savedState();
  if (!saved) {
    machine_ = std::make_unique<MissionMachine>(params_.mission, params_.info);
    return;
  }
  const std::string path = recorder_->folder() + "/mission_state.json";
  try {
    machine_ =
        std::make_unique<MissionMachine>(MissionMachine::fromJson(params_.mission, params_.info, saved->at("mission")));
    wall_before_s_ = saved->at("wall_s").get<double>();
  } catch (const std::exception& error) {
    throw std::invalid_argument(path + " is no mission's state: " + error.what() +
                                "; move it away, or set another run_folder, to start a new mission");
  }
  num_failures_ = machine_->counts().failures;
  if (machine_->state() == State::kEnded) {
    decision_ = "this mission has ended";
    ended_wall_s_ = wall_before_s_;
    ROS_WARN_STREAM_NAMED(kLog, "the mission of " << path << " has ended; start runs a new one in a new folder");
  } else {
    const bool waits_for_start = machine_->state() == State::kIdle;
    if (!waits_for_start) started_ = ros::SteadyTime::now();
    const std::string goes_on = waits_for_start ? "when it is started" : "at resume";
    decision_ = "interrupted; resumes " + goes_on;
    ROS_WARN_STREAM_NAMED(kLog, "the mission of " << path << " was interrupted after " << machine_->usedTime()
                                                  << " s with " << machine_->counts().bricks_picked
                                                  << " bricks picked: it resumes with a fresh inspection " << goes_on);
  }
}

/// After a mission that has ended. Its files stay as they are. Throws std::invalid_argument if there is no place for more.
void PickMissionRos::makeAnother() {
  if (!params_.run_folder.empty()) recorder_ = std::make_unique<RunRecorder>(folderOf(num_missions_ + 1));
  ++num_missions_;
  machine_ = std::make_unique<MissionMachine>(params_.mission, params_.info);
  decision_.clear();
  failures_.clear();
  num_failures_ = 0;
  wall_before_s_ = 0.0;
  ended_wall_s_.reset();
  started_.reset();
  brick_.reset();
  selected_.reset();
  view_.reset();
}

// --- The loop ---------------------------------------------------------------------------------------------------------

void PickMissionRos::spinOnce() {
  alive_s_ = ros::SteadyTime::now().toSec();
  followClock();
  queue_.callAvailable(ros::WallDuration(kIdle_s));
  inbox_->empty();
  tick();
  is_hold_lost_ = actions_->isHoldLost();
}

void PickMissionRos::tick() {
  const ros::SteadyTime wall = ros::SteadyTime::now();
  if ((wall - watched_).toSec() >= kWatchPeriod_s) {
    watched_ = wall;
    actions_->watch();
    if (started_ && !ended_wall_s_) {
      if (const auto base = actions_->place()) recorder_->base(ros::Time::now().toSec(), *base);
    }
  }
  letHeartBeat();
  const ros::Time now = ros::Time::now();
  if (now < ticked_ || (now - ticked_).toSec() >= kTickPeriod_s) {
    ticked_ = now;
    if (started_) step(event::Tick{});
    unload();
    container_emptied_->watch();
  }
  if (params_.autostart && !is_stopping_ && (wall - asked_).toSec() >= kAskPeriod_s) {
    asked_ = wall;
    autostart();
  }
  if ((wall - published_).toSec() >= kPublishPeriod_s) publishState();
}

/// Asks for it until it is done.
void PickMissionRos::unload() {
  if (!unload_) return;
  unload_->watch();
  if (machine_->state() != State::kUnload || unload_->isActive()) return;
  unload_->call({}, ros::WallDuration(params_.servers.service_timeout_s),
                [this](const std_srvs::Trigger* service, const std::string& why) {
                  if (service != nullptr && service->response.success != 0) {
                    step(event::Unloaded{});
                    return tellPlannerOfEmptyContainer();
                  }
                  ROS_INFO_STREAM_THROTTLE_NAMED(
                      10.0, kLog,
                      "the container is not unloaded yet: " << (service == nullptr ? why : service->response.message));
                });
}

/// A planner that does not learn of it avoids bricks that are gone.
void PickMissionRos::tellPlannerOfEmptyContainer() {
  if (machine_->placesUsed() != 0) return;
  container_emptied_->call({}, ros::WallDuration(params_.servers.service_timeout_s),
                           [](const std_srvs::Trigger* service, const std::string& why) {
                             if (service != nullptr) return;
                             ROS_WARN_STREAM_NAMED(kLog, "the planner still takes the container for full: " << why);
                           });
}

void PickMissionRos::autostart() {
  if (machine_->state() != State::kIdle) return;
  const std::string why_not = start();
  if (why_not == waits_for_) return;
  waits_for_ = why_not;
  if (!why_not.empty()) ROS_INFO_STREAM_NAMED(kLog, "waits for " << why_not);
}

/// Not before what an earlier process has asked for is cancelled: with a heartbeat the base would go on with its drive. But
/// in the end, for others wait for it: the clock of a simulation, and a server that is not there may never be.
void PickMissionRos::letHeartBeat() {
  if (may_heart_beat_) return;
  const bool is_cancelled = actions_->areOldGoalsCancelled();
  if (!is_cancelled && (ros::SteadyTime::now() - begun_).toSec() < kOldGoals_s) return;
  if (!is_cancelled) {
    ROS_WARN_STREAM_NAMED(kLog,
                          "navigation or bridge have not cancelled what an earlier process may have asked for within "
                              << kOldGoals_s << " s of wall time: it is cancelled when they answer");
  }
  may_heart_beat_ = true;
  if (!ros::Time::now().isZero()) beat();  // at once: the clock may wait for it
}

/// The heart beats as long as the mission's thread does not hang, and no hold has been lost.
void PickMissionRos::beat() {
  if (!may_heart_beat_ || is_hold_lost_ || ros::SteadyTime::now().toSec() - alive_s_ > params_.heartbeat.max_stall_s) {
    return;
  }
  std_msgs::Header header;
  header.stamp = ros::Time::now();
  header.frame_id = params_.map_frame;
  heartbeat_publisher_.publish(header);
}

/// Now. Before that, moves the timers on by the jump of a clock that was set forward (NTP): an hour that has not passed
/// ends no mission. A simulated clock may jump. A clock that was set back is noticed where times are compared.
double PickMissionRos::followClock() {
  const double now_s = ros::Time::now().toSec();
  const double jump_s = clock_steps_.advance(now_s, ros::SteadyTime::now().toSec());
  if (!ros::Time::isSystemTime() || jump_s < kClockJump_s) return now_s;
  ROS_WARN_STREAM_NAMED(kLog, "the clock was set forward by " << jump_s << " s");
  const ros::Duration jump(jump_s);
  actions_->shiftTimes(jump);
  if (!state_since_.isZero()) state_since_ += jump;
  const pick_mission::MissionOutput output = machine_->step(event::ClockJump{jump_s}, now_s);
  for (const pick_mission::LogEntry& entry : output.log) recorder_->log(entry);
  return now_s;
}

void PickMissionRos::step(const pick_mission::Event& event) {
  if (is_stopping_) return;  // what comes now, the next node's fresh inspection will show
  events_.push_back(event);
  if (!is_draining_) drain();
}

void PickMissionRos::drain() {
  is_draining_ = true;
  while (!events_.empty()) {
    const pick_mission::Event event = events_.front();
    events_.pop_front();
    const double now_s = followClock();
    const State before = machine_->state();
    pick_mission::MissionOutput output;
    try {
      output = machine_->step(event, now_s);
    } catch (const std::invalid_argument& error) {
      ROS_ERROR_STREAM_NAMED(kLog, "an invalid answer: " << error.what());
      if (const auto* reply = std::get_if<event::Reply>(&event)) {
        events_.push_back(event::Reply{reply->id, pick_mission::NoAnswer{}, error.what(), std::nullopt});
      }
      continue;
    }
    for (const pick_mission::LogEntry& entry : output.log) {
      recorder_->log(entry);
      if (!answer_) answer_ = entry.reason;
      if (entry.decision != entry.state || entry.event != "tick") {
        decision_ = std::string(toString(entry.decision)) + (entry.reason.empty() ? "" : ": " + entry.reason);
      }
      ROS_INFO_STREAM_NAMED(kLog, toString(entry.state) << " -> " << toString(entry.decision) << " (" << entry.event
                                                        << (entry.reason.empty() ? "" : ": ") << entry.reason << ")");
      if (entry.counts.failures > num_failures_) {
        num_failures_ = entry.counts.failures;
        MissionFailure failure;
        failure.stamp.fromSec(entry.time_s);
        failure.state = static_cast<std::uint8_t>(entry.state);
        failure.event = entry.event;
        failure.reason = entry.reason;
        failures_.push_front(failure);
        if (failures_.size() > kShownFailures) failures_.pop_back();
      }
    }
    if (machine_->state() != before) state_since_ = ros::Time::now();
    if (machine_->state() == State::kEnded && !ended_wall_s_) {
      ended_wall_s_ = wallSeconds();
      ROS_INFO_STREAM_NAMED(kLog, "the mission has ended: " << toString(machine_->endReason()) << ", "
                                                            << machine_->endMessage() << "; "
                                                            << machine_->counts().bricks_picked << " bricks picked");
    }
    for (const pick_mission::Command& command : output.commands) {
      if (const auto* plan = std::get_if<pick_mission::command::PlanPick>(&command.body)) brick_ = plan->brick.id;
      if (const auto* drive = std::get_if<pick_mission::command::Drive>(&command.body)) {
        const bool is_selected = selected_ && std::hypot(selected_->standing.position.x - drive->T_map_base.x_m,
                                                         selected_->standing.position.y - drive->T_map_base.y_m) < 1e-3;
        view_ = is_selected ? selected_ : std::nullopt;
      }
    }
    if (!output.log.empty() || !output.commands.empty()) {
      keep();
      publishState();
    }
    for (const pick_mission::Command& command : output.commands) actions_->carryOut(command);
  }
  is_draining_ = false;
}

/// Before what was decided is carried out: a crash in the middle of it must not forget that it was begun.
void PickMissionRos::keep() {
  recorder_->state({{"mission", machine_->toJson()}, {"wall_s", wallSeconds()}});
  recorder_->summary(summaryOf(*machine_, wallSeconds()));
  if (recorder_->problem() != told_problem_) {
    told_problem_ = recorder_->problem();
    if (!told_problem_.empty()) ROS_ERROR_STREAM_NAMED(kLog, told_problem_);
  }
}

double PickMissionRos::wallSeconds() const {
  if (ended_wall_s_) return *ended_wall_s_;
  return wall_before_s_ + (started_ ? (ros::SteadyTime::now() - *started_).toSec() : 0.0);
}

std::optional<int> PickMissionRos::currentBrick() const {
  switch (machine_->state()) {
    case State::kPlanPick:
    case State::kPick:
    case State::kPlanStow:
    case State::kStow:
    case State::kLetGo:
      return brick_;
    default:
      return std::nullopt;
  }
}

void PickMissionRos::publishState() {
  published_ = ros::SteadyTime::now();
  MissionState state = toMessage(*machine_, currentBrick());
  state.header.stamp = ros::Time::now();
  state.header.frame_id = params_.map_frame;
  state.since = state_since_;
  state.decision = machine_->state() == State::kIdle && !waits_for_.empty() ? "waits for " + waits_for_ : decision_;
  if (view_) state.view = {*view_};
  state.scene = params_.info.scene;
  state.strategy = params_.info.strategy;
  state.removed_factor = params_.info.removed_factor;
  state.run_folder = recorder_->folder();
  state.limit_s = params_.mission.time.limit_s;
  state.bricks_total = params_.mission.bricks_total;
  state.last_failures.assign(failures_.begin(), failures_.end());
  state_publisher_.publish(state);
  if (marker_publisher_.getNumSubscribers() > 0) marker_publisher_.publish(toMarkers(state, catalogue_));
}

void PickMissionRos::stop(ros::WallDuration timeout) {
  is_stopping_ = true;
  keep();
  actions_->cancel();
  const ros::SteadyTime deadline = ros::SteadyTime::now() + timeout;
  while (!actions_->isIdle() && ros::SteadyTime::now() < deadline) spinOnce();
  if (!actions_->isIdle()) {
    ROS_WARN_NAMED(kLog, "the running action did not end in time: without a heartbeat the arm stops");
  }
}

// --- Services ---------------------------------------------------------------------------------------------------------

/// What it waits for; empty: it has begun.
std::string PickMissionRos::start() {
  std::string why_not;
  for (const std::string& one : actions_->missing()) why_not += (why_not.empty() ? "" : ", ") + one;
  if (!why_not.empty()) return why_not;
  try {
    event::Start begin = actions_->start();
    begin.places_used = machine_->placesUsed();
    begin.start_pose = machine_->startPose();
    if (machine_->state() == State::kEnded) makeAnother();
    if (!started_) started_ = ros::SteadyTime::now();
    waits_for_.clear();
    step(begin);
    return "";
  } catch (const std::exception& error) {
    return error.what();
  }
}

bool PickMissionRos::onStart(std_srvs::Trigger::Request& /*request*/, std_srvs::Trigger::Response& response) {
  const State state = machine_->state();
  if (state != State::kIdle && state != State::kEnded) {
    response.success = 0;
    response.message = std::string("it has begun already: ") + toString(state);
    return true;
  }
  const std::string why_not = start();
  response.success = why_not.empty() ? 1 : 0;
  response.message = why_not.empty() ? decision_ : "missing: " + why_not;
  return true;
}

/// The first entry of the log is about the event itself; what it led to may follow.
void PickMissionRos::take(const pick_mission::Event& event, std_srvs::Trigger::Response* response) {
  answer_.reset();
  step(event);
  const std::string reason = answer_.value_or("");
  response->success = answer_ && reason.rfind("ignored", 0) != 0 ? 1 : 0;
  response->message = std::string(toString(machine_->state())) + (reason.empty() ? "" : ": " + reason);
}

bool PickMissionRos::onPause(std_srvs::Trigger::Request& /*request*/, std_srvs::Trigger::Response& response) {
  take(event::Pause{}, &response);
  return true;
}

bool PickMissionRos::onResume(std_srvs::Trigger::Request& /*request*/, std_srvs::Trigger::Response& response) {
  take(event::Resume{actions_->place()}, &response);
  return true;
}

bool PickMissionRos::onHold(std_srvs::Trigger::Request& /*request*/, std_srvs::Trigger::Response& response) {
  take(event::Hold{}, &response);
  return true;
}

bool PickMissionRos::onStop(std_srvs::Trigger::Request& /*request*/, std_srvs::Trigger::Response& response) {
  actions_->cancelDrives();  // also those of other clients, which the state machine does not know
  take(event::Stop{}, &response);
  return true;
}

bool PickMissionRos::onUnloaded(std_srvs::Trigger::Request& /*request*/, std_srvs::Trigger::Response& response) {
  take(event::Unloaded{}, &response);
  tellPlannerOfEmptyContainer();
  return true;
}

void PickMissionRos::onSelection(const interactive_mapping_msgs::NbvSelection& selection) {
  recorder_->selection(toJson(selection, ros::Time::now().toSec()));
  selected_.reset();
  if (selection.best >= 0 && static_cast<std::size_t>(selection.best) < selection.segments.size()) {
    selected_ = selection.segments[static_cast<std::size_t>(selection.best)];
  }
}

void PickMissionRos::diagnose(diagnostic_updater::DiagnosticStatusWrapper& status) {
  using Status = diagnostic_msgs::DiagnosticStatus;
  const pick_mission::MissionCounts counts = machine_->counts();
  status.summary(Status::OK, std::string(toString(machine_->state())) + (decision_.empty() ? "" : "; " + decision_));
  if (machine_->state() == State::kIdle && !waits_for_.empty()) status.summary(Status::WARN, "waits for " + waits_for_);
  if (machine_->state() == State::kEnded) {
    status.summary(Status::OK,
                   std::string("ended: ") + toString(machine_->endReason()) + ", " + machine_->endMessage());
  }
  if (actions_->isHoldLost()) status.summary(Status::ERROR, "no server has received a hold: the heartbeat is stopped");
  if (!recorder_->problem().empty()) status.summary(Status::ERROR, recorder_->problem());
  status.add("bricks picked", counts.bricks_picked);
  status.add("bricks open", counts.bricks_open);
  status.add("bricks exhausted", counts.bricks_exhausted);
  status.add("places used in the container", machine_->placesUsed());
  status.add("views", counts.views);
  status.add("failures", counts.failures);
  status.add("hand", toString(machine_->hand()));
  status.add("used [s]", machine_->usedTime());
  if (!failures_.empty()) status.add("last failure", failures_.front().event + ": " + failures_.front().reason);
}

}  // namespace pick_mission_ros
