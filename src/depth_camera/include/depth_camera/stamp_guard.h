// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

namespace depth_camera {

/// Checks the stamps of images that a driver publishes: each is later than the one before.
class StampGuard {
 public:
  enum class Verdict {
    kGood,
    kZero,        // the driver gives no stamp; tf would take it for "newest"
    kOutOfOrder,  // not after the last good one, by less than 1 s
    kRestarted,   // 1 s or more before it: time runs anew from here
  };

  /// `stamp_s` [s] of the next image.
  Verdict check(double stamp_s);

  /// What the last verdict other than kGood saw and what is allowed.
  const std::string& message() const { return message_; }

 private:
  std::optional<double> last_stamp_s_;
  std::string message_;
};

}  // namespace depth_camera
