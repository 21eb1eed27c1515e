// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/mesh_extractor.h"

#include <algorithm>
#include <cstring>
#include <iterator>
#include <optional>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include <interactive_mapping_common/threads/parallel_for.h>
#include "marching_cubes.h"
#include "mesh_lattice.h"

namespace gpis_mapping {
namespace {

using interactive_mapping::parallelFor;
using interactive_mapping::resolveThreadCount;

/// A vertex on the border of cells: the cell whose lower faces it lies on, and where on its lattice [voxels]. Pieces
/// compute such vertices from the same numbers in the same way, so equality is exact.
struct BorderVertex {
  LatticeKey cell;
  std::array<float, 3> corner;
  bool operator==(const BorderVertex& other) const { return cell == other.cell && corner == other.corner; }
};

struct BorderVertexHash {
  std::size_t operator()(const BorderVertex& v) const {
    std::int32_t bits[3];
    std::memcpy(bits, v.corner.data(), sizeof(bits));
    return LatticeKeyHash()(v.cell) * 31 + LatticeKeyHash()({bits[0], bits[1], bits[2]});
  }
};

/// None for a vertex inside the cell.
std::optional<BorderVertex> borderVertex(LatticeKey cell, std::array<float, 3> corner, int voxels) {
  bool on_border = false;
  const auto look = [&](std::int32_t* index, float* c) {
    if (*c == static_cast<float>(voxels)) {  // the next cell's lower face
      *c = 0.0f;
      ++*index;
    }
    on_border = on_border || *c == 0.0f;
  };
  look(&cell.x, &corner[0]);
  look(&cell.y, &corner[1]);
  look(&cell.z, &corner[2]);
  if (!on_border) return std::nullopt;
  return BorderVertex{cell, corner};
}

}  // namespace

struct MeshExtractor::Piece {
  std::shared_ptr<const CellGp> gp;  // the state it was extracted from
  CellField field;
  Contour contour;
  std::vector<Eigen::Vector3d> vertices_map;
  std::vector<float> variance_m2;
};

struct MeshExtractor::Pieces : std::unordered_map<LatticeKey, Piece, LatticeKeyHash> {};

MeshExtractor::MeshExtractor(const GpisConfig& config) : config_(config), pieces_(std::make_unique<Pieces>()) {
  requireValid(config_);
  lattice_ = std::make_unique<const MeshLattice>(config_);
}

MeshExtractor::~MeshExtractor() = default;

std::size_t MeshExtractor::numPieces() const {
  return pieces_->size();
}

std::size_t MeshExtractor::update(const MapSnapshot& snapshot) {
  struct Trained {
    LatticeKey key;
    Piece* piece;
    CellField field;
  };
  std::vector<Trained> trained;
  for (const auto& [key, gp] : snapshot.cells()) {
    Piece& piece = (*pieces_)[key];
    if (piece.gp == gp) continue;
    piece.gp = gp;
    trained.push_back({key, &piece, {}});
  }
  const int threads = resolveThreadCount(config_.threads);
  try {
    parallelFor(trained.size(), threads, 16, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) trained[i].field = lattice_->evaluate(*trained[i].piece->gp);
    });
    std::unordered_set<LatticeKey, LatticeKeyHash> stale;
    const auto touch = [&](const LatticeKey& key, const CellField& before, const CellField& now) {
      for (int d = 0; d < 27; ++d) {
        const int dx = d % 3 - 1, dy = d / 3 % 3 - 1, dz = d / 9 - 1;
        if (lattice_->differ(before, now, dx, dy, dz)) stale.insert(key.offset(dx, dy, dz));
      }
    };
    for (Trained& cell : trained) {
      touch(cell.key, cell.piece->field, cell.field);
      stale.insert(cell.key);  // for the variance
      cell.piece->field = std::move(cell.field);
    }
    for (auto piece = pieces_->begin(); piece != pieces_->end();) {
      const bool is_gone = snapshot.cells().get(piece->first) == nullptr;
      if (is_gone) touch(piece->first, piece->second.field, {});
      piece = is_gone ? pieces_->erase(piece) : std::next(piece);
    }
    std::vector<std::pair<LatticeKey, Piece*>> jobs;
    for (const LatticeKey& key : stale) {
      const auto piece = pieces_->find(key);
      if (piece != pieces_->end()) jobs.emplace_back(key, &piece->second);
    }
    parallelFor(jobs.size(), threads, 16, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) extract(jobs[i].first, jobs[i].second);
    });
    return jobs.size();
  } catch (...) {
    pieces_->clear();  // some are half done: all anew the next time
    throw;
  }
}

