// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/obstacle_guard.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <interactive_mapping_common/config/range_check.h>

namespace base_navigation {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kStraight_rad = 1e-6;  // a motion that turns less is straight: 2 m of it bend by 1 um
// An echo in the margin is kept at the distance it has now, less this: it is on the boundary, and would be met by rounding.
constexpr double kRounding_m = 1e-6;

bool isFinite(const Twist2d& twist) {
  return std::isfinite(twist.linear_m_s) && std::isfinite(twist.angular_rad_s);
}

bool isStraight(const BaseMotion& motion) {
  return !motion.isTurn() && std::abs(motion.turn_rad) < kStraight_rad;
}

/// Middle of the turn in the frame of the base at its start; not straight.
Eigen::Vector2d middle(const BaseMotion& motion) {
  return {0.0, motion.length_m / motion.turn_rad};
}

/// Distance of a point from a convex polygon, 0 inside.
double distanceTo(const Polygon& polygon, const Eigen::Vector2d& p) {
  double nearest_m = kInfinity;
  bool is_inside = true;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d& a = polygon[i];
    const Eigen::Vector2d edge = polygon[(i + 1) % polygon.size()] - a;
    const Eigen::Vector2d to = p - a;
    if (edge.x() * to.y() - edge.y() * to.x() < 0.0) is_inside = false;
    const double along = std::clamp(to.dot(edge) / edge.squaredNorm(), 0.0, 1.0);
    nearest_m = std::min(nearest_m, (to - along * edge).norm());
  }
  return is_inside ? 0.0 : nearest_m;
}

/// Highest speed from which the base stops within `free`, keeping it for `latency_s` and then braking by
/// `deceleration`: v latency + v^2 / (2 deceleration) = free. In metres or radians.
double stoppableSpeed(double free, double latency_s, double deceleration) {
  const double lost = latency_s * deceleration;
  return 2.0 * free * deceleration / (lost + std::sqrt(lost * lost + 2.0 * deceleration * free));
}

void requireOneDirection(const std::vector<BaseMotion>& ahead) {
  for (const BaseMotion& motion : ahead) {
    if (!std::isfinite(motion.length_m) || !std::isfinite(motion.turn_rad)) {
      throw std::invalid_argument("a motion of the path ahead is not finite");
    }
    const BaseMotion& first = ahead.front();
    if ((first.isTurn() && ahead.size() > 1) || motion.isTurn() != first.isTurn() ||
        (motion.length_m > 0.0) != (first.length_m > 0.0)) {
      throw std::invalid_argument("the path ahead must have one direction or be one turn on the spot");
    }
  }
}

}  // namespace

std::vector<std::string> ObstacleGuardConfig::problemsFor(const MotionLimits& limits) const {
  if (!interactive_mapping::problemsOf(*this).empty() || !limits.validate().empty()) return {};
  // What is seen only within the distance that it takes to stop is seen too late.
  const auto stopping = [&](double speed, double deceleration) {
    return speed * latency_s + 0.5 * speed * speed / (braking_share * deceleration);
  };
  interactive_mapping::RangeCheck check;
  check("look_ahead_m", look_ahead_m, stopping(std::max(limits.forward_m_s, limits.backward_m_s), limits.linear_m_s2),
        100.0, "m");
  check("look_ahead_rad", look_ahead_rad, stopping(limits.turn_rad_s, limits.turn_rad_s2), 6.283, "rad");
  return check.problems();
}

