// SPDX-License-Identifier: BSD-3-Clause
#include "world_mjcf.h"

#include <sstream>

#include "simulated_world/physics_options.h"
#include "simulated_world/scene_view.h"
#include "simulated_world/world_observation.h"

namespace simulated_world {

std::string worldMjcf(const std::string& robot_mjcf, const std::string& assets_mjcf,
                      const std::vector<WorldBrick>& bricks, const std::vector<Wall>& walls,
                      const WorldConfig& config) {
  const PhysicsOptions physics = config.physics.forBricks(bricks.size());
  std::ostringstream xml;
  xml << "<mujoco model=\"pile\">\n"
      << "<compiler angle=\"radian\"/>\n"
      << physicsXml(physics);
  // What the robot's camera sees is lit from its own place: even, and the cheapest light there is.
  if (config.has_sun && !config.has_surroundings) {
    xml << "<visual>\n" << surroundingsVisualXml() << "</visual>\n";
  } else if (!config.has_surroundings) {
    xml << "<visual><headlight ambient=\"0.4 0.4 0.4\" diffuse=\"0.45 0.45 0.45\" specular=\"0 0 0\"/></visual>\n";
  } else {
    xml << "<visual>\n" << surroundingsVisualXml() << "</visual>\n<asset>\n" << surroundingsAssetsXml() << "</asset>\n";
  }
  xml << "<asset>\n"
      << assets_mjcf << "</asset>\n<worldbody>\n"
      << (config.has_surroundings || config.has_sun ? surroundingsLightsXml() : "")
      << groundXml(physics, config.has_surroundings ? "material=\"ground\"" : "") << robot_mjcf;
  for (const WorldBrick& brick : bricks) {
    const std::string material = brick.material.empty() ? "" : " material=\"" + brick.material + "\"";
    xml << brickXml(brick.placement, physics, "group=\"1\"" + material);
  }
  for (std::size_t i = 0; i < walls.size(); ++i) {
    xml << wallXml(i, walls[i], physics, "group=\"1\" rgba=\"0.72 0.71 0.68 1\"");
  }
  for (int i = 0; i < kMaxObstacles; ++i) {
    xml << obstacleXml(i, physics, "group=\"1\" rgba=\"0.25 0.35 0.6 1\"");
  }
  xml << "</worldbody>\n";
  if (!bricks.empty()) {
    // Which brick the weld holds is written into the model when the magnet takes it.
    xml << "<equality><weld name=\"magnet_hold\" body1=\"magnet\" body2=\""
        << brickBodyName(bricks.front().placement.id)
        << "\" active=\"false\" solref=\"0.005 1\" solimp=\"0.99 0.999 0.0001\"/></equality>\n";
  }
  xml << "<sensor><force name=\"wrist_force\" site=\"wrist_ft\"/><torque name=\"wrist_torque\" "
         "site=\"wrist_ft\"/></sensor>\n"
      << "</mujoco>\n";
  return xml.str();
}

}  // namespace simulated_world
