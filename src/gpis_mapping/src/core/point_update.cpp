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
// The frame against the map.
constexpr double kMinFitCosine = 0.3;        // flatter than 73 degrees, a pixel's own noise is all one sees
constexpr double kMaxDisplacement_m = 0.25;  // more is another surface
constexpr std::size_t kMinFitPoints = 40;
constexpr int kFitPasses = 5;
constexpr double kFitWidth_m = 0.01;  // of the robust loss in the last pass
constexpr double kFitShift_m = 0.02;  // spread of misalignments
constexpr double kFitTurn_rad = 0.01;
constexpr double kMinDepth_m = 0.05;  // of a point that has a pixel
// A view from the same direction within 10 degrees, and not much farther away, shows what the last one showed.
constexpr double kSameViewCosine = 0.985;
constexpr double kSameViewRange = 1.15;
// Nearer than this share of the least range, and farther than that of the greatest, a sensor fails anywhere.
constexpr double kTooNear = 1.2;
constexpr double kTooFar = 0.8;
constexpr double kReachSigmas = 3.0;       // nearer to the greatest range, noise may carry a depth beyond it
constexpr double kDoubleTolerances = 2.5;  // so near behind a surface of its direction, a point is a double of it
constexpr int kMaxMisses = 3;              // looks past a point within the reach of a depth edge, since it was fused
// Of the least tolerance: so far before a face of another direction, look after look, a point belongs to nothing.
constexpr double kStrayShare = 0.5;
constexpr double kMinNormalVariance = 4e-4;  // 1.1 degrees: normals do not get better than the calibration
constexpr double kLateralPx = 0.3;           // standard deviation of where in its pixel a depth was measured
// Share of a depth error's variance that neighbouring pixels have in common (disparity windows, quantisation).
constexpr double kCorrelatedShare = 0.15;

}  // namespace

Frame::Frame(const GpisConfig& config, std::shared_ptr<const ClassifiedFrame> pixels,
             std::shared_ptr<const FrameRegressor> regressor, const std::vector<PixelHistory>& pixel_history,
             const Eigen::Isometry3d& T_map_camera, const CameraMotion& motion, float stamp_s, int num_threads)
    : config_(config),
      pixels_(std::move(pixels)),
      T_map_camera_(T_map_camera),
      T_camera_map_(T_map_camera.inverse()),
      pixel_history_(pixel_history),
      motion_variance_(std::pow(motion.speed_mps * config.sensor.stamp_std_s, 2)),
      angle_variance_(std::pow(config.sensor.pose_std_rad, 2) +
                      std::pow(motion.turn_radps * config.sensor.stamp_std_s, 2)),
      stamp_s_(stamp_s),
      map_(std::move(regressor), pixels_, config.sensor.noise, num_threads) {}

