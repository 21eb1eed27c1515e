// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>

#include "depth_self_filter/robot_mask.h"

namespace depth_self_filter {

/// What the hand held when. An image shows the hand as it was at its stamp, not as it is when the image is worked on.
class HandHistory {
 public:
  struct Change {
    double since_s{0.0};
    std::optional<HeldBrick> brick;
    bool is_clear{true};  // false: something is held, and nobody can say where it is
  };

  /// Changes come in order; one with a stamp before the last one's replaces what it contradicts (a restart).
  void add(const Change& change) {
    while (!changes_.empty() && changes_.back().since_s >= change.since_s) changes_.pop_back();
    changes_.push_back(change);
    if (changes_.size() > kRemembered) changes_.pop_front();
  }

  /// Before the first change that is remembered: as after it. Who joins late hears what is held, and of what was before
  /// nobody tells.
  Change at(double stamp_s) const {
    if (changes_.empty()) return {};
    for (auto change = changes_.rbegin(); change != changes_.rend(); ++change) {
      if (change->since_s <= stamp_s) return *change;
    }
    return changes_.front();
  }

 private:
  static constexpr std::size_t kRemembered = 16;  // no arm picks so often while an image waits
  std::deque<Change> changes_;
};

}  // namespace depth_self_filter
