// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/collision_scene.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <unordered_map>
#include <utility>

#include <interactive_mapping_common/threads/parallel_for.h>

#include "collision/collision_scene_data.h"
#include "collision/robot_shapes.h"

namespace motion_planning {
namespace {

using gpis_mapping::LatticeKey;
using gpis_mapping::LatticeKeyHash;
using gpis_mapping::SpaceState;

constexpr float kNoDistance = std::numeric_limits<float>::quiet_NaN();
constexpr float kFarAway = std::numeric_limits<float>::infinity();

/// At a corner of faces a vertex goes farther than its margin, so that each face is displaced by no less: 1.73 times at a
/// cube's corner, 2 at an edge of 60 degrees. Sharper ones get no more, or one bad triangle would put a spike into free
/// space.
constexpr double kMaxMitre = 2.0;
/// A triangle lower than this says nothing about the surface's direction, and all of it is this near to its neighbours:
/// marching cubes makes such slivers wherever the surface passes a corner of a voxel.
constexpr double kSliver_m = 5e-4;
/// Cross product of two edges [m^2]: below it a triangle has no direction. A millimetre times a nanometre.
constexpr double kMinCross_m2 = 1e-12;
/// Above base_link's ground; the arm ends at 1.6 m.
constexpr double kRegionTop_m = 2.0;
/// Surface this far below the ground is kept: the floor is not the map's business.
constexpr double kRegionBottom_m = -0.2;
/// How far from a surface the map's answer may change when that surface does: its depth of occupied space, see
/// GpisConfig::Query::occupied_depth_m.
constexpr double kReachOfChange_m = 0.20;
// Surface this high above the base's ground may be a wall that goes on above the camera's view.
constexpr double kWall_m = 0.5;

std::uint64_t mix(std::uint64_t h) {  // finaliser of splitmix64
  h = (h ^ (h >> 30)) * 0xbf58476d1ce4e5b9ULL;
  h = (h ^ (h >> 27)) * 0x94d049bb133111ebULL;
  return h ^ (h >> 31);
}

std::uint64_t bitsOf(double x) {
  x += 0.0;  // -0 and 0 are the same place
  std::uint64_t bits;
  std::memcpy(&bits, &x, sizeof bits);
  return bits;
}

std::uint64_t hashOf(const Eigen::Vector3d& p, std::uint64_t seed) {
  std::uint64_t h = seed;
  for (int i = 0; i < 3; ++i) h = mix(h + 0x9e3779b97f4a7c15ULL + bitsOf(p[i]));
  return h;
}

/// Points by their coordinates, numbered in the order they came.
class PointIndex {
 public:
  static constexpr std::uint32_t kNone = ~0u;

  /// Empties it.
  void reserve(std::size_t count) {
    std::size_t size = 64;
    while (size < 2 * count) size *= 2;
    slots_.assign(size, kNone);
    points_.clear();
    points_.reserve(count);
  }

  std::uint32_t find(const Eigen::Vector3d& p) const { return slots_.empty() ? kNone : slots_[slotOf(p)]; }

  std::uint32_t add(const Eigen::Vector3d& p) {
    std::size_t slot = slotOf(p);
    if (slots_[slot] != kNone) return slots_[slot];
    if (2 * (points_.size() + 1) > slots_.size()) {
      const std::vector<Eigen::Vector3d> points = std::move(points_);
      reserve(2 * (points.size() + 1));
      for (const Eigen::Vector3d& old : points) add(old);
      slot = slotOf(p);
    }
    slots_[slot] = static_cast<std::uint32_t>(points_.size());
    points_.push_back(p);
    return slots_[slot];
  }

  const std::vector<Eigen::Vector3d>& points() const { return points_; }

 private:
  std::size_t slotOf(const Eigen::Vector3d& p) const {
    const std::size_t mask = slots_.size() - 1;
    std::size_t slot = static_cast<std::size_t>(hashOf(p, 0)) & mask;
    while (slots_[slot] != kNone && points_[slots_[slot]] != p) slot = (slot + 1) & mask;
    return slot;
  }

  std::vector<std::uint32_t> slots_;
  std::vector<Eigen::Vector3d> points_;
};

/// What a chunk's triangles were, in any order.
struct Contents {
  std::size_t count{0};
  std::array<std::uint64_t, 2> hash{{0, 0}};

