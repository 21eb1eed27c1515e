// SPDX-License-Identifier: BSD-3-Clause
#include "mission.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

namespace pick_mission {
namespace {

command::SelectView selectView(const Mission& mission) {
  command::SelectView select{mission.info.strategy, mission.memory.excluded, mission.map_stamp_s, workspaceOf(mission),
                             mission.config.views.choose_after_each_pick};
  for (const command::Zone& zone : zonesToKeepAwayFrom(mission)) select.excluded.push_back(zone);
  return select;
}

/// Where the next brick goes. A brick that hangs on the magnet has a place, even if it was counted as lost with its pick.
const std::string& freePlace(const Mission& mission) {
  const int used = mission.memory.places_used + (mission.carrying ? 1 : 0);
  const int index = std::min(used, capacityOf(mission.config) - 1);
  return mission.config.stow[static_cast<std::size_t>(index)];
}

Command::Body bodyOf(State action, Mission& mission) {
  const MissionConfig& config = mission.config;
  Memory& memory = mission.memory;
  switch (action) {
    case State::kPlanClear:
      return command::PlanArm{};
    case State::kPlanStow:
      return command::PlanArm{freePlace(mission)};
    case State::kClear:
    case State::kStow:
      mission.arm = ArmIs::kAnywhere;
      return command::MoveArm{mission.plan_id};
    case State::kLook:
      mission.is_next_planned = false;  // if at all, it is of an older look
      return command::Look{config.look.images, config.look.timeout_s};
    case State::kDetect:
      return command::Detect{config.detect.timeout_s};
    case State::kReport:
      return memory.reports.front();
    case State::kPlanPick:
      mission.candidate = memory.nextBrick();
      return command::PlanPick{*mission.candidate, mission.map_stamp_s, freePlace(mission),
                               mission.carrying.has_value()};
    case State::kPick:
      mission.arm = ArmIs::kAnywhere;
      mission.is_next_planned = false;
      ++memory.picks_begun;
      memory.ledger.pickBegun(mission.candidate->id);
      memory.pick_running = mission.candidate->id;
      return command::Pick{*mission.candidate, mission.plan_id};
    case State::kLetGo:
      memory.is_let_go_open = true;
      return command::LetGo{};
    case State::kSelect:
      return selectView(mission);
    case State::kDrive:
      mission.is_drive_due = false;
      return command::Drive{mission.goal.T_map_base};
    case State::kRecover:
      mission.arm = ArmIs::kAnywhere;
      return command::Recover{config.unlocks_protective_stop};
    case State::kWait:
      return mission.wait;
    default:
      throw std::logic_error(std::string("state \"") + toString(action) + "\" has no action");
  }
}

}  // namespace

void takeUpPick(Mission& mission) {
  mission.running = std::exchange(mission.carrying, std::nullopt);
}

Command begin(Mission& mission) {
  Command command;
  command.id = ++mission.memory.last_id;
  command.body = bodyOf(mission.state, mission);
  command.is_beside_pick = mission.carrying.has_value();
  mission.running = Mission::Running{command.id, mission.state};
  if (mission.state == State::kPlanPick || mission.state == State::kPick) mission.running->brick = mission.candidate;
  return command;
}

}  // namespace pick_mission
