// SPDX-License-Identifier: BSD-3-Clause
#include "planning_problems/plan_judge.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <sstream>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>
#include <mp700_ur5e_description/robot_names.h>

#include "planning_problems/exact_checker.h"
#include "simulated_world/world_observation.h"

namespace experiments {
namespace {

using motion_planning::ArmVector;
using motion_planning::JointTrajectory;

constexpr double kSame_rad = 1e-6;  // trajectories that follow one another meet within this

std::string text(const std::string& phase, const std::string& what, double value, const std::string& unit,
                 double limit) {
  std::ostringstream line;
  line << phase << ": " << what << " = " << value << " " << unit << ", allowed " << limit << " " << unit;
  return line.str();
}

/// Calls `look` at times so near to each other that no joint moves more than `step_rad` between.
void follow(const JointTrajectory& trajectory, double step_rad,
            const std::function<void(double, const ArmVector&)>& look) {
  const auto& points = trajectory.points;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const double dt_s = points[i + 1].time_s - points[i].time_s;
    // A cubic between the points may swing: its way is at most what the faster end's speed gives, or the chord.
    const double speed =
        std::max(points[i].velocity_rad_s.cwiseAbs().maxCoeff(), points[i + 1].velocity_rad_s.cwiseAbs().maxCoeff());
    const double way_rad =
        std::max(speed * dt_s, (points[i + 1].position_rad - points[i].position_rad).cwiseAbs().maxCoeff());
    const int pieces = std::max(1, static_cast<int>(std::ceil(way_rad / step_rad)));
    for (int k = 0; k < pieces; ++k) {
      const double t = points[i].time_s + dt_s * k / pieces;
      look(t, trajectory.sample(t).position_rad);
    }
  }
  if (!points.empty()) look(points.back().time_s, points.back().position_rad);
}

class Judge {
 public:
  Judge(const ProblemMaker& maker, const PlanningProblem& problem, const JudgeConfig& config)
      : config_(config),
        problem_(problem),
        stowed_(maker.stowed()),
        robot_(maker.robot()),
        checker_(robot_, problem.stand->bricks, problem.stand->T_map_base) {
    verdict_.clearance_m = config.clearance_limit_m;
  }

  void collide(const std::string& phase, double time_s, const Overlap& overlap) {
    for (Collision& known : verdict_.collisions) {
      if (known.phase == phase && known.first == overlap.first && known.second == overlap.second) {
        known.depth_m = std::max(known.depth_m, overlap.depth_m);
        return;
      }
    }
    verdict_.collisions.push_back({phase, overlap.first, overlap.second, overlap.depth_m, time_s});
  }

  /// Overlaps at a posture, but for those that `is_allowed` lets pass.
  void look(const std::string& phase, double time_s, const ArmVector& q,
            const std::function<bool(const Overlap&)>& is_allowed) {
    ++verdict_.looks;
    for (const Overlap& overlap : checker_.overlaps(q)) {
      const bool is_measured = overlap.brick_id >= 0 || overlap.second == "ground";
      if (is_measured && overlap.depth_m < config_.touch_m) continue;
      if (!is_allowed(overlap)) collide(phase, time_s, overlap);
    }
  }

  void measureClearance(const ArmVector& q) {
    verdict_.clearance_m = std::min(verdict_.clearance_m, checker_.clearance(q, verdict_.clearance_m));
  }

  void fault(const std::string& complaint) { verdict_.faults.push_back(complaint); }

