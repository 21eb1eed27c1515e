// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sstream>
#include <string>

#include "simulated_world/mujoco_model.h"
#include "synthetic_depth/scene.h"

namespace simulated_world {
namespace test {

/// Attributes pos and quat of a pose.
inline std::string poseXml(const Eigen::Isometry3d& pose) {
  mjtNum wxyz[4];
  quaternionTo(Eigen::Quaterniond(pose.linear()), wxyz);
  std::ostringstream xml;
  xml.precision(17);
  xml << " pos='" << pose.translation().x() << ' ' << pose.translation().y() << ' ' << pose.translation().z()
      << "' quat='" << wxyz[0] << ' ' << wxyz[1] << ' ' << wxyz[2] << ' ' << wxyz[3] << "' ";
  return xml.str();
}

/// A camera whose optical frame is at `T_world_camera`.
inline std::string cameraXml(const std::string& name, const Eigen::Isometry3d& T_world_camera) {
  const Eigen::Isometry3d T_optical_mujoco(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
  return "<camera name='" + name + "'" + poseXml(T_world_camera * T_optical_mujoco) + "/>";
}

/// The boxes of frame 0 and the ground of an analytic scene as static geoms of group 2, and cameras "camera_<frame>".
inline std::string mjcfOf(const synthetic_depth::Scene& scene) {
  std::ostringstream xml;
  xml.precision(17);
  xml << "<mujoco><worldbody><light pos='0 0 5'/>";
  if (scene.has_ground) {
    xml << "<geom type='plane' size='0 0 1' group='2'/>";
  }
  for (const synthetic_depth::Box& box : scene.boxesAt(0)) {
    xml << "<geom type='box' group='2' size='" << box.half_extents_m.x() << ' ' << box.half_extents_m.y() << ' '
        << box.half_extents_m.z() << "'" << poseXml(box.T_scene_box) << "/>";
  }
  for (int frame = 0; frame < scene.numFrames(); ++frame) {
    xml << cameraXml("camera_" + std::to_string(frame), scene.T_scene_camera[static_cast<std::size_t>(frame)]);
  }
  xml << "</worldbody></mujoco>";
  return xml.str();
}

}  // namespace test
}  // namespace simulated_world
