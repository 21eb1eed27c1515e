// SPDX-License-Identifier: BSD-3-Clause
// Node nbv_selection among topics and services: every outcome, what it chooses, what it shows, bad input.
#include <array>
#include <atomic>
#include <condition_variable>
#include <cstdlib>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <set>

#include <actionlib_msgs/GoalStatusArray.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <gmock/gmock.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_msgs/ReportFailure.h>
#include <map_msgs/OccupancyGridUpdate.h>
#include <motion_planning_ros/robot_description.h>
#include <mp700_ur5e_description/base_profile.h>
#include <mp700_ur5e_description/robot_names.h>
#include <ros/ros.h>
#include <rosgraph_msgs/Log.h>
#include <std_srvs/Trigger.h>
#include <visualization_msgs/MarkerArray.h>

#include <interactive_mapping_common/testing/process.h>
#include <interactive_mapping_common_ros/testing/tuning.h>
#include "nbv_selection/gpis_scene.h"
#include "nbv_selection/octomap_scene.h"
#include "nbv_selection/view_selector.h"
#include "nbv_selection_ros/conversions.h"
#include "ros/selection_world.h"

namespace nbv_selection_ros {
namespace {

using actionlib::SimpleClientGoalState;
using interactive_mapping_msgs::NbvSegment;
using interactive_mapping_msgs::ReportFailure;
using interactive_mapping_msgs::SelectNextBestViewActionFeedback;
using nbv_selection::Selection;
using nbv_selection::ViewSelectorConfig;
using node_tests::Latest;
using node_tests::Process;
using node_tests::waitUntil;
using testing::AllOf;
using testing::HasSubstr;
using visualization_msgs::Marker;
using visualization_msgs::MarkerArray;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kStampError_s = 1e-6;  // a double holds ROS time of now to 0.3 us
constexpr char kGpis[] = "gpis";
constexpr char kFrontier[] = "octomap_gradient_frontier";
constexpr char kRandom[] = "octomap_random";

std::string describe(const SelectionOutcome& outcome) {
  return std::to_string(outcome.status) + " '" + outcome.message + "'";
}

#define EXPECT_OUTCOME(outcome, expected_status, message_matcher)                                                    \
  do {                                                                                                               \
    const SelectionOutcome seen = (outcome);                                                                         \
    EXPECT_EQ(static_cast<int>(seen.status), static_cast<int>(SelectionOutcome::expected_status)) << describe(seen); \
    EXPECT_THAT(seen.message, message_matcher);                                                                      \
  } while (false)

/// What the node reads from its files and the URDF.
nbv_selection::RobotBody robotOfTheFiles() {
  const auto kinematics = motion_planning_ros::kinematicsFromServer(ros::NodeHandle());
  nbv_selection::RobotBody robot;
  robot.footprint = mp700_ur5e_description::loadBaseProfile(BASE_PROFILE).body.footprint_m;
  robot.sectors = motion_planning::ManipulabilitySectors::load(SECTORS, kinematics->robot());
  robot.T_base_armbase = kinematics->robot().framePose(mp700_ur5e_description::kArmBaseFrame,
                                                       kinematics->robotPositions(motion_planning::ArmVector::Zero()));
  return robot;
}

/// The same choice without the node.
Selection chosenHere(const nbv_selection::SceneModel& scene, const ViewSelectorConfig& config,
                     const Eigen::Isometry3d& T_map_base, const std::vector<nbv_selection::ExcludedZone>& excluded = {},
                     std::uint64_t seed = 0) {
  nbv_selection::SelectionRequest request;
  request.ground = std::make_shared<const base_navigation::NavigationGrid>(groundAroundThePile());
  request.T_map_base = base_navigation_ros::toPlane(T_map_base);
  request.excluded = excluded;
  request.seed = seed;
  return nbv_selection::ViewSelector(config, robotOfTheFiles())
      .select(scene, nbv_selection::FailureMemory(0.1), request);
}

std::size_t numOf(const NbvSelection& selection, std::uint8_t verdict) {
  return static_cast<std::size_t>(std::count_if(selection.segments.begin(), selection.segments.end(),
                                                [verdict](const NbvSegment& s) { return s.verdict == verdict; }));
}

/// Numbers that came through messages: doubles, so but for sums in another order the same.
void expectSameNumber(double seen, double expected, const std::string& what) {
  if (std::isinf(expected)) {
    EXPECT_EQ(seen, expected) << what;
  } else {
    EXPECT_NEAR(seen, expected, 1e-9 * std::max(1e-3, std::abs(expected))) << what;
  }
}

void expectSame(const NbvSelection& message, const Selection& expected) {
  ASSERT_EQ(message.segments.size(), expected.segments.size());
  ASSERT_TRUE(expected.best);
  EXPECT_EQ(message.best, static_cast<int>(*expected.best));
  EXPECT_EQ(message.map_update, expected.map_update);
  for (std::size_t i = 0; i < message.segments.size(); ++i) {
    const NbvSegment& seen = message.segments[i];
    const nbv_selection::ScoredSegment& scored = expected.segments[i];
    const std::string at = "segment " + std::to_string(i);
    EXPECT_EQ(static_cast<int>(seen.kind), static_cast<int>(scored.kind)) << at;
    EXPECT_EQ(static_cast<int>(seen.verdict), static_cast<int>(scored.verdict)) << at;
    EXPECT_EQ(static_cast<int>(seen.outline), scored.segment.outline) << at;
    expectSameNumber(seen.midpoint.x, scored.segment.midpoint_map.x(), at);
    expectSameNumber(seen.midpoint.y, scored.segment.midpoint_map.y(), at);
    expectSameNumber(seen.midpoint.z, scored.segment.midpoint_map.z(), at);
    expectSameNumber(seen.direction.x, scored.segment.direction_map.x(), at);
    expectSameNumber(seen.direction.y, scored.segment.direction_map.y(), at);
    expectSameNumber(seen.outward.x, scored.segment.outward_map.x(), at);
    expectSameNumber(seen.outward.y, scored.segment.outward_map.y(), at);
    expectSameNumber(seen.length, scored.segment.length_m, at);
    EXPECT_EQ(seen.profile, scored.segment.profile_m) << at;
    expectSameNumber(seen.mean_uncertainty, scored.mean_uncertainty, at);
    expectSameNumber(seen.manipulability, scored.attributes.manipulability, at + " manipulability");
    expectSameNumber(seen.height, scored.attributes.height_m, at + " height");
    expectSameNumber(seen.distance, scored.attributes.distance_m, at + " distance");
    // Some 1e-5: to more digits than 1e-12.
    expectSameNumber(1e6 * seen.uncertainty, 1e6 * scored.attributes.uncertainty, at + " uncertainty");
    expectSameNumber(1e6 * seen.frontier, 1e6 * scored.attributes.frontier, at + " frontier");
    const auto& factors = scored.utility.factor_values;
    expectSameNumber(seen.manipulability_factor, factors[0], at);
    expectSameNumber(seen.pick_order_factor, factors[1], at);
    expectSameNumber(seen.travel_factor, factors[2], at);
    expectSameNumber(seen.uncertainty_factor, factors[3], at);
    expectSameNumber(seen.frontier_factor, factors[4], at);
    expectSameNumber(seen.information, scored.utility.information, at);
    expectSameNumber(seen.utility, scored.utility.utility, at);
    EXPECT_EQ(seen.failure_penalty, 0.0) << at;
  }
  std::size_t corner = 0;
  ASSERT_EQ(message.outline_sizes.size(), expected.outline.polygons.size());
  for (std::size_t i = 0; i < message.outline_sizes.size(); ++i) {
    ASSERT_EQ(message.outline_sizes[i], expected.outline.polygons[i].size());
    for (const Eigen::Vector2d& p : expected.outline.polygons[i]) {
      ASSERT_LT(corner, message.outline.size());
      expectSameNumber(message.outline[corner].x, p.x(), "outline");
      expectSameNumber(message.outline[corner].y, p.y(), "outline");
      ++corner;
    }
  }
  EXPECT_EQ(corner, message.outline.size());
}

interactive_mapping_msgs::ExcludedZone zoneAt(const Eigen::Vector3d& center, double radius_m) {
  interactive_mapping_msgs::ExcludedZone zone;
  zone.center.x = center.x();
  zone.center.y = center.y();
  zone.center.z = center.z();
  zone.radius = radius_m;
  return zone;
}

Eigen::Vector3d midpointOf(const NbvSegment& segment) {
  return {segment.midpoint.x, segment.midpoint.y, segment.midpoint.z};
}

const NbvSegment& bestOf(const SelectNextBestViewResult& result) {
  return result.selection.segments.at(static_cast<std::size_t>(result.selection.best));
}

/// Holds answers of the map back until it is opened.
/// Shared with the hook that passes it: the service's thread may be within it when the test has gone.
class Gate {
 public:
  /// Waits, on the service's thread; a test that fails before it opens must not hang.
  void pass() {
    std::unique_lock<std::mutex> lock(mutex_);
    has_come_ = true;
    changed_.wait_for(lock, std::chrono::seconds(30), [this] { return is_open_; });
  }
  bool hasCome() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return has_come_;
  }
  void open() {
    const std::lock_guard<std::mutex> lock(mutex_);
    is_open_ = true;
    changed_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool has_come_{false};
  bool is_open_{false};
};

bool tellsOf(const diagnostic_msgs::DiagnosticArray& array, const std::string& name, int level,
             const std::vector<std::string>& parts) {
  for (const auto& status : array.status) {
    if (!node_tests::has(status.name, name) || status.level != level) continue;
    if (std::all_of(parts.begin(), parts.end(),
                    [&status](const std::string& part) { return node_tests::has(status.message, part); })) {
      return true;
    }
  }
  return false;
}

class NbvSelectionNode : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    world_ = new SelectionWorld;
    main_ = new SelectionClient("/nbv_selection");
    pile_ = halfSeenPile();
    tree_ = halfSeenTree();
    ASSERT_TRUE(main_->connect());
    world_->setMap(pile_);
    world_->setTree(tree_);
    // tf and grid need a moment to be heard.
    ASSERT_TRUE(waitUntil([] { return main_->select(goalOf(kGpis)).outcome.status == SelectionOutcome::SUCCESS; }))
        << describe(main_->select(goalOf(kGpis)).outcome);
  }
  static void TearDownTestSuite() {
    delete main_;
    delete world_;
  }
  void SetUp() override {
    stamp_ = world_->setMap(pile_);
    tree_stamp_ = world_->setTree(tree_);
  }
  void TearDown() override {
    world_->setHook(nullptr);
    forget();
  }

