// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics/level.h"

#include <algorithm>

namespace system_diagnostics {

void Verdict::worsen(Level other, const std::string& what) {
  if (message.empty() || other > level) {
    message = what;
  } else if (other == level && other != Level::kOk) {
    message += "; " + what;
  }
  level = std::max(level, other);
}

}  // namespace system_diagnostics
