// SPDX-License-Identifier: BSD-3-Clause
#include "depth_self_filter_ros/depth_self_filter_params.h"

#include <interactive_mapping_common_ros/params.h>

#include <interactive_mapping_common/config/range_check.h>

namespace depth_self_filter_ros {
namespace {

/// visit(key, value) for each key.
constexpr auto kVisitParams = [](auto& params, auto&& visit) {
  visit("input/camera_frame", params.input.camera_frame);
  visit("input/wait_s", params.input.wait_s);
  visit("input/time_offset_s", params.input.time_offset_s);
  visit("input/max_future_s", params.input.max_future_s);
  visit("input/depth_units_per_metre", params.input.depth_units_per_metre);
  visit("input/image_transport", params.input.image_transport);
  visit("joints/max_gap_s", params.joints.max_gap_s);
  visit("joints/memory_s", params.joints.memory_s);
  visit("mask/padding_m", params.mask.padding_m);
  visit("mask/padding_rad", params.mask.padding_rad);
  visit("mask/brick_padding_m", params.mask.brick_padding_m);
  visit("mask/edge_px", params.mask.edge_px);
  visit("mask/baseline_m", params.mask.baseline_m);
  visit("mask/noise_sigmas", params.mask.noise_sigmas);
  visit("mask/noise/a_m", params.mask.noise.a_m);
  visit("mask/noise/b", params.mask.noise.b);
  visit("mask/noise/c_per_m", params.mask.noise.c_per_m);
};

}  // namespace

std::vector<std::string> DepthSelfFilterParams::validate() const {
  std::vector<std::string> problems;
  if (!input.camera_frame.empty() && input.camera_frame.front() == '/') {
    problems.push_back("input/camera_frame = '" + input.camera_frame + "', must be a tf2 frame: no leading slash");
  }
  interactive_mapping::RangeCheck check("input/");
  check("wait_s", input.wait_s, 0.0, 10.0, "s");
  check("time_offset_s", input.time_offset_s, -1.0, 1.0, "s");
  check("max_future_s", input.max_future_s, 0.0, 1e9, "s");
  check("depth_units_per_metre", input.depth_units_per_metre, 1.0, 1e6, "1/m");
  problems.insert(problems.end(), check.problems().begin(), check.problems().end());
  if (input.image_transport.empty()) {
    problems.push_back("input/image_transport = '', must name a transport, such as raw");
  }
  for (const std::string& problem : joints.validate()) problems.push_back("joints/" + problem);
  for (const std::string& problem : mask.validate()) problems.push_back("mask/" + problem);
  return problems;
}

std::string toYaml(const DepthSelfFilterParams& params) {
  return interactive_mapping_ros::paramsToYaml(params, kVisitParams);
}

DepthSelfFilterParams loadDepthSelfFilterParams(const ros::NodeHandle& private_nh) {
  // Read by image_transport, whose publishers' settings are in ~image_rect/compressedDepth/..., and diagnostic_updater.
  return interactive_mapping_ros::loadParams<DepthSelfFilterParams>(
      private_nh, kVisitParams, {"image_transport", "image_rect", "diagnostic_period", "diagnostic_updater"});
}

}  // namespace depth_self_filter_ros
