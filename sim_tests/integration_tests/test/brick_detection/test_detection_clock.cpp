// SPDX-License-Identifier: BSD-3-Clause
// Calls of ~detect end by ROS time, and also when that stands still or runs back.
#include <future>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include <interactive_mapping_msgs/BrickDetectionUpdate.h>
#include <interactive_mapping_msgs/DetectBricks.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <tf2_ros/static_transform_broadcaster.h>

namespace integration_tests {
namespace {

using node_tests::call;
using node_tests::waitUntil;

using interactive_mapping_msgs::DetectBricks;

class DetectionClock : public testing::Test {
 protected:
  void SetUp() override {
    clock_ = ros::NodeHandle().advertise<rosgraph_msgs::Clock>("/clock", 10, true);
    ASSERT_TRUE(waitUntil([] { return ros::service::exists("/brick_detection/detect", false); }));
    ASSERT_TRUE(waitUntil([this] { return clock_.getNumSubscribers() >= 2; }));  // the node, and this one
    diagnostics_ = ros::NodeHandle().subscribe<diagnostic_msgs::DiagnosticArray>(
        "/diagnostics", 100, [this](const diagnostic_msgs::DiagnosticArrayConstPtr& message) {
          for (const diagnostic_msgs::DiagnosticStatus& status : message->status) {
            for (const diagnostic_msgs::KeyValue& value : status.values) {
              if (value.key == "calls of ~detect that wait") calls_ = value.value;
            }
          }
        });
    show(next_s_);
    EXPECT_TRUE(waitUntil([this] { return calls_ == "0"; }));
    next_s_ += 100.0;
  }

  void show(double time_s) {
    rosgraph_msgs::Clock message;
    message.clock = ros::Time(time_s);
    clock_.publish(message);
    EXPECT_TRUE(waitUntil([&] { return ros::Time::now() == message.clock; }));
  }

  static std::future<DetectBricks::Response> detectLater(double timeout_s) {
    return std::async(std::launch::async, [timeout_s] {
      DetectBricks service;
      service.request.timeout = ros::Duration(timeout_s);
      EXPECT_TRUE(call("/brick_detection/detect", service));
      return service.response;
    });
  }

  static bool isReady(const std::future<DetectBricks::Response>& answer) {
    return answer.wait_for(std::chrono::milliseconds(10)) == std::future_status::ready;
  }

  bool isCallThere() const { return calls_ != "0"; }

