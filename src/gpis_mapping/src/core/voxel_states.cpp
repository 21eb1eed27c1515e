// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/voxel_states.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <unordered_set>

#include <interactive_mapping_common/formatted.h>

namespace gpis_mapping {
namespace {

using Keys = std::unordered_set<LatticeKey, LatticeKeyHash>;
using interactive_mapping::formatted;

constexpr Eigen::Index kBatch = 1 << 16;  // points asked at once: their answers take some 10 MB

/// Cells in which the state of a point depends on more than the layer of observed space.
Keys cellsNearSurfaces(const MapSnapshot& snapshot) {
  const GpisConfig& config = snapshot.config();
  // A surface reaches half a spacing beyond its points, and points stray out of their cell by a quarter.
  const double reach_m =
      std::max({config.query.occupied_depth_m, MapSnapshot::kFreeReach_blocks * snapshot.observed().blockSize(),
                config.surface.blend_radius_m}) +
      config.surface.spacing_m;
  const int steps = static_cast<int>(std::ceil(reach_m / config.cells.size_m));
  Keys near;
  for (const auto& [key, cell] : snapshot.cells()) {
    if (cell->numOwn() == 0) continue;
    for (int dx = -steps; dx <= steps; ++dx) {
      for (int dy = -steps; dy <= steps; ++dy) {
        for (int dz = -steps; dz <= steps; ++dz) near.insert(key.offset(dx, dy, dz));
      }
    }
  }
  return near;
}

/// Calls fn(block) for each block that was seen free.
template <typename Function>
void forEachFreeBlock(const ObservedLayer& observed, const Function& fn) {
  constexpr int kSide = ObservedLayer::kChunkBlocks;
  for (const auto& [key, chunk] : observed.chunks()) {
    for (std::size_t i = 0; i < chunk->size(); ++i) {
      if ((*chunk)[i] == ObservedLayer::kNever) continue;
      const int in_chunk = static_cast<int>(i);
      fn(LatticeKey{key.x * kSide + in_chunk % kSide, key.y * kSide + in_chunk / kSide % kSide,
                    key.z * kSide + in_chunk / (kSide * kSide)});
    }
  }
}

/// Calls fn(voxel, centre) for each voxel whose centre may lie in [low, high]; rounding may bring neighbours along.
template <typename Function>
void forEachVoxel(const Eigen::Vector3d& low, const Eigen::Vector3d& high, double size_m, const Function& fn) {
  const LatticeKey first = LatticeKey::of(low, size_m);
  const LatticeKey last = LatticeKey::of(high, size_m);
  for (int x = first.x; x <= last.x; ++x) {
    for (int y = first.y; y <= last.y; ++y) {
      for (int z = first.z; z <= last.z; ++z) {
        const LatticeKey voxel{x, y, z};
        fn(voxel, voxel.center(size_m));
      }
    }
  }
}

}  // namespace

double shellDepth(const GpisConfig& config, double size_m) {
  return 0.5 * std::min(config.surface.spacing_m, size_m);
}

VoxelStates classifyVoxels(const MapSnapshot& snapshot, double size_m, std::size_t max_voxels) {
  if (!(size_m >= 0.005 && size_m <= 10.0)) {
    throw std::invalid_argument(formatted("voxel size = %g m, must be in [0.005, 10] m", size_m));
  }
  const GpisConfig& config = snapshot.config();
  const ObservedLayer& observed = snapshot.observed();
  const Keys near = cellsNearSurfaces(snapshot);
  std::size_t num_blocks = 0;
  forEachFreeBlock(observed, [&](const LatticeKey&) { ++num_blocks; });
  const double expected = static_cast<double>(near.size()) * std::pow(config.cells.size_m / size_m, 3) +
                          static_cast<double>(num_blocks) * std::pow(observed.blockSize() / size_m, 3);
  if (expected > static_cast<double>(max_voxels)) {
    throw std::invalid_argument(
        formatted("voxels of %g m would be about %.0f, must be at most %.0f: choose larger ones", size_m, expected,
                  static_cast<double>(max_voxels)));
  }

  VoxelStates states;
  states.size_m = size_m;
  Keys occupied;
  const double depth_m = shellDepth(config, size_m);
  for (const auto& [key, cell] : snapshot.cells()) {
    for (std::size_t i = 0; i < cell->numOwn(); ++i) {
      occupied.insert(LatticeKey::of(cell->position(i) - depth_m * cell->normal(i).cast<double>(), size_m));
    }
  }

  std::vector<LatticeKey> asked;
  asked.reserve(kBatch);
  Points3d centres(3, kBatch);
  QueryOptions options;
  options.variance = false;
  const auto ask = [&] {
    const auto count = static_cast<Eigen::Index>(asked.size());
    if (count == 0) return;
    for (Eigen::Index i = 0; i < count; ++i) centres.col(i) = asked[static_cast<std::size_t>(i)].center(size_m);
    const QueryResult answers = snapshot.query(centres.leftCols(count), options);
    for (std::size_t i = 0; i < asked.size(); ++i) {
      if (answers.state[i] == SpaceState::kOccupied) occupied.insert(asked[i]);
      if (answers.state[i] == SpaceState::kFree) states.free.push_back(asked[i]);
    }
    asked.clear();
  };
  for (const LatticeKey& cell : near) {
    forEachVoxel(config.cells.corner(cell), config.cells.corner(cell.offset(1, 1, 1)), size_m,
                 [&](const LatticeKey& voxel, const Eigen::Vector3d& centre) {
                   if (!(config.cells.at(centre) == cell)) return;
                   asked.push_back(voxel);
                   if (asked.size() == static_cast<std::size_t>(kBatch)) ask();
                 });
  }
  ask();
  // Far from all surfaces the layer of observed space alone decides.
  forEachFreeBlock(observed, [&](const LatticeKey& block) {
    forEachVoxel(block.corner(observed.blockSize()), block.offset(1, 1, 1).corner(observed.blockSize()), size_m,
                 [&](const LatticeKey& voxel, const Eigen::Vector3d& centre) {
                   if (!(LatticeKey::of(centre, observed.blockSize()) == block)) return;
                   if (near.count(config.cells.at(centre)) == 0) states.free.push_back(voxel);
                 });
  });
  states.free.erase(std::remove_if(states.free.begin(), states.free.end(),
                                   [&](const LatticeKey& voxel) { return occupied.count(voxel) > 0; }),
                    states.free.end());
  states.occupied.assign(occupied.begin(), occupied.end());
  return states;
}

}  // namespace gpis_mapping
