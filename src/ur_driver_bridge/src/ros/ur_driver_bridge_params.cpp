// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge_ros/ur_driver_bridge_params.h"

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common_ros/params.h>

#include "ur_driver_bridge/config_fields.h"
#include "ur_driver_bridge_ros/attached_memory.h"

namespace ur_driver_bridge_ros {
namespace {

/// visit(key, value) for each key.
constexpr auto kVisitParams = [](auto& params, auto&& visit) {
  visit("base_frame", params.base_frame);
  visit("bricks_file", params.bricks_file);
  visit("max_payload_kg", params.max_payload_kg);
  visit("watchdog_rate_hz", params.watchdog_rate_hz);
  visit("lockstep_wait_s", params.lockstep_wait_s);
  visit("recovery/unlocks_by_itself", params.unlocks_by_itself);
  ur_driver_bridge::visitExecutorFields(params.executor, visit);
};

}  // namespace

std::vector<std::string> UrDriverBridgeParams::validate() const {
  std::vector<std::string> problems;
  if (base_frame.empty() || base_frame.front() == '/') {
    problems.push_back("base_frame = '" + base_frame + "', must be a tf2 frame: no leading slash");
  }
  if (bricks_file.empty() || bricks_file.front() != '/') {
    problems.push_back("bricks_file = '" + bricks_file + "', must be the absolute path of a bricks.yaml");
  }
  interactive_mapping::RangeCheck check;
  check("max_payload_kg", max_payload_kg, 0.1, 100.0, "kg");
  check("watchdog_rate_hz", watchdog_rate_hz, 10.0, 500.0, "Hz");
  check("lockstep_wait_s", lockstep_wait_s, 0.0, 60.0, "s");
  problems.insert(problems.end(), check.problems().begin(), check.problems().end());
  const std::vector<std::string> more = executor.validate();
  problems.insert(problems.end(), more.begin(), more.end());
  return problems;
}

std::string toYaml(const UrDriverBridgeParams& params) {
  return interactive_mapping_ros::paramsToYaml(params, kVisitParams);
}

UrDriverBridgeParams loadUrDriverBridgeParams(const ros::NodeHandle& private_nh) {
  auto params = interactive_mapping_ros::loadParams<UrDriverBridgeParams>(
      private_nh, kVisitParams, {"diagnostic_period", "diagnostic_updater", AttachedMemory::kParam});
  if (params.unlocks_by_itself) {
    params.executor.recovery.protective_stop = ur_driver_bridge::ProtectiveStopPolicy::kAutomatic;
  }
  return params;
}

}  // namespace ur_driver_bridge_ros
