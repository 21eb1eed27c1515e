// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/motion_planner.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <sstream>
#include <stdexcept>
#include <utility>

#include <gpis_mapping/range_check.h>
#include <mp700_ur5e_description/robot_names.h>

#include "collision/camera_view.h"
#include "collision/robot_shapes.h"
#include "kinematics/arm_reach.h"

namespace motion_planning {
namespace {

namespace description = mp700_ur5e_description;
using description::BrickFace;

constexpr double kPi = 3.14159265358979323846;
constexpr double kLineDeviation_rad = 1e-4;     // rounding of straight lines: 0.1 mm at the arm's full reach
constexpr double kTiltReserve_rad = 0.02;       // kept while planning, for what lies between checked states
constexpr double kLimitTolerance_rad = 1e-9;    // of ArmKinematics::isWithinLimits
constexpr std::uint64_t kSeedsPerCall = 1000;   // more than are used up in one
constexpr double kBesideUp = 0.9;               // cosine: nearer to up, away from the face is up
constexpr int kPlanAttempts = 3;                // finer each time, if a path turns out to graze something
constexpr int kRoundings = 4;                   // half the deviation each time, the last time practically none
constexpr int kStowAttempts = 3;                // contact postures tried if the brick cannot be carried away from one
constexpr double kLongestTurn_rad = 1.5 * kPi;  // of joint 1 to a goal: beyond it the other way is much shorter
constexpr double kLevelShare = 0.7;             // of the samples of a carrying motion
constexpr int kSampleAttempts = 30;             // to draw a posture that keeps a tilt
constexpr std::size_t kInspectPostures = 100;   // out of view, found before the nearest of them become goals

bool isFinitePositive(const Eigen::Vector3d& size) {
  return size.allFinite() && size.minCoeff() > 0.0;
}

std::string text(const Eigen::Vector3d& p) {
  std::ostringstream out;
  out.precision(3);
  out << std::fixed << "(" << p.x() << ", " << p.y() << ", " << p.z() << ") m";
  return out.str();
}

std::string degrees(double angle_rad) {
  std::ostringstream out;
  out.precision(1);
  out << std::fixed << angle_rad * 180.0 / kPi << " deg";
  return out.str();
}

PlanFailure failure(PlanStatus status, const std::string& message) {
  return {status, message};
}

PlanFailure startInCollision(const Contact& contact) {
  return failure(PlanStatus::kStartInCollision, "the arm's start is in collision: " + contact.describe());
}

/// One after the other; the first ends where and as the next begins, at rest.
void append(const JointTrajectory& next, JointTrajectory* whole) {
  const double since_s = whole->duration();
  const auto begin = next.points.begin() + (whole->empty() || next.empty() ? 0 : 1);
  for (auto point = begin; point != next.points.end(); ++point) {
    whole->points.push_back(*point);
    whole->points.back().time_s += since_s;
  }
}

PlanFailure cancelledFailure() {
  return failure(PlanStatus::kCancelled, "planning was cancelled");
}

/// Which joints, their angles and what is allowed.
std::string beyondLimits(const ArmVector& q, const ArmLimits& limits) {
  std::ostringstream out;
  out.precision(3);
  out << std::fixed;
  const char* separator = "";
  for (Eigen::Index j = 0; j < q.size(); ++j) {
    if (q[j] >= limits.lower_rad[j] - kLimitTolerance_rad && q[j] <= limits.upper_rad[j] + kLimitTolerance_rad)
      continue;
    out << separator << description::kArmJoints[static_cast<std::size_t>(j)] << " = " << q[j] << " rad, must be in ["
        << limits.lower_rad[j] << ", " << limits.upper_rad[j] << "] rad";
    separator = "; ";
  }
  return out.str();
}

/// Shortest rotation that turns unit vector `from` into `to`.
Eigen::Matrix3d turning(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  // Not Eigen's FromTwoVectors: some 1e-6 rad from opposite, as a brick is that physics has laid down, it cancels and
  // gives no rotation.
  Eigen::Vector3d axis = from.cross(to);
  const double sine = axis.norm();
  constexpr double kParallel = 1e-9;
  axis = sine > kParallel ? Eigen::Vector3d(axis / sine) : from.unitOrthogonal();
  return Eigen::AngleAxisd(std::atan2(sine, from.dot(to)), axis).toRotationMatrix();
}

Eigen::Matrix3d aboutZ(double angle_rad) {
  return Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

/// The edge of the brick that is nearest to upright, as a unit vector in the tip's frame: the face that is up.
Eigen::Vector3d uprightEdge(const HeldBrick& held, const Eigen::Isometry3d& T_base_tip) {
  const Eigen::Matrix3d R_base_brick = T_base_tip.linear() * held.T_tip_brick.linear();
  int edge = 0;
  R_base_brick.row(2).cwiseAbs().maxCoeff(&edge);
  const double sign = R_base_brick(2, edge) < 0.0 ? -1.0 : 1.0;
  return sign * held.T_tip_brick.linear().col(edge);
}

/// What stood in the way of postures, counted.
class Rejections {
 public:
  void add(const Contact& contact) {
    if (!first_ || (contact.kind == CollisionKind::kUnknown && first_.kind != CollisionKind::kUnknown))
      first_ = contact;
    ++count_[contact.kind];
    ++total_;
  }
  bool empty() const { return total_ == 0; }
  /// Unseen space may turn out to be free: one posture that nothing else blocks makes it the reason.
  PlanStatus status() const {
    return count_.count(CollisionKind::kUnknown) != 0 ? PlanStatus::kGoalUnknown : PlanStatus::kGoalInCollision;
  }
  std::string describe() const {
    std::ostringstream out;
    out << total_ << " in collision (";
    const char* separator = "";
    for (const auto& [kind, count] : count_) {
      out << separator << toString(kind) << " " << count;
      separator = ", ";
    }
    out << "), for one: " << first_.describe();
    return out.str();
  }

 private:
  Contact first_;
  std::map<CollisionKind, int> count_;
  int total_{0};
};

}  // namespace

const char* toString(PlanStatus status) {
  switch (status) {
    case PlanStatus::kSuccess:
      return "success";
    case PlanStatus::kBadRequest:
      return "bad request";
    case PlanStatus::kNoMap:
      return "no map";
    case PlanStatus::kOutsideSector:
      return "outside sector";
    case PlanStatus::kNoIk:
      return "no inverse kinematics";
    case PlanStatus::kStartInCollision:
      return "start in collision";
    case PlanStatus::kGoalInCollision:
      return "goal in collision";
    case PlanStatus::kGoalUnknown:
      return "goal in unknown space";
    case PlanStatus::kApproachBlocked:
      return "approach blocked";
    case PlanStatus::kIterations:
      return "no path found";
    case PlanStatus::kConstraint:
      return "constraint";
    case PlanStatus::kCancelled:
      return "cancelled";
    case PlanStatus::kNoRobotState:
      return "no robot state";
    case PlanStatus::kOutsideLimits:
      return "outside limits";
  }
  return "unknown";
}

std::vector<std::string> MotionPlannerConfig::validate() const {
  // Sections as in config_fields.h.
  std::vector<std::string> problems;
  const auto append = [&problems](const char* section, const std::vector<std::string>& more) {
    for (const std::string& problem : more) problems.push_back(std::string(section) + problem);
  };
  append("collision/", collision.validate());
  append("search/", planner.validate());
  gpis_mapping::RangeCheck search("search/");
  search("verify_step_m", verify_step_m, 0.001, 0.1, "m");
  append("", search.problems());
  append("motion/", timing.validate());
  gpis_mapping::RangeCheck motion("motion/");
  motion("velocity_scale", velocity_scale, 0.01, 1.0, "");
  motion("acceleration_rad_s2", acceleration_rad_s2, 0.05, 40.0, "rad/s^2");
  motion("contact_speed_m_s", contact_speed_m_s, 0.001, 0.25, "m/s");
  motion("lift_speed_m_s", lift_speed_m_s, 0.001, 1.0, "m/s");
  append("", motion.problems());
  gpis_mapping::RangeCheck pick("pick/");
  pick("approach_m", approach_m, 0.01, 0.5, "m");
  pick("lift_m", lift_m, 0.01, 0.5, "m");
  pick("min_lift_m", min_lift_m, 0.005, std::max(0.005, lift_m), "m");
  pick("lift_room_m", lift_room_m, 0.0, 0.2, "m");
  pick("overtravel_m", overtravel_m, 0.0, 0.03, "m");
  pick("cartesian_step_m", cartesian_step_m, 5e-4, 0.02, "m");
  pick("max_joint_jump_rad", max_joint_jump_rad, 0.01, 1.0, "rad");
  pick("plate_margin_m", plate_margin_m, 0.0, 0.2, "m");
  pick("magnet_radius_m", magnet_radius_m, 0.001, 0.2, "m");
  pick("yaw_samples", yaw_samples, 1, 360, "");
  pick("contact_grid_m", contact_grid_m, 0.005, 1.0, "m");
  pick("max_goals", max_goals, 1, 1000, "");
  pick("max_tilt_rad", max_tilt_rad, 0.05, 3.2, "rad");
  append("", pick.problems());
  gpis_mapping::RangeCheck view("view/");
  view("clear_m", inspect_clear_m, 0.0, 1.0, "m");
  view("samples", inspect_samples, 0, 1e6, "");
  append("", view.problems());
  return problems;
}

/// One request. Members are what all of its stages share.
class MotionPlanner::Call {
 public:
  Call(const MotionPlanner& planner, const PlanningContext& context)
      : planner_(planner),
        config_(planner.config_),
        arm_(*planner.arm_),
        context_(context),
        T_base_map_(context.T_map_base.inverse()) {
    limits_.velocity_rad_s = config_.velocity_scale * arm_.limits().velocity_rad_s;
    limits_.acceleration_rad_s2.setConstant(config_.acceleration_rad_s2);
  }

