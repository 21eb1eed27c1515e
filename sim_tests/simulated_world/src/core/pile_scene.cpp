// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/pile_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <set>
#include <sstream>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>

#include "pile_generators.h"
#include "simulated_world/box_separation.h"
#include "synthetic_depth/scene.h"
#include "synthetic_depth/seeded_random.h"

namespace simulated_world {
namespace {

using synthetic_depth::SeededRandom;

/// A heap that spans less than this share of its rectangle, on either side, is not the heap that was asked for.
constexpr double kLeastSpan = 0.7;
/// Bricks that touch do not overlap; a file has few decimals.
constexpr double kOverlap_m = 1e-6;

/// Place of a brick in its heap's frame.
struct Cell {
  Eigen::Vector2d center_m;
  bool is_crosswise;  ///< turned by a quarter
  int layer;
};

Eigen::Vector2d footprintOf(const Cell& cell, const Eigen::Vector3d& size_m) {
  return cell.is_crosswise ? Eigen::Vector2d(size_m.y(), size_m.x()) : Eigen::Vector2d(size_m.head<2>());
}

bool covers(const Cell& cell, const Eigen::Vector3d& size_m, const Eigen::Vector2d& p_m) {
  return ((p_m - cell.center_m).cwiseAbs() - 0.5 * footprintOf(cell, size_m)).maxCoeff() <= 0.0;
}

/// Whether a brick would rest on those of the layer below: half of it, and something under each of its quarters.
bool isSupported(const Cell& cell, const std::vector<Cell>& below, const Eigen::Vector3d& size_m) {
  constexpr int kPoints = 6;  // per side
  int num_supported = 0;
  int quarters[2][2] = {{0, 0}, {0, 0}};
  for (int i = 0; i < kPoints; ++i) {
    for (int j = 0; j < kPoints; ++j) {
      const Eigen::Vector2d share((i + 0.5) / kPoints - 0.5, (j + 0.5) / kPoints - 0.5);
      const Eigen::Vector2d p_m = cell.center_m + share.cwiseProduct(footprintOf(cell, size_m));
      if (std::any_of(below.begin(), below.end(), [&](const Cell& b) { return covers(b, size_m, p_m); })) {
        ++num_supported;
        ++quarters[2 * i / kPoints][2 * j / kPoints];
      }
    }
  }
  const bool has_all_quarters = quarters[0][0] > 0 && quarters[0][1] > 0 && quarters[1][0] > 0 && quarters[1][1] > 0;
  return has_all_quarters && 2 * num_supported >= kPoints * kPoints;
}

/// Room that a brick takes in its layer with the most jitter there may be.
Eigen::Vector2d pitchOf(const PileSceneConfig& config, bool is_crosswise) {
  const double c = std::cos(config.yaw_jitter_rad);
  const double s = std::sin(config.yaw_jitter_rad);
  const Eigen::Vector3d& size_m = config.brick.size_m;
  const Eigen::Vector2d turned(size_m.x() * c + size_m.y() * s, size_m.x() * s + size_m.y() * c);
  const Eigen::Vector2d room = turned + Eigen::Vector2d::Constant(2.0 * config.position_jitter_m);
  return is_crosswise ? Eigen::Vector2d(room.y(), room.x()) : room;
}

/// At most `wanted` cells of a layer, those nearest to the heap's middle.
std::vector<Cell> fillLayer(const PileSceneConfig& config, const HeapConfig& heap, int layer,
                            const std::vector<Cell>& below, int wanted) {
  const bool is_crosswise = layer % 2 == 1;
  const Eigen::Vector2d pitch_m = pitchOf(config, is_crosswise);
  const Eigen::Vector2i counts = (heap.extent_m.cwiseQuotient(pitch_m).array() + 1e-9).floor().cast<int>();
  std::vector<Cell> cells;
  for (int i = 0; i < counts.x(); ++i) {
    for (int j = 0; j < counts.y(); ++j) {
      const Eigen::Vector2d index(i - 0.5 * (counts.x() - 1), j - 0.5 * (counts.y() - 1));
      const Cell cell{index.cwiseProduct(pitch_m), is_crosswise, layer};
      if (layer == 0 || isSupported(cell, below, config.brick.size_m)) {
        cells.push_back(cell);
      }
    }
  }
  // In whole steps: mirrored cells are equally far, whatever their last bits say.
  const auto farness = [&](const Cell& cell) {
    return std::llround(1e9 * cell.center_m.cwiseQuotient(heap.extent_m).squaredNorm());
  };
  std::stable_sort(cells.begin(), cells.end(), [&](const Cell& a, const Cell& b) { return farness(a) < farness(b); });
  cells.resize(std::min(cells.size(), static_cast<std::size_t>(wanted)));
  return cells;
}

/// Length and width of a heap over all.
Eigen::Vector2d spanOf(const std::vector<Cell>& cells, const Eigen::Vector3d& size_m) {
  Eigen::Vector2d low_m = cells.front().center_m;
  Eigen::Vector2d high_m = low_m;
  for (const Cell& cell : cells) {
    low_m = low_m.cwiseMin(cell.center_m - 0.5 * footprintOf(cell, size_m));
    high_m = high_m.cwiseMax(cell.center_m + 0.5 * footprintOf(cell, size_m));
  }
  return high_m - low_m;
}

/// Cells for all of the heap's bricks in exactly its layers; nothing if there is no room for them.
std::optional<std::vector<Cell>> fillHeap(const PileSceneConfig& config, const HeapConfig& heap) {
  // The steeper the heap, the more bricks are in its upper layers: the first that works.
  for (double steepness = 1.0; steepness < 4.0; steepness += 0.25) {
    std::vector<Cell> all;
    std::vector<Cell> below;
    int left = heap.bricks;
    for (int layer = 0; layer < heap.layers && left > 0; ++layer) {
      double weights = 0.0;
      for (int k = layer; k < heap.layers; ++k) weights += std::pow(heap.layers - k, steepness);
      const int above = heap.layers - 1 - layer;  // each layer has a brick at least
      const int share = static_cast<int>(std::lround(left * std::pow(heap.layers - layer, steepness) / weights));
      below = fillLayer(config, heap, layer, below, std::clamp(share, std::min(1, left), std::max(1, left - above)));
      if (below.empty()) break;
      all.insert(all.end(), below.begin(), below.end());
      left -= static_cast<int>(below.size());
    }
    if (left == 0 && !all.empty() && all.back().layer == heap.layers - 1) {
      return all;
    }
  }
  return std::nullopt;
}

/// In the frame that the pose is given in.
Eigen::Isometry3d jittered(const Eigen::Isometry3d& pose, const PileSceneConfig& config, SeededRandom& random) {
  const double dx = random.uniform(-config.position_jitter_m, config.position_jitter_m);
  const double dy = random.uniform(-config.position_jitter_m, config.position_jitter_m);
  const double yaw = random.uniform(-config.yaw_jitter_rad, config.yaw_jitter_rad);
  Eigen::Isometry3d moved = pose;
  moved.translation() += Eigen::Vector3d(dx, dy, 0.0);
  moved.linear() = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix() * pose.linear();
  return moved;
}

/// How far below a brick's centre its lowest corner is.
double depthOf(const BrickPlacement& brick) {
  return 0.5 * brick.T_map_brick.linear().row(2).cwiseAbs().dot(brick.type.size_m);
}

/// On the ground, to the rectangle that a brick covers at most.
double distanceTo(const Eigen::Vector2d& xy_m, const BrickPlacement& brick) {
  // Seen from above, the corners' hull: as near as the nearest point of an edge between any two of them.
  double nearest = std::numeric_limits<double>::infinity();
  std::vector<Eigen::Vector2d> corners;
  for (int k = 0; k < 8; ++k) {
    const Eigen::Vector3d sign((k & 1) != 0 ? 0.5 : -0.5, (k & 2) != 0 ? 0.5 : -0.5, (k & 4) != 0 ? 0.5 : -0.5);
    corners.emplace_back((brick.T_map_brick * sign.cwiseProduct(brick.type.size_m)).head<2>());
  }
  for (const Eigen::Vector2d& a : corners) {
    for (const Eigen::Vector2d& b : corners) {
      const double length_squared = (b - a).squaredNorm();
      const double t = length_squared > 0.0 ? std::clamp((xy_m - a).dot(b - a) / length_squared, 0.0, 1.0) : 0.0;
      nearest = std::min(nearest, (xy_m - (a + t * (b - a))).norm());
    }
  }
  return nearest;
}

std::string nameOf(const BrickPlacement& brick) {
  std::ostringstream text;
  text << "brick " << brick.id << " at " << brick.T_map_brick.translation().transpose();
  return text.str();
}

std::vector<std::string> faultsOf(const PileScene& scene) {
  std::vector<std::string> faults;
  for (std::size_t i = 0; i < scene.bricks.size(); ++i) {
    const BrickPlacement& brick = scene.bricks[i];
    if (brick.T_map_brick.translation().z() - depthOf(brick) < -kOverlap_m) {
      faults.push_back(nameOf(brick) + " reaches into the ground, must be above it");
    }
    for (std::size_t j = 0; j < i; ++j) {
      const BrickPlacement& other = scene.bricks[j];
      const double separation_m =
          boxSeparation(brick.T_map_brick, brick.type.size_m, other.T_map_brick, other.type.size_m);
      if (separation_m < -kOverlap_m) {
        std::ostringstream line;
        line << nameOf(brick) << " and " << nameOf(other) << " overlap by " << -separation_m << " m, must not overlap";
        faults.push_back(line.str());
      }
    }
  }
  for (std::size_t w = 0; w < scene.walls.size(); ++w) {
    for (const BrickPlacement& brick : scene.bricks) {
      const double separation_m =
          boxSeparation(brick.T_map_brick, brick.type.size_m, scene.walls[w].pose(), scene.walls[w].size_m);
      if (separation_m < -kOverlap_m) {
        std::ostringstream line;
        line << nameOf(brick) << " and walls[" << w << "] overlap by " << -separation_m << " m, must not overlap";
        faults.push_back(line.str());
      }
    }
  }
  return faults;
}

/// Of a scene [m], rad: generous, to catch what is not finite.
constexpr double kMaxCenter_m = 1000.0;
constexpr double kMostTurn_rad = 100.0;

std::vector<std::string> typeProblems(const std::string& key, const BrickType& type) {
  interactive_mapping::RangeCheck check(key + "/");
  check("size_m", type.size_m.allFinite() ? type.size_m.minCoeff() : type.size_m.sum(), 0.001, 10.0, "m");
  check("mass_kg", type.mass_kg, 0.001, 1000.0, "kg");
  check("friction", type.friction, 0.001, 100.0, "");
  return check.problems();
}

/// Adds the bricks of the heaps; of each the number of its heap. Throws std::invalid_argument if a heap does not fit.
std::vector<std::size_t> addHeaps(const PileSceneConfig& config, const std::string& what, SeededRandom& random,
                                  std::vector<BrickPlacement>* bricks) {
  std::vector<std::string> faults;
  std::vector<std::size_t> heap_of;
  for (std::size_t h = 0; h < config.heaps.size(); ++h) {
    const HeapConfig& heap = config.heaps[h];
    const std::optional<std::vector<Cell>> cells = fillHeap(config, heap);
    if (!cells) {
      std::ostringstream line;
      line << "heaps[" << h << "] = " << heap.bricks << " bricks, must fit into " << heap.layers << " layers within "
           << heap.extent_m.transpose() << " m";
      faults.push_back(line.str());
      continue;
    }
    const Eigen::Vector2d span_m = spanOf(*cells, config.brick.size_m);
    if ((span_m - kLeastSpan * heap.extent_m).minCoeff() < 0.0) {
      std::ostringstream line;
      line << "heaps[" << h << "] = " << heap.bricks << " bricks in " << heap.layers << " layers, must span "
           << 100.0 * kLeastSpan << " % of " << heap.extent_m.transpose() << " m, span " << span_m.transpose() << " m";
      faults.push_back(line.str());
      continue;
    }
    const Eigen::Isometry3d T_map_heap =
        synthetic_depth::poseFromXyzRpy({heap.center_m.x(), heap.center_m.y(), 0.0}, {0.0, 0.0, heap.yaw_rad});
    for (const Cell& cell : *cells) {
      const double z_m = (cell.layer + 0.5) * config.brick.size_m.z() + (cell.layer + 1) * config.drop_gap_m;
      const Eigen::Isometry3d T_heap_brick = synthetic_depth::poseFromXyzRpy(
          {cell.center_m.x(), cell.center_m.y(), z_m}, {0.0, 0.0, cell.is_crosswise ? 0.5 * M_PI : 0.0});
      bricks->push_back({0, config.brick, T_map_heap * jittered(T_heap_brick, config, random)});
      heap_of.push_back(h);
    }
  }
  interactive_mapping::refuseIfAny(what + ":", faults);
  return heap_of;
}

}  // namespace

std::vector<std::string> faultsOfStart(const PileScene& scene, double min_robot_distance_m) {
  constexpr double kWallDistance_m = 1.0;  // the base turns on the spot, with the arm stowed
  std::vector<std::string> faults;
  const auto report = [&faults](double distance_m, const char* what, double least_m) {
    if (distance_m >= least_m) return;
    std::ostringstream line;
    line << "robot_start/xy_m is " << distance_m << " m from a " << what << ", must be at least " << least_m
         << " m away";
    faults.push_back(line.str());
  };
  double nearest_m = std::numeric_limits<double>::infinity();
  for (const BrickPlacement& brick : scene.bricks) {
    nearest_m = std::min(nearest_m, distanceTo(scene.robot_start.xy_m, brick));
  }
  report(nearest_m, "brick", min_robot_distance_m);
  for (const Wall& wall : scene.walls) {
    const Eigen::Vector2d p_wall = Eigen::Rotation2Dd(-wall.yaw_rad) * (scene.robot_start.xy_m - wall.center_m);
    const Eigen::Vector2d excess_m = p_wall.cwiseAbs() - 0.5 * wall.size_m.head<2>();
    report(excess_m.cwiseMax(0.0).norm(), "wall", kWallDistance_m);
  }
  return faults;
}

std::vector<std::string> HeapConfig::validate() const {
  interactive_mapping::RangeCheck check;
  check("center_m", center_m.allFinite() ? center_m.cwiseAbs().maxCoeff() : center_m.sum(), 0.0, kMaxCenter_m, "m");
  check("yaw_rad", yaw_rad, -kMostTurn_rad, kMostTurn_rad, "rad");
  check("extent_m", extent_m.allFinite() ? extent_m.minCoeff() : extent_m.sum(), 0.001, kMaxCenter_m, "m");
  check("bricks", bricks, 1, 10000, "");
  check("layers", layers, 1, bricks, "");
  return check.problems();
}

std::vector<std::string> TippedConfig::validate() const {
  interactive_mapping::RangeCheck check;
  check("center_m", center_m.allFinite() ? center_m.cwiseAbs().maxCoeff() : center_m.sum(), 0.0, kMaxCenter_m, "m");
  check("yaw_rad", yaw_rad, -kMostTurn_rad, kMostTurn_rad, "rad");
  check("extent_m", extent_m.allFinite() ? extent_m.minCoeff() : extent_m.sum(), 0.001, kMaxCenter_m, "m");
  check("bricks", bricks, 1, 10000, "");
  check("drop_height_m", drop_height_m, 0.01, 5.0, "m");
  return check.problems();
}

std::vector<std::string> StackConfig::validate() const {
  interactive_mapping::RangeCheck check;
  check("center_m", center_m.allFinite() ? center_m.cwiseAbs().maxCoeff() : center_m.sum(), 0.0, kMaxCenter_m, "m");
  check("yaw_rad", yaw_rad, -kMostTurn_rad, kMostTurn_rad, "rad");
  check("bricks", bricks, 2, 10, "");
  std::vector<std::string> problems = check.problems();
  if (!(overhang >= 0.0 && overhang * bricks < 1.0)) {
    problems.push_back("overhang = " + std::to_string(overhang) + ", must be in [0, 1 / bricks), or the stack falls");
  }
  return problems;
}

Eigen::Isometry3d Wall::pose() const {
  return synthetic_depth::poseFromXyzRpy({center_m.x(), center_m.y(), 0.5 * size_m.z()}, {0.0, 0.0, yaw_rad});
}

std::vector<std::string> Wall::validate() const {
  interactive_mapping::RangeCheck check;
  check("center_m", center_m.allFinite() ? center_m.cwiseAbs().maxCoeff() : center_m.sum(), 0.0, kMaxCenter_m, "m");
  check("yaw_rad", yaw_rad, -kMostTurn_rad, kMostTurn_rad, "rad");
  check("size_m (least)", size_m.allFinite() ? size_m.minCoeff() : size_m.sum(), 0.01, 100.0, "m");
  check("size_m (most)", size_m.allFinite() ? size_m.maxCoeff() : size_m.sum(), 0.01, 100.0, "m");
  return check.problems();
}

DecoyConfig DecoyConfig::fromShare(double share, int bricks) {
  const int total = static_cast<int>(std::lround(share * bricks));
  DecoyConfig config;
  config.untagged = (total + 3) / 4;
  config.heavy = (total + 2) / 4;
  config.two_plates = (total + 1) / 4;
  config.wedged = total / 4;
  return config;
}

std::vector<std::string> DecoyConfig::validate() const {
  interactive_mapping::RangeCheck check;
  check("untagged", untagged, 0, 10000, "");
  check("heavy", heavy, 0, 10000, "");
  check("two_plates", two_plates, 0, 10000, "");
  check("wedged", wedged, 0, 10000, "");
  check("heavy_mass_kg", heavy_mass_kg, 0.001, 1000.0, "kg");
  check("cardboard", cardboard, 0, 10000, "");
  check("sphere", sphere, 0, 10000, "");
  check("cylinder", cylinder, 0, 10000, "");
  std::vector<std::string> problems = check.problems();
  if (wedged > heavy) {
    problems.push_back("wedged = " + std::to_string(wedged) + ", must be at most heavy = " + std::to_string(heavy) +
                       ": each lies under a heavy one of its own");
  }
  return problems;
}

std::vector<BrickType> PileSceneConfig::typesOf(const TippedConfig& heap) const {
  return heap.types.empty() ? std::vector<BrickType>{brick} : heap.types;
}

int PileSceneConfig::numBricks() const {
  auto total = static_cast<int>(bricks.size());
  for (const HeapConfig& heap : heaps) total += heap.bricks;
  for (const TippedConfig& heap : tipped) total += heap.bricks;
  for (const StackConfig& stack : stacks) total += stack.bricks;
  return total;
}

std::vector<std::string> PileSceneConfig::validate() const {
  std::vector<std::string> problems;
  const auto add = [&](const std::string& section, const std::vector<std::string>& of_section) {
    for (const std::string& problem : of_section) problems.push_back(section + problem);
  };
  const bool is_generated = !heaps.empty() || !tipped.empty() || !stacks.empty();
  if (is_generated) add("", typeProblems("brick", brick));
  for (std::size_t i = 0; i < heaps.size(); ++i) {
    add("heaps[" + std::to_string(i) + "]/", heaps[i].validate());
  }
  for (std::size_t i = 0; i < tipped.size(); ++i) {
    const std::string key = "tipped[" + std::to_string(i) + "]/";
    add(key, tipped[i].validate());
    const std::vector<BrickType> types = typesOf(tipped[i]);
    for (const BrickType& type : types) add(key, typeProblems("brick_types, " + type.name, type));
    const double turned_m = longestDiagonal(types);
    if (!(tipped[i].extent_m.minCoeff() >= turned_m)) {
      problems.push_back(key + "extent_m, must be at least " + std::to_string(turned_m) +
                         " m, a brick's longest diagonal, on each side");
    }
  }
  for (std::size_t i = 0; i < stacks.size(); ++i) {
    add("stacks[" + std::to_string(i) + "]/", stacks[i].validate());
  }
  for (std::size_t i = 0; i < walls.size(); ++i) {
    add("walls[" + std::to_string(i) + "]/", walls[i].validate());
  }
  add("decoys/", decoys.validate());
  if (decoys.total() > numBricks()) {
    problems.push_back("decoys = " + std::to_string(decoys.total()) + ", must be at most " +
                       std::to_string(numBricks()) + ", the number of bricks");
  }
  if (decoys.wedged > 0 && (tipped.empty() || 2 * decoys.wedged > tipped.front().bricks)) {
    problems.push_back("decoys/wedged = " + std::to_string(decoys.wedged) +
                       ", must be at most half of the bricks of the first of tipped");
  }
  std::set<int> ids;
  for (const BrickPlacement& placement : bricks) {
    const std::string key = "bricks, id " + std::to_string(placement.id);
    add("", typeProblems(key, placement.type));
    if (placement.id < 0 || !ids.insert(placement.id).second) problems.push_back(key + ", must be unique and >= 0");
    if (!placement.T_map_brick.matrix().allFinite()) problems.push_back(key + ", must be at a finite pose");
  }
  if (is_generated != bricks.empty()) {
    problems.push_back("heaps = " + std::to_string(heaps.size()) +
                       ", must be given, or tipped or stacks, or bricks, but not both");
  }
  interactive_mapping::RangeCheck check;
  check("position_jitter_m", position_jitter_m, 0.0, 0.1, "m");
  check("yaw_jitter_rad", yaw_jitter_rad, 0.0, M_PI / 4.0, "rad");
  check("drop_gap_m", drop_gap_m, 1e-6, 0.1, "m");
  const Eigen::Vector2d& xy_m = robot_start.xy_m;
  check("robot_start/xy_m", xy_m.allFinite() ? xy_m.cwiseAbs().maxCoeff() : xy_m.sum(), 0.0, kMaxCenter_m, "m");
  check("robot_start/yaw_rad", robot_start.yaw_rad, -kMostTurn_rad, kMostTurn_rad, "rad");
  check("min_robot_distance_m", min_robot_distance_m, 2.5, kMaxCenter_m, "m");
  check("max_shift_m", max_shift_m, 1e-6, 100.0, "m");
  add("", check.problems());
  return problems;
}

PileScene generateScene(const PileSceneConfig& config, std::uint64_t seed) {
  const std::string what = "scene " + config.name;
  interactive_mapping::refuseIfAny(what + ":", config.validate());
  PileScene scene;
  scene.name = config.name;
  scene.seed = seed;
  scene.heaps = config.heaps;
  scene.walls = config.walls;
  scene.has_tipped = !config.tipped.empty();
  scene.max_shift_m = config.max_shift_m;
  scene.has_tags = config.has_tags;
  scene.robot_start = config.robot_start;
  SeededRandom random(seed);
  // And beyond the heaps: the tipped ones, the stacks.
  std::vector<std::size_t> heap_of = addHeaps(config, what, random, &scene.bricks);
  const auto append = [&](const std::vector<BrickPlacement>& bricks, std::size_t group) {
    scene.bricks.insert(scene.bricks.end(), bricks.begin(), bricks.end());
    heap_of.resize(scene.bricks.size(), group);
  };
  const std::size_t tipped_group = config.heaps.size();
  const std::size_t stack_group = tipped_group + 1;
  for (std::size_t t = 0; t < config.tipped.size(); ++t) {
    append(tippedBricks(config.tipped[t], config.typesOf(config.tipped[t]), t == 0 ? config.decoys.wedged : 0,
                        config.decoys.heavy_mass_kg, config.drop_gap_m, random),
           tipped_group);
  }
  for (const StackConfig& stack : config.stacks) {
    append(stackedBricks(stack, config.brick, config.drop_gap_m), stack_group);
  }
  // Which id is where must not give away what lies on top.
  for (std::size_t i = scene.bricks.size(); i > 1; --i) {
    const auto k = static_cast<std::size_t>(random.uniform() * static_cast<double>(i));
    std::swap(scene.bricks[i - 1], scene.bricks[k]);
    std::swap(heap_of[i - 1], heap_of[k]);
  }
  scene.heap_ids.resize(config.heaps.size());
  for (std::size_t i = 0; i < scene.bricks.size(); ++i) {
    scene.bricks[i].id = static_cast<int>(i);
    if (heap_of[i] < config.heaps.size()) scene.heap_ids[heap_of[i]].push_back(static_cast<int>(i));
    if (heap_of[i] == stack_group) scene.stack_ids.push_back(static_cast<int>(i));
  }
  for (BrickPlacement placement : config.bricks) {
    placement.T_map_brick = jittered(placement.T_map_brick, config, random);
    scene.bricks.push_back(placement);
  }
  std::sort(scene.bricks.begin(), scene.bricks.end(),
            [](const BrickPlacement& a, const BrickPlacement& b) { return a.id < b.id; });
  drawDecoys(config.decoys, &scene.bricks, random);
  std::vector<std::string> impossible = faultsOf(scene);
  for (const std::string& fault : faultsOfStart(scene, config.min_robot_distance_m)) impossible.push_back(fault);
  interactive_mapping::refuseIfAny(what + ":", impossible);
  return scene;
}

}  // namespace simulated_world
