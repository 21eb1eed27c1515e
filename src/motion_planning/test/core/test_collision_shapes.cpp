// SPDX-License-Identifier: BSD-3-Clause
// The geometry under the collision test, and FCL itself, against oracles that need neither.
#include <functional>
#include <limits>
#include <random>

#include <fcl/geometry/bvh/BVH_model.h>
#include <fcl/narrowphase/collision.h>
#include <fcl/narrowphase/distance.h>
#include <gmock/gmock.h>

#include "collision/block_lattice.h"
#include "collision/collision_scene_data.h"
#include "collision/robot_shapes.h"
#include "support/shape_samples.h"

namespace motion_planning {
namespace {

using mp700_ur5e_description::Box;
using mp700_ur5e_description::Cylinder;
using mp700_ur5e_description::Shape;
using mp700_ur5e_description::Sphere;

/// Of the robot's and a brick's sizes.
Shape randomShape(std::mt19937& engine) {
  std::uniform_real_distribution<double> small(0.03, 0.07);
  std::uniform_real_distribution<double> large(0.05, 0.4);
  switch (engine() % 3) {
    case 0:
      return Box{{large(engine), large(engine), small(engine)}};
    case 1:
      return Cylinder{small(engine), large(engine)};
    default:
      return Sphere{small(engine)};
  }
}

/// The point of the shape that is nearest to one outside, or that point itself. In the shape's frame.
Eigen::Vector3d project(const Shape& shape, const Eigen::Vector3d& p) {
  if (const auto* box = std::get_if<Box>(&shape)) {
    const Eigen::Vector3d half = 0.5 * box->size_m;
    return p.cwiseMax(-half).cwiseMin(half);
  }
  if (const auto* cylinder = std::get_if<Cylinder>(&shape)) {
    const double across = p.head<2>().norm();
    Eigen::Vector3d q = p;
    if (across > cylinder->radius_m) q.head<2>() *= cylinder->radius_m / across;
    q.z() = std::min(std::max(p.z(), -0.5 * cylinder->length_m), 0.5 * cylinder->length_m);
    return q;
  }
  const double radius_m = std::get<Sphere>(shape).radius_m;
  return p.norm() > radius_m ? Eigen::Vector3d(p * (radius_m / p.norm())) : p;
}

/// Largest n . x of the points x of the shape.
double support(const Shape& shape, const Eigen::Vector3d& n) {
  if (const auto* box = std::get_if<Box>(&shape)) return 0.5 * n.cwiseAbs().dot(box->size_m);
  if (const auto* cylinder = std::get_if<Cylinder>(&shape)) {
    return cylinder->radius_m * n.head<2>().norm() + 0.5 * cylinder->length_m * std::abs(n.z());
  }
  return std::get<Sphere>(shape).radius_m * n.norm();
}

/// Bounds on the distance of two convex shapes: projecting to and fro ends at the nearest points (Cheney, Goldstein 1959),
/// which bound it from above, a plane between them from below. 0, 0: they share a point.
struct Bounds {
  double lower_m;
  double upper_m;
};
Bounds distanceBounds(const Shape& a, const Eigen::Isometry3d& T_a, const Shape& b, const Eigen::Isometry3d& T_b) {
  Eigen::Vector3d in_a = T_a.translation();
  Eigen::Vector3d in_b = T_b.translation();
  Bounds bounds{0.0, std::numeric_limits<double>::max()};
  for (int i = 0; i < 3000; ++i) {
    in_b = T_b * project(b, T_b.inverse() * in_a);
    const Eigen::Vector3d gap = in_b - in_a;
    bounds.upper_m = gap.norm();
    if (bounds.upper_m < 1e-9) return {0.0, 0.0};
    const Eigen::Vector3d n = gap.normalized();
    bounds.lower_m =
        std::max(bounds.lower_m, (n.dot(T_b.translation()) - support(b, T_b.linear().transpose() * -n)) -
                                     (n.dot(T_a.translation()) + support(a, T_a.linear().transpose() * n)));
    if (bounds.lower_m > 0.0 && bounds.upper_m - bounds.lower_m < 1e-7) break;
    in_a = T_a * project(a, T_a.inverse() * in_b);
  }
  return bounds;
}

/// Smallest of a convex function on [0, 1], by golden sections, to 1e-9 of the interval.
double minimum(const std::function<double(double)>& f) {
  const double ratio = 0.5 * (std::sqrt(5.0) - 1.0);
  double lo = 0.0;
  double hi = 1.0;
  double x1 = hi - ratio * (hi - lo);
  double x2 = lo + ratio * (hi - lo);
  double f1 = f(x1);
  double f2 = f(x2);
  for (int i = 0; i < 45; ++i) {
    if (f1 < f2) {
      hi = x2;
      x2 = x1;
      f2 = f1;
      x1 = hi - ratio * (hi - lo);
      f1 = f(x1);
    } else {
      lo = x1;
      x1 = x2;
      f1 = f2;
      x2 = lo + ratio * (hi - lo);
      f2 = f(x2);
    }
  }
  return std::min({f1, f2, f(0.0), f(1.0)});
}

/// Signed distance of a shape to the point of the triangle that is nearest to it or deepest within. The distance to a
/// convex shape is a convex function.
double distanceToTriangle(const Shape& shape, const std::array<Eigen::Vector3d, 3>& p) {
  return minimum([&](double u) {
    const Eigen::Vector3d from = p[0] + u * (p[1] - p[0]);
    const Eigen::Vector3d to = p[0] + u * (p[2] - p[0]);
    return minimum([&](double v) { return signedDistance(shape, from + v * (to - from)); });
  });
}

TEST(RobotShapes, SignedDistanceIsThatToTheNearestSurfacePoint) {
  std::mt19937 engine(1);
  std::uniform_real_distribution<double> coordinate(-0.3, 0.3);
  int num_inside = 0;
  for (int i = 0; i < 60; ++i) {
    const Shape shape = randomShape(engine);
    const double step_m = 0.005;
    const std::vector<Eigen::Vector3d> surface = surfacePoints(shape, step_m);
    for (int j = 0; j < 20; ++j) {
      const double scale = j % 2 == 0 ? 1.0 : 0.1;
      const Eigen::Vector3d p = scale * Eigen::Vector3d(coordinate(engine), coordinate(engine), coordinate(engine));
      double nearest = std::numeric_limits<double>::max();
      for (const Eigen::Vector3d& q : surface) nearest = std::min(nearest, (p - q).norm());
      const double distance = signedDistance(shape, p);
      EXPECT_LE(std::abs(distance), nearest + 1e-12);
      EXPECT_GE(std::abs(distance), nearest - step_m);  // how far the nearest sample may be from the nearest point
      const bool is_inside = (project(shape, p) - p).norm() == 0.0;
      EXPECT_EQ(distance <= 0.0, is_inside);
      if (is_inside) ++num_inside;
    }
  }
  EXPECT_GT(num_inside, 200);
}

TEST(RobotShapes, SpheresCoverEachShapeAndAreHardlyWider) {
  std::mt19937 engine(2);
  for (int i = 0; i < 60; ++i) {
    const Shape shape = randomShape(engine);
    const std::vector<CoveringSphere> spheres = coverShape(shape);
    for (const Eigen::Vector3d& p : surfacePoints(shape, 0.01)) {
      // Convex: a surface that is covered from within by balls that reach the axis between them leaves no hole.
      EXPECT_TRUE(std::any_of(spheres.begin(), spheres.end(), [&](const CoveringSphere& sphere) {
        return (p - sphere.center).norm() <= sphere.radius_m + 1e-12;
      }));
    }
    for (const CoveringSphere& sphere : spheres) {
      EXPECT_LE(signedDistance(shape, sphere.center), 0.0);
      if (const auto* box = std::get_if<Box>(&shape)) {
        const bool is_plate = box->size_m.maxCoeff() > 8.0 * box->size_m.minCoeff();
        EXPECT_LE(2.0 * sphere.radius_m, (is_plate ? 0.25 * box->size_m.maxCoeff() : box->size_m.minCoeff()));
      }
      if (const auto* cylinder = std::get_if<Cylinder>(&shape)) {
        EXPECT_LE(sphere.radius_m, 1.2 * cylinder->radius_m);
      }
    }
  }
}

TEST(RobotShapes, CorePointsAreDeepAndDense) {
  std::mt19937 engine(3);
  for (int i = 0; i < 60; ++i) {
    const Shape shape = randomShape(engine);
    double depth_m = std::numeric_limits<double>::max();
    for (int axis = 0; axis < 3; ++axis) depth_m = std::min(depth_m, support(shape, Eigen::Vector3d::Unit(axis)));
    const std::vector<Eigen::Vector3d> core = corePoints(shape);
    for (const Eigen::Vector3d& p : core) EXPECT_NEAR(signedDistance(shape, p), -depth_m, 1e-12);
    // The ends too: no surface point is farther than the corner of a cube of the shape's thickness.
    for (const Eigen::Vector3d& q : surfacePoints(shape, 0.02)) {
      double nearest = std::numeric_limits<double>::max();
      for (const Eigen::Vector3d& p : core) nearest = std::min(nearest, (p - q).norm());
      EXPECT_LE(nearest, std::sqrt(3.0) * depth_m * 1.1);
    }
  }
}

TEST(RobotShapes, ExtentsHoldTheSurfaceAndTouchIt) {
  std::mt19937 engine(4);
  for (int i = 0; i < 60; ++i) {
    const Shape shape = randomShape(engine);
    const Eigen::Matrix3d R = randomPose(engine, 0.0).linear();
    Eigen::Vector3d sampled = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& p : surfacePoints(shape, 0.004)) sampled = sampled.cwiseMax(R * p);
    const Eigen::Vector3d exact = halfExtents(shape, R);
    EXPECT_TRUE((exact.array() >= sampled.array() - 1e-12).all());
    EXPECT_TRUE((exact.array() <= sampled.array() + 0.004).all());  // a sample is that near to the outermost point
    EXPECT_LE(sampled.norm(), std::sqrt(3.0) * boundingRadius(shape));
    for (const Eigen::Vector3d& p : surfacePoints(shape, 0.02)) EXPECT_LE(p.norm(), boundingRadius(shape) + 1e-12);
  }
}

TEST(RobotShapes, InflatedShapeHoldsAllThatIsNear) {
  std::mt19937 engine(5);
  for (int i = 0; i < 30; ++i) {
    const Shape shape = randomShape(engine);
    for (const Eigen::Vector3d& p : surfacePoints(inflate(shape, 0.01), 0.01)) {
      EXPECT_GE(signedDistance(shape, p), 0.01 - 1e-12);
      EXPECT_LE(signedDistance(shape, p), 0.01 * std::sqrt(3.0) + 1e-12);
    }
  }
}

TEST(RobotShapes, OnlyRigidTransformsAreRigid) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  EXPECT_TRUE(isRigid(T));
  T.linear()(0, 0) = -1.0;  // a mirror
  EXPECT_FALSE(isRigid(T));
  T.linear() = 1.01 * Eigen::Matrix3d::Identity();
  EXPECT_FALSE(isRigid(T));
  T = Eigen::Isometry3d::Identity();
  T.translation().x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(isRigid(T));
}

