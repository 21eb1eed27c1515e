// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "pick_mission/brick_ledger.h"
#include "pick_mission/mission_config.h"
#include "pick_mission/mission_log.h"
#include "pick_mission/mission_types.h"
#include "pick_mission/transitions.h"

namespace pick_mission {

struct MissionOutput {
  std::vector<Command> commands;  // in this order; at most one that is answered
  std::vector<LogEntry> log;
};

/// The whole cycle (method section 9): survey, inspect, choose, pick, next view, until the pile is gone. No threads and no
/// clock: step() takes an event and returns commands. One action at a time; transitions() says what leads where,
/// reactTo() what a result means.
///
/// - The arm is out of the camera's view and the hand empty before the robot looks, selects or drives.
/// - A pick follows a plan that was made after the last look.
/// - A brick that hangs on the magnet is stowed before anything else, even if the mission is over.
/// - Everything that is tried again is counted, and ends.
class MissionMachine {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  MissionMachine(const MissionConfig& config, MissionInfo info);
  /// Of a mission that was interrupted, as toJson() saved it. It waits for Start as a new one does, and begins with a
  /// fresh inspection. One that its operator had paused, held or stopped waits for the operator, paused or held. One
  /// that had ended stays ended. Throws std::invalid_argument if `saved` is not such a state.
  static MissionMachine fromJson(const MissionConfig& config, MissionInfo info, const nlohmann::json& saved);
  ~MissionMachine();
  MissionMachine(MissionMachine&& other) noexcept;
  MissionMachine& operator=(MissionMachine&& other) noexcept;

  /// Replies of commands before the running one change nothing. Throws std::invalid_argument for times that are not finite
  /// and for a reply that the running action cannot give; nothing has changed then.
  MissionOutput step(const Event& event, double now_s);

  State state() const;
  Hand hand() const;
  EndReason endReason() const;
  const std::string& endMessage() const;
  const BrickLedger& bricks() const;
  MissionCounts counts() const;
  int placesUsed() const;                   // in the container
  std::optional<Pose2d> startPose() const;  // in the map: what workspace, survey and depot are relative to
  bool isPauseWanted() const;               // it pauses when the running action has ended
  double usedTime() const;                  // [s], without pauses
  MissionSummary summary(double wall_s) const;

  /// To be saved after each step that changed the state.
  nlohmann::json toJson() const;

 private:
  class Impl;
  explicit MissionMachine(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace pick_mission
