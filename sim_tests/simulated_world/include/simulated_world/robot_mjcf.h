// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <urdf_model/model.h>

namespace simulated_world {

/// What a URDF does not say of a joint: inertia of the motor behind it, viscous friction. Slides: kg, N s/m. Hinges:
/// kg m^2, N m s/rad.
struct JointDynamics {
  double armature{0.0};
  double damping{0.0};
};

struct RobotMjcfOptions {
  JointDynamics base_linear{50.0, 0.0};  ///< base_x, base_y
  JointDynamics base_turn{10.0, 0.0};    ///< base_yaw
  JointDynamics arm{0.1, 1.0};           ///< joints with limits
  JointDynamics wheel{0.01, 0.1};        ///< joints without

  double camera_fovy_rad{0.744};  ///< vertical opening angle: 480 rows at a focal length of 615 px
  double friction{0.8};           ///< sliding, of what the robot touches things with
  /// The base glides in the plane, and its drive plays the tyres' part: these touch nothing, nor do links that continuous
  /// joints turn. A robot need not have them.
  std::vector<std::string> links_without_contact{"wheel_front_left_link", "wheel_front_right_link", "caster_rear_link"};

  /// One line per impossible value: key, value, rule. Empty: fine.
  std::vector<std::string> validate() const;
};

/// The robot as an MJCF <body>, to stand in the <worldbody> of a document with <compiler angle="radian"/>.
///
/// Every link of the URDF is a body of its name, with the URDF's mass and inertia; fixed joints nest without a joint.
/// The root link gets the joints base_x, base_y (slides) and base_yaw (hinge); the others keep the URDF's names and
/// ranges. Shapes: "<link>/c0", ... collide (group 3), "<link>/v0", ... are seen (group 2). Camera "rgbd" in
/// camera_depth_optical_frame. Sites at the frames magnet_tip, ur5e_tool0 (named "wrist_ft"), lidar_1_link.
///
/// Throws std::invalid_argument for impossible options, for joints that are not fixed, revolute, continuous or prismatic,
/// for meshes, and if a link that is named here is missing.
std::string robotMjcf(const urdf::ModelInterface& model, const RobotMjcfOptions& options = {});

/// The same from a URDF file. Throws std::invalid_argument, too, if it cannot be read.
std::string robotMjcfFromFile(const std::string& urdf_file, const RobotMjcfOptions& options = {});

}  // namespace simulated_world
