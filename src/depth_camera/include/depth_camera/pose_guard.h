// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>

namespace depth_camera {

/// Where a camera was, and when.
struct StampedPose {
  Eigen::Isometry3d T_map_camera{Eigen::Isometry3d::Identity()};
  double stamp_s{0.0};
};

/// How far a camera pose may move between two images: step + speed * time between them.
struct PoseLimits {
  double max_step_m{0.30};
  double max_step_rad{0.35};
  double max_speed_mps{1.5};
  double max_turn_radps{1.5};
  int settle_frames{5};

  static void fields(PoseLimits& c, interactive_mapping::Fields& f) {
    f.live()("max_step_m", c.max_step_m, 0.0, 1e3, "m", "step between two images");
    f.live()("max_step_rad", c.max_step_rad, 0.0, 4.0, "rad", "the same of rotation");
    f("max_speed_mps", c.max_speed_mps, 0.0, 1e3, "m/s", "speed");
    f("max_turn_radps", c.max_turn_radps, 0.0, 1e3, "rad/s", "the same of rotation");
    f.live()("settle_frames", c.settle_frames, 0, 1000, "images",
             "this many poses in a row that agree with each other make a jump believed; 0: never");
  }

  /// The motion between two poses, in either order, as a share of what is allowed; beyond 1 it is impossible. Infinite for
  /// a motion where none is allowed.
  double shareUsed(const StampedPose& from, const StampedPose& to) const;
};

/// Keeps poses out of the map that the camera cannot have moved to. A pose is compared with the last believed one. A
/// localisation that corrects itself jumps once and stays: after `settle_frames` poses that agree with each other, the
/// last of them is believed. The first pose of all is believed.
class PoseGuard {
 public:
  enum class Verdict {
    kBelieved,
    kSettled,  // believed although it is a jump: it has lasted
    kJump,
  };

  explicit PoseGuard(const PoseLimits& limits) : limits_(limits) {}

  /// `stamp_s` [s]: the time between two poses counts, not their order.
  Verdict check(const Eigen::Isometry3d& T_map_camera, double stamp_s);

  /// What the last kJump or kSettled saw and what is allowed.
  const std::string& message() const { return message_; }

  /// Believes the next pose, whatever it is.
  void reset();

  void setLimits(const PoseLimits& limits) { limits_ = limits; }

 private:
  PoseLimits limits_;
  std::optional<StampedPose> believed_;
  std::optional<StampedPose> candidate_;  // the last pose refused
  int num_agreeing_{0};                   // poses in a row, candidate_ the last of them
  std::string message_;
};

}  // namespace depth_camera
