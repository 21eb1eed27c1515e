// SPDX-License-Identifier: BSD-3-Clause
#include "planning/curves.h"

#include <algorithm>
#include <cmath>

namespace base_navigation {
namespace {

namespace ob = ompl::base;

constexpr double kCurves[] = {1.0, 2.0, 4.0};  // of the turn radius: curves tried

/// [0, 2 pi); what rounding leaves below a full turn is none.
double positiveAngle(double angle_rad) {
  const double wrapped_rad = wrapAngle(angle_rad);
  const double positive_rad = wrapped_rad < 0.0 ? wrapped_rad + 2.0 * M_PI : wrapped_rad;
  return positive_rad > 2.0 * M_PI - kNothing ? 0.0 : positive_rad;
}

/// Arc, tangent, arc, all forwards (Dubins 1957), with the arcs to the given sides (1 left, -1 right); empty: the circles
/// are too near for it. Not OMPL's, whose assertions end the process for some pairs of poses in line (1.5.2 as packaged).
Motions arcLineArc(const Pose2d& from, const Pose2d& to, double radius_m, int first_side, int last_side) {
  const auto center = [&](const Pose2d& pose, int side) { return transform(pose, {0.0, side * radius_m}); };
  const Eigen::Vector2d between = center(to, last_side) - center(from, first_side);
  // Seen along the line, the centres lie beside it by a radius each, on the arcs' sides.
  const double across_m = (last_side - first_side) * radius_m;
  const double squared_m2 = between.squaredNorm() - across_m * across_m;
  if (squared_m2 < 0.0) return {};
  const double length_m = std::sqrt(squared_m2);
  const double heading_rad =
      between.norm() < kNothing ? from.yaw_rad : std::atan2(between.y(), between.x()) - std::atan2(across_m, length_m);
  const double first_rad = positiveAngle(first_side * (heading_rad - from.yaw_rad));
  const double last_rad = positiveAngle(last_side * (to.yaw_rad - heading_rad));
  Motions motions;
  if (first_rad > kNothing) motions.push_back({radius_m * first_rad, first_side * first_rad});
  if (length_m > kNothing) motions.push_back({length_m, 0.0});
  if (last_rad > kNothing) motions.push_back({radius_m * last_rad, last_side * last_rad});
  return motions;
}

}  // namespace

OmplPose toOmpl(const ob::StateSpacePtr& space, const Pose2d& pose) {
  OmplPose state(space);
  const double yaw_rad = wrapAngle(pose.yaw_rad);
  state->setXY(pose.x_m, pose.y_m);
  state->setYaw(yaw_rad < M_PI ? yaw_rad : -M_PI);  // for OMPL, pi itself is out of bounds
  return state;
}

Pose2d fromOmpl(const ob::State* state) {
  const auto* se2 = state->as<ob::SE2StateSpace::StateType>();
  return {se2->getX(), se2->getY(), se2->getYaw()};
}

double away_m(const Pose2d& a, const Pose2d& b) {
  return (a.position() - b.position()).norm();
}

double away_rad(const Pose2d& a, const Pose2d& b) {
  return std::abs(wrapAngle(a.yaw_rad - b.yaw_rad));
}

Pose2d follow(const Pose2d& from_map, const Motions& motions) {
  return BasePath{from_map, motions}.end();
}

bool isReverse(const BaseMotion& motion) {
  return motion.length_m < 0.0;
}

Motions reedsShepp(const ob::ReedsSheppStateSpace& space, const ob::State* from, const ob::State* to, double radius_m) {
  using Space = ob::ReedsSheppStateSpace;
  const Space::ReedsSheppPath curve = space.reedsShepp(from, to);
  Motions motions;
  for (int i = 0; i < 5; ++i) {
    const double length = curve.length_[i];  // in radii, negative backwards
    if (std::abs(length) < kNothing) continue;
    const int side = curve.type_[i] == Space::RS_LEFT ? 1 : curve.type_[i] == Space::RS_RIGHT ? -1 : 0;
    motions.push_back({radius_m * length, side * length});
  }
  return motions;
}

Motions turnDriveTurn(const Pose2d& from, const Pose2d& to, bool is_forward) {
  const Eigen::Vector2d way = to.position() - from.position();
  const double length_m = way.norm();
  if (length_m < kNothing) return {{0.0, wrapAngle(to.yaw_rad - from.yaw_rad)}};
  const double heading_rad = std::atan2(way.y(), way.x()) + (is_forward ? 0.0 : M_PI);
  Motions motions;
  const double first_rad = wrapAngle(heading_rad - from.yaw_rad);
  const double last_rad = wrapAngle(to.yaw_rad - heading_rad);
  if (std::abs(first_rad) > kNothing) motions.push_back({0.0, first_rad});
  motions.push_back({is_forward ? length_m : -length_m, 0.0});
  if (std::abs(last_rad) > kNothing) motions.push_back({0.0, last_rad});
  return motions;
}

Connections::Connections(double turn_radius_m)
    : radius_m_(turn_radius_m), reeds_shepp_(std::make_shared<ob::ReedsSheppStateSpace>(turn_radius_m)) {
  // The pair of states is only a place for numbers, the same for all spaces.
  ob::RealVectorBounds bounds(2);
  bounds.setLow(-1.0);
  bounds.setHigh(1.0);
  reeds_shepp_->setBounds(bounds);
}

std::vector<Motions> Connections::between(const Pose2d& from, const Pose2d& to) const {
  const auto a = toOmpl(reeds_shepp_, from);
  const auto b = toOmpl(reeds_shepp_, to);
  std::vector<Motions> all;
  all.push_back(turnDriveTurn(from, to, true));
  all.push_back(turnDriveTurn(from, to, false));
  all.push_back(reedsShepp(*reeds_shepp_, a.get(), b.get(), radius_m_));
  for (const double factor : kCurves) {
    for (const int first_side : {1, -1}) {
      for (const int last_side : {1, -1}) {
        all.push_back(arcLineArc(from, to, factor * radius_m_, first_side, last_side));
      }
    }
  }
  const auto isElsewhere = [&](const Motions& motions) {
    const Pose2d end = follow(from, motions);
    return away_m(end, to) > kSamePlace || away_rad(end, to) > kSamePlace;
  };
  all.erase(std::remove_if(all.begin(), all.end(), isElsewhere), all.end());
  return all;
}

}  // namespace base_navigation
