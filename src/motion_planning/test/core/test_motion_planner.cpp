// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/motion_planner.h"

#include <cmath>
#include <functional>
#include <limits>

#include <gmock/gmock.h>
#include <mp700_ur5e_description/robot_names.h>

#include "motion_planning/path_monitor.h"
#include "support/exact_motion.h"
#include "support/pick_world.h"

namespace motion_planning {
namespace {

using mp700_ur5e_description::BrickFace;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::ElementsAre;
using ::testing::Eq;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

MotionPlanner makePlanner(const MotionPlannerConfig& config = {}) {
  return {shippedArm(), testSectors(), config};
}

/// One brick before the robot, within easy reach.
PickWorld oneBrick(double yaw_rad = 0.3) {
  PickWorld pick = emptyPickWorld();
  pick.add({0.85, 0.1, 0.1}, yaw_rad);
  pick.makeScene();
  return pick;
}

Result<PickPlan> pickFrom(const PickWorld& pick, std::size_t brick, const MotionPlannerConfig& config = {}) {
  return makePlanner(config).planPick(pick.context(), pick.target(brick), pick.container(*shippedArm())).plan;
}

double tiltOf(const Eigen::Vector3d& up_tip, const ArmVector& q) {
  return std::acos(std::min(1.0, (shippedArm()->tipPose(q).linear() * up_tip).z()));
}

void expectWithinLimits(const JointTrajectory& trajectory, const MotionPlannerConfig& config) {
  ASSERT_GE(trajectory.points.size(), 2u);
  const ArmVector velocity = config.speed.velocity_scale * shippedArm()->limits().velocity_rad_s;
  for (const TrajectoryPoint& point : trajectory.points) {
    EXPECT_TRUE(shippedArm()->isWithinLimits(point.position_rad));
    EXPECT_LE((point.velocity_rad_s.array().abs() / velocity.array()).maxCoeff(), 1.0 + 1e-6);
    EXPECT_LE(point.acceleration_rad_s2.cwiseAbs().maxCoeff(), config.speed.acceleration_rad_s2 * (1.0 + 1e-6));
  }
  EXPECT_EQ(trajectory.points.front().velocity_rad_s, ArmVector::Zero());
  EXPECT_EQ(trajectory.points.back().velocity_rad_s, ArmVector::Zero());
}

/// The tip's farthest distance from the line between its ends, and its highest speed.
std::pair<double, double> straightness(const JointTrajectory& trajectory) {
  const ArmKinematics& arm = *shippedArm();
  const Eigen::Vector3d from = arm.tipPose(trajectory.points.front().position_rad).translation();
  const Eigen::Vector3d along = (arm.tipPose(trajectory.points.back().position_rad).translation() - from).normalized();
  double off_m = 0.0;
  double speed_m_s = 0.0;
  for (double t = 0.0; t <= trajectory.duration(); t += 0.004) {
    const TrajectoryPoint point = trajectory.sample(t);
    off_m = std::max(off_m, along.cross(arm.tipPose(point.position_rad).translation() - from).norm());
    speed_m_s = std::max(speed_m_s, (arm.jacobian(point.position_rad) * point.velocity_rad_s).head<3>().norm());
  }
  return {off_m, speed_m_s};
}

/// All that a pick promises, against the exact boxes.
void expectGoodPick(const PickWorld& pick, std::size_t brick, const Result<PickPlan>& planned,
                    const MotionPlannerConfig& config = {}, std::size_t place = 0) {
  ASSERT_TRUE(planned) << planned.failure().message;
  const PickPlan& plan = *planned;
  const ArmKinematics& arm = *shippedArm();
  for (const JointTrajectory* trajectory : {&plan.approach, &plan.contact, &plan.lift, &plan.stow}) {
    expectWithinLimits(*trajectory, config);
  }
  EXPECT_EQ(plan.approach.points.front().position_rad, pick.start_rad);
  EXPECT_EQ(plan.approach.points.back().position_rad, plan.contact.points.front().position_rad);
  EXPECT_EQ(plan.contact.points.back().position_rad, plan.lift.points.front().position_rad);
  EXPECT_EQ(plan.lift.points.back().position_rad, plan.stow.points.front().position_rad);

  // Contact: flat on the plate, the magnet's rim within it.
  const Eigen::Isometry3d T_map_tip = pick.T_map_base * arm.tipPose(plan.contact.points.back().position_rad);
  EXPECT_TRUE(T_map_tip.isApprox(plan.T_map_contact, 1e-5));
  const Eigen::Isometry3d T_face_tip =
      (pick.world.boxes[brick].T_map_box * mp700_ur5e_description::tagPose(pick.type, plan.face)).inverse() * T_map_tip;
  EXPECT_NEAR(T_face_tip.translation().z(), 0.0, 1e-5);
  EXPECT_NEAR(T_face_tip.linear()(2, 2), -1.0, 1e-6);
  EXPECT_LE(T_face_tip.translation().head<2>().cwiseAbs().maxCoeff() + config.pick.magnet_radius_m +
                config.pick.plate_margin_m,
            0.5 * pick.type.plate_edge_m + 1e-6);
  EXPECT_TRUE((plan.T_map_contact * plan.held.T_tip_brick).isApprox(pick.world.boxes[brick].T_map_box, 1e-9));

  const auto contact_line = straightness(plan.contact);
  EXPECT_LE(contact_line.first, 1e-3);
  EXPECT_LE(contact_line.second, config.speed.contact_speed_m_s * 1.005);
  const auto lift_line = straightness(plan.lift);
  EXPECT_LE(lift_line.first, 1e-3);
  EXPECT_LE(lift_line.second, config.speed.lift_speed_m_s * 1.005);
  EXPECT_NEAR((arm.tipPose(plan.contact.points.front().position_rad).translation() -
               arm.tipPose(plan.contact.points.back().position_rad).translation())
                  .norm(),
              config.pick.approach_m, 1e-5);

  ExactMotion exact(arm, pick);
  EXPECT_EQ(exact.complaint(plan.approach, 0.0), "");
  exact.setTarget(brick);
  EXPECT_EQ(exact.complaint(plan.contact, 0.0), "");
  exact.setHeld(plan.held);
  // On what it lies on the brick may rub by what it is planned smaller.
  EXPECT_EQ(exact.complaint(plan.lift, config.collision.held_shrink_m), "");
  exact.setTarget(brick, true);
  EXPECT_EQ(exact.complaint(plan.stow, config.collision.held_shrink_m), "");

  const Eigen::Vector3d up_tip =
      (pick.T_map_base.inverse() * plan.T_map_contact).linear().transpose() * Eigen::Vector3d::UnitZ();
  double tilt_rad = 0.0;
  for (double t = 0.0; t < plan.stow.duration(); t += 0.005) {
    tilt_rad = std::max(tilt_rad, tiltOf(up_tip, plan.stow.sample(t).position_rad));
  }
  EXPECT_LE(tilt_rad, config.pick.max_tilt_rad);

  // Over its place: as level as it lay, its lowest corner above the rim, its longer edge along the place.
  const Eigen::Isometry3d T_base_held = arm.tipPose(plan.stow.points.back().position_rad) * plan.held.T_tip_brick;
  const Eigen::Isometry3d T_base_drop =
      arm.robot().framePose(mp700_ur5e_description::kContainerPlaces[place], arm.robotPositions(ArmVector::Zero()));
  double lowest_m = 1.0;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d sign(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1);
    lowest_m = std::min(lowest_m, (T_base_held * (0.5 * sign.cwiseProduct(pick.type.size_m))).z());
  }
  EXPECT_NEAR(lowest_m, T_base_drop.translation().z() + PlaceGoal().above_m, 1e-5);
  EXPECT_LE((T_base_held.translation() - T_base_drop.translation()).head<2>().norm(), 1e-5);
  EXPECT_NEAR(tiltOf(up_tip, plan.stow.points.back().position_rad), 0.0, 1e-5);
  const Eigen::Vector3d hull_m =
      (T_base_drop.linear().transpose() * T_base_held.linear()).cwiseAbs() * pick.type.size_m;
  EXPECT_NEAR(hull_m.x(), 0.3, 1e-4);
  EXPECT_NEAR(hull_m.y(), 0.2, 1e-4);
}

TEST(MotionPlanner, PicksABrickByItsTopAndCarriesItToTheContainer) {
  const PickWorld pick = oneBrick();
  const PickResult result = makePlanner().planPick(pick.context(), pick.target(0), pick.container(*shippedArm()));
  expectGoodPick(pick, 0, result.plan);
  EXPECT_EQ(result.plan->face, BrickFace::kPlusZ);
  EXPECT_THAT(result.tried, IsEmpty());
}

TEST(MotionPlanner, PicksABrickByItsSide) {
  const PickWorld pick = oneBrick();
  PickTarget target = pick.target(0);
  target.faces.erase(target.faces.begin());
  MotionPlannerConfig config;
  const Result<PickPlan> plan =
      makePlanner(config).planPick(pick.context(), target, pick.container(*shippedArm())).plan;
  expectGoodPick(pick, 0, plan, config);
  EXPECT_NE(plan->face, BrickFace::kPlusZ);
}

// Its faces are neither top nor side faces: 30 to 60 degrees from up.
TEST(MotionPlanner, PicksATiltedBrickByAFaceBetween) {
  for (const double turn_rad : {-0.6, -M_PI_4, -1.0}) {
    SCOPED_TRACE(turn_rad);
    PickWorld pick = emptyPickWorld();
    pick.add({0.85, 0.1, 0.19});
    pick.world.boxes[0].T_map_box.rotate(Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitY()));
    pick.makeScene();
    PickTarget target = pick.target(0);
    target.faces = {BrickFace::kPlusZ};
    const Result<PickPlan> plan = makePlanner().planPick(pick.context(), target, pick.container(*shippedArm())).plan;
    ASSERT_TRUE(plan) << plan.failure().message;
    ExactMotion exact(*shippedArm(), pick);
    EXPECT_EQ(exact.complaint(plan->approach, 0.0), "");
    exact.setTarget(0);
    EXPECT_EQ(exact.complaint(plan->contact, 0.0), "");
    exact.setHeld(plan->held);
    EXPECT_EQ(exact.complaint(plan->lift, MotionPlannerConfig().collision.held_shrink_m), "");
    exact.setTarget(0, true);
    EXPECT_EQ(exact.complaint(plan->stow, MotionPlannerConfig().collision.held_shrink_m), "");
  }
}

