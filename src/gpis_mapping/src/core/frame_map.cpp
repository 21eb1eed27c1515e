// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/frame_map.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/Dense>

#include <interactive_mapping_common/threads/parallel_for.h>

namespace gpis_mapping {
namespace {

using interactive_mapping::parallelFor;

constexpr int kSteps = 4;          // of the tables per pixel; weights and variance are smooth at the scale of a pixel
constexpr int kMaxWindow = 28;     // largest tile and twice the largest overlap [px]
constexpr int kDefaultWindow = 8;  // of a size known to the compiler: half the time
// A tile is one surface when what its linear trend leaves over is noise: 1.35 is four standard deviations of the
// rms of 64 samples, 4.5 passes one sample in 10^5.
constexpr float kSmoothRms = 1.35f;
constexpr float kSmoothMax = 4.5f;
constexpr int kEdgeRadiusPx = 2;  // reach of nearestAround

template <int kWindow>
using WindowMap = Eigen::Map<const Eigen::Array<float, kWindow, kWindow>, 0, Eigen::OuterStride<>>;

struct TileFit {
  Eigen::Vector3f trend;  // of inverse range at the window's centre, per pixel along u, along v [1/m]
  float squares;          // of what it leaves over, summed [1/m^2]
  float largest;          // of what it leaves over [1/m]
};

/// Least-squares linear function of the pixels: on a regular grid the three normal equations separate.
/// `pixels`: a column of it is a row of the image.
template <int kWindow>
TileFit fitTile(const WindowMap<kWindow>& pixels) {
  using Line = Eigen::Array<float, kWindow, 1, 0, kWindow == Eigen::Dynamic ? kMaxWindow : kWindow, 1>;
  const Eigen::Index n = pixels.rows();
  const float middle = 0.5f * static_cast<float>(n - 1);
  const Line du = Line::LinSpaced(n, -middle, middle);
  const float reference = pixels(n / 2, n / 2);  // small sums round less
  Line sum = Line::Zero(n);
  Line sum_along = Line::Zero(n);
  for (Eigen::Index v = 0; v < n; ++v) {
    const Line line = pixels.col(v) - reference;
    sum += line;
    sum_along += (static_cast<float>(v) - middle) * line;
  }
  const float count = static_cast<float>(n);
  const float spread = count * du.square().sum();
  TileFit fit;
  fit.trend = {sum.sum() / (count * count), (sum * du).sum() / spread, sum_along.sum() / spread};
  Line squares = Line::Zero(n);
  Line largest = Line::Zero(n);
  for (Eigen::Index v = 0; v < n; ++v) {
    const float at_center = fit.trend[0] + fit.trend[2] * (static_cast<float>(v) - middle) + reference;
    const Line left_over = pixels.col(v) - at_center - fit.trend[1] * du;
    squares += left_over.square();
    largest = largest.max(left_over.abs());
  }
  fit.trend[0] += reference;
  fit.squares = squares.sum();
  fit.largest = largest.maxCoeff();
  return fit;
}

/// Running sums of the least-squares fit w = c0 + c1 du + c2 dv.
struct PlaneSums {
  double n{0}, u{0}, v{0}, uu{0}, uv{0}, vv{0}, w{0}, wu{0}, wv{0}, ww{0};

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
    ww += value * value;
  }
  bool solve(Eigen::Vector3d* c) const {
    Eigen::Matrix3d a;
    a << n, u, v, u, uu, uv, v, uv, vv;
    const double determinant = a.determinant();
    if (!(std::abs(determinant) > 1e-6 * n * (uu + 1.0) * (vv + 1.0))) return false;
    *c = a.inverse() * Eigen::Vector3d(w, wu, wv);
    return true;
  }
  double spreadU() const { return std::max(1.0, uu - u * u / n); }
  double spreadV() const { return std::max(1.0, vv - v * v / n); }
  /// Of the plane at (du, dv), for values of variance 1; grows with the distance from their centroid.
  double variance(double du, double dv) const {
    return 1.0 / n + std::pow(du - u / n, 2) / spreadU() + std::pow(dv - v / n, 2) / spreadV();
  }
  /// Mean square of what the fit leaves over.
  double leftOver(const Eigen::Vector3d& c) const { return (ww - c.dot(Eigen::Vector3d(w, wu, wv))) / n; }
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
  const Eigen::LLT<Eigen::MatrixXd> solver(covariance);
  Eigen::MatrixXd basis(n, 3);
  const double center = 0.5 * (window_ - 1);
  for (int i = 0; i < n; ++i) basis.row(i) << 1.0, i % window_ - center, i / window_ - center;
  const Eigen::Matrix3d moments = basis.transpose() * basis;

