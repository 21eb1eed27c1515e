// SPDX-License-Identifier: BSD-3-Clause
#include "depth_camera_ros/conversions.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <vector>

namespace depth_camera_ros {
namespace {

using depth_camera::CameraModel;
using depth_camera::DepthImage;
using depth_camera::DepthRectifier;
using depth_camera::LensDistortion;

constexpr std::size_t kMaxShownName = 40;

bool isLittleEndianMachine() {
  const std::uint16_t probe = 1;
  unsigned char first = 0;
  std::memcpy(&first, &probe, 1);
  return first == 1;
}

/// Pixel bytes in the machine's order.
template <typename T>
T pixelAt(const std::uint8_t* data, bool swap) {
  unsigned char bytes[sizeof(T)];
  std::memcpy(bytes, data, sizeof(T));
  if (swap) std::reverse(bytes, bytes + sizeof(T));
  T value;
  std::memcpy(&value, bytes, sizeof(T));
  return value;
}

/// As interactive_mapping_ros::toIsometry, with the reason as a refusal.
template <typename Message>
std::optional<Eigen::Isometry3d> makeIsometry(const Message& message, Refusal* refusal) {
  std::string reason;
  const auto T = interactive_mapping_ros::toIsometry(message, &reason);
  if (!T && refusal != nullptr) *refusal = {FrameStatus::kBadTransform, reason};
  return T;
}

}  // namespace

std::string sizeText(std::uint64_t width_px, std::uint64_t height_px) {
  return std::to_string(width_px) + " x " + std::to_string(height_px) + " px";
}

std::string shownName(const std::string& name) {
  std::string text = name.substr(0, kMaxShownName);
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < 0x20 || c > 0x7e; }, '?');
  return "'" + text + (name.size() > kMaxShownName ? "..." : "") + "'";
}

ros::Time shifted(const ros::Time& stamp, double offset_s) {
  if (offset_s == 0.0) return stamp;
  const auto latest_ns = static_cast<std::int64_t>(ros::TIME_MAX.toNSec());
  const std::int64_t at_ns = static_cast<std::int64_t>(stamp.toNSec()) + std::llround(offset_s * 1e9);
  ros::Time at;
  at.fromNSec(static_cast<std::uint64_t>(std::clamp<std::int64_t>(at_ns, 1, latest_ns)));
  return at;
}

bool isRectifiedTopic(const std::string& topic) {
  const std::size_t slash = topic.rfind('/');  // npos + 1 is 0: the whole name
  return topic.find("rect", slash + 1) != std::string::npos;
}

bool isDepthEncoding(const std::string& encoding) {
  return encoding == "16UC1" || encoding == "mono16" || encoding == "32FC1";
}

std::optional<DepthImage> toDepthImage(const sensor_msgs::Image& message, double units_per_metre, Refusal* refusal) {
  if (!isDepthEncoding(message.encoding)) {
    *refusal = {FrameStatus::kWrongEncoding,
                "encoding is " + shownName(message.encoding) + ", must be one of " + kAllowedDepthEncodings};
    return std::nullopt;
  }
  const std::size_t width = message.width;
  const std::size_t height = message.height;
  constexpr std::size_t kMaxSide = std::numeric_limits<int>::max();
  if (width == 0 || height == 0 || width > kMaxSide || height > kMaxSide) {
    *refusal = {FrameStatus::kMalformedImage, "size is " + sizeText(width, height) + ", must be at least 1 x 1 px"};
    return std::nullopt;
  }
  const bool is_float = message.encoding == "32FC1";
  const std::size_t row_bytes = width * (is_float ? sizeof(float) : sizeof(std::uint16_t));
  const std::size_t step = message.step;
  if (step < row_bytes || message.data.size() < row_bytes || (message.data.size() - row_bytes) / step < height - 1) {
    *refusal = {FrameStatus::kMalformedImage, "step " + std::to_string(step) + " and " +
                                                  std::to_string(message.data.size()) + " bytes are too few for " +
                                                  sizeText(width, height) + " of " + message.encoding};
    return std::nullopt;
  }
  const bool swap = (message.is_bigendian != 0) == isLittleEndianMachine();
  if (is_float) {
    DepthImage image{static_cast<int>(width), static_cast<int>(height), std::vector<float>(width * height)};
    for (std::size_t v = 0; v < height; ++v) {
      const std::uint8_t* row = message.data.data() + v * step;
      for (std::size_t u = 0; u < width; ++u) {
        image.depth_m[v * width + u] = pixelAt<float>(row + u * sizeof(float), swap);
      }
    }
    return image;
  }
  std::vector<std::uint16_t> raw(width * height);
  for (std::size_t v = 0; v < height; ++v) {
    const std::uint8_t* row = message.data.data() + v * step;
    for (std::size_t u = 0; u < width; ++u) {
      raw[v * width + u] = pixelAt<std::uint16_t>(row + u * sizeof(std::uint16_t), swap);
    }
  }
  return depth_camera::depthImageFromU16(raw.data(), static_cast<int>(width), static_cast<int>(height),
                                         units_per_metre);
}

