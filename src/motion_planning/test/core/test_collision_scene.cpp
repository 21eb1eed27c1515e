// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/collision_scene.h"

#include <limits>
#include <random>
#include <set>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

#include "collision/collision_scene_data.h"
#include "support/box_world.h"
#include "support/shape_samples.h"

namespace motion_planning {
namespace {

using test_support::messageOf;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::SizeIs;

const Eigen::Isometry3d kBaseAtOrigin = Eigen::Isometry3d::Identity();

BoxWorld bricksOnGround() {
  BoxWorld world;
  world.ground_z_m = 0.0;
  world.ground_half_edge_m = 1.0;
  world.boxes = {uprightBox({0.7, -0.2, 0.1}, {0.3, 0.2, 0.2}), uprightBox({0.7, 0.2, 0.1}, {0.3, 0.2, 0.2}),
                 uprightBox({0.7, 0.0, 0.3}, {0.3, 0.2, 0.2})};
  world.boxes[2].T_map_box.rotate(Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitZ()));
  return world;
}

/// Triangles of all chunks as displaced, in a canonical order.
std::multiset<std::array<double, 9>> displacedTriangles(const CollisionScene& scene) {
  std::multiset<std::array<double, 9>> result;
  for (const auto& chunk : scene.chunks) {
    for (const auto& triangle : chunk->triangles()) {
      std::array<double, 9> row;
      for (std::size_t i = 0; i < 9; ++i) {
        row[i] = chunk->displaced()[triangle[i / 3]][static_cast<Eigen::Index>(i % 3)];
      }
      result.insert(row);
    }
  }
  return result;
}

void expectSameScene(const CollisionScene& a, const CollisionScene& b) {
  EXPECT_EQ(displacedTriangles(a), displacedTriangles(b));
  ASSERT_TRUE(a.lattice == b.lattice);
  EXPECT_EQ(a.flags, b.flags);
  EXPECT_EQ(a.free_distance_m, b.free_distance_m);
  std::size_t num_near_surface = 0;
  for (std::size_t i = 0; i < a.distance_m.size(); ++i) {
    // Only values that decide on a sign are kept up to date: within two blocks of a surface.
    if (!(std::abs(a.distance_m[i]) < 0.1f)) continue;
    ++num_near_surface;
    EXPECT_EQ(a.distance_m[i], b.distance_m[i]);
  }
  EXPECT_GT(num_near_surface, 100u);
}

/// The numbers below are for this margin, whatever the default is.
CollisionSceneConfig sceneConfig() {
  CollisionSceneConfig config;
  config.margin_m = 0.005;
  return config;
}

TEST(CollisionSceneBuilder, RefusesImpossibleValuesAllAtOnce) {
  CollisionSceneConfig config = sceneConfig();
  config.sigmas = -1.0;
  config.max_margin_m = 0.001;  // below the margin
  config.block_m = std::numeric_limits<double>::quiet_NaN();
  config.region_radius_m = 0.0;
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { CollisionSceneBuilder builder(config); }),
              AllOf(HasSubstr("sigmas = -1, must be in [0, 10]"),
                    HasSubstr("max_margin_m = 0.001 m, must be in [0.005, 0.2] m")));
}

TEST(CollisionSceneBuilder, DisplacesEachFaceByNoLessThanItsMargin) {
  BoxWorld world;
  world.boxes = {{Eigen::Isometry3d(Eigen::Translation3d(0.7, 0.1, 0.4)), {0.3, 0.2, 0.2}}};
  world.boxes[0].T_map_box.rotate(Eigen::AngleAxisd(0.5, Eigen::Vector3d(1.0, 2.0, 3.0).normalized()));
  world.surface_std_m = [](const Eigen::Vector3d& p) { return p.x() > 0.7 ? 0.004 : 0.001; };
  CollisionSceneBuilder builder{sceneConfig()};
  Surface surface = world.surface(0.02);
  // As a mesh with normals of faces has them: each vertex of an edge twice or three times. No gap may open there.
  Surface split;
  for (const auto& triangle : surface.triangles) {
    const std::array<Eigen::Vector3d, 3> p = {surface.vertices_map[triangle[0]], surface.vertices_map[triangle[1]],
                                              surface.vertices_map[triangle[2]]};
    const std::uint32_t first = static_cast<std::uint32_t>(split.vertices_map.size());
    split.triangles.push_back({first, first + 1, first + 2});
    for (const Eigen::Vector3d& vertex : p) {
      split.vertices_map.push_back(vertex);
      split.normals_map.push_back((p[1] - p[0]).cross(p[2] - p[0]).normalized().cast<float>());
    }
  }
  for (const Surface* mesh : {&surface, &split}) {
    builder.update(*mesh, world, kBaseAtOrigin);
    std::set<std::array<double, 3>> places;
    std::multiset<std::pair<std::array<double, 3>, std::array<double, 3>>> edges;
    double farthest_m = 0.0;
    for (const auto& chunk : builder.scene()->chunks) {
      for (const auto& triangle : chunk->triangles()) {
        std::array<std::array<double, 3>, 3> corner;
        double least_m = 1.0;
        for (std::size_t i = 0; i < 3; ++i) {
          const Eigen::Vector3d& p = chunk->displaced()[triangle[i]];
          corner[i] = {p.x(), p.y(), p.z()};
          least_m = std::min(least_m, 2.0 * world.surface_std_m(chunk->mapped()[triangle[i]]) + 0.005);
          farthest_m = std::max(farthest_m, world.distance(p));
        }
        for (std::size_t i = 0; i < 3; ++i) edges.insert({corner[i], corner[(i + 1) % 3]});
        // Everywhere on the triangle, not only at its corners.
        for (int i = 0; i <= 4; ++i) {
          for (int j = 0; i + j <= 4; ++j) {
            const Eigen::Vector3d p = (i * chunk->displaced()[triangle[0]] + j * chunk->displaced()[triangle[1]] +
                                       (4 - i - j) * chunk->displaced()[triangle[2]]) /
                                      4.0;
            EXPECT_GE(world.distance(p), least_m - 1e-7);  // directions are kept to 1e-6
          }
        }
      }
    }
    // At a corner of the box, where sigma is 4 mm, the vertex goes along the diagonal: sqrt(3) 13 mm from it.
    EXPECT_NEAR(farthest_m, std::sqrt(3.0) * 0.013, 1e-6);
    // Closed: each edge has its opposite, across the borders of chunks too.
    EXPECT_GT(builder.scene()->chunks.size(), 4u);
    for (const auto& edge : edges) EXPECT_EQ(edges.count({edge.second, edge.first}), 1u);
  }
}

