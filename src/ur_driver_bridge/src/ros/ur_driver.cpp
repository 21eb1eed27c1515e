// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge_ros/ur_driver.h"

#include <motion_planning_ros/conversions.h>
#include <std_srvs/Trigger.h>
#include <ur_msgs/SetPayload.h>

#include "ur_driver_bridge_ros/driver_call.h"

namespace ur_driver_bridge_ros {
namespace {

using ur_driver_bridge::CallReply;
using ur_driver_bridge::TrajectoryEvent;

constexpr const char* kController = "scaled_pos_joint_traj_controller/follow_joint_trajectory";
constexpr double kPresencePeriod_s = 0.1;
// A goal and the stop that takes its place are all that can be on their way at a time.
constexpr std::size_t kMaxGoals = 8;

}  // namespace

CallThread::~CallThread() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    is_stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void CallThread::post(std::function<void()> call) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    calls_.push_back(std::move(call));
  }
  changed_.notify_all();
}

void CallThread::work() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return is_stopping_ || !calls_.empty(); });
    if (is_stopping_) return;
    const std::function<void()> call = std::move(calls_.front());
    calls_.pop_front();
    lock.unlock();
    call();
    lock.lock();
  }
}

UrDriver::UrDriver(const ros::NodeHandle& nh, Gripper& gripper, OnReply on_reply, OnEvent on_event)
    : nh_(nh), gripper_(gripper), on_reply_(std::move(on_reply)), on_event_(std::move(on_event)) {
  ros::NodeHandle own(nh_);
  own.setCallbackQueue(&queue_);
  client_ = std::make_unique<Client>(own, kController, &queue_);
  presence_timer_ = own.createWallTimer(ros::WallDuration(kPresencePeriod_s), [this](const ros::WallTimerEvent&) {
    const bool is_there = client_->isServerConnected();
    // What a bridge before this one sent goes on with nobody who watches it. By its time: the cancel must not overtake a
    // goal that is sent after it, on another connection.
    if (is_there && !is_old_cancelled_) client_->cancelGoalsAtAndBeforeTime(ros::Time::now());
    is_old_cancelled_ = is_old_cancelled_ || is_there;
    is_controller_there_ = is_there;
  });
  spinner_ = std::make_unique<ros::AsyncSpinner>(1, &queue_);
  spinner_->start();
}

UrDriver::~UrDriver() {
  presence_timer_.stop();
  spinner_->stop();
  const std::lock_guard<std::mutex> lock(goals_mutex_);
  goals_.clear();
}

void UrDriver::send(std::uint64_t id, const ur_driver_bridge::JointTrajectory& trajectory) {
  control_msgs::FollowJointTrajectoryGoal goal;
  goal.trajectory = motion_planning_ros::toMessage(trajectory);
  const std::lock_guard<std::mutex> lock(goals_mutex_);
  goals_.push_back(client_->sendGoal(goal, [this, id](Client::GoalHandle handle) { onTransition(id, handle); }));
  while (goals_.size() > kMaxGoals) goals_.pop_front();
}

void UrDriver::cancel() {
  client_->cancelAllGoals();
}

void UrDriver::onTransition(std::uint64_t id, Client::GoalHandle handle) {
  using actionlib::CommState;
  using actionlib::TerminalState;
  using Kind = TrajectoryEvent::Kind;
  const CommState state = handle.getCommState();
  if (state == CommState::ACTIVE) {
    on_event_({id, Kind::kAccepted, ""});
    return;
  }
  if (state != CommState::DONE) return;
  const TerminalState end = handle.getTerminalState();
  std::string message = end.getText();
  if (const auto result = handle.getResult()) {
    if (!result->error_string.empty()) message = result->error_string;
    if (result->error_code != control_msgs::FollowJointTrajectoryResult::SUCCESSFUL) {
      message += " (error " + std::to_string(result->error_code) + ")";
    }
  }
  switch (end.state_) {
    case TerminalState::SUCCEEDED:
      on_event_({id, Kind::kSucceeded, message});
      break;
    case TerminalState::REJECTED:
      on_event_({id, Kind::kRejected, message});
      break;
    case TerminalState::ABORTED:
      on_event_({id, Kind::kAborted, message});
      break;
    case TerminalState::RECALLED:
    case TerminalState::PREEMPTED:
      on_event_({id, Kind::kCancelled, message});
      break;
    case TerminalState::LOST:
      on_event_({id, Kind::kLost, message});
      break;
  }
}

void UrDriver::post(std::uint64_t id, std::function<CallReply()> call) {
  services_.post([this, id, call = std::move(call)] {
    CallReply reply = call();
    reply.id = id;
    on_reply_(reply);
  });
}

void UrDriver::trigger(std::uint64_t id, const std::string& service) {
  post(id, [this, service] {
    return callDriver<std_srvs::Trigger>(nh_, kHardware + service, ros::service_traits::md5sum<std_srvs::Trigger>(),
                                         std_srvs::Trigger::Request(),
                                         [](const std_srvs::Trigger::Response& response) { return response.message; });
  });
}

void UrDriver::setMagnet(std::uint64_t id, bool is_on) {
  post(id, [this, is_on] { return gripper_.set(is_on); });
}

void UrDriver::zeroForce(std::uint64_t id) {
  trigger(id, "zero_ftsensor");
}

void UrDriver::setPayload(std::uint64_t id, const ur_driver_bridge::Payload& payload) {
  ur_msgs::SetPayload::Request request;
  request.mass = static_cast<float>(payload.mass_kg);
  request.center_of_gravity.x = payload.centre_m.x();
  request.center_of_gravity.y = payload.centre_m.y();
  request.center_of_gravity.z = payload.centre_m.z();
  post(id, [this, request] {
    return callDriver<ur_msgs::SetPayload>(nh_, std::string(kHardware) + "set_payload",
                                           ros::service_traits::md5sum<ur_msgs::SetPayload>(), request,
                                           [](const ur_msgs::SetPayload::Response&) { return std::string(); });
  });
}

void UrDriver::dashboard(std::uint64_t id, const std::string& command) {
  trigger(id, command);
}

}  // namespace ur_driver_bridge_ros
