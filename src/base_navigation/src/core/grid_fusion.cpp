// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/grid_fusion.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <stdexcept>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>

#include "polygon_raster.h"

namespace base_navigation {
namespace {

// Cells of two lattices that overlap by less do not touch: what a corner's coordinates round, in float at 100 m.
constexpr double kOverlap_m = 1e-5;

// Coordinates in the map frame beyond this are refused: cells there would not be told apart from one another for long.
constexpr double kMaxCoordinate_m = 1e5;

constexpr std::uint8_t kSeenFree = 1;
constexpr std::uint8_t kEcho = 2;

void requirePose(const Pose2d& pose) {
  interactive_mapping::RangeCheck check("T_map_base.");
  check("x", pose.x_m, -kMaxCoordinate_m, kMaxCoordinate_m, "m");
  check("y", pose.y_m, -kMaxCoordinate_m, kMaxCoordinate_m, "m");
  check("yaw", pose.yaw_rad, -kMaxCoordinate_m, kMaxCoordinate_m, "rad");
  interactive_mapping::refuseIfAny("impossible pose of the base:", check.problems());
}

void requireStamp(double stamp_s) {
  if (!std::isfinite(stamp_s)) throw std::invalid_argument("stamp is not finite");
}

bool holds(const Polygon& polygon, const Eigen::Vector2d& point) {
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d edge = polygon[(i + 1) % polygon.size()] - polygon[i];
    const Eigen::Vector2d to = point - polygon[i];
    if (edge.x() * to.y() - edge.y() * to.x() < 0.0) return false;
  }
  return true;
}

// Without rows and columns at the border in which nothing is known: outside a grid everything is unknown anyway. `low`:
// its lowest cell in the lattice; corners are made from whole numbers, so that all grids agree to the last digit.
std::shared_ptr<const NavigationGrid> trimmed(const NavigationGrid& grid, const Eigen::Vector2i& low) {
  int left = grid.width, right = -1, bottom = grid.height, top = -1;
  for (int row = 0; row < grid.height; ++row) {
    const auto begin = grid.state.begin() + static_cast<std::ptrdiff_t>(grid.index(0, row));
    const auto end = begin + grid.width;
    const auto is_known = [](SpaceState state) { return state != SpaceState::kUnknown; };
    const auto first = std::find_if(begin, end, is_known);
    if (first == end) continue;
    const auto last = std::find_if(std::make_reverse_iterator(end), std::make_reverse_iterator(first), is_known).base();
    left = std::min(left, static_cast<int>(first - begin));
    right = std::max(right, static_cast<int>(last - begin) - 1);
    bottom = std::min(bottom, row);
    top = row;
  }
  auto result = std::make_shared<NavigationGrid>();
  result->cell_size_m = grid.cell_size_m;
  result->origin_m = grid.cell_size_m * (low + Eigen::Vector2i(left, bottom)).cast<double>();
  result->width = right - left + 1;
  result->height = top - bottom + 1;
  result->state.reserve(static_cast<std::size_t>(result->width) * result->height);
  for (int row = bottom; row <= top; ++row) {
    const auto begin = grid.state.begin() + static_cast<std::ptrdiff_t>(grid.index(left, row));
    result->state.insert(result->state.end(), begin, begin + result->width);
  }
  return result;
}

// Which of two says more about a cell: occupied before unknown before free.
SpaceState worse(SpaceState a, SpaceState b) {
  if (a == SpaceState::kOccupied || b == SpaceState::kOccupied) return SpaceState::kOccupied;
  return a == SpaceState::kUnknown ? a : b;
}

}  // namespace

Eigen::Vector2d Scan::direction(std::size_t beam) const {
  const double angle_rad = min_angle_rad + static_cast<double>(beam) * increment_rad;
  const double bearing_rad = T_base_scanner.yaw_rad + (is_mirrored ? -angle_rad : angle_rad);
  return {std::cos(bearing_rad), std::sin(bearing_rad)};
}

bool Scan::isEcho(std::size_t beam) const {
  return ranges_m[beam] >= range_min_m && ranges_m[beam] <= range_max_m;  // false for NaN
}

bool Scan::isEmpty(std::size_t beam) const {
  return ranges_m[beam] > range_max_m;
}

Eigen::Vector2d Scan::echo(std::size_t beam) const {
  return T_base_scanner.position() + ranges_m[beam] * direction(beam);
}

// What the robot has seen and driven over: a square window of the lattice of the map frame about the robot. The lattice's
// corners are multiples of the cell size. The window is a torus: cell (x, y) of the lattice is kept in column x modulo
// size, row y modulo size, and moving it forgets only what leaves.
struct GridFusion::State {
  GridFusionConfig config;
  Polygon footprint;
  Polygon standing;  // larger by the padding
  std::shared_ptr<const NavigationGrid> map;

