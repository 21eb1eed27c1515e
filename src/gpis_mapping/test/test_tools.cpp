// SPDX-License-Identifier: BSD-3-Clause
// Runs the command-line tools as a user would.
#include <unistd.h>
#include <sys/wait.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <sstream>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include <interactive_mapping_common/testing/temporary_folder.h>
#include "gpis_mapping/map_io.h"

namespace gpis_mapping {
namespace {

namespace fs = std::filesystem;
using test_support::readText;
using test_support::splitLines;
using test_support::TemporaryFolder;
using test_support::writeText;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr char kTimingHeader[] =
    "frame,total_ms,classify_ms,regress_ms,fuse_ms,insert_ms,train_ms,observe_ms,publish_ms,points_in,inserted,fused,"
    "deleted,map_points,cells_retrained";
constexpr char kQueryHeader[] = "x,y,z,distance,variance,gx,gy,gz,occupancy,state,euclidean_distance";
constexpr int kNumFrames = 6;
constexpr int kFrameWithoutPose = 4;

std::vector<std::string> fieldsOf(const std::string& line) {
  std::vector<std::string> fields(1);
  for (const char c : line) {
    if (c == ',') fields.emplace_back();
    if (c != ',') fields.back() += c;
  }
  return fields;
}

/// A wall 1 m in front of a camera that looks along the map's z axis; frame 4 has no pose.
class Tools : public testing::Test {
 protected:
  struct Result {
    int exit_code;
    std::vector<std::string> out;
    std::vector<std::string> errors;
  };

