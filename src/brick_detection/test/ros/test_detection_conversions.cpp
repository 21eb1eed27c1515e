// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/conversions.h"

#include <cmath>
#include <limits>
#include <set>
#include <utility>

#include <gmock/gmock.h>

namespace brick_detection_ros {
namespace {

using brick_detection::CameraModel;
using brick_detection::Distortion;
using interactive_mapping_msgs::BrickDetectionUpdate;
using testing::ElementsAre;
using testing::HasSubstr;

sensor_msgs::Image image(const std::string& encoding, std::uint32_t width, std::uint32_t height, std::uint32_t step,
                         std::vector<std::uint8_t> data) {
  sensor_msgs::Image message;
  message.encoding = encoding;
  message.width = width;
  message.height = height;
  message.step = step;
  message.data = std::move(data);
  return message;
}

sensor_msgs::CameraInfo cameraInfo() {
  sensor_msgs::CameraInfo info;
  info.width = 640;
  info.height = 480;
  info.distortion_model = "plumb_bob";
  info.D = {0.1, -0.2, 0.001, 0.002, 0.05};
  info.K = {600.0, 0.0, 320.0, 0.0, 601.0, 240.0, 0.0, 0.0, 1.0};
  info.P = {590.0, 0.0, 321.0, 0.0, 0.0, 591.0, 241.0, 0.0, 0.0, 0.0, 1.0, 0.0};
  return info;
}

TEST(ToColorImage, OrdersColoursBlueGreenRed) {
  Refusal refusal;
  for (const auto& [encoding, data] : {std::make_pair("rgb8", std::vector<std::uint8_t>{1, 2, 3}),
                                       std::make_pair("bgr8", std::vector<std::uint8_t>{3, 2, 1}),
                                       std::make_pair("rgba8", std::vector<std::uint8_t>{1, 2, 3, 9}),
                                       std::make_pair("bgra8", std::vector<std::uint8_t>{3, 2, 1, 9})}) {
    const auto mat = toColorImage(image(encoding, 1, 1, static_cast<std::uint32_t>(data.size()), data), &refusal);
    ASSERT_TRUE(mat) << encoding << " " << refusal.message;
    EXPECT_EQ(mat->at<cv::Vec3b>(0, 0), cv::Vec3b(3, 2, 1)) << encoding;
  }
  const auto grey = toColorImage(image("mono8", 1, 1, 1, {7}), &refusal);
  ASSERT_TRUE(grey);
  EXPECT_EQ(grey->type(), CV_8UC1);
  EXPECT_EQ(grey->at<std::uint8_t>(0, 0), 7);
}

TEST(ToColorImage, KeepsRowsApartWhateverTheirStep) {
  Refusal refusal;
  // Two rows of two grey pixels, a byte between them; the last row ends with its pixels.
  const auto mat = toColorImage(image("mono8", 2, 2, 3, {1, 2, 99, 3, 4}), &refusal);
  ASSERT_TRUE(mat) << refusal.message;
  EXPECT_EQ(mat->at<std::uint8_t>(1, 0), 3);
  EXPECT_EQ(mat->at<std::uint8_t>(1, 1), 4);
}

TEST(ToColorImage, RefusesWhatDoesNotFitTogether) {
  Refusal refusal;
  EXPECT_FALSE(toColorImage(image("mono8", 2, 2, 2, {1, 2, 3}), &refusal));
  EXPECT_EQ(refusal.status, FrameStatus::kMalformedImage);
  EXPECT_FALSE(toColorImage(image("rgb8", 2, 2, 4, std::vector<std::uint8_t>(100)), &refusal));
  EXPECT_THAT(refusal.message, HasSubstr("step 4"));
  EXPECT_FALSE(toColorImage(image("mono8", 0, 2, 0, {}), &refusal));
  EXPECT_THAT(refusal.message, HasSubstr("0 x 2 px"));
  // A product of 2^32 * 2^32 bytes must not come out small.
  EXPECT_FALSE(toColorImage(image("mono8", 0x80000000u, 0x80000000u, 0x80000000u, {1}), &refusal));
  EXPECT_EQ(refusal.status, FrameStatus::kMalformedImage);
  EXPECT_FALSE(toColorImage(image("mono8", 30000, 30000, 30000, {1}), &refusal));
  EXPECT_EQ(refusal.status, FrameStatus::kMalformedImage);
  for (const char* encoding : {"", "16UC1", "32FC1", "mono16", "yuv422", "8UC3"}) {
    EXPECT_FALSE(toColorImage(image(encoding, 1, 1, 16, std::vector<std::uint8_t>(16)), &refusal)) << encoding;
    EXPECT_EQ(refusal.status, FrameStatus::kWrongEncoding) << encoding;
  }
}

TEST(CameraModelOf, RawImagesUseKAndD) {
  Refusal refusal;
  const auto camera = cameraModelOf(cameraInfo(), false, &refusal);
  ASSERT_TRUE(camera) << refusal.message;
  EXPECT_EQ(camera->fx_px, 600.0);
  EXPECT_EQ(camera->fy_px, 601.0);
  EXPECT_EQ(camera->cx_px, 320.0);
  EXPECT_EQ(camera->cy_px, 240.0);
  EXPECT_EQ(camera->distortion, Distortion::kPlumbBob);
  EXPECT_EQ(camera->coefficients, cameraInfo().D);
}

TEST(CameraModelOf, RectifiedImagesUsePAlone) {
  Refusal refusal;
  const auto camera = cameraModelOf(cameraInfo(), true, &refusal);
  ASSERT_TRUE(camera) << refusal.message;
  EXPECT_EQ(camera->fx_px, 590.0);
  EXPECT_EQ(camera->fy_px, 591.0);
  EXPECT_EQ(camera->cx_px, 321.0);
  EXPECT_EQ(camera->cy_px, 241.0);
  EXPECT_EQ(camera->distortion, Distortion::kNone);
}

TEST(CameraModelOf, KnowsTheModelsByTheirNames) {
  Refusal refusal;
  sensor_msgs::CameraInfo info = cameraInfo();
  info.distortion_model = "rational_polynomial";
  info.D = {0.1, -0.2, 0.001, 0.002, 0.05, 0.01, 0.02, 0.03};
  EXPECT_EQ(cameraModelOf(info, false, &refusal)->distortion, Distortion::kRationalPolynomial);
  info.distortion_model = "equidistant";
  info.D = {0.1, -0.02, 0.003, 0.001};
  EXPECT_EQ(cameraModelOf(info, false, &refusal)->distortion, Distortion::kEquidistant);
  // Nothing to undo, whatever it is called.
  info.D.clear();
  EXPECT_EQ(cameraModelOf(info, false, &refusal)->distortion, Distortion::kNone);
  info.distortion_model = "plumb_bob";
  info.D.assign(5, 0.0);
  EXPECT_EQ(cameraModelOf(info, false, &refusal)->distortion, Distortion::kNone);
  info.distortion_model = "";
  info.D.clear();
  EXPECT_EQ(cameraModelOf(info, false, &refusal)->distortion, Distortion::kNone);
}

TEST(CameraModelOf, FisheyeIsEquidistant) {
  Refusal refusal;
  sensor_msgs::CameraInfo info = cameraInfo();
  info.distortion_model = "fisheye";
  info.D = {0.1, -0.02, 0.003, 0.001};
  const auto camera = cameraModelOf(info, false, &refusal);
  ASSERT_TRUE(camera) << refusal.message;
  EXPECT_EQ(camera->distortion, Distortion::kEquidistant);
  EXPECT_EQ(camera->coefficients, info.D);
}

TEST(CameraModelOf, IsOfThePartThatBinningAndRoiLeave) {
  Refusal refusal;
  sensor_msgs::CameraInfo info = cameraInfo();
  info.width = 1280;
  info.height = 960;
  info.K = {1230.0, 0.0, 639.5, 0.0, 1220.0, 479.5, 0.0, 0.0, 1.0};
  info.binning_x = info.binning_y = 2;
  auto camera = cameraModelOf(info, false, &refusal);
  ASSERT_TRUE(camera) << refusal.message;
  EXPECT_EQ(camera->width_px, 640);
  EXPECT_EQ(camera->height_px, 480);
  EXPECT_DOUBLE_EQ(camera->fx_px, 615.0);
  EXPECT_DOUBLE_EQ(camera->fy_px, 610.0);
  EXPECT_DOUBLE_EQ(camera->cx_px, 319.5);  // pixel centres are at integers
  EXPECT_DOUBLE_EQ(camera->cy_px, 239.5);
  EXPECT_EQ(camera->coefficients, info.D) << "of bearings: no matter how large a pixel is";

  info.binning_x = info.binning_y = 0;
  info.roi.x_offset = 320;
  info.roi.y_offset = 240;
  info.roi.width = 640;
  info.roi.height = 480;
  camera = cameraModelOf(info, false, &refusal);
  ASSERT_TRUE(camera) << refusal.message;
  EXPECT_EQ(camera->width_px, 640);
  EXPECT_DOUBLE_EQ(camera->fx_px, 1230.0);
  EXPECT_DOUBLE_EQ(camera->cx_px, 319.5);
  EXPECT_DOUBLE_EQ(camera->cy_px, 239.5);
  // Where a point is seen follows the cut.
  const Eigen::Vector3d p_camera(0.05, 0.03, 1.0);
  sensor_msgs::CameraInfo whole = info;
  whole.roi = sensor_msgs::RegionOfInterest();
  const auto full = cameraModelOf(whole, false, &refusal);
  ASSERT_TRUE(full) << refusal.message;
  EXPECT_TRUE(camera->project(p_camera).isApprox(full->project(p_camera) - Eigen::Vector2d(320.0, 240.0), 1e-9));

  info.roi.x_offset = 700;
  EXPECT_FALSE(cameraModelOf(info, false, &refusal));
  EXPECT_EQ(refusal.status, FrameStatus::kBadCameraInfo);
  EXPECT_THAT(refusal.message, HasSubstr("ROI is 640 x 480 px at (700, 240)"));
}

TEST(CameraModelOf, RefusesWhatCannotBe) {
  const auto refusalOf = [](const sensor_msgs::CameraInfo& info) {
    Refusal refusal;
    EXPECT_FALSE(cameraModelOf(info, false, &refusal));
    EXPECT_EQ(refusal.status, FrameStatus::kBadCameraInfo);
    return refusal.message;
  };
  sensor_msgs::CameraInfo info = cameraInfo();
  info.distortion_model = "fancy";
  EXPECT_THAT(refusalOf(info), HasSubstr("distortion_model is 'fancy'"));
  info = cameraInfo();
  info.distortion_model = "";
  EXPECT_THAT(refusalOf(info), HasSubstr("D has 5 coefficients"));
  info = cameraInfo();
  info.D = {0.1, 0.2};
  refusalOf(info);
  info = cameraInfo();
  info.D[1] = std::numeric_limits<double>::quiet_NaN();
  refusalOf(info);
  info = cameraInfo();
  info.K[0] = 0.0;
  refusalOf(info);
  info = cameraInfo();
  info.width = 0;
  refusalOf(info);
  info = cameraInfo();
  info.width = 0xFFFFFFFFu;
  EXPECT_THAT(refusalOf(info), HasSubstr("4294967295"));
}

TEST(ToMessage, BrickHasPoseCovarianceAndFacesInTheirPlaces) {
  const auto catalogue = mp700_ur5e_description::loadBrickTypes(BRICKS_YAML);
  brick_detection::TrackedBrick brick;
  brick.id = 5;
  brick.instance = 2;
  brick.has_duplicate = true;
  brick.T_map_brick.translation() << 1.0, 2.0, 3.0;
  brick.T_map_brick.rotate(Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitZ()));
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) brick.covariance(i, j) = 10.0 * i + j;
  }
  brick.num_looks = 4;
  brick.first_seen_s = 1.5;
  brick.last_seen_s = 2.5;
  brick.faces_seen[4] = true;
  brick_detection::FaceAccess access;
  access.face = mp700_ur5e_description::BrickFace::kMinusY;
  access.T_map_plate.translation() << 7.0, 8.0, 9.0;
  access.accessibility = 0.5;
  access.free_share = 0.25;
  access.unknown_share = 0.75;
  const auto message = toMessage(brick, catalogue.types.front(), {access});
  EXPECT_EQ(message.id, 5);
  EXPECT_EQ(message.instance, 2u);
  EXPECT_TRUE(message.has_duplicate);
  EXPECT_EQ(message.type, "brick");
  EXPECT_DOUBLE_EQ(message.size.y, 0.2);
  EXPECT_DOUBLE_EQ(message.pose.pose.position.z, 3.0);
  EXPECT_NEAR(message.pose.pose.orientation.z, std::sin(0.25), 1e-12);
  EXPECT_DOUBLE_EQ(message.pose.covariance[6 * 2 + 5], 25.0);
  EXPECT_EQ(message.num_looks, 4u);
  EXPECT_EQ(message.first_seen, ros::Time(1.5));
  EXPECT_EQ(message.last_seen, ros::Time(2.5));
  EXPECT_THAT(message.faces_seen, ElementsAre(interactive_mapping_msgs::BrickFace::PLUS_Z));
  ASSERT_EQ(message.graspable_faces.size(), 1u);
  EXPECT_EQ(message.graspable_faces[0].face, interactive_mapping_msgs::BrickFace::MINUS_Y);
  EXPECT_DOUBLE_EQ(message.graspable_faces[0].pose.position.y, 8.0);
  EXPECT_EQ(message.graspable_faces[0].accessibility, 0.5F);
  EXPECT_EQ(message.graspable_faces[0].free_share, 0.25F);
  EXPECT_EQ(message.graspable_faces[0].unknown_share, 0.75F);
}

TEST(UpdateStatus, HasANameForEachAndAConstantForEachRefusal) {
  std::set<std::string> names;
  for (std::uint8_t status = 0; status < BrickDetectionUpdate::NUM_STATUS; ++status) {
    names.insert(toString(static_cast<DetectionUpdateStatus>(status)));
  }
  EXPECT_EQ(names.size(), static_cast<std::size_t>(BrickDetectionUpdate::NUM_STATUS));
  EXPECT_STREQ(toString(static_cast<DetectionUpdateStatus>(BrickDetectionUpdate::POSE_JUMP)), "pose jump");
  EXPECT_STREQ(toString(depth_camera_ros::statusOf<DetectionUpdateStatus>(FrameStatus::kWrongEncoding)),
               "wrong encoding");
  EXPECT_STREQ(toString(depth_camera_ros::statusOf<DetectionUpdateStatus>(FrameStatus::kStampInFuture)),
               "stamp in the future");
  EXPECT_EQ(depth_camera_ros::statusOf<DetectionUpdateStatus>(FrameStatus::kRefusedByMap),
            DetectionUpdateStatus::kFailed);
}

}  // namespace
}  // namespace brick_detection_ros
