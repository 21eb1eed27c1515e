// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_ROS_COMPRESSED_DEPTH_H
#define GPIS_MAPPING_ROS_COMPRESSED_DEPTH_H

#include <optional>
#include <string>

#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include <depth_camera_ros/conversions.h>

namespace gpis_mapping_ros {

using depth_camera_ros::FrameStatus;
using depth_camera_ros::Refusal;

/// Last part of the topics on which compressed_depth_image_transport publishes.
constexpr char kCompressedDepthSuffix[] = "/compressedDepth";

/// The encoding of the image within, by the message's `format`.
std::string compressedDepthEncoding(const std::string& format);

/// The image in a message of compressed_depth_image_transport (PNG; RVL is rejected). It is 16UC1 or mono16 in the
/// publisher's units, or 32FC1 in metres, where the transport has stored inverse depth. Nothing, and the reason, for
/// another format or broken data.
std::optional<sensor_msgs::Image> decodeCompressedDepth(const sensor_msgs::CompressedImage& message, Refusal* refusal);

}  // namespace gpis_mapping_ros

#endif  // GPIS_MAPPING_ROS_COMPRESSED_DEPTH_H
