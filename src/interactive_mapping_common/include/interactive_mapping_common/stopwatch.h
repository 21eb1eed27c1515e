// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>

namespace interactive_mapping {

class Stopwatch {
 public:
  /// Milliseconds since the last call, or since the watch was made.
  double lapMs() {
    const auto now = std::chrono::steady_clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - last_).count();
    last_ = now;
    return ms;
  }

 private:
  std::chrono::steady_clock::time_point last_{std::chrono::steady_clock::now()};
};

}  // namespace interactive_mapping
