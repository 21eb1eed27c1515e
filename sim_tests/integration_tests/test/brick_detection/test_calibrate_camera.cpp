// SPDX-License-Identifier: BSD-3-Clause
// The mast's camera found from images: the magnet holds a brick, the arm shows it to the camera, and what comes out is held
// against where the camera is.
#include <cmath>
#include <random>

#include <Eigen/Cholesky>
#include <brick_detection/calibration_session.h>
#include <gtest/gtest.h>
#include <mp700_ur5e_description/robot_names.h>
#include <opencv2/imgproc.hpp>

#include "simulated_world/testing/robot_in_world.h"

namespace simulated_world {
namespace {

namespace names = mp700_ur5e_description;
using brick_detection::Matrix6d;

constexpr double kReach_m = 0.75;
constexpr int kBrick = 0;
constexpr double kToDeg = 180.0 / M_PI;

SimulationConfig config() {
  SimulationConfig result;
  result.description = descriptionFiles();
  result.scene = std::string(SIMULATED_WORLDS) + "/single_brick.yaml";
  result.camera_rate_hz = 0.0;  // on demand
  result.camera.rgb_noise_std_grey = 2.0;
  // As config/simulation.yaml has it.
  result.camera.sensor.min_range_m = 0.3;
  result.camera.sensor.max_range_m = 6.0;
  result.camera.sensor.axial_noise_a_m = 0.0005;
  result.camera.sensor.axial_noise_c_per_m = 0.0038;
  result.camera.sensor.baseline_m = 0.05;
  result.camera.sensor.has_shadows = true;
  return result;
}

class Robot {
 public:
  Robot() : sim_(config()), tool_(sim_.world().model()) {}

  void run(double seconds) {
    for (int i = 0; i < std::lround(seconds / sim_.config().tick_s); ++i) tick();
  }

  bool moveTo(const ArmVector& arm_rad, double seconds) {
    TrajectoryGoal goal;
    goal.id = "goal " + std::to_string(++goals_);
    goal.joint_names.assign(kArmJoints.begin(), kArmJoints.end());
    TrajectoryPoint point;
    point.positions_rad.assign(arm_rad.data(), arm_rad.data() + kNumArmJoints);
    point.velocities_rad_s.assign(kNumArmJoints, 0.0);
    point.accelerations_rad_s2.assign(kNumArmJoints, 0.0);
    point.time_from_start_s = seconds;
    goal.points.push_back(point);
    if (!sim_.armDriver().acceptGoal(goal).accepted) return false;
    for (int i = 0; i < 100 * (seconds + 5.0); ++i) {
      tick();
      for (const GoalResult& result : sim_.armDriver().takeResults()) {
        if (result.goal_id == goal.id) return result.outcome == GoalOutcome::kSucceeded;
      }
    }
    return false;
  }

  /// Puts the brick under the tool and takes it up.
  bool takeBrick() {
    const Eigen::Vector3d under = tool_.tip(tool_.angles(kReach_m, 0.4));
    const Pose2d there = compose(sim_.world().basePose(), {under.x(), under.y(), 0.3});
    Fault by_hand;
    by_hand.kind = FaultKind::kMoveBrick;
    by_hand.brick_id = kBrick;
    by_hand.T_map_object.translation() << there.x_m, there.y_m, 0.1;
    by_hand.T_map_object.rotate(Eigen::AngleAxisd(there.yaw_rad, Eigen::Vector3d::UnitZ()));
    sim_.addFault(by_hand);
    run(3.0);  // until it is no longer in anybody's hand, and lies still
    sim_.setTarget(kBrick);
    if (!moveTo(tool_.angles(kReach_m, 0.3), 2.5) || !moveTo(tool_.angles(kReach_m, 0.1995), 2.0)) return false;
    sim_.armDriver().setIo(1, sim_.config().magnet_output, 1.0);
    run(0.2);
    sim_.armDriver().setPayload({1.5, {0.0, 0.0, 0.15}});  // tool and brick
    return sim_.world().heldBrick() == kBrick && moveTo(above(), 3.0);
  }

  /// The brick held up before the camera.
  ArmVector above() {
    ArmVector arm_rad = tool_.angles(0.9, 0.9);
    arm_rad[0] += 0.2;  // past the elbow, which the mast's camera sees before it
    arm_rad[5] += 0.5;
    return arm_rad;
  }

  Simulation::Tick::Image image() {
    EXPECT_TRUE(sim_.requestImage());
    Simulation::Tick result = sim_.tick();
    EXPECT_EQ(result.images.size(), 1U);
    return std::move(result.images.at(0));
  }

  Eigen::Isometry3d inBase(const std::string& link) const {
    return sim_.world().linkPose(names::kBaseFrame).inverse() * sim_.world().linkPose(link);
  }

  const Simulation& sim() const { return sim_; }
  const std::vector<std::string>& incidents() const { return incidents_; }

