// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/ply.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <stdexcept>

#include <interactive_mapping_common/files/atomic_file.h>

namespace gpis_mapping {
namespace {

using interactive_mapping::AtomicFile;

constexpr double kMaxFloatCoordinate_m = 1000.0;

void requireConsistent(const TriangleMesh& mesh, const std::string& path) {
  const std::size_t num_vertices = mesh.vertices_map.size();
  if (mesh.normals_map.size() != num_vertices || mesh.variance_m2.size() != num_vertices) {
    throw std::invalid_argument(path + ": mesh has " + std::to_string(num_vertices) + " vertices, " +
                                std::to_string(mesh.normals_map.size()) + " normals and " +
                                std::to_string(mesh.variance_m2.size()) + " variances, must be as many of each");
  }
  if (num_vertices > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max())) {
    throw std::invalid_argument(path + ": mesh has more vertices than 32-bit indices reach");
  }
  for (const auto& triangle : mesh.triangles) {
    for (const std::uint32_t index : triangle) {
      if (index < num_vertices) continue;
      throw std::invalid_argument(path + ": mesh has triangle index " + std::to_string(index) + ", must be below " +
                                  std::to_string(num_vertices));
    }
  }
}

std::string header(const TriangleMesh& mesh, bool use_double) {
  const std::string type = use_double ? "double" : "float";
  std::string text = "ply\nformat binary_little_endian 1.0\ncomment gpis_mapping surface, metres, map frame\n";
  text += "element vertex " + std::to_string(mesh.vertices_map.size()) + "\n";
  for (const char* axis : {"x", "y", "z"}) text += "property " + type + " " + axis + "\n";
  for (const char* name : {"nx", "ny", "nz", "variance"}) text += std::string("property float ") + name + "\n";
  text += "element face " + std::to_string(mesh.triangles.size()) + "\n";
  text += "property list uchar int vertex_indices\nend_header\n";
  return text;
}

template <typename Scalar>
void writeVertices(const TriangleMesh& mesh, AtomicFile* file) {
  for (std::size_t i = 0; i < mesh.vertices_map.size(); ++i) {
    const Eigen::Matrix<Scalar, 3, 1> position = mesh.vertices_map[i].cast<Scalar>();
    file->write(position.data(), 3 * sizeof(Scalar));
    file->write(mesh.normals_map[i].data(), 3 * sizeof(float));
    file->write(&mesh.variance_m2[i], sizeof(float));
  }
}

}  // namespace

void writePly(const TriangleMesh& mesh, const std::string& path) {
  requireConsistent(mesh, path);
  bool use_double = false;
  for (const Eigen::Vector3d& vertex : mesh.vertices_map) {
    use_double = use_double || vertex.cwiseAbs().maxCoeff() > kMaxFloatCoordinate_m;
  }
  AtomicFile file(path);
  file.write(header(mesh, use_double));
  if (use_double) {
    writeVertices<double>(mesh, &file);
  } else {
    writeVertices<float>(mesh, &file);
  }
  for (const auto& triangle : mesh.triangles) {
    std::array<char, 13> face;
    face[0] = 3;
    std::memcpy(face.data() + 1, triangle.data(), 12);
    file.write(face.data(), face.size());
  }
  file.commit();
}

}  // namespace gpis_mapping
