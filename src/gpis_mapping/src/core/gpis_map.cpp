// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/gpis_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <optional>
#include <set>
#include <sstream>
#include <stdexcept>

#include <interactive_mapping_common/geometry/rigid_motion.h>
#include <interactive_mapping_common/stopwatch.h>
#include <interactive_mapping_common/threads/parallel_for.h>
#include "gpis_mapping/point_update.h"
#include "gpis_mapping/vanished_surface.h"
#include "insertion_grid.h"

namespace gpis_mapping {
namespace {

using interactive_mapping::parallelFor;
using interactive_mapping::requireRigid;
using interactive_mapping::resolveThreadCount;
using interactive_mapping::Stopwatch;

constexpr double kMinInsertCosine = 0.075;  // what is seen at a flatter angle than 86 degrees is not inserted
constexpr double kKnownSpacings = 0.8;      // a pixel this near to a point of the map need not be measured
constexpr int kFullImages = 10;             // after as many, a pixel that has not measured is a margin of the sensor
constexpr double kFateSpacings = 2.5;       // neighbourhood in which the fate of doubtful points is decided
constexpr std::uint64_t kFateUpdates = 10;  // how long a removed face speaks for what is left of it
// Points of one face nearer than this are too many, of two faces at half of it: a little less than insertion keeps, so
// that none comes and goes.
constexpr double kLeastSpacings = 0.9;
constexpr std::uint64_t kThinningPeriod = 8;  // each cell is looked through every so many updates; crowding takes hours
constexpr std::size_t kMisalignmentPoints = 3000;  // about so many tell how far a frame lies off the map
constexpr double kFineLattice_m = 1e-5;            // to choose them by position; reaches 10 km
// A frame this far off the map as a whole is displaced. So many running are right, and the map is wrong.
constexpr double kDisplaced_m = 0.02;
constexpr int kMaxDisplaced = 5;
constexpr int kMaxSuspectLooks = 2;      // a small piece that is missing goes at the second look running
constexpr int kBlanketStride_px = 4;     // a tile of the 2.5D^-1 map
constexpr double kMaxMotionGap_s = 1.0;  // poses farther apart in time tell nothing about the camera's speed

constexpr int neighbourBit(int dx, int dy, int dz) {
  return (dx + 1) * 9 + (dy + 1) * 3 + (dz + 1);
}

void requireBox(const Eigen::Isometry3d& T_map_box, const Eigen::Vector3d& size_m) {
  requireRigid(T_map_box, "pose of the box");
  if (size_m.allFinite() && size_m.minCoeff() > 0.0) return;
  std::ostringstream text;
  text << "size of the box = " << size_m.transpose() << " m, must be finite and > 0 m along each axis";
  throw std::invalid_argument(text.str());
}

auto inBox(const Eigen::Isometry3d& T_map_box, const Eigen::Vector3d& size_m) {
  return [T_box_map = T_map_box.inverse(), half = Eigen::Array3d(0.5 * size_m)](const Eigen::Vector3d& p_map) {
    return ((T_box_map * p_map).cwiseAbs().array() <= half).all();
  };
}

/// In the box, or where it was on its straight way to it, `moved_m` long.
auto inSweptBox(const Eigen::Isometry3d& T_map_box, const Eigen::Vector3d& size_m, const Eigen::Vector3d& moved_m) {
  return [T_box_map = T_map_box.inverse(), half = Eigen::Array3d(0.5 * size_m),
          moved = Eigen::Array3d(T_map_box.linear().transpose() * moved_m)](const Eigen::Vector3d& p_map) {
    const Eigen::Array3d p = (T_box_map * p_map).array();
    double first = 0.0, last = 1.0;  // shares of the way for which the box, drawn back by them, holds the point
    for (int i = 0; i < 3; ++i) {
      if (moved[i] == 0.0) {
        if (std::abs(p[i]) > half[i]) return false;
        continue;
      }
      const double a = (-half[i] - p[i]) / moved[i];
      const double b = (half[i] - p[i]) / moved[i];
      first = std::max(first, std::min(a, b));
      last = std::min(last, std::max(a, b));
    }
    return first <= last;
  };
}

}  // namespace

/// What a frame does to one cell.
struct GpisMap::CellUpdate {
  LatticeKey key;
  Cell* cell;
  std::uint32_t neighbour_mask{0};              // cells whose training set lost a point
  std::array<std::uint16_t, 27> num_changes{};  // per neighbour: points in its training set that changed
  std::size_t fused{0};
  std::size_t occluded{0};
  std::vector<SurfacePoint> removed;
  // Indices of entries.
  std::vector<std::size_t> doubtful;
  std::vector<std::size_t> confirmed;  // without being fused
  std::vector<std::size_t> unseen;     // in holes of the image
  std::vector<std::size_t> missing;    // of these: due
  std::vector<std::size_t> gone;
  std::vector<Cell::Entry> moved_out;

