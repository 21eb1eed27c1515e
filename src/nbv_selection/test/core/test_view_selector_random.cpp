// SPDX-License-Identifier: BSD-3-Clause
// Whatever pile, ground and robot: what is chosen may be gone to, and nothing that may be is better. All oracles are brute
// force and written for this test.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <queue>
#include <random>

#include <gmock/gmock.h>

#include "nbv_selection/view_selector.h"
#include "support/box_scene.h"
#include "support/selection_setup.h"

namespace nbv_selection {
namespace {

using base_navigation::Polygon;

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kTouch_m = 1e-9;  // polygons, discs and cells are closed: what is nearer than this touches

double random(std::mt19937* engine, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(*engine);
}

int randomInt(std::mt19937* engine, int low, int high) {
  return std::uniform_int_distribution<int>(low, high)(*engine);
}

Pose2d randomPose(std::mt19937* engine, double half_m) {
  return {random(engine, -half_m, half_m), random(engine, -half_m, half_m), random(engine, -M_PI, M_PI)};
}

/// Separating axes: the corners of the one are all beyond an edge of the other, or not.
bool overlap(const Polygon& a, const Polygon& b) {
  const auto isApart = [](const Polygon& p, const Polygon& q) {
    for (std::size_t i = 0; i < p.size(); ++i) {
      const Eigen::Vector2d edge = (p[(i + 1) % p.size()] - p[i]).normalized();
      const Eigen::Vector2d outward(edge.y(), -edge.x());
      double nearest = kInf;
      for (const Eigen::Vector2d& corner : q) nearest = std::min(nearest, outward.dot(corner - p[i]));
      if (nearest > kTouch_m) return true;
    }
    return false;
  };
  return !isApart(a, b) && !isApart(b, a);
}

Polygon cellSquare(const NavigationGrid& grid, int column, int row) {
  const Eigen::Vector2d low = grid.origin_m + grid.cell_size_m * Eigen::Vector2d(column, row);
  const double s = grid.cell_size_m;
  return {low, low + Eigen::Vector2d(s, 0.0), low + Eigen::Vector2d(s, s), low + Eigen::Vector2d(0.0, s)};
}

/// The worst of all cells that a rectangle [m, base_link] touches; beyond the grid all is unknown.
SpaceState worstBelow(const NavigationGrid& grid, const Eigen::AlignedBox2d& rectangle, const Pose2d& pose) {
  Polygon polygon;
  for (const auto corner : {Eigen::AlignedBox2d::BottomLeft, Eigen::AlignedBox2d::BottomRight,
                            Eigen::AlignedBox2d::TopRight, Eigen::AlignedBox2d::TopLeft}) {
    polygon.push_back(base_navigation::transform(pose, rectangle.corner(corner)));
  }
  Eigen::AlignedBox2d around;
  for (const Eigen::Vector2d& p : polygon) around.extend(p);
  const Eigen::Vector2i low = grid.cellOf(around.min()), high = grid.cellOf(around.max());
  SpaceState worst = SpaceState::kFree;
  for (int row = low.y() - 1; row <= high.y() + 1; ++row) {
    for (int column = low.x() - 1; column <= high.x() + 1; ++column) {
      const SpaceState state = grid.at(column, row);
      if (state == SpaceState::kFree || !overlap(polygon, cellSquare(grid, column, row))) continue;
      if (state == SpaceState::kOccupied) return state;
      worst = state;
    }
  }
  return worst;
}

/// Distance [m] to all cells from the middle of one cell to another, by Dijkstra with a heap.
struct Ways {
  bool is_start_clear{false};
  std::vector<double> distance_m;
};

Ways waysFrom(const NavigationGrid& grid, const Eigen::Vector2d& from_map, double radius_m) {
  Ways ways;
  ways.distance_m.assign(grid.state.size(), kInf);
  const Eigen::Vector2i start = grid.cellOf(from_map);
  if (!grid.contains(start.x(), start.y())) return ways;
  const int reach = static_cast<int>(std::ceil(radius_m / grid.cell_size_m)) + 1;
  const auto isClear = [&](int column, int row) {
    for (int dy = -reach; dy <= reach; ++dy) {
      for (int dx = -reach; dx <= reach; ++dx) {
        if (grid.at(column + dx, row + dy) == SpaceState::kFree) continue;
        const Eigen::Vector2d gap(std::max(0.0, std::abs(dx) - 0.5), std::max(0.0, std::abs(dy) - 0.5));
        if (grid.cell_size_m * gap.norm() <= radius_m + kTouch_m) return false;
      }
    }
    return true;
  };
  std::vector<bool> is_passed(grid.state.size(), false);
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) is_passed[grid.index(column, row)] = isClear(column, row);
  }
  ways.is_start_clear = is_passed[grid.index(start.x(), start.y())];
  if (!ways.is_start_clear) {
    // How a robot that touches something gets away is DistanceField's; here it may go anywhere free round about: more
    // places can be reached than are.
    for (int row = start.y() - 2 * reach; row <= start.y() + 2 * reach; ++row) {
      for (int column = start.x() - 2 * reach; column <= start.x() + 2 * reach; ++column) {
        if (grid.at(column, row) == SpaceState::kFree) is_passed[grid.index(column, row)] = true;
      }
    }
    is_passed[grid.index(start.x(), start.y())] = true;
  }
  const auto passed = [&](int column, int row) {
    return grid.contains(column, row) && is_passed[grid.index(column, row)];
  };
  using Entry = std::pair<double, std::pair<int, int>>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
  queue.push({0.0, {start.x(), start.y()}});
  ways.distance_m[grid.index(start.x(), start.y())] = 0.0;
  while (!queue.empty()) {
    const auto [distance, cell] = queue.top();
    queue.pop();
    const auto [column, row] = cell;
    if (distance > ways.distance_m[grid.index(column, row)]) continue;
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        if (!passed(column + dx, row + dy) || !passed(column + dx, row) || !passed(column, row + dy)) continue;
        const double over = distance + grid.cell_size_m * std::hypot(dx, dy);
        double& known = ways.distance_m[grid.index(column + dx, row + dy)];
        if (over >= known) continue;
        known = over;
        queue.push({over, {column + dx, row + dy}});
      }
    }
  }
  return ways;
}

