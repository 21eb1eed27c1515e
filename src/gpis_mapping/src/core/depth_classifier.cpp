// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/depth_classifier.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <utility>

#include <opencv2/core/types.hpp>

#include <interactive_mapping_common/threads/parallel_for.h>

namespace gpis_mapping {
namespace {

using interactive_mapping::parallelFor;

// A dropout this narrow between two pieces of one surface cannot be told from speckle.
constexpr int kSpecklePx = 3;
// Speckle has at most that many pixels in a window that reaches so far around it.
constexpr int kSpeckleWindowPx = 2;
// How near the ends of a shadow its depth edge is.
constexpr int kEdgeReachPx = 3;
// Sensors leave out up to that many pixels beside a depth edge.
constexpr int kEdgeGapPx = 6;

/// 1 where any pixel of the ellipse with half axes (radius_u, radius_v) about a pixel of `source` is set.
void dilate(const std::vector<std::uint8_t>& source, int width, int height, double radius_u, double radius_v,
            int num_threads, std::vector<std::uint8_t>* result) {
  result->assign(source.size(), 0);
  const int rows = static_cast<int>(radius_v);
  using Runs = std::vector<std::pair<int, int>>;  // of set pixels in a row
  std::vector<Runs> runs_of(static_cast<std::size_t>(height));
  parallelFor(runs_of.size(), num_threads, 32, [&](std::size_t begin, std::size_t end) {
    for (std::size_t w = begin; w < end; ++w) {
      const std::uint8_t* const in = &source[w * width];
      const auto next = [&](const std::uint8_t* from, int value) {
        const void* found = std::memchr(from, value, static_cast<std::size_t>(in + width - from));
        return found != nullptr ? static_cast<const std::uint8_t*>(found) : in + width;
      };
      for (const std::uint8_t* first = next(in, 1); first != in + width;) {
        const std::uint8_t* const last = next(first, 0);
        runs_of[w].emplace_back(static_cast<int>(first - in), static_cast<int>(last - in));
        first = next(last, 1);
      }
    }
  });
  parallelFor(runs_of.size(), num_threads, 32, [&](std::size_t begin, std::size_t end) {
    for (int v = static_cast<int>(begin); v < static_cast<int>(end); ++v) {
      std::uint8_t* const out = &(*result)[static_cast<std::size_t>(v) * width];
      for (int w = std::max(0, v - rows); w <= std::min(height - 1, v + rows); ++w) {
        const Runs& runs = runs_of[static_cast<std::size_t>(w)];
        if (runs.empty()) continue;
        const double share = (v - w) / radius_v;
        const int reach = static_cast<int>(radius_u * std::sqrt(std::max(0.0, 1.0 - share * share)));
        int filled_to = 0;  // what this row of the source adds to out[0, filled_to) is there
        for (const auto& [first, last] : runs) {
          const int to = std::min(width, last + reach);
          const int from = std::max(filled_to, first - reach);
          if (from < to) std::fill(out + from, out + to, 1);
          filled_to = to;
        }
      }
    }
  });
}

}  // namespace

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

double DepthClassifier::edgeDepth(double near_m) const {
  return 4.0 * config_.sensor.noise.sigma(near_m) + 0.02 * near_m;
}

void DepthClassifier::classifyHole(const float* depth, int begin, int end, PixelKind* kind) const {
  const auto set = [&](PixelKind value) { std::fill(kind + begin, kind + end, value); };
  if (config_.sensor.hole_policy == HolePolicy::kWall) return set(PixelKind::kWall);
  if (config_.sensor.hole_policy == HolePolicy::kNoInformation) return set(PixelKind::kNoInformation);
  // A border nearer than the sensor can measure: the hole is that thing's own body.
  const float too_near = static_cast<float>(1.2 * config_.sensor.min_range_m);
  const bool is_body = (begin > 0 && depth[begin - 1] < too_near) || (end < camera_.width && depth[end] < too_near);
  set(is_body ? PixelKind::kNoInformation : PixelKind::kHole);
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
    if (isMeasured(kind[u])) {
      last = frame->inverse_range[row + u];
    } else if (last >= 0.0f) {
      frame->inverse_range[row + u] = last;
    } else {
      int next = u;
      while (next < width && !isMeasured(kind[next])) ++next;
      if (next < width) {
        std::fill(&frame->inverse_range[row + u], &frame->inverse_range[row + next], frame->inverse_range[row + next]);
      }
      u = next - 1;  // once for all of them: a wide hole must not be counted through for each of its pixels
    }
  }
}

