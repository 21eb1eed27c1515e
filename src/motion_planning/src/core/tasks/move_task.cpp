// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <optional>

#include "tasks/brick_in_scene.h"
#include "tasks/failures.h"
#include "tasks/free_motion.h"
#include "tasks/goal_generator.h"
#include "tasks/pick_stages.h"
#include "tasks/straight_line.h"
#include "tasks/tasks.h"

namespace motion_planning {
namespace {

/// The held brick clear of where it hangs now: the allowed collision there has ended.
CollisionChecker clearOfStart(const TaskContext& task, const StartState& start) {
  CollisionChecker checker(start.checker);
  checker.setTarget(task.request.vacated, true);
  checker.setHeld(task.request.held, false);
  return checker;
}

/// What the map has where the held brick hangs is that brick itself, which an image showed.
CollisionChecker withOwnPlaceEmpty(const TaskContext& task, const StartState& start) {
  const HeldBrick& held = *task.request.held;
  CollisionChecker checker(start.checker);
  checker.setTarget(
      OrientedBox{task.request.T_map_base * task.arm.tipPose(start.joints_rad) * held.T_tip_brick, held.size_m}, true);
  checker.setHeld(held, false);
  return checker;
}

/// Straight from the start, by at most pick/lift_m, until what is held is clear of its surroundings, with room to all sides
/// if it gets that far. Empty: it does not get clear.
JointPath lineOut(const TaskContext& task, const StartState& start, const Eigen::Vector3d& direction_base) {
  const MotionPlannerConfig& config = task.config;
  JointPath line =
      followLine(task, start.joints_rad, task.arm.tipPose(start.joints_rad), config.pick.lift_m * direction_base);
  CollisionChecker among(start.checker);
  const std::size_t first = std::min(line.size(), numSteps(config, kAmongOthers_m) + 1);
  among.setHeldAt(*task.request.held, {line.begin(), line.begin() + static_cast<std::ptrdiff_t>(first)});
  const CollisionChecker clear = clearOfStart(task, start);
  CollisionChecker with_room(clear);
  with_room.setHeld(grown(*task.request.held, config.pick.lift_room_m), false);
  std::size_t end = 0;
  for (std::size_t k = 1; k < line.size() && among.isFree(line[k]); ++k) {
    if (clear.isFree(line[k])) end = k;
    if (with_room.isFree(line[k])) break;
  }
  line.resize(end == 0 ? 0 : end + 1);
  return line;
}

/// By search from the end of `line`, which begins at the start and may end there.
Result<JointTrajectory> searchFrom(const TaskContext& task, const JointPath& line, const CollisionChecker& checker,
                                   const ArmGoal& goal) {
  const Result<Tilt> tilt = tiltOfHeld(task, goal.keep_level);
  if (!tilt) return tilt.failure();
  const auto goals = findGoals(task, goal, line.back(), checker, *tilt);
  if (!goals) return goals.failure();
  const auto motion = moveTo(task, line.back(), *goals, checker, *tilt, "the arm");
  if (!motion) return motion.failure();
  JointTrajectory trajectory;
  if (line.size() > 1) trajectory = timedLine(task, line, task.config.speed.lift_speed_m_s);
  append(motion->trajectory, &trajectory);
  return trajectory;
}

Result<JointTrajectory> moveOneWay(const TaskContext& task, const StartState& start, const ArmGoal& goal) {
  Result<JointTrajectory> plan = startInCollision(start.wedged);
  if (!start.is_among_others) {
    plan = searchFrom(task, {start.joints_rad}, start.checker, goal);
    if (plan || plan.failure().status != PlanStatus::kIterations || !task.request.held) return plan;
  }
  // Among its neighbours a search finds no path out where a straight line may.
  bool has_line = false;
  for (const Eigen::Vector3d& direction_base : directionsOut(task, start.joints_rad)) {
    if (task.isCancelled()) break;
    const JointPath line = lineOut(task, start, direction_base);
    if (line.empty()) continue;
    Result<JointTrajectory> from_there = searchFrom(task, line, clearOfStart(task, start), goal);
    if (from_there) return from_there;
    if (start.is_among_others && !has_line) plan = from_there;  // the reason reported: that of the first line
    has_line = true;
  }
  if (start.is_among_others && !has_line && !start.wedged) {
    return searchFrom(task, {start.joints_rad}, start.checker, goal);
  }
  if (start.wedged && !has_line) {
    const CollisionChecker own_place = withOwnPlaceEmpty(task, start);
    if (own_place.isFree(start.joints_rad)) return searchFrom(task, {start.joints_rad}, own_place, goal);
    // What it is in is over it, too: up and to a side.
    for (const Eigen::Vector3d& direction_base : upAndAside()) {
      if (task.isCancelled()) break;
      const JointPath line = lineOut(task, start, direction_base);
      if (!line.empty()) return searchFrom(task, line, clearOfStart(task, start), goal);
    }
  }
  if (task.isCancelled()) return cancelled();
  return plan;
}

}  // namespace

Result<JointTrajectory> planMove(const TaskContext& task, const StartState& start, const ArmGoal& goal) {
  if (!task.request.held) return moveOneWay(task, start, goal);
  const Eigen::Vector3d up_tip = task.arm.tipPose(start.joints_rad).linear().transpose() * Eigen::Vector3d::UnitZ();
  Result<JointTrajectory> plan = cancelled();
  for (const ArmGoal& way : waysToStow(task, *task.request.held, up_tip, goal)) {
    plan = moveOneWay(task, start, way);
    if (plan || task.isCancelled()) break;
  }
  return plan;
}

}  // namespace motion_planning
