// SPDX-License-Identifier: BSD-3-Clause
// Endurance: one map, frames without end. The camera circles a pile whose bricks go and come back, so that points are
// deleted and inserted for ever; queries, mesh, and saving and loading go on beside. Memory must stay flat.
#include <malloc.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <deque>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <boost/program_options.hpp>

#include "gpis_mapping/gpis_map.h"
#include "gpis_mapping/map_io.h"
#include "gpis_mapping/mesh_extractor.h"
#include "soak/endurance.h"
#include "synthetic_depth/depth_renderer.h"
#include "synthetic_depth/pile.h"
#include "synthetic_depth/scene.h"
#include "synthetic_depth/seeded_random.h"
#include "synthetic_depth/sensor.h"

namespace {

using gpis_mapping::GpisMap;
using gpis_mapping::MapSnapshot;
using synthetic_depth::Scene;
using synthetic_depth::SeededRandom;

constexpr int kCycle = 250;         // frames after which scene and camera path repeat
constexpr int kTurns = 4;           // of the camera per cycle
constexpr int kHeldSnapshots = 50;  // a slow reader lets go of a snapshot this many frames later
constexpr double kExtent_m = 0.9;
constexpr double kPoseStd_m = 0.001;  // of the camera's position: without it nothing would move after a while
constexpr double kPoseStd_rad = 0.0005;

struct Options {
  std::uint64_t frames{100000};
  std::uint64_t record_every{500};
  std::uint64_t query_every{10};
  std::uint64_t mesh_every{25};
  std::uint64_t save_every{5000};
  std::uint64_t seed{1};
  int threads{1};
  std::string out{"."};
  std::string judge;
};

double residentMb() {
  std::ifstream statm("/proc/self/statm");
  long total = 0;
  long resident = 0;
  statm >> total >> resident;
  return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1e6;
}

Scene makeScene(std::uint64_t seed) {
  Scene scene;
  synthetic_depth::PileConfig pile;
  pile.seed = seed;
  pile.extent_m = kExtent_m;
  pile.height_m = 0.4;
  pile.max_bricks = 12;
  scene.boxes = synthetic_depth::makePile(pile);
  // Each brick is away for a part of the cycle. What it carried hangs in the air then, which no map minds.
  SeededRandom random(seed, 1, 0);
  for (synthetic_depth::Box& box : scene.boxes) {
    const int begin = static_cast<int>(random.next() % (kCycle / 2));
    const int length = kCycle / 3 + static_cast<int>(random.next() % (kCycle / 2));
    box.appears_at_frame = begin;
    box.vanishes_at_frame = std::min(kCycle, begin + length);
  }
  scene.camera = {160, 120, 131.25, 131.25, 79.5, 59.5};
  synthetic_depth::OrbitConfig orbit;
  orbit.radius_m = 1.1;
  orbit.height_m = 0.8;
  orbit.look_at_m = {0.0, 0.0, 0.1};
  orbit.turns = kTurns;
  orbit.frames = kCycle;
  scene.T_scene_camera = synthetic_depth::orbitPoses(orbit);
  scene.sensor.min_range_m = 0.3;
  scene.sensor.max_range_m = 3.0;
  scene.sensor.axial_noise_a_m = 0.0005;
  scene.sensor.axial_noise_c_per_m = 0.0015;
  scene.sensor.baseline_m = 0.05;
  scene.sensor.edge_mixing_fraction = 0.3;
  scene.sensor.edge_threshold_m = 0.03;
  scene.sensor.dropout_probability = 0.002;
  scene.seed = seed;
  const std::vector<std::string> problems = scene.validate();
  if (!problems.empty()) throw std::logic_error("scene: " + problems.front());
  return scene;
}

gpis_mapping::GpisConfig makeConfig(const Scene& scene, int threads) {
  gpis_mapping::GpisConfig config;
  config.threads = threads;
  config.sensor.min_range_m = scene.sensor.min_range_m;
  config.sensor.max_range_m = scene.sensor.max_range_m;
  config.sensor.baseline_m = scene.sensor.baseline_m;
  config.sensor.noise = {scene.sensor.axial_noise_a_m, scene.sensor.axial_noise_b, scene.sensor.axial_noise_c_per_m};
  config.region.min_m = {-0.5, -0.5, -10.0};
  config.region.max_m = {0.5, 0.5, 10.0};
  return config;
}

/// The pose as a localisation would give it.
Eigen::Isometry3d jittered(const Eigen::Isometry3d& pose, SeededRandom* random) {
  const auto vector = [random](double std) {
    return Eigen::Vector3d(std * random->normal(), std * random->normal(), std * random->normal());
  };
  Eigen::Isometry3d result = pose;
  result.translation() += vector(kPoseStd_m);
  const Eigen::Vector3d turn = vector(kPoseStd_rad);
  result.linear() = pose.linear() * Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
  return result;
}

gpis_mapping::Points3d randomPoints(SeededRandom* random, Eigen::Index count) {
  gpis_mapping::Points3d points(3, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    points.col(i) = Eigen::Vector3d(random->uniform(-0.6, 0.6), random->uniform(-0.6, 0.6), random->uniform(-0.1, 0.6));
  }
  return points;
}

void require(bool good, const std::string& what, std::uint64_t frame) {
  if (!good) throw std::runtime_error("frame " + std::to_string(frame) + ": " + what);
}

/// Saves, loads, and compares; the file is the map.
void saveAndLoad(const GpisMap& map, const std::string& path, std::uint64_t frame) {
  const gpis_mapping::MapContents saved = map.contents();
  gpis_mapping::saveMap(saved, path);
  const GpisMap restored(gpis_mapping::loadMap(path));
  require(restored.snapshot()->numPoints() == saved.points.size(), "the loaded map has other points", frame);
  require(restored.snapshot()->numUpdates() == saved.num_updates, "the loaded map has another age", frame);
}

int report(const std::vector<soak::Reading>& readings) {
  const soak::Verdict verdict = soak::judge(readings);
  for (const soak::Growth& growth : verdict.growths) {
    std::cout << growth.name << ": " << growth.first << " -> " << growth.last << ", slope "
              << 100.0 * growth.slope_share << " % (at most " << 100.0 * growth.allowed_share << " %)\n";
  }
  for (const std::string& problem : verdict.problems) std::cout << "FAILED: " << problem << '\n';
  if (!readings.empty()) {
    const soak::Reading& last = readings.back();
    std::cout << last.frame << " frames, " << last.inserted << " points inserted, " << last.deleted
              << " deleted: " << (verdict.passed() ? "flat" : "NOT flat") << std::endl;
  }
  return verdict.passed() ? 0 : 1;
}

int judgeFile(const std::string& path) {
  std::ifstream in(path);
  std::stringstream text;
  text << in.rdbuf();
  if (!in) throw std::runtime_error(path + ": cannot be read");
  return report(soak::fromCsv(text.str()));
}

void checkAnswers(const MapSnapshot& snapshot, int threads, std::uint64_t frame, SeededRandom* random) {
  gpis_mapping::QueryOptions query;
  query.variance_gradient = true;
  query.threads = threads;
  const gpis_mapping::QueryResult answers = snapshot.query(randomPoints(random, 200), query);
  for (Eigen::Index i = 0; i < answers.distance.size(); ++i) {
    require(!std::isinf(answers.distance[i]), "a distance is infinite", frame);
    // Within the range of the Euclidean distance there is always a nearest surface.
    require(std::isfinite(answers.euclidean_distance[i]), "no Euclidean distance beside the pile", frame);
  }
}

/// Sizes after `frame`; what was counted since the start is the caller's.
soak::Reading readingOf(const MapSnapshot& snapshot, const gpis_mapping::MeshExtractor& extractor,
                        std::uint64_t frame) {
  const gpis_mapping::TriangleMesh mesh = extractor.mesh();
  for (const Eigen::Vector3d& vertex : mesh.vertices_map) require(vertex.allFinite(), "a vertex is not finite", frame);
  const struct mallinfo2 heap = mallinfo2();
  soak::Reading reading;
  reading.frame = frame + 1;
  reading.resident_mb = residentMb();
  reading.heap_used_mb = static_cast<double>(heap.uordblks + heap.hblkhd) / 1e6;
  reading.heap_free_mb = static_cast<double>(heap.fordblks) / 1e6;
  reading.points = snapshot.numPoints();
  reading.cells = snapshot.cells().size();
  reading.chunks = snapshot.observed().numChunks();
  reading.mesh_pieces = extractor.numPieces();
  reading.triangles = mesh.triangles.size();
  return reading;
}

int run(const Options& options) {
  std::filesystem::create_directories(options.out);
  const std::string map_path = options.out + "/soak_map.gpis";
  const std::string csv_path = options.out + "/loop.csv";
  Scene scene = makeScene(options.seed);
  std::vector<cv::Mat> exact;
  for (int k = 0; k < kCycle; ++k) exact.push_back(synthetic_depth::renderDepth(scene, k));

  const gpis_mapping::CameraModel camera{scene.camera.width_px, scene.camera.height_px, scene.camera.fx_px,
                                         scene.camera.fy_px,    scene.camera.cx_px,     scene.camera.cy_px};
  GpisMap map(makeConfig(scene, options.threads));
  gpis_mapping::MeshExtractor extractor(map.config());
  std::deque<std::shared_ptr<const MapSnapshot>> held;
  std::vector<soak::Reading> readings;
  std::uint64_t inserted = 0;
  std::uint64_t deleted = 0;
  double update_ms = 0.0;
  std::ofstream csv;
  for (std::uint64_t frame = 0; frame < options.frames; ++frame) {
    const int view = static_cast<int>(frame % kCycle);
    scene.seed = SeededRandom(options.seed, 2, frame).next();  // fresh noise for the same view
    const cv::Mat depth = synthetic_depth::applySensor(scene, view, exact[static_cast<std::size_t>(view)]);
    gpis_mapping::DepthImage image{depth.cols, depth.rows, {}};
    image.depth_m.assign(depth.ptr<float>(), depth.ptr<float>() + depth.total());
    SeededRandom random(options.seed, 3, frame);
    const gpis_mapping::UpdateStatistics statistics = map.update(
        image, camera, jittered(scene.cameraInMap(view), &random), 1000.0 + 0.1 * static_cast<double>(frame));
    inserted += statistics.inserted;
    deleted += statistics.deleted;
    update_ms += statistics.total_ms;
    held.push_back(map.snapshot());
    if (held.size() > kHeldSnapshots) held.pop_front();

    if (frame % options.query_every == 0) checkAnswers(*held.front(), options.threads, frame, &random);
    if (frame % options.mesh_every == 0) extractor.update(*held.back());
    if (options.save_every > 0 && (frame + 1) % options.save_every == 0) saveAndLoad(map, map_path, frame);
    if ((frame + 1) % options.record_every != 0) continue;

    extractor.update(*held.back());
    soak::Reading reading = readingOf(*held.back(), extractor, frame);
    reading.inserted = inserted;
    reading.deleted = deleted;
    reading.ms_per_frame = update_ms / static_cast<double>(options.record_every);
    update_ms = 0.0;
    readings.push_back(reading);
    // Line by line, so that an interrupted run leaves what it measured.
    const std::string text = soak::toCsv({reading});
    if (!csv.is_open()) {
      csv.open(csv_path);
      csv << text << std::flush;
    } else {
      csv << text.substr(text.find('\n') + 1) << std::flush;
    }
    if (readings.size() % 10 == 0) {
      std::cout << "frame " << reading.frame << ": " << reading.resident_mb << " MB resident, " << reading.heap_used_mb
                << " MB in use, " << reading.points << " points, " << reading.cells << " cells, "
                << reading.ms_per_frame << " ms per frame" << std::endl;
    }
  }
  require(csv.good(), csv_path + " could not be written", options.frames);
  std::filesystem::remove(map_path);

  return report(readings);
}

}  // namespace

