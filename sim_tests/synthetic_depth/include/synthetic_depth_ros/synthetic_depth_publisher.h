// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>

#include <image_transport/image_transport.h>
#include <image_transport/publisher.h>
#include <interactive_mapping_common/config/schema.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <tf2_ros/transform_broadcaster.h>

#include "synthetic_depth/scene.h"

namespace synthetic_depth_ros {

struct PublisherParams {
  std::string scene_file;
  std::string map_frame{"map"};
  std::string camera_frame{"camera_depth_optical_frame"};
  std::string encoding{"32FC1"};
  double rate_hz{0.0};
  bool loop{true};
  int first_frame{0};
  int last_frame{-1};
  bool apply_sensor{true};
  bool publish_clock{false};
  bool wait_for_subscriber{false};
  int seed{-1};

  static void fields(PublisherParams& c, interactive_mapping::Fields& f);
};

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and bad value.
PublisherParams loadPublisherParams(const ros::NodeHandle& private_nh);

/// Publishes a scene frame by frame: depth/image_rect, depth/camera_info, tf map_frame -> camera_frame and, if asked, /clock.
/// All messages of a frame have one stamp, and tf goes out first. Callbacks run in the global queue (serial).
class SyntheticDepthPublisher {
 public:
  /// Throws std::invalid_argument if the scene is refused or has not got the frames asked for.
  SyntheticDepthPublisher(const ros::NodeHandle& nh, const PublisherParams& params);

 private:
  /// Of one round.
  int numFrames() const { return params_.last_frame - params_.first_frame + 1; }
  void publishNext();

  PublisherParams params_;
  synthetic_depth::Scene scene_;
  ros::NodeHandle nh_;
  image_transport::ImageTransport transport_;
  image_transport::Publisher image_publisher_;
  ros::Publisher info_publisher_;
  ros::Publisher clock_publisher_;
  tf2_ros::TransformBroadcaster tf_broadcaster_;
  sensor_msgs::CameraInfo camera_info_;
  std::int64_t num_published_{0};
  ros::WallTimer timer_;  // last: nothing it uses may go before it
};

}  // namespace synthetic_depth_ros
