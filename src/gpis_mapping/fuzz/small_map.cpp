// SPDX-License-Identifier: BSD-3-Clause
#include "fuzz/small_map.h"

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <limits>
#include <sstream>

namespace gpis_mapping_fuzz {

using gpis_mapping::CameraModel;
using gpis_mapping::DepthImage;
using gpis_mapping::GpisConfig;
using gpis_mapping::GpisMap;
using gpis_mapping::MapContents;
using gpis_mapping::MapSnapshot;
using gpis_mapping::Points3d;
using gpis_mapping::QueryOptions;
using gpis_mapping::QueryResult;
using gpis_mapping::SpaceState;
using gpis_mapping::SurfacePoint;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kBallRadius_m = 0.2;

std::uint64_t addBits(std::uint64_t hash, const void* data, std::size_t size) {
  const auto* bytes = static_cast<const unsigned char*>(data);
  for (std::size_t i = 0; i < size; ++i) hash = (hash ^ bytes[i]) * 1099511628211ULL;  // FNV-1a
  return hash;
}

std::string at(const Eigen::Vector3d& p) {
  std::ostringstream text;
  text.precision(17);
  text << " at (" << p.x() << ", " << p.y() << ", " << p.z() << ")";
  return text.str();
}

}  // namespace

CameraModel smallCamera(int width, int height) {
  return {width, height, 0.8 * width, 0.8 * width, 0.5 * (width - 1), 0.5 * (height - 1)};
}

GpisConfig smallConfig() {
  GpisConfig config;
  config.threads = 1;
  config.sensor.max_range_m = 2.5;
  // The frame regressor costs window^6: 6 px instead of 12.
  config.frame_map.tile_px = 4;
  config.frame_map.overlap_px = 1;
  // Few points in few cells.
  config.surface.spacing_m = 0.05;
  config.surface.blend_radius_m = 0.1;
  config.surface.length_scale_m = 0.125;
  config.cells.size_m = 0.25;
  config.cells.training_margin_m = 0.075;
  config.cells.blend_margin_m = 0.035;
  config.mesh.voxels_per_cell = 5;
  config.observed.block_size_m = 0.2;
  return config;
}

Eigen::Isometry3d somePose(const Eigen::Vector3d& middle_map, Random* random) {
  const double azimuth = random->uniform(0.0, 6.28);
  const double height = random->uniform(0.3, 1.2);
  const double radius = random->uniform(0.5, 1.5);
  const Eigen::Vector3d eye =
      middle_map + Eigen::Vector3d(radius * std::cos(azimuth), radius * std::sin(azimuth), height);
  const Eigen::Vector3d z = (middle_map - eye).normalized();
  const Eigen::Vector3d x = z.cross(Eigen::Vector3d::UnitZ()).normalized();
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() << x, z.cross(x), z;
  pose.translation() = eye;
  return pose;
}

DepthImage renderScene(const CameraModel& camera, const Eigen::Isometry3d& T_map_camera,
                       const Eigen::Vector3d& middle_map, bool with_ball, Random* random) {
  DepthImage image{camera.width, camera.height, {}};
  const Eigen::Vector3d eye = T_map_camera.translation() - middle_map;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const Eigen::Vector3d ray =
          T_map_camera.linear() * Eigen::Vector3d((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
      double depth = ray.z() < 0.0 ? -eye.z() / ray.z() : kInfinity;
      const Eigen::Vector3d to_ball = Eigen::Vector3d(0.0, 0.0, kBallRadius_m) - eye;
      const double along = to_ball.dot(ray) / ray.squaredNorm();
      const double inside = kBallRadius_m * kBallRadius_m - (to_ball - along * ray).squaredNorm();
      if (with_ball && inside > 0.0) depth = std::min(depth, along - std::sqrt(inside / ray.squaredNorm()));
      if (std::isfinite(depth)) depth += random->uniform(-0.002, 0.002);
      image.depth_m.push_back(static_cast<float>(depth));
    }
  }
  return image;
}

MapContents smallMap() {
  Random random(1, 2, 3);
  GpisMap map(smallConfig());
  const CameraModel camera = smallCamera(32, 24);
  for (int i = 0; i < 6; ++i) {
    const Eigen::Isometry3d pose = somePose(Eigen::Vector3d::Zero(), &random);
    map.update(renderScene(camera, pose, Eigen::Vector3d::Zero(), true, &random), camera, pose, 100.0 + i);
  }
  return map.contents();
}

std::uint64_t checksumOf(const MapContents& contents) {
  std::uint64_t hash = 14695981039346656037ULL;
  hash = addBits(hash, &contents.epoch_s, sizeof(double));
  hash = addBits(hash, &contents.num_updates, sizeof(std::uint64_t));
  for (const SurfacePoint& p : contents.points) {
    hash = addBits(hash, p.position_map.data(), 3 * sizeof(double));
    hash = addBits(hash, p.normal_map.data(), 3 * sizeof(float));
    hash = addBits(hash, &p.variance_m2, sizeof(float));
    hash = addBits(hash, &p.normal_variance, sizeof(float));
    hash = addBits(hash, &p.last_seen_s, sizeof(float));
    hash = addBits(hash, &p.num_looks, sizeof(std::uint16_t));
    hash = addBits(hash, &p.num_misses, sizeof(std::uint16_t));
  }
  return hash;
}

