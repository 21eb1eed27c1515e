// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "tasks/brick_in_scene.h"
#include "tasks/carry_tilt.h"

/// The stages of a pick by one face, in the order in which pick_task.cpp goes through them.
namespace motion_planning {

/// How the magnet holds the brick.
struct Grip {
  Eigen::Isometry3d T_base_contact;  // of the tip on the plate, z against the face's normal
  HeldBrick held;
  TiltConstraint tilt;  // while carrying it
};

/// A posture of the arm at a grip.
struct ContactPosture {
  std::size_t grip;  // its index
  ArmVector joints_rad;
  bool is_dexterous;  // manipulability above the sectors' threshold
  double way_s;       // from the start, every joint at its limit
};

/// "face +z of brick 3"
std::string nameOf(const PickTarget& target, mp700_ur5e_description::BrickFace face);
/// T_base_face. The face's frame is its tag's: in its middle, z out of it.
Eigen::Isometry3d facePose(const TaskContext& task, const PickTarget& target, mp700_ur5e_description::BrickFace face);

/// Points on the face's plate [m, face's frame] that the magnet may touch and the sectors admit, the middle first.
Result<std::vector<Eigen::Vector3d>> contactPoints(const TaskContext& task, const PickTarget& target,
                                                   mp700_ur5e_description::BrickFace face);

/// For each point the turns of the tool about the face's normal.
std::vector<Grip> gripsAt(const TaskContext& task, const PickTarget& target, const Eigen::Isometry3d& T_base_face,
                          const std::vector<Eigen::Vector3d>& points_face);

/// What to try for `goal`, in this order: over its place a brick that stands, or leans by more than it may tilt, is laid
/// down, if the magnet holds it at any tilt; else the edge that was nearest to upright is.
/// `up_tip`: up, in the tip's frame.
std::vector<ArmGoal> waysToStow(const TaskContext& task, const HeldBrick& held, const Eigen::Vector3d& up_tip,
                                const ArmGoal& goal);

/// Postures of the arm for each grip from `first_grip` on, best first.
std::vector<ContactPosture> contactPostures(const TaskContext& task, const std::vector<Grip>& grips,
                                            std::size_t first_grip);

/// From before the face straight to the contact posture, and on by pick/overtravel_m.
Result<JointPath> contactLine(const TaskContext& task, const BrickInScene& scene, const Grip& grip,
                              const ArmVector& contact_rad);

/// Lines to lift along [m, base_link], best first: a brick taken by its side is lifted off what it lies on, not dragged; one
/// whose top leans to a wall goes straight up where its normal does not; one at a wall or in a corner up and away.
std::vector<Eigen::Vector3d> liftOffsets(const Eigen::Vector3d& normal_base, double lift_m);

/// From the contact posture straight away with the brick, until it is clear of its neighbours. `scene` holds the brick.
Result<JointPath> liftLine(const TaskContext& task, const BrickInScene& scene, const Grip& grip,
                           const ArmVector& contact_rad, const std::vector<Eigen::Vector3d>& offsets_base);

}  // namespace motion_planning
