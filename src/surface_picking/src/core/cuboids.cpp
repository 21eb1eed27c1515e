// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking/cuboids.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>
#include <tuple>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

namespace surface_picking {
namespace {

namespace description = mp700_ur5e_description;
using description::BrickType;
using description::kBrickFaces;
using description::kNumBrickFaces;

constexpr double kAlong = 0.7;          // cosine within which a border point's direction is that of a side
constexpr double kBin_m = 0.015;        // edges are as long as the bins of this width that hold a border point
constexpr double kCoverSlack_m = 0.01;  // surface this far beside a face still covers it
constexpr double kSame_m = 0.03;        // bodies nearer than this, and turned by less than kSame_rad, are one
constexpr double kSame_rad = 0.15;
constexpr double kSlab_m = 0.06;  // below a surface there is its body, at least for this depth
constexpr int kMostInRow = 6;
constexpr double kCovered_m = 0.02;  // to the next vertex of the mesh

std::vector<Eigen::Matrix3d> rotationsOfTheCube() {
  std::vector<Eigen::Matrix3d> rotations;
  const std::array<std::array<int, 3>, 6> orders = {{{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}}};
  for (const auto& order : orders) {
    for (int signs = 0; signs < 8; ++signs) {
      Eigen::Matrix3d R = Eigen::Matrix3d::Zero();
      for (int i = 0; i < 3; ++i) R(order[static_cast<std::size_t>(i)], i) = (signs >> i) & 1 ? -1.0 : 1.0;
      if (R.determinant() > 0.0) rotations.push_back(R);
    }
  }
  return rotations;
}

/// Length of an edge by the bins along it that hold a point.
double coveredLength(const std::vector<double>& along) {
  std::set<long> bins;
  for (const double s : along) bins.insert(std::lround(std::floor(s / kBin_m)));
  return kBin_m * static_cast<double>(bins.size());
}

/// Convex hull of points in the plane, counter-clockwise.
std::vector<Eigen::Vector2d> hullOf(std::vector<Eigen::Vector2d> points) {
  std::sort(points.begin(), points.end(), [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y();
  });
  std::vector<Eigen::Vector2d> hull;
  const auto turns = [&](const Eigen::Vector2d& p) {
    const Eigen::Vector2d a = hull[hull.size() - 1] - hull[hull.size() - 2];
    const Eigen::Vector2d b = p - hull[hull.size() - 2];
    return a.x() * b.y() - a.y() * b.x() > 0.0;
  };
  for (int half = 0; half < 2; ++half) {
    const std::size_t first = hull.size();
    for (const Eigen::Vector2d& p : points) {
      while (hull.size() >= first + 2 && !turns(p)) hull.pop_back();
      hull.push_back(p);
    }
    hull.pop_back();  // the first of the other half
    std::reverse(points.begin(), points.end());
  }
  return hull;
}

struct Frame {
  Eigen::Vector3d u, v;
};

/// What a patch adds to its own: its edges, frame and hull.
struct Shape {
  std::vector<bool> is_edge;  // of the border's points
  Frame frame;
  std::vector<Eigen::Vector2d> hull;  // in frame, about the patch's centre
  std::vector<Frame> orientations;    // of a face, by neighbours or by the border
};

/// Where a patch ends along a direction.
struct Side {
  double reach{0.0};             // of all its border
  std::optional<double> edge{};  // of the body, corrected for the inset
};

/// A condition J d = r on a small motion d (translation, rotation about the middle, map's axes).
struct Condition {
  Eigen::Matrix<double, 1, 6> J;
  double residual, std;
};

struct Hypothesis {
  const BrickType* type;
  Eigen::Isometry3d T_map_body;
  // Along directions in which no edge fixes it, by the row or by the middle of what is seen: direction, place, deviation.
  struct Pin {
    Eigen::Vector3d axis;
    double place, std;
  };
  std::vector<Pin> pins;
};

/// Where a face may lie along one axis of a patch.
struct Place {
  double center;
  std::optional<double> std;  // unless edges fix it
};

/// Long: all steps from patches to cuboids read the same mesh, patches and shapes.
class CuboidFinder {
 public:
  CuboidFinder(const TriangleMesh& mesh, const std::vector<Patch>& patches, const std::vector<BrickType>& types,
               const SpaceQuery& space, const CuboidConfig& config)
      : mesh_(mesh), patches_(patches), types_(types), space_(space), config_(config) {
    area_.assign(mesh.vertices_map.size(), 0.0);
    for (const auto& triangle : mesh.triangles) {
      const Eigen::Vector3d& a = mesh.vertices_map[triangle[0]];
      const double area = 0.5 * (mesh.vertices_map[triangle[1]] - a).cross(mesh.vertices_map[triangle[2]] - a).norm();
      for (const std::uint32_t vertex : triangle) area_[vertex] += area / 3.0;
    }
    describe();
  }

