// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking/patches.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <stdexcept>
#include <string>

#include <Eigen/Eigenvalues>

namespace surface_picking {
namespace {

constexpr int kNone = -1;
constexpr int kDiscarded = -2;

/// Neighbours of each vertex, and the edges of one triangle only.
class MeshGraph {
 public:
  struct OpenEdge {
    std::uint32_t from, to, opposite;
  };

  explicit MeshGraph(const TriangleMesh& mesh)
      : begins_(mesh.vertices_map.size() + 1, 0), areas_(mesh.vertices_map.size(), 0.0) {
    const auto forEdges = [&mesh](auto use) {
      for (const auto& triangle : mesh.triangles) {
        for (std::size_t i = 0; i < 3; ++i) use(triangle[i], triangle[(i + 1) % 3], triangle[(i + 2) % 3]);
      }
    };
    for (const auto& triangle : mesh.triangles) {
      const Eigen::Vector3d& a = mesh.vertices_map[triangle[0]];
      const double area = 0.5 * (mesh.vertices_map[triangle[1]] - a).cross(mesh.vertices_map[triangle[2]] - a).norm();
      for (const std::uint32_t vertex : triangle) areas_[vertex] += area / 3.0;
    }
    // The edges of each vertex side by side: one for each triangle that has it.
    struct Side {
      std::uint32_t to, opposite;
    };
    std::vector<std::size_t> starts(begins_.size(), 0);
    forEdges([&](std::uint32_t from, std::uint32_t to, std::uint32_t) {
      ++starts[from + 1];
      ++starts[to + 1];
    });
    std::partial_sum(starts.begin(), starts.end(), starts.begin());
    std::vector<Side> sides(starts.back());
    forEdges([&, at = starts](std::uint32_t from, std::uint32_t to, std::uint32_t opposite) mutable {
      sides[at[from]++] = {to, opposite};
      sides[at[to]++] = {from, opposite};
    });
    neighbours_.reserve(sides.size() / 2 + 1);
    for (std::uint32_t vertex = 0; vertex + 1 < begins_.size(); ++vertex) {
      const auto begin = sides.begin() + static_cast<std::ptrdiff_t>(starts[vertex]);
      const auto end = sides.begin() + static_cast<std::ptrdiff_t>(starts[vertex + 1]);
      std::sort(begin, end, [](const Side& a, const Side& b) { return a.to < b.to; });
      for (auto side = begin; side != end;) {
        const auto next = std::find_if(side, end, [&](const Side& other) { return other.to != side->to; });
        neighbours_.push_back(side->to);
        if (next - side == 1 && vertex < side->to) open_.push_back({vertex, side->to, side->opposite});
        side = next;
      }
      begins_[vertex + 1] = neighbours_.size();
    }
  }

  /// In their order, to iterate over.
  struct Neighbours {
    const std::uint32_t *first, *last;
    const std::uint32_t* begin() const { return first; }
    const std::uint32_t* end() const { return last; }
    std::ptrdiff_t size() const { return last - first; }
  };
  Neighbours neighbours(std::uint32_t vertex) const {
    return {neighbours_.data() + begins_[vertex], neighbours_.data() + begins_[vertex + 1]};
  }
  double area(std::uint32_t vertex) const { return areas_[vertex]; }  // a third of its triangles' [m^2]
  const std::vector<OpenEdge>& openEdges() const { return open_; }

 private:
  std::vector<std::uint32_t> neighbours_;  // of all vertices, one after the other
  std::vector<std::size_t> begins_;
  std::vector<double> areas_;
  std::vector<OpenEdge> open_;
};

double angleBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

struct Plane {
  Eigen::Vector3d point, normal;
  double std_m{0.0};         // of the point along the normal
  double tilt_std_rad{0.0};  // the worse axis'
};

class PatchFinder {
 public:
  PatchFinder(const TriangleMesh& mesh, const PatchConfig& config)
      : mesh_(mesh), config_(config), graph_(mesh), region_(mesh.vertices_map.size(), kNone) {}

