// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>
#include <mp700_ur5e_description/brick_types.h>
#include <opencv2/core.hpp>

#include "brick_detection/brick_pose.h"
#include "brick_detection/hand_eye.h"
#include "brick_detection/tag_detector.h"

namespace brick_detection {

/// A catalogue with nothing but one tag, whose "brick" frame is the tag's: for a target that is no brick. `edge_m`: of the
/// black border. Throws std::invalid_argument for an unknown family, an id outside it, or an edge that is not positive.
mp700_ur5e_description::BrickCatalogue loneTag(const std::string& family, int tag_id, double edge_m);

/// Finds one brick, the target, in an image. Not thread-safe.
class TargetFinder {
 public:
  /// Throws std::invalid_argument for a brick that the catalogue does not have, and for impossible configs.
  TargetFinder(const mp700_ur5e_description::BrickCatalogue& catalogue, int brick_id, const BrickPoseConfig& pose);

  /// `image`: CV_8UC1, or CV_8UC3 (blue, green, red); `depth_m`: as BrickPoseEstimator has it, may be empty. Nothing, and
  /// the reason, if the target is not seen, seen twice, or not seen well enough.
  std::optional<BrickSighting> find(const cv::Mat& image, const cv::Mat& depth_m, const CameraModel& camera,
                                    std::string* why_not);

 private:
  int brick_id_;
  BrickPoseEstimator estimator_;
  std::unique_ptr<TagDetector> detector_;
};

struct CalibrationSessionConfig {
  HandEyeConfig hand_eye;

  static void fields(CalibrationSessionConfig& c, interactive_mapping::Fields& f) { f.section("hand_eye", c.hand_eye); }
};

/// The samples of one calibration, and what makes one worth taking. Not thread-safe.
class CalibrationSession {
 public:
  /// Throws std::invalid_argument listing what is wrong with the config.
  explicit CalibrationSession(const CalibrationSessionConfig& config);

  /// Empty if the tool was at one place all the time; else what moved. Throws std::invalid_argument for no pose at all.
  std::string whyNotStill(const std::vector<Eigen::Isometry3d>& T_base_tool) const;

  /// Empty if a sample at this pose adds something; else which earlier one it is too like.
  std::string whyNotNew(const Eigen::Isometry3d& T_base_tool) const;

  void add(const HandEyeSample& sample) { samples_.push_back(sample); }
  /// False if there was none.
  bool discardLast();

  HandEyeResult solve() const { return solveHandEye(samples_, config_.hand_eye); }

  const std::vector<HandEyeSample>& samples() const { return samples_; }

 private:
  CalibrationSessionConfig config_;
  std::vector<HandEyeSample> samples_;
};

/// A line per sample, then the sums, for people.
std::string residualTable(const HandEyeResult& result);

}  // namespace brick_detection
