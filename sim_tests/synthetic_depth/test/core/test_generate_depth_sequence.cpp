// SPDX-License-Identifier: BSD-3-Clause
#include <sys/wait.h>

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>

#include <boost/filesystem.hpp>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "synthetic_depth/tum_sequence.h"

namespace {

struct Outcome {
  int exit_code;
  std::string out;  ///< stdout
  std::string err;  ///< stderr
};

class GenerateDepthSequence : public testing::Test {
 protected:
  GenerateDepthSequence()
      : directory_(boost::filesystem::temp_directory_path() / boost::filesystem::unique_path("generate_%%%%%%%%")) {
    boost::filesystem::create_directory(directory_);
    std::ofstream(path("scene.yaml"))
        << "camera: {width_px: 40, height_px: 30, fx_px: 35}\n"
           "boxes: [{id: 3, xyz_m: [0, 0, 0.1], half_extents_m: [0.1, 0.1, 0.1]}]\n"
           "changes: [{frame: 2, remove: [3]}]\n"
           "sensor: {axial_noise_a_m: 0.01}\n"
           "trajectory: {type: static, eye_m: [1, 0, 1], target_m: [0, 0, 0], frames: 4}\n";
  }
  ~GenerateDepthSequence() override { boost::filesystem::remove_all(directory_); }

  std::string path(const std::string& name) const { return (directory_ / name).string(); }

  Outcome run(const std::string& arguments) const {
    const std::string command =
        std::string(GENERATE_DEPTH_SEQUENCE) + " " + arguments + " > " + path("stdout") + " 2> " + path("stderr");
    const int status = std::system(command.c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, content("stdout"), content("stderr")};
  }

  std::string content(const std::string& name) const {
    std::ifstream file(path(name), std::ios::binary);
    std::ostringstream text;
    text << file.rdbuf();
    return text.str();
  }

  boost::filesystem::path directory_;
};

TEST_F(GenerateDepthSequence, WritesTheSequenceAndEndsWithOneJsonLine) {
  const Outcome outcome = run(path("scene.yaml") + " --out " + path("all"));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const auto summary = nlohmann::json::parse(outcome.out);
  EXPECT_EQ(summary["frames"], 4);
  EXPECT_EQ(summary["removed_ids"], nlohmann::json::array({3}));
  EXPECT_EQ(summary["removal_frame"], 2);
  EXPECT_EQ(outcome.out.find('\n'), outcome.out.size() - 1);
  EXPECT_FALSE(outcome.err.empty()) << "progress belongs on stderr";
  EXPECT_EQ(synthetic_depth::readTumSequence(path("all")).size(), 4U);
}

TEST_F(GenerateDepthSequence, FramesCutTheSequenceAndTheChangesAfterIt) {
  const Outcome outcome = run(path("scene.yaml") + " -o " + path("cut") + " --frames 2 --raw");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const auto summary = nlohmann::json::parse(outcome.out);
  EXPECT_EQ(summary["frames"], 2);
  EXPECT_EQ(summary["removal_frame"], -1);
  EXPECT_EQ(synthetic_depth::readTumSequence(path("cut")).size(), 2U);
  EXPECT_EQ(boost::filesystem::file_size(path("cut/frames.f32")), 2U * 40U * 30U * 4U);
}

TEST_F(GenerateDepthSequence, SeedAndNoiseFreeDecideTheImage) {
  ASSERT_EQ(run(path("scene.yaml") + " -o " + path("a") + " -n 1 --seed 5").exit_code, 0);
  ASSERT_EQ(run(path("scene.yaml") + " -o " + path("b") + " -n 1 --seed 5").exit_code, 0);
  ASSERT_EQ(run(path("scene.yaml") + " -o " + path("c") + " -n 1 --seed 6").exit_code, 0);
  ASSERT_EQ(run(path("scene.yaml") + " -o " + path("d") + " -n 1 --seed 5 --noise-free").exit_code, 0);
  ASSERT_EQ(run(path("scene.yaml") + " -o " + path("e") + " -n 1 --seed 6 --noise-free").exit_code, 0);
  const std::string image = "/depth/000000.png";
  EXPECT_EQ(content("a" + image), content("b" + image));
  EXPECT_NE(content("a" + image), content("c" + image));
  EXPECT_NE(content("a" + image), content("d" + image));
  EXPECT_EQ(content("d" + image), content("e" + image));
}

TEST_F(GenerateDepthSequence, SaysWhatIsWrongAndGivesTheDocumentedExitCode) {
  EXPECT_EQ(run("--help").exit_code, 0);
  EXPECT_EQ(run(path("scene.yaml")).exit_code, 2);
  EXPECT_EQ(run(path("scene.yaml") + " --out " + path("x") + " --colour").exit_code, 2);
  EXPECT_EQ(run(path("scene.yaml") + " --out " + path("x") + " --seed -1").exit_code, 2);
  const Outcome too_many = run(path("scene.yaml") + " --out " + path("x") + " --frames 5");
  EXPECT_EQ(too_many.exit_code, 2);
  EXPECT_NE(too_many.err.find("--frames = 5, must be in [1, 4]"), std::string::npos) << too_many.err;
  const Outcome missing = run(path("none.yaml") + " --out " + path("x"));
  EXPECT_EQ(missing.exit_code, 3);
  EXPECT_NE(missing.err.find("none.yaml: cannot be read"), std::string::npos) << missing.err;
  EXPECT_EQ(missing.out, "");
  EXPECT_EQ(run(path("scene.yaml") + " --out /dev/null/x").exit_code, 1);
}

}  // namespace