  /// Times rise, the ends are at rest, speed and acceleration keep their limits as the controller interpolates: by finite
  /// differences of positions, whatever the points say of velocity.
  void judgeTiming(const std::string& phase, const JointTrajectory& trajectory, const ArmVector& velocity_limit,
                   double acceleration_limit) {
    if (trajectory.empty()) {
      fault(phase + ": empty");
      return;
    }
    verdict_.duration_s += trajectory.duration();
    for (std::size_t i = 1; i < trajectory.points.size(); ++i) {
      if (!(trajectory.points[i].time_s > trajectory.points[i - 1].time_s)) fault(phase + ": times do not rise");
    }
    constexpr double kRest_rad_s = 1e-6;
    for (const auto* end : {&trajectory.points.front(), &trajectory.points.back()}) {
      const double speed = end->velocity_rad_s.cwiseAbs().maxCoeff();
      if (!(speed <= kRest_rad_s)) fault(text(phase, "speed at an end", speed, "rad/s", kRest_rad_s));
    }
    double speed_share = 0.0;
    double acceleration_share = 0.0;
    constexpr double kStep_s = 0.002;  // 1e-15 rad of rounding is 1e-9 rad/s^2
    for (double t = 0.0; t < trajectory.duration(); t += kStep_s) {
      const ArmVector before = trajectory.sample(t - kStep_s).position_rad;
      const ArmVector now = trajectory.sample(t).position_rad;
      const ArmVector after = trajectory.sample(t + kStep_s).position_rad;
      speed_share =
          std::max(speed_share, ((after - now) / kStep_s).cwiseAbs().cwiseQuotient(velocity_limit).maxCoeff());
      acceleration_share =
          std::max(acceleration_share,
                   ((after - 2.0 * now + before) / (kStep_s * kStep_s)).cwiseAbs().maxCoeff() / acceleration_limit);
    }
    verdict_.max_speed_share = std::max(verdict_.max_speed_share, speed_share);
    verdict_.max_acceleration_share = std::max(verdict_.max_acceleration_share, acceleration_share);
    // A mean over 2 ms of what keeps a limit keeps it; a thousandth for the differences' rounding.
    constexpr double kShare = 1.001;
    if (!(speed_share <= kShare)) fault(text(phase, "speed", speed_share, "of the limit", 1.0));
    if (!(acceleration_share <= kShare)) fault(text(phase, "acceleration", acceleration_share, "of the limit", 1.0));
  }

  void judgeMeeting(const std::string& phase, const ArmVector& end, const JointTrajectory& next) {
    if (next.empty()) return;
    const double gap_rad = (next.points.front().position_rad - end).cwiseAbs().maxCoeff();
    if (!(gap_rad < kSame_rad)) fault(text(phase, "jump at its start", gap_rad, "rad", kSame_rad));
  }

  void addWay(const JointTrajectory& trajectory) {
    for (std::size_t i = 1; i < trajectory.points.size(); ++i) {
      verdict_.path_rad += (trajectory.points[i].position_rad - trajectory.points[i - 1].position_rad).norm();
    }
  }

  void judgePick(const motion_planning::PickPlan& plan, const motion_planning::MotionPlannerConfig& planner,
                 const motion_planning::ArmGoal& place) {
    ArmVector velocity_limit;
    for (int i = 0; i < 6; ++i) {
      const auto& joint =
          robot_->joints()[robot_->jointIndex(mp700_ur5e_description::kArmJoints[static_cast<std::size_t>(i)])];
      velocity_limit[i] = planner.speed.velocity_scale * joint.velocity_rad_s;
    }
    const std::pair<const char*, const JointTrajectory*> phases[] = {
        {"approach", &plan.approach}, {"contact", &plan.contact}, {"lift", &plan.lift}, {"stow", &plan.stow}};
    ArmVector end = stowed_;
    for (const auto& [phase, trajectory] : phases) {
      judgeTiming(phase, *trajectory, velocity_limit, planner.speed.acceleration_rad_s2);
      judgeMeeting(phase, end, *trajectory);
      if (!trajectory->empty()) end = trajectory->points.back().position_rad;
    }
    if (plan.approach.empty() || plan.contact.empty() || plan.lift.empty() || plan.stow.empty()) return;
    addWay(plan.approach);
    addWay(plan.stow);

    const auto never = [](const Overlap&) { return false; };
    follow(plan.approach, config_.step_rad, [&](double t, const ArmVector& q) { look("approach", t, q, never); });
    follow(plan.approach, kClearanceSteps * config_.step_rad, [&](double, const ArmVector& q) { measureClearance(q); });
    judgeContact(plan);

    const Eigen::Isometry3d T_base_brick = problem_.stand->T_map_base.inverse() * problem_.target.T_map_brick;
    const ArmVector contact_rad = plan.contact.points.back().position_rad;
    const Eigen::Isometry3d T_tip_brick = checker_.tipInBase(contact_rad).inverse() * T_base_brick;
    checker_.hold(problem_.target.brick_id, T_tip_brick);
    follow(plan.lift, config_.step_rad, [&](double t, const ArmVector& q) {
      look("lift", t, q, [&](const Overlap& overlap) {
        if (overlap.first != "held" || (overlap.brick_id < 0 && overlap.second != "ground")) return false;
        verdict_.lift_overlap_m = std::max(verdict_.lift_overlap_m, overlap.depth_m);
        return overlap.depth_m < config_.lift_m;
      });
    });
    follow(plan.stow, config_.step_rad, [&](double t, const ArmVector& q) { look("stow", t, q, never); });
    follow(plan.stow, kClearanceSteps * config_.step_rad, [&](double, const ArmVector& q) { measureClearance(q); });
    judgeCarrying(plan, planner, T_base_brick, place);
  }

