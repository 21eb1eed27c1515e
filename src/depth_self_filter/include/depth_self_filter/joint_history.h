// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <interactive_mapping_common/config/schema.h>

#include "mp700_ur5e_description/robot_model.h"

namespace depth_self_filter {

struct JointHistoryConfig {
  // A joint that accelerates at 10 rad/s^2 leaves the straight line by a (t/2)^2 / 2 = 13 mrad in that time. That is
  // about the padding at the end of the arm.
  double max_gap_s{0.1};
  double memory_s{5.0};

  static void fields(JointHistoryConfig& c, interactive_mapping::Fields& f) {
    f("max_gap_s", c.max_gap_s, 0.0, 10.0, "s", "longest gap between the joint states before and after an image");
    f("memory_s", c.memory_s, 0.1, 600.0, "s", "older joint states are forgotten");
  }
};

/// Joint positions of the last seconds, and between them. Joints may come in any order, in several messages, and in the
/// company of others. Those that move no shape (wheels, see movesShapes()) need never come: they are at zero.
class JointHistory {
 public:
  enum class Verdict {
    kKnown,
    kNotYet,      // nothing at or after the stamp yet: waiting may help
    kNeverHeard,  // of some joint: waiting may help
    kGap,         // the two joint states about the stamp are too far apart
    kForgotten,   // the stamp is before all that is remembered
  };
  struct Answer {
    Verdict verdict{Verdict::kKnown};
    Eigen::VectorXd positions_rad;  // in the order of the robot's joints(); only if known
    std::string message;            // why not known: which joint, what was seen, what is allowed
  };

  /// Throws std::invalid_argument listing every impossible value.
  JointHistory(std::shared_ptr<const mp700_ur5e_description::RobotModel> robot, const JointHistoryConfig& config);

  /// One message, as it came. Returns why it is left out, as a whole; empty: taken. A stamp before the last one of a
  /// joint is left out for that joint. If it is 1 s before or more, that joint's history starts again: a looped bag, a
  /// restarted simulation.
  std::string add(double stamp_s, const std::vector<std::string>& names, const std::vector<double>& positions_rad);

  Answer at(double stamp_s) const;

 private:
  struct Sample {
    double stamp_s;
    double position_rad;
  };

  const std::shared_ptr<const mp700_ur5e_description::RobotModel> robot_;
  const JointHistoryConfig config_;
  std::vector<bool> is_needed_;              // by joint
  std::vector<std::deque<Sample>> samples_;  // by joint, stamps rising
};

}  // namespace depth_self_filter
