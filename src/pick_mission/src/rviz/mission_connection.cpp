// SPDX-License-Identifier: BSD-3-Clause
#include "mission_connection.h"

#include <algorithm>
#include <atomic>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <utility>

#include <std_srvs/Trigger.h>

namespace pick_mission_rviz {
namespace {

/// Wall time after which a hold that has no answer may be lost: then another press gives another one.
constexpr double kHoldAgain_s = 2.0;
/// Wall time that closing leaves to a hold that is on its way.
constexpr double kHoldOut_s = 0.5;
constexpr double kPoll_s = 0.01;

}  // namespace

/// One request in its own thread.
class MissionConnection::Call {
 public:
  Call(Request request, unsigned epoch, std::string service, std::function<void(const Answer&)> done)
      : request_(request), epoch_(epoch), service_(std::move(service)), done_(std::move(done)), thread_([this] {
          run();
        }) {}
  ~Call() {
    breakOff();
    thread_.join();
  }

  Request request() const { return request_; }
  unsigned epoch() const { return epoch_; }
  double age() const { return (ros::SteadyTime::now() - begun_).toSec(); }
  /// Its answer is told, or about to be.
  bool hasEnded() const { return has_ended_; }

  /// The answer is of no interest any more.
  void breakOff() {
    const std::lock_guard<std::mutex> lock(client_mutex_);
    is_broken_off_ = true;
    client_.shutdown();  // wakes a call that waits: that is why its connection is a persistent one
  }

 private:
  void run() {
    const Answer answer = ask();
    // Before it is told: whoever presses again after that gives a new one.
    has_ended_ = true;
    done_(answer);
  }

  Answer ask() {
    ros::NodeHandle nh;
    // Connects at once: without a service it is not valid.
    ros::ServiceClient client = nh.serviceClient<std_srvs::Trigger>(service_, true);
    Answer answer;
    if (!client.isValid()) return answer;
    {
      const std::lock_guard<std::mutex> lock(client_mutex_);
      if (is_broken_off_) {
        client.shutdown();
        return answer;
      }
      client_ = client;
    }
    std_srvs::Trigger trigger;
    if (client.call(trigger)) {
      answer.kind = Answer::Kind::kAnswered;
      answer.success = trigger.response.success;
      answer.message = trigger.response.message;
    } else {
      answer.kind = Answer::Kind::kBroken;
    }
    return answer;
  }

  const Request request_;
  const unsigned epoch_;
  const ros::SteadyTime begun_{ros::SteadyTime::now()};
  const std::string service_;
  const std::function<void(const Answer&)> done_;
  std::mutex client_mutex_;  // guards the next two
  ros::ServiceClient client_;
  bool is_broken_off_{false};
  std::atomic<bool> has_ended_{false};
  std::thread thread_;  // last: it uses all of the above
};

MissionConnection::MissionConnection(StateCallback on_state, AnswerCallback on_answer)
    : on_state_(std::move(on_state)), on_answer_(std::move(on_answer)), spinner_(1, &queue_) {
  nh_.setCallbackQueue(&queue_);
  spinner_.start();
}

MissionConnection::~MissionConnection() {
  subscriber_.shutdown();
  spinner_.stop();
  const auto isHoldOpen = [](const std::unique_ptr<Call>& call) {
    return call->request() == Request::kHold && !call->hasEnded();
  };
  const ros::SteadyTime begin = ros::SteadyTime::now();
  while ((ros::SteadyTime::now() - begin).toSec() < kHoldOut_s &&
         std::any_of(calls_.begin(), calls_.end(), isHoldOpen)) {
    ros::WallDuration(kPoll_s).sleep();
  }
  for (const std::unique_ptr<Call>& call : calls_) call->breakOff();
  calls_.clear();  // joins
}

void MissionConnection::connectTo(const std::string& node) {
  std::string error;
  if (node.empty() || node == "/" || !ros::names::validate(node, error)) {
    throw std::invalid_argument("node = \"" + node + "\", must be a node's name" + (error.empty() ? "" : ": " + error));
  }
  node_ = ros::names::resolve(node);
  const unsigned epoch = ++epoch_;
  subscriber_.shutdown();
  for (const std::unique_ptr<Call>& call : calls_) {
    if (call->request() != Request::kHold) call->breakOff();
  }
  using interactive_mapping_msgs::MissionState;
  subscriber_ = nh_.subscribe<MissionState>(node_ + "/state", 1, [this, epoch](const MissionState::ConstPtr& state) {
    // Runs in the spinner's thread, what it hands on in this object's.
    QMetaObject::invokeMethod(
        this,
        [this, epoch, state] {
          if (epoch == epoch_) on_state_(state);
        },
        Qt::QueuedConnection);
  });
}

void MissionConnection::call(Request request) {
  calls_.erase(
      std::remove_if(calls_.begin(), calls_.end(), [](const std::unique_ptr<Call>& call) { return call->hasEnded(); }),
      calls_.end());
  for (const std::unique_ptr<Call>& call : calls_) {
    if (call->request() != request || call->epoch() != epoch_) continue;
    if (request != Request::kHold) {
      call->breakOff();
    } else if (last_request_ == request && call->age() < kHoldAgain_s) {
      return;  // it is on its way, and nothing that may have taken it back
    }
  }
  last_request_ = request;
  const unsigned epoch = epoch_;
  const unsigned number = ++last_call_[static_cast<std::size_t>(request)];
  calls_.push_back(std::make_unique<Call>(
      request, epoch, node_ + "/" + serviceOf(request), [this, request, epoch, number](const Answer& answer) {
        QMetaObject::invokeMethod(
            this,
            [this, request, epoch, number, answer] {
              unsigned& last = last_call_[static_cast<std::size_t>(request)];
              // Of several holds one that is taken is enough: that another one fails after it is not told.
              const bool is_hold_taken = request == Request::kHold && answer.success;
              if (epoch != epoch_ || (number != last && !is_hold_taken)) return;
              if (is_hold_taken) ++last;
              on_answer_(request, answer);
            },
            Qt::QueuedConnection);
      }));
}

}  // namespace pick_mission_rviz
