// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission_ros/conversions.h"

#include <limits>

#include <gmock/gmock.h>
#include <interactive_mapping_common_ros/poses.h>
#include <motion_planning/arm_kinematics.h>
#include <mp700_ur5e_description/robot_model.h>
#include <mp700_ur5e_description/robot_names.h>

#include <interactive_mapping_common/testing/temporary_folder.h>

namespace pick_mission_ros {
namespace {

using interactive_mapping_msgs::Brick;
using interactive_mapping_msgs::BrickArray;
using interactive_mapping_msgs::MissionBrick;
using interactive_mapping_msgs::MissionState;
using interactive_mapping_msgs::NbvSegment;
using interactive_mapping_msgs::NbvSelection;
using interactive_mapping_ros::toPose;
using pick_mission::SeenBrick;
using test_support::messageOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinite = std::numeric_limits<double>::infinity();

/// The real sectors, and a place that they have on top for certain, found by trying.
class MissionConversions : public testing::Test {
 protected:
  void SetUp() override {
    const motion_planning::ArmKinematics arm(mp700_ur5e_description::RobotModel::load(URDF));
    sectors_ = motion_planning::ManipulabilitySectors::load(SECTORS, arm.robot());
    reach_.sectors = &sectors_;
    reach_.T_base_armbase = arm.robot().framePose(mp700_ur5e_description::kArmBaseFrame,
                                                  arm.robotPositions(motion_planning::ArmVector::Zero()));
    reach_.T_map_base = Eigen::Translation3d(1.0, -2.0, 0.0) * Eigen::AngleAxisd(2.0, Eigen::Vector3d::UnitZ());
    for (double x_m = 0.3; x_m < 2.0 && !has_place_; x_m += 0.05) {
      p_base_ = {x_m, 0.0, 0.3};
      has_place_ = sectors_.admits(p_base_, Eigen::Vector3d::UnitZ(), reach_.T_base_armbase);
    }
    ASSERT_TRUE(has_place_);
    array_.header.frame_id = "map";
  }

  /// With its top face at `p_base`.
  Brick brickAt(int id, const Eigen::Vector3d& p_base) const {
    Brick brick;
    brick.id = id;
    brick.type = "small";
    Eigen::Isometry3d T_map_top = reach_.T_map_base;
    T_map_top.translate(p_base);
    interactive_mapping_msgs::BrickFace face;
    face.face = interactive_mapping_msgs::BrickFace::PLUS_Z;
    face.pose = toPose(T_map_top);
    brick.graspable_faces = {face};
    brick.pose.pose = toPose(T_map_top * Eigen::Translation3d(0.0, 0.0, -0.05));
    return brick;
  }
  std::vector<SeenBrick> seen(const std::vector<int>& seen_now = {}) {
    complaints_.clear();
    return toSeenBricks(array_, seen_now, "map", reach_, &complaints_);
  }

