// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking/patches.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

#include "support/mapped_scene.h"

namespace surface_picking {
namespace {

using test_support::mapScene;
using test_support::pose;
using test_support::SceneOfSolids;
using testing::HasSubstr;

const Eigen::Vector3d kBrick_m(0.3, 0.2, 0.2);

/// Around the scene's middle only: far ground is noisy and says nothing new.
TriangleMesh near(const TriangleMesh& mesh) {
  return cropMesh(mesh, {-0.6, -0.6, -1.0}, {0.6, 0.6, 1.0});
}

bool isLevel(const Patch& patch, const Eigen::Isometry3d& T_map_scene) {
  return patch.normal_map.dot(T_map_scene.linear().col(2)) > 0.99;
}

TEST(Patches, OfABrickAreItsFaces) {
  SceneOfSolids solids;
  const Eigen::Isometry3d T_scene_brick = pose(0.0, 0.0, 0.1, 0.4);
  solids.addBox(kBrick_m, T_scene_brick);
  solids.lookAround(6);
  const auto mapped = mapScene(solids);
  const std::vector<Patch> patches = findPatches(near(mapped.mesh), PatchConfig());
  ASSERT_FALSE(patches.empty());
  EXPECT_TRUE(patches[0].is_large) << "the ground";
  const Eigen::Isometry3d T_brick_map = (mapped.T_map_scene * T_scene_brick).inverse();
  std::set<int> found;
  for (const Patch& patch : patches) {
    if (patch.is_large || patch.area_m2 < 0.02) continue;
    const Eigen::Vector3d n = T_brick_map.linear() * patch.normal_map;
    const Eigen::Vector3d c = T_brick_map * patch.center_map;
    int axis = 0;
    n.cwiseAbs().maxCoeff(&axis);
    SCOPED_TRACE("axis " + std::to_string(axis) + ", sign " + std::to_string(n[axis]));
    EXPECT_TRUE(found.insert(n[axis] > 0.0 ? axis : -1 - axis).second) << "a face twice";
    // Noise of 3 to 7 mm a pixel, about 20 pixels in a vertex: 1.5 mm, of which the map leaves 1 mm inside as bias.
    EXPECT_NEAR(std::abs(c[axis]), 0.5 * kBrick_m[axis], 0.004);
    EXPECT_LT(std::acos(std::min(1.0, std::abs(n[axis]))), 0.02);  // 1.5 mm over the 8 cm of half a side
    EXPECT_LT(std::abs(std::abs(c[axis]) - 0.5 * kBrick_m[axis]), 4.0 * patch.std_m);
    EXPECT_LT(std::acos(std::min(1.0, std::abs(n[axis]))), 4.0 * patch.tilt_std_rad);
    const int a = (axis + 1) % 3;
    const int b = (axis + 2) % 3;
    // Each side ends 0.5 to 2.2 cm before the edge, which the map rounds.
    EXPECT_GT(patch.area_m2, (kBrick_m[a] - 0.044) * (kBrick_m[b] - 0.044));
    EXPECT_LT(patch.area_m2, (kBrick_m[a] - 0.01) * (kBrick_m[b] - 0.01));
    const double room = 0.5 * std::min(kBrick_m[a], kBrick_m[b]);
    // Its centre is a vertex, up to 1.2 cm from the best one, and one notch of the border takes 2 cm.
    EXPECT_GT(patch.circle_radius_m, room - 0.055);
    EXPECT_LT(patch.circle_radius_m, room);
    EXPECT_NEAR(patch.borderDistance(patch.circle_center_map), patch.circle_radius_m, 1e-9);
    EXPECT_TRUE(std::isinf(patch.clearance_m));
    for (const BorderPoint& point : patch.border) {
      EXPECT_NEAR(patch.height(point.p_map), 0.0, 1e-9);
      EXPECT_NEAR(point.out_map.norm(), 1.0, 1e-9);
      EXPECT_NEAR(point.out_map.dot(patch.normal_map), 0.0, 1e-9);
    }
  }
  EXPECT_EQ(found, (std::set<int>{0, -1, 1, -2, 2}));
}

// The definition, by the slow and obvious way: a region holds a vertex that belongs to its plane, and all that belong
// and can be reached through such vertices over shared triangles; none is in two.
TEST(Patches, AreAllThatIsConnectedAndBelongsToTheirPlane) {
  SceneOfSolids solids;
  solids.addBox(kBrick_m, pose(0.0, 0.0, 0.1, 0.4));
  solids.addBox(kBrick_m, pose(0.05, 0.0, 0.31, 1.0, 0.1));
  solids.lookAround(4);
  const auto mapped = mapScene(solids);
  const TriangleMesh mesh = cropMesh(mapped.mesh, {-0.3, -0.3, -1.0}, {0.3, 0.3, 1.0});
  PatchConfig config;
  config.body_area_m2 = 100.0;
  const std::vector<Patch> patches = findPatches(mesh, config);
  ASSERT_GE(patches.size(), 8u);
  std::vector<int> owner(mesh.vertices_map.size(), -1);
  for (std::size_t i = 0; i < patches.size(); ++i) {
    for (const std::uint32_t vertex : patches[i].vertices) {
      EXPECT_EQ(owner[vertex], -1) << "vertex " << vertex << " is in two patches";
      owner[vertex] = static_cast<int>(i);
    }
  }
  int num_checked = 0;
  for (std::size_t i = 0; i < patches.size(); ++i) {
    std::set<std::uint32_t> reached{patches[i].vertices.front()};
    for (bool has_grown = true; has_grown;) {
      has_grown = false;
      for (const auto& triangle : mesh.triangles) {
        const bool touches =
            std::any_of(triangle.begin(), triangle.end(), [&](std::uint32_t v) { return reached.count(v) > 0; });
        if (!touches) continue;
        for (const std::uint32_t v : triangle) {
          if (owner[v] == static_cast<int>(i)) has_grown = reached.insert(v).second || has_grown;
        }
      }
    }
    EXPECT_EQ(reached.size(), patches[i].vertices.size()) << "patch " << i << " is in pieces";
    // Of what it touches and nobody has, nothing belongs to it. Its plane was fitted once more after it had grown, by
    // less than its deviation: hence what belongs by a margin.
    for (const auto& triangle : mesh.triangles) {
      const bool touches = std::any_of(triangle.begin(), triangle.end(),
                                       [&](std::uint32_t v) { return owner[v] == static_cast<int>(i); });
      if (!touches) continue;
      for (const std::uint32_t v : triangle) {
        if (owner[v] != -1) continue;
        ++num_checked;
        const double angle = std::acos(std::min(1.0, mesh.normals_map[v].cast<double>().dot(patches[i].normal_map)));
        const double angle_margin = 3.0 * patches[i].tilt_std_rad;
        EXPECT_FALSE(std::abs(patches[i].height(mesh.vertices_map[v])) <
                         allowedDistance(mesh.variance_m2[v], config) - 3.0 * patches[i].std_m &&
                     angle < allowedAngle(mesh.variance_m2[v], config) - angle_margin)
            << "vertex " << v << " beside patch " << i;
      }
    }
  }
  EXPECT_GT(num_checked, 500);
}

TEST(Patches, AreNotFoundOnSphereAndCylinder) {
  SceneOfSolids solids;
  solids.spheres.push_back({{-0.3, 0.0, 0.15}, 0.15});
  solids.cylinders.push_back({pose(0.25, 0.0, 0.1, 0.3, M_PI / 2), 0.1, 0.15});  // lying
  solids.lookAround(6);
  const auto mapped = mapScene(solids);
  PatchStatistics statistics;
  const std::vector<Patch> patches = findPatches(near(mapped.mesh), PatchConfig(), &statistics);
  EXPECT_GT(statistics.num_curved, 3);
  int num_ends = 0;
  for (const Patch& patch : patches) {
    if (patch.is_large) continue;
    const Eigen::Vector3d n = mapped.T_map_scene.linear().transpose() * patch.normal_map;
    const Eigen::Vector3d c = mapped.T_map_scene.inverse() * patch.center_map;
    if (c.z() < 0.02) continue;  // pieces of the ground
    // The cylinder's flat ends alone.
    EXPECT_GT(std::abs(n.dot(Eigen::Vector3d(std::cos(0.3), std::sin(0.3), 0.0))), 0.97)
        << "area " << patch.area_m2 << " at " << c.transpose();
    ++num_ends;
  }
  EXPECT_EQ(num_ends, 2);
}

TEST(Patches, TellWhatLiesAboveTheirCircle) {
  SceneOfSolids solids;
  solids.addBox(kBrick_m, pose(0.0, 0.0, 0.1));
  solids.addBox({0.5, 0.04, 0.04}, pose(0.0, 0.0, 0.3));  // a bar, its lower side 8 cm over the brick
  solids.target_m.z() = 0.2;
  solids.lookAround(8, 1.2, 0.5);
  const auto mapped = mapScene(solids);
  bool is_found = false;
  for (const Patch& patch : findPatches(near(mapped.mesh), PatchConfig())) {
    const Eigen::Vector3d c = mapped.T_map_scene.inverse() * patch.center_map;
    if (!isLevel(patch, mapped.T_map_scene) || std::abs(c.z() - 0.2) > 0.02 || patch.area_m2 < 0.02) continue;
    is_found = true;
    // The bar's sides are rounded by the map at their lower edges, and from above its lower side is not seen.
    EXPECT_GT(patch.clearance_m, 0.06);
    EXPECT_LT(patch.clearance_m, 0.12);
  }
  EXPECT_TRUE(is_found);
}

TriangleMesh grid(int edge, double step_m) {
  TriangleMesh mesh;
  for (int i = 0; i < edge; ++i) {
    for (int j = 0; j < edge; ++j) mesh.vertices_map.emplace_back(step_m * i, step_m * j, 0.0);
  }
  mesh.normals_map.assign(mesh.vertices_map.size(), Eigen::Vector3f::UnitZ());
  mesh.variance_m2.assign(mesh.vertices_map.size(), 1e-6F);
  const auto at = [edge](int i, int j) { return static_cast<std::uint32_t>(i * edge + j); };
  for (int i = 0; i + 1 < edge; ++i) {
    for (int j = 0; j + 1 < edge; ++j) {
      mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  }
  return mesh;
}

// A square without noise: everything about it is known.
TEST(Patches, OfAFlatSquareIsExact) {
  const std::vector<Patch> patches = findPatches(grid(21, 0.01), PatchConfig());
  ASSERT_EQ(patches.size(), 1u);
  EXPECT_NEAR(patches[0].area_m2, 0.04, 1e-12);
  EXPECT_LT((patches[0].center_map - Eigen::Vector3d(0.1, 0.1, 0.0)).norm(), 1e-9);
  EXPECT_GT(patches[0].normal_map.z(), 1.0 - 1e-9);
  EXPECT_NEAR(patches[0].circle_radius_m, 0.1, 0.0002);  // to the middle of the nearest edge of 1 cm, not to the line
  EXPECT_LT(patches[0].curvature_per_m, 1e-6);
  EXPECT_EQ(patches[0].border.size(), 80u);
  for (const BorderPoint& point : patches[0].border) {
    EXPECT_EQ(point.kind, BorderKind::kOpen);
    EXPECT_GT(point.out_map.dot(point.p_map - patches[0].center_map), 0.0);
  }
}

/// One point of a profile in x and z, with the angle by which its normal leans from z towards x.
struct Point {
  double x_m, z_m, lean_rad;
};

/// The surface that the profile makes along y, 0.2 m wide, without noise.
TriangleMesh extruded(const std::vector<Point>& profile) {
  TriangleMesh mesh = grid(21, 0.01);
  mesh.vertices_map.clear();
  mesh.normals_map.clear();
  mesh.triangles.clear();
  for (std::size_t i = 0; i < profile.size(); ++i) {
    const Point& point = profile[i];
    for (std::uint32_t j = 0; j < 21; ++j) {
      mesh.vertices_map.emplace_back(point.x_m, 0.01 * j, point.z_m);
      mesh.normals_map.emplace_back(std::sin(point.lean_rad), 0.0, std::cos(point.lean_rad));
      if (i == 0 || j == 0) continue;
      const auto at = static_cast<std::uint32_t>(21 * i) + j;
      mesh.triangles.push_back({at - 22, at - 1, at});
      mesh.triangles.push_back({at - 22, at, at - 21});
    }
  }
  mesh.variance_m2.assign(mesh.vertices_map.size(), 1e-6F);
  return mesh;
}

/// Kinds of the border of the one level patch about this height towards +x or -x.
std::set<BorderKind> borderOf(const TriangleMesh& mesh, double z_m, double sign) {
  std::set<BorderKind> kinds;
  for (const Patch& patch : findPatches(mesh, PatchConfig())) {
    if (patch.normal_map.z() < 0.99 || std::abs(patch.center_map.z() - z_m) > 0.005) continue;
    for (const BorderPoint& point : patch.border) {
      if (sign * point.out_map.x() > 0.9) kinds.insert(point.kind);
    }
  }
  return kinds;
}

// Down round a corner of 2 cm: the body ends. Up: another one stands there.
TEST(Patches, BorderIsConvexWhereTheSurfaceTurnsAway) {
  for (const double turn : {1.0, -1.0}) {
    std::vector<Point> profile;
    for (int i = -20; i < 0; ++i) profile.push_back({0.01 * i, 0.0, 0.0});
    for (int i = 0; i <= 6; ++i) {
      const double angle = M_PI / 12.0 * i;
      profile.push_back({0.02 * std::sin(angle), turn * 0.02 * (std::cos(angle) - 1.0), turn * angle});
    }
    for (int i = 1; i < 20; ++i) profile.push_back({0.02, turn * (-0.02 - 0.01 * i), turn * M_PI / 2.0});
    EXPECT_EQ(borderOf(extruded(profile), 0.0, 1.0),
              std::set<BorderKind>{turn > 0.0 ? BorderKind::kConvex : BorderKind::kConcave});
  }
}

// A step whose normals all point up: the height alone tells that the upper face ends, and the lower may go on behind.
TEST(Patches, BorderOfAStepIsConvexAboveAndConcaveBelow) {
  std::vector<Point> profile;
  for (int i = -20; i < 20; ++i) profile.push_back({0.01 * i, i < 0 ? 0.0 : -0.03, 0.0});
  const TriangleMesh mesh = extruded(profile);
  EXPECT_EQ(borderOf(mesh, 0.0, 1.0), std::set<BorderKind>{BorderKind::kConvex});
  EXPECT_EQ(borderOf(mesh, -0.03, -1.0), std::set<BorderKind>{BorderKind::kConcave});
}

TEST(Patches, RefuseWhatIsNoMesh) {
  const auto messageOf = [](const TriangleMesh& mesh) {
    return test_support::messageOf<std::invalid_argument>([&] { findPatches(mesh, PatchConfig()); });
  };
  EXPECT_TRUE(findPatches(TriangleMesh(), PatchConfig()).empty());
  TriangleMesh mesh = grid(3, 0.01);
  mesh.normals_map.pop_back();
  EXPECT_THAT(messageOf(mesh), HasSubstr("9 vertices, 8 normals and 9 variances"));
  mesh = grid(3, 0.01);
  mesh.vertices_map[4].x() = NAN;
  EXPECT_THAT(messageOf(mesh), HasSubstr("vertex 4 is not finite"));
  mesh = grid(3, 0.01);
  mesh.normals_map[2] *= 2.0F;
  EXPECT_THAT(messageOf(mesh), HasSubstr("vertex 2 has length 2.0"));
  mesh = grid(3, 0.01);
  mesh.variance_m2[1] = -1.0F;
  EXPECT_THAT(messageOf(mesh), HasSubstr("variance of vertex 1"));
  mesh = grid(3, 0.01);
  mesh.triangles[5][1] = 9;
  EXPECT_THAT(messageOf(mesh), HasSubstr("triangle 5 names vertex 9, must be below 9"));
  PatchConfig config;
  config.min_angle_rad = 0.5;
  EXPECT_THAT(test_support::messageOf<std::invalid_argument>([&] { findPatches(grid(3, 0.01), config); }),
              HasSubstr("min_angle_rad must be at most max_angle_rad"));
}

TEST(Patches, CroppedMeshHoldsTheTrianglesInTheBox) {
  const TriangleMesh part = cropMesh(grid(21, 0.01), {0.045, -1.0, -1.0}, {0.155, 0.105, 1.0});
  EXPECT_EQ(part.vertices_map.size(), 11u * 11u);
  EXPECT_EQ(part.triangles.size(), 2u * 10u * 10u);
  EXPECT_NO_THROW(requireMesh(part));
}

}  // namespace
}  // namespace surface_picking
