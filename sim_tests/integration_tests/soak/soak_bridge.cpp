// SPDX-License-Identifier: BSD-3-Clause
// Picks in a row by node ur_driver_bridge in the simulated world, two of three with a random fault at a random moment. Not
// the bridge says whether that went well, but the truth: joint states, digital outputs, the bricks' true poses, the judge.
// A line of bridge.csv for each pick; goes on where it was interrupted. Each pick is drawn from seed and number alone.
#include <algorithm>
#include <array>
#include <cctype>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <limits>
#include <map>
#include <sstream>
#include <stdexcept>

#include <boost/program_options.hpp>
#include <gtest/gtest.h>
#include <ur_driver_bridge/arm_status.h>
#include <ur_msgs/IOStates.h>
#include <visualization_msgs/MarkerArray.h>

#include "synthetic_depth/seeded_random.h"
#include "ur_driver_bridge/bridge_world.h"

namespace integration_tests {
namespace {

// The brick of bricks.yaml lies on the ground, before the robot.
constexpr double kTop_m = 0.2;
constexpr double kMiddle_m = 0.1;
constexpr double kTouchFrom_m = 0.08;   // over the plate
constexpr double kOvertravel_m = 0.01;  // that the touch goes on beyond the plate
constexpr double kLift_m = 0.25;
constexpr double kReady_m = 0.55;  // height of the tip in the ready posture

constexpr double kRest_rad_s = 0.01;     // as the bridge has it: slower than this the arm stands
constexpr double kStop_s = 0.3;          // from the reason of a stop to an arm at rest, as docs/robot.md asks
constexpr double kMonitorAge_s = 0.5;    // gate/max_monitor_age_s: silence for so long is allowed
constexpr double kRobotStop_s = 0.5;     // the robot's own stops
constexpr double kSettle_s = 0.2;        // of joints whose servos have 80 rad/s, after a stop that ends in a corner
constexpr double kGoal_s = 120.0;        // within which each goal has to end
constexpr double kAgree_s = 2.0;         // after its end bridge and truth have to agree
constexpr double kPutDown_m = 0.03;      // a brick whose lower side is less above the ground is put down, not dropped
constexpr double kSlowest_s = 20.0;      // after which the speed slider is put back: a goal at 0.1 would last too long
constexpr double kTopSpeed_rad_s = 1.2;  // planned are 1 rad/s; a fifth for what joins the arm to the trajectory
constexpr double kOffPath_rad = 0.03;  // motion/start_tolerance_rad and 0.01 for the servos, under load and at contact
constexpr double kTwitch_rad = 0.003;  // 2 mm at the tip, with the arm stretched out
constexpr double kFallingAfter_s = 3.0;  // a lost brick falls, rolls and lies still

enum class Kind {
  kNone,
  kProtectiveStop,
  kEmergencyStop,
  kDriverGone,
  kMagnetWeak,
  kDropBrick,
  kForceNoise,
  kIoRefused,
  kProgramStopped,
  kSlow,
  kMissionKilled,
  kMustStop,
  kMonitorSilent,
  kHold,
  kCancel,
  kBrickMoved,
  kBrickTaken,
  kPlateWrong,
  kNumKinds,
};
constexpr int kNumKinds = static_cast<int>(Kind::kNumKinds);
constexpr std::array<const char*, kNumKinds> kKindNames{
    "none",       "protective_stop", "emergency_stop", "driver_gone",    "magnet_weak", "drop_brick",     "force_noise",
    "io_refused", "program_stopped", "slow",           "mission_killed", "must_stop",   "monitor_silent", "hold",
    "cancel",     "brick_moved",     "brick_taken",    "plate_wrong"};

/// What is drawn for one pick.
struct Draw {
  Kind kind{Kind::kNone};
  double x_m{0.0}, y_m{0.0}, yaw_rad{0.0};  // of the brick, in base_link
  double share{0.0};                        // of the time in which the fault may begin
  double value{0.0};                        // of the fault, in its unit
  double duration_s{0.0};
  bool carries_on{false};  // what hangs there after a stop in stow is carried to its end
};

Draw drawPick(std::uint64_t seed, std::uint64_t number) {
  synthetic_depth::SeededRandom random(seed, 41, number);
  Draw draw;
  // The strip in which the tip can go from the touch up to the ready posture, tool straight down.
  draw.x_m = random.uniform(0.80, 0.94);
  draw.y_m = random.uniform(-0.2, 0.2);
  draw.yaw_rad = random.uniform(-M_PI, M_PI);
  const bool has_fault = random.uniform() < 2.0 / 3.0;
  const auto kind = static_cast<Kind>(1 + static_cast<int>(random.next() % (kNumKinds - 1)));
  draw.share = random.uniform();
  const double u = random.uniform();
  const bool is_negative = random.uniform() < 0.5;
  draw.carries_on = random.uniform() < 0.5;
  if (!has_fault) return draw;
  draw.kind = kind;
  switch (kind) {
    case Kind::kEmergencyStop:
      draw.duration_s = 2.0 + 2.0 * u;
      break;
    case Kind::kDriverGone:
      draw.duration_s = 1.0 + 3.0 * u;
      break;
    case Kind::kMagnetWeak:
      draw.value = 0.5 * u;  // of 90 N; 1 kg is 10 N
      break;
    case Kind::kForceNoise:
      draw.value = 3.0 * u;  // [N]
      break;
    case Kind::kSlow:
      draw.value = 0.1 + 0.9 * u;
      draw.duration_s = kSlowest_s;
      break;
    case Kind::kMissionKilled:
      draw.duration_s = 0.3 + 1.7 * u;
      break;
    case Kind::kMonitorSilent:
      draw.duration_s = 0.5 + 1.5 * u;
      break;
    case Kind::kBrickMoved:
      draw.value = 0.02 + 0.1 * u;  // [m], along y
      break;
    case Kind::kPlateWrong:
      draw.value = (is_negative ? -0.05 : 0.05) * u;  // [m] believed higher than it is
      break;
    default:
      break;
  }
  return draw;
}

/// What became of one pick; a line of bridge.csv.
struct Line {
  std::uint64_t number{0};
  std::string kind{"none"};
  double value{0.0};
  double begun_s{0.0};      // of the fault, after the goal; NaN: it came too late
  std::string fault_stage;  // in which it began
  std::string status;       // of the pick
  std::string stage;
  double lasted_s{0.0};
  double stop_s{std::nan("")};  // from the reason of the stop until the arm stood; NaN: nothing to be stopped
  double off_path_rad{0.0};     // farthest that the arm was from the pick's own path
  std::string recovery;         // what was done until the arm was ready again
  std::string violations;
  std::string message;

