// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/simulation.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/threads/parallel_for.h>
#include <mp700_ur5e_description/arm_pose.h>
#include <mp700_ur5e_description/base_profile.h>
#include <mp700_ur5e_description/brick_types.h>
#include <mp700_ur5e_description/robot_names.h>
#include <urdf_parser/urdf_parser.h>

#include "simulated_world/field_section.h"
#include "simulated_world/pickable.h"
#include "simulated_world/robot_mjcf.h"
#include "simulated_world/scene_view.h"
#include "simulated_world/settle.h"

namespace simulated_world {
namespace {

namespace description = mp700_ur5e_description;

constexpr double kBaseConfirmed_s = 1.0;  // the relay board says so for so long after a stop
constexpr double kHandTime_s = 2.0;       // a brick put somewhere by hand is left alone so long after
constexpr double kStandsSpeed_m_s = 0.01;
constexpr double kLifted_m = 0.05;  // a held brick is carried once it has been moved so far
constexpr int kCollisionSteps = 3;  // a shorter spike is the solver's, not a force
// The arm's safety system stops it when the surroundings push harder on the tool, or on a joint as a share of what its
// motor can do.
constexpr double kCollisionStop_N = 200.0;
constexpr double kCollisionStopEffort = 0.6;
constexpr double kLowestRate_hz = 1e-3;

std::string sentence(double now_s, const std::string& text) {
  std::ostringstream line;
  line.precision(3);
  line << std::fixed << now_s << " s: " << text;
  return line.str();
}

urdf::ModelInterfaceSharedPtr readRobot(const std::string& file) {
  urdf::ModelInterfaceSharedPtr robot = urdf::parseURDFFile(file);
  if (!robot) {
    throw std::invalid_argument("robot description " + file + ": does not exist, or is no URDF");
  }
  return robot;
}

std::vector<JointLimits> armLimits(const urdf::ModelInterface& robot) {
  std::vector<JointLimits> limits;
  for (const std::string name : kArmJoints) {
    const urdf::JointConstSharedPtr joint = robot.getJoint(name);
    if (!joint || !joint->limits) {
      throw std::invalid_argument("robot description: no joint \"" + name + "\" with limits");
    }
    limits.push_back(
        {name, joint->limits->lower, joint->limits->upper, joint->limits->velocity, joint->limits->effort});
  }
  return limits;
}

std::array<bool, 6> platesOf(const description::BrickType& type) {
  std::array<bool, 6> has_plate{};
  for (const description::BrickFace face : type.plate_faces) has_plate[static_cast<std::size_t>(face)] = true;
  return has_plate;
}

bool canHaveTags(Decoy decoy) {
  return decoy != Decoy::kUntagged && decoy != Decoy::kCardboard && decoy != Decoy::kSphere &&
         decoy != Decoy::kCylinder;
}

BrickAppearance appearanceOf(const BrickPlacement& placement, const description::BrickCatalogue& catalogue) {
  const description::BrickType& type = placement.type;
  BrickAppearance look;
  look.size_m = type.size_m;
  look.plate_edge_m = type.plate_edge_m;
  look.has_plate = platesOf(type);
  look.has_tags = canHaveTags(placement.decoy);
  look.tag_edge_m = catalogue.tags.black_border_edge_m;
  look.colour_rgb = type.color_rgb;
  look.family = catalogue.tags.family;
  for (std::size_t face = 0; face < look.tag_ids.size(); ++face) {
    look.tag_ids[face] = catalogue.tagId(placement.id, description::kBrickFaces[face]);
  }
  return look;
}

DifferentialDriveConfig driveOf(const description::BaseProfile& profile, const SimulationConfig& config) {
  DifferentialDriveConfig drive;
  drive.wheel_radius_m = profile.drive.wheel_radius_m;
  drive.track_m = profile.drive.track_m;
  // What the drives are able to do, not what a planner should ask for; turning follows from the wheels.
  drive.max_forward_m_s = profile.rating.linear_m_per_s;
  drive.max_backward_m_s = profile.rating.linear_m_per_s;
  drive.max_angular_rad_s = 2.0 * profile.rating.linear_m_per_s / profile.drive.track_m;
  drive.linear_acceleration_m_s2 = profile.rating.linear_m_per_s2;
  drive.angular_acceleration_rad_s2 = 2.0 * profile.rating.linear_m_per_s2 / profile.drive.track_m;
  drive.odometry_scale_std = config.odometry_scale_std;
  drive.odometry_walk_m_per_sqrt_m = config.odometry_walk_m_per_sqrt_m;
  drive.odometry_walk_rad_per_sqrt_m = config.odometry_walk_rad_per_sqrt_m;
  drive.seed = config.seed;
  return drive;
}

LaserScannerConfig scannerOf(const description::BaseProfile::Scanner& profile, const SimulationConfig& config) {
  LaserScannerConfig scanner;
  scanner.angle_min_rad = profile.min_angle_rad;
  scanner.angle_max_rad = profile.max_angle_rad;
  scanner.angle_increment_rad = profile.increment_rad;
  scanner.range_min_m = profile.range_min_m;
  scanner.range_max_m = profile.range_max_m;
  scanner.range_noise_std_m = config.scan_noise_std_m;
  scanner.seed = config.seed;
  return scanner;
}

constexpr double kPictureMargin = 0.03;  // share of the picture that stays free at each border

Eigen::Vector2d middleOf(const PileScene& scene) {
  Eigen::Vector2d middle(0.0, 0.0);
  for (const BrickPlacement& brick : scene.bricks) {
    middle += brick.T_map_brick.translation().head<2>() / static_cast<double>(scene.bricks.size());
  }
  return middle;
}

/// What a picture of a run has to show: the pile, and of the robot the arm that picks.
std::vector<Eigen::Vector3d> pointsOfInterest(const PileScene& scene) {
  constexpr double kRoom_m = 0.6;       // beside the pile, on the ground: the front of the base
  constexpr double kArmHeight_m = 1.0;  // of the elbow, about
  constexpr double kRoomAbove_m = 0.2;  // beside the pile, at that height
  std::vector<Eigen::Vector3d> points;
  const auto addCircle = [&points](const Eigen::Vector2d& middle, double radius_m, double z_m) {
    constexpr int kCorners = 16;
    for (int i = 0; i < kCorners; ++i) {
      const double angle = 2.0 * M_PI * i / kCorners;
      points.emplace_back(middle.x() + radius_m * std::cos(angle), middle.y() + radius_m * std::sin(angle), z_m);
    }
  };
  const Eigen::Vector2d middle = middleOf(scene);
  double pile_radius_m = 0.0;
  for (const BrickPlacement& brick : scene.bricks) {
    pile_radius_m = std::max(pile_radius_m, (brick.T_map_brick.translation().head<2>() - middle).norm());
  }
  addCircle(middle, pile_radius_m + kRoom_m, 0.0);
  addCircle(middle, pile_radius_m + kRoomAbove_m, kArmHeight_m);
  return points;
}

/// From behind the robot's first place and to its right, downwards.
Eigen::Vector3d overviewDirection(const PileScene& scene) {
  constexpr double kAside_rad = 0.6;
  constexpr double kDown_rad = 0.75;  // steep enough to see the pile over the robot
  Eigen::Vector2d ahead = middleOf(scene) - scene.robot_start.xy_m;
  if (!(ahead.norm() > 1e-6)) {
    ahead = {1.0, 0.0};
  }
  const Eigen::Vector2d aside = Eigen::Rotation2Dd(kAside_rad) * ahead.normalized();
  return {aside.x(), aside.y(), -std::tan(kDown_rad)};
}

}  // namespace

void SimulationConfig::fields(SimulationConfig& c, interactive_mapping::Fields& f) {
  const double tick_rate_hz = 1.0 / c.tick_s;
  fieldSection(f, "clock", [&] {
    const double steps = c.tick_s / c.world.physics.timestep_s;
    f("tick_s", c.tick_s, c.world.physics.timestep_s, 0.1, "s", "step of /clock: a whole number of physics steps");
    f.require(std::abs(steps - std::round(steps)) < 1e-6, "tick_s must be a whole number of physics/timestep_s");
    f("start_time_s", c.start_time_s, 1e-3, 1e9, "s", "first time on /clock; not 0, which ROS takes for no time yet");
  });
  fieldSection(f, "physics", [&] { WorldConfig::physicsFields(c.world, f); });
  fieldSection(f, "arm", [&] {
    f("headless_mode", c.arm_driver.headless_mode, "true: the driver sends its program itself; false: it is played");
    f("starts_running", c.arm_starts_running, "true: powered, brakes released, program running; false: powered off");
    f("joint_state_rate_hz", c.joint_state_rate_hz, kLowestRate_hz, tick_rate_hz, "Hz",
      "rate of the joint states, at most one per tick; the real driver: 500 Hz");
    WorldConfig::armFields(c.world, f);
  });
  fieldSection(f, "magnet", [&] {
    f("digital_output", c.magnet_output, 0, static_cast<int>(UrIo::kDigitalPins) - 1, "",
      "output of the arm's controller that switches the magnet");
    MagnetConfig::fields(c.world.magnet, f);
  });
  fieldSection(f, "container", [&] {
    f("rest_s", c.container_rest_s, 0.0, 60.0, "s",
      "a brick that lies flat on the container's floor, at rest for this time, is stowed");
    f("unload_s", c.unload_s, 0.0, 3600.0, "s", "time to empty the container at the depot");
  });
  fieldSection(f, "base", [&] {
    f("odometry_rate_hz", c.odometry_rate_hz, kLowestRate_hz, tick_rate_hz, "Hz",
      "rate of odometry and localisation, at most one per tick");
    WorldConfig::baseFields(c.world, f);
    f("odometry_scale_std", c.odometry_scale_std, 0.0, 0.5, "",
      "standard deviation of the relative error of distance and turn, drawn once");
    f("odometry_walk_m_per_sqrt_m", c.odometry_walk_m_per_sqrt_m, 0.0, 0.5, "m/sqrt(m)", "random walk of the distance");
    f("odometry_walk_rad_per_sqrt_m", c.odometry_walk_rad_per_sqrt_m, 0.0, 0.5, "rad/sqrt(m)",
      "random walk of the heading");
    f("localisation_std_m", c.localisation_std_m, 0.0, 1.0, "m", "noise of map -> odom; 0: ground truth");
    f("localisation_std_rad", c.localisation_std_rad, 0.0, 1.0, "rad", "noise of its yaw");
    f("localisation_correlation_s", c.localisation_correlation_s, 0.0, 3600.0, "s",
      "time in which this noise drifts from one value to another; 0: each value is another one");
    f("scan_noise_std_m", c.scan_noise_std_m, 0.0, 1.0, "m", "standard deviation of the laser scanner's ranges");
  });
  fieldSection(f, "camera", [&] {
    f("rate_hz", c.camera_rate_hz, 0.0, 60.0, "Hz", "rate of the images; 0: only on the service camera/capture");
    f("delay_s", c.camera_delay_s, 0.0, 5.0, "s", "time from capture (the image's stamp) to delivery");
    f("drop_probability", c.camera_drop_probability, 0.0, 1.0, "", "share of images that are lost");
    f("has_sun", c.world.has_sun, "true: light from one side, with shadows; false: even light from the camera");
    RgbdCameraConfig::fields(c.camera, f);
  });
}

Simulation::Simulation(const SimulationConfig& config)
    : config_(interactive_mapping::requireValid("simulation:", config)),
      random_(config.seed, 1, 0),
      force_random_(config.seed, 2, 0),
      now_ns_(std::llround(config.start_time_s * 1e9)) {
  tick_ns_ = std::llround(config.tick_s * 1e9);
  steps_per_tick_ = static_cast<int>(std::lround(config.tick_s / config.world.physics.timestep_s));

  const description::BaseProfile profile = description::loadBaseProfile(config.description.base_profile);
  const ArmVector arm_start = description::loadArmPose(config.description.arm_pose);

  layPile();
  const urdf::ModelInterfaceSharedPtr robot = readRobot(config.description.urdf);
  const std::vector<JointLimits> limits = armLimits(*robot);
  blueprint_.world = config.world;
  for (int i = 0; i < kNumArmJoints; ++i) {
    blueprint_.world.servo.arm_effort_Nm[i] = limits[static_cast<std::size_t>(i)].effort_Nm;
  }
  RobotMjcfOptions robot_options;
  robot_options.arm.damping = 0.0;  // the servo is damped, and knows of no other friction
  robot_options.camera_fovy_rad = 2.0 * std::atan(0.5 * config.camera.camera.height_px / config.camera.camera.fy_px);
  const Pose2d start{scene_.robot_start.xy_m.x(), scene_.robot_start.xy_m.y(), scene_.robot_start.yaw_rad};
  blueprint_.start = start;
  blueprint_.arm_start_rad = arm_start;
  blueprint_.walls = scene_.walls;
  blueprint_.robot_mjcf = robotMjcf(*robot, robot_options);
  world_ = makeWorld(blueprint_, config.seed);

  drive_ = std::make_unique<DifferentialDrive>(driveOf(profile, config));
  map_to_odom_ = start;

  arm_ = std::make_unique<UrController>(limits, config.arm_driver);
  arm_->setPayload({world_->toolMass(), world_->toolCentre()});  // as somebody has set it at the pendant
  startArm();

  RgbdCameraConfig camera = config.camera;
  camera.render.has_shadows = config.world.has_sun;
  camera.seed = config.seed;
  RendererConfig renderer;
  renderer.max_width_px = camera.camera.width_px;
  renderer.max_height_px = camera.camera.height_px;
  renderer.shadow_map_px = 1024;  // a quarter of the time of a picture's, and edges within two pixels
  renderer_ = std::make_unique<OffscreenRenderer>(world_->model(), renderer);
  camera_ = std::make_unique<RgbdCamera>(*renderer_, "rgbd", camera);

  scanner_ = std::make_unique<LaserScanner>(world_->model(), profile.scanner.frame, scannerOf(profile.scanner, config));
  scanner_frame_ = profile.scanner.frame;
  scan_rate_hz_ = profile.scanner.rate_hz;

  JudgeConfig judge = config.judge;
  judge.lookouts.height_m = camera_->opticalPose(world_->data()).translation().z() - judge.pile.ground_height_m;
  for (const Wall& wall : scene_.walls) judge.pile.walls.push_back({wall.pose(), wall.size_m});
  judge_ = std::make_unique<Judge>(judge);
  Tick nothing;
  observe(&nothing);
}

Simulation::~Simulation() = default;

void Simulation::layPile() {
  const description::BrickCatalogue catalogue = description::loadBrickTypes(config_.description.bricks);
  const PileSceneConfig scene_config = loadPileScene(config_.scene, catalogue.types, catalogue.maxBricks());
  SettleConfig settle_config;
  settle_config.physics = config_.world.physics;
  scene_ = settlePile(scene_config, config_.seed, settle_config).scene;
  scene_.has_tags = scene_.has_tags && config_.has_tags;
  const std::map<int, std::string> reasons = unpickable(scene_.bricks, config_.world.magnet.holding_force_N);
  for (const BrickPlacement& placement : scene_.bricks) {
    const std::string& type = placement.type.name;
    if (const std::string& label = catalogue.typeOf(placement.id).name; scene_.has_tags && type != label) {
      throw std::invalid_argument(config_.scene + ": brick " + std::to_string(placement.id) + " is of type " + type +
                                  ", must be " + label + ", as " + config_.description.bricks +
                                  " labels it, or have no tags");
    }
    WorldBrick brick;
    brick.placement = placement;
    brick.plate_edge_m = placement.type.plate_edge_m;
    brick.has_plate = platesOf(placement.type);
    brick.material = brickBodyName(placement.id);
    blueprint_.assets_mjcf += brickTextureXml(brick.material, kBrickFace_px);
    blueprint_.bricks.push_back(brick);
    blueprint_.looks.push_back(appearanceOf(placement, catalogue));
    if (!scene_.has_tags) blueprint_.looks.back().has_tags = false;
    bricks_.push_back({placement.id, placement.type.size_m, BrickStatus::kInPile, placement.T_map_brick, 0.0, -1.0,
                       reasons.count(placement.id) == 0});
  }
}

std::unique_ptr<World> Simulation::makeWorld(const Blueprint& blueprint, std::uint64_t seed) {
  auto world = std::make_unique<World>(blueprint.robot_mjcf, blueprint.assets_mjcf, blueprint.bricks, blueprint.start,
                                       blueprint.arm_start_rad, blueprint.world, blueprint.walls);
  // Each into a place of its own, from a seed of its own: the result is the same on any number of processors.
  const int threads = interactive_mapping::resolveThreadCount(0);
  interactive_mapping::parallelFor(blueprint.bricks.size(), threads, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const int id = blueprint.bricks[i].placement.id;
      uploadBrickTexture(world->mutableModel(), brickBodyName(id),
                         drawBrickFaces(blueprint.looks[i], kBrickFace_px, seed + static_cast<std::uint64_t>(id)));
    }
  });
  return world;
}

