// SPDX-License-Identifier: BSD-3-Clause
// Everything that simulation.launch starts, once through: drive to the pile, detect a brick, plan, pick, stow, look again.
// The test is the mission; the truth is the judge.
#include <algorithm>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <actionlib/client/simple_action_client.h>
#include <gtest/gtest.h>
#include <interactive_mapping_msgs/ArmBridgeState.h>
#include <interactive_mapping_msgs/BrickArray.h>
#include <interactive_mapping_msgs/MoveArmAction.h>
#include <interactive_mapping_msgs/PickBrickAction.h>
#include <interactive_mapping_msgs/PlanArmAction.h>
#include <interactive_mapping_msgs/PlanPickAction.h>
#include <move_base_msgs/MoveBaseAction.h>
#include <ros/ros.h>
#include <simulated_world/JudgeState.h>
#include <std_msgs/Header.h>
#include <std_msgs/Int32.h>
#include <std_msgs/String.h>

namespace {

using namespace interactive_mapping_msgs;

constexpr double kHeartbeat_s = 0.05;
constexpr double kStart_s = 120.0;   // wall time until all nodes are there
constexpr double kAction_s = 600.0;  // wall time for one action, with map and physics on a busy machine
constexpr double kFront_m = 0.296;   // of mp700_ur5e_description/config/base_profile.yaml
constexpr double kPile_m = -0.22;    // front of two_rows' lower row
constexpr double kStandOff_m = 0.12;
constexpr double kLook_s = 1.0;  // simulated time: five images

template <typename Action>
using Client = actionlib::SimpleActionClient<Action>;

class PickInSimulation : public testing::Test {
 protected:
  PickInSimulation()
      : drive_("/move_base", false),
        plan_pick_("/motion_planning/plan_pick", false),
        plan_arm_("/motion_planning/plan_arm", false),
        pick_("/ur_driver_bridge/pick", false),
        move_("/ur_driver_bridge/move", false) {
    subscribers_.push_back(nh_.subscribe<simulated_world::JudgeState>(
        "/simulated_world/judge", 10,
        [this](const simulated_world::JudgeState::ConstPtr& message) { judge_ = *message; }));
    subscribers_.push_back(nh_.subscribe<std_msgs::String>(
        "/simulated_world/incidents", 50,
        [this](const std_msgs::String::ConstPtr& message) { incidents_ += message->data + "\n"; }));
    subscribers_.push_back(nh_.subscribe<BrickArray>(
        "/brick_detection/bricks", 5, [this](const BrickArray::ConstPtr& message) { bricks_ = *message; }));
    subscribers_.push_back(nh_.subscribe<ArmBridgeState>(
        "/ur_driver_bridge/state", 50, [this](const ArmBridgeState::ConstPtr& message) { bridge_ = *message; }));
    target_ = nh_.advertise<std_msgs::Int32>("/simulated_world/target", 1, true);
    heartbeat_ = nh_.advertise<std_msgs::Header>("/pick_mission/heartbeat", 10);
    heart_ = nh_.createTimer(ros::Duration(kHeartbeat_s), [this](const ros::TimerEvent&) {
      std_msgs::Header header;
      header.stamp = ros::Time::now();
      heartbeat_.publish(header);
    });
  }

  static bool waitUntil(const std::function<bool()>& condition, double wall_s) {
    const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(wall_s);
    while (ros::ok() && ros::WallTime::now() < end) {
      if (condition()) return true;
      ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.005));
    }
    return condition();
  }

  template <typename Action, typename Goal>
  auto carryOut(Client<Action>& client, const Goal& goal) {
    client.sendGoal(goal);
    EXPECT_TRUE(waitUntil([&] { return client.getState().isDone(); }, kAction_s))
        << "no result; the bridge is in stage '" << bridge_.stage << "'\n"
        << incidents_;
    EXPECT_EQ(client.getState(), actionlib::SimpleClientGoalState::SUCCEEDED) << client.getState().getText() << "\n"
                                                                              << incidents_;
    const auto result = client.getResult();
    return result ? *result : typename Action::_action_result_type::_result_type();
  }

  /// Out of the camera's view.
  void inspect() {
    PlanArmGoal goal;
    goal.inspect = 1;
    const PlanArmResult plan = carryOut(plan_arm_, goal);
    MoveArmGoal motion;
    motion.trajectory = plan.trajectory;
    carryOut(move_, motion);
  }

  std::vector<Brick> highestFirst() const {
    std::vector<Brick> bricks;
    for (const Brick& brick : bricks_.bricks) {
      if (brick.has_duplicate == 0 && !brick.graspable_faces.empty()) bricks.push_back(brick);
    }
    std::stable_sort(bricks.begin(), bricks.end(),
                     [](const Brick& a, const Brick& b) { return a.pose.pose.position.z > b.pose.pose.position.z; });
    return bricks;
  }

  bool isKnown(int id) const {
    return std::any_of(bricks_.bricks.begin(), bricks_.bricks.end(), [id](const Brick& b) { return b.id == id; });
  }

  ros::NodeHandle nh_;
  std::vector<ros::Subscriber> subscribers_;
  ros::Publisher target_, heartbeat_;
  ros::Timer heart_;
  Client<move_base_msgs::MoveBaseAction> drive_;
  Client<PlanPickAction> plan_pick_;
  Client<PlanArmAction> plan_arm_;
  Client<PickBrickAction> pick_;
  Client<MoveArmAction> move_;
  simulated_world::JudgeState judge_;
  BrickArray bricks_;
  ArmBridgeState bridge_;
  std::string incidents_;
};

