// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/image_input.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <stdexcept>
#include <utility>

#include <interactive_mapping_common/formatted.h>
#include <tf2/exceptions.h>

namespace brick_detection_ros {
namespace {

using depth_camera_ros::CameraPoseSource;
using interactive_mapping::formatted;
using interactive_mapping_ros::withoutSlash;

/// More than a camera sends while a colour image waits for tf.
constexpr std::size_t kNumDepths = 30;

std::chrono::steady_clock::duration toSteady(double duration_s) {
  return std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(duration_s));
}

/// ar_track_alvar leaves the message's own header empty and fills in the markers'.
std_msgs::Header headerOf(const ar_track_alvar_msgs::AlvarMarkers& message) {
  std_msgs::Header header = message.header;
  if (!message.markers.empty()) {
    const std_msgs::Header& of_marker = message.markers.front().header;
    if (header.stamp.isZero()) header.stamp = of_marker.stamp;
    if (header.frame_id.empty()) header.frame_id = of_marker.frame_id;
  }
  return header;
}

}  // namespace

ImageInput::ImageInput(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const ImageInputParams& params,
                       Source source, Callbacks callbacks)
    : ImageWorker(nh, interactive_mapping::requireValid("impossible input parameters:", params)),
      params_(params),
      source_(source),
      callbacks_(std::move(callbacks)),
      transport_(nh) {
  const ros::TransportHints no_delay = ros::TransportHints().tcpNoDelay();
  ros::NodeHandle public_nh(nh);
  if (source_ == Source::kAlvarMarkers) {
    marker_subscriber_ = public_nh.subscribe("alvar_markers", 1, &ImageInput::onMarkers, this, no_delay);
  } else {
    subscribeInfo(nh, "color/camera_info");
    // First colour, then depth: who takes the latter for a sign of interest does not send the former to nobody.
    image_subscriber_ =
        transport_.subscribe("color/image_raw", 1, &ImageInput::onImage, this,
                             image_transport::TransportHints(params_.image_transport, no_delay, private_nh));
    if (params_.use_depth) {
      depth_subscriber_ =
          transport_.subscribe("depth/image_rect", 5, &ImageInput::onDepth, this,
                               image_transport::TransportHints(params_.depth_transport, no_delay, private_nh));
    }
    // Remappings decide what the topic is called.
    is_rectified_ = depth_camera_ros::isRectifiedTopic(nh.resolveName("color/image_raw"));
  }
}

ImageInput::~ImageInput() {
  stop();
  image_subscriber_.shutdown();
  depth_subscriber_.shutdown();
  marker_subscriber_.shutdown();
}

ImageInputCounters ImageInput::counters() const {
  ImageInputCounters counters;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    counters = counters_;
  }
  counters.pose = pose_source_.counters();
  return counters;
}

std::string ImageInput::topic() const {
  return source_ == Source::kAlvarMarkers ? marker_subscriber_.getTopic() : image_subscriber_.getTopic();
}

void ImageInput::onImage(const sensor_msgs::ImageConstPtr& image) {
  store({image, nullptr, image->header.stamp, std::chrono::steady_clock::now()});
}

void ImageInput::onMarkers(const ar_track_alvar_msgs::AlvarMarkersConstPtr& markers) {
  ros::Time stamp = headerOf(*markers).stamp;
  // Nothing seen, and no word of when: as good as now.
  if (stamp.isZero() && markers->markers.empty()) stamp = ros::Time::now();
  store({nullptr, markers, stamp, std::chrono::steady_clock::now()});
}

void ImageInput::store(const WaitingImage& waiting) {
  if (callbacks_.wants(waiting.stamp)) return put(waiting, &counters_);
  const std::lock_guard<std::mutex> lock(mutex_);
  ++counters_.received;
  ++counters_.unwanted;
}

void ImageInput::onDepth(const sensor_msgs::ImageConstPtr& depth) {
  change([&] {
    depths_.push_back(depth);
    if (depths_.size() > kNumDepths) depths_.pop_front();
  });
}