double DepthClassifier::widestShadowPx(double near_m, double far_m) const {
  const double shadow_px = camera_.fx * config_.sensor.baseline_m * (1.0 / near_m - 1.0 / far_m);
  return 1.2 * shadow_px + 2.0;  // depths at the border are noisy, and a pixel at each end is half hidden
}

void DepthClassifier::markGaps(const DepthImage& image, int num_threads, ClassifiedFrame* frame,
                               std::vector<std::uint8_t>* is_shadow) const {
  const cv::Rect whole(0, 0, camera_.width, camera_.height);
  const auto isTold = [&](int u, int v) { return isMeasured(frame->kind[frame->index(u, v)]); };
  const auto explain = [&](const cv::Rect& gap, bool is_row) {
    bool is_zero = true;
    for (int v = gap.y; v < gap.br().y; ++v) {
      for (int u = gap.x; u < gap.br().x; ++u) {
        const float z = image.at(u, v);
        if ((std::isinf(z) && z < 0.0f) || z > 0.0f) return;  // -Inf, or a depth below the least range: a body
        is_zero = is_zero && z == 0.0f;
      }
    }
    // Round both ends: flying pixels and noise make the outline of a gap ragged.
    constexpr int kWide = 2 * kEdgeReachPx + 1;
    const cv::Size end_size = is_row ? cv::Size(kEdgeReachPx, kWide) : cv::Size(kWide, kEdgeReachPx);
    const cv::Point before(gap.x - kEdgeReachPx, gap.y - kEdgeReachPx);
    const cv::Point after = is_row ? cv::Point(gap.br().x, before.y) : cv::Point(before.x, gap.br().y);
    float high = 0.0f;
    float low = std::numeric_limits<float>::infinity();
    float nearest = 0.0f;
    for (const cv::Rect& end : {cv::Rect(before, end_size) & whole, cv::Rect(after, end_size) & whole}) {
      for (int v = end.y; v < end.br().y; ++v) {
        for (int u = end.x; u < end.br().x; ++u) {
          const std::size_t i = frame->index(u, v);
          if (!isTold(u, v)) continue;
          high = std::max(high, frame->inverse_depth[i]);
          low = std::min(low, frame->inverse_depth[i]);
          nearest = std::max(nearest, frame->inverse_range[i]);
        }
      }
    }
    const double near_m = 1.0 / std::max(1e-9f, high);
    const double far_m = 1.0 / std::max(1e-9f, low);
    if (far_m - near_m <= edgeDepth(near_m)) return;
    const bool is_of_baseline = is_row && config_.sensor.baseline_m > 0.0 && gap.width <= widestShadowPx(near_m, far_m);
    if (!is_of_baseline && gap.area() > kEdgeGapPx) return;
    for (int v = gap.y; v < gap.br().y; ++v) {
      for (int u = gap.x; u < gap.br().x; ++u) {
        const std::size_t i = frame->index(u, v);
        if (is_of_baseline) (*is_shadow)[i] = 1;
        if (is_zero) frame->clear_to[i] = std::max(frame->clear_to[i], nearest);
      }
    }
  };
  // Those along rows first, then those along columns: threads write to rows or to columns of their own.
  parallelFor(static_cast<std::size_t>(camera_.height), num_threads, 32, [&](std::size_t begin, std::size_t end) {
    for (int v = static_cast<int>(begin); v < static_cast<int>(end); ++v) {
      int begin_u = 0;
      for (int u = 0; u < camera_.width; ++u) {
        if (!isTold(u, v)) continue;
        if (begin_u > 0 && begin_u < u) explain({begin_u, v, u - begin_u, 1}, true);
        begin_u = u + 1;
      }
    }
  });
  parallelFor(static_cast<std::size_t>(camera_.width), num_threads, 64, [&](std::size_t begin, std::size_t end) {
    std::vector<int> begin_v(end - begin, 0);  // of the gap above this row
    for (int v = 0; v < camera_.height; ++v) {
      for (int u = static_cast<int>(begin); u < static_cast<int>(end); ++u) {
        if (!isTold(u, v)) continue;
        int& gap = begin_v[static_cast<std::size_t>(u) - begin];
        const int height = v - gap;
        if (gap > 0 && height > 0 && height <= kEdgeGapPx) explain({u, gap, 1, height}, false);
        gap = v + 1;
      }
    }
  });
}