  // A tile answers for half a pixel round its own pixels, which at the image's border are the window's.
  table_size_ = window_ * kSteps + 1;
  const auto place = [](int index) { return static_cast<double>(index) / kSteps - 0.5; };
  variance_table_.resize(static_cast<std::size_t>(table_size_) * table_size_);
  weight_table_.resize(n, table_size_ * table_size_);
  Eigen::MatrixXd cross(n, table_size_);
  for (int row = 0; row < table_size_; ++row) {
    for (int column = 0; column < table_size_; ++column) {
      for (int i = 0; i < n; ++i) cross(i, column) = kernel(place(column) - i % window_, place(row) - i / window_);
    }
    const Eigen::MatrixXd weights = solver.solve(cross);
    // They are to be applied to the pixels as they are: the trend's share in those gets no weight.
    weight_table_.middleCols(row * table_size_, table_size_) =
        (weights - basis * moments.ldlt().solve(basis.transpose() * weights)).cast<float>();
    const Eigen::VectorXd explained = weights.cwiseProduct(cross).colwise().sum();
    for (int column = 0; column < table_size_; ++column) {
      variance_table_[static_cast<std::size_t>(row) * table_size_ + column] =
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
    return std::max(0, std::min(table_size_ - 1, static_cast<int>((p + 0.5) * kSteps + 0.5)));
  };
  return variance_table_[static_cast<std::size_t>(index(pv)) * table_size_ + index(pu)];
}

float FrameRegressor::residual(const float* pixels, int stride, double pu, double pv) const {
  Eigen::Array<float, Eigen::Dynamic, 1, 0, kMaxWindow * kMaxWindow, 1> y(window_ * window_);
  for (int j = 0; j < window_; ++j)
    std::copy_n(pixels + static_cast<std::ptrdiff_t>(j) * stride, window_, &y[j * window_]);
  const float u = static_cast<float>((pu + 0.5) * kSteps);
  const float v = static_cast<float>((pv + 0.5) * kSteps);
  const int column = std::max(0, std::min(table_size_ - 2, static_cast<int>(u)));
  const int row = std::max(0, std::min(table_size_ - 2, static_cast<int>(v)));
  const float right = u - static_cast<float>(column);
  const float below = v - static_cast<float>(row);
  const auto along = [&](int r) {
    const auto left_weights = weight_table_.col(static_cast<Eigen::Index>(r) * table_size_ + column).array();
    const auto right_weights = weight_table_.col(static_cast<Eigen::Index>(r) * table_size_ + column + 1).array();
    return ((left_weights + right * (right_weights - left_weights)) * y).sum();
  };
  const float above = along(row);
  return above + below * (along(row + 1) - above);
}

FrameMap::FrameMap(std::shared_ptr<const FrameRegressor> regressor, std::shared_ptr<const ClassifiedFrame> frame,
                   const DepthNoiseModel& noise, int num_threads)
    : regressor_(std::move(regressor)), frame_(std::move(frame)) {
  const FrameRegressor& r = *regressor_;
  const int width = frame_->width;
  const int height = frame_->height;
  const int window = r.window();
  tiles_u_ = (width + r.tile() - 1) / r.tile();
  tiles_v_ = (height + r.tile() - 1) / r.tile();
  const int num_tiles = tiles_u_ * tiles_v_;
  trend_.resize(3, num_tiles);
  scale_.resize(num_tiles);
  smooth_.resize(num_tiles);
  parallelFor(static_cast<std::size_t>(tiles_v_), num_threads, 4, [&](std::size_t begin, std::size_t end) {
    for (std::size_t tv = begin; tv < end; ++tv) {
      const int start_v = r.windowStart(static_cast<int>(tv), height);
      for (int tu = 0; tu < tiles_u_; ++tu) {
        const std::size_t tile = tv * tiles_u_ + tu;
        const float* pixels = &frame_->inverse_range[frame_->index(r.windowStart(tu, width), start_v)];
        const Eigen::OuterStride<> stride(width);
        const TileFit fit = window == kDefaultWindow
                                ? fitTile<kDefaultWindow>(WindowMap<kDefaultWindow>(pixels, window, window, stride))
                                : fitTile<Eigen::Dynamic>(WindowMap<Eigen::Dynamic>(pixels, window, window, stride));
        trend_.col(static_cast<Eigen::Index>(tile)) = fit.trend;
        const double inverse_range = std::max(1e-3f, fit.trend[0]);
        const double range = std::min(20.0, 1.0 / inverse_range);
        const float expected = static_cast<float>(noise.sigma(range) / (range * range));
        const float rms_limit = kSmoothRms * expected;
        scale_[tile] = expected / static_cast<float>(r.noiseStd());
        smooth_[tile] = fit.squares < static_cast<float>(window * window) * rms_limit * rms_limit &&
                        fit.largest < kSmoothMax * expected;
      }
    }
  });
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
  const float* pixels = &frame_->inverse_range[frame_->index(start_u, start_v)];
  const float residual = r.residual(pixels, frame_->width, pu, pv);
  const double center = 0.5 * (window - 1);
  const Eigen::Vector3f& c = trend_.col(tile);
  const double trend = c[0] + c[1] * (pu - center) + c[2] * (pv - center);
  return {trend + residual, scale_[tile] * std::sqrt(r.variance(pu, pv)), smooth_[tile] != 0};
}

float FrameMap::nearestAround(int u, int v) const {
  float largest = 0.0f;
  for (int j = std::max(0, v - kEdgeRadiusPx); j <= std::min(frame_->height - 1, v + kEdgeRadiusPx); ++j) {
    for (int i = std::max(0, u - kEdgeRadiusPx); i <= std::min(frame_->width - 1, u + kEdgeRadiusPx); ++i) {
      largest = std::max(largest, frame_->inverse_range[frame_->index(i, j)]);
    }
  }
  return largest;
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
  constexpr int kSeedRadius = 2;  // the seed: 5 x 5 pixels
  constexpr int kPatchSteps = 3;  // the patch: 7 x 7 samples
  constexpr double kSeedRms =
      1.7;                         // [sigma] less loses more pixels beside edges, more puts planes between two surfaces
  constexpr double kInlier = 2.0;  // [sigma]
  constexpr double kPatchRms = 1.1;  // [sigma] noise within the gate leaves 0.88 over, a plane between surfaces more
  constexpr double kMinShare = 0.4;  // a pixel right beside a straight edge sees its surface in half the patch
  const std::size_t center = frame.index(u, v);
  if (frame.kind[center] != PixelKind::kSurface) return false;
  if (u < kSeedRadius || v < kSeedRadius || u >= frame.width - kSeedRadius || v >= frame.height - kSeedRadius) {
    return false;
  }
  const double w_center = frame.inverse_depth[center];
  const double z = 1.0 / w_center;
  const double sigma_w = noise.sigma(z) * w_center * w_center;  // of inverse depth [1/m]

  PlaneSums patch;  // of the seed at first
  for (int dv = -kSeedRadius; dv <= kSeedRadius; ++dv) {
    for (int du = -kSeedRadius; du <= kSeedRadius; ++du) {
      const std::size_t i = frame.index(u + du, v + dv);
      if (frame.kind[i] != PixelKind::kSurface) return false;
      patch.add(du, dv, frame.inverse_depth[i] - w_center);
    }
  }
  Eigen::Vector3d c;
  if (!patch.solve(&c) || patch.leftOver(c) > std::pow(kSeedRms * sigma_w, 2)) return false;

  const int step = std::max(1, std::min(8, static_cast<int>(std::lround(radius_m * camera.fx / z / kPatchSteps))));
  // Ring by ring: far from the few pixels it is fitted to, a plane is so uncertain that the gate would let in a second
  // surface.
  for (int reach = 1; reach <= kPatchSteps; ++reach) {
    PlaneSums grown;
    for (int j = -reach; j <= reach; ++j) {
      for (int i = -reach; i <= reach; ++i) {
        const int pu = u + i * step;
        const int pv = v + j * step;
        if (pu < 0 || pv < 0 || pu >= frame.width || pv >= frame.height) continue;
        const std::size_t index = frame.index(pu, pv);
        if (frame.kind[index] != PixelKind::kSurface) continue;
        const double du = i * step;
        const double dv = j * step;
        const double value = frame.inverse_depth[index] - w_center;
        const double residual = value - (c[0] + c[1] * du + c[2] * dv);
        const double gate2 = std::pow(kInlier * sigma_w, 2) * (1.0 + patch.variance(du, dv));
        if (residual * residual < gate2) grown.add(du, dv, value);
      }
    }
    if (!grown.solve(&c)) return false;
    patch = grown;
  }
  constexpr int kSide = 2 * kPatchSteps + 1;
  if (patch.n < kMinShare * kSide * kSide || patch.leftOver(c) > std::pow(kPatchRms * sigma_w, 2)) return false;
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
  plane->depth_std_m = sigma_w * std::sqrt(patch.variance(0.0, 0.0)) / (w * w);
  plane->normal_var = std::pow(sigma_w * camera.fx / norm, 2) / std::min(patch.spreadU(), patch.spreadV());
  return true;
}

}  // namespace gpis_mapping