  Tools() {
    fs::create_directories(file("wall"));
    for (int i = 0; i < kNumFrames; ++i) {
      const std::string stem = file("wall/frame-00000" + std::to_string(i));
      cv::imwrite(stem + ".depth.png", cv::Mat(60, 80, CV_16UC1, cv::Scalar(1000)));
      if (i != kFrameWithoutPose) writeText(stem + ".pose.txt", "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
    }
    writeText(file("wall/camera-intrinsics.txt"), "80 0 39.5\n0 80 29.5\n0 0 1\n");
  }

  std::string file(const std::string& name) const { return folder_.file(name); }

  Result run(const std::string& command) const {
    const int status = std::system((command + " > " + file("stdout") + " 2> " + file("stderr")).c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, splitLines(readText(file("stdout"))),
            splitLines(readText(file("stderr")))};
  }
  Result mapWall(const std::string& arguments = "") const {
    return run(MAP_SEQUENCE " " + file("wall") + " --quiet --out " + file("out") + " " + arguments);
  }
  Result query(const std::string& points) const {
    writeText(file("in.csv"), points);
    fs::remove(file("out.csv"));
    return run(QUERY_MAP " " + file("out/map.gpis") + " --quiet --points " + file("in.csv") + " --out " +
               file("out.csv"));
  }
  std::vector<std::string> answers() const { return splitLines(readText(file("out.csv"))); }
  std::vector<int> timedFrames() const {
    std::vector<int> frames;
    for (const std::string& line : splitLines(readText(file("out/timing.csv")))) {
      if (line != kTimingHeader) frames.push_back(std::stoi(line));
    }
    return frames;
  }

  TemporaryFolder folder_;
};

TEST_F(Tools, MapSequenceWritesMapMeshTimingAndSummary) {
  const Result result = mapWall();
  ASSERT_EQ(result.exit_code, 0) << testing::PrintToString(result.errors);
  ASSERT_EQ(result.out.size(), 1u);
  const nlohmann::json summary = nlohmann::json::parse(result.out.back());
  EXPECT_EQ(summary.at("frames"), kNumFrames - 1);
  EXPECT_EQ(summary.at("skipped"), 1);
  EXPECT_EQ(summary.at("skip_reasons").at(0).at("reason"), "no pose file");
  EXPECT_EQ(summary.at("skip_reasons").at(0).at("first_frame"), kFrameWithoutPose);
  for (const char* key : {"median_ms", "mean_ms", "p95_ms", "max_ms", "first_frame_ms", "map_points", "cells",
                          "map_memory_mb", "peak_rss_mb", "mesh_vertices", "mesh_triangles", "mesh_ms", "save_ms"}) {
    EXPECT_GT(summary.at(key).get<double>(), 0.0) << key;
  }
  EXPECT_LE(summary.at("median_ms").get<double>(), summary.at("p95_ms").get<double>());
  EXPECT_LE(summary.at("p95_ms").get<double>(), summary.at("max_ms").get<double>());
  EXPECT_EQ(summary.at("outputs").at("mesh"), file("out/mesh.ply"));
  EXPECT_EQ(summary.at("outputs").at("map"), file("out/map.gpis"));
  EXPECT_EQ(summary.at("outputs").at("timing"), file("out/timing.csv"));
  EXPECT_THAT(readText(file("out/mesh.ply")), testing::StartsWith("ply\nformat binary_little_endian 1.0\n"));
  EXPECT_EQ(loadMap(file("out/map.gpis")).points.size(), summary.at("map_points").get<std::size_t>());

  const std::vector<std::string> timing = splitLines(readText(file("out/timing.csv")));
  ASSERT_EQ(timing.size(), static_cast<std::size_t>(kNumFrames));
  EXPECT_EQ(timing.front(), kTimingHeader);
  EXPECT_THAT(timedFrames(), ElementsAre(0, 1, 2, 3, 5));
  for (const std::string& line : timing) EXPECT_EQ(fieldsOf(line).size(), 15u) << line;
  EXPECT_EQ(fieldsOf(timing.back())[13], std::to_string(summary.at("map_points").get<std::size_t>()));
}

TEST_F(Tools, StartAndEndAreIncludedAndStrideCountsFromStart) {
  ASSERT_EQ(mapWall("--start 1 --end 3").exit_code, 0);
  EXPECT_THAT(timedFrames(), ElementsAre(1, 2, 3));
  ASSERT_EQ(mapWall("--start 1 --end 5 --stride 2").exit_code, 0);
  EXPECT_THAT(timedFrames(), ElementsAre(1, 3, 5));
  ASSERT_EQ(mapWall("--start 0 --end 5 --stride 3").exit_code, 0);
  EXPECT_THAT(timedFrames(), ElementsAre(0, 3));
  ASSERT_EQ(mapWall("--start 5 --end 5").exit_code, 0);
  EXPECT_THAT(timedFrames(), ElementsAre(5));
  const Result past_end = mapWall("--end 99");
  EXPECT_EQ(past_end.exit_code, 0);
  EXPECT_THAT(past_end.errors, testing::Contains(HasSubstr("--end = 99 is past the last frame, 5")));
  EXPECT_THAT(timedFrames(), ElementsAre(0, 1, 2, 3, 5));
}

TEST_F(Tools, MeshEveryWritesMeshesOnTheWay) {
  ASSERT_EQ(mapWall("--mesh-every 2").exit_code, 0);
  EXPECT_TRUE(fs::exists(file("out/mesh_000001.ply")));
  EXPECT_TRUE(fs::exists(file("out/mesh_000003.ply")));
  EXPECT_FALSE(fs::exists(file("out/mesh_000005.ply")));
}

TEST_F(Tools, ProgressGoesToStderrOnly) {
  const Result result = run(MAP_SEQUENCE " " + file("wall") + " --out " + file("out"));
  EXPECT_EQ(result.out.size(), 1u);
  EXPECT_THAT(result.errors, testing::Contains(AllOf(HasSubstr("6/6"), HasSubstr("100 %"), HasSubstr("ETA"))));
}

TEST_F(Tools, WrongUsageIsCode2AndOneLine) {
  const std::string wall = file("wall");
  const std::string out = " --out " + file("out");
  for (const std::string& arguments :
       {std::string(), out, wall, wall + out + " --start -1", wall + out + " --start 3 --end 2",
        wall + out + " --stride 0", wall + out + " --start 6", wall + out + " --stride two", wall + out + " --wrong",
        wall + out + " another", wall + out + " --mesh-every 0"}) {
    const Result result = run(MAP_SEQUENCE " " + arguments);
    EXPECT_EQ(result.exit_code, 2) << arguments;
    EXPECT_EQ(result.errors.size(), 1u) << arguments;
    EXPECT_THAT(result.out, IsEmpty());
  }
  for (const std::string& arguments :
       {std::string("a.gpis"), std::string("a.gpis --points b.csv"), std::string("--points b.csv --out c.csv")}) {
    const Result result = run(QUERY_MAP " " + arguments);
    EXPECT_EQ(result.exit_code, 2) << arguments;
    EXPECT_EQ(result.errors.size(), 1u) << arguments;
  }
}

TEST_F(Tools, HelpIsCode0) {
  for (const char* tool : {MAP_SEQUENCE, QUERY_MAP}) {
    const Result result = run(std::string(tool) + " --help");
    EXPECT_EQ(result.exit_code, 0);
    EXPECT_THAT(result.errors, IsEmpty());
    EXPECT_THAT(result.out.front(), HasSubstr("Usage: "));
  }
}

TEST_F(Tools, FailuresAreCode1AndOneLine) {
  writeText(file("bad.yaml"), "sensor: {max_range_m: -1, wrong: 2}\n");
  writeText(file("text"), "no bag\n");
  writeText(file("cut.bag"), "#ROSBAG V2.0\n");
  const std::vector<std::pair<std::string, std::string>> cases = {
      {file("none") + " --out " + file("out"), "none: no such file or folder"},
      {file("text") + " --out " + file("out"), "neither a ROS bag"},
      {file("cut.bag") + " --out " + file("out"), "cut.bag: "},
      {folder_.path() + " --out " + file("out"), "is no recording"},
      {file("wall") + " --out " + file("text"), "text: "},
      {file("wall") + " --out " + file("text") + "/below", "text/below: "},
      {file("wall") + " --out " + file("out") + " --config " + file("none.yaml"), "none.yaml: cannot be read"},
      {file("wall") + " --out " + file("out") + " --config " + file("bad.yaml"), "sensor/wrong is unknown"},
      {file("wall") + " --out " + file("out") + " --start 4 --end 4", "no frame could be used: 1 x no pose file"},
  };
  for (const auto& [arguments, expected] : cases) {
    const Result result = run(MAP_SEQUENCE " --quiet " + arguments);
    EXPECT_EQ(result.exit_code, 1) << arguments;
    EXPECT_THAT(result.out, IsEmpty());
    ASSERT_EQ(result.errors.size(), 1u) << arguments;
    EXPECT_THAT(result.errors[0], AllOf(testing::StartsWith("map_sequence: "), HasSubstr(expected)));
  }
}

TEST_F(Tools, BrokenFramesAreSkippedAndCounted) {
  writeText(file("wall/frame-000001.depth.png"), "no image");
  writeText(file("wall/frame-000002.pose.txt"), "nan 0 0 0\n0 nan 0 0\n0 0 nan 0\n0 0 0 1\n");  // tracking lost
  const Result result = mapWall();
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_THAT(result.errors, testing::Contains(HasSubstr("frame-000001.depth.png")));
  const nlohmann::json summary = nlohmann::json::parse(result.out.back());
  EXPECT_EQ(summary.at("skipped"), 3);  // and the one that never had a pose
  EXPECT_EQ(summary.at("frames"), kNumFrames - 3);
  EXPECT_THAT(timedFrames(), ElementsAre(0, 3, 5));
  EXPECT_EQ(loadMap(file("out/map.gpis")).num_updates, 3u);
}

TEST_F(Tools, AMapThatStaysEmptyIsAFailureWithItsReason) {
  const Result result = mapWall("--depth-units 50");
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.out, IsEmpty());
  EXPECT_THAT(result.errors.back(),
              AllOf(HasSubstr("no surface was mapped from 5 frame(s): no measurement in range"),
                    HasSubstr("depths were 20 to 20 m"), HasSubstr("max_range_m 4"), HasSubstr("--depth-units")));
  EXPECT_FALSE(fs::exists(file("out/map.gpis")));
  EXPECT_EQ(mapWall("--depth-units 0").exit_code, 2);
  EXPECT_EQ(mapWall("--depth-units nan").exit_code, 2);
}

TEST_F(Tools, FramesThatTheLiveNodeRefusesAreSkipped) {
  cv::imwrite(file("wall/frame-000001.depth.png"), cv::Mat(60, 80, CV_16UC1, cv::Scalar(0)));
  writeText(file("wall/frame-000003.pose.txt"), "1 0 0 0.9\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
  const nlohmann::json summary = nlohmann::json::parse(mapWall().out.back());
  std::map<std::string, int> first_frames;
  for (const nlohmann::json& reason : summary.at("skip_reasons"))
    first_frames[reason.at("reason")] = reason.at("first_frame");
  EXPECT_THAT(first_frames, ElementsAre(testing::Pair("no pose file", 4), testing::Pair("nothing measured", 1),
                                        testing::Pair("pose jump", 3)));
  EXPECT_THAT(timedFrames(), ElementsAre(0, 2, 5));
  ASSERT_EQ(mapWall("--no-pose-check").exit_code, 0);
  EXPECT_THAT(timedFrames(), ElementsAre(0, 2, 3, 5));
}

TEST_F(Tools, InterruptSavesWhatThereIs) {
  for (int i = kNumFrames; i < 3000; ++i) {  // enough to be interrupted in the middle
    char stem[40];
    std::snprintf(stem, sizeof(stem), "wall/frame-%06d", i);
    fs::create_hard_link(file("wall/frame-000000.depth.png"), file(stem) + ".depth.png");
    fs::create_hard_link(file("wall/frame-000000.pose.txt"), file(stem) + ".pose.txt");
  }
  const pid_t child = ::fork();
  if (child == 0) {
    std::freopen(file("stdout").c_str(), "w", stdout);
    std::freopen(file("stderr").c_str(), "w", stderr);
    ::execl(MAP_SEQUENCE, "map_sequence", file("wall").c_str(), "--out", file("out").c_str(), "-q", nullptr);
    ::_exit(127);
  }
  const auto num_rows = [this] {
    return fs::exists(file("out/timing.csv")) ? splitLines(readText(file("out/timing.csv"))).size() : 0;
  };
  bool is_whole = true;
  for (int i = 0; i < 10000 && num_rows() < 60; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(3));
    const std::string text = fs::exists(file("out/timing.csv")) ? readText(file("out/timing.csv")) : "";
    is_whole = is_whole && (text.empty() || text.back() == '\n');
  }
  const std::size_t rows_before = num_rows();
  ::kill(child, SIGINT);
  int status = 0;
  ::waitpid(child, &status, 0);
  EXPECT_TRUE(is_whole) << "a row reached the file in parts";
  EXPECT_GE(rows_before, 60u) << "no rows while running";
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 130);
  EXPECT_THAT(readText(file("stderr")), HasSubstr("interrupted after"));
  const nlohmann::json summary = nlohmann::json::parse(splitLines(readText(file("stdout"))).back());
  EXPECT_EQ(summary.at("interrupted"), true);
  EXPECT_LT(summary.at("frames").get<int>(), 2999);
  EXPECT_EQ(num_rows(), summary.at("frames").get<std::size_t>() + 1);
  EXPECT_EQ(loadMap(file("out/map.gpis")).num_updates, summary.at("frames").get<std::uint64_t>());
}

TEST_F(Tools, QueryMapAnswersAboutAWall) {
  ASSERT_EQ(mapWall().exit_code, 0);
  const Result result = query("x,y,z\n0.013,0.02,0.99\n0.013,0.02,1.01\n0.0,0.0,0.5\n0,0,50\n");
  ASSERT_EQ(result.exit_code, 0) << testing::PrintToString(result.errors);
  EXPECT_THAT(result.errors, IsEmpty());
  const std::vector<std::string> lines = answers();
  ASSERT_EQ(lines.size(), 5u);
  EXPECT_EQ(lines[0], kQueryHeader);
  const std::vector<std::string> before = fieldsOf(lines[1]);
  const std::vector<std::string> behind = fieldsOf(lines[2]);
  const std::vector<std::string> far = fieldsOf(lines[3]);
  const std::vector<std::string> nowhere = fieldsOf(lines[4]);
  ASSERT_EQ(before.size(), 11u);
  EXPECT_THAT(std::vector<std::string>(before.begin(), before.begin() + 3), ElementsAre("0.013", "0.02", "0.99"));
  // The depth is exact; 2 mm leave room for the map's spacing of 2 cm.
  EXPECT_NEAR(std::stod(before[3]), 0.01, 0.002);
  EXPECT_NEAR(std::stod(behind[3]), -0.01, 0.002);
  EXPECT_NEAR(std::stod(before[7]), -1.0, 0.05);
  // The field's standard deviation 1 cm off such a coarsely sampled wall (12.5 mm a pixel) is about 1 cm.
  EXPECT_LT(std::stod(before[8]), 0.3);
  EXPECT_GT(std::stod(behind[8]), 0.7);
  EXPECT_EQ(before[9], "free");
  EXPECT_EQ(behind[9], "occupied");
  EXPECT_EQ(far[9], "free");
  EXPECT_NEAR(std::stod(far[3]), 0.5, 0.01);
  EXPECT_NEAR(std::stod(far[10]), 0.5, 0.01);
  EXPECT_EQ(nowhere[9], "unknown");
  EXPECT_EQ(nowhere[3], "");
}

TEST_F(Tools, QueryMapTakesColumnsInAnyOrderAndPointsWithoutCoordinates) {
  ASSERT_EQ(mapWall().exit_code, 0);
  ASSERT_EQ(query("name, z ,x,\"y\"\r\na,0.99,0.013,0.02\r\n\nb,nan,0,0\nc,,0,0\nd,inf,0,0\n").exit_code, 0);
  const std::vector<std::string> lines = answers();
  ASSERT_EQ(lines.size(), 5u);
  EXPECT_THAT(lines[1], testing::StartsWith("0.013,0.02,0.99,"));
  EXPECT_EQ(fieldsOf(lines[1])[9], "free");
  for (const std::size_t i : {2u, 3u, 4u}) EXPECT_EQ(lines[i], "0,0,,,,,,,,unknown,");
}

TEST_F(Tools, QueryMapRefusesMalformedPointsWithTheLine) {
  ASSERT_EQ(mapWall().exit_code, 0);
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"x,y,z\n1,2,3\n1,2\n", "in.csv:3: has 2 columns, must have 3"},
      {"x,y,z\n1,2,3,4\n", "in.csv:2: has 4 columns"},
      {"x,y,z\n1,2,three\n", "in.csv:2: 'three' is not a number"},
      {"x,y,z\n1,2,3e\n", "in.csv:2: '3e' is not a number"},
      {"x,y\n1,2\n", "in.csv:1: header has 0 columns named z"},
      {"x,y,z,x\n1,2,3,4\n", "in.csv:1: header has 2 columns named x"},
      {"1,2,3\n", "in.csv:1: header has 0 columns named x"},
      {"", "in.csv: is empty"},
  };
  for (const auto& [text, expected] : cases) {
    const Result result = query(text);
    EXPECT_EQ(result.exit_code, 1) << text;
    ASSERT_EQ(result.errors.size(), 1u) << text;
    EXPECT_THAT(result.errors[0], HasSubstr(expected));
    EXPECT_FALSE(fs::exists(file("out.csv"))) << text;
  }
}

