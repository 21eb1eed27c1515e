// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>

#include <interactive_mapping_msgs/MissionState.h>

namespace pick_mission_ros {

/// What people read of a mission, on its panel and in rviz: the same words and colours in both. A value that the message
/// does not know, of a newer node, is given by its number.
std::string stateInWords(std::uint8_t state);
std::string endReasonInWords(std::uint8_t reason);
std::string statusInWords(std::uint8_t status);  // of a MissionBrick

/// The state and, where it is about one, the brick: "picking brick 7".
std::string stateInWords(const interactive_mapping_msgs::MissionState& state);

/// The mission drives, plans, picks ...: it is neither before its start, nor interrupted, nor at its end.
bool isActive(std::uint8_t state);

struct Rgb {
  std::uint8_t r{0};
  std::uint8_t g{0};
  std::uint8_t b{0};
};
bool operator==(const Rgb& a, const Rgb& b);
Rgb colorOfStatus(std::uint8_t status);

}  // namespace pick_mission_ros
