// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/collision_checker.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>

#include <fcl/narrowphase/collision.h>
#include <fcl/narrowphase/distance.h>
#include <mp700_ur5e_description/robot_names.h>

#include "collision/collision_scene_data.h"
#include "collision/robot_shapes.h"

namespace motion_planning {
namespace {

using mp700_ur5e_description::RobotModel;
using mp700_ur5e_description::Shape;

constexpr double kReleaseStep_m = 0.005;
constexpr double kPoseError_m = 0.01;  // of a brick in the map
constexpr double kFacePlace_m = 0.12;  // about the magnet's face: with the padding what its margin reaches
constexpr const char* kBrick = "brick";
constexpr const char* kLoad = "a brick in the container";

/// A shape of the robot, or the brick, with what the tests need of it.
struct Part {
  std::string link;
  std::size_t body{0};
  bool is_tool{false};  // magnet or brick: may touch the target
  Eigen::Isometry3d T_body_shape{Eigen::Isometry3d::Identity()};
  Shape world_shape;  // as the world sees it
  Shape self_shape;   // as the robot sees it: a brick is not shrunk
  std::shared_ptr<const fcl::CollisionGeometryd> world_fcl;
  std::shared_ptr<const fcl::CollisionGeometryd> self_fcl;
  double self_padding_m{0.0};
  std::shared_ptr<const fcl::CollisionGeometryd> padded_fcl;  // self_shape, larger by self_padding_m
  double self_radius_m{0.0};                                  // of the ball about the middle that holds self_shape
  std::vector<CoveringSphere> world_spheres;                  // in the shape's frame
  std::vector<CoveringSphere> self_spheres;
  std::vector<Eigen::Vector3d> core;  // of world_shape
};

Part makePart(const std::string& link, std::size_t body, const Eigen::Isometry3d& T_body_shape,
              const Shape& world_shape, const Shape& self_shape, double self_padding_m) {
  Part part;
  part.link = link;
  part.body = body;
  part.T_body_shape = T_body_shape;
  part.world_shape = world_shape;
  part.self_shape = self_shape;
  part.world_fcl = toFcl(world_shape);
  part.self_fcl = toFcl(self_shape);
  part.self_padding_m = self_padding_m;
  part.padded_fcl = toFcl(inflate(self_shape, self_padding_m));
  part.self_radius_m = boundingRadius(self_shape);
  return part;
}

/// What only parts that move are asked for.
Part makeMovingPart(const std::string& link, std::size_t body, const Eigen::Isometry3d& T_body_shape,
                    const Shape& world_shape, const Shape& self_shape, double self_padding_m) {
  Part part = makePart(link, body, T_body_shape, world_shape, self_shape, self_padding_m);
  part.world_spheres = coverShape(world_shape);
  part.self_spheres = coverShape(self_shape);
  part.core = corePoints(world_shape);
  return part;
}

/// What does not change as long as the robot's URDF does not: shared by all copies of a checker.
struct RobotParts {
  struct Pair {
    std::size_t first;  // in `moving`
    std::size_t second;
  };

