// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/frame_map.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/Dense>
#include <opencv2/imgproc.hpp>

#include <interactive_mapping_common/threads/parallel_for.h>

namespace gpis_mapping {
namespace {

using interactive_mapping::parallelFor;

constexpr int kVarianceSteps = 4;  // per pixel; the variance is smooth at the scale of a pixel
// A tile is one surface when what its linear trend leaves over is noise: 1.35 is six standard deviations of the
// rms of 144 samples, 4.5 passes one sample in 10^5.
constexpr float kSmoothRms = 1.35f;
constexpr float kSmoothMax = 4.5f;
constexpr int kEdgeRadiusPx = 2;  // reach of nearestAround

/// Largest value within `radius` pixels along each axis.
std::vector<float> slidingMaximum(const std::vector<float>& source, int width, int height, int radius) {
  std::vector<float> result(source.size());
  const cv::Mat in(height, width, CV_32F, const_cast<float*>(source.data()));
  cv::Mat out(height, width, CV_32F, result.data());
  cv::dilate(in, out, cv::getStructuringElement(cv::MORPH_RECT, {2 * radius + 1, 2 * radius + 1}));
  return result;
}

/// Running sums of the least-squares fit w = c0 + c1 du + c2 dv.
struct PlaneSums {
  double n{0}, u{0}, v{0}, uu{0}, uv{0}, vv{0}, w{0}, wu{0}, wv{0};

  void add(double du, double dv, double value) {
    n += 1;
    u += du;
    v += dv;
    uu += du * du;
    uv += du * dv;
    vv += dv * dv;
    w += value;
    wu += value * du;
    wv += value * dv;
  }
  bool solve(Eigen::Vector3d* c) const {
    Eigen::Matrix3d a;
    a << n, u, v, u, uu, uv, v, uv, vv;
    const double determinant = a.determinant();
    if (!(std::abs(determinant) > 1e-6 * n * (uu + 1.0) * (vv + 1.0))) return false;
    *c = a.inverse() * Eigen::Vector3d(w, wu, wv);
    return true;
  }
};

}  // namespace

FrameRegressor::FrameRegressor(const CameraModel& camera, const GpisConfig::FrameMap& config, double noise_std_per_m)
    : camera_(camera),
      tile_(config.tile_px),
      window_(std::min({config.tile_px + 2 * config.overlap_px, camera.width, camera.height})),
      alpha_(1.0 / config.kernel_length_rad),
      prior_variance_(config.prior_std_per_m * config.prior_std_per_m),
      noise_std_(noise_std_per_m) {
  const int n = window_ * window_;
  const auto kernel = [this](double du, double dv) {
    return prior_variance_ * std::exp(-alpha_ * std::hypot(du / camera_.fx, dv / camera_.fy));
  };
  Eigen::MatrixXd covariance(n, n);
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      covariance(i, j) = kernel(i % window_ - j % window_, i / window_ - j / window_);
    }
    covariance(i, i) += noise_std_ * noise_std_;
  }
  const Eigen::MatrixXd inverse = covariance.llt().solve(Eigen::MatrixXd::Identity(n, n));
  inverse_covariance_ = inverse.cast<float>();

  Eigen::MatrixXd basis(n, 3);
  const double center = 0.5 * (window_ - 1);
  for (int i = 0; i < n; ++i) basis.row(i) << 1.0, i % window_ - center, i / window_ - center;
  trend_basis_ = basis.cast<float>();
  trend_solver_ = (basis.transpose() * basis).ldlt().solve(basis.transpose()).cast<float>();

  variance_size_ = (window_ - 1) * kVarianceSteps + 1;
  variance_table_.resize(static_cast<std::size_t>(variance_size_) * variance_size_);
  Eigen::MatrixXd cross(n, variance_size_);
  for (int row = 0; row < variance_size_; ++row) {
    for (int column = 0; column < variance_size_; ++column) {
      for (int i = 0; i < n; ++i) {
        cross(i, column) = kernel(static_cast<double>(column) / kVarianceSteps - i % window_,
                                  static_cast<double>(row) / kVarianceSteps - i / window_);
      }
    }
    const Eigen::VectorXd explained = (inverse * cross).cwiseProduct(cross).colwise().sum();
    for (int column = 0; column < variance_size_; ++column) {
      variance_table_[static_cast<std::size_t>(row) * variance_size_ + column] =
          static_cast<float>(std::max(0.0, prior_variance_ - explained(column)));
    }
  }
}

