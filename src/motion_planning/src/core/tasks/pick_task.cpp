// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "collision/robot_shapes.h"
#include "tasks/failures.h"
#include "tasks/free_motion.h"
#include "tasks/goal_generator.h"
#include "tasks/pick_stages.h"
#include "tasks/straight_line.h"
#include "tasks/tasks.h"

namespace motion_planning {
namespace {

namespace description = mp700_ur5e_description;
using description::BrickFace;

constexpr int kStowAttempts = 3;  // contact postures tried if the brick cannot be carried away from one

/// How far a face got: the failure of the one that got farthest is reported.
enum class Stage { kFace, kSector, kIk, kContact, kLine, kStowGoal, kApproach, kStow };

struct FaceFailure {
  Stage stage;
  PlanFailure why;
};

/// Where to carry the brick, and the constraint on the way there.
struct Stow {
  std::vector<ArmVector> goals;
  Tilt tilt;
};
using Stows = std::vector<Stow>;  // best first

/// The pick by one face.
class FacePick {
 public:
  FacePick(const TaskContext& task, const StartState& start, const PickTarget& target, BrickFace face,
           const std::vector<ArmGoal>& stow_goals, BrickInScene* scene)
      : task_(task),
        start_(start),
        target_(target),
        face_(face),
        stow_goals_(stow_goals),
        scene_(*scene),
        name_(nameOf(target, face)),
        T_base_face_(facePose(task, target, face)),
        lift_offsets_(liftOffsets(T_base_face_.linear().col(2), task.config.pick.lift_m)) {}

  Result<PickPlan, FaceFailure> plan() {
    const auto points = contactPoints(task_, target_, face_);
    if (!points) {
      const bool is_outside = points.failure().status == PlanStatus::kOutsideSector;
      return FaceFailure{is_outside ? Stage::kSector : Stage::kFace, points.failure()};
    }
    // The plate's middle alone first: it mostly suffices, and the brick hangs best from it.
    const auto rest = points->begin() + 1;
    if (!collectPicks({points->begin(), rest}) || (picks_.empty() && !collectPicks({rest, points->end()}))) {
      return FaceFailure{Stage::kStow, cancelled()};
    }
    if (picks_.empty()) return whyNoPick();
    return connect();
  }

 private:
  /// A contact posture with its straight lines.
  struct Pick {
    std::size_t grip;
    JointPath contact;  // from before the face to it
    JointPath lift;
  };

  /// False: cancelled.
  bool collectPicks(const std::vector<Eigen::Vector3d>& points_face) {
    const std::size_t first_grip = grips_.size();
    for (const Grip& grip : gripsAt(task_, target_, T_base_face_, points_face)) grips_.push_back(grip);
    const std::vector<ContactPosture> postures = contactPostures(task_, grips_, first_grip);
    num_postures_ += postures.size();
    for (const ContactPosture& posture : postures) {
      if (task_.isCancelled()) return false;
      auto pick = pickFrom(posture);
      if (pick) picks_.push_back(std::move(*pick));
      if (picks_.size() >= static_cast<std::size_t>(task_.config.pick.max_goals)) break;
    }
    return true;
  }

  /// The stages between the searches, cheap tests first.
  std::optional<Pick> pickFrom(const ContactPosture& posture) {
    const Grip& grip = grips_[posture.grip];
    if (const Contact contact = scene_.touching().check(posture.joints_rad)) {
      contacts_.add(contact);
      return std::nullopt;
    }
    Result<JointPath> contact = contactLine(task_, scene_, grip, posture.joints_rad);
    if (!contact) return note({Stage::kLine, contact.failure()});
    scene_.hold(grip.held);
    Result<JointPath> lift = liftLine(task_, scene_, grip, posture.joints_rad, lift_offsets_);
    if (!lift) return note({Stage::kLine, lift.failure()});
    const Result<Stows>& stows = stowsFrom(posture.grip, lift->back());
    if (!stows) {
      const PlanFailure& why = stows.failure();
      return note({Stage::kStowGoal, {why.status, "carrying the brick away: " + why.message}});
    }
    return Pick{posture.grip, std::move(*contact), std::move(*lift)};
  }

  std::nullopt_t note(FaceFailure failure) {
    if (!worst_ || failure.stage >= worst_->stage) worst_ = std::move(failure);
    return std::nullopt;
  }

  /// Found when a grip first asks for them: all ways to the first of the goals that has one.
  const Result<Stows>& stowsFrom(std::size_t grip, const ArmVector& near) {
    const auto known = stows_.find(grip);
    if (known != stows_.end()) return known->second;
    Stows stows;
    std::optional<PlanFailure> why;
    for (const ArmGoal& goal : stow_goals_) {
      for (const ArmGoal& way : waysToStow(task_, grips_[grip].held, grips_[grip].tilt.up_tip, goal)) {
        const Tilt tilt = way.keep_level ? Tilt(grips_[grip].tilt) : std::nullopt;
        const auto goals = findGoals(task_, way, near, scene_.carrying(), tilt);
        if (goals) stows.push_back({*goals, tilt});
        if (!goals) why = goals.failure();
      }
      if (!stows.empty() || why->status == PlanStatus::kCancelled) break;
    }
    return stows_.emplace(grip, stows.empty() ? Result<Stows>(*why) : Result<Stows>(std::move(stows))).first->second;
  }

