// SPDX-License-Identifier: BSD-3-Clause
// Each stage of a plan by itself, with one brick before the robot.
#include <cmath>
#include <random>
#include <variant>

#include <gmock/gmock.h>

#include "support/pick_world.h"
#include "tasks/brick_in_scene.h"
#include "tasks/failures.h"
#include "tasks/free_motion.h"
#include "tasks/goal_generator.h"
#include "tasks/pick_stages.h"
#include "tasks/start_state.h"
#include "tasks/straight_line.h"

namespace motion_planning {
namespace {

using mp700_ur5e_description::BrickFace;
using ::testing::HasSubstr;
using ::testing::SizeIs;
using ::testing::StartsWith;

const Eigen::Vector3d kMiddle(0.85, 0.1, 0.1);  // of the brick, in base_link
constexpr double kYaw_rad = 0.3;
const Eigen::Vector3d kAside(-std::sin(kYaw_rad), std::cos(kYaw_rad), 0.0);  // along its y axis

class Stages : public ::testing::Test {
 protected:
  void SetUp() override {
    pick.add(kMiddle, kYaw_rad);
    refresh();
  }
  /// After a change of `pick`.
  void refresh() {
    pick.makeScene();
    request.scene = pick.scene;
  }
  void addBox(const Eigen::Vector3d& p_base, const Eigen::Vector3d& size_m) {
    pick.world.boxes.push_back({pick.T_map_base * Eigen::Translation3d(p_base), size_m});
    refresh();
  }
  /// The tip looks down.
  static Eigen::Isometry3d downAt(const Eigen::Vector3d& p_base) {
    return Eigen::Translation3d(p_base) * Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX());
  }
  ArmVector postureAt(const Eigen::Isometry3d& T_base_tip) const {
    return arm->inverse(T_base_tip, pick.start_rad).at(0);
  }
  CollisionChecker checker() const { return {arm, request.scene, request.T_map_base, config.collision}; }
  BrickInScene brickInScene() const { return {checker(), pick.world.boxes[0], config.pick.lift_room_m}; }
  /// The best posture at the middle of the top, and its grip.
  std::pair<Grip, ArmVector> onTop() const {
    const PickTarget target = pick.target(0);
    const auto grips = gripsAt(task, target, facePose(task, target, BrickFace::kPlusZ), {Eigen::Vector3d::Zero()});
    const ContactPosture best = contactPostures(task, grips, 0).at(0);
    return {grips[best.grip], best.joints_rad};
  }

