// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/depth_input.h"

#include <exception>
#include <stdexcept>

#include "gpis_mapping_ros/compressed_depth.h"

namespace gpis_mapping_ros {
namespace {

using depth_camera_ros::isRectifiedTopic;
using depth_camera_ros::toDepthImage;
using depth_camera_ros::toDepthRectifier;
using gpis_mapping::CameraModel;

}  // namespace

DepthTopics topicsBeside(const std::string& image_topic) {
  const std::size_t slash = image_topic.rfind('/');
  return {image_topic, (slash == std::string::npos ? "" : image_topic.substr(0, slash + 1)) + "camera_info"};
}

DepthInput::DepthInput(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const DepthInputParams& params,
                       Consume consume, Refuse refuse, const DepthTopics& topics)
    : ImageWorker(nh, interactive_mapping::requireValid("impossible input parameters:", params)),
      params_(params),
      consume_(std::move(consume)),
      refuse_(std::move(refuse)),
      transport_(nh) {
  subscribeInfo(nh, topics.info);
  // Remappings decide what the topic is called.
  const std::string topic = nh.resolveName(topics.image);
  is_rectified_ = isRectifiedTopic(topic);
  if (params_.image_transport == kCompressedDepthSuffix + 1) {  // not every distribution has its plugin
    compressed_subscriber_ = ros::NodeHandle(nh).subscribe(
        topic + kCompressedDepthSuffix, 1, &DepthInput::onCompressedImage, this, ros::TransportHints().tcpNoDelay());
  } else {
    image_subscriber_ = transport_.subscribe(
        topics.image, 1, &DepthInput::onImage, this,
        image_transport::TransportHints(params_.image_transport, ros::TransportHints().tcpNoDelay(), private_nh));
  }
  start();
}

DepthInput::~DepthInput() {
  stop();
  image_subscriber_.shutdown();
  compressed_subscriber_.shutdown();
}

DepthInputCounters DepthInput::counters() const {
  DepthInputCounters counters;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    counters = counters_;
  }
  counters.pose = pose_source_.counters();
  return counters;
}

std::string DepthInput::imageTopic() const {
  return compressed_subscriber_ ? compressed_subscriber_.getTopic() : image_subscriber_.getTopic();
}

void DepthInput::onImage(const sensor_msgs::ImageConstPtr& image) {
  put({image, nullptr, std::chrono::steady_clock::now()}, &counters_);
}

void DepthInput::onCompressedImage(const sensor_msgs::CompressedImageConstPtr& image) {
  put({nullptr, image, std::chrono::steady_clock::now()}, &counters_);
}

void DepthInput::process(const WaitingDepth& job) {
  Refusal refusal;
  bool was_consumed = false;
  try {
    std::optional<DepthInputFrame> frame = prepare(job, &refusal);
    if (isStopping()) return;
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
  if (!was_consumed) refuse_(job.header().stamp, refusal);
}

void DepthInput::count(const Refusal& refusal) {
  const std::lock_guard<std::mutex> lock(mutex_);
  ++counters_.by_status[static_cast<std::size_t>(refusal.status)];
  if (refusal.status != FrameStatus::kAccepted) {
    counters_.last_refusal = std::string(toString(refusal.status)) + ": " + refusal.message;
  }
}

std::optional<DepthInputFrame> DepthInput::prepare(const WaitingDepth& waiting, Refusal* refusal) {
  const std_msgs::Header& header = waiting.header();
  const SteadyTime deadline = pose_source_.deadline(waiting.arrival);
  const CameraPoseSource::StampVerdict verdict = pose_source_.checkStamp(header.stamp, refusal);
  if (verdict == CameraPoseSource::StampVerdict::kRestarted) refusal->message += ", the map stays";
  if (verdict != CameraPoseSource::StampVerdict::kGood) return std::nullopt;
  const std::optional<std::string> camera_frame = pose_source_.cameraFrame(header.frame_id, refusal);
  if (!camera_frame) return std::nullopt;
  DepthInputFrame frame;
  frame.stamp = header.stamp;
  frame.camera_frame = *camera_frame;
  std::optional<sensor_msgs::Image> decoded;
  if (waiting.compressed) decoded = decodeCompressedDepth(*waiting.compressed, refusal);
  if (waiting.compressed && !decoded) return std::nullopt;
  std::optional<gpis_mapping::DepthImage> image =
      toDepthImage(decoded ? *decoded : *waiting.image, params_.depth_units_per_metre, refusal);
  if (!image) return std::nullopt;
  const sensor_msgs::CameraInfoConstPtr info = waitForInfo(deadline, refusal);
  if (!info) return std::nullopt;
  if (!toDepthRectifier(*info, is_rectified_, &rectifier_, refusal)) return std::nullopt;
  const CameraModel& raw = rectifier_.rawCamera();
  if (image->width != raw.width || image->height != raw.height) {
    *refusal = sizeMismatch(image->width, image->height, raw.width, raw.height);
    return std::nullopt;
  }
  change([&] { counters_.warning = depth_camera_ros::frameWarning(info->header, header); });
  if (!holdsMeasurement(*image)) {
    *refusal = {FrameStatus::kNothingMeasured, depth_camera::nothingMeasured(*image)};
    return std::nullopt;
  }
  const std::optional<Eigen::Isometry3d> pose = pose_source_.poseAt(frame.camera_frame, frame.stamp, deadline, refusal);
  if (!pose) return std::nullopt;
  frame.image = rectifier_.rectify(std::move(*image));
  frame.camera = rectifier_.camera();
  frame.T_map_camera = *pose;
  return frame;
}

}  // namespace gpis_mapping_ros
