// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_POSE_GUARD_H
#define GPIS_MAPPING_POSE_GUARD_H

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace gpis_mapping {

/// How far a camera pose may move between two images: step + speed * time between them.
struct PoseLimits {
  double max_step_m{0.30};
  double max_step_rad{0.35};
  double max_speed_mps{1.5};
  double max_turn_radps{1.5};
  int settle_frames{5};  // so many poses in a row that agree with each other make a jump believed; 0: never

  /// Every problem as "key = value unit, must be in [lo, hi] unit".
  std::vector<std::string> validate() const;
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

  /// Stamps [s] rise from call to call.
  Verdict check(const Eigen::Isometry3d& T_map_camera, double stamp_s);

  /// What the last kJump or kSettled saw and what is allowed.
  const std::string& message() const { return message_; }

  /// Believes the next pose, whatever it is.
  void reset();

  void setLimits(const PoseLimits& limits) { limits_ = limits; }

 private:
  struct Pose {
    Eigen::Isometry3d T_map_camera;
    double stamp_s;
  };

  bool agree(const Pose& from, const Pose& to) const;

  PoseLimits limits_;
  std::optional<Pose> believed_;
  std::optional<Pose> candidate_;  // the last pose refused
  int num_agreeing_{0};            // poses in a row, candidate_ the last of them
  std::string message_;
};

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_POSE_GUARD_H
