// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/depth_input.h"

#include <cmath>
#include <cstdio>
#include <exception>
#include <stdexcept>

#include <tf2/exceptions.h>

namespace gpis_mapping_ros {
namespace {

using gpis_mapping::CameraModel;
using gpis_mapping::PoseGuard;

/// Stamps that step back by less are images out of order, not time that runs anew.
constexpr double kOutOfOrder_s = 1.0;

std::string seconds(double value) {
  char text[40];
  std::snprintf(text, sizeof(text), "%.3f s", value);
  return text;
}

std::string sizeText(int width, int height) {
  return std::to_string(width) + " x " + std::to_string(height) + " px";
}

std::chrono::steady_clock::duration toSteady(double duration_s) {
  return std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(duration_s));
}

DepthInputParams requireValid(const DepthInputParams& params) {
  const std::vector<std::string> problems = params.validate();
  if (problems.empty()) return params;
  std::string text = "impossible input parameters:";
  for (const std::string& problem : problems) text += "\n  " + problem;
  throw std::invalid_argument(text);
}

}  // namespace

std::vector<std::string> DepthInputParams::validate() const {
  std::vector<std::string> problems;
  const auto check = [&problems](const char* key, double value, double lo, double hi, const char* unit) {
    if (value >= lo && value <= hi) return;  // false for NaN
    char text[160];
    std::snprintf(text, sizeof(text), "%s = %g %s, must be in [%g, %g] %s", key, value, unit, lo, hi, unit);
    problems.push_back(text);
  };
  if (map_frame.empty() || map_frame.front() == '/') {
    problems.push_back("map_frame = '" + map_frame + "', must be a tf2 frame: not empty, no leading slash");
  }
  if (!camera_frame.empty() && (camera_frame.front() == '/' || camera_frame == map_frame)) {
    problems.push_back("camera_frame = '" + camera_frame + "', must be a tf2 frame other than map_frame, or empty");
  }
  check("depth_units_per_metre", depth_units_per_metre, 1.0, 1e6, "1/m");
  check("tf_timeout_s", tf_timeout_s, 0.0, 10.0, "s");
  check("max_future_s", max_future_s, 0.0, 1e9, "s");
  for (const std::string& problem : pose_limits.validate()) problems.push_back("pose_limits/" + problem);
  return problems;
}

DepthInput::DepthInput(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const DepthInputParams& params,
                       Consume consume, Refuse refuse)
    : params_(requireValid(params)),
      consume_(std::move(consume)),
      refuse_(std::move(refuse)),
      guard_(params.pose_limits),
      tf_listener_(tf_buffer_, nh),
      transport_(nh) {
  tf_connection_ = tf_buffer_._addTransformsChangedListener([this] {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++num_tf_messages_;
    changed_.notify_all();
  });
  info_subscriber_ = ros::NodeHandle(nh).subscribe("depth/camera_info", 2, &DepthInput::onInfo, this,
                                                   ros::TransportHints().tcpNoDelay());
  image_subscriber_ = transport_.subscribe(
      "depth/image_rect", 1, &DepthInput::onImage, this,
      image_transport::TransportHints(params_.image_transport, ros::TransportHints().tcpNoDelay(), private_nh));
  // Remappings decide what the topic is called.
  is_rectified_ = isRectifiedTopic(image_subscriber_.getTopic());
  worker_ = std::thread(&DepthInput::work, this);
}

DepthInput::~DepthInput() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    is_stopping_ = true;
  }
  changed_.notify_all();
  worker_.join();
  image_subscriber_.shutdown();
  info_subscriber_.shutdown();
  tf_buffer_._removeTransformsChangedListener(tf_connection_);
}

DepthInputCounters DepthInput::counters() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return counters_;
}

void DepthInput::setPoseLimits(const gpis_mapping::PoseLimits& limits) {
  const std::lock_guard<std::mutex> lock(mutex_);
  new_limits_ = limits;
}

void DepthInput::resetPoseGuard() {
  const std::lock_guard<std::mutex> lock(mutex_);
  reset_guard_ = true;
}

