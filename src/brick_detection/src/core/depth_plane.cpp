// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/depth_plane.h"

#include <algorithm>
#include <cmath>
#include <random>

#include <Eigen/Dense>

#include "bearing_grid.h"
#include "image_check.h"
#include "rotation.h"

namespace brick_detection {
namespace {

// More samples cost time and gain nothing: the systematic part is larger than the noise of their mean.
constexpr double kMaxSamples = 600.0;
// Three of 60 % inliers are all inliers in one of five draws: 60 draws all miss once in a million.
constexpr int kDraws = 60;
constexpr double kInlierSigmas = 3.0;
constexpr int kMaxRefits = 10;
constexpr double kCurvedChi2 = 16.3;        // three degrees of freedom, 99.9 %
constexpr double kCurvedSystematics = 2.0;  // sag that a depth camera's own error may have, in units of systematic_m

/// A pixel that holds a depth.
struct Sample {
  Eigen::Vector3d direction;  // bearing and 1
  double inverse_depth;       // [1/m]
};

using Quad = std::array<Eigen::Vector2d, 4>;

/// Where the diagonals meet: where a square's middle is seen. Nothing unless the quadrangle is convex.
std::optional<Eigen::Vector2d> middleOf(const Quad& quad) {
  double sign = 0.0;
  for (std::size_t i = 0; i < 4; ++i) {
    const double turn = cross(quad[(i + 1) % 4] - quad[i], quad[(i + 2) % 4] - quad[(i + 1) % 4]);
    if (!std::isfinite(turn) || turn == 0.0 || turn * sign < 0.0) return std::nullopt;
    sign = turn;
  }
  const Eigen::Vector2d diagonal = quad[2] - quad[0];
  const Eigen::Vector2d other = quad[3] - quad[1];
  const double along = cross(quad[1] - quad[0], other) / cross(diagonal, other);
  return quad[0] + along * diagonal;
}

bool isInside(const Quad& quad, const Eigen::Vector2d& pixel) {
  bool has_left = false;
  bool has_right = false;
  for (std::size_t i = 0; i < 4; ++i) {
    const double side = cross(quad[(i + 1) % 4] - quad[i], pixel - quad[i]);
    has_left = has_left || side > 0.0;
    has_right = has_right || side < 0.0;
  }
  return !(has_left && has_right);
}

/// The noise that a sample may show, systematic part included [1/m].
double tolerance(const Sample& sample, const DepthPlaneConfig& config) {
  return kInlierSigmas * std::hypot(config.inverse_depth_std, config.systematic_m * sample.inverse_depth);
}

std::vector<Sample> inliersOf(const std::vector<Sample>& samples, const Eigen::Vector3d& affine,
                              const DepthPlaneConfig& config) {
  std::vector<Sample> inliers;
  for (const Sample& sample : samples) {
    if (std::abs(sample.direction.dot(affine) - sample.inverse_depth) <= tolerance(sample, config)) {
      inliers.push_back(sample);
    }
  }
  return inliers;
}

/// Least squares, about the samples' middle for the numbers' sake. `information`: of the result, for noise of 1.
std::optional<Eigen::Vector3d> fitAffine(const std::vector<Sample>& samples, Eigen::Matrix3d* information) {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const Sample& sample : samples) mean += sample.direction.head<2>();
  mean /= static_cast<double>(samples.size());
  Eigen::Matrix3d sums = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const Sample& sample : samples) {
    const Eigen::Vector3d row(sample.direction.x() - mean.x(), sample.direction.y() - mean.y(), 1.0);
    sums += row * row.transpose();
    right += row * sample.inverse_depth;
  }
  const Eigen::LDLT<Eigen::Matrix3d> factor(sums);
  // All samples on one line of the image leave the plane open.
  if (factor.info() != Eigen::Success || !(sums.topLeftCorner<2, 2>().determinant() > 1e-6 * sums(0, 0) * sums(1, 1))) {
    return std::nullopt;
  }
  const Eigen::Vector3d about_mean = factor.solve(right);
  Eigen::Matrix3d shift = Eigen::Matrix3d::Identity();  // about_mean = shift * affine
  shift.row(2) << mean.x(), mean.y(), 1.0;
  *information = shift.transpose() * sums * shift;
  return Eigen::Vector3d(about_mean.x(), about_mean.y(), about_mean.z() - about_mean.head<2>().dot(mean));
}

