// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_POINT_UPDATE_H
#define GPIS_MAPPING_POINT_UPDATE_H

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

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
  kNothing,    // out of view, without information, or seen from behind
  kDoubtful,   // beside a depth edge, where one image cannot decide
  kOccluded,   // something stands before it: left as it is
  kFused,      // the same surface
  kConfirmed,  // its pixel is as deep, but beside a hole or an edge, where a plane cannot be fitted
  kDeleted,    // seen past
  kUnseen,     // its pixel is a hole, as it may well be from here
  kMissing,    // its pixel is a hole, although the sensor measured the point from about here
};

/// A frame's 2.5D^-1 map with eq 7's tolerance about it, for display. A row-major grid over the image.
struct FrameBlanket {
  /// On one ray, map frame [m]: the mean, and where a point of the map known best would be deleted or occluded. No farther
  /// than `max_range_m`, where the virtual wall so stands. NaN: the frame says nothing here.
  struct Knot {
    Eigen::Vector3f nearer, seen, farther;
    bool is_wall;
  };
  int columns{0};
  std::vector<Knot> knots;
  Eigen::Vector3d camera_map{Eigen::Vector3d::Zero()};
};

/// How fast the camera moved when the image was taken.
struct CameraMotion {
  double speed_mps{0.0};
  double turn_radps{0.0};
};

/// One depth image with everything derived from it, ready to be held against the map.
class Frame {
 public:
  /// `config` and `pixel_history` must outlive the frame; the latter is row major.
  Frame(const GpisConfig& config, std::shared_ptr<const ClassifiedFrame> pixels,
        std::shared_ptr<const FrameRegressor> regressor, const std::vector<PixelHistory>& pixel_history,
        const Eigen::Isometry3d& T_map_camera, const CameraMotion& motion, float stamp_s, int num_threads);

  /// How the frame as a whole is off the map. A point p of the map is seen at p + shift + turn x p, camera frame [m,
  /// rad]. One robust point-to-plane step over `points`; zero where they tell too little. What most surfaces say is an
  /// error of the camera's pose. It is allowed for, not corrected: the pose is given.
  struct Misalignment {
    Eigen::Vector3d shift_m{Eigen::Vector3d::Zero()};
    Eigen::Vector3d turn_rad{Eigen::Vector3d::Zero()};
    Eigen::Matrix<double, 6, 6> covariance{
        Eigen::Matrix<double, 6, 6>::Identity()};  // shift, turn: 1 m, 1 rad is unknown
    double rms_m{0.0};                             // of the displacement across the surfaces
  };
  Misalignment measureMisalignment(const std::vector<const SurfacePoint*>& points) const;

  /// Tolerances allow for it from here on.
  void allowFor(const Misalignment& misalignment) { misalignment_ = misalignment; }

  /// The surface at pixel coordinates (u, v), from the 2.5D^-1 map where that is smooth. Otherwise from the raw pixels
  /// on the near pixel's side of the depth edge. None where no single surface shows.
  std::optional<SurfaceMeasurement> measure(double u, double v) const { return measure(u, v, map_.infer(u, v)); }

  /// Every `stride_px`-th pixel.
  FrameBlanket blanket(int stride_px) const;

  /// Algorithm 1 for one point: compares it with the frame (eq 7), and moves it and firms it up if it is fused.
  PointOutcome apply(SurfacePoint* point) const;

  const ClassifiedFrame& pixels() const { return *pixels_; }
  const FrameMap& map() const { return map_; }
  const CameraModel& camera() const { return map_.regressor().camera(); }
  const Eigen::Isometry3d& T_map_camera() const { return T_map_camera_; }
  const Eigen::Isometry3d& T_camera_map() const { return T_camera_map_; }
  float stamp() const { return stamp_s_; }  // [s since the map's epoch]

  /// Whether the sensor could measure the point, in front of the camera, at its distance; noise included.
  bool isInReach(const Eigen::Vector3d& p_map) const;

  /// Pixel coordinates of a point in front of the camera; none outside the image.
  std::optional<Eigen::Vector2i> pixelOf(const Eigen::Vector3d& p_map) const;

  /// Variance [m^2] of a depth at z_m that smoothing cannot remove: neighbouring pixels have it in common.
  double correlatedVariance(double z_m) const;

 private:
  std::optional<SurfaceMeasurement> measure(double u, double v, const FrameMap::Inference& inferred) const;
  PointOutcome fuse(const SurfaceMeasurement& seen, const Eigen::Vector3d& p_camera, SurfacePoint* point) const;
  /// Variance [m^2], across a surface of that normal at that point, that the camera's pose causes; camera frame.
  double poseVariance(const Eigen::Vector3d& p_camera, const Eigen::Vector3d& normal_camera) const;
  /// Eq 7's g sigma [1/m] at a point of this variance. `facing`: the flatter normal there; `across`: cosine of incidence.
  double tolerance(const Eigen::Vector3d& p_camera, const Eigen::Vector3d& facing, double across, double variance_m2,
                   double seen_sigma) const;
  /// Would the sensor measure the point from here, as it did when it saw the point last?
  bool isDue(const SurfacePoint& point, const Eigen::Vector3d& p_camera) const;
  /// A look that speaks against the point without deciding: several running do.
  PointOutcome miss(SurfacePoint* point) const;
  bool isStray(const SurfaceMeasurement& seen, const Eigen::Vector3d& p_camera,
               const Eigen::Vector3f& normal_camera) const;

  const GpisConfig& config_;
  std::shared_ptr<const ClassifiedFrame> pixels_;
  Eigen::Isometry3d T_map_camera_;
  Eigen::Isometry3d T_camera_map_;
  const std::vector<PixelHistory>& pixel_history_;
  double motion_variance_;  // [m^2] of the camera's position by its speed and the error of stamps
  double angle_variance_;   // [rad^2] of its rotation, by its turning as well
  Misalignment misalignment_;
  float stamp_s_;
  FrameMap map_;
};

/// Normals closer than this (60 degrees) belong to one face.
constexpr float kSameFaceCosine = 0.5f;

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_POINT_UPDATE_H
