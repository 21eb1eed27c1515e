// SPDX-License-Identifier: BSD-3-Clause
// Feeds one rendered sequence to GpisMap and to OctoMap, frame by frame in turn and in one process, and reports for both
// the time per frame, the memory and how good the map is.
#include <unistd.h>
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <unordered_map>
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
#include "octomap_baseline/dynamic_octomap.h"
#include "synthetic_depth/depth_renderer.h"
#include "synthetic_depth/scene_distance.h"
#include "synthetic_depth/scene_loader.h"
#include "synthetic_depth/seeded_random.h"
#include "synthetic_depth/sensor.h"

namespace {

namespace po = boost::program_options;

using gpis_mapping::LatticeKey;
using gpis_mapping::LatticeKeyHash;
using interactive_mapping::Stopwatch;
using nlohmann::json;
using synthetic_depth::Scene;

constexpr double kMaxRange_m = 3.5;
constexpr double kGhostClearance_m = 0.05;  // a ghost point is this far from everything that is still there
constexpr double kGhostReach_m = 0.02;      // a ghost point with surface this near is a ghost
constexpr double kFreeMargin_m = 0.01;      // a point is seen as free when the frame sees this far past it

/// Processor time of all threads, which other programs on the machine disturb less than they do the wall's.
double processorMs() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

double residentMb() {
  std::ifstream statm("/proc/self/statm");
  long total = 0;
  long resident = 0;
  statm >> total >> resident;
  return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1e6;
}

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  const double at = q * static_cast<double>(values.size() - 1);
  const std::size_t low = static_cast<std::size_t>(at);
  const std::size_t high = std::min(low + 1, values.size() - 1);
  return values[low] + (at - static_cast<double>(low)) * (values[high] - values[low]);
}

double median(const std::vector<double>& values) {
  return quantile(values, 0.5);
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

struct RecordedFrame {
  gpis_mapping::DepthImage image;
  octomap::Pointcloud cloud;  // map frame
  Eigen::Isometry3d T_map_camera;
  double stamp_s;
};

std::vector<RecordedFrame> record(const Scene& scene) {
  std::vector<RecordedFrame> frames;
  for (int k = 0; k < scene.numFrames(); ++k) {
    const cv::Mat depth = synthetic_depth::measureDepth(scene, k);
    RecordedFrame frame;
    frame.image.width = depth.cols;
    frame.image.height = depth.rows;
    frame.image.depth_m.assign(depth.ptr<float>(), depth.ptr<float>() + depth.total());
    frame.T_map_camera = scene.cameraInMap(k);
    frame.stamp_s = scene.stampSeconds(k);
    frame.cloud.reserve(depth.total());
    for (int v = 0; v < depth.rows; ++v) {
      for (int u = 0; u < depth.cols; ++u) {
        const double z = depth.at<float>(v, u);
        if (!std::isfinite(z)) continue;
        const Eigen::Vector3d p =
            frame.T_map_camera * (z * Eigen::Vector3d((u - scene.camera.cx_px) / scene.camera.fx_px,
                                                      (v - scene.camera.cy_px) / scene.camera.fy_px, 1.0));
        frame.cloud.push_back(static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()));
      }
    }
    frames.push_back(std::move(frame));
  }
  return frames;
}

/// Is there a point within a fixed reach?
class NeighbourGrid {
 public:
  NeighbourGrid(const std::vector<Eigen::Vector3d>& points, double reach_m) : reach_m_(reach_m) {
    for (const Eigen::Vector3d& p : points) cells_[LatticeKey::of(p, reach_m)].push_back(p);
  }
  bool hasNear(const Eigen::Vector3d& p) const {
    const LatticeKey key = LatticeKey::of(p, reach_m_);
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dz = -1; dz <= 1; ++dz) {
          const auto cell = cells_.find(key.offset(dx, dy, dz));
          if (cell == cells_.end()) continue;
          for (const Eigen::Vector3d& other : cell->second) {
            if ((other - p).squaredNorm() <= reach_m_ * reach_m_) return true;
          }
        }
      }
    }
    return false;
  }
  double coveredShare(const std::vector<Eigen::Vector3d>& targets) const {
    if (targets.empty()) return 0.0;
    std::size_t covered = 0;
    for (const Eigen::Vector3d& p : targets) covered += hasNear(p);
    return static_cast<double>(covered) / static_cast<double>(targets.size());
  }

 private:
  double reach_m_;
  std::unordered_map<LatticeKey, std::vector<Eigen::Vector3d>, LatticeKeyHash> cells_;
};

/// The surface a map claims: points on it, and points with their share of the area for the error.
struct ClaimedSurface {
  std::vector<Eigen::Vector3d> cover;
  std::vector<Eigen::Vector3d> samples;
  std::vector<double> weights;
};