std::vector<std::string> PictureConfig::validate() const {
  RendererConfig renderer;
  renderer.max_width_px = width_px;
  renderer.max_height_px = height_px;
  renderer.samples = samples;
  std::vector<std::string> problems = renderer.validate();
  if (!(fovy_rad > 0.0 && fovy_rad < 2.0)) {
    problems.push_back("fovy_rad = " + std::to_string(fovy_rad) + " rad, must be in (0, 2) rad");
  }
  return problems;
}

/// The world once more, in daylight, and who draws it.
struct Simulation::Stage {
  PictureConfig config;
  std::unique_ptr<World> world;
  std::unique_ptr<OffscreenRenderer> renderer;
  Viewpoint view;
};

cv::Mat Simulation::picture(const PictureConfig& config) {
  if (!stage_) {
    interactive_mapping::refuseIfAny("picture:", config.validate());
    auto stage = std::make_unique<Stage>();
    stage->config = config;
    Blueprint blueprint = blueprint_;
    blueprint.world.has_surroundings = true;
    blueprint.world.has_sleep = false;  // nothing moves by itself there
    stage->world = makeWorld(blueprint, config_.seed);
    RendererConfig renderer;
    renderer.max_width_px = config.width_px;
    renderer.max_height_px = config.height_px;
    renderer.samples = config.samples;
    renderer.quads_per_edge = 4;  // the sun is near enough to fall off across a face
    stage->renderer = std::make_unique<OffscreenRenderer>(stage->world->model(), renderer);
    stage->view = viewpointOf(pointsOfInterest(scene_), overviewDirection(scene_), config.fovy_rad,
                              static_cast<double>(config.width_px) / config.height_px, kPictureMargin);
    stage_ = std::move(stage);
  }
  stage_->world->takePosesFrom(*world_);
  return renderView(*stage_->renderer, stage_->world->data(), stage_->view.eye_m, stage_->view.target_m,
                    stage_->config.fovy_rad, stage_->config.width_px, stage_->config.height_px);
}

