// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace synthetic_depth {

/// Object id of the ground in id images and surface samples.
constexpr int kGroundId = -1;
/// Object id of a pixel whose ray meets nothing.
constexpr int kNoReturnId = -2;
/// Frame number of an event that does not happen.
constexpr int kNever = std::numeric_limits<int>::max();

/// Solid box with any pose.
struct Box {
  int id{0};                                                        ///< unique in its scene, >= 0
  Eigen::Isometry3d T_scene_box{Eigen::Isometry3d::Identity()};     ///< pose of the box centre
  Eigen::Vector3d half_extents_m{Eigen::Vector3d::Constant(0.05)};  ///< > 0, along the axes of the box
  double albedo{1.0};                                               ///< share of the camera's light sent back, 0 .. 1
  int appears_at_frame{0};                                          ///< first frame that has the box
  int vanishes_at_frame{kNever};                                    ///< first frame that no longer has it

  bool isPresent(int frame) const { return frame >= appears_at_frame && frame < vanishes_at_frame; }
};

/// Pinhole camera without distortion, on purpose not that of the packages under test: it is their oracle. Pixel (u, v) is
/// the ray through (u, v): pixel centres are at integers.
struct CameraModel {
  int width_px{640};
  int height_px{480};
  double fx_px{525.0};
  double fy_px{525.0};
  double cx_px{319.5};
  double cy_px{239.5};
};

/// What turns exact depth into a measurement. Every effect is off at its default.
struct SensorModel {
  double min_range_m{0.0};                                      ///< nearer than this is -Inf
  double max_range_m{std::numeric_limits<double>::infinity()};  ///< farther than this is +Inf
  double axial_noise_a_m{0.0};                                  ///< sigma_z = max(0, a + b z + c z^2), in metres
  double axial_noise_b{0.0};
  double axial_noise_c_per_m{0.0};
  double baseline_m{0.0};            ///< second viewpoint at +baseline on the camera's x axis
  bool has_shadows{false};           ///< points the second viewpoint cannot see are NaN
  double disparity_step_px{0.0};     ///< fx * baseline / z is rounded to this step; 0 = off
  double edge_mixing_fraction{0.0};  ///< share of depth-edge pixels that become flying pixels
  double edge_threshold_m{0.05};     ///< jump between neighbours that makes a depth edge
  double dropout_probability{0.0};   ///< pixels lost at random become NaN
  double lateral_jitter_px{0.0};     ///< sigma of the ray's shift in u and in v
  // Depth registered to a colour image that sees more has margins without depth.
  int border_left_px{0};   ///< columns and rows that are NaN
  int border_right_px{0};  ///< at most half of the image, as the others
  int border_top_px{0};
  int border_bottom_px{0};
  bool has_hexagonal_view{false};  ///< of the rectangle within, the hexagon with corners left and right has depth
  double min_return_per_m2{0.0};   ///< albedo cos(incidence) / range^2 below this is NaN; 0 = off
  double return_flicker{0.1};      ///< largest relative change of that strength from frame to frame, in patches
  double edge_loss_px{0.0};        ///< widest strip on either side of a depth edge that is NaN; 0 = off

  /// The same ranges with every other effect off.
  SensorModel withoutNoise() const;
};

/// Axis-aligned region in the scene frame, metres.
struct Region {
  Eigen::Vector3d min_m{Eigen::Vector3d::Zero()};
  Eigen::Vector3d max_m{Eigen::Vector3d::Zero()};
};

/// Tilted off-grid pose of the scene in the map. With the ground at z = 0 and brick faces at multiples of 0.1 m, faces
/// would lie on the cell borders of 1 cm and 2 cm grids, where a quantised field is right by luck.
Eigen::Isometry3d defaultMapScenePose();

/// Fixed-axis roll, pitch, yaw [rad] (REP-103) and position [m] to a pose: R = Rz(yaw) Ry(pitch) Rx(roll).
Eigen::Isometry3d poseFromXyzRpy(const Eigen::Vector3d& xyz_m, const Eigen::Vector3d& rpy_rad);

/// T_scene_camera (optical axes: z forward, x right, y down) at `eye` looking at `target`, image up towards scene +z,
/// or towards scene +x when looking along z. Throws std::invalid_argument if the two points coincide.
Eigen::Isometry3d lookAt(const Eigen::Vector3d& eye_m, const Eigen::Vector3d& target_m);

/// Circle around the vertical line through the target; frame k of n is at start_angle + 2 pi turns k / n.
struct OrbitConfig {
  double radius_m{1.8};
  double height_m{1.2};  ///< of the camera over the scene's z = 0
  Eigen::Vector3d look_at_m{0.0, 0.0, 0.15};
  double turns{1.0};
  double start_angle_rad{0.0};
  int frames{40};
};

/// T_scene_camera of every frame of an orbit.
std::vector<Eigen::Isometry3d> orbitPoses(const OrbitConfig& config);

/// A world of boxes and ground, the camera that flies through it and the sensor it carries.
/// The scene frame has z up and its ground at z = 0; everything a mapper gets is in the map frame.
struct Scene {
  std::vector<Box> boxes;
  bool has_ground{true};  ///< solid half space z <= 0 of the scene frame
  Eigen::Isometry3d T_map_scene{defaultMapScenePose()};
  CameraModel camera;
  std::vector<Eigen::Isometry3d> T_scene_camera;  ///< optical frame, one per frame
  double fps{10.0};
  double start_time_s{1000.0};  ///< stamp of frame 0
  SensorModel sensor;
  std::uint64_t seed{1};  ///< of the sensor noise
  Region roi;             ///< where ground samples are made; see defaultRegion()

  int numFrames() const { return static_cast<int>(T_scene_camera.size()); }

  /// T_map_camera (optical frame) of a frame. Throws std::out_of_range.
  Eigen::Isometry3d cameraInMap(int frame) const;

  double stampSeconds(int frame) const { return start_time_s + frame / fps; }

  /// Boxes present in a frame; any frame number is allowed, also past the end of the trajectory.
  std::vector<Box> boxesAt(int frame) const;

  /// Ids of the boxes that vanish at any frame before the end, ascending, and the first such frame (kNever if none).
  std::vector<int> removedIds() const;
  int firstRemovalFrame() const;

  /// Box hull of all boxes and 0.3 m more on each side, in z from -0.05 m.
  Region defaultRegion() const;

  /// Everything wrong with the scene, one line each as "key = value unit, must be ..."; empty if it can be used.
  std::vector<std::string> validate() const;
};

}  // namespace synthetic_depth
