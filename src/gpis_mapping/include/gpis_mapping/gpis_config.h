// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_GPIS_CONFIG_H
#define GPIS_MAPPING_GPIS_CONFIG_H

#include <string>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <depth_camera/depth_noise.h>
#include <interactive_mapping_common/config/schema.h>

#include "gpis_mapping/types.h"

namespace gpis_mapping {

using interactive_mapping::Fields;

using depth_camera::DepthNoiseModel;

/// What a pixel with depth 0 means (16-bit images have no other way to say "no value").
enum class HolePolicy {
  kAuto,           // not measured, but where a surface known there has vanished as a whole: seen past
  kWall,           // every hole is "nothing within reach"
  kNoInformation,  // every hole is "not measured"
};

inline constexpr interactive_mapping::Names<HolePolicy> kHolePolicyNames = {
    {"auto", HolePolicy::kAuto}, {"wall", HolePolicy::kWall}, {"no_information", HolePolicy::kNoInformation}};

/// All settings of the map. SI units. What a field means and allows stands in the fields() of its section.
struct GpisConfig {
  struct Sensor {
    double min_range_m{0.25};
    double max_range_m{4.0};
    double baseline_m{0.075};
    HolePolicy hole_policy{HolePolicy::kAuto};
    DepthNoiseModel noise;
    double pose_std_m{0.004};
    double pose_std_rad{0.002};
    double stamp_std_s{0.002};
    double fov_width_rad{0.0};
    double fov_height_rad{0.0};

    static void fields(Sensor& c, Fields& f) {
      f.live()("min_range_m", c.min_range_m, 0.01, 10.0, "m", "nearer measurements are no information");
      f.live()("max_range_m", c.max_range_m, 0.1, 50.0, "m",
               "farther measurements insert nothing; they still delete what they see past");
      f("baseline_m", c.baseline_m, 0.0, 1.0, "m",
        "emitter or second camera to depth camera, along image x; 0: none (time of flight)");
      f.live()("hole_policy", c.hole_policy, kHolePolicyNames,
               "depth 0 means not measured, unless a known surface has vanished as a whole; nothing in reach; never "
               "measured");
      f.shorthand(
          "noise_preset", [&c](const std::string& name) { c.noise = DepthNoiseModel::preset(name); },
          DepthNoiseModel::presetNames(), "instead of the three coefficients");
      f("noise_a_m", c.noise.a_m, 0.0, 0.1, "m", "axial noise sigma(z) = a + b z + c z^2 [m], z in metres: a");
      f("noise_b", c.noise.b, -0.1, 0.1, "m/m", "b");
      f("noise_c_per_m", c.noise.c_per_m, 0.0, 0.1, "1/m", "c");
      f.live()("pose_std_m", c.pose_std_m, 0.0, 0.1, "m", "standard deviation of the camera position that tf gives");
      f("pose_std_rad", c.pose_std_rad, 0.0, 0.1, "rad", "standard deviation of its rotation; grows with range");
      f("stamp_std_s", c.stamp_std_s, 0.0, 0.1, "s",
        "standard deviation of the image stamps against tf; grows with the camera's speed");
      f("fov_width_rad", c.fov_width_rad, 0.0, 3.0, "rad",
        "field of view of the depth camera within the image, outside of which depth is never measured; 0: the whole "
        "image");
      f("fov_height_rad", c.fov_height_rad, 0.0, 3.0, "rad", "its height. The map also learns both from the images");
      f.require(c.min_range_m < c.max_range_m, "min_range_m must be below sensor/max_range_m");
      for (const double z : {c.min_range_m, 0.5 * (c.min_range_m + c.max_range_m), c.max_range_m}) {
        if (c.noise.sigma(z) > 0.0) continue;
        f.require(false, "noise_*: standard deviation at " + std::to_string(z) + " m is " +
                             std::to_string(c.noise.sigma(z)) + " m, must be > 0 m");
        break;
      }
    }
  } sensor;

  struct FrameMap {  // 2.5D^-1 map, eqs 5 and 6
    int tile_px{4};
    int overlap_px{2};
    double kernel_length_rad{0.006};
    double prior_std_per_m{0.004};
    double wall_range_m{100.0};

    static void fields(FrameMap& c, Fields& f) {
      f("tile_px", c.tile_px, 4, 16, "px", "side of a tile with a Gaussian process of its own");
      f("overlap_px", c.overlap_px, 0, 6, "px", "border of the neighbouring tiles that a tile also sees");
      f("kernel_length_rad", c.kernel_length_rad, 1e-4, 0.1, "rad",
        "correlation length of the Ornstein-Uhlenbeck kernel across the image, as a bearing");
      f("prior_std_per_m", c.prior_std_per_m, 1e-4, 1.0, "1/m",
        "standard deviation of inverse range about the linear trend of a tile");
      f("wall_range_m", c.wall_range_m, 10.0, 1e4, "m", "range of the virtual wall where nothing is in reach");
    }
  } frame_map;

  struct Surface {  // eqs 3 and 4
    double spacing_m{0.02};
    double length_scale_m{0.05};
    double signal_std_m{0.0};
    double blend_radius_m{0.045};
    double min_noise_std_m{0.001};

    static void fields(Surface& c, Fields& f) {
      f("spacing_m", c.spacing_m, 0.003, 0.2, "m", "least distance of two training points");
      f("length_scale_m", c.length_scale_m, 0.005, 1.0, "m", "of the Matern 3/2 kernel");
      f("signal_std_m", c.signal_std_m, 0.0, 1.0, "m",
        "prior standard deviation of the field; 0: length_scale_m / sqrt(3), a unit variance of the gradient");
      f("blend_radius_m", c.blend_radius_m, 0.005, 0.5, "m", "reach of a point's tangent plane in the prior mean");
      f("min_noise_std_m", c.min_noise_std_m, 1e-4, 0.05, "m",
        "standard deviation of a point that was seen any number of times, at least");
      f.require(c.blend_radius_m >= 1.5 * c.spacing_m,
                "blend_radius_m must be at least 1.5 spacing_m, or the prior mean has gaps");
    }
  } surface;

