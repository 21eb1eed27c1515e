// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "motion_planning/collision_checker.h"

namespace motion_planning {

/// The robot among its surroundings in each phase of a pick. The views differ in what may touch what.
class BrickInScene {
 public:
  /// `robot`: with an empty magnet, the brick still an obstacle. `brick`: where it lies.
  BrickInScene(const CollisionChecker& robot, const OrientedBox& brick, double lift_room_m);

  /// How the brick hangs on the magnet from whileLifting() on. Call it before these views are read.
  void hold(const HeldBrick& held);

  const CollisionChecker& beforeTouch() const { return before_touch_; }  // the brick is an obstacle
  const CollisionChecker& touching() const { return touching_; }         // the magnet may touch it
  const CollisionChecker& whileLifting() const { return lifting_; }      // held, it may touch its neighbours
  const CollisionChecker& whileLiftingAside() const { return aside_; }   // and what stands beside it is in the way
  const CollisionChecker& carrying() const { return carrying_; }         // held at full size, its place is empty
  const CollisionChecker& withRoom() const { return with_room_; }        // as carrying, larger by the room on each side

 private:
  double lift_room_m_;
  CollisionChecker before_touch_;
  CollisionChecker touching_;
  CollisionChecker lifting_;
  CollisionChecker aside_;
  CollisionChecker carrying_;
  CollisionChecker with_room_;
};

/// The brick grown by `by_m` on each side.
HeldBrick grown(HeldBrick held, double by_m);

}  // namespace motion_planning
