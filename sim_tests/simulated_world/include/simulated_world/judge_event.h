// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <interactive_mapping_common/enums/enum_names.h>

namespace simulated_world {

enum class JudgeEventKind { kFall, kFallEnd, kDrop, kStow, kCollision, kCollisionEnd };
inline constexpr interactive_mapping::Names<JudgeEventKind> kJudgeEventKindNames = {
    {"fall", JudgeEventKind::kFall},           {"fall_end", JudgeEventKind::kFallEnd},
    {"drop", JudgeEventKind::kDrop},           {"stow", JudgeEventKind::kStow},
    {"collision", JudgeEventKind::kCollision}, {"collision_end", JudgeEventKind::kCollisionEnd}};
constexpr const char* toString(JudgeEventKind kind) {
  return interactive_mapping::nameOf(kind, kJudgeEventKindNames);
}

/// Something the judge counted, or the end of it. Members that do not belong to its kind keep their defaults.
struct JudgeEvent {
  JudgeEventKind kind{JudgeEventKind::kFall};
  double time_s{0.0};
  int brick_id{-1};         ///< of a fall, drop or stow
  double distance_m{0.0};   ///< of a fall, from where the brick lay: on detection; at the end, where it came to rest
  double tilt_rad{0.0};     ///< likewise
  std::string robot_body;   ///< of a collision
  std::string other_body;   ///< of a collision
  double max_force_N{0.0};  ///< of a collision, so far
  double duration_s{0.0};   ///< of a collision or fall, so far
};

}  // namespace simulated_world
