// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/annotated_image.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <opencv2/imgproc.hpp>

namespace brick_detection {
namespace {

using mp700_ur5e_description::BrickCatalogue;

// Order blue, green, red.
const cv::Scalar kGreen(60, 200, 60);
const cv::Scalar kRed(60, 60, 235);
const cv::Scalar kYellow(60, 220, 250);
const std::array<cv::Scalar, 3> kAxisColors = {cv::Scalar(50, 50, 255), cv::Scalar(50, 220, 50),
                                               cv::Scalar(255, 110, 50)};
constexpr int kShift = 4;  // OpenCV draws at 1/16 px

/// Nothing if the pixel cannot be drawn to, or is where a lens's formula has left its range and folds back.
std::optional<cv::Point> toPoint(const CameraModel& camera, const Eigen::Vector3d& p_camera) {
  const Eigen::Vector2d pixel = camera.project(p_camera);
  constexpr double kFarPx = 20000.0;
  if (!pixel.allFinite() || pixel.cwiseAbs().maxCoeff() > kFarPx) return std::nullopt;
  const Eigen::Vector2d bearing = camera.bearing(pixel);
  if (!((bearing - p_camera.hnormalized()).norm() < 0.01)) return std::nullopt;
  return cv::Point(static_cast<int>(std::lround(pixel.x() * (1 << kShift))),
                   static_cast<int>(std::lround(pixel.y() * (1 << kShift))));
}

cv::Point toPoint(const Eigen::Vector2d& pixel) {
  return {static_cast<int>(std::lround(pixel.x() * (1 << kShift))),
          static_cast<int>(std::lround(pixel.y() * (1 << kShift)))};
}

/// A straight line in space: bent by the lens, cut off where it leaves the view.
void drawSegment(const CameraModel& camera, const Eigen::Vector3d& a_camera, const Eigen::Vector3d& b_camera,
                 const cv::Scalar& color, int thickness, cv::Mat* image) {
  const int pieces = 16;
  std::optional<cv::Point> before = toPoint(camera, a_camera);
  for (int i = 1; i <= pieces; ++i) {
    const std::optional<cv::Point> here =
        toPoint(camera, a_camera + (b_camera - a_camera) * (static_cast<double>(i) / pieces));
    if (before && here) cv::line(*image, *before, *here, color, thickness, cv::LINE_AA, kShift);
    before = here;
  }
}

/// Text about a place, kept inside the image, on a dark plate.
void drawLabel(const std::string& text, const cv::Point& middle, double scale, const cv::Scalar& color,
               cv::Mat* image) {
  constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
  int baseline = 0;
  const cv::Size size = cv::getTextSize(text, kFont, scale, 1, &baseline);
  constexpr int kPad = 2;
  cv::Rect plate(middle.x - size.width / 2 - kPad, middle.y - size.height / 2 - kPad, size.width + 2 * kPad,
                 size.height + baseline + 2 * kPad);
  plate.x = std::clamp(plate.x, 0, std::max(0, image->cols - plate.width));
  plate.y = std::clamp(plate.y, 0, std::max(0, image->rows - plate.height));
  const cv::Rect inside = plate & cv::Rect(0, 0, image->cols, image->rows);
  cv::Mat region = (*image)(inside);
  region *= 0.35;
  cv::putText(*image, text, {plate.x + kPad, plate.y + kPad + size.height}, kFont, scale, color, 1, cv::LINE_AA);
}

double labelScale(const cv::Mat& image) {
  return std::clamp(image.cols / 1400.0, 0.4, 1.2);
}

int lineWidth(const cv::Mat& image) {
  return std::max(1, image.cols / 640);
}

void drawBrick(const BrickSighting& brick, const Eigen::Vector3d& size_m, const CameraModel& camera, cv::Mat* image) {
  const auto cornerAt = [&](int index) {
    const Eigen::Vector3d sign(index & 1 ? 0.5 : -0.5, index & 2 ? 0.5 : -0.5, index & 4 ? 0.5 : -0.5);
    return Eigen::Vector3d(brick.T_camera_brick * size_m.cwiseProduct(sign));
  };
  // Edges behind the brick would only be in the way.
  const auto isTowards = [&](int axis, bool positive) {
    const Eigen::Vector3d n = (positive ? 1.0 : -1.0) * brick.T_camera_brick.linear().col(axis);
    return n.dot(brick.T_camera_brick.translation() + 0.5 * size_m[axis] * n) < 0.0;
  };
  const int width = lineWidth(*image);
  for (int axis = 0; axis < 3; ++axis) {
    for (int corner = 0; corner < 8; ++corner) {
      if ((corner >> axis) & 1) continue;
      const int first = (axis + 1) % 3;
      const int second = (axis + 2) % 3;
      const bool is_front =
          isTowards(first, ((corner >> first) & 1) != 0) || isTowards(second, ((corner >> second) & 1) != 0);
      if (!is_front) continue;
      drawSegment(camera, cornerAt(corner), cornerAt(corner | (1 << axis)), kYellow, width, image);
    }
  }
  const Eigen::Vector3d middle = brick.T_camera_brick.translation();
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d tip = middle + 0.35 * size_m.minCoeff() * 2.0 * brick.T_camera_brick.linear().col(axis);
    drawSegment(camera, middle, tip, kAxisColors[static_cast<std::size_t>(axis)], width + 1, image);
  }
}

void drawTag(const TagSighting& sighting, cv::Mat* image) {
  const bool is_used = sighting.status == TagStatus::kUsed;
  const cv::Scalar& color = is_used ? kGreen : kRed;
  std::vector<cv::Point> outline;
  for (const Eigen::Vector2d& corner : sighting.tag.corners_px) {
    if (!corner.allFinite()) return;
    outline.push_back(toPoint(corner));
  }
  cv::polylines(*image, outline, true, color, lineWidth(*image), cv::LINE_AA, kShift);
}

}  // namespace