  static std::string plain(std::string text) {
    for (char& c : text) c = c == ',' ? ';' : c == '\n' ? ' ' : c;
    return text;
  }
  std::string text() const {
    std::ostringstream out;
    out << std::setprecision(4) << number << ',' << kind << ',' << value << ',' << begun_s << ',' << fault_stage << ','
        << status << ',' << stage << ',' << lasted_s << ',' << stop_s << ',' << off_path_rad << ',' << plain(recovery)
        << ',' << plain(violations) << ',' << plain(message);
    return out.str();
  }
  static Line parse(const std::string& text) {
    std::vector<std::string> parts(1);
    for (const char c : text) {
      if (c == ',') {
        parts.emplace_back();
      } else {
        parts.back() += c;
      }
    }
    if (parts.size() != 13) throw std::runtime_error("bridge.csv: " + text + ": must have 13 columns");
    Line line;
    line.number = std::stoull(parts[0]);
    line.kind = parts[1];
    line.value = std::stod(parts[2]);
    line.begun_s = std::stod(parts[3]);
    line.fault_stage = parts[4];
    line.status = parts[5];
    line.stage = parts[6];
    line.lasted_s = std::stod(parts[7]);
    line.stop_s = std::stod(parts[8]);
    line.off_path_rad = std::stod(parts[9]);
    line.recovery = parts[10];
    line.violations = parts[11];
    line.message = parts[12];
    return line;
  }
};
constexpr const char* kHeader =
    "pick,fault,value,begun_s,fault_stage,status,stage,lasted_s,stop_s,off_path_rad,recovery,violations,message";

std::string statusName(int status) {
  return status >= 0 && status < ur_driver_bridge::kNumArmStatus
             ? toString(static_cast<ur_driver_bridge::ArmStatus>(status))
             : "NO_OUTCOME";
}

/// What the world itself tells, with the times at which it was so.
class Truth {
 public:
  Truth() {
    subscribers_.push_back(nh_.subscribe("/joint_states", 500, &Truth::onJoints, this));
    subscribers_.push_back(nh_.subscribe("/simulated_world/truth", 100, &Truth::onBricks, this));
    subscribers_.push_back(nh_.subscribe("/ur_hardware_interface/io_states", 500, &Truth::onOutputs, this));
    subscribers_.push_back(nh_.subscribe("/ur_driver_bridge/state", 500, &Truth::onState, this));
  }

  struct Brick {
    double at_s{0.0};
    double z_m{0.0};
    bool is_held{false};
  };
  struct Output {
    double at_s{0.0};
    bool is_on{false};
  };
  struct Stage {
    double at_s{0.0};
    std::string name;
  };

  void forget() {
    speeds_.clear();
    positions_.clear();
    stages_.clear();
    switches_.clear();
    // The last one still holds.
    if (bricks_.size() > 1) bricks_.erase(bricks_.begin(), bricks_.end() - 1);
  }

  /// When the arm moved last in [from, to); nothing if it stood. What is not told (the driver is gone) is not known.
  std::optional<double> lastMotion(double from_s, double to_s) const {
    std::optional<double> last_s;
    for (const auto& [at_s, speed] : speeds_) {
      if (at_s >= from_s && at_s < to_s && speed > kRest_rad_s) last_s = at_s;
    }
    return last_s;
  }
  const std::vector<std::pair<double, ArmVector>>& positions() const { return positions_; }
  void forgetSwitches() { switches_.clear(); }
  double topSpeed() const {
    double top = 0.0;
    for (const auto& [at_s, speed] : speeds_) top = std::max(top, speed);
    return top;
  }

  Brick brick() const { return bricks_.empty() ? Brick() : bricks_.back(); }
  /// As it was before `at_s`.
  Brick brickBefore(double at_s) const {
    Brick found = bricks_.empty() ? Brick() : bricks_.front();
    for (const Brick& brick : bricks_) {
      if (brick.at_s < at_s) found = brick;
    }
    return found;
  }
  bool isStage(const std::string& name, double from_s, double to_s) const {
    return std::any_of(stages_.begin(), stages_.end(), [&](const Stage& stage) {
      return stage.name == name && stage.at_s >= from_s && stage.at_s <= to_s;
    });
  }
  std::string stageAt(double at_s) const {
    std::string name;
    for (const Stage& stage : stages_) {
      if (stage.at_s <= at_s) name = stage.name;
    }
    return name;
  }
  bool isMagnetOn() const { return is_on_; }
  const std::vector<Output>& switches() const { return switches_; }

