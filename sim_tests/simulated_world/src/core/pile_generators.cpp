// SPDX-License-Identifier: BSD-3-Clause
#include "pile_generators.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "synthetic_depth/scene.h"

namespace simulated_world {
namespace {

using synthetic_depth::SeededRandom;

std::size_t pick(std::size_t count, SeededRandom& random) {
  return static_cast<std::size_t>(random.uniform() * static_cast<double>(count));
}

template <typename T>
void shuffle(std::vector<T>& items, SeededRandom& random) {
  for (std::size_t i = items.size(); i > 1; --i) std::swap(items[i - 1], items[pick(i, random)]);
}

void makeHeavy(BrickPlacement* brick, double mass_kg) {
  brick->type.mass_kg = mass_kg;
  brick->decoy = Decoy::kHeavy;
}

/// Makes another body of a brick, without plates. It keeps the mass.
void makeForeign(BrickPlacement* brick, Decoy kind, const Eigen::Vector3d& size_m, const Eigen::Vector3d& color_rgb) {
  brick->decoy = kind;
  brick->type.size_m = size_m;
  brick->type.color_rgb = color_rgb;
  brick->type.plate_faces.clear();
  brick->type.plate_edge_m = size_m.minCoeff();
}

}  // namespace

double longestDiagonal(const std::vector<BrickType>& types) {
  double longest_m = 0.0;
  for (const BrickType& type : types) longest_m = std::max(longest_m, type.size_m.norm());
  return longest_m;
}

// Shoemake, "Uniform random rotations", Graphics Gems III, 1992.
Eigen::Matrix3d anyOrientation(SeededRandom& random) {
  const double u = random.uniform();
  const double a = random.uniform(0.0, 2.0 * M_PI);
  const double b = random.uniform(0.0, 2.0 * M_PI);
  const double low = std::sqrt(1.0 - u);
  const double high = std::sqrt(u);
  return Eigen::Quaterniond(high * std::cos(b), low * std::sin(a), low * std::cos(a), high * std::sin(b))
      .normalized()
      .toRotationMatrix();
}

std::vector<BrickPlacement> tippedBricks(const TippedConfig& config, const std::vector<BrickType>& types, int wedged,
                                         double heavy_mass_kg, double gap_m, SeededRandom& random) {
  // Each brick has a cell that holds it whichever way it is turned, and somewhere in it its place.
  const double turned_m = longestDiagonal(types);
  const Eigen::Array2i counts = (config.extent_m.array() / turned_m + 1e-9).floor().cast<int>();
  const Eigen::Vector2d cell_m = config.extent_m.array() / counts.cast<double>();
  const Eigen::Isometry3d T_map_heap =
      synthetic_depth::poseFromXyzRpy({config.center_m.x(), config.center_m.y(), 0.0}, {0.0, 0.0, config.yaw_rad});
  std::vector<BrickPlacement> bricks;
  std::vector<Eigen::Vector2i> free;
  const auto next = [&](bool* is_new_layer) {
    *is_new_layer = free.empty();
    if (free.empty()) {
      for (int i = 0; i < counts.x(); ++i) {
        for (int j = 0; j < counts.y(); ++j) free.emplace_back(i, j);
      }
      shuffle(free, random);
    }
    const Eigen::Vector2i cell = free.back();
    free.pop_back();
    const Eigen::Vector2d play_m = 0.5 * (cell_m.array() - turned_m);
    const Eigen::Vector2d middle_m =
        (cell.cast<double>().array() + 0.5).matrix().cwiseProduct(cell_m) - 0.5 * config.extent_m;
    return Eigen::Vector2d(middle_m.x() + random.uniform(-play_m.x(), play_m.x()),
                           middle_m.y() + random.uniform(-play_m.y(), play_m.y()));
  };

  bool is_new_layer = false;
  double base_m = config.drop_height_m;
  for (int i = 0; i < wedged; ++i) {
    const Eigen::Vector2d xy_m = next(&is_new_layer);
    if (is_new_layer && i > 0) {
      throw std::invalid_argument("tipped/extent_m has no room for " + std::to_string(wedged) + " wedged bricks");
    }
    const double yaw_rad = random.uniform(-M_PI, M_PI);
    const double half_m = 0.5 * types.front().size_m.z();
    BrickPlacement below{0, types.front(), {}, Decoy::kWedged};
    below.T_map_brick = T_map_heap * synthetic_depth::poseFromXyzRpy({xy_m.x(), xy_m.y(), half_m}, {0.0, 0.0, yaw_rad});
    BrickPlacement lid{0, types.front(), {}};
    makeHeavy(&lid, heavy_mass_kg);
    lid.T_map_brick = T_map_heap * synthetic_depth::poseFromXyzRpy({xy_m.x(), xy_m.y(), 3.0 * half_m + gap_m},
                                                                   {0.0, 0.0, yaw_rad + 0.5 * M_PI});
    bricks.push_back(below);
    bricks.push_back(lid);
    base_m = std::max(base_m, 4.0 * half_m + 2.0 * gap_m);
  }
  free.clear();
  int layer = -1;
  while (static_cast<int>(bricks.size()) < config.bricks) {
    const Eigen::Vector2d xy_m = next(&is_new_layer);
    layer += is_new_layer ? 1 : 0;
    BrickPlacement brick{0, types[bricks.size() % types.size()], {}};
    Eigen::Isometry3d T_heap_brick = Eigen::Isometry3d::Identity();
    T_heap_brick.translation() << xy_m.x(), xy_m.y(), base_m + (layer + 0.5) * turned_m;
    T_heap_brick.linear() = anyOrientation(random);
    brick.T_map_brick = T_map_heap * T_heap_brick;
    bricks.push_back(brick);
  }
  return bricks;
}

std::vector<BrickPlacement> stackedBricks(const StackConfig& config, const BrickType& type, double gap_m) {
  const Eigen::Isometry3d T_map_stack =
      synthetic_depth::poseFromXyzRpy({config.center_m.x(), config.center_m.y(), 0.0}, {0.0, 0.0, config.yaw_rad});
  std::vector<BrickPlacement> bricks;
  for (int i = 0; i < config.bricks; ++i) {
    BrickPlacement brick{0, type, {}};
    brick.T_map_brick = T_map_stack;
    brick.T_map_brick.translate(
        Eigen::Vector3d(i * config.overhang * type.size_m.x(), 0.0, (i + 0.5) * type.size_m.z() + i * gap_m));
    bricks.push_back(brick);
  }
  return bricks;
}

void drawDecoys(const DecoyConfig& config, std::vector<BrickPlacement>* bricks, SeededRandom& random) {
  if (config.total() == 0) return;
  std::vector<BrickPlacement*> plain;
  for (BrickPlacement& brick : *bricks) {
    if (brick.decoy == Decoy::kNone) plain.push_back(&brick);
  }
  shuffle(plain, random);
  const auto take = [&plain] {
    BrickPlacement* brick = plain.back();
    plain.pop_back();
    return brick;
  };
  for (int i = 0; i < config.untagged; ++i) {
    BrickPlacement* brick = take();
    brick->decoy = Decoy::kUntagged;
    brick->type.plate_faces.clear();
  }
  for (int i = config.wedged; i < config.heavy; ++i) makeHeavy(take(), config.heavy_mass_kg);
  for (int i = 0; i < config.two_plates; ++i) {
    BrickPlacement* brick = take();
    brick->decoy = Decoy::kTwoPlates;
    shuffle(brick->type.plate_faces, random);
    if (brick->type.plate_faces.size() > 2) brick->type.plate_faces.resize(2);
  }
  // The cell of a shipped brick holds each of these in any orientation. Their sizes differ from those of all types.
  for (int i = 0; i < config.cardboard; ++i) {
    makeForeign(take(), Decoy::kCardboard, {0.24, 0.24, 0.2}, {0.71, 0.55, 0.36});
  }
  for (int i = 0; i < config.sphere; ++i) makeForeign(take(), Decoy::kSphere, {0.2, 0.2, 0.2}, {0.55, 0.55, 0.52});
  for (int i = 0; i < config.cylinder; ++i) {
    makeForeign(take(), Decoy::kCylinder, {0.16, 0.16, 0.26}, {0.3, 0.42, 0.35});
  }
}

}  // namespace simulated_world
