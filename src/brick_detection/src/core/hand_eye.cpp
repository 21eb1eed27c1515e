// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/hand_eye.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <interactive_mapping_common/formatted.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>

#include "brick_detection/pose_refinement.h"
#include "rotation.h"

namespace brick_detection {
namespace {

using interactive_mapping::formatted;

using Matrix12d = Eigen::Matrix<double, 12, 12>;
using Vector12d = Eigen::Matrix<double, 12, 1>;

constexpr double kMedianChi2 = 5.348;  // of six degrees of freedom
constexpr int kPoseFreedom = 6;
constexpr int kUnknowns = 12;
// Starts of three samples. With two thirds of the samples good, so are 3 in 10 of the triples: 100 have them to spare.
constexpr int kMaxTriples = 100;

struct Poses {
  Eigen::Isometry3d T_base_camera{Eigen::Isometry3d::Identity()};
  Eigen::Isometry3d T_tool_target{Eigen::Isometry3d::Identity()};
};

/// d Log(exp(d) exp(r)) / dd at d = 0: inverse of the left Jacobian of SO(3) (Barfoot, State Estimation for Robotics, eq.
/// 7.77).
Eigen::Matrix3d inverseLeftJacobian(const Eigen::Vector3d& r) {
  const double angle = r.norm();
  const Eigen::Matrix3d K = skew(r);
  // The factor's series, where the closed form loses its digits; it leaves out angle^4 / 30240.
  const double factor = angle < 0.05
                            ? 1.0 / 12.0 + angle * angle / 720.0
                            : 1.0 / (angle * angle) - (1.0 + std::cos(angle)) / (2.0 * angle * std::sin(angle));
  return Eigen::Matrix3d::Identity() - 0.5 * K + factor * K * K;
}

void requireUsable(const std::vector<HandEyeSample>& samples) {
  const auto is_rigid = [](const Eigen::Isometry3d& T) {
    return T.matrix().allFinite() &&
           (T.linear() * T.linear().transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-6 &&
           T.linear().determinant() > 0.0;
  };
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const std::string name = "sample " + std::to_string(i);
    if (!is_rigid(samples[i].T_base_tool)) {
      throw std::invalid_argument(name + ": T_base_tool must be finite and a rigid motion");
    }
    if (!is_rigid(samples[i].T_camera_target)) {
      throw std::invalid_argument(name + ": T_camera_target must be finite and a rigid motion");
    }
    if (!samples[i].covariance.allFinite() ||
        Eigen::LLT<Matrix6d>(samples[i].covariance).info() != Eigen::ComputationInfo::Success) {
      throw std::invalid_argument(name + ": the covariance must be finite and positive definite");
    }
  }
}

/// How far the tool turns, at most, between two of the samples; and across the axis of that turn, between any two.
struct TurnSpread {
  double largest_rad{0.0};
  double across_rad{0.0};
};

TurnSpread turnSpread(const std::vector<HandEyeSample>& samples, const std::vector<char>& is_used) {
  std::vector<Eigen::Vector3d> turns;
  TurnSpread spread;
  Eigen::Vector3d axis = Eigen::Vector3d::UnitX();
  for (std::size_t i = 0; i < samples.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (!is_used[i] || !is_used[j]) continue;
      // Along the base's axes: a common axis of these leaves the camera free to slide along it.
      turns.push_back(rotationVector(samples[i].T_base_tool.linear() * samples[j].T_base_tool.linear().transpose()));
      if (turns.back().norm() > spread.largest_rad) {
        spread.largest_rad = turns.back().norm();
        axis = turns.back().normalized();
      }
    }
  }
  for (const Eigen::Vector3d& turn : turns) spread.across_rad = std::max(spread.across_rad, turn.cross(axis).norm());
  return spread;
}

/// Refusals for want of motion; true: fine.
bool isMotionEnough(const std::vector<HandEyeSample>& samples, const std::vector<char>& is_used,
                    const HandEyeConfig& config, HandEyeResult* result) {
  const TurnSpread spread = turnSpread(samples, is_used);
  if (spread.largest_rad < config.min_rotation_rad) {
    result->failure = HandEyeFailure::kTooLittleRotation;
    result->reason = formatted(
        "too little rotation: the tool turned by at most %.1f deg between two samples, at least %.1f deg are needed, "
        "about two axes. Tilt and turn the wrist between samples",
        kToDeg * spread.largest_rad, kToDeg * config.min_rotation_rad);
    return false;
  }
  if (spread.across_rad < config.min_rotation_rad) {
    result->failure = HandEyeFailure::kOneAxisOnly;
    result->reason = formatted(
        "rotation about one axis only: the tool turned by up to %.1f deg. Across that axis it turned by at most %.1f "
        "deg, at least %.1f deg are needed. Tilt the target about a second axis",
        kToDeg * spread.largest_rad, kToDeg * spread.across_rad, kToDeg * config.min_rotation_rad);
    return false;
  }
  return true;
}

class Solver {
 public:
  Solver(const std::vector<HandEyeSample>& samples, const HandEyeConfig& config) : samples_(samples), config_(config) {
    Matrix6d arm = Matrix6d::Zero();
    arm.diagonal() << Eigen::Vector3d::Constant(config.arm_std_m * config.arm_std_m),
        Eigen::Vector3d::Constant(config.arm_std_rad * config.arm_std_rad);
    for (const HandEyeSample& sample : samples) {
      information_.push_back((sample.covariance + arm).llt().solve(Matrix6d::Identity()));
    }
  }

