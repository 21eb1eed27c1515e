// SPDX-License-Identifier: BSD-3-Clause
// The self filter against what the simulator itself knows of each pixel.
#include <cmath>
#include <cstdio>
#include <limits>

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "robot_before_camera.h"
#include "synthetic_depth/sensor.h"

namespace simulated_world {
namespace {

using depth_self_filter::HeldBrick;
using depth_self_filter::RobotMask;
using gpis_mapping::DepthImage;

struct Posture {
  const char* name;
  ArmAngles arm_rad;
};
/// In view of the mast's camera, but for the first.
const std::vector<Posture> kPostures = {
    {"stowed", {0.0, -2.5, 2.4, -1.5, -1.57, 0.0}},
    {"over the pile", {0.2, -0.9, 1.2, -1.9, -1.57, 0.0}},
    {"to the camera's side", {0.9, -0.8, 1.0, -1.7, -1.57, 0.4}},
    {"stretched out", {0.0, -0.35, 0.3, -1.5, -1.57, 0.0}},
    {"low", {-0.2, -0.3, 1.2, -2.4, -1.57, 0.9}},
    {"straight up", {0.3, -1.57, 0.0, -1.57, 0.0, 0.0}},
    {"elbow before the camera", {1.3, -1.4, 1.6, -1.2, 0.5, 0.0}},
    {"wrist before the camera", {1.2, -1.9, 2.2, -0.6, 1.2, 0.0}},
    {"folded", {0.5, -1.2, 2.4, -2.7, -1.57, 2.0}},
    {"sideways", {-0.8, -0.9, 1.4, -2.0, -1.57, -0.7}},
};

class SelfFilterSegmentation : public testing::Test {
 protected:
  struct Counts {
    int robot{0};     // pixels of robot and held brick, by the simulator
    int missed{0};    // of these, not NaN after the filter
    int lost{0};      // others that were measured, and are NaN after it
    int lost_far{0};  // of these, farther than kReach_px from any pixel of the robot
    int ghosts{0};    // points that are left within 5 mm of arm, magnet and held brick
    int pixels{0};
  };
  /// What padding and edges can take at the nearest arm, at 0.4 m: (1 cm + 4 mrad * 0.7 m) * 525 / 0.4 + 2 px, and the
  /// brick's 1.5 cm at 0.5 m; rounded up.
  static constexpr int kReach_px = 24;

  Counts look(RobotBeforeCamera* robot, const Posture& posture, const std::optional<HeldBrick>& brick,
              std::uint64_t frame) {
    robot->pose(posture.arm_rad, brick);
    const cv::Mat truth = robot->truth();
    const DepthImage measured = toDepthImage(robot->measure(frame));
    DepthImage filtered = measured;
    RobotMask mask(robot->robot(), realsenseMask());
    robot->filter(&mask, &filtered);
    cv::Mat near_robot;
    cv::dilate(truth, near_robot, cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * kReach_px + 1, 2 * kReach_px + 1}));
    const gpis_mapping::CameraModel camera = robot->camera();
    Counts counts;
    for (int v = 0; v < truth.rows; ++v) {
      for (int u = 0; u < truth.cols; ++u) {
        const bool is_robot = truth.at<unsigned char>(v, u) != 0;
        const float z = filtered.at(u, v);
        const bool is_gone = std::isnan(z);
        const bool is_lost = !is_robot && is_gone && std::isfinite(measured.at(u, v));
        ++counts.pixels;
        counts.robot += is_robot ? 1 : 0;
        counts.missed += is_robot && !is_gone ? 1 : 0;
        counts.lost += is_lost ? 1 : 0;
        counts.lost_far += is_lost && near_robot.at<unsigned char>(v, u) == 0 ? 1 : 0;
        if (!std::isfinite(z)) continue;
        const Eigen::Vector3d p_root = robot->T_root_camera() * Eigen::Vector3d((u - camera.cx) / camera.fx * z,
                                                                                (v - camera.cy) / camera.fy * z, z);
        // Near the ray's robot only: the rest is the pile.
        if (near_robot.at<unsigned char>(v, u) != 0) counts.ghosts += robot->distanceToArm(p_root) < 0.005 ? 1 : 0;
      }
    }
    std::printf("%-24s %s robot %5.1f %%, missed %d, lost %4.2f %%, far %d, ghosts %d\n", posture.name,
                brick ? "brick" : "     ", 100.0 * counts.robot / counts.pixels, counts.missed,
                100.0 * counts.lost / counts.pixels, counts.lost_far, counts.ghosts);
    return counts;
  }

  void lookAtAll(const synthetic_depth::SensorModel& sensor) {
    RobotBeforeCamera robot("one_heap", -1.5, sensor);
    int in_view = 0;
    std::uint64_t frame = 0;
    for (const Posture& posture : kPostures) {
      for (const bool has_brick : {false, true}) {
        std::optional<HeldBrick> brick;
        if (has_brick) brick = RobotBeforeCamera::brickOnMagnet(0.4);
        const Counts counts = look(&robot, posture, brick, ++frame);
        EXPECT_EQ(counts.missed, 0) << posture.name << " " << has_brick;
        EXPECT_EQ(counts.ghosts, 0) << posture.name << " " << has_brick;
        EXPECT_EQ(counts.lost_far, 0) << posture.name << " " << has_brick;
        // The ring about the arm.
        EXPECT_LT(counts.lost, 0.06 * counts.pixels) << posture.name << " " << has_brick;
        in_view += counts.robot > 0.05 * counts.pixels ? 1 : 0;
      }
    }
    EXPECT_GE(in_view, 14);
  }
};

TEST_F(SelfFilterSegmentation, AllOfTheRobotIsGoneFromExactImages) {
  lookAtAll({});
}

TEST_F(SelfFilterSegmentation, AllOfTheRobotIsGoneFromNoisyImages) {
  lookAtAll(stereoSensor());
}

TEST_F(SelfFilterSegmentation, AllOfTheRobotIsGoneWhereDepthsMixAtEdges) {
  synthetic_depth::SensorModel sensor = stereoSensor();
  sensor.edge_mixing_fraction = 0.5;
  sensor.lateral_jitter_px = 0.4;
  sensor.dropout_probability = 0.02;
  lookAtAll(sensor);
}

}  // namespace
}  // namespace simulated_world
