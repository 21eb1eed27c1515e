// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/pile_scene.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

#include "brick_types.h"
#include "simulated_world/box_separation.h"

namespace simulated_world {
namespace {

const std::string kHead = "brick_type: brick\nrobot_start: {xy_m: [-4.0, 0.0]}\n";

PileSceneConfig parse(const std::string& text) {
  return parsePileScene(text, "test.yaml", {plainBrick()}, kMaxBricks);
}

/// What the loader says about a text that it must refuse.
std::string refusalOf(const std::string& text) {
  try {
    parse(text);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "(accepted)";
}

std::string refusalOfBricks(const std::string& bricks) {
  return refusalOf(kHead + "bricks:\n" + bricks);
}

testing::AssertionResult says(const std::string& message, const std::string& part) {
  return message.find(part) != std::string::npos
             ? testing::AssertionSuccess()
             : testing::AssertionFailure() << "no \"" << part << "\" in: " << message;
}

/// Nearest of many points of a brick's outline, seen from above.
double distanceByPoints(const Eigen::Vector2d& xy_m, const BrickPlacement& brick) {
  double nearest = std::numeric_limits<double>::infinity();
  for (int i = 0; i <= 100; ++i) {
    for (int j = 0; j <= 100; ++j) {
      const Eigen::Vector3d p = Eigen::Vector3d(i / 100.0 - 0.5, j / 100.0 - 0.5, 0.0).cwiseProduct(brick.type.size_m);
      nearest = std::min(nearest, ((brick.T_map_brick * p).head<2>() - xy_m).norm());
    }
  }
  return nearest;
}

std::vector<std::string> shippedWorlds() {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(SIMULATED_WORLDS)) {
    if (entry.path().extension() == ".yaml") names.push_back(entry.path().stem().string());
  }
  return names;
}

TEST(ShippedWorlds, AreAllThere) {
  const std::vector<std::string> list = shippedWorlds();
  const std::set<std::string> names(list.begin(), list.end());
  for (const char* name : {"one_heap", "two_ridges", "three_heaps", "two_rows", "single_brick", "two_stacked",
                           "three_pyramid", "four_bricks", "wall"}) {
    EXPECT_EQ(names.count(name), 1U) << name;
  }
  EXPECT_EQ(generateScene(world("one_heap"), 1).bricks.size(), 20U);
  EXPECT_EQ(generateScene(world("two_ridges"), 1).bricks.size(), 30U);
  EXPECT_EQ(generateScene(world("three_heaps"), 1).bricks.size(), 40U);
  EXPECT_EQ(generateScene(world("two_rows"), 1).bricks.size(), 10U);
}

TEST(ShippedWorlds, StartWithoutOverlapsOnTheGroundAndFarFromTheRobotWithEverySeed) {
  for (const std::string& name : shippedWorlds()) {
    const PileSceneConfig config = world(name);
    for (std::uint64_t seed = 0; seed < 30; ++seed) {
      const PileScene scene = generateScene(config, seed);
      for (std::size_t i = 0; i < scene.bricks.size(); ++i) {
        const BrickPlacement& brick = scene.bricks[i];
        EXPECT_EQ(brick.id, static_cast<int>(i));
        EXPECT_GE(brick.T_map_brick.translation().z(),
                  0.0999999);  // lying: half a brick's height, and it has six decimals
        EXPECT_GE(distanceByPoints(scene.robot_start.xy_m, brick), 2.5) << name;
        for (std::size_t j = 0; j < i; ++j) {
          const BrickPlacement& other = scene.bricks[j];
          EXPECT_GE(boxSeparation(brick.T_map_brick, brick.type.size_m, other.T_map_brick, other.type.size_m), -1e-6)
              << name << ", seed " << seed << ": " << i << " and " << j;
        }
      }
    }
  }
}

TEST(GenerateScene, IsFixedByTheSeedAndOnlyByIt) {
  const PileSceneConfig config = world("one_heap");
  const PileScene a = generateScene(config, 3);
  const PileScene b = generateScene(config, 3);
  const PileScene c = generateScene(config, 4);
  ASSERT_EQ(a.bricks.size(), b.bricks.size());
  int num_moved = 0;
  for (std::size_t i = 0; i < a.bricks.size(); ++i) {
    EXPECT_EQ(a.bricks[i].T_map_brick.matrix(), b.bricks[i].T_map_brick.matrix());
    num_moved += a.bricks[i].T_map_brick.matrix() == c.bricks[i].T_map_brick.matrix() ? 0 : 1;
  }
  EXPECT_EQ(num_moved, 20);
}

TEST(GenerateScene, IdsDoNotFollowTheLayers) {
  // Among the three bricks on top are, over some seeds, low and high ids alike.
  double sum = 0.0;
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    const PileScene scene = generateScene(world("one_heap"), seed);
    const auto top = std::max_element(scene.bricks.begin(), scene.bricks.end(), [](const auto& a, const auto& b) {
      return a.T_map_brick.translation().z() < b.T_map_brick.translation().z();
    });
    sum += top->id;
  }
  EXPECT_NEAR(sum / 40.0, 9.5, 3.7);  // four standard deviations of the mean of 40 out of 0 ... 19
}

TEST(GenerateScene, JitterStaysInItsBounds) {
  PileSceneConfig config = world("two_stacked");
  config.bricks[1].T_map_brick.translation().z() = 0.31;
  config.position_jitter_m = 0.02;
  config.yaw_jitter_rad = 0.1;
  double largest_m = 0.0;
  double largest_rad = 0.0;
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    const PileScene scene = generateScene(config, seed);
    for (std::size_t i = 0; i < 2; ++i) {
      const Eigen::Isometry3d shift = config.bricks[i].T_map_brick.inverse() * scene.bricks[i].T_map_brick;
      const Eigen::Vector3d moved =
          scene.bricks[i].T_map_brick.translation() - config.bricks[i].T_map_brick.translation();
      EXPECT_EQ(moved.z(), 0.0);
      largest_m = std::max(largest_m, moved.cwiseAbs().maxCoeff());
      largest_rad = std::max(largest_rad, Eigen::AngleAxisd(shift.linear()).angle());
    }
  }
  EXPECT_LE(largest_m, 0.02);
  EXPECT_GT(largest_m, 0.019);
  EXPECT_LE(largest_rad, 0.1 + 1e-9);
  EXPECT_GT(largest_rad, 0.095);
}

