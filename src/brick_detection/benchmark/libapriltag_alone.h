// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include <Eigen/Geometry>
#include <opencv2/core.hpp>

#include "brick_detection/camera_model.h"

namespace brick_detection {

/// The peer to compare with: tag36h11 by libapriltag as its documentation uses it, as apriltag_ros does for single tags:
/// its own corners, its own estimate_tag_pose() (orthogonal iteration, the better of two minima), no depth.
class LibapriltagAlone {
 public:
  struct Tag {
    int id{0};
    Eigen::Isometry3d T_camera_tag{Eigen::Isometry3d::Identity()};  ///< our tag frame: x right, y up, z out
  };

  /// `decimate`: 2 is the library's default.
  explicit LibapriltagAlone(double decimate);
  ~LibapriltagAlone();

  /// `edge_m`: of the black border. The camera's distortion is not looked at.
  std::vector<Tag> detect(const cv::Mat& grey, const CameraModel& camera, double edge_m);

 private:
  struct Library;
  std::unique_ptr<Library> library_;
};

}  // namespace brick_detection
