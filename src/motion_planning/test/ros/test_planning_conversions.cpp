// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning_ros/conversions.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>
#include <mp700_ur5e_description/robot_names.h>

#include "motion_planning_ros/planning_markers.h"

namespace motion_planning_ros {
namespace {

using motion_planning::ArmVector;
using motion_planning::JointTrajectory;
using test_support::messageOf;
using testing::HasSubstr;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

JointTrajectory someTrajectory() {
  JointTrajectory trajectory;
  for (int i = 0; i < 4; ++i) {
    motion_planning::TrajectoryPoint point;
    point.time_s = 0.25 * i;
    for (int j = 0; j < 6; ++j) {
      point.position_rad[j] = 0.1 * i + j;
      point.velocity_rad_s[j] = i == 0 || i == 3 ? 0.0 : 0.01 * (j + 1);
    }
    trajectory.points.push_back(point);
  }
  return trajectory;
}

std::string refusalOf(const std::function<void()>& call) {
  return messageOf<std::invalid_argument>([&] { call(); });
}

TEST(PlanningConversions, TrajectoryGoesRoundTripWhateverTheJointsOrder) {
  const JointTrajectory trajectory = someTrajectory();
  trajectory_msgs::JointTrajectory message = toMessage(trajectory);
  ASSERT_EQ(message.joint_names.size(), 6u);
  EXPECT_EQ(message.joint_names.front(), "shoulder_pan_joint");
  std::reverse(message.joint_names.begin(), message.joint_names.end());
  for (auto& point : message.points) {
    std::reverse(point.positions.begin(), point.positions.end());
    std::reverse(point.velocities.begin(), point.velocities.end());
  }
  const JointTrajectory back = fromMessage(message);
  ASSERT_EQ(back.points.size(), trajectory.points.size());
  for (std::size_t i = 0; i < back.points.size(); ++i) {
    EXPECT_DOUBLE_EQ(back.points[i].time_s, trajectory.points[i].time_s);
    EXPECT_EQ(back.points[i].position_rad, trajectory.points[i].position_rad);
    EXPECT_EQ(back.points[i].velocity_rad_s, trajectory.points[i].velocity_rad_s);
  }
}

TEST(PlanningConversions, BadTrajectoriesAreRefusedWithTheReason) {
  const trajectory_msgs::JointTrajectory good = toMessage(someTrajectory());
  const auto refusal = [&good](const std::function<void(trajectory_msgs::JointTrajectory&)>& spoil) {
    trajectory_msgs::JointTrajectory bad = good;
    spoil(bad);
    return refusalOf([&bad] { fromMessage(bad); });
  };
  EXPECT_EQ(refusal([](auto&) {}), "");
  EXPECT_THAT(refusal([](auto& bad) { bad.joint_names.pop_back(); }), HasSubstr("has 5 joints"));
  EXPECT_THAT(refusal([](auto& bad) { bad.joint_names[2] = "elbow"; }), HasSubstr("lacks joint elbow_joint"));
  EXPECT_THAT(refusal([](auto& bad) { bad.points[1].positions.pop_back(); }), HasSubstr("point 1"));
  EXPECT_THAT(refusal([](auto& bad) { bad.points[1].velocities.pop_back(); }), HasSubstr("has 5 velocities"));
  EXPECT_THAT(refusal([](auto& bad) { bad.points[2].positions[0] = kNaN; }), HasSubstr("point 2"));
  EXPECT_THAT(refusal([](auto& bad) { bad.points[3].time_from_start = bad.points[2].time_from_start; }),
              HasSubstr("must be later"));
  EXPECT_THAT(refusal([](auto& bad) { bad.points[0].time_from_start = ros::Duration(-1.0); }),
              HasSubstr("must be >= 0 s"));
  EXPECT_THAT(refusal([](auto& bad) { bad.points[2].velocities.clear(); }), HasSubstr("must have velocities"));
}

TEST(PlanningConversions, MeshKeepsVerticesNormalsAndTriangles) {
  interactive_mapping_msgs::SurfaceMesh mesh;
  mesh.mesh.vertices.resize(3);
  mesh.mesh.vertices[2].z = 0.25;
  mesh.normals = {0.0F, 0.0F, 1.0F, 0.0F, 1.0F, 0.0F, 1.0F, 0.0F, 0.0F};
  mesh.mesh.triangles.resize(1);
  mesh.mesh.triangles[0].vertex_indices = {{0, 1, 2}};
  const motion_planning::Surface surface = toSurface(mesh);
  EXPECT_EQ(surface.vertices_map[2], Eigen::Vector3d(0.0, 0.0, 0.25));
  EXPECT_EQ(surface.normals_map[1], Eigen::Vector3f(0.0F, 1.0F, 0.0F));
  EXPECT_EQ(surface.triangles[0][2], 2u);
  mesh.normals.pop_back();
  EXPECT_THAT(refusalOf([&mesh] { toSurface(mesh); }), HasSubstr("8 numbers in normals, must be 3 x 3"));
}

TEST(PlanningConversions, ArmVectorNeedsSixFiniteAngles) {
  EXPECT_EQ(toArmVector({1, 2, 3, 4, 5, 6}, "start")[5], 6.0);
  EXPECT_THAT(refusalOf([] { toArmVector({1, 2, 3}, "start"); }), HasSubstr("start has 3 joint angles, must be 6"));
  EXPECT_THAT(refusalOf([] { toArmVector({1, 2, 3, 4, 5, kNaN}, "start"); }), HasSubstr("start is not finite"));
}

TEST(ShownPlan, IsOverWhenTheArmHasLeftAndArrived) {
  const ArmVector start = ArmVector::Zero();
  ArmVector end = start;
  end[3] = 1.0;
  const Eigen::Isometry3d here = Eigen::Isometry3d::Identity();
  ShownPlan plan(start, end, here);
  EXPECT_FALSE(plan.isOver(start, here));
  EXPECT_FALSE(plan.isOver(0.5 * end, here));
  EXPECT_FALSE(plan.isOver(std::nullopt, std::nullopt)) << "nothing is known of the robot";
  EXPECT_TRUE(plan.isOver(end, here));
  // Back to where it began: not before it has left.
  ShownPlan round(start, start, here);
  EXPECT_FALSE(round.isOver(start, here));
  EXPECT_FALSE(round.isOver(end, here));
  EXPECT_TRUE(round.isOver(start, here));
}

TEST(ShownPlan, IsOverWhenTheBaseHasMoved) {
  const Eigen::Isometry3d T_map_base =
      Eigen::Translation3d(2.0, -1.0, 0.0) * Eigen::AngleAxisd(1.0, Eigen::Vector3d::UnitZ());
  const auto after = [&](double x_m, double yaw_rad) {
    ShownPlan failure(ArmVector::Zero(), std::nullopt, T_map_base);
    return failure.isOver(ArmVector::Zero(), T_map_base * Eigen::Translation3d(x_m, 0.0, 0.0) *
                                                 Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()));
  };
  EXPECT_FALSE(after(0.0, 0.0));
  EXPECT_FALSE(after(0.04, 0.04)) << "a correction of the localisation";
  EXPECT_TRUE(after(0.06, 0.0));
  EXPECT_TRUE(after(0.0, -0.06));
}

}  // namespace
}  // namespace motion_planning_ros
