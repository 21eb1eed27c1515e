// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/depth_sequence.h"

#include <array>
#include <cmath>
#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include <depth_camera/depth_rectifier.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

namespace gpis_mapping {
namespace {

namespace fs = std::filesystem;
using test_support::messageOf;
using test_support::readText;
using test_support::TemporaryFolder;
using test_support::writeText;
using testing::HasSubstr;

constexpr int kWidth = 32;
constexpr int kHeight = 24;

void writeImage(const std::string& path, std::uint16_t value, int width = kWidth) {
  cv::Mat image(kHeight, width, CV_16UC1, cv::Scalar(value));
  image.at<std::uint16_t>(0, 0) = 0;
  image.at<std::uint16_t>(2, 1) = 65535;  // row 2, column 1
  if (!cv::imwrite(path, image)) throw std::runtime_error(path + ": cannot be written");
}

/// Reads all frames; what they throw, or empty.
std::string refusalOf(const std::string& path) {
  return messageOf<DepthSequenceError>([&] {
    const auto sequence = openDepthSequence(path);
    SkipReason reason;
    for (std::size_t i = 0; i < sequence->size(); ++i) sequence->frame(i, &reason);
  });
}

// ---------------------------------------------------------------------------------------------------- TUM RGB-D

class TumFolder : public testing::Test {
 protected:
  TumFolder() {
    fs::create_directory(file("depth"));
    for (int i = 0; i < 3; ++i) {
      writeImage(file("depth/" + std::to_string(i) + ".png"), static_cast<std::uint16_t>(5000 * (i + 1)));
    }
    writeText(file("depth.txt"), "# depth\n\n10.00 depth/0.png\n10.04 depth/1.png\n10.08 depth/2.png\r\n");
    // A quarter turn about z in 0.1 s while moving 1 m along x.
    writeText(file("groundtruth.txt"),
              "# timestamp tx ty tz qx qy qz qw\n"
              "10.00 1 2 3 0 0 0 1\n"
              "10.10 2 2 3 0 0 0.70710678 0.70710678\n");
    writeText(file("camera_info.yaml"), cameraInfo());
  }
  static std::string cameraInfo(const std::string& data = "[30, 0, 15.5, 0, 31, 11.5, 0, 0, 1]") {
    return "image_width: 32\nimage_height: 24\ncamera_name: test\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: " +
           data + "\ndistortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n";
  }
  std::string file(const std::string& name) const { return folder_.file(name); }

