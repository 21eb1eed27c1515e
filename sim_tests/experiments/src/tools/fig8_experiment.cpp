// SPDX-License-Identifier: BSD-3-Clause
// The accuracy experiment of the paper's Fig. 8: a map that has seen an object and then a scan without it, against a map
// made from that last scan alone.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <exception>
#include <functional>
#include <iostream>
#include <limits>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <boost/filesystem.hpp>
#include <boost/program_options.hpp>
#include <nlohmann/json.hpp>

#include <interactive_mapping_common/files/atomic_file.h>
#include "gpis_mapping/gpis_map.h"
#include "gpis_mapping/mesh_extractor.h"
#include "gpis_mapping/point_update.h"
#include "octomap_baseline/dynamic_octomap.h"
#include "surface_comparison/mesh_distance.h"
#include "surface_comparison/surface_ply.h"
#include "synthetic_depth/depth_renderer.h"
#include "synthetic_depth/scene_distance.h"
#include "synthetic_depth/scene_loader.h"
#include "synthetic_depth/sensor.h"

namespace {

namespace po = boost::program_options;

using Eigen::Vector3d;
using experiments::MeshDistance;
using experiments::Statistics;
using experiments::Surface;
using nlohmann::json;
using synthetic_depth::Scene;

constexpr const char* kUsage = "Usage: fig8_experiment SCENE.yaml --out DIR [options]\n";
constexpr int kFailed = 1;
constexpr int kBadUsage = 2;
constexpr int kBadScene = 3;

/// A point this far behind the surface that the last scan sees, along the optical axis, is hidden from it [m]. More than
/// the maps' own errors on a face seen at a slant, less than a brick's thickness.
constexpr double kHiddenDepth_m = 0.02;
/// Ghost: within the removed object, grown by the first, and farther than the second from all that is left [m]. The
/// first takes in the object's own faces as a 2 cm voxel map has them; the second leaves out what it touched.
constexpr double kGhostMargin_m = 0.02;
constexpr double kGhostClearance_m = 0.03;
/// Nearer than this to an edge of the exact surface, convex or concave, is the zone "edges" [m]: within the reach of the
/// default map's kernel an edge is rounded.
constexpr double kEdgeZone_m = 0.025;
/// Where the map has the exact surface within this and the map of the last scan is farther than this from it, that scan
/// alone gave no surface here (a face seen at a slant) and there is nothing to compare with [m]. Ghosts are not near the
/// exact surface and stay in.
constexpr double kReferenceGap_m = 0.01;
constexpr double kHistogramBin_m = 0.00005;
constexpr double kHistogramReach_m = 0.02;

struct Recorded {
  gpis_mapping::DepthImage image;
  Eigen::Isometry3d T_map_camera;
  double stamp_s;
};

Recorded record(const Scene& scene, int frame) {
  const cv::Mat depth = synthetic_depth::measureDepth(scene, frame);
  Recorded recorded{{depth.cols, depth.rows, {}}, scene.cameraInMap(frame), scene.stampSeconds(frame)};
  recorded.image.depth_m.assign(depth.ptr<float>(), depth.ptr<float>() + depth.total());
  return recorded;
}

/// A map under test.
class Mapper {
 public:
  virtual ~Mapper() = default;
  virtual void update(const Recorded& frame) = 0;
  virtual Surface surface() = 0;
};

class GpisMapper : public Mapper {
 public:
  GpisMapper(const gpis_mapping::GpisConfig& config, const gpis_mapping::CameraModel& camera)
      : camera_(camera), map_(config) {}

  void update(const Recorded& frame) override { map_.update(frame.image, camera_, frame.T_map_camera, frame.stamp_s); }

  Surface surface() override {
    gpis_mapping::MeshExtractor extractor(map_.config());
    extractor.update(*map_.snapshot());
    gpis_mapping::TriangleMesh mesh = extractor.mesh();
    return {std::move(mesh.vertices_map), std::move(mesh.normals_map), std::move(mesh.triangles)};
  }

