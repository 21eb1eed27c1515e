// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/point_update.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace gpis_mapping {
namespace {

// A surface seen at less than this cosine of incidence tells nothing about its position across itself (81 degrees).
constexpr double kMinCosine = 0.15;
// Bound on how much a grazing look widens the tolerance: what it sees past by a few centimetres is gone.
constexpr double kMaxObliqueCosine = 0.5;
constexpr int kMaxAmbiguousLooks = 2;  // a hole that may be wall deletes at the second look running
constexpr int kMaxMisses = 4;          // consecutive looks that see past a point within the reach of a depth edge
// Of the least tolerance: so far before a face of another direction, look after look, a point belongs to nothing.
constexpr double kStrayShare = 0.5;
constexpr double kMinNormalVariance = 4e-4;  // 1.1 degrees: normals do not get better than the calibration
constexpr double kLateralPx = 0.3;           // standard deviation of where in its pixel a depth was measured
// Share of a depth error's variance that neighbouring pixels have in common (disparity windows, quantisation).
constexpr double kCorrelatedShare = 0.15;

}  // namespace

Frame::Frame(const GpisConfig& config, std::shared_ptr<const ClassifiedFrame> pixels,
             std::shared_ptr<const FrameRegressor> regressor, const Eigen::Isometry3d& T_map_camera, float stamp_s,
             int num_threads)
    : config_(config),
      pixels_(std::move(pixels)),
      map_(std::move(regressor), pixels_, config.sensor.noise, num_threads),
      T_map_camera_(T_map_camera),
      T_camera_map_(T_map_camera.inverse()),
      stamp_s_(stamp_s) {}

double Frame::correlatedVariance(double z_m) const {
  const double sigma = config_.sensor.noise.sigma(z_m);
  return kCorrelatedShare * sigma * sigma;
}

