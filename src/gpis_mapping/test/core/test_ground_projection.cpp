// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/ground_projection.h"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "analytic_surfaces.h"
#include "gpis_mapping/gpis_map.h"

namespace gpis_mapping {
namespace {

using gpis_mapping_test::sampleRectangle;

constexpr double kSpacing = 0.02;  // m

/// Points on a plane through `center` with slopes dz/dx, dz/dy, x and y within +-half.
void addPlane(const Eigen::Vector3d& center, double slope_x, double slope_y, double half_m,
              std::vector<SurfacePoint>* points) {
  const Eigen::Vector3d u(2.0 * half_m, 0.0, 2.0 * half_m * slope_x);
  const Eigen::Vector3d v(0.0, 2.0 * half_m, 2.0 * half_m * slope_y);
  sampleRectangle(center - 0.5 * (u + v), u, v, kSpacing, 0.001, points);
}

std::shared_ptr<const MapSnapshot> mapOf(const std::vector<SurfacePoint>& points, ObservedLayer observed) {
  MapContents contents;
  contents.points = points;
  contents.observed = std::move(observed);
  return GpisMap(std::move(contents)).snapshot();
}

SpaceState stateAt(const GroundGrid& grid, double x_m, double y_m) {
  const int column = static_cast<int>(std::floor((x_m - grid.origin_x_m) / grid.cell_size_m));
  const int row = static_cast<int>(std::floor((y_m - grid.origin_y_m) / grid.cell_size_m));
  if (column < 0 || row < 0 || column >= grid.width || row >= grid.height) return SpaceState::kUnknown;
  return grid.state[grid.index(column, row)];
}

TEST(EstimateGround, FindsATiltedFloorAwayFromZero) {
  std::vector<SurfacePoint> points;
  addPlane({120.0, -40.0, 1.7}, 0.06, -0.03, 0.8, &points);
  addPlane({120.2, -40.0, 2.1}, 0.0, 0.0, 0.2, &points);  // a table
  const auto ground = estimateGround(*mapOf(points, ObservedLayer(0.05)), {});
  ASSERT_TRUE(ground);
  const Eigen::Vector3d truth = Eigen::Vector3d(-0.06, 0.03, 1.0).normalized();
  EXPECT_LT(std::acos(std::min(1.0, ground->normal_map.dot(truth))), 1e-3);
  EXPECT_NEAR(ground->zAt(120.0, -40.0), 1.7, 1e-3);  // the points are exact, PCL computes in float
  EXPECT_NEAR(ground->heightOf({120.0, -40.0, 2.7}), truth.z(), 1e-3);
}

TEST(EstimateGround, TakesTheFloorRatherThanALargerTableAboveIt) {
  std::vector<SurfacePoint> points;
  addPlane({0.0, 0.0, 0.75}, 0.0, 0.0, 0.8, &points);  // 6400 points
  addPlane({1.5, 0.0, 0.0}, 0.0, 0.0, 0.5, &points);   // 2500 points
  const auto ground = estimateGround(*mapOf(points, ObservedLayer(0.05)), {});
  ASSERT_TRUE(ground);
  EXPECT_NEAR(ground->zAt(0.0, 0.0), 0.0, 1e-3);
}

TEST(EstimateGround, IsNotMisledByAFewPointsBelowTheFloor) {
  std::vector<SurfacePoint> points;
  addPlane({0.0, 0.0, 0.0}, 0.0, 0.0, 0.8, &points);    // 6400 points
  addPlane({0.0, 0.0, -0.5}, 0.0, 0.0, 0.15, &points);  // 225 points: a mirror image, a pit
  const auto ground = estimateGround(*mapOf(points, ObservedLayer(0.05)), {});
  ASSERT_TRUE(ground);
  EXPECT_NEAR(ground->zAt(0.0, 0.0), 0.0, 1e-3);
}

TEST(EstimateGround, HasNoAnswerWithoutLevelSurface) {
  EXPECT_FALSE(estimateGround(*mapOf({}, ObservedLayer(0.05)), {}));
  std::vector<SurfacePoint> wall;
  sampleRectangle({0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, {0.0, 0.0, 1.0}, kSpacing, 0.001, &wall);
  EXPECT_FALSE(estimateGround(*mapOf(wall, ObservedLayer(0.05)), {}));
  EXPECT_FALSE(projectToGround(*mapOf(wall, ObservedLayer(0.05)), {}));
}

void toSamples(const std::vector<SurfacePoint>& points, std::vector<Eigen::Vector3d>* positions,
               std::vector<Eigen::Vector3f>* normals) {
  for (const SurfacePoint& point : points) {
    positions->push_back(point.position_map);
    normals->push_back(point.normal_map);
  }
}

TEST(EstimateGroundOfSamples, AgreesWithTheMapsOnATiltedFloorWithATable) {
  std::vector<SurfacePoint> points;
  addPlane({12.0, -4.0, 1.7}, 0.06, -0.08, 0.8, &points);  // 0.1 rad
  addPlane({12.2, -4.0, 2.1}, 0.0, 0.0, 0.4, &points);     // a table
  std::vector<Eigen::Vector3d> positions;
  std::vector<Eigen::Vector3f> normals;
  toSamples(points, &positions, &normals);
  const auto of_map = estimateGround(*mapOf(points, ObservedLayer(0.05)), {});
  const auto of_samples = estimateGround(positions, normals, {});
  ASSERT_TRUE(of_map && of_samples);
  const Eigen::Vector3d truth = Eigen::Vector3d(-0.06, 0.08, 1.0).normalized();
  EXPECT_LT((of_samples->normal_map - truth).norm(), 1e-3);  // exact points, PCL computes in float
  EXPECT_NEAR(of_samples->zAt(12.0, -4.0), 1.7, 1e-3);
  EXPECT_NEAR(of_samples->zAt(11.5, -3.5), of_map->zAt(11.5, -3.5), 1e-3);
  EXPECT_LT((of_samples->normal_map - of_map->normal_map).norm(), 1e-3);
  EXPECT_EQ(of_samples->num_points, of_map->num_points);
}

TEST(EstimateGroundOfSamples, CountsOnlyFiniteSamplesThatLookUp) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  std::vector<SurfacePoint> points;
  addPlane({0.0, 0.0, 0.3}, 0.0, 0.0, 0.4, &points);
  std::vector<Eigen::Vector3d> positions;
  std::vector<Eigen::Vector3f> normals;
  toSamples(points, &positions, &normals);
  const std::size_t num_ground = positions.size();
  const std::vector<Eigen::Vector3d> on_ground = positions;
  positions.insert(positions.begin(), Eigen::Vector3d::Constant(kNan));  // the first is special: others are taken
  normals.insert(normals.begin(), Eigen::Vector3f::UnitZ());             // relative to it
  for (const Eigen::Vector3d& p : on_ground) {
    const Eigen::Vector3d broken[] = {{kNan, p.y(), p.z()}, {p.x(), p.y(), std::numeric_limits<double>::infinity()}};
    for (const Eigen::Vector3d& q : broken) {
      positions.push_back(q);
      normals.push_back(Eigen::Vector3f::UnitZ());
    }
    positions.push_back(p);  // a good point with a normal that is none
    normals.push_back(Eigen::Vector3f::Constant(static_cast<float>(kNan)));
    positions.push_back(p - Eigen::Vector3d(0.0, 0.0, 1.0));  // a ceiling below it
    normals.push_back(-Eigen::Vector3f::UnitZ());
  }
  const auto ground = estimateGround(positions, normals, {});
  ASSERT_TRUE(ground);
  EXPECT_EQ(ground->num_points, num_ground);
  EXPECT_NEAR(ground->zAt(0.0, 0.0), 0.3, 1e-3);
  const auto first = static_cast<std::ptrdiff_t>(1);
  const auto last = static_cast<std::ptrdiff_t>(1 + num_ground);
  positions.erase(positions.begin() + first, positions.begin() + last);
  normals.erase(normals.begin() + first, normals.begin() + last);
  EXPECT_FALSE(estimateGround(positions, normals, {})) << "nothing is left that counts";
  EXPECT_FALSE(estimateGround(std::vector<Eigen::Vector3d>(), {}, {}));
}

TEST(EstimateGroundOfSamples, RefusesAnotherNumberOfNormals) {
  const std::vector<Eigen::Vector3d> positions(3, Eigen::Vector3d::Zero());
  const std::vector<Eigen::Vector3f> normals(2, Eigen::Vector3f::UnitZ());
  try {
    estimateGround(positions, normals, {});
    FAIL() << "taken";
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "3 points have 2 normals, must be as many");
  }
}

TEST(ProjectToGround, TellsFloorObstacleStepAndWhatIsDrivenUnder) {
  std::vector<SurfacePoint> points;
  addPlane({0.0, 0.0, 0.3}, 0.0, 0.0, 1.0, &points);
  addPlane({0.5, 0.5, 0.45}, 0.0, 0.0, 0.1, &points);   // a box's top, 15 cm above the floor
  addPlane({-0.5, -0.5, 2.5}, 0.0, 0.0, 0.1, &points);  // 2.2 m above the floor: no obstacle
  addPlane({1.4, 0.0, -0.2}, 0.0, 0.0, 0.1, &points);   // half a metre below it, beyond the floor's edge
  const auto grid = projectToGround(*mapOf(points, ObservedLayer(0.05)), {});
  ASSERT_TRUE(grid);
  EXPECT_EQ(stateAt(*grid, 0.0, 0.0), SpaceState::kFree);
  EXPECT_EQ(stateAt(*grid, 0.5, 0.5), SpaceState::kOccupied);
  EXPECT_EQ(stateAt(*grid, 0.7, 0.5), SpaceState::kFree);
  EXPECT_EQ(stateAt(*grid, -0.5, -0.5), SpaceState::kFree);
  EXPECT_EQ(stateAt(*grid, 1.4, 0.0), SpaceState::kOccupied);
  EXPECT_EQ(stateAt(*grid, 1.2, 0.0), SpaceState::kUnknown);
  const int column = static_cast<int>(std::floor((0.5 - grid->origin_x_m) / grid->cell_size_m));
  const int row = static_cast<int>(std::floor((0.5 - grid->origin_y_m) / grid->cell_size_m));
  EXPECT_NEAR(grid->max_height_m[grid->index(column, row)], 0.15, 1e-3);
}

TEST(ProjectToGround, CallsFreeWhereOnlySpaceAboveTheGroundWasSeen) {
  std::vector<SurfacePoint> points;
  addPlane({0.0, 0.0, 0.0}, 0.0, 0.0, 0.5, &points);
  addPlane({1.5, 0.0, 0.0}, 0.0, 0.0, 0.2, &points);
  ObservedLayer observed(0.05);
  auto chunk = std::make_unique<ObservedLayer::Chunk>();
  chunk->fill(1.0f);
  observed.setChunk({1, 0, 0}, *chunk);  // x in [0.8, 1.6), y and z in [0, 0.8)
  const auto grid = projectToGround(*mapOf(points, observed), {});
  ASSERT_TRUE(grid);
  EXPECT_EQ(stateAt(*grid, 1.0, 0.3), SpaceState::kFree);
  EXPECT_EQ(stateAt(*grid, 1.0, -0.3), SpaceState::kUnknown);
}

TEST(ProjectToGround, IsTheSameForTheSamePointsWhateverTheirOrder) {
  std::vector<SurfacePoint> points;
  addPlane({0.0, 0.0, 0.0}, 0.02, 0.01, 0.6, &points);
  addPlane({0.2, 0.1, 0.2}, 0.0, 0.0, 0.1, &points);
  const auto a = projectToGround(*mapOf(points, ObservedLayer(0.05)), {});
  std::reverse(points.begin(), points.end());
  const auto b = projectToGround(*mapOf(points, ObservedLayer(0.05)), {});
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->state, b->state);
  EXPECT_NEAR(a->plane.offset_m, b->plane.offset_m, 1e-4);  // points enter their cell in another order
}

TEST(ProjectToGround, RefusesAMapThatIsTooWide) {
  std::vector<SurfacePoint> points;
  addPlane({0.0, 0.0, 0.0}, 0.0, 0.0, 0.3, &points);
  addPlane({400.0, 0.0, 0.0}, 0.0, 0.0, 0.3, &points);
  EXPECT_FALSE(projectToGround(*mapOf(points, ObservedLayer(0.05)), {}));
}

TEST(GroundOptions, NameEveryImpossibleValue) {
  EXPECT_TRUE(interactive_mapping::problemsOf(GroundOptions{}).empty());
  GroundOptions bad;
  bad.cell_size_m = 0.0;
  bad.min_obstacle_height_m = 0.9;
  bad.max_obstacle_height_m = 0.8;
  EXPECT_EQ(interactive_mapping::problemsOf(bad).size(), 2u);
}

}  // namespace
}  // namespace gpis_mapping
