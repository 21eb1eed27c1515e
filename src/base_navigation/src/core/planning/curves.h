// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include <ompl/base/ScopedState.h>
#include <ompl/base/spaces/ReedsSheppStateSpace.h>

#include "base_navigation/base_path.h"

/// Motions from one pose to another, whatever stands between.
namespace base_navigation {

constexpr double kNothing = 1e-7;    // [m] or [rad]: pieces of curves that are left out
constexpr double kSamePlace = 1e-6;  // [m] and [rad]: a curve that ends farther from where it should is none

using Motions = std::vector<BaseMotion>;
using OmplPose = ompl::base::ScopedState<ompl::base::SE2StateSpace>;

OmplPose toOmpl(const ompl::base::StateSpacePtr& space, const Pose2d& pose);
Pose2d fromOmpl(const ompl::base::State* state);

double away_m(const Pose2d& a, const Pose2d& b);
double away_rad(const Pose2d& a, const Pose2d& b);
Pose2d follow(const Pose2d& from_map, const Motions& motions);
bool isReverse(const BaseMotion& motion);

/// The shortest curve of Reeds and Shepp 1990.
Motions reedsShepp(const ompl::base::ReedsSheppStateSpace& space, const ompl::base::State* from,
                   const ompl::base::State* to, double radius_m);

Motions turnDriveTurn(const Pose2d& from, const Pose2d& to, bool is_forward);

/// By turn-drive-turn, by Reeds-Shepp curve and by Dubins curves of several radii from `turn_radius_m` on.
class Connections {
 public:
  explicit Connections(double turn_radius_m);
  std::vector<Motions> between(const Pose2d& from, const Pose2d& to) const;

 private:
  double radius_m_;
  std::shared_ptr<ompl::base::ReedsSheppStateSpace> reeds_shepp_;
};

}  // namespace base_navigation
