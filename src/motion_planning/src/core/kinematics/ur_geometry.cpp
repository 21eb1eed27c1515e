// SPDX-License-Identifier: BSD-3-Clause
#include "kinematics/ur_geometry.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include <interactive_mapping_common/formatted.h>
#include <mp700_ur5e_description/robot_names.h>

namespace motion_planning {
namespace {

using interactive_mapping::formatted;

// A factory calibration changes angles by tenths of a degree and offsets by a few millimetres; another make of arm misses
// the structure by ninety degrees or by centimetres.
constexpr double kMaxTilt_rad = 0.02;
constexpr double kMaxGap_m = 0.01;
constexpr double kMinLink_m = 0.05;  // shorter, and elbow or wrist have no direction

/// Below this the wrist is aligned: whatever wrist_3 is, the tool's direction is right to within half the tolerance.
constexpr double kAligned_rad = 0.5 * ArmKinematics::kIkRotationTolerance_rad;

[[noreturn]] void refuse(int first, int second, const std::string& problem) {
  throw std::invalid_argument(std::string("axes of ") + mp700_ur5e_description::kArmJoints[first] + " and " +
                              mp700_ur5e_description::kArmJoints[second] + " " + problem +
                              ": not the structure of a UR, which the closed form needs");
}

/// Point of `a` nearest to `b`; the two are not parallel.
Eigen::Vector3d nearestPoint(const AxisLine& a, const AxisLine& b) {
  const double cosine = a.direction.dot(b.direction);
  const Eigen::Vector3d between = b.point - a.point;
  const double along = (between.dot(a.direction) - cosine * between.dot(b.direction)) / (1.0 - cosine * cosine);
  return a.point + along * a.direction;
}

void requireParallel(const std::array<AxisLine, 6>& axes, int first, int second) {
  const double angle_rad = std::acos(std::clamp(axes[first].direction.dot(axes[second].direction), -1.0, 1.0));
  if (!(angle_rad <= kMaxTilt_rad)) {
    refuse(first, second, formatted("are %g rad from parallel, must be within %g", angle_rad, kMaxTilt_rad));
  }
}

void requireCrossing(const std::array<AxisLine, 6>& axes, int first, int second) {
  const double tilt_rad = std::asin(std::clamp(axes[first].direction.dot(axes[second].direction), -1.0, 1.0));
  if (!(std::abs(tilt_rad) <= kMaxTilt_rad)) {
    refuse(first, second,
           formatted("are %g rad from a right angle, must be within %g", std::abs(tilt_rad), kMaxTilt_rad));
  }
  const double gap_m = (nearestPoint(axes[first], axes[second]) - nearestPoint(axes[second], axes[first])).norm();
  if (!(gap_m <= kMaxGap_m)) refuse(first, second, formatted("pass each other at %g m, must be within 0.01", gap_m));
}

/// Angle from z towards x.
double planeAngle(const Eigen::Vector3d& v) {
  return std::atan2(v.x(), v.z());
}

Eigen::Isometry3d turnAbout(const Eigen::Vector3d& point, const Eigen::Vector3d& axis, double angle_rad) {
  const Eigen::Matrix3d R = Eigen::AngleAxisd(angle_rad, axis).toRotationMatrix();
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = R;
  T.translation() = point - R * point;
  return T;
}

}  // namespace

UrGeometry::UrGeometry(const std::array<AxisLine, 6>& axes, const Eigen::Isometry3d& T_base_tip_at_zero) {
  requireCrossing(axes, 0, 1);
  requireParallel(axes, 1, 2);
  requireParallel(axes, 2, 3);
  requireCrossing(axes, 3, 4);
  requireCrossing(axes, 4, 5);

  const Eigen::Vector3d z = axes[0].direction;
  Eigen::Vector3d y = axes[1].direction + axes[2].direction + axes[3].direction;
  y = (y - z * y.dot(z)).normalized();
  Eigen::Isometry3d T_base_S = Eigen::Isometry3d::Identity();
  T_base_S.linear() << y.cross(z), y, z;
  T_base_S.translation() = nearestPoint(axes[0], axes[1]);
  T_S_base_ = T_base_S.inverse();
  T_S_tip_zero_ = T_S_base_ * T_base_tip_at_zero;
  T_tip_S_zero_ = T_S_tip_zero_.inverse();

  wrist_ = T_S_base_ * nearestPoint(axes[3], axes[4]);
  wrist_offset_m_ = wrist_.y();
  // Axis 3 is hardly tilted: anywhere along the arm's width will do.
  const Eigen::Vector3d elbow_point = T_S_base_ * axes[2].point;
  const Eigen::Vector3d elbow_axis = T_S_base_.linear() * axes[2].direction;
  elbow_ = elbow_point + elbow_axis * ((0.5 * wrist_offset_m_ - elbow_point.y()) / elbow_axis.y());

  const Eigen::Vector3d upper(elbow_.x(), 0.0, elbow_.z());
  const Eigen::Vector3d forearm(wrist_.x() - elbow_.x(), 0.0, wrist_.z() - elbow_.z());
  upper_length_m_ = upper.norm();
  forearm_length_m_ = forearm.norm();
  if (!(upper_length_m_ >= kMinLink_m))
    refuse(1, 2, formatted("are %g m apart, must be 0.05 or more", upper_length_m_));
  if (!(forearm_length_m_ >= kMinLink_m)) {
    refuse(2, 3, formatted("are %g m apart, must be 0.05 or more", forearm_length_m_));
  }
  upper_angle_rad_ = planeAngle(upper);
  forearm_angle_rad_ = planeAngle(forearm);

  axis_5_ = T_S_base_.linear() * axes[4].direction;
  axis_5_.y() = 0.0;
  axis_5_.normalize();
  axis_6_ = T_S_base_.linear() * axes[5].direction;
  axis_6_ = (axis_6_ - axis_5_ * axis_6_.dot(axis_5_)).normalized();
  wrist_height_m_ = (T_S_base_ * nearestPoint(axes[4], axes[5]) - wrist_).dot(axis_5_);
  centre_ = wrist_ + wrist_height_m_ * axis_5_;
  wrist_2_offset_rad_ = std::atan2(axis_5_.cross(axis_6_).y(), axis_6_.y());
}

Eigen::Isometry3d UrGeometry::tipPose(const ArmVector& q) const {
  const Eigen::Vector3d y = Eigen::Vector3d::UnitY();
  return T_S_base_.inverse() * turnAbout(Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitZ(), q[0]) *
         turnAbout(Eigen::Vector3d::Zero(), y, q[1]) * turnAbout(elbow_, y, q[2]) * turnAbout(wrist_, y, q[3]) *
         turnAbout(wrist_, axis_5_, q[4]) * turnAbout(centre_, axis_6_, q[5]) * T_S_tip_zero_;
}

/// What to add to theta, as little as may be, for the wrist to be within reach of upper arm and forearm. The wrist is
/// `wrist_height_m_` from the centre, against axis 5, which turns with theta: reach^2 = r^2 + h^2 - 2 r h cos(angle).
double UrGeometry::toReach(double theta, const Eigen::Vector3d& centre_1) const {
  const double radius_m = std::hypot(centre_1.x(), centre_1.z());
  const double twice_product = 2.0 * radius_m * wrist_height_m_;
  if (std::abs(twice_product) < 1e-12) return 0.0;  // the wrist does not move
  const auto cosineAt = [&](double reach_m) {
    return (radius_m * radius_m + wrist_height_m_ * wrist_height_m_ - reach_m * reach_m) / twice_product;
  };
  const double stretched = cosineAt(upper_length_m_ + forearm_length_m_);
  const double folded = cosineAt(upper_length_m_ - forearm_length_m_);
  const double least = std::min(stretched, folded), most = std::max(stretched, folded);
  const double angle_rad = std::remainder(planeAngle(axis_5_) + theta - planeAngle(centre_1), 2.0 * M_PI);
  const double cosine = std::cos(angle_rad);
  if ((cosine >= least && cosine <= most) || least > 1.0 || most < -1.0) return 0.0;
  return std::copysign(std::acos(std::clamp(cosine, least, most)), angle_rad) - angle_rad;
}

// One derivation from the shoulder to the elbow: its parts would have to hand on most of what they compute.
void UrGeometry::solve(const Eigen::Isometry3d& T_base_tip, double wrist_3_rad, const Softness& softness,
                       Branches* branches) const {
  branches->fill(ArmVector::Constant(std::numeric_limits<double>::quiet_NaN()));
  // N = e1 ... e6. Turns 5 and 6 leave the wrist's centre where it is, turns 2, 3 and 4 its y.
  const Eigen::Isometry3d N = T_S_base_ * T_base_tip * T_tip_S_zero_;
  const Eigen::Vector3d centre = N * centre_;

  // Shoulder: the centre, turned back by q1, has y = wrist_offset: radius sin(bearing - q1) = wrist_offset.
  const double radius_m = std::hypot(centre.x(), centre.y());
  if (radius_m < std::abs(wrist_offset_m_) - softness.position_m - ArmKinematics::kIkPositionTolerance_m) return;
  const double bearing_rad = std::atan2(centre.y(), centre.x());
  // Offset over radius within the softness of 1 is a double root that the polish has to tell apart; an angle d from it
  // moves the centre by radius d^2 / 2.
  const double shoulder_spread_rad = std::sqrt(2.0 * softness.position_m / std::max(radius_m, kMinLink_m));
  const double shoulder_rad =
      std::copysign(std::min(std::asin(std::min(std::abs(wrist_offset_m_) / std::max(radius_m, 1e-12), 1.0)),
                             M_PI_2 - shoulder_spread_rad),
                    wrist_offset_m_);

  for (const std::size_t shoulder : {0, 1}) {
    const double q1 = bearing_rad - (shoulder == 0 ? shoulder_rad : M_PI - shoulder_rad);
    const Eigen::Matrix3d R1 = Eigen::AngleAxisd(-q1, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    const Eigen::Matrix3d N1 = R1 * N.linear();  // = Ry(theta) R(axis_5, q5) R(axis_6, q6), theta = q2 + q3 + q4
    const Eigen::Vector3d centre_1 = R1 * centre;

    // Wrist 2: turns about y leave the y of axis 6, cos(q5 - offset), as it is. The sine keeps digits where the cosine
    // is flat.
    const Eigen::Vector3d y_seen = N1.row(1).transpose();  // N1^T y
    const double cosine = y_seen.dot(axis_6_);
    const double sine = y_seen.cross(axis_6_).norm();
    const double wrist_2_rad = std::atan2(sine, cosine);
    const bool is_aligned = sine <= kAligned_rad;
    const double least_rad = std::max(softness.rotation_rad, 0.0);
    for (const std::size_t wrist_side : {0, 1}) {
      // Aligned, the two sides are one solution.
      if (is_aligned && wrist_side == 1 && least_rad <= kAligned_rad) break;
      const double turn_rad = std::clamp(wrist_2_rad, least_rad, M_PI - least_rad);
      const double q5 = wrist_2_offset_rad_ + (wrist_side == 0 ? turn_rad : -turn_rad);
      const Eigen::Matrix3d R5 = Eigen::AngleAxisd(q5, axis_5_).toRotationMatrix();

      // Wrist 3 turns R5^T y about axis 6 into N1^T y.
      double q6 = wrist_3_rad;
      if (!is_aligned) {
        const Eigen::Vector3d from = R5.row(1).transpose();
        q6 = -std::atan2(axis_6_.dot(from.cross(y_seen)), from.dot(y_seen) - from.dot(axis_6_) * cosine);
      }
      const Eigen::Matrix3d R_theta = N1 * Eigen::AngleAxisd(-q6, axis_6_).toRotationMatrix() * R5.transpose();
      double theta = std::atan2(R_theta(0, 2) - R_theta(2, 0), R_theta(0, 0) + R_theta(2, 2));
      if (is_aligned) {
        // Turns 6 and theta are about one line and only their sum counts.
        const double change_rad = toReach(theta, centre_1);
        theta += change_rad;
        q6 -= cosine > 0.0 ? change_rad : -change_rad;
      }

      // Elbow: a planar arm of two links from the origin to the wrist.
      const double sin_theta = std::sin(theta), cos_theta = std::cos(theta);
      const Eigen::Vector3d axis_5(cos_theta * axis_5_.x() + sin_theta * axis_5_.z(), 0.0,
                                   cos_theta * axis_5_.z() - sin_theta * axis_5_.x());
      const Eigen::Vector3d wrist = centre_1 - wrist_height_m_ * axis_5;
      const double reach_m = std::hypot(wrist.x(), wrist.z());
      // Next to an aligned wrist theta is as uncertain as the tool's direction over the sine, and with it the wrist's place.
      const double theta_softness_rad = is_aligned ? 0.0 : std::min(softness.rotation_rad / sine, 1.0);
      const double wrist_softness_m = softness.position_m + std::abs(wrist_height_m_) * theta_softness_rad;
      const double border_m = wrist_softness_m + ArmKinematics::kIkPositionTolerance_m;
      if (reach_m > upper_length_m_ + forearm_length_m_ + border_m ||
          reach_m < std::abs(upper_length_m_ - forearm_length_m_) - border_m) {
        continue;
      }
      const double twice_product = 2.0 * upper_length_m_ * forearm_length_m_;
      const double cos_elbow =
          (reach_m * reach_m - upper_length_m_ * upper_length_m_ - forearm_length_m_ * forearm_length_m_) /
          twice_product;
      // As at the shoulder; the bend d of a straight arm shortens it by product d^2 / (2 length).
      const double elbow_spread_rad =
          std::min(M_PI_2, std::sqrt(4.0 * (upper_length_m_ + forearm_length_m_) * wrist_softness_m / twice_product));
      const double elbow_rad =
          std::clamp(std::acos(std::clamp(cos_elbow, -1.0, 1.0)), elbow_spread_rad, M_PI - elbow_spread_rad);
      for (const std::size_t elbow_side : {0, 1}) {
        const double bend_rad = elbow_side == 0 ? elbow_rad : -elbow_rad;
        const double q3 = bend_rad - forearm_angle_rad_ + upper_angle_rad_;
        const double q2 = planeAngle(wrist) - upper_angle_rad_ -
                          std::atan2(forearm_length_m_ * std::sin(bend_rad),
                                     upper_length_m_ + forearm_length_m_ * std::cos(bend_rad));
        (*branches)[4 * shoulder + 2 * wrist_side + elbow_side] << q1, q2, q3, theta - q2 - q3, q5, q6;
      }
    }
  }
}

}  // namespace motion_planning
