// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <mp700_ur5e_description/brick_types.h>

namespace simulated_world {

using mp700_ur5e_description::BrickType;  // physics uses name, size, mass and friction

struct BrickPlacement {
  int id{0};
  BrickType type;
  Eigen::Isometry3d T_map_brick{Eigen::Isometry3d::Identity()};  ///< of the brick's centre; the ground is at z = 0
};

struct RobotStart {
  Eigen::Vector2d xy_m{-4.0, 0.0};
  double yaw_rad{0.0};
};

/// Bricks in layers, crosswise, each layer smaller than the one below. A long one is a ridge.
struct HeapConfig {
  Eigen::Vector2d center_m{0.0, 0.0};
  double yaw_rad{0.0};
  Eigen::Vector2d extent_m{1.2, 1.2};  ///< along the heap's axes: no brick reaches beyond, and together they span most
  int bricks{20};
  int layers{3};

  std::vector<std::string> validate() const;
};

/// A scene is a list of heaps or a list of bricks.
struct PileSceneConfig {
  std::string name;
  BrickType brick;  ///< of all heaps
  std::vector<HeapConfig> heaps;
  std::vector<BrickPlacement> bricks;
  double position_jitter_m{0.0};  ///< each brick is shifted by at most this along its heap's x and y (the map's) ...
  double yaw_jitter_rad{0.0};     ///< ... and turned by at most this
  double drop_gap_m{0.01};        ///< heaps: so far apart are the layers before they drop
  RobotStart robot_start;
  double min_robot_distance_m{2.5};  ///< from the middle of its base to the nearest part of any brick, on the ground
  double time_per_brick_s{45.0};     ///< simulated
  double max_shift_m{0.15};          ///< a brick that settles farther than this from its place has rolled away

  std::vector<std::string> validate() const;
};

struct PileScene {
  std::string name;
  std::uint64_t seed{0};
  std::vector<BrickPlacement> bricks;      ///< before they drop; in order of their ids, which say nothing of places
  std::vector<HeapConfig> heaps;           ///< what was asked for
  std::vector<std::vector<int>> heap_ids;  ///< the bricks of each heap
  double max_shift_m{0.15};
  RobotStart robot_start;
  double time_limit_s{0.0};  ///< simulated
};

/// The scene of a config, always the same for a seed. No two bricks overlap, none is in the ground. Throws
/// std::invalid_argument with all the reasons for which there is no such scene: a config that validate() objects to, a
/// heap that does not hold its bricks, bricks that overlap, a robot that is too near.
PileScene generateScene(const PileSceneConfig& config, std::uint64_t seed);

/// Reads a scene from YAML; `types` are those it may name and `max_bricks` is how many can be told apart. Throws
/// std::invalid_argument listing everything wrong with the file, a line each, impossible scenes included.
PileSceneConfig loadPileScene(const std::string& path, const std::vector<BrickType>& types, int max_bricks);
PileSceneConfig parsePileScene(const std::string& text, const std::string& name, const std::vector<BrickType>& types,
                               int max_bricks);

}  // namespace simulated_world
