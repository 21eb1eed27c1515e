// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/mission_config.h"

#include <limits>

#include <gmock/gmock.h>

namespace pick_mission {
namespace {

using interactive_mapping::problemsOf;
using testing::ElementsAre;
using testing::IsEmpty;

TEST(MissionConfig, DefaultsAreValid) {
  EXPECT_THAT(problemsOf(MissionConfig{}), IsEmpty());
}

TEST(MissionConfig, SurveyNeedsAsManyOfEach) {
  MissionConfig config;
  config.survey.y_m.push_back(0.0);
  EXPECT_THAT(problemsOf(config), ElementsAre("survey/x_m, y_m, yaw_rad = 0, 1, 0 values, must be as many of each"));
  config.survey.x_m = config.survey.yaw_rad = {0.5};
  EXPECT_THAT(problemsOf(config), IsEmpty());
}

TEST(MissionConfig, WorkspaceIsAPolygonOrNone) {
  MissionConfig config;
  WorkspaceConfig& workspace = config.workspace;
  workspace.x_m = {0.0, 1.0};
  workspace.y_m.clear();
  EXPECT_THAT(problemsOf(config), ElementsAre("workspace/x_m, y_m = 2, 0 values, must be as many of each"));
  workspace.y_m = {0.0, 1.0};
  EXPECT_THAT(problemsOf(config), ElementsAre("workspace/x_m, y_m: the workspace has 2 corners, must have at least 3"));
  workspace.x_m = {0.0, 1.0, 1.0, 0.0};
  workspace.y_m = {0.0, 1.0, 0.0, 1.0};
  EXPECT_THAT(problemsOf(config), ElementsAre(testing::HasSubstr("the workspace crosses itself")));
  workspace.y_m[1] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(problemsOf(config), testing::Contains(testing::HasSubstr("workspace/y_m")));
  workspace.x_m.clear();
  workspace.y_m.clear();
  EXPECT_THAT(problemsOf(config), IsEmpty()) << "none is fine";
}

TEST(MissionConfig, WaitsAreShorterThanTheLimitOfAnAction) {
  MissionConfig config;
  config.views.fade_wait_s = config.time.action_timeout_s;
  EXPECT_THAT(problemsOf(config), ElementsAre("views/fade_wait_s must be less than time/action_timeout_s"));
  config.views.fade_wait_s = config.time.action_timeout_s - 1.0;
  EXPECT_THAT(problemsOf(config), IsEmpty());
}

}  // namespace
}  // namespace pick_mission
