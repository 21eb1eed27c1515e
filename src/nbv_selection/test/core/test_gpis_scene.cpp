// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/gpis_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <Eigen/Cholesky>
#include <gmock/gmock.h>

#include "support/sampled_map.h"

namespace nbv_selection {
namespace {

using nbv_selection_test::MapSamples;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
const Eigen::AlignedBox3d kBox(Eigen::Vector3d(-0.15, -0.1, 0.0), Eigen::Vector3d(0.15, 0.1, 0.23));

/// A brick on a square of ground.
std::shared_ptr<const gpis_mapping::MapSnapshot> boxMap() {
  static const auto kSnapshot = [] {
    MapSamples samples;
    samples.addRectangle({-0.4, -0.4, 0.0}, {0.8, 0.0, 0.0}, {0.0, 0.3, 0.0});
    samples.addRectangle({-0.4, 0.1, 0.0}, {0.8, 0.0, 0.0}, {0.0, 0.3, 0.0});
    samples.addRectangle({-0.4, -0.1, 0.0}, {0.25, 0.0, 0.0}, {0.0, 0.2, 0.0});
    samples.addRectangle({0.15, -0.1, 0.0}, {0.25, 0.0, 0.0}, {0.0, 0.2, 0.0});
    samples.addBox(kBox);
    return samples.snapshot({}, 42.5);
  }();
  return kSnapshot;
}

/// From a point to the brick and the ground's plane, negative inside of either.
double analyticDistance(const Eigen::Vector3d& p) {
  const Eigen::Vector3d q = (p - kBox.center()).cwiseAbs() - 0.5 * kBox.sizes();
  return std::min(p.z(), q.cwiseMax(0.0).norm() + std::min(0.0, q.maxCoeff()));
}

gpis_mapping::Points3d randomPoints(std::mt19937* rng, int count, const Eigen::AlignedBox3d& box) {
  gpis_mapping::Points3d points(3, count);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  for (int i = 0; i < count; ++i) {
    for (int axis = 0; axis < 3; ++axis) points(axis, i) = box.min()[axis] + uniform(*rng) * box.sizes()[axis];
  }
  return points;
}

TEST(OccupancyProbability, IsTheNormalDistributionFunctionOfTheScaledMean) {
  // Arguments that come out round: 100 x 0.01 = 1 without variance; sqrt(1 + 100^2 x 3e-4) = 2.
  const double phi_1 = 0.5 * (1.0 + std::erf(1.0 / std::sqrt(2.0)));
  const double phi_half = 0.5 * (1.0 + std::erf(0.5 / std::sqrt(2.0)));
  EXPECT_NEAR(phi_1, 0.841344746, 1e-9);  // from a table
  EXPECT_NEAR(occupancyProbability(-0.01, 0.0, 100.0, 0.0), phi_1, 1e-14);
  EXPECT_NEAR(occupancyProbability(0.01, 0.0, 100.0, 0.0), 1.0 - phi_1, 1e-14);
  EXPECT_NEAR(occupancyProbability(-0.01, 3e-4, 100.0, 0.0), phi_half, 1e-14);
  EXPECT_NEAR(occupancyProbability(0.02, 3e-4, 100.0, 3.0), phi_half, 1e-14);  // (-2 + 3) / 2
  EXPECT_NEAR(occupancyProbability(0.0, 0.7, 100.0, 0.0), 0.5, 1e-14);
  EXPECT_EQ(occupancyProbability(1e3, 1e-6, 100.0, 0.0), 0.0);
  EXPECT_EQ(occupancyProbability(-1e3, 1e-6, 100.0, 0.0), 1.0);
}

TEST(OccupancyProbability, IsTheMeanOfAProbitOverTheField) {
  // What eq 14 stands for: f ~ N(mu, sigma^2), P(o = 1 | f) = Phi(-alpha f + beta).
  std::mt19937 rng(1);
  std::normal_distribution<double> normal;
  constexpr int kDraws = 100000;
  for (const double mean_m : {-0.02, 0.0, 0.013}) {
    for (const double std_m : {0.001, 0.01, 0.03}) {
      for (const double beta : {0.0, 0.8}) {
        int occupied = 0;
        for (int i = 0; i < kDraws; ++i) {
          const double f_m = mean_m + std_m * normal(rng);
          if (-100.0 * f_m + beta + normal(rng) > 0.0) ++occupied;
        }
        // Standard deviation of a share of 1e5 draws: at most 0.0016; five of them.
        EXPECT_NEAR(static_cast<double>(occupied) / kDraws, occupancyProbability(mean_m, std_m * std_m, 100.0, beta),
                    0.008)
            << mean_m << " " << std_m << " " << beta;
      }
    }
  }
}

TEST(GpisScene, UncertaintyOfAFewPointsIsThePosteriorVarianceOfEquationThree) {
  // In the middle of one cell of the map, so that it has one GP.
  MapSamples samples;
  samples.addRectangle({0.03, 0.03, 0.05}, {0.04, 0.0, 0.0}, {0.0, 0.04, 0.0});
  const auto snapshot = samples.snapshot();
  const auto scene = makeGpisScene(snapshot, GpisScene::Config());
  const double length_m = snapshot->config().surface.length_scale_m, a = std::sqrt(3.0) / length_m;
  const double prior = length_m * length_m / 3.0;
  EXPECT_NEAR(scene->priorUncertainty(), prior, 1e-15);
  const auto kernel = [&](const Eigen::Vector3d& p, const Eigen::Vector3d& q) {
    const double d = (p - q).norm();
    return prior * (1.0 + a * d) * std::exp(-a * d);
  };
  const auto n = static_cast<Eigen::Index>(samples.points().size());
  ASSERT_EQ(n, 4);
  const auto at = [&](Eigen::Index i) { return samples.points()[static_cast<std::size_t>(i)]; };
  Eigen::MatrixXd k(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j) k(i, j) = kernel(at(i).position_map, at(j).position_map);
    k(i, i) += static_cast<double>(at(i).variance_m2);
  }
  const Eigen::LDLT<Eigen::MatrixXd> solver(k);
  std::mt19937 rng(2);
  const gpis_mapping::Points3d points =
      randomPoints(&rng, 200, {Eigen::Vector3d::Constant(0.02), Eigen::Vector3d::Constant(0.08)});
  const UncertaintyField field = scene->uncertainty(points);
  for (Eigen::Index c = 0; c < points.cols(); ++c) {
    Eigen::VectorXd cross(n);
    Eigen::MatrixXd cross_gradient(3, n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const Eigen::Vector3d r = points.col(c) - at(i).position_map;
      cross[i] = kernel(points.col(c), at(i).position_map);
      cross_gradient.col(i) = -prior * a * a * std::exp(-a * r.norm()) * r;
    }
    const Eigen::VectorXd weights = solver.solve(cross);
    // Floats: 1e-7 of the prior, times the condition of K, some 100 with this noise.
    EXPECT_NEAR(field.value[c], prior - cross.dot(weights), 1e-5 * prior);
    // Eq 10, per length scale.
    EXPECT_LT((field.gradient.col(c) + 2.0 * cross_gradient * weights).norm(), 1e-4 * prior / length_m);
  }
}

TEST(GpisScene, UncertaintyGradientIsItsFiniteDifference) {
  const auto scene = makeGpisScene(boxMap(), GpisScene::Config());
  std::mt19937 rng(3);
  const gpis_mapping::Points3d points =
      randomPoints(&rng, 400, {Eigen::Vector3d(-0.45, -0.45, -0.03), Eigen::Vector3d(0.45, 0.45, 0.28)});
  const UncertaintyField field = scene->uncertainty(points);
  const double prior = scene->priorUncertainty();
  constexpr double kStep_m = 5e-4;
  int num_steep = 0;
  for (int axis = 0; axis < 3; ++axis) {
    gpis_mapping::Points3d ahead = points, behind = points;
    ahead.row(axis).array() += kStep_m;
    behind.row(axis).array() -= kStep_m;
    const Eigen::VectorXd slope =
        (scene->uncertainty(ahead).value - scene->uncertainty(behind).value) / (2.0 * kStep_m);
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      // Float: prior minus explained rounds by 1e-7 prior, over 1 mm 1e-4 prior / m, ten times that for the solve.
      // Truncation: third derivatives are of the order of prior over the half width of a blend, 14 mm, cubed; times
      // the step squared / 6: 0.015 prior / m. Four times all that.
      EXPECT_NEAR(field.gradient(axis, i), slope[i], 0.07 * prior) << axis << " at " << points.col(i).transpose();
      if (std::abs(slope[i]) > 3.0 * prior) ++num_steep;
    }
  }
  EXPECT_GT(num_steep, 100);
}

