// SPDX-License-Identifier: BSD-3-Clause
// Why not a library: neither toppra nor ruckig is packaged for Debian 12. Either could replace timeParametrize().
#include "motion_planning/joint_trajectory.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>

#include "motion_planning/cubic_segment.h"

namespace motion_planning {
namespace {

constexpr double kSamePoint_rad = 1e-6;     // waypoints nearer than this are one
constexpr double kSameDirection = 1e-9;     // difference of unit tangents that is no corner
constexpr double kLimitShare = 0.999;       // planned with this share of the limits: room for rounding
constexpr double kPointSpeedShare = 0.995;  // the same for the speed of a point, which is held at the cells' borders
constexpr double kLimitTolerance = 1e-9;    // relative; of the test at the end
constexpr int kCellsPerBlend = 16;
constexpr double kMaxCell_rad = 0.05;               // on straight parts, where cells are exact
constexpr double kMaxCellAtPointSpeed_rad = 0.005;  // where the Jacobian changes along the way
constexpr double kCellGrowth = 1.15;                // from the ends of a straight part to its middle
constexpr int kMaxRounds = 40;                      // of slowing down where interpolation exceeds a limit

/// Place on the path and its derivatives by the path parameter s. s is the length in joint space on straight parts.
struct PathPoint {
  ArmVector position;
  ArmVector tangent;    // dq/ds
  ArmVector curvature;  // d2q/ds2
};

/// A straight part, or a corner's blend. In a blend the tangent turns from `from` to `to` by the smooth step
/// S(x) = 3 x^2 - 2 x^3: dq/ds = from + (to - from) S(x), so that the second derivative is continuous and zero at both
/// ends. By S(x) + S(1 - x) = 1 a blend that begins at distance d before the corner ends at distance d behind it.
struct Piece {
  ArmVector origin;
  ArmVector from;
  ArmVector to;
  double length;
  bool is_blend;

  PathPoint at(double s) const {
    if (!is_blend) return {origin + s * from, from, ArmVector::Zero()};
    const double x = s / length;
    const ArmVector turn = to - from;
    return {origin + length * (x * from + x * x * x * (1.0 - 0.5 * x) * turn), from + x * x * (3.0 - 2.0 * x) * turn,
            6.0 * x * (1.0 - x) / length * turn};
  }
};

// A blend of half length d leaves the corner by 2 d (to - from) int_0^0.5 S dx = 0.1875 d (to - from), its largest
// deviation from the straight path.
constexpr double kDeviationPerHalfLength = 0.1875;

void requireFinite(const JointPath& path) {
  if (path.empty()) throw std::invalid_argument("path has 0 points, must have at least 1");
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (!path[i].allFinite()) {
      throw std::invalid_argument("path[" + std::to_string(i) + "] has an angle that is not finite");
    }
  }
}

double maxNorm(const ArmVector& v) {
  return v.lpNorm<Eigen::Infinity>();
}

/// Neighbours at least kSamePoint_rad apart; first and last as given.
JointPath withoutRepetitions(const JointPath& path) {
  JointPath kept = {path.front()};
  for (const ArmVector& q : path) {
    if (maxNorm(q - kept.back()) >= kSamePoint_rad) kept.push_back(q);
  }
  if (kept.size() == 1) return kept;
  kept.back() = path.back();  // which may have been left out, and may now be too near to the one before
  while (kept.size() > 1 && maxNorm(kept.back() - kept[kept.size() - 2]) < kSamePoint_rad) {
    kept.erase(kept.end() - (kept.size() == 2 ? 1 : 2));
  }
  return kept;
}

/// `path`: at least two points, without repetitions.
std::vector<Piece> roundCorners(const JointPath& path, double max_deviation_rad) {
  const std::size_t n = path.size();
  std::vector<ArmVector> direction(n - 1);
  std::vector<double> length(n - 1);
  for (std::size_t i = 0; i + 1 < n; ++i) {
    length[i] = (path[i + 1] - path[i]).norm();
    direction[i] = (path[i + 1] - path[i]) / length[i];
  }
  std::vector<double> half_blend(n, 0.0);
  for (std::size_t i = 1; i + 1 < n; ++i) {
    const double turn = maxNorm(direction[i] - direction[i - 1]);
    if (turn < kSameDirection) continue;
    half_blend[i] =
        std::min({0.5 * length[i - 1], 0.5 * length[i], max_deviation_rad / (kDeviationPerHalfLength * turn)});
  }
  std::vector<Piece> pieces;
  pieces.reserve(2 * n);
  for (std::size_t i = 0; i + 1 < n; ++i) {
    const double straight = length[i] - half_blend[i] - half_blend[i + 1];
    // Shorter is what rounding leaves between two blends that meet in the middle.
    if (straight > 1e-12) {
      pieces.push_back({path[i] + half_blend[i] * direction[i], direction[i], direction[i], straight, false});
    }
    if (half_blend[i + 1] > 0.0) {
      pieces.push_back({path[i + 1] - half_blend[i + 1] * direction[i], direction[i], direction[i + 1],
                        2.0 * half_blend[i + 1], true});
    }
  }
  return pieces;
}

/// Part of the path along which the path acceleration d2s/dt2 is constant.
struct Cell {
  std::size_t piece;
  double begin;  // from the start of the piece
  double length;
  double velocity_share{kLimitShare};  // of the limits, lowered where interpolation exceeds them
  double acceleration_share{kLimitShare};
};

double maxPathRate(const ArmVector& limit, const ArmVector& tangent) {
  double rate = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 6; ++i) {
    if (tangent[i] != 0.0) rate = std::min(rate, limit[i] / std::abs(tangent[i]));
  }
  return rate;
}

