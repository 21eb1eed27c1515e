// SPDX-License-Identifier: BSD-3-Clause
#ifndef OCTOMAP_BASELINE_OCTOMAP_CONFIG_H
#define OCTOMAP_BASELINE_OCTOMAP_CONFIG_H

#include <string>
#include <vector>

#include <Eigen/Core>

#include "gpis_mapping/gpis_config.h"

namespace octomap_baseline {

/// How an occupied voxel that rays of one image pass through becomes free.
enum class ForgetPolicy {
  kOdds,         // each image lowers the log odds once, as in OctoMap; free when they fall below the threshold
  kSeenThrough,  // free at once when all pixels around it that see anything see past it; else as kOdds
};

/// All settings of the map, with the only copy of the defaults. SI units.
struct OctomapConfig {
  double resolution_m{0.02};

  gpis_mapping::GpisConfig::Sensor sensor;  // the same classes of pixels as gpis_mapping's

  struct Occupancy {  // OctoMap's sensor model; its own defaults are 0.7, 0.4, 0.1192, 0.971, 0.5
    double prob_hit{0.7};
    double prob_miss{0.3};
    double clamp_min{0.12};
    double clamp_max{0.97};
    double threshold{0.5};  // occupied from here on
  } occupancy;

  struct Dynamic {
    bool enabled{true};       // false: what was occupied once stays occupied
    bool virtual_wall{true};  // false: pixels with nothing in reach say nothing, as in octomap_server
    ForgetPolicy policy{ForgetPolicy::kSeenThrough};
    double tolerance_sigmas{3.0};   // a pixel sees past a voxel when it ends this far behind it
    double min_tolerance_m{0.012};  // least such distance, for errors of calibration and pose
    double least_share{0.5};        // of the pixels around the voxel that must see past it
  } dynamic;

  struct Region {  // voxels outside are neither inserted nor cleared, map frame
    Eigen::Vector3d min_m{-1e4, -1e4, -1e4};
    Eigen::Vector3d max_m{1e4, 1e4, 1e4};
  } region;

  int threads{0};  // 0: all cores

  /// Every problem as "key = value unit, must be in [lo, hi] unit"; empty when the configuration can be used.
  std::vector<std::string> validate() const;
};

/// Throws std::invalid_argument listing all problems of `config`.
void requireValid(const OctomapConfig& config);

/// Reads YAML: missing keys keep their default; unknown keys, wrong types and impossible values are refused with one
/// std::invalid_argument that lists them all (origin, key, value, allowed range).
OctomapConfig loadOctomapConfig(const std::string& yaml_path);
OctomapConfig parseOctomapConfig(const std::string& yaml_text, const std::string& origin);

/// Every key with its value. parseOctomapConfig(toYaml(c)) == c.
std::string toYaml(const OctomapConfig& config);

}  // namespace octomap_baseline

#endif  // OCTOMAP_BASELINE_OCTOMAP_CONFIG_H