  bool operator==(const Contents& other) const { return count == other.count && hash == other.hash; }
};

struct ChunkRecord {
  Contents contents;
  std::shared_ptr<const SurfaceChunk> chunk;
  std::vector<LatticeKey> blocks;  // that its triangles may touch, mapped or displaced
};

using Chunks = std::unordered_map<LatticeKey, ChunkRecord, LatticeKeyHash>;

/// A surface cleaned up: vertices at the same place are one, triangles out of reach or without area are gone.
struct CleanSurface {
  PointIndex vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<Eigen::Vector3d> directions;  // into free space, as long as a margin of 1 has to be
};

struct Gathered {
  Contents contents;
  std::vector<std::uint32_t> triangles;
};
using GatheredChunks = std::unordered_map<LatticeKey, Gathered, LatticeKeyHash>;

std::vector<LatticeKey> touchedBlocks(const SurfaceChunk& chunk, double block_m) {
  std::vector<LatticeKey> keys;
  for (const auto& triangle : chunk.triangles()) {
    Eigen::AlignedBox3d box;
    for (const std::uint32_t v : triangle) box.extend(chunk.mapped()[v]).extend(chunk.displaced()[v]);
    const LatticeKey lo = LatticeKey::of(box.min(), block_m);
    const LatticeKey hi = LatticeKey::of(box.max(), block_m);
    for (std::int32_t z = lo.z; z <= hi.z; ++z) {
      for (std::int32_t y = lo.y; y <= hi.y; ++y) {
        for (std::int32_t x = lo.x; x <= hi.x; ++x) {
          if (keys.empty() || keys.back() != LatticeKey{x, y, z}) keys.push_back({x, y, z});
        }
      }
    }
  }
  std::sort(keys.begin(), keys.end());
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
  return keys;
}

template <class Bvh>
void build(Bvh* bvh, const std::vector<Eigen::Vector3d>& vertices, const SurfaceChunk::Triangles& triangles) {
  std::vector<fcl::Triangle> indices;
  indices.reserve(triangles.size());
  for (const auto& t : triangles) indices.emplace_back(t[0], t[1], t[2]);
  bvh->beginModel(static_cast<int>(triangles.size()), static_cast<int>(vertices.size()));
  bvh->addSubModel(vertices, indices);
  bvh->endModel();
}

}  // namespace

SurfaceChunk::SurfaceChunk(std::vector<Eigen::Vector3d> mapped, std::vector<Eigen::Vector3d> displaced,
                           Triangles triangles)
    : mapped_(std::move(mapped)), displaced_(std::move(displaced)), triangles_(std::move(triangles)) {
  for (const Eigen::Vector3d& p : mapped_) mapped_bounds_.extend(p);
  for (const Eigen::Vector3d& p : displaced_) bounds_.extend(p);
}

const SurfaceChunk::Bvh& SurfaceChunk::bvh() const {
  std::call_once(once_, [this] { build(&bvh_, displaced_, triangles_); });
  return bvh_;
}

const SurfaceChunk::MappedBvh& SurfaceChunk::mappedBvh() const {
  std::call_once(mapped_once_, [this] { build(&mapped_bvh_, mapped_, triangles_); });
  return mapped_bvh_;
}

std::shared_ptr<const SurfaceChunk> SurfaceChunk::without(const std::shared_ptr<const SurfaceChunk>& self,
                                                          const OrientedBox& box, bool only_own) {
  constexpr double kFaces = -0.5;  // cosine between the way into free space and the nearest face's normal
  const Eigen::Isometry3d T_box_map = box.T_map_box.inverse();
  const auto isInBox = [&](const Eigen::Vector3d& p_map) {
    return ((T_box_map * p_map).array().abs() <= 0.5 * box.size_m.array()).all();
  };
  const auto facesBox = [&](const std::array<std::uint32_t, 3>& triangle) {
    Eigen::Vector3d p_map = Eigen::Vector3d::Zero();
    Eigen::Vector3d free_map = Eigen::Vector3d::Zero();
    for (const std::uint32_t v : triangle) {
      p_map += self->mapped_[v] / 3.0;
      free_map += self->displaced_[v] - self->mapped_[v];
    }
    const Eigen::Vector3d p_box = T_box_map * p_map;
    int axis = 0;
    (p_box.cwiseAbs() - 0.5 * box.size_m).maxCoeff(&axis);
    return std::copysign(1.0, p_box[axis]) * (T_box_map.linear() * free_map)[axis] < kFaces * free_map.norm();
  };
  std::vector<std::uint32_t> new_index(self->mapped_.size(), PointIndex::kNone);
  std::vector<Eigen::Vector3d> mapped;
  std::vector<Eigen::Vector3d> displaced;
  Triangles triangles;
  for (const auto& triangle : self->triangles_) {
    const bool is_in =
        std::all_of(triangle.begin(), triangle.end(), [&](std::uint32_t v) { return isInBox(self->mapped_[v]); });
    if (is_in && !(only_own && facesBox(triangle))) continue;
    triangles.emplace_back();
    for (std::size_t i = 0; i < 3; ++i) {
      std::uint32_t& index = new_index[triangle[i]];
      if (index == PointIndex::kNone) {
        index = static_cast<std::uint32_t>(mapped.size());
        mapped.push_back(self->mapped_[triangle[i]]);
        displaced.push_back(self->displaced_[triangle[i]]);
      }
      triangles.back()[i] = index;
    }
  }
  if (triangles.size() == self->triangles_.size()) return self;
  if (triangles.empty()) return nullptr;
  return std::make_shared<SurfaceChunk>(std::move(mapped), std::move(displaced), std::move(triangles));
}

double CollisionScene::freeDistance(const Eigen::Vector3d& p_map) const {
  if (free_distance_m.empty()) return kFarAway;
  // A point outside is no nearer to anything than the point of the lattice's box nearest to it.
  return static_cast<double>(free_distance_m[lattice.index(lattice.clamped(p_map))]);
}

struct PreparedSurface {
  Eigen::Isometry3d T_map_base{Eigen::Isometry3d::Identity()};
  double region_radius_m{0.0};
  double chunk_m{0.0};
  CleanSurface clean;
  GatheredChunks chunks;
  std::size_t degenerate{0};
  double prepare_ms{0.0};
};

struct CollisionSceneBuilder::State {
  CollisionSceneConfig config;
  std::shared_ptr<const PreparedSurface> surface{std::make_shared<PreparedSurface>()};  // the last one
  std::vector<double> surface_std;  // what was answered for each of its vertices; NaN: no answer
  Chunks chunks;
  std::shared_ptr<const CollisionScene> scene{std::make_shared<CollisionScene>()};
};

namespace {

struct Corner {
  Eigen::Vector3d p_map;
  Eigen::Vector3d normal_map;  // as given; zero: none
  std::uint32_t vertex;        // of the surface; kNone: the middle of an edge
};
using Corners = std::array<Corner, 3>;

/// Calls `keep` for the triangle, or for pieces of it without edges longer than `max_edge_m`; those out of the region are
/// dropped. Edges are halved, so that triangles which share one stay joined. The region is a ball.
template <class Keep>
void cutUp(const Corners& whole, double max_edge_m, const Eigen::Vector3d& region_middle_map, double region_radius_m,
           const Keep& keep) {
  const auto isShort = [&](std::size_t i) {
    return (whole[(i + 1) % 3].p_map - whole[i].p_map).squaredNorm() <= max_edge_m * max_edge_m;
  };
  if (isShort(0) && isShort(1) && isShort(2)) {
    keep(whole);
    return;
  }
  std::vector<Corners> rest = {whole};
  while (!rest.empty()) {
    const Corners corners = rest.back();
    rest.pop_back();
    std::size_t longest = 0;
    std::array<double, 3> edge_m;
    for (std::size_t i = 0; i < 3; ++i) {
      edge_m[i] = (corners[(i + 1) % 3].p_map - corners[i].p_map).norm();
      if (edge_m[i] > edge_m[longest]) longest = i;
    }
    if (edge_m[longest] <= max_edge_m) {
      keep(corners);
      continue;
    }
    // Within an edge's length of a corner lies all of the triangle.
    if ((corners[0].p_map - region_middle_map).norm() > region_radius_m + edge_m[longest]) continue;
    const Corner& a = corners[longest];
    const Corner& b = corners[(longest + 1) % 3];
    const Corner middle{0.5 * (a.p_map + b.p_map), a.normal_map + b.normal_map, PointIndex::kNone};
    rest.push_back(corners);
    rest.back()[(longest + 1) % 3] = middle;
    rest.push_back(corners);
    rest.back()[longest] = middle;
  }
}

/// From directions into free space to displacements for a margin of one: n . d >= 1 for each face that meets in the vertex
/// (n its normal), unless that takes more than kMaxMitre.
void mitre(const std::vector<std::array<std::uint32_t, 3>>& triangles, const std::vector<Eigen::Vector3d>& normals,
           std::vector<Eigen::Vector3d>* directions) {
  const auto leastAdvance = [&](const std::vector<std::uint32_t>& chosen, std::vector<double>* least) {
    for (const std::uint32_t t : chosen) {
      if (normals[t].isZero()) continue;
      for (const std::uint32_t v : triangles[t]) (*least)[v] = std::min((*least)[v], normals[t].dot((*directions)[v]));
    }
  };
  std::vector<std::uint32_t> chosen(triangles.size());
  for (std::uint32_t t = 0; t < chosen.size(); ++t) chosen[t] = t;
  std::vector<double> least(directions->size(), 1.0);
  leastAdvance(chosen, &least);
  // Where faces meet at more than 26 degrees, the mean normal is not the best direction: project on the half-space that is
  // violated most, again and again (Motzkin). Faces at right angles are right after a round each. Which one is the most
  // violated does not depend on the order of the triangles; nor may the result.
  constexpr double kSharp = 0.9;
  constexpr int kRounds = 8;
  chosen.erase(std::remove_if(chosen.begin(), chosen.end(),
                              [&](std::uint32_t t) {
                                return std::all_of(triangles[t].begin(), triangles[t].end(),
                                                   [&](std::uint32_t v) { return least[v] >= kSharp; });
                              }),
               chosen.end());
  struct Worst {
    double advance{1.0};
    Eigen::Vector3d normal{Eigen::Vector3d::Zero()};
  };
  for (int round = 0; round < kRounds; ++round) {
    std::unordered_map<std::uint32_t, Worst> worst;
    for (const std::uint32_t t : chosen) {
      const Eigen::Vector3d& n = normals[t];
      if (n.isZero()) continue;
      for (const std::uint32_t v : triangles[t]) {
        if (least[v] >= kSharp) continue;
        const double advance = n.dot((*directions)[v]);
        Worst& so_far = worst[v];
        if (advance < so_far.advance ||
            (advance == so_far.advance &&
             std::lexicographical_compare(n.data(), n.data() + 3, so_far.normal.data(), so_far.normal.data() + 3))) {
          so_far = {advance, n};
        }
      }
    }
    for (const auto& [v, violated] : worst) (*directions)[v] += (1.0 - violated.advance) * violated.normal;
  }
  std::vector<double> reached(directions->size(), std::numeric_limits<double>::max());
  leastAdvance(chosen, &reached);
  for (std::size_t v = 0; v < directions->size(); ++v) {
    Eigen::Vector3d& d = (*directions)[v];
    d /= std::max(1.0 / kMaxMitre, least[v] >= kSharp ? least[v] : reached[v]);
    const double length = d.norm();
    if (length > kMaxMitre) d *= kMaxMitre / length;
  }
}

CleanSurface clean(const Surface& surface, const Eigen::Isometry3d& T_map_base, const CollisionSceneConfig& config,
                   std::size_t* degenerate) {
  CleanSurface result;
  const Eigen::Isometry3d T_base_map = T_map_base.inverse();
  result.vertices.reserve(surface.vertices_map.size());
  result.triangles.reserve(surface.triangles.size());
  std::vector<Eigen::Vector3d> normals;  // of the triangles; zero: a sliver
  normals.reserve(surface.triangles.size());
  std::vector<Eigen::Vector3d> given;  // sum of the normals given for a place
  given.reserve(surface.vertices_map.size());
  std::vector<std::uint32_t> place(surface.vertices_map.size(), PointIndex::kNone);  // of the surface's vertices
  const double region_ball_m = std::hypot(config.region_radius_m, kRegionTop_m);
  const auto keep = [&](const Corners& corners) {
    const Eigen::Vector3d middle_base =
        T_base_map * Eigen::Vector3d((corners[0].p_map + corners[1].p_map + corners[2].p_map) / 3.0);
    if (middle_base.head<2>().norm() > config.region_radius_m || middle_base.z() > kRegionTop_m ||
        middle_base.z() < kRegionBottom_m) {
      return;
    }
    const Eigen::Vector3d ab = corners[1].p_map - corners[0].p_map;
    const Eigen::Vector3d ac = corners[2].p_map - corners[0].p_map;
    const Eigen::Vector3d cross = ab.cross(ac);
    const double longest2 = std::max({ab.squaredNorm(), ac.squaredNorm(), (ac - ab).squaredNorm()});
    const bool is_sliver = cross.squaredNorm() < kSliver_m * kSliver_m * longest2;
    normals.push_back(is_sliver ? Eigen::Vector3d::Zero() : Eigen::Vector3d(cross.normalized()));
    result.triangles.emplace_back();
    for (std::size_t i = 0; i < 3; ++i) {
      std::uint32_t once;
      std::uint32_t& v = corners[i].vertex == PointIndex::kNone ? once : place[corners[i].vertex];
      if (&v == &once || v == PointIndex::kNone) v = result.vertices.add(corners[i].p_map);
      if (v == given.size()) given.push_back(Eigen::Vector3d::Zero());
      given[v] += corners[i].normal_map;
      result.triangles.back()[i] = v;
    }
  };
  for (const auto& triangle : surface.triangles) {
    Corners corners;
    bool is_good = true;
    for (std::size_t i = 0; i < 3 && is_good; ++i) {
      is_good = triangle[i] < surface.vertices_map.size();
      if (!is_good) break;
      corners[i].vertex = triangle[i];
      corners[i].p_map = surface.vertices_map[triangle[i]];
      corners[i].normal_map = surface.normals_map[triangle[i]].cast<double>();
      if (!corners[i].normal_map.allFinite()) corners[i].normal_map.setZero();
      is_good = corners[i].p_map.allFinite();
    }
    if (is_good) {
      const double cross_m2 = (corners[1].p_map - corners[0].p_map).cross(corners[2].p_map - corners[0].p_map).norm();
      is_good = std::isfinite(cross_m2) && cross_m2 > kMinCross_m2;
    }
    if (!is_good) {
      ++*degenerate;
      continue;
    }
    cutUp(corners, config.chunk_m, T_map_base.translation(), region_ball_m, keep);
  }
  // Where no normal was given, the triangles' own.
  std::vector<Eigen::Vector3d> own(given.size(), Eigen::Vector3d::Zero());
  for (std::size_t t = 0; t < result.triangles.size(); ++t) {
    for (const std::uint32_t v : result.triangles[t]) own[v] += normals[t];
  }
  result.directions.resize(given.size());
  for (std::size_t v = 0; v < given.size(); ++v) {
    result.directions[v] = given[v].norm() > 1e-3 ? given[v].normalized() : own[v].normalized();
    // Sums depend in their last bits on the order of the triangles, and a chunk is known by its bits.
    constexpr double kGrid = 1 << 20;
    result.directions[v] = (result.directions[v] * kGrid).array().round() / kGrid;
  }
  mitre(result.triangles, normals, &result.directions);
  return result;
}

/// Blocks below which, and near which, unseen space is an obstacle.
struct PileBlocks {
  std::vector<std::uint8_t> is_near;  // or above a wall
  std::vector<std::uint8_t> is_beneath;
};

PileBlocks findPile(const BlockLattice& lattice, const CleanSurface& surface, const Eigen::Isometry3d& T_base_map,
                    const CollisionSceneConfig& config) {
  PileBlocks result;
  std::vector<std::uint8_t> is_pile(lattice.count(), 0);
  std::vector<std::uint8_t> is_wall(lattice.count(), 0);
  std::vector<std::uint8_t> hides(lattice.count(), 0);
  for (std::size_t v = 0; v < surface.directions.size(); ++v) {
    Eigen::Vector3d p_map = surface.vertices.points()[v];
    const double height_m = T_base_map.linear().row(2) * p_map + T_base_map.translation().z();
    if (height_m <= config.pile_min_height_m) continue;
    const std::size_t at = lattice.index(lattice.clamped(p_map));
    is_pile[at] = 1;
    if (height_m > kWall_m) {
      is_wall[at] = 1;
      // Before the upper end of what was seen of a wall nothing is hidden.
      p_map -= config.unknown_near_pile_m * surface.directions[v].normalized();
    }
    hides[lattice.index(lattice.clamped(p_map))] = 1;
  }
  // From any point of a block to any of one that holds surface.
  const double reach_blocks = config.unknown_near_pile_m / lattice.block() + 1.0;
  const std::vector<std::int32_t> squared = squaredDistances(lattice, hides);
  result.is_near.resize(lattice.count());
  for (std::size_t i = 0; i < squared.size(); ++i) result.is_near[i] = squared[i] <= reach_blocks * reach_blocks;
  result.is_beneath.assign(lattice.count(), 0);
  const Eigen::Vector3i size = lattice.size();
  for (int y = 0; y < size.y(); ++y) {
    for (int x = 0; x < size.x(); ++x) {
      bool is_beneath = false;
      bool is_above = false;
      for (int z = 0; z < size.z(); ++z) {
        const std::size_t at = lattice.index({x, y, z});
        if (is_above) result.is_near[at] = 1;
        is_above = is_above || is_wall[at] != 0;
      }
      for (int z = size.z() - 1; z >= 0; --z) {
        const std::size_t at = lattice.index({x, y, z});
        result.is_beneath[at] = is_beneath;
        is_beneath = is_beneath || is_pile[at] != 0;
      }
    }
  }
  return result;
}

/// A few unseen blocks with free space all around hide no solid: it would have a surface that was seen. They come from pixels
/// that measured nothing, at the edges of things, and from gaps between views: rods of one to six blocks. One block alone
/// may touch what is not free.
void forgiveSpecks(const Eigen::Isometry3d& T_base_map, CollisionScene* scene) {
  const BlockLattice& lattice = scene->lattice;
  // That share faces: a litre, a twelfth of a brick; never fewer than two.
  const double max_blocks = std::clamp(std::round(1e-3 / std::pow(lattice.block(), 3)), 2.0, 8.0);
  const Eigen::Vector3i size = lattice.size();
  const auto isUnknown = [&](std::size_t at) { return (scene->flags[at] & kBlockUnknown) != 0; };
  const auto isOpen = [&](std::size_t at) {
    const std::uint8_t flags = scene->flags[at];
    if ((flags & kBlockObserved) != 0) return (flags & kBlockInside) == 0;
    // Not asked for: far from the pile, or under the floor.
    return (T_base_map * lattice.center(lattice.position(at))).z() >= 0.0;
  };
  std::vector<std::uint8_t> is_visited(lattice.count(), 0);
  std::vector<std::size_t> piece;
  for (std::size_t first = 0; first < lattice.count(); ++first) {
    if (!isUnknown(first) || is_visited[first] != 0) continue;
    piece = {first};
    is_visited[first] = 1;
    std::size_t num_closed_faces = 0;
    for (std::size_t next = 0; next < piece.size(); ++next) {
      for (int axis = 0; axis < 3; ++axis) {
        for (const int step : {-1, 1}) {
          Eigen::Vector3i beside = lattice.position(piece[next]);
          beside[axis] += step;
          if (beside[axis] < 0 || beside[axis] >= size[axis]) {
            ++num_closed_faces;
            continue;
          }
          const std::size_t at = lattice.index(beside);
          if (!isUnknown(at)) {
            num_closed_faces += isOpen(at) ? 0u : 1u;
          } else if (std::exchange(is_visited[at], std::uint8_t{1}) == 0) {
            piece.push_back(at);
          }
        }
      }
    }
    const bool is_speck =
        num_closed_faces == 0 ? static_cast<double>(piece.size()) <= max_blocks : num_closed_faces + piece.size() == 2;
    if (!is_speck) continue;
    for (const std::size_t at : piece) scene->flags[at] = kBlockObserved | kBlockSpeck;
  }
}

BlockLattice latticeOf(const std::vector<Eigen::Vector3d>& vertices_map, const Eigen::Isometry3d& T_map_base,
                       const CollisionSceneConfig& config) {
  const double reach = config.region_radius_m + config.unknown_near_pile_m + 2.0 * config.block_m;
  double bottom = std::numeric_limits<double>::max();
  double top = -bottom;
  for (const double x : {-reach, reach}) {
    for (const double y : {-reach, reach}) {
      const double z = (T_map_base * Eigen::Vector3d(x, y, 0.0)).z();
      bottom = std::min(bottom, z);
      top = std::max(top, z);
    }
  }
  const Eigen::Vector3d origin = T_map_base.translation();
  for (const Eigen::Vector3d& p : vertices_map) {
    const bool is_wall = p.z() - origin.z() > kWall_m;
    top = std::max(top, is_wall ? std::max(p.z(), origin.z() + config.region_radius_m) : p.z());
  }
  top += config.unknown_near_pile_m + 2.0 * config.block_m;
  const LatticeKey first = LatticeKey::of({origin.x() - reach, origin.y() - reach, bottom}, config.block_m);
  LatticeKey last = LatticeKey::of({origin.x() + reach, origin.y() + reach, top}, config.block_m);
  // In steps of eight blocks, so that a pile that grows a little keeps its lattice.
  last.z = first.z + ((last.z - first.z) / 8 + 1) * 8;
  return BlockLattice(config.block_m, first, last);
}

/// Blocks whose answers may have changed with these chunks.
std::vector<std::uint8_t> blocksNear(const BlockLattice& lattice, const std::vector<LatticeKey>& chunks,
                                     const CollisionSceneConfig& config) {
  std::vector<std::uint8_t> is_near(lattice.count(), 0);
  const Eigen::Vector3d reach = Eigen::Vector3d::Constant(kReachOfChange_m + config.block_m);
  for (const LatticeKey& key : chunks) {
    const Eigen::Vector3d corner = key.corner(config.chunk_m);
    const Eigen::Vector3i lo = lattice.clamped(corner - reach);
    const Eigen::Vector3i hi = lattice.clamped(corner + Eigen::Vector3d::Constant(config.chunk_m) + reach);
    for (int z = lo.z(); z <= hi.z(); ++z) {
      for (int y = lo.y(); y <= hi.y(); ++y) {
        std::fill_n(is_near.begin() + static_cast<std::ptrdiff_t>(lattice.index({lo.x(), y, z})), hi.x() - lo.x() + 1,
                    std::uint8_t{1});
      }
    }
  }
  return is_near;
}

ChunkRecord makeChunk(const std::vector<std::uint32_t>& chosen,
                      const std::vector<std::array<std::uint32_t, 3>>& all_triangles,
                      const std::vector<Eigen::Vector3d>& vertices, const std::vector<Eigen::Vector3d>& displaced,
                      const CollisionSceneConfig& config) {
  std::unordered_map<std::uint32_t, std::uint32_t> local;
  std::vector<Eigen::Vector3d> chunk_mapped;
  std::vector<Eigen::Vector3d> chunk_displaced;
  SurfaceChunk::Triangles triangles;
  triangles.reserve(chosen.size());
  for (const std::uint32_t t : chosen) {
    triangles.emplace_back();
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t v = all_triangles[t][i];
      const auto [found, is_new] = local.emplace(v, static_cast<std::uint32_t>(chunk_mapped.size()));
      if (is_new) {
        chunk_mapped.push_back(vertices[v]);
        chunk_displaced.push_back(displaced[v]);
      }
      triangles.back()[i] = found->second;
    }
  }
  ChunkRecord record;
  record.chunk =
      std::make_shared<SurfaceChunk>(std::move(chunk_mapped), std::move(chunk_displaced), std::move(triangles));
  record.blocks = touchedBlocks(*record.chunk, config.block_m);
  return record;
}

/// The triangles of one chunk of a new surface.
/// Chunks by their contents. Margins are left out: they follow from position, direction and the sigma kept for a vertex.
GatheredChunks gatherChunks(const CleanSurface& surface, double chunk_m) {
  const std::vector<Eigen::Vector3d>& vertices = surface.vertices.points();
  std::vector<std::array<std::uint64_t, 2>> vertex_hash(vertices.size());
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    for (std::size_t i = 0; i < 2; ++i) vertex_hash[v][i] = hashOf(surface.directions[v], hashOf(vertices[v], i + 1));
  }
  GatheredChunks gathered;
  std::pair<const LatticeKey, Gathered>* last = nullptr;  // neighbours in the mesh are mostly in the same chunk
  for (std::size_t t = 0; t < surface.triangles.size(); ++t) {
    const auto& [a, b, c] = surface.triangles[t];
    const LatticeKey key = LatticeKey::of((vertices[a] + vertices[b] + vertices[c]) / 3.0, chunk_m);
    if (!last || last->first != key) last = &*gathered.try_emplace(key).first;
    Gathered& chunk = last->second;
    chunk.triangles.push_back(static_cast<std::uint32_t>(t));
    ++chunk.contents.count;
    for (std::size_t i = 0; i < 2; ++i) {
      // A sum does not depend on the order, which in the map's mesh depends on its history.
      chunk.contents.hash[i] +=
          mix(vertex_hash[a][i] + mix(vertex_hash[b][i] + mix(vertex_hash[c][i] + 0x9e3779b97f4a7c15ULL)));
    }
  }
  return gathered;
}

