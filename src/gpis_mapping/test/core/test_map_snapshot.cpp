// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/map_snapshot.h"

#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "../../src/core/cell_kernels.h"
#include "analytic_surfaces.h"
#include "eigen_asserts.h"
#include "gpis_mapping/gpis_map.h"
#include "slow_query.h"

namespace gpis_mapping {
namespace {

using gpis_mapping_test::buildCells;
using gpis_mapping_test::centralDifference;
using gpis_mapping_test::isNear;
using gpis_mapping_test::pagesOf;
using gpis_mapping_test::randomUnit;
using gpis_mapping_test::randomVector;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

const Eigen::Vector3d kSphereCenter(0.02, -0.03, 0.35);  // m
constexpr double kSphereRadius = 0.15;                   // m
const Eigen::Vector3d kPlaneCenter(0.01, -0.02, 0.004);  // m

Eigen::Vector3d planeNormal() {
  return Eigen::Vector3d(0.25, -0.15, 1.0).normalized();
}

/// A map with the distance it should answer, and where f is to be compared.
struct Scene {
  std::string name;
  std::unique_ptr<const MapSnapshot> map;
  std::function<double(const Eigen::Vector3d&)> distance;
  std::function<Eigen::Vector3d(std::mt19937*)> on_surface;  // random surface point away from the map's rim
  std::function<Eigen::Vector3d(const Eigen::Vector3d&)> normal;
};

std::unique_ptr<const MapSnapshot> makeMap(const GpisConfig& config, const std::vector<SurfacePoint>& points,
                                           ObservedLayer observed) {
  return std::make_unique<const MapSnapshot>(config, pagesOf(buildCells(config, points)), std::move(observed), 0.0, 1);
}

Scene planeScene() {
  const Eigen::Vector3d n = planeNormal();
  const Eigen::Vector3d u = n.unitOrthogonal();
  const Eigen::Vector3d v = n.cross(u);
  std::vector<SurfacePoint> points;
  gpis_mapping_test::sampleRectangle(kPlaneCenter - 0.2 * (u + v), 0.4 * u, 0.4 * v, 0.02, 0.001, &points);
  Scene scene{"plane", makeMap({}, points, ObservedLayer(0.05)), {}, {}, {}};
  scene.distance = [=](const Eigen::Vector3d& x) { return n.dot(x - kPlaneCenter); };
  scene.on_surface = [=](std::mt19937* rng) {
    const Eigen::Vector3d at = randomVector(rng, -0.12, 0.12);
    return Eigen::Vector3d(kPlaneCenter + at.x() * u + at.y() * v);
  };
  scene.normal = [=](const Eigen::Vector3d&) { return n; };
  return scene;
}

Scene sphereScene() {
  Scene scene{"sphere",
              makeMap({}, gpis_mapping_test::sampleSphere(kSphereCenter, kSphereRadius, 0.02), ObservedLayer(0.05)),
              {},
              {},
              {}};
  scene.distance = [](const Eigen::Vector3d& x) { return (x - kSphereCenter).norm() - kSphereRadius; };
  scene.on_surface = [](std::mt19937* rng) { return Eigen::Vector3d(kSphereCenter + kSphereRadius * randomUnit(rng)); };
  scene.normal = [](const Eigen::Vector3d& x) { return Eigen::Vector3d((x - kSphereCenter).normalized()); };
  return scene;
}

const std::vector<Scene>& scenes() {
  static const std::vector<Scene> kScenes = [] {
    std::vector<Scene> list;
    list.push_back(planeScene());
    list.push_back(sphereScene());
    return list;
  }();
  return kScenes;
}

QueryResult queryOne(const MapSnapshot& map, const Eigen::Vector3d& x) {
  QueryOptions options;
  options.variance_gradient = true;
  options.threads = 1;
  return map.query(x, options);
}

/// Distance of x to the nearest face between cells [m].
double toCellBorder(const MapSnapshot& map, const Eigen::Vector3d& x) {
  const GpisConfig::Cells& cells = map.config().cells;
  const Eigen::Vector3d local = x - cells.corner(cells.at(x));
  return std::min(local.minCoeff(), cells.size_m - local.maxCoeff());
}

TEST(MapSnapshot, FieldMatchesTheAnalyticDistanceInItsBand) {
  std::mt19937 rng(1);
  for (const Scene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    for (int i = 0; i < 1000; ++i) {
      const Eigen::Vector3d on = scene.on_surface(&rng);
      const double height = 0.02 * (2.0 * (i % 101) / 100.0 - 1.0);
      const FieldSample f = scene.map->field(on + height * scene.normal(on));
      ASSERT_TRUE(f.valid);
      // The prior mean takes tangent planes of a sphere: they stand off by d^2 / (2 r), 0.6 mm at 15 mm; at 2 cm from
      // the surface blending them distorts f by about as much again. On the surface it must be better.
      EXPECT_NEAR(f.value, height, std::abs(height) < 1e-9 ? 0.0005 : 0.002) << "at height " << height;
      EXPECT_NEAR(f.gradient.normalized().dot(scene.normal(on)), 1.0, 0.01);  // 8 degrees
    }
  }
}

TEST(MapSnapshot, FieldSignIsRightOnBothSides) {
  std::mt19937 rng(2);
  for (const Scene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    for (int i = 0; i < 300; ++i) {
      const Eigen::Vector3d on = scene.on_surface(&rng);
      for (const double height : {0.002, 0.01, 0.025, 0.035}) {
        const FieldSample outside = scene.map->field(on + height * scene.normal(on));
        const FieldSample inside = scene.map->field(on - height * scene.normal(on));
        ASSERT_TRUE(outside.valid && inside.valid) << height;
        EXPECT_GT(outside.value, 0.0) << height;
        EXPECT_LT(inside.value, 0.0) << height;
      }
    }
  }
}

TEST(MapSnapshot, FieldGradientMatchesCentralDifferenceInsideCellsAndInTheBlend) {
  std::mt19937 rng(3);
  int inside = 0;
  int blended = 0;
  for (const Scene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    for (int i = 0; i < 1500; ++i) {
      const Eigen::Vector3d on = scene.on_surface(&rng);
      const double height = 0.025 * (2.0 * (i % 101) / 100.0 - 1.0);
      const Eigen::Vector3d x = on + height * scene.normal(on);
      const auto value = [&](const Eigen::Vector3d& y) { return scene.map->field(y).value; };
      // Float values round by 2e-9 m, over a step of 0.2 mm 1e-5; truncation at the scale of the blend radius and of
      // the partition's band (30 mm) stays below (0.2 / 30)^2 of a disagreement between cells that is small itself.
      EXPECT_TRUE(isNear(scene.map->field(x).gradient, centralDifference(value, x, 2e-4), 1e-3)) << x.transpose();
      (toCellBorder(*scene.map, x) > scene.map->config().cells.blend_margin_m ? inside : blended) += 1;
    }
  }
  EXPECT_GT(inside, 100);
  EXPECT_GT(blended, 100);
}

TEST(MapSnapshot, DistanceGradientMatchesCentralDifferenceInTheBand) {
  std::mt19937 rng(4);
  for (const Scene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    for (int i = 0; i < 600; ++i) {
      const Eigen::Vector3d on = scene.on_surface(&rng);
      // 18 mm: up to one spacing the answer is f alone; the discs that take over beyond have kinks between them.
      const double height = 0.018 * (2.0 * (i % 101) / 100.0 - 1.0);
      const Eigen::Vector3d x = on + height * scene.normal(on);
      const auto value = [&](const Eigen::Vector3d& y) { return queryOne(*scene.map, y).distance[0]; };
      EXPECT_TRUE(isNear(queryOne(*scene.map, x).gradient.col(0), centralDifference(value, x, 2e-4), 1e-3))
          << x.transpose();
    }
  }
}

TEST(MapSnapshot, DistanceGradientMatchesCentralDifferenceWhereDiscsTakeOver) {
  // Between one spacing and 0.9 blend radii the answer changes from f to the nearest disc. Outside a sphere the two differ
  // by half a millimetre or so, enough for the derivative of the hand-over to show.
  std::mt19937 rng(5);
  const Scene& scene = scenes()[1];
  int agree = 0;
  int total = 0;
  for (int i = 0; i < 400; ++i) {
    const Eigen::Vector3d on = scene.on_surface(&rng);
    const Eigen::Vector3d x = on + (0.022 + 0.015 * (i % 100) / 100.0) * scene.normal(on);
    const auto value = [&](const Eigen::Vector3d& y) { return queryOne(*scene.map, y).distance[0]; };
    const Eigen::Vector3d numeric = centralDifference(value, x, 1e-4);
    ++total;
    agree += isNear(queryOne(*scene.map, x).gradient.col(0), numeric, 0.005) ? 1 : 0;
  }
  // The kinks where the nearest disc changes are a set of measure zero; a step of 0.1 mm straddles few of them.
  EXPECT_GE(agree, 0.95 * total);
}

TEST(MapSnapshot, VarianceGradientMatchesCentralDifferenceInsideCellsAndInTheBlend) {
  std::mt19937 rng(6);
  const double prior = std::pow(GpisConfig().signalStd(), 2);
  double largest = 0.0;
  int blended = 0;
  for (const Scene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    for (int i = 0; i < 600; ++i) {
      const Eigen::Vector3d on = scene.on_surface(&rng);
      const Eigen::Vector3d x = on + 0.03 * (2.0 * (i % 101) / 100.0 - 1.0) * scene.normal(on);
      const auto value = [&](const Eigen::Vector3d& y) { return queryOne(*scene.map, y).variance[0]; };
      const Eigen::Vector3d gradient = queryOne(*scene.map, x).variance_gradient.col(0);
      largest = std::max(largest, gradient.norm());
      blended += toCellBorder(*scene.map, x) < scene.map->config().cells.blend_margin_m;
      // Float: prior minus explained rounds by 1e-7 prior, over 2 x 0.5 mm 1e-4 prior / m, ten times that for the solve.
      EXPECT_TRUE(isNear(gradient, centralDifference(value, x, 5e-4), 0.3 * prior)) << x.transpose();
    }
  }
  EXPECT_GT(largest, 10.0 * prior);
  EXPECT_GT(blended, 100);
}

/// Largest second difference of `f` along from .. to in steps of `step` m.
template <typename Function>
double largestSecondDifference(const Function& f, const Eigen::Vector3d& from, const Eigen::Vector3d& to, double step) {
  const int count = static_cast<int>((to - from).norm() / step);
  double largest = 0.0;
  double before = f(from);
  double here = f(from + (to - from) / count);
  for (int i = 2; i <= count; ++i) {
    const double next = f(from + (to - from) * (static_cast<double>(i) / count));
    largest = std::max(largest, std::abs(next - 2.0 * here + before));
    before = here;
    here = next;
  }
  return largest;
}

TEST(MapSnapshot, FieldAndVarianceDoNotJumpAcrossCellBorders) {
  // Lines through several cells, 5 mm above the surface: a set of points that switches at a border would show as a jump,
  // a weight without a continuous derivative as a kink of slope error x step.
  const double step = 5e-4;
  const Eigen::Vector3d n = planeNormal();
  const Eigen::Vector3d u = n.unitOrthogonal();
  const Eigen::Vector3d v = n.cross(u);
  const double prior = std::pow(GpisConfig().signalStd(), 2);
  for (const Eigen::Vector3d& along : {u, v, Eigen::Vector3d((u + v).normalized())}) {
    const MapSnapshot& map = *scenes()[0].map;
    const Eigen::Vector3d from = kPlaneCenter + 0.005 * n - 0.15 * along;
    const Eigen::Vector3d to = kPlaneCenter + 0.005 * n + 0.15 * along;
    // Over a plane f is linear; 4e-8 m is float rounding of values of 5 mm and positions of 5 cm, four times.
    EXPECT_LT(largestSecondDifference([&](const Eigen::Vector3d& x) { return map.field(x).value; }, from, to, step),
              4e-8);
    // The variance ripples with the spacing h = 2 cm: curvature below (2 pi / h)^2 prior / 20, times step^2.
    EXPECT_LT(
        largestSecondDifference([&](const Eigen::Vector3d& x) { return queryOne(map, x).variance[0]; }, from, to, step),
        5000.0 * prior * step * step);
  }
  const MapSnapshot& sphere = *scenes()[1].map;
  for (const double height : {-0.01, 0.0, 0.01}) {
    // A quarter of a great circle as a polyline of short chords would kink: evaluate on the circle itself.
    const auto on_circle = [&](double angle) {
      return Eigen::Vector3d(kSphereCenter + (kSphereRadius + height) * Eigen::Vector3d(std::cos(angle),
                                                                                        0.6 * std::sin(angle),
                                                                                        0.8 * std::sin(angle)));
    };
    const double arc = step / kSphereRadius;
    double field_bend = 0.0;
    double variance_bend = 0.0;
    double field_jump = 0.0;
    for (double angle = 0.0; angle < 2.0 * M_PI; angle += arc) {
      const FieldSample a = sphere.field(on_circle(angle - arc));
      const FieldSample b = sphere.field(on_circle(angle));
      const FieldSample c = sphere.field(on_circle(angle + arc));
      ASSERT_TRUE(a.valid && b.valid && c.valid);
      field_bend = std::max(field_bend, std::abs(a.value - 2.0 * b.value + c.value));
      field_jump = std::max(field_jump, std::abs(b.value - a.value));
      variance_bend = std::max(variance_bend, std::abs(queryOne(sphere, on_circle(angle - arc)).variance[0] -
                                                       2.0 * queryOne(sphere, on_circle(angle)).variance[0] +
                                                       queryOne(sphere, on_circle(angle + arc)).variance[0]));
    }
    // Ripple of f along the sphere: well under 1 mm at the scale of the spacing, curvature (2 pi / h)^2 x 0.3 mm.
    EXPECT_LT(field_bend, 30.0 * step * step) << height;
    EXPECT_LT(field_jump, 0.1 * step) << height;  // a tenth of the unit slope across the surface
    EXPECT_LT(variance_bend, 5000.0 * prior * step * step) << height;
  }
}

TEST(MapSnapshot, DistanceMatchesTheAnalyticOneNearAndFar) {
  std::mt19937 rng(7);
  struct Case {
    double height;
    double tolerance;
  };
  for (const Scene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    const bool is_plane = scene.name == "plane";
    // In the band f reproduces a plane to rounding; beyond, discs of 1 cm radius on a 2 cm grid leave gaps of 4.1 mm
    // between their rims: sqrt(h^2 + 4.1^2) - h, 0.3 mm at 3 cm. A sphere is seen as discs of 1 cm radius 2 cm apart: between them the disc's
    // rim stands off by 1 cm^2 / (2 r) = 0.3 mm plus what lies between disc and point; one row farther, 1 mm.
    for (const Case& c :
         {Case{0.0, 0.0005}, Case{0.01, 0.001}, Case{0.02, 0.0015}, Case{0.03, 0.002}, Case{0.05, 0.002},
          Case{0.3, 0.002}, Case{1.0, 0.002}, Case{-0.01, 0.001}, Case{-0.02, 0.002}, Case{-0.05, 0.002}}) {
      for (int i = 0; i < 200; ++i) {
        const Eigen::Vector3d on = scene.on_surface(&rng);
        const Eigen::Vector3d x = on + c.height * scene.normal(on);
        const QueryResult result = queryOne(*scene.map, x);
        const double tolerance = !is_plane ? c.tolerance : std::abs(c.height) <= 0.02 ? 2e-6 : 3e-4;
        // Euclidean distance and gradient answer everywhere, signed distance only near known space.
        EXPECT_NEAR(result.euclidean_distance[0], std::abs(c.height), tolerance) << "at height " << c.height;
        if (std::abs(c.height) < scene.map->config().query.unknown_reach_m - 0.01) {
          EXPECT_NEAR(result.distance[0], c.height, tolerance) << "at height " << c.height;
        }
        if (std::abs(c.height) > 0.005) {
          const double sign = c.height > 0.0 ? 1.0 : -1.0;
          // A disc's normal stands for 1.3 cm of a sphere of 15 cm: 5 degrees, and as much again at its rim.
          EXPECT_GT(result.euclidean_gradient.col(0).normalized().dot(sign * scene.normal(on)), 0.98);
        }
      }
    }
  }
}

TEST(MapSnapshot, FarGradientHasUnitLength) {
  std::mt19937 rng(8);
  for (const Scene& scene : scenes()) {
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector3d on = scene.on_surface(&rng);
      const QueryResult result = queryOne(*scene.map, on + 0.1 * scene.normal(on));
      EXPECT_NEAR(result.gradient.col(0).norm(), 1.0, 1e-6);  // normals are floats
      EXPECT_TRUE(isNear(result.gradient.col(0), result.euclidean_gradient.col(0), 0.0));
    }
  }
}

TEST(MapSnapshot, NearPointsVoteOnTheSideBesideAConvexEdge) {
  // A top face (z = 0) sampled from 5 cm off its edge inwards, a side face (x = 0) up to 1 cm below it. Above the top,
  // 1 cm inwards, the nearest point belongs to the side, whose plane has the place behind it.
  std::vector<SurfacePoint> points;
  gpis_mapping_test::sampleRectangle({-0.3, -0.15, 0.0}, {0.26, 0.0, 0.0}, {0.0, 0.3, 0.0}, 0.02, 0.001, &points);
  gpis_mapping_test::sampleRectangle({0.0, -0.15, -0.2}, {0.0, 0.3, 0.0}, {0.0, 0.0, 0.2}, 0.02, 0.001, &points);
  const auto map = makeMap({}, points, ObservedLayer(0.05));
  const QueryResult result = queryOne(*map, {-0.01, 0.0, 0.05});
  EXPECT_GT(result.distance[0], 0.05 - 1e-6);
  EXPECT_LT(result.distance[0], 0.06);  // the top face's rim is 3 cm aside
  EXPECT_LT(queryOne(*map, {-0.1, 0.0, -0.06}).distance[0], -0.05);
}

TEST(MapSnapshot, SurfaceStdIsThatOfTheNearestPoint) {
  GpisConfig config;
  std::vector<SurfacePoint> points;
  gpis_mapping_test::sampleRectangle({-0.1, -0.1, 0.0}, {0.2, 0.0, 0.0}, {0.0, 0.2, 0.0}, 0.02, 0.001, &points);
  SurfacePoint& blurred = points[37];
  blurred.variance_m2 = 0.004f * 0.004f;
  const auto map = makeMap(config, points, ObservedLayer(0.05));
  const Eigen::Vector3d up(0.0, 0.0, 0.03);
  EXPECT_NEAR(queryOne(*map, blurred.position_map + up).surface_std[0], 0.004, 1e-8);
  EXPECT_NEAR(queryOne(*map, points[40].position_map + up).surface_std[0], 0.001, 1e-8);
}

TEST(MapSnapshot, NonFinitePointsGetNoAnswer) {
  const MapSnapshot& map = *scenes()[0].map;
  Points3d x(3, 5);
  x.col(0) << kNaN, 0.0, 0.0;
  x.col(1) << 0.0, std::numeric_limits<double>::infinity(), 0.0;
  x.col(2) = kPlaneCenter;
  x.col(3) << 0.0, 0.0, -std::numeric_limits<double>::infinity();
  x.col(4) << kNaN, kNaN, kNaN;
  QueryOptions options;
  options.variance_gradient = true;
  const QueryResult result = map.query(x, options);
  for (const int i : {0, 1, 3, 4}) {
    EXPECT_TRUE(std::isnan(result.distance[i]));
    EXPECT_TRUE(std::isnan(result.euclidean_distance[i]));
    EXPECT_TRUE(std::isnan(result.variance[i]));
    EXPECT_TRUE(std::isnan(result.occupancy[i]));
    EXPECT_TRUE(std::isnan(result.surface_std[i]));
    EXPECT_TRUE(result.gradient.col(i).array().isNaN().all());
    EXPECT_TRUE(result.euclidean_gradient.col(i).array().isNaN().all());
    EXPECT_TRUE(result.variance_gradient.col(i).array().isNaN().all());
    EXPECT_EQ(result.state[static_cast<std::size_t>(i)], SpaceState::kUnknown);
  }
  EXPECT_NEAR(result.distance[2], 0.0, 1e-6);  // its neighbours do not suffer
  EXPECT_TRUE(std::isfinite(result.variance[2]));
}

TEST(MapSnapshot, EmptyMapHasNoAnswer) {
  const MapSnapshot map({}, {}, ObservedLayer(0.05), 0.0, 0);
  const QueryResult result = queryOne(map, {0.1, 0.2, 0.3});
  EXPECT_TRUE(std::isnan(result.distance[0]));
  EXPECT_TRUE(std::isnan(result.euclidean_distance[0]));
  EXPECT_TRUE(std::isnan(result.variance[0]));
  EXPECT_TRUE(std::isnan(result.occupancy[0]));
  EXPECT_EQ(result.state[0], SpaceState::kUnknown);
  EXPECT_FALSE(map.field({0.1, 0.2, 0.3}).valid);
  EXPECT_EQ(map.numPoints(), 0u);
  const QueryResult nothing = map.query(Points3d(3, 0));
  EXPECT_EQ(nothing.distance.size(), 0);
  EXPECT_TRUE(nothing.state.empty());
}

/// An observed layer in which the blocks of the given points were seen free.
ObservedLayer seenFree(const std::vector<Eigen::Vector3d>& points_map, double block = 0.05) {
  ObservedLayer layer(block);
  const double chunk_size = block * ObservedLayer::kChunkBlocks;
  for (const Eigen::Vector3d& p : points_map) {
    const LatticeKey key = LatticeKey::of(p, chunk_size);
    ObservedLayer::Chunk chunk;
    if (const ObservedLayer::Chunk* const old = layer.chunk(key)) {
      chunk = *old;
    } else {
      chunk.fill(ObservedLayer::kNever);
    }
    const LatticeKey in = LatticeKey::of(p - key.corner(chunk_size), block);
    chunk[static_cast<std::size_t>((in.z * ObservedLayer::kChunkBlocks + in.y) * ObservedLayer::kChunkBlocks + in.x)] =
        1.0f;
    layer.setChunk(key, chunk);
  }
  return layer;
}

TEST(MapSnapshot, StateFollowsDistanceAndObservation) {
  // A horizontal surface at z = 0 seen from above; a column above x = y = 0 was seen free up to 1 m.
  std::vector<SurfacePoint> points;
  gpis_mapping_test::sampleRectangle({-0.2, -0.2, 0.0}, {0.4, 0.0, 0.0}, {0.0, 0.4, 0.0}, 0.02, 0.001, &points);
  std::vector<Eigen::Vector3d> column;
  for (double z = 0.075; z < 1.0; z += 0.05) column.emplace_back(0.01, 0.01, z);
  column.emplace_back(0.01, 0.01, -0.275);  // seen from another side
  const GpisConfig config;
  const auto map = makeMap(config, points, seenFree(column));
  const auto stateAt = [&](double x, double y, double z) { return queryOne(*map, {x, y, z}).state[0]; };
  EXPECT_EQ(stateAt(0.01, 0.01, 0.02), SpaceState::kFree);     // near the surface that was seen
  EXPECT_EQ(stateAt(0.01, 0.01, 0.08), SpaceState::kFree);     // observed
  EXPECT_EQ(stateAt(0.01, 0.01, 0.9), SpaceState::kFree);      // observed, far from any surface
  EXPECT_EQ(stateAt(0.12, 0.12, 0.04), SpaceState::kFree);     // within 1.5 blocks, not observed
  EXPECT_EQ(stateAt(0.12, 0.12, 0.07), SpaceState::kFree);     // the same
  EXPECT_EQ(stateAt(0.12, 0.12, 0.08), SpaceState::kUnknown);  // farther, not observed
  EXPECT_EQ(stateAt(0.12, 0.12, 0.9), SpaceState::kUnknown);
  EXPECT_EQ(stateAt(0.01, 0.01, -0.01), SpaceState::kOccupied);
  EXPECT_EQ(stateAt(0.01, 0.01, -(config.query.occupied_depth_m - 0.01)), SpaceState::kOccupied);
  EXPECT_EQ(stateAt(0.01, 0.01, -(config.query.occupied_depth_m + 0.01)), SpaceState::kUnknown);
  // Seen free beats the vote of a surface far above; its distance is then positive.
  EXPECT_EQ(stateAt(0.01, 0.01, -0.275), SpaceState::kFree);
  EXPECT_NEAR(queryOne(*map, {0.01, 0.01, -0.275}).distance[0], 0.275, 1e-5);
  EXPECT_LT(queryOne(*map, {0.01, 0.01, -0.275}).occupancy[0], 1e-3);  // nine standard deviations
  // The overload for a known distance, NaN for none.
  EXPECT_EQ(map->state({0.01, 0.01, 0.5}, kNaN), SpaceState::kFree);
  EXPECT_EQ(map->state({0.12, 0.12, 0.5}, kNaN), SpaceState::kUnknown);
}

TEST(MapSnapshot, SignedDistanceEndsInUnseenSpace) {
  std::vector<SurfacePoint> points;
  gpis_mapping_test::sampleRectangle({-0.2, -0.2, 0.0}, {0.4, 0.0, 0.0}, {0.0, 0.4, 0.0}, 0.02, 0.001, &points);
  std::vector<Eigen::Vector3d> column;
  for (double z = 0.075; z < 1.0; z += 0.05) column.emplace_back(0.01, 0.01, z);
  GpisConfig config;
  const auto map = makeMap(config, points, seenFree(column));
  const double reach = config.query.unknown_reach_m;
  for (const double height : {0.06, reach - 0.01}) {
    EXPECT_NEAR(queryOne(*map, {0.11, 0.11, height}).distance[0], height, 1e-5);
  }
  const QueryResult beyond = queryOne(*map, {0.11, 0.11, reach + 0.02});
  EXPECT_TRUE(std::isnan(beyond.distance[0]));
  EXPECT_TRUE(std::isnan(beyond.variance[0]));
  EXPECT_TRUE(std::isnan(beyond.occupancy[0]));
  EXPECT_NEAR(beyond.euclidean_distance[0], reach + 0.02, 1e-5);  // this one does not depend on what was seen
  // Behind the surface: occupied as deep as stated, deeper nobody knows.
  const QueryResult inside = queryOne(*map, {0.11, 0.11, -config.query.occupied_depth_m + 0.01});
  EXPECT_EQ(inside.state[0], SpaceState::kOccupied);
  EXPECT_NEAR(inside.distance[0], -config.query.occupied_depth_m + 0.01, 1e-3);
  EXPECT_GT(inside.occupancy[0], 0.99);
  const QueryResult deep = queryOne(*map, {0.11, 0.11, -config.query.occupied_depth_m - 0.03});
  EXPECT_EQ(deep.state[0], SpaceState::kUnknown);
  EXPECT_TRUE(std::isnan(deep.distance[0]) && std::isnan(deep.occupancy[0]) && std::isnan(deep.variance[0]));
  const QueryResult seen = queryOne(*map, {0.01, 0.01, 0.9});
  EXPECT_NEAR(seen.distance[0], 0.9, 1e-5);
  // Away from data the field has the prior's variance.
  EXPECT_NEAR(seen.variance[0], std::pow(config.signalStd(), 2), 1e-6 * std::pow(config.signalStd(), 2));
  // Past max_distance_m nothing is answered but the state.
  config.query.max_distance_m = 0.5;
  const auto short_map = makeMap(config, points, seenFree(column));
  EXPECT_TRUE(std::isnan(queryOne(*short_map, {0.01, 0.01, 0.9}).euclidean_distance[0]));
  EXPECT_EQ(queryOne(*short_map, {0.01, 0.01, 0.9}).state[0], SpaceState::kFree);
  EXPECT_NEAR(queryOne(*short_map, {0.01, 0.01, 0.45}).euclidean_distance[0], 0.45, 1e-5);
}

TEST(MapSnapshot, OccupancyFallsFromInsideToOutside) {
  const MapSnapshot& map = *scenes()[0].map;
  double before = 1.0;
  for (double height = -0.02; height <= 0.02; height += 0.001) {
    const double occupancy = queryOne(map, kPlaneCenter + height * planeNormal()).occupancy[0];
    EXPECT_LE(occupancy, before) << height;
    EXPECT_GE(occupancy, 0.0);
    before = occupancy;
  }
  const auto at = [&](double height) { return queryOne(map, kPlaneCenter + height * planeNormal()).occupancy[0]; };
  // One spacing away the field's standard deviation has grown to 15 mm: Phi(20 / 15) = 0.91.
  EXPECT_NEAR(at(-0.02), 0.91, 0.03);
  EXPECT_NEAR(at(0.02), 0.09, 0.03);
  // On the surface even odds; f is 1e-7 m there against a standard deviation of about a millimetre.
  EXPECT_NEAR(at(0.0), 0.5, 0.01);
  // One standard deviation outside: Phi(-1).
  const QueryResult result = queryOne(map, kPlaneCenter + 0.003 * planeNormal());
  EXPECT_NEAR(result.occupancy[0], 0.5 * std::erfc(0.003 / std::sqrt(2.0 * result.variance[0])), 1e-4);
}

Points3d mixedQueries(int count) {
  std::mt19937 rng(9);
  Points3d x(3, count);
  for (int i = 0; i < count; ++i) x.col(i) = randomVector(&rng, -0.3, 0.3);
  x(1, 17) = kNaN;
  return x;
}

void expectSame(const QueryResult& a, Eigen::Index i, const QueryResult& b, Eigen::Index j, double tolerance) {
  const auto same = [tolerance](double p, double q) {
    return (std::isnan(p) && std::isnan(q)) || std::abs(p - q) <= tolerance;
  };
  EXPECT_TRUE(same(a.distance[i], b.distance[j]));
  EXPECT_TRUE(same(a.euclidean_distance[i], b.euclidean_distance[j]));
  EXPECT_TRUE(same(a.surface_std[i], b.surface_std[j]));
  EXPECT_TRUE(same(a.variance[i], b.variance[j])) << a.variance[i] << " " << b.variance[j];
  // Occupancy divides by a standard deviation of a millimetre.
  EXPECT_TRUE((std::isnan(a.occupancy[i]) && std::isnan(b.occupancy[j])) ||
              std::abs(a.occupancy[i] - b.occupancy[j]) <= 1e3 * tolerance);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_TRUE(same(a.gradient(axis, i), b.gradient(axis, j)));
    EXPECT_TRUE(same(a.euclidean_gradient(axis, i), b.euclidean_gradient(axis, j)));
    if (a.variance_gradient.cols() == 0) continue;
    EXPECT_TRUE((std::isnan(a.variance_gradient(axis, i)) && std::isnan(b.variance_gradient(axis, j))) ||
                std::abs(a.variance_gradient(axis, i) - b.variance_gradient(axis, j)) <= 1e2 * tolerance);
  }
  EXPECT_EQ(a.state[static_cast<std::size_t>(i)], b.state[static_cast<std::size_t>(j)]);
}

