// SPDX-License-Identifier: BSD-3-Clause
#include "mp700_ur5e_description/brick_types.h"

#include <algorithm>
#include <set>
#include <stdexcept>

#include "yaml_file.h"

namespace mp700_ur5e_description {
namespace {

struct Family {
  const char* name;
  int num_ids;
  int border_cells;
};
// Names, number of ids, cells along the black border: of the AprilTag library, and of OpenCV's ArUco dictionaries.
constexpr std::array<Family, 4> kFamilies = {
    {{"tag36h11", 587, 8}, {"DICT_4X4_1000", 1000, 6}, {"DICT_5X5_1000", 1000, 7}, {"DICT_6X6_1000", 1000, 8}}};

const Family* findFamily(const std::string& name) {
  for (const Family& family : kFamilies) {
    if (name == family.name) return &family;
  }
  return nullptr;
}

BrickType readType(YamlMap& map) {
  const Interval length{0.0, 2.0, "m", true};  // larger is a slip of units
  BrickType type;
  type.name = map.word("name");
  type.size_m = map.numbers("size_m", 3, length);
  type.mass_kg = map.number("mass_kg", {0.0, 100.0, "kg", true});
  type.friction = map.number("friction", {0.0, 2.0, ""});
  type.plate_edge_m = map.number("plate_edge_m", length);
  type.color_rgb = map.numbers("color_rgb", 3, {0.0, 1.0, ""});
  map.finish();
  return type;
}

TagLayout readTags(YamlMap map) {
  TagLayout tags;
  tags.family = map.word("family");
  tags.black_border_edge_m = map.number("black_border_edge_m", {0.0, 2.0, "m", true});
  tags.margin_cells = map.number("margin_cells", {1.0, 10.0, "cells"});  // detectors need a ring of white
  tags.first_id = map.integer("first_id", {0, 100000, ""});
  map.finish();
  return tags;
}

}  // namespace

int TagLayout::numIds(const std::string& family) {
  const Family* found = findFamily(family);
  return found ? found->num_ids : 0;
}

int TagLayout::borderCells(const std::string& family) {
  const Family* found = findFamily(family);
  return found ? found->border_cells : 0;
}

double TagLayout::cellEdge() const {
  return black_border_edge_m / borderCells(family);
}

double TagLayout::paperEdge() const {
  return black_border_edge_m + 2.0 * margin_cells * cellEdge();
}

const BrickType& BrickCatalogue::type(const std::string& name) const {
  std::string known;
  for (const BrickType& candidate : types) {
    if (candidate.name == name) return candidate;
    known += (known.empty() ? "" : ", ") + candidate.name;
  }
  throw std::invalid_argument("brick type = " + name + ", must be one of: " + known);
}

int BrickCatalogue::maxBricks() const {
  return std::max(0, (TagLayout::numIds(tags.family) - tags.first_id) / kNumBrickFaces);
}

int BrickCatalogue::tagId(int brick_id, BrickFace face) const {
  if (brick_id < 0 || brick_id >= maxBricks()) {
    throw std::invalid_argument("brick_id = " + std::to_string(brick_id) + ", must be in [0, " +
                                std::to_string(maxBricks() - 1) + "]: the tags of " + tags.family + " go no further");
  }
  return tags.first_id + kNumBrickFaces * brick_id + static_cast<int>(face);
}

std::optional<BrickTag> BrickCatalogue::brickOfTag(int tag_id) const {
  const int index = tag_id - tags.first_id;
  if (tag_id < tags.first_id || index >= kNumBrickFaces * maxBricks()) return std::nullopt;
  return BrickTag{index / kNumBrickFaces, kBrickFaces[static_cast<std::size_t>(index % kNumBrickFaces)]};
}

std::vector<std::string> BrickCatalogue::validate() const {
  std::vector<std::string> problems;
  if (TagLayout::numIds(tags.family) == 0) {
    std::string known;
    for (const Family& family : kFamilies) known += (known.empty() ? "" : ", ") + std::string(family.name);
    problems.push_back("tags/family = " + tags.family + ", must be one of: " + known);
    return problems;
  }
  if (maxBricks() < 1) {
    problems.push_back("tags/first_id = " + std::to_string(tags.first_id) + ", must leave six ids below " +
                       std::to_string(TagLayout::numIds(tags.family)));
  }
  std::set<std::string> names;
  for (const BrickType& brick : types) {
    const double shortest_m = brick.size_m.minCoeff();
    if (!names.insert(brick.name).second) problems.push_back("types: name = " + brick.name + ", must be unique");
    if (brick.plate_edge_m > shortest_m) {
      problems.push_back("types: plate_edge_m of " + brick.name + " = " + toText(brick.plate_edge_m) +
                         " m, must be at most the shortest edge, " + toText(shortest_m) + " m");
    }
    if (tags.paperEdge() > shortest_m) {
      problems.push_back("tags: black border and margin = " + toText(tags.paperEdge()) + " m, must fit the faces of " +
                         brick.name + ", " + toText(shortest_m) + " m");
    }
  }
  return problems;
}

Eigen::Vector3d faceNormal(BrickFace face) {
  const int index = static_cast<int>(face);
  return (index % 2 == 0 ? 1.0 : -1.0) * Eigen::Vector3d::Unit(index / 2);
}

Eigen::Isometry3d tagPose(const BrickType& type, BrickFace face) {
  const Eigen::Vector3d out = faceNormal(face);
  const bool is_side = out.z() == 0.0;
  const Eigen::Vector3d up = is_side ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitY();
  Eigen::Isometry3d T_brick_tag = Eigen::Isometry3d::Identity();
  T_brick_tag.linear() << up.cross(out), up, out;
  T_brick_tag.translation() = 0.5 * out.cwiseProduct(type.size_m);
  return T_brick_tag;
}

BrickCatalogue parseBrickTypes(const std::string& text, const std::string& name) {
  BrickCatalogue catalogue;
  readYaml(text, name, [&](YamlMap& root, std::vector<std::string>& problems) {
    for (YamlMap& map : root.maps("types")) catalogue.types.push_back(readType(map));
    catalogue.tags = readTags(root.map("tags"));
    root.finish();
    if (problems.empty()) problems = catalogue.validate();
  });
  return catalogue;
}

BrickCatalogue loadBrickTypes(const std::string& path) {
  return parseBrickTypes(readText(path), path);
}

}  // namespace mp700_ur5e_description
