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
#include <ur_msgs/SetIO.h>

#include "ur_driver_bridge_ros/ur_driver.h"

namespace ur_driver_bridge_ros {
namespace {

using ur_driver_bridge::CallReply;
using ur_driver_bridge::TrajectoryEvent;

// Of ur_msgs up to 1.3.4, and of 1.4.0 with its constants for pins. Source: ros-industrial/ur_msgs, generated with genmsg.
constexpr const char* kOld = "e1b580ccf43a938f2efbbb98bbe3e277";
constexpr const char* kNew = "f539fc0b1a42859fb186a5aaba22d4b0";

class UrDriverTest : public testing::Test {
 protected:
  UrDriverTest()
      : driver_(
            ros::NodeHandle(testing::UnitTest::GetInstance()->current_test_info()->name()), 3,
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

  /// A server whose messages have another checksum: same bytes.
  ros::ServiceServer serveSetIo(const std::string& md5sum, bool success) {
    ros::AdvertiseServiceOptions options;
    options.init<ur_msgs::SetIO::Request, ur_msgs::SetIO::Response>(
        nameOf("set_io"), [this, success](ur_msgs::SetIO::Request& request, ur_msgs::SetIO::Response& response) {
          asked_ = request;
          response.success = success ? 1 : 0;
          return true;
        });
    options.md5sum = md5sum;
    return ros::NodeHandle().advertiseService(options);
  }

  std::mutex mutex_;
  std::vector<CallReply> replies_;
  ur_msgs::SetIO::Request asked_;
  UrDriver driver_;
};

TEST_F(UrDriverTest, SetsOutputsOfDriversOldAndNew) {
  for (const char* md5sum : {kOld, kNew}) {
    const ros::ServiceServer server = serveSetIo(md5sum, true);
    driver_.setMagnet(7, true);
    const CallReply told = reply(replies_.size());
    EXPECT_TRUE(told.success) << md5sum << ": " << told.message;
    EXPECT_EQ(told.id, 7U);
    EXPECT_EQ(asked_.fun, ur_msgs::SetIO::Request::FUN_SET_DIGITAL_OUT);
    EXPECT_EQ(asked_.pin, 3);
    EXPECT_EQ(asked_.state, 1.0F);
  }
}

// The call itself succeeds: the answer says no.
TEST_F(UrDriverTest, TellsARefusalFromSilence) {
  {
    const ros::ServiceServer server = serveSetIo(kNew, false);
    driver_.setMagnet(1, false);
    const CallReply told = reply(0);
    EXPECT_FALSE(told.success);
    EXPECT_FALSE(told.is_gone);
  }
  driver_.zeroForce(2);
  const CallReply told = reply(1);
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

  UrDriver driver(
      ros::NodeHandle(ns), 0, [](const CallReply&) {}, [](const TrajectoryEvent&) {});
  ASSERT_TRUE(comesTrue([&] { return driver.isControllerThere(); }));
  driver.send(1, {});  // at once: the two are on their way together
  ASSERT_TRUE(comesTrue([&] { return controller.numGoals() == 2 && !controller.isFollowed(0); }));
  EXPECT_TRUE(controller.isFollowed(1));
}

}  // namespace
}  // namespace ur_driver_bridge_ros