// What the operator does before a run: it has happened when the clock starts.
void Simulation::startArm() {
  const double dt = config_.world.physics.timestep_s;
  double now_s = now() - 60.0;
  const auto pass = [&](double seconds) {
    for (const double end_s = now_s + seconds; now_s < end_s; now_s += dt) {
      arm_->update(now_s, dt, world_->armPosition(), world_->armVelocity());
    }
  };
  pass(dt);
  if (config_.arm_starts_running) {
    arm_->brakeRelease();
    pass(config_.arm_driver.power_on_s + config_.arm_driver.brake_release_s + 4 * dt);
    if (config_.arm_driver.headless_mode) {
      arm_->resendRobotProgram();
    } else {
      arm_->play();
    }
    pass(config_.arm_driver.speed_ramp_s + 4 * dt);
    if (!arm_->robotProgramRunning()) {
      throw std::runtime_error("simulation: the arm's program does not start with this arm_driver configuration");
    }
  }
}

bool Simulation::isDue(double rate_hz) const {
  if (rate_hz <= 0.0) {
    return false;
  }
  // Whole periods since the start, so that rates which are no divisor of the tick's keep their mean.
  const auto periods = [this, rate_hz](std::int64_t time_ns) {
    const double since_s = static_cast<double>(time_ns) * 1e-9 - config_.start_time_s;
    return static_cast<std::int64_t>(std::floor(since_s * rate_hz + 1e-6));
  };
  return periods(now_ns_) > periods(now_ns_ - tick_ns_);
}