ClaimedSurface surfaceOf(const gpis_mapping::TriangleMesh& mesh) {
  ClaimedSurface surface;
  surface.cover = mesh.vertices_map;
  for (const auto& triangle : mesh.triangles) {
    const Eigen::Vector3d& a = mesh.vertices_map[triangle[0]];
    const Eigen::Vector3d& b = mesh.vertices_map[triangle[1]];
    const Eigen::Vector3d& c = mesh.vertices_map[triangle[2]];
    const Eigen::Vector3d center = (a + b + c) / 3.0;
    for (const Eigen::Vector3d& p :
         {center, Eigen::Vector3d((a + b) / 2.0), Eigen::Vector3d((b + c) / 2.0), Eigen::Vector3d((c + a) / 2.0)}) {
      surface.cover.push_back(p);
    }
    surface.samples.push_back(center);
    surface.weights.push_back(0.5 * (b - a).cross(c - a).norm());
  }
  return surface;
}

ClaimedSurface surfaceOf(const octomap::OcTree& tree) {
  ClaimedSurface surface;
  const double resolution = tree.getResolution();
  for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
    if (!tree.isNodeOccupied(*leaf)) continue;
    // A pruned leaf stands for many voxels.
    const int across = static_cast<int>(std::lround(leaf.getSize() / resolution));
    const double first = 0.5 * (resolution - leaf.getSize());
    for (int x = 0; x < across; ++x) {
      for (int y = 0; y < across; ++y) {
        for (int z = 0; z < across; ++z) {
          surface.cover.emplace_back(leaf.getX() + first + x * resolution, leaf.getY() + first + y * resolution,
                                     leaf.getZ() + first + z * resolution);
        }
      }
    }
  }
  surface.samples = surface.cover;
  surface.weights.assign(surface.samples.size(), 1.0);
  return surface;
}

/// What the exact scene says, for the frame before the removal and the first one after it.
class GroundTruth {
 public:
  explicit GroundTruth(const Scene& scene)
      : scene_(scene), last_before_(std::min(scene.firstRemovalFrame(), scene.numFrames()) - 1) {
    for (int k = 0; k < scene.numFrames(); ++k) views_.emplace_back(scene, k, scene.T_scene_camera[k]);
    visible_before_ = visibleInRoi(last_before_);
    if (!hasRemoval()) return;
    visible_after_ = visibleInRoi(last_before_ + 1);
    const synthetic_depth::SurfaceSamples seen = synthetic_depth::visibleSurfaceSamples(scene, 0, last_before_, 0.01);
    const std::vector<int> removed = scene.removedIds();
    const Eigen::VectorXd left = synthetic_depth::signedDistance(scene, last_before_ + 1, seen.points_map);
    for (Eigen::Index i = 0; i < seen.points_map.cols(); ++i) {
      const bool is_removed = std::binary_search(removed.begin(), removed.end(), seen.ids[static_cast<std::size_t>(i)]);
      const Eigen::Vector3d p = seen.points_map.col(i);
      if (is_removed && left[i] > kGhostClearance_m && seenFree(p, last_before_ + 1)) ghosts_.push_back(p);
    }
  }

  bool hasRemoval() const { return last_before_ + 1 < scene_.numFrames(); }
  int lastBefore() const { return last_before_; }
  std::size_t numGhosts() const { return ghosts_.size(); }

  double ghostShare(const ClaimedSurface& surface) const {
    return NeighbourGrid(surface.cover, kGhostReach_m).coveredShare(ghosts_);
  }

  json quality(const ClaimedSurface& surface, bool after) const {
    const int frame = last_before_ + (after ? 1 : 0);
    Eigen::Matrix3Xd points(3, static_cast<Eigen::Index>(surface.samples.size()));
    std::vector<double> weights;
    for (std::size_t i = 0; i < surface.samples.size(); ++i) {
      if (!inRoi(surface.samples[i])) continue;
      points.col(static_cast<Eigen::Index>(weights.size())) = surface.samples[i];
      weights.push_back(surface.weights[i]);
    }
    points.conservativeResize(3, static_cast<Eigen::Index>(weights.size()));
    const Eigen::VectorXd exact = synthetic_depth::signedDistance(scene_, frame, points);
    double sum = 0.0;
    double squares = 0.0;
    double beyond = 0.0;
    for (std::size_t i = 0; i < weights.size(); ++i) {
      const double error = exact[static_cast<Eigen::Index>(i)];
      sum += weights[i];
      squares += weights[i] * error * error;
      if (std::abs(error) > 0.02) beyond += weights[i];
    }
    const std::vector<Eigen::Vector3d>& targets = after ? visible_after_ : visible_before_;
    return {{"rmse_mm", sum > 0.0 ? 1e3 * std::sqrt(squares / sum) : 0.0},
            {"share_off_by_2cm", sum > 0.0 ? beyond / sum : 0.0},
            {"complete_1cm", NeighbourGrid(surface.cover, 0.01).coveredShare(targets)},
            {"complete_2cm", NeighbourGrid(surface.cover, 0.02).coveredShare(targets)}};
  }

