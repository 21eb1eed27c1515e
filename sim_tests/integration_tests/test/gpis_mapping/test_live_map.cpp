// SPDX-License-Identifier: BSD-3-Clause
// The map as a plain node and as a nodelet: what it publishes is the scene, and what is taken away is gone at once.
#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

#include <interactive_mapping_msgs/SurfaceMesh.h>
#include <nav_msgs/OccupancyGrid.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <visualization_msgs/Marker.h>

#include "live_map.h"

namespace integration_tests {
namespace {

using interactive_mapping_msgs::SurfaceMesh;
using nav_msgs::OccupancyGrid;
using sensor_msgs::PointCloud2;
using synthetic_depth::Box;
using synthetic_depth::SceneDistance;
using synthetic_depth::test::Errors;
using visualization_msgs::Marker;

constexpr double kStep_s = 5.0;   // between images: the camera may move 7.5 m at the default speed limit
constexpr int kRemovalFrame = 4;  // the first without box kGone
constexpr int kLastFrame = 4;
constexpr int kGone = 0;
constexpr int kStays = 1;
constexpr double kMapFromScene_rad = 0.35;

/// Two boxes on the floor, four looks from around, then one that sees all of the place where a box was taken away.
Scene twoBoxes() {
  Scene scene = synthetic_depth::test::makeLooks(
      {{0.6, 0.7, 0.7}, {-0.6, 0.7, 0.7}, {-0.6, -0.7, 0.7}, {0.6, -0.7, 0.7}, {-0.7, 0.6, 0.8}}, {0.0, 0.0, 0.05});
  scene.camera = tinyCamera();
  scene.boxes = {synthetic_depth::test::makeBox(kGone, {-0.16, 0.06, 0.08}, {0.08, 0.10, 0.08}, {0.0, 0.0, 0.3}),
                 synthetic_depth::test::makeBox(kStays, {0.2, -0.08, 0.1}, {0.08, 0.08, 0.1}, {0.0, 0.0, -0.5})};
  scene.boxes[kGone].vanishes_at_frame = kRemovalFrame;
  // A floor as level as floors are, off the lattice of the map's cells.
  scene.T_map_scene = synthetic_depth::poseFromXyzRpy({0.1137, -0.0713, 0.0571}, {0.02, -0.015, kMapFromScene_rad});
  return scene;
}

Eigen::Matrix3Xd verticesOf(const SurfaceMesh& mesh) {
  Eigen::Matrix3Xd out(3, static_cast<Eigen::Index>(mesh.mesh.vertices.size()));
  for (std::size_t i = 0; i < mesh.mesh.vertices.size(); ++i) {
    const geometry_msgs::Point& p = mesh.mesh.vertices[i];
    out.col(static_cast<Eigen::Index>(i)) << p.x, p.y, p.z;
  }
  return out;
}

/// One row per field.
Eigen::MatrixXd fieldsOf(const PointCloud2& cloud, const std::vector<std::string>& fields) {
  Eigen::MatrixXd out(static_cast<Eigen::Index>(fields.size()), static_cast<Eigen::Index>(cloud.width * cloud.height));
  for (std::size_t row = 0; row < fields.size(); ++row) {
    sensor_msgs::PointCloud2ConstIterator<float> value(cloud, fields[row]);
    for (Eigen::Index i = 0; i < out.cols(); ++i, ++value) out(static_cast<Eigen::Index>(row), i) = *value;
  }
  return out;
}

/// Points that can only belong to the box: on it, and well off whatever else is there. At its foot a point may be the
/// floor's; 3 cm is the map's tolerance and its reach round an edge.
int countOnBoxAlone(const Scene& scene, const Box& box, const Eigen::Matrix3Xd& points) {
  const Eigen::VectorXd to_rest = SceneDistance(scene, kRemovalFrame).signedDistance(points);
  int count = 0;
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    if (to_rest[i] > 0.03 && std::abs(synthetic_depth::test::boxDistance(scene, box, points.col(i))) < 0.02) ++count;
  }
  return count;
}

/// Target node, encoding.
class LiveMapTest : public testing::TestWithParam<std::tuple<const char*, const char*>> {
 protected:
  LiveMapTest()
      : live_(std::get<0>(GetParam())),
        mesh_(live_.node() + "/mesh"),
        marker_(live_.node() + "/mesh_marker"),
        points_(live_.node() + "/points"),
        removed_(live_.node() + "/removed_points"),
        ground_(live_.node() + "/ground"),
        slice_(live_.node() + "/slice") {}

