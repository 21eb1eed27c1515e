// SPDX-License-Identifier: BSD-3-Clause
// Targets that read text: configurations and recordings.
#include <filesystem>
#include <sstream>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "fuzz/fuzz_engine.h"
#include "fuzz/small_map.h"
#include "fuzz/targets.h"
#include "gpis_mapping/depth_sequence.h"
#include "gpis_mapping/gpis_config.h"

namespace gpis_mapping_fuzz {
namespace {

using gpis_mapping::GpisConfig;
using gpis_mapping::parseGpisConfig;
using gpis_mapping::toYaml;

/// Sections of a configuration as toYaml writes them.
std::vector<std::string> sectionsOf(const std::string& yaml) {
  std::vector<std::string> sections;
  std::istringstream in(yaml);
  for (std::string line; std::getline(in, line);) {
    if (sections.empty() || line.compare(0, 1, " ") != 0) sections.emplace_back();
    sections.back() += line + '\n';
  }
  return sections;
}

/// Damaged configurations.
class ConfigTarget : public Target {
 public:
  Outcome feed(Random* random) override {
    static const std::vector<std::string> kSections = sectionsOf(toYaml(GpisConfig()));
    std::string text;
    const int count = random->between(1, 3);
    for (int i = 0; i < count; ++i) text += random->pick(kSections);
    text = mutateText(std::move(text), yamlDictionary(), random);
    GpisConfig config;
    try {
      config = parseGpisConfig(text, "fuzz");
    } catch (const std::invalid_argument& error) {
      require(std::string(error.what()).find("fuzz") == 0, "a refusal does not name its origin");
      return Outcome::kRefused;
    }
    require(config.validate().empty(), "an impossible configuration was taken");
    const std::string written = toYaml(config);
    require(toYaml(parseGpisConfig(written, "written")) == written, "a configuration is not what was written of it");
    return Outcome::kAccepted;
  }
};

/// Damaged TUM recordings: lists, poses, camera, image.
class RecordingTarget : public Target {
 public:
  RecordingTarget() {
    // A camera that TUM files are made for; every text is small, so that a change matters.
    files_ = {{"camera_info.yaml",
               "image_width: 24\nimage_height: 18\ncamera_matrix:\n  data: [20, 0, 11.5, 0, 20, 8.5, 0, 0, 1]\n"
               "distortion_coefficients:\n  data: [0, 0, 0, 0, 0]\ndepth_units_per_metre: 1000\n"},
              {"depth.txt", "# timestamp file\n10.0 0.png\n10.1 0.png\n10.2 0.png\n"},
              {"groundtruth.txt",
               "# timestamp tx ty tz qx qy qz qw\n9.98 0 0 1 0 0 0 1\n10.05 0.1 0 1 0 0 0 1\n"
               "10.12 0.1 0.1 1 0.7071 0 0 0.7071\n10.2 nan nan nan nan nan nan nan\n"},
              {"0.png", ""}};
    cv::Mat depth(18, 24, CV_16UC1);
    for (int i = 0; i < 18 * 24; ++i) depth.at<std::uint16_t>(i / 24, i % 24) = static_cast<std::uint16_t>(900 + i);
    cv::imwrite(folder_.file("0.png"), depth);
    files_[3].second = readFile(folder_.file("0.png"));
    for (const auto& [name, text] : files_) writeFile(folder_.file(name), text);
  }

  Outcome feed(Random* random) override {
    const auto& [name, good] = files_[random->pick({0U, 0U, 1U, 1U, 2U, 2U, 3U})];
    const std::string path = folder_.file(name);
    if (random->chance(0.02)) {
      std::filesystem::remove(path);
    } else {
      writeFile(path, name == "0.png" ? mutateBytes(good, random) : mutateText(good, dictionary(), random));
    }
    const Outcome outcome = read();
    writeFile(path, good);
    return outcome;
  }

 private:
  static const std::vector<std::string>& dictionary() {
    static const std::vector<std::string> kWords = [] {
      std::vector<std::string> words = yamlDictionary();
      words.insert(words.end(), {"..", "/", "/dev/null", "0.png", std::string(300, 'a'), std::string(5000, '/'),
                                 std::string("a\0b", 3), "\r", "#", "1e308", "-1e308", "10.1", "0.7071", "1 2 3"});
      return words;
    }();
    return kWords;
  }

