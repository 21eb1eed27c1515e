// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/joint_planner.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <stdexcept>

#include <ompl/base/ScopedState.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/datastructures/NearestNeighborsLinear.h>

#include <interactive_mapping_common/search/random.h>
#include <interactive_mapping_common/search/rrt_connect.h>

namespace motion_planning {
namespace {

namespace ob = ompl::base;
using Space = ob::RealVectorStateSpace;
using interactive_mapping::Random;

constexpr double kSameState_rad = 1e-9;
constexpr int kMaxRejectedSamples = 100;  // of JointSpace::sample outside the window, before one is taken uniformly

ArmVector fromOmpl(const ob::State* state) {
  return Eigen::Map<const ArmVector>(state->as<Space::StateType>()->values);
}

void toOmpl(const ArmVector& q, ob::State* state) {
  Eigen::Map<ArmVector>(state->as<Space::StateType>()->values) = q;
}

/// Asks whether states and straight motions are valid; once cancelled, nothing is.
class Validity {
 public:
  Validity(const JointSpace& space, double step_rad, const std::function<bool()>& is_cancelled)
      : space_(space), step_rad_(step_rad), is_cancelled_(is_cancelled) {}

  bool isCancelled() {
    if (!cancelled_ && is_cancelled_ && is_cancelled_()) cancelled_ = true;
    return cancelled_;
  }

  bool isValid(const ArmVector& q) {
    if (isCancelled()) return false;
    if ((q.array() < space_.lower_rad.array()).any() || (q.array() > space_.upper_rad.array()).any()) return false;
    ++states_checked_;
    return space_.is_valid(q);
  }

  /// `from` is valid. Halves first: what is in the way is more often in the middle than near the ends.
  bool isMotionValid(const ArmVector& from, const ArmVector& to, bool check_end) {
    if (check_end && !isValid(to)) return false;
    const int parts = static_cast<int>(std::ceil((to - from).lpNorm<Eigen::Infinity>() / step_rad_));
    int stride = 1;
    while (stride < parts) stride *= 2;
    for (; stride > 1; stride /= 2) {
      for (int k = stride / 2; k < parts; k += stride) {
        if (!isValid(from + (to - from) * (static_cast<double>(k) / parts))) return false;
      }
    }
    return true;
  }

  std::size_t statesChecked() const { return states_checked_; }

