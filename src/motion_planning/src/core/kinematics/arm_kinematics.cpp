// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/arm_kinematics.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <kdl/chain.hpp>
#include <mp700_ur5e_description/robot_names.h>

#include "kinematics/ur_geometry.h"

namespace motion_planning {
namespace {

using mp700_ur5e_description::kArmJoints;

// Further than the tolerance, as far as doubles go on a lever of a metre with a margin: costs a step where one is taken.
constexpr double kPolished = 1e-9;
constexpr int kMaxPolishSteps = 20;
constexpr int kMaxSearchSteps = 60;         // from any posture: half a turn of every joint, and some to converge
constexpr double kMaxPolishStep_rad = 0.2;  // more leads to other branches
constexpr double kSameSolution_rad = 1e-3;  // two solutions of a stretched arm meet at sqrt(tolerance)
constexpr double kOnLimit_rad = 1e-7;       // beyond a limit by less: on it; moves the tip by a tenth of the tolerance
constexpr double kCalibrated = 1e-6;        // a closed form that is off by more [m, rad] is of another arm
constexpr int kMaxFollowSteps = 10;         // halve the softness to a thousandth
constexpr double kRigid = 1e-6;             // rounding of a pose in floats is a tenth

Eigen::Matrix3d toEigen(const KDL::Rotation& rotation) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rotation.data);
}

Eigen::Vector3d toEigen(const KDL::Vector& vector) {
  return Eigen::Map<const Eigen::Vector3d>(vector.data);
}

/// Rotation that takes `from` to `to`: axis times angle, in [0, pi].
Eigen::Vector3d rotationBetween(const Eigen::Matrix3d& from, const Eigen::Matrix3d& to) {
  const Eigen::Matrix3d R = to * from.transpose();
  const Eigen::Vector3d twice_sine(R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1));
  const double sine = 0.5 * twice_sine.norm();
  const double angle_rad = std::atan2(sine, 0.5 * (R.trace() - 1.0));
  // Near pi the axis is lost, but not that the angle is large.
  if (sine < 1e-12) return angle_rad > 1.0 ? Eigen::Vector3d(angle_rad, 0.0, 0.0) : Eigen::Vector3d(0.5 * twice_sine);
  return twice_sine * (0.5 * angle_rad / sine);
}

bool isSame(const ArmVector& a, const ArmVector& b) {
  for (int i = 0; i < 6; ++i) {
    if (std::abs(std::remainder(a[i] - b[i], 2.0 * M_PI)) > kSameSolution_rad) return false;
  }
  return true;
}

/// Always the same.
std::vector<ArmVector> drawPostures(std::size_t count) {
  std::mt19937_64 rng(1);
  std::uniform_real_distribution<double> angle_rad(-M_PI, M_PI);
  std::vector<ArmVector> postures(count);
  for (ArmVector& posture : postures) posture = ArmVector::NullaryExpr([&](Eigen::Index) { return angle_rad(rng); });
  return postures;
}

}  // namespace

