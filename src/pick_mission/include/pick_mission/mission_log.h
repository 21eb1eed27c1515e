// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>

#include <nlohmann/json.hpp>

#include "pick_mission/mission_types.h"

namespace pick_mission {

/// What a mission is about; for its summary.
struct MissionInfo {
  std::string scene;
  int seed{0};
  std::string strategy;        // of the selection; empty: its default
  std::string removed_factor;  // of an ablation
};

struct MissionCounts {
  int bricks_picked{0};
  int bricks_open{0};       // known, with attempts left
  int bricks_exhausted{0};  // their attempts are used up
  int picks_begun{0};
  int views{0};  // standing places that were selected and reached
  int failures{0};
};

/// A step of the mission: what happened in `state`, and what it led to.
struct LogEntry {
  double time_s{0.0};
  State state{State::kIdle};
  std::string event;
  State decision{State::kIdle};  // the same state: nothing changed
  std::string reason;
  double state_s{0.0};  // how long it has been in `state`
  MissionCounts counts;
};

/// One line, without its end.
std::string toJsonLine(const LogEntry& entry);

/// What a mission knows of itself; what the simulator judges is not in it.
struct MissionSummary {
  MissionInfo info;
  int bricks_total{-1};  // -1: not known
  MissionCounts counts;
  EndReason end_reason{EndReason::kNotEnded};
  std::string end_message;
  std::map<std::string, int> failures;  // "state: status"
  double sim_seconds{0.0};              // ROS time, without pauses
  double wall_seconds{0.0};
};
nlohmann::json toJson(const MissionSummary& summary);

}  // namespace pick_mission