cv::Mat drawDetections(const cv::Mat& image, const CameraModel& camera, const BrickPoseEstimator::Result& result,
                       const BrickCatalogue& catalogue) {
  if (image.empty() || (image.type() != CV_8UC3 && image.type() != CV_8UC1)) {
    throw std::invalid_argument("image: type = " + (image.empty() ? "empty" : cv::typeToString(image.type())) +
                                ", must be CV_8UC3 or CV_8UC1");
  }
  cv::Mat drawn;
  if (image.channels() == 1) {
    cv::cvtColor(image, drawn, cv::COLOR_GRAY2BGR);
  } else {
    drawn = image.clone();
  }
  for (const BrickSighting& brick : result.bricks) {
    drawBrick(brick, catalogue.typeOf(brick.brick_id).size_m, camera, &drawn);
  }
  for (const TagSighting& tag : result.tags) drawTag(tag, &drawn);
  // Labels come last: nothing is drawn over them.
  const double scale = labelScale(drawn);
  for (const TagSighting& sighting : result.tags) {
    if (sighting.status == TagStatus::kUsed) continue;
    Eigen::Vector2d lowest = sighting.tag.corners_px[0];
    double sum_u = 0.0;
    for (const Eigen::Vector2d& corner : sighting.tag.corners_px) {
      if (!(corner.y() <= lowest.y())) lowest = corner;
      sum_u += corner.x();
    }
    if (!std::isfinite(sum_u) || !lowest.allFinite()) continue;
    const cv::Point below(static_cast<int>(0.25 * sum_u), static_cast<int>(lowest.y() + 24.0 * scale));
    drawLabel(std::to_string(sighting.tag.id) + ": " + toString(sighting.status), below, scale, kRed, &drawn);
  }
  for (const BrickSighting& brick : result.bricks) {
    const std::optional<cv::Point> middle = toPoint(camera, brick.T_camera_brick.translation());
    if (!middle) continue;
    const cv::Point at(middle->x >> kShift, (middle->y >> kShift) + static_cast<int>(24.0 * scale));
    if (!cv::Rect(0, 0, drawn.cols, drawn.rows).contains(at)) continue;
    const std::string text =
        "brick " + std::to_string(brick.brick_id) + (brick.has_duplicate ? " (id seen twice)" : "");
    drawLabel(text, at, 1.2 * scale, kYellow, &drawn);
  }
  return drawn;
}

}  // namespace brick_detection
