// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking/cuboids.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <set>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

#include "support/mapped_scene.h"

namespace surface_picking {
namespace {

using mp700_ur5e_description::BrickType;
using test_support::MappedScene;
using test_support::mapScene;
using test_support::pose;
using test_support::SceneOfSolids;
using testing::HasSubstr;

const Eigen::Vector3d kBrick_m(0.3, 0.2, 0.2);

std::vector<BrickType> brickTypes() {
  BrickType brick;
  brick.name = "brick";
  brick.size_m = kBrick_m;
  return {brick};
}

SceneOfSolids bricks(const std::vector<Eigen::Isometry3d>& T_scene_bricks) {
  SceneOfSolids solids;
  for (const Eigen::Isometry3d& T : T_scene_bricks) solids.addBox(kBrick_m, T);
  return solids;
}

struct Found {
  MappedScene mapped;
  std::vector<Patch> patches;
  std::vector<Cuboid> cuboids;
  CuboidStatistics statistics;
};

Found findIn(const SceneOfSolids& solids, bool asks_space = true, const std::vector<BrickType>& types = brickTypes()) {
  Found found;
  found.mapped = mapScene(solids);
  const TriangleMesh mesh = cropMesh(found.mapped.mesh, {-0.9, -0.9, -1.0}, {0.9, 0.9, 2.0});
  found.patches = findPatches(mesh, PatchConfig());
  SpaceQuery space;
  if (asks_space) {
    space = [&found](const Eigen::Matrix3Xd& points) {
      gpis_mapping::QueryOptions options;
      options.variance = false;
      return found.mapped.snapshot->query(points, options).state;
    };
  }
  found.cuboids = findCuboids(mesh, found.patches, types, space, CuboidConfig(), &found.statistics);
  return found;
}

struct Match {
  int num_right{0};  // boxes found
  int num_wrong{0};  // cuboids where no box is, or one twice
};

/// Compares with the boxes that are bricks. Position within `bound_m`, rotation within `bound_rad`, both also within 4.5
/// of the stated standard deviations in all six numbers (chi-square of 6 beyond which one in 10^4 lies: 27.9).
Match compare(const SceneOfSolids& solids, const Found& found, double bound_m, double bound_rad) {
  Match match;
  std::set<int> taken;
  for (const Cuboid& cuboid : found.cuboids) {
    bool is_right = false;
    for (const synthetic_depth::Box& box : solids.boxes) {
      if ((2.0 * box.half_extents_m - kBrick_m).norm() > 1e-9) continue;
      const Eigen::Isometry3d T =
          nearestSymmetric(found.mapped.T_map_scene * box.T_scene_box, kBrick_m, cuboid.T_map_body.linear());
      const Eigen::Vector3d off = cuboid.T_map_body.translation() - T.translation();
      const Eigen::AngleAxisd turn(cuboid.T_map_body.linear() * T.linear().transpose());
      if (off.norm() > bound_m || turn.angle() > bound_rad || !taken.insert(box.id).second) continue;
      is_right = true;
      Eigen::Matrix<double, 6, 1> error;
      error << off, turn.angle() * turn.axis();
      EXPECT_LT(error.dot(cuboid.covariance.inverse() * error), 27.9)
          << "box " << box.id << " is off by " << off.transpose() << " m and " << error.tail<3>().transpose() << " rad";
    }
    ++(is_right ? match.num_right : match.num_wrong);
    EXPECT_TRUE(is_right) << "no brick is at " << (found.mapped.T_map_scene.inverse() * cuboid.T_map_body).matrix();
  }
  return match;
}

// What the map does to a face: noise of 3 to 7 mm a pixel, averaged over three images of each eye; a bias of 1 to 2 mm to
// the inside; an edge found to half a triangle, 5 mm, over 10 to 30 of them.
constexpr double kPosition_m = 0.006;
constexpr double kRotation_rad = 0.03;
// Seen from one side an edge is half as long and its border ragged.
constexpr double kPositionOneSide_m = 0.010;
constexpr double kRotationOneSide_rad = 0.05;

TEST(Cuboids, ABrickIsFoundInManyOrientations) {
  std::mt19937_64 engine(1);
  std::uniform_real_distribution<double> angle(-M_PI, M_PI);
  std::vector<Eigen::Isometry3d> poses = {pose(0.0, 0.0, 0.1), pose(0.0, 0.0, 0.1, 0.4),
                                          pose(0.0, 0.0, 0.15, 0.4, M_PI / 2), pose(0.0, 0.0, 0.1, 1.0, 0.0, M_PI / 2)};
  for (int i = 0; i < 8; ++i) {
    const Eigen::Isometry3d T = pose(0.0, 0.0, 0.0, angle(engine), 0.5 * angle(engine), angle(engine));
    // Its lowest corner on the ground.
    const double down = 0.5 * T.linear().row(2).cwiseAbs() * kBrick_m;
    poses.push_back(Eigen::Translation3d(0.0, 0.0, down) * T);
  }
  int num_right = 0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    SCOPED_TRACE("orientation " + std::to_string(i));
    SceneOfSolids solids = bricks({poses[i]});
    solids.seed = i + 1;
    solids.lookAround(6);
    const Found found = findIn(solids);
    const Match match = compare(solids, found, kPosition_m, kRotation_rad);
    EXPECT_EQ(match.num_right, 1) << found.statistics.num_few_edges << " few edges, "
                                  << found.statistics.num_penetrating << " penetrating, " << found.statistics.num_free
                                  << " free, " << found.statistics.num_unsure << " unsure, "
                                  << found.statistics.num_ambiguous << " ambiguous of "
                                  << found.statistics.num_hypotheses;
    num_right += match.num_right;
  }
  EXPECT_EQ(num_right, 12);
}

TEST(Cuboids, ABrickSeenFromOneSideIsFoundOrLeftOut) {
  int num_right = 0;
  for (int i = 0; i < 8; ++i) {
    SCOPED_TRACE("yaw " + std::to_string(i));
    SceneOfSolids solids = bricks({pose(0.0, 0.0, 0.1, 0.2 * i)});
    solids.seed = static_cast<std::uint64_t>(i + 1);
    solids.lookAround(2, 1.3, 1.1, 0.0, 0.6);
    num_right += compare(solids, findIn(solids), kPositionOneSide_m, kRotationOneSide_rad).num_right;
  }
  EXPECT_GE(num_right, 7);
}

// A localisation with a standard deviation of 1 cm shows opposite faces up to 2 cm nearer or farther than they are.
TEST(Cuboids, ABrickMappedFromPosesThatDriftedIsFoundOrLeftOut) {
  int num_found = 0;
  for (int i = 0; i < 16; ++i) {
    SCOPED_TRACE("scene " + std::to_string(i));
    SceneOfSolids solids = bricks({pose(0.0, 0.0, 0.1, 0.1 * i)});
    solids.seed = static_cast<std::uint64_t>(i + 1);
    solids.drift_m.x() = i % 2 == 0 ? 0.02 : -0.02;
    solids.lookAround(6, 1.3, 1.1, 0.5 * M_PI);  // the latter half from the other side
    const Found found = findIn(solids);
    ASSERT_LE(found.cuboids.size(), 1U);
    if (found.cuboids.empty()) continue;
    ++num_found;
    const Eigen::Isometry3d& T_found = found.cuboids[0].T_map_body;
    const Eigen::Isometry3d T =
        nearestSymmetric(found.mapped.T_map_scene * solids.boxes[0].T_scene_box, kBrick_m, T_found.linear());
    // Between where the one half shows it and where the other does.
    EXPECT_LT((T_found.translation() - T.translation()).norm(), solids.drift_m.norm() + kPosition_m);
    EXPECT_LT(Eigen::AngleAxisd(T_found.linear() * T.linear().transpose()).angle(), kRotationOneSide_rad);
  }
  EXPECT_GE(num_found, 8);  // 10 are; of the others an end is mapped nowhere, or the sides are too far off
}

// Lying and leaning bricks, seen from all around; the latter half of the views doubles their faces, 2 cm off.
TEST(Cuboids, BricksInViewsThatDisagreeAreFound) {
  constexpr double kDrift_m = 0.02;
  int num_found = 0;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE("pile " + std::to_string(seed));
    std::mt19937_64 engine(seed);
    std::uniform_real_distribution<double> any(-1.0, 1.0);
    std::vector<Eigen::Isometry3d> poses;
    for (int i = 0; i < 6; ++i) {
      const double tilt_rad = i % 2 == 0 ? 0.0 : 0.35 + 0.5 * std::abs(any(engine));
      const double height_m = 0.5 * (kBrick_m.x() * std::sin(tilt_rad) + kBrick_m.z() * std::cos(tilt_rad));
      poses.push_back(
          pose(0.42 * (i % 3 - 1) + 0.04 * any(engine), i < 3 ? -0.25 : 0.25, height_m, M_PI * any(engine), tilt_rad));
    }
    SceneOfSolids solids = bricks(poses);
    solids.seed = seed;
    solids.lookAround(6, 1.4, 1.2, M_PI * any(engine));
    const double heading_rad = M_PI * any(engine);
    solids.drift_m = kDrift_m * Eigen::Vector3d(std::cos(heading_rad), std::sin(heading_rad), 0.0);
    const Found found = findIn(solids);
    for (const Cuboid& cuboid : found.cuboids) {
      const bool is_there = std::any_of(poses.begin(), poses.end(), [&](const Eigen::Isometry3d& T_scene_brick) {
        const Eigen::Isometry3d T = found.mapped.T_map_scene * T_scene_brick;
        return (cuboid.T_map_body.translation() - T.translation()).norm() < kDrift_m + kPosition_m &&
               angleBetweenBodies(cuboid.T_map_body, T, kBrick_m) < 2.0 * kRotationOneSide_rad;
      });
      EXPECT_TRUE(is_there) << "at " << cuboid.T_map_body.translation().transpose();
    }
    num_found += static_cast<int>(found.cuboids.size());
  }
  EXPECT_GE(num_found, 22);  // of 24
}

