// SPDX-License-Identifier: BSD-3-Clause
// The whole simulated robot through its drivers' commands: a brick picked and stowed, every fault, camera, scanner, judge.
#include "simulated_world/simulation.h"

#include <cmath>
#include <cstdio>
#include <fstream>
#include <stdexcept>

#include <unistd.h>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>
#include <mp700_ur5e_description/robot_names.h>

#include "simulated_world/box_separation.h"
#include "simulated_world/scene_view.h"
#include "simulated_world/testing/robot_in_world.h"
#include "synthetic_depth/depth_renderer.h"

namespace simulated_world {
namespace {

using test_support::messageOf;
using ::testing::AllOf;
using ::testing::HasSubstr;

SimulationConfig configFor(const std::string& scene) {
  SimulationConfig config;
  config.description = descriptionFiles();
  config.scene = std::string(SIMULATED_WORLDS) + "/" + scene + ".yaml";
  config.camera_rate_hz = 0.0;  // drawn only where a test looks
  return config;
}

/// A scene of the test's own, in a file of its own.
class SceneFile {
 public:
  explicit SceneFile(const std::string& text)
      : path_(testing::TempDir() + "scene_" + std::to_string(getpid()) + ".yaml") {
    std::ofstream(path_) << text;
  }
  ~SceneFile() { std::remove(path_.c_str()); }
  SceneFile(const SceneFile&) = delete;
  SceneFile& operator=(const SceneFile&) = delete;

  SimulationConfig config() const {
    SimulationConfig config = configFor("single_brick");
    config.scene = path_;
    return config;
  }

 private:
  std::string path_;
};

Eigen::Isometry3d at(const Eigen::Vector3d& xyz_map, double yaw_rad = 0.0) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = xyz_map;
  T.rotate(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()));
  return T;
}

Fault fault(FaultKind kind, double duration_s = 0.0) {
  Fault result;
  result.kind = kind;
  result.duration_s = duration_s;
  return result;
}

bool says(const std::vector<std::string>& incidents, const std::string& words) {
  return std::any_of(incidents.begin(), incidents.end(),
                     [&words](const std::string& line) { return line.find(words) != std::string::npos; });
}

// A simulation with a hand on its drivers.
class Robot {
 public:
  explicit Robot(const SimulationConfig& config) : sim(config), tool(sim.world().model()) {}

  void run(double seconds) {
    const int ticks = static_cast<int>(std::lround(seconds / sim.config().tick_s));
    for (int i = 0; i < ticks; ++i) {
      step();
    }
  }

  void step() {
    Simulation::Tick tick = sim.tick();
    for (const std::string& incident : tick.incidents) {
      incidents.push_back(incident);
    }
    for (Simulation::Tick::Image& image : tick.images) {
      images.push_back(std::move(image));
    }
    if (tick.scan) {
      scan = *tick.scan;
    }
    odometries += tick.has_odometry ? 1 : 0;
    localisations += tick.has_localisation ? 1 : 0;
    for (const GoalResult& result : sim.armDriver().takeResults()) {
      results.push_back(result);
    }
  }

  // Through the arm's driver, as its controller would be asked.
  GoalAnswer sendArm(const ArmVector& goal_rad, double seconds) {
    TrajectoryGoal goal;
    goal.id = "goal " + std::to_string(++goals_);
    for (const char* name : kArmJoints) {
      goal.joint_names.push_back(name);
    }
    TrajectoryPoint point;
    point.positions_rad.assign(goal_rad.data(), goal_rad.data() + kNumArmJoints);
    point.velocities_rad_s.assign(kNumArmJoints, 0.0);
    point.accelerations_rad_s2.assign(kNumArmJoints, 0.0);
    point.time_from_start_s = seconds;
    goal.points.push_back(point);
    return sim.armDriver().acceptGoal(goal);
  }

  // Runs until the goal has ended.
  GoalResult moveArm(const ArmVector& goal_rad, double seconds) {
    const GoalAnswer answer = sendArm(goal_rad, seconds);
    EXPECT_TRUE(answer.accepted) << answer.text;
    results.clear();
    for (int i = 0; i < 100 * (seconds + 5.0) && results.empty(); ++i) {
      step();
    }
    return results.empty() ? GoalResult{"", GoalOutcome::kAborted, GoalError::kInvalidGoal, "no result"} : results[0];
  }

  bool magnet(bool is_on) { return sim.armDriver().setIo(1, sim.config().magnet_output, is_on ? 1.0 : 0.0).success; }

  // The map's point under the tool at this reach, for the robot where it is.
  Eigen::Vector3d underTool(double reach_m, double height_m) {
    const Eigen::Vector3d p = tool.tip(tool.angles(reach_m, 0.4));
    const Pose2d base = sim.world().basePose();
    const Pose2d there = compose(base, {p.x(), p.y(), 0.0});
    return {there.x_m, there.y_m, height_m};
  }

  void moveBrick(int id, const Eigen::Isometry3d& T_map_brick) {
    Fault by_hand = fault(FaultKind::kMoveBrick);
    by_hand.brick_id = id;
    by_hand.T_map_object = T_map_brick;
    sim.addFault(by_hand);
    run(3.0);  // until it is no longer in anybody's hand, and lies still
  }

  // Brick `id` under the tool, its top at 0.2 m; the tool on it, the magnet on.
  void grasp(int id) {
    moveBrick(id, at(underTool(kReach_m, 0.1), 0.3));
    sim.setTarget(id);
    moveArm(tool.angles(kReach_m, 0.3), 2.5);
    moveArm(tool.angles(kReach_m, 0.1995), 2.0);
    magnet(true);
    run(0.2);
  }

  JudgeRow judged() { return sim.judge().report().totals; }

  static constexpr double kReach_m = 0.75;
  Simulation sim;
  ToolDown tool;
  std::vector<std::string> incidents;
  std::vector<Simulation::Tick::Image> images;
  std::vector<float> scan;
  int odometries{0};
  int localisations{0};
  std::vector<GoalResult> results;

 private:
  int goals_{0};
};

TEST(Simulation, PicksABrickAndStowsIt) {
  Robot robot(configFor("single_brick"));
  robot.run(0.1);
  const auto pressure_V = [&robot] { return robot.sim.armDriver().io().analog_in_V[0]; };
  EXPECT_EQ(pressure_V(), 0.0);
  robot.grasp(0);
  ASSERT_EQ(robot.sim.world().heldBrick(), 0);
  EXPECT_EQ(pressure_V(), 3.0);
  EXPECT_TRUE(robot.sim.armDriver().setPayload({1.5, {0.0, 0.0, 0.15}}).success);
  EXPECT_EQ(robot.moveArm(robot.tool.angles(Robot::kReach_m, 0.9), 3.0).outcome, GoalOutcome::kSucceeded);
  // Over the container: 0.511 m behind the arm's axis, clockwise so that the mast is not in the way.
  const ArmVector over = robot.tool.angles(0.68, 0.85);
  ASSERT_LT(robot.tool.tipError(), 1e-6);
  const Eigen::Vector3d tip = robot.tool.tip(over);
  const double pan = -M_PI - std::atan2(tip.y(), tip.x() - 0.186);
  EXPECT_EQ(robot.moveArm(robot.tool.angles(0.68, 0.85, pan), 5.0).outcome, GoalOutcome::kSucceeded);
  ASSERT_EQ(robot.sim.world().heldBrick(), 0);
  robot.magnet(false);
  robot.sim.armDriver().setPayload({0.5, {0.0, 0.0, 0.05}});
  robot.run(2.0);
  EXPECT_EQ(robot.sim.bricksStowed(), 1);
  EXPECT_TRUE(says(robot.incidents, "brick 0 stowed"));
  const JudgeRow row = robot.judged();
  EXPECT_EQ(row.stowed, 1);
  EXPECT_EQ(row.falls, 0);
  EXPECT_EQ(row.drops, 0);
  for (const std::string& incident : robot.incidents) {
    EXPECT_EQ(incident.find("collision"), std::string::npos) << incident;
  }
  EXPECT_EQ(row.collisions, 0);
  EXPECT_EQ(robot.sim.world().bricks().size(), 1U) << "it stays";
}

