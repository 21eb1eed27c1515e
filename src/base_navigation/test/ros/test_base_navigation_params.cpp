// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation_ros/base_navigation_params.h"

#include <gmock/gmock.h>
#include <ros/ros.h>

#include "support/params_contract.h"

namespace base_navigation_ros {
namespace {

using params_contract::messageOf;
using testing::HasSubstr;

const params_contract::Contract kContract = {
    BASE_NAVIGATION_DIR,
    "config/base_navigation.yaml",
    toYaml(BaseNavigationParams()),
    [](const ros::NodeHandle& nh) { return toYaml(loadBaseNavigationParams(nh)); },
    {"plan/max_iterations", "plan/shortcut_rounds", "guard/min_echoes", "drive/max_plans"},
    {{"map_frame", "world"},
     {"odom_frame", "wheels"},
     {"base_frame", "platform"},
     {"base_profile_file", "/profile.yaml"}}};

TEST(BaseNavigationParams, ShippedFileHasEveryKeyWithItsDefault) {
  params_contract::expectShippedFileHasEveryDefault(kContract);
}

TEST(BaseNavigationParams, ShippedFileLoadsAsTheDefaults) {
  BaseNavigationParams expected;
  expected.base_profile_file = "/base_profile.yaml";  // what a launch file has to give
  EXPECT_EQ(toYaml(loadBaseNavigationParams(ros::NodeHandle("~shipped"))), toYaml(expected));
}

TEST(BaseNavigationParams, EveryKeyIsReadIntoItsOwnField) {
  params_contract::expectEveryKeyIsReadIntoItsOwnField(kContract, ros::NodeHandle("~changed"));
}

TEST(BaseNavigationParams, ReadmeTableHasEveryKeyWithItsDefault) {
  params_contract::expectReadmeTableHasEveryDefault(kContract);
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
  const std::string message = messageOf(kContract, nh);
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

}  // namespace
}  // namespace base_navigation_ros

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  ros::init(argc, argv, "test_base_navigation_params");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