  ros::Publisher clock_;
  ros::Subscriber diagnostics_;
  std::string calls_;  // of ~detect that wait, as the diagnostics say
  static double next_s_;
};
double DetectionClock::next_s_ = 1000.0;

TEST_F(DetectionClock, EndsWhenItStandsStill) {
  const ros::WallTime called = ros::WallTime::now();
  std::future<DetectBricks::Response> answer = detectLater(1.0);
  EXPECT_TRUE(waitUntil([&] { return isReady(answer); }));
  const DetectBricks::Response response = answer.get();
  EXPECT_EQ(static_cast<int>(response.status), DetectBricks::Response::NO_IMAGE);
  EXPECT_NE(response.message.find("the clock has stood still for 0.5 s"), std::string::npos) << response.message;
  EXPECT_GE((ros::WallTime::now() - called).toSec(), 0.5);
}

TEST_F(DetectionClock, IsWaitedForWhileItRuns) {
  double now_s = next_s_;
  show(now_s);
  std::future<DetectBricks::Response> answer = detectLater(20.0);
  // Slowly for longer than the 0.5 s of wall time that a standstill may last; then beyond the end at once.
  const ros::WallTime until = ros::WallTime::now() + ros::WallDuration(0.8);
  while (ros::WallTime::now() < until) {
    now_s += 0.01;
    show(now_s);
    EXPECT_FALSE(isReady(answer));
  }
  show(next_s_ + 40.0);
  EXPECT_TRUE(waitUntil([&] { return isReady(answer); }));
  const DetectBricks::Response response = answer.get();
  EXPECT_EQ(static_cast<int>(response.status), DetectBricks::Response::NO_IMAGE);
  EXPECT_NE(response.message.find("within 20.000 s"), std::string::npos) << response.message;
}

TEST_F(DetectionClock, EndsWhenItRunsBack) {
  double now_s = next_s_;
  show(now_s);
  std::future<DetectBricks::Response> answer = detectLater(50.0);
  // On, so that it does not end for a standstill, until the call is there.
  while (!isCallThere()) {
    now_s += 0.01;
    show(now_s);
    ASSERT_FALSE(isReady(answer));
  }
  show(5.0);
  EXPECT_TRUE(waitUntil([&] { return isReady(answer); }));
  const DetectBricks::Response response = answer.get();
  EXPECT_EQ(static_cast<int>(response.status), DetectBricks::Response::NO_IMAGE);
  EXPECT_NE(response.message.find("ran back"), std::string::npos) << response.message;
}

// An empty room, which is a look as good as any.
void publishImage(const ros::Publisher& images, const ros::Publisher& infos, double stamp_s) {
  sensor_msgs::CameraInfo info;
  info.header.frame_id = "camera";
  info.header.stamp = ros::Time(stamp_s);
  info.width = 64;
  info.height = 48;
  info.K = {60.0, 0.0, 31.5, 0.0, 60.0, 23.5, 0.0, 0.0, 1.0};
  info.R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  info.P = {60.0, 0.0, 31.5, 0.0, 0.0, 60.0, 23.5, 0.0, 0.0, 0.0, 1.0, 0.0};
  infos.publish(info);
  sensor_msgs::Image image;
  image.header = info.header;
  image.width = 64;
  image.height = 48;
  image.step = 64;
  image.encoding = "mono8";
  image.data.assign(64 * 48, 128);
  images.publish(image);
}

// A restarted simulation: looks of before carry later stamps than the call, and are no answer.
TEST_F(DetectionClock, LooksOfBeforeItRanBackAreNoAnswer) {
  using interactive_mapping_msgs::BrickDetectionUpdate;
  tf2_ros::StaticTransformBroadcaster tf;
  geometry_msgs::TransformStamped T_map_camera;
  T_map_camera.header.frame_id = "map";
  T_map_camera.child_frame_id = "camera";
  T_map_camera.transform.rotation.w = 1.0;
  tf.sendTransform(T_map_camera);
  const ros::Publisher images =
      ros::NodeHandle().advertise<sensor_msgs::Image>("/brick_detection_in/color/image_raw", 1);
  const ros::Publisher infos =
      ros::NodeHandle().advertise<sensor_msgs::CameraInfo>("/brick_detection_in/color/camera_info", 1);
  bool is_accepted = false;
  const ros::Subscriber updates = ros::NodeHandle().subscribe<BrickDetectionUpdate>(
      "/brick_detection/update", 10, [&](const boost::shared_ptr<const BrickDetectionUpdate>& update) {
        is_accepted |= update->status == BrickDetectionUpdate::ACCEPTED;
      });
  ASSERT_TRUE(waitUntil([&] {
    return images.getNumSubscribers() > 0 && infos.getNumSubscribers() > 0 && updates.getNumPublishers() > 0;
  }));
  double now_s = next_s_;
  ASSERT_TRUE(waitUntil([&] {
    now_s += 0.1;
    show(now_s);
    publishImage(images, infos, now_s);
    return is_accepted;
  }));
  show(20.0);
  std::future<DetectBricks::Response> answer = detectLater(1.0);
  EXPECT_TRUE(waitUntil([&] { return isReady(answer); }));
  const DetectBricks::Response response = answer.get();
  // One that was under way may be told as refused.
  EXPECT_NE(static_cast<int>(response.status), DetectBricks::Response::OK)
      << "look of " << response.update.header.stamp << ", " << response.message;
}

}  // namespace
}  // namespace integration_tests