  std::vector<Patch> find(PatchStatistics* statistics) {
    std::vector<Patch> patches;
    std::vector<int> numbers;
    int number = 0;
    for (const std::uint32_t seed : seeds()) {
      if (region_[seed] != kNone) continue;
      std::vector<std::uint32_t> members = grow(seed);
      double area = 0.0;
      for (const std::uint32_t member : members) area += graph_.area(member);
      if (members.size() < kLeastVertices || area < config_.min_area_m2) {
        // Only the seed: another one may reach the rest with a better plane.
        region_[seed] = kDiscarded;
        if (members.size() >= kLeastVertices) ++statistics->num_small;
        continue;
      }
      const Plane plane = fit(members);
      const double curvature = curvatureOf(members, plane);
      for (const std::uint32_t member : members) region_[member] = number;
      if (curvature > config_.max_curvature_per_m) {
        ++statistics->num_curved;
      } else {
        Patch patch;
        patch.center_map = plane.point;
        patch.normal_map = plane.normal;
        patch.std_m = plane.std_m;
        patch.tilt_std_rad = plane.tilt_std_rad;
        patch.area_m2 = area;
        patch.curvature_per_m = curvature;
        patch.is_large = area > config_.body_area_m2;
        patch.vertices = std::move(members);
        std::sort(patch.vertices.begin(), patch.vertices.end());
        patches.push_back(std::move(patch));
        numbers.push_back(number);
      }
      ++number;
    }
    for (std::size_t i = 0; i < patches.size(); ++i) {
      findBorder(numbers[i], &patches[i]);
      if (!patches[i].is_large) findCircle(&patches[i]);
    }
    std::stable_sort(patches.begin(), patches.end(),
                     [](const Patch& a, const Patch& b) { return a.area_m2 > b.area_m2; });
    return patches;
  }

 private:
  static constexpr std::size_t kLeastVertices = 12;  // for a plane with a meaningful spread

  Eigen::Vector3d normal(std::uint32_t vertex) const { return mesh_.normals_map[vertex].cast<double>(); }

  /// Flattest first: largest angle to the normals two edges around, smallest first.
  std::vector<std::uint32_t> seeds() const {
    const auto count = static_cast<std::uint32_t>(region_.size());
    std::vector<double> bend(count, 0.0);
    for (std::uint32_t i = 0; i < count; ++i) {
      if (graph_.neighbours(i).size() < 3) bend[i] = M_PI;
      for (const std::uint32_t j : graph_.neighbours(i))
        bend[i] = std::max(bend[i], angleBetween(normal(i), normal(j)));
    }
    std::vector<double> wide(bend);
    for (std::uint32_t i = 0; i < count; ++i) {
      for (const std::uint32_t j : graph_.neighbours(i)) wide[i] = std::max(wide[i], bend[j]);
    }
    std::vector<std::uint32_t> order(count);
    std::iota(order.begin(), order.end(), 0U);
    std::sort(order.begin(), order.end(),
              [&](std::uint32_t a, std::uint32_t b) { return wide[a] != wide[b] ? wide[a] < wide[b] : a < b; });
    return order;
  }

  bool belongs(std::uint32_t vertex, const Plane& plane) const {
    const double variance = mesh_.variance_m2[vertex];
    return std::abs(plane.normal.dot(mesh_.vertices_map[vertex] - plane.point)) <= allowedDistance(variance, config_) &&
           angleBetween(normal(vertex), plane.normal) <= allowedAngle(variance, config_);
  }

  std::vector<std::uint32_t> flood(std::uint32_t seed, const Plane& plane) {
    std::vector<std::uint32_t> members{seed};
    if (mark_.empty()) mark_.assign(region_.size(), 0);
    mark_[seed] = ++stamp_;
    for (std::size_t next = 0; next < members.size(); ++next) {
      for (const std::uint32_t j : graph_.neighbours(members[next])) {
        if (mark_[j] == stamp_ || region_[j] >= 0 || !belongs(j, plane)) continue;
        mark_[j] = stamp_;
        members.push_back(j);
      }
    }
    return members;
  }

