// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/gpis_config.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace gpis_mapping {

void GpisConfig::fields(GpisConfig& c, Fields& f) {
  f.section("sensor", c.sensor);
  f.section("frame_map", c.frame_map, "Gaussian processes over one depth image");
  f.section("surface", c.surface, "training points and their field");
  f.section("cells", c.cells);
  f.section("dynamic", c.dynamic, "removed objects leave the map");
  f.section("retraining", c.retraining,
            "a cell is trained at once when a point came or went, else when enough have changed");
  f.section("observed", c.observed);
  f.section("mesh", c.mesh);
  f.section("query", c.query);
  f.section("region", c.region);
  f("threads", c.threads, 0, 256, "threads", "that work on an update; 0: one per core");
  f.require(c.frame_map.wall_range_m > 2.0 * c.sensor.max_range_m,
            "frame_map/wall_range_m must be more than twice sensor/max_range_m");
  f.require(
      c.influenceMargin() <= c.cells.size_m,
      "cells/size_m must be at least cells/blend_margin_m + surface/blend_radius_m and cells/training_margin_m: a "
      "point reaches the neighbouring cells only");
}

double GpisConfig::signalStd() const {
  return surface.signal_std_m > 0.0 ? surface.signal_std_m : surface.length_scale_m / std::sqrt(3.0);
}

double GpisConfig::influenceMargin() const {
  return std::max(cells.training_margin_m, cells.blend_margin_m + surface.blend_radius_m);
}

std::vector<std::string> GpisConfig::validate() const {
  return interactive_mapping::problemsOf(*this);
}

void requireValid(const GpisConfig& config) {
  interactive_mapping::requireValid("impossible map configuration:", config);
}

GpisConfig parseGpisConfig(const std::string& yaml_text, const std::string& origin) {
  return interactive_mapping::parse<GpisConfig>(yaml_text, origin);
}

GpisConfig loadGpisConfig(const std::string& yaml_path) {
  return parseGpisConfig(interactive_mapping::readTextFile(yaml_path), yaml_path);
}

std::string toYaml(const GpisConfig& config) {
  return interactive_mapping::toYaml(config);
}

}  // namespace gpis_mapping