TEST(Cuboids, WithoutSpaceClosedFacesAreEnough) {
  SceneOfSolids solids = bricks({pose(0.0, 0.0, 0.1, 0.4)});
  solids.lookAround(6);
  EXPECT_EQ(compare(solids, findIn(solids, false), kPosition_m, kRotation_rad).num_right, 1);
}

// The same faces with something before each of them: no edge tells where they end.
TEST(Cuboids, ConcaveBordersAreNoEdges) {
  SceneOfSolids solids = bricks({pose(0.0, 0.0, 0.1, 0.4)});
  solids.lookAround(6);
  Found found = findIn(solids);
  ASSERT_EQ(found.cuboids.size(), 1u);
  const TriangleMesh mesh = cropMesh(found.mapped.mesh, {-0.9, -0.9, -1.0}, {0.9, 0.9, 2.0});
  for (Patch& patch : found.patches) {
    for (BorderPoint& point : patch.border) {
      if (point.kind == BorderKind::kConvex) point.kind = BorderKind::kConcave;
    }
  }
  EXPECT_TRUE(findCuboids(mesh, found.patches, brickTypes(), {}, CuboidConfig()).empty());
}

// Two faces in one plane are one patch, twice as long: the sizes of the types tell.
TEST(Cuboids, TouchingBricksAreTwo) {
  const std::vector<std::pair<const char*, std::vector<Eigen::Isometry3d>>> scenes = {
      {"long sides", {pose(0.0, -0.1, 0.1), pose(0.0, 0.1, 0.1)}},
      {"end to end", {pose(-0.15, 0.0, 0.1), pose(0.15, 0.0, 0.1)}},
      {"as an L", {pose(0.0, 0.0, 0.1), pose(0.25, 0.05, 0.1, M_PI / 2)}},
      {"stacked", {pose(0.0, 0.0, 0.1), pose(0.0, 0.0, 0.3)}},
      {"stacked and turned", {pose(0.0, 0.0, 0.1), pose(0.03, 0.02, 0.3, 0.6)}}};
  for (const auto& [name, poses] : scenes) {
    SCOPED_TRACE(name);
    SceneOfSolids solids = bricks(poses);
    solids.lookAround(6);
    // The lower edge of the lower brick is nowhere to be seen: its height is that of its split, to half of the tolerance.
    EXPECT_EQ(compare(solids, findIn(solids), 0.015, kRotation_rad).num_right, 2);
  }
}

