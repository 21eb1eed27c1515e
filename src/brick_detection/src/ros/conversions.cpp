// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/conversions.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>

namespace brick_detection_ros {
namespace {

using brick_detection::CameraModel;
using brick_detection::Distortion;
using depth_camera_ros::shownName;
namespace enc = sensor_msgs::image_encodings;

constexpr char kAllowedEncodings[] = "rgb8, bgr8, rgba8, bgra8, mono8, bayer_*8";
/// Bytes of a pixel; 0: not for colour images.
std::size_t bytesPerPixel(const std::string& encoding) {
  if (encoding == enc::RGB8 || encoding == enc::BGR8) return 3;
  if (encoding == enc::RGBA8 || encoding == enc::BGRA8) return 4;
  if (encoding == enc::MONO8 || encoding == enc::BAYER_RGGB8 || encoding == enc::BAYER_BGGR8 ||
      encoding == enc::BAYER_GBRG8 || encoding == enc::BAYER_GRBG8) {
    return 1;
  }
  return 0;
}

}  // namespace

std::optional<cv::Mat> toColorImage(const sensor_msgs::Image& message, Refusal* refusal) {
  const std::size_t pixel_bytes = bytesPerPixel(message.encoding);
  if (pixel_bytes == 0) {
    *refusal = {FrameStatus::kWrongEncoding,
                "encoding is " + shownName(message.encoding) + ", must be one of " + kAllowedEncodings};
    return std::nullopt;
  }
  // cv_bridge multiplies sizes before it compares: what it is given has been checked.
  const std::size_t width = message.width;
  const std::size_t height = message.height;
  constexpr std::size_t kMaxSide_px = std::numeric_limits<std::int16_t>::max();
  if (width == 0 || height == 0 || width > kMaxSide_px || height > kMaxSide_px) {
    *refusal = {FrameStatus::kMalformedImage, "size is " + sizeText(width, height) + ", must be between 1 and " +
                                                  std::to_string(kMaxSide_px) + " px on each side"};
    return std::nullopt;
  }
  const std::size_t step = message.step;
  if (step < width * pixel_bytes || message.data.size() < step * (height - 1) + width * pixel_bytes) {
    *refusal = {FrameStatus::kMalformedImage, "step " + std::to_string(step) + " and " +
                                                  std::to_string(message.data.size()) + " bytes are too few for " +
                                                  sizeText(width, height) + " of " + message.encoding};
    return std::nullopt;
  }
  try {
    const std::string target = message.encoding == enc::MONO8 ? enc::MONO8 : enc::BGR8;
    if (message.data.size() == step * height) return cv_bridge::toCvCopy(message, target)->image;
    sensor_msgs::Image whole = message;  // cv_bridge wants whole rows, also the last one
    whole.data.resize(step * height);
    return cv_bridge::toCvCopy(whole, target)->image;
  } catch (const std::exception& error) {  // of cv_bridge and OpenCV
    *refusal = {FrameStatus::kMalformedImage, error.what()};
    return std::nullopt;
  }
}

std::optional<cv::Mat> toDepthMat(const sensor_msgs::Image& message, double units_per_metre, Refusal* refusal) {
  std::optional<depth_camera::DepthImage> depth = depth_camera_ros::toDepthImage(message, units_per_metre, refusal);
  if (!depth) return std::nullopt;
  return cv::Mat(depth->height, depth->width, CV_32FC1, depth->depth_m.data()).clone();
}

std::optional<CameraModel> cameraModelOf(const sensor_msgs::CameraInfo& info, bool is_rectified, Refusal* refusal) {
  const auto refuse = [refusal](const std::string& why) {
    *refusal = {FrameStatus::kBadCameraInfo, "camera info: " + why};
    return std::nullopt;
  };
  constexpr std::uint32_t kMaxSide_px = std::numeric_limits<std::int16_t>::max();
  if (info.width > kMaxSide_px || info.height > kMaxSide_px)
    return refuse("size is " + sizeText(info.width, info.height));
  const std::optional<depth_camera::CameraModel> pinhole = depth_camera_ros::toCameraModel(info, is_rectified, refusal);
  if (!pinhole) return std::nullopt;
  CameraModel camera;
  camera.width_px = pinhole->width;
  camera.height_px = pinhole->height;
  camera.fx_px = pinhole->fx;
  camera.fy_px = pinhole->fy;
  camera.cx_px = pinhole->cx;
  camera.cy_px = pinhole->cy;
  if (!is_rectified) {
    const std::optional<Distortion> distortion = depth_camera::distortionNamed(info.distortion_model);
    if (!distortion) {
      return refuse("distortion_model is " + shownName(info.distortion_model) +
                    ", must be plumb_bob, rational_polynomial, equidistant (or fisheye), or empty");
    }
    if (*distortion == Distortion::kNone && !info.D.empty()) {
      return refuse("distortion_model is empty, but D has " + std::to_string(info.D.size()) + " coefficients");
    }
    // A driver without distortion names a model all the same, and may leave D empty.
    const bool is_distorted = std::any_of(info.D.begin(), info.D.end(), [](double d) { return d != 0.0; });  // NaN, too
    camera.distortion = is_distorted ? *distortion : Distortion::kNone;
    if (is_distorted) camera.coefficients = info.D;
  }
  const std::vector<std::string> problems = camera.validate();
  if (!problems.empty()) return refuse(problems.front());
  return camera;
}

brick_detection::MarkerObservation toMarkerObservation(const ar_track_alvar_msgs::AlvarMarker& marker) {
  const geometry_msgs::Pose& pose = marker.pose.pose;
  brick_detection::MarkerObservation observation;
  observation.id = static_cast<int>(std::min<std::uint32_t>(marker.id, std::numeric_limits<int>::max()));
  const Eigen::Quaterniond q(pose.orientation.w, pose.orientation.x, pose.orientation.y, pose.orientation.z);
  // A quaternion of zeros would make the identity.
  observation.T_camera_tag.linear() = std::abs(q.norm() - 1.0) < 0.01
                                          ? q.normalized().toRotationMatrix()
                                          : Eigen::Matrix3d::Constant(std::numeric_limits<double>::quiet_NaN());
  observation.T_camera_tag.translation() << pose.position.x, pose.position.y, pose.position.z;
  return observation;
}

interactive_mapping_msgs::TagSighting toMessage(const brick_detection::TagSighting& sighting) {
  interactive_mapping_msgs::TagSighting message;
  message.status = static_cast<std::uint8_t>(sighting.status);
  message.id = sighting.tag.id;
  message.brick_id = sighting.brick_id;
  message.face = static_cast<std::uint8_t>(sighting.face);
  message.hamming = static_cast<std::uint8_t>(sighting.tag.hamming);
  message.margin = static_cast<float>(sighting.tag.margin);
  for (std::size_t i = 0; i < sighting.tag.corners_px.size(); ++i) {
    message.corners_px[2 * i] = static_cast<float>(sighting.tag.corners_px[i].x());
    message.corners_px[2 * i + 1] = static_cast<float>(sighting.tag.corners_px[i].y());
  }
  return message;
}

interactive_mapping_msgs::Brick toMessage(const brick_detection::TrackedBrick& brick,
                                          const mp700_ur5e_description::BrickType& type,
                                          const std::vector<brick_detection::FaceAccess>& faces) {
  interactive_mapping_msgs::Brick message;
  message.id = brick.id;
  message.instance = static_cast<std::uint32_t>(brick.instance);
  message.has_duplicate = brick.has_duplicate ? 1 : 0;
  message.type = type.name;
  message.size.x = type.size_m.x();
  message.size.y = type.size_m.y();
  message.size.z = type.size_m.z();
  message.pose.pose = toPose(brick.T_map_brick);
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) {
      message.pose.covariance[static_cast<std::size_t>(6 * row + column)] = brick.covariance(row, column);
    }
  }
  message.num_looks = static_cast<std::uint32_t>(brick.num_looks);
  message.first_seen = ros::Time(brick.first_seen_s);
  message.last_seen = ros::Time(brick.last_seen_s);
  for (std::size_t i = 0; i < brick.faces_seen.size(); ++i) {
    if (brick.faces_seen[i]) message.faces_seen.push_back(static_cast<std::uint8_t>(i));
  }
  for (const brick_detection::FaceAccess& access : faces) {
    interactive_mapping_msgs::BrickFace face;
    face.face = static_cast<std::uint8_t>(access.face);
    face.pose = toPose(access.T_map_plate);
    face.accessibility = static_cast<float>(access.accessibility);
    face.free_share = static_cast<float>(access.free_share);
    face.unknown_share = static_cast<float>(access.unknown_share);
    message.graspable_faces.push_back(face);
  }
  return message;
}

}  // namespace brick_detection_ros
