// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/stacking.h"

#include <fcl/narrowphase/collision.h>

namespace pick_mission {
namespace {

constexpr double kLowered_m = 0.03;
constexpr double kShorter_m = 0.005;
/// Of both half heights: bricks side by side differ by less, one that leans on another by more.
constexpr double kLeastRise = 0.25;

bool hasSize(const SeenBrick& brick) {
  return brick.size_m.allFinite() && brick.size_m.minCoeff() > 2.0 * kShorter_m;
}

double halfHeight(const SeenBrick& brick) {
  return 0.5 * brick.T_map_brick.linear().row(2).cwiseAbs().dot(brick.size_m);
}

}  // namespace

bool restsOn(const SeenBrick& upper, const SeenBrick& lower) {
  if (!hasSize(upper) || !hasSize(lower)) return false;
  const double rise_m = upper.T_map_brick.translation().z() - lower.T_map_brick.translation().z();
  if (rise_m < kLeastRise * (halfHeight(upper) + halfHeight(lower))) return false;
  const fcl::Boxd upper_box(Eigen::Vector3d(upper.size_m.array() - 2.0 * kShorter_m));
  const fcl::Boxd lower_box(lower.size_m);
  const Eigen::Isometry3d T_map_lowered = Eigen::Translation3d(0.0, 0.0, -kLowered_m) * upper.T_map_brick;
  fcl::CollisionResultd result;
  return fcl::collide(&upper_box, T_map_lowered, &lower_box, lower.T_map_brick, fcl::CollisionRequestd(), result) > 0;
}

}  // namespace pick_mission
