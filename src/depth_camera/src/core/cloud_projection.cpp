// SPDX-License-Identifier: BSD-3-Clause
#include "depth_camera/cloud_projection.h"

#include <cmath>
#include <limits>

namespace depth_camera {

DepthImage projectPoints(const Eigen::Ref<const Eigen::Matrix3Xf>& points_cloud, const Eigen::Matrix3f& R_view_cloud,
                         const CameraModel& camera) {
  DepthImage image{camera.width, camera.height, {}};
  image.depth_m.assign(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height),
                       std::numeric_limits<float>::quiet_NaN());
  for (Eigen::Index i = 0; i < points_cloud.cols(); ++i) {
    const Eigen::Vector3f point = R_view_cloud * points_cloud.col(i);
    if (!point.allFinite() || point.z() <= 0.0f) continue;
    const double u = std::round(camera.fx * point.x() / point.z() + camera.cx);
    const double v = std::round(camera.fy * point.y() / point.z() + camera.cy);
    if (!(u >= 0.0 && u < camera.width && v >= 0.0 && v < camera.height)) continue;
    float& depth = image.depth_m[static_cast<std::size_t>(v) * camera.width + static_cast<std::size_t>(u)];
    if (!(depth <= point.z())) depth = point.z();  // NaN, or farther
  }
  return image;
}

}  // namespace depth_camera