Simulation::Tick Simulation::tick() {
  Tick tick;
  applyFaults(&tick);
  {
    const CostMeter::Scope cost(costs_, SimulationPart::kPhysics);
    for (int step = 0; step < steps_per_tick_; ++step) {
      stepPhysics(now() + step * config_.world.physics.timestep_s, &tick);
    }
    now_ns_ += tick_ns_;
    tick.stamp_ns = now_ns_;
    world_->refreshPoses();
    stowBricks(&tick);
  }
  observe(&tick);

  tick.has_joint_states = isDue(config_.joint_state_rate_hz);
  if (tick.has_joint_states) {
    for (int i = 0; i < 3; ++i)
      force_noise_N_[i] = force_noise_std_N_ > 0.0 ? force_noise_std_N_ * force_random_.normal() : 0.0;
  }
  const bool is_odometry_due = isDue(config_.odometry_rate_hz);
  tick.has_odometry = is_odometry_due && !odometry_gone_;
  tick.has_localisation = is_odometry_due && !localisation_gone_;
  if (is_odometry_due) {
    // Drawn each time, so that faults change nothing else.
    double x = 0.0;
    double y = 0.0;
    random_.normalPair(x, y);
    const double turn = random_.normal();
    // A first-order Gauss-Markov process, whose deviation is the same at all times.
    const double kept = config_.localisation_correlation_s > 0.0 && has_localised_
                            ? std::exp(-1.0 / (config_.odometry_rate_hz * config_.localisation_correlation_s))
                            : 0.0;
    localisation_noise_ = kept * localisation_noise_ + std::sqrt(1.0 - kept * kept) * Eigen::Vector3d(x, y, turn);
    has_localised_ = true;
    Pose2d seen = compose(localisation_error_, world_->basePose());
    seen.x_m += config_.localisation_std_m * localisation_noise_.x();
    seen.y_m += config_.localisation_std_m * localisation_noise_.y();
    seen.yaw_rad += config_.localisation_std_rad * localisation_noise_.z();
    if (tick.has_odometry) {  // without, there is nothing to correct: it stays with what it said last
      map_to_odom_ = compose(seen, inverse(drive_->odometry()));
    }
  }
  if (isDue(scan_rate_hz_)) {
    const CostMeter::Scope cost(costs_, SimulationPart::kScanner);
    ++scan_number_;  // whether it is sent or not: the noise of later ones stays the same
    if (!scanner_gone_) {
      tick.scan = scanner_->scan(world_->data(), scan_number_);
    }
  }
  takeImages(&tick);
  return tick;
}

