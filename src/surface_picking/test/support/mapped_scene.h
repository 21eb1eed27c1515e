// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include <Eigen/Geometry>
#include <gpis_mapping/map_snapshot.h>
#include <gpis_mapping/mesh_extractor.h>
#include <synthetic_depth/scene.h>

namespace test_support {

struct Sphere {
  Eigen::Vector3d center_m{Eigen::Vector3d::Zero()};
  double radius_m{0.1};
};

/// With flat ends.
struct Cylinder {
  Eigen::Isometry3d T_scene_cylinder{Eigen::Isometry3d::Identity()};  ///< of its middle, axis along z
  double radius_m{0.1};
  double half_length_m{0.15};
};

/// What stands on the ground z = 0, and where the camera is. The map's frame is the scene's, but for the default tilt
/// that keeps faces off the map's lattice.
struct SceneOfSolids {
  std::vector<synthetic_depth::Box> boxes{};
  std::vector<Sphere> spheres{};
  std::vector<Cylinder> cylinders{};
  std::vector<Eigen::Vector3d> eyes_m{};  ///< camera positions; it looks at target_m
  Eigen::Vector3d target_m{0.0, 0.0, 0.1};
  bool has_noise{true};  ///< of a stereo camera: 0.0038 1/m in inverse depth, alike over 2 x 2 pixels
  std::uint64_t seed{1};
  Eigen::Vector3d drift_m{0.0, 0.0, 0.0};  ///< the latter half of the eyes are taken to be so far from where they are

  /// Adds a box of `size_m`.
  void addBox(const Eigen::Vector3d& size_m, const Eigen::Isometry3d& T_scene_box);
  /// Eyes on a circle of `radius_m` about the target at `height_m`, from `first_rad` over `span_rad`.
  void lookAround(int count, double radius_m = 1.3, double height_m = 1.1, double first_rad = 0.0,
                  double span_rad = 6.283185307179586);
};

struct MappedScene {
  gpis_mapping::TriangleMesh mesh;
  std::shared_ptr<const gpis_mapping::MapSnapshot> snapshot;
  Eigen::Isometry3d T_map_scene{Eigen::Isometry3d::Identity()};
};

/// As gpis_mapping maps it from one image of each eye, three times around. Throws std::invalid_argument without an eye.
MappedScene mapScene(const SceneOfSolids& solids);

/// Pose in the scene: position and fixed-axis roll, pitch, yaw.
Eigen::Isometry3d pose(double x, double y, double z, double yaw_rad = 0.0, double pitch_rad = 0.0,
                       double roll_rad = 0.0);

}  // namespace test_support
