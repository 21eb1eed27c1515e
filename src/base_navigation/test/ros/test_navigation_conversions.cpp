// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation_ros/conversions.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

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

Eigen::Isometry3d tilted(double angle_rad) {
  return Eigen::Isometry3d(Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::UnitY()));
}

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
  EXPECT_THAT(refusal(message), HasSubstr("cell_size = 0 m, must be in [0.01, 10] m"));
  message.info.resolution = kNan;
  EXPECT_THAT(refusal(message), HasSubstr("cell_size = nan m"));
  message.info.resolution = 0.005F;
  EXPECT_THAT(refusal(message), HasSubstr("cell_size = 0.005 m"));
  message = twoByThree();
  message.info.origin.position.x = 5e5;  // of UTM, for instance
  EXPECT_THAT(refusal(message), HasSubstr("origin.x = 500000 m, must be in [-100000, 100000] m"));
  message = twoByThree();
  message.info.width = 200000;
  message.info.height = 1;
  message.data.assign(200000, 0);
  EXPECT_THAT(refusal(message), HasSubstr("width = 200000 cells"));
  message = twoByThree();
  message.info.origin = toPose(Pose2d{-1e5, 0.0, 1.0});  // within the range as it is, not along the axes
  EXPECT_THAT(refusal(message), HasSubstr("origin.x = -100000 m"));
  message = twoByThree();
  message.info.origin.orientation = toPose(tilted(0.2)).orientation;
  EXPECT_THAT(refusal(message), HasSubstr("tilted by 0.2 rad against its frame, must be at most 0.001 rad"));
  message.info.origin.orientation.w = 5.0;
  EXPECT_THAT(refusal(message), HasSubstr("its origin: pose is not finite or no rotation: |q| = "));
  message = twoByThree();
  message.info.width = 100000;  // within the limit as it is
  message.info.height = 1;
  message.data.assign(100000, 0);
  message.info.origin = toPose(Pose2d{1.0, -2.0, 0.7});
  EXPECT_THAT(refusal(message), HasSubstr("100000 x 1 cells turned by 0.700 rad need more than 16000000"));
  message = twoByThree();
  message.info.width = message.info.height = 100000;
  EXPECT_THAT(refusal(message), HasSubstr("must be at most"));
}

constexpr SpaceState kF = SpaceState::kFree;
constexpr SpaceState kO = SpaceState::kOccupied;
constexpr SpaceState kU = SpaceState::kUnknown;

TEST(NavigationConversions, QuarterTurnMovesEachCell) {
  nav_msgs::OccupancyGrid message = twoByThree();
  message.data = {0, 100, -1, 100, 0, 0};
  message.info.origin = toPose(Pose2d{1.0, -2.0, M_PI_2});
  std::string why_not;
  auto grid = toGrid(message, 65, &why_not);
  ASSERT_TRUE(grid) << why_not;
  EXPECT_EQ(grid->width, 2);
  EXPECT_EQ(grid->height, 3);
  EXPECT_LT((grid->origin_m - Eigen::Vector2d(0.9, -2.0)).norm(), 1e-9);
  EXPECT_EQ(grid->state, (std::vector<SpaceState>{kO, kF, kF, kO, kF, kU}));
  message.info.origin = toPose(Pose2d{1.0, -2.0, 1e-7});  // what a float rounds: not turned
  grid = toGrid(message, 65, &why_not);
  ASSERT_TRUE(grid) << why_not;
  EXPECT_EQ(grid->state, (std::vector<SpaceState>{kF, kO, kU, kO, kF, kF}));
}

TEST(NavigationConversions, TurnedGridsAgreeWithEachCellSought) {
  nav_msgs::OccupancyGrid message;
  message.info.resolution = 0.1F;
  message.info.width = 23;
  message.info.height = 9;
  for (int i = 0; i < 23 * 9; ++i) message.data.push_back(i % 7 == 3 ? 100 : i % 5 == 1 ? -1 : 0);
  constexpr double kCell_m = 0.1;
  for (const double yaw_rad : {M_PI / 6.0, -2.5}) {
    message.info.origin = toPose(Pose2d{1.0, -2.0, yaw_rad});
    std::string why_not;
    const auto grid = toGrid(message, 65, &why_not);
    ASSERT_TRUE(grid) << why_not;
    const Eigen::Vector2d along(std::cos(yaw_rad), std::sin(yaw_rad)), across(-along.y(), along.x());
    std::map<SpaceState, int> found;
    int num_kept = 0;  // occupied cells without the centre of one of the result
    for (int row = 0; row < grid->height; ++row) {
      for (int column = 0; column < grid->width; ++column) {
        const Eigen::Vector2d p = grid->centerOf(column, row);
        SpaceState expected = kU;
        bool is_kept = false;
        for (int j = 0; j < 9; ++j) {
          for (int i = 0; i < 23; ++i) {
            const Eigen::Vector2d centre =
                Eigen::Vector2d(1.0, -2.0) + kCell_m * ((i + 0.5) * along + (j + 0.5) * across);
            const Eigen::Vector2d to = p - centre;
            const SpaceState state = stateOf(message.data[static_cast<std::size_t>(23 * j + i)], 65);
            if (std::max(std::abs(to.dot(along)), std::abs(to.dot(across))) < 0.5 * kCell_m) expected = state;
            if (state == kO && to.cwiseAbs().maxCoeff() < 0.5 * kCell_m) is_kept = true;
          }
        }
        num_kept += is_kept && expected != kO ? 1 : 0;
        if (is_kept) expected = kO;
        EXPECT_EQ(grid->at(column, row), expected) << column << ", " << row << " at " << yaw_rad;
        ++found[grid->at(column, row)];
      }
    }
    EXPECT_GT(found[kF], 100);
    EXPECT_GT(found[kO], 23 * 9 / 7 - 1);
    EXPECT_GT(found[kU], 20);
    EXPECT_GT(num_kept, 0);
  }
}

TEST(GroundInput, UpdatesOfATurnedGridTurnWithIt) {
  GroundInput ground("map", 65);
  nav_msgs::OccupancyGrid whole = twoByThree();
  whole.header.frame_id = "map";
  whole.data = {0, 0, 0, 0, 0, 0};
  whole.info.origin = toPose(Pose2d{1.0, -2.0, M_PI_2});
  std::string why_not;
  ASSERT_TRUE(ground.take(whole, &why_not)) << why_not;
  map_msgs::OccupancyGridUpdate update;
  update.header.frame_id = "map";
  update.x = 2;  // not in the turned grid's two columns
  update.width = 1;
  update.height = 2;
  update.data = {100, -1};
  const GroundInput::Grid after = ground.take(update, &why_not);
  ASSERT_TRUE(after) << why_not;
  EXPECT_EQ(after->state, (std::vector<SpaceState>{kF, kF, kF, kF, kU, kO}));
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
  EXPECT_EQ(after->state, (std::vector<SpaceState>{kF, kF, kF, kF, kO, kU}));
  EXPECT_EQ(after->origin_m, before->origin_m);
  EXPECT_EQ(before->state, (std::vector<SpaceState>{kF, kO, kU, kF, kO, kU})) << "who has the old one keeps it";
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
  EXPECT_THAT(refusal(threeBeams(), tilted(0.2)), HasSubstr("tilted by 0.200 rad"));
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
