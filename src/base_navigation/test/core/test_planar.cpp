// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/planar.h"

#include <limits>
#include <stdexcept>

#include <gmock/gmock.h>

namespace base_navigation {
namespace {

const Polygon kBody = {{0.296, 0.296}, {-0.527, 0.296}, {-0.527, -0.296}, {0.296, -0.296}};

TEST(Planar, InverseUndoes) {
  const Pose2d pose{1.0, -2.0, 2.5};
  const Pose2d none = compose(pose, inverse(pose));
  EXPECT_NEAR(none.x_m, 0.0, 1e-12);
  EXPECT_NEAR(none.y_m, 0.0, 1e-12);
  EXPECT_NEAR(none.yaw_rad, 0.0, 1e-12);
}

TEST(Planar, ArcIsTheLimitOfShortLines) {
  for (const double turn_rad : {0.0, 1e-9, 1e-3, 0.7, -2.0, 5.0}) {
    for (const double length_m : {0.0, 1.2, -0.8}) {
      Pose2d slow{0.3, -0.1, 0.4};
      const Pose2d arc = moveAlongArc(slow, length_m, turn_rad);
      constexpr int kSteps = 20000;
      for (int i = 0; i < kSteps; ++i) {  // midpoint rule: its error falls with the square of the step
        const double middle_rad = 0.4 + turn_rad * (i + 0.5) / kSteps;
        slow.x_m += length_m / kSteps * std::cos(middle_rad);
        slow.y_m += length_m / kSteps * std::sin(middle_rad);
      }
      EXPECT_NEAR(arc.x_m, slow.x_m, 1e-7) << length_m << " " << turn_rad;
      EXPECT_NEAR(arc.y_m, slow.y_m, 1e-7) << length_m << " " << turn_rad;
      EXPECT_NEAR(wrapAngle(arc.yaw_rad - 0.4 - turn_rad), 0.0, 1e-12);
    }
  }
}

TEST(Planar, PaddingMovesEveryEdgeOut) {
  const Polygon padded = padPolygon(kBody, 0.1);
  EXPECT_NEAR(inscribedRadius(padded), 0.396, 1e-12);
  EXPECT_NEAR(padded[1].x(), -0.627, 1e-12);
  EXPECT_NEAR(circumscribedRadius(kBody), std::hypot(0.527, 0.296), 1e-12);
  const Polygon triangle = {{1.0, 0.0}, {-1.0, 1.0}, {-1.0, -1.0}};
  EXPECT_NEAR(inscribedRadius(padPolygon(triangle, 0.25)), inscribedRadius(triangle) + 0.25, 1e-12);
}

TEST(Planar, RefusesWhatIsNoFootprint) {
  Polygon clockwise(kBody.rbegin(), kBody.rend());
  Polygon nan = kBody;
  nan[2].x() = std::numeric_limits<double>::quiet_NaN();
  const Polygon star = {{1, 0}, {-0.809, 0.588}, {0.309, -0.951}, {0.309, 0.951}, {-0.809, -0.588}};
  const Polygon two = {{1, 0}, {-1, 0}};
  for (const Polygon& polygon : {clockwise, nan, star, two, Polygon{}}) {
    EXPECT_THROW(padPolygon(polygon, 0.0), std::invalid_argument);
  }
  EXPECT_THROW(padPolygon(kBody, -0.1), std::invalid_argument);
  EXPECT_THROW(padPolygon(kBody, std::numeric_limits<double>::infinity()), std::invalid_argument);
  EXPECT_THROW(inscribedRadius({{2, 0}, {1, 1}, {1, -1}}), std::invalid_argument);  // beside the origin
}

}  // namespace
}  // namespace base_navigation
