// SPDX-License-Identifier: BSD-3-Clause
// Feeds one rendered sequence to GpisMap and to OctoMap, frame by frame in turn and in one process, and reports for both
// the time per frame, the memory and how good the map is.
#include <unistd.h>
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <boost/program_options.hpp>
#include <nlohmann/json.hpp>
#include <octomap/OcTree.h>
#include <octomap/octomap.h>

#include <interactive_mapping_common/stopwatch.h>
#include <interactive_mapping_common/threads/parallel_for.h>
#include "gpis_mapping/gpis_config.h"
#include "gpis_mapping/gpis_map.h"
#include "gpis_mapping/mesh_extractor.h"
#include "ground_truth.h"
#include "map_growth.h"
#include "measuring.h"
#include "octomap_baseline/dynamic_octomap.h"
#include "recorded_frame.h"
#include "synthetic_depth/scene_loader.h"

namespace {

namespace po = boost::program_options;

using experiments::ClaimedSurface;
using experiments::GroundTruth;
using experiments::median;
using experiments::processorMs;
using experiments::quantile;
using experiments::RecordedFrame;
using experiments::surfaceOf;
using experiments::toOctomap;
using interactive_mapping::Stopwatch;
using nlohmann::json;
using synthetic_depth::Scene;

double residentMb() {
  std::ifstream statm("/proc/self/statm");
  long total = 0;
  long resident = 0;
  statm >> total >> resident;
  return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1e6;
}

/// One quantity per frame, measured in each repetition.
class FrameSeries {
 public:
  bool has(std::size_t frame) const { return frame < samples_.size(); }
  void add(std::size_t frame, double value) {
    if (samples_.size() <= frame) samples_.resize(frame + 1);
    samples_[frame].push_back(value);
  }
  /// Per frame the median over the repetitions.
  std::vector<double> perFrame() const {
    std::vector<double> values;
    for (const std::vector<double>& samples : samples_) values.push_back(median(samples));
    return values;
  }
  /// Frame 0 inserts the whole view and is reported by itself.
  json summary(bool with_curve) const {
    std::vector<double> values = perFrame();
    json result = {{"first", values.empty() ? 0.0 : values.front()}};
    if (with_curve) result["per_frame"] = values;
    if (values.size() > 1) values.erase(values.begin());
    result["median"] = median(values);
    result["p95"] = quantile(values, 0.95);
    result["max"] = quantile(values, 1.0);
    return result;
  }

 private:
  std::vector<std::vector<double>> samples_;
};

/// A map under test. One object lives through all repetitions and starts a new map in each.
class Contender {
 public:
  Contender(std::string key, std::string title) : key_(std::move(key)), title_(std::move(title)) {}
  virtual ~Contender() = default;

  const std::string& key() const { return key_; }
  const std::string& title() const { return title_; }
  double medianMs() const { return total_.summary(false)["median"]; }

  double medianProcessorMs() const { return processor_.summary(false)["median"]; }

  virtual void restart() = 0;
  virtual ClaimedSurface surface() = 0;

  void insert(std::size_t k, const RecordedFrame& frame, const gpis_mapping::CameraModel& camera) {
    const double resident_before = residentMb();
    const double processor_before = processorMs();
    const double ms = take(k, frame, camera);
    processor_.add(k, processorMs() - processor_before);
    // The second run lives in the memory that the first one gave back.
    if (!total_.has(k)) rss_growth_mb_ += residentMb() - resident_before;
    total_.add(k, ms);
    afterFrame(k);
    experiments::settleHeap();
  }

  void judge(const GroundTruth& truth, int frame) {
    if (frame == truth.lastBefore()) report_["before_removal"] = truth.quality(surface(), false);
    if (frame == truth.lastBefore() + 1) {
      const ClaimedSurface claimed = surface();
      report_["after_removal"] = truth.quality(claimed, true);
      report_["after_removal"]["ghost_share"] = truth.ghostShare(claimed);
    }
  }

