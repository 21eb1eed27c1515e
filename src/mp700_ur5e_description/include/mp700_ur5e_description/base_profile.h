// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

namespace mp700_ur5e_description {

/// The mobile base in numbers, read from config/base_profile.yaml, which says where they come from. Hardware has no
/// defaults: the file gives every key. Frame: base_link.
struct BaseProfile {
  struct Drive {
    double wheel_radius_m{0.0};
    double track_m{0.0};  ///< between the middles of the driven wheels
    int encoder_ticks_per_wheel_turn{0};
  };
  struct Limits {
    double forward_m_per_s{0.0};
    double backward_m_per_s{0.0};  ///< positive
    double turn_rad_per_s{0.0};
    double linear_m_per_s2{0.0};
    double turn_rad_per_s2{0.0};
    double stop_m_per_s2{0.0};  ///< of a stop that somebody asks for
  };
  struct Rating {
    double linear_m_per_s{0.0};
    double linear_m_per_s2{0.0};
  };
  struct Body {
    double mass_kg{0.0};                       ///< wheels included, without arm and load
    std::vector<Eigen::Vector2d> footprint_m;  ///< convex, counter-clockwise
  };
  struct Scanner {
    std::string frame;
    double min_angle_rad{0.0};  ///< about the frame's z, 0 along its x
    double max_angle_rad{0.0};
    double increment_rad{0.0};
    double range_min_m{0.0};
    double range_max_m{0.0};
    double rate_hz{0.0};
  };

  Drive drive;
  Limits limits;
  Rating rating;
  Body body;
  Scanner scanner;

  /// What concerns several numbers at once; each line says key, value and rule. Empty: fine.
  std::vector<std::string> validate() const;
};

/// Throws std::invalid_argument listing everything wrong with the file, a line each.
BaseProfile loadBaseProfile(const std::string& path);
BaseProfile parseBaseProfile(const std::string& text, const std::string& name);

}  // namespace mp700_ur5e_description
