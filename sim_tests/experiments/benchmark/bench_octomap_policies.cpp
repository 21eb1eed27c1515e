// SPDX-License-Identifier: BSD-3-Clause
// Feeds rendered sequences with boxes taken away to DynamicOctomap under several forget policies, and prints how much of
// the removed boxes is left, how complete the surface is, how much is wrong, and the time per frame.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <iostream>
#include <string>
#include <unordered_map>
#include <vector>

#include <boost/program_options.hpp>

#include "gpis_mapping/types.h"
#include "measuring.h"
#include "octomap_baseline/dynamic_octomap.h"
#include "synthetic_depth/depth_renderer.h"
#include "synthetic_depth/scene_distance.h"
#include "synthetic_depth/scene_loader.h"
#include "synthetic_depth/seeded_random.h"
#include "synthetic_depth/sensor.h"

namespace {

using gpis_mapping::LatticeKey;
using octomap_baseline::DynamicOctomap;
using octomap_baseline::ForgetPolicy;
using octomap_baseline::OctomapConfig;
using synthetic_depth::Scene;

constexpr double kGhostClearance_m = 0.05;  // a ghost is this far from everything that is still there
constexpr double kFreeMargin_m = 0.05;      // and some image saw this far past it, whatever the voxel's size
constexpr double kOff_m = 0.02;             // an occupied voxel is wrong when the surface is farther than this

struct Variant {
  std::string name;
  std::function<void(OctomapConfig*)> change;
};

std::vector<Variant> variants() {
  const auto odds = [](double miss, double clamp_min, double clamp_max) {
    return [=](OctomapConfig* c) {
      c->dynamic.policy = ForgetPolicy::kOdds;
      c->occupancy = {0.7, miss, clamp_min, clamp_max, 0.5};
    };
  };
  const auto seenThrough = [](double miss, double sigmas) {
    return [=](OctomapConfig* c) {
      c->dynamic.policy = ForgetPolicy::kSeenThrough;
      c->occupancy = {0.7, miss, 0.12, 0.97, 0.5};
      c->dynamic.tolerance_sigmas = sigmas;
    };
  };
  const auto noWall = [=](OctomapConfig* c) {
    odds(0.4, 0.12, 0.97)(c);
    c->dynamic.virtual_wall = false;
  };
  return {
      {"odds, no virtual wall", noWall},
      {"odds", odds(0.4, 0.12, 0.97)},
      {"odds, quick: miss 0.2, clamped to 0.2, 0.8", odds(0.2, 0.2, 0.8)},
      {"odds, one miss: miss 0.29, clamped to 0.29, 0.7", odds(0.29, 0.29, 0.7)},
      {"seen_through, 1 sigma", seenThrough(0.4, 1.0)},
      {"seen_through, 3 sigma", seenThrough(0.4, 3.0)},
      {"seen_through, 3 sigma, miss 0.3", seenThrough(0.3, 3.0)},
      {"default", [](OctomapConfig*) {}},
  };
}

struct RecordedFrame {
  gpis_mapping::DepthImage image;
  Eigen::Isometry3d T_map_camera;  // as the map is told
};

/// The measured sequence; the poses carry the given error.
std::vector<RecordedFrame> record(const Scene& scene, double pose_std_m) {
  constexpr double kRadPerMetre = 0.4;  // 4 mm go with 1.6 mrad
  synthetic_depth::SeededRandom random(scene.seed + 1000);
  std::vector<RecordedFrame> frames;
  for (int k = 0; k < scene.numFrames(); ++k) {
    const cv::Mat depth = synthetic_depth::measureDepth(scene, k);
    RecordedFrame frame;
    frame.image = {depth.cols, depth.rows, std::vector<float>(depth.ptr<float>(), depth.ptr<float>() + depth.total())};
    const Eigen::Vector3d shift = pose_std_m * Eigen::Vector3d(random.normal(), random.normal(), random.normal());
    const Eigen::Vector3d turn =
        kRadPerMetre * pose_std_m * Eigen::Vector3d(random.normal(), random.normal(), random.normal());
    frame.T_map_camera = scene.cameraInMap(k);
    frame.T_map_camera.translation() += shift;
    if (turn.norm() > 0.0) frame.T_map_camera.rotate(Eigen::AngleAxisd(turn.norm(), turn.normalized()));
    frames.push_back(std::move(frame));
  }
  return frames;
}

/// Centres of the occupied voxels, pruned leaves taken apart.
std::vector<Eigen::Vector3d> occupiedCenters(const octomap::OcTree& tree) {
  std::vector<Eigen::Vector3d> centers;
  const double resolution = tree.getResolution();
  for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
    if (!tree.isNodeOccupied(*leaf)) continue;
    const int across = static_cast<int>(std::lround(leaf.getSize() / resolution));
    const double first = 0.5 * (resolution - leaf.getSize());
    for (int i = 0; i < across * across * across; ++i) {
      centers.emplace_back(leaf.getX() + first + i % across * resolution,
                           leaf.getY() + first + i / across % across * resolution,
                           leaf.getZ() + first + i / across / across * resolution);
    }
  }
  return centers;
}

