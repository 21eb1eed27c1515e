// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_MESH_EXTRACTOR_H
#define GPIS_MAPPING_MESH_EXTRACTOR_H

#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "gpis_mapping/map_snapshot.h"
#include "gpis_mapping/types.h"

namespace gpis_mapping {

/// Triangles in the map frame. Normals point to free space; variance is that of the field at the vertex.
struct TriangleMesh {
  std::vector<Eigen::Vector3d> vertices_map;
  std::vector<Eigen::Vector3f> normals_map;
  std::vector<float> variance_m2;
  std::vector<std::array<std::uint32_t, 3>> triangles;  // counter-clockwise seen from free space
};

/// A box that meets all others.
inline const Eigen::AlignedBox3d kEverywhere{Eigen::Vector3d::Constant(-std::numeric_limits<double>::infinity()),
                                             Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity())};

class MeshLattice;

/// Marching cubes on f in voxels that training points support; open borders where nothing was seen. Keeps the pieces of
/// every cell and each cell's own values at the corners of its voxels. Extracts again only those pieces whose field or
/// variance changed since the last call. Normals are differences of f along the lattice. Not thread-safe.
class MeshExtractor {
 public:
  explicit MeshExtractor(const GpisConfig& config);
  ~MeshExtractor();

  /// Brings the pieces up to date with `snapshot`. Returns how many were extracted again.
  std::size_t update(const MapSnapshot& snapshot);

  /// The pieces of all cells that meet `box_map`, as one mesh; vertices on the pieces' borders are shared.
  TriangleMesh mesh(const Eigen::AlignedBox3d& box_map = kEverywhere) const;

  /// Cells with a piece, also an empty one.
  std::size_t numPieces() const;

 private:
  struct Piece;
  struct Pieces;

  void extract(const LatticeKey& key, Piece* piece) const;

  GpisConfig config_;
  std::unique_ptr<const MeshLattice> lattice_;
  std::unique_ptr<Pieces> pieces_;
};

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_MESH_EXTRACTOR_H
