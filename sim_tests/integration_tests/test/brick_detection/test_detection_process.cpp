// SPDX-License-Identifier: BSD-3-Clause
// The life of node and nodelet: loading and unloading, and files and parameters that are refused.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <future>
#include <sys/stat.h>

#include <interactive_mapping_common/testing/process.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <interactive_mapping_msgs/QueryMap.h>
#include <nodelet/NodeletList.h>
#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>
#include <ros/spinner.h>

#include "brick_camera.h"

namespace integration_tests {
namespace {

using node_tests::Process;

namespace fs = std::filesystem;

class DetectionProcess : public testing::Test {
 protected:
  DetectionProcess() {
    std::string name = (fs::temp_directory_path() / "brick_detection_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
    folder_ = name;
    node_ = std::string("/") + testing::UnitTest::GetInstance()->current_test_info()->name();
  }
  ~DetectionProcess() override {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }

  std::string write(const std::string& text) const {
    const fs::path path = folder_ / "bricks.yaml";
    std::ofstream(path) << text;
    return path.string();
  }

  /// Exit code and output of a node that ends by itself.
  std::pair<int, std::string> run() const {
    Process process({BRICK_DETECTION_NODE, "__name:=" + node_.substr(1)}, (folder_ / "log").string());
    EXPECT_TRUE(waitUntil([&] { return process.hasEnded(); })) << process.output();
    return {process.exitCode(), process.output()};
  }

  static std::vector<std::string> loaded() {
    nodelet::NodeletList list;
    EXPECT_TRUE(call("/manager/list", list));
    return list.response.nodelets;
  }
  bool isLoaded() const {
    const std::vector<std::string> names = loaded();
    return std::find(names.begin(), names.end(), node_) != names.end();
  }
  bool load() const {
    nodelet::NodeletLoad load;
    load.request.name = node_;
    load.request.type = "brick_detection/BrickDetection";
    for (const char* topic : {"color/image_raw", "color/camera_info", "depth/image_rect"}) {
      load.request.remap_source_args.push_back(std::string("/") + topic);
      load.request.remap_target_args.push_back(node_ + "_in/" + topic);
    }
    for (const char* name : {"/map_update", "/map/query"}) {
      load.request.remap_source_args.emplace_back(name);
      load.request.remap_target_args.push_back(node_ + "_in" + name);
    }
    return call("/manager/load_nodelet", load) && load.response.success != 0;
  }
  bool unload() const {
    nodelet::NodeletUnload unload;
    unload.request.name = node_;
    return call("/manager/unload_nodelet", unload) && unload.response.success != 0;
  }

  fs::path folder_;
  std::string node_;
};

TEST_F(DetectionProcess, BricksFileWithErrorsEndsTheNodeWithAllOfThem) {
  ros::param::set(node_ + "/bricks_file", write("types:\n  - {name: brick, size_m: [0.3, -0.2, 0.2], colour: 1}\n"));
  const auto [code, output] = run();
  EXPECT_EQ(code, 1) << output;
  EXPECT_PRED2(has, output, (folder_ / "bricks.yaml").string());
  EXPECT_PRED2(has, output, "size_m");
  EXPECT_PRED2(has, output, "-0.2");
  EXPECT_PRED2(has, output, "colour");
}

TEST_F(DetectionProcess, MissingBricksFileEndsTheNode) {
  ros::param::set(node_ + "/bricks_file", (folder_ / "nowhere.yaml").string());
  const auto [code, output] = run();
  EXPECT_EQ(code, 1) << output;
  EXPECT_PRED2(has, output, "nowhere.yaml");
}

TEST_F(DetectionProcess, ImpossibleParametersEndTheNodeWithAllOfThem) {
  ros::param::set(node_ + "/bricks_file", std::string(BRICKS_YAML));
  ros::param::set(node_ + "/detect/timeout_s", -1.0);
  ros::param::set(node_ + "/input/use_deep", true);
  const auto [code, output] = run();
  EXPECT_EQ(code, 1) << output;
  EXPECT_PRED2(has, output, "detect/timeout_s = -1 s");
  EXPECT_PRED2(has, output, "input/use_deep is unknown");
}

TEST_F(DetectionProcess, NodeEndsWhenAskedWhileACallWaits) {
  ros::param::set(node_ + "/bricks_file", std::string(BRICKS_YAML));
  std::vector<std::string> arguments{BRICK_DETECTION_NODE, "__name:=" + node_.substr(1)};
  for (const std::string& remapping : BrickCamera::remappings(node_)) arguments.push_back(remapping);
  Process process(arguments, (folder_ / "log").string());
  BrickCamera live(node_);
  ASSERT_TRUE(live.connect()) << process.output();
  process.signal(SIGTERM);
  EXPECT_TRUE(waitUntil([&] { return process.hasEnded(); })) << process.output();
  EXPECT_EQ(process.exitCode(), 0) << process.output();
}

TEST_F(DetectionProcess, NodeletFindsBricksAndCanBeUnloadedAndLoadedAgain) {
  ros::param::set(node_ + "/bricks_file", std::string(BRICKS_YAML));
  ros::param::set(node_ + "/input/tf_timeout_s", 10.0);
  ros::param::set(node_ + "/input/use_depth", false);
  const auto catalogue = mp700_ur5e_description::loadBrickTypes(BRICKS_YAML);
  const Eigen::Isometry3d T_map_camera = lookingAt({-0.65, 0.0, 0.75}, {0.0, 0.0, 0.1});
  // tf is the manager's own: its only subscriber here.
  BrickFrame frame =
      toFrame(renderBricks(catalogue, {{4, standing({0.0, 0.0, 0.1}, 0.3)}}, smallCamera(), T_map_camera),
              smallCamera(), T_map_camera);
  frame.depth.data.clear();
  ros::Publisher tf = ros::NodeHandle().advertise<tf2_msgs::TFMessage>("/tf", 10);
  for (int round = 0; round < 2; ++round) {
    ASSERT_TRUE(load());
    EXPECT_TRUE(isLoaded());
    BrickCamera live(node_);
    ASSERT_TRUE(waitUntil([&] { return tf.getNumSubscribers() > 0; }));
    DetectionUpdate update;
    EXPECT_TRUE(waitUntil([&] {
      frame.setStamp(live.nextStamp());
      tf2_msgs::TFMessage transforms;
      transforms.transforms.push_back(frame.transform);
      tf.publish(transforms);
      live.publish(frame);
      return !live.updates.empty() && live.updates.back().status == DetectionUpdate::ACCEPTED;
    }));
    EXPECT_EQ(live.updates.back().bricks_seen, std::vector<std::int32_t>{4});
    EXPECT_TRUE(unload());
    EXPECT_FALSE(isLoaded());
  }
}

TEST_F(DetectionProcess, BadBricksFileEndsTheNodeletsLoadAndNotTheManager) {
  ros::param::set(node_ + "/bricks_file", write("types: []\n"));
  EXPECT_FALSE(load());
  EXPECT_FALSE(isLoaded());
  ros::param::set(node_ + "/bricks_file", std::string(BRICKS_YAML));
  EXPECT_TRUE(load());
  EXPECT_TRUE(isLoaded());
  EXPECT_TRUE(unload());
}

/// A map whose answer never comes.
TEST_F(DetectionProcess, MapThatHangsStopsNeitherLooksNorTheEnd) {
  ros::param::set(node_ + "/bricks_file", std::string(BRICKS_YAML));
  ros::param::set(node_ + "/input/tf_timeout_s", 10.0);
  ros::param::set(node_ + "/input/use_depth", false);
  ros::CallbackQueue map_queue;
  ros::NodeHandle map(node_ + "_in");
  map.setCallbackQueue(&map_queue);
  std::promise<void> release;
  std::shared_future<void> released = release.get_future().share();
  std::promise<void> asked;
  bool was_asked = false;
  using Query = interactive_mapping_msgs::QueryMap;
  const boost::function<bool(Query::Request&, Query::Response&)> hang = [&](Query::Request&, Query::Response&) {
    if (!was_asked) asked.set_value();
    was_asked = true;
    released.wait();
    return true;
  };
  ros::ServiceServer server = map.advertiseService("map/query", hang);
  ros::AsyncSpinner spinner(1, &map_queue);
  spinner.start();

  std::vector<std::string> arguments{BRICK_DETECTION_NODE, "__name:=" + node_.substr(1),
                                     "map/query:=" + node_ + "_in/map/query"};
  for (const std::string& remapping : BrickCamera::remappings(node_)) arguments.push_back(remapping);
  Process process(arguments, (folder_ / "log").string());
  BrickCamera live(node_);
  ASSERT_TRUE(live.connect()) << process.output();
  const auto catalogue = mp700_ur5e_description::loadBrickTypes(BRICKS_YAML);
  const Eigen::Isometry3d T_map_camera = lookingAt({-0.65, 0.0, 0.75}, {0.0, 0.0, 0.1});
  BrickFrame frame =
      toFrame(renderBricks(catalogue, {{4, standing({0.0, 0.0, 0.1}, 0.3)}}, smallCamera(), T_map_camera),
              smallCamera(), T_map_camera);
  frame.depth.data.clear();
  EXPECT_EQ(live.look(frame).bricks_seen, std::vector<std::int32_t>{4});
  EXPECT_EQ(asked.get_future().wait_for(std::chrono::seconds(static_cast<int>(kDeadline_s))),
            std::future_status::ready);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(live.look(frame).bricks_seen, std::vector<std::int32_t>{4});
  process.signal(SIGTERM);
  EXPECT_TRUE(waitUntil([&] { return process.hasEnded(); })) << process.output();
  EXPECT_EQ(process.exitCode(), 0) << process.output();
  release.set_value();
}

}  // namespace
}  // namespace integration_tests
