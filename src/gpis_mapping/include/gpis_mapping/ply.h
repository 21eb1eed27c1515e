// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_PLY_H
#define GPIS_MAPPING_PLY_H

#include <string>

#include "gpis_mapping/mesh_extractor.h"

namespace gpis_mapping {

/// Writes a binary little-endian PLY: vertices x y z [m, map frame], nx ny nz, variance [m^2]; triangles as
/// `vertex_indices`. Positions are float, or double once a coordinate exceeds 1000 m, where a float's step (0.06 mm)
/// would begin to show. The file appears complete or not at all. Throws interactive_mapping::FileError when it cannot be written and
/// std::invalid_argument when the mesh contradicts itself (array sizes, index out of range).
void writePly(const TriangleMesh& mesh, const std::string& path);

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_PLY_H