  PickWorld pick = emptyPickWorld();
  std::shared_ptr<const ArmKinematics> arm = shippedArm();
  ManipulabilitySectors sectors = testSectors();
  MotionPlannerConfig config;
  PlanningContext request = pick.context();
  TaskContext task{arm, sectors, config, request};
};

TEST_F(Stages, StraightLineKeepsItsBranchAndSpeed) {
  const Eigen::Isometry3d T_from = downAt({0.85, 0.1, 0.5});
  const JointPath line = followLine(task, postureAt(T_from), T_from, {0.0, 0.0, -0.2});
  ASSERT_THAT(line, SizeIs(numSteps(config, 0.2) + 1));
  for (std::size_t k = 0; k < line.size(); ++k) {
    const Eigen::Vector3d p_base(0.85, 0.1, 0.5 - 0.2 * static_cast<double>(k) / static_cast<double>(line.size() - 1));
    EXPECT_LT((arm->tipPose(line[k]).translation() - p_base).norm(), 1e-5) << k;  // ten times that of kinematics
  }
  const JointTrajectory timed = timedLine(task, line, 0.1);
  EXPECT_GE(timed.duration(), 0.2 / 0.1);
  JointTrajectory whole = timed;
  append(timedLine(task, {line.rbegin(), line.rend()}, 0.1), &whole);
  EXPECT_EQ(whole.points.back().position_rad, line.front());
  for (std::size_t i = 1; i < whole.points.size(); ++i) EXPECT_GT(whole.points[i].time_s, whole.points[i - 1].time_s);
}

TEST_F(Stages, StraightLineEndsWhereTheArmDoes) {
  const Eigen::Isometry3d T_from = downAt({0.85, 0.1, 0.5});
  const JointPath line = followLine(task, postureAt(T_from), T_from, {1.0, 0.0, 0.0});
  EXPECT_GT(line.size(), 1u);
  EXPECT_LT(line.size(), numSteps(config, 1.0));
}

TEST_F(Stages, FirstContactLooksBetweenTheEnds) {
  const ArmVector free = pick.start_rad;
  const ArmVector blocked = postureAt(downAt(kMiddle));
  EXPECT_TRUE(firstContact(checker(), {free, free, blocked, free, free, free}));
  EXPECT_TRUE(firstContact(checker(), {free, blocked}));
  EXPECT_FALSE(firstContact(checker(), {free, free, free}));
}

TEST_F(Stages, SampledPosturesKeepTheTilt) {
  const TiltConstraint tilt{-Eigen::Vector3d::UnitZ(), 0.4};
  const auto sample = tiltSampler(*arm, tilt, {postureAt(downAt({0.6, 0.0, 0.5}))});
  std::mt19937_64 engine(1);
  const auto uniform01 = [&engine] { return std::uniform_real_distribution<double>()(engine); };
  double most_rad = 0.0;
  for (int n = 0; n < 500; ++n) most_rad = std::max(most_rad, tiltOf(*arm, tilt, sample(uniform01)));
  EXPECT_LE(most_rad, 0.4 - kTiltReserve_rad + 1e-5);  // rounding of inverse kinematics
  EXPECT_GT(most_rad, 0.3) << "not only level ones";
}

TEST_F(Stages, TiltAtTheStartIsAConstraint) {
  EXPECT_FALSE(*tiltOfHeld(task, true)) << "nothing is held";
  request.held = HeldBrick{Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 0.1)), pick.type.size_m};
  request.start_rad = postureAt(downAt({0.6, 0.0, 0.5}));
  ASSERT_TRUE(*tiltOfHeld(task, true));
  EXPECT_LT(((*tiltOfHeld(task, true))->up_tip + Eigen::Vector3d::UnitZ()).norm(), 1e-9);
  request.held->T_tip_brick.rotate(Eigen::AngleAxisd(0.25 * M_PI, Eigen::Vector3d::UnitX()));
  EXPECT_EQ(tiltOfHeld(task, true).failure().status, PlanStatus::kConstraint);
  EXPECT_FALSE(*tiltOfHeld(task, false));
}

TEST_F(Stages, GoalsAreFreeAndReachTheTip) {
  ArmGoal goal;
  goal.T_map_tip = pick.T_map_base * downAt({0.85, 0.1, 0.4});
  const auto goals = findGoals(task, goal, pick.start_rad, checker(), std::nullopt);
  ASSERT_TRUE(goals) << goals.failure().message;
  EXPECT_GE(goals->size(), 2u);
  for (const ArmVector& q : *goals) {
    EXPECT_TRUE(checker().isFree(q));
    EXPECT_TRUE((pick.T_map_base * arm->tipPose(q)).isApprox(*goal.T_map_tip, 1e-5));
  }
}

TEST_F(Stages, GoalsSayWhyThereIsNone) {
  const auto whyNot = [&](const ArmGoal& goal) {
    return findGoals(task, goal, pick.start_rad, checker(), std::nullopt).failure();
  };
  ArmGoal goal;
  EXPECT_EQ(whyNot(goal).status, PlanStatus::kBadRequest);
  goal.T_map_tip = pick.T_map_base * downAt(kMiddle);
  EXPECT_EQ(whyNot(goal).status, PlanStatus::kGoalInCollision);
  goal.T_map_tip = pick.T_map_base * downAt({3.0, 0.0, 0.5});
  EXPECT_EQ(whyNot(goal).status, PlanStatus::kNoIk);
  EXPECT_THAT(whyNot(pick.container(*arm).front()).message, HasSubstr("nothing is held"));
}