 private:
  void tick() {
    const Simulation::Tick result = sim_.tick();
    incidents_.insert(incidents_.end(), result.incidents.begin(), result.incidents.end());
  }

  Simulation sim_;
  ToolDown tool_;
  std::vector<std::string> incidents_;
  int goals_{0};
};

brick_detection::CameraModel cameraOf(const Simulation& sim) {
  const synthetic_depth::CameraModel& camera = sim.config().camera.camera;
  brick_detection::CameraModel result;
  result.width_px = camera.width_px;
  result.height_px = camera.height_px;
  result.fx_px = camera.fx_px;
  result.fy_px = camera.fy_px;
  result.cx_px = camera.cx_px;
  result.cy_px = camera.cy_px;
  return result;
}

TEST(CalibrateCamera, FindsTheCameraFromABrickInTheHand) {
  Robot robot;
  ASSERT_TRUE(robot.takeBrick());
  const auto catalogue = names::loadBrickTypes(descriptionFiles().bricks);
  brick_detection::TargetFinder finder(catalogue, kBrick, brick_detection::BrickPoseConfig());
  brick_detection::CalibrationSession session{brick_detection::CalibrationSessionConfig()};
  const brick_detection::CameraModel camera = cameraOf(robot.sim());
  const Eigen::Isometry3d T_base_camera = robot.inBase(names::kColorFrame);

  // About the pose before the camera; so little that arm and brick stay clear of everything, so much that the brick turns
  // by 20 degrees and more about all axes.
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> offset(-1.0, 1.0);
  const ArmVector span_rad = (ArmVector() << 0.25, 0.10, 0.15, 0.5, 0.5, 0.6).finished();
  int unseen = 0;
  for (int i = 0; i < 18; ++i) {
    ArmVector arm_rad = robot.above();
    for (int joint = 0; joint < kNumArmJoints; ++joint) arm_rad[joint] += offset(random) * span_rad[joint];
    ASSERT_TRUE(robot.moveTo(arm_rad, 2.0)) << "pose " << i;
    robot.run(0.3);  // servos settle to a hundredth of a millimetre
    ASSERT_EQ(robot.sim().world().heldBrick(), kBrick) << "pose " << i;
    const Simulation::Tick::Image image = robot.image();
    cv::Mat grey;
    cv::cvtColor(image.frame.rgb, grey, cv::COLOR_RGB2GRAY);
    std::string why_not;
    const auto target = finder.find(grey, image.frame.depth_m, camera, &why_not);
    if (!target) {
      ++unseen;  // the arm is before it, or no face looks at the camera
      continue;
    }
    brick_detection::HandEyeSample sample;
    sample.T_base_tool = robot.inBase(names::kToolFrame);
    sample.T_camera_target = target->T_camera_brick;
    sample.covariance = target->covariance;
    EXPECT_EQ(session.whyNotNew(sample.T_base_tool), "");
    session.add(sample);
  }
  for (const std::string& incident : robot.incidents()) {
    EXPECT_EQ(incident.find("collision"), std::string::npos) << incident;
  }
  EXPECT_LE(unseen, 5);

  const brick_detection::HandEyeResult result = session.solve();
  ASSERT_TRUE(result.isGood()) << result.reason;
  const auto error = [](const Eigen::Isometry3d& estimate, const Eigen::Isometry3d& truth) {
    const Eigen::AngleAxisd turn(Eigen::Matrix3d(truth.linear() * estimate.linear().transpose()));
    return (brick_detection::Vector6d() << truth.translation() - estimate.translation(), turn.angle() * turn.axis())
        .finished();
  };
  // Each sample is off by 1 mm and 0.3 degrees, root mean square: some 1 mm and 0.07 degrees for the camera, which is 1 m
  // from the samples. Three times that; the images are the same each time.
  const brick_detection::Vector6d of_camera = error(result.T_base_camera, T_base_camera);
  EXPECT_LT(of_camera.head<3>().norm(), 0.003) << residualTable(result);
  EXPECT_LT(of_camera.tail<3>().norm(), 0.2 / kToDeg) << residualTable(result);
  const Eigen::Isometry3d T_tool_brick = robot.inBase(names::kToolFrame).inverse() *
                                         robot.sim().world().linkPose(names::kBaseFrame).inverse() *
                                         robot.sim().world().brick(kBrick)->T_map_brick;
  EXPECT_LT(error(result.T_tool_target, T_tool_brick).head<3>().norm(), 0.003);
  // The covariance holds the error: chi-square with six degrees of freedom, 99.9 %. It is no wider than what a user would
  // still call a calibration.
  EXPECT_LT(of_camera.dot(result.covariance.llt().solve(of_camera)), 22.5);
  EXPECT_LT(std::sqrt(result.covariance.topLeftCorner<3, 3>().trace()), 0.004);
  EXPECT_LT(std::sqrt(result.covariance.bottomRightCorner<3, 3>().trace()), 0.2 / kToDeg);
}

}  // namespace
}  // namespace simulated_world
