// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_GPIS_CONFIG_H
#define GPIS_MAPPING_GPIS_CONFIG_H

#include <string>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "gpis_mapping/types.h"

namespace gpis_mapping {

/// Axial noise of a depth camera: sigma_z(z) = a + b z + c z^2 [m], z in metres.
struct DepthNoiseModel {
  double a_m{0.0005};
  double b{0.0};
  double c_per_m{0.0017};

  double sigma(double z_m) const { return a_m + (b + c_per_m * z_m) * z_m; }

  /// Presets: generic, kinect_v1, kinect_v2, azure_kinect, realsense_d415, realsense_d435. Throws
  /// std::invalid_argument naming the known ones.
  static DepthNoiseModel preset(const std::string& name);
  static std::vector<std::string> presetNames();
};

/// What a pixel with depth 0 means (16-bit images have no other way to say "no value").
enum class HolePolicy {
  kAuto,           // not measured, but where a surface known there has vanished as a whole: seen past
  kWall,           // every hole is "nothing within reach"
  kNoInformation,  // every hole is "not measured"
};

/// "auto", "wall", "no_information".
const char* toString(HolePolicy policy);

/// Throws std::invalid_argument naming the known ones.
HolePolicy holePolicyFromString(const std::string& name);

/// All settings of the map, with the only copy of the defaults. SI units.
struct GpisConfig {
  struct Sensor {
    double min_range_m{0.25};  // nearer measurements are no information
    double max_range_m{4.0};   // farther measurements insert nothing; they still delete what they see past
    double baseline_m{0.075};  // emitter/second camera to depth camera, along image x; 0: none (time of flight)
    HolePolicy hole_policy{HolePolicy::kAuto};
    DepthNoiseModel noise;
    double pose_std_m{0.004};    // error of the camera position given by tf
    double pose_std_rad{0.002};  // error of its rotation: grows with range
    double stamp_std_s{0.002};   // error of the images' stamps: grows with the camera's speed
    double fov_width_rad{0.0};   // of the depth camera within the image, about its axis; 0: the whole image
    double fov_height_rad{0.0};
  } sensor;

  struct FrameMap {  // 2.5D^-1 map, eqs 5 and 6
    int tile_px{8};
    int overlap_px{2};                // each tile's GP also sees this border of its neighbours
    double kernel_length_rad{0.006};  // 1/alpha of the Ornstein-Uhlenbeck kernel, in bearing units
    double prior_std_per_m{0.004};    // standard deviation of inverse range about the tile's linear trend [1/m]
    double wall_range_m{100.0};       // the virtual wall
  } frame_map;

  struct Surface {           // eqs 3 and 4
    double spacing_m{0.02};  // least distance of two training points
    double length_scale_m{0.05};
    double signal_std_m{0.0};       // sigma_f; 0: length_scale / sqrt(3), a unit prior variance of the gradient
    double blend_radius_m{0.045};   // reach of a point's tangent plane in the prior mean
    double min_noise_std_m{0.001};  // fusing many looks never makes a point better than this
  } surface;

  struct Cells {
    double size_m{0.10};
    double training_margin_m{0.03};  // points this far outside still train the cell
    double blend_margin_m{0.014};    // half width of the overlap in which neighbouring cells are blended

    /// Cell k is the cube about k * size_m: the floor, usually z = 0 of the map, runs through the middle of one layer of
    /// cells (and of voxels, whose number per cell is odd), not along the border of two.
    LatticeKey at(const Eigen::Vector3d& p_map) const {
      return LatticeKey::of((p_map.array() + 0.5 * size_m).matrix(), size_m);
    }
    Eigen::Vector3d center(const LatticeKey& key) const { return key.corner(size_m); }
    /// The one with the least coordinates.
    Eigen::Vector3d corner(const LatticeKey& key) const { return (center(key).array() - 0.5 * size_m).matrix(); }
    Eigen::AlignedBox3d box(const LatticeKey& key) const {
      const Eigen::Vector3d low = corner(key);
      return {low, (low.array() + size_m).matrix()};
    }
  } cells;

  struct Dynamic {                  // Algorithm 1
    bool enabled{true};             // false: nothing is ever deleted (Lee et al. 2019)
    double tolerance_sigmas{3.0};   // g
    double min_tolerance_m{0.012};  // floor of the tolerance across the surface: calibration and pose errors
  } dynamic;

  struct Retraining {            // a cell is trained at once when a point came or went; else when enough have changed
    double moved_sigmas{0.5};    // a point has changed when it moved by more than this many standard deviations ...
    double noise_ratio{0.8};     // ... or its standard deviation fell below this share of what it was
    double changed_share{0.25};  // share of a cell's training points that must have changed
  } retraining;

  struct Observed {
    double block_size_m{0.05};
  } observed;

  struct Mesh {
    int voxels_per_cell{7};         // marching cubes edge = cells.size_m / this
    double support_spacings{1.25};  // a voxel is meshed when a point is this many spacings near its centre
  } mesh;

  struct Query {
    double unknown_reach_m{0.30};   // how far in front of a surface, in unseen space, a distance is answered
    double max_distance_m{10.0};    // reach of the Euclidean distance
    double occupied_depth_m{0.15};  // how deep behind a seen surface space is called occupied
  } query;

  struct Region {  // only points inside are kept, map frame
    Eigen::Vector3d min_m{-1e4, -1e4, -1e4};
    Eigen::Vector3d max_m{1e4, 1e4, 1e4};
  } region;

  int threads{0};  // 0: all cores

  double signalStd() const;  // surface.signal_std_m with its default resolved [m]

  /// How far outside a cell a point still changes its field [m]: the prior mean reaches blend_radius_m from anywhere
  /// the cell is asked at.
  double influenceMargin() const;

  /// Every problem as "key = value unit, must be in [lo, hi] unit"; empty when the configuration can be used.
  std::vector<std::string> validate() const;
};

/// Throws std::invalid_argument listing all problems of `config`.
void requireValid(const GpisConfig& config);

/// Reads YAML: missing keys keep their default; unknown keys, wrong types and impossible values are refused with one
/// std::invalid_argument that lists them all (file, key, value, allowed range).
GpisConfig loadGpisConfig(const std::string& yaml_path);
GpisConfig parseGpisConfig(const std::string& yaml_text, const std::string& origin);

/// Every key with its value, in the layout loadGpisConfig reads. parseGpisConfig(toYaml(c)) == c.
std::string toYaml(const GpisConfig& config);

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_GPIS_CONFIG_H
