// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

namespace pick_mission {

/// Finds steps of a clock that is set now and then (NTP, a person) beside one that never is.
class ClockSteps {
 public:
  /// By how much the clock was set forward (back: negative) since the call before [s]; the first time 0. Both clocks' rates
  /// may differ: to be called often enough that only steps show.
  double advance(double clock_s, double steady_s) {
    const double step_s = last_ ? (clock_s - last_->clock_s) - (steady_s - last_->steady_s) : 0.0;
    last_ = Times{clock_s, steady_s};
    return step_s;
  }

 private:
  struct Times {
    double clock_s;
    double steady_s;
  };
  std::optional<Times> last_;
};

}  // namespace pick_mission
