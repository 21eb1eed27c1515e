// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "simulated_world/pile_scene.h"

namespace simulated_world {

/// How the world with bricks is simulated: one place for settling a pile and for the run with the robot, so that a pile
/// that stands in the one stands in the other.
struct PhysicsOptions {
  double timestep_s{0.002};
  int solver_iterations{50};  ///< at most, of Newton's method; a pile at rest needs one
  double solver_tolerance{1e-8};
  double impratio{1.0};                   ///< stiffness of friction over that of the normal force
  double contact_time_constant_s{0.005};  ///< a contact gives way and recovers like a critically damped spring
  int max_contacts{900};  ///< buffers of MuJoCo 2: 40 bricks at rest have up to 340 contacts of 3 constraints
  int max_constraints{2700};

  /// The same with buffers for so many bricks.
  PhysicsOptions forBricks(std::size_t count) const;

  std::vector<std::string> validate() const;
};

/// `<option>` and `<size>` elements of an MJCF model. Throws std::invalid_argument with all that is wrong with `options`.
std::string physicsXml(const PhysicsOptions& options);

/// `<geom>` of the ground, an infinite plane at z = 0 named "ground". What slides on it slides with its own friction.
std::string groundXml(const PhysicsOptions& options, const std::string& geom_attributes = "");

/// `<geom>` of a wall, which is part of the ground; its name is wallName(index).
std::string wallXml(std::size_t index, const Wall& wall, const PhysicsOptions& options,
                    const std::string& geom_attributes = "");

/// Free `<body>` with a box for a brick, or with the shape of its decoy; body and geom are named brickBodyName(id), the
/// joint with "_joint" after it. `geom_attributes` go into the geom, e.g. a material.
std::string brickXml(const BrickPlacement& brick, const PhysicsOptions& options,
                     const std::string& geom_attributes = "");

/// `<body>` of an obstacle that is not there: it touches nothing. Body and geom are named obstacleBodyName(index).
std::string obstacleXml(int index, const PhysicsOptions& options, const std::string& geom_attributes = "");

}  // namespace simulated_world