TEST(MapSnapshot, BatchEqualsOneByOne) {
  const MapSnapshot& map = *scenes()[0].map;
  const Points3d x = mixedQueries(2000);  // more than one chunk and more than one group per cell
  QueryOptions options;
  options.variance_gradient = true;
  options.threads = 1;
  const QueryResult batch = map.query(x, options);
  int answered = 0;
  for (Eigen::Index i = 0; i < x.cols(); ++i) {
    SCOPED_TRACE(i);
    expectSame(batch, i, queryOne(map, x.col(i)), 0, 0.0);
    answered += std::isfinite(batch.distance[i]);
  }
  EXPECT_GT(answered, 1000);
  EXPECT_LT(answered, 2000);
}

/// A box open below and a ball, points 2 cm apart and a millimetre out of place, seen free beside it: faces, edges,
/// corners, rims, and no two distances alike.
std::unique_ptr<const MapSnapshot> cluttered(const CellKernels& kernels) {
  std::vector<SurfacePoint> points;
  gpis_mapping_test::sampleRectangle({-0.25, -0.15, 0.0}, {0.25, 0.0, 0.0}, {0.0, 0.3, 0.0}, 0.02, 0.001, &points);
  gpis_mapping_test::sampleRectangle({0.0, -0.15, -0.2}, {0.0, 0.3, 0.0}, {0.0, 0.0, 0.2}, 0.02, 0.001, &points);
  gpis_mapping_test::sampleRectangle({-0.25, -0.15, -0.2}, {0.25, 0.0, 0.0}, {0.0, 0.0, 0.2}, 0.02, 0.001, &points);
  for (const SurfacePoint& point : gpis_mapping_test::sampleSphere({0.2, 0.1, 0.1}, 0.12, 0.02))
    points.push_back(point);
  std::mt19937 rng(31);
  for (SurfacePoint& point : points) {
    point.position_map += randomVector(&rng, -0.001, 0.001);
    point.variance_m2 = static_cast<float>(1e-6 * (1.0 + std::abs(randomVector(&rng, -1.0, 1.0).x())));
  }
  std::vector<Eigen::Vector3d> free;
  for (double x = -0.275; x < 0.3; x += 0.05) {
    for (double z = 0.075; z < 0.5; z += 0.05) free.emplace_back(x, 0.025, z);
  }
  const GpisConfig config;
  return std::make_unique<const MapSnapshot>(config, pagesOf(buildCells(config, points, kernels)), seenFree(free), 0.0,
                                             1);
}

