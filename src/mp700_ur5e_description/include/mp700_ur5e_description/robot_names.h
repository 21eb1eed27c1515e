// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>

/// Names in urdf/mp700_ur5e.urdf that other packages rely on; a test asks the URDF for each.
namespace mp700_ur5e_description {

/// The arm's joints from base to tool: the order of the driver's controllers. Its joint states come in another order.
constexpr std::array<const char*, 6> kArmJoints = {"shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint",
                                                   "wrist_1_joint",      "wrist_2_joint",       "wrist_3_joint"};

constexpr const char* kBaseFrame = "base_link";
constexpr const char* kFootprintFrame = "base_footprint";
constexpr const char* kLeftWheelJoint = "wheel_front_left_joint";
constexpr const char* kRightWheelJoint = "wheel_front_right_joint";
constexpr const char* kScannerFrame = "lidar_1_link";
constexpr const char* kArmBaseFrame = "ur5e_base_link";
constexpr const char* kArmControllerFrame = "ur5e_base";  // turned by pi about z against kArmBaseFrame
constexpr const char* kToolFrame = "ur5e_tool0";
constexpr const char* kMagnetLink = "magnet";
constexpr const char* kMagnetTipFrame = "magnet_tip";  // middle of the magnet's end face, z out of the tool
constexpr const char* kColorFrame = "camera_color_optical_frame";
constexpr const char* kDepthFrame = "camera_depth_optical_frame";
constexpr const char* kContainerLink = "container";
/// Places of bricks in the container, level with its rim: z up, x along the brick's longer side.
constexpr std::array<const char*, 3> kContainerPlaces = {"container_place_1", "container_place_2", "container_place_3"};

}  // namespace mp700_ur5e_description
