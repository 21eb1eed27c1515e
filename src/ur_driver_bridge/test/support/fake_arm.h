// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <mp700_ur5e_description/robot_names.h>

#include "ur_driver_bridge/executor.h"
#include "ur_driver_bridge/time_law.h"

namespace ur_driver_bridge {

inline std::shared_ptr<const motion_planning::ArmKinematics> fakeKinematics() {
  static const auto kArm =
      std::make_shared<motion_planning::ArmKinematics>(mp700_ur5e_description::RobotModel::load(URDF_FILE));
  return kArm;
}

inline ArmModel fakeModel() {
  ArmModel model;
  model.kinematics = fakeKinematics();
  const motion_planning::ArmLimits& limits = model.kinematics->limits();
  model.limits.joints.assign(mp700_ur5e_description::kArmJoints.begin(), mp700_ur5e_description::kArmJoints.end());
  model.limits.lower_rad = limits.lower_rad;
  model.limits.upper_rad = limits.upper_rad;
  model.limits.velocity_rad_s = limits.velocity_rad_s;
  model.tool.mass_kg = 0.8;
  return model;
}

/// An arm with its driver, controller, path monitor, map and mission around an Executor: carries its calls out, step by
/// step, without a clock of its own. Follows what it is sent exactly; a brick lies under it.
class FakeArm {
 public:
  enum class Answer { kYes, kNo, kGone, kNever };
  struct Manner {
    Answer answer{Answer::kYes};
    double delay_s{0.0};
  };
  static constexpr double kStep_s = 0.01;
  static constexpr double kStiffness_N_m = 2e4;  // of plate and magnet

  FakeArm(const ExecutorConfig& config, const ArmVector& start_rad)
      : executor(config, fakeModel()), position_rad(start_rad), config_(config) {
    const mp700_ur5e_description::RobotModel& robot = fakeKinematics()->robot();
    namespace names = mp700_ur5e_description;
    R_tip_tool_ = (robot.poseInBody(names::kMagnetTipFrame).inverse() * robot.poseInBody(names::kToolFrame)).linear();
    gate.arm.robot_mode = robot_mode::kRunning;
    gate.arm.safety_mode = safety_mode::kNormal;
    gate.arm.is_program_running = true;
    gate.arm.is_controller_there = true;
    // What a lone step() before the first sees.
    look();
  }

  /// One joint state.
  void step() {
    now_s += kStep_s;
    ++steps;
    move(kStep_s);
    look();
    advance();
  }

  /// Until the request ends: nothing if that takes longer than `limit_s`. `each_step` is called before each.
  std::optional<Finished> run(double limit_s, const std::function<void()>& each_step = {}) {
    const int finished_before = finished_count;
    const int last = steps + static_cast<int>(std::ceil(limit_s / kStep_s));
    while (steps < last) {
      if (each_step) each_step();
      step();
      if (finished_count > finished_before) return finished;
    }
    return std::nullopt;
  }

  bool isAtRest() const { return speed() < config_.motion.rest_rad_s; }
  double speed() const { return velocity_rad_s.cwiseAbs().maxCoeff(); }
  double tipHeight() const { return fakeKinematics()->tipPose(position_rad).translation().z(); }
  /// The brick's weight is on the magnet.
  bool hangs() const { return has_brick && tipHeight() > brick_z_m + 1e-3; }
  int count(const std::string& call) const { return static_cast<int>(std::count(calls.begin(), calls.end(), call)); }
  /// Somebody else ends what the controller follows; the arm stops.
  void abort(TrajectoryEvent::Kind kind, const std::string& message) {
    if (running_) end(kind, message);
    halt();
  }

  Executor executor;
  double now_s{1000.0};
  int steps{0};