TEST(MapSnapshot, AnswersAsOnePointAfterTheOtherInTheObviousWay) {
  std::vector<const CellKernels*> all{&portableCellKernels()};
  if (avx2CellKernels() != nullptr) all.push_back(avx2CellKernels());
  for (const CellKernels* kernels : all) {
    SCOPED_TRACE(kernels == &portableCellKernels() ? "portable" : "AVX2");
    const auto map = cluttered(*kernels);
    const gpis_mapping_test::SlowQuery slow(*map);
    const double prior = std::pow(map->config().signalStd(), 2);
    std::mt19937 rng(32);
    std::uniform_int_distribution<int> pick(0, 3);
    constexpr int kCount = 3000;
    Points3d x(3, kCount);
    for (int i = 0; i < kCount; ++i) {
      const double reach[] = {0.28, 0.28, 0.5, 3.0};
      x.col(i) = randomVector(&rng, -1.0, 1.0) * reach[pick(rng)];
    }
    QueryOptions options;
    options.variance_gradient = true;
    const QueryResult result = map->query(x, options);
    int tied = 0, near = 0, inside = 0;
    for (int i = 0; i < kCount; ++i) {
      SCOPED_TRACE(i);
      const auto expected = slow.at(x.col(i));
      if (expected.is_tied) {
        ++tied;
        continue;
      }
      near += std::abs(expected.distance) < 0.03;
      inside += expected.distance < 0.0;
      const auto expectClose = [](double a, double b, double tolerance, const char* what) {
        EXPECT_TRUE((std::isnan(a) && std::isnan(b)) || std::abs(a - b) <= tolerance) << what << ' ' << a << ' ' << b;
      };
      // The cells' values are sums of floats in another order: as far apart as from the dense GP, see test_cell_gp.
      // Places are rounded to 4e-9 m, their squares by 1e-7: a hundredth of that.
      expectClose(result.distance[i], expected.distance, 2e-6, "distance");
      expectClose(result.euclidean_distance[i], expected.euclidean_distance, 2e-6, "Euclidean distance");
      expectClose(result.surface_std[i], expected.surface_std, 1e-9, "std of the surface");
      expectClose(result.variance[i], expected.variance, 1e-4 * prior, "variance");
      // Phi changes by 0.4 per standard deviation, and that is a millimetre at least: 2e-6 m of distance make 1e-3.
      expectClose(result.occupancy[i], expected.occupancy, 1e-3, "occupancy");
      for (int axis = 0; axis < 3; ++axis) {
        expectClose(result.gradient(axis, i), expected.gradient[axis], 5e-4, "gradient");
        expectClose(result.euclidean_gradient(axis, i), expected.euclidean_gradient[axis], 5e-4, "Euclidean gradient");
        expectClose(result.variance_gradient(axis, i), expected.variance_gradient[axis],
                    1e-4 * prior / map->config().surface.length_scale_m, "variance gradient");
      }
      EXPECT_EQ(result.state[static_cast<std::size_t>(i)], expected.state);
    }
    EXPECT_LT(tied, 0.02 * kCount);
    EXPECT_GT(near, 200);
    EXPECT_GT(inside, 200);
  }
}

