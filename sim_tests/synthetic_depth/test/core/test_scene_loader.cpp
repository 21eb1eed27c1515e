// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/scene_loader.h"

#include <cmath>
#include <ostream>
#include <regex>
#include <stdexcept>

#include <boost/filesystem.hpp>
#include <gtest/gtest.h>

namespace synthetic_depth {
namespace {

const char* const kGood = R"(
seed: 3
has_ground: true
T_map_scene: {xyz_m: [0.1, 0.2, 0.3], rpy_rad: [0.01, 0.02, 0.03]}
camera: {width_px: 320, height_px: 240, fx_px: 260.0, fy_px: 261.0, cx_px: 160.5, cy_px: 119.0}
trajectory: {type: orbit, radius_m: 1.5, height_m: 1.0, look_at_m: [0, 0, 0.1], turns: 1, frames: 8, fps: 5, start_time_s: 10}
boxes:
  - {id: 4, xyz_m: [0.0, 0.0, 0.1], yaw_rad: 0.5, half_extents_m: [0.1, 0.2, 0.1]}
  - {id: 6, xyz_m: [0.5, 0.0, 0.1], quaternion_xyzw: [0, 0, 0.70710678, 0.70710678], half_extents_m: [0.1, 0.2, 0.1]}
changes:
  - {frame: 3, remove: [4]}
  - {frame: 5, appear: [6]}
sensor: {min_range_m: 0.2, max_range_m: 3.0, baseline_m: 0.05, has_shadows: true}
roi: {min_m: [-1, -1, 0], max_m: [1, 1, 1]}
)";

/// The message with which a text is refused, or "accepted".
std::string refusal(const std::string& text) {
  try {
    parseScene(text, "test.yaml");
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

std::string replaced(const std::string& from, const std::string& to) {
  std::string text = kGood;
  const std::size_t at = text.find(from);
  if (at == std::string::npos) {
    throw std::logic_error("not in the good scene: " + from);
  }
  return text.replace(at, from.size(), to);
}

TEST(SceneLoader, ReadsEveryKeyOfAGoodScene) {
  const Scene scene = parseScene(kGood, "test.yaml");
  EXPECT_EQ(scene.seed, 3U);
  EXPECT_EQ(scene.camera.width_px, 320);
  EXPECT_EQ(scene.camera.fy_px, 261.0);
  EXPECT_EQ(scene.numFrames(), 8);
  EXPECT_EQ(scene.stampSeconds(2), 10.4);
  ASSERT_EQ(scene.boxes.size(), 2U);
  EXPECT_EQ(scene.boxes[0].vanishes_at_frame, 3);
  EXPECT_EQ(scene.boxes[1].appears_at_frame, 5);
  EXPECT_NEAR(scene.boxes[0].T_scene_box.linear()(1, 0), std::sin(0.5), 1e-12);
  EXPECT_NEAR(scene.boxes[1].T_scene_box.linear()(1, 0), 1.0, 1e-9);
  EXPECT_TRUE(scene.sensor.has_shadows);
  EXPECT_EQ(scene.roi.max_m.z(), 1.0);
  EXPECT_TRUE(scene.T_map_scene.isApprox(poseFromXyzRpy({0.1, 0.2, 0.3}, {0.01, 0.02, 0.03})));
}

TEST(SceneLoader, ReadsAlbedoAndMissingReturns) {
  std::string text = replaced("id: 4", "id: 4, albedo: 0.05");
  text.replace(
      text.find("has_shadows: true"), 17,
      "border_left_px: 1, border_right_px: 2, border_top_px: 3, border_bottom_px: 4, has_hexagonal_view: true, "
      "min_return_per_m2: 0.02, return_flicker: 0.3, edge_loss_px: 2.5");
  const Scene scene = parseScene(text, "test.yaml");
  EXPECT_EQ(scene.boxes[0].albedo, 0.05);
  EXPECT_EQ(scene.boxes[1].albedo, 1.0);
  EXPECT_EQ(scene.sensor.border_left_px, 1);
  EXPECT_EQ(scene.sensor.border_right_px, 2);
  EXPECT_EQ(scene.sensor.border_top_px, 3);
  EXPECT_EQ(scene.sensor.border_bottom_px, 4);
  EXPECT_TRUE(scene.sensor.has_hexagonal_view);
  EXPECT_EQ(scene.sensor.min_return_per_m2, 0.02);
  EXPECT_EQ(scene.sensor.return_flicker, 0.3);
  EXPECT_EQ(scene.sensor.edge_loss_px, 2.5);
}

TEST(SceneLoader, PutsTheSceneOffGridAndTiltedByDefault) {
  const Scene scene = parseScene("trajectory: {type: static, eye_m: [1, 0, 1], target_m: [0, 0, 0]}", "test.yaml");
  EXPECT_TRUE(scene.T_map_scene.isApprox(defaultMapScenePose()));
  EXPECT_GT(std::acos(scene.T_map_scene.linear()(2, 2)), 0.03);
}

TEST(SceneLoader, LooksGiveOneFrameEachTowardsTheirTargets) {
  const Scene scene = parseScene(
      "trajectory: {type: looks, looks: [{eye_m: [1, 0, 1], target_m: [0, 0, 0]}, {eye_m: [0, 0, 2], target_m: [0, 0, "
      "0]}]}",
      "test.yaml");
  ASSERT_EQ(scene.numFrames(), 2);
  for (const Eigen::Isometry3d& T_scene_camera : scene.T_scene_camera) {
    EXPECT_NEAR(T_scene_camera.linear().determinant(), 1.0, 1e-12);
    const Eigen::Vector3d target_camera = T_scene_camera.inverse() * Eigen::Vector3d::Zero();
    EXPECT_NEAR(target_camera.head<2>().norm(), 0.0, 1e-12);
    EXPECT_GT(target_camera.z(), 0.0);
  }
  EXPECT_LT(scene.T_scene_camera[0].linear()(2, 1), 0.0) << "image down must point down";
}

struct BadCase {
  std::string from, to;
  std::string expected;  // regular expression found in the message
};

std::ostream& operator<<(std::ostream& out, const BadCase& bad) {
  return out << '"' << bad.to << '"';
}

class RefusedScene : public testing::TestWithParam<BadCase> {};

TEST_P(RefusedScene, NamesFileKeyValueAndRule) {
  const std::string message = refusal(replaced(GetParam().from, GetParam().to));
  EXPECT_EQ(message.find("test.yaml: "), 0U) << message;
  EXPECT_TRUE(std::regex_search(message, std::regex(GetParam().expected))) << message;
}

INSTANTIATE_TEST_SUITE_P(
    BadValues, RefusedScene,
    testing::Values(
        BadCase{"seed: 3", "seed: -3", "seed = -3, must be an integer"}, BadCase{"seed: 3", "seed: x", "seed = x"},
        BadCase{"seed: 3", "sed: 3", "sed is unknown; known here: .*seed"},
        BadCase{"seed: 3", "seed: 3\nseed: 4", "seed is given twice"},
        BadCase{"has_ground: true", "has_ground: 7", "has_ground = 7, must be true or false"},
        BadCase{"xyz_m: [0.1, 0.2, 0.3]", "xyz_m: [0.1, 0.2]", "T_map_scene/xyz_m = \\[0.1, 0.2\\], must be 3 numbers"},
        BadCase{"rpy_rad: [0.01,", "rpy_rad: [90,", "T_map_scene/rpy_rad = .*6.2832\\] rad"},
        BadCase{"rpy_rad: [0.01,", "yaw_rad: 1, rpy_rad: [0.01,", "T_map_scene = several orientations"},
        BadCase{"camera: {width_px: 320", "camera: {width_px: 0",
                "camera/width_px = 0 px, must be an integer in \\[1, 10000\\] px"},
        BadCase{"camera: {width_px: 320", "camera: {width_px: 320.5", "camera/width_px = 320.5"},
        BadCase{"fx_px: 260.0", "fx_px: -260.0", "camera/fx_px = -260.0 px, must be in \\(0, 100000\\] px"},
        BadCase{"fx_px: 260.0", "fx_px: .nan", "camera/fx_px"}, BadCase{"fx_px: 260.0", "fx_px: .inf", "camera/fx_px"},
        BadCase{"fx_px: 260.0", "fx_px: wide", "camera/fx_px = wide, must be a number"},
        BadCase{"fx_px: 260.0", "fx_px: '260.0'", "camera/fx_px"},
        BadCase{"fx_px: 260.0", "fx_px: [260.0]", "camera/fx_px = \\[260.0\\]"},
        BadCase{"fx_px: 260.0", "f_px: 260.0", "camera/f_px is unknown"},
        BadCase{"type: orbit", "type: spiral", "trajectory/type = spiral, must be one of: looks, orbit, static"},
        BadCase{"type: orbit, ", "", "trajectory/type = \\(missing\\)"},
        BadCase{"type: orbit", "type: static", "trajectory/eye_m = \\(missing\\)(.|\n)*trajectory/radius_m is unknown"},
        BadCase{"radius_m: 1.5", "radius_m: 0", "trajectory/radius_m = 0 m"},
        BadCase{"frames: 8", "frames: 0", "trajectory/frames = 0"},
        BadCase{"fps: 5", "fps: 0", "trajectory/fps = 0 Hz"},
        BadCase{"turns: 1", "turns: round", "trajectory/turns = round"},
        BadCase{"height_m: 1.0", "height_m: -0.1", "camera at frame 0 = .* outside every box and above the ground"},
        BadCase{"start_time_s: 10", "start_time_s: -1", "trajectory/start_time_s = -1 s"},
        BadCase{"id: 4", "id: -4", "boxes\\[0\\]/id = -4"},
        BadCase{"id: 4", "id: 6", "boxes\\[1\\]/id = 6, must be unique"},
        BadCase{"id: 4, ", "", "boxes\\[0\\]/id = \\(missing\\)"},
        BadCase{"half_extents_m: [0.1, 0.2, 0.1]", "half_extents_m: [0.1, 0.0, 0.1]", "boxes\\[0\\]/half_extents_m"},
        BadCase{"half_extents_m: [0.1, 0.2, 0.1]", "size_m: [0.1, 0.2, 0.1]", "boxes\\[0\\]/size_m is unknown"},
        BadCase{"0.70710678]", "0.5]", "boxes\\[1\\]/quaternion_xyzw = of length"},
        BadCase{"remove: [4]", "remove: [5]", "changes\\[0\\]/remove = 5, must be the id of a box"},
        BadCase{"remove: [4]", "remove: 4", "changes\\[0\\]/remove = 4, must be a list"},
        BadCase{", remove: [4]", "", "changes\\[0\\] = without effect"},
        BadCase{"frame: 3", "frame: -3", "changes\\[0\\]/frame = -3"},
        BadCase{"frame: 3", "frame: 8", "changes\\[0\\]/frame = 8, must be an integer in \\[0, 7\\]"},
        BadCase{"seed: 3", "pile: {remove_topmost: 1, remove_at_frame: 8}", "pile/remove_at_frame = 8"},
        BadCase{"frame: 3, remove: [4]", "frame: 0, remove: [4]", "box 4/appears_at_frame"},
        BadCase{"min_range_m: 0.2", "min_range_m: -0.2", "sensor/min_range_m = -0.2 m"},
        BadCase{"max_range_m: 3.0", "max_range_m: 0.1", "sensor/max_range_m = 0.1, must be > min_range_m"},
        BadCase{"baseline_m: 0.05, ", "", "sensor/baseline_m = 0, must be > 0 m when has_shadows"},
        BadCase{"has_shadows: true", "has_shadows: yes please", "sensor/has_shadows = yes please"},
        BadCase{"has_shadows: true", "dropout_probability: 1.5",
                "sensor/dropout_probability = 1.5, must be in \\[0, 1\\]"},
        BadCase{"has_shadows: true", "edge_mixing_fraction: -1", "sensor/edge_mixing_fraction = -1"},
        BadCase{"has_shadows: true", "edge_threshold_m: 0", "sensor/edge_threshold_m = 0 m"},
        BadCase{"has_shadows: true", "lateral_jitter_px: -1", "sensor/lateral_jitter_px = -1 px"},
        BadCase{"has_shadows: true", "disparity_step_px: -1", "sensor/disparity_step_px = -1 px"},
        BadCase{"has_shadows: true", "border_left_px: 160",
                "sensor/border_left_px = 160 px, must be in \\[0, 159\\] px"},
        BadCase{"has_shadows: true", "border_top_px: -1", "sensor/border_top_px = -1 px"},
        BadCase{"has_shadows: true", "has_hexagonal_view: 6", "sensor/has_hexagonal_view = 6, must be true or false"},
        BadCase{"has_shadows: true", "min_return_per_m2: -1",
                "sensor/min_return_per_m2 = -1 1/m\\^2, must be in \\[0, 100\\] 1/m\\^2"},
        BadCase{"has_shadows: true", "return_flicker: 1.5", "sensor/return_flicker = 1.5, must be in \\[0, 1\\]"},
        BadCase{"has_shadows: true", "edge_loss_px: 21", "sensor/edge_loss_px = 21 px, must be in \\[0, 20\\] px"},
        BadCase{"id: 4", "id: 4, albedo: 1.1", "boxes\\[0\\]/albedo = 1.1, must be in \\[0, 1\\]"},
        BadCase{"has_shadows: true", "axial_noise_a_m: 5", "sensor/axial_noise_a_m = 5 m"},
        BadCase{"has_shadows: true", "axial_noise_b: 5", "sensor/axial_noise_b = 5"},
        BadCase{"has_shadows: true", "axial_noise_c_per_m: 5", "sensor/axial_noise_c_per_m = 5 1/m"},
        BadCase{"sensor: {min_range_m: 0.2, max_range_m: 3.0, baseline_m: 0.05, has_shadows: true}", "sensor: 5",
                "sensor = 5, must be a map"},
        BadCase{"min_m: [-1, -1, 0]", "min_m: [2, -1, 0]", "roi/min_m"},
        BadCase{"seed: 3", "pile: {max_bricks: 0}", "pile/max_bricks = 0"},
        BadCase{"seed: 3", "pile: {brick_size_m: [1, 1, 0]}", "pile/brick_size_m"},
        BadCase{"seed: 3", "pile: {extent_m: 0.1}", "pile/extent_m = 0.1"},
        BadCase{"seed: 3", "pile: {height_m: 0.01}", "pile/height_m = 0.01"},
        BadCase{"seed: 3", "pile: {remove_topmost: 2}", "pile/remove_at_frame = \\(missing\\)"},
        BadCase{"seed: 3", "pile: {max_bricks: 2, remove_topmost: 3, remove_at_frame: 1}", "pile/remove_topmost = 3"},
        BadCase{"seed: 3", "pile: {bricks: 2}", "pile/bricks is unknown"},
        BadCase{"seed: 3\nhas_ground: true", "has_ground: false\npile: {max_bricks: 2}", "has_ground = false"},
        BadCase{"seed: 3", "seed: [3", "line [0-9]+: not valid YAML"}));

TEST(SceneLoader, ListsEveryProblemAtOnce) {
  std::string text = replaced("seed: 3", "sed: 3");
  text.replace(text.find("fps: 5"), 6, "fps: 0");
  text.replace(text.find("id: 4"), 5, "id: -4");
  const std::string message = refusal(text);
  EXPECT_NE(message.find("sed is unknown"), std::string::npos) << message;
  EXPECT_NE(message.find("trajectory/fps"), std::string::npos) << message;
  EXPECT_NE(message.find("boxes[0]/id"), std::string::npos) << message;
}

TEST(SceneLoader, RefusesAMissingAnEmptyAndAScalarFile) {
  try {
    loadScene("/nowhere/scene.yaml");
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("/nowhere/scene.yaml: cannot be read"), std::string::npos) << error.what();
  }
  EXPECT_NE(refusal("").find("trajectory = (missing)"), std::string::npos) << refusal("");
  EXPECT_NE(refusal("hello").find("must be a map"), std::string::npos) << refusal("hello");
}

TEST(SceneLoader, RefusesACameraInsideABox) {
  const std::string message = refusal(
      "boxes: [{id: 2, xyz_m: [1, 0, 1], half_extents_m: [0.1, 0.1, 0.1]}]\n"
      "trajectory: {type: static, eye_m: [1.05, 0, 1], target_m: [0, 0, 0]}");
  EXPECT_NE(message.find("outside every box"), std::string::npos) << message;
}

TEST(SceneLoader, LoadsEveryShippedScene) {
  int num_scenes = 0;
  for (const auto& entry : boost::filesystem::directory_iterator(SYNTHETIC_DEPTH_SCENES)) {
    if (entry.path().extension() != ".yaml") continue;
    SCOPED_TRACE(entry.path().string());
    EXPECT_NO_THROW(loadScene(entry.path().string()));
    ++num_scenes;
  }
  EXPECT_GE(num_scenes, 6);
}

TEST(SceneLoader, DemoPileIsWhatItsFileSays) {
  const Scene scene = loadScene(std::string(SYNTHETIC_DEPTH_SCENES) + "/demo_pile.yaml");
  EXPECT_GE(scene.boxes.size(), 25U);
  EXPECT_LE(scene.boxes.size(), 30U);
  EXPECT_EQ(scene.numFrames(), 40);
  EXPECT_EQ(scene.removedIds().size(), 3U);
  EXPECT_EQ(scene.firstRemovalFrame(), 20);
}

}  // namespace
}  // namespace synthetic_depth