  /// The request's common part, and whether the arm may be where it is. Success: free() can be used.
  PlanFailure begin() {
    if (!context_.scene) return failure(PlanStatus::kNoMap, "there is no collision scene yet");
    if (!isRigid(context_.T_map_base)) {
      return failure(PlanStatus::kBadRequest, "pose of the base is not a finite rigid transform");
    }
    if (!context_.start_rad.allFinite())
      return failure(PlanStatus::kBadRequest, "start has an angle that is not finite");
    if (!arm_.isWithinLimits(context_.start_rad)) {
      return failure(PlanStatus::kOutsideLimits, "the arm's start: " + beyondLimits(context_.start_rad, arm_.limits()));
    }
    if (context_.held && !(isRigid(context_.held->T_tip_brick) && isFinitePositive(context_.held->size_m))) {
      return failure(PlanStatus::kBadRequest, "held brick: pose not a rigid transform, or size not positive");
    }
    if (context_.vacated && !(isRigid(context_.vacated->T_map_box) && isFinitePositive(context_.vacated->size_m))) {
      return failure(PlanStatus::kBadRequest, "vacated place: pose not a rigid transform, or size not positive");
    }
    checker_.emplace(planner_.arm_, context_.scene, context_.T_map_base, config_.collision);
    checker_->setHeld(context_.held, false);
    if (context_.vacated) checker_->setTarget(context_.vacated, true);
    checker_->freeUnknownAt(context_.start_rad);
    checker_->yieldToRobotAt(context_.start_rad);
    // Still among its neighbours, where it touches them: as in a lift.
    if (context_.held && checker_->check(context_.start_rad)) {
      is_among_others_ = true;
      checker_->setHeld(context_.held);
      wedged_ = checker_->check(context_.start_rad);
      if (wedged_) checker_->setHeldAt(*context_.held, {context_.start_rad});
    }
    if (isCancelled()) return cancelledFailure();
    if (const Contact contact = checker_->check(context_.start_rad)) {
      if (!backOff()) return startInCollision(contact);
    }
    return {};
  }

  /// What was planned, from where the arm is: after the way back from a face, if it was at one.
  ArmPlan fromStart(ArmPlan plan) const {
    if (plan.status != PlanStatus::kSuccess || back_off_.size() < 2) return plan;
    JointTrajectory whole = timedLine(back_off_, config_.lift_speed_m_s);
    append(plan.trajectory, &whole);
    plan.trajectory = std::move(whole);
    return plan;
  }

  bool isBackedOff() const { return !back_off_.empty(); }
  ArmPlan planArm(const ArmGoal& goal);
  ArmPlan planInspect(const ViewFrustum& view, const std::vector<ArmVector>& postures);
  PickPlan planPick(const PickTarget& target, const std::vector<ArmGoal>& stow_goals);

 private:
  using Tilt = std::optional<TiltConstraint>;

  struct Goals : PlanFailure {
    std::vector<ArmVector> postures;  // free, nearest first
  };
  struct Motion : PlanFailure {
    JointTrajectory trajectory;
    std::size_t goal{0};
  };
  /// A way to touch the face.
  struct Candidate {
    std::size_t grip;   // index into grips
    ArmVector contact;  // posture
    bool is_dexterous;  // manipulability above the sector's threshold
    double way_s;       // from the start, every joint at its limit
  };
  /// Where the tip stands on the face, and how the brick hangs then.
  struct Grip {
    Eigen::Isometry3d T_base_contact;
    HeldBrick held;
    TiltConstraint tilt;
    std::optional<Goals> stow;  // found when first asked for
    Tilt stow_tilt;             // the constraint on the way there
  };
  /// A candidate with its straight ways.
  struct Pick {
    std::size_t grip;
    JointPath contact;  // from before the face to it
    JointPath lift;
  };
  /// How far a face got, for choosing what to report.
  enum Stage {
    kFaceStage,
    kSectorStage,
    kIkStage,
    kContactStage,
    kLineStage,
    kStowGoalStage,
    kApproachStage,
    kStowStage
  };
  struct FaceOutcome : PlanFailure {
    Stage stage{kFaceStage};
  };

  bool isCancelled() const { return context_.is_cancelled && context_.is_cancelled(); }

  double tiltOf(const TiltConstraint& tilt, const ArmVector& q) const {
    const Eigen::Vector3d up_base = arm_.tipPose(q).linear() * tilt.up_tip;
    return std::acos(std::clamp(up_base.z(), -1.0, 1.0));
  }

  JointPath followLine(const ArmVector& from, const Eigen::Isometry3d& T_base_from,
                       const Eigen::Vector3d& way_base) const;
  std::size_t numSteps(double way_m) const;
  std::function<ArmVector(const std::function<double()>&)> tiltSampler(const TiltConstraint& tilt,
                                                                       std::vector<ArmVector> references) const;
  std::optional<JointTrajectory> timed(const JointPath& path, const ArmVector& reach_m,
                                       const std::function<bool(const ArmVector&)>& is_valid) const;
  JointTrajectory timedLine(const JointPath& line, double speed_m_s) const;
  bool backOff();
  JointPath liftOut(const Eigen::Vector3d& way_base) const;
  ArmPlan planFrom(const JointPath& line, const ArmGoal& goal);
  Goals findGoals(const ArmGoal& goal, const ArmVector& near, const CollisionChecker& checker,
                  const std::optional<HeldBrick>& held, const Tilt& tilt) const;
  std::vector<Eigen::Isometry3d> placePoses(const PlaceGoal& place, const HeldBrick& held,
                                            const Eigen::Vector3d& up_tip) const;
  Motion moveTo(const ArmVector& start, const std::vector<ArmVector>& goals, const CollisionChecker& checker,
                const std::optional<HeldBrick>& held, const Tilt& tilt, const std::string& what) const;
  PlanFailure tiltOfHeld(bool keep_level, Tilt* tilt) const;