struct Failure {
  Eigen::Vector2d center_map;
  double radius_m;
  double stamp_s;
};

/// t_f at a point: of all failures whose disc holds the middle of the point's cell, or whose middle is in it.
double lastFailure(const std::vector<Failure>& failures, double cell_m, const Eigen::Vector2d& p) {
  const auto cellOf = [cell_m](const Eigen::Vector2d& q) { return Eigen::Vector2d((q / cell_m).array().floor()); };
  const Eigen::Vector2d middle = cell_m * (cellOf(p) + Eigen::Vector2d::Constant(0.5));
  double last = -kInf;
  for (const Failure& failure : failures) {
    const bool is_in =
        (middle - failure.center_map).norm() <= failure.radius_m || cellOf(p) == cellOf(failure.center_map);
    if (is_in) last = std::max(last, failure.stamp_s);
  }
  return last;
}

BoxPile randomPile(std::mt19937* engine) {
  BoxPile pile;
  const int count = randomInt(engine, 1, 5);
  double lift_m = 0.0;
  Eigen::Vector2d middle(0.0, 0.0);
  for (int i = 0; i < count; ++i) {
    const bool is_on_top = i > 0 && randomInt(engine, 0, 3) == 0;
    if (!is_on_top) {
      lift_m = 0.0;
      middle = {random(engine, -0.6, 0.6), random(engine, -0.6, 0.6)};
    }
    const Eigen::Vector3d size(random(engine, 0.15, 0.6), random(engine, 0.15, 0.6), random(engine, 0.1, 0.4));
    pile.add(middle, size, random(engine, -M_PI, M_PI), lift_m);
    lift_m += size.z();
  }
  return pile;
}

NavigationGrid randomGround(std::mt19937* engine, const BoxPile& pile) {
  NavigationGrid grid = gridAround(pile, 2.5, 0.1);
  const auto fill = [&](SpaceState state) {
    const Eigen::Vector2d middle(random(engine, -2.5, 2.5), random(engine, -2.5, 2.5));
    const Eigen::Vector2d half(random(engine, 0.05, 0.5), random(engine, 0.05, 0.5));
    for (int row = 0; row < grid.height; ++row) {
      for (int column = 0; column < grid.width; ++column) {
        const Eigen::Vector2d off = (grid.centerOf(column, row) - middle).cwiseAbs();
        if ((off.array() <= half.array()).all()) grid.state[grid.index(column, row)] = state;
      }
    }
  };
  for (int i = randomInt(engine, 0, 4); i > 0; --i) fill(SpaceState::kUnknown);
  for (int i = randomInt(engine, 0, 4); i > 0; --i) fill(SpaceState::kOccupied);
  if (randomInt(engine, 0, 3) == 0) {  // a wall through everything
    const int at = randomInt(engine, 5, 44);
    for (int i = 0; i < 50; ++i) grid.state[grid.index(at, i)] = SpaceState::kOccupied;
  }
  return grid;
}

