// SPDX-License-Identifier: BSD-3-Clause
// Node motion_planning among topics: every outcome, what it follows, its path monitor, bad input.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <map>
#include <stdexcept>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <interactive_mapping_common/testing/process.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_common_ros/testing/tuning.h>
#include <interactive_mapping_msgs/BrickFace.h>
#include <motion_planning/arm_kinematics.h>
#include <visualization_msgs/MarkerArray.h>

#include "planning_client.h"

namespace integration_tests {
namespace {

using node_tests::Process;

using interactive_mapping_msgs::AttachedBrick;
using interactive_mapping_msgs::BrickFace;
using motion_planning::OrientedBox;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
const std::string kDescription = MP700_UR5E_DESCRIPTION_DIR;
const ArmVector kStowed = mp700_ur5e_description::loadArmPose(kDescription + "/config/arm_poses/stowed.yaml");
const Eigen::Vector3d kBrickSize(0.30, 0.20, 0.20);

/// A brick before the robot, its long side across, on a ground; the robot at the origin.
OrientedBox brickBefore(double x_m, double y_m = 0.0, double z_m = 0.10) {
  OrientedBox box = motion_planning::uprightBox({x_m, y_m, z_m}, kBrickSize);
  box.T_map_box.rotate(Eigen::AngleAxisd(M_PI / 2.0, Eigen::Vector3d::UnitZ()));
  return box;
}

BoxWorld worldOf(const std::vector<OrientedBox>& boxes) {
  BoxWorld world;
  world.ground_z_m = 0.0;
  world.boxes = boxes;
  return world;
}

geometry_msgs::PoseStamped toPose(const Eigen::Isometry3d& T, const std::string& frame = "map") {
  geometry_msgs::PoseStamped pose;
  pose.header.frame_id = frame;
  pose.pose = interactive_mapping_ros::toPose(T);
  return pose;
}

PlanPickGoal pickOf(const OrientedBox& brick) {
  PlanPickGoal goal;
  goal.brick_id = 3;
  goal.type = "brick";
  goal.brick = toPose(brick.T_map_box);
  goal.faces = {BrickFace::PLUS_Z};
  return goal;
}

ArmGoalMessage toJoints(const ArmVector& joints_rad) {
  ArmGoalMessage goal;
  goal.kind = ArmGoalMessage::JOINTS;
  goal.joints.assign(joints_rad.data(), joints_rad.data() + 6);
  return goal;
}

PlanArmGoal armTo(const ArmGoalMessage& goal) {
  PlanArmGoal message;
  message.goals.push_back(goal);
  return message;
}

class PlanningNode : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    robot_ = new TopicRobot(kStowed);
    client_ = new PlanningClient;
    robot_->setWorld(worldOf({kBrick}));
    ASSERT_TRUE(client_->connect());
    // Joint states and tf need a moment to be heard.
    ASSERT_TRUE(
        waitUntil([] { return client_->plan(armTo(toJoints(kStowed))).outcome.status == PlanOutcome::SUCCESS; }));
  }
  static void TearDownTestSuite() {
    delete client_;
    delete robot_;
  }
  void SetUp() override { update_ = setWorld(worldOf({kBrick})); }

  /// Waits until the planner has heard of it: its result says which map it planned in.
  static std::uint64_t setWorld(const BoxWorld& world) {
    const std::uint64_t update = robot_->setWorld(world);
    EXPECT_TRUE(waitUntil([update] { return client_->plan(armTo(toJoints(kStowed))).map_update == update; }));
    return update;
  }

  static std::string nameOf(const PlanOutcome& outcome) {
    return std::to_string(outcome.status) + " '" + outcome.message + "'";
  }
  template <typename Goal>
  static void expectOutcome(const Goal& goal, std::uint8_t status, const std::string& part) {
    const PlanOutcome outcome = client_->plan(goal).outcome;
    EXPECT_EQ(static_cast<int>(outcome.status), static_cast<int>(status)) << nameOf(outcome);
    EXPECT_PRED2(has, outcome.message, part);
  }

  /// Published until the planner follows: `holds` says what it is to think.
  static void attach(const AttachedBrick& brick, std::uint8_t expected_pick) {
    robot_->setAttached(brick);
    EXPECT_TRUE(waitUntil([&] { return client_->plan(pickOf(kBrick)).outcome.status == expected_pick; }))
        << nameOf(client_->plan(pickOf(kBrick)).outcome);
  }

  static inline const OrientedBox kBrick = brickBefore(0.75);
  static inline TopicRobot* robot_ = nullptr;
  static inline PlanningClient* client_ = nullptr;
  std::uint64_t update_{0};
};

TEST_F(PlanningNode, PlansAPickFromWhereTheArmIs) {
  const PlanPickResult result = client_->plan(pickOf(kBrick));
  ASSERT_EQ(static_cast<int>(result.outcome.status), static_cast<int>(PlanOutcome::SUCCESS)) << nameOf(result.outcome);
  EXPECT_EQ(client_->pick.getState(), actionlib::SimpleClientGoalState::SUCCEEDED);
  EXPECT_EQ(result.map_update, update_);
  EXPECT_EQ(static_cast<int>(result.face), static_cast<int>(BrickFace::PLUS_Z));
  EXPECT_EQ(result.cost, 0.0) << "real time costs what it costs";
  EXPECT_GT(result.wall_ms, 0.0F);
  // The magnet comes from above on to the top's plate.
  EXPECT_EQ(result.contact.header.frame_id, "map");
  EXPECT_NEAR(result.contact.pose.position.z, 0.20, 1e-6);
  EXPECT_LT(std::hypot(result.contact.pose.position.x - 0.75, result.contact.pose.position.y), 0.085);
  // One after the other, from here.
  const auto* before = &result.approach;
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(before->points.front().positions[static_cast<std::size_t>(i)], kStowed[i], 1e-9);
  }
  for (const auto* after : {&result.touch, &result.lift, &result.stow}) {
    ASSERT_FALSE(after->points.empty());
    EXPECT_EQ(before->points.back().positions, after->points.front().positions);
    before = after;
  }
  // The brick hangs by its top: half its height below the tip.
  EXPECT_NEAR(result.held.position.z, 0.10, 1e-6);
}