 private:
  gpis_mapping::CameraModel camera_;
  gpis_mapping::GpisMap map_;
};

/// Faces between an occupied voxel and a free one: where the map says that the surface is.
Surface facesOf(const octomap::OcTree& tree) {
  Surface surface;
  const double size = tree.getResolution();
  constexpr int kOrigin = 32768;  // key of the voxel whose lower corner is the origin
  const auto add_faces = [&](const octomap::OcTreeKey& key) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const int side : {-1, 1}) {
        octomap::OcTreeKey beside = key;
        beside[static_cast<unsigned>(axis)] = static_cast<octomap::key_type>(key[static_cast<unsigned>(axis)] + side);
        const octomap::OcTreeNode* node = tree.search(beside);
        if (node == nullptr || tree.isNodeOccupied(node)) continue;
        // Integer corners times the size: neighbouring voxels give bit-identical points.
        const auto first = static_cast<std::uint32_t>(surface.points_map.size());
        const int b = (axis + 1) % 3;
        const int c = (axis + 2) % 3;
        Eigen::Vector3f normal = Eigen::Vector3f::Zero();
        normal[axis] = static_cast<float>(side);
        for (const auto& [step_b, step_c] : {std::pair<int, int>{0, 0}, {1, 0}, {1, 1}, {0, 1}}) {
          Eigen::Vector3i corner(key[0] - kOrigin, key[1] - kOrigin, key[2] - kOrigin);
          corner[axis] += side > 0 ? 1 : 0;
          corner[b] += step_b;
          corner[c] += step_c;
          surface.points_map.push_back(corner.cast<double>() * size);
          surface.normals_map.push_back(normal);
        }
        if (side > 0) {
          surface.triangles.push_back({first, first + 1, first + 2});
          surface.triangles.push_back({first, first + 2, first + 3});
        } else {
          surface.triangles.push_back({first, first + 2, first + 1});
          surface.triangles.push_back({first, first + 3, first + 2});
        }
      }
    }
  };
  for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
    if (!tree.isNodeOccupied(*leaf)) continue;
    // A pruned leaf stands for many voxels.
    const auto across = static_cast<unsigned>(std::lround(leaf.getSize() / size));
    const octomap::OcTreeKey low = leaf.getIndexKey();
    for (unsigned i = 0; i < across * across * across; ++i) {
      add_faces({static_cast<octomap::key_type>(low[0] + i % across),
                 static_cast<octomap::key_type>(low[1] + i / across % across),
                 static_cast<octomap::key_type>(low[2] + i / across / across)});
    }
  }
  return surface;
}

class OctomapMapper : public Mapper {
 public:
  OctomapMapper(const octomap_baseline::OctomapConfig& config, const gpis_mapping::CameraModel& camera)
      : camera_(camera), map_(config) {}

  void update(const Recorded& frame) override { map_.update(frame.image, camera_, frame.T_map_camera, frame.stamp_s); }
  Surface surface() override { return facesOf(map_.tree()); }

 private:
  gpis_mapping::CameraModel camera_;
  octomap_baseline::DynamicOctomap map_;
};

struct System {
  std::string key;
  std::string title;
  std::function<std::unique_ptr<Mapper>()> make;
};

/// The surfaces of one system.
struct Maps {
  Surface before;                     // all frames but those after the removal
  Surface after;                      // all frames
  Surface last_scan;                  // the last frame alone
  std::optional<Surface> other_scan;  // the last frame alone with other noise
};

Maps runSystem(const System& system, const std::vector<Recorded>& frames, int removal_frame,
               const std::optional<Recorded>& other_scan) {
  Maps maps;
  const auto single = [&](const Recorded& frame) {
    const std::unique_ptr<Mapper> mapper = system.make();
    mapper->update(frame);
    return mapper->surface();
  };
  const std::unique_ptr<Mapper> mapper = system.make();
  for (std::size_t k = 0; k < frames.size(); ++k) {
    if (static_cast<int>(k) == removal_frame) maps.before = mapper->surface();
    mapper->update(frames[k]);
  }
  maps.after = mapper->surface();
  maps.last_scan = single(frames.back());
  if (other_scan) maps.other_scan = single(*other_scan);
  return maps;
}

/// What the exact scene says about a point of a map at the last frame.
class GroundTruth {
 public:
  explicit GroundTruth(const Scene& scene)
      : scene_(scene),
        last_(scene.numFrames() - 1),
        removal_(scene.firstRemovalFrame()),
        T_scene_map_(scene.T_map_scene.inverse()),
        distance_(scene, last_) {
    for (int k = 0; k <= last_; ++k) views_.emplace_back(scene, k, scene.T_scene_camera[static_cast<std::size_t>(k)]);
    for (const synthetic_depth::Box& box : scene.boxes) {
      if (box.isPresent(removal_ - 1) && !box.isPresent(last_)) removed_.push_back(box);
    }
  }

