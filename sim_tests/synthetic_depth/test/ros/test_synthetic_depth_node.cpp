// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <set>

#include <gtest/gtest.h>
#include <interactive_mapping_common/testing/shipped_file.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <tf2_msgs/TFMessage.h>

#include "synthetic_depth/scene_loader.h"
#include "synthetic_depth/sensor.h"
#include "synthetic_depth_ros/synthetic_depth_publisher.h"

namespace synthetic_depth_ros {
namespace {

/// Serves callbacks until the condition holds; false if it does not within the time.
bool waitUntil(const std::function<bool()>& condition, double timeout_s = 20.0) {
  const ros::WallTime deadline = ros::WallTime::now() + ros::WallDuration(timeout_s);
  while (ros::ok() && ros::WallTime::now() < deadline) {
    if (condition()) {
      return true;
    }
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.05));
  }
  return condition();
}

synthetic_depth::Scene testScene() {
  return synthetic_depth::loadScene(ros::NodeHandle("~").param<std::string>("scene_file", ""));
}

/// Everything one node publishes, by stamp.
class Recorder {
 public:
  Recorder(const std::string& name_space, const std::string& camera_frame) {
    ros::NodeHandle nh(name_space);
    tf_ =
        nh.subscribe<tf2_msgs::TFMessage>("/tf", 100, [this, camera_frame](const tf2_msgs::TFMessageConstPtr& message) {
          for (const geometry_msgs::TransformStamped& transform : message->transforms) {
            if (transform.child_frame_id == camera_frame) {
              transforms[transform.header.stamp] = transform;
            }
          }
        });
    clock_ = nh.subscribe<rosgraph_msgs::Clock>(
        "/clock", 100, [this](const rosgraph_msgs::ClockConstPtr& message) { clocks.insert(message->clock); });
    info_ = nh.subscribe<sensor_msgs::CameraInfo>(
        "depth/camera_info", 100,
        [this](const sensor_msgs::CameraInfoConstPtr& message) { infos[message->header.stamp] = message; });
    // The node starts once image and info have a subscriber: everything else must be connected by then.
    EXPECT_TRUE(waitUntil([this] { return tf_.getNumPublishers() >= 3 && clock_.getNumPublishers() >= 1; }));
    image_ = nh.subscribe<sensor_msgs::Image>(
        "depth/image_rect", 100,
        [this](const sensor_msgs::ImageConstPtr& message) { images[message->header.stamp] = message; });
  }

  /// Stamps for which image, info and transform are all there.
  std::vector<ros::Time> completeStamps() const {
    std::vector<ros::Time> stamps;
    for (const auto& [stamp, image] : images) {
      if (infos.count(stamp) != 0 && transforms.count(stamp) != 0) {
        stamps.push_back(stamp);
      }
    }
    return stamps;
  }

  std::map<ros::Time, sensor_msgs::ImageConstPtr> images;
  std::map<ros::Time, sensor_msgs::CameraInfoConstPtr> infos;
  std::map<ros::Time, geometry_msgs::TransformStamped> transforms;
  std::set<ros::Time> clocks;

 private:
  ros::Subscriber tf_, clock_, info_, image_;
};

Eigen::Isometry3d toPose(const geometry_msgs::Transform& transform) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() =
      Eigen::Quaterniond(transform.rotation.w, transform.rotation.x, transform.rotation.y, transform.rotation.z)
          .toRotationMatrix();
  pose.translation() << transform.translation.x, transform.translation.y, transform.translation.z;
  return pose;
}

/// The frame of the scene with this camera pose, -1 if none.
int frameOfPose(const synthetic_depth::Scene& scene, const Eigen::Isometry3d& T_map_camera) {
  for (int frame = 0; frame < scene.numFrames(); ++frame) {
    if (T_map_camera.isApprox(scene.cameraInMap(frame), 1e-9)) {
      return frame;
    }
  }
  return -1;
}