double fastestJoint(const trajectory_msgs::JointTrajectory& trajectory) {
  double fastest_rad_s = 0.0;
  for (const auto& point : trajectory.points) {
    for (const double velocity_rad_s : point.velocities) {
      fastest_rad_s = std::max(fastest_rad_s, std::abs(velocity_rad_s));
    }
  }
  return fastest_rad_s;
}

TEST_F(PlanningNode, AnotherShareOfSpeedHoldsForTheNextPlan) {
  const std::string server = "/motion_planning/tune";
  const std::map<std::string, std::pair<double, double>> ranges{{"velocity_scale", {0.01, 1.0}}};
  EXPECT_EQ(node_tests::liveFieldsOf(server), ranges);
  constexpr double kLimit_rad_s = 3.1416;  // of every joint in the URDF
  ArmVector away = kStowed;
  away[5] += 0.5;
  const PlanArmGoal goal = armTo(toJoints(away));
  EXPECT_GT(fastestJoint(client_->plan(goal).trajectory), 0.2 * kLimit_rad_s) << "or it would show nothing";
  node_tests::tune(server, "{velocity_scale: 0.1}");
  PlanArmResult slow = client_->plan(goal);
  ASSERT_EQ(static_cast<int>(slow.outcome.status), static_cast<int>(PlanOutcome::SUCCESS)) << nameOf(slow.outcome);
  EXPECT_LE(fastestJoint(slow.trajectory), 0.1 * kLimit_rad_s + 1e-9);
  EXPECT_GT(fastestJoint(slow.trajectory), 0.099 * kLimit_rad_s);
  // Refused: as before.
  EXPECT_EQ(node_tests::askForNumbers(server, {{"velocity_scale", 1.5}}).at("velocity_scale"), 0.1);
  slow = client_->plan(goal);
  EXPECT_LE(fastestJoint(slow.trajectory), 0.1 * kLimit_rad_s + 1e-9);
  EXPECT_EQ(node_tests::askForNumbers(server, {{"velocity_scale", 0.35}}).at("velocity_scale"), 0.35);
}

TEST_F(PlanningNode, ImpossibleRequestsAreRefusedWithTheReason) {
  const auto spoiled = [](const std::function<void(PlanPickGoal&)>& spoil) {
    PlanPickGoal goal = pickOf(kBrick);
    spoil(goal);
    return goal;
  };
  using Outcome = PlanOutcome;
  expectOutcome(spoiled([](auto& goal) { goal.type = "boulder"; }), Outcome::BAD_REQUEST, "boulder");
  expectOutcome(spoiled([](auto& goal) { goal.faces.clear(); }), Outcome::BAD_REQUEST, "face");
  expectOutcome(spoiled([](auto& goal) { goal.faces = {6}; }), Outcome::BAD_REQUEST, "face 6, must be in [0, 5]");
  expectOutcome(spoiled([](auto& goal) {
                  goal.faces = {BrickFace::PLUS_Z, BrickFace::PLUS_Z};
                }),
                Outcome::BAD_REQUEST, "face +z is given twice");
  expectOutcome(spoiled([](auto& goal) { goal.faces.assign(7, BrickFace::PLUS_Z); }), Outcome::BAD_REQUEST,
                "7 faces to try, must be at most 6");
  expectOutcome(spoiled([](auto& goal) { goal.brick.pose.position.x = kNan; }), Outcome::BAD_REQUEST, "not finite");
  expectOutcome(spoiled([](auto& goal) { goal.brick.pose.orientation.w = 9.0; }), Outcome::BAD_REQUEST, "no rotation");
  expectOutcome(spoiled([](auto& goal) { goal.brick.header.frame_id = "nowhere"; }), Outcome::BAD_REQUEST, "nowhere");
  expectOutcome(spoiled([](auto& goal) { goal.start = {1.0, 2.0}; }), Outcome::BAD_REQUEST, "must be 6");
  expectOutcome(spoiled([](auto& goal) { goal.stow.emplace_back().posture = "asleep"; }), Outcome::BAD_REQUEST,
                "must be one of: ");
  expectOutcome(spoiled([](auto& goal) { goal.stow.emplace_back().kind = 9; }), Outcome::BAD_REQUEST, "kind = 9");
  expectOutcome(PlanArmGoal(), Outcome::BAD_REQUEST, "no goals");
  ArmGoalMessage place;
  place.kind = ArmGoalMessage::PLACE;
  place.place_frame = "magnet_tip";  // moves with the arm
  expectOutcome(armTo(place), Outcome::BAD_REQUEST, "must be a link fixed to base_link: ");
  expectOutcome(armTo(place), Outcome::BAD_REQUEST, ", container_place_1, ");
}

