// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "ur_driver_bridge/arm_state.h"

namespace ur_driver_bridge {

struct ContactDetectorConfig {
  double threshold_N{8.0};  // of the force along the tool's axis
  double debounce_s{0.02};  // above it so long, in samples without a gap below
  double sideways_N{40.0};  // of the force across: something else is met; at once
  double hard_N{60.0};      // of the force along: contact at once, without debounce

  std::vector<std::string> validate() const;
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

  void reset();
  /// Samples in the order of time; one that is not newer than the last is ignored, one that is not finite resets the
  /// debounce. Missing samples do not: the force is taken to have stayed. Once there is contact, it stays until reset().
  const Contact& add(const Stamped<ToolForce>& sample);
  const Contact& contact() const { return contact_; }

 private:
  ContactDetectorConfig config_;
  Contact contact_;
  std::optional<double> last_s_;
  std::optional<double> above_since_s_;
};

}  // namespace ur_driver_bridge
