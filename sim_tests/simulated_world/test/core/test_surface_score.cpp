// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/surface_score.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include <gtest/gtest.h>

#include "synthetic_depth/seeded_random.h"

namespace simulated_world {
namespace {

using synthetic_depth::SeededRandom;

Eigen::Vector3d randomPoint(SeededRandom& random, double half_m) {
  return {random.uniform(-half_m, half_m), random.uniform(-half_m, half_m), random.uniform(-half_m, half_m)};
}

PileBrick leaningBrick() {
  PileBrick brick;
  brick.id = 3;
  brick.T_map_brick.translation() = Eigen::Vector3d(0.4, -0.2, 0.3);
  brick.T_map_brick.linear() = Eigen::AngleAxisd(0.8, Eigen::Vector3d(1.0, 2.0, 0.5).normalized()).toRotationMatrix();
  brick.size_m = Eigen::Vector3d(0.3, 0.15, 0.1);
  return brick;
}

/// The brick's surface grown by `grow_m` on all sides, two triangles per face.
StrategySurface meshOf(const PileBrick& brick, double grow_m) {
  StrategySurface mesh;
  const Eigen::Vector3d half = 0.5 * brick.size_m + Eigen::Vector3d::Constant(grow_m);
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3;
    const int v = (axis + 2) % 3;
    for (const double side : {-1.0, 1.0}) {
      const auto first = static_cast<std::uint32_t>(mesh.points_map.size());
      for (const auto& [du, dv] : {std::pair<double, double>{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}) {
        Eigen::Vector3d p;
        p[axis] = side * half[axis];
        p[u] = du * half[u];
        p[v] = dv * half[v];
        mesh.points_map.push_back(brick.T_map_brick * p);
      }
      mesh.triangles.push_back({first, first + 1, first + 2});
      mesh.triangles.push_back({first, first + 2, first + 3});
    }
  }
  return mesh;
}

/// A square sheet at height z with its corner at (x, y), in two triangles.
StrategySurface sheet(double x, double y, double z, double side_m) {
  StrategySurface mesh;
  mesh.points_map = {{x, y, z}, {x + side_m, y, z}, {x + side_m, y + side_m, z}, {x, y + side_m, z}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return mesh;
}

const GroundRegion kEverywhere{Eigen::Vector2d(-10.0, -10.0), Eigen::Vector2d(10.0, 10.0)};

TEST(DistanceToTriangle, IsTheSmallestDistanceToItsPoints) {
  SeededRandom random(1);
  const int n = 150;
  for (int repeat = 0; repeat < 60; ++repeat) {
    const Eigen::Vector3d a = randomPoint(random, 0.1);
    const Eigen::Vector3d b = randomPoint(random, 0.1);
    const Eigen::Vector3d c =
        repeat % 10 == 0 ? Eigen::Vector3d(0.3 * a + 0.7 * b) : randomPoint(random, 0.1);  // a needle
    const Eigen::Vector3d p = randomPoint(random, 0.2);
    double smallest = std::numeric_limits<double>::infinity();
    for (int i = 0; i <= n; ++i) {
      for (int j = 0; j <= n - i; ++j) {
        smallest = std::min(smallest, (p - (a + (b - a) * i / n + (c - a) * j / n)).norm());
      }
    }
    const double distance = distanceToTriangle(p, a, b, c);
    EXPECT_LE(distance, smallest + 1e-12);
    EXPECT_GE(distance, smallest - 0.35 / n);  // no point of the triangle is farther from a tried one: edges <= 0.35 m
  }
  const Eigen::Vector3d point(0.1, 0.2, 0.3);
  EXPECT_NEAR(distanceToTriangle({0.1, 0.2, 0.5}, point, point, point), 0.2, 1e-12);
}

TEST(DistanceToFaces, IsTheSmallestDistanceToPointsOfTheFaces) {
  const PileBrick brick = leaningBrick();
  const auto samples = sampleFaces(brick.size_m, 0.004);
  SeededRandom random(2);
  int num_inside = 0;
  for (int repeat = 0; repeat < 300; ++repeat) {
    const Eigen::Vector3d p_brick = randomPoint(random, 0.2).cwiseProduct(Eigen::Vector3d(1.0, 0.5, 0.4));
    double smallest = std::numeric_limits<double>::infinity();
    for (const FaceSample& sample : samples) smallest = std::min(smallest, (p_brick - sample.p_brick).norm());
    const double distance = distanceToFaces(brick.T_map_brick * p_brick, brick);
    EXPECT_LE(distance, smallest + 1e-9);
    EXPECT_GE(distance, smallest - 0.003);  // half the diagonal of a sample's rectangle
    num_inside += (p_brick.cwiseAbs() - 0.5 * brick.size_m).maxCoeff() < 0.0 ? 1 : 0;
  }
  EXPECT_GT(num_inside, 30);
}

TEST(IsNearSurface, AgreesWithTryingEveryPair) {
  SeededRandom random(3);
  for (const auto& [is_cloud, has_outlier] :
       {std::pair(false, false), std::pair(false, true), std::pair(true, false), std::pair(true, true)}) {
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 400; ++i) points.push_back(randomPoint(random, 0.3));
    if (has_outlier) points.emplace_back(40.0, -30.0, 0.0);  // a brick that rolled away
    StrategySurface surface;
    for (int i = 0; i < (is_cloud ? 3000 : 300); ++i) {
      const Eigen::Vector3d center = randomPoint(random, 0.5);
      const double size_m = i % 20 == 0 ? 1.0 : 0.03;
      for (int k = 0; k < 3; ++k) surface.points_map.push_back(center + randomPoint(random, size_m));
      const auto first = static_cast<std::uint32_t>(3 * i);
      if (!is_cloud) surface.triangles.push_back({first, first + 1, first + 2});
    }
    const std::vector<bool> is_near = isNearSurface(points, surface, 0.02);
    int num_near = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      double distance = std::numeric_limits<double>::infinity();
      if (is_cloud) {
        for (const auto& p : surface.points_map) distance = std::min(distance, (p - points[i]).norm());
      }
      for (const auto& t : surface.triangles) {
        distance = std::min(distance, distanceToTriangle(points[i], surface.points_map[t[0]], surface.points_map[t[1]],
                                                         surface.points_map[t[2]]));
      }
      EXPECT_EQ(is_near[i], distance <= 0.02) << distance;
      num_near += is_near[i] ? 1 : 0;
    }
    EXPECT_GT(num_near, 20);
    EXPECT_LT(num_near, 360);
  }
}

TEST(IsNearSurface, NothingIsNearAnEmptySurface) {
  const std::vector<bool> is_near = isNearSurface({Eigen::Vector3d::Zero()}, StrategySurface(), 0.02);
  ASSERT_EQ(is_near.size(), 1U);
  EXPECT_FALSE(is_near[0]);
  EXPECT_TRUE(isNearSurface({}, sheet(0.0, 0.0, 0.0, 1.0), 0.02).empty());
}

TEST(SurfacePrecision, TellsGrownBricksByTheTolerance) {
  const PileBrick brick = leaningBrick();
  const ScoreConfig config;
  const auto precisionOf = [&](double grow_m) {
    return surfacePrecision(meshOf(brick, grow_m), {brick}, kEverywhere, 0.0, config).value();
  };
  EXPECT_EQ(precisionOf(0.0), 1.0);
  EXPECT_EQ(precisionOf(-0.0199), 1.0);
  EXPECT_EQ(precisionOf(-0.0201), 0.0);
  EXPECT_EQ(precisionOf(0.0201), 0.0);
  // Of the grown faces, right is what lies over the brick's own (area 0.18 m^2), and 2 mm around it: beyond, the brick's
  // edges are farther than its faces. The patches of 1 cm that are cut by the border may go either way.
  const double area_m2 = 2.0 * (0.3398 * 0.1898 + 0.1898 * 0.1398 + 0.3398 * 0.1398);
  EXPECT_NEAR(precisionOf(0.0199), 0.18 / area_m2, 0.05);
}

TEST(SurfacePrecision, IsAShareOfArea) {
  PileBrick brick = leaningBrick();
  brick.T_map_brick = Eigen::Isometry3d::Identity();
  brick.T_map_brick.translation().z() = 0.05;
  brick.size_m = Eigen::Vector3d(0.4, 0.4, 0.1);
  // A sheet on the top that reaches 0.2 m beyond it on two sides; right are the top and 2 cm around its edges.
  const double right_m2 = 0.4 * 0.4 + 2.0 * 0.02 * 0.4 + 0.25 * 3.14159 * 0.02 * 0.02;
  const double share = surfacePrecision(sheet(-0.2, -0.2, 0.1, 0.6), {brick}, kEverywhere, 0.0, ScoreConfig()).value();
  // The border of the right part is 0.8 m long, and each patch of 1 cm along it may be judged wrong by half of it.
  EXPECT_NEAR(share, right_m2 / 0.36, 0.8 * 0.005 / 0.36);
}

TEST(SurfacePrecision, LeavesOutTheGroundAndWhatIsFarAway) {
  const PileBrick brick = leaningBrick();
  const ScoreConfig config;
  EXPECT_FALSE(surfacePrecision(sheet(0.0, 0.0, 0.029, 1.0), {brick}, kEverywhere, 0.0, config));
  EXPECT_LT(surfacePrecision(sheet(0.0, 0.0, 0.031, 1.0), {brick}, kEverywhere, 0.0, config).value(), 1.0);
  EXPECT_FALSE(surfacePrecision(sheet(0.0, 0.0, 0.531, 1.0), {brick}, kEverywhere, 0.51, config));
  const GroundRegion elsewhere{Eigen::Vector2d(3.0, 3.0), Eigen::Vector2d(4.0, 4.0)};
  EXPECT_FALSE(surfacePrecision(sheet(0.0, 0.0, 0.5, 1.0), {brick}, elsewhere, 0.0, config));
  EXPECT_FALSE(surfacePrecision(StrategySurface(), {brick}, kEverywhere, 0.0, config));
}

TEST(SurfacePrecision, CutsATriangleAtTheLimitsOfHeightAndRegion) {
  PileBrick brick = leaningBrick();
  brick.T_map_brick = Eigen::Isometry3d::Identity();
  // An upright sheet from the ground to a brick that hangs over it.
  StrategySurface surface;
  surface.points_map = {{0.15, 0.0, 0.0}, {0.15, 0.06, 0.0}, {0.15, 0.06, 0.06}, {0.15, 0.0, 0.06}};
  surface.triangles = {{0, 1, 2}, {0, 2, 3}};
  brick.T_map_brick.translation().z() = 0.11;  // from 6 cm up: within 2 cm of it is what is above 4 cm
  // Of the 3 cm that count, 2 cm are right; patches of 1 cm may go either way at both limits.
  const auto share = surfacePrecision(surface, {brick}, kEverywhere, 0.0, ScoreConfig());
  EXPECT_NEAR(share.value(), 2.0 / 3.0, 0.15);
  // A region that ends in the middle of a sheet on the brick's top, which lies half beside the brick.
  const GroundRegion near_half{Eigen::Vector2d(-1.0, -1.0), Eigen::Vector2d(0.15, 0.075)};
  EXPECT_EQ(surfacePrecision(sheet(0.05, -0.05, 0.16, 0.1), {brick}, near_half, 0.0, ScoreConfig()), 1.0);
  EXPECT_LT(surfacePrecision(sheet(0.1, -0.05, 0.16, 0.2), {brick}, kEverywhere, 0.0, ScoreConfig()).value(), 0.6);
  EXPECT_EQ(surfacePrecision(sheet(0.1, -0.05, 0.16, 0.2), {brick}, near_half, 0.0, ScoreConfig()), 1.0);
}

TEST(SurfacePrecision, JudgesEveryPieceOfATriangle) {
  // Cut into 3 x 3 pieces; a tiny brick makes the one right that has its corner in the middle of the others.
  StrategySurface surface;
  surface.points_map = {{0.0, 0.0, 0.5}, {0.3, 0.0, 0.5}, {0.0, 0.3, 0.5}};
  surface.triangles = {{0, 1, 2}};
  PileBrick brick;
  brick.T_map_brick.translation() = Eigen::Vector3d(0.2 / 3.0, 0.2 / 3.0, 0.5);
  brick.size_m = Eigen::Vector3d::Constant(0.01);
  ScoreConfig config;
  config.patch_size_m = 0.15;
  EXPECT_NEAR(surfacePrecision(surface, {brick}, kEverywhere, 0.0, config).value(), 1.0 / 9.0, 1e-12);
}

TEST(SurfacePrecision, OfACloudCountsPoints) {
  const PileBrick brick = leaningBrick();
  StrategySurface cloud;
  for (const FaceSample& sample : sampleFaces(brick.size_m, 0.05)) {
    cloud.points_map.push_back(brick.T_map_brick * sample.p_brick);
  }
  const std::size_t num_right = cloud.points_map.size();
  for (std::size_t i = 0; i < num_right; ++i) cloud.points_map.emplace_back(1.0, 1.0, 0.5);
  EXPECT_EQ(surfacePrecision(cloud, {brick}, kEverywhere, 0.0, ScoreConfig()), 0.5);
  // Neither the ground nor what is far away counts.
  for (std::size_t i = 0; i < num_right; ++i) {
    cloud.points_map.emplace_back(1.0, 1.0, 0.029);
    cloud.points_map.emplace_back(11.0, 1.0, 0.5);
  }
  EXPECT_EQ(surfacePrecision(cloud, {brick}, kEverywhere, 0.0, ScoreConfig()), 0.5);
}

TEST(StrategySurface, RefusesABrokenMesh) {
  StrategySurface surface = sheet(0.0, 0.0, 0.1, 1.0);
  EXPECT_NO_THROW(surface.check());
  surface.triangles.push_back({0, 1, 4});
  EXPECT_THROW(surface.check(), std::invalid_argument);
  surface = sheet(0.0, 0.0, 0.1, 1.0);
  surface.points_map[2].y() = std::nan("");
  EXPECT_THROW(surface.check(), std::invalid_argument);
  surface = sheet(0.0, 0.0, 0.1, 1.0);
  surface.stamp_s = std::numeric_limits<double>::infinity();
  EXPECT_THROW(surface.check(), std::invalid_argument);
}

TEST(SurfaceScore, TakesALargeMapInWellUnderASecond) {
  // A wavy sheet over 3 m x 3 m in 100 000 triangles, 20 000 points of the pile close to it, 40 bricks.
  SeededRandom random(4);
  StrategySurface surface;
  const std::uint32_t n = 224;
  const auto height = [](double x, double y) { return 0.2 + 0.1 * std::sin(5.0 * x) * std::cos(4.0 * y); };
  for (std::uint32_t i = 0; i <= n; ++i) {
    for (std::uint32_t j = 0; j <= n; ++j) {
      const double x = 3.0 * i / n - 1.5;
      const double y = 3.0 * j / n - 1.5;
      surface.points_map.emplace_back(x, y, height(x, y));
      if (i < n && j < n) {
        const std::uint32_t k = i * (n + 1) + j;
        surface.triangles.push_back({k, k + n + 1, k + 1});
        surface.triangles.push_back({k + 1, k + n + 1, k + n + 2});
      }
    }
  }
  ASSERT_GE(surface.triangles.size(), 100000U);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 20000; ++i) {
    const double x = random.uniform(-1.5, 1.5);
    const double y = random.uniform(-1.5, 1.5);
    points.emplace_back(x, y, height(x, y) + random.uniform(-0.04, 0.04));
  }
  std::vector<PileBrick> bricks(40, leaningBrick());
  for (PileBrick& brick : bricks) brick.T_map_brick.translation() += randomPoint(random, 1.0);
  const auto begin = std::chrono::steady_clock::now();
  const std::vector<bool> is_near = isNearSurface(points, surface, 0.02);
  const auto precision = surfacePrecision(surface, bricks, kEverywhere, 0.0, ScoreConfig());
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
  RecordProperty("milliseconds", static_cast<int>(1000.0 * seconds.count()));
  EXPECT_GT(std::count(is_near.begin(), is_near.end(), true), 5000);
  EXPECT_TRUE(precision.has_value());
  EXPECT_LT(seconds.count(), 1.0);
}

}  // namespace
}  // namespace simulated_world
