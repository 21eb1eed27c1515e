// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace system_diagnostics {

/// As in diagnostic_msgs/DiagnosticStatus.
enum class Level { kOk = 0, kWarning = 1, kError = 2 };

struct Verdict {
  Level level{Level::kOk};
  std::string message;

  /// Keeps the worse one; of two equally bad ones both messages. What is all right has nothing to say beside a complaint.
  void worsen(Level other, const std::string& what);
};

}  // namespace system_diagnostics