  FaceOutcome planFace(const PickTarget& target, BrickFace face, const std::vector<ArmGoal>& stow_goals,
                       PickPlan* plan);
  std::vector<Candidate> candidatesFor(std::vector<Grip>* grips, std::size_t first_grip) const;
  std::optional<Pick> examine(const Candidate& candidate, const std::vector<ArmGoal>& stow_goals,
                              const std::vector<Eigen::Vector3d>& lifts_base, std::vector<Grip>* grips,
                              Rejections* contacts, FaceOutcome* worst);
  void hold(std::size_t grip, const HeldBrick& held);
  const Goals& stowGoals(Grip* grip, const std::vector<ArmGoal>& stow_goals, const ArmVector& near) const;

  const MotionPlanner& planner_;
  const MotionPlannerConfig& config_;
  const ArmKinematics& arm_;
  PlanningContext context_;  // its start is where what is planned begins
  JointPath back_off_;       // on the way there from a face that the empty magnet touches
  const Eigen::Isometry3d T_base_map_;
  MotionLimits limits_;
  bool is_among_others_{false};              // what is held, at the start
  Contact wedged_;                           // ... more than a lift allows: out of there, and nothing else
  std::optional<CollisionChecker> checker_;  // as the robot stands: held, vacated, start known to be free
  // For a pick: the target may be touched; the same with the brick in the hand; the brick's place is empty.
  std::optional<CollisionChecker> touching_;
  std::optional<CollisionChecker> lifting_;
  std::optional<CollisionChecker> carrying_;
  std::optional<CollisionChecker> roomy_;    // the same, with a brick larger by lift_room_m to all sides
  std::optional<std::size_t> holding_grip_;  // whose brick the last three hold
};

std::size_t MotionPlanner::Call::numSteps(double way_m) const {
  return static_cast<std::size_t>(std::max(1.0, std::ceil(way_m / config_.cartesian_step_m - 1e-9)));
}

/// Postures every cartesian_step_m along a straight line of the tip, all of one branch; numSteps() + 1 of them, or fewer:
/// as far as the arm can follow.
JointPath MotionPlanner::Call::followLine(const ArmVector& from, const Eigen::Isometry3d& T_base_from,
                                          const Eigen::Vector3d& way_base) const {
  const std::size_t steps = numSteps(way_base.norm());
  JointPath line = {from};
  for (std::size_t k = 1; k <= steps; ++k) {
    Eigen::Isometry3d T_base_tip = T_base_from;
    T_base_tip.translation() += way_base * (static_cast<double>(k) / static_cast<double>(steps));
    const std::vector<ArmVector> branches = arm_.inverse(T_base_tip, line.back());
    if (branches.empty()) break;
    if ((branches.front() - line.back()).lpNorm<Eigen::Infinity>() > config_.max_joint_jump_rad) break;
    line.push_back(branches.front());
  }
  return line;
}

/// Draws postures with the carried thing tilted by no more than allowed. Most of them keep the tool at the angle that one
/// of the references (start and goals) has: joints 2, 3 and 4 turn about parallel axes, so that all postures with the
/// same sum of the three and the same joint 5 do, whatever joint 1, whose axis is upright, and so does every straight line
/// between two of them; trees grow along these without being cut by the constraint. The rest draws tips in the arm's
/// reach with any allowed tilt, and a random branch for each.
std::function<ArmVector(const std::function<double()>&)> MotionPlanner::Call::tiltSampler(
    const TiltConstraint& tilt, std::vector<ArmVector> references) const {
  const Eigen::Isometry3d T_base_armbase =
      arm_.robot().framePose(description::kArmBaseFrame, arm_.robotPositions(ArmVector::Zero()));
  const Eigen::Matrix3d R_level = turning(tilt.up_tip, Eigen::Vector3d::UnitZ());
  const double cos_max = std::cos(std::max(0.0, tilt.max_tilt_rad - kTiltReserve_rad));
  const double reach_m = armReach(arm_, std::nullopt)[0];
  const double max_tilt_rad = std::max(0.0, tilt.max_tilt_rad - kTiltReserve_rad);
  return [=, references = std::move(references)](const std::function<double()>& uniform01) -> ArmVector {
    const auto& near = references[std::min(
        references.size() - 1, static_cast<std::size_t>(uniform01() * static_cast<double>(references.size())))];
    if (uniform01() < kLevelShare) {
      ArmVector q = near;
      const double sum_rad = near[1] + near[2] + near[3];
      q[0] += kPi * (2.0 * uniform01() - 1.0);
      q[1] += kPi * (2.0 * uniform01() - 1.0);
      q[2] = std::copysign(kPi * uniform01(), near[2]);  // through the stretched arm is a long way round
      q[3] = sum_rad - q[1] - q[2];
      const double roll_rad = kPi * (2.0 * uniform01() - 1.0);
      q[5] += roll_rad;
      if (tiltOf(tilt, q) > max_tilt_rad) q[5] -= roll_rad;  // the tool is not upright: turning it tilts
      return q;
    }
    for (int attempt = 0; attempt < kSampleAttempts; ++attempt) {
      Eigen::Isometry3d T_base_tip = Eigen::Isometry3d::Identity();
      Eigen::Vector3d p_armbase;
      for (int i = 0; i < 3; ++i) p_armbase[i] = reach_m * (2.0 * uniform01() - 1.0);
      T_base_tip.translation() = T_base_armbase * p_armbase;
      // Uniform in the cone's solid angle.
      const double cos_tilt = 1.0 - uniform01() * (1.0 - cos_max);
      const double sin_tilt = std::sqrt(std::max(0.0, 1.0 - cos_tilt * cos_tilt));
      const double to = 2.0 * kPi * uniform01();
      const Eigen::Vector3d up(sin_tilt * std::cos(to), sin_tilt * std::sin(to), cos_tilt);
      T_base_tip.linear() = turning(Eigen::Vector3d::UnitZ(), up) * aboutZ(2.0 * kPi * uniform01()) * R_level;
      const std::vector<ArmVector> branches = arm_.inverse(T_base_tip, near);
      if (branches.empty()) continue;
      return branches[std::min(branches.size() - 1,
                               static_cast<std::size_t>(uniform01() * static_cast<double>(branches.size())))];
    }
    return near;
  };
}

/// Rounds the path's corners as far as that stays valid, and times it. Nothing: it is not valid even with sharp corners,
/// looked at every verify_step_m.
std::optional<JointTrajectory> MotionPlanner::Call::timed(const JointPath& path, const ArmVector& reach_m,
                                                          const std::function<bool(const ArmVector&)>& is_valid) const {
  TimingConfig timing = config_.timing;
  for (int round = 0; round < kRoundings; ++round) {
    if (round + 1 == kRoundings) timing.max_deviation_rad = std::min(timing.max_deviation_rad, kLineDeviation_rad);
    const JointPath dense = roundedPath(path, config_.verify_step_m / reach_m.sum(), timing);
    const ArmVector* checked = &dense.front();
    bool valid = true;
    for (std::size_t i = 1; i < dense.size() && valid; ++i) {
      const bool is_last = i + 1 == dense.size();
      if (!is_last && reach_m.dot((dense[i + 1] - *checked).cwiseAbs()) <= config_.verify_step_m) continue;
      valid = is_valid(dense[i]);
      checked = &dense[i];
    }
    if (valid) return timeParametrize(path, limits_, timing);
    if (isCancelled()) return std::nullopt;
    timing.max_deviation_rad = std::max(1e-6, 0.5 * timing.max_deviation_rad);
  }
  return std::nullopt;
}

JointTrajectory MotionPlanner::Call::timedLine(const JointPath& line, double speed_m_s) const {
  TimingConfig timing = config_.timing;
  timing.max_deviation_rad = std::min(timing.max_deviation_rad, kLineDeviation_rad);
  return timeParametrize(line, limits_, timing, tipSpeedLimit(planner_.arm_, speed_m_s));
}

/// Poses of the tip that hold the brick over the opening; edges along the opening's are among the turns.
std::vector<Eigen::Isometry3d> MotionPlanner::Call::placePoses(const PlaceGoal& place, const HeldBrick& held,
                                                               const Eigen::Vector3d& up_tip) const {
  const Eigen::Matrix3d R_level = turning(up_tip, Eigen::Vector3d::UnitZ());
  const Eigen::Matrix3d R_level_brick = R_level * held.T_tip_brick.linear();
  int edge = 0;  // one that lies flattest
  R_level_brick.row(2).cwiseAbs().minCoeff(&edge);
  const double brick_yaw = std::atan2(R_level_brick(1, edge), R_level_brick(0, edge));
  const Eigen::Matrix3d& R_opening = place.T_base_opening.linear();
  const double opening_yaw = std::atan2(R_opening(1, 0), R_opening(0, 0));
  std::vector<double> turns;
  for (int k = 0; k < config_.yaw_samples; ++k) turns.push_back(2.0 * kPi * k / config_.yaw_samples);
  std::vector<Eigen::Isometry3d> T_base_tips;
  for (const double turn : turns) {
    Eigen::Isometry3d T_base_brick = Eigen::Isometry3d::Identity();
    T_base_brick.linear() = aboutZ(opening_yaw - brick_yaw + turn) * R_level_brick;
    const double half_height_m = 0.5 * T_base_brick.linear().row(2).cwiseAbs().dot(held.size_m);
    T_base_brick.translation() =
        place.T_base_opening.translation() + Eigen::Vector3d(0.0, 0.0, place.above_m + half_height_m);
    T_base_tips.push_back(T_base_brick * held.T_tip_brick.inverse());
  }
  return T_base_tips;
}

MotionPlanner::Call::Goals MotionPlanner::Call::findGoals(const ArmGoal& goal, const ArmVector& near,
                                                          const CollisionChecker& checker,
                                                          const std::optional<HeldBrick>& held,
                                                          const Tilt& tilt) const {
  Goals goals;
  const auto fail = [&goals](PlanStatus status, const std::string& message) {
    static_cast<PlanFailure&>(goals) = failure(status, message);
    return goals;
  };
  const int kinds = (goal.joints_rad ? 1 : 0) + (goal.T_map_tip ? 1 : 0) + (goal.place ? 1 : 0);
  if (kinds != 1) {
    return fail(PlanStatus::kBadRequest,
                "a goal has " + std::to_string(kinds) + " of joints, tip and place, must have 1");
  }
  std::vector<ArmVector> postures;
  std::string what;
  if (goal.joints_rad) {
    if (!goal.joints_rad->allFinite()) return fail(PlanStatus::kBadRequest, "goal has an angle that is not finite");
    if (!arm_.isWithinLimits(*goal.joints_rad)) {
      return fail(PlanStatus::kOutsideLimits, "the goal posture: " + beyondLimits(*goal.joints_rad, arm_.limits()));
    }
    postures.push_back(*goal.joints_rad);
    what = "the goal posture";
  } else {
    std::vector<Eigen::Isometry3d> T_base_tips;
    if (goal.T_map_tip) {
      if (!isRigid(*goal.T_map_tip))
        return fail(PlanStatus::kBadRequest, "goal of the tip is not a finite rigid transform");
      T_base_tips.push_back(T_base_map_ * *goal.T_map_tip);
      what = "the tip at " + text(goal.T_map_tip->translation()) + " in the map";
    } else {
      if (!held) return fail(PlanStatus::kBadRequest, "nothing is held that could be placed");
      if (!isRigid(goal.place->T_base_opening) || !std::isfinite(goal.place->above_m)) {
        return fail(PlanStatus::kBadRequest, "place: the opening's pose is not rigid, or above_m is not finite");
      }
      const Eigen::Vector3d up_tip = tilt ? tilt->up_tip : uprightEdge(*held, arm_.tipPose(context_.start_rad));
      T_base_tips = placePoses(*goal.place, *held, up_tip);
      what = "the brick over the opening at " + text(goal.place->T_base_opening.translation()) + " in base_link";
    }
    for (const Eigen::Isometry3d& T_base_tip : T_base_tips) {
      const std::vector<ArmVector> branches = arm_.inverse(T_base_tip, near);
      postures.insert(postures.end(), branches.begin(), branches.end());
    }
    if (postures.empty()) {
      return fail(PlanStatus::kNoIk,
                  what + ": no joint angles reach it (" + std::to_string(T_base_tips.size()) + " poses tried)");
    }
    // A whole turn of the first joint is another way round the mast; of the others, the same way.
    const std::size_t given = postures.size();
    for (std::size_t i = 0; i < given; ++i) {
      for (const double turn : {-2.0 * kPi, 2.0 * kPi}) {
        ArmVector turned = postures[i];
        turned[0] += turn;
        if (arm_.isWithinLimits(turned)) postures.push_back(turned);
      }
    }
    std::stable_sort(postures.begin(), postures.end(), [&](const ArmVector& a, const ArmVector& b) {
      return (a - near).squaredNorm() < (b - near).squaredNorm();
    });
  }
  Rejections rejections;
  double least_tilt_rad = kPi;
  for (const ArmVector& q : postures) {
    if (isCancelled()) return fail(PlanStatus::kCancelled, cancelledFailure().message);
    if (tilt) {
      const double tilt_rad = tiltOf(*tilt, q);
      least_tilt_rad = std::min(least_tilt_rad, tilt_rad);
      if (tilt_rad > tilt->max_tilt_rad) continue;
    }
    if (const Contact contact = checker.check(q)) {
      rejections.add(contact);
      continue;
    }
    goals.postures.push_back(q);
    // The other way round as well: the mast stands in one of them. A posture that was asked for is meant as it is.
    ArmVector other_way = q;
    other_way[0] += q[0] > near[0] ? -2.0 * kPi : 2.0 * kPi;
    if (!goal.joints_rad && std::abs(other_way[0] - near[0]) <= kLongestTurn_rad && arm_.isWithinLimits(other_way)) {
      goals.postures.push_back(other_way);
    }
    if (goals.postures.size() >= static_cast<std::size_t>(config_.max_goals)) break;
  }
  if (!goals.postures.empty()) return goals;
  if (rejections.empty()) {
    return fail(PlanStatus::kConstraint, what + " tilts what is carried by " + degrees(least_tilt_rad) +
                                             " or more, allowed are " + degrees(tilt->max_tilt_rad));
  }
  return fail(rejections.status(),
              what + ": of " + std::to_string(postures.size()) + " postures " + rejections.describe());
}

MotionPlanner::Call::Motion MotionPlanner::Call::moveTo(const ArmVector& start, const std::vector<ArmVector>& goals,
                                                        const CollisionChecker& checker,
                                                        const std::optional<HeldBrick>& held, const Tilt& tilt,
                                                        const std::string& what) const {
  Motion motion;
  const auto fail = [&motion](const PlanFailure& why) {
    static_cast<PlanFailure&>(motion) = why;
    return motion;
  };
  JointSpace space;
  space.lower_rad = arm_.limits().lower_rad.array() - kLimitTolerance_rad;
  space.upper_rad = arm_.limits().upper_rad.array() + kLimitTolerance_rad;
  double planned_tilt_rad = 0.0;
  if (tilt) {
    // Start and goals may use up the reserve.
    planned_tilt_rad = std::max(tilt->max_tilt_rad - kTiltReserve_rad, tiltOf(*tilt, start));
    for (const ArmVector& goal : goals) planned_tilt_rad = std::max(planned_tilt_rad, tiltOf(*tilt, goal));
    std::vector<ArmVector> references(goals.size() + 1, start);  // as often the start as a goal
    references.insert(references.end(), goals.begin(), goals.end());
    space.sample = tiltSampler(*tilt, std::move(references));
  }
  const auto is_valid_within = [&](const ArmVector& q, double max_tilt_rad) {
    return (!tilt || tiltOf(*tilt, q) <= max_tilt_rad) && checker.isFree(q);
  };
  space.is_valid = [&](const ArmVector& q) { return is_valid_within(q, planned_tilt_rad); };
  const ArmVector reach_m = armReach(arm_, held);
  JointPlannerConfig planner = config_.planner;
  planner.seed += kSeedsPerCall * context_.seed;
  for (int attempt = 0; attempt < kPlanAttempts; ++attempt) {
    const JointPlanResult result = planJointPath(space, start, goals, planner, context_.is_cancelled);
    switch (result.status) {
      case JointPlanStatus::kSolved:
        break;
      case JointPlanStatus::kCancelled:
        return fail(cancelledFailure());
      case JointPlanStatus::kStartInvalid:
        return fail(failure(PlanStatus::kStartInCollision,
                            what + ": the motion's start is in collision: " + checker.check(start).describe()));
      case JointPlanStatus::kGoalInvalid:
        return fail(failure(PlanStatus::kGoalInCollision,
                            what + ": the motion's end is in collision: " + checker.check(goals.front()).describe()));
      case JointPlanStatus::kIterations:
        return fail(failure(PlanStatus::kIterations, what + ": no path to any of " + std::to_string(goals.size()) +
                                                         " goals in " + std::to_string(result.iterations) +
                                                         " iterations"));
    }
    const double max_tilt_rad = tilt ? std::max(tilt->max_tilt_rad, planned_tilt_rad) : 0.0;
    const auto trajectory =
        timed(result.path, reach_m, [&](const ArmVector& q) { return is_valid_within(q, max_tilt_rad); });
    if (trajectory) {
      motion.trajectory = *trajectory;
      motion.goal = result.goal;
      return motion;
    }
    if (isCancelled()) return fail(cancelledFailure());
    ++planner.seed;
    planner.check_step_rad = std::max(1e-4, 0.5 * planner.check_step_rad);
  }
  return fail(failure(PlanStatus::kIterations, what + ": " + std::to_string(kPlanAttempts) +
                                                   " paths found, each too near to something between its states"));
}

/// The constraint on carrying what is held, if there is one.
PlanFailure MotionPlanner::Call::tiltOfHeld(bool keep_level, Tilt* tilt) const {
  tilt->reset();
  if (!context_.held || !keep_level) return {};
  *tilt = TiltConstraint{uprightEdge(*context_.held, arm_.tipPose(context_.start_rad)), config_.max_tilt_rad};
  const double tilt_rad = tiltOf(**tilt, context_.start_rad);
  if (tilt_rad <= config_.max_tilt_rad) return {};
  return failure(PlanStatus::kConstraint, "what is held is tilted by " + degrees(tilt_rad) +
                                              " at the start, allowed are " + degrees(config_.max_tilt_rad));
}

ArmPlan MotionPlanner::Call::planArm(const ArmGoal& goal) {
  ArmPlan plan;
  static_cast<PlanFailure&>(plan) = startInCollision(wedged_);
  if (!is_among_others_) {
    plan = planFrom({context_.start_rad}, goal);
    if (plan.status != PlanStatus::kIterations || !context_.held) return plan;
  }
  // Between others a search finds no way out that a straight one may be: up, away from the face that is held, or both.
  const Eigen::Vector3d up_base = T_base_map_.linear() * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d back_base = -arm_.tipPose(context_.start_rad).linear().col(2);
  std::vector<Eigen::Vector3d> ways_base{up_base};
  if (back_base.dot(up_base) < kBesideUp) {
    ways_base.push_back((up_base + back_base).normalized());
    ways_base.push_back(back_base);
  }
  const CollisionChecker as_it_hangs(*checker_);
  bool has_way = false;
  for (const Eigen::Vector3d& way_base : ways_base) {
    if (isCancelled()) break;
    checker_.emplace(as_it_hangs);
    const JointPath line = liftOut(way_base);
    if (line.size() < 2) continue;
    ArmPlan from_there = planFrom(line, goal);
    if (from_there.status == PlanStatus::kSuccess) return from_there;
    if (is_among_others_ && !has_way) plan = std::move(from_there);  // why not: of the first way that there is
    has_way = true;
  }
  if (is_among_others_ && !has_way && !wedged_) {
    checker_.emplace(as_it_hangs);
    return planFrom({context_.start_rad}, goal);
  }
  if (isCancelled()) static_cast<PlanFailure&>(plan) = cancelledFailure();
  return plan;
}

/// Along a straight way (or from the start alone), and from its end by search.
ArmPlan MotionPlanner::Call::planFrom(const JointPath& line, const ArmGoal& goal) {
  ArmPlan plan;
  if (line.size() > 1) {
    plan.trajectory = timedLine(line, config_.lift_speed_m_s);
    checker_->setTarget(context_.vacated, true);
    checker_->setHeld(context_.held, false);
  }
  Tilt tilt;
  PlanFailure why = tiltOfHeld(goal.keep_level, &tilt);
  if (why.status == PlanStatus::kSuccess) {
    const Goals goals = findGoals(goal, line.back(), *checker_, context_.held, tilt);
    why = goals;
    if (why.status == PlanStatus::kSuccess) {
      const Motion motion = moveTo(line.back(), goals.postures, *checker_, context_.held, tilt, "the arm");
      why = motion;
      append(motion.trajectory, &plan.trajectory);
    }
  }
  if (why.status != PlanStatus::kSuccess) plan.trajectory = {};
  static_cast<PlanFailure&>(plan) = why;
  return plan;
}

/// Straight from the start, by at most lift_m, until what is held is clear of what it hangs among, with room to all sides if
/// it comes to that. Empty: it cannot be reached so.
/// An empty magnet at a face, where a pick was broken off: straight back, as far as an approach begins. False: it is not that.
bool MotionPlanner::Call::backOff() {
  CollisionChecker touching(*checker_);
  if (!touching.yieldToMagnetAt(context_.start_rad)) return false;
  const Eigen::Isometry3d T_base_tip = arm_.tipPose(context_.start_rad);
  JointPath line = followLine(context_.start_rad, T_base_tip, -config_.approach_m * T_base_tip.linear().col(2));
  std::size_t end = 0;
  for (std::size_t k = 1; k < line.size() && touching.isFree(line[k]); ++k) {
    if (checker_->isFree(line[k])) end = k;
  }
  if (end == 0) return false;
  line.resize(end + 1);
  back_off_ = std::move(line);
  context_.start_rad = back_off_.back();
  return true;
}

JointPath MotionPlanner::Call::liftOut(const Eigen::Vector3d& way_base) const {
  JointPath line = followLine(context_.start_rad, arm_.tipPose(context_.start_rad), config_.lift_m * way_base);
  CollisionChecker among(*checker_);
  const std::size_t first = std::min(line.size(), numSteps(kAmongOthers_m) + 1);
  among.setHeldAt(*context_.held, {line.begin(), line.begin() + static_cast<std::ptrdiff_t>(first)});
  // Out is where it needs no leave to be: that for the place where it hangs ends with the lift.
  CollisionChecker whole(*checker_);
  whole.setTarget(context_.vacated, true);
  whole.setHeld(context_.held, false);
  CollisionChecker roomy(whole);
  HeldBrick with_room = *context_.held;
  with_room.size_m.array() += 2.0 * config_.lift_room_m;
  roomy.setHeld(with_room, false);
  std::size_t end = 0;
  for (std::size_t k = 1; k < line.size() && among.isFree(line[k]); ++k) {
    if (whole.isFree(line[k])) end = k;
    if (roomy.isFree(line[k])) break;
  }
  if (end == 0) return {};
  line.resize(end + 1);
  return line;
}

ArmPlan MotionPlanner::Call::planInspect(const ViewFrustum& view, const std::vector<ArmVector>& postures) {
  ArmPlan plan;
  const auto fail = [&plan](const PlanFailure& why) {
    static_cast<PlanFailure&>(plan) = why;
    return plan;
  };
  const bool is_view = isRigid(view.T_base_camera) && view.half_width_rad > 0.0 && view.half_width_rad < 0.5 * kPi &&
                       view.half_height_rad > 0.0 && view.half_height_rad < 0.5 * kPi && view.max_range_m > 0.0 &&
                       std::isfinite(view.max_range_m);
  if (!is_view) {
    return fail(failure(PlanStatus::kBadRequest,
                        "view: pose not rigid, half angles not in (0, pi/2) rad, or range not positive and finite"));
  }
  if (wedged_) return fail(startInCollision(wedged_));
  Tilt tilt;
  const PlanFailure level = tiltOfHeld(true, &tilt);
  if (level.status != PlanStatus::kSuccess) return fail(level);

  std::size_t in_view = 0;
  Rejections rejections;
  PlanFailure blocked;
  const auto qualifies = [&](const ArmVector& q) {
    if (!q.allFinite() || !arm_.isWithinLimits(q)) return false;
    if (tilt && tiltOf(*tilt, q) > tilt->max_tilt_rad) return false;
    if (blocksView(arm_, q, context_.held, view, config_.inspect_clear_m)) {
      ++in_view;
      return false;
    }
    const Contact contact = checker_->check(q);
    if (contact) rejections.add(contact);
    return !contact;
  };
  const auto arrive = [&](const std::vector<ArmVector>& goals) {
    Motion motion = moveTo(context_.start_rad, goals, *checker_, context_.held, tilt, "to a posture out of view");
    plan.trajectory = std::move(motion.trajectory);
    blocked = motion;
    return motion.status == PlanStatus::kSuccess;
  };
  for (const ArmVector& posture : postures) {
    if (isCancelled()) return fail(cancelledFailure());
    if (qualifies(posture) && arrive({posture})) return plan;
    if (blocked.status == PlanStatus::kCancelled) return fail(blocked);
  }

  std::mt19937_64 engine(config_.planner.seed + kSeedsPerCall * context_.seed);
  const std::function<double()> uniform01 = [&engine] { return static_cast<double>(engine() >> 11) * 0x1.0p-53; };
  const auto draw = [&]() -> ArmVector {
    ArmVector q;
    for (int i = 0; i < 6; ++i) {  // within half a turn of the start: more is the same posture
      const double lower = std::max(arm_.limits().lower_rad[i], context_.start_rad[i] - kPi);
      const double upper = std::min(arm_.limits().upper_rad[i], context_.start_rad[i] + kPi);
      q[i] = lower + (upper - lower) * uniform01();
    }
    return q;
  };
  const auto draw_level = tilt ? tiltSampler(*tilt, {context_.start_rad}) : nullptr;
  std::vector<ArmVector> found;
  for (int n = 0; n < config_.inspect_samples && found.size() < kInspectPostures; ++n) {
    if (isCancelled()) return fail(cancelledFailure());
    const ArmVector q = tilt ? draw_level(uniform01) : draw();
    if (qualifies(q)) found.push_back(q);
  }
  if (!found.empty()) {
    std::stable_sort(found.begin(), found.end(), [&](const ArmVector& one, const ArmVector& other) {
      return (one - context_.start_rad).squaredNorm() < (other - context_.start_rad).squaredNorm();
    });
    found.resize(std::min(found.size(), static_cast<std::size_t>(config_.max_goals)));
    if (arrive(found)) return plan;
    return fail(blocked);
  }
  if (blocked.status != PlanStatus::kSuccess) return fail(blocked);
  const std::string tried = std::to_string(postures.size()) + " postures given and " +
                            std::to_string(config_.inspect_samples) + " drawn: " + std::to_string(in_view) +
                            " in the camera's view";
  if (rejections.empty()) return fail(failure(PlanStatus::kConstraint, tried + ", the others beyond limits or tilt"));
  return fail(failure(rejections.status(), tried + ", " + rejections.describe()));
}

/// Joint angles for each grip from `first_grip` on, best first.
std::vector<MotionPlanner::Call::Candidate> MotionPlanner::Call::candidatesFor(std::vector<Grip>* grips,
                                                                               std::size_t first_grip) const {
  std::vector<Candidate> candidates;
  for (std::size_t grip = first_grip; grip < grips->size(); ++grip) {
    for (const ArmVector& q : arm_.inverse((*grips)[grip].T_base_contact, context_.start_rad)) {
      const double way_s = (q - context_.start_rad).cwiseAbs().cwiseQuotient(limits_.velocity_rad_s).maxCoeff();
      const bool is_dexterous = arm_.manipulability(q) >= planner_.sectors_.config.min_manipulability_m3;
      candidates.push_back({grip, q, is_dexterous, way_s});
    }
  }
  std::stable_sort(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) {
    return a.is_dexterous != b.is_dexterous ? a.is_dexterous : a.way_s < b.way_s;
  });
  return candidates;
}

const MotionPlanner::Call::Goals& MotionPlanner::Call::stowGoals(Grip* grip, const std::vector<ArmGoal>& stow_goals,
                                                                 const ArmVector& near) const {
  if (grip->stow) return *grip->stow;
  for (const ArmGoal& goal : stow_goals) {
    grip->stow_tilt = goal.keep_level ? Tilt(grip->tilt) : std::nullopt;
    grip->stow = findGoals(goal, near, *carrying_, grip->held, grip->stow_tilt);
    if (grip->stow->status == PlanStatus::kSuccess || grip->stow->status == PlanStatus::kCancelled) break;
  }
  return *grip->stow;
}

/// The brick into the hand of those that lift and carry it: as it is, smaller, and with room about it.
void MotionPlanner::Call::hold(std::size_t grip, const HeldBrick& held) {
  if (holding_grip_ == grip) return;
  lifting_->setHeld(held);
  carrying_->setHeld(held, false);
  HeldBrick with_room = held;
  with_room.size_m.array() += 2.0 * config_.lift_room_m;
  roomy_->setHeld(with_room, false);
  holding_grip_ = grip;
}

/// Whether a candidate can touch the face and take the brick away from it; cheap tests first.
std::optional<MotionPlanner::Call::Pick> MotionPlanner::Call::examine(const Candidate& candidate,
                                                                      const std::vector<ArmGoal>& stow_goals,
                                                                      const std::vector<Eigen::Vector3d>& lifts_base,
                                                                      std::vector<Grip>* grips, Rejections* contacts,
                                                                      FaceOutcome* worst) {
  Grip& grip = (*grips)[candidate.grip];
  const auto note = [worst](Stage stage, PlanStatus status, const std::string& message) {
    if (stage < worst->stage) return;
    static_cast<PlanFailure&>(*worst) = failure(status, message);
    worst->stage = stage;
  };
  if (const Contact contact = touching_->check(candidate.contact)) {
    contacts->add(contact);
    return std::nullopt;
  }
  const Eigen::Vector3d back_base = -grip.T_base_contact.linear().col(2);
  // Neighbours share what blocks them: looking at the far end and the middle first finds it sooner.
  const auto firstContact = [](const CollisionChecker& checker, const JointPath& line) -> Contact {
    std::size_t stride = 1;
    while (stride < line.size()) stride *= 2;
    if (const Contact contact = checker.check(line.back())) return contact;
    for (; stride > 1; stride /= 2) {
      for (std::size_t k = stride / 2; k < line.size(); k += stride) {
        if (const Contact contact = checker.check(line[k])) return contact;
      }
    }
    return {};
  };
  JointPath approach = followLine(candidate.contact, grip.T_base_contact, config_.approach_m * back_base);
  if (approach.size() <= numSteps(config_.approach_m)) {
    note(kLineStage, PlanStatus::kApproachBlocked, "the arm cannot follow the straight approach in one posture");
    return std::nullopt;
  }
  // Before the face the magnet has nothing to do with the target yet.
  Contact contact = checker_->check(approach.back());
  if (!contact) contact = firstContact(*touching_, approach);
  if (contact) {
    note(kLineStage, PlanStatus::kApproachBlocked, "on the straight approach: " + contact.describe());
    return std::nullopt;
  }
  // On to where the plate may still be: whoever moves the arm stops at the contact. Where the arm reaches no farther than
  // where the plate is believed to be, a plate a millimetre behind it is never met.
  const JointPath beyond = followLine(candidate.contact, grip.T_base_contact, -config_.overtravel_m * back_base);
  if (config_.overtravel_m > 0.0) {
    if (beyond.size() <= numSteps(config_.overtravel_m)) {
      note(kLineStage, PlanStatus::kApproachBlocked, "the arm cannot follow the touch on beyond the plate");
      return std::nullopt;
    }
    contact = firstContact(*touching_, beyond);
    if (contact) {
      note(kLineStage, PlanStatus::kApproachBlocked, "beyond the plate: " + contact.describe());
      return std::nullopt;
    }
  }
  // Among its neighbours the brick may touch what it lies on and beside. The lift ends where it has room to all sides, for
  // the search that carries it away; where it never has, as high as all of it is at least clear of them.
  hold(candidate.grip, grip.held);
  std::optional<JointPath> lift;
  for (const Eigen::Vector3d& way_base : lifts_base) {
    JointPath line = followLine(candidate.contact, grip.T_base_contact, way_base);
    const std::size_t shortest = numSteps(config_.min_lift_m);
    if (line.size() <= shortest) {
      note(kLineStage, PlanStatus::kApproachBlocked, "the arm cannot follow the straight lift in one posture");
      continue;
    }
    std::size_t end = shortest;
    while (end < line.size() && !roomy_->isFree(line[end])) ++end;
    contact = {};
    Contact highest;  // what is in the way there, below it is the pile
    if (end == line.size()) {
      do {
        contact = carrying_->check(line[--end]);
        if (end + 1 == line.size()) highest = contact;
      } while (contact && end > shortest);
    }
    if (contact) {
      note(kLineStage, PlanStatus::kApproachBlocked,
           "at the end of the lift, " +
               std::to_string(std::lround(1000.0 * config_.cartesian_step_m * static_cast<double>(line.size() - 1))) +
               " mm on: " + highest.describe());
      continue;
    }
    line.resize(end + 1);
    contact = lifting_->check(line.front());
    if (!contact) contact = firstContact(*lifting_, line);
    if (!contact) {
      lift = std::move(line);
      break;
    }
    note(kLineStage, PlanStatus::kApproachBlocked, "on the straight lift: " + contact.describe());
  }
  if (!lift) return std::nullopt;
  const Goals& stow = stowGoals(&grip, stow_goals, lift->back());
  if (stow.status != PlanStatus::kSuccess) {
    note(kStowGoalStage, stow.status, "carrying the brick away: " + stow.message);
    return std::nullopt;
  }
  std::reverse(approach.begin(), approach.end());
  if (config_.overtravel_m > 0.0) approach.insert(approach.end(), std::next(beyond.begin()), beyond.end());
  return Pick{candidate.grip, std::move(approach), std::move(*lift)};
}

MotionPlanner::Call::FaceOutcome MotionPlanner::Call::planFace(const PickTarget& target, BrickFace face,
                                                               const std::vector<ArmGoal>& stow_goals, PickPlan* plan) {
  FaceOutcome outcome;
  const auto fail = [&outcome](Stage stage, PlanStatus status, const std::string& message) {
    static_cast<PlanFailure&>(outcome) = failure(status, message);
    outcome.stage = stage;
    return outcome;
  };
  const std::string name =
      std::string("face ") + description::toString(face) + " of brick " + std::to_string(target.brick_id);
  const auto& plates = target.type->plate_faces;
  if (std::find(plates.begin(), plates.end(), face) == plates.end()) {
    return fail(kFaceStage, PlanStatus::kBadRequest, name + " has no steel plate");
  }
  // The face's frame is its tag's: in its middle, z out of it.
  const Eigen::Isometry3d T_base_face = T_base_map_ * target.T_map_brick * description::tagPose(*target.type, face);
  const Eigen::Vector3d normal_base = T_base_face.linear().col(2);
  const Eigen::Isometry3d T_base_armbase =
      arm_.robot().framePose(description::kArmBaseFrame, arm_.robotPositions(ArmVector::Zero()));

  const double room_m = 0.5 * target.type->plate_edge_m - config_.magnet_radius_m - config_.plate_margin_m;
  if (room_m < 0.0) {
    return fail(kFaceStage, PlanStatus::kBadRequest,
                name + ": the magnet does not fit on its plate of " + std::to_string(target.type->plate_edge_m) + " m");
  }
  // Middle first, then rings about it.
  const int rings = static_cast<int>(std::floor(room_m / config_.contact_grid_m + 1e-9));
  std::vector<Eigen::Vector2d> offsets;
  for (int x = -rings; x <= rings; ++x) {
    for (int y = -rings; y <= rings; ++y) offsets.push_back(config_.contact_grid_m * Eigen::Vector2d(x, y));
  }
  std::stable_sort(offsets.begin(), offsets.end(), [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return a.squaredNorm() < b.squaredNorm();
  });
  std::string why_not;
  std::vector<Eigen::Vector3d> points_face;
  for (const Eigen::Vector2d& offset : offsets) {
    const Eigen::Vector3d p_face(offset.x(), offset.y(), 0.0);
    std::string why;
    if (planner_.sectors_.admits(T_base_face * p_face, normal_base, T_base_armbase, &why)) {
      points_face.push_back(p_face);
    } else if (why_not.empty()) {
      why_not = why;
    }
  }
  if (points_face.empty()) return fail(kSectorStage, PlanStatus::kOutsideSector, name + ": " + why_not);

  // A brick that is taken by its side is lifted off what it lies on, not dragged over it.
  std::vector<Eigen::Vector3d> lifts_base = {config_.lift_m * normal_base};
  if (normal_base.z() < std::cos(0.25 * kPi)) {
    const Eigen::Vector3d up_and_back = (normal_base + Eigen::Vector3d::UnitZ()).normalized();
    lifts_base = {config_.lift_m * up_and_back, config_.lift_m * Eigen::Vector3d::UnitZ(),
                  config_.lift_m * normal_base};
  }

  std::vector<Grip> grips;
  holding_grip_.reset();  // of another face
  std::vector<Pick> picks;
  Rejections contacts;
  FaceOutcome worst;
  std::size_t postures = 0;
  // The middle alone first: mostly it does, and the brick hangs best from it.
  for (std::size_t from = 0; from < points_face.size() && picks.empty(); from = from == 0 ? 1 : points_face.size()) {
    const std::size_t to = from == 0 ? 1 : points_face.size();
    const std::size_t first_grip = grips.size();
    for (std::size_t i = from; i < to; ++i) {
      for (int k = 0; k < config_.yaw_samples; ++k) {
        Grip grip;
        grip.T_base_contact = T_base_face * Eigen::Translation3d(points_face[i]);
        grip.T_base_contact.linear() *= aboutZ(2.0 * kPi * k / config_.yaw_samples) *
                                        Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitX()).toRotationMatrix();
        grip.held.T_tip_brick = grip.T_base_contact.inverse() * T_base_map_ * target.T_map_brick;
        grip.held.size_m = target.type->size_m;
        grip.tilt.up_tip = grip.T_base_contact.linear().transpose() * Eigen::Vector3d::UnitZ();
        grip.tilt.max_tilt_rad = config_.max_tilt_rad;
        grips.push_back(grip);
      }
    }
    const std::vector<Candidate> candidates = candidatesFor(&grips, first_grip);
    postures += candidates.size();
    for (const Candidate& candidate : candidates) {
      if (isCancelled()) return fail(kStowStage, PlanStatus::kCancelled, cancelledFailure().message);
      if (auto pick = examine(candidate, stow_goals, lifts_base, &grips, &contacts, &worst)) {
        picks.push_back(std::move(*pick));
        if (picks.size() >= static_cast<std::size_t>(config_.max_goals)) break;
      }
    }
  }
  if (postures == 0) {
    return fail(kIkStage, PlanStatus::kNoIk,
                name + ": no joint angles reach it at " + text(context_.T_map_base * T_base_face.translation()) + " (" +
                    std::to_string(grips.size()) + " poses tried)");
  }
  if (picks.empty()) {
    const std::string tried = name + ": of " + std::to_string(postures) + " postures that touch it ";
    if (worst.stage == kFaceStage) return fail(kContactStage, contacts.status(), tried + contacts.describe());
    return fail(worst.stage, worst.status,
                name + ": " + worst.message + (contacts.empty() ? "" : "; at the face " + contacts.describe()));
  }