  double chi2(std::size_t i, const Poses& poses) const {
    const Vector6d r = handEyeResidual(samples_[i], poses.T_base_camera, poses.T_tool_target, nullptr);
    return r.dot(information_[i] * r);
  }

  std::vector<double> chi2s(const Poses& poses) const {
    std::vector<double> result;
    for (std::size_t i = 0; i < samples_.size(); ++i) result.push_back(chi2(i, poses));
    return result;
  }

  /// Square of the factor by which the bulk of the samples is farther off than promised; at least 1.
  double variance(std::vector<double> chi2s) const {
    const auto middle = chi2s.begin() + static_cast<std::ptrdiff_t>(chi2s.size() / 2);
    std::nth_element(chi2s.begin(), middle, chi2s.end());
    const double count = kPoseFreedom * static_cast<double>(chi2s.size());
    // The fit takes its share of the noise away.
    return std::max(1.0, *middle / kMedianChi2 * count / (count - kUnknowns));
  }

  /// The start that most samples agree with: outliers, however far, weigh alike.
  Poses start() const {
    std::vector<std::size_t> all(samples_.size());
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
    std::vector<Poses> candidates;
    closedForm(all, cv::CALIB_HAND_EYE_PARK, &candidates);
    closedForm(all, cv::CALIB_HAND_EYE_DANIILIDIS, &candidates);
    const std::size_t n = samples_.size();
    const std::size_t num_triples = n * (n - 1) * (n - 2) / 6;
    const std::size_t stride = num_triples / kMaxTriples + 1;
    std::size_t index = 0;
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = i + 1; j < n; ++j) {
        for (std::size_t k = j + 1; k < n; ++k, ++index) {
          if (index % stride == 0) closedForm({i, j, k}, cv::CALIB_HAND_EYE_PARK, &candidates);
        }
      }
    }
    if (candidates.empty()) return {};
    // The median residual, as in least median of squares (Rousseeuw 1984): bounded however bad the worst half is, and
    // needs no scale, of which a start knows nothing yet.
    double best = std::numeric_limits<double>::infinity();
    Poses result;
    for (const Poses& poses : candidates) {
      std::vector<double> values = chi2s(poses);
      const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
      std::nth_element(values.begin(), middle, values.end());
      if (*middle < best) {
        best = *middle;
        result = poses;
      }
    }
    return result;
  }

  /// Levenberg-Marquardt with fixed weights; a weight of zero leaves a sample out. `normal`: of the unweighted unknowns.
  /// Not by Ceres: `normal` is wanted, too, and one calibration takes 73 ms, with Ceres 63 ms and 25 more packages.
  Poses refine(Poses poses, const std::vector<double>& weights, Matrix12d* normal) const {
    double damping = 1e-6;
    double cost = costOf(poses, weights);
    for (int i = 0; i < 100; ++i) {
      Matrix12d H = Matrix12d::Zero();
      Vector12d g = Vector12d::Zero();
      for (std::size_t k = 0; k < samples_.size(); ++k) {
        if (weights[k] == 0.0) continue;
        Matrix6x12d J;
        const Vector6d r = handEyeResidual(samples_[k], poses.T_base_camera, poses.T_tool_target, &J);
        H += weights[k] * J.transpose() * information_[k] * J;
        g += weights[k] * J.transpose() * (information_[k] * r);
      }
      if (normal != nullptr) *normal = H;
      bool is_better = false;
      while (!is_better && damping < 1e12) {
        Matrix12d damped = H;
        damped.diagonal() *= 1.0 + damping;
        const Vector12d step = -damped.ldlt().solve(g);
        // What the step could gain is lost in rounding: at the minimum to some 1e-7 of a standard deviation.
        if (-step.dot(g) <= 1e-14 * cost) return poses;
        const Poses next{moved(poses.T_base_camera, step.head<6>()), moved(poses.T_tool_target, step.tail<6>())};
        const double next_cost = costOf(next, weights);
        is_better = next_cost < cost;
        if (is_better) {
          poses = next;
          cost = next_cost;
          damping = std::max(1e-15, damping * 0.1);
        } else {
          damping *= 10.0;
        }
      }
      if (!is_better) break;
    }
    return poses;
  }

  /// Of half a sample's chi-square.
  Vector12d gradient(std::size_t i, const Poses& poses) const {
    Matrix6x12d J;
    const Vector6d r = handEyeResidual(samples_[i], poses.T_base_camera, poses.T_tool_target, &J);
    return J.transpose() * (information_[i] * r);
  }

  const std::vector<HandEyeSample>& samples() const { return samples_; }

 private:
  double costOf(const Poses& poses, const std::vector<double>& weights) const {
    double cost = 0.0;
    for (std::size_t i = 0; i < samples_.size(); ++i) {
      if (weights[i] > 0.0) cost += weights[i] * chi2(i, poses);
    }
    return cost;
  }

  /// Appends nothing where the closed form has no answer, as for a triple that turns about one axis.
  void closedForm(const std::vector<std::size_t>& of, cv::HandEyeCalibrationMethod method,
                  std::vector<Poses>* candidates) const {
    std::vector<cv::Mat> R_tool_base;
    std::vector<cv::Mat> t_tool_base;
    std::vector<cv::Mat> R_camera_target;
    std::vector<cv::Mat> t_camera_target;
    for (const std::size_t i : of) {
      // OpenCV's problem is a camera on the tool. Seen from the tool it is the base that moves and carries a camera: its
      // "gripper" is our base, its "base" our tool.
      const Eigen::Isometry3d T_tool_base = samples_[i].T_base_tool.inverse();
      cv::Mat R;
      cv::Mat t;
      cv::eigen2cv(Eigen::Matrix3d(T_tool_base.linear()), R);
      R_tool_base.push_back(R.clone());
      cv::eigen2cv(Eigen::Vector3d(T_tool_base.translation()), t);
      t_tool_base.push_back(t.clone());
      cv::eigen2cv(Eigen::Matrix3d(samples_[i].T_camera_target.linear()), R);
      R_camera_target.push_back(R.clone());
      cv::eigen2cv(Eigen::Vector3d(samples_[i].T_camera_target.translation()), t);
      t_camera_target.push_back(t.clone());
    }
    cv::Mat R_base_camera;
    cv::Mat t_base_camera;
    try {
      cv::calibrateHandEye(R_tool_base, t_tool_base, R_camera_target, t_camera_target, R_base_camera, t_base_camera,
                           method);
    } catch (const cv::Exception&) {
      return;
    }
    if (R_base_camera.empty() || !cv::checkRange(R_base_camera) || !cv::checkRange(t_base_camera)) return;
    Eigen::Matrix3d R;
    Eigen::Vector3d t;
    cv::cv2eigen(R_base_camera, R);
    cv::cv2eigen(t_base_camera, t);
    if (std::abs(R.determinant() - 1.0) > 0.1) return;
    Poses poses;
    poses.T_base_camera.linear() = Eigen::Quaterniond(R).normalized().toRotationMatrix();
    poses.T_base_camera.translation() = t;
    // T_tool_target: the mean over the samples. Of rotations: the quaternion with the largest eigenvalue (Markley et
    // al. 2007).
    Eigen::Matrix4d quaternions = Eigen::Matrix4d::Zero();
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const std::size_t i : of) {
      const Eigen::Isometry3d T_tool_target =
          samples_[i].T_base_tool.inverse() * poses.T_base_camera * samples_[i].T_camera_target;
      const Eigen::Vector4d q = Eigen::Quaterniond(T_tool_target.linear()).coeffs();
      quaternions += q * q.transpose();
      sum += T_tool_target.translation();
    }
    const Eigen::Vector4d mean = Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d>(quaternions).eigenvectors().col(3);
    poses.T_tool_target.linear() = Eigen::Quaterniond(mean).toRotationMatrix();
    poses.T_tool_target.translation() = sum / static_cast<double>(of.size());
    candidates->push_back(poses);
  }

  const std::vector<HandEyeSample>& samples_;
  HandEyeConfig config_;
  std::vector<Matrix6d> information_;
};