  std::vector<Part> moving;
  std::vector<Part> fixed;       // T_body_shape is T_base_shape
  std::vector<Pair> with_fixed;  // second in `fixed`
  std::vector<Pair> with_moving;
  std::vector<std::size_t> parent;  // body -> body
  std::vector<char> is_moving;      // by body
  std::size_t tip_body;
  Eigen::Isometry3d T_body_tip;
};

/// Bodies at the same joint touch by construction. All others are checked; that the arm as built has a posture free of
/// each such pair is held by a test.
bool areNeighbours(const RobotParts& parts, std::size_t body_a, std::size_t body_b) {
  return body_a == body_b || parts.parent[body_a] == body_b || parts.parent[body_b] == body_a;
}

std::shared_ptr<const RobotParts> makeParts(const ArmKinematics& arm, double self_padding_m) {
  const RobotModel& robot = arm.robot();
  auto parts = std::make_shared<RobotParts>();
  parts->is_moving.assign(robot.numBodies(), 0);
  for (std::size_t body = 0; body < robot.numBodies(); ++body) parts->parent.push_back(robot.parentBody(body));
  for (const std::size_t joint : arm.jointIndices()) parts->is_moving[joint + 1] = 1;
  for (std::size_t body = 1; body < robot.numBodies(); ++body) {  // parents come first
    if (parts->is_moving[parts->parent[body]]) parts->is_moving[body] = 1;
  }
  std::vector<Eigen::Isometry3d> T_base_body;
  robot.bodyPoses(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(robot.joints().size())), &T_base_body);
  for (const auto& shape : robot.shapes()) {
    if (parts->is_moving[shape.body]) {
      parts->moving.push_back(
          makeMovingPart(shape.link, shape.body, shape.T_body_shape, shape.shape, shape.shape, self_padding_m));
      parts->moving.back().is_tool = shape.link == mp700_ur5e_description::kMagnetLink;
    } else {
      // Wheels turn about their own axes: at zero they are where they always are.
      parts->fixed.push_back(makePart(shape.link, shape.body, T_base_body[shape.body] * shape.T_body_shape, shape.shape,
                                      shape.shape, self_padding_m));
    }
  }
  for (std::size_t i = 0; i < parts->moving.size(); ++i) {
    for (std::size_t j = 0; j < parts->fixed.size(); ++j) {
      if (!areNeighbours(*parts, parts->moving[i].body, parts->fixed[j].body)) parts->with_fixed.push_back({i, j});
    }
    for (std::size_t j = i + 1; j < parts->moving.size(); ++j) {
      if (!areNeighbours(*parts, parts->moving[i].body, parts->moving[j].body)) parts->with_moving.push_back({i, j});
    }
  }
  parts->tip_body = robot.bodyOf(mp700_ur5e_description::kMagnetTipFrame);
  parts->T_body_tip = robot.poseInBody(mp700_ur5e_description::kMagnetTipFrame);
  return parts;
}

std::string describeSize(const Eigen::Vector3d& size_m) {
  std::ostringstream text;
  text << size_m.transpose() << " m, must be finite and positive";
  return text.str();
}

bool overlap(const fcl::CollisionGeometryd& a, const Eigen::Isometry3d& T_a, const fcl::CollisionGeometryd& b,
             const Eigen::Isometry3d& T_b) {
  static const fcl::CollisionRequestd kRequest;  // one contact, and no more than that there is one
  fcl::CollisionResultd result;
  return fcl::collide(&a, T_a, &b, T_b, kRequest, result) > 0;
}

}  // namespace

std::string Contact::describe() const {
  std::ostringstream at;
  at.precision(3);
  at << std::fixed << " at (" << where_map.x() << ", " << where_map.y() << ", " << where_map.z() << ") m in the map";
  const std::string part = first + ", its middle" + at.str() + ",";
  switch (kind) {
    case CollisionKind::kNone:
      return "nothing is in the way";
    case CollisionKind::kLimits:
      return first + " is beyond its limits";
    case CollisionKind::kSelf:
      return part + " touches " + second;
    case CollisionKind::kSurface:
      return part + " touches the mapped surface or its margin";
    case CollisionKind::kInside:
      return first + " is inside a mapped object" + at.str();
    case CollisionKind::kUnknown:
      return first + " is in unseen space near the pile" + at.str();
    case CollisionKind::kFloor:
      return part + " is too near to the floor";
  }
  return "?";
}

std::optional<LoadedBrick> settledInContainer(const ArmKinematics& arm, const LoadedBrick& released) {
  const RobotModel& robot = arm.robot();
  std::vector<Eigen::Isometry3d> T_base_body;
  robot.bodyPoses(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(robot.joints().size())), &T_base_body);
  const Eigen::Vector3d middle = released.T_base_brick.translation();
  std::optional<double> floor_m;
  for (const auto& shape : robot.shapes()) {
    if (shape.link != mp700_ur5e_description::kContainerLink) continue;
    const Eigen::Isometry3d T_base_shape = T_base_body[shape.body] * shape.T_body_shape;
    const Eigen::Vector3d half = halfExtents(shape.shape, T_base_shape.linear());
    const Eigen::Vector3d offset = (middle - T_base_shape.translation()).cwiseAbs();
    const double top_m = T_base_shape.translation().z() + half.z();
    if (offset.x() > half.x() || offset.y() > half.y() || top_m > middle.z()) continue;
    floor_m = std::max(floor_m.value_or(top_m), top_m);
  }
  if (!floor_m) return std::nullopt;
  LoadedBrick settled = released;
  const double half_height_m = 0.5 * settled.T_base_brick.linear().row(2).cwiseAbs().dot(settled.size_m);
  settled.T_base_brick.translation().z() = *floor_m + half_height_m;
  return settled;
}

struct CollisionChecker::State {
  std::shared_ptr<const ArmKinematics> arm;
  std::shared_ptr<const CollisionScene> scene;
  Eigen::Isometry3d T_map_base;
  CollisionCheckerConfig config;
  std::shared_ptr<const RobotParts> parts;
  std::optional<HeldBrick> held_brick;
  bool held_may_touch{false};
  double held_less_m{0.0};           // on each side, against surface and blocks
  double held_padding_m{0.0};        // against the robot; negative: smaller
  double held_made_for_m{0.0};       // held_padding_m when `held` was made
  std::shared_ptr<const Part> held;  // the same as a part
  std::vector<Part> load;            // T_body_shape is T_map_shape; world_shape is what the held brick must not touch

