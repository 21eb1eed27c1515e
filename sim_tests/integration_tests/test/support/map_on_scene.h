// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include <Eigen/Geometry>
#include <opencv2/core.hpp>

#include "gpis_mapping/gpis_map.h"
#include "gpis_mapping/mesh_extractor.h"
#include "synthetic_depth/depth_renderer.h"
#include "synthetic_depth/scene.h"
#include "synthetic_depth/scene_distance.h"
#include "synthetic_depth/scene_loader.h"
#include "synthetic_depth/seeded_random.h"
#include "synthetic_depth/sensor.h"
#include "synthetic_depth/testing/random_scene.h"

namespace synthetic_depth {
namespace test {

using gpis_mapping::DepthImage;
using gpis_mapping::GpisConfig;
using gpis_mapping::GpisMap;
using gpis_mapping::MapSnapshot;
using gpis_mapping::QueryResult;
using gpis_mapping::SpaceState;
using gpis_mapping::SurfacePoint;
using gpis_mapping::TriangleMesh;
using gpis_mapping::UpdateStatistics;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// 320 x 240 px with the field of view of the 640 x 480 camera: a quarter of the time, half the resolution.
inline CameraModel smallCamera() {
  return {320, 240, 262.5, 262.5, 159.5, 119.5};
}

/// A shipped scene seen with smallCamera().
inline Scene loadSmallScene(const std::string& name) {
  Scene scene = loadScene(std::string(SYNTHETIC_DEPTH_SCENES) + "/" + name + ".yaml");
  scene.camera = smallCamera();
  return scene;
}

/// Static scene in the default map frame with one frame per eye, all looking at `target`; no noise, 0.25 m to 4 m.
inline Scene makeLooks(const std::vector<Eigen::Vector3d>& eyes, const Eigen::Vector3d& target) {
  Scene scene;
  scene.camera = smallCamera();
  for (const Eigen::Vector3d& eye : eyes) scene.T_scene_camera.push_back(lookAt(eye, target));
  scene.sensor.min_range_m = 0.25;
  scene.sensor.max_range_m = 4.0;
  return scene;
}

/// sigma_z = 0.5 mm + 1.5 mm/m^2 z^2, that of the shipped scenes.
inline void addAxialNoise(Scene* scene) {
  scene->sensor.axial_noise_a_m = 0.0005;
  scene->sensor.axial_noise_c_per_m = 0.0015;
}

inline gpis_mapping::CameraModel mapCamera(const Scene& scene) {
  const CameraModel& c = scene.camera;
  return {c.width_px, c.height_px, c.fx_px, c.fy_px, c.cx_px, c.cy_px};
}

/// The map's defaults with the scene's sensor and one thread.
inline GpisConfig mapConfig(const Scene& scene) {
  GpisConfig config;
  config.threads = 1;
  const SensorModel& sensor = scene.sensor;
  if (sensor.min_range_m > 0.0) config.sensor.min_range_m = sensor.min_range_m;
  if (std::isfinite(sensor.max_range_m)) config.sensor.max_range_m = sensor.max_range_m;
  if (sensor.baseline_m > 0.0) config.sensor.baseline_m = sensor.baseline_m;
  if (sensor.axial_noise_a_m > 0.0) {
    config.sensor.noise = {sensor.axial_noise_a_m, sensor.axial_noise_b, sensor.axial_noise_c_per_m};
  }
  return config;
}

/// From a 32FC1 image of metres, as it is.
inline DepthImage toDepthImage(const cv::Mat& depth_m) {
  DepthImage image{depth_m.cols, depth_m.rows, {}};
  for (int v = 0; v < depth_m.rows; ++v) {
    image.depth_m.insert(image.depth_m.end(), depth_m.ptr<float>(v), depth_m.ptr<float>(v) + depth_m.cols);
  }
  return image;
}

/// The way a 16UC1 driver in millimetres would deliver it: 0 for everything that is no depth.
inline DepthImage toDepthImage16(const cv::Mat& depth_m) {
  const cv::Mat units = encodeDepth16(depth_m, 1000.0);
  return depth_camera::depthImageFromU16(units.ptr<std::uint16_t>(), units.cols, units.rows, 1000.0);
}

/// Every pixel the same.
inline DepthImage constantImage(const Scene& scene, float depth_m) {
  const std::size_t size = static_cast<std::size_t>(scene.camera.width_px) * scene.camera.height_px;
  return {scene.camera.width_px, scene.camera.height_px, std::vector<float>(size, depth_m)};
}

/// Feeds one image as frame `frame` of the scene.
inline UpdateStatistics feed(GpisMap* map, const Scene& scene, int frame, const DepthImage& image) {
  return map->update(image, mapCamera(scene), scene.cameraInMap(frame), scene.stampSeconds(frame));
}

/// Feeds frames [first, last] as measured by the scene's sensor, in metres. Returns the last update's statistics.
inline UpdateStatistics feedFrames(GpisMap* map, const Scene& scene, int first, int last) {
  UpdateStatistics statistics;
  for (int frame = first; frame <= last; ++frame) {
    statistics = feed(map, scene, frame, toDepthImage(measureDepth(scene, frame)));
  }
  return statistics;
}

inline bool lexicographicallyLess(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
}

/// All points, sorted by position.
inline std::vector<SurfacePoint> pointsOf(const GpisMap& map) {
  std::vector<SurfacePoint> points = map.contents().points;
  std::sort(points.begin(), points.end(), [](const SurfacePoint& a, const SurfacePoint& b) {
    return lexicographicallyLess(a.position_map, b.position_map);
  });
  return points;
}

inline bool isIdentical(const SurfacePoint& a, const SurfacePoint& b) {
  return a.position_map == b.position_map && a.normal_map == b.normal_map && a.variance_m2 == b.variance_m2 &&
         a.normal_variance == b.normal_variance && a.last_seen_s == b.last_seen_s && a.num_looks == b.num_looks &&
         a.num_misses == b.num_misses;
}

inline bool areIdentical(const std::vector<SurfacePoint>& a, const std::vector<SurfacePoint>& b) {
  return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(), isIdentical);
}

/// Whether `points` (sorted, from pointsOf) has `point` bit for bit.
inline bool holds(const std::vector<SurfacePoint>& points, const SurfacePoint& point) {
  auto found = std::lower_bound(points.begin(), points.end(), point, [](const SurfacePoint& a, const SurfacePoint& b) {
    return lexicographicallyLess(a.position_map, b.position_map);
  });
  for (; found != points.end() && found->position_map == point.position_map; ++found) {
    if (isIdentical(*found, point)) return true;
  }
  return false;
}

/// Where a point of the map appears in an image.
struct Pixel {
  double u{0.0};
  double v{0.0};
  double z_m{0.0};
  bool inside{false};  // before the camera and at least `margin_px` inside the image

