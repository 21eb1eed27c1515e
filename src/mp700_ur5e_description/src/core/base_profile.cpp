// SPDX-License-Identifier: BSD-3-Clause
#include "mp700_ur5e_description/base_profile.h"

#include <utility>

#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/files/yaml_map.h>

namespace mp700_ur5e_description {
namespace {

using interactive_mapping::Interval;
using interactive_mapping::readYaml;
using interactive_mapping::toText;
using interactive_mapping::YamlMap;

// Anything beyond is a slip of units: a room's size, a fast vehicle's speed, a lorry's mass.
const Interval kLength{0.0, 10.0, "m", true};
const Interval kPosition{-10.0, 10.0, "m"};
const Interval kSpeed{0.0, 10.0, "m/s", true};
const Interval kAcceleration{0.0, 20.0, "m/s^2", true};
const Interval kMass{0.0, 10000.0, "kg", true};
const Interval kTurnRate{0.0, 10.0, "rad/s", true};
const Interval kTurnAcceleration{0.0, 50.0, "rad/s^2", true};
const Interval kScanAngle{-3.1416, 3.1416, "rad"};
const Interval kIncrement{1e-4, 0.2, "rad"};
const Interval kRange{0.0, 200.0, "m", true};
const Interval kRate{0.0, 1000.0, "Hz", true};

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

}  // namespace

std::vector<std::string> BaseProfile::validate() const {
  std::vector<std::string> problems;
  if (scanner.min_angle_rad >= scanner.max_angle_rad) {
    problems.push_back("scanner/min_angle_rad = " + toText(scanner.min_angle_rad) +
                       " rad, must be below max_angle_rad = " + toText(scanner.max_angle_rad) + " rad");
  }
  if (scanner.range_min_m >= scanner.range_max_m) {
    problems.push_back("scanner/range_min_m = " + toText(scanner.range_min_m) +
                       " m, must be below range_max_m = " + toText(scanner.range_max_m) + " m");
  }
  for (const double speed : {limits.forward_m_per_s, limits.backward_m_per_s}) {
    if (speed > rating.linear_m_per_s) {
      problems.push_back("limits: " + toText(speed) +
                         " m/s, must be at most rating/linear_m_per_s = " + toText(rating.linear_m_per_s) + " m/s");
    }
  }
  const std::pair<const char*, double> accelerations[] = {{"linear_m_per_s2", limits.linear_m_per_s2},
                                                          {"stop_m_per_s2", limits.stop_m_per_s2}};
  for (const auto& [key, value] : accelerations) {
    if (value > rating.linear_m_per_s2) {
      problems.push_back(std::string("limits/") + key + " = " + toText(value) +
                         " m/s^2, must be at most rating/linear_m_per_s2 = " + toText(rating.linear_m_per_s2) +
                         " m/s^2");
    }
  }
  if (limits.stop_m_per_s2 < limits.linear_m_per_s2) {
    problems.push_back("limits/stop_m_per_s2 = " + toText(limits.stop_m_per_s2) +
                       " m/s^2, must be at least limits/linear_m_per_s2 = " + toText(limits.linear_m_per_s2) +
                       " m/s^2");
  }
  // Left turns only, and a single time round: every corner lies left of every edge.
  const std::vector<Eigen::Vector2d>& corners = body.footprint_m;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Eigen::Vector2d& from = corners[i];
    const Eigen::Vector2d& to = corners[(i + 1) % corners.size()];
    for (std::size_t k = 0; k < corners.size(); ++k) {
      if (k != i && k != (i + 1) % corners.size() && !(cross(to - from, corners[k] - from) > 0.0)) {
        problems.push_back("body/footprint_m: corner " + std::to_string(k) + " does not lie left of edge " +
                           std::to_string(i) + ", must be convex and counter-clockwise");
        return problems;
      }
    }
  }
  return problems;
}

BaseProfile parseBaseProfile(const std::string& text, const std::string& name) {
  BaseProfile profile;
  readYaml(text, name, [&](YamlMap& root, std::vector<std::string>& problems) {
    YamlMap drive = root.map("drive");
    const std::string kind = drive.word("kind");
    if (!kind.empty() && kind != "differential") {
      drive.note("kind", kind,
                 "differential: nothing here drives a base sideways; use its own navigation as move_base");
    }
    profile.drive.wheel_radius_m = drive.number("wheel_radius_m", kLength);
    profile.drive.track_m = drive.number("track_m", kLength);
    profile.drive.encoder_ticks_per_wheel_turn = drive.integer("encoder_ticks_per_wheel_turn", {1, 1e9, ""});
    drive.finish();
    YamlMap limits = root.map("limits");
    profile.limits.forward_m_per_s = limits.number("forward_m_per_s", kSpeed);
    profile.limits.backward_m_per_s = limits.number("backward_m_per_s", kSpeed);
    profile.limits.turn_rad_per_s = limits.number("turn_rad_per_s", kTurnRate);
    profile.limits.linear_m_per_s2 = limits.number("linear_m_per_s2", kAcceleration);
    profile.limits.turn_rad_per_s2 = limits.number("turn_rad_per_s2", kTurnAcceleration);
    profile.limits.stop_m_per_s2 = limits.number("stop_m_per_s2", kAcceleration);
    limits.finish();
    YamlMap rating = root.map("rating");
    profile.rating.linear_m_per_s = rating.number("linear_m_per_s", kSpeed);
    profile.rating.linear_m_per_s2 = rating.number("linear_m_per_s2", kAcceleration);
    rating.finish();
    YamlMap body = root.map("body");
    profile.body.mass_kg = body.number("mass_kg", kMass);
    profile.body.footprint_m = body.pairs("footprint_m", 3, kPosition);
    body.finish();
    YamlMap scanner = root.map("scanner");
    profile.scanner.frame = scanner.word("frame");
    profile.scanner.min_angle_rad = scanner.number("min_angle_rad", kScanAngle);
    profile.scanner.max_angle_rad = scanner.number("max_angle_rad", kScanAngle);
    profile.scanner.increment_rad = scanner.number("increment_rad", kIncrement);
    profile.scanner.range_min_m = scanner.number("range_min_m", kRange);
    profile.scanner.range_max_m = scanner.number("range_max_m", kRange);
    profile.scanner.rate_hz = scanner.number("rate_hz", kRate);
    scanner.finish();
    root.finish();
    if (problems.empty()) problems = profile.validate();
  });
  return profile;
}

BaseProfile loadBaseProfile(const std::string& path) {
  return parseBaseProfile(interactive_mapping::readTextFile(path), path);
}

}  // namespace mp700_ur5e_description
