// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation_ros/base_navigation_params.h"

#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/shipped_file.h>
#include <ros/ros.h>

namespace base_navigation_ros {
namespace {

using interactive_mapping::problemsOf;
using testing::HasSubstr;

std::string messageOf(const ros::NodeHandle& nh) {
  return test_support::messageOf<std::invalid_argument>([&] { loadBaseNavigationParams(nh); });
}

TEST(BaseNavigationParams, ShippedFileIsWhatTheFieldsSay) {
  test_support::expectShippedFile<BaseNavigationParams>(BASE_NAVIGATION_DIR "/config/base_navigation.yaml");
}

TEST(BaseNavigationParams, ShippedFileLoadsAsTheDefaults) {
  const BaseNavigationParams loaded = loadBaseNavigationParams(ros::NodeHandle("~shipped"));
  BaseNavigationParams expected;
  expected.base_profile_file = loaded.base_profile_file;  // what a launch file has to give
  EXPECT_EQ(interactive_mapping::toYaml(loaded), interactive_mapping::toYaml(expected));
}

TEST(BaseNavigationParams, OneMessageNamesEveryProblemWithValueAndRange) {
  ros::NodeHandle nh("~wrong");
  nh.setParam("base_profile_file", "profile.yaml");
  nh.setParam("map_frame", "/map");
  nh.setParam("colour", true);
  nh.setParam("speed_share", 2.0);
  nh.setParam("grid/cell_size_m", 0.0);
  nh.setParam("plan/max_iterations", 1.5);
  nh.setParam("plan/padding_m", "wide");
  nh.setParam("follow/speed_reserve", 2.0);
  nh.setParam("guard/braking_share", 0.0);
  nh.setParam("drive/max_plans", 0);
  const std::string message = messageOf(nh);
  EXPECT_THAT(message, HasSubstr("/wrong/base_profile_file = 'profile.yaml', must be the absolute path"));
  EXPECT_THAT(message, HasSubstr("/wrong/map_frame = '/map', must be a tf2 frame"));
  EXPECT_THAT(message, HasSubstr("/wrong/colour is unknown"));
  EXPECT_THAT(message, HasSubstr("/wrong/speed_share = 2, must be in [0.05, 1]"));
  EXPECT_THAT(message, HasSubstr("/wrong/grid/cell_size_m = 0 m"));
  EXPECT_THAT(message, HasSubstr("/wrong/plan/max_iterations"));
  EXPECT_THAT(message, HasSubstr("/wrong/plan/padding_m"));
  EXPECT_THAT(message, HasSubstr("/wrong/follow/speed_reserve = 2"));
  EXPECT_THAT(message, HasSubstr("/wrong/guard/braking_share = 0"));
  EXPECT_THAT(message, HasSubstr("/wrong/drive/max_plans = 0"));
}

TEST(BaseNavigationParams, WhatTheBaseRulesOutIsReportedWithAllTheRest) {
  ros::NodeHandle nh("~short_sighted");
  nh.setParam("base_profile_file", BASE_PROFILE);
  nh.setParam("guard/look_ahead_m", 2.0);  // from 0.8 m/s it takes 0.8 * 0.25 + 0.8^2 / (2 * 0.7 * 0.2) = 2.486 m
  nh.setParam("guard/look_ahead_rad", 0.1);
  nh.setParam("drive/max_plans", 0);
  const std::string message = messageOf(nh);
  EXPECT_THAT(message, HasSubstr("/short_sighted/guard/look_ahead_m = 2 m, must be in [2.48571, 100] m"));
  EXPECT_THAT(message, HasSubstr("/short_sighted/guard/look_ahead_rad = 0.1 rad, must be in ["));
  EXPECT_THAT(message, HasSubstr("/short_sighted/drive/max_plans = 0"));
  // A slower base stops sooner: 0.4 * 0.25 + 0.4^2 / (2 * 0.7 * 0.2) = 0.67 m.
  ros::NodeHandle slow("~slow");
  slow.setParam("base_profile_file", BASE_PROFILE);
  slow.setParam("guard/look_ahead_m", 2.0);
  slow.setParam("speed_share", 0.5);
  EXPECT_EQ(messageOf(slow), "");
}

TEST(BaseNavigationParams, AProfileThatCannotBeReadIsReportedWithAllTheRest) {
  ros::NodeHandle nh("~no_profile");
  nh.setParam("base_profile_file", "/no_such_profile.yaml");
  nh.setParam("drive/max_plans", 0);
  const std::string message = messageOf(nh);
  EXPECT_THAT(message, HasSubstr("/no_profile/base_profile_file: "));
  EXPECT_THAT(message, HasSubstr("/no_such_profile.yaml"));
  EXPECT_THAT(message, HasSubstr("/no_profile/drive/max_plans = 0"));
}

TEST(BaseNavigationParams, TheThreeFramesAreThree) {
  BaseNavigationParams params;
  params.base_profile_file = BASE_PROFILE;
  EXPECT_THAT(problemsOf(params), testing::IsEmpty());
  params.odom_frame = params.map_frame;
  EXPECT_THAT(problemsOf(params), testing::ElementsAre("odom_frame = 'map', must be another frame than map_frame"));
  for (const char* taken : {"map", "odom"}) {
    params.odom_frame = "odom";
    params.base_frame = taken;
    EXPECT_THAT(problemsOf(params),
                testing::ElementsAre(HasSubstr("must be another frame than map_frame and odom_frame")));
  }
}

TEST(BaseNavigationParams, AnImpossibleBoundIsTheOnlyProblemOfItself) {
  BaseNavigationParams params;
  params.base_profile_file = BASE_PROFILE;
  params.planner.padding_m = -1.0;
  EXPECT_THAT(problemsOf(params), testing::ElementsAre("plan/padding_m = -1 m, must be in [0, 0.5] m"));
  params.planner.padding_m = 0.03;
  EXPECT_THAT(
      problemsOf(params),
      testing::ElementsAre("guard/margin_m = 0.040000 m, must be below plan/padding_m = 0.030000 m, or the guard "
                           "stops planned motion"));
  params.planner.padding_m = 0.06;
  params.planner.goal_padding_m = 0.07;
  EXPECT_THAT(problemsOf(params), testing::ElementsAre("plan/goal_padding_m = 0.07 m, must be in [0, 0.06] m"));
  params.planner.goal_padding_m = 0.0;
  params.planner.approach_m = -1.0;
  EXPECT_THAT(problemsOf(params), testing::ElementsAre("plan/approach_m = -1 m, must be in [0.05, 5] m"));
  params.planner.approach_m = 0.4;
  params.navigator.max_grid_age_s = 0.05;
  EXPECT_THAT(problemsOf(params), testing::ElementsAre("drive/max_grid_age_s = 0.05 s, must be in [0.1, 3600] s"));
  params.navigator.max_grid_age_s = 0.0;
  params.navigator.max_pose_age_s = 100.0;
  EXPECT_THAT(problemsOf(params), testing::ElementsAre(HasSubstr("drive/max_pose_age_s = 100 s")));
}

}  // namespace
}  // namespace base_navigation_ros
