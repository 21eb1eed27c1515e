// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/outline.h"

#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <utility>

#include <gmock/gmock.h>

#include "support/box_pile.h"
#include "support/polygons.h"

namespace nbv_selection {
namespace {

using interactive_mapping::problemsOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kRounding_m = 1e-9;  // of sums of a few metres in doubles, with room

PileOutline outlineOf(const BoxPile& pile, const OutlineConfig& config = {}) {
  return outlinePile(sampleSurface(pile), pile.ground, config);
}

double random(std::mt19937* engine, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(*engine);
}

// Boxes thrown down near each other, standing on the ground, some into each other.
BoxPile randomPile(std::mt19937* engine, int num_boxes, double extent_m) {
  BoxPile pile;
  for (int i = 0; i < num_boxes; ++i) {
    const Eigen::Vector2d middle(random(engine, -extent_m, extent_m), random(engine, -extent_m, extent_m));
    const Eigen::Vector3d size(random(engine, 0.08, 0.5), random(engine, 0.08, 0.5), random(engine, 0.1, 0.4));
    pile.add(middle, size, random(engine, -M_PI, M_PI));
  }
  return pile;
}

// Of the boxes seen from above, on level ground: counted in squares of 4 mm.
double unionArea(const BoxPile& pile) {
  constexpr double kSquare_m = 0.004;
  long number = 0;
  for (double x_m = -2.0; x_m < 2.0; x_m += kSquare_m) {
    for (double y_m = -2.0; y_m < 2.0; y_m += kSquare_m) {
      number += isFull(pile, {x_m, y_m, 0.05}) ? 1 : 0;
    }
  }
  return static_cast<double>(number) * kSquare_m * kSquare_m;
}

Eigen::Vector2d middleOf(const PileGrid& grid, int column, int row) {
  return grid.origin_m + grid.cell_size_m * Eigen::Vector2d(column + 0.5, row + 0.5);
}

// Of the nearest cell of the pile, as a square.
double distanceToPile(const PileGrid& grid, const Eigen::Vector2d& p) {
  double nearest_m = kInfinity;
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) {
      if (grid.is_pile[grid.index(column, row)] == 0) continue;
      const Eigen::Vector2d gap = (p - middleOf(grid, column, row)).cwiseAbs().array() - 0.5 * grid.cell_size_m;
      nearest_m = std::min(nearest_m, gap.cwiseMax(0.0).norm());
    }
  }
  return nearest_m;
}

// Whether two of its edges cross each other, each inside of the other.
bool crossesItself(const OutlinePolygon& polygon) {
  const auto side = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& p) {
    const double area_m2 = (b - a).x() * (p - a).y() - (b - a).y() * (p - a).x();
    return std::abs(area_m2) < 1e-12 ? 0 : area_m2 > 0.0 ? 1 : -1;
  };
  const std::size_t n = polygon.size();
  for (std::size_t i = 0; i < n; ++i) {
    const Eigen::Vector2d& a = polygon[i];
    const Eigen::Vector2d& b = polygon[(i + 1) % n];
    for (std::size_t k = i + 2; k < n; ++k) {
      const Eigen::Vector2d& c = polygon[k];
      const Eigen::Vector2d& d = polygon[(k + 1) % n];
      if (side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0) return true;
    }
  }
  return false;
}

// What every outline must be, whatever the pile.
void expectSound(const PileOutline& outline, double tolerance_m) {
  const PileGrid& grid = outline.grid;
  for (std::size_t i = 0; i < outline.polygons.size(); ++i) {
    const OutlinePolygon& polygon = outline.polygons[i];
    ASSERT_GE(polygon.size(), 3U);
    EXPECT_GT(areaOf(polygon), 0.0) << "clockwise";
    if (i > 0) {
      EXPECT_LE(areaOf(polygon), areaOf(outline.polygons[i - 1]) + 1e-12);  // up to rounding
    }
    for (std::size_t k = 0; k < polygon.size(); ++k) {
      EXPECT_GT((polygon[k] - polygon[(k + 1) % polygon.size()]).norm(), 0.0);
      // A corner's edges move out by the tolerance at most, and the corner to where they meet by at most twice.
      EXPECT_LE(distanceToPile(grid, polygon[k]), 2.0 * tolerance_m + kRounding_m);
    }
  }
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) {
      if (grid.is_pile[grid.index(column, row)] == 0) continue;
      const Eigen::Vector2d middle = middleOf(grid, column, row);
      int holders = 0;
      for (const OutlinePolygon& polygon : outline.polygons) holders += turnsAround(polygon, middle) > 0 ? 1 : 0;
      if (holders > 0) continue;
      // A tolerance of several cells may cut a corner of many short edges off, by less than itself.
      double outside_m = kInfinity;
      for (const OutlinePolygon& polygon : outline.polygons) {
        outside_m = std::min(outside_m, distanceToOutline(polygon, middle));
      }
      EXPECT_GT(tolerance_m, 1.5 * grid.cell_size_m) << "cell at " << middle.transpose();
      EXPECT_LT(outside_m, tolerance_m) << "cell at " << middle.transpose();
    }
  }
}