int FrameRegressor::windowStart(int tile_index, int image_size) const {
  const int overlap = (window_ - tile_) / 2;
  return std::max(0, std::min(tile_index * tile_ - overlap, image_size - window_));
}

double FrameRegressor::variance(double pu, double pv) const {
  const auto index = [this](double p) {
    return std::max(0, std::min(variance_size_ - 1, static_cast<int>(std::lround(p * kVarianceSteps))));
  };
  return variance_table_[static_cast<std::size_t>(index(pv)) * variance_size_ + index(pu)];
}

FrameMap::FrameMap(std::shared_ptr<const FrameRegressor> regressor, std::shared_ptr<const ClassifiedFrame> frame,
                   const DepthNoiseModel& noise, int num_threads)
    : regressor_(std::move(regressor)), frame_(std::move(frame)) {
  const FrameRegressor& r = *regressor_;
  const int width = frame_->width;
  const int height = frame_->height;
  const int window = r.window();
  const int n = window * window;
  tiles_u_ = (width + r.tile() - 1) / r.tile();
  tiles_v_ = (height + r.tile() - 1) / r.tile();
  const int num_tiles = tiles_u_ * tiles_v_;
  alpha_.resize(n, num_tiles);
  trend_.resize(3, num_tiles);
  scale_.resize(num_tiles);
  smooth_.resize(num_tiles);
  parallelFor(static_cast<std::size_t>(tiles_v_), num_threads, 4, [&](std::size_t begin, std::size_t end) {
    Eigen::MatrixXf y(n, tiles_u_);
    for (std::size_t tv = begin; tv < end; ++tv) {
      const int start_v = r.windowStart(static_cast<int>(tv), height);
      for (int tu = 0; tu < tiles_u_; ++tu) {
        const int start_u = r.windowStart(tu, width);
        for (int j = 0; j < window; ++j) {
          std::copy_n(&frame_->inverse_range[frame_->index(start_u, start_v + j)], window, &y(j * window, tu));
        }
      }
      const int first = static_cast<int>(tv) * tiles_u_;
      trend_.middleCols(first, tiles_u_).noalias() = r.trendSolver() * y;
      y.noalias() -= r.trendBasis() * trend_.middleCols(first, tiles_u_);
      alpha_.middleCols(first, tiles_u_).noalias() = r.inverseCovariance() * y;
      for (int tu = 0; tu < tiles_u_; ++tu) {
        const double inverse_range = std::max(1e-3f, trend_(0, first + tu));
        const double range = std::min(20.0, 1.0 / inverse_range);
        const double scale = noise.sigma(range) / (range * range) / r.noiseStd();
        const float expected = static_cast<float>(scale * r.noiseStd());
        scale_[first + tu] = static_cast<float>(scale);
        smooth_[first + tu] = y.col(tu).squaredNorm() < n * std::pow(kSmoothRms * expected, 2) &&
                              y.col(tu).cwiseAbs().maxCoeff() < kSmoothMax * expected;
      }
    }
  });
  nearest_ = slidingMaximum(frame_->inverse_range, width, height, kEdgeRadiusPx);
}

