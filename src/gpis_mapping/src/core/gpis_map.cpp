// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/gpis_map.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <stdexcept>

#include "gpis_mapping/parallel_for.h"

namespace gpis_mapping {
namespace {

// A surface seen at less than this cosine of incidence tells nothing about its position across itself (81 degrees).
constexpr double kMinCosine = 0.15;
constexpr double kMaxObliqueCosine = 0.5;
// Every so many pixels is a candidate for a new point. 3 px are 1.7 cm at 3 m with f = 525 px: below the spacing.
constexpr int kCandidateStridePx = 3;
constexpr double kFateSpacings = 2.5;  // neighbourhood in which the fate of doubtful points is decided
constexpr double kMinNormalVariance = 4e-4;  // 1.1 degrees: normals do not get better than the calibration
constexpr float kSameSideCosine = 0.5f;      // normals closer than 60 degrees belong to one surface
constexpr float kLateralPx = 0.3f;           // standard deviation of where in its pixel a depth was measured

class Stopwatch {
 public:
  /// Milliseconds since the last call.
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - last_).count();
    last_ = now;
    return ms;
  }

 private:
  std::chrono::steady_clock::time_point last_{std::chrono::steady_clock::now()};
};

constexpr int neighbourBit(int dx, int dy, int dz) { return (dx + 1) * 9 + (dy + 1) * 3 + (dz + 1); }

void requireRigid(const Eigen::Isometry3d& pose, double stamp_s) {
  const Eigen::Matrix3d r = pose.linear();
  if (!pose.matrix().allFinite() || !std::isfinite(stamp_s)) {
    throw std::invalid_argument("camera pose or stamp is not finite");
  }
  if (!(r.transpose() * r).isApprox(Eigen::Matrix3d::Identity(), 1e-4) || r.determinant() < 0.0) {
    throw std::invalid_argument("camera pose is no rigid motion: R^T R deviates from the identity by " +
                                std::to_string((r.transpose() * r - Eigen::Matrix3d::Identity()).norm()));
  }
}

}  // namespace

/// A cell as the updating thread sees it.
struct GpisMap::Cell {
  /// A training point, and where it stood when the cells around were last told of a change.
  struct Entry {
    SurfacePoint point;
    Eigen::Vector3d reported_position;
    float reported_std;
  };

  std::vector<Entry> entries;
  std::shared_ptr<const CellGp> gp;
  bool dirty{false};        // a point came or went: train in this update
  float num_changes{0.0f};  // points that moved or firmed up since the last training
};

/// One image and everything derived from it.
struct GpisMap::Frame {
  std::shared_ptr<const ClassifiedFrame> classified;
  std::unique_ptr<const FrameMap> map;
  Eigen::Isometry3d T_map_camera;
  Eigen::Isometry3d T_camera_map;
  float stamp_s;
};

GpisMap::GpisMap(const GpisConfig& config) : config_(config), observed_(config.observed.block_size_m) {
  requireValid(config_);
  publish();
}

GpisMap::GpisMap(MapContents contents)
    : config_(contents.config),
      observed_(std::move(contents.observed)),
      epoch_s_(contents.epoch_s),
      num_updates_(contents.num_updates) {
  requireValid(config_);
  for (const SurfacePoint& point : contents.points) {
    const LatticeKey key = LatticeKey::of(point.position_map, config_.cells.size_m);
    cells_[key].entries.push_back({point, point.position_map, std::sqrt(point.variance_m2)});
  }
  std::vector<std::pair<LatticeKey, std::uint32_t>> touched;
  for (const auto& [key, cell] : cells_) {
    std::uint32_t mask = 0;
    for (const Cell::Entry& entry : cell.entries) mask |= neighbourMask(key, entry.point.position_map);
    touched.emplace_back(key, mask);
  }
  for (const auto& [key, mask] : touched) markTouched(key, mask);
  UpdateStatistics statistics;
  train(&statistics);
  publish();
}

