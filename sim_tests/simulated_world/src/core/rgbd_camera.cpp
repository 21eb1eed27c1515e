// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/rgbd_camera.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <opencv2/imgproc.hpp>

#include "simulated_world/field_section.h"
#include "simulated_world/mujoco_model.h"
#include "simulated_world/stereo_shadow.h"
#include "synthetic_depth/missing_returns.h"
#include "synthetic_depth/seeded_random.h"
#include "synthetic_depth/sensor.h"

namespace simulated_world {
namespace {

constexpr std::size_t kNumDeviates = 1U << 16U;  // a 64-bit draw picks four
// Random streams apart from the depth's, which has one per pixel index.
constexpr std::uint64_t kRgbStream = ~std::uint64_t{0};
constexpr std::uint64_t kExposureStream = kRgbStream - 1;

std::vector<float> albedoOfGeoms(const mjModel& model) {
  std::vector<float> albedo;
  for (int geom = 0; geom < model.ngeom; ++geom) {
    const int material = model.geom_matid[geom];
    const float* rgb = model.geom_rgba + 4 * geom;
    // As MuJoCo draws it: a colour of its own hides the material's, and the default colour stands for none.
    const bool has_colour = rgb[0] != 0.5F || rgb[1] != 0.5F || rgb[2] != 0.5F || rgb[3] != 1.0F;
    if (material >= 0 && !has_colour) rgb = model.mat_rgba + 4 * material;
    albedo.push_back(0.2126F * rgb[0] + 0.7152F * rgb[1] + 0.0722F * rgb[2]);
  }
  return albedo;
}

}  // namespace

void RgbdCameraConfig::fields(RgbdCameraConfig& c, interactive_mapping::Fields& f) {
  synthetic_depth::CameraModel& camera = c.camera;
  f("width_px", camera.width_px, 16, 8192, "px", "width of the colour and the registered depth image");
  f("height_px", camera.height_px, 16, 8192, "px", "height of both");
  f("focal_length_px", camera.fx_px, 10.0, 1e5, "px", "focal length of both");
  camera.fy_px = camera.fx_px;
  camera.cx_px = 0.5 * (camera.width_px - 1);
  camera.cy_px = 0.5 * (camera.height_px - 1);
  f("rgb_noise_std_grey", c.rgb_noise_std_grey, 0.0, 25.0, "",
    "standard deviation of each colour channel, in grey levels of 256");
  f("exposure_std_stops", c.exposure_std_stops, 0.0, 3.0, "",
    "standard deviation of an image's exposure, in powers of 2: some are too dark, some overexposed");
  f("rgb_blur_px", c.rgb_blur_px, 0.0, 10.0, "px", "standard deviation of the colour image's blur by focus and motion");
  fieldSection(f, "sensor", [&] {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    synthetic_depth::SensorModel& sensor = c.sensor;
    f("min_range_m", sensor.min_range_m, 0.0, 1000.0, "m", "nearer is too close: depth is -inf");
    f("max_range_m", sensor.max_range_m, 0.0, kInfinity, "m", "farther is no return: depth is inf");
    f("noise_a_m", sensor.axial_noise_a_m, -1.0, 1.0, "m",
      "axial noise sigma(z) = a + b z + c z^2 [m], z in metres: a");
    f("noise_b", sensor.axial_noise_b, -1.0, 1.0, "m/m", "b");
    f("noise_c_per_m", sensor.axial_noise_c_per_m, -1.0, 1.0, "1/m", "c");
    f("baseline_m", sensor.baseline_m, 0.0, 10.0, "m", "distance of the second viewpoint, along image x");
    f("has_shadows", sensor.has_shadows, "points that the second viewpoint cannot see have no depth");
    f("disparity_step_px", sensor.disparity_step_px, 0.0, 10.0, "px", "step to which disparity is rounded; 0: off");
    f("edge_mixing_fraction", sensor.edge_mixing_fraction, 0.0, 1.0, "",
      "share of the pixels at depth edges that lie between both depths");
    f("dropout_probability", sensor.dropout_probability, 0.0, 1.0, "", "share of pixels lost at random");
    f("lateral_jitter_px", sensor.lateral_jitter_px, 0.0, 10.0, "px",
      "standard deviation of a ray's shift in the image");
    // Something must be left in the middle: half of the image less a pixel.
    const int across = std::max(0, (camera.width_px - 1) / 2);
    const int down = std::max(0, (camera.height_px - 1) / 2);
    f("border_left_px", sensor.border_left_px, 0, across, "px",
      "columns without depth: the colour camera sees more than the depth camera; at most half of the image");
    f("border_right_px", sensor.border_right_px, 0, across, "px", "the same on the right");
    f("border_top_px", sensor.border_top_px, 0, down, "px", "rows without depth");
    f("border_bottom_px", sensor.border_bottom_px, 0, down, "px", "the same at the bottom");
    f("has_hexagonal_view", sensor.has_hexagonal_view, "only a hexagon within these borders has depth");
    f("min_return_per_m2", sensor.min_return_per_m2, 0.0, 100.0, "1/m^2",
      "no depth where albedo cos(incidence) / range^2 is less; 0: off");
    f("return_flicker", sensor.return_flicker, 0.0, 1.0, "", "largest relative change of it from image to image");
    f("edge_loss_px", sensor.edge_loss_px, 0.0, 20.0, "px",
      "widest strip without depth on either side of a depth edge; 0: off");
    f.require(sensor.min_range_m == 0.0 || !(sensor.min_range_m < c.render.near_m),
              "min_range_m must be 0 or at least 0.01 m, where drawing begins");
    f.require(sensor.max_range_m > sensor.min_range_m, "max_range_m must be above sensor/min_range_m");
    f.require(!sensor.has_shadows || sensor.baseline_m > 0.0, "baseline_m must be above 0 m with sensor/has_shadows");
  });
}

std::vector<std::string> RgbdCameraConfig::validate() const {
  std::vector<std::string> problems = interactive_mapping::problemsOf(*this);
  for (const std::string& problem : render.validate()) problems.push_back(problem);
  if (!(std::abs(camera.fx_px - camera.fy_px) <= 1e-6 * std::abs(camera.fx_px))) {
    problems.push_back("camera/fy_px = " + std::to_string(camera.fy_px) + " px, must be equal to camera/fx_px");
  }
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
  if (config.sensor.min_return_per_m2 > 0.0) albedo_of_geom_ = albedoOfGeoms(renderer.model());
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
  expose(frame.rgb, frame_number);
  addNoise(frame.rgb, frame_number);
  cv::Mat shadows;
  if (config_.sensor.has_shadows) {
    shadows = stereoShadowMask(config_.camera, config_.sensor.baseline_m, frame.exact_depth_m);
  }
  frame.depth_m = synthetic_depth::applySensor(config_.camera, config_.sensor, config_.seed, frame_number,
                                               frame.exact_depth_m, shadows, albedo(data));
  return frame;
}

cv::Mat RgbdCamera::albedo(const mjData& data) {
  if (albedo_of_geom_.empty()) {
    return {};
  }
  // Every kStep_px-th ray of the image: all of them would make an image cost half as much again.
  constexpr int kStep_px = 2;
  synthetic_depth::CameraModel coarse = config_.camera;
  coarse.width_px = (coarse.width_px - 1) / kStep_px + 1;
  coarse.height_px = (coarse.height_px - 1) / kStep_px + 1;
  for (double* const length_px : {&coarse.fx_px, &coarse.fy_px, &coarse.cx_px, &coarse.cy_px}) *length_px /= kStep_px;
  cv::Mat geom_ids;
  renderer_.segmentation(data, opticalPose(data), coarse, config_.render, &geom_ids);
  cv::Mat albedo(config_.camera.height_px, config_.camera.width_px, CV_32FC1);
  for (int v = 0; v < albedo.rows; ++v) {
    const int* const geoms = geom_ids.ptr<int>(v / kStep_px);
    float* const to = albedo.ptr<float>(v);
    for (int u = 0; u < albedo.cols; ++u) {
      const int geom = geoms[u / kStep_px];
      to[u] = geom < 0 ? 1.0F : albedo_of_geom_[static_cast<std::size_t>(geom)];
    }
  }
  return albedo;
}

void RgbdCamera::expose(cv::Mat& rgb, std::uint64_t frame_number) const {
  if (config_.rgb_blur_px > 0.0) {
    cv::GaussianBlur(rgb, rgb, cv::Size(), config_.rgb_blur_px);
  }
  if (config_.exposure_std_stops > 0.0) {
    synthetic_depth::SeededRandom random(config_.seed, frame_number, kExposureStream);
    rgb.convertTo(rgb, -1, std::exp2(config_.exposure_std_stops * random.normal()));
  }
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
