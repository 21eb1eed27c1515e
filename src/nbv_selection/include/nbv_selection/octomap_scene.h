// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <octomap/OcTree.h>

#include "nbv_selection/scene_model.h"

namespace nbv_selection {

/// An OctoMap as a scene, for the strategies this work is compared with: u is the entropy of a voxel [bit], 1 where
/// nothing was seen; its gradient is discrete, central differences of neighbouring cells; occupancy is the voxel's.
class OctomapScene : public SceneModel {
 public:
  struct Config {
    double gradient_step_m{0.1};  // of the discrete gradient: u is averaged over cells of this size
    double surface_band_m{0.03};  // a point farther from every occupied voxel's middle than this has no data support

    std::vector<std::string> validate() const;
  };

  /// Throws std::invalid_argument for an impossible config.
  OctomapScene(std::shared_ptr<const octomap::OcTree> tree, std::uint64_t update, double stamp_s, const Config& config);
  ~OctomapScene() override;

  /// Middles of occupied voxels that have a voxel seen free beside them; normals towards free neighbours.
  MappedSurface surface() const override;
  UncertaintyField uncertainty(const gpis_mapping::Points3d& points_map) const override;
  OccupancyField occupancy(const gpis_mapping::Points3d& points_map) const override;
  double priorUncertainty() const override { return 1.0; }

 private:
  struct State;
  std::unique_ptr<const State> state_;
};

/// Entropy [bit] of a voxel that is occupied with probability p; 1 at 0.5.
double voxelEntropy(double probability);

}  // namespace nbv_selection
