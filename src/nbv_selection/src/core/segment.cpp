// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/segment.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

namespace nbv_selection {
namespace {

constexpr int kMinSegments = 4;  // of an outline however short: a look from every side
// A chord is a direction if it is longer than this share of its stretch: an outline that comes back to itself has none.
constexpr double kMinChordShare = 0.01;

/// Lengths and angles on the ground are those of the plane itself, not of its shadow in x and y: in it, a point has two
/// coordinates. On level ground they are x and y.
class PlaneChart {
 public:
  explicit PlaneChart(const gpis_mapping::GroundPlane& ground) : ground_(ground) {
    const Eigen::Vector3d& normal = ground.normal_map;
    if (!(std::abs(normal.norm() - 1.0) < 1e-6 && normal.z() >= 0.5 && std::isfinite(ground.offset_m))) {
      throw std::invalid_argument(
          "the ground's normal must be a unit vector that points up, within 60 degrees, and its "
          "offset finite");
    }
    first_ = Eigen::Vector3d(normal.z(), 0.0, -normal.x()).normalized();
    second_ = normal.cross(first_);
    origin_ = ground.offset_m * normal;
  }

  Eigen::Vector2d fromAbove(const Eigen::Vector2d& p_map) const {
    const Eigen::Vector3d p(p_map.x(), p_map.y(), ground_.zAt(p_map.x(), p_map.y()));
    return {first_.dot(p - origin_), second_.dot(p - origin_)};
  }
  Eigen::Vector3d direction(const Eigen::Vector2d& v) const { return v.x() * first_ + v.y() * second_; }
  Eigen::Vector3d point(const Eigen::Vector2d& p) const { return origin_ + direction(p); }

 private:
  gpis_mapping::GroundPlane ground_;
  Eigen::Vector3d first_;
  Eigen::Vector3d second_;
  Eigen::Vector3d origin_;
};

/// A closed polygon by arc length, which goes round and round.
class ClosedPath {
 public:
  explicit ClosedPath(std::vector<Eigen::Vector2d> corners) : corners_(std::move(corners)) {
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      starts_m_.push_back(length_m_);
      length_m_ += (corners_[(i + 1) % corners_.size()] - corners_[i]).norm();
    }
  }

  double length() const { return length_m_; }

  Eigen::Vector2d at(double at_m) const {
    double rest_m = 0.0;
    const std::size_t i = edgeAt(at_m, &rest_m);
    return corners_[i] + rest_m * edgeDirection(i);
  }

  Eigen::Vector2d tangentAt(double at_m) const {
    double rest_m = 0.0;
    return edgeDirection(edgeAt(at_m, &rest_m));
  }

  /// Ends of the stretch and the corners on it.
  std::vector<Eigen::Vector2d> stretch(double begin_m, double end_m) const {
    std::vector<Eigen::Vector2d> points{at(begin_m)};
    const double rounds = std::floor(begin_m / length_m_);
    for (int round = 0; round < 2; ++round) {
      for (std::size_t i = 0; i < corners_.size(); ++i) {
        const double corner_m = starts_m_[i] + (rounds + round) * length_m_;
        if (corner_m > begin_m && corner_m < end_m) points.push_back(corners_[i]);
      }
    }
    points.push_back(at(end_m));
    return points;
  }

 private:
  std::size_t edgeAt(double at_m, double* rest_m) const {
    const double within_m = std::clamp(at_m - std::floor(at_m / length_m_) * length_m_, 0.0, length_m_);
    const auto next = std::upper_bound(starts_m_.begin(), starts_m_.end(), within_m);
    const std::size_t i = static_cast<std::size_t>(next - starts_m_.begin()) - 1;
    *rest_m = within_m - starts_m_[i];
    return i;
  }

  Eigen::Vector2d edgeDirection(std::size_t i) const {
    return (corners_[(i + 1) % corners_.size()] - corners_[i]).normalized();
  }

