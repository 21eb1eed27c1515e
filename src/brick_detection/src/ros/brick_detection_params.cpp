// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/brick_detection_params.h"

#include <gpis_mapping_ros/param_reader.h>
#include <gpis_mapping_ros/param_writer.h>

#include "gpis_mapping/range_check.h"

namespace brick_detection_ros {
namespace {

/// visit(key, value) for each key but bricks_file.
template <typename Params, typename Visitor>
void visitParams(Params& params, Visitor&& visit) {
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
}

}  // namespace

std::vector<std::string> BrickDetectionParams::validate() const {
  std::vector<std::string> problems;
  gpis_mapping::RangeCheck check;
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
  gpis_mapping_ros::ParamWriter writer;
  const auto write = [&writer](const std::string& key, const auto& value) { writer.write(key, value); };
  write("bricks_file", params.bricks_file);
  write("input/map_frame", params.input.map_frame);
  write("input/camera_frame", params.input.camera_frame);
  write("input/tf_timeout_s", params.input.tf_timeout_s);
  write("input/max_future_s", params.input.max_future_s);
  write("input/pose_limits/max_step_m", params.input.pose_limits.max_step_m);
  write("input/pose_limits/max_step_rad", params.input.pose_limits.max_step_rad);
  write("input/pose_limits/max_speed_mps", params.input.pose_limits.max_speed_mps);
  write("input/pose_limits/max_turn_radps", params.input.pose_limits.max_turn_radps);
  write("input/pose_limits/settle_frames", params.input.pose_limits.settle_frames);
  visitParams(params, write);
  return writer.text();
}

BrickDetectionParams loadBrickDetectionParams(const ros::NodeHandle& private_nh) {
  BrickDetectionParams params;
  gpis_mapping_ros::ParamReader reader(private_nh);
  reader.read("bricks_file", &params.bricks_file);
  params.input.CameraPoseParams::read("input", &reader);
  visitParams(params, [&reader](const char* key, auto& value) { reader.read(key, &value); });
  reader.ignore("image_transport");    // read by image_transport
  reader.ignore("image");              // its publishers' settings: ~image/compressed/...
  reader.ignore("diagnostic_period");  // read by diagnostic_updater
  reader.ignore("diagnostic_updater");
  reader.report("", params.validate());
  reader.finish();
  return params;
}

}  // namespace brick_detection_ros