/// Speed of the limited point where ds/dt = 1 [m/s].
double pointRate(const PointSpeedLimit& limit, const PathPoint& point) {
  return (limit.position_jacobian(point.position) * point.tangent).norm();
}

void cutPiece(std::size_t index, const Piece& piece, const MotionLimits& limits,
              const std::optional<PointSpeedLimit>& speed_limit, std::vector<Cell>* cells) {
  if (piece.is_blend) {
    for (int i = 0; i < kCellsPerBlend; ++i) {
      cells->push_back({index, piece.length * i / kCellsPerBlend, piece.length / kCellsPerBlend});
    }
    return;
  }
  // Cells grow from both ends to the middle: the motion speeds up from one end and slows down to the other, and the cell
  // in which it reaches full speed is what costs time.
  double speed = maxPathRate(limits.velocity_rad_s, piece.from);
  double max_cell = kMaxCell_rad;
  if (speed_limit) {
    max_cell = kMaxCellAtPointSpeed_rad;
    for (const double share : {0.0, 0.5, 1.0}) {
      speed = std::min(speed, speed_limit->speed_m_s / pointRate(*speed_limit, piece.at(share * piece.length)));
    }
  }
  const double acceleration = maxPathRate(limits.acceleration_rad_s2, piece.from);
  const double half = 0.5 * piece.length;
  std::vector<double> ends;
  double size = std::min({0.5 * half, speed * speed / (2.0 * acceleration) / 8.0, max_cell});
  size = std::max(size, half / 2000.0);  // a bound on memory, far below what limits of a real arm ask for
  for (double s = size; s < half - 0.5 * size; s += size) {
    ends.push_back(s);
    size = std::min(size * kCellGrowth, max_cell);
  }
  ends.push_back(half);
  double begin = 0.0;
  for (const double end : ends) {
    cells->push_back({index, begin, end - begin});
    begin = end;
  }
  for (std::size_t i = ends.size(); i-- > 0;) {
    const double end = piece.length - (i == 0 ? 0.0 : ends[i - 1]);
    cells->push_back({index, begin, end - begin});
    begin = end;
  }
}

