// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/safety_gate.h"

#include <functional>
#include <limits>
#include <stdexcept>

#include <gmock/gmock.h>

namespace ur_driver_bridge {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNow_s = 1.7e9;  // as ROS time is on a robot

SafetyGateConfig allOn() {
  SafetyGateConfig config;
  config.max_heartbeat_silence_s = 0.3;
  return config;
}

struct Situation {
  GateInputs inputs;
  GateDemand demand;
};

Situation allFine() {
  Situation all;
  GateInputs& inputs = all.inputs;
  inputs.now_s = kNow_s;
  inputs.wall_s = 500.0;
  inputs.arm.joints = {kNow_s - 0.01, {}};
  inputs.arm.force = {kNow_s - 0.01, {}};
  inputs.arm.speed_scaling = {kNow_s - 0.05, 1.0};
  inputs.arm.robot_mode = robot_mode::kRunning;
  inputs.arm.safety_mode = safety_mode::kNormal;
  inputs.arm.is_program_running = true;
  inputs.arm.is_controller_there = true;
  inputs.map_stamp_s = kNow_s - 0.5;
  inputs.monitor = MonitorWord{kNow_s - 0.1, true, 7, false, ""};
  inputs.heartbeat_s = kNow_s - 0.05;
  inputs.heartbeat_wall_s = 500.0 - 0.05;
  all.demand.needs_force = true;
  all.demand.watch_id = 7;
  all.demand.watch_since_s = kNow_s - 3.0;
  return all;
}

struct Breakage {
  std::string what;
  std::function<void(Situation*)> apply;
  ArmStatus status;
  std::vector<std::string> says;
  int gravity;  // lower is graver; equal: about the same input, not to be combined
};

/// Long: a table, one entry for each way to break the gate.
std::vector<Breakage> breakages() {
  std::vector<Breakage> all;
  int gravity = 0;
  const auto add = [&](const std::string& what, std::function<void(Situation*)> apply, ArmStatus status,
                       std::vector<std::string> says) {
    all.push_back({what, std::move(apply), status, std::move(says), gravity});
  };
  const auto safety = [&](int mode, ArmStatus status, const std::string& name) {
    add(name, [mode](Situation* s) { s->inputs.arm.safety_mode = mode; }, status, {"safety mode " + name});
  };
  safety(3, ArmStatus::kProtectiveStop, "PROTECTIVE_STOP (3)");
  safety(4, ArmStatus::kNotReady, "RECOVERY (4)");
  safety(5, ArmStatus::kEmergencyStop, "SAFEGUARD_STOP (5)");
  safety(6, ArmStatus::kEmergencyStop, "SYSTEM_EMERGENCY_STOP (6)");
  safety(7, ArmStatus::kEmergencyStop, "ROBOT_EMERGENCY_STOP (7)");
  safety(8, ArmStatus::kEmergencyStop, "VIOLATION (8)");
  safety(9, ArmStatus::kEmergencyStop, "FAULT (9)");
  safety(10, ArmStatus::kNotReady, "VALIDATE_JOINT_ID (10)");
  safety(11, ArmStatus::kNotReady, "UNDEFINED_SAFETY_MODE (11)");
  safety(12, ArmStatus::kEmergencyStop, "AUTOMATIC_MODE_SAFEGUARD_STOP (12)");
  safety(13, ArmStatus::kNotReady, "SYSTEM_THREE_POSITION_ENABLING_STOP (13)");
  safety(17, ArmStatus::kNotReady, "unknown (17)");
  safety(0, ArmStatus::kNotReady, "unknown (0)");
  safety(-1, ArmStatus::kNotReady, "unknown (-1)");
  add("no safety mode", [](auto* s) { s->inputs.arm.safety_mode.reset(); }, ArmStatus::kNotReady, {"never heard"});
  ++gravity;
  const std::vector<std::string> mode_names = {
      "NO_CONTROLLER", "DISCONNECTED", "CONFIRM_SAFETY", "BOOTING", "POWER_OFF",
      "POWER_ON",      "IDLE",         "BACKDRIVE",      "",        "UPDATING_FIRMWARE",
      "unknown"};
  for (int mode = -1; mode <= 9; ++mode) {
    if (mode == robot_mode::kRunning) continue;
    const std::string name = mode_names[static_cast<std::size_t>(mode + 1)] + " (" + std::to_string(mode) + ")";
    add(name, [mode](Situation* s) { s->inputs.arm.robot_mode = mode; }, ArmStatus::kNotReady,
        {"robot mode " + name, "RUNNING (7)"});
  }
  add("no robot mode", [](auto* s) { s->inputs.arm.robot_mode.reset(); }, ArmStatus::kNotReady,
      {"robot mode", "never heard"});
  ++gravity;
  add("program", [](auto* s) { s->inputs.arm.is_program_running = false; }, ArmStatus::kProgramStopped, {"program"});
  add("no program", [](auto* s) { s->inputs.arm.is_program_running.reset(); }, ArmStatus::kNotReady,
      {"program", "never heard"});
  ++gravity;
  add("controller", [](auto* s) { s->inputs.arm.is_controller_there = false; }, ArmStatus::kDriverGone, {"controller"});
  ++gravity;
  const auto joints = [&](const std::string& what, double stamp_s, ArmStatus status, std::vector<std::string> says) {
    add(
        "joints " + what, [stamp_s](Situation* s) { s->inputs.arm.joints->stamp_s = stamp_s; }, status,
        std::move(says));
  };
  joints("late", kNow_s - 0.11, ArmStatus::kStaleState, {"joint states", "0.11 s old", "allowed 0.1 s"});
  joints("a second late", kNow_s - 0.99, ArmStatus::kStaleState, {"joint states", "0.99 s old"});
  joints("gone", kNow_s - 1.01, ArmStatus::kDriverGone, {"joint states", "1.01 s old", "allowed 0.1 s"});
  joints("from another clock", 5.0, ArmStatus::kDriverGone, {"joint states"});
  joints("ahead", kNow_s + 0.51, ArmStatus::kStaleState,
         {"joint states", "0.51 s ahead of the clock", "allowed 0.5 s"});
  joints("far ahead", 1e12, ArmStatus::kStaleState, {"joint states", "ahead of the clock"});
  joints("NaN", kNaN, ArmStatus::kStaleState, {"joint states", "not finite"});
  joints("infinite", kInfinity, ArmStatus::kStaleState, {"joint states", "not finite"});
  add("no joints", [](auto* s) { s->inputs.arm.joints.reset(); }, ArmStatus::kDriverGone,
      {"joint states: never heard"});
  add("joint NaN", [](auto* s) { s->inputs.arm.joints->value.position_rad[3] = kNaN; }, ArmStatus::kStaleState,
      {"joint states: not finite"});
  add("speed NaN", [](auto* s) { s->inputs.arm.joints->value.velocity_rad_s[3] = kNaN; }, ArmStatus::kStaleState,
      {"joint states: not finite"});
  ++gravity;
  add("held", [](auto* s) { s->inputs.is_held = true; }, ArmStatus::kHeld, {"operator"});
  ++gravity;
  const auto stop = [](Situation* s) {
    s->inputs.monitor->must_stop = true;
    s->inputs.monitor->reason = "in 0.40 s: wrist meets the map";
  };
  add("stop", stop, ArmStatus::kPathBlocked, {"0.40 s: wrist meets the map"});
  add("old stop",
      [stop](Situation* s) {
        stop(s);
        s->inputs.monitor->stamp_s -= 10.0;
      },
      ArmStatus::kPathBlocked, {"wrist"});
  ++gravity;
  add("force late", [](auto* s) { s->inputs.arm.force->stamp_s = kNow_s - 0.11; }, ArmStatus::kStaleState,
      {"force", "0.11 s old", "allowed 0.1 s"});
  add("force ahead", [](auto* s) { s->inputs.arm.force->stamp_s = kNow_s + 0.6; }, ArmStatus::kStaleState,
      {"force", "ahead of the clock"});
  add("force stamp NaN", [](auto* s) { s->inputs.arm.force->stamp_s = kNaN; }, ArmStatus::kStaleState, {"force"});
  add("force NaN", [](auto* s) { s->inputs.arm.force->value.force_N.x() = kNaN; }, ArmStatus::kStaleState,
      {"force", "not finite"});
  add("torque NaN", [](auto* s) { s->inputs.arm.force->value.torque_Nm.x() = kNaN; }, ArmStatus::kStaleState,
      {"force", "not finite"});
  add("no force", [](auto* s) { s->inputs.arm.force.reset(); }, ArmStatus::kStaleState, {"force", "never heard"});
  ++gravity;
  add("scaling late", [](auto* s) { s->inputs.arm.speed_scaling->stamp_s = kNow_s - 0.51; }, ArmStatus::kStaleState,
      {"speed scaling", "0.51 s old", "allowed 0.5 s"});
  add("scaling NaN", [](auto* s) { s->inputs.arm.speed_scaling->value = kNaN; }, ArmStatus::kStaleState,
      {"speed scaling: not finite"});
  add("no scaling", [](auto* s) { s->inputs.arm.speed_scaling.reset(); }, ArmStatus::kStaleState,
      {"speed scaling: never heard"});
  ++gravity;
  add("map late", [](auto* s) { s->inputs.map_stamp_s = kNow_s - 2.1; }, ArmStatus::kStaleMap,
      {"map", "2.1 s old", "allowed 2 s"});
  add("map ahead", [](auto* s) { s->inputs.map_stamp_s = kNow_s + 1.0; }, ArmStatus::kStaleMap, {"ahead of the clock"});
  add("map NaN", [](auto* s) { s->inputs.map_stamp_s = kNaN; }, ArmStatus::kStaleMap, {"map"});
  add("no map", [](auto* s) { s->inputs.map_stamp_s.reset(); }, ArmStatus::kStaleMap, {"map", "never heard"});
  ++gravity;
  add("monitor late", [](auto* s) { s->inputs.monitor->stamp_s = kNow_s - 0.6; }, ArmStatus::kMonitorGone,
      {"monitor", "0.6 s old", "allowed 0.5 s"});
  add("monitor ahead", [](auto* s) { s->inputs.monitor->stamp_s = kNow_s + 0.6; }, ArmStatus::kMonitorGone,
      {"monitor", "ahead of the clock"});
  add("monitor NaN", [](auto* s) { s->inputs.monitor->stamp_s = kNaN; }, ArmStatus::kMonitorGone, {"monitor"});
  add("another watch", [](auto* s) { s->inputs.monitor->watch_id = 6; }, ArmStatus::kMonitorGone,
      {"watch 7", "watches 6"});
  add("no watch", [](auto* s) { s->inputs.monitor->is_watching = false; }, ArmStatus::kMonitorGone,
      {"watch 7", "watches nothing"});
  add("no monitor", [](auto* s) { s->inputs.monitor.reset(); }, ArmStatus::kMonitorGone, {"watch 7"});
  add("watch NaN",
      [](auto* s) {
        s->demand.watch_since_s = kNaN;
        s->inputs.monitor.reset();
      },
      ArmStatus::kMonitorGone, {"watch 7"});
  ++gravity;
  add("heartbeat late", [](auto* s) { s->inputs.heartbeat_s = kNow_s - 0.16; }, ArmStatus::kHeartbeatLost,
      {"heartbeat", "0.16 s old", "allowed 0.13 s"});
  add("heartbeat ahead", [](auto* s) { s->inputs.heartbeat_s = kNow_s + 0.6; }, ArmStatus::kHeartbeatLost,
      {"heartbeat", "ahead of the clock"});
  add("heartbeat NaN", [](auto* s) { s->inputs.heartbeat_s = kNaN; }, ArmStatus::kHeartbeatLost, {"heartbeat"});
  add("no heartbeat", [](auto* s) { s->inputs.heartbeat_s.reset(); }, ArmStatus::kHeartbeatLost, {"never heard"});
  ++gravity;
  add("silence", [](auto* s) { s->inputs.heartbeat_wall_s = 500.0 - 0.31; }, ArmStatus::kHeartbeatLost,
      {"wall clock", "0.31 s old", "allowed 0.3 s"});
  add("silence NaN", [](auto* s) { s->inputs.heartbeat_wall_s = kNaN; }, ArmStatus::kHeartbeatLost, {"wall clock"});
  add("wall NaN", [](auto* s) { s->inputs.wall_s = kNaN; }, ArmStatus::kHeartbeatLost, {"wall clock"});
  add("silence from the start", [](auto* s) { s->inputs.heartbeat_wall_s.reset(); }, ArmStatus::kHeartbeatLost,
      {"wall clock", "never heard"});
  return all;
}

TEST(SafetyGate, LetsPassWhenAllIsFine) {
  const Situation all = allFine();
  const Verdict verdict = SafetyGate(allOn()).check(all.inputs, all.demand);
  EXPECT_TRUE(verdict.isFine());
  EXPECT_EQ(verdict.message, "");
  Situation reduced = allFine();
  reduced.inputs.arm.safety_mode = safety_mode::kReduced;
  EXPECT_TRUE(SafetyGate(allOn()).check(reduced.inputs, reduced.demand).isFine());
}

TEST(SafetyGate, EachBreakageHasItsStatusAndSentence) {
  const SafetyGate gate(allOn());
  for (const Breakage& one : breakages()) {
    SCOPED_TRACE(one.what);
    Situation situation = allFine();
    one.apply(&situation);
    const Verdict verdict = gate.check(situation.inputs, situation.demand);
    EXPECT_EQ(verdict.status, one.status) << toString(verdict.status) << ": " << verdict.message;
    for (const std::string& text : one.says) EXPECT_THAT(verdict.message, HasSubstr(text));
  }
}

TEST(SafetyGate, OfTwoBreakagesTheGraverIsTold) {
  const SafetyGate gate(allOn());
  const std::vector<Breakage> all = breakages();
  int pairs = 0;
  for (const Breakage& grave : all) {
    for (const Breakage& lesser : all) {
      if (grave.gravity >= lesser.gravity) continue;
      Situation alone = allFine();
      grave.apply(&alone);
      Situation both = allFine();
      grave.apply(&both);
      lesser.apply(&both);
      if (lesser.what == "no monitor" || lesser.what == "another watch" || lesser.what == "watch NaN") {
        if (grave.status == ArmStatus::kPathBlocked) continue;  // the word to stop is gone with the monitor
      }
      const Verdict verdict = gate.check(both.inputs, both.demand);
      EXPECT_EQ(verdict.status, grave.status) << grave.what << " and " << lesser.what << ": " << verdict.message;
      EXPECT_EQ(verdict.message.substr(0, 12), gate.check(alone.inputs, alone.demand).message.substr(0, 12))
          << grave.what << " and " << lesser.what;
      ++pairs;
    }
  }
  EXPECT_GT(pairs, 1000);
}

TEST(SafetyGate, OfTheRobotAloneTheSameIsTold) {
  const SafetyGate gate(allOn());
  for (const Breakage& one : breakages()) {
    Situation situation = allFine();
    one.apply(&situation);
    const Verdict robot = gate.checkRobot(situation.inputs.arm, situation.inputs.now_s);
    const Verdict all = gate.check(situation.inputs, situation.demand);
    const bool is_robots = one.gravity <= 4;  // safety mode, robot mode, program, controller, joint states
    EXPECT_EQ(robot.status, is_robots ? all.status : ArmStatus::kSuccess) << one.what;
    EXPECT_EQ(robot.message, is_robots ? all.message : "") << one.what;
  }
}

TEST(SafetyGate, NothingHeardIsADriverThatIsGone) {
  const Verdict verdict = SafetyGate(allOn()).check({}, {});
  EXPECT_EQ(verdict.status, ArmStatus::kDriverGone);
}

TEST(SafetyGate, ClockThatIsNoNumberLetsNothingPass) {
  Situation all = allFine();
  all.inputs.now_s = kNaN;
  EXPECT_EQ(SafetyGate(allOn()).check(all.inputs, all.demand).status, ArmStatus::kStaleState);
}

TEST(SafetyGate, AgesJustAllowedPass) {
  Situation all = allFine();
  // 1e-6 s for the rounding of ROS times as doubles.
  all.inputs.arm.joints->stamp_s = kNow_s - 0.1 + 1e-6;
  all.inputs.arm.force->stamp_s = kNow_s - 0.1 + 1e-6;
  all.inputs.arm.speed_scaling->stamp_s = kNow_s - 0.5 + 1e-6;
  all.inputs.map_stamp_s = kNow_s - 2.0 + 1e-6;
  all.inputs.monitor->stamp_s = kNow_s - 0.5 + 1e-6;
  all.inputs.heartbeat_s = kNow_s - 0.13 + 1e-6;
  all.inputs.heartbeat_wall_s = 500.0 - 0.3 + 1e-6;
  EXPECT_EQ(SafetyGate(allOn()).check(all.inputs, all.demand).message, "");
  all.inputs.arm.joints->stamp_s = kNow_s + 0.5 - 1e-6;
  EXPECT_EQ(SafetyGate(allOn()).check(all.inputs, all.demand).message, "");
}

TEST(SafetyGate, ConditionsThatAreSwitchedOffAreNotAsked) {
  SafetyGateConfig config;
  config.max_map_age_s = 0.0;
  config.max_monitor_age_s = 0.0;
  config.max_heartbeat_age_s = 0.0;
  config.max_heartbeat_silence_s = 0.0;
  const SafetyGate gate(config);
  Situation all = allFine();
  all.inputs.map_stamp_s.reset();
  all.inputs.monitor.reset();
  all.inputs.heartbeat_s.reset();
  all.inputs.heartbeat_wall_s.reset();
  all.inputs.arm.force.reset();
  all.demand.needs_force = false;
  EXPECT_EQ(gate.check(all.inputs, all.demand).message, "");
  // But who watches without being asked is heard.
  all.inputs.monitor = MonitorWord{kNow_s, true, 7, true, "wrist meets the map"};
  EXPECT_EQ(gate.check(all.inputs, all.demand).status, ArmStatus::kPathBlocked);
}

TEST(SafetyGate, NewWatchHasTimeToBeHeardOf) {
  const SafetyGate gate(allOn());
  Situation all = allFine();
  all.demand.watch_id = 8;  // the monitor still tells of 7, which it must have stopped
  all.inputs.monitor->must_stop = true;
  all.demand.watch_since_s = kNow_s - 0.49;
  EXPECT_EQ(gate.check(all.inputs, all.demand).message, "");
  all.demand.watch_since_s = kNow_s - 0.51;
  EXPECT_EQ(gate.check(all.inputs, all.demand).status, ArmStatus::kMonitorGone);
  all.demand.watch_since_s = kNow_s + 0.6;
  EXPECT_EQ(gate.check(all.inputs, all.demand).status, ArmStatus::kMonitorGone) << "ahead of the clock";
}

TEST(SafetyGate, WordOfTheSameNumberFromBeforeTheWatchDoesNotMakeItOld) {
  Situation all = allFine();
  all.demand.watch_since_s = kNow_s - 0.2;
  all.inputs.monitor->stamp_s = kNow_s - 5.0;
  EXPECT_EQ(SafetyGate(allOn()).check(all.inputs, all.demand).message, "");
}

TEST(SafetyGate, BeforeTheWatchTheMonitorMayBeSilent) {
  const SafetyGate gate(allOn());
  Situation all = allFine();
  all.demand.watch_id.reset();
  all.inputs.monitor = MonitorWord{kNow_s - 0.1, true, 3, true, "of the last trajectory"};
  EXPECT_EQ(gate.check(all.inputs, all.demand).message, "");
  all.inputs.monitor = MonitorWord{kNow_s - 0.1, false, 0, false, ""};
  EXPECT_EQ(gate.check(all.inputs, all.demand).message, "");
  all.inputs.monitor->stamp_s = kNow_s - 60.0;
  EXPECT_EQ(gate.check(all.inputs, all.demand).message, "");
  all.inputs.monitor.reset();
  EXPECT_EQ(gate.check(all.inputs, all.demand).message, "");
}

TEST(SafetyGate, RefusesImpossibleConfigurations) {
  SafetyGateConfig config;
  config.max_monitor_age_s = kInfinity;
  EXPECT_THROW(SafetyGate{config}, std::invalid_argument);
}

}  // namespace
}  // namespace ur_driver_bridge
