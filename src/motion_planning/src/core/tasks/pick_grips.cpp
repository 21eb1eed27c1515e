// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include <mp700_ur5e_description/robot_names.h>

#include "tasks/failures.h"
#include "tasks/pick_stages.h"

namespace motion_planning {

namespace description = mp700_ur5e_description;

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
    if (task.sectors.admits(T_base_face * p_face, T_base_face.linear().col(2), T_base_armbase, &why)) {
      points.push_back(p_face);
    } else if (why_not.empty()) {
      why_not = why;
    }
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
      grip.tilt.up_tip = grip.T_base_contact.linear().transpose() * Eigen::Vector3d::UnitZ();
      grip.tilt.max_tilt_rad = task.config.pick.max_tilt_rad;
      grips.push_back(grip);
    }
  }
  return grips;
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
