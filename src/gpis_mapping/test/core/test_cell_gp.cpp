// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/cell_gp.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "../../src/core/cell_kernels.h"
#include "analytic_surfaces.h"
#include "dense_gp.h"
#include "eigen_asserts.h"

namespace gpis_mapping {
namespace {

using gpis_mapping_test::CellSelection;
using gpis_mapping_test::centralDifference;
using gpis_mapping_test::DenseCellGp;
using gpis_mapping_test::DenseGpis;
using gpis_mapping_test::isNear;
using gpis_mapping_test::pointers;
using gpis_mapping_test::randomVector;
using gpis_mapping_test::selectPoints;
using gpis_mapping_test::surfacePoint;

/// A surface through the cell (0, 0, 0), [-0.05, 0.05]^3 m, sampled every 2 cm, with its exact signed distance.
struct Scene {
  std::string name;
  std::vector<SurfacePoint> points;
  std::function<double(const Eigen::Vector3d&)> distance;
};

Scene planeScene(double noise_std_m) {
  Scene scene{"plane", {}, {}};
  const Eigen::Vector3d n = Eigen::Vector3d(0.3, -0.2, 1.0).normalized();
  const Eigen::Vector3d u = n.unitOrthogonal();
  const Eigen::Vector3d v = n.cross(u);
  const Eigen::Vector3d center(0.002, -0.003, 0.005);
  gpis_mapping_test::sampleRectangle(center - 0.16 * (u + v), 0.32 * u, 0.32 * v, 0.02, noise_std_m, &scene.points);
  scene.distance = [=](const Eigen::Vector3d& x) { return n.dot(x - center); };
  return scene;
}

constexpr double kEdgeX = 0.003;  // m
constexpr double kEdgeZ = 0.011;  // m

Scene edgeScene(double noise_std_m) {
  Scene scene{"edge", {}, {}};
  const Eigen::Vector3d low(-0.30, -0.30, -0.30);
  const Eigen::Vector3d high(kEdgeX, 0.25, kEdgeZ);  // the edge runs along y through the cell
  for (const SurfacePoint& point : gpis_mapping_test::sampleBox(low, high, 0.02, true, noise_std_m)) {
    if (point.position_map.cwiseAbs().maxCoeff() < 0.16) scene.points.push_back(point);
  }
  scene.distance = [=](const Eigen::Vector3d& x) { return gpis_mapping_test::boxDistance(low, high, x); };
  return scene;
}

Scene sphereScene(double noise_std_m) {
  Scene scene{"sphere", {}, {}};
  const Eigen::Vector3d center(-0.005, 0.0, -0.14);
  const double radius = 0.15;
  scene.points = gpis_mapping_test::sampleSphere(center, radius, 0.02, noise_std_m);
  scene.distance = [=](const Eigen::Vector3d& x) { return (x - center).norm() - radius; };
  return scene;
}

std::vector<Scene> scenes(double noise_std_m) {
  return {planeScene(noise_std_m), edgeScene(noise_std_m), sphereScene(noise_std_m)};
}

/// Moves points along their normals by their noise and turns the normals a little.
void perturb(std::vector<SurfacePoint>* points, std::mt19937* rng) {
  std::normal_distribution<double> normal;
  for (SurfacePoint& point : *points) {
    point.position_map += std::sqrt(point.variance_m2) * normal(*rng) * point.normal_map.cast<double>();
    const Eigen::Vector3d turn(normal(*rng), normal(*rng), normal(*rng));
    point.normal_variance = static_cast<float>(std::abs(normal(*rng)) * 0.005 + 4e-4);
    point.normal_map =
        (point.normal_map.cast<double>() + std::sqrt(point.normal_variance) * turn).normalized().cast<float>();
  }
}

CellGp makeCell(const GpisConfig& config, const std::vector<SurfacePoint>& points, const LatticeKey& key = {},
                const CellKernels& kernels = cellKernels()) {
  const CellSelection selection = selectPoints(config, key, points);
  return CellGp(key, config, selection.points, selection.num_own, selection.num_training, kernels);
}

/// Those this processor can run.
std::vector<const CellKernels*> allKernels() {
  std::vector<const CellKernels*> result{&portableCellKernels()};
  if (avx2CellKernels() != nullptr) result.push_back(avx2CellKernels());
  return result;
}

DenseCellGp makeDense(const GpisConfig& config, const std::vector<SurfacePoint>& points, const LatticeKey& key = {}) {
  const CellSelection selection = selectPoints(config, key, points);
  return DenseCellGp(config, selection.points, selection.num_training);
}

/// Where the map asks a cell: inside it and in the overlap with its neighbours.
Eigen::Vector3d randomQuery(const GpisConfig& config, std::mt19937* rng) {
  const double reach_m = 0.5 * config.cells.size_m + config.cells.blend_margin_m;
  return randomVector(rng, -reach_m, reach_m);
}

double varianceAt(const CellGp& cell, const Eigen::Vector3d& x) {
  Eigen::VectorXf variance;
  cell.variance(x, &variance, nullptr);
  return variance[0];
}

void expectDenseGp(const CellKernels& kernels) {
  const GpisConfig config;
  const double prior = std::pow(config.signalStd(), 2);
  std::mt19937 rng(1);
  for (const double noise : {0.001, 0.005}) {
    for (Scene& scene : scenes(noise)) {
      SCOPED_TRACE(scene.name + ", noise " + std::to_string(noise) + " m");
      perturb(&scene.points, &rng);
      const CellGp cell = makeCell(config, scene.points, {}, kernels);
      const DenseCellGp dense = makeDense(config, scene.points);
      ASSERT_GT(cell.numOwn(), 15u);
      ASSERT_GT(cell.numTraining(), cell.numOwn());
      ASSERT_GT(cell.size(), cell.numTraining());
      int answered = 0;
      for (int i = 0; i < 300; ++i) {
        const Eigen::Vector3d x = randomQuery(config, &rng);
        const CellGp::Mean mean = cell.mean(x);
        // Floats cannot tell a weight of 1e-9 from none: at the rim of the blend radius either answer will do.
        if (dense.weightSum(x) > 1e-6) {
          ASSERT_TRUE(mean.valid);
        } else if (!dense.hasPriorMean(x)) {
          EXPECT_FALSE(mean.valid);
        }
        Eigen::VectorXf variance;
        Points3f variance_gradient;
        cell.variance(x, &variance, &variance_gradient);
        // The covariance's condition number is about 10^3 (prior 8e-4 m^2 times 60 correlated points over noise
        // 1e-6..2.5e-5 m^2 and spacing): 6e-8 of rounding grows to 1e-4 of the residual of up to 5 mm, and of the prior.
        EXPECT_NEAR(variance[0], dense.variance(x), 1e-4 * prior);
        const auto dense_variance = [&](const Eigen::Vector3d& y) { return dense.variance(y); };
        // The oracle's step of 1e-6 m in double: truncation (1e-6 a)^2, rounding 1e-16 / 1e-6, both far below.
        EXPECT_TRUE(isNear(variance_gradient.col(0), centralDifference(dense_variance, x, 1e-6),
                           1e-4 * prior / config.surface.length_scale_m));
        if (!mean.valid || dense.weightSum(x) < 1e-3) continue;
        ++answered;
        EXPECT_NEAR(mean.value, dense.mean(x), 2e-6);  // m
        Eigen::VectorXf value;
        cell.meanValues((x - config.cells.center({})).cast<float>(), &value);
        EXPECT_NEAR(value[0], dense.mean(x), 2e-6);
        const auto dense_mean = [&](const Eigen::Vector3d& y) { return dense.mean(y); };
        // A weight sum of 1e-3 is near the rim, where the quotient amplifies the rounding of 6e-8 by 1e3.
        EXPECT_TRUE(isNear(mean.gradient, centralDifference(dense_mean, x, 1e-6), 5e-4)) << x.transpose();
      }
      EXPECT_GT(answered, 100);
    }
  }
}

TEST(CellGp, MatchesDenseGpInDoublePrecision) {
  for (const CellKernels* kernels : allKernels()) {
    SCOPED_TRACE(kernels == &portableCellKernels() ? "portable" : "AVX2");
    expectDenseGp(*kernels);
  }
}

TEST(CellGp, KernelsOfAllProcessorsGiveTheSameAnswers) {
  if (avx2CellKernels() == nullptr) GTEST_SKIP() << "this processor has no AVX2";
  const GpisConfig config;
  const double prior = std::pow(config.signalStd(), 2);
  std::mt19937 rng(12);
  for (Scene& scene : scenes(0.001)) {
    SCOPED_TRACE(scene.name);
    perturb(&scene.points, &rng);
    const CellGp portable = makeCell(config, scene.points, {}, portableCellKernels());
    const CellGp avx2 = makeCell(config, scene.points, {}, *avx2CellKernels());
    // 61: no multiple of either number of lanes.
    Points3d x(3, 61);
    for (Eigen::Index i = 0; i < x.cols(); ++i) x.col(i) = randomQuery(config, &rng);
    Eigen::VectorXf values[2], variances[2];
    Points3f gradients[2];
    int side = 0;
    for (const CellGp* cell : {&portable, &avx2}) {
      cell->meanValues((x.colwise() - config.cells.center({})).cast<float>(), &values[side]);
      cell->variance(x, &variances[side], &gradients[side]);
      ++side;
    }
    int answered = 0;
    for (Eigen::Index i = 0; i < x.cols(); ++i) {
      // Products and sums rounded once or twice, in another order: as far apart as each may be from the oracle.
      EXPECT_NEAR(variances[0][i], variances[1][i], 1e-4 * prior);
      EXPECT_TRUE(isNear(gradients[0].col(i), gradients[1].col(i), 1e-4 * prior / config.surface.length_scale_m));
      if (std::abs(scene.distance(x.col(i))) > 0.03) continue;
      ++answered;
      EXPECT_NEAR(values[0][i], values[1][i], 2e-6);
      for (const CellGp* cell : {&portable, &avx2}) {
        EXPECT_NEAR(cell->mean(x.col(i)).value, values[0][i], 2e-6);
        EXPECT_TRUE(isNear(cell->mean(x.col(i)).gradient, portable.mean(x.col(i)).gradient, 5e-4));
      }
    }
    EXPECT_GT(answered, 20);
  }
}

TEST(CellGp, GradientMatchesCentralDifference) {
  const GpisConfig config;
  std::mt19937 rng(2);
  for (Scene& scene : scenes(0.002)) {
    SCOPED_TRACE(scene.name);
    perturb(&scene.points, &rng);
    const CellGp cell = makeCell(config, scene.points);
    int answered = 0;
    for (int i = 0; i < 300; ++i) {
      const Eigen::Vector3d x = randomQuery(config, &rng);
      if (std::abs(scene.distance(x)) > 0.03) continue;
      ++answered;
      // Float values of a few cm round by 2e-9 m; step 0.2 mm makes that 1e-5 of the unit slope. The field bends at the
      // scale of the blend radius (45 mm): truncation (0.2 / 45)^2 times a slope error of order 1 is 2e-5, more where
      // two faces meet.
      const auto value = [&](const Eigen::Vector3d& y) { return static_cast<double>(cell.mean(y).value); };
      EXPECT_TRUE(isNear(cell.mean(x).gradient, centralDifference(value, x, 2e-4), 1e-3)) << x.transpose();
    }
    EXPECT_GT(answered, 100);
  }
}

TEST(CellGp, VarianceGradientMatchesCentralDifference) {
  const GpisConfig config;
  const double prior = std::pow(config.signalStd(), 2);
  std::mt19937 rng(3);
  for (Scene& scene : scenes(0.002)) {
    SCOPED_TRACE(scene.name);
    const CellGp cell = makeCell(config, scene.points);
    double largest = 0.0;
    for (int i = 0; i < 300; ++i) {
      const Eigen::Vector3d x = randomQuery(config, &rng);
      Eigen::VectorXf variance;
      Points3f gradient;
      cell.variance(x, &variance, &gradient);
      largest = std::max<double>(largest, gradient.norm());
      // Prior minus explained cancels: error 1e-6 of the prior; over a step of 0.5 mm that is 2e-3 prior per metre
      // x 1e3 = 2 prior / m against slopes of up to 20 prior / m. Truncation at the scale of the spacing is below.
      const auto value = [&](const Eigen::Vector3d& y) { return varianceAt(cell, y); };
      EXPECT_TRUE(isNear(gradient.col(0), centralDifference(value, x, 5e-4), 0.3 * prior)) << x.transpose();
    }
    // The tolerance is a small part of what is measured.
    EXPECT_GT(largest, 10.0 * prior);
  }
}

TEST(CellGp, VarianceIsSmallAtDataAndThePriorFarAway) {
  const GpisConfig config;
  const double prior = std::pow(config.signalStd(), 2);
  std::mt19937 rng(4);
  for (const Scene& scene : scenes(0.001)) {
    SCOPED_TRACE(scene.name);
    const CellGp cell = makeCell(config, scene.points);
    for (std::size_t i = 0; i < cell.numTraining(); ++i) {
      // At a point the posterior variance is below the point's own noise.
      EXPECT_LE(varianceAt(cell, cell.position(i)), 1e-6 + 1e-5 * prior);
    }
    for (int i = 0; i < 2000; ++i) {
      const double variance = varianceAt(cell, randomVector(&rng, -0.3, 0.4));
      EXPECT_GE(variance, 0.0);
      EXPECT_LE(variance, prior * (1.0 + 1e-6));
    }
    // 0.7 m are 14 length scales: exp(-14 sqrt 3) is 3e-11.
    EXPECT_NEAR(varianceAt(cell, {0.0, 0.0, 0.85}), prior, 1e-6 * prior);
    EXPECT_FALSE(cell.mean({0.0, 0.0, 0.85}).valid);
  }
}

TEST(CellGp, VarianceGrowsAwayFromThePlane) {
  const GpisConfig config;
  const Scene scene = planeScene(0.001);
  const CellGp cell = makeCell(config, scene.points);
  double before = 0.0;
  for (double height = 0.0; height < 0.045; height += 0.005) {
    const double variance = varianceAt(cell, {0.002, -0.003, 0.005 + height});
    EXPECT_GT(variance, before) << height;
    before = variance;
  }
}

TEST(CellGp, InterpolatesNoiseFreePoints) {
  const GpisConfig config;
  for (const Scene& scene : scenes(0.0)) {
    SCOPED_TRACE(scene.name);
    const CellGp cell = makeCell(config, scene.points);
    for (std::size_t i = 0; i < cell.numTraining(); ++i) {
      // Residuals of a few mm solved in float; the oracle comparison above explains 1e-6 m.
      EXPECT_NEAR(cell.mean(cell.position(i)).value, 0.0, 2e-6);
    }
  }
}

TEST(CellGp, ReproducesAPlaneExactly) {
  // Prior mean and residual are exact for a plane, off the surface too: 1e-6 m is float rounding of some 10 cm.
  const GpisConfig config;
  const Scene scene = planeScene(0.003);
  const CellGp cell = makeCell(config, scene.points);
  std::mt19937 rng(5);
  for (int i = 0; i < 500; ++i) {
    const Eigen::Vector3d x = randomQuery(config, &rng);
    const CellGp::Mean mean = cell.mean(x);
    if (!mean.valid || std::abs(scene.distance(x)) > 0.04) continue;
    EXPECT_NEAR(mean.value, scene.distance(x), 1e-6);
  }
}

TEST(CellGp, DoesNotDependOnTheOrderOfPoints) {
  const GpisConfig config;
  std::mt19937 rng(6);
  for (Scene& scene : scenes(0.002)) {
    SCOPED_TRACE(scene.name);
    perturb(&scene.points, &rng);
    CellSelection selection = selectPoints(config, {}, scene.points);
    const CellGp cell({}, config, selection.points, selection.num_own, selection.num_training);
    const auto own_end = selection.points.begin() + static_cast<std::ptrdiff_t>(selection.num_own);
    const auto training_end = selection.points.begin() + static_cast<std::ptrdiff_t>(selection.num_training);
    std::shuffle(selection.points.begin(), own_end, rng);
    std::shuffle(own_end, training_end, rng);
    std::shuffle(training_end, selection.points.end(), rng);
    const CellGp shuffled({}, config, selection.points, selection.num_own, selection.num_training);
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector3d x = randomQuery(config, &rng);
      if (std::abs(scene.distance(x)) > 0.03) continue;
      // Sums in another order: float rounding times the condition number, as against the oracle.
      EXPECT_NEAR(cell.mean(x).value, shuffled.mean(x).value, 2e-6);
      EXPECT_NEAR(varianceAt(cell, x), varianceAt(shuffled, x), 1e-7);
    }
  }
}

TEST(CellGp, IsAsAccurateFarFromTheMapsOrigin) {
  const GpisConfig config;
  std::mt19937 rng(7);
  for (Scene& scene : scenes(0.001)) {
    SCOPED_TRACE(scene.name);
    const CellGp near = makeCell(config, scene.points);
    const LatticeKey far_key{1000000, -1000000, 600000};
    const Eigen::Vector3d shift = config.cells.center(far_key);  // 100 km: one float step is 8 mm there
    const CellSelection selection = selectPoints(config, {}, scene.points);
    std::vector<SurfacePoint> moved;
    for (const SurfacePoint* point : selection.points) {
      moved.push_back(*point);
      moved.back().position_map += shift;
    }
    const CellGp far(far_key, config, pointers(moved), selection.num_own, selection.num_training);
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector3d x = randomQuery(config, &rng);
      if (std::abs(scene.distance(x)) > 0.03) continue;
      // Doubles at 10^5 m step by 1.5e-11 m, floats at 5 cm by 4e-9 m: the latter decides, times the condition number.
      EXPECT_NEAR(near.mean(x).value, far.mean(x + shift).value, 2e-6);
      EXPECT_TRUE(isNear(near.mean(x).gradient, far.mean(x + shift).gradient, 1e-4));
      EXPECT_NEAR(varianceAt(near, x), varianceAt(far, x + shift), 1e-7);
    }
    EXPECT_TRUE(isNear(far.position(0), moved[0].position_map, 1e-8));
  }
}

