// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/base_planner.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <limits>
#include <mutex>
#include <optional>
#include <random>
#include <sstream>
#include <stdexcept>

#include <ompl/base/MotionValidator.h>
#include <ompl/base/PlannerTerminationCondition.h>
#include <ompl/base/ProblemDefinition.h>
#include <ompl/base/ScopedState.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/StateSampler.h>
#include <ompl/base/goals/GoalStates.h>
#include <ompl/base/spaces/ReedsSheppStateSpace.h>
#include <ompl/datastructures/NearestNeighborsLinear.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>

#include "base_navigation/distance_field.h"

namespace base_navigation {
namespace {

namespace ob = ompl::base;
using State = ob::SE2StateSpace::StateType;

constexpr double kStep_m = 0.05;     // of back-off and approach
constexpr double kNothing = 1e-7;    // [m] or [rad]: pieces of curves that are left out
constexpr double kSamePlace = 1e-6;  // [m] and [rad]: a curve that ends farther from where it should is none
constexpr double kExact_m = 1e-4;    // a tenth of what a path may end beside its goal
constexpr double kExact_rad = 1e-4;
constexpr double kCutAtLeast_m = 0.002;  // pieces that shortening cuts off are not smaller
constexpr double kCutAtLeast_rad = 0.002;
constexpr double kWorthwhile_s = 0.01;
// Of two paths about as fast, the one that drives backwards less (the scanner does not see behind) and has fewer pieces.
constexpr double kBackwards_s = 2.0;  // each time anew
constexpr double kPiece_s = 0.05;
constexpr std::size_t kMaxJoints = 16;         // of a path with more, not all pairs of joints are tried
constexpr double kRange_m = 1.5;               // one growth of a tree
constexpr double kGuided = 0.6;                // share of samples drawn about Dijkstra's way
constexpr double kGuideSpread_m = 0.25;        // standard deviation from the way
constexpr double kGuideSpread_rad = 0.4;       // and from its heading
constexpr double kGuideReversed = 0.2;         // share of these that go backwards
constexpr int kRuns = 3;                       // of RRTConnect, which share the iterations
constexpr double kCurves[] = {1.0, 2.0, 4.0};  // of the turn radius: curves tried
constexpr double kAhead_rad = 0.2;             // a goal in this cone is reached without backing off first, if it can be

using Motions = std::vector<BaseMotion>;

ob::ScopedState<ob::SE2StateSpace> toOmpl(const ob::StateSpacePtr& space, const Pose2d& pose) {
  ob::ScopedState<ob::SE2StateSpace> state(space);
  const double yaw_rad = wrapAngle(pose.yaw_rad);
  state->setXY(pose.x_m, pose.y_m);
  state->setYaw(yaw_rad < M_PI ? yaw_rad : -M_PI);  // for OMPL, pi itself is out of bounds
  return state;
}

Pose2d fromOmpl(const ob::State* state) {
  const auto* se2 = state->as<State>();
  return {se2->getX(), se2->getY(), se2->getYaw()};
}

double away_m(const Pose2d& a, const Pose2d& b) {
  return (a.position() - b.position()).norm();
}

double away_rad(const Pose2d& a, const Pose2d& b) {
  return std::abs(wrapAngle(a.yaw_rad - b.yaw_rad));
}

Pose2d follow(const Pose2d& from_map, const Motions& motions) {
  return BasePath{from_map, motions}.end();
}

bool isReverse(const BaseMotion& motion) {
  return motion.length_m < 0.0;
}

std::string text(const Eigen::Vector2d& p_map) {
  std::ostringstream out;
  out << std::fixed << std::setprecision(2) << "(" << p_map.x() << ", " << p_map.y() << ")";
  return out.str();
}

std::string text(double value) {
  std::ostringstream out;
  out << std::fixed << std::setprecision(2) << value;
  return out.str();
}

std::string text(const FootprintVerdict& verdict) {
  return std::string(verdict.state == SpaceState::kOccupied ? "occupied" : "unknown") + " ground at " +
         text(verdict.where_map);
}

/// Everything random in one call comes from here, never from OMPL's generators, whose seed is shared by the process.
class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double uniform01() { return static_cast<double>(engine_() >> 11) * 0x1.0p-53; }
  double uniform(double lower, double upper) { return lower + (upper - lower) * uniform01(); }
  double normal() {  // Box and Muller 1958
    const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform01()));
    return radius * std::cos(2.0 * M_PI * uniform01());
  }
  std::size_t index(std::size_t n) { return std::min(n - 1, static_cast<std::size_t>(uniform01() * n)); }

 private:
  std::mt19937_64 engine_;
};

class Cancellation {
 public:
  explicit Cancellation(const std::function<bool()>& asked) : asked_(asked) {}
  bool operator()() {
    if (!cancelled_ && asked_ && asked_()) cancelled_ = true;
    return cancelled_;
  }

 private:
  const std::function<bool()>& asked_;
  bool cancelled_{false};
};

Motions fromSegments(const int* left_straight_right, const double* turns, int n, double radius_m) {
  Motions motions;
  for (int i = 0; i < n; ++i) {
    if (std::abs(turns[i]) < kNothing) continue;
    motions.push_back({radius_m * turns[i], left_straight_right[i] * turns[i]});
  }
  return motions;
}

/// The shortest curve of Reeds and Shepp 1990; OMPL's lengths are in radii, negative backwards.
Motions reedsShepp(const ob::ReedsSheppStateSpace& space, const ob::State* from, const ob::State* to, double radius_m) {
  using Space = ob::ReedsSheppStateSpace;
  const Space::ReedsSheppPath curve = space.reedsShepp(from, to);
  int sides[5];
  for (int i = 0; i < 5; ++i)
    sides[i] = curve.type_[i] == Space::RS_LEFT ? 1 : curve.type_[i] == Space::RS_RIGHT ? -1 : 0;
  return fromSegments(sides, curve.length_, 5, radius_m);
}

