// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/ply.h"

#include <cstring>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <interactive_mapping_common/files/atomic_file.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

namespace gpis_mapping {
namespace {

using test_support::messageOf;
using test_support::readText;
using test_support::TemporaryFolder;
using testing::HasSubstr;

TriangleMesh twoTriangles(const Eigen::Vector3d& offset) {
  TriangleMesh mesh;
  mesh.vertices_map = {offset, offset + Eigen::Vector3d(0.1, 0, 0), offset + Eigen::Vector3d(0, 0.2, 0),
                       offset + Eigen::Vector3d(0.1, 0.2, 0.3)};
  mesh.normals_map.assign(4, Eigen::Vector3f(0.0f, 0.6f, 0.8f));
  mesh.variance_m2 = {1e-6f, 2e-6f, 3e-6f, 4e-6f};
  mesh.triangles = {{0, 1, 2}, {1, 3, 2}};
  return mesh;
}

template <typename T>
T take(const std::string& bytes, std::size_t* at) {
  T value;
  std::memcpy(&value, bytes.data() + *at, sizeof(T));
  *at += sizeof(T);
  return value;
}

/// Reads the body back as the header says and compares it with the mesh.
template <typename Scalar>
void expectBody(const std::string& bytes, const TriangleMesh& mesh) {
  const std::string end = "end_header\n";
  std::size_t at = bytes.find(end) + end.size();
  for (std::size_t i = 0; i < mesh.vertices_map.size(); ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_EQ(take<Scalar>(bytes, &at), static_cast<Scalar>(mesh.vertices_map[i][axis]));
    }
    for (int axis = 0; axis < 3; ++axis) EXPECT_EQ(take<float>(bytes, &at), mesh.normals_map[i][axis]);
    EXPECT_EQ(take<float>(bytes, &at), mesh.variance_m2[i]);
  }
  for (const auto& triangle : mesh.triangles) {
    EXPECT_EQ(take<std::uint8_t>(bytes, &at), 3);
    for (const std::uint32_t index : triangle) EXPECT_EQ(take<std::int32_t>(bytes, &at), static_cast<int>(index));
  }
  EXPECT_EQ(at, bytes.size());
}

TEST(Ply, HoldsVerticesNormalsVarianceAndFaces) {
  const TemporaryFolder folder;
  const TriangleMesh mesh = twoTriangles({1.0, -2.0, 3.0});
  writePly(mesh, folder.file("a.ply"));
  const std::string bytes = readText(folder.file("a.ply"));
  EXPECT_EQ(bytes.substr(0, bytes.find("end_header")),
            "ply\nformat binary_little_endian 1.0\ncomment gpis_mapping surface, metres, map frame\n"
            "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n"
            "property float ny\nproperty float nz\nproperty float variance\nelement face 2\n"
            "property list uchar int vertex_indices\n");
  expectBody<float>(bytes, mesh);
}

TEST(Ply, FarCoordinatesAreDoubles) {
  const TemporaryFolder folder;
  const TriangleMesh mesh = twoTriangles({5e5, 4.2e6, 100.0});
  writePly(mesh, folder.file("a.ply"));
  const std::string bytes = readText(folder.file("a.ply"));
  EXPECT_THAT(bytes, HasSubstr("property double x\n"));
  expectBody<double>(bytes, mesh);
}

TEST(Ply, EmptyMeshIsAValidFile) {
  const TemporaryFolder folder;
  writePly(TriangleMesh{}, folder.file("a.ply"));
  expectBody<float>(readText(folder.file("a.ply")), TriangleMesh{});
}

TEST(Ply, RefusesAMeshThatContradictsItself) {
  const TemporaryFolder folder;
  TriangleMesh mesh = twoTriangles({0, 0, 0});
  mesh.triangles[1][2] = 4;
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { writePly(mesh, folder.file("a.ply")); }), HasSubstr("index 4"));
  mesh = twoTriangles({0, 0, 0});
  mesh.normals_map.pop_back();
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { writePly(mesh, folder.file("a.ply")); }), HasSubstr("3 normals"));
  EXPECT_EQ(folder.numEntries(), 0u);
}

TEST(Ply, SaysWhyItCannotWrite) {
  const TemporaryFolder folder;
  EXPECT_THAT(messageOf<interactive_mapping::FileError>([&] { writePly(TriangleMesh{}, folder.file("no/a.ply")); }),
              HasSubstr("No such file or directory"));
}

}  // namespace
}  // namespace gpis_mapping