  static void forget() {
    std_srvs::Trigger forget;
    EXPECT_TRUE(node_tests::call("/nbv_selection/forget_failures", forget) && forget.response.success);
  }

  /// In this test's map, not one that was there before.
  SelectNextBestViewGoal goalHere(const std::string& strategy) const {
    SelectNextBestViewGoal goal = goalOf(strategy);
    goal.min_map_stamp = strategy == kGpis ? stamp_ : tree_stamp_;
    return goal;
  }

  static inline SelectionWorld* world_ = nullptr;
  static inline SelectionClient* main_ = nullptr;
  static inline Snapshot pile_;
  static inline Tree tree_;
  ros::Time stamp_, tree_stamp_;
};

TEST_F(NbvSelectionNode, ChoosesInTheGpisMapWhatAViewSelectorChooses) {
  const SelectNextBestViewResult result = main_->select(goalHere(kGpis));
  ASSERT_EQ(main_->action.getState(), SimpleClientGoalState::SUCCEEDED) << describe(result.outcome);
  EXPECT_OUTCOME(result.outcome, SUCCESS, "");
  EXPECT_OUTCOME(result.selection.outcome, SUCCESS, "");
  const auto scene = nbv_selection::makeGpisScene(pile_, nbv_selection::GpisScene::Config());
  const Selection expected = chosenHere(*scene, ViewSelectorConfig(), world_->T_map_base);
  ASSERT_EQ(expected.status, nbv_selection::SelectionStatus::kSelected) << expected.message;
  expectSame(result.selection, expected);
  EXPECT_EQ(result.selection.strategy, kGpis);
  EXPECT_NEAR((result.selection.map_stamp - stamp_).toSec(), 0.0, kStampError_s);
  EXPECT_GT(numOf(result.selection, NbvSegment::IS_IMAGINARY), 0U) << "the far side: or the pile is not half seen";
  EXPECT_GT(numOf(result.selection, NbvSegment::CANDIDATE), 3U);
  EXPECT_EQ(result.cost, 0.0) << "real time costs what it costs";
  EXPECT_GT(result.wall_ms, 0.0F);

  // Where to stand: on the ground, the pile ahead.
  EXPECT_EQ(result.standing.header.frame_id, "map");
  EXPECT_EQ(result.selection.header.frame_id, "map");
  EXPECT_EQ(node_tests::bytesOf(result.standing.pose), node_tests::bytesOf(bestOf(result).standing));
  const auto T_map_standing = interactive_mapping_ros::toIsometry(result.standing.pose);
  ASSERT_TRUE(T_map_standing);
  const Eigen::Vector3d ahead = T_map_standing->inverse() * midpointOf(bestOf(result));
  // The footprint's front is at 0.296 m, the standoff 0.12 m; the ground's plane is found to a millimetre.
  EXPECT_NEAR(ahead.x(), 0.416, 2e-3);
  EXPECT_NEAR(ahead.y(), 0.0, 2e-3);
  EXPECT_NEAR(ahead.z(), 0.0, 5e-3);
  EXPECT_GT(T_map_standing->linear()(2, 2), 0.999) << "upright";
}

TEST_F(NbvSelectionNode, ChoosesInTheOctomapWhatAViewSelectorChooses) {
  const SelectNextBestViewResult result = main_->select(goalHere(kFrontier));
  ASSERT_EQ(main_->action.getState(), SimpleClientGoalState::SUCCEEDED) << describe(result.outcome);
  const nbv_selection::OctomapScene scene(tree_, 0, tree_stamp_.toSec(), nbv_selection::OctomapScene::Config());
  const Selection expected = chosenHere(scene, nbv_selection::octomapSelectorConfig(), world_->T_map_base);
  ASSERT_EQ(expected.status, nbv_selection::SelectionStatus::kSelected) << expected.message;
  expectSame(result.selection, expected);
  EXPECT_EQ(result.selection.strategy, kFrontier);
  EXPECT_NEAR((result.selection.map_stamp - tree_stamp_).toSec(), 0.0, kStampError_s);
  EXPECT_GT(numOf(result.selection, NbvSegment::IS_IMAGINARY), 0U);
}

TEST_F(NbvSelectionNode, DrawsAtRandomFromTheCandidatesOneSeedAfterTheOther) {
  const nbv_selection::OctomapScene scene(tree_, 0, tree_stamp_.toSec(), nbv_selection::OctomapScene::Config());
  ViewSelectorConfig config = nbv_selection::octomapSelectorConfig();
  config.choice = nbv_selection::Choice::kRandomCandidate;
  std::vector<int> drawn;
  for (int i = 0; i < 6; ++i) {
    const SelectNextBestViewResult result = main_->select(goalHere(kRandom));
    ASSERT_EQ(main_->action.getState(), SimpleClientGoalState::SUCCEEDED) << describe(result.outcome);
    EXPECT_EQ(result.selection.strategy, kRandom);
    EXPECT_EQ(static_cast<int>(bestOf(result).verdict), static_cast<int>(NbvSegment::CANDIDATE));
    drawn.push_back(result.selection.best);
  }
  // How many selections the node has made before is not known here, but it is few, and six draws of some ten candidates
  // tell one seed from another.
  std::vector<int> by_seed;
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    by_seed.push_back(static_cast<int>(chosenHere(scene, config, world_->T_map_base, {}, seed).best.value()));
  }
  EXPECT_NE(std::search(by_seed.begin(), by_seed.end(), drawn.begin(), drawn.end()), by_seed.end())
      << testing::PrintToString(drawn) << " in " << testing::PrintToString(by_seed);
  EXPECT_GT(std::set<int>(drawn.begin(), drawn.end()).size(), 1U);
}

TEST_F(NbvSelectionNode, TheFirstStrategyIsTheDefault) {
  const SelectNextBestViewResult result = main_->select(goalOf(""));
  EXPECT_OUTCOME(result.outcome, SUCCESS, "");
  EXPECT_EQ(result.selection.strategy, kGpis);
}

TEST_F(NbvSelectionNode, ImpossibleGoalsAreRefusedWithTheReason) {
  const SelectNextBestViewResult result = main_->select(goalOf("guess"));
  EXPECT_OUTCOME(result.outcome, BAD_GOAL,
                 "strategy = 'guess', must be one of gpis, octomap_gradient_frontier, octomap_random");
  EXPECT_EQ(main_->action.getState(), SimpleClientGoalState::ABORTED);
  EXPECT_EQ(result.selection.best, -1);
  EXPECT_EQ(result.selection.strategy, "guess");
  EXPECT_TRUE(std::isnan(result.standing.pose.position.x) && std::isnan(result.standing.pose.orientation.w));
  const auto outcomeOfZone = [](const Eigen::Vector3d& center, double radius_m, const std::string& frame = "map") {
    SelectNextBestViewGoal goal = goalOf(kGpis);
    goal.frame_id = frame;
    goal.excluded = {zoneAt(center, radius_m)};
    return main_->select(goal).outcome;
  };
  EXPECT_OUTCOME(outcomeOfZone({kNan, 1.0, 0.0}, 1.0), BAD_GOAL, HasSubstr("centre (nan, 1) and radius 1 m"));
  EXPECT_OUTCOME(outcomeOfZone({0.0, 1.0, 0.0}, kNan), BAD_GOAL, HasSubstr("radius nan m, must be finite"));
  EXPECT_OUTCOME(outcomeOfZone({0.0, 1.0, 0.0}, -0.5), BAD_GOAL,
                 HasSubstr("radius -0.5 m, must be finite, the radius"));
  EXPECT_OUTCOME(outcomeOfZone({0.0, 1.0, 0.0}, 1.0, "nowhere"), BAD_GOAL, HasSubstr("frame_id 'nowhere': "));
  EXPECT_OUTCOME(outcomeOfZone({9.0, 9.0, 0.0}, 1.0, "/map"), SUCCESS, "");
}

