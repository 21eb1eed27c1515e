// SPDX-License-Identifier: BSD-3-Clause
#include "support/box_world.h"

#include <map>
#include <utility>

#include <gmock/gmock.h>

namespace motion_planning {
namespace {

using gpis_mapping::SpaceState;

TEST(BoxWorld, MeshOfABoxIsClosedLiesOnItAndLooksOutwards) {
  BoxWorld world;
  Eigen::Isometry3d T_map_box(Eigen::Translation3d(0.4, -0.2, 0.3));
  T_map_box.rotate(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1.0, 2.0, 3.0).normalized()));
  world.boxes = {{T_map_box, {0.30, 0.20, 0.10}}};
  const Surface surface = world.surface(0.02);
  double area_m2 = 0.0;
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (const auto& triangle : surface.triangles) {
    const Eigen::Vector3d a = surface.vertices_map[triangle[0]];
    const Eigen::Vector3d b = surface.vertices_map[triangle[1]];
    const Eigen::Vector3d c = surface.vertices_map[triangle[2]];
    const Eigen::Vector3d cross = (b - a).cross(c - a);
    area_m2 += 0.5 * cross.norm();
    const Eigen::Vector3d middle = (a + b + c) / 3.0;
    EXPECT_NEAR(world.distance(middle), 0.0, 1e-12);
    EXPECT_NEAR(world.distance(middle + 0.005 * cross.normalized()), 0.005, 1e-9);
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_GT(surface.normals_map[triangle[i]].cast<double>().dot(cross.normalized()),
                0.57);  // 1/sqrt(3) at a corner
      ++edges[{triangle[i], triangle[(i + 1) % 3]}];
    }
  }
  EXPECT_NEAR(area_m2, 2.0 * (0.30 * 0.20 + 0.30 * 0.10 + 0.20 * 0.10), 1e-9);
  for (const auto& [edge, count] : edges) {
    EXPECT_EQ(count, 1);
    EXPECT_EQ(edges.count({edge.second, edge.first}), 1u);
  }
}

TEST(BoxWorld, LeavesOutFacesThatTouchOrLookIntoTheUnknown) {
  BoxWorld world;
  world.ground_z_m = 0.0;
  world.ground_half_edge_m = 0.5;
  world.boxes = {uprightBox({0.0, 0.0, 0.1}, {0.2, 0.2, 0.2}), uprightBox({0.0, 0.0, 0.3}, {0.2, 0.2, 0.2})};
  world.is_unknown = [](const Eigen::Vector3d& p) { return p.x() > 0.1; };
  double area_m2 = 0.0;
  const Surface surface = world.surface(0.02);
  for (const auto& triangle : surface.triangles) {
    const Eigen::Vector3d a = surface.vertices_map[triangle[0]];
    area_m2 += 0.5 * (surface.vertices_map[triangle[1]] - a).cross(surface.vertices_map[triangle[2]] - a).norm();
  }
  // three sides of 0.2 x 0.4, the upper one's top, the ground to the left of x = 0.1 without the lower one's place
  EXPECT_NEAR(area_m2, 3 * 0.2 * 0.4 + 0.2 * 0.2 + (0.6 * 1.0 - 0.2 * 0.2), 1e-9);
}

TEST(BoxWorld, AnswersAsTheMapDoes) {
  BoxWorld world;
  world.boxes = {uprightBox({0.0, 0.0, 0.0}, {1.0, 1.0, 1.0})};
  world.is_unknown = [](const Eigen::Vector3d& p) { return p.x() > 0.5; };
  gpis_mapping::Points3d points(3, 5);
  points.col(0) << -0.7, 0.0, 0.0;  // seen
  points.col(1) << -0.4, 0.0, 0.0;  // under the surface
  points.col(2) << 0.0, 0.0, 0.0;   // deep
  points.col(3) << 0.7, 0.0, 0.0;   // unseen, a surface near
  points.col(4) << 0.9, 0.0, 0.0;   // unseen, far
  const MapAnswers answers = world.query(points);
  EXPECT_THAT(answers.state, ::testing::ElementsAre(SpaceState::kFree, SpaceState::kOccupied, SpaceState::kUnknown,
                                                    SpaceState::kUnknown, SpaceState::kUnknown));
  EXPECT_NEAR(answers.distance_m[0], 0.2, 1e-12);
  EXPECT_NEAR(answers.distance_m[1], -0.1, 1e-12);
  EXPECT_TRUE(std::isnan(answers.distance_m[2]));
  EXPECT_NEAR(answers.distance_m[3], 0.2, 1e-12);
  EXPECT_TRUE(std::isnan(answers.distance_m[4]));
  EXPECT_EQ(answers.surface_std_m[0], 0.002);
}

}  // namespace
}  // namespace motion_planning