void requireSound(const MapContents& contents) {
  require(std::isfinite(contents.epoch_s), "the epoch is not finite");
  for (const SurfacePoint& p : contents.points) {
    const auto check = [&p](bool good, const char* what) {
      if (!good) throw Violation(what + at(p.position_map));
    };
    check(p.position_map.allFinite(), "a point's position is not finite");
    check(p.normal_map.allFinite() && std::abs(p.normal_map.norm() - 1.0f) < 1e-3f,
          "a point's normal is no unit vector");
    check(std::isfinite(p.variance_m2) && p.variance_m2 >= 0.0f, "a point's variance");
    check(std::isfinite(p.normal_variance) && p.normal_variance >= 0.0f, "a normal variance");
    check(std::isfinite(p.last_seen_s), "a point's time of last look is not finite");
  }
}

void requireSoundAnswers(const MapSnapshot& snapshot, const Points3d& points_map, const QueryOptions& options) {
  const QueryResult r = snapshot.query(points_map, options);
  const Eigen::Index count = points_map.cols();
  require(r.distance.size() == count && r.gradient.cols() == count && r.euclidean_distance.size() == count &&
              r.euclidean_gradient.cols() == count && r.surface_std.size() == count && r.variance.size() == count &&
              r.occupancy.size() == count && static_cast<Eigen::Index>(r.state.size()) == count &&
              r.variance_gradient.cols() == (options.variance_gradient ? count : 0),
          "an answer has another number of columns than the question");
  const double prior = std::pow(snapshot.config().signalStd(), 2);
  const auto isAnswer = [](double value) { return !std::isnan(value); };
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Vector3d p = points_map.col(i);
    const auto check = [&p](bool good, const char* what) {
      if (!good) throw Violation(what + at(p));
    };
    const SpaceState state = r.state[static_cast<std::size_t>(i)];
    if (!p.allFinite()) {
      check(state == SpaceState::kUnknown, "a point that is not finite is not unknown");
      check(!isAnswer(r.distance[i]) && !isAnswer(r.euclidean_distance[i]) && !isAnswer(r.variance[i]) &&
                !isAnswer(r.occupancy[i]) && !isAnswer(r.surface_std[i]),
            "a point that is not finite got an answer");
      continue;
    }
    for (const double value :
         {r.distance[i], r.euclidean_distance[i], r.variance[i], r.occupancy[i], r.surface_std[i]}) {
      check(!std::isinf(value), "an answer is infinite");
    }
    if (isAnswer(r.distance[i])) {
      check(r.gradient.col(i).allFinite(), "a distance without gradient");
      check(isAnswer(r.euclidean_distance[i]), "a distance without Euclidean distance");
      check(std::abs(r.distance[i]) == r.euclidean_distance[i], "distance and Euclidean distance differ");
      check(isAnswer(r.surface_std[i]) && r.surface_std[i] >= 0.0, "a distance without surface_std");
      if (options.variance) check(isAnswer(r.variance[i]), "a distance without variance");
      check((r.distance[i] < 0.0) == (state == SpaceState::kOccupied), "the distance's sign contradicts the state");
    }
    if (isAnswer(r.euclidean_distance[i])) {
      check(r.euclidean_distance[i] >= 0.0, "a Euclidean distance is negative");
      check(r.euclidean_gradient.col(i).allFinite(), "a Euclidean distance without gradient");
    }
    // Blending keeps between the cells' variances, each at most the prior's; float rounding is 1e-7 of it.
    if (isAnswer(r.variance[i])) {
      check(r.variance[i] >= 0.0 && r.variance[i] <= 1.0001 * prior, "a variance beyond the prior's");
    }
    if (isAnswer(r.occupancy[i])) {
      check(r.occupancy[i] >= 0.0 && r.occupancy[i] <= 1.0, "an occupancy outside [0, 1]");
    }
  }
}

void requireSoundAnswers(const MapSnapshot& snapshot, Random* random) {
  Points3d points = Points3d::Zero(3, 6);
  if (!snapshot.cells().empty()) {
    auto cell = snapshot.cells().begin();
    std::advance(cell, static_cast<std::ptrdiff_t>(random->below(std::min<std::size_t>(16, snapshot.cells().size()))));
    for (Eigen::Index i = 0; i < 3 && cell->second->size() > 0; ++i) {
      points.col(i) = cell->second->position(random->below(cell->second->size()));
    }
    points.col(1) += 0.01 * Eigen::Vector3d(random->uniform(-1, 1), random->uniform(-1, 1), random->uniform(-1, 1));
    points.col(2) += 0.2 * Eigen::Vector3d(random->uniform(-1, 1), random->uniform(-1, 1), random->uniform(-1, 1));
  }
  for (Eigen::Index i = 3; i < 6; ++i) {
    points.col(i) = Eigen::Vector3d(random->uniform(-2, 2), random->uniform(-2, 2), random->uniform(-1, 2));
  }
  QueryOptions options;
  options.threads = 1;
  options.variance_gradient = random->chance(0.3);
  requireSoundAnswers(snapshot, points, options);
}

ScratchFolder::ScratchFolder() {
  const std::filesystem::path memory = "/dev/shm";
  std::error_code ignored;
  const std::filesystem::path base =
      std::filesystem::is_directory(memory, ignored) ? memory : std::filesystem::temp_directory_path();
  std::string name = (base / "gpis_fuzz_XXXXXX").string();
  if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error(name + ": folder cannot be made");
  path_ = name;
}

ScratchFolder::~ScratchFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

void writeFile(const std::string& path, const std::string& bytes) {
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out << bytes;
  out.close();
  if (!out) throw std::runtime_error(path + ": cannot be written");
}

std::string readFile(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in) throw std::runtime_error(path + ": cannot be read");
  return text.str();
}

}  // namespace gpis_mapping_fuzz