  std::vector<Cuboid> find(CuboidStatistics* statistics) {
    std::vector<Cuboid> candidates;
    for (std::size_t i = 0; i < patches_.size(); ++i) {
      if (patches_[i].is_large) continue;
      for (const Frame& frame : shapes_[i].orientations) {
        for (const Hypothesis& hypothesis : hypothesesOf(i, frame)) {
          ++statistics->num_hypotheses;
          const std::optional<Cuboid> cuboid = settle(hypothesis, statistics);
          if (!cuboid) continue;
          const auto same = std::find_if(candidates.begin(), candidates.end(),
                                         [&](const Cuboid& other) { return isSame(*cuboid, other); });
          if (same == candidates.end()) {
            candidates.push_back(*cuboid);
          } else if (isBetter(*cuboid, *same)) {
            *same = *cuboid;
          }
        }
      }
    }
    return choose(candidates, statistics);
  }

 private:
  void describe() {
    shapes_.resize(patches_.size());
    std::vector<std::pair<std::size_t, std::size_t>> open;
    for (std::size_t i = 0; i < patches_.size(); ++i) {
      const Patch& patch = patches_[i];
      Shape& shape = shapes_[i];
      shape.frame.u = patch.normal_map.unitOrthogonal();
      shape.frame.v = patch.normal_map.cross(shape.frame.u);
      std::vector<Eigen::Vector2d> flat;
      for (const std::uint32_t vertex : patch.vertices) flat.push_back(inFrame(i, mesh_.vertices_map[vertex]));
      shape.hull = hullOf(std::move(flat));
      for (std::size_t k = 0; k < patch.border.size(); ++k) {
        shape.is_edge.push_back(patch.border[k].kind == BorderKind::kConvex);
        if (patch.border[k].kind == BorderKind::kOpen && !patch.is_large) open.emplace_back(i, k);
      }
    }
    if (space_ && !open.empty()) {
      Eigen::Matrix3Xd beyond(3, static_cast<Eigen::Index>(open.size()));
      for (std::size_t j = 0; j < open.size(); ++j) {
        const Patch& patch = patches_[open[j].first];
        const BorderPoint& point = patch.border[open[j].second];
        // Just below the plane: above it free space says nothing of the surface.
        beyond.col(static_cast<Eigen::Index>(j)) =
            point.p_map + config_.open_reach_m * point.out_map - 0.01 * patch.normal_map;
      }
      const std::vector<SpaceState> states = ask(beyond);
      for (std::size_t j = 0; j < open.size(); ++j) {
        shapes_[open[j].first].is_edge[open[j].second] = states[j] == SpaceState::kFree;
      }
    }
    for (std::size_t i = 0; i < patches_.size(); ++i) {
      if (!patches_[i].is_large) shapes_[i].orientations = orientationsOf(i);
    }
  }

  std::vector<SpaceState> ask(const Eigen::Matrix3Xd& points) const {
    std::vector<SpaceState> states = space_(points);
    if (states.size() != static_cast<std::size_t>(points.cols())) {
      throw std::invalid_argument("space() gave " + std::to_string(states.size()) +
                                  " answers, must be one for each of " + std::to_string(points.cols()) + " points");
    }
    return states;
  }