TEST(Cuboids, ABrickAtAWallIsFoundAndTheWallIsNone) {
  SceneOfSolids solids = bricks({pose(-0.1, 0.0, 0.1, M_PI / 2)});
  solids.addBox({0.1, 1.6, 0.6}, pose(-0.25, 0.0, 0.3));
  solids.lookAround(4, 1.3, 1.1, -1.0, 2.0);
  EXPECT_EQ(compare(solids, findIn(solids), kPosition_m, kRotation_rad).num_right, 1);
}

// A post hides the middle of the brick and half of its front: what is seen must still be enough, or nothing is said.
TEST(Cuboids, ABrickHalfHiddenIsFoundOrLeftOut) {
  int num_right = 0;
  for (int i = 0; i < 6; ++i) {
    SCOPED_TRACE("post " + std::to_string(i));
    SceneOfSolids solids = bricks({pose(0.0, 0.0, 0.1, 0.3)});
    solids.addBox({0.04, 0.15, 0.4}, pose(0.32, -0.15 + 0.06 * i, 0.2));
    solids.seed = static_cast<std::uint64_t>(i + 1);
    solids.lookAround(2, 1.3, 0.9, -0.2, 0.4);
    num_right += compare(solids, findIn(solids), kPositionOneSide_m, kRotationOneSide_rad).num_right;
  }
  EXPECT_GE(num_right, 3);
}

