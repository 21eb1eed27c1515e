// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation_ros/conversions.h"

#include <cmath>
#include <limits>

#include <gmock/gmock.h>
#include <interactive_mapping_common_ros/poses.h>

#include "base_navigation_ros/ground_input.h"
#include "base_navigation_ros/odometry_history.h"

namespace base_navigation_ros {
namespace {

using base_navigation::Pose2d;
using base_navigation::Scan;
using base_navigation::SpaceState;
using testing::HasSubstr;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

nav_msgs::OccupancyGrid twoByThree() {
  nav_msgs::OccupancyGrid message;
  message.info.resolution = 0.05F;
  message.info.width = 3;
  message.info.height = 2;
  message.info.origin = toPose(Pose2d{1.0, -2.0, 0.0});
  message.data = {0, 100, -1, 64, 65, 101};
  return message;
}

TEST(NavigationConversions, OccupancyBecomesStates) {
  std::string why_not;
  const auto grid = toGrid(twoByThree(), 65, &why_not);
  ASSERT_TRUE(grid) << why_not;
  EXPECT_DOUBLE_EQ(grid->cell_size_m, 0.05);
  EXPECT_EQ(grid->origin_m, Eigen::Vector2d(1.0, -2.0));
  const std::vector<SpaceState> expected = {SpaceState::kFree, SpaceState::kOccupied, SpaceState::kUnknown,
                                            SpaceState::kFree, SpaceState::kOccupied, SpaceState::kUnknown};
  EXPECT_EQ(grid->state, expected);
  const nav_msgs::OccupancyGrid back = toMessage(*grid, {});
  EXPECT_EQ(back.data, (std::vector<std::int8_t>{0, 100, -1, 0, 100, -1}));
  EXPECT_EQ(back.info.width, 3U);
  EXPECT_FLOAT_EQ(back.info.resolution, 0.05F);
}

TEST(NavigationConversions, GridsThatDoNotFitTogetherAreRefused) {
  const auto refusal = [](const nav_msgs::OccupancyGrid& message) {
    std::string why_not;
    EXPECT_FALSE(toGrid(message, 65, &why_not));
    return why_not;
  };
  nav_msgs::OccupancyGrid message = twoByThree();
  message.data.pop_back();
  EXPECT_THAT(refusal(message), HasSubstr("5 values for 3 x 2 cells"));
  message = twoByThree();
  message.info.resolution = 0.0F;
  EXPECT_THAT(refusal(message), HasSubstr("resolution = 0 m"));
  message.info.resolution = kNan;
  EXPECT_THAT(refusal(message), HasSubstr("resolution"));
  message = twoByThree();
  message.info.origin = toPose(Pose2d{1.0, -2.0, 0.3});
  EXPECT_THAT(refusal(message), HasSubstr("turned against its frame"));
  message = twoByThree();
  message.info.width = message.info.height = 100000;
  EXPECT_THAT(refusal(message), HasSubstr("must be at most"));
}

TEST(GroundInput, UpdatesReplaceAPartOfTheGrid) {
  GroundInput ground("map", 65);
  std::string why_not;
  map_msgs::OccupancyGridUpdate update;
  update.header.frame_id = "/map";
  update.x = 1;
  update.width = 2;
  update.height = 2;
  update.data = {0, 0, 100, -1};
  EXPECT_FALSE(ground.take(update, &why_not));
  EXPECT_THAT(why_not, HasSubstr("no whole grid before it"));
  nav_msgs::OccupancyGrid whole = twoByThree();
  whole.header.frame_id = "/map";
  const GroundInput::Grid before = ground.take(whole, &why_not);
  ASSERT_TRUE(before) << why_not;
  const GroundInput::Grid after = ground.take(update, &why_not);
  ASSERT_TRUE(after) << why_not;
  const auto F = SpaceState::kFree;
  const auto O = SpaceState::kOccupied;
  const auto U = SpaceState::kUnknown;
  EXPECT_EQ(after->state, (std::vector<SpaceState>{F, F, F, F, O, U}));
  EXPECT_EQ(after->origin_m, before->origin_m);
  EXPECT_EQ(before->state, (std::vector<SpaceState>{F, O, U, F, O, U})) << "who has the old one keeps it";
  update.x = 2;
  EXPECT_FALSE(ground.take(update, &why_not));
  EXPECT_THAT(why_not, HasSubstr("2 x 2 cells at (2, 0) with 4 values, must lie within the grid's 3 x 2"));
  update.x = 0;
  update.data.pop_back();
  EXPECT_FALSE(ground.take(update, &why_not));
  update.x = -1;
  update.data.push_back(0);
  EXPECT_FALSE(ground.take(update, &why_not));
  whole.header.frame_id = "odom";
  EXPECT_FALSE(ground.take(whole, &why_not));
  EXPECT_THAT(why_not, HasSubstr("its frame is 'odom', must be 'map'"));
}

sensor_msgs::LaserScan threeBeams() {
  sensor_msgs::LaserScan message;
  message.angle_min = -0.5F;
  message.angle_max = 0.5F;
  message.angle_increment = 0.5F;
  message.range_min = 0.01F;
  message.range_max = 29.0F;
  message.ranges = {1.0F, 2.0F, 30.0F};
  return message;
}

Eigen::Isometry3d upsideDown() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(0.244, 0.0, 0.141);
  T.linear() = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()).toRotationMatrix();
  return T;
}