/// u_factor * u + x_factor * x <= bound, with u = d2s/dt2, x = (ds/dt)^2 and bound >= 0.
struct Constraint {
  double u_factor;
  double x_factor;
  double bound;
};

/// Fastest speeds along the cells that keep velocity and acceleration limits: reachability analysis as in TOPP-RA (Pham
/// and Pham, IEEE T-RO 34(3), 2018) with acceleration limits held at both ends of each cell. Backward: the largest x from
/// which the end can be reached at rest; forward: the largest u that stays below.
class SpeedProfile {
 public:
  SpeedProfile(const std::vector<Piece>& pieces, std::vector<Cell>* cells, const MotionLimits& limits,
               const std::optional<PointSpeedLimit>& speed_limit)
      : pieces_(pieces), cells_(*cells), limits_(limits) {
    begin_.reserve(cells_.size());
    end_.reserve(cells_.size());
    for (const Cell& cell : cells_) {
      begin_.push_back(pieces_[cell.piece].at(cell.begin));
      end_.push_back(pieces_[cell.piece].at(cell.begin + cell.length));
    }
    point_x_.assign(cells_.size() + 1, std::numeric_limits<double>::infinity());
    if (!speed_limit) return;
    for (std::size_t i = 0; i < point_x_.size(); ++i) {
      const PathPoint& point = i < cells_.size() ? begin_[i] : end_.back();
      const double metres_per_s = pointRate(*speed_limit, point);
      if (metres_per_s > 0.0) point_x_[i] = std::pow(kPointSpeedShare * speed_limit->speed_m_s / metres_per_s, 2);
    }
  }

  /// x at the borders of the cells.
  std::vector<double> solve() {
    const std::size_t n = cells_.size();
    std::vector<double> x_max(n + 1);
    x_max[n] = 0.0;
    for (std::size_t i = n; i-- > 0;) x_max[i] = largestSpeed(i, x_max[i + 1]);
    std::vector<double> x(n + 1);
    x[0] = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      const double u = largestAcceleration(i, x[i], x_max[i + 1]);
      x[i + 1] = std::min(std::max(x[i] + 2.0 * cells_[i].length * u, 0.0), x_max[i + 1]);
    }
    return x;
  }

 private:
  void collect(std::size_t i, double next_x_max) {
    constraints_.clear();
    const double step = 2.0 * cells_[i].length;
    constraints_.push_back({step, 1.0, next_x_max});
    constraints_.push_back({-step, -1.0, 0.0});
    const auto addAt = [&](const PathPoint& point, double x_by_u) {
      for (int joint = 0; joint < 6; ++joint) {
        // |q' u + q'' (x + x_by_u u)| <= a
        const double u_factor = point.tangent[joint] + x_by_u * point.curvature[joint];
        const double x_factor = point.curvature[joint];
        const double bound = cells_[i].acceleration_share * limits_.acceleration_rad_s2[joint];
        if (u_factor == 0.0 && x_factor == 0.0) continue;
        constraints_.push_back({u_factor, x_factor, bound});
        constraints_.push_back({-u_factor, -x_factor, bound});
      }
    };
    addAt(begin_[i], 0.0);
    if (pieces_[cells_[i].piece].is_blend) addAt(end_[i], step);
  }

  double velocityBound(std::size_t i) const {
    double x = point_x_[i];
    const auto lower = [&](std::size_t cell, const PathPoint& point) {
      const double rate = cells_[cell].velocity_share * maxPathRate(limits_.velocity_rad_s, point.tangent);
      x = std::min(x, rate * rate);
    };
    lower(i, begin_[i]);
    if (i > 0) lower(i - 1, end_[i - 1]);
    return x;
  }

  double largestSpeed(std::size_t i, double next_x_max) {
    collect(i, next_x_max);
    double x = velocityBound(i);
    // Where the tangent vanishes in all joints that move (the turning point of a reversal) u has no meaning, x is bounded
    // by the curvature alone. Elsewhere x is feasible while every upper bound on u is above every lower bound.
    for (const Constraint& upper : constraints_) {
      if (upper.u_factor == 0.0) {
        if (upper.x_factor > 0.0) x = std::min(x, upper.bound / upper.x_factor);
        continue;
      }
      if (upper.u_factor < 0.0) continue;
      for (const Constraint& lower : constraints_) {
        if (lower.u_factor >= 0.0) continue;
        const double slope = upper.x_factor / upper.u_factor - lower.x_factor / lower.u_factor;
        if (slope > 0.0) x = std::min(x, (upper.bound / upper.u_factor - lower.bound / lower.u_factor) / slope);
      }
    }
    return x;
  }

  double largestAcceleration(std::size_t i, double x, double next_x_max) {
    collect(i, next_x_max);
    double u = std::numeric_limits<double>::infinity();
    for (const Constraint& upper : constraints_) {
      if (upper.u_factor > 0.0) u = std::min(u, (upper.bound - upper.x_factor * x) / upper.u_factor);
    }
    return u;
  }

  const std::vector<Piece>& pieces_;
  const std::vector<Cell>& cells_;
  const MotionLimits& limits_;
  std::vector<PathPoint> begin_;
  std::vector<PathPoint> end_;
  std::vector<double> point_x_;
  std::vector<Constraint> constraints_;
};

