// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include <Eigen/Core>
#include <gpis_mapping/types.h>

namespace motion_planning {

/// A box of blocks of the map's lattice, x fastest.
class BlockLattice {
 public:
  BlockLattice() = default;
  /// `first` and `last` are both part of it.
  BlockLattice(double block_m, const gpis_mapping::LatticeKey& first, const gpis_mapping::LatticeKey& last)
      : block_m_(block_m), first_(first), size_(last.x - first.x + 1, last.y - first.y + 1, last.z - first.z + 1) {}

  bool operator==(const BlockLattice& other) const {
    return block_m_ == other.block_m_ && first_ == other.first_ && size_ == other.size_;
  }
  bool operator!=(const BlockLattice& other) const { return !(*this == other); }

  double block() const { return block_m_; }
  const Eigen::Vector3i& size() const { return size_; }
  std::size_t count() const { return static_cast<std::size_t>(size_.x()) * size_.y() * size_.z(); }
  std::size_t index(const Eigen::Vector3i& at) const {
    return static_cast<std::size_t>(at.x()) +
           static_cast<std::size_t>(size_.x()) * (at.y() + static_cast<std::size_t>(size_.y()) * at.z());
  }
  Eigen::Vector3i position(std::size_t index) const {
    const std::size_t x = static_cast<std::size_t>(size_.x());
    const std::size_t y = static_cast<std::size_t>(size_.y());
    return {static_cast<int>(index % x), static_cast<int>(index / x % y), static_cast<int>(index / (x * y))};
  }
  Eigen::Vector3d center(const Eigen::Vector3i& at) const {
    return ((at + Eigen::Vector3i(first_.x, first_.y, first_.z)).cast<double>().array() + 0.5) * block_m_;
  }
  /// Block that holds a point; one outside the lattice: the nearest block.
  Eigen::Vector3i clamped(const Eigen::Vector3d& p_map) const {
    Eigen::Vector3i at;
    for (int axis = 0; axis < 3; ++axis) {
      const int first = axis == 0 ? first_.x : axis == 1 ? first_.y : first_.z;
      const double blocks = std::floor(p_map[axis] / block_m_) - first;
      at[axis] = static_cast<int>(std::min(std::max(blocks, 0.0), static_cast<double>(size_[axis] - 1)));
    }
    return at;
  }
  bool contains(const Eigen::Vector3d& p_map) const {
    const gpis_mapping::LatticeKey key = gpis_mapping::LatticeKey::of(p_map, block_m_);
    const Eigen::Vector3i at(key.x - first_.x, key.y - first_.y, key.z - first_.z);
    return (at.array() >= 0).all() && (at.array() < size_.array()).all();
  }

 private:
  double block_m_{1.0};
  gpis_mapping::LatticeKey first_;
  Eigen::Vector3i size_{Eigen::Vector3i::Zero()};
};

/// Squared distance between centres [blocks^2] from each block to the nearest one that is set; kNoBlock: none is set.
/// Exact and linear in the number of blocks: lower envelopes of parabolas, an axis at a time (Felzenszwalb, Huttenlocher,
/// Theory of Computing 2012).
std::vector<std::int32_t> squaredDistances(const BlockLattice& lattice, const std::vector<std::uint8_t>& is_set);
constexpr std::int32_t kNoBlock = 1 << 28;

/// `is_set` with the 26 neighbours of each block set as well.
std::vector<std::uint8_t> dilate(const BlockLattice& lattice, std::vector<std::uint8_t> is_set);

}  // namespace motion_planning
