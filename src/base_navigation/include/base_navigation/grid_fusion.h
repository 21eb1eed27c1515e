// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include <interactive_mapping_common/config/schema.h>

#include "base_navigation/navigation_grid.h"
#include "base_navigation/planar.h"

namespace base_navigation {

/// One turn of the safety scanner. A beam longer than range_max_m, +Inf included, is clear up to range_max_m. A beam
/// shorter than range_min_m (the driver masks beams with 0) or NaN is no measurement.
struct Scan {
  Pose2d T_base_scanner;    // of a scanner that may hang upside down: see is_mirrored
  bool is_mirrored{false};  // its z axis points down: bearings run clockwise
  double min_angle_rad{0.0};
  double increment_rad{0.0};
  double range_min_m{0.0};
  double range_max_m{0.0};
  std::vector<float> ranges_m;

  /// Unit vector of a beam in base_link.
  Eigen::Vector2d direction(std::size_t beam) const;
  bool isEcho(std::size_t beam) const;
  bool isEmpty(std::size_t beam) const;  // seen to be free up to range_max_m
  /// Where the echo comes from, in base_link; isEcho(beam).
  Eigen::Vector2d echo(std::size_t beam) const;
};

struct GridFusionConfig {
  double cell_size_m{0.05};
  double scan_free_range_m{4.0};
  double scan_obstacle_range_m{8.0};
  double obstacle_memory_s{60.0};
  double max_range_m{15.0};
  double standing_padding_m{0.1};

  static void fields(GridFusionConfig& c, interactive_mapping::Fields& f) {
    f("cell_size_m", c.cell_size_m, 0.01, 0.5, "m", "edge of a cell of the grid");
    f("scan_free_range_m", c.scan_free_range_m, 0.0, 30.0, "m",
      "ground that a beam of the scanner crosses within this range is free; 0: beams free nothing");
    f("scan_obstacle_range_m", c.scan_obstacle_range_m, 0.0, 30.0, "m", "echoes farther away are ignored");
    f("obstacle_memory_s", c.obstacle_memory_s, 0.0, 1e6, "s",
      "how long an echo stays that no later beam passes through");
    f("max_range_m", c.max_range_m, 1.0, 50.0, "m", "reach of the grid from the robot");
    f("standing_padding_m", c.standing_padding_m, 0.0, 0.5, "m",
      "unknown ground this near to the present and past poses is free: else it could neither leave nor come back");
  }
};

/// Free, occupied and unknown ground from four sources, in this order:
/// 1. where the robot stands is free; unknown ground within standing_padding_m of where it stands or stood, too;
/// 2. the map (surface above the estimated ground) or the scanner sees something: occupied;
/// 3. the map or the scanner has seen free ground, or the robot has been there: free;
/// 4. unknown.
/// A later look of the scanner through a cell takes an earlier echo back, not what the map says: it looks in one height.
class GridFusion {
 public:
  /// Throws std::invalid_argument listing every impossible value, or what is wrong with the footprint.
  GridFusion(const GridFusionConfig& config, Polygon footprint);
  ~GridFusion();
  GridFusion(const GridFusion&) = delete;
  GridFusion& operator=(const GridFusion&) = delete;

  /// The newest map replaces the one before. Another lattice is taken over conservatively: a cell is occupied if it
  /// touches an occupied one, free if all that it touches are. Throws as requireValid.
  void setMap(std::shared_ptr<const NavigationGrid> map);

  /// Enters a scan taken at `T_map_base`. Cost: O(beams * range / cell).
  void addScan(const Scan& scan, const Pose2d& T_map_base, double stamp_s);

  /// The robot stands here: what it touches with its padding is known free from now on; of echoes, those in cells entirely
  /// under it go.
  void addFootprint(const Pose2d& T_map_base);

  /// Forgets scans and own tracks (not the map): what was entered with poses that were wrong.
  void forget();

  std::shared_ptr<const NavigationGrid> build(const Pose2d& T_map_base, double stamp_s) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace base_navigation