GpisMap::~GpisMap() = default;

std::shared_ptr<const MapSnapshot> GpisMap::snapshot() const {
  const std::lock_guard<std::mutex> lock(snapshot_mutex_);
  return snapshot_;
}

MapContents GpisMap::contents() const {
  MapContents contents;
  contents.config = config_;
  contents.epoch_s = epoch_s_;
  contents.num_updates = num_updates_;
  contents.observed = snapshot()->observed();
  for (const auto& [key, cell] : cells_) {
    for (const Cell::Entry& entry : cell.entries) contents.points.push_back(entry.point);
  }
  // The hash map's order depends on its history; a saved map must not.
  std::sort(contents.points.begin(), contents.points.end(), [](const SurfacePoint& a, const SurfacePoint& b) {
    return std::lexicographical_compare(a.position_map.data(), a.position_map.data() + 3, b.position_map.data(),
                                        b.position_map.data() + 3);
  });
  return contents;
}

void GpisMap::prepareCamera(const CameraModel& camera) {
  if (classifier_ && camera == camera_) return;
  const std::vector<std::string> problems = camera.validate();
  if (!problems.empty()) throw std::invalid_argument("impossible camera: " + problems.front());
  // Inverse range noise at the middle of the working range; FrameMap scales it tile by tile.
  const double z = 0.5 * (config_.sensor.min_range_m + config_.sensor.max_range_m);
  regressor_ =
      std::make_shared<FrameRegressor>(camera, config_.frame_map, config_.sensor.noise.sigma(z) / (z * z));
  classifier_ = std::make_unique<DepthClassifier>(camera, config_);
  camera_ = camera;
}

UpdateStatistics GpisMap::update(const DepthImage& image, const CameraModel& camera,
                                 const Eigen::Isometry3d& T_map_camera, double stamp_s) {
  requireRigid(T_map_camera, stamp_s);
  const int threads = resolveThreadCount(config_.threads);
  UpdateStatistics statistics;
  Stopwatch total;
  Stopwatch stage;
  prepareCamera(camera);
  auto classified = std::make_shared<ClassifiedFrame>(classifier_->classify(image, threads));
  statistics.points_in = classified->num_surface;
  statistics.classify_ms = stage.lap();

  if (num_updates_ == 0) epoch_s_ = stamp_s;
  Frame frame;
  frame.classified = classified;
  frame.T_map_camera = T_map_camera;
  frame.T_camera_map = T_map_camera.inverse();
  frame.stamp_s = static_cast<float>(stamp_s - epoch_s_);
  frame.map = std::make_unique<FrameMap>(regressor_, classified, config_.sensor.noise, threads);
  statistics.regress_ms = stage.lap();

  fuseAndDelete(frame, &statistics);
  statistics.fuse_ms = stage.lap();
  observed_.observe(*classified, camera_, T_map_camera, config_.sensor.max_range_m, frame.stamp_s, threads);
  statistics.observe_ms = stage.lap();
  insertNew(frame, &statistics);
  statistics.insert_ms = stage.lap();
  train(&statistics);
  statistics.train_ms = stage.lap();
  ++num_updates_;
  publish();
  statistics.publish_ms = stage.lap();
  for (const auto& [key, cell] : cells_) statistics.map_points += cell.entries.size();
  statistics.total_ms = total.lap();
  return statistics;
}

std::uint32_t GpisMap::neighbourMask(const LatticeKey& key, const Eigen::Vector3d& p_map) const {
  const double size = config_.cells.size_m;
  const double margin = config_.influenceMargin();
  const Eigen::Vector3d local = p_map - key.corner(size);
  // Per axis: does the point lie in the training region of the cell below, of its own, of the one above?
  bool reaches[3][3];
  for (int axis = 0; axis < 3; ++axis) {
    reaches[axis][0] = local[axis] < margin;
    reaches[axis][1] = true;
    reaches[axis][2] = local[axis] > size - margin;
  }
  std::uint32_t mask = 0;
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        if (reaches[0][dx + 1] && reaches[1][dy + 1] && reaches[2][dz + 1]) mask |= 1u << neighbourBit(dx, dy, dz);
      }
    }
  }
  return mask;
}

