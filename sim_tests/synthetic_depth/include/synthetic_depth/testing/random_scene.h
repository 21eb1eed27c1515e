// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "synthetic_depth/scene.h"
#include "synthetic_depth/seeded_random.h"

namespace synthetic_depth {
namespace test {

inline Eigen::Vector3d randomPoint(SeededRandom& random, const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
  const double x = random.uniform(low.x(), high.x());
  const double y = random.uniform(low.y(), high.y());
  const double z = random.uniform(low.z(), high.z());
  return {x, y, z};
}

inline Box makeBox(int id, const Eigen::Vector3d& center, const Eigen::Vector3d& half_extents,
                   const Eigen::Vector3d& rpy_rad = Eigen::Vector3d::Zero()) {
  Box box;
  box.id = id;
  box.T_scene_box = poseFromXyzRpy(center, rpy_rad);
  box.half_extents_m = half_extents;
  return box;
}

/// Small camera in the default map frame, one frame from `eye` to `target`, no boxes, no noise.
inline Scene makeScene(const Eigen::Vector3d& eye, const Eigen::Vector3d& target, int num_frames = 1) {
  Scene scene;
  scene.camera = {160, 120, 130.0, 135.0, 78.3, 61.1};
  scene.T_scene_camera.assign(static_cast<std::size_t>(num_frames), lookAt(eye, target));
  scene.roi = scene.defaultRegion();
  return scene;
}

/// Boxes of any orientation, many of them interpenetrating each other and the ground, under an orbiting camera.
inline Scene makeRandomScene(std::uint64_t seed, int num_boxes, bool has_ground) {
  SeededRandom random(seed);
  Scene scene = makeScene({1.5, 0.4, 1.0}, {0.0, 0.0, 0.15});
  scene.T_scene_camera = orbitPoses({1.5, 1.0, {0.0, 0.0, 0.15}, 1.0, random.uniform(), 3});
  scene.has_ground = has_ground;
  for (int id = 0; id < num_boxes; ++id) {
    const Eigen::Vector3d center = randomPoint(random, {-0.4, -0.4, 0.0}, {0.4, 0.4, 0.4});
    const Eigen::Vector3d half = randomPoint(random, {0.03, 0.03, 0.03}, {0.2, 0.2, 0.2});
    scene.boxes.push_back(makeBox(id, center, half, randomPoint(random, {-3.0, -1.5, -3.0}, {3.0, 1.5, 3.0})));
  }
  scene.roi = scene.defaultRegion();
  return scene;
}

}  // namespace test
}  // namespace synthetic_depth
