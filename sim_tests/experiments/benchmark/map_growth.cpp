// SPDX-License-Identifier: BSD-3-Clause
#include "map_growth.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <utility>
#include <vector>

#include <octomap/OcTree.h>
#include <octomap/octomap.h>

#include <interactive_mapping_common/stopwatch.h>
#include "gpis_mapping/gpis_map.h"
#include "measuring.h"
#include "recorded_frame.h"
#include "synthetic_depth/scene_distance.h"

namespace experiments {
namespace {

using gpis_mapping::GpisConfig;
using gpis_mapping::GpisMap;
using nlohmann::json;

constexpr double kTileArea_m2 = 10.0;
constexpr int kTiles[] = {1, 3, 10, 30, 100};
constexpr int kUpdates = 20;         // measured, after a first one that fits the map to the view
constexpr double kFreeFrom_m = 0.2;  // above the bricks all was seen free ...
constexpr double kFreeTo_m = 1.6;    // ... up to a camera's height

/// Floor with nine bricks, and a camera that sees a part of it again and again.
synthetic_depth::Scene makeTile() {
  synthetic_depth::Scene scene;
  const double side_m = std::sqrt(kTileArea_m2);
  for (int i = 0; i < 9; ++i) {
    synthetic_depth::Box brick;
    brick.id = i;
    brick.half_extents_m = {0.15, 0.075, 0.05};
    brick.T_scene_box.translation() = Eigen::Vector3d(i % 3 - 1, i / 3 - 1, 0.15) * side_m / 3.0;
    brick.T_scene_box.translation().z() = brick.half_extents_m.z();
    brick.T_scene_box.rotate(Eigen::AngleAxisd(0.3 * i, Eigen::Vector3d::UnitZ()));
    scene.boxes.push_back(brick);
  }
  scene.roi.min_m = Eigen::Vector3d(-0.5 * side_m, -0.5 * side_m, -0.05);
  scene.roi.max_m = Eigen::Vector3d(0.5 * side_m, 0.5 * side_m, 1.0);
  // Nothing outside of the tile is in view.
  scene.T_scene_camera.assign(1 + kUpdates, synthetic_depth::lookAt({0.05, -0.9, 1.0}, {0.0, 0.0, 0.0}));
  scene.sensor.min_range_m = 0.3;
  scene.sensor.max_range_m = 3.5;
  scene.sensor.axial_noise_c_per_m = 0.0015;
  return scene;
}

/// Where the tiles lie, from the middle outwards, scene frame [m].
std::vector<Eigen::Vector3d> tilePlaces(int count) {
  std::vector<Eigen::Vector2i> places;
  for (int x = -10; x <= 10; ++x) {
    for (int y = -10; y <= 10; ++y) places.emplace_back(x, y);
  }
  std::stable_sort(places.begin(), places.end(), [](const Eigen::Vector2i& a, const Eigen::Vector2i& b) {
    return a.squaredNorm() < b.squaredNorm();
  });
  std::vector<Eigen::Vector3d> result;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector2d shift_m = places[static_cast<std::size_t>(i)].cast<double>() * std::sqrt(kTileArea_m2);
    result.emplace_back(shift_m.x(), shift_m.y(), 0.0);
  }
  return result;
}

gpis_mapping::MapContents makeContents(const GpisConfig& config, const synthetic_depth::Scene& tile, int tiles) {
  gpis_mapping::MapContents contents;
  contents.config = config;
  contents.observed = gpis_mapping::ObservedLayer(config.observed.block_size_m);
  const synthetic_depth::SurfaceSamples samples =
      synthetic_depth::exposedSurfaceSamples(tile, 0, config.surface.spacing_m);
  const double step_m = config.observed.block_size_m;
  for (const Eigen::Vector3d& place : tilePlaces(tiles)) {
    const Eigen::Vector3d shift = tile.T_map_scene.linear() * place;
    for (Eigen::Index i = 0; i < samples.points_map.cols(); ++i) {
      gpis_mapping::SurfacePoint point;
      point.position_map = samples.points_map.col(i) + shift;
      point.normal_map = samples.normals_map.col(i).cast<float>();
      point.variance_m2 = 1e-6f;  // 1 mm and 1.1 degrees: what well seen points have
      point.normal_variance = 4e-4f;
      contents.points.push_back(point);
    }
    for (double x = tile.roi.min_m.x(); x < tile.roi.max_m.x(); x += step_m) {
      for (double y = tile.roi.min_m.y(); y < tile.roi.max_m.y(); y += step_m) {
        for (double z = kFreeFrom_m; z < kFreeTo_m; z += step_m) {
          contents.observed.setFree(tile.T_map_scene * (place + Eigen::Vector3d(x, y, z)), 0.0f);
        }
      }
    }
  }
  return contents;
}

/// Of one size: the map, OctoMap, and what their updates took.
struct Grown {
  Grown(const GpisConfig& config, const synthetic_depth::Scene& tile, int tiles) : area_m2(tiles * kTileArea_m2) {
    gpis_mapping::MapContents contents = makeContents(config, tile, tiles);
    points = contents.points.size();
    for (const gpis_mapping::SurfacePoint& point : contents.points)
      octomap.updateNode(toOctomap(point.position_map), true);
    map = std::make_unique<GpisMap>(std::move(contents));
  }

