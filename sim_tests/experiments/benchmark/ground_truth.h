// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <Eigen/Geometry>
#include <nlohmann/json.hpp>
#include <octomap/OcTree.h>

#include "gpis_mapping/mesh_extractor.h"
#include "surface_comparison/surface_places.h"
#include "synthetic_depth/depth_renderer.h"
#include "synthetic_depth/scene.h"

namespace experiments {

/// The surface a map claims, map frame [m]: all that counts as covered, and points that each stand for the same area.
struct ClaimedSurface {
  std::vector<Eigen::Vector3d> cover;
  std::vector<Eigen::Vector3d> samples;
};

ClaimedSurface surfaceOf(const gpis_mapping::TriangleMesh& mesh);
/// Centres of the occupied voxels.
ClaimedSurface surfaceOf(const octomap::OcTree& tree);

/// What the exact scene says, for the frame before the removal and the first one after it.
class GroundTruth {
 public:
  explicit GroundTruth(const synthetic_depth::Scene& scene);

  bool hasRemoval() const { return last_before_ + 1 < scene_.numFrames(); }
  int lastBefore() const { return last_before_; }
  std::size_t numGhosts() const { return ghosts_.size(); }

  /// Of what was taken away and is seen through now, the share that the surface still claims.
  double ghostShare(const ClaimedSurface& surface) const;

  /// Error and completeness in the scene's region of interest; before the removal also the error by place.
  nlohmann::json quality(const ClaimedSurface& surface, bool after) const;

  /// Random points [m, map frame] with exact distance [m] in (low, high] from surface that was visible, in space that some
  /// frame up to lastBefore() saw as free.
  void freePoints(double low_m, double high_m, Eigen::Index count, std::uint64_t seed, Eigen::Matrix3Xd* points,
                  Eigen::VectorXd* exact) const;

 private:
  bool inRoi(const Eigen::Vector3d& p_map) const;
  bool seenFree(const Eigen::Vector3d& p_map, int frame) const;
  std::vector<Eigen::Vector3d> visibleInRoi(int frame, std::vector<Eigen::Vector3d>* normals = nullptr) const;
  /// Statistics of `errors_m` at `points`, by what the exact surface is like there.
  nlohmann::json byPlace(const Eigen::Matrix3Xd& points, const Eigen::VectorXd& errors_m) const;

  synthetic_depth::Scene scene_;
  int last_before_;
  SurfacePlaces places_;
  std::vector<synthetic_depth::ViewCaster> views_;
  std::vector<Eigen::Vector3d> visible_before_;
  std::vector<Eigen::Vector3d> normals_before_;
  std::vector<Eigen::Vector3d> visible_after_;
  std::vector<Eigen::Vector3d> ghosts_;
};

}  // namespace experiments