 private:
  void onJoints(const sensor_msgs::JointState::ConstPtr& joints) {
    double speed = -1.0;
    ArmVector position_rad = ArmVector::Zero();
    for (std::size_t i = 0; i < joints->name.size() && i < joints->velocity.size(); ++i) {
      const auto& names = mp700_ur5e_description::kArmJoints;
      const auto found = std::find(names.begin(), names.end(), joints->name[i]);
      if (found == names.end()) continue;
      speed = std::max(speed, std::abs(joints->velocity[i]));
      position_rad[found - names.begin()] = joints->position[i];
    }
    if (speed < 0.0) return;  // of the wheels
    speeds_.emplace_back(joints->header.stamp.toSec(), speed);
    positions_.emplace_back(joints->header.stamp.toSec(), position_rad);
  }
  void onBricks(const visualization_msgs::MarkerArray::ConstPtr& markers) {
    for (const auto& marker : markers->markers) {
      if (marker.ns != "bricks" || marker.id != 0) continue;
      // The world paints the brick on the magnet yellow, the others red.
      bricks_.push_back({marker.header.stamp.toSec(), marker.pose.position.z, marker.color.g > 0.5F});
    }
  }
  void onOutputs(const ur_msgs::IOStates::ConstPtr& outputs) {
    for (const auto& digital : outputs->digital_out_states) {
      if (digital.pin != 0) continue;
      const bool is_on = digital.state != 0;
      if (is_on != is_on_) switches_.push_back({ros::Time::now().toSec(), is_on});
      is_on_ = is_on;
    }
  }
  void onState(const ArmBridgeState::ConstPtr& state) {
    stages_.push_back({state->header.stamp.toSec(), state->stage});
  }

  ros::NodeHandle nh_;
  std::vector<ros::Subscriber> subscribers_;
  std::vector<std::pair<double, double>> speeds_;
  std::vector<std::pair<double, ArmVector>> positions_;
  std::vector<Brick> bricks_;
  std::vector<Stage> stages_;
  std::vector<Output> switches_;
  bool is_on_{false};
};

/// The world cannot go on: the next pick would tell nothing.
class Stuck : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Long: what a soak does to the bridge, and what has to hold meanwhile.
class Soak {
 public:
  explicit Soak(std::uint64_t seed) : seed_(seed) {
    if (!world_.begin()) throw Stuck("simulated world and ur_driver_bridge do not come up: " + world_.state.reason);
    ready_rad_ = world_.above(0.87, 0.0, kReady_m, world_.position_rad);
    if (moveTo(ready_rad_).status != ArmOutcome::SUCCESS) throw Stuck("the arm does not reach its ready posture");
  }

  Line pick(std::uint64_t number);

 private:
  double now() const { return world_.now().toSec(); }
  void violation(const std::string& what) { line_.violations += (line_.violations.empty() ? "" : " | ") + what; }

  ArmOutcome moveTo(const ArmVector& goal_rad, double speed_rad_s = 1.0) {
    return follow(world_.way({world_.position_rad, goal_rad}, speed_rad_s));
  }
  ArmOutcome follow(const JointTrajectory& trajectory) {
    if (trajectory.duration() <= 0.0) return {};  // there already
    interactive_mapping_msgs::MoveArmGoal goal;
    goal.trajectory = motion_planning_ros::toMessage(trajectory);
    world_.move.send(goal);
    return world_.finish(world_.move, kGoal_s).outcome;
  }

  bool putBrick(double x_m, double y_m, double yaw_rad);
  interactive_mapping_msgs::PickBrickGoal makeGoal(const Draw& draw) const;
  double moment(const Draw& draw, const interactive_mapping_msgs::PickBrickGoal& goal) const;
  bool inject(const Draw& draw);
  void endTimedFaults();
  void endFault(const Draw& draw);
  void judgeStop(const Draw& draw, double goal_end_s);
  void judgeMagnet();
  void judgeMotion(const interactive_mapping_msgs::PickBrickGoal& goal, double goal_end_s);
  void judgeAgreement(const std::string& when, const ArmOutcome* outcome);
  void judgeIncidents();
  void recover(const Draw& draw, const interactive_mapping_msgs::PickBrickGoal& goal);
  bool driveBack();

