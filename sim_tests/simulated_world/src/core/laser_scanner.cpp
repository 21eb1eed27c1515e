// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/laser_scanner.h"

#include <cmath>
#include <limits>
#include <stdexcept>

#include "simulated_world/mujoco_model.h"
#include "synthetic_depth/seeded_random.h"

namespace simulated_world {

std::vector<std::string> LaserScannerConfig::validate() const {
  std::vector<std::string> problems;
  const auto require = [&problems](bool is_good, const char* key, double value, const char* unit, const char* allowed) {
    if (!is_good) {
      problems.push_back(std::string(key) + " = " + std::to_string(value) + unit + ", must be " + allowed);
    }
  };
  require(std::isfinite(angle_min_rad), "angle_min_rad", angle_min_rad, " rad", "finite");
  require(angle_max_rad >= angle_min_rad && angle_max_rad - angle_min_rad < 6.2832, "angle_max_rad", angle_max_rad,
          " rad", ">= angle_min_rad and less than a turn beyond it");
  require(angle_increment_rad >= 1e-4 && angle_increment_rad <= 1.0, "angle_increment_rad", angle_increment_rad, " rad",
          "in [1e-4, 1] rad");
  require(range_min_m >= 0.0 && std::isfinite(range_min_m), "range_min_m", range_min_m, " m", ">= 0 m");
  require(range_max_m > range_min_m && std::isfinite(range_max_m), "range_max_m", range_max_m, " m", "> range_min_m");
  require(range_noise_std_m >= 0.0 && range_noise_std_m <= 1.0, "range_noise_std_m", range_noise_std_m, " m",
          "in [0, 1] m");
  return problems;
}

int LaserScannerConfig::numRays() const {
  constexpr double kRounding = 1e-6;  // of an increment
  return 1 + static_cast<int>(std::floor((angle_max_rad - angle_min_rad) / angle_increment_rad + kRounding));
}

LaserScanner::LaserScanner(const mjModel& model, const std::string& site_name, const LaserScannerConfig& config)
    : model_(model), config_(config), site_id_(requireId(model, mjOBJ_SITE, site_name)) {
  const std::vector<std::string> problems = config.validate();
  if (!problems.empty()) {
    std::string message = "laser scanner \"" + site_name + "\":";
    for (const std::string& problem : problems) {
      message += "\n  " + problem;
    }
    throw std::invalid_argument(message);
  }
  for (std::size_t group = 0; group < geom_groups_.size(); ++group) {
    geom_groups_[group] = config.sees_geom_group[group] ? 1 : 0;
  }
}

bool LaserScanner::isOwn(int geom) const {
  const int own_body = model_.site_bodyid[site_id_];
  const int body = model_.geom_bodyid[geom];
  const int own_root = model_.body_weldid[own_body];
  // What stands still is welded to the world: a scanner on a wall must see the other walls.
  return own_root == 0 ? own_body != 0 && body == own_body : model_.body_weldid[body] == own_root;
}

double LaserScanner::castRay(const mjData& data, const mjtNum* origin, const mjtNum* direction) const {
  constexpr mjtNum kPastSurface_m = 1e-6;
  constexpr int kMaxOwnSurfaces = 100;  // a ray that is still inside its own housing sees nothing else
  mjtNum passed_m = 0.0;
  for (int i = 0; i < kMaxOwnSurfaces; ++i) {
    const mjtNum start[3] = {origin[0] + passed_m * direction[0], origin[1] + passed_m * direction[1],
                             origin[2] + passed_m * direction[2]};
    int geom = -1;
    const mjtNum range_m = mj_ray(&model_, &data, start, direction, geom_groups_.data(), 1, -1, &geom);
    if (geom < 0) {
      break;
    }
    if (!isOwn(geom)) {
      return passed_m + range_m;
    }
    passed_m += range_m + kPastSurface_m;
  }
  return std::numeric_limits<double>::infinity();
}

std::vector<float> LaserScanner::scan(const mjData& data, std::uint64_t scan_number) const {
  const mjtNum* const origin = data.site_xpos + 3 * site_id_;
  const mjtNum* const axes = data.site_xmat + 9 * site_id_;  // by rows
  synthetic_depth::SeededRandom random(config_.seed, scan_number, 0);
  std::vector<float> ranges_m(static_cast<std::size_t>(config_.numRays()));
  for (std::size_t ray = 0; ray < ranges_m.size(); ++ray) {
    const double angle_rad = config_.angle_min_rad + static_cast<double>(ray) * config_.angle_increment_rad;
    const double along_x = std::cos(angle_rad);
    const double along_y = std::sin(angle_rad);
    const mjtNum direction[3] = {axes[0] * along_x + axes[1] * along_y, axes[3] * along_x + axes[4] * along_y,
                                 axes[6] * along_x + axes[7] * along_y};
    double range_m = castRay(data, origin, direction);
    range_m += config_.range_noise_std_m > 0.0 ? config_.range_noise_std_m * random.normal() : 0.0;
    if (range_m < config_.range_min_m) {
      range_m = -std::numeric_limits<double>::infinity();
    } else if (range_m > config_.range_max_m) {
      range_m = std::numeric_limits<double>::infinity();
    }
    ranges_m[ray] = static_cast<float>(range_m);
  }
  return ranges_m;
}

}  // namespace simulated_world
