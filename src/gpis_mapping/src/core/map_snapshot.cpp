// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/map_snapshot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include <flann/algorithms/dist.h>
#include <flann/algorithms/kdtree_single_index.h>

#include <interactive_mapping_common/threads/parallel_for.h>
#include "cell_kernels.h"
#include "gpis_mapping/partition_of_unity.h"

namespace gpis_mapping {
namespace {

using interactive_mapping::parallelFor;
using interactive_mapping::resolveThreadCount;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kNeighbours = kNearestPoints;
constexpr int kMaxTogether = kMaxPlaces;  // points of one cell that are answered together

/// The 27 cells about a cell, itself first, then those with which it shares a face, an edge, a corner.
struct Offset {
  int dx, dy, dz;
};
std::array<Offset, 27> searchOrder() {
  std::array<Offset, 27> order;
  std::size_t count = 0;
  for (int steps = 0; steps <= 3; ++steps) {
    for (int d = 0; d < 27; ++d) {
      const Offset o{d / 9 - 1, d / 3 % 3 - 1, d % 3 - 1};
      if (std::abs(o.dx) + std::abs(o.dy) + std::abs(o.dz) == steps) order[count++] = o;
    }
  }
  return order;
}

double smoothStep(double t) {
  t = std::max(0.0, std::min(1.0, t));
  return t * t * (3.0 - 2.0 * t);
}

/// Beyond eight standard deviations the answer is 0 or 1; what erfc says there is rounding of rounding.
double normalCdf(double x) {
  return x < -8.0 ? 0.0 : 0.5 * std::erfc(-x / std::sqrt(2.0));
}

/// What the training points say of a place.
struct Reading {
  bool found;
  double distance;           // signed [m]
  double nearest;            // to the nearest training point [m]
  double aside;              // of the nearest training point's normal line [m]
  Eigen::Vector3d gradient;  // of the signed distance
  double surface_std;        // [m]
};

/// Columns of a matrix of points by the cell they lie in.
class CellGroups {
 public:
  CellGroups(const Points3d& points_map, const GpisConfig::Cells& cells) {
    const auto count = static_cast<std::size_t>(points_map.cols());
    std::vector<std::uint32_t> group_of(count);
    std::vector<std::uint32_t> table(64, 0);  // group + 1 by hash, open addressing
    std::uint32_t last = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const Eigen::Vector3d p = points_map.col(static_cast<Eigen::Index>(i));
      if (!p.allFinite()) {
        group_of[i] = kNone;
        without_cell_.push_back(static_cast<std::uint32_t>(i));
        continue;
      }
      const LatticeKey key = cells.at(p);
      if (keys_.empty() || keys_[last] != key) last = find(key, &table);
      group_of[i] = last;
      ++begins_[last + 1];
    }
    for (std::size_t g = 0; g < keys_.size(); ++g) begins_[g + 1] += begins_[g];
    order_.resize(count);
    std::vector<std::uint32_t> next = begins_;
    for (std::size_t i = 0; i < count; ++i) {
      if (group_of[i] != kNone) order_[next[group_of[i]]++] = static_cast<std::uint32_t>(i);
    }
  }

  std::size_t size() const { return keys_.size(); }
  const LatticeKey& key(std::size_t g) const { return keys_[g]; }
  const std::uint32_t* points(std::size_t g) const { return order_.data() + begins_[g]; }
  int count(std::size_t g) const { return static_cast<int>(begins_[g + 1] - begins_[g]); }
  const std::vector<std::uint32_t>& withoutCell() const { return without_cell_; }

 private:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  std::uint32_t find(const LatticeKey& key, std::vector<std::uint32_t>* table) {
    if (2 * (keys_.size() + 1) > table->size()) {
      table->assign(2 * table->size(), 0);
      for (std::size_t g = 0; g < keys_.size(); ++g) *slot(keys_[g], table) = static_cast<std::uint32_t>(g + 1);
    }
    std::uint32_t* const found = slot(key, table);
    if (*found == 0) {
      keys_.push_back(key);
      begins_.push_back(0);
      *found = static_cast<std::uint32_t>(keys_.size());
    }
    return *found - 1;
  }
  /// Where the key's group is, or would be.
  std::uint32_t* slot(const LatticeKey& key, std::vector<std::uint32_t>* table) const {
    std::size_t at = LatticeKeyHash()(key) & (table->size() - 1);
    while ((*table)[at] != 0 && keys_[(*table)[at] - 1] != key) at = (at + 1) & (table->size() - 1);
    return &(*table)[at];
  }

