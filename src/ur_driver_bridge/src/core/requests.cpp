// SPDX-License-Identifier: BSD-3-Clause
#include "requests.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <mp700_ur5e_description/robot_names.h>

#include "ur_driver_bridge/time_law.h"

namespace ur_driver_bridge {
namespace {

template <typename Made, typename... Arguments>
Item item(Arguments&&... arguments) {
  return {std::make_unique<Made>(std::forward<Arguments>(arguments)...), {}};
}

void append(Items more, Items* items) {
  for (Item& one : more) items->push_back(std::move(one));
}

/// When the tip has gone `rise_m` from the start, or the end.
double timeAtRise(const ArmModel& model, const JointTrajectory& trajectory, double rise_m) {
  constexpr double kSample_s = 0.01;  // a millimetre at 0.1 m/s
  const auto tip = [&model](const ArmVector& joints_rad) {
    return Eigen::Vector3d(model.kinematics->tipPose(joints_rad).translation());
  };
  const Eigen::Vector3d start = tip(trajectory.points.front().position_rad);
  for (double s = trajectory.points.front().time_s; s < trajectory.duration(); s += kSample_s) {
    if ((tip(trajectory.sample(s).position_rad) - start).norm() >= rise_m) return s;
  }
  return trajectory.duration();
}

/// All four trajectories before the first one begins: a brick in the air is no place to find the next one impossible.
Items checkItems(const ExecutorConfig& config, const ArmModel& model,
                 const std::shared_ptr<const PickRequest>& request) {
  TrajectoryLimits limits = model.limits;
  limits.acceleration_rad_s2.setConstant(config.motion.acceleration_rad_s2);
  const double tolerance_rad = config.motion.start_tolerance_rad;
  Items items;
  const auto add = [&](const std::string& stage, const JointTrajectory& trajectory, auto starts_at) {
    const auto check = [request, limits, tolerance_rad, &trajectory, starts_at](const StepContext&) {
      const Verdict verdict = checkTrajectory(trajectory, limits);
      if (!verdict.isFine()) return verdict;
      const std::optional<ArmVector> start_rad = starts_at(*request);
      return start_rad ? checkStart(trajectory, *start_rad, limits.joints, tolerance_rad) : Verdict{};
    };
    items.push_back(item<CheckStep>(stage, check));
  };
  using Start = std::optional<ArmVector>;
  add("approach", request->approach, [](const PickRequest&) { return Start(); });
  add("touch", request->touch, [](const PickRequest& pick) { return Start(pick.approach.points.back().position_rad); });
  // Anywhere on the touch, for that ends where there is contact.
  add("lift", request->lift, [](const PickRequest& pick) {
    const double at_s = timeOf(pick.touch, pick.lift.points.front().position_rad, 0.0, pick.touch.duration());
    return Start(pick.touch.sample(at_s).position_rad);
  });
  if (!request->stow.empty()) {
    add("stow", request->stow, [](const PickRequest& pick) { return Start(pick.lift.points.back().position_rad); });
  }
  return items;
}

/// Throws std::invalid_argument for a pick that makes no sense.
void requireSense(const PickRequest& request) {
  const std::size_t points =
      std::min({request.approach.points.size(), request.touch.points.size(), request.lift.points.size()});
  if (points == 0) throw std::invalid_argument("pick: approach, touch and lift must have points");
  if (!(request.brick_mass_kg > 0.0 && std::isfinite(request.brick_mass_kg))) {
    throw std::invalid_argument(
        formatted("pick: brick_mass_kg = %g kg, must be > 0 kg and finite", request.brick_mass_kg));
  }
  if (!(request.contact_travel_m >= 0.0 && std::isfinite(request.contact_travel_m))) {
    throw std::invalid_argument(
        formatted("pick: contact_travel_m = %g m, must be >= 0 m and finite", request.contact_travel_m));
  }
}

/// Tool and brick. Throws std::invalid_argument for one that the arm cannot carry.
Payload payloadWith(const PickRequest& request, const ArmModel& model) {
  Payload payload;
  payload.mass_kg = model.tool.mass_kg + request.brick_mass_kg;
  const Eigen::Isometry3d T_tool_tip =
      model.kinematics->robot().poseInBody(mp700_ur5e_description::kToolFrame).inverse() *
      model.kinematics->robot().poseInBody(mp700_ur5e_description::kMagnetTipFrame);
  payload.centre_m = (model.tool.mass_kg * model.tool.centre_m +
                      request.brick_mass_kg * (T_tool_tip * request.T_tip_brick.translation())) /
                     payload.mass_kg;
  if (!payload.centre_m.allFinite()) throw std::invalid_argument("pick: T_tip_brick is not finite");
  if (!(payload.mass_kg <= model.max_payload_kg)) {
    throw std::invalid_argument(formatted("pick: tool and brick weigh %.2f kg, must be at most %.2f kg",
                                          payload.mass_kg, model.max_payload_kg));
  }
  return payload;
}

}  // namespace

Items moveItems(const JointTrajectory& trajectory) {
  Items items;
  items.push_back(item<MotionStep>("move", WatchPhase::kFree, [trajectory] { return trajectory; }));
  return items;
}

Items letGoItems(const ArmModel& model, double brick_mass_kg, Duty duty) {
  Items items;
  items.push_back(item<MagnetStep>("let_go", false, duty));
  if (brick_mass_kg > 0.0) items.push_back(item<GoneStep>("let_go"));
  items.push_back(item<AttachStep>("let_go", false));
  items.push_back(item<PayloadStep>("let_go", model.tool, Duty::kAlways));
  return items;
}

Items letGoUnknownItems(const ArmModel& model) {
  // Nobody knows what hung there when the node began.
  const auto check = [](const StepContext& context) {
    const auto& gripper = context.arm().gripper;
    const bool is_off = gripper && !gripper->value.is_on;
    return is_off ? Verdict{ArmStatus::kNothingHeld, "the magnet is off, and holds nothing"} : Verdict{};
  };
  Items items = letGoItems(model, 0.0, Duty::kUnlessStopped);
  items.push_front(item<CheckStep>("let_go", check));
  return items;
}

Items recoverItems(const RecoveryConfig& config, const RecoveryPermit& permit) {
  Items items;
  items.push_back(item<RecoverStep>(config, permit));
  // The stop may have cost the brick. A planner that still counts it as held may find no path.
  items.push_back(item<StillThereStep>("recover"));
  return items;
}

Items lossItems(const ArmModel& model) {
  Items items;
  items.push_back(item<AttachStep>("let_go", false));
  items.push_back(item<MagnetStep>("let_go", false, Duty::kAlways));
  items.push_back(item<PayloadStep>("let_go", model.tool, Duty::kAlways));
  return items;
}

Items pickItems(const ExecutorConfig& config, const ArmModel& model, const PickRequest& request,
                TouchStep::Touched* touched) {
  requireSense(request);
  const Payload payload = payloadWith(request, model);
  const auto shared = std::make_shared<const PickRequest>(request);
  const double ramp_s = config.pick.ramp_s;
  const double weigh_s = timeAtRise(model, request.lift, config.pick.weigh_height_m);
  // What is stopped or begun within a motion adds to its accelerations.
  const auto gentle = [&config](const JointTrajectory& trajectory) {
    return withinAcceleration(trajectory, config.motion.acceleration_rad_s2);
  };
  // From where the touch has ended, which is not quite where the lift was planned to begin: the difference fades all the
  // way, or the magnet would first be pressed down to there.
  const auto littleLift = [=] {
    const JointTrajectory lift = upTo(shared->lift, weigh_s, ramp_s);
    if (lift.duration() <= 0.0) return lift;
    return gentle(joined(lift, touched->trajectory.sample(touched->at_s).position_rad, lift.duration()));
  };

  // Back the way the magnet came, from wherever the touch has ended.
  const auto retreat = [=] {
    Items items;
    items.push_back(
        item<RetreatStep>([=] { return gentle(reversed(upTo(touched->trajectory, touched->at_s, ramp_s))); }));
    return items;
  };
  const auto offAndRetreat = [=, &model] {
    Items items = letGoItems(model, 0.0, Duty::kAlways);
    append(retreat(), &items);
    return items;
  };
  const auto lifted_a_little = std::make_shared<LiftStep::Lifted>();
  const auto lifted = std::make_shared<LiftStep::Lifted>();
  // What hangs there is put back where it was, whatever it is; then away from it.
  const auto putBack = [=] {
    Items items;
    for (const auto& part : {lifted, lifted_a_little}) {
      if (part->trajectory.empty()) continue;  // not begun, or stopped before it moved
      items.push_back(item<PutBackStep>([=] { return gentle(reversed(upTo(part->trajectory, part->at_s, ramp_s))); }));
    }
    append(offAndRetreat(), &items);
    return items;
  };
  const auto undoIf = [](auto undo, std::initializer_list<ArmStatus> statuses) {
    return [undo, of = std::vector<ArmStatus>(statuses)](const Verdict& verdict) {
      return std::count(of.begin(), of.end(), verdict.status) > 0 ? undo() : Items{};
    };
  };

  Items items = checkItems(config, model, shared);
  const auto add = [&items](Item one) { items.push_back(std::move(one)); };
  const auto addMotion = [&](const char* stage, WatchPhase watch, auto make) {
    add(item<MotionStep>(stage, watch, make));
  };
  addMotion("approach", WatchPhase::kFree, [shared] { return shared->approach; });
  add(item<ZeroForceStep>("zero"));
  add({std::make_unique<TouchStep>([shared] { return shared->touch; }, request.contact_travel_m, touched),
       undoIf(retreat, {ArmStatus::kContactTooEarly, ArmStatus::kNotAttached})});
  // The call has failed, and the magnet may still be on.
  add({std::make_unique<MagnetStep>("magnet", true, Duty::kIfGateIsOpen),
       undoIf(offAndRetreat, {ArmStatus::kIoRefused, ArmStatus::kDriverGone, ArmStatus::kNotAttached})});
  add(item<AttachStep>("magnet", true));
  add({std::make_unique<LiftStep>("lift_a_little", littleLift, request.brick_mass_kg, lifted_a_little),
       undoIf(putBack, {ArmStatus::kPathBlocked})});
  add({std::make_unique<WeighStep>("weigh", request.brick_mass_kg, &touched->no_contact),
       undoIf(putBack, {ArmStatus::kNotAttached, ArmStatus::kNoContact})});
  add(item<PayloadStep>("payload", payload, Duty::kUnlessStopped));
  add(item<HoldStep>("payload", request.brick_mass_kg));
  if (weigh_s < request.lift.duration()) {
    const auto lift = [=] { return gentle(resume(shared->lift, weigh_s, ramp_s)); };
    add({std::make_unique<LiftStep>("lift", lift, request.brick_mass_kg, lifted),
         undoIf(putBack, {ArmStatus::kNotAttached, ArmStatus::kPathBlocked})});
  }
  if (!request.stow.empty()) addMotion("stow", WatchPhase::kFree, [shared] { return shared->stow; });
  if (request.lets_go) append(letGoItems(model, request.brick_mass_kg, Duty::kIfGateIsOpen), &items);
  return items;
}

}  // namespace ur_driver_bridge
