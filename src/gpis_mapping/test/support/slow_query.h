// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_TEST_SLOW_QUERY_H
#define GPIS_MAPPING_TEST_SLOW_QUERY_H

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "gpis_mapping/map_snapshot.h"
#include "gpis_mapping/partition_of_unity.h"

namespace gpis_mapping_test {

/// MapSnapshot::query in the obvious way: one point at a time, every training point looked at, in double precision but
/// for the cells' own answers, which their own tests compare with a dense GP.
class SlowQuery {
 public:
  struct Answer {
    double distance{kNaN};
    Eigen::Vector3d gradient = Eigen::Vector3d::Constant(kNaN);
    double variance{kNaN};
    Eigen::Vector3d variance_gradient = Eigen::Vector3d::Constant(kNaN);
    double occupancy{kNaN};
    double euclidean_distance{kNaN};
    Eigen::Vector3d euclidean_gradient = Eigen::Vector3d::Constant(kNaN);
    double surface_std{kNaN};
    gpis_mapping::SpaceState state{gpis_mapping::SpaceState::kUnknown};
    bool is_tied{false};  // two training points, or the votes of the two sides, are equal to within rounding
  };

  explicit SlowQuery(const gpis_mapping::MapSnapshot& map) : map_(map) {
    for (const auto& [key, cell] : map.cells()) {
      for (std::size_t i = 0; i < cell->numOwn(); ++i) {
        discs_.push_back({0.0, cell->position(i), cell->normal(i).cast<double>(), cell->noiseVariance(i)});
      }
    }
  }

  Answer at(const Eigen::Vector3d& x) const {
    using gpis_mapping::SpaceState;
    const gpis_mapping::GpisConfig& config = map_.config();
    const gpis_mapping::ObservedLayer& observed = map_.observed();
    Answer answer;
    if (!x.allFinite()) return answer;
    Reading reading = read(x, &answer.is_tied);
    if (!reading.found || reading.nearest > config.query.max_distance_m) {
      answer.state = observed.isFree(x) ? SpaceState::kFree : SpaceState::kUnknown;
      if (reading.found && answer.state != SpaceState::kUnknown) addVariance(x, &answer);
      return answer;
    }
    double distance = reading.distance;
    Eigen::Vector3d gradient = reading.gradient;
    if (distance < -0.5 * observed.blockSize() && observed.isFree(x)) {
      distance = -distance;
      gradient = -gradient;
    }
    if (reading.nearest < config.surface.blend_radius_m) {
      const gpis_mapping::FieldSample f = map_.field(x);
      if (f.valid) {
        const double begin = config.surface.spacing_m;
        const double end = 0.9 * config.surface.blend_radius_m;
        const double t = (std::abs(distance) - begin) / (end - begin);
        const double s = std::max(0.0, std::min(1.0, t));
        const double share = s * s * (3.0 - 2.0 * s);
        const double slope = 6.0 * s * (1.0 - s) / (end - begin) * (distance < 0.0 ? -1.0 : 1.0);
        const Eigen::Vector3d share_gradient = slope * gradient;
        gradient = (1.0 - share) * f.gradient + share * gradient + (distance - f.value) * share_gradient;
        distance = (1.0 - share) * f.value + share * distance;
      }
    }
    answer.state = map_.state(x, distance);
    if (answer.state == SpaceState::kFree && reading.aside > 1.5 * config.surface.spacing_m && !observed.isFree(x)) {
      answer.state = SpaceState::kUnknown;
    }
    answer.euclidean_distance = std::abs(distance);
    answer.euclidean_gradient = distance < 0.0 ? Eigen::Vector3d(-gradient) : gradient;
    const bool has_answer =
        answer.state != SpaceState::kUnknown || (distance >= 0.0 && reading.nearest <= config.query.unknown_reach_m);
    if (!has_answer) return answer;
    answer.distance = distance;
    answer.gradient = gradient;
    answer.surface_std = reading.surface_std;
    addVariance(x, &answer);
    return answer;
  }

 private:
  static constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  static constexpr double kRounding_m = 1e-7;  // of places and distances as floats