// The robot's payload is all that hangs on its flange; the world's, what that is more than the tool.
void Simulation::declarePayload(const UrPayload& payload) {
  const double more_kg = payload.mass_kg - world_->toolMass();
  const Eigen::Vector3d moment_kg_m =
      payload.mass_kg * payload.center_of_gravity_m - world_->toolMass() * world_->toolCentre();
  constexpr double kNothing_kg = 1e-6;
  const bool is_tool_alone = std::abs(more_kg) < kNothing_kg;
  world_->setPayload(is_tool_alone ? 0.0 : more_kg,
                     is_tool_alone ? Eigen::Vector3d::Zero() : Eigen::Vector3d(moment_kg_m / more_kg));
}

void Simulation::stepPhysics(double now_s, Tick* tick) {
  const double dt = config_.world.physics.timestep_s;
  const JointMotion& setpoint = arm_->update(now_s, dt, world_->armPosition(), world_->armVelocity());
  if (isArmOnBrakes(now_s)) {
    world_->setArmReference(*brake_rad_, ArmVector::Zero(), ArmVector::Zero());
  } else {
    world_->setArmReference(setpoint.position_rad, setpoint.velocity_rad_s, setpoint.acceleration_rad_s2);
  }
  declarePayload(arm_->payload());
  if (arm_->takeFtSensorZeroed()) {
    wrench_zero_ = world_->toolWrench();
  }
  world_->setMagnet(arm_->io().digital_out.at(static_cast<std::size_t>(config_.magnet_output)));
  world_->setBaseTwist(drive_->update(now_s, dt));
  world_->setWheelAngles(drive_->leftWheelAngle(), drive_->rightWheelAngle());
  world_->step();
  watchForCollision(now_s, tick);
  followMagnet(now_s, tick);
  // As of a vacuum's pressure sensor with -20 kPa per volt.
  arm_->setAnalogIn(0, world_->heldBrick() ? 3.0 : 0.0);
}

// A stopped arm first comes to rest by its motors. Then brakes hold it, and slip under what is left of the push, so that
// it does not stop again as soon as it is unlocked.
bool Simulation::isArmOnBrakes(double now_s) {
  if (arm_->robotProgramRunning()) {
    brake_rad_.reset();
    stopped_since_s_ = now_s;
    return false;
  }
  if (now_s - stopped_since_s_ < config_.arm_driver.follower.stop_trajectory_duration_s) {
    return false;
  }
  constexpr double kSlip = 0.25;  // of the collision limits
  if (!brake_rad_ || pushOnArm() > kSlip) {
    brake_rad_ = world_->armPosition();
  }
  return true;
}

double Simulation::pushOnArm() const {
  const double by_force = world_->toolPush() / kCollisionStop_N;
  const double by_torque = world_->armPush().cwiseAbs().cwiseQuotient(world_->config().servo.arm_effort_Nm).maxCoeff() /
                           kCollisionStopEffort;
  return std::max(by_force, by_torque);
}

void Simulation::watchForCollision(double now_s, Tick* tick) {
  const bool is_moving_itself =
      arm_->robotMode() == RobotMode::kRunning &&
      (arm_->safetyMode() == SafetyMode::kNormal || arm_->safetyMode() == SafetyMode::kReduced);
  overload_steps_ = is_moving_itself && pushOnArm() > 1.0 ? overload_steps_ + 1 : 0;
  if (overload_steps_ < kCollisionSteps) {
    return;
  }
  overload_steps_ = 0;
  const double force_N = world_->toolPush();
  const ArmVector effort = world_->armPush().cwiseAbs().cwiseQuotient(world_->config().servo.arm_effort_Nm);
  int joint = 0;
  const double share = effort.maxCoeff(&joint);
  std::ostringstream reason;
  if (force_N > kCollisionStop_N) {
    reason << "collision: " << force_N << " N on the tool, allowed " << kCollisionStop_N << " N";
  } else {
    reason << "collision: " << kArmJoints[joint] << " is pushed with " << share * 100.0
           << " % of its motor's torque, allowed " << kCollisionStopEffort * 100.0 << " %";
  }
  arm_->protectiveStop(reason.str());
  tick->incidents.push_back(sentence(now_s, "protective stop, " + reason.str()));
}

Simulation::BrickRecord& Simulation::record(int id) {
  return *std::find_if(bricks_.begin(), bricks_.end(), [id](const BrickRecord& brick) { return brick.id == id; });
}

