// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

namespace system_diagnostics {

struct ImageShiftConfig {
  int width_px{160};              // images are made as small as this: noise goes, speed comes
  double min_response{0.1};       // of the phase correlation's peak, 1: nothing but shifted
  double min_contrast_grey{2.0};  // standard deviation of the small image; less is a wall, and its noise stands still

  std::vector<std::string> validate() const;
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
