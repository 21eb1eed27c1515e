// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_DEPTH_CLASSIFIER_H
#define GPIS_MAPPING_DEPTH_CLASSIFIER_H

#include <cstdint>
#include <vector>

#include "gpis_mapping/gpis_config.h"
#include "gpis_mapping/types.h"

namespace gpis_mapping {

/// What a pixel of this camera has done so far.
enum class PixelHistory : std::uint8_t {
  kUnknown,
  kMeasures,
  kNeverMeasures,  // not in ten images with a depth at more than half of their pixels: a margin of the sensor
};

enum class PixelKind : std::uint8_t {
  kSurface,        // a depth was measured
  kWall,           // nothing within reach: the virtual wall stands there
  kHole,           // depth 0 with no reason in sight: no evidence by itself (see vanished_surface.h)
  kNoInformation,  // shadow, too close, masked, a single dropout
};

/// Whether the sensor said what is at this pixel.
inline bool isMeasured(PixelKind kind) {
  return kind == PixelKind::kSurface || kind == PixelKind::kWall;
}

/// Whether a pixel lies beside pixels without information.
enum class Block : std::uint8_t {
  kNone = 0,
  kNarrow,         // only of holes, the baseline's shadow at a depth edge, a few dropouts near one
  kNoInformation,  // of anything else: the robot's own pixels, something too near
};

/// What every pixel of a depth image says, row major.
struct ClassifiedFrame {
  int width{0};
  int height{0};
  std::vector<float> inverse_depth;  // 1/z [1/m]; 0 where nothing was measured
  std::vector<float> inverse_range;  // 1/|x| [1/m], complete: wall pixels at the wall, unmeasured pixels filled
  std::vector<PixelKind> kind;
  // Not kNone within one kernel length of an unmeasured pixel. Speckle does not count: a few dropouts with one surface
  // all round leave out nothing that the pixels beside them do not tell.
  std::vector<Block> blocked;
  // Inverse range [1/m] up to which the ray of a hole is clear: the nearer border of a gap of zeros that a depth edge
  // explains; the wall, where a mapped surface has vanished. 0 at all other pixels.
  std::vector<float> clear_to;
  std::size_t num_surface{0};

  std::size_t index(int u, int v) const { return static_cast<std::size_t>(v) * width + u; }
};

/// Decides pixel by pixel what a depth image says (method: virtual wall, shadows, no information).
class DepthClassifier {
 public:
  /// `camera` and `config` must be valid. Precomputes the length of every pixel's ray.
  DepthClassifier(const CameraModel& camera, const GpisConfig& config);

  /// Image size must equal the camera's; throws std::invalid_argument otherwise.
  ClassifiedFrame classify(const DepthImage& image, int num_threads) const;

  /// Upright box around the camera and everything that the image says anything about, up to the sensor's range [m, map
  /// frame]; to within a few pixels.
  Eigen::AlignedBox3d viewBox(const ClassifiedFrame& frame, const Eigen::Isometry3d& T_map_camera) const;

  /// Length of (theta, 1) for a pixel: range = depth * rayLength.
  float rayLength(int u, int v) const { return ray_length_[static_cast<std::size_t>(v) * camera_.width + u]; }

 private:
  void classifyRow(const DepthImage& image, int v, ClassifiedFrame* frame) const;
  void classifyHole(const float* depth, int begin, int end, PixelKind* kind) const;
  /// Depths beyond `near_m` by more than this belong to another surface [m].
  double edgeDepth(double near_m) const;
  /// Widest strip, along the image row, that the near side of a depth edge can hide from the second viewpoint [px].
  double widestShadowPx(double near_m, double far_m) const;
  /// Sets `is_shadow` where a run of unmeasured pixels in a row is no wider than the shadow of the depth edge it lies
  /// at. Sets the frame's `clear_to` there, and where a gap between the two sides of a depth edge is narrow.
  void markGaps(const DepthImage& image, int num_threads, ClassifiedFrame* frame,
                std::vector<std::uint8_t>* is_shadow) const;
  /// What an unmeasured pixel blocks around it: nothing if it is one of a few with one surface, or wall, all round.
  Block blockOf(const ClassifiedFrame& frame, int u, int v, bool is_shadow) const;

  CameraModel camera_;
  GpisConfig config_;
  std::vector<float> ray_length_;
};

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_DEPTH_CLASSIFIER_H