TEST(MapSnapshot, AnswerDoesNotDependOnWhatElseIsAsked) {
  const auto map = cluttered(cellKernels());
  std::mt19937 rng(33);
  Points3d x(3, 4000);
  for (Eigen::Index i = 0; i < x.cols(); ++i) x.col(i) = randomVector(&rng, -0.35, 0.35);
  QueryOptions options;
  options.variance_gradient = true;
  const QueryResult together = map->query(x, options);
  const QueryResult backwards = map->query(x.rowwise().reverse(), options);
  const QueryResult few = map->query(x.leftCols(37), options);
  for (Eigen::Index i = 0; i < x.cols(); ++i) {
    SCOPED_TRACE(i);
    expectSame(together, i, backwards, x.cols() - 1 - i, 0.0);
    if (i < few.distance.size()) expectSame(together, i, few, i, 0.0);
  }
}

TEST(MapSnapshot, TiesGoTheSameWayWhicheverPointsAreAskedTogether) {
  // Above the middle of a square of points, and of the 8th and 9th, all are equally far: the answer is one of them,
  // always the same.
  const auto map = planeScene().map;
  const Eigen::Vector3d u = planeNormal().unitOrthogonal();
  Points3d x(3, 41);
  for (Eigen::Index i = 0; i < x.cols(); ++i) {
    x.col(i) = kPlaneCenter + 0.01 * static_cast<double>(i - 20) * u + 0.05 * planeNormal();
  }
  const QueryResult together = map->query(x);
  for (Eigen::Index i = 0; i < x.cols(); ++i) {
    const QueryResult alone = map->query(x.col(i));
    expectSame(together, i, alone, 0, 0.0);
  }
}