  struct Disc {
    double distance;  // of its middle from the place asked for
    Eigen::Vector3d position, normal;
    float variance;
  };
  struct Reading {
    bool found{false};
    double distance{0.0}, nearest{0.0}, aside{0.0}, surface_std{0.0};
    Eigen::Vector3d gradient;
  };

  Reading read(const Eigen::Vector3d& x, bool* is_tied) const {
    Reading reading;
    std::vector<Disc> near = discs_;
    if (near.empty()) return reading;
    for (Disc& disc : near) disc.distance = (x - disc.position).norm();
    std::sort(near.begin(), near.end(), [](const Disc& a, const Disc& b) { return a.distance < b.distance; });
    const std::size_t count = std::min<std::size_t>(8, near.size());
    const auto isTie = [&](std::size_t i, std::size_t j) {
      return j < near.size() && near[j].distance - near[i].distance < kRounding_m;
    };
    *is_tied = isTie(0, 1) || isTie(count - 1, count);
    const double scale = map_.config().surface.spacing_m;
    double vote = 0.0, votes = 0.0;
    for (std::size_t i = 0; i < count; ++i) {
      const double along = near[i].normal.dot(x - near[i].position);
      const double excess2 = std::pow(near[i].distance, 2) - std::pow(near[0].distance, 2);
      vote += std::exp(-excess2 / (scale * scale)) * along;
      votes += std::exp(-excess2 / (scale * scale)) * std::abs(along);
      *is_tied = *is_tied || std::abs(along) < kRounding_m;
    }
    *is_tied = *is_tied || std::abs(vote) < 1e-5 * votes;
    const double sign = vote < 0.0 ? -1.0 : 1.0;
    double best = std::numeric_limits<double>::infinity();
    double second = best;
    for (std::size_t i = 0; i < count; ++i) {
      const Eigen::Vector3d offset = x - near[i].position;
      const Eigen::Vector3d& n = near[i].normal;
      const double along = n.dot(offset);
      if (along * sign < 0.0 && i > 0) continue;
      const double aside = std::sqrt(std::max(0.0, offset.squaredNorm() - along * along));
      const double beyond = std::max(0.0, aside - 0.5 * scale);
      const double distance = std::hypot(along, beyond);
      if (i == 0) reading.aside = aside;
      second = std::min(second, std::max(best, distance));
      if (distance >= best) continue;
      best = distance;
      Eigen::Vector3d away = along * n;
      if (aside > 0.0) away += (offset - along * n) * (beyond / aside);
      reading.gradient = away.norm() > 1e-9 ? Eigen::Vector3d(sign * away.normalized()) : n;
    }
    *is_tied = *is_tied || second - best < kRounding_m;
    reading.found = true;
    reading.nearest = near[0].distance;
    reading.surface_std = std::sqrt(near[0].variance);
    reading.distance = sign * best;
    return reading;
  }

  void addVariance(const Eigen::Vector3d& x, Answer* answer) const {
    const double prior = std::pow(map_.config().signalStd(), 2);
    gpis_mapping::BlendWeight weights[8];
    const int count = gpis_mapping::blendWeights(x, map_.config().cells, weights);
    answer->variance = 0.0;
    answer->variance_gradient.setZero();
    for (int i = 0; i < count; ++i) {
      const gpis_mapping::CellGp* const cell = map_.cells().get(weights[i].key);
      double variance = prior;
      if (cell != nullptr) {
        Eigen::VectorXf of_cell;
        gpis_mapping::Points3f gradient;
        cell->variance(x, &of_cell, &gradient);
        variance = of_cell[0];
        answer->variance_gradient += weights[i].weight * gradient.col(0).cast<double>();
      }
      answer->variance += weights[i].weight * variance;
      answer->variance_gradient += weights[i].gradient * variance;
    }
    if (answer->state == gpis_mapping::SpaceState::kUnknown) return;
    const double z = -answer->distance / std::sqrt(std::max(1e-12, answer->variance));
    answer->occupancy = z < -8.0 ? 0.0 : 0.5 * std::erfc(-z / std::sqrt(2.0));
  }

  const gpis_mapping::MapSnapshot& map_;
  std::vector<Disc> discs_;
};

}  // namespace gpis_mapping_test

#endif  // GPIS_MAPPING_TEST_SLOW_QUERY_H