  void SetUp() override {
    ASSERT_TRUE(live_.connect());
    ASSERT_TRUE(live_.clear());
  }

  /// Feeds frames [first, last]; each must be accepted.
  MapUpdate feed(int first, int last) {
    MapUpdate update;
    for (int frame = first; frame <= last; ++frame) {
      update = live_.look(scene_, frame, std::get<1>(GetParam()), kStep_s);
      EXPECT_EQ(static_cast<int>(update.status), MapUpdate::ACCEPTED) << update.message;
      EXPECT_EQ(update.update, static_cast<std::uint64_t>(frame + 1));
      EXPECT_EQ(update.header.frame_id, "map");
    }
    return update;
  }

  const Scene scene_ = twoBoxes();
  LiveMap live_;
  Latest<SurfaceMesh> mesh_;
  Latest<Marker> marker_;
  Latest<PointCloud2> points_, removed_;
  Latest<OccupancyGrid> ground_;
  Latest<PointCloud2> slice_;
};

TEST_P(LiveMapTest, PublishesTheSceneAsMesh) {
  const MapUpdate update = feed(0, kRemovalFrame - 1);
  const SurfaceMesh& mesh = mesh_.awaitStamp(live_.stamp());
  EXPECT_EQ(mesh.header.frame_id, "map");
  EXPECT_EQ(mesh.update, update.update);
  const Eigen::Matrix3Xd vertices = verticesOf(mesh);
  // 1.2 m^2 in view by voxels of 14.3 mm: some 6000.
  ASSERT_GT(vertices.cols(), 3000);
  ASSERT_EQ(mesh.normals.size(), 3 * mesh.mesh.vertices.size());
  ASSERT_EQ(mesh.variance.size(), mesh.mesh.vertices.size());

  const SceneDistance truth(scene_, kRemovalFrame - 1);
  const Errors errors(truth.signedDistance(vertices));
  EXPECT_EQ(errors.numNan(), 0u);
  // Faces are exact to a millimetre; edges are rounded over the spacing of 2 cm, and two boxes are little but edges
  // in an image of 10 mm per pixel.
  EXPECT_LT(errors.rms(), 0.004);
  EXPECT_LT(errors.shareAbove(0.02), 0.005) << "max " << errors.max();

  // Half a centimetre along the normal is farther outside; not at edges, where the nearest face is another one.
  const Eigen::Matrix3Xd normals =
      Eigen::Map<const Eigen::Matrix3Xf>(mesh.normals.data(), 3, vertices.cols()).cast<double>();
  const double ahead_m = 0.005;
  const Eigen::VectorXd gain =
      truth.signedDistance(vertices + ahead_m * normals) - truth.signedDistance(vertices - ahead_m * normals);
  EXPECT_LT((normals.colwise().norm().array() - 1.0).abs().maxCoeff(), 1e-4);  // float32
  EXPECT_GT((gain.array() > 0.5 * ahead_m).cast<double>().mean(), 0.99);
  EXPECT_EQ((Eigen::Map<const Eigen::VectorXf>(mesh.variance.data(), vertices.cols()).array() > 0.0f).count(),
            vertices.cols());

  std::size_t num_outward = 0;
  for (const shape_msgs::MeshTriangle& triangle : mesh.mesh.triangles) {
    Eigen::Vector3d corner[3];
    Eigen::Vector3d normal = Eigen::Vector3d::Zero();
    for (int i = 0; i < 3; ++i) {
      ASSERT_LT(triangle.vertex_indices[i], vertices.cols());
      corner[i] = vertices.col(triangle.vertex_indices[i]);
      normal += normals.col(triangle.vertex_indices[i]);
    }
    if ((corner[1] - corner[0]).cross(corner[2] - corner[0]).dot(normal) >= 0.0) ++num_outward;
  }
  // Slivers at edges may be turned against the mean of their corners' normals.
  EXPECT_GT(static_cast<double>(num_outward), 0.99 * static_cast<double>(mesh.mesh.triangles.size()));

  const Marker& marker = marker_.awaitStamp(live_.stamp());
  EXPECT_EQ(marker.type, static_cast<int>(Marker::TRIANGLE_LIST));
  EXPECT_EQ(marker.action, static_cast<int>(Marker::ADD));
  EXPECT_EQ(marker.header.frame_id, "map");
  EXPECT_EQ(marker.points.size(), 3 * mesh.mesh.triangles.size());
  EXPECT_EQ(marker.colors.size(), marker.points.size());
}

TEST_P(LiveMapTest, PublishesPointsOnTheScene) {
  const MapUpdate update = feed(0, kRemovalFrame - 1);
  const PointCloud2& cloud = points_.awaitStamp(live_.stamp());
  EXPECT_EQ(cloud.header.frame_id, "map");
  ASSERT_EQ(cloud.width * cloud.height, update.map_points);
  const SceneDistance truth(scene_, kRemovalFrame - 1);
  const Eigen::Matrix3Xd points = fieldsOf(cloud, {"x", "y", "z"});
  const Errors errors(truth.signedDistance(points));
  EXPECT_LT(errors.rms(), 0.003);  // a third of a pixel's 10 mm on the ground, for surfaces at 45 degrees and edges
  const Eigen::Matrix3Xd normals = fieldsOf(cloud, {"normal_x", "normal_y", "normal_z"});
  const Eigen::VectorXd gain =
      truth.signedDistance(points + 0.005 * normals) - truth.signedDistance(points - 0.005 * normals);
  EXPECT_GT((gain.array() > 0.0025).cast<double>().mean(), 0.97);  // normals at edges lie between two faces
  EXPECT_GT(fieldsOf(cloud, {"std"}).minCoeff(), 0.0);
}

TEST_P(LiveMapTest, PublishesTheGroundOccupiedWhereBoxesStandAndFreeOnTheFloor) {
  feed(0, kRemovalFrame - 1);
  const OccupancyGrid& grid = ground_.awaitStamp(live_.stamp());
  EXPECT_EQ(grid.header.frame_id, "map");
  ASSERT_EQ(grid.data.size(), static_cast<std::size_t>(grid.info.width) * grid.info.height);
  ASSERT_GT(grid.info.resolution, 0.0f);
  const double half_diagonal_m = 0.5 * grid.info.resolution * std::sqrt(2.0);
  int num_box = 0;
  int num_box_occupied = 0;
  int num_floor = 0;
  int num_floor_free = 0;
  int num_floor_occupied = 0;
  for (std::uint32_t row = 0; row < grid.info.height; ++row) {
    for (std::uint32_t column = 0; column < grid.info.width; ++column) {
      const Eigen::Vector3d p_map(grid.info.origin.position.x + (column + 0.5) * grid.info.resolution,
                                  grid.info.origin.position.y + (row + 0.5) * grid.info.resolution,
                                  grid.info.origin.position.z);
      const int value = grid.data[static_cast<std::size_t>(row) * grid.info.width + column];
      Eigen::Vector3d p_scene = scene_.T_map_scene.inverse() * p_map;
      // Footprint: inside when the whole cell is, 1 cm for the tilt of a box 0.2 m high.
      p_scene.z() = 0.1;
      double to_boxes = 1.0;
      for (const Box& box : scene_.boxes) {
        Eigen::Vector3d p = box.T_scene_box.inverse() * p_scene;
        p.z() = 0.0;
        const Eigen::Vector3d q = p.cwiseAbs() - box.half_extents_m;
        to_boxes = std::min(to_boxes,
                            Eigen::Vector2d(q.head<2>().cwiseMax(0.0)).norm() + std::min(0.0, q.head<2>().maxCoeff()));
      }
      if (to_boxes < -half_diagonal_m) {
        ++num_box;
        num_box_occupied += value == 100 ? 1 : 0;
      } else if (to_boxes > half_diagonal_m + 0.01 && p_scene.head<2>().norm() < 0.4) {
        ++num_floor;  // all four looks see the floor this far from the middle
        num_floor_free += value == 0 ? 1 : 0;
        num_floor_occupied += value == 100 ? 1 : 0;
      }
    }
  }
  ASSERT_GT(num_box, 3);
  ASSERT_GT(num_floor, 100);
  EXPECT_EQ(num_box_occupied, num_box);
  EXPECT_EQ(num_floor_occupied, 0);
  EXPECT_GT(num_floor_free, 0.98 * num_floor);  // a cell between the boxes may have been seen by a grazing look only
}

TEST_P(LiveMapTest, PublishesASliceOfTrueDistances) {
  feed(0, kRemovalFrame - 1);
  const PointCloud2& cloud = slice_.awaitStamp(live_.stamp());
  EXPECT_EQ(cloud.header.frame_id, "map");
  const Eigen::MatrixXd slice = fieldsOf(cloud, {"x", "y", "z", "distance", "std"});
  ASSERT_GT(slice.cols(), 300);
  EXPECT_LT((slice.row(2).array() - 0.1).abs().maxCoeff(), 1e-6);  // the default height, as float32
  const Eigen::VectorXd truth = SceneDistance(scene_, kRemovalFrame - 1).signedDistance(slice.topRows<3>());
  std::vector<double> outside;
  int num_inside = 0;
  for (Eigen::Index i = 0; i < slice.cols(); ++i) {
    const Eigen::Vector3d p_scene = scene_.T_map_scene.inverse() * slice.col(i).head<3>();
    // Farther out, the nearest floor is one that no look has seen.
    if (truth[i] > 0.0 && p_scene.head<2>().norm() < 0.4) outside.push_back(slice(3, i) - truth[i]);
    // 2 cm inside: beyond the rounding of edges.
    if (truth[i] < -0.02) {
      ++num_inside;
      EXPECT_LT(slice(3, i), 0.0) << slice.col(i).transpose();
    }
  }
  EXPECT_GT(num_inside, 3);
  const Errors errors(outside);
  EXPECT_LT(errors.quantile(0.5), 0.005);
  EXPECT_LT(errors.quantile(0.9), 0.02);  // to the nearest training point, of which there is one every 2 cm
}

TEST_P(LiveMapTest, ForgetsARemovedBoxInTheUpdateThatSeesPastIt) {
  feed(0, kRemovalFrame - 1);
  const Box& gone = scene_.boxes[kGone];
  const Box& stays = scene_.boxes[kStays];
  const Eigen::Vector3d inside = scene_.T_map_scene * gone.T_scene_box * Eigen::Vector3d::Zero();
  const Eigen::Vector3d above = scene_.T_map_scene * gone.T_scene_box * Eigen::Vector3d(0.0, 0.0, 0.09);
  Eigen::Matrix3Xd asked(3, 2);
  asked << inside, above;
  QueryMap::Response answer = live_.ask(asked);
  ASSERT_TRUE(answer.success) << answer.message;
  EXPECT_EQ(static_cast<int>(answer.state[0]), QueryMap::Response::OCCUPIED);
  EXPECT_LT(answer.distance[0], 0.0);
  EXPECT_NEAR(answer.distance[1], 0.01, 0.004);  // 1 cm above its top; as good as the mesh
  // Top 0.16 x 0.2 m and 5 to 13 cm of the sides, one point per 2 cm disc packed at random: 1740 per m^2 is 120.
  ASSERT_GT(countOnBoxAlone(scene_, gone, fieldsOf(points_.awaitStamp(live_.stamp()), {"x", "y", "z"})), 80);
  ASSERT_GT(countOnBoxAlone(scene_, gone, verticesOf(mesh_.awaitStamp(live_.stamp()))), 200);
  ASSERT_EQ(removed_.awaitStamp(live_.stamp()).width, 0u);

  const MapUpdate update = feed(kRemovalFrame, kLastFrame);
  EXPECT_GT(update.deleted, 80u);
  // At once, without waiting for a display: the update is said after the answers know of it.
  answer = live_.ask(asked);
  ASSERT_TRUE(answer.success) << answer.message;
  EXPECT_EQ(answer.update, update.update);
  EXPECT_EQ(answer.header.stamp, live_.stamp());
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(static_cast<int>(answer.state[i]), QueryMap::Response::FREE);
    EXPECT_GT(answer.distance[i], 0.05) << "the floor is 8 cm below the one, 17 cm below the other";
  }
  const SurfaceMesh& mesh = mesh_.awaitStamp(live_.stamp());
  EXPECT_EQ(mesh.update, update.update);
  EXPECT_EQ(countOnBoxAlone(scene_, gone, verticesOf(mesh)), 0);
  const Eigen::Matrix3Xd points = fieldsOf(points_.awaitStamp(live_.stamp()), {"x", "y", "z"});
  EXPECT_EQ(countOnBoxAlone(scene_, gone, points), 0);
  int num_staying = 0;
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    num_staying += std::abs(synthetic_depth::test::boxDistance(scene_, stays, points.col(i))) < 0.01 ? 1 : 0;
  }
  EXPECT_GT(num_staying, 120);  // 0.16 x 0.16 m top, 0.2 m sides of 0.64 m: 0.15 m^2, less what no look sees well

  const Eigen::Matrix3Xd removed = fieldsOf(removed_.awaitStamp(live_.stamp()), {"x", "y", "z"});
  EXPECT_EQ(static_cast<std::uint32_t>(removed.cols()), update.deleted);
  int num_on_box = 0;
  for (Eigen::Index i = 0; i < removed.cols(); ++i) {
    num_on_box += std::abs(synthetic_depth::test::boxDistance(scene_, gone, removed.col(i))) < 0.02 ? 1 : 0;
  }
  // Beside the box's own, single points of the other's silhouette may go: edges move by a pixel (1 cm) between looks.
  EXPECT_GT(num_on_box, 0.9 * static_cast<double>(removed.cols()));
}

