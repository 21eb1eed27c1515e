// SPDX-License-Identifier: BSD-3-Clause
// How fast the simulated world is by itself, without ROS: seconds of wall and processor per simulated second, by part,
// with bricks at rest, with all of them awake, and while the robot moves; and what judging a large surface costs.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <boost/program_options.hpp>
#include <nlohmann/json.hpp>
#include <yaml-cpp/yaml.h>

#include "measuring.h"
#include "simulated_world/simulation.h"
#include "synthetic_depth/seeded_random.h"

namespace {

using nlohmann::json;
using simulated_world::Cost;
using simulated_world::Simulation;
using simulated_world::SimulationConfig;
using simulated_world::SimulationPart;

constexpr std::array<std::pair<const char*, SimulationPart>, 4> kParts{{{"physics", SimulationPart::kPhysics},
                                                                        {"camera", SimulationPart::kCamera},
                                                                        {"scanner", SimulationPart::kScanner},
                                                                        {"judge", SimulationPart::kJudge}}};
constexpr int kSurfaces = 5;  // that the judge is shown
constexpr double kApproach_m_s = 0.5;
constexpr double kApproach_s = 3.0;  // to where the first heap fills the picture
constexpr double kSwing_s = 2.0;     // the robot goes to and fro with twice this period

/// The camera and its sensor of config/simulation.yaml, under the names of the node's parameters.
void readCamera(const YAML::Node& yaml, SimulationConfig* config) {
  config->camera_rate_hz = yaml["rate_hz"].as<double>();
  interactive_mapping::FieldReader reader(yaml);
  simulated_world::RgbdCameraConfig::fields(config->camera, reader);
}

SimulationConfig readConfig(const std::string& scene) {
  SimulationConfig config;
  const std::string description = BENCH_DESCRIPTION;
  config.description = {description + "/urdf/mp700_ur5e.urdf", description + "/config/base_profile.yaml",
                        description + "/config/bricks.yaml", description + "/config/arm_poses/stowed.yaml"};
  config.scene = scene;
  const YAML::Node yaml = YAML::LoadFile(BENCH_WORLD "/config/simulation.yaml");
  readCamera(yaml["camera"], &config);
  config.scan_noise_std_m = yaml["base"]["scan_noise_std_m"].as<double>();
  return config;
}

struct Case {
  std::string key;
  std::string title;
  bool has_sleep;
  bool is_moving;
};

/// Arm and base to and fro around where they were: far enough that every link moves, not so far that anything is hit.
class Exercise {
 public:
  explicit Exercise(const Simulation& simulation) : home_rad_(simulation.world().armPosition()) {}

  /// To be called before each tick.
  void beforeTick(Simulation& simulation) {
    const auto ticks_per_swing = static_cast<int>(std::lround(kSwing_s / simulation.config().tick_s));
    const bool is_out = ticks_ / ticks_per_swing % 2 == 0;
    if (ticks_ % ticks_per_swing == 0) moveArm(simulation, is_out);
    // A command is good for a moment only.
    simulation.commandBase(is_out ? simulated_world::Twist2d{-0.2, 0.2} : simulated_world::Twist2d{0.2, -0.2});
    ++ticks_;
  }

 private:
  void moveArm(Simulation& simulation, bool is_out) const {
    simulated_world::TrajectoryGoal goal;
    goal.id = "exercise";
    goal.joint_names.assign(simulated_world::kArmJoints.begin(), simulated_world::kArmJoints.end());
    simulated_world::TrajectoryPoint point;
    for (int i = 0; i < simulated_world::kNumArmJoints; ++i) {
      point.positions_rad.push_back(home_rad_[i] + (is_out ? 0.1 * (i + 1) : 0.0));
    }
    point.velocities_rad_s.assign(simulated_world::kNumArmJoints, 0.0);
    point.time_from_start_s = 0.9 * kSwing_s;
    goal.points.push_back(point);
    const simulated_world::GoalAnswer answer = simulation.armDriver().acceptGoal(goal);
    if (!answer.accepted) throw std::runtime_error("the arm refuses to move: " + answer.text);
  }