TEST(CollisionSceneBuilder, LimitsTheMarginAlsoWhereSigmaIsNotKnown) {
  BoxWorld world;
  world.boxes = {uprightBox({0.7, 0.0, 0.4}, {0.3, 0.2, 0.2})};
  for (const double surface_std_m : {0.2, std::numeric_limits<double>::quiet_NaN()}) {
    world.surface_std_m = [=](const Eigen::Vector3d&) { return surface_std_m; };
    CollisionSceneBuilder builder{sceneConfig()};
    builder.update(world.surface(0.02), world, kBaseAtOrigin);
    double nearest_m = 1.0;
    for (const auto& chunk : builder.scene()->chunks) {
      for (const Eigen::Vector3d& p : chunk->displaced()) nearest_m = std::min(nearest_m, world.distance(p));
    }
    EXPECT_NEAR(nearest_m, builder.config().max_margin_m, 1e-7);
  }
}

TEST(CollisionSceneBuilder, SliversDoNotPutSpikesIntoFreeSpace) {
  BoxWorld world;
  world.ground_z_m = 0.2;
  world.ground_half_edge_m = 0.3;
  Surface surface = world.surface(0.02);
  // A triangle 0.2 mm high and steep, as marching cubes leaves them, on two vertices of the plane.
  const auto [a, b, c] = surface.triangles[300];
  surface.vertices_map.push_back(0.5 * (surface.vertices_map[a] + surface.vertices_map[b]) +
                                 Eigen::Vector3d(0.0, 0.0, 2e-4));
  surface.normals_map.push_back(Eigen::Vector3f::UnitZ());
  surface.triangles.push_back({a, b, static_cast<std::uint32_t>(surface.vertices_map.size() - 1)});
  CollisionSceneBuilder builder{sceneConfig()};
  builder.update(surface, world, kBaseAtOrigin);
  for (const auto& chunk : builder.scene()->chunks) {
    for (const Eigen::Vector3d& p : chunk->displaced()) EXPECT_LE(p.z(), 0.2 + 0.009 + 2.1e-4);
  }
}

TEST(CollisionSceneBuilder, RebuildsOnlyWhatChanged) {
  const BoxWorld world = bricksOnGround();
  CollisionSceneBuilder builder{sceneConfig()};
  Surface surface = world.surface(0.02);
  const SceneUpdate first = builder.update(surface, world, kBaseAtOrigin);
  EXPECT_EQ(first.chunks_rebuilt, first.chunks);
  EXPECT_GT(first.chunks, 60u);
  EXPECT_GT(first.blocks_asked, 500u);
  const std::shared_ptr<const CollisionScene> before = builder.scene();

  // The same triangles in another order are the same surface.
  std::mt19937 engine(1);
  std::shuffle(surface.triangles.begin(), surface.triangles.end(), engine);
  SceneUpdate update = builder.update(surface, world, kBaseAtOrigin);
  EXPECT_EQ(update.chunks_rebuilt, 0u);
  EXPECT_EQ(update.chunks, first.chunks);
  EXPECT_LT(update.blocks_asked, first.blocks_asked / 10);  // only what is unknown

  // A vertex on the ground far from borders moves by a nanometre: its chunk, and no other.
  for (std::size_t v = 0; v < surface.vertices_map.size(); ++v) {
    const Eigen::Vector3d& p = surface.vertices_map[v];
    if (std::abs(p.x() + 0.5) < 0.03 && std::abs(p.y() - 0.5) < 0.03 && p.z() == 0.0) {
      surface.vertices_map[v].z() += 1e-9;
      break;
    }
  }
  update = builder.update(surface, world, kBaseAtOrigin);
  EXPECT_EQ(update.chunks_rebuilt, 1u);
  std::size_t kept = 0;
  for (const auto& chunk : builder.scene()->chunks) {
    kept += static_cast<std::size_t>(std::count(before->chunks.begin(), before->chunks.end(), chunk));
  }
  EXPECT_EQ(kept, first.chunks - 1);
}

