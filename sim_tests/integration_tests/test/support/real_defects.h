// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "support/map_on_scene.h"

namespace synthetic_depth {
namespace test {

/// Names for withDefects(). "dark" needs an object of small albedo.
constexpr std::array<const char*, 6> kDefectSets{"ideal", "border_rectangle", "border_hexagon", "dark", "edges", "all"};

/// `sensor` with what real registered depth images of smallCamera()'s size lack. Throws for a name not in kDefectSets.
inline SensorModel withDefects(SensorModel sensor, const std::string& name) {
  const bool is_all = name == "all";
  bool is_known = is_all || name == "ideal";
  const auto has = [&](const char* defect) {
    is_known |= name == defect;
    return is_all || name == defect;
  };
  if (has("border_rectangle")) {  // a Kinect's of the TUM sequences: 34 rows and 35 columns of 640 x 480 px
    sensor.border_top_px = 17;
    sensor.border_right_px = 17;
  }
  if (has("border_hexagon")) sensor.has_hexagonal_view = true;  // the narrow field of view of an Azure Kinect
  if (has("dark")) {
    sensor.min_return_per_m2 = 0.02;  // white, facing the camera: to 7 m; albedo 0.05: to 1.6 m
    sensor.return_flicker = 0.3;
  }
  if (has("edges")) sensor.edge_loss_px = 3.0;
  if (!is_known) throw std::invalid_argument("no set of defects \"" + name + "\"");
  return sensor;
}

constexpr int kDarkBox = 20;

/// A room with a few boxes, one of them (kDarkBox) dark, before a camera that turns 35 degrees to the left, to the right
/// and back in steps of 2.5 degrees. Everything in view is within reach.
inline Scene turningCamera(const std::string& defects) {
  constexpr double kDegree = 3.14159265358979323846 / 180.0;
  const Eigen::Vector3d eye(-0.6, 0.0, 1.2);
  std::vector<double> yaws_deg;
  for (double yaw = 0.0; yaw < 35.0; yaw += 2.5) yaws_deg.push_back(yaw);
  for (double yaw = 35.0; yaw > -35.0; yaw -= 2.5) yaws_deg.push_back(yaw);
  for (double yaw = -35.0; yaw <= 0.0; yaw += 2.5) yaws_deg.push_back(yaw);
  Scene scene = makeLooks({}, {});
  for (const double yaw : yaws_deg) {
    const Eigen::Vector3d sight(std::cos(yaw * kDegree), std::sin(yaw * kDegree), -0.2);
    scene.T_scene_camera.push_back(lookAt(eye, eye + sight));
  }
  scene.boxes = {makeBox(0, {1.65, 0.0, 1.2}, {0.05, 1.7, 1.2}),
                 makeBox(1, {0.0, 1.65, 1.2}, {1.7, 0.05, 1.2}),
                 makeBox(2, {0.0, -1.65, 1.2}, {1.7, 0.05, 1.2}),
                 makeBox(3, {0.9, 0.7, 0.3}, {0.2, 0.15, 0.3}, {0.0, 0.0, 0.4}),
                 makeBox(4, {0.3, -1.1, 0.4}, {0.15, 0.2, 0.4}, {0.0, 0.0, -0.2}),
                 makeBox(kDarkBox, {0.9, -0.2, 0.6}, {0.03, 0.3, 0.6})};
  scene.boxes.back().albedo = 0.05;  // like a monitor; 1.6 m away its front is at the threshold of "dark"
  addAxialNoise(&scene);
  scene.sensor = withDefects(scene.sensor, defects);
  scene.roi = scene.defaultRegion();
  return scene;
}

constexpr int kTakenBox = 1;
constexpr int kTakenAtFrame = 6;

/// A box (kTakenBox) on a table, nothing within reach behind it. The camera moves sideways from -0.1 m to 0.1 m; from
/// kTakenAtFrame on, half way, the box is gone.
inline Scene boxTakenBeforeNothing(const std::string& defects) {
  constexpr int kFrames = 12;
  Scene scene = makeLooks({}, {});
  for (int frame = 0; frame < kFrames; ++frame) {
    const double y = -0.1 + 0.2 * frame / (kFrames - 1);
    scene.T_scene_camera.push_back(lookAt({1.2, y, 0.45}, {0.0, y, 0.15}));
  }
  scene.has_ground = false;
  scene.boxes = {makeBox(0, {0.0, 0.0, -0.05}, {0.3, 0.6, 0.05}),
                 makeBox(kTakenBox, {0.0, 0.0, 0.2}, {0.1, 0.15, 0.2}, {0.0, 0.0, 0.3})};
  scene.boxes[1].vanishes_at_frame = kTakenAtFrame;
  addAxialNoise(&scene);
  scene.sensor = withDefects(scene.sensor, defects);
  scene.roi = scene.defaultRegion();
  return scene;
}

/// A frame as a 16 bit camera delivers it, and the true points (map frame) of every `step_px`-th pixel that it measured,
/// more than 2 px from depth edges; with `box_id`, on that box alone.
struct MeasuredFrame {
  DepthImage image;
  std::vector<Eigen::Vector3d> points_map;
};

inline MeasuredFrame measureFrame(const Scene& scene, int frame, int step_px, const int* box_id = nullptr) {
  constexpr int kMargin_px = 2;
  cv::Mat ids;
  const cv::Mat exact_m = renderDepth(scene, frame, &ids);
  const cv::Mat measured_m = applySensor(scene, frame, exact_m);
  MeasuredFrame result{toDepthImage16(measured_m), {}};
  for (int v = kMargin_px; v < exact_m.rows - kMargin_px; v += step_px) {
    for (int u = kMargin_px; u < exact_m.cols - kMargin_px; u += step_px) {
      const cv::Mat around = ids(cv::Rect(u - kMargin_px, v - kMargin_px, 2 * kMargin_px + 1, 2 * kMargin_px + 1));
      const int id = ids.at<int>(v, u);
      if (!std::isfinite(measured_m.at<float>(v, u)) || cv::countNonZero(around != id) > 0) continue;
      if (box_id != nullptr && id != *box_id) continue;
      const double z = exact_m.at<float>(v, u);
      const CameraModel& c = scene.camera;
      result.points_map.push_back(scene.cameraInMap(frame) *
                                  Eigen::Vector3d((u - c.cx_px) / c.fx_px * z, (v - c.cy_px) / c.fy_px * z, z));
    }
  }
  return result;
}

/// How many of the points lie within `reach_m` of the map's surface.
inline Eigen::Index numOnSurface(const GpisMap& map, const std::vector<Eigen::Vector3d>& points_map, double reach_m) {
  gpis_mapping::QueryOptions options;
  options.variance = false;
  options.threads = 1;
  // NaN, where there is no surface near, is not less.
  return (map.snapshot()->query(asMatrix(points_map), options).euclidean_distance.array() < reach_m).count();
}

}  // namespace test
}  // namespace synthetic_depth
