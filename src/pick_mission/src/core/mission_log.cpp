// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/mission_log.h"

namespace pick_mission {
namespace {

/// Messages come from everywhere: what is no UTF-8 is replaced, a log line must not fail.
std::string dumped(const nlohmann::json& json) {
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

}  // namespace

std::string toJsonLine(const LogEntry& entry) {
  const MissionCounts& counts = entry.counts;
  nlohmann::json line = {{"time_s", entry.time_s},
                         {"state", toString(entry.state)},
                         {"event", entry.event},
                         {"decision", toString(entry.decision)},
                         {"reason", entry.reason},
                         {"state_s", entry.state_s},
                         {"bricks_picked", counts.bricks_picked},
                         {"bricks_open", counts.bricks_open},
                         {"bricks_exhausted", counts.bricks_exhausted},
                         {"picks_begun", counts.picks_begun},
                         {"views", counts.views},
                         {"failures", counts.failures}};
  return dumped(line);
}

nlohmann::json toJson(const MissionSummary& summary) {
  nlohmann::json json = {{"scene", summary.info.scene},
                         {"seed", summary.info.seed},
                         {"strategy", summary.info.strategy},
                         {"removed_factor", summary.info.removed_factor},
                         {"bricks_total", nullptr},
                         {"bricks_picked", summary.counts.bricks_picked},
                         {"bricks_exhausted", summary.counts.bricks_exhausted},
                         {"picks_begun", summary.counts.picks_begun},
                         {"views", summary.counts.views},
                         {"end_reason", toString(summary.end_reason)},
                         {"end_message", summary.end_message},
                         {"failures", summary.failures},
                         {"sim_seconds", summary.sim_seconds},
                         {"wall_seconds", summary.wall_seconds}};
  if (summary.bricks_total >= 0) json["bricks_total"] = summary.bricks_total;
  // Once more through text: whoever writes it must not fail at a byte that is no UTF-8.
  return nlohmann::json::parse(dumped(json));
}

}  // namespace pick_mission
