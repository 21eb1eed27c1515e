// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/rgbd_camera.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "simulated_world/mujoco_model.h"
#include "simulated_world/stereo_shadow.h"
#include "synthetic_depth/seeded_random.h"
#include "synthetic_depth/sensor.h"

namespace simulated_world {
namespace {

constexpr std::size_t kNumDeviates = 1U << 16U;  // a 64-bit draw picks four
// Random streams apart from the depth's, which has one per pixel index.
constexpr std::uint64_t kRgbStream = ~std::uint64_t{0};

}  // namespace

std::vector<std::string> RgbdCameraConfig::validate() const {
  std::vector<std::string> problems = render.validate();
  const auto require = [&problems](bool is_good, const char* key, double value, const char* unit, const char* allowed) {
    if (!is_good) {
      problems.push_back(std::string(key) + " = " + std::to_string(value) + unit + ", must be " + allowed);
    }
  };
  require(camera.width_px > 0, "camera/width_px", camera.width_px, " px", "> 0 px");
  require(camera.height_px > 0, "camera/height_px", camera.height_px, " px", "> 0 px");
  require(camera.fx_px > 0.0 && std::isfinite(camera.fx_px), "camera/fx_px", camera.fx_px, " px", "> 0 px");
  require(std::abs(camera.fx_px - camera.fy_px) <= 1e-6 * std::abs(camera.fx_px), "camera/fy_px", camera.fy_px, " px",
          "equal to camera/fx_px");
  require(sensor.min_range_m >= render.near_m || sensor.min_range_m == 0.0, "sensor/min_range_m", sensor.min_range_m,
          " m", "0 or at least render/near_m");
  require(sensor.max_range_m > sensor.min_range_m, "sensor/max_range_m", sensor.max_range_m, " m",
          "> sensor/min_range_m");
  require(sensor.baseline_m >= 0.0 && std::isfinite(sensor.baseline_m), "sensor/baseline_m", sensor.baseline_m, " m",
          ">= 0 m");
  require(!sensor.has_shadows || sensor.baseline_m > 0.0, "sensor/baseline_m", sensor.baseline_m, " m",
          "> 0 m with has_shadows");
  require(rgb_noise_std_grey >= 0.0 && rgb_noise_std_grey <= 25.0, "rgb_noise_std_grey", rgb_noise_std_grey, "",
          "in [0, 25]");
  return problems;
}

RgbdCamera::RgbdCamera(OffscreenRenderer& renderer, const std::string& camera_name, const RgbdCameraConfig& config)
    : renderer_(renderer), config_(config), camera_id_(requireId(renderer.model(), mjOBJ_CAMERA, camera_name)) {
  const std::vector<std::string> problems = config.validate();
  if (!problems.empty()) {
    std::string message = "camera \"" + camera_name + "\":";
    for (const std::string& problem : problems) {
      message += "\n  " + problem;
    }
    throw std::invalid_argument(message);
  }
  if (config.rgb_noise_std_grey > 0.0) {
    synthetic_depth::SeededRandom random(config.seed, kRgbStream, kRgbStream);
    noise_grey_.resize(kNumDeviates);
    std::generate(noise_grey_.begin(), noise_grey_.end(), [&] {
      const double grey = std::round(config_.rgb_noise_std_grey * random.normal());
      return static_cast<std::int8_t>(std::clamp(grey, -127.0, 127.0));
    });
  }
}

Eigen::Isometry3d RgbdCamera::opticalPose(const mjData& data) const {
  using RowMajor = Eigen::Matrix<mjtNum, 3, 3, Eigen::RowMajor>;
  Eigen::Isometry3d T_world_camera = Eigen::Isometry3d::Identity();
  T_world_camera.translation() = Eigen::Map<const Eigen::Vector3d>(data.cam_xpos + 3 * camera_id_);
  // MuJoCo's cameras look along -z with y up.
  T_world_camera.linear() =
      Eigen::Map<const RowMajor>(data.cam_xmat + 9 * camera_id_) * Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal();
  return T_world_camera;
}

RgbdCamera::Frame RgbdCamera::capture(const mjData& data, std::uint64_t frame_number) {
  Frame frame;
  renderer_.render(data, opticalPose(data), config_.camera, config_.render, &frame.rgb, &frame.exact_depth_m);
  addNoise(frame.rgb, frame_number);
  cv::Mat shadows;
  if (config_.sensor.has_shadows) {
    shadows = stereoShadowMask(config_.camera, config_.sensor.baseline_m, frame.exact_depth_m);
  }
  frame.depth_m = synthetic_depth::applySensor(config_.camera, config_.sensor, config_.seed, frame_number,
                                               frame.exact_depth_m, shadows);
  return frame;
}

void RgbdCamera::addNoise(cv::Mat& rgb, std::uint64_t frame_number) const {
  if (noise_grey_.empty()) {
    return;
  }
  synthetic_depth::SeededRandom random(config_.seed, frame_number, kRgbStream);
  for (int v = 0; v < rgb.rows; ++v) {
    unsigned char* value = rgb.ptr<unsigned char>(v);
    for (int u = 0; u < rgb.cols; ++u) {
      std::uint64_t draw = random.next();
      for (int channel = 0; channel < 3; ++channel, ++value) {
        *value = cv::saturate_cast<unsigned char>(*value + noise_grey_[draw % kNumDeviates]);
        draw /= kNumDeviates;
      }
    }
  }
}

}  // namespace simulated_world