TEST(CollisionSceneBuilder, IncrementalIsTheSameAsFromScratch) {
  BoxWorld world = bricksOnGround();
  world.boxes.push_back(uprightBox({0.4, 0.5, 0.1}, {0.2, 0.2, 0.2}));
  world.surface_std_m = [](const Eigen::Vector3d& p) { return 0.002 + 0.001 * std::sin(20.0 * p.x()); };
  world.is_unknown = [](const Eigen::Vector3d& p) { return p.x() > 0.75 && p.z() < 0.25; };
  CollisionSceneBuilder builder{sceneConfig()};
  builder.update(world.surface(0.02), world, kBaseAtOrigin);
  std::mt19937 engine(2);
  std::uniform_real_distribution<double> offset(-0.05, 0.05);
  int num_saved = 0;
  for (int round = 0; round < 8; ++round) {
    // A brick moves, one comes or goes, more is seen.
    OrientedBox& moved = world.boxes[engine() % world.boxes.size()];
    moved.T_map_box.translation() += Eigen::Vector3d(offset(engine), offset(engine), 0.0);
    if (round % 3 == 1) world.boxes.pop_back();
    if (round % 3 == 2) world.boxes.push_back(uprightBox({0.5, -0.5 + offset(engine), 0.1}, {0.2, 0.2, 0.2}));
    const double seen_m = 0.75 + 0.03 * round;
    world.is_unknown = [seen_m](const Eigen::Vector3d& p) { return p.x() > seen_m && p.z() < 0.25; };
    const Surface surface = world.surface(0.02);
    const SceneUpdate update = builder.update(surface, world, kBaseAtOrigin);
    EXPECT_LT(update.chunks_rebuilt, update.chunks);
    CollisionSceneBuilder scratch{sceneConfig()};
    const SceneUpdate all = scratch.update(surface, world, kBaseAtOrigin);
    EXPECT_EQ(update.chunks, all.chunks);
    EXPECT_EQ(update.blocks_unknown, all.blocks_unknown);
    if (update.blocks_asked < all.blocks_asked) ++num_saved;  // not where the pile's height has changed
    expectSameScene(*builder.scene(), *scratch.scene());
  }
  EXPECT_GE(num_saved, 4);
}

TEST(CollisionSceneBuilder, NeighbouringChunksAgreeWhenSigmaDrifts) {
  BoxWorld world;
  world.ground_z_m = 0.2;
  world.ground_half_edge_m = 0.5;
  world.surface_std_m = [](const Eigen::Vector3d&) { return 0.010; };
  CollisionSceneBuilder builder{sceneConfig()};
  Surface surface = world.surface(0.02);
  builder.update(surface, world, kBaseAtOrigin);
  // More looks: the map is surer of itself, and the surface moves in a part of it.
  world.surface_std_m = [](const Eigen::Vector3d&) { return 0.002; };
  for (Eigen::Vector3d& p : surface.vertices_map) {
    if (p.x() > 0.101) p.z() += 0.003;
  }
  const SceneUpdate update = builder.update(surface, world, kBaseAtOrigin);
  EXPECT_GT(update.chunks_rebuilt, 0u);
  EXPECT_LT(update.chunks_rebuilt, update.chunks);
  std::map<std::array<double, 3>, std::array<double, 3>> displaced_by_place;
  for (const auto& chunk : builder.scene()->chunks) {
    for (std::size_t v = 0; v < chunk->mapped().size(); ++v) {
      const Eigen::Vector3d& p = chunk->mapped()[v];
      const Eigen::Vector3d& q = chunk->displaced()[v];
      const auto [found, is_new] = displaced_by_place.insert({{p.x(), p.y(), p.z()}, {q.x(), q.y(), q.z()}});
      EXPECT_THAT(found->second, ::testing::ElementsAre(q.x(), q.y(), q.z()));
      EXPECT_NEAR(q.z() - p.z(), p.x() > 0.101 ? 0.009 : 0.025, 1e-3);
    }
  }
}

TEST(CollisionSceneBuilder, FreeDistanceIsNeverTooLarge) {
  BoxWorld world = bricksOnGround();
  world.is_unknown = [](const Eigen::Vector3d& p) { return p.x() > 0.8 && p.z() < 0.3; };
  CollisionSceneBuilder builder{sceneConfig()};
  const SceneUpdate update = builder.update(world.surface(0.02), world, kBaseAtOrigin);
  EXPECT_GT(update.blocks_unknown, 20u);
  const CollisionScene& scene = *builder.scene();
  std::mt19937 engine(3);
  std::uniform_real_distribution<double> coordinate(-2.5, 2.5);
  std::size_t num_large = 0;
  for (int i = 0; i < 3000; ++i) {
    const double scale = i % 2 == 0 ? 1.0 : 0.4;
    const Eigen::Vector3d p(0.5 + scale * coordinate(engine), scale * coordinate(engine), scale * coordinate(engine));
    double nearest = std::numeric_limits<double>::infinity();
    for (const auto& chunk : scene.chunks) {
      for (const Eigen::Vector3d& q : chunk->displaced()) nearest = std::min(nearest, (p - q).norm());
      for (const Eigen::Vector3d& q : chunk->mapped()) nearest = std::min(nearest, (p - q).norm());
    }
    for (std::size_t at = 0; at < scene.flags.size(); ++at) {
      if ((scene.flags[at] & (kBlockInside | kBlockUnknown)) == 0) continue;
      const Eigen::Vector3d beyond =
          ((p - scene.lattice.center(scene.lattice.position(at))).cwiseAbs().array() - 0.025).max(0.0);
      nearest = std::min(nearest, beyond.norm());
    }
    EXPECT_LE(scene.freeDistance(p), nearest + 1e-6);
    if (scene.freeDistance(p) > 0.5 * nearest && nearest > 0.2) ++num_large;
  }
  EXPECT_GT(num_large, 500u);  // nor is it always zero
}

/// A box on the ground, and an unseen piece of space beside it: the first `count` blocks of an upright square of three by
/// three, in rows along y from below, whose corner with the least coordinates is at `corner`.
BoxWorld boxAndUnseenPiece(int count, const Eigen::Vector3d& corner) {
  BoxWorld world;
  world.ground_z_m = 0.0;
  world.ground_half_edge_m = 1.2;
  world.boxes = {uprightBox({0.8, 0.0, 0.1}, {0.2, 0.2, 0.2})};
  world.is_unknown = [=](const Eigen::Vector3d& p) {
    const Eigen::Array3i at = ((p - corner) / 0.05).array().floor().cast<int>();
    return at.x() == 0 && at.y() >= 0 && at.y() < 3 && at.z() >= 0 && 3 * at.z() + at.y() < count;
  };
  return world;
}