std::vector<LatticeKey> changedChunks(const GatheredChunks& gathered, const Chunks& last) {
  std::vector<LatticeKey> changed;
  for (const auto& [key, chunk] : gathered) {
    const auto before = last.find(key);
    if (before == last.end() || !(before->second.contents == chunk.contents)) changed.push_back(key);
  }
  return changed;
}

std::vector<LatticeKey> goneChunks(const GatheredChunks& gathered, const Chunks& last) {
  std::vector<LatticeKey> gone;
  for (const auto& [key, record] : last) {
    if (gathered.count(key) == 0) gone.push_back(key);
  }
  return gone;
}

/// Blocks to ask the map about: those near or beneath the pile that are new, unknown or near a chunk in `touched`. The
/// others are entered in the scene as the last scene has them.
std::vector<std::uint32_t> blocksToAsk(const CleanSurface& surface, const std::vector<LatticeKey>& touched,
                                       const CollisionSceneConfig& config, const CollisionScene& last_scene,
                                       CollisionScene* scene) {
  const BlockLattice& lattice = scene->lattice;
  const Eigen::Isometry3d T_base_map = scene->T_map_base.inverse();
  const PileBlocks pile = findPile(lattice, surface, T_base_map, config);
  scene->flags.assign(lattice.count(), 0);
  scene->distance_m.assign(lattice.count(), kNoDistance);
  const bool is_same_lattice = lattice == last_scene.lattice;
  std::vector<std::uint8_t> is_stale;
  if (is_same_lattice) is_stale = blocksNear(lattice, touched, config);
  std::vector<std::uint32_t> asked;
  for (std::size_t at = 0; at < lattice.count(); ++at) {
    if (!pile.is_near[at] && !pile.is_beneath[at]) continue;
    // The floor test covers what is below the ground.
    if ((T_base_map * lattice.center(lattice.position(at))).z() < 0.0) continue;
    const bool is_known = is_same_lattice && (last_scene.flags[at] & kBlockObserved) != 0 &&
                          (last_scene.flags[at] & (kBlockUnknown | kBlockSpeck)) == 0 && is_stale[at] == 0;
    if (is_known) {
      scene->flags[at] = last_scene.flags[at];
      scene->distance_m[at] = last_scene.distance_m[at];
    } else {
      asked.push_back(static_cast<std::uint32_t>(at));
    }
  }
  return asked;
}

