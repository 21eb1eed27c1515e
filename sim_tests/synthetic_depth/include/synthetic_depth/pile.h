// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "synthetic_depth/scene.h"

namespace synthetic_depth {

/// A heap of equal bricks, each lying flat with a random yaw.
struct PileConfig {
  std::uint64_t seed{1};
  Eigen::Vector3d brick_size_m{0.3, 0.15, 0.1};  ///< full length, width, height
  Eigen::Vector2d center_m{0.0, 0.0};
  double extent_m{1.6};         ///< diameter of the circle that holds every brick
  double height_m{0.5};         ///< no brick top is higher; lower towards the rim (dome)
  int max_bricks{30};           ///< upper limit; the envelope may stop the pile earlier
  int remove_topmost{0};        ///< so many of the highest bricks vanish ...
  int remove_at_frame{kNever};  ///< ... at this frame
  int first_id{0};

  std::vector<std::string> validate() const;
};

/// Drops bricks one after the other. A brick comes to rest on the highest tops below it, and stays only if its centre
/// lies over the hull of its contact patches with some margin and the patches cover at least half of its base, so each
/// brick would stand alone on those below; the load of bricks added later is not checked.
/// The topmost bricks never carry another that stays, so removing them leaves a supported pile.
/// Throws std::invalid_argument for a bad config or fewer bricks than remove_topmost.
std::vector<Box> makePile(const PileConfig& config);

}  // namespace synthetic_depth