TEST(GenerateScene, HeapsKeepTheirRectangleAndHaveAllLayers) {
  for (const char* name : {"one_heap", "two_ridges", "three_heaps"}) {
    const PileSceneConfig config = world(name);
    const PileScene scene = generateScene(config, 7);
    ASSERT_EQ(scene.heap_ids.size(), config.heaps.size());
    for (std::size_t h = 0; h < config.heaps.size(); ++h) {
      const HeapConfig& heap = config.heaps[h];
      EXPECT_EQ(scene.heap_ids[h].size(), static_cast<std::size_t>(heap.bricks));
      std::set<int> layers;
      for (const int id : scene.heap_ids[h]) {
        const BrickPlacement& brick = scene.bricks[static_cast<std::size_t>(id)];
        layers.insert(static_cast<int>(brick.T_map_brick.translation().z() / 0.21));
        for (const double x : {-0.15, 0.15}) {
          for (const double y : {-0.1, 0.1}) {
            const Eigen::Vector2d corner = (brick.T_map_brick * Eigen::Vector3d(x, y, 0.0)).head<2>() - heap.center_m;
            const Eigen::Vector2d in_heap = Eigen::Rotation2Dd(-heap.yaw_rad) * corner;
            EXPECT_LE((in_heap.cwiseAbs() - 0.5 * heap.extent_m).maxCoeff(), 1e-9) << name;
          }
        }
      }
      EXPECT_EQ(layers.size(), static_cast<std::size_t>(heap.layers)) << name;
    }
  }
}

