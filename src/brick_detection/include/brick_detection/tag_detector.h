// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <opencv2/core.hpp>

namespace brick_detection {

/// A tag decoded in an image.
struct TagObservation {
  int id{0};
  /// Corners of the black border, sub-pixel, pixel centres at integers: top left, top right, bottom right, bottom left as
  /// the tag stands upright. In the tag's frame (x right, y up, z out): (-,+), (+,+), (+,-), (-,-).
  std::array<Eigen::Vector2d, 4> corners_px{};
  int hamming{0};      ///< bits corrected
  double margin{0.0};  ///< how sure the bits are: mean contrast to the decision threshold [grey levels]

  /// What was printed, CV_8UC1: 0 black, 255 white, kUnknownCell; upright, with one ring of cells or more about the
  /// `border_cells` that lie between the corners. Empty: not known, and then not compared with the image.
  cv::Mat cells;
  int border_cells{0};
  static constexpr int kUnknownCell = 128;

  double shortestSide() const;  ///< [px]
};

struct TagDetectorConfig {
  std::string family{"tag36h11"};  ///< a name that TagLayout::numIds() of mp700_ur5e_description knows
  int threads{1};
  double decimate{1.0};  ///< AprilTag: edges are looked for in an image smaller by this factor; 1 finds the smallest
  /// AprilTag: Gaussian blur before edges are looked for and bits are read. Corners are measured in the image as it is.
  double blur_sigma_px{0.3};
  double sharpening{0.5};  ///< AprilTag: of the bits' image
  /// Bits that may be corrected. Families of more than 10000 codes correct one at most: the table takes gigabytes for two.
  int max_hamming{2};

  /// One sentence per problem with key, value and allowed range; empty: fine.
  std::vector<std::string> validate() const;
};

/// Finds tags of one family in grey images. Not thread-safe: one detector per thread.
class TagDetector {
 public:
  virtual ~TagDetector() = default;

  /// All tags, in order of their ids; an id occurs as often as it is seen. Small, weak and doubtful ones too: whoever asks
  /// decides by their margin and size. `grey`: CV_8UC1, any stride. Throws std::invalid_argument for another type or
  /// an empty image.
  virtual std::vector<TagObservation> detect(const cv::Mat& grey) = 0;
};

/// By libapriltag for its families, by OpenCV for ArUco's dictionaries. Throws std::invalid_argument for an impossible
/// config, and for families that neither decodes, with the reason.
std::unique_ptr<TagDetector> makeTagDetector(const TagDetectorConfig& config);

}  // namespace brick_detection
