// SPDX-License-Identifier: BSD-3-Clause
// Bad input: each image that cannot be used is refused with the reason, is counted, and leaves the map as it was.
#include <algorithm>
#include <array>
#include <limits>

#include "live_map.h"

namespace integration_tests {
namespace {

using Parts = std::vector<std::string>;

constexpr double kStep_s = 0.1;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

Scene oneBox() {
  Scene scene = synthetic_depth::test::makeLooks({{0.5, 0.6, 0.6}, {2.5, 0.6, 0.6}}, {0.0, 0.0, 0.05});
  scene.camera = tinyCamera();
  scene.boxes = {synthetic_depth::test::makeBox(0, {0.0, 0.0, 0.08}, {0.08, 0.10, 0.08}, {0.0, 0.0, 0.3})};
  // The second camera looks into the same direction, two metres aside.
  scene.T_scene_camera[1].linear() = scene.T_scene_camera[0].linear();
  return scene;
}

class LiveMapInput : public testing::Test {
 protected:
  void connect(const std::string& node) {
    live_ = std::make_unique<LiveMap>(node);
    ASSERT_TRUE(live_->connect());
    ASSERT_TRUE(live_->clear());
    expectGoodIsAccepted("to begin with");
  }

  LiveFrame good(int frame = 0) {
    LiveFrame live = toLiveFrame(scene_, frame);
    live.setStamp(live_->nextStamp(kStep_s));
    return live;
  }

  MapUpdate expectGoodIsAccepted(const std::string& after) {
    const MapUpdate update = live_->look(good());
    EXPECT_EQ(static_cast<int>(update.status), MapUpdate::ACCEPTED) << after << ": " << update.message;
    EXPECT_EQ(update.message, "");
    return update;
  }

  /// All that the map answers to points about the box, as bytes.
  std::vector<std::uint8_t> answers() {
    return bytesOf(
        live_->ask(synthetic_depth::test::randomPointsInMap(scene_, 5, 200, {-0.3, -0.3, -0.1}, {0.3, 0.3, 0.4})));
  }

  void expectRefused(const MapUpdate& update, int status, const Parts& parts) {
    EXPECT_EQ(static_cast<int>(update.status), status) << update.message;
    for (const std::string& part : parts) EXPECT_PRED2(has, update.message, part);
    ++expected_counts_[static_cast<std::size_t>(update.status)];
  }

