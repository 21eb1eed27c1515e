// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <cstddef>

#include "surface_picking/cuboids.h"

namespace surface_picking {

using mp700_ur5e_description::faceNormal;
using mp700_ur5e_description::kBrickFaces;

const std::vector<Eigen::Matrix3d>& rotationsOfTheCube() {
  static const std::vector<Eigen::Matrix3d> kRotations = [] {
    std::vector<Eigen::Matrix3d> rotations;
    const std::array<std::array<int, 3>, 6> orders = {
        {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}}};
    for (const auto& order : orders) {
      for (int signs = 0; signs < 8; ++signs) {
        Eigen::Matrix3d R = Eigen::Matrix3d::Zero();
        for (int i = 0; i < 3; ++i) R(order[static_cast<std::size_t>(i)], i) = (signs >> i) & 1 ? -1.0 : 1.0;
        if (R.determinant() > 0.0) rotations.push_back(R);
      }
    }
    return rotations;
  }();
  return kRotations;
}

bool overlap(const Eigen::Isometry3d& T_map_a, const Eigen::Vector3d& size_a_m, const Eigen::Isometry3d& T_map_b,
             const Eigen::Vector3d& size_b_m, double slack_m) {
  std::vector<Eigen::Vector3d> axes;
  for (int i = 0; i < 3; ++i) {
    axes.emplace_back(T_map_a.linear().col(i));
    axes.emplace_back(T_map_b.linear().col(i));
    for (int j = 0; j < 3; ++j) {
      const Eigen::Vector3d cross = T_map_a.linear().col(i).cross(T_map_b.linear().col(j));
      if (cross.norm() > 1e-6) axes.emplace_back(cross.normalized());
    }
  }
  const Eigen::Vector3d between = T_map_b.translation() - T_map_a.translation();
  return std::all_of(axes.begin(), axes.end(), [&](const Eigen::Vector3d& axis) {
    const double reach = 0.5 * ((T_map_a.linear().transpose() * axis).cwiseAbs().dot(size_a_m) +
                                (T_map_b.linear().transpose() * axis).cwiseAbs().dot(size_b_m));
    return std::abs(axis.dot(between)) < reach - slack_m;
  });
}

Eigen::AlignedBox3d boxAround(const Eigen::Isometry3d& T_map_body, const Eigen::Vector3d& size_m) {
  const Eigen::Vector3d reach = 0.5 * (T_map_body.linear().cwiseAbs() * size_m);
  return {T_map_body.translation() - reach, T_map_body.translation() + reach};
}

Eigen::Isometry3d nearestSymmetric(const Eigen::Isometry3d& T_map_body, const Eigen::Vector3d& size_m,
                                   const Eigen::Matrix3d& like) {
  Eigen::Isometry3d nearest = T_map_body;
  double best = -INFINITY;
  for (const Eigen::Matrix3d& rotation : rotationsOfTheCube()) {
    if (((rotation.cwiseAbs() * size_m) - size_m).cwiseAbs().maxCoeff() > 1e-3) continue;
    const Eigen::Matrix3d turned = T_map_body.linear() * rotation;
    const double likeness = (like.transpose() * turned).trace();
    if (likeness > best + 1e-9) {
      best = likeness;
      nearest.linear() = turned;
    }
  }
  return nearest;
}

Cuboid alignedLike(const Cuboid& cuboid, const Eigen::Matrix3d& like) {
  Cuboid aligned = cuboid;
  aligned.T_map_body = nearestSymmetric(cuboid.T_map_body, cuboid.size_m, like);
  const Eigen::Matrix3d R_old_new = cuboid.T_map_body.linear().transpose() * aligned.T_map_body.linear();
  for (std::size_t f = 0; f < kBrickFaces.size(); ++f) {
    const Eigen::Vector3d normal_old = R_old_new * faceNormal(kBrickFaces[f]);
    for (std::size_t g = 0; g < kBrickFaces.size(); ++g) {
      if (normal_old.dot(faceNormal(kBrickFaces[g])) > 0.5) aligned.faces[f] = cuboid.faces[g];
    }
  }
  return aligned;
}

double angleBetweenBodies(const Eigen::Isometry3d& T_map_a, const Eigen::Isometry3d& T_map_b,
                          const Eigen::Vector3d& size_m) {
  const Eigen::Isometry3d nearest = nearestSymmetric(T_map_a, size_m, T_map_b.linear());
  return Eigen::AngleAxisd(T_map_b.linear().transpose() * nearest.linear()).angle();
}

Eigen::Matrix3Xd insidePoints(const Eigen::Isometry3d& T_map_body, const Eigen::Vector3d& size_m, double margin_m,
                              int per_edge) {
  Eigen::Matrix3Xd points(3, static_cast<Eigen::Index>(per_edge) * per_edge * per_edge);
  const Eigen::Vector3d room = (0.5 * size_m.array() - margin_m).max(0.0);
  Eigen::Index next = 0;
  const auto at = [per_edge](int i) { return per_edge == 1 ? 0.0 : 2.0 * i / (per_edge - 1) - 1.0; };
  for (int i = 0; i < per_edge; ++i) {
    for (int j = 0; j < per_edge; ++j) {
      for (int k = 0; k < per_edge; ++k) {
        points.col(next++) = T_map_body * room.cwiseProduct(Eigen::Vector3d(at(i), at(j), at(k)));
      }
    }
  }
  return points;
}

}  // namespace surface_picking