  void fuse(const GpisMap& map, const Frame& frame);
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
  eye_.view = std::move(contents.view);
  for (const SurfacePoint& point : contents.points) {
    const LatticeKey key = config_.cells.at(point.position_map);
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
  if (camera_index_ == 0) {
    contents.view = eye_.view;
  } else if (const auto first = other_eyes_.find(0); first != other_eyes_.end()) {
    contents.view = first->second.view;
  }
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

void GpisMap::selectCamera(std::size_t index) {
  if (index == camera_index_) return;
  other_eyes_[camera_index_] = std::move(eye_);
  eye_ = std::move(other_eyes_[index]);  // a new one, if it has not looked yet
  other_eyes_.erase(index);
  camera_index_ = index;
}

void GpisMap::prepareCamera(const CameraModel& camera) {
  if (eye_.classifier && camera == eye_.camera) return;
  // Inverse range noise at the middle of the working range; FrameMap scales it tile by tile.
  const double z = 0.5 * (config_.sensor.min_range_m + config_.sensor.max_range_m);
  auto regressor = std::make_shared<FrameRegressor>(camera, config_.frame_map, config_.sensor.noise.sigma(z) / (z * z));
  eye_.classifier = std::make_unique<DepthClassifier>(camera, config_);
  eye_.regressor = std::move(regressor);
  if (!(camera == eye_.view.camera)) {
    eye_.view.camera = camera;
    eye_.view.pixel_history.assign(static_cast<std::size_t>(camera.width) * camera.height, PixelHistory::kUnknown);
    eye_.view.num_surface = 0;
    eye_.view.num_full = 0;
  }
  eye_.camera = camera;
}

UpdateStatistics GpisMap::update(const DepthImage& image, const CameraModel& camera,
                                 const Eigen::Isometry3d& T_map_camera, double stamp_s, FrameBlanket* blanket,
                                 std::size_t camera_index) {
  requireRigid(T_map_camera, "camera pose");
  if (!(std::abs(stamp_s) <= kMaxStamp_s)) {  // true for NaN
    std::ostringstream text;
    text << "stamp = " << stamp_s << " s, must be in [" << -kMaxStamp_s << ", " << kMaxStamp_s << "] s";
    throw std::invalid_argument(text.str());
  }
  const std::vector<std::string> problems = camera.validate();
  if (!problems.empty()) throw std::invalid_argument("impossible camera: " + problems.front());
  requireFits(image, camera);  // before tables of the camera's size are made
  const int threads = resolveThreadCount(config_.threads);
  UpdateStatistics statistics;
  Stopwatch total;
  Stopwatch stage;
  selectCamera(camera_index);
  prepareCamera(camera);
  auto classified = std::make_shared<ClassifiedFrame>(eye_.classifier->classify(image, threads));
  statistics.points_in = classified->num_surface;
  statistics.view_box_map = eye_.classifier->viewBox(*classified, T_map_camera);
  statistics.classify_ms = stage.lapMs();

  if (num_updates_ == 0) epoch_s_ = stamp_s;
  Frame frame(config_, classified, eye_.regressor, eye_.view.pixel_history, T_map_camera,
              motionTo(T_map_camera, stamp_s), static_cast<float>(stamp_s - epoch_s_), threads);
  eye_.view.T_map_camera = T_map_camera;
  eye_.view.stamp_s = stamp_s;
  statistics.regress_ms = stage.lapMs();

  allowForMisalignment(&frame);
  if (blanket != nullptr) *blanket = frame.blanket(kBlanketStride_px);
  fuseAndDelete(frame, classified.get(), &statistics);
  learnView(*classified);
  statistics.fuse_ms = stage.lapMs();
  observed_.observe(*classified, eye_.camera, T_map_camera, config_.sensor.max_range_m, frame.stamp(), threads);
  statistics.observe_ms = stage.lapMs();
  insertNew(frame, &statistics);
  statistics.insert_ms = stage.lapMs();
  train(&statistics);
  statistics.train_ms = stage.lapMs();
  ++num_updates_;
  publish();
  statistics.publish_ms = stage.lapMs();
  statistics.map_points = trained_.numPoints();
  statistics.cells_looked_at = cells_.numLookedAt();
  statistics.total_ms = total.lapMs();
  return statistics;
}

std::vector<Eigen::Vector3d> GpisMap::clearBox(const Eigen::Isometry3d& T_map_box, const Eigen::Vector3d& size_m) {
  requireBox(T_map_box, size_m);
  const auto isInside = inBox(T_map_box, size_m);
  const std::vector<Eigen::Vector3d> removed = removePoints(isInside);
  observed_.forgetIf(isInside);
  UpdateStatistics statistics;
  train(&statistics);
  publish();
  return removed;
}

std::vector<Eigen::Vector3d> GpisMap::takeOut(const Eigen::Isometry3d& T_map_box, const Eigen::Vector3d& size_m,
                                              double padding_m, double stamp_s, const Eigen::Vector3d& moved_m) {
  requireBox(T_map_box, size_m);
  constexpr double kMaxEdge_m = 2.0;  // of what a gripper takes; each block in it is listed
  if (size_m.maxCoeff() > kMaxEdge_m) {
    std::ostringstream text;
    text << "size of the box = " << size_m.transpose() << " m, must be at most " << kMaxEdge_m << " m along each axis";
    throw std::invalid_argument(text.str());
  }
  if (!std::isfinite(padding_m) || padding_m < 0.0 || !std::isfinite(stamp_s) || !moved_m.allFinite()) {
    throw std::invalid_argument("padding = " + std::to_string(padding_m) + " m, stamp = " + std::to_string(stamp_s) +
                                " s, moved by " + std::to_string(moved_m.norm()) +
                                " m, must be finite and the padding >= 0 m");
  }
  const double block = observed_.blockSize();
  const auto isTaken = inBox(T_map_box, size_m);
  // Blocks with a centre in the box, and those beside it that are free as the map is now.
  const Eigen::Vector3d reach = 0.5 * (T_map_box.linear().cwiseAbs() * size_m) +
                                Eigen::Vector3d::Constant(padding_m + block) + moved_m.cwiseAbs();
  const Eigen::Array3i first = ((T_map_box.translation() - reach) / block).array().floor().cast<int>();
  const Eigen::Array3i last = ((T_map_box.translation() + reach) / block).array().floor().cast<int>();
  std::vector<Eigen::Vector3d> taken, beside;
  for (int z = first.z(); z <= last.z(); ++z) {
    for (int y = first.y(); y <= last.y(); ++y) {
      for (int x = first.x(); x <= last.x(); ++x) {
        const Eigen::Vector3d center = (Eigen::Array3d(x, y, z) + 0.5).matrix() * block;
        (isTaken(center) ? taken : beside).push_back(center);
      }
    }
  }
  Points3d at(3, static_cast<Eigen::Index>(beside.size()));
  for (std::size_t i = 0; i < beside.size(); ++i) at.col(static_cast<Eigen::Index>(i)) = beside[i];
  const QueryResult before = snapshot()->query(at);
  for (std::size_t i = 0; i < beside.size(); ++i) {
    if (before.state[i] == SpaceState::kFree) taken.push_back(beside[i]);
  }
  const std::vector<Eigen::Vector3d> removed =
      removePoints(inSweptBox(T_map_box, size_m.array() + 2.0 * padding_m, moved_m));
  for (const Eigen::Vector3d& center : taken) observed_.setFree(center, static_cast<float>(stamp_s - epoch_s_));
  UpdateStatistics statistics;
  train(&statistics);
  publish();
  return removed;
}

std::vector<Eigen::Vector3d> GpisMap::removePoints(const std::function<bool(const Eigen::Vector3d&)>& isInside) {
  std::vector<Eigen::Vector3d> removed;
  std::vector<std::pair<LatticeKey, std::uint32_t>> touched;
  for (auto& [key, cell] : cells_) {
    std::uint32_t mask = 0;
    std::vector<Cell::Entry> kept;
    for (const Cell::Entry& entry : cell.entries) {
      if (!isInside(entry.point.position_map)) {
        kept.push_back(entry);
        continue;
      }
      mask |= neighbourMask(key, entry.point.position_map);
      removed.push_back(entry.point.position_map);
    }
    if (mask == 0) continue;
    cell.entries = std::move(kept);
    touched.emplace_back(key, mask);
  }
  for (const auto& [key, mask] : touched) markTouched(key, mask);
  return removed;
}

void GpisMap::retune(const GpisConfig::Sensor& sensor, const GpisConfig::Dynamic& dynamic) {
  GpisConfig config = config_;
  config.sensor = sensor;
  config.dynamic = dynamic;
  requireValid(config);
  config_ = config;
  // Made again for the next image.
  eye_.classifier.reset();
  for (auto& [index, eye] : other_eyes_) eye.classifier.reset();
}

std::uint32_t GpisMap::neighbourMask(const LatticeKey& key, const Eigen::Vector3d& p_map) const {
  const double size = config_.cells.size_m;
  const double margin = config_.influenceMargin();
  const Eigen::Array3d local = (p_map - config_.cells.corner(key)).array();
  // Per axis the square of how far outside the cell below, its own, the one above the point lies.
  const Eigen::Array3d outside[3] = {local.max(0.0).square(), (-local).max(local - size).max(0.0).square(),
                                     (size - local).max(0.0).square()};
  std::uint32_t mask = 1u << neighbourBit(0, 0, 0);
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        const double distance2 = outside[dx + 1].x() + outside[dy + 1].y() + outside[dz + 1].z();
        if (distance2 < margin * margin) mask |= 1u << neighbourBit(dx, dy, dz);
      }
    }
  }
  return mask;
}