  TemporaryFolder folder_;
};

TEST_F(TumFolder, GivesImagesInMetresAndCamera) {
  const auto sequence = openDepthSequence(folder_.path());
  ASSERT_EQ(sequence->size(), 3u);
  EXPECT_EQ(sequence->camera(), (CameraModel{kWidth, kHeight, 30, 31, 15.5, 11.5}));
  SkipReason reason;
  const auto frame = sequence->frame(1, &reason);
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->image.width, kWidth);
  EXPECT_EQ(frame->image.height, kHeight);
  EXPECT_FLOAT_EQ(frame->image.at(5, 5), 2.0f);
  EXPECT_EQ(frame->image.at(0, 0), 0.0f);
  EXPECT_EQ(frame->image.at(1, 2), 0.0f);  // 65535 is no value either
  EXPECT_EQ(frame->stamp_s, 10.04);
  EXPECT_THAT(frame->name, HasSubstr("1.png"));
  EXPECT_THAT(sequence->notes(), testing::IsEmpty());
}

TEST_F(TumFolder, UnitsCanBeGiven) {
  writeText(file("camera_info.yaml"), cameraInfo() + "depth_units_per_metre: 1000\n");
  SkipReason reason;
  EXPECT_FLOAT_EQ(openDepthSequence(folder_.path())->frame(0, &reason)->image.at(5, 5), 5.0f);
}

TEST_F(TumFolder, InterpolatesPoses) {
  const auto sequence = openDepthSequence(folder_.path());
  SkipReason reason;
  const Eigen::Isometry3d first = sequence->frame(0, &reason)->T_map_camera;
  EXPECT_TRUE(first.isApprox(Eigen::Isometry3d(Eigen::Translation3d(1, 2, 3)), 1e-12));
  const Eigen::Isometry3d T = sequence->frame(1, &reason)->T_map_camera;
  const Eigen::AngleAxisd expected(0.4 * M_PI / 2.0, Eigen::Vector3d::UnitZ());
  EXPECT_NEAR((T.translation() - Eigen::Vector3d(1.4, 2, 3)).norm(), 0.0, 1e-9);
  // The trajectory has eight decimals.
  EXPECT_NEAR((T.linear() - expected.toRotationMatrix()).norm(), 0.0, 1e-7);
}

TEST_F(TumFolder, LooksUpPosesAtTheStampPlusTheTimeOffset) {
  const auto sequence = openDepthSequence(folder_.path());
  SkipReason reason;
  EXPECT_NEAR(sequence->pose(1, 0.02, &reason)->T_map_camera.translation().x(), 1.6, 1e-9);
  sequence->setTimeOffset(-0.01);
  const auto frame = sequence->frame(1, &reason);
  ASSERT_TRUE(frame);
  EXPECT_NEAR(frame->T_map_camera.translation().x(), 1.3, 1e-9);
  EXPECT_EQ(frame->stamp_s, 10.04) << "the image's own";
  EXPECT_FALSE(sequence->pose(0, -0.5, &reason));
}

TEST_F(TumFolder, InterpolatesAlongTheShorterArc) {
  writeText(file("groundtruth.txt"), "10.00 0 0 0 0 0 0 1\n10.08 0 0 0 0 0 -0.0871557 -0.9961947\n");  // 10 deg
  const auto sequence = openDepthSequence(folder_.path());
  SkipReason reason;
  const Eigen::AngleAxisd half(sequence->frame(1, &reason)->T_map_camera.linear());
  EXPECT_NEAR(half.angle(), 5.0 * M_PI / 180.0, 1e-6);
}

TEST_F(TumFolder, PosesNeedNoOrder) {
  writeText(file("groundtruth.txt"), "10.10 2 2 3 0 0 0 1\n10.00 1 2 3 0 0 0 1\n");
  SkipReason reason;
  EXPECT_NEAR(openDepthSequence(folder_.path())->frame(1, &reason)->T_map_camera.translation().x(), 1.4, 1e-9);
}

TEST_F(TumFolder, SkipsFramesWithoutPoseAndSaysWhy) {
  // 0.03 s after the last pose, then 0.07 s: only poses within 0.02 s count there.
  writeText(file("groundtruth.txt"), "9.90 1 2 3 0 0 0 1\n10.01 1 2 3 0 0 0 1\n");
  const auto sequence = openDepthSequence(folder_.path());
  ASSERT_EQ(sequence->size(), 3u);
  SkipReason reason;
  EXPECT_TRUE(sequence->frame(0, &reason));  // 0.01 s from a pose
  EXPECT_FALSE(sequence->frame(1, &reason));
  EXPECT_EQ(reason.kind, "no pose near enough in time");
  EXPECT_THAT(reason.detail, HasSubstr("10.04"));
  EXPECT_THAT(reason.detail, HasSubstr("0.02 s"));
  EXPECT_FALSE(sequence->frame(2, &reason));
}

TEST_F(TumFolder, SkipsFramesInALongGapOfTheTrajectory) {
  writeText(file("groundtruth.txt"), "9.95 1 2 3 0 0 0 1\n10.06 1 2 3 0 0 0 1\n");
  const auto sequence = openDepthSequence(folder_.path());
  SkipReason reason;
  EXPECT_FALSE(sequence->frame(0, &reason));  // 0.05 s from the nearest, gap 0.11 s
  EXPECT_TRUE(sequence->frame(1, &reason));   // 0.02 s from the nearest
}

TEST_F(TumFolder, TakesThePoseOfTheVeryStamp) {
  writeText(file("groundtruth.txt"), "9.0 9 9 9 0 0 0 1\n10.04 1 2 3 0 0 0 1\n12.0 9 9 9 0 0 0 1\n");
  SkipReason reason;
  const auto frame = openDepthSequence(folder_.path())->frame(1, &reason);
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->T_map_camera.translation(), Eigen::Vector3d(1, 2, 3));
}