  const std::uint64_t seed_;
  BridgeWorld world_;
  Truth truth_;
  ArmVector ready_rad_;
  Line line_;
  double fault_s_{0.0};      // when it began
  double fault_end_s_{0.0};  // when a fault of limited duration ends
  double must_stop_until_s_{0.0};
  std::vector<std::pair<double, double>> lets_go_;  // when the soak itself told the bridge to let go
};

bool Soak::putBrick(double x_m, double y_m, double yaw_rad) {
  simulated_world::InjectFault fault;
  fault.request.kind = "move_brick";
  fault.request.brick_id = 0;
  const Eigen::Isometry3d T_map_brick = world_.robotInMap() * Eigen::Translation3d(x_m, y_m, kMiddle_m) *
                                        Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ());
  fault.request.pose.position.x = T_map_brick.translation().x();
  fault.request.pose.position.y = T_map_brick.translation().y();
  fault.request.pose.position.z = T_map_brick.translation().z();
  const Eigen::Quaterniond q(T_map_brick.linear());
  fault.request.pose.orientation.x = q.x();
  fault.request.pose.orientation.y = q.y();
  fault.request.pose.orientation.z = q.z();
  fault.request.pose.orientation.w = q.w();
  return call("/simulated_world/inject_fault", fault) && fault.response.success;
}

/// As a planner would make it that believes the plate where `draw` has it.
interactive_mapping_msgs::PickBrickGoal Soak::makeGoal(const Draw& draw) const {
  using motion_planning_ros::toMessage;
  const double plate_m = kTop_m + (draw.kind == Kind::kPlateWrong ? draw.value : 0.0);
  interactive_mapping_msgs::PickBrickGoal goal;
  goal.brick_id = 0;
  goal.type = "brick";
  goal.let_go = 1;
  goal.brick.header.frame_id = "base_link";
  goal.brick.pose.position.x = draw.x_m;
  goal.brick.pose.position.y = draw.y_m;
  goal.brick.pose.position.z = plate_m - kMiddle_m;
  goal.brick.pose.orientation.z = std::sin(0.5 * draw.yaw_rad);
  goal.brick.pose.orientation.w = std::cos(0.5 * draw.yaw_rad);
  goal.contact.header.frame_id = "base_link";
  goal.contact.pose.position.x = draw.x_m;
  goal.contact.pose.position.y = draw.y_m;
  goal.contact.pose.position.z = plate_m;
  goal.contact.pose.orientation.x = 1.0;  // z down
  goal.held.position.z = kMiddle_m;
  // Of the brick in the tip, which is turned by pi about x.
  const Eigen::Quaterniond held(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()) *
                                Eigen::AngleAxisd(draw.yaw_rad, Eigen::Vector3d::UnitZ()));
  goal.held.orientation.x = held.x();
  goal.held.orientation.y = held.y();
  goal.held.orientation.z = held.z();
  goal.held.orientation.w = held.w();

  const auto over = [&](double z_m, const ArmVector& near_rad) {
    return world_.above(draw.x_m, draw.y_m, z_m, near_rad);
  };
  // `straight` goes along x = const, y = const.
  const auto straight = [&](const ArmVector& from_rad, double from_m, double to_m, double speed_m_s) {
    return world_.straight(from_rad, draw.x_m, draw.y_m, from_m, to_m, speed_m_s);
  };
  const JointTrajectory touch = straight(ready_rad_, plate_m + kTouchFrom_m, plate_m - kOvertravel_m, 0.05);
  const ArmVector over_rad = touch.points.front().position_rad;
  goal.approach = toMessage(world_.way({world_.position_rad, over_rad}));
  goal.touch = toMessage(touch);
  const JointTrajectory lift = straight(over(plate_m, over_rad), plate_m, plate_m + kLift_m, 0.1);
  goal.lift = toMessage(lift);
  // To the side, where the brick is let go low over the ground.
  const ArmVector high_rad = lift.points.back().position_rad;
  goal.stow = toMessage(world_.way({high_rad, world_.above(0.186, -0.75, kTop_m + 0.03, high_rad)}, 0.5));
  return goal;
}

/// After the goal was sent [s].
double Soak::moment(const Draw& draw, const interactive_mapping_msgs::PickBrickGoal& goal) const {
  const auto duration = [](const trajectory_msgs::JointTrajectory& trajectory) {
    return trajectory.points.back().time_from_start.toSec();
  };
  // Zeroing, magnet, weighing, payload and letting go, as seen without faults: 0.4 s before the touch, 2.5 s after it.
  const double approach_s = duration(goal.approach);
  const double touch_s = duration(goal.touch) + 0.4;
  const double end_s = approach_s + touch_s + duration(goal.lift) + duration(goal.stow) + 2.5;
  switch (draw.kind) {
    case Kind::kBrickMoved:
    case Kind::kBrickTaken:
      return draw.share * approach_s;  // later the arm would stand in it
    case Kind::kDropBrick:             // none hangs there before
      return approach_s + touch_s + draw.share * (end_s - approach_s - touch_s);
    case Kind::kPlateWrong:
      return 0.0;
    default:
      return draw.share * end_s;
  }
}

/// False if the world refuses.
bool Soak::inject(const Draw& draw) {
  fault_s_ = now();
  fault_end_s_ = fault_s_ + draw.duration_s;
  const std::string name = kKindNames[static_cast<std::size_t>(draw.kind)];
  switch (draw.kind) {
    case Kind::kProtectiveStop:
    case Kind::kEmergencyStop:
    case Kind::kDriverGone:
    case Kind::kMagnetWeak:
    case Kind::kDropBrick:
    case Kind::kForceNoise:
    case Kind::kIoRefused:
      return world_.inject(name, draw.duration_s, draw.value).empty();
    case Kind::kProgramStopped:
      return world_.trigger("/ur_hardware_interface/dashboard/stop").empty();
    case Kind::kSlow:
      world_.setSpeed(draw.value);
      return true;
    case Kind::kMissionKilled:
      world_.is_mission_alive = false;
      return true;
    case Kind::kMustStop:
      world_.must_stop = "a person's arm";
      world_.speak();
      must_stop_until_s_ = std::numeric_limits<double>::infinity();
      return true;
    case Kind::kMonitorSilent:
      world_.is_monitor_alive = false;
      return true;
    case Kind::kHold:
      return world_.trigger("/ur_driver_bridge/hold").empty();
    case Kind::kCancel:
      world_.pick.cancel();
      return true;
    case Kind::kBrickMoved:
      return putBrick(draw.x_m, draw.y_m + draw.value, draw.yaw_rad);
    case Kind::kBrickTaken:
      return putBrick(draw.x_m + 1.0, draw.y_m, draw.yaw_rad);
    default:
      return true;
  }
}

