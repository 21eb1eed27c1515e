// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/pile_surface.h"

#include <chrono>
#include <cmath>
#include <set>
#include <stdexcept>
#include <utility>

#include <gtest/gtest.h>

#include "synthetic_depth/pile.h"
#include "synthetic_depth/seeded_random.h"

namespace simulated_world {
namespace {

using synthetic_depth::SeededRandom;
using SampleSet = std::set<std::pair<int, std::size_t>>;

const Eigen::Vector3d kSize_m(0.3, 0.15, 0.1);

PileBrick brickAt(int id, const Eigen::Vector3d& xyz_m, double yaw_rad = 0.0) {
  PileBrick brick;
  brick.id = id;
  brick.T_map_brick.translation() = xyz_m;
  brick.T_map_brick.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  brick.size_m = kSize_m;
  return brick;
}

/// Bricks leaning and lying in a heap, overlaps allowed: harder than a real pile.
std::vector<PileBrick> tangle(int count, SeededRandom& random) {
  std::vector<PileBrick> bricks;
  for (int id = 0; id < count; ++id) {
    PileBrick brick = brickAt(id, {random.uniform(-0.4, 0.4), random.uniform(-0.3, 0.3), random.uniform(0.0, 0.4)});
    const Eigen::Vector3d axis(random.normal(), random.normal(), random.normal());
    brick.T_map_brick.linear() = Eigen::AngleAxisd(random.uniform(0.0, 3.0), axis.normalized()).toRotationMatrix();
    bricks.push_back(brick);
  }
  return bricks;
}

std::vector<PileBrick> realisticPile(std::uint64_t seed, int max_bricks) {
  synthetic_depth::PileConfig config;
  config.seed = seed;
  config.max_bricks = max_bricks;
  std::vector<PileBrick> bricks;
  for (const synthetic_depth::Box& box : synthetic_depth::makePile(config)) {
    bricks.push_back({box.id, box.T_scene_box, 2.0 * box.half_extents_m, true});
  }
  return bricks;
}

SampleSet exposedOf(const PileTruth& truth) {
  SampleSet set;
  for (const PileTruth::Sample& sample : truth.exposed) set.emplace(sample.brick_id, sample.index);
  return set;
}

bool isInside(const PileBrick& brick, const Eigen::Vector3d& p_map) {
  const Eigen::Vector3d p = brick.T_map_brick.inverse() * p_map;
  return (p.cwiseAbs() - 0.5 * brick.size_m).maxCoeff() < 0.0;
}

/// Walks along each direction in small steps and asks every brick whether it is in it.
SampleSet exposedByWalking(const std::vector<PileBrick>& bricks, const PileSurfaceConfig& config, double step_m) {
  SampleSet exposed;
  for (const PileBrick& brick : bricks) {
    const std::vector<FaceSample> samples = sampleFaces(brick.size_m, config.sample_spacing_m);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const Eigen::Vector3d p_map = brick.T_map_brick * samples[i].p_brick;
      const Eigen::Vector3d normal = brick.T_map_brick.linear() * samples[i].normal_brick;
      if (p_map.z() <= config.ground_height_m + 1e-3) continue;
      for (const Eigen::Vector3d& direction : upwardDirections(config.num_directions)) {
        if (std::acos(direction.dot(normal)) > config.max_view_angle_rad) continue;
        bool is_free = true;
        for (double s = 0.5 * step_m; is_free && s < 2.0; s += step_m) {
          for (const PileBrick& other : bricks) {
            is_free = is_free && (other.id == brick.id || !isInside(other, p_map + s * direction));
          }
        }
        if (is_free) {
          exposed.emplace(brick.id, i);
          break;
        }
      }
    }
  }
  return exposed;
}

TEST(SampleFaces, CoversTheBrickWithNoGaps) {
  const std::vector<FaceSample> samples = sampleFaces(kSize_m, 0.02);
  double area_m2 = 0.0;
  Eigen::Vector3d pull = Eigen::Vector3d::Zero();
  for (const FaceSample& sample : samples) {
    area_m2 += sample.area_m2;
    pull += sample.area_m2 * sample.normal_brick;
    const Eigen::Vector3d rest = sample.p_brick.cwiseAbs() - 0.5 * kSize_m;
    EXPECT_NEAR(rest.maxCoeff(), 0.0, 1e-12);                 // on a face
    EXPECT_GT(sample.p_brick.dot(sample.normal_brick), 0.0);  // with the normal outward
    EXPECT_LE(sample.area_m2, 0.02 * 0.02 + 1e-12);
  }
  EXPECT_NEAR(area_m2, 2.0 * (0.3 * 0.15 + 0.15 * 0.1 + 0.3 * 0.1), 1e-12);
  EXPECT_LT(pull.norm(), 1e-12);  // a closed surface
  EXPECT_EQ(samples.size(), 2U * (15U * 8U + 8U * 5U + 15U * 5U));
}

TEST(UpwardDirections, AreSpreadEvenlyOverTheHemisphere) {
  const auto directions = upwardDirections(96);
  ASSERT_EQ(directions.size(), 96U);
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& direction : directions) {
    EXPECT_NEAR(direction.norm(), 1.0, 1e-12);
    EXPECT_GT(direction.z(), 0.0);
    mean += direction / 96.0;
  }
  EXPECT_LT((mean - Eigen::Vector3d(0.0, 0.0, 0.5)).norm(),
            0.02);  // the centroid of a half sphere is at half its radius
}

