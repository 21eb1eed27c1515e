// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_ROS_DEPTH_INPUT_H
#define GPIS_MAPPING_ROS_DEPTH_INPUT_H

#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include <Eigen/Geometry>
#include <image_transport/image_transport.h>
#include <ros/node_handle.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include <depth_camera_ros/image_worker.h>
#include "gpis_mapping/types.h"

namespace gpis_mapping_ros {

using depth_camera_ros::CameraPoseCounters;
using depth_camera_ros::CameraPoseParams;
using depth_camera_ros::CameraPoseSource;
using depth_camera_ros::FrameStatus;
using depth_camera_ros::Refusal;

struct DepthInputParams : CameraPoseParams {
  std::string image_transport{"raw"};
  double depth_units_per_metre{1000.0};

  static void fields(DepthInputParams& c, interactive_mapping::Fields& f) {
    CameraPoseParams::fields(c, f);
    f("image_transport", c.image_transport, "or compressedDepth, which needs no plugin");
    f("depth_units_per_metre", c.depth_units_per_metre, 1.0, 1e6, "1/m", "of images of 16 bits");
  }
};

/// A depth image that passed every check, rectified.
struct DepthInputFrame {
  gpis_mapping::DepthImage image;
  gpis_mapping::CameraModel camera;
  Eigen::Isometry3d T_map_camera{Eigen::Isometry3d::Identity()};
  ros::Time stamp;
  std::string camera_frame;
  double wait_ms{0.0};  // from arrival to the begin of its processing
};

/// What happened so far; for diagnostics.
struct DepthInputCounters {
  std::uint64_t received{0};
  std::uint64_t replaced{0};  // by a newer image while they waited
  std::array<std::uint64_t, depth_camera_ros::kNumFrameStatus> by_status{};
  std::string last_refusal;
  CameraPoseCounters pose;
  std::string warning;  // of the kind that does not stop anything
};

/// A depth image as it came.
struct WaitingDepth {
  sensor_msgs::ImageConstPtr image;
  sensor_msgs::CompressedImageConstPtr compressed;  // one of the two
  std::chrono::steady_clock::time_point arrival;

  const std_msgs::Header& header() const { return image ? image->header : compressed->header; }
};

/// The topics of a camera, by default those that launch files remap.
struct DepthTopics {
  std::string image{"depth/image_rect"};
  std::string info{"depth/camera_info"};
};

/// An image topic, and the camera info beside it, as drivers have them.
DepthTopics topicsBeside(const std::string& image_topic);

/// Depth images with camera info and tf, checked, one at a time. Subscribes an image and an info topic relative to `nh`;
/// with image_transport compressedDepth the image topic with `/compressedDepth`. The worker thread waits for an
/// image's pose, checks it and hands it to `consume`. Neither `consume` nor `refuse` is called after the destructor has
/// begun to return.
class DepthInput final : public depth_camera_ros::ImageWorker<WaitingDepth> {
 public:
  /// Called on the worker thread. Returns why the consumer did not want the frame, or a status of kAccepted.
  using Consume = std::function<Refusal(const DepthInputFrame&)>;
  /// Called on the worker thread for each image that is left out.
  using Refuse = std::function<void(const ros::Time& stamp, const Refusal&)>;

  /// `private_nh` names the transport hints' namespace. Throws std::invalid_argument for impossible parameters.
  DepthInput(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const DepthInputParams& params,
             Consume consume, Refuse refuse, const DepthTopics& topics = {});
  ~DepthInput();

  DepthInputCounters counters() const;
  void setPoseLimits(const depth_camera::PoseLimits& limits) { pose_source_.setLimits(limits); }

  const DepthInputParams& params() const { return params_; }
  std::string imageTopic() const;

 private:
  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onCompressedImage(const sensor_msgs::CompressedImageConstPtr& image);
  void process(const WaitingDepth& job) override;
  /// Everything between arrival and `consume`. Nothing, and the reason, when the image is left out.
  std::optional<DepthInputFrame> prepare(const WaitingDepth& waiting, Refusal* refusal);
  void count(const Refusal& refusal);

  const DepthInputParams params_;
  Consume consume_;
  Refuse refuse_;
  bool is_rectified_{false};
  depth_camera::DepthRectifier rectifier_;  // the worker's

  DepthInputCounters counters_;  // mutex_ guards it

  image_transport::ImageTransport transport_;
  image_transport::Subscriber image_subscriber_;
  ros::Subscriber compressed_subscriber_;  // in its place for image_transport: compressedDepth
};

}  // namespace gpis_mapping_ros

#endif  // GPIS_MAPPING_ROS_DEPTH_INPUT_H
