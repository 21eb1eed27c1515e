// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/mesh_extractor.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>
#include <unordered_map>

#include <vtkCellArray.h>
#include <vtkFloatArray.h>
#include <vtkFlyingEdges3D.h>
#include <vtkIdList.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkSMPTools.h>

#include <interactive_mapping_common/threads/parallel_for.h>

namespace gpis_mapping {
namespace {

using interactive_mapping::parallelFor;
using interactive_mapping::resolveThreadCount;

/// Lattice coordinates of a vertex [voxels]; pieces compute the vertices on their common border from the same numbers
/// in the same way, so equality is exact.
struct VertexKey {
  float x, y, z;
  bool operator==(const VertexKey& other) const { return x == other.x && y == other.y && z == other.z; }
};

struct VertexKeyHash {
  std::size_t operator()(const VertexKey& key) const {
    std::int32_t bits[3];
    std::memcpy(bits, &key, sizeof(bits));
    return LatticeKeyHash()({bits[0], bits[1], bits[2]});
  }
};

/// Of the 27 cells about one and with it, a bit each: 9 (dx + 1) + 3 (dy + 1) + (dz + 1).
using Neighbours = std::uint32_t;
constexpr Neighbours kNobody = 0;

constexpr Neighbours neighbour(int dx, int dy, int dz) {
  return Neighbours{1} << (9 * (dx + 1) + 3 * (dy + 1) + dz + 1);
}

/// The nine that are `offset` cells off along an axis.
constexpr Neighbours layer(int axis, int offset) {
  return axis == 0   ? Neighbours{0777} << 9 * (offset + 1)
         : axis == 1 ? Neighbours{07007007} << 3 * (offset + 1)
                     : Neighbours{0111111111} << (offset + 1);
}

/// Where in a cell's lattice f is not what it was, because cells have changed that have a say there.
class ChangedField {
 public:
  ChangedField(const GpisConfig& config, Neighbours changed)
      : changed_(changed),
        last_(config.mesh.voxels_per_cell),
        // Rounding must not hide a cell that has a say; one that has none costs time only.
        band_((config.cells.blend_margin_m + 1e-6) / config.cells.size_m * last_) {}

  bool isWhole() const { return (changed_ & neighbour(0, 0, 0)) != 0; }
  /// In voxels from the cell's lower corner.
  bool covers(double x, double y, double z) const { return (changed_ & along(0, x) & along(1, y) & along(2, z)) != 0; }

 private:
  /// The neighbours that have a say at a coordinate.
  Neighbours along(int axis, double c) const {
    return layer(axis, 0) | (c <= band_ ? layer(axis, -1) : kNobody) | (last_ - c <= band_ ? layer(axis, 1) : kNobody);
  }

  Neighbours changed_;
  double last_;  // voxels of a cell
  double band_;  // of the blend with the next cell [voxels]
};

}  // namespace

struct MeshExtractor::Piece {
  std::shared_ptr<const CellGp> gp;  // the state it was extracted from; null for a cell without one
  std::vector<float> corners;        // f at the corners of supported voxels, x fastest [m]; NaN: no answer there
  std::vector<VertexKey> lattice;    // relative to the cell's first voxel [voxels]
  std::vector<Eigen::Vector3d> vertices_map;
  std::vector<Eigen::Vector3f> normals_map;
  std::vector<float> variance_m2;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

struct MeshExtractor::Pieces : std::unordered_map<LatticeKey, Piece, LatticeKeyHash> {};

/// VTK's pipeline for the lattice of one cell: setting it up costs more than running it.
class MeshExtractor::Contour {
 public:
  explicit Contour(int corners) {
    image_->SetDimensions(corners, corners, corners);
    image_->AllocateScalars(VTK_FLOAT, 1);
    filter_->SetInputData(image_.Get());  // VTK 7 has no conversion
    filter_->SetValue(0, 0.0);
    filter_->ComputeNormalsOff();
    filter_->ComputeScalarsOff();
  }
  /// Of the corners, x fastest.
  float* values() { return static_cast<float*>(image_->GetScalarPointer()); }
  /// Where they are zero [voxels]; valid until the next call.
  vtkPolyData* surface() {
    image_->GetPointData()->GetScalars()->Modified();
    image_->Modified();
    filter_->Update();
    return filter_->GetOutput();
  }
  vtkIdList* ids() { return ids_.Get(); }

