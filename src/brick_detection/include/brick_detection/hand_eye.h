// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <Eigen/Geometry>

#include "brick_detection/brick_pose.h"
#include "brick_detection/camera_model.h"

namespace brick_detection {

/// One standstill of the arm with the target in view. Camera and target see each other; neither pose is known to the other.
struct HandEyeSample {
  Eigen::Isometry3d T_base_tool{Eigen::Isometry3d::Identity()};      ///< forward kinematics
  Eigen::Isometry3d T_camera_target{Eigen::Isometry3d::Identity()};  ///< by detection
  Matrix6d covariance{Matrix6d::Identity() * 1e-6};                  ///< of T_camera_target, as BrickSighting's
};

struct HandEyeConfig {
  int min_samples{8};
  double min_rotation_rad{0.35};  ///< the tool must turn at least that much between some samples, about two axes
  double max_residual_m{0.01};    ///< root mean square: above it the result is refused
  double max_residual_rad{0.02};
  double outlier_chi2{30.0};  ///< six degrees of freedom: a sample farther off is left out, and reported

  std::vector<std::string> validate() const;
};

/// Camera on the mast, target on the tool (eye to hand).
struct HandEyeResult {
  Eigen::Isometry3d T_base_camera{Eigen::Isometry3d::Identity()};
  Eigen::Isometry3d T_tool_target{Eigen::Isometry3d::Identity()};
  Matrix6d covariance{Matrix6d::Identity()};  ///< of T_base_camera, along the base's axes
  struct Residual {
    double translation_m{0.0};
    double rotation_rad{0.0};
    bool is_outlier{false};
  };
  std::vector<Residual> residuals;  ///< of each sample: T_base_camera T_camera_target against T_base_tool T_tool_target
  double rms_m{0.0};                ///< over those that are no outliers
  double rms_rad{0.0};
};

/// OpenCV's closed form (cv::calibrateHandEye), then least squares over both unknown poses, weighted by the covariances,
/// without outliers. Throws std::invalid_argument for a bad config or a sample that is not finite, and
/// std::runtime_error that says what to do when the samples do not determine the answer: too few, too little rotation,
/// residuals beyond the limits.
HandEyeResult solveHandEye(const std::vector<HandEyeSample>& samples, const HandEyeConfig& config);

}  // namespace brick_detection