std::uint8_t flagsAt(const CollisionSceneBuilder& builder, const Eigen::Vector3d& p_map) {
  const CollisionScene& scene = *builder.scene();
  return scene.flags[scene.lattice.index(scene.lattice.clamped(p_map))];
}

TEST(CollisionSceneBuilder, SpecksOfUnknownSpaceAreNoObstacle) {
  const Eigen::Vector3d first = Eigen::Vector3d(0.575, -0.075, 0.125);
  const Eigen::Vector3d corner = first - Eigen::Vector3d::Constant(0.025);
  for (const int count : {1, 2, 3, 5, 8}) {
    const BoxWorld world = boxAndUnseenPiece(count, corner);
    CollisionSceneBuilder builder{sceneConfig()};
    EXPECT_EQ(builder.update(world.surface(0.02), world, kBaseAtOrigin).blocks_unknown, 0u) << count;
    EXPECT_EQ(flagsAt(builder, first), kBlockObserved | kBlockSpeck) << count;
  }
  const BoxWorld world = boxAndUnseenPiece(9, corner);
  CollisionSceneBuilder builder{sceneConfig()};
  EXPECT_EQ(builder.update(world.surface(0.02), world, kBaseAtOrigin).blocks_unknown, 9u);
  // On the ground, or beside the box: one alone is none either.
  for (const Eigen::Vector3d& touching : {Eigen::Vector3d(0.575, 0.025, 0.025), Eigen::Vector3d(0.675, 0.025, 0.125)}) {
    for (const int count : {1, 2}) {
      const BoxWorld beside = boxAndUnseenPiece(count, touching - Eigen::Vector3d::Constant(0.025));
      CollisionSceneBuilder builder_beside{sceneConfig()};
      builder_beside.update(beside.surface(0.02), beside, kBaseAtOrigin);
      EXPECT_EQ(flagsAt(builder_beside, touching), kBlockObserved | (count == 1 ? kBlockSpeck : kBlockUnknown))
          << touching.transpose() << " and " << count;
    }
  }
}

TEST(CollisionSceneBuilder, ASpeckThatProvesToBePartOfMoreIsAnObstacle) {
  BoxWorld world = boxAndUnseenPiece(0, Eigen::Vector3d::Zero());
  world.is_unknown = [](const Eigen::Vector3d& p) {
    return p.x() > 0.3 && p.x() < 0.6 && std::abs(p.y()) < 0.1 && p.z() > 0.1 && p.z() < 0.15;
  };
  const Eigen::Vector3d end(0.575, 0.025, 0.125);
  CollisionSceneBuilder builder{sceneConfig()};
  builder.update(world.surface(0.02), world, kBaseAtOrigin);
  ASSERT_EQ(flagsAt(builder, end), kBlockObserved | kBlockSpeck) << "only the end of it is near the box";
  world.boxes.push_back(uprightBox({0.45, -0.35, 0.1}, {0.3, 0.2, 0.2}));
  builder.update(world.surface(0.02), world, kBaseAtOrigin);
  EXPECT_EQ(flagsAt(builder, end), kBlockObserved | kBlockUnknown);
}

TEST(CollisionSceneBuilder, OfLargeBlocksFewerMakeASpeck) {
  CollisionSceneConfig config = sceneConfig();
  config.block_m = 0.1;
  for (const int count : {2, 3}) {
    BoxWorld world = boxAndUnseenPiece(0, Eigen::Vector3d::Zero());
    world.is_unknown = [=](const Eigen::Vector3d& p) {
      return p.x() > 0.5 && p.x() < 0.6 && p.y() > -0.1 && p.y() < 0.1 * (count - 1) && p.z() > 0.1 && p.z() < 0.2;
    };
    CollisionSceneBuilder builder{config};
    builder.update(world.surface(0.02), world, kBaseAtOrigin);
    EXPECT_EQ(flagsAt(builder, {0.55, -0.05, 0.15}), kBlockObserved | (count == 2 ? kBlockSpeck : kBlockUnknown));
  }
}

TEST(CollisionSceneBuilder, SpaceSeenFreeStaysFreeWhileTheRobotStands) {
  const Eigen::Vector3d first = Eigen::Vector3d(0.575, -0.075, 0.125);
  const Eigen::Vector3d corner = first - Eigen::Vector3d::Constant(0.025);
  BoxWorld world = boxAndUnseenPiece(0, corner);
  CollisionSceneBuilder builder{sceneConfig()};
  builder.update(world.surface(0.02), world, kBaseAtOrigin);
  ASSERT_EQ(flagsAt(builder, first), kBlockObserved);
  // Noise: the surface moves by a little, and with it the space that its distance makes free.
  world = boxAndUnseenPiece(9, corner);
  world.boxes[0].T_map_box.translation().x() += 1e-3;
  EXPECT_EQ(builder.update(world.surface(0.02), world, kBaseAtOrigin).blocks_unknown, 0u);
  EXPECT_EQ(flagsAt(builder, first), kBlockObserved);
  // From elsewhere it is as the map has it.
  const Eigen::Isometry3d elsewhere(Eigen::Translation3d(0.0, -0.2, 0.0));
  EXPECT_EQ(builder.update(world.surface(0.02), world, elsewhere).blocks_unknown, 9u);
  // What was not seen at first is free once it is, and what comes is in the way.
  world.is_unknown = nullptr;
  EXPECT_EQ(builder.update(world.surface(0.02), world, elsewhere).blocks_unknown, 0u);
  world.boxes.push_back(uprightBox({0.55, -0.05, 0.1}, {0.1, 0.1, 0.2}));
  builder.update(world.surface(0.02), world, elsewhere);
  EXPECT_EQ(flagsAt(builder, first), kBlockObserved | kBlockInside);
}

