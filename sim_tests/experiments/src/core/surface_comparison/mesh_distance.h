// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include <Eigen/Core>

namespace experiments {

/// Triangles in the map frame [m], counter-clockwise seen from outside.
struct Surface {
  std::vector<Eigen::Vector3d> points_map;
  std::vector<Eigen::Vector3f> normals_map;  ///< per point; for drawing only, may be empty
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// Signed distance from points to a triangle mesh, which may be open.
///
/// The magnitude is the distance to the nearest triangle. The sign is the side of the surface: that of the pseudonormal
/// of the nearest face, edge or vertex (Baerentzen and Aanaes, "Signed distance computation using the angle weighted
/// pseudonormal", TVCG 2005); taking the nearest triangle's own normal is wrong wherever edges or corners are nearest.
/// Points at exactly the same position count as one. Not for concurrent use: VTK's locator marks what it has visited.
class MeshDistance {
 public:
  struct Nearest {
    double signed_distance_m;   ///< positive on the side the triangles' normals point to
    Eigen::Vector3d point_map;  ///< nearest point of the mesh
    bool on_border;             ///< that point is on an open border: how far the surface goes on is not known
  };

  /// Throws std::invalid_argument for an index out of range, a point that is not finite and a mesh without area.
  explicit MeshDistance(const Surface& surface);
  ~MeshDistance();
  MeshDistance(const MeshDistance&) = delete;
  MeshDistance& operator=(const MeshDistance&) = delete;

  /// `p_map` must be finite; std::invalid_argument otherwise.
  Nearest nearest(const Eigen::Vector3d& p_map) const;

 private:
  struct Topology;
  struct Locator;

  std::unique_ptr<Topology> topology_;
  std::unique_ptr<Locator> locator_;
};

/// Points spread evenly over the area: one per `spacing_m` squared, at random places within their triangles, so that each
/// stands for the same area however large the triangles are. The same seed gives the same points. Throws
/// std::invalid_argument for a spacing that is not positive.
std::vector<Eigen::Vector3d> sampleEvenly(const Surface& surface, double spacing_m, std::uint64_t seed);

/// Of signed values [m]; all zero when there are none.
struct Statistics {
  std::size_t count{0};
  double mean{0.0};
  double std_dev{0.0};  ///< about the mean
  double rms{0.0};
  double median_abs{0.0};
  double p95_abs{0.0};
  double max_abs{0.0};
};

Statistics statisticsOf(const std::vector<double>& values);

}  // namespace experiments
