// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/bag_sequence.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>

#include <geometry_msgs/TransformStamped.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <tf2_msgs/TFMessage.h>

#include <depth_camera_ros/conversions.h>
#include <interactive_mapping_common/testing/temporary_folder.h>
#include "../support/compressed_images.h"

namespace gpis_mapping_ros {
namespace {

using depth_camera_ros::Refusal;
using depth_camera_ros::toDepthImage;
using gpis_mapping::CameraModel;
using gpis_mapping::DepthSequenceError;
using gpis_mapping::SkipReason;
using test_support::messageOf;
using test_support::readText;
using test_support::TemporaryFolder;
using test_support::writeText;
using testing::AllOf;
using testing::HasSubstr;

constexpr std::uint32_t kWidth = 20;
constexpr std::uint32_t kHeight = 16;
constexpr std::uint32_t kPadding = 6;  // bytes after each row

ros::Time at(double seconds) {
  return ros::Time(100.0 + seconds);
}

/// Pixel (u, v) holds depthAt(u, v) [mm]; rows are padded.
std::uint16_t depthAt(std::uint32_t u, std::uint32_t v) {
  return static_cast<std::uint16_t>(1000 + 10 * v + u);
}

template <typename T>
sensor_msgs::Image makeImage(double seconds, const std::string& encoding, T scale, bool is_big_endian) {
  sensor_msgs::Image image;
  image.header.stamp = at(seconds);
  image.header.frame_id = "camera_depth_optical_frame";
  image.width = kWidth;
  image.height = kHeight;
  image.encoding = encoding;
  image.is_bigendian = is_big_endian;
  image.step = kWidth * sizeof(T) + kPadding;
  image.data.assign(image.step * kHeight, 0xAB);
  for (std::uint32_t v = 0; v < kHeight; ++v) {
    for (std::uint32_t u = 0; u < kWidth; ++u) {
      const T value = static_cast<T>(depthAt(u, v) * scale);
      unsigned char bytes[sizeof(T)];
      std::memcpy(bytes, &value, sizeof(T));
      if (is_big_endian) std::reverse(bytes, bytes + sizeof(T));  // the tests' machine is little-endian
      std::memcpy(&image.data[v * image.step + u * sizeof(T)], bytes, sizeof(T));
    }
  }
  return image;
}

sensor_msgs::Image image16(double seconds, bool is_big_endian = false) {
  return makeImage<std::uint16_t>(seconds, "16UC1", 1, is_big_endian);
}
sensor_msgs::Image image32(double seconds, bool is_big_endian = false) {
  return makeImage<float>(seconds, "32FC1", 0.001f, is_big_endian);
}

geometry_msgs::TransformStamped transform(double seconds, const std::string& parent, const std::string& child, double x,
                                          double yaw = 0.0) {
  geometry_msgs::TransformStamped message;
  message.header.stamp = at(seconds);
  message.header.frame_id = parent;
  message.child_frame_id = child;
  message.transform.translation.x = x;
  message.transform.rotation.z = std::sin(yaw / 2.0);
  message.transform.rotation.w = std::cos(yaw / 2.0);
  return message;
}

class Bag : public testing::Test {
 protected:
  Bag() : path_(folder_.file("a.bag")) { bag_.open(path_, rosbag::bagmode::Write); }

