// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>
#include <vector>

#include "simulated_world/pile_scene.h"

namespace simulated_world {

/// Bricks of a pile at rest that lie on a brick: they touch it, and their middle is higher by a quarter of its height.
std::vector<int> carriedBy(int id, const std::vector<BrickPlacement>& bricks);
/// Those of one kind.
std::vector<int> carriedBy(int id, const std::vector<BrickPlacement>& bricks, Decoy kind);

/// Why bricks of a pile at rest can never be picked, by id; the others can, once those on them are gone. A brick needs a
/// tag, a plate that does not look downwards, and a weight below `holding_force_N`; and nothing may lie on it that stays.
std::map<int, std::string> unpickable(const std::vector<BrickPlacement>& bricks, double holding_force_N);

}  // namespace simulated_world
