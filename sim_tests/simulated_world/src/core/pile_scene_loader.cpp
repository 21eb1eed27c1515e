// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <filesystem>
#include <set>
#include <stdexcept>

#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/files/yaml_map.h>

#include "simulated_world/pile_scene.h"
#include "synthetic_depth/scene.h"

namespace simulated_world {
namespace {

using interactive_mapping::Interval;
using interactive_mapping::YamlMap;

// Farther than this is a slip of units.
const Interval kPosition{-100.0, 100.0, "m"};
const Interval kLength{0.0, 100.0, "m", true};
const Interval kAngle{-6.2832, 6.2832, "rad"};
const Interval kCount{1, 10000};

const BrickType* findType(const std::vector<BrickType>& types, const std::string& name) {
  const auto found = std::find_if(types.begin(), types.end(), [&](const BrickType& type) { return type.name == name; });
  return found == types.end() ? nullptr : &*found;
}

/// The type that `section` names at `key`, which is `fallback` if it has no such key.
BrickType readType(YamlMap& section, const std::string& key, const std::vector<BrickType>& types,
                   const BrickType& fallback) {
  std::set<std::string> names;
  for (const BrickType& type : types) names.insert(type.name);
  const BrickType* type = findType(types, section.choice(key, names, fallback.name));
  return type == nullptr ? fallback : *type;
}

std::string namesOf(const std::vector<BrickType>& types) {
  std::string names;
  for (const BrickType& type : types) names += (names.empty() ? "" : ", ") + type.name;
  return names;
}

/// The types that `section` lists at `key`; empty if it has no such key.
std::vector<BrickType> readTypes(YamlMap& section, const std::string& key, const std::vector<BrickType>& types) {
  std::vector<BrickType> listed;
  if (!section.has(key)) return listed;
  for (const std::string& name : section.words(key)) {
    const BrickType* type = findType(types, name);
    if (type == nullptr) {
      section.note(key, name, "a list of: " + namesOf(types));
    } else {
      listed.push_back(*type);
    }
  }
  return listed;
}

HeapConfig readHeap(YamlMap section) {
  HeapConfig heap;
  for (const char* key : {"center_m", "extent_m", "bricks", "layers"}) {
    section.require(key, "given for each heap");
  }
  heap.center_m = section.numbers("center_m", heap.center_m, kPosition);
  heap.yaw_rad = section.number("yaw_rad", heap.yaw_rad, kAngle);
  heap.extent_m = section.numbers("extent_m", heap.extent_m, kLength);
  heap.bricks = section.integer("bricks", heap.bricks, kCount);
  heap.layers = section.integer("layers", heap.layers, kCount);
  section.finish();
  return heap;
}

TippedConfig readTipped(YamlMap section, const std::vector<BrickType>& types) {
  TippedConfig heap;
  for (const char* key : {"center_m", "extent_m", "bricks"}) {
    section.require(key, "given for each of tipped");
  }
  heap.center_m = section.numbers("center_m", heap.center_m, kPosition);
  heap.yaw_rad = section.number("yaw_rad", heap.yaw_rad, kAngle);
  heap.extent_m = section.numbers("extent_m", heap.extent_m, kLength);
  heap.bricks = section.integer("bricks", heap.bricks, kCount);
  heap.drop_height_m = section.number("drop_height_m", heap.drop_height_m, {0.01, 5.0, "m"});
  heap.types = readTypes(section, "brick_types", types);
  section.finish();
  return heap;
}

StackConfig readStack(YamlMap section) {
  StackConfig stack;
  section.require("center_m", "given for each stack");
  stack.center_m = section.numbers("center_m", stack.center_m, kPosition);
  stack.yaw_rad = section.number("yaw_rad", stack.yaw_rad, kAngle);
  stack.bricks = section.integer("bricks", stack.bricks, {2, 10});
  stack.overhang = section.number("overhang", stack.overhang, {0.0, 0.5});
  section.finish();
  return stack;
}

Wall readWall(YamlMap section) {
  Wall wall;
  section.require("center_m", "given for each wall");
  section.require("size_m", "given for each wall");
  wall.center_m = section.numbers("center_m", wall.center_m, kPosition);
  wall.yaw_rad = section.number("yaw_rad", wall.yaw_rad, kAngle);
  wall.size_m = section.numbers("size_m", wall.size_m, {0.01, 100.0, "m"});
  section.finish();
  return wall;
}

DecoyConfig readDecoys(YamlMap section, int num_bricks) {
  DecoyConfig decoys;
  const Interval count{0, 10000};
  if (section.has("share")) {
    decoys = DecoyConfig::fromShare(section.number("share", 0.0, {0.0, 1.0}), num_bricks);
    for (const char* key : {"untagged", "heavy", "two_plates", "wedged", "cardboard", "sphere", "cylinder"}) {
      if (section.has(key)) section.note(key, "a number beside share", "given, or share, but not both");
    }
  }
  decoys.untagged = section.integer("untagged", decoys.untagged, count);
  decoys.heavy = section.integer("heavy", decoys.heavy, count);
  decoys.two_plates = section.integer("two_plates", decoys.two_plates, count);
  decoys.wedged = section.integer("wedged", decoys.wedged, count);
  decoys.cardboard = section.integer("cardboard", decoys.cardboard, count);
  decoys.sphere = section.integer("sphere", decoys.sphere, count);
  decoys.cylinder = section.integer("cylinder", decoys.cylinder, count);
  decoys.heavy_mass_kg = section.number("heavy_mass_kg", decoys.heavy_mass_kg, {0.001, 1000.0, "kg"});
  section.finish();
  return decoys;
}

BrickPlacement readBrick(YamlMap section, const std::vector<BrickType>& types, const BrickType& fallback) {
  BrickPlacement brick;
  section.require("id", "given for each brick");
  section.require("xyz_m", "given for each brick");
  brick.id = section.integer("id", 0, {0, 1e6});
  brick.type = readType(section, "type", types, fallback);
  const Eigen::Vector3d xyz_m = section.numbers("xyz_m", Eigen::Vector3d::Zero(), kPosition);
  const double yaw_rad = section.number("yaw_rad", 0.0, kAngle);
  brick.T_map_brick = synthetic_depth::poseFromXyzRpy(xyz_m, {0.0, 0.0, yaw_rad});
  if (section.has("rpy_rad")) {
    if (section.has("yaw_rad")) section.note("rpy_rad", "several orientations", "given, or yaw_rad, but not both");
    brick.T_map_brick =
        synthetic_depth::poseFromXyzRpy(xyz_m, section.numbers("rpy_rad", Eigen::Vector3d::Zero(), kAngle));
  }
  section.finish();
  return brick;
}

PileSceneConfig readScene(YamlMap section, const std::vector<BrickType>& types, int max_bricks) {
  PileSceneConfig config;
  section.require("brick_type", "the name of a type");
  section.require("robot_start", "{xy_m, yaw_rad}");
  config.brick = readType(section, "brick_type", types, BrickType());
  for (const YamlMap& heap : section.optionalMaps("heaps")) config.heaps.push_back(readHeap(heap));
  for (const YamlMap& heap : section.optionalMaps("tipped")) config.tipped.push_back(readTipped(heap, types));
  for (const YamlMap& stack : section.optionalMaps("stacks")) config.stacks.push_back(readStack(stack));
  for (const YamlMap& wall : section.optionalMaps("walls")) config.walls.push_back(readWall(wall));
  for (const YamlMap& brick : section.optionalMaps("bricks")) {
    config.bricks.push_back(readBrick(brick, types, config.brick));
  }
  config.position_jitter_m = section.number("position_jitter_m", config.position_jitter_m, {0.0, 0.1, "m"});
  config.yaw_jitter_rad = section.number("yaw_jitter_rad", config.yaw_jitter_rad, {0.0, 0.7854, "rad"});
  config.drop_gap_m = section.number("drop_gap_m", config.drop_gap_m, {0.0, 0.1, "m", true});
  config.has_tags = section.flag("has_tags", config.has_tags);
  config.max_shift_m = section.number("max_shift_m", config.max_shift_m, kLength);
  YamlMap start = section.optionalMap("robot_start");
  config.robot_start.xy_m = start.numbers("xy_m", config.robot_start.xy_m, kPosition);
  config.robot_start.yaw_rad = start.number("yaw_rad", config.robot_start.yaw_rad, kAngle);
  start.finish();

  const int num_bricks = config.numBricks();
  if (section.has("decoys")) config.decoys = readDecoys(section.optionalMap("decoys"), num_bricks);
  if (num_bricks > max_bricks) {
    section.note(!config.bricks.empty()  ? "bricks"
                 : !config.heaps.empty() ? "heaps"
                                         : "tipped",
                 std::to_string(num_bricks) + " bricks",
                 "at most " + std::to_string(max_bricks) + ", for there are no more tags");
  }
  for (const BrickPlacement& brick : config.bricks) {
    if (brick.id >= max_bricks) {
      section.note("bricks", "id " + std::to_string(brick.id), "less than " + std::to_string(max_bricks));
    }
  }
  section.optionalMap("decoys");  // a known key, whether it is there or not
  section.finish();
  return config;
}

}  // namespace

PileSceneConfig parsePileScene(const std::string& text, const std::string& name, const std::vector<BrickType>& types,
                               int max_bricks) {
  std::vector<std::string> problems;
  PileSceneConfig config;
  try {
    const YAML::Node root = YAML::Load(text);
    if (!root.IsMap()) interactive_mapping::refuseIfAny(name + ":", {"is no map of keys"});
    config = readScene(YamlMap(root, "", problems), types, max_bricks);
  } catch (const YAML::Exception& error) {
    problems = {error.what()};
  }
  interactive_mapping::refuseIfAny(name + ":", problems);
  config.name = std::filesystem::path(name).stem().string();
  try {
    generateScene(config, 0);  // whether it can be at all
  } catch (const std::invalid_argument& error) {
    interactive_mapping::refuseIfAny(name + ":", {error.what()});
  }
  return config;
}

PileSceneConfig loadPileScene(const std::string& path, const std::vector<BrickType>& types, int max_bricks) {
  return parsePileScene(interactive_mapping::readTextFile(path), path, types, max_bricks);
}

}  // namespace simulated_world
