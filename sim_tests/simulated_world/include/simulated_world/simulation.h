// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Geometry>

#include "simulated_world/brick_texture.h"
#include "simulated_world/cost_meter.h"
#include "simulated_world/differential_drive.h"
#include "simulated_world/fault.h"
#include "simulated_world/judge.h"
#include "simulated_world/laser_scanner.h"
#include "simulated_world/pile_scene.h"
#include "simulated_world/rgbd_camera.h"
#include "simulated_world/ur_controller.h"
#include "simulated_world/world.h"

namespace simulated_world {

/// Where the facts about robot and bricks are kept: the files of mp700_ur5e_description.
struct DescriptionFiles {
  std::string urdf;
  std::string base_profile;
  std::string bricks;
  std::string arm_pose;  ///< in which the arm is at the start
};

struct SimulationConfig {
  DescriptionFiles description;
  std::string scene;    ///< file of a pile scene
  bool has_tags{true};  ///< false: no brick has tags, whatever the scene says
  std::uint64_t seed{1};

  WorldConfig world;
  UrControllerConfig arm_driver;
  RgbdCameraConfig camera;
  JudgeConfig judge;  ///< the height of its lookouts is the robot's camera's
  double scan_noise_std_m{0.0};
  // Of the base's odometry and of the localisation, which otherwise is ground truth.
  double odometry_scale_std{0.0};
  double odometry_walk_m_per_sqrt_m{0.0};
  double odometry_walk_rad_per_sqrt_m{0.0};
  double localisation_std_m{0.0};
  double localisation_std_rad{0.0};
  double localisation_correlation_s{0.0};

  double tick_s{0.01};
  double joint_state_rate_hz{100.0};
  double odometry_rate_hz{50.0};
  double camera_rate_hz{5.0};
  double camera_delay_s{0.0};
  double camera_drop_probability{0.0};

  int magnet_output{0};
  double container_rest_s{0.3};
  double unload_s{15.0};
  bool arm_starts_running{true};
  double start_time_s{10.0};

  /// By the parameters' sections, from "clock" to "camera". Files and seed belong to the call.
  static void fields(SimulationConfig& c, interactive_mapping::Fields& f);
};

/// A picture of the whole, for people.
struct PictureConfig {
  int width_px{960};
  int height_px{540};
  double fovy_rad{0.5};
  int samples{8};  ///< per pixel: smooth edges

  std::vector<std::string> validate() const;
};

/// Whether the base's relay board has stopped the drives, and by what.
struct RelayBoard {
  enum class State { kFree, kStopped, kConfirmed };  // as neo_msgs/EmergencyStopState
  bool is_button_pressed{false};
  bool is_scanner_blocked{false};
  State state{State::kFree};
};

/// The whole simulated robot in its world, one clock tick at a time: drivers' behaviour on one side, physics on the
/// other, and the judge who sees both. No ROS; threads only within a call, where each fills a place of its own: the same calls
/// give the same bits. Must stay in the thread that made it, as its renderer does.
/// Long: a tick has one order of all parts, and the faults reach into each of them.
class Simulation {
 public:
  /// Reads the files, settles the pile, builds the world. Takes some seconds for large piles. Throws
  /// std::invalid_argument or std::runtime_error with the reason.
  explicit Simulation(const SimulationConfig& config);
  ~Simulation();

  /// What one tick brought.
  struct Tick {
    std::int64_t stamp_ns{0};
    bool has_joint_states{false};
    bool has_odometry{false};
    bool has_localisation{false};
    struct Image {
      std::int64_t stamp_ns;  ///< of the capture
      RgbdCamera::Frame frame;
    };
    std::vector<Image> images;
    std::optional<std::vector<float>> scan;
    std::vector<std::string> incidents;  ///< a sentence each: faults, stops, bricks lost and stowed
  };
  /// Advances by config().tick_s: what has been commanded takes effect, what falls due comes back. Throws
  /// std::runtime_error if the physics fail.
  Tick tick();

  std::int64_t nowNs() const { return now_ns_; }
  double now() const { return static_cast<double>(now_ns_) * 1e-9; }

  // The drivers' commands.
  UrController& armDriver() { return *arm_; }
  /// False if the command is not finite or the base is halted by its button or scanner.
  bool commandBase(const Twist2d& twist);
  /// One image at the next tick, whatever the rate. False while the camera is gone.
  bool requestImage();
  /// Images that nobody looks at need not be drawn; nothing else changes by it.
  void setCameraUsed(bool is_used) { is_camera_used_ = is_used; }

  // Experiments.
  /// Throws std::invalid_argument with what is wrong.
  void addFault(const Fault& fault);
  void clearFaults() { faults_.clear(); }
  /// Somebody at the depot takes all bricks out of the container, unload_s after they were first asked to. How many; nothing:
  /// not yet.
  std::optional<int> unload();
  /// The brick that the tool is about to touch; contact of tool and brick is a collision otherwise.
  void setTarget(std::optional<int> brick_id) { target_ = brick_id; }
  /// The same, where it is said to be [m, map frame]: a detection without tags does not know the ids. It is the brick of
  /// this id unless that is elsewhere and another one is there.
  void setTarget(int brick_id, const Eigen::Vector3d& p_map);
  /// In the map frame. Throws std::invalid_argument for a broken surface.
  void judgeSurface(const StrategySurface& surface) { judge_->judgeSurface(surface); }
  Judge& judge() { return *judge_; }

