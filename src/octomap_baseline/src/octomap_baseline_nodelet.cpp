// SPDX-License-Identifier: BSD-3-Clause
#include <exception>
#include <memory>

#include <nodelet/nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include "octomap_baseline_ros/octomap_baseline_ros.h"

namespace octomap_baseline_ros {

class OctomapBaselineNodelet : public nodelet::Nodelet {
  // The queue with several threads: a service does not wait for the publishing of the map.
  void onInit() override {
    try {
      map_ = std::make_unique<OctomapBaselineRos>(getMTNodeHandle(), getMTPrivateNodeHandle());
    } catch (const std::exception& error) {
      NODELET_FATAL("%s", error.what());  // the loader tells only that it failed
      throw;
    }
  }

  std::unique_ptr<OctomapBaselineRos> map_;
};

}  // namespace octomap_baseline_ros

PLUGINLIB_EXPORT_CLASS(octomap_baseline_ros::OctomapBaselineNodelet, nodelet::Nodelet)