void GpisMap::markTouched(const LatticeKey& key, std::uint32_t neighbour_mask) {
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        if ((neighbour_mask >> neighbourBit(dx, dy, dz) & 1u) == 0) continue;
        const LatticeKey neighbour = key.offset(dx, dy, dz);
        Cell& cell = cells_[neighbour];
        if (!cell.dirty) to_train_.push_back(neighbour);
        cell.dirty = true;
      }
    }
  }
}

CameraMotion GpisMap::motionTo(const Eigen::Isometry3d& T_map_camera, double stamp_s) const {
  const double dt = stamp_s - eye_.view.stamp_s;
  if (!(dt > 0.0 && dt < kMaxMotionGap_s)) return {};
  const Eigen::Isometry3d moved = eye_.view.T_map_camera.inverse() * T_map_camera;
  return {moved.translation().norm() / dt, Eigen::AngleAxisd(moved.linear()).angle() / dt};
}

void GpisMap::allowForMisalignment(Frame* frame) {
  std::vector<const SurfacePoint*> points;  // in view
  for (const CellMap::value_type* const cell : cellsInView(*frame)) {
    for (const Cell::Entry& entry : cell->second.entries) {
      if (frame->pixelOf(entry.point.position_map)) points.push_back(&entry.point);
    }
  }
  // A sample by position: it must not depend on cells and their order, which the map's history decides.
  const std::size_t share = std::max<std::size_t>(1, points.size() / kMisalignmentPoints);
  const auto isLeftOut = [share](const SurfacePoint* point) {
    return LatticeKeyHash()(LatticeKey::of(point->position_map, kFineLattice_m)) % share != 0;
  };
  points.erase(std::remove_if(points.begin(), points.end(), isLeftOut), points.end());
  std::sort(points.begin(), points.end(), [](const SurfacePoint* a, const SurfacePoint* b) {
    return std::lexicographical_compare(a->position_map.data(), a->position_map.data() + 3, b->position_map.data(),
                                        b->position_map.data() + 3);
  });
  const Frame::Misalignment misalignment = frame->measureMisalignment(points);
  eye_.view.num_displaced = misalignment.rms_m > kDisplaced_m ? eye_.view.num_displaced + 1 : 0;
  frame->allowFor(eye_.view.num_displaced <= kMaxDisplaced ? misalignment : Frame::Misalignment());
}