/// Pixels that two pictures do not share, as a share of all.
double difference(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat apart;
  cv::absdiff(a, b, apart);
  int count = 0;
  for (int v = 0; v < apart.rows; ++v) {
    for (int u = 0; u < apart.cols; ++u) {
      const cv::Vec3b pixel = apart.at<cv::Vec3b>(v, u);
      count += pixel[0] + pixel[1] + pixel[2] > 20 ? 1 : 0;
    }
  }
  return static_cast<double>(count) / static_cast<double>(apart.total());
}

TEST(Simulation, PictureShowsTheWorldAsItIs) {
  Robot robot(configFor("two_stacked"));
  const cv::Mat before = robot.sim.picture();
  ASSERT_EQ(before.size(), cv::Size(PictureConfig().width_px, PictureConfig().height_px));
  EXPECT_EQ(difference(before, robot.sim.picture()), 0.0) << "nothing has changed";
  // One brick less: of 960 x 540 px, some 2 m wide, a brick of 0.2 x 0.3 m fills 100 x 150 px and its shadow as much.
  robot.moveBrick(1, at(robot.sim.world().linkPose("container_place_3").translation() + Eigen::Vector3d(0, 0, 0.05)));
  ASSERT_EQ(robot.sim.bricksStowed(), 1);
  ASSERT_FALSE(robot.sim.unload());
  robot.run(SimulationConfig().unload_s + 0.1);
  ASSERT_EQ(robot.sim.unload(), 1);
  const double gone = difference(before, robot.sim.picture());
  EXPECT_GT(gone, 0.01);
  EXPECT_LT(gone, 0.2) << "the pile's other brick, ground and robot stay as they are";
  // The robot drives up to the pile, from where no picture shows it.
  const cv::Mat one_brick = robot.sim.picture();
  for (int i = 0; i < 10; ++i) {  // the base stops by itself without commands
    robot.sim.commandBase({0.4, 0.0});
    robot.run(0.5);
  }
  EXPECT_GT(difference(one_brick, robot.sim.picture()), 0.02);
  PictureConfig none;
  none.width_px = 0;
  Robot other(configFor("single_brick"));
  EXPECT_THROW(other.sim.picture(none), std::invalid_argument);
}

TEST(Simulation, PicturesChangeNothingThatTheRobotMeasures) {
  Robot with(configFor("two_stacked"));
  Robot without(configFor("two_stacked"));
  for (Robot* robot : {&with, &without}) {
    robot->sim.commandBase({0.3, 0.2});
    for (int i = 0; i < 5; ++i) {
      robot->run(0.1);
      if (robot == &with) {
        robot->sim.picture();
      }
    }
    ASSERT_TRUE(robot->sim.requestImage());
    robot->step();
  }
  EXPECT_EQ(with.sim.digest(), without.sim.digest());
  ASSERT_EQ(with.images.size(), without.images.size());
  ASSERT_FALSE(with.images.empty());
  EXPECT_EQ(cv::norm(with.images.back().frame.rgb, without.images.back().frame.rgb, cv::NORM_INF), 0.0);
}

/// Brick `id` let go over its place of the container, as the arm does.
void stow(Robot* robot, int id, const char* place, double above_m = 0.03) {
  Eigen::Isometry3d T_map_brick = robot->sim.world().linkPose(place);
  T_map_brick.translate(Eigen::Vector3d(0.0, 0.0, above_m + 0.1));
  robot->moveBrick(id, T_map_brick);
}

void drive(Robot* robot, double linear_m_s, double angular_rad_s) {
  for (int i = 0; i < 4; ++i) {  // a command holds for less than a second
    robot->sim.commandBase({linear_m_s, angular_rad_s});
    robot->run(0.5);
  }
}

TEST(Simulation, BricksStayInTheContainerWhileTheBaseDrivesUntilUnloaded) {
  Robot robot(configFor("four_bricks"));
  for (std::size_t i = 0; i < mp700_ur5e_description::kContainerPlaces.size(); ++i)
    stow(&robot, static_cast<int>(i), mp700_ur5e_description::kContainerPlaces[i]);
  ASSERT_EQ(robot.sim.bricksStowed(), 3);
  const JudgeRow before = robot.judged();  // a brick in somebody's hand must not touch the robot
  // As hard as the drives are able to: backwards, stop, turn to both sides, stop in an emergency.
  for (const auto& [linear_m_s, angular_rad_s] : {std::pair(-0.8, 0.0), std::pair(0.0, 0.0), std::pair(0.4, 0.6),
                                                  std::pair(0.0, -0.6), std::pair(-0.5, 0.0), std::pair(0.8, 0.6)}) {
    drive(&robot, linear_m_s, angular_rad_s);
  }
  robot.sim.addFault(fault(FaultKind::kEmergencyStop));
  robot.run(2.0);
  EXPECT_EQ(robot.sim.bricksStowed(), 3);
  EXPECT_EQ(robot.sim.world().bricksInContainer().size(), 3U);
  const JudgeRow row = robot.judged();
  EXPECT_GT(row.distance_m, 1.0);
  EXPECT_EQ(row.drops + row.falls, 0);
  EXPECT_EQ(row.collisions, before.collisions);
  EXPECT_FALSE(robot.sim.unload());
  robot.run(SimulationConfig().unload_s - 0.1);
  EXPECT_FALSE(robot.sim.unload());
  EXPECT_EQ(robot.sim.world().bricksInContainer().size(), 3U);
  robot.run(0.2);
  EXPECT_EQ(robot.sim.unload(), 3);
  EXPECT_FALSE(robot.sim.unload()) << "the next time it lasts as long";
  robot.run(0.1);
  EXPECT_EQ(robot.sim.bricksStowed(), 3);
  EXPECT_EQ(robot.sim.world().bricks().size(), 1U);
}

TEST(Simulation, ABrickOnAnotherInTheContainerIsADrop) {
  Robot robot(configFor("four_bricks"));
  stow(&robot, 0, mp700_ur5e_description::kContainerPlaces[2]);
  stow(&robot, 1, mp700_ur5e_description::kContainerPlaces[2]);
  EXPECT_EQ(robot.sim.bricksStowed(), 1);
  EXPECT_TRUE(says(robot.incidents, "brick 1 is jammed"));
  EXPECT_EQ(robot.judged().drops, 1);
  drive(&robot, 0.0, 0.0);  // at rest for long: from here it could fall, lay it on the ground
  drive(&robot, -0.2, 0.0);
  EXPECT_GT(robot.judged().distance_m, 0.1);
  EXPECT_EQ(robot.judged().falls, 0) << "it rides along";
  EXPECT_EQ(robot.judged().drops, 1);
}

TEST(Simulation, ABrickThatLeavesTheContainerIsADrop) {
  Robot robot(configFor("four_bricks"));
  stow(&robot, 0, mp700_ur5e_description::kContainerPlaces[2]);
  ASSERT_EQ(robot.sim.bricksStowed(), 1);
  // Thrown out: nothing that the robot can do does that.
  auto& data = const_cast<mjData&>(robot.sim.world().data());
  const mjModel& model = robot.sim.world().model();
  const int joint = model.body_jntadr[mj_name2id(&model, mjOBJ_BODY, "brick_0")];
  data.qvel[model.jnt_dofadr[joint]] = -2.0;
  data.qvel[model.jnt_dofadr[joint] + 2] = 4.0;
  robot.run(3.0);
  EXPECT_EQ(robot.sim.bricksStowed(), 0);
  EXPECT_TRUE(says(robot.incidents, "brick 0 fell out of the container"));
  EXPECT_EQ(robot.judged().drops, 1);
}