  int reach;               // the window's cells on each side of the middle one
  int size;                // 2 reach + 1
  Eigen::Vector2i middle;  // of the window, in the lattice
  bool is_placed{false};   // else there is no middle yet
  std::vector<std::uint8_t> flags;
  std::vector<double> echo_s;  // stamp of the last echo, where flags have kEcho

  Eigen::Vector2i cellOf(const Eigen::Vector2d& p_map) const {
    return {floorToInt(p_map.x() / config.cell_size_m), floorToInt(p_map.y() / config.cell_size_m)};
  }
  int wrap(int cell) const {
    const int rest = cell % size;
    return rest < 0 ? rest + size : rest;
  }
  bool isKept(const Eigen::Vector2i& cell) const {
    return is_placed && std::abs(cell.x() - middle.x()) <= reach && std::abs(cell.y() - middle.y()) <= reach;
  }
  std::size_t slot(const Eigen::Vector2i& cell) const {
    return static_cast<std::size_t>(wrap(cell.y())) * size + wrap(cell.x());
  }

  void clear() {
    std::fill(flags.begin(), flags.end(), static_cast<std::uint8_t>(0));
    is_placed = false;
  }

  void moveTo(const Eigen::Vector2i& to) {
    if (!is_placed || std::abs(to.x() - middle.x()) >= size || std::abs(to.y() - middle.y()) >= size) {
      clear();
      middle = to;
      is_placed = true;
      return;
    }
    // Column by column and row by row: the slots of what enters are those of what leaves.
    for (; middle.x() != to.x(); middle.x() += to.x() > middle.x() ? 1 : -1) {
      const int column = wrap(to.x() > middle.x() ? middle.x() - reach : middle.x() + reach);
      for (int row = 0; row < size; ++row) flags[static_cast<std::size_t>(row) * size + column] = 0;
    }
    for (; middle.y() != to.y(); middle.y() += to.y() > middle.y() ? 1 : -1) {
      const int row = wrap(to.y() > middle.y() ? middle.y() - reach : middle.y() + reach);
      std::fill_n(flags.begin() + static_cast<std::ptrdiff_t>(row) * size, size, static_cast<std::uint8_t>(0));
    }
  }
};

GridFusion::GridFusion(const GridFusionConfig& config, Polygon footprint) {
  interactive_mapping::requireValid("impossible grid:", config);
  state_ = std::make_unique<State>();
  state_->config = config;
  state_->standing = padPolygon(footprint, config.standing_padding_m);
  state_->footprint = std::move(footprint);
  state_->reach = static_cast<int>(std::ceil(config.max_range_m / config.cell_size_m));
  state_->size = 2 * state_->reach + 1;
  state_->flags.resize(static_cast<std::size_t>(state_->size) * state_->size);
  state_->echo_s.resize(state_->flags.size());
  state_->clear();
}

GridFusion::~GridFusion() = default;

void GridFusion::setMap(std::shared_ptr<const NavigationGrid> map) {
  if (map) requireValid(*map);
  state_->map = std::move(map);
}