void GpisMap::learnView(const ClassifiedFrame& pixels) {
  if (pixels.num_surface > 0) eye_.view.num_surface = pixels.num_surface;
  const bool is_full = 2 * pixels.num_surface > pixels.kind.size();
  eye_.view.num_full = std::min(eye_.view.num_full + is_full, kFullImages);
  const double half_width = config_.sensor.fov_width_rad > 0.0 ? 0.5 * config_.sensor.fov_width_rad : M_PI_2;
  const double half_height = config_.sensor.fov_height_rad > 0.0 ? 0.5 * config_.sensor.fov_height_rad : M_PI_2;
  const double reach_u = std::tan(half_width) * eye_.camera.fx;
  const double reach_v = std::tan(half_height) * eye_.camera.fy;
  for (int v = 0; v < pixels.height; ++v) {
    const bool is_row_in_view = std::abs(v - eye_.camera.cy) <= reach_v;
    for (int u = 0; u < pixels.width; ++u) {
      const std::size_t i = pixels.index(u, v);
      PixelHistory& history = eye_.view.pixel_history[i];
      if (pixels.kind[i] == PixelKind::kSurface && is_row_in_view && std::abs(u - eye_.camera.cx) <= reach_u) {
        history = PixelHistory::kMeasures;
      } else if (history == PixelHistory::kUnknown && eye_.view.num_full == kFullImages) {
        history = PixelHistory::kNeverMeasures;
      }
    }
  }
}

std::vector<GpisMap::CellMap::value_type*> GpisMap::cellsInView(const Frame& frame) {
  const double size = config_.cells.size_m;
  const double slope_u = std::max(eye_.camera.cx, eye_.camera.width - eye_.camera.cx) / eye_.camera.fx;
  const double slope_v = std::max(eye_.camera.cy, eye_.camera.height - eye_.camera.cy) / eye_.camera.fy;
  const double widening_u = std::sqrt(1.0 + slope_u * slope_u);
  const double widening_v = std::sqrt(1.0 + slope_v * slope_v);
  const auto mayShow = [&](const Eigen::Vector3d& center_map, double radius) {
    const Eigen::Vector3d c = frame.T_camera_map() * center_map;
    return c.z() >= -radius && std::abs(c.x()) - slope_u * c.z() <= radius * widening_u &&
           std::abs(c.y()) - slope_v * c.z() <= radius * widening_v;
  };
  const double half_diagonal = 0.5 * std::sqrt(3.0) * size;
  std::vector<CellMap::value_type*> cells = cells_.select(
      [&](const Eigen::Vector3d& center, int side) { return mayShow(size * center, half_diagonal * (side + 0.1)); },
      [&](const LatticeKey& key) { return mayShow(config_.cells.center(key), half_diagonal); });
  const auto isEmpty = [](const CellMap::value_type* cell) { return cell->second.entries.empty(); };
  cells.erase(std::remove_if(cells.begin(), cells.end(), isEmpty), cells.end());
  return cells;
}