  virtual json report() const {
    json result = report_;
    result["title"] = title_;
    result["total_ms"] = total_.summary(true);
    result["processor_ms"] = processor_.summary(false);
    result["rss_growth_mb"] = rss_growth_mb_;
    return result;
  }

 protected:
  virtual double take(std::size_t k, const RecordedFrame& frame, const gpis_mapping::CameraModel& camera) = 0;
  virtual void afterFrame(std::size_t) {}

  json report_;
  double rss_growth_mb_{0.0};

 private:
  std::string key_;
  std::string title_;
  FrameSeries total_;
  FrameSeries processor_;
};

class GpisContender : public Contender {
 public:
  GpisContender(const std::string& key, const std::string& title, const gpis_mapping::GpisConfig& config,
                bool with_mesh)
      : Contender(key, title), config_(config), with_mesh_(with_mesh) {}

  void restart() override {
    map_ = std::make_unique<gpis_mapping::GpisMap>(config_);
    mesher_ = std::make_unique<gpis_mapping::MeshExtractor>(config_);
  }

  ClaimedSurface surface() override {
    mesher_->update(*map_->snapshot());
    return surfaceOf(mesher_->mesh());
  }

  std::shared_ptr<const gpis_mapping::MapSnapshot> snapshot() const { return map_->snapshot(); }
  const gpis_mapping::GpisConfig& config() const { return config_; }

  json report() const override {
    json result = Contender::report();
    for (const auto& [stage, series] : stages_) result["stages_ms"][stage] = series.summary(true);
    if (with_mesh_) {
      result["mesh_incremental_ms"] = mesh_ms_.summary(true);
      result["mesh_incremental_cells"] = mesh_cells_.summary(false);
    }
    const auto snapshot = map_->snapshot();
    result["map_mb"] = static_cast<double>(snapshot->memoryBytes()) / 1e6;
    result["points"] = snapshot->numPoints();
    result["cells"] = snapshot->cells().size();
    double training = 0.0;
    double largest = 0.0;
    for (const auto& [key, cell] : snapshot->cells()) {
      training += static_cast<double>(cell->numTraining());
      largest = std::max(largest, static_cast<double>(cell->numTraining()));
    }
    result["training_points_per_cell"] =
        training / std::max<double>(1.0, static_cast<double>(snapshot->cells().size()));
    result["largest_cell"] = largest;
    result["threads"] = interactive_mapping::resolveThreadCount(config_.threads);
    result["cells_retrained"] = cells_retrained_.summary(true);
    return result;
  }

 protected:
  double take(std::size_t k, const RecordedFrame& frame, const gpis_mapping::CameraModel& camera) override {
    Stopwatch watch;
    const gpis_mapping::UpdateStatistics s = map_->update(frame.image, camera, frame.T_map_camera, frame.stamp_s);
    const double ms = watch.lapMs();
    stages_["classify"].add(k, s.classify_ms);
    stages_["regress"].add(k, s.regress_ms);
    stages_["fuse"].add(k, s.fuse_ms);
    stages_["observe"].add(k, s.observe_ms);
    stages_["insert"].add(k, s.insert_ms);
    stages_["train"].add(k, s.train_ms);
    stages_["publish"].add(k, s.publish_ms);
    cells_retrained_.add(k, static_cast<double>(s.cells_retrained));
    return ms;
  }

  void afterFrame(std::size_t k) override {
    if (!with_mesh_) return;
    const auto snapshot = map_->snapshot();
    Stopwatch watch;
    const std::size_t cells = mesher_->update(*snapshot);
    mesh_ms_.add(k, watch.lapMs());
    mesh_cells_.add(k, static_cast<double>(cells));
  }

 private:
  gpis_mapping::GpisConfig config_;
  bool with_mesh_;
  std::unique_ptr<gpis_mapping::GpisMap> map_;
  std::unique_ptr<gpis_mapping::MeshExtractor> mesher_;
  std::map<std::string, FrameSeries> stages_;
  FrameSeries mesh_ms_;
  FrameSeries mesh_cells_;
  FrameSeries cells_retrained_;
};

class OctomapContender : public Contender {
 public:
  struct Options {
    double resolution_m{0.02};
    bool every_ray{false};  // octomap_server casts every pixel's ray; insertPointCloud can do one per end voxel
    const gpis_mapping::GpisConfig::Region* region{nullptr};  // null: everything
  };
  OctomapContender(const std::string& key, const std::string& title, const Options& options)
      : Contender(key, title), options_(options) {}