/// [0, 2 pi); what rounding leaves below a full turn is none.
double positiveAngle(double angle_rad) {
  const double wrapped_rad = wrapAngle(angle_rad);
  const double positive_rad = wrapped_rad < 0.0 ? wrapped_rad + 2.0 * M_PI : wrapped_rad;
  return positive_rad > 2.0 * M_PI - kNothing ? 0.0 : positive_rad;
}

/// Arc, tangent, arc, all forwards (Dubins 1957), with the arcs to the given sides (1 left, -1 right); empty: the circles
/// are too near for it. Not OMPL's, whose assertions end the process for some pairs of poses in line (1.5.2 as packaged).
Motions arcLineArc(const Pose2d& from, const Pose2d& to, double radius_m, int first_side, int last_side) {
  const auto center = [&](const Pose2d& pose, int side) { return transform(pose, {0.0, side * radius_m}); };
  const Eigen::Vector2d between = center(to, last_side) - center(from, first_side);
  // Seen along the line, the centres lie beside it by a radius each, on the arcs' sides.
  const double across_m = (last_side - first_side) * radius_m;
  const double squared_m2 = between.squaredNorm() - across_m * across_m;
  if (squared_m2 < 0.0) return {};
  const double length_m = std::sqrt(squared_m2);
  const double heading_rad =
      between.norm() < kNothing ? from.yaw_rad : std::atan2(between.y(), between.x()) - std::atan2(across_m, length_m);
  const double first_rad = positiveAngle(first_side * (heading_rad - from.yaw_rad));
  const double last_rad = positiveAngle(last_side * (to.yaw_rad - heading_rad));
  Motions motions;
  if (first_rad > kNothing) motions.push_back({radius_m * first_rad, first_side * first_rad});
  if (length_m > kNothing) motions.push_back({length_m, 0.0});
  if (last_rad > kNothing) motions.push_back({radius_m * last_rad, last_side * last_rad});
  return motions;
}

Motions turnDriveTurn(const Pose2d& from, const Pose2d& to, bool is_forward) {
  const Eigen::Vector2d way = to.position() - from.position();
  const double length_m = way.norm();
  if (length_m < kNothing) return {{0.0, wrapAngle(to.yaw_rad - from.yaw_rad)}};
  const double heading_rad = std::atan2(way.y(), way.x()) + (is_forward ? 0.0 : M_PI);
  Motions motions;
  const double first_rad = wrapAngle(heading_rad - from.yaw_rad);
  const double last_rad = wrapAngle(to.yaw_rad - heading_rad);
  if (std::abs(first_rad) > kNothing) motions.push_back({0.0, first_rad});
  motions.push_back({is_forward ? length_m : -length_m, 0.0});
  if (std::abs(last_rad) > kNothing) motions.push_back({0.0, last_rad});
  return motions;
}

/// Ways to get from one pose to another, whatever stands between.
class Connections {
 public:
  explicit Connections(double turn_radius_m) : radius_m_(turn_radius_m) {
    reeds_shepp_ = std::make_shared<ob::ReedsSheppStateSpace>(radius_m_);
    // The pair of states is only a place for numbers, the same for all spaces.
    ob::RealVectorBounds bounds(2);
    bounds.setLow(-1.0);
    bounds.setHigh(1.0);
    reeds_shepp_->setBounds(bounds);
  }

  std::vector<Motions> between(const Pose2d& from, const Pose2d& to) const {
    const auto a = toOmpl(reeds_shepp_, from);
    const auto b = toOmpl(reeds_shepp_, to);
    std::vector<Motions> all;
    all.push_back(turnDriveTurn(from, to, true));
    all.push_back(turnDriveTurn(from, to, false));
    all.push_back(reedsShepp(*reeds_shepp_, a.get(), b.get(), radius_m_));
    for (const double factor : kCurves) {
      for (const int first_side : {1, -1}) {
        for (const int last_side : {1, -1}) {
          all.push_back(arcLineArc(from, to, factor * radius_m_, first_side, last_side));
        }
      }
    }
    all.erase(std::remove_if(all.begin(), all.end(),
                             [&](const Motions& motions) {
                               const Pose2d end = follow(from, motions);
                               return away_m(end, to) > kSamePlace || away_rad(end, to) > kSamePlace;
                             }),
              all.end());
    return all;
  }

 private:
  double radius_m_;
  std::shared_ptr<ob::ReedsSheppStateSpace> reeds_shepp_;
};

// ---------------------------------------------------------------------------------------------------- RRTConnect

/// Asks FootprintChecker; once cancelled, nothing is valid.
class Validity {
 public:
  Validity(const FootprintChecker& checker, Cancellation* cancelled) : checker_(checker), cancelled_(cancelled) {}

  bool isValid(const Pose2d& pose) const { return !(*cancelled_)() && checker_.isFree(pose); }
  bool isValid(const Pose2d& from, const Motions& motions) const {
    if ((*cancelled_)()) return false;
    return checker_.check(BasePath{from, motions}).isFree();
  }
  /// Whether the circle that the padded footprint sweeps touches free cells only.
  bool canTurnAt(const Pose2d& pose) const {
    const double radius_m = checker_.circumscribedRadius();
    const Eigen::Vector2d p_map = pose.position();
    if (checker_.clearance(p_map) > radius_m) return true;
    // The clearance is a lower bound: the last word have the cells.
    const NavigationGrid& grid = checker_.grid();
    const Eigen::Vector2i low = grid.cellOf(p_map - Eigen::Vector2d::Constant(radius_m));
    const Eigen::Vector2i high = grid.cellOf(p_map + Eigen::Vector2d::Constant(radius_m));
    for (int row = low.y(); row <= high.y(); ++row) {
      for (int column = low.x(); column <= high.x(); ++column) {
        if (grid.at(column, row) == SpaceState::kFree) continue;
        const Eigen::Vector2d beside = (p_map - grid.centerOf(column, row)).cwiseAbs();
        const Eigen::Vector2d gap = (beside.array() - 0.5 * grid.cell_size_m).max(0.0).matrix();
        if (gap.norm() <= radius_m) return false;
      }
    }
    return true;
  }