TEST_F(TumFolder, RefusesMissingFiles) {
  const std::string info = readText(file("camera_info.yaml"));
  fs::remove(file("camera_info.yaml"));
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("camera_info.yaml: is missing"));
  writeText(file("camera_info.yaml"), info);
  fs::remove(file("depth/1.png"));
  // One lost image does not make the recording useless: only its own frame is refused.
  const auto sequence = openDepthSequence(folder_.path());
  SkipReason reason;
  EXPECT_THAT(messageOf<DepthSequenceError>([&] { sequence->frame(1, &reason); }), HasSubstr("depth/1.png"));
  EXPECT_TRUE(sequence->frame(0, &reason));
  writeImage(file("depth/1.png"), 1);
  fs::remove(file("groundtruth.txt"));
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("groundtruth.txt: is missing"));
}

TEST_F(TumFolder, RefusesMalformedLists) {
  writeText(file("depth.txt"), "10.0 depth/0.png\n10.1\n");
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("depth.txt:2: has 1 entries, must have 2"));
  writeText(file("depth.txt"), "ten depth/0.png\n");
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("depth.txt:1: 'ten' is not a finite number"));
  writeText(file("depth.txt"), "# nothing\n");
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("lists no image"));
}

TEST_F(TumFolder, RefusesMalformedTrajectories) {
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"10 1 2 3 0 0 0 1\n10.1 1 2 3 0 0 1\n", "groundtruth.txt:2: has 7 entries, must have 8"},
      {"nan 1 2 3 0 0 0 1\n", "groundtruth.txt:1: 'nan' is not a finite number"},
      {"# c\n10 1 2 3 0 0 0 nan\n", "holds no pose"},  // tracking lost all the time
      {"10 1 2 3 0 0 0 1.2\n", "groundtruth.txt:1: quaternion has norm 1.2"},
      {"10 1 2 3x 0 0 0 1\n", "'3x' is not a finite number"},
      {"", "holds no pose"},
  };
  for (const auto& [text, expected] : cases) {
    writeText(file("groundtruth.txt"), text);
    EXPECT_THAT(refusalOf(folder_.path()), HasSubstr(expected));
  }
}

TEST_F(TumFolder, SkipsLostPoses) {
  for (const char* lost : {"nan nan nan nan nan nan nan", "0 0 0 0 0 0 0", "-inf -inf -inf -inf -inf -inf -inf",
                           "1 2 3 -1.#IND000e+000 0 0 1", "1.#QNAN 2 3 0 0 0 1", "1 2 3 0 0 0 nan(ind)"}) {
    writeText(file("groundtruth.txt"), "9.5 1 2 3 0 0 0 1\n10.00 " + std::string(lost) + "\n10.08 1 2 3 0 0 0 1\n");
    const auto sequence = openDepthSequence(folder_.path());
    SkipReason reason;
    EXPECT_FALSE(sequence->frame(0, &reason)) << lost;
    EXPECT_FALSE(sequence->pose(0, 0.0, &reason)) << lost;
    EXPECT_TRUE(sequence->frame(2, &reason)) << lost;
  }
}

TEST_F(TumFolder, ReadsAByteOrderMark) {
  for (const char* name : {"depth.txt", "groundtruth.txt", "camera_info.yaml"}) {
    writeText(file(name), "\xEF\xBB\xBF" + readText(file(name)));
  }
  EXPECT_EQ(refusalOf(folder_.path()), "");
}

