// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include <Eigen/Geometry>
#include <geometry_msgs/Pose.h>
#include <interactive_mapping_common_ros/poses.h>
#include <nav_msgs/OccupancyGrid.h>
#include <nav_msgs/Path.h>
#include <sensor_msgs/LaserScan.h>

#include "base_navigation/base_path.h"
#include "base_navigation/grid_fusion.h"
#include "base_navigation/navigation_grid.h"

namespace base_navigation_ros {

using interactive_mapping_ros::toPlane;
using interactive_mapping_ros::toPose;

/// Angle between the z axis of `T` and upright.
double tilt(const Eigen::Isometry3d& T);

/// Of a cell of an occupancy grid: 0 .. `occupied_from` - 1 is free, from there to 100 occupied, everything else unknown.
base_navigation::SpaceState stateOf(std::int8_t value, int occupied_from);
/// Along the axes of the message's frame, see alongAxes(): its origin may have a yaw. Nothing, and why, for a message whose
/// numbers do not fit together, or that is tilted against its frame.
std::optional<base_navigation::NavigationGrid> toGrid(const nav_msgs::OccupancyGrid& message, int occupied_from,
                                                      std::string* why_not);
nav_msgs::OccupancyGrid toMessage(const base_navigation::NavigationGrid& grid, const std_msgs::Header& header);

/// `T_base_scanner` from tf; the scanner may hang upside down. Nothing, and why, for impossible numbers, more than
/// 10000 beams, or a scan of which less than a quarter is a measurement. Also for a scanner that does not lie flat (5
/// degrees).
std::optional<base_navigation::Scan> toScan(const sensor_msgs::LaserScan& message,
                                            const Eigen::Isometry3d& T_base_scanner, std::string* why_not);

/// A pose every `step_m`.
nav_msgs::Path toMessage(const base_navigation::BasePath& path, double step_m, const std_msgs::Header& header);

}  // namespace base_navigation_ros
