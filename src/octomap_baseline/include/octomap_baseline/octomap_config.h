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

inline constexpr interactive_mapping::Names<ForgetPolicy> kForgetPolicyNames = {
    {"odds", ForgetPolicy::kOdds}, {"seen_through", ForgetPolicy::kSeenThrough}};

/// All settings of the map. SI units.
struct OctomapConfig {
  double resolution_m{0.02};

  gpis_mapping::GpisConfig::Sensor sensor;  // the same classes of pixels as gpis_mapping's

  struct Occupancy {  // OctoMap's sensor model; its own defaults are 0.7, 0.4, 0.1192, 0.971, 0.5
    double prob_hit{0.7};
    double prob_miss{0.3};
    double clamp_min{0.12};
    double clamp_max{0.97};
    double threshold{0.5};

    static void fields(Occupancy& c, interactive_mapping::Fields& f) {
      f("prob_hit", c.prob_hit, 0.501, 0.999, "", "probability of occupancy that a hit stands for");
      f("prob_miss", c.prob_miss, 0.001, 0.499, "", "the same of a miss");
      f("clamp_min", c.clamp_min, 0.001, 0.499, "", "probabilities never fall below this ...");
      f("clamp_max", c.clamp_max, 0.501, 0.999, "", "... or rise above this");
      f("threshold", c.threshold, 0.01, 0.99, "", "occupied from here on");
      f.require(c.clamp_min < c.threshold && c.threshold < c.clamp_max,
                "threshold must be between occupancy/clamp_min and occupancy/clamp_max");
      f.require(c.prob_miss < c.threshold, "threshold must be above occupancy/prob_miss");
    }
  } occupancy;

  struct Dynamic {
    bool enabled{true};
    bool virtual_wall{true};
    ForgetPolicy policy{ForgetPolicy::kSeenThrough};
    double tolerance_sigmas{3.0};
    double min_tolerance_m{0.012};
    double least_share{0.5};

    static void fields(Dynamic& c, interactive_mapping::Fields& f) {
      f("enabled", c.enabled, "false: what was occupied once stays occupied");
      f("virtual_wall", c.virtual_wall, "false: pixels with nothing in reach say nothing, as in octomap_server");
      f("policy", c.policy, kForgetPolicyNames,
        "free when the log odds fall below the threshold; or at once when all pixels around see past it");
      f("tolerance_sigmas", c.tolerance_sigmas, 0.0, 10.0, "sigma",
        "a pixel sees past a voxel when it ends this many standard deviations behind it");
      f("min_tolerance_m", c.min_tolerance_m, 0.0, 0.2, "m", "least such distance, for errors of calibration and pose");
      f("least_share", c.least_share, 0.01, 1.0, "", "of the pixels around the voxel that must see past it");
    }
  } dynamic;

  struct Region {
    Eigen::Vector3d min_m{-1e4, -1e4, -1e4};
    Eigen::Vector3d max_m{1e4, 1e4, 1e4};

    static void fields(Region& c, interactive_mapping::Fields& f) {
      f("min_m", c.min_m, -1e9, 1e9, "m", "x, y, z in the map frame: voxels outside are neither inserted nor cleared");
      f("max_m", c.max_m, -1e9, 1e9, "m", "x, y, z");
      f.require((c.min_m.array() < c.max_m.array()).all(), "min_m must be below region/max_m on each axis");
    }
  } region;

  int threads{0};

  static void fields(OctomapConfig& c, interactive_mapping::Fields& f) {
    f("resolution_m", c.resolution_m, 0.002, 1.0, "m", "edge of a voxel");
    f.section(
        "sensor", c.sensor,
        "as in gpis_mapping. Here hole_policy auto is wall, but for shadows; pose_std_rad, stamp_std_s and fov_* are "
        "not used");
    f.section("occupancy", c.occupancy, "OctoMap's sensor model");
    f.section("dynamic", c.dynamic);
    f.section("region", c.region);
    f("threads", c.threads, 0, 256, "threads", "0: one per core");
  }

  /// Every problem as "key = value unit, must be in [lo, hi] unit"; empty when the configuration can be used.
  std::vector<std::string> validate() const;
};

/// Throws std::invalid_argument listing all problems of `config`.
void requireValid(const OctomapConfig& config);

/// Reads YAML. Missing keys keep their default. Unknown keys, wrong types and impossible values are rejected with one
/// std::invalid_argument that lists them all (origin, key, value, allowed range).
OctomapConfig parseOctomapConfig(const std::string& yaml_text, const std::string& origin);

/// Every key with its value. parseOctomapConfig(toYaml(c)) == c.
std::string toYaml(const OctomapConfig& config);

}  // namespace octomap_baseline

#endif  // OCTOMAP_BASELINE_OCTOMAP_CONFIG_H