// By its top, an end and a long side.
TEST(MotionPlanner, StowsAtEachPlace) {
  for (const BrickFace face : {BrickFace::kPlusZ, BrickFace::kMinusX, BrickFace::kMinusY}) {
    PickWorld pick = emptyPickWorld();
    pick.add({0.85, 0.1, 0.1}, face == BrickFace::kMinusY ? -M_PI_2 : 0.0);
    pick.makeScene();
    PickTarget target = pick.target(0);
    target.faces = {face};
    for (std::size_t place = 0; place < mp700_ur5e_description::kContainerPlaces.size(); ++place) {
      SCOPED_TRACE(std::string(toString(face)) + " at place " + std::to_string(place + 1));
      const Result<PickPlan> plan =
          makePlanner().planPick(pick.context(), target, pick.container(*shippedArm(), place)).plan;
      expectGoodPick(pick, 0, plan, {}, place);
    }
  }
}

/// The brick where it is let go, in the frame of its place.
Eigen::Isometry3d letGoAt(const PickPlan& plan, std::size_t place) {
  const ArmKinematics& arm = *shippedArm();
  const Eigen::Isometry3d T_base_place =
      arm.robot().framePose(mp700_ur5e_description::kContainerPlaces.at(place), arm.robotPositions(ArmVector::Zero()));
  return T_base_place.inverse() * arm.tipPose(plan.stow.points.back().position_rad) * plan.held.T_tip_brick;
}

// One that stands, or leans, is laid down in each place, beside what stands in the others; not where its weight would turn it
// on the magnet.
TEST(MotionPlanner, LaysDownABrickThatStands) {
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX();
  const Eigen::Vector3d y = Eigen::Vector3d::UnitY();
  for (const Eigen::AngleAxisd& turn :
       {Eigen::AngleAxisd(M_PI_2, y), Eigen::AngleAxisd(-M_PI_2, y), Eigen::AngleAxisd(1.15, y),
        Eigen::AngleAxisd(0.3, x), Eigen::AngleAxisd(0.7, x)}) {
    PickWorld pick = emptyPickWorld();
    pick.add({0.85, 0.1, 0.19});
    pick.world.boxes[0].T_map_box.rotate(turn);
    pick.makeScene();
    for (std::size_t place = 0; place < mp700_ur5e_description::kContainerPlaces.size(); ++place) {
      SCOPED_TRACE("turned by " + std::to_string(turn.angle()) + " to place " + std::to_string(place + 1));
      PlanningContext context = pick.context();
      PickWorld loaded = pick;
      for (std::size_t other = 0; other < place; ++other) {
        LoadedBrick standing{pick.container(*shippedArm(), other).front().place->T_base_place, {0.2, 0.2, 0.3}};
        standing.T_base_brick.translation().z() -= 0.06;
        context.load.push_back(standing);
        loaded.world.boxes.push_back({pick.T_map_base * standing.T_base_brick, standing.size_m});
      }
      const Result<PickPlan> plan =
          makePlanner().planPick(context, pick.target(0), pick.container(*shippedArm(), place)).plan;
      ASSERT_TRUE(plan) << plan.failure().message;
      const Eigen::Isometry3d T_place_brick = letGoAt(*plan, place);
      EXPECT_LT(T_place_brick.translation().head<2>().norm(), 1e-5);
      EXPECT_NEAR(T_place_brick.translation().z(), PlaceGoal().above_m + 0.1, 1e-5);
      EXPECT_LT((T_place_brick.linear().cwiseAbs() * pick.type.size_m - pick.type.size_m).norm(), 1e-4);
      ExactMotion exact(*shippedArm(), loaded);
      exact.setHeld(plan->held);
      exact.setTarget(0, true);
      EXPECT_EQ(exact.complaint(plan->stow, MotionPlannerConfig().collision.held_shrink_m), "");
    }
    const Result<PickPlan> begun =
        makePlanner().planPick(pick.context(), pick.target(0), pick.container(*shippedArm())).plan;
    ASSERT_TRUE(begun) << begun.failure().message;
    // Stopped anywhere on the way, it can still be stowed.
    for (double t = 0.0; t < begun->stow.duration(); t += 0.5) {
      PlanningContext context = pick.context();
      context.held = begun->held;
      context.start_rad = begun->stow.sample(t).position_rad;
      context.vacated = pick.world.boxes[0];
      const Result<JointTrajectory> rest = makePlanner().planArm(context, pick.container(*shippedArm()).front());
      ASSERT_TRUE(rest) << "after " << t << " s: " << rest.failure().message;
      const Eigen::Isometry3d T_base_held =
          shippedArm()->tipPose(rest->points.back().position_rad) * begun->held.T_tip_brick;
      EXPECT_NEAR(T_base_held.linear().row(2).cwiseAbs().dot(pick.type.size_m), 0.2, 1e-4) << "it lies";
    }
    if (std::abs(turn.angle()) < 1.5) continue;
    pick.type.mass_kg = 1.5;  // 2.2 Nm about a magnet on its end
    const Result<PickPlan> plan =
        makePlanner().planPick(pick.context(), pick.target(0), pick.container(*shippedArm())).plan;
    ASSERT_TRUE(plan) << plan.failure().message;
    EXPECT_NEAR(letGoAt(*plan, 0).translation().z(), PlaceGoal().above_m + 0.15, 1e-5);
  }
}

TEST(MotionPlanner, AGuardedTouchGoesOnBeyondThePlate) {
  MotionPlannerConfig guarded;
  guarded.pick.overtravel_m = 0.01;
  int solved = 0;
  for (const double x_m : {0.6, 0.8, 0.98, 1.02, 1.06, 1.1}) {  // out to where the arm just reaches the plate
    PickWorld pick = emptyPickWorld();
    pick.add({x_m, 0.0, 0.1});
    pick.makeScene();
    PickTarget target = pick.target(0);
    target.faces = {BrickFace::kPlusZ};
    const Result<PickPlan> plan =
        makePlanner(guarded).planPick(pick.context(), target, pick.container(*shippedArm())).plan;
    if (!plan) continue;
    ++solved;
    const Eigen::Isometry3d T_contact_end = plan->T_map_contact.inverse() * pick.T_map_base *
                                            shippedArm()->tipPose(plan->contact.points.back().position_rad);
    EXPECT_LT((T_contact_end.translation() - Eigen::Vector3d(0.0, 0.0, 0.01)).norm(), 1e-5) << x_m;
  }
  EXPECT_GE(solved, 4);
}

TEST(MotionPlanner, PlansInPilesHoldAgainstTheExactBoxes) {
  int solved = 0;
  int asked = 0;
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    const PickWorld pick = randomPile(seed, 8);
    for (const std::size_t brick : pick.open) {
      SCOPED_TRACE("pile " + std::to_string(seed) + ", brick " + std::to_string(brick));
      const auto [plan, tried] =
          makePlanner().planPick(pick.context(), pick.target(brick), pick.container(*shippedArm()));
      ++asked;
      if (plan) {
        expectGoodPick(pick, brick, plan);
        ++solved;
      } else {
        EXPECT_THAT(plan.failure().message, ::testing::Not(IsEmpty()));
        EXPECT_THAT(tried, SizeIs(pick.target(brick).faces.size()));
      }
    }
  }
  EXPECT_GE(2 * solved, asked);  // bricks at the border of the arm's reach are among them
}

// Of a wall of two metres the map has the lowest 0.7 m. Against it, or in a corner, a brick goes up and away.
TEST(MotionPlanner, PlansBesideWallsHoldAgainstTheExactBoxes) {
  for (const double gap_m : {0.003, 0.05}) {
    for (const bool is_corner : {false, true}) {
      SCOPED_TRACE(std::to_string(gap_m) + (is_corner ? " m in a corner" : " m from a wall"));
      PickWorld pick = emptyPickWorld();
      pick.add({0.95, 0.1, 0.1});
      const auto addWall = [&](const Eigen::Vector3d& middle_base, const Eigen::Vector3d& size_m) {
        pick.world.boxes.push_back({pick.T_map_base * Eigen::Translation3d(middle_base), size_m});
      };
      addWall({1.5, 0.1 + 0.1 + gap_m + 0.1, 1.0}, {2.0, 0.2, 2.0});
      if (is_corner) addWall({0.95 + 0.15 + gap_m + 0.1, -0.2, 1.0}, {0.2, 2.0, 2.0});
      pick.world.is_unknown = [](const Eigen::Vector3d& p_map) { return p_map.z() > 0.73; };
      pick.makeScene();
      const Result<PickPlan> plan = pickFrom(pick, 0);
      expectGoodPick(pick, 0, plan);
    }
  }
}

