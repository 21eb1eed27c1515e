// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "system_diagnostics/level.h"

namespace system_diagnostics {

/// Each frame has one parent and each edge one publisher. With two, the tree flips between them from message to
/// message, and only the wrong poses show it.
class TreeWatch {
 public:
  /// `window_s`: a publisher that has been silent for so long is gone. Throws std::invalid_argument unless in (0, 3600].
  explicit TreeWatch(double window_s);

  /// An edge in a message of node `publisher`. Static ones are sent once, so they never count as gone.
  void add(double now_s, const std::string& parent, const std::string& child, const std::string& publisher,
           bool is_static);

  /// Names each frame that has two parents or publishers, with them. Two of which all are static: a warning, for it may be
  /// a node that was replaced.
  Verdict report(double now_s) const;

  int edges() const { return static_cast<int>(frames_.size()); }
  void clear() { frames_.clear(); }

 private:
  struct Seen {
    double last_s;
    bool is_static;
  };
  double window_s_;
  std::map<std::string, std::map<std::pair<std::string, std::string>, Seen>> frames_;  // child: (parent, publisher)
};

}  // namespace system_diagnostics
