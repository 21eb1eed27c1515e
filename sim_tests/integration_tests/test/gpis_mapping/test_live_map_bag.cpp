// SPDX-License-Identifier: BSD-3-Clause
// mapping.launch on a recording, by arguments alone.
#include <filesystem>

#include <rosbag/bag.h>

#include <interactive_mapping_common/testing/process.h>
#include "live_map.h"

namespace integration_tests {
namespace {

namespace fs = std::filesystem;

constexpr int kNumFrames = 20;
constexpr char kFrame[] = "rgb_camera_link";  // depth registered to the colour camera

Scene orbit() {
  synthetic_depth::OrbitConfig config;
  config.radius_m = 0.8;
  config.height_m = 0.7;
  config.turns = 0.25;
  config.frames = kNumFrames;
  Scene scene;
  scene.camera = tinyCamera();
  scene.T_scene_camera = synthetic_depth::orbitPoses(config);
  scene.boxes = {synthetic_depth::test::makeBox(0, {0.0, 0.0, 0.08}, {0.08, 0.10, 0.08}, {0.0, 0.0, 0.3})};
  scene.fps = 5.0;
  return scene;
}

/// As a static transform's publisher: whoever comes later gets it, too.
boost::shared_ptr<ros::M_string> latchedHeader() {
  auto header = boost::make_shared<ros::M_string>();
  (*header)["type"] = ros::message_traits::datatype<tf2_msgs::TFMessage>();
  (*header)["md5sum"] = ros::message_traits::md5sum<tf2_msgs::TFMessage>();
  (*header)["message_definition"] = ros::message_traits::definition<tf2_msgs::TFMessage>();
  (*header)["callerid"] = "/camera";
  (*header)["latching"] = "1";
  return header;
}

/// Topics and frames of an Azure Kinect's driver: the pose is known of its base, the rest is a static transform.
void record(const Scene& scene, const std::string& path) {
  rosbag::Bag bag(path, rosbag::bagmode::Write);
  const Eigen::Isometry3d T_base_camera = synthetic_depth::poseFromXyzRpy({0.03, 0.0, 0.02}, {-1.5, 0.0, -1.57});
  tf2_msgs::TFMessage fixed;
  fixed.transforms = {toTransform(T_base_camera)};
  fixed.transforms[0].header.frame_id = "camera_base";
  fixed.transforms[0].child_frame_id = kFrame;
  fixed.transforms[0].header.stamp = ros::Time(scene.stampSeconds(0));
  bag.write("/tf_static", ros::Time(scene.stampSeconds(0)), fixed, latchedHeader());
  for (int frame = 0; frame < scene.numFrames(); ++frame) {
    LiveFrame live = toLiveFrame(scene, frame, "16UC1");
    live.setCameraFrame(kFrame);
    live.setStamp(ros::Time(scene.stampSeconds(frame)));
    tf2_msgs::TFMessage moving;
    moving.transforms = {toTransform(scene.cameraInMap(frame) * T_base_camera.inverse())};
    moving.transforms[0].header.stamp = live.image.header.stamp;
    moving.transforms[0].child_frame_id = "camera_base";
    bag.write("/tf", live.image.header.stamp, moving);
    bag.write("/depth_to_rgb/camera_info", live.image.header.stamp, live.info);
    bag.write("/depth_to_rgb/image_raw", live.image.header.stamp, live.image);
  }
}

TEST(MappingLaunch, MapsABagOfAnAzureKinectByArgumentsAlone) {
  std::string folder = (fs::temp_directory_path() / "gpis_live_XXXXXX").string();
  ASSERT_NE(::mkdtemp(folder.data()), nullptr);
  const Scene scene = orbit();
  record(scene, folder + "/run.bag");

  std::vector<MapUpdate> updates;
  const ros::Subscriber subscriber = ros::NodeHandle().subscribe<MapUpdate>(
      "/gpis_mapping/update", 100,
      [&](const boost::shared_ptr<const MapUpdate>& update) { updates.push_back(*update); });
  {
    node_tests::Process launch(
        {"roslaunch", "gpis_mapping", "mapping.launch", "camera:=azure_kinect", "bag:=" + folder + "/run.bag"},
        folder + "/log");
    const ros::Time last(scene.stampSeconds(kNumFrames - 1));
    EXPECT_TRUE(waitUntil([&] {
      return (!updates.empty() && updates.back().header.stamp == last) || launch.hasEnded();
    })) << launch.output();
    ASSERT_FALSE(updates.empty()) << launch.output();
    EXPECT_EQ(static_cast<int>(updates.back().status), MapUpdate::ACCEPTED) << updates.back().message;
    // The player begins 0.2 s after it is there, the map may need a second (five images) more.
    EXPECT_GE(updates.back().update, static_cast<std::uint64_t>(kNumFrames - 6));
    EXPECT_GT(updates.back().map_points, 500u);
    double max_range_m = 0.0;
    EXPECT_TRUE(ros::param::get("/gpis_mapping/map/sensor/max_range_m", max_range_m));
    EXPECT_EQ(max_range_m, 3.8) << "config/cameras/azure_kinect.yaml";
    QueryMap query;
    query.request.points.resize(1);
    const Eigen::Vector3d inside = scene.T_map_scene * Eigen::Vector3d(0.0, 0.0, 0.08);
    query.request.points[0].x = inside.x();
    query.request.points[0].y = inside.y();
    query.request.points[0].z = inside.z();
    ASSERT_TRUE(call("/gpis_mapping/query", query));
    EXPECT_EQ(static_cast<int>(query.response.state.at(0)), QueryMap::Response::OCCUPIED);
    launch.signal(SIGINT);  // it ends what it has started
    EXPECT_TRUE(waitUntil([&] { return launch.hasEnded(); }));
  }
  fs::remove_all(folder);
}

}  // namespace
}  // namespace integration_tests