TEST(SyntheticDepthNode, PublishesImageInfoAndTransformWithTheSameStamp) {
  const synthetic_depth::Scene scene = testScene();
  Recorder recorder("metric", "metric_optical_frame");
  ASSERT_TRUE(waitUntil([&] { return recorder.completeStamps().size() >= 6; }))
      << "more frames than the scene has: it loops";
  std::set<int> frames;
  for (const ros::Time& stamp : recorder.completeStamps()) {
    const sensor_msgs::Image& image = *recorder.images[stamp];
    const sensor_msgs::CameraInfo& info = *recorder.infos[stamp];
    EXPECT_EQ(image.header.frame_id, "metric_optical_frame");
    EXPECT_EQ(info.header.frame_id, "metric_optical_frame");
    EXPECT_EQ(recorder.transforms[stamp].header.frame_id, "map");
    EXPECT_EQ(image.encoding, "32FC1");
    EXPECT_EQ(info.width, 80U);
    EXPECT_EQ(info.height, 60U);
    EXPECT_EQ(info.K[0], 70.0);
    EXPECT_EQ(info.P[6], 29.5);

    const int frame = frameOfPose(scene, toPose(recorder.transforms[stamp].transform));
    ASSERT_GE(frame, 0) << "pose is none of the scene's";
    frames.insert(frame);
    const cv::Mat expected = synthetic_depth::measureDepth(scene, frame);
    ASSERT_EQ(image.data.size(), expected.total() * sizeof(float));
    EXPECT_EQ(std::memcmp(image.data.data(), expected.data, image.data.size()), 0) << "frame " << frame;
  }
  EXPECT_EQ(frames.size(), 4U);
}

TEST(SyntheticDepthNode, PublishesMillimetresAndClockOnceThroughIfAsked) {
  synthetic_depth::Scene scene = testScene();
  scene.sensor = scene.sensor.withoutNoise();
  Recorder recorder("raw", "raw_optical_frame");
  ASSERT_TRUE(waitUntil([&] { return recorder.completeStamps().size() == 4 && recorder.clocks.size() == 4; }));
  int frame = 0;
  for (const ros::Time& stamp : recorder.completeStamps()) {
    EXPECT_NEAR(stamp.toSec(), scene.stampSeconds(frame), 1e-6);
    EXPECT_EQ(recorder.clocks.count(stamp), 1U);
    EXPECT_EQ(recorder.transforms[stamp].header.frame_id, "world");
    EXPECT_EQ(frameOfPose(scene, toPose(recorder.transforms[stamp].transform)), frame);
    const sensor_msgs::Image& image = *recorder.images[stamp];
    EXPECT_EQ(image.encoding, "16UC1");
    const cv::Mat expected = synthetic_depth::encodeDepth16(synthetic_depth::measureDepth(scene, frame), 1000.0);
    ASSERT_EQ(image.data.size(), expected.total() * sizeof(std::uint16_t));
    EXPECT_EQ(std::memcmp(image.data.data(), expected.data, image.data.size()), 0) << "frame " << frame;
    ++frame;
  }
}

TEST(SyntheticDepthNode, PublishesOnlyTheFramesAskedFor) {
  const synthetic_depth::Scene scene = testScene();
  Recorder recorder("part", "part_optical_frame");
  // The publisher goes on offering its topics after its last frame: what would come too much could still come.
  ASSERT_TRUE(waitUntil([&] { return recorder.completeStamps().size() >= 2; }));
  EXPECT_FALSE(waitUntil([&] { return recorder.images.size() > 2; }, 0.5)) << "15 frames could have come since";
  ASSERT_EQ(recorder.completeStamps().size(), 2U);
  int frame = 1;
  for (const ros::Time& stamp : recorder.completeStamps()) {
    EXPECT_EQ(frameOfPose(scene, toPose(recorder.transforms[stamp].transform)), frame);
    ++frame;
  }
}