  int column() const { return static_cast<int>(std::lround(u)); }
  int row() const { return static_cast<int>(std::lround(v)); }
};

inline Pixel project(const Scene& scene, int frame, const Eigen::Vector3d& p_map, double margin_px = 0.0) {
  const Eigen::Vector3d p = scene.cameraInMap(frame).inverse() * p_map;
  const CameraModel& c = scene.camera;
  Pixel pixel{c.fx_px * p.x() / p.z() + c.cx_px, c.fy_px * p.y() / p.z() + c.cy_px, p.z(), false};
  pixel.inside = p.z() > 0.06 && pixel.u >= margin_px && pixel.v >= margin_px &&
                 pixel.u <= c.width_px - 1 - margin_px && pixel.v <= c.height_px - 1 - margin_px;
  return pixel;
}

/// Whether any pixel within `radius_px` of (u, v) satisfies the predicate on its depth.
template <typename Predicate>
bool anyPixelNear(const DepthImage& image, const Pixel& pixel, double radius_px, Predicate predicate) {
  const int u0 = std::max(0, static_cast<int>(std::ceil(pixel.u - radius_px)));
  const int u1 = std::min(image.width - 1, static_cast<int>(std::floor(pixel.u + radius_px)));
  const int v0 = std::max(0, static_cast<int>(std::ceil(pixel.v - radius_px)));
  const int v1 = std::min(image.height - 1, static_cast<int>(std::floor(pixel.v + radius_px)));
  for (int v = v0; v <= v1; ++v) {
    for (int u = u0; u <= u1; ++u) {
      const bool is_near = std::hypot(u - pixel.u, v - pixel.v) <= radius_px;
      if (is_near && predicate(image.at(u, v))) return true;
    }
  }
  return false;
}

/// Signed distance to one box alone, negative inside.
inline double boxDistance(const Scene& scene, const Box& box, const Eigen::Vector3d& p_map) {
  const Eigen::Vector3d p = (scene.T_map_scene * box.T_scene_box).inverse() * p_map;
  const Eigen::Vector3d q = p.cwiseAbs() - box.half_extents_m;
  return q.cwiseMax(0.0).norm() + std::min(0.0, q.maxCoeff());
}

inline double distanceAt(const SceneDistance& truth, const Eigen::Vector3d& p_map) {
  return truth.signedDistance(Eigen::Matrix3Xd(p_map))[0];
}

inline TriangleMesh meshOf(const MapSnapshot& snapshot) {
  gpis_mapping::MeshExtractor extractor(snapshot.config());
  extractor.update(snapshot);
  return extractor.mesh();
}

inline Eigen::Matrix3Xd asMatrix(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Matrix3Xd matrix(3, static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) matrix.col(static_cast<Eigen::Index>(i)) = points[i];
  return matrix;
}

/// Absolute values of errors, sorted; NaN are counted apart.
class Errors {
 public:
  template <typename Values>
  explicit Errors(const Values& values) {
    for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(values.size()); ++i) {
      const double value = values[i];
      if (std::isnan(value)) {
        ++num_nan_;
      } else {
        sorted_.push_back(std::abs(value));
      }
    }
    std::sort(sorted_.begin(), sorted_.end());
  }

