// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <optional>
#include <random>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <kdl/chainiksolverpos_lma.hpp>
#include <kdl/tree.hpp>
#include <kdl_parser/kdl_parser.hpp>
#include <mp700_ur5e_description/arm_pose.h>
#include <mp700_ur5e_description/base_profile.h>
#include <mp700_ur5e_description/robot_names.h>
#include <urdf_parser/urdf_parser.h>

#include "simulated_world/robot_mjcf.h"
#include "simulated_world/world.h"
#include "simulated_world/world_observation.h"

namespace simulated_world {
namespace test {

/// How the magnet may come to a brick: the tip is in the middle of a face, its z against the face's normal.
struct Grasp {
  Eigen::Vector3d point_map;
  Eigen::Vector3d normal_map;
};

/// A way to touch a brick: where the base stands, how the arm is bent.
struct Reach {
  Pose2d base;
  ArmVector arm_rad;
};

/// Whether the robot, standing before a pile, can touch a brick of it. Looks for one way, by sampling: a brick that is
/// said to be out of reach might have been missed, one that is said to be reached is.
class ArmReach {
 public:
  static constexpr double kClearance_m = 0.01;        // of the robot to bricks, the magnet to its target apart
  static constexpr double kLimitMargin_rad = 0.01;    // half a degree from a limit is at the limit
  static constexpr double kMaxTopTilt_rad = 0.5236;   // 30 degrees: of an upward face
  static constexpr double kMaxSideTilt_rad = 0.1745;  // 10 degrees: of a side face against the vertical plane

  explicit ArmReach(std::vector<BrickPlacement> bricks)
      : bricks_(std::move(bricks)),
        profile_(mp700_ur5e_description::loadBaseProfile(kDescription + "/config/base_profile.yaml")),
        stowed_(mp700_ur5e_description::loadArmPose(kDescription + "/config/arm_poses/stowed.yaml")),
        world_(robotBody(), "", worldBricks(bricks_), Pose2d{-50.0, 0.0, 0.0}, stowed_, WorldConfig()),
        data_(makeData(world_.model())) {
    const std::string urdf = kDescription + "/urdf/mp700_ur5e.urdf";
    KDL::Tree tree;
    const urdf::ModelInterfaceSharedPtr robot = urdf::parseURDFFile(urdf);
    if (!robot || !kdl_parser::treeFromFile(urdf, tree) ||
        !tree.getChain(mp700_ur5e_description::kBaseFrame, mp700_ur5e_description::kMagnetTipFrame, chain_)) {
      throw std::runtime_error("cannot read " + urdf);
    }
    for (int i = 0; i < kNumArmJoints; ++i) {
      const auto limits = robot->getJoint(kArmJoints[static_cast<std::size_t>(i)])->limits;
      lower_rad_[i] = limits->lower + kLimitMargin_rad;
      upper_rad_[i] = limits->upper - kLimitMargin_rad;
    }
    ignoreBricksAmongThemselves();
  }

  /// Nothing rests on the brick: no other one is in the way when it is lifted straight up.
  bool isTopmost(const BrickPlacement& brick) const;

  /// The face that looks up most; after it the faces at the sides.
  static std::vector<Grasp> grasps(const BrickPlacement& brick);

  /// Standing poses from which the brick may be near enough: the robot has driven straight ahead until its outline, seen
  /// from above, is `standoff_m` before the first brick in its way. Nearest to the brick first.
  std::vector<Pose2d> standingPoses(const BrickPlacement& brick) const;

  /// A way to touch the brick, or nothing.
  std::optional<Reach> find(const BrickPlacement& brick);

  /// What the robot touches or comes too close to, but for the magnet and `target_id`: pairs of bodies; empty: none.
  std::set<std::string> collisions(const Reach& reach, int target_id);

  /// T_map_tip by the physics' own kinematics.
  Eigen::Isometry3d tip(const Reach& reach);

  void moveBrick(int id, const Eigen::Vector3d& centre_map) {
    const int joint = requireId(world_.model(), mjOBJ_JOINT, brickBodyName(id) + "_joint");
    for (int i = 0; i < 3; ++i) data_->qpos[world_.model().jnt_qposadr[joint] + i] = centre_map[i];
  }

 private:
  static inline const std::string kDescription = MP700_UR5E_DESCRIPTION_DIR;

  static std::string robotBody() { return robotMjcfFromFile(kDescription + "/urdf/mp700_ur5e.urdf"); }

  static std::vector<WorldBrick> worldBricks(const std::vector<BrickPlacement>& bricks) {
    std::vector<WorldBrick> result;
    result.reserve(bricks.size());
    for (const BrickPlacement& brick : bricks) {
      WorldBrick world_brick;
      world_brick.placement = brick;
      result.push_back(world_brick);
    }
    return result;
  }

  static std::vector<Eigen::Vector2d> cornersSeenFromAbove(const BrickPlacement& brick);
  void ignoreBricksAmongThemselves();
  /// False: the magnet itself would be inside another brick, whatever the arm does. Saves the search.
  bool isMagnetFree(const Grasp& grasp, int target_id) const;
  void bend(const Reach& reach);
  std::optional<ArmVector> solve(const Eigen::Isometry3d& T_base_tip, const ArmVector& start_rad);

  std::vector<BrickPlacement> bricks_;
  mp700_ur5e_description::BaseProfile profile_;
  ArmVector stowed_;
  World world_;
  DataPtr data_;
  KDL::Chain chain_;
  ArmVector lower_rad_;
  ArmVector upper_rad_;
  std::mt19937_64 random_{1};
};

}  // namespace test
}  // namespace simulated_world
