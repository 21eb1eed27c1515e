// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <string>

#include <gpis_mapping/map_snapshot.h>
#include <interactive_mapping_common/config/schema.h>

#include "nbv_selection/scene_model.h"

namespace nbv_selection {

/// The dynamic Gaussian-process implicit surface as a scene. u is the variance of the field [m^2], its gradient
/// analytic (eq 10), the occupancy eq 14's Phi. Each answer takes one question. In unknown space far from the surface
/// the map gives a distance, but no variance: u is the prior's there, without slope. Where it does not even give a
/// distance (no surface within its reach, or none at all), u is NaN.
class GpisScene : public SceneModel {
 public:
  struct Config {
    double alpha_1_m{100.0};
    double beta{0.0};
    double support_m{0.06};

    static void fields(Config& c, interactive_mapping::Fields& f) {
      f("alpha_1_m", c.alpha_1_m, 1.0, 1e4, "1/m", "steepness of eq 14, about 1 / sigma of a surface");
      f("beta", c.beta, -10.0, 10.0, "", "offset of eq 14");
      f("support_m", c.support_m, 0.001, 0.2, "m",
        "a point farther from the surface has no data; at least manipulability/band_m, or many samples seem lost");
    }
  };

  /// What it asks the map: QueryResult with the options that are set. Throws std::runtime_error if the map is silent;
  /// so does the scene if answers are not as many as points.
  using Query =
      std::function<gpis_mapping::QueryResult(const gpis_mapping::Points3d&, const gpis_mapping::QueryOptions&)>;

  /// `prior_std_m`: sigma_f of the map. Throws std::invalid_argument for an impossible config.
  GpisScene(MappedSurface surface, double prior_std_m, Query query, const Config& config);

  MappedSurface surface() const override { return surface_; }
  UncertaintyField uncertainty(const gpis_mapping::Points3d& points_map) const override;
  OccupancyField occupancy(const gpis_mapping::Points3d& points_map) const override;
  double priorUncertainty() const override { return prior_variance_; }

 private:
  MappedSurface surface_;
  double prior_variance_;
  Query query_;
  Config config_;
};

/// A map in this process: meshes it, and asks the snapshot itself. The surface's stamp is the last at which an image
/// saw free space; the snapshot keeps no other.
std::unique_ptr<GpisScene> makeGpisScene(std::shared_ptr<const gpis_mapping::MapSnapshot> snapshot,
                                         const GpisScene::Config& config);

/// Eq 14's Phi((-alpha mu + beta) / sqrt(1 + alpha^2 sigma^2)).
double occupancyProbability(double mean_m, double variance_m2, double alpha_1_m, double beta);

}  // namespace nbv_selection