TEST(Outline, GoesRoundTheOuterEdgesOfTheCells) {
  BoxPile pile;
  pile.add({0.01, -0.01}, {2.0, 2.0, 0.3});  // reaches from -0.99 to 1.01 and from -1.01 to 0.99: in the midst of cells
  const PileOutline outline = outlineOf(pile);
  ASSERT_THAT(outline.polygons, SizeIs(1));
  ASSERT_THAT(outline.polygons.front(), SizeIs(4));
  // Cells of 4 cm: x from -25 to 26 of them, y from -26 to 25. The outline is of whole cells, not of their middles.
  const OutlinePolygon expected{{-1.0, -1.04}, {1.04, -1.04}, {1.04, 1.0}, {-1.0, 1.0}};
  for (int i = 0; i < 4; ++i) EXPECT_LT((outline.polygons.front()[i] - expected[i]).norm(), kRounding_m) << i;
}

TEST(Outline, HoldsEveryCellOfAnyPile) {
  std::mt19937 engine(1);
  int polygons = 0;
  for (int i = 0; i < 150; ++i) {
    OutlineConfig config;
    config.closing_m = i % 3 == 0 ? 0.0 : 0.12;
    config.tolerance_m = i % 4 == 0 ? 0.0 : random(&engine, 0.005, i % 4 == 1 ? 0.2 : 0.04);
    const PileOutline outline = outlineOf(randomPile(&engine, 1 + i % 7, 0.6), config);
    SCOPED_TRACE("pile " + std::to_string(i) + ", tolerance " + std::to_string(config.tolerance_m));
    expectSound(outline, config.tolerance_m);
    polygons += static_cast<int>(outline.polygons.size());
    // Two sides of a slit may meet when each is moved into it: not where the closing leaves none narrower than that.
    if (config.closing_m < 2.0 * config.tolerance_m || config.tolerance_m > config.cell_size_m) continue;
    for (const OutlinePolygon& polygon : outline.polygons) EXPECT_FALSE(crossesItself(polygon));
  }
  EXPECT_GT(polygons, 150);  // some fell apart, none was lost
}

TEST(Outline, HoldsEveryCellOfNoise) {
  std::mt19937 engine(7);
  const gpis_mapping::GroundPlane ground;
  for (int i = 0; i < 60; ++i) {
    MappedSurface surface;  // cells alone, in rows, touching at corners
    for (int column = 0; column < 25; ++column) {
      for (int row = 0; row < 25; ++row) {
        if (random(&engine, 0.0, 1.0) > 0.2 + 0.01 * i) continue;
        surface.points_map.emplace_back(0.04 * (column + 0.5), 0.04 * (row + 0.5), 0.2);
        surface.normals_map.emplace_back(0.0F, 0.0F, 1.0F);
        surface.uncertainty.push_back(1.0F);
      }
    }
    OutlineConfig config;
    config.closing_m = i % 2 == 0 ? 0.0 : 0.05;
    config.min_area_m2 = 0.0;
    config.tolerance_m = i % 3 == 0 ? 0.0 : 0.03;
    SCOPED_TRACE("noise " + std::to_string(i));
    expectSound(outlinePile(surface, ground, config), config.tolerance_m);
  }
}

TEST(Outline, IsAPolygonHoweverLargeTheTolerance) {
  for (const double tolerance_m : {0.05, 0.1, 0.2, 0.5}) {
    BoxPile pile;
    pile.add({0.01, 0.01}, {0.2, 0.12, 0.1});
    OutlineConfig config;
    config.tolerance_m = tolerance_m;
    const PileOutline outline = outlineOf(pile, config);
    ASSERT_THAT(outline.polygons, SizeIs(1));
    expectSound(outline, tolerance_m);
    EXPECT_EQ(turnsAround(outline.polygons.front(), {0.01, 0.01}), 1);
    EXPECT_LT(areaOf(outline.polygons.front()), 3.0 * 0.2 * 0.12);  // a triangle round a rectangle has twice its area
  }
}

