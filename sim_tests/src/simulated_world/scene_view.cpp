// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/scene_view.h"

#include <cmath>
#include <stdexcept>

#include "synthetic_depth/scene.h"

namespace simulated_world {

cv::Mat renderView(OffscreenRenderer& renderer, const mjData& data, const Eigen::Vector3d& eye_m,
                   const Eigen::Vector3d& target_m, double fovy_rad, int width_px, int height_px, bool has_shadows) {
  if (!(fovy_rad > 0.0 && fovy_rad < M_PI)) {
    throw std::invalid_argument("renderView: fovy_rad = " + std::to_string(fovy_rad) + " rad, must be in (0, pi) rad");
  }
  const double focal_px = 0.5 * height_px / std::tan(0.5 * fovy_rad);
  const synthetic_depth::CameraModel camera{
      width_px, height_px, focal_px, focal_px, 0.5 * (width_px - 1), 0.5 * (height_px - 1)};
  RenderOptions options;
  options.has_shadows = has_shadows;
  options.has_skybox = true;
  cv::Mat rgb;
  renderer.render(data, synthetic_depth::lookAt(eye_m, target_m), camera, options, &rgb, nullptr);
  return rgb;
}

std::string surroundingsAssetsXml() {
  return R"(<texture type="skybox" builtin="gradient" width="256" height="256" rgb1="0.75 0.82 0.90" rgb2="0.42 0.52 0.66"/>
<texture name="ground" type="2d" builtin="checker" width="512" height="512" rgb1="0.60 0.59 0.57" rgb2="0.56 0.55 0.53"
 mark="edge" markrgb="0.50 0.49 0.47"/>
<material name="ground" texture="ground" texrepeat="1 1" texuniform="true" specular="0" reflectance="0"/>
)";
}

std::string surroundingsLightsXml() {
  return R"(<light name="sun" pos="-4 -2 5" dir="0.60 0.30 -0.75" directional="true" castshadow="true"
 ambient="0 0 0" diffuse="0.60 0.59 0.56" specular="0.1 0.1 0.1"/>
)";
}

std::string surroundingsVisualXml() {
  return R"(<headlight ambient="0.36 0.37 0.40" diffuse="0.12 0.12 0.12" specular="0 0 0"/>
<map shadowclip="2.5"/>
)";
}

}  // namespace simulated_world