TEST_F(Stages, FreeMotionReachesOneOfTheGoals) {
  const std::vector<ArmVector> goals = {postureAt(downAt({0.7, 0.3, 0.5})), postureAt(downAt({0.7, -0.3, 0.5}))};
  const auto motion = moveTo(task, pick.start_rad, goals, checker(), std::nullopt, "it");
  ASSERT_TRUE(motion) << motion.failure().message;
  EXPECT_EQ(motion->trajectory.points.front().position_rad, pick.start_rad);
  EXPECT_EQ(motion->trajectory.points.back().position_rad, goals.at(motion->goal));
  for (double t = 0.0; t < motion->trajectory.duration(); t += 0.01) {
    EXPECT_TRUE(checker().isFree(motion->trajectory.sample(t).position_rad)) << t;
  }
  const auto into = moveTo(task, pick.start_rad, {postureAt(downAt(kMiddle))}, checker(), std::nullopt, "it");
  EXPECT_EQ(into.failure().status, PlanStatus::kGoalInCollision);
  EXPECT_THAT(into.failure().message, StartsWith("it: the motion's end"));
  request.is_cancelled = [] { return true; };
  EXPECT_EQ(moveTo(task, pick.start_rad, goals, checker(), std::nullopt, "it").failure().status,
            PlanStatus::kCancelled);
}

TEST_F(Stages, StartAtAFaceBacksOffStraight) {
  EXPECT_TRUE(findStart(task)->back_off.empty());
  request.start_rad = onTop().second;
  const auto start = findStart(task);
  ASSERT_TRUE(start) << start.failure().message;
  ASSERT_GE(start->back_off.size(), 2u);
  EXPECT_EQ(start->back_off.front(), request.start_rad);
  EXPECT_EQ(start->back_off.back(), start->joints_rad);
  EXPECT_TRUE(start->checker.isFree(start->joints_rad));
  const Eigen::Vector3d moved = arm->tipPose(start->joints_rad).translation() - Eigen::Vector3d(0.85, 0.1, 0.2);
  EXPECT_LT(moved.head<2>().norm(), 1e-5);
  EXPECT_NEAR(moved.z(), config.pick.approach_m, 1e-5);
}

TEST_F(Stages, StartWithAHeldBrickAmongNeighbours) {
  const auto [grip, contact_rad] = onTop();
  request.held = grip.held;
  request.start_rad = followLine(task, contact_rad, grip.T_base_contact, {0.0, 0.0, 0.1}).back();
  pick.world.boxes.clear();
  refresh();
  EXPECT_FALSE(findStart(task)->is_among_others);
  pick.add(kMiddle + Eigen::Vector3d(0.0, 0.0, 0.1) + kAside * pick.type.size_m.y(), kYaw_rad);
  refresh();
  EXPECT_TRUE(findStart(task)->is_among_others);
  EXPECT_FALSE(findStart(task)->wedged);
  request.scene = nullptr;
  EXPECT_EQ(findStart(task).failure().status, PlanStatus::kNoMap);
}

TEST_F(Stages, BrickInSceneByPhase) {
  // 3 cm beside: more than the map's margin, less than with the room.
  pick.add(kMiddle + kAside * (pick.type.size_m.y() + 0.03), kYaw_rad);
  refresh();
  const auto [grip, contact_rad] = onTop();
  BrickInScene scene = brickInScene();
  EXPECT_FALSE(scene.beforeTouch().isFree(contact_rad));
  EXPECT_TRUE(scene.touching().isFree(contact_rad));
  scene.hold(grip.held);
  EXPECT_TRUE(scene.whileLifting().isFree(contact_rad));
  const auto lifted = [&, &grip = grip, &contact_rad = contact_rad](double by_m) {
    return followLine(task, contact_rad, grip.T_base_contact, {0.0, 0.0, by_m}).back();
  };
  EXPECT_TRUE(scene.carrying().isFree(lifted(0.05)));
  EXPECT_FALSE(scene.withRoom().isFree(lifted(0.05)));
  EXPECT_TRUE(scene.withRoom().isFree(lifted(0.3)));
  const ArmVector aside = followLine(task, contact_rad, grip.T_base_contact, 0.033 * kAside).back();
  EXPECT_FALSE(scene.carrying().isFree(aside)) << "the neighbour beside the empty place";
  EXPECT_EQ(scene.carrying().held()->size_m, pick.type.size_m);
  EXPECT_FALSE(scene.touching().held());
}

