// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "depth_camera/depth_image.h"

namespace depth_camera {

/// What a pinhole at the sensor would measure of its points: the nearest point [m] per pixel, NaN where there is none.
/// `points_cloud` [m] in the frame of the cloud, whose origin is the sensor; those that are not finite are left out.
/// `R_view_cloud` turns the cloud's axes into the pinhole's (z along the optical axis, x right, y down).
DepthImage projectPoints(const Eigen::Ref<const Eigen::Matrix3Xf>& points_cloud, const Eigen::Matrix3f& R_view_cloud,
                         const CameraModel& camera);

}  // namespace depth_camera
