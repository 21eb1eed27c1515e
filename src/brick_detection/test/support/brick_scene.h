// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include <Eigen/Geometry>
#include <mp700_ur5e_description/brick_types.h>

#include "brick_detection/brick_pose.h"

namespace brick_detection {

/// Bricks before a camera, with their exact image: no rendering, only projection.
inline CameraModel testCamera() {
  CameraModel camera;
  camera.width_px = 640;
  camera.height_px = 480;
  camera.fx_px = 600.0;
  camera.fy_px = 602.0;
  camera.cx_px = 321.5;
  camera.cy_px = 238.0;
  return camera;
}

inline mp700_ur5e_description::BrickCatalogue testCatalogue() {
  return mp700_ur5e_description::loadBrickTypes(BRICKS_YAML);
}

inline Eigen::Isometry3d makePose(const Eigen::Vector3d& translation, const Eigen::Vector3d& turn = {0, 0, 0}) {
  Vector6d step;
  step << translation, turn;
  return moved(Eigen::Isometry3d::Identity(), step);
}

/// A rotation of any size, each as likely.
inline Eigen::Quaterniond anyRotation(std::mt19937& engine) {
  std::normal_distribution<double> normal;
  Eigen::Quaterniond q(normal(engine), normal(engine), normal(engine), normal(engine));
  return q.normalized();
}

inline Vector6d drawFrom(const Matrix6d& covariance, std::mt19937& engine) {
  std::normal_distribution<double> normal;
  Vector6d white;
  for (int i = 0; i < 6; ++i) white(i) = normal(engine);
  return covariance.llt().matrixL() * white;
}

/// The tag's corners as the camera has them, decoded beyond doubt.
inline TagObservation observe(int tag_id, double edge_m, const Eigen::Isometry3d& T_camera_tag,
                              const CameraModel& camera) {
  TagObservation tag;
  tag.id = tag_id;
  tag.margin = 100.0;
  const std::array<Eigen::Vector3d, 4> corners = tagCorners(edge_m);
  for (std::size_t i = 0; i < 4; ++i) tag.corners_px[i] = camera.project(T_camera_tag * corners[i]);
  return tag;
}

/// The tags of a brick that face the camera by more than `least_facing` (cosine), none hidden by another brick.
inline std::vector<TagObservation> observeBrick(const mp700_ur5e_description::BrickCatalogue& catalogue, int brick_id,
                                                const Eigen::Isometry3d& T_camera_brick, const CameraModel& camera,
                                                double least_facing = 0.15) {
  std::vector<TagObservation> tags;
  for (const auto face : mp700_ur5e_description::kBrickFaces) {
    const int tag_id = catalogue.tagId(brick_id, face);
    const mp700_ur5e_description::BrickTag tag = *catalogue.brickOfTag(tag_id);
    const Eigen::Isometry3d T_camera_tag = T_camera_brick * tag.T_brick_tag;
    const double facing = -T_camera_tag.linear().col(2).dot(T_camera_tag.translation().normalized());
    if (facing > least_facing) tags.push_back(observe(tag_id, tag.black_border_edge_m, T_camera_tag, camera));
  }
  return tags;
}

inline void addCornerNoise(double std_px, std::mt19937& engine, std::vector<TagObservation>* tags) {
  std::normal_distribution<double> normal(0.0, std_px);
  for (TagObservation& tag : *tags) {
    for (Eigen::Vector2d& corner : tag.corners_px) corner += Eigen::Vector2d(normal(engine), normal(engine));
  }
}

/// Distance along the optical axis to a box; infinite where it is missed.
inline double depthOfBox(const Eigen::Isometry3d& T_camera_box, const Eigen::Vector3d& size_m,
                         const Eigen::Vector2d& bearing) {
  const Eigen::Isometry3d T_box_camera = T_camera_box.inverse();
  const Eigen::Vector3d origin = T_box_camera.translation();
  const Eigen::Vector3d direction = T_box_camera.linear() * bearing.homogeneous();
  double enter = 0.0;
  double leave = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    const double a = (-0.5 * size_m(axis) - origin(axis)) / direction(axis);
    const double b = (0.5 * size_m(axis) - origin(axis)) / direction(axis);
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter < leave ? enter : std::numeric_limits<double>::infinity();
}

/// Exact depth image of boxes of one size; nothing elsewhere.
inline cv::Mat depthImage(const std::vector<Eigen::Isometry3d>& T_camera_boxes, const Eigen::Vector3d& size_m,
                          const CameraModel& camera) {
  cv::Mat depth_m(camera.height_px, camera.width_px, CV_32FC1, cv::Scalar(0.0f));
  for (int v = 0; v < camera.height_px; ++v) {
    for (int u = 0; u < camera.width_px; ++u) {
      double nearest = std::numeric_limits<double>::infinity();
      for (const Eigen::Isometry3d& T_camera_box : T_camera_boxes) {
        nearest = std::min(nearest, depthOfBox(T_camera_box, size_m, camera.bearing({u, v})));
      }
      if (std::isfinite(nearest)) depth_m.at<float>(v, u) = static_cast<float>(nearest);
    }
  }
  return depth_m;
}

/// Noise of a stereo camera: even in inverse depth, alike in patches, and one error of scale for the whole image.
inline void addDepthNoise(double inverse_depth_std, int patch_px, double scale, std::mt19937& engine,
                          cv::Mat* depth_m) {
  std::normal_distribution<double> normal(0.0, inverse_depth_std);
  for (int v0 = 0; v0 < depth_m->rows; v0 += patch_px) {
    for (int u0 = 0; u0 < depth_m->cols; u0 += patch_px) {
      const double off = normal(engine);
      for (int v = v0; v < std::min(v0 + patch_px, depth_m->rows); ++v) {
        for (int u = u0; u < std::min(u0 + patch_px, depth_m->cols); ++u) {
          auto& depth = depth_m->at<float>(v, u);
          if (depth > 0.0f) depth = static_cast<float>(scale / (1.0 / depth + off));
        }
      }
    }
  }
}

}  // namespace brick_detection
