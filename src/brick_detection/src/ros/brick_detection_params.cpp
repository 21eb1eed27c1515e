// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/brick_detection_params.h"

#include <interactive_mapping_common_ros/params.h>

namespace brick_detection_ros {

BrickDetectionParams loadBrickDetectionParams(const ros::NodeHandle& private_nh) {
  // Read by image_transport, whose publishers' settings are in ~image/compressed/...
  return interactive_mapping_ros::loadParams<BrickDetectionParams>(private_nh, {"image_transport", "image"});
}

}  // namespace brick_detection_ros
