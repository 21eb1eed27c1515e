// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <boost/signals2/connection.hpp>
#include <ros/node_handle.h>
#include <ros/time.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <interactive_mapping_common/config/schema.h>
#include "depth_camera/pose_guard.h"
#include "depth_camera/stamp_guard.h"
#include "depth_camera_ros/conversions.h"

namespace depth_camera_ros {

struct CameraPoseParams {
  std::string map_frame{"map"};
  std::string camera_frame;
  double tf_timeout_s{0.2};
  double time_offset_s{0.0};
  double max_future_s{0.5};
  depth_camera::PoseLimits pose_limits;

  static void fields(CameraPoseParams& c, interactive_mapping::Fields& f) {
    f("map_frame", c.map_frame, "fixed frame of the map, z up");
    f("camera_frame", c.camera_frame, "optical frame; empty: the frame_id of the image");
    f("tf_timeout_s", c.tf_timeout_s, 0.0, 10.0, "s",
      "how long an image waits for its pose and camera info, by the wall clock");
    f("time_offset_s", c.time_offset_s, -1.0, 1.0, "s",
      "added to the stamp of an image before its pose is looked up; negative when images are stamped too late");
    f("max_future_s", c.max_future_s, 0.0, 1e9, "s", "how far a stamp may lie ahead of ROS time");
    f.section("pose_limits", c.pose_limits, "a pose that moves farther than step + speed * time is refused");
    f.require(!c.map_frame.empty() && c.map_frame.front() != '/',
              "map_frame = '" + c.map_frame + "', must be a tf2 frame: not empty, no leading slash");
    f.require(c.camera_frame.empty() || (c.camera_frame.front() != '/' && c.camera_frame != c.map_frame),
              "camera_frame = '" + c.camera_frame + "', must be a tf2 frame other than map_frame, or empty");
  }
};

/// What tf said so far; for diagnostics.
struct CameraPoseCounters {
  std::uint64_t settled_jumps{0};
  double last_tf_age_s{0.0};  // newest pose in tf, how old at the time of the last image's look-up
  bool has_tf_age{false};
};

/// The pose of a camera in the map at each image's stamp: from tf, waited for, and checked. Checks the stamps, too. One
/// thread asks, image by image; stop(), the setters and counters() may be called from any.
class CameraPoseSource {
 public:
  using SteadyTime = std::chrono::steady_clock::time_point;

  enum class StampVerdict {
    kGood,
    kRefused,    // this image is left out
    kRestarted,  // left out, too: time ran back, and what was known of tf is forgotten; the next image is taken in
  };

  /// Throws std::invalid_argument for impossible parameters.
  CameraPoseSource(const ros::NodeHandle& nh, const CameraPoseParams& params);
  ~CameraPoseSource();
  CameraPoseSource(const CameraPoseSource&) = delete;
  CameraPoseSource& operator=(const CameraPoseSource&) = delete;

  /// Listens to tf from now on. After image_transport's plugins are loaded: dlopen() and a first warning of tf2 would
  /// wait for each other's locks.
  void listen();

  /// Of the next image. Stamps must rise, and be of now.
  StampVerdict checkStamp(const ros::Time& stamp, Refusal* refusal);

  /// The frame to ask for when an image has this frame_id; nothing, and the reason, if it can be none.
  std::optional<std::string> cameraFrame(const std::string& frame_id, Refusal* refusal) const;

  /// When to give up waiting for what belongs to an image that arrived then.
  SteadyTime deadline(SteadyTime arrival) const;

  /// T_map_camera at `stamp` + time_offset_s. Waits until tf can answer, or the deadline, or stop(). Nothing, and the reason, when there is no pose
  /// or the camera cannot have moved there.
  std::optional<Eigen::Isometry3d> poseAt(const std::string& camera_frame, const ros::Time& stamp, SteadyTime deadline,
                                          Refusal* refusal);

  /// Ends waiting, now and for good.
  void stop();

  void setLimits(const depth_camera::PoseLimits& limits);
  /// Believes the next pose, whatever it is.
  void resetGuard();
  CameraPoseCounters counters() const;
  const tf2_ros::Buffer& buffer() const { return buffer_; }

 private:
  void noteAge(const std::string& camera_frame, const ros::Time& stamp);
  std::optional<Eigen::Isometry3d> lookUp(const std::string& camera_frame, const ros::Time& stamp, SteadyTime deadline,
                                          Refusal* refusal);

  const CameraPoseParams params_;

  mutable std::mutex mutex_;  // guards what follows, up to the blank line
  std::condition_variable changed_;
  bool is_stopping_{false};
  std::uint64_t num_tf_messages_{0};
  std::optional<depth_camera::PoseLimits> new_limits_;
  bool reset_guard_{false};
  CameraPoseCounters counters_;

  // Of the thread that asks.
  depth_camera::PoseGuard guard_;
  depth_camera::StampGuard stamps_;
  bool has_restarted_{false};  // time ran back, and tf has not answered since

  const ros::NodeHandle nh_;
  tf2_ros::Buffer buffer_;
  std::optional<tf2_ros::TransformListener> listener_;
  boost::signals2::connection connection_;
};

}  // namespace depth_camera_ros