TEST_F(PlanningNode, GoalsThatCannotBeReachedSayWhy) {
  using Outcome = PlanOutcome;
  expectOutcome(pickOf(brickBefore(3.0)), Outcome::OUTSIDE_SECTOR, "");
  ArmGoalMessage far;
  far.kind = ArmGoalMessage::TIP;
  far.tip = toPose(Eigen::Isometry3d(Eigen::Translation3d(4.0, 0.0, 0.5)));
  expectOutcome(armTo(far), Outcome::NO_IK, "");
  // The arm stretched ahead and down: through brick and ground.
  ArmVector down = kStowed;
  down.head<3>() << 0.0, 0.6, 0.2;
  expectOutcome(armTo(toJoints(down)), Outcome::GOAL_IN_COLLISION, "");
  PlanArmGoal from_there = armTo(toJoints(kStowed));
  from_there.start.assign(down.data(), down.data() + 6);
  expectOutcome(from_there, Outcome::START_IN_COLLISION, "");
  from_there.start[5] = 7.0;
  expectOutcome(from_there, Outcome::OUTSIDE_LIMITS, "start: wrist_3_joint = 7.000 rad, must be in");
  ArmVector beyond = kStowed;
  beyond[2] = -3.5;
  expectOutcome(armTo(toJoints(beyond)), Outcome::OUTSIDE_LIMITS, "goal posture: elbow_joint = -3.500 rad");
}

TEST_F(PlanningNode, AMapWithoutSurfaceIsPlannedIn) {
  BoxWorld nothing;
  nothing.ground_z_m.reset();
  const auto expectPlans = [](const std::string& what) {
    const PlanPickResult result = client_->plan(pickOf(kBrick));
    EXPECT_EQ(static_cast<int>(result.outcome.status), static_cast<int>(PlanOutcome::SUCCESS))
        << what << ": " << nameOf(result.outcome);
  };
  setWorld(nothing);
  expectPlans("no triangle");
  const auto setSpoiled = [](const std::function<void(interactive_mapping_msgs::SurfaceMesh&)>& spoil) {
    const std::uint64_t update = robot_->setWorld(worldOf({kBrick}), spoil);
    EXPECT_TRUE(waitUntil([update] { return client_->plan(armTo(toJoints(kStowed))).map_update == update; }));
  };
  setSpoiled([](auto& mesh) {
    for (auto& vertex : mesh.mesh.vertices) vertex.z = kNan;
  });
  expectPlans("no vertex is a number");
  setSpoiled([](auto& mesh) {
    for (auto& triangle : mesh.mesh.triangles) triangle.vertex_indices[1] = triangle.vertex_indices[0];
  });
  expectPlans("no triangle has area");
  // One without a normal for each vertex is no mesh: the planner says so and does not plan in the one before.
  robot_->setWorld(worldOf({kBrick}), [](auto& mesh) { mesh.normals.clear(); });
  PlanOutcome outcome;
  EXPECT_TRUE(waitUntil([&] {
    outcome = client_->plan(pickOf(kBrick)).outcome;
    return outcome.status == PlanOutcome::NO_MAP;
  })) << nameOf(outcome);
  EXPECT_PRED2(has, outcome.message, "numbers in normals, must be 3 x");
}

TEST_F(PlanningNode, TheMeshIsFetchedForAPlanIfTheMapHasChanged) {
  const PlanArmGoal goal = armTo(toJoints(kStowed));
  client_->plan(goal);
  const int fetched = robot_->numMeshes();
  client_->plan(goal);
  EXPECT_EQ(robot_->numMeshes(), fetched);
  // Nobody plans or watches: nobody needs it.
  const std::uint64_t newest = robot_->setWorld(worldOf({kBrick}));
  EXPECT_EQ(robot_->numMeshes(), fetched);
  EXPECT_EQ(client_->plan(goal).map_update, newest);
  EXPECT_EQ(robot_->numMeshes(), fetched + 1);
}

TEST_F(PlanningNode, AGoalMayAskForAMapThatIsNewEnough) {
  PlanPickGoal goal = pickOf(kBrick);
  goal.min_map_stamp = robot_->mapStamp();
  const PlanPickResult now = client_->plan(goal);
  EXPECT_EQ(static_cast<int>(now.outcome.status), static_cast<int>(PlanOutcome::SUCCESS)) << nameOf(now.outcome);
  EXPECT_EQ(now.map_update, update_);

  // One that comes while the goal waits.
  goal.min_map_stamp = ros::Time::now();
  client_->pick.sendGoal(goal);
  ASSERT_TRUE(waitUntil([] { return client_->pick.getState() == actionlib::SimpleClientGoalState::ACTIVE; }));
  const std::uint64_t newer = robot_->setWorld(worldOf({kBrick}));
  ASSERT_TRUE(waitUntil([] { return client_->pick.getState().isDone(); }));
  const PlanPickResult waited = *client_->pick.getResult();
  EXPECT_EQ(static_cast<int>(waited.outcome.status), static_cast<int>(PlanOutcome::SUCCESS)) << nameOf(waited.outcome);
  EXPECT_EQ(waited.map_update, newer);

  // None comes: what there is and what was asked for.
  const auto stampOf = [](const ros::Time& stamp) {
    char text[32];
    std::snprintf(text, sizeof(text), "%.3f s", stamp.toSec());
    return std::string(text);
  };
  PlanArmGoal arm = armTo(toJoints(kStowed));
  arm.min_map_stamp = robot_->mapStamp() + ros::Duration(0.001);
  const ros::Time asked = ros::Time::now();
  expectOutcome(arm, PlanOutcome::NO_MAP,
                "the map's newest image is of " + stampOf(robot_->mapStamp()) + ", asked for is one of " +
                    stampOf(arm.min_map_stamp) + " or later (waited 2.000 s, state/map_wait_s)");
  EXPECT_GE((ros::Time::now() - asked).toSec(), 2.0);

  // Waiting can be cancelled.
  goal.min_map_stamp = ros::Time::now() + ros::Duration(600.0);
  client_->pick.sendGoal(goal);
  ASSERT_TRUE(waitUntil([] { return client_->pick.getState() == actionlib::SimpleClientGoalState::ACTIVE; }));
  client_->pick.cancelGoal();
  ASSERT_TRUE(waitUntil([] { return client_->pick.getState().isDone(); }));
  ASSERT_TRUE(client_->pick.getState() == actionlib::SimpleClientGoalState::PREEMPTED);
  const PlanPickResult cancelled = *client_->pick.getResult();
  EXPECT_EQ(static_cast<int>(cancelled.outcome.status), static_cast<int>(PlanOutcome::CANCELLED));
  EXPECT_LT(cancelled.wall_ms, 1900.0F) << "it waited for the map instead";
}