/// Answers for the vertices, then for the blocks.
MapAnswers ask(const MapView& map, const std::vector<Eigen::Vector3d>& vertices,
               const std::vector<std::uint32_t>& asked_vertices, const BlockLattice& lattice,
               const std::vector<std::uint32_t>& asked_blocks) {
  const std::size_t num_asked = asked_vertices.size() + asked_blocks.size();
  if (num_asked == 0) return {};
  gpis_mapping::Points3d points(3, static_cast<Eigen::Index>(num_asked));
  Eigen::Index column = 0;
  for (const std::uint32_t v : asked_vertices) points.col(column++) = vertices[v];
  for (const std::uint32_t at : asked_blocks) points.col(column++) = lattice.center(lattice.position(at));
  MapAnswers answers = map.query(points);
  if (answers.state.size() != num_asked || answers.distance_m.size() != points.cols() ||
      answers.surface_std_m.size() != points.cols()) {
    throw std::runtime_error("the map answered " + std::to_string(answers.state.size()) + " of " +
                             std::to_string(num_asked) + " points");
  }
  return answers;
}

/// Vertices moved into free space by their margins: mean - k sigma of the surface's position, to first order.
std::vector<Eigen::Vector3d> displace(const CleanSurface& surface, const std::vector<double>& surface_std,
                                      const CollisionSceneConfig& config) {
  std::vector<Eigen::Vector3d> displaced = surface.vertices.points();
  for (std::size_t v = 0; v < displaced.size(); ++v) {
    // Without a sigma nobody knows how good the surface is: NaN takes the largest margin.
    const double margin_m = config.sigmas * surface_std[v] + config.margin_m;
    displaced[v] += (margin_m < config.max_margin_m ? margin_m : config.max_margin_m) * surface.directions[v];
  }
  return displaced;
}

