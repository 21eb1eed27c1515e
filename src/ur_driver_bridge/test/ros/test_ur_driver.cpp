// SPDX-License-Identifier: BSD-3-Clause
// The driver's client against services as other versions of the driver's messages have them.
#include <atomic>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include <actionlib/client/action_client.h>
#include <actionlib/server/action_server.h>
#include <control_msgs/FollowJointTrajectoryAction.h>
#include <gtest/gtest.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include "ur_driver_bridge_ros/ur_driver.h"

namespace ur_driver_bridge_ros {
namespace {

using ur_driver_bridge::CallReply;
using ur_driver_bridge::TrajectoryEvent;

/// Answers what it is told to.
struct FakeGripper : Gripper {
  void start(const ros::NodeHandle& /*nh*/, const ros::NodeHandle& /*own_nh*/, OnState /*on_state*/) override {}
  CallReply set(bool is_on) override {
    CallReply reply;
    reply.success = is_on;
    return reply;
  }
};

class UrDriverTest : public testing::Test {
 protected:
  UrDriverTest()
      : driver_(
            ros::NodeHandle(testing::UnitTest::GetInstance()->current_test_info()->name()), gripper_,
            [this](const CallReply& reply) {
              const std::lock_guard<std::mutex> lock(mutex_);
              replies_.push_back(reply);
            },
            [](const TrajectoryEvent&) {}) {}

  std::string nameOf(const std::string& service) const {
    return std::string("/") + testing::UnitTest::GetInstance()->current_test_info()->name() +
           "/ur_hardware_interface/" + service;
  }

  /// The reply, waiting for it.
  CallReply reply(std::size_t number) {
    constexpr double kDeadline_s = 20.0;
    const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(kDeadline_s);
    while (ros::WallTime::now() < end) {
      ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.005));
      const std::lock_guard<std::mutex> lock(mutex_);
      if (replies_.size() > number) return replies_[number];
    }
    ADD_FAILURE() << "no reply within " << kDeadline_s << " s";
    return {};
  }

  std::mutex mutex_;
  std::vector<CallReply> replies_;
  FakeGripper gripper_;
  UrDriver driver_;
};

TEST_F(UrDriverTest, ReportsWhatTheGripperAnswers) {
  for (const bool is_on : {true, false}) {
    const std::uint64_t id = is_on ? 7 : 8;
    driver_.setMagnet(id, is_on);
    const CallReply told = reply(id - 7);
    EXPECT_EQ(told.id, id);
    EXPECT_EQ(told.success, is_on);
  }
}

TEST_F(UrDriverTest, TellsOfSilence) {
  driver_.zeroForce(2);
  const CallReply told = reply(0);
  EXPECT_FALSE(told.success);
  EXPECT_TRUE(told.is_gone);
  EXPECT_NE(told.message.find(nameOf("zero_ftsensor")), std::string::npos) << told.message;
}

/// A controller that follows whatever it is given until it is cancelled.
class FollowingController {
 public:
  using Action = control_msgs::FollowJointTrajectoryAction;
  using Server = actionlib::ActionServer<Action>;

  explicit FollowingController(const std::string& ns)
      : server_(
            ros::NodeHandle(ns), "scaled_pos_joint_traj_controller/follow_joint_trajectory",
            [this](Server::GoalHandle goal) {
              goal.setAccepted();
              goals_.push_back(goal);
            },
            [](Server::GoalHandle goal) { goal.setCanceled(); }, false) {
    server_.start();
  }

  std::size_t numGoals() const { return goals_.size(); }
  bool isFollowed(std::size_t number) const {
    return goals_.at(number).getGoalStatus().status == actionlib_msgs::GoalStatus::ACTIVE;
  }

 private:
  std::vector<Server::GoalHandle> goals_;  // of the thread that spins
  Server server_;
};

/// Whether it comes true, while the global queue is served.
bool comesTrue(const std::function<bool()>& condition) {
  constexpr double kDeadline_s = 20.0;
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(kDeadline_s);
  while (!condition() && ros::WallTime::now() < end)
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.005));
  return condition();
}

// A bridge that is killed in mid-motion leaves the controller at work; the one that comes after it did not ask for that.
TEST(UrDriverAfterACrash, CancelsWhatItFindsAndNotWhatItSends) {
  const std::string ns = "/UrDriverAfterACrash";
  FollowingController controller(ns);
  actionlib::ActionClient<FollowingController::Action> crashed(
      ros::NodeHandle(ns), "scaled_pos_joint_traj_controller/follow_joint_trajectory");
  ASSERT_TRUE(comesTrue([&] { return crashed.isServerConnected(); }));
  const auto left_behind = crashed.sendGoal({});
  ASSERT_TRUE(comesTrue([&] { return controller.numGoals() == 1; }));
  ASSERT_TRUE(controller.isFollowed(0));

  FakeGripper gripper;
  UrDriver driver(
      ros::NodeHandle(ns), gripper, [](const CallReply&) {}, [](const TrajectoryEvent&) {});
  ASSERT_TRUE(comesTrue([&] { return driver.isControllerThere(); }));
  driver.send(1, {});  // at once: the two are on their way together
  ASSERT_TRUE(comesTrue([&] { return controller.numGoals() == 2 && !controller.isFollowed(0); }));
  EXPECT_TRUE(controller.isFollowed(1));
}

}  // namespace
}  // namespace ur_driver_bridge_ros
