// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <string>

#include <actionlib/client/action_client.h>
#include <ros/callback_queue_interface.h>
#include <ros/node_handle.h>
#include <ros/time.h>

namespace pick_mission_ros {

/// An action server as its client sees it: one goal at a time, whose end is reported once, also when the server is lost.
/// All in the thread of `queue`.
template <typename Action>
class ActionCaller {
 public:
  using Client = actionlib::ActionClient<Action>;
  using Goal = typename Action::_action_goal_type::_goal_type;
  using Result = typename Action::_action_result_type::_result_type;
  using ResultConstPtr = boost::shared_ptr<const Result>;

  /// How a goal ended. Without a result there is no answer, and `why` says so.
  struct End {
    ResultConstPtr result;
    bool is_succeeded{false};
    bool is_cancelled{false};
    std::string why;  // or the text of the status
  };
  using OnEnd = std::function<void(const End& end)>;

  ActionCaller(const ros::NodeHandle& nh, const std::string& name, ros::CallbackQueueInterface* queue)
      : name_(name), client_(nh, name, queue) {}

  const std::string& name() const { return name_; }
  bool isConnected() { return client_.isServerConnected(); }
  bool isActive() const { return static_cast<bool>(on_end_); }

  /// The goal waits for its server, at most as long as watch() allows. One that still runs is abandoned.
  void send(const Goal& goal, OnEnd on_end) {
    abandon();
    on_end_ = std::move(on_end);
    goal_ = goal;
    seen_ = ros::SteadyTime::now();
    if (maySend()) reallySend();
  }

  void cancel() {
    if (!isActive()) return;
    is_cancel_wanted_ = true;
    if (is_sent_) handle_.cancel();
  }

  /// Cancels every goal that the server has, of any client: now, or as soon as it is there.
  void cancelAll() {
    cancel();
    is_cancel_all_wanted_ = true;
    reallyCancelAll();
  }
  /// It has not reached the server yet.
  bool isCancelAllWanted() const { return is_cancel_all_wanted_; }

  /// Cancels the goal, whose end is not reported any more.
  void abandon() {
    if (isActive() && is_sent_) abandoned_ = handle_;
    ++number_;  // what still comes is of no goal
    on_end_ = nullptr;
    is_sent_ = is_cancel_wanted_ = false;
    cancelAbandoned();
  }

  /// To be called now and then. Gives up a goal whose server has been away for `timeout` of wall time, or has not
  /// acknowledged it for as long. Also gives up a goal that has ended without a result for as long.
  void watch(ros::WallDuration timeout) {
    reallyCancelAll();
    cancelAbandoned();
    if (!isActive()) return;
    if (!is_sent_ && is_cancel_wanted_) {
      End end;
      end.is_cancelled = true;
      end.why = name_ + ": cancelled before it was sent";
      return finish(end);
    }
    const ros::SteadyTime now = ros::SteadyTime::now();
    const bool is_connected = isConnected();
    if (!is_sent_ && maySend()) reallySend();
    // A server that was restarted may not know the goal: actionlib reports that of running goals only.
    if (is_connected && (!is_sent_ || !isUnheard())) seen_ = now;
    if (now - seen_ < timeout) return;
    End end;
    end.why = "the action server " + name_ + (is_connected ? " does not report the goal's result" : " is not there");
    const OnEnd on_end = on_end_;
    abandon();
    on_end(end);
  }

 private:
  /// Goals and cancels go by different connections: one may overtake the other. Wall time
  static constexpr double kOvertaking_s = 0.2;

  bool maySend() {
    reallyCancelAll();
    return isConnected() && !is_cancel_all_wanted_ && (ros::SteadyTime::now() - cancelled_all_).toSec() > kOvertaking_s;
  }

  void reallyCancelAll() {
    if (!is_cancel_all_wanted_ || !isConnected()) return;
    client_.cancelAllGoals();
    is_cancel_all_wanted_ = false;
    cancelled_all_ = ros::SteadyTime::now();
  }

  /// A server that has been away may still be at it.
  void cancelAbandoned() {
    if (abandoned_.isExpired() || !isConnected()) return;
    abandoned_.cancel();
    abandoned_.reset();
  }

  /// For the server, the goal has not begun or has ended.
  bool isUnheard() const {
    const actionlib::CommState state = handle_.getCommState();
    return state == actionlib::CommState::WAITING_FOR_GOAL_ACK || state == actionlib::CommState::WAITING_FOR_RESULT;
  }

  void reallySend() {
    is_sent_ = true;
    seen_ = ros::SteadyTime::now();
    const std::uint64_t number = number_;
    handle_ = client_.sendGoal(goal_, [this, number](typename Client::GoalHandle handle) {
      if (number != number_ || !isActive()) return;  // of a goal that was given up
      if (handle.getCommState() != actionlib::CommState::DONE) return;
      End end;
      const actionlib::TerminalState state = handle.getTerminalState();
      end.why = state.getText();
      if (state == actionlib::TerminalState::LOST) {
        end.why = "the action server " + name_ + " has lost the goal: it was restarted";
      } else {
        end.result = handle.getResult();
        end.is_succeeded = state == actionlib::TerminalState::SUCCEEDED;
        end.is_cancelled = state == actionlib::TerminalState::PREEMPTED || state == actionlib::TerminalState::RECALLED;
        if (!end.result && end.why.empty()) end.why = "the action server " + name_ + " gave no result";
      }
      finish(end);
    });
  }

  void finish(const End& end) {
    const OnEnd on_end = std::move(on_end_);
    on_end_ = nullptr;
    is_sent_ = is_cancel_wanted_ = false;
    on_end(end);
  }

  const std::string name_;
  Goal goal_;
  OnEnd on_end_;
  bool is_sent_{false};
  bool is_cancel_wanted_{false};
  bool is_cancel_all_wanted_{false};
  ros::SteadyTime cancelled_all_;
  std::uint64_t number_{0};  // of the goal
  ros::SteadyTime seen_;     // when the server was last there and at the goal
  Client client_;
  typename Client::GoalHandle handle_, abandoned_;  // after the client: they go before it
};

}  // namespace pick_mission_ros