  for (int attempt = 0; attempt < kStowAttempts && !picks.empty(); ++attempt) {
    std::vector<ArmVector> before_face;
    for (const Pick& pick : picks) before_face.push_back(pick.contact.front());
    const Motion approach =
        moveTo(context_.start_rad, before_face, *checker_, std::nullopt, std::nullopt, name + ", approach");
    if (approach.status != PlanStatus::kSuccess) {
      return attempt == 0 ? fail(kApproachStage, approach.status, approach.message) : outcome;
    }
    const Pick pick = picks[approach.goal];
    const Grip& grip = grips[pick.grip];
    hold(pick.grip, grip.held);
    const Motion stow = moveTo(pick.lift.back(), grip.stow->postures, *carrying_, grip.held, grip.stow_tilt,
                               name + ", carrying the brick away");
    if (stow.status == PlanStatus::kSuccess) {
      plan->face = face;
      plan->T_map_contact = context_.T_map_base * grip.T_base_contact;
      plan->held = grip.held;
      plan->approach = approach.trajectory;
      plan->contact = timedLine(pick.contact, config_.contact_speed_m_s);
      plan->lift = timedLine(pick.lift, config_.lift_speed_m_s);
      plan->stow = stow.trajectory;
      return {};
    }
    fail(kStowStage, stow.status, stow.message);
    if (stow.status == PlanStatus::kCancelled) return outcome;
    // Another grip: what blocks this one blocks its other postures too.
    picks.erase(std::remove_if(picks.begin(), picks.end(), [&](const Pick& other) { return other.grip == pick.grip; }),
                picks.end());
  }
  return outcome;
}

