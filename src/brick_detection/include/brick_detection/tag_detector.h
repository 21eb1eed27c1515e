// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <array>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <interactive_mapping_common/config/schema.h>
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
  /// A name that TagLayout::numIds() of mp700_ur5e_description knows. No parameter: the tags have one.
  std::string family{"tag36h11"};
  int threads{1};
  double decimate{1.0};
  double blur_sigma_px{0.3};
  double sharpening{0.5};
  int max_hamming{2};  // families of more than 10000 codes correct one at most: the table takes gigabytes for two

  static void fields(TagDetectorConfig& c, interactive_mapping::Fields& f) {
    f("threads", c.threads, 1, 64, "", "threads of AprilTag's detector");
    f("decimate", c.decimate, 1.0, 4.0, "",
      "AprilTag searches edges in an image smaller by this factor; 1, 1.5, 2, 3 or 4, where 1 finds the smallest tags");
    f("blur_sigma_px", c.blur_sigma_px, 0.0, 10.0, "px",
      "AprilTag blurs the image by this much before it searches edges; more loses small tags");
    f("sharpening", c.sharpening, 0.0, 10.0, "", "AprilTag sharpens the image of the bits by this much");
    f("max_hamming", c.max_hamming, 0, 2, "", "bits that may be corrected when a tag is decoded");
    const std::array<double, 5> factors = {1.0, 1.5, 2.0, 3.0, 4.0};  // what libapriltag knows
    const bool is_known = std::find(factors.begin(), factors.end(), c.decimate) != factors.end();
    f.require(is_known || !(c.decimate >= 1.0 && c.decimate <= 4.0),
              "decimate = " + std::to_string(c.decimate) + ", must be 1, 1.5, 2, 3 or 4");
  }
};

/// Finds tags of one family in grey images. Not thread-safe: one detector per thread.
class TagDetector {
 public:
  virtual ~TagDetector() = default;

  /// All tags, in order of their ids; an id occurs as often as it is seen. Small, weak and doubtful ones too: the
  /// caller decides by their margin and size. `grey`: CV_8UC1, any stride. Throws std::invalid_argument for another type or
  /// an empty image.
  virtual std::vector<TagObservation> detect(const cv::Mat& grey) = 0;
};

/// By libapriltag for its families, by OpenCV for ArUco's dictionaries. Throws std::invalid_argument for an impossible
/// config, and for families that neither decodes, with the reason.
std::unique_ptr<TagDetector> makeTagDetector(const TagDetectorConfig& config);

}  // namespace brick_detection