  const Scene scene_ = oneBox();
  std::unique_ptr<LiveMap> live_;
  std::array<long, MapUpdate::NUM_STATUS + 1> expected_counts_{};
};

/// What is done to a good frame before it is published.
struct BadFrame {
  const char* name;
  std::function<void(LiveFrame*)> spoil;
  int status;
  Parts message;
};

/// Long: a table, one entry for each kind of bad frame.
std::vector<BadFrame> badFrames() {
  const auto fill = [](LiveFrame* frame, float value) {
    for (std::size_t i = 0; i < frame->image.data.size(); i += sizeof(value)) {
      std::memcpy(&frame->image.data[i], &value, sizeof(value));
    }
  };
  return {
      {"an encoding that is no depth",
       [](LiveFrame* frame) { frame->image.encoding = "bgr8"; },
       MapUpdate::WRONG_ENCODING,
       {"'bgr8'", "must be one of 16UC1 or mono16 (mm), 32FC1 (m)"}},
      {"an image larger than the camera info",
       [](LiveFrame* frame) {
         frame->image.width = 164;
         frame->image.step = 164 * 4;
         frame->image.data.resize(164 * 4 * 120);
       },
       MapUpdate::SIZE_MISMATCH,
       {"164 x 120 px", "160 x 120 px", "/guarded_in/depth/camera_info"}},
      {"a step too short",
       [](LiveFrame* frame) { frame->image.step = 600; },
       MapUpdate::MALFORMED_IMAGE,
       {"step 600", "160 x 120 px of 32FC1"}},
      {"data too short",
       [](LiveFrame* frame) { frame->image.data.resize(1000); },
       MapUpdate::MALFORMED_IMAGE,
       {"1000 bytes", "160 x 120 px of 32FC1"}},
      {"no data", [](LiveFrame* frame) { frame->image.data.clear(); }, MapUpdate::MALFORMED_IMAGE, {"0 bytes"}},
      {"no pixels",
       [](LiveFrame* frame) { frame->image.width = frame->image.height = 0; },
       MapUpdate::MALFORMED_IMAGE,
       {"0 x 0 px", "must be at least 1 x 1 px"}},
      {"a size that would need more memory than there is",
       [](LiveFrame* frame) { frame->image.width = frame->image.height = frame->image.step = 2000000000; },
       MapUpdate::MALFORMED_IMAGE,
       {"2000000000 x 2000000000 px"}},
      {"all NaN",
       [fill](LiveFrame* frame) { fill(frame, std::numeric_limits<float>::quiet_NaN()); },
       MapUpdate::NOTHING_MEASURED,
       {"none of 19200 pixels"}},
      {"all zero",
       [fill](LiveFrame* frame) { fill(frame, 0.0f); },
       MapUpdate::NOTHING_MEASURED,
       {"none of 19200 pixels"}},
      {"all below zero",
       [fill](LiveFrame* frame) { fill(frame, -1.0f); },
       MapUpdate::NOTHING_MEASURED,
       {"none of 19200 pixels"}},
      {"no stamp",
       [](LiveFrame* frame) { frame->image.header.stamp = ros::Time(); },
       MapUpdate::MALFORMED_IMAGE,
       {"stamp is 0", "must be the time of exposure"}},
      {"no frame",
       [](LiveFrame* frame) { frame->image.header.frame_id = ""; },
       MapUpdate::MALFORMED_IMAGE,
       {"frame_id is empty", "camera_frame"}},
      {"the map's own frame",
       [](LiveFrame* frame) { frame->image.header.frame_id = "map"; },
       MapUpdate::MALFORMED_IMAGE,
       {"frame_id 'map' is the map's frame"}},
      {"the last stamp there is",
       [](LiveFrame* frame) { frame->image.header.stamp = frame->info.header.stamp = ros::Time(0xFFFFFFFFu, 0); },
       MapUpdate::STAMP_IN_FUTURE,
       {"ahead of ROS time"}},
      {"a stamp far in the future",
       [](LiveFrame* frame) { frame->image.header.stamp = ros::Time::now() + ros::Duration(100.0); },
       MapUpdate::STAMP_IN_FUTURE,
       {"ahead of ROS time", "must be at most 0.500 s (max_future_s)"}},
      {"a frame that tf does not know",
       [](LiveFrame* frame) { frame->image.header.frame_id = "elsewhere_optical_frame"; },
       MapUpdate::NO_TRANSFORM,
       {"'elsewhere_optical_frame'", "'map'", "after waiting 0.200 s (tf_timeout_s)"}},
      {"tf that ends before the image",
       [](LiveFrame* frame) {
         frame->transform.child_frame_id = frame->image.header.frame_id = "ended_optical_frame";
         frame->transform.header.stamp -= ros::Duration(0.05);
       },
       MapUpdate::NO_TRANSFORM,
       {"'ended_optical_frame'", "extrapolation", "0.200 s (tf_timeout_s)"}},
      {"tf that begins after the image",
       [](LiveFrame* frame) {
         frame->transform.child_frame_id = frame->image.header.frame_id = "begun_optical_frame";
         frame->transform.header.stamp += ros::Duration(0.05);
       },
       MapUpdate::NO_TRANSFORM,
       {"'begun_optical_frame'", "extrapolation", "0.200 s (tf_timeout_s)"}},
      {"NaN in the rotation",
       [](LiveFrame* frame) { frame->transform.transform.rotation.x = kNan; },
       MapUpdate::NO_TRANSFORM,
       {"'camera_depth_optical_frame'"}},
      {"NaN in the translation",
       [](LiveFrame* frame) { frame->transform.transform.translation.y = kNan; },
       MapUpdate::NO_TRANSFORM,
       {"'camera_depth_optical_frame'"}},
      {"a quaternion of length 2",
       [](LiveFrame* frame) {
         frame->transform.transform.rotation.x *= 2.0;
         frame->transform.transform.rotation.y *= 2.0;
         frame->transform.transform.rotation.z *= 2.0;
         frame->transform.transform.rotation.w *= 2.0;
       },
       MapUpdate::NO_TRANSFORM,
       {"'camera_depth_optical_frame'"}},
      {"a jump of a metre",
       [](LiveFrame* frame) { frame->transform.transform.translation.x += 1.0; },
       MapUpdate::POSE_JUMP,
       {"moved by 1.000 m", "must be at most", "(pose_limits)"}},
      {"a camera upside down",
       [](LiveFrame* frame) {
         const geometry_msgs::Quaternion q = frame->transform.transform.rotation;  // times (0, 0, 0, 1): half a turn
         frame->transform.transform.rotation.w = -q.z;
         frame->transform.transform.rotation.x = q.y;
         frame->transform.transform.rotation.y = -q.x;
         frame->transform.transform.rotation.z = q.w;
       },
       MapUpdate::POSE_JUMP,
       {"3.14", "must be at most"}},
      {"an image out of order",
       [](LiveFrame* frame) { frame->setStamp(frame->image.header.stamp - ros::Duration(0.6)); },
       MapUpdate::TIME_RAN_BACK,
       {"before the last one", "must be after it"}},
  };
}

TEST_F(LiveMapInput, EachBadImageIsRefusedNamedCountedAndLeavesTheMapBitForBit) {
  ASSERT_NO_FATAL_FAILURE(connect("/guarded"));
  ASSERT_TRUE(waitUntil([this] { return live_->count("accepted") == 1; }));
  for (std::size_t i = 0; i < expected_counts_.size() - 1; ++i) expected_counts_[i] = 0;
  expected_counts_[MapUpdate::ACCEPTED] = 1;
  expected_counts_[MapUpdate::WRONG_ENCODING] = live_->count("left out: wrong encoding");  // from connecting
  for (const BadFrame& bad : badFrames()) {
    SCOPED_TRACE(bad.name);
    const std::vector<std::uint8_t> before = answers();
    const std::uint64_t updates_before = live_->updates.back().update;
    LiveFrame frame = good();
    bad.spoil(&frame);
    const MapUpdate update = live_->look(frame);
    expectRefused(update, bad.status, bad.message);
    EXPECT_EQ(update.update, updates_before);
    EXPECT_TRUE(answers() == before);
    EXPECT_EQ(expectGoodIsAccepted(bad.name).update, updates_before + 1);
    ++expected_counts_[MapUpdate::ACCEPTED];
  }
  const std::array<const char*, 8> names{
      "left out: wrong encoding",   "left out: malformed image",    "left out: size differs from camera info",
      "left out: nothing measured", "left out: no transform",       "left out: pose jump",
      "left out: time ran back",    "left out: stamp in the future"};
  const std::array<int, 8> statuses{MapUpdate::WRONG_ENCODING,   MapUpdate::MALFORMED_IMAGE, MapUpdate::SIZE_MISMATCH,
                                    MapUpdate::NOTHING_MEASURED, MapUpdate::NO_TRANSFORM,    MapUpdate::POSE_JUMP,
                                    MapUpdate::TIME_RAN_BACK,    MapUpdate::STAMP_IN_FUTURE};
  EXPECT_TRUE(waitUntil([&] { return live_->count("accepted") == expected_counts_[MapUpdate::ACCEPTED]; }));
  for (std::size_t i = 0; i < names.size(); ++i) {
    EXPECT_EQ(live_->count(names[i]), expected_counts_[static_cast<std::size_t>(statuses[i])]) << names[i];
  }
  EXPECT_PRED2(has, live_->diagnosticValue("input", "last left out"), "time ran back: stamp is");
  EXPECT_EQ(live_->diagnostic("input").level, diagnostic_msgs::DiagnosticStatus::WARN)
      << "more than a tenth is left out";
}

TEST_F(LiveMapInput, ImpossibleCameraInfoIsRefusedUntilAGoodOneComes) {
  ASSERT_NO_FATAL_FAILURE(connect("/guarded"));
  const std::vector<std::pair<std::function<void(sensor_msgs::CameraInfo*)>, std::string>> cases{
      {[](sensor_msgs::CameraInfo* info) { info->K[0] = info->P[0] = 0.0; }, "fx"},
      {[](sensor_msgs::CameraInfo* info) { info->K[4] = info->P[5] = -131.0; }, "fy"},
      {[](sensor_msgs::CameraInfo* info) { info->K[2] = info->P[2] = kNan; }, "cx"},
      {[](sensor_msgs::CameraInfo* info) { info->width = 0; }, "width"},
  };
  for (const auto& [spoil, name] : cases) {
    SCOPED_TRACE(name);
    const std::vector<std::uint8_t> before = answers();
    LiveFrame frame = good();
    spoil(&frame.info);
    const MapUpdate update = live_->publishInfoAndAwait(frame, MapUpdate::BAD_CAMERA_INFO);
    EXPECT_EQ(static_cast<int>(update.status), MapUpdate::BAD_CAMERA_INFO) << update.message;
    EXPECT_PRED2(has, update.message, "camera info: ");
    EXPECT_PRED2(has, update.message, name);
    EXPECT_PRED2(has, update.message, "must be");
    EXPECT_TRUE(answers() == before);
    live_->publishInfoAndAwait(good(), MapUpdate::NOTHING_MEASURED);
    expectGoodIsAccepted(name);
  }
}

TEST_F(LiveMapInput, CameraInfoOfAnotherFrameIsTakenWithAWarning) {
  ASSERT_NO_FATAL_FAILURE(connect("/guarded"));
  LiveFrame frame = good();
  frame.info.header.frame_id = "color_optical_frame";
  // The refusals of the tests before count for five seconds.
  EXPECT_TRUE(waitUntil([&] {
    frame.setStamp(live_->nextStamp(kStep_s));
    EXPECT_EQ(static_cast<int>(live_->look(frame).status), MapUpdate::ACCEPTED);
    return has(live_->diagnostic("input").message, "camera info is of frame 'color_optical_frame'") &&
           has(live_->diagnostic("input").message, "the image of 'camera_depth_optical_frame'");
  })) << live_->diagnostic("input").message;
  EXPECT_EQ(live_->diagnostic("input").level, diagnostic_msgs::DiagnosticStatus::WARN);
  EXPECT_TRUE(waitUntil([&] {
    expectGoodIsAccepted("the right frame");
    return live_->diagnostic("input").level == diagnostic_msgs::DiagnosticStatus::OK;
  })) << live_->diagnostic("input").message;
}

TEST_F(LiveMapInput, TimeThatRunsAnewForgetsTransformsAndKeepsTheMap) {
  ASSERT_NO_FATAL_FAILURE(connect("/guarded"));
  const std::vector<std::uint8_t> before = answers();
  const std::uint64_t updates_before = live_->updates.back().update;
  live_->setStamp(live_->stamp() - ros::Duration(100.0));
  LiveFrame frame = good();
  const MapUpdate update = live_->look(frame.image);
  EXPECT_EQ(static_cast<int>(update.status), MapUpdate::TIME_RAN_BACK) << update.message;
  EXPECT_PRED2(has, update.message, "time ran back by 99.9");
  EXPECT_PRED2(has, update.message, "the map stays");
  EXPECT_TRUE(answers() == before);
  // tf knew this pose at later times only; now it knows none.
  frame.image.header.stamp = live_->nextStamp(kStep_s);
  EXPECT_PRED2(has, live_->look(frame.image).message, "no transform from 'camera_depth_optical_frame'");
  // From another place: a camera that starts anew has not jumped.
  const MapUpdate next = live_->look(good(1));
  EXPECT_EQ(static_cast<int>(next.status), MapUpdate::ACCEPTED) << next.message;
  EXPECT_EQ(next.update, updates_before + 1);
}

TEST_F(LiveMapInput, WithoutCameraInfoImagesAreRefused) {
  // Before anything else is sent to this node: camera info, once there, stays.
  live_ = std::make_unique<LiveMap>("/jumping");
  ASSERT_TRUE(live_->connect());
  const LiveFrame frame = good();
  const MapUpdate update = live_->look(frame.image);
  EXPECT_EQ(static_cast<int>(update.status), MapUpdate::NO_CAMERA_INFO) << update.message;
  EXPECT_PRED2(has, update.message, "/jumping_in/depth/camera_info");
  expectGoodIsAccepted("camera info");
}

TEST_F(LiveMapInput, AJumpThatLastsIsBelievedAfterSettleFrames) {
  ASSERT_NO_FATAL_FAILURE(connect("/jumping"));
  const std::vector<std::uint8_t> before = answers();
  constexpr int kSettleFrames = 5;  // default
  for (int i = 1; i < kSettleFrames; ++i) {
    const MapUpdate update = live_->look(good(1));
    EXPECT_EQ(static_cast<int>(update.status), MapUpdate::POSE_JUMP) << update.message;
    EXPECT_PRED2(has, update.message, "camera moved by 2.000 m");
    EXPECT_TRUE(answers() == before);
  }
  EXPECT_EQ(static_cast<int>(live_->look(good(1)).status), MapUpdate::ACCEPTED);
  EXPECT_EQ(static_cast<int>(live_->look(good(1)).status), MapUpdate::ACCEPTED);
  EXPECT_TRUE(waitUntil([&] { return live_->diagnosticValue("transforms", "jumps that stayed") == "1"; }));
  EXPECT_PRED2(has, live_->diagnostic("transforms").message, "the pose jumped and stayed, 1 times");
}

TEST_F(LiveMapInput, OnlyTheNewestImageWaitsWhileTheNodeIsBusy) {
  ASSERT_NO_FATAL_FAILURE(connect("/busy"));
  const auto settled = [this] {  // of which kind does not matter here
    long sum = live_->count("accepted");
    for (const diagnostic_msgs::KeyValue& value : live_->diagnostic("input").values) {
      if (value.key.compare(0, 10, "left out: ") == 0) sum += std::atol(value.value.c_str());
    }
    return sum + live_->count("replaced by a newer one");
  };
  // The good image comes after all those that connecting took: with it, diagnostics tell of them all.
  ASSERT_TRUE(waitUntil([&] { return live_->count("accepted") == 1 && settled() == live_->count("received"); }));
  const long received = live_->count("received");
  const long accepted = live_->count("accepted");
  const long replaced = live_->count("replaced by a newer one");
  // Waiting for its pose, this one keeps the node busy; of those behind it, one after the other, the last remains.
  std::vector<LiveFrame> frames;
  const std::size_t since = live_->updates.size();
  constexpr long kNumBehind = 5;
  for (long i = 0; i <= kNumBehind; ++i) {
    frames.push_back(good());
    live_->publish(frames.back().image);
    ASSERT_TRUE(waitUntil([&] { return live_->count("received") == received + i + 1; })) << i;
    EXPECT_EQ(live_->count("replaced by a newer one"), replaced + std::max(0L, i - 1));
  }
  for (const LiveFrame& frame : frames) live_->publish(frame.transform);
  EXPECT_EQ(static_cast<int>(live_->await(frames.back().image.header.stamp, since).status), MapUpdate::ACCEPTED);
  ASSERT_TRUE(waitUntil([&] { return live_->count("accepted") == accepted + 2; }));
  EXPECT_EQ(live_->count("received"), received + 1 + kNumBehind);
  EXPECT_EQ(live_->count("replaced by a newer one"), replaced + kNumBehind - 1);
  EXPECT_EQ(live_->updates.size(), since + 2);

  // At once: how many are looked at depends on the machine, that the newest is the last of them does not.
  constexpr int kBurst = 20;
  frames.clear();
  for (int i = 0; i < kBurst; ++i) frames.push_back(good());
  for (const LiveFrame& frame : frames) live_->publish(frame.transform);
  const std::size_t before_burst = live_->updates.size();
  for (const LiveFrame& frame : frames) live_->publish(frame.image);
  EXPECT_EQ(static_cast<int>(live_->await(frames.back().image.header.stamp, before_burst).status), MapUpdate::ACCEPTED);
  const long num_looked_at = static_cast<long>(live_->updates.size() - before_burst);
  EXPECT_LE(num_looked_at, kBurst);
  ASSERT_TRUE(waitUntil([&] { return live_->count("accepted") == accepted + 2 + num_looked_at; }));
  EXPECT_EQ(settled(), live_->count("received"));
  EXPECT_EQ(static_cast<long>(live_->updates.size() - before_burst), num_looked_at) << "nothing was queued";
}

}  // namespace
}  // namespace integration_tests