// Without tags nobody knows the ids: the place says which brick is meant.
TEST(Simulation, TheTargetIsTheBrickAtItsPlace) {
  for (const bool is_there : {true, false}) {
    Robot robot(configFor("single_brick"));
    robot.moveBrick(0, at(robot.underTool(Robot::kReach_m, 0.1), 0.3));
    const Eigen::Vector3d p_map = robot.sim.world().brick(0)->T_map_brick.translation();
    robot.sim.setTarget(17, p_map + Eigen::Vector3d(is_there ? 0.1 : 0.5, 0.0, 0.0));
    robot.moveArm(robot.tool.angles(Robot::kReach_m, 0.3), 2.5);
    robot.moveArm(robot.tool.angles(Robot::kReach_m, 0.1995), 2.0);
    robot.run(0.5);
    EXPECT_EQ(robot.judged().collisions, is_there ? 0 : 1);
  }
}

TEST(Simulation, TouchingAnythingButTheTargetIsACollision) {
  Robot robot(configFor("single_brick"));
  robot.grasp(0);
  EXPECT_EQ(robot.judged().collisions, 0);
  robot.magnet(false);
  robot.moveArm(robot.tool.angles(Robot::kReach_m, 0.3), 1.0);
  robot.sim.setTarget(std::nullopt);
  robot.run(1.0);
  robot.moveArm(robot.tool.angles(Robot::kReach_m, 0.1995), 2.0);
  robot.run(0.5);
  EXPECT_EQ(robot.judged().collisions, 1);
  EXPECT_TRUE(says(robot.incidents, "collision of magnet with brick_0"));
}

TEST(Simulation, LoadThatTouchesAnotherBrickIsALoadContact) {
  Robot robot(configFor("two_stacked"));
  robot.moveBrick(1, at({3.0, 3.0, 0.1}));
  robot.grasp(0);
  ASSERT_EQ(robot.sim.world().heldBrick(), 0);
  robot.moveArm(robot.tool.angles(Robot::kReach_m, 0.6), 3.0);
  robot.moveBrick(1, at(robot.underTool(Robot::kReach_m, 0.1), 0.3));
  EXPECT_EQ(robot.judged().load_contacts, 0) << "with the ground that it was taken from";
  robot.moveArm(robot.tool.angles(Robot::kReach_m, 0.3995), 3.0);  // both are 0.2 m high
  robot.run(0.5);
  EXPECT_EQ(robot.judged().load_contacts, 1);
  EXPECT_EQ(robot.judged().collisions, 0);
  EXPECT_TRUE(says(robot.incidents, "contact of the carried brick_0 with brick_1"));
  const auto& events = robot.sim.judge().events();
  const auto touch = std::find_if(events.begin(), events.end(),
                                  [](const JudgeEvent& e) { return e.kind == JudgeEventKind::kLoadContact; });
  ASSERT_NE(touch, events.end());
  EXPECT_NEAR(touch->p_map.z(), 0.2, 0.01) << "the upper side of brick 1";
}

TEST(Simulation, PressingHardStopsTheArm) {
  Robot robot(configFor("single_brick"));
  robot.moveArm(robot.tool.angles(Robot::kReach_m, 0.05), 3.0);
  const GoalResult result = robot.moveArm(robot.tool.angles(Robot::kReach_m, -0.05), 1.0);
  EXPECT_EQ(result.outcome, GoalOutcome::kAborted);
  EXPECT_EQ(robot.sim.armDriver().safetyMode(), SafetyMode::kProtectiveStop);
  EXPECT_TRUE(says(robot.incidents, "protective stop"));
  EXPECT_TRUE(says(robot.incidents, "collision of magnet with ground"));
  EXPECT_FALSE(robot.sendArm(robot.tool.angles(Robot::kReach_m, 0.2), 2.0).accepted);
  robot.run(5.1);
  EXPECT_TRUE(robot.sim.armDriver().unlockProtectiveStop().success);
  robot.run(0.1);
  const CommandAnswer played = robot.sim.armDriver().play();
  EXPECT_TRUE(played.success) << played.text << "; " << robot.incidents.back() << ", still pushed with "
                              << robot.sim.wrench().force_N.transpose() << " N";
  robot.run(0.5);
  EXPECT_EQ(robot.moveArm(robot.tool.angles(Robot::kReach_m, 0.2), 2.0).outcome, GoalOutcome::kSucceeded);
}

// Points without velocities are joined by straight lines, on which the speed steps at each end: no push from outside.
TEST(Simulation, FreeMotionNeverStopsTheArm) {
  Robot robot(configFor("single_brick"));
  ArmVector stretched;
  stretched << 0.0, -0.5, 0.5, -1.57, -1.57, 0.0;
  ASSERT_EQ(robot.moveArm(stretched, 4.0).outcome, GoalOutcome::kSucceeded);
  for (const double speed_rad_s : {0.3, 1.0, 2.0}) {
    ArmVector goal = stretched;
    goal[1] -= 0.4;
    TrajectoryGoal steps;
    steps.id = "steps " + std::to_string(speed_rad_s);
    steps.joint_names.assign(kArmJoints.begin(), kArmJoints.end());
    TrajectoryPoint point;
    point.positions_rad.assign(goal.data(), goal.data() + kNumArmJoints);
    point.time_from_start_s = 0.4 / speed_rad_s;
    steps.points.push_back(point);
    const GoalAnswer answer = robot.sim.armDriver().acceptGoal(steps);
    ASSERT_TRUE(answer.accepted) << answer.text;
    robot.run(3.0);
    EXPECT_EQ(robot.sim.armDriver().safetyMode(), SafetyMode::kNormal) << speed_rad_s << " rad/s";
    ASSERT_EQ(robot.moveArm(stretched, 4.0).outcome, GoalOutcome::kSucceeded);
  }
}

TEST(Simulation, BrickPulledFromBelowBringsDownWhatItCarried) {
  Robot robot(configFor("three_pyramid"));
  robot.run(2.0);
  ASSERT_EQ(robot.judged().falls, 0);
  robot.moveBrick(0, at({2.0, 2.0, 0.1}));
  EXPECT_EQ(robot.judged().falls, 1) << "the one on top; the one moved by hand does not count";
  EXPECT_TRUE(says(robot.incidents, "brick 2 falls"));
}

TEST(Simulation, SettledHeapStaysAsItIs) {
  Robot robot(configFor("one_heap"));
  const std::vector<BrickMotion> before = robot.sim.world().bricks();
  ASSERT_EQ(before.size(), 20U);
  robot.run(60.0);
  const std::vector<BrickMotion> after = robot.sim.world().bricks();
  for (std::size_t i = 0; i < before.size(); ++i) {
    // The pile goes from the settling to this world with its poses, not its contact forces: it settles anew by microns.
    EXPECT_LT((before[i].T_map_brick.translation() - after[i].T_map_brick.translation()).norm(), 5e-4) << before[i].id;
  }
  EXPECT_EQ(robot.judged().falls, 0);
  EXPECT_EQ(robot.judged().collisions, 0);
}