Block DepthClassifier::blockOf(const ClassifiedFrame& frame, int u, int v, bool is_shadow) const {
  const bool is_hole = frame.kind[frame.index(u, v)] == PixelKind::kHole;
  const Block of_many = is_shadow || is_hole ? Block::kNarrow : Block::kNoInformation;
  int dropouts = 0;
  float low = std::numeric_limits<float>::infinity();
  float high = 0.0f;
  for (int y = std::max(0, v - kSpeckleWindowPx); y <= std::min(camera_.height - 1, v + kSpeckleWindowPx); ++y) {
    for (int x = std::max(0, u - kSpeckleWindowPx); x <= std::min(camera_.width - 1, u + kSpeckleWindowPx); ++x) {
      const std::size_t i = frame.index(x, y);
      if (!isMeasured(frame.kind[i])) {
        if (++dropouts > kSpecklePx) return of_many;
        continue;
      }
      low = std::min(low, frame.inverse_depth[i]);  // 0: wall
      high = std::max(high, frame.inverse_depth[i]);
    }
  }
  if (!std::isfinite(low)) return of_many;  // an image of a pixel or two
  if (high == 0.0f) return Block::kNone;    // wall all round
  if (low > 0.0f && 1.0 / low - 1.0 / high <= edgeDepth(1.0 / high)) return Block::kNone;
  return Block::kNarrow;
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
  frame.clear_to.assign(size, 0.0f);
  parallelFor(static_cast<std::size_t>(camera_.height), num_threads, 32, [&](std::size_t begin, std::size_t end) {
    for (std::size_t v = begin; v < end; ++v) classifyRow(image, static_cast<int>(v), &frame);
  });
  std::vector<std::uint8_t> is_shadow(size, 0);
  std::vector<std::uint8_t> unknown(size, 0);
  std::vector<std::uint8_t> unexplained(size, 0);
  markGaps(image, num_threads, &frame, &is_shadow);
  std::atomic<std::size_t> num_surface{0};
  std::atomic<bool> is_any_unknown{false};
  const auto height = static_cast<std::size_t>(camera_.height);
  const auto width = static_cast<std::size_t>(camera_.width);
  parallelFor(height, num_threads, 32, [&](std::size_t begin, std::size_t end) {
    std::size_t num_here = 0;
    bool is_any_here = false;
    for (std::size_t i = begin * width; i < end * width; ++i) {
      num_here += frame.kind[i] == PixelKind::kSurface;
      if (isMeasured(frame.kind[i])) continue;
      const Block block = blockOf(frame, static_cast<int>(i % width), static_cast<int>(i / width), is_shadow[i] != 0);
      unknown[i] = block != Block::kNone;
      unexplained[i] = block == Block::kNoInformation;
      is_any_here = is_any_here || unknown[i] != 0;
    }
    num_surface += num_here;
    if (is_any_here) is_any_unknown = true;
  });
  frame.num_surface = num_surface;
  frame.blocked.assign(size, Block::kNone);
  parallelFor(height, num_threads, 64, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin * width; i < end * width; ++i) {
      const bool is_other = is_shadow[i] || !unknown[i];
      if (frame.kind[i] == PixelKind::kHole && is_other) frame.kind[i] = PixelKind::kNoInformation;
    }
  });
  if (!is_any_unknown) return frame;
  // Of a point, which lies up to half a diagonal from the middle of its pixel.
  const double radius_u = config_.frame_map.kernel_length_rad * camera_.fx + M_SQRT1_2;
  const double radius_v = config_.frame_map.kernel_length_rad * camera_.fy + M_SQRT1_2;
  std::vector<std::uint8_t> beside_any;
  std::vector<std::uint8_t> beside_unexplained;
  dilate(unknown, camera_.width, camera_.height, radius_u, radius_v, num_threads, &beside_any);
  dilate(unexplained, camera_.width, camera_.height, radius_u, radius_v, num_threads, &beside_unexplained);
  parallelFor(height, num_threads, 64, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin * width; i < end * width; ++i) {
      frame.blocked[i] = beside_unexplained[i] ? Block::kNoInformation : beside_any[i] ? Block::kNarrow : Block::kNone;
    }
  });
  return frame;
}

Eigen::AlignedBox3d DepthClassifier::viewBox(const ClassifiedFrame& frame,
                                             const Eigen::Isometry3d& T_map_camera) const {
  constexpr int kStride_px = 4;
  Eigen::AlignedBox3d box(Eigen::Vector3d(T_map_camera.translation()));
  for (int v = 0; v < frame.height; v += kStride_px) {
    for (int u = 0; u < frame.width; u += kStride_px) {
      const std::size_t i = frame.index(u, v);
      if (frame.kind[i] == PixelKind::kNoInformation) continue;
      const double range_m = std::min(1.0 / frame.inverse_range[i], config_.sensor.max_range_m);
      box.extend(T_map_camera * (camera_.ray(u, v) * (range_m / rayLength(u, v))));
    }
  }
  return box;
}

}  // namespace gpis_mapping
