// SPDX-License-Identifier: BSD-3-Clause
#include "planning/stages.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace base_navigation {
namespace {

constexpr double kCutAtLeast_m = 0.002;  // pieces that shortening cuts off are not smaller
constexpr double kCutAtLeast_rad = 0.002;
constexpr double kWorthwhile_s = 0.01;
constexpr std::size_t kMaxJoints = 16;  // of a path with more, not all pairs of joints are tried

/// A place on the motions: `along` (0 .. 1) of one of them.
struct Place {
  std::size_t motion;
  double along;
};

void append(const Motions& more, Motions* motions) {
  motions->insert(motions->end(), more.begin(), more.end());
}

class Shortening {
 public:
  Shortening(const PlanTask& task, const Connections& connections, const Launch& launch, const Approach& approach,
             Motions* motions)
      : task_(task), connections_(connections), launch_(launch), approach_(approach), motions_(*motions) {}

  /// All pairs of joints, the widest apart first, until none is worth it.
  void cutJoints() {
    bool goes_on = motions_.size() <= kMaxJoints;
    while (goes_on) {
      goes_on = false;
      for (std::size_t span = motions_.size(); span >= 2 && !goes_on; --span) {
        for (std::size_t i = 0; i + span <= motions_.size() && !goes_on; ++i) {
          if (task_.isCancelled()) return;
          goes_on = cut({i, 0.0}, {i + span - 1, 1.0});
        }
      }
    }
  }

  void cutAtRandom(interactive_mapping::Random* random) {
    double total_s = 0.0;
    for (const BaseMotion& motion : motions_) total_s += roughTime(motion);
    double from_s = random->uniform(0.0, total_s);
    double to_s = random->uniform(0.0, total_s);
    if (from_s > to_s) std::swap(from_s, to_s);
    Place a = placeAt(from_s);
    Place b = placeAt(to_s);
    // Half of the ends at joints: whole motions.
    if (random->uniform01() < 0.5) a.along = 0.0;
    if (random->uniform01() < 0.5) b.along = 1.0;
    if (a.motion != b.motion) cut(a, b);
  }

 private:
  struct Option {
    Candidate candidate;
    Motions between;
    Motions all;
  };

  /// Replaces what is between two places by the best valid connection, if that is worth it.
  bool cut(const Place& a, const Place& b) {
    const BasePath path{launch_.pose_map, motions_};
    const Pose2d from = path.pose(a.motion, a.along);
    const Pose2d to = path.pose(b.motion, b.along);
    Motions head(motions_.begin(), motions_.begin() + static_cast<std::ptrdiff_t>(a.motion));
    const BaseMotion& first = motions_[a.motion];
    if (a.along > 0.0) head.push_back({a.along * first.length_m, a.along * first.turn_rad});
    Motions tail;
    const BaseMotion& last = motions_[b.motion];
    if (b.along < 1.0) tail.push_back({(1.0 - b.along) * last.length_m, (1.0 - b.along) * last.turn_rad});
    tail.insert(tail.end(), motions_.begin() + static_cast<std::ptrdiff_t>(b.motion) + 1, motions_.end());

    std::vector<Option> options;
    for (Motions& between : connections_.between(from, to)) {
      Option option;
      for (const Motions* part : {&head, &between, &tail}) append(*part, &option.all);
      option.candidate = assemble(task_, launch_, approach_, option.all);
      if (option.candidate.cost_s > best_s_ - kWorthwhile_s) continue;
      option.between = std::move(between);
      options.push_back(std::move(option));
    }
    std::stable_sort(options.begin(), options.end(),
                     [](const Option& x, const Option& y) { return x.candidate.cost_s < y.candidate.cost_s; });
    for (Option& option : options) {
      // The quick look first; the last check, or else a path cut many times might fail it in the end.
      if (!task_.isFree(from, option.between) || !isWholeFree(task_, option.candidate)) continue;
      motions_ = std::move(option.all);
      best_s_ = option.candidate.cost_s;
      return true;
    }
    return false;
  }

  Place placeAt(double time_s) const {
    for (std::size_t i = 0; i < motions_.size(); ++i) {
      const double here_s = roughTime(motions_[i]);
      if (time_s > here_s && i + 1 < motions_.size()) {
        time_s -= here_s;
        continue;
      }
      double along = here_s > 0.0 ? std::min(1.0, time_s / here_s) : 0.0;
      // No crumbs: they would be tidied away, and the path end beside the goal.
      const auto isCrumb = [&](double part) {
        return part * std::abs(motions_[i].length_m) < kCutAtLeast_m &&
               part * std::abs(motions_[i].turn_rad) < kCutAtLeast_rad;
      };
      if (isCrumb(along)) along = 0.0;
      if (isCrumb(1.0 - along)) along = 1.0;
      return {i, along};
    }
    return {0, 0.0};
  }

  double roughTime(const BaseMotion& motion) const {
    const double speed = motion.length_m > 0.0 ? task_.limits.forward_m_s : task_.limits.backward_m_s;
    return std::max(std::abs(motion.length_m) / speed, std::abs(motion.turn_rad) / task_.limits.turn_rad_s);
  }

  const PlanTask& task_;
  const Connections& connections_;
  const Launch& launch_;
  const Approach& approach_;
  Motions& motions_;
  double best_s_{assemble(task_, launch_, approach_, motions_).cost_s};
};

}  // namespace

Motions shorten(const PlanTask& task, const Connections& connections, const Launch& launch, const Approach& approach,
                Motions middle, interactive_mapping::Random* random) {
  if (middle.empty()) return middle;
  Shortening shortening(task, connections, launch, approach, &middle);
  shortening.cutJoints();
  for (int round = 0; round < task.config.shortcut_rounds && !task.isCancelled(); ++round) {
    shortening.cutAtRandom(random);
  }
  shortening.cutJoints();
  return middle;
}

}  // namespace base_navigation
