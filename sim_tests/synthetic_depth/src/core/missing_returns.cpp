// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/missing_returns.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include <interactive_mapping_common/threads/parallel_for.h>
#include <opencv2/imgproc.hpp>

#include "synthetic_depth/seeded_random.h"

namespace synthetic_depth {
namespace {

constexpr std::size_t kRowsAtATime = 16;
// Random streams apart from those of the pixels and of the colour noise.
constexpr std::uint64_t kFlickerStream = ~std::uint64_t{1};
constexpr std::uint64_t kStripStream = ~std::uint64_t{2};
constexpr int kFlickerPitch_px = 12;
constexpr int kStripPitch_px = 4;

/// Random values in [0, 1) on a coarse grid of pixels, interpolated between: neighbours have similar values.
class PatchNoise {
 public:
  PatchNoise(const cv::Size& image, int pitch_px, SeededRandom random)
      : pitch_px_(pitch_px), values_(image.height / pitch_px + 2, image.width / pitch_px + 2) {
    std::generate(values_.begin(), values_.end(),
                  [&random] { return static_cast<float>(random.uniform(0.0, 0.9999)); });
  }

  float at(int u, int v) const {
    const int column = u / pitch_px_;
    const int row = v / pitch_px_;
    const float across = static_cast<float>(u % pitch_px_) / static_cast<float>(pitch_px_);
    const float down = static_cast<float>(v % pitch_px_) / static_cast<float>(pitch_px_);
    const float* const above = values_[row] + column;
    const float* const below = values_[row + 1] + column;
    return (1.0F - down) * (above[0] + across * (above[1] - above[0])) +
           down * (below[0] + across * (below[1] - below[0]));
  }

