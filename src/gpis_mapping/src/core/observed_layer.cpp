// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/observed_layer.h"

#include <algorithm>

#include <interactive_mapping_common/threads/parallel_for.h>

namespace gpis_mapping {
namespace {

using interactive_mapping::parallelFor;

constexpr float kNoInformation = std::numeric_limits<float>::infinity();
constexpr int kBaseLevel = 2;  // the finest level kept: 4 x 4 pixels
// Dropouts among those 16 pixels that are speckle: their neighbours see past the block as well as they would.
constexpr int kMaxDropouts = 2;

/// Nearest surface (largest inverse range) over squares of 2^level pixels; infinite where a pixel has no information.
struct NearestPyramid {
  struct Level {
    int width;
    int height;
    std::vector<float> nearest;
  };
  std::vector<Level> levels;

  explicit NearestPyramid(const ClassifiedFrame& frame) {
    const int block = 1 << kBaseLevel;
    Level base{(frame.width + block - 1) / block, (frame.height + block - 1) / block, {}};
    base.nearest.assign(static_cast<std::size_t>(base.width) * base.height, 0.0f);
    std::vector<std::uint8_t> unknown(base.nearest.size(), 0);
    for (int v = 0; v < frame.height; ++v) {
      const std::size_t row = static_cast<std::size_t>(v >> kBaseLevel) * base.width;
      for (int u = 0; u < frame.width; ++u) {
        const std::size_t i = frame.index(u, v);
        const std::size_t cell = row + (u >> kBaseLevel);
        if (isMeasured(frame.kind[i])) {
          base.nearest[cell] = std::max(base.nearest[cell], frame.inverse_range[i]);
        } else if (frame.clear_to[i] > 0.0f) {
          base.nearest[cell] = std::max(base.nearest[cell], frame.clear_to[i]);
        } else {
          ++unknown[cell];
        }
      }
    }
    for (std::size_t cell = 0; cell < unknown.size(); ++cell) {
      if (unknown[cell] > kMaxDropouts) base.nearest[cell] = kNoInformation;
    }
    levels.push_back(std::move(base));
    while (levels.back().width > 1 && levels.back().height > 1) {
      const Level& fine = levels.back();
      Level coarse{(fine.width + 1) / 2, (fine.height + 1) / 2, {}};
      coarse.nearest.assign(static_cast<std::size_t>(coarse.width) * coarse.height, 0.0f);
      for (int v = 0; v < fine.height; ++v) {
        for (int u = 0; u < fine.width; ++u) {
          float& cell = coarse.nearest[static_cast<std::size_t>(v / 2) * coarse.width + u / 2];
          cell = std::max(cell, fine.nearest[static_cast<std::size_t>(v) * fine.width + u]);
        }
      }
      levels.push_back(std::move(coarse));
    }
  }