TEST(Simulation, OdometryAndLocalisationAgreeWithTheTruth) {
  Robot robot(configFor("single_brick"));
  robot.sim.commandBase({0.4, 0.3});
  for (int i = 0; i < 400; ++i) {
    robot.sim.commandBase({0.4, 0.3});
    robot.step();
  }
  const Pose2d truth = robot.sim.world().basePose();
  const Pose2d start{robot.sim.scene().robot_start.xy_m.x(), robot.sim.scene().robot_start.xy_m.y(),
                     robot.sim.scene().robot_start.yaw_rad};
  const Pose2d by_wheels = compose(start, robot.sim.drive().odometry());
  // The base's servo lags by fractions of a millimetre and the tyres slide as little.
  EXPECT_NEAR(by_wheels.x_m, truth.x_m, 0.002);
  EXPECT_NEAR(by_wheels.y_m, truth.y_m, 0.002);
  EXPECT_NEAR(by_wheels.yaw_rad, truth.yaw_rad, 0.002);
  const Pose2d localised = compose(robot.sim.mapToOdom(), robot.sim.drive().odometry());
  EXPECT_NEAR(localised.x_m, truth.x_m, 1e-9) << "ground truth is the default";
  // v^2 / 2a less than v t, on an arc: the judge measures the way, the truth its end.
  EXPECT_NEAR(robot.judged().distance_m, 0.4 * 4.0 - 0.4 * 0.4 / (2 * 2.4), 0.02);
}

TEST(Simulation, LocalisationDriftsWithItsDeviationAndCorrelation) {
  constexpr double kStd_m = 0.01;
  for (const double correlation_s : {0.0, 1.0}) {
    SimulationConfig config = configFor("single_brick");
    config.localisation_std_m = kStd_m;
    config.localisation_correlation_s = correlation_s;
    config.odometry_rate_hz = 10.0;
    Robot robot(config);
    std::vector<double> errors_m;
    for (int i = 0; i < 12000; ++i) {
      const Simulation::Tick tick = robot.sim.tick();
      if (!tick.has_localisation) continue;
      const Pose2d told = compose(robot.sim.mapToOdom(), robot.sim.drive().odometry());
      errors_m.push_back(told.x_m - robot.sim.world().basePose().x_m);
    }
    double square = 0.0;
    double product = 0.0;
    for (std::size_t i = 1; i < errors_m.size(); ++i) {
      square += errors_m[i] * errors_m[i];
      product += errors_m[i] * errors_m[i - 1];
    }
    // 1200 values over 120 s: of two deviations of time each is a value of its own, 60 then. Four standard errors.
    const double independent = correlation_s > 0.0 ? 60.0 : 1200.0;
    EXPECT_NEAR(std::sqrt(square / static_cast<double>(errors_m.size())), kStd_m,
                4.0 * kStd_m / std::sqrt(2.0 * independent));
    EXPECT_NEAR(product / square, correlation_s > 0.0 ? std::exp(-0.1 / correlation_s) : 0.0, 4.0 / std::sqrt(1200.0));
  }
}

TEST(Simulation, WheelSlipIsNotSeenByOdometry) {
  Robot robot(configFor("single_brick"));
  Fault slip = fault(FaultKind::kWheelSlip, 2.0);
  slip.value = slip.value2 = 0.5;
  robot.sim.addFault(slip);
  const Pose2d start = robot.sim.world().basePose();
  for (int i = 0; i < 200; ++i) {
    robot.sim.commandBase({0.4, 0.0});
    robot.step();
  }
  const double moved_m = robot.sim.world().basePose().x_m - start.x_m;
  EXPECT_NEAR(moved_m, 0.5 * robot.sim.drive().odometry().x_m, 0.005);
  EXPECT_GT(moved_m, 0.3);
  for (int i = 0; i < 100; ++i) {
    robot.sim.commandBase({0.4, 0.0});
    robot.step();
  }
  EXPECT_NEAR(robot.sim.world().basePose().x_m - start.x_m - moved_m, 0.4, 0.01) << "the fault is over";
  EXPECT_TRUE(says(robot.incidents, "fault wheel_slip is over"));
}

TEST(Simulation, ProtectiveStopEndsTheGoalAndHoldsTheArm) {
  Robot robot(configFor("single_brick"));
  ASSERT_TRUE(robot.sendArm(robot.tool.angles(Robot::kReach_m, 0.5), 4.0).accepted);
  robot.run(1.0);
  robot.results.clear();
  robot.sim.addFault(fault(FaultKind::kProtectiveStop));
  robot.run(1.0);
  ASSERT_EQ(robot.results.size(), 1U);
  EXPECT_EQ(robot.results[0].outcome, GoalOutcome::kAborted);
  const ArmVector held = robot.sim.world().armPosition();
  robot.run(1.0);
  EXPECT_LT((robot.sim.world().armPosition() - held).cwiseAbs().maxCoeff(), 1e-4);
}

TEST(Simulation, EmergencyStopHaltsArmAndBase) {
  Robot robot(configFor("single_brick"));
  for (int i = 0; i < 100; ++i) {
    robot.sim.commandBase({0.4, 0.0});
    robot.step();
  }
  ASSERT_GT(robot.sim.world().baseTwist().linear_m_s, 0.3);
  robot.sim.addFault(fault(FaultKind::kEmergencyStop, 3.0));
  robot.run(0.5);
  EXPECT_FALSE(robot.sim.commandBase({0.4, 0.0}));
  robot.run(1.0);
  EXPECT_NEAR(robot.sim.world().baseTwist().linear_m_s, 0.0, 0.01);
  EXPECT_NE(robot.sim.armDriver().robotMode(), RobotMode::kRunning);
  robot.run(2.0);
  EXPECT_TRUE(robot.sim.commandBase({0.4, 0.0})) << "released";
  EXPECT_TRUE(robot.sim.armDriver().brakeRelease().success);
  robot.run(4.0);
  EXPECT_TRUE(robot.sim.armDriver().play().success);
  robot.run(0.5);
  EXPECT_EQ(robot.moveArm(robot.tool.angles(Robot::kReach_m, 0.5), 3.0).outcome, GoalOutcome::kSucceeded);
}

TEST(Simulation, TheBasesOwnStopsLeaveTheArmAlone) {
  for (const auto& [kind, is_button] :
       {std::pair(FaultKind::kBaseButton, true), std::pair(FaultKind::kBaseScanner, false)}) {
    Robot robot(configFor("single_brick"));
    for (int i = 0; i < 100; ++i) {
      robot.sim.commandBase({0.4, 0.0});
      robot.step();
    }
    ASSERT_GT(robot.sim.world().baseTwist().linear_m_s, 0.3);
    robot.sim.addFault(fault(kind, 1.0));
    robot.run(0.5);
    EXPECT_FALSE(robot.sim.commandBase({0.4, 0.0}));
    EXPECT_NEAR(robot.sim.world().baseTwist().linear_m_s, 0.0, 0.01);
    EXPECT_EQ(robot.sim.armDriver().robotMode(), RobotMode::kRunning);
    EXPECT_EQ(robot.sim.relayBoard().is_button_pressed, is_button);
    EXPECT_EQ(robot.sim.relayBoard().is_scanner_blocked, !is_button);
    EXPECT_EQ(robot.sim.relayBoard().state, RelayBoard::State::kStopped);
    robot.run(0.8);
    EXPECT_EQ(robot.sim.relayBoard().state, RelayBoard::State::kConfirmed);
    robot.run(1.0);
    EXPECT_EQ(robot.sim.relayBoard().state, RelayBoard::State::kFree);
    EXPECT_FALSE(robot.sim.relayBoard().is_button_pressed || robot.sim.relayBoard().is_scanner_blocked);
    EXPECT_TRUE(robot.sim.commandBase({0.4, 0.0})) << "released";
  }
}

TEST(Simulation, DriverGoneRefusesAndComesBack) {
  Robot robot(configFor("single_brick"));
  robot.sim.addFault(fault(FaultKind::kDriverGone, 2.0));
  robot.run(0.5);
  EXPECT_FALSE(robot.sim.armDriver().robotProgramRunning());
  EXPECT_FALSE(robot.sendArm(robot.tool.angles(Robot::kReach_m, 0.5), 3.0).accepted);
  EXPECT_FALSE(robot.magnet(true));
  robot.run(2.0);
  EXPECT_TRUE(robot.sim.armDriver().driverConnected());
}