  std::vector<LatticeKey> keys_;
  std::vector<std::uint32_t> begins_{0};
  std::vector<std::uint32_t> order_;
  std::vector<std::uint32_t> without_cell_;
};

}  // namespace

/// The mapped surface as discs about the training points: distance to it from anywhere, with a sign. For places whose
/// nearest points may lie beyond the cells around; near the surface CellQuery reads the same from those.
class MapSnapshot::NearestIndex {
 public:
  explicit NearestIndex(const MapSnapshot& map)
      : disc_radius_(0.5 * map.config_.surface.spacing_m), sign_scale2_(std::pow(map.config_.surface.spacing_m, 2)) {
    for (const auto& [key, cell] : map.cells_) {
      for (std::size_t i = 0; i < cell->numOwn(); ++i) {
        discs_.push_back({cell->position(i), cell->normal(i), cell->noiseVariance(i)});
      }
    }
    // By place, so that ties between neighbours depend on nothing else.
    std::sort(discs_.begin(), discs_.end(), [](const Disc& a, const Disc& b) {
      return std::lexicographical_compare(a.position.data(), a.position.data() + 3, b.position.data(),
                                          b.position.data() + 3);
    });
    if (discs_.empty()) return;
    // FLANN reads rows of numbers, any distance apart.
    tree_.emplace(flann::Matrix<double>(discs_[0].position.data(), discs_.size(), 3, sizeof(Disc)),
                  flann::KDTreeSingleIndexParams(12));
    tree_->buildIndex();
  }

  std::size_t size() const { return discs_.size(); }

  Reading read(const Eigen::Vector3d& x) const {
    Reading result;
    result.found = false;
    if (discs_.empty()) return result;
    std::size_t index[kNeighbours];
    double squared[kNeighbours];
    flann::KNNSimpleResultSet<double> nearest(kNeighbours);
    tree_->findNeighbors(nearest, x.data(), flann::SearchParams(flann::FLANN_CHECKS_UNLIMITED));
    const std::size_t count = nearest.size();
    if (count == 0) return result;  // so far away that the square is infinite
    nearest.copy(index, squared, count, true);
    result.found = true;
    result.nearest = std::sqrt(squared[0]);
    result.surface_std = std::sqrt(discs_[index[0]].variance);
    // The side of x: vote of the near discs, those about as near as the nearest. At a convex edge the plane of a face
    // that is not the nearest may have x on its other side; it is farther and is outvoted.
    double vote = 0.0;
    double along[kNeighbours];
    for (std::size_t i = 0; i < count; ++i) {
      const Disc& disc = discs_[index[i]];
      along[i] = disc.normal.cast<double>().dot(x - disc.position);
      vote += std::exp(-(squared[i] - squared[0]) / sign_scale2_) * along[i];
    }
    result.aside = std::sqrt(std::max(0.0, squared[0] - along[0] * along[0]));
    const double sign = vote < 0.0 ? -1.0 : 1.0;
    double best = std::numeric_limits<double>::max();
    for (std::size_t i = 0; i < count; ++i) {
      if (along[i] * sign < 0.0 && i > 0) continue;
      const double aside = std::sqrt(std::max(0.0, squared[i] - along[i] * along[i]));
      const double beyond = std::max(0.0, aside - disc_radius_);
      const double distance2 = along[i] * along[i] + beyond * beyond;
      if (distance2 >= best) continue;
      best = distance2;
      const Disc& disc = discs_[index[i]];
      const Eigen::Vector3d n = disc.normal.cast<double>();
      const Eigen::Vector3d lateral = x - disc.position - along[i] * n;
      Eigen::Vector3d away = along[i] * n;
      if (aside > 0.0) away += lateral * (beyond / aside);
      const double length = away.norm();
      result.gradient = length > 1e-9 ? Eigen::Vector3d(sign * away / length) : n;
    }
    result.distance = sign * std::sqrt(best);
    return result;
  }

  std::size_t memoryBytes() const { return discs_.size() * (sizeof(Disc) + 56); }  // 56: of the tree

 private:
  struct Disc {
    Eigen::Vector3d position;
    Eigen::Vector3f normal;
    float variance;
  };