INSTANTIATE_TEST_SUITE_P(NodeAndNodelet, LiveMapTest,
                         testing::Combine(testing::Values("/plain", "/loaded"), testing::Values("16UC1", "32FC1")),
                         [](const auto& instance) {
                           return std::string(std::get<0>(instance.param) + 1) + "_" + std::get<1>(instance.param);
                         });

TEST(LiveMapDefaults, AreNotToldWhatTheMagnetTakes) {
  ASSERT_TRUE(ros::service::waitForService("/plain/query", ros::Duration(60.0)));  // offered after all subscriptions
  XmlRpc::XmlRpcValue request(ros::this_node::getName()), response, state;
  ASSERT_TRUE(ros::master::execute("getSystemState", request, response, state, true));
  const XmlRpc::XmlRpcValue& subscribed = state[1];
  ASSERT_GT(subscribed.size(), 0);
  for (int i = 0; i < subscribed.size(); ++i) EXPECT_NE(std::string(subscribed[i][0]), "/attached_brick");
}

TEST(LiveMapWithGenerator, MapsWhatTheSyntheticCameraPublishes) {
  LiveMap live("/generated");
  // Its box comes and goes: taken away at the third of four frames, and back when the sequence starts anew. In so small
  // an image it is 16 points.
  const auto has_deleted = [&] {
    return std::any_of(live.updates.begin(), live.updates.end(), [](const MapUpdate& update) {
      return update.status == MapUpdate::ACCEPTED && update.deleted > 10;
    });
  };
  EXPECT_TRUE(waitUntil(has_deleted)) << live.updates.size() << " updates, the last: "
                                      << (live.updates.empty() ? "" : live.updates.back().message);
}

}  // namespace
}  // namespace integration_tests