/// Those that this program makes itself.
void Soak::endTimedFaults() {
  if (must_stop_until_s_ > now() && world_.must_stop.empty()) must_stop_until_s_ = now();  // taken back by a new watch
  if (now() < fault_end_s_) return;
  world_.is_mission_alive = world_.is_monitor_alive = true;
  if (line_.kind == "slow" && fault_end_s_ > 0.0) {
    world_.setSpeed(1.0);
    fault_end_s_ = std::numeric_limits<double>::infinity();
  }
}

void Soak::endFault(const Draw& draw) {
  const std::string name = kKindNames[static_cast<std::size_t>(draw.kind)];
  world_.is_mission_alive = world_.is_monitor_alive = true;
  world_.must_stop.clear();
  if (draw.kind == Kind::kSlow) world_.setSpeed(1.0);
  // One that lasts ends when the same kind has been given again, for a moment and harmless.
  if (draw.kind == Kind::kMagnetWeak) world_.inject(name, 0.05, 1.0);
  if (draw.kind == Kind::kForceNoise || draw.kind == Kind::kIoRefused) world_.inject(name, 0.05, 0.0);
  const bool has_end = draw.kind == Kind::kMagnetWeak || draw.kind == Kind::kForceNoise ||
                       draw.kind == Kind::kIoRefused || draw.kind == Kind::kEmergencyStop ||
                       draw.kind == Kind::kDriverGone;
  if (has_end && !world_.goOn(10.0, [&] { return has(world_.incidents, "fault " + name + " is over"); })) {
    throw Stuck("fault " + name + " does not end");
  }
  if (draw.kind == Kind::kHold && !world_.trigger("/ur_driver_bridge/release").empty()) violation("no release");
}

/// The arm stands soon after the reason of a stop, and as long as the reason lasts.
void Soak::judgeStop(const Draw& draw, double goal_end_s) {
  double within_s = kStop_s;
  double until_s = goal_end_s + kAgree_s;
  double from_s = fault_s_;
  switch (draw.kind) {
    case Kind::kMissionKilled:
      until_s = std::min(until_s, fault_s_ + draw.duration_s);
      break;
    case Kind::kMonitorSilent:
      until_s = std::min(until_s, fault_s_ + draw.duration_s);
      // A watch that was answered meanwhile is a word of the monitor's own, and begins its time anew, once.
      within_s += 2.0 * kMonitorAge_s;
      break;
    case Kind::kMustStop:
      until_s = std::min(until_s, must_stop_until_s_);
      break;
    case Kind::kHold:
    case Kind::kCancel:
      break;
    case Kind::kProtectiveStop:
    case Kind::kEmergencyStop:
    case Kind::kProgramStopped:
      within_s = kRobotStop_s + kSettle_s;
      break;
    case Kind::kDriverGone:
      // Nothing is told of the arm meanwhile; when it is again, the arm stands.
      within_s = kRobotStop_s + kSettle_s;
      break;
    default:
      return;
  }
  const std::optional<double> last_s = truth_.lastMotion(from_s, until_s);
  const bool was_moving = truth_.lastMotion(from_s - 0.03, from_s + 0.03).has_value();
  if (!last_s) return;
  const double stop_s = *last_s - from_s;
  if (was_moving && draw.kind != Kind::kDriverGone) line_.stop_s = stop_s;
  if (stop_s > within_s) {
    std::ostringstream text;
    text << "moves " << stop_s << " s after " << line_.kind << "; allowed " << within_s << " s; stage "
         << truth_.stageAt(*last_s);
    violation(text.str());
  }
}

/// Whatever happens, the arm keeps to the pick's own path and to its speed, and stands when the outcome is told.
void Soak::judgeMotion(const interactive_mapping_msgs::PickBrickGoal& goal, double goal_end_s) {
  std::vector<std::vector<ArmVector>> paths;
  for (const auto* trajectory : {&goal.approach, &goal.touch, &goal.lift, &goal.stow}) {
    paths.emplace_back();
    for (const auto& point : trajectory->points) {
      paths.back().push_back(Eigen::Map<const ArmVector>(point.positions.data()));
    }
  }
  double worst_at_s = 0.0;
  for (const auto& [at_s, position_rad] : truth_.positions()) {
    double nearest_rad = std::numeric_limits<double>::infinity();
    for (const auto& path : paths) {
      for (std::size_t i = 1; i < path.size(); ++i) {
        const ArmVector along = path[i] - path[i - 1];
        const double length2 = along.squaredNorm();
        const double u = length2 > 0.0 ? std::clamp(along.dot(position_rad - path[i - 1]) / length2, 0.0, 1.0) : 0.0;
        nearest_rad = std::min(nearest_rad, (position_rad - path[i - 1] - u * along).cwiseAbs().maxCoeff());
      }
    }
    if (std::isfinite(nearest_rad) && nearest_rad > line_.off_path_rad) {
      line_.off_path_rad = nearest_rad;
      worst_at_s = at_s;
    }
  }
  std::ostringstream text;
  if (line_.off_path_rad > kOffPath_rad) {
    text << line_.off_path_rad << " rad off its path in stage " << truth_.stageAt(worst_at_s) << "; ";
  }
  if (truth_.topSpeed() > kTopSpeed_rad_s) text << truth_.topSpeed() << " rad/s; ";
  // Stands: set_payload changes what the servos carry, and they twitch; what counts is where the arm goes.
  // Of an arm whose driver is gone nothing is known.
  std::optional<ArmVector> end_rad;
  double moved_rad = 0.0;
  for (const auto& [at_s, position_rad] : truth_.positions()) {
    if (at_s < goal_end_s) continue;
    if (!end_rad) end_rad = position_rad;
    moved_rad = std::max(moved_rad, (position_rad - *end_rad).cwiseAbs().maxCoeff());
  }
  if (moved_rad > kTwitch_rad) text << "moves by " << moved_rad << " rad after the outcome; ";
  if (!text.str().empty()) violation(text.str());
}