TEST_F(NbvSelectionNode, ExcludedZonesMoveTheChoiceInWhateverFrameTheyAre) {
  const SelectNextBestViewResult before = main_->select(goalHere(kGpis));
  ASSERT_EQ(main_->action.getState(), SimpleClientGoalState::SUCCEEDED);
  const Eigen::Vector3d center_map = midpointOf(bestOf(before));
  constexpr double kRadius_m = 0.2;
  const auto scene = nbv_selection::makeGpisScene(pile_, nbv_selection::GpisScene::Config());
  const Selection expected = chosenHere(*scene, ViewSelectorConfig(), world_->T_map_base,
                                        {{Eigen::Vector2d(center_map.head<2>()), kRadius_m}});
  SelectNextBestViewGoal goal = goalHere(kGpis);
  for (const std::string frame : {"", "map", "odom"}) {
    goal.frame_id = frame;
    goal.excluded = {zoneAt(frame == "odom" ? world_->T_map_odom.inverse() * center_map : center_map, kRadius_m)};
    const SelectNextBestViewResult result = main_->select(goal);
    ASSERT_EQ(main_->action.getState(), SimpleClientGoalState::SUCCEEDED) << describe(result.outcome);
    expectSame(result.selection, expected);
    EXPECT_NE(result.selection.best, before.selection.best);
    EXPECT_GT((midpointOf(bestOf(result)) - center_map).norm(), kRadius_m);
    EXPECT_GT(numOf(result.selection, NbvSegment::EXCLUDED), 0U);
  }
  goal.excluded = {zoneAt(Eigen::Vector3d::Zero(), 1.0), zoneAt(center_map, 20.0)};
  const SelectNextBestViewResult none = main_->select(goal);
  EXPECT_OUTCOME(none.outcome, NO_CANDIDATE, AllOf(HasSubstr("excluded"), HasSubstr("imaginary")));
  EXPECT_EQ(none.selection.best, -1);
  EXPECT_EQ(none.selection.segments.size(), before.selection.segments.size()) << "each with its reason";
  EXPECT_TRUE(std::isnan(none.standing.pose.position.x));
}

TEST_F(NbvSelectionNode, FeedbackTellsEachStageAndHowManySegments) {
  std::vector<SelectNextBestViewActionFeedback> heard;
  const ros::Subscriber subscriber = ros::NodeHandle().subscribe<SelectNextBestViewActionFeedback>(
      "/nbv_selection/select/feedback", 20,
      [&heard](const SelectNextBestViewActionFeedback::ConstPtr& message) { heard.push_back(*message); });
  ASSERT_TRUE(waitUntil([&subscriber] { return subscriber.getNumPublishers() == 1; }));
  for (const std::string strategy : {kGpis, kFrontier}) {
    // The connection may be there on this side only: until something has come, and then once more.
    std::string id;
    SelectNextBestViewResult result;
    const auto ofTheLast = [&] {
      std::vector<std::pair<std::string, std::size_t>> stages;
      for (const auto& message : heard) {
        if (message.status.goal_id.id == heard.back().status.goal_id.id) {
          stages.emplace_back(message.feedback.stage, message.feedback.segments);
        }
      }
      return stages;
    };
    ASSERT_TRUE(waitUntil([&] {
      heard.clear();
      main_->select(goalHere(strategy));
      return !heard.empty();
    }));
    heard.clear();
    result = main_->select(goalHere(strategy));
    ASSERT_EQ(main_->action.getState(), SimpleClientGoalState::SUCCEEDED);
    ASSERT_TRUE(waitUntil([&] { return !heard.empty() && heard.back().feedback.stage == "choice"; }));
    const std::size_t count = result.selection.segments.size();
    EXPECT_THAT(ofTheLast(),
                testing::ElementsAre(std::make_pair("surface", 0U), std::make_pair("outline", 0U),
                                     std::make_pair("uncertainty", count), std::make_pair("manipulability", count),
                                     std::make_pair("travel", count), std::make_pair("choice", count)));
  }
}

TEST_F(NbvSelectionNode, TheLastSelectionStaysOnItsTopic) {
  const SelectNextBestViewResult result = main_->select(goalHere(kGpis));
  Latest<NbvSelection> late("/nbv_selection/selection");
  const auto bytesWithoutCount = [](NbvSelection selection) {
    selection.header.seq = 0;  // publishers count their messages in it
    return node_tests::bytesOf(selection);
  };
  EXPECT_EQ(bytesWithoutCount(late.await([](const NbvSelection&) { return true; })),
            bytesWithoutCount(result.selection));
  const SelectNextBestViewResult refused = main_->select(goalOf("guess"));
  EXPECT_EQ(bytesWithoutCount(late.awaitStamp(refused.selection.header.stamp)), bytesWithoutCount(refused.selection));
}

TEST_F(NbvSelectionNode, WaitsForAMapAsNewAsAskedFor) {
  const ros::Time wanted = ros::Time::now() + ros::Duration(1000.0);
  for (const std::string strategy : {kGpis, kFrontier}) {
    SelectNextBestViewGoal goal = goalOf(strategy);
    goal.min_map_stamp = wanted;
    main_->action.sendGoal(goal);
    ASSERT_TRUE(waitUntil([] { return main_->action.getState() == SimpleClientGoalState::ACTIVE; }));
    if (strategy == kGpis) {
      world_->setMap(otherPile(), [&](SurfaceMesh* mesh) { mesh->header.stamp = wanted; });
    } else {
      std_msgs::Header header;
      header.frame_id = "map";
      header.stamp = wanted;
      world_->setOctomap(octomap_baseline_ros::toFullMessage(*tree_, header));
    }
    const SelectNextBestViewResult result = main_->await();
    EXPECT_OUTCOME(result.outcome, SUCCESS, "");
    EXPECT_NEAR((result.selection.map_stamp - wanted).toSec(), 0.0, kStampError_s);
  }
}

TEST_F(NbvSelectionNode, GivesUpOnAMapThatDoesNotCome) {
  const ros::Time wanted = ros::Time::now() + ros::Duration(1000.0);
  for (const std::string strategy : {kGpis, kFrontier}) {
    SelectNextBestViewGoal goal = goalOf(strategy);
    goal.min_map_stamp = wanted;
    const ros::WallTime sent = ros::WallTime::now();
    const SelectNextBestViewResult result = main_->select(goal);
    EXPECT_OUTCOME(
        result.outcome, STALE_MAP,
        AllOf(HasSubstr("asked for is one of " + std::to_string(wanted.toSec())), HasSubstr("input/map_wait_s")));
    EXPECT_GE((ros::WallTime::now() - sent).toSec(), 1.0) << "input/map_wait_s of this test";
    EXPECT_TRUE(result.selection.segments.empty());
  }
}

TEST_F(NbvSelectionNode, AMapWithoutAPileSaysSo) {
  SelectNextBestViewGoal goal = goalOf(kGpis);
  goal.min_map_stamp = world_->setMap(nbv_selection_test::MapSamples().snapshot());
  SelectNextBestViewResult result = main_->select(goal);
  EXPECT_OUTCOME(result.outcome, EMPTY_MAP, HasSubstr("no surface"));
  EXPECT_EQ(result.selection.best, -1);
  EXPECT_EQ(main_->action.getState(), SimpleClientGoalState::ABORTED);
  goal.min_map_stamp = world_->setMap(groundOnly());
  EXPECT_OUTCOME(main_->select(goal).outcome, NO_PILE, HasSubstr("0.04 m above the ground"));
  nbv_selection_test::MapSamples wall;
  wall.addRectangle({0.0, -0.5, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0});
  goal.min_map_stamp = world_->setMap(wall.snapshot());
  EXPECT_OUTCOME(main_->select(goal).outcome, NO_GROUND, HasSubstr("level plane"));

  goal.strategy = kFrontier;
  goal.min_map_stamp = world_->setTree(std::make_shared<octomap::OcTree>(0.02));
  EXPECT_OUTCOME(main_->select(goal).outcome, EMPTY_MAP, HasSubstr("no surface"));
}