/// Largest share of the limits that the cubic between two points uses: of velocity, of acceleration.
std::pair<double, double> loadOf(const TrajectoryPoint& a, const TrajectoryPoint& b, const MotionLimits& limits) {
  const CubicSegment cubic(a, b);
  double velocity = 0.0;
  double acceleration = 0.0;
  for (int i = 0; i < 6; ++i) {
    const double a0 = cubic.acceleration_rad_s2[i];
    const double a1 = cubic.end_acceleration_rad_s2[i];
    acceleration = std::max(acceleration, std::max(std::abs(a0), std::abs(a1)) / limits.acceleration_rad_s2[i]);
    double v = std::max(std::abs(a.velocity_rad_s[i]), std::abs(b.velocity_rad_s[i]));
    if (a0 * a1 < 0.0) v = std::max(v, std::abs(a.velocity_rad_s[i] - a0 * a0 * cubic.duration_s / (2.0 * (a1 - a0))));
    velocity = std::max(velocity, v / limits.velocity_rad_s[i]);
  }
  return {velocity, acceleration};
}

/// Points at the cells' borders, and within cells that take longer than `sample_s`. `cell_of[i]`: cell that begins at
/// point i or holds it.
std::vector<TrajectoryPoint> finePoints(const std::vector<Piece>& pieces, const std::vector<Cell>& cells,
                                        const std::vector<double>& x, double sample_s,
                                        std::vector<std::size_t>* cell_of) {
  std::vector<TrajectoryPoint> points;
  cell_of->clear();
  double time = 0.0;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const double speed = std::sqrt(x[i]);
    const double duration = 2.0 * cells[i].length / (speed + std::sqrt(x[i + 1]));
    const double u = (x[i + 1] - x[i]) / (2.0 * cells[i].length);
    const int parts = std::max(1, static_cast<int>(std::ceil(duration / sample_s - 1e-9)));
    for (int k = 0; k < parts; ++k) {
      const double t = duration * k / parts;
      const PathPoint point = pieces[cells[i].piece].at(cells[i].begin + (speed + 0.5 * u * t) * t);
      TrajectoryPoint out;
      out.time_s = time + t;
      out.position_rad = point.position;
      out.velocity_rad_s = point.tangent * (speed + u * t);
      points.push_back(out);
      cell_of->push_back(i);
    }
    time += duration;
  }
  const PathPoint last = pieces.back().at(pieces.back().length);
  TrajectoryPoint out;
  out.time_s = time;
  out.position_rad = last.position;
  points.push_back(out);
  return points;
}

