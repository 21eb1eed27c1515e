// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/reactions.h"

#include <stdexcept>

namespace pick_mission {
namespace {

EndReason endReasonOf(State action) {
  switch (action) {
    case State::kPlanClear:
    case State::kPlanPick:
      return EndReason::kPlanningFailed;
    case State::kClear:
      return EndReason::kArmFailed;
    case State::kLook:
      return EndReason::kLooksFailed;
    case State::kDetect:
      return EndReason::kDetectionFailed;
    case State::kPick:
      return EndReason::kPicksFailed;
    case State::kPlanStow:
    case State::kStow:
    case State::kLetGo:
      return EndReason::kBrickInHand;
    case State::kSelect:
      return EndReason::kSelectionFailed;
    case State::kDrive:
      return EndReason::kDrivesFailed;
    case State::kRecover:
      return EndReason::kRecoveryFailed;
    case State::kWait:
      return EndReason::kNotReady;
    default:
      return EndReason::kNone;
  }
}

Reaction done() {
  return {};
}

/// A failure that the place and the brick have nothing to do with.
Reaction inARow(State action, Trigger next, const char* why) {
  Reaction reaction;
  reaction.next = next;
  reaction.counts_in_a_row = true;
  reaction.end = endReasonOf(action);
  reaction.why = why;
  return reaction;
}

Reaction ofBrick(Trigger next, bool is_reported, const char* why) {
  Reaction reaction;
  reaction.next = next;
  reaction.blames_brick = true;
  reaction.is_reported = is_reported;
  reaction.why = why;
  return reaction;
}

Reaction giveUp(EndReason end, const char* why) {
  Reaction reaction;
  reaction.next = Trigger::kGiveUp;
  reaction.end = end;
  reaction.why = why;
  return reaction;
}

Reaction toPickPlan(PlanStatus status) {
  const State action = State::kPlanPick;
  switch (status) {
    case PlanStatus::kSuccess:
      return done();
    case PlanStatus::kBadRequest:
      return ofBrick(Trigger::kNextBrick, false, "what was asked makes no sense and will not when asked again");
    case PlanStatus::kNoMap:
      return inARow(action, Trigger::kWaitFirst, "the map has to come");
    case PlanStatus::kOutsideSector:
      return ofBrick(Trigger::kNextBrick, false, "out of the arm's reach from here");
    case PlanStatus::kNoIk:
      return ofBrick(Trigger::kNextBrick, false, "no posture of the arm reaches it from here");
    case PlanStatus::kStartInCollision:
      return inARow(action, Trigger::kRetryHere, "the map has changed about the arm: clear the view and look again");
    case PlanStatus::kGoalInCollision:
      return ofBrick(Trigger::kNextBrick, true, "something stands where the arm would have to be");
    case PlanStatus::kGoalUnknown:
      return ofBrick(Trigger::kNextBrick, true, "unseen space at the brick: another view may show it");
    case PlanStatus::kApproachBlocked:
      return ofBrick(Trigger::kNextBrick, true, "the straight way to it is not free from here");
    case PlanStatus::kIterations:
      return ofBrick(Trigger::kNextBrick, true, "no way found from here");
    case PlanStatus::kConstraint:
      return ofBrick(Trigger::kNextBrick, true, "cannot be carried as it was taken");
    case PlanStatus::kCancelled:
      return inARow(action, Trigger::kRetryHere, "somebody ended it");
    case PlanStatus::kNoRobotState:
      return inARow(action, Trigger::kWaitFirst, "where the robot is has to be known");
    case PlanStatus::kOutsideLimits:
      return ofBrick(Trigger::kNextBrick, false, "beyond the joints' limits from here");
  }
  throw std::invalid_argument("plan status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 13]");
}

Reaction toArmPlan(State action, PlanStatus status) {
  switch (status) {
    case PlanStatus::kSuccess:
      return done();
    case PlanStatus::kBadRequest:
      return giveUp(endReasonOf(action), "posture or place is none: a mistake in the configuration");
    case PlanStatus::kCancelled:
      return inARow(action, Trigger::kRetryHere, "somebody ended it");
    case PlanStatus::kNoMap:
      return inARow(action, Trigger::kWaitFirst, "the map has to come");
    case PlanStatus::kNoRobotState:
      return inARow(action, Trigger::kWaitFirst, "where the robot is has to be known");
    case PlanStatus::kOutsideSector:
    case PlanStatus::kNoIk:
    case PlanStatus::kStartInCollision:
    case PlanStatus::kGoalInCollision:
    case PlanStatus::kGoalUnknown:
    case PlanStatus::kApproachBlocked:
    case PlanStatus::kIterations:
    case PlanStatus::kConstraint:
    case PlanStatus::kOutsideLimits:
      return inARow(action, Trigger::kWaitFirst, "the arm has to get away from here: newer images may show a way");
  }
  throw std::invalid_argument("plan status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 13]");
}

Reaction toArm(State action, ArmStatus status) {
  const bool is_pick = action == State::kPick;
  const bool is_recovery = action == State::kRecover;
  switch (status) {
    case ArmStatus::kSuccess:
      return done();
    case ArmStatus::kCancelled:
      return inARow(action, Trigger::kRetryHere, "somebody ended it: from where the arm stands now");
    case ArmStatus::kBadRequest:
    case ArmStatus::kBeyondLimits:
      if (is_pick) return ofBrick(Trigger::kNextBrick, false, "a mistake in the plan: not to be repeated");
      if (is_recovery) return inARow(action, Trigger::kRetryHere, "not an answer of a recovery");
      return giveUp(endReasonOf(action), "a mistake in the plan: not to be repeated");
    case ArmStatus::kStartMismatch:
      return inARow(action, Trigger::kRetryHere, "plan anew from where the arm stands");
    case ArmStatus::kNotReady:
    case ArmStatus::kProgramStopped:
      if (is_recovery) return inARow(action, Trigger::kWaitFirst, "it may come with time, or with the next attempt");
      return inARow(action, Trigger::kRecover, "mode, brakes or program have to be brought back");
    case ArmStatus::kStaleState:
    case ArmStatus::kStaleMap:
    case ArmStatus::kMonitorGone:
    case ArmStatus::kHeartbeatLost:
      return inARow(action, Trigger::kWaitFirst, "the arm does not move until what is late has come");
    case ArmStatus::kPathBlocked:
      if (is_pick) return ofBrick(Trigger::kRetryHere, true, "plan anew in the map as it is now");
      return inARow(action, Trigger::kRetryHere, "plan anew in the map as it is now");
    case ArmStatus::kHeld: {
      Reaction reaction;
      reaction.next = Trigger::kHeldByOperator;
      reaction.why = "the operator holds: wait for resume";
      return reaction;
    }
    case ArmStatus::kProtectiveStop:
      if (is_recovery) return giveUp(EndReason::kNeedsPerson, "a person has to look why it stopped");
      {
        Reaction reaction = inARow(action, Trigger::kRecover, "unlock, if that is allowed without a person");
        return reaction;
      }
    case ArmStatus::kEmergencyStop:
      return giveUp(EndReason::kNeedsPerson, "a person has to look");
    case ArmStatus::kDriverGone:
      if (is_recovery) return inARow(action, Trigger::kWaitFirst, "the driver has to come back");
      return inARow(action, Trigger::kRecover, "when the driver is back, its program has to be");
    case ArmStatus::kTrajectoryRefused:
    case ArmStatus::kTrajectoryAborted:
      return inARow(action, Trigger::kRetryHere, "plan anew; again and again: a person has to look");
    case ArmStatus::kStalled:
      return inARow(action, Trigger::kWaitFirst, "the speed slider is near zero");
    case ArmStatus::kIoRefused:
      if (action == State::kLetGo) return inARow(action, Trigger::kLetGoAgain, "the magnet has to go off");
      return inARow(action, Trigger::kRetryHere, "the driver refused magnet, payload or force sensor");
    case ArmStatus::kNoContact:
    case ArmStatus::kContactTooEarly:
      if (is_pick) return ofBrick(Trigger::kRetryHere, true, "the brick is not where it was thought to be: look again");
      return inARow(action, Trigger::kRetryHere, "not an answer of a motion");
    case ArmStatus::kNotAttached:
      if (is_pick) return ofBrick(Trigger::kNextBrick, true, "it does not hold: another brick first");
      return inARow(action, Trigger::kRetryHere, "not an answer of a motion");
    case ArmStatus::kLostOnTheWay:
      if (is_pick) return ofBrick(Trigger::kRetryHere, true, "the brick lies somewhere else now: look for it");
      return inARow(action, Trigger::kRetryHere, "the brick lies somewhere else now: look for it");
    case ArmStatus::kNotLetGo:
      if (is_pick || action == State::kLetGo) return inARow(action, Trigger::kLetGoAgain, "the weight is still there");
      return inARow(action, Trigger::kRetryHere, "not an answer of a motion");
    case ArmStatus::kNothingHeld:
      return inARow(action, Trigger::kRetryHere, "the magnet is off and nothing hangs there: look");
    case ArmStatus::kFault:
      return giveUp(EndReason::kArmFailed, "the arm's bridge contradicts itself: it must not move on");
    case ArmStatus::kBusy: {
      Reaction reaction = inARow(action, Trigger::kWaitFirst, "the arm still does what it was told before");
      reaction.is_arm_busy = true;
      return reaction;
    }
  }
  throw std::invalid_argument("arm status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 27]");
}

Reaction toDrive(NavigationStatus status) {
  const State action = State::kDrive;
  const auto other = [&](const char* why) {
    Reaction reaction = inARow(action, Trigger::kOtherView, why);
    reaction.is_reported = true;
    return reaction;
  };
  switch (status) {
    case NavigationStatus::kSuccess:
      return done();
    case NavigationStatus::kCancelled:
      return inARow(action, Trigger::kRetryHere, "somebody ended it");
    case NavigationStatus::kBadGoal:
      return other("the place makes no sense");
    case NavigationStatus::kStartBlocked:
      return inARow(action, Trigger::kWaitFirst, "something stands in the robot's own place: it may go away");
    case NavigationStatus::kGoalOccupied:
    case NavigationStatus::kGoalUnknown:
      return other("the robot cannot stand there");
    case NavigationStatus::kNoApproach:
    case NavigationStatus::kNoPath:
    case NavigationStatus::kIterations:
      return other("no way there");
    case NavigationStatus::kObstacle:
    case NavigationStatus::kTooManyPlans:
      return other("something is in the way and stays");
    case NavigationStatus::kStuck:
      return other("the base does not move as told: another way may do");
    case NavigationStatus::kStaleOdometry:
    case NavigationStatus::kStalePose:
    case NavigationStatus::kStaleScan:
    case NavigationStatus::kStaleGrid:
    case NavigationStatus::kStaleHeartbeat:
      return inARow(action, Trigger::kWaitFirst, "the base does not move until what is late has come");
    case NavigationStatus::kBadInput:
      return inARow(action, Trigger::kWaitFirst, "the base does not move until its input has been put right");
    case NavigationStatus::kBaseStopped:
      return giveUp(EndReason::kNeedsPerson, "the base was stopped by its button or scanner: a person has to look");
    case NavigationStatus::kGoalMissed:
      return other("it cannot get there exactly enough");
  }
  throw std::invalid_argument("navigation status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 19]");
}

Reaction toSelection(SelectionStatus status) {
  const State action = State::kSelect;
  const auto notCounted = [](Trigger next, const char* why) {
    Reaction reaction;
    reaction.next = next;
    reaction.why = why;
    return reaction;
  };
  switch (status) {
    case SelectionStatus::kSuccess:
      return done();
    case SelectionStatus::kCancelled:
      return inARow(action, Trigger::kRetryHere, "somebody ended it");
    case SelectionStatus::kBadGoal:
      return giveUp(EndReason::kSelectionFailed, "strategy or zones make no sense and will not when asked again");
    case SelectionStatus::kStaleMap:
    case SelectionStatus::kStaleGround:
    case SelectionStatus::kNoPose:
      return inARow(action, Trigger::kWaitFirst, "what it selects from has to come");
    case SelectionStatus::kEmptyMap:
    case SelectionStatus::kNoGround:
      return notCounted(Trigger::kVantage, "ground and pile have to be in view");
    case SelectionStatus::kNoPile:
      return notCounted(Trigger::kNoPile, "nothing left, or nothing seen");
    case SelectionStatus::kNoCandidate:
      return notCounted(Trigger::kVantage, "no place that the robot may go to is known from here");
    case SelectionStatus::kLowUtility:
      return notCounted(Trigger::kLowUtility, "no place is worth going to");
    case SelectionStatus::kMapChanged:
      return inARow(action, Trigger::kRetryHere, "the map has to come to rest");
    case SelectionStatus::kBadInput:
      return inARow(action, Trigger::kWaitFirst, "map or grid has to be put right");
  }
  throw std::invalid_argument("selection status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 12]");
}

Reaction toDetection(DetectionStatus status) {
  const State action = State::kDetect;
  switch (status) {
    case DetectionStatus::kSuccess:
      return done();
    case DetectionStatus::kNoImage:
      return inARow(action, Trigger::kWaitFirst, "the camera has to come back");
    case DetectionStatus::kRefused:
      return inARow(action, Trigger::kRetryHere, "the next image may do");
    case DetectionStatus::kShuttingDown:
      return inARow(action, Trigger::kWaitFirst, "the detection has to come back");
  }
  throw std::invalid_argument("detection status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 3]");
}

Reaction toLook(LookStatus status) {
  const State action = State::kLook;
  switch (status) {
    case LookStatus::kSuccess:
      return done();
    case LookStatus::kCancelled:
      return inARow(action, Trigger::kRetryHere, "somebody ended it");
    case LookStatus::kNoImage:
      return inARow(action, Trigger::kWaitFirst, "the map gets no images");
  }
  throw std::invalid_argument("look status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 2]");
}

Reaction toWait(WaitStatus status) {
  const State action = State::kWait;
  switch (status) {
    case WaitStatus::kSuccess:
      return done();
    case WaitStatus::kCancelled:
      return inARow(action, Trigger::kRetryHere, "somebody ended it");
    case WaitStatus::kNotReady:
      return inARow(action, Trigger::kRecover, "it does not come by itself");
  }
  throw std::invalid_argument("wait status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 2]");
}

Reaction toReport(ReportStatus status) {
  switch (status) {
    case ReportStatus::kSuccess:
      return done();
    case ReportStatus::kRefused: {
      Reaction reaction;
      reaction.next = Trigger::kRetryHere;
      reaction.why = "goes on without the penalty; the place is excluded anyway";
      return reaction;
    }
  }
  throw std::invalid_argument("report status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 1]");
}

Reaction toNoAnswer(State action) {
  switch (action) {
    case State::kReport:
      return toReport(ReportStatus::kRefused);
    case State::kWait:
      return inARow(action, Trigger::kRetryHere, "try without");
    default:
      return inARow(action, Trigger::kWaitFirst, "whoever should have answered has to come back");
  }
}

enum class Kind { kNone, kArmPlan, kPickPlan, kArm, kLook, kDetection, kReport, kSelection, kDrive, kWait };

Kind kindOf(State action) {
  switch (action) {
    case State::kPlanClear:
    case State::kPlanStow:
      return Kind::kArmPlan;
    case State::kPlanPick:
      return Kind::kPickPlan;
    case State::kClear:
    case State::kPick:
    case State::kStow:
    case State::kLetGo:
    case State::kRecover:
      return Kind::kArm;
    case State::kLook:
      return Kind::kLook;
    case State::kDetect:
      return Kind::kDetection;
    case State::kReport:
      return Kind::kReport;
    case State::kSelect:
      return Kind::kSelection;
    case State::kDrive:
      return Kind::kDrive;
    case State::kWait:
      return Kind::kWait;
    case State::kIdle:
    case State::kPaused:
    case State::kHeld:
    case State::kHalting:
    case State::kEnded:
    case State::kBegin:
    case State::kChoose:
      return Kind::kNone;
  }
  return Kind::kNone;
}

template <typename ResultType, typename Status>
void append(std::vector<Result>& results, int count) {
  for (int i = 0; i < count; ++i) {
    ResultType result;
    result.status = static_cast<Status>(i);
    results.emplace_back(result);
  }
}

}  // namespace

Reaction reactTo(State action, const Result& result) {
  const Kind kind = kindOf(action);
  if (kind != Kind::kNone && std::holds_alternative<NoAnswer>(result)) return toNoAnswer(action);
  if (kind == Kind::kPickPlan) {
    if (const auto* plan = std::get_if<PlanResult>(&result)) return toPickPlan(plan->status);
  } else if (kind == Kind::kArmPlan) {
    if (const auto* plan = std::get_if<PlanResult>(&result)) return toArmPlan(action, plan->status);
  } else if (kind == Kind::kArm) {
    if (const auto* arm = std::get_if<ArmResult>(&result)) return toArm(action, arm->status);
  } else if (kind == Kind::kLook) {
    if (const auto* look = std::get_if<LookResult>(&result)) return toLook(look->status);
  } else if (kind == Kind::kDetection) {
    if (const auto* detection = std::get_if<DetectionResult>(&result)) return toDetection(detection->status);
  } else if (kind == Kind::kReport) {
    if (const auto* report = std::get_if<ReportResult>(&result)) return toReport(report->status);
  } else if (kind == Kind::kSelection) {
    if (const auto* selection = std::get_if<SelectionResult>(&result)) return toSelection(selection->status);
  } else if (kind == Kind::kDrive) {
    if (const auto* drive = std::get_if<NavigationResult>(&result)) return toDrive(drive->status);
  } else if (kind == Kind::kWait) {
    if (const auto* wait = std::get_if<WaitResult>(&result)) return toWait(wait->status);
  }
  throw std::invalid_argument(std::string("result \"") + toString(result) + "\" of kind " +
                              std::to_string(result.index()) + " in state \"" + toString(action) +
                              "\", must be one that its action can have");
}

std::vector<Result> possibleResults(State action) {
  std::vector<Result> results;
  switch (kindOf(action)) {
    case Kind::kNone:
      return {};
    case Kind::kArmPlan:
    case Kind::kPickPlan:
      append<PlanResult, PlanStatus>(results, kNumPlanStatus);
      break;
    case Kind::kArm:
      append<ArmResult, ArmStatus>(results, ur_driver_bridge::kNumArmStatus);
      break;
    case Kind::kLook:
      append<LookResult, LookStatus>(results, kNumLookStatus);
      break;
    case Kind::kDetection:
      append<DetectionResult, DetectionStatus>(results, kNumDetectionStatus);
      break;
    case Kind::kReport:
      append<ReportResult, ReportStatus>(results, kNumReportStatus);
      break;
    case Kind::kSelection:
      append<SelectionResult, SelectionStatus>(results, kNumSelectionStatus);
      break;
    case Kind::kDrive:
      append<NavigationResult, NavigationStatus>(results, kNumNavigationStatus);
      break;
    case Kind::kWait:
      append<WaitResult, WaitStatus>(results, kNumWaitStatus);
      break;
  }
  results.emplace_back(NoAnswer{});
  return results;
}

std::string reactionsAsMarkdown() {
  std::string text = "| State | Result | Then | Why |\n|---|---|---|---|\n";
  for (int i = 0; i < kNumStates; ++i) {
    const State action = static_cast<State>(i);
    const std::vector<Result> results = possibleResults(action);
    // Neighbours with the same reaction share a row.
    for (std::size_t k = 0; k < results.size(); ++k) {
      const Reaction reaction = reactTo(action, results[k]);
      if (reaction.next == Trigger::kDone) continue;
      std::string names = toString(results[k]);
      while (k + 1 < results.size() && reactTo(action, results[k + 1]).why == reaction.why &&
             reactTo(action, results[k + 1]).next == reaction.next) {
        names += std::string(", ") + toString(results[++k]);
      }
      text += std::string("| ") + toString(action) + " | " + names + " | " + toString(reaction.next) + " | " +
              reaction.why + " |\n";
    }
  }
  return text;
}

}  // namespace pick_mission