void GpisMap::markTouched(const LatticeKey& key, std::uint32_t neighbour_mask) {
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        if (neighbour_mask >> neighbourBit(dx, dy, dz) & 1u) cells_[key.offset(dx, dy, dz)].dirty = true;
      }
    }
  }
}

void GpisMap::fuseAndDelete(const Frame& frame, UpdateStatistics* statistics) {
  const double size = config_.cells.size_m;
  const double cell_radius = 0.5 * std::sqrt(3.0) * size;
  const double stray = strayTolerance();
  struct Job {
    LatticeKey key;
    Cell* cell;
    std::uint32_t neighbour_mask{0};               // cells whose training set lost a point
    std::array<std::uint16_t, 27> num_changes{};  // per neighbour: points in its training set that changed
    std::size_t fused{0};
    std::size_t occluded{0};
    std::vector<SurfacePoint> removed;
    std::vector<std::size_t> doubtful;  // indices of entries
    std::vector<Cell::Entry> moved_out;
  };
  std::vector<Job> jobs;
  const double slope_u = std::max(camera_.cx, camera_.width - camera_.cx) / camera_.fx;
  const double slope_v = std::max(camera_.cy, camera_.height - camera_.cy) / camera_.fy;
  for (auto& [key, cell] : cells_) {
    if (cell.entries.empty()) continue;
    const Eigen::Vector3d c = frame.T_camera_map * key.center(size);
    if (c.z() < -cell_radius) continue;
    if (std::abs(c.x()) - slope_u * c.z() > cell_radius * std::hypot(1.0, slope_u)) continue;
    if (std::abs(c.y()) - slope_v * c.z() > cell_radius * std::hypot(1.0, slope_v)) continue;
    jobs.push_back({key, &cell, 0, {}, 0, 0, {}, {}, {}});
  }

  enum class Outcome { kNothing, kDoubtful, kOccluded, kFused, kDeleted };
  const double floor_variance = std::pow(config_.surface.min_noise_std_m, 2);
  const double pose_variance = std::pow(config_.sensor.pose_std_m, 2);
  const double g = config_.dynamic.tolerance_sigmas;
  const Eigen::Matrix3f R_map_camera = frame.T_map_camera.linear().cast<float>();
  const Eigen::Matrix3f R_camera_map = R_map_camera.transpose();

  // One point against the frame: Algorithm 1.
  const auto confront = [&](Cell::Entry* entry) {
    SurfacePoint& point = entry->point;
    const Eigen::Vector3d p = frame.T_camera_map * point.position_map;
    if (p.z() < 0.05) return Outcome::kNothing;
    const double u = camera_.fx * p.x() / p.z() + camera_.cx;
    const double v = camera_.fy * p.y() / p.z() + camera_.cy;
    if (u < 0.0 || v < 0.0 || u > camera_.width - 1.0 || v > camera_.height - 1.0) return Outcome::kNothing;
    const int pixel_u = static_cast<int>(u + 0.5);
    const int pixel_v = static_cast<int>(v + 0.5);
    const std::size_t pixel = frame.classified->index(pixel_u, pixel_v);
    if (frame.classified->blocked[pixel]) return Outcome::kNothing;

    const double range = p.norm();
    const Eigen::Vector3f n = R_camera_map * point.normal_map;
    const double cosine = -n.cast<double>().dot(p) / range;
    // Range change per change across the surface. Bounded: what a grazing look sees past by a few centimetres is gone.
    const double across = std::max(kMaxObliqueCosine, std::abs(cosine));
    const FrameMap::Inference seen = frame.map->infer(u, v);
    const double inverse_range = 1.0 / range;
    const double own_sigma = std::sqrt(point.variance_m2 + pose_variance) / across * inverse_range * inverse_range;
    const double sigma = std::hypot(seen.sigma, own_sigma);
    const double tolerance =
        std::max(g * sigma, config_.dynamic.min_tolerance_m / across * inverse_range * inverse_range);
    // Eq 7. Near a depth edge the mean lies between the surfaces: seen past is only what is past the raw depths too.
    const double delta = inverse_range - seen.inverse_range;
    const double past =
        seen.smooth ? delta
                    : std::min<double>(delta, inverse_range - frame.map->nearestAround(pixel_u, pixel_v));
    if (past >= tolerance) {
      if (!config_.dynamic.enabled) return Outcome::kNothing;
      if (frame.classified->kind[pixel] == PixelKind::kAmbiguous && ++point.num_misses < 2) return Outcome::kNothing;
      return Outcome::kDeleted;
    }
    // Seen past by its own pixel, spared by a nearer one beside it: it shares the fate of its neighbours.
    if (inverse_range - frame.classified->inverse_range[pixel] >= tolerance) return Outcome::kDoubtful;
    if (delta <= -tolerance && seen.smooth) return Outcome::kOccluded;
    if (frame.classified->kind[pixel] != PixelKind::kSurface) return Outcome::kNothing;
    if (cosine < kMinCosine) {
      // A face turned away is hidden by its own object. Within the tolerance of what is seen it is a rim, or the foot
      // of an object that is gone: the rest of the face knows.
      return cosine < -kMinCosine && std::abs(delta) < tolerance ? Outcome::kDoubtful : Outcome::kNothing;
    }

    // Same surface: measure its offset along the stored normal.
    Eigen::Vector3d measured = p;
    Eigen::Vector3f measured_normal = n;
    double along_ray_std = 0.0;
    double normal_variance = 0.0;
    if (seen.smooth) {
      if (std::abs(delta) >= tolerance || seen.inverse_range <= 0.0) return Outcome::kNothing;
      measured = p * (inverse_range > 0.0 ? 1.0 / (seen.inverse_range * range) : 1.0);  // x_s, eq 6
      measured_normal = frame.map->trendNormal(u, v);
      along_ray_std = seen.sigma / (seen.inverse_range * seen.inverse_range);
      const double sigma_w = config_.sensor.noise.sigma(p.z()) / (p.z() * p.z());
      const double window = frame.map->regressor().window();
      normal_variance = std::pow(sigma_w * camera_.fx * p.z(), 2) * 12.0 / std::pow(window, 4);
    } else {
      LocalPlane plane;
      if (!fitLocalPlane(*frame.classified, camera_, config_.sensor.noise, pixel_u, pixel_v, config_.surface.spacing_m,
                         &plane)) {
        return Outcome::kNothing;
      }
      const double plane_range = plane.point_camera.norm();
      if (std::abs(1.0 / plane_range - inverse_range) >= tolerance) return Outcome::kNothing;
      measured_normal = plane.normal_camera;
      // The point's ray meets the fitted plane.
      const double denominator = measured_normal.cast<double>().dot(p);
      if (std::abs(denominator) < 0.05 * range) return Outcome::kNothing;
      measured = p * (measured_normal.cast<double>().dot(plane.point_camera) / denominator);
      if (std::abs(measured.norm() - range) * inverse_range * inverse_range >= tolerance) return Outcome::kNothing;
      along_ray_std = plane.depth_std_m * range / p.z();
      normal_variance = plane.normal_var;
    }
    const float agreement = measured_normal.dot(n);
    if (agreement < 0.2f) return Outcome::kDoubtful;  // another face, seen through the tolerance of this one
    const double offset = n.cast<double>().dot(measured - p);
    const double sine2 = std::max(0.0, 1.0 - cosine * cosine);
    const double lateral_std = kLateralPx * range / camera_.fx;
    const double measurement_variance =
        std::pow(along_ray_std * cosine, 2) + lateral_std * lateral_std * sine2 + pose_variance;
    const double gain = point.variance_m2 / (point.variance_m2 + measurement_variance);
    point.position_map += gain * offset * point.normal_map.cast<double>();
    point.variance_m2 = static_cast<float>(std::max(floor_variance, point.variance_m2 * (1.0 - gain)));
    normal_variance = std::max(normal_variance, kMinNormalVariance);
    if (agreement > kSameSideCosine) {
      const double w_old = 1.0 / point.normal_variance;
      const double w_new = 1.0 / normal_variance;
      const Eigen::Vector3f fused = static_cast<float>(w_old) * point.normal_map +
                                    static_cast<float>(w_new) * (R_map_camera * measured_normal);
      point.normal_map = fused.normalized();
      point.normal_variance = static_cast<float>(std::max(kMinNormalVariance, 1.0 / (w_old + w_new)));
    }
    point.last_seen_s = frame.stamp_s;
    point.num_misses = 0;
    if (point.num_looks < std::numeric_limits<std::uint16_t>::max()) ++point.num_looks;
    return Outcome::kFused;
  };

  parallelFor(jobs.size(), resolveThreadCount(config_.threads), 8, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      Job& job = jobs[i];
      std::vector<Cell::Entry>& entries = job.cell->entries;
      std::size_t kept = 0;
      for (std::size_t e = 0; e < entries.size(); ++e) {
        Cell::Entry& entry = entries[e];
        const Outcome outcome = confront(&entry);
        bool keep = true;
        if (outcome == Outcome::kDeleted) {
          job.removed.push_back(entry.point);
          job.neighbour_mask |= neighbourMask(job.key, entry.point.position_map);
          keep = false;
        } else if (outcome == Outcome::kDoubtful) {
          job.doubtful.push_back(kept);
        } else if (outcome == Outcome::kOccluded) {
          ++job.occluded;
        } else if (outcome == Outcome::kFused) {
          ++job.fused;
          const double std_now = std::sqrt(entry.point.variance_m2);
          const double moved = (entry.point.position_map - entry.reported_position).norm();
          const Eigen::Vector3d corner = job.key.corner(size);
          const Eigen::AlignedBox3d home(corner, corner + Eigen::Vector3d::Constant(size));
          const bool outside = home.squaredExteriorDistance(entry.point.position_map) > stray * stray;
          if (moved > config_.retraining.moved_sigmas * std_now ||
              std_now < config_.retraining.noise_ratio * entry.reported_std) {
            const std::uint32_t mask = neighbourMask(job.key, entry.point.position_map);
            for (std::size_t bit = 0; bit < job.num_changes.size(); ++bit) job.num_changes[bit] += mask >> bit & 1u;
            entry.reported_position = entry.point.position_map;
            entry.reported_std = static_cast<float>(std_now);
          }
          if (outside) {
            job.neighbour_mask |= neighbourMask(job.key, entry.point.position_map);
            job.moved_out.push_back(entry);
            keep = false;
          }
        }
        if (keep) {
          if (kept != e) entries[kept] = entry;
          ++kept;
        }
      }
      entries.resize(kept);
    }
  });
  for (Job& job : jobs) {
    markTouched(job.key, job.neighbour_mask);
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dz = -1; dz <= 1; ++dz) {
          const std::uint16_t changes = job.num_changes[static_cast<std::size_t>(neighbourBit(dx, dy, dz))];
          if (changes == 0) continue;
          const auto cell = cells_.find(job.key.offset(dx, dy, dz));
          if (cell != cells_.end()) cell->second.num_changes += changes;
        }
      }
    }
    statistics->fused += job.fused;
    statistics->occluded += job.occluded;
    for (const Cell::Entry& entry : job.moved_out) {
      const LatticeKey key = LatticeKey::of(entry.point.position_map, size);
      cells_[key].entries.push_back(entry);
      markTouched(key, neighbourMask(key, entry.point.position_map));
    }
  }

  // Doubtful points lie within a few pixels of a depth edge, where one image cannot decide. The face they belong to
  // can: it goes when more of it was removed than confirmed by this frame.
  std::unordered_map<LatticeKey, std::vector<SurfacePoint>, LatticeKeyHash> removed;
  for (const Job& job : jobs) {
    if (!job.removed.empty()) removed[job.key] = job.removed;
  }
  const double reach = kFateSpacings * config_.surface.spacing_m;
  for (const Job& job : jobs) {
    if (removed.empty()) break;
    std::vector<std::size_t> gone;
    for (const std::size_t index : job.doubtful) {
      const SurfacePoint& point = job.cell->entries[index].point;
      const auto sameFace = [&](const SurfacePoint& other) {
        return (other.position_map - point.position_map).squaredNorm() < reach * reach &&
               other.normal_map.dot(point.normal_map) > kSameSideCosine;
      };
      std::size_t num_removed = 0;
      std::size_t num_confirmed = 0;
      for (int dx = -1; dx <= 1; ++dx) {
        for (int dy = -1; dy <= 1; ++dy) {
          for (int dz = -1; dz <= 1; ++dz) {
            const LatticeKey key = job.key.offset(dx, dy, dz);
            const auto gone_here = removed.find(key);
            if (gone_here != removed.end()) {
              num_removed += static_cast<std::size_t>(
                  std::count_if(gone_here->second.begin(), gone_here->second.end(), sameFace));
            }
            const auto cell = cells_.find(key);
            if (cell == cells_.end()) continue;
            for (const Cell::Entry& entry : cell->second.entries) {
              num_confirmed += entry.point.last_seen_s == frame.stamp_s && sameFace(entry.point);
            }
          }
        }
      }
      if (num_removed > num_confirmed) gone.push_back(index);
    }
    for (auto index = gone.rbegin(); index != gone.rend(); ++index) {
      std::vector<Cell::Entry>& entries = job.cell->entries;
      statistics->removed_points_map.push_back(entries[*index].point.position_map);
      markTouched(job.key, neighbourMask(job.key, entries[*index].point.position_map));
      entries.erase(entries.begin() + static_cast<std::ptrdiff_t>(*index));
    }
  }
  for (const Job& job : jobs) {
    for (const SurfacePoint& point : job.removed) statistics->removed_points_map.push_back(point.position_map);
  }
  statistics->deleted = statistics->removed_points_map.size();
}