  void take(const RecordedFrame& frame, const gpis_mapping::CameraModel& camera, bool is_first) {
    const double processor_before_ms = processorMs();
    interactive_mapping::Stopwatch watch;
    map->update(frame.image, camera, frame.T_map_camera, frame.stamp_s);
    const double ms = watch.lapMs();
    const double processor_between_ms = processorMs();
    octomap.insertPointCloud(frame.cloud, toOctomap(frame.T_map_camera.translation()), kMaxRange_m, false, true);
    const double processor_after_ms = processorMs();
    settleHeap();
    if (is_first) return;
    update_ms.push_back(ms);
    processor_ms.push_back(processor_between_ms - processor_before_ms);
    octomap_ms.push_back(processor_after_ms - processor_between_ms);
  }

  double area_m2;
  std::size_t points;
  std::unique_ptr<GpisMap> map;
  octomap::OcTree octomap{0.02};
  std::vector<double> update_ms;
  std::vector<double> processor_ms;
  std::vector<double> octomap_ms;
};

}  // namespace

json measureGrowth(GpisConfig config) {
  config.region = GpisConfig::Region();
  const synthetic_depth::Scene tile = makeTile();
  const std::vector<RecordedFrame> frames = record(tile);
  std::vector<std::unique_ptr<Grown>> sizes;
  for (const int tiles : kTiles) sizes.push_back(std::make_unique<Grown>(config, tile, tiles));
  for (std::size_t k = 0; k < frames.size(); ++k) {
    // In turn, so that what else the machine does meets all sizes alike.
    for (std::size_t i = 0; i < sizes.size(); ++i) {
      sizes[(i + k) % sizes.size()]->take(frames[k], cameraOf(tile), k == 0);
    }
  }
  json result;
  for (const auto& size : sizes) {
    result["maps"].push_back({{"area_m2", size->area_m2},
                              {"points", size->points},
                              {"map_mb", static_cast<double>(size->map->snapshot()->memoryBytes()) / 1e6},
                              {"update_ms", median(size->update_ms)},
                              {"processor_ms", median(size->processor_ms)},
                              {"octomap_processor_ms", median(size->octomap_ms)}});
  }
  const json& smallest = result["maps"].front();
  const json& largest = result["maps"].back();
  for (const char* what : {"update_ms", "processor_ms", "octomap_processor_ms"}) {
    result["ratio"][what] = largest[what].get<double>() / smallest[what].get<double>();
  }
  return result;
}

}  // namespace experiments