TEST(GpisScene, UncertaintyFarFromAllDataIsThePriorsWithoutSlope) {
  const auto scene = makeGpisScene(boxMap(), GpisScene::Config());
  gpis_mapping::Points3d points(3, 6);
  points.col(0) << 0.0, 0.0, 2.0;                                // in front of a surface, nobody has looked
  points.col(1) << 3.0, 0.0, 0.0;                                // beside the ground
  points.col(2) << 0.0, 0.0, -1.0;                               // far below it
  points.col(3) << 50.0, 0.0, 0.0;                               // beyond the map's reach of 10 m: no answer
  points.col(4) << kNaN, 0.0, 0.0;                               // no place
  points.col(5) << 0.3, 0.3, 0.001;                              // on the ground
  ASSERT_TRUE(std::isnan(boxMap()->query(points).variance[0]));  // the map itself says nothing
  const UncertaintyField field = scene->uncertainty(points);
  for (const int i : {0, 1, 2}) {
    EXPECT_EQ(field.value[i], scene->priorUncertainty()) << i;
    EXPECT_EQ(field.gradient.col(i).norm(), 0.0) << i;
  }
  for (const int i : {3, 4}) {
    EXPECT_TRUE(std::isnan(field.value[i])) << i;
    EXPECT_TRUE(field.gradient.col(i).array().isNaN().all()) << i;
  }
  EXPECT_LT(field.value[5], 0.1 * scene->priorUncertainty());
  EXPECT_GT(field.value[5], 0.0);
}

