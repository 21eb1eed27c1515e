// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include <interactive_mapping_common/search/random.h>

#include "planning/candidate.h"

/// The stages of a plan, in the order in which BasePlanner::plan goes through them.
namespace base_navigation {

/// Why the robot cannot stand at start or goal.
std::optional<PlanFailure> blockedEnd(const PlanTask& task);

/// How far straight on (`direction` 1 or -1) the footprint is free of anything nearer than the padding, and the way
/// there with the goal's padding.
std::optional<double> tightLength(const PlanTask& task, int direction);

/// The longest straight last piece that is free and begins where the base can turn on the spot; or else where it can
/// stand with its padding.
Result<Approach> findApproach(const PlanTask& task);

/// Straight out of where the robot stands until it can turn on the spot, backwards or forwards; if neither comes to
/// that, from where it stands with its padding. Not empty.
Result<std::vector<Launch>> findLaunches(const PlanTask& task);

/// The motions between launch and approach, and with them the best path. Counts the iterations. Why there is no path, if
/// there is none.
PlanFailure searchBetween(const PlanTask& task, const std::vector<Launch>& launches, const Approach& approach,
                          BestPath* best, int* iterations);

/// Where samples are drawn.
struct Guide {
  std::vector<Eigen::Vector2d> way_map;     // Dijkstra's
  std::vector<Eigen::Vector2d> places_map;  // middles of cells that it reached
};

struct Growth {
  std::optional<Motions> motions;
  int iterations{0};
};

/// One run of RRTConnect over Reeds-Shepp curves.
Growth growTrees(const PlanTask& task, const Pose2d& from_map, const Pose2d& to_map, const Guide& guide,
                 int max_iterations, interactive_mapping::Random* random);

/// The motions between launch and approach with pieces replaced by faster free ones, at joints and at random places.
Motions shorten(const PlanTask& task, const Connections& connections, const Launch& launch, const Approach& approach,
                Motions middle, interactive_mapping::Random* random);

}  // namespace base_navigation
