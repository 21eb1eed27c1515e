// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <mp700_ur5e_description/base_profile.h>
#include <ros/node_handle.h>

#include "base_navigation/base_navigator.h"
#include "base_navigation/grid_fusion.h"

namespace base_navigation_ros {

/// All parameters of the node, with the only copy of the defaults. SI units.
struct BaseNavigationParams {
  std::string map_frame{"map"};
  std::string odom_frame{"odom"};
  std::string base_frame{"base_link"};
  std::string base_profile_file;  // absolute path of a base_profile.yaml: footprint and limits
  double speed_share{1.0};        // of the profile's limits of speed

  struct Pose {
    double wait_s{0.0};  // wall time that a step waits for the localisation of its odometry's stamp; for lock step
    double max_tilt_rad{0.1};  // of a goal, against the map's plane
  } pose;

  struct Ground {
    bool required{true};    // drive only where the map has told of the ground; else the scanner will do
    int occupied_from{65};  // of the grid's values, 0 .. 100: less is free
  } ground;

  struct Output {
    double grid_rate_hz{2.0};       // of ~grid, at most, ROS time
    double watchdog_rate_hz{20.0};  // looks so often whether odometry still comes
  } output;

  base_navigation::GridFusionConfig grid;
  base_navigation::BasePlannerConfig planner;
  base_navigation::PathFollowerConfig follower;
  base_navigation::ObstacleGuardConfig guard;
  base_navigation::BaseNavigatorConfig navigator;

  /// Every problem as "key = value unit, must be ..."; those that only a base has are left to validateFor().
  std::vector<std::string> validate() const;
  std::vector<std::string> validateFor(const mp700_ur5e_description::BaseProfile& profile) const;

  base_navigation::MotionLimits limitsOf(const mp700_ur5e_description::BaseProfile& profile) const;
};

/// In the layout of config/base_navigation.yaml.
std::string toYaml(const BaseNavigationParams& params);

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value,
/// for the base whose profile they name, too.
BaseNavigationParams loadBaseNavigationParams(const ros::NodeHandle& private_nh);

}  // namespace base_navigation_ros
