// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/enums/enum_names.h>

#include "motion_planning/arm_kinematics.h"
#include "motion_planning/collision_scene.h"

namespace motion_planning {

enum class CollisionKind {
  kNone,
  kLimits,   // a joint beyond its limits
  kSelf,     // robot with itself, or with what it holds
  kSurface,  // the mapped surface with its margin
  kInside,   // within a mapped object, where no triangle is near
  kUnknown,  // unseen space near the pile
  kFloor,
};
inline constexpr interactive_mapping::Names<CollisionKind> kCollisionKindNames = {
    {"none", CollisionKind::kNone},       {"limits", CollisionKind::kLimits}, {"self", CollisionKind::kSelf},
    {"surface", CollisionKind::kSurface}, {"inside", CollisionKind::kInside}, {"unknown", CollisionKind::kUnknown},
    {"floor", CollisionKind::kFloor}};
constexpr const char* toString(CollisionKind kind) {
  return interactive_mapping::nameOf(kind, kCollisionKindNames);
}

struct Contact {
  CollisionKind kind{CollisionKind::kNone};
  std::string first;                                   // link of the robot, or "brick"
  std::string second;                                  // the other link; empty but for kSelf
  Eigen::Vector3d where_map{Eigen::Vector3d::Zero()};  // the part or block of space in the way, about

  explicit operator bool() const { return kind != CollisionKind::kNone; }
  std::string describe() const;  // a sentence
};

/// A brick, or anything that is a box.
struct OrientedBox {
  Eigen::Isometry3d T_map_box{Eigen::Isometry3d::Identity()};  // of its middle
  Eigen::Vector3d size_m{Eigen::Vector3d::Zero()};
};

/// What the magnet holds.
struct HeldBrick {
  Eigen::Isometry3d T_tip_brick{Eigen::Isometry3d::Identity()};
  Eigen::Vector3d size_m{Eigen::Vector3d::Zero()};
  double mass_kg{0.0};  // 0: not known; it is then held at any tilt
};

/// A brick in the robot's container.
struct LoadedBrick {
  Eigen::Isometry3d T_base_brick{Eigen::Isometry3d::Identity()};
  Eigen::Vector3d size_m{Eigen::Vector3d::Zero()};
};

/// How a brick lies in the container after it was let go at `released`. It lies straight below, as it hung, on the
/// highest of the container's shapes under its middle. Nothing: its middle is not over the container.
std::optional<LoadedBrick> settledInContainer(const ArmKinematics& arm, const LoadedBrick& released);

constexpr double kMaxSelfPadding_m = 0.05;  // that can be asked for

struct CollisionCheckerConfig {
  double self_padding_m{0.005};
  double held_padding_m{0.02};  // a millimetre was seen in simulation in lock step, 10 mm at real time
  double floor_margin_m{0.02};
  double held_shrink_m{0.01};
  double held_release_m{0.06};
  /// With the shrinking it is at least half a block of the scene, or a brick's unseen back would hold it in its place.
  /// It also covers the doubtful surface that the map grows before edges and half-seen faces, up to 3 cm.
  double target_padding_m{0.035};
  /// For watching: a part may reach so far into an unseen block, and what the held brick has left empty is so much larger.
  double unknown_tolerance_m{0.0};

  static void fields(CollisionCheckerConfig& c, interactive_mapping::Fields& f) {
    f("self_padding_m", c.self_padding_m, 0.0, kMaxSelfPadding_m, "m", "distance that links keep from each other");
    f("held_padding_m", c.held_padding_m, 0.0, kMaxSelfPadding_m, "m",
      "distance between links and a held brick, for errors of detection, touch and grip");
    f("floor_margin_m", c.floor_margin_m, -0.1, 0.3, "m", "distance of every moving link above the ground");
    f("held_shrink_m", c.held_shrink_m, 0.0, 0.05, "m",
      "a held brick is smaller by this on each side: it may touch what it lies on and beside");
    f("held_release_m", c.held_release_m, 0.0, 0.1, "m",
      "a held brick is smaller by up to this at the start of a lift; nearer surface is ignored there");
    f("target_padding_m", c.target_padding_m, 0.0, 0.1, "m",
      "padding of the box about the target that magnet and brick may enter");
  }
};

/// So long is the first part of a held brick's way, in which it may still hang among its neighbours.
constexpr double kAmongOthers_m = 0.05;

/// The robot in a scene. The arm moves, the base stands at T_map_base. Cheap to copy for another thread; not thread-safe.
/// Robot shapes are the URDF's, exact against triangles and each other (FCL) and against the lattice's blocks, which count as
/// the balls within them. Spheres that cover the shapes only exclude what need not be checked. Bodies that share a joint are
/// not checked against each other; nor is what is held against the body that holds it.
/// Long: the questions of planner, monitor and mission to the same shapes.
class CollisionChecker {
 public:
  /// Throws std::invalid_argument for a bad config or a base pose that is not rigid.
  CollisionChecker(std::shared_ptr<const ArmKinematics> arm, std::shared_ptr<const CollisionScene> scene,
                   const Eigen::Isometry3d& T_map_base, const CollisionCheckerConfig& config = {});
  ~CollisionChecker();
  CollisionChecker(const CollisionChecker& other);
  CollisionChecker& operator=(const CollisionChecker&) = delete;

