// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

namespace interactive_mapping {

/// Pose in the ground plane. The variable's name tells the frame.
struct Pose2d {
  double x_m{0.0};
  double y_m{0.0};
  double yaw_rad{0.0};

  Eigen::Vector2d position() const { return {x_m, y_m}; }
};

/// Velocity in base_link of a base that cannot move sideways.
struct Twist2d {
  double linear_m_s{0.0};
  double angular_rad_s{0.0};
};

}  // namespace interactive_mapping