TEST_F(PickInSimulation, DrivesDetectsPlansPicksStowsAndForgets) {
  ASSERT_TRUE(waitUntil(
      [this] {
        return drive_.isServerConnected() && plan_pick_.isServerConnected() && plan_arm_.isServerConnected() &&
               pick_.isServerConnected() && move_.isServerConnected() && bridge_.may_move != 0 &&
               !bricks_.bricks.empty();
      },
      kStart_s))
      << "the bridge says: " << bridge_.reason << "; " << bricks_.bricks.size() << " bricks";

  // By way of places from which all of the pile can be seen: at the last one only its near edge is in the image, and what
  // nobody has seen by then the planner takes for occupied.
  ros::Time stands;
  for (const double distance_m : {1.0, 0.6, kStandOff_m}) {
    move_base_msgs::MoveBaseGoal place;
    place.target_pose.header.frame_id = "map";
    place.target_pose.pose.position.x = kPile_m - kFront_m - distance_m;
    place.target_pose.pose.orientation.w = 1.0;
    carryOut(drive_, place);
    ASSERT_FALSE(HasFailure());
    stands = ros::Time::now();
    ASSERT_TRUE(waitUntil([&] { return bricks_.header.stamp > stands + ros::Duration(kLook_s); }, kAction_s));
  }

  // Highest first, as method.md section 9 has it.
  ASSERT_FALSE(bricks_.bricks.empty());
  PlanPickGoal wanted;
  PlanPickResult plan;
  std::string failures;
  for (const Brick& brick : highestFirst()) {
    wanted.brick_id = brick.id;
    wanted.type = brick.type;
    wanted.brick.header.frame_id = bricks_.header.frame_id;
    wanted.brick.pose = brick.pose.pose;
    wanted.faces.clear();
    for (const BrickFace& face : brick.graspable_faces) wanted.faces.push_back(face.face);
    wanted.min_map_stamp = stands;
    plan_pick_.sendGoal(wanted);
    ASSERT_TRUE(waitUntil([&] { return plan_pick_.getState().isDone(); }, kAction_s));
    plan = *plan_pick_.getResult();
    if (plan.outcome.status == PlanOutcome::SUCCESS) break;
    failures += plan.outcome.message + "\n";
  }
  ASSERT_EQ(static_cast<int>(plan.outcome.status), static_cast<int>(PlanOutcome::SUCCESS)) << failures;
  std::cout << failures;
  const int id = wanted.brick_id;
  std_msgs::Int32 target;
  target.data = id;
  target_.publish(target);

  PickBrickGoal pick;
  pick.brick_id = id;
  pick.type = wanted.type;
  pick.brick = wanted.brick;
  pick.contact = plan.contact;
  pick.held = plan.held;
  pick.approach = plan.approach;
  pick.touch = plan.touch;
  pick.lift = plan.lift;
  pick.stow = plan.stow;
  pick.let_go = 1;
  const PickBrickResult picked = carryOut(pick_, pick);
  EXPECT_EQ(picked.outcome.message, "");
  EXPECT_NEAR(picked.load, 1.0, 0.2);  // of bricks.yaml
  EXPECT_TRUE(waitUntil([this] { return judge_.stowed == 1; }, kAction_s)) << incidents_;

  inspect();
  EXPECT_TRUE(waitUntil([&] { return !isKnown(id); }, kAction_s)) << "the brick is still believed to be there";
  EXPECT_EQ(judge_.collisions, 0) << incidents_;
  EXPECT_EQ(judge_.drops, 0) << incidents_;
  EXPECT_EQ(judge_.falls, 0) << incidents_;
}

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_pick_in_simulation");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