  bool isInRegion(const Vector3d& p_map) const {
    const Vector3d p = T_scene_map_ * p_map;
    return (p.array() >= scene_.roi.min_m.array()).all() && (p.array() <= scene_.roi.max_m.array()).all();
  }

  /// On or before the surface that a frame sees: what that scan can judge.
  bool isJudgedBy(int frame, const Vector3d& p_map) const {
    const Vector3d p = scene_.cameraInMap(frame).inverse() * p_map;
    const synthetic_depth::CameraModel& c = scene_.camera;
    if (p.z() < std::max(scene_.sensor.min_range_m, 1e-3) || p.z() > scene_.sensor.max_range_m) return false;
    const double u = c.fx_px * p.x() / p.z() + c.cx_px;
    const double v = c.fy_px * p.y() / p.z() + c.cy_px;
    if (u < 0.0 || v < 0.0 || u > c.width_px - 1.0 || v > c.height_px - 1.0) return false;
    return views_[static_cast<std::size_t>(frame)].isVisible(p, kHiddenDepth_m);
  }
  bool isJudgedByLast(const Vector3d& p_map) const { return isJudgedBy(last_, p_map); }

  /// Whether a surface here was in view, of this frame's boxes, before the removal.
  bool wasSeenBefore(const Vector3d& p_map) const {
    for (int k = 0; k < removal_; ++k) {
      if (isJudgedBy(k, p_map)) return true;
    }
    return false;
  }

  double signedDistance(const Vector3d& p_map) const { return distance_.signedDistanceScene(T_scene_map_ * p_map); }

  bool isGhost(const Vector3d& p_map) const {
    const Vector3d p_scene = T_scene_map_ * p_map;
    const bool is_within = std::any_of(removed_.begin(), removed_.end(), [&](const synthetic_depth::Box& box) {
      const Vector3d p = box.T_scene_box.inverse() * p_scene;
      return ((p.cwiseAbs() - box.half_extents_m).array() <= kGhostMargin_m).all();
    });
    return is_within && distance_.signedDistanceScene(p_scene) > kGhostClearance_m;
  }

  /// Whether the point's own pixel in the last image has a depth behind it: what a dynamic map can know to be gone.
  bool isSeenPast(const Recorded& last_scan, const Vector3d& p_map) const {
    const Vector3d p = last_scan.T_map_camera.inverse() * p_map;
    if (p.z() <= 0.0) return false;
    const synthetic_depth::CameraModel& c = scene_.camera;
    const long u = std::lround(c.fx_px * p.x() / p.z() + c.cx_px);
    const long v = std::lround(c.fy_px * p.y() / p.z() + c.cy_px);
    if (u < 0 || v < 0 || u >= c.width_px || v >= c.height_px) return false;
    const double z = last_scan.image.at(static_cast<int>(u), static_cast<int>(v));
    return z > p.z() + kGhostClearance_m;  // false for NaN; an infinite depth is seen past
  }

  bool isNearEdge(const Vector3d& p_map) const {
    const Vector3d p = T_scene_map_ * p_map;
    for (const synthetic_depth::ExposedFace& face : distance_.exposedFaces()) {
      const Vector3d local = p - face.origin_scene;
      const Eigen::Vector2d uv(local.dot(face.axis_u), local.dot(face.axis_v));
      const double height = local.dot(face.normal);
      if (std::abs(height) > kEdgeZone_m) continue;
      for (const auto& [a, b] : face.rims) {
        const Eigen::Vector2d ab = b - a;
        const double along = ab.squaredNorm() > 0.0 ? std::clamp((uv - a).dot(ab) / ab.squaredNorm(), 0.0, 1.0) : 0.0;
        if (std::hypot((uv - a - along * ab).norm(), height) < kEdgeZone_m) return true;
      }
    }
    return false;
  }

 private:
  Scene scene_;
  int last_;
  int removal_;
  Eigen::Isometry3d T_scene_map_;
  synthetic_depth::SceneDistance distance_;
  std::vector<synthetic_depth::ViewCaster> views_;
  std::vector<synthetic_depth::Box> removed_;
};

json toJson(const Statistics& s) {
  return {{"count", s.count},
          {"mean_m", s.mean},
          {"std_dev_m", s.std_dev},
          {"rms_m", s.rms},
          {"median_abs_m", s.median_abs},
          {"p95_abs_m", s.p95_abs},
          {"max_abs_m", s.max_abs}};
}

