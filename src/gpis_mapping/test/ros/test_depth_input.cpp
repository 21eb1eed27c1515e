// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/depth_input.h"

#include <gmock/gmock.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include <interactive_mapping_common_ros/testing/waiting.h>
#include "../support/compressed_images.h"

namespace gpis_mapping_ros {
namespace {

using node_tests::waitUntil;
using testing::HasSubstr;

TEST(DepthInput, ReadsCompressedDepthWithoutThePlugin) {
  ros::NodeHandle nh("compressed");
  tf2_ros::StaticTransformBroadcaster tf;
  geometry_msgs::TransformStamped transform;
  transform.header.stamp = ros::Time::now();
  transform.header.frame_id = "map";
  transform.child_frame_id = "eye";
  transform.transform.rotation.w = 1.0;
  tf.sendTransform(transform);

  DepthInputParams params;
  params.image_transport = "compressedDepth";
  params.tf_timeout_s = 5.0;
  std::mutex mutex;
  std::vector<DepthInputFrame> frames;
  std::vector<Refusal> refusals;
  DepthInput input(
      nh, nh, params,
      [&](const DepthInputFrame& frame) {
        const std::lock_guard<std::mutex> lock(mutex);
        frames.push_back(frame);
        return Refusal{};
      },
      [&](const ros::Time&, const Refusal& refusal) {
        const std::lock_guard<std::mutex> lock(mutex);
        refusals.push_back(refusal);
      });
  EXPECT_EQ(input.imageTopic(), "/compressed/depth/image_rect/compressedDepth");

  ros::Publisher images = nh.advertise<sensor_msgs::CompressedImage>("depth/image_rect/compressedDepth", 1);
  ros::Publisher infos = nh.advertise<sensor_msgs::CameraInfo>("depth/camera_info", 1, true);
  sensor_msgs::CameraInfo info;
  info.header.frame_id = "eye";
  info.width = 32;
  info.height = 24;
  info.K = {{30, 0, 15.5, 0, 31, 11.5, 0, 0, 1}};
  infos.publish(info);
  ASSERT_TRUE(waitUntil([&] { return images.getNumSubscribers() > 0 && infos.getNumSubscribers() > 0; }));

  const auto publish = [&](const std::string& format) {
    sensor_msgs::CompressedImage image =
        test_support::compressedDepth(format, cv::Mat(24, 32, CV_16UC1, cv::Scalar(1500)));
    image.header.stamp = ros::Time::now();
    image.header.frame_id = "eye";
    images.publish(image);
  };
  const auto numOf = [&](const auto& list) {
    const std::lock_guard<std::mutex> lock(mutex);
    return list.size();
  };
  publish("16UC1; compressedDepth png");
  ASSERT_TRUE(waitUntil([&] { return numOf(frames) == 1; })) << input.counters().last_refusal;
  EXPECT_FLOAT_EQ(frames[0].image.at(3, 3), 1.5f);
  EXPECT_EQ(frames[0].camera.fx, 30.0) << "the first matrix of the base topic's info";
  publish("16UC1; compressedDepth rvl");
  ASSERT_TRUE(waitUntil([&] { return numOf(refusals) == 1; }));
  EXPECT_EQ(refusals[0].status, FrameStatus::kWrongEncoding);
  EXPECT_THAT(refusals[0].message, HasSubstr("RVL"));
}

}  // namespace
}  // namespace gpis_mapping_ros