 private:
  const FootprintChecker& checker_;
  Cancellation* cancelled_;
};

class StateValidity : public ob::StateValidityChecker {
 public:
  StateValidity(const ob::SpaceInformationPtr& information, const Validity* validity)
      : ob::StateValidityChecker(information), validity_(validity) {}
  bool isValid(const ob::State* state) const override { return validity_->isValid(fromOmpl(state)); }

 private:
  const Validity* validity_;
};

class MotionValidity : public ob::MotionValidator {
 public:
  MotionValidity(const ob::SpaceInformationPtr& information, const Validity* validity, double radius_m)
      : ob::MotionValidator(information), validity_(validity), radius_m_(radius_m) {}
  bool checkMotion(const ob::State* from, const ob::State* to) const override {
    const auto& space = *si_->getStateSpace()->as<ob::ReedsSheppStateSpace>();
    const Pose2d begin = fromOmpl(from);
    const Pose2d end = fromOmpl(to);
    const Motions motions = reedsShepp(space, from, to, radius_m_);
    if (away_m(follow(begin, motions), end) > kSamePlace) return false;
    return validity_->isValid(end) && validity_->isValid(begin, motions);
  }
  bool checkMotion(const ob::State*, const ob::State*, std::pair<ob::State*, double>&) const override {
    throw std::logic_error("RRTConnect does not ask how far a motion is valid");
  }

 private:
  const Validity* validity_;
  double radius_m_;
};

/// Where samples are drawn.
struct Guide {
  std::vector<Eigen::Vector2d> way_map;     // Dijkstra's
  std::vector<Eigen::Vector2d> places_map;  // middles of cells that it reached
  double cell_size_m{0.05};
};

/// Draws states, and counts them: RRTConnect draws one in each iteration.
class Sampler : public ob::StateSampler {
 public:
  Sampler(const ob::StateSpace* space, const Guide& guide, Random* random, int* drawn)
      : ob::StateSampler(space), guide_(guide), random_(random), drawn_(drawn) {}

  void sampleUniform(ob::State* state) override {
    ++*drawn_;
    auto* se2 = state->as<State>();
    if (random_->uniform01() < kGuided && guide_.way_map.size() > 1) {
      const std::size_t i = random_->index(guide_.way_map.size());
      const Eigen::Vector2d ahead =
          guide_.way_map[std::min(i + 4, guide_.way_map.size() - 1)] - guide_.way_map[i < 4 ? 0 : i - 4];
      const double reversed_rad = random_->uniform01() < kGuideReversed ? M_PI : 0.0;
      se2->setXY(guide_.way_map[i].x() + kGuideSpread_m * random_->normal(),
                 guide_.way_map[i].y() + kGuideSpread_m * random_->normal());
      se2->setYaw(wrapAngle(std::atan2(ahead.y(), ahead.x()) + reversed_rad + kGuideSpread_rad * random_->normal()));
      space_->enforceBounds(state);
      return;
    }
    const Eigen::Vector2d& place = guide_.places_map[random_->index(guide_.places_map.size())];
    const double half_m = 0.5 * guide_.cell_size_m;
    se2->setXY(place.x() + random_->uniform(-half_m, half_m), place.y() + random_->uniform(-half_m, half_m));
    se2->setYaw(random_->uniform(-M_PI, M_PI));
  }
  void sampleUniformNear(ob::State*, const ob::State*, double) override {
    throw std::logic_error("RRTConnect does not sample near a state");
  }
  void sampleGaussian(ob::State*, const ob::State*, double) override {
    throw std::logic_error("RRTConnect does not sample near a state");
  }

 private:
  const Guide& guide_;
  Random* random_;
  int* drawn_;
};

/// Linear search, as exact, and with no generator of its own (OMPL's default draws its pivots from the shared one). No curve
/// is shorter than the straight line, which is asked first: it spares most of the expensive distances.
template <typename T>
class NearestByCurve : public ompl::NearestNeighborsLinear<T> {
 public:
  T nearest(const T& wanted) const override {
    const auto& data = this->data_;
    if (data.empty()) throw std::logic_error("nearest of none");
    const Pose2d p = fromOmpl(wanted->state);
    std::size_t best = 0;
    double straight_best = std::numeric_limits<double>::infinity();
    straight_.resize(data.size());
    for (std::size_t i = 0; i < data.size(); ++i) {
      straight_[i] = away_m(fromOmpl(data[i]->state), p);
      if (straight_[i] >= straight_best) continue;
      straight_best = straight_[i];
      best = i;
    }
    double shortest = this->distFun_(data[best], wanted);
    const std::size_t first = best;
    for (std::size_t i = 0; i < data.size(); ++i) {
      if (straight_[i] >= shortest || i == first) continue;
      const double curve = this->distFun_(data[i], wanted);
      if (curve >= shortest) continue;
      shortest = curve;
      best = i;
    }
    return data[best];
  }

 private:
  mutable std::vector<double> straight_;
};

struct Growth {
  std::optional<Motions> motions;
  int iterations{0};
};

