// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <mp700_ur5e_description/brick_types.h>
#include <opencv2/core.hpp>

#include "brick_detection/camera_model.h"
#include "brick_detection/depth_plane.h"
#include "brick_detection/pose_refinement.h"
#include "brick_detection/tag_detector.h"

namespace brick_detection {

/// What a decoded tag was good for; the constants of interactive_mapping_msgs/TagSighting.
enum class TagStatus : std::uint8_t {
  kUsed = 0,
  kUnknownId = 1,
  kTooSmall = 2,
  kUnsure = 3,
  kAmbiguous = 4,
  kContradictsDepth = 5,
  kInconsistent = 6
};
const char* toString(TagStatus status);

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
  double corner_std_px{0.25};  ///< of a corner's coordinates: detector, blur, what calibration leaves
  double min_side_px{12.0};    ///< tags with a shorter side are not used
  double min_margin{8.0};      ///< of the decision [grey levels]; a tenth of full light leaves some 10
  int max_hamming{1};
  double max_reprojection_px{1.5};  ///< root mean square of a tag's corners
  /// Of the two poses that fit a flat square, the second may stand unless its corners fit worse than the first's by
  /// this chi-square (one degree of freedom): below it, depth or another tag must decide.
  double ambiguity_chi2{15.0};
  /// A pose must be known that well. Two poses nearer to each other are no ambiguity: the covariance then spans both.
  double max_rotation_std_rad{0.20};
  /// By how much a label may stand off its face, as a whole or at one side: of a brick that is seen by one tag only.
  double label_std_m{0.002};
  /// Between a tag and its depth plane, in distance and normal: standard deviations of the plane, systematic parts and
  /// what the corners leave open included. The final pose is held to the plane's own.
  double max_depth_sigmas{4.0};
  /// Tags of one id belong to one brick if their poses of it agree to that; else several bricks carry the id.
  double same_brick_m{0.04};
  double same_brick_rad{0.30};
  DepthPlaneConfig depth;

  std::vector<std::string> validate() const;
};

/// Corners of a tag's black border in its frame, in the order of TagObservation.
std::array<Eigen::Vector3d, 4> tagCorners(double edge_m);

/// Both poses T_camera_tag of a square seen in an image (IPPE, Collins and Bartoli 2014), each moved to its minimum of the
/// reprojection error, best first. The second is missing where it is not in front of the camera or has the same minimum;
/// both are where the corners are not those of a square's printed side. `edge_m`: of the black border; throws
/// std::invalid_argument unless positive.
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