TEST(Outline, HasTheAreaOfTheBoxes) {
  std::mt19937 engine(2);
  const OutlineConfig config;
  for (int i = 0; i < 30; ++i) {
    BoxPile pile;  // one box at any angle: convex, so that closing adds nothing
    pile.add({random(&engine, -0.5, 0.5), random(&engine, -0.5, 0.5)},
             {random(&engine, 0.2, 1.5), random(&engine, 0.2, 1.5), 0.2}, random(&engine, -M_PI, M_PI));
    const PileOutline outline = outlineOf(pile, config);
    ASSERT_THAT(outline.polygons, SizeIs(1));
    const Eigen::Vector2d size = pile.boxes.front().size_m.head<2>();
    const double exact_m2 = size.prod();
    // Each side moves out to the far edges of its cells, by at most a cell's diagonal, and by the tolerance.
    const double out_m = std::sqrt(2.0) * config.cell_size_m + config.tolerance_m;
    const double most_m2 = (size.x() + 2.0 * out_m) * (size.y() + 2.0 * out_m);
    EXPECT_GT(areaOf(outline.polygons.front()), exact_m2);
    EXPECT_LT(areaOf(outline.polygons.front()), most_m2);
    // On average half of a cell and a bit: half of the bound is not reached by a box at a slant.
    EXPECT_LT(areaOf(outline.polygons.front()) - exact_m2, 0.6 * (most_m2 - exact_m2));
  }
}

TEST(Outline, FollowsAConcavePile) {
  BoxPile pile;  // a U, open upwards
  pile.add({0.0, -0.5}, {1.4, 0.4, 0.2});
  pile.add({-0.5, 0.1}, {0.4, 1.0, 0.2});
  pile.add({0.5, 0.1}, {0.4, 1.0, 0.2});
  const PileOutline outline = outlineOf(pile);
  ASSERT_THAT(outline.polygons, SizeIs(1));
  expectSound(outline, OutlineConfig().tolerance_m);
  const double exact_m2 = unionArea(pile);
  ASSERT_NEAR(exact_m2, 1.4 * 0.4 + 2 * 0.4 * 0.9, 0.03);  // of squares of 4 mm along 7.5 m of rim
  const double area_m2 = areaOf(outline.polygons.front());
  // Axis-parallel sides: each moves out by less than one cell, and nothing is simplified away but in the two inner
  // corners, which the closing rounds.
  EXPECT_GT(area_m2, exact_m2 - 0.03);
  EXPECT_LT(area_m2, exact_m2 + 7.5 * 0.04 + 2 * 0.12 * 0.12);
  EXPECT_EQ(turnsAround(outline.polygons.front(), {0.0, 0.3}), 0);  // in its mouth
}

TEST(Outline, LeavesHolesOut) {
  BoxPile pile;  // a ring, and a box in it
  for (int side = 0; side < 4; ++side) {
    const double yaw_rad = 0.5 * M_PI * side;
    pile.add(Eigen::Vector2d(std::cos(yaw_rad), std::sin(yaw_rad)) * 0.8, {0.3, 1.9, 0.2}, yaw_rad);
  }
  pile.add({0.0, 0.0}, {0.4, 0.4, 0.2});
  const PileOutline outline = outlineOf(pile);
  ASSERT_THAT(outline.polygons, SizeIs(1));
  expectSound(outline, OutlineConfig().tolerance_m);
  EXPECT_EQ(turnsAround(outline.polygons.front(), {0.4, 0.4}), 1);  // on the ground between the two
  // From -0.95 to 0.95: each side out by at most a cell.
  EXPECT_GE(areaOf(outline.polygons.front()), 1.9 * 1.9);
  EXPECT_LE(areaOf(outline.polygons.front()), 1.98 * 1.98 + 1e-6);
}