bool isEqual(const ScoredSegment& a, const ScoredSegment& b) {
  const auto numbers = [](const ScoredSegment& s) {
    std::vector<double> all{s.mean_uncertainty,
                            s.attributes.manipulability,
                            s.attributes.height_m,
                            s.attributes.distance_m,
                            s.attributes.uncertainty,
                            s.attributes.frontier,
                            s.utility.information,
                            s.utility.failure_penalty,
                            s.utility.utility,
                            s.segment.at_m,
                            s.segment.standing_map.x_m,
                            s.segment.standing_map.y_m,
                            s.segment.standing_map.yaw_rad};
    all.insert(all.end(), s.utility.factor_values.begin(), s.utility.factor_values.end());
    return all;
  };
  return a.kind == b.kind && a.verdict == b.verdict && numbers(a) == numbers(b);
}

void expectSame(const Selection& again, const Selection& selection) {
  EXPECT_EQ(again.status, selection.status);
  EXPECT_EQ(again.message, selection.message);
  EXPECT_EQ(again.best, selection.best);
  ASSERT_EQ(again.segments.size(), selection.segments.size());
  for (std::size_t i = 0; i < again.segments.size(); ++i) {
    EXPECT_TRUE(isEqual(again.segments[i], selection.segments[i])) << i;
  }
}

/// The gradient of half of the space is so large that its square is no number.
class HalfWildScene : public BoxScene {
 public:
  using BoxScene::BoxScene;
  bool is_wild{false};

  UncertaintyField uncertainty(const gpis_mapping::Points3d& points_map) const override {
    UncertaintyField field = BoxScene::uncertainty(points_map);
    for (Eigen::Index i = 0; is_wild && i < points_map.cols(); ++i) {
      if (points_map(0, i) > 0.0) field.gradient.col(i).setConstant(1e200);
    }
    return field;
  }
};

ViewSelectorConfig coarseConfig() {
  ViewSelectorConfig config;
  config.outline.cell_size_m = 0.08;
  config.outline.closing_m = 0.16;
  config.segments.spacing_m = 0.25;
  config.segments.sample_spacing_m = 0.06;
  config.manipulability.cell_m = 0.16;
  config.manipulability.band_m = 0.08;
  return config;
}

/// Everything that one random world says of its selection.
class World {
 public:
  explicit World(int round)
      : engine_(1000U + static_cast<unsigned>(round)),  // seed: the round
        pile_(randomPile(&engine_)),
        scene_(pile_, randomEyes(), BoxScene::Options{0.04, 0.6, 8.3e-4, 0.09, 0.085}),
        failures_(0.1) {
    scene_.is_wild = round % 10 == 0;
    config_ = coarseConfig();
    request_ = requestOn(randomGround(&engine_, pile_), randomPose(&engine_, 2.6), 500.0);
    for (int i = randomInt(&engine_, 0, 2); i > 0; --i) {
      const Eigen::Vector2d center = randomPose(&engine_, 1.5).position();
      request_.excluded.push_back({center, random(&engine_, 0.0, 0.8)});
    }
    for (int i = randomInt(&engine_, 0, 3); i > 0; --i) {
      const Eigen::Vector2d center = randomPose(&engine_, 1.5).position();
      failed_.push_back({center, random(&engine_, 0.0, 0.8), random(&engine_, 300.0, 520.0)});
      failures_.add(failed_.back().center_map, failed_.back().radius_m, failed_.back().stamp_s);
    }
  }

  Selection select() const { return ViewSelector(config_, robot_).select(scene_, failures_, request_); }

  void check(const Selection& selection, std::array<int, interactive_mapping::kNumSegmentVerdict>* counts) {
    const Ways ways = waysFrom(*request_.ground, request_.T_map_base.position(), 0.296);
    double largest = -kInf;
    for (std::size_t i = 0; i < selection.segments.size(); ++i) {
      const ScoredSegment& scored = selection.segments[i];
      SCOPED_TRACE("segment " + std::to_string(i));
      ++counts->at(static_cast<std::size_t>(scored.verdict));
      expectUncertainty(scored);
      expectDistance(scored, ways);
      EXPECT_EQ(scored.verdict, verdictOf(scored, ways));
      const Attributes& a = scored.attributes;
      if (scored.verdict == SegmentVerdict::kIsImaginary) {
        EXPECT_EQ(a.manipulability + a.height_m + a.uncertainty + a.frontier, 0.0);
      }
      if (scored.verdict != SegmentVerdict::kCandidate) {
        EXPECT_EQ(scored.utility.utility, 0.0);
        continue;
      }
      EXPECT_TRUE(a.isFinite());
      const double utility = utilityByHand(a, sinceFailure(scored.segment), config_.utility);
      EXPECT_NEAR(scored.utility.utility, utility, 1e-12);  // rounding of sums of five terms below 1
      largest = std::max(largest, scored.utility.utility);
    }
    ASSERT_EQ(selection.best.has_value(), largest >= 0.0);  // 0: it failed this very moment
    if (!selection.best) {
      EXPECT_EQ(selection.status, SelectionStatus::kNoCandidate);
      return;
    }
    EXPECT_EQ(selection.status,
              largest < config_.utility.min_utility ? SelectionStatus::kLowUtility : SelectionStatus::kSelected);
    const ScoredSegment& best = selection.segments.at(*selection.best);
    EXPECT_EQ(best.verdict, SegmentVerdict::kCandidate);
    EXPECT_EQ(best.utility.utility, largest);
  }

