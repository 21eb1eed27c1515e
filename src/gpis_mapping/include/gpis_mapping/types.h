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
#include <depth_camera/depth_image.h>
#include <interactive_mapping_enums/query_map.h>

namespace gpis_mapping {

using Points3f = Eigen::Matrix<float, 3, Eigen::Dynamic>;
using Points3d = Eigen::Matrix<double, 3, Eigen::Dynamic>;

/// Stamps beyond this are taken for broken [s]: 30000 years.
constexpr double kMaxStamp_s = 1e12;

using depth_camera::CameraModel;
using depth_camera::DepthImage;

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
