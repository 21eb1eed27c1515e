// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>

#include <depth_camera_ros/conversions.h>
#include <interactive_mapping_enums/self_filter_update.h>
#include <interactive_mapping_msgs/AttachedBrick.h>
#include <interactive_mapping_msgs/SelfFilterUpdate.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include "depth_self_filter/hand_history.h"
#include "depth_self_filter/joint_history.h"

namespace depth_self_filter_ros {

using interactive_mapping::SelfFilterStatus;

/// Why an image is dropped, and a sentence.
struct Drop {
  SelfFilterStatus status{SelfFilterStatus::kAccepted};
  std::string message;
};

/// What the checks that the map has, too, found.
Drop toDrop(const depth_camera_ros::Refusal& refusal);
/// kAccepted if the positions are known.
Drop toDrop(const depth_self_filter::JointHistory::Answer& answer);

/// Something attached whose pose or size can be nobody's, by `robot`, is a change that is not clear; `problem` says why.
depth_self_filter::HandHistory::Change toChange(const interactive_mapping_msgs::AttachedBrick& message,
                                                const mp700_ur5e_description::RobotModel& robot, std::string* problem);

/// 32FC1, metres, in the machine's byte order; the header is the caller's.
sensor_msgs::ImagePtr toMessage(const depth_camera::DepthImage& image);

/// Camera info for a rectified image of `camera`, made of one that `info` accompanied. K and P are the same, and D is
/// 0. There is neither ROI nor binning, nor an offset to another camera in P.
sensor_msgs::CameraInfo toOutputInfo(const sensor_msgs::CameraInfo& info, const depth_camera::CameraModel& camera);

}  // namespace depth_self_filter_ros
