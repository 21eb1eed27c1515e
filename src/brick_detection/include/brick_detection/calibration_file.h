// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <Eigen/Geometry>
#include <mp700_ur5e_description/camera_calibration.h>

#include "brick_detection/hand_eye.h"

namespace brick_detection {

/// The edge of the tree of frames that a hand-eye result measures, and which frames it joins. What lies beside the edge
/// is taken from the URDF: `T_base_parent` below it, `T_child_camera` above.
struct CalibratedEdge {
  std::string parent_frame{"camera_mast"};
  std::string child_frame{"camera_link"};
  Eigen::Isometry3d T_base_parent{Eigen::Isometry3d::Identity()};
  Eigen::Isometry3d T_child_camera{Eigen::Isometry3d::Identity()};
};

/// The result as a calibration of the edge, with its covariance. The child's origin is not the camera's, so it takes a
/// share of the camera's rotation. `date`: as it shall stand in the file. Throws std::invalid_argument for a result
/// without an answer.
mp700_ur5e_description::CameraCalibration toCameraCalibration(const HandEyeResult& result, const CalibratedEdge& edge,
                                                              const std::string& date);

/// Writes the file completely or not at all. Throws interactive_mapping::FileError with path and reason.
void saveCameraCalibration(const std::string& path, const mp700_ur5e_description::CameraCalibration& calibration);

}  // namespace brick_detection
