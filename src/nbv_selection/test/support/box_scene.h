// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <unordered_map>
#include <utility>
#include <vector>

#include <gpis_mapping/types.h>

#include "nbv_selection/scene_model.h"
#include "support/box_pile.h"

namespace nbv_selection {

/// A pile of boxes as a map knows it that was looked at by some eyes. Its surface are the samples that were seen. Its
/// uncertainty u is a function of the distance d to the nearest of them, prior (1 - (1 - d^2 / R^2)^2) up to R and the
/// prior beyond, with that function's own gradient. What stands where is exact, but known near seen samples only.
class BoxScene : public SceneModel {
 public:
  struct Options {
    double spacing_m{0.02};
    double ground_margin_m{0.5};
    double prior{8.3e-4};     // of a map whose kernel has a length of 5 cm [m^2]
    double reach_m{0.06};     // R
    double support_m{0.055};  // a little more than the band of the manipulability's samples
    std::function<bool(const Eigen::Vector3d& p_map)> is_mapped{};  // false: outside of the map. Empty: all is inside
  };

  BoxScene(const BoxPile& pile, const std::vector<Eigen::Vector3d>& eyes_map, const Options& options)
      : pile_(pile), options_(options), cell_m_(std::max(options.reach_m, options.support_m)) {
    SamplingOptions sampling;
    sampling.spacing_m = options.spacing_m;
    sampling.ground_margin_m = options.ground_margin_m;
    sampling.is_seen = [&options, is_seen = seenFrom(pile, eyes_map)](const Eigen::Vector3d& p_map,
                                                                      const Eigen::Vector3d& normal_map) {
      return (!options.is_mapped || options.is_mapped(p_map)) && is_seen(p_map, normal_map);
    };
    surface_ = sampleSurface(pile, sampling);
    surface_.stamp_s = 12.5;
    for (std::size_t i = 0; i < surface_.points_map.size(); ++i) {
      near_[gpis_mapping::LatticeKey::of(surface_.points_map[i], cell_m_)].push_back(i);
    }
  }
  BoxScene(const BoxPile& pile, const std::vector<Eigen::Vector3d>& eyes_map) : BoxScene(pile, eyes_map, Options()) {}

  MappedSurface surface() const override { return surface_; }

  UncertaintyField uncertainty(const gpis_mapping::Points3d& points_map) const override {
    UncertaintyField field{Eigen::VectorXd::Constant(points_map.cols(), options_.prior),
                           gpis_mapping::Points3d::Zero(3, points_map.cols())};
    const double reach2 = options_.reach_m * options_.reach_m;
    for (Eigen::Index i = 0; i < points_map.cols(); ++i) {
      const auto nearest = nearestSeen(points_map.col(i), options_.reach_m);
      if (!nearest) continue;
      const Eigen::Vector3d off = points_map.col(i) - surface_.points_map[*nearest];
      const double left = 1.0 - off.squaredNorm() / reach2;
      field.value[i] = options_.prior * (1.0 - left * left);
      field.gradient.col(i) = options_.prior * 4.0 * left / reach2 * off;
    }
    return field;
  }

  OccupancyField occupancy(const gpis_mapping::Points3d& points_map) const override {
    OccupancyField field{Eigen::VectorXd::Zero(points_map.cols()), gpis_mapping::Points3d::Zero(3, points_map.cols()),
                         std::vector<bool>(static_cast<std::size_t>(points_map.cols()), false)};
    for (Eigen::Index i = 0; i < points_map.cols(); ++i) {
      const auto nearest = nearestSeen(points_map.col(i), options_.support_m);
      if (!nearest) continue;
      field.is_supported[static_cast<std::size_t>(i)] = true;
      field.probability[i] = isFull(pile_, points_map.col(i)) ? 1.0 : 0.0;
      field.normal.col(i) = surface_.normals_map[*nearest].cast<double>();
    }
    return field;
  }

  double priorUncertainty() const override { return options_.prior; }

  const BoxPile& pile() const { return pile_; }

 protected:
  MappedSurface surface_;

 private:
  /// Index of a nearest seen sample within `radius_m`, not more than a cell.
  std::optional<std::size_t> nearestSeen(const Eigen::Vector3d& p_map, double radius_m) const {
    std::optional<std::size_t> nearest;
    if (!p_map.allFinite()) return nearest;
    double best = radius_m * radius_m;
    const gpis_mapping::LatticeKey middle = gpis_mapping::LatticeKey::of(p_map, cell_m_);
    for (gpis_mapping::LatticeKey key{middle.x - 1, 0, 0}; key.x <= middle.x + 1; ++key.x) {
      for (key.y = middle.y - 1; key.y <= middle.y + 1; ++key.y) {
        for (key.z = middle.z - 1; key.z <= middle.z + 1; ++key.z) {
          const auto found = near_.find(key);
          if (found == near_.end()) continue;
          for (const std::size_t i : found->second) {
            const double distance2 = (surface_.points_map[i] - p_map).squaredNorm();
            if (distance2 >= best) continue;
            best = distance2;
            nearest = i;
          }
        }
      }
    }
    return nearest;
  }

  BoxPile pile_;
  Options options_;
  double cell_m_;
  std::unordered_map<gpis_mapping::LatticeKey, std::vector<std::size_t>, gpis_mapping::LatticeKeyHash> near_;
};

/// Eyes on a circle about the origin, the first at `from_rad`.
inline std::vector<Eigen::Vector3d> eyesAround(int count, double radius_m = 2.5, double height_m = 1.3,
                                               double from_rad = 0.0) {
  std::vector<Eigen::Vector3d> eyes;
  for (int i = 0; i < count; ++i) {
    const double angle_rad = from_rad + 2.0 * M_PI * i / count;
    eyes.emplace_back(radius_m * std::cos(angle_rad), radius_m * std::sin(angle_rad), height_m);
  }
  return eyes;
}

}  // namespace nbv_selection