bool GpisMap::hasNeighbour(const Eigen::Vector3d& p_map, const Eigen::Vector3f& normal_map, double spacings) const {
  const double size = config_.cells.size_m;
  const double spacing = spacings * config_.surface.spacing_m;
  const Eigen::Vector3d reach = Eigen::Vector3d::Constant(spacing + strayTolerance());
  const LatticeKey low = LatticeKey::of(p_map - reach, size);
  const LatticeKey high = LatticeKey::of(p_map + reach, size);
  for (LatticeKey key = low; key.x <= high.x; ++key.x) {
    for (key.y = low.y; key.y <= high.y; ++key.y) {
      for (key.z = low.z; key.z <= high.z; ++key.z) {
        const auto found = cells_.find(key);
        if (found == cells_.end()) continue;
        for (const Cell::Entry& entry : found->second.entries) {
          const double distance2 = (entry.point.position_map - p_map).squaredNorm();
          if (distance2 > spacing * spacing) continue;
          // Two faces that meet at an edge both need points near it.
          if (distance2 < 0.25 * spacing * spacing || entry.point.normal_map.dot(normal_map) > kSameSideCosine) {
            return true;
          }
        }
      }
    }
  }
  return false;
}

void GpisMap::insertNew(const Frame& frame, UpdateStatistics* statistics) {
  const ClassifiedFrame& image = *frame.classified;
  const int stride = kCandidateStridePx;
  const int rows = (image.height + stride - 1) / stride;
  const double max_range = config_.sensor.max_range_m;
  const double pose_variance = std::pow(config_.sensor.pose_std_m, 2);
  const double floor_variance = std::pow(config_.surface.min_noise_std_m, 2);
  const Eigen::AlignedBox3d region(config_.region.min_m, config_.region.max_m);
  const Eigen::Matrix3f R_map_camera = frame.T_map_camera.linear().cast<float>();
  std::vector<std::vector<SurfacePoint>> candidates(static_cast<std::size_t>(rows));

  parallelFor(candidates.size(), resolveThreadCount(config_.threads), 4, [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row) {
      const int v = static_cast<int>(row) * stride;
      for (int u = 0; u < image.width; u += stride) {
        const std::size_t pixel = image.index(u, v);
        if (image.kind[pixel] != PixelKind::kSurface || image.blocked[pixel]) continue;
        const Eigen::Vector3d ray((u - camera_.cx) / camera_.fx, (v - camera_.cy) / camera_.fy, 1.0);
        const double length = ray.norm();
        if (image.inverse_depth[pixel] * max_range * length < 0.95) continue;
        // Cheap test first: most pixels show what the map has already. The raw depth is good enough for it.
        const bool is_smooth = frame.map->isSmooth(u, v);
        if (is_smooth && hasNeighbour(frame.T_map_camera * (ray / image.inverse_depth[pixel]),
                                      R_map_camera * frame.map->trendNormal(u, v), 0.8)) {
          continue;
        }
        const FrameMap::Inference seen = frame.map->infer(u, v);
        Eigen::Vector3d p;
        Eigen::Vector3f n;
        double along_ray_std;
        double normal_variance;
        if (seen.smooth) {
          if (seen.inverse_range * max_range < 1.0) continue;
          p = ray / (length * seen.inverse_range);
          n = frame.map->trendNormal(u, v);
          if (hasNeighbour(frame.T_map_camera * p, R_map_camera * n, 1.0)) continue;
          along_ray_std = seen.sigma / (seen.inverse_range * seen.inverse_range);
          const double sigma_w = config_.sensor.noise.sigma(p.z()) / (p.z() * p.z());
          normal_variance =
              std::pow(sigma_w * camera_.fx * p.z(), 2) * 12.0 / std::pow(frame.map->regressor().window(), 4);
        } else {
          if (image.inverse_range[pixel] * max_range < 1.0) continue;
          LocalPlane plane;
          if (!fitLocalPlane(image, camera_, config_.sensor.noise, u, v, config_.surface.spacing_m, &plane)) continue;
          p = plane.point_camera;
          n = plane.normal_camera;
          if (hasNeighbour(frame.T_map_camera * p, R_map_camera * n, 1.0)) continue;
          along_ray_std = plane.depth_std_m * length;
          normal_variance = plane.normal_var;
        }
        const double cosine = -n.cast<double>().dot(p) / p.norm();
        if (cosine < 0.5 * kMinCosine) continue;
        const Eigen::Vector3d p_map = frame.T_map_camera * p;
        if (!region.contains(p_map)) continue;
        const double lateral_std = kLateralPx * p.norm() / camera_.fx;
        SurfacePoint point;
        point.position_map = p_map;
        point.normal_map = R_map_camera * n;
        point.variance_m2 = static_cast<float>(std::max(
            floor_variance, std::pow(along_ray_std * cosine, 2) + lateral_std * lateral_std * (1.0 - cosine * cosine) +
                                pose_variance));
        point.normal_variance = static_cast<float>(std::max(kMinNormalVariance, normal_variance));
        point.last_seen_s = frame.stamp_s;
        candidates[row].push_back(point);
      }
    }
  });

  // In image order, so that the result does not depend on the number of threads.
  const double size = config_.cells.size_m;
  const double block = config_.observed.block_size_m;
  for (const std::vector<SurfacePoint>& row : candidates) {
    for (const SurfacePoint& point : row) {
      if (hasNeighbour(point.position_map, point.normal_map, 1.0)) continue;
      const LatticeKey key = LatticeKey::of(point.position_map, size);
      cells_[key].entries.push_back({point, point.position_map, std::sqrt(point.variance_m2)});
      markTouched(key, neighbourMask(key, point.position_map));
      ++statistics->inserted;
      // What was free before is not free behind a new surface.
      for (double depth = 0.5 * block; depth < config_.query.occupied_depth_m; depth += block) {
        observed_.occupy(point.position_map - depth * point.normal_map.cast<double>());
      }
    }
  }
}

