// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <interactive_mapping_common/geometry/pose2d.h>

#include "synthetic_depth/seeded_random.h"

namespace simulated_world {

using interactive_mapping::Pose2d;  // here the heading is not wrapped: turns can be counted
using interactive_mapping::Twist2d;

/// Pose after moving with a constant twist for dt: a circular arc, or a line where the turn is too small to tell.
Pose2d moveAlongArc(const Pose2d& pose, const Twist2d& twist, double dt_s);

/// Pose of `b`, given in the frame of `a`, in the frame `a` is given in; and the inverse of a pose.
Pose2d compose(const Pose2d& a, const Pose2d& b);
Pose2d inverse(const Pose2d& pose);

/// Behaviour of a differential drive with its controller. Wheels and limits come from the base profile.
struct DifferentialDriveConfig {
  double wheel_radius_m{0.13375};
  double track_m{0.507};  ///< between the contact points of the two driven wheels
  double max_forward_m_s{0.8};
  double max_backward_m_s{0.1};
  double max_angular_rad_s{0.6};
  double linear_acceleration_m_s2{0.2};
  double angular_acceleration_rad_s2{0.6};
  double command_timeout_s{1.0};  ///< without a command for so long the base brakes to a stop
  // Odometry: what the wheels say, scaled by an error that is drawn once, and a random walk per metre and radian.
  double odometry_scale_std{0.0};            ///< of distance and of turn, relative
  double odometry_walk_m_per_sqrt_m{0.0};    ///< of distance
  double odometry_walk_rad_per_sqrt_m{0.0};  ///< of heading
  std::uint64_t seed{1};

  std::vector<std::string> validate() const;
};

/// From velocity commands to wheel speeds, to the motion of the base on the ground, to odometry. No dynamics: the
/// motion is that of the wheels; the caller, who moves the body, decides whether it can follow.
class DifferentialDrive {
 public:
  /// Throws std::invalid_argument with everything validate() names.
  explicit DifferentialDrive(const DifferentialDriveConfig& config);

  /// Latest velocity command. What is beyond the limits is limited, both components by one factor, so that the path
  /// stays the one asked for. A command that is not finite is refused (false) and the previous one stays.
  bool command(const Twist2d& twist, double now_s);

  /// One step: ramps towards the command, turns the wheels, moves odometry. Returns the twist over the ground, which
  /// differs from the wheels' where a wheel slips.
  Twist2d update(double now_s, double dt_s);

  /// Share of the left and right wheel's turning that does not become motion: 0 none, 1 spinning on the spot.
  /// Throws std::invalid_argument outside [0, 1].
  void setSlip(double left, double right);

  /// Stops the wheels at once and forgets the command (motors off).
  void stop();

  const Twist2d& wheelTwist() const { return wheel_twist_; }  ///< what the wheels do
  const Pose2d& odometry() const { return odometry_; }        ///< of base_link in `odom`, which starts at zero
  double leftWheelAngle() const { return left_angle_rad_; }
  double rightWheelAngle() const { return right_angle_rad_; }
  double leftWheelSpeed() const;   ///< rad/s
  double rightWheelSpeed() const;  ///< rad/s
  const DifferentialDriveConfig& config() const { return config_; }

 private:
  DifferentialDriveConfig config_;
  synthetic_depth::SeededRandom random_;
  Twist2d command_;
  double command_time_s_;
  Twist2d wheel_twist_;
  Pose2d odometry_;
  double linear_scale_{1.0};
  double angular_scale_{1.0};
  double left_angle_rad_{0.0};
  double right_angle_rad_{0.0};
  double left_slip_{0.0};
  double right_slip_{0.0};
};

}  // namespace simulated_world
