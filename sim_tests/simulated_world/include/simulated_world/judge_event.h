// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <Eigen/Core>
#include <interactive_mapping_common/enums/enum_names.h>

namespace simulated_world {

enum class JudgeEventKind { kFall, kFallEnd, kDrop, kStow, kCollision, kCollisionEnd, kLoadContact, kLoadContactEnd };
inline constexpr interactive_mapping::Names<JudgeEventKind> kJudgeEventKindNames = {
    {"fall", JudgeEventKind::kFall},
    {"fall_end", JudgeEventKind::kFallEnd},
    {"drop", JudgeEventKind::kDrop},
    {"stow", JudgeEventKind::kStow},
    {"collision", JudgeEventKind::kCollision},
    {"collision_end", JudgeEventKind::kCollisionEnd},
    {"load_contact", JudgeEventKind::kLoadContact},
    {"load_contact_end", JudgeEventKind::kLoadContactEnd}};
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
  std::string robot_body;   ///< of a collision; of a load's contact the brick in the hand
  std::string other_body;   ///< of a collision or a load's contact
  double max_force_N{0.0};  ///< likewise, so far
  Eigen::Vector3d p_map{Eigen::Vector3d::Zero()};  ///< likewise, where the bodies touched first
  double duration_s{0.0};                          ///< likewise, or of a fall, so far
};

}  // namespace simulated_world
