// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_TYPES_H
#define GPIS_MAPPING_TYPES_H

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <interactive_mapping_enums/query_map.h>

namespace gpis_mapping {

using Points3f = Eigen::Matrix<float, 3, Eigen::Dynamic>;
using Points3d = Eigen::Matrix<double, 3, Eigen::Dynamic>;

/// Stamps beyond this are taken for broken [s]: 30000 years.
constexpr double kMaxStamp_s = 1e12;

/// Pinhole model of a rectified depth image: pixel (u, v) sees bearing ((u - cx)/fx, (v - cy)/fy).
struct CameraModel {
  int width{0};   // [px]
  int height{0};  // [px]
  double fx{0.0};
  double fy{0.0};
  double cx{0.0};
  double cy{0.0};

  /// Empty when the model can be used; otherwise one sentence per problem with value and allowed range.
  std::vector<std::string> validate() const;
  bool operator==(const CameraModel& other) const {
    return width == other.width && height == other.height && fx == other.fx && fy == other.fy && cx == other.cx &&
           cy == other.cy;
  }
};

/// Depth along the optical axis [m], row major, REP-117 values: +Inf no return, -Inf too close, NaN no information.
/// 0 is the unexplained hole of 16-bit images; DepthClassifier decides what it is.
struct DepthImage {
  int width{0};
  int height{0};
  std::vector<float> depth_m;

  float at(int u, int v) const { return depth_m[static_cast<std::size_t>(v) * width + u]; }
};

/// Converts raw 16-bit depth (0 = hole, 65535 = the "no value" of some recorders, also a hole).
DepthImage depthImageFromU16(const std::uint16_t* raw, int width, int height, double units_per_metre);

/// Whether any pixel says something: a depth, or "nothing within reach" (+Inf). Zeros, NaN, -Inf and depths below zero
/// say nothing: an image of these alone comes from a covered lens as well as from an empty scene.
bool holdsMeasurement(const DepthImage& image);

/// The sentence for an image that holds none.
std::string nothingMeasured(const DepthImage& image);

/// Index of a cube of a regular lattice; cube i covers [i, i + 1) * size along each axis.
struct LatticeKey {
  std::int32_t x{0};
  std::int32_t y{0};
  std::int32_t z{0};

  bool operator==(const LatticeKey& other) const { return x == other.x && y == other.y && z == other.z; }
  bool operator!=(const LatticeKey& other) const { return !(*this == other); }
  bool operator<(const LatticeKey& other) const {
    return x != other.x ? x < other.x : (y != other.y ? y < other.y : z < other.z);
  }
  LatticeKey offset(int dx, int dy, int dz) const { return {x + dx, y + dy, z + dz}; }

  /// Cube that holds `p`. Coordinates beyond 2^30 cubes, and NaN, end at the lattice's border.
  static LatticeKey of(const Eigen::Vector3d& p, double size) {
    const auto index = [size](double c) {
      constexpr double kLimit = 1 << 30;
      return static_cast<std::int32_t>(std::floor(std::min(kLimit, std::max(-kLimit, c / size))));
    };
    return {index(p.x()), index(p.y()), index(p.z())};
  }
  Eigen::Vector3d corner(double size) const { return Eigen::Vector3d(x, y, z) * size; }
  Eigen::Vector3d center(double size) const { return (Eigen::Vector3d(x, y, z).array() + 0.5).matrix() * size; }
};

struct LatticeKeyHash {
  std::size_t operator()(const LatticeKey& key) const {
    // Large odd multipliers spread neighbouring cells (Teschner et al. 2003); the final shift mixes the high bits in.
    std::uint64_t h = static_cast<std::uint32_t>(key.x) * 73856093ULL;
    h ^= static_cast<std::uint32_t>(key.y) * 19349669ULL << 7;
    h ^= static_cast<std::uint32_t>(key.z) * 83492791ULL << 14;
    h *= 0x9E3779B97F4A7C15ULL;
    return static_cast<std::size_t>(h ^ (h >> 29));
  }
};

using interactive_mapping::SpaceState;

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_TYPES_H