  /// That attributes are those of the segment they are said to be of; each is proved elsewhere.
  void checkManipulability(const Selection& selection) const {
    const MappedSurface surface = scene_.surface();
    const ManipulabilityScore score(scene_, surface, selection.outline.ground, config_.outline.min_height_m,
                                    *robot_.sectors, robot_.T_base_armbase, config_.manipulability);
    for (const ScoredSegment& scored : selection.segments) {
      if (scored.kind == SegmentKind::kImaginary) continue;
      EXPECT_EQ(scored.attributes.manipulability, score.at(scored.segment.standing_map));
      double sum_m = 0.0;
      for (const float height_m : scored.segment.profile_m) sum_m += height_m;
      EXPECT_NEAR(scored.attributes.height_m, sum_m / static_cast<double>(scored.segment.profile_m.size()), 1e-12);
    }
  }

 private:
  std::vector<Eigen::Vector3d> randomEyes() {
    std::vector<Eigen::Vector3d> eyes;
    for (int i = randomInt(&engine_, 1, 3); i > 0; --i) {
      const double angle_rad = random(&engine_, -M_PI, M_PI), radius_m = random(&engine_, 1.5, 3.0);
      eyes.emplace_back(radius_m * std::cos(angle_rad), radius_m * std::sin(angle_rad), random(&engine_, 0.8, 1.8));
    }
    return eyes;
  }

  double sinceFailure(const Segment& segment) const {
    std::vector<Eigen::Vector2d> places{segment.standing_map.position(), segment.midpoint_map.head<2>()};
    for (const Eigen::Vector3d& sample : segment.samples_map) places.emplace_back(sample.head<2>());
    double last = -kInf;
    for (const Eigen::Vector2d& place : places) last = std::max(last, lastFailure(failed_, 0.1, place));
    return request_.now_s - last;
  }

  void expectUncertainty(const ScoredSegment& scored) const {
    double mean = 0.0, frontier = 0.0;
    const auto count = static_cast<double>(scored.segment.samples_map.size());
    for (const Eigen::Vector3d& sample : scored.segment.samples_map) {
      const UncertaintyField field = scene_.uncertainty(gpis_mapping::Points3d(sample));
      mean += field.value[0] / count;
      frontier += std::pow(field.gradient.col(0).dot(scored.segment.direction_map), 2) / count;
    }
    EXPECT_NEAR(scored.mean_uncertainty, mean, 1e-12);
    const bool is_imaginary = mean > 0.5 * scene_.priorUncertainty();
    EXPECT_EQ(scored.kind == SegmentKind::kImaginary, is_imaginary);
    if (is_imaginary) return;
    EXPECT_NEAR(scored.attributes.uncertainty, mean, 1e-12);
    if (std::isfinite(frontier)) {
      EXPECT_NEAR(scored.attributes.frontier, frontier, 1e-9 * frontier);
    } else {
      EXPECT_FALSE(std::isfinite(scored.attributes.frontier));
    }
  }

  double wayTo(const ScoredSegment& scored, const Ways& ways) const {
    const Eigen::Vector2i cell = request_.ground->cellOf(scored.segment.standing_map.position());
    if (!request_.ground->contains(cell.x(), cell.y())) return kInf;
    return ways.distance_m[request_.ground->index(cell.x(), cell.y())];
  }

  void expectDistance(const ScoredSegment& scored, const Ways& ways) const {
    const double expected = wayTo(scored, ways);
    if (!ways.is_start_clear) {
      EXPECT_GE(scored.attributes.distance_m, expected - 1e-4);  // of all ways; floats over some 100 steps
    } else if (std::isinf(expected)) {
      EXPECT_EQ(scored.attributes.distance_m, kInf);
    } else {
      EXPECT_NEAR(scored.attributes.distance_m, expected, 1e-4);
    }
  }

