// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/fault.h"

#include <cmath>
#include <stdexcept>

#include <gtest/gtest.h>

namespace simulated_world {
namespace {

Fault faultAt(FaultKind kind, double at_s, double duration_s = 0.0) {
  Fault fault;
  fault.kind = kind;
  fault.at_s = at_s;
  fault.duration_s = duration_s;
  return fault;
}

TEST(Fault, NamesGoThereAndBack) {
  for (int i = 0; i <= static_cast<int>(FaultKind::kIoRefused); ++i) {
    const auto kind = static_cast<FaultKind>(i);
    EXPECT_EQ(faultKind(faultName(kind)), kind);
    EXPECT_NE(allFaultNames().find(faultName(kind)), std::string::npos);
  }
  EXPECT_FALSE(faultKind("earthquake").has_value());
}

TEST(Fault, SaysWhatCannotBe) {
  Fault fault = faultAt(FaultKind::kMagnetWeak, 0.0);
  fault.value = 1.5;
  ASSERT_EQ(fault.validate().size(), 1U);
  EXPECT_EQ(fault.validate()[0], "value = 1.5, must be in [0, 1]");
  fault = faultAt(FaultKind::kWheelSlip, std::nan(""), -1.0);
  fault.value2 = -0.1;
  EXPECT_EQ(fault.validate().size(), 3U);
  EXPECT_EQ(faultAt(FaultKind::kDropBrick, 0.0, 2.0).validate().size(), 1U) << "a dropped brick does not come back";
  fault = faultAt(FaultKind::kMoveBrick, 0.0);
  fault.T_map_object.linear() *= 2.0;
  EXPECT_EQ(fault.validate().size(), 2U) << "no brick, no pose";
  Fault jump = faultAt(FaultKind::kLocalisationJump, 0.0);
  jump.value = -0.5;
  jump.value2 = -3.0;
  EXPECT_TRUE(jump.validate().empty()) << "to either side";
  jump.value = std::nan("");
  jump.value2 = 4.0;
  EXPECT_EQ(jump.validate().size(), 2U);
  FaultSchedule schedule;
  EXPECT_THROW(schedule.add(fault), std::invalid_argument);
}

TEST(FaultSchedule, GivesEachFaultWhenItsTimeHasCome) {
  FaultSchedule schedule;
  schedule.add(faultAt(FaultKind::kDropBrick, 2.0));
  schedule.add(faultAt(FaultKind::kProtectiveStop, 1.0));
  EXPECT_TRUE(schedule.takeDue(0.99).empty());
  const auto first = schedule.takeDue(1.0);
  ASSERT_EQ(first.size(), 1U);
  EXPECT_EQ(first[0].fault.kind, FaultKind::kProtectiveStop);
  EXPECT_EQ(schedule.takeDue(5.0).size(), 1U);
  EXPECT_TRUE(schedule.takeDue(1e9).empty());
}

TEST(FaultSchedule, EndsWhatHasADuration) {
  FaultSchedule schedule;
  schedule.add(faultAt(FaultKind::kCameraGone, 1.0, 2.0));
  ASSERT_EQ(schedule.takeDue(1.0).size(), 1U);
  EXPECT_TRUE(schedule.takeDue(2.9).empty());
  const auto end = schedule.takeDue(3.0);
  ASSERT_EQ(end.size(), 1U);
  EXPECT_FALSE(end[0].is_beginning);
}

TEST(FaultSchedule, DurationCountsFromWhenItTakesEffect) {
  FaultSchedule schedule;
  schedule.add(faultAt(FaultKind::kCameraGone, 0.0, 2.0));
  ASSERT_EQ(schedule.takeDue(10.0).size(), 1U) << "asked for too late, its end has not come";
  EXPECT_TRUE(schedule.takeDue(11.9).empty());
  EXPECT_EQ(schedule.takeDue(12.0).size(), 1U);
}

TEST(FaultSchedule, SameKindAgainReplacesTheEnd) {
  FaultSchedule schedule;
  schedule.add(faultAt(FaultKind::kDriverGone, 0.0, 2.0));
  schedule.takeDue(0.0);
  schedule.add(faultAt(FaultKind::kDriverGone, 1.0, 5.0));
  ASSERT_EQ(schedule.takeDue(3.0).size(), 1U) << "the second's beginning, not the first's end";
  ASSERT_EQ(schedule.takeDue(8.0).size(), 1U) << "five seconds from the tick at which it began";
}

TEST(Fault, ObstaclesStandUprightOnTheGround) {
  Fault obstacle = faultAt(FaultKind::kObstacle, 0.0, 3.0);
  obstacle.T_map_object.translate(Eigen::Vector3d(1.0, -2.0, 0.0));
  obstacle.T_map_object.rotate(Eigen::AngleAxisd(1.0, Eigen::Vector3d::UnitZ()));
  EXPECT_TRUE(obstacle.validate().empty()) << obstacle.validate()[0];
  Fault lying = obstacle;
  lying.T_map_object.rotate(Eigen::AngleAxisd(0.5 * M_PI, Eigen::Vector3d::UnitX()));
  ASSERT_EQ(lying.validate().size(), 1U);
  EXPECT_NE(lying.validate()[0].find("upright"), std::string::npos);
  Fault floating = obstacle;
  floating.T_map_object.translation().z() = 0.5;
  ASSERT_EQ(floating.validate().size(), 1U);
  EXPECT_EQ(floating.validate()[0], "pose.position.z = 0.5, must be 0 m: an obstacle stands on the ground");
  Fault far = obstacle;
  far.T_map_object.translation().x() = -200.0;
  EXPECT_EQ(far.validate().size(), 1U);
  Fault broken = obstacle;
  broken.T_map_object.translation().y() = std::nan("");
  EXPECT_EQ(broken.validate().size(), 1U);
}

TEST(FaultSchedule, EachObstacleHasItsOwnEnd) {
  FaultSchedule schedule;
  schedule.add(faultAt(FaultKind::kObstacle, 0.0, 5.0));
  schedule.add(faultAt(FaultKind::kObstacle, 1.0, 2.0));
  const auto first = schedule.takeDue(0.0);
  const auto second = schedule.takeDue(1.0);
  ASSERT_EQ(first.size(), 1U);
  ASSERT_EQ(second.size(), 1U);
  EXPECT_NE(first[0].number, second[0].number);
  const auto end_of_second = schedule.takeDue(3.0);
  const auto end_of_first = schedule.takeDue(5.0);
  ASSERT_EQ(end_of_second.size(), 1U);
  ASSERT_EQ(end_of_first.size(), 1U);
  EXPECT_FALSE(end_of_second[0].is_beginning);
  EXPECT_EQ(end_of_second[0].number, second[0].number);
  EXPECT_EQ(end_of_first[0].number, first[0].number);
}

TEST(FaultSchedule, ClearKeepsTheEndOfWhatHasBegun) {
  FaultSchedule schedule;
  schedule.add(faultAt(FaultKind::kCameraGone, 0.0, 1.0));
  schedule.add(faultAt(FaultKind::kDropBrick, 0.5));
  schedule.takeDue(0.0);
  schedule.clear();
  const auto due = schedule.takeDue(2.0);
  ASSERT_EQ(due.size(), 1U);
  EXPECT_FALSE(due[0].is_beginning);
}

}  // namespace
}  // namespace simulated_world
