// SPDX-License-Identifier: BSD-3-Clause
#include "mesh_lattice.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "gpis_mapping/partition_of_unity.h"

namespace gpis_mapping {
namespace {

constexpr float kNoValue = std::numeric_limits<float>::quiet_NaN();

// Beyond its last points a surface is a guess: planes go on where the object ends. There the points lie all to one side.
constexpr double kTrimReach = 2.0;        // [spacings] points that count
constexpr double kTrimOffset = 0.8;       // [spacings] of their mean, along the surface
constexpr float kLeastMeanNormal = 0.3f;  // shorter, and the faces look in opposite ways

bool isSame(float a, float b) {
  return a == b || (std::isnan(a) && std::isnan(b));
}

}  // namespace

MeshLattice::MeshLattice(const GpisConfig& config)
    : config_(config),
      voxels_(config.mesh.voxels_per_cell),
      edge_(config.cells.size_m / voxels_),
      band_(static_cast<int>(std::ceil(config.cells.blend_margin_m / edge_)) - 1),
      side_(corners() + 2 * band_) {
  const double border = config.cells.corner({}).x();
  for (int plane = -band_; plane <= band_; ++plane) {
    // Along y and z the middle of cell (0, 0, 0): only two cells have a say.
    BlendWeight weights[8];
    const int count = blendWeights({border + plane * edge_, 0.0, 0.0}, config.cells, weights);
    double share = 0.0;
    for (int i = 0; i < count; ++i) share += weights[i].key.x == 0 ? weights[i].weight : 0.0;
    upper_share_.push_back(static_cast<float>(share));
  }
}

Eigen::Vector3d MeshLattice::pointAt(const LatticeKey& key, const std::array<float, 3>& corner) const {
  // By whole steps from the map's origin, so that neighbours place the vertices of their common border alike.
  const Eigen::Array3d first = voxels_ * (Eigen::Array3d(key.x, key.y, key.z) - 0.5);
  return (edge_ * (first + Eigen::Array3d(corner[0], corner[1], corner[2]))).matrix();
}

std::size_t MeshLattice::fieldIndex(int x, int y, int z) const {
  return (static_cast<std::size_t>(z + band_) * side_ + y + band_) * side_ + x + band_;
}

/// Of the cell's voxels and, on all sides, those that meet the corners at which it has a say.
std::vector<std::uint8_t> MeshLattice::supportOf(const CellGp& gp) const {
  const int wide = side_ + 1;
  std::vector<std::uint8_t> supported(static_cast<std::size_t>(wide) * wide * wide, 0);
  const float reach =
      static_cast<float>(config_.mesh.support_spacings * config_.surface.spacing_m / edge_);  // [voxels]
  // Off the point's tangent plane by more than this (a voxel's diagonal and what a surface bends within the reach)
  // the voxel cannot hold this point's surface: most of the work is saved, and no second sheet can be meshed there.
  const float thickness = 0.9f + 0.25f * reach;  // [voxels]
  const Eigen::Vector3d first = config_.cells.corner(gp.key());
  for (std::size_t i = 0; i < gp.size(); ++i) {
    // In voxels from the centre of the first one.
    const Eigen::Vector3f p = (((gp.position(i) - first) / edge_).array() + (band_ + 0.5)).matrix().cast<float>();
    const Eigen::Vector3f n = gp.normal(i);
    int low[3], high[3];
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::max(0, static_cast<int>(std::ceil(p[axis] - reach)));
      high[axis] = std::min(wide - 1, static_cast<int>(std::floor(p[axis] + reach)));
    }
    for (int z = low[2]; z <= high[2]; ++z) {
      for (int y = low[1]; y <= high[1]; ++y) {
        std::uint8_t* const row = &supported[(static_cast<std::size_t>(z) * wide + y) * wide];
        for (int x = low[0]; x <= high[0]; ++x) {
          const Eigen::Vector3f offset(static_cast<float>(x) - p.x(), static_cast<float>(y) - p.y(),
                                       static_cast<float>(z) - p.z());
          if (offset.squaredNorm() <= reach * reach && std::abs(offset.dot(n)) <= thickness) row[x] = 1;
        }
      }
    }
  }
  return supported;
}

