// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/scene_view.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <Eigen/Geometry>

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

Viewpoint viewpointOf(const std::vector<Eigen::Vector3d>& points_m, const Eigen::Vector3d& forward, double fovy_rad,
                      double aspect, double margin) {
  if (points_m.empty()) {
    throw std::invalid_argument("viewpointOf: no points, must be one at least");
  }
  if (!(fovy_rad > 0.0 && fovy_rad < M_PI) || !(aspect > 0.0) || !(margin >= 0.0 && margin < 1.0)) {
    throw std::invalid_argument("viewpointOf: fovy_rad = " + std::to_string(fovy_rad) +
                                " rad, aspect = " + std::to_string(aspect) + ", margin = " + std::to_string(margin) +
                                ", must be in (0, pi) rad, > 0, in [0, 1)");
  }
  constexpr double kNearest_m = 0.1;  // from the eye to the nearest point, which else may be in it
  const Eigen::Vector3d z = forward.normalized();
  const Eigen::Vector3d sideways = z.cross(Eigen::Vector3d::UnitZ());
  if (!(sideways.norm() > 1e-6)) {
    throw std::invalid_argument("viewpointOf: forward is vertical or no direction");
  }
  const Eigen::Vector3d x = sideways.normalized();
  const Eigen::Vector3d y = z.cross(x);
  const double tan_y = (1.0 - margin) * std::tan(0.5 * fovy_rad);
  const double tan_x = (1.0 - margin) * std::tan(0.5 * fovy_rad) * aspect;
  // Along each image axis the two borders are planes through the eye. The nearest eye for it is where the planes that
  // touch the points from both sides meet; the farther of both axes' eyes sees all, for going back only widens the view.
  double high_x = -std::numeric_limits<double>::infinity();
  double high_y = high_x;
  double low_x = high_x;
  double low_y = high_x;
  double near_z = std::numeric_limits<double>::infinity();
  for (const Eigen::Vector3d& point : points_m) {
    high_x = std::max(high_x, point.dot(x) - tan_x * point.dot(z));
    low_x = std::max(low_x, -point.dot(x) - tan_x * point.dot(z));
    high_y = std::max(high_y, point.dot(y) - tan_y * point.dot(z));
    low_y = std::max(low_y, -point.dot(y) - tan_y * point.dot(z));
    near_z = std::min(near_z, point.dot(z));
  }
  const double eye_z =
      std::min({-0.5 * (high_x + low_x) / tan_x, -0.5 * (high_y + low_y) / tan_y, near_z - kNearest_m});
  const Eigen::Vector3d eye = 0.5 * (high_x - low_x) * x + 0.5 * (high_y - low_y) * y + eye_z * z;
  double middle_z = 0.0;
  for (const Eigen::Vector3d& point : points_m) {
    middle_z += (point - eye).dot(z) / static_cast<double>(points_m.size());
  }
  return {eye, eye + middle_z * z};
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