  // The world without the target.
  std::optional<OrientedBox> target;  // padded
  Eigen::Isometry3d T_target_map;
  bool target_for_all{false};
  bool target_only_own{false};  // what stands beside the target stays
  // As the scene's, made when first asked for; a null pointer: nothing is left.
  std::vector<std::optional<std::shared_ptr<const SurfaceChunk>>> target_chunks;

  std::vector<char> is_freed;  // blocks of the lattice; empty: none
  bool keeps_margin{true};     // the robot's parts, from surface

  // Scratch of a single check.
  std::vector<Eigen::Isometry3d> T_base_body;
  std::vector<Eigen::Isometry3d> T_map_moving;  // of the moving parts' shapes, the held brick last
  std::vector<std::size_t> near;                // parts that may touch the world

  std::vector<Eigen::Isometry3d> T_map_fixed;

  std::size_t numMoving() const { return parts->moving.size() + (held ? 1 : 0); }
  const Part& moving(std::size_t i) const { return i < parts->moving.size() ? parts->moving[i] : *held; }

  void place(const ArmVector& joints_rad) {
    arm->robot().bodyPoses(arm->robotPositions(joints_rad), &T_base_body);
    for (Eigen::Isometry3d& pose : T_base_body) pose = T_map_base * pose;
    T_map_moving.resize(numMoving());
    for (std::size_t i = 0; i < numMoving(); ++i) {
      T_map_moving[i] = T_base_body[moving(i).body] * moving(i).T_body_shape;
    }
  }

  bool isExempt(const Part& part) const { return target && (target_for_all || part.is_tool); }

  bool isInTarget(const Eigen::Vector3d& p_map, double more_m = 0.0) const {
    return ((T_target_map * p_map).array().abs() <= 0.5 * target->size_m.array() + more_m).all();
  }

  /// Whether what is under a surface there is the target itself: beside its place stand others once it is gone.
  bool isTargetsInside(const Eigen::Vector3d& p_map) const {
    return isInTarget(p_map, target_only_own ? kPoseError_m - config.target_padding_m : 0.0);
  }

  Contact contact(CollisionKind kind, std::size_t i) const {
    return {kind, moving(i).link, "", T_map_moving[i].translation()};
  }

  Contact checkFloor() const {
    // Heights above the ground are along base_link's z.
    const Eigen::Vector3d up = T_map_base.linear().col(2);
    const double ground_m = up.dot(T_map_base.translation());
    for (std::size_t i = 0; i < numMoving(); ++i) {
      const Eigen::Isometry3d& T = T_map_moving[i];
      const double half_m = halfExtents(moving(i).world_shape, T_base_up(T)).z();
      // What is held lies on the ground when it is taken: shrunk, it may come down to it.
      const double margin_m = &moving(i) == held.get() ? 0.0 : config.floor_margin_m;
      if (up.dot(T.translation()) - ground_m - half_m < margin_m) return contact(CollisionKind::kFloor, i);
    }
    return {};
  }

  /// Rotation of a shape as base_link sees it.
  Eigen::Matrix3d T_base_up(const Eigen::Isometry3d& T_map_shape) const {
    return T_map_base.linear().transpose() * T_map_shape.linear();
  }

  /// Whether something may be nearer to the part than `margin_m`.
  bool mayTouchWorld(std::size_t i, double margin_m = 0.0) const {
    for (const CoveringSphere& sphere : moving(i).world_spheres) {
      if (scene->freeDistance(T_map_moving[i] * sphere.center) <= sphere.radius_m + margin_m) return true;
    }
    return false;
  }

