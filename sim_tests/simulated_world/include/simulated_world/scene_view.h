// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>
#include <mujoco/mujoco.h>
#include <opencv2/core.hpp>

#include "simulated_world/offscreen_renderer.h"

namespace simulated_world {

/// Picture of a scene for people: with shadows and sky, image up towards world +z. CV_8UC3 in the order red, green, blue.
/// `fovy_rad` is the vertical field of view. For smooth edges the renderer wants samples = 8. Throws
/// std::invalid_argument if eye and target coincide, the field of view is not in (0, pi), or the renderer is too small.
cv::Mat renderView(OffscreenRenderer& renderer, const mjData& data, const Eigen::Vector3d& eye_m,
                   const Eigen::Vector3d& target_m, double fovy_rad, int width_px, int height_px,
                   bool has_shadows = true);

/// Where to stand for a picture, and what to look at.
struct Viewpoint {
  Eigen::Vector3d eye_m;
  Eigen::Vector3d target_m;
};

/// The nearest viewpoint, 0.1 m before the first point at least, from which all points are in the picture with `margin`
/// (share of its half width and height) to spare, looking along `forward` (any length, not vertical). Throws
/// std::invalid_argument if there is no point, or a number out of range: `fovy_rad` in (0, pi), `aspect` (width / height)
/// > 0, `margin` in [0, 1).
Viewpoint viewpointOf(const std::vector<Eigen::Vector3d>& points_m, const Eigen::Vector3d& forward, double fovy_rad,
                      double aspect, double margin);

/// Surroundings that look well: elements of the asset section (sky, and the material "ground" to be used by the plane) and
/// of the world body (lights), and the visual section that goes with them. Light is daylight from above and aside.
std::string surroundingsAssetsXml();
std::string surroundingsLightsXml();
std::string surroundingsVisualXml();

}  // namespace simulated_world