  Eigen::Vector2d inFrame(std::size_t patch, const Eigen::Vector3d& p_map) const {
    const Eigen::Vector3d d = p_map - patches_[patch].center_map;
    return {shapes_[patch].frame.u.dot(d), shapes_[patch].frame.v.dot(d)};
  }

  /// Directions of the edges of a face: of the lines in which faces square to it would cut it; without one, of the
  /// straightest edges.
  std::vector<Frame> orientationsOf(std::size_t i) const {
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
      if (std::abs(patches_[i].normal_map.dot(patches_[j].normal_map)) > std::sin(config_.face_tolerance_rad)) continue;
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
  std::optional<Eigen::Vector3d> straightest(std::size_t i) const {
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

  Side sideOf(std::size_t i, const Eigen::Vector3d& axis, const Eigen::Vector3d& across) const {
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
    if (coveredLength(along) >= config_.min_edge_m) {
      std::nth_element(places.begin(), places.begin() + static_cast<long>(places.size() / 2), places.end());
      side.edge = places[places.size() / 2] + config_.edge_inset_m;
    }
    return side;
  }

  /// Where faces of this length may lie between two sides: `lower` is along the negative axis.
  std::vector<Place> placesOf(const Side& lower, const Side& upper, double length) const {
    const double tolerance = config_.size_tolerance_m;
    std::vector<Place> places;
    if (lower.edge && upper.edge) {
      const double extent = *lower.edge + *upper.edge;
      const int count = static_cast<int>(std::lround(extent / length));
      if (count < 1 || count > kMostInRow || std::abs(extent - count * length) > tolerance) return {};
      for (int k = 0; k < count; ++k) {
        const double center = -*lower.edge + extent * (k + 0.5) / count;
        places.push_back({center, count == 1 ? std::nullopt : std::optional<double>(0.5 * tolerance)});
      }
      return places;
    }
    const double low = lower.edge ? *lower.edge : lower.reach;
    const double high = upper.edge ? *upper.edge : upper.reach;
    const double extent = low + high;
    if (!lower.edge && !upper.edge) {
      if (std::abs(extent - length) > tolerance) return {};
      return {{0.5 * (high - low), tolerance}};
    }
    const int count = std::clamp(static_cast<int>(std::floor((extent + tolerance) / length)), 1, kMostInRow);
    for (int k = 0; k < count; ++k) {
      const double from_edge = (k + 0.5) * length;
      places.push_back({lower.edge ? -low + from_edge : high - from_edge,
                        k == 0 ? std::nullopt : std::optional<double>(0.5 * tolerance)});
    }
    return places;
  }

  std::vector<Hypothesis> hypothesesOf(std::size_t i, const Frame& frame) const {
    const Patch& patch = patches_[i];
    const Side lower_u = sideOf(i, -frame.u, frame.v);
    const Side upper_u = sideOf(i, frame.u, frame.v);
    const Side lower_v = sideOf(i, -frame.v, frame.u);
    const Side upper_v = sideOf(i, frame.v, frame.u);
    std::vector<Hypothesis> hypotheses;
    for (const BrickType& type : types_) {
      std::set<std::tuple<long, long, long>> tried;  // edges along u, v and the normal [mm]
      for (int a = 0; a < 3; ++a) {
        for (int b = 0; b < 3; ++b) {
          if (a == b) continue;
          const int c = 3 - a - b;
          const Eigen::Vector3d size = type.size_m;
          const auto millimetres = [](double metres) { return std::lround(1000.0 * metres); };
          if (!tried.emplace(millimetres(size[a]), millimetres(size[b]), millimetres(size[c])).second) continue;
          for (const Place& along_u : placesOf(lower_u, upper_u, size[a])) {
            for (const Place& along_v : placesOf(lower_v, upper_v, size[b])) {
              Hypothesis hypothesis{&type, Eigen::Isometry3d::Identity(), {}};
              Eigen::Matrix3d R;
              R.col(a) = frame.u;
              R.col(b) = frame.v;
              R.col(c) = patch.normal_map;
              if (R.determinant() < 0.0) R.col(b) *= -1.0;
              hypothesis.T_map_body.linear() = R;
              hypothesis.T_map_body.translation() = patch.center_map + along_u.center * frame.u +
                                                    along_v.center * frame.v - 0.5 * size[c] * patch.normal_map;
              const Eigen::Vector3d& p = hypothesis.T_map_body.translation();
              if (along_u.std) hypothesis.pins.push_back({frame.u, frame.u.dot(p), *along_u.std});
              if (along_v.std) hypothesis.pins.push_back({frame.v, frame.v.dot(p), *along_v.std});
              hypotheses.push_back(hypothesis);
            }
          }
        }
      }
    }
    return hypotheses;
  }

  /// What faces and edges say of an end of a body.
  struct End {
    bool is_shown{false};
    bool is_denied{false};  // the surface goes on beyond
  };

  /// What patches say of a body at a pose.
  struct Evidence {
    std::array<SeenFace, kNumBrickFaces> faces{};
    std::vector<bool> is_support;  // of each patch
    std::vector<Condition> conditions;
    int num_edges{0};
    bool has_inner_edge{false};  // a seen face ends in its midst
    double seen_area_m2{0.0};
    // Along each axis of the body: what is seen of its ends, and of the surface between them [m from the middle].
    std::array<std::array<End, 2>, 3> ends{};
    std::array<double, 3> lowest{INFINITY, INFINITY, INFINITY}, highest{-INFINITY, -INFINITY, -INFINITY};
  };

  Evidence weigh(const BrickType& type, const Eigen::Isometry3d& T) const {
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
        if (patch.is_large || patch.normal_map.dot(normal) < std::cos(config_.face_tolerance_rad)) continue;
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

  static Eigen::Matrix<double, 1, 6> row(const Eigen::Vector3d& translation, const Eigen::Vector3d& rotation) {
    Eigen::Matrix<double, 1, 6> J;
    J << translation.transpose(), rotation.transpose();
    return J;
  }

  /// One edge of a seen face: `axis` points from the face's middle to it, and `end` is that end of the body.
  void weighEdge(const std::vector<std::size_t>& supports, const Eigen::Vector3d& c, const Eigen::Vector3d& axis,
                 double half, const Eigen::Vector3d& across, double half_across, Evidence* evidence, End* end) const {
    constexpr double kInner_m = 0.03;
    std::vector<std::pair<double, Eigen::Vector3d>> on_edge;  // place along the edge, point
    std::vector<double> along;
    std::map<long, std::vector<double>> inner_along;  // an edge is a line: holes here and there are none
    double beyond = 0.0;
    for (const std::size_t i : supports) {
      for (std::size_t k = 0; k < patches_[i].border.size(); ++k) {
        const BorderPoint& point = patches_[i].border[k];
        if (!shapes_[i].is_edge[k] || point.out_map.dot(axis) < kAlong) continue;
        const double place = axis.dot(point.p_map - c);
        const double place_across = across.dot(point.p_map - c);
        if (std::abs(place_across) > half_across) continue;
        if (std::abs(place + config_.edge_inset_m - half) <= 0.75 * config_.size_tolerance_m) {
          on_edge.emplace_back(place_across, point.p_map);
          along.push_back(place_across);
        } else if (place < half - config_.edge_inset_m - kInner_m && std::abs(place_across) < half_across - kInner_m) {
          inner_along[std::lround(place / (2.0 * kBin_m))].push_back(place_across);
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
      if (coveredLength(inner) > 0.4 * length) evidence->has_inner_edge = true;
    }
    if (is_denied) {
      --evidence->num_edges;
    } else if (coveredLength(along) >= std::max(config_.min_edge_m, 0.3 * length)) {
      ++evidence->num_edges;
    }
    end->is_denied = end->is_denied || is_denied;
    // Pieces of half the length and less were seen where something stood before the face.
    end->is_shown = end->is_shown || coveredLength(along) > 0.5 * length;
    if (is_denied || coveredLength(along) < config_.min_edge_m) return;
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
                                      std::sqrt(2.0) * config_.edge_std_m});
    }
  }

  /// Whether what is seen rules out every other size: along some axis both ends are seen, or surface beyond its end.
  bool isSizeSeen(const Eigen::Vector3d& size_m, const Evidence& evidence) const {
    const auto isRuledOut = [&](const Eigen::Vector3d& other_m) {
      for (std::size_t i = 0; i < 3; ++i) {
        const double longer_m = size_m[static_cast<int>(i)] - other_m[static_cast<int>(i)];
        if (std::abs(longer_m) <= config_.size_tolerance_m) continue;
        const auto isSeen = [](const End& end) { return end.is_shown && !end.is_denied; };
        if (std::all_of(evidence.ends[i].begin(), evidence.ends[i].end(), isSeen)) return true;
        const double seen_m = evidence.highest[i] - evidence.lowest[i];
        if (longer_m > 0.0 && seen_m > other_m[static_cast<int>(i)] + config_.size_tolerance_m) return true;
      }
      return (size_m - other_m).cwiseAbs().maxCoeff() <= config_.size_tolerance_m;
    };
    static const std::vector<Eigen::Matrix3d> rotations = rotationsOfTheCube();
    return std::all_of(types_.begin(), types_.end(), [&](const BrickType& type) {
      return std::all_of(rotations.begin(), rotations.end(), [&](const Eigen::Matrix3d& rotation) {
        return isRuledOut((rotation * type.size_m).cwiseAbs());
      });
    });
  }

  /// Least squares of all conditions: moves the body and gives its covariance. Nothing, if they do not determine it.
  static std::optional<Matrix6d> solve(const std::vector<Condition>& conditions, Eigen::Isometry3d* T) {
    Matrix6d information = Matrix6d::Zero();
    Eigen::Matrix<double, 6, 1> right = Eigen::Matrix<double, 6, 1>::Zero();
    for (const Condition& condition : conditions) {
      const double weight = 1.0 / (condition.std * condition.std);
      information += weight * condition.J.transpose() * condition.J;
      right += weight * condition.J.transpose() * condition.residual;
    }
    const Eigen::SelfAdjointEigenSolver<Matrix6d> axes(information);
    if (axes.eigenvalues()[0] < 1.0) return std::nullopt;  // a metre, a radian
    const Eigen::Matrix<double, 6, 1> step = information.ldlt().solve(right);
    T->translation() += step.head<3>();
    const double angle = step.tail<3>().norm();
    if (angle > 1e-12) {
      T->linear() = Eigen::AngleAxisd(angle, step.tail<3>() / angle).toRotationMatrix() * T->linear();
    }
    return information.inverse();
  }

  std::optional<Cuboid> settle(const Hypothesis& hypothesis, CuboidStatistics* statistics) const {
    constexpr int kRounds = 3;
    const BrickType& type = *hypothesis.type;
    Eigen::Isometry3d T = hypothesis.T_map_body;
    Matrix6d covariance = Matrix6d::Identity();
    Evidence evidence;
    for (int round = 0; round < kRounds; ++round) {
      evidence = weigh(type, T);
      if (evidence.num_edges < config_.min_edges || evidence.has_inner_edge) {
        ++statistics->num_few_edges;
        return std::nullopt;
      }
      std::vector<Condition> conditions = evidence.conditions;
      for (const Hypothesis::Pin& pin : hypothesis.pins) {
        conditions.push_back(
            {row(pin.axis, Eigen::Vector3d::Zero()), pin.place - pin.axis.dot(T.translation()), pin.std});
      }
      const std::optional<Matrix6d> solved = solve(conditions, &T);
      if (!solved) {
        ++statistics->num_unsure;
        return std::nullopt;
      }
      covariance = *solved;
    }
    evidence = weigh(type, T);
    double best_share = 0.0;
    for (const SeenFace& face : evidence.faces) best_share = std::max(best_share, face.share);
    if (evidence.num_edges < config_.min_edges || evidence.has_inner_edge || best_share < config_.min_face_share) {
      ++statistics->num_few_edges;
      return std::nullopt;
    }
    const auto worst = [&covariance](int from) {
      const Eigen::Matrix3d block = covariance.block<3, 3>(from, from);
      return std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(block).eigenvalues()[2]);
    };
    if (worst(0) > config_.max_std_m || worst(3) > config_.max_std_rad) {
      ++statistics->num_unsure;
      return std::nullopt;
    }
    if (!isSizeSeen(type.size_m, evidence)) {
      ++statistics->num_ambiguous;
      return std::nullopt;
    }
    if (isPenetrated(type, T, evidence)) {
      ++statistics->num_penetrating;
      return std::nullopt;
    }
    if (space_) {
      const std::vector<SpaceState> states = ask(insidePoints(T, type.size_m, config_.inside_m, 5));
      const auto num_free = std::count(states.begin(), states.end(), SpaceState::kFree);
      if (static_cast<double>(num_free) > config_.max_free_share * static_cast<double>(states.size())) {
        ++statistics->num_free;
        return std::nullopt;
      }
    }
    Cuboid cuboid;
    cuboid.type = type.name;
    cuboid.size_m = type.size_m;
    cuboid.T_map_body = T;
    cuboid.covariance = covariance;
    cuboid.covariance.topLeftCorner<3, 3>().diagonal().array() += config_.floor_std_m * config_.floor_std_m;
    cuboid.covariance.bottomRightCorner<3, 3>().diagonal().array() += config_.floor_std_rad * config_.floor_std_rad;
    cuboid.faces = evidence.faces;
    for (std::size_t f = 0; f < kBrickFaces.size(); ++f) {
      SeenFace& face = cuboid.faces[f];
      if (face.patch < 0) continue;
      const Eigen::Vector3d middle = T * (0.5 * type.size_m.cwiseProduct(description::faceNormal(kBrickFaces[f])));
      face.radius_m = roomAround(static_cast<std::size_t>(face.patch), middle);
    }
    cuboid.num_edges = evidence.num_edges;
    cuboid.seen_area_m2 = evidence.seen_area_m2;
    return alignedLike(cuboid, Eigen::Matrix3d::Identity());
  }

  /// Distance from a point to the border of a patch that covers it; 0 if it does not.
  double roomAround(std::size_t i, const Eigen::Vector3d& p_map) const {
    const double room = patches_[i].borderDistance(p_map);
    const auto& vertices = patches_[i].vertices;
    const bool is_covered = std::any_of(vertices.begin(), vertices.end(), [&](std::uint32_t vertex) {
      const Eigen::Vector3d d = mesh_.vertices_map[vertex] - p_map;
      return (d - patches_[i].normal_map.dot(d) * patches_[i].normal_map).norm() < std::min(room, kCovered_m);
    });
    return is_covered ? room : 0.0;
  }

  /// Surface inside the body, or the body reaching below a surface that is none of its faces.
  bool isPenetrated(const BrickType& type, const Eigen::Isometry3d& T, const Evidence& evidence) const {
    const Eigen::Isometry3d T_body_map = T.inverse();
    const Eigen::Array3d room = 0.5 * type.size_m.array() - config_.inside_m;
    double inside = 0.0;
    for (std::size_t i = 0; i < mesh_.vertices_map.size(); ++i) {
      const Eigen::Vector3d p_body = T_body_map * mesh_.vertices_map[i];
      if ((p_body.array().abs() < room).all()) inside += area_[i];
    }
    if (inside > config_.max_inside_share * evidence.seen_area_m2) return true;
    const Eigen::Matrix3Xd points = insidePoints(T, type.size_m, config_.inside_m, 7);
    for (std::size_t i = 0; i < patches_.size(); ++i) {
      if (evidence.is_support[i]) continue;
      int num_below = 0;
      for (Eigen::Index k = 0; k < points.cols(); ++k) {
        const double height = patches_[i].height(points.col(k));
        if (height > 0.0 || height < -kSlab_m) continue;
        num_below += isWellInHull(i, inFrame(i, points.col(k))) ? 1 : 0;
      }
      if (num_below > config_.max_inside_share * static_cast<double>(points.cols())) return true;
    }
    return false;
  }

  /// And not near its border: patches reach a little into the rounding at their foot.
  bool isWellInHull(std::size_t i, const Eigen::Vector2d& p) const {
    const std::vector<Eigen::Vector2d>& hull = shapes_[i].hull;
    for (std::size_t k = 0; k < hull.size(); ++k) {
      const Eigen::Vector2d along = hull[(k + 1) % hull.size()] - hull[k];
      const Eigen::Vector2d d = p - hull[k];
      if (along.x() * d.y() - along.y() * d.x() < config_.inside_m * along.norm()) return false;
    }
    return hull.size() >= 3;
  }

  static bool isSame(const Cuboid& a, const Cuboid& b) {
    return a.type == b.type && (a.T_map_body.translation() - b.T_map_body.translation()).norm() < kSame_m &&
           angleBetweenBodies(a.T_map_body, b.T_map_body, a.size_m) < kSame_rad;
  }

  static bool isBetter(const Cuboid& a, const Cuboid& b) {
    return a.num_edges != b.num_edges ? a.num_edges > b.num_edges : a.seen_area_m2 > b.seen_area_m2;
  }

  static std::vector<Cuboid> choose(std::vector<Cuboid> candidates, CuboidStatistics* statistics) {
    constexpr double kAsWell = 0.9;  // share of the surface that a rival explains
    std::stable_sort(candidates.begin(), candidates.end(), isBetter);
    std::vector<bool> is_out(candidates.size(), false);
    std::vector<Cuboid> chosen;
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      if (is_out[i]) continue;
      const Cuboid& best = candidates[i];
      bool is_ambiguous = false;
      for (std::size_t j = i + 1; j < candidates.size(); ++j) {
        if (is_out[j] ||
            !overlap(best.T_map_body, best.size_m, candidates[j].T_map_body, candidates[j].size_m, kSame_m)) {
          continue;
        }
        is_out[j] = true;
        is_ambiguous = is_ambiguous || (candidates[j].num_edges == best.num_edges &&
                                        candidates[j].seen_area_m2 >= kAsWell * best.seen_area_m2);
      }
      if (is_ambiguous) {
        ++statistics->num_ambiguous;
      } else {
        chosen.push_back(best);
      }
    }
    return chosen;
  }