  void restart() override {
    tree_ = std::make_unique<octomap::OcTree>(options_.resolution_m);
    if (options_.region != nullptr) {
      tree_->useBBXLimit(true);
      octomap::point3d low = toOctomap(options_.region->min_m.cwiseMax(-20.0));
      octomap::point3d high = toOctomap(options_.region->max_m.cwiseMin(20.0));
      tree_->setBBXMin(low);
      tree_->setBBXMax(high);
    }
  }

  ClaimedSurface surface() override { return surfaceOf(*tree_); }
  const octomap::OcTree& tree() const { return *tree_; }

  json report() const override {
    json result = Contender::report();
    result["map_mb"] = static_cast<double>(tree_->memoryUsage()) / 1e6;
    result["nodes"] = tree_->size();
    result["resolution_m"] = options_.resolution_m;
    return result;
  }

 protected:
  double take(std::size_t, const RecordedFrame& frame, const gpis_mapping::CameraModel&) override {
    const octomap::point3d origin = toOctomap(frame.T_map_camera.translation());
    Stopwatch watch;
    tree_->insertPointCloud(frame.cloud, origin, experiments::kMaxRange_m, false, !options_.every_ray);
    return watch.lapMs();
  }

 private:
  Options options_;
  std::unique_ptr<octomap::OcTree> tree_;
};

/// OctoMap that forgets, with the same sensor as ours.
class ForgettingOctomapContender : public Contender {
 public:
  ForgettingOctomapContender(const std::string& key, const std::string& title, const gpis_mapping::GpisConfig& config)
      : Contender(key, title) {
    config_.sensor = config.sensor;
    config_.region.min_m = config.region.min_m;
    config_.region.max_m = config.region.max_m;
    config_.threads = config.threads;
  }

  void restart() override { map_ = std::make_unique<octomap_baseline::DynamicOctomap>(config_); }

  ClaimedSurface surface() override { return surfaceOf(map_->tree()); }

  json report() const override {
    json result = Contender::report();
    result["map_mb"] = static_cast<double>(map_->tree().memoryUsage()) / 1e6;
    result["nodes"] = map_->tree().size();
    result["resolution_m"] = config_.resolution_m;
    result["threads"] = interactive_mapping::resolveThreadCount(config_.threads);
    return result;
  }

 protected:
  double take(std::size_t, const RecordedFrame& frame, const gpis_mapping::CameraModel& camera) override {
    Stopwatch watch;
    map_->update(frame.image, camera, frame.T_map_camera, frame.stamp_s);
    return watch.lapMs();
  }

