// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include <Eigen/Geometry>
#include <geometry_msgs/Pose.h>
#include <geometry_msgs/Transform.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_enums/map_update.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include "depth_camera/depth_image.h"
#include "depth_camera/depth_rectifier.h"

namespace depth_camera_ros {

using interactive_mapping::FrameStatus;
using interactive_mapping::kNumFrameStatus;

/// Why an image was left out: what was seen, and what is allowed.
struct Refusal {
  FrameStatus status{FrameStatus::kAccepted};
  std::string message;
};

/// The status of the same name in another node's messages; kFailed for those that only the map's have.
template <typename Status>
Status statusOf(FrameStatus status) {
  switch (status) {
    case FrameStatus::kAccepted:
      return Status::kAccepted;
    case FrameStatus::kWrongEncoding:
      return Status::kWrongEncoding;
    case FrameStatus::kMalformedImage:
      return Status::kMalformedImage;
    case FrameStatus::kSizeMismatch:
      return Status::kSizeMismatch;
    case FrameStatus::kBadCameraInfo:
      return Status::kBadCameraInfo;
    case FrameStatus::kNoCameraInfo:
      return Status::kNoCameraInfo;
    case FrameStatus::kNoTransform:
      return Status::kNoTransform;
    case FrameStatus::kBadTransform:
      return Status::kBadTransform;
    case FrameStatus::kPoseJump:
      return Status::kPoseJump;
    case FrameStatus::kTimeRanBack:
      return Status::kTimeRanBack;
    case FrameStatus::kStampInFuture:
      return Status::kStampInFuture;
    case FrameStatus::kNothingMeasured:
    case FrameStatus::kRefusedByMap:
      break;
  }
  return Status::kFailed;
}

/// "800 x 600 px".
std::string sizeText(std::uint64_t width_px, std::uint64_t height_px);

/// A name from outside in quotes, fit to print: at most 40 characters, '?' for what is not printable.
std::string shownName(const std::string& name);

/// `stamp` + `offset_s`, but never 0, which is "newest" to tf2, nor beyond what a stamp can hold.
ros::Time shifted(const ros::Time& stamp, double offset_s);

/// REP-104: the projection matrix P belongs to topics with rectified images (".../image_rect"), K to raw ones.
bool isRectifiedTopic(const std::string& topic);

constexpr char kAllowedDepthEncodings[] = "16UC1 or mono16 (mm), 32FC1 (m)";
bool isDepthEncoding(const std::string& encoding);

/// Converts 16UC1 and mono16 (`units_per_metre` for 1 m, 0: a hole) and 32FC1 (metres, REP-117) of either byte order. Nothing, and
/// the reason, when encoding, step, size and data do not fit together. Never throws but for lack of memory, which it
/// asks for only after the message has proved to hold that many pixels.
std::optional<depth_camera::DepthImage> toDepthImage(const sensor_msgs::Image& message, double units_per_metre,
                                                     Refusal* refusal);

/// Pinhole model of the image that `info` accompanies, its lens distortion left out. It is P of a rectified image, K of
/// another, for the part of the full image that ROI and binning leave. Nothing, and the reason, when it cannot be one.
std::optional<depth_camera::CameraModel> toCameraModel(const sensor_msgs::CameraInfo& info, bool is_rectified,
                                                       Refusal* refusal);

/// Makes `rectifier` the one of the images that `info` accompanies, unless it is already. A rectified image is taken as it
/// is. False, and the reason, when the camera or its distortion cannot be used; `rectifier` stays as it was.
bool toDepthRectifier(const sensor_msgs::CameraInfo& info, bool is_rectified, depth_camera::DepthRectifier* rectifier,
                      Refusal* refusal);

/// As interactive_mapping_ros::toIsometry, with the reason as a refusal.
std::optional<Eigen::Isometry3d> toIsometry(const geometry_msgs::Transform& transform, Refusal* refusal = nullptr);
std::optional<Eigen::Isometry3d> toIsometry(const geometry_msgs::Pose& pose, Refusal* refusal = nullptr);

}  // namespace depth_camera_ros