  template <typename T>
  void write(const std::string& topic, double seconds, const T& message) {
    bag_.write(topic, at(seconds), message);
  }
  void writeTf(const std::string& topic, const geometry_msgs::TransformStamped& message) {
    tf2_msgs::TFMessage transforms;
    transforms.transforms.push_back(message);
    bag_.write(topic, message.header.stamp, transforms);
  }
  static sensor_msgs::CameraInfo cameraInfo() {
    sensor_msgs::CameraInfo info;
    info.header.stamp = at(0.0);
    info.width = kWidth;
    info.height = kHeight;
    info.K = {{30, 0, 9.5, 0, 31, 7.5, 0, 0, 1}};
    info.P = {{28, 0, 9, 0, 0, 29, 7, 0, 0, 0, 1, 0}};
    info.D.assign(5, 0.0);
    return info;
  }
  void writeCameraInfo(const std::string& topic = "/camera/depth/camera_info") { write(topic, 0.0, cameraInfo()); }
  /// map -> odom (moving and turning) -> base_link (static) -> camera (static, named with a leading slash).
  void writeTransforms() {
    writeTf("/tf_static", transform(0.0, "odom", "base_link", 0.5));
    writeTf("/tf_static", transform(0.0, "base_link", "/camera_depth_optical_frame", 0.25));
    writeTf("/tf", transform(0.0, "map", "odom", 1.0));
    writeTf("/tf", transform(1.0, "map", "odom", 2.0, M_PI / 2.0));
  }
  std::unique_ptr<gpis_mapping::DepthSequence> open(const BagOptions& options = {}) {
    bag_.close();
    return openBagSequence(path_, options);
  }
  std::string refusal(const BagOptions& options = {}) {
    return messageOf<DepthSequenceError>([&] { open(options); });
  }

