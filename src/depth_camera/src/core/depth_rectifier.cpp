// SPDX-License-Identifier: BSD-3-Clause
#include "depth_camera/depth_rectifier.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

#include <interactive_mapping_common/formatted.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "depth_camera/distortion.h"

namespace depth_camera {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
// A pinhole image grows as tan: beyond 68 degrees from the axis it has few pixels' worth of information in many pixels.
constexpr double kMaxBearing = 2.475;  // tan(68 deg)
// Four neighbours are of one surface, and blended, when their depths differ by no more than those of a plane seen at 80
// degrees from its normal do over the diagonal of a pixel, and by the noise between neighbours.
constexpr double kMaxSlope = 8.0;  // sqrt(2) tan(80 deg)
constexpr float kNoise_m = 0.004f;
constexpr int kDirections = 180;
constexpr int kSteps = 500;

Distortion requireLens(const LensDistortion& lens) {
  const std::vector<double>& d = lens.coefficients;
  const std::optional<Distortion> distortion = distortionNamed(lens.model);
  if (!distortion || *distortion == Distortion::kNone) {
    throw std::invalid_argument("distortion_model is '" + lens.model.substr(0, 40) +
                                "' with D other than 0, must be plumb_bob, rational_polynomial or equidistant");
  }
  const std::string counts = countsOtherThan(d.size(), *distortion);
  if (!counts.empty()) {
    throw std::invalid_argument("D has " + std::to_string(d.size()) + " coefficients, must have " + counts + " for " +
                                lens.model);
  }
  if (!std::all_of(d.begin(), d.end(), [](double value) { return std::isfinite(value); })) {
    throw std::invalid_argument("D is not finite");
  }
  return *distortion;
}

/// The lens as OpenCV has it.
class Projection {
 public:
  Projection(const CameraModel& raw, const LensDistortion& distortion)
      : lens_(requireLens(distortion)), K_(cameraMatrix(raw)), D_(distortion.coefficients, true) {}

  /// Where the raw image shows these bearings.
  std::vector<cv::Point2d> operator()(const std::vector<cv::Point3d>& bearings) const {
    std::vector<cv::Point2d> pixels;
    const cv::Vec3d zero(0.0, 0.0, 0.0);
    if (lens_ == Distortion::kEquidistant) {
      cv::fisheye::projectPoints(bearings, pixels, zero, zero, K_, D_);
    } else {
      cv::projectPoints(bearings, zero, zero, K_, D_, pixels);
    }
    return pixels;
  }

  /// Where the raw image shows the pixels of a pinhole.
  void tables(const CameraModel& pinhole, cv::Mat_<float>* u_px, cv::Mat_<float>* v_px) const {
    const cv::Size size(pinhole.width, pinhole.height);
    if (lens_ == Distortion::kEquidistant) {
      cv::fisheye::initUndistortRectifyMap(K_, D_, cv::Matx33d::eye(), cameraMatrix(pinhole), size, CV_32FC1, *u_px,
                                           *v_px);
    } else {
      cv::initUndistortRectifyMap(K_, D_, cv::noArray(), cameraMatrix(pinhole), size, CV_32FC1, *u_px, *v_px);
    }
  }

 private:
  static cv::Matx33d cameraMatrix(const CameraModel& camera) {
    return {camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0};
  }

  Distortion lens_;
  cv::Matx33d K_;
  cv::Mat D_;
};

/// Between the centres of the outermost pixels, beyond which nothing can be interpolated.
bool isInside(const CameraModel& raw, const cv::Point2d& pixel) {
  return pixel.x >= 0.0 && pixel.x <= raw.width - 1 && pixel.y >= 0.0 && pixel.y <= raw.height - 1;  // false for NaN
}

/// How far from the axis, as tan of the angle, the projection is one to one in every direction, at most kMaxBearing.
/// Beyond, a polynomial turns back and shows what the lens does not. Throws when that begins inside the raw image.
double oneToOneBearing(const CameraModel& raw, const Projection& project) {
  std::vector<cv::Point2d> directions;
  for (int i = 0; i < kDirections; ++i) {
    const double angle = 2.0 * CV_PI * i / kDirections;
    directions.emplace_back(std::cos(angle), std::sin(angle));
  }
  const auto ring = [&](double radius) {
    std::vector<cv::Point3d> bearings;
    for (const cv::Point2d& d : directions) bearings.emplace_back(radius * d.x, radius * d.y, 1.0);
    return project(bearings);
  };
  double radius = 0.0;
  std::vector<cv::Point2d> last = ring(0.0);
  for (int step = 1; step <= kSteps; ++step) {
    const double next_radius = kMaxBearing * step / kSteps;
    const std::vector<cv::Point2d> next = ring(next_radius);
    bool turns = false;
    for (std::size_t i = 0; i < next.size(); ++i) {
      const cv::Point2d advance((next[i].x - last[i].x) / raw.fx, (next[i].y - last[i].y) / raw.fy);
      turns = turns || !(advance.dot(directions[i]) > 0.0);  // NaN, too
    }
    if (turns) break;
    radius = next_radius;
    last = next;
  }
  const auto inside = std::find_if(last.begin(), last.end(), [&](const auto& pixel) { return isInside(raw, pixel); });
  if (radius == kMaxBearing || inside == last.end()) return radius;
  throw std::invalid_argument(interactive_mapping::formatted(
      "D is not one to one inside the image: it turns back %.1f deg from the axis, at pixel (%.0f, %.0f); "
      "calibrate again",
      std::atan(radius) * 180.0 / CV_PI, inside->x, inside->y));
}

}  // namespace