TEST(Outline, SeparatesPilesLargestFirst) {
  BoxPile pile;
  pile.add({-1.0, 0.0}, {0.4, 0.4, 0.2});
  pile.add({0.0, 0.0}, {0.8, 0.6, 0.2});
  pile.add({1.0, 0.0}, {0.4, 0.4, 0.2});  // 50 cells from the first: as large to the last cell
  const PileOutline outline = outlineOf(pile);
  ASSERT_THAT(outline.polygons, SizeIs(3));
  EXPECT_EQ(turnsAround(outline.polygons[0], {0.0, 0.0}), 1);
  EXPECT_NEAR(areaOf(outline.polygons[1]), areaOf(outline.polygons[2]), kRounding_m);
  for (const OutlinePolygon& polygon : outline.polygons) {
    for (const Eigen::Vector2d& corner : polygon) {
      EXPECT_TRUE(polygon.front().x() < corner.x() ||
                  (polygon.front().x() == corner.x() && polygon.front().y() <= corner.y()));
    }
  }
}

TEST(Outline, OrdersEqualPilesByTheirFirstCorner) {
  OutlineConfig config;
  config.cell_size_m = 0.03125;  // so that all corners and areas are exact
  config.tolerance_m = 0.0;
  for (const double y_m : {-1.0, 1.0}) {
    BoxPile pile;
    for (const double x_m : {1.0, -2.0, 0.0}) pile.add({x_m, x_m * y_m}, {0.5, 0.5, 0.2});
    const PileOutline outline = outlineOf(pile, config);
    ASSERT_THAT(outline.polygons, SizeIs(3));
    ASSERT_EQ(areaOf(outline.polygons[0]), areaOf(outline.polygons[1]));
    ASSERT_EQ(areaOf(outline.polygons[1]), areaOf(outline.polygons[2]));
    EXPECT_LT(outline.polygons[0].front().x(), outline.polygons[1].front().x());
    EXPECT_LT(outline.polygons[1].front().x(), outline.polygons[2].front().x());
  }
}

TEST(Outline, ClosesGapsNarrowerThanAsked) {
  const auto numPolygons = [](double gap_m, double closing_m, double x_m) {
    BoxPile pile;
    pile.add({x_m - 0.5 * gap_m - 0.3, 0.007}, {0.6, 0.6, 0.2});
    pile.add({x_m + 0.5 * gap_m + 0.3, 0.007}, {0.6, 0.6, 0.2});
    OutlineConfig config;
    config.closing_m = closing_m;
    return outlineOf(pile, config).polygons.size();
  };
  // Wherever the gap lies in its cells.
  for (double x_m = 0.0; x_m < 0.04; x_m += 0.005) {
    SCOPED_TRACE(x_m);
    EXPECT_EQ(numPolygons(0.119, 0.12, x_m), 1U);
    EXPECT_EQ(numPolygons(0.159, 0.16, x_m), 1U);
    EXPECT_EQ(numPolygons(0.239, 0.24, x_m), 1U);
    // The closing is of whole cells at both sides: 2 ceil(0.12 / 0.08) = 4 of them, and two that are partly occupied.
    EXPECT_EQ(numPolygons(0.245, 0.12, x_m), 2U);
    EXPECT_EQ(numPolygons(0.1, 0.0, x_m), 2U);
  }
}

TEST(Outline, LeavesSpecksOutAndKeepsABrick) {
  BoxPile pile;
  pile.add({0.0, 0.0}, {0.2, 0.1, 0.1}, 0.4);
  pile.add({0.7, 0.0}, {0.06, 0.06, 0.1});  // at most 3 x 3 cells: 0.0144 m2
  const PileOutline outline = outlineOf(pile);
  ASSERT_THAT(outline.polygons, SizeIs(1));
  EXPECT_EQ(turnsAround(outline.polygons.front(), {0.0, 0.0}), 1);
  const Eigen::Vector2i speck = outline.grid.cellOf({0.7, 0.0});
  ASSERT_TRUE(outline.grid.contains(speck.x(), speck.y()));
  EXPECT_EQ(outline.grid.is_occupied[outline.grid.index(speck.x(), speck.y())], 1);
  EXPECT_EQ(outline.grid.is_pile[outline.grid.index(speck.x(), speck.y())], 0);

  OutlineConfig all;
  all.min_area_m2 = 0.0;
  EXPECT_THAT(outlineOf(pile, all).polygons, SizeIs(2));
}

