// SPDX-License-Identifier: BSD-3-Clause
#include "support/box_world.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

namespace motion_planning {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kTouching_m = 1e-4;  // faces nearer than this lie on each other
constexpr double kInFront_m = 0.005;  // of a face: space there must be known for the face to have been seen

/// A grid over the surface of a box, or over a patch of ground; triangles that `is_seen` refuses are left out.
class Mesher {
 public:
  explicit Mesher(Surface* surface) : surface_(surface) {}

  using Index = std::array<int, 3>;

  void quad(const std::array<Index, 4>& corners, const std::function<Eigen::Vector3d(const Index&)>& position,
            const Eigen::Vector3d& normal_map, const std::function<bool(const Eigen::Vector3d&)>& is_seen) {
    for (const auto& [a, b, c] : {std::array<int, 3>{0, 1, 2}, std::array<int, 3>{0, 2, 3}}) {
      const Index ia = corners[static_cast<std::size_t>(a)];
      const Index ib = corners[static_cast<std::size_t>(b)];
      const Index ic = corners[static_cast<std::size_t>(c)];
      if (!is_seen((position(ia) + position(ib) + position(ic)) / 3.0)) continue;
      surface_->triangles.push_back(
          {vertex(ia, position, normal_map), vertex(ib, position, normal_map), vertex(ic, position, normal_map)});
    }
  }

  /// Once for each box: its vertices are not shared with the next one's.
  void finish() {
    for (std::size_t i = begin_; i < surface_->vertices_map.size(); ++i) {
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (const Eigen::Vector3d& normal : normals_[i - begin_]) sum += normal;
      surface_->normals_map[i] = sum.normalized().cast<float>();
    }
    begin_ = surface_->vertices_map.size();
    vertices_.clear();
    normals_.clear();
  }

 private:
  std::uint32_t vertex(const Index& index, const std::function<Eigen::Vector3d(const Index&)>& position,
                       const Eigen::Vector3d& normal_map) {
    const auto [found, is_new] = vertices_.emplace(index, static_cast<std::uint32_t>(surface_->vertices_map.size()));
    if (is_new) {
      surface_->vertices_map.push_back(position(index));
      surface_->normals_map.push_back(Eigen::Vector3f::Zero());
      normals_.emplace_back();
    }
    std::vector<Eigen::Vector3d>& normals = normals_[found->second - begin_];
    if (std::none_of(normals.begin(), normals.end(), [&](const auto& n) { return n.isApprox(normal_map); })) {
      normals.push_back(normal_map);
    }
    return found->second;
  }

  Surface* surface_;
  std::size_t begin_{0};
  std::map<Index, std::uint32_t> vertices_;
  std::vector<std::vector<Eigen::Vector3d>> normals_;  // of the faces that meet in a vertex
};

}  // namespace

double signedDistance(const OrientedBox& box, const Eigen::Vector3d& p_map) {
  const Eigen::Vector3d q = (box.T_map_box.inverse() * p_map).cwiseAbs() - 0.5 * box.size_m;
  return q.cwiseMax(0.0).norm() + std::min(0.0, q.maxCoeff());
}

OrientedBox uprightBox(const Eigen::Vector3d& middle_map, const Eigen::Vector3d& size_m) {
  return {Eigen::Isometry3d(Eigen::Translation3d(middle_map)), size_m};
}

double BoxWorld::distance(const Eigen::Vector3d& p_map) const {
  double nearest = ground_z_m ? p_map.z() - *ground_z_m : kInfinity;
  for (const OrientedBox& box : boxes) nearest = std::min(nearest, signedDistance(box, p_map));
  return nearest;
}