TEST(PileSurface, ALoneBrickShowsAllButItsUnderside) {
  PileSurface surface{PileSurfaceConfig()};
  EXPECT_TRUE(surface.update({brickAt(7, {0.2, 0.1, 0.05}, 0.3)}));
  double area_m2 = 0.0;
  for (const PileTruth::Sample& sample : surface.truth()->exposed) {
    area_m2 += sample.area_m2;
    EXPECT_GT(sample.p_map.z(), 0.001);
  }
  EXPECT_NEAR(area_m2, 0.3 * 0.15 + 2.0 * (0.15 * 0.1 + 0.3 * 0.1), 1e-12);
}

TEST(PileSurface, ContactFacesAreHiddenWithAndWithoutAGapAsPhysicsLeavesIt) {
  for (const double gap_m : {-5e-4, 0.0, 5e-4}) {
    PileSurface surface{PileSurfaceConfig()};
    surface.update({brickAt(0, {0.0, 0.0, 0.05}), brickAt(1, {0.0, 0.0, 0.15 + gap_m})});
    double area_m2 = 0.0;
    for (const PileTruth::Sample& sample : surface.truth()->exposed) area_m2 += sample.area_m2;
    EXPECT_NEAR(area_m2, 0.3 * 0.15 + 4.0 * (0.15 * 0.1 + 0.3 * 0.1), 1e-12) << gap_m;
  }
}

TEST(PileSurface, FlushNeighboursDoNotHideEachOthersTops) {
  PileSurface surface{PileSurfaceConfig()};
  surface.update({brickAt(0, {0.0, 0.0, 0.05}), brickAt(1, {0.3, 0.0, 0.05})});
  double area_m2 = 0.0;
  for (const PileTruth::Sample& sample : surface.truth()->exposed) area_m2 += sample.area_m2;
  EXPECT_NEAR(area_m2, 2.0 * (0.3 * 0.15 + 0.15 * 0.1 + 2.0 * 0.3 * 0.1), 1e-12);  // but each other's ends
}

