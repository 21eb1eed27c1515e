// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation_ros/base_navigation_params.h"

#include <stdexcept>
#include <string>
#include <vector>

#include <interactive_mapping_common_ros/params.h>

namespace base_navigation_ros {

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

std::vector<std::string> BaseNavigationParams::problemsFor(const mp700_ur5e_description::BaseProfile& profile) const {
  std::vector<std::string> problems;
  // An impossible share is reported alone.
  if (!(speed_share > 0.0 && speed_share <= 1.0)) return problems;
  const base_navigation::MotionLimits limits = limitsOf(profile);
  for (const std::string& problem : limits.validate()) problems.push_back("speed_share: " + problem);
  for (const std::string& problem : guard.problemsFor(limits)) problems.push_back("guard/" + problem);
  return problems;
}

BaseNavigationParams loadBaseNavigationParams(const ros::NodeHandle& private_nh) {
  return interactive_mapping_ros::loadParams<BaseNavigationParams>(
      private_nh, {}, [](const BaseNavigationParams& params) -> std::vector<std::string> {
        const std::string& file = params.base_profile_file;
        if (file.empty() || file.front() != '/') return {};
        try {
          return params.problemsFor(mp700_ur5e_description::loadBaseProfile(file));
        } catch (const std::invalid_argument& error) {
          return {std::string("base_profile_file: ") + error.what()};
        }
      });
}

}  // namespace base_navigation_ros