ArmKinematics::ArmKinematics(std::shared_ptr<const mp700_ur5e_description::RobotModel> robot)
    : robot_(std::move(robot)) {
  if (!robot_) throw std::invalid_argument("ArmKinematics: no robot model");
  const KDL::Chain chain = robot_->chain(mp700_ur5e_description::kBaseFrame, mp700_ur5e_description::kMagnetTipFrame);

  // Each segment turns about a line in its parent's frame; written as a fixed pose up to the joint, whose z is the line,
  // and one after it.
  std::vector<std::string> names;
  Pose fixed{Eigen::Matrix3d::Identity(), Eigen::Vector3d::Zero()};
  for (const KDL::Segment& segment : chain.segments) {
    const KDL::Frame at_zero = segment.pose(0.0);
    const Eigen::Matrix3d R = toEigen(at_zero.M);
    const Eigen::Vector3d p = toEigen(at_zero.p);
    if (segment.getJoint().getType() == KDL::Joint::None) {
      fixed.p += fixed.R * p;
      fixed.R *= R;
      continue;
    }
    names.push_back(segment.getJoint().getName());
    if (names.size() > kArmJoints.size()) continue;
    const Eigen::Vector3d origin = toEigen(segment.getJoint().JointOrigin());
    const Eigen::Matrix3d R_parent_axis =
        Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), toEigen(segment.getJoint().JointAxis()))
            .toRotationMatrix();
    fixed_[names.size() - 1] = {fixed.R * R_parent_axis, fixed.p + fixed.R * origin};
    fixed = {R_parent_axis.transpose() * R, R_parent_axis.transpose() * (p - origin)};
  }
  if (names != std::vector<std::string>(kArmJoints.begin(), kArmJoints.end())) {
    std::string found, wanted;
    for (const std::string& name : names) found += (found.empty() ? "" : ", ") + name;
    for (const std::string name : kArmJoints) wanted += (wanted.empty() ? "" : ", ") + name;
    throw std::invalid_argument("the arm's joints from the base to the magnet are (" + found + "), must be (" + wanted +
                                ")");
  }
  fixed_.back() = fixed;

  for (std::size_t i = 0; i < kArmJoints.size(); ++i) {
    joint_indices_[i] = robot_->jointIndex(kArmJoints[i]);
    const auto& joint = robot_->joints()[joint_indices_[i]];
    const auto row = static_cast<Eigen::Index>(i);
    limits_.lower_rad[row] = joint.lower_rad;
    limits_.upper_rad[row] = joint.upper_rad;
    limits_.velocity_rad_s[row] = joint.velocity_rad_s;
    if (!(joint.lower_rad <= joint.upper_rad)) {
      std::ostringstream text;
      text << "limits of " << joint.name << " = [" << joint.lower_rad << ", " << joint.upper_rad
           << "] rad, must have lower <= upper";
      throw std::invalid_argument(text.str());
    }
  }

  Axes directions, points;
  walk(ArmVector::Zero(), &directions, &points);
  std::array<AxisLine, 6> axes;
  for (int i = 0; i < 6; ++i) axes[static_cast<std::size_t>(i)] = {points.col(i), directions.col(i)};
  try {
    geometry_ = std::make_shared<UrGeometry>(axes, tipPose(ArmVector::Zero()));
  } catch (const std::invalid_argument&) {
    return;
  }

  // How well the closed form knows this arm. Half as much again is for postures that these few do not show.
  for (const ArmVector& joints_rad : drawPostures(100)) {
    const Pose exact = walk(joints_rad, nullptr, nullptr);
    const Eigen::Isometry3d closed = geometry_->tipPose(joints_rad);
    model_gap_m_ = std::max(model_gap_m_, 1.5 * (closed.translation() - exact.p).norm());
    model_gap_rad_ = std::max(model_gap_rad_, 1.5 * rotationBetween(closed.linear(), exact.R).norm());
  }
}

ArmKinematics::Pose ArmKinematics::walk(const ArmVector& joints_rad, Axes* directions, Axes* points) const {
  Pose T = fixed_[0];
  for (int i = 0; i < 6; ++i) {
    if (directions != nullptr) {
      directions->col(i) = T.R.col(2);
      points->col(i) = T.p;
    }
    const double sine = std::sin(joints_rad[i]), cosine = std::cos(joints_rad[i]);
    const Eigen::Vector3d x = T.R.col(0);
    T.R.col(0) = cosine * x + sine * T.R.col(1);
    T.R.col(1) = cosine * T.R.col(1) - sine * x;
    const Pose& next = fixed_[static_cast<std::size_t>(i) + 1];
    T.p += T.R * next.p;
    T.R = (T.R * next.R).eval();
  }
  return T;
}

Eigen::Isometry3d ArmKinematics::tipPose(const ArmVector& joints_rad) const {
  const Pose tip = walk(joints_rad, nullptr, nullptr);
  Eigen::Isometry3d T_base_tip = Eigen::Isometry3d::Identity();
  T_base_tip.linear() = tip.R;
  T_base_tip.translation() = tip.p;
  return T_base_tip;
}

