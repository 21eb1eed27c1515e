// SPDX-License-Identifier: BSD-3-Clause
#include "mission.h"

#include <algorithm>

#include "wording.h"

namespace pick_mission {
namespace {

int& streakOf(State action, Memory& memory) {
  return memory.streaks[static_cast<std::size_t>(action)];
}

/// A place of the survey that cannot be driven to is left out, and there are only so many of them.
bool countsInARow(State action, const Reaction& reaction, const Mission& mission) {
  const bool is_left_out = action == State::kDrive && reaction.is_reported && mission.goal.why != DriveFor::kView &&
                           mission.goal.why != DriveFor::kDepot;
  return reaction.counts_in_a_row && !is_left_out;
}

std::string kindOf(State action, const Result& result) {
  return std::string(toString(action)) + ": " + toString(result);
}

void brickStowed(Mission& mission) {
  Memory& memory = mission.memory;
  ++memory.places_used;
  if (memory.brick_in_hand && memory.ledger.isKnown(*memory.brick_in_hand)) {
    memory.ledger.picked(*memory.brick_in_hand);
  } else {
    ++memory.picked_without_id;
    memory.ledger.pileChanged();
  }
  // Whatever was answered on the way to it.
  streakOf(State::kPick, memory) = streakOf(State::kLetGo, memory) = 0;
  memory.fruitless_views = memory.low_utility_views = memory.vantage_drives = memory.fade_waits = 0;
  memory.excluded.clear();
  mission.plan_reports.clear();
  mission.is_view_untried = false;
  mission.approaches_tried_bricks = false;
}

/// By the bridge; where it does not tell, by the result. Nothing: as before.
std::optional<Hand> handAfter(State action, const event::Reply& reply) {
  if (reply.hand || !handlesBrick(action)) return reply.hand;
  const auto* arm = std::get_if<ArmResult>(&reply.result);
  if (arm == nullptr) return Hand::kUnknown;
  switch (arm->status) {
    case ArmStatus::kSuccess:
      return action == State::kStow ? Hand::kHolding : Hand::kEmpty;
    case ArmStatus::kNothingHeld:
    case ArmStatus::kLostOnTheWay:
      return Hand::kEmpty;
    case ArmStatus::kNotLetGo:
      return Hand::kHolding;
    default:
      return Hand::kUnknown;
  }
}

void recordArm(const Mission::Running& ended, const event::Reply& reply, Mission& mission) {
  Memory& memory = mission.memory;
  const State action = ended.action;
  const std::optional<int> held_before = memory.brick_in_hand;
  const auto* arm = std::get_if<ArmResult>(&reply.result);
  mission.is_protective_stop = arm != nullptr && arm->status == ArmStatus::kProtectiveStop;
  // No camera looks into the container. What the arm met may be a brick that rises over its rim: it would meet it again. A
  // brick that was lost may have fallen into it, where the next one is to lie.
  if ((mission.is_protective_stop && memory.places_used > 0) || (arm != nullptr && arm->is_lost_over_robot)) {
    memory.places_used = capacityOf(mission.config);
  }
  const bool is_lost =
      arm != nullptr && (arm->status == ArmStatus::kLostOnTheWay || arm->status == ArmStatus::kNothingHeld);
  if (is_lost) memory.is_let_go_open = false;  // it fell before that
  if (action == State::kPick) memory.brick_in_hand = ended.brick->id;
  if (const std::optional<Hand> hand = handAfter(action, reply)) setHand(*hand, mission);
  if (!is_lost || !held_before || action == State::kPick) return;
  // A pick after all that failed: it lies somewhere else now.
  ++memory.scene;
  if (memory.ledger.isKnown(*held_before)) memory.ledger.pickFailed(*held_before, kindOf(action, reply.result));
}

void recordDetection(const std::vector<SeenBrick>& bricks, Memory& memory) {
  const BrickLedger::Update update = memory.ledger.update(bricks);
  if (!update.found.empty()) memory.fruitless_views = 0;
  for (const int id : update.came_back)
    ++memory.failures["brick " + std::to_string(id) + ": seen again after its pick"];
}

/// A view that showed new ground was not fruitless.
void recordSelection(const SelectionResult& selection, Mission& mission) {
  constexpr double kNew_m2 = 0.05;  // the map's edge of seen ground moves by so much between two looks from one pose
  mission.selection = selection;
  std::optional<double>& least_m2 = mission.least_unseen_m2;
  if (least_m2 && selection.unseen_m2 > *least_m2 - kNew_m2) return;
  if (least_m2) mission.memory.fruitless_views = 0;
  least_m2 = selection.unseen_m2;
}

void recordArrival(Mission& mission) {
  const DriveFor why = mission.goal.why;
  mission.memory.base = mission.goal.T_map_base;
  mission.is_view_untried = mission.is_place_chosen = why == DriveFor::kView;
  mission.pick_failures_here = mission.plan_failures_here = 0;
  if (why == DriveFor::kSurvey) ++mission.memory.survey_index;
  if (why == DriveFor::kView) ++mission.memory.views;
}

void recordSuccess(const Mission::Running& ended, const event::Reply& reply, Mission& mission) {
  Memory& memory = mission.memory;
  const State action = ended.action;
  streakOf(action, memory) = 0;
  switch (action) {
    case State::kPlanPick: {
      auto& faces = mission.candidate->graspable_faces;
      const std::uint8_t planned = std::get<PlanResult>(reply.result).face;
      std::stable_partition(faces.begin(), faces.end(), [&](std::uint8_t face) { return face == planned; });
    }
      [[fallthrough]];
    case State::kPlanClear:
    case State::kPlanStow:
      mission.plan_id = reply.id;
      break;
    case State::kClear:
    case State::kStow:
    case State::kPick:
      mission.arm = action == State::kClear ? ArmIs::kFolded : ArmIs::kOverPlace;
      mission.recoveries = 0;
      // Still holding, against what the result says: it is stowed, and counts then.
      if (action != State::kPick || mission.hand == Hand::kHolding) break;
      memory.brick_in_hand = ended.brick->id;
      if (!ended.is_looked_ahead) ++memory.scene;  // else it was another when the brick had left it
      brickStowed(mission);
      memory.brick_in_hand.reset();
      break;
    case State::kLook:
      mission.map_stamp_s = std::get<LookResult>(reply.result).map_stamp_s;
      break;
    case State::kDetect:
      recordDetection(std::get<DetectionResult>(reply.result).bricks, memory);
      break;
    case State::kSelect:
      recordSelection(std::get<SelectionResult>(reply.result), mission);
      break;
    case State::kDrive:
      recordArrival(mission);
      break;
    default:
      break;
  }
}

void recordFailure(const Mission::Running& ended, const event::Reply& reply, const Reaction& reaction,
                   Mission& mission) {
  Memory& memory = mission.memory;
  const State action = ended.action;
  const std::string kind = kindOf(action, reply.result);
  const std::string reason = withMessage(kind, reply.message);
  ++memory.failures[kind];
  mission.is_drive_due = mission.is_next_planned = false;
  if (countsInARow(action, reaction, mission)) ++streakOf(action, memory);
  // The brick may lie in its place.
  if (action == State::kPick && std::holds_alternative<NoAnswer>(reply.result) && mission.hand != Hand::kHolding) {
    ++memory.places_used;
  }
  if (const auto* selection = std::get_if<SelectionResult>(&reply.result)) mission.selection = *selection;
  if (action == State::kPlanPick && reaction.blames_brick) {
    memory.ledger.planFailed(ended.brick->id, kind);
    memory.ledger.triedInVain(ended.brick->id, memory.scene);
    ++mission.plan_failures_here;
  }
  // A brick that hangs on the magnet nevertheless is stowed, and picked then.
  if (action == State::kPick && reaction.blames_brick && mission.hand != Hand::kHolding) {
    const auto& faces = ended.brick->graspable_faces;
    memory.ledger.pickFailed(ended.brick->id, kind, faces.empty() ? std::nullopt : std::make_optional(faces.front()));
    if (reaction.next == Trigger::kNextBrick) memory.ledger.triedInVain(ended.brick->id, memory.scene);
    ++mission.pick_failures_here;
  }
  if (!reaction.is_reported) return;
  const Pose2d& goal = mission.goal.T_map_base;
  if (action != State::kDrive) {
    auto& reports = action == State::kPlanPick ? mission.plan_reports : memory.reports;
    reports.push_back({nearSideOf(*ended.brick, memory.base), mission.now_s, reason});
  } else if (mission.goal.why == DriveFor::kSurvey) {
    ++memory.survey_index;
  } else if (mission.goal.why == DriveFor::kView) {
    exclude(goal.position(), mission);
    memory.reports.push_back({{goal.x_m, goal.y_m, 0.0}, mission.now_s, reason});
  }
}

}  // namespace

void record(const Mission::Running& ended, const event::Reply& reply, const Reaction& reaction, bool is_broken_off,
            Mission& mission) {
  Memory& memory = mission.memory;
  const State action = ended.action;
  recordArm(ended, reply, mission);
  const bool was_a_pick = (action == State::kPick && !ended.is_looked_ahead) || action == State::kLetGo;
  if (was_a_pick) mission.is_place_chosen = false;
  if (action == State::kReport) memory.reports.pop_front();
  if (isSuccess(reply.result)) {
    recordSuccess(ended, reply, mission);
  } else if (action == State::kReport || !is_broken_off) {
    recordFailure(ended, reply, reaction, mission);
  }
  // A failed plan takes no time and a drive does: the other bricks in reach come first.
  const bool is_next_brick = action == State::kPlanPick && reaction.blames_brick && holds(Guard::kBrickHere, mission);
  if (!isSuccess(reply.result) && !is_next_brick) mission.is_place_chosen = false;
  if (action != State::kDrive) return;
  // Also after a failure it stands somewhere else.
  ++memory.scene;
  const auto* drive = std::get_if<NavigationResult>(&reply.result);
  if (drive != nullptr && drive->T_map_base) memory.base = *drive->T_map_base;
}

void setHand(Hand hand, Mission& mission) {
  Memory& memory = mission.memory;
  mission.hand = hand;
  if (hand == Hand::kUnknown) return;
  if (hand == Hand::kEmpty && memory.is_let_go_open) {
    ++memory.scene;
    brickStowed(mission);
  }
  memory.is_let_go_open = false;
  mission.unknown_hand_waits = 0;
  if (hand == Hand::kEmpty) memory.brick_in_hand.reset();
}

int tooManyInARow(State action, const Reaction& reaction, const Mission& mission) {
  const MissionConfig& config = mission.config;
  const int most =
      action == State::kRecover ? config.attempts.max_recoveries_in_a_row : config.attempts.max_failures_in_a_row;
  const int streak = mission.memory.streaks[static_cast<std::size_t>(action)];
  return countsInARow(action, reaction, mission) && streak >= most ? streak : 0;
}

}  // namespace pick_mission