  // The world, for tests to change.
  GateInputs gate;  // is renewed each step but for modes, hold, and what is silent
  ArmVector position_rad;
  ArmVector velocity_rad_s{ArmVector::Zero()};
  double scaling{1.0};
  double plate_z_m{-10.0};                  // in the arm's base; the magnet touches below
  bool gives_way{false};                    // the plate is pushed along without a force
  double sideways_N{0.0};                   // from now on
  double push_up_N{0.0};                    // likewise, of something under what it carries
  double brick_z_m{0.0};                    // of the tip, where it was when the brick stuck to it
  double mass_kg{1.0};                      // of what lies there
  double noise_N{0.0};                      // alternating
  bool holds_plate{true};                   // it sticks to a magnet that is on
  std::optional<bool> is_held_by_pressure;  // as a vacuum tells
  bool is_pin_stuck{false};
  bool has_brick{false};  // at the magnet
  std::map<std::string, Manner> manners;
  bool ignores_cancel{false};
  bool hides_acceptance{false};                // the controller follows, and does not say so
  ArmVector shaking_rad_s{ArmVector::Zero()};  // beside its motion, as the joint states tell
  bool is_joints_silent{false};
  bool is_force_silent{false};
  bool is_mission_silent{false};
  double watch_over_s{0.3};  // the monitor's watch ends so much after the trajectory's time
  bool is_monitor_silent{false};
  bool is_map_silent{false};
  std::string must_stop;

  // What has happened.
  std::vector<std::string> calls;  // "watch", "send", "magnet_on", ...
  std::vector<std::string> stages;
  std::vector<JointTrajectory> sent;
  WatchCall watched;  // the last one
  std::vector<Payload> payloads;
  std::deque<CallReply> extra_replies;  // said with the next step, asked for or not
  std::deque<TrajectoryEvent> extra_events;
  std::uint64_t last_sent_id{0};
  int finished_count{0};
  std::optional<Finished> finished;
  bool is_attached{false};  // as the last AttachCall says
  bool is_magnet_on{false};
  int dropped{0};                // times the magnet was switched off while a brick hung in the air
  std::string dropped_in;        // stage
  double worst_off_path_rad{0};  // of any posture while following, to what was sent before any stop
  double longest_stop_s{0.0};    // from the first step of a stop until the arm stood

 private:
  struct Running {
    std::uint64_t id;
    JointTrajectory trajectory;  // from where the arm was, at time 0
    double at_s{0.0};
    double start_s;  // accepted
    bool is_halting{false};
  };
  struct Due {
    double at_s;
    std::function<void()> happen;
  };

  Manner mannerOf(const std::string& name) const {
    const auto found = manners.find(name);
    return found == manners.end() ? Manner{} : found->second;
  }

  void move(double dt_s) {
    velocity_rad_s.setZero();
    if (!running_) return;
    running_->at_s += dt_s * (running_->is_halting ? 1.0 : scaling);
    const TrajectoryPoint point = running_->trajectory.sample(running_->at_s);
    position_rad = point.position_rad;
    velocity_rad_s = point.velocity_rad_s * (running_->is_halting ? 1.0 : scaling);
    if (running_->at_s < running_->trajectory.duration()) return;
    velocity_rad_s.setZero();
    if (!running_->is_halting) end(TrajectoryEvent::Kind::kSucceeded, "");
    running_.reset();
  }

  void end(TrajectoryEvent::Kind kind, const std::string& message) {
    if (running_->is_halting) return;
    const TrajectoryEvent event{running_->id, kind, message};
    due_.push_back({now_s, [this, event] { events_.push_back(event); }});
  }

  /// The controller's own stop, on the way: as real ones hold the arm.
  void halt() {
    if (!running_ || running_->is_halting) return;
    const double real = std::max(scaling, 1e-3);
    JointTrajectory stop = brake(running_->trajectory, running_->at_s, 0.05 * real);
    for (TrajectoryPoint& point : stop.points) {
      point.time_s /= real;
      point.velocity_rad_s *= real;
    }
    running_ = Running{running_->id, stop, 0.0, now_s, true};
  }

  void look() {
    gate.now_s = now_s;
    gate.wall_s = now_s;
    if (!is_joints_silent) gate.arm.joints = Stamped<JointState>{now_s, {position_rad, velocity_rad_s + shaking_rad_s}};
    if (!is_force_silent) gate.arm.force = Stamped<ToolForce>{now_s, {force(), Eigen::Vector3d::Zero()}};
    if (!is_joints_silent) gate.arm.speed_scaling = Stamped<double>{now_s, scaling};
    const bool is_on = is_magnet_on && !is_pin_stuck;
    gate.arm.gripper = Stamped<GripperState>{now_s, {is_on, is_held_by_pressure}};
    if (!is_map_silent) gate.map_stamp_s = now_s;
    if (!is_mission_silent) gate.heartbeat_s = now_s;
    if (!is_monitor_silent) {
      // As the real one: it has nothing more to look at once the trajectory is over by its clock.
      const bool is_watching = watch_id_ != 0 && now_s < watch_end_s_;
      gate.monitor = MonitorWord{now_s, is_watching, watch_id_, !must_stop.empty(), must_stop};
    }
  }