double shareOf(std::size_t part, std::size_t whole) {
  return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
}

/// Counts per bin, one column per series; the first and last row hold what lies beyond.
void writeHistogram(const std::vector<std::pair<std::string, const std::vector<double>*>>& series,
                    const std::string& path) {
  const auto half = static_cast<int>(std::lround(kHistogramReach_m / kHistogramBin_m));
  const auto num_bins = static_cast<std::size_t>(2 * half);
  std::vector<std::vector<std::size_t>> counts;
  std::string text = "low_m,high_m";
  for (const auto& [name, values] : series) {
    text += "," + name;
    std::vector<std::size_t> bins(num_bins + 2, 0);
    for (const double value : *values) {
      const double place = std::floor(value / kHistogramBin_m) + half + 1;
      ++bins[static_cast<std::size_t>(std::clamp(place, 0.0, static_cast<double>(num_bins + 1)))];
    }
    counts.push_back(std::move(bins));
  }
  text += "\n";
  const auto edge = [&](std::size_t k) { return std::to_string((static_cast<double>(k) - half) * kHistogramBin_m); };
  for (std::size_t row = 0; row < num_bins + 2; ++row) {
    text += (row == 0 ? "-inf" : edge(row - 1)) + "," + (row == num_bins + 1 ? "inf" : edge(row));
    for (const std::vector<std::size_t>& bins : counts) text += "," + std::to_string(bins[row]);
    text += "\n";
  }
  interactive_mapping::AtomicFile file(path);
  file.write(text);
  file.commit();
}

/// The paper's Fig. 3: `blanket.csv`, a row per ray of the last frame, and `removed.csv`, the points that it deleted; metres, map frame.
void writeBlanket(const std::vector<Recorded>& frames, const gpis_mapping::GpisConfig& config,
                  const gpis_mapping::CameraModel& camera, const std::string& out) {
  gpis_mapping::GpisMap map(config);
  gpis_mapping::FrameBlanket blanket;
  std::vector<Vector3d> removed;
  for (const Recorded& frame : frames) {
    removed = map.update(frame.image, camera, frame.T_map_camera, frame.stamp_s, &blanket).removed_points_map;
  }
  const Eigen::IOFormat row(6, Eigen::DontAlignCols, ",", ",");
  std::ostringstream rays, points;
  rays << "column,row,is_wall,nearer_x,nearer_y,nearer_z,seen_x,seen_y,seen_z,farther_x,farther_y,farther_z\n";
  for (int i = 0; i < static_cast<int>(blanket.knots.size()); ++i) {
    const auto& knot = blanket.knots[static_cast<std::size_t>(i)];
    rays << i % blanket.columns << "," << i / blanket.columns << "," << knot.is_wall << "," << knot.nearer.format(row)
         << "," << knot.seen.format(row) << "," << knot.farther.format(row) << "\n";
  }
  points << "x,y,z\n";
  for (const Vector3d& p : removed) points << p.format(row) << "\n";
  for (const auto& [name, text] : {std::pair("/blanket.csv", rays.str()), std::pair("/removed.csv", points.str())}) {
    interactive_mapping::AtomicFile file(out + name);
    file.write(text);
    file.commit();
  }
}

struct Options {
  std::string out;
  double spacing_m;
  std::uint64_t seed;
};

/// Points of a system's map after the removal, and how far they are off.
struct Comparison {
  std::size_t cloud_points{0};
  Surface common;                                        // judged: the last scan's map has them, too
  Surface outside;                                       // not judged
  std::vector<double> to_reference, to_other, to_truth;  // signed [m], of the common points
  std::vector<double> faces, edges, uncovered;           // to_reference by zone
  std::size_t hidden{0}, border{0}, gap{0};              // why outside
  std::size_t ghosts{0}, ghosts_seen_past{0}, common_ghosts{0};
};

