// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_INSERTION_GRID_H
#define GPIS_MAPPING_INSERTION_GRID_H

#include <atomic>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "gpis_mapping/point_update.h"

namespace gpis_mapping {

/// When is a point so near that a new one has no place beside it?
struct Crowding {
  double spacing_m;
  double tolerance_sigmas;

  /// Farther away no point leaves no room for one of this variance [m].
  double reach(double variance_m2) const;

  /// Of the same face within the spacing (along the normal: within the noise of both, if that is more), or of any face
  /// within half of that. `offset_m`: from the point in the way to the new one; `reach_m`: of the new one.
  template <typename Scalar>
  bool leavesNoRoom(const Eigen::Matrix<Scalar, 3, 1>& offset_m, const Eigen::Vector3f& normal,
                    const Eigen::Vector3f& new_normal, Scalar variance_m2, Scalar reach_m) const {
    const Scalar distance2 = offset_m.squaredNorm();
    if (distance2 > reach_m * reach_m) return false;
    const Scalar spacing2 = static_cast<Scalar>(spacing_m * spacing_m);
    if (distance2 < Scalar(0.25) * spacing2) return true;
    // Two faces that meet at an edge both need points near it.
    if (normal.dot(new_normal) <= kSameFaceCosine) return false;
    if (distance2 < spacing2) return true;
    const Scalar along = offset_m.dot(normal.template cast<Scalar>());
    const Scalar sigmas2 = static_cast<Scalar>(tolerance_sigmas * tolerance_sigmas);
    return distance2 - along * along < spacing2 && along * along < sigmas2 * variance_m2;
  }
};

/// The pixels of a frame at which new points may begin. Most show what the map has already: its points, projected into the
/// image, strike them out at less cost than a search of the map for each pixel.
class InsertionGrid {
 public:
  // 3 px are 1.7 cm at 3 m with f = 525 px: below the spacing.
  static constexpr int kStridePx = 3;

  InsertionGrid(const Frame& frame, const GpisConfig& config, const Crowding& crowding, int num_threads);

  int rows() const { return rows_; }
  int columns() const { return columns_; }

  /// Strikes out the smooth pixels beside which `point` leaves no room. From any thread.
  void strikeOut(const SurfacePoint& point);

  bool isOpen(int row, int column) const { return open_[index(row, column)].load(std::memory_order_relaxed) != 0; }

 private:
  struct Pixel {
    Eigen::Vector3f p_camera;
    Eigen::Vector3f n_camera;
    float variance_m2;
    float reach_m;  // 0: not smooth, no point strikes it out
  };

  std::size_t index(int row, int column) const { return static_cast<std::size_t>(row) * columns_ + column; }

  const Frame& frame_;
  Crowding crowding_;
  int rows_;
  int columns_;
  std::vector<Pixel> pixels_;
  std::vector<std::atomic<std::uint8_t>> open_;
};

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_INSERTION_GRID_H
