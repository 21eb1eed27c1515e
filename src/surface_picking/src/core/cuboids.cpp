// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking/cuboids.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <set>
#include <stdexcept>
#include <tuple>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "body_evidence.h"
#include "patch_shapes.h"

namespace surface_picking {
namespace {

namespace description = mp700_ur5e_description;
using description::BrickType;
using description::kBrickFaces;
using description::kNumBrickFaces;

constexpr double kSame_m = 0.03;  // bodies nearer than this, and turned by less than kSame_rad, are one
constexpr double kSame_rad = 0.15;
constexpr int kMostInRow = 6;
constexpr double kCovered_m = 0.02;  // to the next vertex of the mesh

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

class CuboidFinder {
 public:
  CuboidFinder(const TriangleMesh& mesh, const std::vector<Patch>& patches, const std::vector<BrickType>& types,
               const SpaceQuery& space, const CuboidConfig& config)
      : mesh_(mesh),
        patches_(patches),
        types_(types),
        space_(space),
        config_(config),
        shapes_(mesh, patches, space, config),
        evidence_(mesh, patches, shapes_, config) {}

  std::vector<Cuboid> find(CuboidStatistics* statistics) {
    std::vector<Cuboid> candidates;
    for (std::size_t i = 0; i < patches_.size(); ++i) {
      if (patches_[i].is_large) continue;
      for (const Frame& frame : shapes_.orientations(i)) {
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
    const Side lower_u = shapes_.sideOf(i, -frame.u, frame.v);
    const Side upper_u = shapes_.sideOf(i, frame.u, frame.v);
    const Side lower_v = shapes_.sideOf(i, -frame.v, frame.u);
    const Side upper_v = shapes_.sideOf(i, frame.v, frame.u);
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
    const std::vector<Eigen::Matrix3d>& rotations = rotationsOfTheCube();
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
      evidence = evidence_.weigh(type, T);
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
    evidence = evidence_.weigh(type, T);
    double best_share = 0.0;
    for (const SeenFace& face : evidence.faces) best_share = std::max(best_share, face.share);
    if (evidence.num_edges < config_.min_edges || evidence.has_inner_edge || best_share < CuboidConfig::kMinFaceShare) {
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
    if (evidence_.isPenetrated(type, T, evidence)) {
      ++statistics->num_penetrating;
      return std::nullopt;
    }
    if (space_) {
      const std::vector<SpaceState> states = askSpace(space_, insidePoints(T, type.size_m, config_.inside_m, 5));
      const auto num_free = std::count(states.begin(), states.end(), SpaceState::kFree);
      if (static_cast<double>(num_free) > CuboidConfig::kMaxFreeShare * static_cast<double>(states.size())) {
        ++statistics->num_free;
        return std::nullopt;
      }
    }
    Cuboid cuboid;
    cuboid.type = type.name;
    cuboid.size_m = type.size_m;
    cuboid.T_map_body = T;
    cuboid.covariance = covariance;
    cuboid.covariance.topLeftCorner<3, 3>().diagonal().array() += CuboidConfig::kFloorStd_m * CuboidConfig::kFloorStd_m;
    cuboid.covariance.bottomRightCorner<3, 3>().diagonal().array() +=
        CuboidConfig::kFloorStd_rad * CuboidConfig::kFloorStd_rad;
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
  const PatchShapes shapes_;
  const BodyEvidence evidence_;
};

}  // namespace

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