TEST(MotionPlanner, SameRequestSamePlan) {
  const PickWorld pick = randomPile(3, 8);
  const Result<PickPlan> first = pickFrom(pick, pick.open.front());
  const Result<PickPlan> second = pickFrom(pick, pick.open.front());
  ASSERT_TRUE(first) << first.failure().message;
  ASSERT_TRUE(second) << second.failure().message;
  const auto expectSame = [](const JointTrajectory& a, const JointTrajectory& b) {
    ASSERT_EQ(a.points.size(), b.points.size());
    for (std::size_t i = 0; i < a.points.size(); ++i) {
      EXPECT_EQ(a.points[i].time_s, b.points[i].time_s);
      EXPECT_EQ(a.points[i].position_rad, b.points[i].position_rad);
    }
  };
  expectSame(first->approach, second->approach);
  expectSame(first->stow, second->stow);
}

TEST(MotionPlanner, ABrickUnderAnotherIsNotTakenByItsTop) {
  PickWorld pick = emptyPickWorld();
  pick.add({0.8, 0.0, 0.1});
  pick.add({0.8, 0.0, 0.3}, 0.1);
  pick.makeScene();
  PickTarget target = pick.target(0);
  target.faces = {BrickFace::kPlusZ};
  const auto [plan, tried] = makePlanner().planPick(pick.context(), target, pick.container(*shippedArm()));
  EXPECT_THAT(plan.failure().status, AnyOf(PlanStatus::kGoalInCollision, PlanStatus::kApproachBlocked))
      << plan.failure().message;
  ASSERT_THAT(tried, SizeIs(1));
  EXPECT_EQ(tried[0].first, BrickFace::kPlusZ);
  EXPECT_EQ(tried[0].second.message, plan.failure().message);
  EXPECT_THAT(plan.failure().message, HasSubstr("face +z of brick 0"));
}

TEST(MotionPlanner, ReportsTheFaceThatGotFarthest) {
  PickWorld pick = emptyPickWorld();
  pick.add({0.8, 0.0, 0.1});
  pick.add({0.8, 0.0, 0.3}, 0.1);
  pick.makeScene();
  PickTarget target = pick.target(0);
  // +x looks away from the robot, -z into the ground.
  target.faces = {BrickFace::kPlusX, BrickFace::kPlusZ, BrickFace::kMinusZ};
  const auto [plan, tried] = makePlanner().planPick(pick.context(), target, pick.container(*shippedArm()));
  ASSERT_THAT(tried, SizeIs(3));
  EXPECT_EQ(tried[0].second.status, PlanStatus::kOutsideSector);
  EXPECT_EQ(plan.failure().status, tried[1].second.status);
  EXPECT_THAT(plan.failure().message, HasSubstr("face +z of brick 0"));
  EXPECT_NE(plan.failure().status, PlanStatus::kOutsideSector);
}

TEST(MotionPlanner, BadRequestsAreNamed) {
  const PickWorld pick = oneBrick();
  const MotionPlanner planner = makePlanner();
  const auto stow = pick.container(*shippedArm());
  const auto expectBad = [](const PlanFailure& why, const std::string& part) {
    EXPECT_EQ(why.status, PlanStatus::kBadRequest);
    EXPECT_THAT(why.message, HasSubstr(part));
  };
  PickTarget target = pick.target(0);
  target.T_map_brick.translation().x() = kNaN;
  expectBad(planner.planPick(pick.context(), target, stow).plan.failure(), "pose of the brick");
  target = pick.target(0);
  target.type = nullptr;
  expectBad(planner.planPick(pick.context(), target, stow).plan.failure(), "type");
  target = pick.target(0);
  target.faces.clear();
  expectBad(planner.planPick(pick.context(), target, stow).plan.failure(), "no face");
  target.faces = {BrickFace::kPlusZ, BrickFace::kMinusX, BrickFace::kPlusZ};
  expectBad(planner.planPick(pick.context(), target, stow).plan.failure(), "face +z is given twice");
  target.faces.assign(7, BrickFace::kPlusX);
  expectBad(planner.planPick(pick.context(), target, stow).plan.failure(), "7 faces to try, must be at most 6");
  expectBad(planner.planPick(pick.context(), pick.target(0), {}).plan.failure(), "no goal");
  PlanningContext context = pick.context();
  context.start_rad[3] = kNaN;
  expectBad(planner.planPick(context, pick.target(0), stow).plan.failure(), "start has an angle");
  context = pick.context();
  context.T_map_base.linear() *= 1.1;
  expectBad(planner.planPick(context, pick.target(0), stow).plan.failure(), "pose of the base");
  context = pick.context();
  context.held = HeldBrick{Eigen::Isometry3d(Eigen::Translation3d(0, 0, 0.1)), pick.type.size_m};
  expectBad(planner.planPick(context, pick.target(0), stow).plan.failure(), "holds a brick already");
  PickWorld few_plates = oneBrick();
  few_plates.type.plate_faces = {BrickFace::kMinusZ};
  expectBad(pickFrom(few_plates, 0).failure(), "has no steel plate");

  ArmGoal goal;
  expectBad(planner.planArm(pick.context(), goal).failure(), "0 of joints, tip and place");
  goal.joints_rad = pick.start_rad;
  goal.T_map_tip = Eigen::Isometry3d::Identity();
  expectBad(planner.planArm(pick.context(), goal).failure(), "2 of joints, tip and place");
  goal.T_map_tip.reset();
  (*goal.joints_rad)[0] = kNaN;
  expectBad(planner.planArm(pick.context(), goal).failure(), "not finite");
  expectBad(planner.planArm(pick.context(), stow.front()).failure(), "nothing is held");
  ViewFrustum view;
  expectBad(planner.planInspect(pick.context(), view, {}).failure(), "view");
}

TEST(MotionPlanner, NoMap) {
  PickWorld pick = oneBrick();
  pick.scene.reset();
  EXPECT_EQ(pickFrom(pick, 0).failure().status, PlanStatus::kNoMap);
}

TEST(MotionPlanner, EmptySceneIsFreeButForRobotAndFloor) {
  PickWorld pick = emptyPickWorld();
  pick.world.ground_z_m.reset();
  pick.makeScene();
  ArmGoal goal;
  goal.joints_rad = pick.start_rad;
  (*goal.joints_rad)[0] += 1.0;
  const Result<JointTrajectory> plan = makePlanner().planArm(pick.context(), goal);
  ASSERT_TRUE(plan) << plan.failure().message;
  EXPECT_EQ(plan->points.back().position_rad, *goal.joints_rad);
}

TEST(MotionPlanner, FarBrickIsOutsideTheSector) {
  PickWorld pick = emptyPickWorld();
  pick.add({2.5, 0.0, 0.1});
  pick.makeScene();
  const auto [plan, tried] = makePlanner().planPick(pick.context(), pick.target(0), pick.container(*shippedArm()));
  EXPECT_EQ(plan.failure().status, PlanStatus::kOutsideSector);
  EXPECT_THAT(tried, SizeIs(5));
}

TEST(MotionPlanner, UnreachableFaceAndTipHaveNoIk) {
  PickWorld pick = emptyPickWorld();
  pick.add({1.6, 0.0, 0.1});
  pick.makeScene();
  ManipulabilitySectors wide = testSectors();
  wide.top.max_radius_m = 5.0;
  const MotionPlanner planner(shippedArm(), wide, {});
  PickTarget target = pick.target(0);
  target.faces = {BrickFace::kPlusZ};
  const Result<PickPlan> plan = planner.planPick(pick.context(), target, pick.container(*shippedArm())).plan;
  EXPECT_EQ(plan.failure().status, PlanStatus::kNoIk) << plan.failure().message;
  ArmGoal goal;
  goal.T_map_tip = pick.T_map_base * Eigen::Translation3d(3.0, 0.0, 1.0);
  EXPECT_EQ(planner.planArm(pick.context(), goal).failure().status, PlanStatus::kNoIk);
}

TEST(MotionPlanner, StartInCollisionSaysWithWhat) {
  PickWorld pick = emptyPickWorld();
  const Eigen::Vector3d tip = shippedArm()->tipPose(pick.start_rad).translation();
  pick.add(tip);
  pick.makeScene();
  const Result<PickPlan> plan = pickFrom(pick, 0);
  EXPECT_EQ(plan.failure().status, PlanStatus::kStartInCollision);
  EXPECT_THAT(plan.failure().message, HasSubstr("start is in collision"));
}

// A pick that was broken off on its last centimetres, by a protective stop for one: nothing is held.
TEST(MotionPlanner, EmptyMagnetAtAFaceGoesStraightBackFirst) {
  const PickWorld pick = oneBrick();
  const Result<PickPlan> broken_off = pickFrom(pick, 0);
  ASSERT_TRUE(broken_off) << broken_off.failure().message;
  const MotionPlanner planner = makePlanner();
  const ArmKinematics& arm = *shippedArm();
  PlanningContext context = pick.context();
  CollisionChecker checker(shippedArm(), context.scene, context.T_map_base, planner.config().collision);
  context.start_rad = broken_off->contact.points.back().position_rad;
  ASSERT_TRUE(checker.check(context.start_rad)) << "that is the case";
  ArmGoal goal;
  goal.joints_rad = pick.start_rad;
  const Result<JointTrajectory> plan = planner.planArm(context, goal);
  ASSERT_TRUE(plan) << plan.failure().message;
  EXPECT_EQ(plan->points.front().position_rad, context.start_rad);
  EXPECT_EQ(plan->points.back().position_rad, pick.start_rad);

  const Eigen::Isometry3d T_face = arm.tipPose(context.start_rad);
  double back_m = 0.0;
  bool is_out = false;
  for (double t = 0.0; t < plan->duration(); t += 0.005) {
    const ArmVector q = plan->sample(t).position_rad;
    is_out = is_out || checker.isFree(q);
    if (is_out) {
      EXPECT_TRUE(checker.isFree(q)) << "back into something at " << t << " s";
      continue;
    }
    const Eigen::Vector3d moved = T_face.inverse() * arm.tipPose(q).translation();
    EXPECT_LT(moved.head<2>().norm(), 0.003) << "aside at " << t << " s";
    EXPECT_LT(moved.z(), -back_m + 1e-6) << "towards the face at " << t << " s";
    back_m = -moved.z();
  }
  EXPECT_TRUE(is_out);
  EXPECT_GT(back_m, 0.005);

  // The next pick begins with a way out of there.
  PickTarget target = pick.target(0);
  EXPECT_EQ(planner.planPick(context, target, pick.container(arm)).plan.failure().status,
            PlanStatus::kStartInCollision);
  // And who watches it sees the same.
  EXPECT_TRUE(checker.yieldToMagnetAt(context.start_rad));
  for (double t = 0.0; t < plan->duration(); t += 0.02) {
    EXPECT_TRUE(checker.isFree(plan->sample(t).position_rad)) << t;
  }
}

