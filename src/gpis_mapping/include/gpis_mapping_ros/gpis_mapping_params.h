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

/// All parameters of the node, with the only copy of the defaults. SI units.
struct GpisMappingParams {
  DepthInputParams input;
  gpis_mapping::GpisConfig map;

  struct Output {
    double rate_hz{2.0};             // of mesh, points, ground and slice, at most; by the wall clock
    bool every_image{false};         // instead: after each image, and the next one waits for it
    double removed_display_s{10.0};  // how long removed points are shown, ROS time
    MeshColor mesh_color{MeshColor::kHeight};
    double color_max_std_m{0.01};  // the far end of the colour scale for uncertainty
  } output;

  struct Slice {
    double height_m{0.1};  // z of the plane of distances, map frame
    double cell_size_m{0.04};
    double margin_m{0.3};  // round the mapped surface
  } slice;

  gpis_mapping::GroundOptions ground;

  struct Attached {
    double padding_m{0.01};  // on each side of a taken brick's place, which is cleared
    double pushed_m{0.05};   // ... and so much more on the tool's side: it may have been pushed by the touch
  } attached;

  struct Storage {
    std::string autosave_file;       // absolute; empty: no autosave
    double autosave_period_s{60.0};  // by the wall clock; only when the map has changed
    bool restore_on_start{true};     // from autosave_file, when it exists
  } storage;

  /// Every problem as "key = value unit, must be in [lo, hi] unit".
  std::vector<std::string> validate() const;
};

/// "uncertainty", "height".
const char* toString(MeshColor color);

/// The node's own parameters in the layout of config/gpis_mapping_node.yaml; those of the map are not in it.
std::string toYaml(const GpisMappingParams& params);

/// Reads `~` parameters: `~map/...` in the layout of config/gpis_mapping.yaml, the rest in that of
/// config/gpis_mapping_node.yaml. Throws one std::invalid_argument that lists every unknown key, wrong type and
/// impossible value.
GpisMappingParams loadGpisMappingParams(const ros::NodeHandle& private_nh);

/// The path when it can be used for a map: absolute, in a folder that exists; else throws std::invalid_argument.
void requireUsablePath(const std::string& path);

}  // namespace gpis_mapping_ros

#endif  // GPIS_MAPPING_ROS_GPIS_MAPPING_PARAMS_H
