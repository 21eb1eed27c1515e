// SPDX-License-Identifier: BSD-3-Clause
// Node and nodelet depth_self_filter on images, joint states and attached bricks that the test publishes: what comes out is
// what the core makes of the same, and whatever is wrong is said.
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>

#include <depth_self_filter/robot_mask.h>
#include <interactive_mapping_common/testing/process.h>
#include <tf2_eigen/tf2_eigen.h>

#include "filter_camera.h"

namespace integration_tests {
namespace {

using node_tests::Process;

using depth_camera::DepthImage;
using interactive_mapping_msgs::AttachedBrick;

const std::vector<double> kInView = {0.2, -0.9, 1.2, -1.9, -1.57, 0.0};
const std::vector<double> kElsewhere = {2.5, -2.0, 1.2, -1.9, -1.57, 0.0};

AttachedBrick brickInHand(const ros::Time& since) {
  AttachedBrick brick;
  brick.header.stamp = since;
  brick.header.frame_id = description::kToolFrame;
  brick.is_attached = 1;
  brick.id = 3;
  brick.size.x = 0.3;
  brick.size.y = brick.size.z = 0.2;
  brick.pose.position.z = 0.2;
  brick.pose.orientation.w = 1.0;
  return brick;
}

AttachedBrick emptyHand(const ros::Time& since) {
  AttachedBrick brick;
  brick.header.stamp = since;
  return brick;
}

class SelfFilterInput : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    patient_ = new FilterCamera("/patient");
    hasty_ = new FilterCamera("/hasty");
    robot_ = description::RobotModel::load(MP700_UR5E_DESCRIPTION_DIR "/urdf/mp700_ur5e.urdf");
    are_connected_ = patient_->connect() && hasty_->connect();
  }
  static void TearDownTestSuite() {
    delete patient_;
    delete hasty_;
  }

  void SetUp() override {
    ASSERT_TRUE(are_connected_);  // a failure above would be no test's, and go unnoticed
    for (FilterCamera* camera : {patient_, hasty_}) {
      camera->publish(emptyHand(ros::Time::now()));
      camera->publish(infoOf(filterCameraModel()));
      camera->lookUntil(flatImage(3.0F), kInView, [](const Update& update) {
        return update.status == Update::ACCEPTED && update.has_brick == 0;
      });
    }
  }

  /// What the core makes of the same.
  static DepthImage expected(const sensor_msgs::Image& image, const std::vector<double>& arm_rad,
                             const std::optional<depth_self_filter::HeldBrick>& brick,
                             depth_self_filter::MaskStatistics* statistics) {
    depth_camera_ros::Refusal refusal;
    DepthImage depth = *depth_camera_ros::toDepthImage(image, 1000.0, &refusal);
    Eigen::VectorXd q = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(robot_->joints().size()));
    for (std::size_t i = 0; i < arm_rad.size(); ++i) {
      q[static_cast<Eigen::Index>(robot_->jointIndex(description::kArmJoints[i]))] = arm_rad[i];
    }
    depth_self_filter::RobotMask mask(robot_, {});
    *statistics = mask.apply(filterCameraModel(), robot_->framePose(description::kDepthFrame, q), q, brick, &depth);
    return depth;
  }

  static bool isSame(const sensor_msgs::Image& message, const DepthImage& depth) {
    return message.encoding == "32FC1" && message.data.size() == depth.depth_m.size() * sizeof(float) &&
           std::memcmp(message.data.data(), depth.depth_m.data(), message.data.size()) == 0;
  }

  static bool are_connected_;
  static FilterCamera* patient_;
  static FilterCamera* hasty_;
  static std::shared_ptr<const description::RobotModel> robot_;
};
bool SelfFilterInput::are_connected_ = false;
FilterCamera* SelfFilterInput::patient_ = nullptr;
FilterCamera* SelfFilterInput::hasty_ = nullptr;
std::shared_ptr<const description::RobotModel> SelfFilterInput::robot_;

