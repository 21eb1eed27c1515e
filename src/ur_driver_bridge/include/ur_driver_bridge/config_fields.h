// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "ur_driver_bridge/executor.h"

/// The table of all keys, for whoever reads or writes configurations: visit(key, value) for each.
namespace ur_driver_bridge {

template <typename Config, typename Visitor>
void visitExecutorFields(Config& config, Visitor&& visit) {
  visit("gate/max_joint_age_s", config.gate.max_joint_age_s);
  visit("gate/max_force_age_s", config.gate.max_force_age_s);
  visit("gate/max_speed_scaling_age_s", config.gate.max_speed_scaling_age_s);
  visit("gate/max_map_age_s", config.gate.max_map_age_s);
  visit("gate/max_monitor_age_s", config.gate.max_monitor_age_s);
  visit("gate/max_heartbeat_age_s", config.gate.max_heartbeat_age_s);
  visit("gate/max_heartbeat_silence_s", config.gate.max_heartbeat_silence_s);
  visit("gate/max_future_s", config.gate.max_future_s);

  visit("motion/start_tolerance_rad", config.motion.start_tolerance_rad);
  visit("motion/acceleration_rad_s2", config.motion.acceleration_rad_s2);
  visit("motion/stop_s", config.motion.stop_s);
  visit("motion/latency_s", config.motion.latency_s);
  visit("motion/rest_rad_s", config.motion.rest_rad_s);
  visit("motion/rest_timeout_s", config.motion.rest_timeout_s);
  visit("motion/answer_timeout_s", config.motion.answer_timeout_s);
  visit("motion/end_patience_s", config.motion.end_patience_s);
  visit("motion/stall_speed", config.motion.stall_speed);
  visit("motion/stall_patience_s", config.motion.stall_patience_s);
  visit("motion/watch_drift_s", config.motion.watch_drift_s);

  visit("contact/threshold_N", config.contact.threshold_N);
  visit("contact/debounce_s", config.contact.debounce_s);
  visit("contact/sideways_N", config.contact.sideways_N);
  visit("contact/hard_N", config.contact.hard_N);

  visit("pick/settle_s", config.pick.settle_s);
  visit("pick/early_m", config.pick.early_m);
  visit("pick/contact_stop_s", config.pick.contact_stop_s);
  visit("pick/magnet_settle_s", config.pick.magnet_settle_s);
  visit("pick/weigh_height_m", config.pick.weigh_height_m);
  visit("pick/weigh_timeout_s", config.pick.weigh_timeout_s);
  visit("pick/ramp_s", config.pick.ramp_s);

  visit("load/weigh_s", config.load.weigh_s);
  visit("load/min_samples", config.load.min_samples);
  visit("load/max_spread_N", config.load.max_spread_N);
  visit("load/min_share", config.load.min_share);
  visit("load/max_share", config.load.max_share);
  visit("load/lost_share", config.load.lost_share);
  visit("load/lost_s", config.load.lost_s);

  visit("magnet/digital_output", config.magnet_pin);
  visit("magnet/io_timeout_s", config.io_timeout_s);

  visit("recovery/is_headless", config.recovery.is_headless);
  visit("recovery/unlock_wait_s", config.recovery.unlock_wait_s);
  visit("recovery/step_timeout_s", config.recovery.step_timeout_s);
  visit("recovery/max_commands", config.recovery.max_commands);
}

}  // namespace ur_driver_bridge
