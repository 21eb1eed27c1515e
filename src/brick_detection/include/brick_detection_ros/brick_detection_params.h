// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <interactive_mapping_common/config/schema.h>
#include <ros/node_handle.h>

#include "brick_detection/brick_detection_config.h"
#include "brick_detection_ros/detect_server.h"
#include "brick_detection_ros/image_input.h"

namespace brick_detection_ros {

/// All parameters of the node. SI units.
struct BrickDetectionParams {
  std::string bricks_file;
  bool continuous{true};
  ImageInputParams input;
  brick_detection::BrickDetectionConfig detection;

  DetectParams detect;

  struct Map {
    bool use{true};
    double answer_age_s{5.0};

    static void fields(Map& c, interactive_mapping::Fields& f) {
      f("use", c.use, "asks the map, where there is one");
      f("answer_age_s", c.answer_age_s, 0.1, 600.0, "s",
        "the diagnostics warn when the map has not answered for longer, wall time");
    }
  } map;

  static void fields(BrickDetectionParams& c, interactive_mapping::Fields& f) {
    f("bricks_file", c.bricks_file, "absolute path of a bricks.yaml; the launch file gives it");
    f("continuous", c.continuous, "false: images are processed only while a call of ~detect waits");
    f.section("input", c.input);
    brick_detection::BrickDetectionConfig::fields(c.detection, f);
    f.section("detect", c.detect);
    f.section("map", c.map);
    f.require(!c.bricks_file.empty() && c.bricks_file.front() == '/',
              "bricks_file = '" + c.bricks_file + "', must be the absolute path of a bricks.yaml");
  }
};

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
BrickDetectionParams loadBrickDetectionParams(const ros::NodeHandle& private_nh);

}  // namespace brick_detection_ros
