// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "system_diagnostics/delay_statistics.h"
#include "system_diagnostics/image_shift.h"
#include "system_diagnostics/time_offset_estimator.h"
#include "system_diagnostics/transform_watch.h"

namespace system_diagnostics_ros {

/// One transform that is watched: pose of `source` in `target`, as `tf_echo target source` has it.
struct WatchedTransform {
  std::string target;
  std::string source;
  system_diagnostics::TransformWatchConfig limits;  // its window_s is the node's
};

/// All parameters of the node, with the only copy of the defaults. SI units.
struct SystemDiagnosticsParams {
  SystemDiagnosticsParams();

  double window_s{10.0};                                     // of rates, gaps, jumps and delays
  std::string watched{"localisation odometry camera tool"};  // names below tf/
  std::map<std::string, WatchedTransform> transforms;        // by name

  system_diagnostics::DelayStatisticsConfig arrival;  // its window_s is the node's

  struct Motion {
    bool enabled{true};           // false: images are not looked at, only their stamps
    double warn_offset_s{0.02};   // at 0.6 rad/s a camera turns 12 mrad in that: 2.4 cm at 2 m
    double error_offset_s{0.05};  // 30 mrad, 6 cm at 2 m: as wide as the magnet
    system_diagnostics::TimeOffsetConfig estimator;
    system_diagnostics::ImageShiftConfig image;
  } motion;

  /// Every problem as "key = value unit, must be ...".
  std::vector<std::string> validate() const;
};

/// In the layout of config/system_diagnostics.yaml.
std::string toYaml(const SystemDiagnosticsParams& params);

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
SystemDiagnosticsParams loadSystemDiagnosticsParams(const ros::NodeHandle& private_nh);

}  // namespace system_diagnostics_ros