 private:
  const JointSpace& space_;
  double step_rad_;
  const std::function<bool()>& is_cancelled_;
  bool cancelled_{false};
  std::size_t states_checked_{0};
};

double lengthOf(const JointPath& path) {
  double length = 0.0;
  for (std::size_t i = 0; i + 1 < path.size(); ++i) length += (path[i + 1] - path[i]).norm();
  return length;
}

/// Ends of a path by the length along it.
struct PathPlace {
  std::size_t segment;
  ArmVector q;
};

PathPlace placeAt(const JointPath& path, double along) {
  for (std::size_t i = 0; i + 1 < path.size(); ++i) {
    const double length = (path[i + 1] - path[i]).norm();
    if (along <= length && length > 0.0) return {i, path[i] + (path[i + 1] - path[i]) * (along / length)};
    along -= length;
  }
  return {path.size() - 2, path.back()};
}

/// Leaves out waypoints, the longest cuts first.
void cutVertices(Validity* validity, JointPath* path) {
  for (std::size_t from = 0; from + 2 < path->size() && !validity->isCancelled(); ++from) {
    for (std::size_t to = path->size() - 1; to > from + 1; --to) {
      if (!validity->isMotionValid((*path)[from], (*path)[to], false)) continue;
      path->erase(path->begin() + static_cast<std::ptrdiff_t>(from) + 1,
                  path->begin() + static_cast<std::ptrdiff_t>(to));
      break;
    }
  }
}

/// Joins two random places on the path by a straight line where that is valid.
void shortcut(int rounds, Validity* validity, Random* random, JointPath* path) {
  double length = lengthOf(*path);
  for (int round = 0; round < rounds && path->size() > 2 && !validity->isCancelled(); ++round) {
    double a = random->uniform(0.0, length);
    double b = random->uniform(0.0, length);
    if (a > b) std::swap(a, b);
    const PathPlace from = placeAt(*path, a);
    const PathPlace to = placeAt(*path, b);
    if (from.segment == to.segment) continue;
    const double saved = b - a - (to.q - from.q).norm();
    if (saved < 0.01 * length) continue;  // not worth its checks
    // Places between checked states need not be valid; the pieces that stay are straight but cut anew.
    const ArmVector& before = (*path)[from.segment];
    const ArmVector& after = (*path)[to.segment + 1];
    if (!validity->isValid(from.q) || !validity->isMotionValid(from.q, to.q, true)) continue;
    if (!validity->isMotionValid(before, from.q, false) || !validity->isMotionValid(to.q, after, false)) continue;
    JointPath next(path->begin(), path->begin() + static_cast<std::ptrdiff_t>(from.segment) + 1);
    next.push_back(from.q);
    next.push_back(to.q);
    next.insert(next.end(), path->begin() + static_cast<std::ptrdiff_t>(to.segment) + 1, path->end());
    *path = std::move(next);
    length = lengthOf(*path);
  }
}

/// Draws each waypoint toward the line between its neighbours: half of the way, or a quarter where that is not valid.
void smooth(int rounds, Validity* validity, JointPath* path) {
  for (int round = 0; round < rounds; ++round) {
    for (std::size_t i = 1; i + 1 < path->size() && !validity->isCancelled(); ++i) {
      const ArmVector& before = (*path)[i - 1];
      const ArmVector& after = (*path)[i + 1];
      const ArmVector way = after - before;
      if (way.squaredNorm() < kSameState_rad * kSameState_rad) continue;
      const double t = std::clamp(((*path)[i] - before).dot(way) / way.squaredNorm(), 0.0, 1.0);
      const ArmVector foot = before + t * way;
      for (const double share : {0.5, 0.25}) {
        const ArmVector moved = (*path)[i] + share * (foot - (*path)[i]);
        if (!validity->isValid(moved) || !validity->isMotionValid(before, moved, false) ||
            !validity->isMotionValid(moved, after, false)) {
          continue;
        }
        (*path)[i] = moved;
        break;
      }
    }
  }
}

struct Tree {
  JointPath path;  // empty: none found
  int iterations{0};
};

/// By the joint space's own samples as far as they lie within the bounds.
void draw(const JointSpace& joints, Random* random, const ob::StateSpace* space, ob::State* state) {
  const auto& bounds = space->as<Space>()->getBounds();
  if (joints.sample) {
    const std::function<double()> uniform01 = [random] { return random->uniform01(); };
    for (int attempt = 0; attempt < kMaxRejectedSamples; ++attempt) {
      toOmpl(joints.sample(uniform01), state);
      if (space->satisfiesBounds(state)) return;
    }
  }
  ArmVector q;
  for (int i = 0; i < 6; ++i) q[i] = random->uniform(bounds.low[i], bounds.high[i]);
  toOmpl(q, state);
}

Tree growTrees(const JointSpace& joints, const ArmVector& start, const std::vector<ArmVector>& goals,
               const JointPlannerConfig& config, Validity* validity, Random* random) {
  ArmVector lower = start;
  ArmVector upper = start;
  for (const ArmVector& goal : goals) {
    lower = lower.cwiseMin(goal);
    upper = upper.cwiseMax(goal);
  }
  lower = (lower.array() - config.joint_window_rad).matrix().cwiseMax(joints.lower_rad);
  upper = (upper.array() + config.joint_window_rad).matrix().cwiseMin(joints.upper_rad);
  const auto space = std::make_shared<Space>(6);
  ob::RealVectorBounds bounds(6);
  for (int i = 0; i < 6; ++i) {
    bounds.setLow(static_cast<unsigned>(i), lower[i]);
    bounds.setHigh(static_cast<unsigned>(i), upper[i]);
  }
  space->setBounds(bounds);

  interactive_mapping::TreeSearch search;
  search.is_valid = [&](const ob::State* state) { return validity->isValid(fromOmpl(state)); };
  search.is_motion_valid = [&](const ob::State* from, const ob::State* to) {
    return validity->isMotionValid(fromOmpl(from), fromOmpl(to), true);
  };
  search.sample = [&](const ob::StateSpace* of, ob::State* state) { draw(joints, random, of, state); };
  search.is_cancelled = [&] { return validity->isCancelled(); };
  search.range = config.range_rad;
  search.max_iterations = config.max_iterations;

  std::vector<ob::ScopedState<Space>> ends(1 + goals.size(), ob::ScopedState<Space>(space));
  std::vector<const ob::State*> goal_states;
  toOmpl(start, ends[0].get());
  for (std::size_t i = 0; i < goals.size(); ++i) {
    toOmpl(goals[i], ends[i + 1].get());
    goal_states.push_back(ends[i + 1].get());
  }
  const auto found =
      interactive_mapping::connectByTrees<ompl::NearestNeighborsLinear>(space, ends[0].get(), goal_states, search);
  Tree tree;
  tree.iterations = found.iterations;
  if (!found.path) return tree;
  for (const ob::State* waypoint : found.path->getStates()) tree.path.push_back(fromOmpl(waypoint));
  return tree;
}

void requireFinite(const char* what, const ArmVector& q) {
  if (!q.allFinite()) throw std::invalid_argument(std::string(what) + " has an angle that is not finite");
}

}  // namespace

JointPlanResult planJointPath(const JointSpace& space, const ArmVector& start, const std::vector<ArmVector>& goals,
                              const JointPlannerConfig& config, const std::function<bool()>& is_cancelled) {
  interactive_mapping::requireValid("impossible joint planner:", config);
  if (!space.is_valid) throw std::invalid_argument("joint space has no validity test");
  if (goals.empty()) throw std::invalid_argument("goals: 0, must be at least 1");
  requireFinite("start", start);
  for (const ArmVector& goal : goals) requireFinite("a goal", goal);
  if (!(space.lower_rad.array() < space.upper_rad.array()).all() || !space.lower_rad.allFinite() ||
      !space.upper_rad.allFinite()) {
    throw std::invalid_argument("joint space: lower_rad must be finite and below upper_rad for every joint");
  }

  JointPlanResult result;
  Validity validity(space, config.check_step_rad, is_cancelled);
  Random random(config.seed);
  const auto finish = [&](JointPlanStatus status) {
    result.status = validity.isCancelled() ? JointPlanStatus::kCancelled : status;
    result.states_checked = validity.statesChecked();
    if (result.status != JointPlanStatus::kSolved) result.path.clear();
    return result;
  };
  if (!validity.isValid(start)) return finish(JointPlanStatus::kStartInvalid);
  std::vector<std::size_t> usable;
  for (std::size_t i = 0; i < goals.size(); ++i) {
    const bool is_new = std::none_of(usable.begin(), usable.end(), [&](std::size_t other) {
      return (goals[other] - goals[i]).lpNorm<Eigen::Infinity>() < kSameState_rad;
    });
    if (is_new && validity.isValid(goals[i])) usable.push_back(i);
  }
  if (usable.empty()) return finish(JointPlanStatus::kGoalInvalid);

  std::vector<std::size_t> nearest_first = usable;
  std::stable_sort(nearest_first.begin(), nearest_first.end(), [&](std::size_t a, std::size_t b) {
    return (goals[a] - start).squaredNorm() < (goals[b] - start).squaredNorm();
  });
  for (const std::size_t goal : nearest_first) {
    if (!validity.isMotionValid(start, goals[goal], false)) continue;
    result.goal = goal;
    result.path = {start, goals[goal]};
    return finish(JointPlanStatus::kSolved);
  }

  std::vector<ArmVector> usable_goals;
  for (const std::size_t i : usable) usable_goals.push_back(goals[i]);
  Tree tree = growTrees(space, start, usable_goals, config, &validity, &random);
  result.iterations = tree.iterations;
  if (tree.path.empty()) return finish(JointPlanStatus::kIterations);
  result.path = std::move(tree.path);
  const auto reached = std::find(goals.begin(), goals.end(), result.path.back());
  result.goal = static_cast<std::size_t>(reached - goals.begin());
  cutVertices(&validity, &result.path);
  shortcut(config.shortcut_rounds, &validity, &random, &result.path);
  cutVertices(&validity, &result.path);
  smooth(config.smooth_rounds, &validity, &result.path);
  return finish(JointPlanStatus::kSolved);
}

}  // namespace motion_planning
