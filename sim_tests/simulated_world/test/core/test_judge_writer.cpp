// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/judge_writer.h"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>
#include <nlohmann/json.hpp>

#include "observation_builder.h"

namespace simulated_world {
namespace {

using test_support::messageOf;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr std::uint64_t kDigest = 0xFE;

class JudgeWriterTest : public testing::Test {
 protected:
  JudgeWriterTest() : judge(JudgeConfig()) {
    std::string pattern = (std::filesystem::temp_directory_path() / "judge_XXXXXX").string();
    folder = mkdtemp(pattern.data());
    world.add(1, {0.0, 0.0, 0.05});
    world.add(2, {1.0, 0.0, 0.05});
  }
  ~JudgeWriterTest() override { std::filesystem::remove_all(folder); }

  void hold(double duration_s) {
    for (int i = 0; i < static_cast<int>(duration_s / 0.1 + 0.5); ++i) {
      world.now.time_s += 0.1;
      judge.observe(world.now);
    }
  }

  std::vector<std::string> linesOf(const std::string& name) const {
    std::ifstream file(folder + "/" + name);
    std::vector<std::string> lines;
    for (std::string line; std::getline(file, line);) lines.push_back(line);
    return lines;
  }

  std::string folder;
  ObservedWorld world;
  Judge judge;
};

TEST_F(JudgeWriterTest, LinesAreOnDiskBeforeTheRunEnds) {
  JudgeWriter writer(folder);
  EXPECT_EQ(linesOf("judge.csv"),
            std::vector<std::string>{
                "time_s,stowed,falls,dropped,collisions,load_contacts,coverage,precision,distance_m,digest"});
  hold(3.0);
  world.touch("forearm", "brick_1", 12.5);
  world.brick(2).T_map_brick.translation().x() = 1.1;
  hold(0.1);
  writer.write(judge, kDigest);
  const std::vector<std::string> rows = linesOf("judge.csv");
  ASSERT_EQ(rows.size(), 1 + judge.history().size());
  EXPECT_EQ(rows.back(), "3.100,0,1,0,1,0,0.00000,,0.000,00000000000000fe");
  const std::vector<std::string> events = linesOf("events.jsonl");
  ASSERT_EQ(events.size(), 2U);
  const nlohmann::json fall = nlohmann::json::parse(events[0]);
  EXPECT_EQ(fall.at("event"), "fall");
  EXPECT_EQ(fall.at("brick"), 2);
  EXPECT_NEAR(fall.at("distance_m").get<double>(), 0.1, 1e-9);
  const nlohmann::json collision = nlohmann::json::parse(events[1]);
  EXPECT_EQ(collision.at("event"), "collision");
  EXPECT_EQ(collision.at("robot_body"), "forearm");
  EXPECT_EQ(collision.at("max_force_N"), 12.5);
  EXPECT_EQ(collision.at("at_m"), nlohmann::json({0.3, 0.2, 0.1}));
  writer.write(judge, kDigest);
  EXPECT_EQ(linesOf("judge.csv").size(), rows.size());  // nothing twice
}

TEST_F(JudgeWriterTest, FinishWritesTheTotals) {
  JudgeWriter writer(folder + "/new/run");  // made if it is not there
  folder += "/new/run";
  hold(1.0);
  world.brick(1).status = BrickStatus::kStowed;
  world.now.base_xy_m.x() = 2.0;
  hold(1.0);
  judge.finish();
  writer.finish(judge, kDigest);
  const nlohmann::json totals = nlohmann::json::parse(std::ifstream(folder + "/judge.json"));
  EXPECT_EQ(totals.at("bricks_total"), 2);
  EXPECT_EQ(totals.at("stowed"), 1);
  EXPECT_EQ(totals.at("falls"), 0);
  EXPECT_EQ(totals.at("distance_m"), 2.0);
  EXPECT_TRUE(totals.at("precision").is_null());
  EXPECT_EQ(totals.at("coverage"), 0.0);
  EXPECT_FALSE(std::filesystem::exists(folder + "/judge.json.part"));
  EXPECT_EQ(linesOf("events.jsonl").size(), 1U);
}

TEST_F(JudgeWriterTest, RefusesAnEarlierRunsFolder) {
  { const JudgeWriter writer(folder); }
  EXPECT_THROW(JudgeWriter{folder}, std::runtime_error);
}

TEST_F(JudgeWriterTest, SaysThatAFolderCannotBeMade) {
  std::ofstream(folder + "/file") << "x";
  EXPECT_THROW(JudgeWriter{folder + "/file/run"}, std::runtime_error);
}

TEST_F(JudgeWriterTest, AFullDiskIsReported) {
  JudgeWriter writer(folder);
  hold(2.0);
  std::filesystem::create_symlink("/dev/full", folder + "/judge.json.part");
  EXPECT_THAT(messageOf<std::runtime_error>([&] { writer.finish(judge, kDigest); }),
              AllOf(HasSubstr("judge.json.part"), HasSubstr("No space left")));
  EXPECT_FALSE(std::filesystem::exists(folder + "/judge.json"));
}

}  // namespace
}  // namespace simulated_world
