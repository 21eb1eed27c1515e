// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include <interactive_mapping_common/formatted.h>
#include <mp700_ur5e_description/robot_names.h>

#include "tasks/failures.h"
#include "tasks/pick_stages.h"

namespace motion_planning {

namespace description = mp700_ur5e_description;
using interactive_mapping::formatted;

namespace {

constexpr double kGravity_m_s2 = 9.81;

/// Of the weight of a brick at rest that hangs from `p_face`, about the face's normal (z) and across it [Nm].
struct WeightMoments {
  double twist_Nm;
  double bend_Nm;
};
WeightMoments weightMoments(const description::BrickType& type, const Eigen::Isometry3d& T_base_face,
                            const Eigen::Isometry3d& T_base_brick, const Eigen::Vector3d& p_face) {
  const Eigen::Vector3d lever = T_base_brick.translation() - T_base_face * p_face;
  const Eigen::Vector3d moment = lever.cross(Eigen::Vector3d(0.0, 0.0, -type.mass_kg * kGravity_m_s2));
  const Eigen::Vector3d normal = T_base_face.linear().col(2);
  const double twist_Nm = moment.dot(normal);
  return {std::abs(twist_Nm), (moment - twist_Nm * normal).norm()};
}

}  // namespace

std::string nameOf(const PickTarget& target, description::BrickFace face) {
  return std::string("face ") + toString(face) + " of brick " + std::to_string(target.brick_id);
}

Eigen::Isometry3d facePose(const TaskContext& task, const PickTarget& target, description::BrickFace face) {
  return task.T_base_map * target.T_map_brick * description::tagPose(*target.type, face);
}

Result<std::vector<Eigen::Vector3d>> contactPoints(const TaskContext& task, const PickTarget& target,
                                                   description::BrickFace face) {
  const MotionPlannerConfig& config = task.config;
  const std::string name = nameOf(target, face);
  const auto& plates = target.type->plate_faces;
  if (std::find(plates.begin(), plates.end(), face) == plates.end()) return badRequest(name + " has no steel plate");
  const double room_m = 0.5 * target.type->plate_edge_m - config.pick.magnet_radius_m - config.pick.plate_margin_m;
  if (room_m < 0.0) {
    return badRequest(name + ": the magnet does not fit on its plate of " + std::to_string(target.type->plate_edge_m) +
                      " m");
  }
  const int rings = static_cast<int>(std::floor(room_m / kContactGrid_m + 1e-9));
  std::vector<Eigen::Vector3d> grid;
  for (int x = -rings; x <= rings; ++x) {
    for (int y = -rings; y <= rings; ++y) grid.push_back(kContactGrid_m * Eigen::Vector3d(x, y, 0.0));
  }
  std::stable_sort(grid.begin(), grid.end(), [](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return a.squaredNorm() < b.squaredNorm();
  });
  const Eigen::Isometry3d T_base_face = facePose(task, target, face);
  const Eigen::Isometry3d T_base_armbase =
      task.arm.robot().framePose(description::kArmBaseFrame, task.arm.robotPositions(ArmVector::Zero()));
  std::string why_not;  // of the first point
  std::vector<Eigen::Vector3d> points;
  for (const Eigen::Vector3d& p_face : grid) {
    std::string why;
    const WeightMoments moments =
        weightMoments(*target.type, T_base_face, task.T_base_map * target.T_map_brick, p_face);
    if (moments.twist_Nm > config.pick.max_twist_Nm || moments.bend_Nm > config.pick.max_bend_Nm) {
      why = formatted(
          "the brick's weight turns it on the magnet: %.2f Nm about the magnet's axis, allowed are %.2f Nm "
          "(pick/max_twist_Nm); %.2f Nm across it, allowed are %.2f Nm (pick/max_bend_Nm)",
          moments.twist_Nm, config.pick.max_twist_Nm, moments.bend_Nm, config.pick.max_bend_Nm);
    } else if (task.sectors.admits(T_base_face * p_face, T_base_face.linear().col(2), T_base_armbase, &why)) {
      points.push_back(p_face);
    }
    if (why_not.empty()) why_not = why;
  }
  if (points.empty()) return PlanFailure{PlanStatus::kOutsideSector, name + ": " + why_not};
  return points;
}

std::vector<Grip> gripsAt(const TaskContext& task, const PickTarget& target, const Eigen::Isometry3d& T_base_face,
                          const std::vector<Eigen::Vector3d>& points_face) {
  std::vector<Grip> grips;
  const int turns = task.config.pick.yaw_samples;
  for (const Eigen::Vector3d& p_face : points_face) {
    for (int k = 0; k < turns; ++k) {
      Grip grip;
      grip.T_base_contact = T_base_face * Eigen::Translation3d(p_face);
      grip.T_base_contact.linear() *=
          aboutZ(2.0 * M_PI * k / turns) * Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()).toRotationMatrix();
      grip.held.T_tip_brick = grip.T_base_contact.inverse() * task.T_base_map * target.T_map_brick;
      grip.held.size_m = target.type->size_m;
      grip.held.mass_kg = target.type->mass_kg;
      grip.tilt.up_tip = grip.T_base_contact.linear().transpose() * Eigen::Vector3d::UnitZ();
      grip.tilt.max_tilt_rad = task.config.pick.max_tilt_rad;
      grips.push_back(grip);
    }
  }
  return grips;
}

std::vector<ArmGoal> waysToStow(const TaskContext& task, const HeldBrick& held, const Eigen::Vector3d& up_tip,
                                const ArmGoal& goal) {
  int longest = 0;
  held.size_m.maxCoeff(&longest);
  const Eigen::Vector3d upright_tip = uprightEdge(held, up_tip);
  const bool stands = std::abs(upright_tip.dot(held.T_tip_brick.linear().col(longest))) > 0.5;
  const double lean_rad = std::acos(std::min(1.0, upright_tip.dot(up_tip)));
  const Eigen::Vector3d lever = held.T_tip_brick.translation();
  const double weight_N = held.mass_kg * kGravity_m_s2;
  const bool holds_at_any_tilt = weight_N * lever.head<2>().norm() <= task.config.pick.max_twist_Nm &&
                                 weight_N * lever.norm() <= task.config.pick.max_bend_Nm;
  const bool lies = !stands && lean_rad <= task.config.pick.max_tilt_rad;
  if (!goal.place || !goal.keep_level || lies || !holds_at_any_tilt) return {goal};
  ArmGoal laid_down = goal;
  laid_down.place->lay_down = true;
  laid_down.keep_level = false;
  return {laid_down, goal};
}

std::vector<ContactPosture> contactPostures(const TaskContext& task, const std::vector<Grip>& grips,
                                            std::size_t first_grip) {
  const ArmVector& start = task.request.start_rad;
  std::vector<ContactPosture> postures;
  for (std::size_t grip = first_grip; grip < grips.size(); ++grip) {
    for (const ArmVector& q : task.arm.inverse(grips[grip].T_base_contact, start)) {
      const double way_s = (q - start).cwiseAbs().cwiseQuotient(task.limits.velocity_rad_s).maxCoeff();
      const bool is_dexterous = task.arm.manipulability(q) >= task.sectors.config.min_manipulability_m3;
      postures.push_back({grip, q, is_dexterous, way_s});
    }
  }
  std::stable_sort(postures.begin(), postures.end(), [](const ContactPosture& a, const ContactPosture& b) {
    return a.is_dexterous != b.is_dexterous ? a.is_dexterous : a.way_s < b.way_s;
  });
  return postures;
}

}  // namespace motion_planning