TEST(GpisScene, UncertaintyHasNoStepWhereTheMapStopsToAnswer) {
  // Downwards from a wide surface: 15 cm under it the map has no variance any more.
  MapSamples samples;
  samples.addRectangle({-0.4, -0.4, 0.03}, {0.8, 0.0, 0.0}, {0.0, 0.8, 0.0});
  const auto snapshot = samples.snapshot();
  const auto scene = makeGpisScene(snapshot, GpisScene::Config());
  gpis_mapping::Points3d points(3, 100);
  for (int i = 0; i < 100; ++i) points.col(i) << 0.0, 0.0, 0.03 - 0.002 * i;
  const UncertaintyField field = scene->uncertainty(points);
  const Eigen::VectorXd variance = snapshot->query(points).variance;
  int num_ends = 0;
  for (int i = 1; i < 100; ++i) {
    if (std::isfinite(variance[i]) == std::isfinite(variance[i - 1])) continue;
    ++num_ends;
    // The kernel of 5 cm has fallen to 3 % of its value 15 cm away, and its square to 0.1 %; ten times that for a
    // surface of many points.
    EXPECT_NEAR(field.value[i], field.value[i - 1], 0.01 * scene->priorUncertainty());
  }
  EXPECT_EQ(num_ends, 1);
}

