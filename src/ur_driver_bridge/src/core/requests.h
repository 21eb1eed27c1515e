// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <functional>
#include <memory>

#include "motion_step.h"
#include "tool_steps.h"

/// Each request as a list of steps.
namespace ur_driver_bridge {

/// A step, and what is done if it fails: back to where nothing is touched, before the request ends with the failure.
struct Item {
  std::unique_ptr<Step> step;
  std::function<std::deque<Item>(const Verdict&)> undo;
};
using Items = std::deque<Item>;

Items moveItems(const JointTrajectory& trajectory);

/// Config, model and `touched`, which the touch fills in, must outlive the items. Throws std::invalid_argument for a pick
/// that makes no sense.
Items pickItems(const ExecutorConfig& config, const ArmModel& model, const PickRequest& request,
                TouchStep::Touched* touched);

/// `brick_mass_kg` 0: nobody looks whether it is gone.
Items letGoItems(const ArmModel& model, double brick_mass_kg, Duty duty);

/// A magnet that may be on is switched off, whatever hangs there.
Items letGoUnknownItems(const ArmModel& model);

Items recoverItems(const RecoveryConfig& config, const RecoveryPermit& permit);

/// Nothing is held any more, and everybody has to know, first of all.
Items lossItems(const ArmModel& model);

}  // namespace ur_driver_bridge
