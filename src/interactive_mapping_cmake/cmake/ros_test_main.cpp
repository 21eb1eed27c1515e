// SPDX-License-Identifier: BSD-3-Clause
// main() of the tests that are nodes. rostest names the node.
#include <gmock/gmock.h>
#include <ros/ros.h>

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  ros::init(argc, argv, "ros_test");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