TEST_F(Stages, GripsHoldTheBrickAtItsPlate) {
  const PickTarget target = pick.target(0);
  const auto points = contactPoints(task, target, BrickFace::kPlusZ);
  ASSERT_TRUE(points) << points.failure().message;
  EXPECT_EQ(points->front(), Eigen::Vector3d::Zero());
  const auto grips = gripsAt(task, target, facePose(task, target, BrickFace::kPlusZ), *points);
  ASSERT_THAT(grips, SizeIs(points->size() * static_cast<std::size_t>(config.pick.yaw_samples)));
  for (const Grip& grip : grips) {
    EXPECT_TRUE((pick.T_map_base * grip.T_base_contact * grip.held.T_tip_brick).isApprox(target.T_map_brick, 1e-9));
    EXPECT_NEAR(grip.T_base_contact.linear()(2, 2), -1.0, 1e-9);
    EXPECT_LT((grip.T_base_contact.linear() * grip.tilt.up_tip - Eigen::Vector3d::UnitZ()).norm(), 1e-9);
  }
  const auto postures = contactPostures(task, grips, 1);
  ASSERT_FALSE(postures.empty());
  for (std::size_t i = 0; i < postures.size(); ++i) {
    EXPECT_GE(postures[i].grip, 1u);
    EXPECT_TRUE(arm->tipPose(postures[i].joints_rad).isApprox(grips[postures[i].grip].T_base_contact, 1e-5));
    if (i == 0 || postures[i].is_dexterous != postures[i - 1].is_dexterous) continue;
    EXPECT_GE(postures[i].way_s, postures[i - 1].way_s);
  }
  sectors.top.max_radius_m = 0.31;
  EXPECT_EQ(contactPoints(task, target, BrickFace::kPlusZ).failure().status, PlanStatus::kOutsideSector);
  config.pick.magnet_radius_m = 0.2;
  EXPECT_EQ(contactPoints(task, target, BrickFace::kPlusZ).failure().status, PlanStatus::kBadRequest);
}

// By a side face the weight turns a brick about the magnet; by its top only across it.
TEST_F(Stages, GripsKeepTheWeightsMomentsWithinTheMagnets) {
  const PickTarget target = pick.target(0);
  const auto numPoints = [&](BrickFace face) {
    const auto points = contactPoints(task, target, face);
    EXPECT_TRUE(points) << points.failure().message;
    return points ? points->size() : 0u;
  };
  const BrickFace end = BrickFace::kMinusX;
  EXPECT_EQ(numPoints(end), 9u);  // 0.39 Nm at 4 cm aside
  config.pick.max_twist_Nm = 0.3;
  const auto points = contactPoints(task, target, end);
  ASSERT_TRUE(points) << points.failure().message;
  ASSERT_THAT(*points, SizeIs(3));
  for (const Eigen::Vector3d& p_face : *points) {
    const Eigen::Vector3d p_map = pick.T_map_base * facePose(task, target, end) * p_face;
    const Eigen::Vector3d lever = p_map - target.T_map_brick.translation();
    EXPECT_NEAR(lever.dot(target.T_map_brick.linear().col(1)), 0.0, 1e-9) << "beside the middle";
  }
  EXPECT_EQ(numPoints(BrickFace::kPlusZ), 9u);
  config.pick.max_bend_Nm = 1.4;  // 1.47 Nm are 1 kg at 15 cm
  const PlanFailure failure = contactPoints(task, target, end).failure();
  EXPECT_EQ(failure.status, PlanStatus::kOutsideSector);
  EXPECT_THAT(failure.message, HasSubstr("1.47 Nm across it, allowed are 1.40 Nm (pick/max_bend_Nm)"));
  EXPECT_EQ(numPoints(BrickFace::kPlusZ), 9u);
}