Frame::Misalignment Frame::measureMisalignment(const std::vector<const SurfacePoint*>& points) const {
  struct Row {
    Eigen::Matrix<double, 6, 1> jacobian;  // of the displacement across the surface
    double displacement;
    double variance;
  };
  std::vector<Row> rows;
  for (const SurfacePoint* point : points) {
    const std::optional<Eigen::Vector2i> at = pixelOf(point->position_map);
    if (!at || !map_.isSmooth(at->x(), at->y())) continue;
    const std::size_t pixel = pixels_->index(at->x(), at->y());
    if (pixels_->kind[pixel] != PixelKind::kSurface || pixels_->blocked[pixel] != Block::kNone) continue;
    const Eigen::Vector3d p = T_camera_map_ * point->position_map;
    const Eigen::Vector3d n = T_camera_map_.linear() * point->normal_map.cast<double>();
    const double cosine = -n.dot(p) / p.norm();
    if (cosine < kMinFitCosine || map_.trendNormal(at->x(), at->y()).cast<double>().dot(n) < kSameFaceCosine) continue;
    const double displacement = (p.norm() - 1.0 / pixels_->inverse_range[pixel]) * cosine;
    if (std::abs(displacement) > kMaxDisplacement_m) continue;
    Row row;
    row.jacobian << n, p.cross(n);
    row.displacement = displacement;
    row.variance = point->variance_m2 + std::pow(config_.sensor.noise.sigma(p.z()) * cosine, 2);
    rows.push_back(row);
  }
  if (rows.size() < kMinFitPoints) return {};
  Misalignment result;
  Eigen::Matrix<double, 6, 1> twist = Eigen::Matrix<double, 6, 1>::Zero();
  for (int pass = 0; pass < kFitPasses; ++pass) {
    // What the surfaces leave open stays at zero.
    Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();
    information.diagonal().head<3>().setConstant(1.0 / (kFitShift_m * kFitShift_m));
    information.diagonal().tail<3>().setConstant(1.0 / (kFitTurn_rad * kFitTurn_rad));
    Eigen::Matrix<double, 6, 1> gradient = Eigen::Matrix<double, 6, 1>::Zero();
    for (const Row& row : rows) {
      const double residual = row.displacement - row.jacobian.dot(twist);
      // Geman-McClure: what came or went has no say in the end. Wide at first.
      const double width2 = row.variance + std::pow(kFitWidth_m * (kFitPasses - pass), 2);
      const double weight = std::pow(width2 / (width2 + residual * residual), 2) / row.variance;
      information += weight * row.jacobian * row.jacobian.transpose();
      gradient += weight * row.displacement * row.jacobian;
    }
    const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> solver(information);
    twist = solver.solve(gradient);
    result.covariance = solver.solve(Eigen::Matrix<double, 6, 6>::Identity());
  }
  result.shift_m = twist.head<3>();
  result.turn_rad = twist.tail<3>();
  double squares = 0.0;
  for (const Row& row : rows) squares += std::pow(row.jacobian.dot(twist), 2);
  result.rms_m = std::sqrt(squares / static_cast<double>(rows.size()));
  if (result.rms_m < config_.sensor.pose_std_m) {  // that much is stated, and allowed for as it is
    result.shift_m.setZero();
    result.turn_rad.setZero();
  }
  return result;
}

double Frame::poseVariance(const Eigen::Vector3d& p_camera, const Eigen::Vector3d& normal_camera) const {
  Eigen::Matrix<double, 6, 1> jacobian;
  jacobian << normal_camera, p_camera.cross(normal_camera);
  // Rotation and time are as uncertain as they are stated to be, or as the frame itself leaves them.
  const double of_motion = motion_variance_ + angle_variance_ * jacobian.tail<3>().squaredNorm();
  const double left_open = jacobian.dot(misalignment_.covariance * jacobian);
  return std::pow(config_.sensor.pose_std_m, 2) + std::min(of_motion, left_open);
}

std::optional<Eigen::Vector2i> Frame::pixelOf(const Eigen::Vector3d& p_map) const {
  const CameraModel& camera = this->camera();
  const Eigen::Vector3d p = T_camera_map_ * p_map;
  if (p.z() < kMinDepth_m) return std::nullopt;
  const double u = camera.fx * p.x() / p.z() + camera.cx;
  const double v = camera.fy * p.y() / p.z() + camera.cy;
  if (!(u >= 0.0 && v >= 0.0 && u <= camera.width - 1.0 && v <= camera.height - 1.0)) return std::nullopt;
  return Eigen::Vector2i(static_cast<int>(u + 0.5), static_cast<int>(v + 0.5));
}

bool Frame::isDue(const SurfacePoint& point, const Eigen::Vector3d& p_camera) const {
  if (!config_.dynamic.enabled) return false;
  const double range = p_camera.norm();
  if (range < kTooNear * config_.sensor.min_range_m || range > kTooFar * config_.sensor.max_range_m) return false;
  const Eigen::Vector3d then = point.seen_from_map.cast<double>() - point.position_map;  // NaN: false below
  const Eigen::Vector3d now = T_map_camera_.translation() - point.position_map;
  return range < kSameViewRange * then.norm() && then.dot(now) > kSameViewCosine * then.norm() * range;
}

double Frame::correlatedVariance(double z_m) const {
  const double sigma = config_.sensor.noise.sigma(z_m);
  return kCorrelatedShare * sigma * sigma;
}

