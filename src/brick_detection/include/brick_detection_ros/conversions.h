// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <ar_track_alvar_msgs/AlvarMarkers.h>
#include <depth_camera_ros/conversions.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_enums/brick_detection_update.h>
#include <interactive_mapping_msgs/Brick.h>
#include <interactive_mapping_msgs/BrickDetectionUpdate.h>
#include <interactive_mapping_msgs/TagSighting.h>
#include <opencv2/core.hpp>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include "brick_detection/brick_detector.h"

namespace brick_detection_ros {

using depth_camera_ros::FrameStatus;
using depth_camera_ros::Refusal;
using depth_camera_ros::sizeText;
using interactive_mapping::DetectionUpdateStatus;

/// CV_8UC3 (blue, green, red) from rgb8, bgr8, rgba8, bgra8 and Bayer patterns, CV_8UC1 from mono8. A copy. Nothing, and
/// the reason, for another encoding and when step, size and data do not fit together.
std::optional<cv::Mat> toColorImage(const sensor_msgs::Image& message, Refusal* refusal);

/// CV_32FC1 [m] as depth_camera_ros::toDepthImage() has it.
std::optional<cv::Mat> toDepthMat(const sensor_msgs::Image& message, double units_per_metre, Refusal* refusal);

/// Of the colour image that `info` goes with, which binning and ROI may have made smaller than its full size. Rectified: P
/// without distortion; else K with D by distortion_model: "" and an empty D, plumb_bob, rational_polynomial, equidistant
/// or fisheye, which are one. Nothing, and the reason, for anything else.
std::optional<brick_detection::CameraModel> cameraModelOf(const sensor_msgs::CameraInfo& info, bool is_rectified,
                                                          Refusal* refusal);

/// Not checked but for the rotation, which is NaN unless it is one: see brick_detection::sightingsOfMarkers().
brick_detection::MarkerObservation toMarkerObservation(const ar_track_alvar_msgs::AlvarMarker& marker);

using interactive_mapping_ros::toPose;
interactive_mapping_msgs::TagSighting toMessage(const brick_detection::TagSighting& sighting);
interactive_mapping_msgs::Brick toMessage(const brick_detection::TrackedBrick& brick,
                                          const mp700_ur5e_description::BrickType& type,
                                          const std::vector<brick_detection::FaceAccess>& faces);

}  // namespace brick_detection_ros
