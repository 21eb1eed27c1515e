// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <opencv2/core.hpp>

#include "synthetic_depth/scene.h"

namespace synthetic_depth {

/// Depth units of the PNG files (TUM RGB-D convention).
constexpr double kTumUnitsPerMetre = 5000.0;

struct SequenceOptions {
  int num_frames{-1};       ///< only the first so many; -1 = all
  bool apply_sensor{true};  ///< false: exact depth within the sensor's range limits
  bool write_raw{false};    ///< also frames.f32 and poses.f64, see writeTumSequence()
  /// Called after each frame with (frames done, frames in total); may be empty.
  std::function<void(int, int)> on_progress;
};

struct SequenceStatistics {
  int num_frames{0};
  double valid_fraction{0.0};  ///< share of pixels with a finite measurement, over all frames
  double render_ms{0.0};       ///< mean per frame, exact rendering only
  double sensor_ms{0.0};       ///< mean per frame
};

/// Writes a TUM RGB-D folder: depth.txt, depth/NNNNNN.png (16 bit, 5000 units per metre, 0 = invalid), groundtruth.txt
/// (T_map_camera of the optical frame: timestamp tx ty tz qx qy qz qw), camera_info.yaml (camera_info_manager layout and
/// depth_units_per_metre) and ground_truth.yaml (boxes, what vanishes when, T_map_scene, sensor).
/// With write_raw: frames.f32 = float32 metres, row major, frame after frame, REP-117 values kept; poses.f64 = one
/// row-major 4x4 T_map_camera per frame; both in the machine's byte order.
/// The folder is made if missing and files of the same name are replaced. Throws std::invalid_argument for num_frames out
/// of [1, scene.numFrames()], std::runtime_error if a file cannot be written.
SequenceStatistics writeTumSequence(const Scene& scene, const std::string& directory, const SequenceOptions& options);

struct TumFrame {
  double stamp_s{0.0};
  std::string depth_path;  ///< directory included
  Eigen::Isometry3d T_map_camera{Eigen::Isometry3d::Identity()};
};

/// Reads depth.txt and groundtruth.txt back; a frame gets the pose of the same stamp (within 1 us).
/// Throws std::runtime_error if a file is missing or malformed or a frame has no pose.
std::vector<TumFrame> readTumSequence(const std::string& directory);

/// One depth/NNNNNN.png in metres, CV_32FC1, NaN where invalid. Throws std::runtime_error if it is not a 16-bit image.
cv::Mat readTumDepth(const std::string& path);

}  // namespace synthetic_depth
