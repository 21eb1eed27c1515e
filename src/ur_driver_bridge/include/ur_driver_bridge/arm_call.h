// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <variant>

#include <Eigen/Geometry>
#include <interactive_mapping_enums/watch_trajectory.h>

#include "ur_driver_bridge/trajectory_check.h"

/// What the executor asks of the world, and what the world answers. Whoever carries calls out answers each one but
/// CancelCall and AttachCall with a Reply, and tells of each trajectory sent with TrajectoryEvents.
namespace ur_driver_bridge {

using interactive_mapping::WatchPhase;

/// The path monitor is to watch this from now on; an empty trajectory: nothing.
struct WatchCall {
  JointTrajectory trajectory;
  double start_s{0.0};  // ROS time
  WatchPhase phase{WatchPhase::kFree};
};
/// The controller is to follow this now, in place of what it follows.
struct SendCall {
  JointTrajectory trajectory;
};
struct CancelCall {};  // whatever the controller follows
struct MagnetCall {
  bool is_on{false};
};
struct ZeroForceCall {};
struct Payload {
  double mass_kg{0.0};
  Eigen::Vector3d centre_m{Eigen::Vector3d::Zero()};  // in the tool flange
};
struct PayloadCall {
  Payload payload;  // all that hangs on the flange
};
struct DashboardCall {
  std::string command;  // as Recovery::Step::command
};
/// Tell everybody what the magnet holds: the brick of the pick, or nothing.
struct AttachCall {
  bool is_attached{false};
};

struct ArmCall {
  std::uint64_t id{0};
  std::variant<WatchCall, SendCall, CancelCall, MagnetCall, ZeroForceCall, PayloadCall, DashboardCall, AttachCall> what;
};

struct CallReply {
  std::uint64_t id{0};
  bool success{false};
  bool is_gone{false};  // nobody answered
  std::string message;
  std::uint32_t watch_id{0};  // WatchCall
};

/// Of the trajectory sent with call `id`.
struct TrajectoryEvent {
  enum class Kind { kAccepted, kRejected, kSucceeded, kAborted, kCancelled, kLost };
  std::uint64_t id{0};
  Kind kind{Kind::kAccepted};
  std::string message;  // of the controller
};

}  // namespace ur_driver_bridge
