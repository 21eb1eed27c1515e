// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics_ros/system_diagnostics_params.h"

#include <set>
#include <sstream>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common_ros/param_reader.h>
#include <interactive_mapping_common_ros/param_writer.h>

namespace system_diagnostics_ros {
namespace {

using system_diagnostics::TransformWatchConfig;

std::vector<std::string> namesIn(const std::string& words) {
  std::istringstream stream(words);
  std::vector<std::string> names;
  for (std::string name; stream >> name;) names.push_back(name);
  return names;
}

WatchedTransform between(const std::string& target, const std::string& source) {
  WatchedTransform transform;
  transform.target = target;
  transform.source = source;
  return transform;
}

/// visit(key, value) for each key of a transform.
template <typename Transform, typename Visitor>
void visitTransform(const std::string& name, Transform& transform, Visitor&& visit) {
  const std::string section = "tf/" + name + "/";
  visit(section + "target", transform.target);
  visit(section + "source", transform.source);
  visit(section + "may_be_static", transform.limits.may_be_static);
  visit(section + "min_rate_hz", transform.limits.min_rate_hz);
  visit(section + "max_age_s", transform.limits.max_age_s);
  visit(section + "max_ahead_s", transform.limits.max_ahead_s);
  visit(section + "max_gap_s", transform.limits.max_gap_s);
  visit(section + "step_m", transform.limits.step_m);
  visit(section + "speed_m_s", transform.limits.speed_m_s);
  visit(section + "step_rad", transform.limits.step_rad);
  visit(section + "speed_rad_s", transform.limits.speed_rad_s);
}

/// visit(key, value) for each key beside the transforms'.
template <typename Params, typename Visitor>
void visitOthers(Params& params, Visitor&& visit) {
  visit("arrival/warn_ahead_s", params.arrival.warn_ahead_s);
  visit("arrival/error_ahead_s", params.arrival.error_ahead_s);
  visit("arrival/max_delay_s", params.arrival.max_delay_s);
  visit("arrival/timeout_s", params.arrival.timeout_s);
  visit("motion/enabled", params.motion.enabled);
  visit("motion/warn_offset_s", params.motion.warn_offset_s);
  visit("motion/error_offset_s", params.motion.error_offset_s);
  visit("motion/window_s", params.motion.estimator.window_s);
  visit("motion/max_offset_s", params.motion.estimator.max_offset_s);
  visit("motion/min_turn_rad", params.motion.estimator.min_turn_rad);
  visit("motion/min_images", params.motion.estimator.min_images);
  visit("motion/min_correlation", params.motion.estimator.min_correlation);
  visit("motion/max_std_s", params.motion.estimator.max_std_s);
  visit("motion/max_odometry_gap_s", params.motion.estimator.max_odometry_gap_s);
  visit("motion/max_image_gap_s", params.motion.estimator.max_image_gap_s);
  visit("motion/image_width_px", params.motion.image.width_px);
  visit("motion/min_response", params.motion.image.min_response);
  visit("motion/min_contrast_grey", params.motion.image.min_contrast_grey);
}

}  // namespace

SystemDiagnosticsParams::SystemDiagnosticsParams() {
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

std::vector<std::string> SystemDiagnosticsParams::validate() const {
  std::vector<std::string> problems;
  const auto append = [&problems](const std::string& section, const std::vector<std::string>& more) {
    for (const std::string& problem : more) problems.push_back(section + problem);
  };
  interactive_mapping::RangeCheck check;
  check("window_s", window_s, 1.0, 3600.0, "s");
  check("motion/warn_offset_s", motion.warn_offset_s, 0.0, 10.0, "s");
  check("motion/error_offset_s", motion.error_offset_s, motion.warn_offset_s, 10.0, "s");
  append("", check.problems());
  for (const auto& [name, transform] : transforms) {
    for (const std::string* frame : {&transform.target, &transform.source}) {
      if (frame->empty() || frame->front() == '/') {
        problems.push_back("tf/" + name + (frame == &transform.target ? "/target" : "/source") + " = '" + *frame +
                           "', must be a tf2 frame: no leading slash");
      }
    }
    append("tf/" + name + "/", transform.limits.validate());
  }
  append("arrival/", arrival.validate());
  append("motion/", motion.estimator.validate());
  for (const std::string& problem : motion.image.validate()) {
    problems.push_back("motion/" + std::string(problem.rfind("width_px", 0) == 0 ? "image_" : "") + problem);
  }
  return problems;
}

std::string toYaml(const SystemDiagnosticsParams& params) {
  interactive_mapping_ros::ParamWriter writer;
  const auto write = [&writer](const std::string& key, const auto& value) { writer.write(key, value); };
  write("window_s", params.window_s);
  write("tf/watched", params.watched);
  for (const auto& [name, transform] : params.transforms) visitTransform(name, transform, write);
  visitOthers(params, write);
  return writer.text();
}

SystemDiagnosticsParams loadSystemDiagnosticsParams(const ros::NodeHandle& private_nh) {
  SystemDiagnosticsParams params;
  interactive_mapping_ros::ParamReader reader(private_nh);
  const auto read = [&reader](const std::string& key, auto& value) { reader.read(key, &value); };
  read("window_s", params.window_s);
  read("tf/watched", params.watched);
  const std::vector<std::string> names = namesIn(params.watched);
  std::map<std::string, WatchedTransform> chosen;
  for (const std::string& name : names) {
    const auto known = params.transforms.find(name);
    WatchedTransform transform = known != params.transforms.end() ? known->second : WatchedTransform();
    visitTransform(name, transform, read);
    transform.limits.window_s = params.window_s;
    if (!chosen.emplace(name, transform).second)
      reader.report("", {"tf/watched = '" + params.watched + "', must name each once"});
  }
  // Those that are not watched may stand in the file.
  for (const auto& [name, transform] : params.transforms) {
    if (chosen.count(name) == 0) reader.ignore("tf/" + name);
  }
  params.transforms = chosen;
  visitOthers(params, read);
  params.arrival.window_s = params.window_s;
  reader.ignore("diagnostic_period");  // read by diagnostic_updater
  reader.ignore("diagnostic_updater");
  reader.report("", params.validate());
  reader.finish();
  return params;
}

}  // namespace system_diagnostics_ros