Growth growTrees(const Pose2d& start, const Pose2d& goal, const NavigationGrid& grid, double radius_m,
                 int max_iterations, const Guide& guide, const Validity& validity, Cancellation* cancelled,
                 Random* random) {
  // OMPL's messages go to one handler of the whole process; nothing here is to be printed.
  static std::once_flag silence;
  std::call_once(silence, [] { ompl::msg::noOutputHandler(); });

  const auto space = std::make_shared<ob::ReedsSheppStateSpace>(radius_m);
  ob::RealVectorBounds bounds(2);
  for (unsigned i = 0; i < 2; ++i) {
    const int cells = i == 0 ? grid.width : grid.height;
    bounds.setLow(i, grid.origin_m[i]);
    bounds.setHigh(i, grid.origin_m[i] + grid.cell_size_m * cells);
  }
  space->setBounds(bounds);
  const auto information = std::make_shared<ob::SpaceInformation>(space);
  information->setStateValidityChecker(std::make_shared<StateValidity>(information, &validity));
  information->setMotionValidator(std::make_shared<MotionValidity>(information, &validity, radius_m));
  information->setup();
  Growth growth;
  // After setup, which draws samples of its own to scale projections that nobody here uses.
  space->setStateSamplerAllocator([&](const ob::StateSpace* allocated_for) {
    return std::make_shared<Sampler>(allocated_for, guide, random, &growth.iterations);
  });
  const auto first = toOmpl(space, start);
  const auto last = toOmpl(space, goal);
  // For a goal that is not valid RRTConnect would wait for ever.
  for (const ob::State* state : {first.get(), last.get()}) {
    if (!information->satisfiesBounds(state) || !information->isValid(state)) return growth;
  }
  const auto problem = std::make_shared<ob::ProblemDefinition>(information);
  problem->addStartState(first);
  const auto goal_states = std::make_shared<ob::GoalStates>(information);
  goal_states->addState(last);
  problem->setGoal(goal_states);

  ompl::geometric::RRTConnect planner(information);
  planner.setRange(kRange_m);
  planner.setNearestNeighbors<NearestByCurve>();
  planner.setProblemDefinition(problem);
  planner.setup();
  const ob::PlannerTerminationCondition ends([&] { return growth.iterations >= max_iterations || (*cancelled)(); });
  if (planner.solve(ends) != ob::PlannerStatus::EXACT_SOLUTION) return growth;
  auto& solution = *problem->getSolutionPath()->as<ompl::geometric::PathGeometric>();
  growth.motions.emplace();
  for (std::size_t i = 0; i + 1 < solution.getStateCount(); ++i) {
    const auto k = static_cast<unsigned>(i);
    const Motions curve = reedsShepp(*space, solution.getState(k), solution.getState(k + 1), radius_m);
    growth.motions->insert(growth.motions->end(), curve.begin(), curve.end());
  }
  return growth;
}

// ---------------------------------------------------------------------------------------------------- last check

struct Blocked {
  BasePath::Sample sample;
  const FootprintChecker* by;
};

/// The first pose from `from_m` on that is not free, or at which `stop` says so, at double the density of all other
/// checks: `tight` holds on the first `tight_start_m` and the last `tight_end_m`, `roomy` between.
template <typename Stop>
std::optional<Blocked> firstBlocked(const BasePath& path, double tight_start_m, double tight_end_m, double from_m,
                                    const FootprintChecker& tight, const FootprintChecker& roomy, Stop&& stop) {
  const double length_m = path.length();
  // The same poses whatever grid is asked: what was free is found free again.
  for (const BasePath::Sample& sample : path.sample(0.25 * roomy.grid().cell_size_m, roomy.circumscribedRadius())) {
    if (sample.at_m < from_m) continue;
    const bool is_tight = sample.at_m < tight_start_m - kNothing || sample.at_m > length_m - tight_end_m + kNothing;
    const FootprintChecker& checker = is_tight ? tight : roomy;
    if (stop() || !checker.isFree(sample.pose)) return Blocked{sample, &checker};
  }
  return std::nullopt;
}

// ------------------------------------------------------------------------------------------------------- one call

/// Straight out of where the robot stands.
struct Launch {
  double length_m{0.0};  // signed
  double tight_m{0.0};   // so much of it, unsigned, with the goal's padding
  Pose2d pose_map;
};

struct Candidate {
  BasePath path;
  double tight_m{0.0};
  double approach_m{0.0};
  double cost_s{0.0};
};

class Call {
 public:
  Call(const BasePlannerConfig& config, const MotionLimits& limits, const Polygon& footprint,
       std::shared_ptr<const NavigationGrid> grid, const Pose2d& start_map, const Pose2d& goal_map,
       const std::function<bool()>& is_cancelled)
      : config_(config),
        limits_(limits),
        footprint_(footprint),
        grid_(*grid),
        start_map_(start_map),
        goal_map_(goal_map),
        cancelled_(is_cancelled),
        tight_(grid, footprint, config.goal_padding_m),
        roomy_(grid, footprint, config.padding_m),
        validity_(roomy_, &cancelled_),
        connections_(config.turn_radius_m) {}

  BasePlan run() {
    plan_.path.start = start_map_;
    if (cancelled_()) return fail(BasePlanStatus::kCancelled, "");
    if (away_m(start_map_, goal_map_) <= config_.position_tolerance_m &&
        away_rad(start_map_, goal_map_) <= config_.yaw_tolerance_rad) {
      plan_.status = BasePlanStatus::kSolved;
      return plan_;
    }
    const FootprintVerdict at_start = tight_.check(start_map_);
    if (!at_start.isFree()) {
      return fail(startStatus(at_start),
                  "the robot stands at " + text(start_map_.position()) + " on " + text(at_start));
    }
    const FootprintVerdict at_goal = tight_.check(goal_map_);
    if (!at_goal.isFree()) {
      return fail(at_goal.state == SpaceState::kOccupied ? BasePlanStatus::kGoalOccupied : BasePlanStatus::kGoalUnknown,
                  "the footprint at the goal " + text(goal_map_.position()) + " stands on " + text(at_goal));
    }
    tryStraightLine();
    if (!best_ && !findApproach()) return finish();
    if (best_) return finish();
    findLaunches();
    if (launches_.empty()) return finish();
    tryAhead();
    if (best_) return finish();
    for (std::size_t i = 0; i < launches_.size(); ++i) search(i);
    return finish();
  }