Eigen::Matrix3Xd asMatrix(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Matrix3Xd matrix(3, static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) matrix.col(static_cast<Eigen::Index>(i)) = points[i];
  return matrix;
}

/// What the exact scene says.
class GroundTruth {
 public:
  explicit GroundTruth(const Scene& scene) : scene_(scene), removal_(scene.firstRemovalFrame()) {
    if (removal_ < 1 || removal_ >= scene.numFrames())
      throw std::invalid_argument("nothing is taken away in the scene");
    for (int k = removal_; k < scene.numFrames(); ++k) views_.emplace_back(scene, k, scene.T_scene_camera[k]);
    const auto samples = synthetic_depth::visibleSurfaceSamples(scene, 0, removal_ - 1, 0.02);
    for (Eigen::Index i = 0; i < samples.points_map.cols(); ++i) {
      if (inRoi(samples.points_map.col(i))) surface_.emplace_back(samples.points_map.col(i));
    }
  }

  int removalFrame() const { return removal_; }

  /// Share of the visible surface with an occupied voxel's centre within `reach_m`.
  double completeness(const std::vector<Eigen::Vector3d>& centers, double reach_m) const {
    std::unordered_map<LatticeKey, std::vector<Eigen::Vector3d>, gpis_mapping::LatticeKeyHash> grid;
    for (const Eigen::Vector3d& p : centers) grid[LatticeKey::of(p, reach_m)].push_back(p);
    std::size_t covered = 0;
    for (const Eigen::Vector3d& p : surface_) {
      const LatticeKey key = LatticeKey::of(p, reach_m);
      bool found = false;
      for (int i = 0; i < 27 && !found; ++i) {
        const auto cell = grid.find(key.offset(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1));
        if (cell == grid.end()) continue;
        for (const Eigen::Vector3d& q : cell->second) found = found || (p - q).norm() <= reach_m;
      }
      covered += found;
    }
    return static_cast<double>(covered) / static_cast<double>(surface_.size());
  }

  /// Share of the occupied voxels that are farther than kOff_m from the surface of a frame.
  double wrongShare(const std::vector<Eigen::Vector3d>& centers, int frame) const {
    std::vector<Eigen::Vector3d> inside;
    for (const Eigen::Vector3d& p : centers) {
      if (inRoi(p)) inside.push_back(p);
    }
    const Eigen::VectorXd exact = synthetic_depth::signedDistance(scene_, frame, asMatrix(inside));
    return static_cast<double>((exact.array().abs() > kOff_m).count()) / std::max<double>(1.0, exact.size());
  }