// A beam is a ray, and a cell is judged by all rays that cross it, with the next one on either side: it is seen free if all
// of them go on for more than a cell behind it. So a wall's cell is never taken for free by the beams that pass along it
// at a grazing angle and end behind it: of the two beams between which a point of the wall lies, the nearer to the wall's
// foot ends before that point, and both are asked. The cell behind the last free one absorbs the noise of the ranges (of
// 10 mm in the simulation: five sigma).
void GridFusion::addScan(const Scan& scan, const Pose2d& T_map_base, double stamp_s) {
  requirePose(T_map_base);
  requireStamp(stamp_s);
  requirePose(scan.T_base_scanner);
  if (!std::isfinite(scan.min_angle_rad) || !std::isfinite(scan.increment_rad) || scan.increment_rad == 0.0) {
    throw std::invalid_argument("scan's angles must be finite and its increment not 0");
  }
  State& state = *state_;
  const GridFusionConfig& config = state.config;
  const double cell_m = config.cell_size_m;
  state.moveTo(state.cellOf(T_map_base.position()));

  const int num_beams = static_cast<int>(scan.ranges_m.size());
  std::vector<double> free_m(num_beams, 0.0);  // the beam has passed through what is nearer
  for (int beam = 0; beam < num_beams; ++beam) {
    if (scan.isEcho(beam)) free_m[beam] = scan.ranges_m[beam] - cell_m;
    if (scan.isEmpty(beam)) free_m[beam] = scan.range_max_m - cell_m;
  }

  const Pose2d T_map_scanner = compose(T_map_base, scan.T_base_scanner);
  const Eigen::Vector2d eye = T_map_scanner.position();
  // Beams by rising bearing in the map frame: beam k at first + k * increment, k counted from the other end if clockwise.
  const bool is_clockwise = scan.is_mirrored != (scan.increment_rad < 0.0);
  const double increment_rad = std::abs(scan.increment_rad);
  if (is_clockwise) std::reverse(free_m.begin(), free_m.end());
  const double first_angle_rad = scan.min_angle_rad + (is_clockwise ? (num_beams - 1) * scan.increment_rad : 0.0);
  const double first_rad = T_map_scanner.yaw_rad + (scan.is_mirrored ? -first_angle_rad : first_angle_rad);

  const double look_m = std::max(config.scan_free_range_m, config.scan_obstacle_range_m);
  const double half_diagonal_m = std::sqrt(0.5) * cell_m;
  const Eigen::Vector2i reach = Eigen::Vector2i::Constant(state.reach);
  const Eigen::Vector2i low = state.cellOf(eye - Eigen::Vector2d::Constant(look_m)).cwiseMax(state.middle - reach);
  const Eigen::Vector2i high = state.cellOf(eye + Eigen::Vector2d::Constant(look_m)).cwiseMin(state.middle + reach);
  for (int y = low.y(); y <= high.y(); ++y) {
    std::uint8_t* row = &state.flags[static_cast<std::size_t>(state.wrap(y)) * state.size];
    int slot = state.wrap(low.x());
    for (int x = low.x(); x <= high.x(); ++x, slot = slot + 1 == state.size ? 0 : slot + 1) {
      const Eigen::Vector2d off = cell_m * Eigen::Vector2d(x + 0.5, y + 0.5) - eye;
      const double far_m = (off.cwiseAbs() + Eigen::Vector2d::Constant(0.5 * cell_m)).norm();
      const bool is_near = far_m <= config.scan_free_range_m;
      // Beyond that range, and where nothing would change, a look tells nothing new.
      if (is_near ? row[slot] == kSeenFree : (row[slot] & kEcho) == 0) continue;
      const double distance_m = off.norm();
      if (distance_m <= half_diagonal_m) continue;  // the scanner itself is in there
      const double half_width = std::asin(half_diagonal_m / distance_m) / increment_rad;
      double bearing_rad = std::remainder(std::atan2(off.y(), off.x()) - first_rad, 2.0 * M_PI);
      if (bearing_rad < 0.0) bearing_rad += 2.0 * M_PI;
      const double beam = bearing_rad / increment_rad;
      if (!(beam - half_width >= 0.0 && beam + half_width <= num_beams - 1)) continue;
      const auto begin = free_m.begin() + floorToInt(beam - half_width);
      const auto end = free_m.begin() + floorToInt(std::ceil(beam + half_width)) + 1;
      if (std::all_of(begin, end, [far_m](double range_m) { return range_m >= far_m; })) {
        row[slot] = is_near ? kSeenFree : 0;
      }
    }
  }

  for (int beam = 0; beam < num_beams; ++beam) {
    if (!scan.isEcho(beam) || scan.ranges_m[beam] > config.scan_obstacle_range_m) continue;
    const Eigen::Vector2d echo_base = scan.echo(beam);
    const Eigen::Vector2i cell = state.cellOf(transform(T_map_base, echo_base));
    if (!state.isKept(cell) || holds(state.footprint, echo_base)) continue;  // in there it is the robot's own
    // What stands there now was not there when the ground was seen to be free. Once it is forgotten, nothing is known.
    state.flags[state.slot(cell)] = kEcho;
    state.echo_s[state.slot(cell)] = stamp_s;
  }
}

void GridFusion::addFootprint(const Pose2d& T_map_base) {
  requirePose(T_map_base);
  State& state = *state_;
  state.moveTo(state.cellOf(T_map_base.position()));
  const auto raster = [&](const Polygon& place) {
    return PolygonRaster(Eigen::Vector2d::Zero(), state.config.cell_size_m, place, T_map_base);
  };
  int first, last;
  const PolygonRaster under = raster(state.footprint);
  for (int y = under.firstRow(); y <= under.lastRow(); ++y) {
    under.covered(y, &first, &last);
    for (int x = first; x <= last; ++x) {
      if (state.isKept({x, y})) state.flags[state.slot({x, y})] = kSeenFree;
    }
  }
  // Beside it, and in cells at its edge, an echo stays.
  const PolygonRaster around = raster(state.standing);
  for (int y = around.firstRow(); y <= around.lastRow(); ++y) {
    around.touched(y, &first, &last);
    for (int x = first; x <= last; ++x) {
      if (!state.isKept({x, y})) continue;
      std::uint8_t& flags = state.flags[state.slot({x, y})];
      if (flags != kEcho) flags = kSeenFree;
    }
  }
}

