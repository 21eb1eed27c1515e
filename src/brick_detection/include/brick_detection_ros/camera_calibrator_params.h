// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <string>

#include <interactive_mapping_common/config/schema.h>
#include <ros/node_handle.h>

#include "brick_detection/brick_pose.h"
#include "brick_detection/calibration_session.h"

namespace brick_detection_ros {

/// What the arm shows to the camera: a brick of the catalogue, or a lone tag. One of both ids is given, the other is -1.
struct CalibrationTargetParams {
  int brick_id{-1};
  int tag_id{-1};
  double edge_m{0.12};
  std::string family{"tag36h11"};

  static void fields(CalibrationTargetParams& c, interactive_mapping::Fields& f) {
    constexpr int kMax = std::numeric_limits<int>::max();
    f("brick_id", c.brick_id, -1, kMax, "", "brick of bricks_file that the arm holds; -1: a lone tag");
    f("tag_id", c.tag_id, -1, kMax, "", "lone tag that the arm holds; -1: a brick");
    f("edge_m", c.edge_m, 0.005, 2.0, "m", "edge of the black border of the lone tag");
    f("family", c.family, "family of the lone tag");
    f.require((c.brick_id >= 0) != (c.tag_id >= 0), "brick_id = " + std::to_string(c.brick_id) +
                                                        " and target/tag_id = " + std::to_string(c.tag_id) +
                                                        ", must be one id of what the arm holds, the other -1");
  }
};

struct CameraCalibratorParams {
  std::string base_frame{"base_link"};
  std::string tool_frame{"ur5e_tool0"};
  std::string parent_frame{"camera_mast"};
  std::string child_frame{"camera_link"};
  std::string camera_frame;
  std::string bricks_file;
  std::string output_file;
  CalibrationTargetParams target;
  bool is_auto{false};
  bool use_depth{true};
  double depth_units_per_metre{1000.0};
  double max_depth_offset_s{0.02};
  double still_s{1.0};
  double max_image_age_s{2.0};
  double tf_timeout_s{0.5};
  brick_detection::BrickPoseConfig pose;
  brick_detection::CalibrationSessionConfig session;

  /// What a lone tag needs of it.
  struct Pose {
    brick_detection::BrickPoseConfig& pose;
    static void fields(Pose& c, interactive_mapping::Fields& f) {
      brick_detection::BrickPoseConfig::cornerFields(c.pose, f);
    }
  };

  static void fields(CameraCalibratorParams& c, interactive_mapping::Fields& f) {
    f("base_frame", c.base_frame, "frame of the base");
    f("tool_frame", c.tool_frame, "frame of the arm that holds the target");
    f("parent_frame", c.parent_frame,
      "the edge from this frame to child_frame, a fixed joint of the URDF, is measured");
    f("child_frame", c.child_frame, "see parent_frame");
    f("camera_frame", c.camera_frame, "optical frame; empty: the frame_id of the image");
    f("bricks_file", c.bricks_file, "path of a bricks.yaml; needed for a brick");
    f("output_file", c.output_file, "absolute path of the file that ~save writes");
    f("auto", c.is_auto, "takes a sample wherever the arm is stationary");
    f("use_depth", c.use_depth, "distinguishes the two poses that a flat tag can have; false: no depth image is used");
    f("depth_units_per_metre", c.depth_units_per_metre, 1.0, 1e6, "1/m", "of depth images of 16 bits");
    f("max_depth_offset_s", c.max_depth_offset_s, 0.0, 1.0, "s",
      "between the stamps of a colour and a depth image that belong together");
    f("still_s", c.still_s, 0.1, 30.0, "s", "how long the arm must have been at rest before the image");
    f("max_image_age_s", c.max_image_age_s, 0.05, 60.0, "s", "an older image gives no sample");
    f("tf_timeout_s", c.tf_timeout_s, 0.0, 10.0, "s",
      "how long an image waits for the pose of the arm, by the wall clock");
    f.section("target", c.target);
    Pose pose{c.pose};
    f.section("pose", pose);
    brick_detection::CalibrationSessionConfig::fields(c.session, f);
    const auto require_frame = [&f](const char* key, const std::string& frame) {
      f.require(!frame.empty() && frame.front() != '/',
                std::string(key) + " = '" + frame + "', must be a tf2 frame: not empty, no leading slash");
    };
    require_frame("base_frame", c.base_frame);
    require_frame("tool_frame", c.tool_frame);
    require_frame("parent_frame", c.parent_frame);
    require_frame("child_frame", c.child_frame);
    if (!c.camera_frame.empty()) require_frame("camera_frame", c.camera_frame);
    f.require(c.tool_frame != c.base_frame,
              "tool_frame = '" + c.tool_frame + "', must be another frame than base_frame");
    f.require(c.child_frame != c.parent_frame,
              "child_frame = '" + c.child_frame + "', must be another frame than parent_frame");
    f.require(c.target.brick_id < 0 || !c.bricks_file.empty(), "bricks_file = '', must be the path of bricks.yaml");
  }
};

/// The private parameters. Throws one std::invalid_argument that lists every problem: unknown keys, wrong types,
/// impossible values.
CameraCalibratorParams loadCameraCalibratorParams(const ros::NodeHandle& private_nh);

}  // namespace brick_detection_ros
