// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "simulated_world/simulation.h"

namespace simulated_world {

/// Keeps pictures of a run in its folder: pictures/world_<seconds>_<stowed>.png at the start, after each brick that was
/// stowed, and at the end. All members throw std::runtime_error with the path and the reason.
class RunPictures {
 public:
  /// Makes the folder.
  explicit RunPictures(const std::string& run_folder);

  /// To be called after each tick. Costs nothing unless something was stowed: then a picture, some 0.2 s.
  void watch(Simulation& simulation);

  /// The last picture, unless nothing has changed since the one before.
  void finish(Simulation& simulation);

 private:
  void take(Simulation& simulation);

  std::string folder_;
  std::optional<int> stowed_;  // in the last picture
  std::uint64_t digest_{0};    // of the same
};

}  // namespace simulated_world
