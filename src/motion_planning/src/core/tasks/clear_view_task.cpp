// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <optional>
#include <random>
#include <string>

#include "collision/camera_view.h"
#include "collision/robot_shapes.h"
#include "tasks/failures.h"
#include "tasks/free_motion.h"
#include "tasks/tasks.h"

namespace motion_planning {
namespace {

constexpr std::size_t kEnoughPostures = 100;  // found, before the nearest of them become goals

bool isView(const ViewFrustum& view) {
  const auto isHalfAngle = [](double angle_rad) { return angle_rad > 0.0 && angle_rad < 0.5 * M_PI; };
  return isRigid(view.T_base_camera) && isHalfAngle(view.half_width_rad) && isHalfAngle(view.half_height_rad) &&
         view.max_range_m > 0.0 && std::isfinite(view.max_range_m);
}

/// Which postures keep the view free, and what the others fail at.
class PostureFilter {
 public:
  PostureFilter(const TaskContext& task, const CollisionChecker& checker, const ViewFrustum& view, const Tilt& tilt)
      : task_(task), checker_(checker), view_(view), tilt_(tilt) {}

  bool accepts(const ArmVector& q) {
    if (!q.allFinite() || !task_.arm.isWithinLimits(q)) return false;
    if (tilt_ && tiltOf(task_.arm, *tilt_, q) > tilt_->max_tilt_rad) return false;
    if (blocksView(task_.arm, q, checker_.held(), view_, task_.config.view.clear_m)) {
      ++in_view_;
      return false;
    }
    const Contact contact = checker_.check(q);
    if (contact) rejections_.add(contact);
    return !contact;
  }

  PlanFailure whyNone(std::size_t given) const {
    const std::string tried = std::to_string(given) + " postures given and " +
                              std::to_string(task_.config.view.samples) + " drawn: " + std::to_string(in_view_) +
                              " in the camera's view";
    if (rejections_.empty()) return {PlanStatus::kConstraint, tried + ", the others beyond limits or tilt"};
    return {rejections_.status(), tried + ", " + rejections_.describe()};
  }

 private:
  const TaskContext& task_;
  const CollisionChecker& checker_;
  const ViewFrustum& view_;
  const Tilt& tilt_;
  std::size_t in_view_{0};
  Rejections rejections_;
};

/// Accepted postures at random, nearest to the start first.
Result<std::vector<ArmVector>> drawPostures(const TaskContext& task, const ArmVector& start_rad, const Tilt& tilt,
                                            PostureFilter* filter) {
  std::mt19937_64 engine(seedOf(task));
  const std::function<double()> uniform01 = [&engine] { return static_cast<double>(engine() >> 11) * 0x1.0p-53; };
  // Within half a turn of the start: farther is the same posture.
  const ArmVector lower = (start_rad.array() - M_PI).matrix().cwiseMax(task.arm.limits().lower_rad);
  const ArmVector upper = (start_rad.array() + M_PI).matrix().cwiseMin(task.arm.limits().upper_rad);
  const auto draw = [&]() -> ArmVector {
    ArmVector q;
    for (int i = 0; i < 6; ++i) q[i] = lower[i] + (upper[i] - lower[i]) * uniform01();
    return q;
  };
  const auto draw_level = tilt ? tiltSampler(task.arm, *tilt, {start_rad}) : nullptr;
  std::vector<ArmVector> found;
  for (int n = 0; n < task.config.view.samples && found.size() < kEnoughPostures; ++n) {
    if (task.isCancelled()) return cancelled();
    const ArmVector q = tilt ? draw_level(uniform01) : draw();
    if (filter->accepts(q)) found.push_back(q);
  }
  std::stable_sort(found.begin(), found.end(), [&](const ArmVector& one, const ArmVector& other) {
    return (one - start_rad).squaredNorm() < (other - start_rad).squaredNorm();
  });
  found.resize(std::min(found.size(), static_cast<std::size_t>(task.config.pick.max_goals)));
  return found;
}

}  // namespace

Result<JointTrajectory> planClearView(const TaskContext& task, const StartState& start, const ViewFrustum& view,
                                      const std::vector<ArmVector>& postures) {
  if (!isView(view)) {
    return badRequest("view: pose not rigid, half angles not in (0, pi/2) rad, or range not positive and finite");
  }
  if (start.wedged) return startInCollision(start.wedged);
  const Result<Tilt> tilt = tiltOfHeld(task, true);
  if (!tilt) return tilt.failure();
  const auto moveToAny = [&](const std::vector<ArmVector>& goals) -> Result<JointTrajectory> {
    const auto motion = moveTo(task, start.joints_rad, goals, start.checker, *tilt, "to a posture out of view");
    return motion ? Result<JointTrajectory>(motion->trajectory) : motion.failure();
  };
  PostureFilter filter(task, start.checker, view, *tilt);
  std::optional<PlanFailure> blocked;  // of a given posture that is out of view
  for (const ArmVector& posture : postures) {
    if (task.isCancelled()) return cancelled();
    if (!filter.accepts(posture)) continue;
    const Result<JointTrajectory> trajectory = moveToAny({posture});
    if (trajectory || trajectory.failure().status == PlanStatus::kCancelled) return trajectory;
    blocked = trajectory.failure();
  }
  const Result<std::vector<ArmVector>> drawn = drawPostures(task, start.joints_rad, *tilt, &filter);
  if (!drawn) return drawn.failure();
  if (!drawn->empty()) return moveToAny(*drawn);
  return blocked ? *blocked : filter.whyNone(postures.size());
}

}  // namespace motion_planning