  /// Nearest surface within `radius_px` of (u, v); the square must lie inside the image.
  float around(double u, double v, double radius_px) const {
    const double diameter = 2.0 * radius_px + 1.0;
    int level = 0;
    while (3 * (1 << (kBaseLevel + level)) < diameter && level + 1 < static_cast<int>(levels.size())) ++level;
    const Level& grid = levels[level];
    const int shift = kBaseLevel + level;
    const auto clampTo = [](int i, int size) { return std::max(0, std::min(size - 1, i)); };
    const int u0 = clampTo(static_cast<int>(u - radius_px) >> shift, grid.width);
    const int u1 = clampTo(static_cast<int>(u + radius_px) >> shift, grid.width);
    const int v0 = clampTo(static_cast<int>(v - radius_px) >> shift, grid.height);
    const int v1 = clampTo(static_cast<int>(v + radius_px) >> shift, grid.height);
    float nearest = 0.0f;
    for (int j = v0; j <= v1; ++j) {
      for (int i = u0; i <= u1; ++i) {
        nearest = std::max(nearest, grid.nearest[static_cast<std::size_t>(j) * grid.width + i]);
      }
    }
    return nearest;
  }
};

}  // namespace

ObservedLayer::ObservedLayer(const ObservedLayer& other)
    : block_size_m_(other.block_size_m_), chunks_(other.chunks_), private_chunks_(other.private_chunks_) {
  for (const LatticeKey& key : private_chunks_) {
    std::shared_ptr<Chunk>& chunk = chunks_.at(key);
    chunk = std::make_shared<Chunk>(*chunk);
  }
}

ObservedLayer& ObservedLayer::operator=(const ObservedLayer& other) {
  return *this = ObservedLayer(other);  // by move
}

ObservedLayer ObservedLayer::share() {
  private_chunks_.clear();
  ObservedLayer copy(block_size_m_);
  copy.chunks_ = chunks_;
  return copy;
}

ObservedLayer::Chunk& ObservedLayer::writable(const LatticeKey& key) {
  std::shared_ptr<Chunk>& chunk = chunks_[key];
  if (private_chunks_.insert(key).second) {
    if (chunk) {
      chunk = std::make_shared<Chunk>(*chunk);
    } else {
      chunk = std::make_shared<Chunk>();
      chunk->fill(kNever);
    }
  }
  return *chunk;
}

void ObservedLayer::observe(const ClassifiedFrame& frame, const CameraModel& camera,
                            const Eigen::Isometry3d& T_map_camera, double max_range_m, float stamp_s, int num_threads) {
  const NearestPyramid pyramid(frame);
  const double chunk_size = block_size_m_ * kChunkBlocks;
  const Eigen::Isometry3d T_camera_map = T_map_camera.inverse();
  // Chunks touched by the frustum's bounding box.
  Eigen::AlignedBox3d box(T_map_camera.translation());
  for (const double u : {0.0, camera.width - 1.0}) {
    for (const double v : {0.0, camera.height - 1.0}) {
      const Eigen::Vector3d ray((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
      box.extend(T_map_camera * (ray * max_range_m));
    }
  }
  // Only what is within range can be marked; a wide image's corners are many times as far.
  const Eigen::Vector3d reach = Eigen::Vector3d::Constant(max_range_m);
  box = box.intersection(Eigen::AlignedBox3d(T_map_camera.translation() - reach, T_map_camera.translation() + reach));
  const LatticeKey low = LatticeKey::of(box.min(), chunk_size);
  const LatticeKey high = LatticeKey::of(box.max(), chunk_size);
  std::vector<LatticeKey> keys;
  const double chunk_radius = 0.5 * std::sqrt(3.0) * chunk_size;
  const double slope_u = std::max(camera.cx, camera.width - camera.cx) / camera.fx;
  const double slope_v = std::max(camera.cy, camera.height - camera.cy) / camera.fy;
  for (LatticeKey key = low; key.x <= high.x; ++key.x) {
    for (key.y = low.y; key.y <= high.y; ++key.y) {
      for (key.z = low.z; key.z <= high.z; ++key.z) {
        const Eigen::Vector3d c = T_camera_map * key.center(chunk_size);
        if (c.z() < -chunk_radius || c.norm() > max_range_m + chunk_radius) continue;
        // Distance to the frustum's side planes, by the widest half angle on either side.
        if (std::abs(c.x()) - slope_u * c.z() > chunk_radius * std::hypot(1.0, slope_u)) continue;
        if (std::abs(c.y()) - slope_v * c.z() > chunk_radius * std::hypot(1.0, slope_v)) continue;
        keys.push_back(key);
      }
    }
  }
  const double radius = 0.6 * block_size_m_;  // between the inscribed and the circumscribed sphere
  std::vector<std::vector<std::uint16_t>> free_blocks(keys.size());
  parallelFor(keys.size(), num_threads, 4, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Eigen::Vector3d first =
          T_camera_map * (keys[i].corner(chunk_size) + Eigen::Vector3d::Constant(0.5 * block_size_m_));
      const Eigen::Matrix3d step = block_size_m_ * T_camera_map.linear();
      for (int z = 0; z < kChunkBlocks; ++z) {
        for (int y = 0; y < kChunkBlocks; ++y) {
          Eigen::Vector3d p = first + y * step.col(1) + z * step.col(2);
          for (int x = 0; x < kChunkBlocks; ++x, p += step.col(0)) {
            if (p.z() < radius) continue;
            const double inverse_z = 1.0 / p.z();
            const double u = camera.fx * p.x() * inverse_z + camera.cx;
            const double v = camera.fy * p.y() * inverse_z + camera.cy;
            const double radius_px = radius * std::max(camera.fx, camera.fy) * inverse_z;
            if (u < radius_px || v < radius_px || u > camera.width - 1 - radius_px ||
                v > camera.height - 1 - radius_px) {
              continue;
            }
            const double range = p.norm();
            if (range > max_range_m || pyramid.around(u, v, radius_px) * (range + radius) >= 1.0) continue;
            free_blocks[i].push_back(static_cast<std::uint16_t>(indexIn(x, y, z)));
          }
        }
      }
    }
  });
  for (std::size_t i = 0; i < keys.size(); ++i) {
    if (free_blocks[i].empty()) continue;
    Chunk& chunk = writable(keys[i]);
    for (const std::uint16_t index : free_blocks[i]) chunk[index] = stamp_s;
  }
}

LatticeKey ObservedLayer::locate(const Eigen::Vector3d& p_map, int* index) const {
  const LatticeKey block = LatticeKey::of(p_map, block_size_m_);
  const auto floorDivide = [](int a) { return a >= 0 ? a / kChunkBlocks : -((-a + kChunkBlocks - 1) / kChunkBlocks); };
  const LatticeKey key{floorDivide(block.x), floorDivide(block.y), floorDivide(block.z)};
  *index = indexIn(block.x - key.x * kChunkBlocks, block.y - key.y * kChunkBlocks, block.z - key.z * kChunkBlocks);
  return key;
}

void ObservedLayer::occupy(const Eigen::Vector3d& p_map) {
  int index = 0;
  const LatticeKey key = locate(p_map, &index);
  const auto found = chunks_.find(key);
  if (found != chunks_.end() && (*found->second)[index] != kNever) writable(key)[index] = kNever;
}

void ObservedLayer::setFree(const Eigen::Vector3d& p_map, float stamp_s) {
  int index = 0;
  const LatticeKey key = locate(p_map, &index);
  float& last = writable(key)[static_cast<std::size_t>(index)];
  last = std::max(last, stamp_s);
}

void ObservedLayer::forgetIf(const std::function<bool(const Eigen::Vector3d&)>& isInside) {
  const double chunk_size = kChunkBlocks * block_size_m_;
  std::vector<LatticeKey> keys;  // writable() changes chunks_
  keys.reserve(chunks_.size());
  for (const auto& entry : chunks_) keys.push_back(entry.first);
  for (const LatticeKey& key : keys) {
    const Eigen::Vector3d corner = key.corner(chunk_size);
    for (int z = 0; z < kChunkBlocks; ++z) {
      for (int y = 0; y < kChunkBlocks; ++y) {
        for (int x = 0; x < kChunkBlocks; ++x) {
          const auto index = static_cast<std::size_t>(indexIn(x, y, z));
          if ((*chunks_.at(key))[index] == kNever) continue;
          const Eigen::Vector3d center = corner + (Eigen::Array3d(x, y, z) + 0.5).matrix() * block_size_m_;
          if (isInside(center)) writable(key)[index] = kNever;
        }
      }
    }
  }
}

float ObservedLayer::lastFree(const Eigen::Vector3d& p_map) const {
  int index = 0;
  const auto found = chunks_.find(locate(p_map, &index));
  return found == chunks_.end() ? kNever : (*found->second)[index];
}

}  // namespace gpis_mapping