std::size_t FrameMap::tileIndex(double u, double v, int* start_u, int* start_v) const {
  const int tu = std::max(0, std::min(tiles_u_ - 1, static_cast<int>((u + 0.5) / regressor_->tile())));
  const int tv = std::max(0, std::min(tiles_v_ - 1, static_cast<int>((v + 0.5) / regressor_->tile())));
  *start_u = regressor_->windowStart(tu, frame_->width);
  *start_v = regressor_->windowStart(tv, frame_->height);
  return static_cast<std::size_t>(tv) * tiles_u_ + tu;
}

FrameMap::Inference FrameMap::infer(double u, double v) const {
  int start_u = 0;
  int start_v = 0;
  const std::size_t tile = tileIndex(u, v, &start_u, &start_v);
  const FrameRegressor& r = *regressor_;
  const int window = r.window();
  const double pu = u - start_u;
  const double pv = v - start_v;
  // k* against the window's pixels; row by row so that the compiler can vectorise the distances.
  const float decay_u = static_cast<float>(r.alpha() / r.camera().fx);
  const float decay_v = static_cast<float>(r.alpha() / r.camera().fy);
  Eigen::Array<float, Eigen::Dynamic, 1, 0, 28 * 28, 1> distance(window * window);
  for (int j = 0; j < window; ++j) {
    const float dv = decay_v * static_cast<float>(pv - j);
    for (int i = 0; i < window; ++i) {
      const float du = decay_u * static_cast<float>(pu - i);
      distance[j * window + i] = du * du + dv * dv;
    }
  }
  distance = (-distance.sqrt()).exp();
  const float residual = static_cast<float>(r.priorVariance()) * alpha_.col(tile).dot(distance.matrix());
  const double center = 0.5 * (window - 1);
  const Eigen::Vector3f& c = trend_.col(tile);
  const double trend = c[0] + c[1] * (pu - center) + c[2] * (pv - center);
  return {trend + residual, scale_[tile] * std::sqrt(r.variance(pu, pv)), smooth_[tile] != 0};
}

bool FrameMap::isSmooth(double u, double v) const {
  int start_u = 0;
  int start_v = 0;
  return smooth_[tileIndex(u, v, &start_u, &start_v)] != 0;
}

Eigen::Vector3f FrameMap::trendNormal(double u, double v) const {
  int start_u = 0;
  int start_v = 0;
  const std::size_t tile = tileIndex(u, v, &start_u, &start_v);
  const CameraModel& camera = regressor_->camera();
  const double center = 0.5 * (regressor_->window() - 1);
  const Eigen::Vector3f& c = trend_.col(tile);
  const double y = c[0] + c[1] * (u - start_u - center) + c[2] * (v - start_v - center);
  // From inverse range y to inverse depth w = |v| y, whose gradient in (theta_u, theta_v, 1) is the plane's normal / D.
  const double tu = (u - camera.cx) / camera.fx;
  const double tv = (v - camera.cy) / camera.fy;
  const double length = std::sqrt(tu * tu + tv * tv + 1.0);
  const double a = tu / length * y + length * c[1] * camera.fx;
  const double b = tv / length * y + length * c[2] * camera.fy;
  const Eigen::Vector3d n(a, b, length * y - a * tu - b * tv);
  return (-n / n.norm()).cast<float>();
}

