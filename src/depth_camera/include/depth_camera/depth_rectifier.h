// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "depth_camera/depth_image.h"

namespace depth_camera {

/// Lens distortion with the names and the order of sensor_msgs/CameraInfo.
struct LensDistortion {
  std::string model;  // plumb_bob (4 or 5), rational_polynomial (8, 12 or 14), equidistant or fisheye (4 coefficients)
  std::vector<double> coefficients;

  /// Whether all coefficients are 0, or there are none. The model's name does not matter then.
  bool isZero() const;
  bool operator==(const LensDistortion& other) const {
    return model == other.model && coefficients == other.coefficients;
  }
};

/// Resamples depth images of one camera with lens distortion to those of an ideal pinhole in the same place. Its focal
/// length is that of the raw image. Its size and centre are such that it covers all that the raw image sees, within two
/// bounds. These are 68 degrees from the optical axis, and half the raw image's size beyond each of its borders.
/// Without distortion it hands through what it gets. All functions are const and safe from several threads.
class DepthRectifier {
 public:
  /// A camera that sees nothing yet.
  DepthRectifier() = default;
  /// `raw`: the camera matrix of the raw image. Makes tables of 8 bytes per pixel, once. Throws std::invalid_argument
  /// when the model or its number of coefficients is unknown, or two bearings would share a pixel of the raw image.
  DepthRectifier(const CameraModel& raw, const LensDistortion& distortion);

  const CameraModel& rawCamera() const { return raw_; }
  const LensDistortion& distortion() const { return distortion_; }
  /// The pinhole of rectified images.
  const CameraModel& camera() const { return camera_; }

  /// `raw` as the pinhole sees it. NaN where the raw image does not reach. Values that are no depth (0, NaN, +-Inf) are
  /// handed on and never blended. Throws std::invalid_argument when the size is not that of rawCamera().
  DepthImage rectify(DepthImage raw) const;

 private:
  float sample(const DepthImage& raw, float u, float v) const;

  CameraModel raw_;
  LensDistortion distortion_;
  CameraModel camera_;
  float max_spread_{0.0f};                  // of the depths of neighbours on one surface, as a share of the depth
  std::vector<float> raw_u_px_, raw_v_px_;  // for each rectified pixel; NaN outside the raw image; empty: no distortion
};

}  // namespace depth_camera
