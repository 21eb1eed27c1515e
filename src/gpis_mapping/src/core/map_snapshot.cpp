// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/map_snapshot.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include <flann/algorithms/dist.h>
#include <flann/algorithms/kdtree_single_index.h>

#include <interactive_mapping_common/threads/parallel_for.h>
#include "gpis_mapping/partition_of_unity.h"

namespace gpis_mapping {
namespace {

using interactive_mapping::parallelFor;
using interactive_mapping::resolveThreadCount;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kNeighbours = 8;
constexpr std::size_t kQueryChunk = 512;

double smoothStep(double t) {
  t = std::max(0.0, std::min(1.0, t));
  return t * t * (3.0 - 2.0 * t);
}

/// Beyond eight standard deviations the answer is 0 or 1; what erfc says there is rounding of rounding.
double normalCdf(double x) {
  return x < -8.0 ? 0.0 : 0.5 * std::erfc(-x / std::sqrt(2.0));
}

}  // namespace

/// The mapped surface as discs about the training points: distance to it from anywhere, with a sign.
class MapSnapshot::NearestIndex {
 public:
  struct Reading {
    bool found{false};
    double distance{0.0};      // signed [m]
    double nearest{0.0};       // to the nearest training point [m]
    double aside{0.0};         // of the nearest training point's normal line [m]
    Eigen::Vector3d gradient;  // of the signed distance
    double surface_std{0.0};   // [m]
  };