// A newer image has brought surface to within the margin of the wrist, where a pick was stopped with a brick in the hand.
TEST(MotionPlanner, OutOfAMarginThatSurfaceHasReachedTheArmGoesStraight) {
  const PickWorld pick = oneBrick();
  const Result<PickPlan> broken_off = pickFrom(pick, 0);
  ASSERT_TRUE(broken_off) << broken_off.failure().message;
  const MotionPlanner planner = makePlanner();
  const ArmVector start = broken_off->lift.points.front().position_rad;
  PickWorld beside;
  const auto contactAt = [&](double gap_m) {
    beside = pick;
    beside.add(shippedArm()->tipPose(start).translation() + Eigen::Vector3d(0.15 + gap_m, 0.0, 0.25));
    beside.makeScene();
    CollisionChecker checker(shippedArm(), beside.context().scene, beside.T_map_base, planner.config().collision);
    checker.setTarget(pick.world.boxes[0]);
    return checker.check(start);
  };
  double free_m = 0.3, touching_m = 0.0;
  while (free_m - touching_m > 0.001) {
    const double gap_m = 0.5 * (free_m + touching_m);
    (contactAt(gap_m) ? touching_m : free_m) = gap_m;
  }
  const Contact contact = contactAt(touching_m);
  ASSERT_EQ(contact.kind, CollisionKind::kSurface) << contact.describe();
  ASSERT_NE(contact.first, "brick");
  PlanningContext context = beside.context();
  context.start_rad = start;
  context.held = broken_off->held;
  context.vacated = pick.world.boxes[0];
  const Result<JointTrajectory> plan = planner.planArm(context, pick.container(*shippedArm()).front());
  ASSERT_TRUE(plan) << plan.failure().message;
  EXPECT_EQ(plan->points.front().position_rad, start);
  ExactMotion exact(*shippedArm(), beside);
  exact.setHeld(broken_off->held);
  exact.setTarget(0, true);
  EXPECT_EQ(exact.complaint(*plan, planner.config().collision.held_shrink_m), "");
  // Who watches it lets it go, and would stop it in the surface itself.
  Watched watched;
  watched.first_rad = firstPostures(*shippedArm(), *plan);
  watched.held = context.held;
  watched.vacated = context.vacated;
  const WatchCheckers checkers =
      watchCheckers(shippedArm(), context.scene, context.T_map_base, planner.config().collision, watched);
  for (double t = 0.0; t < plan->duration(); t += 0.02) {
    const ArmVector q = plan->sample(t).position_rad;
    EXPECT_TRUE(checkers.from_start.isFree(q) || (checkers.beyond && checkers.beyond->isFree(q))) << t;
  }
  CollisionChecker margin(shippedArm(), context.scene, context.T_map_base, planner.config().collision);
  margin.setTarget(pick.world.boxes[0], true);
  EXPECT_TRUE(margin.yieldToSurfaceAt(start));
  EXPECT_TRUE(margin.isFree(start));
  EXPECT_FALSE(margin.yieldToSurfaceAt(std::nullopt));
  EXPECT_FALSE(margin.isFree(start));
  EXPECT_THROW(margin.yieldToSurfaceAt(ArmVector::Constant(std::nan(""))), std::invalid_argument);
}

TEST(MotionPlanner, OtherLinksInCollisionAreNoMagnetAtAFace) {
  const PickWorld pick = oneBrick();
  const Result<PickPlan> broken_off = pickFrom(pick, 0);
  ASSERT_TRUE(broken_off) << broken_off.failure().message;
  const ArmVector at_face = broken_off->contact.points.back().position_rad;
  // The side of something goes through the wrist.
  PickWorld beside = pick;
  beside.add(shippedArm()->tipPose(at_face).translation() + Eigen::Vector3d(0.15, 0.0, 0.25));
  beside.makeScene();
  PlanningContext context = beside.context();
  const MotionPlanner planner = makePlanner();
  CollisionChecker checker(shippedArm(), context.scene, context.T_map_base, planner.config().collision);
  ASSERT_TRUE(checker.check(at_face));
  EXPECT_FALSE(checker.yieldToMagnetAt(at_face));
  EXPECT_FALSE(checker.yieldToMagnetAt(pick.start_rad)) << "in contact with nothing";
  context.start_rad = at_face;
  ArmGoal goal;
  goal.joints_rad = pick.start_rad;
  EXPECT_EQ(planner.planArm(context, goal).failure().status, PlanStatus::kStartInCollision);
}

TEST(MotionPlanner, BeyondTheJointsLimitsIsAReasonOfItsOwn) {
  const PickWorld pick = oneBrick();
  const auto expectBeyond = [](const PlanFailure& why, const std::string& where, const std::string& joint) {
    EXPECT_EQ(why.status, PlanStatus::kOutsideLimits) << why.message;
    EXPECT_THAT(why.message, AllOf(HasSubstr(where), HasSubstr(joint)));
  };
  PlanningContext context = pick.context();
  context.start_rad[0] = 20.0;
  context.start_rad[2] = -3.5;
  ArmGoal goal;
  goal.joints_rad = pick.start_rad;
  const std::string joints =
      "shoulder_pan_joint = 20.000 rad, must be in [-6.283, 6.283] rad; elbow_joint = -3.500 rad, must be in "
      "[-3.142, 3.142] rad";
  expectBeyond(makePlanner().planArm(context, goal).failure(), "start: ", joints);
  expectBeyond(makePlanner().planPick(context, pick.target(0), pick.container(*shippedArm())).plan.failure(),
               "start: ", joints);
  // At a limit is within it.
  context = pick.context();
  context.start_rad[5] = shippedArm()->limits().upper_rad[5];
  EXPECT_TRUE(makePlanner().planArm(context, goal));

  goal.joints_rad = pick.start_rad;
  (*goal.joints_rad)[5] = -7.0;
  const std::string wrist = "wrist_3_joint = -7.000 rad, must be in [-6.283, 6.283] rad";
  expectBeyond(makePlanner().planArm(pick.context(), goal).failure(), "the goal posture: ", wrist);
  PickTarget target = pick.target(0);
  target.faces = {BrickFace::kPlusZ};
  expectBeyond(makePlanner().planPick(pick.context(), target, {goal}).plan.failure(),
               "carrying the brick away: ", wrist);
}

TEST(MotionPlanner, ASurfaceWithoutAreaIsNoneAtAll) {
  PickWorld pick = oneBrick();
  const Result<PickPlan> floor_alone = [&] {
    PickWorld empty = oneBrick();
    CollisionSceneBuilder builder{CollisionSceneConfig()};
    builder.update(Surface(), empty.world, empty.T_map_base);
    empty.scene = builder.scene();
    return pickFrom(empty, 0);
  }();
  // The container's way is free, the magnet may stand on a brick that no map has seen.
  ASSERT_TRUE(floor_alone) << floor_alone.failure().message;

  const Surface good = pick.world.surface();
  const auto spoiled = [&](const std::function<void(Surface*)>& spoil) {
    Surface surface = good;
    spoil(&surface);
    CollisionSceneBuilder builder{CollisionSceneConfig()};
    const SceneUpdate update = builder.update(surface, pick.world, pick.T_map_base);
    EXPECT_EQ(update.triangles, 0u);
    EXPECT_EQ(update.degenerate, surface.triangles.size());
    pick.scene = builder.scene();
    return pickFrom(pick, 0);
  };
  const auto expectAsEmpty = [&](const Result<PickPlan>& plan) {
    ASSERT_TRUE(plan) << plan.failure().message;
    EXPECT_EQ(plan->approach.points.back().position_rad, floor_alone->approach.points.back().position_rad);
    EXPECT_EQ(plan->stow.points.back().position_rad, floor_alone->stow.points.back().position_rad);
  };
  {
    SCOPED_TRACE("vertices, but no triangle");
    expectAsEmpty(spoiled([](Surface* surface) { surface->triangles.clear(); }));
  }
  {
    SCOPED_TRACE("all triangles without area");
    expectAsEmpty(spoiled([](Surface* surface) {
      for (auto& triangle : surface->triangles) triangle[2] = triangle[1];
    }));
  }
  {
    SCOPED_TRACE("all vertices in one place");
    expectAsEmpty(spoiled([](Surface* surface) {
      for (auto& vertex : surface->vertices_map) vertex = surface->vertices_map.front();
    }));
  }
  {
    SCOPED_TRACE("no vertex is a number");
    expectAsEmpty(spoiled([](Surface* surface) {
      for (auto& vertex : surface->vertices_map) vertex.setConstant(kNaN);
    }));
  }
  {
    SCOPED_TRACE("indices of no vertex");
    expectAsEmpty(spoiled([](Surface* surface) {
      for (auto& triangle : surface->triangles) triangle[0] = static_cast<std::uint32_t>(surface->vertices_map.size());
    }));
  }
}

