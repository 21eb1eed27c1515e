// SPDX-License-Identifier: BSD-3-Clause
#include <unistd.h>

#include <cstdint>
#include <exception>
#include <iostream>
#include <optional>
#include <string>

#include <boost/program_options.hpp>
#include <nlohmann/json.hpp>

#include "synthetic_depth/scene_loader.h"
#include "synthetic_depth/tum_sequence.h"

namespace {

namespace po = boost::program_options;

constexpr char kUsage[] = "Usage: generate_depth_sequence SCENE.yaml --out DIR [options]\n";
constexpr int kFailed = 1;
constexpr int kBadUsage = 2;
constexpr int kBadScene = 3;

/// A moving bar on a terminal; in a log one line for each tenth.
class ProgressBar {
 public:
  void show(int done, int total) {
    constexpr int kWidth = 40;
    if (is_terminal_) {
      const auto filled = static_cast<std::size_t>(kWidth * done / total);
      std::cerr << "\r[" << std::string(filled, '#') << std::string(kWidth - filled, '.') << "] " << done << "/"
                << total << (done == total ? "\n" : "") << std::flush;
    } else if (10 * done / total != 10 * (done - 1) / total) {
      std::cerr << done << "/" << total << " frames\n";
    }
  }

 private:
  bool is_terminal_{isatty(STDERR_FILENO) == 1};
};

/// Nothing where only the help was asked for. Throws po::error for wrong usage.
std::optional<po::variables_map> parse(int argc, char** argv) {
  po::options_description visible("Options");
  // clang-format off
  visible.add_options()
    ("help,h", "show this text")
    ("out,o", po::value<std::string>(), "folder to write; made if missing, files of the same name are replaced")
    ("frames,n", po::value<int>(), "only the first N frames")
    ("seed,s", po::value<std::int64_t>(), "seed of the sensor noise, in place of the scene's (a pile keeps its own)")
    ("noise-free", "exact depth: no noise, shadows or dropout; the range limits stay")
    ("raw", "also write frames.f32 and poses.f64");
  // clang-format on
  po::options_description all;
  all.add(visible).add_options()("scene", po::value<std::string>());
  po::positional_options_description positional;
  positional.add("scene", 1);
  po::variables_map arguments;
  po::store(po::command_line_parser(argc, argv).options(all).positional(positional).run(), arguments);
  po::notify(arguments);
  if (arguments.count("help") != 0) {
    std::cout << kUsage << "Writes a synthetic depth sequence in TUM RGB-D layout.\n"
              << visible << "Exit codes: 0 done, 1 cannot write, 2 wrong usage, 3 scene refused.\n";
    return std::nullopt;
  }
  if (arguments.count("scene") == 0 || arguments.count("out") == 0) {
    throw po::error("a scene file and --out are needed");
  }
  if (arguments.count("seed") != 0 && arguments["seed"].as<std::int64_t>() < 0) {
    throw po::error("--seed = " + std::to_string(arguments["seed"].as<std::int64_t>()) + ", must be >= 0");
  }
  return arguments;
}

}  // namespace

int main(int argc, char** argv) {
  std::optional<po::variables_map> parsed;
  try {
    parsed = parse(argc, argv);
  } catch (const po::error& error) {
    std::cerr << "generate_depth_sequence: " << error.what() << "\n" << kUsage;
    return kBadUsage;
  }
  if (!parsed) return 0;
  const po::variables_map& arguments = *parsed;

  synthetic_depth::Scene scene;
  synthetic_depth::SequenceOptions options;
  try {
    scene = synthetic_depth::loadScene(arguments["scene"].as<std::string>());
  } catch (const std::invalid_argument& error) {
    std::cerr << error.what() << "\n";
    return kBadScene;
  }
  if (arguments.count("seed") != 0) {
    scene.seed = static_cast<std::uint64_t>(arguments["seed"].as<std::int64_t>());
  }
  if (arguments.count("frames") != 0) {
    const int num_frames = arguments["frames"].as<int>();
    if (num_frames < 1 || num_frames > scene.numFrames()) {
      std::cerr << "generate_depth_sequence: --frames = " << num_frames << ", must be in [1, " << scene.numFrames()
                << "] for this scene\n";
      return kBadUsage;
    }
    scene.T_scene_camera.resize(
        static_cast<std::size_t>(num_frames));  // later changes are then no part of the sequence
  }
  options.apply_sensor = arguments.count("noise-free") == 0;
  options.write_raw = arguments.count("raw") != 0;
  ProgressBar progress;
  options.on_progress = [&progress](int done, int total) { progress.show(done, total); };

  const std::string directory = arguments["out"].as<std::string>();
  try {
    const synthetic_depth::SequenceStatistics statistics = synthetic_depth::writeTumSequence(scene, directory, options);
    const int removal_frame = scene.firstRemovalFrame();
    const nlohmann::json summary = {
        {"out", directory},
        {"frames", statistics.num_frames},
        {"boxes", scene.boxes.size()},
        {"removed_ids", scene.removedIds()},
        {"removal_frame", removal_frame == synthetic_depth::kNever ? -1 : removal_frame},
        {"seed", scene.seed},
        {"noise_free", !options.apply_sensor},
        {"valid_fraction", statistics.valid_fraction},
        {"render_ms_per_frame", statistics.render_ms},
        {"sensor_ms_per_frame", statistics.sensor_ms},
    };
    std::cout << summary.dump() << std::endl;
  } catch (const std::exception& error) {
    std::cerr << "generate_depth_sequence: " << error.what() << "\n";
    return kFailed;
  }
  return 0;
}
