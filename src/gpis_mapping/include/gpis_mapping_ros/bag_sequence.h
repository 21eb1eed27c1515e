// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_ROS_BAG_SEQUENCE_H
#define GPIS_MAPPING_ROS_BAG_SEQUENCE_H

#include <memory>
#include <string>

#include "gpis_mapping/depth_sequence.h"

namespace gpis_mapping_ros {

/// Which parts of a bag to read.
struct BagOptions {
  std::string depth_topic;         // empty: the only topic with depth images, mono16 if there is no other
  std::string info_topic;          // empty: camera_info beside the depth topic
  std::string map_frame{"map"};    // the fixed frame of the map
  double units_per_metre{1000.0};  // [1/m] of images of 16 bits; REP 118
};

/// Opens a ROS bag (compressed or not) with depth images, their sensor_msgs/CameraInfo, and the camera's pose in /tf
/// and /tf_static. Images are 16UC1, mono16 or 32FC1, raw or as compressedDepth. The first CameraInfo counts; K and P
/// of later ones may differ by 1e-3 px. Needs no roscore. Frames without a transform at their stamp, or without a
/// stamp, are skipped. Throws gpis_mapping::DepthSequenceError; the message lists the topics, encodings or frames there
/// are.
std::unique_ptr<gpis_mapping::DepthSequence> openBagSequence(const std::string& path, const BagOptions& options = {});

/// Whether `path` is a file that begins like a ROS bag.
bool looksLikeBag(const std::string& path);

}  // namespace gpis_mapping_ros

#endif  // GPIS_MAPPING_ROS_BAG_SEQUENCE_H
