// SPDX-License-Identifier: BSD-3-Clause
// The self filter in the simulated world, in lock step: the arm moves into view and is not in the images that the map gets;
// joint states stop, and images with them; they come back.
#include <cmath>
#include <map>

#include <actionlib/client/simple_action_client.h>
#include <control_msgs/FollowJointTrajectoryAction.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <mp700_ur5e_description/robot_names.h>
#include <sensor_msgs/CameraInfo.h>

#include "arm_distance.h"
#include "filter_camera.h"

namespace integration_tests {
namespace {

using interactive_mapping_msgs::MapUpdate;
using FollowClient = actionlib::SimpleActionClient<control_msgs::FollowJointTrajectoryAction>;

constexpr double kLong_s = 120.0;  // wall time of some simulated seconds on a busy machine

class SelfFilterWorld : public testing::Test {
 protected:
  SelfFilterWorld()
      : robot_(description::RobotModel::load(MP700_UR5E_DESCRIPTION_DIR "/urdf/mp700_ur5e.urdf")),
        arm_("scaled_pos_joint_traj_controller/follow_joint_trajectory", false) {
    relay_ = nh_.advertise<sensor_msgs::JointState>("/joint_states_of_test", 1000);
    subscribers_.push_back(nh_.subscribe<sensor_msgs::JointState>(
        "/joint_states", 1000, [this](const sensor_msgs::JointState::ConstPtr& joints) {
          if (is_relaying_) relay_.publish(joints);
          for (std::size_t i = 0; i < joints->name.size(); ++i) {
            joints_[joints->header.stamp][joints->name[i]] = joints->position.at(i);
          }
        }));
    subscribers_.push_back(nh_.subscribe<Update>("/depth_self_filter/update", 100,
                                                 [this](const Update::ConstPtr& u) { updates_.push_back(*u); }));
    subscribers_.push_back(nh_.subscribe<sensor_msgs::Image>(
        "/depth_self_filter/image_rect", 100,
        [this](const sensor_msgs::ImageConstPtr& image) { filtered_[image->header.stamp] = image; }));
    subscribers_.push_back(nh_.subscribe<sensor_msgs::Image>(
        "/camera/aligned_depth_to_color/image_raw", 100,
        [this](const sensor_msgs::ImageConstPtr& image) { raw_[image->header.stamp] = image; }));
    subscribers_.push_back(nh_.subscribe<sensor_msgs::CameraInfo>(
        "/depth_self_filter/camera_info", 10, [this](const sensor_msgs::CameraInfo::ConstPtr& info) { info_ = info; }));
    subscribers_.push_back(nh_.subscribe<MapUpdate>("/gpis_mapping/update", 100, [this](const MapUpdate::ConstPtr& u) {
      if (u->status == MapUpdate::ACCEPTED) mapped_.push_back(u->header.stamp);
    }));
  }

  /// Waits for so many more updates of a status; false if they do not come.
  bool awaitUpdates(std::uint8_t status, int number) {
    std::size_t next = updates_.size();
    return waitUntil(
        [&] {
          for (; next < updates_.size(); ++next) number -= updates_[next].status == status ? 1 : 0;
          return number <= 0;
        },
        kLong_s);
  }

  /// Points of an image within 5 mm of the arm as it was at its stamp; -1: nobody knows how it was. Noise makes more of the
  /// arm's points lie farther from it than nearer, but at 1 m its standard deviation is 4 mm.
  int pointsOnArm(const sensor_msgs::Image& message) {
    const auto joints = joints_.find(message.header.stamp);
    if (joints == joints_.end()) return -1;
    Eigen::VectorXd q = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(robot_->joints().size()));
    for (const auto& [name, position] : joints->second)
      q[static_cast<Eigen::Index>(robot_->jointIndex(name))] = position;
    depth_camera_ros::Refusal refusal;
    const auto image = depth_camera_ros::toDepthImage(message, 1000.0, &refusal);
    const auto camera = depth_camera_ros::toCameraModel(*info_, true, &refusal);
    EXPECT_TRUE(image && camera) << refusal.message;
    if (!image || !camera) return -1;
    const Eigen::Isometry3d T_root_camera = robot_->framePose(description::kDepthFrame, q);
    int count = 0;
    constexpr int kStride_px = 3;  // arms are wider
    for (int v = 0; v < image->height; v += kStride_px) {
      for (int u = 0; u < image->width; u += kStride_px) {
        const float z = image->at(u, v);
        if (!std::isfinite(z) || z <= 0.0F) continue;
        const Eigen::Vector3d p_camera((u - camera->cx) / camera->fx * z, (v - camera->cy) / camera->fy * z, z);
        count += simulated_world::distanceToArm(*robot_, q, T_root_camera * p_camera) < 0.005 ? 1 : 0;
      }
    }
    return count;
  }