TEST(Simulation, CameraGoneSendsNothingAndComesBack) {
  SimulationConfig config = configFor("single_brick");
  config.camera_rate_hz = 5.0;
  Robot robot(config);
  robot.run(1.0);
  EXPECT_EQ(robot.images.size(), 5U);
  robot.sim.addFault(fault(FaultKind::kCameraGone, 1.0));
  robot.images.clear();
  robot.run(0.9);
  EXPECT_TRUE(robot.images.empty());
  EXPECT_FALSE(robot.sim.requestImage());
  robot.run(1.1);
  EXPECT_GE(robot.images.size(), 4U);
}

TEST(Simulation, ScannerGoneSendsNothingAndComesBackAsIfNothingHadBeen) {
  SimulationConfig config = configFor("single_brick");
  config.scan_noise_std_m = 0.01;
  Robot robot(config);
  Robot sound(config);
  robot.run(0.5);
  EXPECT_FALSE(robot.scan.empty());
  robot.sim.addFault(fault(FaultKind::kScannerGone, 1.0));
  robot.scan.clear();
  robot.run(1.0);
  EXPECT_TRUE(robot.scan.empty());
  robot.run(0.5);
  sound.run(2.0);
  ASSERT_FALSE(robot.scan.empty());
  EXPECT_EQ(robot.scan, sound.scan) << "noise and all";
}

TEST(Simulation, OdometryGoneSaysNothingAndStillObeys) {
  Robot robot(configFor("single_brick"));
  const auto drive = [&robot](double seconds) {
    robot.odometries = robot.localisations = 0;
    for (int i = 0; i < 100 * seconds; ++i) {
      robot.sim.commandBase({0.2, 0.3});
      robot.step();
    }
  };
  drive(1.0);
  EXPECT_EQ(robot.odometries, 50);
  EXPECT_EQ(robot.localisations, 50);
  robot.sim.addFault(fault(FaultKind::kOdometryGone, 1.0));
  const Pose2d before = robot.sim.world().basePose();
  const Pose2d last_said = robot.sim.mapToOdom();
  drive(1.0);
  EXPECT_EQ(robot.odometries, 0);
  EXPECT_EQ(robot.localisations, 50);
  EXPECT_EQ(robot.sim.mapToOdom().x_m, last_said.x_m) << "there is nothing to correct";
  const Pose2d after = robot.sim.world().basePose();
  EXPECT_NEAR(std::hypot(after.x_m - before.x_m, after.y_m - before.y_m), 0.2, 0.01) << "0.2 m/s for 1 s";
  drive(1.0);
  EXPECT_EQ(robot.odometries, 50);
  const Pose2d localised = compose(robot.sim.mapToOdom(), robot.sim.drive().odometry());
  EXPECT_NEAR(localised.x_m, robot.sim.world().basePose().x_m, 1e-9) << "it has counted on";
}

TEST(Simulation, LocalisationGoneLeavesOdometry) {
  Robot robot(configFor("single_brick"));
  robot.sim.addFault(fault(FaultKind::kLocalisationGone, 1.0));
  robot.run(1.0);
  EXPECT_EQ(robot.odometries, 50);
  EXPECT_EQ(robot.localisations, 0);
  robot.run(1.0);
  EXPECT_EQ(robot.localisations, 50);
}

TEST(Simulation, LocalisationJumpMovesTheMapUnderTheRobotAsAWhole) {
  Robot robot(configFor("single_brick"));
  Fault jump = fault(FaultKind::kLocalisationJump, 3.0);
  jump.value = 0.5;
  jump.value2 = -0.1;
  const auto expectOff = [&robot](double x_m, double yaw_rad) {
    const Pose2d truth = robot.sim.world().basePose();
    const Pose2d localised = compose(robot.sim.mapToOdom(), robot.sim.drive().odometry());
    // Both are computed from the same doubles; only rounding is left.
    EXPECT_NEAR(localised.x_m - truth.x_m, x_m, 1e-9);
    EXPECT_NEAR(localised.y_m - truth.y_m, 0.0, 1e-9);
    EXPECT_NEAR(localised.yaw_rad - truth.yaw_rad, yaw_rad, 1e-9);
  };
  robot.run(0.1);
  expectOff(0.0, 0.0);
  robot.sim.addFault(jump);
  robot.run(0.02);
  expectOff(0.5, -0.1);
  const Pose2d truth_before = robot.sim.world().basePose();
  const Pose2d before = compose(robot.sim.mapToOdom(), robot.sim.drive().odometry());
  for (int i = 0; i < 200; ++i) {
    robot.sim.commandBase({0.4, 0.5});
    robot.step();
  }
  // What is driven is driven in the new frame: seen from where the robot was, it is the same.
  const Pose2d driven = compose(inverse(truth_before), robot.sim.world().basePose());
  const Pose2d told = compose(inverse(before), compose(robot.sim.mapToOdom(), robot.sim.drive().odometry()));
  EXPECT_GT(std::hypot(driven.x_m, driven.y_m), 0.2);
  EXPECT_NEAR(told.x_m, driven.x_m, 1e-9);
  EXPECT_NEAR(told.y_m, driven.y_m, 1e-9);
  EXPECT_NEAR(told.yaw_rad, driven.yaw_rad, 1e-9);
  robot.run(1.0);
  expectOff(0.0, 0.0);
}

Fault obstacleAt(double x_m, double y_m, double duration_s = 0.0) {
  Fault obstacle = fault(FaultKind::kObstacle, duration_s);
  obstacle.T_map_object = at({x_m, y_m, 0.0});
  return obstacle;
}

TEST(Simulation, ObstacleIsSeenByScannerAndCameraUntilItLeaves) {
  Robot robot(configFor("single_brick"));
  const auto look = [&robot] {
    robot.images.clear();
    EXPECT_TRUE(robot.sim.requestImage());
    robot.run(0.1);  // a scan and an image
    return robot.images.at(0).frame;
  };
  const RgbdCamera::Frame before = look();
  const std::vector<float> scan_before = robot.scan;
  const Eigen::Vector3d scanner = robot.sim.world().linkPose("lidar_1_link").translation();
  const Eigen::Vector2d middle(scanner.x() + 1.0 + kObstacleRadius_m, scanner.y());
  robot.sim.addFault(obstacleAt(middle.x(), middle.y(), 1.0));
  const RgbdCamera::Frame during = look();
  EXPECT_NEAR(robot.scan[robot.scan.size() / 2], 1.0, 1e-3) << "its nearest point; a ray half a step beside it";
  // A cylinder at 1 m from its surface hides asin(R / (1 m + R)) to either side.
  const double half_angle = std::asin(kObstacleRadius_m / (1.0 + kObstacleRadius_m));
  const auto seen_by = std::count_if(robot.scan.begin(), robot.scan.end(), [](float range) { return range < 1.25F; });
  EXPECT_NEAR(static_cast<double>(seen_by), 2.0 * half_angle / robot.sim.scannerConfig().angle_increment_rad, 2.0);

  // Each ray of the camera against the cylinder by hand. The drawn one has 28 flat sides, up to 1.3 mm inside: across
  // rays that meet it at less than 50 degrees, 2 mm, with the depth buffer's steps 3 mm.
  const Eigen::Isometry3d T_map_camera = robot.sim.world().linkPose("camera_depth_optical_frame");
  const auto& camera = robot.sim.config().camera.camera;
  int compared = 0;
  int redder = 0;
  for (int v = 0; v < during.exact_depth_m.rows; ++v) {
    for (int u = 0; u < during.exact_depth_m.cols; ++u) {
      const Eigen::Vector3d ray = T_map_camera.linear() * Eigen::Vector3d((u - camera.cx_px) / camera.fx_px,
                                                                          (v - camera.cy_px) / camera.fy_px, 1);
      const Eigen::Vector2d origin = T_map_camera.translation().head<2>() - middle;
      const double across_m = std::abs(origin.x() * ray.y() - origin.y() * ray.x()) / ray.head<2>().norm();
      if (across_m > 0.75 * kObstacleRadius_m) continue;
      const double a = ray.head<2>().squaredNorm();
      const double b = origin.dot(ray.head<2>());
      const double c = origin.squaredNorm() - kObstacleRadius_m * kObstacleRadius_m;
      const double depth_m = (-b - std::sqrt(b * b - a * c)) / a;
      const double z_map = T_map_camera.translation().z() + depth_m * ray.z();
      if (depth_m <= 0.0 || z_map < 0.01 || z_map > kObstacleHeight_m - 0.01) continue;
      if (before.exact_depth_m.at<float>(v, u) < depth_m) continue;  // the robot's own arm
      ++compared;
      EXPECT_NEAR(during.exact_depth_m.at<float>(v, u), depth_m, 0.003) << u << ", " << v;
      const cv::Vec3b rgb = during.rgb.at<cv::Vec3b>(v, u);
      redder += rgb[0] >= rgb[2] ? 1 : 0;
    }
  }
  EXPECT_GT(compared, 10000);
  EXPECT_EQ(redder, 0) << "it is blue, by 50 grey levels of which the noise is 2";

  robot.run(1.0);
  const RgbdCamera::Frame after = look();
  EXPECT_EQ(robot.scan, scan_before) << "without noise the scans are equal";
  EXPECT_EQ(cv::norm(after.exact_depth_m, before.exact_depth_m, cv::NORM_INF), 0.0);
}