TEST(MotionPlanner, BadVerticesLeaveTheRestOfTheSurface) {
  PickWorld pick = oneBrick();
  // Tool down, the tip within the brick.
  ArmGoal goal;
  goal.T_map_tip =
      pick.T_map_base * Eigen::Translation3d(0.85, 0.1, 0.15) * Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX());
  Surface surface = pick.world.surface();
  const auto first_bad = static_cast<std::uint32_t>(surface.vertices_map.size());
  for (const double bad : {kNaN, std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()}) {
    surface.vertices_map.push_back(surface.vertices_map.front());
    surface.vertices_map.back().z() = bad;
    surface.normals_map.push_back(surface.normals_map.front());
    surface.triangles.push_back({0, 1, static_cast<std::uint32_t>(surface.vertices_map.size() - 1)});
  }
  ASSERT_GT(surface.vertices_map.size(), first_bad);
  CollisionSceneBuilder builder{CollisionSceneConfig()};
  const SceneUpdate update = builder.update(surface, pick.world, pick.T_map_base);
  EXPECT_EQ(update.degenerate, 3u);
  PlanningContext context = pick.context();
  context.scene = builder.scene();
  EXPECT_EQ(makePlanner().planArm(context, goal).failure().status, PlanStatus::kGoalInCollision);
}

TEST(MotionPlanner, ASingleTriangleIsInTheWayAndNothingElseIs) {
  PickWorld pick = emptyPickWorld();
  pick.world.ground_z_m.reset();
  ArmGoal goal;  // tool down, the tip 30 cm above the ground
  goal.T_map_tip =
      pick.T_map_base * Eigen::Translation3d(0.85, 0.1, 0.30) * Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX());
  // A tile of 16 cm, too small to be cut up, under the magnet, or 20 cm lower.
  const auto planOver = [&](double z_m) {
    Surface surface;
    for (const auto& [x, y] : {std::pair(-0.08, -0.08), std::pair(0.08, -0.08), std::pair(0.0, 0.08)}) {
      surface.vertices_map.emplace_back(pick.T_map_base * Eigen::Vector3d(0.85 + x, 0.1 + y, z_m));
      surface.normals_map.emplace_back(0.0F, 0.0F, 1.0F);
    }
    surface.triangles.push_back({0, 1, 2});
    CollisionSceneBuilder builder{CollisionSceneConfig()};
    EXPECT_EQ(builder.update(surface, pick.world, pick.T_map_base).triangles, 1u);
    PlanningContext context = pick.context();
    context.scene = builder.scene();
    return makePlanner().planArm(context, goal);
  };
  const Result<JointTrajectory> touching = planOver(0.31);
  EXPECT_EQ(touching.failure().status, PlanStatus::kGoalInCollision) << touching.failure().message;
  EXPECT_THAT(touching.failure().message, HasSubstr("surface"));
  const Result<JointTrajectory> over = planOver(0.10);
  EXPECT_TRUE(over) << over.failure().message;
}

TEST(MotionPlanner, GoalInCollisionAndGoalUnknownAreToldApart) {
  PickWorld pick = oneBrick();
  ArmGoal goal;
  // Tool down, the tip within the brick; above it; beside it.
  Eigen::Isometry3d T_base_tip =
      Eigen::Translation3d(0.85, 0.1, 0.15) * Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX());
  goal.T_map_tip = pick.T_map_base * T_base_tip;
  Result<JointTrajectory> plan = makePlanner().planArm(pick.context(), goal);
  EXPECT_EQ(plan.failure().status, PlanStatus::kGoalInCollision) << plan.failure().message;
  EXPECT_THAT(plan.failure().message, HasSubstr("in collision"));

  T_base_tip.translation() += Eigen::Vector3d(0.0, 0.0, 0.15);
  goal.T_map_tip = pick.T_map_base * T_base_tip;
  plan = makePlanner().planArm(pick.context(), goal);
  EXPECT_TRUE(plan) << plan.failure().message;

  pick.world.is_unknown = [&](const Eigen::Vector3d& p_map) { return (pick.T_map_base.inverse() * p_map).x() > 0.8; };
  pick.makeScene();
  plan = makePlanner().planArm(pick.context(), goal);
  EXPECT_EQ(plan.failure().status, PlanStatus::kGoalUnknown) << plan.failure().message;
}

TEST(MotionPlanner, WhereTheArmIsCannotBeUnseen) {
  PickWorld pick = oneBrick();
  pick.world.is_unknown = [&](const Eigen::Vector3d& p_map) { return (pick.T_map_base.inverse() * p_map).z() > 0.25; };
  pick.makeScene();
  const auto over = [&](double x, double y) {
    const Eigen::Isometry3d T_base_tip =
        Eigen::Translation3d(x, y, 0.32) * Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX());
    return T_base_tip;
  };
  PlanningContext context = pick.context();
  const auto branches = shippedArm()->inverse(over(0.80, 0.05), context.start_rad);
  ASSERT_FALSE(branches.empty());
  context.start_rad = branches.front();
  ArmGoal goal;
  goal.joints_rad = context.start_rad;
  EXPECT_TRUE(makePlanner().planArm(context, goal));
  goal.joints_rad.reset();
  goal.T_map_tip = pick.T_map_base * over(0.92, 0.2);
  EXPECT_EQ(makePlanner().planArm(context, goal).failure().status, PlanStatus::kGoalUnknown);
}

/// What was planned in a map must not be stopped in the same map, by margins that are smaller.
void expectTheWatchLetsPass(const PickWorld& planned_in, const PlanningContext& context,
                            const JointTrajectory& trajectory) {
  CollisionSceneConfig margins;
  margins.sigmas = 1.0;
  margins.margin_m = 0.0;
  PickWorld pick = planned_in;
  pick.makeScene(margins);
  CollisionCheckerConfig robot = MotionPlannerConfig().collision;
  robot.self_padding_m = robot.held_padding_m = 0.0;
  const Watched watched{context.held, context.vacated, std::nullopt, firstPostures(*shippedArm(), trajectory)};
  const WatchCheckers checkers = watchCheckers(shippedArm(), pick.scene, pick.T_map_base, robot, watched);
  PathMonitor monitor({});
  monitor.start(trajectory, shippedArm());
  const PathVerdict verdict = monitor.check(0.0, checkers.from_start, checkers.beyond ? &*checkers.beyond : nullptr);
  EXPECT_FALSE(verdict.must_stop) << verdict.reason;
}

TEST(MotionPlanner, PlaceOfTheHeldBrickIsEmpty) {
  // Just taken: the map still has the brick where the hand holds it now.
  const PickWorld pick = oneBrick();
  const Result<PickPlan> plan = pickFrom(pick, 0);
  ASSERT_TRUE(plan);
  PlanningContext context = pick.context();
  context.start_rad = plan->lift.points.front().position_rad;
  context.held = plan->held;
  ArmGoal goal;
  goal.joints_rad = plan->lift.points.back().position_rad;
  // Where it hangs there is nothing else: out of there it comes. But next to it the map is believed...
  EXPECT_EQ(makePlanner().planArm(context, goal).failure().status, PlanStatus::kGoalInCollision);
  ArmGoal away;
  away.joints_rad = plan->stow.points.back().position_rad;
  const Result<JointTrajectory> out = makePlanner().planArm(context, away);
  EXPECT_TRUE(out) << out.failure().message;
  expectTheWatchLetsPass(pick, context, *out);
  // ... unless that is known to be its place.
  context.vacated = pick.world.boxes[0];
  const Result<JointTrajectory> lifted = makePlanner().planArm(context, goal);
  EXPECT_TRUE(lifted) << lifted.failure().message;
  expectTheWatchLetsPass(pick, context, *lifted);
}

TEST(MotionPlanner, WhatIsLiftedPastASheetThatLeansOverItIsNotStoppedThere) {
  const Eigen::Vector3d middle(0.75, 0.0, 0.1);
  PickWorld alone = emptyPickWorld();
  alone.add(middle);
  alone.makeScene();
  const Result<PickPlan> taken = pickFrom(alone, 0);
  ASSERT_TRUE(taken) << taken.failure().message;
  ASSERT_EQ(taken->face, BrickFace::kPlusZ);
  ArmGoal goal;
  goal.joints_rad = taken->stow.points.back().position_rad;
  // From its top upwards by 6 cm, ever deeper over it: what leave it needs for the first 5 cm is just enough beyond, or not.
  int num_planned = 0;
  for (double lean_rad = 0.10; lean_rad < 0.42; lean_rad += 0.01) {
    SCOPED_TRACE(lean_rad);
    PickWorld pick = emptyPickWorld();
    const double thickness_m = 0.02, height_m = 0.06;
    OrientedBox sheet;
    sheet.T_map_box = pick.T_map_base *
                      Eigen::Translation3d(middle.x(), 0.5 * alone.type.size_m.y(), alone.type.size_m.z()) *
                      Eigen::AngleAxisd(lean_rad, Eigen::Vector3d::UnitX()) *
                      Eigen::Translation3d(0.0, 0.5 * thickness_m, 0.5 * height_m);
    sheet.size_m = {0.5, thickness_m, height_m};
    pick.world.boxes.push_back(sheet);
    pick.makeScene();
    PlanningContext context = pick.context();
    context.held = taken->held;
    context.start_rad = taken->lift.points.front().position_rad;
    const Result<JointTrajectory> plan = makePlanner().planArm(context, goal);
    if (!plan) continue;
    ++num_planned;
    expectTheWatchLetsPass(pick, context, *plan);
  }
  EXPECT_GE(num_planned, 10);
}

