// SPDX-License-Identifier: BSD-3-Clause
// The tables of transitions and of reactions: complete, reachable, and as the documents have them.
#include <fstream>
#include <set>
#include <sstream>

#include <gmock/gmock.h>

#include "pick_mission/reactions.h"
#include "pick_mission/transitions.h"

namespace pick_mission {
namespace {

State stateAt(int i) {
  return static_cast<State>(i);
}

std::string textOf(const std::string& name) {
  std::ifstream file(std::string(PICK_MISSION_DIR) + "/" + name);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

bool onlyAlways(Guard guard) {
  return guard == Guard::kAlways;
}

TEST(Transitions, EveryReactionHasANextStateWhateverHolds) {
  for (int i = 0; i < kNumStates; ++i) {
    for (const Result& result : possibleResults(stateAt(i))) {
      const Trigger next = reactTo(stateAt(i), result).next;
      EXPECT_NE(nextTransition(stateAt(i), next, onlyAlways), nullptr)
          << toString(stateAt(i)) << ", " << toString(result) << ": " << toString(next);
    }
    if (isAction(stateAt(i))) {
      // Of any action, after too many failures, and by the operator.
      for (const Trigger trigger : {Trigger::kGiveUp, Trigger::kHold, Trigger::kStop, Trigger::kActionTimeout}) {
        EXPECT_NE(nextTransition(stateAt(i), trigger, onlyAlways), nullptr)
            << toString(stateAt(i)) << ": " << toString(trigger);
      }
    }
  }
}

TEST(Transitions, JunctionsAreAlwaysLeft) {
  EXPECT_NE(nextTransition(State::kBegin, Trigger::kAtOnce, onlyAlways), nullptr);
  EXPECT_NE(nextTransition(State::kChoose, Trigger::kAtOnce, onlyAlways), nullptr);
}

TEST(Transitions, EveryWayOutOfHaltingIsThere) {
  for (const Guard why : {Guard::kForHold, Guard::kForResume, Guard::kForEnd}) {
    EXPECT_NE(nextTransition(State::kHalting, Trigger::kHalted, [why](Guard guard) { return guard == why; }), nullptr);
  }
  // What took too long counts as unanswered; see reactTo(NoAnswer).
  for (int i = 0; i < kNumStates; ++i) {
    if (!isAction(stateAt(i))) continue;
    const Trigger next = reactTo(stateAt(i), NoAnswer{}).next;
    EXPECT_NE(nextTransition(State::kHalting, next, onlyAlways), nullptr) << toString(stateAt(i));
  }
}

TEST(Transitions, EveryStateCanBeReachedAndNoneIsLeftAfterTheEnd) {
  std::set<State> reached = {State::kIdle};
  for (std::size_t before = 0; before != reached.size();) {
    before = reached.size();
    for (const Transition& row : transitions()) {
      const bool is_from = row.from ? reached.count(*row.from) > 0 : true;
      if (is_from) reached.insert(row.to);
    }
  }
  EXPECT_EQ(reached.size(), static_cast<std::size_t>(kNumStates));
  for (const Transition& row : transitions()) EXPECT_NE(row.from, State::kEnded);
}

TEST(Transitions, NoRowIsHiddenByOneBeforeIt) {
  const std::vector<Transition>& rows = transitions();
  for (std::size_t k = 0; k < rows.size(); ++k) {
    for (std::size_t j = 0; j < k; ++j) {
      const bool is_same_from =
          rows[j].from == rows[k].from || (!rows[j].from && rows[k].from && isAction(*rows[k].from));
      EXPECT_FALSE(is_same_from && rows[j].trigger == rows[k].trigger &&
                   (rows[j].guard == Guard::kAlways || rows[j].guard == rows[k].guard))
          << "row " << k << " never taken because of row " << j;
    }
  }
}

TEST(Transitions, EffectsTellWhereToDriveWhatToWaitForAndWhyToEnd) {
  const auto isBetween = [](Effect effect, Effect first, Effect last) { return effect >= first && effect <= last; };
  for (const Transition& row : transitions()) {
    const std::string where = std::string(toString(row.to)) + ", if " + toString(row.guard);
    EXPECT_EQ(row.to == State::kHalting, isBetween(row.effect, Effect::kHaltForHold, Effect::kHaltForTimeout)) << where;
    EXPECT_EQ(row.to == State::kDrive && row.guard != Guard::kDriveDue,
              isBetween(row.effect, Effect::kGoToDepot, Effect::kGoToVantage))
        << where;
    EXPECT_EQ(row.to == State::kRecover, row.effect == Effect::kCountRecovery) << where;
    EXPECT_EQ(row.to == State::kWait, isBetween(row.effect, Effect::kWaitForHand, Effect::kWaitForFading)) << where;
    // A mission that is over already has its reason; others may have to stow a brick or to unload first.
    const bool is_end = isBetween(row.effect, Effect::kGiveUp, Effect::kEndNoView);
    if (row.trigger == Trigger::kGiveUp) {
      EXPECT_EQ(row.effect, Effect::kGiveUp) << where;
    } else {
      const bool is_ended = row.to == State::kEnded && row.guard != Guard::kEnding;
      EXPECT_TRUE(is_end ? is_ended || row.to == State::kBegin : !is_ended) << where;
    }
  }
}

TEST(Transitions, NamesAreDifferent) {
  std::set<std::string> states, triggers, guards, effects, ends;
  for (int i = 0; i < kNumStates; ++i) states.insert(toString(stateAt(i)));
  for (int i = 0; i < kNumTriggers; ++i) triggers.insert(toString(static_cast<Trigger>(i)));
  for (int i = 0; i < kNumGuards; ++i) guards.insert(toString(static_cast<Guard>(i)));
  for (int i = 0; i < kNumEffects; ++i) effects.insert(toString(static_cast<Effect>(i)));
  for (int i = 0; i < kNumEndReasons; ++i) ends.insert(toString(static_cast<EndReason>(i)));
  EXPECT_EQ(states.size(), static_cast<std::size_t>(kNumStates));
  EXPECT_EQ(triggers.size(), static_cast<std::size_t>(kNumTriggers));
  EXPECT_EQ(guards.size(), static_cast<std::size_t>(kNumGuards));
  EXPECT_EQ(effects.size(), static_cast<std::size_t>(kNumEffects));
  EXPECT_EQ(ends.size(), static_cast<std::size_t>(kNumEndReasons));
  for (const auto& names : {states, triggers, guards, effects, ends}) EXPECT_EQ(names.count("?"), 0u);
  for (const Transition& row : transitions()) {  // the last ones, too
    EXPECT_STRNE(toString(row.trigger), "?");
    EXPECT_STRNE(toString(row.guard), "?");
    EXPECT_STRNE(toString(row.effect), "?");
  }
}

TEST(Reactions, AreTotalAndHaveReasons) {
  std::size_t count = 0;
  for (int i = 0; i < kNumStates; ++i) {
    const std::vector<Result> results = possibleResults(stateAt(i));
    EXPECT_EQ(results.empty(), !isAction(stateAt(i))) << toString(stateAt(i));
    count += results.size();
    for (const Result& result : results) {
      const Reaction reaction = reactTo(stateAt(i), result);
      EXPECT_NE(toString(result), "?");
      EXPECT_EQ(reaction.next == Trigger::kDone, isSuccess(result)) << toString(stateAt(i)) << ": " << toString(result);
      if (isSuccess(result)) continue;
      EXPECT_FALSE(reaction.why.empty());
      // Nothing is tried again for ever: it is counted in a row or against a brick, or the machine counts it (views).
      const bool is_counted = reaction.counts_in_a_row || reaction.blames_brick;
      const bool is_ended_otherwise = reaction.next == Trigger::kGiveUp || reaction.next == Trigger::kHeldByOperator ||
                                      reaction.next == Trigger::kVantage || reaction.next == Trigger::kLowUtility ||
                                      reaction.next == Trigger::kNoPile || stateAt(i) == State::kReport;
      EXPECT_NE(is_counted, is_ended_otherwise) << toString(stateAt(i)) << ": " << toString(result);
      if (reaction.counts_in_a_row || reaction.next == Trigger::kGiveUp) {
        EXPECT_NE(reaction.end, EndReason::kNotEnded);
      }
    }
  }
  // 3 kinds of plans, 5 of the arm, look, detect, report, select, drive, wait; and no answer for each.
  EXPECT_EQ(count, 3u * 15 + 5u * 29 + 4 + 5 + 3 + 14 + 21 + 4);
}

TEST(Reactions, ResultsThatAnActionCannotHaveAreRefused) {
  EXPECT_THROW(reactTo(State::kDrive, ArmResult{}), std::invalid_argument);
  EXPECT_THROW(reactTo(State::kPlanPick, SelectionResult{}), std::invalid_argument);
  EXPECT_THROW(reactTo(State::kIdle, NoAnswer{}), std::invalid_argument);
  EXPECT_THROW(reactTo(State::kPick, ArmResult{static_cast<ArmStatus>(28)}), std::invalid_argument);
  EXPECT_THROW(reactTo(State::kPlanPick, PlanResult{static_cast<PlanStatus>(14)}), std::invalid_argument);
  EXPECT_THROW(reactTo(State::kPlanStow, PlanResult{static_cast<PlanStatus>(14)}), std::invalid_argument);
  EXPECT_THROW(reactTo(State::kDrive, NavigationResult{static_cast<NavigationStatus>(20), {}}), std::invalid_argument);
  EXPECT_THROW(reactTo(State::kSelect, SelectionResult{static_cast<SelectionStatus>(13), {}, false}),
               std::invalid_argument);
  EXPECT_THROW(reactTo(State::kDetect, DetectionResult{static_cast<DetectionStatus>(4), {}}), std::invalid_argument);
}

TEST(Documents, HaveTheTableOfTransitions) {
  EXPECT_THAT(textOf("docs/state_machine.md"), testing::HasSubstr(transitionsAsMarkdown())) << "write this into it:\n"
                                                                                            << transitionsAsMarkdown();
}

TEST(Documents, HaveTheTableOfReactions) {
  EXPECT_THAT(textOf("docs/state_machine.md"), testing::HasSubstr(reactionsAsMarkdown())) << "write this into it:\n"
                                                                                          << reactionsAsMarkdown();
}

TEST(Documents, TellEveryEndReason) {
  for (int i = 1; i < kNumEndReasons; ++i) {
    const std::string row = std::string("| `") + toString(static_cast<EndReason>(i)) + "` |";
    EXPECT_THAT(textOf("README.md"), testing::HasSubstr(row));
  }
}

}  // namespace
}  // namespace pick_mission