TEST(Simulation, RunningIntoAnObstacleStopsTheBaseAndIsOneCollision) {
  Robot robot(configFor("single_brick"));
  const Pose2d start = robot.sim.world().basePose();
  robot.run(1.0);
  const double ahead_m = 0.8;
  const double aside_m = -0.25;  // where the folded arm, which reaches 0.22 m beyond the base's front, is not
  robot.sim.addFault(obstacleAt(start.x_m + ahead_m, start.y_m + aside_m));
  for (int i = 0; i < 600; ++i) {
    robot.sim.commandBase({0.3, 0.0});
    robot.step();
  }
  // The base's front is 0.296 m before base_link; contacts give by millimetres.
  EXPECT_NEAR(robot.sim.world().basePose().x_m, start.x_m + ahead_m - kObstacleRadius_m - 0.296, 0.005);
  EXPECT_EQ(robot.judged().collisions, 1);
  EXPECT_TRUE(says(robot.incidents, "collision of chassis_link with obstacle_0"));
  ASSERT_EQ(robot.sim.world().obstacles().size(), 1U);
  EXPECT_EQ(robot.sim.world().obstacles()[0].xy_map.x(), start.x_m + ahead_m) << "it stands like a rock";
}

TEST(Simulation, BrickLiesOnAnObstacle) {
  Robot robot(configFor("single_brick"));
  robot.sim.addFault(obstacleAt(1.0, 2.0));
  robot.run(0.1);
  robot.moveBrick(0, at({1.0, 2.0, kObstacleHeight_m + 0.11}));
  EXPECT_NEAR(robot.sim.world().brick(0)->T_map_brick.translation().z(), kObstacleHeight_m + 0.1, 0.002);
  Fault inside = fault(FaultKind::kMoveBrick);
  inside.brick_id = 0;
  inside.T_map_object = at({1.25, 2.0, 0.1});
  EXPECT_THROW(robot.sim.addFault(inside), std::invalid_argument);
}

TEST(Simulation, ObstacleNeverAppearsInsideOfAnything) {
  Robot robot(configFor("single_brick"));
  robot.run(1.0);
  const Pose2d base = robot.sim.world().basePose();
  const Eigen::Vector3d brick = robot.sim.world().brick(0)->T_map_brick.translation();
  robot.sim.addFault(obstacleAt(2.0, 2.0));
  robot.run(0.1);
  const std::uint64_t before = robot.sim.digest();
  const auto refusal = [&robot](const Fault& obstacle) -> std::string {
    return messageOf<std::invalid_argument>([&] { robot.sim.addFault(obstacle); });
  };
  EXPECT_NE(refusal(obstacleAt(base.x_m, base.y_m)).find("must be free"), std::string::npos);
  // 1 cm into the back of the base, 0.527 m behind base_link.
  EXPECT_NE(refusal(obstacleAt(base.x_m - 0.527 - 0.19, base.y_m)).find("chassis_link"), std::string::npos);
  EXPECT_NE(refusal(obstacleAt(brick.x(), brick.y())).find("brick_0"), std::string::npos);
  EXPECT_NE(refusal(obstacleAt(2.3, 2.0)).find("obstacle_0"), std::string::npos);
  EXPECT_EQ(robot.sim.digest(), before) << "asking changes nothing";

  // Later: what holds is what is there then.
  Fault later = obstacleAt(base.x_m, base.y_m, 0.5);
  later.at_s = robot.sim.now() + 1.0;
  robot.sim.addFault(later);
  robot.run(2.0);
  EXPECT_TRUE(says(robot.incidents, "fault obstacle refused: pose is inside"));
  EXPECT_FALSE(says(robot.incidents, "fault obstacle is over")) << "it never began";
  EXPECT_EQ(robot.sim.world().obstacles().size(), 1U);
  EXPECT_EQ(robot.judged().collisions, 0);
}

TEST(Simulation, ObstaclesComeAndGoEachForItself) {
  Robot robot(configFor("single_brick"));
  const std::uint64_t nobody = robot.sim.digest();
  robot.sim.addFault(obstacleAt(2.0, 2.0, 3.0));
  robot.sim.addFault(obstacleAt(2.0, 3.0, 1.0));
  for (int i = 2; i < kMaxObstacles; ++i) robot.sim.addFault(obstacleAt(2.0, 2.0 + i));
  robot.run(0.5);
  EXPECT_NE(robot.sim.digest(), nobody);
  ASSERT_EQ(robot.sim.world().obstacles().size(), static_cast<std::size_t>(kMaxObstacles));
  EXPECT_THROW(robot.sim.addFault(obstacleAt(-2.0, -2.0)), std::invalid_argument) << "one too many";
  robot.run(1.0);
  ASSERT_EQ(robot.sim.world().obstacles().size(), static_cast<std::size_t>(kMaxObstacles - 1));
  EXPECT_EQ(robot.sim.world().obstacles()[0].xy_map.y(), 2.0) << "the second has left, not the first";
  robot.sim.addFault(obstacleAt(2.0, 3.0));
  robot.run(2.0);
  ASSERT_EQ(robot.sim.world().obstacles().size(), static_cast<std::size_t>(kMaxObstacles - 1));
  EXPECT_EQ(robot.sim.world().obstacles()[0].xy_map.y(), 3.0) << "whose place is another's now";
}

TEST(Simulation, ImagesComeOnDemandLateAndNotAtAll) {
  SimulationConfig config = configFor("single_brick");
  config.camera_delay_s = 0.1;
  Robot robot(config);
  robot.run(0.5);
  EXPECT_TRUE(robot.images.empty());
  ASSERT_TRUE(robot.sim.requestImage());
  const std::int64_t asked_ns = robot.sim.nowNs();
  robot.run(0.1);
  EXPECT_TRUE(robot.images.empty());
  robot.run(0.05);
  ASSERT_EQ(robot.images.size(), 1U);
  EXPECT_EQ(robot.images[0].stamp_ns, asked_ns + 10000000) << "stamped when it was taken: at the next tick";

  config = configFor("single_brick");
  config.camera_rate_hz = 20.0;
  config.camera_drop_probability = 0.5;
  Robot losing(config);
  losing.run(5.0);
  // 100 draws of 0.5: 5 sigma is 25.
  EXPECT_GT(losing.images.size(), 25U);
  EXPECT_LT(losing.images.size(), 75U);
}