TEST(CellGp, RotatesWithItsPoints) {
  // The field is a scalar: turning points and query about the cell's centre turns the gradient and nothing else.
  const GpisConfig config;
  std::mt19937 rng(8);
  Scene scene = edgeScene(0.002);
  perturb(&scene.points, &rng);
  const CellSelection selection = selectPoints(config, {}, scene.points);
  const Eigen::Matrix3d R = Eigen::AngleAxisd(0.7, gpis_mapping_test::randomUnit(&rng)).toRotationMatrix();
  const Eigen::Vector3d center = config.cells.center({});
  std::vector<SurfacePoint> turned;
  for (const SurfacePoint* point : selection.points) {
    turned.push_back(*point);
    turned.back().position_map = center + R * (point->position_map - center);
    turned.back().normal_map = R.cast<float>() * point->normal_map;
  }
  const CellGp upright({}, config, selection.points, selection.num_own, selection.num_training);
  const CellGp rotated({}, config, pointers(turned), selection.num_own, selection.num_training);
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d x = randomQuery(config, &rng);
    if (std::abs(scene.distance(x)) > 0.03) continue;
    const Eigen::Vector3d y = center + R * (x - center);
    EXPECT_NEAR(upright.mean(x).value, rotated.mean(y).value, 2e-6);  // float rounding, as above
    EXPECT_TRUE(isNear(R.cast<float>() * upright.mean(x).gradient, rotated.mean(y).gradient, 2e-4));
    EXPECT_NEAR(varianceAt(upright, x), varianceAt(rotated, y), 1e-7);
  }
}