std::vector<std::uint8_t> MeshLattice::trim(const CellGp& gp, const std::vector<float>& values,
                                            std::vector<std::uint8_t> supported) const {
  const Eigen::Index n = static_cast<Eigen::Index>(gp.size());
  Eigen::ArrayX3f position(n, 3), normal(n, 3);  // [voxels]
  const Eigen::Vector3d first = config_.cells.corner(gp.key());
  for (Eigen::Index i = 0; i < n; ++i) {
    position.row(i) = (((gp.position(static_cast<std::size_t>(i)) - first) / edge_).array() - 0.5).cast<float>();
    normal.row(i) = gp.normal(static_cast<std::size_t>(i)).array();
  }
  const float reach = static_cast<float>(kTrimReach * config_.surface.spacing_m / edge_);
  const float limit = static_cast<float>(kTrimOffset * config_.surface.spacing_m / edge_);
  Eigen::ArrayXf weight(n);
  std::size_t at = 0;
  for (int z = 0; z < voxels_; ++z) {
    for (int y = 0; y < voxels_; ++y) {
      for (int x = 0; x < voxels_; ++x, ++at) {
        if (!supported[at]) continue;
        int num_inside = 0;
        for (int c = 0; c < 8; ++c) {
          const int corner = ((z + (c >> 2)) * corners() + y + (c >> 1 & 1)) * corners() + x + (c & 1);
          num_inside += values[static_cast<std::size_t>(corner)] < 0.0f;
        }
        if (num_inside == 0 || num_inside == 8) continue;  // no surface
        const Eigen::Array3f voxel(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z));
        weight = (position.col(0) - voxel.x()).square() + (position.col(1) - voxel.y()).square() +
                 (position.col(2) - voxel.z()).square();
        weight = (1.0f - weight / (reach * reach)).max(0.0f).square();
        const float sum = weight.sum();
        Eigen::Vector3f offset, up;
        for (int axis = 0; axis < 3; ++axis) {
          offset[axis] = (weight * position.col(axis)).sum() / sum - voxel[axis];
          up[axis] = (weight * normal.col(axis)).sum() / sum;
        }
        // At an edge the points of both faces lie to one side, too, but along the normal between them.
        if (up.norm() > kLeastMeanNormal) offset -= offset.dot(up) / up.squaredNorm() * up;
        if (offset.squaredNorm() > limit * limit) supported[at] = 0;
      }
    }
  }
  return supported;
}

CellField MeshLattice::evaluate(const CellGp& gp) const {
  CellField field;
  const std::vector<std::uint8_t> wide_support = supportOf(gp);
  const int wide = side_ + 1;
  const auto isSupported = [&](int x, int y, int z) {
    return wide_support[(static_cast<std::size_t>(z) * wide + y) * wide + x] != 0;
  };
  std::vector<std::size_t> needed;
  Points3f places(3, static_cast<Eigen::Index>(side_) * side_ * side_);
  const float half = 0.5f * static_cast<float>(side_ - 1);
  const float edge = static_cast<float>(edge_);
  for (int z = 0; z < side_; ++z) {
    for (int y = 0; y < side_; ++y) {
      for (int x = 0; x < side_; ++x) {
        bool is_needed = false;
        for (int c = 0; c < 8 && !is_needed; ++c) is_needed = isSupported(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2));
        if (!is_needed) continue;
        places.col(static_cast<Eigen::Index>(needed.size())) =
            edge *
            Eigen::Vector3f(static_cast<float>(x) - half, static_cast<float>(y) - half, static_cast<float>(z) - half);
        needed.push_back((static_cast<std::size_t>(z) * side_ + y) * side_ + x);
      }
    }
  }
  if (needed.empty()) return field;
  Eigen::VectorXf values;
  gp.meanValues(places.leftCols(static_cast<Eigen::Index>(needed.size())), &values);
  field.values.assign(static_cast<std::size_t>(side_) * side_ * side_, kNoValue);
  for (std::size_t i = 0; i < needed.size(); ++i) field.values[needed[i]] = values[static_cast<Eigen::Index>(i)];
  bool has_support = false;
  for (int z = 0; z < voxels_; ++z) {
    for (int y = 0; y < voxels_; ++y) {
      for (int x = 0; x < voxels_; ++x) {
        const bool is = isSupported(x + band_ + 1, y + band_ + 1, z + band_ + 1);
        field.supported.push_back(is);
        has_support = has_support || is;
      }
    }
  }
  if (!has_support) field.supported.clear();
  return field;
}