TEST_F(TumFolder, SaysInWhichUnitStampsLookToBe) {
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"1305031239543802112", "nanoseconds, must be in seconds: divide by 1e9"},
      {"1305031239543802", "microseconds, must be in seconds: divide by 1e6"},
      {"1305031239543", "milliseconds, must be in seconds: divide by 1e3"},
  };
  for (const auto& [stamp, expected] : cases) {
    writeText(file("depth.txt"), "10.00 depth/0.png\n" + stamp + " depth/1.png\n");
    EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("depth.txt:2: stamp " + stamp + " looks like " + expected));
  }
  writeText(file("depth.txt"), "10.00 depth/0.png\n");
  writeText(file("groundtruth.txt"), "1305031239543802112 1 2 3 0 0 0 1\n");
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("groundtruth.txt:1: stamp 1305031239543802112 looks like"));
}

TEST_F(TumFolder, PrintsStampsWithDecimals) {
  writeText(file("depth.txt"), "1305031239.543802 depth/0.png\n");
  SkipReason reason;
  EXPECT_FALSE(openDepthSequence(folder_.path())->frame(0, &reason));
  EXPECT_THAT(reason.detail, HasSubstr("1305031239.543802"));
}

TEST_F(TumFolder, TurnsImagesOfACameraWithYUp) {
  SkipReason reason;
  const auto upright = openDepthSequence(folder_.path())->frame(0, &reason);
  writeText(file("camera_info.yaml"), cameraInfo("[30, 0, 15.5, 0, -31, 10.5, 0, 0, 1]"));
  const auto sequence = openDepthSequence(folder_.path());
  EXPECT_EQ(sequence->camera(), (CameraModel{kWidth, kHeight, 30, 31, 15.5, 12.5}));
  EXPECT_THAT(sequence->notes(), testing::ElementsAre(HasSubstr("upside down")));
  const auto turned = sequence->frame(0, &reason);
  ASSERT_TRUE(turned);
  // What y up says of a pixel: y = (v - cy) / fy with the file's numbers.
  for (const int v : {0, 2, kHeight - 1}) {
    const int row = kHeight - 1 - v;
    for (int u = 0; u < kWidth; ++u) ASSERT_EQ(turned->image.at(u, row), upright->image.at(u, v));
    EXPECT_NEAR((row - sequence->camera().cy) / sequence->camera().fy, (v - 10.5) / -31, 1e-12);
  }
  EXPECT_TRUE(turned->T_map_camera.isApprox(upright->T_map_camera));
}

TEST_F(TumFolder, ReadsACameraInfoAsRostopicEchoPrintsIt) {
  const std::string text =
      "header: \n  seq: 1\n  frame_id: \"eye\"\nheight: 24\nwidth: 32\ndistortion_model: \"plumb_bob\"\n"
      "D: [0.1, 0.0, 0.0, 0.0, 0.0]\nK: [30.0, 0.0, 15.5, 0.0, 31.0, 11.5, 0.0, 0.0, 1.0]\n---\n";
  writeText(file("camera_info.yaml"), text);
  const auto sequence = openDepthSequence(folder_.path());
  const depth_camera::DepthRectifier rectifier({kWidth, kHeight, 30, 31, 15.5, 11.5},
                                               {"plumb_bob", {0.1, 0.0, 0.0, 0.0, 0.0}});
  EXPECT_EQ(sequence->camera(), rectifier.camera());
  EXPECT_FALSE(sequence->camera() == rectifier.rawCamera());
  EXPECT_THAT(sequence->notes(), testing::IsEmpty());
  writeText(file("camera_info.yaml"), text.substr(text.find("distortion_model")));
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("key image_width is missing"));
}

TEST_F(TumFolder, GivenUnitsCountAboveTheFiles) {
  writeText(file("camera_info.yaml"), cameraInfo() + "depth_units_per_metre: 1000\n");
  SkipReason reason;
  EXPECT_FLOAT_EQ(openDepthSequence(folder_.path(), 2500.0)->frame(0, &reason)->image.at(5, 5), 2.0f);
}

