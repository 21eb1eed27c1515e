// SPDX-License-Identifier: BSD-3-Clause
#include "tasks/start_state.h"

#include <optional>
#include <utility>

#include "collision/robot_shapes.h"
#include "tasks/failures.h"
#include "tasks/straight_line.h"

namespace motion_planning {
namespace {

std::optional<PlanFailure> refusal(const TaskContext& task) {
  const PlanningContext& request = task.request;
  if (!request.scene) return PlanFailure{PlanStatus::kNoMap, "there is no collision scene yet"};
  if (!isRigid(request.T_map_base)) return badRequest("pose of the base is not a finite rigid transform");
  if (!request.start_rad.allFinite()) return badRequest("start has an angle that is not finite");
  if (!task.arm.isWithinLimits(request.start_rad)) {
    return outsideLimits("the arm's start", request.start_rad, task.arm.limits());
  }
  if (request.held && !(isRigid(request.held->T_tip_brick) && isBoxSize(request.held->size_m))) {
    return badRequest("held brick: pose not a rigid transform, or size not positive");
  }
  if (request.vacated && !(isRigid(request.vacated->T_map_box) && isBoxSize(request.vacated->size_m))) {
    return badRequest("vacated box: pose not a rigid transform, or size not positive");
  }
  for (const LoadedBrick& brick : request.load) {
    if (!isRigid(brick.T_base_brick) || !isBoxSize(brick.size_m)) {
      return badRequest("brick in the container: pose not a rigid transform, or size not positive");
    }
  }
  return std::nullopt;
}

/// The way straight back for an empty magnet at a face, where a pick was broken off: as far as an approach begins. Empty:
/// the magnet is not at a face, or the line is not free.
JointPath backOff(const TaskContext& task, const CollisionChecker& checker) {
  const ArmVector& start = task.request.start_rad;
  CollisionChecker touching(checker);
  if (!touching.yieldToMagnetAt(start)) return {};
  const Eigen::Isometry3d T_base_tip = task.arm.tipPose(start);
  JointPath line = followLine(task, start, T_base_tip, -task.config.pick.approach_m * T_base_tip.linear().col(2));
  std::size_t end = 0;
  for (std::size_t k = 1; k < line.size() && touching.isFree(line[k]); ++k) {
    if (checker.isFree(line[k])) end = k;
  }
  line.resize(end == 0 ? 0 : end + 1);
  return line;
}

/// The way straight out where links are within the margin of surface that a newer image has brought nearer. Empty: there is
/// none, or they are in the surface itself.
JointPath outOfMargin(const TaskContext& task, const CollisionChecker& checker) {
  const ArmVector& start = task.request.start_rad;
  CollisionChecker near(checker);
  if (!near.yieldToSurfaceAt(start)) return {};
  if (task.request.held) near.setHeldAt(*task.request.held, {start});
  CollisionChecker clear(near);
  clear.yieldToSurfaceAt(std::nullopt);
  std::vector<Eigen::Vector3d> directions_base = directionsOut(task, start);
  const std::vector<Eigen::Vector3d> aside = upAndAside();
  directions_base.insert(directions_base.end(), aside.begin(), aside.end());
  for (const Eigen::Vector3d& direction_base : directions_base) {
    JointPath line = followLine(task, start, task.arm.tipPose(start), task.config.pick.lift_m * direction_base);
    for (std::size_t k = 0; k < line.size() && near.isFree(line[k]); ++k) {
      if (k == 0 || !clear.isFree(line[k])) continue;
      line.resize(k + 1);
      return line;
    }
  }
  return {};
}

}  // namespace

JointTrajectory StartState::withBackOff(const TaskContext& task, const JointTrajectory& trajectory) const {
  if (back_off.empty()) return trajectory;
  JointTrajectory whole = timedLine(task, back_off, task.config.speed.lift_speed_m_s);
  append(trajectory, &whole);
  return whole;
}

Result<StartState> findStart(const TaskContext& task) {
  if (const auto why = refusal(task)) return *why;
  const PlanningContext& request = task.request;
  StartState start{
      request.start_rad, {}, {task.shared_arm, request.scene, request.T_map_base, task.config.collision}, false, {}};
  CollisionChecker& checker = start.checker;
  checker.setHeld(request.held, false);
  checker.setLoad(request.load, request.start_rad);
  if (request.vacated) checker.setTarget(request.vacated, true);
  checker.freeUnknownAt(request.start_rad);
  checker.yieldToRobotAt(request.start_rad);
  if (checker.check(start.joints_rad)) {
    start.back_off = backOff(task, checker);
    if (start.back_off.empty()) start.back_off = outOfMargin(task, checker);
    if (!start.back_off.empty()) start.joints_rad = start.back_off.back();
  }
  if (request.held && checker.check(start.joints_rad)) {
    start.is_among_others = true;
    checker.setHeld(request.held);
    start.wedged = checker.check(start.joints_rad);
    if (start.wedged) {
      if (const Contact contact = checker.setHeldAt(*request.held, {start.joints_rad}))
        return startInCollision(contact);
    }
  }
  if (task.isCancelled()) return cancelled();
  if (const Contact contact = checker.check(start.joints_rad)) return startInCollision(contact);
  return start;
}

}  // namespace motion_planning
