// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics_ros/system_diagnostics_params.h"

#include <sstream>

#include <interactive_mapping_common_ros/params.h>

namespace system_diagnostics_ros {
namespace {

WatchedTransform between(const std::string& target, const std::string& source) {
  WatchedTransform transform;
  transform.target = target;
  transform.source = source;
  return transform;
}

}  // namespace

SystemDiagnosticsParams::Tf::Tf() {
  WatchedTransform localisation = between("map", "odom");
  localisation.limits.max_ahead_s = 0.2;  // amcl stamps its answer into the future on purpose
  localisation.limits.step_rad = 0.03;
  WatchedTransform odometry = between("odom", "base_link");
  odometry.limits.min_rate_hz = 20.0;
  odometry.limits.max_age_s = 0.2;
  odometry.limits.max_gap_s = 0.2;
  odometry.limits.step_m = 0.02;
  odometry.limits.speed_m_s = 1.5;
  odometry.limits.step_rad = 0.02;
  odometry.limits.speed_rad_s = 2.0;
  WatchedTransform camera = between("base_link", "camera_color_optical_frame");
  camera.limits.may_be_static = true;
  camera.limits.step_m = 0.001;
  camera.limits.step_rad = 0.001;
  WatchedTransform tool = between("base_link", "magnet_tip");
  tool.limits.min_rate_hz = 20.0;
  tool.limits.max_age_s = 0.2;
  tool.limits.max_gap_s = 0.2;
  tool.limits.step_m = 0.02;
  tool.limits.speed_m_s = 4.0;  // stretched out, its shoulder at pi rad/s: 3 m/s
  tool.limits.step_rad = 0.02;
  tool.limits.speed_rad_s = 12.0;  // four joints at pi rad/s
  transforms = {{"localisation", localisation}, {"odometry", odometry}, {"camera", camera}, {"tool", tool}};
}

std::vector<std::string> SystemDiagnosticsParams::Tf::select() {
  std::istringstream words(watched);
  std::vector<std::string> names;
  std::map<std::string, WatchedTransform> selected;
  for (std::string name; words >> name;) {
    names.push_back(name);
    selected[name] = transforms[name];
  }
  transforms = selected;
  return names;
}

SystemDiagnosticsParams loadSystemDiagnosticsParams(const ros::NodeHandle& private_nh) {
  SystemDiagnosticsParams params;
  interactive_mapping_ros::ParamsReader reader(private_nh);
  SystemDiagnosticsParams::fields(params, reader.fields());
  // The shipped sections that are not watched may stay in the file.
  const SystemDiagnosticsParams::Tf shipped;
  for (const auto& [name, transform] : shipped.transforms) {
    if (params.tf.transforms.count(name) == 0) reader.fields().ignore("tf/" + name);
  }
  reader.finish(interactive_mapping::problemsOf(params));
  for (auto& [name, transform] : params.tf.transforms) transform.limits.window_s = params.window_s;
  params.arrival.window_s = params.window_s;
  return params;
}

}  // namespace system_diagnostics_ros
