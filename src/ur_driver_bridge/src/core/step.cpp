// SPDX-License-Identifier: BSD-3-Clause
#include "step.h"

namespace ur_driver_bridge {

std::optional<Verdict> lossOf(const StepContext& context) {
  if (!context.load.isHolding()) return std::nullopt;
  const auto& gripper = context.arm().gripper;
  if (gripper && !gripper->value.is_holding.value_or(true)) {
    return Verdict{ArmStatus::kLostOnTheWay, "the gripper reports that it holds nothing"};
  }
  if (!context.load.isLost()) return std::nullopt;
  return Verdict{ArmStatus::kLostOnTheWay, formatted("the brick's weight is gone: %.2f kg beside the declared payload",
                                                     context.load.load().value_or(0.0))};
}

}  // namespace ur_driver_bridge