TEST(MotionPlanner, OutOfWhatTheMapHasWithinTheHeldBrickItGoesStraightUp) {
  const Eigen::Vector3d middle(0.75, 0.0, 0.1);
  PickWorld alone = emptyPickWorld();
  alone.add(middle);
  alone.makeScene();
  const Result<PickPlan> taken = pickFrom(alone, 0);
  ASSERT_TRUE(taken) << taken.failure().message;
  ASSERT_EQ(taken->face, BrickFace::kPlusZ);
  const ArmKinematics& arm = *shippedArm();
  const MotionPlannerConfig config;
  // So far within the brick the map has its neighbours to both sides: at last both are in its middle.
  for (const double within_m : {0.005, 0.015, 0.02, 0.05, 0.08, 0.1}) {
    SCOPED_TRACE(within_m);
    PickWorld pick = emptyPickWorld();
    const Eigen::Vector3d beside(0.0, alone.type.size_m.y() - within_m, 0.0);
    pick.add(middle + beside);
    pick.add(middle - beside);
    pick.makeScene();
    PlanningContext context = pick.context();
    context.held = taken->held;
    context.start_rad = taken->lift.points.front().position_rad;
    ArmGoal goal;
    goal.joints_rad = taken->stow.points.back().position_rad;
    const Result<JointTrajectory> plan = makePlanner(config).planArm(context, goal);
    ASSERT_TRUE(plan) << plan.failure().message;
    expectWithinLimits(*plan, config);
    EXPECT_EQ(plan->points.front().position_rad, context.start_rad);
    EXPECT_EQ(plan->points.back().position_rad, *goal.joints_rad);
    const Eigen::Vector3d from = arm.tipPose(context.start_rad).translation();
    ExactMotion exact(arm, pick);
    exact.setHeld(taken->held);
    double over_m = 0.0;
    for (double t = 0.0; t < plan->duration(); t += 0.01) {
      const ArmVector q = plan->sample(t).position_rad;
      const Eigen::Vector3d way = arm.tipPose(q).translation() - from;
      over_m = std::max(over_m, way.z());
      if (over_m < pick.type.size_m.z()) {
        EXPECT_LT(way.head<2>().norm(), 1e-3) << "after " << t << " s";
      } else if (over_m > pick.type.size_m.z() + config.pick.lift_room_m) {
        EXPECT_GT(exact.clearance(q, 0.0), 0.0) << "after " << t << " s";
      }
    }
    EXPECT_GT(over_m, pick.type.size_m.z());
    expectTheWatchLetsPass(pick, context, *plan);
  }
}

TEST(MotionPlanner, HeldBrickLeavesABlockAside) {
  PickWorld alone = emptyPickWorld();
  alone.add({0.75, 0.0, 0.1});
  alone.makeScene();
  const Result<PickPlan> taken = pickFrom(alone, 0);
  ASSERT_TRUE(taken) << taken.failure().message;
  const ArmVector start_rad = taken->lift.points.back().position_rad;
  const Eigen::Isometry3d T_base_tip = shippedArm()->tipPose(start_rad);
  const Eigen::Isometry3d T_base_brick = T_base_tip * taken->held.T_tip_brick;
  ArmGoal goal;
  goal.joints_rad = taken->stow.points.back().position_rad;
  // The map has something there since the arm has stopped: beside the brick and over it.
  for (const double within_m : {0.02, 0.03, 0.05}) {
    SCOPED_TRACE(within_m);
    PickWorld pick = emptyPickWorld();
    OrientedBox block;
    block.size_m = {0.1, 0.3, 0.4};
    const double beside_m = 0.5 * (alone.type.size_m.x() + block.size_m.x()) - within_m;
    block.T_map_box =
        pick.T_map_base * Eigen::Translation3d(T_base_brick.translation()) * Eigen::Translation3d(beside_m, 0.0, 0.1);
    pick.world.boxes.push_back(block);
    pick.makeScene();
    PlanningContext context = pick.context();
    context.held = taken->held;
    context.start_rad = start_rad;
    const Result<JointTrajectory> plan = makePlanner().planArm(context, goal);
    ASSERT_TRUE(plan) << plan.failure().message;
    Eigen::Vector3d way = Eigen::Vector3d::Zero();
    for (double t = 0.0; t < plan->duration() && way.norm() < within_m; t += 0.01) {
      way = shippedArm()->tipPose(plan->sample(t).position_rad).translation() - T_base_tip.translation();
    }
    EXPECT_LT(way.x(), -0.5 * within_m) << "away from the block";
    expectTheWatchLetsPass(pick, context, *plan);
  }
}

// An image showed the brick in the hand: the map has it beside where it is taken to be, and too high to get out straight.
TEST(MotionPlanner, WhatTheMapHasOfTheHeldBrickItselfIsNotInItsWay) {
  PickWorld pick = emptyPickWorld();
  pick.add({0.775, 0.0, 0.8});
  pick.world.boxes[0].size_m = {0.2, 0.2, 0.3};
  pick.makeScene();
  PlanningContext context = pick.context();
  context.held = HeldBrick{Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 0.15)), {0.2, 0.2, 0.3}};
  Eigen::Isometry3d T_base_tip(Eigen::Translation3d(0.75, 0.0, 0.95));
  T_base_tip.rotate(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
  context.start_rad = shippedArm()->inverse(T_base_tip, pick.start_rad).at(0);
  const Result<JointTrajectory> plan = makePlanner().planArm(context, pick.container(*shippedArm()).front());
  ASSERT_TRUE(plan) << plan.failure().message;
  expectTheWatchLetsPass(pick, context, *plan);
  // What reaches farther is another thing.
  pick.add({0.775, 0.0, 0.8});
  pick.world.boxes[1].size_m = {0.5, 0.5, 0.5};
  pick.makeScene();
  context.scene = pick.scene;
  EXPECT_EQ(makePlanner().planArm(context, pick.container(*shippedArm()).front()).failure().status,
            PlanStatus::kStartInCollision);
}

/// Nearest that a held brick's surface comes to the container on a way [m]; negative: it is in it.
double distanceToContainer(const HeldBrick& held, const JointTrajectory& way) {
  const ArmKinematics& arm = *shippedArm();
  std::vector<Eigen::Isometry3d> T_base_body;
  double nearest_m = std::numeric_limits<double>::infinity();
  for (double t = 0.0; t <= way.duration(); t += 0.01) {
    const ArmVector q = way.sample(t).position_rad;
    arm.robot().bodyPoses(arm.robotPositions(q), &T_base_body);
    for (const auto& part : arm.robot().shapes()) {
      if (part.link != mp700_ur5e_description::kContainerLink) continue;
      const auto& wall = std::get<mp700_ur5e_description::Box>(part.shape);
      const Eigen::Isometry3d T_base_wall = T_base_body[part.body] * part.T_body_shape;
      // A brick is larger than what it may meet here is thick: points of each on the other.
      const OrientedBox wall_box{T_base_wall, wall.size_m};
      const OrientedBox brick_box{arm.tipPose(q) * held.T_tip_brick, held.size_m};
      for (const auto& [a, b] : {std::pair(wall_box, brick_box), std::pair(brick_box, wall_box)}) {
        for (double u = -0.5; u <= 0.5; u += 0.125) {
          for (double v = -0.5; v <= 0.5; v += 0.125) {
            for (double w = -0.5; w <= 0.5; w += 0.125) {
              const Eigen::Vector3d p = a.T_map_box * Eigen::Vector3d(u, v, w).cwiseProduct(a.size_m);
              nearest_m = std::min(nearest_m, signedDistance(b, p));
            }
          }
        }
      }
    }
  }
  return nearest_m;
}

// What hangs a centimetre elsewhere than believed must not meet the container's rim; what is nearer already may go away from it.
TEST(MotionPlanner, WhatIsCarriedKeepsItsDistanceFromTheContainer) {
  PickWorld pick = emptyPickWorld();
  pick.makeScene();
  const MotionPlannerConfig config;
  PlanningContext context = pick.context();
  context.held = HeldBrick{Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 0.1)), {0.3, 0.2, 0.2}};
  const auto beside = [&](double gap_m) {  // the container ends at y = -0.315, its rim is at z = 0.578
    Eigen::Isometry3d T_base_tip(Eigen::Translation3d(-0.30, -0.415 - gap_m, 0.73));
    T_base_tip.rotate(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
    return T_base_tip;
  };
  ArmGoal goal = pick.container(*shippedArm()).front();
  int num_ways = 0;
  // Two searches at two gaps: free, and nearer than planned with, by belief even within the rim.
  for (const double gap_m : {0.04, 0.01, -0.01}) {
    for (const ArmVector& start : shippedArm()->inverse(beside(gap_m), pick.start_rad)) {
      context.start_rad = start;
      CollisionChecker empty(shippedArm(), context.scene, context.T_map_base, config.collision);
      if (!empty.isFree(start)) continue;
      const Result<JointTrajectory> plan = makePlanner(config).planArm(context, goal);
      ASSERT_TRUE(plan) << gap_m << ": " << plan.failure().message;
      // Between the last checks of a path it may be nearer by half a step; and at its start it is yielded to in steps.
      const double slack_m = 0.5 * config.check.verify_step_m;
      EXPECT_GT(distanceToContainer(*context.held, *plan),
                std::min(gap_m - 0.005, config.collision.held_padding_m) - slack_m)
          << gap_m;
      ++num_ways;
      break;
    }
  }
  EXPECT_EQ(num_ways, 3);
}

