// SPDX-License-Identifier: BSD-3-Clause
#include "depth_self_filter_ros/depth_self_filter_params.h"

#include <interactive_mapping_common_ros/params.h>

namespace depth_self_filter_ros {

DepthSelfFilterParams loadDepthSelfFilterParams(const ros::NodeHandle& private_nh) {
  // Read by image_transport, whose publishers' settings are in ~image_rect/compressedDepth/...
  return interactive_mapping_ros::loadParams<DepthSelfFilterParams>(private_nh, {"image_transport", "image_rect"});
}

}  // namespace depth_self_filter_ros
