// SPDX-License-Identifier: BSD-3-Clause
#include <exception>
#include <memory>

#include <nodelet/nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include "brick_detection_ros/brick_detection_ros.h"

namespace brick_detection_ros {

class BrickDetectionNodelet : public nodelet::Nodelet {
  // The queue with several threads: its callbacks only store what they get, and need not wait for one another.
  void onInit() override {
    try {
      detection_ = std::make_unique<BrickDetectionRos>(getMTNodeHandle(), getMTPrivateNodeHandle());
    } catch (const std::exception& error) {
      NODELET_FATAL("%s", error.what());  // the loader tells only that it failed
      throw;
    }
  }

  std::unique_ptr<BrickDetectionRos> detection_;
};

}  // namespace brick_detection_ros

PLUGINLIB_EXPORT_CLASS(brick_detection_ros::BrickDetectionNodelet, nodelet::Nodelet)
