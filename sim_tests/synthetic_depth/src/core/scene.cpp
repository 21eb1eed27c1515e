// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/scene.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>
#include <stdexcept>

#include "synthetic_depth/missing_returns.h"

namespace synthetic_depth {
namespace {

/// Same texts as the loader's range checks, for scenes that were not loaded from a file.
class Problems {
 public:
  template <typename Value>
  void check(bool is_good, const std::string& key, const Value& value, const std::string& rule) {
    if (!is_good) {
      std::ostringstream text;
      text << key << " = " << value << ", must be " << rule;
      lines_.push_back(text.str());
    }
  }
  void add(const std::vector<std::string>& lines) { lines_.insert(lines_.end(), lines.begin(), lines.end()); }
  std::vector<std::string> take() { return std::move(lines_); }

 private:
  std::vector<std::string> lines_;
};

std::string toText(const Eigen::Vector3d& v) {
  std::ostringstream text;
  text << "[" << v.x() << ", " << v.y() << ", " << v.z() << "]";
  return text.str();
}

}  // namespace

SensorModel SensorModel::withoutNoise() const {
  SensorModel clean;
  clean.min_range_m = min_range_m;
  clean.max_range_m = max_range_m;
  return clean;
}

Eigen::Isometry3d poseFromXyzRpy(const Eigen::Vector3d& xyz_m, const Eigen::Vector3d& rpy_rad) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = (Eigen::AngleAxisd(rpy_rad.z(), Eigen::Vector3d::UnitZ()) *
                   Eigen::AngleAxisd(rpy_rad.y(), Eigen::Vector3d::UnitY()) *
                   Eigen::AngleAxisd(rpy_rad.x(), Eigen::Vector3d::UnitX()))
                      .toRotationMatrix();
  pose.translation() = xyz_m;
  return pose;
}

Eigen::Isometry3d defaultMapScenePose() {
  return poseFromXyzRpy({0.0137, -0.0213, 0.0171}, Eigen::Vector3d(2.3, -1.7, 7.0) * M_PI / 180.0);
}

Eigen::Isometry3d lookAt(const Eigen::Vector3d& eye_m, const Eigen::Vector3d& target_m) {
  const Eigen::Vector3d sight = target_m - eye_m;
  if (!(sight.norm() > 1e-9)) {
    throw std::invalid_argument("lookAt: eye and target are the same point " + toText(eye_m));
  }
  const Eigen::Vector3d forward = sight.normalized();
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  if (forward.cross(up).norm() < 1e-6) {
    up = Eigen::Vector3d::UnitX();
  }
  const Eigen::Vector3d right = forward.cross(up).normalized();
  Eigen::Isometry3d T_scene_camera = Eigen::Isometry3d::Identity();
  T_scene_camera.linear().col(0) = right;
  T_scene_camera.linear().col(1) = forward.cross(right);
  T_scene_camera.linear().col(2) = forward;
  T_scene_camera.translation() = eye_m;
  return T_scene_camera;
}

std::vector<Eigen::Isometry3d> orbitPoses(const OrbitConfig& config) {
  std::vector<Eigen::Isometry3d> poses;
  poses.reserve(static_cast<std::size_t>(std::max(0, config.frames)));
  for (int frame = 0; frame < config.frames; ++frame) {
    const double angle = config.start_angle_rad + 2.0 * M_PI * config.turns * frame / config.frames;
    const Eigen::Vector3d eye(config.look_at_m.x() + config.radius_m * std::cos(angle),
                              config.look_at_m.y() + config.radius_m * std::sin(angle), config.height_m);
    poses.push_back(lookAt(eye, config.look_at_m));
  }
  return poses;
}

Eigen::Isometry3d Scene::cameraInMap(int frame) const {
  if (frame < 0 || frame >= numFrames()) {
    throw std::out_of_range("frame = " + std::to_string(frame) + ", must be in [0, " + std::to_string(numFrames()) +
                            ")");
  }
  return T_map_scene * T_scene_camera[static_cast<std::size_t>(frame)];
}

std::vector<Box> Scene::boxesAt(int frame) const {
  std::vector<Box> present;
  std::copy_if(boxes.begin(), boxes.end(), std::back_inserter(present),
               [frame](const Box& box) { return box.isPresent(frame); });
  return present;
}

std::vector<int> Scene::removedIds() const {
  std::vector<int> ids;
  for (const Box& box : boxes) {
    if (box.vanishes_at_frame < numFrames()) {
      ids.push_back(box.id);
    }
  }
  std::sort(ids.begin(), ids.end());
  return ids;
}

int Scene::firstRemovalFrame() const {
  int first = kNever;
  for (const Box& box : boxes) {
    if (box.vanishes_at_frame < numFrames()) {
      first = std::min(first, box.vanishes_at_frame);
    }
  }
  return first;
}