/// The magnet goes off only over the ground, where nothing hangs, or where it was told to let go.
void Soak::judgeMagnet() {
  for (const Truth::Output& change : truth_.switches()) {
    if (change.is_on) continue;
    // The truth is told each 0.1 s; the output a little after it was switched.
    const Truth::Brick brick = truth_.brickBefore(change.at_s - 0.03);
    if (!brick.is_held) continue;
    const bool is_told = std::any_of(lets_go_.begin(), lets_go_.end(), [&](const auto& span) {
      return change.at_s >= span.first && change.at_s <= span.second;
    });
    const bool is_stage = truth_.isStage("let_go", change.at_s - 0.15, change.at_s + 0.02);
    const bool is_put_down = brick.z_m - kMiddle_m < kPutDown_m + 0.01;
    std::ostringstream text;
    text << "magnet off in stage " << truth_.stageAt(change.at_s) << " with the brick " << brick.z_m - kMiddle_m
         << " m over the ground";
    if (!is_stage) violation(text.str());
    // The end of stow is as low.
    if (is_stage && !is_told && !is_put_down) violation(text.str() + "; nobody asked for it");
  }
  truth_.forgetSwitches();
}

/// Bridge and truth say the same of what hangs on the magnet.
void Soak::judgeAgreement(const std::string& when, const ArmOutcome* outcome) {
  const bool is_held = truth_.brick().is_held;
  const bool is_attached = world_.attached.is_attached != 0;
  const bool is_holding = world_.state.is_holding != 0;
  if (is_attached == is_held && is_holding == is_held) return;
  std::ostringstream text;
  text << when << ": truth " << (is_held ? "held" : "free") << " at " << truth_.brick().z_m << " m; attached_brick "
       << is_attached << "; is_holding " << is_holding;
  if (outcome != nullptr) text << "; outcome.is_holding " << static_cast<int>(outcome->is_holding);
  violation(text.str());
}

/// Contacts that nothing permits, stops that nobody has injected.
void Soak::judgeIncidents() {
  std::istringstream lines(world_.incidents);
  std::string text;
  const bool is_stop_of_robot =
      line_.fault_stage == "touch" && (line_.kind == "driver_gone" || line_.kind == "program_stopped" ||
                                       line_.kind == "protective_stop" || line_.kind == "emergency_stop");
  double lost_s = -std::numeric_limits<double>::infinity();
  while (std::getline(lines, text)) {
    // "12.340 s: what"
    const double at_s = std::atof(text.c_str());
    if (has(text, "the magnet lost brick")) lost_s = at_s;
    // The robot's own stop takes 0.5 s: begun just before contact it goes on into the brick, 12 mm at most, and the
    // robot protects itself. Nothing the bridge can do.
    const bool is_pressed = is_stop_of_robot && at_s >= fault_s_ && at_s - fault_s_ < kRobotStop_s + kSettle_s;
    if (is_pressed && has(text, "protective stop, ")) line_.recovery += " (pressed by the robot's own stop)";
    if (has(text, "protective stop, ") && !is_pressed) violation(text);
    // A brick that falls may meet the robot on its way, wherever it was lost: that is the fall, not a motion.
    const bool is_falling = has(text, "with brick_0") && at_s >= lost_s && at_s - lost_s < kFallingAfter_s;
    if (has(text, "collision of ") && !is_falling) violation(text);
  }
}

/// With the operator's word, until the arm is ready for the next pick.
void Soak::recover(const Draw& draw, const interactive_mapping_msgs::PickBrickGoal& goal) {
  const auto note = [this](const std::string& what) { line_.recovery += (line_.recovery.empty() ? "" : " + ") + what; };
  if (!world_.goOn(1.0, [this] { return world_.state.may_move != 0; })) {
    interactive_mapping_msgs::RecoverArmGoal word;
    word.unlock_protective_stop = 1;
    word.restart_safety = 1;
    world_.recover.send(word);
    const auto result = world_.finish(world_.recover, kGoal_s);
    note("recover");
    if (result.outcome.status != ArmOutcome::SUCCESS) {
      violation("recover: " + statusName(result.outcome.status) + ": " + result.outcome.message);
    }
    if (!world_.goOn(2.0, [this] { return world_.state.may_move != 0; })) {
      throw Stuck("after recovery the bridge may not move: " + world_.state.reason);
    }
  }
  if (world_.state.is_holding != 0 && line_.stage == "stow" && draw.carries_on) {
    const ArmVector end_rad = Eigen::Map<const ArmVector>(goal.stow.points.back().positions.data());
    const ArmOutcome outcome = moveTo(end_rad, 0.5);
    note("carry on: " + statusName(outcome.status));
    if (outcome.status != ArmOutcome::SUCCESS && outcome.status != ArmOutcome::LOST_ON_THE_WAY) {
      violation("carry on: " + statusName(outcome.status) + ": " + outcome.message);
    }
  }
  if (world_.state.is_holding != 0 || truth_.isMagnetOn()) {
    lets_go_.emplace_back(now(), std::numeric_limits<double>::infinity());
    world_.let_go.send({});
    const ArmOutcome outcome = world_.finish(world_.let_go, kGoal_s).outcome;
    lets_go_.back().second = now() + 0.1;
    note("let_go: " + statusName(outcome.status));
    if (outcome.status != ArmOutcome::SUCCESS) {
      violation("let_go: " + statusName(outcome.status) + ": " + outcome.message);
    }
    world_.goOn(kAgree_s);
    judgeAgreement("after let_go", nullptr);
    if (truth_.isMagnetOn()) violation("the magnet is still on after let_go");
  }
  if (!driveBack()) {
    world_.goOn(2.0);
    note("again");
    if (!driveBack()) throw Stuck("the arm does not come back: " + line_.message);
  }
}