TEST_F(SelfFilterInput, WhatComesOutIsWhatTheCoreMakesOfIt) {
  for (const bool is_16_bit : {false, true}) {
    sensor_msgs::Image image = flatImage(3.0F);
    if (is_16_bit) {
      image.encoding = "16UC1";
      image.step = image.width * 2;
      image.data.clear();
      for (std::uint32_t i = 0; i < image.width * image.height; ++i) {  // 3000 mm, and holes
        image.data.push_back(i % 7 == 0 ? 0x00 : 0xB8);
        image.data.push_back(i % 7 == 0 ? 0x00 : 0x0B);
      }
    }
    const Update update = patient_->look(image, kInView);
    ASSERT_EQ(update.status, Update::ACCEPTED) << update.message;
    depth_self_filter::MaskStatistics statistics;
    const DepthImage depth = expected(image, kInView, std::nullopt, &statistics);
    EXPECT_TRUE(isSame(patient_->images.awaitStamp(update.header.stamp), depth)) << is_16_bit;
    EXPECT_EQ(update.masked, statistics.masked_px);
    EXPECT_EQ(update.shadow, statistics.shadow_px);
    EXPECT_EQ(update.in_front, statistics.in_front_px);
    EXPECT_GT(update.masked, 160U * 120U / 20);
    EXPECT_EQ(update.shadow > 0, is_16_bit);
    EXPECT_EQ(update.header.frame_id, description::kDepthFrame);
    const sensor_msgs::CameraInfo& info = patient_->infos.awaitStamp(update.header.stamp);
    EXPECT_EQ(info.width, 160U);
    EXPECT_EQ(info.header.frame_id, description::kDepthFrame);
  }
}

TEST_F(SelfFilterInput, AnImageWaitsForTheJointStateAfterIt) {
  sensor_msgs::Image image = flatImage(3.0F);
  image.header.stamp = patient_->nextStamp();
  const std::size_t since = patient_->updates.size();
  patient_->publish(FilterCamera::armAt(image.header.stamp - ros::Duration(0.02), kInView));
  patient_->publish(image);
  // Halfway between both states, and the arm moves by 0.2 rad.
  std::vector<double> later = kInView;
  std::vector<double> middle = kInView;
  later[0] += 0.2;
  middle[0] += 0.1;
  patient_->publish(FilterCamera::armAt(image.header.stamp + ros::Duration(0.02), later));
  const Update update = patient_->await(image.header.stamp, since);
  ASSERT_EQ(update.status, Update::ACCEPTED) << update.message;
  depth_self_filter::MaskStatistics statistics;
  expected(image, middle, std::nullopt, &statistics);
  // To the rounding of a stamp: 2e-7 s of 1.7e9 s in double precision are a millionth of a radian.
  EXPECT_NEAR(update.masked, statistics.masked_px, 2.0);
  expected(image, kInView, std::nullopt, &statistics);
  EXPECT_GT(std::abs(static_cast<double>(update.masked) - static_cast<double>(statistics.masked_px)), 2.0);
}

TEST_F(SelfFilterInput, JointStatesThatStopDropImagesAndComeBack) {
  const sensor_msgs::Image image = flatImage(3.0F);
  sensor_msgs::Image late = image;
  late.header.stamp = hasty_->nextStamp() + ros::Duration(0.1);
  std::size_t since = hasty_->updates.size();
  hasty_->publish(late);
  Update update = hasty_->await(late.header.stamp, since);
  EXPECT_EQ(update.status, Update::JOINT_STATES_LATE) << update.message;
  EXPECT_TRUE(has(update.message, "before the image, must be at or after it; waited 0.050 s (wait_s)"))
      << update.message;
  // In its values: what the summary says depends on how long ago the last good image was.
  EXPECT_TRUE(waitUntil([&] {
    for (const auto& value : hasty_->diagnostic("input").values) {
      if (value.key == "last drop" && has(value.value, "joint states late")) return true;
    }
    return false;
  }));
  // They come back 0.4 s later: an image in the gap is dropped, one after it is not.
  const ros::Time again = late.header.stamp + ros::Duration(0.3);
  ASSERT_TRUE(waitUntil([&] { return ros::Time::now() > again; }));
  late.header.stamp = again;
  since = hasty_->updates.size();
  hasty_->publish(FilterCamera::armAt(again + ros::Duration(0.1), kInView));
  hasty_->publish(late);
  update = hasty_->await(late.header.stamp, since);
  // The joint state may be heard too late; then the image is too early for it.
  EXPECT_TRUE(update.status == Update::JOINT_STATES_MISSING || update.status == Update::JOINT_STATES_LATE)
      << update.message;
  EXPECT_EQ(hasty_->lookUntil(image, kInView, Update::ACCEPTED).status, Update::ACCEPTED);
}

TEST_F(SelfFilterInput, AGapInJointStatesIsNotBridged) {
  sensor_msgs::Image image = flatImage(3.0F);
  image.header.stamp = patient_->nextStamp() + ros::Duration(0.3);
  const std::size_t since = patient_->updates.size();
  patient_->publish(FilterCamera::armAt(image.header.stamp - ros::Duration(0.1), kInView));
  patient_->publish(FilterCamera::armAt(image.header.stamp + ros::Duration(0.1), kInView));
  patient_->publish(image);
  const Update update = patient_->await(image.header.stamp, since);
  EXPECT_EQ(update.status, Update::JOINT_STATES_MISSING);
  EXPECT_TRUE(has(update.message, "0.200000 s apart, must be at most 0.100000 s (max_gap_s)")) << update.message;
}