TEST(CollisionSceneBuilder, UnknownSpaceCountsNearThePileAndUnderItOnly) {
  BoxWorld world;
  world.ground_z_m = 0.0;
  world.ground_half_edge_m = 1.2;
  world.boxes = {uprightBox({0.8, 0.0, 0.4}, {0.4, 0.4, 0.8})};
  world.is_unknown = [](const Eigen::Vector3d& p) { return p.x() > 0.9; };  // behind, and all the ground there
  CollisionSceneBuilder builder{sceneConfig()};
  builder.update(world.surface(0.02), world, kBaseAtOrigin);
  EXPECT_EQ(flagsAt(builder, {1.02, 0.0, 0.82}) & kBlockUnknown, kBlockUnknown);  // behind, beside the seen top
  EXPECT_EQ(flagsAt(builder, {1.4, 0.0, 0.5}), 0);                                // far behind: nobody asks
  EXPECT_EQ(flagsAt(builder, {0.8, 0.0, 0.72}) & kBlockInside, kBlockInside);
  EXPECT_EQ(flagsAt(builder, {0.77, 0.0, 0.42}) & kBlockUnknown, kBlockUnknown);  // deep in the box, under its top
  EXPECT_EQ(flagsAt(builder, {0.5, 0.0, 0.4}), kBlockObserved);                   // seen, free
  EXPECT_EQ(flagsAt(builder, {0.0, -0.7, 0.02}), 0);                              // ground is no pile
}

// A camera that looks down sees no more of a wall than its foot.
TEST(CollisionSceneBuilder, AWallGoesOnAboveWhatWasSeenOfIt) {
  BoxWorld world;
  world.ground_z_m = 0.0;
  world.ground_half_edge_m = 1.2;
  world.boxes = {uprightBox({0.8, 0.8, 0.35}, {1.0, 0.2, 0.7}), uprightBox({0.8, 0.0, 0.1}, {0.3, 0.2, 0.2})};
  const auto isObstacle = [&](double y, double z) {
    CollisionSceneBuilder builder{sceneConfig()};
    builder.update(world.surface(0.02), world, kBaseAtOrigin);
    const CollisionScene& scene = *builder.scene();
    return (scene.flags[scene.lattice.index(scene.lattice.clamped({0.8, y, z}))] & kBlockUnknown) != 0;
  };
  world.is_unknown = [](const Eigen::Vector3d& p) { return p.z() > 0.7; };
  for (const double z : {0.72, 1.1, 1.4, 1.68}) EXPECT_TRUE(isObstacle(0.71, z)) << z;
  for (const double z : {0.72, 0.77, 1.1}) EXPECT_FALSE(isObstacle(0.58, z)) << "before the wall, " << z;
  EXPECT_FALSE(isObstacle(0.0, 1.1)) << "over a brick";
  world.is_unknown = [](const Eigen::Vector3d& p) { return p.z() > 0.7 && p.z() < 1.0; };
  EXPECT_FALSE(isObstacle(0.71, 1.2)) << "seen free";
}

TEST(CollisionSceneBuilder, UnknownSpaceIsAskedForFromTheGroundUpAndAsFarAsItSays) {
  BoxWorld world;
  world.boxes = {uprightBox({0.8, 0.0, 0.2}, {0.4, 0.4, 0.4})};
  world.is_unknown = [](const Eigen::Vector3d& p) { return p.x() > 1.03; };  // behind the far face
  CollisionSceneConfig config = sceneConfig();
  config.unknown_near_pile_m = 0.15;
  CollisionSceneBuilder builder{config};
  builder.update(world.surface(0.02), world, kBaseAtOrigin);
  EXPECT_EQ(flagsAt(builder, {1.07, 0.01, 0.02}), kBlockObserved | kBlockUnknown);  // the lowest block above the ground
  // The far face is at x = 1.0, in the block from 1.00 to 1.05 or the one before: all points within 0.15 m of it are in
  // blocks that count, whichever it is.
  EXPECT_EQ(flagsAt(builder, {1.14, 0.01, 0.22}), kBlockObserved | kBlockUnknown);
  EXPECT_EQ(flagsAt(builder, {1.27, 0.01, 0.22}), 0);
}

TEST(CollisionSceneBuilder, WhatIsLowerThanAPileHasNoUnknownNearIt) {
  for (const double height_m : {0.03, 0.08}) {
    BoxWorld world;
    world.ground_z_m = 0.0;
    world.ground_half_edge_m = 1.2;
    world.boxes = {uprightBox({0.8, 0.0, 0.5 * height_m}, {0.4, 0.4, height_m})};
    world.is_unknown = [](const Eigen::Vector3d& p) { return p.z() > 0.1; };
    CollisionSceneConfig config = sceneConfig();
    config.pile_min_height_m = 0.05;
    CollisionSceneBuilder builder{config};
    const SceneUpdate update = builder.update(world.surface(0.02), world, kBaseAtOrigin);
    EXPECT_EQ(update.blocks_unknown > 0, height_m > 0.05) << height_m;
    EXPECT_EQ(update.blocks_asked > 0, height_m > 0.05) << height_m;
  }
}