 private:
  vtkNew<vtkImageData> image_;
  vtkNew<vtkFlyingEdges3D> filter_;
  vtkNew<vtkIdList> ids_;
};

MeshExtractor::MeshExtractor(const GpisConfig& config) : config_(config), pieces_(std::make_unique<Pieces>()) {
  requireValid(config_);
  // For the whole process: VTK's own threads have nothing to do in lattices this small but wait for each other.
  static std::once_flag is_serial;
  std::call_once(is_serial, [] { vtkSMPTools::Initialize(1); });
}

MeshExtractor::~MeshExtractor() = default;

std::size_t MeshExtractor::numPieces() const {
  return pieces_->size();
}

std::size_t MeshExtractor::update(const MapSnapshot& snapshot) {
  // f near a cell's border depends on its neighbours: a change reaches the 26 pieces around it, as far as the blend.
  std::unordered_map<LatticeKey, Neighbours, LatticeKeyHash> stale;
  const auto touch = [&stale](const LatticeKey& key) {
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dz = -1; dz <= 1; ++dz) stale[key.offset(dx, dy, dz)] |= neighbour(-dx, -dy, -dz);
      }
    }
  };
  for (const auto& [key, cell] : snapshot.cells()) {
    const auto piece = pieces_->find(key);
    if (piece == pieces_->end() || piece->second.gp != cell) touch(key);
  }
  for (const auto& [key, piece] : *pieces_) {
    if (piece.gp && snapshot.cells().count(key) == 0) touch(key);
  }
  struct Job {
    LatticeKey key;
    Neighbours changed;
    Piece* piece;
  };
  std::vector<Job> jobs;
  for (const auto& [key, changed] : stale) {
    const auto cell = snapshot.cells().find(key);
    if (cell == snapshot.cells().end()) {
      pieces_->erase(key);
      continue;
    }
    Piece& piece = (*pieces_)[key];
    piece.gp = cell->second;
    jobs.push_back({key, changed, &piece});
  }
  try {
    parallelFor(jobs.size(), resolveThreadCount(config_.threads), 32, [&](std::size_t begin, std::size_t end) {
      Contour contour(config_.mesh.voxels_per_cell + 1);
      for (std::size_t i = begin; i < end; ++i) {
        extract(snapshot, jobs[i].key, jobs[i].changed, &contour, jobs[i].piece);
      }
    });
  } catch (...) {
    pieces_->clear();  // some are half done: all anew the next time
    throw;
  }
  return jobs.size();
}

