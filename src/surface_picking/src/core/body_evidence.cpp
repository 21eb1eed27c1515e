// SPDX-License-Identifier: BSD-3-Clause
#include "body_evidence.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace surface_picking {
namespace {

namespace description = mp700_ur5e_description;
using description::BrickType;
using description::kBrickFaces;

constexpr double kCoverSlack_m = 0.01;  // surface this far beside a face still covers it
constexpr double kSlab_m = 0.06;        // below a surface there is its body, at least for this depth

}  // namespace

BodyEvidence::BodyEvidence(const TriangleMesh& mesh, const std::vector<Patch>& patches, const PatchShapes& shapes,
                           const CuboidConfig& config)
    : mesh_(mesh), patches_(patches), shapes_(shapes), config_(config), area_(mesh.vertices_map.size(), 0.0) {
  for (const auto& triangle : mesh.triangles) {
    const Eigen::Vector3d& a = mesh.vertices_map[triangle[0]];
    const double area = 0.5 * (mesh.vertices_map[triangle[1]] - a).cross(mesh.vertices_map[triangle[2]] - a).norm();
    for (const std::uint32_t vertex : triangle) area_[vertex] += area / 3.0;
  }
}

Evidence BodyEvidence::weigh(const BrickType& type, const Eigen::Isometry3d& T) const {
  Evidence evidence;
  evidence.is_support.assign(patches_.size(), false);
  const Eigen::Vector3d half = 0.5 * type.size_m;
  const Eigen::Vector3d& c = T.translation();
  for (std::size_t f = 0; f < kBrickFaces.size(); ++f) {
    const Eigen::Vector3d normal_body = description::faceNormal(kBrickFaces[f]);
    int axis = 0;
    normal_body.cwiseAbs().maxCoeff(&axis);
    const int axis_u = (axis + 1) % 3;
    const int axis_v = (axis + 2) % 3;
    const Eigen::Vector3d normal = T.linear() * normal_body;
    const Eigen::Vector3d u = T.linear().col(axis_u);
    const Eigen::Vector3d v = T.linear().col(axis_v);
    const double face_area = 4.0 * half[axis_u] * half[axis_v];
    std::vector<std::size_t> supports;
    double largest = 0.0;
    for (std::size_t i = 0; i < patches_.size(); ++i) {
      const Patch& patch = patches_[i];
      if (patch.is_large || patch.normal_map.dot(normal) < std::cos(CuboidConfig::kFaceTolerance_rad)) continue;
      double area = 0.0;
      double moment = 0.0;
      std::vector<std::uint32_t> seen;
      for (const std::uint32_t vertex : patch.vertices) {
        const Eigen::Vector3d d = mesh_.vertices_map[vertex] - c;
        if (std::abs(u.dot(d)) > half[axis_u] + kCoverSlack_m || std::abs(v.dot(d)) > half[axis_v] + kCoverSlack_m) {
          continue;
        }
        area += area_[vertex];
        moment += area_[vertex] * (normal.dot(d) - half[axis]);
        seen.push_back(vertex);
      }
      if (area < 0.02 * face_area || std::abs(moment / area) > config_.face_tolerance_m) continue;
      supports.push_back(i);
      evidence.is_support[i] = true;
      for (const std::uint32_t vertex : seen) {
        const Eigen::Vector3d d_body = T.linear().transpose() * (mesh_.vertices_map[vertex] - c);
        for (const int k : {axis_u, axis_v}) {
          const auto along = static_cast<std::size_t>(k);
          evidence.lowest[along] = std::min(evidence.lowest[along], d_body[k]);
          evidence.highest[along] = std::max(evidence.highest[along], d_body[k]);
        }
      }
      evidence.faces[f].share += area / face_area;
      evidence.seen_area_m2 += area;
      if (area > largest) {
        largest = area;
        evidence.faces[f].patch = static_cast<int>(i);
      }
      const Eigen::Vector3d lever = patch.center_map - c;
      evidence.conditions.push_back({row(-normal, normal.cross(lever)), half[axis] - normal.dot(lever), patch.std_m});
      for (const Eigen::Vector3d& across : {u, v}) {
        evidence.conditions.push_back(
            {row(Eigen::Vector3d::Zero(), normal.cross(across)), across.dot(patch.normal_map), patch.tilt_std_rad});
      }
    }
    if (supports.empty()) continue;
    evidence.ends[static_cast<std::size_t>(axis)][normal_body[axis] > 0.0 ? 1 : 0].is_shown = true;
    for (const std::size_t end : {0, 1}) {
      const double sign = end == 0 ? -1.0 : 1.0;
      weighEdge(supports, c, sign * u, half[axis_u], v, half[axis_v], &evidence,
                &evidence.ends[static_cast<std::size_t>(axis_u)][end]);
      weighEdge(supports, c, sign * v, half[axis_v], u, half[axis_u], &evidence,
                &evidence.ends[static_cast<std::size_t>(axis_v)][end]);
    }
  }
  return evidence;
}