  const TriangleMesh& mesh_;
  const std::vector<Patch>& patches_;
  const std::vector<BrickType>& types_;
  const SpaceQuery& space_;
  const CuboidConfig& config_;
  std::vector<double> area_;  // of each vertex
  std::vector<Shape> shapes_;
};

}  // namespace

bool overlap(const Eigen::Isometry3d& T_map_a, const Eigen::Vector3d& size_a_m, const Eigen::Isometry3d& T_map_b,
             const Eigen::Vector3d& size_b_m, double slack_m) {
  std::vector<Eigen::Vector3d> axes;
  for (int i = 0; i < 3; ++i) {
    axes.emplace_back(T_map_a.linear().col(i));
    axes.emplace_back(T_map_b.linear().col(i));
    for (int j = 0; j < 3; ++j) {
      const Eigen::Vector3d cross = T_map_a.linear().col(i).cross(T_map_b.linear().col(j));
      if (cross.norm() > 1e-6) axes.emplace_back(cross.normalized());
    }
  }
  const Eigen::Vector3d between = T_map_b.translation() - T_map_a.translation();
  return std::all_of(axes.begin(), axes.end(), [&](const Eigen::Vector3d& axis) {
    const double reach = 0.5 * ((T_map_a.linear().transpose() * axis).cwiseAbs().dot(size_a_m) +
                                (T_map_b.linear().transpose() * axis).cwiseAbs().dot(size_b_m));
    return std::abs(axis.dot(between)) < reach - slack_m;
  });
}

Eigen::Isometry3d nearestSymmetric(const Eigen::Isometry3d& T_map_body, const Eigen::Vector3d& size_m,
                                   const Eigen::Matrix3d& like) {
  static const std::vector<Eigen::Matrix3d> rotations = rotationsOfTheCube();
  Eigen::Isometry3d nearest = T_map_body;
  double best = -INFINITY;
  for (const Eigen::Matrix3d& rotation : rotations) {
    if (((rotation.cwiseAbs() * size_m) - size_m).cwiseAbs().maxCoeff() > 1e-3) continue;
    const Eigen::Matrix3d turned = T_map_body.linear() * rotation;
    const double likeness = (like.transpose() * turned).trace();
    if (likeness > best + 1e-9) {
      best = likeness;
      nearest.linear() = turned;
    }
  }
  return nearest;
}

Cuboid alignedLike(const Cuboid& cuboid, const Eigen::Matrix3d& like) {
  Cuboid aligned = cuboid;
  aligned.T_map_body = nearestSymmetric(cuboid.T_map_body, cuboid.size_m, like);
  const Eigen::Matrix3d R_old_new = cuboid.T_map_body.linear().transpose() * aligned.T_map_body.linear();
  for (std::size_t f = 0; f < kBrickFaces.size(); ++f) {
    const Eigen::Vector3d normal_old = R_old_new * description::faceNormal(kBrickFaces[f]);
    for (std::size_t g = 0; g < kBrickFaces.size(); ++g) {
      if (normal_old.dot(description::faceNormal(kBrickFaces[g])) > 0.5) aligned.faces[f] = cuboid.faces[g];
    }
  }
  return aligned;
}

double angleBetweenBodies(const Eigen::Isometry3d& T_map_a, const Eigen::Isometry3d& T_map_b,
                          const Eigen::Vector3d& size_m) {
  const Eigen::Isometry3d nearest = nearestSymmetric(T_map_a, size_m, T_map_b.linear());
  return Eigen::AngleAxisd(T_map_b.linear().transpose() * nearest.linear()).angle();
}

Eigen::Matrix3Xd insidePoints(const Eigen::Isometry3d& T_map_body, const Eigen::Vector3d& size_m, double margin_m,
                              int per_edge) {
  Eigen::Matrix3Xd points(3, static_cast<Eigen::Index>(per_edge) * per_edge * per_edge);
  const Eigen::Vector3d room = (0.5 * size_m.array() - margin_m).max(0.0);
  Eigen::Index next = 0;
  const auto at = [per_edge](int i) { return per_edge == 1 ? 0.0 : 2.0 * i / (per_edge - 1) - 1.0; };
  for (int i = 0; i < per_edge; ++i) {
    for (int j = 0; j < per_edge; ++j) {
      for (int k = 0; k < per_edge; ++k) {
        points.col(next++) = T_map_body * room.cwiseProduct(Eigen::Vector3d(at(i), at(j), at(k)));
      }
    }
  }
  return points;
}

std::vector<Cuboid> findCuboids(const TriangleMesh& mesh, const std::vector<Patch>& patches,
                                const std::vector<BrickType>& types, const SpaceQuery& space,
                                const CuboidConfig& config, CuboidStatistics* statistics) {
  interactive_mapping::requireValid("impossible cuboids:", config);
  if (types.empty()) throw std::invalid_argument("no types of bodies are given, must be at least one");
  for (const BrickType& type : types) {
    if (!(type.size_m.array() > 0.0).all() || !type.size_m.allFinite()) {
      throw std::invalid_argument("size_m of type '" + type.name + "' must be finite and positive");
    }
  }
  requireMesh(mesh);
  for (const Patch& patch : patches) {
    if (!patch.vertices.empty() && patch.vertices.back() >= mesh.vertices_map.size()) {
      throw std::invalid_argument("a patch names vertex " + std::to_string(patch.vertices.back()) +
                                  ", must be one of the mesh's " + std::to_string(mesh.vertices_map.size()));
    }
  }
  CuboidStatistics counted;
  std::vector<Cuboid> cuboids = CuboidFinder(mesh, patches, types, space, config).find(&counted);
  if (statistics != nullptr) *statistics = counted;
  return cuboids;
}

}  // namespace surface_picking
