// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "base_navigation/base_navigator.h"

namespace base_navigation {

/// The base's own stop: the scanner's ends by itself; the button and the stop input end a goal. One pressed between two
/// goals ends the next one, once.
class BaseStopInput {
 public:
  void take(const std::optional<BaseStop>& reported) {
    // Pressed at the first report: who starts the robot knows.
    if (isPressed(reported) && now_ && !isPressed(now_)) pressed_between_ = toString(*reported);
    now_ = reported;
  }
  bool isActive() const { return now_ && *now_ != BaseStop::kNone; }
  bool endsGoal() const { return isPressed(now_) || !pressed_between_.empty(); }
  void goalHasEnded() { pressed_between_.clear(); }
  std::string words() const {
    if (isPressed(now_) || pressed_between_.empty()) return std::string("the base is stopped: ") + toString(*now_);
    return "the base was stopped before this goal (" + pressed_between_ + "): check the base, and send the goal again";
  }

 private:
  static bool isPressed(const std::optional<BaseStop>& stop) {
    return stop == BaseStop::kButton || stop == BaseStop::kSignal;
  }

  std::optional<BaseStop> now_;
  std::string pressed_between_;  // what was pressed while there was no goal to end; empty: nothing
};

}  // namespace base_navigation