  std::vector<Eigen::Vector2d> corners_;
  std::vector<double> starts_m_;
  double length_m_{0.0};
};

/// Of the chord of the stretch; where its ends all but meet (the outline goes round a sliver, or into a slit), of the
/// chord of a shorter one, down to the edge in its middle.
Eigen::Vector2d chordDirection(const ClosedPath& path, double middle_m, double length_m) {
  for (double stretch_m = length_m; stretch_m > 1e-3 * length_m; stretch_m *= 0.5) {
    const Eigen::Vector2d chord = path.at(middle_m + 0.5 * stretch_m) - path.at(middle_m - 0.5 * stretch_m);
    if (chord.norm() > kMinChordShare * stretch_m) return chord.normalized();
  }
  return path.tangentAt(middle_m);
}

/// The highest of the pile's cells that the line from `begin` to `end` goes through; 0 if none does.
float highestAlong(const PileGrid& grid, const Eigen::Vector2d& begin, const Eigen::Vector2d& end) {
  if (grid.width <= 0 || grid.height <= 0) return 0.0F;
  // Between two crossings of the lattice the line is in one cell.
  std::vector<double> crossings{0.0, 1.0};
  const Eigen::Vector2d step = end - begin;
  for (int axis = 0; axis < 2; ++axis) {
    const double first = (begin(axis) - grid.origin_m(axis)) / grid.cell_size_m;
    const double last = (end(axis) - grid.origin_m(axis)) / grid.cell_size_m;
    for (double line = std::ceil(std::min(first, last)); line <= std::max(first, last); line += 1.0) {
      if (first != last) crossings.push_back(std::clamp((line - first) / (last - first), 0.0, 1.0));
    }
  }
  std::sort(crossings.begin(), crossings.end());
  float highest_m = 0.0F;
  for (std::size_t i = 0; i + 1 < crossings.size(); ++i) {
    if (crossings[i + 1] - crossings[i] < 1e-9) continue;  // a corner of cells, up to rounding
    const Eigen::Vector2i cell = grid.cellOf(begin + 0.5 * (crossings[i] + crossings[i + 1]) * step);
    if (!grid.contains(cell.x(), cell.y())) continue;
    const std::size_t index = grid.index(cell.x(), cell.y());
    if (grid.is_pile[index] != 0) highest_m = std::fmax(highest_m, grid.height_m[index]);  // NaN gives way
  }
  return highest_m;
}

ClosedPath toPath(const OutlinePolygon& polygon, const PlaneChart& chart, std::size_t number) {
  const std::string name = "outline " + std::to_string(number);
  if (polygon.size() < 3) {
    throw std::invalid_argument(name + " has " + std::to_string(polygon.size()) + " corners, must be at least 3");
  }
  std::vector<Eigen::Vector2d> corners;
  double area_m2 = 0.0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d a = polygon[i] - polygon.front();
    const Eigen::Vector2d b = polygon[(i + 1) % polygon.size()] - polygon.front();
    if (!a.allFinite()) throw std::invalid_argument("corner " + std::to_string(i) + " of " + name + " is not finite");
    if (a == b) {
      throw std::invalid_argument("corner " + std::to_string(i) + " of " + name + " is there twice in a row");
    }
    area_m2 += 0.5 * (a.x() * b.y() - a.y() * b.x());
    corners.push_back(chart.fromAbove(polygon[i]));
  }
  if (!(area_m2 > 0.0)) throw std::invalid_argument(name + " goes round clockwise, must go round counter-clockwise");
  return ClosedPath(std::move(corners));
}

}  // namespace