bool MeshLattice::differ(const CellField& a, const CellField& b, int dx, int dy, int dz) const {
  if (a.values.empty() || b.values.empty()) return a.values.size() != b.values.size();
  int first[3], last[3];
  const int offset[3] = {dx, dy, dz};
  for (int axis = 0; axis < 3; ++axis) {
    first[axis] = offset[axis] > 0 ? voxels_ - band_ : -band_;
    last[axis] = offset[axis] < 0 ? band_ : voxels_ + band_;
  }
  for (int z = first[2]; z <= last[2]; ++z) {
    for (int y = first[1]; y <= last[1]; ++y) {
      for (int x = first[0]; x <= last[0]; ++x) {
        const std::size_t i = fieldIndex(x, y, z);
        if (!isSame(a.values[i], b.values[i])) return true;
      }
    }
  }
  return false;
}

MeshLattice::Shares MeshLattice::sharesAt(int corner) const {
  if (corner <= band_) {
    const float upper = upper_share_[static_cast<std::size_t>(corner + band_)];
    return {2, {{-1, 1.0f - upper}, {0, upper}}};
  }
  if (voxels_ - corner <= band_) {
    const float upper = upper_share_[static_cast<std::size_t>(corner - voxels_ + band_)];
    return {2, {{0, 1.0f - upper}, {1, upper}}};
  }
  return {1, {{0, 1.0f}, {0, 0.0f}}};
}

std::vector<float> MeshLattice::blend(const std::array<const CellField*, 27>& around) const {
  std::vector<Shares> shares;
  for (int corner = 0; corner < corners(); ++corner) shares.push_back(sharesAt(corner));
  std::vector<float> blended;
  blended.reserve(static_cast<std::size_t>(corners()) * corners() * corners());
  for (int z = 0; z < corners(); ++z) {
    const Shares& at_z = shares[static_cast<std::size_t>(z)];
    for (int y = 0; y < corners(); ++y) {
      const Shares& at_y = shares[static_cast<std::size_t>(y)];
      for (int x = 0; x < corners(); ++x) {
        const Shares& at_x = shares[static_cast<std::size_t>(x)];
        if (at_x.count + at_y.count + at_z.count == 3) {
          blended.push_back(around[13]->values[fieldIndex(x, y, z)]);
          continue;
        }
        float sum = 0.0f;
        float weights = 0.0f;
        for (int i = 0; i < at_z.count; ++i) {
          for (int j = 0; j < at_y.count; ++j) {
            for (int k = 0; k < at_x.count; ++k) {
              const int dx = at_x.of[k].offset, dy = at_y.of[j].offset, dz = at_z.of[i].offset;
              const CellField* const field = around[static_cast<std::size_t>(9 * (dz + 1) + 3 * (dy + 1) + dx + 1)];
              if (field == nullptr || field->values.empty()) continue;
              const float value = field->values[fieldIndex(x - dx * voxels_, y - dy * voxels_, z - dz * voxels_)];
              if (std::isnan(value)) continue;
              const float weight = at_z.of[i].weight * at_y.of[j].weight * at_x.of[k].weight;
              sum += weight * value;
              weights += weight;
            }
          }
        }
        blended.push_back(weights > 0.0f ? sum / weights : kNoValue);
      }
    }
  }
  return blended;
}

}  // namespace gpis_mapping