 private:
  int pitch_px_;
  cv::Mat_<float> values_;
};

template <typename Function>
void forEachRow(int rows, const Function& function) {
  using interactive_mapping::parallelFor;
  using interactive_mapping::resolveThreadCount;
  parallelFor(static_cast<std::size_t>(rows), resolveThreadCount(0), kRowsAtATime,
              [&](std::size_t begin, std::size_t end) {
                for (std::size_t v = begin; v < end; ++v) function(static_cast<int>(v));
              });
}

/// Outside of the rectangle within the margins, or of the hexagon in it.
void loseBorder(const SensorModel& sensor, cv::Mat* missing) {
  const int left = sensor.border_left_px;
  const int top = sensor.border_top_px;
  const int width = missing->cols - left - sensor.border_right_px;
  const int height = missing->rows - top - sensor.border_bottom_px;
  for (int v = 0; v < missing->rows; ++v) {
    unsigned char* const row = missing->ptr<unsigned char>(v);
    int cut = 0;
    if (sensor.has_hexagonal_view) {
      const double off_middle = std::abs(v - top - 0.5 * (height - 1)) / (0.5 * height);
      cut = static_cast<int>(std::lround(0.25 * width * std::min(1.0, off_middle)));
    }
    const bool is_in = v >= top && v < top + height;
    std::fill(row, row + (is_in ? left + cut : missing->cols), 255);
    std::fill(row + (is_in ? left + width - cut : missing->cols), row + missing->cols, 255);
  }
}

void loseWeakReturns(const CameraModel& camera, const SensorModel& sensor, std::uint64_t seed, std::uint64_t frame,
                     const cv::Mat& exact_depth_m, const cv::Mat& albedo, cv::Mat* missing) {
  const cv::Mat strength = returnStrength(camera, exact_depth_m, albedo);
  const PatchNoise noise(strength.size(), kFlickerPitch_px, SeededRandom(seed, frame, kFlickerStream));
  const auto least = static_cast<float>(sensor.min_return_per_m2);
  const auto flicker = static_cast<float>(sensor.return_flicker);
  forEachRow(strength.rows, [&](int v) {
    const float* const from = strength.ptr<float>(v);
    unsigned char* const to = missing->ptr<unsigned char>(v);
    for (int u = 0; u < strength.cols; ++u) {
      const float s = from[u];
      if (s > 0.0F && s * (1.0F - flicker) < least && s * (1.0F + flicker * (2.0F * noise.at(u, v) - 1.0F)) < least) {
        to[u] = 255;
      }
    }
  });
}

void loseEdgeStrips(const SensorModel& sensor, std::uint64_t seed, std::uint64_t frame, const cv::Mat& exact_depth_m,
                    cv::Mat* missing) {
  // Relative, so that a surface seen at a grazing angle far away is no row of edges; infinite depth on one side is one.
  constexpr float kLeastRelativeJump = 0.05F;
  const auto threshold_m = static_cast<float>(sensor.edge_threshold_m);
  const auto isEdge = [threshold_m](float a, float b) {
    return std::abs(a - b) > std::max(threshold_m, kLeastRelativeJump * std::min(a, b));
  };
  cv::Mat is_smooth(exact_depth_m.size(), CV_8UC1, cv::Scalar(1));
  for (int v = 0; v < exact_depth_m.rows; ++v) {
    const float* const row = exact_depth_m.ptr<float>(v);
    const float* const below = exact_depth_m.ptr<float>(std::min(v + 1, exact_depth_m.rows - 1));
    unsigned char* const marks = is_smooth.ptr<unsigned char>(v);
    unsigned char* const marks_below = is_smooth.ptr<unsigned char>(std::min(v + 1, exact_depth_m.rows - 1));
    for (int u = 0; u < exact_depth_m.cols; ++u) {
      if (isEdge(row[u], below[u])) marks[u] = marks_below[u] = 0;
      if (u > 0 && isEdge(row[u - 1], row[u])) marks[u - 1] = marks[u] = 0;
    }
  }
  cv::Mat distance_px;
  cv::distanceTransform(is_smooth, distance_px, cv::DIST_L1, cv::DIST_MASK_3, CV_8U);
  const PatchNoise noise(is_smooth.size(), kStripPitch_px, SeededRandom(seed, frame, kStripStream));
  const auto widest_px = static_cast<float>(sensor.edge_loss_px);
  for (int v = 0; v < distance_px.rows; ++v) {
    const unsigned char* const distances = distance_px.ptr<unsigned char>(v);
    unsigned char* const to = missing->ptr<unsigned char>(v);
    for (int u = 0; u < distance_px.cols; ++u) {
      const float distance = distances[u];
      if (distance < widest_px && distance < widest_px * noise.at(u, v)) to[u] = 255;
    }
  }
}

bool hasBorder(const SensorModel& sensor) {
  return sensor.has_hexagonal_view || sensor.border_left_px > 0 || sensor.border_right_px > 0 ||
         sensor.border_top_px > 0 || sensor.border_bottom_px > 0;
}

}  // namespace

cv::Mat returnStrength(const CameraModel& camera, const cv::Mat& exact_depth_m, const cv::Mat& albedo) {
  // The inverse depth of a plane is linear in x = (u - cx) / fx and y: 1 / z = gx x + gy y + gz with (gx, gy, gz) the
  // plane's normal divided by its distance. So with the ray r = (x, y, 1) of length |r|, cos(incidence) = 1 / (z |g| |r|).
  cv::Mat inverse;
  cv::divide(1.0, exact_depth_m, inverse);  // 0 where nothing is hit
  cv::Mat strength(exact_depth_m.size(), CV_32FC1);
  const auto smaller = [](float a, float b) { return std::abs(a) < std::abs(b) ? a : b; };
  forEachRow(strength.rows, [&](int v) {
    const float* const here = inverse.ptr<float>(v);
    const float* const above = inverse.ptr<float>(std::max(v - 1, 0));
    const float* const below = inverse.ptr<float>(std::min(v + 1, strength.rows - 1));
    const float* const albedo_row = albedo.empty() ? nullptr : albedo.ptr<float>(v);
    float* const to = strength.ptr<float>(v);
    const auto fx = static_cast<float>(camera.fx_px);
    const auto fy = static_cast<float>(camera.fy_px);
    const auto y = static_cast<float>((v - camera.cy_px) / camera.fy_px);
    const int last = strength.cols - 1;
    for (int u = 0; u <= last; ++u) {
      const float w = here[u];
      const float from_left = w - here[std::max(u - 1, 0)];
      const float to_right = here[std::min(u + 1, last)] - w;
      const float from_above = w - above[u];
      const float to_below = below[u] - w;
      const float gx = fx * (u == 0 ? to_right : u == last ? from_left : smaller(from_left, to_right));
      const float gy = fy * (v == 0 ? to_below : v == strength.rows - 1 ? from_above : smaller(from_above, to_below));
      const float x = (static_cast<float>(u) - static_cast<float>(camera.cx_px)) / fx;
      const float gz = w - gx * x - gy * y;
      const float r2 = 1.0F + x * x + y * y;
      const float g2 = gx * gx + gy * gy + gz * gz;
      to[u] = w > 0.0F ? w * w * w / (std::sqrt(g2 * r2) * r2) : 0.0F;
      if (albedo_row != nullptr) to[u] *= albedo_row[u];
    }
  });
  return strength;
}

cv::Mat missingReturns(const CameraModel& camera, const SensorModel& sensor, std::uint64_t seed, std::uint64_t frame,
                       const cv::Mat& exact_depth_m, const cv::Mat& albedo) {
  const bool has_border = hasBorder(sensor);
  const bool has_weak_returns = sensor.min_return_per_m2 > 0.0;
  const bool has_strips = sensor.edge_loss_px > 0.0;
  if (!has_border && !has_weak_returns && !has_strips) return {};
  cv::Mat missing = cv::Mat::zeros(exact_depth_m.size(), CV_8UC1);
  if (has_border) loseBorder(sensor, &missing);
  if (has_weak_returns) loseWeakReturns(camera, sensor, seed, frame, exact_depth_m, albedo, &missing);
  if (has_strips) loseEdgeStrips(sensor, seed, frame, exact_depth_m, &missing);
  return missing;
}

std::vector<std::string> missingReturnProblems(const CameraModel& camera, const SensorModel& sensor) {
  std::vector<std::string> problems;
  const auto within = [&problems](const char* key, double value, double high, const char* unit) {
    if (value >= 0.0 && value <= high) return;
    std::ostringstream text;
    text << "sensor/" << key << " = " << value << unit << ", must be in [0, " << high << "]" << unit;
    problems.push_back(text.str());
  };
  // Something must be left in the middle: half of the image less a pixel.
  const int across = std::max(0, (camera.width_px - 1) / 2);
  const int down = std::max(0, (camera.height_px - 1) / 2);
  within("border_left_px", sensor.border_left_px, across, " px");
  within("border_right_px", sensor.border_right_px, across, " px");
  within("border_top_px", sensor.border_top_px, down, " px");
  within("border_bottom_px", sensor.border_bottom_px, down, " px");
  within("min_return_per_m2", sensor.min_return_per_m2, 100.0, " 1/m^2");
  within("return_flicker", sensor.return_flicker, 1.0, "");
  within("edge_loss_px", sensor.edge_loss_px, 20.0, " px");
  return problems;
}

}  // namespace synthetic_depth
