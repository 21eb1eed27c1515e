// SPDX-License-Identifier: BSD-3-Clause
// What changes a map beside depth images: clearBox, takeOut and retune.
#include <cmath>
#include <limits>

#include <gmock/gmock.h>

#include "analytic_surfaces.h"
#include "gpis_mapping/gpis_map.h"
#include "gpis_mapping/mesh_extractor.h"

namespace gpis_mapping {
namespace {

using gpis_mapping_test::sampleRectangle;
using testing::HasSubstr;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

MapContents floorContents() {
  MapContents contents;
  sampleRectangle({-0.5, -0.5, 0.0}, {1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, 0.02, 0.001, &contents.points);
  auto chunk = std::make_unique<ObservedLayer::Chunk>();
  chunk->fill(1.0f);
  for (int x = -1; x <= 0; ++x) {
    for (int y = -1; y <= 0; ++y) contents.observed.setChunk({x, y, 0}, *chunk);  // 0.8 m a side, above the floor
  }
  return contents;
}

Eigen::Isometry3d boxPose() {
  return Eigen::Translation3d(0.1, -0.05, 0.1) *
         Eigen::Isometry3d(Eigen::AngleAxisd(0.6, Eigen::Vector3d(0.2, 0.1, 1.0).normalized()));
}

bool isInBox(const Eigen::Vector3d& p_map, const Eigen::Vector3d& size_m) {
  return ((boxPose().inverse() * p_map).cwiseAbs().array() <= 0.5 * size_m.array()).all();
}

TEST(ClearBox, ForgetsExactlyThePointsInATurnedBox) {
  const Eigen::Vector3d size(0.4, 0.2, 0.5);
  const MapContents before = floorContents();
  GpisMap map(before);
  const auto removed = map.clearBox(boxPose(), size);
  std::size_t expected = 0;
  for (const SurfacePoint& point : before.points) expected += isInBox(point.position_map, size) ? 1 : 0;
  ASSERT_GT(expected, 50u);
  EXPECT_EQ(removed.size(), expected);
  for (const Eigen::Vector3d& p : removed) EXPECT_TRUE(isInBox(p, size));
  EXPECT_EQ(map.snapshot()->numPoints(), before.points.size() - expected);
  for (const SurfacePoint& point : map.contents().points) EXPECT_FALSE(isInBox(point.position_map, size));
}

TEST(ClearBox, LeavesTheMapThatWouldHaveBeenBuiltWithoutThosePoints) {
  const Eigen::Vector3d size(0.4, 0.2, 0.5);
  GpisMap map(floorContents());
  map.clearBox(boxPose(), size);
  MapContents rest = floorContents();
  rest.points.erase(std::remove_if(rest.points.begin(), rest.points.end(),
                                   [&](const SurfacePoint& p) { return isInBox(p.position_map, size); }),
                    rest.points.end());
  const GpisMap oracle(rest);
  Points3d at(3, 400);
  for (int i = 0; i < 400; ++i) at.col(i) << -0.5 + 0.05 * (i % 20), -0.5 + 0.05 * (i / 20), 0.01;
  const QueryResult is = map.snapshot()->query(at);
  const QueryResult should = oracle.snapshot()->query(at);
  for (int i = 0; i < 400; ++i) {
    // Floats; the cells' points stand in the same order, cells away from the box are the very same.
    if (std::isnan(should.distance[i])) {
      EXPECT_TRUE(std::isnan(is.distance[i]));
    } else {
      EXPECT_NEAR(is.distance[i], should.distance[i], 1e-5) << at.col(i).transpose();
    }
  }
  MeshExtractor extractor(map.config());
  extractor.update(*map.snapshot());
  std::size_t deep_inside = 0;
  const Eigen::Vector3d core =
      size.array() - 2.0 * 0.04;  // marching cubes reach 1.25 spacings and a voxel beyond points
  for (const Eigen::Vector3d& v : extractor.mesh().vertices_map) deep_inside += isInBox(v, core) ? 1 : 0;
  EXPECT_EQ(deep_inside, 0u);
}

/// A brick of 0.3 x 0.2 x 0.2 m whose top and -y side were seen, before a wall that was seen from +y, its back to the brick.
/// Nothing was seen free: only surface tells where space is.
MapContents brickBeforeWall() {
  MapContents contents;
  sampleRectangle({-0.15, -0.10, 0.2}, {0.3, 0.0, 0.0}, {0.0, 0.2, 0.0}, 0.02, 0.001, &contents.points);
  sampleRectangle({-0.15, -0.10, 0.0}, {0.3, 0.0, 0.0}, {0.0, 0.0, 0.2}, 0.02, 0.001, &contents.points);
  sampleRectangle({0.25, 0.16, 0.0}, {-0.5, 0.0, 0.0}, {0.0, 0.0, 0.4}, 0.02, 0.001, &contents.points);
  return contents;
}

SpaceState stateAt(const GpisMap& map, const Eigen::Vector3d& p_map) {
  return map.snapshot()->query(p_map).state[0];
}

TEST(TakeOut, LeavesFreeSpaceWhereTheSolidWasAndBesideIt) {
  const Eigen::Isometry3d T_map_brick(Eigen::Translation3d(0.0, 0.0, 0.1));
  const Eigen::Vector3d size(0.3, 0.2, 0.2);
  GpisMap map(brickBeforeWall());
  const Eigen::Vector3d inside(0.025, 0.025, 0.125), above(0.025, 0.075, 0.225), behind(0.025, 0.275, 0.225);
  ASSERT_EQ(stateAt(map, inside), SpaceState::kOccupied);
  ASSERT_EQ(stateAt(map, above), SpaceState::kFree);
  const SpaceState far_before = stateAt(map, behind);
  const auto removed = map.takeOut(T_map_brick, size, 0.01, 5.0);
  GpisMap forgetful(brickBeforeWall());
  const auto cleared = forgetful.clearBox(T_map_brick, size.array() + 0.02);
  EXPECT_EQ(removed.size(), cleared.size());
  EXPECT_NE(stateAt(forgetful, above), SpaceState::kFree) << "the wall's back would tell it to be solid";
  std::size_t seen = 0;
  for (double x = -0.125; x < 0.15; x += 0.05) {
    for (double y = -0.075; y < 0.1; y += 0.05) {
      for (double z = 0.025; z < 0.2; z += 0.05, ++seen) {
        EXPECT_EQ(stateAt(map, {x, y, z}), SpaceState::kFree) << x << " " << y << " " << z;
      }
    }
  }
  EXPECT_EQ(seen, 6u * 4u * 4u);
  EXPECT_EQ(stateAt(map, above), SpaceState::kFree);
  EXPECT_EQ(stateAt(map, behind), far_before) << "too far away to be touched";
}

TEST(TakeOut, ForgetsWhereTheSolidStoodBeforeItWasPushed) {
  const Eigen::Vector3d size(0.3, 0.2, 0.2);
  const Eigen::Isometry3d T_map_brick =
      Eigen::Translation3d(0.1, -0.05, 0.1) * Eigen::Isometry3d(Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitZ()));
  const double padding_m = 0.01;
  for (const Eigen::Vector3d& moved_brick : {Eigen::Vector3d(0.0, 0.05, 0.0), Eigen::Vector3d(-0.04, 0.03, 0.0)}) {
    const MapContents before = floorContents();
    GpisMap map(before);
    const auto removed = map.takeOut(T_map_brick, size, padding_m, 5.0, T_map_brick.linear() * moved_brick);
    // By small steps of the way.
    std::size_t expected = 0;
    for (const SurfacePoint& point : before.points) {
      const Eigen::Vector3d p_brick = T_map_brick.inverse() * point.position_map;
      bool is_swept = false;
      for (int k = 0; k <= 5000 && !is_swept; ++k) {
        const Eigen::Vector3d p = p_brick + k / 5000.0 * moved_brick;
        is_swept = (p.cwiseAbs().array() <= 0.5 * size.array() + padding_m).all();
      }
      expected += is_swept ? 1 : 0;
    }
    EXPECT_EQ(removed.size(), expected) << moved_brick.transpose();
    GpisMap unmoved(before);
    EXPECT_GT(removed.size(), unmoved.takeOut(T_map_brick, size, padding_m, 5.0).size());
  }
}

TEST(TakeOut, RefusesWhatIsNoSolid) {
  GpisMap map(floorContents());
  const auto at = Eigen::Isometry3d::Identity();
  EXPECT_THROW(map.takeOut(at, {0.1, 0.0, 0.1}, 0.01, 1.0), std::invalid_argument);
  EXPECT_THROW(map.takeOut(at, {200.0, 200.0, 200.0}, 0.01, 1.0), std::invalid_argument) << "millimetres";
  EXPECT_THROW(map.takeOut(at, {0.1, 0.1, 0.1}, -0.01, 1.0), std::invalid_argument);
  EXPECT_THROW(map.takeOut(at, {0.1, 0.1, 0.1}, 0.01, kNaN), std::invalid_argument);
  EXPECT_THROW(map.takeOut(at, {0.1, 0.1, 0.1}, 0.01, 1.0, {kNaN, 0.0, 0.0}), std::invalid_argument);
  EXPECT_EQ(map.snapshot()->numPoints(), 2500u);
}

TEST(ClearBox, ForgetsThatSpaceInsideWasFree) {
  const Eigen::Vector3d size(0.4, 0.2, 0.5);
  GpisMap map(floorContents());
  const auto before = map.snapshot();
  map.clearBox(boxPose(), size);
  std::size_t inside = 0;
  for (double x = -0.775; x < 0.8; x += 0.05) {
    for (double y = -0.775; y < 0.8; y += 0.05) {
      for (double z = 0.025; z < 0.8; z += 0.05) {
        const Eigen::Vector3d block(x, y, z);
        ASSERT_TRUE(before->observed().isFree(block));
        EXPECT_EQ(map.snapshot()->observed().isFree(block), !isInBox(block, size)) << block.transpose();
        inside += isInBox(block, size) ? 1 : 0;
      }
    }
  }
  EXPECT_GT(inside, 100u);
}

TEST(ClearBox, RefusesImpossibleBoxesAndChangesNothing) {
  GpisMap map(floorContents());
  const std::size_t num_points = map.snapshot()->numPoints();
  const auto refusal = [&](const Eigen::Isometry3d& pose, const Eigen::Vector3d& size) -> std::string {
    try {
      map.clearBox(pose, size);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "accepted";
  };
  EXPECT_THAT(refusal(boxPose(), {0.1, 0.0, 0.1}), HasSubstr("must be finite and > 0 m"));
  EXPECT_THAT(refusal(boxPose(), {0.1, kNaN, 0.1}), HasSubstr("must be finite and > 0 m"));
  EXPECT_THAT(refusal(boxPose(), {0.1, std::numeric_limits<double>::infinity(), 0.1}), HasSubstr("finite"));
  Eigen::Isometry3d bad = boxPose();
  bad.translation().x() = kNaN;
  EXPECT_THAT(refusal(bad, {0.1, 0.1, 0.1}), HasSubstr("pose of the box is not finite"));
  bad = boxPose();
  bad.linear() *= 2.0;
  EXPECT_THAT(refusal(bad, {0.1, 0.1, 0.1}), HasSubstr("no rigid motion"));
  EXPECT_EQ(map.snapshot()->numPoints(), num_points);
}

TEST(ClearBox, OfEverythingLeavesAnEmptyMapThatStillAnswers) {
  GpisMap map(floorContents());
  EXPECT_EQ(map.clearBox(Eigen::Isometry3d::Identity(), {1e6, 1e6, 1e6}).size(), 2500u);
  EXPECT_EQ(map.snapshot()->numPoints(), 0u);
  EXPECT_TRUE(map.snapshot()->cells().empty());
  const QueryResult answer = map.snapshot()->query(Points3d(Eigen::Vector3d(0.0, 0.0, 0.1)));
  EXPECT_TRUE(std::isnan(answer.distance[0]));
  EXPECT_EQ(answer.state[0], SpaceState::kUnknown);
}

TEST(Retune, RefusesImpossibleValuesAndKeepsTheOldOnes) {
  GpisMap map(floorContents());
  GpisConfig::Sensor sensor = map.config().sensor;
  sensor.min_range_m = 5.0;
  try {
    map.retune(sensor, map.config().dynamic);
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("sensor/min_range_m must be below sensor/max_range_m"));
  }
  EXPECT_EQ(map.config().sensor.min_range_m, GpisConfig{}.sensor.min_range_m);
}

/// A camera 0.5 m above the floor that looks straight down and sees nothing within reach, as if the floor were gone.
DepthImage nothing(const CameraModel& camera) {
  return {camera.width, camera.height,
          std::vector<float>(static_cast<std::size_t>(camera.width) * camera.height,
                             std::numeric_limits<float>::infinity())};
}

TEST(Retune, TakesEffectWithTheNextImage) {
  const CameraModel camera{64, 48, 60.0, 60.0, 31.5, 23.5};
  const Eigen::Isometry3d T_map_camera =
      Eigen::Translation3d(0.0, 0.0, 0.5) * Eigen::Isometry3d(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
  GpisMap map(floorContents());
  GpisConfig::Dynamic off = map.config().dynamic;
  off.enabled = false;
  map.retune(map.config().sensor, off);
  EXPECT_EQ(map.update(nothing(camera), camera, T_map_camera, 1.0).deleted, 0u);
  GpisConfig::Dynamic on = off;
  on.enabled = true;
  map.retune(map.config().sensor, on);
  EXPECT_GT(map.update(nothing(camera), camera, T_map_camera, 2.0).deleted, 300u);
}

TEST(Retune, OfRangesReachesTheClassifier) {
  const CameraModel camera{64, 48, 60.0, 60.0, 31.5, 23.5};
  DepthImage image = nothing(camera);
  std::fill(image.depth_m.begin(), image.depth_m.end(), 0.5f);
  const Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  GpisMap map{GpisConfig{}};
  EXPECT_GT(map.update(image, camera, pose, 1.0).points_in, 0u);
  GpisConfig::Sensor sensor = map.config().sensor;
  sensor.min_range_m = 1.0;
  map.retune(sensor, map.config().dynamic);
  EXPECT_EQ(map.update(image, camera, pose, 2.0).points_in, 0u);
}

}  // namespace
}  // namespace gpis_mapping
