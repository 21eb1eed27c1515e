// SPDX-License-Identifier: BSD-3-Clause
// Simulated time that a selection is charged: whatever the machine, a result comes that long after its goal.
#include <gmock/gmock.h>
#include <interactive_mapping_msgs/ReportFailure.h>
#include <ros/ros.h>
#include <rosgraph_msgs/Clock.h>
#include <std_srvs/Trigger.h>

#include "ros/selection_world.h"

namespace nbv_selection_ros {
namespace {

using actionlib::SimpleClientGoalState;
using node_tests::waitUntil;

constexpr double kCost_s = 0.3;  // as in nbv_selection.yaml

class NbvSelectionCost : public testing::Test {
 protected:
  NbvSelectionCost() : clock_(ros::NodeHandle().advertise<rosgraph_msgs::Clock>("/clock", 1, true)) { setClock(10.0); }

  void SetUp() override {
    ASSERT_TRUE(waitUntil([] { return ros::Time::now().toSec() == 10.0; }));
    world_ = std::make_unique<SelectionWorld>();
    world_->setMap(halfSeenPile());
    client_ = std::make_unique<SelectionClient>("/nbv_selection");
    ASSERT_TRUE(client_->connect());
    // Until map, grid and tf have been heard of, each goal fails, after its cost all the same.
    double now_s = 10.0;
    ASSERT_TRUE(waitUntil([&] {
      send();
      setClock(now_s += 5.0);
      waitUntil([&] { return isDone(); });
      return client_->action.getState() == SimpleClientGoalState::SUCCEEDED;
    }));
    start_s_ = now_s;
  }

  void setClock(double time_s) {
    rosgraph_msgs::Clock message;
    message.clock = ros::Time(time_s);
    clock_.publish(message);
    EXPECT_TRUE(waitUntil([time_s] { return ros::Time::now() == ros::Time(time_s); }));
  }
  void send(const std::string& strategy = "gpis") { client_->action.sendGoal(goalOf(strategy)); }
  bool isDone() { return client_->action.getState().isDone(); }

  ros::Publisher clock_;
  std::unique_ptr<SelectionWorld> world_;
  std::unique_ptr<SelectionClient> client_;
  double start_s_{0.0};
};

TEST_F(NbvSelectionCost, AResultWaitsForItsTimeAndForAClockNoLongerThanStated) {
  for (const std::string strategy : {"gpis", "guess"}) {  // a refusal is charged, too
    send(strategy);
    // Chosen it is within 0.1 s; half a second is for a result that does not wait to show itself.
    setClock(start_s_ + kCost_s - 0.01);
    EXPECT_FALSE(waitUntil([this] { return isDone(); }, 0.5));
    setClock(start_s_ + kCost_s);
    ASSERT_TRUE(waitUntil([this] { return isDone(); }));
    EXPECT_EQ(client_->action.getState(),
              strategy == "gpis" ? SimpleClientGoalState::SUCCEEDED : SimpleClientGoalState::ABORTED)
        << client_->action.getResult()->outcome.message;
    EXPECT_DOUBLE_EQ(client_->action.getResult()->cost, kCost_s);
    start_s_ += kCost_s;
  }

  // A clock that stands still, because its own rule allows selecting less time: nobody waits for ever.
  const ros::WallTime sent = ros::WallTime::now();
  send();
  ASSERT_TRUE(waitUntil([this] { return isDone(); }));
  EXPECT_GE((ros::WallTime::now() - sent).toSec(), 1.0) << "cost/stall_s of this test";
  EXPECT_EQ(client_->action.getState(), SimpleClientGoalState::SUCCEEDED);
}

TEST_F(NbvSelectionCost, FailuresOfBeforeTheClockRanBackAreForgotten) {
  interactive_mapping_msgs::ReportFailure failure;
  failure.request.pose.header.frame_id = "map";
  ASSERT_TRUE(node_tests::call("/nbv_selection/report_failure", failure));
  EXPECT_TRUE(failure.response.success) << failure.response.message;
  const ros::Time before_any_goal(5.0);
  setClock(before_any_goal.toSec());
  ASSERT_TRUE(waitUntil([&] {  // a goal may arrive before the clock's message does
    send();
    waitUntil([this] { return isDone(); });
    const auto result = client_->action.getResult();
    return result && result->selection.header.stamp == before_any_goal;
  }));
  std_srvs::Trigger forget;
  ASSERT_TRUE(node_tests::call("/nbv_selection/forget_failures", forget));
  EXPECT_EQ(forget.response.message, "0 failures forgotten");
}

}  // namespace
}  // namespace nbv_selection_ros
