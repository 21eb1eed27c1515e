// SPDX-License-Identifier: BSD-3-Clause
// The foot of a removed object, where its sides met what is still there.
#include <gtest/gtest.h>

#include "support/map_on_scene.h"

namespace synthetic_depth {
namespace test {
namespace {

TEST(DynamicMapFoot, NoSheetRemainsWhereBricksWereTakenOffOthers) {
  Scene scene = loadSmallScene("demo_pile");
  scene.T_scene_camera = orbitPoses({1.7, 1.1, {0.0, 0.0, 0.15}, 2.0, 0.0, 30});
  for (Box& box : scene.boxes) {
    if (box.vanishes_at_frame != kNever) box.vanishes_at_frame = 15;
  }
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 5, 24);  // ten looks with the bricks, ten without
  const SceneDistance truth(scene, 24);
  for (const Eigen::Vector3d& p : meshOf(*map.snapshot()).vertices_map) {
    for (const Box& box : scene.boxes) {
      // 3 cm: five standard deviations at 2 m; a look at 28 degrees with the tolerance of 12 mm at half a cosine sees
      // past everything more than 1.1 cm above the surface.
      const bool was_removed = box.vanishes_at_frame == 15 && boxDistance(scene, box, p) < 0.015;
      EXPECT_FALSE(was_removed && distanceAt(truth, p) > 0.03)
          << "at " << (scene.T_map_scene.inverse() * p).transpose() << ", box " << box.id;
    }
  }
}

}  // namespace
}  // namespace test
}  // namespace synthetic_depth
