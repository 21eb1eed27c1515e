// SPDX-License-Identifier: BSD-3-Clause
#include "support/spoilt_tags.h"

#include <cmath>
#include <random>

namespace brick_detection {

SpoiltTag drawSpoiltTag(Spoilt kind, std::uint32_t seed) {
  std::mt19937 engine(seed);
  const auto uniform = [&engine](double low, double high) {  // std's distributions differ between libraries
    return low + (high - low) * (engine() / 4294967296.0);
  };
  SpoiltTag drawn;
  drawn.camera = {640, 480, 615.0, 615.0, 319.5, 239.5, Distortion::kNone, {}};
  drawn.id = static_cast<int>(uniform(0.0, 587.0));
  const double distance_m = uniform(0.5, 2.0);
  const Eigen::Vector2d pixel(uniform(150.0, 490.0), uniform(130.0, 350.0));
  drawn.T_camera_tag = poseSeenAt(drawn.camera, pixel, distance_m, uniform(0.0, 1.13), uniform(0.0, 2.0 * M_PI),
                                  uniform(0.0, 2.0 * M_PI));
  RenderScene scene;
  scene.camera = drawn.camera;
  constexpr double kBoard_m = 0.2;
  scene.bricks = {tagBoard(drawn.id, drawn.edge_m, kBoard_m, drawn.T_camera_tag)};
  RenderEffects effects;
  effects.noise_std = uniform(1.0, 4.0);
  effects.blur_sigma_px = uniform(0.3, 0.8);
  effects.depth_noise = 0.003;
  effects.depth_noise_px = 4.0;

  constexpr double kCell = 0.125;  // of the edge
  const double side_px = drawn.edge_m / distance_m * drawn.camera.fx_px;
  const double turn_rad = 0.5 * M_PI * std::floor(uniform(0.0, 4.0));  // which side
  const double tone = uniform(0.0, 1.0);
  const double grey = tone < 0.6 ? uniform(0.75, 1.0) : uniform(0.05, 0.75);
  switch (kind) {
    case Spoilt::kClean:
      break;
    case Spoilt::kCover:
    case Spoilt::kTape: {
      const bool is_tape = kind == Spoilt::kTape;
      RenderBox box;
      box.color_rgb.setConstant(grey);
      // A cover reaches in from outside; a tape is narrow, and may lie anywhere.
      const double width_m = is_tape ? uniform(0.1, 1.0) * kCell * drawn.edge_m : 0.1;
      const double reach_m = (is_tape ? uniform(-0.5, 1.5) : uniform(0.1, 1.0)) * kCell * drawn.edge_m;
      box.size_m = {width_m, uniform(0.3, 2.5) * drawn.edge_m, is_tape ? 2e-4 : uniform(2e-4, 5e-3)};
      const double lift_m = 0.5 * box.size_m.z() + 1e-4;
      box.T_camera_box = drawn.T_camera_tag * Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitZ()) *
                         Eigen::Translation3d(0.5 * drawn.edge_m - reach_m, uniform(-0.5, 0.5) * drawn.edge_m, lift_m) *
                         Eigen::AngleAxisd(uniform(-0.3, 0.3) * (is_tape ? 3.0 : 1.0), Eigen::Vector3d::UnitZ()) *
                         Eigen::Translation3d(0.5 * width_m, 0.0, 0.0);
      scene.boxes = {box};
      break;
    }
    case Spoilt::kGlare: {
      const Eigen::Vector3d at(uniform(-0.6, 0.6) * drawn.edge_m, uniform(-0.6, 0.6) * drawn.edge_m, 0.0);
      effects.glare_px = drawn.camera.project(drawn.T_camera_tag * at);
      effects.glare_radius_px = uniform(0.05, 0.5) * side_px;
      effects.glare = uniform(0.2, 2.0);
      break;
    }
    case Spoilt::kBend:
      scene.bricks[0].label_bend_m = uniform(0.005, 0.06) * drawn.edge_m * (uniform(0.0, 1.0) < 0.5 ? -1.0 : 1.0);
      scene.bricks[0].label_bend_axis_rad = uniform(0.0, M_PI);
      break;
    case Spoilt::kShadow: {
      const Eigen::Vector3d at(uniform(-0.6, 0.6) * drawn.edge_m, uniform(-0.6, 0.6) * drawn.edge_m, 0.0);
      effects.shadow_px = drawn.camera.project(drawn.T_camera_tag * at);
      const double angle = uniform(0.0, 2.0 * M_PI);
      effects.shadow_normal = {std::cos(angle), std::sin(angle)};
      effects.shadow_factor = uniform(0.2, 0.7);
      effects.shadow_width_px = uniform(0.5, 6.0);
      break;
    }
  }
  drawn.view = render(scene, effects, seed);
  // The depth image is off as a whole, as a camera's.
  const double scale = 1.0 + 0.002 * std::sqrt(3.0) * uniform(-1.0, 1.0);
  drawn.view.depth_m *= scale;
  return drawn;
}

}  // namespace brick_detection