ObstacleGuard::ObstacleGuard(const ObstacleGuardConfig& config, const MotionLimits& limits, const Polygon& footprint)
    : config_(config), limits_(limits) {
  std::vector<std::string> problems = interactive_mapping::problemsOf(config);
  for (const std::vector<std::string>& more : {limits.validate(), config.problemsFor(limits)}) {
    problems.insert(problems.end(), more.begin(), more.end());
  }
  interactive_mapping::refuseIfAny("impossible obstacle guard:", problems);
  padded_ = padPolygon(footprint, config.margin_m);
  radius_m_ = circumscribedRadius(padded_);
  inscribedRadius(footprint);  // throws if it does not hold the origin
  for (std::size_t i = 0; i < footprint.size(); ++i) {
    const Eigen::Vector2d along = (footprint[(i + 1) % footprint.size()] - footprint[i]).normalized();
    const Eigen::Vector2d normal(along.y(), -along.x());
    edges_.push_back({normal, normal.dot(footprint[i]), std::atan2(normal.y(), normal.x())});
  }
}

/// Padding at which the footprint's boundary goes through the point; negative inside.
double ObstacleGuard::distance(const Eigen::Vector2d& p_base) const {
  double distance_m = -kInfinity;
  for (const Edge& edge : edges_) distance_m = std::max(distance_m, edge.normal.dot(p_base) - edge.offset_m);
  return distance_m;
}

/// How fast distance() of a point that stands still falls [m/s]; at a corner, where two edges are as near, the slower.
double ObstacleGuard::approach(const Eigen::Vector2d& p_base, const Twist2d& twist) const {
  const Eigen::Vector2d velocity(-twist.linear_m_s + twist.angular_rad_s * p_base.y(),
                                 -twist.angular_rad_s * p_base.x());
  const double distance_m = distance(p_base);
  double growth_m_s = -kInfinity;
  for (const Edge& edge : edges_) {
    if (edge.normal.dot(p_base) - edge.offset_m < distance_m - kRounding_m) continue;
    growth_m_s = std::max(growth_m_s, edge.normal.dot(velocity));
  }
  return -growth_m_s;
}

/// Share of the leg's motion after which the footprint with this padding has the point, in the leg's frame, inside it
/// for the first time; infinite: not on this leg.
double ObstacleGuard::meets(const Eigen::Vector2d& p_leg, const Leg& leg, double padding_m) const {
  const BaseMotion& motion = leg.motion;
  if (isStraight(motion)) {
    // Seen from the base the point moves by -length along x; it is inside while it is inside of every edge.
    double first = 0.0;
    double last = 1.0;
    for (const Edge& edge : edges_) {
      const double outside_m = edge.normal.dot(p_leg) - edge.offset_m - padding_m;
      const double change_m = -motion.length_m * edge.normal.x();
      if (change_m == 0.0) {
        if (outside_m > 0.0) return kInfinity;
      } else if (change_m < 0.0) {
        first = std::max(first, -outside_m / change_m);
      } else {
        last = std::min(last, -outside_m / change_m);
      }
    }
    return first <= last ? first : kInfinity;
  }

  // Seen from the base the point runs round the middle of the turn, by -turn. It is outside of an edge while
  // n . m + r cos(bearing - bearing of n) > offset: within acos((offset - n . m) / r) of the normal's bearing.
  const Eigen::Vector2d m = middle(motion);
  const Eigen::Vector2d arm = p_leg - m;
  const double r_m = arm.norm();
  if (r_m < leg.min_radius_m || r_m > leg.max_radius_m) return kInfinity;
  const double turn_rad = std::abs(motion.turn_rad);
  const double sense = motion.turn_rad > 0.0 ? -1.0 : 1.0;
  const double bearing_rad = std::atan2(arm.y(), arm.x());
  constexpr double kRounding_rad = 1e-12;
  double turned_rad = 0.0;
  // Each round leaves an edge behind; a second turn about all of them means that there is no place inside.
  for (std::size_t settled = 0, i = 0; settled < edges_.size(); i = (i + 1) % edges_.size()) {
    const Edge& edge = edges_[i];
    const double reach_m = edge.offset_m + padding_m - edge.normal.dot(m);
    ++settled;
    if (reach_m >= r_m) continue;
    if (reach_m < -r_m) return kInfinity;
    const double half_rad = std::acos(reach_m / r_m);
    const double at_rad = wrapAngle(sense * (bearing_rad - edge.normal_rad) + turned_rad);
    if (std::abs(at_rad) >= half_rad - kRounding_rad) continue;
    turned_rad += half_rad - at_rad;
    if (turned_rad > turn_rad) return kInfinity;
    settled = 1;
  }
  return turned_rad / turn_rad;
}