void ImageInput::process(const WaitingImage& job) {
  Refusal refusal;
  bool is_restart = false;
  std::optional<InputFrame> frame;
  try {
    frame = prepare(job, &refusal, &is_restart);
    if (isStopping()) return;
    if (frame) {
      frame->wait_ms =
          std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - job.arrival).count();
      callbacks_.consume(*frame);
    }
  } catch (const std::exception& error) {  // out of memory, say: this image is lost, the next may do
    frame.reset();
    refusal = {FrameStatus::kRefusedByMap, error.what()};
  }
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto status = depth_camera_ros::statusOf<DetectionUpdateStatus>(refusal.status);
    ++counters_.by_status[static_cast<std::size_t>(status)];
    if (!frame) {
      counters_.last_refusal = std::string(toString(status)) + ": " + refusal.message;
    } else if (frame->has_image && params_.use_depth && frame->depth_m.empty()) {
      ++counters_.without_depth;
      counters_.last_remark = frame->remark;
    }
  }
  if (!frame) callbacks_.refuse(job.stamp, refusal, is_restart);
}

std::optional<InputFrame> ImageInput::prepare(const WaitingImage& waiting, Refusal* refusal, bool* is_restart) {
  if (waiting.markers && waiting.markers->markers.empty()) {
    InputFrame frame;
    frame.stamp = waiting.stamp;
    frame.remark = "no marker in view";
    return frame;
  }
  const CameraPoseSource::StampVerdict verdict = pose_source_.checkStamp(waiting.stamp, refusal);
  *is_restart = verdict == CameraPoseSource::StampVerdict::kRestarted;
  if (*is_restart) {
    const std::lock_guard<std::mutex> lock(mutex_);
    depths_.clear();
  }
  if (verdict != CameraPoseSource::StampVerdict::kGood) return std::nullopt;
  std::optional<InputFrame> frame = waiting.image ? prepareImage(waiting, refusal) : prepareMarkers(waiting, refusal);
  if (!frame) return std::nullopt;
  frame->stamp = waiting.stamp;
  if (frame->camera_frame == params_.map_frame) {  // of markers that are given in the map's frame
    frame->T_map_camera = Eigen::Isometry3d::Identity();
    return frame;
  }
  frame->T_map_camera =
      pose_source_.poseAt(frame->camera_frame, frame->stamp, pose_source_.deadline(waiting.arrival), refusal);
  if (!frame->T_map_camera) return std::nullopt;
  return frame;
}

std::optional<InputFrame> ImageInput::prepareMarkers(const WaitingImage& waiting, Refusal* refusal) {
  InputFrame frame;
  frame.camera_frame = withoutSlash(headerOf(*waiting.markers).frame_id);
  for (const ar_track_alvar_msgs::AlvarMarker& marker : waiting.markers->markers) {
    const std::string marker_frame = withoutSlash(marker.header.frame_id);
    if (!marker_frame.empty() && marker_frame != frame.camera_frame) {
      *refusal = {FrameStatus::kMalformedImage, "markers of one message are in frames '" + frame.camera_frame +
                                                    "' and '" + marker_frame + "', must be in one"};
      return std::nullopt;
    }
    frame.markers.push_back(toMarkerObservation(marker));
  }
  if (frame.camera_frame != params_.map_frame) {
    const std::optional<std::string> camera_frame = pose_source_.cameraFrame(frame.camera_frame, refusal);
    if (!camera_frame) return std::nullopt;
    frame.camera_frame = *camera_frame;
  }
  return frame;
}

std::optional<InputFrame> ImageInput::prepareImage(const WaitingImage& waiting, Refusal* refusal) {
  const sensor_msgs::Image& message = *waiting.image;
  InputFrame frame;
  frame.has_image = true;
  const std::optional<std::string> camera_frame = pose_source_.cameraFrame(message.header.frame_id, refusal);
  if (!camera_frame) return std::nullopt;
  frame.camera_frame = *camera_frame;
  std::optional<cv::Mat> image = toColorImage(message, refusal);
  if (!image) return std::nullopt;
  frame.image = *image;
  const sensor_msgs::CameraInfoConstPtr info = waitForInfo(pose_source_.deadline(waiting.arrival), refusal);
  if (!info) return std::nullopt;
  const std::optional<brick_detection::CameraModel> camera = cameraModelOf(*info, is_rectified_, refusal);
  if (!camera) return std::nullopt;
  frame.camera = *camera;
  if (static_cast<int>(message.width) != camera->width_px || static_cast<int>(message.height) != camera->height_px) {
    const bool is_cut = info->width != static_cast<std::uint32_t>(camera->width_px) ||
                        info->height != static_cast<std::uint32_t>(camera->height_px);
    *refusal = sizeMismatch(message.width, message.height, static_cast<std::uint64_t>(camera->width_px),
                            static_cast<std::uint64_t>(camera->height_px));
    if (is_cut) refusal->message += ", by its ROI and binning of " + sizeText(info->width, info->height);
    return std::nullopt;
  }
  change([&] { counters_.warning = depth_camera_ros::frameWarning(info->header, message.header); });
  if (params_.use_depth && !addDepth(message, waiting.arrival, &frame, refusal)) return std::nullopt;
  return frame;
}

