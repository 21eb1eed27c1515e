// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_TEST_DEPTH_FRAMES_H
#define GPIS_MAPPING_TEST_DEPTH_FRAMES_H

#include <cmath>
#include <functional>
#include <memory>
#include <utility>

#include <Eigen/Core>

#include "gpis_mapping/depth_classifier.h"
#include "gpis_mapping/types.h"

namespace gpis_mapping_test {

/// Depth along the optical axis at which the ray of a pixel meets the plane n . x = offset (camera frame).
inline double planeDepth(const Eigen::Vector3d& ray, const Eigen::Vector3d& n, double offset) {
  return offset / n.dot(ray);
}

/// A frame in which every pixel measured `depth(u, v)` [m], classified by hand.
inline std::shared_ptr<gpis_mapping::ClassifiedFrame> makeFrame(const gpis_mapping::CameraModel& camera,
                                                                const std::function<double(int, int)>& depth) {
  auto frame = std::make_shared<gpis_mapping::ClassifiedFrame>();
  const std::size_t size = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  frame->width = camera.width;
  frame->height = camera.height;
  frame->inverse_depth.resize(size);
  frame->inverse_range.resize(size);
  frame->kind.assign(size, gpis_mapping::PixelKind::kSurface);
  frame->blocked.assign(size, gpis_mapping::Block::kNone);
  frame->clear_to.assign(size, 0.0f);
  frame->num_surface = size;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const double z = depth(u, v);
      frame->inverse_depth[frame->index(u, v)] = static_cast<float>(1.0 / z);
      frame->inverse_range[frame->index(u, v)] = static_cast<float>(1.0 / (z * camera.ray(u, v).norm()));
    }
  }
  return frame;
}

}  // namespace gpis_mapping_test

#endif  // GPIS_MAPPING_TEST_DEPTH_FRAMES_H