TEST(BlockLattice, DistancesMatchBruteForce) {
  std::mt19937 engine(6);
  for (const double share : {0.0, 0.002, 0.05, 0.5}) {
    for (int round = 0; round < 8; ++round) {
      const BlockLattice lattice(0.05, {-3, 4, 7}, {8, 12, 21});  // no two edges alike
      std::vector<std::uint8_t> is_set(lattice.count());
      for (auto& value : is_set) value = std::uniform_real_distribution<double>()(engine) < share;
      std::vector<Eigen::Vector3i> all;
      for (std::size_t i = 0; i < is_set.size(); ++i) {
        if (is_set[i]) all.push_back(lattice.position(i));
      }
      const std::vector<std::int32_t> squared = squaredDistances(lattice, is_set);
      const std::vector<std::uint8_t> grown = dilate(lattice, is_set);
      for (std::size_t i = 0; i < is_set.size(); ++i) {
        std::int32_t nearest = kNoBlock;
        int largest_step = 1 << 14;
        for (const Eigen::Vector3i& at : all) {
          nearest = std::min(nearest, (at - lattice.position(i)).squaredNorm());
          largest_step = std::min(largest_step, (at - lattice.position(i)).cwiseAbs().maxCoeff());
        }
        ASSERT_EQ(squared[i], nearest);
        ASSERT_EQ(grown[i] != 0, largest_step <= 1);
      }
    }
  }
}

