// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_POINT_UPDATE_H
#define GPIS_MAPPING_POINT_UPDATE_H

#include <memory>
#include <optional>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "gpis_mapping/cell_gp.h"
#include "gpis_mapping/frame_map.h"
#include "gpis_mapping/gpis_config.h"
#include "gpis_mapping/types.h"

namespace gpis_mapping {

/// A piece of surface as one frame shows it at one bearing.
struct SurfaceMeasurement {
  Eigen::Vector3d point_camera;   // on the bearing's ray [m] (x_s, eq 6)
  Eigen::Vector3f normal_camera;  // unit, towards the camera
  double cosine;                  // of incidence
  double variance_m2;             // across the surface: noise along the ray, pixel footprint, camera pose
  double normal_variance;         // of each tangential component of the normal
};

/// What a frame says about a stored point (Algorithm 1).
enum class PointOutcome {
  kNothing,   // out of view, without information, or seen from behind
  kDoubtful,  // beside a depth edge, where one image cannot decide
  kOccluded,  // something stands before it: left as it is
  kFused,     // the same surface
  kDeleted,   // seen past
};

/// One depth image with everything derived from it, ready to be held against the map.
class Frame {
 public:
  /// `config` must outlive the frame.
  Frame(const GpisConfig& config, std::shared_ptr<const ClassifiedFrame> pixels,
        std::shared_ptr<const FrameRegressor> regressor, const Eigen::Isometry3d& T_map_camera, float stamp_s,
        int num_threads);

  /// The surface at pixel coordinates (u, v): from the 2.5D^-1 map where that is smooth, else from the raw pixels on
  /// the near pixel's side of the depth edge. None where no single surface shows.
  std::optional<SurfaceMeasurement> measure(double u, double v) const;

  /// Algorithm 1 for one point: compares it with the frame (eq 7), and moves it and firms it up if it is fused.
  PointOutcome apply(SurfacePoint* point) const;

  const ClassifiedFrame& pixels() const { return *pixels_; }
  const FrameMap& map() const { return map_; }
  const CameraModel& camera() const { return map_.regressor().camera(); }
  const Eigen::Isometry3d& T_map_camera() const { return T_map_camera_; }
  const Eigen::Isometry3d& T_camera_map() const { return T_camera_map_; }
  float stamp() const { return stamp_s_; }  // [s since the map's epoch]

  /// Variance [m^2] of a depth at z_m that smoothing cannot remove: neighbouring pixels have it in common.
  double correlatedVariance(double z_m) const;

 private:
  PointOutcome fuse(const SurfaceMeasurement& seen, const Eigen::Vector3d& p_camera, SurfacePoint* point) const;
  bool isStray(const SurfaceMeasurement& seen, const Eigen::Vector3d& p_camera,
               const Eigen::Vector3f& normal_camera) const;

  const GpisConfig& config_;
  std::shared_ptr<const ClassifiedFrame> pixels_;
  FrameMap map_;
  Eigen::Isometry3d T_map_camera_;
  Eigen::Isometry3d T_camera_map_;
  float stamp_s_;
};

/// Normals closer than this (60 degrees) belong to one face.
constexpr float kSameFaceCosine = 0.5f;

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_POINT_UPDATE_H
