// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/fault.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include <interactive_mapping_common/enums/enum_names.h>

#include <interactive_mapping_common/config/schema.h>

namespace simulated_world {
namespace {

constexpr interactive_mapping::Names<FaultKind> kNames = {
    {"protective_stop", FaultKind::kProtectiveStop},
    {"emergency_stop", FaultKind::kEmergencyStop},
    {"base_button", FaultKind::kBaseButton},
    {"base_scanner", FaultKind::kBaseScanner},
    {"driver_gone", FaultKind::kDriverGone},
    {"camera_gone", FaultKind::kCameraGone},
    {"magnet_weak", FaultKind::kMagnetWeak},
    {"wheel_slip", FaultKind::kWheelSlip},
    {"drop_brick", FaultKind::kDropBrick},
    {"move_brick", FaultKind::kMoveBrick},
    {"scanner_gone", FaultKind::kScannerGone},
    {"odometry_gone", FaultKind::kOdometryGone},
    {"localisation_gone", FaultKind::kLocalisationGone},
    {"localisation_jump", FaultKind::kLocalisationJump},
    {"obstacle", FaultKind::kObstacle},
    {"force_noise", FaultKind::kForceNoise},
    {"io_refused", FaultKind::kIoRefused},
};

constexpr double kMaxObject_m = 100.0;
constexpr double kLoudest_N = 100.0;
// What a client may be off by rounding, or by a ground that it has estimated.
constexpr double kOnGround_m = 0.01;
constexpr double kUpright_rad = 0.01;

// Several of a kind at a time, each with its own end.
bool canBeMany(FaultKind kind) {
  return kind == FaultKind::kObstacle;
}

bool canEnd(FaultKind kind) {
  return kind != FaultKind::kProtectiveStop && kind != FaultKind::kDropBrick && kind != FaultKind::kMoveBrick;
}

}  // namespace

std::string faultName(FaultKind kind) {
  return interactive_mapping::nameOf(kind, kNames);
}

std::optional<FaultKind> faultKind(const std::string& name) {
  for (const auto& [known, kind] : kNames) {
    if (name == known) {
      return kind;
    }
  }
  return std::nullopt;
}

std::string allFaultNames() {
  std::string names;
  for (const auto& [name, kind] : kNames) {
    names += (names.empty() ? "" : ", ") + std::string(name);
  }
  return names;
}

std::vector<std::string> Fault::validate() const {
  std::vector<std::string> problems;
  const auto report = [&problems](const char* key, double seen, const char* allowed) {
    std::ostringstream line;
    line << key << " = " << seen << ", must be " << allowed;
    problems.push_back(line.str());
  };
  if (!(std::abs(at_s) <= 1e9)) {
    report("at_s", at_s, "a time in [-1e9, 1e9] s");
  }
  if (!(duration_s >= 0.0 && duration_s <= 1e6)) {
    report("duration_s", duration_s, "in [0, 1e6] s; 0 = for good");
  } else if (duration_s > 0.0 && !canEnd(kind)) {
    report("duration_s", duration_s, ("0: " + faultName(kind) + " has no end of its own").c_str());
  }
  if (kind == FaultKind::kMagnetWeak || kind == FaultKind::kWheelSlip) {
    if (!(value >= 0.0 && value <= 1.0)) {
      report("value", value, "in [0, 1]");
    }
    if (kind == FaultKind::kWheelSlip && !(value2 >= 0.0 && value2 <= 1.0)) {
      report("value2", value2, "in [0, 1]");
    }
  }
  if (kind == FaultKind::kForceNoise && !(value >= 0.0 && value <= kLoudest_N)) {
    report("value", value, "in [0, 100] N");
  }
  if (kind == FaultKind::kLocalisationJump) {
    if (!(std::abs(value) <= kMaxObject_m)) {
      report("value", value, "in [-100, 100] m");
    }
    if (!(std::abs(value2) <= M_PI)) {
      report("value2", value2, "in [-pi, pi] rad");
    }
  }
  if (kind == FaultKind::kMoveBrick && brick_id < 0) {
    report("brick_id", brick_id, "the id of a brick, >= 0");
  }
  if (kind == FaultKind::kMoveBrick || kind == FaultKind::kObstacle) {
    const Eigen::Matrix3d R = T_map_object.linear();
    if (!T_map_object.matrix().allFinite() || !(R * R.transpose()).isIdentity(1e-3)) {
      problems.emplace_back("pose must be finite, its quaternion of length 1");
    } else if (kind == FaultKind::kObstacle) {
      if (!(T_map_object.translation().head<2>().cwiseAbs().maxCoeff() <= kMaxObject_m)) {
        report("pose.position (farther of x and y)", T_map_object.translation().head<2>().cwiseAbs().maxCoeff(),
               "within +-100 m");
      }
      if (!(std::abs(T_map_object.translation().z()) <= kOnGround_m)) {
        report("pose.position.z", T_map_object.translation().z(), "0 m: an obstacle stands on the ground");
      }
      if (!(R(2, 2) >= std::cos(kUpright_rad))) {
        problems.emplace_back("pose.orientation must leave z up: an obstacle stands upright");
      }
    }
  }
  return problems;
}

void FaultSchedule::insert(double at_s, const Change& change) {
  const auto place = std::upper_bound(entries_.begin(), entries_.end(), at_s,
                                      [](double time_s, const Entry& entry) { return time_s < entry.at_s; });
  entries_.insert(place, {at_s, change});
}

void FaultSchedule::add(const Fault& fault) {
  interactive_mapping::refuseIfAny("fault " + faultName(fault.kind) + ":", fault.validate());
  insert(fault.at_s, {fault, true, ++num_added_});
}

std::vector<FaultSchedule::Change> FaultSchedule::takeDue(double now_s) {
  std::vector<Change> due;
  while (!entries_.empty() && entries_.front().at_s <= now_s) {
    const Change change = entries_.front().change;
    entries_.erase(entries_.begin());
    if (change.is_beginning) {
      // The same kind again replaces the earlier one, whose end would otherwise cut this one short.
      entries_.erase(std::remove_if(entries_.begin(), entries_.end(),
                                    [&change](const Entry& entry) {
                                      return !entry.change.is_beginning && !canBeMany(change.fault.kind) &&
                                             entry.change.fault.kind == change.fault.kind;
                                    }),
                     entries_.end());
      if (change.fault.duration_s > 0.0) {
        // From when it takes effect, which is later than asked for if that was in the past.
        insert(std::max(now_s, change.fault.at_s) + change.fault.duration_s, {change.fault, false, change.number});
      }
    }
    due.push_back(change);
  }
  return due;
}

void FaultSchedule::clear() {
  entries_.erase(
      std::remove_if(entries_.begin(), entries_.end(), [](const Entry& entry) { return entry.change.is_beginning; }),
      entries_.end());
}

}  // namespace simulated_world