GuardVerdict ObstacleGuard::check(const Twist2d& wanted, const Scan& scan, const Pose2d& T_scan_base) const {
  if (!isFinite(wanted)) throw std::invalid_argument("wanted twist is not finite");
  const double linear_m_s = std::abs(wanted.linear_m_s);
  const double angular_rad_s = std::abs(wanted.angular_rad_s);
  const double duration_s = std::min(linear_m_s > 0.0 ? config_.look_ahead_m / linear_m_s : kInfinity,
                                     angular_rad_s > 0.0 ? config_.look_ahead_rad / angular_rad_s : kInfinity);
  std::vector<BaseMotion> ahead;
  if (std::isfinite(duration_s)) {
    ahead.push_back({wanted.linear_m_s * duration_s, wanted.angular_rad_s * duration_s});
  }
  return check(wanted, ahead, scan, T_scan_base);
}

std::vector<ObstacleGuard::Leg> ObstacleGuard::legsOf(const std::vector<BaseMotion>& ahead) const {
  std::vector<Leg> legs;
  Pose2d start;
  double way_m = 0.0;
  double way_rad = 0.0;
  for (BaseMotion motion : ahead) {
    const double length = motion.isTurn() ? std::abs(motion.turn_rad) : std::abs(motion.length_m);
    const double left = motion.isTurn() ? config_.look_ahead_rad - way_rad : config_.look_ahead_m - way_m;
    if (left <= 0.0) break;
    if (length == 0.0) continue;
    const double share = std::min(1.0, left / length);
    motion.length_m *= share;
    motion.turn_rad *= share;
    const Pose2d T_leg_base = inverse(start);
    Leg leg{motion,
            Eigen::Isometry2d::Identity(),
            way_m,
            way_rad,
            0.0,
            kInfinity,
            radius_m_ + std::abs(motion.length_m) + kRounding_m};
    leg.T_leg_base.translation() = T_leg_base.position();
    leg.T_leg_base.linear() = Eigen::Rotation2Dd(T_leg_base.yaw_rad).toRotationMatrix();
    if (!isStraight(motion)) {
      const Eigen::Vector2d m = middle(motion);
      leg.min_radius_m = distanceTo(padded_, m) - kRounding_m;
      leg.max_radius_m = 0.0;
      for (const Eigen::Vector2d& corner : padded_) leg.max_radius_m = std::max(leg.max_radius_m, (corner - m).norm());
    }
    legs.push_back(leg);
    start = moveAlongArc(start, motion.length_m, motion.turn_rad);
    way_m += std::abs(motion.length_m);
    way_rad += std::abs(motion.turn_rad);
  }
  return legs;
}

double ObstacleGuard::whenMet(const Eigen::Vector2d& p_base, const std::vector<Leg>& legs) const {
  const double distance_m = distance(p_base);
  double padding_m = config_.margin_m;
  if (distance_m < config_.margin_m) {
    const Twist2d first{legs.front().motion.length_m, legs.front().motion.turn_rad};
    if (approach(p_base, first) > 1e-9) return 0.0;
    if (distance_m <= kRounding_m) return kInfinity;  // touched, and left behind
    padding_m = distance_m - kRounding_m;
  }
  for (std::size_t i = 0; i < legs.size(); ++i) {
    const Eigen::Vector2d p_leg = legs[i].T_leg_base * p_base;
    if (p_leg.squaredNorm() > legs[i].reach_m * legs[i].reach_m) continue;
    const double share = meets(p_leg, legs[i], padding_m);
    if (share <= 1.0) return static_cast<double>(i) + share;
  }
  return kInfinity;
}

