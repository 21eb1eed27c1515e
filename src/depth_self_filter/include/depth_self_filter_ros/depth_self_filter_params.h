// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <interactive_mapping_common/config/schema.h>
#include <ros/node_handle.h>

#include "depth_self_filter/joint_history.h"
#include "depth_self_filter/robot_mask.h"

namespace depth_self_filter_ros {

/// All parameters of the node. SI units.
struct DepthSelfFilterParams {
  struct Input {
    std::string camera_frame;
    double wait_s{0.2};
    double time_offset_s{0.0};
    double max_future_s{0.5};
    double depth_units_per_metre{1000.0};
    std::string image_transport{"raw"};

    static void fields(Input& c, interactive_mapping::Fields& f) {
      f("camera_frame", c.camera_frame, "optical frame; empty: the frame_id of the image");
      f("wait_s", c.wait_s, 0.0, 10.0, "s",
        "how long an image waits for joint states, camera info and tf, by the wall clock");
      f("time_offset_s", c.time_offset_s, -1.0, 1.0, "s",
        "added to the stamp of an image before joint states and tf are looked up; as for the map");
      f("max_future_s", c.max_future_s, 0.0, 1e9, "s", "how far a stamp may lie ahead of ROS time");
      f("depth_units_per_metre", c.depth_units_per_metre, 1.0, 1e6, "1/m", "of images of 16 bits");
      f("image_transport", c.image_transport, "transport of the images");
      f.require(c.camera_frame.empty() || c.camera_frame.front() != '/',
                "camera_frame = '" + c.camera_frame + "', must be a tf2 frame: no leading slash");
      f.require(!c.image_transport.empty(), "image_transport = '', must name a transport, such as raw");
    }
  } input;
  depth_self_filter::JointHistoryConfig joints;
  depth_self_filter::RobotMaskConfig mask;

  static void fields(DepthSelfFilterParams& c, interactive_mapping::Fields& f) {
    f.section("input", c.input);
    f.section("joints", c.joints);
    f.section("mask", c.mask);
  }
};

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
DepthSelfFilterParams loadDepthSelfFilterParams(const ros::NodeHandle& private_nh);

}  // namespace depth_self_filter_ros
