// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/recovery.h"

#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include <gmock/gmock.h>

#include "ur_driver_bridge/safety_gate.h"

namespace ur_driver_bridge {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

using Action = Recovery::Action;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kStep_s = 0.05;

constexpr char kUnlock[] = "dashboard/unlock_protective_stop";
constexpr char kRestartSafety[] = "dashboard/restart_safety";
constexpr char kPowerOn[] = "dashboard/power_on";
constexpr char kBrakeRelease[] = "dashboard/brake_release";
constexpr char kPlay[] = "dashboard/play";
constexpr char kResend[] = "resend_robot_program";

/// The robot behind the driver, as its documentation describes it; written from that, not from the class under test.
class Robot {
 public:
  explicit Robot(bool is_headless) : is_headless_(is_headless) {
    arm.robot_mode = robot_mode::kRunning;
    arm.safety_mode = safety_mode::kNormal;
    arm.is_program_running = true;
    arm.is_controller_there = true;
  }

  void advance(double now_s) {
    now_s_ = now_s;
    if (next_mode_ && now_s >= next_mode_->first) {
      arm.robot_mode = next_mode_->second;
      next_mode_.reset();
    }
    if (safe_again_s_ && now_s >= *safe_again_s_) {
      arm.safety_mode = safety_mode::kNormal;
      safe_again_s_.reset();
    }
  }

  std::pair<bool, std::string> command(const std::string& name) {
    if (name == refused) return {false, "Failed to execute: " + name};
    if (name == ignored) return {true, "accepted"};
    const bool is_safe = *arm.safety_mode == safety_mode::kNormal || *arm.safety_mode == safety_mode::kReduced;
    if (name == kUnlock) {
      if (*arm.safety_mode != safety_mode::kProtectiveStop) return {false, "no protective stop"};
      if (now_s_ < protective_stop_s_ + 5.0) return {false, "Cannot unlock protective stop until 5s after occurrence"};
      safe_again_s_ = now_s_ + 0.3;
      return {true, "Protective stop releasing"};
    }
    if (name == kRestartSafety) {
      arm.safety_mode = 11;  // undefined while it boots
      arm.robot_mode = robot_mode::kBooting;
      safe_again_s_ = now_s_ + 4.0;
      next_mode_ = {now_s_ + 5.0, robot_mode::kPowerOff};
      return {true, "Restarting safety"};
    }
    if (!is_safe) return {false, "not while stopped"};
    if (name == kPowerOn) {
      if (*arm.robot_mode != robot_mode::kPowerOff) return {false, "is on"};
      arm.robot_mode = robot_mode::kPowerOn;
      next_mode_ = {now_s_ + 2.0, robot_mode::kIdle};
      return {true, "Powering on"};
    }
    if (name == kBrakeRelease) {
      if (*arm.robot_mode != robot_mode::kIdle) return {false, "is not idle"};
      next_mode_ = {now_s_ + 1.0, robot_mode::kRunning};
      return {true, "Brake releasing"};
    }
    if (name == kPlay || name == kResend) {
      if ((name == kResend) != is_headless_) return {false, "wrong mode of the driver"};
      if (*arm.robot_mode != robot_mode::kRunning) return {false, "not running"};
      arm.is_program_running = true;
      return {true, "Starting program"};
    }
    return {false, "no such command: " + name};
  }

  void protectiveStop() {
    arm.safety_mode = safety_mode::kProtectiveStop;
    arm.is_program_running = false;
    protective_stop_s_ = now_s_;
  }
  void losePower(int safety_mode) {
    arm.safety_mode = safety_mode;
    arm.robot_mode = robot_mode::kPowerOff;
    arm.is_program_running = false;
    next_mode_.reset();
  }

  ArmState arm;
  std::string refused;  // the command that is answered with no
  std::string ignored;  // the command that is answered with yes and changes nothing