 private:
  static BasePlanStatus startStatus(const FootprintVerdict& verdict) {
    return verdict.state == SpaceState::kOccupied ? BasePlanStatus::kStartOccupied : BasePlanStatus::kStartUnknown;
  }

  BasePlan fail(BasePlanStatus status, std::string message) {
    plan_.status = status;
    plan_.message = status == BasePlanStatus::kCancelled ? "cancelled" : std::move(message);
    plan_.path = {start_map_, {}};
    plan_.duration_s = 0.0;
    return plan_;
  }

  BasePlan finish() {
    if (cancelled_()) return fail(BasePlanStatus::kCancelled, "");
    if (!best_) return fail(plan_.status, plan_.message);
    plan_.status = BasePlanStatus::kSolved;
    plan_.message.clear();
    plan_.path = best_->path;
    plan_.tight_start_m = best_->tight_m;
    plan_.tight_end_m = best_->approach_m;
    plan_.duration_s = duration(best_->path, limits_);
    return plan_;
  }

  bool isWholeFree(const Candidate& candidate) {
    return !firstBlocked(candidate.path, candidate.tight_m, candidate.approach_m, 0.0, tight_, roomy_,
                         [this] { return cancelled_(); });
  }

  /// Takes the path if it stands the last check and is the best so far. False: it does not stand the check.
  bool offer(const Candidate& candidate) {
    if (best_ && best_->cost_s <= candidate.cost_s) return true;
    if (away_m(candidate.path.end(), goal_map_) > 5.0 * kExact_m ||
        away_rad(candidate.path.end(), goal_map_) > 5.0 * kExact_rad || !isWholeFree(candidate)) {
      return false;
    }
    best_ = candidate;
    return true;
  }

  /// Shortened; as it is, if that does not stand the last check.
  bool offer(const Launch& launch, const Motions& middle) {
    return offer(assemble(launch, shorten(launch, middle))) || offer(assemble(launch, middle));
  }

  /// How far straight on (`direction` 1 or -1) the footprint is free of anything nearer than the padding, and the way
  /// there with the goal's padding.
  std::optional<double> tightLength(int direction) {
    for (int i = 0; i * kStep_m <= config_.max_back_off_m + kNothing; ++i) {
      const Pose2d pose = moveAlongArc(start_map_, direction * i * kStep_m, 0.0);
      if (!tight_.isFree(pose)) return std::nullopt;
      if (i > 0 && !tight_.check(BasePath{moveAlongArc(pose, -direction * kStep_m, 0.0), {{direction * kStep_m, 0.0}}})
                        .isFree()) {
        return std::nullopt;
      }
      if (roomy_.isFree(pose)) return i * kStep_m;
    }
    return std::nullopt;
  }

  void tryStraightLine() {
    const Pose2d goal_start = compose(inverse(start_map_), goal_map_);
    if (std::abs(goal_start.y_m) > kExact_m || std::abs(goal_start.yaw_rad) > kExact_rad) return;
    Candidate candidate;
    candidate.path = {start_map_, {{goal_start.x_m, 0.0}}};
    candidate.approach_m = std::min(std::abs(goal_start.x_m), config_.approach_m);
    const std::optional<double> tight_m = tightLength(goal_start.x_m > 0.0 ? 1 : -1);
    candidate.tight_m = std::min(tight_m.value_or(config_.max_back_off_m), std::abs(goal_start.x_m));
    // Backwards is slow: far behind, turning round may be faster, and is for the search to find out.
    const bool is_sure = goal_start.x_m > 0.0 || -goal_start.x_m <= config_.max_back_off_m;
    if (is_sure) offer(candidate);
  }

  /// The longest straight last piece that is free and begins where the base can turn on the spot; or else where it can
  /// stand with its padding.
  bool findApproach() {
    FootprintVerdict blocked;
    std::optional<double> standing_m;
    double free_m = 0.0;
    for (int i = 1;; ++i) {
      const double length_m = std::min(i * kStep_m, config_.approach_m);
      const Pose2d begin = moveAlongArc(goal_map_, -length_m, 0.0);
      blocked = tight_.check(BasePath{begin, {{length_m, 0.0}}});
      if (!blocked.isFree()) break;
      free_m = length_m;
      if (length_m >= config_.min_approach_m - kNothing && roomy_.isFree(begin)) {
        const bool can_turn = validity_.canTurnAt(begin);
        if (can_turn || !turning_m_) standing_m = length_m;
        if (can_turn) turning_m_ = length_m;
      }
      if (length_m >= config_.approach_m) break;
    }
    if (!standing_m) {
      std::string message = "no straight approach to the goal " + text(goal_map_.position()) + ": ";
      if (free_m < config_.min_approach_m - kNothing) {
        message += "its last " + text(config_.min_approach_m) + " m meet " + text(blocked);
      } else {
        const Pose2d begin = moveAlongArc(goal_map_, -free_m, 0.0);
        message += text(free_m) + " m before it the footprint with its padding of " + text(config_.padding_m) +
                   " m meets " + text(roomy_.check(begin));
      }
      fail(BasePlanStatus::kNoApproach, message);
      return false;
    }
    approach_m_ = turning_m_.value_or(*standing_m);
    approach_map_ = moveAlongArc(goal_map_, -approach_m_, 0.0);
    return true;
  }