/// The plane that most samples lie on. Draws are the same for the same samples.
Eigen::Vector3d drawAffine(const std::vector<Sample>& samples, const DepthPlaneConfig& config) {
  std::minstd_rand engine(1);
  std::uniform_int_distribution<std::size_t> draw(0, samples.size() - 1);
  Eigen::Vector3d best = Eigen::Vector3d::Zero();
  double best_score = -1.0;
  for (int i = 0; i < kDraws; ++i) {
    Eigen::Matrix3d directions;
    Eigen::Vector3d inverse_depths;
    for (int row = 0; row < 3; ++row) {
      const Sample& sample = samples[draw(engine)];
      directions.row(row) = sample.direction.transpose();
      inverse_depths(row) = sample.inverse_depth;
    }
    const Eigen::Vector3d affine = directions.partialPivLu().solve(inverse_depths);
    if (!affine.allFinite()) continue;
    // Nearer inliers count more (MSAC, Torr and Zisserman 2000): a plain count does not tell good draws apart.
    double score = 0.0;
    for (const Sample& sample : samples) {
      const double off = (sample.direction.dot(affine) - sample.inverse_depth) / tolerance(sample, config);
      score += std::max(0.0, 1.0 - off * off);
    }
    if (score > best_score) {
      best_score = score;
      best = affine;
    }
  }
  return best;
}

/// Whether the residuals follow a surface of second order rather than noise.
bool isCurved(const std::vector<Sample>& inliers, const Eigen::Vector3d& affine, double noise_std, double inflation,
              const DepthPlaneConfig& config) {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  Eigen::Vector2d spread = Eigen::Vector2d::Zero();
  for (const Sample& sample : inliers) mean += sample.direction.head<2>();
  mean /= static_cast<double>(inliers.size());
  for (const Sample& sample : inliers) spread += (sample.direction.head<2>() - mean).cwiseAbs2();
  spread = (spread / static_cast<double>(inliers.size())).cwiseSqrt();
  Eigen::Matrix<double, 6, 6> sums = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::Matrix<double, 6, 1> right = Eigen::Matrix<double, 6, 1>::Zero();
  double mean_inverse_depth = 0.0;
  for (const Sample& sample : inliers) {
    const Eigen::Vector2d at = (sample.direction.head<2>() - mean).cwiseQuotient(spread);
    Eigen::Matrix<double, 6, 1> row;
    row << 1.0, at.x(), at.y(), at.x() * at.x(), at.x() * at.y(), at.y() * at.y();
    sums += row * row.transpose();
    right += row * (sample.inverse_depth - sample.direction.dot(affine));
    mean_inverse_depth += sample.inverse_depth / static_cast<double>(inliers.size());
  }
  // The residuals' squares that the second order takes away; the first order takes nothing, the plane being fitted.
  const double explained = right.dot(sums.ldlt().solve(right));
  const double sag_rms = std::sqrt(std::max(0.0, explained) / static_cast<double>(inliers.size()));  // [1/m]
  return explained > kCurvedChi2 * noise_std * noise_std * inflation &&
         sag_rms > kCurvedSystematics * config.systematic_m * mean_inverse_depth;
}

struct Samples {
  std::vector<Sample> with_depth;
  double num_pixels{0.0};  // looked at, with depth or without
  int stride_px{0};        // 0: nothing of the quadrangle is in the image
};