Region Scene::defaultRegion() const {
  constexpr double kMargin_m = 0.3;
  constexpr double kBelowGround_m = 0.05;
  Eigen::AlignedBox3d hull(Eigen::Vector3d(0.0, 0.0, 0.0));
  if (!boxes.empty()) {
    hull.setEmpty();
  }
  for (const Box& box : boxes) {
    const Eigen::Vector3d reach = box.T_scene_box.linear().cwiseAbs() * box.half_extents_m;
    hull.extend(Eigen::Vector3d(box.T_scene_box.translation() - reach));
    hull.extend(Eigen::Vector3d(box.T_scene_box.translation() + reach));
  }
  Region region;
  region.min_m = hull.min() - Eigen::Vector3d::Constant(kMargin_m);
  region.max_m = hull.max() + Eigen::Vector3d::Constant(kMargin_m);
  if (has_ground) {
    region.min_m.z() = -kBelowGround_m;
  }
  return region;
}

std::vector<std::string> Scene::validate() const {
  Problems problems;
  problems.check(camera.width_px > 0 && camera.width_px <= 10000, "camera/width_px", camera.width_px,
                 "in [1, 10000] px");
  problems.check(camera.height_px > 0 && camera.height_px <= 10000, "camera/height_px", camera.height_px,
                 "in [1, 10000] px");
  problems.check(camera.fx_px > 0.0, "camera/fx_px", camera.fx_px, "> 0 px");
  problems.check(camera.fy_px > 0.0, "camera/fy_px", camera.fy_px, "> 0 px");
  problems.check(fps > 0.0, "trajectory/fps", fps, "> 0 Hz");
  problems.check(!T_scene_camera.empty(), "trajectory/frames", T_scene_camera.size(), ">= 1");

  std::set<int> seen_ids;
  for (const Box& box : boxes) {
    const std::string key = "box " + std::to_string(box.id);
    problems.check(box.id >= 0, key + "/id", box.id, ">= 0");
    problems.check(seen_ids.insert(box.id).second, key + "/id", box.id, "unique");
    problems.check(box.half_extents_m.allFinite() && (box.half_extents_m.array() > 0.0).all(), key + "/half_extents_m",
                   toText(box.half_extents_m), "> 0 m");
    problems.check(box.albedo >= 0.0 && box.albedo <= 1.0, key + "/albedo", box.albedo, "in [0, 1]");
    problems.check(box.appears_at_frame < box.vanishes_at_frame, key + "/appears_at_frame", box.appears_at_frame,
                   "before the frame it vanishes at (" + std::to_string(box.vanishes_at_frame) + ")");
  }

  problems.check(sensor.min_range_m >= 0.0, "sensor/min_range_m", sensor.min_range_m, ">= 0 m");
  problems.check(sensor.max_range_m > sensor.min_range_m, "sensor/max_range_m", sensor.max_range_m,
                 "> min_range_m (" + std::to_string(sensor.min_range_m) + ") m");
  problems.check(sensor.baseline_m > 0.0 || !(sensor.has_shadows || sensor.disparity_step_px > 0.0),
                 "sensor/baseline_m", sensor.baseline_m, "> 0 m when has_shadows or disparity_step_px is set");
  problems.check(sensor.edge_threshold_m > 0.0, "sensor/edge_threshold_m", sensor.edge_threshold_m, "> 0 m");
  problems.check(sensor.edge_mixing_fraction >= 0.0 && sensor.edge_mixing_fraction <= 1.0,
                 "sensor/edge_mixing_fraction", sensor.edge_mixing_fraction, "in [0, 1]");
  problems.check(sensor.dropout_probability >= 0.0 && sensor.dropout_probability <= 1.0, "sensor/dropout_probability",
                 sensor.dropout_probability, "in [0, 1]");
  problems.check(sensor.lateral_jitter_px >= 0.0, "sensor/lateral_jitter_px", sensor.lateral_jitter_px, ">= 0 px");
  problems.check(sensor.disparity_step_px >= 0.0, "sensor/disparity_step_px", sensor.disparity_step_px, ">= 0 px");
  problems.add(missingReturnProblems(camera, sensor));
  problems.check((roi.min_m.array() <= roi.max_m.array()).all(), "roi/min_m", toText(roi.min_m),
                 "<= max_m " + toText(roi.max_m) + " m");

  // A camera inside something solid would see it from within, which no real camera does.
  for (int frame = 0; frame < numFrames(); ++frame) {
    const Eigen::Vector3d eye = T_scene_camera[static_cast<std::size_t>(frame)].translation();
    bool is_inside = has_ground && eye.z() <= 0.0;
    for (const Box& box : boxes) {
      const Eigen::Vector3d eye_in_box = box.T_scene_box.inverse(Eigen::Isometry) * eye;
      is_inside =
          is_inside || (box.isPresent(frame) && (eye_in_box.cwiseAbs().array() <= box.half_extents_m.array()).all());
    }
    if (is_inside) {
      problems.check(false, "trajectory: camera at frame " + std::to_string(frame), toText(eye) + " m",
                     "outside every box and above the ground");
      break;  // the first one tells enough
    }
  }
  return problems.take();
}

}  // namespace synthetic_depth
