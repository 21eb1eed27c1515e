// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning_ros/motion_planning_params.h"

#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ros/ros.h>

#include <interactive_mapping_common/testing/shipped_file.h>

namespace motion_planning_ros {
namespace {

using interactive_mapping::problemsOf;
using interactive_mapping::toYaml;
using test_support::messageOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::UnorderedElementsAre;

TEST(MotionPlanningParams, ShippedFileIsWhatTheFieldsSay) {
  test_support::expectShippedFile<MotionPlanningParams>(MOTION_PLANNING_DIR "/config/motion_planning.yaml");
}

TEST(MotionPlanningParams, ShippedFileLoadsAsTheDefaults) {
  MotionPlanningParams expected;
  expected.bricks_file = "/bricks.yaml";  // what a launch file has to give
  expected.sectors_file = "/sectors.yaml";
  expected.postures_dir = "/postures";
  EXPECT_EQ(toYaml(loadMotionPlanningParams(ros::NodeHandle("~shipped"))), toYaml(expected));
}

TEST(MotionPlanningParams, OneMessageNamesEveryProblemWithValueAndRange) {
  ros::NodeHandle nh("~wrong");
  nh.setParam("bricks_file", "bricks.yaml");
  nh.setParam("colour", true);
  nh.setParam("state/max_joint_age_s", 0.0);
  nh.setParam("search/max_iterations", 1.5);
  nh.setParam("scene/sigmas", -1.0);
  nh.setParam("pick/approach_m", "far");
  nh.setParam("motion/velocity_scale", 2.0);
  nh.setParam("monitor/rate_hz", 1000.0);
  const std::string message = messageOf<std::invalid_argument>([&] { loadMotionPlanningParams(nh); });
  EXPECT_THAT(message, HasSubstr("/wrong/bricks_file = 'bricks.yaml', must be the absolute path"));
  EXPECT_THAT(message, HasSubstr("/wrong/sectors_file = '', must be the absolute path"));
  EXPECT_THAT(message, HasSubstr("/wrong/colour is unknown"));
  EXPECT_THAT(message, HasSubstr("/wrong/state/max_joint_age_s = 0 s, must be in [0.01, 60] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/search/max_iterations"));
  EXPECT_THAT(message, HasSubstr("/wrong/scene/sigmas = -1"));
  EXPECT_THAT(message, HasSubstr("/wrong/pick/approach_m"));
  EXPECT_THAT(message, HasSubstr("/wrong/motion/velocity_scale = 2"));
  EXPECT_THAT(message, HasSubstr("/wrong/monitor/rate_hz = 1000 Hz, must be in [0.5, 100] Hz"));
}

// What is watched may have no more margin than what is planned with; who is wrong about the one is not told of the other.
TEST(MotionPlanningParams, AnImpossibleMarginIsOneProblemNotTwo) {
  MotionPlanningParams params;
  params.bricks_file = params.sectors_file = params.postures_dir = "/a";
  EXPECT_THAT(problemsOf(params), IsEmpty());
  params.scene.sigmas = -1.0;
  EXPECT_THAT(problemsOf(params), ElementsAre(HasSubstr("scene/sigmas = -1, must be in [0, 10]")));
  params.scene.sigmas = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(problemsOf(params), ElementsAre(HasSubstr("scene/sigmas = nan")));
  params.scene.sigmas = 20.0;
  EXPECT_THAT(problemsOf(params), ElementsAre(HasSubstr("scene/sigmas = 20")));
  params.monitor.sigmas = -0.5;  // impossible itself
  EXPECT_THAT(problemsOf(params), UnorderedElementsAre(HasSubstr("scene/sigmas = 20"),
                                                       HasSubstr("monitor/sigmas = -0.5, must be in [0, 10]")));
  params.scene.sigmas = 1.5;
  params.monitor.sigmas = 1.6;
  EXPECT_THAT(problemsOf(params), ElementsAre("monitor/sigmas must be at most scene/sigmas"));
  params.monitor.sigmas = 1.5;
  params.scene.margin_m = -0.01;
  params.monitor.margin_m = 0.005;
  EXPECT_THAT(problemsOf(params), ElementsAre(HasSubstr("scene/margin_m = -0.01 m")));
  params.scene.margin_m = 0.01;
  params.planner.collision.self_padding_m = -0.01;
  params.monitor.self_padding_m = 0.005;
  EXPECT_THAT(problemsOf(params), ElementsAre(HasSubstr("collision/self_padding_m = -0.01 m")));
}

}  // namespace
}  // namespace motion_planning_ros