void GpisMap::CellMap::erase(const LatticeKey& key) {
  const auto found = cells_.find(key);
  if (found == cells_.end()) return;
  const auto block = blocks_.find(blockOf(key));
  std::vector<value_type*>& cells = block->second;
  *std::find(cells.begin(), cells.end(), &*found) = cells.back();
  cells.pop_back();
  if (cells.empty()) blocks_.erase(block);
  cells_.erase(found);
}

/// What the image tells of each point of the cell; keeps those that stay in it.
void GpisMap::CellUpdate::fuse(const GpisMap& map, const Frame& frame) {
  std::vector<Cell::Entry>& entries = cell->entries;
  const double stray = map.strayTolerance();
  std::size_t kept = 0;
  for (std::size_t e = 0; e < entries.size(); ++e) {
    Cell::Entry& entry = entries[e];
    const PointOutcome outcome = frame.apply(&entry.point);
    bool keep = true;
    if (outcome == PointOutcome::kDeleted) {
      removed.push_back(entry.point);
      neighbour_mask |= map.neighbourMask(key, entry.point.position_map);
      keep = false;
    } else if (outcome == PointOutcome::kDoubtful) {
      doubtful.push_back(kept);
    } else if (outcome == PointOutcome::kUnseen || outcome == PointOutcome::kMissing) {
      unseen.push_back(kept);
      if (outcome == PointOutcome::kMissing) missing.push_back(kept);
    } else if (outcome == PointOutcome::kConfirmed) {
      confirmed.push_back(kept);
    } else if (outcome == PointOutcome::kOccluded) {
      ++occluded;
    } else if (outcome == PointOutcome::kFused) {
      ++fused;
      entry.fused_in = static_cast<std::uint32_t>(map.num_updates_ + 1);
      const double std_now = std::sqrt(entry.point.variance_m2);
      const double moved = (entry.point.position_map - entry.reported_position).norm();
      const Eigen::AlignedBox3d home = map.config_.cells.box(key);
      const bool outside = home.squaredExteriorDistance(entry.point.position_map) > stray * stray;
      if (moved > map.config_.retraining.moved_sigmas * std_now ||
          std_now < map.config_.retraining.noise_ratio * entry.reported_std) {
        const std::uint32_t mask = map.neighbourMask(key, entry.point.position_map);
        for (std::size_t bit = 0; bit < num_changes.size(); ++bit) num_changes[bit] += mask >> bit & 1u;
        entry.reported_position = entry.point.position_map;
        entry.reported_std = static_cast<float>(std_now);
      }
      if (outside) {
        neighbour_mask |= map.neighbourMask(key, entry.point.position_map);
        moved_out.push_back(entry);
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

void GpisMap::fuseAndDelete(const Frame& frame, ClassifiedFrame* pixels, UpdateStatistics* statistics) {
  std::vector<CellUpdate> jobs;
  for (CellMap::value_type* const cell : cellsInView(frame)) {
    jobs.emplace_back();
    jobs.back().key = cell->first;
    jobs.back().cell = &cell->second;
  }

  parallelFor(jobs.size(), resolveThreadCount(config_.threads), 8, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) jobs[i].fuse(*this, frame);
  });
  for (CellUpdate& job : jobs) {
    markTouched(job.key, job.neighbour_mask);
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dz = -1; dz <= 1; ++dz) {
          const std::uint16_t changes = job.num_changes[static_cast<std::size_t>(neighbourBit(dx, dy, dz))];
          if (changes == 0) continue;
          const auto cell = cells_.find(job.key.offset(dx, dy, dz));
          if (cell == cells_.end()) continue;
          cell->second.num_changes += changes;
          to_train_.push_back(cell->first);
        }
      }
    }
    statistics->fused += job.fused;
    statistics->occluded += job.occluded;
    for (const Cell::Entry& entry : job.moved_out) {
      const LatticeKey key = config_.cells.at(entry.point.position_map);
      cells_[key].entries.push_back(entry);
      markTouched(key, neighbourMask(key, entry.point.position_map));
    }
  }

  rememberRemoved(jobs);
  judgeHoles(frame, pixels, &jobs);
  decideDoubtful(&jobs);
  for (CellUpdate& job : jobs) {
    std::sort(job.gone.begin(), job.gone.end());
    std::vector<Cell::Entry>& entries = job.cell->entries;
    for (auto index = job.gone.rbegin(); index != job.gone.rend(); ++index) {
      markTouched(job.key, neighbourMask(job.key, entries[*index].point.position_map));
      entries.erase(entries.begin() + static_cast<std::ptrdiff_t>(*index));
    }
    for (const SurfacePoint& point : job.removed) statistics->removed_points_map.push_back(point.position_map);
  }
  thinOut(jobs);
  statistics->deleted = statistics->removed_points_map.size();
}

