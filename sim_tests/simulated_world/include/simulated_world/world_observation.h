// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>

#include "simulated_world/obstacle.h"

namespace simulated_world {

/// What the simulator knows about who is moving a brick, or did last.
enum class BrickStatus {
  kInPile,       ///< nobody has it; the state in which it can fall
  kHeld,         ///< on the magnet
  kReleased,     ///< let go on purpose over the container, on its way into it
  kJammed,       ///< rests on the container's rim or on other bricks in it: counts as dropped, and rides along
  kDropped,      ///< lost by the magnet; lies wherever it fell and belongs to the pile again once at rest
  kStowed,       ///< lies in the container, or was unloaded
  kMovedByHand,  ///< being moved by somebody else than the robot (fault injection)
};

struct BrickObservation {
  int id{0};
  Eigen::Isometry3d T_map_brick{Eigen::Isometry3d::Identity()};  ///< of the brick's centre
  Eigen::Vector3d size_m{Eigen::Vector3d::Zero()};               ///< full lengths along the brick's axes
  BrickStatus status{BrickStatus::kInPile};
  bool is_pickable{true};  ///< at the start of the run, once nothing lies on it
};

/// One pair of bodies in contact, one of them the robot's or a brick that it carries. A simulator that observes less often
/// than it steps reports the largest force since the last observation.
struct RobotContact {
  std::string robot_body;
  std::string other_body;
  double force_N{0.0};
  bool is_of_load{
      false};  ///< robot_body is a brick in the hand, off the place where it was taken; other_body is not the robot's
  Eigen::Vector3d p_map{Eigen::Vector3d::Zero()};  ///< where they touch
};

/// Ground truth at one moment: all that the judge sees of the world, and nothing that the mission may see.
struct WorldObservation {
  double time_s{0.0};
  std::vector<BrickObservation> bricks;
  std::optional<int> target_id;  ///< the brick that the tool may touch now
  std::vector<RobotContact> contacts;
  std::vector<Obstacle> obstacles;                     ///< that stand in the way now
  Eigen::Vector2d base_xy_m{Eigen::Vector2d::Zero()};  ///< in the map frame
};

/// Name of a brick's body in the simulated world and in contacts.
inline std::string brickBodyName(int id) {
  return "brick_" + std::to_string(id);
}

}  // namespace simulated_world