TEST(Cuboids, DecoysAreRefused) {
  const auto expectNothing = [](const char* name, SceneOfSolids solids) {
    SCOPED_TRACE(name);
    for (const bool is_around : {true, false}) {
      SceneOfSolids seen = solids;
      if (is_around) {
        seen.lookAround(6);
      } else {
        seen.lookAround(2, 1.3, 1.1, 0.0, 0.6);
      }
      EXPECT_EQ(compare(seen, findIn(seen), kPosition_m, kRotation_rad).num_wrong, 0);
    }
  };
  SceneOfSolids sphere;
  sphere.spheres.push_back({{0.0, 0.0, 0.15}, 0.15});
  expectNothing("sphere", sphere);
  SceneOfSolids lying;
  lying.cylinders.push_back({pose(0.0, 0.0, 0.1, 0.3, M_PI / 2), 0.1, 0.15});
  expectNothing("lying cylinder", lying);
  SceneOfSolids standing;
  standing.cylinders.push_back({pose(0.0, 0.0, 0.1), 0.1, 0.1});
  expectNothing("standing cylinder", standing);
  SceneOfSolids cube;
  cube.addBox({0.25, 0.25, 0.25}, pose(0.0, 0.0, 0.125, 0.3));
  expectNothing("cube", cube);
  SceneOfSolids flat;
  flat.addBox({0.3, 0.2, 0.08}, pose(0.0, 0.0, 0.04, 0.3));
  expectNothing("flat box with the top of a brick", flat);
  SceneOfSolids wedge;  // a face of the right size on a body that is none
  wedge.addBox({0.35, 0.25, 0.2}, pose(0.0, 0.0, 0.1, 0.3));
  expectNothing("larger box", wedge);
}

TEST(Cuboids, BricksOfThreeSizesAreToldApart) {
  const std::vector<Eigen::Vector3d> sizes_m = {kBrick_m, {0.24, 0.12, 0.12}, {0.4, 0.2, 0.1}};
  std::vector<BrickType> types(sizes_m.size());
  SceneOfSolids solids;
  for (std::size_t i = 0; i < sizes_m.size(); ++i) {
    types[i].name = std::to_string(i);
    types[i].size_m = sizes_m[i];
    solids.addBox(sizes_m[i], pose(0.45 * static_cast<double>(i) - 0.45, 0.0, 0.5 * sizes_m[i].z(), 0.4));
  }
  solids.lookAround(6);
  const Found found = findIn(solids, true, types);
  std::set<std::string> seen;
  for (const Cuboid& cuboid : found.cuboids) {
    SCOPED_TRACE("type " + cuboid.type);
    EXPECT_TRUE(seen.insert(cuboid.type).second) << "twice";
    const Eigen::Isometry3d T = found.mapped.T_map_scene * solids.boxes[std::stoul(cuboid.type)].T_scene_box;
    EXPECT_LT((cuboid.T_map_body.translation() - T.translation()).norm(), kPosition_m);
    EXPECT_LT(angleBetweenBodies(cuboid.T_map_body, T, cuboid.size_m), kRotation_rad);
  }
  EXPECT_EQ(seen.size(), sizes_m.size());
}

