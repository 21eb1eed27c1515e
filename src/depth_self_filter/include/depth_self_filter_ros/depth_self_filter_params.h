// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "depth_self_filter/joint_history.h"
#include "depth_self_filter/robot_mask.h"

namespace depth_self_filter_ros {

/// All parameters of the node, with the only copy of the defaults. SI units.
struct DepthSelfFilterParams {
  struct Input {
    std::string camera_frame;              // optical frame; empty: the image's frame_id
    double wait_s{0.2};                    // how long an image waits for what belongs to it, wall clock
    double time_offset_s{0.0};             // added to an image's stamp before joint states and tf are looked up
    double max_future_s{0.5};              // how far a stamp may lie ahead of ROS time
    double depth_units_per_metre{1000.0};  // of 16UC1 images
    std::string image_transport{"raw"};
  } input;
  depth_self_filter::JointHistoryConfig joints;
  depth_self_filter::RobotMaskConfig mask;

  /// Every problem as "key = value unit, must be in [lo, hi] unit".
  std::vector<std::string> validate() const;
};

/// In the layout of config/depth_self_filter.yaml.
std::string toYaml(const DepthSelfFilterParams& params);

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
DepthSelfFilterParams loadDepthSelfFilterParams(const ros::NodeHandle& private_nh);

}  // namespace depth_self_filter_ros