  double disc_radius_;
  double sign_scale2_;
  std::vector<Disc> discs_;
  std::optional<flann::KDTreeSingleIndex<flann::L2_3D<double>>> tree_;
};

MapSnapshot::MapSnapshot(const GpisConfig& config, CellPages cells, ObservedLayer observed, double epoch_s,
                         std::uint64_t num_updates)
    : config_(config),
      cells_(std::move(cells)),
      observed_(std::move(observed)),
      epoch_s_(epoch_s),
      num_updates_(num_updates) {}

MapSnapshot::~MapSnapshot() = default;

const MapSnapshot::NearestIndex& MapSnapshot::nearestIndex() const {
  std::call_once(nearest_once_, [this] { nearest_ = std::make_unique<NearestIndex>(*this); });
  return *nearest_;
}

std::size_t MapSnapshot::memoryBytes() const {
  std::size_t bytes = 0;
  for (const auto& [key, cell] : cells_) bytes += cell->memoryBytes() + sizeof(key) + 4 * sizeof(void*);
  return bytes + observed_.numChunks() * sizeof(ObservedLayer::Chunk) + numPoints() * sizeof(SurfacePoint);
}

FieldSample MapSnapshot::field(const Eigen::Vector3d& p_map) const {
  BlendWeight weights[8];
  const int count = blendWeights(p_map, config_.cells, weights);
  // f = sum(w f_c) / sum(w) over the cells that have an answer here.
  double sum = 0.0;
  double value = 0.0;
  Eigen::Vector3d sum_gradient = Eigen::Vector3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  for (int i = 0; i < count; ++i) {
    const CellGp* const cell = cells_.get(weights[i].key);
    if (cell == nullptr) continue;
    const CellGp::Mean mean = cell->mean(p_map);
    if (!mean.valid) continue;
    sum += weights[i].weight;
    value += weights[i].weight * mean.value;
    sum_gradient += weights[i].gradient;
    gradient += weights[i].weight * mean.gradient.cast<double>() + weights[i].gradient * mean.value;
  }
  if (!(sum > 1e-9)) return {kNaN, Eigen::Vector3d::Constant(kNaN), false};
  value /= sum;
  return {value, (gradient - value * sum_gradient) / sum, true};
}

SpaceState MapSnapshot::state(const Eigen::Vector3d& p_map, double distance_m) const {
  if (distance_m < 0.0) {
    return -distance_m <= config_.query.occupied_depth_m ? SpaceState::kOccupied : SpaceState::kUnknown;
  }
  // Near a surface, on the side it was seen from: the ray that saw it went through here. A block is told to be free when a
  // ball of 0.6 blocks about its centre is before what was seen; at 1.1 blocks from a face, or more with noise, it may not
  // be. Less than that would leave sheets of unknown space before every face.
  const bool is_near = distance_m < kFreeReach_blocks * observed_.blockSize();
  return is_near || observed_.isFree(p_map) ? SpaceState::kFree : SpaceState::kUnknown;
}

/// Answers at points that lie in one cell: each cell around is asked once for all of them.
class MapSnapshot::CellQuery {
 public:
  CellQuery(const MapSnapshot& map, const Points3d& points_map, const QueryOptions& options, QueryResult* result)
      : map_(map),
        config_(map.config_),
        points_map_(points_map),
        with_variance_(options.variance),
        with_variance_gradient_(options.variance_gradient),
        prior_(static_cast<float>(std::pow(map.config_.signalStd(), 2))),
        inner_reach_(0.5 * map.config_.cells.size_m - map.config_.cells.blend_margin_m),
        result_(*result) {
    // Points stray out of their cell by a quarter of the spacing at most; the rest is for rounding.
    const double stray = 0.25 * config_.surface.spacing_m + 1e-6;
    nearby_.read = &Nearby::readCell;
    nearby_.cell_reach = static_cast<float>(0.5 * config_.cells.size_m - stray);
    nearby_.outer_reach = static_cast<float>(1.5 * config_.cells.size_m - stray);
    nearby_.disc_radius_m = static_cast<float>(0.5 * config_.surface.spacing_m);
    nearby_.inverse_vote_scale2 = static_cast<float>(std::pow(config_.surface.spacing_m, -2));
  }

