// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "ur_driver_bridge/arm_state.h"
#include "ur_driver_bridge/arm_status.h"

namespace ur_driver_bridge {

struct SafetyGateConfig {
  double max_joint_age_s{0.1};
  double max_force_age_s{0.1};  // looked at while the force matters
  double max_speed_scaling_age_s{0.5};
  double max_map_age_s{2.0};            // since the last image in the map; 0: the map is not asked
  double max_monitor_age_s{0.5};        // of what the path monitor says; 0: motion without it
  double max_heartbeat_age_s{0.13};     // of the mission, ROS time: one of 20 Hz may be lost; 0: motion without it
  double max_heartbeat_silence_s{0.0};  // the same by the wall clock, for real hardware; 0: off
  double max_future_s{0.5};             // a stamp this far ahead of the clock is no stamp

  std::vector<std::string> validate() const;
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

/// May the arm move? The first condition that does not hold, in the order of gravity: what stops the robot itself (safety
/// mode, robot mode, program, driver), the operator's hold, the path monitor's word to stop, then what is not known: force,
/// speed scaling, map, monitor, heartbeat. A stamp that is not finite or too far ahead of the clock counts as too old.
/// Joint states that are late are kStaleState; never heard or later than a second: kDriverGone.
class SafetyGate {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  explicit SafetyGate(const SafetyGateConfig& config);

  Verdict check(const GateInputs& inputs, const GateDemand& demand) const;

  /// Of these the part about the robot alone: safety mode, robot mode, program, controller, joint states.
  Verdict checkRobot(const ArmState& arm, double now_s) const;

  const SafetyGateConfig& config() const { return config_; }

 private:
  std::string monitorProblem(const GateInputs& inputs, const GateDemand& demand) const;

  SafetyGateConfig config_;
};

/// Names as the messages have them: "RUNNING (7)", "unknown (17)".
std::string robotModeName(int mode);
std::string safetyModeName(int mode);

}  // namespace ur_driver_bridge