  SegmentVerdict verdictOf(const ScoredSegment& scored, const Ways& ways) const {
    if (scored.mean_uncertainty > 0.5 * scene_.priorUncertainty()) return SegmentVerdict::kIsImaginary;
    for (const ExcludedZone& zone : request_.excluded) {
      for (const Eigen::Vector2d& place :
           {scored.segment.standing_map.position(), Eigen::Vector2d(scored.segment.midpoint_map.head<2>())}) {
        if ((place - zone.center_map).norm() <= zone.radius_m) return SegmentVerdict::kExcluded;
      }
    }
    const double pad = config_.standing_padding_m;
    const Eigen::AlignedBox2d padded(Eigen::Vector2d(-0.527 - pad, -0.296 - pad),
                                     Eigen::Vector2d(0.296 + pad, 0.296 + pad));
    const SpaceState below = worstBelow(*request_.ground, padded, scored.segment.standing_map);
    if (below == SpaceState::kOccupied) return SegmentVerdict::kOccupied;
    if (below == SpaceState::kUnknown) return SegmentVerdict::kUnknownGround;
    // From where something is touched the oracle only knows what cannot be reached.
    const double way = ways.is_start_clear ? wayTo(scored, ways) : scored.attributes.distance_m;
    if (std::isinf(wayTo(scored, ways)) || std::isinf(way)) return SegmentVerdict::kUnreachable;
    if (!hasApproach(scored.segment.standing_map)) return SegmentVerdict::kUnreachable;
    const bool is_wild =
        scene_.is_wild && std::any_of(scored.segment.samples_map.begin(), scored.segment.samples_map.end(),
                                      [](const Eigen::Vector3d& p) { return p.x() > 0.0; });
    return is_wild ? SegmentVerdict::kBadAttribute : SegmentVerdict::kCandidate;
  }

  /// Straight to the pose, at least 0.1 m and at most 0.4 m, from where 0.06 m are free about the footprint.
  bool hasApproach(const Pose2d& standing_map) const {
    const auto worstBehind = [&](double back_m, double pad_m) {
      const Eigen::AlignedBox2d padded(Eigen::Vector2d(-0.527 - pad_m, -0.296 - pad_m),
                                       Eigen::Vector2d(0.296 + pad_m, 0.296 + pad_m));
      return worstBelow(*request_.ground, padded, base_navigation::moveAlongArc(standing_map, -back_m, 0.0));
    };
    for (int i = 1; i <= 8; ++i) {
      for (int k = 0; k <= 4; ++k) {
        if (worstBehind(0.05 * (i - 0.25 * k), config_.standing_padding_m) != SpaceState::kFree) return false;
      }
      if (i >= 2 && worstBehind(0.05 * i, 0.06) == SpaceState::kFree) return true;
    }
    return false;
  }

  std::mt19937 engine_;
  BoxPile pile_;
  HalfWildScene scene_;
  ViewSelectorConfig config_;
  RobotBody robot_{pickingRobot()};
  SelectionRequest request_;
  std::vector<Failure> failed_;
  FailureMemory failures_;
};

TEST(ViewSelectorRandom, ChoosesTheBestOfWhatMayBeGoneToInAThousandWorlds) {
  std::array<int, interactive_mapping::kNumSegmentVerdict> counts{};
  int num_chosen = 0, num_without_pile = 0;
  for (int round = 0; round < 1000; ++round) {
    SCOPED_TRACE("round " + std::to_string(round));
    World world(round);
    const Selection selection = world.select();
    if (selection.segments.empty()) {
      EXPECT_EQ(selection.status, SelectionStatus::kNoPile) << selection.message;
      ++num_without_pile;
      continue;
    }
    EXPECT_EQ(selection.message.empty(), selection.status == SelectionStatus::kSelected);
    world.check(selection, &counts);
    if (round % 20 == 0) world.checkManipulability(selection);
    if (selection.best) ++num_chosen;

    if (round % 5 == 0) expectSame(world.select(), selection);
    if (HasFailure()) FAIL() << "the first world that fails is enough";
  }
  // Enough of each kind that none goes untested.
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (static_cast<SegmentVerdict>(i) == SegmentVerdict::kBehindWall) continue;  // these worlds have no walls
    EXPECT_GT(counts.at(i), 50) << toString(static_cast<SegmentVerdict>(i));
    RecordProperty(std::string("verdict_") + std::to_string(i), counts.at(i));
  }
  EXPECT_GT(num_chosen, 300);
  EXPECT_LT(num_without_pile, 50);
}

}  // namespace
}  // namespace nbv_selection
