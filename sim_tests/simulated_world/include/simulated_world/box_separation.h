// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>

namespace simulated_world {

/// Gap between two boxes along the direction in which it is largest, by the separating axis theorem: > 0 apart (a lower
/// bound of their distance), 0 touching, < 0 as deep as they overlap. Poses are those of the boxes' centres.
double boxSeparation(const Eigen::Isometry3d& T_map_a, const Eigen::Vector3d& size_a_m,
                     const Eigen::Isometry3d& T_map_b, const Eigen::Vector3d& size_b_m);

}  // namespace simulated_world
