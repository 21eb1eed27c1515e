// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation_ros/base_navigation_params.h"

#include <gpis_mapping/range_check.h>
#include <gpis_mapping_ros/param_reader.h>
#include <gpis_mapping_ros/param_writer.h>

#include "base_navigation/config_fields.h"

namespace base_navigation_ros {
namespace {

/// visit(key, value) for each key.
template <typename Params, typename Visitor>
void visitParams(Params& params, Visitor&& visit) {
  visit("map_frame", params.map_frame);
  visit("odom_frame", params.odom_frame);
  visit("base_frame", params.base_frame);
  visit("base_profile_file", params.base_profile_file);
  visit("speed_share", params.speed_share);
  visit("pose/wait_s", params.pose.wait_s);
  visit("pose/max_tilt_rad", params.pose.max_tilt_rad);
  visit("ground/required", params.ground.required);
  visit("output/grid_rate_hz", params.output.grid_rate_hz);
  visit("output/watchdog_rate_hz", params.output.watchdog_rate_hz);
  base_navigation::visitGridFields(params.grid, visit);
  base_navigation::visitPlannerFields(params.planner, visit);
  base_navigation::visitFollowerFields(params.follower, visit);
  base_navigation::visitGuardFields(params.guard, visit);
  base_navigation::visitNavigatorFields(params.navigator, visit);
}

}  // namespace

std::vector<std::string> BaseNavigationParams::validate() const {
  std::vector<std::string> problems;
  const auto append = [&problems](const std::string& section, const std::vector<std::string>& more) {
    for (const std::string& problem : more) problems.push_back(section + problem);
  };
  const std::pair<const char*, const std::string*> frames[] = {
      {"map_frame", &map_frame}, {"odom_frame", &odom_frame}, {"base_frame", &base_frame}};
  for (const auto& [key, frame] : frames) {
    if (frame->empty() || frame->front() == '/') {
      problems.push_back(std::string(key) + " = '" + *frame + "', must be a tf2 frame: no leading slash");
    }
  }
  if (base_profile_file.empty() || base_profile_file.front() != '/') {
    problems.push_back("base_profile_file = '" + base_profile_file +
                       "', must be the absolute path of a base_profile.yaml");
  }
  gpis_mapping::RangeCheck check;
  check("speed_share", speed_share, 0.05, 1.0, "");
  check("pose/wait_s", pose.wait_s, 0.0, 10.0, "s");
  check("pose/max_tilt_rad", pose.max_tilt_rad, 0.0, 1.5, "rad");
  check("output/grid_rate_hz", output.grid_rate_hz, 0.1, 50.0, "Hz");
  check("output/watchdog_rate_hz", output.watchdog_rate_hz, 5.0, 200.0, "Hz");
  append("", check.problems());
  if (guard.margin_m >= planner.padding_m) {
    problems.push_back("guard/margin_m = " + std::to_string(guard.margin_m) + " m, must be below plan/padding_m = " +
                       std::to_string(planner.padding_m) + " m: the guard would stop what was planned");
  }
  append("grid/", grid.validate());
  append("plan/", planner.validate());
  append("follow/", follower.validate());
  append("guard/", guard.validate());
  append("drive/", navigator.validate());
  return problems;
}

std::string toYaml(const BaseNavigationParams& params) {
  gpis_mapping_ros::ParamWriter writer;
  visitParams(params, [&writer](const std::string& key, const auto& value) { writer.write(key, value); });
  return writer.text();
}

BaseNavigationParams loadBaseNavigationParams(const ros::NodeHandle& private_nh) {
  BaseNavigationParams params;
  gpis_mapping_ros::ParamReader reader(private_nh);
  visitParams(params, [&reader](const std::string& key, auto& value) { reader.read(key, &value); });
  reader.ignore("diagnostic_period");  // read by diagnostic_updater
  reader.ignore("diagnostic_updater");
  reader.report("", params.validate());
  reader.finish();
  return params;
}

}  // namespace base_navigation_ros