ArmJacobian ArmKinematics::jacobian(const ArmVector& joints_rad) const {
  Axes directions, points;
  const Pose tip = walk(joints_rad, &directions, &points);
  ArmJacobian J;
  for (int i = 0; i < 6; ++i) {
    const Eigen::Vector3d axis = directions.col(i);
    J.col(i).head<3>() = axis.cross(tip.p - points.col(i));
    J.col(i).tail<3>() = axis;
  }
  return J;
}

double ArmKinematics::manipulability(const ArmVector& joints_rad) const {
  return std::abs(jacobian(joints_rad).determinant());
}

bool ArmKinematics::isWithinLimits(const ArmVector& joints_rad, double tolerance_rad) const {
  // Written so that NaN is not within.
  return ((joints_rad - limits_.lower_rad).array() >= -tolerance_rad).all() &&
         ((limits_.upper_rad - joints_rad).array() >= -tolerance_rad).all();
}

Eigen::VectorXd ArmKinematics::robotPositions(const ArmVector& joints_rad) const {
  Eigen::VectorXd positions_rad = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(robot_->joints().size()));
  for (std::size_t i = 0; i < joint_indices_.size(); ++i) {
    positions_rad[static_cast<Eigen::Index>(joint_indices_[i])] = joints_rad[static_cast<Eigen::Index>(i)];
  }
  return positions_rad;
}

/// Levenberg-Marquardt with the exact Jacobian. The damping, the squared residual, keeps steps finite at singularities and
/// fades faster than the residual, so that convergence stays quadratic elsewhere. Not by Ceres:
/// inverse() polishes seven branches in 5 us, one problem of six unknowns takes Ceres 270 us (brick_detection's
/// refinePose() says of what).
bool ArmKinematics::polish(const Pose& goal, ArmVector* joints_rad) const {
  Axes directions, points;
  bool is_good = false;
  double last = 0.0;
  ArmVector best = *joints_rad;
  const int max_steps = geometry_ ? kMaxPolishSteps : kMaxSearchSteps;
  for (int step = 0; step < max_steps; ++step) {
    const Pose tip = walk(*joints_rad, &directions, &points);
    ArmVector error;
    error << goal.p - tip.p, rotationBetween(tip.R, goal.R);
    const double residual = error.norm();
    if (!std::isfinite(residual)) return false;
    const bool is_within =
        error.head<3>().norm() <= kIkPositionTolerance_m && error.tail<3>().norm() <= kIkRotationTolerance_rad;
    // Good enough, and no longer getting better.
    if (is_good && (!is_within || residual > 0.5 * last)) {
      if (!is_within || residual > last) *joints_rad = best;
      return true;
    }
    is_good = is_within;
    if (is_good && residual <= kPolished) return true;
    last = residual;
    best = *joints_rad;

    ArmJacobian J;
    for (int i = 0; i < 6; ++i) {
      const Eigen::Vector3d axis = directions.col(i);
      J.col(i).head<3>() = axis.cross(tip.p - points.col(i));
      J.col(i).tail<3>() = axis;
    }
    ArmJacobian normal = J.transpose() * J;
    normal.diagonal().array() += residual * residual + 1e-12;  // the latter: no leaps along an aligned wrist
    ArmVector change = normal.ldlt().solve(J.transpose() * error);
    const double largest = change.cwiseAbs().maxCoeff();
    if (!(largest < 1e6)) return is_good;
    if (largest > kMaxPolishStep_rad) change *= kMaxPolishStep_rad / largest;
    *joints_rad += change;
  }
  *joints_rad = best;
  return is_good;
}