  explicit NearestIndex(const MapSnapshot& map)
      : disc_radius_(0.5 * map.config_.surface.spacing_m), sign_scale2_(std::pow(map.config_.surface.spacing_m, 2)) {
    for (const auto& [key, cell] : map.cells_) {
      for (std::size_t i = 0; i < cell->numOwn(); ++i) {
        discs_.push_back({cell->position(i), cell->normal(i), cell->noiseVariance(i)});
      }
    }
    // The hash map's order depends on its history; ties between neighbours must not.
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

MapSnapshot::MapSnapshot(const GpisConfig& config, Cells cells, ObservedLayer observed, double epoch_s,
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

std::size_t MapSnapshot::numPoints() const {
  std::size_t count = 0;
  for (const auto& [key, cell] : cells_) count += cell->numOwn();
  return count;
}

std::size_t MapSnapshot::memoryBytes() const {
  std::size_t bytes = 0;
  for (const auto& [key, cell] : cells_) bytes += cell->memoryBytes() + sizeof(key) + 4 * sizeof(void*);
  return bytes + observed_.chunks().size() * sizeof(ObservedLayer::Chunk) + numPoints() * sizeof(SurfacePoint);
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
    const auto cell = cells_.find(weights[i].key);
    if (cell == cells_.end()) continue;
    const CellGp::Mean mean = cell->second->mean(p_map);
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
  if (observed_.isFree(p_map)) return SpaceState::kFree;
  // Near a surface, on the side it was seen from: the ray that saw it went through here. A block is told to be free when a
  // ball of 0.6 blocks about its centre is before what was seen; at 1.1 blocks from a face, or more with noise, it may not
  // be. Less than that would leave sheets of unknown space before every face.
  constexpr double kNear_blocks = 1.5;
  return distance_m < kNear_blocks * observed_.blockSize() ? SpaceState::kFree : SpaceState::kUnknown;
}

void MapSnapshot::blendedVariance(const Points3d& points_map, const QueryOptions& options, QueryResult* result) const {
  // Grouped by cell, so that each cell solves for all its points at once.
  struct Share {
    LatticeKey key;
    Eigen::Index point;
    double weight;
    Eigen::Vector3d weight_gradient;
    float variance;
    Eigen::Vector3f gradient;
  };
  std::vector<Share> shares;
  for (Eigen::Index i = 0; i < points_map.cols(); ++i) {
    if (!points_map.col(i).allFinite()) continue;
    BlendWeight weights[8];
    const int count = blendWeights(points_map.col(i), config_.cells, weights);
    for (int j = 0; j < count; ++j) {
      shares.push_back({weights[j].key, i, weights[j].weight, weights[j].gradient, 0.0f, Eigen::Vector3f::Zero()});
    }
  }
  std::sort(shares.begin(), shares.end(),
            [](const Share& a, const Share& b) { return a.key != b.key ? a.key < b.key : a.point < b.point; });
  constexpr std::size_t kMaxGroup = 256;
  std::vector<std::size_t> groups;
  for (std::size_t i = 0; i < shares.size(); ++i) {
    if (i == 0 || shares[i].key != shares[i - 1].key || i - groups.back() >= kMaxGroup) groups.push_back(i);
  }
  groups.push_back(shares.size());
  const float prior = static_cast<float>(std::pow(config_.signalStd(), 2));
  parallelFor(groups.size() - 1, resolveThreadCount(options.threads), 8, [&](std::size_t begin, std::size_t end) {
    Points3d group_points;
    Points3f gradients;
    Eigen::VectorXf variances;
    for (std::size_t g = begin; g < end; ++g) {
      const auto cell = cells_.find(shares[groups[g]].key);
      if (cell == cells_.end()) {
        for (std::size_t i = groups[g]; i < groups[g + 1]; ++i) shares[i].variance = prior;
        continue;
      }
      group_points.resize(3, static_cast<Eigen::Index>(groups[g + 1] - groups[g]));
      for (std::size_t i = groups[g]; i < groups[g + 1]; ++i) {
        group_points.col(static_cast<Eigen::Index>(i - groups[g])) = points_map.col(shares[i].point);
      }
      cell->second->variance(group_points, &variances, options.variance_gradient ? &gradients : nullptr);
      for (std::size_t i = groups[g]; i < groups[g + 1]; ++i) {
        const Eigen::Index local = static_cast<Eigen::Index>(i - groups[g]);
        shares[i].variance = variances[local];
        if (options.variance_gradient) shares[i].gradient = gradients.col(local);
      }
    }
  });
  for (const Share& share : shares) {
    result->variance[share.point] += share.weight * share.variance;
    if (options.variance_gradient) {
      result->variance_gradient.col(share.point) +=
          share.weight * share.gradient.cast<double>() + share.weight_gradient * share.variance;
    }
  }
}

QueryResult MapSnapshot::query(const Points3d& points_map, const QueryOptions& options) const {
  const Eigen::Index count = points_map.cols();
  QueryResult result;
  result.distance = Eigen::VectorXd::Constant(count, kNaN);
  result.gradient = Points3d::Constant(3, count, kNaN);
  result.euclidean_distance = Eigen::VectorXd::Constant(count, kNaN);
  result.euclidean_gradient = Points3d::Constant(3, count, kNaN);
  result.surface_std = Eigen::VectorXd::Constant(count, kNaN);
  result.variance = Eigen::VectorXd::Constant(count, options.variance ? 0.0 : kNaN);
  result.occupancy = Eigen::VectorXd::Constant(count, kNaN);
  result.variance_gradient.resize(3, options.variance_gradient ? count : 0);
  result.variance_gradient.setZero();
  result.state.assign(static_cast<std::size_t>(count), SpaceState::kUnknown);
  const NearestIndex& nearest = nearestIndex();

  // f is exact near its points and no distance far from them: hand over to the discs between these two.
  const double band_begin = config_.surface.spacing_m;
  const double band_end = 0.9 * config_.surface.blend_radius_m;
  parallelFor(
      static_cast<std::size_t>(count), resolveThreadCount(options.threads), kQueryChunk,
      [&](std::size_t begin, std::size_t end) {
        for (Eigen::Index i = static_cast<Eigen::Index>(begin); i < static_cast<Eigen::Index>(end); ++i) {
          const Eigen::Vector3d x = points_map.col(i);
          if (!x.allFinite()) continue;
          SpaceState& state = result.state[static_cast<std::size_t>(i)];
          NearestIndex::Reading reading = nearest.read(x);
          if (!reading.found || reading.nearest > config_.query.max_distance_m) {
            state = observed_.isFree(x) ? SpaceState::kFree : SpaceState::kUnknown;
            continue;
          }
          double distance = reading.distance;
          Eigen::Vector3d gradient = reading.gradient;
          // Seen free beats the vote of surfaces far away: such a block holds no object. Its corners may: they are a
          // quarter of a block outside the sphere that was seen through; as much again for noise.
          if (distance < -0.5 * observed_.blockSize() && observed_.isFree(x)) {
            distance = -distance;
            gradient = -gradient;
          }
          if (reading.nearest < config_.surface.blend_radius_m) {
            const FieldSample f = field(x);
            if (f.valid) {
              const double t = (std::abs(distance) - band_begin) / (band_end - band_begin);
              const double share = smoothStep(t);
              // d share / dx, through |distance|
              const double inside = t > 0.0 && t < 1.0 ? 6.0 * t * (1.0 - t) / (band_end - band_begin) : 0.0;
              const Eigen::Vector3d share_gradient = inside * (distance < 0.0 ? -1.0 : 1.0) * gradient;
              gradient = (1.0 - share) * f.gradient + share * gradient + (distance - f.value) * share_gradient;
              distance = (1.0 - share) * f.value + share * distance;
            }
          }
          state = this->state(x, distance);
          // The ray that saw the nearest surface did not go through here if that lies aside.
          if (state == SpaceState::kFree && reading.aside > 1.5 * config_.surface.spacing_m && !observed_.isFree(x)) {
            state = SpaceState::kUnknown;
          }
          result.euclidean_distance[i] = std::abs(distance);
          result.euclidean_gradient.col(i) = distance < 0.0 ? Eigen::Vector3d(-gradient) : gradient;
          // Deep behind a seen surface nobody knows how thick the object is.
          const bool has_answer =
              state != SpaceState::kUnknown || (distance >= 0.0 && reading.nearest <= config_.query.unknown_reach_m);
          if (!has_answer) continue;
          result.distance[i] = distance;
          result.gradient.col(i) = gradient;
          result.surface_std[i] = reading.surface_std;
        }
      });
  if (!options.variance && !options.variance_gradient) return result;
  blendedVariance(points_map, options, &result);
  for (Eigen::Index i = 0; i < count; ++i) {
    const bool no_answer =
        !points_map.col(i).allFinite() || nearest.size() == 0 ||
        (std::isnan(result.distance[i]) && result.state[static_cast<std::size_t>(i)] == SpaceState::kUnknown);
    if (no_answer) {
      result.variance[i] = kNaN;
      if (options.variance_gradient) result.variance_gradient.col(i).setConstant(kNaN);
      continue;
    }
    if (options.variance && result.state[static_cast<std::size_t>(i)] != SpaceState::kUnknown) {
      result.occupancy[i] = normalCdf(-result.distance[i] / std::sqrt(std::max(1e-12, result.variance[i])));
    }
  }
  return result;
}

}  // namespace gpis_mapping
