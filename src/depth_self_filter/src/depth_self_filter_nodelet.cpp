// SPDX-License-Identifier: BSD-3-Clause
#include <exception>
#include <memory>

#include <nodelet/nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include "depth_self_filter_ros/depth_self_filter_ros.h"

namespace depth_self_filter_ros {

class DepthSelfFilterNodelet : public nodelet::Nodelet {
  // The queue with several threads: its callbacks only store what they get, and need not wait for one another.
  void onInit() override {
    try {
      filter_ = std::make_unique<DepthSelfFilterRos>(getMTNodeHandle(), getMTPrivateNodeHandle());
    } catch (const std::exception& error) {
      NODELET_FATAL("%s", error.what());  // the loader tells only that it failed
      throw;
    }
  }

  std::unique_ptr<DepthSelfFilterRos> filter_;
};

}  // namespace depth_self_filter_ros

PLUGINLIB_EXPORT_CLASS(depth_self_filter_ros::DepthSelfFilterNodelet, nodelet::Nodelet)