/// Builds the changed chunks; takes the others from the last ones.
Chunks buildChunks(const GatheredChunks& gathered, const std::vector<LatticeKey>& changed, const CleanSurface& surface,
                   const std::vector<Eigen::Vector3d>& displaced, const CollisionSceneConfig& config,
                   const Chunks& last) {
  std::vector<ChunkRecord> built(changed.size());
  interactive_mapping::parallelFor(
      changed.size(), interactive_mapping::resolveThreadCount(0), 4, [&](std::size_t first, std::size_t end) {
        for (std::size_t i = first; i < end; ++i) {
          const Gathered& chunk = gathered.at(changed[i]);
          built[i] = makeChunk(chunk.triangles, surface.triangles, surface.vertices.points(), displaced, config);
          built[i].contents = chunk.contents;
        }
      });
  Chunks chunks;
  chunks.reserve(gathered.size());
  for (std::size_t i = 0; i < changed.size(); ++i) chunks.emplace(changed[i], std::move(built[i]));
  for (const auto& [key, chunk] : gathered) {
    if (chunks.count(key) == 0) chunks.emplace(key, last.at(key));
  }
  return chunks;
}

/// In the order of their keys: the hash map's order depends on its history; the contact found first must not.
std::vector<std::shared_ptr<const SurfaceChunk>> inOrder(const Chunks& chunks) {
  std::vector<LatticeKey> order;
  for (const auto& [key, record] : chunks) order.push_back(key);
  std::sort(order.begin(), order.end());
  std::vector<std::shared_ptr<const SurfaceChunk>> result;
  for (const LatticeKey& key : order) result.push_back(chunks.at(key).chunk);
  return result;
}

