// SPDX-License-Identifier: BSD-3-Clause
#include "tasks/goal_generator.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "collision/robot_shapes.h"
#include "tasks/failures.h"

namespace motion_planning {
namespace {

constexpr double kLongestTurn_rad = 1.5 * M_PI;  // of joint 1 to a goal: beyond it the other direction is much shorter

/// Where the tip has to be.
struct TipGoal {
  std::string what;
  std::vector<Eigen::Isometry3d> T_base_tips;  // any of them
};

/// Directions, in the tip's frame, that are up when the brick lies: its shorter edges, both ways.
std::vector<Eigen::Vector3d> lyingUps(const HeldBrick& held) {
  int longest = 0;
  held.size_m.maxCoeff(&longest);
  std::vector<Eigen::Vector3d> ups;
  for (const int edge : {(longest + 1) % 3, (longest + 2) % 3}) {
    for (const double sign : {1.0, -1.0}) ups.push_back(sign * held.T_tip_brick.linear().col(edge));
  }
  return ups;
}

/// Poses of the tip that hold the brick over its place, its longer level edge along the place's x.
std::vector<Eigen::Isometry3d> placePoses(const PlaceGoal& place, const HeldBrick& held,
                                          const Eigen::Vector3d& up_tip) {
  constexpr double kSameEdge_m = 0.005;  // a quarter of the air beside a brick in its place
  const Eigen::Matrix3d R_level = turning(up_tip, Eigen::Vector3d::UnitZ());
  const Eigen::Matrix3d R_level_brick = R_level * held.T_tip_brick.linear();
  int upright = 0;
  R_level_brick.row(2).cwiseAbs().maxCoeff(&upright);
  int longer = (upright + 1) % 3;
  int shorter = (upright + 2) % 3;
  if (held.size_m[longer] < held.size_m[shorter]) std::swap(longer, shorter);
  const int turns = held.size_m[longer] - held.size_m[shorter] < kSameEdge_m ? 4 : 2;
  const double brick_yaw = std::atan2(R_level_brick(1, longer), R_level_brick(0, longer));
  const Eigen::Matrix3d& R_place = place.T_base_place.linear();
  const double place_yaw = std::atan2(R_place(1, 0), R_place(0, 0));
  std::vector<Eigen::Isometry3d> T_base_tips;
  for (int k = 0; k < turns; ++k) {
    Eigen::Isometry3d T_base_brick = Eigen::Isometry3d::Identity();
    T_base_brick.linear() = aboutZ(place_yaw - brick_yaw + 2.0 * M_PI * k / turns) * R_level_brick;
    const double half_height_m = 0.5 * T_base_brick.linear().row(2).cwiseAbs().dot(held.size_m);
    T_base_brick.translation() =
        place.T_base_place.translation() + Eigen::Vector3d(0.0, 0.0, place.above_m + half_height_m);
    T_base_tips.push_back(T_base_brick * held.T_tip_brick.inverse());
  }
  return T_base_tips;
}

Result<TipGoal> tipGoal(const TaskContext& task, const ArmGoal& goal, const std::optional<HeldBrick>& held,
                        const Tilt& tilt) {
  if (goal.T_map_tip) {
    if (!isRigid(*goal.T_map_tip)) return badRequest("goal of the tip is not a finite rigid transform");
    return TipGoal{"the tip at " + inMetres(goal.T_map_tip->translation()) + " in the map",
                   {task.T_base_map * *goal.T_map_tip}};
  }
  const PlaceGoal& place = *goal.place;
  if (!held) return badRequest("nothing is held that could be placed");
  if (!isRigid(place.T_base_place) || !std::isfinite(place.above_m)) {
    return badRequest("place: its pose is not rigid, or above_m is not finite");
  }
  std::vector<Eigen::Vector3d> ups = lyingUps(*held);
  if (!place.lay_down) {
    const Eigen::Matrix3d R_base_tip = task.arm.tipPose(task.request.start_rad).linear();
    ups = {uprightEdge(*held, tilt ? tilt->up_tip : R_base_tip.transpose() * Eigen::Vector3d::UnitZ())};
  }
  TipGoal tip{"the brick over its release pose at " + inMetres(place.T_base_place.translation()) + " in base_link", {}};
  for (const Eigen::Vector3d& up_tip : ups) {
    const std::vector<Eigen::Isometry3d> poses = placePoses(place, *held, up_tip);
    tip.T_base_tips.insert(tip.T_base_tips.end(), poses.begin(), poses.end());
  }
  return tip;
}

/// All postures with the tip there, nearest to `near` first.
std::vector<ArmVector> posturesAt(const TipGoal& goal, const ArmKinematics& arm, const ArmVector& near) {
  std::vector<ArmVector> postures;
  for (const Eigen::Isometry3d& T_base_tip : goal.T_base_tips) {
    const std::vector<ArmVector> branches = arm.inverse(T_base_tip, near);
    postures.insert(postures.end(), branches.begin(), branches.end());
  }
  // A whole turn of the first joint leads round the mast on its other side. A turn of another joint changes nothing.
  const std::size_t given = postures.size();
  for (std::size_t i = 0; i < given; ++i) {
    for (const double turn : {-2.0 * M_PI, 2.0 * M_PI}) {
      ArmVector turned = postures[i];
      turned[0] += turn;
      if (arm.isWithinLimits(turned)) postures.push_back(turned);
    }
  }
  std::stable_sort(postures.begin(), postures.end(), [&](const ArmVector& a, const ArmVector& b) {
    return (a - near).squaredNorm() < (b - near).squaredNorm();
  });
  return postures;
}

/// Those that are free and keep the tilt. `what`: the goal, begins the sentence that says why none is.
Result<std::vector<ArmVector>> freePostures(const TaskContext& task, const std::vector<ArmVector>& postures,
                                            const ArmVector& near, const CollisionChecker& checker, const Tilt& tilt,
                                            bool may_turn, const std::string& what) {
  std::vector<ArmVector> free;
  Rejections rejections;
  double least_tilt_rad = M_PI;
  for (const ArmVector& q : postures) {
    if (task.isCancelled()) return cancelled();
    if (tilt) {
      const double tilt_rad = tiltOf(task.arm, *tilt, q);
      least_tilt_rad = std::min(least_tilt_rad, tilt_rad);
      if (tilt_rad > tilt->max_tilt_rad) continue;
    }
    if (const Contact contact = checker.check(q)) {
      rejections.add(contact);
      continue;
    }
    free.push_back(q);
    // The other direction of joint 1 as well: the mast is in the way of one of them.
    ArmVector other_way = q;
    other_way[0] += q[0] > near[0] ? -2.0 * M_PI : 2.0 * M_PI;
    if (may_turn && std::abs(other_way[0] - near[0]) <= kLongestTurn_rad && task.arm.isWithinLimits(other_way)) {
      free.push_back(other_way);
    }
    if (free.size() >= static_cast<std::size_t>(task.config.pick.max_goals)) break;
  }
  if (!free.empty()) return free;
  if (rejections.empty()) {
    return PlanFailure{PlanStatus::kConstraint, what + " tilts what is carried by " + inDegrees(least_tilt_rad) +
                                                    " or more, allowed are " + inDegrees(tilt->max_tilt_rad)};
  }
  return PlanFailure{rejections.status(),
                     what + ": of " + std::to_string(postures.size()) + " postures " + rejections.describe()};
}

}  // namespace

Result<std::vector<ArmVector>> findGoals(const TaskContext& task, const ArmGoal& goal, const ArmVector& near,
                                         const CollisionChecker& checker, const Tilt& tilt) {
  const int kinds = (goal.joints_rad ? 1 : 0) + (goal.T_map_tip ? 1 : 0) + (goal.place ? 1 : 0);
  if (kinds != 1) return badRequest("a goal has " + std::to_string(kinds) + " of joints, tip and place, must have 1");
  if (goal.joints_rad) {
    const std::string what = "the goal posture";
    if (!goal.joints_rad->allFinite()) return badRequest("goal has an angle that is not finite");
    if (!task.arm.isWithinLimits(*goal.joints_rad)) return outsideLimits(what, *goal.joints_rad, task.arm.limits());
    return freePostures(task, {*goal.joints_rad}, near, checker, tilt, false, what);
  }
  const Result<TipGoal> tip = tipGoal(task, goal, checker.held(), tilt);
  if (!tip) return tip.failure();
  const std::vector<ArmVector> postures = posturesAt(*tip, task.arm, near);
  if (postures.empty()) {
    return PlanFailure{PlanStatus::kNoIk, tip->what + ": no joint angles reach it (" +
                                              std::to_string(tip->T_base_tips.size()) + " poses tried)"};
  }
  return freePostures(task, postures, near, checker, tilt, true, tip->what);
}

}  // namespace motion_planning