  Eigen::Vector3d force() {
    const Eigen::Matrix3d R_base_tool = fakeKinematics()->tipPose(position_rad).linear() * R_tip_tool_;
    if (gives_way) plate_z_m = std::min(plate_z_m, tipHeight());
    const double depth_m = plate_z_m - tipHeight();
    Eigen::Vector3d up_N = push_up_N * Eigen::Vector3d::UnitZ();
    if (depth_m > 0.0 && !hangs()) up_N.z() += kStiffness_N_m * depth_m;
    const double declared_kg = payloads.empty() ? 0.0 : payloads.back().mass_kg - fakeModel().tool.mass_kg;
    up_N.z() -= kGravity_m_s2 * ((hangs() ? mass_kg : 0.0) - declared_kg);
    up_N.z() += steps % 2 == 0 ? noise_N : -noise_N;
    return R_base_tool.transpose() * up_N + Eigen::Vector3d(sideways_N, 0.0, 0.0);
  }

  void advance() {
    ExecutorInputs inputs;
    for (std::size_t i = 0; i < due_.size();) {
      if (due_[i].at_s > now_s + 1e-9) {
        ++i;
        continue;
      }
      const auto happen = due_[i].happen;
      due_.erase(due_.begin() + static_cast<std::ptrdiff_t>(i));
      happen();
    }
    inputs.gate = gate;
    inputs.replies.assign(replies_.begin(), replies_.end());
    inputs.replies.insert(inputs.replies.end(), extra_replies.begin(), extra_replies.end());
    inputs.events.assign(events_.begin(), events_.end());
    inputs.events.insert(inputs.events.end(), extra_events.begin(), extra_events.end());
    replies_.clear();
    events_.clear();
    extra_replies.clear();
    extra_events.clear();
    const ExecutorOutput output = executor.step(inputs);
    const bool is_stopping = executor.phase() == ExecutorPhase::kStopping;
    if (is_stopping && !stop_since_s_) {
      stop_since_s_ = now_s;
      has_stood_ = false;
    }
    for (const ArmCall& call : output.calls) carryOut(call, is_stopping);
    if (stages.empty() || stages.back() != executor.stage()) stages.push_back(executor.stage());
    if (stop_since_s_) {
      if (!has_stood_) longest_stop_s = std::max(longest_stop_s, now_s - *stop_since_s_);
      has_stood_ = has_stood_ || isAtRest();
      if (!is_stopping) stop_since_s_.reset();
    }
    if (running_ && !path_.empty()) {
      const double near_s = timeOf(path_, position_rad, path_.duration() * 0.5, path_.duration());
      worst_off_path_rad =
          std::max(worst_off_path_rad, (path_.sample(near_s).position_rad - position_rad).cwiseAbs().maxCoeff());
    }
    if (output.finished) {
      finished = output.finished;
      ++finished_count;
    }
  }

  void later(const Manner& manner, const std::function<void()>& happen) {
    due_.push_back({now_s + std::max(manner.delay_s, 0.5 * kStep_s), happen});
  }

  /// `effect`: if the answer is yes, with the answer.
  void answer(std::uint64_t id, const std::string& name, const std::function<void(CallReply&)>& effect) {
    Manner manner = mannerOf(name);
    if (manner.answer == Answer::kNever) return;
    if (name == "watch" || name == "unwatch") {
      // One after the other, as a service is called.
      manner.delay_s = std::max(manner.delay_s, last_watch_s_ - now_s);
      last_watch_s_ = now_s + manner.delay_s;
    }
    later(manner, [this, id, manner, effect] {
      CallReply reply;
      reply.id = id;
      reply.success = manner.answer == Answer::kYes;
      reply.is_gone = manner.answer == Answer::kGone;
      if (!reply.success) reply.message = "not now";
      if (reply.success) effect(reply);
      replies_.push_back(reply);
    });
  }

