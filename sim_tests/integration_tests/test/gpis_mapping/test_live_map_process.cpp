// SPDX-License-Identifier: BSD-3-Clause
// The life of the program: autosave and restore through kill and restart, refused parameters.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>

#include <nodelet/NodeletList.h>
#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>

#include <interactive_mapping_common/testing/process.h>
#include "gpis_mapping/map_io.h"
#include "live_map.h"

namespace integration_tests {
namespace {

namespace fs = std::filesystem;

Scene oneBox() {
  Scene scene = synthetic_depth::test::makeLooks({{0.5, 0.6, 0.6}, {-0.5, 0.6, 0.6}}, {0.0, 0.0, 0.05});
  scene.camera = tinyCamera();
  scene.boxes = {synthetic_depth::test::makeBox(0, {0.0, 0.0, 0.08}, {0.08, 0.10, 0.08}, {0.0, 0.0, 0.3})};
  return scene;
}

class LiveMapProcess : public testing::Test {
 protected:
  LiveMapProcess() {
    std::string name = (fs::temp_directory_path() / "gpis_live_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
    folder_ = name;
    node_ = std::string("/") + testing::UnitTest::GetInstance()->current_test_info()->name();
  }
  ~LiveMapProcess() override {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }

  std::unique_ptr<node_tests::Process> start() {
    std::vector<std::string> arguments{GPIS_MAPPING_NODE, "__name:=" + node_.substr(1)};
    for (const std::string& remapping : LiveMap::remappings(node_)) arguments.push_back(remapping);
    return std::make_unique<node_tests::Process>(arguments, (folder_ / "log").string());
  }

  void setAutosave(double period_s) {
    ros::param::set(node_ + "/storage/autosave_file", mapFile());
    ros::param::set(node_ + "/storage/autosave_period_s", period_s);
  }

  std::string mapFile() const { return (folder_ / "map.gpis").string(); }

  /// Both looks at the box.
  MapUpdate feed(LiveMap* live) {
    MapUpdate update;
    for (int frame = 0; frame < scene_.numFrames(); ++frame) {
      update = live->look(scene_, frame, "32FC1", 5.0);
      EXPECT_EQ(static_cast<int>(update.status), MapUpdate::ACCEPTED) << update.message;
    }
    return update;
  }

  QueryMap::Response answers(LiveMap* live) {
    const QueryMap::Response answer =
        live->ask(synthetic_depth::test::randomPointsInMap(scene_, 5, 300, {-0.3, -0.3, -0.1}, {0.3, 0.3, 0.4}));
    EXPECT_TRUE(answer.success) << answer.message;
    return answer;
  }

  bool fileHolds(std::size_t num_points) {
    try {
      return gpis_mapping::loadMap(mapFile()).points.size() == num_points;
    } catch (const gpis_mapping::MapFileError&) {
      return false;
    }
  }

  const Scene scene_ = oneBox();
  fs::path folder_;
  std::string node_;
};

TEST_F(LiveMapProcess, AnswersAsBeforeAfterBeingKilled) {
  setAutosave(0.2);
  QueryMap::Response before;
  std::size_t num_points = 0;
  {
    const std::unique_ptr<node_tests::Process> process = start();
    LiveMap live(node_);
    ASSERT_TRUE(live.connect()) << process->output();
    num_points = feed(&live).map_points;
    ASSERT_GT(num_points, 200u);
    before = answers(&live);
    // Written to a file beside and renamed: whole whenever it is looked at.
    ASSERT_TRUE(waitUntil([&] { return fileHolds(num_points); })) << process->output();
    process->signal(SIGKILL);
    ASSERT_TRUE(waitUntil([&] { return process->hasEnded(); }));
    EXPECT_EQ(process->exitCode(), -SIGKILL);
  }
  const std::unique_ptr<node_tests::Process> process = start();
  LiveMap live(node_);
  ASSERT_TRUE(live.connect()) << process->output();
  EXPECT_EQ(live.updates.back().map_points, num_points);
  const QueryMap::Response after = answers(&live);
  // The file has seconds since its epoch as float32: within seconds of it, to a tenth of a microsecond.
  EXPECT_NEAR((after.header.stamp - before.header.stamp).toSec(), 0.0, 1e-6);
  ASSERT_EQ(after.distance.size(), before.distance.size());
  int num_near = 0;
  int num_other_state = 0;
  for (std::size_t i = 0; i < before.distance.size(); ++i) {
    EXPECT_EQ(std::isnan(after.distance[i]), std::isnan(before.distance[i]));
    num_other_state += after.state[i] != before.state[i] ? 1 : 0;
    if (std::isnan(before.distance[i])) continue;
    ++num_near;
    // Restored, each cell is trained on its points as they are; before, it may have been trained when they were up to
    // half a standard deviation (1 mm) elsewhere.
    EXPECT_NEAR(after.distance[i], before.distance[i], 0.001);
    EXPECT_NEAR(after.euclidean_distance[i], before.euclidean_distance[i], 1e-6);  // from the points themselves
  }
  EXPECT_GT(num_near, 100);
  EXPECT_EQ(num_other_state, 0);
  // The map goes on from there: what is known is fused, not doubled.
  const MapUpdate update = live.look(scene_, 0, "32FC1", 5.0);
  EXPECT_EQ(static_cast<int>(update.status), MapUpdate::ACCEPTED) << update.message;
  EXPECT_GT(update.fused, 100u);
  EXPECT_LT(update.inserted, 50u);
}

TEST_F(LiveMapProcess, SavesALastTimeWhenAskedToEnd) {
  setAutosave(3600.0);
  for (const int number : {SIGTERM, SIGINT}) {
    SCOPED_TRACE(number == SIGTERM ? "SIGTERM" : "SIGINT");
    fs::remove(mapFile());
    const std::unique_ptr<node_tests::Process> process = start();
    LiveMap live(node_);
    ASSERT_TRUE(live.connect()) << process->output();
    const std::size_t num_points = feed(&live).map_points;
    ASSERT_FALSE(fs::exists(mapFile())) << "the period is an hour";
    process->signal(number);
    ASSERT_TRUE(waitUntil([&] { return process->hasEnded(); }));
    EXPECT_EQ(process->exitCode(), 0) << process->output();
    EXPECT_TRUE(fileHolds(num_points));
  }
}

TEST_F(LiveMapProcess, MovesAnUnreadableFileAsideAndStartsEmpty) {
  setAutosave(0.2);
  const std::string garbage(5000, 'x');
  std::ofstream(mapFile()) << garbage;
  const std::unique_ptr<node_tests::Process> process = start();
  LiveMap live(node_);
  ASSERT_TRUE(live.connect()) << process->output();
  EXPECT_EQ(live.updates.back().map_points, 0u);
  EXPECT_PRED2(has, live.ask(Eigen::Matrix3Xd::Zero(3, 1)).message, "empty");
  EXPECT_EQ(fs::file_size(mapFile() + ".unreadable"), garbage.size());
  EXPECT_FALSE(fs::exists(mapFile()));
  EXPECT_TRUE(waitUntil([&] { return has(process->output(), "map not restored, starting empty"); }));
  // And saves anew beside it.
  const std::size_t num_points = feed(&live).map_points;
  EXPECT_TRUE(waitUntil([&] { return fileHolds(num_points); }));
}

TEST_F(LiveMapProcess, RefusesImpossibleParametersByNameValueAndRange) {
  struct Case {
    std::string key;
    XmlRpc::XmlRpcValue value;
    std::string message;
  };
  const std::vector<Case> cases{
      {"output/rate_hz", -1.0, "/output/rate_hz = -1 Hz, must be in [0.05, 30] Hz"},
      {"input/tf_timeout_s", 99, "/input/tf_timeout_s = 99 s, must be in [0, 10] s"},
      {"input/map_frame", std::string("/map"), "/input/map_frame = '/map', must be a tf2 frame"},
      {"map/surface/spacing_m", -0.02, "spacing_m = -0.02 m, must be in"},
      {"storage/autosave_file", std::string("map.gpis"),
       "storage/autosave_file = 'map.gpis', must be an absolute path"},
      {"output/mesh_color", std::string("pink"), "/output/mesh_color = 'pink', must be one of uncertainty, height"},
      {"output/rate_hz", std::string("fast"), "/output/rate_hz = 'fast', must be a number"},
      {"storage/restore_on_start", 1, "/storage/restore_on_start = 1, must be true or false"},
      {"input", 3, "/input = 3, must be a section with keys"},
      {"output/rate", 2.0, "/output/rate is unknown"},
      {"map/surface/spacing", 0.02, "surface/spacing"},
  };
  // All at once, each with a node of its own.
  std::vector<std::unique_ptr<node_tests::Process>> processes;
  for (std::size_t i = 0; i <= cases.size(); ++i) {
    const std::string name = node_ + "_" + std::to_string(i);
    if (i < cases.size()) {
      ros::param::set(name + "/" + cases[i].key, cases[i].value);
    } else {
      for (const std::size_t several : {0, 1, 9})
        ros::param::set(name + "/" + cases[several].key, cases[several].value);
    }
    processes.push_back(
        std::make_unique<node_tests::Process>(std::vector<std::string>{GPIS_MAPPING_NODE, "__name:=" + name.substr(1)},
                                              (folder_ / ("log" + std::to_string(i))).string()));
  }
  const auto have_ended = [&] {
    return std::all_of(processes.begin(), processes.end(), [](const auto& process) { return process->hasEnded(); });
  };
  EXPECT_TRUE(waitUntil(have_ended));
  for (std::size_t i = 0; i < cases.size(); ++i) {
    SCOPED_TRACE(cases[i].message);
    if (!processes[i]->hasEnded()) {
      ADD_FAILURE() << "still runs";
      continue;
    }
    EXPECT_EQ(processes[i]->exitCode(), 1);
    EXPECT_PRED2(has, processes[i]->output(), cases[i].message);
    EXPECT_PRED2(has, processes[i]->output(), node_ + "_" + std::to_string(i) + "/" + cases[i].key);
  }
  EXPECT_EQ(processes.back()->exitCode(), 1);
  for (const std::size_t several : {0, 1, 9}) EXPECT_PRED2(has, processes.back()->output(), cases[several].message);
}

TEST_F(LiveMapProcess, AsANodeletRefusesThemAndTheManagerSurvives) {
  ASSERT_TRUE(ros::service::waitForService("/manager/load_nodelet", ros::Duration(kDeadline_s)));
  nodelet::NodeletLoad load;
  load.request.name = node_;
  load.request.type = "gpis_mapping/GpisMapping";
  for (const std::string& remapping : LiveMap::remappings(node_)) {
    const std::size_t at = remapping.find(":=");
    load.request.remap_source_args.push_back(ros::names::resolve(remapping.substr(0, at)));
    load.request.remap_target_args.push_back(remapping.substr(at + 2));
  }
  ros::param::set(node_ + "/output/rate_hz", -1.0);
  // The manager reports failure by success = false or by failing the call.
  EXPECT_FALSE(call("/manager/load_nodelet", load) && load.response.success);
  nodelet::NodeletList list;
  ASSERT_TRUE(call("/manager/list", list)) << "the manager is gone";
  EXPECT_EQ(list.response.nodelets.size(), 0u);

  ros::param::set(node_ + "/output/rate_hz", 30.0);
  ASSERT_TRUE(call("/manager/load_nodelet", load) && load.response.success);
  {
    LiveMap live(node_);
    ASSERT_TRUE(live.connect());
    feed(&live);
  }
  nodelet::NodeletUnload unload;
  unload.request.name = node_;
  EXPECT_TRUE(call("/manager/unload_nodelet", unload) && unload.response.success);
  EXPECT_FALSE(ros::service::exists(node_ + "/query", false));
  ASSERT_TRUE(call("/manager/list", list));
  EXPECT_EQ(list.response.nodelets.size(), 0u);
}

}  // namespace
}  // namespace integration_tests
