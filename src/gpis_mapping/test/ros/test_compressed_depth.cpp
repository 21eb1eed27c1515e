// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/compressed_depth.h"

#include <gmock/gmock.h>

#include "../support/compressed_images.h"

namespace gpis_mapping_ros {
namespace {

using depth_camera_ros::toDepthImage;
using test_support::compressedDepth;
using testing::HasSubstr;

const cv::Mat kRaw = (cv::Mat_<std::uint16_t>(2, 3) << 0, 1500, 65535, 250, 1, 4000);

TEST(CompressedDepth, ReadsSixteenBits) {
  for (const char* format :
       {"16UC1; compressedDepth png", "16UC1; compressedDepth", "16UC1", "16UC1 ; png compressed"}) {
    sensor_msgs::CompressedImage message = compressedDepth(format, kRaw);
    message.header.frame_id = "eye";
    message.header.stamp = ros::Time(7.5);
    Refusal refusal;
    const auto image = decodeCompressedDepth(message, &refusal);
    ASSERT_TRUE(image) << refusal.message;
    EXPECT_EQ(image->header.frame_id, "eye");
    EXPECT_EQ(image->header.stamp, ros::Time(7.5));
    const auto depth = toDepthImage(*image, 1000.0, &refusal);
    ASSERT_TRUE(depth) << refusal.message;
    EXPECT_EQ(depth->width, 3);
    EXPECT_FLOAT_EQ(depth->at(1, 0), 1.5f);
    EXPECT_FLOAT_EQ(depth->at(2, 1), 4.0f);
    EXPECT_EQ(depth->at(0, 0), 0.0f);
  }
  Refusal refusal;
  EXPECT_EQ(decodeCompressedDepth(compressedDepth("mono16; compressedDepth png", kRaw), &refusal)->encoding, "mono16");
}

TEST(CompressedDepth, ReadsQuantisedInverseDepth) {
  // As the transport quantises 32FC1: raw = a / depth + b.
  const float a = 100.0f * 101.0f;
  const float b = 1.0f - a / 10.0f;
  cv::Mat raw(1, 4, CV_16UC1, cv::Scalar(0));
  const std::vector<float> depth_m = {0.5f, 1.0f, 2.0f};
  for (int u = 0; u < 3; ++u) {
    raw.at<std::uint16_t>(0, u) = static_cast<std::uint16_t>(a / depth_m[static_cast<std::size_t>(u)] + b);
  }
  Refusal refusal;
  const auto image = decodeCompressedDepth(compressedDepth("32FC1; compressedDepth png", raw, a, b), &refusal);
  ASSERT_TRUE(image) << refusal.message;
  const auto depth = toDepthImage(*image, 1000.0, &refusal);
  ASSERT_TRUE(depth) << refusal.message;
  // A step of raw is depth^2 / a: 0.4 mm at 2 m.
  for (int u = 0; u < 3; ++u) EXPECT_NEAR(depth->at(u, 0), depth_m[static_cast<std::size_t>(u)], 4e-4);
  EXPECT_TRUE(std::isnan(depth->at(3, 0)));
}

TEST(CompressedDepth, RefusesWhatItIsNot) {
  sensor_msgs::CompressedImage rvl = compressedDepth("16UC1; compressedDepth rvl", kRaw);
  sensor_msgs::CompressedImage colour = compressedDepth("bgr8; jpeg compressed bgr8", kRaw);
  sensor_msgs::CompressedImage nothing = compressedDepth("", kRaw);
  sensor_msgs::CompressedImage header_only = compressedDepth("16UC1; compressedDepth png", kRaw);
  header_only.data.resize(12);
  sensor_msgs::CompressedImage cut = compressedDepth("16UC1; compressedDepth png", kRaw);
  cut.data.resize(40);
  sensor_msgs::CompressedImage no_header = compressedDepth("16UC1; compressedDepth png", kRaw);
  no_header.data.erase(no_header.data.begin(), no_header.data.begin() + 12);
  const sensor_msgs::CompressedImage bytes =
      compressedDepth("16UC1; compressedDepth png", cv::Mat(2, 3, CV_8UC1, cv::Scalar(7)));
  const std::vector<std::tuple<sensor_msgs::CompressedImage, FrameStatus, std::string>> cases = {
      {rvl, FrameStatus::kWrongEncoding,
       "RVL is not read; set the publisher's parameter compressedDepth/format to png"},
      {colour, FrameStatus::kWrongEncoding, "'bgr8; jpeg compressed bgr8', must begin with 16UC1"},
      {nothing, FrameStatus::kWrongEncoding, "compressed format is ''"},
      {header_only, FrameStatus::kMalformedImage, "has 12 bytes"},
      {cut, FrameStatus::kMalformedImage, "no PNG of one channel of 16 bits"},
      {no_header, FrameStatus::kMalformedImage, "no PNG of one channel of 16 bits"},
      {bytes, FrameStatus::kMalformedImage, "no PNG of one channel of 16 bits"},
  };
  for (const auto& [message, status, says] : cases) {
    Refusal refusal;
    EXPECT_FALSE(decodeCompressedDepth(message, &refusal)) << says;
    EXPECT_EQ(refusal.status, status) << says;
    EXPECT_THAT(refusal.message, HasSubstr(says));
  }
}

}  // namespace
}  // namespace gpis_mapping_ros