// A brick of the container, on end, is met by the arm where one that lies flat is not.
TEST_F(Stages, ThePlanAvoidsWhatLiesInTheContainer) {
  const Eigen::Isometry3d T_base_place = pick.container(*arm).front().place->T_base_place;
  const double rim_m = T_base_place.translation().z();
  LoadedBrick released{T_base_place, {0.2, 0.2, 0.3}};
  released.T_base_brick.translation().z() = rim_m + 0.15;
  const auto on_end = settledInContainer(*arm, released);
  ASSERT_TRUE(on_end);
  EXPECT_NEAR(on_end->T_base_brick.translation().z() + 0.15, rim_m + 0.09, 1e-3);  // the container is 0.21 m deep
  released.T_base_brick.translation().x() += 1.5;
  EXPECT_FALSE(settledInContainer(*arm, released)) << "it falls beside the robot";

  ArmGoal goal;
  goal.T_map_tip = pick.T_map_base * downAt(T_base_place.translation() + Eigen::Vector3d(0.0, 0.0, 0.06));
  const MotionPlanner planner(arm, sectors, config);
  request.load = {{T_base_place, {0.3, 0.2, 0.2}}};
  request.load.front().T_base_brick.translation().z() = rim_m - 0.11;
  const Result<JointTrajectory> over_flat = planner.planArm(request, goal);
  ASSERT_TRUE(over_flat) << over_flat.failure().message;
  request.load = {*on_end};
  EXPECT_EQ(planner.planArm(request, goal).failure().status, PlanStatus::kGoalInCollision);
  const ArmVector over_rad = over_flat->points.back().position_rad;
  CollisionChecker with_load = checker();
  with_load.setLoad(request.load, pick.start_rad);
  EXPECT_THAT(with_load.check(over_rad).describe(), HasSubstr("touches a brick in the container"));
  // Where the arm is nothing can lie: it gets away.
  request.start_rad = over_rad;
  goal.T_map_tip.reset();
  goal.joints_rad = pick.start_rad;
  EXPECT_TRUE(planner.planArm(request, goal));
  request.load.front().size_m.x() = -1.0;
  EXPECT_EQ(planner.planArm(request, goal).failure().status, PlanStatus::kBadRequest);
}

TEST_F(Stages, ContactLineEndsOnThePlateOrBeyond) {
  const auto [grip, contact_rad] = onTop();
  const auto heights = [&](const JointPath& line) {
    return std::pair(arm->tipPose(line.front()).translation().z(), arm->tipPose(line.back()).translation().z());
  };
  const auto line = contactLine(task, brickInScene(), grip, contact_rad);
  ASSERT_TRUE(line) << line.failure().message;
  EXPECT_NEAR(heights(*line).first, 0.2 + config.pick.approach_m, 1e-5);
  EXPECT_EQ(line->back(), contact_rad);
  config.pick.overtravel_m = 0.01;
  EXPECT_NEAR(heights(*contactLine(task, brickInScene(), grip, contact_rad)).second, 0.2 - 0.01, 1e-5);
  addBox({0.85, 0.1, 0.26}, {0.3, 0.3, 0.02});
  const auto blocked = contactLine(task, brickInScene(), grip, contact_rad);
  EXPECT_EQ(blocked.failure().status, PlanStatus::kApproachBlocked);
  EXPECT_THAT(blocked.failure().message, StartsWith("on the straight approach"));
}

