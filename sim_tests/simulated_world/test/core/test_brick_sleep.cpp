// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/brick_sleep.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <stdexcept>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "brick_types.h"
#include "simulated_world/settle.h"
#include "simulated_world/world_observation.h"

namespace simulated_world {
namespace {

/// Settled bricks with a free ball, a plate on a slide that a test may move, and a weld from the plate to brick 0.
class SleepyWorld {
 public:
  SleepyWorld(const std::vector<BrickPlacement>& bricks, bool can_sleep, const BrickSleepConfig& config = {})
      : can_sleep_(can_sleep) {
    const PhysicsOptions options;
    std::string mjcf = "<mujoco>" + physicsXml(options) + "<worldbody>" + groundXml(options);
    for (const BrickPlacement& brick : bricks) mjcf += brickXml(brick, options);
    mjcf +=
        "<body name='ball' pos='5 5 0.1'><freejoint/><geom type='sphere' size='0.1' mass='2'/></body>"
        "<body name='plate' pos='0 0 3'><joint name='lift' type='slide' axis='0 0 1' damping='10'/>"
        "<geom type='box' size='0.05 0.05 0.01' mass='1' pos='4 0 0'/></body></worldbody>"
        "<equality><weld name='magnet' body1='plate' body2='brick_0' active='false'/></equality>"
        "<actuator><position name='lift' joint='lift' kp='2000'/></actuator></mujoco>";
    model = compileModel(mjcf);
    data = makeData(*model);
    for (const BrickPlacement& brick : bricks) ids_.push_back(brick.id);
    sleep = std::make_unique<BrickSleep>(*model, ids_, config);
    mj_forward(model.get(), data.get());
  }

  void run(double duration_s) {
    for (int i = 0; i < static_cast<int>(duration_s / 0.002 + 0.5); ++i) {
      mj_step(model.get(), data.get());
      if (can_sleep_) sleep->update(*model, *data);
    }
    mj_kinematics(model.get(), data.get());
  }

  mjtNum* qposOf(const std::string& body) {
    return data->qpos + model->jnt_qposadr[model->body_jntadr[requireId(*model, mjOBJ_BODY, body)]];
  }

  void throwBall(const Eigen::Vector3d& from_m, const Eigen::Vector3d& velocity_m_per_s) {
    const int body = requireId(*model, mjOBJ_BODY, "ball");
    std::copy_n(from_m.data(), 3, qposOf("ball"));
    std::copy_n(velocity_m_per_s.data(), 3, data->qvel + model->body_dofadr[body]);
  }

  Eigen::Vector3d position(int id) const {
    return bodyPose(*data, requireId(*model, mjOBJ_BODY, brickBodyName(id))).translation();
  }

  std::ptrdiff_t numAsleep() const {
    return std::count_if(ids_.begin(), ids_.end(), [this](int id) { return sleep->isAsleep(id); });
  }

  std::vector<double> state() const { return {data->qpos, data->qpos + model->nq}; }

  ModelPtr model;
  DataPtr data;
  std::unique_ptr<BrickSleep> sleep;

