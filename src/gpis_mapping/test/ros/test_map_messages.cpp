// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/map_messages.h"

#include <cmath>
#include <limits>
#include <map>

#include <gtest/gtest.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include "analytic_surfaces.h"

namespace gpis_mapping_ros {
namespace {

using gpis_mapping::GpisMap;
using gpis_mapping::MapContents;
using gpis_mapping::MapSnapshot;
using gpis_mapping::SpaceState;
using gpis_mapping::TriangleMesh;

std_msgs::Header header() {
  std_msgs::Header header;
  header.frame_id = "map";
  header.stamp = ros::Time(12.5);
  return header;
}

/// A level floor at z = 0.2 m, 1 m a side.
std::shared_ptr<const MapSnapshot> floorMap() {
  MapContents contents;
  gpis_mapping_test::sampleRectangle({-0.5, -0.5, 0.2}, {1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, 0.02, 0.002,
                                     &contents.points);
  return GpisMap(std::move(contents)).snapshot();
}

TriangleMesh triangle() {
  TriangleMesh mesh;
  mesh.vertices_map = {{0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, {0.0, 1.0, 2.0}, {1.0, 1.0, 1.0}};
  mesh.normals_map.assign(4, Eigen::Vector3f(0.0f, 0.6f, 0.8f));
  mesh.variance_m2 = {0.0f, 1e-4f, 2.5e-5f, 4.0f};
  mesh.triangles = {{0, 1, 2}, {1, 3, 2}};
  return mesh;
}

TEST(MapMessages, AMeshIsAskedForInABox) {
  interactive_mapping_msgs::GetMesh::Request request;
  EXPECT_TRUE(boxOf(request).contains(Eigen::Vector3d(1e9, -1e9, 0.0)));
  request.min.x = -1.0;
  request.max.z = 2.0;
  EXPECT_EQ(boxOf(request).min(), Eigen::Vector3d(-1.0, 0.0, 0.0));
  EXPECT_EQ(boxOf(request).max(), Eigen::Vector3d(0.0, 0.0, 2.0));
  for (const double bad : {-0.1, std::numeric_limits<double>::quiet_NaN()}) {
    request.max.y = bad;
    EXPECT_THROW(boxOf(request), std::invalid_argument);
  }
}

TEST(MapMessages, SurfaceMeshCarriesEverything) {
  const auto message = toSurfaceMesh(triangle(), header(), 7);
  EXPECT_EQ(message.header.frame_id, "map");
  EXPECT_EQ(message.header.stamp, ros::Time(12.5));
  EXPECT_EQ(message.update, 7u);
  ASSERT_EQ(message.mesh.vertices.size(), 4u);
  EXPECT_EQ(message.mesh.vertices[2].z, 2.0);
  ASSERT_EQ(message.mesh.triangles.size(), 2u);
  EXPECT_EQ(message.mesh.triangles[1].vertex_indices[1], 3u);
  ASSERT_EQ(message.normals.size(), 12u);
  EXPECT_EQ(message.normals[10], 0.6f);
  EXPECT_EQ(message.variance[3], 4.0f);
}

TEST(MapMessages, MarkerHasOneColourPerCornerOnTheAskedScale) {
  TriangleMesh mesh = triangle();
  mesh.normals_map.assign(4, Eigen::Vector3f::UnitZ());  // level: the scale's own colours
  const auto marker = toMarker(mesh, header(), MeshColor::kUncertainty, 0.01);
  EXPECT_EQ(marker.action, visualization_msgs::Marker::ADD);
  ASSERT_EQ(marker.points.size(), 6u);
  ASSERT_EQ(marker.colors.size(), 6u);
  EXPECT_EQ(marker.colors[0].r, colorOf(0.0).r);
  EXPECT_EQ(marker.colors[1].g, colorOf(1.0).g) << "sigma 0.01 m is the far end";
  EXPECT_NEAR(marker.colors[2].g, colorOf(0.5).g, 1e-6);
  EXPECT_EQ(marker.colors[4].g, colorOf(1.0).g) << "beyond the far end";
  const auto by_height = toMarker(mesh, header(), MeshColor::kHeight, 0.01);
  EXPECT_EQ(by_height.colors[2].b, colorOf(1.0).b);
  EXPECT_EQ(by_height.colors[4].b, colorOf(0.5).b);
}

TEST(MapMessages, MarkerTellsTheSidesOfABoxFromItsTopAndFromEachOther) {
  TriangleMesh mesh = triangle();
  mesh.variance_m2.assign(4, 1e-4f);
  mesh.normals_map = {Eigen::Vector3f::UnitZ(), Eigen::Vector3f::UnitX(), Eigen::Vector3f::UnitY(),
                      Eigen::Vector3f::Constant(std::numeric_limits<float>::quiet_NaN())};
  mesh.triangles = {{0, 1, 2}, {3, 1, 2}};
  const auto colors = toMarker(mesh, header(), MeshColor::kUncertainty, 0.01).colors;
  EXPECT_GT(colors[0].g, 1.1f * colors[1].g) << "a tenth is seen at once";
  EXPECT_GT(colors[1].g, 1.1f * colors[2].g);
  EXPECT_EQ(colors[3].g, colors[0].g) << "without a normal: the scale's own colour";
}

TEST(MapMessages, BlanketHasThreeSheetsWithoutTrianglesAcrossEdges) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  const auto knotAt = [](float x, float y, float z, bool is_wall) {
    return gpis_mapping::FrameBlanket::Knot{{x, y, z - 0.1f}, {x, y, z}, {x, y, z + 0.1f}, is_wall};
  };
  gpis_mapping::FrameBlanket blanket;
  blanket.columns = 5;  // a square of two triangles, an edge, a square of wall, and one without a corner
  for (const float y : {0.0f, 0.1f}) {
    blanket.knots.push_back(knotAt(0.0f, y, 1.0f, false));
    blanket.knots.push_back(knotAt(0.1f, y, 1.0f, false));
    blanket.knots.push_back(knotAt(0.2f, y, 1.5f, true));
    blanket.knots.push_back(knotAt(0.3f, y, 1.5f, true));
    blanket.knots.push_back(knotAt(0.4f, y, y == 0.0f ? kNan : 1.5f, true));
  }
  const visualization_msgs::MarkerArray array = toMarkers(blanket, header());
  ASSERT_EQ(array.markers.size(), 3u);
  for (const visualization_msgs::Marker& marker : array.markers) {
    ASSERT_EQ(marker.points.size(), 15u) << marker.ns;
    ASSERT_EQ(marker.colors.size(), 15u) << marker.ns;
    const double offset_m = marker.ns == "nearer" ? -0.1 : marker.ns == "farther" ? 0.1 : 0.0;
    for (std::size_t i = 0; i < 15; ++i) EXPECT_NEAR(marker.points[i].z, (i < 6 ? 1.0 : 1.5) + offset_m, 1e-6);
    EXPECT_NE(marker.colors.front(), marker.colors.back()) << "the wall is another colour";
  }
  EXPECT_EQ(toMarkers({}, header()).markers.at(0).action, visualization_msgs::Marker::DELETE);
}

TEST(MapMessages, MarkerOfNothingDeletes) {
  EXPECT_EQ(toMarker(TriangleMesh(), header(), MeshColor::kHeight, 0.01).action, visualization_msgs::Marker::DELETE);
}

TEST(MapMessages, ColoursSurviveNumbersThatAreNone) {
  for (const double share : {-1.0, 0.0, 1.0, 2.0, 1e300, std::numeric_limits<double>::quiet_NaN()}) {
    const auto color = colorOf(share);
    EXPECT_GE(color.r, 0.0f);
    EXPECT_LE(color.r, 1.0f);
    EXPECT_EQ(color.a, 1.0f);
  }
}

TEST(MapMessages, PointCloudHoldsPointsNormalsAndStandardDeviations) {
  sensor_msgs::PointCloud2 cloud = toPointCloud(*floorMap(), header());
  ASSERT_EQ(cloud.width, 2500u);
  sensor_msgs::PointCloud2ConstIterator<float> z(cloud, "z");
  sensor_msgs::PointCloud2ConstIterator<float> normal(cloud, "normal_z");
  sensor_msgs::PointCloud2ConstIterator<float> std_m(cloud, "std");
  for (; z != z.end(); ++z, ++normal, ++std_m) {
    EXPECT_NEAR(*z, 0.2f, 1e-6f);
    EXPECT_NEAR(*normal, 1.0f, 1e-6f);
    EXPECT_NEAR(*std_m, 0.002f, 1e-4f);
  }
}

TEST(MapMessages, SurfaceCloudHoldsTheMeshsVerticesNormalsAndVariances) {
  const TriangleMesh mesh = triangle();
  const sensor_msgs::PointCloud2 cloud = toPointCloud(mesh, header());
  EXPECT_EQ(cloud.header.frame_id, "map");
  ASSERT_EQ(cloud.width, 4u);
  const std::vector<std::string> names{"x", "y", "z", "normal_x", "normal_y", "normal_z", "variance"};
  ASSERT_EQ(cloud.fields.size(), names.size());
  for (std::size_t field = 0; field < names.size(); ++field) {
    EXPECT_EQ(cloud.fields[field].name, names[field]);
    sensor_msgs::PointCloud2ConstIterator<float> value(cloud, names[field]);
    for (std::size_t i = 0; i < 4; ++i, ++value) {
      const double expected = field < 3   ? mesh.vertices_map[i][static_cast<Eigen::Index>(field)]
                              : field < 6 ? mesh.normals_map[i][static_cast<Eigen::Index>(field - 3)]
                                          : mesh.variance_m2[i];
      EXPECT_EQ(*value, static_cast<float>(expected)) << names[field] << ' ' << i;
    }
  }
  EXPECT_EQ(toPointCloud(TriangleMesh(), header()).width, 0u);
}

TEST(MapMessages, EsdfSliceHasTheAnswersOfQueriesAsIntensity) {
  const auto snapshot = floorMap();
  GpisMappingParams::Slice slice;
  for (const double height_m : {0.3, 0.12}) {  // outside, inside
    slice.height_m = height_m;
    const sensor_msgs::PointCloud2 cloud = toIntensityCloud(makeSlice(*snapshot, slice, 1000), header());
    ASSERT_GT(cloud.width, 100u);
    ASSERT_EQ(cloud.fields.size(), 4u);
    sensor_msgs::PointCloud2ConstIterator<float> x(cloud, "x");
    sensor_msgs::PointCloud2ConstIterator<float> y(cloud, "y");
    sensor_msgs::PointCloud2ConstIterator<float> z(cloud, "z");
    sensor_msgs::PointCloud2ConstIterator<float> intensity(cloud, "intensity");
    for (; x != x.end(); ++x, ++y, ++z, ++intensity) {
      EXPECT_EQ(*z, static_cast<float>(height_m));
      const double distance_m = snapshot->query(gpis_mapping::Points3d(Eigen::Vector3d(*x, *y, height_m))).distance[0];
      EXPECT_NEAR(*intensity, distance_m, 1e-6);  // float32, of the place too
      EXPECT_EQ(*intensity < 0.0f, height_m < 0.2);
    }
  }
}

TEST(MapMessages, SliceHoldsTheDistanceToTheFloorAndNoMoreCellsThanAllowed) {
  const auto snapshot = floorMap();
  GpisMappingParams::Slice slice;
  slice.height_m = 0.23;
  slice.margin_m = 0.0;
  for (const std::size_t max_cells : {100000u, 200u}) {
    sensor_msgs::PointCloud2 cloud = toPointCloud(makeSlice(*snapshot, slice, max_cells), header());
    ASSERT_GT(cloud.width, 100u);
    EXPECT_LE(cloud.width, max_cells + 30u);  // the last row and column may stand out
    sensor_msgs::PointCloud2ConstIterator<float> x(cloud, "x");
    sensor_msgs::PointCloud2ConstIterator<float> y(cloud, "y");
    sensor_msgs::PointCloud2ConstIterator<float> distance(cloud, "distance");
    for (; x != x.end(); ++x, ++y, ++distance) {
      if (std::abs(*x) > 0.45f || std::abs(*y) > 0.45f) continue;  // beyond the rim it is the distance to the rim
      EXPECT_NEAR(*distance, 0.03f, 0.002f);                       // the noise that the points claim
    }
  }
  const SliceCells nothing = makeSlice(*GpisMap(gpis_mapping::GpisConfig()).snapshot(), slice, 100);
  EXPECT_EQ(toPointCloud(nothing, header()).width, 0u);
  EXPECT_EQ(toMarker(nothing, header()).action, visualization_msgs::Marker::DELETE);
}

TEST(MapMessages, SliceMarkerHasASquarePerCellRedInsideBlueOutsideWhiteBetween) {
  SliceCells slice;
  slice.cell_size_m = 0.04;
  slice.centres_map = (gpis_mapping::Points3d(3, 3) << 0.0, 1.0, 2.0, 0.0, 0.5, 0.0, 0.3, 0.3, 0.3).finished();
  slice.distance = Eigen::Vector3d(-1.0, 0.0, 1.0);
  slice.std = Eigen::Vector3d::Zero();
  const auto marker = toMarker(slice, header());
  EXPECT_EQ(marker.action, visualization_msgs::Marker::ADD);
  ASSERT_EQ(marker.points.size(), 18u);
  ASSERT_EQ(marker.colors.size(), 18u);
  double area = 0.0;
  for (std::size_t i = 6; i < 12; i += 3) {
    const auto &a = marker.points[i], &b = marker.points[i + 1], &c = marker.points[i + 2];
    area += 0.5 * ((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x));
    for (const auto& corner : {a, b, c}) {
      EXPECT_NEAR(std::abs(corner.x - 1.0), 0.02, 1e-12);
      EXPECT_NEAR(std::abs(corner.y - 0.5), 0.02, 1e-12);
      EXPECT_EQ(corner.z, 0.3);
    }
  }
  EXPECT_NEAR(area, 0.04 * 0.04, 1e-12) << "both triangles, and both seen from above";
  EXPECT_GT(marker.colors[0].r, 2.0f * marker.colors[0].b);
  EXPECT_EQ(marker.colors[6].r, 1.0f);
  EXPECT_EQ(marker.colors[6].b, 1.0f);
  EXPECT_GT(marker.colors[12].b, 2.0f * marker.colors[12].r);
}

TEST(MapMessages, OccupancyGridKeepsStatesInRowsFromTheOrigin) {
  gpis_mapping::GroundGrid grid;
  grid.width = 2;
  grid.height = 3;
  grid.cell_size_m = 0.1;
  grid.origin_x_m = -1.0;
  grid.origin_y_m = 2.0;
  grid.plane.offset_m = 0.4;
  grid.state = {SpaceState::kFree,    SpaceState::kOccupied, SpaceState::kUnknown,
                SpaceState::kUnknown, SpaceState::kUnknown,  SpaceState::kFree};
  const auto message = toOccupancyGrid(grid, header());
  EXPECT_EQ(message.data, (std::vector<std::int8_t>{0, 100, -1, -1, -1, 0}));
  EXPECT_EQ(message.info.width, 2u);
  EXPECT_EQ(message.info.height, 3u);
  EXPECT_EQ(message.info.origin.position.x, -1.0);
  EXPECT_EQ(message.info.origin.position.y, 2.0);
  EXPECT_EQ(message.info.origin.position.z, 0.4);
  EXPECT_EQ(message.info.origin.orientation.w, 1.0);
  EXPECT_FLOAT_EQ(message.info.resolution, 0.1f);
}

TEST(MapMessages, AnswersTurnDirectionsIntoTheFrameAskedFor) {
  const auto snapshot = floorMap();
  geometry_msgs::Point above;
  above.z = 0.215;
  geometry_msgs::Point bad;
  bad.x = std::numeric_limits<double>::quiet_NaN();
  const gpis_mapping::Points3d points = toPoints({above, bad});
  const Eigen::Matrix3d R = Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitX()).toRotationMatrix();  // z to -y
  interactive_mapping_msgs::QueryMap::Response answer;
  fillAnswer(snapshot->query(points), R, true, &answer);
  ASSERT_EQ(answer.distance.size(), 2u);
  EXPECT_NEAR(answer.distance[0], 0.015, 0.002);
  EXPECT_NEAR(answer.gradient[0].y, -1.0, 0.01);
  EXPECT_NEAR(answer.gradient[0].z, 0.0, 0.01);
  EXPECT_NEAR(answer.euclidean_distance[0], 0.015, 0.002);
  EXPECT_GT(answer.variance[0], 0.0);
  EXPECT_TRUE(std::isnan(answer.distance[1]));
  EXPECT_EQ(answer.state[1], static_cast<std::uint8_t>(SpaceState::kUnknown));
  interactive_mapping_msgs::QueryMap::Response brief;
  fillAnswer(snapshot->query(points), R, false, &brief);
  EXPECT_TRUE(brief.variance.empty());
  EXPECT_TRUE(brief.occupancy.empty());
}

TEST(MapMessages, AnswersHoldTheDerivativeOfTheirVarianceInTheFrameAskedFor) {
  const auto snapshot = floorMap();
  const Eigen::Matrix3d R_out_map =
      Eigen::AngleAxisd(0.8, Eigen::Vector3d(1.0, -2.0, 0.5).normalized()).toRotationMatrix();
  // Beside the floor's rim, where all three components differ, and a point that is none; then the neighbours of the
  // first along the axes of the frame that is asked in.
  const Eigen::Vector3d p_map(0.49, 0.47, 0.21);
  constexpr double kStep_m = 1e-3;
  gpis_mapping::Points3d points_map(3, 8);
  points_map.col(0) = p_map;
  points_map.col(1).setConstant(std::numeric_limits<double>::quiet_NaN());
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d step_map = kStep_m * R_out_map.transpose().col(axis);
    points_map.col(2 + 2 * axis) = p_map - step_map;
    points_map.col(3 + 2 * axis) = p_map + step_map;
  }
  gpis_mapping::QueryOptions options;
  options.variance_gradient = true;
  interactive_mapping_msgs::QueryMap::Response answer;
  fillAnswer(snapshot->query(points_map, options), R_out_map, true, &answer);
  ASSERT_EQ(answer.variance.size(), 8u);
  ASSERT_EQ(answer.variance_gradient.size(), 8u);
  const auto& g = answer.variance_gradient[0];
  const Eigen::Vector3d gradient(g.x, g.y, g.z);
  const double prior = std::pow(snapshot->config().signalStd(), 2);
  EXPECT_GT(gradient.cwiseAbs().minCoeff(), 0.5 * prior) << "or the comparison would say nothing";
  for (int axis = 0; axis < 3; ++axis) {
    const auto at = static_cast<std::size_t>(2 + 2 * axis);
    // As in test_map_snapshot: the variance is a float.
    EXPECT_NEAR(gradient[axis], (answer.variance[at + 1] - answer.variance[at]) / (2.0 * kStep_m), 0.3 * prior) << axis;
  }
  EXPECT_TRUE(std::isnan(answer.variance_gradient[1].x));

  interactive_mapping_msgs::QueryMap::Response variance_only;
  fillAnswer(snapshot->query(points_map), R_out_map, true, &variance_only);
  ASSERT_EQ(variance_only.variance.size(), 8u);
  for (const std::size_t i : {0u, 2u, 7u}) EXPECT_EQ(variance_only.variance[i], answer.variance[i]);
  EXPECT_TRUE(variance_only.variance_gradient.empty());
}

}  // namespace
}  // namespace gpis_mapping_ros
