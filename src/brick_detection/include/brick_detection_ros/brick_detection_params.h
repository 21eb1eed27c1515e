// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "brick_detection/brick_detection_config.h"
#include "brick_detection_ros/image_input.h"

namespace brick_detection_ros {

/// All parameters of the node, with the only copy of the defaults. SI units.
struct BrickDetectionParams {
  std::string bricks_file;  // absolute path of a bricks.yaml
  bool continuous{true};    // false: images are looked at only while a ~detect waits
  ImageInputParams input;
  brick_detection::BrickDetectionConfig detection;

  struct Detect {
    double timeout_s{5.0};      // ROS time, of a call that names none
    double clock_stall_s{3.0};  // wall time after which a clock that stands still ends a call
  } detect;

  struct Map {
    bool use{true};            // ask it, where it is there
    double answer_age_s{5.0};  // wall time without an answer, after which the diagnostics warn
  } map;

  struct Output {
    double ellipsoid_sigmas{10.0};  // radius of the markers of uncertainty, in standard deviations
    double arrow_m{0.12};           // length of the arrows to graspable faces
  } output;

  /// Every problem as "key = value unit, must be in [lo, hi] unit".
  std::vector<std::string> validate() const;
};

/// In the layout of config/brick_detection.yaml.
std::string toYaml(const BrickDetectionParams& params);

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
BrickDetectionParams loadBrickDetectionParams(const ros::NodeHandle& private_nh);

}  // namespace brick_detection_ros
