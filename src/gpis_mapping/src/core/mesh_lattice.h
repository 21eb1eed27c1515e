// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_MESH_LATTICE_H
#define GPIS_MAPPING_MESH_LATTICE_H

#include <array>
#include <cstdint>
#include <vector>

#include "gpis_mapping/cell_gp.h"
#include "gpis_mapping/gpis_config.h"

namespace gpis_mapping {

/// What one cell alone says about the corners of its voxels, and of its neighbours' as far as it has a say there.
struct CellField {
  std::vector<float> values;  // f of the cell [m], x fastest; NaN: no answer, or no voxel asks; empty: all NaN
  std::vector<std::uint8_t> supported;  // voxels near a training point, x fastest; empty: none
};

/// The lattice on which a cell is meshed: corner (x, y, z) lies x, y, z voxels from the cell's lower corner.
class MeshLattice {
 public:
  explicit MeshLattice(const GpisConfig& config);

  int voxels() const { return voxels_; }
  int corners() const { return voxels_ + 1; }
  double edge() const { return edge_; }  // of a voxel [m]
  Eigen::Vector3d pointAt(const LatticeKey& key, const std::array<float, 3>& corner) const;

  /// Depends on the cell alone: evaluated once when it is trained, whoever asks.
  CellField evaluate(const CellGp& gp) const;

  /// Do two fields of a cell differ where its neighbour (dx, dy, dz) takes a share of it? (0, 0, 0): anywhere.
  bool differ(const CellField& a, const CellField& b, int dx, int dy, int dz) const;

  /// The blended f at the corners of the middle one of 27 cells, x fastest; `around`: [9 (dz + 1) + 3 (dy + 1) + dx + 1],
  /// null for a cell that is not there. Neighbours get the same bits on their common border.
  std::vector<float> blend(const std::array<const CellField*, 27>& around) const;

  /// The `supported` voxels of a cell without those that the surface runs through beyond its last points. `values`: f at
  /// the cell's corners.
  std::vector<std::uint8_t> trim(const CellGp& gp, const std::vector<float>& values,
                                 std::vector<std::uint8_t> supported) const;

 private:
  struct Share {
    int offset;  // of the cell along the axis
    float weight;
  };
  struct Shares {
    int count;
    Share of[2];  // lower cell first
  };
  Shares sharesAt(int corner) const;
  std::vector<std::uint8_t> supportOf(const CellGp& gp) const;
  std::size_t fieldIndex(int x, int y, int z) const;

  const GpisConfig& config_;
  int voxels_;
  double edge_;
  int band_;                        // planes beyond its border at which a cell has a say
  int side_;                        // corners of a CellField along an axis
  std::vector<float> upper_share_;  // of the cell above a border, by plane from -band to band
};

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_MESH_LATTICE_H
