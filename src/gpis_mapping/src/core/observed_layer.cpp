// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/observed_layer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <interactive_mapping_common/threads/parallel_for.h>

namespace gpis_mapping {
namespace {

using interactive_mapping::parallelFor;

constexpr float kNoInformation = std::numeric_limits<float>::infinity();
constexpr int kBaseLevel = 2;  // the finest level kept: 4 x 4 pixels
// Dropouts among those 16 pixels that are speckle: their neighbours see past the block as well as they would.
constexpr int kMaxDropouts = 2;

/// Nearest surface (largest inverse range) over squares of 2^level pixels, infinite where a pixel has no information;
/// and the least of that over the squares of the finest level.
struct NearestPyramid {
  struct Level {
    int width;
    int height;
    std::vector<float> nearest;
    std::vector<float> least;
  };
  std::vector<Level> levels;

  NearestPyramid(const ClassifiedFrame& frame, int num_threads) {
    const int block = 1 << kBaseLevel;
    Level base{(frame.width + block - 1) / block, (frame.height + block - 1) / block, {}, {}};
    base.nearest.assign(static_cast<std::size_t>(base.width) * base.height, 0.0f);
    parallelFor(static_cast<std::size_t>(base.height), num_threads, 16, [&](std::size_t begin, std::size_t end) {
      std::vector<std::uint8_t> unknown(static_cast<std::size_t>(base.width));
      for (std::size_t row = begin; row < end; ++row) {
        float* const nearest = &base.nearest[row * base.width];
        std::fill(unknown.begin(), unknown.end(), 0);
        const int first = static_cast<int>(row) * block;
        for (int v = first; v < std::min(frame.height, first + block); ++v) {
          for (int u = 0; u < frame.width; ++u) {
            const std::size_t i = frame.index(u, v);
            const std::size_t cell = static_cast<std::size_t>(u >> kBaseLevel);
            if (isMeasured(frame.kind[i])) {
              nearest[cell] = std::max(nearest[cell], frame.inverse_range[i]);
            } else if (frame.clear_to[i] > 0.0f) {
              nearest[cell] = std::max(nearest[cell], frame.clear_to[i]);
            } else {
              ++unknown[cell];
            }
          }
        }
        for (std::size_t cell = 0; cell < unknown.size(); ++cell) {
          if (unknown[cell] > kMaxDropouts) nearest[cell] = kNoInformation;
        }
      }
    });
    base.least = base.nearest;
    levels.push_back(std::move(base));
    while (levels.back().width > 1 && levels.back().height > 1) {
      const Level& fine = levels.back();
      Level coarse{(fine.width + 1) / 2, (fine.height + 1) / 2, {}, {}};
      coarse.nearest.assign(static_cast<std::size_t>(coarse.width) * coarse.height, 0.0f);
      coarse.least.assign(coarse.nearest.size(), kNoInformation);
      for (int v = 0; v < fine.height; ++v) {
        for (int u = 0; u < fine.width; ++u) {
          const std::size_t from = static_cast<std::size_t>(v) * fine.width + u;
          const std::size_t to = static_cast<std::size_t>(v / 2) * coarse.width + u / 2;
          coarse.nearest[to] = std::max(coarse.nearest[to], fine.nearest[from]);
          coarse.least[to] = std::min(coarse.least[to], fine.least[from]);
        }
      }
      levels.push_back(std::move(coarse));
    }
  }