/// A grid of pixels of the quadrangle, grown about its middle.
Samples samplesOf(const cv::Mat& depth_m, const CameraModel& camera, const Quad& quad_px,
                  const Eigen::Vector2d& middle_px, double grow) {
  Samples samples;
  Quad grown;
  Eigen::AlignedBox2d box;
  for (std::size_t i = 0; i < 4; ++i) {
    grown[i] = middle_px + grow * (quad_px[i] - middle_px);
    box.extend(grown[i]);
  }
  box = box.intersection(
      Eigen::AlignedBox2d(Eigen::Vector2d::Zero(), Eigen::Vector2d(camera.width_px - 1.0, camera.height_px - 1.0)));
  if (box.isEmpty()) return samples;
  const double area_px = 0.5 * std::abs(cross(grown[2] - grown[0], grown[3] - grown[1]));
  samples.stride_px = std::max(1, static_cast<int>(std::ceil(std::sqrt(area_px / kMaxSamples))));

  const BearingGrid bearings(box, camera);
  for (int v = static_cast<int>(std::ceil(box.min().y())); v <= box.max().y(); v += samples.stride_px) {
    for (int u = static_cast<int>(std::ceil(box.min().x())); u <= box.max().x(); u += samples.stride_px) {
      const Eigen::Vector2d pixel(u, v);
      if (!isInside(grown, pixel)) continue;
      samples.num_pixels += 1.0;
      const double depth = depth_m.at<float>(v, u);
      if (!(depth > 0.0) || !std::isfinite(depth)) continue;
      const Eigen::Vector2d bearing = bearings.at(pixel);
      if (bearing.allFinite()) samples.with_depth.push_back({bearing.homogeneous(), 1.0 / depth});
    }
  }
  return samples;
}

struct AffineFit {
  Eigen::Vector3d affine{Eigen::Vector3d::Zero()};
  std::vector<Sample> inliers;
  Eigen::Matrix3d information{Eigen::Matrix3d::Identity()};  // of `affine`, for noise of 1
};

/// The plane of most samples, fitted to its inliers until these stay the same.
DepthPlaneFailure fitInliers(const std::vector<Sample>& samples, const DepthPlaneConfig& config, AffineFit* fit) {
  fit->affine = drawAffine(samples, config);
  const double least = std::max(config.min_inlier_share * static_cast<double>(samples.size()), 3.0);
  for (int i = 0; i < kMaxRefits; ++i) {
    const std::size_t num_before = fit->inliers.size();
    fit->inliers = inliersOf(samples, fit->affine, config);
    if (static_cast<double>(fit->inliers.size()) < least) return DepthPlaneFailure::kNotFlat;
    const std::optional<Eigen::Vector3d> fitted = fitAffine(fit->inliers, &fit->information);
    if (!fitted) return DepthPlaneFailure::kTooFewPixels;
    fit->affine = *fitted;
    if (fit->inliers.size() == num_before) break;
  }
  const bool is_enough = static_cast<double>(fit->inliers.size()) >= config.min_pixels;
  return is_enough ? DepthPlaneFailure::kNone : DepthPlaneFailure::kTooFewPixels;
}

