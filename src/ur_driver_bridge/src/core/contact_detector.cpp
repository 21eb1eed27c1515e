// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/contact_detector.h"

#include <cmath>

namespace ur_driver_bridge {
ContactDetector::ContactDetector(const ContactDetectorConfig& config)
    : config_(interactive_mapping::requireValid("impossible contact detector:", config)) {}

const ContactDetector::Contact& ContactDetector::add(const Stamped<ToolForce>& sample) {
  if (!std::isfinite(sample.stamp_s) || (last_s_ && sample.stamp_s <= *last_s_)) return contact_;
  last_s_ = sample.stamp_s;
  if (contact_.kind != Kind::kNone) return contact_;
  const Eigen::Vector3d& force_N = sample.value.force_N;
  if (!force_N.allFinite()) {
    above_since_s_.reset();
    return contact_;
  }
  const double axial_N = std::abs(force_N.z());
  const double sideways_N = force_N.head<2>().norm();
  if (axial_N <= config_.threshold_N) {
    above_since_s_.reset();
  } else if (!above_since_s_) {
    above_since_s_ = sample.stamp_s;
  }
  if (sideways_N > config_.sideways_N) {
    contact_ = {Kind::kSideways, sideways_N, sample.stamp_s};
  } else if (above_since_s_ &&
             (axial_N > config_.hard_N || sample.stamp_s - *above_since_s_ >= config_.debounce_s - kRounding_s)) {
    contact_ = {Kind::kAxial, axial_N, *above_since_s_};
  }
  return contact_;
}

}  // namespace ur_driver_bridge
