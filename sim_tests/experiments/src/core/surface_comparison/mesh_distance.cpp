// SPDX-License-Identifier: BSD-3-Clause
#include "surface_comparison/mesh_distance.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>

#include <vtkCellArray.h>
#include <vtkCellLocator.h>
#include <vtkGenericCell.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <Eigen/Geometry>

#include "synthetic_depth/seeded_random.h"

namespace experiments {
namespace {

using Eigen::Vector3d;
using Triangle = std::array<std::uint32_t, 3>;

/// Part of a triangle: corner k, edge k (from corner k to k + 1) or the face.
struct Feature {
  enum class Kind { kCorner, kEdge, kFace } kind;
  int k;
};

struct NearestOnTriangle {
  Vector3d point;
  Feature feature;
};

/// Ericson, "Real-Time Collision Detection", 5.1.5.
NearestOnTriangle nearestOnTriangle(const Vector3d& p, const Vector3d& a, const Vector3d& b, const Vector3d& c) {
  using Kind = Feature::Kind;
  const Vector3d ab = b - a;
  const Vector3d ac = c - a;
  const double d1 = ab.dot(p - a);
  const double d2 = ac.dot(p - a);
  if (d1 <= 0.0 && d2 <= 0.0) return {a, {Kind::kCorner, 0}};
  const double d3 = ab.dot(p - b);
  const double d4 = ac.dot(p - b);
  if (d3 >= 0.0 && d4 <= d3) return {b, {Kind::kCorner, 1}};
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return {a + d1 / (d1 - d3) * ab, {Kind::kEdge, 0}};
  const double d5 = ab.dot(p - c);
  const double d6 = ac.dot(p - c);
  if (d6 >= 0.0 && d5 <= d6) return {c, {Kind::kCorner, 2}};
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return {a + d2 / (d2 - d6) * ac, {Kind::kEdge, 2}};
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0.0 && d4 >= d3 && d5 >= d6) {
    return {b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b), {Kind::kEdge, 1}};
  }
  return {a + vb / (va + vb + vc) * ab + vc / (va + vb + vc) * ac, {Kind::kFace, 0}};
}

void requireUsable(const Surface& surface) {
  for (std::size_t i = 0; i < surface.points_map.size(); ++i) {
    if (surface.points_map[i].allFinite()) continue;
    throw std::invalid_argument("mesh point " + std::to_string(i) + " is not finite");
  }
  for (const Triangle& triangle : surface.triangles) {
    for (const std::uint32_t index : triangle) {
      if (index < surface.points_map.size()) continue;
      throw std::invalid_argument("mesh has triangle index " + std::to_string(index) + ", must be below " +
                                  std::to_string(surface.points_map.size()));
    }
  }
}

Vector3d areaVector(const Surface& surface, const Triangle& t) {
  const Vector3d& a = surface.points_map[t[0]];
  return 0.5 * (surface.points_map[t[1]] - a).cross(surface.points_map[t[2]] - a);
}

}  // namespace

/// What the nearest feature's normal and border are looked up in.
struct MeshDistance::Topology {
  struct Edge {
    Vector3d normal_sum{Vector3d::Zero()};
    int triangles{0};
  };
  using EdgeKey = std::pair<std::uint32_t, std::uint32_t>;

  static EdgeKey edgeKey(const Triangle& t, int k) {
    return std::minmax(t[static_cast<std::size_t>(k)], t[static_cast<std::size_t>((k + 1) % 3)]);
  }

  explicit Topology(const Surface& surface) {
    std::vector<std::uint32_t> welded(surface.points_map.size());
    std::map<std::array<double, 3>, std::uint32_t> seen;
    for (std::size_t i = 0; i < surface.points_map.size(); ++i) {
      const Vector3d& p = surface.points_map[i];
      const auto found = seen.try_emplace({p.x(), p.y(), p.z()}, static_cast<std::uint32_t>(points.size()));
      if (found.second) points.push_back(p);
      welded[i] = found.first->second;
    }
    std::map<EdgeKey, Edge> edge_map;
    corner_normals.assign(points.size(), Vector3d::Zero());
    for (const Triangle& source : surface.triangles) {
      const Triangle t{welded[source[0]], welded[source[1]], welded[source[2]]};
      if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) continue;
      const Vector3d area = 0.5 * (points[t[1]] - points[t[0]]).cross(points[t[2]] - points[t[0]]);
      const bool has_area = area.norm() > kLeastArea_m2;
      const Vector3d normal = has_area ? Vector3d(area.normalized()) : Vector3d(Vector3d::Zero());
      for (int k = 0; k < 3; ++k) {
        Edge& edge = edge_map[edgeKey(t, k)];
        edge.normal_sum += normal;
        ++edge.triangles;
      }
      // A sliver joins its neighbours, so that no border appears between them, but nothing is nearest to it alone.
      if (!has_area) continue;
      for (std::size_t k = 0; k < 3; ++k) {
        const Vector3d u = points[t[(k + 1) % 3]] - points[t[k]];
        const Vector3d v = points[t[(k + 2) % 3]] - points[t[k]];
        corner_normals[t[k]] += std::atan2(u.cross(v).norm(), u.dot(v)) * normal;
      }
      triangles.push_back(t);
      normals.push_back(normal);
    }
    if (triangles.empty()) throw std::invalid_argument("mesh has no triangle with an area");
    is_border_point.assign(points.size(), false);
    for (const auto& [key, edge] : edge_map) {
      if (edge.triangles == 1) is_border_point[key.first] = is_border_point[key.second] = true;
    }
    for (const Triangle& t : triangles) {
      std::array<Edge, 3> around;
      for (int k = 0; k < 3; ++k) around[static_cast<std::size_t>(k)] = edge_map[edgeKey(t, k)];
      edges.push_back(around);
    }
  }

  static constexpr double kLeastArea_m2 = 1e-15;  // a triangle of 0.03 um: rounding, not shape

  std::vector<Vector3d> points;
  std::vector<Triangle> triangles;
  std::vector<Vector3d> normals;
  std::vector<std::array<Edge, 3>> edges;
  std::vector<Vector3d> corner_normals;
  std::vector<bool> is_border_point;
};

