// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <interactive_mapping_common/config/schema.h>
#include <mp700_ur5e_description/base_profile.h>
#include <ros/node_handle.h>

#include "base_navigation/base_navigator.h"
#include "base_navigation/grid_fusion.h"

namespace base_navigation_ros {

/// All parameters of the node. SI units.
struct BaseNavigationParams {
  std::string map_frame{"map"};
  std::string odom_frame{"odom"};
  std::string base_frame{"base_link"};
  std::string base_profile_file;
  double speed_share{1.0};

  struct Pose {
    double wait_s{0.0};
    double max_tilt_rad{0.1};

    static void fields(Pose& c, interactive_mapping::Fields& f) {
      f("wait_s", c.wait_s, 0.0, 10.0, "s",
        "wall time that a step waits for the localisation of its odometry's stamp; for lock step");
      f("max_tilt_rad", c.max_tilt_rad, 0.0, 1.5, "rad", "largest tilt of a goal against the map's plane");
    }
  } pose;

  struct Ground {
    bool required{true};
    int occupied_from{65};

    static void fields(Ground& c, interactive_mapping::Fields& f) {
      f("required", c.required, "the base drives only while the map's ground is fresh; false: the scanner is enough");
      f("occupied_from", c.occupied_from, 1, 100, "",
        "lowest occupied value of the ground's cells; 65 is map_server's, 100 leaves out the inflation of a costmap");
    }
  } ground;

  struct Output {
    double grid_rate_hz{2.0};
    double watchdog_rate_hz{20.0};

    static void fields(Output& c, interactive_mapping::Fields& f) {
      f("grid_rate_hz", c.grid_rate_hz, 0.1, 50.0, "Hz",
        "highest rate of ~grid, ROS time; also of the grid that ~make_plan uses while there is no goal");
      f("watchdog_rate_hz", c.watchdog_rate_hz, 5.0, 200.0, "Hz",
        "how often the node checks that odometry still comes");
    }
  } output;

  base_navigation::GridFusionConfig grid;
  base_navigation::BasePlannerConfig planner;
  base_navigation::PathFollowerConfig follower;
  base_navigation::ObstacleGuardConfig guard;
  base_navigation::BaseNavigatorConfig navigator;

  static void fields(BaseNavigationParams& c, interactive_mapping::Fields& f) {
    f("map_frame", c.map_frame, "fixed frame, that of the map's ground");
    f("odom_frame", c.odom_frame, "frame of the odometry");
    f("base_frame", c.base_frame, "frame of the base");
    f("base_profile_file", c.base_profile_file, "absolute path of a base_profile.yaml; the launch file gives it");
    f.live()("speed_share", c.speed_share, 0.05, 1.0, "", "share of the profile's speed limits");
    f.section("pose", c.pose);
    f.section("ground", c.ground);
    f.section("output", c.output);
    f.section("grid", c.grid);
    f.section("plan", c.planner);
    f.section("follow", c.follower);
    f.section("guard", c.guard);
    f.section("drive", c.navigator);
    const auto require_frame = [&f](const char* key, const std::string& frame) {
      f.require(!frame.empty() && frame.front() != '/',
                std::string(key) + " = '" + frame + "', must be a tf2 frame: no leading slash");
    };
    require_frame("map_frame", c.map_frame);
    require_frame("odom_frame", c.odom_frame);
    require_frame("base_frame", c.base_frame);
    f.require(c.odom_frame != c.map_frame, "odom_frame = '" + c.odom_frame + "', must be another frame than map_frame");
    f.require(c.base_frame != c.map_frame && c.base_frame != c.odom_frame,
              "base_frame = '" + c.base_frame + "', must be another frame than map_frame and odom_frame");
    f.require(!c.base_profile_file.empty() && c.base_profile_file.front() == '/',
              "base_profile_file = '" + c.base_profile_file + "', must be the absolute path of a base_profile.yaml");
    // An impossible padding is reported alone.
    f.require(!(c.planner.padding_m >= 0.0 && c.guard.margin_m >= c.planner.padding_m),
              "guard/margin_m = " + std::to_string(c.guard.margin_m) + " m, must be below plan/padding_m = " +
                  std::to_string(c.planner.padding_m) + " m, or the guard stops planned motion");
  }

  base_navigation::MotionLimits limitsOf(const mp700_ur5e_description::BaseProfile& profile) const;
  /// Problems that only a base with this profile has.
  std::vector<std::string> problemsFor(const mp700_ur5e_description::BaseProfile& profile) const;
};

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value,
/// for the base whose profile they name, too.
BaseNavigationParams loadBaseNavigationParams(const ros::NodeHandle& private_nh);

}  // namespace base_navigation_ros