  struct Cells {
    double size_m{0.10};
    double training_margin_m{0.03};
    double blend_margin_m{0.014};

    /// Cell k is the cube about k * size_m. The floor, usually z = 0 of the map, runs through the middle of one layer
    /// of cells, not along the border of two. The same holds for voxels, whose number per cell is odd.
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

    static void fields(Cells& c, Fields& f) {
      f("size_m", c.size_m, 0.02, 1.0, "m", "side of a cell with a Gaussian process of its own");
      f("training_margin_m", c.training_margin_m, 0.005, 1.0, "m", "points this far outside still train the cell");
      f("blend_margin_m", c.blend_margin_m, 0.001, 0.5, "m",
        "half width of the overlap in which neighbouring cells are blended");
      f.require(c.blend_margin_m < 0.5 * c.size_m, "blend_margin_m must be below half of cells/size_m");
    }
  } cells;

  struct Dynamic {  // Algorithm 1
    bool enabled{true};
    double tolerance_sigmas{3.0};  // g
    double min_tolerance_m{0.012};

    static void fields(Dynamic& c, Fields& f) {
      f.live("dynamic")("enabled", c.enabled, "false: nothing is ever deleted (Lee et al. 2019)");
      f.live()("tolerance_sigmas", c.tolerance_sigmas, 0.5, 10.0, "sigma",
               "a point is deleted when it is seen past by more than this many standard deviations");
      f.live()("min_tolerance_m", c.min_tolerance_m, 0.0, 0.2, "m",
               "least tolerance across the surface, for errors of calibration and pose");
    }
  } dynamic;

  struct Retraining {  // a cell is trained at once when a point came or went; else when enough have changed
    double moved_sigmas{0.5};
    double noise_ratio{0.8};
    double changed_share{0.25};

    static void fields(Retraining& c, Fields& f) {
      f("moved_sigmas", c.moved_sigmas, 0.0, 10.0, "sigma",
        "a point has changed when it moved by more than this many standard deviations");
      f("noise_ratio", c.noise_ratio, 0.0, 1.0, "",
        "a point has changed, too, when its standard deviation fell below this share of what it was");
      f("changed_share", c.changed_share, 0.0, 1.0, "",
        "a cell is trained again when this share of its training points has changed");
    }
  } retraining;

  struct Observed {
    double block_size_m{0.05};

    static void fields(Observed& c, Fields& f) {
      f("block_size_m", c.block_size_m, 0.01, 0.5, "m", "resolution at which free space is remembered");
    }
  } observed;

  struct Mesh {
    int voxels_per_cell{7};
    double support_spacings{1.25};

    static void fields(Mesh& c, Fields& f) {
      f("voxels_per_cell", c.voxels_per_cell, 2, 32, "",
        "edge of marching cubes: cells/size_m divided by this; odd, or a floor at z = 0 takes three times the "
        "vertices");
      f("support_spacings", c.support_spacings, 0.5, 4.0, "spacings",
        "a voxel is meshed when a point is this near to its centre, as a multiple of surface/spacing_m");
    }
  } mesh;

  struct Query {
    double unknown_reach_m{0.30};
    double max_distance_m{10.0};
    double occupied_depth_m{0.15};

    static void fields(Query& c, Fields& f) {
      f("unknown_reach_m", c.unknown_reach_m, 0.0, 5.0, "m",
        "how far in front of a surface, in unseen space, a distance is answered");
      f("max_distance_m", c.max_distance_m, 0.1, 100.0, "m", "reach of the Euclidean distance");
      f("occupied_depth_m", c.occupied_depth_m, 0.01, 5.0, "m", "how deep behind a seen surface space is occupied");
    }
  } query;

  struct Region {
    Eigen::Vector3d min_m{-1e4, -1e4, -1e4};
    Eigen::Vector3d max_m{1e4, 1e4, 1e4};

    static void fields(Region& c, Fields& f) {
      f("min_m", c.min_m, -1e9, 1e9, "m", "x, y, z in the map frame: only points inside are kept");
      f("max_m", c.max_m, -1e9, 1e9, "m", "x, y, z");
      f.require((c.min_m.array() < c.max_m.array()).all(), "min_m must be below region/max_m on each axis");
    }
  } region;

  int threads{0};

  static void fields(GpisConfig& c, Fields& f);

  double signalStd() const;  // surface.signal_std_m with its default resolved [m]

  /// How far outside a cell a point still changes its field [m]: the prior mean reaches blend_radius_m from anywhere
  /// the cell is asked at.
  double influenceMargin() const;

  /// Every problem as "key = value unit, must be in [lo, hi] unit"; empty when the configuration can be used.
  std::vector<std::string> validate() const;
};

/// Throws std::invalid_argument listing all problems of `config`.
void requireValid(const GpisConfig& config);

/// Reads YAML. Missing keys keep their default. Unknown keys, wrong types and impossible values are rejected with one
/// std::invalid_argument that lists them all (file, key, value, allowed range).
GpisConfig loadGpisConfig(const std::string& yaml_path);
GpisConfig parseGpisConfig(const std::string& yaml_text, const std::string& origin);

/// Every key with its value, in the layout loadGpisConfig reads. parseGpisConfig(toYaml(c)) == c.
std::string toYaml(const GpisConfig& config);

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_GPIS_CONFIG_H