Comparison compare(const Maps& maps, const MeshDistance& reference, const GroundTruth& truth, const Recorded& last_scan,
                   const Options& options) {
  std::optional<MeshDistance> other;
  if (maps.other_scan) other.emplace(*maps.other_scan);
  Comparison result;
  for (const Vector3d& p : experiments::sampleEvenly(maps.after, options.spacing_m, options.seed)) {
    if (!truth.isInRegion(p)) continue;
    ++result.cloud_points;
    const bool is_ghost = truth.isGhost(p);
    result.ghosts += is_ghost;
    result.ghosts_seen_past += is_ghost && truth.isSeenPast(last_scan, p);
    const bool is_judged = truth.isJudgedByLast(p);
    const MeshDistance::Nearest nearest = reference.nearest(p);
    const double exact = truth.signedDistance(p);
    const bool is_gap = std::abs(exact) < kReferenceGap_m && std::abs(nearest.signed_distance_m) > kReferenceGap_m;
    if (!is_judged || nearest.on_border || is_gap) {
      ++(!is_judged ? result.hidden : nearest.on_border ? result.border : result.gap);
      result.outside.points_map.push_back(p);
      continue;
    }
    result.common_ghosts += is_ghost;
    result.common.points_map.push_back(p);
    result.to_reference.push_back(nearest.signed_distance_m);
    result.to_truth.push_back(exact);
    std::vector<double>& zone = !truth.wasSeenBefore(p) ? result.uncovered
                                : truth.isNearEdge(p)   ? result.edges
                                                        : result.faces;
    zone.push_back(nearest.signed_distance_m);
    if (!other) continue;
    const MeshDistance::Nearest in_other = other->nearest(p);
    if (!in_other.on_border) result.to_other.push_back(in_other.signed_distance_m);
  }
  return result;
}

/// `<prefix>_*.ply` and `<prefix>_histogram.csv`.
void writeComparison(const Comparison& found, const Maps& maps, const MeshDistance& reference, const GroundTruth& truth,
                     const std::string& prefix) {
  std::vector<double> colours;
  for (const Vector3d& p : maps.after.points_map) {
    const MeshDistance::Nearest nearest = reference.nearest(p);
    const bool is_common = truth.isJudgedByLast(p) && !nearest.on_border;
    colours.push_back(is_common ? nearest.signed_distance_m : std::numeric_limits<double>::quiet_NaN());
  }
  experiments::writePly(maps.before, {}, prefix + "_before.ply");
  experiments::writePly(maps.after, {{"distance", colours}}, prefix + "_after.ply");
  experiments::writePly(maps.last_scan, {}, prefix + "_last_scan.ply");
  experiments::writePly(found.common, {{"distance", found.to_reference}, {"truth", found.to_truth}},
                        prefix + "_common.ply");
  experiments::writePly(found.outside, {}, prefix + "_outside.ply");
  writeHistogram({{"last_scan", &found.to_reference}, {"other_scan", &found.to_other}, {"truth", &found.to_truth}},
                 prefix + "_histogram.csv");
}

/// Compares, writes `<key>_*.ply` and `<key>_histogram.csv`, returns the system's part of the summary.
json judge(const System& system, const Maps& maps, const GroundTruth& truth, const Recorded& last_scan,
           const Options& options) {
  const MeshDistance reference(maps.last_scan);
  const Comparison found = compare(maps, reference, truth, last_scan, options);
  writeComparison(found, maps, reference, truth, options.out + "/" + system.key);
  // The same yardstick on the map of the last scan: what a single scan is off by.
  std::vector<double> reference_to_truth;
  for (const Vector3d& p : experiments::sampleEvenly(maps.last_scan, options.spacing_m, options.seed)) {
    if (truth.isInRegion(p) && truth.isJudgedByLast(p)) reference_to_truth.push_back(truth.signedDistance(p));
  }
  const double area_per_point = options.spacing_m * options.spacing_m;
  const auto share = [&](std::size_t part) { return shareOf(part, found.cloud_points); };
  const auto statistics = [](const std::vector<double>& values) { return toJson(experiments::statisticsOf(values)); };
  json result = {
      {"title", system.title},
      {"cloud_points", found.cloud_points},
      {"cloud_area_m2", static_cast<double>(found.cloud_points) * area_per_point},
      {"outside_share", share(found.outside.points_map.size())},
      {"outside_hidden_share", share(found.hidden)},
      {"outside_border_share", share(found.border)},
      {"ghost_share", share(found.ghosts)},
      {"ghost_area_m2", static_cast<double>(found.ghosts) * area_per_point},
      {"outside_gap_share", share(found.gap)},
      {"ghost_points", found.ghosts},
      {"ghost_points_measured_past", found.ghosts_seen_past},
      {"ghost_points_in_common", found.common_ghosts},
      {"against_last_scan", statistics(found.to_reference)},
      {"against_truth", statistics(found.to_truth)},
      {"last_scan_against_truth", statistics(reference_to_truth)},
      {"zones_against_last_scan",
       {{"faces", statistics(found.faces)},
        {"edges", statistics(found.edges)},
        {"uncovered", statistics(found.uncovered)}}},
  };
  if (maps.other_scan) result["against_other_scan"] = statistics(found.to_other);
  return result;
}

