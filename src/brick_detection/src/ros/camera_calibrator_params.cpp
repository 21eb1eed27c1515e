// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/camera_calibrator_params.h"

#include <stdexcept>

#include <gpis_mapping_ros/gpis_mapping_params.h>
#include <interactive_mapping_common_ros/params.h>

#include <interactive_mapping_common/config/range_check.h>

namespace brick_detection_ros {
namespace {

/// visit(key, value) for each key.
constexpr auto kVisitParams = [](auto& params, auto&& visit) {
  visit("base_frame", params.base_frame);
  visit("tool_frame", params.tool_frame);
  visit("parent_frame", params.parent_frame);
  visit("child_frame", params.child_frame);
  visit("camera_frame", params.camera_frame);
  visit("bricks_file", params.bricks_file);
  visit("output_file", params.output_file);
  visit("target/brick_id", params.target.brick_id);
  visit("target/tag_id", params.target.tag_id);
  visit("target/edge_m", params.target.edge_m);
  visit("target/family", params.target.family);
  visit("auto", params.is_auto);
  visit("use_depth", params.use_depth);
  visit("depth_units_per_metre", params.depth_units_per_metre);
  visit("max_depth_offset_s", params.max_depth_offset_s);
  visit("still_s", params.still_s);
  visit("max_image_age_s", params.max_image_age_s);
  visit("tf_timeout_s", params.tf_timeout_s);
  visit("samples/min_step_m", params.session.min_step_m);
  visit("samples/min_step_rad", params.session.min_step_rad);
  visit("samples/still_m", params.session.still_m);
  visit("samples/still_rad", params.session.still_rad);
  visit("pose/corner_std_px", params.pose.corner_std_px);
  visit("pose/min_side_px", params.pose.min_side_px);
  visit("pose/max_reprojection_px", params.pose.max_reprojection_px);
  visit("hand_eye/min_samples", params.session.hand_eye.min_samples);
  visit("hand_eye/min_rotation_rad", params.session.hand_eye.min_rotation_rad);
  visit("hand_eye/arm_std_m", params.session.hand_eye.arm_std_m);
  visit("hand_eye/arm_std_rad", params.session.hand_eye.arm_std_rad);
  visit("hand_eye/max_residual_m", params.session.hand_eye.max_residual_m);
  visit("hand_eye/max_residual_rad", params.session.hand_eye.max_residual_rad);
  visit("hand_eye/outlier_chi2", params.session.hand_eye.outlier_chi2);
};

}  // namespace

std::vector<std::string> CameraCalibratorParams::validate() const {
  std::vector<std::string> problems;
  interactive_mapping::RangeCheck check;
  const auto frame = [&problems](const char* key, const std::string& value) {
    if (!value.empty() && value.front() != '/') return;
    problems.push_back(std::string(key) + " = '" + value + "', must be a tf2 frame: not empty, no leading slash");
  };
  frame("base_frame", base_frame);
  frame("tool_frame", tool_frame);
  frame("parent_frame", parent_frame);
  frame("child_frame", child_frame);
  if (!camera_frame.empty()) frame("camera_frame", camera_frame);
  if (tool_frame == base_frame) {
    problems.push_back("tool_frame = '" + tool_frame + "', must be another frame than base_frame");
  }
  if (child_frame == parent_frame) {
    problems.push_back("child_frame = '" + child_frame + "', must be another frame than parent_frame");
  }
  if ((target.brick_id >= 0) == (target.tag_id >= 0)) {
    problems.push_back("target/brick_id = " + std::to_string(target.brick_id) + " and target/tag_id = " +
                       std::to_string(target.tag_id) + ", must be one id of what the arm holds, the other -1");
  }
  if (target.brick_id >= 0 && bricks_file.empty())
    problems.push_back("bricks_file = '', must be the path of bricks.yaml");
  if (!output_file.empty()) {
    try {
      gpis_mapping_ros::requireUsablePath(output_file);
    } catch (const std::invalid_argument& error) {
      problems.push_back(std::string("output_file = ") + error.what());
    }
  }
  check("target/edge_m", target.edge_m, 0.005, 2.0, "m");
  check("depth_units_per_metre", depth_units_per_metre, 1.0, 1e6, "1/m");
  check("max_depth_offset_s", max_depth_offset_s, 0.0, 1.0, "s");
  check("still_s", still_s, 0.1, 30.0, "s");
  check("max_image_age_s", max_image_age_s, 0.05, 60.0, "s");
  check("tf_timeout_s", tf_timeout_s, 0.0, 10.0, "s");
  problems.insert(problems.end(), check.problems().begin(), check.problems().end());
  for (const std::string& problem : pose.validate()) problems.push_back("pose/" + problem);
  for (const std::string& problem : session.validate()) {
    problems.push_back(problem.rfind("hand_eye/", 0) == 0 ? problem : "samples/" + problem);
  }
  return problems;
}

std::string toYaml(const CameraCalibratorParams& params) {
  return interactive_mapping_ros::paramsToYaml(params, kVisitParams);
}

CameraCalibratorParams loadCameraCalibratorParams(const ros::NodeHandle& private_nh) {
  return interactive_mapping_ros::loadParams<CameraCalibratorParams>(private_nh, kVisitParams, {"image_transport"});
}

}  // namespace brick_detection_ros