  struct Range {
    float nearest;
    float least;
  };
  /// Of all that around() looks at anywhere in the rectangle, and perhaps some more.
  Range within(double u_low, double u_high, double v_low, double v_high) const {
    const double extent = std::max(u_high - u_low, v_high - v_low) + 1.0;
    int level = 0;
    while (3 * (1 << (kBaseLevel + level)) < extent && level + 1 < static_cast<int>(levels.size())) ++level;
    const Level& grid = levels[static_cast<std::size_t>(level)];
    const int shift = kBaseLevel + level;
    const auto clampTo = [](int i, int size) { return std::max(0, std::min(size - 1, i)); };
    const int u0 = clampTo(static_cast<int>(std::floor(u_low)) >> shift, grid.width);
    const int u1 = clampTo(static_cast<int>(std::floor(u_high)) >> shift, grid.width);
    const int v0 = clampTo(static_cast<int>(std::floor(v_low)) >> shift, grid.height);
    const int v1 = clampTo(static_cast<int>(std::floor(v_high)) >> shift, grid.height);
    Range range{0.0f, kNoInformation};
    for (int j = v0; j <= v1; ++j) {
      for (int i = u0; i <= u1; ++i) {
        const std::size_t at = static_cast<std::size_t>(j) * grid.width + i;
        range.nearest = std::max(range.nearest, grid.nearest[at]);
        range.least = std::min(range.least, grid.least[at]);
      }
    }
    return range;
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

/// What one frame says of blocks: which of them it sees through.
class SeenThrough {
 public:
  SeenThrough(const ClassifiedFrame& frame, const CameraModel& camera, double block_size_m, double max_range_m,
              int num_threads)
      : camera_(camera),
        max_range_m_(max_range_m),
        radius_m_(0.6 * block_size_m),  // between the inscribed and the circumscribed sphere
        pyramid_(frame, num_threads) {}

  bool isFree(const Eigen::Vector3d& p) const {
    if (p.z() < radius_m_) return false;
    const double inverse_z = 1.0 / p.z();
    const double u = camera_.fx * p.x() * inverse_z + camera_.cx;
    const double v = camera_.fy * p.y() * inverse_z + camera_.cy;
    const double radius_px = radius_m_ * std::max(camera_.fx, camera_.fy) * inverse_z;
    if (u < radius_px || v < radius_px || u > camera_.width - 1 - radius_px || v > camera_.height - 1 - radius_px) {
      return false;
    }
    const double range = p.norm();
    return range <= max_range_m_ && pyramid_.around(u, v, radius_px) * (range + radius_m_) < 1.0;
  }

  enum class Verdict { kAll, kNone, kSome };

  /// What isFree() would say of all points up to `reach` from `p`, if that is easily told.
  Verdict ofBall(const Eigen::Vector3d& p, double reach) const {
    reach += 1e-6;  // for rounding
    const double z_low = p.z() - reach, z_high = p.z() + reach;
    const double range = p.norm();
    if (z_high < radius_m_ || range - reach > max_range_m_) return Verdict::kNone;
    if (z_low < radius_m_) return Verdict::kSome;
    // Bounds of the pixels of the points in the cube about the ball.
    const auto bounds = [&](double x, double f, double c) {
      const double low = x - reach, high = x + reach;
      return std::make_pair(f * (low < 0.0 ? low / z_low : low / z_high) + c,
                            f * (high < 0.0 ? high / z_high : high / z_low) + c);
    };
    const auto [u_low, u_high] = bounds(p.x(), camera_.fx, camera_.cx);
    const auto [v_low, v_high] = bounds(p.y(), camera_.fy, camera_.cy);
    const double f = std::max(camera_.fx, camera_.fy);
    const double least_px = radius_m_ * f / z_high, most_px = radius_m_ * f / z_low + 1e-6;
    if (u_high < least_px || v_high < least_px || u_low > camera_.width - 1 - least_px ||
        v_low > camera_.height - 1 - least_px) {
      return Verdict::kNone;
    }
    const NearestPyramid::Range seen =
        pyramid_.within(u_low - most_px, u_high + most_px, v_low - most_px, v_high + most_px);
    if (seen.least * (range - reach + radius_m_) >= 1.0 + 1e-6) return Verdict::kNone;
    const bool is_inside = u_low >= most_px && v_low >= most_px && u_high <= camera_.width - 1 - most_px &&
                           v_high <= camera_.height - 1 - most_px && range + reach <= max_range_m_;
    return is_inside && seen.nearest * (range + reach + radius_m_) < 1.0 - 1e-6 ? Verdict::kAll : Verdict::kSome;
  }

 private:
  const CameraModel& camera_;
  double max_range_m_;
  double radius_m_;
  NearestPyramid pyramid_;
};

/// The cubes of an edge of `chunk_size` in which the camera may see something.
std::vector<LatticeKey> chunksInView(const CameraModel& camera, const Eigen::Isometry3d& T_map_camera,
                                     double max_range_m, double chunk_size) {
  const Eigen::Isometry3d T_camera_map = T_map_camera.inverse();
  // Those touched by the frustum's bounding box.
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
  return keys;
}

}  // namespace

ObservedLayer::ObservedLayer(const ObservedLayer& other)
    : block_size_m_(other.block_size_m_),
      pages_(other.pages_),
      num_chunks_(other.num_chunks_),
      private_pages_(other.private_pages_),
      private_chunks_(other.private_chunks_) {
  for (const LatticeKey& key : private_pages_) pages_.at(key) = std::make_shared<Page>(*pages_.at(key));
  for (const LatticeKey& key : private_chunks_) {
    std::shared_ptr<Chunk>& chunk = (*pages_.at(pageOf(key)))[placeIn(key)];
    chunk = std::make_shared<Chunk>(*chunk);
  }
}

ObservedLayer& ObservedLayer::operator=(const ObservedLayer& other) {
  return *this = ObservedLayer(other);  // by move
}

ObservedLayer ObservedLayer::share() {
  private_pages_.clear();
  private_chunks_.clear();
  return *this;
}

ObservedLayer::Chunks ObservedLayer::chunks() const {
  Chunks result;
  result.reserve(num_chunks_);
  constexpr int kSide = 1 << kPageShift;
  for (const auto& [page_key, page] : pages_) {
    for (int x = 0; x < kSide; ++x) {
      for (int y = 0; y < kSide; ++y) {
        for (int z = 0; z < kSide; ++z) {
          const LatticeKey key{page_key.x * kSide + x, page_key.y * kSide + y, page_key.z * kSide + z};
          if ((*page)[placeIn(key)]) result.emplace_back(key, (*page)[placeIn(key)]);
        }
      }
    }
  }
  std::sort(result.begin(), result.end());
  return result;
}

const ObservedLayer::Chunk* ObservedLayer::chunk(const LatticeKey& key) const {
  const auto page = pages_.find(pageOf(key));
  return page == pages_.end() ? nullptr : (*page->second)[placeIn(key)].get();
}

ObservedLayer::Chunk& ObservedLayer::writable(const LatticeKey& key) {
  std::shared_ptr<Page>& page = pages_[pageOf(key)];
  if (private_pages_.insert(pageOf(key)).second) page = page ? std::make_shared<Page>(*page) : std::make_shared<Page>();
  std::shared_ptr<Chunk>& chunk = (*page)[placeIn(key)];
  if (private_chunks_.insert(key).second) {
    if (chunk) {
      chunk = std::make_shared<Chunk>(*chunk);
    } else {
      chunk = std::make_shared<Chunk>();
      chunk->fill(kNever);
      ++num_chunks_;
    }
  }
  return *chunk;
}

void ObservedLayer::observe(const ClassifiedFrame& frame, const CameraModel& camera,
                            const Eigen::Isometry3d& T_map_camera, double max_range_m, float stamp_s, int num_threads) {
  const SeenThrough seen_through(frame, camera, block_size_m_, max_range_m, num_threads);
  const double chunk_size = block_size_m_ * kChunkBlocks;
  const Eigen::Isometry3d T_camera_map = T_map_camera.inverse();
  const std::vector<LatticeKey> keys = chunksInView(camera, T_map_camera, max_range_m, chunk_size);
  using Verdict = SeenThrough::Verdict;
  struct Seen {
    bool all{false};
    std::vector<std::uint16_t> blocks;
  };
  std::vector<Seen> seen(keys.size());
  // A chunk, then cubes of a few blocks, then single blocks.
  constexpr int kCubeBlocks = 4;
  const auto reachOf = [&](int blocks) { return 0.5 * std::sqrt(3.0) * (blocks - 1) * block_size_m_; };
  parallelFor(keys.size(), num_threads, 4, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Eigen::Vector3d first =
          T_camera_map * (keys[i].corner(chunk_size) + Eigen::Vector3d::Constant(0.5 * block_size_m_));
      const Eigen::Matrix3d step = block_size_m_ * T_camera_map.linear();
      const Verdict of_chunk = seen_through.ofBall(T_camera_map * keys[i].center(chunk_size), reachOf(kChunkBlocks));
      seen[i].all = of_chunk == Verdict::kAll;
      if (of_chunk != Verdict::kSome) continue;
      std::vector<std::uint16_t>& blocks = seen[i].blocks;
      constexpr int kCubes = kChunkBlocks / kCubeBlocks;
      for (int cube = 0; cube < kCubes * kCubes * kCubes; ++cube) {
        const int x0 = kCubeBlocks * (cube % kCubes);
        const int y0 = kCubeBlocks * (cube / kCubes % kCubes);
        const int z0 = kCubeBlocks * (cube / kCubes / kCubes);
        const Eigen::Vector3d middle = (Eigen::Array3d(x0, y0, z0) + 0.5 * (kCubeBlocks - 1)).matrix();
        const Verdict of_cube = seen_through.ofBall(first + step * middle, reachOf(kCubeBlocks));
        if (of_cube == Verdict::kNone) continue;
        for (int z = z0; z < z0 + kCubeBlocks; ++z) {
          for (int y = y0; y < y0 + kCubeBlocks; ++y) {
            for (int x = x0; x < x0 + kCubeBlocks; ++x) {
              const bool is_free =
                  of_cube == Verdict::kAll || seen_through.isFree(first + step * Eigen::Vector3d(x, y, z));
              if (is_free) blocks.push_back(static_cast<std::uint16_t>(indexIn(x, y, z)));
            }
          }
        }
      }
    }
  });
  for (std::size_t i = 0; i < keys.size(); ++i) {
    if (seen[i].all) {
      writable(keys[i]).fill(stamp_s);
    } else if (!seen[i].blocks.empty()) {
      Chunk& chunk = writable(keys[i]);
      for (const std::uint16_t index : seen[i].blocks) chunk[index] = stamp_s;
    }
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
  const Chunk* const found = chunk(key);
  if (found != nullptr && (*found)[index] != kNever) writable(key)[index] = kNever;
}

void ObservedLayer::setFree(const Eigen::Vector3d& p_map, float stamp_s) {
  int index = 0;
  const LatticeKey key = locate(p_map, &index);
  float& last = writable(key)[static_cast<std::size_t>(index)];
  last = std::max(last, stamp_s);
}

void ObservedLayer::forgetIf(const std::function<bool(const Eigen::Vector3d&)>& isInside) {
  const double chunk_size = kChunkBlocks * block_size_m_;
  for (const auto& [key, chunk] : chunks()) {
    const Eigen::Vector3d corner = key.corner(chunk_size);
    for (int z = 0; z < kChunkBlocks; ++z) {
      for (int y = 0; y < kChunkBlocks; ++y) {
        for (int x = 0; x < kChunkBlocks; ++x) {
          const auto index = static_cast<std::size_t>(indexIn(x, y, z));
          if ((*chunk)[index] == kNever) continue;
          const Eigen::Vector3d center = corner + (Eigen::Array3d(x, y, z) + 0.5).matrix() * block_size_m_;
          if (isInside(center)) writable(key)[index] = kNever;
        }
      }
    }
  }
}

float ObservedLayer::lastFree(const Eigen::Vector3d& p_map) const {
  int index = 0;
  const Chunk* const found = chunk(locate(p_map, &index));
  return found == nullptr ? kNever : (*found)[index];
}

}  // namespace gpis_mapping
