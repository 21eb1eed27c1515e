// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include <Eigen/Geometry>
#include <opencv2/core.hpp>

#include "synthetic_depth/scene.h"

namespace synthetic_depth {

/// Casts rays from one viewpoint into the state of a scene at one frame. Boxes are binned into image tiles by their
/// projected bounding rectangles, so a ray meets only the few boxes that can be under its pixel. A box that contains the
/// viewpoint is not seen. Immutable once built: safe for concurrent use.
class ViewCaster {
 public:
  struct Hit {
    double z_m;  ///< depth along the optical axis (not ray length); +Inf if nothing is hit
    int id;      ///< box id, kGroundId or kNoReturnId
  };

  /// `T_scene_view`: optical frame of the viewpoint; intrinsics are those of the scene's camera.
  ViewCaster(const Scene& scene, int frame, const Eigen::Isometry3d& T_scene_view);

  /// First surface on the ray through pixel (u, v); not limited to the image and not to whole pixels.
  Hit cast(double u_px, double v_px) const;

  /// Whether the straight line from the viewpoint to a point in front of it (view frame, z > 0) meets nothing nearer
  /// than `tolerance_m` (along z) before the point. The image border plays no part.
  bool isVisible(const Eigen::Vector3d& p_view, double tolerance_m = 1e-6) const;

 private:
  struct ProjectedBox {
    Eigen::Matrix3d R_box_view;
    Eigen::Vector3d view_in_box;
    Eigen::Vector3d half_extents_m;
    double nearest_z_m;
    int id;
  };

  const std::vector<int>& candidates(double u_px, double v_px) const;

  CameraModel camera_;
  std::vector<ProjectedBox> boxes_;      // nearest first
  std::vector<int> all_boxes_;           // indices into boxes_, for rays outside the tiles
  std::vector<std::vector<int>> tiles_;  // indices into boxes_, nearest first
  int tile_columns_;
  int tile_rows_;
  bool has_ground_;
  double height_over_ground_m_;
  Eigen::Vector3d ground_normal_view_;
};

/// Exact z-depth of a frame [m]: CV_32FC1, +Inf where the ray meets nothing, no range limits. `box_ids`, if given,
/// becomes CV_32SC1 with box id, kGroundId or kNoReturnId. Throws std::out_of_range for a frame the scene has not.
cv::Mat renderDepth(const Scene& scene, int frame, cv::Mat* box_ids = nullptr);

}  // namespace synthetic_depth
