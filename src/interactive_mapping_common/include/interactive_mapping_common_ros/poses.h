// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include <Eigen/Geometry>
#include <geometry_msgs/Pose.h>
#include <geometry_msgs/Transform.h>

#include "interactive_mapping_common/geometry/pose2d.h"

/// Poses of messages, checked: tf2_eigen takes what is no rotation, too.
namespace interactive_mapping_ros {

/// Frame names of tf2 have no leading slash; those of old bags do.
std::string withoutSlash(const std::string& frame);

/// Nothing, with the reason on request, when a number is not finite or the quaternion's length is not 1 within 1 %.
/// Float32 sources keep to this.
std::optional<Eigen::Isometry3d> toIsometry(const geometry_msgs::Transform& transform, std::string* reason = nullptr);
std::optional<Eigen::Isometry3d> toIsometry(const geometry_msgs::Pose& pose, std::string* reason = nullptr);

geometry_msgs::Pose toPose(const Eigen::Isometry3d& T);
geometry_msgs::Pose toPose(const interactive_mapping::Pose2d& pose);

/// Seen from above; the tilt is lost.
interactive_mapping::Pose2d toPlane(const Eigen::Isometry3d& T);

}  // namespace interactive_mapping_ros