TEST(GpisScene, OccupancyIsEquationFourteenOfTheMapsMeanAndVariance) {
  GpisScene::Config config;
  config.alpha_1_m = 70.0;
  config.beta = 0.3;
  const auto scene = makeGpisScene(boxMap(), config);
  std::mt19937 rng(4);
  const gpis_mapping::Points3d points =
      randomPoints(&rng, 3000, {Eigen::Vector3d(-0.3, -0.3, -0.05), Eigen::Vector3d(0.3, 0.3, 0.3)});
  const OccupancyField field = scene->occupancy(points);
  const gpis_mapping::QueryResult answer = boxMap()->query(points);
  int num_supported = 0;
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const bool is_near = answer.euclidean_distance[i] <= config.support_m && std::isfinite(answer.distance[i]);
    ASSERT_EQ(field.is_supported[static_cast<std::size_t>(i)], is_near) << points.col(i).transpose();
    if (!is_near) {
      EXPECT_EQ(field.probability[i], 0.0);
      continue;
    }
    ++num_supported;
    const double argument = (-70.0 * answer.distance[i] + 0.3) / std::sqrt(1.0 + 70.0 * 70.0 * answer.variance[i]);
    // Variances are floats, off by 1e-7 of the prior of 8e-4 m^2 depending on what else is asked; times alpha squared.
    EXPECT_NEAR(field.probability[i], 0.5 * (1.0 + std::erf(argument / std::sqrt(2.0))), 1e-6);
    EXPECT_LT((field.normal.col(i) - answer.gradient.col(i).normalized()).norm(), 1e-12);
  }
  EXPECT_GT(num_supported, 300);
}

TEST(GpisScene, OccupancyKnowsInsideFromOutsideAndTheWayOut) {
  const auto scene = makeGpisScene(boxMap(), GpisScene::Config());
  std::mt19937 rng(5);
  // About the upper part of the brick, away from the ground.
  const gpis_mapping::Points3d points =
      randomPoints(&rng, 3000, {Eigen::Vector3d(-0.2, -0.15, 0.08), Eigen::Vector3d(0.2, 0.15, 0.28)});
  const OccupancyField field = scene->occupancy(points);
  int num_inside = 0, num_outside = 0, num_faces = 0;
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const Eigen::Vector3d p = points.col(i);
    if (!field.is_supported[static_cast<std::size_t>(i)]) {
      // Near a face, away from edges, there is data.
      EXPECT_GT(std::abs(analyticDistance(p)), GpisScene::Config().support_m - 0.005);
      continue;
    }
    const double distance_m = analyticDistance(p);
    // 1 cm: beyond what the map may be off at an edge (5 mm), and one sigma of eq 14's own softness, 1 / alpha.
    if (distance_m < -0.01) {
      ++num_inside;
      EXPECT_GT(field.probability[i], 0.6) << p.transpose();
    }
    if (distance_m > 0.01) {
      ++num_outside;
      EXPECT_LT(field.probability[i], 0.4) << p.transpose();
    }
    EXPECT_NEAR(field.normal.col(i).norm(), 1.0, 1e-12);
    // Over the middle of the top face the way out is up; beside the long sides it is sideways. 4 cm from edges: out of
    // their points' reach.
    if (std::abs(p.x()) < 0.11 && std::abs(p.y()) < 0.06 && std::abs(distance_m) < 0.02) {
      ++num_faces;
      EXPECT_GT(field.normal.col(i).z(), 0.99) << p.transpose();
    } else if (std::abs(p.x()) < 0.11 && p.z() < 0.19 && std::abs(distance_m) < 0.02) {
      ++num_faces;
      EXPECT_GT(field.normal.col(i).y() * (p.y() > 0.0 ? 1.0 : -1.0), 0.99) << p.transpose();
    }
  }
  EXPECT_GT(num_inside, 100);
  EXPECT_GT(num_outside, 100);
  EXPECT_GT(num_faces, 100);
}

/// Counts and passes on.
struct Recorder {
  struct Question {
    Eigen::Index num_points;
    bool variance;
    bool gradient;
  };
  std::vector<Question> questions;

  GpisScene::Query query() {
    return [this](const gpis_mapping::Points3d& points, const gpis_mapping::QueryOptions& options) {
      questions.push_back({points.cols(), options.variance, options.variance_gradient});
      return boxMap()->query(points, options);
    };
  }
};