  /// Calls `visit(index, position, signed distance of the block's centre from the part)` for unknown and inside blocks
  /// whose centres may be nearer to the part than half a block, until it returns true.
  template <class Visit>
  bool visitBlocks(std::size_t i, const Visit& visit) const {
    const BlockLattice& lattice = scene->lattice;
    if (lattice.count() == 0) return false;
    const Part& part = moving(i);
    const Eigen::Isometry3d& T = T_map_moving[i];
    const double reach_m = 0.5 * lattice.block();
    const Eigen::Vector3d half = halfExtents(part.world_shape, T.linear()).array() + reach_m;
    const Eigen::Vector3i lo = lattice.clamped(T.translation() - half);
    const Eigen::Vector3i hi = lattice.clamped(T.translation() + half);
    const Eigen::Isometry3d T_shape_map = T.inverse();
    const bool is_exempt = isExempt(part);
    Eigen::Vector3i at;
    for (at.z() = lo.z(); at.z() <= hi.z(); ++at.z()) {
      for (at.y() = lo.y(); at.y() <= hi.y(); ++at.y()) {
        at.x() = lo.x();
        std::size_t index = lattice.index(at);
        for (; at.x() <= hi.x(); ++at.x(), ++index) {
          if ((scene->flags[index] & (kBlockInside | kBlockUnknown)) == 0) continue;
          const Eigen::Vector3d center_map = lattice.center(at);
          const double distance_m = signedDistance(part.world_shape, T_shape_map * center_map);
          if (distance_m >= reach_m) continue;
          // Space within a block of the target's faces was known free because they were seen there. When they leave the
          // map, so does that knowledge; nothing has come there. Not when its place is empty: what is carried moves to
          // the side, where an unseen neighbour may stand.
          const bool is_unknown = (scene->flags[index] & kBlockInside) == 0;
          if (is_exempt &&
              (is_unknown ? isInTarget(center_map, target_for_all ? config.unknown_tolerance_m : lattice.block())
                          : isTargetsInside(center_map))) {
            continue;
          }
          if (visit(index, distance_m)) return true;
        }
      }
    }
    return false;
  }

