// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/ur_controller.h"

#include <limits>
#include <stdexcept>

#include <gtest/gtest.h>

#include "arm_plant.h"

namespace simulated_world {
namespace {

constexpr double kDt_s = 0.002;

UrControllerConfig headless() {
  UrControllerConfig config;
  config.headless_mode = true;
  return config;
}

class UrControllerTest : public testing::Test {
 public:
  explicit UrControllerTest(const UrControllerConfig& config = {}) : ur(twoJoints(), config) { step(); }

  void step() {
    now_s += kDt_s;
    plant.follow(ur.update(now_s, kDt_s, plant.position_rad, plant.velocity_rad_s), kDt_s);
    for (const GoalResult& result : ur.takeResults()) {
      results.push_back(result);
    }
  }

  void run(double duration_s) {
    for (const double end_s = now_s + duration_s - 0.5 * kDt_s; now_s < end_s;) {
      step();
    }
  }

  void bringUp() {
    ASSERT_TRUE(ur.brakeRelease().success);
    run(3.1);
    ASSERT_EQ(ur.robotMode(), RobotMode::kRunning);
    ASSERT_TRUE(ur.config().headless_mode ? ur.resendRobotProgram().success : ur.play().success);
    ASSERT_TRUE(ur.robotProgramRunning());
    run(0.3);
    ASSERT_EQ(ur.speedScaling(), 1.0);
  }

