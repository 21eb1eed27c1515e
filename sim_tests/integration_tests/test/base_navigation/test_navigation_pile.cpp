// SPDX-License-Identifier: BSD-3-Clause
// The whole way: camera, self filter, map, navigation and the base's driver. The robot comes to stand square to each side
// of a pile, with the truth as judge.
#include <algorithm>
#include <limits>
#include <vector>

#include <Eigen/Geometry>

#include "navigation_world.h"

namespace integration_tests {
namespace {

constexpr double kStandOff_m = 0.15;

class NavigationPile : public NavigationTest {
 protected:
  /// Corners of all bricks on the ground plane, truth.
  static std::vector<Eigen::Vector2d> corners() {
    std::vector<Eigen::Vector2d> corners;
    for (const auto& [id, brick] : world->bricks) {
      const auto& q = brick.pose.orientation;
      const Eigen::Matrix3d R = Eigen::Quaterniond(q.w, q.x, q.y, q.z).toRotationMatrix();
      for (const double x : {-0.5, 0.5}) {
        for (const double y : {-0.5, 0.5}) {
          for (const double z : {-0.5, 0.5}) {
            const Eigen::Vector3d p =
                Eigen::Vector3d(brick.pose.position.x, brick.pose.position.y, brick.pose.position.z) +
                R * Eigen::Vector3d(x * brick.scale.x, y * brick.scale.y, z * brick.scale.z);
            corners.emplace_back(p.head<2>());
          }
        }
      }
    }
    return corners;
  }

  /// How far the pile reaches in a direction of the map.
  static double reach(const Eigen::Vector2d& direction) {
    double farthest = -std::numeric_limits<double>::infinity();
    for (const Eigen::Vector2d& corner : corners()) farthest = std::max(farthest, corner.dot(direction));
    return farthest;
  }

  /// The pose that looks at the pile from the side that `outwards` points to, its front at the stand-off.
  static Pose2d stand(const Eigen::Vector2d& outwards) {
    const Eigen::Vector2d p = (reach(outwards) + kStandOff_m + kFront_m) * outwards;
    return {p.x(), p.y(), std::atan2(-outwards.y(), -outwards.x())};
  }

  /// By way of a place from which the next one can be seen.
  static void expectSquareTo(const Eigen::Vector2d& outwards, const std::vector<Pose2d>& by_way_of) {
    for (const Pose2d& place : by_way_of) {
      const NavigationOutcome outcome = world->drive(place, 120.0);
      ASSERT_EQ(static_cast<int>(outcome.status), static_cast<int>(NavigationOutcome::SUCCESS))
          << "to (" << place.x_m << ", " << place.y_m << "): " << outcome.message;
    }
    const Pose2d goal = stand(outwards);
    const NavigationOutcome outcome = world->drive(goal, 120.0);
    ASSERT_EQ(static_cast<int>(outcome.status), static_cast<int>(NavigationOutcome::SUCCESS)) << outcome.message;
    EXPECT_LT(world->drivenInHalfASecond(), 0.001) << "it stands";
    expectAt(goal);
    // The same from the truth's other end: from the robot's front to the nearest brick before it.
    double gap_m = std::numeric_limits<double>::infinity();
    for (const Eigen::Vector2d& corner : corners()) {
      const Pose2d p = simulated_world::compose(simulated_world::inverse(world->pose), {corner.x(), corner.y(), 0.0});
      if (std::abs(p.y_m) < 0.7) gap_m = std::min(gap_m, p.x_m - kFront_m);
    }
    EXPECT_NEAR(gap_m, kStandOff_m, 0.03);
  }
};

TEST_F(NavigationPile, FrontIsReachedSquare) {
  expectSquareTo({-1.0, 0.0}, {});
}

// Straight back before it turns: the base's corners would sweep the bricks.
TEST_F(NavigationPile, LeftSideIsReachedSquare) {
  expectSquareTo({0.0, 1.0}, {{-1.3, 1.5, 0.5}, {-0.2, 2.0, -0.8}});
}

TEST_F(NavigationPile, BackIsReachedSquare) {
  expectSquareTo({1.0, 0.0}, {{1.6, 1.6, -1.8}});
}

TEST_F(NavigationPile, RightSideIsReachedSquare) {
  expectSquareTo({0.0, -1.0}, {{1.6, -1.4, -2.5}, {0.2, -2.0, 2.3}});
}

}  // namespace
}  // namespace integration_tests
