// SPDX-License-Identifier: BSD-3-Clause
#include "support/mapped_scene.h"

#include <cmath>
#include <random>
#include <stdexcept>

#include <gpis_mapping/gpis_map.h>
#include <opencv2/core.hpp>
#include <synthetic_depth/depth_renderer.h>

namespace test_support {
namespace {

/// Nearest root of the ray eye + t ray on the sphere, or infinity.
double hit(const Sphere& sphere, const Eigen::Vector3d& eye, const Eigen::Vector3d& ray) {
  const Eigen::Vector3d d = eye - sphere.center_m;
  const double a = ray.squaredNorm();
  const double b = ray.dot(d);
  const double root = b * b - a * (d.squaredNorm() - sphere.radius_m * sphere.radius_m);
  if (root < 0.0) return INFINITY;
  const double t = (-b - std::sqrt(root)) / a;
  return t > 0.0 ? t : INFINITY;
}

double hit(const Cylinder& cylinder, const Eigen::Vector3d& eye_scene, const Eigen::Vector3d& ray_scene) {
  const Eigen::Isometry3d T = cylinder.T_scene_cylinder.inverse();
  const Eigen::Vector3d eye = T * eye_scene;
  const Eigen::Vector3d ray = T.linear() * ray_scene;
  double nearest = INFINITY;
  const double a = ray.head<2>().squaredNorm();
  const double b = ray.head<2>().dot(eye.head<2>());
  const double root = b * b - a * (eye.head<2>().squaredNorm() - cylinder.radius_m * cylinder.radius_m);
  if (a > 1e-12 && root >= 0.0) {
    const double t = (-b - std::sqrt(root)) / a;
    if (t > 0.0 && std::abs(eye.z() + t * ray.z()) <= cylinder.half_length_m) nearest = t;
  }
  for (const double z : {-cylinder.half_length_m, cylinder.half_length_m}) {
    const double t = (z - eye.z()) / ray.z();
    if (t > 0.0 && (eye + t * ray).head<2>().norm() <= cylinder.radius_m) nearest = std::min(nearest, t);
  }
  return nearest;
}

}  // namespace

void SceneOfSolids::addBox(const Eigen::Vector3d& size_m, const Eigen::Isometry3d& T_scene_box) {
  synthetic_depth::Box box;
  box.id = static_cast<int>(boxes.size());
  box.T_scene_box = T_scene_box;
  box.half_extents_m = 0.5 * size_m;
  boxes.push_back(box);
}

void SceneOfSolids::lookAround(int count, double radius_m, double height_m, double first_rad, double span_rad) {
  const bool is_closed = span_rad > 6.28;
  for (int i = 0; i < count; ++i) {
    const double angle = first_rad + span_rad * i / std::max(1, is_closed ? count : count - 1);
    eyes_m.emplace_back(target_m.x() + radius_m * std::cos(angle), target_m.y() + radius_m * std::sin(angle), height_m);
  }
}

Eigen::Isometry3d pose(double x, double y, double z, double yaw_rad, double pitch_rad, double roll_rad) {
  return synthetic_depth::poseFromXyzRpy({x, y, z}, {roll_rad, pitch_rad, yaw_rad});
}

MappedScene mapScene(const SceneOfSolids& solids) {
  if (solids.eyes_m.empty()) throw std::invalid_argument("a scene needs an eye");
  constexpr int kRounds = 3;
  synthetic_depth::Scene scene;
  scene.boxes = solids.boxes;
  scene.camera = {320, 240, 300.0, 300.0, 159.5, 119.5};
  for (const Eigen::Vector3d& eye : solids.eyes_m) {
    scene.T_scene_camera.push_back(synthetic_depth::lookAt(eye, solids.target_m));
  }
  gpis_mapping::CameraModel camera;
  camera.width = scene.camera.width_px;
  camera.height = scene.camera.height_px;
  camera.fx = camera.fy = scene.camera.fx_px;
  camera.cx = scene.camera.cx_px;
  camera.cy = scene.camera.cy_px;

  std::mt19937_64 engine(solids.seed);
  std::normal_distribution<double> noise(0.0, 0.0038);
  gpis_mapping::GpisConfig config;
  gpis_mapping::GpisMap map(config);
  double stamp_s = 1.0;
  for (int round = 0; round < kRounds; ++round) {
    for (int frame = 0; frame < scene.numFrames(); ++frame) {
      const Eigen::Isometry3d& T = scene.T_scene_camera[static_cast<std::size_t>(frame)];
      const cv::Mat boxes = synthetic_depth::renderDepth(scene, frame);
      gpis_mapping::DepthImage image;
      image.width = camera.width;
      image.height = camera.height;
      for (int v = 0; v < camera.height; ++v) {
        for (int u = 0; u < camera.width; ++u) {
          double depth = boxes.at<float>(v, u);
          const Eigen::Vector3d ray = T.linear() * camera.ray(u, v);
          for (const Sphere& sphere : solids.spheres) depth = std::min(depth, hit(sphere, T.translation(), ray));
          for (const Cylinder& cylinder : solids.cylinders)
            depth = std::min(depth, hit(cylinder, T.translation(), ray));
          image.depth_m.push_back(static_cast<float>(depth));
        }
      }
      if (solids.has_noise) {
        std::vector<double> offsets(static_cast<std::size_t>((camera.width / 2) * (camera.height / 2)));
        for (double& offset : offsets) offset = noise(engine);
        for (int v = 0; v < camera.height; ++v) {
          for (int u = 0; u < camera.width; ++u) {
            float& depth = image.depth_m[static_cast<std::size_t>(v * camera.width + u)];
            if (!std::isfinite(depth)) continue;
            depth = static_cast<float>(
                1.0 / (1.0 / depth + offsets[static_cast<std::size_t>(v / 2 * (camera.width / 2) + u / 2)]));
          }
        }
      }
      Eigen::Isometry3d T_map_camera = scene.cameraInMap(frame);
      if (2 * frame >= scene.numFrames()) T_map_camera.pretranslate(scene.T_map_scene.linear() * solids.drift_m);
      map.update(image, camera, T_map_camera, stamp_s);
      stamp_s += 10.0;  // the camera has moved a metre meanwhile
    }
  }
  MappedScene mapped;
  mapped.snapshot = map.snapshot();
  gpis_mapping::MeshExtractor extractor(map.config());
  extractor.update(*mapped.snapshot);
  mapped.mesh = extractor.mesh();
  mapped.T_map_scene = scene.T_map_scene;
  return mapped;
}

}  // namespace test_support