TEST(Outline, MovesWithThePile) {
  std::mt19937 engine(3);
  const BoxPile pile = randomPile(&engine, 6, 0.5);
  const MappedSurface surface = sampleSurface(pile);
  const PileOutline outline = outlinePile(surface, pile.ground, {});
  ASSERT_FALSE(outline.polygons.empty());
  // By whole cells, exact in binary fractions: the lattice looks the same from there.
  OutlineConfig config;
  config.cell_size_m = 0.03125;
  const Eigen::Vector3d shift(-320 * 0.03125, 77 * 0.03125, 0.0);
  MappedSurface moved = surface;
  for (Eigen::Vector3d& p : moved.points_map) p += shift;
  const PileOutline here = outlinePile(surface, pile.ground, config);
  const PileOutline there = outlinePile(moved, pile.ground, config);
  ASSERT_EQ(here.polygons.size(), there.polygons.size());
  for (std::size_t i = 0; i < here.polygons.size(); ++i) {
    ASSERT_EQ(here.polygons[i].size(), there.polygons[i].size());
    for (std::size_t k = 0; k < here.polygons[i].size(); ++k) {
      EXPECT_LT((here.polygons[i][k] + shift.head<2>() - there.polygons[i][k]).norm(), kRounding_m);
    }
  }
}

TEST(Outline, IsWholeAtTheBorderOfTheMap) {
  BoxPile pile;
  pile.add({0.0, 0.0}, {1.0, 1.0, 0.3});
  SamplingOptions options;
  options.ground_margin_m = 0.0;
  options.is_seen = [](const Eigen::Vector3d& p_map, const Eigen::Vector3d&) { return p_map.x() < 0.2; };
  const PileOutline outline = outlinePile(sampleSurface(pile, options), pile.ground, {});
  ASSERT_THAT(outline.polygons, SizeIs(1));
  expectSound(outline, OutlineConfig().tolerance_m);
  EXPECT_NEAR(areaOf(outline.polygons.front()), 1.0 * 0.7, (2 * 1.0 + 2 * 0.7) * 0.04);  // each side within a cell
}

TEST(Outline, OfAHalfSeenPileIsRoundWhatWasSeen) {
  BoxPile pile;
  pile.add({0.0, 0.0}, {0.6, 1.2, 0.5}, 0.3);
  SamplingOptions options;
  options.is_seen = seenFrom(pile, {{-2.0, 0.0, 0.3}});  // from lower than its top: one or two sides alone
  const PileOutline outline = outlinePile(sampleSurface(pile, options), pile.ground, {});
  ASSERT_THAT(outline.polygons, SizeIs(1));
  expectSound(outline, OutlineConfig().tolerance_m);
  EXPECT_EQ(turnsAround(outline.polygons.front(), {0.1, 0.0}), 0);  // a wall, not the box behind it
  EXPECT_LT(areaOf(outline.polygons.front()), 0.5 * 0.6 * 1.2);
}

TEST(Outline, MeasuresHeightFromTheTiltedGround) {
  for (const double uphill_rad : {0.0, 1.0, 2.5, -2.0}) {
    BoxPile pile;
    pile.ground = tiltedGround(0.2, uphill_rad, 0.4);
    pile.add({0.4, 0.3}, {0.8, 0.5, 0.15}, 0.7);
    SamplingOptions options;
    options.ground_margin_m = 2.0;  // there the ground is 40 cm higher, and lower
    const PileOutline outline = outlinePile(sampleSurface(pile, options), pile.ground, {});
    ASSERT_THAT(outline.polygons, SizeIs(1));
    expectSound(outline, OutlineConfig().tolerance_m);
    // From above the box is foreshortened by cos 0.2, and shows up to 0.15 sin 0.2 of a side; what is below 4 cm is
    // hidden behind it. The outline is farther out by a cell's diagonal and the tolerance at most.
    const double out_m = 0.15 * std::sin(0.2) + std::sqrt(2.0) * 0.04 + 0.03;
    EXPECT_GT(areaOf(outline.polygons.front()), 0.8 * 0.5 * std::cos(0.2));
    EXPECT_LT(areaOf(outline.polygons.front()), (0.8 + 2 * out_m) * (0.5 + 2 * out_m));
    float highest_m = 0.0F;
    for (const float height_m : outline.grid.height_m) highest_m = std::fmax(highest_m, height_m);
    EXPECT_NEAR(highest_m, 0.15F, 1e-6F);  // of floats
  }
}