  simulated_world::ArmVector home_rad_;
  int ticks_{0};
};

void run(Simulation& simulation, double duration_s, Exercise* exercise) {
  const auto ticks = static_cast<int>(std::lround(duration_s / simulation.config().tick_s));
  for (int i = 0; i < ticks; ++i) {
    if (exercise != nullptr) exercise->beforeTick(simulation);
    for (const std::string& incident : simulation.tick().incidents) {
      throw std::runtime_error("not what was to be measured: " + incident);
    }
  }
}

void approach(Simulation& simulation) {
  const auto ticks = static_cast<int>(std::lround(kApproach_s / simulation.config().tick_s));
  for (int i = 0; i < ticks; ++i) {
    simulation.commandBase({kApproach_m_s, 0.0});
    simulation.tick();
  }
  simulation.commandBase({0.0, 0.0});
  for (int i = 0; i < ticks; ++i) simulation.tick();
}

json toJson(const std::vector<Cost>& runs, double simulated_s) {
  std::vector<double> wall_s;
  std::vector<double> processor_s;
  for (const Cost& cost : runs) {
    wall_s.push_back(cost.wall_s / simulated_s);
    processor_s.push_back(cost.processor_s / simulated_s);
  }
  return {{"wall_s", experiments::median(wall_s)}, {"processor_s", experiments::median(processor_s)}};
}

json measure(const Case& what, SimulationConfig config, double simulated_s, int repeat) {
  config.world.has_sleep = what.has_sleep;
  Cost start = simulated_world::costNow();
  Simulation simulation(config);
  const Cost construction = simulated_world::costNow() - start;
  approach(simulation);
  Exercise exercise(simulation);
  const int awake = simulation.world().numAwake();

  std::vector<Cost> totals;
  std::vector<std::vector<Cost>> by_part(kParts.size());
  for (int repetition = 0; repetition < repeat; ++repetition) {
    std::vector<Cost> before;
    for (const auto& [name, part] : kParts) before.push_back(simulation.costs().of(part));
    start = simulated_world::costNow();
    run(simulation, simulated_s, what.is_moving ? &exercise : nullptr);
    totals.push_back(simulated_world::costNow() - start);
    for (std::size_t i = 0; i < kParts.size(); ++i) {
      by_part[i].push_back(simulation.costs().of(kParts[i].second) - before[i]);
    }
  }
  json result = {{"title", what.title},
                 {"bricks", simulation.scene().bricks.size()},
                 {"bricks_awake", awake},
                 {"construction", {{"wall_s", construction.wall_s}, {"processor_s", construction.processor_s}}},
                 {"total", toJson(totals, simulated_s)}};
  for (std::size_t i = 0; i < kParts.size(); ++i) result["parts"][kParts[i].first] = toJson(by_part[i], simulated_s);
  result["real_time_factor"] = 1.0 / result["total"]["wall_s"].get<double>();
  return result;
}

/// A strategy's map as good maps are: all faces of all bricks, in triangles of equal size, off by a few millimetres.
simulated_world::StrategySurface surfaceOf(const Simulation& simulation, std::size_t num_triangles) {
  simulated_world::StrategySurface surface;
  surface.stamp_s = simulation.now();
  const auto& bricks = simulation.scene().bricks;
  const double faces = 6.0 * static_cast<double>(bricks.size());
  const auto cuts = static_cast<std::uint32_t>(std::ceil(std::sqrt(static_cast<double>(num_triangles) / faces / 2.0)));
  synthetic_depth::SeededRandom random(1);
  for (const auto& brick : bricks) {
    for (int face = 0; face < 6; ++face) {
      const int axis = face / 2;
      const auto first = static_cast<std::uint32_t>(surface.points_map.size());
      for (std::uint32_t i = 0; i <= cuts; ++i) {
        for (std::uint32_t j = 0; j <= cuts; ++j) {
          Eigen::Vector3d p_brick;
          p_brick[axis] = (face % 2 == 0 ? 0.5 : -0.5) * brick.type.size_m[axis] + 0.003 * random.normal();
          p_brick[(axis + 1) % 3] = (static_cast<double>(i) / cuts - 0.5) * brick.type.size_m[(axis + 1) % 3];
          p_brick[(axis + 2) % 3] = (static_cast<double>(j) / cuts - 0.5) * brick.type.size_m[(axis + 2) % 3];
          surface.points_map.push_back(brick.T_map_brick * p_brick);
        }
      }
      for (std::uint32_t i = 0; i < cuts; ++i) {
        for (std::uint32_t j = 0; j < cuts; ++j) {
          const std::uint32_t corner = first + i * (cuts + 1) + j;
          surface.triangles.push_back({corner, corner + 1, corner + cuts + 1});
          surface.triangles.push_back({corner + 1, corner + cuts + 2, corner + cuts + 1});
        }
      }
    }
  }
  return surface;
}

json measureJudge(const SimulationConfig& config, std::size_t num_triangles, int surfaces) {
  Simulation simulation(config);
  run(simulation, 1.0, nullptr);
  simulated_world::StrategySurface surface = surfaceOf(simulation, num_triangles);
  std::vector<Cost> costs;
  for (int i = 0; i < surfaces; ++i) {
    surface.stamp_s = simulation.now();
    const Cost start = simulated_world::costNow();
    simulation.judgeSurface(surface);
    costs.push_back(simulated_world::costNow() - start);
    run(simulation, 1.0, nullptr);
  }
  // The first one finds all of the pile still to be covered, the later ones what is left.
  const std::vector<Cost> later(costs.begin() + 1, costs.end());
  return {{"triangles", surface.triangles.size()},
          {"first", toJson({costs.front()}, 1.0)},
          {"later", toJson(later, 1.0)},
          {"coverage", *simulation.judge().report().totals.coverage},
          {"precision", *simulation.judge().report().totals.precision}};
}

std::string text(const json& cost, double unit_s) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, "%.1f (%.1f)", cost["wall_s"].get<double>() / unit_s,
                cost["processor_s"].get<double>() / unit_s);
  return buffer;
}