  UrController ur;
  ArmPlant plant;
  double now_s = 10.0;
  std::vector<GoalResult> results;
};

class HeadlessUrControllerTest : public UrControllerTest {
 public:
  HeadlessUrControllerTest() : UrControllerTest(headless()) {}
};

TEST_F(UrControllerTest, ComesUpInTheOrderOfTheModes) {
  EXPECT_EQ(ur.robotMode(), RobotMode::kPowerOff);
  EXPECT_EQ(ur.safetyMode(), SafetyMode::kNormal);
  EXPECT_FALSE(ur.play().success);
  EXPECT_EQ(ur.powerOn().text, "Powering on");
  EXPECT_EQ(ur.robotMode(), RobotMode::kPowerOn);
  run(2.1);
  EXPECT_EQ(ur.robotMode(), RobotMode::kIdle);
  run(5.0);
  EXPECT_EQ(ur.robotMode(), RobotMode::kIdle) << "the brakes were not to be released";
  EXPECT_FALSE(ur.play().success);
  EXPECT_EQ(ur.brakeRelease().text, "Brake releasing");
  EXPECT_EQ(ur.robotMode(), RobotMode::kIdle);
  run(1.1);
  EXPECT_EQ(ur.robotMode(), RobotMode::kRunning);
  EXPECT_FALSE(ur.robotProgramRunning());
  EXPECT_EQ(ur.play().text, "Starting program");
  EXPECT_TRUE(ur.robotProgramRunning());
  EXPECT_EQ(ur.programState(), ProgramState::kPlaying);
}

TEST_F(UrControllerTest, AcceptsGoalsOnlyWhileTheProgramRuns) {
  const auto expectRefused = [this] {
    const GoalAnswer answer = ur.acceptGoal(goTo("a", 0.1, 0.0, 1.0));
    EXPECT_FALSE(answer.accepted);
    EXPECT_EQ(answer.error, GoalError::kInvalidGoal);
    EXPECT_EQ(answer.text, "Can't accept new action goals. Controller is not running.");
  };
  expectRefused();
  bringUp();
  EXPECT_TRUE(ur.acceptGoal(goTo("a", 0.1, 0.0, 1.0)).accepted);
  EXPECT_TRUE(ur.stop().success);
  expectRefused();
}

TEST_F(UrControllerTest, SpeedScalingIsSliderTimesInternalFactorWithARamp) {
  bringUp();
  EXPECT_TRUE(ur.setSpeedSlider(0.5).success);
  ur.setInternalSpeedFactor(0.8);
  double last = ur.speedScaling();
  run(kDt_s);
  EXPECT_NEAR(last - ur.speedScaling(), kDt_s / 0.2, 1e-12);  // the ramp, rounded
  run(0.3);
  EXPECT_NEAR(ur.speedScaling(), 0.4, 1e-12);
  EXPECT_FALSE(ur.setSpeedSlider(1.1).success);
  EXPECT_FALSE(ur.setSpeedSlider(-0.1).success);
  EXPECT_FALSE(ur.setSpeedSlider(std::numeric_limits<double>::quiet_NaN()).success);
  run(0.3);
  EXPECT_NEAR(ur.speedScaling(), 0.4, 1e-12) << "the slider is where it was";
  EXPECT_THROW(ur.setInternalSpeedFactor(2.0), std::invalid_argument);
}

TEST_F(UrControllerTest, HalfTheSliderDoublesTheTime) {
  bringUp();
  ASSERT_TRUE(ur.setSpeedSlider(0.5).success);
  run(0.3);
  ASSERT_TRUE(ur.acceptGoal(goTo("a", 1.0, -0.5, 1.0)).accepted);
  run(1.98);
  EXPECT_TRUE(results.empty());
  run(0.04);
  ASSERT_EQ(results.size(), 1u);
  EXPECT_EQ(results[0].outcome, GoalOutcome::kSucceeded);
}

TEST_F(UrControllerTest, PauseFreezesTheTrajectoryAndPlayResumesIt) {
  bringUp();
  ASSERT_TRUE(ur.acceptGoal(goTo("a", 1.0, -0.5, 1.0)).accepted);
  run(0.5);
  EXPECT_EQ(ur.pause().text, "Pausing program");
  EXPECT_FALSE(ur.pause().success) << "twice";
  run(0.3);
  EXPECT_EQ(ur.speedScaling(), 0.0);
  EXPECT_EQ(ur.programState(), ProgramState::kPaused);
  EXPECT_TRUE(ur.robotProgramRunning());
  const Eigen::VectorXd frozen = plant.position_rad;
  run(20.0);
  EXPECT_EQ(plant.position_rad, frozen);
  EXPECT_TRUE(results.empty());
  EXPECT_TRUE(ur.play().success);
  run(1.0);
  ASSERT_EQ(results.size(), 1u);
  EXPECT_EQ(results[0].outcome, GoalOutcome::kSucceeded);
  EXPECT_NEAR(plant.position_rad[0], 1.0, 1e-9);
}

TEST_F(UrControllerTest, StoppingTheProgramKillsTheGoal) {
  bringUp();
  ASSERT_TRUE(ur.acceptGoal(goTo("a", 1.0, -0.5, 1.0)).accepted);
  run(0.5);
  EXPECT_EQ(ur.stop().text, "Stopped");
  EXPECT_FALSE(ur.stop().success) << "twice";
  EXPECT_EQ(ur.speedScaling(), 0.0);
  run(1.0);
  ASSERT_EQ(results.size(), 1u);
  EXPECT_EQ(results[0].outcome, GoalOutcome::kAborted);
  EXPECT_EQ(results[0].text, "robot program stopped");
  const Eigen::VectorXd stopped = plant.position_rad;
  EXPECT_LT(stopped[0], 1.0);
  EXPECT_TRUE(ur.play().success);
  run(3.0);
  EXPECT_EQ(plant.position_rad, stopped) << "the old trajectory came back to life";
}

TEST_F(UrControllerTest, RecoversFromAProtectiveStopInThisOrderOnly) {
  bringUp();
  ASSERT_TRUE(ur.acceptGoal(goTo("a", 1.0, -0.5, 1.0)).accepted);
  run(0.5);
  ur.protectiveStop("collision");
  EXPECT_EQ(ur.safetyMode(), SafetyMode::kProtectiveStop);
  EXPECT_EQ(ur.robotMode(), RobotMode::kRunning);
  EXPECT_FALSE(ur.robotProgramRunning());
  step();
  ASSERT_EQ(results.size(), 1u);
  EXPECT_EQ(results[0].outcome, GoalOutcome::kAborted);
  EXPECT_EQ(results[0].text, "protective stop: collision");
  EXPECT_FALSE(ur.play().success);
  run(4.9);
  EXPECT_FALSE(ur.unlockProtectiveStop().success);
  EXPECT_NE(ur.unlockProtectiveStop().text.find("until 5s after occurrence"), std::string::npos);
  run(0.2);
  EXPECT_EQ(ur.unlockProtectiveStop().text, "Protective stop releasing");
  EXPECT_FALSE(ur.unlockProtectiveStop().success) << "twice";
  EXPECT_EQ(ur.safetyMode(), SafetyMode::kNormal);
  EXPECT_FALSE(ur.robotProgramRunning()) << "nobody pressed play";
  EXPECT_FALSE(ur.acceptGoal(goTo("b", 1.0, -0.5, 1.0)).accepted);
  EXPECT_TRUE(ur.play().success);
  const Eigen::VectorXd stopped = plant.position_rad;
  run(2.0);
  EXPECT_EQ(plant.position_rad, stopped) << "the old trajectory came back to life";
  EXPECT_TRUE(ur.acceptGoal(goTo("b", 1.0, -0.5, 1.0)).accepted);
  run(1.1);
  EXPECT_EQ(results.back().goal_id, "b");
  EXPECT_EQ(results.back().outcome, GoalOutcome::kSucceeded);
}

TEST_F(UrControllerTest, AnEmergencyStopTakesThePower) {
  bringUp();
  ur.emergencyStop();
  EXPECT_EQ(ur.robotMode(), RobotMode::kPowerOff);
  EXPECT_EQ(ur.safetyMode(), SafetyMode::kRobotEmergencyStop);
  EXPECT_FALSE(ur.robotProgramRunning());
  EXPECT_FALSE(ur.powerOn().success);
  EXPECT_FALSE(ur.brakeRelease().success);
  ur.releaseEmergencyStop();
  EXPECT_EQ(ur.safetyMode(), SafetyMode::kNormal);
  EXPECT_EQ(ur.robotMode(), RobotMode::kPowerOff);
  bringUp();
}

TEST_F(UrControllerTest, AFaultNeedsTheSafetyRestarted) {
  bringUp();
  ur.safetyFault(SafetyMode::kFault);
  EXPECT_EQ(ur.robotMode(), RobotMode::kPowerOff);
  EXPECT_FALSE(ur.powerOn().success);
  EXPECT_FALSE(ur.unlockProtectiveStop().success);
  EXPECT_EQ(ur.restartSafety().text, "Restarting safety");
  EXPECT_EQ(ur.safetyMode(), SafetyMode::kNormal);
  EXPECT_EQ(ur.robotMode(), RobotMode::kPowerOff);
  bringUp();
  EXPECT_THROW(ur.safetyFault(SafetyMode::kNormal), std::invalid_argument);
}

TEST_F(UrControllerTest, PoweringOffWhileComingUpStaysOff) {
  ASSERT_TRUE(ur.brakeRelease().success);
  run(1.0);
  EXPECT_EQ(ur.powerOff().text, "Powering off");
  run(5.0);
  EXPECT_EQ(ur.robotMode(), RobotMode::kPowerOff);
}

TEST_F(UrControllerTest, SendsNoProgramUnlessHeadless) {
  ASSERT_TRUE(ur.brakeRelease().success);
  run(3.1);
  EXPECT_FALSE(ur.resendRobotProgram().success);
  EXPECT_FALSE(ur.robotProgramRunning());
}

TEST_F(HeadlessUrControllerTest, AProgramSentToAStoppedRobotDoesNotRun) {
  bringUp();
  ur.protectiveStop("collision");
  EXPECT_TRUE(ur.resendRobotProgram().success);
  EXPECT_FALSE(ur.robotProgramRunning());
  run(5.1);
  ASSERT_TRUE(ur.unlockProtectiveStop().success);
  EXPECT_FALSE(ur.robotProgramRunning());
  EXPECT_TRUE(ur.resendRobotProgram().success);
  EXPECT_TRUE(ur.robotProgramRunning());
}

TEST_F(HeadlessUrControllerTest, SendingTheProgramAgainKillsTheGoal) {
  bringUp();
  ASSERT_TRUE(ur.acceptGoal(goTo("a", 1.0, -0.5, 1.0)).accepted);
  run(0.5);
  EXPECT_TRUE(ur.resendRobotProgram().success);
  EXPECT_TRUE(ur.robotProgramRunning());
  const Eigen::VectorXd velocity = plant.velocity_rad_s;
  step();
  EXPECT_NEAR((plant.velocity_rad_s - velocity).norm(), 0.0, 0.02) << "brakes at once";  // 0.5 s to rest
  ASSERT_EQ(results.size(), 1u);
  EXPECT_EQ(results[0].outcome, GoalOutcome::kAborted);
}

TEST_F(UrControllerTest, HandingBackControlEndsTheProgram) {
  bringUp();
  EXPECT_TRUE(ur.handBackControl().success);
  EXPECT_FALSE(ur.robotProgramRunning());
}

TEST_F(UrControllerTest, WithoutTheDriverNothingIsAccepted) {
  bringUp();
  ASSERT_TRUE(ur.acceptGoal(goTo("a", 1.0, -0.5, 1.0)).accepted);
  run(0.5);
  ur.setDriverConnected(false);
  EXPECT_FALSE(ur.robotProgramRunning());
  for (const CommandAnswer& answer :
       {ur.powerOn(), ur.powerOff(), ur.brakeRelease(), ur.play(), ur.pause(), ur.stop(), ur.unlockProtectiveStop(),
        ur.restartSafety(), ur.closePopup(), ur.closeSafetyPopup(), ur.loadProgram("external_control.urp"),
        ur.resendRobotProgram(), ur.handBackControl(), ur.setSpeedSlider(0.5), ur.setIo(1, 0, 1.0), ur.setPayload({}),
        ur.zeroFtSensor()}) {
    EXPECT_FALSE(answer.success);
    EXPECT_EQ(answer.text, "The driver is not connected to the robot");
  }
  EXPECT_FALSE(ur.acceptGoal(goTo("b", 0.0, 0.0, 1.0)).accepted);
  run(1.0);
  const Eigen::VectorXd held = plant.position_rad;
  run(1.0);
  EXPECT_EQ(plant.position_rad, held);
  EXPECT_EQ(results.back().outcome, GoalOutcome::kAborted);
  ur.setDriverConnected(true);
  EXPECT_FALSE(ur.robotProgramRunning());
  EXPECT_TRUE(ur.play().success);
  EXPECT_TRUE(ur.robotProgramRunning());
}

TEST_F(UrControllerTest, SetsOutputsAsTheDriverDoes) {
  for (int pin = 0; pin < 18; ++pin) {
    EXPECT_TRUE(ur.setIo(1, pin, 1.0).success) << pin;
    EXPECT_TRUE(ur.io().digital_out[static_cast<std::size_t>(pin)]) << pin;
    EXPECT_TRUE(ur.setIo(1, pin, 0.0).success) << pin;
    EXPECT_FALSE(ur.io().digital_out[static_cast<std::size_t>(pin)]) << pin;
  }
  EXPECT_FALSE(ur.setIo(1, 18, 1.0).success);
  EXPECT_FALSE(ur.setIo(1, -1, 1.0).success);
  EXPECT_FALSE(ur.setIo(1, 0, 0.5).success);
  EXPECT_FALSE(ur.setIo(2, 0, 1.0).success) << "flags";
  EXPECT_NE(ur.setIo(2, 0, 1.0).text.find("fun = 2"), std::string::npos);
  EXPECT_TRUE(ur.setIo(3, 1, 0.25).success);
  EXPECT_EQ(ur.io().analog_out[1], 0.25);
  EXPECT_FALSE(ur.setIo(3, 2, 0.25).success);
  EXPECT_FALSE(ur.setIo(3, 0, 1.5).success);
  EXPECT_TRUE(ur.setIo(4, 0, 24.0).success);
  EXPECT_EQ(ur.io().tool_voltage_V, 24);
  EXPECT_FALSE(ur.setIo(4, 0, 5.0).success);
  EXPECT_EQ(ur.io().tool_voltage_V, 24);
}

TEST_F(UrControllerTest, KnowsItsPayload) {
  EXPECT_TRUE(ur.setPayload({1.5, {0.0, 0.0, 0.1}}).success);
  EXPECT_EQ(ur.payload().mass_kg, 1.5);
  EXPECT_FALSE(ur.setPayload({5.1, {0.0, 0.0, 0.0}}).success);
  EXPECT_FALSE(ur.setPayload({-0.1, {0.0, 0.0, 0.0}}).success);
  EXPECT_FALSE(ur.setPayload({1.0, {0.0, 0.0, std::numeric_limits<double>::infinity()}}).success);
  EXPECT_EQ(ur.payload().mass_kg, 1.5);
}

TEST_F(UrControllerTest, PassesOnTheZeroingOfTheForceSensorOnce) {
  EXPECT_FALSE(ur.takeFtSensorZeroed());
  EXPECT_TRUE(ur.zeroFtSensor().success);
  EXPECT_TRUE(ur.takeFtSensorZeroed());
  EXPECT_FALSE(ur.takeFtSensorZeroed());
}

TEST_F(UrControllerTest, LoadsTheOnlyProgramThereIs) {
  EXPECT_EQ(ur.loadProgram("other.urp").text, "File not found: other.urp");
  EXPECT_EQ(ur.loadProgram("external_control.urp").text, "Loading program: external_control.urp");
  bringUp();
  EXPECT_FALSE(ur.loadProgram("external_control.urp").success) << "while it plays";
}

TEST(UrController, ListsEveryImpossibleValue) {
  EXPECT_TRUE(UrControllerConfig{}.validate().empty());
  UrControllerConfig config;
  config.unlock_delay_s = -1.0;
  config.program.clear();
  config.follower.goal_time_s = 0.0;
  EXPECT_EQ(config.validate().size(), 3u);
  EXPECT_THROW(UrController(twoJoints(), config), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
