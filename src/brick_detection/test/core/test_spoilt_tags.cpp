// SPDX-License-Identifier: BSD-3-Clause
// Tags that are partly covered, bent, in glare or in a shadow, with their truth: what is told of them holds.
#include <algorithm>
#include <cmath>
#include <iostream>

#include <gmock/gmock.h>

#include "brick_detection/brick_pose.h"
#include "brick_detection/calibration_session.h"
#include "support/spoilt_tags.h"

namespace brick_detection {
namespace {

struct Count {
  int decoded{0};
  int used{0};
  int wrong{0};  ///< a coordinate of the pose off by more than 3 of its standard deviations
  double worst{0.0};
};

/// Largest of the six coordinates' errors in their standard deviations.
double worstSigmas(const BrickSighting& brick, const Eigen::Isometry3d& truth) {
  const Vector6d off = stepBetween(brick.T_camera_brick, truth);
  return (off.cwiseAbs().array() / brick.covariance.diagonal().cwiseSqrt().array()).maxCoeff();
}

/// Without depth first, then with it.
std::array<Count, 2> count(Spoilt kind, std::uint32_t first_seed, int num_draws) {
  std::array<Count, 2> counts;
  const auto detector = makeTagDetector({});
  for (int i = 0; i < num_draws; ++i) {
    const SpoiltTag drawn = drawSpoiltTag(kind, first_seed + static_cast<std::uint32_t>(i));
    const BrickPoseEstimator estimator(loneTag("tag36h11", drawn.id, drawn.edge_m), {});
    const std::vector<TagObservation> tags = detector->detect(drawn.view.grey);
    for (std::size_t has_depth = 0; has_depth < 2; ++has_depth) {
      Count& count = counts[has_depth];
      const cv::Mat depth_m = has_depth ? drawn.view.depth_m : cv::Mat();
      const auto result = estimator.estimate(tags, drawn.camera, depth_m, drawn.view.grey);
      count.decoded += static_cast<int>(tags.size());
      for (const BrickSighting& brick : result.bricks) {
        ++count.used;
        const double sigmas = worstSigmas(brick, drawn.T_camera_tag);
        count.wrong += sigmas > 3.0 ? 1 : 0;
        count.worst = std::max(count.worst, sigmas);
      }
    }
  }
  return counts;
}

// Other seeds than those that the limits were chosen on.
constexpr std::uint32_t kFirstSeed = 700000;
constexpr int kNumDraws = 120;

TEST(SpoiltTags, AreRefusedOrWithinThreeSigmas) {
  std::array<Count, 2> all;
  for (int k = 1; k < kNumSpoilt; ++k) {
    const auto kind = static_cast<Spoilt>(k);
    const auto counts = count(kind, kFirstSeed + 10000U * static_cast<std::uint32_t>(k), kNumDraws);
    for (std::size_t has_depth = 0; has_depth < 2; ++has_depth) {
      const Count& of_kind = counts[has_depth];
      std::cout << toString(kind) << (has_depth ? ", depth: " : ": ") << of_kind.decoded << " decoded, " << of_kind.used
                << " used, " << of_kind.wrong << " beyond 3 sigma, worst " << of_kind.worst << "\n";
      EXPECT_GT(of_kind.decoded, kNumDraws / 4) << toString(kind) << ": a kind that is not decoded shows nothing";
      all[has_depth].used += of_kind.used;
      all[has_depth].wrong += of_kind.wrong;
    }
  }
  for (const Count& total : all) {
    EXPECT_GT(total.used, kNumDraws / 2);
    EXPECT_LE(total.wrong, total.used / 100);
  }
}

TEST(SpoiltTags, CleanTagsAreUsedAsBefore) {
  // The same draws with the cells not compared: what the comparison costs.
  const auto detector = makeTagDetector({});
  int num_used = 0;
  int num_before = 0;
  int num_wrong = 0;
  for (int i = 0; i < kNumDraws; ++i) {
    const SpoiltTag drawn = drawSpoiltTag(Spoilt::kClean, kFirstSeed + static_cast<std::uint32_t>(i));
    const BrickPoseEstimator estimator(loneTag("tag36h11", drawn.id, drawn.edge_m), {});
    const std::vector<TagObservation> tags = detector->detect(drawn.view.grey);
    for (const bool has_depth : {false, true}) {
      const cv::Mat depth_m = has_depth ? drawn.view.depth_m : cv::Mat();
      num_before += static_cast<int>(estimator.estimate(tags, drawn.camera, depth_m).bricks.size());
      const auto result = estimator.estimate(tags, drawn.camera, depth_m, drawn.view.grey);
      num_used += static_cast<int>(result.bricks.size());
      for (const BrickSighting& brick : result.bricks)
        num_wrong += worstSigmas(brick, drawn.T_camera_tag) > 3.0 ? 1 : 0;
    }
  }
  std::cout << "clean: " << num_used << " used, " << num_before << " without the comparison, " << num_wrong
            << " beyond 3 sigma\n";
  EXPECT_GE(num_used, num_before - num_before / 100);
  EXPECT_LE(num_wrong, num_used / 100);
}

}  // namespace
}  // namespace brick_detection