void GpisMap::rememberRemoved(const std::vector<CellUpdate>& jobs) {
  for (auto cell = recently_removed_.begin(); cell != recently_removed_.end();) {
    std::vector<RemovedPoint>& points = cell->second;
    points.erase(std::remove_if(points.begin(), points.end(),
                                [this](const RemovedPoint& p) { return num_updates_ - p.update >= kFateUpdates; }),
                 points.end());
    cell = points.empty() ? recently_removed_.erase(cell) : std::next(cell);
  }
  for (const CellUpdate& job : jobs) {
    for (const SurfacePoint& point : job.removed) recently_removed_[job.key].push_back({num_updates_, point});
  }
}

void GpisMap::judgeHoles(const Frame& frame, ClassifiedFrame* pixels, std::vector<CellUpdate>* jobs) {
  // Objects leave; a whole view does not. The sensor has failed.
  if (pixels->num_surface == 0 && 2 * eye_.view.num_surface > pixels->kind.size()) return;
  const double reach = kFateSpacings * config_.surface.spacing_m;
  std::vector<HiddenPoint> hidden;
  std::vector<std::pair<CellUpdate*, std::size_t>> owners;
  std::set<LatticeKey> around;  // sorted: the hash map's order depends on its history
  for (CellUpdate& job : *jobs) {
    auto missing = job.missing.begin();
    for (const std::size_t index : job.unseen) {
      const SurfacePoint& point = job.cell->entries[index].point;
      const bool is_due = missing != job.missing.end() && *missing == index;
      missing += is_due;
      hidden.push_back({point.position_map, point.normal_map, is_due});
      owners.emplace_back(&job, index);
    }
    if (job.unseen.empty()) continue;
    for (int d = 0; d < 27; ++d) around.insert(job.key.offset(d % 3 - 1, d / 3 % 3 - 1, d / 9 - 1));
  }
  if (hidden.empty()) return;
  std::vector<Witness> witnesses;
  for (const LatticeKey& key : around) {
    const auto removed = recently_removed_.find(key);
    if (removed != recently_removed_.end()) {
      for (const RemovedPoint& gone : removed->second) {
        if (gone.update == num_updates_) witnesses.push_back({gone.point.position_map, gone.point.normal_map, true});
      }
    }
    const auto cell = cells_.find(key);
    if (cell == cells_.end()) continue;
    for (const Cell::Entry& entry : cell->second.entries) {
      if (entry.fused_in == num_updates_ + 1) {
        witnesses.push_back({entry.point.position_map, entry.point.normal_map, false});
      }
    }
  }
  for (const CellUpdate& job : *jobs) {
    if (job.confirmed.empty() || around.count(job.key) == 0) continue;
    for (const std::size_t index : job.confirmed) {
      const SurfacePoint& point = job.cell->entries[index].point;
      witnesses.push_back({point.position_map, point.normal_map, false});
    }
  }
  const std::vector<HiddenFate> fates = judgeHidden(hidden, witnesses, reach);
  std::vector<std::uint8_t> is_gone(hidden.size(), 0);
  const auto remove = [&](std::size_t i) {
    auto& [job, index] = owners[i];
    const SurfacePoint& point = job->cell->entries[index].point;
    is_gone[i] = 1;
    job->removed.push_back(point);
    job->gone.push_back(index);
    recently_removed_[job->key].push_back({num_updates_, point});
  };
  // Where a surface has vanished in a hole, the hole is a look past it.
  const float wall = static_cast<float>(1.0 / config_.frame_map.wall_range_m);
  std::vector<bool> looked_past(pixels->kind.size(), false);
  for (std::size_t i = 0; i < hidden.size(); ++i) {
    auto& [job, index] = owners[i];
    SurfacePoint& point = job->cell->entries[index].point;
    if (fates[i] == HiddenFate::kStands) continue;
    if (fates[i] == HiddenFate::kSuspect && ++point.num_misses < kMaxSuspectLooks) continue;
    remove(i);
    const Eigen::Vector3d p = frame.T_camera_map() * point.position_map;
    const Eigen::Vector2i center = *frame.pixelOf(point.position_map);
    const int radius = static_cast<int>(std::ceil(config_.surface.spacing_m * eye_.camera.fx / p.z()));
    for (int v = std::max(0, center.y() - radius); v <= std::min(eye_.camera.height - 1, center.y() + radius); ++v) {
      for (int u = std::max(0, center.x() - radius); u <= std::min(eye_.camera.width - 1, center.x() + radius); ++u) {
        const std::size_t pixel = pixels->index(u, v);
        if (pixels->kind[pixel] != PixelKind::kHole) continue;
        pixels->clear_to[pixel] = wall;
        looked_past[pixel] = true;
      }
    }
  }
  for (std::size_t i = 0; i < hidden.size(); ++i) {
    if (is_gone[i]) continue;
    const Eigen::Vector2i at = *frame.pixelOf(hidden[i].position_map);
    if (looked_past[pixels->index(at.x(), at.y())] && frame.isInReach(hidden[i].position_map)) remove(i);
  }
}