/// Says of all space that nobody has seen it, and of some that it is under a surface nonetheless.
class UnsureMap : public MapView {
 public:
  explicit UnsureMap(const BoxWorld& world) : world_(world) {}
  MapAnswers query(const gpis_mapping::Points3d& points_map) const override {
    MapAnswers answers = world_.query(points_map);
    for (auto& state : answers.state) state = gpis_mapping::SpaceState::kUnknown;
    return answers;
  }

 private:
  const BoxWorld& world_;
};

TEST(CollisionSceneBuilder, ANegativeDistanceIsInsideWhateverTheState) {
  BoxWorld world;
  world.boxes = {uprightBox({0.8, 0.0, 0.2}, {0.4, 0.4, 0.4})};
  CollisionSceneBuilder builder{sceneConfig()};
  builder.update(world.surface(0.02), UnsureMap(world), kBaseAtOrigin);
  EXPECT_EQ(flagsAt(builder, {0.81, 0.01, 0.32}), kBlockObserved | kBlockInside);
  EXPECT_EQ(flagsAt(builder, {0.81, 0.01, 0.47}), kBlockObserved | kBlockUnknown);
}

TEST(CollisionSceneBuilder, AChunkThatIsGoneIsAskedAboutAnew) {
  // No ground: with the second brick go all triangles of its chunks.
  BoxWorld world;
  world.boxes = {uprightBox({0.7, -0.12, 0.1}, {0.2, 0.2, 0.2}), uprightBox({0.7, 0.12, 0.1}, {0.2, 0.2, 0.2})};
  CollisionSceneBuilder builder{sceneConfig()};
  builder.update(world.surface(0.02), world, kBaseAtOrigin);
  world.boxes.pop_back();
  const Surface surface = world.surface(0.02);
  builder.update(surface, world, kBaseAtOrigin);
  CollisionSceneBuilder scratch{sceneConfig()};
  scratch.update(surface, world, kBaseAtOrigin);
  expectSameScene(*builder.scene(), *scratch.scene());
}

TEST(CollisionSceneBuilder, ShallowEdgesAreDisplacedByTheirMarginToo) {
  // A roof of two planes that slope by 15 degrees: along the mean normal the ridge would gain some 5 % less than a plane.
  constexpr double kSlope_rad = 15.0 * M_PI / 180.0;
  Surface roof;
  for (const double x : {-0.1, 0.0, 0.1}) {
    for (const double y : {-0.05, 0.05}) {
      roof.vertices_map.emplace_back(0.8 + x, y, 0.5 - std::abs(x) * std::tan(kSlope_rad));
      roof.normals_map.emplace_back(0.0F, 0.0F, 0.0F);  // the triangles' own
    }
  }
  roof.triangles = {{0, 2, 1}, {1, 2, 3}, {2, 4, 3}, {3, 4, 5}};
  BoxWorld world;
  CollisionSceneConfig config = sceneConfig();
  config.sigmas = 0.0;
  config.max_margin_m = config.margin_m;  // the map of nothing knows no sigma
  CollisionSceneBuilder builder{config};
  ASSERT_EQ(builder.update(roof, world, kBaseAtOrigin).triangles, 4u);
  const Eigen::Vector3d left(-std::sin(kSlope_rad), 0.0, std::cos(kSlope_rad));
  const Eigen::Vector3d right(std::sin(kSlope_rad), 0.0, std::cos(kSlope_rad));
  int num_ridge = 0;
  for (const auto& chunk : builder.scene()->chunks) {
    for (std::size_t v = 0; v < chunk->mapped().size(); ++v) {
      const Eigen::Vector3d moved = chunk->displaced()[v] - chunk->mapped()[v];
      const double x = chunk->mapped()[v].x() - 0.8;
      // Directions are kept to 1e-6 of the margin.
      if (x < 1e-6) {
        EXPECT_GE(left.dot(moved), 0.005 - 1e-8);
      }
      if (x > -1e-6) {
        EXPECT_GE(right.dot(moved), 0.005 - 1e-8);
      }
      if (std::abs(x) < 1e-6) ++num_ridge;
    }
  }
  EXPECT_GE(num_ridge, 2);
}

TEST(CollisionSceneBuilder, SurvivesDegenerateTrianglesAndCountsThem) {
  const BoxWorld world = bricksOnGround();
  const Surface good = world.surface(0.02);
  CollisionSceneBuilder reference{sceneConfig()};
  const SceneUpdate expected = reference.update(good, world, kBaseAtOrigin);
  EXPECT_EQ(expected.degenerate, 0u);
  Surface bad = good;
  const std::uint32_t first = static_cast<std::uint32_t>(bad.vertices_map.size());
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  bad.vertices_map.insert(bad.vertices_map.end(), {{kNaN, 0.0, 0.5}, {kInfinity, 0.0, 0.5}, {1e300, -1e300, 1e300}});
  bad.normals_map.insert(bad.normals_map.end(), 3, Eigen::Vector3f::UnitZ());
  bad.triangles.push_back({0, 1, first});      // NaN
  bad.triangles.push_back({0, first + 1, 1});  // infinite
  bad.triangles.push_back({0, 1, first + 2});  // so long that its area is not finite
  bad.triangles.push_back({0, 1, first + 3});  // no such vertex
  bad.triangles.push_back({0, 1, ~0u});        // nor this one
  bad.triangles.push_back({2, 2, 5});          // no area
  bad.triangles.push_back({7, 7, 7});          // a point
  CollisionSceneBuilder builder{sceneConfig()};
  const SceneUpdate update = builder.update(bad, world, kBaseAtOrigin);
  EXPECT_EQ(update.degenerate, 7u);
  EXPECT_EQ(update.triangles, expected.triangles);
  expectSameScene(*builder.scene(), *reference.scene());

  Surface doubled = good;
  doubled.triangles.insert(doubled.triangles.end(), good.triangles.begin(), good.triangles.end());
  for (Eigen::Vector3f& normal : doubled.normals_map) normal.setConstant(std::numeric_limits<float>::quiet_NaN());
  builder.update(doubled, world, kBaseAtOrigin);
  for (const auto& chunk : builder.scene()->chunks) {
    for (const Eigen::Vector3d& p : chunk->displaced()) {
      EXPECT_TRUE(p.allFinite());
    }
    for (std::size_t v = 0; v < chunk->mapped().size(); ++v) {
      const double moved_m = (chunk->displaced()[v] - chunk->mapped()[v]).norm();
      EXPECT_GE(moved_m, 0.009 - 1e-7);
      EXPECT_LE(moved_m, 2.0 * 0.009 + 1e-7);
    }
  }
}

