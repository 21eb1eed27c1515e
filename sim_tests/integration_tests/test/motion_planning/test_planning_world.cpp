// SPDX-License-Identifier: BSD-3-Clause
// A brick of the simulated world, picked by plans made in the map and executed as they are: through the arm's own driver,
// with the truth as judge.
#include <cmath>
#include <map>
#include <optional>

#include <control_msgs/FollowJointTrajectoryAction.h>
#include <geometry_msgs/Twist.h>
#include <interactive_mapping_msgs/BrickFace.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <std_msgs/Int32.h>
#include <std_msgs/String.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>
#include <ur_msgs/SetIO.h>
#include <visualization_msgs/MarkerArray.h>

#include "planning_client.h"
#include "simulated_world/JudgeState.h"

namespace integration_tests {
namespace {

using control_msgs::FollowJointTrajectoryAction;
using interactive_mapping_msgs::AttachedBrick;
using interactive_mapping_msgs::BrickFace;
using interactive_mapping_msgs::MapUpdate;

constexpr double kDrive_s = 150.0;  // wall time for a way with map and physics on a busy machine

class PlanningWorld : public testing::Test {
 protected:
  PlanningWorld() : listener_(tf_), follow_("scaled_pos_joint_traj_controller/follow_joint_trajectory", false) {
    subscribers_.push_back(nh_.subscribe<visualization_msgs::MarkerArray>(
        "/simulated_world/truth", 10, [this](const visualization_msgs::MarkerArray::ConstPtr& markers) {
          for (const auto& marker : markers->markers) {
            if (marker.ns == "bricks") truth_[marker.id] = marker.pose;
          }
        }));
    subscribers_.push_back(nh_.subscribe<simulated_world::JudgeState>(
        "/simulated_world/judge", 10, [this](const simulated_world::JudgeState::ConstPtr& state) { judge_ = *state; }));
    subscribers_.push_back(nh_.subscribe<std_msgs::String>(
        "/simulated_world/incidents", 10,
        [this](const std_msgs::String::ConstPtr& text) { incidents_ += text->data + "\n"; }));
    subscribers_.push_back(
        nh_.subscribe<MapUpdate>("/gpis_mapping/update", 10, [this](const MapUpdate::ConstPtr& update) {
          if (update->status != MapUpdate::ACCEPTED) return;
          ++images_;
          geometry_msgs::Twist twist;
          twist.linear.x = speed_m_s_;
          drive_.publish(twist);
        }));
    subscribers_.push_back(nh_.subscribe<PathMonitorState>("/motion_planning/path_monitor", 10,
                                                           [this](const PathMonitorState::ConstPtr& state) {
                                                             if (state->must_stop != 0) stop_reason_ = state->reason;
                                                           }));
    drive_ = nh_.advertise<geometry_msgs::Twist>("/cmd_vel", 1);
    target_ = nh_.advertise<std_msgs::Int32>("/simulated_world/target", 1, true);
    attached_ = nh_.advertise<AttachedBrick>("/attached_brick", 1, true);
  }

  double baseX() {
    try {
      return tf_.lookupTransform("map", "base_link", ros::Time(0)).transform.translation.x;
    } catch (const tf2::TransformException&) {
      return -1e9;
    }
  }

  void driveTo(double x_m) {
    constexpr double kBraking_m = 0.42;  // from 0.4 m/s at 0.2 m/s^2, by hand; the base profile's rating brakes harder
    speed_m_s_ = 0.4;
    ASSERT_TRUE(waitUntil([&] { return baseX() > x_m - kBraking_m; }, kDrive_s));
    speed_m_s_ = 0.1;
    ASSERT_TRUE(waitUntil([&] { return baseX() > x_m - 0.02; }, kDrive_s));
    speed_m_s_ = 0.0;
    double last_x = -1e9;
    int before = images_;
    // Two images in a row from the same place.
    ASSERT_TRUE(waitUntil(
        [&] {
          if (images_ < before + 2) return false;
          before = images_;
          const bool stands = std::abs(baseX() - last_x) < 0.001;
          last_x = baseX();
          return stands;
        },
        kDrive_s));
  }

  /// Watched, and stopped when the monitor says so.
  void execute(const trajectory_msgs::JointTrajectory& trajectory, std::uint8_t phase,
               const geometry_msgs::PoseStamped& target) {
    WatchTrajectory watch;
    watch.request.trajectory = trajectory;
    watch.request.phase = phase;
    watch.request.target = target;
    watch.request.target_size.x = 0.30;
    watch.request.target_size.y = watch.request.target_size.z = 0.20;
    stop_reason_.clear();
    ASSERT_TRUE(call("/motion_planning/watch", watch));
    ASSERT_TRUE(watch.response.success) << watch.response.message;
    control_msgs::FollowJointTrajectoryGoal goal;
    goal.trajectory = trajectory;
    follow_.sendGoal(goal);
    ASSERT_TRUE(waitUntil(
        [&] {
          if (!stop_reason_.empty()) follow_.cancelGoal();
          return follow_.getState().isDone();
        },
        kDrive_s));
    EXPECT_EQ(stop_reason_, "") << "the monitor";
    EXPECT_EQ(follow_.getState(), actionlib::SimpleClientGoalState::SUCCEEDED)
        << follow_.getResult()->error_string << incidents_;
  }