TEST(PileSurface, AgreesWithWalkingAlongEveryLine) {
  PileSurfaceConfig config;
  config.sample_spacing_m = 0.05;  // fewer samples: walking is slow
  config.num_directions = 24;
  SeededRandom random(5);
  std::size_t num_samples = 0;
  std::size_t num_different = 0;
  std::size_t num_hidden = 0;
  for (int repeat = 0; repeat < 3; ++repeat) {
    const std::vector<PileBrick> bricks = tangle(10, random);
    PileSurface surface(config);
    surface.update(bricks);
    const SampleSet expected = exposedByWalking(bricks, config, 0.002);
    const SampleSet exposed = exposedOf(*surface.truth());
    for (const PileBrick& brick : bricks) {
      for (std::size_t i = 0; i < surface.samplesOf(brick.id).size(); ++i) {
        const std::pair<int, std::size_t> key(brick.id, i);
        ++num_samples;
        num_hidden += 1 - expected.count(key);
        num_different += expected.count(key) != exposed.count(key) ? 1 : 0;
      }
    }
  }
  EXPECT_GT(num_hidden, num_samples / 10);
  EXPECT_LT(num_hidden, num_samples * 9 / 10);
  // A walk steps over corners shorter than its step.
  EXPECT_LE(num_different, num_samples / 200);
}

TEST(IsVisibleFrom, AgreesWithWalkingToTheEye) {
  SeededRandom random(11);
  const double max_view_angle_rad = 1.4;
  std::size_t num_seen = 0;
  std::size_t num_in_the_way = 0;
  std::size_t num_different = 0;
  std::size_t num_asked = 0;
  for (int repeat = 0; repeat < 3; ++repeat) {
    PileSurface surface{PileSurfaceConfig()};
    surface.update(tangle(10, random));
    const PileTruth& truth = *surface.truth();
    // One of the eyes stands close to the pile: what is behind it hides nothing.
    for (const Eigen::Vector3d& eye_map : {Eigen::Vector3d(1.2, 0.3, 0.9), Eigen::Vector3d(-0.1, -0.2, 0.8)}) {
      for (std::size_t i = 0; i < truth.exposed.size(); i += 20) {
        const PileTruth::Sample& sample = truth.exposed[i];
        const Eigen::Vector3d way_map = eye_map - sample.p_map;
        bool is_seen = std::acos(way_map.normalized().dot(sample.normal_map)) <= max_view_angle_rad;
        bool is_in_the_way = false;
        for (double s = 0.001; is_seen && !is_in_the_way && s < way_map.norm(); s += 0.002) {
          for (const PileBrick& brick : truth.bricks) {
            is_in_the_way = is_in_the_way ||
                            (brick.id != sample.brick_id && isInside(brick, sample.p_map + s * way_map.normalized()));
          }
        }
        is_seen = is_seen && !is_in_the_way;
        ++num_asked;
        num_seen += is_seen ? 1 : 0;
        num_in_the_way += is_in_the_way ? 1 : 0;
        num_different += is_seen != isVisibleFrom(eye_map, sample, truth, max_view_angle_rad) ? 1 : 0;
      }
    }
  }
  EXPECT_GT(num_seen, num_asked / 10);
  EXPECT_GT(num_in_the_way, num_asked / 10);
  EXPECT_LE(num_different, num_asked / 200);  // a walk steps over corners shorter than its step
}

TEST(IsVisibleFrom, WhatIsBehindTheEyeHidesNothing) {
  PileSurface surface{PileSurfaceConfig()};
  surface.update({brickAt(0, {0.0, 0.0, 0.05}), brickAt(1, {0.5, 0.0, 0.05})});
  for (const PileTruth::Sample& sample : surface.truth()->exposed) {
    if (sample.brick_id != 0 || sample.normal_map.x() < 0.9) continue;
    EXPECT_TRUE(isVisibleFrom({0.3, sample.p_map.y(), sample.p_map.z()}, sample, *surface.truth(), 1.4));
    EXPECT_FALSE(isVisibleFrom({0.7, sample.p_map.y(), sample.p_map.z()}, sample, *surface.truth(), 1.4));
  }
}