TEST_F(NbvSelectionNode, AMapThatDoesNotAnswerRightIsNamed) {
  const auto spoiled = [this](const SelectionWorld::Hook& hook) {
    world_->setHook(hook);
    return main_->select(goalHere(kGpis)).outcome;
  };
  EXPECT_OUTCOME(spoiled([](const auto&, QueryMap::Response* answer) {
                   answer->success = 0;
                   answer->message = "out of order";
                 }),
                 STALE_MAP, HasSubstr("/map/query: out of order"));
  EXPECT_OUTCOME(spoiled([](const auto&, QueryMap::Response* answer) { answer->prior_variance = 0.0; }), STALE_MAP,
                 AllOf(HasSubstr("/map/query says that the prior's variance is 0.0"), HasSubstr("must be above 0")));
  EXPECT_OUTCOME(spoiled([](const auto&, QueryMap::Response* answer) { answer->prior_variance = kNan; }), STALE_MAP,
                 HasSubstr("/map/query says that the prior's variance is nan"));
  const std::vector<std::pair<std::string, std::function<void(QueryMap::Response*)>>> cuts{
      {"distance", [](auto* answer) { answer->distance.pop_back(); }},
      {"gradient", [](auto* answer) { answer->gradient.pop_back(); }},
      {"euclidean_distance", [](auto* answer) { answer->euclidean_distance.pop_back(); }},
      {"euclidean_gradient", [](auto* answer) { answer->euclidean_gradient.pop_back(); }},
      {"surface_std", [](auto* answer) { answer->surface_std.pop_back(); }},
      {"state", [](auto* answer) { answer->state.clear(); }},
      {"variance", [](auto* answer) { answer->variance.pop_back(); }},
      {"occupancy", [](auto* answer) { answer->occupancy.push_back(0.0); }},
      {"variance_gradient", [](auto* answer) {
         if (!answer->variance_gradient.empty()) answer->variance_gradient.pop_back();
       }}};
  for (const auto& [what, cut] : cuts) {
    const auto hook = [cut = cut](const QueryMap::Request& request, QueryMap::Response* answer) {
      if (!request.points.empty()) cut(answer);
    };
    EXPECT_OUTCOME(spoiled(hook), STALE_MAP,
                   AllOf(HasSubstr("/map/query gave "), HasSubstr(" of " + what + " for "), HasSubstr(" points")));
  }
  // Numbers that are none: nothing is chosen by them, and nothing breaks.
  const SelectionOutcome outcome = spoiled([](const auto&, QueryMap::Response* answer) {
    std::fill(answer->distance.begin(), answer->distance.end(), kNan);
    std::fill(answer->variance.begin(), answer->variance.end(), kNan);
    std::fill(answer->euclidean_distance.begin(), answer->euclidean_distance.end(), kNan);
  });
  EXPECT_NE(static_cast<int>(outcome.status), static_cast<int>(SelectionOutcome::SUCCESS));
  world_->setHook(nullptr);
  world_->answerFrom(nullptr);
  EXPECT_OUTCOME(main_->select(goalHere(kGpis)).outcome, STALE_MAP, HasSubstr("the call of /map/query failed"));
  world_->answerFrom(pile_);
  EXPECT_OUTCOME(main_->select(goalHere(kGpis)).outcome, SUCCESS, "");
}

TEST_F(NbvSelectionNode, AMeshThatIsNoneIsNamed) {
  const auto spoiled = [](const std::function<void(SurfaceMesh*)>& spoil) {
    SelectNextBestViewGoal goal = goalOf(kGpis);
    goal.min_map_stamp = world_->setMap(pile_, spoil);
    return main_->select(goal).outcome;
  };
  EXPECT_OUTCOME(spoiled([](SurfaceMesh* mesh) { mesh->header.frame_id = "odom"; }), BAD_INPUT,
                 HasSubstr("the mesh's frame is 'odom', must be 'map' (map_frame)"));
  EXPECT_OUTCOME(spoiled([](SurfaceMesh* mesh) { mesh->normals.resize(6); }), STALE_MAP, HasSubstr("but 2 normals"));
  EXPECT_OUTCOME(spoiled([](SurfaceMesh* mesh) { mesh->variance.resize(5); }), STALE_MAP, HasSubstr("5 variances"));
  EXPECT_OUTCOME(spoiled([](SurfaceMesh* mesh) { mesh->mesh.vertices[3].x = kNan; }), SUCCESS, "");
  EXPECT_OUTCOME(spoiled([](SurfaceMesh*) {}), SUCCESS, "");
}

TEST_F(NbvSelectionNode, AnOctomapThatIsNoneIsNamed) {
  std_msgs::Header header;
  header.frame_id = "map";
  header.stamp = ros::Time::now();
  const auto spoiled = [&](const std::function<void(octomap_msgs::Octomap*)>& spoil) {
    octomap_msgs::Octomap message = octomap_baseline_ros::toFullMessage(*tree_, header);
    spoil(&message);
    world_->setOctomap(message);
    return main_->select(goalOf(kFrontier)).outcome;
  };
  EXPECT_OUTCOME(spoiled([](auto* map) { map->header.frame_id = "odom"; }), BAD_INPUT,
                 HasSubstr("the octomap's frame is 'odom', must be 'map' (map_frame)"));
  EXPECT_OUTCOME(spoiled([](auto* map) { map->id = "ColorOcTree"; }), STALE_MAP,
                 AllOf(HasSubstr("/octomap_full: "), HasSubstr("'ColorOcTree'")));
  EXPECT_OUTCOME(spoiled([](auto* map) { map->resolution = 0.0; }), STALE_MAP, HasSubstr("resolution is 0.0"));
  EXPECT_OUTCOME(spoiled([](auto* map) { map->resolution = 0.5; }), BAD_INPUT, HasSubstr("gradient_step_m"));
  EXPECT_OUTCOME(spoiled([](auto* map) { map->data.resize(map->data.size() / 2); }), STALE_MAP,
                 HasSubstr("/octomap_full: the octomap's data end within its nodes"));
  EXPECT_OUTCOME(spoiled([](auto*) {}), SUCCESS, "");
}

TEST_F(NbvSelectionNode, AMapThatChangesMeanwhileIsTakenAnew) {
  const Snapshot empty = nbv_selection_test::MapSamples().snapshot();
  const Snapshot other = otherPile();
  // While it is asked the first map goes; its successor comes.
  std::atomic<int> num_asked{0};
  ros::Time newer;
  world_->setHook([&](const QueryMap::Request& request, QueryMap::Response*) {
    if (request.points.empty() || num_asked++ != 0) return;
    newer = world_->setMap(other);
    world_->answerFrom(empty);  // at this moment: what was the pile is not there
    world_->setHook([&](const QueryMap::Request& next, QueryMap::Response*) {
      if (next.points.empty()) world_->answerFrom(other);  // the next attempt begins: with the prior's variance
    });
  });
  const SelectNextBestViewResult result = main_->select(goalHere(kGpis));
  EXPECT_OUTCOME(result.outcome, SUCCESS, "");
  EXPECT_NEAR((result.selection.map_stamp - newer).toSec(), 0.0, kStampError_s);
  const auto scene = nbv_selection::makeGpisScene(other, nbv_selection::GpisScene::Config());
  expectSame(result.selection, chosenHere(*scene, ViewSelectorConfig(), world_->T_map_base));
}

TEST_F(NbvSelectionNode, AMapThatChangesAgainAndAgainIsGivenUp) {
  const Snapshot empty = nbv_selection_test::MapSamples().snapshot();
  std::atomic<int> num_attempts{0};
  world_->setHook([&](const QueryMap::Request& request, QueryMap::Response*) {
    if (request.points.empty()) {
      ++num_attempts;
      return;
    }
    world_->setMap(pile_);
    world_->answerFrom(empty);
  });
  const SelectNextBestViewResult result = main_->select(goalHere(kGpis));
  EXPECT_OUTCOME(result.outcome, MAP_CHANGED, HasSubstr("the map changed during the selection: 100 %"));
  EXPECT_EQ(num_attempts, 3) << "max_attempts";
  EXPECT_EQ(result.selection.best, -1);
  // It changes and no mesh says how: what is missing is a newer one.
  stamp_ = world_->setMap(pile_);
  world_->setHook([&](const QueryMap::Request& request, QueryMap::Response*) {
    if (!request.points.empty()) world_->answerFrom(empty);
  });
  EXPECT_OUTCOME(main_->select(goalHere(kGpis)).outcome, STALE_MAP, HasSubstr("the map's newest image is of "));
}

TEST_F(NbvSelectionNode, IsCancelledWhileItWaits) {
  for (const std::string strategy : {kGpis, kFrontier}) {
    SelectNextBestViewGoal goal = goalOf(strategy);
    goal.min_map_stamp = ros::Time::now() + ros::Duration(1000.0);
    main_->action.sendGoal(goal);
    ASSERT_TRUE(waitUntil([] { return main_->action.getState() == SimpleClientGoalState::ACTIVE; }));
    main_->action.cancelGoal();
    const SelectNextBestViewResult result = main_->await();
    // It asks an OctoMap's server again and again meanwhile, and may be met at either.
    EXPECT_OUTCOME(
        result.outcome, CANCELLED,
        testing::AnyOf(HasSubstr("while waiting for the map"), HasSubstr("cancelled while /octomap_full was asked")));
    EXPECT_EQ(main_->action.getState(), SimpleClientGoalState::PREEMPTED);
    EXPECT_EQ(result.selection.best, -1);
  }
}