  TemporaryFolder folder_;
  std::string path_;
  rosbag::Bag bag_;
};

const char kDepthTopic[] = "/camera/depth/image_raw";

TEST_F(Bag, ReadsBothEncodingsInBothByteOrders) {
  bag_.setCompression(rosbag::compression::BZ2);
  writeCameraInfo();
  writeTransforms();
  write(kDepthTopic, 0.1, image16(0.1));
  write(kDepthTopic, 0.2, image32(0.2));
  write(kDepthTopic, 0.3, image16(0.3, true));
  write(kDepthTopic, 0.4, image32(0.4, true));
  const auto sequence = open();
  ASSERT_EQ(sequence->size(), 4u);
  EXPECT_EQ(sequence->camera(), (CameraModel{kWidth, kHeight, 30, 31, 9.5, 7.5}));
  SkipReason reason;
  for (const std::size_t i : {3u, 0u, 2u, 1u}) {  // in any order
    const auto frame = sequence->frame(i, &reason);
    ASSERT_TRUE(frame) << i;
    EXPECT_NEAR(frame->stamp_s, 100.1 + 0.1 * static_cast<double>(i), 1e-6);
    for (std::uint32_t v = 0; v < kHeight; ++v) {
      for (std::uint32_t u = 0; u < kWidth; ++u) {
        ASSERT_FLOAT_EQ(frame->image.at(static_cast<int>(u), static_cast<int>(v)), 0.001f * depthAt(u, v)) << i;
      }
    }
  }
}

TEST_F(Bag, ChainsTransformsAtTheImageStamp) {
  writeCameraInfo();
  writeTransforms();
  write(kDepthTopic, 0.9, image16(0.5));  // arrives late; its stamp counts
  SkipReason reason;
  const auto frame = open()->frame(0, &reason);
  ASSERT_TRUE(frame);
  // Half way: odom at x = 1.5, turned by 45 deg; the camera is 0.75 m ahead along the turned axis.
  const double reach = 0.75 * std::sqrt(0.5);
  EXPECT_NEAR((frame->T_map_camera.translation() - Eigen::Vector3d(1.5 + reach, reach, 0)).norm(), 0.0, 1e-9);
  EXPECT_NEAR(Eigen::AngleAxisd(frame->T_map_camera.linear()).angle(), M_PI / 4.0, 1e-9);
}

TEST_F(Bag, SkipsImagesWithoutTransform) {
  writeCameraInfo();
  writeTransforms();
  write(kDepthTopic, 0.5, image16(0.5));
  write(kDepthTopic, 1.5, image16(1.5));  // after the last transform
  sensor_msgs::Image stranger = image16(0.7);
  stranger.header.frame_id = "another_camera";
  write(kDepthTopic, 1.6, stranger);
  const auto sequence = open();
  ASSERT_EQ(sequence->size(), 3u);
  SkipReason reason;
  EXPECT_TRUE(sequence->frame(0, &reason));
  EXPECT_FALSE(sequence->frame(1, &reason));
  EXPECT_THAT(reason.kind, AllOf(HasSubstr("'camera_depth_optical_frame'"), HasSubstr("'map'")));
  EXPECT_THAT(reason.detail, HasSubstr("extrapolation"));
  EXPECT_FALSE(sequence->frame(2, &reason));
  EXPECT_THAT(reason.kind, HasSubstr("another_camera"));
}

TEST_F(Bag, RefusesOtherEncodingsAndNamesTheAllowedOnes) {
  writeCameraInfo();
  writeTransforms();
  sensor_msgs::Image colour = image16(0.1);
  colour.encoding = "rgb8";
  write(kDepthTopic, 0.1, colour);
  write("/camera/depth/image/compressedDepth", 0.1, sensor_msgs::CompressedImage());
  const std::string message = refusal();
  EXPECT_THAT(message, HasSubstr("/camera/depth/image/compressedDepth (compressed, not read: '')"));
  EXPECT_THAT(message, AllOf(HasSubstr("16UC1"), HasSubstr("32FC1"), HasSubstr("/camera/depth/image_raw (rgb8)")));
  BagOptions options;
  options.depth_topic = kDepthTopic;
  const auto sequence = openBagSequence(path_, options);
  SkipReason reason;
  EXPECT_THAT(messageOf<DepthSequenceError>([&] { sequence->frame(0, &reason); }),
              AllOf(HasSubstr("encoding is 'rgb8'"), HasSubstr("16UC1 or mono16 (mm), 32FC1 (m)")));
}

TEST_F(Bag, AsksWhenSeveralTopicsWouldDo) {
  writeCameraInfo();
  writeCameraInfo("/other/camera_info");
  writeTransforms();
  write(kDepthTopic, 0.1, image16(0.1));
  write("/other/image", 0.1, image32(0.1));
  write("/other/image", 0.2, image32(0.2));
  EXPECT_THAT(refusal(), AllOf(HasSubstr("choose one"), HasSubstr(kDepthTopic), HasSubstr("/other/image")));
  BagOptions options;
  options.depth_topic = "/other/image";
  EXPECT_EQ(openBagSequence(path_, options)->size(), 2u);
  options.depth_topic = "/none";
  EXPECT_THAT(messageOf<DepthSequenceError>([&] { openBagSequence(path_, options); }),
              AllOf(HasSubstr("no image topic /none"), HasSubstr("/other/image (32FC1)")));
  options = BagOptions{};
  options.depth_topic = kDepthTopic;
  options.info_topic = "/none";
  EXPECT_THAT(messageOf<DepthSequenceError>([&] { openBagSequence(path_, options); }),
              AllOf(HasSubstr("no camera info topic /none"), HasSubstr("/other/camera_info")));
}

TEST_F(Bag, LooksUpPosesAtTheStampPlusTheTimeOffset) {
  writeCameraInfo();
  writeTransforms();
  write(kDepthTopic, 0.5, image16(0.5));
  const auto sequence = open();
  SkipReason reason;
  const auto x = [](const Eigen::Isometry3d& T) { return T.translation().x(); };
  const double before = x(sequence->pose(0, -0.25, &reason)->T_map_camera);
  EXPECT_NE(before, x(sequence->frame(0, &reason)->T_map_camera));
  sequence->setTimeOffset(-0.25);
  const auto frame = sequence->frame(0, &reason);
  ASSERT_TRUE(frame);
  EXPECT_EQ(x(frame->T_map_camera), before);
  EXPECT_NEAR(before, 1.25 + 0.75 * std::cos(M_PI / 8.0), 1e-9);
  EXPECT_NEAR(frame->stamp_s, 100.5, 1e-9) << "the image's own";
  sequence->setTimeOffset(0.6);
  EXPECT_FALSE(sequence->frame(0, &reason));
  EXPECT_FALSE(sequence->pose(0, -0.6, &reason));
}

TEST_F(Bag, ListsFramesWhenTheMapFrameIsMissing) {
  writeCameraInfo();
  writeTransforms();
  write(kDepthTopic, 0.1, image16(0.1));
  BagOptions options;
  options.map_frame = "world";
  EXPECT_THAT(refusal(options),
              AllOf(HasSubstr("no frame 'world'"), HasSubstr("base_link, camera_depth_optical_frame, map, odom")));
  options.map_frame = "odom";
  SkipReason reason;
  const auto frame = openBagSequence(path_, options)->frame(0, &reason);
  ASSERT_TRUE(frame);
  EXPECT_NEAR(frame->T_map_camera.translation().x(), 0.75, 1e-12);
}

TEST_F(Bag, RefusesABagWithoutCameraInfoOrTransforms) {
  writeTransforms();
  write(kDepthTopic, 0.1, image16(0.1));
  EXPECT_THAT(refusal(), HasSubstr("no camera info topic /camera/depth/camera_info"));
  bag_.open(path_, rosbag::bagmode::Write);
  writeCameraInfo();
  write(kDepthTopic, 0.1, image16(0.1));
  EXPECT_THAT(refusal(), HasSubstr("no usable transform"));
}

TEST_F(Bag, RefusesImagesThatContradictThemselves) {
  writeCameraInfo();
  writeTransforms();
  sensor_msgs::Image shorter = image16(0.1);
  shorter.data.resize(shorter.data.size() / 2);
  write(kDepthTopic, 0.1, shorter);
  sensor_msgs::Image narrow = image16(0.2);
  narrow.step = 4;
  write(kDepthTopic, 0.2, narrow);
  sensor_msgs::Image small = image16(0.3);
  small.height = kHeight - 1;
  write(kDepthTopic, 0.3, small);
  const auto sequence = open();
  SkipReason reason;
  for (const std::size_t i : {0u, 1u}) {
    EXPECT_THAT(messageOf<DepthSequenceError>([&] { sequence->frame(i, &reason); }), HasSubstr("bytes are too few"));
  }
  EXPECT_THAT(messageOf<DepthSequenceError>([&] { sequence->frame(2, &reason); }), HasSubstr("is 20 x 15 px"));
}

TEST_F(Bag, SkipsImagesWithoutStamp) {
  writeCameraInfo();
  writeTransforms();
  sensor_msgs::Image image = image16(0.1);
  image.header.stamp = ros::Time(0);
  write(kDepthTopic, 0.1, image);
  const auto sequence = open();
  EXPECT_TRUE(sequence->hasClock());
  SkipReason reason;
  EXPECT_FALSE(sequence->frame(0, &reason));
  EXPECT_EQ(reason.kind, "no stamp");
  EXPECT_FALSE(sequence->pose(0, 0.5, &reason)) << "0 plus an offset is no stamp either";
}

TEST_F(Bag, UnitsCanBeGiven) {
  writeCameraInfo();
  writeTransforms();
  write(kDepthTopic, 0.1, image16(0.1));
  write(kDepthTopic, 0.2, image32(0.2));
  BagOptions options;
  options.units_per_metre = 4000.0;
  const auto sequence = open(options);
  SkipReason reason;
  EXPECT_FLOAT_EQ(sequence->frame(0, &reason)->image.at(0, 0), 0.25f);
  EXPECT_FLOAT_EQ(sequence->frame(1, &reason)->image.at(0, 0), 1.0f) << "metres are metres";
}

TEST_F(Bag, Mono16IsDepthWhereThereIsNoOther) {
  writeCameraInfo();
  writeTransforms();
  sensor_msgs::Image image = image16(0.1);
  image.encoding = "mono16";
  write("/camera/ir/image_raw", 0.1, image);
  writeCameraInfo("/camera/ir/camera_info");
  SkipReason reason;
  const auto frame = open()->frame(0, &reason);
  ASSERT_TRUE(frame);
  EXPECT_FLOAT_EQ(frame->image.at(0, 0), 1.0f);
  bag_.open(path_, rosbag::bagmode::Append);
  write(kDepthTopic, 0.2, image16(0.2));
  EXPECT_THAT(open()->frame(0, &reason)->name, HasSubstr(kDepthTopic));
}

TEST_F(Bag, ReadsCompressedDepth) {
  writeCameraInfo();
  writeTransforms();
  sensor_msgs::CompressedImage message =
      test_support::compressedDepth("16UC1; compressedDepth", cv::Mat(kHeight, kWidth, CV_16UC1, cv::Scalar(1250)));
  message.header = image16(0.1).header;
  const std::string topic = "/camera/depth/image_rect/compressedDepth";
  write(topic, 0.1, message);
  SkipReason reason;
  for (const std::string& wanted : {std::string(), topic, std::string("/camera/depth/image_rect")}) {
    BagOptions options;
    options.depth_topic = wanted;
    const auto sequence = open(options);
    EXPECT_EQ(sequence->camera().fx, 28.0) << "rectified: P";
    const auto frame = sequence->frame(0, &reason);
    ASSERT_TRUE(frame) << reason.detail;
    EXPECT_FLOAT_EQ(frame->image.at(3, 3), 1.25f);
    EXPECT_EQ(sequence->pose(0, 0.0, &reason)->stamp_s, frame->stamp_s);
  }
  bag_.open(path_, rosbag::bagmode::Append);
  write("/camera/depth/image_rect", 0.2, image16(0.2));
  EXPECT_FLOAT_EQ(open()->frame(0, &reason)->image.at(0, 0), 1.0f) << "the raw ones of both";
}

TEST_F(Bag, CameraInfoMayJitter) {
  writeTransforms();
  write(kDepthTopic, 0.1, image16(0.1));
  sensor_msgs::CameraInfo info;
  info.width = kWidth;
  info.height = kHeight;
  info.K = {{30, 0, 9.5, 0, 31, 7.5, 0, 0, 1}};
  write("/camera/depth/camera_info", 0.1, info);
  info.K[0] += 9e-4;
  write("/camera/depth/camera_info", 0.2, info);
  EXPECT_EQ(open()->camera().fx, 30.0);
  bag_.open(path_, rosbag::bagmode::Append);
  info.K[0] += 9e-4;
  write("/camera/depth/camera_info", 0.3, info);
  EXPECT_THAT(refusal(), HasSubstr("changes during the recording"));
}

TEST_F(Bag, RefusesACameraInfoWhoseDistortionOrCutChanges) {
  bag_.close();
  for (const auto& change : std::vector<std::function<void(sensor_msgs::CameraInfo*)>>{
           [](auto* info) { info->D[0] = 1e-4; }, [](auto* info) { info->roi.width = kWidth; },
           [](auto* info) { info->binning_x = 2; }, [](auto* info) { info->binning_y = 2; }}) {
    bag_.open(path_, rosbag::bagmode::Write);
    writeTransforms();
    write(kDepthTopic, 0.1, image16(0.1));
    sensor_msgs::CameraInfo info = cameraInfo();
    write("/camera/depth/camera_info", 0.1, info);
    change(&info);
    write("/camera/depth/camera_info", 0.2, info);
    EXPECT_THAT(refusal(), HasSubstr("changes during the recording"));
  }
}

TEST_F(Bag, CountsTransformsThatAreNoRotation) {
  writeCameraInfo();
  geometry_msgs::TransformStamped scaled = transform(0.0, "map", "camera_depth_optical_frame", 1.0);
  scaled.transform.rotation.w = 1.03;
  writeTf("/tf", scaled);
  scaled.header.stamp = at(1.0);
  writeTf("/tf", scaled);
  write(kDepthTopic, 0.1, image16(0.1));
  const std::string expected =
      "2 transforms were left out, the first from 'map' to 'camera_depth_optical_frame': transform is not finite or no "
      "rotation: |q| = 1.03";
  testing::internal::CaptureStderr();
  EXPECT_THAT(refusal(), AllOf(HasSubstr("no usable transform"), HasSubstr(expected)));
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  bag_.open(path_, rosbag::bagmode::Append);
  scaled.transform.rotation.w = 1.009;  // rounding, which tf2 does not take
  writeTf("/tf_static", scaled);
  SkipReason reason;
  const auto sequence = open();
  EXPECT_THAT(sequence->notes(), testing::ElementsAre(HasSubstr(expected)));
  EXPECT_TRUE(sequence->frame(0, &reason)) << reason.detail;
}

TEST_F(Bag, RectifiedImagesTakeTheProjectionMatrix) {
  writeCameraInfo();
  writeTransforms();
  write("/camera/depth/image_rect", 0.1, image16(0.1));
  EXPECT_EQ(open()->camera(), (CameraModel{kWidth, kHeight, 28, 29, 9, 7}));
}

TEST_F(Bag, RectifiesDistortedImages) {
  sensor_msgs::CameraInfo info = cameraInfo();
  info.distortion_model = "plumb_bob";
  info.D = {-0.2, 0.01, 0.0, 0.0, 0.0};
  write("/camera/depth/camera_info", 0.0, info);
  writeTransforms();
  write(kDepthTopic, 0.1, image16(0.1));
  const auto sequence = open();
  const depth_camera::DepthRectifier rectifier({kWidth, kHeight, 30, 31, 9.5, 7.5}, {"plumb_bob", info.D});
  EXPECT_EQ(sequence->camera(), rectifier.camera());
  SkipReason reason;
  const auto frame = sequence->frame(0, &reason);
  ASSERT_TRUE(frame);
  Refusal refusal;
  const auto expected = rectifier.rectify(*toDepthImage(image16(0.1), 1000.0, &refusal));
  EXPECT_THAT(frame->image.depth_m, testing::Pointwise(testing::NanSensitiveFloatEq(), expected.depth_m));
  EXPECT_THAT(sequence->notes(), testing::IsEmpty());
}

TEST_F(Bag, TakesRoiAndBinningOfTheCameraInfo) {
  sensor_msgs::CameraInfo info = cameraInfo();
  info.width = 100;
  info.roi.x_offset = 10;
  info.roi.y_offset = 20;
  info.roi.width = 2 * kWidth;
  info.roi.height = 3 * kHeight;
  info.binning_x = 2;
  info.binning_y = 3;
  info.height = 20 + 3 * kHeight;
  write("/camera/depth/camera_info", 0.0, info);
  writeTransforms();
  write(kDepthTopic, 0.1, image16(0.1));
  const auto sequence = open();
  EXPECT_EQ(sequence->camera(), (CameraModel{kWidth, kHeight, 15, 31.0 / 3.0, -0.5, -12.0 / 3.0 - 0.5}));
  SkipReason reason;
  EXPECT_TRUE(sequence->frame(0, &reason));
}

TEST_F(Bag, RefusesARoiBeyondTheFullImage) {
  sensor_msgs::CameraInfo info = cameraInfo();
  info.roi.x_offset = 3;
  info.roi.width = kWidth;
  info.roi.height = kHeight;
  write("/camera/depth/camera_info", 0.0, info);
  writeTransforms();
  write(kDepthTopic, 0.1, image16(0.1));
  EXPECT_THAT(refusal(), HasSubstr("ROI is 20 x 16 px at (3, 0), must be within the full image of 20 x 16 px"));
}

TEST_F(Bag, RefusesBrokenFiles) {
  writeCameraInfo();
  writeTransforms();
  for (int i = 0; i < 5; ++i) write(kDepthTopic, 0.1 * i, image16(0.1 * i));
  bag_.close();
  EXPECT_TRUE(looksLikeBag(path_));
  const std::string whole = readText(path_);
  for (const std::size_t length : {std::size_t{0}, std::size_t{10}, std::size_t{4096}, whole.size() / 2}) {
    writeText(path_, whole.substr(0, length));
    EXPECT_THAT(messageOf<DepthSequenceError>([&] { openBagSequence(path_); }), HasSubstr(path_)) << length;
  }
  writeText(path_, whole.substr(0, whole.size() / 2));
  EXPECT_THAT(messageOf<DepthSequenceError>([&] { openBagSequence(path_); }), HasSubstr("rosbag reindex"));
  writeText(path_, "# depth\n");
  EXPECT_FALSE(looksLikeBag(path_));
  EXPECT_FALSE(looksLikeBag(folder_.file("none.bag")));
  EXPECT_THAT(messageOf<DepthSequenceError>([&] { openBagSequence(folder_.file("none.bag")); }), HasSubstr("none.bag"));
}

}  // namespace
}  // namespace gpis_mapping_ros
