// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline_ros/octomap_baseline_params.h"

#include <interactive_mapping_common_ros/params.h>

namespace octomap_baseline_ros {

OctomapBaselineParams loadOctomapBaselineParams(const ros::NodeHandle& private_nh) {
  return interactive_mapping_ros::loadParams<OctomapBaselineParams>(private_nh, {"image_transport"});
}

}  // namespace octomap_baseline_ros
