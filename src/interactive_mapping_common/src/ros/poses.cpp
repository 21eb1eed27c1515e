// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common_ros/poses.h"

#include <cmath>

namespace interactive_mapping_ros {
namespace {

/// `Position`: geometry_msgs' Point or Vector3.
template <typename Position>
std::optional<Eigen::Isometry3d> makeIsometry(const char* what, const Position& position,
                                              const geometry_msgs::Quaternion& orientation, std::string* reason) {
  const Eigen::Quaterniond q(orientation.w, orientation.x, orientation.y, orientation.z);
  const Eigen::Vector3d translation(position.x, position.y, position.z);
  if (!translation.allFinite() || !(std::abs(q.norm() - 1.0) <= 0.01)) {  // false for NaN
    if (reason != nullptr) {
      *reason = std::string(what) + " is not finite or no rotation: |q| = " + std::to_string(q.norm()) + ", must be 1";
    }
    return std::nullopt;
  }
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = q.normalized().toRotationMatrix();
  T.translation() = translation;
  return T;
}

}  // namespace

std::string withoutSlash(const std::string& frame) {
  return !frame.empty() && frame.front() == '/' ? frame.substr(1) : frame;
}

std::optional<Eigen::Isometry3d> toIsometry(const geometry_msgs::Transform& transform, std::string* reason) {
  return makeIsometry("transform", transform.translation, transform.rotation, reason);
}

std::optional<Eigen::Isometry3d> toIsometry(const geometry_msgs::Pose& pose, std::string* reason) {
  return makeIsometry("pose", pose.position, pose.orientation, reason);
}

geometry_msgs::Pose toPose(const Eigen::Isometry3d& T) {
  const Eigen::Quaterniond q(T.linear());
  geometry_msgs::Pose pose;
  pose.position.x = T.translation().x();
  pose.position.y = T.translation().y();
  pose.position.z = T.translation().z();
  pose.orientation.x = q.x();
  pose.orientation.y = q.y();
  pose.orientation.z = q.z();
  pose.orientation.w = q.w();
  return pose;
}

geometry_msgs::Pose toPose(const interactive_mapping::Pose2d& pose) {
  geometry_msgs::Pose message;
  message.position.x = pose.x_m;
  message.position.y = pose.y_m;
  message.orientation.z = std::sin(0.5 * pose.yaw_rad);
  message.orientation.w = std::cos(0.5 * pose.yaw_rad);
  return message;
}

interactive_mapping::Pose2d toPlane(const Eigen::Isometry3d& T) {
  return {T.translation().x(), T.translation().y(), std::atan2(T.linear()(1, 0), T.linear()(0, 0))};
}

}  // namespace interactive_mapping_ros