TEST(Outline, KeepsWhatIsBetweenTheHeights) {
  BoxPile pile;
  pile.add({-0.6, 0.0}, {0.4, 0.4, 0.03});            // a mat
  pile.add({0.0, 0.0}, {0.4, 0.4, 0.06});             // a flat brick
  pile.add({0.6, 0.0}, {0.4, 0.4, 0.05}, 0.0, 2.01);  // a lamp
  pile.add({1.2, 0.0}, {0.4, 0.4, 0.05}, 0.0, 0.3);   // something that sticks out: it cannot be driven under
  const PileOutline outline = outlineOf(pile);
  ASSERT_THAT(outline.polygons, SizeIs(2));
  EXPECT_EQ(turnsAround(outline.polygons[0], {0.0, 0.0}) + turnsAround(outline.polygons[1], {0.0, 0.0}), 1);
  EXPECT_EQ(turnsAround(outline.polygons[0], {1.2, 0.0}) + turnsAround(outline.polygons[1], {1.2, 0.0}), 1);
}

TEST(Outline, AWallIsNoPileAndAPileAtItsFootIs) {
  BoxPile pile;
  pile.add({0.6, 0.0}, {0.2, 2.0, 1.5});
  pile.add({0.2, 0.1}, {0.4, 0.4, 0.3});    // 10 cm from the wall
  pile.add({0.44, 0.8}, {0.12, 0.3, 0.2});  // at it
  const PileOutline outline = outlineOf(pile);
  ASSERT_THAT(outline.polygons, SizeIs(2));
  EXPECT_EQ(turnsAround(outline.polygons[0], {0.2, 0.1}), 1);
  EXPECT_EQ(turnsAround(outline.polygons[1], {0.41, 0.8}), 1);
  for (const OutlinePolygon& polygon : outline.polygons) EXPECT_EQ(turnsAround(polygon, {0.6, 0.0}), 0);
  const PileGrid& grid = outline.grid;
  for (const float height_m : grid.height_m) EXPECT_FALSE(height_m > 0.31F) << height_m;
  EXPECT_TRUE(outline.isWallBetween({0.2, 0.1}, {1.2, -0.3}));
  EXPECT_TRUE(outline.isWallBetween({1.2, -0.3}, {0.2, 0.1}));
  EXPECT_FALSE(outline.isWallBetween({-1.0, 0.1}, {0.4, 0.1})) << "over the pile, before the wall";
  EXPECT_FALSE(outline.isWallBetween({0.2, 1.3}, {1.2, 1.1})) << "past its end";
}

TEST(Outline, AWallOfWhichTheTopWasNotSeenIsNoPileAndATowerIs) {
  BoxPile pile;
  pile.add({0.6, 0.0}, {0.2, 2.0, 1.5});
  pile.add({0.2, 0.1}, {0.3, 0.2, 0.6});
  MappedSurface surface = sampleSurface(pile);
  for (Eigen::Vector3d& p : surface.points_map) {
    if (p.z() > 0.7) p.setConstant(kNan);
  }
  const PileOutline outline = outlinePile(surface, pile.ground, {});
  ASSERT_THAT(outline.polygons, SizeIs(1));
  EXPECT_EQ(turnsAround(outline.polygons[0], {0.2, 0.1}), 1);
  EXPECT_TRUE(outline.isWallBetween({0.2, 0.1}, {1.2, 0.1}));
  EXPECT_FALSE(outline.isWallBetween({-0.5, 0.1}, {0.4, 0.1})) << "over the tower";
}

