// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/tum_sequence.h"

#include <cmath>
#include <cstring>
#include <fstream>
#include <stdexcept>

#include <boost/filesystem.hpp>
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>
#include <yaml-cpp/yaml.h>

#include "synthetic_depth/scene_loader.h"
#include "synthetic_depth/sensor.h"
#include "synthetic_depth/testing/random_scene.h"

namespace synthetic_depth {
namespace {

class TumSequence : public testing::Test {
 protected:
  TumSequence()
      : directory_(boost::filesystem::temp_directory_path() / boost::filesystem::unique_path("tum_%%%%%%%%")) {
    scene_ = test::makeRandomScene(7, 6, true);
    scene_.boxes[2].vanishes_at_frame = 1;
    scene_.sensor.min_range_m = 0.3;
    scene_.sensor.max_range_m = 2.5;
    scene_.sensor.axial_noise_a_m = 0.002;
    scene_.sensor.dropout_probability = 0.05;
  }
  ~TumSequence() override { boost::filesystem::remove_all(directory_); }

  std::string path(const std::string& name) const { return (directory_ / name).string(); }

  boost::filesystem::path directory_;
  Scene scene_;
};

TEST_F(TumSequence, ReadsBackStampsPosesAndDepth) {
  const SequenceStatistics statistics = writeTumSequence(scene_, directory_.string(), {});
  EXPECT_EQ(statistics.num_frames, 3);
  const std::vector<TumFrame> frames = readTumSequence(directory_.string());
  ASSERT_EQ(frames.size(), 3U);
  double num_valid = 0.0;
  for (int k = 0; k < 3; ++k) {
    const TumFrame& frame = frames[static_cast<std::size_t>(k)];
    EXPECT_NEAR(frame.stamp_s, scene_.stampSeconds(k), 1e-6);
    // Nine decimals of position and quaternion.
    EXPECT_LT((frame.T_map_camera.matrix() - scene_.cameraInMap(k).matrix()).cwiseAbs().maxCoeff(), 1e-8);
    const cv::Mat expected = measureDepth(scene_, k);
    const cv::Mat depth = readTumDepth(frame.depth_path);
    ASSERT_EQ(depth.size(), expected.size());
    for (int v = 0; v < depth.rows; ++v) {
      for (int u = 0; u < depth.cols; ++u) {
        const float z = expected.at<float>(v, u);
        ASSERT_EQ(std::isfinite(z), std::isfinite(depth.at<float>(v, u)));
        if (std::isfinite(z)) {
          num_valid += 1.0;
          ASSERT_NEAR(depth.at<float>(v, u), z, 0.5 / kTumUnitsPerMetre + 1e-6);
        }
      }
    }
  }
  EXPECT_NEAR(statistics.valid_fraction, num_valid / (3.0 * 160.0 * 120.0), 1e-9);
}

TEST_F(TumSequence, FilesHaveTheDocumentedLayout) {
  writeTumSequence(scene_, directory_.string(), {});
  const cv::Mat png = cv::imread(path("depth/000002.png"), cv::IMREAD_UNCHANGED);
  EXPECT_EQ(png.type(), CV_16UC1);
  std::ifstream list(path("depth.txt"));
  std::string comment;
  std::string line;
  std::getline(list, comment);
  std::getline(list, line);
  EXPECT_EQ(comment[0], '#');
  EXPECT_EQ(line, "1000.000000 depth/000000.png");

  const YAML::Node info = YAML::LoadFile(path("camera_info.yaml"));
  EXPECT_EQ(info["image_width"].as<int>(), 160);
  EXPECT_EQ(info["image_height"].as<int>(), 120);
  EXPECT_EQ(info["depth_units_per_metre"].as<double>(), 5000.0);
  EXPECT_EQ(info["camera_matrix"]["data"].size(), 9U);
  EXPECT_EQ(info["camera_matrix"]["data"][4].as<double>(), 135.0);
  EXPECT_EQ(info["projection_matrix"]["data"].size(), 12U);
  EXPECT_EQ(info["projection_matrix"]["data"][5].as<double>(), 135.0);
  EXPECT_EQ(info["distortion_coefficients"]["data"].size(), 5U);
  EXPECT_EQ(info["rectification_matrix"]["data"].size(), 9U);

  const YAML::Node truth = YAML::LoadFile(path("ground_truth.yaml"));
  EXPECT_EQ(truth["removed_ids"].as<std::vector<int>>(), std::vector<int>{2});
  EXPECT_EQ(truth["removal_frame"].as<int>(), 1);
  ASSERT_EQ(truth["boxes"].size(), scene_.boxes.size());
  for (std::size_t i = 0; i < scene_.boxes.size(); ++i) {
    const YAML::Node box = truth["boxes"][i];
    EXPECT_EQ(box["id"].as<int>(), scene_.boxes[i].id);
    const auto xyz = box["xyz_m"].as<std::vector<double>>();
    const auto q = box["quaternion_xyzw"].as<std::vector<double>>();
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.linear() = Eigen::Quaterniond(q[3], q[0], q[1], q[2]).toRotationMatrix();
    pose.translation() << xyz[0], xyz[1], xyz[2];
    EXPECT_TRUE(pose.isApprox(scene_.boxes[i].T_scene_box, 1e-12));
  }
}

TEST_F(TumSequence, WithoutSensorIsExactWithinTheRange) {
  SequenceOptions options;
  options.apply_sensor = false;
  options.num_frames = 1;
  writeTumSequence(scene_, directory_.string(), options);
  const std::vector<TumFrame> frames = readTumSequence(directory_.string());
  ASSERT_EQ(frames.size(), 1U);
  Scene clean = scene_;
  clean.sensor = scene_.sensor.withoutNoise();
  const cv::Mat expected = encodeDepth16(measureDepth(clean, 0), kTumUnitsPerMetre);
  EXPECT_EQ(cv::countNonZero(cv::imread(frames[0].depth_path, cv::IMREAD_UNCHANGED) != expected), 0);
}

TEST_F(TumSequence, RawFilesHoldFloatDepthAndPoses) {
  SequenceOptions options;
  options.write_raw = true;
  writeTumSequence(scene_, directory_.string(), options);
  ASSERT_EQ(boost::filesystem::file_size(path("frames.f32")), 3U * 160U * 120U * 4U);
  ASSERT_EQ(boost::filesystem::file_size(path("poses.f64")), 3U * 16U * 8U);
  std::ifstream raw(path("frames.f32"), std::ios::binary);
  raw.seekg(2 * 160 * 120 * 4);
  cv::Mat last(120, 160, CV_32FC1);
  raw.read(reinterpret_cast<char*>(last.data), 160 * 120 * 4);
  EXPECT_EQ(std::memcmp(last.data, measureDepth(scene_, 2).data, 160 * 120 * 4), 0);
}

TEST_F(TumSequence, ReportsProgressOncePerFrame) {
  SequenceOptions options;
  std::vector<int> done;
  options.on_progress = [&done](int count, int total) {
    EXPECT_EQ(total, 3);
    done.push_back(count);
  };
  writeTumSequence(scene_, directory_.string(), options);
  EXPECT_EQ(done, (std::vector<int>{1, 2, 3}));
}

TEST_F(TumSequence, RefusesAFrameCountTheSceneHasNotAndAnUnwritableFolder) {
  SequenceOptions options;
  options.num_frames = 4;
  EXPECT_THROW(writeTumSequence(scene_, directory_.string(), options), std::invalid_argument);
  options.num_frames = 0;
  EXPECT_THROW(writeTumSequence(scene_, directory_.string(), options), std::invalid_argument);
  EXPECT_THROW(writeTumSequence(scene_, "/dev/null/sequence", {}), std::runtime_error);
}

TEST_F(TumSequence, ReadingRefusesMissingAndMalformedFiles) {
  EXPECT_THROW(readTumSequence(directory_.string()), std::runtime_error);
  writeTumSequence(scene_, directory_.string(), {});
  EXPECT_THROW(readTumDepth(path("depth/000099.png")), std::runtime_error);
  std::ofstream(path("groundtruth.txt")) << "1000.000000 0 0 0 0 0 0 1\n";
  EXPECT_THROW(readTumSequence(directory_.string()), std::runtime_error);  // poses of frames 1 and 2 are missing
  std::ofstream(path("groundtruth.txt")) << "1000.000000 0 0 zero 0 0 0 1\n";
  EXPECT_THROW(readTumSequence(directory_.string()), std::runtime_error);
}

}  // namespace
}  // namespace synthetic_depth
