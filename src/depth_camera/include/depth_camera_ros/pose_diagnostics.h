// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>

#include <diagnostic_updater/DiagnosticStatusWrapper.h>

#include "depth_camera_ros/camera_pose_source.h"

namespace depth_camera_ros {

/// `consequence`: what a jump that stayed means to the node.
inline void diagnosePoses(const CameraPoseParams& params, const CameraPoseCounters& counters,
                          std::uint64_t num_jump_refusals, std::uint64_t num_restarts, const std::string& consequence,
                          diagnostic_updater::DiagnosticStatusWrapper* status) {
  using diagnostic_msgs::DiagnosticStatus;
  if (counters.has_tf_age && counters.last_tf_age_s > params.tf_timeout_s) {
    status->summaryf(DiagnosticStatus::WARN, "newest transform is %.3f s older than the image", counters.last_tf_age_s);
  } else if (counters.settled_jumps > 0) {
    status->summary(DiagnosticStatus::WARN,
                    "the pose jumped and stayed, " + std::to_string(counters.settled_jumps) + " times: " + consequence);
  } else {
    status->summary(DiagnosticStatus::OK, "");
  }
  status->add("map frame", params.map_frame);
  if (counters.has_tf_age) {
    status->addf("age at the last image [s]", "%.3f", counters.last_tf_age_s);
  } else {
    status->add("age at the last image [s]", "static or none");
  }
  status->add("images left out for a jump", num_jump_refusals);
  status->add("jumps that stayed", counters.settled_jumps);
  status->add("time ran back", num_restarts);
}

}  // namespace depth_camera_ros
