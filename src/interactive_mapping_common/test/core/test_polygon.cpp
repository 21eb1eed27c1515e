// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common/geometry/polygon.h>

#include <algorithm>
#include <limits>

#include <gmock/gmock.h>

namespace interactive_mapping {
namespace {

using ::testing::HasSubstr;
using Corners = std::vector<Eigen::Vector2d>;

TEST(Polygon, SimpleOnesHaveNoProblem) {
  const Corners hollow{{0.0, 0.0}, {2.0, 0.0}, {2.0, 2.0}, {1.0, 0.5}, {0.0, 2.0}};
  const Corners with_straight_corner{{0.0, 0.0}, {1.0, 0.0}, {2.0, 0.0}, {1.0, 1.0}};
  for (Corners corners : {Corners{{0.0, 0.0}, {1.0, 0.0}, {0.0, 1.0}}, hollow, with_straight_corner}) {
    EXPECT_EQ(problemOfPolygon(corners), "");
    std::reverse(corners.begin(), corners.end());
    EXPECT_EQ(problemOfPolygon(corners), "");
  }
}

TEST(Polygon, OthersAreNamed) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(problemOfPolygon({}), HasSubstr("0 corners, must have at least 3"));
  EXPECT_THAT(problemOfPolygon({{0.0, 0.0}, {1.0, 0.0}}), HasSubstr("2 corners"));
  EXPECT_THAT(problemOfPolygon({{0.0, 0.0}, {1.0, nan}, {1.0, 1.0}}), HasSubstr("corner 1 that is not finite"));
  EXPECT_THAT(problemOfPolygon({{0.0, 0.0}, {1.0, 0.0}, {2.0, 0.0}}), HasSubstr("must have an area"));
  EXPECT_THAT(problemOfPolygon({{0.0, 0.0}, {1.0, 0.0}, {1.0, 0.0}, {0.0, 1.0}}), HasSubstr("must have an area"));
  EXPECT_THAT(problemOfPolygon({{0.0, 0.0}, {1.0, 1.0}, {1.0, 0.0}, {0.0, 1.0}}), HasSubstr("crosses itself"));
  // A corner on another edge.
  EXPECT_THAT(problemOfPolygon({{0.0, 0.0}, {2.0, 0.0}, {2.0, 2.0}, {1.0, 0.0}, {0.0, 2.0}}),
              HasSubstr("crosses itself"));
}

TEST(Polygon, InsideIsByTheEvenOddRule) {
  const Corners hollow{{0.0, 0.0}, {2.0, 0.0}, {2.0, 2.0}, {1.0, 0.5}, {0.0, 2.0}};
  EXPECT_TRUE(isInside(hollow, {0.2, 1.0}));
  EXPECT_TRUE(isInside(hollow, {1.8, 1.0}));
  EXPECT_TRUE(isInside(hollow, {1.0, 0.3}));
  EXPECT_FALSE(isInside(hollow, {1.0, 1.0})) << "in the notch";
  EXPECT_FALSE(isInside(hollow, {2.5, 1.0}));
  EXPECT_FALSE(isInside(hollow, {1.0, -0.1}));
}

}  // namespace
}  // namespace interactive_mapping