bool withinLimits(const std::pair<double, double>& load) {
  return load.first <= 1.0 + kLimitTolerance && load.second <= 1.0 + kLimitTolerance;
}

/// Leaves out points that interpolation does not need. `too_fast`: pairs of neighbours that break a limit even so.
std::vector<TrajectoryPoint> thinOut(const std::vector<TrajectoryPoint>& fine, const MotionLimits& limits,
                                     double sample_s, std::vector<std::size_t>* too_fast) {
  too_fast->clear();
  std::vector<TrajectoryPoint> kept = {fine.front()};
  std::size_t i = 0;
  while (i + 1 < fine.size()) {
    std::size_t next = i + 1;
    if (!withinLimits(loadOf(fine[i], fine[next], limits))) too_fast->push_back(i);
    while (next + 1 < fine.size() && fine[next + 1].time_s - fine[i].time_s <= sample_s * (1.0 + 1e-9) &&
           withinLimits(loadOf(fine[i], fine[next + 1], limits))) {
      ++next;
    }
    kept.push_back(fine[next]);
    i = next;
  }
  return kept;
}

void slowDown(const std::vector<TrajectoryPoint>& fine, const std::vector<std::size_t>& too_fast,
              const std::vector<std::size_t>& cell_of, const MotionLimits& limits, std::vector<Cell>* cells) {
  std::vector<double> velocity(cells->size(), 1.0);
  std::vector<double> acceleration(cells->size(), 1.0);
  for (const std::size_t i : too_fast) {
    const auto load = loadOf(fine[i], fine[i + 1], limits);
    const std::size_t cell = cell_of[i];
    for (std::size_t k = cell == 0 ? 0 : cell - 1; k < std::min(cell + 2, cells->size()); ++k) {
      velocity[k] = std::min(velocity[k], load.first > 1.0 ? 0.99 / load.first : 1.0);
      acceleration[k] = std::min(acceleration[k], load.second > 1.0 ? std::max(0.5, 0.99 / load.second) : 1.0);
    }
  }
  for (std::size_t k = 0; k < cells->size(); ++k) {
    (*cells)[k].velocity_share *= velocity[k];
    (*cells)[k].acceleration_share *= acceleration[k];
  }
}

/// The whole motion slower, until every limit holds: what is left if slowing down in places does not end.
void stretch(const MotionLimits& limits, std::vector<TrajectoryPoint>* points) {
  double factor = 1.0;
  for (std::size_t i = 0; i + 1 < points->size(); ++i) {
    const auto load = loadOf((*points)[i], (*points)[i + 1], limits);
    factor = std::max({factor, load.first, std::sqrt(load.second)});
  }
  for (TrajectoryPoint& point : *points) {
    point.time_s *= factor;
    point.velocity_rad_s /= factor;
  }
}

}  // namespace

std::vector<std::string> MotionLimits::validate() const {
  interactive_mapping::RangeCheck check;
  for (int i = 0; i < 6; ++i) {
    const std::string index = "[" + std::to_string(i) + "]";
    check(("velocity_rad_s" + index).c_str(), velocity_rad_s[i], 1e-3, 100.0, "rad/s");
    check(("acceleration_rad_s2" + index).c_str(), acceleration_rad_s2[i], 1e-2, 1000.0, "rad/s^2");
  }
  return check.problems();
}

TrajectoryPoint JointTrajectory::sample(double time_s) const {
  if (points.empty()) throw std::logic_error("an empty trajectory has no point at " + std::to_string(time_s) + " s");
  const auto at_rest = [time_s](TrajectoryPoint point) {
    point.time_s = time_s;
    point.velocity_rad_s.setZero();
    point.acceleration_rad_s2.setZero();
    return point;
  };
  if (!(time_s > points.front().time_s)) {
    return time_s == points.front().time_s ? points.front() : at_rest(points.front());
  }
  if (time_s >= points.back().time_s) return at_rest(points.back());
  const auto after = std::upper_bound(points.begin(), points.end(), time_s,
                                      [](double t, const TrajectoryPoint& point) { return t < point.time_s; });
  const TrajectoryPoint& a = *(after - 1);
  const CubicSegment cubic(a, *after);
  const double t = time_s - a.time_s;
  return {time_s, cubic.positionAt(t), cubic.velocityAt(t), cubic.accelerationAt(t)};
}

