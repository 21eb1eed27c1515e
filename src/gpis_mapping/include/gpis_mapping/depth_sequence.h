// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_DEPTH_SEQUENCE_H
#define GPIS_MAPPING_DEPTH_SEQUENCE_H

#include <cstddef>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <Eigen/Geometry>

#include <depth_camera/pose_guard.h>
#include "gpis_mapping/types.h"

namespace gpis_mapping {

/// A recording that cannot be used. what() names the file, the line where there is one, and the reason.
class DepthSequenceError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// One depth image with the pose it was taken from.
struct DepthFrame {
  DepthImage image;
  Eigen::Isometry3d T_map_camera{Eigen::Isometry3d::Identity()};  // optical frame to map
  double stamp_s{0.0};
  std::string name;  // for messages: file or topic and stamp
};

/// Why a frame was left out.
struct SkipReason {
  std::string kind;    // the same for all frames with the same trouble, fit for counting
  std::string detail;  // what was seen and what is allowed
};

/// A recording of depth images with poses, frames numbered from 0 in recorded order.
class DepthSequence {
 public:
  virtual ~DepthSequence() = default;

  virtual std::size_t size() const = 0;

  /// The same for all frames: an ideal pinhole, to which the images of a camera with lens distortion are resampled.
  virtual const CameraModel& camera() const = 0;

  /// Frame `i`, or nothing and the reason when it has no pose. Throws DepthSequenceError if the image is missing or not
  /// what it must be, std::out_of_range for i >= size().
  virtual std::optional<DepthFrame> frame(std::size_t i, SkipReason* reason) = 0;

  /// The pose of frame `i` when `time_offset_s` is added to its stamp, or nothing and the reason. Its stamp_s is the
  /// frame's own. Reads no image. Throws DepthSequenceError if what holds the pose is malformed.
  virtual std::optional<depth_camera::StampedPose> pose(std::size_t i, double time_offset_s, SkipReason* reason) = 0;

  /// Whether stamps come from a clock and frames in its order. Lists may repeat and reorder images.
  virtual bool hasClock() const { return false; }

  /// Whether poses have stamps of their own, so that an image can be given that of another time.
  virtual bool hasPoseStamps() const { return true; }

  /// What is added to an image's stamp before its pose is looked up [s]: negative when the images are stamped too late.
  /// frame() uses it from now on. Throws DepthSequenceError for anything but 0 when poses have no stamps.
  void setTimeOffset(double time_offset_s) {
    if (time_offset_s != 0.0 && !hasPoseStamps()) {
      throw DepthSequenceError("the recording's poses have no stamps: a time offset cannot be applied");
    }
    time_offset_s_ = time_offset_s;
  }
  double timeOffset() const { return time_offset_s_; }

  /// What the user should know about the recording although it can be used. One sentence each.
  const std::vector<std::string>& notes() const { return notes_; }

 protected:
  std::vector<std::string> notes_;

 private:
  double time_offset_s_{0.0};
};

/// Opens a TUM RGB-D folder (depth.txt, groundtruth.txt, camera_info.yaml with optional distortion_model,
/// distortion_coefficients and depth_units_per_metre, default 5000) or a 7-Scenes folder (frame-*.depth.png, default
/// 1000, frame-*.pose.txt, camera-intrinsics.txt).
/// TUM poses are interpolated (linear, slerp) to the image's stamp. The poses around it must be at most 0.1 s apart, or
/// one must be within 0.02 s. Before the first and after the last pose only the latter counts. A TUM pose that is not
/// finite or all 0 is a lost one, and left out. A camera with fy < 0 (y up, as in ICL-NUIM) has its images turned
/// upside down; its poses stay. It must have no distortion. `units_per_metre` [1/m], if given, counts instead of the
/// layout's and the file's. Throws DepthSequenceError for everything else and for any malformed line.
std::unique_ptr<DepthSequence> openDepthSequence(const std::string& path,
                                                 std::optional<double> units_per_metre = std::nullopt);

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_DEPTH_SEQUENCE_H