  /// Of the voxels occupied before the removal, those in whose place a later frame sees empty space, with the number of
  /// frames from the removal to the first such frame.
  void setGhosts(const std::vector<Eigen::Vector3d>& centers) {
    ghosts_.clear();
    std::vector<Eigen::Vector3d> near;
    for (const Eigen::Vector3d& p : centers) {
      if (inRoi(p)) near.push_back(p);
    }
    const Eigen::VectorXd before = synthetic_depth::signedDistance(scene_, removal_ - 1, asMatrix(near));
    const Eigen::VectorXd after = synthetic_depth::signedDistance(scene_, removal_, asMatrix(near));
    for (std::size_t i = 0; i < near.size(); ++i) {
      const auto n = static_cast<Eigen::Index>(i);
      if (std::abs(before[n]) > kOff_m || after[n] < kGhostClearance_m) continue;
      for (std::size_t k = 0; k < views_.size(); ++k) {
        if (!seenFree(near[i], static_cast<int>(k))) continue;
        ghosts_.push_back({near[i], static_cast<int>(k)});
        break;
      }
    }
  }

  /// Of the ghosts that the first `frames` images after the removal saw through, the share still occupied.
  double ghostShare(const octomap::OcTree& tree, int frames) const {
    std::size_t all = 0;
    std::size_t left = 0;
    for (const Ghost& ghost : ghosts_) {
      if (ghost.first_seen_free >= frames) continue;
      const Eigen::Vector3d& p = ghost.p_map;
      const octomap::OcTreeNode* node = tree.search(p.x(), p.y(), p.z());
      ++all;
      left += node != nullptr && tree.isNodeOccupied(node);
    }
    return static_cast<double>(left) / std::max<double>(1.0, static_cast<double>(all));
  }

 private:
  struct Ghost {
    Eigen::Vector3d p_map;
    int first_seen_free;  // frames since the removal
  };

  bool inRoi(const Eigen::Vector3d& p_map) const {
    const Eigen::Vector3d p = scene_.T_map_scene.inverse() * p_map;
    return (p.array() >= scene_.roi.min_m.array()).all() && (p.array() <= scene_.roi.max_m.array()).all();
  }

  bool seenFree(const Eigen::Vector3d& p_map, int frames_since) const {
    const Eigen::Vector3d p = scene_.cameraInMap(removal_ + frames_since).inverse() * p_map;
    if (p.z() < scene_.sensor.min_range_m) return false;
    const double u = scene_.camera.fx_px * p.x() / p.z() + scene_.camera.cx_px;
    const double v = scene_.camera.fy_px * p.y() / p.z() + scene_.camera.cy_px;
    if (u < 0.0 || v < 0.0 || u > scene_.camera.width_px - 1.0 || v > scene_.camera.height_px - 1.0) return false;
    return views_[static_cast<std::size_t>(frames_since)].cast(u, v).z_m > p.z() + kFreeMargin_m;
  }

  Scene scene_;
  int removal_;
  std::vector<synthetic_depth::ViewCaster> views_;
  std::vector<Eigen::Vector3d> surface_;
  std::vector<Ghost> ghosts_;
};

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.2f", 100.0 * share);
  return text;
}

