// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics/tree_watch.h"

#include <stdexcept>

namespace system_diagnostics {

TreeWatch::TreeWatch(double window_s) : window_s_(window_s) {
  if (!(window_s > 0.0 && window_s <= 3600.0)) {
    throw std::invalid_argument("window_s = " + std::to_string(window_s) + " s, must be in (0, 3600] s");
  }
}

void TreeWatch::add(double now_s, const std::string& parent, const std::string& child, const std::string& publisher,
                    bool is_static) {
  frames_[child][{parent, publisher}] = Seen{now_s, is_static};
}

Verdict TreeWatch::report(double now_s) const {
  Verdict verdict;
  for (const auto& [child, sources] : frames_) {
    std::string names;
    int present = 0;
    bool is_any_moving = false;
    for (const auto& [source, seen] : sources) {
      if (!seen.is_static && seen.last_s < now_s - window_s_) continue;
      ++present;
      is_any_moving = is_any_moving || !seen.is_static;
      names += (names.empty() ? "" : ", ") + source.second + " (in " + source.first + ")";
    }
    if (present < 2) continue;
    verdict.worsen(is_any_moving ? Level::kError : Level::kWarning,
                   "frame " + child + " is published by " + std::to_string(present) + ": " + names);
  }
  verdict.worsen(Level::kOk, "every frame has one publisher");
  return verdict;
}

}  // namespace system_diagnostics
