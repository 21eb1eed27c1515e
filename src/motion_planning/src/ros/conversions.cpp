// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning_ros/conversions.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <mp700_ur5e_description/robot_names.h>

namespace motion_planning_ros {
namespace {

using interactive_mapping_msgs::PlanOutcome;
using motion_planning::ArmVector;
using motion_planning::JointTrajectory;
using motion_planning::PlanStatus;
using mp700_ur5e_description::kArmJoints;

/// Sizes are checked by the caller.
ArmVector pick(const std::vector<double>& values, const std::array<std::size_t, 6>& order) {
  ArmVector result;
  for (std::size_t i = 0; i < order.size(); ++i) result[static_cast<Eigen::Index>(i)] = values[order[i]];
  return result;
}

}  // namespace

motion_planning::Surface toSurface(const interactive_mapping_msgs::SurfaceMesh& mesh) {
  const std::size_t num_vertices = mesh.mesh.vertices.size();
  if (mesh.normals.size() != 3 * num_vertices) {
    throw std::invalid_argument("the mesh has " + std::to_string(mesh.normals.size()) +
                                " numbers in normals, must be 3 x " + std::to_string(num_vertices) + " vertices");
  }
  motion_planning::Surface surface;
  surface.vertices_map.reserve(num_vertices);
  surface.normals_map.reserve(num_vertices);
  for (std::size_t i = 0; i < num_vertices; ++i) {
    const geometry_msgs::Point& p = mesh.mesh.vertices[i];
    surface.vertices_map.emplace_back(p.x, p.y, p.z);
    surface.normals_map.emplace_back(mesh.normals[3 * i], mesh.normals[3 * i + 1], mesh.normals[3 * i + 2]);
  }
  surface.triangles.reserve(mesh.mesh.triangles.size());
  for (const shape_msgs::MeshTriangle& triangle : mesh.mesh.triangles) {
    surface.triangles.push_back({triangle.vertex_indices[0], triangle.vertex_indices[1], triangle.vertex_indices[2]});
  }
  return surface;
}

trajectory_msgs::JointTrajectory toMessage(const JointTrajectory& trajectory) {
  trajectory_msgs::JointTrajectory message;
  message.joint_names.assign(kArmJoints.begin(), kArmJoints.end());
  message.points.reserve(trajectory.points.size());
  for (const motion_planning::TrajectoryPoint& point : trajectory.points) {
    trajectory_msgs::JointTrajectoryPoint out;
    const auto copy = [](const ArmVector& v) { return std::vector<double>(v.data(), v.data() + v.size()); };
    out.positions = copy(point.position_rad);
    out.velocities = copy(point.velocity_rad_s);
    out.time_from_start = ros::Duration(point.time_s);
    message.points.push_back(std::move(out));
  }
  return message;
}

JointTrajectory fromMessage(const trajectory_msgs::JointTrajectory& message) {
  if (message.joint_names.size() != kArmJoints.size()) {
    throw std::invalid_argument("the trajectory has " + std::to_string(message.joint_names.size()) +
                                " joints, must be the arm's 6");
  }
  std::array<std::size_t, 6> order{};
  for (std::size_t i = 0; i < kArmJoints.size(); ++i) {
    const auto found = std::find(message.joint_names.begin(), message.joint_names.end(), kArmJoints[i]);
    if (found == message.joint_names.end()) {
      throw std::invalid_argument(std::string("the trajectory lacks joint ") + kArmJoints[i]);
    }
    order[i] = static_cast<std::size_t>(found - message.joint_names.begin());
  }
  JointTrajectory trajectory;
  for (const trajectory_msgs::JointTrajectoryPoint& in : message.points) {
    const std::string where = "point " + std::to_string(trajectory.points.size()) + " of the trajectory ";
    if (in.positions.size() != order.size()) {
      throw std::invalid_argument(where + "has " + std::to_string(in.positions.size()) + " positions, must be 6");
    }
    if (!in.velocities.empty() && in.velocities.size() != order.size()) {
      throw std::invalid_argument(where + "has " + std::to_string(in.velocities.size()) +
                                  " velocities, must be 0 or 6");
    }
    if (in.velocities.empty() != message.points.front().velocities.empty()) {
      throw std::invalid_argument(where + "must have velocities if the first has, and none if it has none");
    }
    motion_planning::TrajectoryPoint point;
    point.time_s = in.time_from_start.toSec();
    point.position_rad = pick(in.positions, order);
    if (!in.velocities.empty()) point.velocity_rad_s = pick(in.velocities, order);
    if (!point.position_rad.allFinite() || !point.velocity_rad_s.allFinite()) {
      throw std::invalid_argument(where + "is not finite");
    }
    if (point.time_s < 0.0) {
      throw std::invalid_argument(where + "has time_from_start = " + std::to_string(point.time_s) +
                                  " s, must be >= 0 s");
    }
    if (!trajectory.empty() && point.time_s <= trajectory.points.back().time_s) {
      throw std::invalid_argument(where + "has time_from_start = " + std::to_string(point.time_s) +
                                  " s, must be later than the point before, " +
                                  std::to_string(trajectory.points.back().time_s) + " s");
    }
    trajectory.points.push_back(point);
  }
  return trajectory;
}

ArmVector toArmVector(const std::vector<double>& joints_rad, const std::string& what) {
  if (joints_rad.size() != 6) {
    throw std::invalid_argument(what + " has " + std::to_string(joints_rad.size()) + " joint angles, must be 6");
  }
  const ArmVector result = Eigen::Map<const ArmVector>(joints_rad.data());
  if (!result.allFinite()) throw std::invalid_argument(what + " is not finite");
  return result;
}

PlanOutcome toMessage(const motion_planning::PlanFailure& failure) {
  PlanOutcome message;
  message.status = static_cast<std::uint8_t>(failure.status);
  message.message = failure.message;
  return message;
}

}  // namespace motion_planning_ros