  void judgeReach(const motion_planning::JointPath& path) {
    const auto isMagnetOnTarget = [&](const Overlap& overlap) {
      return overlap.first == mp700_ur5e_description::kMagnetLink && overlap.brick_id == problem_.target.brick_id &&
             overlap.depth_m < config_.contact_m;
    };
    for (std::size_t i = 0; i + 1 < path.size(); ++i) {
      const ArmVector way = path[i + 1] - path[i];
      verdict_.path_rad += way.norm();
      const int pieces = std::max(1, static_cast<int>(std::ceil(way.cwiseAbs().maxCoeff() / config_.step_rad)));
      for (int k = 0; k < pieces + (i + 2 == path.size() ? 1 : 0); ++k) {
        const ArmVector q = path[i] + way * (static_cast<double>(k) / pieces);
        look("reach", 0.0, q, isMagnetOnTarget);
        if (k % kClearanceSteps == 0) {
          verdict_.clearance_m =
              std::min(verdict_.clearance_m, checker_.clearance(q, verdict_.clearance_m, problem_.target.brick_id));
        }
      }
    }
  }

  const PlanVerdict& verdict() const { return verdict_; }

 private:
  static constexpr int kClearanceSteps = 5;  // clearance changes slowly: by 1.75 mm at 0.1 m from the axis

  void judgeContact(const motion_planning::PickPlan& plan) {
    const Eigen::Isometry3d T_base_brick = problem_.stand->T_map_base.inverse() * problem_.target.T_map_brick;
    const Eigen::Isometry3d T_brick_end =
        T_base_brick.inverse() * checker_.tipInBase(plan.contact.points.back().position_rad);
    follow(plan.contact, config_.step_rad, [&](double t, const ArmVector& q) {
      const double to_go_m =
          ((T_base_brick.inverse() * checker_.tipInBase(q)).translation() - T_brick_end.translation()).norm();
      look("contact", t, q, [&](const Overlap& overlap) {
        return overlap.first == mp700_ur5e_description::kMagnetLink && overlap.brick_id == problem_.target.brick_id &&
               overlap.depth_m < config_.contact_m && to_go_m < config_.contact_end_m;
      });
    });
    // Plate on plate: where the tip is on the face that the plan names, and how it stands on it.
    const Eigen::Vector3d normal = mp700_ur5e_description::faceNormal(plan.face);
    const Eigen::Vector3d p = T_brick_end.translation();
    const Eigen::Vector3d size_m = problem_.target.type->size_m;
    verdict_.contact_error_m = std::abs(normal.dot(p) - 0.5 * normal.cwiseAbs().dot(size_m));
    if (!(verdict_.contact_error_m < config_.contact_m)) {
      fault(text("contact", "tip to face", verdict_.contact_error_m, "m", config_.contact_m));
    }
    constexpr double kTilt_rad = 0.01;  // the magnet's force falls to zero at 0.12
    const double tilt_rad = std::acos(std::min(1.0, -normal.dot(T_brick_end.linear().col(2))));
    if (!(tilt_rad < kTilt_rad)) fault(text("contact", "tilt on the face", tilt_rad, "rad", kTilt_rad));
    const double aside_m = (p - normal * normal.dot(p)).cwiseAbs().maxCoeff() + kMagnetRadius_m;
    const double edge_m = 0.5 * problem_.target.type->plate_edge_m;
    if (!(aside_m < edge_m)) fault(text("contact", "magnet's edge from the plate's middle", aside_m, "m", edge_m));
  }

