// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_common/enums/enum_names.h>
#include <mp700_ur5e_description/brick_types.h>

namespace simulated_world {

using mp700_ur5e_description::BrickType;  // physics uses name, size, mass and friction

/// How a brick is not what its type says. Mass and plates of such a brick's type are its own.
enum class Decoy {
  kNone,
  kUntagged,   ///< a box of a brick's size: no tag tells which it is, no plate holds
  kHeavy,      ///< more than the magnet lifts
  kTwoPlates,  ///< plates on two faces only, tags on all
  kWedged,     ///< lies under a heavy one
  kCardboard,  ///< a box of a size of its own; it and the next two have no tags and no plates
  kSphere,
  kCylinder,
};
inline constexpr interactive_mapping::Names<Decoy> kDecoyNames = {
    {"none", Decoy::kNone},     {"untagged", Decoy::kUntagged},
    {"heavy", Decoy::kHeavy},   {"two_plates", Decoy::kTwoPlates},
    {"wedged", Decoy::kWedged}, {"cardboard", Decoy::kCardboard},
    {"sphere", Decoy::kSphere}, {"cylinder", Decoy::kCylinder}};
constexpr const char* toString(Decoy decoy) {
  return interactive_mapping::nameOf(decoy, kDecoyNames);
}

struct BrickPlacement {
  int id{0};
  BrickType type;
  Eigen::Isometry3d T_map_brick{Eigen::Isometry3d::Identity()};  ///< of the brick's centre; the ground is at z = 0
  Decoy decoy{Decoy::kNone};
};

/// Upright box on the ground. Nothing moves it.
struct Wall {
  Eigen::Vector2d center_m{0.0, 0.0};
  double yaw_rad{0.0};
  Eigen::Vector3d size_m{2.0, 0.2, 2.0};

  Eigen::Isometry3d pose() const;  ///< T_map_wall, of its middle
  std::vector<std::string> validate() const;
};

/// Name of a wall in the simulated world and in contacts.
inline std::string wallName(std::size_t index) {
  return "wall_" + std::to_string(index);
}

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

/// Bricks tipped out: dropped in any orientation from over a rectangle, one above another. They come to rest as a loose
/// heap that is wider than the rectangle.
struct TippedConfig {
  Eigen::Vector2d center_m{0.0, 0.0};
  double yaw_rad{0.0};
  Eigen::Vector2d extent_m{1.2, 1.2};  ///< along the rectangle's axes; a brick in any orientation fits into it
  int bricks{20};
  double drop_height_m{0.1};     ///< of the lowest ones over the ground, at least
  std::vector<BrickType> types;  ///< of the bricks, in turn; empty: the scene's type

  std::vector<std::string> validate() const;
};

/// Bricks one on another, each farther along the stack's x than the one below: it stands while it is taken from its top.
struct StackConfig {
  Eigen::Vector2d center_m{0.0, 0.0};  ///< of the lowest brick
  double yaw_rad{0.0};
  int bricks{3};
  double overhang{0.3};  ///< of each over the one below, share of a brick's length: less than 1 / bricks, or it falls

  std::vector<std::string> validate() const;
};

/// How many of a scene's bricks are decoys, which ones the seed says.
struct DecoyConfig {
  int untagged{0};
  int heavy{0};
  int two_plates{0};
  int wedged{0};               ///< each under a heavy one of its own, in the first of the tipped heaps
  double heavy_mass_kg{12.0};  ///< of each heavy one
  int cardboard{0};
  int sphere{0};
  int cylinder{0};

  int total() const { return untagged + heavy + two_plates + wedged + cardboard + sphere + cylinder; }
  /// As many as a share of `bricks` is: untagged, heavy, with two plates and wedged in turn.
  static DecoyConfig fromShare(double share, int bricks);
  std::vector<std::string> validate() const;
};

/// A scene is made of heaps, tipped heaps and stacks, or of a list of bricks.
struct PileSceneConfig {
  std::string name;
  BrickType brick;  ///< of all heaps and stacks
  std::vector<HeapConfig> heaps;
  std::vector<TippedConfig> tipped;
  std::vector<StackConfig> stacks;
  DecoyConfig decoys;
  std::vector<Wall> walls;
  std::vector<BrickPlacement> bricks;
  double position_jitter_m{0.0};  ///< each brick is shifted by at most this along its heap's x and y (the map's) ...
  double yaw_jitter_rad{0.0};     ///< ... and turned by at most this
  double drop_gap_m{0.01};        ///< heaps: so far apart are the layers before they drop
  RobotStart robot_start;
  double min_robot_distance_m{2.5};  ///< from the middle of its base to the nearest part of any brick, on the ground
  double max_shift_m{0.15};          ///< a brick that settles farther than this from its place has rolled away
  bool has_tags{true};  ///< false: plain bricks, with their plates; what can be picked is judged as with tags

  int numBricks() const;
  /// Of the bricks of one of `tipped`, in turn.
  std::vector<BrickType> typesOf(const TippedConfig& heap) const;
  std::vector<std::string> validate() const;
};

struct PileScene {
  std::string name;
  std::uint64_t seed{0};
  std::vector<BrickPlacement> bricks;      ///< before they drop; in order of their ids, which say nothing of places
  std::vector<HeapConfig> heaps;           ///< what was asked for
  std::vector<std::vector<int>> heap_ids;  ///< the bricks of each heap
  std::vector<int> stack_ids;              ///< the bricks of all stacks
  bool has_tipped{false};
  std::vector<Wall> walls;
  double max_shift_m{0.15};
  bool has_tags{true};
  RobotStart robot_start;
};

/// The scene of a config, always the same for a seed. No two bricks overlap, none is in the ground. Throws
/// std::invalid_argument with all the reasons for which there is no such scene: a config that validate() objects to, a
/// heap that does not hold its bricks, bricks or walls that overlap, a robot that is too near.
PileScene generateScene(const PileSceneConfig& config, std::uint64_t seed);

/// What is wrong with a robot that starts here, one line each.
std::vector<std::string> faultsOfStart(const PileScene& scene, double min_robot_distance_m);

/// Reads a scene from YAML; `types` are those it may name and `max_bricks` is how many can be told apart. Throws
/// std::invalid_argument listing everything wrong with the file, a line each, impossible scenes included.
PileSceneConfig loadPileScene(const std::string& path, const std::vector<BrickType>& types, int max_bricks);
PileSceneConfig parsePileScene(const std::string& text, const std::string& name, const std::vector<BrickType>& types,
                               int max_bricks);

}  // namespace simulated_world