/// By how much the answer's deviation grows because successive samples depend on each other: the covariance by the sums
/// over blocks of samples (the sandwich of Liang and Zeger 1986) against that of independent samples; at least 1.
double dependenceFactor(const Solver& solver, const Poses& poses, const std::vector<char>& is_used,
                        const Matrix12d& inverse, const Matrix6d& covariance) {
  constexpr std::size_t kMostBlocks = 10;
  constexpr std::size_t kLeastBlocks = 4;
  std::vector<std::size_t> used;
  for (std::size_t k = 0; k < is_used.size(); ++k) {
    if (is_used[k] != 0) used.push_back(k);
  }
  const std::size_t num_blocks = std::clamp(used.size() / 3, kLeastBlocks, kMostBlocks);
  Matrix12d sums = Matrix12d::Zero();
  for (std::size_t block = 0; block < num_blocks; ++block) {
    Vector12d gradient = Vector12d::Zero();
    for (std::size_t i = block * used.size() / num_blocks; i < (block + 1) * used.size() / num_blocks; ++i) {
      gradient += solver.gradient(used[i], poses);
    }
    sums += gradient * gradient.transpose();
  }
  // The fit takes its share of the residuals away, and one sum of all: usual corrections.
  const double freedom = kPoseFreedom * static_cast<double>(used.size());
  const double correction =
      static_cast<double>(num_blocks) / static_cast<double>(num_blocks - 1) * (freedom - 1.0) / (freedom - kUnknowns);
  const Matrix6d of_blocks = (correction * inverse * sums * inverse).topLeftCorner<6, 6>();
  return std::sqrt(std::max(1.0, covariance.llt().solve(of_blocks).trace() / kPoseFreedom));
}