TEST_F(TumFolder, RefusesWrongImages) {
  writeImage(file("depth/1.png"), 5000, kWidth + 1);
  EXPECT_THAT(refusalOf(folder_.path()),
              testing::AllOf(HasSubstr("depth/1.png: image is 33 x 24 px"), HasSubstr("must be 32 x 24 px")));
  cv::imwrite(file("depth/1.png"), cv::Mat(kHeight, kWidth, CV_8UC1, cv::Scalar(7)));
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("1 channel(s) of 8 bits"));
  cv::imwrite(file("depth/1.png"), cv::Mat(kHeight, kWidth, CV_16UC3, cv::Scalar(7, 7, 7)));
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("3 channel(s) of 16 bits"));
  writeText(file("depth/1.png"), "no image");
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("depth/1.png: image cannot be decoded"));
  writeImage(file("depth/1.png"), 5000);
  const std::string whole = readText(file("depth/1.png"));
  writeText(file("depth/1.png"), whole.substr(0, whole.size() / 2));
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("depth/1.png: image cannot be decoded"));
}

TEST_F(TumFolder, RefusesNamesThatNoFileCanHave) {
  writeText(file("depth.txt"), "10.0 " + std::string(300, 'a') + "\n");
  writeText(file("groundtruth.txt"), "10.0 0 0 0 0 0 0 1\n");
  const auto sequence = openDepthSequence(folder_.path());
  SkipReason reason;
  EXPECT_THAT(messageOf<DepthSequenceError>([&] { sequence->frame(0, &reason); }), HasSubstr("name too long"));
}

TEST_F(TumFolder, RefusesImpossibleCameras) {
  const std::vector<std::pair<std::string, std::string>> cases = {
      {cameraInfo("[30, 0, 15.5, 0, 31]"), "camera_matrix/data has 5 numbers, must have 9"},
      {cameraInfo("[-30, 0, 15.5, 0, 31, 11.5, 0, 0, 1]"), "camera fx = -30"},
      {cameraInfo("[wide, 0, 15.5, 0, 31, 11.5, 0, 0, 1]"), "camera_info.yaml"},
      {"image_width: 32\n", "key image_height is missing"},
      {"image_width: {", "camera_info.yaml"},
      {cameraInfo() + "depth_units_per_metre: 0\n", "depth_units_per_metre = 0, must be > 0"},
      {cameraInfo() + "depth_units_per_metre: .nan\n", "depth_units_per_metre"},
  };
  for (const auto& [text, expected] : cases) {
    writeText(file("camera_info.yaml"), text);
    EXPECT_THAT(refusalOf(folder_.path()), HasSubstr(expected));
  }
}

/// camera_info.yaml with these coefficients, of this model if one is given.
std::string distorted(std::string text, const std::string& coefficients, const std::string& model = "") {
  text.replace(text.find("[0, 0, 0, 0, 0]"), 15, coefficients);
  return text + (model.empty() ? "" : "distortion_model: " + model + "\n");
}

TEST_F(TumFolder, RectifiesDistortedImages) {
  for (const char* model : {"", "plumb_bob"}) {
    writeText(file("camera_info.yaml"), distorted(cameraInfo(), "[-0.2, 0.01, 0, 0, 0]", model));
    const depth_camera::DepthRectifier rectifier({kWidth, kHeight, 30, 31, 15.5, 11.5},
                                                 {"plumb_bob", {-0.2, 0.01, 0.0, 0.0, 0.0}});
    const auto sequence = openDepthSequence(folder_.path());
    EXPECT_EQ(sequence->camera(), rectifier.camera());
    EXPECT_GT(sequence->camera().width, kWidth);
    SkipReason reason;
    const DepthImage image = sequence->frame(0, &reason)->image;
    DepthImage raw{kWidth, kHeight, std::vector<float>(kWidth * kHeight, 1.0f)};
    raw.depth_m[0] = raw.depth_m[2 * kWidth + 1] = 0.0f;
    EXPECT_THAT(image.depth_m, testing::Pointwise(testing::NanSensitiveFloatEq(), rectifier.rectify(raw).depth_m));
    EXPECT_THAT(sequence->notes(), testing::IsEmpty());
  }
}

