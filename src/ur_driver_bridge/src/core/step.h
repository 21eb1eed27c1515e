// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <interactive_mapping_common/formatted.h>

#include "ur_driver_bridge/executor.h"

namespace ur_driver_bridge {

using interactive_mapping::formatted;

/// What the steps of a request see and share.
struct StepContext {
  const ExecutorConfig& config;
  const ArmModel& model;
  const SafetyGate& gate;
  LoadCell& load;
  PickFigures& figures;
  bool& is_holding;
  double& payload_kg;  // declared

  // Of this call.
  const ExecutorInputs& inputs;
  double now_s;   // ROS time: for stamps
  double time_s;  // never runs back: for how long something takes
  double dt_s;    // since the call before; 0: a reply in between
  const std::optional<Verdict>& stop_asked;
  std::vector<ArmCall>& calls;
  std::uint64_t& last_id;

  const ArmState& arm() const { return inputs.gate.arm; }

  template <typename What>
  std::uint64_t call(What what) {
    ArmCall& made = calls.emplace_back();
    made.id = ++last_id;
    made.what = std::move(what);
    return last_id;
  }
  /// Nothing: not yet.
  const CallReply* replyTo(std::uint64_t id) const {
    for (const CallReply& reply : inputs.replies) {
      if (reply.id == id) return &reply;
    }
    return nullptr;
  }
  /// As far as is known: joint states that are too old tell nothing.
  bool isAtRest() const {
    return arm().joints && now_s - arm().joints->stamp_s <= config.gate.max_joint_age_s &&
           arm().joints->value.velocity_rad_s.cwiseAbs().maxCoeff() < config.motion.rest_rad_s;
  }
};

/// A part of a request. Told to stop, it ends with what it was told as soon as it can.
class Step {
 public:
  explicit Step(std::string stage) : stage_(std::move(stage)) {}
  virtual ~Step() = default;
  Step(const Step&) = delete;
  Step& operator=(const Step&) = delete;

  /// Called again and again until it returns something.
  virtual std::optional<Verdict> advance(StepContext& context) = 0;
  virtual ExecutorPhase phase() const { return ExecutorPhase::kActing; }
  virtual double progress() const { return 0.0; }
  const std::string& stage() const { return stage_; }

 private:
  std::string stage_;
};

/// LOST_ON_THE_WAY when the weight of what is held is gone. Nothing: it is not, or no weight was known before.
std::optional<Verdict> lossOf(const StepContext& context);

}  // namespace ur_driver_bridge
