// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/distance_field.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>

#include "polygon_raster.h"

namespace base_navigation {
namespace {

constexpr float kUnreached_m = std::numeric_limits<float>::infinity();

// Of a back-off from a pose where the disc touches something: at least so much clearance is gained per length driven. It
// leads away from the obstacle, within 60 degrees, and not along it.
constexpr double kLeaveGain = 0.5;

// From the middle of a cell to the square `cells` columns (or rows) away, along that axis [cells].
double gap(int cells) {
  return std::max(std::abs(cells) - 0.5, 0.0);
}

// Cells whose middle is farther than a radius from every square that is not free; the squares outside are not.
class Clearance {
 public:
  Clearance(const NavigationGrid& grid, double radius_m)
      : width_(grid.width), height_(grid.height), row_gap_(grid.state.size()) {
    constexpr int kFar = std::numeric_limits<std::uint16_t>::max();
    for (int row = 0; row < height_; ++row) {
      const SpaceState* state = &grid.state[grid.index(0, row)];
      std::uint16_t* nearest =
          &row_gap_[grid.index(0, row)];  // columns to the nearest cell of the row that is not free
      int columns = 0;                    // since the one left of the grid
      for (int column = 0; column < width_; ++column) {
        columns = state[column] == SpaceState::kFree ? columns + 1 : 0;
        nearest[column] = static_cast<std::uint16_t>(std::min(columns, kFar));
      }
      columns = 0;
      for (int column = width_ - 1; column >= 0; --column) {
        columns = state[column] == SpaceState::kFree ? columns + 1 : 0;
        nearest[column] = std::min(nearest[column], static_cast<std::uint16_t>(std::min(columns, kFar)));
      }
    }
    // (row offset, column offset) touches if gap(row)^2 + gap(column)^2 <= radius^2: per row the farthest column that does.
    radius_ = std::min((radius_m + kTouch_m) / grid.cell_size_m, kFar - 1.0);
    for (int offset = 0; gap(offset) <= radius_; ++offset) {
      reach_.push_back(static_cast<std::uint16_t>(std::sqrt(radius_ * radius_ - gap(offset) * gap(offset)) + 0.5));
    }
  }

  // 1 for each cell of the row that is clear.
  void clearCells(int row, std::uint8_t* is_clear) const {
    const int rows = static_cast<int>(reach_.size()) - 1;
    const bool is_inside = row - rows >= 0 && row + rows < height_;
    std::fill(is_clear, is_clear + width_, static_cast<std::uint8_t>(is_inside ? 1 : 0));
    if (!is_inside) return;
    for (int offset = -rows; offset <= rows; ++offset) {
      const std::uint16_t* nearest = &row_gap_[static_cast<std::size_t>(row + offset) * width_];
      const std::uint16_t reach = reach_[std::abs(offset)];
      for (int column = 0; column < width_; ++column) {
        is_clear[column] = static_cast<std::uint8_t>(is_clear[column] & (nearest[column] > reach ? 1 : 0));
      }
    }
  }

  // From the middle of a cell to the nearest square that is not free [cells], if within the radius; else more than that.
  double at(int column, int row) const {
    double nearest2 = std::numeric_limits<double>::infinity();
    for (int offset = -static_cast<int>(reach_.size()) + 1; offset < static_cast<int>(reach_.size()); ++offset) {
      const int other = row + offset;
      const double columns =
          other < 0 || other >= height_ ? 0.0 : gap(row_gap_[static_cast<std::size_t>(other) * width_ + column]);
      nearest2 = std::min(nearest2, columns * columns + gap(offset) * gap(offset));
    }
    return std::sqrt(nearest2);
  }

  double radius() const { return radius_; }

 private:
  int width_;
  int height_;
  std::vector<std::uint16_t> row_gap_;
  double radius_;  // [cells]
  std::vector<std::uint16_t> reach_;
};

/// Cells that the disc may pass, with a ring around them that it may not: no neighbour needs a look at the border.
struct PassedCells {
  PassedCells(const NavigationGrid& grid, const Eigen::Vector2i& start, double radius_m)
      : stride(grid.width + 2), is_passed(static_cast<std::size_t>(stride) * (grid.height + 2), 0) {
    const Clearance clearance(grid, radius_m);
    for (int row = 0; row < grid.height; ++row) clearance.clearCells(row, at(0, row));
    if (*at(start.x(), start.y()) != 0) return;
    const double at_start = clearance.at(start.x(), start.y());
    const int reach = static_cast<int>((clearance.radius() - at_start) / kLeaveGain) + 1;
    for (int row = std::max(start.y() - reach, 0); row <= std::min(start.y() + reach, grid.height - 1); ++row) {
      for (int column = std::max(start.x() - reach, 0); column <= std::min(start.x() + reach, grid.width - 1);
           ++column) {
        // What is not free has no clearance at all, so that only the start itself may be.
        const double away = std::hypot(column - start.x(), row - start.y());
        if (clearance.at(column, row) >= at_start + kLeaveGain * away - 1e-9) *at(column, row) = 1;
      }
    }
  }