 private:
  std::vector<int> ids_;
  bool can_sleep_;
};

std::vector<BrickPlacement> settled(const std::string& name) {
  return settlePile(world(name), 1).scene.bricks;
}

TEST(BrickSleep, APileFallsAsleepAndThenDoesNotMoveAtAll) {
  SleepyWorld world(settled("one_heap"), true);
  world.run(0.4);
  EXPECT_EQ(world.numAsleep(), 0);
  world.run(0.2);
  EXPECT_EQ(world.numAsleep(), 20);
  const std::vector<double> before = world.state();
  world.run(20.0);
  EXPECT_EQ(world.numAsleep(), 20);
  const std::vector<double> after = world.state();
  const auto num_bricks = static_cast<std::ptrdiff_t>(7 * 20);
  EXPECT_TRUE(std::equal(before.begin(), before.begin() + num_bricks, after.begin()));
}

TEST(BrickSleep, MakesALargePileCheap) {
  SleepyWorld world(settled("three_heaps"), true);
  world.run(1.0);
  ASSERT_EQ(world.numAsleep(), 40);
  const std::clock_t begin = std::clock();
  world.run(10.0);
  const double seconds = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
  RecordProperty("simulated_over_cpu_time", static_cast<int>(10.0 / seconds));
  EXPECT_GT(10.0 / seconds, 12.0);  // measured: 40 and more on a busy machine, 6 for a pile awake
}

TEST(BrickSleep, WakingAndSleepingAgainMovesNothing) {
  const std::vector<BrickPlacement> bricks = settled("one_heap");
  SleepyWorld world(bricks, true);
  for (int repeat = 0; repeat < 20; ++repeat) {
    world.run(0.7);
    ASSERT_EQ(world.numAsleep(), 20);
    for (const BrickPlacement& brick : bricks) world.sleep->wake(*world.model, *world.data, brick.id);
    ASSERT_EQ(world.numAsleep(), 0);
  }
  for (const BrickPlacement& brick : bricks) {
    // As for a pile that is awake all the time: see SettlePile.FortyBricksStayStillForAMinute.
    EXPECT_LT((world.position(brick.id) - brick.T_map_brick.translation()).norm(), 0.001);
  }
}

TEST(BrickSleep, AThrownBallDoesToASleepingPileWhatItDoesToOneAwake) {
  const std::vector<BrickPlacement> bricks = settled("two_stacked");
  std::vector<Eigen::Vector3d> ends;
  for (const bool can_sleep : {false, true}) {
    SleepyWorld world(bricks, can_sleep);
    world.run(1.0);
    EXPECT_EQ(world.numAsleep(), can_sleep ? 2 : 0);
    world.throwBall({-0.5, 0.0, 0.3}, {4.0, 0.0, 0.5});
    world.run(3.0);
    ends.push_back(world.position(1));
    EXPECT_GT((ends.back() - bricks[1].T_map_brick.translation()).norm(), 0.15);  // knocked off
  }
  // The blow's first step acts on bricks without friction, and contacts amplify: the same fall, not the same bits.
  EXPECT_LT((ends[0] - ends[1]).norm(), 0.1);
}

TEST(BrickSleep, OnlyTheGroupThatIsTouchedWakes) {
  std::vector<BrickPlacement> bricks{brickAt(0, {0.0, 0.0, 0.1}), brickAt(1, {0.0, 0.0, 0.3}),
                                     brickAt(2, {2.0, 0.0, 0.1})};
  SleepyWorld world(bricks, true);
  world.run(1.0);
  ASSERT_EQ(world.numAsleep(), 3);
  world.throwBall({-0.5, 0.0, 0.3}, {1.0, 0.0, 1.0});  // at brick 1
  bool has_woken = false;
  for (int i = 0; i < 500 && !has_woken; ++i) {
    world.run(0.002);
    has_woken = !world.sleep->isAsleep(1);
  }
  EXPECT_TRUE(has_woken);
  EXPECT_FALSE(world.sleep->isAsleep(0));  // carries brick 1
  EXPECT_TRUE(world.sleep->isAsleep(2));
}

TEST(BrickSleep, ATouchWakesHoweverLittleItMoves) {
  BrickSleepConfig config;
  config.moved_m = 1.0;  // nothing moves that far in a step
  SleepyWorld world({brickAt(0, {0.0, 0.0, 0.1})}, true, config);
  world.run(1.0);
  ASSERT_TRUE(world.sleep->isAsleep(0));
  world.throwBall({0.0, 0.0, 0.302}, {0.0, 0.0, 0.0});
  world.run(0.1);
  EXPECT_FALSE(world.sleep->isAsleep(0));
}

TEST(BrickSleep, TakingTheLowerBrickAwayBringsTheUpperOneDown) {
  const std::vector<BrickPlacement> bricks = settled("three_pyramid");
  SleepyWorld world(bricks, true);
  world.run(1.0);
  ASSERT_EQ(world.numAsleep(), 3);
  world.qposOf("brick_0")[0] = 20.0;  // nobody told the sleepers
  world.run(3.0);
  EXPECT_LT(world.position(2).z(), 0.25);
  EXPECT_NEAR(world.position(0).x(), 20.0, 0.01);
}

TEST(BrickSleep, TheMagnetWakesWhatItHoldsAndWhatItHoldsNeverSleeps) {
  BrickSleepConfig config;
  config.moved_m = 1.0;  // the hold alone, not what it does
  SleepyWorld world(settled("two_stacked"), true, config);
  world.run(1.0);
  ASSERT_EQ(world.numAsleep(), 2);
#if mjVERSION_HEADER >= 300
  world.data->eq_active[0] = 1;
#else
  world.model->eq_active[0] = 1;
#endif
  world.run(1.0);
  EXPECT_EQ(world.numAsleep(), 0);  // it holds the lower one, still at rest
  world.data->ctrl[0] = 0.3;
  world.run(3.0);
  EXPECT_GT(world.position(0).z(), 0.3);
  EXPECT_FALSE(world.sleep->isAsleep(0));  // at rest in mid-air
}

TEST(BrickSleep, ABrickInTheAirDoesNotSleepEvenIfItIsSlow) {
  SleepyWorld world({brickAt(0, {0.0, 0.0, 3.0})}, true);
  world.model->opt.gravity[2] = 0.0;
  world.run(2.0);
  EXPECT_FALSE(world.sleep->isAsleep(0));
}

TEST(BrickSleep, ABrickThatSomethingRestsAgainstStaysAwake) {
  SleepyWorld world({brickAt(0, {0.0, 0.0, 0.1})}, true);
  world.throwBall({0.0, 0.0, 0.301}, {0.0, 0.0, 0.0});  // lies on the brick
  world.run(3.0);
  EXPECT_FALSE(world.sleep->isAsleep(0));
}

TEST(BrickSleep, APushWakesAndIsNotLost) {
  SleepyWorld world({brickAt(0, {0.0, 0.0, 0.1})}, true);
  world.run(1.0);
  ASSERT_TRUE(world.sleep->isAsleep(0));
  const int body = requireId(*world.model, mjOBJ_BODY, "brick_0");
  world.data->xfrc_applied[6 * body] = 20.0;
  world.data->xfrc_applied[6 * body + 2] = 0.0;
  world.run(0.2);
  EXPECT_FALSE(world.sleep->isAsleep(0));
  // (20 N - 0.6 * 9.81 N) / 1 kg for 0.2 s: 0.28 m; the soft contact holds back some of it.
  EXPECT_NEAR(world.position(0).x(), 0.28, 0.06);
}

TEST(BrickSleep, RefusesAWorldInWhichItCannotWork) {
  const PhysicsOptions options;
  const std::string brick = brickXml(brickAt(0, {0.0, 0.0, 0.1}), options);
  const ModelPtr good = compileModel("<mujoco><worldbody>" + groundXml(options) + brick + "</worldbody></mujoco>");
  EXPECT_NO_THROW(BrickSleep(*good, {0}));
  EXPECT_THROW(BrickSleep(*good, {1}), std::invalid_argument);
  BrickSleepConfig config;
  config.rest_time_s = 0.0;
  EXPECT_THROW(BrickSleep(*good, {0}, config), std::invalid_argument);
  const ModelPtr bad = compileModel("<mujoco><worldbody><geom name='ground' type='plane' size='0 0 1'/>" + brick +
                                    "</worldbody></mujoco>");
  EXPECT_THROW(BrickSleep(*bad, {0}), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