TEST(MapSnapshot, ResultDoesNotDependOnTheNumberOfThreads) {
  const MapSnapshot& map = *scenes()[0].map;
  const Points3d x = mixedQueries(5000);
  QueryOptions options;
  options.variance_gradient = true;
  options.threads = 1;
  const QueryResult one = map.query(x, options);
  for (const int threads : {2, 3}) {
    options.threads = threads;
    const QueryResult many = map.query(x, options);
    for (Eigen::Index i = 0; i < x.cols(); ++i) expectSame(one, i, many, i, 0.0);
  }
}

TEST(MapSnapshot, LeavesOutWhatWasNotAskedFor) {
  const MapSnapshot& map = *scenes()[0].map;
  QueryOptions options;
  options.variance = false;
  const QueryResult plain = map.query(kPlaneCenter, options);
  EXPECT_TRUE(std::isnan(plain.variance[0]));
  EXPECT_TRUE(std::isnan(plain.occupancy[0]));
  EXPECT_EQ(plain.variance_gradient.cols(), 0);
  EXPECT_NEAR(plain.distance[0], 0.0, 1e-6);
  options.variance_gradient = true;
  const Eigen::Vector3d x = kPlaneCenter + 0.02 * planeNormal();
  const QueryResult gradient_only = map.query(x, options);
  EXPECT_TRUE(isNear(gradient_only.variance_gradient.col(0), queryOne(map, x).variance_gradient.col(0), 0.0));
  // An occupancy without a variance behind it would be a step function in disguise.
  EXPECT_TRUE(std::isnan(gradient_only.variance[0]));
  EXPECT_TRUE(std::isnan(gradient_only.occupancy[0]));
}