TEST_F(TumFolder, RefusesDistortionOfACameraWithYUp) {
  writeText(file("camera_info.yaml"),
            distorted(cameraInfo("[30, 0, 15.5, 0, -31, 10.5, 0, 0, 1]"), "[0.1, 0, 0, 0, 0]"));
  EXPECT_THAT(refusalOf(folder_.path()),
              testing::AllOf(HasSubstr("camera_info.yaml: fy < 0"), HasSubstr("Rectify the images")));
}

TEST_F(TumFolder, RefusesDistortionThatCannotBeInverted) {
  const std::vector<std::array<std::string, 3>> cases = {
      {"[0.1, 0, 0]", "plumb_bob", "camera_info.yaml: D has 3 coefficients"},
      {"[0.1, 0, 0, 0]", "fancy", "camera_info.yaml: distortion_model is 'fancy'"},
      {"[-3, 0, 0, 0]", "plumb_bob", "camera_info.yaml: D is not one to one"},
      {"[much]", "plumb_bob", "camera_info.yaml"},
  };
  for (const auto& [coefficients, model, expected] : cases) {
    writeText(file("camera_info.yaml"), distorted(cameraInfo(), coefficients, model));
    EXPECT_THAT(refusalOf(folder_.path()), HasSubstr(expected));
  }
}

// ---------------------------------------------------------------------------------------------------- 7-Scenes

class SevenScenesFolder : public testing::Test {
 protected:
  SevenScenesFolder() {
    for (const int number : {0, 3, 12}) {
      writeImage(file(stem(number) + ".depth.png"), static_cast<std::uint16_t>(1000 + number));
      writeText(file(stem(number) + ".pose.txt"), pose(number));
    }
    writeText(file("camera-intrinsics.txt"), "3.0e+01 0.0e+00 1.55e+01\n0 31 11.5\n0 0 1\n");
  }
  static std::string stem(int number) {
    char name[32];
    std::snprintf(name, sizeof(name), "frame-%06d", number);
    return name;
  }
  static std::string pose(double x) { return "0 -1 0 " + std::to_string(x) + "\n1 0 0 2\n0 0 1 3\n0 0 0 1\n"; }
  std::string file(const std::string& name) const { return folder_.file(name); }

  TemporaryFolder folder_;
};

TEST_F(SevenScenesFolder, GivesFramesInOrderOfTheirNumbers) {
  const auto sequence = openDepthSequence(folder_.path());
  ASSERT_EQ(sequence->size(), 3u);
  EXPECT_EQ(sequence->camera(), (CameraModel{kWidth, kHeight, 30, 31, 15.5, 11.5}));
  SkipReason reason;
  const auto frame = sequence->frame(2, &reason);
  ASSERT_TRUE(frame);
  EXPECT_FLOAT_EQ(frame->image.at(5, 5), 1.012f);
  EXPECT_EQ(frame->image.at(0, 0), 0.0f);
  EXPECT_EQ(frame->image.at(1, 2), 0.0f);
  EXPECT_NEAR(frame->stamp_s, 12.0 / 30.0, 1e-12);
  EXPECT_EQ(frame->T_map_camera.translation(), Eigen::Vector3d(12, 2, 3));
  EXPECT_NEAR((frame->T_map_camera.linear() * Eigen::Vector3d::UnitX() - Eigen::Vector3d::UnitY()).norm(), 0, 1e-12);
}

TEST_F(SevenScenesFolder, UnitsCanBeGiven) {
  SkipReason reason;
  EXPECT_FLOAT_EQ(openDepthSequence(folder_.path(), 10000.0)->frame(2, &reason)->image.at(5, 5), 0.1012f);
}