void GpisMap::decideDoubtful(std::vector<CellUpdate>* jobs) {
  const double reach = kFateSpacings * config_.surface.spacing_m;
  for (CellUpdate& job : *jobs) {
    if (recently_removed_.empty()) break;
    std::vector<std::size_t> gone;
    for (const std::size_t index : job.doubtful) {
      const SurfacePoint& point = job.cell->entries[index].point;
      const auto sameFace = [&](const SurfacePoint& other) {
        return (other.position_map - point.position_map).squaredNorm() < reach * reach &&
               other.normal_map.dot(point.normal_map) > kSameFaceCosine;
      };
      std::size_t num_removed = 0;
      std::size_t num_confirmed = 0;
      for (int dx = -1; dx <= 1; ++dx) {
        for (int dy = -1; dy <= 1; ++dy) {
          for (int dz = -1; dz <= 1; ++dz) {
            const LatticeKey key = job.key.offset(dx, dy, dz);
            const auto removed = recently_removed_.find(key);
            if (removed != recently_removed_.end()) {
              for (const RemovedPoint& gone_point : removed->second) num_removed += sameFace(gone_point.point);
            }
            const auto cell = cells_.find(key);
            if (cell == cells_.end()) continue;
            for (const Cell::Entry& entry : cell->second.entries) {
              num_confirmed += entry.fused_in == num_updates_ + 1 && sameFace(entry.point);
            }
          }
        }
      }
      if (num_removed > num_confirmed) gone.push_back(index);
    }
    for (const std::size_t index : gone) {
      job.removed.push_back(job.cell->entries[index].point);
      job.gone.push_back(index);
    }
  }
}

void GpisMap::thinOut(const std::vector<CellUpdate>& jobs) {
  const double least = kLeastSpacings * config_.surface.spacing_m;
  std::vector<LatticeKey> keys;
  for (const CellUpdate& job : jobs) {
    if (job.fused > 0 && (num_updates_ + LatticeKeyHash()(job.key)) % kThinningPeriod == 0) keys.push_back(job.key);
  }
  std::sort(keys.begin(), keys.end());  // the hash map's order depends on its history
  struct Neighbour {
    LatticeKey key;
    std::vector<Cell::Entry>* entries;
  };
  std::vector<std::pair<LatticeKey, Eigen::Vector3d>> gone;
  const auto take = [&gone](const Neighbour& cell, std::size_t index) {
    gone.emplace_back(cell.key, (*cell.entries)[index].point.position_map);
    cell.entries->erase(cell.entries->begin() + static_cast<std::ptrdiff_t>(index));
  };
  std::vector<Neighbour> around;
  for (const LatticeKey& key : keys) {
    around.clear();
    for (int d = 0; d < 27; ++d) {
      const auto found = cells_.find(key.offset(d % 3 - 1, d / 3 % 3 - 1, d / 9 - 1));
      if (found != cells_.end()) around.push_back({found->first, &found->second.entries});
    }
    const Neighbour own{key, &cells_.at(key).entries};
    for (std::size_t i = 0; i < own.entries->size();) {
      const SurfacePoint point = (*own.entries)[i].point;
      bool is_crowded = false;
      for (const Neighbour& cell : around) {
        for (std::size_t j = cell.entries == own.entries ? i + 1 : 0; j < cell.entries->size() && !is_crowded;) {
          const SurfacePoint& other = (*cell.entries)[j].point;
          const bool same_face = point.normal_map.dot(other.normal_map) > kSameFaceCosine;
          const double allowed = same_face ? least : 0.5 * least;
          if ((point.position_map - other.position_map).squaredNorm() >= allowed * allowed) {
            ++j;
          } else if (point.num_looks != other.num_looks ? point.num_looks > other.num_looks
                                                        : point.variance_m2 <= other.variance_m2) {
            take(cell, j);
          } else {
            is_crowded = true;
          }
        }
      }
      if (is_crowded) {
        take(own, i);
      } else {
        ++i;
      }
    }
  }
  for (const auto& [key, place] : gone) markTouched(key, neighbourMask(key, place));
}

bool GpisMap::hasNeighbour(const Eigen::Vector3d& p_map, const Eigen::Vector3f& normal_map, double variance_m2) const {
  const Crowding crowding{config_.surface.spacing_m, config_.dynamic.tolerance_sigmas};
  const double own_reach = crowding.reach(variance_m2);
  const Eigen::Vector3d reach = Eigen::Vector3d::Constant(own_reach + strayTolerance());
  const LatticeKey low = config_.cells.at(p_map - reach);
  const LatticeKey high = config_.cells.at(p_map + reach);
  for (LatticeKey key = low; key.x <= high.x; ++key.x) {
    for (key.y = low.y; key.y <= high.y; ++key.y) {
      for (key.z = low.z; key.z <= high.z; ++key.z) {
        const auto found = cells_.find(key);
        if (found == cells_.end()) continue;
        for (const Cell::Entry& entry : found->second.entries) {
          const Eigen::Vector3d offset = p_map - entry.point.position_map;
          if (crowding.leavesNoRoom<double>(offset, entry.point.normal_map, normal_map,
                                            variance_m2 + entry.point.variance_m2, own_reach)) {
            return true;
          }
        }
      }
    }
  }
  return false;
}