TEST(CollisionSceneBuilder, CutsUpTrianglesThatAreLargerThanAChunk) {
  BoxWorld world;
  world.ground_z_m = 0.1;
  Surface surface;
  surface.vertices_map = {{-1e6, -1e6, 0.1}, {1e6, -1e6, 0.1}, {1e6, 1e6, 0.1}, {-1e6, 1e6, 0.1}};
  surface.normals_map.assign(4, Eigen::Vector3f::UnitZ());
  surface.triangles = {{0, 1, 2}, {0, 2, 3}};
  CollisionSceneBuilder builder{sceneConfig()};
  const SceneUpdate update = builder.update(surface, world, kBaseAtOrigin);
  EXPECT_EQ(update.degenerate, 0u);
  double area_m2 = 0.0;
  std::set<std::pair<std::array<double, 3>, std::array<double, 3>>> edges;
  for (const auto& chunk : builder.scene()->chunks) {
    for (const auto& triangle : chunk->triangles()) {
      std::array<std::array<double, 3>, 3> corner;
      for (std::size_t i = 0; i < 3; ++i) {
        const Eigen::Vector3d& p = chunk->displaced()[triangle[i]];
        EXPECT_NEAR(p.z(), 0.109, 1e-9);
        corner[i] = {p.x(), p.y(), p.z()};
      }
      const Eigen::Vector3d a = chunk->mapped()[triangle[0]];
      area_m2 += 0.5 * (chunk->mapped()[triangle[1]] - a).cross(chunk->mapped()[triangle[2]] - a).norm();
      for (std::size_t i = 0; i < 3; ++i) edges.insert({corner[i], corner[(i + 1) % 3]});
    }
  }
  const double radius_m = builder.config().region_radius_m;
  EXPECT_NEAR(area_m2, M_PI * radius_m * radius_m, 0.05 * area_m2);  // ragged by a piece of a chunk's size at the rim
  for (const auto& [from, to] : edges) {
    if (std::hypot(from[0], from[1]) > radius_m - 0.3)
      continue;  // but for the rim, no piece is missing and none is split alone
    EXPECT_EQ(edges.count({to, from}), 1u);
  }
}

TEST(CollisionSceneBuilder, AnEmptySurfaceIsAnEmptyScene) {
  const BoxWorld world = bricksOnGround();
  CollisionSceneBuilder builder{sceneConfig()};
  EXPECT_NE(builder.scene(), nullptr);
  EXPECT_TRUE(builder.scene()->chunks.empty());
  builder.update(world.surface(0.02), world, kBaseAtOrigin);
  const SceneUpdate update = builder.update(Surface(), world, kBaseAtOrigin);
  EXPECT_EQ(update.chunks, 0u);
  EXPECT_EQ(update.blocks_asked, 0u);
  EXPECT_TRUE(builder.scene()->chunks.empty());
  EXPECT_GT(builder.scene()->freeDistance({0.7, 0.0, 0.3}), 1e9);
}

TEST(CollisionSceneBuilder, LooksNoFartherThanTheRegionAndFollowsTheRobot) {
  BoxWorld world = bricksOnGround();
  world.boxes.push_back(uprightBox({3.0, 0.0, 0.1}, {0.3, 0.2, 0.2}));
  const Surface surface = world.surface(0.02);
  CollisionSceneBuilder builder{sceneConfig()};
  builder.update(surface, world, kBaseAtOrigin);
  for (const auto& chunk : builder.scene()->chunks) EXPECT_LT(chunk->bounds().max().x(), 2.0);
  const Eigen::Isometry3d moved(Eigen::Translation3d(2.4, 0.0, 0.0));
  builder.update(surface, world, moved);
  CollisionSceneBuilder scratch{sceneConfig()};
  scratch.update(surface, world, moved);
  expectSameScene(*builder.scene(), *scratch.scene());
  EXPECT_TRUE(std::any_of(builder.scene()->chunks.begin(), builder.scene()->chunks.end(),
                          [](const auto& chunk) { return chunk->bounds().max().x() > 3.0; }));
}

class CountingMap : public MapView {
 public:
  explicit CountingMap(const BoxWorld& world) : world_(world) {}
  MapAnswers query(const gpis_mapping::Points3d& points_map) const override {
    ++num_queries_;
    return world_.query(points_map);
  }
  int numQueries() const { return num_queries_; }

 private:
  const BoxWorld& world_;
  mutable int num_queries_{0};
};