TEST_F(Tools, QueryMapGoesThroughManyBlocks) {
  ASSERT_EQ(mapWall().exit_code, 0);
  std::string points = "x,y,z\n";
  constexpr int kNumPoints = 100007;  // more than one block
  for (int i = 0; i < kNumPoints; ++i) points += std::to_string(i) + ",50,50\n";
  ASSERT_EQ(query(points).exit_code, 0);
  const std::vector<std::string> lines = answers();
  ASSERT_EQ(lines.size(), kNumPoints + 1u);
  for (int i = 0; i < kNumPoints; ++i) {
    ASSERT_EQ(lines[static_cast<std::size_t>(i) + 1].find(std::to_string(i) + ",50,50,"), 0u) << i;
  }
}

TEST_F(Tools, QueryMapRefusesABrokenMapInOneLine) {
  ASSERT_EQ(mapWall().exit_code, 0);
  const std::string map = readText(file("out/map.gpis"));
  writeText(file("out/map.gpis"), map.substr(0, map.size() - 100));
  const Result truncated = query("x,y,z\n0,0,0\n");
  EXPECT_EQ(truncated.exit_code, 1);
  ASSERT_EQ(truncated.errors.size(), 1u);
  EXPECT_THAT(truncated.errors[0], AllOf(HasSubstr("map.gpis"), HasSubstr("is truncated")));
  EXPECT_FALSE(fs::exists(file("out.csv")));
  fs::remove(file("out/map.gpis"));
  const Result missing = query("x,y,z\n0,0,0\n");
  EXPECT_EQ(missing.exit_code, 1);
  ASSERT_EQ(missing.errors.size(), 1u);
  EXPECT_THAT(missing.errors[0], HasSubstr("No such file"));
}

