// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/detect_server.h"

#include <chrono>
#include <utility>

#include <interactive_mapping_common/formatted.h>

#include "brick_detection_ros/conversions.h"

namespace brick_detection_ros {
namespace {

using interactive_mapping::formatted;

constexpr int kThreads = 4;                            // calls that can wait at once; others queue up
constexpr std::chrono::milliseconds kClockPeriod(20);  // a waiting call looks at the clock that often

void answer(std::uint8_t status, const std::string& message, interactive_mapping_msgs::DetectBricks::Response* r) {
  r->status = status;
  r->success = status == interactive_mapping_msgs::DetectBricks::Response::OK ? 1 : 0;
  r->message = message;
}

}  // namespace

DetectServer::DetectServer(const ros::NodeHandle& private_nh, const DetectParams& params, const Input& input)
    : params_(params), input_(input), spinner_(kThreads, &queue_) {
  ros::NodeHandle nh(private_nh);
  nh.setCallbackQueue(&queue_);
  server_ = nh.advertiseService("detect", &DetectServer::onDetect, this);
  spinner_.start();
}

DetectServer::~DetectServer() {
  stop();
}

void DetectServer::stop() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    is_stopping_ = true;
  }
  look_done_.notify_all();
  server_.shutdown();
  spinner_.stop();
}

bool DetectServer::wants(const ros::Time& stamp) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return !waiting_since_.empty() && (stamp.isZero() || *waiting_since_.begin() < stamp);
}

std::size_t DetectServer::numWaiting() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return waiting_since_.size();
}

void DetectServer::conclude(DetectLook look) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const bool is_accepted = look.update.status == interactive_mapping_msgs::BrickDetectionUpdate::ACCEPTED;
    (is_accepted ? last_accepted_ : last_refused_) = std::make_shared<const DetectLook>(std::move(look));
  }
  look_done_.notify_all();
}

bool DetectServer::onDetect(Request& request, Response& response) {
  const double timeout_s = request.timeout.isZero() ? params_.timeout_s : request.timeout.toSec();
  const ros::Time called = ros::Time::now();
  response.bricks.header.frame_id = input_.map_frame;
  if (timeout_s < 0.0) {
    answer(Response::NO_IMAGE,
           "timeout = " + formatted("%g s", timeout_s) + ", must be at least 0 s (0: the node's own)", &response);
    return true;
  }
  std::unique_lock<std::mutex> lock(mutex_);
  const auto place = waiting_since_.insert(called);
  await(called, timeout_s, &lock, &response);
  waiting_since_.erase(place);
  return true;
}

void DetectServer::await(const ros::Time& called, double timeout_s, std::unique_lock<std::mutex>* lock,
                         Response* response) {
  const std::shared_ptr<const DetectLook> refused_before = last_refused_;
  // A stamp alone does not tell: after time has run back, looks of before carry later ones, and one may be under way.
  const std::uint64_t look_before = last_accepted_ ? last_accepted_->update.look : 0;
  ros::Time clock = called;
  ros::WallTime clock_moved = ros::WallTime::now();
  while (true) {
    if (is_stopping_) return answer(Response::SHUTTING_DOWN, "the node is ending", response);
    const ros::Time now = ros::Time::now();
    // Exposed after the call, not at its very moment: that one may show the world before.
    const auto isAnswer = [&](const interactive_mapping_msgs::BrickDetectionUpdate& update) {
      const double ahead_s = update.header.stamp.toSec() - now.toSec();
      return update.look > look_before && update.header.stamp > called && ahead_s <= input_.max_future_s;
    };
    if (last_accepted_ && isAnswer(last_accepted_->update)) {
      response->update = last_accepted_->update;
      response->bricks = last_accepted_->bricks;
      return answer(Response::OK, last_accepted_->update.message, response);
    }
    if (now < called) return answer(Response::NO_IMAGE, "ROS time ran back during the call", response);
    if (now != clock) {
      clock = now;
      clock_moved = ros::WallTime::now();
    }
    const double stood_s = (ros::WallTime::now() - clock_moved).toSec();
    if (now.toSec() - called.toSec() >= timeout_s) {
      return answerNone(refused_before, "within " + formatted("%.3f s", timeout_s), response);
    }
    if (stood_s >= params_.clock_stall_s) {
      return answerNone(refused_before, "the clock has stood still for " + formatted("%.1f s", stood_s), response);
    }
    look_done_.wait_for(*lock, kClockPeriod);
  }
}

void DetectServer::answerNone(const std::shared_ptr<const DetectLook>& refused_before, const std::string& why,
                              Response* response) {
  if (last_refused_ == refused_before) {
    return answer(Response::NO_IMAGE, "no " + input_.what + " on " + input_.topic + ", " + why, response);
  }
  response->update = last_refused_->update;
  answer(Response::REFUSED,
         "no " + input_.what + " could be used, " + why +
             "; the last: " + toString(static_cast<DetectionUpdateStatus>(last_refused_->update.status)) + ", " +
             last_refused_->update.message,
         response);
}

}  // namespace brick_detection_ros