TEST_F(PlanningNode, ALaterGoalIsTriedWhenTheFirstCannotBeReached) {
  ArmGoalMessage far;
  far.kind = ArmGoalMessage::TIP;
  far.tip = toPose(Eigen::Isometry3d(Eigen::Translation3d(4.0, 0.0, 0.5)));
  PlanArmGoal goal = armTo(far);
  ArmGoalMessage stowed;
  stowed.posture = "stowed";
  goal.goals.push_back(stowed);
  const PlanArmResult result = client_->plan(goal);
  EXPECT_EQ(static_cast<int>(result.outcome.status), static_cast<int>(PlanOutcome::SUCCESS)) << nameOf(result.outcome);
  EXPECT_EQ(result.goal, 1);
}

TEST_F(PlanningNode, GoalsInOtherFramesFollowTf) {
  Eigen::Isometry3d T_map_base = Eigen::Isometry3d::Identity();
  T_map_base.translation() << 0.0, 0.05, 0.0;
  robot_->setBase(T_map_base);
  PlanPickGoal goal = pickOf(kBrick);
  goal.brick = toPose(T_map_base.inverse() * kBrick.T_map_box, "base_link");
  PlanPickResult result;
  EXPECT_TRUE(waitUntil([&] {
    result = client_->plan(goal);
    return result.outcome.status == PlanOutcome::SUCCESS && std::abs(result.contact.pose.position.y) < 0.085;
  })) << nameOf(result.outcome);
  robot_->setBase(Eigen::Isometry3d::Identity());
}

TEST_F(PlanningNode, GoalsInOtherFramesAreTakenAtTheirStamp) {
  Eigen::Isometry3d T_map_base_then = Eigen::Isometry3d::Identity();
  T_map_base_then.translation() << -0.2, 0.0, 0.0;
  robot_->setBase(T_map_base_then);
  const ros::Time then = robot_->awaitState();
  robot_->setBase(Eigen::Isometry3d::Identity());
  robot_->awaitState();
  const auto expectPicked = [](const PlanPickGoal& goal, const std::string& what) {
    PlanPickResult result;
    // The first plans may find the base on its way, or the scene with it.
    EXPECT_TRUE(waitUntil([&] {
      result = client_->plan(goal);
      return result.outcome.status == PlanOutcome::SUCCESS || result.outcome.status == PlanOutcome::BAD_REQUEST;
    }));
    EXPECT_EQ(static_cast<int>(result.outcome.status), static_cast<int>(PlanOutcome::SUCCESS))
        << what << ": " << nameOf(result.outcome);
    EXPECT_NEAR(result.contact.pose.position.x, 0.75, 0.085) << what;  // on the plate, 20 cm from where it is not
  };
  PlanPickGoal goal = pickOf(kBrick);
  goal.brick = toPose(T_map_base_then.inverse() * kBrick.T_map_box, "base_link");
  goal.brick.header.stamp = then;
  expectPicked(goal, "seen from where the base was");
  goal.brick = toPose(kBrick.T_map_box, "base_link");
  goal.brick.header.stamp = ros::Time::now() + ros::Duration(0.1);
  expectPicked(goal, "tf has it in a moment");
  goal.brick.header.stamp = ros::Time();
  expectPicked(goal, "tf's newest");
  goal.brick = toPose(kBrick.T_map_box);
  goal.brick.header.stamp = ros::Time::now() + ros::Duration(60.0);
  expectPicked(goal, "in the map's own frame no stamp matters");

  // What tf does not have, any more or yet: its memory is 10 s.
  goal.brick.header.frame_id = "base_link";
  for (const double later_s : {-60.0, 60.0}) {
    goal.brick.header.stamp = ros::Time::now() + ros::Duration(later_s);
    char stamp[32];
    std::snprintf(stamp, sizeof(stamp), "%.3f s", goal.brick.header.stamp.toSec());
    expectOutcome(
        goal, PlanOutcome::BAD_REQUEST,
        std::string("brick: no pose of frame 'base_link' in map at its stamp, ") + stamp + ", tf has it up to ");
  }
}

TEST_F(PlanningNode, TheArmLeavesTheCamerasView) {
  PlanArmGoal goal;
  goal.inspect = 1;
  // Stretched out before the camera.
  ArmVector start = kStowed;
  start.head<3>() << 0.0, -0.9, 0.9;
  goal.start.assign(start.data(), start.data() + 6);
  const PlanArmResult result = client_->plan(goal);
  ASSERT_EQ(static_cast<int>(result.outcome.status), static_cast<int>(PlanOutcome::SUCCESS)) << nameOf(result.outcome);
  EXPECT_GE(result.trajectory.points.size(), 2u);
}

