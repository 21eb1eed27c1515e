// SPDX-License-Identifier: BSD-3-Clause
// Where to go next, on maps made of rendered depth images, noise and all.
#include <algorithm>
#include <cmath>
#include <memory>
#include <set>

#include <gmock/gmock.h>
#include <octomap_baseline/dynamic_octomap.h>

#include "nbv_selection/gpis_scene.h"
#include "nbv_selection/octomap_scene.h"
#include "nbv_selection/view_selector.h"
#include "support/map_on_scene.h"
#include "support/selection_setup.h"

namespace synthetic_depth {
namespace test {
namespace {

using nbv_selection::BoxPile;
using nbv_selection::GpisScene;
using nbv_selection::OctomapScene;
using nbv_selection::SceneModel;
using nbv_selection::ScoredSegment;
using nbv_selection::SegmentKind;
using nbv_selection::Selection;
using nbv_selection::SelectionStatus;
using nbv_selection::ViewSelector;
using nbv_selection::ViewSelectorConfig;
using ::testing::IsEmpty;
using ::testing::Not;

const Eigen::Vector3d kHalfBrick(0.15, 0.1, 0.1);

/// The same boxes and ground in the map frame, for rays and grids.
BoxPile truthOf(const Scene& scene, int frame) {
  BoxPile pile;
  pile.ground.normal_map = scene.T_map_scene.linear().col(2);
  pile.ground.offset_m = pile.ground.normal_map.dot(scene.T_map_scene.translation());
  for (const Box& box : scene.boxesAt(frame)) {
    pile.boxes.push_back({scene.T_map_scene * box.T_scene_box, 2.0 * box.half_extents_m});
  }
  return pile;
}

std::shared_ptr<const MapSnapshot> gpisOf(const Scene& scene, int last_frame) {
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, last_frame);
  return map.snapshot();
}

std::unique_ptr<OctomapScene> octomapOf(const Scene& scene, int last_frame) {
  octomap_baseline::OctomapConfig config;
  config.threads = 1;
  octomap_baseline::DynamicOctomap map(config);
  for (int frame = 0; frame <= last_frame; ++frame) {
    map.update(toDepthImage(measureDepth(scene, frame)), mapCamera(scene), scene.cameraInMap(frame),
               scene.stampSeconds(frame));
  }
  return std::make_unique<OctomapScene>(std::make_shared<const octomap::OcTree>(map.tree()), map.numUpdates(),
                                        map.stamp(), OctomapScene::Config());
}

/// On ground that is known wherever no box stands: what was seen of the pile is what the choice is about.
Selection select(const SceneModel& model, const Scene& scene, int frame, const Eigen::Vector3d& robot_scene,
                 const ViewSelectorConfig& config = {}) {
  const Eigen::Vector3d robot_map = scene.T_map_scene * robot_scene;
  const auto request =
      nbv_selection::requestOn(nbv_selection::gridAround(truthOf(scene, frame)), {robot_map.x(), robot_map.y(), 0.0});
  return ViewSelector(config, nbv_selection::pickingRobot()).select(model, nbv_selection::FailureMemory(0.1), request);
}

const ScoredSegment& bestOf(const Selection& selection) {
  return selection.segments.at(selection.best.value());
}

TEST(NbvOnRenderedMaps, FrontierIsTheSlopeOfTheMapsVarianceAlongTheSegment) {
  Scene scene = loadSmallScene("brick_pile");
  const auto snapshot = gpisOf(scene, 6);  // a third of a turn
  const auto model = makeGpisScene(snapshot, GpisScene::Config());
  const Selection selection = select(*model, scene, 6, {1.8, 1.4, 0.0});
  ASSERT_EQ(selection.status, SelectionStatus::kSelected) << selection.message;
  EXPECT_GT(selection.segments.size(), 30U);
  const double prior = model->priorUncertainty();
  // Central differences with steps of 1 mm and 0.5 mm, extrapolated (Richardson): of truncation the fourth power of the step
  // is left, (a h)^4 a prior, 5e-5 prior / m. Rounding of the map's floats, 1e-7 prior, gives 3e-4 prior / m, ten times
  // that for the solve behind them. Where the map's answer jumps there is no slope: such samples, known by a slope of more
  // than kernels can have, 2 a sigma_f^2 = 70 prior / m, are left out.
  constexpr double kStep_m = 1e-3;
  const double slope_error = 4e-3 * prior;
  std::size_t num_compared = 0, num_left_out = 0;
  double largest = 0.0;
  for (const ScoredSegment& scored : selection.segments) {
    const Eigen::Vector3d along = scored.segment.direction_map;
    for (const Eigen::Vector3d& sample : scored.segment.samples_map) {
      const auto valueAt = [&](const Eigen::Vector3d& p) {
        return model->uncertainty(gpis_mapping::Points3d(p)).value[0];
      };
      const auto slopeOver = [&](double step_m) {
        return (valueAt(sample + step_m * along) - valueAt(sample - step_m * along)) / (2.0 * step_m);
      };
      const double slope = (4.0 * slopeOver(0.5 * kStep_m) - slopeOver(kStep_m)) / 3.0;
      const auto field = model->uncertainty(gpis_mapping::Points3d(sample));
      if (!std::isfinite(slope) || std::abs(slope) > 70.0 * prior) {
        ++num_left_out;
        continue;
      }
      EXPECT_NEAR(field.gradient.col(0).dot(along), slope, slope_error) << sample.transpose();
      largest = std::max(largest, std::abs(slope));
      ++num_compared;
    }
  }
  EXPECT_GT(num_compared, 500U);
  EXPECT_LT(num_left_out, num_compared / 50);
  EXPECT_GT(largest, prior / 0.3);  // some segment leads over the edge of what was seen
}

/// A block of bricks, two layers.
Scene block() {
  Scene scene = makeLooks({{1.9, 1.6, 1.3}, {1.6, 1.9, 1.3}, {1.9, 1.3, 1.3}, {1.3, 1.9, 1.3}}, {0.0, 0.0, 0.1});
  addAxialNoise(&scene);
  int id = 0;
  for (const double x : {-0.3, 0.0, 0.3}) {
    for (const double y : {-0.3, -0.1, 0.1, 0.3}) {
      for (const double z : {0.1, 0.3}) scene.boxes.push_back(makeBox(id++, {x, y, z}, kHalfBrick));
    }
  }
  return scene;
}

void expectFrontiersAtTheEdgesOfWhatWasSeen(const SceneModel& model, const Scene& scene,
                                            const ViewSelectorConfig& config, std::size_t edge_width) {
  const Selection selection = select(model, scene, 3, {1.8, 1.5, 0.0}, config);
  ASSERT_EQ(selection.status, SelectionStatus::kSelected) << selection.message;
  EXPECT_NE(bestOf(selection).kind, SegmentKind::kImaginary);
  const BoxPile truth = truthOf(scene, 3);
  const auto isSeen = [&](const ScoredSegment& scored) {
    // The ground 8 cm before the segment, clear of the blur of the pile's foot.
    const Eigen::Vector3d p = scored.segment.midpoint_map + 0.08 * scored.segment.outward_map;
    for (int frame = 0; frame <= 3; ++frame) {
      if (project(scene, frame, p, 5.0).inside &&
          isSeenFrom(truth, scene.cameraInMap(frame).translation(), p, truth.ground.normal_map)) {
        return true;
      }
    }
    return false;
  };
  const std::size_t n = selection.segments.size();
  std::size_t num_seen = 0, num_clear = 0, num_frontiers = 0, num_edges = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const ScoredSegment& scored = selection.segments[i];
    const auto seenAt = [&](std::size_t k) { return isSeen(selection.segments[k % n]); };
    if (seenAt(i)) ++num_seen;
    if (seenAt(i) != seenAt(i + 1)) ++num_edges;
    // One that has its like for some segments on either side is clear of the edge, wherever that is in between.
    bool is_clear = true;
    for (std::size_t k = 1; k <= edge_width; ++k) {
      is_clear = is_clear && seenAt(i + k) == seenAt(i) && seenAt(i + n - k) == seenAt(i);
    }
    if (is_clear) {
      ++num_clear;
      EXPECT_EQ(scored.kind, seenAt(i) ? SegmentKind::kReal : SegmentKind::kImaginary)
          << scored.segment.midpoint_map.transpose() << " " << toString(scored.kind);
    }
    if (scored.kind == SegmentKind::kFrontier) ++num_frontiers;
  }
  EXPECT_EQ(num_edges, 2U);
  EXPECT_EQ(num_frontiers, 2U);
  EXPECT_GE(num_clear, 6U);
  EXPECT_GE(num_seen, 5U);
  EXPECT_LE(num_seen, n - 5);
}

TEST(NbvOnRenderedMaps, HalfSeenBlockHasItsFrontiersAtTheEdgesOfWhatWasSeen) {
  const Scene scene = block();
  const auto model = makeGpisScene(gpisOf(scene, 3), GpisScene::Config());
  expectFrontiersAtTheEdgesOfWhatWasSeen(*model, scene, {}, 2);
}

TEST(NbvOnRenderedMaps, HalfSeenBlockHasThemOnAnOctomapToo) {
  // Blunter: entropy is averaged over cells of 10 cm, half of which the pile hides or fills, and the look along its faces is
  // too flat to see all voxels of the ground. The edge is right to within four segments of 16 cm, about one's own length.
  const Scene scene = block();
  expectFrontiersAtTheEdgesOfWhatWasSeen(*octomapOf(scene, 3), scene, nbv_selection::octomapSelectorConfig(), 4);
}

constexpr int kFramesAround = 8;

/// Two rows of three bricks with one more on top of the first of each, seen from all sides; then the one of row A, at
/// x < 0, is gone, and the pile is seen from all sides again.
Scene twoRows() {
  std::vector<Eigen::Vector3d> eyes;
  for (int i = 0; i < 2 * kFramesAround; ++i) {
    const double angle_rad = 2.0 * M_PI * i / kFramesAround;
    eyes.emplace_back(1.9 * std::cos(angle_rad), 1.9 * std::sin(angle_rad), 1.3);
  }
  Scene scene = makeLooks(eyes, {0.0, 0.0, 0.1});
  addAxialNoise(&scene);
  int id = 0;
  for (const double x : {-0.35, 0.35}) {
    for (const double y : {-0.3, 0.0, 0.3}) {
      scene.boxes.push_back(makeBox(id++, {x, y, 0.1}, {0.1, 0.15, 0.1}));
    }
    scene.boxes.push_back(makeBox(id++, {x, -0.3, 0.3}, {0.1, 0.15, 0.1}));
    if (x < 0.0) scene.boxes.back().vanishes_at_frame = kFramesAround;
  }
  return scene;
}

TEST(NbvOnRenderedMaps, TakingTheTopmostBrickOfOneRowMovesTheChoiceToTheOther) {
  const Scene scene = twoRows();
  GpisMap map(mapConfig(scene));
  const auto chosenAfter = [&](int first, int last) {
    feedFrames(&map, scene, first, last);
    const auto model = makeGpisScene(map.snapshot(), GpisScene::Config());
    const Selection selection = select(*model, scene, last, {-0.35, -1.9, 0.0});
    EXPECT_EQ(selection.status, SelectionStatus::kSelected) << selection.message;
    return Eigen::Vector3d(scene.T_map_scene.inverse() * bestOf(selection).segment.midpoint_map);
  };
  const Eigen::Vector3d before = chosenAfter(0, kFramesAround - 1);
  EXPECT_LT(before.x(), 0.0) << before.transpose();
  const Eigen::Vector3d after = chosenAfter(kFramesAround, 2 * kFramesAround - 1);
  EXPECT_GT(after.x(), 0.0) << after.transpose();
}

}  // namespace
}  // namespace test
}  // namespace synthetic_depth