// The map need not answer for that.
TEST_F(NbvSelectionNode, IsCancelledWhileItThinks) {
  const auto gate = std::make_shared<Gate>();
  world_->setHook([gate](const auto&, auto*) { gate->pass(); });
  main_->action.sendGoal(goalHere(kGpis));
  ASSERT_TRUE(waitUntil([gate] { return gate->hasCome(); }));
  main_->action.cancelGoal();
  const SelectNextBestViewResult result = main_->await();
  EXPECT_OUTCOME(result.outcome, CANCELLED, HasSubstr("cancelled while /map/query was asked"));
  EXPECT_EQ(main_->action.getState(), SimpleClientGoalState::PREEMPTED);
  EXPECT_TRUE(std::isnan(result.standing.pose.position.x));
  gate->open();
}

TEST_F(NbvSelectionNode, ANewGoalTakesTheOldOnesPlace) {
  SelectionClient second("/nbv_selection");
  ASSERT_TRUE(second.connect());
  const auto gate = std::make_shared<Gate>();
  world_->setHook([gate](const auto&, auto*) { gate->pass(); });
  main_->action.sendGoal(goalHere(kGpis));
  ASSERT_TRUE(waitUntil([gate] { return gate->hasCome(); }));
  second.action.sendGoal(goalHere(kFrontier));
  EXPECT_OUTCOME(main_->await().outcome, CANCELLED, HasSubstr("cancelled"));
  EXPECT_EQ(main_->action.getState(), SimpleClientGoalState::PREEMPTED);
  const SelectNextBestViewResult result = second.await();
  EXPECT_OUTCOME(result.outcome, SUCCESS, "");
  EXPECT_EQ(result.selection.strategy, kFrontier);
  gate->open();
}

class TunedSelection : public NbvSelectionNode {
 protected:
  void TearDown() override {
    const ViewSelectorConfig shipped;
    std::map<std::string, double> numbers;
    for (std::size_t i = 0; i < nbv_selection::kNumFactors; ++i) {
      const nbv_selection::FactorConfig& factor = shipped.utility.factors[i];
      const std::string name = toString(static_cast<nbv_selection::Factor>(i));
      numbers["weight_" + name] = factor.weight;
      numbers["logistic_" + name + "_l"] = factor.logistic.l;
      numbers["logistic_" + name + "_a"] = factor.logistic.a;
      numbers["logistic_" + name + "_b"] = factor.logistic.b;
    }
    EXPECT_EQ(node_tests::askForNumbers(kTune, numbers), numbers);
    NbvSelectionNode::TearDown();
  }

  void expectChosenBy(const ViewSelectorConfig& config, const SelectNextBestViewResult& result) const {
    const auto scene = nbv_selection::makeGpisScene(pile_, nbv_selection::GpisScene::Config());
    ASSERT_EQ(main_->action.getState(), SimpleClientGoalState::SUCCEEDED) << describe(result.outcome);
    expectSame(result.selection, chosenHere(*scene, config, world_->T_map_base));
  }

  static constexpr char kTune[] = "/nbv_selection/gpis/tune";
};

TEST_F(TunedSelection, EachStrategyOffersItsWeightsAndLogistics) {
  std::map<std::string, std::pair<double, double>> expected;
  for (const char* factor : {"manipulability", "pick_order", "travel", "uncertainty", "frontier"}) {
    const std::string name = factor;
    expected["weight_" + name] = {0.0, 1.0};
    expected["logistic_" + name + "_l"] = {1e-6, 10.0};
    expected["logistic_" + name + "_a"] = {0.0, 1e12};
    expected["logistic_" + name + "_b"] = {-1e9, 1e9};
  }
  for (const char* strategy : {kGpis, kFrontier, kRandom}) {
    EXPECT_EQ(node_tests::liveFieldsOf(std::string("/nbv_selection/") + strategy + "/tune"), expected) << strategy;
  }
}

TEST_F(TunedSelection, WeightsAndLogisticsChangeTheNextSelection) {
  const int untuned = main_->select(goalHere(kGpis)).selection.best;
  node_tests::tune(kTune,
                   "{weight_manipulability: 0.0, weight_pick_order: 1.0, weight_travel: 0.0, weight_uncertainty: 0.0, "
                   "weight_frontier: 0.0, logistic_pick_order_a: 23.3}");
  ViewSelectorConfig config;
  for (nbv_selection::FactorConfig& factor : config.utility.factors) factor.weight = 0.0;
  config.utility.of(nbv_selection::Factor::kPickOrder).weight = 1.0;
  config.utility.of(nbv_selection::Factor::kPickOrder).logistic.a = 23.3;
  const SelectNextBestViewResult tuned = main_->select(goalHere(kGpis));
  expectChosenBy(config, tuned);
  EXPECT_NE(tuned.selection.best, untuned) << "or it would show nothing";
  EXPECT_EQ(node_tests::askForNumbers("/nbv_selection/octomap_gradient_frontier/tune", {}).at("weight_travel"), 0.4);
}

TEST_F(TunedSelection, ASelectionKeepsTheWeightsOfItsStart) {
  const auto gate = std::make_shared<Gate>();
  world_->setHook([gate](const auto&, auto*) { gate->pass(); });
  main_->action.sendGoal(goalHere(kGpis));
  EXPECT_TRUE(waitUntil([&gate] { return gate->hasCome(); }));
  ViewSelectorConfig config;
  config.utility.of(nbv_selection::Factor::kTravel).weight = 0.5;
  config.utility.of(nbv_selection::Factor::kFrontier).weight = 0.1;
  const auto in_use = node_tests::askForNumbers(kTune, {{"weight_travel", 0.5}, {"weight_frontier", 0.1}});
  EXPECT_EQ(in_use.at("weight_travel"), 0.5);
  gate->open();
  expectChosenBy(ViewSelectorConfig(), main_->await());
  world_->setHook(nullptr);
  expectChosenBy(config, main_->select(goalHere(kGpis)));
}

TEST_F(TunedSelection, WeightsWithAnotherSumAreRefusedAsAWhole) {
  std::vector<std::string> errors;
  const ros::Subscriber log =
      ros::NodeHandle().subscribe<rosgraph_msgs::Log>("/rosout", 100, [&](const rosgraph_msgs::LogConstPtr& message) {
        if (message->name == "/nbv_selection" && message->level >= rosgraph_msgs::Log::ERROR) {
          errors.push_back(message->msg);
        }
      });
  const auto before = node_tests::askForNumbers(kTune, {});
  // Until the node knows that somebody listens.
  EXPECT_TRUE(waitUntil([&] {
    EXPECT_EQ(node_tests::askForNumbers(kTune, {{"weight_travel", 0.9}, {"logistic_travel_a", 2.0}}), before);
    return !errors.empty();
  }));
  EXPECT_THAT(errors, testing::Each(AllOf(HasSubstr("/nbv_selection/gpis/tune: tuning refused"),
                                          HasSubstr("weights: their sum = 1.5"))));
  expectChosenBy(ViewSelectorConfig(), main_->select(goalHere(kGpis)));
}

TEST_F(NbvSelectionNode, AMapThatHangsIsGivenUp) {
  const auto gate = std::make_shared<Gate>();
  world_->setHook([gate](const auto&, auto*) { gate->pass(); });
  EXPECT_OUTCOME(main_->select(goalHere(kGpis)).outcome, STALE_MAP,
                 AllOf(HasSubstr("/map/query has not answered for 5.0"), HasSubstr("input/answer_timeout_s")));
  gate->open();
  world_->setHook(nullptr);
  EXPECT_OUTCOME(main_->select(goalHere(kGpis)).outcome, SUCCESS, "");
}

ReportFailure::Response report(const Eigen::Vector3d& p, double radius_m, const std::string& frame = "map",
                               const ros::Time& stamp = ros::Time()) {
  ReportFailure failure;
  failure.request.pose.header.frame_id = frame;
  failure.request.pose.header.stamp = stamp;
  failure.request.pose.pose.position.x = p.x();
  failure.request.pose.pose.position.y = p.y();
  failure.request.pose.pose.position.z = p.z();
  failure.request.pose.pose.orientation.w = 1.0;
  failure.request.radius = radius_m;
  failure.request.reason = "a test";
  EXPECT_TRUE(node_tests::call("/nbv_selection/report_failure", failure));
  return failure.response;
}

