// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <memory>
#include <vector>

#include <Eigen/Geometry>
#include <mp700_ur5e_description/robot_model.h>

namespace motion_planning {

/// Joint angles, speeds or accelerations of the arm, in the order of mp700_ur5e_description::kArmJoints. SI units.
using ArmVector = Eigen::Matrix<double, 6, 1>;
using ArmJacobian = Eigen::Matrix<double, 6, 6>;

struct ArmLimits {
  ArmVector lower_rad;
  ArmVector upper_rad;
  ArmVector velocity_rad_s;
};

constexpr double kLimitTolerance_rad = 1e-9;  // of a posture at its limits: rounding

class UrGeometry;  // the closed form

/// Kinematics of the chain base_link -> magnet_tip. Frames: B = base_link, T = magnet_tip (z out of the tool).
/// Immutable, safe for any number of threads.
class ArmKinematics {
 public:
  static constexpr int kMaxBranches = 8;  // shoulder left/right, elbow up/down, wrist flipped or not

  /// Throws std::invalid_argument unless the chain has the arm's six joints.
  explicit ArmKinematics(std::shared_ptr<const mp700_ur5e_description::RobotModel> robot);

  /// T_base_tip.
  Eigen::Isometry3d tipPose(const ArmVector& joints_rad) const;

  /// Of the tip, in axes of B: rows 0-2 d position [m/rad], rows 3-5 rotation [rad/rad].
  ArmJacobian jacobian(const ArmVector& joints_rad) const;

  /// Yoshikawa's measure sqrt(det(J J^T)) (eq 12) = |det J| for six joints, position in metres and rotation in radians
  /// [m^3]. Zero where the arm is singular.
  double manipulability(const ArmVector& joints_rad) const;

  /// All branches that reach `T_base_tip`, each once: every joint by the turn that is nearest to `near_rad` within the
  /// limits. Nearest first (Euclidean, rad). Closed form, polished with the exact kinematics of the URDF, which may be
  /// calibrated: residual <= kIkPositionTolerance_m and kIkRotationTolerance_rad. Empty: out of reach, beyond the limits,
  /// or `T_base_tip` not finite / not rigid (to 1e-6). At a wrist singularity a whole line solves. wrist_3 is then
  /// taken from `near_rad`, or is the nearest to it that the arm is long enough for. Solutions nearer to each other
  /// than 1e-3 rad (an arm all but stretched) count as one. No branch is missed, but on a calibrated arm where J has a
  /// singular value below 0.02: there some are. Throws std::invalid_argument if `near_rad` is not finite. An arm
  /// without the UR's structure has no closed form here: the polish starts from `near_rad` and from kNumericalStarts
  /// fixed postures. This is slower and may miss branches (docs/how_it_works.md has the numbers).
  std::vector<ArmVector> inverse(const Eigen::Isometry3d& T_base_tip, const ArmVector& near_rad) const;

  static constexpr double kIkPositionTolerance_m = 1e-6;
  static constexpr double kIkRotationTolerance_rad = 1e-6;

  static constexpr int kNumericalStarts = 64;

  /// Whether the arm has the UR's structure: axes 2, 3 and 4 parallel, axes 1, 5 and 6 at right angles to their
  /// neighbours. The tolerance is what a factory calibration changes.
  bool isClosedForm() const { return geometry_ != nullptr; }

  const ArmLimits& limits() const { return limits_; }
  bool isWithinLimits(const ArmVector& joints_rad, double tolerance_rad = kLimitTolerance_rad) const;

  const mp700_ur5e_description::RobotModel& robot() const { return *robot_; }
  /// Where an arm joint stands in RobotModel::joints().
  const std::array<std::size_t, 6>& jointIndices() const { return joint_indices_; }
  /// All joints of the robot with the arm at `joints_rad` and the rest at zero: argument of RobotModel::bodyPoses.
  Eigen::VectorXd robotPositions(const ArmVector& joints_rad) const;

 private:
  using Axes = Eigen::Matrix<double, 3, 6>;
  struct Pose {
    Eigen::Matrix3d R;
    Eigen::Vector3d p;
  };

  /// Along the chain: pose of the tip; if asked for, direction of and a point on each joint's axis. All in B.
  Pose walk(const ArmVector& joints_rad, Axes* directions, Axes* points) const;
  bool polish(const Pose& goal, ArmVector* joints_rad) const;
  ArmVector followBranch(const Eigen::Isometry3d& T_base_tip, std::size_t branch, ArmVector joints_rad) const;
  bool wind(const ArmVector& near_rad, ArmVector* joints_rad) const;

  std::shared_ptr<const mp700_ur5e_description::RobotModel> robot_;
  ArmLimits limits_;
  std::array<std::size_t, 6> joint_indices_;
  std::array<Pose, 7> fixed_;                   // before, between and after the joints; each joint turns about its z
  std::shared_ptr<const UrGeometry> geometry_;  // null: the arm has another structure
  double model_gap_m_{0.0};                     // largest difference of the closed form's tip from the URDF's
  double model_gap_rad_{0.0};
};

}  // namespace motion_planning