TEST(CollisionSceneBuilder, TheRegionsBoxHoldsAllThatCounts) {
  CollisionSceneConfig config = sceneConfig();
  config.region_radius_m = 0.7;  // the bricks reach beyond
  BoxWorld world = bricksOnGround();
  for (const double roll_rad : {0.0, 0.03, 0.8}) {
    SCOPED_TRACE(roll_rad);
    Eigen::Isometry3d T_map_base{Eigen::Translation3d{0.2, -0.1, 0.0}};
    T_map_base.rotate(Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitZ()));
    T_map_base.rotate(Eigen::AngleAxisd(roll_rad, Eigen::Vector3d::UnitX()));
    const Surface all = world.surface(0.02);
    const Eigen::AlignedBox3d box_map = regionBox(T_map_base, config);
    Surface part = all;
    part.triangles.clear();
    for (const auto& triangle : all.triangles) {
      Eigen::AlignedBox3d box;
      for (const std::uint32_t v : triangle) box.extend(all.vertices_map[v]);
      if (box.intersects(box_map)) part.triangles.push_back(triangle);
    }
    EXPECT_LT(part.triangles.size(), all.triangles.size() * 0.9);
    CollisionSceneBuilder of_all(config), of_part(config);
    of_all.update(all, world, T_map_base);
    of_part.update(part, world, T_map_base);
    expectSameScene(*of_part.scene(), *of_all.scene());
  }
}

TEST(CollisionSceneBuilder, TwoInStepAskTheMapOnce) {
  BoxWorld world = bricksOnGround();
  CollisionSceneConfig wider = sceneConfig();
  wider.margin_m += 0.01;
  CollisionSceneBuilder builder{sceneConfig()}, wide_builder{wider}, scratch{wider};
  const CountingMap map(world);
  for (int mesh = 1; mesh <= 2; ++mesh) {
    const Surface surface = world.surface(0.02);
    const AskedOnceView view(map);
    const auto prepared = prepareSurface(surface, kBaseAtOrigin, builder.config());
    builder.update(prepared, view);
    wide_builder.update(prepared, view);
    EXPECT_EQ(map.numQueries(), mesh);
    scratch.update(surface, world, kBaseAtOrigin);
    expectSameScene(*wide_builder.scene(), *scratch.scene());
    world.boxes.pop_back();
  }
  for (double CollisionSceneConfig::*const other :
       {&CollisionSceneConfig::chunk_m, &CollisionSceneConfig::region_radius_m}) {
    CollisionSceneConfig config = sceneConfig();
    config.*other *= 0.9;
    const auto prepared = prepareSurface(world.surface(0.02), kBaseAtOrigin, config);
    EXPECT_THROW(builder.update(prepared, world), std::invalid_argument);
  }
}

TEST(AskedOnceView, AsksAgainForOtherPoints) {
  const BoxWorld world = bricksOnGround();
  const CountingMap map(world);
  const AskedOnceView view(map);
  gpis_mapping::Points3d points = 0.1 * gpis_mapping::Points3d::Random(3, 4);
  points.colwise() += Eigen::Vector3d{0.7, 0.0, 0.5};  // over the bricks, where every distance is known
  int expected = 0;
  const auto expectAsked = [&] {
    const MapAnswers answers = view.query(points);
    EXPECT_EQ(map.numQueries(), ++expected);
    EXPECT_EQ(answers.distance_m, world.query(points).distance_m);
    EXPECT_EQ(answers.state, world.query(points).state);
  };
  expectAsked();
  points(2, 3) += 0.1;
  expectAsked();
  points.conservativeResize(3, 3);
  expectAsked();
  view.query(points);
  EXPECT_EQ(map.numQueries(), expected);
}

class BrokenMap : public MapView {
 public:
  bool answers_too_little{false};
  MapAnswers query(const gpis_mapping::Points3d&) const override {
    if (answers_too_little) return {};
    throw std::runtime_error("no answer");
  }
};

TEST(CollisionSceneBuilder, KeepsTheLastSceneWhenTheMapDoesNotAnswer) {
  BoxWorld world = bricksOnGround();
  CollisionSceneBuilder builder{sceneConfig()};
  builder.update(world.surface(0.02), world, kBaseAtOrigin);
  const std::shared_ptr<const CollisionScene> before = builder.scene();
  world.boxes.pop_back();
  const Surface surface = world.surface(0.02);
  BrokenMap broken;
  EXPECT_THROW(builder.update(surface, broken, kBaseAtOrigin), std::runtime_error);
  broken.answers_too_little = true;
  EXPECT_THROW(builder.update(surface, broken, kBaseAtOrigin), std::runtime_error);
  EXPECT_EQ(builder.scene(), before);
  // and is none the worse for it
  builder.update(surface, world, kBaseAtOrigin);
  CollisionSceneBuilder scratch{sceneConfig()};
  scratch.update(surface, world, kBaseAtOrigin);
  expectSameScene(*builder.scene(), *scratch.scene());
}

TEST(CollisionSceneBuilder, RefusesBadArgumentsAndKeepsTheLastScene) {
  const BoxWorld world = bricksOnGround();
  CollisionSceneBuilder builder{sceneConfig()};
  Surface surface = world.surface(0.02);
  builder.update(surface, world, kBaseAtOrigin);
  const std::shared_ptr<const CollisionScene> before = builder.scene();
  Eigen::Isometry3d scaled = kBaseAtOrigin;
  scaled.linear() *= 1.1;
  EXPECT_THROW(builder.update(surface, world, scaled), std::invalid_argument);
  Eigen::Isometry3d nowhere = kBaseAtOrigin;
  nowhere.translation().z() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(builder.update(surface, world, nowhere), std::invalid_argument);
  surface.normals_map.pop_back();
  EXPECT_THROW(builder.update(surface, world, kBaseAtOrigin), std::invalid_argument);
  EXPECT_EQ(builder.scene(), before);
}

}  // namespace
}  // namespace motion_planning