TEST(ShippedWorlds, HaveTheSizesTheyAreNamedFor) {
  const auto sizeOf = [](const std::string& name) {
    Eigen::Vector2d low_m = Eigen::Vector2d::Constant(100.0);
    Eigen::Vector2d high_m = -low_m;
    for (const BrickPlacement& brick : generateScene(world(name), 1).bricks) {
      const Eigen::Vector3d reach_m = 0.5 * brick.T_map_brick.linear().cwiseAbs() * brick.type.size_m;
      low_m = low_m.cwiseMin((brick.T_map_brick.translation() - reach_m).head<2>());
      high_m = high_m.cwiseMax((brick.T_map_brick.translation() + reach_m).head<2>());
    }
    return Eigen::Vector2d(high_m - low_m);
  };
  EXPECT_NEAR(sizeOf("one_heap").x(), 1.2, 0.25);  // a brick more or less on one side
  EXPECT_NEAR(sizeOf("one_heap").y(), 1.2, 0.25);
  EXPECT_NEAR(sizeOf("two_ridges").x(), 1.2, 0.15);
  EXPECT_NEAR(sizeOf("two_ridges").y(), 2.4, 0.15);
  // The valley: nothing in the middle, over all its length.
  for (const BrickPlacement& brick : generateScene(world("two_ridges"), 1).bricks) {
    EXPECT_GT(std::abs(brick.T_map_brick.translation().x()), 0.15 + 0.2);
  }
}

TEST(PileSceneLoader, ReadsWhatIsWritten) {
  const PileSceneConfig config = parse(
      "brick_type: brick\n"
      "robot_start: {xy_m: [-5.0, 1.0], yaw_rad: 0.4}\n"
      "max_shift_m: 0.3\n"
      "has_tags: false\n"
      "bricks:\n"
      "  - {id: 4, xyz_m: [0.1, 0.2, 0.1], yaw_rad: 0.3}\n"
      "  - {id: 7, xyz_m: [1.0, 0.2, 0.15], rpy_rad: [0.0, 1.5707963267948966, 0.0], type: brick}\n");
  EXPECT_EQ(config.name, "test");
  EXPECT_EQ(config.robot_start.xy_m, Eigen::Vector2d(-5.0, 1.0));
  EXPECT_EQ(config.robot_start.yaw_rad, 0.4);
  EXPECT_EQ(config.max_shift_m, 0.3);
  EXPECT_FALSE(config.has_tags);
  EXPECT_FALSE(generateScene(config, 0).has_tags);
  ASSERT_EQ(config.bricks.size(), 2U);
  EXPECT_EQ(config.bricks[1].id, 7);
  EXPECT_EQ(config.bricks[1].type.mass_kg, 1.0);
  EXPECT_TRUE(config.bricks[1].T_map_brick.linear().col(0).isApprox(-Eigen::Vector3d::UnitZ(), 1e-12));
}