  /// From the seed's own plane, fitted again to what it reached until that no longer changes.
  std::vector<std::uint32_t> grow(std::uint32_t seed) {
    constexpr int kRounds = 8;
    Plane plane{mesh_.vertices_map[seed], normal(seed), 0.0, 0.0};
    std::vector<std::uint32_t> members = flood(seed, plane);
    for (int round = 0; round < kRounds; ++round) {
      if (members.size() < kLeastVertices) break;
      plane = fit(members);
      if (!belongs(seed, plane)) break;
      const std::size_t before = members.size();
      members = flood(seed, plane);
      if (members.size() == before) break;
    }
    return members;
  }

  /// Least squares, each vertex with its area over its variance.
  Plane fit(const std::vector<std::uint32_t>& members) const {
    double sum = 0.0;
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    Eigen::Vector3d side = Eigen::Vector3d::Zero();
    const auto weight = [this](std::uint32_t vertex) {
      return graph_.area(vertex) /
             (mesh_.variance_m2[vertex] + PatchConfig::kSurfaceStd_m * PatchConfig::kSurfaceStd_m + 1e-12);
    };
    for (const std::uint32_t member : members) {
      sum += weight(member);
      mean += weight(member) * mesh_.vertices_map[member];
      side += normal(member);
    }
    mean /= sum;
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (const std::uint32_t member : members) {
      const Eigen::Vector3d d = mesh_.vertices_map[member] - mean;
      scatter += weight(member) / sum * d * d.transpose();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(scatter);
    Plane plane;
    plane.point = mean;
    plane.normal = axes.eigenvectors().col(0);
    if (plane.normal.dot(side) < 0.0) plane.normal *= -1.0;
    // Residuals of neighbours are alike over a kernel length: the mean does not get better with the number of vertices.
    double variance = 0.0;
    for (const std::uint32_t member : members) variance += mesh_.variance_m2[member];
    variance = std::max(variance / static_cast<double>(members.size()), axes.eigenvalues()[0]);
    const double extent = std::sqrt(std::max(axes.eigenvalues()[1], 1e-8));
    const double pieces = std::max(1.0, std::pow(4.0 * extent / PatchConfig::kNormalBaseline_m, 2));
    plane.std_m = std::sqrt(variance / pieces + PatchConfig::kSurfaceStd_m * PatchConfig::kSurfaceStd_m);
    plane.tilt_std_rad = std::hypot(std::sqrt(variance / pieces) / extent, PatchConfig::kSurfaceStd_rad);
    return plane;
  }

  /// Slope of the normals over the plane: the larger eigenvalue of the shape operator.
  double curvatureOf(const std::vector<std::uint32_t>& members, const Plane& plane) {
    ++stamp_;
    for (const std::uint32_t member : members) mark_[member] = stamp_;
    std::vector<std::uint32_t> inner;  // edges of the mapped surface are rounded
    for (const std::uint32_t member : members) {
      const auto isMember = [this](std::uint32_t j) { return mark_[j] == stamp_; };
      const auto& near = graph_.neighbours(member);
      const bool is_inner = std::all_of(near.begin(), near.end(), [&](std::uint32_t j) {
        const auto& far = graph_.neighbours(j);
        return isMember(j) && std::all_of(far.begin(), far.end(), isMember);
      });
      if (is_inner) inner.push_back(member);
    }
    const std::vector<std::uint32_t>& used = inner.size() >= kLeastVertices ? inner : members;
    const Eigen::Vector3d u = plane.normal.unitOrthogonal();
    const Eigen::Vector3d v = plane.normal.cross(u);
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    for (const std::uint32_t member : used) middle += mesh_.vertices_map[member];
    middle /= static_cast<double>(used.size());
    Eigen::Matrix2d xx = 1e-9 * Eigen::Matrix2d::Identity();
    Eigen::Matrix2d nx = Eigen::Matrix2d::Zero();
    for (const std::uint32_t member : used) {
      const Eigen::Vector3d d = mesh_.vertices_map[member] - middle;
      const Eigen::Vector2d x(u.dot(d), v.dot(d));
      const Eigen::Vector2d n(u.dot(normal(member)), v.dot(normal(member)));
      xx += x * x.transpose();
      nx += n * x.transpose();
    }
    const Eigen::Matrix2d slope = nx * xx.inverse();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> bends(0.5 * (slope + slope.transpose()));
    return bends.eigenvalues().cwiseAbs().maxCoeff();
  }

  void findBorder(int number, Patch* patch) const {
    const auto project = [&](const Eigen::Vector3d& d) -> Eigen::Vector3d {
      return d - patch->normal_map.dot(d) * patch->normal_map;
    };
    const auto add = [&](const Eigen::Vector3d& p_map, const Eigen::Vector3d& out, BorderKind kind) {
      const Eigen::Vector3d flat = project(out);
      if (flat.norm() < 1e-9) return;
      patch->border.push_back({p_map - patch->height(p_map) * patch->normal_map, flat.normalized(), kind});
    };
    for (const std::uint32_t inside : patch->vertices) {
      const Eigen::Vector3d& p_in = mesh_.vertices_map[inside];
      const double angle_in = angleBetween(normal(inside), patch->normal_map);
      for (const std::uint32_t outside : graph_.neighbours(inside)) {
        if (region_[outside] == number) continue;
        const Eigen::Vector3d& p_out = mesh_.vertices_map[outside];
        const double angle_out = angleBetween(normal(outside), patch->normal_map);
        const double limit = allowedAngle(mesh_.variance_m2[inside], config_);
        const double share = angle_out > limit && angle_out > angle_in
                                 ? std::clamp((limit - angle_in) / (angle_out - angle_in), 0.0, 1.0)
                                 : 0.5;
        const Eigen::Vector3d out = project(p_out - p_in);
        // Normals that lean outwards belong to a surface that turns away.
        const double lean = out.norm() > 1e-9 ? normal(outside).dot(out.normalized()) : 0.0;
        const bool is_convex =
            std::abs(lean) > std::sin(config_.min_angle_rad) ? lean > 0.0 : patch->height(p_out) < 0.0;
        add(p_in + share * (p_out - p_in), out, is_convex ? BorderKind::kConvex : BorderKind::kConcave);
      }
    }
    for (const MeshGraph::OpenEdge& edge : graph_.openEdges()) {
      if (region_[edge.from] != number || region_[edge.to] != number) continue;
      const Eigen::Vector3d& from = mesh_.vertices_map[edge.from];
      const Eigen::Vector3d& to = mesh_.vertices_map[edge.to];
      const Eigen::Vector3d along = to - from;
      const Eigen::Vector3d inwards = mesh_.vertices_map[edge.opposite] - from;
      add(0.5 * (from + to), along * (along.dot(inwards) / std::max(along.squaredNorm(), 1e-12)) - inwards,
          BorderKind::kOpen);
    }
  }

  void findCircle(Patch* patch) const {
    for (const std::uint32_t vertex : patch->vertices) {
      const Eigen::Vector3d& p = mesh_.vertices_map[vertex];
      const double radius = patch->borderDistance(p);
      if (std::isfinite(radius) && radius > patch->circle_radius_m) {
        patch->circle_radius_m = radius;
        patch->circle_center_map = p - patch->height(p) * patch->normal_map;
      }
    }
    for (const Eigen::Vector3d& p : mesh_.vertices_map) {
      const double height = patch->height(p);
      if (height <= 2.0 * config_.distance_m || height > PatchConfig::kAbove_m) continue;
      const Eigen::Vector3d flat = p - height * patch->normal_map - patch->circle_center_map;
      if (flat.squaredNorm() <= patch->circle_radius_m * patch->circle_radius_m) {
        patch->clearance_m = std::min(patch->clearance_m, height);
      }
    }
  }

  const TriangleMesh& mesh_;
  const PatchConfig& config_;
  MeshGraph graph_;
  std::vector<int> region_;
  std::vector<int> mark_;
  int stamp_{0};
};

}  // namespace

TriangleMesh cropMesh(const TriangleMesh& mesh, const Eigen::Vector3d& min_map_m, const Eigen::Vector3d& max_map_m) {
  constexpr auto kLeftOut = std::numeric_limits<std::uint32_t>::max();
  TriangleMesh part;
  std::vector<std::uint32_t> index(mesh.vertices_map.size(), kLeftOut);
  const auto isInside = [&](std::uint32_t vertex) {
    const Eigen::Array3d p = mesh.vertices_map[vertex];
    return (p >= min_map_m.array()).all() && (p <= max_map_m.array()).all();
  };
  for (const auto& triangle : mesh.triangles) {
    if (!std::all_of(triangle.begin(), triangle.end(), isInside)) continue;
    std::array<std::uint32_t, 3> kept{};
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t vertex = triangle[i];
      if (index[vertex] == kLeftOut) {
        index[vertex] = static_cast<std::uint32_t>(part.vertices_map.size());
        part.vertices_map.push_back(mesh.vertices_map[vertex]);
        part.normals_map.push_back(mesh.normals_map[vertex]);
        part.variance_m2.push_back(mesh.variance_m2[vertex]);
      }
      kept[i] = index[vertex];
    }
    part.triangles.push_back(kept);
  }
  return part;
}

double allowedAngle(double variance_m2, const PatchConfig& config) {
  const double std_rad = std::sqrt(2.0 * variance_m2) / PatchConfig::kNormalBaseline_m;
  return std::clamp(config.sigmas * std_rad, config.min_angle_rad, config.max_angle_rad);
}

double allowedDistance(double variance_m2, const PatchConfig& config) {
  return std::max(config.distance_m, config.sigmas * std::sqrt(variance_m2));
}

double Patch::borderDistance(const Eigen::Vector3d& p_map) const {
  const Eigen::Vector3d p = p_map - height(p_map) * normal_map;
  double least = std::numeric_limits<double>::infinity();
  for (const BorderPoint& point : border) least = std::min(least, (point.p_map - p).squaredNorm());
  return std::sqrt(least);
}

void requireMesh(const TriangleMesh& mesh) {
  const std::size_t count = mesh.vertices_map.size();
  const auto refuse = [](const std::string& what) { throw std::invalid_argument("impossible mesh: " + what); };
  if (mesh.normals_map.size() != count || mesh.variance_m2.size() != count) {
    refuse(std::to_string(count) + " vertices, " + std::to_string(mesh.normals_map.size()) + " normals and " +
           std::to_string(mesh.variance_m2.size()) + " variances, must be as many of each");
  }
  for (std::size_t i = 0; i < count; ++i) {
    const std::string vertex = "vertex " + std::to_string(i);
    if (!mesh.vertices_map[i].allFinite()) refuse(vertex + " is not finite");
    const double length = mesh.normals_map[i].cast<double>().norm();
    if (!(std::abs(length - 1.0) < 1e-3)) {
      refuse("the normal of " + vertex + " has length " + std::to_string(length) + ", must be 1");
    }
    if (!(mesh.variance_m2[i] >= 0.0F) || !std::isfinite(mesh.variance_m2[i])) {
      refuse("the variance of " + vertex + " is " + std::to_string(mesh.variance_m2[i]) + " m^2, must be at least 0");
    }
  }
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    for (const std::uint32_t vertex : mesh.triangles[i]) {
      if (vertex >= count) {
        refuse("triangle " + std::to_string(i) + " names vertex " + std::to_string(vertex) + ", must be below " +
               std::to_string(count));
      }
    }
  }
}

std::vector<Patch> findPatches(const TriangleMesh& mesh, const PatchConfig& config, PatchStatistics* statistics) {
  interactive_mapping::requireValid("impossible patches:", config);
  requireMesh(mesh);
  PatchStatistics counted;
  std::vector<Patch> patches = PatchFinder(mesh, config).find(&counted);
  if (statistics != nullptr) *statistics = counted;
  return patches;
}

}  // namespace surface_picking
