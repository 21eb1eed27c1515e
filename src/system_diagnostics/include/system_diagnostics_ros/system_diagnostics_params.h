// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include <interactive_mapping_common/config/schema.h>
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

  static void fields(WatchedTransform& c, interactive_mapping::Fields& f) {
    f("target", c.target, "the pose of source in target is watched, as `tf_echo target source` prints it");
    f("source", c.source, "see target");
    system_diagnostics::TransformWatchConfig::fields(c.limits, f);
    f.require(!c.target.empty() && c.target.front() != '/',
              "target = '" + c.target + "', must be a tf2 frame: no leading slash");
    f.require(!c.source.empty() && c.source.front() != '/',
              "source = '" + c.source + "', must be a tf2 frame: no leading slash");
  }
};

/// All parameters of the node. SI units.
struct SystemDiagnosticsParams {
  double window_s{10.0};

  struct Tf {
    Tf();
    std::string watched{"localisation odometry camera tool"};
    std::map<std::string, WatchedTransform> transforms;  // by name; from fields() on those watched

    static void fields(Tf& c, interactive_mapping::Fields& f) {
      f("watched", c.watched, "names of the sections below that are used; you may add sections of your own");
      const std::vector<std::string> names = c.select();
      std::set<std::string> done;
      for (const std::string& name : names) {
        if (done.insert(name).second) f.section(name.c_str(), c.transforms.at(name));
      }
      f.require(done.size() == names.size(), "watched = '" + c.watched + "', must name each once");
    }

   private:
    /// The names in `watched`. Afterwards there are transforms of these names only.
    std::vector<std::string> select();
  } tf;

  system_diagnostics::DelayStatisticsConfig arrival;  // its window_s is the node's

  struct Motion {
    bool enabled{true};
    double warn_offset_s{0.02};
    double error_offset_s{0.05};
    system_diagnostics::TimeOffsetConfig estimator;
    system_diagnostics::ImageShiftConfig image;

    static void fields(Motion& c, interactive_mapping::Fields& f) {
      f("enabled", c.enabled,
        "estimates the offset of the camera's stamps while the base turns; false: images are only timed");
      f("warn_offset_s", c.warn_offset_s, 0.0, 10.0, "s",
        "larger offset that gives a warning: at 0.6 rad/s a camera turns 12 mrad in 0.02 s, 2.4 cm at 2 m");
      f("error_offset_s", c.error_offset_s, c.warn_offset_s, 10.0, "s",
        "larger offset that gives an error, at least warn_offset_s: in 0.05 s 6 cm at 2 m, the width of the magnet");
      system_diagnostics::TimeOffsetConfig::fields(c.estimator, f);
      system_diagnostics::ImageShiftConfig::fields(c.image, f);
    }
  } motion;

  static void fields(SystemDiagnosticsParams& c, interactive_mapping::Fields& f) {
    f("window_s", c.window_s, 1.0, 3600.0, "s", "rates, gaps, jumps and delays are those of this last time");
    f.section("tf", c.tf);
    f.section("arrival", c.arrival);
    f.section("motion", c.motion);
  }
};

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
SystemDiagnosticsParams loadSystemDiagnosticsParams(const ros::NodeHandle& private_nh);

}  // namespace system_diagnostics_ros