  std::size_t index(int column, int row) const { return static_cast<std::size_t>(row + 1) * stride + column + 1; }
  std::uint8_t* at(int column, int row) { return &is_passed[index(column, row)]; }
  const std::uint8_t* at(int column, int row) const { return &is_passed[index(column, row)]; }

  int stride;
  std::vector<std::uint8_t> is_passed;
};

}  // namespace

DistanceField::DistanceField(const NavigationGrid& grid, const Eigen::Vector2d& from_map, double radius_m) {
  if (!(radius_m >= 0.0) || !std::isfinite(radius_m)) {
    throw std::invalid_argument("radius = " + std::to_string(radius_m) + " m, must be finite and at least 0");
  }
  if (!from_map.allFinite()) throw std::invalid_argument("place to start from is not finite");
  lattice_.cell_size_m = grid.cell_size_m;
  lattice_.origin_m = grid.origin_m;
  lattice_.width = grid.width;
  lattice_.height = grid.height;
  distance_m_.assign(grid.state.size(), kUnreached_m);
  from_.assign(grid.state.size(), -1);
  const Eigen::Vector2i start = grid.cellOf(from_map);
  if (!grid.contains(start.x(), start.y())) return;

  const PassedCells passed(grid, start, radius_m);
  const int stride = passed.stride;
  // Dijkstra. Steps have two lengths only, and cells are settled by rising distance: what they append to the queue of each
  // length rises too, and the smaller of the two heads is the smallest of all. That is the heap, in constant time.
  struct Entry {
    int cell;
    float distance;  // [cells]
  };
  struct Queue {
    std::vector<Entry> entries;
    std::size_t head{0};
    float next() const { return head < entries.size() ? entries[head].distance : kUnreached_m; }
  };
  Queue straight, diagonal;
  straight.entries.reserve(grid.state.size());
  diagonal.entries.reserve(grid.state.size());
  const float kDiagonal = std::sqrt(2.0F);
  const int first = static_cast<int>(grid.index(start.x(), start.y()));
  distance_m_[first] = 0.0F;
  straight.entries.push_back({first, 0.0F});
  while (true) {
    Queue& queue = straight.next() <= diagonal.next() ? straight : diagonal;
    if (queue.head == queue.entries.size()) break;
    const Entry entry = queue.entries[queue.head++];
    if (entry.distance > distance_m_[entry.cell]) continue;  // has been reached on a shorter way since
    const int row = entry.cell / grid.width;
    const std::uint8_t* here = passed.at(entry.cell - row * grid.width, row);
    const auto relax = [&](Queue& to, int cell, float distance) {
      if (distance >= distance_m_[cell]) return;
      distance_m_[cell] = distance;
      from_[cell] = entry.cell;
      to.entries.push_back({cell, distance});
    };
    const bool east = here[1] != 0, west = here[-1] != 0, north = here[stride] != 0, south = here[-stride] != 0;
    const float one = entry.distance + 1.0F;
    if (east) relax(straight, entry.cell + 1, one);
    if (west) relax(straight, entry.cell - 1, one);
    if (north) relax(straight, entry.cell + grid.width, one);
    if (south) relax(straight, entry.cell - grid.width, one);
    // Not cutting corners: then the disc touches nothing between the two cells either, for its path from one to the other
    // is covered by the discs of the four.
    const float across = entry.distance + kDiagonal;
    if (north && east && here[stride + 1] != 0) relax(diagonal, entry.cell + grid.width + 1, across);
    if (north && west && here[stride - 1] != 0) relax(diagonal, entry.cell + grid.width - 1, across);
    if (south && east && here[-stride + 1] != 0) relax(diagonal, entry.cell - grid.width + 1, across);
    if (south && west && here[-stride - 1] != 0) relax(diagonal, entry.cell - grid.width - 1, across);
  }
  for (float& distance : distance_m_) distance *= static_cast<float>(grid.cell_size_m);
}

double DistanceField::distance(const Eigen::Vector2d& p_map) const {
  const Eigen::Vector2i cell = lattice_.cellOf(p_map);
  return lattice_.contains(cell.x(), cell.y()) ? distance_m_[lattice_.index(cell.x(), cell.y())] : kUnreached_m;
}

std::vector<Eigen::Vector2d> DistanceField::pathTo(const Eigen::Vector2d& p_map) const {
  std::vector<Eigen::Vector2d> path;
  if (!std::isfinite(distance(p_map))) return path;
  const Eigen::Vector2i last = lattice_.cellOf(p_map);
  for (int cell = static_cast<int>(lattice_.index(last.x(), last.y())); cell >= 0; cell = from_[cell]) {
    path.push_back(lattice_.centerOf(cell % lattice_.width, cell / lattice_.width));
  }
  std::reverse(path.begin(), path.end());
  return path;
}

}  // namespace base_navigation
