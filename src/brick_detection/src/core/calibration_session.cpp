// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/calibration_session.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <opencv2/imgproc.hpp>

#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/formatted.h>

#include "rotation.h"

namespace brick_detection {
namespace {

using interactive_mapping::formatted;
using mp700_ur5e_description::BrickCatalogue;
using mp700_ur5e_description::BrickFace;
using mp700_ur5e_description::BrickTag;

// A sample must be that far from each earlier one, or turned by that much: equal ones add confidence, not knowledge.
constexpr double kMinStep_m = 0.05;
constexpr double kMinStep_rad = 0.17;
// Between looks at an arm that stands still. A UR5e repeats to 0.03 mm; the rest is for encoders' noise.
constexpr double kStill_m = 0.0005;
constexpr double kStill_rad = 0.001;

std::string apart(double distance_m, double angle_rad) {
  return formatted("%.1f mm and %.2f deg", 1e3 * distance_m, kToDeg * angle_rad);
}

double distanceBetween(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return (a.translation() - b.translation()).norm();
}

double angleBetween(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return Eigen::Quaterniond(a.linear()).angularDistance(Eigen::Quaterniond(b.linear()));
}

/// A target is made with care, and what its labels are off stays the same: the solution takes it up.
BrickPoseConfig withFlatLabels(BrickPoseConfig config) {
  config.label_std_m = 0.0;
  return config;
}

TagDetectorConfig detectorOf(const BrickCatalogue& catalogue) {
  TagDetectorConfig config;
  config.family = catalogue.tags.family;
  return config;
}

}  // namespace

BrickCatalogue loneTag(const std::string& family, int tag_id, double edge_m) {
  if (!(edge_m > 0.0 && edge_m <= 2.0)) {
    throw std::invalid_argument("edge_m = " + std::to_string(edge_m) + " m, must be in (0, 2] m");
  }
  if (tag_id < 0) throw std::invalid_argument("tag_id = " + std::to_string(tag_id) + ", must be at least 0");
  BrickCatalogue catalogue;
  mp700_ur5e_description::BrickType board;
  board.name = "target";
  catalogue.tags.family = family;
  catalogue.tags.black_border_edge_m = edge_m;
  catalogue.tags.num_bricks = 0;
  // Of no meaning, but that the tag is inside.
  board.size_m.setConstant(2.0 * edge_m);
  catalogue.types = {board};
  BrickTag tag;
  tag.face = BrickFace::kPlusZ;
  tag.black_border_edge_m = edge_m;
  catalogue.bricks = {{0, board.name, {{tag_id, tag}}}};
  interactive_mapping::refuseIfAny("impossible brick catalogue:", catalogue.validate());
  return catalogue;
}

TargetFinder::TargetFinder(const BrickCatalogue& catalogue, int brick_id, const BrickPoseConfig& pose)
    : brick_id_(brick_id),
      estimator_(catalogue, withFlatLabels(pose)),
      detector_(makeTagDetector(detectorOf(catalogue))) {
  catalogue.typeOf(brick_id);  // throws if there is none
}

std::optional<BrickSighting> TargetFinder::find(const cv::Mat& image, const cv::Mat& depth_m, const CameraModel& camera,
                                                std::string* why_not) {
  cv::Mat grey = image;
  if (image.channels() == 3) cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  const BrickPoseEstimator::Result found = estimator_.estimate(detector_->detect(grey), camera, depth_m, grey);
  std::optional<BrickSighting> target;
  int count = 0;
  for (const BrickSighting& brick : found.bricks) {
    if (brick.brick_id != brick_id_) continue;
    ++count;
    target = brick;
  }
  if (count == 1 && !target->has_duplicate) return target;
  if (count > 0) {
    *why_not = "the target is seen more than once: is there another brick with its id?";
    return std::nullopt;
  }
  *why_not = "the target is not in view";
  for (const TagSighting& tag : found.tags) {
    if (tag.brick_id != brick_id_) continue;
    *why_not = formatted("the target is in view, but tag %d is of no use: %s (shortest side %.0f px)", tag.tag.id,
                         toString(tag.status), tag.tag.shortestSide());
  }
  return std::nullopt;
}

CalibrationSession::CalibrationSession(const CalibrationSessionConfig& config) : config_(config) {
  interactive_mapping::requireValid("impossible calibration:", config);
}

std::string CalibrationSession::whyNotStill(const std::vector<Eigen::Isometry3d>& T_base_tool) const {
  if (T_base_tool.empty()) throw std::invalid_argument("T_base_tool must hold at least one pose");
  double step_m = 0.0;
  double step_rad = 0.0;
  for (const Eigen::Isometry3d& T : T_base_tool) {
    step_m = std::max(step_m, distanceBetween(T, T_base_tool.back()));
    step_rad = std::max(step_rad, angleBetween(T, T_base_tool.back()));
  }
  if (step_m <= kStill_m && step_rad <= kStill_rad) return "";
  return "the arm moves: " + apart(step_m, step_rad) + ", at most " + apart(kStill_m, kStill_rad) +
         " count as stationary";
}

std::string CalibrationSession::whyNotNew(const Eigen::Isometry3d& T_base_tool) const {
  for (std::size_t i = 0; i < samples_.size(); ++i) {
    const double step_m = distanceBetween(T_base_tool, samples_[i].T_base_tool);
    const double step_rad = angleBetween(T_base_tool, samples_[i].T_base_tool);
    if (step_m < kMinStep_m && step_rad < kMinStep_rad) {
      return "too like sample " + std::to_string(i) + ": " + apart(step_m, step_rad) + " from it, at least " +
             apart(kMinStep_m, kMinStep_rad) + " are needed";
    }
  }
  return "";
}

bool CalibrationSession::discardLast() {
  if (samples_.empty()) return false;
  samples_.pop_back();
  return true;
}

std::string residualTable(const HandEyeResult& result) {
  std::string text = "sample   place [mm]   turn [deg]\n";
  for (std::size_t i = 0; i < result.residuals.size(); ++i) {
    const HandEyeResult::Residual& residual = result.residuals[i];
    text += formatted("%6zu %12.2f %12.3f%s\n", i, 1e3 * residual.translation_m, kToDeg * residual.rotation_rad,
                      residual.is_outlier ? "   left out" : "");
  }
  if (!result.isGood()) return text + result.reason;
  text += formatted("   rms %12.2f %12.3f   of %d samples, %.1f times what was expected\n", 1e3 * result.rms_m,
                    kToDeg * result.rms_rad, result.num_used, result.noise_factor);
  text += formatted("others %12.2f %12.3f   each predicted by all others\n", 1e3 * result.leave_one_out_rms_m,
                    kToDeg * result.leave_one_out_rms_rad);
  const Eigen::Matrix<double, 6, 1> std = result.covariance.diagonal().cwiseSqrt();
  return text + formatted("camera in the base: +-(%.2f, %.2f, %.2f) mm, +-(%.3f, %.3f, %.3f) deg", 1e3 * std[0],
                          1e3 * std[1], 1e3 * std[2], kToDeg * std[3], kToDeg * std[4], kToDeg * std[5]);
}

}  // namespace brick_detection