 private:
  bool is_headless_;
  double now_s_{0.0};
  double protective_stop_s_{-1e9};
  std::optional<std::pair<double, int>> next_mode_;
  std::optional<double> safe_again_s_;
};

RecoveryConfig configOf(bool is_headless) {
  RecoveryConfig config;
  config.is_headless = is_headless;
  return config;
}

class RecoveryTest : public ::testing::TestWithParam<bool> {
 protected:
  std::string program() const { return GetParam() ? kResend : kPlay; }

  /// Until the recovery ends; `each` is called before every step.
  template <typename Each>
  Recovery::Step run(const RecoveryPermit& permit, const Each& each) {
    recovery_.begin(permit, now_s_);
    const double begin_s = now_s_;
    while (now_s_ < begin_s + 300.0) {
      robot_.advance(now_s_);
      each();
      const Recovery::Step step = recovery_.next(robot_.arm, now_s_);
      switch (step.action) {
        case Action::kDone:
          EXPECT_TRUE(step.verdict.isFine());
          return step;
        case Action::kImpossible:
          EXPECT_FALSE(step.verdict.isFine());
          EXPECT_NE(step.verdict.message, "");
          return step;
        case Action::kCommand: {
          EXPECT_FALSE(step.command.empty());
          now_s_ += 0.1;  // a service takes its time
          robot_.advance(now_s_);
          const auto [success, message] = robot_.command(step.command);
          recovery_.answered(success, message, now_s_);
          break;
        }
        case Action::kWait:
          EXPECT_FALSE(step.verdict.isFine());
          EXPECT_NE(step.verdict.message, "");
          waits_.push_back(step.verdict.message);
          now_s_ += kStep_s;
          break;
      }
    }
    ADD_FAILURE() << "does not end";
    return {};
  }
  Recovery::Step run(const RecoveryPermit& permit = {}) {
    return run(permit, [] {});
  }