TEST(NavigationConversions, EchoesOfAScannerThatHangsUpsideDown) {
  std::string why_not;
  const auto scan = toScan(threeBeams(), upsideDown(), &why_not);
  ASSERT_TRUE(scan) << why_not;
  for (std::size_t beam = 0; beam < 2; ++beam) {
    // The message's own definition, in three dimensions.
    const double angle_rad = -0.5 + 0.5 * static_cast<double>(beam);
    const double range_m = threeBeams().ranges[beam];
    const Eigen::Vector3d expected =
        upsideDown() * Eigen::Vector3d(range_m * std::cos(angle_rad), range_m * std::sin(angle_rad), 0.0);
    EXPECT_NEAR((scan->echo(beam) - expected.head<2>()).norm(), 0.0, 1e-6);
    EXPECT_TRUE(scan->isEcho(beam));
  }
  EXPECT_FALSE(scan->isEcho(2));
  EXPECT_TRUE(scan->isEmpty(2));
}

TEST(NavigationConversions, ScansThatCannotBeAreRefused) {
  const auto refusal = [](const sensor_msgs::LaserScan& message, const Eigen::Isometry3d& T) {
    std::string why_not;
    EXPECT_FALSE(toScan(message, T, &why_not));
    return why_not;
  };
  sensor_msgs::LaserScan message = threeBeams();
  message.ranges.clear();
  EXPECT_THAT(refusal(message, upsideDown()), HasSubstr("0 beams"));
  message.ranges.resize(100000);
  EXPECT_THAT(refusal(message, upsideDown()), HasSubstr("100000 beams"));
  message = threeBeams();
  message.angle_increment = kNan;
  EXPECT_THAT(refusal(message, upsideDown()), HasSubstr("angle_increment"));
  message = threeBeams();
  message.range_max = 0.0F;
  EXPECT_THAT(refusal(message, upsideDown()), HasSubstr("range_max = 0 m"));
  for (const float masked : {0.0F, kNan}) {  // a driver that lives, and a scanner that does not
    message = threeBeams();
    message.ranges.assign(400, masked);
    message.angle_increment = 0.005F;
    EXPECT_THAT(refusal(message, upsideDown()), HasSubstr("only 0 of 400 beams report a range"));
  }
  Eigen::Isometry3d tilted = Eigen::Isometry3d::Identity();
  tilted.linear() = Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitY()).toRotationMatrix();
  EXPECT_THAT(refusal(threeBeams(), tilted), HasSubstr("tilted by 0.200 rad"));
}

TEST(NavigationConversions, PosesKeepTheirHeading) {
  for (const double yaw_rad : {0.0, 1.0, -3.0}) {
    const auto T = interactive_mapping_ros::toIsometry(toPose(Pose2d{1.0, 2.0, yaw_rad}));
    ASSERT_TRUE(T);
    EXPECT_NEAR(toPlane(*T).yaw_rad, yaw_rad, 1e-12);
    EXPECT_NEAR(tilt(*T), 0.0, 1e-12);
  }
  geometry_msgs::Pose none;  // a quaternion of zeros, as a message is made
  EXPECT_FALSE(interactive_mapping_ros::toIsometry(none));
  none.orientation.w = 1.0;
  none.position.x = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(interactive_mapping_ros::toIsometry(none));
  EXPECT_NEAR(tilt(upsideDown()), M_PI, 1e-12);
}

TEST(OdometryHistory, PosesBetweenMessages) {
  OdometryHistory history(1.0);
  EXPECT_FALSE(history.at(ros::Time(1.0)));
  history.add(ros::Time(1.0), {0.0, 0.0, 3.1});
  history.add(ros::Time(1.2), {1.0, -2.0, -3.1});  // across the turn's seam: the short way round
  const auto middle = history.at(ros::Time(1.1));
  ASSERT_TRUE(middle);
  EXPECT_NEAR(middle->x_m, 0.5, 1e-9);
  EXPECT_NEAR(middle->y_m, -1.0, 1e-9);
  EXPECT_NEAR(std::abs(middle->yaw_rad), M_PI, 1e-9);
  EXPECT_TRUE(history.at(ros::Time(1.25)));
  EXPECT_TRUE(history.at(ros::Time(0.95)));
  EXPECT_FALSE(history.at(ros::Time(1.4)));
  EXPECT_FALSE(history.at(ros::Time(0.8)));
}

TEST(OdometryHistory, ForgetsWhatIsOldAndWhatCameBeforeTimeRanBack) {
  OdometryHistory history(1.0);
  EXPECT_TRUE(history.add(ros::Time(1.0), {}));
  EXPECT_TRUE(history.add(ros::Time(5.0), {1.0, 0.0, 0.0}));
  EXPECT_FALSE(history.at(ros::Time(1.0)));
  EXPECT_FALSE(history.add(ros::Time(2.0), {2.0, 0.0, 0.0}));
  EXPECT_DOUBLE_EQ(history.newest().x_m, 2.0);
  EXPECT_FALSE(history.at(ros::Time(5.0)));
}

}  // namespace
}  // namespace base_navigation_ros
