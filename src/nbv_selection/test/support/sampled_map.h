// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include <Eigen/Geometry>
#include <gpis_mapping/gpis_map.h>

namespace nbv_selection_test {

/// Surface points of a map that was never seen by a camera: what a GpisMap is restored from. Frame: map.
class MapSamples {
 public:
  double spacing_m{0.02};  // the map's own
  double noise_std_m{0.002};

  /// Spanned by `u` and `v` from `corner`, normal u x v; points in a grid, half a step inside of the border.
  void addRectangle(const Eigen::Vector3d& corner, const Eigen::Vector3d& u, const Eigen::Vector3d& v) {
    const int count_u = std::max(1, static_cast<int>(std::lround(u.norm() / spacing_m)));
    const int count_v = std::max(1, static_cast<int>(std::lround(v.norm() / spacing_m)));
    for (int i = 0; i < count_u; ++i) {
      for (int j = 0; j < count_v; ++j) {
        gpis_mapping::SurfacePoint point;
        point.position_map = corner + u * ((i + 0.5) / count_u) + v * ((j + 0.5) / count_v);
        point.normal_map = u.cross(v).normalized().cast<float>();
        point.variance_m2 = static_cast<float>(noise_std_m * noise_std_m);
        point.normal_variance = 4e-4F;  // 1.1 degrees, as of points seen well
        points_.push_back(point);
      }
    }
  }

  /// Top and sides of an upright box; nobody sees what it stands on.
  void addBox(const Eigen::AlignedBox3d& box) {
    const Eigen::Vector3d low = box.min(), size = box.sizes();
    const Eigen::Vector3d x = size.x() * Eigen::Vector3d::UnitX(), y = size.y() * Eigen::Vector3d::UnitY(),
                          z = size.z() * Eigen::Vector3d::UnitZ();
    addRectangle(low + z, x, y);
    addRectangle(low, x, z);
    addRectangle(low + y, z, x);
    addRectangle(low, z, y);
    addRectangle(low + x, y, z);
  }

  std::shared_ptr<const gpis_mapping::MapSnapshot> snapshot(const gpis_mapping::GpisConfig& config = {},
                                                            double stamp_s = 0.0) const {
    gpis_mapping::MapContents contents;
    contents.config = config;
    contents.num_updates = 1;
    contents.points = points_;
    contents.epoch_s = stamp_s;
    return gpis_mapping::GpisMap(std::move(contents)).snapshot();
  }

  const std::vector<gpis_mapping::SurfacePoint>& points() const { return points_; }

 private:
  std::vector<gpis_mapping::SurfacePoint> points_;
};

}  // namespace nbv_selection_test