void GpisMap::insertNew(const Frame& frame, UpdateStatistics* statistics) {
  const int threads = resolveThreadCount(config_.threads);
  const double max_range = config_.sensor.max_range_m;
  const double floor_variance = std::pow(config_.surface.min_noise_std_m, 2);
  const Eigen::AlignedBox3d region(config_.region.min_m, config_.region.max_m);
  const Eigen::Matrix3f R_map_camera = frame.T_map_camera().linear().cast<float>();
  InsertionGrid grid(frame, config_, {kKnownSpacings * config_.surface.spacing_m, config_.dynamic.tolerance_sigmas},
                     threads);
  const std::vector<CellMap::value_type*> cells = cellsInView(frame);
  parallelFor(cells.size(), threads, 16, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      for (const Cell::Entry& entry : cells[i]->second.entries) grid.strikeOut(entry.point);
    }
  });

  std::vector<std::vector<SurfacePoint>> candidates(static_cast<std::size_t>(grid.rows()));
  parallelFor(candidates.size(), threads, 4, [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row) {
      const int v = static_cast<int>(row) * InsertionGrid::kStridePx;
      for (int column = 0; column < grid.columns(); ++column) {
        if (!grid.isOpen(static_cast<int>(row), column)) continue;
        const int u = column * InsertionGrid::kStridePx;
        const std::optional<SurfaceMeasurement> seen = frame.measure(u, v);
        if (!seen || seen->cosine < kMinInsertCosine || seen->point_camera.norm() > max_range) continue;
        SurfacePoint point;
        point.position_map = frame.T_map_camera() * seen->point_camera;
        if (!region.contains(point.position_map)) continue;
        point.normal_map = R_map_camera * seen->normal_camera;
        point.variance_m2 = static_cast<float>(std::max(floor_variance, seen->variance_m2));
        point.normal_variance = static_cast<float>(seen->normal_variance);
        point.last_seen_s = frame.stamp();
        point.seen_from_map = frame.T_map_camera().translation().cast<float>();
        if (hasNeighbour(point.position_map, point.normal_map, point.variance_m2)) continue;
        candidates[row].push_back(point);
      }
    }
  });

  // In image order, so that the result does not depend on the number of threads.
  const double block = config_.observed.block_size_m;
  for (const std::vector<SurfacePoint>& row : candidates) {
    for (const SurfacePoint& point : row) {
      if (hasNeighbour(point.position_map, point.normal_map, point.variance_m2)) continue;
      const LatticeKey key = config_.cells.at(point.position_map);
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
  std::sort(to_train_.begin(), to_train_.end());
  to_train_.erase(std::unique(to_train_.begin(), to_train_.end()), to_train_.end());
  for (const LatticeKey& key : to_train_) {
    const auto found = cells_.find(key);
    if (found == cells_.end()) continue;
    Cell& cell = found->second;
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
      const Eigen::AlignedBox3d box = config_.cells.box(job.key);
      bool is_needed = num_own > 0;
      for (int dx = -1; dx <= 1; ++dx) {
        for (int dy = -1; dy <= 1; ++dy) {
          for (int dz = -1; dz <= 1; ++dz) {
            if (dx == 0 && dy == 0 && dz == 0) continue;
            const auto found = cells_.find(job.key.offset(dx, dy, dz));
            if (found == cells_.end()) continue;
            for (const Cell::Entry& entry : found->second.entries) {
              const double outside2 = box.squaredExteriorDistance(entry.point.position_map);
              if (outside2 < training_margin * training_margin) {
                points.push_back(&entry.point);
              } else if (outside2 < margin * margin) {
                mean_only.push_back(&entry.point);
              }
              is_needed = is_needed || outside2 < needed * needed;
            }
          }
        }
      }
      job.empty = !is_needed;
      const std::size_t num_training = points.size();
      points.insert(points.end(), mean_only.begin(), mean_only.end());
      job.cell->gp = is_needed ? std::make_shared<CellGp>(job.key, config_, points, num_own, num_training) : nullptr;
      job.cell->dirty = false;
      job.cell->num_changes = 0.0f;
    }
  });
  std::vector<CellPages::value_type> changes;
  for (const Job& job : jobs) {
    changes.emplace_back(job.key, job.cell->gp);
    if (job.empty) {
      cells_.erase(job.key);
      continue;
    }
    ++statistics->cells_retrained;
  }
  to_train_.clear();  // not before: what could not be trained is tried again
  statistics->cells_copied = trained_.replace(std::move(changes));
}

void GpisMap::publish() {
  auto next = std::make_shared<const MapSnapshot>(config_, trained_, observed_.share(), epoch_s_, num_updates_);
  const std::lock_guard<std::mutex> lock(snapshot_mutex_);
  snapshot_ = std::move(next);
}

}  // namespace gpis_mapping
