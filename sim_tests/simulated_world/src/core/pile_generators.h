// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "simulated_world/pile_scene.h"
#include "synthetic_depth/seeded_random.h"

namespace simulated_world {

/// Of the largest of these types [m].
double longestDiagonal(const std::vector<BrickType>& types);

/// Bricks of a tipped heap before they drop, of the types in turn. `wedged` of them, of the first type, are flat on the
/// ground with a heavy one across. Ids are not set.
std::vector<BrickPlacement> tippedBricks(const TippedConfig& config, const std::vector<BrickType>& types, int wedged,
                                         double heavy_mass_kg, double gap_m, synthetic_depth::SeededRandom& random);

/// Any orientation, all equally likely.
Eigen::Matrix3d anyOrientation(synthetic_depth::SeededRandom& random);

/// Bricks of a stack, the lowest first, `gap_m` between them; ids are not set.
std::vector<BrickPlacement> stackedBricks(const StackConfig& config, const BrickType& type, double gap_m);

/// Makes decoys of as many of the bricks as `config` wants beyond those that are decoys already.
void drawDecoys(const DecoyConfig& config, std::vector<BrickPlacement>* bricks, synthetic_depth::SeededRandom& random);

}  // namespace simulated_world
