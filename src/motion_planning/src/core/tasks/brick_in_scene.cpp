// SPDX-License-Identifier: BSD-3-Clause
#include "tasks/brick_in_scene.h"

namespace motion_planning {

BrickInScene::BrickInScene(const CollisionChecker& robot, const OrientedBox& brick, double lift_room_m)
    : lift_room_m_(lift_room_m),
      before_touch_(robot),
      touching_(robot),
      lifting_(robot),
      aside_(robot),
      carrying_(robot),
      with_room_(robot) {
  touching_.setTarget(brick);
  lifting_.setTarget(brick);
  aside_.setTarget(brick, true);
  carrying_.setTarget(brick, true);
  with_room_.setTarget(brick, true);
}

void BrickInScene::hold(const HeldBrick& held) {
  const auto& now = lifting_.held();
  if (now && now->T_tip_brick.matrix() == held.T_tip_brick.matrix() && now->size_m == held.size_m) return;
  lifting_.setHeld(held);
  aside_.setHeld(held);
  carrying_.setHeld(held, false);
  with_room_.setHeld(grown(held, lift_room_m_), false);
}

HeldBrick grown(HeldBrick held, double by_m) {
  held.size_m.array() += 2.0 * by_m;
  return held;
}

}  // namespace motion_planning
