// SPDX-License-Identifier: BSD-3-Clause
#include "depth_camera_ros/camera_pose_source.h"

#include <algorithm>
#include <stdexcept>

#include <interactive_mapping_common/formatted.h>
#include <tf2/exceptions.h>

namespace depth_camera_ros {
namespace {

using depth_camera::PoseGuard;
using depth_camera::StampGuard;
using interactive_mapping::formatted;

}  // namespace

CameraPoseSource::CameraPoseSource(const ros::NodeHandle& nh, const CameraPoseParams& params)
    : params_(interactive_mapping::requireValid("impossible parameters of the camera's pose:", params)),
      guard_(params.pose_limits),
      nh_(nh) {
  connection_ = buffer_._addTransformsChangedListener([this] {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++num_tf_messages_;
    changed_.notify_all();
  });
}

void CameraPoseSource::listen() {
  listener_.emplace(buffer_, nh_, true, ros::TransportHints().tcpNoDelay());
}

CameraPoseSource::~CameraPoseSource() {
  stop();
  buffer_._removeTransformsChangedListener(connection_);
}

void CameraPoseSource::stop() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    is_stopping_ = true;
  }
  changed_.notify_all();
}

void CameraPoseSource::setLimits(const depth_camera::PoseLimits& limits) {
  const std::lock_guard<std::mutex> lock(mutex_);
  new_limits_ = limits;
}

void CameraPoseSource::resetGuard() {
  const std::lock_guard<std::mutex> lock(mutex_);
  reset_guard_ = true;
}

CameraPoseCounters CameraPoseSource::counters() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return counters_;
}

CameraPoseSource::SteadyTime CameraPoseSource::deadline(SteadyTime arrival) const {
  // A pose of later than the image comes later by as much.
  const double wait_s = params_.tf_timeout_s + std::max(0.0, params_.time_offset_s);
  return arrival + std::chrono::duration_cast<SteadyTime::duration>(std::chrono::duration<double>(wait_s));
}

CameraPoseSource::StampVerdict CameraPoseSource::checkStamp(const ros::Time& stamp, Refusal* refusal) {
  const ros::Time now = ros::Time::now();
  const double ahead = stamp.toSec() - now.toSec();  // a ros::Duration ends at 68 years
  if (!stamp.isZero() && !now.isZero() && ahead > params_.max_future_s) {
    *refusal = {FrameStatus::kStampInFuture,
                "stamp is " + formatted("%.3f s", ahead) + " ahead of ROS time, must be at most " +
                    formatted("%.3f s", params_.max_future_s) + " (max_future_s); are the clocks in step?"};
    return StampVerdict::kRefused;
  }
  switch (stamps_.check(stamp.toSec())) {
    case StampGuard::Verdict::kGood:
      return StampVerdict::kGood;
    case StampGuard::Verdict::kZero:
      *refusal = {FrameStatus::kMalformedImage, stamps_.message()};
      return StampVerdict::kRefused;
    case StampGuard::Verdict::kOutOfOrder:
      *refusal = {FrameStatus::kTimeRanBack, stamps_.message()};
      return StampVerdict::kRefused;
    case StampGuard::Verdict::kRestarted:
      break;
  }
  // What tf and the guard remember belongs to a time that is yet to come.
  buffer_.clear();
  guard_.reset();
  has_restarted_ = true;
  *refusal = {FrameStatus::kTimeRanBack, stamps_.message() + ": transforms and pose history are forgotten"};
  return StampVerdict::kRestarted;
}

std::optional<std::string> CameraPoseSource::cameraFrame(const std::string& frame_id, Refusal* refusal) const {
  std::string frame =
      params_.camera_frame.empty() ? interactive_mapping_ros::withoutSlash(frame_id) : params_.camera_frame;
  if (frame.empty()) {
    *refusal = {FrameStatus::kMalformedImage,
                "frame_id is empty, must name the camera's optical frame (or set camera_frame)"};
    return std::nullopt;
  }
  if (frame == params_.map_frame) {
    *refusal = {FrameStatus::kMalformedImage,
                "frame_id '" + frame + "' is the map's frame, must name the camera's optical frame"};
    return std::nullopt;
  }
  return frame;
}

void CameraPoseSource::noteAge(const std::string& camera_frame, const ros::Time& stamp) {
  bool has_age = false;
  double age_s = 0.0;
  try {
    const ros::Time newest = buffer_.lookupTransform(params_.map_frame, camera_frame, ros::Time(0)).header.stamp;
    has_age = !newest.isZero();  // static transforms have no age
    age_s = stamp.toSec() - newest.toSec();
  } catch (const tf2::TransformException&) {
    has_age = false;
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  counters_.has_tf_age = has_age;
  counters_.last_tf_age_s = age_s;
}

std::optional<Eigen::Isometry3d> CameraPoseSource::lookUp(const std::string& camera_frame, const ros::Time& stamp,
                                                          SteadyTime deadline, Refusal* refusal) {
  noteAge(camera_frame, stamp);
  while (true) {
    std::uint64_t seen;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      seen = num_tf_messages_;
    }
    std::string why;
    try {
      const auto transform = buffer_.lookupTransform(params_.map_frame, camera_frame, stamp).transform;
      has_restarted_ = false;
      return toIsometry(transform, refusal);
    } catch (const tf2::TransformException& error) {
      why = error.what();
    }
    std::unique_lock<std::mutex> lock(mutex_);
    const bool has_changed =
        changed_.wait_until(lock, deadline, [this, seen] { return is_stopping_ || num_tf_messages_ != seen; });
    if (has_changed && !is_stopping_) continue;
    // One transform of the time before that arrived after the restart makes tf refuse all of the new time.
    if (has_restarted_) buffer_.clear();
    *refusal = {FrameStatus::kNoTransform, "no transform from '" + camera_frame + "' to '" + params_.map_frame +
                                               "' at " + std::to_string(stamp.toSec()) + " s after waiting " +
                                               formatted("%.3f s", params_.tf_timeout_s) + " (tf_timeout_s): " + why};
    return std::nullopt;
  }
}

std::optional<Eigen::Isometry3d> CameraPoseSource::poseAt(const std::string& camera_frame, const ros::Time& stamp,
                                                          SteadyTime deadline, Refusal* refusal) {
  const std::optional<Eigen::Isometry3d> pose =
      lookUp(camera_frame, shifted(stamp, params_.time_offset_s), deadline, refusal);
  if (!pose) return std::nullopt;
  const std::lock_guard<std::mutex> lock(mutex_);
  if (new_limits_) guard_.setLimits(*new_limits_);
  if (reset_guard_) guard_.reset();
  new_limits_.reset();
  reset_guard_ = false;
  const PoseGuard::Verdict verdict = guard_.check(*pose, stamp.toSec());
  if (verdict == PoseGuard::Verdict::kJump) {
    *refusal = {FrameStatus::kPoseJump, guard_.message()};
    return std::nullopt;
  }
  if (verdict == PoseGuard::Verdict::kSettled) ++counters_.settled_jumps;
  return pose;
}

}  // namespace depth_camera_ros
