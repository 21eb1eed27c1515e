// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace depth_camera {

/// Pinhole model of a rectified depth image: pixel (u, v) sees bearing ((u - cx)/fx, (v - cy)/fy).
struct CameraModel {
  int width{0};   // [px]
  int height{0};  // [px]
  double fx{0.0};
  double fy{0.0};
  double cx{0.0};
  double cy{0.0};

  /// Empty when the model can be used; otherwise one sentence per problem with value and allowed range.
  std::vector<std::string> validate() const;
  /// Direction of a pixel, 1 along the optical axis.
  Eigen::Vector3d ray(double u, double v) const { return {(u - cx) / fx, (v - cy) / fy, 1.0}; }
  bool operator==(const CameraModel& other) const {
    return width == other.width && height == other.height && fx == other.fx && fy == other.fy && cx == other.cx &&
           cy == other.cy;
  }
};

/// Depth along the optical axis [m], row major, REP-117 values: +Inf no return, -Inf too close, NaN no information.
/// 0 is the unexplained hole of 16-bit images; DepthClassifier decides what it is.
struct DepthImage {
  int width{0};
  int height{0};
  std::vector<float> depth_m;

  float at(int u, int v) const { return depth_m[static_cast<std::size_t>(v) * width + u]; }
};

/// Converts raw 16-bit depth (0 = hole, 65535 = the "no value" of some recorders, also a hole).
DepthImage depthImageFromU16(const std::uint16_t* raw, int width, int height, double units_per_metre);

/// Whether any pixel says something: a depth, or "nothing within reach" (+Inf). Zeros, NaN, -Inf and depths below zero
/// are no evidence. An image of these alone comes from a covered lens as well as from an empty scene.
bool holdsMeasurement(const DepthImage& image);

/// The sentence for an image that holds none.
std::string nothingMeasured(const DepthImage& image);

/// Throws std::invalid_argument with both sizes if the image is not of the camera's.
void requireFits(const DepthImage& image, const CameraModel& camera);

}  // namespace depth_camera