void DepthInput::onImage(const sensor_msgs::ImageConstPtr& image) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++counters_.received;
    if (waiting_) ++counters_.replaced;
    waiting_ = Waiting{image, std::chrono::steady_clock::now()};
  }
  changed_.notify_all();
}

void DepthInput::onInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    info_ = info;
  }
  changed_.notify_all();
}

void DepthInput::work() {
  while (true) {
    Waiting job;
    {
      std::unique_lock<std::mutex> lock(mutex_);
      changed_.wait(lock, [this] { return is_stopping_ || waiting_; });
      if (is_stopping_) return;
      job = std::move(*waiting_);
      waiting_.reset();
      if (new_limits_) guard_.setLimits(*new_limits_);
      if (reset_guard_) guard_.reset();
      new_limits_.reset();
      reset_guard_ = false;
    }
    Refusal refusal;
    bool was_consumed = false;
    try {
      std::optional<DepthInputFrame> frame = prepare(job, &refusal);
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        if (is_stopping_) return;
      }
      if (frame) {
        frame->wait_ms =
            std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - job.arrival).count();
        refusal = consume_(*frame);
        was_consumed = refusal.status == FrameStatus::kAccepted;
      }
    } catch (const std::exception& error) {  // out of memory, say: this image is lost, the next may do
      refusal = {FrameStatus::kRefusedByMap, error.what()};
    }
    count(refusal);
    if (!was_consumed) refuse_(job.image->header.stamp, refusal);
  }
}

void DepthInput::count(const Refusal& refusal) {
  const std::lock_guard<std::mutex> lock(mutex_);
  ++counters_.by_status[static_cast<std::size_t>(refusal.status)];
  if (refusal.status != FrameStatus::kAccepted) {
    counters_.last_refusal = std::string(toString(refusal.status)) + ": " + refusal.message;
  }
}

bool DepthInput::checkTime(const ros::Time& stamp, Refusal* refusal) {
  if (stamp.isZero()) {  // tf would take it for "newest"
    *refusal = {FrameStatus::kMalformedImage, "stamp is 0, must be the time of exposure"};
    return false;
  }
  const ros::Time now = ros::Time::now();
  const double ahead = stamp.toSec() - now.toSec();  // a ros::Duration ends at 68 years
  if (!now.isZero() && ahead > params_.max_future_s) {
    *refusal = {FrameStatus::kStampInFuture, "stamp is " + seconds(ahead) + " ahead of ROS time, must be at most " +
                                                 seconds(params_.max_future_s) +
                                                 " (max_future_s); are the clocks in step?"};
    return false;
  }
  if (!last_stamp_.isZero() && stamp <= last_stamp_) {
    const double back = last_stamp_.toSec() - stamp.toSec();
    if (back < kOutOfOrder_s) {
      *refusal = {FrameStatus::kTimeRanBack, "stamp is " + seconds(back) + " before the last one, must be after it"};
      return false;
    }
    // What tf and the guard remember belongs to a time that is yet to come.
    tf_buffer_.clear();
    guard_.reset();
    last_stamp_ = stamp;
    *refusal = {FrameStatus::kTimeRanBack,
                "time ran back by " + seconds(back) +
                    " (a looped bag?): transforms and pose history are forgotten, the map stays"};
    return false;
  }
  last_stamp_ = stamp;
  return true;
}

sensor_msgs::CameraInfoConstPtr DepthInput::waitForInfo(SteadyTime deadline) {
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait_until(lock, deadline, [this] { return is_stopping_ || info_; });
  return info_;
}