struct MeshDistance::Locator {
  explicit Locator(const Topology& topology) {
    vtkNew<vtkPoints> points;
    points->SetDataTypeToDouble();
    points->SetNumberOfPoints(static_cast<vtkIdType>(topology.points.size()));
    for (std::size_t i = 0; i < topology.points.size(); ++i) {
      points->SetPoint(static_cast<vtkIdType>(i), topology.points[i].data());
    }
    vtkNew<vtkCellArray> cells;
    for (const Triangle& t : topology.triangles) {
      const std::array<vtkIdType, 3> ids{t[0], t[1], t[2]};
      cells->InsertNextCell(3, ids.data());
    }
    mesh->SetPoints(points.Get());  // VTK 7 has no conversion
    mesh->SetPolys(cells.Get());
    mesh->BuildCells();
    locator->SetDataSet(mesh.Get());
    locator->BuildLocator();
  }

  vtkNew<vtkPolyData> mesh;
  vtkNew<vtkCellLocator> locator;  // VTK 7 has no vtkStaticCellLocator
};

MeshDistance::MeshDistance(const Surface& surface) {
  requireUsable(surface);
  topology_ = std::make_unique<Topology>(surface);
  locator_ = std::make_unique<Locator>(*topology_);
}

MeshDistance::~MeshDistance() = default;

MeshDistance::Nearest MeshDistance::nearest(const Vector3d& p_map) const {
  if (!p_map.allFinite()) throw std::invalid_argument("the point is not finite");
  vtkNew<vtkGenericCell> cell;
  vtkIdType id = -1;
  int part = 0;
  double squared = 0.0;
  Vector3d query = p_map;  // VTK 7 takes no constant
  Vector3d found;
  locator_->locator->FindClosestPoint(query.data(), found.data(), cell.Get(), id, part, squared);
  const auto index = static_cast<std::size_t>(id);
  const Triangle& t = topology_->triangles[index];
  const auto [point, feature] =
      nearestOnTriangle(p_map, topology_->points[t[0]], topology_->points[t[1]], topology_->points[t[2]]);
  const auto k = static_cast<std::size_t>(feature.k);
  Vector3d normal = topology_->normals[index];
  bool on_border = false;
  if (feature.kind == Feature::Kind::kEdge) {
    normal = topology_->edges[index][k].normal_sum;
    on_border = topology_->edges[index][k].triangles == 1;
  } else if (feature.kind == Feature::Kind::kCorner) {
    normal = topology_->corner_normals[t[k]];
    on_border = topology_->is_border_point[t[k]];
  }
  const double distance = (p_map - point).norm();
  return {(p_map - point).dot(normal) < 0.0 ? -distance : distance, point, on_border};
}

std::vector<Vector3d> sampleEvenly(const Surface& surface, double spacing_m, std::uint64_t seed) {
  if (!(spacing_m > 0.0)) throw std::invalid_argument("spacing = " + std::to_string(spacing_m) + " m, must be > 0");
  requireUsable(surface);
  synthetic_depth::SeededRandom random(seed);
  std::vector<Vector3d> samples;
  // Systematic sampling: the number of points on any patch is its area over spacing^2, give or take one.
  double owed = random.uniform();
  for (const Triangle& t : surface.triangles) {
    owed += areaVector(surface, t).norm() / (spacing_m * spacing_m);
    for (; owed >= 1.0; owed -= 1.0) {
      const double root = std::sqrt(random.uniform());
      const double share = random.uniform();
      samples.push_back((1.0 - root) * surface.points_map[t[0]] + root * (1.0 - share) * surface.points_map[t[1]] +
                        root * share * surface.points_map[t[2]]);
    }
  }
  return samples;
}

Statistics statisticsOf(const std::vector<double>& values) {
  Statistics s;
  s.count = values.size();
  if (values.empty()) return s;
  const auto n = static_cast<double>(values.size());
  double squares = 0.0;
  for (const double value : values) {
    s.mean += value / n;
    squares += value * value;
  }
  s.rms = std::sqrt(squares / n);
  double spread = 0.0;
  for (const double value : values) spread += (value - s.mean) * (value - s.mean);
  s.std_dev = std::sqrt(spread / n);
  std::vector<double> sorted(values.size());
  std::transform(values.begin(), values.end(), sorted.begin(), [](double value) { return std::abs(value); });
  std::sort(sorted.begin(), sorted.end());
  const auto quantile = [&](double share) {
    return sorted[std::min(sorted.size() - 1, static_cast<std::size_t>(share * n))];
  };
  s.median_abs = quantile(0.5);
  s.p95_abs = quantile(0.95);
  s.max_abs = sorted.back();
  return s;
}

}  // namespace experiments
