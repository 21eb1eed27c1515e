// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/settle.h"

#include <algorithm>
#include <ctime>
#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

#include "brick_types.h"

namespace simulated_world {
namespace {

using test_support::messageOf;
using ::testing::AllOf;
using ::testing::HasSubstr;

struct Motion {
  double distance_m{0.0};
  double angle_rad{0.0};
};

/// Farthest that any brick has gone.
Motion motionBetween(const std::vector<BrickPlacement>& before, const std::vector<BrickPlacement>& now) {
  Motion most;
  for (std::size_t i = 0; i < before.size(); ++i) {
    const Eigen::Isometry3d shift = before[i].T_map_brick.inverse() * now[i].T_map_brick;
    most.distance_m = std::max(most.distance_m, shift.translation().norm());
    most.angle_rad = std::max(most.angle_rad, Eigen::AngleAxisd(shift.linear()).angle());
  }
  return most;
}

double highestOf(const std::vector<BrickPlacement>& bricks) {
  double highest_m = 0.0;
  for (const BrickPlacement& brick : bricks) highest_m = std::max(highest_m, brick.T_map_brick.translation().z());
  return highest_m;
}

TEST(SettlePile, FortyBricksStayStillForAMinute) {
  const SettledPile pile = settlePile(world("three_heaps"), 1);
  ASSERT_EQ(pile.scene.bricks.size(), 40U);
  BrickPhysics physics(pile.scene.bricks, PhysicsOptions());
  const std::clock_t begin = std::clock();
  physics.run(60.0);
  const double seconds = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
  RecordProperty("simulated_over_cpu_time", static_cast<int>(60.0 / seconds));
  const Motion drift = motionBetween(pile.scene.bricks, physics.bricks());
  EXPECT_LT(drift.distance_m, 0.001);
  EXPECT_LT(drift.angle_rad, 0.5 * 3.1416 / 180.0);
}

TEST(SettlePile, EveryShippedWorldSettlesWithSeveralSeeds) {
  for (const char* name :
       {"one_heap", "two_ridges", "two_rows", "single_brick", "two_stacked", "three_pyramid", "four_bricks", "wall"}) {
    const PileSceneConfig config = world(name);
    for (std::uint64_t seed = 1; seed <= 3; ++seed) {
      const SettledPile pile = settlePile(config, seed);
      EXPECT_EQ(pile.attempts, 1) << name;  // the shipped worlds are made to stand
      EXPECT_LT(pile.settle_time_s, 5.0) << name;
      for (const BrickPlacement& brick : pile.scene.bricks) {
        EXPECT_GT(brick.T_map_brick.translation().z(), 0.099) << name;  // not in the ground, whatever side is down
      }
    }
  }
}

TEST(SettlePile, HeapsHaveTheHeightOfTheirLayers) {
  // Layers of 0.2 m; contacts give way by less than a millimetre.
  EXPECT_NEAR(highestOf(settlePile(world("one_heap"), 2).scene.bricks), 0.5, 0.003);
  EXPECT_NEAR(highestOf(settlePile(world("two_ridges"), 2).scene.bricks), 0.5, 0.003);
  EXPECT_NEAR(highestOf(settlePile(world("wall"), 2).scene.bricks), 0.5, 0.003);
  EXPECT_NEAR(highestOf(settlePile(world("two_rows"), 2).scene.bricks), 0.3, 0.003);
}

TEST(SettlePile, TheSameSeedGivesTheSameBits) {
  const SettledPile a = settlePile(world("one_heap"), 5);
  const SettledPile b = settlePile(world("one_heap"), 5);
  const SettledPile c = settlePile(world("one_heap"), 6);
  EXPECT_EQ(a.settle_time_s, b.settle_time_s);
  for (std::size_t i = 0; i < a.scene.bricks.size(); ++i) {
    EXPECT_EQ(a.scene.bricks[i].T_map_brick.matrix(), b.scene.bricks[i].T_map_brick.matrix());
  }
  EXPECT_GT(motionBetween(a.scene.bricks, c.scene.bricks).distance_m, 0.001);
}

TEST(BrickPhysics, ABrickTakenFromBelowBringsDownWhatItCarried) {
  std::vector<BrickPlacement> bricks = settlePile(world("three_pyramid"), 1).scene.bricks;
  bricks.erase(bricks.begin());  // one of the two that carry the third
  BrickPhysics physics(bricks, PhysicsOptions());
  physics.run(3.0);
  const std::vector<BrickPlacement> after = physics.bricks();
  EXPECT_GT(motionBetween({bricks[1]}, {after[1]}).distance_m, 0.1);
  EXPECT_LT(after[1].T_map_brick.translation().z(), 0.25);
}

TEST(BrickPhysics, ABrickTakenFromTheTopLeavesTheOthersWhereTheyAre) {
  std::vector<BrickPlacement> bricks = settlePile(world("one_heap"), 1).scene.bricks;
  bricks.erase(std::max_element(bricks.begin(), bricks.end(), [](const auto& a, const auto& b) {
    return a.T_map_brick.translation().z() < b.T_map_brick.translation().z();
  }));
  BrickPhysics physics(bricks, PhysicsOptions());
  physics.run(3.0);
  EXPECT_LT(motionBetween(bricks, physics.bricks()).distance_m, 0.001);
}

TEST(BrickPhysics, FrictionHoldsAgainstAPushUpToItsLimit) {
  for (const double push : {0.9, 1.1}) {  // times mu m g
    BrickPlacement brick = brickAt(0, {0.0, 0.0, 0.1});
    std::string mjcf = "<mujoco>" + physicsXml(PhysicsOptions()) + "<worldbody>" + groundXml(PhysicsOptions()) +
                       brickXml(brick, PhysicsOptions()) + "</worldbody></mujoco>";
    const ModelPtr model = compileModel(mjcf);
    const DataPtr data = makeData(*model);
    const int body = requireId(*model, mjOBJ_BODY, "brick_0");
    for (int i = 0; i < 500; ++i) {  // 1 s
      data->xfrc_applied[6 * body] = push * 0.6 * 9.81;
      mj_step(model.get(), data.get());
    }
    const double x_m = bodyPose(*data, body).translation().x();
    if (push < 1.0) {
      EXPECT_LT(x_m, 0.002);
    } else {
      // 0.1 mu g t^2 / 2 = 0.294 m, less what the soft contact holds back.
      EXPECT_NEAR(x_m, 0.294, 0.05);
    }
  }
}

TEST(BrickPhysics, AFullBufferIsAnError) {
  PhysicsOptions options;
  options.max_contacts = 8;
  BrickPhysics physics(generateScene(world("wall"), 1).bricks, options);
  EXPECT_THROW(physics.run(0.1), std::runtime_error);
}

TEST(FaultsOfSettled, NamesBricksThatRolledAway) {
  const PileScene scene = generateScene(world("two_stacked"), 1);
  std::vector<BrickPlacement> settled = scene.bricks;
  EXPECT_TRUE(faultsOfSettled(scene, settled, 0.05).empty());
  settled[1].T_map_brick.translation().x() += 0.14;
  EXPECT_TRUE(faultsOfSettled(scene, settled, 0.05).empty());
  settled[1].T_map_brick.translation().x() += 0.02;
  const std::vector<std::string> faults = faultsOfSettled(scene, settled, 0.05);
  ASSERT_EQ(faults.size(), 1U);
  EXPECT_EQ(faults[0].find("brick 1 rolled 0.16 m"), 0U) << faults[0];
}

TEST(FaultsOfSettled, NamesHeapsThatSpreadOrLostALayer) {
  PileSceneConfig config = world("one_heap");
  config.max_shift_m = 10.0;
  const PileScene scene = generateScene(config, 1);
  std::vector<BrickPlacement> settled = scene.bricks;
  EXPECT_TRUE(faultsOfSettled(scene, settled, 0.0).empty());
  settled[3].T_map_brick.translation().x() = 0.6;  // reaches to 0.7 m at least, with the rectangle ending at 0.65 m
  EXPECT_EQ(faultsOfSettled(scene, settled, 0.0).size(), 1U);
  settled = scene.bricks;
  for (BrickPlacement& brick : settled) {
    double& z_m = brick.T_map_brick.translation().z();
    z_m = std::min(z_m, 0.32);
  }
  const std::vector<std::string> faults = faultsOfSettled(scene, settled, 0.0);
  ASSERT_EQ(faults.size(), 1U);
  EXPECT_NE(faults[0].find("3 layers"), std::string::npos) << faults[0];
}

TEST(SettlePile, RefusesAPileThatCannotStandWithTheReasonOfEachAttempt) {
  PileSceneConfig config = world("single_brick");
  config.name = "on_edge";
  // Leaning far over its lower edge: it falls on its side, its middle going a way to the side.
  config.bricks[0].T_map_brick.linear() = Eigen::AngleAxisd(1.1, Eigen::Vector3d::UnitY()).toRotationMatrix();
  config.bricks[0].T_map_brick.translation().z() = 0.5;
  config.position_jitter_m = 0.01;
  config.max_shift_m = 0.001;
  SettleConfig settle;
  settle.max_attempts = 3;
  EXPECT_THAT(messageOf<std::runtime_error>([&] { settlePile(config, 1, settle); }),
              AllOf(HasSubstr("scene on_edge, seed 1"), HasSubstr("attempt 0: brick 0 rolled"),
                    HasSubstr("attempt 1: "), HasSubstr("attempt 2: ")));
  settle.max_time_s = 0.2;
  settle.rest_time_s = 0.1;
  settle.max_attempts = 1;
  EXPECT_THAT(messageOf<std::runtime_error>([&] { settlePile(config, 1, settle); }),
              HasSubstr("not at rest after 0.2"));
}

TEST(SettlePile, ALaterAttemptIsRecordedWithItsSeed) {
  // A brick stands beside the edge of another's top: by the jitter's luck it stays or falls.
  PileSceneConfig config = world("two_stacked");
  config.bricks[1].T_map_brick.translation() = Eigen::Vector3d(0.148, 0.0, 0.31);
  config.bricks[1].T_map_brick.linear().setIdentity();
  config.position_jitter_m = 0.02;
  config.max_shift_m = 0.05;
  SettleConfig settle;
  settle.max_attempts = 20;
  int num_retried = 0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const SettledPile pile = settlePile(config, seed, settle);
    EXPECT_EQ(pile.scene.seed, seedOfAttempt(seed, pile.attempts - 1));
    EXPECT_EQ(pile.refusals.empty(), pile.attempts == 1);
    num_retried += pile.attempts > 1 ? 1 : 0;
  }
  EXPECT_GT(num_retried, 0);
  EXPECT_LT(num_retried, 6);
}

TEST(PhysicsOptions, RefusesWhatCannotBe) {
  PhysicsOptions options;
  EXPECT_TRUE(options.validate().empty());
  options.contact_time_constant_s = 0.003;  // less than two steps
  options.impratio = 0.5;
  EXPECT_EQ(options.validate().size(), 2U);
  EXPECT_THROW(physicsXml(options), std::invalid_argument);
  SettleConfig settle;
  EXPECT_TRUE(settle.validate().empty());
  settle.max_time_s = 0.5;
  settle.max_attempts = 0;
  EXPECT_EQ(settle.validate().size(), 2U);
  EXPECT_THROW(settlePile(world("single_brick"), 1, settle), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