/// Straight up first, away from what stands there, then to the ready posture.
bool Soak::driveBack() {
  Eigen::Isometry3d T_base_tip = world_.arm().tipPose(world_.position_rad);
  motion_planning::JointPath path{world_.position_rad};
  while (T_base_tip.translation().z() < kReady_m - 0.01) {
    T_base_tip.translation().z() += 0.01;
    const std::vector<ArmVector> solutions = world_.arm().inverse(T_base_tip, path.back());
    constexpr double kJump_rad = 0.3;  // another branch
    if (solutions.empty() || (solutions.front() - path.back()).cwiseAbs().maxCoeff() > kJump_rad) break;
    path.push_back(solutions.front());
  }
  for (const motion_planning::JointPath& part : {path, motion_planning::JointPath{path.back(), ready_rad_}}) {
    if (part.size() < 2 || (part.back() - part.front()).cwiseAbs().maxCoeff() < 1e-3) continue;
    const ArmOutcome outcome = follow(world_.way(part));
    if (outcome.status == ArmOutcome::SUCCESS) continue;
    line_.message += " / way back: " + statusName(outcome.status) + ": " + outcome.message;
    return false;
  }
  return true;
}

Line Soak::pick(std::uint64_t number) {
  const Draw draw = drawPick(seed_, number);
  line_ = Line();
  line_.number = number;
  line_.kind = kKindNames[static_cast<std::size_t>(draw.kind)];
  line_.value = draw.duration_s > 0.0 && draw.kind != Kind::kSlow ? draw.duration_s : draw.value;
  line_.begun_s = std::nan("");
  fault_s_ = fault_end_s_ = must_stop_until_s_ = 0.0;
  lets_go_.clear();
  if (!putBrick(draw.x_m, draw.y_m, draw.yaw_rad)) throw Stuck("the brick cannot be put before the robot");
  world_.setTarget(0);
  world_.goOn(3.0);  // until it is in nobody's hand, and lies still
  truth_.forget();
  world_.incidents.clear();
  const int collisions_before = world_.judge.collisions;
  const int failed_before = testing::UnitTest::GetInstance()->ad_hoc_test_result().total_part_count();

  const auto goal = makeGoal(draw);
  const double start_s = now();
  world_.pick.send(goal);
  if (draw.kind != Kind::kNone) {
    const double end_s = start_s + moment(draw, goal);
    const bool is_late = world_.goOn(end_s - start_s, [this] { return world_.pick.isDone(); });
    if (!is_late) {
      line_.fault_stage = world_.state.stage;
      if (inject(draw)) line_.begun_s = fault_s_ - start_s;
    }
  }
  const bool has_begun = !std::isnan(line_.begun_s);
  const auto each_step = [this, has_begun] {
    if (has_begun) endTimedFaults();
  };
  const bool has_ended = world_.goOn(
      start_s + kGoal_s - now(), [this] { return world_.pick.isDone(); }, each_step);
  const double goal_end_s = now();
  line_.lasted_s = goal_end_s - start_s;
  ArmOutcome outcome;
  if (has_ended) {
    outcome = world_.pick.result().outcome;
    line_.status = statusName(outcome.status);
    line_.stage = outcome.stage;
    line_.message = outcome.message;
  } else {
    line_.status = "NO_OUTCOME";
    line_.stage = world_.state.stage;
    violation("deadlock: no outcome in stage " + world_.state.stage);
  }
  world_.goOn(
      kAgree_s, [] { return false; }, each_step);
  if (!has_ended) throw Stuck(line_.violations);
  if (world_.state.phase != ArmBridgeState::IDLE) violation("not idle after its outcome; stage " + world_.state.stage);
  judgeAgreement("after the pick", &outcome);
  if (outcome.status == ArmOutcome::FAULT) violation("FAULT");
  if (draw.kind == Kind::kNone && outcome.status != ArmOutcome::SUCCESS) {
    violation("without a fault: " + line_.status);
  }
  judgeMotion(goal, goal_end_s);
  if (has_begun) judgeStop(draw, goal_end_s);
  judgeMagnet();
  if (has_begun) endFault(draw);
  recover(draw, goal);
  judgeMagnet();
  judgeIncidents();
  // The judge tells each 0.5 s; incidents tell which contacts these were.
  if (world_.judge.collisions > collisions_before && !has(world_.incidents, "collision of ")) {
    violation("the judge has counted a collision");
  }
  if (testing::UnitTest::GetInstance()->ad_hoc_test_result().total_part_count() > failed_before) {
    violation("an expectation of BridgeWorld has failed; see the log");
  }
  return line_;
}

struct Options {
  std::uint64_t picks{200};
  std::uint64_t first{0};
  std::uint64_t seed{1};
  std::string out{"."};
  std::string label;
};

