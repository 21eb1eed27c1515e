// SPDX-License-Identifier: BSD-3-Clause
#include "mp700_ur5e_description/brick_types.h"

#include <algorithm>
#include <set>
#include <stdexcept>

#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/files/yaml_map.h>

namespace mp700_ur5e_description {
namespace {

using interactive_mapping::Interval;
using interactive_mapping::readYaml;
using interactive_mapping::toText;
using interactive_mapping::YamlMap;

struct Family {
  const char* name;
  int num_ids;
  int border_cells;  // between the corners that detectors report
  int black_cells;   // along the black border's outer edge
  int outer_cells;   // with data outside the border
};
// As libapriltag and OpenCV have them. Where the corners lie on the border's inner edge, the border has white inside and data
// outside. ALVAR_5X5 are 25 data bits in a border of two cells, ids of 16 bits.
constexpr std::array<Family, 13> kFamilies = {{{"tag36h11", 587, 8, 8, 8},
                                               {"tag16h5", 30, 6, 6, 6},
                                               {"tag25h9", 35, 7, 7, 7},
                                               {"tag36h10", 2320, 8, 8, 8},
                                               {"tagCircle21h7", 38, 5, 7, 9},
                                               {"tagCircle49h12", 65535, 5, 7, 11},
                                               {"tagCustom48h12", 42211, 6, 8, 10},
                                               {"tagStandard41h12", 2115, 5, 7, 9},
                                               {"tagStandard52h13", 48714, 6, 8, 10},
                                               {"DICT_4X4_1000", 1000, 6, 6, 6},
                                               {"DICT_5X5_1000", 1000, 7, 7, 7},
                                               {"DICT_6X6_1000", 1000, 8, 8, 8},
                                               {"ALVAR_5X5", 65536, 9, 9, 9}}};

const Family* findFamily(const std::string& name) {
  for (const Family& family : kFamilies) {
    if (name == family.name) return &family;
  }
  return nullptr;
}

std::string join(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

/// OpenCV's own names of AprilTag's families.
std::string adviceFor(const std::string& family) {
  if (family.rfind("DICT_APRILTAG_", 0) != 0) return "";
  return ". OpenCV prints the tags of tag" + family.substr(std::string("DICT_APRILTAG_").size()) +
         " turned by 180 degrees: name that family, and turn the labels, or list the bricks with turn_rad: 3.1416";
}

std::optional<BrickFace> faceOf(const std::string& name) {
  for (const BrickFace face : kBrickFaces) {
    if (name == toString(face)) return face;
  }
  return std::nullopt;
}

constexpr char kFaceRule[] = "one of +x, -x, +y, -y, +z, -z";

BrickType readType(YamlMap& map) {
  const Interval length{0.0, 2.0, "m", true};  // larger is a slip of units
  BrickType type;
  type.name = map.word("name");
  type.size_m = map.numbers("size_m", 3, length);
  type.mass_kg = map.number("mass_kg", {0.0, 100.0, "kg", true});
  type.friction = map.number("friction", {0.0, 2.0, ""});
  type.plate_edge_m = map.number("plate_edge_m", length);
  if (map.has("plate_faces")) {
    type.plate_faces.clear();
    for (const std::string& name : map.words("plate_faces")) {
      const std::optional<BrickFace> face = faceOf(name);
      if (!face || std::count(type.plate_faces.begin(), type.plate_faces.end(), *face) > 0) {
        map.note("plate_faces", name, std::string(kFaceRule) + ", each at most once");
      } else {
        type.plate_faces.push_back(*face);
      }
    }
  }
  type.color_rgb = map.numbers("color_rgb", 3, {0.0, 1.0, ""});
  map.finish();
  return type;
}

constexpr int kMaxId = 100000;

LabelledBrick readBrick(YamlMap& map, const std::vector<BrickType>& types, const TagLayout& scheme) {
  const Interval shift{-2.0, 2.0, "m"};
  LabelledBrick brick;
  brick.id = map.integer("id", {0, kMaxId, ""});
  brick.type = map.word("type");
  const auto type = std::find_if(types.begin(), types.end(), [&](const BrickType& t) { return t.name == brick.type; });
  if (type == types.end()) map.note("type", brick.type, "the name of one of types");
  for (YamlMap& entry : map.maps("tags")) {
    BrickTag tag;
    tag.brick_id = brick.id;
    const int tag_id = entry.integer("id", {0, kMaxId, ""});
    const std::string face = entry.word("face");
    if (const std::optional<BrickFace> known = faceOf(face)) {
      tag.face = *known;
    } else {
      entry.note("face", face, kFaceRule);
    }
    tag.black_border_edge_m = entry.has("black_border_edge_m")
                                  ? entry.number("black_border_edge_m", {0.0, 2.0, "m", true})
                                  : scheme.black_border_edge_m;
    Eigen::Vector2d centre = Eigen::Vector2d::Zero();
    if (entry.has("center_m")) centre = entry.numbers("center_m", 2, shift);
    const double turn = entry.has("turn_rad") ? entry.number("turn_rad", {-6.2832, 6.2832, "rad"}) : 0.0;
    entry.finish();
    if (type == types.end()) continue;
    tag.T_brick_tag = tagPose(*type, tag.face) * Eigen::Translation3d(centre.x(), centre.y(), 0.0) *
                      Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ());
    if (!brick.tags.emplace(tag_id, tag).second) {
      entry.note("id", std::to_string(tag_id), "a tag that no other place has");
    }
  }
  map.finish();
  return brick;
}

TagLayout readTags(YamlMap map) {
  TagLayout tags;
  tags.family = map.word("family");
  tags.black_border_edge_m = map.number("black_border_edge_m", {0.0, 2.0, "m", true});
  // Detectors need a ring of white about the black border; where data lies outside it, the white is inside.
  const bool has_data_outside = TagLayout::outerCells(tags.family) > TagLayout::blackCells(tags.family);
  tags.margin_cells = map.number("margin_cells", {has_data_outside ? 0.0 : 1.0, 10.0, "cells"});
  tags.first_id = map.integer("first_id", {0, kMaxId, ""});
  if (map.has("num_bricks")) tags.num_bricks = map.integer("num_bricks", {0, kMaxId, ""});
  map.finish();
  return tags;
}

}  // namespace

std::vector<std::string> TagLayout::families() {
  std::vector<std::string> names;
  for (const Family& family : kFamilies) names.emplace_back(family.name);
  return names;
}

int TagLayout::numIds(const std::string& family) {
  const Family* found = findFamily(family);
  return found ? found->num_ids : 0;
}

int TagLayout::borderCells(const std::string& family) {
  const Family* found = findFamily(family);
  return found ? found->border_cells : 0;
}

int TagLayout::blackCells(const std::string& family) {
  const Family* found = findFamily(family);
  return found ? found->black_cells : 0;
}

int TagLayout::outerCells(const std::string& family) {
  const Family* found = findFamily(family);
  return found ? found->outer_cells : 0;
}

double TagLayout::cellEdge() const {
  return black_border_edge_m / blackCells(family);
}

double TagLayout::cornerEdge(double of_black_border_edge_m) const {
  return of_black_border_edge_m * borderCells(family) / blackCells(family);
}

double TagLayout::paperEdge() const {
  return (outerCells(family) + 2.0 * margin_cells) * cellEdge();
}

const BrickType& BrickCatalogue::type(const std::string& name) const {
  std::vector<std::string> known;
  for (const BrickType& candidate : types) {
    if (candidate.name == name) return candidate;
    known.push_back(candidate.name);
  }
  throw std::invalid_argument("brick type = " + name + ", must be one of: " + join(known));
}

const BrickType& BrickCatalogue::typeOf(int brick_id) const {
  for (const LabelledBrick& brick : bricks) {
    if (brick.id == brick_id) return type(brick.type);
  }
  if (brick_id < 0 || brick_id >= maxBricks()) {
    throw std::invalid_argument("brick_id = " + std::to_string(brick_id) + ", must be one of the list or in [0, " +
                                std::to_string(maxBricks() - 1) + "]");
  }
  return types.front();
}

int BrickCatalogue::maxBricks() const {
  const int possible = std::max(0, (TagLayout::numIds(tags.family) - tags.first_id) / kNumBrickFaces);
  return std::min(possible, tags.num_bricks.value_or(possible));
}

int BrickCatalogue::tagId(int brick_id, BrickFace face) const {
  if (brick_id < 0 || brick_id >= maxBricks()) {
    throw std::invalid_argument("brick_id = " + std::to_string(brick_id) + ", must be in [0, " +
                                std::to_string(maxBricks() - 1) + "]: the tags of " + tags.family + " go no further");
  }
  return tags.first_id + kNumBrickFaces * brick_id + static_cast<int>(face);
}

std::optional<BrickTag> BrickCatalogue::brickOfTag(int tag_id) const {
  for (const LabelledBrick& brick : bricks) {
    const auto tag = brick.tags.find(tag_id);
    if (tag != brick.tags.end()) return tag->second;
  }
  const int index = tag_id - tags.first_id;
  if (tag_id < tags.first_id || index >= kNumBrickFaces * maxBricks()) return std::nullopt;
  const BrickFace face = kBrickFaces[static_cast<std::size_t>(index % kNumBrickFaces)];
  return BrickTag{index / kNumBrickFaces, face, tags.black_border_edge_m, tagPose(types.front(), face)};
}

std::vector<std::string> BrickCatalogue::validate() const {
  std::vector<std::string> problems;
  if (TagLayout::numIds(tags.family) == 0) {
    problems.push_back("tags/family = " + tags.family + ", must be one of: " + join(TagLayout::families()) +
                       adviceFor(tags.family));
    return problems;
  }
  const int num_ids = TagLayout::numIds(tags.family);
  if (tags.num_bricks && maxBricks() < *tags.num_bricks) {
    problems.push_back("tags/num_bricks = " + std::to_string(*tags.num_bricks) + ", must be at most " +
                       std::to_string(maxBricks()) + ": the family has " + std::to_string(num_ids) + " ids");
  } else if (maxBricks() < 1 && bricks.empty()) {
    problems.push_back("tags/first_id = " + std::to_string(tags.first_id) + ", must leave six ids below " +
                       std::to_string(num_ids));
  }
  std::set<std::string> names;
  for (const BrickType& brick : types) {
    const double shortest_m = brick.size_m.minCoeff();
    if (!names.insert(brick.name).second) problems.push_back("types: name = " + brick.name + ", must be unique");
    if (brick.plate_edge_m > shortest_m) {
      problems.push_back("types: plate_edge_m of " + brick.name + " = " + toText(brick.plate_edge_m) +
                         " m, must be at most the shortest edge, " + toText(shortest_m) + " m");
    }
    if (&brick == &types.front() && maxBricks() > 0 && tags.paperEdge() > shortest_m) {
      problems.push_back("tags: black border and margin = " + toText(tags.paperEdge()) + " m, must fit the faces of " +
                         brick.name + ", " + toText(shortest_m) + " m");
    }
  }
  validateList(num_ids, &problems);
  return problems;
}

void BrickCatalogue::validateList(int num_ids, std::vector<std::string>* problems) const {
  std::set<int> brick_ids;
  std::map<int, int> owner;  // of a tag: the brick
  const double outer_per_black =
      static_cast<double>(TagLayout::outerCells(tags.family)) / TagLayout::blackCells(tags.family);
  for (const LabelledBrick& brick : bricks) {
    const std::string where = "bricks: id = " + std::to_string(brick.id);
    if (!brick_ids.insert(brick.id).second) problems->push_back(where + ", must be unique");
    if (brick.id < maxBricks()) {
      problems->push_back(where + ", must be at least " + std::to_string(maxBricks()) +
                          ": those below are labelled by the scheme (tags/num_bricks)");
    }
    for (const auto& [tag_id, tag] : brick.tags) {
      const std::string label = "bricks: tag id = " + std::to_string(tag_id) + " of brick " + std::to_string(brick.id);
      if (tag_id >= num_ids) {
        problems->push_back(label + ", must be below " + std::to_string(num_ids) + ", the number of ids of " +
                            tags.family);
      }
      const auto [other, is_new] = owner.emplace(tag_id, brick.id);
      const int index = tag_id - tags.first_id;
      if (!is_new) {
        problems->push_back(label + ", must be unique: brick " + std::to_string(other->second) + " has it too");
      } else if (index >= 0 && index < kNumBrickFaces * maxBricks()) {
        problems->push_back(label + ", must be unique: by the scheme it is that of brick " +
                            std::to_string(index / kNumBrickFaces) + " (tags/num_bricks limits the scheme)");
      }
      // The middle may be anywhere as long as the border, and what data lies outside it, is on the face.
      const Eigen::Vector3d half_size_m = 0.5 * type(brick.type).size_m;
      const double half_m = 0.5 * tag.black_border_edge_m * outer_per_black;
      bool is_on_face = true;
      for (const double x : {-half_m, half_m}) {
        for (const double y : {-half_m, half_m}) {
          const Eigen::Vector3d corner = tag.T_brick_tag * Eigen::Vector3d(x, y, 0.0);
          is_on_face = is_on_face && ((corner.cwiseAbs() - half_size_m).array() < 1e-9).all();
        }
      }
      if (!is_on_face)
        problems->push_back(label + ", must lie on its face: a corner of its " +
                            (outer_per_black > 1.0 ? "data outside the border" : "border") + " is outside");
      for (const auto& [other_id, other_tag] : brick.tags) {
        const double distance_m = (other_tag.T_brick_tag.translation() - tag.T_brick_tag.translation()).norm();
        if (other_id < tag_id && other_tag.face == tag.face &&
            distance_m < 0.5 * outer_per_black * (other_tag.black_border_edge_m + tag.black_border_edge_m)) {
          problems->push_back(label + ", must lie beside tag " + std::to_string(other_id) + ", not on it");
        }
      }
    }
  }
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
    if (root.has("bricks")) {
      for (YamlMap& map : root.maps("bricks")) {
        catalogue.bricks.push_back(readBrick(map, catalogue.types, catalogue.tags));
      }
    }
    root.finish();
    if (problems.empty()) problems = catalogue.validate();
  });
  return catalogue;
}

BrickCatalogue loadBrickTypes(const std::string& path) {
  return parseBrickTypes(interactive_mapping::readTextFile(path), path);
}

}  // namespace mp700_ur5e_description
