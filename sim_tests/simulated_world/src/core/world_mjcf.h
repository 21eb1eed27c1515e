// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "simulated_world/world.h"

namespace simulated_world {

/// The complete model: options, light, ground, walls, robot, bricks, the magnet's weld and the wrist's sensors.
std::string worldMjcf(const std::string& robot_mjcf, const std::string& assets_mjcf,
                      const std::vector<WorldBrick>& bricks, const std::vector<Wall>& walls, const WorldConfig& config);

}  // namespace simulated_world