HandEyeResult::Residual residualOf(const HandEyeSample& sample, const Poses& poses) {
  const Eigen::Isometry3d difference =
      (poses.T_base_camera * sample.T_camera_target).inverse() * sample.T_base_tool * poses.T_tool_target;
  HandEyeResult::Residual residual;
  residual.translation_m = difference.translation().norm();
  residual.rotation_rad = rotationVector(difference.linear()).norm();
  return residual;
}

/// The poses that most samples agree with, and which those are.
struct Agreement {
  Poses poses;
  std::vector<char> is_used;
  Matrix12d normal;  // of the unknowns
};

Agreement agreementOf(const Solver& solver, double outlier_chi2) {
  const std::size_t num_samples = solver.samples().size();
  Agreement agreement;
  Poses& poses = agreement.poses;
  poses = solver.start();
  std::vector<double> weights(num_samples, 1.0);
  // The start is of three samples and as noisy; Geman-McClure weights bring all that agree in, far ones stay out.
  for (int i = 0; i < 10; ++i) {
    const std::vector<double> chi2s = solver.chi2s(poses);
    const double limit = outlier_chi2 * solver.variance(chi2s);
    for (std::size_t k = 0; k < num_samples; ++k) weights[k] = std::pow(1.0 + chi2s[k] / limit, -2.0);
    poses = solver.refine(poses, weights, nullptr);
  }
  // Then each is in or out, until that settles.
  for (int i = 0; i < 20; ++i) {
    const std::vector<double> chi2s = solver.chi2s(poses);
    const double limit = outlier_chi2 * solver.variance(chi2s);
    std::vector<char> is_near(num_samples);
    for (std::size_t k = 0; k < num_samples; ++k) is_near[k] = chi2s[k] <= limit ? 1 : 0;
    if (i > 0 && is_near == agreement.is_used) break;
    agreement.is_used = is_near;
    for (std::size_t k = 0; k < num_samples; ++k) weights[k] = is_near[k];
    poses = solver.refine(poses, weights, &agreement.normal);
  }
  return agreement;
}