TEST_F(SelfFilterInput, JointStatesWithNaNAreLeftOutAndSaid) {
  sensor_msgs::Image image = flatImage(3.0F);
  image.header.stamp = hasty_->nextStamp();
  const std::size_t since = hasty_->updates.size();
  for (const double offset_s : {0.01, 0.02}) {
    sensor_msgs::JointState joints = FilterCamera::armAt(image.header.stamp + ros::Duration(offset_s), kInView);
    joints.position[0] = std::nan("");
    hasty_->publish(joints);
  }
  hasty_->publish(image);
  const Update update = hasty_->await(image.header.stamp, since);
  EXPECT_NE(update.status, Update::ACCEPTED);
  EXPECT_TRUE(waitUntil([&] { return has(hasty_->diagnostic("joint states").message, "elbow_joint is at"); }));
  // Waiting images say it, too.
  EXPECT_TRUE(waitUntil([&] {
    sensor_msgs::Image next = flatImage(3.0F);
    next.header.stamp = hasty_->nextStamp() + ros::Duration(0.2);
    const std::size_t before = hasty_->updates.size();
    hasty_->publish(next);
    return has(hasty_->await(next.header.stamp, before).message, "joint elbow_joint is at nan rad");
  }));
}

TEST_F(SelfFilterInput, TheBrickInTheHandIsTakenOut) {
  const sensor_msgs::Image image = flatImage(3.0F);
  const Update without = patient_->look(image, kInView);
  patient_->publish(brickInHand(ros::Time::now()));
  const Update with = patient_->lookUntil(image, kInView, [](const Update& update) { return update.has_brick != 0; });
  EXPECT_EQ(with.status, Update::ACCEPTED);
  EXPECT_GT(with.masked, without.masked + 500);
  depth_self_filter::HeldBrick brick{description::kToolFrame, Eigen::Isometry3d::Identity(), {0.3, 0.2, 0.2}};
  brick.T_frame_brick.translation().z() = 0.2;
  depth_self_filter::MaskStatistics statistics;
  const DepthImage depth = expected(image, kInView, brick, &statistics);
  EXPECT_TRUE(isSame(patient_->images.awaitStamp(with.header.stamp), depth));
  patient_->publish(emptyHand(ros::Time::now()));
  const Update after = patient_->lookUntil(image, kInView, [](const Update& update) { return update.has_brick == 0; });
  EXPECT_EQ(after.masked, without.masked);
}

TEST_F(SelfFilterInput, ABrickThatIsNowhereDropsImagesUntilItIsClear) {
  const sensor_msgs::Image image = flatImage(3.0F);
  AttachedBrick bad = brickInHand(ros::Time::now());
  bad.header.frame_id = "gripper";
  patient_->publish(bad);
  const Update update = patient_->lookUntil(image, kInView, Update::BAD_ATTACHED_BRICK);
  EXPECT_TRUE(has(update.message, "'gripper', must be a link of the URDF")) << update.message;
  EXPECT_TRUE(waitUntil([&] { return patient_->diagnostic("joint states").level == 2; }));
  patient_->publish(brickInHand(ros::Time::now()));
  EXPECT_EQ(patient_->lookUntil(image, kInView, Update::ACCEPTED).has_brick, 1);
}

TEST_F(SelfFilterInput, BadImagesAreDroppedWithTheirReason) {
  const sensor_msgs::Image good = flatImage(3.0F);
  const auto lookAt = [&](const sensor_msgs::Image& image, std::uint8_t status, const std::string& words) {
    const Update update = patient_->look(image, kInView);
    EXPECT_EQ(static_cast<int>(update.status), static_cast<int>(status)) << update.message;
    EXPECT_TRUE(has(update.message, words)) << update.message;
  };
  sensor_msgs::Image image = good;
  image.encoding = "rgb8";
  lookAt(image, Update::WRONG_ENCODING, "encoding is 'rgb8', must be one of 16UC1 or mono16 (mm), 32FC1 (m)");
  image = good;
  image.data.resize(100);
  lookAt(image, Update::MALFORMED_IMAGE, "100 bytes are too few");
  image = good;
  image.header.frame_id = "";
  lookAt(image, Update::MALFORMED_IMAGE, "frame_id is empty");
  image = good;
  image.height -= 1;
  lookAt(image, Update::SIZE_MISMATCH, "160 x 119 px");

  image = good;
  image.header.stamp = patient_->nextStamp() + ros::Duration(60.0);
  Update update = patient_->lookAsIs(image, kInView);
  EXPECT_EQ(update.status, Update::STAMP_IN_FUTURE) << update.message;
  // Its joint states are of the future as well, and forgotten with the next ones.
  EXPECT_EQ(patient_->lookUntil(good, kInView, Update::ACCEPTED).status, Update::ACCEPTED);

  image = good;
  image.header.stamp = patient_->nextStamp() - ros::Duration(30.0);
  update = patient_->lookAsIs(image, kInView);
  EXPECT_EQ(update.status, Update::TIME_RAN_BACK) << update.message;
  EXPECT_EQ(patient_->lookUntil(good, kInView, Update::ACCEPTED).status, Update::ACCEPTED);
}

