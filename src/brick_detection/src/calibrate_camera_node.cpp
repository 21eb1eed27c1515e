// SPDX-License-Identifier: BSD-3-Clause
#include <exception>

#include <interactive_mapping_common_ros/spinner.h>
#include <ros/ros.h>

#include "brick_detection_ros/camera_calibrator.h"

int main(int argc, char** argv) {
  ros::init(argc, argv, "calibrate_camera");
  // Outside the block that may throw: with the last handle goes ROS's log, and with that the reason.
  const ros::NodeHandle nh;
  const ros::NodeHandle private_nh("~");
  try {
    brick_detection_ros::CameraCalibrator calibrator(nh, private_nh,
                                                     brick_detection_ros::loadCameraCalibratorParams(private_nh));
    // Images, a service that works, one that asks meanwhile.
    const interactive_mapping_ros::Spinner spinner(3, ros::getGlobalCallbackQueue());
    ros::waitForShutdown();
    return 0;
  } catch (const std::exception& error) {
    ROS_FATAL("%s", error.what());
    return 1;
  }
}