bool fitLocalPlane(const ClassifiedFrame& frame, const CameraModel& camera, const DepthNoiseModel& noise, int u, int v,
                   double radius_m, LocalPlane* plane) {
  constexpr int kSeedRadius = 2;     // the seed: 5 x 5 pixels
  constexpr int kPatchSteps = 3;     // the patch: 7 x 7 samples
  constexpr double kSeedRms = 2.5;   // [sigma] a seed that straddles an edge is no seed
  constexpr double kInlier = 3.0;    // [sigma]
  constexpr double kMinShare = 0.4;  // a pixel right beside a straight edge sees its surface in half the patch
  const std::size_t center = frame.index(u, v);
  if (frame.kind[center] != PixelKind::kSurface) return false;
  if (u < kSeedRadius || v < kSeedRadius || u >= frame.width - kSeedRadius || v >= frame.height - kSeedRadius) {
    return false;
  }
  const double w_center = frame.inverse_depth[center];
  const double z = 1.0 / w_center;
  const double sigma_w = noise.sigma(z) * w_center * w_center;  // of inverse depth [1/m]

  PlaneSums seed;
  double squares = 0.0;
  for (int dv = -kSeedRadius; dv <= kSeedRadius; ++dv) {
    for (int du = -kSeedRadius; du <= kSeedRadius; ++du) {
      const std::size_t i = frame.index(u + du, v + dv);
      if (frame.kind[i] != PixelKind::kSurface) return false;
      seed.add(du, dv, frame.inverse_depth[i] - w_center);
      squares += std::pow(frame.inverse_depth[i] - w_center, 2);
    }
  }
  Eigen::Vector3d c;
  if (!seed.solve(&c)) return false;
  const double left_over = squares - c.dot(Eigen::Vector3d(seed.w, seed.wu, seed.wv));
  if (left_over > seed.n * std::pow(kSeedRms * sigma_w, 2)) return false;

  const int step = std::max(1, std::min(8, static_cast<int>(std::lround(radius_m * camera.fx / z / kPatchSteps))));
  for (int pass = 0; pass < 2; ++pass) {
    // The seed's slope is uncertain: the gate opens with the distance from the centre in the first pass.
    const double slope_std = pass == 0 ? sigma_w / std::sqrt(seed.uu) : 0.0;
    PlaneSums patch;
    int looked = 0;
    for (int j = -kPatchSteps; j <= kPatchSteps; ++j) {
      for (int i = -kPatchSteps; i <= kPatchSteps; ++i) {
        const int pu = u + i * step;
        const int pv = v + j * step;
        ++looked;
        if (pu < 0 || pv < 0 || pu >= frame.width || pv >= frame.height) continue;
        const std::size_t index = frame.index(pu, pv);
        if (frame.kind[index] != PixelKind::kSurface) continue;
        const double du = i * step;
        const double dv = j * step;
        const double residual = frame.inverse_depth[index] - w_center - (c[0] + c[1] * du + c[2] * dv);
        const double gate = kInlier * (sigma_w + slope_std * std::hypot(du, dv));
        if (std::abs(residual) < gate) patch.add(du, dv, frame.inverse_depth[index] - w_center);
      }
    }
    if (patch.n < kMinShare * looked || !patch.solve(&c)) return false;
    seed = patch;
  }
  const double w = w_center + c[0];
  if (!(w > 0.0)) return false;
  const double tu = (u - camera.cx) / camera.fx;
  const double tv = (v - camera.cy) / camera.fy;
  const double a = c[1] * camera.fx;
  const double b = c[2] * camera.fy;
  const Eigen::Vector3d n(a, b, w - a * tu - b * tv);
  const double norm = n.norm();
  if (!(norm > 0.0)) return false;
  plane->point_camera = Eigen::Vector3d(tu, tv, 1.0) / w;
  plane->normal_camera = (-n / norm).cast<float>();
  // An off-centre patch extrapolates: the variance at the centre follows from the sums' centroid.
  const double mean_u = seed.u / seed.n;
  const double mean_v = seed.v / seed.n;
  const double spread_u = std::max(1.0, seed.uu - seed.n * mean_u * mean_u);
  const double spread_v = std::max(1.0, seed.vv - seed.n * mean_v * mean_v);
  const double w_variance =
      sigma_w * sigma_w * (1.0 / seed.n + mean_u * mean_u / spread_u + mean_v * mean_v / spread_v);
  plane->depth_std_m = std::sqrt(w_variance) / (w * w);
  plane->normal_var = std::pow(sigma_w * camera.fx / norm, 2) / std::min(spread_u, spread_v);
  return true;
}

}  // namespace gpis_mapping
