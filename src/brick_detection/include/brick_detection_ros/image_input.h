// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <ar_track_alvar_msgs/AlvarMarkers.h>
#include <depth_camera_ros/image_worker.h>
#include <image_transport/image_transport.h>
#include <interactive_mapping_common/config/schema.h>
#include <opencv2/core.hpp>
#include <ros/node_handle.h>
#include <sensor_msgs/Image.h>

#include "brick_detection/camera_model.h"
#include "brick_detection/marker_sightings.h"
#include "brick_detection_ros/conversions.h"

namespace brick_detection_ros {

struct ImageInputParams : depth_camera_ros::CameraPoseParams {
  bool use_depth{true};
  double max_depth_offset_s{0.02};
  double depth_timeout_s{0.15};
  double depth_units_per_metre{1000.0};
  std::string image_transport{"raw"};
  std::string depth_transport{"raw"};

  static void fields(ImageInputParams& c, interactive_mapping::Fields& f) {
    CameraPoseParams::fields(c, f);
    f("use_depth", c.use_depth, "false: no depth image is subscribed to");
    f("max_depth_offset_s", c.max_depth_offset_s, 0.0, 1.0, "s",
      "between the stamps of a colour and a depth image that belong together");
    f("depth_timeout_s", c.depth_timeout_s, 0.0, 10.0, "s",
      "how long a colour image waits for its depth before it goes without, by the wall clock");
    f("depth_units_per_metre", c.depth_units_per_metre, 1.0, 1e6, "1/m", "of depth images of 16 bits");
    f("image_transport", c.image_transport, "transport of the colour images");
    f("depth_transport", c.depth_transport, "transport of the depth images");
    f.require(!c.image_transport.empty(), "image_transport = '', must name a transport, such as raw");
    f.require(!c.depth_transport.empty(), "depth_transport = '', must name a transport, such as raw");
  }
};

/// A look that passed every check: an image with what belongs to it, or markers that another program has found.
struct InputFrame {
  bool has_image{false};
  cv::Mat image;    // CV_8UC1 or CV_8UC3 (blue, green, red)
  cv::Mat depth_m;  // CV_32FC1 of the image's size, or empty
  brick_detection::CameraModel camera;

  std::vector<brick_detection::MarkerObservation> markers;

  /// Nothing for a message without any marker, which does not say where it was taken.
  std::optional<Eigen::Isometry3d> T_map_camera;
  ros::Time stamp;
  std::string camera_frame;
  std::string remark;   // what was done without
  double wait_ms{0.0};  // from arrival to the begin of its work
};

/// What happened so far; for diagnostics.
struct ImageInputCounters {
  static constexpr std::size_t kNumStatus = interactive_mapping_msgs::BrickDetectionUpdate::NUM_STATUS;

  std::uint64_t received{0};
  std::uint64_t replaced{0};       // by a newer image while they waited
  std::uint64_t unwanted{0};       // nobody had asked for a look
  std::uint64_t without_depth{0};  // of those accepted
  std::array<std::uint64_t, kNumStatus> by_status{};
  std::string last_refusal;
  std::string last_remark;
  std::string warning;  // of the kind that does not stop anything
  depth_camera_ros::CameraPoseCounters pose;
};

/// An image, or else markers, as they came.
struct WaitingImage {
  sensor_msgs::ImageConstPtr image;
  ar_track_alvar_msgs::AlvarMarkersConstPtr markers;
  ros::Time stamp;
  std::chrono::steady_clock::time_point arrival;
};

/// Colour images with camera info, depth and tf, checked, one at a time; or markers of ar_track_alvar. Subscribes
/// `color/image_raw`, `color/camera_info` and `depth/image_rect`, or else `alvar_markers`, relative to `nh`. The worker
/// thread waits for what belongs to an image, checks it and hands it to `consume`. None of the functions given is called
/// after the destructor has begun to return.
class ImageInput final : public depth_camera_ros::ImageWorker<WaitingImage> {
 public:
  enum class Source { kImages, kAlvarMarkers };

  struct Callbacks {
    /// Whether an image of this stamp is to be looked at; called when it arrives, on the subscription's thread.
    std::function<bool(const ros::Time& stamp)> wants;
    /// On the worker thread.
    std::function<void(const InputFrame& frame)> consume;
    /// On the worker thread, for each image that is left out. `is_restart`: time ran back, what was known is of a time
    /// that is yet to come.
    std::function<void(const ros::Time& stamp, const Refusal& refusal, bool is_restart)> refuse;
  };

  /// Subscribes. `private_nh` names the transport hints' namespace. Throws std::invalid_argument for impossible
  /// parameters.
  ImageInput(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const ImageInputParams& params,
             Source source, Callbacks callbacks);
  ~ImageInput();

  /// Begins to work on what has come and comes.
  using ImageWorker::start;

  ImageInputCounters counters() const;
  /// Of images or markers.
  std::string topic() const;
  std::string depthTopic() const { return depth_subscriber_.getTopic(); }

 private:
  struct Depth {
    sensor_msgs::ImageConstPtr image;  // the one that belongs to a colour image, or none
    std::string why_not;
  };

  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onDepth(const sensor_msgs::ImageConstPtr& depth);
  void onMarkers(const ar_track_alvar_msgs::AlvarMarkersConstPtr& markers);
  void store(const WaitingImage& waiting);
  void process(const WaitingImage& job) override;
  /// Everything between arrival and `consume`. Nothing, and the reason, when it is left out.
  std::optional<InputFrame> prepare(const WaitingImage& waiting, Refusal* refusal, bool* is_restart);
  std::optional<InputFrame> prepareImage(const WaitingImage& waiting, Refusal* refusal);
  std::optional<InputFrame> prepareMarkers(const WaitingImage& waiting, Refusal* refusal);
  Depth waitForDepth(const ros::Time& stamp, SteadyTime deadline);
  bool isOneCamera(const std::string& frame, const std::string& other_frame) const;
  /// False, and the reason, when the depth image says that something is set up wrongly.
  bool addDepth(const sensor_msgs::Image& color, SteadyTime arrival, InputFrame* frame, Refusal* refusal);

  const ImageInputParams params_;
  const Source source_;
  const Callbacks callbacks_;
  bool is_rectified_{false};

  // mutex_ guards these two.
  std::deque<sensor_msgs::ImageConstPtr> depths_;  // the last few, as they came
  ImageInputCounters counters_;

  image_transport::ImageTransport transport_;
  image_transport::Subscriber image_subscriber_, depth_subscriber_;
  ros::Subscriber marker_subscriber_;
};

}  // namespace brick_detection_ros
