// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "surface_comparison/mesh_distance.h"

namespace experiments {

/// Named value per point. Values that are not finite are written as NaN.
using PointScalars = std::vector<std::pair<std::string, std::vector<double>>>;

/// Writes a binary little-endian PLY with x y z [m, map frame], nx ny nz if the surface has normals, the scalars, all
/// float, and the triangles as `vertex_indices`. Without triangles it is a point cloud. The file appears complete or not
/// at all. Throws interactive_mapping::FileError when it cannot be written, std::invalid_argument when sizes contradict.
void writePly(const Surface& surface, const PointScalars& scalars, const std::string& path);

}  // namespace experiments