TEST(PileSceneLoader, RefusesWhatCannotBe) {
  const std::string brick = "  - {id: 0, xyz_m: [0, 0, 0.1]}\n";
  EXPECT_EQ(refusalOfBricks(brick), "(accepted)");
  EXPECT_TRUE(says(refusalOf(kHead), "heaps = 0, must be given"));
  EXPECT_TRUE(says(refusalOf(kHead + "bricks: []\n"), "must be given"));
  EXPECT_TRUE(says(refusalOfBricks(brick + "  - {id: 1, xyz_m: [0.1, 0, 0.1]}\n"), "overlap by 0.2 m"));
  EXPECT_EQ(refusalOfBricks(brick + "  - {id: 1, xyz_m: [0.3, 0, 0.1]}\n"), "(accepted)");  // touching
  EXPECT_TRUE(says(refusalOfBricks("  - {id: 0, xyz_m: [0, 0, 0.09]}\n"), "reaches into the ground"));
  EXPECT_TRUE(says(refusalOfBricks(brick + "  - {id: 0, xyz_m: [1, 0, 0.1]}\n"), "unique"));
  EXPECT_TRUE(says(refusalOfBricks("  - {id: 97, xyz_m: [0, 0, 0.1]}\n"), "id 97, must be less than 97"));
  EXPECT_TRUE(says(refusalOfBricks("  - {id: 0, xyz_m: [-1.4, 0, 0.1]}\n"), "is 2.45 m from a brick"));
  EXPECT_EQ(refusalOfBricks("  - {id: 0, xyz_m: [-1.35, 0, 0.1]}\n"), "(accepted)");
  EXPECT_TRUE(says(refusalOfBricks("  - {id: 0, xyz_m: [0, 0, 0.1], type: cube}\n"), "one of: brick"));
  EXPECT_TRUE(says(refusalOfBricks("  - {id: 0, xyz_m: [0, 0, 0.1], size_m: [1, 1, -1]}\n"), "size_m is unknown"));
  EXPECT_TRUE(says(refusalOf(kHead + "heaps:\n  - {center_m: [0, 0], extent_m: [2, -1], bricks: 3, layers: 1}\n"),
                   "heaps[0]/extent_m"));
  EXPECT_TRUE(says(refusalOf(kHead + "heaps:\n  - {center_m: [0, 0], extent_m: [1, 1], bricks: 0, layers: 1}\n"),
                   "heaps[0]/bricks"));
  EXPECT_TRUE(says(refusalOf(kHead + "heaps:\n  - {center_m: [0, 0], extent_m: [1, 1], bricks: 40, layers: 2}\n"),
                   "40 bricks, must fit into 2 layers"));
  EXPECT_TRUE(says(refusalOf(kHead + "heaps:\n  - {center_m: [0, 0], extent_m: [9, 9], bricks: 98, layers: 1}\n"),
                   "98 bricks, must be at most 97"));
  EXPECT_TRUE(says(refusalOf(kHead + "heaps:\n  - {center_m: [0, 0], extent_m: [2.4, 1], bricks: 9, layers: 2}\n"),
                   "must span 70 % of"));
  EXPECT_TRUE(says(refusalOf(kHead + "heaps:\n  - {center_m: [0, 0]}\n"), "heaps[0]/layers"));
  EXPECT_TRUE(says(refusalOf(kHead + "bricks:\n" + brick +
                             "heaps:\n  - {center_m: [2, 0], extent_m: [1, 1], bricks: 3, layers: 1}\n"),
                   "not both"));
  EXPECT_TRUE(says(refusalOf("bricks:\n" + brick), "robot_start"));
  EXPECT_TRUE(says(refusalOf(kHead + "gravity: 3\nbricks:\n" + brick), "gravity is unknown"));
  EXPECT_TRUE(says(refusalOf(kHead + "drop_gap_m: wide\nbricks:\n" + brick), "drop_gap_m = wide"));
  EXPECT_TRUE(says(refusalOf("[1, 2"), "test.yaml"));
  EXPECT_TRUE(says(refusalOf("[1, 2]"), "is no map"));
}

TEST(PileSceneLoader, ListsAllProblemsInOneMessage) {
  const std::string message = refusalOf("robot_start: {xy_m: [0.0], heading: 1}\nyaw_jitter_rad: 7\nbricks: 3\n");
  for (const char* part : {"brick_type", "robot_start/xy_m", "robot_start/heading", "yaw_jitter_rad", "bricks"}) {
    EXPECT_TRUE(says(message, part));
  }
}

TEST(PileSceneLoader, RefusesTypesThatCannotBe) {
  BrickType flat = plainBrick();
  flat.size_m.z() = -0.2;
  const std::string text = kHead + "bricks:\n  - {id: 0, xyz_m: [0, 0, 0.1]}\n";
  EXPECT_THROW(parsePileScene(text, "test.yaml", {flat}, kMaxBricks), std::invalid_argument);
  EXPECT_THROW(parsePileScene(text, "test.yaml", {}, kMaxBricks), std::invalid_argument);
  EXPECT_THROW(loadPileScene("/nonexistent.yaml", {plainBrick()}, kMaxBricks), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
