// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics/image_shift.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include <opencv2/imgproc.hpp>

namespace system_diagnostics {
namespace {
constexpr double kMinResponse = 0.1;       // of the peak of the phase correlation; 1: nothing but shifted
constexpr double kMinContrast_grey = 2.0;  // standard deviation; less is a wall, whose noise stands still
}  // namespace

ImageShiftMeter::ImageShiftMeter(const ImageShiftConfig& config) : config_(config) {
  interactive_mapping::requireValid("impossible image shift:", config_);
}

std::optional<ImageShift> ImageShiftMeter::add(const cv::Mat& grey) {
  if (grey.type() != CV_8UC1 || grey.cols < kLeastImage_px || grey.rows < kLeastImage_px) {
    throw std::invalid_argument("image of type " + std::to_string(grey.type()) + ", " + std::to_string(grey.cols) +
                                " x " + std::to_string(grey.rows) + " px, must be CV_8UC1 and at least 16 x 16 px");
  }
  const double scale = std::min(1.0, static_cast<double>(config_.width_px) / grey.cols);
  const cv::Size size(std::max(kLeastImage_px, static_cast<int>(std::lround(scale * grey.cols))),
                      std::max(kLeastImage_px, static_cast<int>(std::lround(scale * grey.rows))));
  cv::Mat small;
  cv::resize(grey, small, size, 0.0, 0.0, cv::INTER_AREA);
  small.convertTo(small, CV_32F);
  cv::Scalar mean, deviation;
  cv::meanStdDev(small, mean, deviation);
  if (deviation[0] < kMinContrast_grey) {
    last_ = cv::Mat();
    return std::nullopt;
  }
  std::swap(small, last_);
  if (small.size() != last_.size()) return std::nullopt;
  if (window_.size() != size) cv::createHanningWindow(window_, size, CV_32F);
  ImageShift shift{};
  const cv::Point2d moved = cv::phaseCorrelate(small, last_, window_, &shift.response);
  shift.x_px = moved.x;
  shift.y_px = moved.y;
  if (!(shift.response >= kMinResponse) || !std::isfinite(moved.x) || !std::isfinite(moved.y)) {
    return std::nullopt;  // false for NaN
  }
  return shift;
}

}  // namespace system_diagnostics