bool Simulation::isCarried(const BrickRecord& brick) const {
  const Eigen::Vector3d now_map = world_->brick(brick.id)->T_map_brick.translation();
  return (now_map - brick.T_map_grasp.translation()).norm() > kLifted_m;
}

void Simulation::followMagnet(double now_s, Tick* tick) {
  if (const std::optional<World::Release> release = world_->takeRelease()) {
    BrickRecord& brick = record(release->brick_id);
    const std::optional<BrickMotion> motion = world_->brick(release->brick_id);
    const std::string name = "brick " + std::to_string(release->brick_id);
    if (brick.status == BrickStatus::kHeld && motion) {
      // Whoever lets go over the container means it, and the brick's fall decides whether it gets there.
      const std::vector<World::StowedBrick> inside = world_->bricksInContainer();
      const std::string why = release->load.empty() ? "" : ": " + release->load;
      const bool is_over_container =
          std::any_of(inside.begin(), inside.end(), [&](const World::StowedBrick& one) { return one.id == brick.id; });
      if (release->reason == ReleaseReason::kSwitchedOff && is_over_container) {
        brick.status = BrickStatus::kReleased;
      } else if (isCarried(brick)) {
        drop(&brick);
        tick->incidents.push_back(sentence(now_s, "the magnet lost " + name + why));
      } else {
        brick.status = BrickStatus::kInPile;
        if (release->reason != ReleaseReason::kSwitchedOff) {
          tick->incidents.push_back(sentence(now_s, "the magnet came off " + name + " before lifting it" + why));
        }
      }
      brick.status_since_s = now_s;
    }
  }
  if (const std::optional<int> held = world_->heldBrick()) {
    BrickRecord& brick = record(*held);
    if (brick.status != BrickStatus::kHeld) {
      if (brick.status == BrickStatus::kStowed) --stowed_;
      brick.status = BrickStatus::kHeld;
      brick.status_since_s = now_s;
      brick.T_map_grasp = world_->brick(*held)->T_map_brick;
    }
  }
}

void Simulation::stowBricks(Tick* tick) {
  const std::vector<World::StowedBrick> inside = world_->bricksInContainer();
  for (BrickRecord& brick : bricks_) {
    const std::string name = "brick " + std::to_string(brick.id);
    const auto found =
        std::find_if(inside.begin(), inside.end(), [&](const World::StowedBrick& one) { return one.id == brick.id; });
    const bool is_aboard = brick.status == BrickStatus::kStowed || brick.status == BrickStatus::kJammed;
    if (is_aboard && found == inside.end() && world_->brick(brick.id)) {
      if (brick.status == BrickStatus::kStowed) --stowed_;
      drop(&brick);
      tick->incidents.push_back(sentence(now(), name + " fell out of the container"));
    }
    if (brick.status == BrickStatus::kStowed) continue;
    if (found == inside.end() || !found->is_at_rest) {
      brick.rests_since_s = -1.0;
      continue;
    }
    if (brick.rests_since_s < 0.0) {
      brick.rests_since_s = now();
    }
    if (now() - brick.rests_since_s < config_.container_rest_s) {
      continue;
    }
    if (found->is_seated) {
      brick.status = BrickStatus::kStowed;
      brick.status_since_s = now();
      ++stowed_;
      tick->incidents.push_back(sentence(now(), name + " stowed, " + std::to_string(stowed_) + " in all"));
    } else if (brick.status != BrickStatus::kJammed) {
      brick.status = BrickStatus::kJammed;
      brick.status_since_s = now();
      tick->incidents.push_back(
          sentence(now(), name + " is jammed: it rests on the container's rim or on other bricks"));
    }
  }
}

void Simulation::drop(BrickRecord* brick) {
  brick->status = BrickStatus::kDropped;
  brick->status_since_s = now();
}

void Simulation::setTarget(int brick_id, const Eigen::Vector3d& p_map) {
  constexpr double kNear_m = 0.15;  // between the middles of two bricks there is more
  const std::optional<BrickMotion> named = world_->brick(brick_id);
  target_ = brick_id;
  if (named && (named->T_map_brick.translation() - p_map).norm() <= kNear_m) return;
  double nearest_m = kNear_m;
  for (const BrickMotion& brick : world_->bricks()) {
    const double distance_m = (brick.T_map_brick.translation() - p_map).norm();
    if (distance_m > nearest_m) continue;
    nearest_m = distance_m;
    target_ = brick.id;
  }
}

std::optional<int> Simulation::unload() {
  if (!unload_asked_s_) unload_asked_s_ = now();
  if (now() - *unload_asked_s_ < config_.unload_s) return std::nullopt;
  unload_asked_s_.reset();
  const std::vector<World::StowedBrick> inside = world_->bricksInContainer();
  for (const World::StowedBrick& one : inside) {
    BrickRecord& brick = record(one.id);
    if (brick.status != BrickStatus::kStowed) ++stowed_;  // jammed, or still on its way
    brick.status = BrickStatus::kStowed;
    world_->takeAwayBrick(one.id);
  }
  return static_cast<int>(inside.size());
}

bool Simulation::requestImage() {
  image_wanted_ = !camera_gone_;
  return image_wanted_;
}