/// The map's defaults with what the scene's data sheet says of its sensor; noise coefficients also of a noise-free run,
/// so that noise is the only difference between the two.
gpis_mapping::GpisConfig configFor(const Scene& scene) {
  gpis_mapping::GpisConfig config;
  const synthetic_depth::SensorModel& sensor = scene.sensor;
  if (sensor.min_range_m > 0.0) config.sensor.min_range_m = sensor.min_range_m;
  if (std::isfinite(sensor.max_range_m)) config.sensor.max_range_m = sensor.max_range_m;
  if (sensor.baseline_m > 0.0) config.sensor.baseline_m = sensor.baseline_m;
  if (sensor.axial_noise_a_m > 0.0 || sensor.axial_noise_b > 0.0 || sensor.axial_noise_c_per_m > 0.0) {
    config.sensor.noise = {sensor.axial_noise_a_m, sensor.axial_noise_b, sensor.axial_noise_c_per_m};
  }
  return config;
}

/// Problem with the scene for this experiment; empty if none.
std::string unfitness(const Scene& scene) {
  const int removal = scene.firstRemovalFrame();
  if (removal == synthetic_depth::kNever || removal >= scene.numFrames()) {
    return "no box is removed within its " + std::to_string(scene.numFrames()) + " frames";
  }
  if (removal < 1) return "boxes are removed at frame " + std::to_string(removal) + ", must be >= 1";
  return {};
}

/// Nothing when only help was asked for. Throws po::error.
std::optional<po::variables_map> parseArguments(int argc, char** argv) {
  po::options_description visible("Options");
  // clang-format off
  visible.add_options()
    ("help,h", "show this text")
    ("out,o", po::value<std::string>(), "folder to write; made if missing, files of the same name are replaced")
    ("seed,s", po::value<std::int64_t>(), "seed of the sensor noise, in place of the scene's")
    ("sensor", po::value<std::string>()->default_value("full"),
     "full: as in the scene; complete: no shadows and dropouts; exact: no noise either, the range limits stay")
    ("config", po::value<std::string>(), "settings of gpis_mapping; default: its defaults with the scene's sensor")
    ("spacing", po::value<double>()->default_value(0.004), "of the points that are compared [m], 0.0005 to 0.1");
  // clang-format on
  po::options_description all;
  all.add(visible).add_options()("scene", po::value<std::string>());
  po::positional_options_description positional;
  positional.add("scene", 1);
  po::variables_map arguments;
  po::store(po::command_line_parser(argc, argv).options(all).positional(positional).run(), arguments);
  po::notify(arguments);
  if (arguments.count("help") != 0) {
    std::cout << kUsage
              << "Maps a scene in which boxes are taken away and compares the map with one of the last scan alone.\n"
              << visible << "Exit codes: 0 done, 1 failed, 2 wrong usage, 3 scene or settings refused.\n";
    return std::nullopt;
  }
  if (arguments.count("scene") == 0 || arguments.count("out") == 0) {
    throw po::error("a scene file and --out are needed");
  }
  if (arguments.count("seed") != 0 && arguments["seed"].as<std::int64_t>() < 0) {
    throw po::error("--seed = " + std::to_string(arguments["seed"].as<std::int64_t>()) + ", must be >= 0");
  }
  const std::string sensor = arguments["sensor"].as<std::string>();
  if (sensor != "full" && sensor != "complete" && sensor != "exact") {
    throw po::error("--sensor = " + sensor + ", must be full, complete or exact");
  }
  const double spacing_m = arguments["spacing"].as<double>();
  if (!(spacing_m >= 0.0005 && spacing_m <= 0.1)) {
    throw po::error("--spacing = " + std::to_string(spacing_m) + " m, must be in [0.0005, 0.1] m");
  }
  return arguments;
}

/// With the seed and the sensor that were asked for. Throws std::invalid_argument.
Scene sceneFrom(const po::variables_map& arguments) {
  const std::string path = arguments["scene"].as<std::string>();
  Scene scene = synthetic_depth::loadScene(path);
  const std::string problem = unfitness(scene);
  if (!problem.empty()) throw std::invalid_argument(path + ": " + problem);
  if (arguments.count("seed") != 0) scene.seed = static_cast<std::uint64_t>(arguments["seed"].as<std::int64_t>());
  return scene;
}

