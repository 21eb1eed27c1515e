// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/brick_markers.h"

#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>

#include "brick_detection_ros/conversions.h"

namespace brick_detection_ros {
namespace {

using interactive_mapping_msgs::Brick;
using interactive_mapping_msgs::BrickArray;
using testing::IsEmpty;
using testing::SizeIs;
using visualization_msgs::Marker;
using visualization_msgs::MarkerArray;

const mp700_ur5e_description::BrickCatalogue& catalogue() {
  static const auto kCatalogue = mp700_ur5e_description::loadBrickTypes(BRICKS_YAML);
  return kCatalogue;
}

Brick brick(int id, int instance) {
  brick_detection::TrackedBrick tracked;
  tracked.id = id;
  tracked.instance = instance;
  tracked.T_map_brick.translation() << 1.0, 2.0, 0.1;
  tracked.covariance = brick_detection::Matrix6d::Identity() * 1e-6;
  tracked.covariance(0, 0) = 4e-6;  // 2 mm along x, 1 mm else
  brick_detection::FaceAccess face;
  face.face = mp700_ur5e_description::BrickFace::kPlusZ;
  face.T_map_plate.translation() << 1.0, 2.0, 0.2;
  face.accessibility = 0.75;
  return toMessage(tracked, catalogue().types.front(), {face});
}

std::vector<Marker> select(const MarkerArray& array, const std::string& ns, int action = Marker::ADD) {
  std::vector<Marker> markers;
  for (const Marker& marker : array.markers) {
    if (marker.ns == ns && marker.action == action) markers.push_back(marker);
  }
  return markers;
}

BrickArray arrayOf(const std::vector<Brick>& bricks) {
  BrickArray array;
  array.header.frame_id = "map";
  array.bricks = bricks;
  return array;
}

TEST(BrickMarkers, ShowEachBrickWhereItIs) {
  BrickMarkers markers(catalogue());
  const MarkerArray array = markers.update(arrayOf({brick(3, 0), brick(7, 0)}));
  const std::vector<Marker> cubes = select(array, "bricks");
  ASSERT_THAT(cubes, SizeIs(2));
  EXPECT_EQ(cubes[0].header.frame_id, "map");
  EXPECT_DOUBLE_EQ(cubes[0].scale.x, 0.3);
  EXPECT_DOUBLE_EQ(cubes[0].pose.position.y, 2.0);
  EXPECT_NEAR(cubes[0].color.r, catalogue().types.front().color_rgb.x(), 1e-6);
  EXPECT_NE(cubes[0].id, cubes[1].id);
  ASSERT_THAT(select(array, "ids"), SizeIs(2));
  EXPECT_EQ(select(array, "ids")[1].text, "7");
  EXPECT_GT(select(array, "ids")[0].pose.position.z, 0.2);
}

TEST(BrickMarkers, EllipsoidHasTheStatedNumberOfSigmas) {
  BrickMarkers markers(catalogue());
  const Marker ellipsoid = select(markers.update(arrayOf({brick(3, 0)})), "uncertainty").at(0);
  std::vector<double> diameters = {ellipsoid.scale.x, ellipsoid.scale.y, ellipsoid.scale.z};
  std::sort(diameters.begin(), diameters.end());
  EXPECT_NEAR(diameters[0], 2 * 10 * 0.001, 1e-9);
  EXPECT_NEAR(diameters[1], 2 * 10 * 0.001, 1e-9);
  EXPECT_NEAR(diameters[2], 2 * 10 * 0.002, 1e-9);
  // Its longest axis lies along x.
  const Eigen::Quaterniond q(ellipsoid.pose.orientation.w, ellipsoid.pose.orientation.x, ellipsoid.pose.orientation.y,
                             ellipsoid.pose.orientation.z);
  EXPECT_NEAR(q.norm(), 1.0, 1e-9);
  EXPECT_NEAR(std::abs((q * Eigen::Vector3d::UnitZ()).x()), 1.0, 1e-9);  // eigenvalues rise: z is the last
}

TEST(BrickMarkers, ArrowsPointToTheFacesByTheirColour) {
  BrickMarkers markers(catalogue());
  const Marker arrow = select(markers.update(arrayOf({brick(3, 0)})), "faces").at(0);
  ASSERT_THAT(arrow.points, SizeIs(2));
  EXPECT_NEAR(arrow.points[0].z - arrow.points[1].z, 0.12, 1e-9);
  EXPECT_GT(arrow.points[1].z, 0.2);
  EXPECT_LT(arrow.points[1].z, 0.22);
  EXPECT_NEAR(arrow.color.g, 0.75, 1e-6);
  EXPECT_NEAR(arrow.color.r, 0.25, 1e-6);
}

TEST(BrickMarkers, WhatIsGoneIsDeletedOnce) {
  BrickMarkers markers(catalogue());
  const int kept = select(markers.update(arrayOf({brick(3, 0), brick(7, 0)})), "bricks")[1].id;
  const MarkerArray after = markers.update(arrayOf({brick(7, 0)}));
  ASSERT_THAT(select(after, "bricks"), SizeIs(1));
  EXPECT_EQ(select(after, "bricks")[0].id, kept);
  for (const char* ns : {"bricks", "ids", "uncertainty", "faces"}) {
    ASSERT_THAT(select(after, ns, Marker::DELETE), SizeIs(1)) << ns;
    EXPECT_NE(select(after, ns, Marker::DELETE)[0].id, select(after, ns)[0].id) << ns;
  }
  EXPECT_THAT(select(markers.update(arrayOf({brick(7, 0)})), "bricks", Marker::DELETE), IsEmpty());
}

TEST(BrickMarkers, DuplicatesAreToldByTheirInstance) {
  BrickMarkers markers(catalogue());
  Brick one = brick(5, 0);
  Brick other = brick(5, 1);
  one.has_duplicate = other.has_duplicate = 1;
  const MarkerArray array = markers.update(arrayOf({one, other}));
  ASSERT_THAT(select(array, "ids"), SizeIs(2));
  EXPECT_EQ(select(array, "ids")[0].text, "5 #0 (duplicate id)");
  EXPECT_EQ(select(array, "ids")[1].text, "5 #1 (duplicate id)");
  EXPECT_NE(select(array, "bricks")[0].id, select(array, "bricks")[1].id);
}

}  // namespace
}  // namespace brick_detection_ros