void Simulation::takeImages(Tick* tick) {
  const CostMeter::Scope cost(costs_, SimulationPart::kCamera);
  const bool is_wanted = image_wanted_;
  image_wanted_ = false;
  if (!camera_gone_ && (is_wanted || isDue(config_.camera_rate_hz))) {
    ++frame_number_;
    // Drawn for every frame, so that switching drops on changes nothing else.
    const bool is_lost =
        synthetic_depth::SeededRandom(config_.seed, 2, frame_number_).uniform() < config_.camera_drop_probability;
    if (is_camera_used_ && (!is_lost || is_wanted)) {
      images_on_their_way_.push_back({now_ns_, camera_->capture(world_->data(), frame_number_)});
    }
  }
  const std::int64_t delay_ns = std::llround(config_.camera_delay_s * 1e9);
  while (!images_on_their_way_.empty() && images_on_their_way_.front().stamp_ns + delay_ns <= now_ns_) {
    tick->images.push_back(std::move(images_on_their_way_.front()));
    images_on_their_way_.erase(images_on_their_way_.begin());
  }
}

ToolWrench Simulation::wrench() const {
  ToolWrench wrench = world_->toolWrench();
  if (wrench_zero_) {
    wrench.force_N -= wrench_zero_->force_N;
    wrench.torque_Nm -= wrench_zero_->torque_Nm;
  }
  wrench.force_N += force_noise_N_;
  return wrench;
}

void Simulation::observe(Tick* tick) {
  const CostMeter::Scope cost(costs_, SimulationPart::kJudge);
  WorldObservation seen;
  seen.time_s = now();
  const std::vector<BrickMotion> motions = world_->bricks();
  for (BrickRecord& brick : bricks_) {
    if (brick.status == BrickStatus::kMovedByHand && now() - brick.status_since_s > kHandTime_s) {
      brick.status = BrickStatus::kInPile;
    }
    const auto motion = std::find_if(motions.begin(), motions.end(),
                                     [&brick](const BrickMotion& other) { return other.id == brick.id; });
    // What was lost or missed the container belongs to the pile again where it lies.
    const bool was_let_go = brick.status == BrickStatus::kDropped || brick.status == BrickStatus::kReleased;
    if (was_let_go && brick.rests_since_s < 0.0 && now() - brick.status_since_s > kHandTime_s &&
        motion != motions.end() && motion->velocity_m_s.norm() < kStandsSpeed_m_s) {
      brick.status = BrickStatus::kInPile;
    }
    BrickObservation observation;
    observation.id = brick.id;
    observation.size_m = brick.size_m;
    observation.status = brick.status;
    observation.is_pickable = brick.is_pickable;
    observation.T_map_brick = motion != motions.end() ? motion->T_map_brick : brick.T_map_grasp;
    seen.bricks.push_back(observation);
  }
  seen.target_id = target_;
  for (const RobotTouch& touch : world_->takeTouches()) {
    const bool is_of_load = touch.load_id >= 0;
    if (is_of_load && !isCarried(record(touch.load_id))) continue;  // it may lean on others until it has left them
    seen.contacts.push_back({touch.robot_body, touch.other_body, touch.force_N, is_of_load, touch.p_map});
  }
  seen.obstacles = world_->obstacles();
  const Pose2d base = world_->basePose();
  seen.base_xy_m = {base.x_m, base.y_m};
  const std::size_t known = judge_->events().size();
  judge_->observe(seen);
  for (std::size_t i = known; i < judge_->events().size(); ++i) {
    const JudgeEvent& event = judge_->events()[i];
    if (event.kind == JudgeEventKind::kFall) {
      tick->incidents.push_back(sentence(event.time_s, "brick " + std::to_string(event.brick_id) + " falls"));
    } else if (event.kind == JudgeEventKind::kCollision || event.kind == JudgeEventKind::kLoadContact) {
      std::ostringstream text;
      text << (event.kind == JudgeEventKind::kCollision ? "collision of " : "contact of the carried ")
           << event.robot_body << " with " << event.other_body << ", " << event.max_force_N << " N, at ("
           << event.p_map.x() << ", " << event.p_map.y() << ", " << event.p_map.z() << ") m";
      tick->incidents.push_back(sentence(event.time_s, text.str()));
    }
  }
}

void Simulation::addFault(const Fault& fault) {
  if (fault.kind == FaultKind::kMoveBrick && !world_->knowsBrick(fault.brick_id)) {
    throw std::invalid_argument("fault move_brick: brick_id = " + std::to_string(fault.brick_id) +
                                ", must be the id of a brick of the scene");
  }
  if (fault.at_s <= now() && fault.validate().empty()) {
    const std::string problem = placeProblem(fault);
    if (!problem.empty()) {
      throw std::invalid_argument("fault " + faultName(fault.kind) + ": " + problem);
    }
  }
  faults_.add(fault);
}

std::string Simulation::placeProblem(const Fault& fault) {
  std::string taken_by;
  if (fault.kind == FaultKind::kMoveBrick) {
    taken_by = world_->obstacleAt(fault.brick_id, fault.T_map_object);
  } else if (fault.kind == FaultKind::kObstacle) {
    if (world_->obstacles().size() >= static_cast<std::size_t>(kMaxObstacles)) {
      return "obstacles that stand already = " + std::to_string(kMaxObstacles) + ", must be fewer than " +
             std::to_string(kMaxObstacles);
    }
    taken_by = world_->thingAt(fault.T_map_object.translation().head<2>());
  }
  return taken_by.empty() ? "" : "pose is inside " + taken_by + ", must be free";
}

void Simulation::applyFaults(Tick* tick) {
  for (const FaultSchedule::Change& change : faults_.takeDue(now())) {
    if (change.is_beginning) {
      beginFault(change, tick);
    } else {
      endFault(change, tick);
    }
  }
}