  void leaveView() {
    PlanArmGoal inspect;
    inspect.inspect = 1;
    PlanArmResult result;
    // The planner may not have heard of the map yet, or still believe that it holds a brick.
    ASSERT_TRUE(waitUntil([&] {
      result = client_.plan(inspect);
      return result.outcome.status == PlanOutcome::SUCCESS;
    })) << result.outcome.message;
    execute(result.trajectory, WatchTrajectory::Request::FREE, geometry_msgs::PoseStamped());
  }

  void setMagnet(bool is_on) {
    ur_msgs::SetIO io;
    io.request.fun = ur_msgs::SetIO::Request::FUN_SET_DIGITAL_OUT;
    io.request.pin = 0;
    io.request.state = is_on ? 1.0F : 0.0F;
    ASSERT_TRUE(call("/ur_hardware_interface/set_io", io));
    ASSERT_TRUE(io.response.success);
  }

  ros::NodeHandle nh_;
  tf2_ros::Buffer tf_;
  tf2_ros::TransformListener listener_;
  std::vector<ros::Subscriber> subscribers_;
  ros::Publisher drive_, target_, attached_;
  actionlib::SimpleActionClient<FollowJointTrajectoryAction> follow_;
  PlanningClient client_;
  std::map<int, geometry_msgs::Pose> truth_;
  simulated_world::JudgeState judge_;
  std::string incidents_, stop_reason_;
  double speed_m_s_{0.0};
  int images_{0};
};

TEST_F(PlanningWorld, ABrickIsPickedAndStowedWithoutTouchingAnythingElse) {
  ASSERT_TRUE(client_.connect());
  ASSERT_TRUE(waitUntil([this] { return follow_.isServerConnected() && !truth_.empty() && images_ > 0; }, 60.0));
  // Stowed, the arm hides from the camera what is before the robot: a part of it would stay unknown.
  ASSERT_NO_FATAL_FAILURE(leaveView());
  // The front of the lower row is at -0.22 m, the robot's outline 0.296 m before base_link.
  driveTo(-0.22 - 0.296 - 0.12);

  // One of the two that lie on top.
  const int id = truth_.at(8).position.z > 0.25 ? 8 : 9;
  geometry_msgs::PoseStamped brick;
  brick.header.frame_id = "map";
  brick.pose = truth_.at(id);
  PlanPickGoal goal;
  goal.brick_id = id;
  goal.type = "brick";
  goal.brick = brick;
  goal.faces = {BrickFace::PLUS_Z};
  const PlanPickResult plan = client_.plan(goal);
  ASSERT_EQ(static_cast<int>(plan.outcome.status), static_cast<int>(PlanOutcome::SUCCESS)) << plan.outcome.message;
  EXPECT_DOUBLE_EQ(plan.cost, 0.5);

  std_msgs::Int32 target;
  target.data = id;
  target_.publish(target);
  ASSERT_NO_FATAL_FAILURE(execute(plan.approach, WatchTrajectory::Request::FREE, brick));
  ASSERT_NO_FATAL_FAILURE(setMagnet(true));
  ASSERT_NO_FATAL_FAILURE(execute(plan.touch, WatchTrajectory::Request::CONTACT, brick));

  AttachedBrick attached;
  attached.header.frame_id = "magnet_tip";
  attached.header.stamp = ros::Time::now();
  attached.is_attached = 1;
  attached.id = id;
  attached.type = "brick";
  attached.size.x = 0.30;
  attached.size.y = attached.size.z = 0.20;
  attached.pose = plan.held;
  attached_.publish(attached);
  ASSERT_NO_FATAL_FAILURE(execute(plan.lift, WatchTrajectory::Request::LIFT, brick));
  ASSERT_TRUE(waitUntil([&] { return truth_.at(id).position.z > brick.pose.position.z + 0.05; })) << incidents_;
  ASSERT_NO_FATAL_FAILURE(execute(plan.stow, WatchTrajectory::Request::FREE, brick));
  ASSERT_NO_FATAL_FAILURE(setMagnet(false));
  attached_.publish(AttachedBrick());
  EXPECT_TRUE(waitUntil([this] { return judge_.stowed == 1; }, 60.0)) << incidents_;

  // Back, out of the camera's view: the map sees that the brick is gone.
  ASSERT_NO_FATAL_FAILURE(leaveView());
  EXPECT_EQ(judge_.collisions, 0) << incidents_;
  EXPECT_EQ(judge_.drops, 0) << incidents_;
  EXPECT_EQ(judge_.falls, 0) << incidents_;
}

}  // namespace
}  // namespace integration_tests
