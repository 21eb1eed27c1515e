// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>
#include <opencv2/core/types.hpp>

#include "surface_picking/cuboids.h"

namespace surface_picking {

constexpr double kAlong = 0.7;  // cosine within which a border point's direction is that of a side

/// Two directions in the plane of a face, unit and square to each other.
struct Frame {
  Eigen::Vector3d u, v;
};

/// Where a patch ends along a direction.
struct Side {
  double reach{0.0};             ///< of all its border [m from its centre]
  std::optional<double> edge{};  ///< of the body, corrected for the inset [m]
};

/// Length of an edge [m] by the bins along it that hold one of these places.
double coveredLength(const std::vector<double>& along);

/// `space` at points. Throws std::invalid_argument for an answer of another length.
std::vector<SpaceState> askSpace(const SpaceQuery& space, const Eigen::Matrix3Xd& points);

/// What can be said of patches one by one: which border points are edges of a body, how a face's edges may lie, and where it
/// ends. Keeps references to all it is given.
class PatchShapes {
 public:
  PatchShapes(const TriangleMesh& mesh, const std::vector<Patch>& patches, const SpaceQuery& space,
              const CuboidConfig& config);

  /// Of each border point of patch `i`.
  const std::vector<bool>& isEdge(std::size_t i) const { return shapes_[i].is_edge; }
  /// How the edges of a face that patch `i` shows may lie; none for a large patch.
  const std::vector<Frame>& orientations(std::size_t i) const { return shapes_[i].orientations; }
  /// Where patch `i` ends along `axis`; its edge there runs along `across`.
  Side sideOf(std::size_t i, const Eigen::Vector3d& axis, const Eigen::Vector3d& across) const;
  /// Whether the projection of a point lies inside the hull of patch `i`, and not near its border: patches reach a little into
  /// the rounding at their foot.
  bool isWellInside(std::size_t i, const Eigen::Vector3d& p_map) const;

 private:
  struct Shape {
    std::vector<bool> is_edge;  // of the border's points
    Frame frame;
    std::vector<cv::Point2f> hull;  // in frame, about the patch's centre
    std::vector<Frame> orientations;
  };

  void findEdges(const SpaceQuery& space);
  std::vector<Frame> orientationsOf(std::size_t i) const;
  std::optional<Eigen::Vector3d> straightest(std::size_t i) const;
  Eigen::Vector2d inFrame(std::size_t i, const Eigen::Vector3d& p_map) const;

  const std::vector<Patch>& patches_;
  const CuboidConfig& config_;
  std::vector<Shape> shapes_;
};

}  // namespace surface_picking