std::optional<SurfaceMeasurement> Frame::measure(double u, double v, const FrameMap::Inference& inferred) const {
  const CameraModel& camera = this->camera();
  const Eigen::Vector3d ray((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
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
                       poseVariance(result.point_camera, result.normal_camera.cast<double>());
  result.normal_variance = std::max(kMinNormalVariance, result.normal_variance);
  return result;
}

double Frame::tolerance(const Eigen::Vector3d& p_camera, const Eigen::Vector3d& facing, double across,
                        double variance_m2, double seen_sigma) const {
  const double per_metre = 1.0 / p_camera.squaredNorm();  // change of inverse range per metre of range
  const double seen_off = facing.dot(misalignment_.shift_m + misalignment_.turn_rad.cross(p_camera));
  const double own_variance = (variance_m2 + poseVariance(p_camera, facing) + seen_off * seen_off) / (across * across) +
                              correlatedVariance(p_camera.z());
  const double sigma = std::sqrt(seen_sigma * seen_sigma + own_variance * per_metre * per_metre);
  return std::max(config_.dynamic.tolerance_sigmas * sigma, config_.dynamic.min_tolerance_m / across * per_metre);
}

FrameBlanket Frame::blanket(int stride_px) const {
  const CameraModel& camera = this->camera();
  const double variance_m2 = config_.surface.min_noise_std_m * config_.surface.min_noise_std_m;
  FrameBlanket blanket;
  blanket.columns = (camera.width - 1) / stride_px + 1;
  blanket.camera_map = T_map_camera_.translation();
  for (int v = 0; v < camera.height; v += stride_px) {
    for (int u = 0; u < camera.width; u += stride_px) {
      const std::size_t pixel = pixels_->index(u, v);
      const Eigen::Vector3d ray = camera.ray(u, v).normalized();
      const FrameMap::Inference seen = map_.infer(u, v);
      const double least_inverse_range = 1.0 / config_.sensor.max_range_m;
      const Eigen::Vector3d p = ray / std::max(seen.inverse_range, least_inverse_range);
      Eigen::Vector3d n = -ray;
      double nearest = seen.inverse_range;
      if (seen.smooth) {
        n = map_.trendNormal(u, v).cast<double>();
      } else {
        nearest = std::max<double>(nearest, map_.nearestAround(u, v));
      }
      const double tolerance =
          this->tolerance(p, n, std::max(kMaxObliqueCosine, std::abs(n.dot(ray))), variance_m2, seen.sigma);
      const bool is_told = isMeasured(pixels_->kind[pixel]) && pixels_->blocked[pixel] == Block::kNone;
      const auto at = [&](double inverse_range) -> Eigen::Vector3f {
        if (!is_told) return Eigen::Vector3f::Constant(std::numeric_limits<float>::quiet_NaN());
        return (T_map_camera_ * (ray / std::max(inverse_range, least_inverse_range))).cast<float>();
      };
      blanket.knots.push_back({at(nearest + tolerance), at(seen.inverse_range), at(seen.inverse_range - tolerance),
                               pixels_->kind[pixel] == PixelKind::kWall});
    }
  }
  return blanket;
}

PointOutcome Frame::apply(SurfacePoint* point) const {
  const CameraModel& camera = this->camera();
  const Eigen::Vector3d p = T_camera_map_ * point->position_map;
  if (p.z() < kMinDepth_m) return PointOutcome::kNothing;
  const double u = camera.fx * p.x() / p.z() + camera.cx;
  const double v = camera.fy * p.y() / p.z() + camera.cy;
  if (!(u >= 0.0 && v >= 0.0 && u <= camera.width - 1.0 && v <= camera.height - 1.0)) return PointOutcome::kNothing;
  const int pixel_u = static_cast<int>(u + 0.5);
  const int pixel_v = static_cast<int>(v + 0.5);
  const std::size_t pixel = pixels_->index(pixel_u, pixel_v);
  const PixelKind kind = pixels_->kind[pixel];
  const Block block = pixels_->blocked[pixel];
  if (block == Block::kNoInformation) return PointOutcome::kNothing;
  const float clear_to = pixels_->clear_to[pixel];
  const auto inHole = [&] {
    if (pixel_history_[pixel] == PixelHistory::kNeverMeasures) return PointOutcome::kNothing;
    const bool is_due = pixel_history_[pixel] == PixelHistory::kMeasures && isDue(*point, p);
    return is_due ? PointOutcome::kMissing : PointOutcome::kUnseen;
  };
  if (kind == PixelKind::kHole && clear_to == 0.0f) return inHole();

  const double range = p.norm();
  // That nothing is within reach says nothing of what lies beyond it.
  if (kind == PixelKind::kWall && !isInReach(point->position_map)) return PointOutcome::kNothing;
  const double inverse_range = 1.0 / range;
  const Eigen::Vector3f n = (T_camera_map_.linear() * point->normal_map.cast<double>()).cast<float>();
  const double cosine = -n.cast<double>().dot(p) / range;
  const double across = std::max(kMaxObliqueCosine, std::abs(cosine));
  const FrameMap::Inference seen = map_.infer(u, v);
  // A displaced look at one surface is as far off as its slope makes it: were it the same, both slopes would agree.
  const Eigen::Vector3f seen_n = seen.smooth ? map_.trendNormal(u, v) : n;
  const Eigen::Vector3d facing = (seen_n.dot(p.cast<float>()) < n.dot(p.cast<float>()) ? seen_n : n).cast<double>();
  const double tolerance = this->tolerance(p, facing, across, point->variance_m2, seen.sigma);

  const double past_pixel = inverse_range - pixels_->inverse_range[pixel];
  const PointOutcome unfused =
      std::abs(past_pixel) < tolerance && cosine > kMinCosine ? PointOutcome::kConfirmed : PointOutcome::kNothing;
  if (block == Block::kNarrow) {
    // The frame's GP does not count beside pixels without information. But a shadow is at the same place in every look
    // from here, and it would keep a piece of a removed object: what all pixels round a dropout see past shares the
    // fate of its neighbours, and what its own pixel sees past goes after some looks.
    if (!isMeasured(kind)) {
      const bool is_past = inverse_range - std::max(clear_to, map_.nearestAround(pixel_u, pixel_v)) >= tolerance;
      if (is_past && clear_to > 0.0f) return miss(point);
      if (kind == PixelKind::kHole) return inHole();
      return is_past && config_.dynamic.enabled ? PointOutcome::kDoubtful : PointOutcome::kNothing;
    }
    return past_pixel >= tolerance ? miss(point) : unfused;
  }
  // Eq 7. Near a depth edge the mean lies between the surfaces: seen past is only what is past the raw depths too.
  const double delta = inverse_range - seen.inverse_range;
  const double past =
      seen.smooth ? delta : std::min<double>(delta, inverse_range - map_.nearestAround(pixel_u, pixel_v));
  if (past >= tolerance) {
    return config_.dynamic.enabled ? PointOutcome::kDeleted : PointOutcome::kNothing;
  }
  // Seen past by its own pixel, spared by a nearer one beside it: it shares the fate of its neighbours, and goes when
  // look after look finds it there without ever confirming it.
  if (past_pixel >= tolerance) return miss(point);
  if (delta <= -tolerance && seen.smooth) {
    // Just behind a surface that faces the same way, it is that surface, placed too far: as one too near, it goes.
    const bool is_double = delta > -kDoubleTolerances * tolerance && seen_n.dot(n) > kSameFaceCosine;
    return is_double ? miss(point) : PointOutcome::kOccluded;
  }
  if (kind != PixelKind::kSurface) return PointOutcome::kNothing;
  if (cosine < kMinCosine && std::abs(delta) >= tolerance) return PointOutcome::kNothing;
  const std::optional<SurfaceMeasurement> measurement = measure(u, v, seen);
  const bool is_near = measurement && std::abs(1.0 / measurement->point_camera.norm() - inverse_range) < tolerance;
  if (is_near && isStray(*measurement, p, n)) return miss(point);
  // A face turned away is hidden by its own object. Within the tolerance of what is seen it is a rim, or the foot of an
  // object that is gone: the rest of the face knows.
  if (cosine < kMinCosine) return cosine < -kMinCosine ? PointOutcome::kDoubtful : PointOutcome::kNothing;
  if (!measurement) return unfused;
  return is_near ? fuse(*measurement, p, point) : PointOutcome::kNothing;
}

bool Frame::isInReach(const Eigen::Vector3d& p_map) const {
  const Eigen::Vector3d p = T_camera_map_ * p_map;
  return p.norm() + kReachSigmas * config_.sensor.noise.sigma(p.z()) <= config_.sensor.max_range_m;
}

PointOutcome Frame::miss(SurfacePoint* point) const {
  if (!config_.dynamic.enabled) return PointOutcome::kNothing;
  return ++point->num_misses >= kMaxMisses ? PointOutcome::kDeleted : PointOutcome::kDoubtful;
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
  point->seen_from_map = T_map_camera_.translation().cast<float>();
  point->num_misses = 0;
  if (point->num_looks < std::numeric_limits<std::uint16_t>::max()) ++point->num_looks;
  return PointOutcome::kFused;
}

}  // namespace gpis_mapping
