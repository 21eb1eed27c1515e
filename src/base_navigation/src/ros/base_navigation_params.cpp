// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation_ros/base_navigation_params.h"

#include <sstream>
#include <stdexcept>
#include <utility>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common_ros/params.h>

#include "base_navigation/config_fields.h"

namespace base_navigation_ros {
namespace {

/// visit(key, value) for each key.
constexpr auto kVisitParams = [](auto& params, auto&& visit) {
  visit("map_frame", params.map_frame);
  visit("odom_frame", params.odom_frame);
  visit("base_frame", params.base_frame);
  visit("base_profile_file", params.base_profile_file);
  visit("speed_share", params.speed_share);
  visit("pose/wait_s", params.pose.wait_s);
  visit("pose/max_tilt_rad", params.pose.max_tilt_rad);
  visit("ground/required", params.ground.required);
  visit("ground/occupied_from", params.ground.occupied_from);
  visit("output/grid_rate_hz", params.output.grid_rate_hz);
  visit("output/watchdog_rate_hz", params.output.watchdog_rate_hz);
  base_navigation::visitGridFields(params.grid, visit);
  base_navigation::visitPlannerFields(params.planner, visit);
  base_navigation::visitFollowerFields(params.follower, visit);
  base_navigation::visitGuardFields(params.guard, visit);
  base_navigation::visitNavigatorFields(params.navigator, visit);
};

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
  if (odom_frame == map_frame) {
    problems.push_back("odom_frame = '" + odom_frame + "', must be another frame than map_frame");
  }
  if (base_frame == map_frame || base_frame == odom_frame) {
    problems.push_back("base_frame = '" + base_frame + "', must be another frame than map_frame and odom_frame");
  }
  if (base_profile_file.empty() || base_profile_file.front() != '/') {
    problems.push_back("base_profile_file = '" + base_profile_file +
                       "', must be the absolute path of a base_profile.yaml");
  }
  interactive_mapping::RangeCheck check;
  check("speed_share", speed_share, 0.05, 1.0, "");
  check("pose/wait_s", pose.wait_s, 0.0, 10.0, "s");
  check("pose/max_tilt_rad", pose.max_tilt_rad, 0.0, 1.5, "rad");
  check("ground/occupied_from", ground.occupied_from, 1, 100, "");
  check("output/grid_rate_hz", output.grid_rate_hz, 0.1, 50.0, "Hz");
  check("output/watchdog_rate_hz", output.watchdog_rate_hz, 5.0, 200.0, "Hz");
  append("", check.problems());
  // A padding that is impossible itself is reported below, alone.
  if (planner.padding_m >= 0.0 && guard.margin_m >= planner.padding_m) {
    std::ostringstream text;
    text << "guard/margin_m = " << guard.margin_m << " m, must be below plan/padding_m = " << planner.padding_m
         << " m: the guard would stop what was planned";
    problems.push_back(text.str());
  }
  append("grid/", grid.validate());
  append("plan/", planner.validate());
  append("follow/", follower.validate());
  append("guard/", guard.validate());
  append("drive/", navigator.validate());
  return problems;
}

std::vector<std::string> BaseNavigationParams::validateFor(const mp700_ur5e_description::BaseProfile& profile) const {
  std::vector<std::string> problems;
  if (!(speed_share > 0.0 && speed_share <= 1.0)) return problems;  // what comes of it tells nothing
  for (const std::string& problem : guard.validateFor(limitsOf(profile))) problems.push_back("guard/" + problem);
  return problems;
}

base_navigation::MotionLimits BaseNavigationParams::limitsOf(const mp700_ur5e_description::BaseProfile& profile) const {
  base_navigation::MotionLimits limits;
  limits.forward_m_s = speed_share * profile.limits.forward_m_per_s;
  limits.backward_m_s = speed_share * profile.limits.backward_m_per_s;
  limits.turn_rad_s = speed_share * profile.limits.turn_rad_per_s;
  limits.linear_m_s2 = profile.limits.linear_m_per_s2;
  limits.turn_rad_s2 = profile.limits.turn_rad_per_s2;
  limits.stop_m_s2 = profile.limits.stop_m_per_s2;
  return limits;
}

std::string toYaml(const BaseNavigationParams& params) {
  return interactive_mapping_ros::paramsToYaml(params, kVisitParams);
}

BaseNavigationParams loadBaseNavigationParams(const ros::NodeHandle& private_nh) {
  return interactive_mapping_ros::loadParams<BaseNavigationParams>(
      private_nh, kVisitParams, {"diagnostic_period", "diagnostic_updater"}, [](const BaseNavigationParams& params) {
        std::vector<std::string> problems = params.validate();
        const std::string& file = params.base_profile_file;
        if (file.empty() || file.front() != '/') return problems;
        try {
          for (std::string& problem : params.validateFor(mp700_ur5e_description::loadBaseProfile(file))) {
            problems.push_back(std::move(problem));
          }
        } catch (const std::invalid_argument& error) {
          problems.push_back(std::string("base_profile_file: ") + error.what());
        }
        return problems;
      });
}

}  // namespace base_navigation_ros