void Simulation::beginFault(const FaultSchedule::Change& change, Tick* tick) {
  const Fault& fault = change.fault;
  std::string note = "fault " + faultName(fault.kind);
  switch (fault.kind) {
    case FaultKind::kProtectiveStop:
      arm_->protectiveStop("on command");
      break;
    case FaultKind::kEmergencyStop:
      arm_->emergencyStop();
      haltBase(fault.kind);
      break;
    case FaultKind::kBaseButton:
    case FaultKind::kBaseScanner:
      haltBase(fault.kind);
      break;
    case FaultKind::kDriverGone:
      arm_->setDriverConnected(false);
      break;
    case FaultKind::kCameraGone:
      camera_gone_ = true;
      images_on_their_way_.clear();
      break;
    case FaultKind::kMagnetWeak:
      world_->setMagnetStrength(fault.value);
      break;
    case FaultKind::kForceNoise:
      force_noise_std_N_ = fault.value;
      break;
    case FaultKind::kIoRefused:
      arm_->setRefusesIo(true);
      break;
    case FaultKind::kWheelSlip:
      drive_->setSlip(fault.value, fault.value2);
      break;
    case FaultKind::kDropBrick:
      if (!world_->dropHeldBrick()) {
        note += ": the magnet holds none";
      }
      break;
    case FaultKind::kMoveBrick:
      if (const std::string problem = placeProblem(fault); !problem.empty()) {
        note += " refused: " + problem;
      } else {
        BrickRecord& brick = record(fault.brick_id);
        if (brick.status == BrickStatus::kStowed) {
          --stowed_;
        }
        brick.status = BrickStatus::kMovedByHand;
        brick.status_since_s = now();
        world_->moveBrick(fault.brick_id, fault.T_map_object);
      }
      break;
    case FaultKind::kScannerGone:
      scanner_gone_ = true;
      break;
    case FaultKind::kOdometryGone:
      odometry_gone_ = true;
      break;
    case FaultKind::kLocalisationGone:
      localisation_gone_ = true;
      break;
    case FaultKind::kLocalisationJump: {
      // As a whole: who turns the map's frame turns the way driven in it, too.
      const Pose2d truth = world_->basePose();
      localisation_error_ = compose({truth.x_m + fault.value, truth.y_m, truth.yaw_rad + fault.value2}, inverse(truth));
    } break;
    case FaultKind::kObstacle:
      if (const std::string problem = placeProblem(fault); !problem.empty()) {
        note += " refused: " + problem;
      } else {
        obstacle_of_fault_[change.number] = world_->addObstacle(fault.T_map_object.translation().head<2>());
      }
      break;
  }
  tick->incidents.push_back(sentence(now(), note));
}

void Simulation::endFault(const FaultSchedule::Change& change, Tick* tick) {
  const Fault& fault = change.fault;
  switch (fault.kind) {
    case FaultKind::kEmergencyStop:
      arm_->releaseEmergencyStop();
      releaseBase(fault.kind);
      break;
    case FaultKind::kBaseButton:
    case FaultKind::kBaseScanner:
      releaseBase(fault.kind);
      break;
    case FaultKind::kDriverGone:
      arm_->setDriverConnected(true);
      break;
    case FaultKind::kCameraGone:
      camera_gone_ = false;
      break;
    case FaultKind::kMagnetWeak:
      world_->setMagnetStrength(1.0);
      break;
    case FaultKind::kForceNoise:
      force_noise_std_N_ = 0.0;
      break;
    case FaultKind::kIoRefused:
      arm_->setRefusesIo(false);
      break;
    case FaultKind::kWheelSlip:
      drive_->setSlip(0.0, 0.0);
      break;
    case FaultKind::kScannerGone:
      scanner_gone_ = false;
      break;
    case FaultKind::kOdometryGone:
      odometry_gone_ = false;
      break;
    case FaultKind::kLocalisationGone:
      localisation_gone_ = false;
      break;
    case FaultKind::kLocalisationJump:
      localisation_error_ = Pose2d{};
      break;
    case FaultKind::kObstacle:
      if (const auto entry = obstacle_of_fault_.find(change.number); entry != obstacle_of_fault_.end()) {
        world_->takeAwayObstacle(entry->second);
        obstacle_of_fault_.erase(entry);
      } else {
        return;  // it was refused, and never began
      }
      break;
    case FaultKind::kProtectiveStop:
    case FaultKind::kDropBrick:
    case FaultKind::kMoveBrick:
      break;
  }
  tick->incidents.push_back(sentence(now(), "fault " + faultName(fault.kind) + " is over"));
}

void Simulation::haltBase(FaultKind kind) {
  drive_->stop();
  base_halts_.insert(kind);
}

void Simulation::releaseBase(FaultKind kind) {
  base_halts_.erase(kind);
  if (base_halts_.empty()) base_free_s_ = now() + kBaseConfirmed_s;
}

RelayBoard Simulation::relayBoard() const {
  RelayBoard board;
  board.is_button_pressed =
      base_halts_.count(FaultKind::kEmergencyStop) + base_halts_.count(FaultKind::kBaseButton) > 0;
  board.is_scanner_blocked = base_halts_.count(FaultKind::kBaseScanner) > 0;
  if (!base_halts_.empty()) {
    board.state = RelayBoard::State::kStopped;
  } else if (now() < base_free_s_) {
    board.state = RelayBoard::State::kConfirmed;
  }
  return board;
}

bool Simulation::commandBase(const Twist2d& twist) {
  const bool is_halted = !base_halts_.empty();
  return drive_->command(is_halted ? Twist2d{} : twist, now()) && !is_halted;
}

const LaserScannerConfig& Simulation::scannerConfig() const {
  return scanner_->config();
}

}  // namespace simulated_world
