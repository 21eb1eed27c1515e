// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline_ros/octomap_baseline_params.h"

#include <interactive_mapping_common_ros/params.h>

namespace octomap_baseline_ros {

OctomapBaselineParams loadOctomapBaselineParams(const ros::NodeHandle& private_nh) {
  OctomapBaselineParams params;
  interactive_mapping_ros::ParamsReader reader(private_nh);
  OctomapBaselineParams::fields(params, reader.fields());
  reader.fields().section("map", params.map);
  reader.fields().ignore("image_transport");  // read by image_transport
  interactive_mapping::FieldChecker checker;
  OctomapBaselineParams::fields(params, checker);
  checker.section("map", params.map);
  reader.finish(checker.problems);
  return params;
}

}  // namespace octomap_baseline_ros