  motion_planning::ManipulabilitySectors sectors_;
  Reach reach_;
  Eigen::Vector3d p_base_;
  bool has_place_{false};
  BrickArray array_;
  std::vector<std::string> complaints_;
};

TEST_F(MissionConversions, BricksComeWithAllThatIsKnown) {
  array_.header.frame_id = "/map";  // as others name it
  array_.bricks = {brickAt(7, p_base_), brickAt(9, p_base_ + Eigen::Vector3d(3.0, 0.0, 0.0))};
  array_.bricks[1].has_duplicate = true;
  const std::vector<SeenBrick> bricks = seen({9});
  ASSERT_THAT(bricks, SizeIs(2));
  EXPECT_EQ(bricks[0].id, 7);
  EXPECT_EQ(bricks[0].type, "small");
  EXPECT_THAT(bricks[0].graspable_faces, ElementsAre(interactive_mapping_msgs::BrickFace::PLUS_Z));
  EXPECT_TRUE(bricks[0].is_in_sector);
  EXPECT_FALSE(bricks[0].is_seen_now);
  EXPECT_FALSE(bricks[0].has_duplicate);
  const Eigen::Vector3d center = reach_.T_map_base * Eigen::Vector3d(p_base_ - Eigen::Vector3d(0.0, 0.0, 0.05));
  EXPECT_LT((bricks[0].T_map_brick.translation() - center).norm(), 1e-9);  // rounding of a quaternion
  EXPECT_FALSE(bricks[1].is_in_sector) << "3 m farther away than the arm reaches";
  EXPECT_TRUE(bricks[1].is_seen_now);
  EXPECT_TRUE(bricks[1].has_duplicate);
  EXPECT_THAT(complaints_, IsEmpty());
}

TEST_F(MissionConversions, AFaceThatIsNoneIsNotInTheSector) {
  array_.bricks = {brickAt(1, p_base_), brickAt(2, p_base_), brickAt(3, p_base_)};
  array_.bricks[0].graspable_faces[0].pose.position.x = kNan;
  array_.bricks[1].graspable_faces.clear();
  array_.bricks[2].graspable_faces.insert(array_.bricks[2].graspable_faces.begin(),
                                          array_.bricks[0].graspable_faces[0]);
  const std::vector<SeenBrick> bricks = seen();
  ASSERT_THAT(bricks, SizeIs(3));
  EXPECT_FALSE(bricks[0].is_in_sector);
  EXPECT_FALSE(bricks[1].is_in_sector);
  EXPECT_TRUE(bricks[2].is_in_sector) << "another face is";
}

TEST_F(MissionConversions, BricksWhosePoseIsNoneAreLeftOutAndNamed) {
  array_.bricks = {brickAt(1, p_base_), brickAt(2, p_base_), brickAt(3, p_base_)};
  array_.bricks[0].pose.pose.position.z = kInfinite;
  array_.bricks[1].pose.pose.orientation = geometry_msgs::Quaternion();
  const std::vector<SeenBrick> bricks = seen();
  ASSERT_THAT(bricks, SizeIs(1));
  EXPECT_EQ(bricks[0].id, 3);
  EXPECT_THAT(complaints_,
              ElementsAre(HasSubstr("brick 1 has an invalid pose"), HasSubstr("brick 2 has an invalid pose")));
}

TEST_F(MissionConversions, TwoBricksOfOneIdAreOneThatHasADuplicate) {
  array_.bricks = {brickAt(4, p_base_), brickAt(5, p_base_), brickAt(4, p_base_ + Eigen::Vector3d(0.1, 0.0, 0.0))};
  const std::vector<SeenBrick> bricks = seen();
  ASSERT_THAT(bricks, SizeIs(2));
  EXPECT_EQ(bricks[0].id, 4);
  EXPECT_TRUE(bricks[0].has_duplicate) << "though the detection does not say so";
  EXPECT_FALSE(bricks[1].has_duplicate);
}

TEST_F(MissionConversions, BricksInAnotherFrameAreRefused) {
  array_.header.frame_id = "odom";
  EXPECT_THAT(messageOf<std::invalid_argument>([this] { seen(); }), HasSubstr("in frame 'odom', must be 'map'"));
}

TEST(MissionStatus, IsRefusedBeyondItsRange) {
  EXPECT_EQ(statusFrom<pick_mission::PlanStatus>(13, 14, "outcome"), static_cast<pick_mission::PlanStatus>(13));
  EXPECT_THAT(messageOf<std::invalid_argument>([] { statusFrom<pick_mission::PlanStatus>(14, 14, "outcome"); }),
              HasSubstr("outcome = 14, must be less than 14"));
}

TEST_F(MissionConversions, GoalsOfPlanAndPickAreOfTheSameBrick) {
  array_.bricks = {brickAt(7, p_base_)};
  const SeenBrick brick = seen().front();
  const auto plan = toGoal(pick_mission::command::PlanPick{brick, 12.25, "place"}, "map");
  EXPECT_EQ(plan.brick_id, 7);
  EXPECT_EQ(plan.type, "small");
  EXPECT_EQ(plan.brick.header.frame_id, "map");
  EXPECT_TRUE(plan.brick.header.stamp.isZero()) << "the map's frame needs no tf of a moment";
  EXPECT_EQ(plan.faces, brick.graspable_faces);
  ASSERT_THAT(plan.stow, SizeIs(1));
  EXPECT_EQ(plan.stow[0].kind, interactive_mapping_msgs::ArmGoal::PLACE);
  EXPECT_EQ(plan.stow[0].place_frame, "place");
  EXPECT_EQ(plan.min_map_stamp, ros::Time(12.25));
  EXPECT_TRUE(toGoal(pick_mission::command::PlanPick{brick, -1.0, "place"}, "map").min_map_stamp.isZero());

  interactive_mapping_msgs::PlanPickResult result;
  result.contact.header.frame_id = "map";
  result.contact.pose.position.x = 1.0;
  result.held.position.z = 2.0;
  result.approach.points.resize(1);
  result.touch.points.resize(2);
  result.lift.points.resize(3);
  result.stow.points.resize(4);
  const auto pick = toGoal(brick, "map", result);
  EXPECT_EQ(pick.brick_id, 7);
  EXPECT_EQ(pick.type, "small");
  EXPECT_EQ(pick.brick, plan.brick);
  EXPECT_EQ(pick.contact, result.contact);
  EXPECT_EQ(pick.held, result.held);
  EXPECT_THAT(pick.approach.points, SizeIs(1));
  EXPECT_THAT(pick.touch.points, SizeIs(2));
  EXPECT_THAT(pick.lift.points, SizeIs(3));
  EXPECT_THAT(pick.stow.points, SizeIs(4));
  EXPECT_TRUE(pick.let_go);
}

TEST(MissionPoses, ComeBackFromTheMessage) {
  for (const double yaw_rad : {-3.1, -1.0, 0.0, 0.5, 3.1}) {
    const auto pose = toPose2d(toPose(pick_mission::Pose2d{1.0, -2.0, yaw_rad}));
    ASSERT_TRUE(pose);
    EXPECT_EQ(pose->x_m, 1.0);
    EXPECT_EQ(pose->y_m, -2.0);
    EXPECT_NEAR(pose->yaw_rad, yaw_rad, 1e-12);  // rounding of a quaternion
  }
  geometry_msgs::Pose none = toPose(pick_mission::Pose2d{1.0, kNan, 0.0});
  EXPECT_FALSE(toPose2d(none));
}

TEST(MissionSelections, BecomeALineInWhichWhatIsNotFiniteIsNull) {
  NbvSelection selection;
  selection.strategy = "gpis";
  selection.outcome.status = 10;
  selection.outcome.message = "low";
  selection.best = 1;
  selection.segments.resize(2);
  // Each its own, so that none is taken for another.
  NbvSegment& s = selection.segments[1];
  s.midpoint.x = 1.0;
  s.midpoint.y = 2.0;
  s.kind = NbvSegment::FRONTIER;
  s.verdict = NbvSegment::EXCLUDED;
  s.manipulability = 0.1;
  s.height = 0.2;
  s.distance = kInfinite;
  s.uncertainty = kNan;
  s.frontier = 0.5;
  s.manipulability_factor = 0.6;
  s.pick_order_factor = 0.7;
  s.travel_factor = 0.8;
  s.uncertainty_factor = 0.9;
  s.frontier_factor = 1.1;
  s.information = 1.2;
  s.failure_penalty = 1.3;
  s.utility = 1.4;
  const auto json = nlohmann::json::parse(toJson(selection, 3.5).dump());
  EXPECT_EQ(json.at("time_s"), 3.5);
  EXPECT_EQ(json.at("strategy"), "gpis");
  EXPECT_EQ(json.at("outcome"), 10);
  EXPECT_EQ(json.at("message"), "low");
  EXPECT_EQ(json.at("best"), 1);
  ASSERT_EQ(json.at("segments").size(), 2u);
  EXPECT_EQ(json.at("segments")[1], nlohmann::json::parse(R"({"midpoint": [1.0, 2.0], "kind": 1, "verdict": 2,
      "manipulability": 0.1, "height": 0.2, "distance": null, "uncertainty": null, "frontier": 0.5,
      "manipulability_factor": 0.6, "pick_order_factor": 0.7, "travel_factor": 0.8, "uncertainty_factor": 0.9,
      "frontier_factor": 1.1, "information": 1.2, "failure_penalty": 1.3, "utility": 1.4})"));
}

TEST(MissionStateMessage, TellsOfEachBrickHowItStands) {
  // Brick 1 was picked, 2 has used its attempts, 3 is open, 4 is away.
  nlohmann::json saved = pick_mission::MissionMachine({}, {}).toJson();
  pick_mission::BrickLedger ledger(3, 10);
  std::vector<SeenBrick> bricks(4);
  for (int i = 0; i < 4; ++i) bricks[static_cast<std::size_t>(i)].id = i + 1;
  ledger.update(bricks);
  ledger.pickBegun(1);
  ledger.picked(1);
  for (int i = 0; i < 3; ++i) ledger.pickFailed(2, "pick: NOT_ATTACHED");
  saved["bricks"] = ledger.toJson();
  const auto machine = pick_mission::MissionMachine::fromJson({}, {}, saved);
  const MissionState state = toMessage(machine, 3);
  EXPECT_EQ(state.state, MissionState::IDLE);
  EXPECT_EQ(state.brick, 3);
  EXPECT_EQ(state.bricks_picked, 1u);
  EXPECT_EQ(state.bricks_exhausted, 1u);
  ASSERT_THAT(state.bricks, SizeIs(4));
  EXPECT_EQ(state.bricks[0].status, MissionBrick::PICKED);
  EXPECT_EQ(state.bricks[0].picks_begun, 1);
  EXPECT_EQ(state.bricks[1].status, MissionBrick::EXHAUSTED);
  EXPECT_EQ(state.bricks[1].picks_failed, 3);
  EXPECT_EQ(state.bricks[1].last_failure, "pick: NOT_ATTACHED");
  EXPECT_EQ(state.bricks[2].status, MissionBrick::CURRENT);
  EXPECT_EQ(state.bricks[3].status, MissionBrick::AWAY) << "not seen since the restart";
  EXPECT_EQ(toMessage(machine, std::nullopt).brick, -1);
}

}  // namespace
}  // namespace pick_mission_ros
