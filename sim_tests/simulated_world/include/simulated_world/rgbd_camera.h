// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>
#include <opencv2/core.hpp>

#include "simulated_world/offscreen_renderer.h"
#include "synthetic_depth/scene.h"

namespace simulated_world {

struct RgbdCameraConfig {
  synthetic_depth::CameraModel camera;  ///< of both images: depth is registered to colour. fx = fy
  synthetic_depth::SensorModel sensor;
  double rgb_noise_std_grey{0.0};
  double exposure_std_stops{0.0};  ///< of each image: its colours are multiplied by a power of 2
  double rgb_blur_px{0.0};         ///< standard deviation of a Gaussian, by focus and motion
  RenderOptions render;
  std::uint64_t seed{1};  ///< of all noise

  /// Parameters have square pixels and the principal point in the middle.
  static void fields(RgbdCameraConfig& c, interactive_mapping::Fields& f);

  std::vector<std::string> validate() const;
};

/// RGB-D camera at a named camera of the model, of which the pose alone is used. What a geom sends back of the sensor's
/// light is the luminance of its colour, or of its material's (Rec. 709); textures do not count, outlines are within a pixel.
class RgbdCamera {
 public:
  struct Frame {
    cv::Mat rgb;            ///< CV_8UC3, order red, green, blue
    cv::Mat depth_m;        ///< CV_32FC1, REP-117: NaN no measurement, -Inf too close, +Inf nothing within range
    cv::Mat exact_depth_m;  ///< CV_32FC1 before the sensor's effects; +Inf where nothing is seen
  };

  /// The renderer must outlive the camera. Throws std::invalid_argument for a bad config or an unknown camera name.
  RgbdCamera(OffscreenRenderer& renderer, const std::string& camera_name, const RgbdCameraConfig& config);

  /// Noise is fixed by the seed and the frame number, whatever was captured before. See OffscreenRenderer::render() for
  /// what is asked of `data`, and of the thread.
  Frame capture(const mjData& data, std::uint64_t frame_number);

  /// T_world_camera of the optical frame (z forward, x right, y down).
  Eigen::Isometry3d opticalPose(const mjData& data) const;

  const RgbdCameraConfig& config() const { return config_; }

 private:
  void expose(cv::Mat& rgb, std::uint64_t frame_number) const;
  void addNoise(cv::Mat& rgb, std::uint64_t frame_number) const;
  cv::Mat albedo(const mjData& data);

  OffscreenRenderer& renderer_;
  RgbdCameraConfig config_;
  int camera_id_;
  std::vector<float> albedo_of_geom_;  // empty if it does not matter
  std::vector<std::int8_t>
      noise_grey_;  // normal deviates to pick from: drawing each anew would cost more than rendering
};

}  // namespace simulated_world
