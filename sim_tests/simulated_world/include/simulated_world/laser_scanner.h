// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include <mujoco/mujoco.h>

namespace simulated_world {

/// Ray k is at angle_min_rad + k angle_increment_rad about the site's z axis, from its x axis.
struct LaserScannerConfig {
  double angle_min_rad{-2.356};
  double angle_max_rad{2.356};  ///< of the last ray, at most
  double angle_increment_rad{0.00873};
  double range_min_m{0.05};
  double range_max_m{30.0};
  double range_noise_std_m{0.0};
  std::array<bool, mjNGROUP> sees_geom_group{true, true, false, true, false, false};  ///< 2 visual, 3 collision
  std::uint64_t seed{1};

  std::vector<std::string> validate() const;
  int numRays() const;
};

/// Planar scanner at a site of the model. It looks through the body that carries it, and through bodies fixed to that
/// one; what else belongs to the robot it sees.
class LaserScanner {
 public:
  /// The model must outlive the scanner. Throws std::invalid_argument for a bad config or an unknown site.
  LaserScanner(const mjModel& model, const std::string& site_name, const LaserScannerConfig& config);

  /// Range of every ray [m], REP-117: -Inf too close, +Inf nothing within range. Noise is fixed by the seed and the scan
  /// number. Kinematics of `data` must be up to date.
  std::vector<float> scan(const mjData& data, std::uint64_t scan_number) const;

  const LaserScannerConfig& config() const { return config_; }

 private:
  bool isOwn(int geom) const;
  double castRay(const mjData& data, const mjtNum* origin, const mjtNum* direction) const;

  const mjModel& model_;
  LaserScannerConfig config_;
  int site_id_;
  std::array<mjtByte, mjNGROUP> geom_groups_{};
};

}  // namespace simulated_world
