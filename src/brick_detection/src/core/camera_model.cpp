// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/camera_model.h"

#include <cmath>
#include <limits>
#include <sstream>

#include <opencv2/calib3d.hpp>

namespace brick_detection {

std::vector<std::string> CameraModel::validate() const {
  std::vector<std::string> problems;
  const auto check = [&problems](const char* key, double value, double lo, double hi) {
    if (value >= lo && value <= hi) return;  // false for NaN
    std::ostringstream text;
    text << key << " = " << value << " px, must be in [" << lo << ", " << hi << "] px";
    problems.push_back(text.str());
  };
  check("width_px", width_px, 1, 100000);
  check("height_px", height_px, 1, 100000);
  check("fx_px", fx_px, 1.0, 1e6);
  check("fy_px", fy_px, 1.0, 1e6);
  check("cx_px", cx_px, -1e6, 1e6);
  check("cy_px", cy_px, -1e6, 1e6);
  return problems;
}

Eigen::Vector2d CameraModel::project(const Eigen::Vector3d& p_camera) const {
  if (!(p_camera.z() > 0.0)) return Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
  if (distortion == Distortion::kNone) {
    return {fx_px * p_camera.x() / p_camera.z() + cx_px, fy_px * p_camera.y() / p_camera.z() + cy_px};
  }
  const cv::Matx33d K(fx_px, 0, cx_px, 0, fy_px, cy_px, 0, 0, 1);
  const std::vector<cv::Point3d> points{{p_camera.x(), p_camera.y(), p_camera.z()}};
  const cv::Vec3d none(0, 0, 0);
  std::vector<cv::Point2d> pixels;
  if (distortion == Distortion::kEquidistant) {
    cv::fisheye::projectPoints(points, pixels, none, none, K, coefficients);
  } else {
    cv::projectPoints(points, none, none, K, coefficients, pixels);
  }
  return {pixels[0].x, pixels[0].y};
}

Eigen::Vector2d CameraModel::bearing(const Eigen::Vector2d& pixel) const {
  if (distortion == Distortion::kNone) return {(pixel.x() - cx_px) / fx_px, (pixel.y() - cy_px) / fy_px};
  const cv::Matx33d K(fx_px, 0, cx_px, 0, fy_px, cy_px, 0, 0, 1);
  const std::vector<cv::Point2d> pixels{{pixel.x(), pixel.y()}};
  std::vector<cv::Point2d> bearings;
  if (distortion == Distortion::kEquidistant) {
    cv::fisheye::undistortPoints(pixels, bearings, K, coefficients);
  } else {
    cv::undistortPoints(pixels, bearings, K, coefficients, cv::noArray(), cv::noArray(),
                        cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 40, 1e-12));
  }
  return {bearings[0].x, bearings[0].y};
}

}  // namespace brick_detection