/// Next to a singularity the polish of a calibrated arm may run into a neighbouring branch. Here the closed form keeps the
/// branch: where its arm and the true one differ is put into the goal, at the joints found last, and the border's softness
/// fades as the two come together.
ArmVector ArmKinematics::followBranch(const Eigen::Isometry3d& T_base_tip, std::size_t branch,
                                      ArmVector joints_rad) const {
  UrGeometry::Branches branches;
  double softness = 1.0;
  for (int i = 0; i < kMaxFollowSteps; ++i) {
    softness *= 0.5;
    const Eigen::Isometry3d T_shifted =
        T_base_tip * tipPose(joints_rad).inverse(Eigen::Isometry) * geometry_->tipPose(joints_rad);
    geometry_->solve(T_shifted, joints_rad[5], {softness * model_gap_m_, softness * model_gap_rad_}, &branches);
    if (!branches[branch].allFinite()) break;
    joints_rad = branches[branch];
  }
  return joints_rad;
}

bool ArmKinematics::wind(const ArmVector& near_rad, ArmVector* joints_rad) const {
  constexpr double kTurn_rad = 2.0 * M_PI;
  for (int i = 0; i < 6; ++i) {
    const double lower = limits_.lower_rad[i], upper = limits_.upper_rad[i];
    double& value = (*joints_rad)[i];
    value = near_rad[i] + std::remainder(value - near_rad[i], kTurn_rad);
    if (value < lower - kOnLimit_rad) value += kTurn_rad * std::ceil((lower - kOnLimit_rad - value) / kTurn_rad);
    if (value > upper + kOnLimit_rad) {
      value -= kTurn_rad * std::ceil((value - upper - kOnLimit_rad) / kTurn_rad);
      if (value < lower - kOnLimit_rad) return false;
    }
    value = std::clamp(value, lower, upper);
  }
  return true;
}

std::vector<ArmVector> ArmKinematics::inverse(const Eigen::Isometry3d& T_base_tip, const ArmVector& near_rad) const {
  if (!near_rad.allFinite()) throw std::invalid_argument("inverse: near_rad is not finite");
  const Eigen::Matrix3d linear = T_base_tip.linear();
  const Eigen::Vector3d position = T_base_tip.translation();
  if (!linear.allFinite() || !position.allFinite()) return {};
  if (!((linear.transpose() * linear - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() <= kRigid)) return {};
  if (linear.determinant() < 0.0) return {};
  const Pose goal{Eigen::Quaterniond(linear).normalized().toRotationMatrix(), position};
  Eigen::Isometry3d T_goal = Eigen::Isometry3d::Identity();
  T_goal.linear() = goal.R;
  T_goal.translation() = goal.p;

  std::vector<ArmVector> solutions;
  solutions.reserve(kMaxBranches);
  const auto add = [&](ArmVector joints_rad) {
    if (!joints_rad.allFinite() || !polish(goal, &joints_rad)) return false;
    const bool is_known = std::any_of(solutions.begin(), solutions.end(),
                                      [&](const ArmVector& other) { return isSame(joints_rad, other); });
    if (!is_known) solutions.push_back(joints_rad);
    return !is_known;
  };
  if (geometry_) {
    UrGeometry::Branches branches;
    geometry_->solve(T_goal, near_rad[5], {model_gap_m_, model_gap_rad_}, &branches);
    std::array<bool, kMaxBranches> is_found;
    for (std::size_t i = 0; i < branches.size(); ++i) is_found[i] = add(branches[i]);
    if (std::max(model_gap_m_, model_gap_rad_) > kCalibrated) {
      for (std::size_t i = 0; i < branches.size(); ++i) {
        if (!is_found[i] && branches[i].allFinite()) add(followBranch(T_goal, i, branches[i]));
      }
    }
  } else {
    static const std::vector<ArmVector> starts_rad = drawPostures(kNumericalStarts);
    add(near_rad);
    for (const ArmVector& start_rad : starts_rad) add(start_rad);
  }
  solutions.erase(std::remove_if(solutions.begin(), solutions.end(),
                                 [&](ArmVector& solution) { return !wind(near_rad, &solution); }),
                  solutions.end());
  std::stable_sort(solutions.begin(), solutions.end(), [&](const ArmVector& a, const ArmVector& b) {
    return (a - near_rad).squaredNorm() < (b - near_rad).squaredNorm();
  });
  return solutions;
}

}  // namespace motion_planning