  /// The map's distance at a point between block centres, from those that have one; NaN: none has.
  double interpolatedDistance(const Eigen::Vector3d& p_map, bool is_exempt) const {
    const BlockLattice& lattice = scene->lattice;
    const Eigen::Vector3d half = Eigen::Vector3d::Constant(0.5 * lattice.block());
    const Eigen::Vector3i lo = lattice.clamped(p_map - half);
    const Eigen::Vector3d share = ((p_map - lattice.center(lo)) / lattice.block()).cwiseMax(0.0).cwiseMin(1.0);
    double sum = 0.0;
    double weights = 0.0;
    for (int corner = 0; corner < 8; ++corner) {
      const Eigen::Vector3i step(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
      const Eigen::Vector3i at = (lo + step).cwiseMin(lattice.size() - Eigen::Vector3i::Ones());
      const float distance_m = scene->distance_m[lattice.index(at)];
      if (std::isnan(distance_m)) continue;
      if (is_exempt && isTargetsInside(lattice.center(at))) continue;
      double weight = 1.0;
      for (int axis = 0; axis < 3; ++axis) weight *= step[axis] == 1 ? share[axis] : 1.0 - share[axis];
      sum += weight * static_cast<double>(distance_m);
      weights += weight;
    }
    return weights > 1e-6 ? sum / weights : std::numeric_limits<double>::quiet_NaN();
  }

  /// Triangles have no inside, so a part that holds none may still be within an object. It is if a block's middle that is
  /// under the surface lies in the part, or if the map's distance along the part's middle is negative. The second is for
  /// parts thinner than a block. Interpolation across a dihedral of two objects reads up to half a block too little, but
  /// there the middle of a part is already nearer to the surface than the part is thick.
  /// `where_map`: the block's middle, or the part's point.
  CollisionKind checkLattice(std::size_t i, Eigen::Vector3d* where_map) const {
    CollisionKind kind = CollisionKind::kNone;
    visitBlocks(i, [&](std::size_t index, double distance_m) {
      if ((scene->flags[index] & kBlockInside) != 0) {
        if (distance_m > 0.0) return false;
        kind = CollisionKind::kInside;
      } else if ((!is_freed.empty() && is_freed[index] != 0) ||
                 distance_m >= 0.5 * scene->lattice.block() - config.unknown_tolerance_m) {
        return false;
      } else {
        kind = CollisionKind::kUnknown;
      }
      *where_map = scene->lattice.center(scene->lattice.position(index));
      return true;
    });
    if (kind != CollisionKind::kNone || scene->lattice.count() == 0) return kind;
    const bool is_exempt = isExempt(moving(i));
    for (const Eigen::Vector3d& p_shape : moving(i).core) {
      const Eigen::Vector3d p_map = T_map_moving[i] * p_shape;
      if (!scene->lattice.contains(p_map) || (is_exempt && isTargetsInside(p_map))) continue;
      if (!(interpolatedDistance(p_map, is_exempt) < 0.0)) continue;  // NaN: not known
      *where_map = p_map;
      return CollisionKind::kInside;
    }
    return CollisionKind::kNone;
  }

  /// The least of the map's distances at blocks' middles and at points of the middle within the part [m]: how deep it is in
  /// an object. Zero: it is in none.
  double depth(std::size_t i) const {
    double depth_m = 0.0;
    visitBlocks(i, [&](std::size_t index, double distance_m) {
      const double here_m = static_cast<double>(scene->distance_m[index]);
      if ((scene->flags[index] & kBlockInside) != 0 && distance_m <= 0.0 && here_m < depth_m) depth_m = here_m;
      return false;
    });
    const bool is_exempt = isExempt(moving(i));
    for (const Eigen::Vector3d& p_shape : moving(i).core) {
      const Eigen::Vector3d p_map = T_map_moving[i] * p_shape;
      if (!scene->lattice.contains(p_map) || (is_exempt && isTargetsInside(p_map))) continue;
      const double here_m = interpolatedDistance(p_map, is_exempt);
      if (here_m < depth_m) depth_m = here_m;
    }
    return depth_m;
  }

  const SurfaceChunk* chunkFor(std::size_t chunk, bool is_exempt) {
    if (!is_exempt) return scene->chunks[chunk].get();
    auto& reduced = target_chunks[chunk];
    if (!reduced) reduced = SurfaceChunk::without(scene->chunks[chunk], *target, target_only_own);
    return reduced->get();
  }

  bool touchesSurface(std::size_t i) {
    const Part& part = moving(i);
    const Eigen::Isometry3d& T = T_map_moving[i];
    const Eigen::Vector3d half = halfExtents(part.world_shape, T.linear());
    const Eigen::AlignedBox3d bounds(T.translation() - half, T.translation() + half);
    const bool is_exempt = isExempt(part);
    for (std::size_t c = 0; c < scene->chunks.size(); ++c) {
      if (!scene->chunks[c]->bounds().intersects(bounds)) continue;
      const SurfaceChunk* chunk = chunkFor(c, is_exempt);
      if (!chunk) continue;
      // A neighbour is doubted by more than the gap to it, and yet cannot be where the brick lies.
      const bool is_mapped = &part == held.get() ? held_may_touch : !keeps_margin;
      const fcl::CollisionGeometryd& surface =
          is_mapped ? static_cast<const fcl::CollisionGeometryd&>(chunk->mappedBvh()) : chunk->bvh();
      if (overlap(surface, Eigen::Isometry3d::Identity(), *part.world_fcl, T)) return true;
    }
    return false;
  }

  /// `a` grown by the padding against `b` as it is.
  bool touch(const Part& a, const Eigen::Isometry3d& T_a, const Part& b, const Eigen::Isometry3d& T_b) const {
    // The padded shape's corners stand out of the ball grown by the padding, by up to 0.73 of it.
    const double padding_m = 2.0 * a.self_padding_m;
    const double reach_m = a.self_radius_m + b.self_radius_m + padding_m;
    if ((T_a.translation() - T_b.translation()).squaredNorm() > reach_m * reach_m) return false;
    const Eigen::Isometry3d T_b_a = T_b.inverse() * T_a;
    const bool may_touch = std::any_of(a.self_spheres.begin(), a.self_spheres.end(), [&](const CoveringSphere& sphere) {
      return signedDistance(b.self_shape, T_b_a * sphere.center) <= sphere.radius_m + padding_m;
    });
    return may_touch && overlap(*a.padded_fcl, T_a, *b.self_fcl, T_b);
  }

  Contact selfContact(const Part& a, std::size_t i, const Part& b) const {
    return {CollisionKind::kSelf, a.link, b.link, T_map_moving[i].translation()};
  }

  Contact checkSelf() const {
    for (const auto& [i, j] : parts->with_moving) {
      const Part& a = parts->moving[i];
      const Part& b = parts->moving[j];
      if (touch(a, T_map_moving[i], b, T_map_moving[j])) return selfContact(a, i, b);
    }
    for (const auto& [i, j] : parts->with_fixed) {
      const Part& a = parts->moving[i];
      if (touch(a, T_map_moving[i], parts->fixed[j], T_map_fixed[j])) return selfContact(a, i, parts->fixed[j]);
    }
    for (std::size_t i = 0; i < parts->moving.size(); ++i) {
      for (const Part& brick : load) {
        if (touch(parts->moving[i], T_map_moving[i], brick, brick.T_body_shape)) {
          return selfContact(parts->moving[i], i, brick);
        }
      }
    }
    if (held) {
      for (const Part& brick : load) {
        if (heldTouchesLoad(brick)) return selfContact(*held, parts->moving.size(), brick);
      }
    }
    return checkHeldWithRobot();
  }

  bool heldTouchesLoad(const Part& brick) const {
    return overlap(*held->self_fcl, T_map_moving.back(), *brick.world_fcl, brick.T_body_shape);
  }

  bool heldTouchesRobot(const ArmVector& joints_rad) {
    place(joints_rad);
    return static_cast<bool>(checkHeldWithRobot());
  }

  Contact checkHeldWithRobot() const {
    if (!held) return {};
    const std::size_t h = parts->moving.size();
    for (std::size_t j = 0; j < parts->moving.size(); ++j) {
      // It does not move against the body it hangs on.
      if (parts->moving[j].body == held->body) continue;
      if (touch(*held, T_map_moving[h], parts->moving[j], T_map_moving[j]))
        return selfContact(*held, h, parts->moving[j]);
    }
    for (std::size_t j = 0; j < parts->fixed.size(); ++j) {
      if (touch(*held, T_map_moving[h], parts->fixed[j], T_map_fixed[j])) return selfContact(*held, h, parts->fixed[j]);
    }
    return {};
  }
};

CollisionChecker::CollisionChecker(std::shared_ptr<const ArmKinematics> arm,
                                   std::shared_ptr<const CollisionScene> scene, const Eigen::Isometry3d& T_map_base,
                                   const CollisionCheckerConfig& config)
    : state_(std::make_unique<State>()) {
  interactive_mapping::requireValid("impossible collision checker:", config);
  if (!arm || !scene) throw std::invalid_argument("no arm or no scene");
  if (!isRigid(T_map_base)) throw std::invalid_argument("T_map_base is not a rigid transform");
  state_->parts = makeParts(*arm, config.self_padding_m);
  state_->held_padding_m = config.held_padding_m;
  state_->arm = std::move(arm);
  state_->scene = std::move(scene);
  state_->T_map_base = T_map_base;
  state_->config = config;
  for (const Part& part : state_->parts->fixed) state_->T_map_fixed.push_back(T_map_base * part.T_body_shape);
}

CollisionChecker::~CollisionChecker() = default;

CollisionChecker::CollisionChecker(const CollisionChecker& other) : state_(std::make_unique<State>(*other.state_)) {}

const ArmKinematics& CollisionChecker::arm() const {
  return *state_->arm;
}

const Eigen::Isometry3d& CollisionChecker::baseInMap() const {
  return state_->T_map_base;
}

void CollisionChecker::setHeld(const std::optional<HeldBrick>& held, bool may_touch) {
  setHeld(held, may_touch, may_touch ? state_->config.held_shrink_m : 0.0);
}

Contact CollisionChecker::setHeldAt(const HeldBrick& held, const std::vector<ArmVector>& postures) {
  if (!releaseHeld(held, postures)) return {};
  const CollisionChecker before(*this);
  // Whatever the map has there: what is held is there, and nothing else can be.
  setTarget(OrientedBox{state_->T_map_base * state_->arm->tipPose(postures.front()) * held.T_tip_brick, held.size_m},
            true, false);
  const Contact contact = releaseHeld(held, postures);
  if (contact) *state_ = *before.state_;
  return contact;
}

bool CollisionChecker::yieldToMagnetAt(const ArmVector& joints_rad) {
  if (!joints_rad.allFinite()) throw std::invalid_argument("yieldToMagnetAt: an angle that is not finite");
  if (state_->held || state_->target || !check(joints_rad)) return false;
  setTarget(
      OrientedBox{state_->T_map_base * state_->arm->tipPose(joints_rad), Eigen::Vector3d::Constant(kFacePlace_m)});
  if (!check(joints_rad)) return true;
  setTarget(std::nullopt);
  return false;
}

bool CollisionChecker::yieldToRobotAt(const ArmVector& joints_rad) {
  if (!joints_rad.allFinite()) throw std::invalid_argument("yieldToRobotAt: an angle that is not finite");
  if (!state_->held) return true;
  const HeldBrick held = *state_->held_brick;
  const auto yieldBy = [&](double padding_m) {
    state_->held_padding_m = padding_m;
    setHeld(held, state_->held_may_touch, state_->held_less_m);
    return !state_->heldTouchesRobot(joints_rad);
  };
  const CollisionCheckerConfig& config = state_->config;
  for (double padding_m = config.held_padding_m;; padding_m -= kReleaseStep_m) {
    if (yieldBy(std::max(padding_m, -config.held_release_m))) return true;
    if (padding_m <= -config.held_release_m) break;
  }
  yieldBy(config.held_padding_m);
  return false;
}

bool CollisionChecker::yieldToSurfaceAt(const std::optional<ArmVector>& joints_rad) {
  if (joints_rad && !joints_rad->allFinite()) throw std::invalid_argument("yieldToSurfaceAt: an angle is not finite");
  State& state = *state_;
  state.keeps_margin = true;
  if (!joints_rad) return false;
  state.place(*joints_rad);
  for (std::size_t i = 0; i < state.parts->moving.size() && state.keeps_margin; ++i) {
    state.keeps_margin = !state.touchesSurface(i);
  }
  return !state.keeps_margin;
}

/// None: smaller by at most held_release_m it is free in all of them. Else it is as in a lift, and this is what the smallest
/// one touches.
Contact CollisionChecker::releaseHeld(const HeldBrick& held, const std::vector<ArmVector>& postures) {
  const CollisionCheckerConfig& config = state_->config;
  Contact contact;
  const auto are_free = [&] {
    contact = {};
    return std::all_of(postures.begin(), postures.end(), [&](const ArmVector& q) { return !(contact = check(q)); });
  };
  for (double less_m = config.held_shrink_m;; less_m += kReleaseStep_m) {
    setHeld(held, true, std::min(less_m, std::max(config.held_release_m, config.held_shrink_m)));
    if (are_free()) return {};
    if (less_m >= config.held_release_m) break;
  }
  setHeld(held);
  return contact;
}

void CollisionChecker::setHeld(const std::optional<HeldBrick>& held, bool may_touch, double less_m) {
  if (!held) {
    state_->held_brick.reset();
    state_->held.reset();
    return;
  }
  if (!isRigid(held->T_tip_brick)) throw std::invalid_argument("pose of the held brick is not a rigid transform");
  if (!isBoxSize(held->size_m)) throw std::invalid_argument("size of the held brick " + describeSize(held->size_m));
  if (state_->held && state_->held_brick->size_m == held->size_m && state_->held_may_touch == may_touch &&
      state_->held_less_m == less_m && state_->held_made_for_m == state_->held_padding_m) {
    // The same brick, taken elsewhere: what depends on its size is there.
    auto part = std::make_shared<Part>(*state_->held);
    part->T_body_shape = state_->parts->T_body_tip * held->T_tip_brick;
    state_->held = std::move(part);
    state_->held_brick = held;
    return;
  }
  // A plate thinner than twice what it is shrunk by keeps a fifth of its thickness.
  const auto smallerBy = [&](double by_m) {
    return mp700_ur5e_description::Box{(held->size_m.array() - 2.0 * by_m).max(0.2 * held->size_m.array())};
  };
  const mp700_ur5e_description::Box whole{held->size_m};
  auto part = std::make_shared<Part>(
      makeMovingPart(kBrick, state_->parts->tip_body, state_->parts->T_body_tip * held->T_tip_brick,
                     may_touch ? smallerBy(less_m) : whole, smallerBy(std::max(0.0, -state_->held_padding_m)),
                     std::max(0.0, state_->held_padding_m)));
  part->is_tool = true;
  state_->held = std::move(part);
  state_->held_brick = held;
  state_->held_may_touch = may_touch;
  state_->held_less_m = less_m;
  state_->held_made_for_m = state_->held_padding_m;
}

const std::optional<HeldBrick>& CollisionChecker::held() const {
  return state_->held_brick;
}

void CollisionChecker::setLoad(const std::vector<LoadedBrick>& load, const ArmVector& start_rad) {
  if (!start_rad.allFinite()) throw std::invalid_argument("setLoad: an angle that is not finite");
  State& state = *state_;
  state.load.clear();
  state.place(start_rad);
  for (const LoadedBrick& brick : load) {
    const Shape box = mp700_ur5e_description::Box{brick.size_m};
    Part part = makePart(kLoad, 0, state.T_map_base * brick.T_base_brick, inflate(box, kPoseError_m),
                         inflate(box, state.config.held_padding_m), 0.0);
    bool is_free = !state.held || !state.heldTouchesLoad(part);
    for (std::size_t i = 0; i < state.parts->moving.size(); ++i) {
      is_free = is_free && !state.touch(state.parts->moving[i], state.T_map_moving[i], part, part.T_body_shape);
    }
    if (is_free) state.load.push_back(std::move(part));
  }
}

void CollisionChecker::setTarget(const std::optional<OrientedBox>& target, bool for_all) {
  setTarget(target, for_all, for_all);
}

void CollisionChecker::setTarget(const std::optional<OrientedBox>& target, bool for_all, bool only_own) {
  State& state = *state_;
  if (!target) {
    state.target.reset();
    state.target_chunks.clear();
    return;
  }
  if (!isRigid(target->T_map_box)) throw std::invalid_argument("pose of the target is not a rigid transform");
  if (!isBoxSize(target->size_m)) throw std::invalid_argument("size of the target " + describeSize(target->size_m));
  OrientedBox padded = *target;
  padded.size_m.array() += 2.0 * state.config.target_padding_m;
  if (state.target && state.target->T_map_box.matrix() == padded.T_map_box.matrix() &&
      state.target->size_m == padded.size_m && state.target_for_all == for_all && state.target_only_own == only_own) {
    return;
  }
  state.target_for_all = for_all;
  state.target_only_own = only_own;
  state.target = padded;
  state.T_target_map = padded.T_map_box.inverse();
  state.target_chunks.assign(state.scene->chunks.size(), std::nullopt);
}

void CollisionChecker::freeUnknownAt(const ArmVector& joints_rad) {
  if (!joints_rad.allFinite()) throw std::invalid_argument("joint angles are not finite");
  State& state = *state_;
  if (state.scene->lattice.count() == 0) return;
  state.is_freed.resize(state.scene->lattice.count(), 0);
  state.place(joints_rad);
  for (std::size_t i = 0; i < state.numMoving(); ++i) {
    state.visitBlocks(i, [&](std::size_t index, double) {
      state.is_freed[index] = 1;
      return false;
    });
  }
}

Contact CollisionChecker::check(const ArmVector& joints_rad) const {
  State& state = *state_;
  const ArmLimits& limits = state.arm->limits();
  for (Eigen::Index j = 0; j < joints_rad.size(); ++j) {
    const bool is_within = joints_rad[j] >= limits.lower_rad[j] - kLimitTolerance_rad &&
                           joints_rad[j] <= limits.upper_rad[j] + kLimitTolerance_rad;  // false for NaN
    if (!is_within) {
      return {CollisionKind::kLimits, mp700_ur5e_description::kArmJoints[static_cast<std::size_t>(j)], "",
              state.T_map_base.translation()};
    }
  }
  state.place(joints_rad);
  if (Contact floor = state.checkFloor()) return floor;
  state.near.clear();
  for (std::size_t i = 0; i < state.numMoving(); ++i) {
    if (!state.mayTouchWorld(i)) continue;
    Contact contact = state.contact(CollisionKind::kNone, i);
    contact.kind = state.checkLattice(i, &contact.where_map);
    if (contact) return contact;
    state.near.push_back(i);
  }
  if (Contact self = state.checkSelf()) return self;
  for (const std::size_t i : state.near) {
    if (state.touchesSurface(i)) return state.contact(CollisionKind::kSurface, i);
  }
  return {};
}

double CollisionChecker::clearance(const ArmVector& joints_rad, double limit_m) const {
  if (!joints_rad.allFinite() || !(limit_m >= 0.0)) {
    throw std::invalid_argument("joint angles and limit must be finite, the limit not negative");
  }
  State& state = *state_;
  state.place(joints_rad);
  double best_m = limit_m;
  struct Candidate {
    double distance_m;  // between bounding boxes
    std::size_t part;
    const SurfaceChunk* chunk;
  };
  std::vector<Candidate> candidates;
  for (std::size_t i = 0; i < state.numMoving(); ++i) {
    if (!state.mayTouchWorld(i, std::max(0.0, best_m))) continue;
    const Part& part = state.moving(i);
    const double depth_m = state.depth(i);
    if (depth_m < 0.0) {
      best_m = std::min(best_m, depth_m);
      continue;
    }
    const bool is_exempt = state.isExempt(part);
    const Eigen::Vector3d half = halfExtents(part.world_shape, state.T_map_moving[i].linear());
    const Eigen::Vector3d middle = state.T_map_moving[i].translation();
    const Eigen::AlignedBox3d bounds(middle - half, middle + half);
    for (std::size_t c = 0; c < state.scene->chunks.size(); ++c) {
      const double distance_m = state.scene->chunks[c]->mappedBounds().exteriorDistance(bounds);
      if (distance_m >= best_m) continue;
      if (const SurfaceChunk* chunk = state.chunkFor(c, is_exempt)) candidates.push_back({distance_m, i, chunk});
    }
  }
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate& a, const Candidate& b) { return a.distance_m < b.distance_m; });
  // Vertices bound the answer from above, cheaply; FCL then looks at the few triangles that may be nearer.
  double bound_m = best_m;
  for (const Candidate& candidate : candidates) {
    if (candidate.distance_m >= bound_m || bound_m <= 0.0) break;
    const Eigen::Isometry3d T_shape_map = state.T_map_moving[candidate.part].inverse();
    for (const Eigen::Vector3d& p_map : candidate.chunk->mapped()) {
      bound_m = std::min(bound_m, signedDistance(state.moving(candidate.part).world_shape, T_shape_map * p_map));
    }
  }
  if (bound_m <= 0.0) return std::min(best_m, 0.0);  // a vertex within a part
  for (const Candidate& candidate : candidates) {
    if (candidate.distance_m >= bound_m) break;
    fcl::DistanceResultd result(bound_m);
    fcl::distance(&candidate.chunk->mappedBvh(), Eigen::Isometry3d::Identity(),
                  state.moving(candidate.part).world_fcl.get(), state.T_map_moving[candidate.part],
                  exactDistanceRequest(), result);
    bound_m = std::min(bound_m, std::max(0.0, result.min_distance));  // -1 where they overlap
  }
  return std::min(best_m, bound_m);
}

}  // namespace motion_planning