TEST(CellGp, PointsThatOnlyShapeThePriorMeanAddNoInformation) {
  const GpisConfig config;
  const Scene scene = planeScene(0.001);
  const CellSelection selection = selectPoints(config, {}, scene.points);
  const CellGp with({}, config, selection.points, selection.num_own, selection.num_training);
  const std::vector<const SurfacePoint*> training(
      selection.points.begin(), selection.points.begin() + static_cast<std::ptrdiff_t>(selection.num_training));
  const CellGp without({}, config, training, selection.num_own, selection.num_training);
  std::mt19937 rng(9);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d x = randomQuery(config, &rng);
    EXPECT_EQ(varianceAt(with, x), varianceAt(without, x));  // the same numbers in the same order
  }
}

TEST(CellGp, BatchVarianceEqualsOneByOne) {
  const GpisConfig config;
  const CellGp cell = makeCell(config, sphereScene(0.001).points);
  std::mt19937 rng(10);
  Points3d x(3, 50);
  for (int i = 0; i < 50; ++i) x.col(i) = randomQuery(config, &rng);
  Eigen::VectorXf batch;
  Points3f batch_gradient;
  cell.variance(x, &batch, &batch_gradient);
  ASSERT_EQ(batch.size(), 50);
  ASSERT_EQ(batch_gradient.cols(), 50);
  for (int i = 0; i < 50; ++i) {
    Eigen::VectorXf single;
    Points3f gradient;
    cell.variance(x.col(i), &single, &gradient);
    // A solve for many right-hand sides sums in another order: rounding of the prior, 8e-4 m^2.
    EXPECT_NEAR(batch[i], single[0], 1e-8);
    EXPECT_TRUE(isNear(batch_gradient.col(i), gradient.col(0), 1e-6));
  }
}