void runVariant(const Variant& variant, const OctomapConfig& base, const Scene& scene,
                const std::vector<RecordedFrame>& frames, GroundTruth* truth) {
  OctomapConfig config = base;
  variant.change(&config);
  DynamicOctomap map(config);
  const synthetic_depth::CameraModel& c = scene.camera;
  const gpis_mapping::CameraModel camera{c.width_px, c.height_px, c.fx_px, c.fy_px, c.cx_px, c.cy_px};
  std::vector<double> wall_ms;
  std::vector<double> processor_ms;
  std::string before;
  std::string after;
  std::string ghosts;
  for (int k = 0; k < scene.numFrames(); ++k) {
    const RecordedFrame& frame = frames[static_cast<std::size_t>(k)];
    const double processor_before = experiments::processorMs();
    wall_ms.push_back(map.update(frame.image, camera, frame.T_map_camera, scene.stampSeconds(k)).total_ms);
    processor_ms.push_back(experiments::processorMs() - processor_before);
    const int since = k - truth->removalFrame() + 1;  // images after the removal
    if (since == 0) {
      const auto centers = occupiedCenters(map.tree());
      before =
          percent(truth->completeness(centers, config.resolution_m)) + " | " + percent(truth->wrongShare(centers, k));
      truth->setGhosts(centers);
    }
    if (since == 1 || since == 5 || since == 10 || (since == 30 || (since < 30 && k + 1 == scene.numFrames()))) {
      ghosts += " | " + percent(truth->ghostShare(map.tree(), since));
    }
    if (since == 10) after = percent(truth->wrongShare(occupiedCenters(map.tree()), k));
  }
  std::printf("| %s | %s | %s%s | %.0f | %.0f |\n", variant.name.c_str(), before.c_str(), after.c_str(), ghosts.c_str(),
              experiments::median(wall_ms), experiments::median(processor_ms));
  std::fflush(stdout);
}

int run(int argc, char** argv) {
  namespace po = boost::program_options;
  po::options_description options("Options");
  std::string scene_name;
  std::string only;
  double resolution_m = 0.0;
  double pose_std_m = 0.0;
  int threads = 0;
  // clang-format off
  options.add_options()
    ("help,h", "show this text")
    ("scene", po::value(&scene_name)->default_value("demo_pile"), "scene of sim_tests/synthetic_depth/scenes, by name")
    ("resolution", po::value(&resolution_m)->default_value(0.02), "of the octree [m]")
    ("pose-std", po::value(&pose_std_m)->default_value(0.0), "error of the camera position given to the map [m]; "
                                                            "of its direction: 0.4 rad per metre of it")
    ("only", po::value(&only), "variants whose name contains this")
    ("threads", po::value(&threads)->default_value(0), "0: one per core");
  // clang-format on
  po::variables_map arguments;
  po::store(po::parse_command_line(argc, argv, options), arguments);
  po::notify(arguments);
  if (arguments.count("help") != 0) {
    std::cout << "Usage: bench_octomap_policies [options]\n" << options;
    return 0;
  }
  const Scene scene = synthetic_depth::loadScene(std::string(BENCH_SCENES) + "/" + scene_name + ".yaml");
  OctomapConfig base;
  base.resolution_m = resolution_m;
  base.threads = threads;
  base.sensor.min_range_m = scene.sensor.min_range_m;
  base.sensor.max_range_m = scene.sensor.max_range_m;
  base.sensor.baseline_m = scene.sensor.baseline_m;
  base.sensor.noise = {scene.sensor.axial_noise_a_m, scene.sensor.axial_noise_b, scene.sensor.axial_noise_c_per_m};
  const std::vector<RecordedFrame> frames = record(scene, pose_std_m);
  GroundTruth truth(scene);
  std::printf("%s, %g cm, pose error %g mm: %d images, boxes taken away before image %d\n\n", scene_name.c_str(),
              100.0 * resolution_m, 1e3 * pose_std_m, scene.numFrames(), truth.removalFrame());
  std::printf(
      "| policy | complete %% | wrong %% | wrong %% 10 after | ghosts %% after 1 | 5 | 10 | %d | ms | processor ms |\n",
      std::min(30, scene.numFrames() - truth.removalFrame()));
  std::printf("| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n");
  for (const Variant& variant : variants()) {
    if (variant.name.find(only) != std::string::npos) runVariant(variant, base, scene, frames, &truth);
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const boost::program_options::error& error) {
    std::cerr << "bench_octomap_policies: " << error.what() << " (--help explains)\n";
    return 2;
  } catch (const std::exception& error) {
    std::cerr << "bench_octomap_policies: " << error.what() << "\n";
    return 1;
  }
}