/// Root mean squares, outliers left out.
void setRms(const std::vector<HandEyeResult::Residual>& residuals, double* rms_m, double* rms_rad) {
  double count = 0.0;
  double sum_m2 = 0.0;
  double sum_rad2 = 0.0;
  for (const HandEyeResult::Residual& residual : residuals) {
    if (residual.is_outlier) continue;
    count += 1.0;
    sum_m2 += residual.translation_m * residual.translation_m;
    sum_rad2 += residual.rotation_rad * residual.rotation_rad;
  }
  *rms_m = std::sqrt(sum_m2 / count);
  *rms_rad = std::sqrt(sum_rad2 / count);
}

/// The poses and each sample's residual. Returns the sum of the used ones' chi-squares.
double addResiduals(const Solver& solver, const Agreement& agreement, HandEyeResult* result) {
  double chi2_sum = 0.0;
  for (std::size_t k = 0; k < agreement.is_used.size(); ++k) {
    HandEyeResult::Residual residual = residualOf(solver.samples()[k], agreement.poses);
    residual.is_outlier = agreement.is_used[k] == 0;
    result->residuals.push_back(residual);
    if (residual.is_outlier) continue;
    ++result->num_used;
    chi2_sum += solver.chi2(k, agreement.poses);
  }
  result->T_base_camera = agreement.poses.T_base_camera;
  result->T_tool_target = agreement.poses.T_tool_target;
  return chi2_sum;
}

/// Refusals by the residuals; true: fine.
bool isAgreementEnough(const std::vector<HandEyeSample>& samples, const Agreement& agreement,
                       const HandEyeConfig& config, HandEyeResult* result) {
  if (result->num_used < config.min_samples) {
    result->failure = HandEyeFailure::kSamplesDisagree;
    result->reason = formatted(
        "the samples disagree: only %d of %zu agree with each other, at least %d are needed. Is the target loose on "
        "the tool, was the base moved, is the tag's size right?",
        result->num_used, samples.size(), config.min_samples);
    return false;
  }
  setRms(result->residuals, &result->rms_m, &result->rms_rad);
  if (!isMotionEnough(samples, agreement.is_used, config, result)) {
    result->reason +=
        formatted(" (%zu outliers were left out)", samples.size() - static_cast<std::size_t>(result->num_used));
    return false;
  }
  if (result->rms_m <= config.max_residual_m && result->rms_rad <= config.max_residual_rad) return true;
  result->failure = HandEyeFailure::kResidualTooBig;
  result->reason = formatted(
      "the residuals are too big: %.1f mm and %.2f deg, at most %.1f mm and %.2f deg are allowed. Is the target loose "
      "on the tool, is the arm at rest, are the camera's intrinsics and the tag's size right?",
      1e3 * result->rms_m, kToDeg * result->rms_rad, 1e3 * config.max_residual_m, kToDeg * config.max_residual_rad);
  return false;
}

