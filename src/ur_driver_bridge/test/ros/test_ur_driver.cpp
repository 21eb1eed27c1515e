// SPDX-License-Identifier: BSD-3-Clause
// The driver's client against services as other versions of the driver's messages have them.
#include <atomic>
#include <mutex>
#include <string>
#include <vector>

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

}  // namespace
}  // namespace ur_driver_bridge_ros

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_ur_driver");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
