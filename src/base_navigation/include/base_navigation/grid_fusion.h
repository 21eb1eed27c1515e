// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base_navigation/navigation_grid.h"
#include "base_navigation/planar.h"

namespace base_navigation {

/// One turn of the safety scanner. A beam without an echo, shorter than the scanner's minimum or not finite (the
/// driver masks beams with 0) says nothing, except one beyond range_max_m: nothing stands there up to range_max_m.
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
  double scan_free_range_m{4.0};      // ground that the scanner has looked across is free so far from it; 0: never
  double scan_obstacle_range_m{8.0};  // echoes farther away are not entered
  double obstacle_memory_s{60.0};     // an echo that no later beam has passed through stands so long
  double max_range_m{15.0};           // the grid reaches so far from the robot
  double standing_padding_m{0.1};  // unknown ground so near to where the robot stands is free: it could not leave else

  std::vector<std::string> validate() const;
};

/// Free, occupied and unknown ground from four sources, in this order:
/// 1. where the robot stands is free; unknown ground within standing_padding_m of it, too;
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
  /// touches an occupied one, free if all that it touches are. Throws std::invalid_argument if the sizes do not agree.
  void setMap(std::shared_ptr<const NavigationGrid> map);

  /// Enters a scan taken at `T_map_base`. Cost: O(beams * range / cell).
  void addScan(const Scan& scan, const Pose2d& T_map_base, double stamp_s);

  /// The robot stands here: what it touches is known free from now on; of echoes, those in cells entirely under it go.
  void addFootprint(const Pose2d& T_map_base);

  /// Forgets scans and own tracks (not the map): what was entered with poses that were wrong.
  void forget();

  std::shared_ptr<const NavigationGrid> build(const Pose2d& T_map_base, double stamp_s) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace base_navigation
