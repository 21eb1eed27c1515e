// SPDX-License-Identifier: BSD-3-Clause
#include "surface_comparison/mesh_distance.h"

#include <cmath>
#include <limits>
#include <stdexcept>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "synthetic_depth/seeded_random.h"

namespace {

using Eigen::Vector3d;
using experiments::MeshDistance;
using experiments::Surface;

/// Box with outward faces; each face has corners of its own unless they are welded by position.
Surface makeBox(const Vector3d& half, bool with_top = true) {
  Surface box;
  for (int axis = 0; axis < 3; ++axis) {
    for (const int side : {-1, 1}) {
      if (axis == 2 && side == 1 && !with_top) continue;
      const auto first = static_cast<std::uint32_t>(box.points_map.size());
      for (const auto& [b, c] : {std::pair<int, int>{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}) {
        Vector3d p;
        p[axis] = side;
        p[(axis + 1) % 3] = b;
        p[(axis + 2) % 3] = c;
        box.points_map.push_back(p.cwiseProduct(half));
      }
      const std::uint32_t second = side > 0 ? 1 : 3;
      box.triangles.push_back({first, first + second, first + 2});
      box.triangles.push_back({first, first + 2, first + 4 - second});
    }
  }
  return box;
}

/// Oracle that shares no formula with the code: projected gradient over barycentric coordinates is replaced by a fine
/// recursive search. The error is at most the last sub-triangle's size.
double searchedDistance(const Vector3d& p, const Vector3d& a, const Vector3d& b, const Vector3d& c) {
  constexpr int kSteps = 200;
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps - i; ++j) {
      const Vector3d q = a + (b - a) * i / kSteps + (c - a) * j / kSteps;
      best = std::min(best, (p - q).norm());
    }
  }
  return best;
}

TEST(MeshDistance, MagnitudeAgreesWithBruteForceOverAllTriangles) {
  synthetic_depth::SeededRandom random(3);
  const auto point = [&](double r) {
    return Vector3d(random.uniform(-r, r), random.uniform(-r, r), random.uniform(-r, r));
  };
  Surface soup;
  for (std::uint32_t k = 0; k < 20; ++k) {
    const Vector3d center = point(0.5);
    for (int corner = 0; corner < 3; ++corner) soup.points_map.push_back(center + point(0.2));
    soup.triangles.push_back({3 * k, 3 * k + 1, 3 * k + 2});
  }
  const MeshDistance distance(soup);
  for (int k = 0; k < 40; ++k) {
    const Vector3d p = point(0.8);
    double best = std::numeric_limits<double>::infinity();
    for (const auto& t : soup.triangles) {
      best = std::min(best, searchedDistance(p, soup.points_map[t[0]], soup.points_map[t[1]], soup.points_map[t[2]]));
    }
    // Sides are at most 0.7 m, so a search point is within 0.7 m / 200 of any point of the triangle, never nearer.
    const double found = std::abs(distance.nearest(p).signed_distance_m);
    EXPECT_LE(found, best + 1e-12);
    EXPECT_GE(found, best - 0.0035);
  }
}

TEST(MeshDistance, SignAndValueAreThoseOfABoxAlsoBesideEdgesAndCorners) {
  const Vector3d half(0.15, 0.075, 0.05);
  const MeshDistance distance(makeBox(half));
  synthetic_depth::SeededRandom random(4);
  for (int k = 0; k < 2000; ++k) {
    const Vector3d p(random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3));
    const Vector3d q = p.cwiseAbs() - half;
    const double exact = q.cwiseMax(0.0).norm() + std::min(0.0, q.maxCoeff());
    const MeshDistance::Nearest nearest = distance.nearest(p);
    EXPECT_NEAR(nearest.signed_distance_m, exact, 1e-12) << p.transpose();  // rounding
    EXPECT_FALSE(nearest.on_border);
  }
}

TEST(MeshDistance, TellsWhereTheMeshEnds) {
  const MeshDistance open(makeBox(Vector3d(0.1, 0.1, 0.1), false));
  EXPECT_TRUE(open.nearest(Vector3d(0.15, 0.0, 0.2)).on_border);
  EXPECT_FALSE(open.nearest(Vector3d(0.15, 0.0, 0.05)).on_border);
  EXPECT_FALSE(open.nearest(Vector3d(0.15, 0.15, 0.0)).on_border) << "an edge between two faces is none";
}

TEST(MeshDistance, RefusesWhatIsNoMesh) {
  EXPECT_THROW(MeshDistance(Surface{}), std::invalid_argument);
  EXPECT_THROW(MeshDistance(Surface{{Vector3d::Zero()}, {}, {{0, 0, 1}}}), std::invalid_argument);
  const MeshDistance box(makeBox(Vector3d(0.1, 0.1, 0.1)));
  EXPECT_THROW(box.nearest(Vector3d(0.0, std::nan(""), 0.0)), std::invalid_argument);
}

TEST(SampleEvenly, EveryFaceGetsItsShareOfTheArea) {
  const Surface box = makeBox(Vector3d(0.2, 0.1, 0.05));
  const auto samples = experiments::sampleEvenly(box, 0.004, 1);
  // 0.28 = 8 (0.2 0.1 + 0.1 0.05 + 0.05 0.2); systematic: give or take one
  EXPECT_NEAR(static_cast<double>(samples.size()), 0.28 / 1.6e-5, 1.0);
  int top = 0;
  for (const Vector3d& p : samples) top += p.z() > 0.05 - 1e-9;
  EXPECT_NEAR(top, 0.08 / 1.6e-5, 2.0);  // one at either end
  EXPECT_THROW(experiments::sampleEvenly(box, 0.0, 1), std::invalid_argument);
}

TEST(Statistics, AreThoseOfAKnownSeries) {
  const experiments::Statistics s = experiments::statisticsOf({-1.0, 0.0, 1.0, 4.0});
  EXPECT_EQ(s.count, 4U);
  EXPECT_DOUBLE_EQ(s.mean, 1.0);
  EXPECT_DOUBLE_EQ(s.std_dev, std::sqrt(14.0 / 4.0));
  EXPECT_DOUBLE_EQ(s.rms, std::sqrt(18.0 / 4.0));
  EXPECT_DOUBLE_EQ(s.max_abs, 4.0);
  EXPECT_EQ(experiments::statisticsOf({}).count, 0U);
}

}  // namespace