/// Enters the answers for the blocks, which begin at `first_answer`. What was free stays so while the robot stands there,
/// until something comes: near a surface the map calls space free by its distance, and with noise that comes and goes.
void enterAnswers(const MapAnswers& answers, std::size_t first_answer, const std::vector<std::uint32_t>& asked_blocks,
                  const CollisionScene& last_scene, CollisionScene* scene) {
  const bool is_same_lattice = scene->lattice == last_scene.lattice;
  for (std::size_t i = 0; i < asked_blocks.size(); ++i) {
    const std::size_t at = asked_blocks[i];
    const double distance_m = answers.distance_m[static_cast<Eigen::Index>(first_answer + i)];
    const SpaceState state = answers.state[first_answer + i];
    scene->distance_m[at] = static_cast<float>(distance_m);
    scene->flags[at] = kBlockObserved;
    if (state == SpaceState::kOccupied || distance_m < 0.0) {
      scene->flags[at] |= kBlockInside;
    } else if (state == SpaceState::kUnknown) {
      const bool was_free = is_same_lattice && last_scene.flags[at] == kBlockObserved;
      if (!was_free) scene->flags[at] |= kBlockUnknown;
    }
  }
}

/// CollisionScene::free_distance_m.
std::vector<float> freeDistances(const CollisionScene& scene, const Chunks& chunks) {
  const BlockLattice& lattice = scene.lattice;
  std::vector<std::uint8_t> is_taken(lattice.count());
  for (std::size_t at = 0; at < is_taken.size(); ++at) {
    is_taken[at] = (scene.flags[at] & (kBlockInside | kBlockUnknown)) != 0;
  }
  for (const auto& [key, record] : chunks) {
    for (const LatticeKey& block : record.blocks) {
      is_taken[lattice.index(lattice.clamped(block.center(lattice.block())))] = 1;
    }
  }
  // Between two blocks at offset d [blocks] no points are nearer than |max(0, |d| - 1)|: the distance between centres
  // once one of the two is grown by a block to all sides.
  std::vector<float> free_distance_m;
  for (const std::int32_t squared : squaredDistances(lattice, dilate(lattice, std::move(is_taken)))) {
    free_distance_m.push_back(
        squared >= kNoBlock ? kFarAway : static_cast<float>(lattice.block() * std::sqrt(static_cast<double>(squared))));
  }
  return free_distance_m;
}

}  // namespace