TEST(BlockLattice, ClampsToTheNearestBlock) {
  const BlockLattice lattice(0.1, {-2, 0, 5}, {3, 1, 9});
  EXPECT_EQ(lattice.clamped({-5.0, 0.05, 0.75}), Eigen::Vector3i(0, 0, 2));
  EXPECT_EQ(lattice.clamped({1e9, 1e9, -1e9}), Eigen::Vector3i(5, 1, 0));
  EXPECT_TRUE(lattice.contains(lattice.center({5, 1, 4})));
  EXPECT_FALSE(lattice.contains({0.0, 0.25, 0.75}));
  for (std::size_t i = 0; i < lattice.count(); ++i) EXPECT_EQ(lattice.index(lattice.position(i)), i);
}

/// The arm's pairs, cylinder on cylinder above all, have no closed form in FCL: they go through libccd's GJK.
TEST(Fcl, SaysWhetherShapesOverlap) {
  std::mt19937 engine(7);
  int num_apart = 0;
  int num_overlapping = 0;
  int num_undecided = 0;
  for (int i = 0; i < 20000; ++i) {
    const Shape a = randomShape(engine);
    const Shape b = randomShape(engine);
    const Eigen::Isometry3d T_a = randomPose(engine, 0.0);
    const Eigen::Isometry3d T_b = randomPose(engine, 0.2);
    const Bounds truth = distanceBounds(a, T_a, b, T_b);
    fcl::CollisionResultd result;
    const bool overlap = fcl::collide(toFcl(a).get(), T_a, toFcl(b).get(), T_b, fcl::CollisionRequestd(), result) > 0;
    if (truth.upper_m == 0.0) {
      ++num_overlapping;
      EXPECT_TRUE(overlap) << i;
    } else if (truth.lower_m > 1e-5) {  // FCL's own tolerance is 1e-6
      ++num_apart;
      EXPECT_FALSE(overlap) << i << " apart by " << truth.lower_m;
    } else {
      ++num_undecided;
    }
  }
  EXPECT_GT(num_apart, 5000);
  EXPECT_GT(num_overlapping, 5000);
  EXPECT_LT(num_undecided, 200);
}