  /// Straight out of where the robot stands until it can turn on the spot, backwards or forwards; if neither comes to
  /// that, from where it stands with its padding.
  void findLaunches() {
    std::vector<Launch> standing;
    for (const int direction : {-1, 1}) {
      const std::optional<double> tight_m = tightLength(direction);
      if (!tight_m) continue;
      for (int i = static_cast<int>(std::lround(*tight_m / kStep_m)); i * kStep_m <= config_.max_back_off_m + kNothing;
           ++i) {
        const double length_m = i * kStep_m;
        const Pose2d pose = moveAlongArc(start_map_, direction * length_m, 0.0);
        const Pose2d before = moveAlongArc(start_map_, direction * std::max(*tight_m, length_m - kStep_m), 0.0);
        if (!validity_.isValid(before, {{direction * away_m(before, pose), 0.0}})) break;
        if (i * kStep_m == *tight_m) standing.push_back({direction * length_m, *tight_m, pose});
        if (!validity_.canTurnAt(pose)) continue;
        launches_.push_back({direction * length_m, *tight_m, pose});
        break;
      }
      if (!launches_.empty() && launches_.back().length_m == 0.0) return;  // no need to leave
    }
    if (launches_.empty()) launches_ = standing;
    if (launches_.size() == 2 && launches_[0].length_m == 0.0 && launches_[1].length_m == 0.0) launches_.pop_back();
    if (!launches_.empty()) return;
    const FootprintVerdict verdict = roomy_.check(start_map_);
    fail(startStatus(verdict), "the robot stands at " + text(start_map_.position()) + " nearer than " +
                                   text(config_.padding_m) + " m to " + text(verdict) +
                                   ", and cannot leave it straight back or ahead within " +
                                   text(config_.max_back_off_m) + " m");
  }

  Candidate assemble(const Launch& launch, const Motions& middle) const {
    Candidate candidate;
    candidate.path.start = start_map_;
    if (launch.length_m != 0.0) candidate.path.motions.push_back({launch.length_m, 0.0});
    candidate.path.motions.insert(candidate.path.motions.end(), middle.begin(), middle.end());
    candidate.path.motions.push_back({approach_m_, 0.0});
    candidate.tight_m = launch.tight_m;
    candidate.approach_m = approach_m_;
    BasePath tidied = candidate.path;
    tidied.tidy();
    if (away_m(tidied.end(), goal_map_) < kExact_m && away_rad(tidied.end(), goal_map_) < kExact_rad) {
      candidate.path = std::move(tidied);
    }
    candidate.cost_s =
        duration(candidate.path, limits_) + kPiece_s * static_cast<double>(candidate.path.motions.size());
    for (std::size_t i = 0; i < middle.size(); ++i) {
      if (isReverse(middle[i]) && (i == 0 || !isReverse(middle[i - 1]))) candidate.cost_s += kBackwards_s;
    }
    return candidate;
  }

