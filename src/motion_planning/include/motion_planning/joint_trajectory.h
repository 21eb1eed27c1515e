// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <interactive_mapping_common/config/schema.h>

#include "motion_planning/arm_kinematics.h"

namespace motion_planning {

/// A joint path as waypoints, straight between them in joint space.
using JointPath = std::vector<ArmVector>;

/// What a trajectory may do. The URDF has velocities; accelerations are a convention (none are published).
struct MotionLimits {
  ArmVector velocity_rad_s{ArmVector::Constant(1.0)};
  ArmVector acceleration_rad_s2{ArmVector::Constant(2.0)};

  std::vector<std::string> validate() const;
};

struct TrajectoryPoint {
  double time_s{0.0};  // from the start
  ArmVector position_rad{ArmVector::Zero()};
  ArmVector velocity_rad_s{ArmVector::Zero()};
  ArmVector acceleration_rad_s2{ArmVector::Zero()};  // just after time_s; zero at the end
};

/// At rest at both ends; times strictly rising. Between points: the cubic that joins position and velocity, as the joint
/// trajectory controller interpolates.
struct JointTrajectory {
  std::vector<TrajectoryPoint> points;

  bool empty() const { return points.empty(); }
  double duration() const { return points.empty() ? 0.0 : points.back().time_s; }
  /// Before the start and after the end: at rest there. Throws std::logic_error when empty.
  TrajectoryPoint sample(double time_s) const;
};

struct TimingConfig {
  double max_deviation_rad{0.05};
  double sample_s{0.02};

  static void fields(TimingConfig& c, interactive_mapping::Fields& f) {
    f("max_deviation_rad", c.max_deviation_rad, 1e-6, 1.0, "rad",
      "greatest deviation of a joint where corners of the path are rounded");
    f("sample_s", c.sample_s, 1e-3, 1.0, "s",
      "longest time between points of a trajectory; shorter where the acceleration changes");
  }
};

/// Holds the speed of a point on the arm. `position_jacobian`: its rows 0-2 of ArmKinematics::jacobian [m/rad].
struct PointSpeedLimit {
  std::function<Eigen::Matrix<double, 3, 6>(const ArmVector&)> position_jacobian;
  double speed_m_s{0.0};
};

/// The tip's speed. Keeps `arm` alive.
PointSpeedLimit tipSpeedLimit(std::shared_ptr<const ArmKinematics> arm, double speed_m_s);

/// Fastest motion along the path, corners rounded, that keeps velocity and acceleration limits everywhere, also between
/// the points of the result as they are interpolated. Velocity is continuous. Waypoints nearer than 1e-6 rad are one.
/// A path of one point gives one point at time zero. `speed_limit` holds to within 0.5 % between points. Throws
/// std::invalid_argument for an empty path, numbers that are not finite, or impossible limits.
JointTrajectory timeParametrize(const JointPath& path, const MotionLimits& limits, const TimingConfig& config = {},
                                const std::optional<PointSpeedLimit>& speed_limit = std::nullopt);

/// The path that timeParametrize follows, densely, so that rounded corners can be checked for collision: neighbours are
/// at most `step_rad` apart in every joint. Both ends are the given path's.
JointPath roundedPath(const JointPath& path, double step_rad, const TimingConfig& config = {});

}  // namespace motion_planning
