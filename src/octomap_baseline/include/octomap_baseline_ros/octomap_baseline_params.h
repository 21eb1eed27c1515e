// SPDX-License-Identifier: BSD-3-Clause
#ifndef OCTOMAP_BASELINE_ROS_OCTOMAP_BASELINE_PARAMS_H
#define OCTOMAP_BASELINE_ROS_OCTOMAP_BASELINE_PARAMS_H

#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "gpis_mapping_ros/depth_input.h"
#include "octomap_baseline/octomap_config.h"

namespace octomap_baseline_ros {

/// All parameters of the node. SI units.
struct OctomapBaselineParams {
  gpis_mapping_ros::DepthInputParams input;
  octomap_baseline::OctomapConfig map;

  struct Output {
    double rate_hz{2.0};
    bool every_image{false};
    double mesh_period_s{0.0};
    double projected_min_z_m{-1e4};
    double projected_max_z_m{1e4};
    bool filter_speckles{false};

    static void fields(Output& c, interactive_mapping::Fields& f) {
      f("rate_hz", c.rate_hz, 0.05, 30.0, "Hz", "of every topic but ~update, at most; by the wall clock");
      f("every_image", c.every_image, "besides, after each image that changed the map, before its ~update");
      f("mesh_period_s", c.mesh_period_s, 0.0, 3600.0, "s",
        "between two of ~mesh, at least, by the stamps of the images");
      f("projected_min_z_m", c.projected_min_z_m, -1e4, 1e4, "m", "voxels between these heights ...");
      f("projected_max_z_m", c.projected_max_z_m, -1e4, 1e4, "m", "... make the projected map");
      f("filter_speckles", c.filter_speckles, "voxels without an occupied neighbour are left out of it and of ~mesh");
      f.require(c.projected_min_z_m < c.projected_max_z_m, "projected_min_z_m must be below output/projected_max_z_m");
    }
  } output;

  /// But for those of the map, which have a file of their own.
  static void fields(OctomapBaselineParams& c, interactive_mapping::Fields& f) {
    f.section("input", c.input);
    f.section("output", c.output);
  }
};

/// Reads `~` parameters: `~map/...` in the layout of config/octomap_baseline.yaml, the rest in that of
/// config/octomap_baseline_node.yaml. Throws one std::invalid_argument that lists every unknown key, wrong type and
/// impossible value.
OctomapBaselineParams loadOctomapBaselineParams(const ros::NodeHandle& private_nh);

}  // namespace octomap_baseline_ros

#endif  // OCTOMAP_BASELINE_ROS_OCTOMAP_BASELINE_PARAMS_H