TEST_F(NbvSelectionNode, FailuresMoveTheChoiceUntilTheyAreForgotten) {
  const SelectNextBestViewResult before = main_->select(goalHere(kGpis));
  ASSERT_EQ(main_->action.getState(), SimpleClientGoalState::SUCCEEDED);
  const Eigen::Vector3d place_map = midpointOf(bestOf(before));
  const auto best = static_cast<std::size_t>(before.selection.best);
  const auto penalised = [this] {
    std::set<std::size_t> found;
    const SelectNextBestViewResult result = main_->select(goalHere(kGpis));
    for (std::size_t i = 0; i < result.selection.segments.size(); ++i) {
      if (result.selection.segments[i].failure_penalty > 0.0) found.insert(i);
    }
    return found;
  };
  EXPECT_TRUE(penalised().empty());

  EXPECT_TRUE(report(place_map, 0.0).success);
  const SelectNextBestViewResult after = main_->select(goalHere(kGpis));
  ASSERT_EQ(main_->action.getState(), SimpleClientGoalState::SUCCEEDED) << describe(after.outcome);
  EXPECT_NE(after.selection.best, before.selection.best);
  // 0.99^t: some seconds at most have gone by.
  EXPECT_GT(after.selection.segments[best].failure_penalty, 0.6);
  EXPECT_LE(after.selection.segments[best].failure_penalty, 1.0);
  EXPECT_LT(after.selection.segments[best].utility, 0.4 * before.selection.segments[best].utility);
  const std::set<std::size_t> of_default_radius = penalised();
  EXPECT_LT(of_default_radius.size(), numOf(before.selection, NbvSegment::CANDIDATE)) << "or none is left to go to";
  forget();
  EXPECT_EQ(main_->select(goalHere(kGpis)).selection.best, before.selection.best);
  EXPECT_TRUE(penalised().empty());

  // failures/radius_m is 0.3; the same in another frame; more and less.
  EXPECT_TRUE(report(place_map, 0.3).success);
  EXPECT_EQ(penalised(), of_default_radius);
  forget();
  EXPECT_TRUE(report(world_->T_map_odom.inverse() * place_map, 0.0, "odom").success);
  EXPECT_EQ(penalised(), of_default_radius);
  forget();
  EXPECT_TRUE(report(place_map, 0.01).success);
  const std::set<std::size_t> of_small_radius = penalised();
  EXPECT_EQ(of_small_radius.count(best), 1U);
  EXPECT_LT(of_small_radius.size(), of_default_radius.size());
  EXPECT_TRUE(report(place_map, 1.0).success);
  EXPECT_GT(penalised().size(), of_default_radius.size());
  forget();

  // Long ago: 0.99^1000 = 4e-5.
  EXPECT_TRUE(report(place_map, 0.0, "map", ros::Time::now() - ros::Duration(1000.0)).success);
  EXPECT_EQ(main_->select(goalHere(kGpis)).selection.best, before.selection.best);
  EXPECT_EQ(penalised(), of_default_radius);

  // The clock of who reports may be ahead by a step.
  const ReportFailure::Response ahead = report(place_map, 0.0, "map", ros::Time::now() + ros::Duration(0.05));
  EXPECT_TRUE(ahead.success) << ahead.message;
}

TEST_F(NbvSelectionNode, ImpossibleFailuresAreRefusedWithTheReason) {
  const auto refusal = [](const ReportFailure::Response& response) {
    EXPECT_FALSE(response.success);
    return response.message;
  };
  EXPECT_THAT(refusal(report({kNan, 0.0, 0.0}, 0.3)), HasSubstr("nan"));
  EXPECT_THAT(refusal(report({0.0, 0.0, 0.0}, kNan)), HasSubstr("nan"));
  EXPECT_THAT(refusal(report({0.0, 0.0, 0.0}, -1.0)), HasSubstr("-1"));
  EXPECT_THAT(refusal(report({0.0, 0.0, 0.0}, 11.0)), HasSubstr("11"));
  EXPECT_THAT(refusal(report({1e9, 0.0, 0.0}, 0.3)), HasSubstr("1e+09"));
  EXPECT_THAT(refusal(report({0.0, 0.0, 0.0}, 0.3, "map", ros::Time::now() + ros::Duration(100.0))),
              HasSubstr("lies ahead of ROS time"));
  EXPECT_THAT(refusal(report({0.0, 0.0, 0.0}, 0.3, "nowhere")), HasSubstr("frame 'nowhere': "));
  const SelectNextBestViewResult result = main_->select(goalHere(kGpis));
  for (const NbvSegment& segment : result.selection.segments) EXPECT_EQ(segment.failure_penalty, 0.0);
}

bool isRed(const std_msgs::ColorRGBA& c) {
  return c.r > 0.8F && c.g < 0.3F && c.b < 0.3F;
}
bool isGrey(const std_msgs::ColorRGBA& c) {
  return c.r == c.g && c.g == c.b;
}
std::vector<Marker> ofNamespace(const MarkerArray& array, const std::string& ns) {
  std::vector<Marker> found;
  for (const Marker& marker : array.markers) {
    if (marker.ns == ns && marker.action == Marker::ADD) found.push_back(marker);
  }
  return found;
}

// Long: the same checks of each view in one selection.
TEST_F(NbvSelectionNode, EachViewShowsOutlineBarsAndTheBestInRed) {
  const std::vector<std::pair<std::string, std::function<double(const NbvSegment&)>>> views{
      {"utility", [](const NbvSegment& s) { return s.utility; }},
      {"manipulability", [](const NbvSegment& s) { return s.manipulability_factor; }},
      {"pick_order", [](const NbvSegment& s) { return s.height; }},
      {"travel", [](const NbvSegment& s) { return s.travel_factor; }},
      {"uncertainty", [](const NbvSegment& s) { return s.uncertainty_factor; }},
      {"frontier", [](const NbvSegment& s) { return s.frontier_factor; }}};
  const SelectNextBestViewResult result = main_->select(goalHere(kGpis));
  ASSERT_EQ(main_->action.getState(), SimpleClientGoalState::SUCCEEDED);
  const std::vector<NbvSegment>& segments = result.selection.segments;
  for (const auto& [view, value] : views) {
    SCOPED_TRACE(view);
    Latest<MarkerArray> markers("/nbv_selection/markers/" + view);
    const MarkerArray& array = markers.await([&](const MarkerArray& m) {
      return !m.markers.empty() && m.markers[0].header.stamp == result.selection.header.stamp;
    });
    ASSERT_FALSE(array.markers.empty());
    EXPECT_EQ(static_cast<int>(array.markers[0].action), static_cast<int>(Marker::DELETEALL)) << "what was before";
    std::set<std::pair<std::string, int>> ids;
    for (const Marker& marker : array.markers) {
      if (marker.action != Marker::ADD) continue;
      EXPECT_EQ(marker.header.frame_id, "map");
      EXPECT_TRUE(ids.insert({marker.ns, marker.id}).second) << marker.ns << " " << marker.id;
    }
    const std::vector<Marker> outline = ofNamespace(array, "outline");
    ASSERT_EQ(outline.size(), 1U);
    EXPECT_EQ(outline[0].points.size(), 2 * result.selection.outline.size()) << "a line from each corner to the next";
    EXPECT_TRUE(isRed(outline[0].color));

    // A bar where the segment is, as high as its value.
    const std::vector<Marker> bars = ofNamespace(array, "bars");
    std::size_t num_red = 0;
    std::size_t num_expected = 0;
    double highest_candidate = 0.0;
    for (const NbvSegment& segment : segments) {
      const bool is_imaginary = segment.verdict == NbvSegment::IS_IMAGINARY;
      if (segment.verdict == NbvSegment::CANDIDATE) highest_candidate = std::max(highest_candidate, value(segment));
      if (!is_imaginary && value(segment) <= 1e-3) continue;  // too low to be seen
      ++num_expected;
      const auto bar = std::find_if(bars.begin(), bars.end(), [&](const Marker& marker) {
        // Its foot is the middle of the segment, on ground that is level to a millirad.
        return std::hypot(marker.pose.position.x - segment.midpoint.x, marker.pose.position.y - segment.midpoint.y) <
               2e-3;
      });
      ASSERT_NE(bar, bars.end());
      EXPECT_EQ(isGrey(bar->color), is_imaginary);
      if (!is_imaginary) {
        EXPECT_NEAR(bar->scale.z, value(segment), 1e-9) << "1 m of a value of 1, or the height itself";
      }
      EXPECT_NEAR(bar->pose.position.z - 0.5 * bar->scale.z, segment.midpoint.z, 2e-3) << "stands on the ground";
      if (!isRed(bar->color)) continue;
      ++num_red;
      EXPECT_EQ(static_cast<int>(segment.verdict), static_cast<int>(NbvSegment::CANDIDATE));
    }
    EXPECT_EQ(bars.size(), num_expected);
    EXPECT_EQ(num_red, 1U);
    // The red one is the highest of those that can be gone to.
    const auto red = std::find_if(bars.begin(), bars.end(), [](const Marker& bar) { return isRed(bar.color); });
    ASSERT_NE(red, bars.end());
    EXPECT_NEAR(red->scale.z, highest_candidate, 1e-9);
    if (view == "utility") {
      EXPECT_NEAR(red->pose.position.x, bestOf(result).midpoint.x, 2e-3);
      EXPECT_NEAR(red->pose.position.y, bestOf(result).midpoint.y, 2e-3);
    }
    const std::vector<Marker> arrow = ofNamespace(array, "arrow");
    ASSERT_EQ(arrow.size(), 1U);
    ASSERT_EQ(arrow[0].points.size(), 2U);
    EXPECT_NEAR(arrow[0].points[1].x, red->pose.position.x, 3e-3) << "points at the red bar";
    EXPECT_NEAR(arrow[0].points[1].y, red->pose.position.y, 3e-3);
    ASSERT_EQ(ofNamespace(array, "standing").size(), 1U);
    EXPECT_EQ(ofNamespace(array, "standing")[0].points.size(), 7U) << "the footprint's six corners, closed";
    EXPECT_EQ(ofNamespace(array, "samples").size(), view == "manipulability" ? 1U : 0U);
    if (view == "manipulability") {
      EXPECT_GT(ofNamespace(array, "samples")[0].points.size(), 10U);
    }
  }
  // A selection without one leaves nothing to be taken for it.
  const SelectNextBestViewResult refused = main_->select(goalOf("guess"));
  Latest<MarkerArray> utility("/nbv_selection/markers/utility");
  const MarkerArray& cleared = utility.await([&](const MarkerArray& m) {
    return !m.markers.empty() && m.markers[0].header.stamp == refused.selection.header.stamp;
  });
  EXPECT_EQ(cleared.markers.size(), 1U);
}

