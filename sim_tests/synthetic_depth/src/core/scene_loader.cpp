// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/scene_loader.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/files/yaml_map.h>

#include "synthetic_depth/pile.h"

namespace synthetic_depth {
namespace {

using interactive_mapping::Interval;
using interactive_mapping::YamlMap;

// Anything larger is a slip of units rather than a scene to be scanned by a depth camera.
const Interval kPosition{-1000.0, 1000.0, "m"};
const Interval kLength{0.0, 1000.0, "m", true};
const Interval kAngle{-6.2832, 6.2832, "rad"};
const Interval kFrame{0.0, 1e6, ""};

/// `{xyz_m, rpy_rad | quaternion_xyzw | yaw_rad}` of `section`; not finished, so that callers may have more keys.
Eigen::Isometry3d readPose(YamlMap& section, const Eigen::Isometry3d& fallback) {
  int num_orientations = 0;
  for (const char* key : {"rpy_rad", "quaternion_xyzw", "yaw_rad"}) {
    num_orientations += section.has(key) ? 1 : 0;
  }
  if (num_orientations > 1) {
    section.note("", "several orientations", "given by one of rpy_rad, quaternion_xyzw, yaw_rad");
  }
  Eigen::Isometry3d pose = fallback;
  const Eigen::Vector3d rpy = section.numbers("rpy_rad", Eigen::Vector3d::Zero(), kAngle);
  const Eigen::Vector4d xyzw = section.numbers("quaternion_xyzw", Eigen::Vector4d(0.0, 0.0, 0.0, 1.0), {-1.0, 1.0});
  const double yaw = section.number("yaw_rad", 0.0, kAngle);
  if (section.has("quaternion_xyzw")) {
    // Six decimals are common in files; farther from unit length than that is a slip.
    if (std::abs(xyzw.norm() - 1.0) > 1e-3) {
      section.note("quaternion_xyzw", "of length " + std::to_string(xyzw.norm()), "of length 1 (+- 0.001)");
    } else {
      pose.linear() = Eigen::Quaterniond(xyzw[3], xyzw[0], xyzw[1], xyzw[2]).normalized().toRotationMatrix();
    }
  } else if (section.has("rpy_rad")) {
    pose.linear() = poseFromXyzRpy(Eigen::Vector3d::Zero(), rpy).linear();
  } else if (section.has("yaw_rad")) {
    pose.linear() = poseFromXyzRpy(Eigen::Vector3d::Zero(), {0.0, 0.0, yaw}).linear();
  }
  pose.translation() = section.numbers("xyz_m", Eigen::Vector3d(fallback.translation()), kPosition);
  return pose;
}

CameraModel readCamera(YamlMap section) {
  const Interval focal{0.0, 1e5, "px", true};
  const Interval size{1, 10000, "px"};
  CameraModel camera;
  camera.width_px = section.integer("width_px", camera.width_px, size);
  camera.height_px = section.integer("height_px", camera.height_px, size);
  camera.fx_px = section.number("fx_px", camera.fx_px, focal);
  camera.fy_px = section.number("fy_px", camera.fx_px, focal);
  camera.cx_px = section.number("cx_px", 0.5 * (camera.width_px - 1), {-1e5, 1e5, "px"});
  camera.cy_px = section.number("cy_px", 0.5 * (camera.height_px - 1), {-1e5, 1e5, "px"});
  section.finish();
  return camera;
}

bool readLook(YamlMap& section, Eigen::Isometry3d& T_scene_camera) {
  section.require("eye_m", "3 numbers");
  section.require("target_m", "3 numbers");
  const Eigen::Vector3d eye = section.numbers("eye_m", Eigen::Vector3d(0.0, 0.0, 1.0), kPosition);
  const Eigen::Vector3d target = section.numbers("target_m", Eigen::Vector3d::Zero(), kPosition);
  if ((target - eye).norm() < 1e-6) {
    section.note("target_m", "eye_m", "another point than eye_m");
    return false;
  }
  T_scene_camera = lookAt(eye, target);
  return true;
}

void readTrajectory(YamlMap section, Scene& scene) {
  section.require("type", "one of: looks, orbit, static");
  const std::string type = section.choice("type", {"orbit", "looks", "static"}, "");
  scene.fps = section.number("fps", scene.fps, {0.0, 1000.0, "Hz", true});
  scene.start_time_s = section.number("start_time_s", scene.start_time_s, {0.0, 4e9, "s"});
  const Interval num_frames{1, 100000};
  if (type == "orbit") {
    OrbitConfig orbit;
    orbit.radius_m = section.number("radius_m", orbit.radius_m, kLength);
    orbit.height_m = section.number("height_m", orbit.height_m, kPosition);
    orbit.look_at_m = section.numbers("look_at_m", orbit.look_at_m, kPosition);
    orbit.turns = section.number("turns", orbit.turns, {-1000.0, 1000.0});
    orbit.start_angle_rad = section.number("start_angle_rad", orbit.start_angle_rad, kAngle);
    orbit.frames = section.integer("frames", orbit.frames, num_frames);
    scene.T_scene_camera = orbitPoses(orbit);
  } else if (type == "looks") {
    section.require("looks", "a list of {eye_m, target_m}");
    for (YamlMap& look : section.optionalMaps("looks")) {
      Eigen::Isometry3d pose;
      if (readLook(look, pose)) {
        scene.T_scene_camera.push_back(pose);
      }
      look.finish();
    }
  } else if (type == "static") {
    const int frames = section.integer("frames", 1, num_frames);
    Eigen::Isometry3d pose;
    if (readLook(section, pose)) {
      scene.T_scene_camera.assign(static_cast<std::size_t>(frames), pose);
    }
  } else {
    return;  // the keys depend on the type, so none can be called unknown
  }
  section.finish();
}

SensorModel readSensor(YamlMap section) {
  SensorModel sensor;
  sensor.min_range_m = section.number("min_range_m", sensor.min_range_m, {0.0, 1000.0, "m"});
  sensor.max_range_m = section.number("max_range_m", sensor.max_range_m, kLength);
  sensor.axial_noise_a_m = section.number("axial_noise_a_m", sensor.axial_noise_a_m, {-1.0, 1.0, "m"});
  sensor.axial_noise_b = section.number("axial_noise_b", sensor.axial_noise_b, {-1.0, 1.0});
  sensor.axial_noise_c_per_m = section.number("axial_noise_c_per_m", sensor.axial_noise_c_per_m, {-1.0, 1.0, "1/m"});
  sensor.baseline_m = section.number("baseline_m", sensor.baseline_m, {0.0, 10.0, "m"});
  sensor.has_shadows = section.flag("has_shadows", sensor.has_shadows);
  sensor.disparity_step_px = section.number("disparity_step_px", sensor.disparity_step_px, {0.0, 10.0, "px"});
  sensor.edge_mixing_fraction = section.number("edge_mixing_fraction", sensor.edge_mixing_fraction, {0.0, 1.0});
  sensor.edge_threshold_m = section.number("edge_threshold_m", sensor.edge_threshold_m, kLength);
  sensor.dropout_probability = section.number("dropout_probability", sensor.dropout_probability, {0.0, 1.0});
  sensor.lateral_jitter_px = section.number("lateral_jitter_px", sensor.lateral_jitter_px, {0.0, 10.0, "px"});
  const Interval border{0, 5000, "px"};  // half of the image at most is Scene::validate()'s to check
  sensor.border_left_px = section.integer("border_left_px", sensor.border_left_px, border);
  sensor.border_right_px = section.integer("border_right_px", sensor.border_right_px, border);
  sensor.border_top_px = section.integer("border_top_px", sensor.border_top_px, border);
  sensor.border_bottom_px = section.integer("border_bottom_px", sensor.border_bottom_px, border);
  sensor.has_hexagonal_view = section.flag("has_hexagonal_view", sensor.has_hexagonal_view);
  sensor.min_return_per_m2 = section.number("min_return_per_m2", sensor.min_return_per_m2, {0.0, 100.0, "1/m^2"});
  sensor.return_flicker = section.number("return_flicker", sensor.return_flicker, {0.0, 1.0});
  sensor.edge_loss_px = section.number("edge_loss_px", sensor.edge_loss_px, {0.0, 20.0, "px"});
  section.finish();
  return sensor;
}

Box readBox(YamlMap& section) {
  Box box;
  section.require("id", "an integer");
  section.require("half_extents_m", "3 numbers");
  section.require("xyz_m", "3 numbers");
  box.id = section.integer("id", 0, {0, 1e9});
  box.half_extents_m = section.numbers("half_extents_m", box.half_extents_m, kLength);
  box.albedo = section.number("albedo", box.albedo, {0.0, 1.0});
  box.T_scene_box = readPose(section, Eigen::Isometry3d::Identity());
  section.finish();
  return box;
}

/// A change after the last frame would be no change at all: most likely the trajectory is shorter than meant.
Interval frameOf(const Scene& scene) {
  return scene.numFrames() > 0 ? Interval{0.0, static_cast<double>(scene.numFrames() - 1)}
                               : kFrame;  // no frames: reported elsewhere
}

std::vector<Box> readPile(YamlMap section, int first_id, const Interval& frame_range) {
  PileConfig pile;
  pile.first_id = first_id;
  pile.seed = section.seed("seed", pile.seed);
  pile.brick_size_m = section.numbers("brick_size_m", pile.brick_size_m, kLength);
  pile.center_m = section.numbers("center_m", pile.center_m, kPosition);
  pile.extent_m = section.number("extent_m", pile.extent_m, kLength);
  pile.height_m = section.number("height_m", pile.height_m, kLength);
  pile.max_bricks = section.integer("max_bricks", pile.max_bricks, {1, 10000});
  pile.remove_topmost = section.integer("remove_topmost", pile.remove_topmost, {0, 10000});
  if (pile.remove_topmost > 0) {
    section.require("remove_at_frame", "an integer when remove_topmost > 0");
  }
  pile.remove_at_frame = section.integer("remove_at_frame", pile.remove_at_frame, frame_range);
  section.finish();
  return makePile(pile);
}

void readChanges(YamlMap& root, Scene& scene) {
  for (YamlMap& change : root.optionalMaps("changes")) {
    change.require("frame", "an integer");
    const int frame = change.integer("frame", 0, frameOf(scene));
    if (!change.has("remove") && !change.has("appear")) {
      change.note("", "without effect", "one with remove or appear");
    }
    for (const bool is_removal : {true, false}) {
      const std::string key = is_removal ? "remove" : "appear";
      for (const int id : change.optionalIntegers(key, {0, 1e9})) {
        bool is_known = false;
        for (Box& box : scene.boxes) {
          if (box.id == id) {
            is_known = true;
            (is_removal ? box.vanishes_at_frame : box.appears_at_frame) = frame;
          }
        }
        if (!is_known) {
          change.note(key, std::to_string(id), "the id of a box of this scene");
        }
      }
    }
    change.finish();
  }
}

}  // namespace

Scene parseScene(const std::string& text, const std::string& name) {
  Scene scene;
  interactive_mapping::readYaml(text, name, [&](YamlMap& root, std::vector<std::string>& problems) {
    root.require("trajectory", "a map");
    scene.seed = root.seed("seed", scene.seed);
    scene.has_ground = root.flag("has_ground", scene.has_ground);
    YamlMap map_pose = root.optionalMap("T_map_scene");
    scene.T_map_scene = readPose(map_pose, defaultMapScenePose());
    map_pose.finish();
    scene.camera = readCamera(root.optionalMap("camera"));
    readTrajectory(root.optionalMap("trajectory"), scene);
    scene.sensor = readSensor(root.optionalMap("sensor"));
    int next_id = 0;
    std::set<int> ids;
    for (YamlMap& section : root.optionalMaps("boxes")) {
      scene.boxes.push_back(readBox(section));
      if (!ids.insert(scene.boxes.back().id).second) {
        section.note("id", std::to_string(scene.boxes.back().id), "unique");
      }
      next_id = std::max(next_id, scene.boxes.back().id + 1);
    }
    if (root.has("pile")) {
      try {
        const std::vector<Box> pile = readPile(root.optionalMap("pile"), next_id, frameOf(scene));
        scene.boxes.insert(scene.boxes.end(), pile.begin(), pile.end());
      } catch (const std::invalid_argument& error) {
        problems.emplace_back(error.what());
      }
      if (!scene.has_ground) {
        problems.emplace_back("has_ground = false, must be true for a pile to lie on");
      }
    }
    root.optionalMap("pile");  // known also where it is absent
    readChanges(root, scene);
    const Region default_region = scene.defaultRegion();
    YamlMap region = root.optionalMap("roi");
    scene.roi.min_m = region.numbers("min_m", default_region.min_m, kPosition);
    scene.roi.max_m = region.numbers("max_m", default_region.max_m, kPosition);
    region.finish();
    root.finish();
    if (problems.empty()) problems = scene.validate();  // what concerns several keys at once
  });
  return scene;
}

Scene loadScene(const std::string& path) {
  return parseScene(interactive_mapping::readTextFile(path), path);
}

}  // namespace synthetic_depth
