// SPDX-License-Identifier: BSD-3-Clause
// Simulated time that a plan is charged: whatever the machine, a result comes that long after its goal.
#include <rosgraph_msgs/Clock.h>
#include <visualization_msgs/MarkerArray.h>

#include "planning_client.h"

namespace integration_tests {
namespace {

const ArmVector kStowed =
    mp700_ur5e_description::loadArmPose(std::string(MP700_UR5E_DESCRIPTION_DIR) + "/config/arm_poses/stowed.yaml");
constexpr double kCost_s = 0.3;  // as in motion_planning.yaml

class PlanningCost : public testing::Test {
 protected:
  PlanningCost() : clock_(ros::NodeHandle().advertise<rosgraph_msgs::Clock>("/clock", 1, true)) { setClock(10.0); }

  void SetUp() override {
    ASSERT_TRUE(waitUntil([] { return ros::Time::now().toSec() == 10.0; }));
    robot_ = std::make_unique<TopicRobot>(kStowed);
    robot_->setWorld(BoxWorld());
    client_ = std::make_unique<PlanningClient>();
    ASSERT_TRUE(client_->connect());
    PlanArmGoal posture;
    posture.goals.emplace_back().posture = "stowed";
    goal_ = posture;
    // Until map and robot have been heard of, each goal fails, after its cost all the same.
    double now_s = 10.0;
    ASSERT_TRUE(waitUntil([&] {
      client_->arm.sendGoal(goal_);
      setClock(now_s += 1.0);
      waitUntil([&] { return client_->arm.getState().isDone(); });
      return client_->arm.getState() == actionlib::SimpleClientGoalState::SUCCEEDED;
    }));
    start_s_ = ros::Time::now().toSec();
  }

  void setClock(double time_s) {
    rosgraph_msgs::Clock message;
    message.clock = ros::Time(time_s);
    clock_.publish(message);
  }
  bool isDone() { return client_->arm.getState().isDone(); }

  ros::Publisher clock_;
  std::unique_ptr<TopicRobot> robot_;
  std::unique_ptr<PlanningClient> client_;
  PlanArmGoal goal_;
  double start_s_{0.0};
};

TEST_F(PlanningCost, AResultWaitsForItsTimeAndForAClockNoLongerThanStated) {
  client_->arm.sendGoal(goal_);
  // Planned it is within milliseconds; half a second is for a result that does not wait to show itself.
  setClock(start_s_ + kCost_s - 0.01);
  EXPECT_FALSE(waitUntil([this] { return isDone(); }, 0.5));
  setClock(start_s_ + kCost_s);
  ASSERT_TRUE(waitUntil([this] { return isDone(); }));
  EXPECT_EQ(client_->arm.getState(), actionlib::SimpleClientGoalState::SUCCEEDED)
      << client_->arm.getResult()->outcome.message;
  EXPECT_DOUBLE_EQ(client_->arm.getResult()->cost, kCost_s);

  // A clock that stands still, because its own rule allows planning less time: nobody waits for ever.
  const ros::WallTime sent = ros::WallTime::now();
  client_->arm.sendGoal(goal_);
  ASSERT_TRUE(waitUntil([this] { return isDone(); }));
  EXPECT_GE((ros::WallTime::now() - sent).toSec(), 1.0) << "cost/stall_s of this test";
}

}  // namespace
}  // namespace integration_tests
