// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include <Eigen/Geometry>
#include <octomap/Pointcloud.h>

#include "gpis_mapping/types.h"
#include "synthetic_depth/scene.h"

namespace experiments {

constexpr double kMaxRange_m = 3.5;  // of OctoMap's rays, as the maps' own

/// What each map is given.
struct RecordedFrame {
  gpis_mapping::DepthImage image;
  octomap::Pointcloud cloud;  // map frame [m]
  Eigen::Isometry3d T_map_camera;
  double stamp_s;
};

/// All frames of a scene as its sensor measures them.
std::vector<RecordedFrame> record(const synthetic_depth::Scene& scene);

gpis_mapping::CameraModel cameraOf(const synthetic_depth::Scene& scene);
octomap::point3d toOctomap(const Eigen::Vector3d& p);

}  // namespace experiments