TEST(MotionPlanner, WhereNoSearchFindsAWayOutAStraightOneIsTaken) {
  const Eigen::Vector3d middle(0.75, 0.0, 0.1);
  PickWorld alone = emptyPickWorld();
  alone.add(middle);
  alone.makeScene();
  const Result<PickPlan> taken = pickFrom(alone, 0);
  ASSERT_TRUE(taken) << taken.failure().message;
  ASSERT_EQ(taken->face, BrickFace::kPlusZ);
  // A shaft, open above, with half a centimetre more than the margin on all sides; the brick hangs in it, off the ground.
  PickWorld pick = emptyPickWorld();
  const Eigen::Vector3d size_m = pick.type.size_m;
  for (const double side : {-1.0, 1.0}) {
    pick.add(middle + Eigen::Vector3d(0.0, side * (size_m.y() + 0.02), 0.0));
    pick.add(middle + Eigen::Vector3d(side * (size_m.x() + 0.02), 0.0, 0.0));
  }
  pick.makeScene();
  MotionPlannerConfig config;
  config.planner.max_iterations = 20;
  PlanningContext context = pick.context();
  context.held = taken->held;
  const std::vector<TrajectoryPoint>& lift = taken->lift.points;
  const auto start = std::find_if(lift.begin(), lift.end(), [&](const TrajectoryPoint& point) {
    const double rise_m = (shippedArm()->tipPose(point.position_rad).translation() -
                           shippedArm()->tipPose(lift.front().position_rad).translation())
                              .z();
    return rise_m > 0.03;
  });
  ASSERT_NE(start, lift.end());
  context.start_rad = start->position_rad;
  ArmGoal goal;
  goal.joints_rad = taken->stow.points.back().position_rad;
  const Result<JointTrajectory> plan = makePlanner(config).planArm(context, goal);
  ASSERT_TRUE(plan) << plan.failure().message;
  ExactMotion exact(*shippedArm(), pick);
  exact.setHeld(taken->held);
  const Eigen::Vector3d from = shippedArm()->tipPose(context.start_rad).translation();
  double over_m = 0.0;
  for (double t = 0.0; t < plan->duration(); t += 0.01) {
    const ArmVector q = plan->sample(t).position_rad;
    EXPECT_GT(exact.clearance(q, 0.0), 0.0) << "after " << t << " s";
    const Eigen::Vector3d way = shippedArm()->tipPose(q).translation() - from;
    over_m = std::max(over_m, way.z());
    if (over_m < 0.1) {
      EXPECT_LT(way.head<2>().norm(), 1e-3) << "after " << t << " s";
    }
  }
  EXPECT_EQ(plan->points.back().position_rad, *goal.joints_rad);
}

TEST(MotionPlanner, AnotherSeedSearchesOtherPaths) {
  // A wall over which the brick in it has to be carried.
  PickWorld pick = emptyPickWorld();
  for (const double y : {-0.4, 0.0, 0.4}) {
    pick.add({0.75, y, 0.1});
    if (y != 0.0) pick.add({0.75, y, 0.3});
  }
  pick.makeScene();
  PlanningContext context = pick.context();
  const auto pathOf = [&](std::uint64_t seed) {
    context.seed = seed;
    const Result<PickPlan> plan = makePlanner().planPick(context, pick.target(2), pick.container(*shippedArm())).plan;
    EXPECT_TRUE(plan) << plan.failure().message;
    std::vector<double> all;
    for (const JointTrajectory* part : {&plan->approach, &plan->stow}) {
      for (const auto& point : part->points) {
        all.insert(all.end(), point.position_rad.data(), point.position_rad.data() + 6);
      }
    }
    return all;
  };
  const std::vector<double> path = pathOf(0);
  EXPECT_EQ(path, pathOf(0));
  bool differs = false;
  for (std::uint64_t seed = 1; seed < 6 && !differs; ++seed) differs = pathOf(seed) != path;
  EXPECT_TRUE(differs);
}

TEST(MotionPlanner, NothingIsLiftedThroughWhatReachesOverIt) {
  const Eigen::Vector3d middle(0.75, 0.0, 0.1);
  PickWorld pick = emptyPickWorld();
  pick.add(middle);
  pick.makeScene();
  const Result<PickPlan> taken = pickFrom(pick, 0);
  ASSERT_TRUE(taken) << taken.failure().message;
  PlanningContext context = pick.context();
  context.held = taken->held;
  context.start_rad = taken->lift.points.front().position_rad;
  // Two lie on it, far in over its top on both sides of the magnet; held too deep within them, too.
  for (const double drop_m : {0.0, 0.09}) {
    PickWorld under = emptyPickWorld();
    const Eigen::Vector3d over(0.0, 0.12, pick.type.size_m.z() - drop_m);
    under.add(middle + over);
    under.add(middle + Eigen::Vector3d(0.0, -over.y(), over.z()));
    under.makeScene();
    PlanningContext below = under.context();
    below.held = context.held;
    below.start_rad = context.start_rad;
    ArmGoal goal;
    goal.joints_rad = taken->stow.points.back().position_rad;
    const Result<JointTrajectory> plan = makePlanner().planArm(below, goal);
    EXPECT_EQ(plan.failure().status, PlanStatus::kStartInCollision) << drop_m << ": " << plan.failure().message;
  }
}

TEST(MotionPlanner, TheLiftEndsWhereTheBrickAsItHangsHasRoomToAllSides) {
  // Neighbours 1.5 cm from both ends: seen turned by a right angle, the brick would be far from them all along.
  for (const double yaw_rad : {0.0, 0.4, 0.8, 1.2, 1.6, 2.0, 2.4, 2.8}) {
    PickWorld pick = emptyPickWorld();
    const Eigen::Vector3d middle(0.75, 0.1, 0.1);
    const Eigen::Vector3d along(0.315 * std::cos(yaw_rad), 0.315 * std::sin(yaw_rad), 0.0);
    pick.add(middle, yaw_rad);
    pick.add(middle + along, yaw_rad);
    pick.add(middle - along, yaw_rad);
    pick.makeScene();
    PickTarget target = pick.target(0);
    target.faces = {BrickFace::kPlusZ};
    const MotionPlannerConfig config;
    const Result<PickPlan> plan =
        makePlanner(config).planPick(pick.context(), target, pick.container(*shippedArm())).plan;
    ASSERT_TRUE(plan) << yaw_rad << ": " << plan.failure().message;
    const double rise_m = (shippedArm()->tipPose(plan->lift.points.back().position_rad).translation() -
                           shippedArm()->tipPose(plan->lift.points.front().position_rad).translation())
                              .z();
    // Its underside over their tops: the room, the map's margin (2 sigma of 2 mm and 10 mm), less than a step of the line
    // and, where triangles turn about an edge, the mitre.
    const double over_m = rise_m - pick.type.size_m.z();
    EXPECT_GE(over_m, config.pick.lift_room_m) << yaw_rad;
    EXPECT_LE(over_m, config.pick.lift_room_m + 0.014 + config.pick.cartesian_step_m + 0.006) << yaw_rad;
  }
}

TEST(MotionPlanner, LiftThatIsBlockedIsAnApproachBlocked) {
  // A frame 3 cm over the brick, open where the magnet comes down: the brick cannot go up through it, nor half the way.
  PickWorld pick = emptyPickWorld();
  pick.add({0.8, 0.0, 0.1});
  const auto plate = [&](double x, double y, double size_x, double size_y) {
    OrientedBox box;
    box.T_map_box = pick.T_map_base * Eigen::Translation3d(0.8 + x, y, 0.25);
    box.size_m = {size_x, size_y, 0.04};
    pick.world.boxes.push_back(box);
  };
  plate(-0.15, 0.0, 0.12, 0.40);
  plate(0.15, 0.0, 0.12, 0.40);
  plate(0.0, -0.15, 0.18, 0.10);
  plate(0.0, 0.15, 0.18, 0.10);
  pick.makeScene();
  PickTarget target = pick.target(0);
  target.faces = {BrickFace::kPlusZ};
  const Result<PickPlan> plan = makePlanner().planPick(pick.context(), target, pick.container(*shippedArm())).plan;
  EXPECT_EQ(plan.failure().status, PlanStatus::kApproachBlocked) << plan.failure().message;
  EXPECT_THAT(plan.failure().message, HasSubstr("lift: "));
}

TEST(MotionPlanner, StraightWaysAreFreeAllAlongNotOnlyAtTheirEnds) {
  // A small block where a link is halfway down a long approach, but at neither end of it.
  PickWorld pick = oneBrick();
  MotionPlannerConfig config;
  config.pick.approach_m = 0.3;
  const Result<PickPlan> before = pickFrom(pick, 0, config);
  ASSERT_TRUE(before) << before.failure().message;
  const ExactMotion free(*shippedArm(), pick);
  std::vector<Eigen::Vector3d> ends = free.points(before->contact.points.front().position_rad);
  const auto at_face = free.points(before->contact.points.back().position_rad);
  ends.insert(ends.end(), at_face.begin(), at_face.end());
  Eigen::Vector3d farthest_base = Eigen::Vector3d::Zero();
  double farthest_m = 0.0;
  for (const Eigen::Vector3d& p : free.points(before->contact.sample(0.5 * before->contact.duration()).position_rad)) {
    double nearest_m = 1.0;
    for (const Eigen::Vector3d& end : ends) nearest_m = std::min(nearest_m, (p - end).norm());
    if (nearest_m <= farthest_m) continue;
    farthest_m = nearest_m;
    farthest_base = p;
  }
  ASSERT_GT(farthest_m, 0.05);
  pick.world.boxes.push_back(uprightBox(pick.T_map_base * farthest_base, {0.04, 0.04, 0.04}));
  pick.makeScene();
  ExactMotion blocked(*shippedArm(), pick, 0.01);
  blocked.setTarget(0);
  ASSERT_NE(blocked.complaint(before->contact, 0.0), "");
  const Result<PickPlan> after = pickFrom(pick, 0, config);
  ASSERT_TRUE(after) << after.failure().message;
  EXPECT_EQ(blocked.complaint(after->contact, 0.0), "");
}

