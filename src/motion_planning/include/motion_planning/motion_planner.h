// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/result.h>
#include <interactive_mapping_enums/plan_outcome.h>
#include <mp700_ur5e_description/brick_types.h>

#include "motion_planning/collision_checker.h"
#include "motion_planning/joint_planner.h"
#include "motion_planning/joint_trajectory.h"
#include "motion_planning/manipulability_sector.h"

namespace motion_planning {

/// Why there is no plan. Same numbers as in interactive_mapping_msgs/PlanOutcome.
using interactive_mapping::PlanStatus;

struct PathCheckConfig {
  double verify_step_m{0.015};

  static void fields(PathCheckConfig& c, interactive_mapping::Fields& f) {
    f("verify_step_m", c.verify_step_m, 0.001, 0.1, "m",
      "greatest motion of any point of the arm between the last checks of a path");
  }
};

struct SpeedConfig {
  double velocity_scale{0.35};
  double acceleration_rad_s2{1.5};
  double contact_speed_m_s{0.05};
  double lift_speed_m_s{0.10};

  static void fields(SpeedConfig& c, interactive_mapping::Fields& f) {
    f.live()("velocity_scale", c.velocity_scale, 0.01, 1.0, "", "share of the URDF's velocity limits");
    f("acceleration_rad_s2", c.acceleration_rad_s2, 0.05, 40.0, "rad/s^2", "limit of every joint");
    f("contact_speed_m_s", c.contact_speed_m_s, 0.001, 0.25, "m/s",
      "speed of the tip on its last approach to the plate");
    f("lift_speed_m_s", c.lift_speed_m_s, 0.001, 1.0, "m/s", "speed of the tip on the straight retreat with the brick");
  }
};

constexpr double kMinLift_m = 0.05;         // a lift is no shorter; from here on it ends once the brick has room
constexpr double kMaxJointJump_rad = 0.25;  // between neighbours on a straight line: more is a change of branch
constexpr double kContactGrid_m = 0.04;     // spacing of the contact points that are tried beside the plate's middle

struct PickMotionConfig {
  double approach_m{0.10};
  double lift_m{0.30};
  double lift_room_m{0.03};
  double overtravel_m{0.0};
  double cartesian_step_m{0.005};
  double plate_margin_m{0.01};
  double magnet_radius_m{0.03};
  double max_twist_Nm{0.4};
  double max_bend_Nm{2.0};
  int yaw_samples{12};
  int max_goals{24};
  double max_tilt_rad{0.5235987755982988};

  static void fields(PickMotionConfig& c, interactive_mapping::Fields& f) {
    f("approach_m", c.approach_m, 0.01, 0.5, "m", "length of the straight approach along the face's normal");
    f("lift_m", c.lift_m, kMinLift_m, 0.5, "m",
      "longest straight retreat with the brick; from a side face up and back");
    f("lift_room_m", c.lift_room_m, 0.0, 0.2, "m", "clearance of the brick to all sides that ends the retreat earlier");
    f("overtravel_m", c.overtravel_m, 0.0, 0.03, "m",
      "length of the touch beyond the plate, for a guarded move that stops at contact");
    f("cartesian_step_m", c.cartesian_step_m, 5e-4, 0.02, "m", "distance of the joint states on a straight line");
    f("plate_margin_m", c.plate_margin_m, 0.0, 0.2, "m", "distance of the magnet's face from the plate's edges");
    f("magnet_radius_m", c.magnet_radius_m, 0.001, 0.2, "m", "radius of the magnet's face");
    f("max_twist_Nm", c.max_twist_Nm, 0.01, 100.0, "Nm",
      "moment about the magnet's axis that the weight of a held brick may have");
    f("max_bend_Nm", c.max_bend_Nm, 0.01, 1000.0, "Nm",
      "moment across the magnet's axis that the weight of a held brick may have");
    f("yaw_samples", c.yaw_samples, 1, 360, "", "angles of the tool about the face's normal that are tried");
    f("max_goals", c.max_goals, 1, 1000, "", "contact configurations passed to the planner, best first");
    f("max_tilt_rad", c.max_tilt_rad, 0.05, 3.2, "rad", "greatest tilt of a carried brick against how it was taken");
  }
};

struct InspectConfig {
  double clear_m{0.05};
  int samples{4000};

  static void fields(InspectConfig& c, interactive_mapping::Fields& f) {
    f("clear_m", c.clear_m, 0.0, 1.0, "m", "distance of the arm from the camera's view");
    f("samples", c.samples, 0, 1'000'000, "", "postures sampled if no given one keeps the view free");
  }
};

struct MotionPlannerConfig {
  CollisionCheckerConfig collision;
  JointPlannerConfig planner;
  PathCheckConfig check;
  SpeedConfig speed;
  TimingConfig timing;
  PickMotionConfig pick;
  InspectConfig view;

