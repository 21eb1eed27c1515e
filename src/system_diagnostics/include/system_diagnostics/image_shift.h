// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include <interactive_mapping_common/config/schema.h>
#include <opencv2/core/mat.hpp>

namespace system_diagnostics {

inline constexpr int kLeastImage_px = 16;  // a smaller image leaves no space for a shift

struct ImageShiftConfig {
  int width_px{160};

  static void fields(ImageShiftConfig& c, interactive_mapping::Fields& f) {
    f("image_width_px", c.width_px, kLeastImage_px, 4096, "px",
      "images are scaled down to this width, which removes noise and saves time");
  }
};

struct ImageShift {
  double x_px;  // of what is seen, to the right, in the small image
  double y_px;
  double response;
};

/// How far what is seen has moved from image to image, by phase correlation.
class ImageShiftMeter {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  explicit ImageShiftMeter(const ImageShiftConfig& config);

  /// Since the image before, or nothing: it is the first, of another size, or unlike the one before. Throws
  /// std::invalid_argument unless `grey` is a CV_8UC1 image of at least 16 x 16 px.
  std::optional<ImageShift> add(const cv::Mat& grey);

  void clear() { last_ = cv::Mat(); }

 private:
  ImageShiftConfig config_;
  cv::Mat last_;    // small, CV_32FC1
  cv::Mat window_;  // Hann's, of its size
};

}  // namespace system_diagnostics