void GridFusion::forget() {
  state_->clear();
}

std::shared_ptr<const NavigationGrid> GridFusion::build(const Pose2d& T_map_base, double stamp_s) const {
  requirePose(T_map_base);
  requireStamp(stamp_s);
  const State& state = *state_;
  const double cell_m = state.config.cell_size_m;
  const Eigen::Vector2i middle = state.cellOf(T_map_base.position());

  NavigationGrid grid;
  const Eigen::Vector2i low = middle - Eigen::Vector2i::Constant(state.reach);
  grid.cell_size_m = cell_m;
  grid.origin_m = cell_m * low.cast<double>();
  grid.width = state.size;
  grid.height = state.size;
  grid.state.assign(static_cast<std::size_t>(state.size) * state.size, SpaceState::kUnknown);

  // The map, conservatively: the worst of what a cell touches. Along x and y alike, a cell touches an interval of the
  // map's columns or rows.
  if (state.map && !state.map->state.empty()) {
    const NavigationGrid& map = *state.map;
    struct Interval {
      int first, last;
    };
    const auto touched = [&](double origin_m, int cell) {
      const double from = ((cell * cell_m - origin_m) + kOverlap_m) / map.cell_size_m;
      const double to = (((cell + 1) * cell_m - origin_m) - kOverlap_m) / map.cell_size_m;
      return Interval{static_cast<int>(std::floor(from)), static_cast<int>(std::floor(to))};
    };
    std::vector<Interval> columns(state.size);
    for (int x = 0; x < state.size; ++x) columns[x] = touched(map.origin_m.x(), low.x() + x);
    for (int y = 0; y < state.size; ++y) {
      const Interval rows = touched(map.origin_m.y(), low.y() + y);
      if (rows.last < 0 || rows.first >= map.height) continue;
      SpaceState* out = &grid.state[grid.index(0, y)];
      for (int x = 0; x < state.size; ++x) {
        if (columns[x].last < 0 || columns[x].first >= map.width) continue;
        SpaceState cell = SpaceState::kFree;
        for (int row = rows.first; row <= rows.last; ++row) {
          for (int column = columns[x].first; column <= columns[x].last; ++column) {
            cell = worse(cell, map.at(column, row));
          }
        }
        out[x] = cell;
      }
    }
  }

  // What the robot knows itself.
  if (state.is_placed) {
    const Eigen::Vector2i from = low.cwiseMax(state.middle - Eigen::Vector2i::Constant(state.reach));
    const Eigen::Vector2i to = (low + Eigen::Vector2i::Constant(state.size - 1))
                                   .cwiseMin(state.middle + Eigen::Vector2i::Constant(state.reach));
    for (int y = from.y(); y <= to.y(); ++y) {
      const std::size_t row = static_cast<std::size_t>(state.wrap(y)) * state.size;
      SpaceState* out = &grid.state[grid.index(from.x() - low.x(), y - low.y())];
      int slot = state.wrap(from.x());
      for (int x = from.x(); x <= to.x(); ++x, ++out, slot = slot + 1 == state.size ? 0 : slot + 1) {
        const std::uint8_t flags = state.flags[row + slot];
        if (flags == kSeenFree && *out == SpaceState::kUnknown) *out = SpaceState::kFree;
        if (flags == kEcho && stamp_s - state.echo_s[row + slot] <= state.config.obstacle_memory_s) {
          *out = SpaceState::kOccupied;
        }
      }
    }
  }

  const auto stand = [&grid, &T_map_base](const Polygon& place, bool is_occupied_freed) {
    const PolygonRaster raster(grid, place, T_map_base);
    for (int row = std::max(raster.firstRow(), 0); row <= std::min(raster.lastRow(), grid.height - 1); ++row) {
      int first, last;
      raster.touched(row, &first, &last);
      for (int column = std::max(first, 0); column <= std::min(last, grid.width - 1); ++column) {
        SpaceState& cell = grid.state[grid.index(column, row)];
        if (is_occupied_freed || cell == SpaceState::kUnknown) cell = SpaceState::kFree;
      }
    }
  };
  stand(state.footprint, true);
  stand(state.standing, false);
  return trimmed(grid, low);
}

}  // namespace base_navigation
