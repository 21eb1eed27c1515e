// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/box_separation.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace simulated_world {

double boxSeparation(const Eigen::Isometry3d& T_map_a, const Eigen::Vector3d& size_a_m,
                     const Eigen::Isometry3d& T_map_b, const Eigen::Vector3d& size_b_m) {
  const Eigen::Vector3d offset = T_map_b.translation() - T_map_a.translation();
  double largest = -std::numeric_limits<double>::infinity();
  const auto tryAxis = [&](const Eigen::Vector3d& axis) {
    const double length = axis.norm();
    if (length < 1e-6) return;  // two parallel edges span no direction; the faces' normals have it
    const Eigen::Vector3d n = axis / length;
    const double reach = 0.5 * ((T_map_a.linear().transpose() * n).cwiseAbs().dot(size_a_m) +
                                (T_map_b.linear().transpose() * n).cwiseAbs().dot(size_b_m));
    largest = std::max(largest, std::abs(offset.dot(n)) - reach);
  };
  for (int i = 0; i < 3; ++i) {
    tryAxis(T_map_a.linear().col(i));
    tryAxis(T_map_b.linear().col(i));
    for (int j = 0; j < 3; ++j) {
      tryAxis(T_map_a.linear().col(i).cross(T_map_b.linear().col(j)));
    }
  }
  return largest;
}

}  // namespace simulated_world