TEST(CellGp, CellWithoutTrainingPointsHasThePrior) {
  const GpisConfig config;
  const CellGp empty({}, config, {}, 0, 0);
  EXPECT_FALSE(empty.mean({0.0, 0.0, 0.0}).valid);
  EXPECT_FLOAT_EQ(static_cast<float>(varianceAt(empty, {0.0, 0.0, 0.0})),
                  static_cast<float>(std::pow(config.signalStd(), 2)));
}

TEST(CellGp, KeepsTheFirstPointsAsItsOwn) {
  const GpisConfig config;
  const Scene scene = sphereScene(0.001);
  const CellSelection selection = selectPoints(config, {}, scene.points);
  const CellGp cell({}, config, selection.points, selection.num_own, selection.num_training);
  EXPECT_EQ(cell.numOwn(), selection.num_own);
  EXPECT_EQ(cell.numTraining(), selection.num_training);
  ASSERT_EQ(cell.size(), selection.points.size());
  for (std::size_t i = 0; i < cell.size(); ++i) {
    EXPECT_TRUE(isNear(cell.position(i), selection.points[i]->position_map, 1e-8));  // float step at 10 cm: 7e-9 m
    EXPECT_EQ(cell.normal(i), selection.points[i]->normal_map);
    EXPECT_EQ(cell.noiseVariance(i), selection.points[i]->variance_m2);
  }
}

