// SPDX-License-Identifier: BSD-3-Clause
// A picture of a scene of the simulated world, settled, with the robot at its start.
#include <cmath>
#include <cstdint>
#include <exception>
#include <iostream>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <boost/program_options.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <yaml-cpp/yaml.h>

#include "simulated_world/scene_view.h"
#include "simulated_world/simulation.h"

namespace {

namespace po = boost::program_options;

constexpr char kUsage[] = "Usage: render_world SCENE.yaml --out FILE.png [options]\n";
constexpr int kFailed = 1;
constexpr int kBadUsage = 2;
constexpr int kSamples = 8;  // per pixel: smooth edges

Eigen::Vector3d vectorFrom(const po::variables_map& arguments, const char* name) {
  const auto& values = arguments[name].as<std::vector<double>>();
  if (values.size() != 3) {
    throw po::error("--" + std::string(name) + " takes three numbers, x y z in metres");
  }
  return {values[0], values[1], values[2]};
}

/// The camera's part of the node's parameters, config/simulation.yaml.
void readCamera(const std::string& file, simulated_world::RgbdCameraConfig* camera) {
  interactive_mapping::FieldReader reader(YAML::LoadFile(file)["camera"]);
  simulated_world::RgbdCameraConfig::fields(*camera, reader);
}

simulated_world::RgbdCamera::Frame cameraFrame(simulated_world::Simulation& simulation) {
  constexpr int kPatience = 1000;  // ticks
  simulation.requestImage();
  for (int i = 0; i < kPatience; ++i) {
    const simulated_world::Simulation::Tick tick = simulation.tick();
    if (!tick.images.empty()) {
      return tick.images.front().frame;
    }
  }
  throw std::runtime_error("the camera gives no image");
}

/// Depth in colours, near red to far blue, black where nothing was measured, with a bar of metres below.
cv::Mat depthPicture(const cv::Mat& depth_m) {
  constexpr double kNear_m = 0.5;
  constexpr double kFar_m = 5.5;
  constexpr int kBar_px = 24;
  constexpr int kLabels_px = 28;
  const auto coloured = [](const cv::Mat& metres) {
    cv::Mat grey;
    cv::Mat bgr;
    // TURBO runs from blue to red: the nearer, the redder.
    cv::Mat(metres - kNear_m).convertTo(grey, CV_8U, -255.0 / (kFar_m - kNear_m), 255.0);
    cv::applyColorMap(grey, bgr, cv::COLORMAP_TURBO);
    bgr.setTo(cv::Scalar(0, 0, 0), ~((metres > 0.0F) & (metres < 100.0F)));  // NaN and infinities
    return bgr;
  };
  cv::Mat bar(1, depth_m.cols, CV_32FC1);
  for (int column = 0; column < bar.cols; ++column) {
    bar.at<float>(0, column) = static_cast<float>(kNear_m + (kFar_m - kNear_m) * column / (bar.cols - 1));
  }
  cv::Mat stretched;
  cv::resize(bar, stretched, cv::Size(bar.cols, kBar_px), 0.0, 0.0, cv::INTER_NEAREST);
  cv::Mat labels(kLabels_px, depth_m.cols, CV_8UC3, cv::Scalar(255, 255, 255));
  for (int metres = 1; metres <= static_cast<int>(kFar_m); ++metres) {
    const int column = static_cast<int>((metres - kNear_m) / (kFar_m - kNear_m) * (bar.cols - 1));
    cv::line(labels, {column, 0}, {column, 4}, cv::Scalar(40, 40, 40));
    cv::putText(labels, std::to_string(metres) + " m", {column - 14, kLabels_px - 7}, cv::FONT_HERSHEY_SIMPLEX, 0.5,
                cv::Scalar(40, 40, 40), 1, cv::LINE_AA);
  }
  cv::Mat picture;
  cv::vconcat(std::vector<cv::Mat>{coloured(depth_m), coloured(stretched), labels}, picture);
  return picture;
}

void savePicture(const std::string& file, const cv::Mat& bgr) {
  if (!cv::imwrite(file, bgr, {cv::IMWRITE_PNG_COMPRESSION, 9})) {
    throw std::runtime_error("cannot write " + file);
  }
}

cv::Mat toBgr(const cv::Mat& rgb) {
  cv::Mat bgr;
  cv::cvtColor(rgb, bgr, cv::COLOR_RGB2BGR);
  return bgr;
}

cv::Mat overview(const po::variables_map& arguments, const simulated_world::Simulation& simulation) {
  const int width_px = arguments["width"].as<int>();
  const int height_px = arguments["height"].as<int>();
  simulated_world::RendererConfig renderer_config;
  renderer_config.max_width_px = width_px;
  renderer_config.max_height_px = height_px;
  renderer_config.samples = kSamples;
  renderer_config.quads_per_edge = 4;
  simulated_world::OffscreenRenderer renderer(simulation.world().model(), renderer_config);
  // By default from behind the robot's right, over its shoulder to the pile.
  const Eigen::Vector3d eye_m =
      arguments.count("eye") != 0 ? vectorFrom(arguments, "eye") : Eigen::Vector3d(-4.2, -4.6, 2.6);
  const Eigen::Vector3d target_m =
      arguments.count("target") != 0 ? vectorFrom(arguments, "target") : Eigen::Vector3d(-1.4, 0.0, 0.35);
  return toBgr(simulated_world::renderView(renderer, simulation.world().data(), eye_m, target_m,
                                           arguments["fovy"].as<double>() * M_PI / 180.0, width_px, height_px));
}

/// Nothing where only the help was asked for. Throws po::error for wrong usage.
std::optional<po::variables_map> parse(int argc, char** argv) {
  po::options_description visible("Options");
  // clang-format off
  visible.add_options()
    ("help,h", "show this text")
    ("out,o", po::value<std::string>(), "picture to write, PNG")
    ("view", po::value<std::string>()->default_value("overview"),
     "overview: from outside, in sunlight; camera: the robot's colour image; depth: its depth in false colours")
    ("seed,s", po::value<std::int64_t>()->default_value(1), "of the pile and of the camera's noise")
    ("width", po::value<int>()->default_value(900), "of an overview [px]")
    ("height", po::value<int>()->default_value(500), "of an overview [px]")
    ("eye", po::value<std::vector<double>>()->multitoken(), "of an overview: x y z in the map [m]")
    ("target", po::value<std::vector<double>>()->multitoken(), "what the eye looks at: x y z in the map [m]")
    ("fovy", po::value<double>()->default_value(32.0), "of an overview: vertical field of view [deg]")
    ("config", po::value<std::string>(), "the node's parameters; their camera is used (default: one without noise)")
    ("bricks", po::value<std::string>(), "types of bricks (default: config/bricks.yaml of --description)")
    ("description", po::value<std::string>()->default_value(MP700_UR5E_DESCRIPTION_DIR),
     "folder of the package mp700_ur5e_description");
  // clang-format on
  po::options_description all;
  all.add(visible).add_options()("scene", po::value<std::string>());
  po::positional_options_description positional;
  positional.add("scene", 1);
  po::variables_map arguments;
  const int style = po::command_line_style::unix_style ^ po::command_line_style::allow_short;  // -1.5 is a number
  po::store(po::command_line_parser(argc, argv).options(all).positional(positional).style(style).run(), arguments);
  po::notify(arguments);
  if (arguments.count("help") != 0) {
    std::cout << kUsage << visible << "Exit codes: 0 done, 1 cannot be done, 2 wrong usage.\n";
    return std::nullopt;
  }
  if (arguments.count("scene") == 0 || arguments.count("out") == 0) {
    throw po::error("a scene file and --out are needed");
  }
  const auto view = arguments["view"].as<std::string>();
  if (view != "overview" && view != "camera" && view != "depth") {
    throw po::error("--view = '" + view + "', must be overview, camera or depth");
  }
  if (arguments["seed"].as<std::int64_t>() < 0) {
    throw po::error("--seed = " + std::to_string(arguments["seed"].as<std::int64_t>()) + ", must be >= 0");
  }
  return arguments;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const std::optional<po::variables_map> parsed = parse(argc, argv);
    if (!parsed) return 0;
    const po::variables_map& arguments = *parsed;
    const auto view = arguments["view"].as<std::string>();
    const auto description = arguments["description"].as<std::string>();

    simulated_world::SimulationConfig config;
    config.description = {
        description + "/urdf/mp700_ur5e.urdf", description + "/config/base_profile.yaml",
        arguments.count("bricks") != 0 ? arguments["bricks"].as<std::string>() : description + "/config/bricks.yaml",
        description + "/config/arm_poses/stowed.yaml"};
    config.scene = arguments["scene"].as<std::string>();
    config.seed = static_cast<std::uint64_t>(arguments["seed"].as<std::int64_t>());
    config.world.has_surroundings = view == "overview";
    if (arguments.count("config") != 0) {
      readCamera(arguments["config"].as<std::string>(), &config.camera);
    }
    simulated_world::Simulation simulation(config);

    const auto out = arguments["out"].as<std::string>();
    if (view == "overview") {
      savePicture(out, overview(arguments, simulation));
    } else {
      const simulated_world::RgbdCamera::Frame frame = cameraFrame(simulation);
      savePicture(out, view == "camera" ? toBgr(frame.rgb) : depthPicture(frame.depth_m));
    }
  } catch (const po::error& error) {
    std::cerr << "render_world: " << error.what() << "\n" << kUsage;
    return kBadUsage;
  } catch (const std::exception& error) {
    std::cerr << "render_world: " << error.what() << "\n";
    return kFailed;
  }
  return 0;
}