  /// The best valid connection from the launch to the approach.
  std::optional<Motions> connectDirectly(const Launch& launch, bool forward_only) {
    std::vector<std::pair<double, Motions>> ways;
    for (Motions& motions : connections_.between(launch.pose_map, approach_map_)) {
      if (forward_only && std::any_of(motions.begin(), motions.end(), isReverse)) continue;
      const double cost_s = assemble(launch, motions).cost_s;
      ways.emplace_back(cost_s, std::move(motions));
    }
    std::stable_sort(ways.begin(), ways.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (auto& [cost_s, motions] : ways) {
      if (validity_.isValid(launch.pose_map, motions)) return std::move(motions);
    }
    return std::nullopt;
  }

  /// A goal ahead, almost in line, needs no back-off even where the base could not turn round.
  void tryAhead() {
    if (!roomy_.isFree(start_map_)) return;
    const Pose2d approach_start = compose(inverse(start_map_), approach_map_);
    if (approach_start.x_m < 0.0 || std::abs(approach_start.yaw_rad) > kAhead_rad ||
        std::abs(std::atan2(approach_start.y_m, approach_start.x_m)) > kAhead_rad) {
      return;
    }
    const Launch launch{0.0, 0.0, start_map_};
    if (const std::optional<Motions> middle = connectDirectly(launch, true)) {
      offer(launch, *middle);
    }
  }

  /// Turn, drive, turn, ... along Dijkstra's way for the circle in which the base can turn; nothing if a piece of it is
  /// not free, which happens only about ends where it cannot turn.
  std::optional<Motions> turnAndDrive(const Pose2d& from, const std::vector<Eigen::Vector2d>& way_map) {
    std::vector<Eigen::Vector2d> places = way_map;
    places.push_back(approach_map_.position());
    Motions motions;
    Pose2d here = from;
    const auto driveTo = [&](std::size_t k) {
      const Eigen::Vector2d way = places[k] - here.position();
      const double heading_rad = way.norm() < kNothing ? here.yaw_rad : std::atan2(way.y(), way.x());
      return turnDriveTurn(here, {places[k].x(), places[k].y(), heading_rad}, true);
    };
    for (std::size_t next = 0; next < places.size();) {
      if (cancelled_()) return std::nullopt;
      // The farthest place in one straight line: steps that double, then halve.
      std::size_t reached = next;
      if (!validity_.isValid(here, driveTo(next))) return std::nullopt;
      for (std::size_t stride = 1; stride > 0;) {
        const std::size_t to = std::min(reached + stride, places.size() - 1);
        if (to > reached && validity_.isValid(here, driveTo(to))) {
          reached = to;
          stride *= 2;
        } else {
          stride /= 2;
        }
      }
      const Motions drive = driveTo(reached);
      motions.insert(motions.end(), drive.begin(), drive.end());
      here = follow(here, drive);
      next = reached + 1;
    }
    const Motions last = {{0.0, wrapAngle(approach_map_.yaw_rad - here.yaw_rad)}};
    if (!validity_.isValid(here, last)) return std::nullopt;
    motions.push_back(last.front());
    return motions;
  }

  /// A place on the motions: `along` (0 .. 1) of one of them.
  struct Place {
    std::size_t motion;
    double along;
  };

  Place placeAt(const Motions& motions, double time_s) const {
    for (std::size_t i = 0; i < motions.size(); ++i) {
      const double here_s = roughTime(motions[i]);
      if (time_s > here_s && i + 1 < motions.size()) {
        time_s -= here_s;
        continue;
      }
      double along = here_s > 0.0 ? std::min(1.0, time_s / here_s) : 0.0;
      // No crumbs: they would be tidied away, and the path end beside the goal.
      const auto isCrumb = [&](double part) {
        return part * std::abs(motions[i].length_m) < kCutAtLeast_m &&
               part * std::abs(motions[i].turn_rad) < kCutAtLeast_rad;
      };
      if (isCrumb(along)) along = 0.0;
      if (isCrumb(1.0 - along)) along = 1.0;
      return {i, along};
    }
    return {0, 0.0};
  }

  double roughTime(const BaseMotion& motion) const {
    const double speed = motion.length_m > 0.0 ? limits_.forward_m_s : limits_.backward_m_s;
    return std::max(std::abs(motion.length_m) / speed, std::abs(motion.turn_rad) / limits_.turn_rad_s);
  }

  /// Replaces what is between two places by the best valid connection, if that is worth it.
  bool cut(const Launch& launch, const Place& a, const Place& b, Motions* motions, double* best_s) {
    const BasePath path{launch.pose_map, *motions};
    const Pose2d from = path.pose(a.motion, a.along);
    const Pose2d to = path.pose(b.motion, b.along);
    Motions head(motions->begin(), motions->begin() + static_cast<std::ptrdiff_t>(a.motion));
    const BaseMotion& first = (*motions)[a.motion];
    if (a.along > 0.0) head.push_back({a.along * first.length_m, a.along * first.turn_rad});
    Motions tail;
    const BaseMotion& last = (*motions)[b.motion];
    if (b.along < 1.0) tail.push_back({(1.0 - b.along) * last.length_m, (1.0 - b.along) * last.turn_rad});
    tail.insert(tail.end(), motions->begin() + static_cast<std::ptrdiff_t>(b.motion) + 1, motions->end());

    struct Option {
      Candidate candidate;
      Motions between;
      Motions all;
    };
    std::vector<Option> options;
    for (Motions& between : connections_.between(from, to)) {
      Option option;
      option.all = head;
      option.all.insert(option.all.end(), between.begin(), between.end());
      option.all.insert(option.all.end(), tail.begin(), tail.end());
      option.candidate = assemble(launch, option.all);
      if (option.candidate.cost_s > *best_s - kWorthwhile_s) continue;
      option.between = std::move(between);
      options.push_back(std::move(option));
    }
    std::stable_sort(options.begin(), options.end(),
                     [](const Option& x, const Option& y) { return x.candidate.cost_s < y.candidate.cost_s; });
    for (Option& option : options) {
      // The quick look first; the last check, or else a path cut many times might fail it in the end.
      if (!validity_.isValid(from, option.between) || !isWholeFree(option.candidate)) continue;
      *motions = std::move(option.all);
      *best_s = option.candidate.cost_s;
      return true;
    }
    return false;
  }

  /// All pairs of joints, the widest apart first, until none is worth it.
  void cutJoints(const Launch& launch, Motions* motions, double* best_s) {
    bool goes_on = motions->size() <= kMaxJoints;
    while (goes_on) {
      goes_on = false;
      for (std::size_t span = motions->size(); span >= 2 && !goes_on; --span) {
        for (std::size_t i = 0; i + span <= motions->size() && !goes_on; ++i) {
          if (cancelled_()) return;
          goes_on = cut(launch, {i, 0.0}, {i + span - 1, 1.0}, motions, best_s);
        }
      }
    }
  }

  Motions shorten(const Launch& launch, Motions motions) {
    if (motions.empty()) return motions;
    double best_s = assemble(launch, motions).cost_s;
    cutJoints(launch, &motions, &best_s);
    for (int round = 0; round < config_.shortcut_rounds && !cancelled_(); ++round) {
      double total_s = 0.0;
      for (const BaseMotion& motion : motions) total_s += roughTime(motion);
      double from_s = random_.uniform(0.0, total_s);
      double to_s = random_.uniform(0.0, total_s);
      if (from_s > to_s) std::swap(from_s, to_s);
      Place a = placeAt(motions, from_s);
      Place b = placeAt(motions, to_s);
      // Half of the ends at joints: whole motions.
      if (random_.uniform01() < 0.5) a.along = 0.0;
      if (random_.uniform01() < 0.5) b.along = 1.0;
      if (a.motion == b.motion) continue;
      cut(launch, a, b, &motions, &best_s);
    }
    cutJoints(launch, &motions, &best_s);
    return motions;
  }

  void search(std::size_t which) {
    const Launch& launch = launches_[which];
    if (std::optional<Motions> direct = connectDirectly(launch, false)) {
      const bool is_forward = std::none_of(direct->begin(), direct->end(), isReverse);
      if (offer(launch, *direct) && is_forward) return;
    }
    // Dijkstra's cells are asked at their middles, up to half a diagonal beside the base: a radius smaller by so much
    // misses no way that there is.
    const double slack_m = std::sqrt(0.5) * grid_.cell_size_m;
    const DistanceField field(grid_, launch.pose_map.position(), std::max(0.0, inscribedRadius(footprint_) - slack_m));
    Guide guide;
    guide.cell_size_m = grid_.cell_size_m;
    guide.way_map = field.pathTo(approach_map_.position());
    double nearest_m = std::numeric_limits<double>::infinity();
    Eigen::Vector2d nearest_map = launch.pose_map.position();
    for (int row = 0; row < grid_.height; ++row) {
      for (int column = 0; column < grid_.width; ++column) {
        const Eigen::Vector2d p_map = grid_.centerOf(column, row);
        if (!std::isfinite(field.distance(p_map))) continue;
        guide.places_map.push_back(p_map);
        const double beside_m = (p_map - approach_map_.position()).norm();
        if (beside_m >= nearest_m) continue;
        nearest_m = beside_m;
        nearest_map = p_map;
      }
    }
    if (guide.way_map.empty() || guide.places_map.empty()) {
      if (plan_.status == BasePlanStatus::kIterations && plan_.message.empty()) {
        fail(BasePlanStatus::kNoPath, "no way over free ground from " + text(launch.pose_map.position()) + " to " +
                                          text(approach_map_.position()) + " before the goal: it ends at " +
                                          text(nearest_map));
      }
      return;
    }
    if (cancelled_()) return;
    const DistanceField wide(grid_, launch.pose_map.position(), roomy_.circumscribedRadius());
    const std::vector<Eigen::Vector2d> wide_way = wide.pathTo(approach_map_.position());
    bool has_wide = false;
    if (!wide_way.empty()) {
      if (std::optional<Motions> motions = turnAndDrive(launch.pose_map, wide_way)) {
        has_wide = offer(launch, *motions);
      }
    }
    const int iterations = config_.max_iterations / static_cast<int>(launches_.size()) / kRuns;
    for (int run = 0; run < (has_wide ? 1 : kRuns) && !cancelled_(); ++run) {
      Growth growth = growTrees(launch.pose_map, approach_map_, grid_, config_.turn_radius_m, std::max(1, iterations),
                                guide, validity_, &cancelled_, &random_);
      plan_.iterations += growth.iterations;
      if (!growth.motions) continue;
      offer(launch, *growth.motions);
    }
    if (!best_) {
      fail(BasePlanStatus::kIterations, "no path found from " + text(launch.pose_map.position()) + " to " +
                                            text(approach_map_.position()) + " before the goal within " +
                                            std::to_string(plan_.iterations) + " iterations");
    }
  }

  const BasePlannerConfig& config_;
  const MotionLimits& limits_;
  const Polygon& footprint_;
  const NavigationGrid& grid_;
  const Pose2d start_map_;
  const Pose2d goal_map_;
  Cancellation cancelled_;
  FootprintChecker tight_;
  FootprintChecker roomy_;
  Validity validity_;
  Connections connections_;
  Random random_{config_.seed};

  std::optional<double> turning_m_;  // approach whose beginning leaves room to turn on the spot
  double approach_m_{0.0};
  Pose2d approach_map_;
  std::vector<Launch> launches_;
  std::optional<Candidate> best_;
  BasePlan plan_;
};

void requireGrid(const std::shared_ptr<const NavigationGrid>& grid) {
  if (!grid) throw std::invalid_argument("grid: none given");
  if (grid->width < 0 || grid->height < 0 || !(grid->cell_size_m > 0.0) ||
      grid->state.size() != static_cast<std::size_t>(grid->width) * static_cast<std::size_t>(grid->height)) {
    throw std::invalid_argument("grid: " + std::to_string(grid->state.size()) + " cells of " +
                                std::to_string(grid->cell_size_m) + " m, must be " + std::to_string(grid->width) +
                                " x " + std::to_string(grid->height) + " of a positive size");
  }
}

void requireFinite(const char* what, const Pose2d& pose) {
  if (std::isfinite(pose.x_m) && std::isfinite(pose.y_m) && std::isfinite(pose.yaw_rad)) return;
  std::ostringstream out;
  out << what << " = (" << pose.x_m << " m, " << pose.y_m << " m, " << pose.yaw_rad << " rad), must be finite";
  throw std::invalid_argument(out.str());
}

}  // namespace

