// SPDX-License-Identifier: BSD-3-Clause
#include <exception>
#include <memory>

#include <nodelet/nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include "surface_picking_ros/surface_picking_ros.h"

namespace surface_picking_ros {

class SurfacePickingNodelet : public nodelet::Nodelet {
  // The queue with several threads: its callbacks only store what they get, and need not wait for one another.
  void onInit() override {
    try {
      picking_ = std::make_unique<SurfacePickingRos>(getMTNodeHandle(), getMTPrivateNodeHandle());
    } catch (const std::exception& error) {
      NODELET_FATAL("%s", error.what());  // the loader tells only that it failed
      throw;
    }
  }

  std::unique_ptr<SurfacePickingRos> picking_;
};

}  // namespace surface_picking_ros

PLUGINLIB_EXPORT_CLASS(surface_picking_ros::SurfacePickingNodelet, nodelet::Nodelet)
