// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation_ros/ground_input.h"

#include <algorithm>
#include <utility>

#include <interactive_mapping_common_ros/poses.h>

#include "base_navigation_ros/conversions.h"

namespace base_navigation_ros {

namespace {

using base_navigation::NavigationGrid;

GroundInput::Grid shared(std::optional<NavigationGrid> grid) {
  return grid ? std::make_shared<const NavigationGrid>(std::move(*grid)) : nullptr;
}

}  // namespace

GroundInput::GroundInput(std::string map_frame, int occupied_from)
    : map_frame_(std::move(map_frame)), occupied_from_(occupied_from) {}

bool GroundInput::isInMap(const std::string& frame, std::string* why_not) const {
  if (interactive_mapping_ros::withoutSlash(frame) == map_frame_) return true;
  *why_not = "its frame is '" + frame + "', must be '" + map_frame_ + "' (map_frame)";
  return false;
}

GroundInput::Grid GroundInput::take(const nav_msgs::OccupancyGrid& message, std::string* why_not) {
  if (!isInMap(message.header.frame_id, why_not)) return nullptr;
  Grid grid = shared(toGrid(message, occupied_from_, why_not));
  if (grid) newest_ = message;
  return grid;
}

GroundInput::Grid GroundInput::take(const map_msgs::OccupancyGridUpdate& message, std::string* why_not) {
  if (!isInMap(message.header.frame_id, why_not)) return nullptr;
  const auto text = [](auto number) { return std::to_string(number); };
  if (!newest_) {
    *why_not = "an update came, and no whole grid before it";
    return nullptr;
  }
  const auto width = static_cast<std::int64_t>(message.width);
  const auto height = static_cast<std::int64_t>(message.height);
  const auto columns = static_cast<std::int64_t>(newest_->info.width);
  const auto rows = static_cast<std::int64_t>(newest_->info.height);
  if (message.x < 0 || message.y < 0 || message.x + width > columns || message.y + height > rows ||
      static_cast<std::int64_t>(message.data.size()) != width * height) {
    *why_not = "an update of " + text(width) + " x " + text(height) + " cells at (" + text(message.x) + ", " +
               text(message.y) + ") with " + text(message.data.size()) + " values, must lie within the grid's " +
               text(columns) + " x " + text(rows);
    return nullptr;
  }
  for (std::int64_t row = 0; row < height; ++row) {
    std::copy_n(message.data.begin() + row * width, width,
                newest_->data.begin() + (message.y + row) * columns + message.x);
  }
  return shared(toGrid(*newest_, occupied_from_, why_not));
}

}  // namespace base_navigation_ros
