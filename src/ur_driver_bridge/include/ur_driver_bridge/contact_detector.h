// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include <interactive_mapping_common/config/schema.h>

#include "ur_driver_bridge/arm_state.h"

namespace ur_driver_bridge {

struct ContactDetectorConfig {
  double threshold_N{8.0};
  double debounce_s{0.02};
  double sideways_N{40.0};
  double hard_N{60.0};

  static void fields(ContactDetectorConfig& c, interactive_mapping::Fields& f) {
    f("threshold_N", c.threshold_N, 0.5, 200.0, "N", "force along the tool's axis that is contact after debounce_s");
    f("debounce_s", c.debounce_s, 0.0, 1.0, "s", "time above threshold_N, in samples without a gap below it");
    f("sideways_N", c.sideways_N, 0.5, 500.0, "N",
      "force across the axis that is contact with something else, at once");
    f("hard_N", c.hard_N, c.threshold_N, 500.0, "N",
      "force along the axis that is contact at once; at least threshold_N");
  }
};

/// Decides from the tool's force whether the magnet has met something. The sensor has been zeroed at rest shortly before, in
/// the same orientation: what remains is noise, inertia and contact.
class ContactDetector {
 public:
  enum class Kind { kNone, kAxial, kSideways };
  struct Contact {
    Kind kind{Kind::kNone};
    double force_N{0.0};  // along the tool's axis (kAxial) or across (kSideways), magnitude, at the time it was known
    double since_s{0.0};  // stamp of the first sample above the threshold
  };

  /// Throws std::invalid_argument listing every impossible value.
  explicit ContactDetector(const ContactDetectorConfig& config);

  /// Samples in the order of time; one that is not newer than the last is ignored, one that is not finite resets the
  /// debounce. Missing samples do not: the force is taken to have stayed. Once there is contact, it stays.
  const Contact& add(const Stamped<ToolForce>& sample);
  const Contact& contact() const { return contact_; }

 private:
  ContactDetectorConfig config_;
  Contact contact_;
  std::optional<double> last_s_;
  std::optional<double> above_since_s_;
};

}  // namespace ur_driver_bridge