TEST(SyntheticDepthNode, RefusesFramesThatTheSceneHasNot) {
  PublisherParams params;
  params.scene_file = ros::NodeHandle("~").param<std::string>("scene_file", "");
  params.last_frame = 4;  // of 0 to 3
  EXPECT_THROW(SyntheticDepthPublisher(ros::NodeHandle("refused"), params), std::invalid_argument);
  params.first_frame = 3;
  params.last_frame = 2;
  EXPECT_THROW(SyntheticDepthPublisher(ros::NodeHandle("refused"), params), std::invalid_argument);
  params.last_frame = 3;
  EXPECT_NO_THROW(SyntheticDepthPublisher(ros::NodeHandle("refused"), params));
}

/// The message with which a set of private parameters is refused, or "accepted".
std::string refusal(const std::function<void(ros::NodeHandle&)>& set_params) {
  ros::NodeHandle nh("~candidate");
  nh.deleteParam(nh.getNamespace());
  nh.setParam("scene_file", "scene.yaml");
  set_params(nh);
  try {
    loadPublisherParams(nh);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

TEST(PublisherParams, ShippedFileIsWhatTheFieldsSay) {
  test_support::expectShippedFile<PublisherParams>(SYNTHETIC_DEPTH_DIR "/config/synthetic_depth.yaml");
}

TEST(PublisherParams, WhatIsNotGivenKeepsItsDefault) {
  ros::NodeHandle nh("~candidate");
  nh.deleteParam(nh.getNamespace());
  PublisherParams expected;
  expected.scene_file = "scene.yaml";
  expected.rate_hz = 5.0;
  nh.setParam("scene_file", "scene.yaml");
  nh.setParam("rate_hz", 5);  // an integer will do
  EXPECT_EQ(interactive_mapping::toYaml(loadPublisherParams(nh)), interactive_mapping::toYaml(expected));
}

TEST(PublisherParams, RefuseUnknownKeysWrongTypesAndBadValuesByName) {
  using Nh = ros::NodeHandle;
  const std::vector<std::pair<std::function<void(Nh&)>, std::string>> cases{
      {[](Nh& nh) { nh.deleteParam("scene_file"); }, "candidate/scene_file = '', must be"},
      {[](Nh& nh) { nh.setParam("scene", "a"); }, "candidate/scene is unknown"},
      {[](Nh& nh) { nh.setParam("rate_hz", "fast"); }, "candidate/rate_hz"},
      {[](Nh& nh) { nh.setParam("rate_hz", -1.0); }, "candidate/rate_hz = -1 Hz, must be in [0, 1000] Hz"},
      {[](Nh& nh) { nh.setParam("encoding", "mono8"); }, "candidate/encoding = 'mono8', must be 32FC1 or 16UC1"},
      {[](Nh& nh) { nh.setParam("loop", "yes"); }, "candidate/loop"},
      {[](Nh& nh) { nh.setParam("loop", 1); }, "candidate/loop"},
      {[](Nh& nh) { nh.setParam("seed", -2); }, "candidate/seed = -2"},
      {[](Nh& nh) { nh.setParam("first_frame", -1); }, "candidate/first_frame = -1, must be in [0, "},
      {[](Nh& nh) { nh.setParam("last_frame", -2); }, "candidate/last_frame = -2, must be in [-1, "},
      {[](Nh& nh) { nh.setParam("map_frame", "/map"); }, "candidate/map_frame = '/map"},
      {[](Nh& nh) { nh.setParam("camera_frame", "map"); }, "candidate/camera_frame = 'map"},
  };
  for (const auto& [set_params, expected] : cases) {
    const std::string message = refusal(set_params);
    EXPECT_NE(message.find(expected), std::string::npos) << "expected: " << expected << "\nis: " << message;
  }
  const std::string both = refusal([](Nh& nh) {
    nh.setParam("rate_hz", -1.0);
    nh.setParam("scene", "a");
  });
  EXPECT_NE(both.find("rate_hz"), std::string::npos);
  EXPECT_NE(both.find("scene is unknown"), std::string::npos);
}

}  // namespace
}  // namespace synthetic_depth_ros