void MeshExtractor::extract(const LatticeKey& key, Piece* piece) const {
  piece->contour = {};
  piece->vertices_map.clear();
  piece->variance_m2.clear();
  if (piece->field.supported.empty()) return;
  std::array<const CellField*, 27> around{};
  for (std::size_t d = 0; d < around.size(); ++d) {
    const int i = static_cast<int>(d);
    const auto found = pieces_->find(key.offset(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1));
    if (found != pieces_->end()) around[d] = &found->second.field;
  }
  std::vector<float> values = lattice_->blend(around);
  const std::vector<std::uint8_t> wanted = lattice_->trim(*piece->gp, values, piece->field.supported);
  piece->contour = contourOf(std::move(values), wanted, lattice_->voxels());
  Contour& contour = piece->contour;
  if (contour.triangles.empty()) return;
  Points3d points(3, static_cast<Eigen::Index>(contour.vertices.size()));
  for (std::size_t i = 0; i < contour.vertices.size(); ++i) {
    piece->vertices_map.push_back(lattice_->pointAt(key, contour.vertices[i]));
    points.col(static_cast<Eigen::Index>(i)) = piece->vertices_map.back();
  }
  Eigen::VectorXf variance;
  piece->gp->variance(points, &variance, nullptr);
  piece->variance_m2.assign(variance.data(), variance.data() + variance.size());
  // The table orders triangles so that their normal points to larger values where it does at all; make sure of it.
  for (std::array<std::uint32_t, 3>& t : contour.triangles) {
    const Eigen::Vector3d n = (piece->vertices_map[t[1]] - piece->vertices_map[t[0]])
                                  .cross(piece->vertices_map[t[2]] - piece->vertices_map[t[0]]);
    const Eigen::Vector3f outward = contour.normals[t[0]] + contour.normals[t[1]] + contour.normals[t[2]];
    if (n.dot(outward.cast<double>()) < 0.0) std::swap(t[1], t[2]);
  }
}

TriangleMesh MeshExtractor::mesh(const Eigen::AlignedBox3d& box_map) const {
  std::vector<LatticeKey> keys;
  std::size_t num_vertices = 0;
  std::size_t num_triangles = 0;
  for (const auto& [key, piece] : *pieces_) {
    if (piece.contour.triangles.empty() || !config_.cells.box(key).intersects(box_map)) continue;
    keys.push_back(key);
    num_vertices += piece.vertices_map.size();
    num_triangles += piece.contour.triangles.size();
  }
  std::sort(keys.begin(), keys.end());  // the same map gives the same file
  TriangleMesh mesh;
  mesh.vertices_map.reserve(num_vertices);
  mesh.normals_map.reserve(num_vertices);
  mesh.variance_m2.reserve(num_vertices);
  mesh.triangles.reserve(num_triangles);
  // Vertices on a border belong to up to four pieces; those inside to one.
  std::unordered_map<BorderVertex, std::uint32_t, BorderVertexHash> border;
  border.reserve(num_vertices / 2);  // more than there are; growing costs more than all else here
  std::vector<std::uint32_t> index;
  for (const LatticeKey& key : keys) {
    const Piece& piece = pieces_->at(key);
    index.resize(piece.vertices_map.size());
    for (std::size_t i = 0; i < index.size(); ++i) {
      index[i] = static_cast<std::uint32_t>(mesh.vertices_map.size());
      const auto shared = borderVertex(key, piece.contour.vertices[i], lattice_->voxels());
      if (shared) {
        const auto [entry, is_new] = border.emplace(*shared, index[i]);
        index[i] = entry->second;
        if (!is_new) continue;
      }
      mesh.vertices_map.push_back(piece.vertices_map[i]);
      mesh.normals_map.push_back(piece.contour.normals[i]);
      mesh.variance_m2.push_back(piece.variance_m2[i]);
    }
    for (const std::array<std::uint32_t, 3>& t : piece.contour.triangles) {
      mesh.triangles.push_back({index[t[0]], index[t[1]], index[t[2]]});
    }
  }
  return mesh;
}

}  // namespace gpis_mapping
