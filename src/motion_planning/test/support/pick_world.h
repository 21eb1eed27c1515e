// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "motion_planning/motion_planner.h"
#include "support/box_world.h"

namespace motion_planning {

/// Bricks on the ground before the robot, as an exact world, and what a planner is asked there.
struct PickWorld {
  BoxWorld world;  // of bricks
  mp700_ur5e_description::BrickType type;
  Eigen::Isometry3d T_map_base{Eigen::Isometry3d::Identity()};
  ArmVector start_rad{ArmVector::Zero()};
  std::shared_ptr<const CollisionScene> scene;  // made by makeScene()
  std::vector<std::size_t> open;                // bricks that nothing lies on

  /// Puts a brick of the type with its middle at `p_base`, turned about the vertical.
  void add(const Eigen::Vector3d& p_base, double yaw_rad = 0.0);
  void makeScene(const CollisionSceneConfig& config = {});

  PlanningContext context() const;
  /// Brick i, faces by default: the top, then those towards the robot first.
  PickTarget target(std::size_t brick) const;
  /// Over one of the places in the container.
  std::vector<ArmGoal> container(const ArmKinematics& arm, std::size_t place = 0) const;
};

/// The arm of the shipped URDF.
std::shared_ptr<const ArmKinematics> shippedArm();
/// Sectors wide enough for what the tests ask, narrower than the arm's reach.
ManipulabilitySectors testSectors();
/// Nothing there yet; the base stands turned and off the map's origin.
PickWorld emptyPickWorld();
/// A pile drawn at random: bricks side by side, some with another on top.
PickWorld randomPile(std::uint64_t seed, int num_bricks);

}  // namespace motion_planning
