// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/segment_attributes.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>

#include "nbv_selection/gpis_scene.h"
#include "support/function_scene.h"
#include "support/sampled_map.h"

namespace nbv_selection {
namespace {

using nbv_selection_test::FunctionScene;
using nbv_selection_test::MapSamples;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr SegmentKind kReal = SegmentKind::kReal;
constexpr SegmentKind kFrontier = SegmentKind::kFrontier;
constexpr SegmentKind kImaginary = SegmentKind::kImaginary;

/// Straight, with `count` samples from one end to the other.
Segment straight(const Eigen::Vector3d& middle_map, const Eigen::Vector3d& direction_map, double length_m, int count) {
  Segment segment;
  segment.midpoint_map = middle_map;
  segment.direction_map = direction_map.normalized();
  segment.length_m = length_m;
  for (int i = 0; i < count; ++i) {
    const double at_m = count == 1 ? 0.0 : length_m * (static_cast<double>(i) / (count - 1) - 0.5);
    segment.samples_map.push_back(middle_map + at_m * segment.direction_map);
  }
  return segment;
}

FunctionScene linearScene(const Eigen::Vector3d& slope) {
  FunctionScene scene;
  scene.value = [=](const Eigen::Vector3d& p) { return 0.4 + slope.dot(p); };
  scene.gradient = [=](const Eigen::Vector3d&) { return slope; };
  return scene;
}

TEST(SegmentUncertainty, OfALinearFieldIsItsMiddleAndItsSlopeAlongTheSegment) {
  const Eigen::Vector3d slope(0.3, -0.2, 0.5);
  const FunctionScene scene = linearScene(slope);
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<Segment> segments;
  for (int i = 0; i < 50; ++i) {
    segments.push_back(straight({uniform(rng), uniform(rng), uniform(rng)}, {uniform(rng), uniform(rng), uniform(rng)},
                                0.6, 2 + i % 20));
  }
  const std::vector<SegmentUncertainty> uncertainty = segmentUncertainty(scene, segments);
  ASSERT_THAT(uncertainty, SizeIs(segments.size()));
  for (std::size_t i = 0; i < segments.size(); ++i) {
    EXPECT_NEAR(uncertainty[i].mean, 0.4 + slope.dot(segments[i].midpoint_map), 1e-12);
    EXPECT_NEAR(uncertainty[i].frontier, std::pow(slope.dot(segments[i].direction_map), 2), 1e-12);
  }
}

TEST(SegmentUncertainty, OfASquareIsTheSumInClosedForm) {
  // u = c x^2 along x: du/dx = 2 c x; samples at +-L/2, ... : the mean of x^2 over n even steps about 0 is
  // L^2 / 12 (n + 1) / (n - 1), about x0 it is x0^2 more.
  constexpr double kC = 0.7, kLength_m = 0.6;
  FunctionScene scene;
  scene.value = [](const Eigen::Vector3d& p) { return kC * p.x() * p.x(); };
  scene.gradient = [](const Eigen::Vector3d& p) { return Eigen::Vector3d(2.0 * kC * p.x(), 0.0, 0.0); };
  for (const int count : {2, 5, 21}) {
    for (const double x0 : {0.0, 0.4, -3.0}) {
      const Segment segment = straight({x0, 1.0, 0.0}, Eigen::Vector3d::UnitX(), kLength_m, count);
      const double mean_square_m2 = x0 * x0 + kLength_m * kLength_m / 12.0 * (count + 1.0) / (count - 1.0);
      const SegmentUncertainty uncertainty = segmentUncertainty(scene, {segment})[0];
      EXPECT_NEAR(uncertainty.mean, kC * mean_square_m2, 1e-12);
      EXPECT_NEAR(uncertainty.frontier, 4.0 * kC * kC * mean_square_m2, 1e-12);
      // Across the slope nothing changes.
      const Segment across = straight({x0, 1.0, 0.0}, {0.0, 1.0, 0.0}, kLength_m, count);
      EXPECT_NEAR(segmentUncertainty(scene, {across})[0].frontier, 0.0, 1e-12);
    }
  }
}

TEST(SegmentUncertainty, DoesNotDependOnTheDirectionsSignOrTheNumberOfSamplesOfASlope) {
  const FunctionScene scene = linearScene({0.3, -0.2, 0.5});
  const Segment few = straight({1, 2, 0}, {1, 1, 0}, 0.5, 3), many = straight({1, 2, 0}, {1, 1, 0}, 0.5, 300);
  const Segment back = straight({1, 2, 0}, {-1, -1, 0}, 0.5, 30);
  const std::vector<SegmentUncertainty> uncertainty = segmentUncertainty(scene, {few, many, back});
  EXPECT_NEAR(uncertainty[0].frontier, uncertainty[1].frontier, 1e-12);
  EXPECT_NEAR(uncertainty[0].frontier, uncertainty[2].frontier, 1e-12);
}

TEST(SegmentUncertainty, AsksTheMapOnceForAllSegments) {
  const FunctionScene scene = linearScene({1, 0, 0});
  std::vector<Segment> segments(7, straight({0, 0, 0}, {1, 0, 0}, 0.5, 11));
  segments.push_back(straight({0, 0, 0}, {1, 0, 0}, 0.5, 2));
  segmentUncertainty(scene, segments);
  EXPECT_EQ(scene.num_questions, 1);
  EXPECT_EQ(scene.num_points, 79);
  EXPECT_THAT(segmentUncertainty(scene, {}), IsEmpty());
  EXPECT_EQ(scene.num_questions, 1);  // nothing to ask
}

TEST(SegmentUncertainty, SampleWithoutAnswerCountsAsThePriorAndHasNoSlope) {
  FunctionScene scene = linearScene({0.5, 0, 0});
  scene.prior = 3.0;
  const auto linear = scene.value;
  scene.value = [=](const Eigen::Vector3d& p) { return p.x() > 0.05 ? kNaN : linear(p); };
  // Five samples, at x = -0.2, -0.1, 0, 0.1, 0.2: the last two are not known.
  const SegmentUncertainty uncertainty = segmentUncertainty(scene, {straight({0, 0, 0}, {1, 0, 0}, 0.4, 5)})[0];
  EXPECT_NEAR(uncertainty.mean, (0.3 + 0.35 + 0.4 + 3.0 + 3.0) / 5.0, 1e-12);
  EXPECT_NEAR(uncertainty.frontier, 3.0 * 0.25 / 5.0, 1e-12);
  // A value without a gradient is an answer.
  scene.value = linear;
  scene.gradient = [](const Eigen::Vector3d& p) { return Eigen::Vector3d::Constant(p.x() > 0.05 ? kNaN : 0.5); };
  const SegmentUncertainty without_gradient = segmentUncertainty(scene, {straight({0, 0, 0}, {1, 0, 0}, 0.4, 5)})[0];
  EXPECT_NEAR(without_gradient.mean, 0.4, 1e-12);
  EXPECT_NEAR(without_gradient.frontier, 3.0 * 0.25 / 5.0, 1e-12);
}

TEST(SegmentUncertainty, SegmentWithoutSamplesIsUnknown) {
  FunctionScene scene = linearScene({0.5, 0, 0});
  scene.prior = 3.0;
  const std::vector<SegmentUncertainty> uncertainty =
      segmentUncertainty(scene, {Segment(), straight({0, 0, 0}, {1, 0, 0}, 0.4, 5)});
  EXPECT_EQ(uncertainty[0].mean, 3.0);
  EXPECT_EQ(uncertainty[0].frontier, 0.0);
  EXPECT_NEAR(uncertainty[1].mean, 0.4, 1e-12);
}

TEST(SegmentUncertainty, FrontierOfARealMapIsTheSlopeOfItsVarianceAlongTheSegment) {
  // Ground that ends at x = 0.3: the edge of what was seen.
  MapSamples samples;
  samples.addRectangle({-0.3, -0.3, 0.0}, {0.6, 0.0, 0.0}, {0.0, 0.6, 0.0});
  const auto scene = makeGpisScene(samples.snapshot(), GpisScene::Config());
  std::vector<Segment> segments;
  for (const double angle_rad : {0.0, 0.5, 1.5707963267948966, 2.5}) {
    for (const double x_m : {0.0, 0.25, 0.31}) {
      segments.push_back(straight({x_m, 0.03, 0.0}, {std::cos(angle_rad), std::sin(angle_rad), 0.0}, 0.3, 11));
    }
  }
  const std::vector<SegmentUncertainty> uncertainty = segmentUncertainty(*scene, segments);
  const double prior = scene->priorUncertainty();
  // The map answers in floats, off by about 1e-7 prior, over two steps of 0.5 mm 1e-4 prior per metre, and ten times
  // that for the solve behind them. Truncation: the kernel's third derivative is a^3 prior, a = sqrt(3) / l = 35 / m; times
  // the step squared / 6, 1.7e-3 prior per metre; twice that for what the solve makes of it.
  constexpr double kStep_m = 5e-4;
  const double slope_error = 5e-3 * prior;
  double largest = 0.0;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const Segment& segment = segments[i];
    double frontier = 0.0, mean = 0.0;
    const auto count = static_cast<double>(segment.samples_map.size());
    for (const Eigen::Vector3d& sample : segment.samples_map) {
      const gpis_mapping::Points3d ahead = sample + kStep_m * segment.direction_map;
      const gpis_mapping::Points3d behind = sample - kStep_m * segment.direction_map;
      const double slope = (scene->uncertainty(ahead).value[0] - scene->uncertainty(behind).value[0]) / (2.0 * kStep_m);
      frontier += slope * slope / count;
      mean += scene->uncertainty(sample).value[0] / count;
    }
    // d (s^2) = 2 s ds + ds^2
    const double slope_rms = std::sqrt(std::max(frontier, uncertainty[i].frontier));
    EXPECT_NEAR(uncertainty[i].frontier, frontier, (2.0 * slope_rms + slope_error) * slope_error) << i;
    EXPECT_NEAR(uncertainty[i].mean, mean, 1e-6 * prior) << i;
    largest = std::max(largest, uncertainty[i].frontier);
  }
  // Over the edge the variance rises from little to the prior within about two length scales of 5 cm.
  EXPECT_GT(largest, std::pow(prior / 0.3, 2));
  EXPECT_GT(uncertainty[2].frontier, 100.0 * uncertainty[0].frontier);  // over the edge, and far from it
  EXPECT_GT(uncertainty[2].frontier, 10.0 * uncertainty[8].frontier);   // and along it
}

TEST(PileHeight, IsTheMeanOfTheProfile) {
  Segment segment;
  EXPECT_EQ(pileHeight(segment), 0.0);
  segment.profile_m = {0.0F, 0.5F, 0.25F, 0.25F};
  EXPECT_EQ(pileHeight(segment), 0.25);
  segment.profile_m.push_back(std::numeric_limits<float>::quiet_NaN());
  EXPECT_TRUE(std::isnan(pileHeight(segment)));  // not hidden
}

/// Segments of outlines with these mean uncertainties, prior 1.
std::vector<SegmentKind> kindsOf(const std::vector<std::vector<double>>& outlines, double imaginary_share = 0.5) {
  std::vector<Segment> segments;
  std::vector<SegmentUncertainty> uncertainty;
  for (std::size_t outline = 0; outline < outlines.size(); ++outline) {
    for (const double mean : outlines[outline]) {
      segments.emplace_back();
      segments.back().outline = static_cast<int>(outline);
      uncertainty.push_back({mean, 0.0});
    }
  }
  return classify(segments, uncertainty, 1.0, imaginary_share);
}

TEST(Classify, BordersOfTheImaginaryPartAreFrontiersAlsoRoundTheCorner) {
  EXPECT_THAT(kindsOf({{0, 0, 0, 1, 1, 0, 0}}),
              ElementsAre(kReal, kReal, kFrontier, kImaginary, kImaginary, kFrontier, kReal));
  EXPECT_THAT(kindsOf({{1, 0, 0, 0}}), ElementsAre(kImaginary, kFrontier, kReal, kFrontier));
  EXPECT_THAT(kindsOf({{0, 0, 0, 1}}), ElementsAre(kFrontier, kReal, kFrontier, kImaginary));
  EXPECT_THAT(kindsOf({{1, 0, 1}}), ElementsAre(kImaginary, kFrontier, kImaginary));
}

TEST(Classify, OutlinesAreNoNeighbours) {
  EXPECT_THAT(kindsOf({{0, 0, 0}, {1, 1, 1}, {0, 0}}),
              ElementsAre(kReal, kReal, kReal, kImaginary, kImaginary, kImaginary, kReal, kReal));
  EXPECT_THAT(
      kindsOf({{0, 0, 1}, {0, 0, 0}, {1, 0, 0, 0}}),
      ElementsAre(kFrontier, kFrontier, kImaginary, kReal, kReal, kReal, kImaginary, kFrontier, kReal, kFrontier));
}

TEST(Classify, OneOrTwoSegmentsAndNone) {
  EXPECT_THAT(kindsOf({}), IsEmpty());
  EXPECT_THAT(kindsOf({{0}}), ElementsAre(kReal));
  EXPECT_THAT(kindsOf({{1}}), ElementsAre(kImaginary));
  EXPECT_THAT(kindsOf({{1, 0}}), ElementsAre(kImaginary, kFrontier));
  EXPECT_THAT(kindsOf({{0, 0}, {1}}), ElementsAre(kReal, kReal, kImaginary));
}

TEST(Classify, ImaginaryIsAboveTheShareOfThePriorOrNoNumber) {
  EXPECT_THAT(kindsOf({{0.5, 0, 0}}), ElementsAre(kReal, kReal, kReal));
  EXPECT_THAT(kindsOf({{0.5000001, 0, 0}}), ElementsAre(kImaginary, kFrontier, kFrontier));
  EXPECT_THAT(kindsOf({{0.8, 0.6, 0, 0}}, 0.7), ElementsAre(kImaginary, kFrontier, kReal, kFrontier));
  EXPECT_THAT(kindsOf({{kNaN, 0, 0, 0}}), ElementsAre(kImaginary, kFrontier, kReal, kFrontier));
  const std::vector<Segment> one(1);
  EXPECT_THAT(classify(one, {{5.0, 0.0}}, 20.0, 0.5), ElementsAre(kReal));
}

TEST(Classify, RefusesWhatDoesNotFit) {
  const std::vector<Segment> two(2);
  EXPECT_THROW(classify(two, {{}}, 1.0, 0.5), std::invalid_argument);
  EXPECT_THROW(classify(two, {{}, {}}, kNaN, 0.5), std::invalid_argument);
  EXPECT_THROW(classify(two, {{}, {}}, 0.0, 0.5), std::invalid_argument);
  EXPECT_THROW(classify(two, {{}, {}}, 1.0, 0.0), std::invalid_argument);
  EXPECT_THROW(classify(two, {{}, {}}, 1.0, std::numeric_limits<double>::infinity()), std::invalid_argument);
}

}  // namespace
}  // namespace nbv_selection
