// SPDX-License-Identifier: BSD-3-Clause
// Candidates that are no segment of an outline: the robot's own pose, and poses that show unseen ground.
#include "nbv_selection/view_selector.h"

#include <algorithm>
#include <limits>
#include <stdexcept>

#include <gmock/gmock.h>

#include "support/box_scene.h"
#include "support/selection_setup.h"

namespace nbv_selection {
namespace {

using ::testing::HasSubstr;

const FailureMemory kNoFailures(0.1);
const std::vector<Eigen::Vector2d> kWorkspace{{-3.0, -3.0}, {3.0, -3.0}, {3.0, 3.0}, {-3.0, 3.0}};

BoxPile block() {
  BoxPile pile;
  pile.add({0.013, 0.007}, {1.1, 0.9, 0.3});
  return pile;
}

struct BlockSetup {
  BoxPile pile{block()};
  BoxScene scene{pile, eyesAround(8)};
  SelectionRequest request{requestOn(gridAround(pile), {-2.0, -1.5, 0.3})};

  Selection select(const FailureMemory& failures = kNoFailures, const ViewSelectorConfig& config = {}) const {
    return ViewSelector(config, pickingRobot()).select(scene, failures, request);
  }
  /// The robot drives to the best segment.
  ScoredSegment goToBest() {
    const Selection selection = select();
    const ScoredSegment best = selection.segments.at(selection.best.value());
    request.T_map_base = best.segment.standing_map;
    return best;
  }
};

std::vector<const ScoredSegment*> ofKind(SegmentKind kind, const Selection& selection) {
  std::vector<const ScoredSegment*> found;
  for (const ScoredSegment& scored : selection.segments) {
    if (scored.kind == kind) found.push_back(&scored);
  }
  return found;
}

TEST(ViewSelectorHere, OwnPoseIsACandidateOnlyWhereAsked) {
  BlockSetup setup;
  const ScoredSegment best = setup.goToBest();
  EXPECT_TRUE(ofKind(SegmentKind::kHere, setup.select()).empty());
  setup.request.may_stay = true;
  const Selection selection = setup.select();
  const auto here = ofKind(SegmentKind::kHere, selection);
  ASSERT_EQ(here.size(), 1U);
  EXPECT_EQ(here[0]->verdict, SegmentVerdict::kCandidate);
  EXPECT_EQ(here[0]->attributes.distance_m, 0.0);
  EXPECT_EQ(here[0]->attributes.manipulability, best.attributes.manipulability);
  EXPECT_EQ(here[0]->attributes.height_m, best.attributes.height_m);
  EXPECT_EQ(here[0]->attributes.frontier, best.attributes.frontier);
  EXPECT_EQ(here[0]->segment.standing_map.position(), setup.request.T_map_base.position());
}

TEST(ViewSelectorHere, RobotStaysWhereItIsBest) {
  BlockSetup setup;
  setup.goToBest();
  setup.request.may_stay = true;
  const Selection selection = setup.select();
  EXPECT_EQ(selection.segments.at(selection.best.value()).kind, SegmentKind::kHere);
}

TEST(ViewSelectorHere, OwnPoseOutOfReachIsNoCandidate) {
  BlockSetup setup;
  setup.request.may_stay = true;
  EXPECT_TRUE(ofKind(SegmentKind::kHere, setup.select()).empty());
}

TEST(ViewSelectorHere, FailureHereMovesTheChoiceAway) {
  BlockSetup setup;
  setup.goToBest();
  setup.request.may_stay = true;
  setup.request.now_s = 100.0;
  FailureMemory failures(0.1);
  failures.add(setup.request.T_map_base.position(), 0.3, 100.0);
  const Selection selection = setup.select(failures);
  EXPECT_EQ(ofKind(SegmentKind::kHere, selection).at(0)->utility.utility, 0.0);
  EXPECT_NE(selection.segments.at(selection.best.value()).kind, SegmentKind::kHere);
}

TEST(ViewSelectorHere, ExcludedPoseIsNoCandidate) {
  BlockSetup setup;
  setup.goToBest();
  setup.request.may_stay = true;
  setup.request.excluded = {{setup.request.T_map_base.position(), 0.01}};
  EXPECT_EQ(ofKind(SegmentKind::kHere, setup.select()).at(0)->verdict, SegmentVerdict::kExcluded);
}

TEST(ViewSelectorGround, UnseenGroundCompetesInOneUtility) {
  BlockSetup setup;
  setup.request.workspace_map = kWorkspace;
  const Selection selection = setup.select();
  const auto views = ofKind(SegmentKind::kGround, selection);
  ASSERT_FALSE(views.empty());
  EXPECT_GT(selection.unseen_m2, 1.0);
  int num_candidates = 0;
  for (const ScoredSegment* view : views) {
    if (view->verdict != SegmentVerdict::kCandidate) continue;
    ++num_candidates;
    EXPECT_EQ(view->attributes.manipulability, 0.0);
    EXPECT_EQ(view->attributes.height_m, 0.0);
    EXPECT_EQ(view->attributes.uncertainty, 0.0);
    EXPECT_GT(view->attributes.frontier, 0.0);
    EXPECT_NEAR(view->utility.utility, informationByHand(view->attributes, UtilityConfig()), 1e-12);
  }
  EXPECT_GT(num_candidates, 0);
}

TEST(ViewSelectorGround, WithoutAPileItLooksAtUnseenGround) {
  BlockSetup setup;
  setup.pile = {};
  setup.scene = BoxScene(setup.pile, {{0.0, 0.0, 1.3}});
  setup.request = requestOn(gridAround(setup.pile), {0.0, 0.0, 0.0});
  EXPECT_EQ(setup.select().status, SelectionStatus::kNoPile) << "no workspace";
  setup.request.workspace_map = kWorkspace;
  const Selection selection = setup.select();
  ASSERT_EQ(selection.status, SelectionStatus::kSelected) << selection.message;
  EXPECT_EQ(selection.segments.at(selection.best.value()).kind, SegmentKind::kGround);
}

TEST(ViewSelectorGround, SeenWorkspaceLeavesNoPile) {
  BlockSetup setup;
  setup.pile = {};
  setup.scene = BoxScene(setup.pile, {{0.0, 0.0, 1.3}});
  setup.request = requestOn(gridAround(setup.pile), {0.0, 0.0, 0.0});
  setup.request.workspace_map = {{-0.4, -0.4}, {0.4, -0.4}, {0.4, 0.4}, {-0.4, 0.4}};
  const Selection selection = setup.select();
  EXPECT_EQ(selection.status, SelectionStatus::kNoPile);
  EXPECT_EQ(selection.unseen_m2, 0.0);
}

TEST(ViewSelectorGround, NamesTheGroundThatNoPoseShows) {
  BlockSetup setup;
  setup.pile = {};
  setup.scene = BoxScene(setup.pile, {{0.0, 0.0, 1.3}});
  // Known ground ends 0.8 m around the robot, which stands in the middle of it: the camera's range ends before the workspace.
  setup.request = requestOn(gridAround(setup.pile, 0.8), {0.0, 0.0, 0.0});
  setup.request.workspace_map = {{5.0, 5.0}, {6.0, 5.0}, {6.0, 6.0}, {5.0, 6.0}};
  const Selection selection = setup.select();
  EXPECT_EQ(selection.status, SelectionStatus::kNoPile);
  EXPECT_THAT(selection.message, HasSubstr("no reachable pose shows the unseen ground of the workspace: 1.0 m^2 at"));
  EXPECT_EQ(selection.unseen_m2, 0.0) << "it cannot be seen";
}

// The robot may begin outside of what it is to clear.
TEST(ViewSelectorGround, StartOutsideTheWorkspaceIsAllowed) {
  BlockSetup setup;
  setup.request.workspace_map = {{0.0, 0.0}, {3.0, 0.0}, {3.0, 3.0}, {0.0, 3.0}};
  EXPECT_EQ(setup.select().status, SelectionStatus::kSelected);
}

TEST(ViewSelectorGround, RejectsAWorkspaceThatIsNoPolygonOrWithoutACamera) {
  BlockSetup setup;
  setup.request.workspace_map = {{0.0, 0.0}, {3.0, 0.0}};
  EXPECT_THROW(setup.select(), std::invalid_argument);
  setup.request.workspace_map = {{0.0, 0.0}, {3.0, std::numeric_limits<double>::infinity()}, {3.0, 3.0}};
  EXPECT_THROW(setup.select(), std::invalid_argument);
  setup.request.workspace_map = kWorkspace;
  RobotBody blind = pickingRobot();
  blind.T_base_camera.reset();
  EXPECT_THROW(ViewSelector({}, blind).select(setup.scene, kNoFailures, setup.request), std::invalid_argument);
}

}  // namespace
}  // namespace nbv_selection
