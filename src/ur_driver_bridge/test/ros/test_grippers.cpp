// SPDX-License-Identifier: BSD-3-Clause
// The shipped grippers as plugins, against the services and topics of the arm's driver.
#include "ur_driver_bridge_ros/gripper.h"

#include <atomic>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/shipped_file.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include <pluginlib/class_loader.hpp>
#include <ros/ros.h>
#include <ur_msgs/IOStates.h>
#include <ur_msgs/SetIO.h>

#include "ur_driver_bridge_ros/output_grippers.h"

namespace ur_driver_bridge_ros {
namespace {

using node_tests::waitUntil;
using testing::HasSubstr;
using ur_driver_bridge::CallReply;
using ur_driver_bridge::GripperState;

// Of ur_msgs up to 1.3.4, and of 1.4.0 with its constants for pins. Source: ros-industrial/ur_msgs, generated with genmsg.
constexpr const char* kOld = "e1b580ccf43a938f2efbbb98bbe3e277";
constexpr const char* kNew = "f539fc0b1a42859fb186a5aaba22d4b0";

class Grippers : public testing::Test {
 protected:
  Grippers()
      : name_(std::string("/") + testing::UnitTest::GetInstance()->current_test_info()->name()),
        nh_(name_),
        publisher_(nh_.advertise<ur_msgs::IOStates>("ur_hardware_interface/io_states", 5)) {}

  void start(const std::string& type) {
    gripper_ = loader_.createUniqueInstance(type);
    gripper_->start(nh_, ros::NodeHandle(nh_, "own"), [this](const GripperState& state) { states_.push_back(state); });
  }

  /// What the gripper reports of these outputs and inputs.
  GripperState stateOf(int on_pin, double volts) {
    ur_msgs::IOStates io;
    for (int pin = 0; pin < 18; ++pin) {
      ur_msgs::Digital digital;
      digital.pin = static_cast<std::uint8_t>(pin);
      digital.state = pin == on_pin ? 1 : 0;
      io.digital_out_states.push_back(digital);
    }
    for (int pin = 0; pin < 2; ++pin) {
      ur_msgs::Analog analog;
      analog.pin = static_cast<std::uint8_t>(pin);
      analog.state = pin == 1 ? static_cast<float>(volts) : 0.0F;
      io.analog_in_states.push_back(analog);
    }
    EXPECT_TRUE(waitUntil([this] { return publisher_.getNumSubscribers() > 0; }));
    const std::size_t before = states_.size();
    publisher_.publish(io);
    EXPECT_TRUE(waitUntil([&] { return states_.size() > before; }));
    return states_.empty() ? GripperState() : states_.back();
  }

  /// A server whose messages may have another checksum: same bytes.
  ros::ServiceServer serveSetIo(const std::string& md5sum, bool success) {
    ros::AdvertiseServiceOptions options;
    options.init<ur_msgs::SetIO::Request, ur_msgs::SetIO::Response>(
        name_ + "/ur_hardware_interface/set_io",
        [this, success](ur_msgs::SetIO::Request& request, ur_msgs::SetIO::Response& response) {
          asked_ = request;
          response.success = success ? 1 : 0;
          return true;
        });
    options.md5sum = md5sum;
    return ros::NodeHandle().advertiseService(options);
  }

  /// set(), which blocks, while the server is served.
  CallReply set(bool is_on) {
    CallReply reply;
    std::atomic<bool> is_done{false};
    std::thread call([&] {
      reply = gripper_->set(is_on);
      is_done = true;
    });
    EXPECT_TRUE(waitUntil([&] { return is_done.load(); }));
    call.join();
    return reply;
  }

  const std::string name_;
  ros::NodeHandle nh_;
  ros::Publisher publisher_;
  pluginlib::ClassLoader<Gripper> loader_{"ur_driver_bridge", "ur_driver_bridge_ros::Gripper"};
  std::vector<GripperState> states_;
  ur_msgs::SetIO::Request asked_;
  pluginlib::UniquePtr<Gripper> gripper_;
};

TEST_F(Grippers, MagnetSetsOutputsOfDriversOldAndNew) {
  nh_.setParam("own/digital_output", 3);
  start("ur_driver_bridge/Magnet");
  for (const char* md5sum : {kOld, kNew}) {
    const ros::ServiceServer server = serveSetIo(md5sum, true);
    const CallReply reply = set(true);
    EXPECT_TRUE(reply.success) << md5sum << ": " << reply.message;
    EXPECT_EQ(asked_.fun, ur_msgs::SetIO::Request::FUN_SET_DIGITAL_OUT);
    EXPECT_EQ(asked_.pin, 3);
    EXPECT_EQ(asked_.state, 1.0F);
  }
}

TEST_F(Grippers, MagnetTellsARefusalFromSilence) {
  start("ur_driver_bridge/Magnet");
  {
    const ros::ServiceServer server = serveSetIo(kNew, false);
    const CallReply refused = set(false);
    EXPECT_FALSE(refused.success);
    EXPECT_FALSE(refused.is_gone);
  }
  EXPECT_TRUE(set(false).is_gone);
}

TEST_F(Grippers, MagnetReportsItsOutputAndNoHold) {
  nh_.setParam("own/digital_output", 16);
  start("ur_driver_bridge/Magnet");
  EXPECT_TRUE(stateOf(16, 5.0).is_on);
  EXPECT_FALSE(stateOf(3, 5.0).is_on);
  EXPECT_FALSE(states_.back().is_holding);
}

TEST_F(Grippers, VacuumHoldsBelowItsPressure) {
  nh_.setParam("own/analog_input", 1);
  nh_.setParam("own/kPa_at_zero", 25.0);  // of a sensor with 1 to 5 V
  nh_.setParam("own/kPa_per_unit", -25.0);
  nh_.setParam("own/hold_kPa", -50.0);
  start("ur_driver_bridge/Vacuum");
  EXPECT_EQ(stateOf(0, 1.0).is_holding, std::optional<bool>(false));
  EXPECT_EQ(stateOf(0, 2.9).is_holding, std::optional<bool>(false));  // -47.5 kPa
  EXPECT_EQ(stateOf(0, 3.1).is_holding, std::optional<bool>(true));   // -52.5 kPa
  EXPECT_TRUE(states_.back().is_on);
}

TEST_F(Grippers, VacuumWithoutASensorTellsNothing) {
  nh_.setParam("own/analog_input", -1);
  start("ur_driver_bridge/Vacuum");
  EXPECT_FALSE(stateOf(0, 5.0).is_holding);
}

TEST_F(Grippers, WrongParametersAreNamed) {
  nh_.setParam("own/hold_kPa", 40.0);
  nh_.setParam("own/suction", 1);
  try {
    start("ur_driver_bridge/Vacuum");
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("hold_kPa = 40 kPa, must be in [-100, -1] kPa"));
    EXPECT_THAT(error.what(), HasSubstr("suction is unknown"));
  }
}

TEST(GripperParams, ShippedFileIsWhatTheFieldsSay) {
  test_support::expectShippedFile<VacuumParams>(UR_DRIVER_BRIDGE_DIR "/config/vacuum.yaml");
}

}  // namespace
}  // namespace ur_driver_bridge_ros
