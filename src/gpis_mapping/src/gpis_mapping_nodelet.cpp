// SPDX-License-Identifier: BSD-3-Clause
#include <exception>
#include <memory>

#include <nodelet/nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include "gpis_mapping_ros/gpis_mapping_ros.h"

namespace gpis_mapping_ros {

class GpisMappingNodelet : public nodelet::Nodelet {
  // The queue with several threads: a query waits for no save.
  void onInit() override {
    try {
      map_ = std::make_unique<GpisMappingRos>(getMTNodeHandle(), getMTPrivateNodeHandle());
    } catch (const std::exception& error) {
      NODELET_FATAL("%s", error.what());  // the loader tells only that it failed
      throw;
    }
  }

  std::unique_ptr<GpisMappingRos> map_;
};

}  // namespace gpis_mapping_ros

PLUGINLIB_EXPORT_CLASS(gpis_mapping_ros::GpisMappingNodelet, nodelet::Nodelet)