TEST(GpisScene, AsksTheMapOnceForEachAnswerSoThatItIsOfOneState) {
  Recorder recorder;
  const GpisScene scene({}, 0.03, recorder.query(), GpisScene::Config());
  gpis_mapping::Points3d points(3, 4);
  points.col(0) << 0.0, 0.0, 0.5;
  points.col(1) << 0.0, 0.0, 0.225;
  points.col(2) << 0.3, 0.3, 0.2;
  points.col(3) << 0.3, 0.3, 0.005;
  EXPECT_THAT(scene.occupancy(points).is_supported, ElementsAre(false, true, false, true));
  ASSERT_EQ(recorder.questions.size(), 1u);
  EXPECT_EQ(recorder.questions[0].num_points, 4);
  EXPECT_TRUE(recorder.questions[0].variance);
  EXPECT_FALSE(recorder.questions[0].gradient);  // of the variance: nobody needs it here
  EXPECT_EQ(scene.uncertainty(points).value.size(), 4);
  ASSERT_EQ(recorder.questions.size(), 2u);
  EXPECT_TRUE(recorder.questions[1].gradient);
  // No points, nothing to ask.
  EXPECT_EQ(scene.occupancy(gpis_mapping::Points3d(3, 0)).probability.size(), 0);
  EXPECT_EQ(scene.uncertainty(gpis_mapping::Points3d(3, 0)).value.size(), 0);
  EXPECT_EQ(recorder.questions.size(), 2u);
}

TEST(GpisScene, MapThatIsSilentOrAnswersForOtherPointsIsAnError) {
  const gpis_mapping::Points3d points = gpis_mapping::Points3d::Zero(3, 2);
  const GpisScene silent(
      {}, 0.03,
      [](const gpis_mapping::Points3d&, const gpis_mapping::QueryOptions&) -> gpis_mapping::QueryResult {
        throw std::runtime_error("no map");
      },
      GpisScene::Config());
  EXPECT_THROW(silent.uncertainty(points), std::runtime_error);
  EXPECT_THROW(silent.occupancy(points), std::runtime_error);
  const GpisScene wrong(
      {}, 0.03,
      [](const gpis_mapping::Points3d& asked, const gpis_mapping::QueryOptions& options) {
        return boxMap()->query(asked.leftCols(1), options);
      },
      GpisScene::Config());
  EXPECT_THROW(wrong.uncertainty(points), std::runtime_error);
  EXPECT_THROW(wrong.occupancy(points), std::runtime_error);
  // A service of a map that does not know of gradients.
  const GpisScene without_gradient(
      {}, 0.03,
      [](const gpis_mapping::Points3d& asked, const gpis_mapping::QueryOptions&) { return boxMap()->query(asked); },
      GpisScene::Config());
  EXPECT_THROW(without_gradient.uncertainty(points), std::runtime_error);
}

TEST(GpisScene, SurfaceIsTheMapsMesh) {
  const auto scene = makeGpisScene(boxMap(), GpisScene::Config());
  const MappedSurface surface = scene->surface();
  ASSERT_GT(surface.points_map.size(), 1000u);
  ASSERT_EQ(surface.normals_map.size(), surface.points_map.size());
  ASSERT_EQ(surface.uncertainty.size(), surface.points_map.size());
  EXPECT_EQ(surface.update, 1u);
  EXPECT_EQ(surface.stamp_s, 42.5);
  gpis_mapping::Points3d points(3, static_cast<Eigen::Index>(surface.points_map.size()));
  for (std::size_t i = 0; i < surface.points_map.size(); ++i) {
    points.col(static_cast<Eigen::Index>(i)) = surface.points_map[i];
    // Edges are rounded: the map's points are 2 cm apart, so half of that.
    EXPECT_LT(std::abs(analyticDistance(surface.points_map[i])), 0.01) << surface.points_map[i].transpose();
    EXPECT_NEAR(surface.normals_map[i].norm(), 1.0F, 1e-5F);
  }
  // Each vertex carries the field's variance there: what uncertainty() says. Where cells are blended it has that of its
  // own cell alone.
  const UncertaintyField field = scene->uncertainty(points);
  const gpis_mapping::GpisConfig::Cells& cells = boxMap()->config().cells;
  int num_compared = 0;
  for (std::size_t i = 0; i < surface.points_map.size(); ++i) {
    const Eigen::Vector3d& p = surface.points_map[i];
    const Eigen::Vector3d local = p - cells.corner(cells.at(p));
    if (local.minCoeff() < cells.blend_margin_m || local.maxCoeff() > cells.size_m - cells.blend_margin_m) continue;
    ++num_compared;
    const auto column = static_cast<Eigen::Index>(i);
    EXPECT_NEAR(surface.uncertainty[i], field.value[column], 1e-5 * scene->priorUncertainty()) << p.transpose();
  }
  EXPECT_GT(num_compared, 500);
  // Samples all over: a grid of half the mesh's largest voxel diagonal finds one near each point of a face.
  for (double x = -0.14; x < 0.14; x += 0.01) {
    const Eigen::Vector3d on_top(x, 0.03, kBox.max().z());
    double nearest_m = 1.0;
    for (const Eigen::Vector3d& p : surface.points_map) nearest_m = std::min(nearest_m, (p - on_top).norm());
    EXPECT_LT(nearest_m, 0.02) << x;  // half of the outline's grid
  }
}