void print(const json& report) {
  constexpr double kMs = 1e-3;
  std::printf("ms per simulated second, on the wall (of all processors)\n%-27s %8s %16s", "", "x real", "all");
  for (const auto& [name, part] : kParts) std::printf(" %16s", name);
  std::printf("\n");
  for (const auto& [key, entry] : report["cases"].items()) {
    std::printf("%-27s %8.1f %16s", entry["title"].get<std::string>().c_str(), entry["real_time_factor"].get<double>(),
                text(entry["total"], kMs).c_str());
    for (const auto& [name, part] : kParts) std::printf(" %16s", text(entry["parts"][name], kMs).c_str());
    std::printf("  %d of %d bricks awake, built in %s s\n", entry["bricks_awake"].get<int>(),
                entry["bricks"].get<int>(), text(entry["construction"], 1.0).c_str());
  }
  if (report.contains("judge_surface")) {
    const json& judge = report["judge_surface"];
    std::printf(
        "judging a surface of %zu triangles: %s ms the first time, %s ms later; coverage %.3f, precision %.3f\n",
        judge["triangles"].get<std::size_t>(), text(judge["first"], kMs).c_str(), text(judge["later"], kMs).c_str(),
        judge["coverage"].get<double>(), judge["precision"].get<double>());
  }
}

/// "model name" of the first processor, and how busy the machine is.
json machineFacts() {
  std::ifstream cpuinfo("/proc/cpuinfo");
  std::string processor;
  for (std::string line; processor.empty() && std::getline(cpuinfo, line);) {
    if (line.rfind("model name", 0) == 0) processor = line.substr(line.find(':') + 2);
  }
  double load = 0.0;
  std::ifstream("/proc/loadavg") >> load;
  return {{"processor", processor},
          {"cores", std::thread::hardware_concurrency()},
          {"load_at_start", load},
          {"build_type", BENCH_BUILD_TYPE}};
}

int runProgram(int argc, char** argv) {
  namespace options = boost::program_options;
  std::string out_path;
  std::string scene = BENCH_WORLD "/worlds/three_heaps.yaml";
  int repeat = 3;
  double simulated_s = 8.0;
  std::size_t num_triangles = 100000;
  options::options_description description("bench_world: how fast the simulated world is");
  description.add_options()("help,h", "this text")("out", options::value(&out_path), "JSON file to write")(
      "repeat", options::value(&repeat)->default_value(repeat), "runs of each case, of which medians are taken")(
      "scene", options::value(&scene)->default_value(scene), "scene of bricks")(
      "seconds", options::value(&simulated_s)->default_value(simulated_s), "simulated time of a run")(
      "triangles", options::value(&num_triangles)->default_value(num_triangles), "of the surface that is judged")(
      "only", options::value<std::string>(), "key of the one case to be measured: rest, awake, moving or judge");
  options::variables_map arguments;
  options::store(options::parse_command_line(argc, argv, description), arguments);
  if (arguments.count("help") != 0) {
    std::cout << description;
    return 0;
  }
  options::notify(arguments);
  if (repeat < 1 || !(simulated_s >= 1.0)) throw std::invalid_argument("--repeat must be >= 1, --seconds >= 1 s");
  const auto isWanted = [&arguments](const std::string& key) {
    return arguments.count("only") == 0 || arguments["only"].as<std::string>() == key;
  };

  const SimulationConfig config = readConfig(scene);
  json report = {{"camera_rate_hz", config.camera_rate_hz}, {"repeat", repeat}, {"simulated_s", simulated_s}};
  report["machine"] = machineFacts();
  report["cases"] = json::object();
  for (const Case& what : {Case{"rest", "at rest", true, false}, Case{"moving", "arm and base moving", true, true},
                           Case{"awake", "at rest, no brick asleep", false, false}}) {
    if (isWanted(what.key)) report["cases"][what.key] = measure(what, config, simulated_s, repeat);
  }
  if (isWanted("judge")) report["judge_surface"] = measureJudge(config, num_triangles, kSurfaces);

  print(report);
  if (!out_path.empty()) {
    std::ofstream out(out_path);
    out << report.dump(1) << "\n";
    if (!out.flush()) throw std::runtime_error(out_path + ": cannot be written");
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return runProgram(argc, argv);
  } catch (const boost::program_options::error& error) {
    std::cerr << "bench_world: " << error.what() << " (--help explains)\n";
    return 2;
  } catch (const std::exception& error) {
    std::cerr << "bench_world: " << error.what() << "\n";
    return 1;
  }
}