TEST_F(Tools, TimeOffsetIsRefusedOutsideItsRangeOrWithoutPoseStamps) {
  for (const char* value : {"1.5", "-1.5", "nan"}) {
    const Result result = mapWall(std::string("--time-offset ") + value);
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_THAT(result.errors, ElementsAre(HasSubstr("must be in [-1, 1] s")));
  }
  const Result result = mapWall("--time-offset -0.02");
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.errors, ElementsAre(HasSubstr("poses have no stamps")));
  EXPECT_EQ(mapWall("--time-offset 0").exit_code, 0);
}

TEST_F(Tools, EstimateTimeOffsetSaysWhyItCannot) {
  const Result no_stamps = run(ESTIMATE_TIME_OFFSET " " + file("wall"));
  EXPECT_EQ(no_stamps.exit_code, 1);
  EXPECT_THAT(no_stamps.errors, ElementsAre(HasSubstr("no stamps of their own")));
  EXPECT_THAT(no_stamps.out, IsEmpty());
  EXPECT_EQ(run(ESTIMATE_TIME_OFFSET "").exit_code, 2);
  EXPECT_EQ(run(ESTIMATE_TIME_OFFSET " " + file("wall") + " --start 99").exit_code, 2);
  EXPECT_EQ(run(ESTIMATE_TIME_OFFSET " " + file("wall") + " --depth-units 0").exit_code, 2);
  EXPECT_EQ(run(ESTIMATE_TIME_OFFSET " " + file("nowhere")).exit_code, 1);
  EXPECT_EQ(run(ESTIMATE_TIME_OFFSET " --help").exit_code, 0);
}

}  // namespace
}  // namespace gpis_mapping
