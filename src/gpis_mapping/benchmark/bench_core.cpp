// SPDX-License-Identifier: BSD-3-Clause
// The map's building blocks one by one, on an analytic world: a floor with a sphere on it. One thread throughout.
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include "gpis_mapping/cell_gp.h"
#include "gpis_mapping/depth_classifier.h"
#include "gpis_mapping/frame_map.h"
#include "gpis_mapping/gpis_config.h"
#include "gpis_mapping/gpis_map.h"
#include "gpis_mapping/map_io.h"
#include "gpis_mapping/mesh_extractor.h"
#include "gpis_mapping/partition_of_unity.h"

namespace gpis_mapping {
namespace {

GpisConfig oneThread() {
  GpisConfig config;
  config.threads = 1;
  return config;
}

CameraModel vgaCamera() {
  CameraModel camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = 525.0;
  camera.fy = 525.0;
  camera.cx = 319.5;
  camera.cy = 239.5;
  return camera;
}

/// Looks along x, 35 degrees down, from 1 m over the floor z = 0.
Eigen::Isometry3d cameraPose() {
  const double pitch = 35.0 * 3.14159265358979323846 / 180.0;
  Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
  const Eigen::Vector3d forward(std::cos(pitch), 0.0, -std::sin(pitch));
  const Eigen::Vector3d right(0.0, -1.0, 0.0);
  T_map_camera.linear().col(0) = right;
  T_map_camera.linear().col(1) = forward.cross(right);
  T_map_camera.linear().col(2) = forward;
  T_map_camera.translation() = Eigen::Vector3d(0.013, -0.021, 1.0);
  return T_map_camera;
}

/// Depth of the floor and a sphere of 30 cm, with the noise the default model expects.
DepthImage analyticImage() {
  const CameraModel camera = vgaCamera();
  const Eigen::Isometry3d T_map_camera = cameraPose();
  const Eigen::Vector3d eye = T_map_camera.translation();
  const Eigen::Vector3d center(1.5, 0.1, 0.25);
  const DepthNoiseModel noise;
  std::mt19937 engine(1);
  std::normal_distribution<double> normal;
  DepthImage image;
  image.width = camera.width;
  image.height = camera.height;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const Eigen::Vector3d ray =
          T_map_camera.linear() * Eigen::Vector3d((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
      double z = ray.z() < 0.0 ? -eye.z() / ray.z() : INFINITY;
      const double a = ray.squaredNorm();
      const double b = ray.dot(eye - center);
      const double root = b * b - a * ((eye - center).squaredNorm() - 0.3 * 0.3);
      if (root > 0.0) z = std::min(z, (-b - std::sqrt(root)) / a);
      if (z > 5.0) z = INFINITY;
      image.depth_m.push_back(static_cast<float>(std::isfinite(z) ? z + noise.sigma(z) * normal(engine) : z));
    }
  }
  return image;
}

/// The default map after one look.
const GpisMap& smallMap() {
  static const std::unique_ptr<GpisMap> map = [] {
    auto made = std::make_unique<GpisMap>(oneThread());
    made->update(analyticImage(), vgaCamera(), cameraPose(), 0.0);
    return made;
  }();
  return *map;
}

const MapSnapshot& smallSnapshot() {
  static const std::shared_ptr<const MapSnapshot> snapshot = smallMap().snapshot();
  return *snapshot;
}

/// `count` random points up to `reach_m` from training points of the small map.
Points3d pointsNearSurface(Eigen::Index count, double reach_m) {
  std::vector<Eigen::Vector3d> surface;
  for (const SurfacePoint& point : smallMap().contents().points) surface.push_back(point.position_map);
  std::mt19937 engine(2);
  std::uniform_int_distribution<std::size_t> pick(0, surface.size() - 1);
  std::uniform_real_distribution<double> offset(-reach_m, reach_m);
  Points3d points(3, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    points.col(i) = surface[pick(engine)] + Eigen::Vector3d(offset(engine), offset(engine), offset(engine));
  }
  return points;
}

/// `count` points on a wavy sheet through a cell and its margin.
std::vector<SurfacePoint> sheet(std::size_t count) {
  std::mt19937 engine(3);
  std::uniform_real_distribution<double> across(-0.03, 0.13);
  std::vector<SurfacePoint> points(count);
  for (SurfacePoint& point : points) {
    const double x = across(engine);
    const double y = across(engine);
    point.position_map = {x, y, 0.05 + 0.01 * std::sin(40.0 * x)};
    point.normal_map = Eigen::Vector3d(-0.4 * std::cos(40.0 * x), 0.0, 1.0).normalized().cast<float>();
    point.variance_m2 = 4e-6f;
    point.normal_variance = 1e-3f;
  }
  return points;
}

CellGp trainedCell(const std::vector<SurfacePoint>& points) {
  std::vector<const SurfacePoint*> pointers;
  for (const SurfacePoint& point : points) pointers.push_back(&point);
  return CellGp({0, 0, 0}, oneThread(), pointers, points.size() / 2, points.size());
}

void BM_CellGpTrain(benchmark::State& state) {
  const std::vector<SurfacePoint> points = sheet(static_cast<std::size_t>(state.range(0)));
  for (auto _ : state) benchmark::DoNotOptimize(trainedCell(points));
}
BENCHMARK(BM_CellGpTrain)->Arg(50)->Arg(100)->Arg(150)->Unit(benchmark::kMicrosecond);

void BM_CellGpMean(benchmark::State& state) {
  const CellGp gp = trainedCell(sheet(static_cast<std::size_t>(state.range(0))));
  double x = 0.0;
  for (auto _ : state) {
    x = x < 0.1 ? x + 0.001 : 0.0;
    benchmark::DoNotOptimize(gp.mean({x, 0.05, 0.055}));
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(BM_CellGpMean)->Arg(50)->Arg(100)->Arg(150);

/// 64 points at a time, as a query groups them.
void cellGpVariance(benchmark::State& state, bool with_gradient) {
  const CellGp gp = trainedCell(sheet(static_cast<std::size_t>(state.range(0))));
  const Points3d points = (0.05 * (Points3d::Random(3, 64).array() + 1.0)).matrix();
  Eigen::VectorXf variance;
  Points3f gradient;
  for (auto _ : state) {
    gp.variance(points, &variance, with_gradient ? &gradient : nullptr);
    benchmark::DoNotOptimize(variance.data());
  }
  state.SetItemsProcessed(state.iterations() * points.cols());
}
void BM_CellGpVariance(benchmark::State& state) {
  cellGpVariance(state, false);
}
BENCHMARK(BM_CellGpVariance)->Arg(50)->Arg(100)->Arg(150)->Unit(benchmark::kMicrosecond);
void BM_CellGpVarianceGradient(benchmark::State& state) {
  cellGpVariance(state, true);
}
BENCHMARK(BM_CellGpVarianceGradient)->Arg(50)->Arg(100)->Arg(150)->Unit(benchmark::kMicrosecond);

std::shared_ptr<const FrameRegressor> makeRegressor() {
  const GpisConfig config = oneThread();
  const double z = 0.5 * (config.sensor.min_range_m + config.sensor.max_range_m);
  return std::make_shared<FrameRegressor>(vgaCamera(), config.frame_map, config.sensor.noise.sigma(z) / (z * z));
}

void BM_FrameRegressor(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(makeRegressor());
}
BENCHMARK(BM_FrameRegressor)->Unit(benchmark::kMillisecond);

void BM_DepthClassifier(benchmark::State& state) {
  const DepthClassifier classifier(vgaCamera(), oneThread());
  const DepthImage image = analyticImage();
  for (auto _ : state) benchmark::DoNotOptimize(classifier.classify(image, 1));
}
BENCHMARK(BM_DepthClassifier)->Unit(benchmark::kMillisecond);

std::shared_ptr<const ClassifiedFrame> classifiedFrame() {
  return std::make_shared<ClassifiedFrame>(DepthClassifier(vgaCamera(), oneThread()).classify(analyticImage(), 1));
}

void BM_FrameMapCondition(benchmark::State& state) {
  const auto regressor = makeRegressor();
  const auto frame = classifiedFrame();
  for (auto _ : state) benchmark::DoNotOptimize(FrameMap(regressor, frame, DepthNoiseModel(), 1));
}
BENCHMARK(BM_FrameMapCondition)->Unit(benchmark::kMillisecond);

void BM_FrameMapInfer(benchmark::State& state) {
  const FrameMap map(makeRegressor(), classifiedFrame(), DepthNoiseModel(), 1);
  double u = 0.0;
  for (auto _ : state) {
    u = u < 630.0 ? u + 3.3 : 0.0;
    benchmark::DoNotOptimize(map.infer(u, 300.4));
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(BM_FrameMapInfer);

void BM_FitLocalPlane(benchmark::State& state) {
  const auto frame = classifiedFrame();
  const CameraModel camera = vgaCamera();
  const double spacing = oneThread().surface.spacing_m;
  LocalPlane plane;
  int u = 20;
  for (auto _ : state) {
    u = u < 600 ? u + 1 : 20;
    benchmark::DoNotOptimize(fitLocalPlane(*frame, camera, DepthNoiseModel(), u, 400, spacing, &plane));
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(BM_FitLocalPlane);

void BM_MapUpdateSameView(benchmark::State& state) {
  GpisMap map(oneThread());
  const DepthImage image = analyticImage();
  double stamp = 0.0;
  map.update(image, vgaCamera(), cameraPose(), stamp);
  for (auto _ : state) benchmark::DoNotOptimize(map.update(image, vgaCamera(), cameraPose(), stamp += 0.1));
}
BENCHMARK(BM_MapUpdateSameView)->Unit(benchmark::kMillisecond);

/// A map of a floor of that many m2, seen from its middle: what an update costs must not depend on what is out of view.
void BM_MapUpdateOfAreaM2(benchmark::State& state) {
  MapContents contents;
  contents.config = oneThread();
  const double spacing = contents.config.surface.spacing_m;
  const double half = 0.5 * std::sqrt(static_cast<double>(state.range(0)));
  for (double x = -half; x < half; x += spacing) {
    for (double y = -half; y < half; y += spacing) {
      SurfacePoint point;
      point.position_map = {x, y, 0.0};
      point.normal_map = {0.0f, 0.0f, 1.0f};
      point.variance_m2 = 1e-6f;
      point.normal_variance = 1e-3f;
      contents.points.push_back(point);
    }
  }
  GpisMap map(std::move(contents));
  Eigen::Isometry3d pose = cameraPose();
  pose.translation().x() -= 1.3;
  DepthImage image = analyticImage();
  double stamp = 0.0;
  for (int i = 0; i < 5; ++i) map.update(image, vgaCamera(), pose, stamp += 0.1);
  UpdateStatistics last;
  for (auto _ : state) last = map.update(image, vgaCamera(), pose, stamp += 0.1);
  state.counters["points"] = static_cast<double>(last.map_points);
  state.counters["cells_looked_at"] = static_cast<double>(last.cells_looked_at);
  state.counters["cells_copied"] = static_cast<double>(last.cells_copied);
}
BENCHMARK(BM_MapUpdateOfAreaM2)->Arg(10)->Arg(100)->Arg(1000)->Unit(benchmark::kMillisecond);

/// Argument: 0 distance and gradient, 1 and variance, 2 and its gradient.
void BM_SnapshotQuery(benchmark::State& state) {
  const MapSnapshot& snapshot = smallSnapshot();
  const Points3d points = pointsNearSurface(10000, 0.05);
  QueryOptions options;
  options.threads = 1;
  options.variance = state.range(0) > 0;
  options.variance_gradient = state.range(0) > 1;
  snapshot.query(points.leftCols(1), options);  // builds the index
  for (auto _ : state) benchmark::DoNotOptimize(snapshot.query(points, options));
  state.SetItemsProcessed(state.iterations() * points.cols());
}
BENCHMARK(BM_SnapshotQuery)->DenseRange(0, 2)->Unit(benchmark::kMillisecond);

void BM_SnapshotField(benchmark::State& state) {
  const MapSnapshot& snapshot = smallSnapshot();
  const Points3d points = pointsNearSurface(4096, 0.02);
  Eigen::Index i = 0;
  for (auto _ : state) {
    i = (i + 1) % points.cols();
    benchmark::DoNotOptimize(snapshot.field(points.col(i)));
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(BM_SnapshotField);

void BM_BlendWeights(benchmark::State& state) {
  const GpisConfig::Cells cells;
  const Points3d points = Points3d::Random(3, 1024);
  BlendWeight weights[8];
  Eigen::Index i = 0;
  for (auto _ : state) {
    i = (i + 1) % points.cols();
    benchmark::DoNotOptimize(blendWeights(points.col(i), cells, weights));
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(BM_BlendWeights);

/// A block of 3 x 3 x 3 cells round the floor under the camera's axis.
void BM_MeshOfCellBlock(benchmark::State& state) {
  const MapSnapshot& whole = smallSnapshot();
  const LatticeKey center = whole.config().cells.at({1.0, 0.35, 0.0});
  std::vector<CellPages::value_type> cells;
  for (const auto& [key, cell] : whole.cells()) {
    const bool is_near =
        std::abs(key.x - center.x) <= 1 && std::abs(key.y - center.y) <= 1 && std::abs(key.z - center.z) <= 1;
    if (is_near) cells.emplace_back(key, cell);
  }
  const MapSnapshot block(whole.config(), CellPages(cells), ObservedLayer(0.05), 0.0, 1);
  std::size_t triangles = 0;
  for (auto _ : state) {
    MeshExtractor extractor(whole.config());
    extractor.update(block);
    triangles = extractor.mesh().triangles.size();
  }
  state.counters["cells"] = static_cast<double>(cells.size());
  state.counters["triangles"] = static_cast<double>(triangles);
}
BENCHMARK(BM_MeshOfCellBlock)->Unit(benchmark::kMillisecond);

/// A file of its own in the folder for temporary files, removed at the end.
class TemporaryFile {
 public:
  TemporaryFile() {
    const char* folder = std::getenv("TMPDIR");
    path_ = std::string(folder != nullptr ? folder : "/tmp") + "/bench_core_" + std::to_string(getpid()) + ".gpis";
  }
  ~TemporaryFile() { std::remove(path_.c_str()); }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

void BM_SaveMap(benchmark::State& state) {
  const MapContents contents = smallMap().contents();
  const TemporaryFile file;
  for (auto _ : state) saveMap(contents, file.path());
  state.counters["points"] = static_cast<double>(contents.points.size());
}
BENCHMARK(BM_SaveMap)->Unit(benchmark::kMillisecond);

void BM_LoadMapAndTrain(benchmark::State& state) {
  const TemporaryFile file;
  saveMap(smallMap().contents(), file.path());
  for (auto _ : state) benchmark::DoNotOptimize(std::make_unique<GpisMap>(loadMap(file.path())));
}
BENCHMARK(BM_LoadMapAndTrain)->Unit(benchmark::kMillisecond);

void BM_LoadMapFile(benchmark::State& state) {
  const TemporaryFile file;
  saveMap(smallMap().contents(), file.path());
  for (auto _ : state) benchmark::DoNotOptimize(loadMap(file.path()));
}
BENCHMARK(BM_LoadMapFile)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace gpis_mapping