  ros::NodeHandle nh_;
  std::shared_ptr<const description::RobotModel> robot_;
  FollowClient arm_;
  ros::Publisher relay_;
  std::vector<ros::Subscriber> subscribers_;
  bool is_relaying_{true};
  std::map<ros::Time, std::map<std::string, double>> joints_;
  std::map<ros::Time, sensor_msgs::ImageConstPtr> filtered_, raw_;
  sensor_msgs::CameraInfo::ConstPtr info_;
  std::vector<Update> updates_;
  std::vector<ros::Time> mapped_;
};

TEST_F(SelfFilterWorld, TheArmIsNeverSeenAndNoImageIsGuessed) {
  ASSERT_TRUE(waitUntil([this] { return arm_.isServerConnected() && relay_.getNumSubscribers() > 0; }, kLong_s));
  ASSERT_TRUE(awaitUpdates(Update::ACCEPTED, 3)) << (updates_.empty() ? "no update" : updates_.back().message);

  control_msgs::FollowJointTrajectoryGoal goal;
  goal.trajectory.joint_names.assign(description::kArmJoints.begin(), description::kArmJoints.end());
  trajectory_msgs::JointTrajectoryPoint point;
  point.positions = {0.2, -0.9, 1.2, -1.9, -1.57, 0.0};
  point.velocities.assign(6, 0.0);
  point.time_from_start = ros::Duration(2.5);  // joints at up to 1.5 rad/s
  goal.trajectory.points.push_back(point);
  const std::size_t first = updates_.size();
  arm_.sendGoal(goal);
  ASSERT_TRUE(waitUntil([this] { return arm_.getState().isDone(); }, kLong_s));
  EXPECT_EQ(arm_.getState(), actionlib::SimpleClientGoalState::SUCCEEDED) << arm_.getState().getText();
  ASSERT_TRUE(awaitUpdates(Update::ACCEPTED, 2));
  const ros::Time last = updates_.back().header.stamp;
  ASSERT_TRUE(
      waitUntil([&] { return filtered_.count(last) == 1 && raw_.count(last) == 1 && joints_.count(last) == 1; }));

  int moving = 0;
  int seen_raw = 0;
  std::uint32_t most_masked = 0;
  for (std::size_t i = first; i < updates_.size(); ++i) {
    const Update& update = updates_[i];
    // What the arm does takes wall time to tell: an image may come too late for it, never wrong.
    if (update.status != Update::ACCEPTED) continue;
    ASSERT_EQ(filtered_.count(update.header.stamp), 1U);
    EXPECT_EQ(pointsOnArm(*filtered_[update.header.stamp]), 0) << update.header.stamp;
    if (raw_.count(update.header.stamp) == 1) seen_raw += pointsOnArm(*raw_[update.header.stamp]) > 200 ? 1 : 0;
    most_masked = std::max(most_masked, update.masked);
    ++moving;
  }
  EXPECT_GE(moving, 8);    // of 5 images a second
  EXPECT_GE(seen_raw, 4);  // without the filter
  EXPECT_GT(most_masked, 30000U);
  EXPECT_TRUE(waitUntil([this] { return mapped_.size() >= 3; }));  // the map takes these images

  is_relaying_ = false;
  ASSERT_TRUE(awaitUpdates(Update::JOINT_STATES_LATE, 2)) << updates_.back().message;
  EXPECT_TRUE(has(updates_.back().message, "must be at or after it")) << updates_.back().message;
  EXPECT_EQ(filtered_.count(updates_.back().header.stamp), 0U);
  is_relaying_ = true;
  ASSERT_TRUE(awaitUpdates(Update::ACCEPTED, 2)) << updates_.back().message;
}

}  // namespace
}  // namespace integration_tests