  void answer(const LatticeKey& key, const std::uint32_t* points, int count) {
    findCells(key);
    for (int first = 0; first < count; first += kMaxTogether) {
      count_ = std::min(kMaxTogether, count - first);
      answerSome(points + first);
    }
  }

  /// Brings into the cache what answer() is going to read of the first points and to write; both lie anywhere.
  void fetch(const std::uint32_t* points, int count) const {
    for (int i = 0; i < std::min(kMaxTogether, count); ++i) {
      const Eigen::Index point = points[i];
      __builtin_prefetch(points_map_.data() + 3 * point);
      __builtin_prefetch(result_.distance.data() + point, 1);
      __builtin_prefetch(result_.gradient.data() + 3 * point, 1);
      __builtin_prefetch(result_.euclidean_distance.data() + point, 1);
      __builtin_prefetch(result_.euclidean_gradient.data() + 3 * point, 1);
      __builtin_prefetch(result_.surface_std.data() + point, 1);
    }
  }

  /// At a place that has no answer but perhaps a state.
  static void answerNone(Eigen::Index i, SpaceState state, QueryResult* result) {
    result->distance[i] = kNaN;
    result->gradient.col(i).setConstant(kNaN);
    result->euclidean_distance[i] = kNaN;
    result->euclidean_gradient.col(i).setConstant(kNaN);
    result->surface_std[i] = kNaN;
    result->state[static_cast<std::size_t>(i)] = state;
  }

 private:
  struct Share {
    int point;
    double weight;
    Eigen::Vector3d gradient;
  };

  struct Nearby : NearbyPoints {
    std::array<const CellGp*, 27> owners;  // of `cells`

    static void readCell(NearbyPoints* nearby, int n) {
      const CellGp& gp = *static_cast<Nearby*>(nearby)->owners[static_cast<std::size_t>(n)];
      const CellArrays arrays = gp.arrays();
      Cell& cell = nearby->cells[n];
      cell.count = static_cast<int>(gp.numOwn());
      cell.x = arrays.x;
      cell.y = arrays.y;
      cell.z = arrays.z;
      cell.nx = arrays.nx;
      cell.ny = arrays.ny;
      cell.nz = arrays.nz;
    }
  };

  static constexpr int kMiddle = 13;
  static int indexOf(int dx, int dy, int dz) { return (dx + 1) * 9 + (dy + 1) * 3 + dz + 1; }

  void findCells(const LatticeKey& key) {
    key_ = key;
    center_ = config_.cells.center(key);
    nearby_.count = 0;
    const float size = static_cast<float>(config_.cells.size_m);
    static const std::array<Offset, 27> kOrder = searchOrder();
    map_.cells_.getAround(key, &around_);
    for (const Offset& o : kOrder) {
      const CellGp* const gp = around_[static_cast<std::size_t>(indexOf(o.dx, o.dy, o.dz))];
      if (gp == nullptr) continue;
      NearbyPoints::Cell& cell = nearby_.cells[nearby_.count];
      cell.count = NearbyPoints::kUnread;
      const int step[3] = {o.dx, o.dy, o.dz};
      for (int axis = 0; axis < 3; ++axis) {
        cell.side[axis] = static_cast<float>(step[axis]);
        cell.offset[axis] = size * cell.side[axis];
      }
      nearby_.owners[nearby_.count++] = gp;
    }
  }

  void answerSome(const std::uint32_t* points) {
    sortByPlace(points);
    read();
    int num_field = 0;
    for (int i = 0; i < count_; ++i) {
      needs_field_[i] = readings_[i].found && readings_[i].nearest < config_.surface.blend_radius_m;
      num_field += needs_field_[i];
    }
    if (num_field > 0) {
      share(needs_field_);
      blendMean();
    }
    for (int i = 0; i < count_; ++i) has_answer_[i] = finish(i);
    if (!with_variance_ && !with_variance_gradient_) return;
    if (num_field == 0 || !std::equal(has_answer_, has_answer_ + count_, needs_field_)) share(has_answer_);
    blendVariance();
  }

