// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/segment.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include <gmock/gmock.h>

#include "support/box_pile.h"
#include "support/polygons.h"

namespace nbv_selection {
namespace {

using base_navigation::Pose2d;
using ::testing::Contains;
using ::testing::Each;
using ::testing::FloatNear;
using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kRounding = 1e-9;  // of sums over an outline of some 10 m, with room

// The simulated base.
const base_navigation::Polygon kFootprint = {{0.296, 0.296}, {-0.527, 0.296}, {-0.527, -0.296}, {0.296, -0.296}};
constexpr double kFront_m = 0.296;
constexpr double kWidth_m = 0.592;

double random(std::mt19937* engine, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(*engine);
}

PileOutline outlineOf(const OutlinePolygon& polygon, const gpis_mapping::GroundPlane& ground = {}) {
  PileOutline outline;
  outline.ground = ground;
  outline.polygons = {polygon};
  return outline;
}

OutlinePolygon rectangle(double length_m, double width_m, double yaw_rad = 0.0) {
  OutlinePolygon polygon{{-0.5 * length_m, -0.5 * width_m},
                         {0.5 * length_m, -0.5 * width_m},
                         {0.5 * length_m, 0.5 * width_m},
                         {-0.5 * length_m, 0.5 * width_m}};
  for (Eigen::Vector2d& corner : polygon) corner = base_navigation::transform({0.0, 0.0, yaw_rad}, corner);
  return polygon;
}

// Corners at increasing angles round the origin, at any distance: concave nearly everywhere.
OutlinePolygon randomStar(std::mt19937* engine) {
  const int corners = std::uniform_int_distribution<int>(3, 24)(*engine);
  const double radius_m = random(engine, 0.05, 2.0);
  OutlinePolygon polygon;
  for (int i = 0; i < corners; ++i) {
    const double angle_rad = 2.0 * M_PI * (i + random(engine, 0.05, 0.95)) / corners;
    polygon.push_back(random(engine, 0.2, 1.0) * radius_m * Eigen::Vector2d(std::cos(angle_rad), std::sin(angle_rad)));
  }
  return polygon;
}

// Corners on an ellipse: convex.
OutlinePolygon randomConvex(std::mt19937* engine) {
  const int corners = std::uniform_int_distribution<int>(4, 12)(*engine);
  const Eigen::Vector2d radius(random(engine, 0.03, 1.5), random(engine, 0.03, 1.5));
  OutlinePolygon polygon;
  for (int i = 0; i < corners; ++i) {
    const double angle_rad = 2.0 * M_PI * (i + random(engine, 0.05, 0.95)) / corners;
    polygon.push_back(radius.cwiseProduct(Eigen::Vector2d(std::cos(angle_rad), std::sin(angle_rad))));
  }
  return polygon;
}

// Where one is after `at_m` along the polygon: walked edge by edge, as often round as it takes.
Eigen::Vector2d walk(const OutlinePolygon& polygon, double at_m) {
  while (at_m < 0.0) at_m += perimeterOf(polygon);
  for (std::size_t i = 0;; i = (i + 1) % polygon.size()) {
    const Eigen::Vector2d step = polygon[(i + 1) % polygon.size()] - polygon[i];
    if (at_m <= step.norm()) return polygon[i] + at_m * step.normalized();
    at_m -= step.norm();
  }
}

Eigen::Vector2d inBase(const Segment& segment, const Eigen::Vector2d& p_map) {
  return base_navigation::transform(base_navigation::inverse(segment.standing_map), p_map);
}

// What every segment on level ground must be.
void expectSound(const Segment& segment, const OutlinePolygon& polygon, const SegmentConfig& config = {}) {
  const Eigen::Vector2d direction = segment.direction_map.head<2>();
  const Eigen::Vector2d outward = segment.outward_map.head<2>();
  ASSERT_NEAR(direction.norm(), 1.0, kRounding);
  ASSERT_NEAR(outward.norm(), 1.0, kRounding);
  EXPECT_NEAR(direction.x() * outward.y() - direction.y() * outward.x(), -1.0, kRounding);  // outwards is to its right
  const Eigen::Vector2d heading(std::cos(segment.standing_map.yaw_rad), std::sin(segment.standing_map.yaw_rad));
  EXPECT_LT((heading + outward).norm(), kRounding);

  // The stretch, in steps of 2 cm and at its corners, from base_link: all of it at least the stand-off before the front
  // edge and beside none of its ends, and some of it no farther.
  const double begin_m = segment.at_m - 0.5 * segment.length_m;
  double nearest_m = std::numeric_limits<double>::infinity();
  const auto look = [&](double at_m) {
    const Eigen::Vector2d p = inBase(segment, walk(polygon, at_m));
    nearest_m = std::min(nearest_m, p.x() - kFront_m);
    EXPECT_LE(std::abs(p.y()), 0.5 * segment.length_m + kRounding);
  };
  const int steps = static_cast<int>(std::ceil(segment.length_m / 0.02));
  for (int i = 0; i <= steps; ++i) look(begin_m + segment.length_m * i / steps);
  double corner_m = 0.0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    for (const double round_m : {-perimeterOf(polygon), 0.0, perimeterOf(polygon)}) {
      if (std::abs(corner_m + round_m - segment.at_m) < 0.5 * segment.length_m) look(corner_m + round_m);
    }
    corner_m += (polygon[(i + 1) % polygon.size()] - polygon[i]).norm();
  }
  EXPECT_NEAR(nearest_m, config.standoff_m, kRounding);