  void carryOut(const ArmCall& call, bool is_stopping) {
    const std::uint64_t id = call.id;
    if (const auto* watch = std::get_if<WatchCall>(&call.what)) {
      calls.push_back(watch->trajectory.empty() ? "unwatch" : "watch");
      const WatchCall what = *watch;
      watched = what;
      answer(id, calls.back(), [this, what](CallReply& reply) {
        watch_id_ = what.trajectory.empty() ? 0 : ++watches_;
        watch_end_s_ = what.start_s + what.trajectory.duration() + watch_over_s;
        reply.watch_id = watch_id_;
        look();  // as from the real one, its first word is there before its answer
      });
    } else if (const auto* send = std::get_if<SendCall>(&call.what)) {
      calls.push_back(is_stopping ? "brake" : "send");
      sent.push_back(send->trajectory);
      last_sent_id = id;
      if (!is_stopping) path_ = send->trajectory;
      const Manner manner = mannerOf(calls.back());
      if (manner.answer == Answer::kNever) return;
      const JointTrajectory wanted = send->trajectory;
      later(manner, [this, id, wanted, manner] {
        if (manner.answer != Answer::kYes) {
          events_.push_back({id, TrajectoryEvent::Kind::kRejected, "not now"});
          return;
        }
        if (running_) end(TrajectoryEvent::Kind::kCancelled, "replaced");
        if (!hides_acceptance) events_.push_back({id, TrajectoryEvent::Kind::kAccepted, ""});
        // From where the arm is and as fast as it goes there, to the first point that is still to come.
        TrajectoryPoint from;
        from.position_rad = position_rad;
        from.velocity_rad_s = velocity_rad_s / std::max(scaling, 1e-3);
        Running running{id, {}, 0.0, now_s};
        running.trajectory.points.push_back(from);
        for (const TrajectoryPoint& point : wanted.points) {
          if (point.time_s > 1e-6) running.trajectory.points.push_back(point);
        }
        running_ = running;
      });
    } else if (std::holds_alternative<CancelCall>(call.what)) {
      calls.push_back("cancel");
      if (ignores_cancel || !running_) return;
      end(TrajectoryEvent::Kind::kCancelled, "as asked");
      halt();
    } else if (const auto* magnet = std::get_if<MagnetCall>(&call.what)) {
      calls.push_back(magnet->is_on ? "magnet_on" : "magnet_off");
      const std::string stage = executor.stage();
      answer(id, calls.back(), [this, is_on = magnet->is_on, stage](CallReply&) {
        if (!is_on && hangs()) {
          ++dropped;
          dropped_in = stage;
        }
        is_magnet_on = is_on;
        if (is_on && holds_plate && tipHeight() < plate_z_m + 2e-3) {
          has_brick = true;
          brick_z_m = tipHeight();
        }
        if (!is_on) has_brick = false;
      });
    } else if (std::holds_alternative<ZeroForceCall>(call.what)) {
      calls.push_back("zero");
      answer(id, "zero", [](CallReply&) {});
    } else if (const auto* payload = std::get_if<PayloadCall>(&call.what)) {
      calls.push_back("payload");
      answer(id, "payload", [this, what = payload->payload](CallReply&) { payloads.push_back(what); });
    } else if (const auto* dashboard = std::get_if<DashboardCall>(&call.what)) {
      calls.push_back(dashboard->command);
      answer(id, dashboard->command, [this, command = dashboard->command](CallReply&) {
        if (command == "dashboard/unlock_protective_stop") gate.arm.safety_mode = safety_mode::kNormal;
        if (command == "dashboard/play") gate.arm.is_program_running = true;
      });
    } else if (const auto* attach = std::get_if<AttachCall>(&call.what)) {
      calls.push_back(attach->is_attached ? "attach" : "detach");
      is_attached = attach->is_attached;
    }
  }

  ExecutorConfig config_;
  Eigen::Matrix3d R_tip_tool_;
  std::optional<Running> running_;
  std::deque<Due> due_;
  std::deque<CallReply> replies_;
  std::deque<TrajectoryEvent> events_;
  JointTrajectory path_;
  std::optional<double> stop_since_s_;
  bool has_stood_{false};
  double last_watch_s_{0.0};
  std::uint32_t watch_id_{0}, watches_{0};
  double watch_end_s_{0.0};
};

}  // namespace ur_driver_bridge
