// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth_ros/synthetic_depth_publisher.h"

#include <limits>
#include <stdexcept>

#include <geometry_msgs/TransformStamped.h>
#include <interactive_mapping_common_ros/params.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/fill_image.h>
#include <sensor_msgs/image_encodings.h>
#include <tf2_eigen/tf2_eigen.h>

#include "synthetic_depth/scene_loader.h"
#include "synthetic_depth/sensor.h"
#include "synthetic_depth_ros/camera_info.h"

namespace synthetic_depth_ros {
namespace {

constexpr double kMillimetresPerMetre = 1000.0;

}  // namespace

void PublisherParams::fields(PublisherParams& c, interactive_mapping::Fields& f) {
  constexpr int kMost = std::numeric_limits<int>::max();
  f("scene_file", c.scene_file, "file of the scene");
  f.require(!c.scene_file.empty(), "scene_file = '', must be the path of a scene file");
  f("map_frame", c.map_frame, "fixed frame");
  f.require(!c.map_frame.empty() && c.map_frame.front() != '/',
            "map_frame = '" + c.map_frame + "', must be a frame name without leading slash");
  f("camera_frame", c.camera_frame, "optical frame of the camera");
  f.require(
      !c.camera_frame.empty() && c.camera_frame.front() != '/' && c.camera_frame != c.map_frame,
      "camera_frame = '" + c.camera_frame + "', must be a frame name without leading slash, other than map_frame");
  f("encoding", c.encoding, "32FC1 [m] or 16UC1 [mm, 0 = invalid] (REP-118)");
  f.require(c.encoding == "32FC1" || c.encoding == "16UC1", "encoding = '" + c.encoding + "', must be 32FC1 or 16UC1");
  f("rate_hz", c.rate_hz, 0.0, 1000.0, "Hz", "frames per second of wall time; 0: the scene's own");
  f("loop", c.loop, "true: starts again after the last frame");
  f("first_frame", c.first_frame, 0, kMost, "", "frames before this one are left out");
  f("last_frame", c.last_frame, -1, kMost, "", "frames after this one are left out; -1: none");
  f("apply_sensor", c.apply_sensor, "false: exact depth within the range limits");
  f("publish_clock", c.publish_clock, "true: publishes /clock and stamps with the scene's own time");
  f("wait_for_subscriber", c.wait_for_subscriber,
    "true: the first frame waits until image and info both have a subscriber");
  f("seed", c.seed, -1, kMost, "", "seed of the sensor noise; -1: the scene's");
}

PublisherParams loadPublisherParams(const ros::NodeHandle& private_nh) {
  return interactive_mapping_ros::loadParams<PublisherParams>(private_nh);
}

SyntheticDepthPublisher::SyntheticDepthPublisher(const ros::NodeHandle& nh, const PublisherParams& params)
    : params_(params), scene_(synthetic_depth::loadScene(params.scene_file)), nh_(nh), transport_(nh_) {
  if (params_.seed >= 0) {
    scene_.seed = static_cast<std::uint64_t>(params_.seed);
  }
  if (!params_.apply_sensor) {
    scene_.sensor = scene_.sensor.withoutNoise();
  }
  if (!(params_.rate_hz > 0.0)) {
    params_.rate_hz = scene_.fps;
  }
  if (params_.last_frame < 0) {
    params_.last_frame = scene_.numFrames() - 1;
  }
  if (params_.first_frame > params_.last_frame || params_.last_frame >= scene_.numFrames()) {
    throw std::invalid_argument("first_frame = " + std::to_string(params_.first_frame) + ", last_frame = " +
                                std::to_string(params_.last_frame) + ", must be in order and in [0, " +
                                std::to_string(scene_.numFrames() - 1) + "], the frames of " + params_.scene_file);
  }
  camera_info_ = cameraInfo(scene_.camera, params_.camera_frame);
  constexpr std::uint32_t kQueueSize = 10;
  // Not a CameraPublisher: that cannot tell whether both topics have a subscriber.
  image_publisher_ = transport_.advertise("depth/image_rect", kQueueSize);
  info_publisher_ = nh_.advertise<sensor_msgs::CameraInfo>("depth/camera_info", kQueueSize);
  if (params_.publish_clock) {
    clock_publisher_ = nh_.advertise<rosgraph_msgs::Clock>("/clock", kQueueSize);
  }
  ROS_INFO("%s: frames %d to %d of %d, %zu boxes, %s at %.3g Hz, %s -> %s, loop %s, sensor %s, clock %s",
           params_.scene_file.c_str(), params_.first_frame, params_.last_frame, scene_.numFrames(), scene_.boxes.size(),
           params_.encoding.c_str(), params_.rate_hz, params_.map_frame.c_str(), params_.camera_frame.c_str(),
           params_.loop ? "on" : "off", params_.apply_sensor ? "on" : "off", params_.publish_clock ? "on" : "off");
  // Wall time, as this node may be the one that makes ROS time.
  timer_ = nh_.createWallTimer(ros::WallDuration(1.0 / params_.rate_hz),
                               [this](const ros::WallTimerEvent&) { publishNext(); });
}

void SyntheticDepthPublisher::publishNext() {
  if (num_published_ == 0 && params_.wait_for_subscriber &&
      (image_publisher_.getNumSubscribers() == 0 || info_publisher_.getNumSubscribers() == 0)) {
    return;
  }
  if (!params_.loop && num_published_ == numFrames()) {
    timer_.stop();
    ROS_INFO("sequence is complete: %d frames", numFrames());
    return;
  }
  const int frame = params_.first_frame + static_cast<int>(num_published_ % numFrames());
  // The scene's time runs on through loops: ROS time must not jump back.
  const ros::Time stamp =
      params_.publish_clock
          ? ros::Time(scene_.start_time_s + static_cast<double>(params_.first_frame + num_published_) / scene_.fps)
          : ros::Time::now();
  ++num_published_;
  if (params_.publish_clock) {
    rosgraph_msgs::Clock clock;
    clock.clock = stamp;
    clock_publisher_.publish(clock);
  }

  const Eigen::Isometry3d T_map_camera = scene_.cameraInMap(frame);
  geometry_msgs::TransformStamped transform = tf2::eigenToTransform(T_map_camera);
  transform.header.stamp = stamp;
  transform.header.frame_id = params_.map_frame;
  transform.child_frame_id = params_.camera_frame;
  tf_broadcaster_.sendTransform(transform);

  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = params_.camera_frame;
  cv::Mat depth = synthetic_depth::measureDepth(scene_, frame);
  if (params_.encoding == sensor_msgs::image_encodings::TYPE_16UC1) {
    depth = synthetic_depth::encodeDepth16(depth, kMillimetresPerMetre);
  }
  camera_info_.header = header;
  info_publisher_.publish(camera_info_);
  sensor_msgs::Image image;
  image.header = header;
  sensor_msgs::fillImage(image, params_.encoding, static_cast<std::uint32_t>(depth.rows),
                         static_cast<std::uint32_t>(depth.cols), static_cast<std::uint32_t>(depth.step), depth.data);
  image_publisher_.publish(image);
}

}  // namespace synthetic_depth_ros
