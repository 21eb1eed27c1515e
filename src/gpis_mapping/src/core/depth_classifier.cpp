// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/depth_classifier.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "gpis_mapping/parallel_for.h"

namespace gpis_mapping {
namespace {

// A dropout this narrow between two pieces of one surface cannot be told from speckle.
constexpr int kSpecklePx = 3;
// Between equal depths, a hole narrower than this (or than the widest possible shadow) waits for a second look.
constexpr int kWideHolePx = 12;

/// 1 where any pixel within (radius_u, radius_v) of `source` is set; separable box dilation by run length.
void dilate(const std::vector<std::uint8_t>& source, int width, int height, int radius_u, int radius_v,
            std::vector<std::uint8_t>* result) {
  std::vector<std::uint8_t> rows(source.size(), 0);
  for (int v = 0; v < height; ++v) {
    const std::uint8_t* in = &source[static_cast<std::size_t>(v) * width];
    std::uint8_t* out = &rows[static_cast<std::size_t>(v) * width];
    int filled_to = 0;  // out[0, filled_to) is final
    for (int u = 0; u < width; ++u) {
      if (!in[u]) continue;
      const int begin = std::max(filled_to, u - radius_u);
      const int end = std::min(width, u + radius_u + 1);
      for (int i = begin; i < end; ++i) out[i] = 1;
      filled_to = std::max(filled_to, end);
    }
  }
  result->assign(source.size(), 0);
  for (int v = 0; v < height; ++v) {
    std::uint8_t* out = &(*result)[static_cast<std::size_t>(v) * width];
    for (int w = std::max(0, v - radius_v); w <= std::min(height - 1, v + radius_v); ++w) {
      const std::uint8_t* in = &rows[static_cast<std::size_t>(w) * width];
      for (int u = 0; u < width; ++u) out[u] |= in[u];
    }
  }
}

}  // namespace

void requireFits(const DepthImage& image, const CameraModel& camera) {
  // A negative size has no number of pixels.
  const bool fits = camera.width > 0 && camera.height > 0 && image.width == camera.width &&
                    image.height == camera.height &&
                    image.depth_m.size() == static_cast<std::size_t>(camera.width) * camera.height;
  if (fits) return;
  throw std::invalid_argument("depth image is " + std::to_string(image.width) + " x " + std::to_string(image.height) +
                              " px with " + std::to_string(image.depth_m.size()) + " values, the camera model says " +
                              std::to_string(camera.width) + " x " + std::to_string(camera.height) + " px");
}

DepthClassifier::DepthClassifier(const CameraModel& camera, const GpisConfig& config)
    : camera_(camera), config_(config), ray_length_(static_cast<std::size_t>(camera.width) * camera.height) {
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const double x = (u - camera.cx) / camera.fx;
      const double y = (v - camera.cy) / camera.fy;
      ray_length_[static_cast<std::size_t>(v) * camera.width + u] = static_cast<float>(std::sqrt(x * x + y * y + 1.0));
    }
  }
}

void DepthClassifier::classifyHole(const float* depth, int begin, int end, PixelKind* kind) const {
  const auto set = [&](PixelKind value) { std::fill(kind + begin, kind + end, value); };
  if (config_.sensor.hole_policy == HolePolicy::kWall) return set(PixelKind::kWall);
  if (config_.sensor.hole_policy == HolePolicy::kNoInformation) return set(PixelKind::kNoInformation);

  const int width_px = end - begin;
  const bool has_left = begin > 0;
  const bool has_right = end < camera_.width;
  const float left = has_left ? depth[begin - 1] : 0.0f;
  const float right = has_right ? depth[end] : 0.0f;
  // A border nearer than the sensor can measure: the hole is that thing's own body.
  const float too_near = static_cast<float>(1.2 * config_.sensor.min_range_m);
  if ((has_left && left < too_near) || (has_right && right < too_near)) return set(PixelKind::kNoInformation);

  const auto isDepth = [](float z) { return std::isfinite(z) && z > 0.0f; };
  double near_m = 1e9;
  double far_m = 0.0;
  for (const float z : {left, right}) {
    if (!isDepth(z)) continue;
    near_m = std::min<double>(near_m, z);
    far_m = std::max<double>(far_m, z);
  }
  if (far_m == 0.0) return set(PixelKind::kWall);
  const double focal_baseline = camera_.fx * config_.sensor.baseline_m;
  const bool one_sided = !(isDepth(left) && isDepth(right));
  const double edge_m = 4.0 * config_.sensor.noise.sigma(near_m) + 0.02 * near_m;
  // Widest shadow that the near border can throw on the far one; on the image border the far side is unseen.
  const double shadow_px = focal_baseline * (1.0 / near_m - (one_sided ? 0.0 : 1.0 / far_m));
  if ((one_sided || far_m - near_m > edge_m) && config_.sensor.baseline_m > 0.0 && width_px <= 1.2 * shadow_px + 2.0) {
    return set(PixelKind::kNoInformation);
  }
  if (!one_sided && far_m - near_m <= edge_m) {
    if (width_px <= kSpecklePx) return set(PixelKind::kNoInformation);
    const double widest_shadow_px = focal_baseline * (1.0 / near_m - 1.0 / config_.sensor.max_range_m);
    if (width_px <= std::max<double>(kWideHolePx, widest_shadow_px)) return set(PixelKind::kAmbiguous);
  }
  set(PixelKind::kWall);
}