TEST_F(Stages, LiftLineEndsClearOfNeighbours) {
  const auto [grip, contact_rad] = onTop();
  const auto lift = [&, &grip = grip, &contact_rad = contact_rad] {
    BrickInScene scene = brickInScene();
    scene.hold(grip.held);
    return liftLine(task, scene, grip, contact_rad, liftOffsets(Eigen::Vector3d::UnitZ(), config.pick.lift_m));
  };
  const Result<JointPath> alone = lift();
  ASSERT_TRUE(alone) << alone.failure().message;
  EXPECT_EQ(alone->front(), contact_rad);
  EXPECT_THAT(*alone, SizeIs(numSteps(config, kMinLift_m) + 1));
  pick.add(kMiddle + kAside * (pick.type.size_m.y() + 0.03), kYaw_rad);
  refresh();
  EXPECT_GT(arm->tipPose(lift()->back()).translation().z(), 0.2 + pick.type.size_m.z()) << "over its neighbour";
  for (const double side : {-1.0, 1.0}) addBox({0.85 + 0.15 * side, 0.1, 0.26}, {0.12, 0.5, 0.04});
  const Result<JointPath> blocked = lift();
  ASSERT_FALSE(blocked);
  EXPECT_THAT(blocked.failure().message, HasSubstr("lift"));
}

TEST_F(Stages, ASideIsLiftedUpAndBackFirst) {
  EXPECT_EQ(liftOffsets(Eigen::Vector3d::UnitZ(), 0.3).at(0), 0.3 * Eigen::Vector3d::UnitZ());
  const auto offsets = liftOffsets(-Eigen::Vector3d::UnitX(), 0.3);
  for (const Eigen::Vector3d& offset : offsets) EXPECT_NEAR(offset.norm(), 0.3, 1e-12);
  EXPECT_LT((offsets[0] - 0.3 * Eigen::Vector3d(-M_SQRT1_2, 0.0, M_SQRT1_2)).norm(), 1e-12);
}

TEST_F(Stages, AFaceThatLeansToAWallIsLiftedStraightUp) {
  const double edge_x_m =
      kMiddle.x() + 0.5 * (std::cos(kYaw_rad) * pick.type.size_m.x() + std::sin(kYaw_rad) * pick.type.size_m.y());
  addBox({edge_x_m + 0.02 + 0.05, 0.1, 0.2}, {0.1, 0.8, 0.4});  // a little farther than the map's margin
  const auto [grip, contact_rad] = onTop();
  BrickInScene scene = brickInScene();
  scene.hold(grip.held);
  const Eigen::Vector3d normal(0.5, 0.0, std::sqrt(0.75));
  const Eigen::Vector3d along_normal = config.pick.lift_m * normal;
  EXPECT_FALSE(liftLine(task, scene, grip, contact_rad, {along_normal})) << "there is the wall";
  const auto offsets = liftOffsets(normal, config.pick.lift_m);
  EXPECT_EQ(offsets[0], along_normal) << "its neighbours' sides are parallel to it: tried first";
  const auto line = liftLine(task, scene, grip, contact_rad, offsets);
  ASSERT_TRUE(line) << line.failure().message;
  const Eigen::Vector3d moved = arm->tipPose(line->back()).translation() - arm->tipPose(contact_rad).translation();
  EXPECT_LT(moved.head<2>().norm(), 1e-3) << "the inverse kinematics' accuracy on a line";
}

TEST(Rejections, UnknownSpaceIsTheReason) {
  Rejections rejections;
  rejections.add({CollisionKind::kSurface, "forearm", "", Eigen::Vector3d::Zero()});
  EXPECT_EQ(rejections.status(), PlanStatus::kGoalInCollision);
  rejections.add({CollisionKind::kUnknown, "magnet", "", Eigen::Vector3d::Zero()});
  rejections.add({CollisionKind::kSurface, "brick", "", Eigen::Vector3d::Zero()});
  EXPECT_EQ(rejections.status(), PlanStatus::kGoalUnknown);
  EXPECT_THAT(rejections.describe(), StartsWith("3 in collision (surface 2, unknown 1), for one: magnet"));
}

TEST(Result, HoldsAValueOrAFailure) {
  const Result<int> good = 3;
  EXPECT_TRUE(good);
  EXPECT_EQ(*good, 3);
  EXPECT_THROW(good.failure(), std::bad_variant_access);
  const Result<int> bad = cancelled();
  EXPECT_FALSE(bad);
  EXPECT_EQ(bad.failure().status, PlanStatus::kCancelled);
}

}  // namespace
}  // namespace motion_planning
