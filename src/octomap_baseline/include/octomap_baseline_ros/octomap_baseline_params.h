// SPDX-License-Identifier: BSD-3-Clause
#ifndef OCTOMAP_BASELINE_ROS_OCTOMAP_BASELINE_PARAMS_H
#define OCTOMAP_BASELINE_ROS_OCTOMAP_BASELINE_PARAMS_H

#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "gpis_mapping_ros/depth_input.h"
#include "octomap_baseline/octomap_config.h"

namespace octomap_baseline_ros {

/// All parameters of the node, with the only copy of the defaults. SI units.
struct OctomapBaselineParams {
  gpis_mapping_ros::DepthInputParams input;
  octomap_baseline::OctomapConfig map;

  struct Output {
    double rate_hz{2.0};             // of every topic but ~update, at most; by the wall clock
    bool every_image{false};         // besides, after each image that changed the map, before its ~update
    double projected_min_z_m{-1e4};  // voxels between these heights make the projected map
    double projected_max_z_m{1e4};
    bool filter_speckles{false};  // voxels without an occupied neighbour are left out of it
  } output;

  /// Every problem as "key = value unit, must be in [lo, hi] unit".
  std::vector<std::string> validate() const;
};

/// Reads `~` parameters: `~map/...` in the layout of config/octomap_baseline.yaml, the rest in that of
/// config/octomap_baseline_node.yaml. Throws one std::invalid_argument that lists every unknown key, wrong type and
/// impossible value.
OctomapBaselineParams loadOctomapBaselineParams(const ros::NodeHandle& private_nh);

}  // namespace octomap_baseline_ros

#endif  // OCTOMAP_BASELINE_ROS_OCTOMAP_BASELINE_PARAMS_H