PickPlan MotionPlanner::Call::planPick(const PickTarget& target, const std::vector<ArmGoal>& stow_goals) {
  PickPlan plan;
  const auto fail = [&plan](const PlanFailure& why) {
    static_cast<PlanFailure&>(plan) = why;
    return plan;
  };
  if (context_.held) return fail(failure(PlanStatus::kBadRequest, "the magnet holds a brick already"));
  if (target.type == nullptr) return fail(failure(PlanStatus::kBadRequest, "the brick's type is not known"));
  if (target.faces.empty()) return fail(failure(PlanStatus::kBadRequest, "no face to try"));
  if (target.faces.size() > static_cast<std::size_t>(description::kNumBrickFaces)) {
    return fail(failure(PlanStatus::kBadRequest, std::to_string(target.faces.size()) +
                                                     " faces to try, must be at most " +
                                                     std::to_string(description::kNumBrickFaces)));
  }
  for (auto face = target.faces.begin(); face != target.faces.end(); ++face) {
    if (std::find(target.faces.begin(), face, *face) == face) continue;
    return fail(failure(PlanStatus::kBadRequest, std::string("face ") + description::toString(*face) +
                                                     " is given twice, must be once: what fails once fails again"));
  }
  if (!isRigid(target.T_map_brick)) {
    return fail(failure(PlanStatus::kBadRequest, "pose of the brick is not a finite rigid transform"));
  }
  if (stow_goals.empty()) return fail(failure(PlanStatus::kBadRequest, "no goal to carry the brick to"));

  const OrientedBox box{target.T_map_brick, target.type->size_m};
  touching_.emplace(*checker_);
  touching_->setTarget(box);
  lifting_.emplace(*touching_);
  carrying_.emplace(*checker_);
  carrying_->setTarget(box, true);
  roomy_.emplace(*carrying_);
  int farthest = -1;
  for (const BrickFace face : target.faces) {
    const FaceOutcome outcome = planFace(target, face, stow_goals, &plan);
    if (outcome.status == PlanStatus::kSuccess) return fail({});
    plan.tried.emplace_back(face, outcome);
    if (outcome.status == PlanStatus::kCancelled) return fail(outcome);
    if (static_cast<int>(outcome.stage) > farthest) {
      farthest = outcome.stage;
      plan.face = face;
      fail(outcome);
    }
  }
  return plan;
}