void DepthInput::noteTfAge(const std::string& camera_frame, const ros::Time& stamp) {
  bool has_age = false;
  double age_s = 0.0;
  try {
    const ros::Time newest = tf_buffer_.lookupTransform(params_.map_frame, camera_frame, ros::Time(0)).header.stamp;
    has_age = !newest.isZero();  // static transforms have no age
    age_s = stamp.toSec() - newest.toSec();
  } catch (const tf2::TransformException&) {
    has_age = false;
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  counters_.has_tf_age = has_age;
  counters_.last_tf_age_s = age_s;
}

std::optional<Eigen::Isometry3d> DepthInput::lookUpPose(const std::string& camera_frame, const ros::Time& stamp,
                                                        SteadyTime deadline, Refusal* refusal) {
  noteTfAge(camera_frame, stamp);
  while (true) {
    std::uint64_t seen;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      seen = num_tf_messages_;
    }
    std::string why;
    try {
      return toIsometry(tf_buffer_.lookupTransform(params_.map_frame, camera_frame, stamp).transform, refusal);
    } catch (const tf2::TransformException& error) {
      why = error.what();
    }
    std::unique_lock<std::mutex> lock(mutex_);
    const bool has_changed =
        changed_.wait_until(lock, deadline, [this, seen] { return is_stopping_ || num_tf_messages_ != seen; });
    if (has_changed && !is_stopping_) continue;
    *refusal = {FrameStatus::kNoTransform, "no transform from '" + camera_frame + "' to '" + params_.map_frame +
                                               "' at " + std::to_string(stamp.toSec()) + " s after waiting " +
                                               seconds(params_.tf_timeout_s) + " (tf_timeout_s): " + why};
    return std::nullopt;
  }
}

std::optional<DepthInputFrame> DepthInput::prepare(const Waiting& waiting, Refusal* refusal) {
  const sensor_msgs::Image& message = *waiting.image;
  const SteadyTime deadline = waiting.arrival + toSteady(params_.tf_timeout_s);
  if (!checkTime(message.header.stamp, refusal)) return std::nullopt;
  DepthInputFrame frame;
  frame.stamp = message.header.stamp;
  frame.camera_frame = params_.camera_frame.empty() ? withoutSlash(message.header.frame_id) : params_.camera_frame;
  if (frame.camera_frame.empty()) {
    *refusal = {FrameStatus::kMalformedImage,
                "frame_id is empty, must name the camera's optical frame (or set camera_frame)"};
    return std::nullopt;
  }
  if (frame.camera_frame == params_.map_frame) {
    *refusal = {FrameStatus::kMalformedImage,
                "frame_id '" + frame.camera_frame + "' is the map's frame, must name the camera's optical frame"};
    return std::nullopt;
  }
  std::optional<gpis_mapping::DepthImage> image = toDepthImage(message, params_.depth_units_per_metre, refusal);
  if (!image) return std::nullopt;
  const sensor_msgs::CameraInfoConstPtr info = waitForInfo(deadline);
  if (!info) {
    *refusal = {FrameStatus::kNoCameraInfo, "no camera info on " + info_subscriber_.getTopic()};
    return std::nullopt;
  }
  const std::optional<CameraModel> camera = toCameraModel(*info, is_rectified_, refusal);
  if (!camera) return std::nullopt;
  if (image->width != camera->width || image->height != camera->height) {
    *refusal = {FrameStatus::kSizeMismatch, "image is " + sizeText(image->width, image->height) + ", camera info on " +
                                                info_subscriber_.getTopic() + " says " +
                                                sizeText(camera->width, camera->height)};
    return std::nullopt;
  }
  const std::string info_frame = withoutSlash(info->header.frame_id);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    counters_.warning = info_frame == withoutSlash(message.header.frame_id)
                            ? ""
                            : "camera info is of frame '" + info_frame + "', the image of '" +
                                  withoutSlash(message.header.frame_id) + "': is it the right topic?";
  }
  if (!holdsMeasurement(*image)) {
    *refusal = {FrameStatus::kNothingMeasured, "none of " + std::to_string(image->depth_m.size()) +
                                                   " pixels holds a depth or +Inf: is the lens covered?"};
    return std::nullopt;
  }
  const std::optional<Eigen::Isometry3d> pose = lookUpPose(frame.camera_frame, frame.stamp, deadline, refusal);
  if (!pose) return std::nullopt;
  const PoseGuard::Verdict verdict = guard_.check(*pose, frame.stamp.toSec());
  if (verdict == PoseGuard::Verdict::kJump) {
    *refusal = {FrameStatus::kPoseJump, guard_.message()};
    return std::nullopt;
  }
  if (verdict == PoseGuard::Verdict::kSettled) {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++counters_.settled_jumps;
  }
  frame.image = std::move(*image);
  frame.camera = *camera;
  frame.T_map_camera = *pose;
  return frame;
}

}  // namespace gpis_mapping_ros
