// SPDX-License-Identifier: BSD-3-Clause
#include "recorded_frame.h"

#include <cmath>
#include <utility>

#include "synthetic_depth/sensor.h"

namespace experiments {

using synthetic_depth::Scene;

std::vector<RecordedFrame> record(const Scene& scene) {
  std::vector<RecordedFrame> frames;
  for (int k = 0; k < scene.numFrames(); ++k) {
    const cv::Mat depth = synthetic_depth::measureDepth(scene, k);
    RecordedFrame frame;
    frame.image.width = depth.cols;
    frame.image.height = depth.rows;
    frame.image.depth_m.assign(depth.ptr<float>(), depth.ptr<float>() + depth.total());
    frame.T_map_camera = scene.cameraInMap(k);
    frame.stamp_s = scene.stampSeconds(k);
    frame.cloud.reserve(depth.total());
    for (int v = 0; v < depth.rows; ++v) {
      for (int u = 0; u < depth.cols; ++u) {
        const double z = depth.at<float>(v, u);
        if (!std::isfinite(z)) continue;
        const Eigen::Vector3d p =
            frame.T_map_camera * (z * Eigen::Vector3d((u - scene.camera.cx_px) / scene.camera.fx_px,
                                                      (v - scene.camera.cy_px) / scene.camera.fy_px, 1.0));
        frame.cloud.push_back(static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()));
      }
    }
    frames.push_back(std::move(frame));
  }
  return frames;
}

gpis_mapping::CameraModel cameraOf(const Scene& scene) {
  const synthetic_depth::CameraModel& c = scene.camera;
  return {c.width_px, c.height_px, c.fx_px, c.fy_px, c.cx_px, c.cy_px};
}

octomap::point3d toOctomap(const Eigen::Vector3d& p) {
  return {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())};
}

}  // namespace experiments
