// SPDX-License-Identifier: BSD-3-Clause
#include "depth_camera_ros/cloud_to_depth.h"

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/shipped_file.h>
#include <sensor_msgs/point_cloud2_iterator.h>

namespace depth_camera_ros {
namespace {

using testing::HasSubstr;

sensor_msgs::PointCloud2 twoPoints() {
  sensor_msgs::PointCloud2 cloud;
  sensor_msgs::PointCloud2Modifier modifier(cloud);
  modifier.setPointCloud2FieldsByString(2, "xyz", "rgb");  // 32 bytes a point
  modifier.resize(2);
  sensor_msgs::PointCloud2Iterator<float> x(cloud, "x"), y(cloud, "y"), z(cloud, "z");
  for (int i = 0; i < 2; ++i, ++x, ++y, ++z) {
    *x = 1.0f + i;
    *y = 3.0f + i;
    *z = 5.0f + i;
  }
  return cloud;
}

std::string problemOf(const sensor_msgs::PointCloud2& cloud) {
  std::string problem;
  EXPECT_FALSE(pointsOf(cloud, &problem));
  return problem;
}

TEST(CloudToDepth, ReadsXyzBesideOtherFields) {
  std::string problem;
  const auto points = pointsOf(twoPoints(), &problem);
  ASSERT_TRUE(points) << problem;
  Eigen::Matrix3Xf expected(3, 2);
  expected << 1, 2, 3, 4, 5, 6;
  EXPECT_EQ(*points, expected);
}

TEST(CloudToDepth, ACloudFromWhichAllWasFilteredHasNoPoints) {
  sensor_msgs::PointCloud2 cloud = twoPoints();
  cloud.width = cloud.row_step = 0;
  cloud.data.clear();
  std::string problem;
  const auto points = pointsOf(cloud, &problem);
  ASSERT_TRUE(points) << problem;
  EXPECT_EQ(points->cols(), 0);
}

TEST(CloudToDepth, RejectsCloudsThatItCannotRead) {
  sensor_msgs::PointCloud2 cloud = twoPoints();
  cloud.data.pop_back();
  EXPECT_THAT(problemOf(cloud), HasSubstr("has 63 bytes"));
  EXPECT_THAT(problemOf(cloud), HasSubstr("must have 64"));
  cloud = twoPoints();
  cloud.fields[1].datatype = sensor_msgs::PointField::FLOAT64;
  EXPECT_THAT(problemOf(cloud), HasSubstr("no field y of type FLOAT32"));
  cloud = twoPoints();
  cloud.fields[2].offset = cloud.point_step - 1;
  EXPECT_THAT(problemOf(cloud), HasSubstr("no field z"));
  cloud = twoPoints();
  cloud.is_bigendian = true;
  EXPECT_THAT(problemOf(cloud), HasSubstr("big endian"));
  cloud = twoPoints();
  cloud.width = 1;
  cloud.height = 2;
  cloud.row_step = 64;
  EXPECT_THAT(problemOf(cloud), HasSubstr("rows of 64"));
}

TEST(CloudToDepth, AnglesOfViewAreThoseOfThePinhole) {
  CloudToDepthParams params;
  const depth_camera::CameraModel camera = params.camera();
  // The image's edge is half a pixel beyond its last centre.
  EXPECT_NEAR(std::atan(camera.ray(camera.width - 0.5, 0.0).x()), 0.5 * params.horizontal_rad, 1e-9);
  EXPECT_NEAR(std::atan(camera.ray(0.0, camera.height - 0.5).y()), 0.5 * params.vertical_rad, 1e-9);
}

TEST(CloudToDepth, ShippedFileIsWhatTheFieldsSay) {
  test_support::expectShippedFile<CloudToDepthParams>(DEPTH_CAMERA_DIR "/config/cloud_to_depth.yaml");
}

TEST(CloudToDepth, AnOpticalFrameHasOneView) {
  CloudToDepthParams params;
  params.is_optical = true;
  EXPECT_THAT(interactive_mapping::problemsOf(params), testing::ElementsAre("views = 4, must be 1 with is_optical"));
}

}  // namespace
}  // namespace depth_camera_ros
