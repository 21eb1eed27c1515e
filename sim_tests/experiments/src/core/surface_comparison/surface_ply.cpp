// SPDX-License-Identifier: BSD-3-Clause
#include "surface_comparison/surface_ply.h"

#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

#include <interactive_mapping_common/files/atomic_file.h>

namespace experiments {

void writePly(const Surface& surface, const PointScalars& scalars, const std::string& path) {
  const std::size_t count = surface.points_map.size();
  const bool has_normals = !surface.normals_map.empty();
  const auto require_size = [&](std::size_t size, const std::string& what) {
    if (size == count) return;
    throw std::invalid_argument(path + ": " + std::to_string(size) + " values of " + what + " for " +
                                std::to_string(count) + " points, must be as many");
  };
  if (has_normals) require_size(surface.normals_map.size(), "normal");
  for (const auto& [name, values] : scalars) require_size(values.size(), name);

  std::string header =
      "ply\nformat binary_little_endian 1.0\ncomment metres, map frame\nelement vertex " + std::to_string(count) + "\n";
  for (const char* name : {"x", "y", "z"}) header += std::string("property float ") + name + "\n";
  if (has_normals) header += "property float nx\nproperty float ny\nproperty float nz\n";
  for (const auto& [name, values] : scalars) header += "property float " + name + "\n";
  if (!surface.triangles.empty()) {
    header += "element face " + std::to_string(surface.triangles.size()) + "\nproperty list uchar int vertex_indices\n";
  }
  header += "end_header\n";

  interactive_mapping::AtomicFile file(path);
  file.write(header);
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector3f position = surface.points_map[i].cast<float>();
    file.write(position.data(), 3 * sizeof(float));
    if (has_normals) file.write(surface.normals_map[i].data(), 3 * sizeof(float));
    for (const auto& [name, values] : scalars) {
      const float value =
          std::isfinite(values[i]) ? static_cast<float>(values[i]) : std::numeric_limits<float>::quiet_NaN();
      file.write(&value, sizeof(value));
    }
  }
  for (const auto& triangle : surface.triangles) {
    std::array<char, 13> face;
    face[0] = 3;
    std::memcpy(face.data() + 1, triangle.data(), 12);
    file.write(face.data(), face.size());
  }
  file.commit();
}

}  // namespace experiments