TEST_F(SelfFilterInput, BadCameraInfoIsSaid) {
  sensor_msgs::CameraInfo info = infoOf(filterCameraModel());
  info.P[0] = info.K[0] = 0.0;
  patient_->publish(info);
  const Update update = patient_->lookUntil(flatImage(3.0F), kInView, Update::BAD_CAMERA_INFO);
  EXPECT_TRUE(has(update.message, "fx = 0 px")) << update.message;
}

TEST_F(SelfFilterInput, ACameraThatTheUrdfDoesNotHaveIsAskedOfTf) {
  sensor_msgs::Image image = flatImage(3.0F);
  image.header.frame_id = "tripod";
  const Update unknown = hasty_->look(image, kInView);
  EXPECT_EQ(unknown.status, Update::NO_TRANSFORM) << unknown.message;
  EXPECT_TRUE(has(unknown.message, "the URDF has no frame 'tripod', and tf:")) << unknown.message;
  // Where the mast's camera is: the same is masked.
  const Eigen::VectorXd q = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(robot_->joints().size()));
  const Eigen::Isometry3d T = robot_->framePose(description::kDepthFrame, q);
  const auto published = [&](const ros::Time& stamp) {
    tf2_msgs::TFMessage message;
    message.transforms.push_back(tf2::eigenToTransform(T));
    geometry_msgs::TransformStamped& transform = message.transforms.back();
    transform.header.stamp = stamp;
    transform.header.frame_id = description::kBaseFrame;
    transform.child_frame_id = "tripod";
    return message;
  };
  image.header.stamp = patient_->nextStamp();
  patient_->publish(published(image.header.stamp));
  const Update by_tf = patient_->lookAsIs(image, kInView);
  ASSERT_EQ(by_tf.status, Update::ACCEPTED) << by_tf.message;
  const Update by_urdf = patient_->look(flatImage(3.0F), kInView);
  EXPECT_NEAR(by_tf.masked, by_urdf.masked, 2.0);  // the quaternion's rounding
}

TEST_F(SelfFilterInput, TheArmThatIsElsewhereLeavesTheViewAlone) {
  const Update in_view = patient_->look(flatImage(3.0F), kInView);
  const Update elsewhere = patient_->look(flatImage(3.0F), kElsewhere);
  EXPECT_LT(elsewhere.masked, in_view.masked / 2);
}

/// A node that ends by itself: its exit code and output.
std::pair<int, std::string> run(const std::string& name) {
  std::string folder = (std::filesystem::temp_directory_path() / "self_filter_XXXXXX").string();
  if (::mkdtemp(folder.data()) == nullptr) throw std::runtime_error("no temporary folder");
  std::pair<int, std::string> result;
  {
    Process process({DEPTH_SELF_FILTER_NODE, "__name:=" + name, "robot_description:=" + name + "_description"},
                    folder + "/log");
    EXPECT_TRUE(waitUntil([&] { return process.hasEnded(); })) << process.output();
    result = {process.exitCode(), process.output()};
  }
  std::error_code ignored;
  std::filesystem::remove_all(folder, ignored);
  return result;
}

TEST(SelfFilterProcess, ARobotThatIsNoneEndsTheNodeWithTheReason) {
  ros::NodeHandle nh;
  auto [code, output] = run("without_urdf");
  EXPECT_EQ(code, 1);
  EXPECT_TRUE(has(output, "must hold the URDF as text")) << output;
  nh.setParam("/broken_urdf_description", "<robot");
  std::tie(code, output) = run("broken_urdf");
  EXPECT_EQ(code, 1);
  EXPECT_TRUE(has(output, "is no URDF")) << output;
}

TEST(SelfFilterProcess, ImpossibleParametersEndTheNodeWithAllOfThem) {
  ros::NodeHandle nh;
  nh.setParam("/impossible/mask/padding_m", -1.0);
  nh.setParam("/impossible/joints/max_gap", 0.1);
  const auto [code, output] = run("impossible");
  EXPECT_EQ(code, 1);
  EXPECT_TRUE(has(output, "/impossible/mask/padding_m = -1 m, must be in [0, 0.5] m")) << output;
  EXPECT_TRUE(has(output, "/impossible/joints/max_gap is unknown")) << output;
}

}  // namespace
}  // namespace integration_tests