 private:
  octomap_baseline::OctomapConfig config_;
  std::unique_ptr<octomap_baseline::DynamicOctomap> map_;
};

/// Points answered per second, median of three runs.
double throughput(Eigen::Index count, const std::function<void()>& ask) {
  std::vector<double> rates;
  for (int i = 0; i < 3; ++i) {
    Stopwatch watch;
    ask();
    rates.push_back(1e3 * static_cast<double>(count) / watch.lapMs());
  }
  return median(rates);
}

struct Band {
  std::string name;
  Eigen::Matrix3Xd points;
  Eigen::VectorXd exact;
};

json measureQueries(const gpis_mapping::MapSnapshot& snapshot, const std::vector<Band>& bands, int max_threads) {
  json result;
  gpis_mapping::QueryOptions distance_only;
  distance_only.variance = false;
  Stopwatch watch;
  snapshot.query(bands.back().points.leftCols(1), distance_only);
  result["first_query_ms"] = watch.lapMs();  // far from the surface: builds an index of nearest points
  for (const Band& band : bands) {
    json entry = {{"points", band.points.cols()}};
    for (const int threads : {1, max_threads}) {
      const std::string suffix = "_" + std::to_string(threads) + "_threads";
      gpis_mapping::QueryOptions options;
      options.threads = threads;
      options.variance = false;
      const auto ask = [&] { snapshot.query(band.points, options); };
      entry["distance_per_s" + suffix] = throughput(band.points.cols(), ask);
      options.variance = true;
      entry["variance_per_s" + suffix] = throughput(band.points.cols(), ask);
      options.variance_gradient = true;
      entry["variance_gradient_per_s" + suffix] = throughput(band.points.cols(), ask);
      if (max_threads == 1) break;
    }
    const gpis_mapping::QueryResult answers = snapshot.query(band.points, distance_only);
    double sum = 0.0;
    double squares = 0.0;
    std::size_t answered = 0;
    for (Eigen::Index i = 0; i < band.points.cols(); ++i) {
      if (std::isnan(answers.distance[i])) continue;
      const double error = answers.distance[i] - band.exact[i];
      sum += std::abs(error);
      squares += error * error;
      ++answered;
    }
    const double n = std::max<double>(1.0, static_cast<double>(answered));
    entry["answered_share"] = static_cast<double>(answered) / static_cast<double>(band.points.cols());
    entry["mean_abs_error_mm"] = 1e3 * sum / n;
    entry["rmse_mm"] = 1e3 * std::sqrt(squares / n);
    result["bands"][band.name] = entry;
  }
  return result;
}

json machine() {
  json result;
  std::ifstream cpuinfo("/proc/cpuinfo");
  for (std::string line; std::getline(cpuinfo, line);) {
    if (line.rfind("model name", 0) == 0) {
      result["processor"] = line.substr(line.find(':') + 2);
      break;
    }
  }
  double load = -1.0;
  std::ifstream load_file("/proc/loadavg");
  load_file >> load;
  result["cores"] = std::thread::hardware_concurrency();
  result["load_at_start"] = load;
  result["compiler"] = std::string("GCC ") + __VERSION__;
  result["build_type"] = BENCH_BUILD_TYPE;
  return result;
}

struct Options {
  std::string scene_path;
  std::string config_path;
  std::string out_path;
  int repeat{1};
  int num_frames{0};  // 0: all
  Eigen::Index num_queries{0};
  bool is_only_ours{false};
  bool has_forgetting{false};
  bool has_1cm{false};
  bool has_every_ray{false};
};

/// Nothing when only help was asked for. Throws po::error.
std::optional<Options> parseCommandLine(int argc, char** argv) {
  Options wanted;
  po::options_description options("Options");
  // clang-format off
  options.add_options()
    ("help,h", "show this text")
    ("scene", po::value(&wanted.scene_path)->default_value(BENCH_SCENES "/bench_pile.yaml", "bench_pile.yaml"), "scene file")
    ("config", po::value(&wanted.config_path)->default_value(BENCH_MAP_CONFIG, "bench.yaml"), "settings of the map")
    ("out,o", po::value(&wanted.out_path), "JSON file to write; without it the JSON goes to the terminal")
    ("repeat,n", po::value(&wanted.repeat)->default_value(1), "run the sequence so often and take medians")
    ("frames", po::value(&wanted.num_frames)->default_value(0), "only the first so many; 0: all")
    ("queries", po::value(&wanted.num_queries)->default_value(100000), "points per band")
    ("only-ours", po::bool_switch(&wanted.is_only_ours), "no OctoMap beside the 2 cm one, no run with one thread")
    ("octomap-forgets", po::bool_switch(&wanted.has_forgetting), "also octomap_baseline, 2 cm, our region")
    ("octomap-1cm", po::bool_switch(&wanted.has_1cm), "also OctoMap at 1 cm (slow)")
    ("octomap-every-ray", po::bool_switch(&wanted.has_every_ray),
     "also OctoMap as octomap_server feeds it: one ray per pixel, not one per end voxel (slow)");
  // clang-format on
  po::variables_map arguments;
  po::store(po::parse_command_line(argc, argv, options), arguments);
  po::notify(arguments);
  if (arguments.count("help") != 0) {
    std::cout << "Usage: bench_map_vs_octomap [options]\n" << options;
    return std::nullopt;
  }
  if (wanted.repeat < 1 || wanted.num_frames < 0 || wanted.num_queries < 1) {
    throw po::error("--repeat, --frames and --queries must be positive");
  }
  return wanted;
}

struct Contenders {
  std::vector<std::unique_ptr<Contender>> all;
  GpisContender* ours;
  OctomapContender* octomap_2cm;
};

Contenders makeContenders(const Options& options, const gpis_mapping::GpisConfig& config, int threads) {
  Contenders made;
  auto ours =
      std::make_unique<GpisContender>("gpis", "gpis_mapping, " + std::to_string(threads) + " threads", config, true);
  made.ours = ours.get();
  made.all.push_back(std::move(ours));
  auto octomap_2cm = std::make_unique<OctomapContender>("octomap_2cm", "OctoMap 2 cm", OctomapContender::Options{});
  made.octomap_2cm = octomap_2cm.get();
  made.all.push_back(std::move(octomap_2cm));
  if (!options.is_only_ours) {
    gpis_mapping::GpisConfig single = config;
    single.threads = 1;
    made.all.push_back(std::make_unique<GpisContender>("gpis_1_thread", "gpis_mapping, 1 thread", single, false));
    OctomapContender::Options same_region;
    same_region.region = &config.region;
    made.all.push_back(
        std::make_unique<OctomapContender>("octomap_2cm_region", "OctoMap 2 cm, our region", same_region));
  }
  if (options.has_forgetting) {
    made.all.push_back(
        std::make_unique<ForgettingOctomapContender>("octomap_baseline_2cm", "octomap_baseline 2 cm", config));
  }
  if (options.has_1cm) {
    OctomapContender::Options fine;
    fine.resolution_m = 0.01;
    made.all.push_back(std::make_unique<OctomapContender>("octomap_1cm", "OctoMap 1 cm", fine));
  }
  if (options.has_every_ray) {
    OctomapContender::Options every_ray;
    every_ray.every_ray = true;
    made.all.push_back(
        std::make_unique<OctomapContender>("octomap_2cm_every_ray", "OctoMap 2 cm, every ray", every_ray));
  }
  return made;
}

json measureMesh(const gpis_mapping::GpisConfig& config, const gpis_mapping::MapSnapshot& snapshot) {
  std::vector<double> mesh_ms;
  gpis_mapping::TriangleMesh mesh;
  for (int i = 0; i < 3; ++i) {
    gpis_mapping::MeshExtractor mesher(config);
    Stopwatch watch;
    mesher.update(snapshot);
    mesh = mesher.mesh();
    mesh_ms.push_back(watch.lapMs());
  }
  return {{"full_ms", median(mesh_ms)}, {"triangles", mesh.triangles.size()}, {"vertices", mesh.vertices_map.size()}};
}

/// All frames to all maps, `repeat` times. Returns ours as it was before the removal, which the exact distances belong to.
std::shared_ptr<const gpis_mapping::MapSnapshot> feed(const Contenders& contenders,
                                                      const std::vector<RecordedFrame>& frames,
                                                      const gpis_mapping::CameraModel& camera, const GroundTruth& truth,
                                                      int repeat) {
  std::shared_ptr<const gpis_mapping::MapSnapshot> before;
  for (int repetition = 0; repetition < repeat; ++repetition) {
    for (const auto& contender : contenders.all) contender->restart();
    for (std::size_t k = 0; k < frames.size(); ++k) {
      // Whoever comes first finds the caches as the last one left them: take turns.
      for (std::size_t i = 0; i < contenders.all.size(); ++i) {
        contenders.all[(i + k) % contenders.all.size()]->insert(k, frames[k], camera);
      }
      if (static_cast<int>(k) == truth.lastBefore()) before = contenders.ours->snapshot();
      if (repetition == 0) {
        for (const auto& contender : contenders.all) contender->judge(truth, static_cast<int>(k));
      }
    }
    std::fprintf(stderr, "run %d of %d done\n", repetition + 1, repeat);
  }
  return before;
}

int run(int argc, char** argv) {
  const std::optional<Options> options = parseCommandLine(argc, argv);
  if (!options) return 0;
  Scene scene = synthetic_depth::loadScene(options->scene_path);
  if (options->num_frames > 0 && options->num_frames < scene.numFrames()) {
    scene.T_scene_camera.resize(static_cast<std::size_t>(options->num_frames));
  }
  const gpis_mapping::GpisConfig config = gpis_mapping::loadGpisConfig(options->config_path);
  json report = {{"benchmark", "bench_map_vs_octomap"}, {"machine", machine()}, {"repeat", options->repeat}};
  std::fprintf(stderr, "rendering %d frames of %zu boxes ...\n", scene.numFrames(), scene.boxes.size());
  const std::vector<RecordedFrame> frames = experiments::record(scene);
  const GroundTruth truth(scene);
  report["scene"] = {{"boxes", scene.boxes.size()},
                     {"frames", scene.numFrames()},
                     {"removal_frame", truth.hasRemoval() ? truth.lastBefore() + 1 : -1},
                     {"removed_boxes", scene.removedIds().size()},
                     {"ghost_points", truth.numGhosts()},
                     {"width_px", scene.camera.width_px},
                     {"height_px", scene.camera.height_px}};
  const int threads = interactive_mapping::resolveThreadCount(config.threads);
  const Contenders contenders = makeContenders(*options, config, threads);
  const auto before = feed(contenders, frames, experiments::cameraOf(scene), truth, options->repeat);
  const double octomap_ms = contenders.octomap_2cm->medianMs();
  for (const auto& contender : contenders.all) {
    report["maps"][contender->key()] = contender->report();
    report["ratios"]["median_ms_over_octomap_2cm"][contender->key()] = contender->medianMs() / octomap_ms;
  }
  report["ratios"]["processor_gpis_to_octomap_2cm"] =
      contenders.ours->medianProcessorMs() / contenders.octomap_2cm->medianProcessorMs();
  report["ratios"]["gpis_to_octomap_2cm"] = contenders.ours->medianMs() / octomap_ms;
  report["mesh"] = measureMesh(config, *contenders.ours->snapshot());
  std::fprintf(stderr, "maps of 10 to 1000 m2 ...\n");
  report["growth"] = experiments::measureGrowth(config);

  std::vector<Band> bands(2);
  bands[0].name = "0 to 5 cm";
  truth.freePoints(0.0, 0.05, options->num_queries, 1, &bands[0].points, &bands[0].exact);
  bands[1].name = "5 to 30 cm";
  truth.freePoints(0.05, 0.30, options->num_queries, 2, &bands[1].points, &bands[1].exact);
  report["queries"] = measureQueries(*before, bands, threads);
  const octomap::OcTree& tree = contenders.octomap_2cm->tree();
  std::size_t occupied = 0;
  report["octomap_lookups_per_s"] = throughput(options->num_queries, [&] {
    for (Eigen::Index i = 0; i < options->num_queries; ++i) {
      const auto p = bands[0].points.col(i);
      const octomap::OcTreeNode* node = tree.search(p.x(), p.y(), p.z());
      occupied += node != nullptr && tree.isNodeOccupied(node);
    }
  });
  report["octomap_lookups_occupied"] = occupied;
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  report["peak_rss_mb"] = static_cast<double>(usage.ru_maxrss) / 1e3;

  if (options->out_path.empty()) {
    std::cout << report.dump(1) << "\n";
    return 0;
  }
  std::ofstream out(options->out_path);
  out << report.dump(1) << "\n";
  if (!out.flush()) throw std::runtime_error(options->out_path + ": cannot be written");
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const boost::program_options::error& error) {
    std::cerr << "bench_map_vs_octomap: " << error.what() << " (--help explains)\n";
    return 2;
  } catch (const std::exception& error) {
    std::cerr << "bench_map_vs_octomap: " << error.what() << "\n";
    return 1;
  }
}
