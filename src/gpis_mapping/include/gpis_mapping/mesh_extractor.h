// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_MESH_EXTRACTOR_H
#define GPIS_MAPPING_MESH_EXTRACTOR_H

#include <array>
#include <cstdint>
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

/// Marching cubes on f in voxels that training points support; open borders where nothing was seen. Keeps the pieces
/// of every cell and extracts again only those whose field changed since the last call; of one whose neighbours alone
/// changed, only what they have a say in. Not thread-safe.
class MeshExtractor {
 public:
  explicit MeshExtractor(const GpisConfig& config);
  ~MeshExtractor();

  /// Brings the pieces up to date with `snapshot`. Returns how many were extracted again.
  std::size_t update(const MapSnapshot& snapshot);

  /// All pieces as one mesh; vertices on the pieces' borders are shared.
  TriangleMesh mesh() const;

  /// Cells with a piece, also an empty one.
  std::size_t numPieces() const;

 private:
  struct Piece;
  class Contour;
  struct Pieces;

  /// `changed`: which of the 27 cells about and with the piece's are not what they were, as bits.
  void extract(const MapSnapshot& snapshot, const LatticeKey& key, std::uint32_t changed, Contour* contour,
               Piece* piece) const;

  GpisConfig config_;
  std::unique_ptr<Pieces> pieces_;
};

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_MESH_EXTRACTOR_H
