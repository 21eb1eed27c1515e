// SPDX-License-Identifier: BSD-3-Clause
#include "depth_camera_ros/conversions.h"

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>

#include <gmock/gmock.h>

namespace depth_camera_ros {
namespace {

using testing::HasSubstr;

template <typename T>
sensor_msgs::Image image(const std::string& encoding, std::uint32_t width, std::uint32_t height,
                         const std::vector<T>& pixels, std::uint32_t padding = 0, bool big_endian = false) {
  sensor_msgs::Image message;
  message.encoding = encoding;
  message.width = width;
  message.height = height;
  message.step = width * static_cast<std::uint32_t>(sizeof(T)) + padding;
  message.is_bigendian = big_endian;
  for (std::uint32_t v = 0; v < height; ++v) {
    for (std::uint32_t u = 0; u < width; ++u) {
      unsigned char bytes[sizeof(T)];
      std::memcpy(bytes, &pixels[v * width + u], sizeof(T));
      if (big_endian) std::reverse(bytes, bytes + sizeof(T));  // the tests' machine is little-endian
      message.data.insert(message.data.end(), bytes, bytes + sizeof(T));
    }
    message.data.insert(message.data.end(), padding, 0xAB);
  }
  return message;
}

TEST(ToDepthImage, ReadsMillimetresAndMetresOfEitherByteOrderWithPaddedRows) {
  const std::vector<std::uint16_t> raw = {0, 1500, 65535, 250, 1, 4000};
  const std::vector<float> metres = {1.5f, -1.0f, std::numeric_limits<float>::infinity(), 0.0f, 2.5f, 3.25f};
  for (const std::uint32_t padding : {0u, 3u}) {
    for (const bool big_endian : {false, true}) {
      Refusal refusal;
      const auto from_raw = toDepthImage(image("16UC1", 3, 2, raw, padding, big_endian), 1000.0, &refusal);
      ASSERT_TRUE(from_raw) << refusal.message;
      EXPECT_EQ(from_raw->width, 3);
      EXPECT_EQ(from_raw->height, 2);
      EXPECT_FLOAT_EQ(from_raw->at(1, 0), 1.5f);
      EXPECT_FLOAT_EQ(from_raw->at(0, 1), 0.25f);
      EXPECT_EQ(from_raw->at(0, 0), 0.0f);
      const auto from_float = toDepthImage(image("32FC1", 3, 2, metres, padding, big_endian), 1000.0, &refusal);
      ASSERT_TRUE(from_float) << refusal.message;
      EXPECT_EQ(from_float->depth_m, metres);
    }
  }
  Refusal refusal;
  EXPECT_FLOAT_EQ(toDepthImage(image("mono16", 3, 2, raw), 1000.0, &refusal)->at(1, 0), 1.5f);
  EXPECT_FLOAT_EQ(toDepthImage(image("16UC1", 3, 2, raw), 5000.0, &refusal)->at(1, 0), 0.3f);
}

TEST(ToDepthImage, RefusesWhatDoesNotFitTogether) {
  const sensor_msgs::Image good = image("32FC1", 3, 2, std::vector<float>(6, 1.0f));
  struct Case {
    std::function<void(sensor_msgs::Image&)> spoil;
    FrameStatus status;
    std::string says;
  };
  const std::vector<Case> cases = {
      {[](auto& m) { m.encoding = "rgb8"; }, FrameStatus::kWrongEncoding, "encoding is 'rgb8', must be one of 16UC1"},
      {[](auto& m) { m.encoding = ""; }, FrameStatus::kWrongEncoding, "encoding is ''"},
      {[](auto& m) { m.encoding = std::string(5000, '\n'); }, FrameStatus::kWrongEncoding, "????...'"},
      {[](auto& m) { m.width = 0; }, FrameStatus::kMalformedImage, "size is 0 x 2 px"},
      {[](auto& m) { m.height = 0; }, FrameStatus::kMalformedImage, "size is 3 x 0 px"},
      {[](auto& m) { m.step = 11; }, FrameStatus::kMalformedImage, "step 11 and 24 bytes are too few for 3 x 2 px"},
      {[](auto& m) { m.step = 0; }, FrameStatus::kMalformedImage, "step 0"},
      {[](auto& m) { m.data.pop_back(); }, FrameStatus::kMalformedImage, "step 12 and 23 bytes"},
      {[](auto& m) { m.data.clear(); }, FrameStatus::kMalformedImage, "0 bytes"},
      {[](auto& m) { m.height = 0xFFFFFFFFu; }, FrameStatus::kMalformedImage, "size is 3 x 4294967295 px"},
      {[](auto& m) { m.height = 0x7FFFFFFFu; }, FrameStatus::kMalformedImage, "too few for 3 x 2147483647 px"},
      {[](auto& m) {
         m.width = m.height = 0x7FFFFFFFu;
         m.step = 0xFFFFFFFFu;
       },
       FrameStatus::kMalformedImage, "too few"},
      {[](auto& m) { m.step = 0xFFFFFFFFu; }, FrameStatus::kMalformedImage, "too few"},
  };
  Refusal refusal;
  ASSERT_TRUE(toDepthImage(good, 1000.0, &refusal));
  for (const Case& c : cases) {
    sensor_msgs::Image message = good;
    c.spoil(message);
    refusal = {};
    EXPECT_FALSE(toDepthImage(message, 1000.0, &refusal)) << c.says;
    EXPECT_EQ(refusal.status, c.status) << c.says;
    EXPECT_THAT(refusal.message, HasSubstr(c.says));
    EXPECT_LT(refusal.message.size(), 200u);
  }
}

TEST(ToCameraModel, TakesPForRectifiedTopicsAndKElse) {
  sensor_msgs::CameraInfo info;
  info.width = 640;
  info.height = 480;
  info.K = {500, 0, 320, 0, 501, 240, 0, 0, 1};
  info.P = {510, 0, 321, 0, 0, 511, 241, 0, 0, 0, 1, 0};
  Refusal refusal;
  EXPECT_EQ(toCameraModel(info, true, &refusal)->fx, 510.0);
  EXPECT_EQ(toCameraModel(info, true, &refusal)->cy, 241.0);
  EXPECT_EQ(toCameraModel(info, false, &refusal)->fy, 501.0);
  info.P[0] = 0.0;  // some drivers leave P empty
  EXPECT_EQ(toCameraModel(info, true, &refusal)->fx, 500.0);
  info.K[0] = 0.0;
  EXPECT_FALSE(toCameraModel(info, true, &refusal));
  EXPECT_EQ(refusal.status, FrameStatus::kBadCameraInfo);
  EXPECT_THAT(refusal.message, HasSubstr("fx"));
  info.K[0] = 500.0;
  info.width = 0xFFFFFFFFu;
  EXPECT_FALSE(toCameraModel(info, false, &refusal));
  EXPECT_THAT(refusal.message, HasSubstr("4294967295 x 480"));
}

sensor_msgs::CameraInfo cutInfo(std::uint32_t x, std::uint32_t y, std::uint32_t width, std::uint32_t height,
                                std::uint32_t binning_x, std::uint32_t binning_y) {
  sensor_msgs::CameraInfo info;
  info.width = 160;
  info.height = 120;
  info.K = {130, 0, 79.6, 0, 129, 57.3, 0, 0, 1};
  info.P = {128, 0, 78.2, 0, 0, 127, 58.9, 0, 0, 0, 1, 0};
  info.roi.x_offset = x;
  info.roi.y_offset = y;
  info.roi.width = width;
  info.roi.height = height;
  info.binning_x = binning_x;
  info.binning_y = binning_y;
  return info;
}

TEST(ToCameraModel, RoiAndBinningCutAndAverageTheFullImage) {
  // 1/z of a plane is linear in the pixel: its mean over a block is that of the block's centre.
  const Eigen::Vector3d n = Eigen::Vector3d(0.2, -0.3, 1.0).normalized();
  const auto inverse_depth = [&n](const depth_camera::CameraModel& camera, double u, double v) {
    return n.dot(Eigen::Vector3d((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0)) / 1.5;
  };
  Refusal refusal;
  for (const bool is_rectified : {false, true}) {
    const auto full = toCameraModel(cutInfo(0, 0, 0, 0, 0, 0), is_rectified, &refusal);
    ASSERT_TRUE(full) << refusal.message;
    for (const auto& info : {cutInfo(0, 0, 160, 120, 1, 1), cutInfo(20, 16, 120, 88, 0, 0), cutInfo(0, 0, 0, 0, 4, 2),
                             cutInfo(21, 17, 99, 71, 3, 4)}) {
      const auto camera = toCameraModel(info, is_rectified, &refusal);
      ASSERT_TRUE(camera) << refusal.message;
      const int bx = static_cast<int>(std::max(1U, info.binning_x));
      const int by = static_cast<int>(std::max(1U, info.binning_y));
      const int x = static_cast<int>(info.roi.x_offset);
      const int y = static_cast<int>(info.roi.y_offset);
      EXPECT_EQ(camera->width, static_cast<int>(info.roi.width == 0 ? 160 : info.roi.width) / bx);
      EXPECT_EQ(camera->height, static_cast<int>(info.roi.height == 0 ? 120 : info.roi.height) / by);
      for (const int v : {0, 5, camera->height - 1}) {
        for (const int u : {0, 7, camera->width - 1}) {
          double sum = 0.0;
          for (int j = 0; j < by; ++j) {
            for (int i = 0; i < bx; ++i) sum += inverse_depth(*full, x + bx * u + i, y + by * v + j);
          }
          EXPECT_NEAR(inverse_depth(*camera, u, v), sum / (bx * by), 1e-12);
        }
      }
    }
  }
}

TEST(ToCameraModel, RefusesARoiThatLeavesTheFullImage) {
  struct Case {
    sensor_msgs::CameraInfo info;
    std::string says;
  };
  const std::vector<Case> cases = {
      {cutInfo(50, 40, 120, 88, 0, 0), "ROI is 120 x 88 px at (50, 40), must be within the full image of 160 x 120 px"},
      {cutInfo(20, 40, 120, 88, 0, 0), "at (20, 40)"},
      {cutInfo(20, 16, 0, 0, 0, 0), "ROI is 160 x 120 px at (20, 16)"},
      {cutInfo(0, 0, 0, 88, 0, 0), "ROI is 0 x 88 px"},
      {cutInfo(0, 0, 100, 0, 0, 0), "ROI is 100 x 0 px"},
      {cutInfo(0xFFFFFFFFU, 0, 120, 88, 0, 0), "at (4294967295, 0)"},
      {cutInfo(0, 0, 0xFFFFFFFFU, 88, 0, 0), "ROI is 4294967295 x 88 px"},
      {cutInfo(0, 0, 0, 0, 11, 1), "with its ROI and binning, camera width = 14 px"},
      {cutInfo(0, 0, 0, 0, 0xFFFFFFFFU, 1), "with its ROI and binning, camera width = 0 px"},
      {cutInfo(0, 0, 10, 10, 1, 1), "with its ROI and binning, camera width = 10 px"},
  };
  for (const Case& c : cases) {
    Refusal refusal;
    EXPECT_FALSE(toCameraModel(c.info, false, &refusal)) << c.says;
    EXPECT_EQ(refusal.status, FrameStatus::kBadCameraInfo);
    EXPECT_THAT(refusal.message, HasSubstr(c.says));
  }
}

TEST(ToDepthRectifier, DistortsWhatIsNotCalledRectified) {
  sensor_msgs::CameraInfo info = cutInfo(20, 16, 120, 88, 1, 2);
  info.distortion_model = "plumb_bob";
  info.D = {-0.2, 0.05, 0.001, 0.0, 0.0};
  Refusal refusal;
  depth_camera::DepthRectifier rectifier;
  ASSERT_TRUE(toDepthRectifier(info, true, &rectifier, &refusal)) << refusal.message;
  EXPECT_EQ(rectifier.camera(), *toCameraModel(info, true, &refusal));
  EXPECT_EQ(rectifier.rawCamera(), rectifier.camera());
  ASSERT_TRUE(toDepthRectifier(info, false, &rectifier, &refusal)) << refusal.message;
  EXPECT_EQ(rectifier.rawCamera(), *toCameraModel(info, false, &refusal));
  EXPECT_EQ(rectifier.camera(), depth_camera::DepthRectifier(rectifier.rawCamera(), {"plumb_bob", info.D}).camera());
  EXPECT_GT(rectifier.camera().width, rectifier.rawCamera().width);
}

TEST(ToDepthRectifier, KeepsItsTablesThroughJitterAndTheLastGoodOneThroughABadInfo) {
  sensor_msgs::CameraInfo info = cutInfo(0, 0, 0, 0, 0, 0);
  info.distortion_model = "plumb_bob";
  info.D = {-0.2, 0.05, 0.001, 0.0, 0.0};
  Refusal refusal;
  depth_camera::DepthRectifier rectifier;
  ASSERT_TRUE(toDepthRectifier(info, false, &rectifier, &refusal));
  info.K[0] += 1e-5;
  ASSERT_TRUE(toDepthRectifier(info, false, &rectifier, &refusal));
  EXPECT_EQ(rectifier.rawCamera().fx, 130.0);
  info.K[0] += 1.0;
  ASSERT_TRUE(toDepthRectifier(info, false, &rectifier, &refusal));
  EXPECT_EQ(rectifier.rawCamera().fx, info.K[0]);
  info.D[0] = -9.0;
  EXPECT_FALSE(toDepthRectifier(info, false, &rectifier, &refusal));
  EXPECT_EQ(refusal.status, FrameStatus::kBadCameraInfo);
  EXPECT_THAT(refusal.message, HasSubstr("camera info: D is not one to one"));
  EXPECT_EQ(rectifier.distortion().coefficients[0], -0.2);
  info.D.assign(5, 0.0);
  info.K[0] += 1e-5;
  ASSERT_TRUE(toDepthRectifier(info, false, &rectifier, &refusal));
  EXPECT_EQ(rectifier.camera().fx, info.K[0]);
  info.P[0] = 131.0;
  ASSERT_TRUE(toDepthRectifier(info, true, &rectifier, &refusal));
  info.P[0] += 1e-5;
  ASSERT_TRUE(toDepthRectifier(info, true, &rectifier, &refusal));
  EXPECT_EQ(rectifier.rawCamera().fx, 131.0);
}

TEST(ToIsometry, RefusesWhatIsNoRigidMotion) {
  geometry_msgs::Transform transform;
  transform.translation.x = 1.0;
  transform.rotation.z = transform.rotation.w = std::sqrt(0.5);
  Refusal refusal;
  const auto T = toIsometry(transform, &refusal);
  ASSERT_TRUE(T);
  EXPECT_LT((*T * Eigen::Vector3d::UnitX() - Eigen::Vector3d(1.0, 1.0, 0.0)).norm(), 1e-12);
  transform.rotation.w = 0.0;
  EXPECT_FALSE(toIsometry(transform, &refusal));
  EXPECT_EQ(refusal.status, FrameStatus::kBadTransform);
  transform.rotation.w = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(toIsometry(transform, &refusal));
  transform.rotation.w = std::sqrt(0.5);
  transform.translation.y = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(toIsometry(transform, &refusal));
  EXPECT_FALSE(toIsometry(geometry_msgs::Transform(), &refusal)) << "the all-zero quaternion of an unset message";
  EXPECT_FALSE(toIsometry(geometry_msgs::Transform())) << "nobody asks for the reason";
}

TEST(Conversions, ShiftedStampsAreNeverZero) {
  EXPECT_EQ(shifted(ros::Time(100, 5), 0.0), ros::Time(100, 5));
  EXPECT_EQ(shifted(ros::Time(1600000000, 10000000), -0.024), ros::Time(1599999999, 986000000));
  EXPECT_EQ(shifted(ros::Time(1600000000, 990000000), 0.024), ros::Time(1600000001, 14000000));
  EXPECT_EQ(shifted(ros::Time(0, 500000000), -0.5), ros::Time(0, 1));
  EXPECT_EQ(shifted(ros::Time(0, 1), -1.0), ros::Time(0, 1));
  EXPECT_EQ(shifted(ros::TIME_MAX, 1.0), ros::TIME_MAX);
}

TEST(Conversions, HoldMeasurementOnlyWithADepthOrNothingInReach) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  EXPECT_FALSE(depth_camera::holdsMeasurement({2, 2, {nan, 0.0f, -inf, -1.0f}}));
  EXPECT_TRUE(depth_camera::holdsMeasurement({2, 2, {nan, 0.0f, inf, -1.0f}}));
  EXPECT_TRUE(depth_camera::holdsMeasurement({2, 2, {nan, 0.0f, -inf, 0.4f}}));
}

TEST(Conversions, KnowRectifiedTopics) {
  EXPECT_TRUE(isRectifiedTopic("/camera/depth/image_rect"));
  EXPECT_TRUE(isRectifiedTopic("image_rect_raw"));
  EXPECT_FALSE(isRectifiedTopic("/rectified_camera/depth/image_raw"));
}

TEST(Conversions, EveryStatusHasAName) {
  for (int i = 0; i < kNumFrameStatus; ++i) {
    EXPECT_STRNE(toString(static_cast<FrameStatus>(i)), "?") << i;
  }
}

}  // namespace
}  // namespace depth_camera_ros
