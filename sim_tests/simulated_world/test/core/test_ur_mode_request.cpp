// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/ur_mode_request.h"

#include <gtest/gtest.h>

#include "arm_plant.h"

namespace simulated_world {
namespace {

constexpr double kDt_s = 0.01;

class UrModeRequestTest : public testing::Test {
 public:
  UrModeRequestTest() { update(); }

  void update() {
    now_s += kDt_s;
    plant.follow(robot.update(now_s, kDt_s, plant.position_rad, plant.velocity_rad_s), kDt_s);
  }

  /// The answer, or none within 20 s.
  std::optional<CommandAnswer> ask(RobotMode target, bool stop_program, bool play_program) {
    UrModeRequest request(target, stop_program, play_program);
    for (int i = 0; i < 2000; ++i) {
      if (auto answer = request.step(robot)) return answer;
      update();
    }
    return std::nullopt;
  }

  UrController robot{twoJoints(), {}};
  ArmPlant plant;
  double now_s = 0.0;
};

TEST_F(UrModeRequestTest, BringsTheRobotUpAndPlays) {
  ASSERT_TRUE(ask(RobotMode::kRunning, false, true).value_or(CommandAnswer{}).success);
  EXPECT_EQ(robot.robotMode(), RobotMode::kRunning);
  EXPECT_TRUE(robot.robotProgramRunning());
}

TEST_F(UrModeRequestTest, GoesDownAsWellAsUp) {
  ASSERT_TRUE(ask(RobotMode::kRunning, false, false).value_or(CommandAnswer{}).success);
  EXPECT_FALSE(robot.robotProgramRunning());
  ASSERT_TRUE(ask(RobotMode::kIdle, false, true).value_or(CommandAnswer{}).success);
  EXPECT_EQ(robot.robotMode(), RobotMode::kIdle);
  ASSERT_TRUE(ask(RobotMode::kPowerOff, false, false).value_or(CommandAnswer{}).success);
  EXPECT_EQ(robot.robotMode(), RobotMode::kPowerOff);
}

TEST_F(UrModeRequestTest, StopsTheProgramFirst) {
  ASSERT_TRUE(ask(RobotMode::kRunning, false, true).has_value());
  ASSERT_TRUE(ask(RobotMode::kRunning, true, false).value_or(CommandAnswer{}).success);
  EXPECT_EQ(robot.programState(), ProgramState::kStopped);
}

TEST_F(UrModeRequestTest, RecoversFromAProtectiveStop) {
  ASSERT_TRUE(ask(RobotMode::kRunning, false, true).has_value());
  robot.protectiveStop("collision");
  ASSERT_TRUE(ask(RobotMode::kRunning, true, true).value_or(CommandAnswer{}).success);
  EXPECT_EQ(robot.safetyMode(), SafetyMode::kNormal);
  EXPECT_TRUE(robot.robotProgramRunning());
}

TEST_F(UrModeRequestTest, RecoversFromAFault) {
  ASSERT_TRUE(ask(RobotMode::kRunning, false, true).has_value());
  robot.safetyFault(SafetyMode::kViolation);
  ASSERT_TRUE(ask(RobotMode::kRunning, true, true).value_or(CommandAnswer{}).success);
  EXPECT_TRUE(robot.robotProgramRunning());
}

TEST_F(UrModeRequestTest, SaysWhatItCannotDo) {
  EXPECT_FALSE(ask(RobotMode::kBackdrive, false, false).value_or(CommandAnswer{true, {}}).success);
  robot.emergencyStop();
  const CommandAnswer stopped = ask(RobotMode::kRunning, false, true).value_or(CommandAnswer{true, {}});
  EXPECT_FALSE(stopped.success);
  EXPECT_NE(stopped.text.find("ROBOT_EMERGENCY_STOP"), std::string::npos) << stopped.text;
  robot.releaseEmergencyStop();
  robot.setDriverConnected(false);
  EXPECT_FALSE(ask(RobotMode::kRunning, false, true).value_or(CommandAnswer{true, {}}).success);
}

}  // namespace
}  // namespace simulated_world
