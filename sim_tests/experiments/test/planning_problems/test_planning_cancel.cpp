// SPDX-License-Identifier: BSD-3-Clause
// Planning in a pile is given up at once when asked to, and says why it could not even begin.
#include <limits>

#include <gmock/gmock.h>

#include "planning_problems/problem_planner.h"
#include "problem_files.h"

namespace experiments {
namespace {

using motion_planning::PlanStatus;

const std::string kSectors = std::string(MOTION_PLANNING_DIR) + "/config/manipulability_sectors.yaml";

TEST(PlanningCancel, ReturnsWithinATenthOfASecond) {
  const ProblemMaker maker(problemFiles(), SurveyConfig{});
  ProblemPlanner planner(maker, kSectors);
  int cancelled = 0;
  for (const PlanningProblem& problem : maker.problemsOfPile(2)) {
    planner.scene(problem);  // not planning's time
    for (const double after_ms : {1.0, 20.0, 60.0}) {
      // Processor time of the planning thread: a busy machine does not lengthen it.
      const double begin_ms = threadTime_ms();
      double asked_ms = std::numeric_limits<double>::infinity();
      const ProblemPlanner::Answer answer = planner.plan(problem, [&] {
        const double now_ms = threadTime_ms();
        if (now_ms - begin_ms < after_ms) return false;
        asked_ms = std::min(asked_ms, now_ms);
        return true;
      });
      if (answer.plan || answer.plan.failure().status != PlanStatus::kCancelled) continue;  // was done before
      ++cancelled;
      EXPECT_LT(threadTime_ms() - asked_ms, 100.0) << problem.name << ", after " << after_ms << " ms";
      // And it asks often: nobody would wait longer for the question either.
      EXPECT_LT(asked_ms - begin_ms - after_ms, 100.0) << problem.name << ", after " << after_ms << " ms";
    }
  }
  EXPECT_GE(cancelled, 9);  // of 27: some problems take less than 60 ms
}

TEST(PlanningCancel, WithoutASceneThereIsNoMap) {
  const ProblemMaker maker(problemFiles(), SurveyConfig{});
  ProblemPlanner planner(maker, kSectors);
  const PlanningProblem problem = maker.problemsOfPile(1, 1, 1).front();
  motion_planning::PlanningContext context;
  context.T_map_base = problem.stand->T_map_base;
  context.start_rad = maker.stowed();
  const auto plan = planner.planner().planPick(context, problem.target, {maker.containerGoal()}).plan;
  EXPECT_EQ(plan.failure().status, PlanStatus::kNoMap);
  EXPECT_FALSE(plan.failure().message.empty());
}

}  // namespace
}  // namespace experiments
