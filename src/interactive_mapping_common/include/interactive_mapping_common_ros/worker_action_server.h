// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include <actionlib/server/action_server.h>
#include <interactive_mapping_common_ros/cancel_asked.h>
#include <ros/node_handle.h>

namespace interactive_mapping_ros {

/// Waits until ROS time has come to `due`, or the clock has stood still for `stall_s` of wall time, or `is_cancelled`.
/// False: the clock stood still.
bool waitUntil(const ros::Time& due, double stall_s, const std::function<bool()>& is_cancelled);

/// Holds a result back for its simulated cost, until `cost_s` after `started`. Not if `started` is zero: a clock that
/// waits for the result counts from another moment. Nothing by the wall clock. False: the clock stood still for
/// `stall_s` of wall time.
bool charge(double cost_s, const ros::Time& started, double stall_s, const std::function<bool()>& is_cancelled);

/// An action server that thinks about one goal at a time, on a thread of its own; a new goal cancels the one before. The
/// result always carries an `outcome`, such as PlanOutcome: SUCCESS succeeds, CANCELLED is preempted, all others abort.
template <typename Action>
class WorkerActionServer {
 public:
  using Server = actionlib::ActionServer<Action>;
  using GoalHandle = typename Server::GoalHandle;
  using Goal = typename Action::_action_goal_type::_goal_type;
  using Result = typename Action::_action_result_type::_result_type;
  using Feedback = typename Action::_action_feedback_type::_feedback_type;
  using Outcome = decltype(Result::outcome);
  /// `started`: when the goal was sent, ROS time; zero: its sender did not say.
  using Plan =
      std::function<Result(const Goal& goal, const ros::Time& started, const std::function<bool()>& is_cancelled,
                           const std::function<void(const Feedback&)>& tell)>;

  WorkerActionServer(ros::NodeHandle& nh, const std::string& name, Plan plan)
      : plan_(std::move(plan)),
        server_(
            nh, name, [this](GoalHandle goal) { onGoal(goal); }, NoCancelCallback(), false),
        worker_(&WorkerActionServer::work, this) {
    server_.start();
  }

  ~WorkerActionServer() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      is_stopping_ = true;
    }
    changed_.notify_all();
    worker_.join();
  }

  WorkerActionServer(const WorkerActionServer&) = delete;
  WorkerActionServer& operator=(const WorkerActionServer&) = delete;

 private:
  void onGoal(GoalHandle goal) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (has_next_) refuse(next_, "replaced by a newer goal before it was begun");
    next_ = goal;
    has_next_ = true;
    changed_.notify_all();
  }

  void refuse(GoalHandle& goal, const std::string& why) {
    Result result;
    result.outcome.status = Outcome::CANCELLED;
    result.outcome.message = why;
    goal.setCanceled(result, why);
  }

  void work() {
    std::unique_lock<std::mutex> lock(mutex_);
    while (true) {
      changed_.wait(lock, [this] { return is_stopping_ || has_next_; });
      if (is_stopping_) return;
      GoalHandle goal = next_;
      has_next_ = false;
      lock.unlock();

      goal.setAccepted();
      const auto is_cancelled = [this, &goal] {
        if (isCancelAsked(goal)) return true;
        const std::lock_guard<std::mutex> guard(mutex_);
        return is_stopping_ || has_next_;
      };
      if (is_cancelled()) {
        refuse(goal, "cancelled or replaced before it was begun");
        lock.lock();
        continue;
      }
      const auto tell = [&goal](const Feedback& feedback) { goal.publishFeedback(feedback); };
      const ros::Time started = goal.getGoalID().stamp;
      const Result result = plan_(*goal.getGoal(), started, is_cancelled, tell);
      if (result.outcome.status == Outcome::SUCCESS) {
        goal.setSucceeded(result);
      } else if (result.outcome.status == Outcome::CANCELLED) {
        goal.setCanceled(result, result.outcome.message);
      } else {
        goal.setAborted(result, result.outcome.message);
      }

      lock.lock();
    }
  }

  const Plan plan_;

  std::mutex mutex_;  // guards what follows, up to the blank line
  std::condition_variable changed_;
  bool is_stopping_{false};
  GoalHandle next_;
  bool has_next_{false};

  Server server_;
  std::thread worker_;  // last: everything it uses exists before it
};

}  // namespace interactive_mapping_ros
