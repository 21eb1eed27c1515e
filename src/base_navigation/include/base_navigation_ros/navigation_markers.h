// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <ros/time.h>

#include "base_navigation/base_navigator.h"

namespace base_navigation_ros {

/// ~markers for rviz: the footprint, its place at the goal, what the guard stops for, and why the base stands.
class NavigationMarkers {
 public:
  NavigationMarkers(const ros::NodeHandle& private_nh, std::string map_frame, base_navigation::Polygon footprint);

  bool isWatched() const { return publisher_.getNumSubscribers() > 0; }
  void show(const base_navigation::NavigationOutput& output, const base_navigation::Pose2d& T_map_base,
            const std::optional<base_navigation::Pose2d>& goal_map, const ros::Time& stamp);

 private:
  const std::string map_frame_;
  const base_navigation::Polygon footprint_;
  ros::Publisher publisher_;
};

}  // namespace base_navigation_ros
