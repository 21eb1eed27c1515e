// SPDX-License-Identifier: BSD-3-Clause
#include "support/pick_world.h"

#include <algorithm>
#include <cmath>
#include <random>

#include <mp700_ur5e_description/arm_pose.h>
#include <mp700_ur5e_description/robot_names.h>

namespace motion_planning {

namespace description = mp700_ur5e_description;

void PickWorld::add(const Eigen::Vector3d& p_base, double yaw_rad) {
  OrientedBox box;
  box.T_map_box = T_map_base * Eigen::Translation3d(p_base) * Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ());
  box.size_m = type.size_m;
  open.push_back(world.boxes.size());
  world.boxes.push_back(box);
}

void PickWorld::makeScene(const CollisionSceneConfig& config) {
  CollisionSceneBuilder builder(config);
  builder.update(world.surface(), world, T_map_base);
  scene = builder.scene();
}

PlanningContext PickWorld::context() const {
  PlanningContext context;
  context.scene = scene;
  context.T_map_base = T_map_base;
  context.start_rad = start_rad;
  return context;
}

PickTarget PickWorld::target(std::size_t brick) const {
  PickTarget target;
  target.brick_id = static_cast<int>(brick);
  target.T_map_brick = world.boxes[brick].T_map_box;
  target.type = &type;
  const Eigen::Isometry3d T_base_brick = T_map_base.inverse() * target.T_map_brick;
  const Eigen::Vector3d to_robot = -T_base_brick.translation().normalized();
  target.faces.assign(description::kBrickFaces.begin(), description::kBrickFaces.end());
  const auto worth = [&](description::BrickFace face) {
    const Eigen::Vector3d n = T_base_brick.linear() * description::faceNormal(face);
    return 10.0 * n.z() + n.dot(to_robot);
  };
  std::stable_sort(target.faces.begin(), target.faces.end(),
                   [&](description::BrickFace a, description::BrickFace b) { return worth(a) > worth(b); });
  target.faces.pop_back();  // the one it lies on
  return target;
}

std::vector<ArmGoal> PickWorld::container(const ArmKinematics& arm, std::size_t index) const {
  PlaceGoal place;
  place.T_base_place =
      arm.robot().framePose(description::kContainerPlaces.at(index), arm.robotPositions(ArmVector::Zero()));
  ArmGoal goal;
  goal.place = place;
  return {goal};
}

std::shared_ptr<const ArmKinematics> shippedArm() {
  static const auto arm =
      std::make_shared<const ArmKinematics>(description::RobotModel::load(DESCRIPTION_DIR "/urdf/mp700_ur5e.urdf"));
  return arm;
}

ManipulabilitySectors testSectors() {
  ManipulabilitySectors sectors;
  for (AnnulusSector* sector : {&sectors.top, &sectors.side}) {
    sector->min_radius_m = 0.30;
    sector->max_radius_m = 0.85;
    sector->min_height_m = -0.55;
    sector->max_height_m = 0.35;
    sector->half_angle_rad = 1.6;
  }
  return sectors;
}

PickWorld emptyPickWorld() {
  PickWorld pick;
  pick.T_map_base = Eigen::Translation3d(0.2, -0.1, 0.03) * Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitZ());
  pick.world.ground_z_m = 0.03;
  pick.type = description::loadBrickTypes(DESCRIPTION_DIR "/config/bricks.yaml").types.front();
  pick.start_rad << 0.0, -2.0, 2.4, -0.4 - 0.5 * M_PI, -0.5 * M_PI, 0.0;  // stowed
  return pick;
}

PickWorld randomPile(std::uint64_t seed, int num_bricks) {
  PickWorld pick = emptyPickWorld();
  std::mt19937_64 rng(seed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  const double height_m = pick.type.size_m.z();
  const double radius_m = 0.5 * pick.type.size_m.head<2>().norm();
  std::vector<std::size_t> base;
  std::vector<bool> covered;
  for (int attempt = 0; attempt < 2000 && static_cast<int>(pick.world.boxes.size()) < num_bricks; ++attempt) {
    const double yaw_rad = M_PI * unit(rng);
    if (!base.empty() && unit(rng) < 0.3) {  // on top of another
      const std::size_t below = base[static_cast<std::size_t>(unit(rng) * static_cast<double>(base.size()))];
      if (covered[below]) continue;
      covered[below] = true;
      Eigen::Vector3d p = pick.T_map_base.inverse() * pick.world.boxes[below].T_map_box.translation();
      p += Eigen::Vector3d(0.06 * (unit(rng) - 0.5), 0.06 * (unit(rng) - 0.5), height_m);
      // Boxes of one map must not overlap: this one may not reach over a neighbour of the same height.
      bool is_clear = true;
      for (const OrientedBox& box : pick.world.boxes) {
        const Eigen::Vector3d way = pick.T_map_base.inverse() * box.T_map_box.translation() - p;
        is_clear = is_clear && (std::abs(way.z()) > 0.9 * height_m || way.head<2>().norm() > 2.0 * radius_m);
      }
      if (!is_clear) continue;
      pick.open.erase(std::find(pick.open.begin(), pick.open.end(), below));
      pick.add(p, yaw_rad);
      covered.push_back(true);
      continue;
    }
    const Eigen::Vector3d p(0.65 + 0.55 * unit(rng), 1.2 * (unit(rng) - 0.5), 0.5 * height_m);
    bool is_clear = true;
    for (const OrientedBox& box : pick.world.boxes) {
      const Eigen::Vector3d way = pick.T_map_base.inverse() * box.T_map_box.translation() - p;
      is_clear = is_clear && way.head<2>().norm() > 2.0 * radius_m;
    }
    if (!is_clear) continue;
    base.push_back(pick.world.boxes.size());
    covered.resize(pick.world.boxes.size() + 1, false);
    covered[base.back()] = false;
    pick.add(p, yaw_rad);
  }
  pick.makeScene();
  return pick;
}

}  // namespace motion_planning