TEST(MotionPlanner, WhatIsHeldMustNotTouchEither) {
  const PickWorld pick = oneBrick();
  PlanningContext context = pick.context();
  context.start_rad << 0.0, -1.5, 1.6, -1.67, -0.5 * M_PI, 0.0;
  ArmGoal goal;  // 15 cm over the brick
  goal.T_map_tip =
      pick.T_map_base * Eigen::Translation3d(0.85, 0.1, 0.35) * Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX());
  EXPECT_TRUE(makePlanner().planArm(context, goal));
  context.held = HeldBrick{Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 0.1)), pick.type.size_m};
  const Result<JointTrajectory> plan = makePlanner().planArm(context, goal);
  EXPECT_EQ(plan.failure().status, PlanStatus::kGoalInCollision) << plan.failure().message;
  EXPECT_THAT(plan.failure().message, HasSubstr("brick"));
}

TEST(MotionPlanner, GivesUpAfterTheIterationsAllowed) {
  // A plate stands in the way of the swing; one iteration does not lead round it.
  PickWorld pick = emptyPickWorld();
  PlanningContext context = pick.context();
  context.start_rad << -0.8, -1.2, 1.2, -0.5 * M_PI, -0.5 * M_PI, 0.0;
  ArmGoal goal;
  goal.joints_rad = context.start_rad;
  (*goal.joints_rad)[0] = 0.8;
  ArmVector middle = context.start_rad;
  middle[0] = 0.0;
  OrientedBox plate;
  plate.T_map_box = pick.T_map_base * Eigen::Translation3d(shippedArm()->tipPose(middle).translation());
  plate.size_m = {0.3, 0.05, 0.3};
  pick.world.boxes.push_back(plate);
  pick.makeScene();
  context.scene = pick.scene;
  MotionPlannerConfig config;
  EXPECT_TRUE(makePlanner(config).planArm(context, goal));
  config.planner.max_iterations = 1;
  const Result<JointTrajectory> few = makePlanner(config).planArm(context, goal);
  EXPECT_EQ(few.failure().status, PlanStatus::kIterations) << few.failure().message;
  EXPECT_THAT(few.failure().message, HasSubstr("1 iterations"));
}

TEST(MotionPlanner, HeldBrickStaysLevelUnlessToldOtherwise) {
  PickWorld pick = oneBrick();
  PlanningContext context = pick.context();
  context.start_rad << 0.0, -1.5, 1.6, -1.67, -0.5 * M_PI, 0.0;  // before the robot, tool down
  context.held = HeldBrick{Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 0.1)), pick.type.size_m};
  ArmGoal goal;
  goal.joints_rad = context.start_rad;
  (*goal.joints_rad)[3] += 0.8;
  const Result<JointTrajectory> tilted = makePlanner().planArm(context, goal);
  EXPECT_EQ(tilted.failure().status, PlanStatus::kConstraint) << tilted.failure().message;
  EXPECT_THAT(tilted.failure().message, HasSubstr("tilts what is carried by 45"));
  goal.keep_level = false;
  EXPECT_TRUE(makePlanner().planArm(context, goal));
  // A start that is tilted already.
  goal.keep_level = true;
  context.start_rad = *goal.joints_rad;
  const Result<JointTrajectory> start = makePlanner().planArm(context, goal);
  EXPECT_EQ(start.failure().status, PlanStatus::kConstraint) << start.failure().message;
  EXPECT_THAT(start.failure().message, HasSubstr("at the start"));
}

TEST(MotionPlanner, PlacesWhatItHoldsOverTheContainer) {
  PickWorld pick = emptyPickWorld();
  pick.makeScene();
  PlanningContext context = pick.context();
  context.start_rad << 0.0, -1.5, 1.6, -1.67, -0.5 * M_PI, 0.0;
  context.held = HeldBrick{Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 0.1)), pick.type.size_m};
  const Result<JointTrajectory> plan = makePlanner().planArm(context, pick.container(*shippedArm()).front());
  ASSERT_TRUE(plan) << plan.failure().message;
  ExactMotion exact(*shippedArm(), pick);
  exact.setHeld(context.held);
  EXPECT_EQ(exact.complaint(*plan, 0.0), "");
  const Eigen::Vector3d up_tip(0.0, 0.0, -1.0);  // the tool looks down
  for (double t = 0.0; t < plan->duration(); t += 0.01) {
    EXPECT_LE(tiltOf(up_tip, plan->sample(t).position_rad), MotionPlannerConfig().pick.max_tilt_rad);
  }
}

/// A camera that looks down on the place before the robot.
ViewFrustum cameraView() {
  const ArmKinematics& arm = *shippedArm();
  ViewFrustum view;
  view.T_base_camera =
      arm.robot().framePose(mp700_ur5e_description::kColorFrame, arm.robotPositions(ArmVector::Zero()));
  view.half_width_rad = 0.547;
  view.half_height_rad = 0.429;
  view.max_range_m = 3.0;
  return view;
}

/// Whether a point of the arm is imaged.
bool isSeen(const ViewFrustum& view, const std::vector<Eigen::Vector3d>& points_base) {
  return std::any_of(points_base.begin(), points_base.end(), [&](const Eigen::Vector3d& p_base) {
    const Eigen::Vector3d p = view.T_base_camera.inverse() * p_base;
    return p.z() > 0.0 && p.z() < view.max_range_m && std::abs(p.x()) < p.z() * std::tan(view.half_width_rad) &&
           std::abs(p.y()) < p.z() * std::tan(view.half_height_rad);
  });
}

TEST(MotionPlanner, InspectTakesTheFirstPostureOutOfView) {
  const PickWorld pick = oneBrick();
  const ViewFrustum view = cameraView();
  ArmVector reaching;
  reaching << 0.0, -1.2, 1.2, -1.57, -0.5 * M_PI, 0.0;
  ArmVector folded;
  folded << 0.56, -2.68, 2.85, -2.04, -1.92, 0.0;
  const ExactMotion exact(*shippedArm(), pick);
  ASSERT_TRUE(isSeen(view, exact.points(reaching)));
  ASSERT_FALSE(isSeen(view, exact.points(folded)));
  PlanningContext context = pick.context();
  context.start_rad << 0.0, -1.5, 1.6, -1.67, -0.5 * M_PI, 0.0;
  const Result<JointTrajectory> plan = makePlanner().planInspect(context, view, {reaching, folded, context.start_rad});
  ASSERT_TRUE(plan) << plan.failure().message;
  EXPECT_EQ(plan->points.back().position_rad, folded);
  EXPECT_EQ(exact.complaint(*plan, 0.0), "");
}

TEST(MotionPlanner, InspectFindsAPostureByItself) {
  const PickWorld pick = oneBrick();
  const ViewFrustum view = cameraView();
  const ExactMotion exact(*shippedArm(), pick);
  for (const bool is_holding : {false, true}) {
    PlanningContext context = pick.context();
    context.start_rad << 0.0, -1.5, 1.6, -1.67, -0.5 * M_PI, 0.0;
    if (is_holding) {
      context.held = HeldBrick{Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 0.1)), pick.type.size_m};
    }
    ExactMotion holding(*shippedArm(), pick);
    holding.setHeld(context.held);
    ASSERT_TRUE(isSeen(view, holding.points(context.start_rad)));
    const Result<JointTrajectory> plan = makePlanner().planInspect(context, view, {});
    ASSERT_TRUE(plan) << plan.failure().message;
    EXPECT_FALSE(isSeen(view, holding.points(plan->points.back().position_rad)));
    EXPECT_EQ(holding.complaint(*plan, 0.0), "");
  }
}

TEST(MotionPlanner, InspectSaysWhyThereIsNone) {
  const PickWorld pick = oneBrick();
  ViewFrustum view = cameraView();
  view.T_base_camera = Eigen::Translation3d(0.2, 0.0, 5.0) * Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX());
  view.max_range_m = 6.0;  // from above it sees all of the robot
  MotionPlannerConfig config;
  config.view.samples = 50;
  const Result<JointTrajectory> plan = makePlanner(config).planInspect(pick.context(), view, {pick.start_rad});
  EXPECT_EQ(plan.failure().status, PlanStatus::kConstraint);
  EXPECT_THAT(plan.failure().message, HasSubstr("1 postures given and 50 drawn: 51 in the camera's view"));
}

TEST(MotionPlanner, CancelledInAnyStageAtOnce) {
  const PickWorld pick = randomPile(2, 8);
  PlanningContext context = pick.context();
  std::size_t asked = 0;
  context.is_cancelled = [&] {
    ++asked;
    return false;
  };
  const auto plan = [&] {
    return makePlanner().planPick(context, pick.target(pick.open.back()), pick.container(*shippedArm())).plan;
  };
  plan();
  const std::size_t all = asked;
  ASSERT_GT(all, 10u);
  for (std::size_t after = 0; after < all; after += 1 + all / 12) {
    asked = 0;
    std::size_t since = 0;
    context.is_cancelled = [&] {
      since += asked >= after ? 1 : 0;
      return asked++ >= after;
    };
    const Result<PickPlan> cancelled = plan();
    EXPECT_EQ(cancelled.failure().status, PlanStatus::kCancelled) << after << " of " << all;
    EXPECT_LE(since, 200u);  // asked again only on the way out
  }
}

TEST(MotionPlanner, RefusesImpossibleConfigurations) {
  MotionPlannerConfig config;
  config.speed.velocity_scale = 2.0;
  config.planner.range_rad = 0.0;
  config.pick.yaw_samples = 0;
  EXPECT_THAT(interactive_mapping::problemsOf(config),
              ElementsAre(HasSubstr("search/range_rad = 0 rad, must be in"), HasSubstr("motion/velocity_scale = 2"),
                          HasSubstr("pick/yaw_samples = 0")));
  EXPECT_THROW(makePlanner(config), std::invalid_argument);
  EXPECT_THROW(MotionPlanner(nullptr, testSectors(), {}), std::invalid_argument);
}

}  // namespace
}  // namespace motion_planning
