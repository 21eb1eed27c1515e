// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "brick_detection/brick_pose.h"
#include "brick_detection/calibration_session.h"

namespace brick_detection_ros {

/// What the arm shows to the camera: a brick of the catalogue, or a lone tag. One of both ids is given, the other is -1.
struct CalibrationTargetParams {
  int brick_id{-1};
  int tag_id{-1};
  double edge_m{0.12};             // of the lone tag's black border
  std::string family{"tag36h11"};  // of the lone tag; bricks have theirs in the catalogue
};

struct CameraCalibratorParams {
  std::string base_frame{"base_link"};
  std::string tool_frame{"ur5e_tool0"};
  std::string parent_frame{"camera_mast"};  // the edge of the tree of frames that is measured
  std::string child_frame{"camera_link"};
  std::string camera_frame;  // optical; empty: the image's frame_id
  std::string bricks_file;   // path of bricks.yaml
  std::string output_file;   // absolute path; ~save writes it
  CalibrationTargetParams target;
  bool is_auto{false};  // key "auto": takes samples by itself
  bool use_depth{true};
  double depth_units_per_metre{1000.0};  // of 16UC1 images
  double max_depth_offset_s{0.02};       // between the stamps of a colour and a depth image that belong together
  double still_s{1.0};                   // the arm must have stood that long before the image
  double max_image_age_s{2.0};
  double tf_timeout_s{0.5};  // how long an image waits for the arm's pose, by the wall clock
  brick_detection::BrickPoseConfig pose;
  brick_detection::CalibrationSessionConfig session;

  /// Every problem as "key = value unit, must be ...".
  std::vector<std::string> validate() const;
};

/// Every key with its value, as the parameter file has it.
std::string toYaml(const CameraCalibratorParams& params);

/// The private parameters. Throws one std::invalid_argument that lists every problem: unknown keys, wrong types,
/// impossible values.
CameraCalibratorParams loadCameraCalibratorParams(const ros::NodeHandle& private_nh);

}  // namespace brick_detection_ros