  /// Neighbours together, so that eight at a time have about the same nearest points.
  void sortByPlace(const std::uint32_t* points) {
    if (count_ <= kCellPad) {
      std::copy(points, points + count_, order_);
      return;
    }
    const double to_bins = 4.0 / config_.cells.size_m;
    const auto binOf = [&](std::uint32_t point) {
      const Eigen::Array3i at = ((points_map_.col(point) - center_).array() * to_bins + 2.0).cast<int>().max(0).min(3);
      return (at.x() * 4 + (at.x() & 1 ? 3 - at.y() : at.y())) * 4 + at.z();
    };
    int begins[65] = {};
    std::uint8_t bins[kMaxTogether];
    for (int i = 0; i < count_; ++i) {
      bins[i] = static_cast<std::uint8_t>(binOf(points[i]));
      ++begins[bins[i] + 1];
    }
    for (int b = 0; b < 64; ++b) begins[b + 1] += begins[b];
    for (int i = 0; i < count_; ++i) order_[begins[bins[i]]++] = points[i];
  }

  const Eigen::Vector3d at(int i) const { return points_map_.col(order_[i]); }

  /// Writes places of the `count` points relative to `center`, whole vectors of them.
  template <typename PointOf>
  void place(int count, const Eigen::Vector3d& center, const PointOf& pointOf) {
    for (int i = 0; i < count; ++i) {
      const Eigen::Vector3f p = (pointOf(i) - center).template cast<float>();
      x_[i] = p.x();
      y_[i] = p.y();
      z_[i] = p.z();
    }
    for (int i = count; i < padded(count); ++i) {
      x_[i] = x_[count - 1];
      y_[i] = y_[count - 1];
      z_[i] = z_[count - 1];
    }
  }

  void read() {
    if (nearby_.count > 0) {
      place(count_, center_, [this](int i) { return at(i); });
      nearby_.owners[0]->kernels().readNearest(&nearby_, x_, y_, z_, count_, &nearest_);
    }
    for (int i = 0; i < count_; ++i) {
      Reading& reading = readings_[i];
      if (nearby_.count == 0 || nearest_.is_complete[i] == 0) {
        reading = map_.nearestIndex().read(at(i));
        continue;
      }
      reading.found = true;
      reading.distance = nearest_.distance[i];
      reading.nearest = nearest_.nearest[i];
      reading.aside = nearest_.aside[i];
      reading.gradient = {nearest_.gx[i], nearest_.gy[i], nearest_.gz[i]};
      const CellGp& owner = *nearby_.owners[static_cast<std::size_t>(nearest_.cell[i])];
      reading.surface_std = std::sqrt(owner.noiseVariance(static_cast<std::size_t>(nearest_.point[i])));
    }
  }

  /// Which cells have a say at the points that are `wanted`: shares_[begins_[c]] to shares_[begins_[c + 1]] those of c.
  void share(const bool* wanted) {
    int cells[8 * kMaxTogether];
    Share all[8 * kMaxTogether];
    int count = 0;
    begins_.fill(0);
    for (int i = 0; i < count_; ++i) {
      if (!wanted[i]) continue;
      const Eigen::Vector3d x = at(i);
      if ((x - center_).cwiseAbs().maxCoeff() < inner_reach_) {  // weight 1 for the cell itself
        ++begins_[kMiddle + 1];
        cells[count] = kMiddle;
        all[count++] = {i, 1.0, Eigen::Vector3d::Zero()};
        continue;
      }
      BlendWeight weights[8];
      const int num_weights = blendWeights(x, config_.cells, weights);
      for (int w = 0; w < num_weights; ++w) {
        const LatticeKey& key = weights[w].key;
        cells[count] = indexOf(key.x - key_.x, key.y - key_.y, key.z - key_.z);
        ++begins_[static_cast<std::size_t>(cells[count]) + 1];
        all[count++] = {i, weights[w].weight, weights[w].gradient};
      }
    }
    for (std::size_t c = 0; c < 27; ++c) begins_[c + 1] += begins_[c];
    std::array<int, 28> next = begins_;
    for (int s = 0; s < count; ++s) shares_[next[static_cast<std::size_t>(cells[s])]++] = all[s];
  }

  /// Calls fn(cell, shares, count) for whole vectors of the shares of each cell that exists, else with a null cell.
  template <typename Function>
  void forEachCell(const Function& fn) {
    for (std::size_t c = 0; c < 27; ++c) {
      for (int first = begins_[c]; first < begins_[c + 1]; first += kMaxTogether) {
        const int count = std::min(kMaxTogether, begins_[c + 1] - first);
        const Share* const shares = shares_ + first;
        if (around_[c] != nullptr) {
          const Eigen::Vector3d center = config_.cells.center(around_[c]->key());
          place(count, center, [&](int i) { return at(shares[i].point); });
        }
        fn(around_[c], shares, count);
      }
    }
  }

