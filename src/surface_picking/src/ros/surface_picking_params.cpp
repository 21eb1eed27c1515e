// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking_ros/surface_picking_params.h"

#include <interactive_mapping_common_ros/params.h>

namespace surface_picking_ros {

SurfacePickingParams loadSurfacePickingParams(const ros::NodeHandle& private_nh) {
  return interactive_mapping_ros::loadParams<SurfacePickingParams>(private_nh, {kNextIdParam});
}

}  // namespace surface_picking_ros
