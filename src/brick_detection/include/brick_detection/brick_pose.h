// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_enums/tag_sighting.h>
#include <mp700_ur5e_description/brick_types.h>
#include <opencv2/core.hpp>

#include "brick_detection/camera_model.h"
#include "brick_detection/depth_plane.h"
#include "brick_detection/pose_refinement.h"
#include "brick_detection/tag_detector.h"

namespace brick_detection {

using interactive_mapping::TagStatus;

struct TagSighting {
  TagObservation tag;
  TagStatus status{TagStatus::kUsed};
  int brick_id{-1};
  mp700_ur5e_description::BrickFace face{mp700_ur5e_description::BrickFace::kPlusX};
};

/// One brick in one image.
struct BrickSighting {
  int brick_id{0};
  Eigen::Isometry3d T_camera_brick{Eigen::Isometry3d::Identity()};
  /// Of (translation [m], rotation [rad]), both along the camera's axes: the true pose is t + dt, exp(dr) R.
  Matrix6d covariance{Matrix6d::Identity()};
  std::vector<mp700_ur5e_description::BrickFace> faces;  ///< whose tags were used
  bool has_depth{false};                                 ///< the depth image took part
  bool has_duplicate{false};                             ///< another brick in this image carries the same id
  double reprojection_rms_px{0.0};
};

struct BrickPoseConfig {
  double corner_std_px{0.25};
  double min_side_px{12.0};
  double min_margin{8.0};  // a tenth of full light leaves some 10
  int max_hamming{1};
  double max_rotation_std_rad{0.20};
  double label_std_m{0.002};
  double same_brick_m{0.04};
  double same_brick_rad{0.30};
  DepthPlaneConfig depth;

  static void cornerFields(BrickPoseConfig& c, interactive_mapping::Fields& f) {
    f("corner_std_px", c.corner_std_px, 0.01, 10.0, "px",
      "standard deviation of the coordinates of a corner, from detector, blur and calibration");
    f("min_side_px", c.min_side_px, 1.0, 1000.0, "px", "tags with a shorter side are not used");
  }

  static void fields(BrickPoseConfig& c, interactive_mapping::Fields& f) {
    cornerFields(c, f);
    f("min_margin", c.min_margin, 0.0, 255.0, "grey levels", "tags decoded with a smaller margin are not used");
    f("max_hamming", c.max_hamming, 0, 10, "bits", "tags with more corrected bits are not used");
    f("max_rotation_std_rad", c.max_rotation_std_rad, 0.001, 1.0, "rad",
      "tags whose rotation is known less well are not used; two poses nearer to each other are no ambiguity");
    f("label_std_m", c.label_std_m, 0.0, 0.1, "m",
      "standard deviation of a label off its face, as a whole or at one side: of bricks seen by one tag only");
    f("same_brick_m", c.same_brick_m, 0.001, 1.0, "m",
      "tags whose poses of a brick differ by more show several bricks with one id");
    f("same_brick_rad", c.same_brick_rad, 0.01, 1.5, "rad", "the same of their orientation");
    f.section("depth", c.depth);
  }
};

/// Corners of a tag's black border in its frame, in the order of TagObservation.
std::array<Eigen::Vector3d, 4> tagCorners(double edge_m);

/// Both poses T_camera_tag of a square seen in an image (IPPE, Collins and Bartoli 2014). Each is moved to its minimum
/// of the reprojection error; the best comes first. The second is missing where it is not in front of the camera or has
/// the same minimum. Both are missing where the corners are not those of a square's printed side. `edge_m`: of the
/// black border; throws std::invalid_argument unless positive.
struct TagPose {
  Eigen::Isometry3d T_camera_tag{Eigen::Isometry3d::Identity()};
  double reprojection_rms_px{0.0};
};
std::vector<TagPose> tagPoses(const std::array<Eigen::Vector2d, 4>& corners_px, double edge_m,
                              const CameraModel& camera);

/// From decoded tags to bricks, one image at a time. Thread-safe: keeps nothing between calls.
class BrickPoseEstimator {
 public:
  struct Result {
    std::vector<BrickSighting> bricks;  ///< in order of id; an id as often as bricks carry it
    std::vector<TagSighting> tags;      ///< one for each that was given, in the same order
  };

  /// Throws std::invalid_argument listing what is wrong with the config.
  BrickPoseEstimator(const mp700_ur5e_description::BrickCatalogue& catalogue, const BrickPoseConfig& config);

  /// `depth_m`: as fitDepthPlane() has it, registered to the colour camera; may be empty. The poses of all tags of a
  /// brick are refined together: reprojection of every corner, and every tag's plane. `grey`: CV_8UC1, the image that the
  /// tags are of; their cells are compared with it. Empty: the corners are believed. Throws std::invalid_argument if
  /// the depth image is not of the camera's size, or the camera is impossible.
  Result estimate(const std::vector<TagObservation>& tags, const CameraModel& camera, const cv::Mat& depth_m,
                  const cv::Mat& grey = cv::Mat()) const;

  const mp700_ur5e_description::BrickCatalogue& catalogue() const { return catalogue_; }
  const BrickPoseConfig& config() const { return config_; }

 private:
  mp700_ur5e_description::BrickCatalogue catalogue_;
  BrickPoseConfig config_;
};

}  // namespace brick_detection