  /// f = sum(w f_c) / sum(w) over the cells that have an answer here.
  void blendMean() {
    for (int i = 0; i < count_; ++i) {
      Blend& blend = blends_[i];
      blend.weight = blend.value = 0.0;
      blend.weight_gradient.setZero();
      blend.gradient.setZero();
    }
    forEachCell([this](const CellGp* cell, const Share* shares, int count) {
      if (cell == nullptr) return;
      cell->kernels().meansWithGradient(cell->arrays(), x_, y_, z_, count, value_, gx_, gy_, gz_);
      for (int i = 0; i < count; ++i) {
        if (std::isnan(value_[i])) continue;
        const Share& share = shares[i];
        Blend& blend = blends_[share.point];
        blend.weight += share.weight;
        blend.value += share.weight * value_[i];
        blend.weight_gradient += share.gradient;
        blend.gradient += share.weight * Eigen::Vector3d(gx_[i], gy_[i], gz_[i]) + share.gradient * value_[i];
      }
    });
  }

  /// Everything but the variance of one point; false if there is no answer that could have one.
  bool finish(int i) {
    const Eigen::Index point = order_[i];
    const Eigen::Vector3d x = at(i);
    const Reading& reading = readings_[i];
    SpaceState state;
    if (!reading.found || reading.nearest > config_.query.max_distance_m) {
      state = map_.observed_.isFree(x) ? SpaceState::kFree : SpaceState::kUnknown;
      answerNone(point, state, &result_);
      return state != SpaceState::kUnknown && (reading.found || map_.nearestIndex().size() > 0);
    }
    double distance = reading.distance;
    Eigen::Vector3d gradient = reading.gradient;
    // Seen free beats the vote of surfaces far away: such a block holds no object. Its corners may: they are a
    // quarter of a block outside the sphere that was seen through; as much again for noise.
    if (distance < -0.5 * map_.observed_.blockSize() && map_.observed_.isFree(x)) {
      distance = -distance;
      gradient = -gradient;
    }
    const Blend& f = blends_[i];
    if (needs_field_[i] && f.weight > 1e-9) {
      const double scale = 1.0 / f.weight;
      const double value = scale * f.value;
      const Eigen::Vector3d f_gradient = scale * (f.gradient - value * f.weight_gradient);
      // f is exact near its points and no distance far from them: hand over to the discs between these two.
      const double band_begin = config_.surface.spacing_m;
      const double band_end = 0.9 * config_.surface.blend_radius_m;
      const double t = (std::abs(distance) - band_begin) / (band_end - band_begin);
      const double share = smoothStep(t);
      // d share / dx, through |distance|
      const double inside = t > 0.0 && t < 1.0 ? 6.0 * t * (1.0 - t) / (band_end - band_begin) : 0.0;
      const Eigen::Vector3d share_gradient = inside * (distance < 0.0 ? -1.0 : 1.0) * gradient;
      gradient = (1.0 - share) * f_gradient + share * gradient + (distance - value) * share_gradient;
      distance = (1.0 - share) * value + share * distance;
    }
    state = map_.state(x, distance);
    // The ray that saw the nearest surface did not go through here if that lies aside.
    if (state == SpaceState::kFree && reading.aside > 1.5 * config_.surface.spacing_m && !map_.observed_.isFree(x)) {
      state = SpaceState::kUnknown;
    }
    // Deep behind a seen surface nobody knows how thick the object is.
    const bool has_answer =
        state != SpaceState::kUnknown || (distance >= 0.0 && reading.nearest <= config_.query.unknown_reach_m);
    result_.state[static_cast<std::size_t>(point)] = state;
    result_.euclidean_distance[point] = std::abs(distance);
    result_.euclidean_gradient.col(point) = distance < 0.0 ? Eigen::Vector3d(-gradient) : gradient;
    result_.distance[point] = has_answer ? distance : kNaN;
    result_.gradient.col(point) = has_answer ? gradient : Eigen::Vector3d::Constant(kNaN);
    result_.surface_std[point] = has_answer ? reading.surface_std : kNaN;
    return has_answer;
  }

