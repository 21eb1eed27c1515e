// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_RECORDING_GUARD_H
#define GPIS_MAPPING_RECORDING_GUARD_H

#include <cstddef>
#include <optional>
#include <vector>

#include <depth_camera/pose_guard.h>
#include <depth_camera/stamp_guard.h>
#include "gpis_mapping/depth_sequence.h"

namespace gpis_mapping {

/// Keeps those frames of a recording out of the map that the live node rejects. These have no measurement, or a pose
/// the camera cannot have moved to. In bags also those whose stamp is not after the last one; lists may repeat and
/// reorder images. Folders may hold separate views, and frame numbers in place of stamps. So their limits grow with the
/// pace of the recording. A rejected frame moved by more than the limits and by more than five times the median.
class RecordingGuard {
 public:
  /// `frames`: numbers of those that will be checked. Of a folder it reads their poses, with the time offset that is set
  /// by then. `limits` are the live node's; none: poses are not checked.
  RecordingGuard(DepthSequence* sequence, const std::vector<std::size_t>& frames,
                 std::optional<depth_camera::PoseLimits> limits);

  /// Why this frame must not be mapped; nothing when it may.
  std::optional<SkipReason> check(const DepthFrame& frame);

  /// How often poses jumped and stayed, so that the later ones were believed.
  std::size_t numSettledJumps() const { return num_settled_; }

 private:
  bool is_clock_;
  depth_camera::StampGuard stamps_;
  std::optional<depth_camera::PoseGuard> poses_;
  std::size_t num_settled_{0};
};

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_RECORDING_GUARD_H
