// SPDX-License-Identifier: BSD-3-Clause
#include "insertion_grid.h"

#include <algorithm>
#include <cmath>

#include <interactive_mapping_common/threads/parallel_for.h>

namespace gpis_mapping {
namespace {

constexpr double kMaxNoiseReach_m = 0.06;  // no noise makes one surface of two that are farther apart
constexpr float kMinInserted_m = 0.05f;

}  // namespace

double Crowding::reach(double variance_m2) const {
  // Far away the noise exceeds the spacing: two points of one face that differ by noise alone are one point, or a
  // wall would be stored twice.
  const double noise = tolerance_sigmas * std::sqrt(2.0 * variance_m2);
  return std::min(kMaxNoiseReach_m, std::max(spacing_m, noise));
}

InsertionGrid::InsertionGrid(const Frame& frame, const GpisConfig& config, const Crowding& crowding, int num_threads)
    : frame_(frame),
      crowding_(crowding),
      rows_((frame.pixels().height + kStridePx - 1) / kStridePx),
      columns_((frame.pixels().width + kStridePx - 1) / kStridePx),
      pixels_(static_cast<std::size_t>(rows_) * columns_),
      open_(pixels_.size()) {
  const ClassifiedFrame& image = frame.pixels();
  const CameraModel& camera = frame.camera();
  // The raw depth is good enough here.
  const float max_range = static_cast<float>(1.05 * config.sensor.max_range_m);
  interactive_mapping::parallelFor(
      static_cast<std::size_t>(rows_), num_threads, 8, [&](std::size_t begin, std::size_t end) {
        for (int row = static_cast<int>(begin); row < static_cast<int>(end); ++row) {
          for (int column = 0; column < columns_; ++column) {
            const int u = column * kStridePx;
            const int v = row * kStridePx;
            const std::size_t at = image.index(u, v);
            Pixel& pixel = pixels_[index(row, column)];
            pixel.reach_m = 0.0f;
            if (image.kind[at] != PixelKind::kSurface || image.blocked[at] != Block::kNone) continue;
            const Eigen::Vector3d ray((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
            pixel.p_camera = (ray / image.inverse_depth[at]).cast<float>();
            if (pixel.p_camera.norm() > max_range) continue;
            open_[index(row, column)].store(1, std::memory_order_relaxed);
            if (!frame.map().isSmooth(u, v)) continue;
            pixel.n_camera = frame.map().trendNormal(u, v);
            pixel.variance_m2 = static_cast<float>(frame.correlatedVariance(pixel.p_camera.z()));
            pixel.reach_m = static_cast<float>(crowding.reach(pixel.variance_m2));
          }
        }
      });
}

void InsertionGrid::strikeOut(const SurfacePoint& point) {
  const CameraModel& camera = frame_.camera();
  const Eigen::Vector3f p = (frame_.T_camera_map() * point.position_map).cast<float>();
  if (p.z() < kMinInserted_m) return;
  const float u = static_cast<float>(camera.fx) * p.x() / p.z() + static_cast<float>(camera.cx);
  const float v = static_cast<float>(camera.fy) * p.y() / p.z() + static_cast<float>(camera.cy);
  // Across the ray no farther than the spacing: what is missed farther along a slanted normal, a search finds.
  const float spacing = static_cast<float>(crowding_.spacing_m);
  const float radius_u = spacing * static_cast<float>(camera.fx) / p.z();
  const float radius_v = spacing * static_cast<float>(camera.fy) / p.z();
  constexpr float kStride = kStridePx;
  if (!(u + radius_u >= 0.0f && v + radius_v >= 0.0f && u - radius_u < kStride * static_cast<float>(columns_) &&
        v - radius_v < kStride * static_cast<float>(rows_))) {
    return;
  }
  const int first_column = std::max(0, static_cast<int>(std::ceil((u - radius_u) / kStride)));
  const int last_column = std::min(columns_ - 1, static_cast<int>((u + radius_u) / kStride));
  const int first_row = std::max(0, static_cast<int>(std::ceil((v - radius_v) / kStride)));
  const int last_row = std::min(rows_ - 1, static_cast<int>((v + radius_v) / kStride));
  const Eigen::Vector3f n = frame_.T_camera_map().linear().cast<float>() * point.normal_map;
  for (int row = first_row; row <= last_row; ++row) {
    for (int column = first_column; column <= last_column; ++column) {
      const std::size_t i = index(row, column);
      const Pixel& pixel = pixels_[i];
      if (pixel.reach_m == 0.0f) continue;
      const Eigen::Vector3f offset = pixel.p_camera - p;
      if (crowding_.leavesNoRoom<float>(offset, n, pixel.n_camera, pixel.variance_m2 + point.variance_m2,
                                        pixel.reach_m)) {
        open_[i].store(0, std::memory_order_relaxed);
      }
    }
  }
}

}  // namespace gpis_mapping