TEST(MapSnapshot, MapTrainedFromPointsHasTheSameField) {
  // GpisMap chooses each cell's points by marking neighbours; here every cell looked at every point.
  MapContents contents;
  contents.config.threads = 1;
  contents.points = gpis_mapping_test::sampleSphere(kSphereCenter, kSphereRadius, 0.02);
  const GpisMap map(contents);
  const auto trained = map.snapshot();
  const Scene& plain = scenes()[1];
  ASSERT_EQ(trained->numPoints(), plain.map->numPoints());
  EXPECT_EQ(trained->cells().size(), plain.map->cells().size());
  for (const auto& [key, cell] : trained->cells()) {
    const CellGp* const found = plain.map->cells().get(key);
    ASSERT_NE(found, nullptr);
    EXPECT_EQ(cell->numOwn(), found->numOwn());
    EXPECT_EQ(cell->numTraining(), found->numTraining());
    EXPECT_EQ(cell->size(), found->size());
  }
  std::mt19937 rng(10);
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector3d on = plain.on_surface(&rng);
    const Eigen::Vector3d x = on + 0.02 * (i % 3 - 1) * plain.normal(on);
    EXPECT_NEAR(trained->field(x).value, plain.map->field(x).value, 2e-6);  // points in another order, in float
  }
}

TEST(MapSnapshot, FirstQueriesMayComeFromManyThreads) {
  // The nearest-neighbour index is built by the first query, whoever asks it.
  const auto map = planeScene().map;
  std::vector<double> distances(8, kNaN);
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < distances.size(); ++i) {
    threads.emplace_back([&, i] { distances[i] = queryOne(*map, kPlaneCenter + 0.1 * planeNormal()).distance[0]; });
  }
  for (std::thread& thread : threads) thread.join();
  for (const double distance : distances) EXPECT_NEAR(distance, 0.1, 3e-4);  // gaps between discs, as above
}

}  // namespace
}  // namespace gpis_mapping
