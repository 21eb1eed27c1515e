// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation_ros/ground_input.h"

#include <utility>

#include <interactive_mapping_common_ros/poses.h>

#include "base_navigation_ros/conversions.h"

namespace base_navigation_ros {

using base_navigation::NavigationGrid;

GroundInput::GroundInput(std::string map_frame, int occupied_from)
    : map_frame_(std::move(map_frame)), occupied_from_(occupied_from) {}

bool GroundInput::isInMap(const std::string& frame, std::string* why_not) const {
  if (interactive_mapping_ros::withoutSlash(frame) == map_frame_) return true;
  *why_not = "its frame is '" + frame + "', must be '" + map_frame_ + "' (map_frame)";
  return false;
}

GroundInput::Grid GroundInput::take(const nav_msgs::OccupancyGrid& message, std::string* why_not) {
  if (!isInMap(message.header.frame_id, why_not)) return nullptr;
  auto grid = toGrid(message, occupied_from_, why_not);
  if (!grid) return nullptr;
  newest_ = std::make_shared<const NavigationGrid>(std::move(*grid));
  return newest_;
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
  if (message.x < 0 || message.y < 0 || message.x + width > newest_->width || message.y + height > newest_->height ||
      static_cast<std::int64_t>(message.data.size()) != width * height) {
    *why_not = "an update of " + text(width) + " x " + text(height) + " cells at (" + text(message.x) + ", " +
               text(message.y) + ") with " + text(message.data.size()) + " values, must lie within the grid's " +
               text(newest_->width) + " x " + text(newest_->height);
    return nullptr;
  }
  auto grid = std::make_shared<NavigationGrid>(*newest_);
  auto value = message.data.begin();
  for (int row = message.y; row < message.y + height; ++row) {
    for (int column = message.x; column < message.x + width; ++column) {
      grid->state[grid->index(column, row)] = stateOf(*value++, occupied_from_);
    }
  }
  newest_ = std::move(grid);
  return newest_;
}

}  // namespace base_navigation_ros