Eigen::AlignedBox3d regionBox(const Eigen::Isometry3d& T_map_base, const CollisionSceneConfig& config) {
  const Eigen::Vector3d axis = T_map_base.linear().col(2);
  const Eigen::Vector3d across = config.region_radius_m * T_map_base.linear().leftCols<2>().rowwise().norm();
  const Eigen::Vector3d bottom = T_map_base.translation() + kRegionBottom_m * axis;
  const Eigen::Vector3d top = T_map_base.translation() + kRegionTop_m * axis;
  return {bottom.cwiseMin(top) - across, bottom.cwiseMax(top) + across};
}

std::shared_ptr<const PreparedSurface> prepareSurface(const Surface& surface, const Eigen::Isometry3d& T_map_base,
                                                      const CollisionSceneConfig& config) {
  if (!isRigid(T_map_base)) throw std::invalid_argument("T_map_base is not a rigid transform");
  if (surface.normals_map.size() != surface.vertices_map.size()) {
    throw std::invalid_argument(std::to_string(surface.normals_map.size()) + " normals, must be one for each of " +
                                std::to_string(surface.vertices_map.size()) + " vertices");
  }
  const auto begin = std::chrono::steady_clock::now();
  auto prepared = std::make_shared<PreparedSurface>();
  prepared->T_map_base = T_map_base;
  prepared->region_radius_m = config.region_radius_m;
  prepared->chunk_m = config.chunk_m;
  prepared->clean = clean(surface, T_map_base, config, &prepared->degenerate);
  prepared->chunks = gatherChunks(prepared->clean, config.chunk_m);
  prepared->prepare_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
  return prepared;
}

