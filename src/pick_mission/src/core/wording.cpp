// SPDX-License-Identifier: BSD-3-Clause
#include "wording.h"

#include <iomanip>
#include <sstream>

namespace pick_mission {
namespace {

/// Why each brick that is there is left for now.
std::string obstaclesInWords(const Memory& memory) {
  std::string text;
  for (const auto& [id, record] : memory.ledger.bricks()) {
    const std::string obstacle = memory.ledger.obstacleTo(id, memory.scene, memory.fruitless_views);
    if (record.is_picked || !record.is_there || obstacle.empty()) continue;
    text += (text.empty() ? ": brick " : ", ") + std::to_string(id) + " " + obstacle;
  }
  return text;
}

std::string brickInWords(const std::optional<SeenBrick>& seen) {
  return seen ? "brick " + std::to_string(seen->id) : "a brick";
}

std::string driveInWords(const Mission& mission) {
  std::ostringstream text;
  text << std::fixed << std::setprecision(2);
  if (mission.goal.why == DriveFor::kSurvey) {
    text << "survey pose " << mission.memory.survey_index + 1 << " of " << numSurveyPoses(mission);
  } else {
    text << (mission.goal.why == DriveFor::kDepot     ? "the depot"
             : mission.goal.why == DriveFor::kVantage ? "back to a survey pose"
                                                      : "the best view");
  }
  const Pose2d& goal = mission.goal.T_map_base;
  text << " at (" << goal.x_m << ", " << goal.y_m << ") m, " << goal.yaw_rad << " rad";
  return text.str();
}

std::string nextInWords(State next, const Mission& mission) {
  const Memory& memory = mission.memory;
  const std::string picked = std::to_string(numPicked(memory)) + " picked";
  const bool has_picked = mission.state == State::kPick || mission.state == State::kLetGo;
  switch (next) {
    case State::kBegin:
      return (has_picked ? picked + " so far: " : "") + "the arm out of the view, then a fresh inspection";
    case State::kPlanClear:
      return mission.is_drive_due ? "the arm is folded before the drive" : "the arm has to be out of the camera's view";
    case State::kClear:
      return "a path out of the camera's view is planned";
    case State::kLook:
      return "nothing is in the camera's view: " + std::to_string(mission.config.look.images) +
             " new images into the map";
    case State::kDetect:
      return "the map has them: the bricks are detected";
    case State::kChoose:
      return std::to_string(memory.ledger.numOpen()) + " bricks to pick, " + picked;
    case State::kReport:
      return "no brick could be picked there";
    case State::kPlanPick:
      return brickInWords(memory.nextBrick()) + ", the " +
             (mission.config.bricks.order == BrickOrder::kHighest ? "highest" : "nearest") + " that is graspable" +
             (memory.fruitless_views < mission.config.bricks.carriers_wait_views ? ", carries none" : "") +
             " and is in the arm's sector";
    case State::kPick:
      return brickInWords(mission.candidate) + ": its pick is planned";
    case State::kStow:
      return "a path to its release pose is planned";
    case State::kLetGo:
      return "the brick is over its release pose";
    case State::kSelect:
      return "no brick is to be tried from here" + obstaclesInWords(memory) +
             (holds(Guard::kKeepsAway, mission)
                  ? "; away from bricks tried without success, others were tried less often"
                  : "");
    case State::kDrive:
      return driveInWords(mission);
    case State::kUnload:
      return std::to_string(memory.places_used) + " places of the container are used";
    default:
      return "";
  }
}

std::string joined(const std::string& first, const std::string& second) {
  return first + (first.empty() || second.empty() ? "" : "; ") + second;
}

}  // namespace

std::string withMessage(const std::string& text, const std::string& message) {
  if (text.empty() || message.empty()) return text + message;
  return text + " (" + message + ")";
}

std::string reasonFor(const Transition& row, const std::string& reason, const Mission& mission) {
  const std::string why = joined(reason, toString(row.guard));
  const bool names_next = why.empty() || row.to == State::kPlanPick || row.to == State::kDrive;
  return names_next ? joined(why, nextInWords(row.to, mission)) : why;
}

std::string leftInWords(const Mission& mission) {
  const BrickLedger& ledger = mission.memory.ledger;
  std::string text;
  const auto add = [&text](const std::string& one) { text += (text.empty() ? "; " : ", ") + one; };
  for (const auto& [id, record] : ledger.bricks()) {
    if (record.is_picked || ledger.isExhausted(record)) continue;
    const std::string obstacle = ledger.obstacleTo(id, mission.memory.scene, mission.memory.fruitless_views);
    const std::string stands = record.is_there || obstacle.empty() ? "is still there" : "";
    const std::string both = stands.empty() || obstacle.empty() ? "" : " and ";
    add("brick " + std::to_string(id) + " " + stands + both + obstacle);
  }
  if (numNeverFound(mission) > 0) {
    add(std::to_string(numNeverFound(mission)) + " of " + std::to_string(mission.config.bricks_total) +
        " bricks never found");
  }
  return text;
}

}  // namespace pick_mission