std::optional<SurfaceMeasurement> Frame::measure(double u, double v) const {
  const CameraModel& camera = this->camera();
  const Eigen::Vector3d ray((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
  const FrameMap::Inference inferred = map_.infer(u, v);
  SurfaceMeasurement result;
  double along_ray_variance = 0.0;
  if (inferred.smooth) {
    if (inferred.inverse_range <= 0.0) return std::nullopt;
    result.point_camera = ray / (ray.norm() * inferred.inverse_range);
    result.normal_camera = map_.trendNormal(u, v);
    along_ray_variance = std::pow(inferred.sigma / (inferred.inverse_range * inferred.inverse_range), 2);
    // Slope of a least-squares plane over a square of w x w pixels: variance 12 s^2 / w^4 per pixel of baseline.
    const double z = result.point_camera.z();
    const double sigma_w = config_.sensor.noise.sigma(z) / (z * z);
    result.normal_variance = 12.0 * std::pow(sigma_w * camera.fx * z, 2) / std::pow(map_.regressor().window(), 4);
  } else {
    const int pixel_u = static_cast<int>(u + 0.5);
    const int pixel_v = static_cast<int>(v + 0.5);
    LocalPlane plane;
    if (!fitLocalPlane(*pixels_, camera, config_.sensor.noise, pixel_u, pixel_v, config_.surface.spacing_m, &plane)) {
      return std::nullopt;
    }
    const Eigen::Vector3d n = plane.normal_camera.cast<double>();
    const double denominator = n.dot(ray);
    if (std::abs(denominator) < 0.05 * ray.norm()) return std::nullopt;  // the ray grazes the plane
    result.point_camera = ray * (n.dot(plane.point_camera) / denominator);
    if (!(result.point_camera.z() > 0.0)) return std::nullopt;
    result.normal_camera = plane.normal_camera;
    along_ray_variance = std::pow(plane.depth_std_m * ray.norm(), 2);
    result.normal_variance = plane.normal_var;
  }
  const double range = result.point_camera.norm();
  result.cosine = -result.normal_camera.cast<double>().dot(result.point_camera) / range;
  const double cosine2 = result.cosine * result.cosine;
  result.variance_m2 = (along_ray_variance + correlatedVariance(result.point_camera.z())) * cosine2 +
                       std::pow(kLateralPx * range / camera.fx, 2) * std::max(0.0, 1.0 - cosine2) +
                       config_.sensor.pose_std_m * config_.sensor.pose_std_m;
  result.normal_variance = std::max(kMinNormalVariance, result.normal_variance);
  return result;
}

PointOutcome Frame::apply(SurfacePoint* point) const {
  const CameraModel& camera = this->camera();
  const Eigen::Vector3d p = T_camera_map_ * point->position_map;
  if (p.z() < 0.05) return PointOutcome::kNothing;
  const double u = camera.fx * p.x() / p.z() + camera.cx;
  const double v = camera.fy * p.y() / p.z() + camera.cy;
  if (!(u >= 0.0 && v >= 0.0 && u <= camera.width - 1.0 && v <= camera.height - 1.0)) return PointOutcome::kNothing;
  const int pixel_u = static_cast<int>(u + 0.5);
  const int pixel_v = static_cast<int>(v + 0.5);
  const std::size_t pixel = pixels_->index(pixel_u, pixel_v);
  const PixelKind kind = pixels_->kind[pixel];
  const Block block = pixels_->blocked[pixel];
  if (block == Block::kNoInformation) return PointOutcome::kNothing;

  const double range = p.norm();
  const double inverse_range = 1.0 / range;
  const double per_metre = inverse_range * inverse_range;  // change of inverse range per metre of range
  const Eigen::Vector3f n = (T_camera_map_.linear() * point->normal_map.cast<double>()).cast<float>();
  const double cosine = -n.cast<double>().dot(p) / range;
  const double across = std::max(kMaxObliqueCosine, std::abs(cosine));
  const FrameMap::Inference seen = map_.infer(u, v);
  const double pose_variance = config_.sensor.pose_std_m * config_.sensor.pose_std_m;
  const double own_variance = (point->variance_m2 + pose_variance) / (across * across) + correlatedVariance(p.z());
  const double sigma = std::sqrt(seen.sigma * seen.sigma + own_variance * per_metre * per_metre);
  const double tolerance =
      std::max(config_.dynamic.tolerance_sigmas * sigma, config_.dynamic.min_tolerance_m / across * per_metre);

  if (block == Block::kNarrow) {
    // The frame's GP does not count beside pixels without information. But a shadow is at the same place in every look
    // from here, and it would keep a piece of a removed object: what its own pixel sees past, or all pixels round a
    // dropout, shares the fate of its neighbours.
    const double seen_at =
        kind == PixelKind::kNoInformation ? map_.nearestAround(pixel_u, pixel_v) : pixels_->inverse_range[pixel];
    const bool is_past = kind != PixelKind::kAmbiguous && inverse_range - seen_at >= tolerance;
    return config_.dynamic.enabled && is_past ? PointOutcome::kDoubtful : PointOutcome::kNothing;
  }
  // Eq 7. Near a depth edge the mean lies between the surfaces: seen past is only what is past the raw depths too.
  const double delta = inverse_range - seen.inverse_range;
  const double past =
      seen.smooth ? delta : std::min<double>(delta, inverse_range - map_.nearestAround(pixel_u, pixel_v));
  if (past >= tolerance) {
    if (!config_.dynamic.enabled) return PointOutcome::kNothing;
    if (kind != PixelKind::kAmbiguous) return PointOutcome::kDeleted;
    return ++point->num_misses >= kMaxAmbiguousLooks ? PointOutcome::kDeleted : PointOutcome::kNothing;
  }
  // Seen past by its own pixel, spared by a nearer one beside it: it shares the fate of its neighbours, and goes when
  // look after look finds it there without ever confirming it.
  if (inverse_range - pixels_->inverse_range[pixel] >= tolerance) {
    if (config_.dynamic.enabled && ++point->num_misses >= kMaxMisses) return PointOutcome::kDeleted;
    return PointOutcome::kDoubtful;
  }
  if (delta <= -tolerance && seen.smooth) return PointOutcome::kOccluded;
  if (kind != PixelKind::kSurface) return PointOutcome::kNothing;
  if (cosine < kMinCosine && std::abs(delta) >= tolerance) return PointOutcome::kNothing;
  const std::optional<SurfaceMeasurement> measurement = measure(u, v);
  const bool is_near = measurement && std::abs(1.0 / measurement->point_camera.norm() - inverse_range) < tolerance;
  if (is_near && config_.dynamic.enabled && isStray(*measurement, p, n)) {
    return ++point->num_misses >= kMaxMisses ? PointOutcome::kDeleted : PointOutcome::kDoubtful;
  }
  // A face turned away is hidden by its own object. Within the tolerance of what is seen it is a rim, or the foot of an
  // object that is gone: the rest of the face knows.
  if (cosine < kMinCosine) return cosine < -kMinCosine ? PointOutcome::kDoubtful : PointOutcome::kNothing;
  return is_near ? fuse(*measurement, p, point) : PointOutcome::kNothing;
}

/// A rim lies on what is seen there of another face. What hangs before it belongs to nothing, and the face would confirm
/// it for ever, or its own normal hide it.
bool Frame::isStray(const SurfaceMeasurement& seen, const Eigen::Vector3d& p_camera,
                    const Eigen::Vector3f& normal_camera) const {
  if (seen.normal_camera.dot(normal_camera) > kSameFaceCosine) return false;
  const double before_m = seen.normal_camera.cast<double>().dot(p_camera - seen.point_camera);
  return before_m > kStrayShare * config_.dynamic.min_tolerance_m;
}

PointOutcome Frame::fuse(const SurfaceMeasurement& seen, const Eigen::Vector3d& p_camera, SurfacePoint* point) const {
  const Eigen::Vector3f seen_normal = (T_map_camera_.linear() * seen.normal_camera.cast<double>()).cast<float>();
  const float agreement = seen_normal.dot(point->normal_map);
  if (agreement < 0.2f) return PointOutcome::kDoubtful;  // another face, seen through the tolerance of this one
  const Eigen::Vector3d n = point->normal_map.cast<double>();
  const double offset = n.dot(T_map_camera_.linear() * (seen.point_camera - p_camera));
  const double gain = point->variance_m2 / (point->variance_m2 + seen.variance_m2);
  const double floor_variance = config_.surface.min_noise_std_m * config_.surface.min_noise_std_m;
  point->position_map += gain * offset * n;
  point->variance_m2 = static_cast<float>(std::max(floor_variance, point->variance_m2 * (1.0 - gain)));
  if (agreement > kSameFaceCosine) {
    // A map file may say 0.
    const float w_old = 1.0f / std::max(static_cast<float>(kMinNormalVariance), point->normal_variance);
    const float w_new = static_cast<float>(1.0 / seen.normal_variance);
    point->normal_map = (w_old * point->normal_map + w_new * seen_normal).normalized();
    point->normal_variance = std::max(static_cast<float>(kMinNormalVariance), 1.0f / (w_old + w_new));
  }
  point->last_seen_s = stamp_s_;
  point->num_misses = 0;
  if (point->num_looks < std::numeric_limits<std::uint16_t>::max()) ++point->num_looks;
  return PointOutcome::kFused;
}

}  // namespace gpis_mapping
