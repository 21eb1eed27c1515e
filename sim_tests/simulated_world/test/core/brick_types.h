// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include <mp700_ur5e_description/brick_types.h>

#include "simulated_world/pile_scene.h"

namespace simulated_world {

/// A brick as in the shipped catalogue, and how many of them tags can tell apart.
inline BrickType plainBrick() {
  return {"brick", Eigen::Vector3d(0.3, 0.2, 0.2), 1.0, 0.6};
}
constexpr int kMaxBricks = 97;
constexpr char kThreeSizes[] = MP700_UR5E_DESCRIPTION_DIR "/config/bricks_three_sizes.yaml";

/// A shipped one.
inline PileSceneConfig world(const std::string& name) {
  static const auto kTypes = mp700_ur5e_description::loadBrickTypes(kThreeSizes).types;
  return loadPileScene(SIMULATED_WORLDS "/" + name + ".yaml", kTypes, kMaxBricks);
}

inline BrickPlacement brickAt(int id, const Eigen::Vector3d& xyz_m, double yaw_rad = 0.0) {
  BrickPlacement brick;
  brick.id = id;
  brick.type = plainBrick();
  brick.T_map_brick.translation() = xyz_m;
  brick.T_map_brick.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return brick;
}

}  // namespace simulated_world
