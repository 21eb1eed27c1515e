// SPDX-License-Identifier: BSD-3-Clause
// The services of the live map and its tuning: right answers, reasons for refusals, nothing lost by a refusal.
#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <future>
#include <limits>
#include <map>

#include <dynamic_reconfigure/Reconfigure.h>
#include <interactive_mapping_common_ros/testing/tuning.h>
#include <interactive_mapping_msgs/AttachedBrick.h>
#include <interactive_mapping_msgs/ClearBox.h>
#include <interactive_mapping_msgs/GetMesh.h>
#include <interactive_mapping_msgs/LoadMap.h>
#include <interactive_mapping_msgs/SaveMap.h>
#include <interactive_mapping_msgs/SurfaceMesh.h>
#include <rosgraph_msgs/Log.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include "live_map.h"

namespace integration_tests {
namespace {

namespace fs = std::filesystem;
using dynamic_reconfigure::Reconfigure;
using interactive_mapping_msgs::ClearBox;
using interactive_mapping_msgs::GetMesh;
using interactive_mapping_msgs::LoadMap;
using interactive_mapping_msgs::SaveMap;
using interactive_mapping_msgs::SurfaceMesh;
using synthetic_depth::Box;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kStep_s = 5.0;
constexpr int kRemovalFrame = 2;

/// A box seen from two sides, then the place without it.
Scene oneBox() {
  Scene scene =
      synthetic_depth::test::makeLooks({{0.5, 0.6, 0.6}, {-0.5, 0.6, 0.6}, {0.5, 0.6, 0.6}}, {0.0, 0.0, 0.05});
  scene.camera = tinyCamera();
  scene.boxes = {synthetic_depth::test::makeBox(0, {0.0, 0.0, 0.08}, {0.08, 0.10, 0.08}, {0.0, 0.0, 0.3})};
  scene.boxes[0].vanishes_at_frame = kRemovalFrame;
  return scene;
}

class LiveMapServices : public testing::Test {
 protected:
  LiveMapServices() : live_("/served") {
    std::string name = (fs::temp_directory_path() / "gpis_live_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
    folder_ = name;
  }
  ~LiveMapServices() override {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  void SetUp() override {
    ASSERT_TRUE(live_.connect());
    ASSERT_TRUE(live_.clear());
    last_ = feed(0, kRemovalFrame - 1);
  }

  MapUpdate feed(int first, int last) {
    MapUpdate update;
    for (int frame = first; frame <= last; ++frame) {
      update = live_.look(scene_, frame, "32FC1", kStep_s);
      EXPECT_EQ(static_cast<int>(update.status), MapUpdate::ACCEPTED) << update.message;
    }
    return update;
  }

  std::vector<std::uint8_t> answers() {
    return bytesOf(
        live_.ask(synthetic_depth::test::randomPointsInMap(scene_, 5, 300, {-0.3, -0.3, -0.1}, {0.3, 0.3, 0.4})));
  }

  Eigen::Matrix3Xd boxCenter() const {
    return scene_.T_map_scene * scene_.boxes[0].T_scene_box * Eigen::Matrix3Xd::Zero(3, 1);
  }
  /// The box in the hand of a tool whose frame is the camera's, pushed along its axis by so much.
  interactive_mapping_msgs::AttachedBrick attachedBrick(double pushed_m) const {
    interactive_mapping_msgs::AttachedBrick brick;
    brick.header.frame_id = "camera_depth_optical_frame";
    brick.header.stamp = live_.stamp();
    brick.is_attached = 1;
    brick.id = 7;
    brick.size.x = 0.16;
    brick.size.y = 0.20;
    brick.size.z = 0.16;
    const Eigen::Isometry3d T_map_box = scene_.T_map_scene * scene_.boxes[0].T_scene_box;
    const geometry_msgs::Transform pose = toTransform(Eigen::Translation3d(0.0, 0.0, pushed_m) *
                                                      scene_.cameraInMap(kRemovalFrame - 1).inverse() * T_map_box)
                                              .transform;
    brick.pose.position.x = pose.translation.x;
    brick.pose.position.y = pose.translation.y;
    brick.pose.position.z = pose.translation.z;
    brick.pose.orientation = pose.rotation;
    return brick;
  }
  int stateAtBox() { return live_.ask(boxCenter(), false).state.at(0); }

  Reconfigure::Response tune(const dynamic_reconfigure::Config& config) {
    Reconfigure reconfigure;
    reconfigure.request.config = config;
    EXPECT_TRUE(call("/served/tune/set_parameters", reconfigure));
    return reconfigure.response;
  }
  static void set(dynamic_reconfigure::Config* config, const std::string& name, double value) {
    config->doubles.emplace_back();
    config->doubles.back().name = name;
    config->doubles.back().value = value;
  }
  static double valueOf(const dynamic_reconfigure::Config& config, const std::string& name) {
    for (const dynamic_reconfigure::DoubleParameter& parameter : config.doubles) {
      if (parameter.name == name) return parameter.value;
    }
    return kNan;
  }

  const Scene scene_ = oneBox();
  LiveMap live_;
  MapUpdate last_;
  fs::path folder_;
};

TEST_F(LiveMapServices, QueryAnswersEachPointOrSaysWhyNot) {
  const Eigen::Vector3d above = scene_.T_map_scene * scene_.boxes[0].T_scene_box * Eigen::Vector3d(0.0, 0.0, 0.09);
  Eigen::Matrix3Xd points(3, 4);
  points << above, Eigen::Vector3d(kNan, 0.0, 0.0), Eigen::Vector3d(0.0, std::numeric_limits<double>::infinity(), 0.0),
      boxCenter();
  const QueryMap::Response answer = live_.ask(points);
  EXPECT_TRUE(answer.success);
  EXPECT_EQ(answer.num_invalid, 2u);
  EXPECT_PRED2(has, answer.message, "2 of 4 points are not finite");
  ASSERT_EQ(answer.distance.size(), 4u);
  ASSERT_EQ(answer.variance.size(), 4u);
  ASSERT_EQ(answer.euclidean_gradient.size(), 4u);
  EXPECT_NEAR(answer.distance[0], 0.01, 0.005);  // pixels are 8 mm there
  for (const std::size_t bad : {1u, 2u}) {
    EXPECT_TRUE(std::isnan(answer.distance[bad]));
    EXPECT_TRUE(std::isnan(answer.gradient[bad].x));
    EXPECT_EQ(static_cast<int>(answer.state[bad]), QueryMap::Response::UNKNOWN);
  }
  EXPECT_LT(answer.distance[3], 0.0);
  const QueryMap::Response of_nothing = live_.ask(Eigen::Matrix3Xd(3, 0));
  EXPECT_TRUE(of_nothing.success);
  // The prior's sigma_f, unless it is set: the length scale, 5 cm, over the root of 3.
  EXPECT_NEAR(of_nothing.prior_variance, 0.05 * 0.05 / 3.0, 1e-12);
  EXPECT_EQ(answer.prior_variance, of_nothing.prior_variance);
  EXPECT_TRUE(live_.ask(points, false).variance.empty());

  const QueryMap::Response lost = live_.ask(points, true, "nowhere");
  EXPECT_FALSE(lost.success);
  EXPECT_PRED2(has, lost.message, "nowhere");
  EXPECT_TRUE(lost.distance.empty());
  // In the camera's frame: the same points, the same distances, directions turned.
  const Eigen::Isometry3d T_map_camera = scene_.cameraInMap(kRemovalFrame - 1);
  const QueryMap::Response in_camera =
      live_.ask(T_map_camera.inverse() * Eigen::Matrix3Xd(above), true, "camera_depth_optical_frame");
  ASSERT_TRUE(in_camera.success) << in_camera.message;
  EXPECT_EQ(in_camera.header.frame_id, "camera_depth_optical_frame");
  EXPECT_NEAR(in_camera.distance[0], answer.distance[0], 1e-9);  // rounding of two transforms
  const auto vector = [](const geometry_msgs::Vector3& v) { return Eigen::Vector3d(v.x, v.y, v.z); };
  EXPECT_LT((T_map_camera.linear() * vector(in_camera.gradient[0]) - vector(answer.gradient[0])).norm(), 1e-6);
}

TEST_F(LiveMapServices, GivesTheMeshOfTheMapAsItIsUnlessTheCallerHasIt) {
  Latest<SurfaceMesh> published("/served/mesh");
  const std::string service = "/served/get_mesh";
  GetMesh first;
  ASSERT_TRUE(call(service, first));
  EXPECT_EQ(first.response.mesh.header.stamp, live_.stamp());
  EXPECT_EQ(first.response.mesh.update, last_.update);
  EXPECT_GT(first.response.mesh.mesh.triangles.size(), 1000u);
  EXPECT_EQ(bytesOf(first.response.mesh), bytesOf(published.awaitStamp(live_.stamp())));

  GetMesh known;
  known.request.revision = first.response.revision;
  ASSERT_TRUE(call(service, known));
  EXPECT_EQ(known.response.revision, first.response.revision);
  EXPECT_TRUE(known.response.mesh.mesh.vertices.empty());
  EXPECT_EQ(known.response.mesh.header.stamp, live_.stamp());

  // At once after an image, and after a change without one.
  last_ = feed(kRemovalFrame, kRemovalFrame);
  GetMesh next = known;
  ASSERT_TRUE(call(service, next));
  EXPECT_NE(next.response.revision, known.response.revision);
  EXPECT_EQ(next.response.mesh.header.stamp, live_.stamp());
  EXPECT_LT(next.response.mesh.mesh.vertices.size(), first.response.mesh.mesh.vertices.size());
  ASSERT_TRUE(live_.clear());
  GetMesh cleared = next;
  cleared.request.revision = next.response.revision;
  ASSERT_TRUE(call(service, cleared));
  EXPECT_NE(cleared.response.revision, next.response.revision);
  EXPECT_TRUE(cleared.response.mesh.mesh.vertices.empty());
  EXPECT_EQ(cleared.response.mesh.header.frame_id, "map");
}

TEST_F(LiveMapServices, QueryAnswersTheDerivativeOfTheVarianceItAnswers) {
  const std::string frame = "camera_depth_optical_frame";
  const Eigen::Isometry3d T_camera_map = scene_.cameraInMap(kRemovalFrame - 1).inverse();
  // Over an edge of the box, so that no component is zero by symmetry.
  const Eigen::Vector3d p_camera =
      T_camera_map * (scene_.T_map_scene * scene_.boxes[0].T_scene_box * Eigen::Vector3d(0.07, 0.03, 0.10));
  constexpr double kStep_m = 2e-3;
  Eigen::Matrix3Xd points_camera(3, 8);
  points_camera.col(0) = p_camera;
  points_camera.col(1).setConstant(kNan);
  for (int axis = 0; axis < 3; ++axis) {
    points_camera.col(2 + 2 * axis) = p_camera - kStep_m * Eigen::Vector3d::Unit(axis);
    points_camera.col(3 + 2 * axis) = p_camera + kStep_m * Eigen::Vector3d::Unit(axis);
  }
  const QueryMap::Response answer = live_.ask(points_camera, true, frame, true);
  ASSERT_TRUE(answer.success) << answer.message;
  ASSERT_EQ(answer.variance_gradient.size(), 8u);
  const auto vector = [](const geometry_msgs::Vector3& v) { return Eigen::Vector3d(v.x, v.y, v.z); };
  Eigen::Vector3d difference;
  for (int axis = 0; axis < 3; ++axis) {
    const auto at = static_cast<std::size_t>(2 + 2 * axis);
    difference[axis] = (answer.variance[at + 1] - answer.variance[at]) / (2.0 * kStep_m);
  }
  const Eigen::Vector3d gradient = vector(answer.variance_gradient[0]);
  // The variance changes within a length scale of 5 cm: over 2 mm the difference is good to some permille.
  EXPECT_LT((gradient - difference).norm(), 0.02 * gradient.norm()) << gradient.transpose();
  EXPECT_GT(gradient.norm(), 1e-3) << "m: a variance of the order of 1e-4 m^2 that changes within centimetres";
  EXPECT_TRUE(std::isnan(answer.variance_gradient[1].z));
  const Eigen::Vector3d in_map =
      vector(live_.ask(T_camera_map.inverse() * points_camera, true, "", true).variance_gradient.at(0));
  // Rounding of the transforms moves the point by 1e-15 m; the variance is a float.
  EXPECT_LT((T_camera_map.linear() * in_map - gradient).norm(), 1e-3 * gradient.norm());
  EXPECT_GT((in_map - gradient).norm(), 0.1 * gradient.norm()) << "the camera is turned: or nothing was compared";

  EXPECT_TRUE(live_.ask(points_camera, true, frame).variance_gradient.empty());
  const QueryMap::Response refused = live_.ask(points_camera, false, frame, true);
  EXPECT_FALSE(refused.success);
  EXPECT_PRED2(has, refused.message, "with_variance_gradient = true needs with_variance = true");
  EXPECT_TRUE(refused.distance.empty());
}

TEST_F(LiveMapServices, QueriesAreAnsweredWhileMapsAreLoaded) {
  SaveMap save;
  save.request.path = (folder_ / "map.gpis").string();
  ASSERT_TRUE(call("/served/save_map", save));
  ASSERT_TRUE(save.response.success) << save.response.message;
  EXPECT_EQ(save.response.num_points, last_.map_points);
  LoadMap first;  // trains every cell anew: from now on the map and the file are the same to the bit
  first.request.path = save.request.path;
  ASSERT_TRUE(call("/served/load_map", first) && first.response.success);
  std::atomic<bool> is_asking{true};
  std::future<int> loads = std::async(std::launch::async, [&] {
    int failed = 0;
    do {
      LoadMap load;
      load.request.path = save.request.path;
      failed += call("/served/load_map", load) && load.response.success ? 0 : 1;
    } while (is_asking);
    return failed;
  });
  const Eigen::Matrix3Xd points =
      synthetic_depth::test::randomPointsInMap(scene_, 5, 100, {-0.3, -0.3, -0.1}, {0.3, 0.3, 0.4});
  const QueryMap::Response expected = live_.ask(points);
  for (int i = 0; i < 50; ++i) {
    const QueryMap::Response answer = live_.ask(points);
    EXPECT_TRUE(answer.success) << answer.message;
    // Before or after a load: a whole map, never half a one.
    EXPECT_TRUE(bytesOf(answer.distance) == bytesOf(expected.distance));
  }
  is_asking = false;
  EXPECT_EQ(loads.get(), 0);
}

TEST_F(LiveMapServices, AFileThatCannotBeUsedLeavesTheMapBitForBit) {
  SaveMap save;
  save.request.path = (folder_ / "map.gpis").string();
  ASSERT_TRUE(call("/served/save_map", save) && save.response.success);
  std::string bytes;
  {
    std::ifstream in(save.request.path, std::ios::binary);
    bytes.assign(std::istreambuf_iterator<char>(in), {});
  }
  std::string flipped = bytes;
  flipped[flipped.size() / 2] = static_cast<char>(flipped[flipped.size() / 2] ^ 1);
  const auto write = [this](const std::string& name, const std::string& text) {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return (folder_ / name).string();
  };
  const std::vector<std::pair<std::string, std::string>> cases{
      {(folder_ / "missing.gpis").string(), "missing.gpis"},
      {write("empty.gpis", ""), "empty.gpis"},
      {write("foreign.gpis", "ply\nformat ascii 1.0\n"), "foreign.gpis"},
      {write("half.gpis", bytes.substr(0, bytes.size() / 2)), "half.gpis"},
      {write("flipped.gpis", flipped), "flipped.gpis"},
      {"map.gpis", "must be an absolute path"},
      {folder_.string(), "must name a file"},
      {"/no/such/folder/map.gpis", "must be in a folder that exists; /no/such/folder does not"},
      {"", "storage/autosave_file is not set"},
  };
  const std::vector<std::uint8_t> before = answers();
  for (const auto& [path, message] : cases) {
    LoadMap load;
    load.request.path = path;
    ASSERT_TRUE(call("/served/load_map", load)) << path;
    EXPECT_FALSE(load.response.success) << path;
    EXPECT_PRED2(has, load.response.message, message);
    EXPECT_PRED2(has, load.response.message, "the map is as it was");
    EXPECT_TRUE(answers() == before) << path;
  }
  for (const char* path : {"/no/such/folder/map.gpis", "map.gpis", "", "/proc/map.gpis"}) {
    SaveMap impossible;
    impossible.request.path = path;
    ASSERT_TRUE(call("/served/save_map", impossible)) << path;
    EXPECT_FALSE(impossible.response.success) << path;
    EXPECT_NE(impossible.response.message, "") << path;
  }
  EXPECT_TRUE(answers() == before);
  EXPECT_EQ(feed(0, 0).update, last_.update + 1);
}

TEST_F(LiveMapServices, ClearMapForgetsEverything) {
  EXPECT_EQ(stateAtBox(), static_cast<int>(QueryMap::Response::OCCUPIED));
  ASSERT_TRUE(live_.clear());
  const QueryMap::Response answer = live_.ask(boxCenter());
  EXPECT_TRUE(answer.success);
  EXPECT_EQ(answer.message, "the map is empty");
  EXPECT_EQ(answer.update, 0u);
  EXPECT_EQ(static_cast<int>(answer.state.at(0)), QueryMap::Response::UNKNOWN);
  EXPECT_EQ(feed(0, 0).update, 1u);
}

TEST_F(LiveMapServices, ClearBoxForgetsWhatIsInItInAnyFrame) {
  // Bad requests first: they change nothing.
  const Eigen::Isometry3d T_map_camera = scene_.cameraInMap(kRemovalFrame - 1);
  const Eigen::Isometry3d T_camera_box = T_map_camera.inverse() * scene_.T_map_scene * scene_.boxes[0].T_scene_box;
  ClearBox good;
  good.request.pose.header.frame_id = "camera_depth_optical_frame";
  const geometry_msgs::Transform pose = toTransform(T_camera_box).transform;
  good.request.pose.pose.position.x = pose.translation.x;
  good.request.pose.pose.position.y = pose.translation.y;
  good.request.pose.pose.position.z = pose.translation.z;
  good.request.pose.pose.orientation = pose.rotation;
  good.request.size.x = 0.18;  // the box and a centimetre round it
  good.request.size.y = 0.22;
  good.request.size.z = 0.18;
  const std::vector<std::pair<std::function<void(ClearBox::Request*)>, std::string>> cases{
      {[](ClearBox::Request* request) { request->size.y = kNan; }, "must be"},
      {[](ClearBox::Request* request) { request->size.x = 0.0; }, "must be"},
      {[](ClearBox::Request* request) { request->size.z = -1.0; }, "must be"},
      {[](ClearBox::Request* request) { request->pose.header.frame_id = "nowhere"; }, "nowhere"},
      {[](ClearBox::Request* request) { request->pose.header.frame_id = ""; }, "frame_id is empty"},
      {[](ClearBox::Request* request) { request->pose.pose.orientation.w = kNan; }, "no rotation"},
      {[](ClearBox::Request* request) { request->pose.pose.orientation = geometry_msgs::Quaternion(); }, "|q| = 0"},
  };
  const std::vector<std::uint8_t> before = answers();
  for (const auto& [spoil, message] : cases) {
    ClearBox bad = good;
    spoil(&bad.request);
    ASSERT_TRUE(call("/served/clear_box", bad));
    EXPECT_FALSE(bad.response.success) << message;
    EXPECT_PRED2(has, bad.response.message, message);
    EXPECT_TRUE(answers() == before) << message;
  }
  ASSERT_TRUE(call("/served/clear_box", good));
  ASSERT_TRUE(good.response.success) << good.response.message;
  EXPECT_GT(good.response.num_removed, 80u);  // 0.12 m^2 seen of the box at 1740 points per m^2, in coarse images half
  EXPECT_EQ(stateAtBox(), static_cast<int>(QueryMap::Response::UNKNOWN));
  const Eigen::Vector3d above = scene_.T_map_scene * scene_.boxes[0].T_scene_box * Eigen::Vector3d(0.0, 0.0, 0.085);
  const double distance_m = live_.ask(Eigen::Matrix3Xd(above)).distance.at(0);
  EXPECT_FALSE(distance_m < 0.05) << "the box's top was 5 mm below";
}

TEST_F(LiveMapServices, ABrickThatTheMagnetTookLeavesTheMap) {
  interactive_mapping_msgs::AttachedBrick brick = attachedBrick(0.0);
  ros::Publisher publisher = ros::NodeHandle().advertise<interactive_mapping_msgs::AttachedBrick>("attached_brick", 5);
  ASSERT_TRUE(waitUntil([&] { return publisher.getNumSubscribers() > 0; }));

  // What says nothing of now changes nothing.
  const std::vector<std::uint8_t> before = answers();
  brick.header.stamp = live_.stamp() - ros::Duration(60.0);
  publisher.publish(brick);  // latched long ago
  brick.header.stamp = live_.stamp();
  brick.size.y = kNan;
  publisher.publish(brick);
  brick.size.y = 0.20;
  brick.is_attached = 0;
  publisher.publish(brick);
  brick.is_attached = 1;
  brick.header.stamp = live_.stamp();
  brick.id = 8;
  EXPECT_TRUE(answers() == before);
  EXPECT_EQ(stateAtBox(), static_cast<int>(QueryMap::Response::OCCUPIED));
  publisher.publish(brick);
  EXPECT_TRUE(waitUntil([&] { return stateAtBox() == static_cast<int>(QueryMap::Response::FREE); }));
}

TEST_F(LiveMapServices, APushedBrickLeavesNothingWhereItWasMapped) {
  ros::Publisher publisher = ros::NodeHandle().advertise<interactive_mapping_msgs::AttachedBrick>("attached_brick", 5);
  ASSERT_TRUE(waitUntil([&] { return publisher.getNumSubscribers() > 0; }));
  publisher.publish(attachedBrick(0.03));  // attached/pushed_m is 5 cm
  ASSERT_TRUE(waitUntil([&] { return stateAtBox() == static_cast<int>(QueryMap::Response::FREE); }));
  // Everything that was seen of it, but for its lower edge: there is the floor.
  const Eigen::Isometry3d T_map_box = scene_.T_map_scene * scene_.boxes[0].T_scene_box;
  ClearBox rest;
  rest.request.pose.header.frame_id = "map";
  const geometry_msgs::Transform pose = toTransform(T_map_box * Eigen::Translation3d(0.0, 0.0, 0.02)).transform;
  rest.request.pose.pose.position.x = pose.translation.x;
  rest.request.pose.pose.position.y = pose.translation.y;
  rest.request.pose.pose.position.z = pose.translation.z;
  rest.request.pose.pose.orientation = pose.rotation;
  rest.request.size.x = 0.17;
  rest.request.size.y = 0.21;
  rest.request.size.z = 0.13;
  ASSERT_TRUE(call("/served/clear_box", rest));
  EXPECT_TRUE(rest.response.success) << rest.response.message;
  EXPECT_EQ(rest.response.num_removed, 0u);
}

TEST_F(LiveMapServices, TellsWhatCanBeTuned) {
  const std::map<std::string, std::pair<double, double>> live{
      {"min_range_m", {0.01, 10.0}},    {"max_range_m", {0.1, 50.0}},     {"hole_policy", {0.0, 1.0}},
      {"pose_std_m", {0.0, 0.1}},       {"dynamic", {0.0, 1.0}},          {"tolerance_sigmas", {0.5, 10.0}},
      {"min_tolerance_m", {0.0, 0.2}},  {"max_step_m", {0.0, 1000.0}},    {"max_step_rad", {0.0, 4.0}},
      {"settle_frames", {0.0, 1000.0}}, {"rate_hz", {0.05, 30.0}},        {"removed_display_s", {0.0, 3600.0}},
      {"mesh_color", {0.0, 1.0}},       {"color_max_std_m", {1e-4, 1.0}}, {"slice_height_m", {-100.0, 100.0}}};
  EXPECT_EQ(node_tests::liveFieldsOf("/served/tune"), live);
}

TEST_F(LiveMapServices, TunedToBeStaticItKeepsARemovedBox) {
  dynamic_reconfigure::Config config;
  config.bools.emplace_back();
  config.bools.back().name = "dynamic";
  config.bools.back().value = 0;
  tune(config);
  MapUpdate update = feed(kRemovalFrame, kRemovalFrame);
  EXPECT_EQ(update.deleted, 0u);
  const Eigen::Matrix3Xd above = scene_.T_map_scene * scene_.boxes[0].T_scene_box * Eigen::Vector3d(0.0, 0.0, 0.09);
  EXPECT_NEAR(live_.ask(above).euclidean_distance.at(0), 0.01, 0.006);  // its top, one point every 2 cm
  config.bools.back().value = 1;
  tune(config);
  update = feed(kRemovalFrame, kRemovalFrame);
  EXPECT_GT(update.deleted, 50u);
  EXPECT_EQ(stateAtBox(), static_cast<int>(QueryMap::Response::FREE));
  EXPECT_GT(live_.ask(above).euclidean_distance.at(0), 0.1);  // the floor, 17 cm below
}

TEST_F(LiveMapServices, ImpossibleTuningIsRefusedNamedAndTakenBack) {
  std::vector<std::string> errors;
  const ros::Subscriber log =
      ros::NodeHandle().subscribe<rosgraph_msgs::Log>("/rosout", 100, [&](const rosgraph_msgs::LogConstPtr& message) {
        if (message->name == "/served" && message->level >= rosgraph_msgs::Log::ERROR) errors.push_back(message->msg);
      });
  // This process says something there itself.
  ASSERT_TRUE(waitUntil([&] { return log.getNumPublishers() > 1; }));
  const double min_range_m = valueOf(tune({}).config, "min_range_m");
  const double max_range_m = valueOf(tune({}).config, "max_range_m");
  dynamic_reconfigure::Config config;
  set(&config, "min_range_m", 2.0);
  set(&config, "max_range_m", 1.0);
  const Reconfigure::Response refused = tune(config);
  // What is said to be set is what the map uses.
  EXPECT_EQ(valueOf(refused.config, "min_range_m"), min_range_m);
  EXPECT_EQ(valueOf(refused.config, "max_range_m"), max_range_m);
  EXPECT_TRUE(waitUntil([&] { return !errors.empty(); }));
  ASSERT_FALSE(errors.empty());
  EXPECT_PRED2(has, errors.front(), "tuning refused");
  EXPECT_PRED2(has, errors.front(), "sensor/min_range_m must be below sensor/max_range_m");
  errors.clear();
  const double rate_hz = valueOf(refused.config, "rate_hz");
  dynamic_reconfigure::Config no_number;  // which dynamic_reconfigure itself lets through
  set(&no_number, "rate_hz", std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(valueOf(tune(no_number).config, "rate_hz"), rate_hz);
  EXPECT_TRUE(waitUntil([&] { return !errors.empty(); }));
  ASSERT_FALSE(errors.empty());
  EXPECT_PRED2(has, errors.front(), "output/rate_hz = nan Hz, must be in");
  // What is a metre away is still mapped, and what is tuned next is not refused for what was.
  ASSERT_TRUE(live_.clear());
  EXPECT_GT(feed(0, 0).map_points, 200u);
  dynamic_reconfigure::Config possible;
  set(&possible, "max_range_m", 0.5);
  EXPECT_EQ(valueOf(tune(possible).config, "max_range_m"), 0.5);
  ASSERT_TRUE(live_.clear());
  EXPECT_EQ(feed(0, 0).map_points, 0u);  // the nearest floor in view is 0.63 m away
  dynamic_reconfigure::Config original;
  set(&original, "max_range_m", max_range_m);
  tune(original);
}

TEST_F(LiveMapServices, TheSliceMovesWhenTuned) {
  Latest<sensor_msgs::PointCloud2> slice("/served/slice");
  for (const double height_m : {0.15, 0.1}) {
    node_tests::tune("/served/tune", "{slice_height_m: " + std::to_string(height_m) + "}");
    const sensor_msgs::PointCloud2& cloud = slice.await([height_m](const sensor_msgs::PointCloud2& message) {
      return message.width > 0 &&
             std::abs(*sensor_msgs::PointCloud2ConstIterator<float>(message, "z") - height_m) < 1e-6;  // float32
    });
    EXPECT_GT(cloud.width, 100u);
  }
}

}  // namespace
}  // namespace integration_tests