  void judgeCarrying(const motion_planning::PickPlan& plan, const motion_planning::MotionPlannerConfig& planner,
                     const Eigen::Isometry3d& T_base_brick, const motion_planning::ArmGoal& place) {
    const Eigen::Vector3d up_brick = T_base_brick.linear().transpose() * Eigen::Vector3d::UnitZ();
    double tilt_rad = 0.0;
    follow(plan.stow, config_.step_rad, [&](double, const ArmVector& q) {
      tilt_rad = std::max(tilt_rad, std::acos(std::min(1.0, (checker_.heldPose(q).linear() * up_brick).z())));
    });
    // Planned states keep the limit; rounded corners between them may cut through it by a little.
    constexpr double kSlack_rad = 0.02;
    if (place.keep_level && !(tilt_rad < planner.pick.max_tilt_rad + kSlack_rad)) {
      fault(text("stow", "tilt", tilt_rad, "rad", planner.pick.max_tilt_rad));
    }
    if (!place.place) return;
    const Eigen::Isometry3d T_opening_brick =
        place.place->T_base_place.inverse() * checker_.heldPose(plan.stow.points.back().position_rad);
    const Eigen::Vector3d half_m =
        T_opening_brick.linear().cwiseAbs() * (0.5 * problem_.target.type->size_m);  // of its axis-aligned hull
    constexpr double kAbove_m = 0.002;
    const double above_m = T_opening_brick.translation().z() - half_m.z();
    if (!(above_m > place.place->above_m - kAbove_m))
      fault(text("stow", "height over the opening", above_m, "m", place.place->above_m));
    // A place of the URDF has 2 cm of air round a brick of 0.30 m x 0.20 m: 1 cm to its neighbour's air.
    const Eigen::Vector2d place_m(0.16, 0.11);
    const Eigen::Vector2d out_m = T_opening_brick.translation().head<2>().cwiseAbs() + half_m.head<2>() - place_m;
    if (!(out_m.maxCoeff() < 0.0)) fault(text("stow", "edge beside its place", out_m.maxCoeff(), "m", 0.0));
  }

  static constexpr double kMagnetRadius_m = 0.03;  // of the URDF

  JudgeConfig config_;
  const PlanningProblem& problem_;
  ArmVector stowed_;
  std::shared_ptr<const mp700_ur5e_description::RobotModel> robot_;
  ExactChecker checker_;
  PlanVerdict verdict_;
};

}  // namespace

std::vector<std::string> JudgeConfig::validate() const {
  interactive_mapping::RangeCheck check("judge/");
  check("step_rad", step_rad, 1e-5, 0.1, "rad");
  check("touch_m", touch_m, 0.0002, 0.01, "m");
  check("contact_m", contact_m, 0.0, 0.01, "m");
  check("contact_end_m", contact_end_m, 0.0, 0.05, "m");
  check("lift_m", lift_m, 0.0, 0.05, "m");
  check("clearance_limit_m", clearance_limit_m, 0.001, 1.0, "m");
  return check.problems();
}

std::string PlanVerdict::describe() const {
  std::ostringstream out;
  for (const Collision& collision : collisions) {
    out << collision.phase << ": " << collision.first << " in " << collision.second << ", " << 1e3 * collision.depth_m
        << " mm deep, from " << collision.time_s << " s on\n";
  }
  for (const std::string& fault : faults) out << fault << '\n';
  return out.str();
}

PlanVerdict judgePick(const ProblemMaker& maker, const PlanningProblem& problem, const motion_planning::PickPlan& plan,
                      const motion_planning::MotionPlannerConfig& planner, const JudgeConfig& config) {
  interactive_mapping::refuseIfAny("impossible judge:", config.validate());
  Judge judge(maker, problem, config);
  judge.judgePick(plan, planner, maker.containerGoal());
  return judge.verdict();
}

PlanVerdict judgeReach(const ProblemMaker& maker, const PlanningProblem& problem,
                       const motion_planning::JointPath& path, const JudgeConfig& config) {
  interactive_mapping::refuseIfAny("impossible judge:", config.validate());
  Judge judge(maker, problem, config);
  judge.judgeReach(path);
  return judge.verdict();
}

}  // namespace experiments
