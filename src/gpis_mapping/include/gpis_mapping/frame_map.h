// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_FRAME_MAP_H
#define GPIS_MAPPING_FRAME_MAP_H

#include <cstdint>
#include <memory>
#include <vector>

#include <Eigen/Core>

#include "gpis_mapping/depth_classifier.h"
#include "gpis_mapping/gpis_config.h"
#include "gpis_mapping/types.h"

namespace gpis_mapping {

/// The part of the 2.5D^-1 map that depends on the camera only. All image tiles share one covariance matrix, factorised
/// once: the bearings are a regular grid and the kernel is stationary.
///
/// Kernel: Ornstein-Uhlenbeck k(d) = s^2 exp(-alpha d), d in bearing units. Eq 6 has s^2 = 1/(2 alpha); here s is a
/// parameter so that the noise filter can be set. Prior mean: the least-squares linear function of the tile (a plane in
/// space has linear inverse depth), so that slopes are not flattened.
class FrameRegressor {
 public:
  /// `noise_std_per_m`: standard deviation of an inverse range measurement [1/m], i.i.d. over pixels.
  FrameRegressor(const CameraModel& camera, const GpisConfig::FrameMap& config, double noise_std_per_m);

  const CameraModel& camera() const { return camera_; }
  int tile() const { return tile_; }
  int window() const { return window_; }
  double noiseStd() const { return noise_std_; }
  /// First pixel of the window that serves the tile of pixel coordinate p (windows are shifted inwards at borders).
  int windowStart(int tile_index, int image_size) const;

  /// Posterior variance of inverse range [1/m^2] at window coordinates (pu, pv) [px]; depends on the position only.
  double variance(double pu, double pv) const;

  /// Posterior mean less the tile's linear trend [1/m] at window coordinates (pu, pv) [px]: the window's pixels, row by
  /// row `stride` floats apart, weighted. The weights depend on the place in the window only and are interpolated
  /// between tabulated ones, a quarter of a pixel apart.
  float residual(const float* pixels, int stride, double pu, double pv) const;

 private:
  CameraModel camera_;
  int tile_;
  int window_;
  double alpha_;
  double prior_variance_;
  double noise_std_;
  // Per place, from half a pixel before the window's first pixel to half a pixel past its last:
  int table_size_{0};                  // places along each axis
  Eigen::MatrixXf weight_table_;       // window^2 x places: (K + s_n^2 I)^-1 k* less what the trend takes
  std::vector<float> variance_table_;  // posterior variance
};

/// One depth image as a continuous function of bearing: inverse range with uncertainty.
class FrameMap {
 public:
  struct Inference {
    double inverse_range;  // posterior mean [1/m]
    double sigma;          // posterior standard deviation [1/m]
    bool smooth;           // the tile fits one surface: no depth edge, mean and normal can be used
  };

  /// Conditions every tile on the frame's inverse ranges.
  FrameMap(std::shared_ptr<const FrameRegressor> regressor, std::shared_ptr<const ClassifiedFrame> frame,
           const DepthNoiseModel& noise, int num_threads);

  /// At pixel coordinates (u, v) inside [0, width - 1] x [0, height - 1].
  Inference infer(double u, double v) const;

  /// infer(u, v).smooth alone, at no cost.
  bool isSmooth(double u, double v) const;

  /// Normal in the camera frame, towards the camera, of the tile's trend at (u, v); good where the tile is smooth.
  Eigen::Vector3f trendNormal(double u, double v) const;

  /// Largest raw inverse range [1/m] of the 5 x 5 pixels round (u, v): the tolerance widens to it at depth edges.
  float nearestAround(int u, int v) const;

  const ClassifiedFrame& frame() const { return *frame_; }
  const FrameRegressor& regressor() const { return *regressor_; }

 private:
  std::size_t tileIndex(double u, double v, int* start_u, int* start_v) const;

  std::shared_ptr<const FrameRegressor> regressor_;
  std::shared_ptr<const ClassifiedFrame> frame_;
  int tiles_u_{0};
  int tiles_v_{0};
  Eigen::Matrix3Xf trend_;    // 3 x tiles
  std::vector<float> scale_;  // noise of the tile over the regressor's
  std::vector<std::uint8_t> smooth_;
};

/// Plane fitted to the raw pixels round one pixel, leaving out what lies across a depth edge.
struct LocalPlane {
  Eigen::Vector3d point_camera;   // on the pixel's ray [m]
  Eigen::Vector3f normal_camera;  // unit, towards the camera
  double depth_std_m;             // of point_camera along the optical axis
  double normal_var;              // variance of each tangential component of the normal
};

/// False when the pixels round (u, v) do not show one surface. `radius_m`: size of the patch on the surface.
bool fitLocalPlane(const ClassifiedFrame& frame, const CameraModel& camera, const DepthNoiseModel& noise, int u, int v,
                   double radius_m, LocalPlane* plane);

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_FRAME_MAP_H