CollisionSceneBuilder::CollisionSceneBuilder(const CollisionSceneConfig& config) : state_(std::make_unique<State>()) {
  interactive_mapping::requireValid("impossible collision scene:", config);
  state_->config = config;
}

CollisionSceneBuilder::~CollisionSceneBuilder() = default;

std::shared_ptr<const CollisionScene> CollisionSceneBuilder::scene() const {
  return state_->scene;
}

const CollisionSceneConfig& CollisionSceneBuilder::config() const {
  return state_->config;
}

SceneUpdate CollisionSceneBuilder::update(const Surface& surface, const MapView& map,
                                          const Eigen::Isometry3d& T_map_base) {
  return update(prepareSurface(surface, T_map_base, state_->config), map);
}

SceneUpdate CollisionSceneBuilder::update(const std::shared_ptr<const PreparedSurface>& surface, const MapView& map) {
  auto since = std::chrono::steady_clock::now();
  const auto lap_ms = [&since] {
    const auto begin = std::exchange(since, std::chrono::steady_clock::now());
    return std::chrono::duration<double, std::milli>(since - begin).count();
  };
  const CollisionSceneConfig& config = state_->config;
  if (surface->region_radius_m != config.region_radius_m || surface->chunk_m != config.chunk_m) {
    throw std::invalid_argument("the surface is prepared for another region_radius_m or chunk_m than this builder's");
  }
  const Eigen::Isometry3d& T_map_base = surface->T_map_base;
  const CleanSurface& cleaned = surface->clean;
  const GatheredChunks& gathered = surface->chunks;
  SceneUpdate update;
  update.degenerate = surface->degenerate;
  update.mesh_ms = surface->prepare_ms;
  const std::vector<Eigen::Vector3d>& vertices = cleaned.vertices.points();
  auto scene = std::make_shared<CollisionScene>();
  scene->T_map_base = T_map_base;
  const std::vector<LatticeKey> changed = changedChunks(gathered, state_->chunks);
  std::vector<LatticeKey> touched = goneChunks(gathered, state_->chunks);
  touched.insert(touched.end(), changed.begin(), changed.end());
  // A vertex keeps the sigma it was first given for as long as it stays where it is: chunks that share it agree on it, and
  // sigma of a surface that stays in place only falls, as more images are fused.
  std::vector<double> surface_std(vertices.size());
  std::vector<std::uint32_t> asked_vertices;
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    const std::uint32_t before = state_->surface->clean.vertices.find(vertices[v]);
    if (before == PointIndex::kNone) {
      asked_vertices.push_back(static_cast<std::uint32_t>(v));
    } else {
      surface_std[v] = state_->surface_std[before];
    }
  }
  update.mesh_ms += lap_ms();

  std::vector<std::uint32_t> asked_blocks;
  if (!vertices.empty()) {
    scene->lattice = latticeOf(vertices, T_map_base, config);
    asked_blocks = blocksToAsk(cleaned, touched, config, *state_->scene, scene.get());
  }
  update.lattice_ms += lap_ms();

  const MapAnswers answers = ask(map, vertices, asked_vertices, scene->lattice, asked_blocks);
  lap_ms();  // the map's own time is not the scene's

  for (std::size_t i = 0; i < asked_vertices.size(); ++i) {
    surface_std[asked_vertices[i]] = answers.surface_std_m[static_cast<Eigen::Index>(i)];
  }
  Chunks chunks =
      buildChunks(gathered, changed, cleaned, displace(cleaned, surface_std, config), config, state_->chunks);
  scene->chunks = inOrder(chunks);
  update.mesh_ms += lap_ms();

  enterAnswers(answers, asked_vertices.size(), asked_blocks, *state_->scene, scene.get());
  if (!vertices.empty()) {
    forgiveSpecks(T_map_base.inverse(), scene.get());
    scene->free_distance_m = freeDistances(*scene, chunks);
  }
  update.lattice_ms += lap_ms();

  update.chunks = chunks.size();
  update.chunks_rebuilt = changed.size();
  update.triangles = cleaned.triangles.size();
  update.blocks_asked = asked_blocks.size();
  update.blocks_unknown = static_cast<std::size_t>(
      std::count_if(scene->flags.begin(), scene->flags.end(), [](std::uint8_t f) { return (f & kBlockUnknown) != 0; }));
  state_->surface = surface;
  state_->surface_std = std::move(surface_std);
  state_->chunks = std::move(chunks);
  state_->scene = std::move(scene);
  return update;
}

}  // namespace motion_planning