BasePlanner::BasePlanner(const BasePlannerConfig& config, const MotionLimits& limits, Polygon footprint)
    : config_(config), limits_(limits), footprint_(std::move(footprint)) {
  std::vector<std::string> problems = interactive_mapping::problemsOf(config_);
  for (const std::string& problem : limits_.validate()) problems.push_back(problem);
  interactive_mapping::refuseIfAny("impossible planner:", problems);
  padPolygon(footprint_, config_.padding_m);  // throws for what is no footprint
  inscribedRadius(footprint_);
}

BasePlan BasePlanner::plan(std::shared_ptr<const NavigationGrid> grid, const Pose2d& start_map, const Pose2d& goal_map,
                           const std::function<bool()>& is_cancelled) const {
  requireGrid(grid);
  requireFinite("start", start_map);
  requireFinite("goal", goal_map);
  return Call(config_, limits_, footprint_, std::move(grid), start_map, goal_map, is_cancelled).run();
}

FootprintVerdict BasePlanner::recheck(const BasePlan& plan, double from_m,
                                      std::shared_ptr<const NavigationGrid> grid) const {
  requireGrid(grid);
  if (!std::isfinite(from_m)) {
    throw std::invalid_argument("from = " + std::to_string(from_m) + " m along the path, must be finite");
  }
  if (plan.path.motions.empty()) return {};
  const FootprintChecker tight(grid, footprint_, config_.goal_padding_m);
  const FootprintChecker roomy(std::move(grid), footprint_, config_.padding_m);
  const std::optional<Blocked> blocked =
      firstBlocked(plan.path, plan.tight_start_m, plan.tight_end_m, from_m, tight, roomy, [] { return false; });
  if (!blocked) return {};
  FootprintVerdict verdict = blocked->by->check(blocked->sample.pose);
  verdict.at_m = blocked->sample.at_m;
  return verdict;
}

}  // namespace base_navigation