TEST_F(NbvSelectionNode, FailuresAreShownUntilTheyAreForgotten) {
  Latest<MarkerArray> markers("/nbv_selection/markers/failures");
  ASSERT_TRUE(report({0.33, -0.21, 0.0}, 0.15).success);
  const MarkerArray& shown = markers.await([](const MarkerArray& m) { return !ofNamespace(m, "failures").empty(); });
  double area_m2 = 0.0;
  for (const Marker& square : ofNamespace(shown, "failures")) {
    const double size_m = square.scale.x / 0.95;  // a gap between neighbours
    area_m2 += size_m * size_m;
    // Cells of 0.1 m whose middle is in the circle: no part farther than its corner.
    EXPECT_LT(std::hypot(square.pose.position.x - 0.33, square.pose.position.y + 0.21), 0.15 + 0.1);
  }
  // Of a circle of 0.071 m^2, in cells of 0.01: within the cells of its border, some 2 pi r / 0.1 / 2.
  EXPECT_NEAR(area_m2, M_PI * 0.15 * 0.15, 0.05);
  forget();
  markers.await([](const MarkerArray& m) { return ofNamespace(m, "failures").empty(); });
}

TEST_F(NbvSelectionNode, DiagnosticsTellOfInputsAndSelections) {
  Latest<diagnostic_msgs::DiagnosticArray> diagnostics("/diagnostics");
  main_->select(goalOf("guess"));
  diagnostics.await([](const auto& array) { return tellsOf(array, "nbv_selection: inputs", 0, {"ready"}); });
  diagnostics.await([](const auto& array) {
    return tellsOf(array, "nbv_selection: selections", 0, {"guess: bad goal: strategy = 'guess'"});
  });
}

TEST_F(NbvSelectionNode, WithoutAMapItSaysWhichTopicAndServiceAreMissing) {
  Latest<diagnostic_msgs::DiagnosticArray> diagnostics("/diagnostics");
  SelectionClient blind("/blind");
  ASSERT_TRUE(blind.connect());
  // The grid and tf are the same as the others'.
  ASSERT_TRUE(waitUntil([&] { return blind.select(goalOf(kGpis)).outcome.status == SelectionOutcome::STALE_MAP; }));
  EXPECT_OUTCOME(blind.select(goalOf(kGpis)).outcome, STALE_MAP, "no service /blind/get_mesh");
  EXPECT_OUTCOME(blind.select(goalOf(kRandom)).outcome, STALE_MAP,
                 HasSubstr("no service /blind/octomap_full, or it does not answer"));
  diagnostics.await([](const auto& array) {
    return tellsOf(
        array, "blind: inputs", 1,
        {"gpis: the map has taken in no image (/blind/update)", "octomap_random: no service /blind/octomap_full"});
  });
  ros::CallbackQueue queue;
  ros::NodeHandle map_nh;
  map_nh.setCallbackQueue(&queue);
  ros::AsyncSpinner spinner(1, &queue);
  spinner.start();
  const boost::function<bool(GetMesh::Request&, GetMesh::Response&)> get_mesh = [](GetMesh::Request&,
                                                                                   GetMesh::Response& response) {
    response.mesh = SelectionWorld::meshOf(pile_, ros::Time::now());
    return true;
  };
  const ros::ServiceServer mesh = map_nh.advertiseService("/blind/get_mesh", get_mesh);
  EXPECT_OUTCOME(blind.select(goalOf(kGpis)).outcome, STALE_MAP, HasSubstr("no service /blind/query"));
  // The map's node ends.
  const boost::function<bool(QueryMap::Request&, QueryMap::Response&)> answer = [](QueryMap::Request& request,
                                                                                   QueryMap::Response& response) {
    SelectionWorld::answerFrom(*pile_, request, &response);
    return true;
  };
  ros::ServiceServer query = map_nh.advertiseService("/blind/query", answer);
  EXPECT_OUTCOME(blind.select(goalOf(kGpis)).outcome, SUCCESS, "");
  query.shutdown();
  EXPECT_OUTCOME(blind.select(goalOf(kGpis)).outcome, STALE_MAP, HasSubstr("no service /blind/query"));
}

TEST_F(NbvSelectionNode, WithoutPoseOrGroundItSaysWhatIsMissing) {
  SelectionClient lost("/lost");
  ASSERT_TRUE(lost.connect());
  Latest<diagnostic_msgs::DiagnosticArray> diagnostics("/diagnostics");
  EXPECT_OUTCOME(lost.select(goalOf("")).outcome, NO_POSE, AllOf(HasSubstr("tf: "), HasSubstr("lost_base")));
  diagnostics.await([](const auto& array) {
    return tellsOf(array, "lost: inputs", 1, {"lost_base", "no grid has come on /lost/grid"});
  });

  ros::NodeHandle nh;
  ros::Publisher tf = nh.advertise<tf2_msgs::TFMessage>("/tf", 10);
  /// `outcome` comes to what is expected once the node has heard what is published meanwhile.
  const auto becomes = [&](const std::function<void()>& publish, std::uint8_t status, const std::string& part) {
    SelectionOutcome outcome;
    EXPECT_TRUE(waitUntil([&] {
      publish();
      outcome = lost.select(goalOf("")).outcome;
      return outcome.status == status && node_tests::has(outcome.message, part);
    })) << describe(outcome)
        << ", not " << static_cast<int>(status) << " '" << part << "'";
  };
  const auto publishPose = [&](double age_s) {
    tf2_msgs::TFMessage message;
    message.transforms = {toTransform(world_->T_map_base, "map", "lost_base", ros::Time::now() - ros::Duration(age_s))};
    tf.publish(message);
  };
  becomes([&] { publishPose(5.0); }, SelectionOutcome::NO_POSE, "must be within 1.00 s (input/max_pose_age_s)");
  becomes([&] { publishPose(0.0); }, SelectionOutcome::STALE_GROUND, "no grid has come on /lost/grid");

  ros::Publisher grids = nh.advertise<nav_msgs::OccupancyGrid>("/lost/grid", 1);
  const auto publishGrid = [&](double age_s, const std::function<void(nav_msgs::OccupancyGrid*)>& spoil) {
    publishPose(0.0);
    std_msgs::Header header;
    header.frame_id = "map";
    header.stamp = ros::Time::now() - ros::Duration(age_s);
    nav_msgs::OccupancyGrid grid = base_navigation_ros::toMessage(groundAroundThePile(), header);
    if (spoil) spoil(&grid);
    grids.publish(grid);
  };
  becomes([&] { publishGrid(0.0, [](auto* grid) { grid->header.frame_id = "odom"; }); }, SelectionOutcome::BAD_INPUT,
          "the grid on /lost/grid: its frame is 'odom', must be 'map' (map_frame)");
  becomes([&] { publishGrid(0.0, [](auto* grid) { grid->data.pop_back(); }); }, SelectionOutcome::BAD_INPUT,
          "the grid on /lost/grid: 14399 values for 120 x 120 cells");
  becomes(
      [&] {
        publishGrid(0.0, [](auto* grid) {
          grid->info.origin.orientation.x = std::sin(0.1);
          grid->info.origin.orientation.w = std::cos(0.1);
        });
      },
      SelectionOutcome::BAD_INPUT, "the grid on /lost/grid: its origin is tilted by 0.2 rad");
  becomes([&] { publishGrid(0.0, [](auto* grid) { grid->info.origin.position.x = kNan; }); },
          SelectionOutcome::BAD_INPUT, "the grid on /lost/grid: its origin: pose is not finite");
  diagnostics.await([](const auto& array) {
    return tellsOf(array, "lost: inputs", 2, {"the grid on /lost/grid: its origin: pose is not finite"});
  });
  becomes([&] { publishGrid(10.0, nullptr); }, SelectionOutcome::STALE_GROUND,
          "must be within 5.00 s (input/max_grid_age_s)");
  becomes([&] { publishGrid(0.0, nullptr); }, SelectionOutcome::SUCCESS, "");
  // As old web clients and bags name it; a costmap's inflation is free ground.
  becomes(
      [&] {
        publishGrid(0.0, [](auto* grid) {
          grid->header.frame_id = "/map";
          std::replace(grid->data.begin(), grid->data.end(), std::int8_t{0}, std::int8_t{40});
        });
      },
      SelectionOutcome::SUCCESS, "");
  // Nowhere to stand.
  becomes([&] { publishGrid(0.0, [](auto* grid) { std::fill(grid->data.begin(), grid->data.end(), -1); }); },
          SelectionOutcome::NO_CANDIDATE, "on unknown ground");
  // A grid that is none does not take the place of the last good one, which grows old.
  becomes([&] { publishGrid(0.0, nullptr); }, SelectionOutcome::SUCCESS, "");
  // As costmap_2d publishes a part.
  ros::Publisher updates = nh.advertise<map_msgs::OccupancyGridUpdate>("/lost/grid_updates", 1);
  becomes(
      [&] {
        publishPose(0.0);
        map_msgs::OccupancyGridUpdate update;
        update.header.frame_id = "map";
        update.header.stamp = ros::Time::now();
        update.width = update.height = 120;
        update.data.assign(120 * 120, -1);
        updates.publish(update);
      },
      SelectionOutcome::NO_CANDIDATE, "on unknown ground");
  // As map_server publishes a map with a yaw: the same square, turned by a quarter.
  becomes(
      [&] {
        publishGrid(0.0, [](auto* grid) {
          grid->info.origin = base_navigation_ros::toPose(base_navigation::Pose2d{3.0, -3.0, M_PI_2});
        });
      },
      SelectionOutcome::SUCCESS, "");
}

