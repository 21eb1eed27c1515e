// SPDX-License-Identifier: BSD-3-Clause
#include "patch_shapes.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>

#include <opencv2/imgproc.hpp>

namespace surface_picking {

double coveredLength(const std::vector<double>& along) {
  constexpr double kBin_m = 0.015;
  std::set<long> bins;
  for (const double s : along) bins.insert(std::lround(std::floor(s / kBin_m)));
  return kBin_m * static_cast<double>(bins.size());
}

std::vector<SpaceState> askSpace(const SpaceQuery& space, const Eigen::Matrix3Xd& points) {
  std::vector<SpaceState> states = space(points);
  if (states.size() != static_cast<std::size_t>(points.cols())) {
    throw std::invalid_argument("space() gave " + std::to_string(states.size()) + " answers, must be one for each of " +
                                std::to_string(points.cols()) + " points");
  }
  return states;
}

PatchShapes::PatchShapes(const TriangleMesh& mesh, const std::vector<Patch>& patches, const SpaceQuery& space,
                         const CuboidConfig& config)
    : patches_(patches), config_(config), shapes_(patches.size()) {
  for (std::size_t i = 0; i < patches_.size(); ++i) {
    Shape& shape = shapes_[i];
    shape.frame.u = patches_[i].normal_map.unitOrthogonal();
    shape.frame.v = patches_[i].normal_map.cross(shape.frame.u);
    std::vector<cv::Point2f> flat;
    for (const std::uint32_t vertex : patches_[i].vertices) {
      const Eigen::Vector2f p = inFrame(i, mesh.vertices_map[vertex]).cast<float>();
      flat.emplace_back(p.x(), p.y());
    }
    cv::convexHull(flat, shape.hull);
  }
  findEdges(space);
  for (std::size_t i = 0; i < patches_.size(); ++i) {
    if (!patches_[i].is_large) shapes_[i].orientations = orientationsOf(i);
  }
}

/// Convex borders, and open ones beyond which space is free.
void PatchShapes::findEdges(const SpaceQuery& space) {
  std::vector<std::pair<std::size_t, std::size_t>> open;
  for (std::size_t i = 0; i < patches_.size(); ++i) {
    for (std::size_t k = 0; k < patches_[i].border.size(); ++k) {
      shapes_[i].is_edge.push_back(patches_[i].border[k].kind == BorderKind::kConvex);
      if (patches_[i].border[k].kind == BorderKind::kOpen && !patches_[i].is_large) open.emplace_back(i, k);
    }
  }
  if (space && !open.empty()) {
    Eigen::Matrix3Xd beyond(3, static_cast<Eigen::Index>(open.size()));
    for (std::size_t j = 0; j < open.size(); ++j) {
      const Patch& patch = patches_[open[j].first];
      const BorderPoint& point = patch.border[open[j].second];
      // Just below the plane: above it free space says nothing of the surface.
      beyond.col(static_cast<Eigen::Index>(j)) =
          point.p_map + CuboidConfig::kOpenReach_m * point.out_map - 0.01 * patch.normal_map;
    }
    const std::vector<SpaceState> states = askSpace(space, beyond);
    for (std::size_t j = 0; j < open.size(); ++j) {
      shapes_[open[j].first].is_edge[open[j].second] = states[j] == SpaceState::kFree;
    }
  }
}

Eigen::Vector2d PatchShapes::inFrame(std::size_t i, const Eigen::Vector3d& p_map) const {
  const Eigen::Vector3d d = p_map - patches_[i].center_map;
  return {shapes_[i].frame.u.dot(d), shapes_[i].frame.v.dot(d)};
}

/// Directions of the edges of a face: of the lines in which faces square to it would cut it; without one, of the
/// straightest edges.
std::vector<Frame> PatchShapes::orientationsOf(std::size_t i) const {
  constexpr double kJoin_m = 0.05;  // between the borders of two faces of one body, both inset
  constexpr int kLeastNear = 3;
  std::vector<Frame> frames;
  const auto add = [&](const Eigen::Vector3d& direction) {
    const Eigen::Vector3d& n = patches_[i].normal_map;
    const Eigen::Vector3d u = (direction - n.dot(direction) * n).normalized();
    for (const Frame& known : frames) {
      if (std::max(std::abs(known.u.dot(u)), std::abs(known.v.dot(u))) > std::cos(0.05)) return;
    }
    frames.push_back({u, n.cross(u)});
  };
  for (std::size_t j = 0; j < patches_.size(); ++j) {
    if (j == i || patches_[j].is_large) continue;
    if (std::abs(patches_[i].normal_map.dot(patches_[j].normal_map)) > std::sin(CuboidConfig::kFaceTolerance_rad))
      continue;
    int num_near = 0;
    for (std::size_t k = 0; k < patches_[i].border.size() && num_near < kLeastNear; ++k) {
      if (!shapes_[i].is_edge[k]) continue;
      for (std::size_t l = 0; l < patches_[j].border.size(); ++l) {
        if (!shapes_[j].is_edge[l]) continue;
        if ((patches_[i].border[k].p_map - patches_[j].border[l].p_map).norm() > kJoin_m) continue;
        ++num_near;
        break;
      }
    }
    if (num_near >= kLeastNear) add(patches_[i].normal_map.cross(patches_[j].normal_map));
  }
  if (frames.empty()) {
    if (const std::optional<Eigen::Vector3d> along = straightest(i)) add(*along);
  }
  return frames;
}

/// By trial: the direction for which most edge points lie on the four outermost lines.
std::optional<Eigen::Vector3d> PatchShapes::straightest(std::size_t i) const {
  constexpr int kSteps = 90;
  constexpr double kOnLine_m = 0.006;
  std::vector<Eigen::Vector2d> points, outs;
  for (std::size_t k = 0; k < patches_[i].border.size(); ++k) {
    if (!shapes_[i].is_edge[k]) continue;
    const BorderPoint& point = patches_[i].border[k];
    points.push_back(inFrame(i, point.p_map));
    outs.emplace_back(shapes_[i].frame.u.dot(point.out_map), shapes_[i].frame.v.dot(point.out_map));
  }
  std::optional<double> best;
  int most = 0;
  for (int step = 0; step < kSteps; ++step) {
    const double angle = 0.5 * M_PI * step / kSteps;
    int num_on = 0;
    for (int side = 0; side < 4; ++side) {
      const Eigen::Vector2d axis = Eigen::Rotation2Dd(angle + 0.5 * M_PI * side) * Eigen::Vector2d::UnitX();
      std::vector<double> reach;
      for (std::size_t k = 0; k < points.size(); ++k) {
        if (outs[k].dot(axis) > kAlong) reach.push_back(axis.dot(points[k]));
      }
      if (reach.size() < 3) continue;
      std::sort(reach.begin(), reach.end());
      const double line = reach[reach.size() - 1 - reach.size() / 10];
      for (const double r : reach) num_on += std::abs(r - line) <= kOnLine_m ? 1 : 0;
    }
    if (num_on > most) {
      most = num_on;
      best = angle;
    }
  }
  if (!best) return std::nullopt;
  return std::cos(*best) * shapes_[i].frame.u + std::sin(*best) * shapes_[i].frame.v;
}

Side PatchShapes::sideOf(std::size_t i, const Eigen::Vector3d& axis, const Eigen::Vector3d& across) const {
  const Patch& patch = patches_[i];
  std::vector<double> reach;
  for (const BorderPoint& point : patch.border) reach.push_back(axis.dot(point.p_map - patch.center_map));
  std::sort(reach.begin(), reach.end());
  Side side;
  side.reach = reach.empty() ? 0.0 : reach[reach.size() - 1 - std::min<std::size_t>(2, reach.size() - 1)];
  std::vector<double> places, along;
  for (std::size_t k = 0; k < patch.border.size(); ++k) {
    const BorderPoint& point = patch.border[k];
    const double place = axis.dot(point.p_map - patch.center_map);
    if (!shapes_[i].is_edge[k] || point.out_map.dot(axis) < kAlong || place < side.reach - config_.size_tolerance_m) {
      continue;
    }
    places.push_back(place);
    along.push_back(across.dot(point.p_map));
  }
  if (coveredLength(along) >= CuboidConfig::kMinEdge_m) {
    std::nth_element(places.begin(), places.begin() + static_cast<long>(places.size() / 2), places.end());
    side.edge = places[places.size() / 2] + config_.edge_inset_m;
  }
  return side;
}

bool PatchShapes::isWellInside(std::size_t i, const Eigen::Vector3d& p_map) const {
  const Eigen::Vector2f p = inFrame(i, p_map).cast<float>();
  return cv::pointPolygonTest(shapes_[i].hull, {p.x(), p.y()}, true) >= config_.inside_m;
}

}  // namespace surface_picking
