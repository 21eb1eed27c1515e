// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission_ros/run_recorder.h"

#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>

#include <interactive_mapping_common/testing/temporary_folder.h>

namespace pick_mission_ros {
namespace {

using test_support::messageOf;
using test_support::readText;
using test_support::splitLines;
using test_support::TemporaryFolder;
using test_support::writeText;
using testing::AllOf;
using testing::HasSubstr;

pick_mission::LogEntry entryWith(const std::string& reason) {
  pick_mission::LogEntry entry;
  entry.time_s = 1.5;
  entry.reason = reason;
  return entry;
}

TEST(RunRecorder, MakesItsFolderAndEachLineIsThereAtOnce) {
  const TemporaryFolder folder;
  RunRecorder recorder(folder.file("deep/run"));
  for (int i = 0; i < 3; ++i) {
    recorder.log(entryWith("reason " + std::to_string(i)));
    recorder.selection({{"time_s", i}});
    const auto lines = splitLines(readText(folder.file("deep/run/mission.jsonl")));
    ASSERT_EQ(lines.size(), static_cast<std::size_t>(i + 1));
    EXPECT_EQ(nlohmann::json::parse(lines.back()).at("reason"), "reason " + std::to_string(i));
    EXPECT_EQ(splitLines(readText(folder.file("deep/run/selections.jsonl"))).size(), static_cast<std::size_t>(i + 1));
  }
  EXPECT_EQ(recorder.problem(), "");
}

TEST(RunRecorder, PathHasALineForEachMove) {
  const TemporaryFolder folder;
  RunRecorder recorder(folder.path());
  const auto lines = [&folder] { return splitLines(readText(folder.file("path.jsonl"))); };
  recorder.base(1.0, {2.0, -1.0, 3.1});
  EXPECT_EQ(lines(), std::vector<std::string>{R"({"base":[2.0,-1.0,3.1],"time_s":1.0})"});
  recorder.base(2.0, {2.04, -1.0, 3.1});
  recorder.base(3.0, {2.0, -1.0, -3.1});  // turned by 0.08 rad, through pi
  EXPECT_EQ(lines().size(), 1u) << "it has hardly moved";
  recorder.base(4.0, {2.04, -1.04, 3.1});
  recorder.base(5.0, {2.04, -1.04, -3.0});
  EXPECT_EQ(lines().size(), 3u);
  EXPECT_EQ(recorder.problem(), "");
}

TEST(RunRecorder, WithoutAFolderNothingIsWritten) {
  RunRecorder recorder("");
  recorder.log(entryWith(""));
  recorder.selection({});
  recorder.base(0.0, {});
  recorder.state({{"a", 1}});
  recorder.summary({});
  EXPECT_EQ(recorder.problem(), "");
  EXPECT_FALSE(recorder.savedState());
}

TEST(RunRecorder, StateAndSummaryAreReplacedAsAWhole) {
  const TemporaryFolder folder;
  RunRecorder recorder(folder.path());
  EXPECT_FALSE(RunRecorder::exists(folder.path()));
  EXPECT_FALSE(recorder.savedState());
  recorder.state({{"n", 1}});
  recorder.summary({{"scene", "x"}});
  EXPECT_TRUE(RunRecorder::exists(folder.path()));
  // Who has it open still reads the old one to its end: it was not written into.
  std::ifstream before(folder.file("mission_state.json"));
  recorder.state({{"n", 2}});
  std::string text;
  std::getline(before, text);
  EXPECT_EQ(text, R"({"n":1})");
  EXPECT_EQ(recorder.savedState()->at("n"), 2);
  EXPECT_EQ(nlohmann::json::parse(readText(folder.file("summary.json"))).at("scene"), "x");
  // What a crash in the middle of writing leaves beside it is not taken for it.
  writeText(folder.file("mission_state.json.new"), "{\"n\":");
  EXPECT_EQ(RunRecorder(folder.path()).savedState()->at("n"), 2);
}

TEST(RunRecorder, RefusesAFolderThatCannotBe) {
  const TemporaryFolder folder;
  writeText(folder.file("taken"), "");
  for (const std::string& bad : {folder.file("taken"), folder.file("taken/below"), std::string("/proc/self/run")}) {
    EXPECT_THAT(messageOf<std::invalid_argument>([&bad] { RunRecorder recorder(bad); }),
                AllOf(HasSubstr("run_folder = '" + bad + "'"), HasSubstr("must be a folder that can be written to")));
  }
  // It is there, and takes no files from anybody, root included.
  EXPECT_THAT(messageOf<std::invalid_argument>([] { RunRecorder recorder("/proc/self"); }),
              HasSubstr("must be a folder that can be written to: "));
}

TEST(RunRecorder, RefusesAStateThatIsNone) {
  const TemporaryFolder folder;
  for (const char* text : {"", "{\"mission\":", "nonsense"}) {
    writeText(folder.file("mission_state.json"), text);
    EXPECT_THAT(messageOf<std::invalid_argument>([&] { RunRecorder(folder.path()).savedState(); }),
                HasSubstr(folder.file("mission_state.json") + " is no mission's state"));
  }
  std::filesystem::remove(folder.file("mission_state.json"));
  std::filesystem::create_directory(folder.file("mission_state.json"));
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { RunRecorder(folder.path()).savedState(); }),
              HasSubstr(folder.file("mission_state.json") + " cannot be read"));
}

