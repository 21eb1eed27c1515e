// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <limits>
#include <string>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>

#include "system_diagnostics/level.h"

namespace system_diagnostics {

struct TransformWatchConfig {
  bool may_be_static{false};
  double min_rate_hz{5.0};
  double max_age_s{0.5};
  double max_ahead_s{0.02};
  double max_gap_s{0.5};
  double step_m{0.05};
  double speed_m_s{0.0};
  double step_rad{0.05};
  double speed_rad_s{0.0};
  double window_s{10.0};  // of rate, gaps and jumps, [1, 3600] s; no field: that of the whole node

  static void fields(TransformWatchConfig& c, interactive_mapping::Fields& f) {
    f("may_be_static", c.may_be_static, "a transform without time is good, as of mounted parts");
    f("min_rate_hz", c.min_rate_hz, 0.0, 1000.0, "Hz", "fewer new poses give a warning");
    f("max_age_s", c.max_age_s, 0.001, 1000.0, "s", "an older newest pose gives an error");
    f("max_ahead_s", c.max_ahead_s, 0.0, 10.0, "s",
      "a newest pose stamped farther in the future gives a warning; amcl does so by 0.1 s on purpose");
    f("max_gap_s", c.max_gap_s, 0.001, 1000.0, "s", "a longer time without a pose gives a warning");
    f("step_m", c.step_m, 0.0, 100.0, "m",
      "a motion from pose to pose of more than step_m + speed_m_s * time is a jump, which gives a warning");
    f("speed_m_s", c.speed_m_s, 0.0, 100.0, "m/s", "see step_m");
    f("step_rad", c.step_rad, 0.0, 4.0, "rad", "a turn of more than step_rad + speed_rad_s * time is a jump, too");
    f("speed_rad_s", c.speed_rad_s, 0.0, 100.0, "rad/s", "see step_rad");
  }
};

struct TransformReport {
  Verdict verdict;
  bool is_static{false};
  double rate_hz{0.0};                                     // of new poses, in the window
  double age_s{std::numeric_limits<double>::quiet_NaN()};  // of the newest pose, by its stamp; < 0: ahead
  double longest_gap_s{0.0};                               // between stamps, in the window
  int jumps{0};                                            // in the window
  int total_jumps{0};                                      // since the start
  double largest_jump_m{0.0};                              // in the window; of whatever was one, length ...
  double largest_jump_rad{0.0};                            // ... and angle
};

/// Judges one transform by the poses that tf gave for it: how often, how old, how steady. ROS-free; times are seconds of
/// one clock.
class TransformWatch {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  TransformWatch(std::string name, const TransformWatchConfig& config);

  /// A pose, T_target_source, that tf has newly had for `stamp_s`. Stamps that are not later than the newest one are
  /// not new and are left out. Poses that are not finite are kept as an error.
  void add(double stamp_s, const Eigen::Isometry3d& pose);

  /// tf has it without time.
  void addStatic(const Eigen::Isometry3d& pose);

  TransformReport report(double now_s) const;

  /// As new: the clock went back.
  void clear();

  const std::string& name() const { return name_; }

 private:
  struct Sample {
    double stamp_s;
    double gap_s;  // since the one before; 0: none
    bool is_jump;
    double moved_m;
    double moved_rad;
  };

  void forgetBefore(double stamp_s);

  std::string name_;
  TransformWatchConfig config_;
  std::deque<Sample> samples_;  // those within window_s before the newest
  double first_stamp_s_{std::numeric_limits<double>::quiet_NaN()};
  Eigen::Isometry3d last_pose_{Eigen::Isometry3d::Identity()};
  bool has_pose_{false};
  bool is_static_{false};
  bool is_finite_{true};
  int total_jumps_{0};
};

}  // namespace system_diagnostics
