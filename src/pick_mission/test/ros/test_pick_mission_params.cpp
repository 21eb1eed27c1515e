// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission_ros/pick_mission_params.h"

#include <gmock/gmock.h>
#include <ros/ros.h>

#include <interactive_mapping_common/testing/shipped_file.h>

namespace pick_mission_ros {
namespace {

using interactive_mapping::problemsOf;
using interactive_mapping::toYaml;
using test_support::messageOf;
using testing::Contains;
using testing::HasSubstr;
using testing::StartsWith;

TEST(PickMissionParams, ShippedFileIsWhatTheFieldsSay) {
  test_support::expectShippedFile<PickMissionParams>(PICK_MISSION_DIR "/config/pick_mission.yaml");
}

TEST(PickMissionParams, ShippedFileLoadsAsTheDefaults) {
  const PickMissionParams loaded = loadPickMissionParams(ros::NodeHandle("~shipped"));
  PickMissionParams expected;
  expected.sectors_file = loaded.sectors_file;  // what a launch file has to give
  expected.bricks_file = loaded.bricks_file;
  EXPECT_EQ(toYaml(loaded), toYaml(expected));
}

TEST(PickMissionParams, PaperLeavesTheChoiceToTheUtility) {
  const pick_mission::MissionConfig paper = loadPickMissionParams(ros::NodeHandle("~paper")).mission;
  EXPECT_THAT(paper.survey.x_m, testing::ElementsAre(1.2));
  EXPECT_TRUE(paper.workspace.x_m.empty());
  EXPECT_EQ(paper.bricks.order, pick_mission::BrickOrder::kNearest);
  EXPECT_EQ(paper.bricks.carriers_wait_views, 0);
  EXPECT_TRUE(paper.views.choose_after_each_pick);
  EXPECT_EQ(paper.views.exclusion_radius_m, 0.0);
  EXPECT_EQ(paper.views.leave_radius_m, 0.0);
  EXPECT_EQ(paper.views.max_vantage_drives, 0);
  EXPECT_EQ(paper.views.max_low_utility, 0);
  // More than a mission can use up in its time.
  EXPECT_THAT(std::vector<int>({paper.views.max_fade_waits, paper.views.max_fruitless,
                                paper.attempts.max_picks_per_brick, paper.attempts.max_plans_per_brick,
                                paper.attempts.max_pick_failures_per_view, paper.attempts.max_plan_failures_per_view}),
              testing::Each(pick_mission::kMost));
}

TEST(PickMissionParams, OneMessageNamesEveryProblemWithValueAndRange) {
  ros::NodeHandle nh("~wrong");
  nh.setParam("colour", true);
  nh.setParam("map_frame", "/map");
  nh.setParam("base_frame", "");
  nh.setParam("stow", std::vector<std::string>{"container", "/container"});
  nh.setParam("sectors_file", "sectors.yaml");
  nh.setParam("bricks_file", "bricks.yaml");
  nh.setParam("run_folder", "run");
  nh.setParam("autostart", "yes");
  nh.setParam("seed", 1.5);
  nh.setParam("survey/x_m", 0.6);
  nh.setParam("look/images", 0);
  nh.setParam("time/limit_s", -1.0);
  nh.setParam("heartbeat/rate_hz", 0.1);
  nh.setParam("heartbeat/max_stall_s", 0.0);
  nh.setParam("input/max_bridge_age_s", 0.0);
  nh.setParam("input/max_tf_age_s", 100.0);
  nh.setParam("servers/timeout_s", 0.0);
  nh.setParam("servers/service_timeout_s", 1e4);
  nh.setParam("servers/detect_stall_s", 0.5);
  nh.setParam("nodes/map", "");
  nh.setParam("nodes/planner", "two words");
  const std::string message = messageOf<std::invalid_argument>([&] { loadPickMissionParams(nh); });
  EXPECT_THAT(message, HasSubstr("/wrong/colour is unknown"));
  EXPECT_THAT(message, HasSubstr("/wrong/map_frame = '/map', must be a tf2 frame"));
  EXPECT_THAT(message, HasSubstr("/wrong/base_frame = '', must be a tf2 frame"));
  EXPECT_THAT(message, HasSubstr("/wrong/stow = '/container', must be a tf2 frame"));
  EXPECT_THAT(message, HasSubstr("/wrong/sectors_file = 'sectors.yaml', must be the absolute path"));
  EXPECT_THAT(message, HasSubstr("/wrong/bricks_file = 'bricks.yaml', must be the absolute path"));
  EXPECT_THAT(message, HasSubstr("/wrong/run_folder = 'run', must be the absolute path"));
  EXPECT_THAT(message, HasSubstr("/wrong/autostart"));
  EXPECT_THAT(message, HasSubstr("/wrong/seed"));
  EXPECT_THAT(message, HasSubstr("/wrong/survey/x_m"));
  EXPECT_THAT(message, HasSubstr("/wrong/look/images = 0, must be in [1, 1000]"));
  EXPECT_THAT(message, HasSubstr("/wrong/time/limit_s = -1 s, must be in [1, 86400] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/heartbeat/rate_hz = 0.1 Hz, must be in [1, 100] Hz"));
  EXPECT_THAT(message, HasSubstr("/wrong/heartbeat/max_stall_s = 0 s, must be in [0.5, 60] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/max_bridge_age_s = 0 s, must be in [0.05, 60] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/max_tf_age_s = 100 s, must be in [0.05, 60] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/servers/timeout_s = 0 s, must be in [0.5, 600] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/servers/service_timeout_s = 10000 s, must be in [0.5, 600] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/servers/detect_stall_s = 0.5 s, must be in [1, 3600] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/nodes/map = '', must be a name"));
  EXPECT_THAT(message, HasSubstr("/wrong/nodes/planner = 'two words', must be a name"));
}

TEST(PickMissionParams, FramesOfMapAndBaseAreTwo) {
  PickMissionParams params;
  params.base_frame = params.map_frame;
  EXPECT_THAT(problemsOf(params), Contains(HasSubstr("must be another frame than map_frame")));
}

TEST(PickMissionParams, FilesOfSectorsAndBricksMustBeGiven) {
  EXPECT_THAT(problemsOf(PickMissionParams()),
              testing::ElementsAre(StartsWith("sectors_file = '', must be"), StartsWith("bricks_file = '', must be")));
}

}  // namespace
}  // namespace pick_mission_ros