  double now_s_{1.7e9};
  Robot robot_{GetParam()};
  Recovery recovery_{configOf(GetParam())};
  std::vector<std::string> waits_;
};

TEST_P(RecoveryTest, NothingIsToBeDoneOnceTheArmTakesTrajectories) {
  EXPECT_EQ(run().action, Action::kDone);
  EXPECT_THAT(recovery_.done(), IsEmpty());
  EXPECT_THAT(waits_, IsEmpty());
  robot_.arm.safety_mode = safety_mode::kReduced;
  EXPECT_EQ(run().action, Action::kDone);
}

TEST_P(RecoveryTest, StoppedProgramIsStarted) {
  robot_.arm.is_program_running = false;
  EXPECT_EQ(run().action, Action::kDone);
  EXPECT_THAT(recovery_.done(), ElementsAre(program()));
}

TEST_P(RecoveryTest, IdleRobotReleasesItsBrakes) {
  robot_.losePower(safety_mode::kNormal);
  robot_.arm.robot_mode = robot_mode::kIdle;
  EXPECT_EQ(run().action, Action::kDone);
  EXPECT_THAT(recovery_.done(), ElementsAre(kBrakeRelease, program()));
}

TEST_P(RecoveryTest, RobotWithoutPowerGoesThroughAllModes) {
  robot_.losePower(safety_mode::kNormal);
  const double begin_s = now_s_;
  EXPECT_EQ(run().action, Action::kDone);
  EXPECT_THAT(recovery_.done(), ElementsAre(kPowerOn, kBrakeRelease, program()));
  EXPECT_NEAR(now_s_ - begin_s, 3.0, 0.6) << "2 s to idle, 1 s to running, answers and steps";
}

TEST_P(RecoveryTest, ProtectiveStopNeedsTheOperatorsWord) {
  robot_.protectiveStop();
  const Recovery::Step step = run();
  EXPECT_EQ(step.action, Action::kImpossible);
  EXPECT_EQ(step.verdict.status, ArmStatus::kProtectiveStop);
  EXPECT_THAT(step.verdict.message,
              AllOf(HasSubstr("PROTECTIVE_STOP (3)"), HasSubstr("operator"), HasSubstr("unlock_protective_stop")));
  EXPECT_THAT(recovery_.done(), IsEmpty());
  RecoveryPermit other;
  other.restart_safety = true;
  EXPECT_EQ(run(other).action, Action::kImpossible) << "a word for something else";
}

TEST_P(RecoveryTest, ProtectiveStopIsUnlockedOnTheOperatorsWordWhenItsTimeHasCome) {
  robot_.advance(now_s_);
  robot_.protectiveStop();
  RecoveryPermit permit;
  permit.unlock_protective_stop = true;
  const double begin_s = now_s_;
  EXPECT_EQ(run(permit).action, Action::kDone);
  EXPECT_THAT(recovery_.done(), ElementsAre(kUnlock, program()));
  EXPECT_GE(now_s_ - begin_s, 5.5);
  EXPECT_LT(now_s_ - begin_s, 7.0);
}

TEST_P(RecoveryTest, OneWordUnlocksOneStop) {
  robot_.advance(now_s_);
  robot_.protectiveStop();
  RecoveryPermit permit;
  permit.unlock_protective_stop = true;
  robot_.arm.is_controller_there = false;  // so that there is time for a second stop once the program runs
  bool has_stopped_again = false;
  const Recovery::Step step = run(permit, [&] {
    if (has_stopped_again || !*robot_.arm.is_program_running) return;
    robot_.protectiveStop();
    has_stopped_again = true;
  });
  EXPECT_TRUE(has_stopped_again);
  EXPECT_EQ(step.action, Action::kImpossible);
  EXPECT_EQ(step.verdict.status, ArmStatus::kProtectiveStop);
  EXPECT_THAT(step.verdict.message, HasSubstr("again"));
}

TEST_P(RecoveryTest, AutomaticPolicyNeedsNoWord) {
  RecoveryConfig config = configOf(GetParam());
  config.unlocks_by_itself = true;
  recovery_ = Recovery(config);
  robot_.advance(now_s_);
  robot_.protectiveStop();
  EXPECT_EQ(run().action, Action::kDone);
  EXPECT_THAT(recovery_.done(), ElementsAre(kUnlock, program()));
}

TEST_P(RecoveryTest, ViolationAndFaultNeedTheOperatorsWordUnderAnyPolicy) {
  RecoveryConfig config = configOf(GetParam());
  config.unlocks_by_itself = true;
  recovery_ = Recovery(config);
  for (const int mode : {safety_mode::kViolation, safety_mode::kFault}) {
    robot_.losePower(mode);
    RecoveryPermit permit;
    permit.unlock_protective_stop = true;
    const Recovery::Step step = run(permit);
    EXPECT_EQ(step.action, Action::kImpossible);
    EXPECT_EQ(step.verdict.status, ArmStatus::kEmergencyStop);
    EXPECT_THAT(step.verdict.message, AllOf(HasSubstr("operator"), HasSubstr("restart_safety")));
    EXPECT_THAT(recovery_.done(), IsEmpty());
  }
}

TEST_P(RecoveryTest, SafetyIsRestartedOnTheOperatorsWord) {
  for (const int mode : {safety_mode::kViolation, safety_mode::kFault}) {
    robot_.losePower(mode);
    RecoveryPermit permit;
    permit.restart_safety = true;
    EXPECT_EQ(run(permit).action, Action::kDone);
    EXPECT_THAT(recovery_.done(), ElementsAre(kRestartSafety, kPowerOn, kBrakeRelease, program()));
  }
}

TEST_P(RecoveryTest, OneWordRestartsSafetyOnce) {
  robot_.losePower(safety_mode::kFault);
  RecoveryPermit permit;
  permit.restart_safety = true;
  const Recovery::Step step = run(permit, [&] {
    if (*robot_.arm.robot_mode == robot_mode::kIdle) robot_.losePower(safety_mode::kFault);
  });
  EXPECT_EQ(step.action, Action::kImpossible);
  EXPECT_EQ(step.verdict.status, ArmStatus::kEmergencyStop);
  EXPECT_THAT(step.verdict.message, AllOf(HasSubstr("FAULT (9)"), HasSubstr("again")));
}

TEST_P(RecoveryTest, EmergencyStopIsWaitedForAndThenTheRobotPoweredOn) {
  robot_.losePower(safety_mode::kRobotEmergencyStop);
  const double release_s = now_s_ + 10.0;
  EXPECT_EQ(run({},
                [&] {
                  if (now_s_ >= release_s) robot_.arm.safety_mode = safety_mode::kNormal;
                })
                .action,
            Action::kDone);
  EXPECT_THAT(waits_.front(), AllOf(HasSubstr("ROBOT_EMERGENCY_STOP (7)"), HasSubstr("operator")));
  EXPECT_THAT(recovery_.done(), ElementsAre(kPowerOn, kBrakeRelease, program()));
}

TEST_P(RecoveryTest, StopsThatOnlyPeopleEndAreNotWaitedForForEver) {
  for (const int mode : {safety_mode::kSafeguardStop, safety_mode::kSystemEmergencyStop,
                         safety_mode::kRobotEmergencyStop, safety_mode::kAutomaticModeSafeguardStop}) {
    robot_.losePower(mode);
    const double begin_s = now_s_;
    RecoveryPermit permit;
    permit.unlock_protective_stop = true;
    permit.restart_safety = true;
    const Recovery::Step step = run(permit);
    EXPECT_EQ(step.action, Action::kImpossible);
    EXPECT_EQ(step.verdict.status, ArmStatus::kEmergencyStop);
    EXPECT_THAT(step.verdict.message, AllOf(HasSubstr("operator"), HasSubstr("allowed 15 s")));
    EXPECT_NEAR(now_s_ - begin_s, 15.0, 2.0 * kStep_s);
    EXPECT_THAT(recovery_.done(), IsEmpty());
  }
}

TEST_P(RecoveryTest, ModesThatNoCommandEndsAreNotReady) {
  for (const int mode :
       {safety_mode::kRecovery, safety_mode::kValidateJointId, safety_mode::kThreePositionEnablingStop, 17}) {
    robot_.arm.safety_mode = mode;
    const Recovery::Step step = run();
    EXPECT_EQ(step.verdict.status, ArmStatus::kNotReady);
    EXPECT_THAT(step.verdict.message, HasSubstr("(" + std::to_string(mode) + ")"));
    EXPECT_THAT(recovery_.done(), IsEmpty());
  }
  robot_.arm.safety_mode = safety_mode::kNormal;
  for (const int mode : {-1, 0, 1, 2, 4, 6, 8, 42}) {
    robot_.arm.robot_mode = mode;
    const Recovery::Step step = run();
    EXPECT_EQ(step.verdict.status, ArmStatus::kNotReady);
    EXPECT_THAT(step.verdict.message, HasSubstr("(" + std::to_string(mode) + ")"));
    EXPECT_THAT(recovery_.done(), IsEmpty());
  }
}

TEST_P(RecoveryTest, SilentDriverIsGone) {
  robot_.arm = ArmState{};
  const double begin_s = now_s_;
  Recovery silent(configOf(GetParam()));
  silent.begin({}, now_s_);
  Recovery::Step step = silent.next({}, now_s_);
  while (step.action == Action::kWait && now_s_ < begin_s + 100.0) step = silent.next({}, now_s_ += kStep_s);
  EXPECT_EQ(step.action, Action::kImpossible);
  EXPECT_EQ(step.verdict.status, ArmStatus::kDriverGone);
  EXPECT_NEAR(now_s_ - begin_s, 15.0, 2.0 * kStep_s);
}

TEST_P(RecoveryTest, ArmWithoutAControllerTakesNoTrajectories) {
  robot_.arm.is_controller_there = false;
  const Recovery::Step step = run();
  EXPECT_EQ(step.verdict.status, ArmStatus::kDriverGone);
  EXPECT_THAT(step.verdict.message, HasSubstr("controller"));
}

/// State in which the command is what is to be done next.
void bringTo(const std::string& command, Robot* robot) {
  if (command == kUnlock) robot->protectiveStop();
  if (command == kRestartSafety) robot->losePower(safety_mode::kViolation);
  if (command == kPowerOn) robot->losePower(safety_mode::kNormal);
  if (command == kBrakeRelease) {
    robot->losePower(safety_mode::kNormal);
    robot->arm.robot_mode = robot_mode::kIdle;
  }
  if (command == kPlay || command == kResend) robot->arm.is_program_running = false;
}

ArmStatus statusOf(const std::string& command) {
  if (command == kUnlock) return ArmStatus::kProtectiveStop;
  if (command == kRestartSafety) return ArmStatus::kEmergencyStop;
  if (command == kPowerOn || command == kBrakeRelease) return ArmStatus::kNotReady;
  return ArmStatus::kProgramStopped;
}

TEST_P(RecoveryTest, RefusedCommandIsNamedWithTheAnswer) {
  for (const std::string& command : {std::string(kUnlock), std::string(kRestartSafety), std::string(kPowerOn),
                                     std::string(kBrakeRelease), program()}) {
    SCOPED_TRACE(command);
    robot_ = Robot(GetParam());
    bringTo(command, &robot_);
    robot_.refused = command;
    const Recovery::Step step = run({true, true});
    EXPECT_EQ(step.action, Action::kImpossible);
    EXPECT_EQ(step.verdict.status, statusOf(command));
    EXPECT_THAT(step.verdict.message, AllOf(HasSubstr(command), HasSubstr("refused"), HasSubstr("Failed to execute"),
                                            HasSubstr("safety mode"), HasSubstr("robot mode")));
    EXPECT_THAT(recovery_.done(), ElementsAre(command));
    EXPECT_EQ(recovery_.next(robot_.arm, now_s_ + 100.0).action, Action::kImpossible) << "until it begins again";
  }
}

TEST_P(RecoveryTest, RobotThatDoesNotFollowIsNamedAfterTheTimeout) {
  for (const std::string& command : {std::string(kUnlock), std::string(kRestartSafety), std::string(kPowerOn),
                                     std::string(kBrakeRelease), program()}) {
    SCOPED_TRACE(command);
    robot_ = Robot(GetParam());
    bringTo(command, &robot_);
    robot_.ignored = command;
    const double begin_s = now_s_;
    const Recovery::Step step = run({true, true});
    EXPECT_EQ(step.action, Action::kImpossible);
    EXPECT_EQ(step.verdict.status, statusOf(command));
    EXPECT_THAT(step.verdict.message, AllOf(HasSubstr(command), HasSubstr("not followed"), HasSubstr("allowed 15 s"),
                                            HasSubstr("robot mode " + robotModeName(*robot_.arm.robot_mode))));
    EXPECT_THAT(recovery_.done(), ElementsAre(command)) << "it is not given again and again";
    const double unlock_wait_s = command == kUnlock ? 5.5 : 0.0;
    EXPECT_NEAR(now_s_ - begin_s, unlock_wait_s + 15.0, 0.1 + 3.0 * kStep_s);
  }
}

TEST_P(RecoveryTest, RefusedCommandThatIsNeededNoMoreDoesNoHarm) {
  robot_.arm.is_program_running = false;
  robot_.refused = program();
  const Recovery::Step step = run({}, [&] {
    if (!recovery_.done().empty()) robot_.arm.is_program_running = true;  // by somebody else
  });
  EXPECT_EQ(step.action, Action::kDone);
}

TEST_P(RecoveryTest, MissingAnswerEndsTheRecovery) {
  robot_.losePower(safety_mode::kNormal);
  recovery_.begin({}, now_s_);
  ASSERT_EQ(recovery_.next(robot_.arm, now_s_).action, Action::kCommand);
  EXPECT_EQ(recovery_.next(robot_.arm, now_s_ + 14.9).action, Action::kWait);
  const Recovery::Step step = recovery_.next(robot_.arm, now_s_ + 15.1);
  EXPECT_EQ(step.action, Action::kImpossible);
  EXPECT_EQ(step.verdict.status, ArmStatus::kDriverGone);
  EXPECT_THAT(step.verdict.message, HasSubstr(kPowerOn));
}

TEST_P(RecoveryTest, RobotThatFallsBackAgainAndAgainIsGivenUp) {
  robot_.losePower(safety_mode::kNormal);
  const Recovery::Step step = run({}, [&] {
    if (*robot_.arm.robot_mode == robot_mode::kIdle) robot_.losePower(safety_mode::kNormal);
  });
  EXPECT_EQ(step.action, Action::kImpossible);
  EXPECT_THAT(step.verdict.message, AllOf(HasSubstr("12 commands given, allowed 12"), HasSubstr(kPowerOn)));
  EXPECT_EQ(recovery_.done().size(), 12u);
}

TEST_P(RecoveryTest, ModesThatChangeForEverDoNotProlongTheWait) {
  const double begin_s = now_s_;
  int mode = 0;
  const Recovery::Step step = run({}, [&] { robot_.arm.safety_mode = 10 + (++mode % 2); });
  EXPECT_EQ(step.action, Action::kImpossible);
  EXPECT_NEAR(now_s_ - begin_s, 15.0, 2.0 * kStep_s);
}

TEST_P(RecoveryTest, EmergencyStopInTheMiddleIsTold) {
  robot_.losePower(safety_mode::kNormal);
  const Recovery::Step step = run({}, [&] {
    if (*robot_.arm.robot_mode == robot_mode::kIdle) robot_.losePower(safety_mode::kRobotEmergencyStop);
  });
  EXPECT_EQ(step.verdict.status, ArmStatus::kEmergencyStop);
  EXPECT_THAT(step.verdict.message, HasSubstr("last command: dashboard/power_on"));
}

TEST_P(RecoveryTest, BeginsAnewAfterItHasGivenUp) {
  robot_.losePower(safety_mode::kNormal);
  robot_.refused = kPowerOn;
  EXPECT_EQ(run().action, Action::kImpossible);
  robot_.refused.clear();
  EXPECT_EQ(run().action, Action::kDone);
  EXPECT_THAT(recovery_.done(), ElementsAre(kPowerOn, kBrakeRelease, program()));
}

TEST_P(RecoveryTest, RefusesToBeCalledOutOfOrder) {
  EXPECT_THROW(recovery_.next(robot_.arm, 0.0), std::logic_error);
  EXPECT_THROW(recovery_.begin({}, kNaN), std::invalid_argument);
  recovery_.begin({}, 0.0);
  EXPECT_THROW(recovery_.answered(true, "", 0.0), std::logic_error);
  EXPECT_THROW(recovery_.next(robot_.arm, kNaN), std::invalid_argument);
  robot_.arm.is_program_running = false;
  ASSERT_EQ(recovery_.next(robot_.arm, 0.0).action, Action::kCommand);
  EXPECT_THROW(recovery_.answered(true, "", kNaN), std::invalid_argument);
  recovery_.answered(true, "", 0.1);
  EXPECT_THROW(recovery_.answered(true, "", 0.2), std::logic_error);
}

INSTANTIATE_TEST_SUITE_P(PlayedAndHeadless, RecoveryTest, ::testing::Bool());

TEST(RecoveryConfig, RefusesImpossibleValues) {
  RecoveryConfig config;
  config.step_timeout_s = kNaN;
  EXPECT_THROW(Recovery{config}, std::invalid_argument);
}

}  // namespace
}  // namespace ur_driver_bridge