/// The plane in space with its covariance; `middle`: where the ray of the quadrangle's middle meets it. `variance`: of an
/// inlier's inverse depth, times the number of inliers that count as one.
DepthPlane planeOf(const AffineFit& fit, const Eigen::Vector3d& middle, double variance,
                   const DepthPlaneConfig& config) {
  DepthPlane plane;
  // 1/z = affine . (x, y, 1) is n . p + d = 0 with affine = -n / d.
  plane.d_m = 1.0 / fit.affine.norm();
  plane.normal = -fit.affine * plane.d_m;
  plane.middle = middle;
  plane.axis_u = plane.normal.unitOrthogonal();
  plane.axis_v = plane.normal.cross(plane.axis_u);
  plane.num_pixels = static_cast<int>(fit.inliers.size());
  // First order in a change of affine: normal -d (I - n n^T) da, hence the tilts; depth of the middle -z^2 da . (x, y, 1),
  // which is d da . middle along the normal.
  Eigen::Matrix3d by_affine;
  by_affine.row(0) = plane.d_m * plane.axis_v.transpose();
  by_affine.row(1) = -plane.d_m * plane.axis_u.transpose();
  by_affine.row(2) = plane.d_m * plane.middle.transpose();
  const Eigen::Matrix3d noise = variance * fit.information.inverse();
  // The camera's offset is along its optical axis: systematic_m times the middle's depth, d / z of it along the normal.
  plane.shared_offset_m = config.systematic_m * plane.d_m;
  plane.covariance = by_affine * noise * by_affine.transpose();
  plane.covariance = (0.5 * (plane.covariance + plane.covariance.transpose())).eval();
  plane.covariance.diagonal() +=
      Eigen::Vector3d(config.systematic_rad * config.systematic_rad, config.systematic_rad * config.systematic_rad,
                      plane.shared_offset_m * plane.shared_offset_m);
  return plane;
}

}  // namespace

std::optional<DepthPlane> fitDepthPlane(const cv::Mat& depth_m, const CameraModel& camera, const Quad& quad_px,
                                        const DepthPlaneConfig& config, DepthPlaneFailure* failure) {
  const auto fail = [failure](DepthPlaneFailure reason) {
    if (failure) *failure = reason;
    return std::nullopt;
  };
  if (failure) *failure = DepthPlaneFailure::kNone;
  if (depth_m.empty()) return fail(DepthPlaneFailure::kNoDepth);
  requireImageOf(camera, "depth", depth_m, CV_32FC1, "CV_32FC1");
  const std::optional<Eigen::Vector2d> middle_px = middleOf(quad_px);
  if (!middle_px) return fail(DepthPlaneFailure::kTooFewPixels);

  const Samples samples = samplesOf(depth_m, camera, quad_px, *middle_px, config.grow);
  const auto num_samples = static_cast<double>(samples.with_depth.size());
  if (samples.stride_px == 0) return fail(DepthPlaneFailure::kTooFewPixels);
  if (samples.with_depth.empty()) return fail(DepthPlaneFailure::kNoDepth);
  if (num_samples < config.min_pixels || num_samples < config.min_coverage * samples.num_pixels) {
    return fail(DepthPlaneFailure::kTooFewPixels);
  }
  AffineFit fit;
  const DepthPlaneFailure reason = fitInliers(samples.with_depth, config, &fit);
  if (reason != DepthPlaneFailure::kNone) return fail(reason);

  double sum_squares = 0.0;    // of inverse depths
  double sum_squares_m = 0.0;  // along the rays
  for (const Sample& sample : fit.inliers) {
    const double off = sample.inverse_depth - sample.direction.dot(fit.affine);
    const double off_m = off / (sample.inverse_depth * sample.inverse_depth) * sample.direction.norm();
    sum_squares += off * off;
    sum_squares_m += off_m * off_m;
  }
  const auto num_inliers = static_cast<double>(fit.inliers.size());
  const double noise_std = std::max(config.inverse_depth_std, std::sqrt(sum_squares / num_inliers));
  // So many samples fall into one patch of like noise, and count as one.
  const double inflation = std::max(1.0, std::pow(config.correlation_px / samples.stride_px, 2));
  if (isCurved(fit.inliers, fit.affine, noise_std, inflation, config)) return fail(DepthPlaneFailure::kNotFlat);

  const Eigen::Vector3d direction = camera.bearing(*middle_px).homogeneous();
  const double inverse_depth = fit.affine.dot(direction);
  if (!(inverse_depth > 0.0) || !std::isfinite(inverse_depth)) return fail(DepthPlaneFailure::kNotFlat);
  DepthPlane plane = planeOf(fit, direction / inverse_depth, noise_std * noise_std * inflation, config);
  plane.rms_m = std::sqrt(sum_squares_m / num_inliers);
  return plane;
}

}  // namespace brick_detection