TEST(Simulation, WeakMagnetLiftsNothing) {
  Robot robot(configFor("single_brick"));
  Fault weak = fault(FaultKind::kMagnetWeak);
  weak.value = 0.05;
  robot.sim.addFault(weak);
  robot.grasp(0);
  robot.moveArm(robot.tool.angles(Robot::kReach_m, 0.5), 2.0);
  EXPECT_FALSE(robot.sim.world().heldBrick().has_value());
  EXPECT_EQ(robot.judged().drops, 0) << "it never left the ground";
}

TEST(Simulation, AHeavyBrickStaysAndIsNotPickable) {
  const SceneFile heavy(
      "brick_type: brick\nrobot_start: {xy_m: [-3, 0]}\nbricks: [{id: 0, xyz_m: [0, 0, 0.1]}]\ndecoys: {heavy: 1}\n");
  Robot robot(heavy.config());
  EXPECT_EQ(robot.sim.judge().report().bricks_total, 1);
  EXPECT_EQ(robot.sim.judge().report().bricks_pickable, 0);
  robot.grasp(0);
  robot.moveArm(robot.tool.angles(Robot::kReach_m, 0.5), 2.0);
  EXPECT_FALSE(robot.sim.world().heldBrick().has_value());
  EXPECT_LT(robot.sim.world().brick(0)->T_map_brick.translation().z(), 0.11);
  EXPECT_EQ(robot.judged().drops, 0) << "it never left the ground";
}

TEST(Simulation, OtherBodiesHaveNoPlateToHoldThemBy) {
  for (const std::string kind : {"untagged", "cardboard", "sphere"}) {
    SCOPED_TRACE(kind);
    const SceneFile scene(
        "brick_type: brick\nrobot_start: {xy_m: [-3, 0]}\nbricks: [{id: 0, xyz_m: [0, 0, 0.1]}]\ndecoys: {" + kind +
        ": 1}\n");
    Robot robot(scene.config());
    EXPECT_EQ(robot.sim.judge().report().bricks_pickable, 0);
    robot.grasp(0);
    EXPECT_FALSE(robot.sim.world().heldBrick().has_value());
  }
}

TEST(Simulation, BricksOfOtherTypesHaveNoTags) {
  const SceneFile scene("brick_type: half\nrobot_start: {xy_m: [-3, 0]}\nbricks: [{id: 0, xyz_m: [0, 0, 0.06]}]\n");
  SimulationConfig config = scene.config();
  config.description.bricks = MP700_UR5E_DESCRIPTION_DIR "/config/bricks_three_sizes.yaml";
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { const Simulation refused(config); }),
              HasSubstr("brick 0 is of type half, must be brick, as " + config.description.bricks + " labels it"));
  config.has_tags = false;
  const Simulation plain(config);
  EXPECT_EQ(plain.scene().bricks.at(0).type.name, "half");
}

const char* const kWallAhead =
    "brick_type: brick\nrobot_start: {xy_m: [-3, 0]}\nbricks: [{id: 0, xyz_m: [0, 0, 0.1]}]\n"
    "walls: [{center_m: [-1.5, 0.0], size_m: [0.2, 4.0, 2.0]}]\n";

TEST(Simulation, WallIsSeenByScannerAndCamera) {
  const SceneFile scene(kWallAhead);
  Robot robot(scene.config());
  ASSERT_TRUE(robot.sim.requestImage());
  robot.run(0.1);  // a scan and an image
  const Eigen::Vector3d scanner = robot.sim.world().linkPose("lidar_1_link").translation();
  EXPECT_NEAR(robot.scan[robot.scan.size() / 2], -1.6 - scanner.x(), 1e-3) << "its face towards the robot";
  const RgbdCamera::Frame& frame = robot.images.at(0).frame;
  const auto& camera = robot.sim.config().camera.camera;
  const Eigen::Isometry3d T_map_camera = robot.sim.world().linkPose("camera_depth_optical_frame");
  int compared = 0;
  for (int v = 0; v < frame.exact_depth_m.rows; v += 4) {
    for (int u = 0; u < frame.exact_depth_m.cols; u += 4) {
      const Eigen::Vector3d ray = T_map_camera.linear() * Eigen::Vector3d((u - camera.cx_px) / camera.fx_px,
                                                                          (v - camera.cy_px) / camera.fy_px, 1);
      const double depth_m = (-1.6 - T_map_camera.translation().x()) / ray.x();
      const Eigen::Vector3d p_map = T_map_camera.translation() + depth_m * ray;
      // On the wall, and not behind the robot's own arm, which is nearer by a lot.
      if (depth_m < 0.0 || p_map.z() < 0.02 || frame.exact_depth_m.at<float>(v, u) < depth_m - 0.1) continue;
      ++compared;
      EXPECT_NEAR(frame.exact_depth_m.at<float>(v, u), depth_m, 0.003) << u << ", " << v;  // the depth buffer's steps
    }
  }
  EXPECT_GT(compared, 1000);
}

TEST(Simulation, RunningIntoAWallIsACollisionWithIt) {
  const SceneFile scene(kWallAhead);
  Robot robot(scene.config());
  for (int i = 0; i < 500; ++i) {
    robot.sim.commandBase({0.4, 0.0});
    robot.step();
  }
  EXPECT_LT(robot.sim.world().basePose().x_m, -1.6 - 0.29) << "the base's front is 0.296 m before base_link";
  EXPECT_GE(robot.judged().collisions, 1);
  EXPECT_TRUE(says(robot.incidents, "with wall_0"));
}

TEST(Simulation, BricksThatLeanOnAWallFallAsleep) {
  Robot robot(configFor("in_corner"));
  int leaning = 0;
  const PileScene& scene = robot.sim.scene();
  for (const BrickPlacement& brick : scene.bricks) {
    for (const Wall& wall : scene.walls) {
      const double gap_m = boxSeparation(brick.T_map_brick, brick.type.size_m, wall.pose(), wall.size_m);
      leaning += gap_m < 0.001 ? 1 : 0;
    }
  }
  ASSERT_GT(leaning, 0) << "no brick touches a wall";
  robot.run(4.0);
  EXPECT_EQ(robot.sim.world().numAwake(), 0);
  EXPECT_EQ(robot.judged().falls, 0);
}

TEST(Simulation, TheSunCastsTheBricksShadow) {
  for (const bool has_sun : {false, true}) {
    SimulationConfig config = configFor("single_brick");
    config.world.has_sun = has_sun;
    Robot robot(config);
    ASSERT_TRUE(robot.sim.requestImage());
    robot.step();
    const auto& camera = robot.sim.config().camera.camera;
    const Eigen::Isometry3d T_map_camera = robot.sim.world().linkPose("camera_depth_optical_frame");
    const auto greyAt = [&](const Eigen::Vector3d& p_map) {
      const Eigen::Vector3d p = T_map_camera.inverse() * p_map;
      const int u = static_cast<int>(std::lround(camera.fx_px * p.x() / p.z() + camera.cx_px));
      const int v = static_cast<int>(std::lround(camera.fy_px * p.y() / p.z() + camera.cy_px));
      const cv::Vec3b rgb = robot.images.at(0).frame.rgb.at<cv::Vec3b>(v, u);
      return (rgb[0] + rgb[1] + rgb[2]) / 3.0;
    };
    // The sun is in the direction (-0.60, -0.30, 0.75): beside the brick, 0.2 m high, there is shadow as far as y = 0.18.
    const double beside = greyAt({0.0, 0.14, 0.0});
    const double open = greyAt({0.0, 0.5, 0.0});
    if (has_sun) {
      EXPECT_LT(beside, 0.7 * open);
    } else {
      EXPECT_NEAR(beside, open, 0.05 * open);
    }
  }
}