TEST_F(PlanningNode, CancelledGoalsEndAsCancelled) {
  client_->pick.sendGoal(pickOf(kBrick));
  client_->pick.cancelGoal();
  ASSERT_TRUE(waitUntil([] { return client_->pick.getState().isDone(); }));
  // It may have been ready before it heard; and a cancellation that overtakes its goal is answered by actionlib itself,
  // with an empty result.
  if (client_->pick.getState() == actionlib::SimpleClientGoalState::PREEMPTED) {
    EXPECT_EQ(static_cast<int>(client_->pick.getResult()->outcome.status), static_cast<int>(PlanOutcome::CANCELLED));
  } else {
    EXPECT_TRUE(client_->pick.getState() == actionlib::SimpleClientGoalState::SUCCEEDED ||
                client_->pick.getState() == actionlib::SimpleClientGoalState::RECALLED);
  }
  // Two clients: the newer goal is the one that counts.
  PlanningClient other;
  ASSERT_TRUE(other.connect());
  client_->pick.sendGoal(pickOf(kBrick));
  const PlanPickResult newer = other.plan(pickOf(kBrick));
  EXPECT_EQ(static_cast<int>(newer.outcome.status), static_cast<int>(PlanOutcome::SUCCESS)) << nameOf(newer.outcome);
  EXPECT_TRUE(waitUntil([] { return client_->pick.getState().isDone(); }));
}

