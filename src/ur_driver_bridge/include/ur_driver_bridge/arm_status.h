// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <interactive_mapping_enums/arm_outcome.h>

namespace ur_driver_bridge {

using interactive_mapping::ArmStatus;
using interactive_mapping::kNumArmStatus;

/// A status with its sentence; the sentence is empty on success.
struct Verdict {
  ArmStatus status{ArmStatus::kSuccess};
  std::string message;

  bool isFine() const { return status == ArmStatus::kSuccess; }
};

}  // namespace ur_driver_bridge