TEST(CellGp, TakesPointsThatCoincideAndClaimToBeExact) {
  // As a map file may hold them; a large prior makes them worse.
  GpisConfig config;
  config.surface.signal_std_m = 1.0;
  std::vector<SurfacePoint> points;
  for (int i = 0; i < 40; ++i) {
    points.push_back(surfacePoint({0.005 * (i % 4), 0.0, 0.0}, Eigen::Vector3d::UnitZ(), 0.0));
  }
  const CellGp gp({0, 0, 0}, config, pointers(points), points.size(), points.size());
  const CellGp::Mean mean = gp.mean({0.005, 0.0, 0.01});
  ASSERT_TRUE(mean.valid);
  EXPECT_NEAR(mean.value, 0.01, 1e-4);  // all in one plane: the prior mean is exact
}

TEST(CellGp, RefusesNonFinitePoints) {
  const GpisConfig config;
  const std::vector<SurfacePoint> good = planeScene(0.001).points;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  const std::vector<std::pair<std::string, std::function<void(SurfacePoint*)>>> faults = {
      {"NaN position", [=](SurfacePoint* p) { p->position_map.y() = nan; }},
      {"infinite position", [=](SurfacePoint* p) { p->position_map.x() = inf; }},
      {"NaN normal", [=](SurfacePoint* p) { p->normal_map.z() = nan; }},
      {"NaN noise", [=](SurfacePoint* p) { p->variance_m2 = nan; }},
      {"negative noise", [=](SurfacePoint* p) { p->variance_m2 = -1.0f; }},
      {"NaN normal noise", [=](SurfacePoint* p) { p->normal_variance = nan; }},
  };
  for (const auto& [name, spoil] : faults) {
    SCOPED_TRACE(name);
    const CellSelection selection = selectPoints(config, {}, good);
    for (const std::size_t victim : {std::size_t{0}, selection.num_own, selection.num_training - 1}) {
      SurfacePoint bad = *selection.points[victim];
      spoil(&bad);
      std::vector<const SurfacePoint*> points = selection.points;
      points[victim] = &bad;
      try {
        const CellGp cell({7, 0, -3}, config, points, selection.num_own, selection.num_training);
        ADD_FAILURE() << "point " << victim << " was accepted";
      } catch (const std::runtime_error& error) {
        EXPECT_NE(std::string(error.what()).find("(7, 0, -3)"), std::string::npos) << error.what();
      }
    }
  }
  // A point that only shapes the prior mean can spoil the cell as well.
  const CellSelection selection = selectPoints(config, {}, good);
  SurfacePoint bad = *selection.points.back();
  bad.position_map.x() = nan;
  std::vector<const SurfacePoint*> points = selection.points;
  points.back() = &bad;
  EXPECT_THROW(CellGp({}, config, points, selection.num_own, selection.num_training), std::runtime_error);
}

