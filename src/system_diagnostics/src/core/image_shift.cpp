// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics/image_shift.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include <interactive_mapping_common/config/range_check.h>
#include <opencv2/imgproc.hpp>

namespace system_diagnostics {
namespace {
constexpr int kLeast_px = 16;  // a smaller image has no room for a shift
}

std::vector<std::string> ImageShiftConfig::validate() const {
  interactive_mapping::RangeCheck check;
  check("width_px", width_px, kLeast_px, 4096, "px");
  check("min_response", min_response, 0.0, 1.0, "");
  check("min_contrast_grey", min_contrast_grey, 0.0, 255.0, "");
  return check.problems();
}

ImageShiftMeter::ImageShiftMeter(const ImageShiftConfig& config) : config_(config) {
  interactive_mapping::throwIfAny(config_.validate());
}

std::optional<ImageShift> ImageShiftMeter::add(const cv::Mat& grey) {
  if (grey.type() != CV_8UC1 || grey.cols < kLeast_px || grey.rows < kLeast_px) {
    throw std::invalid_argument("image of type " + std::to_string(grey.type()) + ", " + std::to_string(grey.cols) +
                                " x " + std::to_string(grey.rows) + " px, must be CV_8UC1 and at least 16 x 16 px");
  }
  const double scale = std::min(1.0, static_cast<double>(config_.width_px) / grey.cols);
  const cv::Size size(std::max(kLeast_px, static_cast<int>(std::lround(scale * grey.cols))),
                      std::max(kLeast_px, static_cast<int>(std::lround(scale * grey.rows))));
  cv::Mat small;
  cv::resize(grey, small, size, 0.0, 0.0, cv::INTER_AREA);
  small.convertTo(small, CV_32F);
  cv::Scalar mean, deviation;
  cv::meanStdDev(small, mean, deviation);
  if (deviation[0] < config_.min_contrast_grey) {
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
  if (!(shift.response >= config_.min_response) || !std::isfinite(moved.x) || !std::isfinite(moved.y)) {
    return std::nullopt;  // false for NaN
  }
  return shift;
}

}  // namespace system_diagnostics