std::vector<System> systemsToCompare(const gpis_mapping::GpisConfig& config, const gpis_mapping::CameraModel& camera) {
  gpis_mapping::GpisConfig dynamic = config;
  dynamic.dynamic.enabled = true;
  gpis_mapping::GpisConfig never_deletes = config;
  never_deletes.dynamic.enabled = false;
  octomap_baseline::OctomapConfig octomap;
  octomap.sensor = config.sensor;
  return {
      {"gpis", "Dynamic GPIS", [=] { return std::make_unique<GpisMapper>(dynamic, camera); }},
      {"gpis_static", "GPIS, dynamic: false", [=] { return std::make_unique<GpisMapper>(never_deletes, camera); }},
      {"octomap", "Dynamic OctoMap", [=] { return std::make_unique<OctomapMapper>(octomap, camera); }},
  };
}

void runExperiment(const po::variables_map& arguments, Scene scene, const gpis_mapping::GpisConfig& config) {
  const std::string sensor = arguments["sensor"].as<std::string>();
  const bool is_noise_free = sensor == "exact";
  if (is_noise_free) scene.sensor = scene.sensor.withoutNoise();
  if (sensor == "complete") {
    scene.sensor.has_shadows = false;
    scene.sensor.dropout_probability = 0.0;
  }
  const Options options{arguments["out"].as<std::string>(), arguments["spacing"].as<double>(), scene.seed};
  boost::filesystem::create_directories(options.out);
  std::vector<Recorded> frames;
  for (int k = 0; k < scene.numFrames(); ++k) frames.push_back(record(scene, k));
  std::optional<Recorded> other_scan;
  if (!is_noise_free) {
    Scene other = scene;
    other.seed = scene.seed + 1;
    other_scan = record(other, scene.numFrames() - 1);
  }

  json summary = {{"scene", arguments["scene"].as<std::string>()},
                  {"out", options.out},
                  {"frames", frames.size()},
                  {"removal_frame", scene.firstRemovalFrame()},
                  {"removed_ids", scene.removedIds()},
                  {"seed", scene.seed},
                  {"sensor", sensor},
                  {"spacing_m", options.spacing_m},
                  {"T_map_camera_last", json::array()},
                  {"systems", json::object()}};
  const Eigen::Matrix4d last_pose = frames.back().T_map_camera.matrix();
  for (int row = 0; row < 4; ++row) {
    summary["T_map_camera_last"].push_back(
        {last_pose(row, 0), last_pose(row, 1), last_pose(row, 2), last_pose(row, 3)});
  }
  const GroundTruth truth(scene);
  const synthetic_depth::CameraModel& c = scene.camera;
  const gpis_mapping::CameraModel camera{c.width_px, c.height_px, c.fx_px, c.fy_px, c.cx_px, c.cy_px};
  writeBlanket(frames, config, camera, options.out);
  for (const System& system : systemsToCompare(config, camera)) {
    std::cerr << system.title << " ...\n";
    const Maps maps = runSystem(system, frames, scene.firstRemovalFrame(), other_scan);
    summary["systems"][system.key] = judge(system, maps, truth, frames.back(), options);
  }
  interactive_mapping::AtomicFile file(options.out + "/summary.json");
  file.write(summary.dump(2) + "\n");
  file.commit();
  std::cout << summary.dump() << std::endl;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const std::optional<po::variables_map> arguments = parseArguments(argc, argv);
    if (!arguments) return 0;
    Scene scene;
    gpis_mapping::GpisConfig config;
    try {
      scene = sceneFrom(*arguments);
      config = arguments->count("config") != 0 ? gpis_mapping::loadGpisConfig((*arguments)["config"].as<std::string>())
                                               : configFor(scene);
    } catch (const std::invalid_argument& error) {
      std::cerr << error.what() << "\n";
      return kBadScene;
    }
    runExperiment(*arguments, scene, config);
  } catch (const po::error& error) {
    std::cerr << "fig8_experiment: " << error.what() << "\n" << kUsage;
    return kBadUsage;
  } catch (const std::exception& error) {
    std::cerr << "fig8_experiment: " << error.what() << "\n";
    return kFailed;
  }
  return 0;
}