bool LensDistortion::isZero() const {
  return std::all_of(coefficients.begin(), coefficients.end(), [](double d) { return d == 0.0; });  // NaN is not
}

DepthRectifier::DepthRectifier(const CameraModel& raw, const LensDistortion& distortion)
    : raw_(raw), distortion_(distortion), camera_(raw) {
  std::vector<std::string> problems = raw.validate();
  if (!problems.empty()) throw std::invalid_argument(problems.front());
  if (distortion.isZero()) return;
  const Projection project(raw, distortion);
  const double max_bearing = oneToOneBearing(raw, project);

  // The largest pinhole image first, then the part of it that the raw image sees.
  const int left = raw.width / 2;
  const int top = raw.height / 2;
  const CameraModel largest{raw.width + 2 * left, raw.height + 2 * top, raw.fx, raw.fy, raw.cx + left, raw.cy + top};
  cv::Mat_<float> u_px, v_px;
  project.tables(largest, &u_px, &v_px);
  cv::Rect box;
  for (int v = 0; v < largest.height; ++v) {
    for (int u = 0; u < largest.width; ++u) {
      const double bearing = std::hypot((u - largest.cx) / largest.fx, (v - largest.cy) / largest.fy);
      if (bearing <= max_bearing && isInside(raw, cv::Point2d(u_px(v, u), v_px(v, u)))) {
        box |= cv::Rect(u, v, 1, 1);
      } else {
        u_px(v, u) = kNan;
      }
    }
  }
  camera_.width = box.width;
  camera_.height = box.height;
  camera_.cx = largest.cx - box.x;
  camera_.cy = largest.cy - box.y;
  problems = camera_.validate();
  if (!problems.empty()) throw std::invalid_argument("rectified with D, " + problems.front());
  max_spread_ = static_cast<float>(kMaxSlope / std::min(raw.fx, raw.fy));
  u_px = u_px(box).clone();
  v_px = v_px(box).clone();
  raw_u_px_.assign(u_px.begin(), u_px.end());
  raw_v_px_.assign(v_px.begin(), v_px.end());
}

float DepthRectifier::sample(const DepthImage& raw, float u, float v) const {
  const int u0 = std::min(static_cast<int>(u), raw.width - 2);
  const int v0 = std::min(static_cast<int>(v), raw.height - 2);
  const float a = u - static_cast<float>(u0);
  const float b = v - static_cast<float>(v0);
  const float z[4] = {raw.at(u0, v0), raw.at(u0 + 1, v0), raw.at(u0, v0 + 1), raw.at(u0 + 1, v0 + 1)};
  const float nearest = z[(a < 0.5f ? 0 : 1) + (b < 0.5f ? 0 : 2)];
  float least = z[0];
  float most = z[0];
  for (const float value : z) {
    if (!(value > 0.0f) || std::isinf(value)) return nearest;  // NaN, too
    least = std::min(least, value);
    most = std::max(most, value);
  }
  if (most - least > max_spread_ * least + kNoise_m) return nearest;
  // 1/z of a plane is linear across a pinhole image, z is not.
  return 1.0f / ((1.0f - b) * ((1.0f - a) / z[0] + a / z[1]) + b * ((1.0f - a) / z[2] + a / z[3]));
}

DepthImage DepthRectifier::rectify(DepthImage raw) const {
  if (raw.width != raw_.width || raw.height != raw_.height) {
    throw std::invalid_argument("depth image is " + std::to_string(raw.width) + " x " + std::to_string(raw.height) +
                                " px, must be " + std::to_string(raw_.width) + " x " + std::to_string(raw_.height) +
                                " px as the camera");
  }
  if (raw_u_px_.empty()) return raw;
  DepthImage image{camera_.width, camera_.height, std::vector<float>(raw_u_px_.size(), kNan)};
  for (std::size_t i = 0; i < raw_u_px_.size(); ++i) {
    if (std::isnan(raw_u_px_[i])) continue;
    image.depth_m[i] = sample(raw, raw_u_px_[i], raw_v_px_[i]);
  }
  return image;
}

}  // namespace depth_camera