// The lower end of a leaning brick is rounded off on the ground: along half of its edge the face seems to end 4 cm too soon,
// where that of a slab would.
TEST(Cuboids, ALeaningBrickIsNotTwoSlabs) {
  std::vector<BrickType> types(2);
  types[0].name = "brick";
  types[0].size_m = kBrick_m;
  types[1].name = "slab";
  types[1].size_m = {0.26, 0.16, 0.10};
  SceneOfSolids solids;
  solids.addBox(types[1].size_m, pose(-0.6, 0.0, 0.101345, 0.1923741, 0.4476649));
  solids.addBox(kBrick_m, pose(0.0, 0.0, 0.1676649, -0.9916072, 0.6065119));
  solids.addBox(kBrick_m, pose(0.6, 0.0, 0.1470988, -3.0739045, 0.3663807));
  solids.seed = 182;
  solids.lookAround(4, 1.3, 1.1, -2.0755967, 1.5);
  const Found found = findIn(solids, true, types);
  EXPECT_EQ(found.cuboids.size(), 3u);
  for (const Cuboid& cuboid : found.cuboids) {
    const Eigen::Vector3d p = found.mapped.T_map_scene.inverse() * cuboid.T_map_body.translation();
    const double x = p.x() < -0.3 ? -0.6 : p.x() < 0.3 ? 0.0 : 0.6;
    EXPECT_EQ(cuboid.type, x < 0.0 ? "slab" : "brick") << p.transpose();
    EXPECT_NEAR(p.x(), x, kPositionOneSide_m) << p.transpose();
  }
}

// Loose piles, seen from all around and from one side: whatever is reported is a brick, where it is reported. A brick of
// which too little is seen may be left out.
TEST(Cuboids, OfRandomPilesNothingWrongIsReported) {
  std::mt19937_64 engine(5);
  std::uniform_real_distribution<double> yaw(-M_PI, M_PI);
  std::uniform_real_distribution<double> shift(-0.04, 0.04);
  int num_right = 0;
  for (int scene = 0; scene < 6; ++scene) {
    SCOPED_TRACE("pile " + std::to_string(scene));
    std::vector<Eigen::Isometry3d> poses;
    for (int i = -1; i <= 1; ++i) {
      for (int j = -1; j <= 0; ++j) {
        poses.push_back(pose(0.38 * i + shift(engine), 0.19 + 0.38 * j + shift(engine), 0.1, yaw(engine)));
      }
    }
    poses.push_back(pose(shift(engine), shift(engine), 0.3, yaw(engine)));
    SceneOfSolids solids = bricks(poses);
    solids.seed = static_cast<std::uint64_t>(scene + 1);
    const bool is_around = scene % 2 == 0;
    if (is_around) {
      solids.lookAround(6, 1.4, 1.2, 0.5 * scene);
    } else {
      solids.lookAround(3, 1.4, 1.2, 0.5 * scene, 1.5);
    }
    // From one side: twice the standard deviation with which a body may be reported.
    const Match match = compare(solids, findIn(solids), 0.02, is_around ? 0.06 : 2.0 * CuboidConfig().max_std_rad);
    EXPECT_EQ(match.num_wrong, 0);
    num_right += match.num_right;
  }
  EXPECT_GE(num_right, 30);  // of 42
}