  std::size_t size() const { return sorted_.size(); }
  std::size_t numNan() const { return num_nan_; }
  double mean() const {
    double sum = 0.0;
    for (const double e : sorted_) sum += e;
    return sorted_.empty() ? 0.0 : sum / static_cast<double>(sorted_.size());
  }
  double rms() const {
    double sum = 0.0;
    for (const double e : sorted_) sum += e * e;
    return sorted_.empty() ? 0.0 : std::sqrt(sum / static_cast<double>(sorted_.size()));
  }
  double max() const { return sorted_.empty() ? 0.0 : sorted_.back(); }
  /// Smallest value that `share` of the errors do not exceed.
  double quantile(double share) const {
    if (sorted_.empty()) return 0.0;
    return sorted_[std::min(sorted_.size() - 1, static_cast<std::size_t>(share * static_cast<double>(sorted_.size())))];
  }
  double shareAbove(double limit) const {
    if (sorted_.empty()) return 0.0;
    const auto above = sorted_.end() - std::upper_bound(sorted_.begin(), sorted_.end(), limit);
    return static_cast<double>(above) / static_cast<double>(sorted_.size());
  }

 private:
  std::vector<double> sorted_;
  std::size_t num_nan_{0};
};

/// Distance of each mesh vertex from the true surface of a frame.
inline Errors meshErrors(const TriangleMesh& mesh, const Scene& scene, int frame) {
  return Errors(SceneDistance(scene, frame).signedDistance(asMatrix(mesh.vertices_map)));
}