Surface BoxWorld::surface(double edge_m) const {
  Surface result;
  Mesher mesher(&result);
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    const OrientedBox& box = boxes[b];
    const Eigen::Vector3i count = (box.size_m / edge_m).array().round().cast<int>().max(1);
    const auto position = [&](const Mesher::Index& index) -> Eigen::Vector3d {
      const Eigen::Vector3d share(static_cast<double>(index[0]) / count.x() - 0.5,
                                  static_cast<double>(index[1]) / count.y() - 0.5,
                                  static_cast<double>(index[2]) / count.z() - 0.5);
      return box.T_map_box * share.cwiseProduct(box.size_m);
    };
    for (int axis = 0; axis < 3; ++axis) {
      for (const int side : {-1, 1}) {
        const Eigen::Vector3d normal_map = box.T_map_box.linear().col(axis) * side;
        const auto is_seen = [&](const Eigen::Vector3d& p_map) {
          if (ground_z_m && p_map.z() < *ground_z_m + kTouching_m) return false;
          for (std::size_t other = 0; other < boxes.size(); ++other) {
            if (other != b && signedDistance(boxes[other], p_map) < kTouching_m) return false;
          }
          return !is_unknown || !is_unknown(p_map + kInFront_m * normal_map);
        };
        // u, v, axis are a right-handed system: counter-clockwise seen from +axis.
        const std::size_t w = static_cast<std::size_t>(axis);
        const std::size_t u = (w + 1) % 3;
        const std::size_t v = (w + 2) % 3;
        for (int i = 0; i < count[static_cast<Eigen::Index>(u)]; ++i) {
          for (int j = 0; j < count[static_cast<Eigen::Index>(v)]; ++j) {
            std::array<Mesher::Index, 4> corners;
            const std::array<std::array<int, 2>, 4> steps = {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}};
            for (std::size_t c = 0; c < 4; ++c) {
              corners[c][w] = side > 0 ? count[axis] : 0;
              corners[c][u] = i + steps[c][0];
              corners[c][v] = j + steps[c][1];
            }
            if (side < 0) std::swap(corners[1], corners[3]);
            mesher.quad(corners, position, normal_map, is_seen);
          }
        }
      }
    }
    mesher.finish();
  }
  if (ground_z_m) {
    const int count = std::max(1, static_cast<int>(std::lround(2.0 * ground_half_edge_m / edge_m)));
    const auto position = [&](const Mesher::Index& index) -> Eigen::Vector3d {
      return {ground_half_edge_m * (2.0 * index[0] / count - 1.0), ground_half_edge_m * (2.0 * index[1] / count - 1.0),
              *ground_z_m};
    };
    const auto is_seen = [&](const Eigen::Vector3d& p_map) {
      for (const OrientedBox& box : boxes) {
        if (signedDistance(box, p_map) < kTouching_m) return false;
      }
      return !is_unknown || !is_unknown(p_map + kInFront_m * Eigen::Vector3d::UnitZ());
    };
    for (int i = 0; i < count; ++i) {
      for (int j = 0; j < count; ++j) {
        mesher.quad({{{i, j, 0}, {i + 1, j, 0}, {i + 1, j + 1, 0}, {i, j + 1, 0}}}, position, Eigen::Vector3d::UnitZ(),
                    is_seen);
      }
    }
    mesher.finish();
  }
  return result;
}

MapAnswers BoxWorld::query(const gpis_mapping::Points3d& points_map) const {
  const Eigen::Index count = points_map.cols();
  MapAnswers answers;
  answers.distance_m = Eigen::VectorXd::Constant(count, kNaN);
  answers.surface_std_m = Eigen::VectorXd::Constant(count, kNaN);
  answers.state.assign(static_cast<std::size_t>(count), gpis_mapping::SpaceState::kUnknown);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Vector3d p_map = points_map.col(i);
    if (!p_map.allFinite()) continue;
    const double d = distance(p_map);
    gpis_mapping::SpaceState& state = answers.state[static_cast<std::size_t>(i)];
    if (d < 0.0) {
      state = -d <= occupied_depth_m ? gpis_mapping::SpaceState::kOccupied : gpis_mapping::SpaceState::kUnknown;
    } else {
      state = is_unknown && is_unknown(p_map) ? gpis_mapping::SpaceState::kUnknown : gpis_mapping::SpaceState::kFree;
    }
    const bool has_answer = state != gpis_mapping::SpaceState::kUnknown || (d >= 0.0 && d <= unknown_reach_m);
    if (!has_answer || !std::isfinite(d)) continue;
    answers.distance_m[i] = d;
    answers.surface_std_m[i] = surface_std_m ? surface_std_m(p_map) : 0.002;
  }
  return answers;
}

}  // namespace motion_planning
