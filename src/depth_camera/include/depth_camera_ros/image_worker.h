// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include <ros/node_handle.h>
#include <sensor_msgs/CameraInfo.h>

#include "depth_camera_ros/camera_pose_source.h"

namespace depth_camera_ros {

/// The shared part of inputs of images: a thread that works on the newest image. It waits for the camera info and the
/// camera's pose. An image that comes meanwhile replaces the one that waits. Callbacks of subscriptions only store what
/// they get; they may run in any callback queue. A derived class calls start() when it has subscribed and all that
/// process() uses exists, and stop() first in its destructor.
template <typename Job>
class ImageWorker {
 public:
  ImageWorker(const ImageWorker&) = delete;
  ImageWorker& operator=(const ImageWorker&) = delete;

  /// Believes the next pose, whatever it is: for a map that was cleared or loaded.
  void resetPoseGuard() { pose_source_.resetGuard(); }
  const tf2_ros::Buffer& tfBuffer() const { return pose_source_.buffer(); }
  std::string infoTopic() const { return info_subscriber_.getTopic(); }

 protected:
  using SteadyTime = CameraPoseSource::SteadyTime;

  ImageWorker(const ros::NodeHandle& nh, const CameraPoseParams& params) : pose_source_(nh, params) {}
  ~ImageWorker() = default;

  /// On the worker thread.
  virtual void process(const Job& job) = 0;

  void start() {
    pose_source_.listen();
    worker_ = std::thread([this] { work(); });
  }

  /// Ends waiting, and returns when process() has.
  void stop() {
    change([this] { is_stopping_ = true; });
    pose_source_.stop();
    if (worker_.joinable()) worker_.join();
    info_subscriber_.shutdown();
  }

  bool isStopping() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return is_stopping_;
  }

  void subscribeInfo(ros::NodeHandle nh, const std::string& topic) {
    info_subscriber_ = nh.subscribe<sensor_msgs::CameraInfo>(
        topic, 2, [this](const sensor_msgs::CameraInfoConstPtr& info) { change([&] { info_ = info; }); },
        ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
  }

  /// Counts the job in `counters`, which mutex_ guards.
  template <typename Counters>
  void put(Job job, Counters* counters) {
    change([&] {
      ++counters->received;
      if (waiting_) ++counters->replaced;
      waiting_ = std::move(job);
    });
  }

  /// Runs `function` under the mutex, then wakes whoever waits.
  template <typename Function>
  void change(Function function) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      function();
    }
    changed_.notify_all();
  }

  /// Until `is_done`, which the mutex guards, or the deadline, or stop().
  template <typename Condition>
  void waitUntil(SteadyTime deadline, std::unique_lock<std::mutex>* lock, Condition is_done) {
    changed_.wait_until(*lock, deadline, [&] { return is_done() || is_stopping_; });
  }

  /// Null, and the reason, if none comes.
  sensor_msgs::CameraInfoConstPtr waitForInfo(SteadyTime deadline, Refusal* refusal) {
    std::unique_lock<std::mutex> lock(mutex_);
    waitUntil(deadline, &lock, [this] { return info_ != nullptr; });
    if (!info_) *refusal = {FrameStatus::kNoCameraInfo, "no camera info on " + infoTopic()};
    return info_;
  }

  Refusal sizeMismatch(std::uint64_t width, std::uint64_t height, std::uint64_t info_width,
                       std::uint64_t info_height) const {
    return {FrameStatus::kSizeMismatch, "image is " + sizeText(width, height) + ", camera info on " + infoTopic() +
                                            " says " + sizeText(info_width, info_height)};
  }

  mutable std::mutex mutex_;  // guards what follows, up to the blank line, and what of the derived class it says
  std::condition_variable changed_;
  bool is_stopping_{false};
  std::optional<Job> waiting_;
  sensor_msgs::CameraInfoConstPtr info_;

  CameraPoseSource pose_source_;

 private:
  void work() {
    while (true) {
      std::unique_lock<std::mutex> lock(mutex_);
      changed_.wait(lock, [this] { return is_stopping_ || waiting_; });
      if (is_stopping_) return;
      const Job job = std::move(*waiting_);
      waiting_.reset();
      lock.unlock();
      process(job);
    }
  }

  ros::Subscriber info_subscriber_;
  std::thread worker_;
};

/// What is odd, if anything, about an image whose camera info names another frame.
inline std::string frameWarning(const std_msgs::Header& info, const std_msgs::Header& image) {
  const std::string info_frame = interactive_mapping_ros::withoutSlash(info.frame_id);
  const std::string image_frame = interactive_mapping_ros::withoutSlash(image.frame_id);
  if (info_frame == image_frame) return "";
  return "camera info is of frame '" + info_frame + "', the image of '" + image_frame + "': is it the right topic?";
}

}  // namespace depth_camera_ros