void DepthClassifier::classifyRow(const DepthImage& image, int v, ClassifiedFrame* frame) const {
  const int width = camera_.width;
  const std::size_t row = frame->index(0, v);
  const float* depth = &image.depth_m[row];
  PixelKind* kind = &frame->kind[row];
  const float min_range = static_cast<float>(config_.sensor.min_range_m);
  const float wall = static_cast<float>(1.0 / config_.frame_map.wall_range_m);
  for (int u = 0; u < width; ++u) {
    const float z = depth[u];
    if (z == 0.0f) {
      int end = u + 1;
      while (end < width && depth[end] == 0.0f) ++end;
      classifyHole(depth, u, end, kind);
      u = end - 1;
    } else if (std::isfinite(z) && z > 0.0f) {
      kind[u] = z * ray_length_[row + u] < min_range ? PixelKind::kNoInformation : PixelKind::kSurface;
    } else {
      // REP-117: +Inf no return; -Inf too close, NaN and (against the rule) negative depths no information.
      kind[u] = std::isinf(z) && z > 0.0f ? PixelKind::kWall : PixelKind::kNoInformation;
    }
  }
  for (int u = 0; u < width; ++u) {
    if (kind[u] == PixelKind::kSurface) {
      frame->inverse_depth[row + u] = 1.0f / depth[u];
      frame->inverse_range[row + u] = std::max(wall, 1.0f / (depth[u] * ray_length_[row + u]));
    } else {
      frame->inverse_range[row + u] = wall;
    }
  }
  // Filled for the GP only, so that the grid stays complete: the last value to the left, else the next to the right.
  float last = -1.0f;
  for (int u = 0; u < width; ++u) {
    if (kind[u] != PixelKind::kNoInformation) {
      last = frame->inverse_range[row + u];
    } else if (last >= 0.0f) {
      frame->inverse_range[row + u] = last;
    } else {
      int next = u;
      while (next < width && kind[next] == PixelKind::kNoInformation) ++next;
      if (next < width) frame->inverse_range[row + u] = frame->inverse_range[row + next];
    }
  }
}

ClassifiedFrame DepthClassifier::classify(const DepthImage& image, int num_threads) const {
  const std::size_t size = static_cast<std::size_t>(camera_.width) * camera_.height;
  requireFits(image, camera_);
  ClassifiedFrame frame;
  frame.width = camera_.width;
  frame.height = camera_.height;
  frame.inverse_depth.assign(size, 0.0f);
  frame.inverse_range.assign(size, 0.0f);
  frame.kind.assign(size, PixelKind::kNoInformation);
  parallelFor(static_cast<std::size_t>(camera_.height), num_threads, 32, [&](std::size_t begin, std::size_t end) {
    for (std::size_t v = begin; v < end; ++v) classifyRow(image, static_cast<int>(v), &frame);
  });
  std::vector<std::uint8_t> unknown(size);
  for (std::size_t i = 0; i < size; ++i) {
    unknown[i] = frame.kind[i] == PixelKind::kNoInformation;
    frame.num_surface += frame.kind[i] == PixelKind::kSurface;
  }
  const int radius_u = static_cast<int>(std::ceil(config_.frame_map.kernel_length_rad * camera_.fx));
  const int radius_v = static_cast<int>(std::ceil(config_.frame_map.kernel_length_rad * camera_.fy));
  dilate(unknown, camera_.width, camera_.height, radius_u, radius_v, &frame.blocked);
  return frame;
}

}  // namespace gpis_mapping