void MeshExtractor::extract(const MapSnapshot& snapshot, const LatticeKey& key, std::uint32_t changed_cells,
                            Contour* contour, Piece* piece) const {
  const ChangedField changed(config_, changed_cells);
  Piece before = std::move(*piece);
  *piece = Piece{};
  piece->gp = before.gp;
  const int voxels = config_.mesh.voxels_per_cell;
  const int corners = voxels + 1;
  const double edge = config_.cells.size_m / voxels;
  const Eigen::Vector3d origin = config_.cells.corner(key);
  // Points of the cell's lattice by whole steps from the map's origin, so that neighbouring pieces evaluate f at the very
  // same points of their common border.
  const auto pointAt = [&key, voxels, edge](double x, double y, double z) -> Eigen::Vector3d {
    return edge * (voxels * (Eigen::Vector3d(key.x, key.y, key.z).array() - 0.5) + Eigen::Array3d(x, y, z)).matrix();
  };
  const CellGp& gp = *piece->gp;

  // Voxels that a training point (of this cell or its margin) supports.
  const auto voxelIndex = [voxels](int x, int y, int z) { return (z * voxels + y) * voxels + x; };
  std::vector<std::uint8_t> supported(static_cast<std::size_t>(voxels) * voxels * voxels, 0);
  const double reach = config_.mesh.support_spacings * config_.surface.spacing_m / edge;  // [voxels]
  // Off the point's tangent plane by more than this (a voxel's diagonal and what a surface bends within the reach)
  // the voxel cannot hold this point's surface: most of the work is saved, and no second sheet can be meshed there.
  const double thickness = 0.9 + 0.25 * reach;  // [voxels]
  bool any = false;
  for (std::size_t i = 0; i < gp.size(); ++i) {
    const Eigen::Vector3d p = (gp.position(i) - origin) / edge - Eigen::Vector3d::Constant(0.5);
    const Eigen::Vector3d n = gp.normal(i).cast<double>();
    int low[3], high[3];
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::max(0, static_cast<int>(std::ceil(p[axis] - reach)));
      high[axis] = std::min(voxels - 1, static_cast<int>(std::floor(p[axis] + reach)));
    }
    for (int z = low[2]; z <= high[2]; ++z) {
      for (int y = low[1]; y <= high[1]; ++y) {
        for (int x = low[0]; x <= high[0]; ++x) {
          const Eigen::Vector3d offset = Eigen::Vector3d(x, y, z) - p;
          if (offset.squaredNorm() > reach * reach || std::abs(offset.dot(n)) > thickness) continue;
          supported[voxelIndex(x, y, z)] = 1;
          any = true;
        }
      }
    }
  }
  if (!any) return;

  float* values = contour->values();
  std::size_t num_needed = 0;
  bool above = false;
  bool below = false;
  std::vector<std::uint8_t> valid(static_cast<std::size_t>(corners) * corners * corners, 0);
  for (int z = 0; z < corners; ++z) {
    for (int y = 0; y < corners; ++y) {
      for (int x = 0; x < corners; ++x) {
        const std::size_t index = (static_cast<std::size_t>(z) * corners + y) * corners + x;
        values[index] = 1.0f;  // unsupported corners: their voxels are dropped below
        bool needed = false;
        for (int corner = 0; corner < 8 && !needed; ++corner) {
          const int vx = x - (corner & 1), vy = y - (corner >> 1 & 1), vz = z - (corner >> 2);
          needed = vx >= 0 && vy >= 0 && vz >= 0 && vx < voxels && vy < voxels && vz < voxels &&
                   supported[voxelIndex(vx, vy, vz)];
        }
        if (!needed) continue;
        // The same corners are needed as long as the cell is the same.
        const bool is_known = !changed.isWhole() && !changed.covers(x, y, z);
        float value = is_known ? before.corners.at(num_needed) : 0.0f;
        ++num_needed;
        if (!is_known) value = static_cast<float>(snapshot.fieldValue(pointAt(x, y, z)));
        piece->corners.push_back(value);
        if (std::isnan(value)) continue;
        valid[index] = 1;
        // An exact zero makes degenerate triangles.
        values[index] = std::abs(value) < 1e-7f ? 1e-7f : value;
        above = above || values[index] > 0.0f;
        below = below || values[index] <= 0.0f;
      }
    }
  }
  if (!above || !below) return;

  vtkPolyData* surface = contour->surface();
  std::vector<std::uint32_t> kept(static_cast<std::size_t>(surface->GetNumberOfPoints()), UINT32_MAX);
  vtkIdList* ids = contour->ids();
  vtkCellArray* polygons = surface->GetPolys();
  polygons->InitTraversal();
  while (polygons->GetNextCell(ids)) {
    double corner[3][3];
    double center[3] = {0.0, 0.0, 0.0};
    for (int i = 0; i < 3; ++i) {
      surface->GetPoint(ids->GetId(i), corner[i]);
      for (int axis = 0; axis < 3; ++axis) center[axis] += corner[i][axis] / 3.0;
    }
    const auto voxelOf = [voxels](double c) { return std::max(0, std::min(voxels - 1, static_cast<int>(c))); };
    const int vx = voxelOf(center[0]), vy = voxelOf(center[1]), vz = voxelOf(center[2]);
    if (!supported[voxelIndex(vx, vy, vz)]) continue;
    bool complete = true;
    for (int i = 0; i < 8; ++i) {
      const std::size_t index =
          (static_cast<std::size_t>(vz + (i >> 2)) * corners + vy + (i >> 1 & 1)) * corners + vx + (i & 1);
      complete = complete && valid[index];
    }
    if (!complete) continue;
    std::array<std::uint32_t, 3> triangle;
    for (int i = 0; i < 3; ++i) {
      std::uint32_t& vertex = kept[static_cast<std::size_t>(ids->GetId(i))];
      if (vertex == UINT32_MAX) {
        vertex = static_cast<std::uint32_t>(piece->lattice.size());
        piece->lattice.push_back(
            {static_cast<float>(corner[i][0]), static_cast<float>(corner[i][1]), static_cast<float>(corner[i][2])});
      }
      triangle[static_cast<std::size_t>(i)] = vertex;
    }
    piece->triangles.push_back(triangle);
  }
  if (piece->triangles.empty()) return;

  // A vertex that was there, with the field about it as it was, keeps its normal and variance.
  std::unordered_map<VertexKey, std::size_t, VertexKeyHash> known;
  if (!changed.isWhole()) {
    for (std::size_t i = 0; i < before.lattice.size(); ++i) {
      const VertexKey& v = before.lattice[i];
      if (!changed.covers(v.x, v.y, v.z)) known.emplace(v, i);
    }
  }
  std::vector<std::size_t> unknown;
  Points3d points(3, static_cast<Eigen::Index>(piece->lattice.size()));
  piece->vertices_map.reserve(piece->lattice.size());
  piece->normals_map.reserve(piece->lattice.size());
  piece->variance_m2.reserve(piece->lattice.size());
  for (std::size_t i = 0; i < piece->lattice.size(); ++i) {
    const VertexKey& v = piece->lattice[i];
    const auto same = known.find(v);
    if (same != known.end()) {
      piece->vertices_map.push_back(before.vertices_map[same->second]);
      piece->normals_map.push_back(before.normals_map[same->second]);
      piece->variance_m2.push_back(before.variance_m2[same->second]);
      continue;
    }
    const Eigen::Vector3d p = pointAt(v.x, v.y, v.z);
    piece->vertices_map.push_back(p);
    points.col(static_cast<Eigen::Index>(unknown.size())) = p;
    unknown.push_back(i);
    const FieldSample f = snapshot.field(p);
    const Eigen::Vector3d normal = f.valid ? Eigen::Vector3d(f.gradient.normalized()) : Eigen::Vector3d::UnitZ();
    piece->normals_map.push_back(normal.cast<float>());
    piece->variance_m2.push_back(std::numeric_limits<float>::quiet_NaN());  // below, all at once
  }
  Eigen::VectorXf variance;
  gp.variance(points.leftCols(static_cast<Eigen::Index>(unknown.size())), &variance, nullptr);
  for (std::size_t i = 0; i < unknown.size(); ++i) {
    piece->variance_m2[unknown[i]] = variance[static_cast<Eigen::Index>(i)];
  }
  // VTK orders triangles so that their normal points to larger values where it does at all; make sure of it.
  for (std::array<std::uint32_t, 3>& t : piece->triangles) {
    const Eigen::Vector3d n = (piece->vertices_map[t[1]] - piece->vertices_map[t[0]])
                                  .cross(piece->vertices_map[t[2]] - piece->vertices_map[t[0]]);
    const Eigen::Vector3f outward = piece->normals_map[t[0]] + piece->normals_map[t[1]] + piece->normals_map[t[2]];
    if (n.dot(outward.cast<double>()) < 0.0) std::swap(t[1], t[2]);
  }
}

