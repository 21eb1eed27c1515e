// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "pick_mission/brick_ledger.h"
#include "pick_mission/mission_types.h"

namespace pick_mission {

/// What a mission remembers: all that survives a crash of its process. Poses in the map.
struct Memory {
  explicit Memory(BrickLedger empty_ledger) : ledger(std::move(empty_ledger)) {}

  EndReason end_reason{EndReason::kNotEnded};
  std::string end_message;
  bool is_ending{false};          // the mission is over, but a brick may have to be stowed first
  bool has_ended{false};          // that is done, too; this and the next follow the state
  std::optional<State> waits_in;  // paused or held: the operator has to resume a mission that restarts
  bool is_hold_given{false};      // to the arm's bridge, and not released
  bool is_let_go_open{false};     // the magnet was told to let go, and what came of it is not known
  double used_s{0.0};             // ROS time, without pauses

  std::optional<Pose2d> start_pose;
  Pose2d base;
  std::size_t survey_index{0};

  /// To be tried from here; none: no brick may be.
  std::optional<SeenBrick> nextBrick() const { return ledger.best(scene, base.position(), fruitless_views); }

  BrickLedger ledger;
  std::optional<int> brick_in_hand;
  std::optional<int> pick_running;  // the brick of a pick that has not been answered
  int picked_without_id{0};         // stowed bricks of which nobody knew the id
  int scene{0};                     // changes with robot and pile
  int places_used{0};               // in the container, since it was unloaded; all: nothing more may go there

  int views{0};  // selected and reached
  int picks_begun{0};
  // Since a brick was last stowed.
  int fruitless_views{0};
  int low_utility_views{0};
  int vantage_drives{0};
  int fade_waits{0};
  std::vector<command::Zone> excluded;

  std::array<int, kNumStates> streaks{};       // failures in a row, by action
  std::map<std::string, int> failures;         // "action: status"
  std::deque<command::ReportFailure> reports;  // not yet sent to the selection
  std::uint64_t last_id{0};                    // of a command

  /// visit(key, member) for each: the one list for saving and restoring.
  template <typename Self, typename Visitor>
  static void visitFields(Self& self, Visitor&& visit) {
    visit("end_reason", self.end_reason);
    visit("end_message", self.end_message);
    visit("is_ending", self.is_ending);
    visit("has_ended", self.has_ended);
    visit("waits_in", self.waits_in);
    visit("is_hold_given", self.is_hold_given);
    visit("is_let_go_open", self.is_let_go_open);
    visit("used_s", self.used_s);
    visit("start_pose", self.start_pose);
    visit("base", self.base);
    visit("survey_index", self.survey_index);
    visit("bricks", self.ledger);
    visit("brick_in_hand", self.brick_in_hand);
    visit("pick_running", self.pick_running);
    visit("nameless_picked", self.picked_without_id);
    visit("scene", self.scene);
    visit("places_used", self.places_used);
    visit("views", self.views);
    visit("picks_begun", self.picks_begun);
    visit("fruitless_views", self.fruitless_views);
    visit("low_utility_views", self.low_utility_views);
    visit("vantage_drives", self.vantage_drives);
    visit("fade_waits", self.fade_waits);
    visit("excluded", self.excluded);
    visit("streaks", self.streaks);
    visit("failures", self.failures);
    visit("reports", self.reports);
    visit("last_id", self.last_id);
  }
};

nlohmann::json toJson(const Memory& memory);
/// A pick that was not answered has failed then: nobody knows how it ended. Throws std::invalid_argument for what is no
/// mission's state; `memory` is worth nothing then.
void restore(const nlohmann::json& saved, Memory& memory);

}  // namespace pick_mission
