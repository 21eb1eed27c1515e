// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <geometry_msgs/Pose.h>
#include <interactive_mapping_msgs/ArmGoal.h>
#include <interactive_mapping_msgs/BrickArray.h>
#include <interactive_mapping_msgs/MissionState.h>
#include <interactive_mapping_msgs/NbvSelection.h>
#include <interactive_mapping_msgs/PickBrickGoal.h>
#include <interactive_mapping_msgs/PlanPickGoal.h>
#include <interactive_mapping_msgs/PlanPickResult.h>
#include <motion_planning/manipulability_sector.h>
#include <nlohmann/json.hpp>

#include "pick_mission/mission_machine.h"

namespace pick_mission_ros {

/// Message and enum have the same values. Throws std::invalid_argument, beginning with `what`, for a value beyond.
template <typename Status>
Status statusFrom(std::uint8_t value, int num_status, const std::string& what) {
  if (value < num_status) return static_cast<Status>(value);
  throw std::invalid_argument(what + " = " + std::to_string(value) + ", must be less than " +
                              std::to_string(num_status));
}

/// Where the arm stands and what it can reach from there.
struct Reach {
  const motion_planning::ManipulabilitySectors* sectors;
  Eigen::Isometry3d T_base_armbase;
  Eigen::Isometry3d T_map_base;
};

/// All bricks that can be made sense of; of several that carry the same id the first, marked as such. `seen_now`: ids of
/// this look. Throws std::invalid_argument if the array is not in `map_frame`. Bricks whose pose is not finite are left
/// out, a sentence each in `complaints`.
std::vector<pick_mission::SeenBrick> toSeenBricks(const interactive_mapping_msgs::BrickArray& bricks,
                                                  const std::vector<int>& seen_now, const std::string& map_frame,
                                                  const Reach& reach, std::vector<std::string>* complaints);

/// What is held over a frame of the robot.
interactive_mapping_msgs::ArmGoal placeGoal(const std::string& frame);
interactive_mapping_msgs::PlanPickGoal toGoal(const pick_mission::command::PlanPick& plan,
                                              const std::string& map_frame);

/// With letting go at the end.
interactive_mapping_msgs::PickBrickGoal toGoal(const pick_mission::SeenBrick& brick, const std::string& map_frame,
                                               const interactive_mapping_msgs::PlanPickResult& plan);

/// Nothing if a number is not finite.
std::optional<pick_mission::Pose2d> toPose2d(const geometry_msgs::Pose& pose);

/// For the file of all selections; numbers that are not finite become null.
nlohmann::json toJson(const interactive_mapping_msgs::NbvSelection& selection, double time_s);

/// The mission's part of the message: header, view, decision, failures and what belongs to the run are the caller's.
/// `current`: the brick that is being planned for, picked or carried.
interactive_mapping_msgs::MissionState toMessage(const pick_mission::MissionMachine& machine,
                                                 std::optional<int> current);

}  // namespace pick_mission_ros