  static void fields(MotionPlannerConfig& c, interactive_mapping::Fields& f) {
    f.section("collision", c.collision);
    f.section("search", c.planner);
    f.section("search", c.check);
    f.section("motion", c.speed);
    f.section("motion", c.timing);
    f.section("pick", c.pick);
    f.section("view", c.view);
  }
};

struct PickTarget {
  int brick_id{-1};
  Eigen::Isometry3d T_map_brick{Eigen::Isometry3d::Identity()};
  const mp700_ur5e_description::BrickType* type{nullptr};
  std::vector<mp700_ur5e_description::BrickFace> faces;  // to try, in this order
};

struct PlanFailure {
  PlanStatus status;    // not kSuccess
  std::string message;  // a sentence: what, where, seen, allowed
};

template <class T, class Failure = PlanFailure>
using Result = interactive_mapping::Result<T, Failure>;

struct PickPlan {
  mp700_ur5e_description::BrickFace face{mp700_ur5e_description::BrickFace::kPlusZ};
  Eigen::Isometry3d T_map_contact{
      Eigen::Isometry3d::Identity()};  // of the tip on the plate, z against the face's normal
  HeldBrick held;                      // once it is attached
  JointTrajectory approach;            // from the start to before the face
  JointTrajectory contact;             // straight to the plate, and on by overtravel_m
  JointTrajectory lift;                // straight away with the brick
  JointTrajectory stow;                // with the brick to the place asked for
};

struct PickResult {
  Result<PickPlan> plan;  // or why the face that got farthest failed
  std::vector<std::pair<mp700_ur5e_description::BrickFace, PlanFailure>> tried{};  // faces that failed
};

struct PlanningContext {
  std::shared_ptr<const CollisionScene> scene;
  Eigen::Isometry3d T_map_base{Eigen::Isometry3d::Identity()};
  ArmVector start_rad{ArmVector::Zero()};
  std::optional<HeldBrick> held;
  std::optional<OrientedBox> vacated;  // where the held brick was picked: the map may still have it there
  std::vector<LoadedBrick> load;       // what lies in the robot's container
  std::uint64_t seed{0};               // another: the same question is searched along other random paths
  std::function<bool()> is_cancelled;
};

/// Where the held brick must hang, ready to be let go. It is over its place on the robot, its longer level edge along
/// the place's x, either way round. With level edges of one length any quarter turn is allowed.
struct PlaceGoal {
  Eigen::Isometry3d T_base_place{Eigen::Isometry3d::Identity()};  // its middle, z up
  double above_m{0.03};                                           // the brick's lowest point over it
  bool lay_down{false};  // its longest edge level, any shorter one upright; false: as upright as it was taken
};

/// Where the arm is to go: exactly one of the three.
struct ArmGoal {
  std::optional<ArmVector> joints_rad;
  std::optional<Eigen::Isometry3d> T_map_tip;
  std::optional<PlaceGoal> place;
  bool keep_level{true};  // what is held stays within max_tilt_rad; nothing held: no constraint
};

/// The camera whose view is to be kept free.
struct ViewFrustum {
  Eigen::Isometry3d T_base_camera{Eigen::Isometry3d::Identity()};  // optical frame
  double half_width_rad{0.0};
  double half_height_rad{0.0};
  double max_range_m{0.0};
};

/// Plans motions of the arm; moves nothing. Immutable but for its configuration; each call is independent and
/// deterministic. Cancelled calls return within a few milliseconds.
class MotionPlanner {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  MotionPlanner(std::shared_ptr<const ArmKinematics> arm, ManipulabilitySectors sectors,
                const MotionPlannerConfig& config);

  /// Approach, contact, lift, stow. `stow_goals`: arm postures where the brick may be carried to, best first.
  PickResult planPick(const PlanningContext& context, const PickTarget& target,
                      const std::vector<ArmGoal>& stow_goals) const;

  Result<JointTrajectory> planArm(const PlanningContext& context, const ArmGoal& goal) const;

  /// To a posture with no part of the arm in the camera's view: the first of `postures` that qualifies, else one found by
  /// sampling.
  Result<JointTrajectory> planInspect(const PlanningContext& context, const ViewFrustum& view,
                                      const std::vector<ArmVector>& postures) const;

  const MotionPlannerConfig& config() const { return config_; }
  const ArmKinematics& arm() const { return *arm_; }

 private:
  std::shared_ptr<const ArmKinematics> arm_;
  ManipulabilitySectors sectors_;
  MotionPlannerConfig config_;
};

}  // namespace motion_planning