ImageInput::Depth ImageInput::waitForDepth(const ros::Time& stamp, SteadyTime deadline) {
  sensor_msgs::ImageConstPtr nearest;
  double offset_s = 0.0;
  // Depth images come in the order of their stamps: the nearest is known once one is not before the colour image.
  const auto isDecided = [&] {
    nearest.reset();
    offset_s = std::numeric_limits<double>::infinity();
    bool has_later = false;
    for (const sensor_msgs::ImageConstPtr& depth : depths_) {
      const double difference_s = std::abs(depth->header.stamp.toSec() - stamp.toSec());
      if (difference_s < offset_s) {
        nearest = depth;
        offset_s = difference_s;
      }
      // One from before a restart of time is later by far.
      has_later |= depth->header.stamp >= stamp && difference_s < 1.0;
    }
    return has_later;
  };
  std::unique_lock<std::mutex> lock(mutex_);
  waitUntil(deadline, &lock, isDecided);
  if (nearest && offset_s <= params_.max_depth_offset_s) return {nearest, ""};
  if (!nearest) return {nullptr, "no depth image on " + depth_subscriber_.getTopic()};
  return {nullptr, "no depth image within " + formatted("%.3f s", params_.max_depth_offset_s) +
                       " (max_depth_offset_s), the nearest is off by " + formatted("%.3f s", offset_s)};
}

/// Drivers name the frame of a registered depth image as they like; the camera's centre is then the colour camera's.
bool ImageInput::isOneCamera(const std::string& frame, const std::string& other_frame) const {
  constexpr double kSamePlace_m = 1e-3;  // a depth camera beside it is ten times as far away
  try {
    const auto transform = pose_source_.buffer().lookupTransform(frame, other_frame, ros::Time(0));  // fixed
    const geometry_msgs::Vector3& t = transform.transform.translation;
    return Eigen::Vector3d(t.x, t.y, t.z).norm() < kSamePlace_m;
  } catch (const tf2::TransformException&) {
    return false;
  }
}

bool ImageInput::addDepth(const sensor_msgs::Image& color, SteadyTime arrival, InputFrame* frame, Refusal* refusal) {
  const Depth depth = waitForDepth(color.header.stamp, arrival + toSteady(params_.depth_timeout_s));
  if (!depth.image) {
    frame->remark = "without depth: " + depth.why_not;
    return true;
  }
  constexpr char kAdvice[] =
      "; use the depth that the driver registers to the colour image, or set input/use_depth to false";
  if (depth.image->width != color.width || depth.image->height != color.height) {
    *refusal = {FrameStatus::kSizeMismatch, "depth image on " + depth_subscriber_.getTopic() + " is " +
                                                sizeText(depth.image->width, depth.image->height) +
                                                ", the colour image " + sizeText(color.width, color.height) + kAdvice};
    return false;
  }
  const std::string depth_frame = withoutSlash(depth.image->header.frame_id);
  const std::string color_frame = withoutSlash(color.header.frame_id);
  if (depth_frame != color_frame && !isOneCamera(depth_frame, color_frame)) {
    frame->remark = "without depth: the depth image on " + depth_subscriber_.getTopic() + " is of frame '" +
                    depth_frame + "', the colour image of '" + color_frame + "', and tf has them at different poses" +
                    kAdvice;
    return true;
  }
  Refusal why;
  const std::optional<cv::Mat> depth_m = toDepthMat(*depth.image, params_.depth_units_per_metre, &why);
  if (!depth_m) {
    frame->remark = "without depth: " + why.message;
    return true;
  }
  // Comparisons are false for NaN.
  if (cv::countNonZero((*depth_m > 0.0F) & (*depth_m < std::numeric_limits<float>::infinity())) == 0) {
    frame->remark = "without depth: no pixel of the depth image holds one";
    return true;
  }
  frame->depth_m = *depth_m;
  return true;
}

}  // namespace brick_detection_ros