Eigen::Matrix<double, 1, 6> row(const Eigen::Vector3d& translation, const Eigen::Vector3d& rotation) {
  Eigen::Matrix<double, 1, 6> J;
  J << translation.transpose(), rotation.transpose();
  return J;
}

/// One edge of a seen face: `axis` points from the face's middle to it, and `end` is that end of the body.
void BodyEvidence::weighEdge(const std::vector<std::size_t>& supports, const Eigen::Vector3d& c,
                             const Eigen::Vector3d& axis, double half, const Eigen::Vector3d& across,
                             double half_across, Evidence* evidence, End* end) const {
  constexpr double kInner_m = 0.03;
  constexpr double kLine_m = 0.03;
  std::vector<std::pair<double, Eigen::Vector3d>> on_edge;  // place along the edge, point
  std::vector<double> along;
  std::map<long, std::vector<double>> inner_along;  // an edge is a line: holes here and there are none
  double beyond = 0.0;
  for (const std::size_t i : supports) {
    for (std::size_t k = 0; k < patches_[i].border.size(); ++k) {
      const BorderPoint& point = patches_[i].border[k];
      if (!shapes_.isEdge(i)[k] || point.out_map.dot(axis) < kAlong) continue;
      const double place = axis.dot(point.p_map - c);
      const double place_across = across.dot(point.p_map - c);
      if (std::abs(place_across) > half_across) continue;
      if (std::abs(place + config_.edge_inset_m - half) <= 0.75 * config_.size_tolerance_m) {
        on_edge.emplace_back(place_across, point.p_map);
        along.push_back(place_across);
      } else if (place < half - config_.edge_inset_m - kInner_m && std::abs(place_across) < half_across - kInner_m) {
        inner_along[std::lround(place / (kLine_m))].push_back(place_across);
      }
    }
    for (const std::uint32_t vertex : patches_[i].vertices) {
      const Eigen::Vector3d d = mesh_.vertices_map[vertex] - c;
      if (std::abs(across.dot(d)) > half_across) continue;
      const double place = axis.dot(d) - half;
      if (place > 0.01 && place < 0.05) beyond += area_[vertex];
    }
  }
  const bool is_denied = beyond > 0.4 * (0.04 * 2.0 * half_across);
  const double length = 2.0 * half_across;
  for (const auto& [line, inner] : inner_along) {
    if (coveredLength(inner) > CuboidConfig::kInnerEdgeShare * length) evidence->has_inner_edge = true;
  }
  if (is_denied) {
    --evidence->num_edges;
  } else if (coveredLength(along) >= std::max(CuboidConfig::kMinEdge_m, 0.3 * length)) {
    ++evidence->num_edges;
  }
  end->is_denied = end->is_denied || is_denied;
  // Pieces of half the length and less were seen where something stood before the face.
  end->is_shown = end->is_shown || coveredLength(along) > 0.5 * length;
  if (is_denied || coveredLength(along) < CuboidConfig::kMinEdge_m) return;
  // Two halves of the edge: their places also tell its direction.
  std::sort(on_edge.begin(), on_edge.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  const std::size_t middle = on_edge.size() / 2;
  for (const auto& [from, to] : {std::make_pair(std::size_t{0}, middle), std::make_pair(middle, on_edge.size())}) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (std::size_t k = from; k < to; ++k) mean += on_edge[k].second;
    if (to == from) continue;
    mean /= static_cast<double>(to - from);
    const Eigen::Vector3d lever = mean - c;
    evidence->conditions.push_back({row(-axis, axis.cross(lever)), half - config_.edge_inset_m - axis.dot(lever),
                                    std::sqrt(2.0) * CuboidConfig::kEdgeStd_m});
  }
}

bool BodyEvidence::isPenetrated(const BrickType& type, const Eigen::Isometry3d& T, const Evidence& evidence) const {
  const Eigen::Isometry3d T_body_map = T.inverse();
  const Eigen::Array3d room = 0.5 * type.size_m.array() - config_.inside_m;
  double inside = 0.0;
  for (std::size_t i = 0; i < mesh_.vertices_map.size(); ++i) {
    const Eigen::Vector3d p_body = T_body_map * mesh_.vertices_map[i];
    if ((p_body.array().abs() < room).all()) inside += area_[i];
  }
  if (inside > CuboidConfig::kMaxInsideShare * evidence.seen_area_m2) return true;
  const Eigen::Matrix3Xd points = insidePoints(T, type.size_m, config_.inside_m, 7);
  for (std::size_t i = 0; i < patches_.size(); ++i) {
    if (evidence.is_support[i]) continue;
    int num_below = 0;
    for (Eigen::Index k = 0; k < points.cols(); ++k) {
      const double height = patches_[i].height(points.col(k));
      if (height > 0.0 || height < -kSlab_m) continue;
      num_below += shapes_.isWellInside(i, points.col(k)) ? 1 : 0;
    }
    if (num_below > CuboidConfig::kMaxInsideShare * static_cast<double>(points.cols())) return true;
  }
  return false;
}

}  // namespace surface_picking
