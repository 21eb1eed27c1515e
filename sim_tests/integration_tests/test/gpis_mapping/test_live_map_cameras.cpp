// SPDX-License-Identifier: BSD-3-Clause
// Two cameras, one map: images of both are taken in, what either sees past leaves, each one's faults are its own.
#include "live_map.h"

namespace integration_tests {
namespace {

constexpr double kStep_s = 0.1;
constexpr int kRemovalFrame = 2;  // the first without the box

/// Even frames are the first camera's, odd ones the second's, which sees the other sides of the box.
Scene oneBox() {
  Scene scene = synthetic_depth::test::makeLooks(
      {{0.6, 0.6, 0.6}, {-0.6, -0.6, 0.6}, {0.6, 0.6, 0.6}, {-0.6, -0.6, 0.6}}, {0.0, 0.0, 0.05});
  scene.camera = tinyCamera();
  scene.boxes = {synthetic_depth::test::makeBox(0, {0.0, 0.0, 0.08}, {0.08, 0.10, 0.08}, {0.0, 0.0, 0.3})};
  scene.boxes[0].vanishes_at_frame = kRemovalFrame;
  return scene;
}

class LiveMapCameras : public testing::Test {
 protected:
  void SetUp() override {
    ros::NodeHandle nh;
    rear_image_ = nh.advertise<sensor_msgs::Image>("/pair_in/rear/image_rect", 10);
    rear_info_ = nh.advertise<sensor_msgs::CameraInfo>("/pair_in/rear/camera_info", 10, true);
    ASSERT_TRUE(live_.connect());
    ASSERT_TRUE(live_.clear());
    ASSERT_TRUE(waitUntil([&] { return rear_image_.getNumSubscribers() > 0 && rear_info_.getNumSubscribers() > 0; }));
    // As in LiveMap::connect(): until an image arrives.
    sensor_msgs::Image probe;
    probe.encoding = "probe";
    probe.header.frame_id = "rear_depth_optical_frame";
    const std::size_t before = live_.updates.size();
    ASSERT_TRUE(waitUntil([&] {
      probe.header.stamp = live_.nextStamp(0.01);
      rear_image_.publish(probe);
      return waitUntil([&] { return live_.updates.size() > before; }, 1.0);
    }));
  }

  LiveFrame frameAt(int frame, const ros::Time& stamp, bool is_rear) {
    LiveFrame live = toLiveFrame(scene_, frame);
    live.setStamp(stamp);
    if (is_rear) live.setCameraFrame("rear_depth_optical_frame");
    return live;
  }

  /// What becomes of an image of the second camera.
  MapUpdate lookRear(const LiveFrame& frame) {
    const std::size_t since = live_.updates.size();
    live_.publish(frame.transform);
    rear_info_.publish(frame.info);
    rear_image_.publish(frame.image);
    EXPECT_TRUE(waitUntil([&] { return live_.updates.size() > since; }));
    return live_.updates.size() > since ? live_.updates.back() : MapUpdate();
  }

  double distanceToTop() { return live_.ask(Eigen::Matrix3Xd(top_)).euclidean_distance.at(0); }

  const Scene scene_ = oneBox();
  const Eigen::Vector3d top_ = scene_.T_map_scene * Eigen::Vector3d(0.0, 0.0, 0.16);
  LiveMap live_{"/pair"};
  ros::Publisher rear_image_, rear_info_;
};

TEST_F(LiveMapCameras, BothFillOneMapAndEitherForgets) {
  ros::Time stamp;
  for (int i = 0; i < 3; ++i) {
    stamp = live_.nextStamp(kStep_s);
    const MapUpdate front = live_.look(frameAt(0, stamp, false));
    ASSERT_EQ(static_cast<int>(front.status), MapUpdate::ACCEPTED) << front.message;
    // At the same time, and once a little before.
    const MapUpdate rear = lookRear(frameAt(1, stamp - ros::Duration(i == 2 ? 0.03 : 0.0), true));
    ASSERT_EQ(static_cast<int>(rear.status), MapUpdate::ACCEPTED) << rear.message;
    EXPECT_EQ(rear.update, front.update + 1);
    EXPECT_TRUE(i > 0 || rear.inserted > 100u) << "the sides that the first does not see";
  }
  EXPECT_LT(distanceToTop(), 0.01);
  EXPECT_EQ(live_.ask(Eigen::Matrix3Xd(top_)).header.stamp, stamp) << "the newest, although it came first";
  const MapUpdate forgot = lookRear(frameAt(3, live_.nextStamp(kStep_s), true));
  EXPECT_GT(forgot.deleted, 50u);
  EXPECT_GT(distanceToTop(), 0.1);
}

TEST_F(LiveMapCameras, FaultsOfOneAreCountedAsItsOwnAndLeaveTheOther) {
  LiveFrame bad = frameAt(1, live_.nextStamp(kStep_s), true);
  bad.image.height /= 2;
  bad.image.data.resize(bad.image.data.size() / 2);
  for (int i = 0; i < 3; ++i) {
    bad.setStamp(live_.nextStamp(kStep_s));
    EXPECT_EQ(static_cast<int>(lookRear(bad).status), MapUpdate::SIZE_MISMATCH);
  }
  EXPECT_EQ(static_cast<int>(live_.look(frameAt(0, live_.nextStamp(kStep_s), false)).status), MapUpdate::ACCEPTED);
  EXPECT_TRUE(
      waitUntil([&] { return live_.diagnosticValue("input 2", "left out: size differs from camera info") == "3"; }));
  EXPECT_EQ(live_.diagnosticValue("input", "left out: size differs from camera info"), "0");
  EXPECT_EQ(live_.diagnosticValue("input 2", "image topic"), "/pair_in/rear/image_rect");
  EXPECT_EQ(live_.diagnosticValue("input 2", "camera info topic"), "/pair_in/rear/camera_info");
}

}  // namespace
}  // namespace integration_tests
