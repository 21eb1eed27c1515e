// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation_ros/conversions.h"

#include <cmath>
#include <stdexcept>

#include <interactive_mapping_common/formatted.h>

namespace base_navigation_ros {
namespace {

using base_navigation::NavigationGrid;
using base_navigation::Pose2d;
using base_navigation::Scan;
using base_navigation::SpaceState;
using interactive_mapping::formatted;

constexpr std::size_t kMaxBeams = 10000;
constexpr double kMaxScannerTilt_rad = 0.087;
constexpr double kMinTellingShare = 0.25;  // drivers mask beams that look at the robot: a third at most
constexpr double kMaxCells = 1.6e7;
constexpr double kMaxGridTilt_rad = 1e-3;

}  // namespace

double tilt(const Eigen::Isometry3d& T) {
  return std::atan2(T.linear().col(2).head<2>().norm(), T.linear()(2, 2));
}

SpaceState stateOf(std::int8_t value, int occupied_from) {
  if (value < 0 || value > 100) return SpaceState::kUnknown;
  return value < occupied_from ? SpaceState::kFree : SpaceState::kOccupied;
}

std::optional<NavigationGrid> toGrid(const nav_msgs::OccupancyGrid& message, int occupied_from, std::string* why_not) {
  const auto& info = message.info;
  const double cells = static_cast<double>(info.width) * info.height;
  if (cells > kMaxCells) {
    *why_not = formatted("%u x %u cells, must be at most %.0f in all", info.width, info.height, kMaxCells);
  } else if (static_cast<double>(message.data.size()) != cells) {
    *why_not = formatted("%zu values for %u x %u cells", message.data.size(), info.width, info.height);
  } else {
    std::string no_pose;
    const auto T_frame_origin = interactive_mapping_ros::toIsometry(info.origin, &no_pose);
    if (!T_frame_origin) {
      *why_not = "its origin: " + no_pose;
    } else if (tilt(*T_frame_origin) > kMaxGridTilt_rad) {
      *why_not =
          formatted("its origin is tilted by %.3g rad against its frame, must be at most %.3g rad; a yaw is allowed",
                    tilt(*T_frame_origin), kMaxGridTilt_rad);
    } else {
      NavigationGrid grid;
      grid.cell_size_m = info.resolution;
      // Written as a float: 0.05 comes back as 0.05000000075, and far cells would be off.
      grid.cell_size_m = std::round(grid.cell_size_m * 1e6) / 1e6;
      grid.origin_m = T_frame_origin->translation().head<2>();
      grid.width = static_cast<int>(info.width);
      grid.height = static_cast<int>(info.height);
      grid.state.reserve(message.data.size());
      for (const std::int8_t value : message.data) grid.state.push_back(stateOf(value, occupied_from));
      try {
        requireValid(grid);
        const double yaw_rad = toPlane(*T_frame_origin).yaw_rad;
        if (yaw_rad == 0.0) return grid;
        std::optional<NavigationGrid> along = alongAxes(grid, yaw_rad, kMaxCells);
        if (along) {
          requireValid(*along);
        } else {
          *why_not = formatted("%u x %u cells turned by %.3f rad need more than %.0f along the axes of its frame",
                               info.width, info.height, yaw_rad, kMaxCells);
        }
        return along;
      } catch (const std::invalid_argument& error) {
        *why_not = error.what();
      }
    }
  }
  return std::nullopt;
}

nav_msgs::OccupancyGrid toMessage(const NavigationGrid& grid, const std_msgs::Header& header) {
  nav_msgs::OccupancyGrid message;
  message.header = header;
  message.info.map_load_time = header.stamp;
  message.info.resolution = static_cast<float>(grid.cell_size_m);
  message.info.width = static_cast<std::uint32_t>(grid.width);
  message.info.height = static_cast<std::uint32_t>(grid.height);
  message.info.origin = toPose(Pose2d{grid.origin_m.x(), grid.origin_m.y(), 0.0});
  message.data.reserve(grid.state.size());
  for (const SpaceState state : grid.state) {
    message.data.push_back(state == SpaceState::kOccupied ? 100 : state == SpaceState::kFree ? 0 : -1);
  }
  return message;
}

std::optional<Scan> toScan(const sensor_msgs::LaserScan& message, const Eigen::Isometry3d& T_base_scanner,
                           std::string* why_not) {
  if (message.ranges.size() < 2 || message.ranges.size() > kMaxBeams) {
    *why_not = formatted("%zu beams, must be 2 .. %zu", message.ranges.size(), kMaxBeams);
  } else if (!std::isfinite(message.angle_min) || !std::isfinite(message.angle_increment) ||
             message.angle_increment == 0.0F ||
             std::abs(message.angle_increment) * (message.ranges.size() - 1) > 2.0 * M_PI + 0.01) {
    *why_not =
        formatted("angle_min = %g rad, angle_increment = %g rad with %zu beams, must be finite and one turn at most",
                  message.angle_min, message.angle_increment, message.ranges.size());
  } else if (!(message.range_min >= 0.0F) || !(message.range_max > message.range_min) ||
             !std::isfinite(message.range_max)) {
    *why_not = formatted("range_min = %g m, range_max = %g m, must be 0 <= range_min < range_max", message.range_min,
                         message.range_max);
  } else {
    const double upright_rad = tilt(T_base_scanner);
    if (upright_rad > kMaxScannerTilt_rad && upright_rad < M_PI - kMaxScannerTilt_rad) {
      *why_not = formatted("the scanner is tilted by %.3f rad, must lie flat or upside down within %.3f rad",
                           upright_rad, kMaxScannerTilt_rad);
      return std::nullopt;
    }
    Scan scan;
    scan.T_base_scanner = toPlane(T_base_scanner);
    scan.is_mirrored = upright_rad > 0.5 * M_PI;
    scan.min_angle_rad = message.angle_min;
    scan.increment_rad = message.angle_increment;
    scan.range_min_m = message.range_min;
    scan.range_max_m = message.range_max;
    scan.ranges_m = message.ranges;
    std::size_t telling = 0;
    for (std::size_t beam = 0; beam < scan.ranges_m.size(); ++beam) telling += scan.isEcho(beam) || scan.isEmpty(beam);
    if (static_cast<double>(telling) < kMinTellingShare * static_cast<double>(scan.ranges_m.size())) {
      *why_not = formatted("only %zu of %zu beams report a range, must be at least %.0f %%: the scanner is blind",
                           telling, scan.ranges_m.size(), 100.0 * kMinTellingShare);
      return std::nullopt;
    }
    return scan;
  }
  return std::nullopt;
}

nav_msgs::Path toMessage(const base_navigation::BasePath& path, double step_m, const std_msgs::Header& header) {
  nav_msgs::Path message;
  message.header = header;
  if (path.motions.empty()) return message;
  for (const auto& sample : path.sample(step_m, 0.3)) {
    geometry_msgs::PoseStamped pose;
    pose.header = header;
    pose.pose = toPose(sample.pose);
    message.poses.push_back(pose);
  }
  return message;
}

}  // namespace base_navigation_ros