std::vector<Line> readLines(const Options& options, const std::string& path) {
  std::vector<Line> lines;
  std::ifstream in(path);
  std::string text;
  if (!std::getline(in, text) || text != "# " + options.label + " seed " + std::to_string(options.seed)) return lines;
  std::getline(in, text);
  // The last line of an interrupted run may be half a line.
  while (std::getline(in, text) && !in.eof()) lines.push_back(Line::parse(text));
  return lines;
}

/// Fault by outcome. True if nothing was violated.
bool summarize(const std::vector<Line>& lines) {
  struct Row {
    int picks{0};
    int in_time{0};
    std::map<std::string, int> statuses;
    double worst_s{0.0};
    int violations{0};
  };
  std::map<std::string, Row> rows;
  int violations = 0;
  for (const Line& line : lines) {
    Row& row = rows[line.kind];
    ++row.picks;
    if (!std::isnan(line.begun_s)) ++row.in_time;
    ++row.statuses[line.status];
    if (!std::isnan(line.stop_s)) row.worst_s = std::max(row.worst_s, line.stop_s);
    if (!line.violations.empty()) {
      ++row.violations;
      ++violations;
    }
  }
  std::cout << "| fault | picks | begun in time | outcomes | longest stop [s] | violations |\n"
            << "| --- | ---: | ---: | --- | ---: | ---: |\n";
  for (const char* kind : kKindNames) {
    const auto found = rows.find(kind);
    if (found == rows.end()) continue;
    const Row& row = found->second;
    std::string outcomes;
    for (const auto& [status, count] : row.statuses) {
      outcomes += (outcomes.empty() ? "" : ", ") + std::to_string(count) + " " + status;
    }
    std::cout << "| " << kind << " | " << row.picks << " | " << row.in_time << " | " << outcomes << " | ";
    if (row.worst_s > 0.0) std::cout << std::fixed << std::setprecision(2) << row.worst_s;
    std::cout << " | " << row.violations << " |\n";
  }
  for (const Line& line : lines) {
    if (!line.violations.empty()) std::cout << "VIOLATION in " << line.text() << '\n';
  }
  double off_path_rad = 0.0;
  double lasted_s = 0.0;
  for (const Line& line : lines) {
    off_path_rad = std::max(off_path_rad, line.off_path_rad);
    lasted_s = std::max(lasted_s, line.lasted_s);
  }
  std::cout << std::setprecision(4) << "at most " << off_path_rad << " rad off the path; longest goal " << lasted_s
            << " s\n";
  std::cout << lines.size() << " picks, " << violations << " with a violation" << std::endl;
  return violations == 0;
}

int run(const Options& options, bool only_judge) {
  const std::string path = options.out + "/bridge.csv";
  std::vector<Line> lines = readLines(options, path);
  const auto isComplete = [&] { return options.first + lines.size() >= options.picks; };
  if (!only_judge && !isComplete()) {
    if (!lines.empty()) std::cout << lines.size() << " picks were made before" << std::endl;
    std::ofstream out(path);
    out << "# " << options.label << " seed " << options.seed << '\n' << kHeader << '\n';
    for (const Line& line : lines) out << line.text() << '\n';
    Soak soak(options.seed);
    int violations = 0;
    for (std::uint64_t number = options.first + lines.size(); number < options.picks && ros::ok(); ++number) {
      const Line line = soak.pick(number);
      out << line.text() << std::endl;
      if (!out) throw std::runtime_error(path + ": cannot be written");
      lines.push_back(line);
      if (!line.violations.empty()) {
        ++violations;
        std::cout << "VIOLATION in " << line.text() << std::endl;
      }
      if ((number + 1) % 10 == 0) std::cout << number + 1 << " picks, " << violations << " violations" << std::endl;
    }
  }
  const bool is_good = summarize(lines);
  if (!isComplete()) std::cout << "not complete: " << options.picks << " picks were asked for" << std::endl;
  return is_good && isComplete() ? 0 : 1;
}

}  // namespace
}  // namespace integration_tests

int main(int argc, char** argv) {
  namespace po = boost::program_options;
  std::vector<std::string> arguments;
  ros::removeROSArgs(argc, argv, arguments);
  arguments.erase(arguments.begin());
  integration_tests::Options options;
  po::options_description description("Picks with random faults in the simulated world, judged by its truth. Options");
  auto add = description.add_options();
  add("help", "this text");
  add("picks", po::value(&options.picks)->default_value(options.picks), "number of the pick before which to end");
  add("first", po::value(&options.first)->default_value(options.first), "number of the first pick");
  add("seed", po::value(&options.seed)->default_value(options.seed), "of places, faults and moments");
  add("out", po::value(&options.out)->default_value(options.out), "folder for bridge.csv");
  add("label", po::value(&options.label)->default_value(options.label),
      "of the tree's state: what another one left is not gone on with");
  add("judge", "only reports the picks that were made; needs no world");
  po::variables_map values;
  try {
    po::store(po::command_line_parser(arguments).options(description).run(), values);
    po::notify(values);
  } catch (const po::error& error) {
    std::cerr << "soak_bridge: " << error.what() << '\n' << description;
    return 2;
  }
  if (values.count("help") > 0) {
    std::cout << description;
    return 0;
  }
  try {
    if (values.count("judge") > 0) return integration_tests::run(options, true);
    testing::InitGoogleTest(&argc, argv);
    ros::init(argc, argv, "soak_bridge");
    const ros::NodeHandle keep_alive;
    return integration_tests::run(options, false);
  } catch (const std::exception& error) {
    std::cerr << "soak_bridge: " << error.what() << '\n';
    return 1;
  }
}
