// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common_ros/worker_action_server.h"

#include <atomic>
#include <string>

#include <gmock/gmock.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include <interactive_mapping_msgs/PlanArmAction.h>
#include <ros/spinner.h>

namespace interactive_mapping_ros {
namespace {

using actionlib_msgs::GoalStatus;
using interactive_mapping_msgs::PlanArmAction;
using interactive_mapping_msgs::PlanArmActionGoal;
using interactive_mapping_msgs::PlanArmActionResult;
using interactive_mapping_msgs::PlanArmResult;
using interactive_mapping_msgs::PlanOutcome;

// Callbacks of two topics run at once: the cancel's may come while the goal's is still handing the goal over.
// In this package, as interactive_mapping_common may not know an action whose result has an outcome.
TEST(WorkerActionServer, NoCancelIsLostThatComesRightAfterItsGoal) {
  constexpr int kGoals = 2000;
  constexpr double kLost_s = 2.0;
  ros::NodeHandle nh("plan");
  ros::CallbackQueue queue;
  ros::NodeHandle server_nh;
  server_nh.setCallbackQueue(&queue);
  std::atomic<int> lost{0};
  WorkerActionServer<PlanArmAction> server(
      server_nh, "plan", [&](const auto&, const ros::Time&, const auto& is_cancelled, const auto&) {
        PlanArmResult result;
        const ros::WallTime deadline = ros::WallTime::now() + ros::WallDuration(kLost_s);
        while (!is_cancelled() && ros::WallTime::now() < deadline) {
        }
        if (!is_cancelled()) ++lost;
        result.outcome.status = PlanOutcome::CANCELLED;
        return result;
      });
  std::string ended;
  const auto results = nh.subscribe<PlanArmActionResult>("result", 10, [&](const auto& result) {
    EXPECT_THAT(result->status.status, ::testing::AnyOf(GoalStatus::PREEMPTED, GoalStatus::RECALLED));
    ended = result->status.goal_id.id;
  });
  ros::Publisher goals = nh.advertise<PlanArmActionGoal>("goal", 10);
  ros::Publisher cancels = nh.advertise<actionlib_msgs::GoalID>("cancel", 10);
  ros::AsyncSpinner spinner(4, &queue);
  spinner.start();
  ASSERT_TRUE(node_tests::waitUntil([&] {
    return goals.getNumSubscribers() > 0 && cancels.getNumSubscribers() > 0 && results.getNumPublishers() > 0;
  }));
  for (int i = 0; i < kGoals && lost == 0; ++i) {
    PlanArmActionGoal goal;
    goal.goal_id.id = std::to_string(i);
    goal.goal_id.stamp = ros::Time::now();
    goals.publish(goal);
    actionlib_msgs::GoalID cancel;
    cancel.id = goal.goal_id.id;
    cancels.publish(cancel);
    ASSERT_TRUE(node_tests::waitUntil([&] { return ended == goal.goal_id.id; })) << i;
  }
  EXPECT_EQ(lost, 0);
  spinner.stop();
}

}  // namespace
}  // namespace interactive_mapping_ros