PointSpeedLimit tipSpeedLimit(std::shared_ptr<const ArmKinematics> arm, double speed_m_s) {
  if (!arm) throw std::invalid_argument("tipSpeedLimit: no arm");
  return {[arm = std::move(arm)](const ArmVector& q) -> Eigen::Matrix<double, 3, 6> {
            return arm->jacobian(q).topRows<3>();
          },
          speed_m_s};
}

JointTrajectory timeParametrize(const JointPath& path, const MotionLimits& limits, const TimingConfig& config,
                                const std::optional<PointSpeedLimit>& speed_limit) {
  interactive_mapping::refuseIfAny("impossible limits:", limits.validate());
  interactive_mapping::requireValid("impossible timing:", config);
  requireFinite(path);
  if (speed_limit) {
    interactive_mapping::RangeCheck check;
    check("speed_m_s", speed_limit->speed_m_s, 1e-4, 10.0, "m/s");
    interactive_mapping::refuseIfAny("impossible speed limit:", check.problems());
  }
  const JointPath waypoints = withoutRepetitions(path);
  JointTrajectory trajectory;
  if (waypoints.size() == 1) {
    trajectory.points.resize(1);
    trajectory.points[0].position_rad = waypoints[0];
    return trajectory;
  }
  const std::vector<Piece> pieces = roundCorners(waypoints, config.max_deviation_rad);
  std::vector<Cell> cells;
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    cutPiece(i, pieces[i], limits, speed_limit, &cells);
  }
  SpeedProfile profile(pieces, &cells, limits, speed_limit);
  std::vector<std::size_t> cell_of;
  std::vector<std::size_t> too_fast;
  std::vector<TrajectoryPoint> points;
  for (int round = 0; round < kMaxRounds; ++round) {
    const std::vector<TrajectoryPoint> fine = finePoints(pieces, cells, profile.solve(), config.sample_s, &cell_of);
    points = thinOut(fine, limits, config.sample_s, &too_fast);
    if (too_fast.empty()) break;
    slowDown(fine, too_fast, cell_of, limits, &cells);
  }
  points.front().position_rad = waypoints.front();
  points.back().position_rad = waypoints.back();
  stretch(limits, &points);
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    points[i].acceleration_rad_s2 = CubicSegment(points[i], points[i + 1]).acceleration_rad_s2;
  }
  trajectory.points = std::move(points);
  return trajectory;
}

JointPath roundedPath(const JointPath& path, double step_rad, const TimingConfig& config) {
  interactive_mapping::requireValid("impossible timing:", config);
  requireFinite(path);
  interactive_mapping::RangeCheck check;
  check("step_rad", step_rad, 1e-6, 10.0, "rad");
  interactive_mapping::refuseIfAny("impossible step:", check.problems());
  const JointPath waypoints = withoutRepetitions(path);
  JointPath dense = {waypoints.front()};
  if (waypoints.size() == 1) return dense;
  for (const Piece& piece : roundCorners(waypoints, config.max_deviation_rad)) {
    // No joint moves faster in s than the faster of the two tangents.
    const double way = piece.length * piece.from.cwiseAbs().cwiseMax(piece.to.cwiseAbs()).maxCoeff();
    const int parts = std::max(1, static_cast<int>(std::ceil(way / step_rad)));
    for (int k = 1; k <= parts; ++k) dense.push_back(piece.at(piece.length * k / parts).position);
  }
  dense.back() = waypoints.back();
  return dense;
}

}  // namespace motion_planning