TEST(Simulation, LostBrickIsADropAndNoFall) {
  Robot robot(configFor("single_brick"));
  robot.grasp(0);
  robot.moveArm(robot.tool.angles(Robot::kReach_m, 0.6), 2.0);
  ASSERT_EQ(robot.sim.world().heldBrick(), 0);
  robot.sim.addFault(fault(FaultKind::kDropBrick));
  robot.run(3.0);
  EXPECT_FALSE(robot.sim.world().heldBrick().has_value());
  EXPECT_EQ(robot.sim.armDriver().io().analog_in_V[0], 0.0);
  EXPECT_EQ(robot.judged().drops, 1);
  EXPECT_EQ(robot.judged().falls, 0);
  EXPECT_TRUE(says(robot.incidents, "the magnet lost brick 0"));
  // Where it lies it is in the way like any other.
  Pose2d base = robot.sim.world().basePose();
  const Eigen::Vector3d lies = robot.sim.world().brick(0)->T_map_brick.translation();
  EXPECT_GT(lies.x(), base.x_m + 0.3);
  robot.sim.setTarget(std::nullopt);
  for (int i = 0; i < 300; ++i) {
    robot.sim.commandBase({0.5, 0.0});
    robot.step();
  }
  EXPECT_GT(robot.judged().collisions, 0) << "driven over";
}

TEST(Simulation, BrickMovedBySomebodyIsNoFall) {
  Robot robot(configFor("single_brick"));
  robot.moveBrick(0, at({1.0, 1.0, 0.1}, 1.0));
  EXPECT_EQ(robot.judged().falls, 0);
  EXPECT_NEAR(robot.sim.world().brick(0)->T_map_brick.translation().x(), 1.0, 0.002);
  Fault nobody = fault(FaultKind::kMoveBrick);
  nobody.brick_id = 4;
  EXPECT_THROW(robot.sim.addFault(nobody), std::invalid_argument);
  Fault nowhere = fault(FaultKind::kMoveBrick);
  nowhere.brick_id = 0;
  const std::uint64_t before = robot.sim.digest();
  for (const Eigen::Vector3d& taken : {Eigen::Vector3d(0.0, 0.0, -1.0), Eigen::Vector3d(-3.0, 0.0, 0.3),
                                       Eigen::Vector3d(1e6, 0.0, 0.1)}) {  // ground, robot, too far
    nowhere.T_map_object = at(taken);
    EXPECT_THROW(robot.sim.addFault(nowhere), std::invalid_argument) << taken.transpose();
  }
  EXPECT_EQ(robot.sim.digest(), before) << "asking changes nothing";
}

TEST(Simulation, ScannerSeesTheBrickInFront) {
  Robot robot(configFor("single_brick"));
  const Eigen::Vector3d scanner = robot.sim.world().linkPose("lidar_1_link").translation();
  robot.moveBrick(0, at({scanner.x() + 1.0 + 0.15, scanner.y(), 0.1}));
  ASSERT_FALSE(robot.scan.empty());
  const double ahead = robot.scan[robot.scan.size() / 2];
  EXPECT_NEAR(ahead, 1.0, 0.002) << "the face towards the robot";
}

// What camera, drawing and world make of the scene against the ray caster that knows none of them.
TEST(Simulation, RenderedDepthIsTheAnalyticDepth) {
  Robot robot(configFor("three_pyramid"));
  // Nearer, so that the pile fills the view.
  for (int i = 0; i < 300; ++i) {
    robot.sim.commandBase({0.5, 0.0});
    robot.step();
  }
  robot.run(1.5);
  ASSERT_TRUE(robot.sim.requestImage());
  robot.step();
  ASSERT_EQ(robot.images.size(), 1U);
  const cv::Mat& seen = robot.images[0].frame.exact_depth_m;

  synthetic_depth::Scene scene;
  scene.T_map_scene = Eigen::Isometry3d::Identity();
  scene.camera = robot.sim.config().camera.camera;
  scene.T_scene_camera = {robot.sim.world().linkPose("camera_depth_optical_frame")};
  for (const BrickMotion& brick : robot.sim.world().bricks()) {
    synthetic_depth::Box box;
    box.id = brick.id;
    box.T_scene_box = brick.T_map_brick;
    box.half_extents_m = {0.15, 0.10, 0.10};
    scene.boxes.push_back(box);
  }
  const cv::Mat exact = synthetic_depth::renderDepth(scene, 0);
  ASSERT_EQ(seen.size(), exact.size());
  int compared = 0;
  int wrong = 0;
  int hidden_by_robot = 0;
  for (int v = 1; v + 1 < seen.rows; ++v) {
    for (int u = 1; u + 1 < seen.cols; ++u) {
      const float truth = exact.at<float>(v, u);
      const float depth = seen.at<float>(v, u);
      if (!std::isfinite(truth)) {
        continue;
      }
      if (depth < truth - 0.05F) {
        ++hidden_by_robot;
        continue;
      }
      // At silhouettes a pixel may fall to either side.
      bool is_edge = false;
      for (int dv = -1; dv <= 1; ++dv) {
        for (int du = -1; du <= 1; ++du) {
          is_edge |= std::abs(exact.at<float>(v + dv, u + du) - truth) > 0.03F;
        }
      }
      if (!is_edge) {
        ++compared;
        wrong += std::abs(depth - truth) > 0.001F ? 1 : 0;  // five times the depth buffer's step at 6 m
      }
    }
  }
  EXPECT_GT(compared, 200000);
  EXPECT_LT(wrong, compared / 10000) << "of " << compared;
  EXPECT_LT(hidden_by_robot, 40000) << "the folded arm in the lower part of the image";
}

TEST(Simulation, SensorEffectsAreThoseAskedFor) {
  SimulationConfig config = configFor("three_pyramid");
  config.camera.sensor.max_range_m = 3.0;
  config.camera.sensor.min_range_m = 1.0;
  config.camera.sensor.axial_noise_c_per_m = 0.004;
  config.camera.sensor.baseline_m = 0.05;
  config.camera.sensor.has_shadows = true;
  Robot robot(config);
  ASSERT_TRUE(robot.sim.requestImage());
  robot.step();
  const RgbdCamera::Frame& frame = robot.images.at(0).frame;
  int far = 0;
  int near = 0;
  int none = 0;
  for (int v = 0; v < frame.depth_m.rows; ++v) {
    for (int u = 0; u < frame.depth_m.cols; ++u) {
      const float depth = frame.depth_m.at<float>(v, u);
      const float exact = frame.exact_depth_m.at<float>(v, u);
      far += std::isinf(depth) && depth > 0 ? 1 : 0;
      near += std::isinf(depth) && depth < 0 ? 1 : 0;
      none += std::isnan(depth) ? 1 : 0;
      if (std::isfinite(depth)) {
        // Six sigma of 0.004 z^2.
        EXPECT_NEAR(depth, exact, 6 * 0.004 * exact * exact);
      }
    }
  }
  EXPECT_GT(far, 1000) << "ground beyond 3 m";
  EXPECT_GT(near, 1000) << "the robot's own arm";
  EXPECT_GT(none, 100) << "behind the arm's edge";
}

TEST(Simulation, RefusesWhatCannotBe) {
  SimulationConfig config = configFor("single_brick");
  config.tick_s = 0.003;
  config.camera_drop_probability = 2.0;
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { const Simulation refused(config); }),
              AllOf(HasSubstr("clock/tick_s must be a whole number of physics/timestep_s"),
                    HasSubstr("camera/drop_probability = 2, must be in [0, 1]")));
  config = configFor("no_such_scene");
  EXPECT_THROW(Simulation{config}, std::invalid_argument);
  config = configFor("single_brick");
  config.description.urdf = "nowhere.urdf";
  EXPECT_THROW(Simulation{config}, std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