  void blendVariance() {
    for (int i = 0; i < count_; ++i) {
      blends_[i].value = 0.0;
      blends_[i].gradient.setZero();
    }
    forEachCell([this](const CellGp* cell, const Share* shares, int count) {
      if (cell != nullptr) {
        scratch_.resize(static_cast<std::size_t>(varianceScratch(static_cast<int>(cell->numTraining()))));
        cell->kernels().variances(cell->arrays(), x_, y_, z_, count, scratch_.data(), value_,
                                  with_variance_gradient_ ? gx_ : nullptr, gy_, gz_);
      }
      for (int i = 0; i < count; ++i) {
        const Share& share = shares[i];
        Blend& blend = blends_[share.point];
        const float variance = cell != nullptr ? value_[i] : prior_;
        blend.value += share.weight * variance;
        if (!with_variance_gradient_) continue;
        blend.gradient += share.gradient * variance;
        if (cell != nullptr) blend.gradient += share.weight * Eigen::Vector3d(gx_[i], gy_[i], gz_[i]);
      }
    });
    for (int i = 0; i < count_; ++i) {
      if (!has_answer_[i]) continue;
      const Eigen::Index point = order_[i];
      if (with_variance_gradient_) result_.variance_gradient.col(point) = blends_[i].gradient;
      if (!with_variance_) continue;
      result_.variance[point] = blends_[i].value;
      if (result_.state[static_cast<std::size_t>(point)] == SpaceState::kUnknown) continue;
      result_.occupancy[point] = normalCdf(-result_.distance[point] / std::sqrt(std::max(1e-12, blends_[i].value)));
    }
  }

  struct Blend {
    double weight, value;
    Eigen::Vector3d weight_gradient, gradient;
  };

  const MapSnapshot& map_;
  const GpisConfig& config_;
  const Points3d& points_map_;
  bool with_variance_, with_variance_gradient_;
  float prior_;
  double inner_reach_;  // from the cell's centre [m]: within, no neighbour has a say
  QueryResult& result_;
  LatticeKey key_;
  Eigen::Vector3d center_;
  std::array<const CellGp*, 27> around_;
  Nearby nearby_;
  NearestReadings nearest_;
  int count_{0};
  std::uint32_t order_[kMaxTogether];  // columns of points_map_
  Reading readings_[kMaxTogether];
  bool needs_field_[kMaxTogether];
  bool has_answer_[kMaxTogether];
  Blend blends_[kMaxTogether];
  std::array<int, 28> begins_;
  Share shares_[8 * kMaxTogether];
  alignas(32) float x_[kMaxTogether], y_[kMaxTogether], z_[kMaxTogether];
  alignas(32) float value_[kMaxTogether], gx_[kMaxTogether], gy_[kMaxTogether], gz_[kMaxTogether];
  std::vector<float> scratch_;
};

QueryResult MapSnapshot::query(const Points3d& points_map, const QueryOptions& options) const {
  const Eigen::Index count = points_map.cols();
  QueryResult result;
  result.distance.resize(count);
  result.gradient.resize(3, count);
  result.euclidean_distance.resize(count);
  result.euclidean_gradient.resize(3, count);
  result.surface_std.resize(count);
  result.variance.setConstant(count, kNaN);
  result.occupancy.setConstant(count, kNaN);
  result.variance_gradient.setConstant(3, options.variance_gradient ? count : 0, kNaN);
  result.state.resize(static_cast<std::size_t>(count));
  if (count == 1 && points_map.allFinite()) {  // without what it takes to sort many
    const std::uint32_t only = 0;
    CellQuery(*this, points_map, options, &result).answer(config_.cells.at(points_map.col(0)), &only, 1);
    return result;
  }
  const CellGroups groups(points_map, config_.cells);
  for (const std::uint32_t i : groups.withoutCell()) CellQuery::answerNone(i, SpaceState::kUnknown, &result);
  parallelFor(groups.size(), resolveThreadCount(options.threads), 8, [&](std::size_t begin, std::size_t end) {
    CellQuery query(*this, points_map, options, &result);
    for (std::size_t g = begin; g < end; ++g) {
      if (g + 1 < end) query.fetch(groups.points(g + 1), groups.count(g + 1));
      query.answer(groups.key(g), groups.points(g), groups.count(g));
    }
  });
  return result;
}

}  // namespace gpis_mapping
