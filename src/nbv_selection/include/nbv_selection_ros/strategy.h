// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <stdexcept>
#include <string>

#include <diagnostic_updater/DiagnosticStatusWrapper.h>
#include <ros/node_handle.h>
#include <ros/time.h>

#include "nbv_selection/failure_memory.h"
#include "nbv_selection/view_selector.h"

namespace nbv_selection_ros {

/// What a strategy gets once, before anything else.
struct StrategyContext {
  std::string name;            // by which goals ask for it
  ros::NodeHandle nh;          // topics and services of its map are relative to it
  ros::NodeHandle private_nh;  // its parameters: ~<name>
  std::string map_frame;
  nbv_selection::RobotBody robot;
  double map_wait_s{0.0};        // ROS time that a request waits for a map as new as it wants, ...
  double stall_s{0.0};           // ... and wall time that the clock may stand still during it
  double answer_timeout_s{0.0};  // wall time that a service of the map may take
};

/// Its map has not come, is too old, or does not answer: what(), for the user.
class MapUnavailable : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Its map comes and cannot be used, being in another frame: what(), for the user.
class MapUnusable : public MapUnavailable {
 public:
  using MapUnavailable::MapUnavailable;
};

/// The goal was cancelled while the map was waited for or asked.
class SelectionCancelled : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A way to choose where to stand next, a plugin of package nbv_selection (pluginlib). One thread selects; the others'
/// callbacks, of subscriptions it makes, and diagnose() run beside it.
class Strategy {
 public:
  using Tell = std::function<void(const std::string& stage, std::size_t segments)>;
  using IsCancelled = std::function<bool()>;

  virtual ~Strategy() = default;

  /// Reads parameters, subscribes. Throws std::invalid_argument listing every impossible parameter.
  virtual void initialize(const StrategyContext& context) = 0;

  /// In a map whose last image is not older than `min_map_stamp` (zero: any). May throw SelectionCancelled in place of a
  /// selection that says so. Throws MapUnavailable; std::runtime_error if
  /// the map stops answering; std::invalid_argument for an impossible request.
  virtual nbv_selection::Selection select(const nbv_selection::SelectionRequest& request,
                                          const nbv_selection::FailureMemory& failures, const ros::Time& min_map_stamp,
                                          const Tell& tell, const IsCancelled& is_cancelled) = 0;

  /// About its map.
  virtual void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status) const = 0;

  /// All its parameters, as YAML.
  virtual std::string configuration() const = 0;
};

}  // namespace nbv_selection_ros
