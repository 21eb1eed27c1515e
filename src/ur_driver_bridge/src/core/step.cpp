// SPDX-License-Identifier: BSD-3-Clause
#include "step.h"

#include <cstdarg>
#include <cstdio>

namespace ur_driver_bridge {

std::optional<Verdict> lossOf(const StepContext& context) {
  if (!context.load.isHolding() || !context.load.isLost()) return std::nullopt;
  return Verdict{ArmStatus::kLostOnTheWay, formatted("the brick's weight is gone: %.2f kg beside the declared payload",
                                                     context.load.load().value_or(0.0))};
}

std::string formatted(const char* format, ...) {
  char text[512];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  return text;
}

}  // namespace ur_driver_bridge
