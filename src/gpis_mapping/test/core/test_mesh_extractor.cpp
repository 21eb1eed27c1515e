// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/mesh_extractor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "../../src/core/mesh_lattice.h"
#include "analytic_surfaces.h"
#include "gpis_mapping/gpis_map.h"

namespace gpis_mapping {
namespace {

using gpis_mapping_test::buildCells;
using gpis_mapping_test::CellTable;
using gpis_mapping_test::pagesOf;
using gpis_mapping_test::sampleBox;
using gpis_mapping_test::sampleSphere;

using Edge = std::pair<std::uint32_t, std::uint32_t>;

TriangleMesh meshOf(const MapSnapshot& snapshot) {
  MeshExtractor extractor(snapshot.config());
  extractor.update(snapshot);
  return extractor.mesh();
}

std::shared_ptr<const MapSnapshot> mapOf(const std::vector<SurfacePoint>& points) {
  MapContents contents;
  contents.config.threads = 2;
  contents.points = points;
  return GpisMap(contents).snapshot();
}

/// How often each undirected edge occurs; every directed one may occur once only.
std::map<Edge, int> countEdges(const TriangleMesh& mesh) {
  std::map<Edge, int> undirected;
  std::set<Edge> directed;
  for (const auto& t : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t a = t[i];
      const std::uint32_t b = t[(i + 1) % 3];
      EXPECT_NE(a, b) << "degenerate triangle";
      EXPECT_TRUE(directed.insert({a, b}).second) << "two triangles run along one edge in the same direction";
      ++undirected[std::minmax(a, b)];
    }
  }
  return undirected;
}

/// What must hold for any mesh.
void expectWellFormed(const TriangleMesh& mesh) {
  ASSERT_EQ(mesh.normals_map.size(), mesh.vertices_map.size());
  ASSERT_EQ(mesh.variance_m2.size(), mesh.vertices_map.size());
  std::vector<bool> used(mesh.vertices_map.size(), false);
  for (const auto& t : mesh.triangles) {
    for (const std::uint32_t i : t) {
      ASSERT_LT(i, mesh.vertices_map.size());
      used[i] = true;
    }
    const Eigen::Vector3d a = mesh.vertices_map[t[0]];
    const Eigen::Vector3d n = (mesh.vertices_map[t[1]] - a).cross(mesh.vertices_map[t[2]] - a);
    const Eigen::Vector3d shading =
        (mesh.normals_map[t[0]] + mesh.normals_map[t[1]] + mesh.normals_map[t[2]]).cast<double>();
    EXPECT_GE(n.dot(shading), 0.0) << "triangle turned inside out";
  }
  EXPECT_TRUE(std::all_of(used.begin(), used.end(), [](bool b) { return b; })) << "vertices without a triangle";
  const float prior = static_cast<float>(std::pow(GpisConfig().signalStd(), 2));
  std::map<std::array<long, 3>, int> at;
  for (std::size_t i = 0; i < mesh.vertices_map.size(); ++i) {
    ASSERT_TRUE(mesh.vertices_map[i].allFinite());
    EXPECT_NEAR(mesh.normals_map[i].norm(), 1.0f, 1e-5f);
    EXPECT_GE(mesh.variance_m2[i], 0.0f);
    EXPECT_LE(mesh.variance_m2[i], prior * 1.0001f);
    const Eigen::Vector3d q = mesh.vertices_map[i] / 1e-9;  // equal to a nanometre: the same vertex twice
    const int count = ++at[{std::lround(q.x()), std::lround(q.y()), std::lround(q.z())}];
    EXPECT_EQ(count, 1) << "duplicate vertex at " << mesh.vertices_map[i].transpose();
  }
}

/// Triangles as sorted vertex positions, each starting at its smallest vertex: equal sets are equal meshes.
std::set<std::array<double, 9>> triangleSet(const TriangleMesh& mesh) {
  std::set<std::array<double, 9>> result;
  for (const auto& t : mesh.triangles) {
    std::array<std::array<double, 3>, 3> p;
    for (std::size_t i = 0; i < 3; ++i) {
      const Eigen::Vector3d& v = mesh.vertices_map[t[i]];
      p[i] = {v.x(), v.y(), v.z()};
    }
    std::rotate(p.begin(), std::min_element(p.begin(), p.end()), p.end());
    result.insert({p[0][0], p[0][1], p[0][2], p[1][0], p[1][1], p[1][2], p[2][0], p[2][1], p[2][2]});
  }
  return result;
}

/// Normal and variance at each vertex, by its position.
std::map<std::array<double, 3>, std::pair<Eigen::Vector3f, float>> attributes(const TriangleMesh& mesh) {
  std::map<std::array<double, 3>, std::pair<Eigen::Vector3f, float>> result;
  for (std::size_t i = 0; i < mesh.vertices_map.size(); ++i) {
    const Eigen::Vector3d& v = mesh.vertices_map[i];
    result[{v.x(), v.y(), v.z()}] = {mesh.normals_map[i], mesh.variance_m2[i]};
  }
  return result;
}

/// The same triangles, normals and variances.
void expectEqualMeshes(const TriangleMesh& a, const TriangleMesh& b) {
  ASSERT_TRUE(triangleSet(a) == triangleSet(b));
  const auto of_a = attributes(a);
  const auto of_b = attributes(b);
  for (const auto& [position, at_a] : of_a) {
    const auto& at_b = of_b.at(position);
    ASSERT_EQ(at_a.first, at_b.first);
    ASSERT_NEAR(at_a.second, at_b.second, 1e-4f * at_b.second + 1e-12f);  // solved together with others: rounding
  }
}

int eulerCharacteristic(const TriangleMesh& mesh, const std::map<Edge, int>& edges) {
  return static_cast<int>(mesh.vertices_map.size()) - static_cast<int>(edges.size()) +
         static_cast<int>(mesh.triangles.size());
}

TEST(MeshExtractor, SphereIsClosedWithEulerCharacteristicTwo) {
  // Off the lattice and across zero, so that all octants and many cell borders take part.
  const Eigen::Vector3d center(0.013, -0.021, 0.007);
  const double radius = 0.15;
  const TriangleMesh mesh = meshOf(*mapOf(sampleSphere(center, radius, 0.02)));
  expectWellFormed(mesh);
  ASSERT_GT(mesh.triangles.size(), 1000u);
  const std::map<Edge, int> edges = countEdges(mesh);
  for (const auto& [edge, count] : edges) {
    EXPECT_EQ(count, 2) << "open edge at " << mesh.vertices_map[edge.first].transpose();
  }
  EXPECT_EQ(eulerCharacteristic(mesh, edges), 2);
  double area = 0.0;
  double worst = 0.0;
  for (const auto& t : mesh.triangles) {
    const Eigen::Vector3d a = mesh.vertices_map[t[0]];
    const Eigen::Vector3d n = (mesh.vertices_map[t[1]] - a).cross(mesh.vertices_map[t[2]] - a);
    area += 0.5 * n.norm();
    EXPECT_GT(n.dot(a - center), -1e-9) << "triangle faces inwards";  // slivers have an area of rounding only
  }
  for (std::size_t i = 0; i < mesh.vertices_map.size(); ++i) {
    const Eigen::Vector3d out = mesh.vertices_map[i] - center;
    worst = std::max(worst, std::abs(out.norm() - radius));
    // Vertex normals are the field's gradient: points 2 cm apart on a sphere of 15 cm turn by 7.6 degrees.
    EXPECT_GT(mesh.normals_map[i].cast<double>().dot(out.normalized()), std::cos(0.07));
    EXPECT_LT(std::sqrt(mesh.variance_m2[i]), 0.01f);  // data within 1.4 cm everywhere
  }
  // The field is within 0.5 mm of the sphere at the surface (map snapshot test), linear interpolation along a voxel edge
  // of 14 mm adds e^2 / (8 r) = 0.17 mm.
  EXPECT_LT(worst, 0.0007);
  EXPECT_NEAR(area, 4.0 * M_PI * radius * radius, 0.01 * area);
}

TEST(MeshExtractor, ClosedBoxHasNoCracksAndNoSecondSheet) {
  const Eigen::Vector3d low(-0.093, -0.112, 0.017);
  const Eigen::Vector3d high(0.127, 0.098, 0.187);
  const TriangleMesh mesh = meshOf(*mapOf(sampleBox(low, high, 0.02, true)));
  expectWellFormed(mesh);
  const std::map<Edge, int> edges = countEdges(mesh);
  for (const auto& [edge, count] : edges) {
    EXPECT_EQ(count, 2) << "open edge at " << mesh.vertices_map[edge.first].transpose();
  }
  EXPECT_EQ(eulerCharacteristic(mesh, edges), 2);
  for (const Eigen::Vector3d& v : mesh.vertices_map) {
    // Edges and corners are rounded at the scale of the spacing; a second sheet would be 4 cm deep.
    EXPECT_GT(gpis_mapping_test::boxDistance(low, high, v), -0.012) << v.transpose();
    EXPECT_LT(gpis_mapping_test::boxDistance(low, high, v), 0.004) << v.transpose();
  }
}

TEST(MeshExtractor, OpenBoxIsOpenAtItsTrueBorderOnly) {
  const Eigen::Vector3d low(-0.093, -0.112, 0.017);
  const Eigen::Vector3d high(0.127, 0.098, 0.187);
  const TriangleMesh mesh = meshOf(*mapOf(sampleBox(low, high, 0.02, false)));
  expectWellFormed(mesh);
  const std::map<Edge, int> edges = countEdges(mesh);
  std::map<std::uint32_t, int> open_at;
  for (const auto& [edge, count] : edges) {
    if (count == 2) continue;
    ASSERT_EQ(count, 1);
    ++open_at[edge.first];
    ++open_at[edge.second];
    for (const std::uint32_t i : {edge.first, edge.second}) {
      // The lowest points are 1 cm above the rim; voxels (14 mm) are meshed up to 25 mm from a point.
      EXPECT_NEAR(mesh.vertices_map[i].z(), low.z() - 0.01, 0.028) << "crack at " << mesh.vertices_map[i].transpose();
    }
  }
  EXPECT_GT(open_at.size(), 20u);
  for (const auto& entry : open_at) EXPECT_EQ(entry.second, 2) << "the border is not a simple loop";
  EXPECT_EQ(eulerCharacteristic(mesh, edges), 1);  // a disc: one border, no crack
}

TEST(MeshExtractor, MeshesOnlyNearPoints) {
  std::vector<SurfacePoint> points;
  gpis_mapping_test::sampleRectangle({0.03, 0.04, 0.052}, {0.2, 0.0, 0.0}, {0.0, 0.15, 0.0}, 0.02, 0.001, &points);
  const auto map = mapOf(points);
  const GpisConfig& config = map->config();
  const TriangleMesh mesh = meshOf(*map);
  expectWellFormed(mesh);
  ASSERT_GT(mesh.triangles.size(), 100u);
  const double voxel = config.cells.size_m / config.mesh.voxels_per_cell;
  const double reach = config.mesh.support_spacings * config.surface.spacing_m + 0.5 * std::sqrt(3.0) * voxel;
  for (std::size_t i = 0; i < mesh.vertices_map.size(); ++i) {
    double nearest = 1e9;
    for (const SurfacePoint& point : points) {
      nearest = std::min(nearest, (point.position_map - mesh.vertices_map[i]).norm());
    }
    EXPECT_LE(nearest, reach + 1e-9);
    EXPECT_NEAR(mesh.vertices_map[i].z(), 0.052, 2e-6);  // f is linear here: float rounding
    EXPECT_GT(mesh.normals_map[i].z(), 0.999f);
  }
  // And everywhere near them: the patch is covered.
  double area = 0.0;
  for (const auto& t : mesh.triangles) {
    const Eigen::Vector3d a = mesh.vertices_map[t[0]];
    area += 0.5 * (mesh.vertices_map[t[1]] - a).cross(mesh.vertices_map[t[2]] - a).norm();
  }
  EXPECT_GT(area, 0.2 * 0.15);
}

TEST(MeshExtractor, DoesNotGoOnPastTheLastPoints) {
  // Two faces of a box seen from one side: at their common edge the surface goes on, at the rest of their rims it ends.
  std::vector<SurfacePoint> points;
  const Eigen::Vector3d low(-0.113, -0.142, -0.127), high(0.127, 0.138, 0.113);
  const Eigen::Vector3d size = high - low;
  const Eigen::Vector3d x = size.x() * Eigen::Vector3d::UnitX(), y = size.y() * Eigen::Vector3d::UnitY(),
                        z = size.z() * Eigen::Vector3d::UnitZ();
  gpis_mapping_test::sampleRectangle(low + z, x, y, 0.02, 0.001, &points);
  gpis_mapping_test::sampleRectangle(low + x, y, z, 0.02, 0.001, &points);
  const TriangleMesh mesh = meshOf(*mapOf(points));
  expectWellFormed(mesh);
  // Points end 1 cm before the rims. At the last of them the mean of the half plane of points is 0.29 * 40 mm off, 8 mm
  // farther 16 mm, where voxels of 14 mm are cut: 22 mm past the points. Uncut it were 29.
  double beyond = 0.0;
  bool is_at_edge = false;
  for (const Eigen::Vector3d& v : mesh.vertices_map) {
    for (const double past : {low.x() - v.x(), low.y() - v.y(), v.y() - high.y(), low.z() - v.z()}) {
      beyond = std::max(beyond, past);
    }
    is_at_edge = is_at_edge || std::hypot(v.x() - high.x(), v.z() - high.z()) < 0.008;  // it is rounded
  }
  EXPECT_LT(beyond, 0.0125);
  EXPECT_TRUE(is_at_edge);
  // None is missing in the midst of the faces, nor along their edge.
  for (double along = low.y() + 0.02; along < high.y() - 0.02; along += 0.005) {
    for (double off = 0.0; off < 0.2; off += 0.005) {
      for (const Eigen::Vector3d& p :
           {Eigen::Vector3d(high.x() - off, along, high.z()), Eigen::Vector3d(high.x(), along, high.z() - off)}) {
        double nearest = 1.0;
        for (const Eigen::Vector3d& v : mesh.vertices_map) nearest = std::min(nearest, (v - p).norm());
        EXPECT_LT(nearest, 0.0143) << p.transpose();  // a voxel's edge
      }
    }
  }
}

TEST(MeshExtractor, VertexVarianceIsThatOfTheField) {
  const auto map = mapOf(sampleSphere({0.013, -0.021, 0.007}, 0.15, 0.02));
  const TriangleMesh mesh = meshOf(*map);
  Points3d points(3, static_cast<Eigen::Index>(mesh.vertices_map.size()));
  for (std::size_t i = 0; i < mesh.vertices_map.size(); ++i)
    points.col(static_cast<Eigen::Index>(i)) = mesh.vertices_map[i];
  const QueryResult field = map->query(points);
  const double prior = std::pow(map->config().signalStd(), 2);
  for (std::size_t i = 0; i < mesh.vertices_map.size(); ++i) {
    // The mesh takes the variance of the cell it is extracted from, unblended: neighbours know 3 cm less of each other's
    // points, 1 % of the prior.
    EXPECT_NEAR(mesh.variance_m2[i], field.variance[static_cast<Eigen::Index>(i)], 0.01 * prior);
  }
}

TEST(MeshExtractor, DoesNotDependOnTheNumberOfThreads) {
  MapContents contents;
  contents.points = sampleSphere({0.013, -0.021, 0.007}, 0.12, 0.02);
  contents.config.threads = 1;
  const auto one = GpisMap(contents).snapshot();
  contents.config.threads = 3;
  const auto three = GpisMap(contents).snapshot();
  const TriangleMesh a = meshOf(*one);
  const TriangleMesh b = meshOf(*three);
  EXPECT_EQ(a.triangles, b.triangles);
  EXPECT_TRUE(triangleSet(a) == triangleSet(b));
}

/// Cells of `points`; those whose points are all among the unchanged ones are taken over from `old`.
CellTable update(const GpisConfig& config, const CellTable& old, const std::vector<SurfacePoint>& points) {
  CellTable cells = buildCells(config, points);
  for (auto& [key, cell] : cells) {
    const auto before = old.find(key);
    if (before == old.end() || before->second->size() != cell->size()) continue;
    bool same = true;
    for (std::size_t i = 0; i < cell->size(); ++i) same = same && before->second->position(i) == cell->position(i);
    if (same) cell = before->second;
  }
  return cells;
}

std::unique_ptr<const MapSnapshot> snapshotOf(const GpisConfig& config, const CellTable& cells) {
  return std::make_unique<const MapSnapshot>(config, pagesOf(cells), ObservedLayer(0.05), 0.0, 1);
}

TEST(MeshExtractor, IncrementalUpdateEqualsExtractionFromScratch) {
  const GpisConfig config;
  std::vector<SurfacePoint> points;
  gpis_mapping_test::sampleRectangle({-0.45, -0.45, 0.004}, {0.9, 0.0, 0.0}, {0.0, 0.9, 0.0}, 0.02, 0.001, &points);
  MeshExtractor extractor(config);
  CellTable cells = buildCells(config, points);
  EXPECT_EQ(extractor.update(*snapshotOf(config, cells)), cells.size());
  EXPECT_EQ(extractor.update(*snapshotOf(config, cells)), 0u) << "nothing changed";
  const auto before = triangleSet(extractor.mesh());

  const auto check = [&](const std::string& what, bool expect_partial) {
    SCOPED_TRACE(what);
    cells = update(config, cells, points);
    const auto snapshot = snapshotOf(config, cells);
    const std::size_t extracted = extractor.update(*snapshot);
    EXPECT_GT(extracted, 0u);
    if (expect_partial) {
      EXPECT_LT(extracted, cells.size() / 2);
    }
    const TriangleMesh mesh = extractor.mesh();
    expectWellFormed(mesh);
    expectEqualMeshes(mesh, meshOf(*snapshot));
    for (const auto& entry : countEdges(mesh)) EXPECT_LE(entry.second, 2);
  };
  // One point beside a cell border moves up: the blend carries it into the neighbour's field.
  for (SurfacePoint& point : points) {
    if ((point.position_map - Eigen::Vector3d(0.2, 0.06, 0.004)).norm() < 0.012) point.position_map.z() += 0.005;
  }
  check("points moved", true);
  EXPECT_TRUE(triangleSet(extractor.mesh()) != before);

  const auto in_hole = [](const SurfacePoint& p) { return p.position_map.x() < -0.18 && p.position_map.y() < -0.18; };
  std::vector<SurfacePoint> removed;
  std::copy_if(points.begin(), points.end(), std::back_inserter(removed), in_hole);
  points.erase(std::remove_if(points.begin(), points.end(), in_hole), points.end());
  check("points removed", true);

  points.insert(points.end(), removed.begin(), removed.end());
  check("points back", true);

  const std::vector<SurfacePoint> ball = sampleSphere({0.25, 0.25, 0.4}, 0.08, 0.02);
  points.insert(points.end(), ball.begin(), ball.end());
  check("an object appears", false);
}

/// Cells that change one at a time: their neighbours' pieces are mended, again and again.
TEST(MeshExtractor, ManyIncrementalUpdatesEqualExtractionFromScratch) {
  for (const double blend_margin_m : {0.014, 0.03}) {  // one and three of the lattice's planes are blended
    SCOPED_TRACE(blend_margin_m);
    GpisConfig config;
    config.cells.blend_margin_m = blend_margin_m;
    std::vector<SurfacePoint> points = sampleSphere({0.05, 0.03, 0.02}, 0.17, 0.02);
    MeshExtractor extractor(config);
    CellTable cells = buildCells(config, points);
    extractor.update(*snapshotOf(config, cells));
    std::mt19937 random(3);
    for (int round = 0; round < 15; ++round) {
      SCOPED_TRACE(round);
      const std::size_t i = std::uniform_int_distribution<std::size_t>(0, points.size() - 1)(random);
      if (round % 5 == 4) {
        points.erase(points.begin() + static_cast<std::ptrdiff_t>(i));
      } else {
        points[i].position_map += 0.003 * points[i].normal_map.cast<double>();
      }
      cells = update(config, cells, points);
      const auto snapshot = snapshotOf(config, cells);
      ASSERT_GT(extractor.update(*snapshot), 0u);
      expectEqualMeshes(extractor.mesh(), meshOf(*snapshot));
      if (HasFatalFailure()) return;
    }
  }
}

TEST(MeshLattice, CornersHoldTheBlendedField) {
  for (const double blend_margin_m : {0.014, 0.03}) {  // one and three of the lattice's planes are blended
    SCOPED_TRACE(blend_margin_m);
    GpisConfig config;
    config.cells.blend_margin_m = blend_margin_m;
    const auto snapshot = snapshotOf(config, buildCells(config, sampleSphere({0.05, 0.03, 0.02}, 0.17, 0.02)));
    const MeshLattice lattice(config);
    std::map<LatticeKey, CellField> fields;
    for (const auto& [key, gp] : snapshot->cells()) fields[key] = lattice.evaluate(*gp);
    int compared = 0;
    for (const auto& [key, field] : fields) {
      if (field.supported.empty()) continue;
      std::array<const CellField*, 27> around{};
      for (int d = 0; d < 27; ++d) {
        const auto found = fields.find(key.offset(d % 3 - 1, d / 3 % 3 - 1, d / 9 - 1));
        if (found != fields.end()) around[static_cast<std::size_t>(d)] = &found->second;
      }
      const std::vector<float> values = lattice.blend(around);
      std::size_t voxel = 0;
      for (int z = 0; z < lattice.voxels(); ++z) {
        for (int y = 0; y < lattice.voxels(); ++y) {
          for (int x = 0; x < lattice.voxels(); ++x) {
            if (!field.supported[voxel++]) continue;
            for (int c = 0; c < 8; ++c) {
              const int cx = x + (c & 1), cy = y + (c >> 1 & 1), cz = z + (c >> 2);
              const float value =
                  values[static_cast<std::size_t>((cz * lattice.corners() + cy) * lattice.corners() + cx)];
              const FieldSample f = snapshot->field(
                  lattice.pointAt(key, {static_cast<float>(cx), static_cast<float>(cy), static_cast<float>(cz)}));
              ASSERT_EQ(std::isnan(value), !f.valid);
              // Sums in another order, as between the cell's two ways to its mean.
              if (f.valid) {
                ASSERT_NEAR(value, f.value, 2e-6)
                    << key.x << " " << key.y << " " << key.z << ": " << x << " " << y << " " << z;
              }
              ++compared;
            }
          }
        }
      }
    }
    EXPECT_GT(compared, 1000);
  }
}

TEST(MeshExtractor, OfABoxItGivesWhatLiesThereAndLittleMore) {
  const auto snapshot = mapOf(sampleSphere({0.1, -0.2, 0.3}, 0.4, 0.02));
  MeshExtractor extractor(snapshot->config());
  extractor.update(*snapshot);
  const TriangleMesh all = extractor.mesh();
  const Eigen::AlignedBox3d box{Eigen::Vector3d{-0.1, -0.7, 0.25}, Eigen::Vector3d{0.35, 0.0, 0.9}};
  const TriangleMesh part = extractor.mesh(box);
  const auto of_all = triangleSet(all), of_part = triangleSet(part);
  EXPECT_TRUE(std::includes(of_all.begin(), of_all.end(), of_part.begin(), of_part.end()));
  const double cell_m = snapshot->config().cells.size_m;
  const auto countIn = [](const TriangleMesh& mesh, const Eigen::AlignedBox3d& in) {
    return std::count_if(mesh.triangles.begin(), mesh.triangles.end(), [&](const auto& t) {
      const auto& v = mesh.vertices_map;
      return in.contains(Eigen::Vector3d((v[t[0]] + v[t[1]] + v[t[2]]) / 3.0));
    });
  };
  EXPECT_GT(countIn(part, box), 100);
  EXPECT_EQ(countIn(part, box), countIn(all, box));
  const Eigen::Vector3d cell = Eigen::Vector3d::Constant(cell_m);
  EXPECT_EQ(countIn(part, {box.min() - cell, box.max() + cell}), static_cast<long>(part.triangles.size()));
  EXPECT_TRUE(extractor.mesh({Eigen::Vector3d::Constant(5.0), Eigen::Vector3d::Constant(6.0)}).triangles.empty());
}

TEST(MeshExtractor, RemovedCellsVanish) {
  const GpisConfig config;
  const std::vector<SurfacePoint> left = sampleSphere({0.0, 0.0, 0.0}, 0.1, 0.02);
  const std::vector<SurfacePoint> right = sampleSphere({1.0, 0.0, 0.0}, 0.1, 0.02);
  std::vector<SurfacePoint> both = left;
  both.insert(both.end(), right.begin(), right.end());
  MeshExtractor extractor(config);
  const CellTable cells = buildCells(config, both);
  extractor.update(*snapshotOf(config, cells));
  const std::size_t all = extractor.mesh().triangles.size();
  const CellTable rest = update(config, cells, left);
  extractor.update(*snapshotOf(config, rest));
  const TriangleMesh mesh = extractor.mesh();
  EXPECT_GT(mesh.triangles.size(), 0u);
  EXPECT_LT(mesh.triangles.size(), all);
  for (const Eigen::Vector3d& v : mesh.vertices_map) EXPECT_LT(v.x(), 0.5);
  EXPECT_TRUE(triangleSet(mesh) == triangleSet(meshOf(*snapshotOf(config, rest))));
  extractor.update(*snapshotOf(config, {}));
  EXPECT_TRUE(extractor.mesh().triangles.empty());
  EXPECT_TRUE(extractor.mesh().vertices_map.empty());
}

TEST(MeshExtractor, EmptyAndDegenerateMapsGiveNoTriangles) {
  const GpisConfig config;
  MeshExtractor extractor(config);
  EXPECT_EQ(extractor.update(*snapshotOf(config, {})), 0u);
  EXPECT_TRUE(extractor.mesh().triangles.empty());
  // A single point is a small patch of its tangent plane, well formed.
  const auto lone =
      snapshotOf(config, buildCells(config, {gpis_mapping_test::surfacePoint({0.0, 0.0, 0.0}, {0.1, 0.2, 1.0})}));
  const TriangleMesh patch = meshOf(*lone);
  expectWellFormed(patch);
  EXPECT_GT(patch.triangles.size(), 2u);
  for (const Eigen::Vector3d& v : patch.vertices_map) {
    EXPECT_NEAR(v.dot(Eigen::Vector3d(0.1, 0.2, 1.0).normalized()), 0.0, 2e-6);  // its plane, in float
  }
}

TEST(MeshExtractor, SurfaceOnLatticePlanesIsMeshedOnce) {
  // z = 0.05 and z = -0.05 are borders between cells: f is exactly zero at the corners of both cells' voxels.
  for (const double z : {0.05, -0.05, 0.15}) {
    SCOPED_TRACE(z);
    std::vector<SurfacePoint> points;
    gpis_mapping_test::sampleRectangle({-0.15, -0.15, z}, {0.3, 0.0, 0.0}, {0.0, 0.3, 0.0}, 0.02, 0.001, &points);
    const TriangleMesh mesh = meshOf(*mapOf(points));
    double area = 0.0;
    for (const auto& t : mesh.triangles) {
      const Eigen::Vector3d a = mesh.vertices_map[t[0]];
      area += 0.5 * (mesh.vertices_map[t[1]] - a).cross(mesh.vertices_map[t[2]] - a).norm();
    }
    EXPECT_GT(area, 0.3 * 0.3 * 0.98);
    EXPECT_LT(area, 0.36 * 0.36);
    for (const auto& entry : countEdges(mesh)) EXPECT_LE(entry.second, 2);
    for (const Eigen::Vector3d& v : mesh.vertices_map) EXPECT_NEAR(v.z(), z, 2e-6);
  }
}

TEST(MeshExtractor, FloorIsOneSheetOfVertices) {
  // z = 0, and the tops of bricks of whole decimetres, run through the middle of cells and voxels: of a lattice's edges only
  // the upright ones meet them, in one layer of cells.
  for (const double z : {0.0, 0.2}) {
    SCOPED_TRACE(z);
    std::vector<SurfacePoint> points;
    gpis_mapping_test::sampleRectangle({-0.25, -0.25, z}, {0.5, 0.0, 0.0}, {0.0, 0.5, 0.0}, 0.02, 0.001, &points);
    std::mt19937 rng(11);
    std::normal_distribution<double> noise(0.0, 0.001);
    for (SurfacePoint& point : points) point.position_map.z() += noise(rng);
    const auto map = mapOf(points);
    const double edge = map->config().cells.size_m / map->config().mesh.voxels_per_cell;
    const TriangleMesh mesh = meshOf(*map);
    ASSERT_GT(mesh.triangles.size(), 2 * 30 * 30u);
    std::set<std::pair<long, long>> columns;
    for (const Eigen::Vector3d& v : mesh.vertices_map) {
      const Eigen::Vector2d column = v.head<2>() / edge - Eigen::Vector2d::Constant(0.5);
      EXPECT_NEAR((column - column.array().round().matrix()).norm(), 0.0, 1e-4) << v.transpose();  // in float
      EXPECT_TRUE(columns.emplace(std::lround(column.x()), std::lround(column.y())).second) << v.transpose();
    }
    for (const auto& entry : map->cells()) {
      if (entry.second->numOwn() == 0) continue;
      EXPECT_NEAR(map->config().cells.center(entry.first).z(), z, 1e-12);
    }
  }
}

}  // namespace
}  // namespace gpis_mapping