  ASSERT_EQ(segment.samples_map.size(), segment.profile_m.size());
  ASSERT_GE(segment.samples_map.size(), 2U);
  const double step_m = segment.length_m / static_cast<double>(segment.samples_map.size());
  EXPECT_LE(step_m, config.sample_spacing_m + kRounding);
  for (std::size_t j = 0; j < segment.samples_map.size(); ++j) {
    const Eigen::Vector2d expected = walk(polygon, begin_m + (static_cast<double>(j) + 0.5) * step_m);
    EXPECT_LT((segment.samples_map[j].head<2>() - expected).norm(), kRounding);
  }
}

void expectSound(const std::vector<Segment>& segments, const OutlinePolygon& polygon,
                 const SegmentConfig& config = {}) {
  const double perimeter_m = perimeterOf(polygon);
  ASSERT_GE(segments.size(), 4U);
  const double spacing_m = perimeter_m / static_cast<double>(segments.size());
  for (std::size_t i = 0; i < segments.size(); ++i) {
    SCOPED_TRACE("segment " + std::to_string(i) + " at " + std::to_string(segments[i].at_m));
    expectSound(segments[i], polygon, config);
    EXPECT_NEAR(segments[i].length_m, std::min(kWidth_m, 0.5 * perimeter_m), kRounding);
    EXPECT_GT(segments[i].length_m, spacing_m);  // its neighbours' begin before it ends
    if (i > 0) {
      EXPECT_NEAR(segments[i].at_m - segments[i - 1].at_m, spacing_m, kRounding);
    }
  }
  EXPECT_NEAR(segments.front().at_m + perimeter_m - segments.back().at_m, spacing_m, kRounding);
}

TEST(Segment, AreFiftyRoundFourSquareMetres) {
  const OutlinePolygon square = rectangle(2.0, 2.0, 0.3);
  const std::vector<Segment> segments = cutSegments(outlineOf(square), kFootprint, {});
  ASSERT_THAT(segments, SizeIs(50));  // 8 m / 0.16 m
  expectSound(segments, square);
  EXPECT_NEAR(segments[1].at_m - segments[0].at_m, 0.16, kRounding);
}

TEST(Segment, IsExactOnAStraightSide) {
  const double yaw_rad = 0.3;
  const OutlinePolygon square = rectangle(2.0, 2.0, yaw_rad);
  const SegmentConfig config;
  int straight = 0;
  for (const Segment& segment : cutSegments(outlineOf(square), kFootprint, config)) {
    const int side = static_cast<int>(segment.at_m / 2.0);
    const double along_m = segment.at_m - 2.0 * side;
    if (along_m < 0.5 * kWidth_m || along_m > 2.0 - 0.5 * kWidth_m) continue;
    ++straight;
    const double side_rad = yaw_rad + 0.5 * M_PI * side;
    const Eigen::Vector3d direction(std::cos(side_rad), std::sin(side_rad), 0.0);
    const Eigen::Vector3d outward(std::sin(side_rad), -std::cos(side_rad), 0.0);
    const Eigen::Vector3d midpoint = (along_m - 1.0) * direction + outward;
    EXPECT_LT((segment.direction_map - direction).norm(), kRounding);
    EXPECT_LT((segment.outward_map - outward).norm(), kRounding);
    EXPECT_LT((segment.midpoint_map - midpoint).norm(), kRounding);
    const Eigen::Vector3d standing = midpoint + (config.standoff_m + kFront_m) * outward;
    EXPECT_LT((segment.standing_map.position() - standing.head<2>()).norm(), kRounding);
    EXPECT_NEAR(base_navigation::wrapAngle(segment.standing_map.yaw_rad - side_rad - 0.5 * M_PI), 0.0, kRounding);
  }
  EXPECT_EQ(straight, 4 * 9);  // 1.41 m of each side hold 8.8 of them: 8 or 9, here 9 by where the first one is
}

TEST(Segment, KeepsItsStandOffRoundCorners) {
  const OutlinePolygon l_shape{{-1.0, -1.0}, {1.0, -1.0}, {1.0, 0.0}, {0.0, 0.0}, {0.0, 1.0}, {-1.0, 1.0}};
  const OutlinePolygon slot{{-1.0, -1.0}, {1.0, -1.0}, {1.0, 1.0},  {0.2, 1.0},
                            {0.2, 0.0},   {-0.2, 0.0}, {-0.2, 1.0}, {-1.0, 1.0}};
  const OutlinePolygon wedge{{0.0, 0.0}, {2.0, -0.1}, {2.0, 0.1}};
  for (const OutlinePolygon& polygon : {l_shape, slot, wedge}) {
    for (const double standoff_m : {0.0, 0.12, 0.5}) {
      SegmentConfig config;
      config.standoff_m = standoff_m;
      expectSound(cutSegments(outlineOf(polygon), kFootprint, config), polygon, config);
    }
  }
}

TEST(Segment, LooksAcrossAConcaveCorner) {
  // Its middle in the corner itself: the line from arm to arm is at 45 degrees, half a width's root of a half away.
  const OutlinePolygon l_shape{{-1.0, -1.0}, {1.0, -1.0}, {1.0, 0.0}, {0.0, 0.0}, {0.0, 1.0}, {-1.0, 1.0}};  // 8 m
  SegmentConfig config;
  config.spacing_m = 8.0 / 8.0 / 2.0;  // at 0.25, 0.75, ...
  OutlinePolygon shifted = l_shape;
  shifted.insert(shifted.begin(), {-1.0, -0.75});  // the first of them at the first corner: then one at each
  const std::vector<Segment> segments = cutSegments(outlineOf(shifted), kFootprint, config);
  const auto corner = std::find_if(segments.begin(), segments.end(),
                                   [](const Segment& segment) { return std::abs(segment.at_m - 4.25) < 1e-6; });
  ASSERT_NE(corner, segments.end());
  const double half = std::sqrt(0.5);
  EXPECT_LT((corner->outward_map - Eigen::Vector3d(half, half, 0.0)).norm(), kRounding);
  EXPECT_LT((corner->midpoint_map - Eigen::Vector3d(0.25 * kWidth_m, 0.25 * kWidth_m, 0.0)).norm(), kRounding);
}

TEST(Segment, KeepsItsStandOffOnAThousandStars) {
  std::mt19937 engine(1);
  std::size_t number = 0;
  for (int i = 0; i < 1000; ++i) {
    const OutlinePolygon star = randomStar(&engine);
    SCOPED_TRACE("star " + std::to_string(i));
    const std::vector<Segment> segments = cutSegments(outlineOf(star), kFootprint, {});
    expectSound(segments, star);
    number += segments.size();
    if (::testing::Test::HasFailure()) break;
  }
  EXPECT_GT(number, 10000U);
}

TEST(Segment, IsTheChordOfItsStretch) {
  std::mt19937 engine(2);
  int compared = 0;
  for (int i = 0; i < 100; ++i) {
    const OutlinePolygon star = randomStar(&engine);
    for (const Segment& segment : cutSegments(outlineOf(star), kFootprint, {})) {
      const Eigen::Vector2d chord =
          walk(star, segment.at_m + 0.5 * segment.length_m) - walk(star, segment.at_m - 0.5 * segment.length_m);
      if (chord.norm() < 0.02 * segment.length_m) continue;  // all but none
      ++compared;
      EXPECT_LT((segment.direction_map.head<2>() - chord.normalized()).norm(), kRounding);
    }
  }
  EXPECT_GT(compared, 1000);
}

TEST(Segment, StandsClearOfAllOfAConvexPile) {
  std::mt19937 engine(3);
  const SegmentConfig config;
  for (int i = 0; i < 300; ++i) {
    const OutlinePolygon polygon = randomConvex(&engine);
    for (const Segment& segment : cutSegments(outlineOf(polygon), kFootprint, config)) {
      for (const Eigen::Vector2d& corner : polygon) {
        ASSERT_GE(inBase(segment, corner).x(), kFront_m + config.standoff_m - kRounding) << "polygon " << i;
      }
    }
  }
}

TEST(Segment, LooksAtASingleBrickFromAllSides) {
  struct Brick {
    Eigen::Vector2d size_m;
    double largest_gap_rad;  // between headings next to each other
  };
  // Shorter round than the robot is wide, about as long, longer: three places round would leave 2/3 pi. Nobody stands
  // squarely before the end of a plank unless a middle happens to lie on it, but somebody on either hand of it.
  for (const Brick& brick : {Brick{{0.04, 0.04}, 2.0 / 3.0 * M_PI}, Brick{{0.2, 0.1}, 2.0 / 3.0 * M_PI},
                             Brick{{0.24, 0.24}, 2.0 / 3.0 * M_PI}, Brick{{1.0, 0.04}, M_PI}}) {
    const OutlinePolygon polygon = rectangle(brick.size_m.x(), brick.size_m.y(), 0.5);
    const std::vector<Segment> segments = cutSegments(outlineOf(polygon), kFootprint, {});
    SCOPED_TRACE(brick.size_m.transpose());
    expectSound(segments, polygon);
    std::vector<double> headings;
    for (const Segment& segment : segments) {
      headings.push_back(segment.standing_map.yaw_rad);
      EXPECT_GT(inBase(segment, {0.0, 0.0}).x(), kFront_m);  // the brick's middle is before it
      EXPECT_LT(segment.length_m, 0.5 * perimeterOf(polygon) + kRounding);
    }
    std::sort(headings.begin(), headings.end());
    headings.push_back(headings.front() + 2.0 * M_PI);
    for (std::size_t i = 0; i + 1 < headings.size(); ++i) {
      EXPECT_LT(headings[i + 1] - headings[i], brick.largest_gap_rad);
    }
  }
}

TEST(Segment, OverlapsAndHasTwoSamplesHoweverCoarse) {
  SegmentConfig config;
  config.spacing_m = kWidth_m;  // the most that is allowed
  config.sample_spacing_m = 0.5;
  for (double side_m = 0.1; side_m < 1.0; side_m += 0.017) {
    const OutlinePolygon square = rectangle(side_m, side_m);
    const std::vector<Segment> segments = cutSegments(outlineOf(square), kFootprint, config);
    for (const Segment& segment : segments) {
      EXPECT_GE(segment.samples_map.size(), 2U);
      EXPECT_GE(segment.length_m, 4.0 * side_m / static_cast<double>(segments.size()) - kRounding);  // no gap between
    }
  }
}

TEST(Segment, HasADirectionWhereTheOutlineMeetsItself) {
  // A slit of no width: the stretch about its bottom ends where it began.
  const OutlinePolygon slit{{0.0, -0.5}, {1.0, -0.5}, {1.0, 0.5},  {0.0, 0.5},
                            {0.0, 0.0},  {0.0, 0.5},  {-1.0, 0.5}, {-1.0, -0.5}};
  SegmentConfig config;
  config.spacing_m = perimeterOf(slit) / 43.0;  // odd: one is at the bottom, halfway round
  const std::vector<Segment> segments = cutSegments(outlineOf(slit), kFootprint, config);
  ASSERT_THAT(segments, SizeIs(43));
  ASSERT_NEAR(segments[21].at_m, 0.5 * perimeterOf(slit), kRounding);
  expectSound(segments, slit, config);
}

TEST(Segment, MeasuresOnTheTiltedGround) {
  for (const double uphill_rad : {0.0, 0.8, 2.0, -2.5}) {
    const gpis_mapping::GroundPlane ground = tiltedGround(0.2, uphill_rad, 0.7);
    const OutlinePolygon polygon = rectangle(2.0, 1.0, 0.4);
    const SegmentConfig config;
    const std::vector<Segment> segments = cutSegments(outlineOf(polygon, ground), kFootprint, config);
    double perimeter_m = 0.0;  // of the corners lifted to the plane
    for (std::size_t i = 0; i < polygon.size(); ++i) {
      const Eigen::Vector2d& a = polygon[i];
      const Eigen::Vector2d& b = polygon[(i + 1) % polygon.size()];
      perimeter_m +=
          Eigen::Vector3d(b.x() - a.x(), b.y() - a.y(), ground.zAt(b.x(), b.y()) - ground.zAt(a.x(), a.y())).norm();
    }
    ASSERT_EQ(segments.size(), static_cast<std::size_t>(std::lround(perimeter_m / config.spacing_m)));
    for (std::size_t i = 0; i < segments.size(); ++i) {
      const Segment& segment = segments[i];
      EXPECT_NEAR(segment.at_m, (static_cast<double>(i) + 0.5) * perimeter_m / static_cast<double>(segments.size()),
                  kRounding);
      EXPECT_NEAR(segment.length_m, kWidth_m, kRounding);
      EXPECT_NEAR(segment.direction_map.norm(), 1.0, kRounding);
      EXPECT_NEAR(segment.direction_map.dot(ground.normal_map), 0.0, kRounding);
      EXPECT_LT((segment.direction_map.cross(ground.normal_map) - segment.outward_map).norm(), kRounding);
      EXPECT_NEAR(ground.heightOf(segment.midpoint_map), 0.0, kRounding);
      double nearest_m = std::numeric_limits<double>::infinity();
      for (std::size_t j = 0; j < segment.samples_map.size(); ++j) {
        const Eigen::Vector3d& sample = segment.samples_map[j];
        EXPECT_NEAR(ground.heightOf(sample), 0.0, kRounding);
        EXPECT_LT(distanceToOutline(polygon, sample.head<2>()), kRounding);
        nearest_m = std::min(nearest_m, segment.outward_map.dot(segment.midpoint_map - sample));
        EXPECT_LE(std::abs(segment.direction_map.dot(segment.midpoint_map - sample)), 0.5 * kWidth_m);
        if (j == 0) continue;
        // Along a side they are evenly apart; round a corner the straight way is shorter.
        const double step_m = segment.length_m / static_cast<double>(segment.samples_map.size());
        EXPECT_LE((sample - segment.samples_map[j - 1]).norm(), step_m + kRounding);
      }
      EXPECT_GE(nearest_m, -kRounding);
      // The base on the plane: its x axis above its heading, base_link the stand-off and its front away.
      const double c = std::cos(segment.standing_map.yaw_rad);
      const double s = std::sin(segment.standing_map.yaw_rad);
      const Eigen::Vector3d& n = ground.normal_map;
      const Eigen::Vector3d forward = Eigen::Vector3d(c, s, -(n.x() * c + n.y() * s) / n.z()).normalized();
      EXPECT_LT((forward + segment.outward_map).norm(), kRounding);
      const Eigen::Vector3d base(segment.standing_map.x_m, segment.standing_map.y_m,
                                 ground.zAt(segment.standing_map.x_m, segment.standing_map.y_m));
      EXPECT_LT((base + (config.standoff_m + kFront_m) * forward - segment.midpoint_map).norm(), kRounding);
    }
  }
}

TEST(Segment, TurnsAndMovesWithThePile) {
  std::mt19937 engine(4);
  const OutlinePolygon star = randomStar(&engine);
  const Pose2d motion{3.0, -7.0, 2.2};
  OutlinePolygon moved;
  for (const Eigen::Vector2d& corner : star) moved.push_back(base_navigation::transform(motion, corner));
  const std::vector<Segment> here = cutSegments(outlineOf(star), kFootprint, {});
  const std::vector<Segment> there = cutSegments(outlineOf(moved), kFootprint, {});
  ASSERT_EQ(here.size(), there.size());
  for (std::size_t i = 0; i < here.size(); ++i) {
    const Pose2d expected = base_navigation::compose(motion, here[i].standing_map);
    EXPECT_LT((expected.position() - there[i].standing_map.position()).norm(), 1e-8);
    EXPECT_NEAR(base_navigation::wrapAngle(expected.yaw_rad - there[i].standing_map.yaw_rad), 0.0, 1e-8);
  }
}

TEST(Segment, StandsOffByTheForemostPointOfTheFootprint) {
  const base_navigation::Polygon nosed{{0.5, 0.0}, {0.2, 0.3}, {-0.4, 0.3}, {-0.4, -0.2}, {0.2, -0.2}};
  const OutlinePolygon square = rectangle(2.0, 2.0);
  const std::vector<Segment> segments = cutSegments(outlineOf(square), nosed, {});
  const Segment& segment = segments[6];  // amid the lower side
  ASSERT_NEAR(segment.direction_map.x(), 1.0, kRounding);
  EXPECT_NEAR(segment.standing_map.y_m, -1.0 - 0.12 - 0.5, kRounding);
  EXPECT_NEAR(segment.length_m, 0.5, kRounding);  // from -0.2 to 0.3
}

// Whether a line goes through the inside of a cell: where it is between both pairs of its sides at once.
bool crosses(const Eigen::Vector2d& begin, const Eigen::Vector2d& end, const Eigen::Vector2d& corner, double size_m) {
  double enter = 0.0;
  double leave = 1.0;
  for (int axis = 0; axis < 2; ++axis) {
    const double a = (corner(axis) - begin(axis)) / (end(axis) - begin(axis));
    const double b = (corner(axis) + size_m - begin(axis)) / (end(axis) - begin(axis));
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter + 1e-8 < leave;  // not by a corner
}

// Direction on the ground of the edge of the only polygon that the point is on.
Eigen::Vector3d edgeAt(const PileOutline& outline, const Eigen::Vector2d& p) {
  const OutlinePolygon& polygon = outline.polygons.front();
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d& a = polygon[i];
    const Eigen::Vector2d& b = polygon[(i + 1) % polygon.size()];
    if (std::abs((p - a).norm() + (b - p).norm() - (b - a).norm()) > 1e-10) continue;  // it is longer by way of p
    const double rise_m = outline.ground.zAt(b.x(), b.y()) - outline.ground.zAt(a.x(), a.y());
    return Eigen::Vector3d(b.x() - a.x(), b.y() - a.y(), rise_m).normalized();
  }
  return Eigen::Vector3d::Constant(kNan);
}

TEST(Segment, ProfileIsTheHighestCellInwards) {
  std::mt19937 engine(5);
  int flat = 0;
  int high = 0;
  for (int i = 0; i < 40; ++i) {
    PileOutline outline =
        outlineOf(randomStar(&engine), tiltedGround(random(&engine, 0.0, 0.2), random(&engine, -3.0, 3.0)));
    PileGrid& grid = outline.grid;
    grid.cell_size_m = 0.04;
    grid.origin_m = {-0.9, -1.1};  // some outlines reach beyond it
    grid.width = 60;
    grid.height = 45;
    for (int k = 0; k < grid.width * grid.height; ++k) {
      const double die = random(&engine, 0.0, 1.0);
      grid.is_pile.push_back(die < 0.2 ? 1 : 0);
      grid.is_occupied.push_back(die < 0.1 || die > 0.9 ? 1 : 0);  // closed cells, and specks
      grid.height_m.push_back(grid.is_occupied.back() != 0 ? static_cast<float>(random(&engine, 0.04, 1.0))
                                                           : static_cast<float>(kNan));
    }
    SegmentConfig config;
    config.profile_depth_m = random(&engine, 0.05, 0.5);
    for (const Segment& segment : cutSegments(outline, kFootprint, config)) {
      for (std::size_t j = 0; j < segment.samples_map.size(); j += 3) {
        const Eigen::Vector2d begin = segment.samples_map[j].head<2>();
        const Eigen::Vector3d inwards = outline.ground.normal_map.cross(edgeAt(outline, begin));
        const Eigen::Vector2d end = begin + config.profile_depth_m * inwards.head<2>();
        float expected_m = 0.0F;
        for (int row = 0; row < grid.height; ++row) {
          for (int column = 0; column < grid.width; ++column) {
            const std::size_t index = grid.index(column, row);
            if (grid.is_pile[index] == 0 || std::isnan(grid.height_m[index])) continue;
            const Eigen::Vector2d corner = grid.origin_m + grid.cell_size_m * Eigen::Vector2d(column, row);
            if (crosses(begin, end, corner, grid.cell_size_m)) expected_m = std::max(expected_m, grid.height_m[index]);
          }
        }
        ASSERT_EQ(segment.profile_m[j], expected_m) << "outline " << i << ", at " << begin.transpose();
        ++(expected_m > 0.0F ? high : flat);
      }
    }
  }
  EXPECT_GT(flat, 500);
  EXPECT_GT(high, 500);
}

TEST(Segment, ProfileSeesAsDeepAsAsked) {
  BoxPile pile;  // a low step before a high one, 0.2 m behind its edge
  pile.add({0.0, -0.5}, {2.0, 1.0, 0.2});
  pile.add({0.0, -0.4}, {1.6, 0.8, 0.6});
  const PileOutline outline = outlinePile(sampleSurface(pile), pile.ground, {});
  for (const auto& [depth_m, height_m] : {std::pair(0.15, 0.2F), std::pair(0.25, 0.6F)}) {
    SegmentConfig config;
    config.profile_depth_m = depth_m;
    int front = 0;
    for (const Segment& segment : cutSegments(outline, kFootprint, config)) {
      if (segment.outward_map.y() > -0.999 || std::abs(segment.midpoint_map.x()) > 0.4) continue;
      ++front;
      EXPECT_THAT(segment.profile_m, Each(FloatNear(height_m, 1e-6F)));
    }
    EXPECT_GE(front, 4);
  }
}

TEST(Segment, ProfileOfABoxIsItsHeight) {
  std::mt19937 engine(6);
  int compared = 0;
  for (int i = 0; i < 20; ++i) {
    BoxPile pile;
    pile.ground = tiltedGround(random(&engine, 0.0, 0.2), random(&engine, -3.0, 3.0));
    pile.add({0.0, 0.0}, {random(&engine, 0.5, 2.0), random(&engine, 0.5, 2.0), 0.3}, random(&engine, -3.0, 3.0));
    const PileOutline outline = outlinePile(sampleSurface(pile), pile.ground, {});
    ASSERT_THAT(outline.polygons, SizeIs(1));
    for (const Segment& segment : cutSegments(outline, kFootprint, {})) {
      double sum_m = 0.0;
      for (std::size_t j = 0; j < segment.samples_map.size(); ++j) {
        sum_m += segment.profile_m[j];
        // The outline is farther out than the box by a cell's diagonal and the tolerance at most: 87 mm. So near to a
        // corner, what looks along one side of the box may miss it.
        double corner_m = std::numeric_limits<double>::infinity();
        for (const Eigen::Vector2d& corner : outline.polygons.front()) {
          corner_m = std::min(corner_m, (corner - segment.samples_map[j].head<2>()).norm());
        }
        if (corner_m < 0.087) continue;
        ++compared;
        EXPECT_NEAR(segment.profile_m[j], 0.3, 1e-6);  // of floats
      }
      // A corner has 2 x 87 mm of a stretch of 592 mm.
      EXPECT_GT(sum_m / static_cast<double>(segment.samples_map.size()), 0.7 * 0.3);
    }
  }
  EXPECT_GT(compared, 5000);
}

TEST(Segment, NeighboursWrapOnTheirOutline) {
  PileOutline outline;
  outline.polygons = {rectangle(2.0, 2.0), rectangle(0.2, 0.1), rectangle(1.0, 0.5)};
  const std::vector<Segment> segments = cutSegments(outline, kFootprint, {});
  ASSERT_THAT(segments, SizeIs(50 + 4 + 19));
  for (std::size_t i = 0; i < segments.size(); ++i) {
    // The nearest by arc length, either way.
    const double perimeter_m = perimeterOf(outline.polygons[segments[i].outline]);
    std::size_t before = i;
    std::size_t after = i;
    double before_m = perimeter_m;
    double after_m = perimeter_m;
    for (std::size_t k = 0; k < segments.size(); ++k) {
      if (k == i || segments[k].outline != segments[i].outline) continue;
      const double ahead_m = std::fmod(segments[k].at_m - segments[i].at_m + perimeter_m, perimeter_m);
      if (ahead_m < after_m) after = k, after_m = ahead_m;
      if (perimeter_m - ahead_m < before_m) before = k, before_m = perimeter_m - ahead_m;
    }
    EXPECT_EQ(neighbours(segments, i), std::make_pair(before, after)) << i;
  }
  EXPECT_EQ(neighbours({segments[3]}, 0), std::make_pair(std::size_t{0}, std::size_t{0}));
  EXPECT_THROW(neighbours(segments, segments.size()), std::invalid_argument);
}

TEST(Segment, OfNothingIsNone) {
  EXPECT_TRUE(cutSegments({}, kFootprint, {}).empty());
}

TEST(Segment, NamesWhatIsImpossible) {
  SegmentConfig config;
  EXPECT_TRUE(interactive_mapping::problemsOf(config).empty());
  config.spacing_m = 0.0;
  config.standoff_m = -0.1;
  config.sample_spacing_m = kNan;
  config.profile_depth_m = 3.0;
  const std::vector<std::string> problems = interactive_mapping::problemsOf(config);
  EXPECT_THAT(problems, SizeIs(4));
  for (const char* key :
       {"spacing_m = 0 m", "standoff_m = -0.1 m", "sample_spacing_m = nan m", "profile_depth_m = 3 m"}) {
    EXPECT_THAT(problems, Contains(HasSubstr(std::string(key) + ", must be in")));
  }
  EXPECT_THROW(cutSegments({}, kFootprint, config), std::invalid_argument);

  const auto whatOf = [](const PileOutline& outline, const base_navigation::Polygon& footprint,
                         const SegmentConfig& with) {
    try {
      cutSegments(outline, footprint, with);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  SegmentConfig wide;
  wide.spacing_m = 0.6;
  EXPECT_THAT(whatOf({}, kFootprint, wide), HasSubstr("spacing_m = 0.6"));
  base_navigation::Polygon clockwise(kFootprint.rbegin(), kFootprint.rend());
  EXPECT_THAT(whatOf({}, clockwise, {}), HasSubstr("footprint: polygon must be convex"));
  base_navigation::Polygon ahead = kFootprint;
  for (Eigen::Vector2d& corner : ahead) corner.x() += 1.0;
  EXPECT_THAT(whatOf({}, ahead, {}), HasSubstr("footprint: "));
  EXPECT_THAT(whatOf({}, {}, {}), HasSubstr("footprint: "));

  OutlinePolygon square = rectangle(1.0, 1.0);
  EXPECT_EQ(whatOf(outlineOf(square), kFootprint, {}), "");
  EXPECT_THAT(whatOf(outlineOf({square.rbegin(), square.rend()}), kFootprint, {}),
              HasSubstr("outline 0 goes round clockwise"));
  EXPECT_THAT(whatOf(outlineOf({square[0], square[1]}), kFootprint, {}), HasSubstr("outline 0 has 2 corners"));
  EXPECT_THAT(whatOf(outlineOf({square[0], square[1], square[1], square[2]}), kFootprint, {}),
              HasSubstr("corner 1 of outline 0"));
  square[2].x() = kNan;
  EXPECT_THAT(whatOf(outlineOf(square), kFootprint, {}), HasSubstr("corner 2 of outline 0 is not finite"));
  gpis_mapping::GroundPlane wall;
  wall.normal_map = Eigen::Vector3d::UnitX();
  EXPECT_THAT(whatOf(outlineOf(rectangle(1.0, 1.0), wall), kFootprint, {}), HasSubstr("normal"));
}

}  // namespace
}  // namespace nbv_selection
