// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_ROS_GPIS_MAPPING_PARAMS_H
#define GPIS_MAPPING_ROS_GPIS_MAPPING_PARAMS_H

#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "gpis_mapping/gpis_config.h"
#include "gpis_mapping/ground_projection.h"
#include "gpis_mapping_ros/depth_input.h"

namespace gpis_mapping_ros {

enum class MeshColor { kUncertainty, kHeight };
inline constexpr interactive_mapping::Names<MeshColor> kMeshColorNames = {{"uncertainty", MeshColor::kUncertainty},
                                                                          {"height", MeshColor::kHeight}};

/// All parameters of the node. SI units.
struct GpisMappingParams {
  DepthInputParams input;
  std::vector<std::string> more_depth_topics;
  gpis_mapping::GpisConfig map;

  struct Output {
    double rate_hz{2.0};
    bool every_image{false};
    double mesh_period_s{0.0};
    double removed_display_s{10.0};
    MeshColor mesh_color{MeshColor::kHeight};
    double color_max_std_m{0.01};

    static void fields(Output& c, interactive_mapping::Fields& f) {
      f.live()("rate_hz", c.rate_hz, 0.05, 30.0, "Hz", "of every output but ~update, at most; by the wall clock");
      f("every_image", c.every_image,
        "instead of a rate: after each image, before its ~update; the next image waits for it. For "
        "simulation in lock step");
      f("mesh_period_s", c.mesh_period_s, 0.0, 3600.0, "s",
        "between two of ~mesh, ~mesh_marker and ~surface_cloud, at least, by the stamps of the images; ~get_mesh has "
        "each image at once");
      f.live()("removed_display_s", c.removed_display_s, 0.0, 3600.0, "s",
               "how long removed points are shown, ROS time");
      f.live()("mesh_color", c.mesh_color, kMeshColorNames, "of ~mesh_marker");
      f.live()("color_max_std_m", c.color_max_std_m, 1e-4, 1.0, "m", "far end of the colour scale for uncertainty");
    }
  } output;

  struct Slice {
    double height_m{0.1};
    double cell_size_m{0.04};
    double margin_m{0.3};

    static void fields(Slice& c, interactive_mapping::Fields& f) {
      f.live("slice_height_m")("height_m", c.height_m, -100.0, 100.0, "m", "z of the plane of distances, map frame");
      f("cell_size_m", c.cell_size_m, 0.005, 1.0, "m", "distance of its points");
      f("margin_m", c.margin_m, 0.0, 10.0, "m", "how far it reaches beyond the mapped surface");
    }
  } slice;

  gpis_mapping::GroundOptions ground;

  struct Octomap {
    double resolution_m{0.05};

    static void fields(Octomap& c, interactive_mapping::Fields& f) {
      f("resolution_m", c.resolution_m, 0.005, 1.0, "m", "side of the voxels of ~octomap_... and ~esdf_pointcloud");
    }
  } octomap;

  struct Attached {
    bool clear{false};
    double padding_m{0.01};
    double pushed_m{0.05};

    static void fields(Attached& c, interactive_mapping::Fields& f) {
      f("clear", c.clear, "true: clear the volume of a brick when the magnet takes it; false: images alone do it");
      f("padding_m", c.padding_m, 0.0, 0.1, "m", "padding of that volume on each side");
      f("pushed_m", c.pushed_m, 0.0, 0.2, "m", "beside, on the side of the tool: the touch may have pushed the brick");
    }
  } attached;

  struct Storage {
    std::string autosave_file;
    double autosave_period_s{60.0};
    bool restore_on_start{true};

    static void fields(Storage& c, interactive_mapping::Fields& f) {
      f("autosave_file", c.autosave_file,
        "absolute path, its folder is made if only that is missing; empty: no autosave");
      f("autosave_period_s", c.autosave_period_s, 0.1, 86400.0, "s",
        "by the wall clock; only when something has changed");
      f("restore_on_start", c.restore_on_start, "from the autosave file, when it exists");
    }
  } storage;

  /// But for those of the map, which have a file of their own.
  static void fields(GpisMappingParams& c, interactive_mapping::Fields& f) {
    f.section("input", c.input);
    f("more_depth_topics", c.more_depth_topics,
      "depth images of further cameras of the same kind, each with its camera_info beside it; their frames are those "
      "of the images");
    f.section("output", c.output);
    f.section("slice", c.slice, "the plane of distances");
    f.section("ground", c.ground, "the projection from above");
    f.section("octomap", c.octomap, "the map as voxels");
    f.section("attached", c.attached, "what the magnet takes; for comparison");
    f.section("storage", c.storage);
  }

  /// Every problem as "key = value unit, must be in [lo, hi] unit".
  std::vector<std::string> validate() const;
};

/// In their layout on the parameter server, those of the map included.
struct GpisMappingParamsWithMap : GpisMappingParams {
  static void fields(GpisMappingParamsWithMap& c, interactive_mapping::Fields& f) {
    GpisMappingParams::fields(c, f);
    f.section("map", c.map);
  }
};

/// Reads `~` parameters: `~map/...` in the layout of config/gpis_mapping.yaml, the rest in that of
/// config/gpis_mapping_node.yaml. Throws one std::invalid_argument that lists every unknown key, wrong type and
/// impossible value.
GpisMappingParams loadGpisMappingParams(const ros::NodeHandle& private_nh);

}  // namespace gpis_mapping_ros

#endif  // GPIS_MAPPING_ROS_GPIS_MAPPING_PARAMS_H