TEST(Cuboids, OverlapIsThatOfSamples) {
  std::mt19937_64 engine(3);
  std::uniform_real_distribution<double> angle(-M_PI, M_PI);
  std::uniform_real_distribution<double> place(-0.3, 0.3);
  int num_both = 0;
  for (int i = 0; i < 300; ++i) {
    const Eigen::Isometry3d a = pose(0.0, 0.0, 0.0, angle(engine), angle(engine), angle(engine));
    const Eigen::Isometry3d b = pose(place(engine), place(engine), place(engine), angle(engine), angle(engine), 0.3);
    const Eigen::Matrix3Xd points = insidePoints(b, kBrick_m, 0.0, 25);
    bool has_shared = false;
    for (Eigen::Index k = 0; k < points.cols() && !has_shared; ++k) {
      has_shared = ((a.inverse() * points.col(k)).array().abs() < 0.5 * kBrick_m.array()).all();
    }
    num_both += has_shared ? 1 : 0;
    // Samples are 1.25 cm apart: boxes that share more than 2 cm along every axis share one.
    EXPECT_EQ(overlap(a, kBrick_m, b, kBrick_m, has_shared ? 0.0 : 0.02), has_shared) << i;
    EXPECT_EQ(overlap(a, kBrick_m, b, kBrick_m, 0.01), overlap(b, kBrick_m, a, kBrick_m, 0.01));
  }
  EXPECT_GT(num_both, 100);
  EXPECT_LT(num_both, 290);
}

TEST(Cuboids, SymmetryLeavesTheBodyWhereItIs) {
  const Eigen::Isometry3d T = pose(0.1, 0.2, 0.3, 0.4, 0.5, 0.6);
  for (const Eigen::Vector3d& size : {Eigen::Vector3d(0.3, 0.2, 0.2), Eigen::Vector3d(0.3, 0.2, 0.1)}) {
    for (double turn = 0.0; turn < 6.0; turn += M_PI / 2) {
      const Eigen::Isometry3d other = T * Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitX());
      const Eigen::Isometry3d nearest = nearestSymmetric(other, size, T.linear());
      const Eigen::Matrix3d R = other.linear().transpose() * nearest.linear();
      EXPECT_LT(((R.cwiseAbs() * size) - size).norm(), 1e-9);
      const bool is_symmetry = size.y() == size.z() || std::abs(std::sin(turn)) < 0.5;
      EXPECT_NEAR(angleBetweenBodies(other, T, size), is_symmetry ? 0.0 : M_PI / 2, 1e-6) << turn;
    }
  }
}

TEST(Cuboids, RefuseWhatMakesNoSense) {
  SceneOfSolids solids = bricks({pose(0.0, 0.0, 0.1)});
  solids.lookAround(2);
  const MappedScene mapped = mapScene(solids);
  const std::vector<Patch> patches = findPatches(mapped.mesh, PatchConfig());
  const auto messageOf = [&](const TriangleMesh& mesh, const std::vector<BrickType>& types, const SpaceQuery& space,
                             const CuboidConfig& config) {
    return test_support::messageOf<std::invalid_argument>([&] { findCuboids(mesh, patches, types, space, config); });
  };
  EXPECT_THAT(messageOf(mapped.mesh, {}, {}, CuboidConfig()), HasSubstr("no types of bodies"));
  std::vector<BrickType> types = brickTypes();
  types[0].size_m.y() = 0.0;
  EXPECT_THAT(messageOf(mapped.mesh, types, {}, CuboidConfig()), HasSubstr("size_m of type 'brick'"));
  EXPECT_THAT(messageOf(TriangleMesh(), brickTypes(), {}, CuboidConfig()), HasSubstr("must be one of the mesh's 0"));
  const SpaceQuery mute = [](const Eigen::Matrix3Xd&) { return std::vector<SpaceState>(); };
  EXPECT_THAT(messageOf(mapped.mesh, brickTypes(), mute, CuboidConfig()), HasSubstr("space() gave 0 answers"));
  CuboidConfig config;
  config.size_tolerance_m = 0.0;
  EXPECT_THAT(messageOf(mapped.mesh, brickTypes(), {}, config), HasSubstr("size_tolerance_m = 0 m"));
}

}  // namespace
}  // namespace surface_picking