TEST(Fcl, SaysWhetherAndHowFarATriangleIs) {
  std::mt19937 engine(8);
  std::uniform_real_distribution<double> coordinate(-0.3, 0.3);
  std::uniform_real_distribution<double> edge(-0.02, 0.02);
  int num_apart = 0;
  int num_overlapping = 0;
  for (int i = 0; i < 3000; ++i) {
    const Shape shape = randomShape(engine);
    std::array<Eigen::Vector3d, 3> triangle;
    triangle[0] << 0.5 * coordinate(engine), 0.5 * coordinate(engine), 0.5 * coordinate(engine);
    for (std::size_t v = 1; v < 3; ++v) {
      triangle[v] = triangle[0] + Eigen::Vector3d(edge(engine), edge(engine), edge(engine));
    }
    const double truth_m = distanceToTriangle(shape, triangle);
    const Eigen::Isometry3d T = randomPose(engine, 1.0);
    const std::vector<Eigen::Vector3d> moved = {T * triangle[0], T * triangle[1], T * triangle[2]};
    const SurfaceChunk chunk(moved, moved, {{0, 1, 2}});
    fcl::CollisionResultd collision;
    const bool overlap = fcl::collide(&chunk.bvh(), Eigen::Isometry3d::Identity(), toFcl(shape).get(), T,
                                      fcl::CollisionRequestd(), collision) > 0;
    if (truth_m < -1e-5) {
      ++num_overlapping;
      EXPECT_TRUE(overlap) << i << " by " << truth_m;
      continue;
    }
    if (truth_m < 1e-5) continue;
    ++num_apart;
    EXPECT_FALSE(overlap) << i << " apart by " << truth_m;
    fcl::DistanceResultd distance;
    fcl::distance(&chunk.mappedBvh(), Eigen::Isometry3d::Identity(), toFcl(shape).get(), T, exactDistanceRequest(),
                  distance);
    EXPECT_NEAR(distance.min_distance, truth_m, 1e-6) << i;
  }
  EXPECT_GT(num_apart, 1000);
  EXPECT_GT(num_overlapping, 150);
}

}  // namespace
}  // namespace motion_planning