double ObstacleGuard::deceleration(const std::vector<Leg>& legs, std::size_t last) const {
  const double turning_rad_s2 = config_.braking_share * limits_.turn_rad_s2;
  if (legs.front().motion.isTurn()) return turning_rad_s2;
  double along_m_s2 = config_.braking_share * limits_.linear_m_s2;
  for (std::size_t i = 0; i <= last; ++i) {
    const double turn_rad = std::abs(legs[i].motion.turn_rad);
    if (turn_rad == 0.0) continue;
    along_m_s2 = std::min(along_m_s2, turning_rad_s2 * std::abs(legs[i].motion.length_m) / turn_rad);
  }
  return along_m_s2;
}

GuardVerdict ObstacleGuard::check(const Twist2d& wanted, const std::vector<BaseMotion>& ahead, const Scan& scan,
                                  const Pose2d& T_scan_base) const {
  if (!isFinite(wanted)) throw std::invalid_argument("wanted twist is not finite");
  if (!isFinite(T_scan_base)) throw std::invalid_argument("pose of the base since the scan is not finite");
  requireOneDirection(ahead);
  const std::vector<Leg> legs = legsOf(ahead);
  GuardVerdict verdict;
  verdict.free_m = config_.look_ahead_m;
  verdict.free_rad = config_.look_ahead_rad;
  if (legs.empty()) return verdict;
  const bool is_turn = legs.front().motion.isTurn();
  const double way_m = legs.back().before_m + std::abs(legs.back().motion.length_m);
  if (!is_turn) verdict.free_m = way_m;
  verdict.free_rad = legs.back().before_rad + std::abs(legs.back().motion.turn_rad);

  const Pose2d T_base_scan = inverse(T_scan_base);
  const double reach_m = radius_m_ + way_m;
  std::vector<double> met(scan.ranges_m.size(), kInfinity);  // of each beam's echo
  std::vector<Eigen::Vector2d> echoes(scan.ranges_m.size());
  for (std::size_t beam = 0; beam < met.size(); ++beam) {
    if (!scan.isEcho(beam)) continue;
    const Eigen::Vector2d p_scan = scan.echo(beam);
    if (distance(p_scan) <= 0.0) continue;  // the robot itself
    echoes[beam] = transform(T_base_scan, p_scan);
    if (echoes[beam].squaredNorm() <= reach_m * reach_m) met[beam] = whenMet(echoes[beam], legs);
  }
  const std::size_t num_echoes = static_cast<std::size_t>(config_.min_echoes);
  double soonest = kInfinity;
  for (std::size_t begin = 0; begin + num_echoes <= met.size(); ++begin) {
    const auto last = std::max_element(met.begin() + begin, met.begin() + begin + num_echoes);
    if (*last >= soonest) continue;
    soonest = *last;
    verdict.obstacle_base = echoes[last - met.begin()];
  }
  if (!verdict.obstacle_base) return verdict;

  const std::size_t leg_index = std::min(static_cast<std::size_t>(soonest), legs.size() - 1);
  const double share = soonest - static_cast<double>(leg_index);
  const Leg& leg = legs[leg_index];
  verdict.free_rad = leg.before_rad + share * std::abs(leg.motion.turn_rad);
  if (!is_turn) verdict.free_m = leg.before_m + share * std::abs(leg.motion.length_m);
  const double speed = std::abs(is_turn ? wanted.angular_rad_s : wanted.linear_m_s);
  const double allowed =
      stoppableSpeed(is_turn ? verdict.free_rad : verdict.free_m, config_.latency_s, deceleration(legs, leg_index));
  verdict.speed_factor = allowed < speed ? allowed / speed : 1.0;
  if (allowed <= 0.0) verdict.speed_factor = 0.0;
  return verdict;
}

}  // namespace base_navigation