TEST(Outline, GridsAreThoseOfBruteForce) {
  std::mt19937 engine(4);
  const gpis_mapping::GroundPlane ground = tiltedGround(0.15, 0.6, -0.3);
  MappedSurface surface;
  for (int i = 0; i < 5000; ++i) {
    const double x_m = random(&engine, -0.7, 0.7);
    const double y_m = random(&engine, -0.7, 0.7);
    surface.points_map.emplace_back(x_m, y_m, ground.zAt(x_m, y_m) + random(&engine, -0.1, 0.3));
    surface.normals_map.emplace_back(0.0F, 0.0F, 1.0F);
    surface.uncertainty.push_back(static_cast<float>(random(&engine, 0.0, 1.0)));
  }
  surface.points_map[7].z() = kNan;
  surface.points_map[8].x() = kInfinity;
  surface.points_map[9].y() = -kInfinity;
  for (int i = 10; i < 500; ++i) surface.uncertainty[i] = std::numeric_limits<float>::quiet_NaN();
  const OutlineConfig config;
  const PileGrid grid = outlinePile(surface, ground, config).grid;

  struct Cell {
    double highest_m{-kInfinity};
    double sum{0.0};
    int number{0};
  };
  std::map<std::pair<long, long>, Cell> cells;  // by multiples of the cell size
  for (std::size_t i = 0; i < surface.points_map.size(); ++i) {
    const Eigen::Vector3d& p = surface.points_map[i];
    const double height_m = ground.normal_map.dot(p) - ground.offset_m;
    if (!p.allFinite() || height_m < config.min_height_m || height_m > config.max_height_m) continue;
    Cell& cell = cells[{std::lround(std::floor(p.x() / 0.04)), std::lround(std::floor(p.y() / 0.04))}];
    cell.highest_m = std::max(cell.highest_m, height_m);
    if (std::isnan(surface.uncertainty[i])) continue;
    cell.sum += surface.uncertainty[i];
    ++cell.number;
  }
  std::size_t occupied = 0;
  bool has_silent = false;
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) {
      const Eigen::Vector2d middle = middleOf(grid, column, row);
      const auto cell =
          cells.find({std::lround(std::floor(middle.x() / 0.04)), std::lround(std::floor(middle.y() / 0.04))});
      const std::size_t index = grid.index(column, row);
      ASSERT_EQ(grid.is_occupied[index], cell != cells.end() ? 1 : 0);
      if (cell == cells.end()) {
        EXPECT_TRUE(std::isnan(grid.height_m[index]));
        EXPECT_TRUE(std::isnan(grid.uncertainty[index]));
        continue;
      }
      ++occupied;
      EXPECT_NEAR(grid.height_m[index], cell->second.highest_m, 1e-6);  // of floats
      if (cell->second.number > 0) {
        EXPECT_NEAR(grid.uncertainty[index], cell->second.sum / cell->second.number, 1e-6);
      } else {
        has_silent = true;
        EXPECT_TRUE(std::isnan(grid.uncertainty[index]));
      }
    }
  }
  EXPECT_EQ(occupied, cells.size());
  EXPECT_TRUE(has_silent);  // the seed gives some
}

TEST(Outline, OfNothingIsNone) {
  const gpis_mapping::GroundPlane ground;
  EXPECT_TRUE(outlinePile({}, ground, {}).polygons.empty());
  EXPECT_EQ(outlinePile({}, ground, {}).grid.width, 0);
  EXPECT_TRUE(outlineOf(BoxPile()).polygons.empty());  // ground alone
  MappedSurface lost;
  lost.points_map = {{kNan, 0.0, 0.2}, {0.0, kInfinity, 0.2}, {0.0, 0.0, kNan}};
  lost.normals_map.assign(3, {0.0F, 0.0F, 1.0F});
  lost.uncertainty.assign(3, 1.0F);
  EXPECT_TRUE(outlinePile(lost, ground, {}).polygons.empty());
  const PileGrid grid;
  EXPECT_FALSE(grid.contains(grid.cellOf({0.0, 0.0}).x(), grid.cellOf({0.0, 0.0}).y()));
}

TEST(Outline, CellOfWhatIsNotThereIsOutside) {
  BoxPile pile;
  pile.add({0.0, 0.0}, {0.4, 0.4, 0.2});
  const PileGrid grid = outlineOf(pile).grid;
  for (const Eigen::Vector2d& p :
       {Eigen::Vector2d(kNan, 0.0), Eigen::Vector2d(0.0, kInfinity), Eigen::Vector2d(1e300, 0.0),
        Eigen::Vector2d(-5.0, 0.0), Eigen::Vector2d(0.0, 5.0)}) {
    const Eigen::Vector2i cell = grid.cellOf(p);
    EXPECT_FALSE(grid.contains(cell.x(), cell.y())) << p.transpose();
  }
}

