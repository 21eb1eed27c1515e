// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base_navigation/obstacle_guard.h"
#include "base_navigation/path_follower.h"
#include "driving/drive_data.h"

namespace base_navigation {

/// The share of speed that the scanner leaves: along the way planned, and along the arcs that the base is on and is
/// about to take, which corrections bend.
GuardVerdict lookAhead(const ObstacleGuard& guard, const PathFollower& follower, const MotionLimits& limits,
                       const DriveData& data);

}  // namespace base_navigation
