// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/laser_scanner.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include <Eigen/Geometry>
#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

#include "simulated_world/mujoco_model.h"

namespace simulated_world {
namespace {

using test_support::messageOf;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// A turned and shifted cart with a housing round its scanner (in a body of its own), a turning arm above, and bricks.
constexpr const char* kCart = R"(
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <body name="cart" pos="0.5 -0.25 0.3" euler="0 0 0.4">
      <freejoint/>
      <geom type="box" size="0.3 0.25 0.15" group="3"/>
      <body name="housing" pos="0.3 0 0">
        <geom type="cylinder" size="0.08 0.05" group="3"/>
        <site name="scanner"/>
      </body>
      <body name="arm" pos="0.9 0 0">
        <joint type="hinge"/>
        <geom type="sphere" size="0.05" group="3"/>
      </body>
    </body>
    <body pos="2.5 0.2 0.3" euler="0 0 0.7"><freejoint/><geom type="box" size="0.15 0.1 0.1" group="1"/></body>
    <body pos="0.4 1.6 0.3" euler="0 0 -0.3"><freejoint/><geom type="box" size="0.15 0.1 0.1" group="1"/></body>
    <body pos="-1.5 -0.8 0.3" euler="0 0 1.1"><freejoint/><geom type="box" size="0.15 0.1 0.1" group="1"/></body>
    <geom type="box" size="0.2 0.2 0.5" pos="0.5 -1.6 0.3" group="2"/>
  </worldbody>
</mujoco>)";

struct Rectangle {
  double x_m, y_m, yaw_rad, half_x_m, half_y_m;
};
const std::vector<Rectangle> kBricks = {
    {2.5, 0.2, 0.7, 0.15, 0.1}, {0.4, 1.6, -0.3, 0.15, 0.1}, {-1.5, -0.8, 1.1, 0.15, 0.1}};
const Eigen::Vector2d kScanner(0.5 + 0.3 * std::cos(0.4), -0.25 + 0.3 * std::sin(0.4));
constexpr double kScannerYaw_rad = 0.4;

/// Distance along a ray to the nearest side of the bricks' outlines, and to the arm's circle.
double expectedRange(double angle_rad) {
  const Eigen::Vector2d direction(std::cos(kScannerYaw_rad + angle_rad), std::sin(kScannerYaw_rad + angle_rad));
  double nearest = std::numeric_limits<double>::infinity();
  for (const Rectangle& brick : kBricks) {
    const Eigen::Rotation2Dd turn(brick.yaw_rad);
    const std::array<Eigen::Vector2d, 4> corners{{{brick.half_x_m, brick.half_y_m},
                                                  {-brick.half_x_m, brick.half_y_m},
                                                  {-brick.half_x_m, -brick.half_y_m},
                                                  {brick.half_x_m, -brick.half_y_m}}};
    for (std::size_t i = 0; i < 4; ++i) {
      const Eigen::Vector2d a = Eigen::Vector2d(brick.x_m, brick.y_m) + turn * corners[i];
      const Eigen::Vector2d b = Eigen::Vector2d(brick.x_m, brick.y_m) + turn * corners[(i + 1) % 4];
      Eigen::Matrix2d lines;  // scanner + r direction = a + s (b - a)
      lines << direction, a - b;
      const Eigen::Vector2d solution = lines.inverse() * (a - kScanner);
      if (solution[0] > 0.0 && solution[1] >= 0.0 && solution[1] <= 1.0) {
        nearest = std::min(nearest, solution[0]);
      }
    }
  }
  const Eigen::Vector2d to_arm = 0.6 * Eigen::Vector2d(std::cos(kScannerYaw_rad), std::sin(kScannerYaw_rad));
  const double along = to_arm.dot(direction);
  const double aside_squared = to_arm.squaredNorm() - along * along;
  if (along > 0.0 && aside_squared < 0.05 * 0.05) {
    nearest = std::min(nearest, along - std::sqrt(0.05 * 0.05 - aside_squared));
  }
  return nearest;
}

LaserScannerConfig wholeTurn() {
  LaserScannerConfig config;
  config.angle_min_rad = -3.1;
  config.angle_max_rad = 3.1;
  config.angle_increment_rad = 0.005;
  return config;
}

struct Cart {
  Cart() : model(compileModel(kCart)), data(makeData(*model)) { mj_forward(model.get(), data.get()); }
  ModelPtr model;
  DataPtr data;
};

TEST(LaserScanner, MeasuresBricksAndArmThroughItsOwnHousing) {
  const Cart cart;
  const LaserScanner scanner(*cart.model, "scanner", wholeTurn());
  const std::vector<float> ranges = scanner.scan(*cart.data, 0);
  ASSERT_EQ(ranges.size(), 1241U);
  int num_hits = 0;
  int num_mismatched = 0;
  for (std::size_t ray = 0; ray < ranges.size(); ++ray) {
    const double expected = expectedRange(-3.1 + static_cast<double>(ray) * 0.005);
    if (std::isfinite(expected) != std::isfinite(ranges[ray])) {
      ++num_mismatched;
    } else if (std::isfinite(expected)) {
      ++num_hits;
      EXPECT_NEAR(ranges[ray], expected, 1e-5) << "ray " << ray;  // float
    }
  }
  EXPECT_GT(num_hits, 80);
  EXPECT_EQ(num_mismatched, 0);
}

TEST(LaserScanner, ReportsWhatIsOutOfRangeByItsSign) {
  const Cart cart;
  LaserScannerConfig config = wholeTurn();
  config.range_min_m = 0.6;  // the arm's sphere begins at 0.55 m
  config.range_max_m = 1.9;
  const std::vector<float> ranges = LaserScanner(*cart.model, "scanner", config).scan(*cart.data, 0);
  int num_near = 0;
  int num_far = 0;
  for (std::size_t ray = 0; ray < ranges.size(); ++ray) {
    const double expected = expectedRange(-3.1 + static_cast<double>(ray) * 0.005);
    if (expected < 0.6) {
      EXPECT_EQ(ranges[ray], -kInfinity);
      ++num_near;
    } else if (expected > 1.9) {
      EXPECT_EQ(ranges[ray], kInfinity);
      num_far += std::isfinite(expected) ? 1 : 0;
    }
  }
  EXPECT_GT(num_near, 10);
  EXPECT_GT(num_far, 10);
}

TEST(LaserScanner, SeesVisualGeomsOnlyIfAsked) {
  const Cart cart;
  LaserScannerConfig config = wholeTurn();
  const auto countHits = [&] {
    const std::vector<float> ranges = LaserScanner(*cart.model, "scanner", config).scan(*cart.data, 0);
    return std::count_if(ranges.begin(), ranges.end(), [](float range_m) { return std::isfinite(range_m); });
  };
  const auto without = countHits();
  config.sees_geom_group[2] = true;
  EXPECT_GT(countHits(), without + 20);
}

TEST(LaserScanner, NoiseHasTheStatedSigmaAndIsFixedByTheScanNumber) {
  const Cart cart;
  LaserScannerConfig config = wholeTurn();
  config.range_noise_std_m = 0.01;
  const LaserScanner scanner(*cart.model, "scanner", config);
  const std::vector<float> first = scanner.scan(*cart.data, 4);
  EXPECT_NE(scanner.scan(*cart.data, 5), first);
  EXPECT_EQ(scanner.scan(*cart.data, 4), first);
  double sum_of_squares = 0.0;
  double count = 0.0;
  for (std::uint64_t number = 0; number < 50; ++number) {
    const std::vector<float> ranges = scanner.scan(*cart.data, number);
    for (std::size_t ray = 0; ray < ranges.size(); ++ray) {
      if (std::isfinite(ranges[ray])) {
        sum_of_squares += std::pow(ranges[ray] - expectedRange(-3.1 + static_cast<double>(ray) * 0.005), 2);
        count += 1.0;
      }
    }
  }
  ASSERT_GT(count, 4000.0);
  EXPECT_NEAR(std::sqrt(sum_of_squares / count), 0.01, 5.0 * 0.01 / std::sqrt(2.0 * count));  // five standard errors
}

TEST(LaserScanner, OnAWallSeesTheOtherWalls) {
  const ModelPtr model = compileModel(R"(<mujoco><worldbody>
    <body pos="0 0 1"><geom type="box" size="0.05 0.05 0.05"/><site name="scanner"/></body>
    <body pos="2 0 1"><geom type="box" size="0.1 1 1"/></body></worldbody></mujoco>)");
  const DataPtr data = makeData(*model);
  mj_forward(model.get(), data.get());
  LaserScannerConfig config;
  config.angle_min_rad = config.angle_max_rad = 0.0;
  EXPECT_NEAR(LaserScanner(*model, "scanner", config).scan(*data, 0).at(0), 1.9, 1e-5);
}

TEST(LaserScanner, CountsItsRays) {
  LaserScannerConfig config;
  config.angle_min_rad = -1.0;
  config.angle_max_rad = 1.0;
  config.angle_increment_rad = 0.1;  // not a binary fraction
  EXPECT_EQ(config.numRays(), 21);
  config.angle_max_rad = 0.99;
  EXPECT_EQ(config.numRays(), 20);
}

TEST(LaserScanner, RefusesAnImpossibleConfig) {
  const Cart cart;
  LaserScannerConfig config;
  config.angle_max_rad = -3.0;
  config.range_max_m = 0.01;
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { LaserScanner(*cart.model, "scanner", config); }),
              AllOf(HasSubstr("angle_max_rad = -3"), HasSubstr("range_max_m = 0.01")));
  EXPECT_THROW(LaserScanner(*cart.model, "no_scanner", {}), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
