// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>

#include "brick_detection/brick_pose.h"

namespace brick_detection {

/// One standstill of the arm with the target in view. Camera and target see each other; neither pose is known to the other.
struct HandEyeSample {
  Eigen::Isometry3d T_base_tool{Eigen::Isometry3d::Identity()};      ///< forward kinematics
  Eigen::Isometry3d T_camera_target{Eigen::Isometry3d::Identity()};  ///< by detection
  Matrix6d covariance{Matrix6d::Identity() * 1e-6};                  ///< of T_camera_target, as BrickSighting's
};

struct HandEyeConfig {
  int min_samples{8};
  double min_rotation_rad{0.35};
  // A tag's covariance alone can be far below it, and would let one near sample outvote the rest.
  double arm_std_m{0.0005};
  double arm_std_rad{0.0005};
  double max_residual_m{0.01};
  double max_residual_rad{0.035};  // a lone tag seen frontally at 1.5 m has 0.02 by itself
  double outlier_chi2{30.0};

  static void fields(HandEyeConfig& c, interactive_mapping::Fields& f) {
    // Three poses determine both unknowns; the fourth begins to check them.
    f("min_samples", c.min_samples, 4, 1000, "", "samples that a solution needs");
    f("min_rotation_rad", c.min_rotation_rad, 0.05, 3.0, "rad",
      "rotation of the tool between some of the samples that a solution needs, about two axes");
    f("arm_std_m", c.arm_std_m, 0.0, 0.1, "m",
      "standard deviation of the forward kinematics at the target, which differs between poses");
    f("arm_std_rad", c.arm_std_rad, 0.0, 0.1, "rad", "the same of the rotation");
    f("max_residual_m", c.max_residual_m, 1e-6, 1.0, "m", "a larger root mean square of the residuals gives no result");
    f("max_residual_rad", c.max_residual_rad, 1e-6, 1.0, "rad", "the same of the rotation");
    // Below 12.6, one good sample in 20 would be left out.
    f("outlier_chi2", c.outlier_chi2, 12.6, 1e6, "",
      "a sample with a larger chi-square, of six degrees of freedom, is left out and reported");
  }
};

/// Why there is no answer. The reason in words is HandEyeResult::reason.
enum class HandEyeFailure {
  kNone,
  kTooFewSamples,
  kTooLittleRotation,
  kOneAxisOnly,
  kSamplesDisagree,
  kResidualTooBig
};

/// Camera on the mast, target on the tool (eye to hand).
struct HandEyeResult {
  HandEyeFailure failure{HandEyeFailure::kNone};
  std::string reason;  ///< what is wrong and what to do; empty when there is an answer
  Eigen::Isometry3d T_base_camera{Eigen::Isometry3d::Identity()};
  Eigen::Isometry3d T_tool_target{Eigen::Isometry3d::Identity()};
  Matrix6d covariance{Matrix6d::Identity()};  ///< of T_base_camera, along the base's axes
  struct Residual {
    double translation_m{0.0};
    double rotation_rad{0.0};
    bool is_outlier{false};
  };
  /// Of each sample: T_base_camera T_camera_target against T_base_tool T_tool_target. Also there when the samples
  /// disagree or the residuals are too big, to show which are to blame.
  std::vector<Residual> residuals;
  int num_used{0};  ///< samples that are no outliers; what follows is over those
  double rms_m{0.0};
  double rms_rad{0.0};
  /// Of each sample against the answer of all others: how well a place is predicted where nothing was measured.
  double leave_one_out_rms_m{0.0};
  double leave_one_out_rms_rad{0.0};
  /// Residuals as multiples of what the covariances promise; 1 is as promised. What it is beyond 1 is in `covariance`.
  double noise_factor{1.0};
  /// By how much the deviations are larger because successive samples depend on each other, as those of one place may;
  /// `covariance` has it in. Errors alike over more than a tenth of the samples do not show.
  double dependence_factor{1.0};

  bool isGood() const { return failure == HandEyeFailure::kNone; }
};

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6x12d = Eigen::Matrix<double, 6, 12>;

/// What the sample's T_camera_target lacks to the one that follows from both poses, (translation, rotation) along the
/// camera's axes, as the sample's covariance. `jacobian`: by T_base_camera's translation and rotation along the base's
/// axes, then T_tool_target's along the tool's; may be null.
Vector6d handEyeResidual(const HandEyeSample& sample, const Eigen::Isometry3d& T_base_camera,
                         const Eigen::Isometry3d& T_tool_target, Matrix6x12d* jacobian);

/// Closed forms (cv::calibrateHandEye) of all samples and of triples; the one that most samples agree with is the
/// start. Then least squares over both unknown poses, weighted by the covariances, without outliers. Throws
/// std::invalid_argument for a bad config, or a sample that is not finite, not rigid or whose covariance is not
/// positive definite.
HandEyeResult solveHandEye(const std::vector<HandEyeSample>& samples, const HandEyeConfig& config);

}  // namespace brick_detection
