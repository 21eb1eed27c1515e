// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>

#include <image_transport/image_transport.h>
#include <image_transport/publisher.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <tf2_ros/transform_broadcaster.h>

#include "synthetic_depth/scene.h"

namespace sim_tests_ros {

struct PublisherParams {
  std::string scene_file;  ///< required
  std::string map_frame{"map"};
  std::string camera_frame{"camera_depth_optical_frame"};
  std::string encoding{"32FC1"};    ///< 32FC1 [m] or 16UC1 [mm, 0 = invalid] (REP-118)
  double rate_hz{0.0};              ///< frames per second of wall time; 0 = the scene's fps
  bool loop{true};                  ///< start again after the last frame
  int first_frame{0};               ///< frames before this one are left out
  int last_frame{-1};               ///< frames after this one are left out; -1 = none
  bool apply_sensor{true};          ///< false: exact depth within the range limits
  bool publish_clock{false};        ///< publish /clock and stamp with the scene's own time
  bool wait_for_subscriber{false};  ///< hold the first frame back until image and info both have a subscriber
  int seed{-1};                     ///< of the sensor noise; -1 = the scene's
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

}  // namespace sim_tests_ros