TEST(RunRecorder, TellsOfEachFileThatCannotBeWrittenUntilItCan) {
  const TemporaryFolder folder;
  std::filesystem::create_symlink("/dev/full", folder.file("mission.jsonl"));
  std::filesystem::create_directory(folder.file("mission_state.json"));
  RunRecorder recorder(folder.path());
  recorder.log(entryWith("lost"));
  recorder.state({{"n", 1}});
  recorder.summary({});  // goes well, and does not hide the others
  EXPECT_THAT(recorder.problem(), AllOf(HasSubstr("mission.jsonl cannot be written: No space left on device"),
                                        HasSubstr("mission_state.json cannot be replaced: ")));
  recorder.log(entryWith("lost, too"));
  std::filesystem::remove(folder.file("mission.jsonl"));
  std::filesystem::remove(folder.file("mission_state.json"));
  recorder.log(entryWith("kept"));
  recorder.state({{"n", 2}});
  EXPECT_EQ(recorder.problem(), "");
  const auto lines = splitLines(readText(folder.file("mission.jsonl")));
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_EQ(nlohmann::json::parse(lines[0]).at("reason"), "kept");
  EXPECT_EQ(recorder.savedState()->at("n"), 2);
}

TEST(RunRecorder, GoesOnBehindHalfALine) {
  const TemporaryFolder folder;
  writeText(folder.file("mission.jsonl"), "{\"whole\":1}\n{\"time_s\":1.0,\"sta");
  RunRecorder recorder(folder.path());
  recorder.log(entryWith("first"));
  recorder.log(entryWith("second"));
  const auto lines = splitLines(readText(folder.file("mission.jsonl")));
  ASSERT_EQ(lines.size(), 4u);
  EXPECT_EQ(nlohmann::json::parse(lines[2]).at("reason"), "first");
  EXPECT_EQ(nlohmann::json::parse(lines[3]).at("reason"), "second");
}

TEST(RunRecorder, TextsThatAreNoUtf8AreWrittenNevertheless) {
  const TemporaryFolder folder;
  RunRecorder recorder(folder.path());
  recorder.log(entryWith("\xff"));
  recorder.selection({{"message", "\xff"}});
  recorder.state({{"message", "\xff"}});
  recorder.summary({{"message", "\xff"}});
  EXPECT_EQ(recorder.problem(), "");
  EXPECT_TRUE(recorder.savedState());
}

}  // namespace
}  // namespace pick_mission_ros