void GpisMap::train(UpdateStatistics* statistics) {
  const double size = config_.cells.size_m;
  const double margin = config_.influenceMargin();
  const double training_margin = config_.cells.training_margin_m;
  // A cell without points of its own still serves queries next to its neighbour's surface.
  const double needed = std::min(margin, 2.0 * config_.surface.spacing_m);
  struct Job {
    LatticeKey key;
    Cell* cell;
    bool empty{false};
  };
  std::vector<Job> jobs;
  for (auto& [key, cell] : cells_) {
    const bool changed_enough =
        cell.gp && cell.num_changes > config_.retraining.changed_share * static_cast<double>(cell.gp->size());
    if (cell.dirty || changed_enough) jobs.push_back({key, &cell});
  }
  parallelFor(jobs.size(), resolveThreadCount(config_.threads), 4, [&](std::size_t begin, std::size_t end) {
    std::vector<const SurfacePoint*> points;
    std::vector<const SurfacePoint*> mean_only;
    for (std::size_t i = begin; i < end; ++i) {
      Job& job = jobs[i];
      points.clear();
      mean_only.clear();
      for (const Cell::Entry& entry : job.cell->entries) points.push_back(&entry.point);
      const std::size_t num_own = points.size();
      const Eigen::Vector3d corner = job.key.corner(size);
      const Eigen::AlignedBox3d box(corner, corner + Eigen::Vector3d::Constant(size));
      bool is_needed = num_own > 0;
      for (int dx = -1; dx <= 1; ++dx) {
        for (int dy = -1; dy <= 1; ++dy) {
          for (int dz = -1; dz <= 1; ++dz) {
            if (dx == 0 && dy == 0 && dz == 0) continue;
            const auto found = cells_.find(job.key.offset(dx, dy, dz));
            if (found == cells_.end()) continue;
            for (const Cell::Entry& entry : found->second.entries) {
              const double outside = box.exteriorDistance(entry.point.position_map);
              if (outside < training_margin) {
                points.push_back(&entry.point);
              } else if (outside < margin) {
                mean_only.push_back(&entry.point);
              }
              is_needed = is_needed || outside < needed;
            }
          }
        }
      }
      job.empty = !is_needed;
      const std::size_t num_training = points.size();
      points.insert(points.end(), mean_only.begin(), mean_only.end());
      job.cell->gp =
          is_needed ? std::make_shared<CellGp>(job.key, config_, points, num_own, num_training) : nullptr;
      job.cell->dirty = false;
      job.cell->num_changes = 0.0f;
    }
  });
  for (const Job& job : jobs) {
    if (job.empty) {
      cells_.erase(job.key);
      continue;
    }
    ++statistics->cells_retrained;
  }
}

void GpisMap::publish() {
  MapSnapshot::Cells cells;
  cells.reserve(cells_.size());
  for (const auto& [key, cell] : cells_) {
    if (cell.gp) cells.emplace(key, cell.gp);
  }
  auto next = std::make_shared<const MapSnapshot>(config_, std::move(cells), observed_.share(), epoch_s_, num_updates_);
  const std::lock_guard<std::mutex> lock(snapshot_mutex_);
  snapshot_ = std::move(next);
}

}  // namespace gpis_mapping