  Outcome read() const {
    try {
      const auto sequence = gpis_mapping::openDepthSequence(folder_.path());
      require(sequence->camera().validate().empty(), "a recording has an impossible camera");
      bool any = false;
      for (std::size_t i = 0; i < std::min<std::size_t>(4, sequence->size()); ++i) {
        gpis_mapping::SkipReason reason;
        const auto frame = sequence->frame(i, &reason);
        if (!frame) {
          require(!reason.kind.empty(), "a frame was left out without a reason");
          continue;
        }
        any = true;
        require(frame->image.depth_m.size() == static_cast<std::size_t>(frame->image.width) * frame->image.height &&
                    frame->image.width == sequence->camera().width && frame->image.height == sequence->camera().height,
                "an image has another size than the camera");
        require(std::isfinite(frame->stamp_s), "a stamp is not finite");
      }
      return any ? Outcome::kAccepted : Outcome::kRefused;
    } catch (const gpis_mapping::DepthSequenceError& error) {
      // An entry of depth.txt may be an absolute path.
      require(std::string(error.what()).find('/') == 0, "a refusal does not name the file");
      return Outcome::kRefused;
    }
  }

  ScratchFolder folder_;
  std::vector<std::pair<std::string, std::string>> files_;
};

}  // namespace

/// Long: one list.
const std::vector<std::string>& yamlDictionary() {
  static const std::vector<std::string> kWords = {"0",
                                                  "-1",
                                                  "1",
                                                  "1e-310",
                                                  "1e300",
                                                  "-1e300",
                                                  "1e400",
                                                  ".nan",
                                                  ".inf",
                                                  "-.inf",
                                                  "nan",
                                                  "2147483648",
                                                  "-2147483649",
                                                  "99999999999999999999",
                                                  "0x10",
                                                  "010",
                                                  "1_000",
                                                  "1.5e",
                                                  "0.05",
                                                  "0.1",
                                                  "0.3",
                                                  "1.0",
                                                  "50",
                                                  "2",
                                                  "16",
                                                  "true",
                                                  "false",
                                                  "yes",
                                                  "~",
                                                  "null",
                                                  "",
                                                  " ",
                                                  "''",
                                                  "\"",
                                                  "'",
                                                  "[",
                                                  "]",
                                                  "{",
                                                  "}",
                                                  "[]",
                                                  "{}",
                                                  "[1, 2]",
                                                  "[1, 2, 3]",
                                                  "[1, 2, .nan]",
                                                  "[[1], [2], [3]]",
                                                  "{a: 1}",
                                                  "? [a, b]\n: c\n",
                                                  "? {a: b}\n: c\n",
                                                  "&a ",
                                                  "*a",
                                                  "&a [*a]",
                                                  "<<: ",
                                                  "---\n",
                                                  "...\n",
                                                  "!!str ",
                                                  "!!binary ",
                                                  "|\n",
                                                  ">\n",
                                                  "#",
                                                  ":",
                                                  ": ",
                                                  "- ",
                                                  "\t",
                                                  "\n",
                                                  "\n\n",
                                                  "%YAML 1.2\n",
                                                  "sensor:\n",
                                                  "  min_range_m: ",
                                                  "threads: ",
                                                  "auto",
                                                  "wall",
                                                  "kinect_v1",
                                                  "  noise_preset: kinect_v2\n",
                                                  std::string(1, '\0'),
                                                  "\xFF\xFE",
                                                  "\xEF\xBB\xBF",
                                                  "\xC3",
                                                  "\xF0\x9F\xA7\xB1",
                                                  std::string(600, '['),
                                                  std::string(2000, ' '),
                                                  std::string(200, '{'),
                                                  std::string(64, '9')};
  return kWords;
}

std::vector<TargetInfo> textTargets() {
  return {
      {"configurations", 120000, 1000, [](Random*) { return std::make_unique<ConfigTarget>(); }},
      {"recordings", 50000, 1000, [](Random*) { return std::make_unique<RecordingTarget>(); }},
  };
}

}  // namespace gpis_mapping_fuzz