TEST_F(SevenScenesFolder, StraightensARotationThatIsSlightlyOff) {
  writeText(file(stem(3) + ".pose.txt"), "0 -1.001 0 1\n0.999 0 0.0005 2\n0 0 1 3\n0 0 0 1\n");
  SkipReason reason;
  const Eigen::Matrix3d R = openDepthSequence(folder_.path())->frame(1, &reason)->T_map_camera.linear();
  EXPECT_NEAR((R.transpose() * R - Eigen::Matrix3d::Identity()).norm(), 0.0, 1e-12);
  EXPECT_NEAR(R.determinant(), 1.0, 1e-12);
  EXPECT_NEAR(R(1, 0), 1.0, 1e-6);
}

TEST_F(SevenScenesFolder, SkipsFramesWithoutPoseFile) {
  fs::remove(file(stem(3) + ".pose.txt"));
  const auto sequence = openDepthSequence(folder_.path());
  ASSERT_EQ(sequence->size(), 3u);
  SkipReason reason;
  EXPECT_FALSE(sequence->frame(1, &reason));
  EXPECT_EQ(reason.kind, "no pose file");
  EXPECT_THAT(reason.detail, HasSubstr("frame-000003.pose.txt"));
  EXPECT_TRUE(sequence->frame(2, &reason));
}

TEST_F(SevenScenesFolder, RefusesWhatIsNoPose) {
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"1 0 0 0\n0 1 0 0\n0 0 -1 0\n0 0 0 1\n", "is no rotation"},  // a mirror
      {"2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n", "is no rotation"},
      {"0 0 0 0\n0 0 0 0\n0 0 0 0\n0 0 0 1\n", "is no rotation"},
      {"1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 1 1\n", "last row must be 0 0 0 1"},
      {"1 0 0 0\n0 1 0 0\n0 0 1 0\n", "has 3 rows, must have 4"},
      {"1 0 0 0\n0 1 0\n0 0 1 0\n0 0 0 1\n", "pose.txt:2: has 3 entries, must have 4"},
      {"1 0 0 -inf\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "pose.txt:1: '-inf' is not a finite number"},
      {"1 0 0 x\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "pose.txt:1: 'x'"},
  };
  for (const auto& [text, expected] : cases) {
    writeText(file(stem(3) + ".pose.txt"), text);
    EXPECT_THAT(refusalOf(folder_.path()), HasSubstr(expected));
  }
}

TEST_F(SevenScenesFolder, RefusesWrongIntrinsicsAndImages) {
  writeText(file("camera-intrinsics.txt"), "30 0 15.5\n0 31 11.5\n");
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("has 2 rows, must have 3"));
  writeText(file("camera-intrinsics.txt"), "0 0 15.5\n0 31 11.5\n0 0 1\n");
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("camera fx = 0"));
  writeText(file("camera-intrinsics.txt"), "30 1 15.5\n0 31 11.5\n0 0 1\n");
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("must be fx 0 cx"));
  fs::remove(file("camera-intrinsics.txt"));
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("camera-intrinsics.txt: is missing"));
  writeText(file("camera-intrinsics.txt"), "30 0 15.5\n0 31 11.5\n0 0 1\n");
  writeImage(file(stem(12) + ".depth.png"), 1, kWidth + 2);
  EXPECT_THAT(refusalOf(folder_.path()), HasSubstr("frame-000012.depth.png: image is 34 x 24 px"));
}

TEST(DepthSequence, RefusesWhatIsNoRecording) {
  const TemporaryFolder folder;
  EXPECT_THAT(refusalOf(folder.path()), testing::AllOf(HasSubstr("TUM RGB-D"), HasSubstr("7-Scenes")));
  EXPECT_THAT(refusalOf(folder.file("none")), HasSubstr("no such file or folder"));
  writeText(folder.file("a.txt"), "");
  EXPECT_THAT(refusalOf(folder.file("a.txt")), HasSubstr("is not a folder"));
}

}  // namespace
}  // namespace gpis_mapping