TEST(PileSurface, UpdatingGivesWhatANewSurfaceGives) {
  SeededRandom random(11);
  PileSurfaceConfig config;
  config.sample_spacing_m = 0.03;
  std::vector<PileBrick> bricks = tangle(15, random);
  PileSurface updated(config);
  updated.update(bricks);
  int num_uncovered = 0;
  int next_id = 100;
  for (int step = 0; step < 40; ++step) {
    const SampleSet before = exposedOf(*updated.truth());
    const auto chosen = static_cast<std::size_t>(random.uniform(0.0, static_cast<double>(bricks.size())));
    switch (step % 4) {
      case 0:
        bricks.erase(bricks.begin() + static_cast<std::ptrdiff_t>(chosen));
        break;
      case 1:
        bricks[chosen].T_map_brick.translation() += Eigen::Vector3d(0.1, 0.05, 0.02);
        break;
      case 2:
        bricks.push_back(tangle(1, random).front());
        bricks.back().id = next_id++;
        break;
      default:
        bricks[chosen].is_resting = !bricks[chosen].is_resting;
        break;
    }
    EXPECT_TRUE(updated.update(bricks));
    PileSurface fresh(config);
    fresh.update(bricks);
    const SampleSet now = exposedOf(*updated.truth());
    ASSERT_EQ(now, exposedOf(*fresh.truth())) << "step " << step;
    for (const auto& key : now) num_uncovered += before.count(key) == 0 ? 1 : 0;
  }
  EXPECT_GT(num_uncovered, 100);  // the hidden did come to light
}

TEST(PileSurface, AMovingBrickHidesOthersAndShowsNothing) {
  std::vector<PileBrick> bricks{brickAt(0, {0.0, 0.0, 0.05}), brickAt(1, {0.0, 0.0, 0.15})};
  bricks[1].is_resting = false;
  PileSurface surface{PileSurfaceConfig()};
  surface.update(bricks);
  for (const PileTruth::Sample& sample : surface.truth()->exposed) {
    EXPECT_EQ(sample.brick_id, 0);
    EXPECT_LT(sample.p_map.z(), 0.0999);  // its top is hidden
  }
  EXPECT_EQ(surface.truth()->bricks.size(), 2U);
}

TEST(PileSurface, TremorChangesNothingAndCreepDoes) {
  PileSurface surface{PileSurfaceConfig()};
  surface.update({brickAt(0, {0.0, 0.0, 0.05})});
  const auto truth = surface.truth();
  EXPECT_FALSE(surface.update({brickAt(0, {0.0006, 0.0, 0.05})}));
  EXPECT_EQ(surface.truth(), truth);
  EXPECT_TRUE(surface.update({brickAt(0, {0.0012, 0.0, 0.05})}));  // against where it was taken over, not the last look
  EXPECT_NE(surface.truth(), truth);
}

TEST(PileSurface, FollowsABrickTakenFromFortyInWellUnderASecond) {
  std::vector<PileBrick> bricks = realisticPile(3, 40);
  ASSERT_GE(bricks.size(), 25U);
  PileSurface surface{PileSurfaceConfig()};
  surface.update(bricks);
  bricks.pop_back();
  const auto begin = std::chrono::steady_clock::now();
  surface.update(bricks);
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
  EXPECT_LT(seconds.count(), 1.0);  // measured: some ms; the machine may be busy
}

TEST(PileSurface, RefusesWhatIsNoPile) {
  PileSurface surface{PileSurfaceConfig()};
  EXPECT_THROW(surface.update({brickAt(1, {0.0, 0.0, 0.0}), brickAt(1, {1.0, 0.0, 0.0})}), std::invalid_argument);
  PileBrick flat = brickAt(1, {0.0, 0.0, 0.0});
  flat.size_m.z() = 0.0;
  EXPECT_THROW(surface.update({flat}), std::invalid_argument);
  EXPECT_THROW(surface.update({brickAt(1, {std::nan(""), 0.0, 0.0})}), std::invalid_argument);
  PileSurfaceConfig config;
  config.num_directions = 0;
  config.max_view_angle_rad = 1.6;
  EXPECT_EQ(config.validate().size(), 2U);
  EXPECT_THROW(PileSurface{config}, std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