MotionPlanner::MotionPlanner(std::shared_ptr<const ArmKinematics> arm, ManipulabilitySectors sectors,
                             const MotionPlannerConfig& config)
    : arm_(std::move(arm)), sectors_(std::move(sectors)), config_(config) {
  if (!arm_) throw std::invalid_argument("no arm");
  gpis_mapping::throwIfAny(config.validate());
}

PickPlan MotionPlanner::planPick(const PlanningContext& context, const PickTarget& target,
                                 const std::vector<ArmGoal>& stow_goals) const {
  Call call(*this, context);
  PlanFailure why = call.begin();
  if (why.status == PlanStatus::kSuccess && call.isBackedOff()) {
    why = failure(PlanStatus::kStartInCollision,
                  "the arm's start is in collision: the magnet is at a face; plan a way out of there first");
  }
  if (why.status == PlanStatus::kSuccess) return call.planPick(target, stow_goals);
  PickPlan plan;
  static_cast<PlanFailure&>(plan) = why;
  return plan;
}

ArmPlan MotionPlanner::planArm(const PlanningContext& context, const ArmGoal& goal) const {
  Call call(*this, context);
  const PlanFailure why = call.begin();
  if (why.status == PlanStatus::kSuccess) return call.fromStart(call.planArm(goal));
  ArmPlan plan;
  static_cast<PlanFailure&>(plan) = why;
  return plan;
}

ArmPlan MotionPlanner::planInspect(const PlanningContext& context, const ViewFrustum& view,
                                   const std::vector<ArmVector>& postures) const {
  Call call(*this, context);
  const PlanFailure why = call.begin();
  if (why.status == PlanStatus::kSuccess) return call.fromStart(call.planInspect(view, postures));
  ArmPlan plan;
  static_cast<PlanFailure&>(plan) = why;
  return plan;
}

}  // namespace motion_planning