  /// Random points with exact distance in (low, high], in space that some frame up to lastBefore() saw as free.
  void freePoints(double low_m, double high_m, Eigen::Index count, std::uint64_t seed, Eigen::Matrix3Xd* points,
                  Eigen::VectorXd* exact) const {
    const synthetic_depth::SceneDistance distance(scene_, last_before_);
    const Eigen::Isometry3d T_scene_map = scene_.T_map_scene.inverse();
    synthetic_depth::SeededRandom random(seed);
    points->resize(3, count);
    exact->resize(count);
    for (Eigen::Index found = 0; found < count;) {
      const auto pick = static_cast<std::size_t>(random.uniform() * static_cast<double>(visible_before_.size()));
      Eigen::Vector3d direction(random.normal(), random.normal(), random.normal());
      const Eigen::Vector3d p = visible_before_[std::min(pick, visible_before_.size() - 1)] +
                                direction.normalized() * random.uniform(low_m, high_m);
      const double d = distance.signedDistanceScene(T_scene_map * p);
      if (d <= low_m || d > high_m || !inRoi(p)) continue;
      bool is_free = false;
      for (int k = 0; k <= last_before_ && !is_free; ++k) is_free = seenFree(p, k);
      if (!is_free) continue;
      points->col(found) = p;
      (*exact)[found++] = d;
    }
  }

 private:
  bool inRoi(const Eigen::Vector3d& p_map) const {
    const Eigen::Vector3d p = scene_.T_map_scene.inverse() * p_map;
    return (p.array() >= scene_.roi.min_m.array()).all() && (p.array() <= scene_.roi.max_m.array()).all();
  }

  bool seenFree(const Eigen::Vector3d& p_map, int frame) const {
    const Eigen::Vector3d p = scene_.cameraInMap(frame).inverse() * p_map;
    if (p.z() < scene_.sensor.min_range_m) return false;
    const double u = scene_.camera.fx_px * p.x() / p.z() + scene_.camera.cx_px;
    const double v = scene_.camera.fy_px * p.y() / p.z() + scene_.camera.cy_px;
    if (u < 0.0 || v < 0.0 || u > scene_.camera.width_px - 1.0 || v > scene_.camera.height_px - 1.0) return false;
    // The pixels around it, all of them: one that mixes in another surface is no proof.
    for (const double pu : {std::floor(u), std::ceil(u)}) {
      for (const double pv : {std::floor(v), std::ceil(v)}) {
        if (views_[static_cast<std::size_t>(frame)].cast(pu, pv).z_m < p.z() + kFreeMargin_m) return false;
      }
    }
    return true;
  }

  std::vector<Eigen::Vector3d> visibleInRoi(int frame) const {
    const synthetic_depth::SurfaceSamples samples = synthetic_depth::visibleSurfaceSamples(scene_, 0, frame, 0.02);
    std::vector<Eigen::Vector3d> points;
    for (Eigen::Index i = 0; i < samples.points_map.cols(); ++i) {
      if (inRoi(samples.points_map.col(i))) points.emplace_back(samples.points_map.col(i));
    }
    return points;
  }

