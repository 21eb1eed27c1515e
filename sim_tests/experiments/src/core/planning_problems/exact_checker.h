// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Geometry>
#include <motion_planning/arm_kinematics.h>
#include <motion_planning/collision_checker.h>
#include <mp700_ur5e_description/robot_model.h>

#include "planning_problems/convex_distance.h"
#include "simulated_world/pile_scene.h"

namespace experiments {

/// Two things that are inside of one another.
struct Overlap {
  std::string first;    // link of the robot, or "held"
  std::string second;   // "brick_<id>", "ground", or another link
  int brick_id{-1};     // of second
  double depth_m{0.0};  // bricks: how much smaller on each side the brick would have to be for the two to be apart;
                        // ground: how far below it; links among themselves: 0, not measured
};

/// The judge of plans: the robot's shapes, as its URDF has them, against bricks where they are. Distances of convex solids
/// by alternating projections; kinematics by RobotModel. Nothing of motion_planning's collision code is used. Not
/// thread-safe.
class ExactChecker {
 public:
  ExactChecker(std::shared_ptr<const mp700_ur5e_description::RobotModel> robot,
               const std::vector<simulated_world::BrickPlacement>& bricks, const Eigen::Isometry3d& T_map_base);

  /// What the magnet holds: a brick of the list, from now on at `T_tip_brick`; it is no obstacle then.
  void hold(int brick_id, const Eigen::Isometry3d& T_tip_brick);

  /// Where the held brick is while the arm is at `joints_rad`, in base_link. Throws std::logic_error if nothing is held.
  Eigen::Isometry3d heldPose(const motion_planning::ArmVector& joints_rad);

  /// All overlaps of moving links and of what is held with bricks and ground, with links that do not hang on the same or a
  /// neighbouring joint, and with the robot's body.
  std::vector<Overlap> overlaps(const motion_planning::ArmVector& joints_rad);

  /// Distance of moving links and of what is held to the nearest brick but `except_id`, at most `limit_m`; 0: they overlap.
  double clearance(const motion_planning::ArmVector& joints_rad, double limit_m, int except_id = -1);

  Eigen::Isometry3d tipInBase(const motion_planning::ArmVector& joints_rad);

 private:
  struct Part {
    std::string link;
    std::size_t body;
    mp700_ur5e_description::Shape shape;
    Eigen::Isometry3d T_body_shape;
    double radius_m;
    bool is_moving;
    Solid solid;  // at the last posture; frame: base_link
  };
  struct Brick {
    int id;
    Eigen::Vector3d size_m;
    Solid solid;
    double radius_m;
  };

  void bend(const motion_planning::ArmVector& joints_rad);
  bool mayTouch(const Part& a, const Part& b) const;
  /// Smallest shrinkage of the brick that parts the two.
  static double depth(const Solid& part, const Brick& brick);

  std::shared_ptr<const mp700_ur5e_description::RobotModel> robot_;
  std::vector<std::size_t> arm_joints_;
  std::vector<Part> parts_;  // what is held comes last
  std::vector<std::pair<std::size_t, std::size_t>> self_pairs_;
  std::vector<Brick> bricks_;
  std::optional<int> held_id_;
  std::size_t tip_body_;
  Eigen::Isometry3d T_body_tip_;
  Eigen::VectorXd positions_;
  std::vector<Eigen::Isometry3d> T_base_body_;
};

}  // namespace experiments