  /// Nothing: the magnet is empty. `may_touch`: as in a lift, the held brick lies on or beside something. It is smaller
  /// by held_shrink_m and may come as near to surface as that is mapped, whatever its margin. Otherwise it hangs free
  /// and is taken as large as it is.
  void setHeld(const std::optional<HeldBrick>& held, bool may_touch = true);
  /// As in a lift, and made smaller still, up to held_release_m, until it is free in all these postures, the first of
  /// its path. Nothing else can be where it hangs, so the map is wrong by as much. If that is not enough, its volume in
  /// the first posture becomes the target, for all links. Surface that the map has there does not exist, however deep.
  /// None: it is free. Else what even then is touched; it is as in a lift, and the target is as before. Throws as
  /// setHeld(); std::invalid_argument too for angles that are not finite.
  Contact setHeldAt(const HeldBrick& held, const std::vector<ArmVector>& postures);
  /// The held brick may be as near to the robot as it is in this posture, the start of its path. From now on it keeps
  /// less than held_padding_m from it, or is smaller, by held_release_m at most. False: not even then; as before.
  /// Throws std::invalid_argument for angles that are not finite.
  bool yieldToRobotAt(const ArmVector& joints_rad);
  /// An empty magnet that is in contact with the map there has come to a face, as in a pick. The volume about its own
  /// face becomes the target. False: it is not in contact, holds something, there is a target already, or other links
  /// are in contact, too; nothing changes then. Throws std::invalid_argument for angles that are not finite.
  bool yieldToMagnetAt(const ArmVector& joints_rad);
  /// If a link is within the margin of surface there, links need only be free of surface as mapped from now on. False:
  /// none is, or nothing is given; links keep their margin then. Throws std::invalid_argument for angles that are not
  /// finite.
  bool yieldToSurfaceAt(const std::optional<ArmVector>& joints_rad);
  const std::optional<HeldBrick>& held() const;

  /// What lies in the container: all links keep held_padding_m from it, and what is held 1 cm. Bricks that arm or held brick
  /// would touch in this posture, its start, are left out: they cannot lie there. Call it after setHeld(). findStart()
  /// rejects bad poses and sizes. Throws std::invalid_argument for angles that are not finite.
  void setLoad(const std::vector<LoadedBrick>& load, const ArmVector& start_rad);

  /// The padded box of the target leaves the world: surface, inside and unknown. For magnet and held brick alone; all
  /// other links still avoid it. Unknown space is opened a block farther to all sides, for the magnet may come closer
  /// to the faces than a block reaches. `for_all`: for every link (the brick is in the hand, its old volume is empty),
  /// and only the brick's own surface. Surface that faces the box stays, and what is inside beside it. Nothing: no
  /// target.
  void setTarget(const std::optional<OrientedBox>& target, bool for_all = false);

  /// The volume of the arm itself cannot hold an unseen obstacle. Lattice blocks that its shapes, and what it holds,
  /// reach there are not unknown any more.
  void freeUnknownAt(const ArmVector& joints_rad);

  /// The first thing found in the way; cheap tests come first.
  Contact check(const ArmVector& joints_rad) const;
  bool isFree(const ArmVector& joints_rad) const { return !check(joints_rad); }

  /// Smallest distance of arm, magnet and held brick to the surface as mapped (without margin) [m], at most `limit_m`.
  /// `limit_m` is also the answer when there is no surface within it. Zero: a part cuts the surface. Negative: a part
  /// is in an object. The depth is the map's at the deepest place checked (blocks' middles, the parts' own middles).
  /// The target is left out where check() leaves it out. Costs about a millisecond near the pile.
  double clearance(const ArmVector& joints_rad, double limit_m) const;

  const ArmKinematics& arm() const;
  const Eigen::Isometry3d& baseInMap() const;  // T_map_base

 private:
  void setTarget(const std::optional<OrientedBox>& target, bool for_all, bool only_own);
  void setHeld(const std::optional<HeldBrick>& held, bool may_touch, double less_m);
  Contact releaseHeld(const HeldBrick& held, const std::vector<ArmVector>& postures);

  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace motion_planning