std::optional<CameraModel> toCameraModel(const sensor_msgs::CameraInfo& info, bool is_rectified, Refusal* refusal) {
  const auto refuse = [refusal](const std::string& why) {
    *refusal = {FrameStatus::kBadCameraInfo, "camera info: " + why};
    return std::nullopt;
  };
  constexpr std::uint32_t kMaxSide = std::numeric_limits<int>::max();
  if (info.width > kMaxSide || info.height > kMaxSide) return refuse("size is " + sizeText(info.width, info.height));
  const bool uses_P = is_rectified && info.P[0] > 0.0;
  const CameraModel full{static_cast<int>(info.width),   static_cast<int>(info.height),
                         uses_P ? info.P[0] : info.K[0], uses_P ? info.P[5] : info.K[4],
                         uses_P ? info.P[2] : info.K[2], uses_P ? info.P[6] : info.K[5]};
  const std::vector<std::string> problems = full.validate();
  if (!problems.empty()) return refuse(problems.front());

  // Everything but binning and ROI is of the full image.
  const sensor_msgs::RegionOfInterest& roi = info.roi;
  const bool is_whole = roi.width == 0 && roi.height == 0;
  const std::uint64_t width = is_whole ? info.width : roi.width;
  const std::uint64_t height = is_whole ? info.height : roi.height;
  if (width == 0 || height == 0 || roi.x_offset + width > info.width || roi.y_offset + height > info.height) {
    return refuse("ROI is " + sizeText(width, height) + " at (" + std::to_string(roi.x_offset) + ", " +
                  std::to_string(roi.y_offset) + "), must be within the full image of " +
                  sizeText(info.width, info.height) + ", whose size width and height give");
  }
  const std::uint64_t binning_x = std::max(1U, info.binning_x);
  const std::uint64_t binning_y = std::max(1U, info.binning_y);
  const auto bx = static_cast<double>(binning_x);
  const auto by = static_cast<double>(binning_y);
  // The image's pixel u' covers the full image's pixels u' b ... u' b + b - 1 of the ROI, its centre is the mean of those.
  const CameraModel camera{
      static_cast<int>(width / binning_x),       static_cast<int>(height / binning_y),     full.fx / bx, full.fy / by,
      (full.cx - roi.x_offset + 0.5) / bx - 0.5, (full.cy - roi.y_offset + 0.5) / by - 0.5};
  const std::vector<std::string> cut_problems = camera.validate();
  if (!cut_problems.empty()) return refuse("with its ROI and binning, " + cut_problems.front());
  return camera;
}

bool toDepthRectifier(const sensor_msgs::CameraInfo& info, bool is_rectified, DepthRectifier* rectifier,
                      Refusal* refusal) {
  const std::optional<CameraModel> camera = toCameraModel(info, is_rectified, refusal);
  if (!camera) return false;
  LensDistortion distortion;
  if (!is_rectified) distortion = {info.distortion_model, info.D};
  constexpr double kJitter_px = 1e-3;  // some drivers compute K anew for each image
  const CameraModel& known = rectifier->rawCamera();
  if (distortion == rectifier->distortion() && camera->width == known.width && camera->height == known.height &&
      std::abs(camera->fx - known.fx) < kJitter_px && std::abs(camera->fy - known.fy) < kJitter_px &&
      std::abs(camera->cx - known.cx) < kJitter_px && std::abs(camera->cy - known.cy) < kJitter_px) {
    return true;
  }
  try {
    *rectifier = DepthRectifier(*camera, distortion);
  } catch (const std::invalid_argument& error) {
    *refusal = {FrameStatus::kBadCameraInfo, std::string("camera info: ") + error.what()};
    return false;
  }
  return true;
}

std::optional<Eigen::Isometry3d> toIsometry(const geometry_msgs::Transform& transform, Refusal* refusal) {
  return makeIsometry(transform, refusal);
}

std::optional<Eigen::Isometry3d> toIsometry(const geometry_msgs::Pose& pose, Refusal* refusal) {
  return makeIsometry(pose, refusal);
}

}  // namespace depth_camera_ros
