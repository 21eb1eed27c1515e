// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <motion_planning/motion_planner.h>

#include "planning_problems/planning_problems.h"

namespace experiments {

struct JudgeConfig {
  double step_rad{0.0035};  // between looks, in the joint that moves most: a tenth of the planner's 0.035
  /// Two solids that are less deep in one another just touch: bisection to 0.1 mm, twice.
  double touch_m{0.0002};
  /// How deep the magnet may be in the target on the way to the plate: rounding of the trajectory's points to what the
  /// controller interpolates; MuJoCo's contacts and real plates give way by more.
  double contact_m{0.001};
  /// The magnet touches the target no earlier than this before the end of the straight way, and is on it at the end.
  double contact_end_m{0.002};
  /// A brick at rest is inside of what carries it by what contacts give way, some tenths of a millimetre; and one that is
  /// pulled off along a face that is not quite upright comes nearer to its neighbours. More than this is a push.
  double lift_m{0.005};
  double clearance_limit_m{0.10};  // up to which clearance is measured

  std::vector<std::string> validate() const;
};

/// A thing that went through another, once for each pair of bodies and phase.
struct Collision {
  std::string phase;  // approach, contact, lift, stow
  std::string first;
  std::string second;
  double depth_m;  // the deepest
  double time_s;   // when it began, in its phase
};

struct PlanVerdict {
  std::vector<Collision> collisions;
  std::vector<std::string> faults;  // other things that must not be: limits, gaps between phases, place of contact ...
  double clearance_m{0.0};          // smallest distance to any brick in approach and stow
  double lift_overlap_m{0.0};       // deepest overlap of the held brick with others and the ground in the lift
  double contact_error_m{0.0};      // distance of tip and plate at the end of contact, along the face's normal
  double max_speed_share{0.0};      // of the limits, over all joints and phases
  double max_acceleration_share{0.0};
  double path_rad{0.0};  // sum over approach and stow of the joints' Euclidean way
  double duration_s{0.0};
  std::size_t looks{0};

  bool isGood() const { return collisions.empty() && faults.empty(); }
  std::string describe() const;  // a line per complaint
};

/// Follows all four trajectories of a pick as the arm's controller would, and looks at the exact scene on the way.
PlanVerdict judgePick(const ProblemMaker& maker, const PlanningProblem& problem, const motion_planning::PickPlan& plan,
                      const motion_planning::MotionPlannerConfig& planner, const JudgeConfig& config = {});

/// Collisions and clearance of one joint path alone, that ends at the target with the magnet: what a planner without
/// phases is judged by. The magnet may touch the target.
PlanVerdict judgeReach(const ProblemMaker& maker, const PlanningProblem& problem,
                       const motion_planning::JointPath& path, const JudgeConfig& config = {});

}  // namespace experiments