TEST(Outline, NamesWhatIsImpossible) {
  OutlineConfig config;
  EXPECT_TRUE(problemsOf(config).empty());
  config.cell_size_m = 0.0;
  config.min_height_m = -0.1;
  config.max_height_m = kNan;
  config.closing_m = 0.6;
  config.min_area_m2 = -1.0;
  config.tolerance_m = kInfinity;
  const std::vector<std::string> problems = problemsOf(config);
  EXPECT_THAT(problems, SizeIs(6));
  for (const char* key : {"cell_size_m = 0 m", "min_height_m = -0.1 m", "max_height_m = nan m", "closing_m = 0.6 m",
                          "min_area_m2 = -1 m2", "tolerance_m = inf m"}) {
    EXPECT_THAT(problems, Contains(HasSubstr(std::string(key) + ", must be in")));
  }
  EXPECT_THROW(outlinePile({}, {}, config), std::invalid_argument);
  OutlineConfig crossed;
  crossed.min_height_m = 0.8;
  crossed.max_height_m = 0.7;
  EXPECT_THAT(problemsOf(crossed), Contains(HasSubstr("max_height_m = 0.7 m, must be in [0.8, 20] m")));

  MappedSurface uneven;
  uneven.points_map.resize(2, Eigen::Vector3d::Zero());
  uneven.normals_map.resize(2);
  EXPECT_THROW(outlinePile(uneven, {}, {}), std::invalid_argument);
  uneven.uncertainty.resize(2);
  uneven.normals_map.resize(3);
  EXPECT_THROW(outlinePile(uneven, {}, {}), std::invalid_argument);

  gpis_mapping::GroundPlane wall;
  wall.normal_map = Eigen::Vector3d::UnitX();
  EXPECT_THROW(outlinePile({}, wall, {}), std::invalid_argument);
  gpis_mapping::GroundPlane lost;
  lost.offset_m = kNan;
  EXPECT_THROW(outlinePile({}, lost, {}), std::invalid_argument);
  gpis_mapping::GroundPlane stretched;
  stretched.normal_map.z() = 2.0;
  EXPECT_THROW(outlinePile({}, stretched, {}), std::invalid_argument);
}

TEST(Outline, RefusesWhatFitsNoGrid) {
  const auto surfaceOf = [](double x_m, double y_m) {
    MappedSurface surface;
    surface.points_map = {{0.0, 0.0, 0.2}, {x_m, y_m, 0.2}};
    surface.normals_map.assign(2, {0.0F, 0.0F, 1.0F});
    surface.uncertainty.assign(2, 1.0F);
    return surface;
  };
  OutlineConfig config;
  config.min_area_m2 = 0.0;
  EXPECT_THAT(outlinePile(surfaceOf(0.0, 4000 * 0.04 - 0.1), {}, config).polygons, SizeIs(2));
  EXPECT_THROW(outlinePile(surfaceOf(4000 * 0.04 + 0.1, 0.0), {}, config), std::runtime_error);
  EXPECT_THROW(outlinePile(surfaceOf(0.0, -4000 * 0.04 - 0.1), {}, config), std::runtime_error);
  EXPECT_THROW(outlinePile(surfaceOf(1e300, 0.0), {}, config), std::runtime_error);
  MappedSurface far = surfaceOf(0.0, 1.0);
  for (Eigen::Vector3d& p : far.points_map) p.x() += 1.1e5;
  EXPECT_THROW(outlinePile(far, {}, config), std::runtime_error);
}

// The other tests stand on these piles.
TEST(BoxPile, HidesWhatALineToTheEyeFindsFull) {
  std::mt19937 engine(5);
  BoxPile pile = randomPile(&engine, 6, 0.5);
  const Eigen::Vector3d eye(-1.6, 0.4, 0.7);
  const MappedSurface surface = sampleSurface(pile);
  int seen = 0;
  int hidden = 0;
  int grazed = 0;
  for (std::size_t i = 0; i < surface.points_map.size(); i += 7) {
    const Eigen::Vector3d& p = surface.points_map[i];
    const Eigen::Vector3d normal = surface.normals_map[i].cast<double>();
    EXPECT_FALSE(isFull(pile, p + 1e-4 * normal));
    bool is_full = false;
    const double length_m = (eye - p).norm();
    for (double s_m = 1e-3; s_m < length_m && !is_full; s_m += 1e-3) {
      is_full = isFull(pile, p + s_m / length_m * (eye - p));
    }
    if (isSeenFrom(pile, eye, p, normal)) {
      EXPECT_FALSE(is_full) << p.transpose();
      ++seen;
    } else if (is_full) {
      ++hidden;
    } else if (normal.dot(eye - p) > 0.0) {  // on an edge, the line of a face that looks away may go along the other
      ++grazed;                              // through less than a step of a box
    }
  }
  EXPECT_GT(seen, 100);
  EXPECT_GT(hidden, 100);
  EXPECT_LT(grazed, (seen + hidden) / 100);
}

}  // namespace
}  // namespace nbv_selection
