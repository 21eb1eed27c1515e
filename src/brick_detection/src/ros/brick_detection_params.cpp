// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/brick_detection_params.h"

#include <interactive_mapping_common_ros/params.h>

#include <interactive_mapping_common/config/range_check.h>

namespace brick_detection_ros {
namespace {

/// visit(key, value) for each key.
constexpr auto kVisitParams = [](auto& params, auto&& visit) {
  visit("bricks_file", params.bricks_file);
  visit("input/map_frame", params.input.map_frame);
  visit("input/camera_frame", params.input.camera_frame);
  visit("input/tf_timeout_s", params.input.tf_timeout_s);
  visit("input/time_offset_s", params.input.time_offset_s);
  visit("input/max_future_s", params.input.max_future_s);
  visit("input/pose_limits/max_step_m", params.input.pose_limits.max_step_m);
  visit("input/pose_limits/max_step_rad", params.input.pose_limits.max_step_rad);
  visit("input/pose_limits/max_speed_mps", params.input.pose_limits.max_speed_mps);
  visit("input/pose_limits/max_turn_radps", params.input.pose_limits.max_turn_radps);
  visit("input/pose_limits/settle_frames", params.input.pose_limits.settle_frames);
  visit("continuous", params.continuous);
  visit("input/use_depth", params.input.use_depth);
  visit("input/max_depth_offset_s", params.input.max_depth_offset_s);
  visit("input/depth_timeout_s", params.input.depth_timeout_s);
  visit("input/depth_units_per_metre", params.input.depth_units_per_metre);
  visit("input/image_transport", params.input.image_transport);
  visit("input/depth_transport", params.input.depth_transport);
  visit("detect/timeout_s", params.detect.timeout_s);
  visit("detect/clock_stall_s", params.detect.clock_stall_s);
  visit("map/use", params.map.use);
  visit("map/answer_age_s", params.map.answer_age_s);
  visit("output/ellipsoid_sigmas", params.output.ellipsoid_sigmas);
  visit("output/arrow_m", params.output.arrow_m);
  brick_detection::visitFields(params.detection, visit);
};

}  // namespace

std::vector<std::string> BrickDetectionParams::validate() const {
  std::vector<std::string> problems;
  interactive_mapping::RangeCheck check;
  if (bricks_file.empty() || bricks_file.front() != '/') {
    problems.push_back("bricks_file = '" + bricks_file + "', must be the absolute path of a bricks.yaml");
  }
  for (const std::string& problem : input.validate()) problems.push_back("input/" + problem);
  for (const std::string& problem : detection.validate()) problems.push_back(problem);
  check("detect/timeout_s", detect.timeout_s, 0.01, 600.0, "s");
  check("detect/clock_stall_s", detect.clock_stall_s, 0.1, 600.0, "s");
  check("map/answer_age_s", map.answer_age_s, 0.1, 600.0, "s");
  check("output/ellipsoid_sigmas", output.ellipsoid_sigmas, 0.1, 1000.0, "sigma");
  check("output/arrow_m", output.arrow_m, 0.01, 1.0, "m");
  problems.insert(problems.end(), check.problems().begin(), check.problems().end());
  return problems;
}

std::string toYaml(const BrickDetectionParams& params) {
  return interactive_mapping_ros::paramsToYaml(params, kVisitParams);
}

BrickDetectionParams loadBrickDetectionParams(const ros::NodeHandle& private_nh) {
  // Read by image_transport, whose publishers' settings are in ~image/compressed/..., and diagnostic_updater.
  return interactive_mapping_ros::loadParams<BrickDetectionParams>(
      private_nh, kVisitParams, {"image_transport", "image", "diagnostic_period", "diagnostic_updater"});
}

}  // namespace brick_detection_ros