  // What the drivers tell.
  const World& world() const { return *world_; }
  const DifferentialDrive& drive() const { return *drive_; }
  RelayBoard relayBoard() const;
  /// What the arm's driver tells: less what it was when the sensor was zeroed. In ur5e_tool0, N and N m.
  ToolWrench wrench() const;
  /// Of `odom` in `map`: ground truth and odometry put together, with the localisation's noise and error.
  const Pose2d& mapToOdom() const { return map_to_odom_; }
  const PileScene& scene() const { return scene_; }
  const LaserScannerConfig& scannerConfig() const;
  const std::string& scannerFrame() const { return scanner_frame_; }
  int bricksStowed() const { return stowed_; }
  /// The world as it is: pile, robot, and room for the robot to go around the pile, from behind the robot's first place
  /// and aside; always the same view. CV_8UC3 in the order red, green, blue. It is drawn in a world of its own, which the
  /// first call makes (a second or so): what the robot measures does not change by it. `config` counts in the first call.
  /// Throws std::invalid_argument for a bad one.
  cv::Mat picture(const PictureConfig& config = {});
  std::uint64_t digest() const { return world_->digest(); }
  const SimulationConfig& config() const { return config_; }
  /// Of all ticks so far. Surfaces that the judge was shown are not among it.
  const CostMeter& costs() const { return costs_; }

 private:
  /// What worlds are made of.
  struct Blueprint {
    std::string robot_mjcf;
    std::string assets_mjcf;
    std::vector<WorldBrick> bricks;
    std::vector<BrickAppearance> looks;  ///< of the bricks
    std::vector<Wall> walls;
    Pose2d start;
    ArmVector arm_start_rad;
    WorldConfig world;
  };
  static std::unique_ptr<World> makeWorld(const Blueprint& blueprint, std::uint64_t seed);
  struct Stage;

  void layPile();  ///< the scene at rest: into the blueprint and the records
  void applyFaults(Tick* tick);
  void beginFault(const FaultSchedule::Change& change, Tick* tick);
  void endFault(const FaultSchedule::Change& change, Tick* tick);
  /// Why a fault's pose is not to be had now; empty: it is.
  std::string placeProblem(const Fault& fault);
  void haltBase(FaultKind kind);
  void releaseBase(FaultKind kind);
  void startArm();
  void declarePayload(const UrPayload& payload);
  void stepPhysics(double now_s, Tick* tick);
  bool isArmOnBrakes(double now_s);
  double pushOnArm() const;  // of the surroundings, as a share of what makes the arm stop
  void watchForCollision(double now_s, Tick* tick);
  void followMagnet(double now_s, Tick* tick);
  void stowBricks(Tick* tick);
  void takeImages(Tick* tick);
  void observe(Tick* tick);
  bool isDue(double rate_hz) const;

  struct BrickRecord {
    int id;
    Eigen::Vector3d size_m;
    BrickStatus status;
    Eigen::Isometry3d T_map_grasp;  // where it was when the magnet took it
    double status_since_s;
    double rests_since_s;  // in the container; < 0: it does not
    bool is_pickable;
  };
  BrickRecord& record(int id);
  void drop(BrickRecord* brick);
  bool isCarried(const BrickRecord& brick) const;  ///< farther than a lift from where it was grasped

  SimulationConfig config_;
  PileScene scene_;
  std::string scanner_frame_;
  Blueprint blueprint_;
  std::unique_ptr<World> world_;
  std::unique_ptr<Stage> stage_;  // of the pictures
  std::unique_ptr<DifferentialDrive> drive_;
  std::unique_ptr<UrController> arm_;
  std::unique_ptr<OffscreenRenderer> renderer_;
  std::unique_ptr<RgbdCamera> camera_;
  std::unique_ptr<LaserScanner> scanner_;
  std::unique_ptr<Judge> judge_;
  CostMeter costs_;
  FaultSchedule faults_;
  synthetic_depth::SeededRandom random_;
  synthetic_depth::SeededRandom force_random_;
  double force_noise_std_N_{0.0};
  Eigen::Vector3d force_noise_N_{Eigen::Vector3d::Zero()};  // of the last joint states
  std::vector<BrickRecord> bricks_;
  std::vector<Tick::Image> images_on_their_way_;
  std::optional<ToolWrench> wrench_zero_;
  Pose2d map_to_odom_;
  Pose2d localisation_error_;                                    // from the true map frame to the one that is told of
  Eigen::Vector3d localisation_noise_{Eigen::Vector3d::Zero()};  // x, y, yaw, in standard deviations
  bool has_localised_{false};
  std::map<std::uint64_t, int> obstacle_of_fault_;
  std::optional<int> target_;
  std::int64_t now_ns_;
  std::int64_t tick_ns_;
  int steps_per_tick_;
  int overload_steps_{0};
  std::optional<ArmVector> brake_rad_;  // where the brakes hold the arm
  double stopped_since_s_{0.0};
  std::uint64_t frame_number_{0};
  std::uint64_t scan_number_{0};
  double scan_rate_hz_{0.0};
  bool image_wanted_{false};
  std::optional<double> unload_asked_s_;  // of the container
  bool camera_gone_{false};
  bool scanner_gone_{false};
  bool odometry_gone_{false};
  bool localisation_gone_{false};
  bool is_camera_used_{true};
  std::set<FaultKind> base_halts_;
  double base_free_s_{0.0};
  int stowed_{0};
};

}  // namespace simulated_world