TEST_F(PlanningNode, WhatTheMagnetHoldsIsPartOfTheRobot) {
  AttachedBrick brick;
  brick.header.frame_id = "ur5e_tool0";
  brick.header.stamp = ros::Time::now();
  brick.is_attached = 1;
  brick.id = 3;
  brick.type = "brick";
  brick.size.x = 0.30;
  brick.size.y = brick.size.z = 0.20;
  brick.pose.position.z = 0.20;  // 0.10 m magnet, half a brick
  brick.pose.orientation.w = 1.0;
  // Held over the deck's front, from where it can go on.
  ArmVector holding = kStowed;
  holding.head<4>() << 0.0, -1.4, 1.5, -M_PI / 2.0 - 0.1;
  robot_->setArm(holding);
  attach(brick, PlanOutcome::BAD_REQUEST);
  expectOutcome(pickOf(kBrick), PlanOutcome::BAD_REQUEST, "holds brick 3");
  // While it is carried away the next one may be planned, from where that ends.
  PlanPickGoal next = pickOf(kBrick);
  next.after_let_go = 1;
  next.start.assign(kStowed.data(), kStowed.data() + 6);
  const PlanPickResult planned = client_->plan(next);
  ASSERT_EQ(static_cast<int>(planned.outcome.status), static_cast<int>(PlanOutcome::SUCCESS))
      << nameOf(planned.outcome);
  EXPECT_EQ(planned.approach.points.front().positions, next.start);
  ArmGoalMessage place;
  place.kind = ArmGoalMessage::PLACE;
  place.place_frame = "container_place_1";
  const PlanArmResult placed = client_->plan(armTo(place));
  EXPECT_EQ(static_cast<int>(placed.outcome.status), static_cast<int>(PlanOutcome::SUCCESS)) << nameOf(placed.outcome);
  // Where the tip alone could be, the brick would be in the ground.
  ArmGoalMessage low;
  low.kind = ArmGoalMessage::TIP;
  Eigen::Isometry3d T_map_tip(Eigen::Translation3d(0.75, -0.4, 0.12));
  T_map_tip.rotate(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
  low.tip = toPose(T_map_tip);
  expectOutcome(armTo(low), PlanOutcome::GOAL_IN_COLLISION, "brick");

  // What cannot be: no plan goes on as if nothing were held.
  AttachedBrick bad = brick;
  bad.header.frame_id = "chassis_link";
  attach(bad, PlanOutcome::NO_ROBOT_STATE);
  expectOutcome(armTo(toJoints(kStowed)), PlanOutcome::NO_ROBOT_STATE, "not fixed to magnet_tip");
  bad = brick;
  bad.size.x = -1.0;
  attach(bad, PlanOutcome::NO_ROBOT_STATE);
  bad = brick;
  bad.size.y = 0.61;  // bricks have edges of up to 0.30 m
  attach(bad, PlanOutcome::NO_ROBOT_STATE);
  expectOutcome(armTo(toJoints(kStowed)), PlanOutcome::NO_ROBOT_STATE,
                "its longest edge is 0.610 m, must be at most 0.600 m");
  bad.size.y = 0.60;
  attach(bad, PlanOutcome::BAD_REQUEST);
  robot_->setArm(kStowed);
  attach(AttachedBrick(), PlanOutcome::SUCCESS);
}

TEST_F(PlanningNode, AMapThatDoesNotAnswerIsNoMap) {
  robot_->refuseQueries("out of order");
  robot_->setWorld(worldOf({kBrick, brickBefore(0.75, 0.35)}));  // another surface: it has to ask
  PlanOutcome outcome;
  EXPECT_TRUE(waitUntil([&] {
    outcome = client_->plan(pickOf(kBrick)).outcome;
    return outcome.status == PlanOutcome::NO_MAP;
  })) << nameOf(outcome);
  EXPECT_PRED2(has, outcome.message, "out of order");
  robot_->refuseQueries("");
  EXPECT_TRUE(waitUntil([&] { return client_->plan(pickOf(kBrick)).outcome.status == PlanOutcome::SUCCESS; }));
}

TEST_F(PlanningNode, WithoutMapOrJointStatesNothingIsPlanned) {
  PlanningClient blind("/blind");
  ASSERT_TRUE(blind.connect());
  const PlanOutcome no_map = blind.plan(pickOf(kBrick)).outcome;
  EXPECT_EQ(static_cast<int>(no_map.status), static_cast<int>(PlanOutcome::NO_MAP)) << nameOf(no_map);
  EXPECT_PRED2(has, no_map.message, "no service /nowhere/get_mesh");
  PlanningClient numb("/numb");
  ASSERT_TRUE(numb.connect());
  const PlanOutcome no_arm = numb.plan(pickOf(kBrick)).outcome;
  EXPECT_EQ(static_cast<int>(no_arm.status), static_cast<int>(PlanOutcome::NO_ROBOT_STATE)) << nameOf(no_arm);
  EXPECT_PRED2(has, no_arm.message, "no joint state of shoulder_pan_joint has come on /nowhere/joint_states");
}

TEST_F(PlanningNode, TheMonitorCallsForAStopWhenSomethingComesIntoTheWay) {
  Latest<PathMonitorState> state("/motion_planning/path_monitor");
  const PlanPickResult plan = client_->plan(pickOf(kBrick));
  ASSERT_EQ(static_cast<int>(plan.outcome.status), static_cast<int>(PlanOutcome::SUCCESS)) << nameOf(plan.outcome);
  WatchTrajectory watch;
  watch.request.trajectory = plan.approach;
  watch.request.start = ros::Time::now() + ros::Duration(600.0);  // nobody moves it: the whole of it is still to come
  ASSERT_TRUE(call("/motion_planning/watch", watch));
  ASSERT_TRUE(watch.response.success) << watch.response.message;
  const std::uint32_t id = watch.response.watch_id;
  const PathMonitorState free = state.await([id](const PathMonitorState& s) { return s.watch_id == id; });
  EXPECT_TRUE(free.is_watching);
  EXPECT_FALSE(free.must_stop) << free.reason;
  EXPECT_GT(free.clearance, 0.0F);
  EXPECT_TRUE(std::isinf(free.time_to_contact));

  // Somebody puts a box where the tip goes.
  const Eigen::Vector3d at(plan.contact.pose.position.x, plan.contact.pose.position.y,
                           plan.contact.pose.position.z + 0.12);
  robot_->setWorld(worldOf({kBrick, motion_planning::uprightBox(at, {0.1, 0.1, 0.1})}));
  const PathMonitorState stop = state.await([](const PathMonitorState& s) { return s.must_stop != 0; });
  EXPECT_EQ(stop.watch_id, id);
  EXPECT_FALSE(stop.reason.empty());
  EXPECT_LT(stop.time_to_contact, plan.approach.points.back().time_from_start.toSec() + 600.0);
  // Gone again: a stop is a stop, until the next trajectory.
  setWorld(worldOf({kBrick}));
  const ros::Time since = ros::Time::now();
  const PathMonitorState later = state.await([since](const PathMonitorState& s) { return s.header.stamp > since; });
  EXPECT_TRUE(later.must_stop);
  ASSERT_TRUE(call("/motion_planning/watch", watch));
  const std::uint32_t next = watch.response.watch_id;
  EXPECT_NE(next, id);
  EXPECT_FALSE(state.await([next](const PathMonitorState& s) { return s.watch_id == next; }).must_stop);

  // One that ended long ago is refused, and what is watched goes on.
  WatchTrajectory late = watch;
  late.request.start = ros::Time::now() - ros::Duration(600.0);
  ASSERT_TRUE(call("/motion_planning/watch", late));
  EXPECT_FALSE(late.response.success);
  EXPECT_PRED2(has, late.response.message, "start is 600.0");
  char lasts[512];
  std::snprintf(lasts, sizeof(lasts), "ago, the trajectory lasts %.3f s: it has ended; watch %u continues",
                plan.approach.points.back().time_from_start.toSec(), next);
  EXPECT_PRED2(has, late.response.message, lasts);
  EXPECT_EQ(late.response.watch_id, next);
  // One that ends in a moment is not watched any more then.
  watch.request.start = ros::Time::now() - plan.approach.points.back().time_from_start + ros::Duration(0.5);
  ASSERT_TRUE(call("/motion_planning/watch", watch));
  EXPECT_TRUE(watch.response.success) << watch.response.message;
  state.await([](const PathMonitorState& s) { return s.is_watching == 0; });
  ASSERT_TRUE(call("/motion_planning/watch", late));
  EXPECT_FALSE(late.response.success);
  EXPECT_PRED2(has, late.response.message, "; nothing is watched");
  EXPECT_EQ(late.response.watch_id, 0u);
  // Neither is an empty one.
  watch.request.start = ros::Time();
  ASSERT_TRUE(call("/motion_planning/watch", watch));
  EXPECT_TRUE(watch.response.success) << watch.response.message;
  state.await([](const PathMonitorState& s) { return s.is_watching == 1; });
  watch.request.trajectory.points.clear();
  ASSERT_TRUE(call("/motion_planning/watch", watch));
  EXPECT_TRUE(watch.response.success);
  EXPECT_EQ(watch.response.watch_id, 0u);
  state.await([](const PathMonitorState& s) { return s.is_watching == 0; });
}

TEST_F(PlanningNode, TheMonitorCallsForAStopWhenItCannotGetTheNewestMap) {
  Latest<PathMonitorState> state("/motion_planning/path_monitor");
  const PlanPickResult plan = client_->plan(pickOf(kBrick));
  ASSERT_EQ(static_cast<int>(plan.outcome.status), static_cast<int>(PlanOutcome::SUCCESS)) << nameOf(plan.outcome);
  WatchTrajectory watch;
  watch.request.trajectory = plan.approach;
  watch.request.start = ros::Time::now() + ros::Duration(600.0);
  ASSERT_TRUE(call("/motion_planning/watch", watch));
  const std::uint32_t id = watch.response.watch_id;
  EXPECT_FALSE(state.await([id](const PathMonitorState& s) { return s.watch_id == id; }).must_stop);
  robot_->refuseQueries("out of order");
  robot_->setWorld(worldOf({kBrick, brickBefore(0.75, 0.35)}));  // somebody comes, and the map does not tell where
  EXPECT_PRED2(has, state.await([](const PathMonitorState& s) { return s.must_stop != 0; }).reason, "out of order");
  robot_->refuseQueries("");
  setWorld(worldOf({kBrick}));
  watch.request.trajectory.points.clear();
  ASSERT_TRUE(call("/motion_planning/watch", watch));
}

TEST_F(PlanningNode, TheMonitorLetsTheMagnetTouchItsTargetAlone) {
  Latest<PathMonitorState> state("/motion_planning/path_monitor");
  const PlanPickResult plan = client_->plan(pickOf(kBrick));
  ASSERT_EQ(static_cast<int>(plan.outcome.status), static_cast<int>(PlanOutcome::SUCCESS)) << nameOf(plan.outcome);
  WatchTrajectory watch;
  watch.request.trajectory = plan.touch;
  watch.request.start = ros::Time::now() + ros::Duration(600.0);
  ASSERT_TRUE(call("/motion_planning/watch", watch));
  std::uint32_t id = watch.response.watch_id;
  EXPECT_TRUE(state.await([&id](const PathMonitorState& s) { return s.watch_id == id; }).must_stop)
      << "the way to the plate ends on the plate";
  watch.request.phase = WatchTrajectory::Request::CONTACT;
  watch.request.target = toPose(kBrick.T_map_box);
  watch.request.target_size.x = 0.30;
  watch.request.target_size.y = watch.request.target_size.z = 0.20;
  ASSERT_TRUE(call("/motion_planning/watch", watch));
  ASSERT_TRUE(watch.response.success) << watch.response.message;
  id = watch.response.watch_id;
  const PathMonitorState touching = state.await([&id](const PathMonitorState& s) { return s.watch_id == id; });
  EXPECT_FALSE(touching.must_stop) << touching.reason;

  // Bad ones are refused, and the last one is watched on.
  WatchTrajectory bad = watch;
  bad.request.target_size.z = 0.0;
  ASSERT_TRUE(call("/motion_planning/watch", bad));
  EXPECT_FALSE(bad.response.success);
  EXPECT_PRED2(has, bad.response.message, "target_size");
  EXPECT_PRED2(has, bad.response.message, "; watch " + std::to_string(id) + " continues");
  EXPECT_EQ(bad.response.watch_id, id);
  bad = watch;
  bad.request.phase = 9;
  ASSERT_TRUE(call("/motion_planning/watch", bad));
  EXPECT_PRED2(has, bad.response.message, "phase = 9, must be in [0, 2]");
  bad = watch;
  bad.request.trajectory.points[0].positions.pop_back();
  ASSERT_TRUE(call("/motion_planning/watch", bad));
  EXPECT_PRED2(has, bad.response.message, "must be 6");
  const ros::Time since = ros::Time::now();
  EXPECT_EQ(state.await([since](const PathMonitorState& s) { return s.header.stamp > since; }).watch_id, id);
}

TEST_F(PlanningNode, RvizGetsSceneAndPlan) {
  Latest<visualization_msgs::MarkerArray> scene("/motion_planning/scene"), plan("/motion_planning/plan");
  const auto hasNamespace = [](const visualization_msgs::MarkerArray& array, const std::string& name) {
    for (const auto& marker : array.markers) {
      if (marker.ns == name && marker.action == visualization_msgs::Marker::ADD) return true;
    }
    return false;
  };
  // Markers are made while somebody looks: both sides have to know of each other first.
  EXPECT_TRUE(waitUntil([&] {
    robot_->setWorld(worldOf({kBrick}));
    return client_->plan(pickOf(kBrick)).outcome.status == PlanOutcome::SUCCESS && scene.hasCome() && plan.hasCome();
  }));
  scene.await([&](const auto& array) { return hasNamespace(array, "surface with margin"); });
  plan.await([&](const auto& array) {
    return hasNamespace(array, "path of the tip") && hasNamespace(array, "arms") && hasNamespace(array, "contact");
  });
  client_->plan(pickOf(brickBefore(3.0)));
  plan.await([&](const auto& array) { return hasNamespace(array, "failure"); });
}

TEST_F(PlanningNode, AnOldPlanLeavesRviz) {
  using visualization_msgs::MarkerArray;
  const auto isEmpty = [](const MarkerArray& array) {
    return std::none_of(array.markers.begin(), array.markers.end(),
                        [](const auto& marker) { return marker.action == visualization_msgs::Marker::ADD; });
  };
  ArmVector away = kStowed;
  away[5] += 0.5;
  const PlanArmGoal goal = armTo(toJoints(away));
  {
    Latest<MarkerArray> plan("/motion_planning/plan");
    const auto showPlan = [&] {
      EXPECT_TRUE(waitUntil([&] {
        bool is_shown = false;
        if (client_->plan(goal).outcome.status != PlanOutcome::SUCCESS || !plan.hasCome()) return false;
        plan.await([&](const MarkerArray& array) {
          is_shown = !isEmpty(array);
          return true;
        });
        return is_shown;
      }));
    };
    showPlan();
    robot_->setArm(away);  // carried out
    plan.await(isEmpty);
    robot_->setArm(kStowed);
    robot_->awaitState();
    showPlan();
    robot_->setBase(Eigen::Isometry3d(Eigen::Translation3d(0.2, 0.0, 0.0)));  // driven off without it
    plan.await(isEmpty);
    robot_->setBase(Eigen::Isometry3d::Identity());
    robot_->awaitState();
    showPlan();
  }
  // A plan that one rviz has shown is not shown to the next one after others were made.
  EXPECT_TRUE(waitUntil([&] {
    client_->plan(goal);
    Latest<MarkerArray> next("/motion_planning/plan");
    bool is_empty = false;
    next.await([&](const MarkerArray& array) {
      is_empty = isEmpty(array);
      return true;
    });
    return is_empty;
  }));
}

TEST_F(PlanningNode, DiagnosticsTellOfMapRobotAndPlans) {
  Latest<diagnostic_msgs::DiagnosticArray> diagnostics("/diagnostics");
  const auto tells = [](const std::string& name, const std::string& part) {
    return [name, part](const diagnostic_msgs::DiagnosticArray& array) {
      for (const auto& status : array.status) {
        if (status.name.find(name) != std::string::npos && status.message.find(part) != std::string::npos) return true;
      }
      return false;
    };
  };
  diagnostics.await(tells("motion_planning: map", "follows the map"));
  diagnostics.await(tells("motion_planning: robot", "arm and base are known"));
  diagnostics.await(tells("motion_planning: plans", "ready"));
  diagnostics.await(tells("blind: map", "the map has taken in no image"));
  diagnostics.await(tells("numb: robot", "no joint state"));
}

TEST(PlanningProcess, ANodeThatCannotWorkSaysWhyAndEnds) {
  const auto refusal = [](const std::string& name, const std::map<std::string, std::string>& params) {
    for (const auto& [key, value] : params) ros::param::set("/" + name + "/" + key, value);
    Process node({MOTION_PLANNING_NODE, "__name:=" + name}, std::string(::testing::TempDir()) + name + ".log");
    EXPECT_TRUE(waitUntil([&node] { return node.hasEnded(); })) << name;
    EXPECT_EQ(node.exitCode(), 1) << name;
    return node.output();
  };
  std::map<std::string, std::string> good;
  for (const char* key : {"bricks_file", "sectors_file", "postures_dir"}) {
    ASSERT_TRUE(ros::param::get(std::string("/motion_planning/") + key, good[key]));
  }
  EXPECT_PRED2(has, refusal("bare", {}), "bricks_file = '', must be the absolute path");
  std::map<std::string, std::string> bad = good;
  bad["postures_dir"] = "/nowhere/at/all";
  EXPECT_PRED2(has, refusal("no_postures", bad), "/nowhere/at/all");
  bad = good;
  bad["stow"] = "attic";
  EXPECT_PRED2(has, refusal("no_stow", bad), "stow = 'attic'");
  bad = good;
  bad["sectors_file"] = good["bricks_file"];
  EXPECT_PRED2(has, refusal("no_sectors", bad), "sectors_file = '" + good["bricks_file"] + "'");
  bad = good;
  bad["bricks_file"] = "/nowhere/bricks.yaml";
  EXPECT_PRED2(has, refusal("no_bricks", bad), "bricks_file = '/nowhere/bricks.yaml'");
}

TEST_F(PlanningNode, TheLogTellsWhatIsMissingAndOnceThatAllIsThere) {
  setenv("ROSCONSOLE_STDOUT_LINE_BUFFERED", "1", 1);  // the program's log is read while it runs
  for (const std::string key : {"bricks_file", "sectors_file", "postures_dir"}) {
    std::string value;
    ASSERT_TRUE(ros::param::get("/motion_planning/" + key, value));
    ros::param::set(std::string("/late/").append(key), value);
  }
  Latest<diagnostic_msgs::DiagnosticArray> diagnostics("/diagnostics");
  Process node({MOTION_PLANNING_NODE, "__name:=late", "map/update:=/late/update", "map/get_mesh:=/map/get_mesh",
                "map/query:=/map/query", "joint_states:=/late/joint_states"},
               std::string(::testing::TempDir()) + "late.log");
  const std::string missing =
      "motion_planning is not ready: no joint state of shoulder_pan_joint has come on /late/joint_states; the map "
      "has taken in no image (/late/update)";
  ASSERT_TRUE(waitUntil([&] { return has(node.output(), missing); }, 30.0)) << node.output();
  ros::NodeHandle nh;
  ros::Publisher joints = nh.advertise<sensor_msgs::JointState>("/late/joint_states", 10);
  ros::Publisher updates = nh.advertise<interactive_mapping_msgs::MapUpdate>("/late/update", 1, true);
  updates.publish(interactive_mapping_msgs::MapUpdate());
  EXPECT_FALSE(has(node.output(), "motion_planning is ready")) << "no joint state yet";
  const auto publishJoints = [&joints] {
    sensor_msgs::JointState state;
    state.header.stamp = ros::Time::now();
    state.name.assign(mp700_ur5e_description::kArmJoints.begin(), mp700_ur5e_description::kArmJoints.end());
    state.position.assign(kStowed.data(), kStowed.data() + 6);
    joints.publish(state);
  };
  const std::string ready = "motion_planning is ready: ";
  ASSERT_TRUE(waitUntil(
      [&] {
        publishJoints();
        return has(node.output(), ready);
      },
      30.0))
      << node.output();
  // Each look at what is there ends with diagnostics: some more of them, and no second line.
  const ros::Time since = ros::Time::now() + ros::Duration(2.5);
  diagnostics.await([&](const diagnostic_msgs::DiagnosticArray& array) {
    publishJoints();
    return array.header.stamp > since && !array.status.empty() && has(array.status.front().name, "late");
  });
  const std::string output = node.output();
  EXPECT_EQ(output.find(ready), output.rfind(ready)) << output;
  EXPECT_LT(output.rfind(missing), output.find(ready)) << output;
}

}  // namespace
}  // namespace integration_tests