int main(int argc, char** argv) {
  namespace po = boost::program_options;
  Options options;
  po::options_description description("Runs the map for a long time and judges its memory. Options");
  auto add = description.add_options();
  add("help", "this text");
  add("frames", po::value(&options.frames)->default_value(options.frames), "frames in all");
  add("record-every", po::value(&options.record_every)->default_value(options.record_every),
      "frames between readings; a multiple of 250 keeps them at the same phase of the scene");
  add("mesh-every", po::value(&options.mesh_every)->default_value(options.mesh_every), "frames between mesh updates");
  add("query-every", po::value(&options.query_every)->default_value(options.query_every), "frames between queries");
  add("save-every", po::value(&options.save_every)->default_value(options.save_every),
      "frames between saving and loading; 0: never");
  add("seed", po::value(&options.seed)->default_value(options.seed), "of scene and noise");
  add("threads", po::value(&options.threads)->default_value(options.threads), "of the map");
  add("judge", po::value(&options.judge), "judge this loop.csv of an interrupted run, and do nothing else");
  add("out", po::value(&options.out)->default_value(options.out), "folder for loop.csv");
  try {
    po::variables_map values;
    po::store(po::parse_command_line(argc, argv, description), values);
    po::notify(values);
    if (values.count("help") > 0) {
      std::cout << description;
      return 0;
    }
    if (options.record_every == 0 || options.mesh_every == 0 || options.query_every == 0) {
      throw po::error("--record-every, --mesh-every and --query-every must be > 0");
    }
  } catch (const po::error& error) {
    std::cerr << "soak_map: " << error.what() << '\n' << description;
    return 2;
  }
  try {
    return options.judge.empty() ? run(options) : judgeFile(options.judge);
  } catch (const std::exception& error) {
    std::cerr << "soak_map: " << error.what() << '\n';
    return 1;
  }
}
