// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/camera_model.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include <Eigen/Geometry>
#include <opencv2/calib3d.hpp>

namespace brick_detection {
namespace {

constexpr int kMaxImagePx = 16384;  // larger is a slip
const Eigen::Vector2d kNowhere = Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());

/// Drivers of rectified images send zeros for the coefficients. Equidistant with zeros still is a fisheye.
bool isPinhole(const CameraModel& camera) {
  return camera.distortion == Distortion::kNone ||
         (camera.distortion != Distortion::kEquidistant &&
          std::all_of(camera.coefficients.begin(), camera.coefficients.end(), [](double k) { return k == 0.0; }));
}

cv::Matx33d matrixOf(const CameraModel& camera) {
  return {camera.fx_px, 0.0, camera.cx_px, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 1.0};
}

void requireRange(const char* key, double value, const char* unit, double low, double high, bool open_low,
                  std::vector<std::string>* problems) {
  if (std::isfinite(value) && (open_low ? value > low : value >= low) && value <= high) return;
  std::ostringstream text;
  text << key << " = " << value << " " << unit << ", must be in " << (open_low ? "(" : "[") << low << ", " << high
       << "] " << unit;
  problems->push_back(text.str());
}

}  // namespace

std::vector<std::string> CameraModel::validate() const {
  std::vector<std::string> problems;
  requireRange("width_px", width_px, "px", 1, kMaxImagePx, false, &problems);
  requireRange("height_px", height_px, "px", 1, kMaxImagePx, false, &problems);
  // Ten image widths are a lens of 6 degrees: longer ones are not on a robot.
  requireRange("fx_px", fx_px, "px", 0.0, 10.0 * kMaxImagePx, true, &problems);
  requireRange("fy_px", fy_px, "px", 0.0, 10.0 * kMaxImagePx, true, &problems);
  // A cropped image may leave its principal point outside, but not by more than what it was cropped from.
  requireRange("cx_px", cx_px, "px", -width_px, 2.0 * width_px, false, &problems);
  requireRange("cy_px", cy_px, "px", -height_px, 2.0 * height_px, false, &problems);
  const std::string counts = depth_camera::countsOtherThan(coefficients.size(), distortion);
  if (!counts.empty()) {
    problems.push_back("coefficients: number = " + std::to_string(coefficients.size()) + ", must be " + counts +
                       " for this distortion model");
  }
  for (std::size_t i = 0; i < coefficients.size(); ++i) {
    if (!std::isfinite(coefficients[i])) {
      problems.push_back("coefficients: number " + std::to_string(i) + " = " + std::to_string(coefficients[i]) +
                         ", must be finite");
    }
  }
  return problems;
}

Eigen::Vector2d CameraModel::project(const Eigen::Vector3d& p_camera) const {
  if (!(p_camera.z() > 0.0) || !p_camera.allFinite()) return kNowhere;
  if (isPinhole(*this)) {
    return {fx_px * p_camera.x() / p_camera.z() + cx_px, fy_px * p_camera.y() / p_camera.z() + cy_px};
  }
  const cv::Mat_<cv::Vec3d> point(1, 1, cv::Vec3d(p_camera.x(), p_camera.y(), p_camera.z()));
  cv::Mat_<cv::Vec2d> pixel(1, 1);
  if (distortion == Distortion::kEquidistant) {
    cv::fisheye::projectPoints(point, pixel, cv::Vec3d(), cv::Vec3d(), matrixOf(*this), coefficients);
  } else {
    cv::projectPoints(point, cv::Vec3d(), cv::Vec3d(), matrixOf(*this), coefficients, pixel);
  }
  return {pixel(0)[0], pixel(0)[1]};
}

Eigen::Vector2d CameraModel::bearing(const Eigen::Vector2d& pixel) const {
  if (!pixel.allFinite()) return kNowhere;
  if (isPinhole(*this)) return {(pixel.x() - cx_px) / fx_px, (pixel.y() - cy_px) / fy_px};
  const cv::Mat_<cv::Vec2d> distorted(1, 1, cv::Vec2d(pixel.x(), pixel.y()));
  cv::Mat_<cv::Vec2d> straight(1, 1);
  if (distortion == Distortion::kEquidistant) {
    cv::fisheye::undistortPoints(distorted, straight, matrixOf(*this), coefficients);
  } else {
    // OpenCV's default, five iterations, leaves tenths of a pixel in the corners of a wide lens.
    cv::undistortPoints(distorted, straight, matrixOf(*this), coefficients, cv::noArray(), cv::noArray(),
                        cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 100, 1e-9));
  }
  const Eigen::Vector2d direction(straight(0)[0], straight(0)[1]);
  // Outside the lens's range the iteration ends somewhere, or far away.
  constexpr double kSamePixel = 0.01;
  const Eigen::Vector2d back = project(direction.homogeneous());
  return (back - pixel).norm() < kSamePixel ? direction : kNowhere;
}

}  // namespace brick_detection
