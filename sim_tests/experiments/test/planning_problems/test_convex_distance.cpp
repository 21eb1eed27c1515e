// SPDX-License-Identifier: BSD-3-Clause
// The judge's geometry against closed forms and brute force.
#include "planning_problems/convex_distance.h"

#include <cmath>

#include <gtest/gtest.h>

#include "synthetic_depth/seeded_random.h"

namespace experiments {
namespace {

using mp700_ur5e_description::Box;
using mp700_ur5e_description::Cylinder;
using mp700_ur5e_description::Shape;
using mp700_ur5e_description::Sphere;
using synthetic_depth::SeededRandom;

constexpr double kTolerance_m = 1e-4;

Solid at(const Shape& shape, const Eigen::Vector3d& p, const Eigen::Vector3d& axis = Eigen::Vector3d::UnitZ(),
         double angle_rad = 0.0) {
  Solid solid{shape, Eigen::Isometry3d::Identity()};
  solid.T_world_shape.translation() = p;
  solid.T_world_shape.linear() = Eigen::AngleAxisd(angle_rad, axis.normalized()).matrix();
  return solid;
}

Eigen::Vector3d randomVector(SeededRandom* random, double half) {
  return {random->uniform(-half, half), random->uniform(-half, half), random->uniform(-half, half)};
}

Solid randomSolid(SeededRandom* random, double half_m = 0.4) {
  const Eigen::Vector3d p = randomVector(random, half_m);
  const Eigen::Vector3d axis = randomVector(random, 1.0);
  const double angle_rad = random->uniform(0.0, 3.0);
  switch (random->next() % 3) {
    case 0:
      return at(
          Box{Eigen::Vector3d(random->uniform(0.05, 0.4), random->uniform(0.05, 0.4), random->uniform(0.05, 0.4))}, p,
          axis, angle_rad);
    case 1:
      return at(Cylinder{random->uniform(0.02, 0.1), random->uniform(0.05, 0.4)}, p, axis, angle_rad);
    default:
      return at(Sphere{random->uniform(0.02, 0.2)}, p, axis, angle_rad);
  }
}

void expectDistance(double truth_m, const Solid& a, const Solid& b) {
  for (const ConvexDistance& distance : {convexDistance(a, b), convexDistance(b, a)}) {
    EXPECT_LE(distance.lower_m, truth_m + 1e-12);
    EXPECT_GE(distance.upper_m, truth_m - 1e-12);
    EXPECT_LT(distance.upper_m - distance.lower_m, kTolerance_m);
  }
}

TEST(ConvexDistance, MatchesClosedForms) {
  expectDistance(0.7, at(Sphere{0.2}, {0.0, 0.0, 0.0}), at(Sphere{0.1}, {0.6, 0.8, 0.0}));
  // Faces, edges and corners of two boxes that meet in parallel.
  const Shape cube = Box{Eigen::Vector3d(0.2, 0.2, 0.2)};
  expectDistance(0.1, at(cube, {0.0, 0.0, 0.0}), at(cube, {0.3, 0.05, -0.1}));
  expectDistance(std::hypot(0.1, 0.2), at(cube, {0.0, 0.0, 0.0}), at(cube, {0.3, 0.4, -0.1}));
  expectDistance(Eigen::Vector3d(0.1, 0.2, 0.3).norm(), at(cube, {0.0, 0.0, 0.0}), at(cube, {0.3, 0.4, 0.5}));
  // A cylinder lying across a face: by its mantle; standing on it: by its end.
  const Shape tube = Cylinder{0.05, 0.3};
  expectDistance(0.03, at(tube, {0.0, 0.0, 0.18}, {1.0, 0.0, 0.0}, M_PI_2), at(cube, {0.0, 0.0, 0.0}));
  expectDistance(0.07, at(tube, {0.0, 0.0, 0.32}), at(cube, {0.0, 0.0, 0.0}));
  // Two cylinders, end to end and crossing at right angles.
  expectDistance(0.2, at(tube, {0.0, 0.0, 0.25}), at(tube, {0.0, 0.0, -0.25}));
  expectDistance(0.2, at(tube, {0.0, 0.0, 0.3}, {1.0, 0.0, 0.0}, M_PI_2),
                 at(tube, {0.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, M_PI_2));
}

/// Points on the surface of a solid, at most about `step_m` apart.
std::vector<Eigen::Vector3d> surfacePoints(const Solid& solid, double step_m) {
  std::vector<Eigen::Vector3d> points;
  const double half = 0.6;
  // Rays from the middle in all directions: the solids are convex about it.
  const int rings = static_cast<int>(M_PI * 0.35 / step_m);
  for (int i = 0; i <= rings; ++i) {
    const double theta = M_PI * i / rings;
    const int turns = std::max(1, static_cast<int>(2.0 * rings * std::sin(theta)));
    for (int j = 0; j < turns; ++j) {
      const double phi = 2.0 * M_PI * j / turns;
      const Eigen::Vector3d way(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta));
      double inside = 0.0;
      double outside = half;
      while (outside - inside > 1e-5) {
        const double middle = 0.5 * (inside + outside);
        const Eigen::Vector3d p = solid.T_world_shape.translation() + middle * way;
        ((nearestPoint(solid, p) - p).norm() < 1e-12 ? inside : outside) = middle;
      }
      points.push_back(solid.T_world_shape.translation() + inside * way);
    }
  }
  return points;
}

TEST(ConvexDistance, MatchesBruteForceOverSurfacePoints) {
  SeededRandom random(3);
  constexpr double kStep_m = 0.006;
  int apart = 0;
  int overlapping = 0;
  for (int i = 0; i < 60; ++i) {
    const double half_m = i % 2 == 0 ? 0.4 : 0.12;
    const Solid a = randomSolid(&random, half_m);
    const Solid b = randomSolid(&random, half_m);
    double brute_m = 1e9;
    for (const Eigen::Vector3d& p : surfacePoints(a, kStep_m))
      brute_m = std::min(brute_m, (nearestPoint(b, p) - p).norm());
    const ConvexDistance distance = convexDistance(a, b);
    // Every point of the surface is at least as far as the nearest one ...
    EXPECT_LE(distance.lower_m, brute_m + 1e-9) << i;
    // ... and one is within a step of it, and of the rays' slant where the surface is seen edge-on.
    EXPECT_GE(distance.upper_m, brute_m - 3.0 * kStep_m) << i;
    if (distance.lower_m > 0.01) ++apart;
    if (distance.upper_m < 1e-3) {
      ++overlapping;
      EXPECT_LT(brute_m, 3.0 * kStep_m) << i;
    }
  }
  EXPECT_GT(apart, 15);
  EXPECT_GT(overlapping, 15);
}

TEST(ConvexDistance, BoundsCloseInOnEachOther) {
  SeededRandom random(5);
  int apart = 0;
  for (int i = 0; i < 5000; ++i) {
    const Solid a = randomSolid(&random);
    const Solid b = randomSolid(&random);
    const ConvexDistance distance = convexDistance(a, b, kTolerance_m, 1e9, 1e-5, 2000);
    ASSERT_LE(distance.lower_m, distance.upper_m + 1e-12);
    if (distance.upper_m < 1e-3) continue;  // meeting: the bounds need not
    ++apart;
    EXPECT_LT(distance.upper_m - distance.lower_m, kTolerance_m)
        << i << ": " << distance.lower_m << " " << distance.upper_m;
  }
  EXPECT_GT(apart, 1500);
}

TEST(ConvexDistance, NearestPointIsInsideAndNoOtherIsNearer) {
  SeededRandom random(7);
  for (int i = 0; i < 500; ++i) {
    const Solid solid = randomSolid(&random);
    const Eigen::Vector3d p = randomVector(&random, 0.8);
    const Eigen::Vector3d nearest = nearestPoint(solid, p);
    EXPECT_LT((nearestPoint(solid, nearest) - nearest).norm(), 1e-12);
    // The plane through the nearest point has the whole solid on its far side (projection onto a convex set).
    const Eigen::Vector3d n = p - nearest;
    EXPECT_LE(support(solid, n), n.dot(nearest) + 1e-9);
  }
}

}  // namespace
}  // namespace experiments
