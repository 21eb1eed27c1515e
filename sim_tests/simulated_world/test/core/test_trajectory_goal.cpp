// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/trajectory_goal.h"

#include <cmath>
#include <functional>
#include <limits>

#include <gtest/gtest.h>

#include "arm_plant.h"

namespace simulated_world {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

std::vector<JointLimits> twoJoints() {
  return {{"pan", -6.0, 6.0, 3.0, 150.0}, {"lift", -2.0, 1.0, 1.0, 150.0}};
}

/// Two points, 1 s apart, in the order lift, pan: not the arm's.
TrajectoryGoal validGoal() {
  TrajectoryGoal goal;
  goal.id = "g";
  goal.joint_names = {"lift", "pan"};
  goal.points = {{{0.1, 0.2}, {0.3, 0.4}, {0.5, 0.6}, 1.0}, {{0.7, 0.8}, {}, {}, 2.0}};
  return goal;
}

GoalAnswer check(const TrajectoryGoal& goal, CheckedGoal* checked = nullptr) {
  CheckedGoal ignored;
  return checkGoal(goal, twoJoints(), {}, checked != nullptr ? checked : &ignored);
}

struct Refusal {
  const char* name;
  std::function<void(TrajectoryGoal&)> spoil;
  GoalError error;
  const char* text;  ///< a part of the answer
};

void PrintTo(const Refusal& refusal, std::ostream* stream) {
  *stream << refusal.name;
}

class TrajectoryGoalRefusal : public testing::TestWithParam<Refusal> {};

TEST_P(TrajectoryGoalRefusal, NamesTheReason) {
  TrajectoryGoal goal = validGoal();
  ASSERT_TRUE(check(goal).accepted);
  GetParam().spoil(goal);
  const GoalAnswer answer = check(goal);
  EXPECT_FALSE(answer.accepted);
  EXPECT_EQ(answer.error, GetParam().error);
  EXPECT_NE(answer.text.find(GetParam().text), std::string::npos) << answer.text;
}

INSTANTIATE_TEST_SUITE_P(
    Each, TrajectoryGoalRefusal,
    testing::Values(
        Refusal{"UnknownJoint", [](TrajectoryGoal& g) { g.joint_names[0] = "elbow"; }, GoalError::kInvalidJoints,
                "joint lift is missing, joint \"elbow\" is unknown"},
        Refusal{"ExtraJoint", [](TrajectoryGoal& g) { g.joint_names.emplace_back("elbow"); }, GoalError::kInvalidJoints,
                "\"elbow\" is unknown"},
        Refusal{"DoubledJoint", [](TrajectoryGoal& g) { g.joint_names.emplace_back("lift"); },
                GoalError::kInvalidJoints, "named twice"},
        Refusal{"MissingJoint", [](TrajectoryGoal& g) { g.joint_names.pop_back(); }, GoalError::kInvalidJoints,
                "joint pan is missing"},
        Refusal{"TooFewPositions", [](TrajectoryGoal& g) { g.points[1].positions_rad.pop_back(); },
                GoalError::kInvalidGoal, "point 1: number of positions must be the number of joints = 2"},
        Refusal{"NoPositions", [](TrajectoryGoal& g) { g.points[0].positions_rad.clear(); }, GoalError::kInvalidGoal,
                "point 0: number of positions"},
        Refusal{"TooManyVelocities", [](TrajectoryGoal& g) { g.points[0].velocities_rad_s.push_back(0.0); },
                GoalError::kInvalidGoal, "number of velocities"},
        Refusal{"TooFewAccelerations", [](TrajectoryGoal& g) { g.points[0].accelerations_rad_s2.pop_back(); },
                GoalError::kInvalidGoal, "number of accelerations"},
        Refusal{"PositionNaN", [](TrajectoryGoal& g) { g.points[0].positions_rad[1] = kNaN; }, GoalError::kInvalidGoal,
                "joint pan, point 0: position"},
        Refusal{"VelocityNaN", [](TrajectoryGoal& g) { g.points[0].velocities_rad_s[1] = kNaN; },
                GoalError::kInvalidGoal, "joint pan, point 0: velocity"},
        Refusal{"AccelerationInfinite", [](TrajectoryGoal& g) { g.points[0].accelerations_rad_s2[0] = kInfinity; },
                GoalError::kInvalidGoal, "joint lift, point 0: acceleration"},
        Refusal{"TimeNaN", [](TrajectoryGoal& g) { g.points[1].time_from_start_s = kNaN; }, GoalError::kInvalidGoal,
                "point 1: time_from_start"},
        Refusal{"TimeStandsStill", [](TrajectoryGoal& g) { g.points[1].time_from_start_s = 1.0; },
                GoalError::kInvalidGoal, "point 1: time_from_start = 1 s, must be greater than 1 s"},
        Refusal{"TimeNegative", [](TrajectoryGoal& g) { g.points[0].time_from_start_s = -0.1; },
                GoalError::kInvalidGoal, "point 0: time_from_start = -0.1 s, must be at least 0 s"},
        Refusal{"BelowLimit", [](TrajectoryGoal& g) { g.points[1].positions_rad[0] = -2.5; }, GoalError::kInvalidGoal,
                "joint lift, point 1: position = -2.5 rad, must be in [-2, 1] rad"},
        Refusal{"AboveLimit", [](TrajectoryGoal& g) { g.points[1].positions_rad[0] = 1.001; }, GoalError::kInvalidGoal,
                "joint lift, point 1: position = 1.001 rad"},
        Refusal{"VelocityOfPoint", [](TrajectoryGoal& g) { g.points[0].velocities_rad_s[0] = -1.1; },
                GoalError::kInvalidGoal, "joint lift, point 0: velocity = -1.1 rad/s, must be in [-1, 1] rad/s"},
        Refusal{"MeanVelocity", [](TrajectoryGoal& g) { g.points[1].time_from_start_s = 1.5; }, GoalError::kInvalidGoal,
                "joint lift: mean speed from 0.1 to 0.7 rad within 0.5 s = 1.2 rad/s"},
        Refusal{"ToleranceNaN",
                [](TrajectoryGoal& g) {
                  g.path_tolerance = {{"pan", kNaN, 0.0, 0.0}};
                },
                GoalError::kInvalidGoal, "Tolerances"},
        Refusal{"StartNaN", [](TrajectoryGoal& g) { g.start_s = kNaN; }, GoalError::kInvalidGoal, "start time"}),
    [](const testing::TestParamInfo<Refusal>& parameter) { return parameter.param.name; });

TEST(TrajectoryGoal, IsSortedByTheArmsJoints) {
  CheckedGoal checked;
  ASSERT_TRUE(check(validGoal(), &checked).accepted);
  ASSERT_EQ(checked.points.size(), 2u);
  EXPECT_EQ(checked.points[0].position_rad, Eigen::Vector2d(0.2, 0.1));
  EXPECT_EQ(checked.points[0].velocity_rad_s, Eigen::Vector2d(0.4, 0.3));
  EXPECT_EQ(checked.points[0].acceleration_rad_s2, Eigen::Vector2d(0.6, 0.5));
  EXPECT_EQ(checked.points[1].velocity_rad_s.size(), 0);
}

TEST(TrajectoryGoal, MayGoToTheLimits) {
  TrajectoryGoal goal = validGoal();
  goal.points[0].positions_rad = {0.0, 6.0};
  goal.points[0].velocities_rad_s = {-1.0, 3.0};
  goal.points[1].positions_rad = {1.0, 3.0};  // mean speeds 1 and -3 rad/s
  EXPECT_TRUE(check(goal).accepted) << check(goal).text;
}

TEST(TrajectoryGoal, ZeroToleranceIsThePresetAndNegativeNone) {
  TrajectoryGoal goal = validGoal();
  goal.path_tolerance = {{"pan", 0.01, 0.0, 0.0}, {"lift", -1.0, 0.5, 0.0}, {"somebody", 9.0, 9.0, 0.0}};
  goal.goal_tolerance = {{"pan", 0.0, -1.0, 0.0}, {"lift", 0.02, 0.0, 0.0}};
  goal.goal_time_tolerance_s = 2.5;
  CheckedGoal checked;
  ASSERT_TRUE(check(goal, &checked).accepted);
  EXPECT_EQ(checked.tolerances[0].path_position_rad, 0.01);
  EXPECT_EQ(checked.tolerances[0].path_velocity_rad_s, kInfinity);
  EXPECT_EQ(checked.tolerances[1].path_position_rad, kInfinity);
  EXPECT_EQ(checked.tolerances[1].path_velocity_rad_s, 0.5);
  EXPECT_EQ(checked.tolerances[0].goal_position_rad, TrajectoryFollowerConfig{}.goal_tolerance_rad);
  EXPECT_EQ(checked.tolerances[0].goal_velocity_rad_s, kInfinity);
  EXPECT_EQ(checked.tolerances[1].goal_position_rad, 0.02);
  EXPECT_EQ(checked.tolerances[1].goal_velocity_rad_s, TrajectoryFollowerConfig{}.stopped_velocity_tolerance_rad_s);
  EXPECT_EQ(checked.goal_time_s, 2.5);
  goal.goal_time_tolerance_s = 0.0;
  ASSERT_TRUE(check(goal, &checked).accepted);
  EXPECT_EQ(checked.goal_time_s, 0.6);
  goal.goal_time_tolerance_s = -1.0;
  ASSERT_TRUE(check(goal, &checked).accepted);
  EXPECT_EQ(checked.goal_time_s, 0.0);
}

TEST(TrajectoryFollowerConfig, ListsEveryImpossibleValue) {
  EXPECT_TRUE(TrajectoryFollowerConfig{}.validate().empty());
  TrajectoryFollowerConfig config;
  config.path_tolerance_rad = -0.1;
  config.goal_time_s = kNaN;
  const std::vector<std::string> problems = config.validate();
  ASSERT_EQ(problems.size(), 2u);
  EXPECT_EQ(problems[0], "path_tolerance_rad = -0.1 rad, must be positive and finite");
}

}  // namespace
}  // namespace simulated_world