TEST(GpisScene, StampIsOfTheLastLook) {
  gpis_mapping::MapContents contents;
  contents.epoch_s = 1000.0;
  contents.num_updates = 7;
  gpis_mapping::ObservedLayer::Chunk chunk;
  chunk.fill(gpis_mapping::ObservedLayer::kNever);
  chunk[5] = 3.5F;
  contents.observed.setChunk({0, 0, 0}, chunk);
  chunk[5] = 1.5F;
  contents.observed.setChunk({1, 0, 0}, chunk);
  const auto scene = makeGpisScene(gpis_mapping::GpisMap(contents).snapshot(), GpisScene::Config());
  EXPECT_EQ(scene->surface().stamp_s, 1003.5);
  EXPECT_EQ(scene->surface().update, 7u);
}

TEST(GpisScene, EmptyMapHasNoSurfaceNoAnswerAndNoSupport) {
  const gpis_mapping::GpisMap map{gpis_mapping::GpisConfig()};
  const auto scene = makeGpisScene(map.snapshot(), GpisScene::Config());
  EXPECT_THAT(scene->surface().points_map, IsEmpty());
  const gpis_mapping::Points3d points = gpis_mapping::Points3d::Zero(3, 2);
  EXPECT_TRUE(scene->uncertainty(points).value.array().isNaN().all());
  EXPECT_THAT(scene->occupancy(points).is_supported, ElementsAre(false, false));
}

TEST(GpisScene, RefusesImpossibleConfigs) {
  EXPECT_THAT(interactive_mapping::problemsOf(GpisScene::Config()), IsEmpty());
  Recorder recorder;
  GpisScene::Config config;
  config.alpha_1_m = 0.0;
  config.beta = kNaN;
  config.support_m = 0.3;
  EXPECT_THAT(interactive_mapping::problemsOf(config),
              ElementsAre(HasSubstr("alpha_1_m = 0 1/m, must be in [1, 10000] 1/m"),
                          HasSubstr("beta = nan, must be in [-10, 10]"),
                          HasSubstr("support_m = 0.3 m, must be in [0.001, 0.2] m")));
  EXPECT_THROW(GpisScene({}, 0.03, recorder.query(), config), std::invalid_argument);
  EXPECT_THROW(makeGpisScene(boxMap(), config), std::invalid_argument);
  EXPECT_THROW(makeGpisScene(nullptr, GpisScene::Config()), std::invalid_argument);
  EXPECT_THROW(GpisScene({}, 0.0, recorder.query(), GpisScene::Config()), std::invalid_argument);
  EXPECT_THROW(GpisScene({}, kNaN, recorder.query(), GpisScene::Config()), std::invalid_argument);
  EXPECT_THROW(GpisScene({}, 0.03, {}, GpisScene::Config()), std::invalid_argument);
}

}  // namespace
}  // namespace nbv_selection