/// Root of `f` on the segment x + t n, |t| <= reach; NaN without a sign change.
template <typename Function>
double rootAlong(const Function& f, const Eigen::Vector3d& x, const Eigen::Vector3d& n, double reach) {
  double low = -reach;
  double high = reach;
  if (!(f(x + low * n) < 0.0 && f(x + high * n) > 0.0)) return std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < 40; ++i) {
    const double middle = 0.5 * (low + high);
    (f(x + middle * n) < 0.0 ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

// The equivalent promised by the class comment: n value rows about a mean from the normals stand for 4 n rows of values
// and gradients. Documented differences: (1) beyond the band the full GPIS relaxes to its constant mean, outside and
// inside, so that its sign is wrong a few centimetres below a surface, while the tangent planes keep theirs; (2) both
// round a convex edge (by 4 to 6 mm at its crest with points every 2 cm), the cell by up to 2.5 mm more, because its prior
// mean blends the planes of both faces where the full GPIS weighs their gradients.
TEST(CellGp, HasTheZeroSetOfTheFullGpisWithDerivativeObservations) {
  const GpisConfig config;
  for (const Scene& scene : scenes(0.001)) {
    SCOPED_TRACE(scene.name);
    const CellSelection selection = selectPoints(config, {}, scene.points);
    const CellGp cell({}, config, selection.points, selection.num_own, selection.num_training);
    const DenseGpis gpis(config, selection.points, 0.0);
    const auto f_cell = [&](const Eigen::Vector3d& y) { return static_cast<double>(cell.mean(y).value); };
    const auto f_gpis = [&](const Eigen::Vector3d& y) { return gpis.mean(y); };
    std::mt19937 rng(11);
    int roots = 0;
    double squares = 0.0;
    for (int i = 0; i < 400; ++i) {
      Eigen::Vector3d x = randomVector(&rng, -0.05, 0.05);
      const Eigen::Vector3d n = centralDifference(scene.distance, x, 1e-6);
      x -= scene.distance(x) * n;  // on the surface, between the training points
      if (x.cwiseAbs().maxCoeff() > 0.05) continue;
      const double root_cell = rootAlong(f_cell, x, n, 0.015);
      const double root_gpis = rootAlong(f_gpis, x, n, 0.015);
      ASSERT_TRUE(std::isfinite(root_cell)) << x.transpose();
      ASSERT_TRUE(std::isfinite(root_gpis)) << x.transpose();
      // 1 mm is the noise of a point. Within the blend radius of the crest the planes of both faces are blended.
      const bool at_crest =
          scene.name == "edge" && std::hypot(x.x() - kEdgeX, x.z() - kEdgeZ) < config.surface.blend_radius_m;
      EXPECT_NEAR(root_cell, root_gpis, at_crest ? 0.003 : 0.001) << x.transpose();
      squares += std::pow(root_cell - root_gpis, 2);
      ++roots;
    }
    EXPECT_GT(roots, 100);
    EXPECT_LT(std::sqrt(squares / roots), 0.001);
    int signs = 0;
    for (int i = 0; i < 400; ++i) {
      const Eigen::Vector3d x = randomVector(&rng, -0.05, 0.05);
      const double d = scene.distance(x);
      if (std::abs(d) > config.surface.spacing_m || std::abs(d) < 0.001) continue;
      // What the rounded crest cuts off is outside for the map.
      if (scene.name == "edge" && std::hypot(x.x() - kEdgeX, x.z() - kEdgeZ) < config.surface.spacing_m) continue;
      EXPECT_EQ(f_cell(x) > 0.0, f_gpis(x) > 0.0) << x.transpose() << ", " << d << " m from the surface";
      EXPECT_EQ(f_cell(x) > 0.0, d > 0.0) << x.transpose() << ", " << d << " m from the surface";
      ++signs;
    }
    EXPECT_GT(signs, 50);
  }
}

TEST(CellGp, KeepsItsSignDeeperThanTheFullGpis) {
  // Difference (1): with a prior mean of one signal standard deviation the full GPIS turns positive again below a
  // plane; the cell reads "inside" as deep as its tangent planes reach.
  const GpisConfig config;
  std::vector<SurfacePoint> points;
  gpis_mapping_test::sampleRectangle({-0.15, -0.15, 0.04}, {0.3, 0.0, 0.0}, {0.0, 0.3, 0.0}, 0.02, 0.001, &points);
  const CellGp cell = makeCell(config, points);
  const CellSelection selection = selectPoints(config, {}, points);
  const DenseGpis gpis(config, selection.points, config.signalStd());
  const Eigen::Vector3d below(0.0, 0.0, 0.04 - 0.042);
  ASSERT_TRUE(cell.mean(below).valid);
  EXPECT_NEAR(cell.mean(below).value, -0.042, 1e-5);
  EXPECT_GT(gpis.mean(below), cell.mean(below).value + 0.02);
  EXPECT_LT(gpis.mean({0.0, 0.0, 0.03}), 0.0);  // they agree in the band
}

}  // namespace
}  // namespace gpis_mapping