/// Of each used sample against the poses of the others.
void leaveOneOut(const Solver& solver, const Agreement& agreement, HandEyeResult* result) {
  std::vector<HandEyeResult::Residual> residuals;
  std::vector<double> weights(agreement.is_used.begin(), agreement.is_used.end());
  for (std::size_t k = 0; k < weights.size(); ++k) {
    if (agreement.is_used[k] == 0) continue;
    weights[k] = 0.0;
    residuals.push_back(residualOf(solver.samples()[k], solver.refine(agreement.poses, weights, nullptr)));
    weights[k] = 1.0;
  }
  setRms(residuals, &result->leave_one_out_rms_m, &result->leave_one_out_rms_rad);
}

}  // namespace

Vector6d handEyeResidual(const HandEyeSample& sample, const Eigen::Isometry3d& T_base_camera,
                         const Eigen::Isometry3d& T_tool_target, Matrix6x12d* jacobian) {
  const Eigen::Matrix3d R_camera_base = T_base_camera.linear().transpose();
  const Eigen::Matrix3d R_camera_tool = R_camera_base * sample.T_base_tool.linear();
  const Eigen::Vector3d from_camera_base =
      sample.T_base_tool * T_tool_target.translation() - T_base_camera.translation();
  Vector6d residual;
  residual.head<3>() = R_camera_base * from_camera_base - sample.T_camera_target.translation();
  const Eigen::Vector3d r =
      rotationVector(R_camera_tool * T_tool_target.linear() * sample.T_camera_target.linear().transpose());
  residual.tail<3>() = r;
  if (jacobian != nullptr) {
    const Eigen::Matrix3d J = inverseLeftJacobian(r);
    jacobian->setZero();
    jacobian->block<3, 3>(0, 0) = -R_camera_base;
    jacobian->block<3, 3>(0, 3) = R_camera_base * skew(from_camera_base);
    jacobian->block<3, 3>(0, 6) = R_camera_tool;
    jacobian->block<3, 3>(3, 3) = -J * R_camera_base;
    jacobian->block<3, 3>(3, 9) = J * R_camera_tool;
  }
  return residual;
}

HandEyeResult solveHandEye(const std::vector<HandEyeSample>& samples, const HandEyeConfig& config) {
  interactive_mapping::requireValid("impossible hand-eye parameters:", config);
  requireUsable(samples);
  HandEyeResult result;
  const auto min_samples = static_cast<std::size_t>(config.min_samples);
  if (samples.size() < min_samples) {
    result.failure = HandEyeFailure::kTooFewSamples;
    result.reason = formatted("too few samples: %zu, at least %zu are needed: take more", samples.size(), min_samples);
    return result;
  }
  if (!isMotionEnough(samples, std::vector<char>(samples.size(), 1), config, &result)) return result;

  const Solver solver(samples, config);
  const Agreement agreement = agreementOf(solver, config.outlier_chi2);
  const double chi2_sum = addResiduals(solver, agreement, &result);
  if (!isAgreementEnough(samples, agreement, config, &result)) return result;

  const double freedom = kPoseFreedom * result.num_used - kUnknowns;
  result.noise_factor = std::sqrt(chi2_sum / freedom);
  const Matrix12d inverse = agreement.normal.ldlt().solve(Matrix12d::Identity());
  result.covariance = std::max(1.0, chi2_sum / freedom) * inverse.topLeftCorner<6, 6>();

  result.dependence_factor = dependenceFactor(solver, agreement.poses, agreement.is_used, inverse, result.covariance);
  result.covariance *= result.dependence_factor * result.dependence_factor;
  leaveOneOut(solver, agreement, &result);
  return result;
}

}  // namespace brick_detection