/// Distance of each training point from the true surface of a frame.
inline Errors pointErrors(const std::vector<SurfacePoint>& points, const Scene& scene, int frame) {
  std::vector<Eigen::Vector3d> positions;
  for (const SurfacePoint& point : points) positions.push_back(point.position_map);
  return Errors(SceneDistance(scene, frame).signedDistance(asMatrix(positions)));
}

/// Distance from each sample to the nearest mesh vertex, cut off at `reach_m`. Vertices of marching cubes are at most
/// a voxel apart, so on a meshed surface this is below the voxel's edge (14 mm by default).
inline Eigen::VectorXd distancesToMesh(const Eigen::Matrix3Xd& samples_map, const TriangleMesh& mesh, double reach_m) {
  using gpis_mapping::LatticeKey;
  std::unordered_map<LatticeKey, std::vector<Eigen::Vector3d>, gpis_mapping::LatticeKeyHash> grid;
  for (const Eigen::Vector3d& p : mesh.vertices_map) grid[LatticeKey::of(p, reach_m)].push_back(p);
  Eigen::VectorXd nearest = Eigen::VectorXd::Constant(samples_map.cols(), reach_m);
  for (Eigen::Index i = 0; i < samples_map.cols(); ++i) {
    const LatticeKey center = LatticeKey::of(samples_map.col(i), reach_m);
    for (int d = 0; d < 27; ++d) {
      const auto found = grid.find(center.offset(d % 3 - 1, d / 3 % 3 - 1, d / 9 - 1));
      if (found == grid.end()) continue;
      for (const Eigen::Vector3d& p : found->second) {
        nearest[i] = std::min(nearest[i], (p - samples_map.col(i)).norm());
      }
    }
  }
  return nearest;
}

inline Errors distanceToMesh(const Eigen::Matrix3Xd& samples_map, const TriangleMesh& mesh, double reach_m) {
  return Errors(distancesToMesh(samples_map, mesh, reach_m));
}

/// One answer.
struct Answer {
  double distance;
  SpaceState state;
};

inline Answer ask(const MapSnapshot& snapshot, const Eigen::Vector3d& p_map) {
  gpis_mapping::QueryOptions options;
  options.variance = false;
  options.threads = 1;
  const QueryResult result = snapshot.query(gpis_mapping::Points3d(p_map), options);
  return {result.distance[0], result.state[0]};
}

/// NaN equals NaN here.
template <typename A, typename B>
bool areBitwiseEqual(const Eigen::MatrixBase<A>& a, const Eigen::MatrixBase<B>& b) {
  if (a.rows() != b.rows() || a.cols() != b.cols()) return false;
  for (Eigen::Index c = 0; c < a.cols(); ++c) {
    for (Eigen::Index r = 0; r < a.rows(); ++r) {
      if (!(a(r, c) == b(r, c) || (std::isnan(a(r, c)) && std::isnan(b(r, c))))) return false;
    }
  }
  return true;
}

inline bool areBitwiseEqual(const QueryResult& a, const QueryResult& b) {
  return areBitwiseEqual(a.distance, b.distance) && areBitwiseEqual(a.gradient, b.gradient) &&
         areBitwiseEqual(a.variance, b.variance) && areBitwiseEqual(a.occupancy, b.occupancy) &&
         areBitwiseEqual(a.euclidean_distance, b.euclidean_distance) && areBitwiseEqual(a.surface_std, b.surface_std) &&
         a.state == b.state;
}

/// Random points in a box of the scene frame, given in the map frame.
inline Eigen::Matrix3Xd randomPointsInMap(const Scene& scene, std::uint64_t seed, int count, const Eigen::Vector3d& low,
                                          const Eigen::Vector3d& high) {
  SeededRandom random(seed);
  Eigen::Matrix3Xd points(3, count);
  for (int i = 0; i < count; ++i) points.col(i) = scene.T_map_scene * randomPoint(random, low, high);
  return points;
}

}  // namespace test
}  // namespace synthetic_depth