std::vector<Segment> cutSegments(const PileOutline& outline, const base_navigation::Polygon& footprint,
                                 const SegmentConfig& config) {
  interactive_mapping::requireValid("impossible segments:", config);
  double front_m = -std::numeric_limits<double>::infinity();
  double left_m = front_m;
  double right_m = -front_m;
  try {
    base_navigation::inscribedRadius(footprint);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(std::string("footprint: ") + error.what());
  }
  for (const Eigen::Vector2d& corner : footprint) {
    front_m = std::max(front_m, corner.x());
    left_m = std::max(left_m, corner.y());
    right_m = std::min(right_m, corner.y());
  }
  const double width_m = left_m - right_m;
  if (config.spacing_m > width_m) {
    throw std::invalid_argument("spacing_m = " + std::to_string(config.spacing_m) +
                                " m, must be at most the footprint's width of " + std::to_string(width_m) +
                                " m: neighbours overlap");
  }

  const PlaneChart chart(outline.ground);
  std::vector<Segment> segments;
  for (std::size_t number = 0; number < outline.polygons.size(); ++number) {
    const ClosedPath path = toPath(outline.polygons[number], chart, number);
    const int count = std::max({kMinSegments, static_cast<int>(std::lround(path.length() / config.spacing_m)),
                                static_cast<int>(std::ceil(path.length() / width_m))});
    // What is beyond half of the outline is the other side of the pile.
    const double length_m = std::min(width_m, 0.5 * path.length());
    const int num_samples = std::max(2, static_cast<int>(std::ceil(length_m / config.sample_spacing_m - 1e-9)));
    for (int k = 0; k < count; ++k) {
      Segment segment;
      segment.outline = static_cast<int>(number);
      segment.at_m = (k + 0.5) * path.length() / count;
      segment.length_m = length_m;
      const double begin_m = segment.at_m - 0.5 * length_m;
      const Eigen::Vector2d middle = path.at(segment.at_m);
      const Eigen::Vector2d direction = chordDirection(path, segment.at_m, length_m);
      const Eigen::Vector2d outward(direction.y(), -direction.x());
      double touch_m = 0.0;  // from the middle outwards to the line that touches the stretch
      for (const Eigen::Vector2d& p : path.stretch(begin_m, begin_m + length_m)) {
        touch_m = std::max(touch_m, outward.dot(p - middle));
      }
      const Eigen::Vector2d midpoint = middle + touch_m * outward;
      segment.midpoint_map = chart.point(midpoint);
      segment.direction_map = chart.direction(direction);
      segment.outward_map = chart.direction(outward);

      for (int j = 0; j < num_samples; ++j) {
        const double sample_m = begin_m + (j + 0.5) * length_m / num_samples;
        const Eigen::Vector2d sample = path.at(sample_m);
        const Eigen::Vector2d tangent = path.tangentAt(sample_m);
        // Square to the outline there and not to the segment: round a corner that would look past the pile.
        const Eigen::Vector2d inside = sample + config.profile_depth_m * Eigen::Vector2d(-tangent.y(), tangent.x());
        segment.samples_map.push_back(chart.point(sample));
        segment.profile_m.push_back(
            highestAlong(outline.grid, chart.point(sample).head<2>(), chart.point(inside).head<2>()));
      }

      const Eigen::Vector3d standing = chart.point(midpoint + (config.standoff_m + front_m) * outward);
      segment.standing_map = {standing.x(), standing.y(),
                              std::atan2(-segment.outward_map.y(), -segment.outward_map.x())};
      segments.push_back(std::move(segment));
    }
  }
  return segments;
}

std::pair<std::size_t, std::size_t> neighbours(const std::vector<Segment>& segments, std::size_t i) {
  if (i >= segments.size()) {
    throw std::invalid_argument("segment " + std::to_string(i) + " of " + std::to_string(segments.size()));
  }
  const int outline = segments[i].outline;
  std::size_t begin = i;
  while (begin > 0 && segments[begin - 1].outline == outline) --begin;
  std::size_t end = i + 1;
  while (end < segments.size() && segments[end].outline == outline) ++end;
  return {i > begin ? i - 1 : end - 1, i + 1 < end ? i + 1 : begin};
}

}  // namespace nbv_selection
