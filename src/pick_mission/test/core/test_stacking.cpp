// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/stacking.h"

#include <limits>

#include <gmock/gmock.h>

namespace pick_mission {
namespace {

SeenBrick brickAt(const Eigen::Vector3d& position_m, double yaw_rad = 0.0) {
  SeenBrick brick;
  brick.T_map_brick =
      Eigen::Translation3d(position_m) * Eigen::Isometry3d(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()));
  brick.size_m = {0.3, 0.2, 0.2};
  return brick;
}

TEST(Stacking, ABrickRestsOnThoseUnderIt) {
  const SeenBrick left = brickAt({-0.16, 0.0, 0.1});
  const SeenBrick right = brickAt({0.16, 0.0, 0.1});
  const SeenBrick bridge = brickAt({0.0, 0.02, 0.3}, 0.1);
  EXPECT_TRUE(restsOn(bridge, left));
  EXPECT_TRUE(restsOn(bridge, right));
  EXPECT_FALSE(restsOn(left, bridge));
  EXPECT_FALSE(restsOn(left, right)) << "side by side";
  EXPECT_FALSE(restsOn(right, left));
  EXPECT_FALSE(restsOn(bridge, bridge));
  EXPECT_FALSE(restsOn(brickAt({0.0, 0.0, 0.5}), left)) << "two layers up";
}

TEST(Stacking, PosesAreWrongByMillimetres) {
  const SeenBrick lower = brickAt({0.0, 0.0, 0.1});
  EXPECT_TRUE(restsOn(brickAt({0.0, 0.0, 0.31}), lower)) << "a gap";
  EXPECT_TRUE(restsOn(brickAt({0.0, 0.0, 0.29}), lower)) << "within it";
  EXPECT_FALSE(restsOn(brickAt({0.305, 0.0, 0.11}), lower)) << "beside it, higher by a pebble";
  EXPECT_FALSE(restsOn(brickAt({0.295, 0.0, 0.11}), lower)) << "beside it, and within it";
  // A corner that reaches over it by less than 5 mm, and one that carries.
  EXPECT_FALSE(restsOn(brickAt({0.297, 0.0, 0.3}), lower));
  EXPECT_TRUE(restsOn(brickAt({0.285, 0.185, 0.3}), lower));
}

TEST(Stacking, OneThatLeansRestsToo) {
  const SeenBrick lower = brickAt({0.0, 0.0, 0.1});
  // On edge before the other's end, its upper part on the other's upper edge.
  SeenBrick leaning = brickAt({0.24, 0.0, 0.2});
  leaning.T_map_brick.linear() = Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitY()).toRotationMatrix();
  EXPECT_TRUE(restsOn(leaning, lower));
  EXPECT_FALSE(restsOn(lower, leaning));
}

TEST(Stacking, WithoutASizeNothingIsKnown) {
  const SeenBrick lower = brickAt({0.0, 0.0, 0.1});
  for (const Eigen::Vector3d& size_m : {Eigen::Vector3d(0.0, 0.0, 0.0), Eigen::Vector3d(0.3, -0.2, 0.2),
                                        Eigen::Vector3d(0.3, std::numeric_limits<double>::quiet_NaN(), 0.2)}) {
    SeenBrick upper = brickAt({0.0, 0.0, 0.3});
    upper.size_m = size_m;
    EXPECT_FALSE(restsOn(upper, lower));
    EXPECT_FALSE(restsOn(lower, upper));
  }
}

}  // namespace
}  // namespace pick_mission