  FaceFailure whyNoPick() const {
    if (num_postures_ == 0) {
      const Eigen::Vector3d p_map = task_.request.T_map_base * T_base_face_.translation();
      return {Stage::kIk,
              {PlanStatus::kNoIk, name_ + ": no joint angles reach it at " + inMetres(p_map) + " (" +
                                      std::to_string(grips_.size()) + " poses tried)"}};
    }
    if (!worst_) {
      return {Stage::kContact,
              {contacts_.status(),
               name_ + ": of " + std::to_string(num_postures_) + " postures that touch it " + contacts_.describe()}};
    }
    const std::string at_face = contacts_.empty() ? "" : "; at the face " + contacts_.describe();
    return {worst_->stage, {worst_->why.status, name_ + ": " + worst_->why.message + at_face}};
  }

  /// Searches the motions to before the face and from the lift's end.
  Result<PickPlan, FaceFailure> connect() {
    std::optional<FaceFailure> failure;
    for (int attempt = 0; attempt < kStowAttempts && !picks_.empty(); ++attempt) {
      std::vector<ArmVector> before_face;
      for (const Pick& pick : picks_) before_face.push_back(pick.contact.front());
      const auto approach =
          moveTo(task_, start_.joints_rad, before_face, scene_.beforeTouch(), std::nullopt, name_ + ", approach");
      if (!approach) return failure.value_or(FaceFailure{Stage::kApproach, approach.failure()});
      const Pick pick = picks_[approach->goal];
      const Grip& grip = grips_[pick.grip];
      scene_.hold(grip.held);
      for (const Stow& stow : *stows_.at(pick.grip)) {
        const auto carry = moveTo(task_, pick.lift.back(), stow.goals, scene_.carrying(), stow.tilt,
                                  name_ + ", carrying the brick away");
        if (carry) return planOf(pick, approach->trajectory, carry->trajectory);
        failure = FaceFailure{Stage::kStow, carry.failure()};
        if (failure->why.status == PlanStatus::kCancelled) return *failure;
      }
      // Another grip: what blocks this one blocks its other postures too.
      picks_.erase(
          std::remove_if(picks_.begin(), picks_.end(), [&](const Pick& other) { return other.grip == pick.grip; }),
          picks_.end());
    }
    return *failure;
  }

  PickPlan planOf(const Pick& pick, const JointTrajectory& approach, const JointTrajectory& stow) const {
    const Grip& grip = grips_[pick.grip];
    PickPlan plan;
    plan.face = face_;
    plan.T_map_contact = task_.request.T_map_base * grip.T_base_contact;
    plan.held = grip.held;
    plan.approach = approach;
    plan.contact = timedLine(task_, pick.contact, task_.config.speed.contact_speed_m_s);
    plan.lift = timedLine(task_, pick.lift, task_.config.speed.lift_speed_m_s);
    plan.stow = stow;
    return plan;
  }

  const TaskContext& task_;
  const StartState& start_;
  const PickTarget& target_;
  const BrickFace face_;
  const std::vector<ArmGoal>& stow_goals_;
  BrickInScene& scene_;
  const std::string name_;
  const Eigen::Isometry3d T_base_face_;
  const std::vector<Eigen::Vector3d> lift_offsets_;

  std::vector<Grip> grips_;
  std::map<std::size_t, Result<Stows>> stows_;  // by grip
  std::size_t num_postures_{0};
  std::vector<Pick> picks_;
  Rejections contacts_;               // of contact postures
  std::optional<FaceFailure> worst_;  // of the postures that got farther
};

std::optional<PlanFailure> refusal(const PlanningContext& request, const StartState& start, const PickTarget& target,
                                   const std::vector<ArmGoal>& stow_goals) {
  if (!start.back_off.empty()) {
    return PlanFailure{PlanStatus::kStartInCollision, "the arm's start is in collision; plan a motion out of it first"};
  }
  if (request.held) return badRequest("the magnet holds a brick already");
  if (target.type == nullptr) return badRequest("the brick's type is not known");
  if (target.faces.empty()) return badRequest("no face to try");
  if (target.faces.size() > static_cast<std::size_t>(description::kNumBrickFaces)) {
    return badRequest(std::to_string(target.faces.size()) + " faces to try, must be at most " +
                      std::to_string(description::kNumBrickFaces));
  }
  for (auto face = target.faces.begin(); face != target.faces.end(); ++face) {
    if (std::find(target.faces.begin(), face, *face) == face) continue;
    return badRequest(std::string("face ") + toString(*face) +
                      " is given twice, must be once: what fails once fails again");
  }
  if (!isRigid(target.T_map_brick)) return badRequest("pose of the brick is not a finite rigid transform");
  if (stow_goals.empty()) return badRequest("no goal to carry the brick to");
  return std::nullopt;
}

}  // namespace

PickResult planPick(const TaskContext& task, const StartState& start, const PickTarget& target,
                    const std::vector<ArmGoal>& stow_goals) {
  if (const auto why = refusal(task.request, start, target, stow_goals)) return {*why, {}};
  BrickInScene scene(start.checker, {target.T_map_brick, target.type->size_m}, task.config.pick.lift_room_m);
  std::optional<FaceFailure> farthest;
  std::vector<std::pair<BrickFace, PlanFailure>> tried;
  for (const BrickFace face : target.faces) {
    Result<PickPlan, FaceFailure> pick = FacePick(task, start, target, face, stow_goals, &scene).plan();
    if (pick) return {std::move(*pick), std::move(tried)};
    const FaceFailure& failure = pick.failure();
    tried.emplace_back(face, failure.why);
    const bool is_cancelled = failure.why.status == PlanStatus::kCancelled;
    if (is_cancelled || !farthest || failure.stage > farthest->stage) farthest = failure;
    if (is_cancelled) break;
  }
  return {farthest->why, std::move(tried)};
}

}  // namespace motion_planning
