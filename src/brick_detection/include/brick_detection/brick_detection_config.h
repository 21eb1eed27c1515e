// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "brick_detection/brick_pose.h"
#include "brick_detection/brick_tracker.h"
#include "brick_detection/face_access.h"
#include "brick_detection/marker_sightings.h"
#include "brick_detection/tag_detector.h"

namespace brick_detection {

/// All settings of a BrickDetector. `detector.family` is not one of them: bricks.yaml says it.
struct BrickDetectionConfig {
  TagDetectorConfig detector;
  BrickPoseConfig pose;
  MarkerConfig alvar;
  BrickTrackerConfig tracker;
  FaceAccessConfig access;

  /// One sentence per problem with key, value and allowed range; empty: fine.
  std::vector<std::string> validate() const;
};

/// The one table of all keys: visit(key, value) for each, key with its sections ("pose/depth/grow").
template <typename Config, typename Visitor>
void visitFields(Config& config, Visitor&& visit) {
  visit("detector/threads", config.detector.threads);
  visit("detector/decimate", config.detector.decimate);
  visit("detector/blur_sigma_px", config.detector.blur_sigma_px);
  visit("detector/sharpening", config.detector.sharpening);
  visit("detector/max_hamming", config.detector.max_hamming);
  visit("pose/corner_std_px", config.pose.corner_std_px);
  visit("pose/min_side_px", config.pose.min_side_px);
  visit("pose/min_margin", config.pose.min_margin);
  visit("pose/max_hamming", config.pose.max_hamming);
  visit("pose/max_reprojection_px", config.pose.max_reprojection_px);
  visit("pose/ambiguity_chi2", config.pose.ambiguity_chi2);
  visit("pose/max_rotation_std_rad", config.pose.max_rotation_std_rad);
  visit("pose/label_std_m", config.pose.label_std_m);
  visit("pose/max_depth_sigmas", config.pose.max_depth_sigmas);
  visit("pose/same_brick_m", config.pose.same_brick_m);
  visit("pose/same_brick_rad", config.pose.same_brick_rad);
  visit("pose/depth/grow", config.pose.depth.grow);
  visit("pose/depth/inverse_depth_std", config.pose.depth.inverse_depth_std);
  visit("pose/depth/correlation_px", config.pose.depth.correlation_px);
  visit("pose/depth/systematic_m", config.pose.depth.systematic_m);
  visit("pose/depth/systematic_rad", config.pose.depth.systematic_rad);
  visit("pose/depth/min_coverage", config.pose.depth.min_coverage);
  visit("pose/depth/min_inlier_share", config.pose.depth.min_inlier_share);
  visit("pose/depth/min_pixels", config.pose.depth.min_pixels);
  visit("alvar/position_std_m", config.alvar.position_std_m);
  visit("alvar/rotation_std_rad", config.alvar.rotation_std_rad);
  visit("alvar/same_brick_m", config.alvar.same_brick_m);
  visit("alvar/same_brick_rad", config.alvar.same_brick_rad);
  visit("tracker/camera_std_m", config.tracker.camera_std_m);
  visit("tracker/camera_std_rad", config.tracker.camera_std_rad);
  visit("tracker/standpoint_m", config.tracker.standpoint_m);
  visit("tracker/standpoint_rad", config.tracker.standpoint_rad);
  visit("tracker/looks_per_standpoint", config.tracker.looks_per_standpoint);
  visit("tracker/floor_std_m", config.tracker.floor_std_m);
  visit("tracker/floor_std_rad", config.tracker.floor_std_rad);
  visit("tracker/gate_chi2", config.tracker.gate_chi2);
  visit("tracker/moved_looks", config.tracker.moved_looks);
  visit("tracker/free_share", config.tracker.free_share);
  visit("tracker/inside_samples", config.tracker.inside_samples);
  visit("access/corridor_m", config.access.corridor_m);
  visit("access/tool_radius_m", config.access.tool_radius_m);
  visit("access/gap_m", config.access.gap_m);
  visit("access/sample_m", config.access.sample_m);
  visit("access/max_down_rad", config.access.max_down_rad);
  visit("access/unknown_weight", config.access.unknown_weight);
  visit("access/min_clear", config.access.min_clear);
}

}  // namespace brick_detection