TEST_F(NbvSelectionNode, StillChoosesAfterAllOfThis) {
  EXPECT_OUTCOME(main_->select(goalHere(kGpis)).outcome, SUCCESS, "");
  EXPECT_OUTCOME(main_->select(goalHere(kFrontier)).outcome, SUCCESS, "");
}

class NbvSelectionProcess : public testing::Test {
 protected:
  /// Parameters that are right, under that name.
  static void setUp(const std::string& name) {
    for (const char* key : {"base_profile_file", "sectors_file", "gpis"}) {
      XmlRpc::XmlRpcValue value;
      ASSERT_TRUE(ros::param::get(std::string("/nbv_selection/") + key, value));
      ros::param::set("/" + name + "/" + key, value);
    }
  }
  static std::string logOf(const std::string& name) { return std::string(::testing::TempDir()) + name + ".log"; }
};

TEST_F(NbvSelectionProcess, ImpossibleParametersEndItWithOneMessage) {
  const auto refusal = [](const std::string& name, const std::map<std::string, XmlRpc::XmlRpcValue>& params) {
    setUp(name);
    for (const auto& [key, value] : params) ros::param::set("/" + name + "/" + key, value);
    Process node({NBV_SELECTION_NODE, "__name:=" + name}, logOf(name));
    EXPECT_TRUE(waitUntil([&node] { return node.hasEnded(); })) << name;
    EXPECT_EQ(node.exitCode(), 1) << name;
    const std::string output = node.output();
    EXPECT_EQ(output.find("FATAL"), output.rfind("FATAL")) << output;
    return output;
  };
  const auto list = [](const std::vector<std::string>& names) {
    XmlRpc::XmlRpcValue value;
    value.setSize(static_cast<int>(names.size()));
    for (int i = 0; i < value.size(); ++i) value[i] = names[static_cast<std::size_t>(i)];
    return value;
  };
  EXPECT_THAT(refusal("two_problems", {{"max_attempts", 0}, {"inptu", 1.0}}),
              AllOf(HasSubstr("/two_problems/max_attempts = 0"), HasSubstr("/two_problems/inptu is unknown")));
  EXPECT_THAT(refusal("no_plugin", {{"strategies", list({"gpis", "dowsing"})}}),
              HasSubstr("strategies holds 'dowsing', but /no_plugin/dowsing/plugin is not set"));
  EXPECT_THAT(refusal("bad_plugin", {{"gpis/plugin", "nbv_selection/Dowsing"}}),
              AllOf(HasSubstr("/bad_plugin/gpis/plugin = 'nbv_selection/Dowsing', must be one of "),
                    HasSubstr("nbv_selection/Gpis"), HasSubstr("nbv_selection/Octomap")));
  EXPECT_THAT(
      refusal("bad_weights", {{"gpis/weights/travel", 0.5}, {"gpis/gamma_per_s", 2.0}}),
      AllOf(HasSubstr("/bad_weights/gpis/weights: their sum = 1.1"), HasSubstr("/bad_weights/gpis/gamma_per_s")));
  EXPECT_THAT(refusal("no_file", {{"sectors_file", "/no/such/file.yaml"}}),
              HasSubstr("sectors_file = '/no/such/file.yaml'"));
  EXPECT_THAT(refusal("wrong_file", {{"base_profile_file", SECTORS}}), HasSubstr("base_profile_file = '"));
}

TEST_F(NbvSelectionProcess, BesideAForeignNavigationItNeedsNoArm) {
  const std::string name = "foreign";
  setUp(name);
  ros::param::set("/" + name + "/sectors_file", "");
  {
    Process node({NBV_SELECTION_NODE, "__name:=" + name}, logOf(name));
    EXPECT_TRUE(waitUntil([&node] { return node.hasEnded(); }));
    EXPECT_THAT(node.output(), HasSubstr("weights/manipulability = 0.2, must be 0 without the arm's sectors"));
  }
  ros::param::set("/" + name + "/gpis/removed_factor", "manipulability");
  ros::param::set("/" + name + "/input/max_grid_age_s", 0.0);
  // A map server's: it comes once, stamped long ago.
  std_msgs::Header header;
  header.frame_id = "map";
  ros::Publisher grids = ros::NodeHandle().advertise<nav_msgs::OccupancyGrid>("/foreign/grid", 1, true);
  grids.publish(base_navigation_ros::toMessage(groundAroundThePile(), header));
  SelectionWorld world;
  world.setMap(halfSeenPile());
  Process node({NBV_SELECTION_NODE, "__name:=" + name, "robot_description:=/no_such_description", "grid:=/foreign/grid",
                "map/get_mesh:=/map/get_mesh", "map/query:=/map/query"},
               logOf(name));
  SelectionClient client("/" + name);
  ASSERT_TRUE(client.connect()) << node.output();
  SelectionOutcome outcome;
  EXPECT_TRUE(waitUntil([&] {
    outcome = client.select(goalOf(kGpis)).outcome;
    return outcome.status == SelectionOutcome::SUCCESS;
  })) << describe(outcome);
  node.signal(SIGTERM);
  EXPECT_TRUE(waitUntil([&node] { return node.hasEnded(); }));
}

TEST_F(NbvSelectionProcess, EndsWithZeroWhenItIsToldTo) {
  setUp("ended");
  setUp("ended_at_work");
  {
    Process node({NBV_SELECTION_NODE, "__name:=ended"}, logOf("ended"));
    SelectionClient client("/ended");
    ASSERT_TRUE(client.connect()) << node.output();
    node.signal(SIGTERM);
    ASSERT_TRUE(waitUntil([&node] { return node.hasEnded(); })) << node.output();
    EXPECT_EQ(node.exitCode(), 0) << node.output();
  }
  // While a goal waits for a map that does not come.
  ros::param::set("/ended_at_work/input/map_wait_s", 60.0);
  Process node({NBV_SELECTION_NODE, "__name:=ended_at_work"}, logOf("ended_at_work"));
  SelectionClient client("/ended_at_work");
  ASSERT_TRUE(client.connect()) << node.output();
  const SelectionWorld world;
  ASSERT_TRUE(waitUntil([&] {
    if (client.action.getState().isDone()) client.action.sendGoal(goalOf(kGpis));  // refused until tf has been heard
    return client.action.getState() == SimpleClientGoalState::ACTIVE;
  }));
  node.signal(SIGTERM);
  ASSERT_TRUE(waitUntil([&node] { return node.hasEnded(); }, 10.0)) << node.output();
  EXPECT_EQ(node.exitCode(), 0) << node.output();
}

}  // namespace
}  // namespace nbv_selection_ros