  Scene scene_;
  int last_before_;
  std::vector<synthetic_depth::ViewCaster> views_;
  std::vector<Eigen::Vector3d> visible_before_;
  std::vector<Eigen::Vector3d> visible_after_;
  std::vector<Eigen::Vector3d> ghosts_;
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
  static octomap::point3d toOctomap(const Eigen::Vector3d& p) {
    return {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())};
  }

  double take(std::size_t, const RecordedFrame& frame, const gpis_mapping::CameraModel&) override {
    const octomap::point3d origin = toOctomap(frame.T_map_camera.translation());
    Stopwatch watch;
    tree_->insertPointCloud(frame.cloud, origin, kMaxRange_m, false, !options_.every_ray);
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
  snapshot.query(bands.front().points.leftCols(1), distance_only);
  result["first_query_ms"] = watch.lapMs();  // builds the nearest-point index
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

void printRow(const char* name, const json& summary) {
  std::printf("  %-26s %8.2f %8.2f %8.2f %8.2f\n", name, summary["median"].get<double>(), summary["p95"].get<double>(),
              summary["max"].get<double>(), summary["first"].get<double>());
}

void printReport(const json& report) {
  const json& maps = report["maps"];
  std::printf("\nms per frame                   median      p95      max    first\n");
  for (const auto& [key, map] : maps.items()) {
    printRow(map["title"].get<std::string>().c_str(), map["total_ms"]);
    printRow("  processor time", map["processor_ms"]);
    if (!map.contains("stages_ms")) continue;
    for (const char* stage : {"classify", "regress", "fuse", "observe", "insert", "train", "publish"}) {
      printRow((std::string("  ") + stage).c_str(), map["stages_ms"][stage]);
    }
    if (map.contains("mesh_incremental_ms")) printRow("  (mesh, changed cells)", map["mesh_incremental_ms"]);
  }
  std::printf(
      "\n                                 map MB  RSS MB  rmse mm  complete 1cm  2cm    after removal: 2cm  ghosts\n");
  for (const auto& [key, map] : maps.items()) {
    std::printf("  %-28s %8.1f %7.0f", map["title"].get<std::string>().c_str(), map["map_mb"].get<double>(),
                map["rss_growth_mb"].get<double>());
    if (map.contains("before_removal")) {
      const json& q = map["before_removal"];
      std::printf(" %8.1f %13.3f %.3f", q["rmse_mm"].get<double>(), q["complete_1cm"].get<double>(),
                  q["complete_2cm"].get<double>());
    }
    if (map.contains("after_removal")) {
      const json& q = map["after_removal"];
      std::printf(" %20.3f %7.3f", q["complete_2cm"].get<double>(), q["ghost_share"].get<double>());
    }
    std::printf("\n");
  }
  std::printf("\nour time over that of OctoMap 2 cm: %.2f; processor time: %.2f\n",
              report["ratios"]["gpis_to_octomap_2cm"].get<double>(),
              report["ratios"]["processor_gpis_to_octomap_2cm"].get<double>());
  std::printf("whole mesh, from nothing: %.0f ms, %zu triangles\n", report["mesh"]["full_ms"].get<double>(),
              report["mesh"]["triangles"].get<std::size_t>());
  std::printf("\nqueries per s; the first one builds an index: %.1f ms\n",
              report["queries"]["first_query_ms"].get<double>());
  for (const auto& [name, band] : report["queries"]["bands"].items()) {
    std::printf("  %s: mean error %.1f mm, %.3f answered\n", name.c_str(), band["mean_abs_error_mm"].get<double>(),
                band["answered_share"].get<double>());
    for (const auto& [key, value] : band.items()) {
      if (key.find("_per_s") != std::string::npos) std::printf("    %-38s %10.0f\n", key.c_str(), value.get<double>());
    }
  }
  std::printf("  OctoMap occupancy look-ups, one thread %12.0f\n", report["octomap_lookups_per_s"].get<double>());
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
    ("out,o", po::value(&wanted.out_path), "JSON file to write")
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
  const std::vector<RecordedFrame> frames = record(scene);
  const GroundTruth truth(scene);
  const auto& c = scene.camera;
  report["scene"] = {{"boxes", scene.boxes.size()},
                     {"frames", scene.numFrames()},
                     {"removal_frame", truth.hasRemoval() ? truth.lastBefore() + 1 : -1},
                     {"removed_boxes", scene.removedIds().size()},
                     {"ghost_points", truth.numGhosts()},
                     {"width_px", c.width_px},
                     {"height_px", c.height_px}};
  const gpis_mapping::CameraModel camera{c.width_px, c.height_px, c.fx_px, c.fy_px, c.cx_px, c.cy_px};

  const int threads = interactive_mapping::resolveThreadCount(config.threads);
  const Contenders contenders = makeContenders(*options, config, threads);
  std::shared_ptr<const gpis_mapping::MapSnapshot> before;  // what the exact distances belong to
  for (int repetition = 0; repetition < options->repeat; ++repetition) {
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
    std::fprintf(stderr, "run %d of %d done\n", repetition + 1, options->repeat);
  }

  const double octomap_ms = contenders.octomap_2cm->medianMs();
  for (const auto& contender : contenders.all) {
    report["maps"][contender->key()] = contender->report();
    report["ratios"]["median_ms_over_octomap_2cm"][contender->key()] = contender->medianMs() / octomap_ms;
  }
  report["ratios"]["processor_gpis_to_octomap_2cm"] =
      contenders.ours->medianProcessorMs() / contenders.octomap_2cm->medianProcessorMs();
  report["ratios"]["gpis_to_octomap_2cm"] = contenders.ours->medianMs() / octomap_ms;
  report["mesh"] = measureMesh(config, *contenders.ours->snapshot());

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

  printReport(report);
  if (!options->out_path.empty()) {
    std::ofstream out(options->out_path);
    out << report.dump(1) << "\n";
    if (!out.flush()) throw std::runtime_error(options->out_path + ": cannot be written");
  }
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