TriangleMesh MeshExtractor::mesh() const {
  std::vector<LatticeKey> keys;
  std::size_t num_vertices = 0;
  std::size_t num_triangles = 0;
  for (const auto& [key, piece] : *pieces_) {
    if (piece.triangles.empty()) continue;
    keys.push_back(key);
    num_vertices += piece.lattice.size();
    num_triangles += piece.triangles.size();
  }
  std::sort(keys.begin(), keys.end());  // the same map gives the same file
  TriangleMesh mesh;
  mesh.vertices_map.reserve(num_vertices);
  mesh.normals_map.reserve(num_vertices);
  mesh.variance_m2.reserve(num_vertices);
  mesh.triangles.reserve(num_triangles);
  const int voxels = config_.mesh.voxels_per_cell;
  // Vertices on a border belong to up to four pieces; those inside to one.
  struct BorderKey {
    LatticeKey cell;
    VertexKey offset;
    bool operator==(const BorderKey& other) const { return cell == other.cell && offset == other.offset; }
  };
  struct BorderHash {
    std::size_t operator()(const BorderKey& k) const {
      return LatticeKeyHash()(k.cell) * 31 + VertexKeyHash()(k.offset);
    }
  };
  std::unordered_map<BorderKey, std::uint32_t, BorderHash> border;
  border.reserve(num_vertices / 2);  // more than there are; growing costs more than all else here
  std::vector<std::uint32_t> index;
  for (const LatticeKey& key : keys) {
    const Piece& piece = pieces_->at(key);
    index.resize(piece.lattice.size());
    for (std::size_t i = 0; i < piece.lattice.size(); ++i) {
      VertexKey v = piece.lattice[i];
      LatticeKey cell = key;
      bool on_border = v.x == 0.0f || v.y == 0.0f || v.z == 0.0f;
      // A vertex on the upper face is the next piece's lower face.
      const float last = static_cast<float>(voxels);
      if (v.x == last) {
        v.x = 0.0f;
        ++cell.x;
        on_border = true;
      }
      if (v.y == last) {
        v.y = 0.0f;
        ++cell.y;
        on_border = true;
      }
      if (v.z == last) {
        v.z = 0.0f;
        ++cell.z;
        on_border = true;
      }
      if (on_border) {
        const auto [entry, is_new] =
            border.emplace(BorderKey{cell, v}, static_cast<std::uint32_t>(mesh.vertices_map.size()));
        index[i] = entry->second;
        if (!is_new) continue;
      } else {
        index[i] = static_cast<std::uint32_t>(mesh.vertices_map.size());
      }
      mesh.vertices_map.push_back(piece.vertices_map[i]);
      mesh.normals_map.push_back(piece.normals_map[i]);
      mesh.variance_m2.push_back(piece.variance_m2[i]);
    }
    for (const std::array<std::uint32_t, 3>& t : piece.triangles) {
      mesh.triangles.push_back({index[t[0]], index[t[1]], index[t[2]]});
    }
  }
  return mesh;
}

}  // namespace gpis_mapping
