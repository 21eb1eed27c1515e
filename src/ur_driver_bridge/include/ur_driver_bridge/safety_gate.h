// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include <interactive_mapping_common/config/schema.h>

#include "ur_driver_bridge/arm_state.h"
#include "ur_driver_bridge/arm_status.h"

namespace ur_driver_bridge {

struct SafetyGateConfig {
  double max_joint_age_s{0.1};
  double max_force_age_s{0.1};
  double max_speed_scaling_age_s{0.5};
  double max_map_age_s{2.0};
  double max_monitor_age_s{0.5};
  double max_heartbeat_age_s{0.13};
  double max_heartbeat_silence_s{0.0};
  double max_future_s{0.5};

  static void fields(SafetyGateConfig& c, interactive_mapping::Fields& f) {
    f("max_joint_age_s", c.max_joint_age_s, 0.005, 1.0, "s", "greatest age of the newest joint state");
    f("max_force_age_s", c.max_force_age_s, 0.005, 1.0, "s",
      "greatest age of the force, checked during the touch and while a brick is held");
    f("max_speed_scaling_age_s", c.max_speed_scaling_age_s, 0.005, 10.0, "s",
      "greatest age of the speed scaling, by its arrival");
    f("max_map_age_s", c.max_map_age_s, 0.0, 60.0, "s", "greatest age of the last image in the map; 0: not checked");
    f("max_monitor_age_s", c.max_monitor_age_s, 0.0, 5.0, "s",
      "greatest age of the path monitor's last message; 0: the arm moves without a monitor");
    f("max_heartbeat_age_s", c.max_heartbeat_age_s, 0.0, 5.0, "s",
      "greatest age of the mission's heartbeat, ROS time: one of 20 Hz may be lost; 0: the arm moves without it");
    f("max_heartbeat_silence_s", c.max_heartbeat_silence_s, 0.0, 5.0, "s",
      "longest time without a heartbeat by the wall clock, for real hardware; 0: not checked");
    f("max_future_s", c.max_future_s, 0.0, 5.0, "s", "a stamp farther ahead of the clock is invalid");
  }
};

struct MonitorWord {
  double stamp_s{0.0};
  bool is_watching{false};
  std::uint32_t watch_id{0};
  bool must_stop{false};
  std::string reason;
};

struct GateInputs {
  double now_s{0.0};   // ROS time
  double wall_s{0.0};  // steady clock
  ArmState arm;
  std::optional<double> map_stamp_s;  // of the newest image in the map
  std::optional<MonitorWord> monitor;
  std::optional<double> heartbeat_s;       // newest stamp, ROS time
  std::optional<double> heartbeat_wall_s;  // when it was heard, steady clock
  bool is_held{false};                     // by the operator
};

/// Which of the conditions apply.
struct GateDemand {
  bool needs_force{false};                // the motion is guarded by the force, or a load is looked after
  std::optional<std::uint32_t> watch_id;  // the monitor must watch just this; nothing: before the watch begins, then it
                                          // is enough that the monitor lives
  double watch_since_s{0.0};              // when it was begun: words from before do not count against the monitor's age
};

/// May the arm move? The first condition that does not hold, in the order of gravity. First comes what stops the robot
/// itself (safety mode, robot mode, program, driver), then the operator's hold and the path monitor's stop. Then comes
/// what is not known: force, speed scaling, map, monitor, heartbeat. A stamp that is not finite or too far ahead of the
/// clock counts as too old. Joint states that are late are kStaleState; never heard or later than a second:
/// kDriverGone.
class SafetyGate {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  explicit SafetyGate(const SafetyGateConfig& config);

  Verdict check(const GateInputs& inputs, const GateDemand& demand) const;

  /// Of these the part about the robot alone: safety mode, robot mode, program, controller, joint states.
  Verdict checkRobot(const ArmState& arm, double now_s) const;

 private:
  std::string monitorProblem(const GateInputs& inputs, const GateDemand& demand) const;

  SafetyGateConfig config_;
};

/// Names as the messages have them: "RUNNING (7)", "unknown (17)".
std::string robotModeName(int mode);
std::string safetyModeName(int mode);

}  // namespace ur_driver_bridge
