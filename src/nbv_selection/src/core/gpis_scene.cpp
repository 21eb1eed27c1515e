// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/gpis_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include <gpis_mapping/mesh_extractor.h>
#include <interactive_mapping_common/config/range_check.h>

namespace nbv_selection {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

double normalCdf(double x) {
  return 0.5 * std::erfc(-x / std::sqrt(2.0));
}

void requireAnswers(Eigen::Index answers, Eigen::Index points) {
  if (answers == points) return;
  throw std::runtime_error("the map answered for " + std::to_string(answers) + " of " + std::to_string(points) +
                           " points");
}

}  // namespace

GpisScene::GpisScene(MappedSurface surface, double prior_std_m, Query query, const Config& config)
    : surface_(std::move(surface)),
      prior_variance_(prior_std_m * prior_std_m),
      query_(std::move(query)),
      config_(config) {
  std::vector<std::string> problems = interactive_mapping::problemsOf(config_);
  interactive_mapping::RangeCheck check;
  check("prior_std_m", prior_std_m, 1e-6, 1e3, "m");
  problems.insert(problems.end(), check.problems().begin(), check.problems().end());
  if (!query_) problems.push_back("query is empty, must be a function");
  interactive_mapping::refuseIfAny("impossible scene:", problems);
}

UncertaintyField GpisScene::uncertainty(const gpis_mapping::Points3d& points_map) const {
  const Eigen::Index count = points_map.cols();
  if (count == 0) return {Eigen::VectorXd(0), gpis_mapping::Points3d(3, 0)};
  gpis_mapping::QueryOptions options;
  options.variance_gradient = true;
  const gpis_mapping::QueryResult answer = query_(points_map, options);
  requireAnswers(answer.variance.size(), count);
  requireAnswers(answer.variance_gradient.cols(), count);
  requireAnswers(answer.euclidean_distance.size(), count);
  UncertaintyField field{answer.variance, answer.variance_gradient};
  for (Eigen::Index i = 0; i < count; ++i) {
    if (std::isfinite(field.value[i]) && field.gradient.col(i).allFinite()) continue;
    // The map gives no variance in unknown space far from its surface, but says how far: there its posterior is the
    // prior. Without a distance it knows of nothing about this point.
    const bool is_far = std::isfinite(answer.euclidean_distance[i]);
    field.value[i] = is_far ? prior_variance_ : kNaN;
    field.gradient.col(i).setConstant(is_far ? 0.0 : kNaN);
  }
  return field;
}

OccupancyField GpisScene::occupancy(const gpis_mapping::Points3d& points_map) const {
  const Eigen::Index count = points_map.cols();
  OccupancyField field{Eigen::VectorXd::Zero(count), gpis_mapping::Points3d::Zero(3, count),
                       std::vector<bool>(static_cast<std::size_t>(count), false)};
  if (count == 0) return field;
  // Asked once: to ask for distances first, and for variances where they turn out small, takes longer unless more than
  // half of the points are far from the surface, and the map may change in between.
  const gpis_mapping::QueryResult answer = query_(points_map, gpis_mapping::QueryOptions());
  requireAnswers(answer.distance.size(), count);
  requireAnswers(answer.variance.size(), count);
  requireAnswers(answer.gradient.cols(), count);
  requireAnswers(answer.euclidean_distance.size(), count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const double length = answer.gradient.col(i).norm();
    const bool is_supported = answer.euclidean_distance[i] <= config_.support_m && std::isfinite(answer.distance[i]) &&
                              std::isfinite(answer.variance[i]) && std::isfinite(length) && length > 0.0;
    if (!is_supported) continue;
    field.is_supported[static_cast<std::size_t>(i)] = true;
    field.normal.col(i) = answer.gradient.col(i) / length;
    field.probability[i] =
        occupancyProbability(answer.distance[i], answer.variance[i], config_.alpha_1_m, config_.beta);
  }
  return field;
}

std::unique_ptr<GpisScene> makeGpisScene(std::shared_ptr<const gpis_mapping::MapSnapshot> snapshot,
                                         const GpisScene::Config& config) {
  if (snapshot == nullptr) throw std::invalid_argument("snapshot is null, must be a map");
  gpis_mapping::MeshExtractor extractor(snapshot->config());
  extractor.update(*snapshot);
  gpis_mapping::TriangleMesh mesh = extractor.mesh();
  MappedSurface surface;
  surface.points_map = std::move(mesh.vertices_map);
  surface.normals_map = std::move(mesh.normals_map);
  surface.uncertainty = std::move(mesh.variance_m2);
  surface.update = snapshot->numUpdates();
  // A snapshot does not keep the stamp of its last image; the latest at which one saw free space is that, but for an
  // image without any.
  float last_free_s = 0.0F;
  for (const auto& [key, chunk] : snapshot->observed().chunks()) {
    last_free_s = std::max(last_free_s, *std::max_element(chunk->begin(), chunk->end()));
  }
  surface.stamp_s = snapshot->epoch() + static_cast<double>(last_free_s);
  const double prior_std_m = snapshot->config().signalStd();
  return std::make_unique<GpisScene>(
      std::move(surface), prior_std_m,
      [snapshot = std::move(snapshot)](const gpis_mapping::Points3d& points_map,
                                       const gpis_mapping::QueryOptions& options) {
        return snapshot->query(points_map, options);
      },
      config);
}

double occupancyProbability(double mean_m, double variance_m2, double alpha_1_m, double beta) {
  return normalCdf((-alpha_1_m * mean_m + beta) / std::sqrt(1.0 + alpha_1_m * alpha_1_m * variance_m2));
}

}  // namespace nbv_selection
