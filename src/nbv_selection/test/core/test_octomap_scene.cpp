// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/octomap_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <random>
#include <set>
#include <tuple>
#include <utility>

#include <Eigen/Geometry>
#include <gmock/gmock.h>
#include <gpis_mapping/ground_projection.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

namespace nbv_selection {
namespace {

using gpis_mapping::Points3d;
using gpis_mapping::SpaceState;
using test_support::messageOf;
using testing::HasSubstr;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kResolution_m = 0.02;
// Clamped values of octomap_baseline's sensor model, and their entropy: -p log2 p - (1 - p) log2(1 - p) by hand.
constexpr double kFree = 0.12;
constexpr double kOccupied = 0.97;
constexpr double kFreeEntropy = 0.529361;
constexpr double kOccupiedEntropy = 0.194392;

using Voxel = std::array<int, 3>;  // covers [i, i + 1) voxels along each axis

/// Voxels with their probability, put into a tree one by one.
class TreeMaker {
 public:
  explicit TreeMaker(double resolution_m = kResolution_m) : tree_(std::make_shared<octomap::OcTree>(resolution_m)) {}

  void set(const Voxel& voxel, double probability) {
    const auto key = [](int i) { return static_cast<octomap::key_type>(i + 32768); };
    tree_->setNodeValue(octomap::OcTreeKey(key(voxel[0]), key(voxel[1]), key(voxel[2])), octomap::logodds(probability),
                        true);
  }
  /// All voxels from `low` up to and without `high`.
  void fill(const Voxel& low, const Voxel& high, double probability) {
    for (int x = low[0]; x < high[0]; ++x) {
      for (int y = low[1]; y < high[1]; ++y) {
        for (int z = low[2]; z < high[2]; ++z) set({x, y, z}, probability);
      }
    }
  }
  std::shared_ptr<octomap::OcTree> pruned() {
    tree_->updateInnerOccupancy();
    tree_->prune();
    return tree_;
  }
  std::shared_ptr<octomap::OcTree> expanded() {
    tree_->updateInnerOccupancy();
    tree_->expand();
    return tree_;
  }

 private:
  std::shared_ptr<octomap::OcTree> tree_;
};

OctomapScene sceneOf(const std::shared_ptr<const octomap::OcTree>& tree, const OctomapScene::Config& config = {}) {
  return OctomapScene(tree, 7, 12.5, config);
}

/// A box of 20 x 16 x 12 voxels from voxel (0, 0, 0), hollow as cameras see it, in free space.
std::shared_ptr<octomap::OcTree> boxTree() {
  TreeMaker maker;
  for (int x = -8; x < 28; ++x) {
    for (int y = -8; y < 24; ++y) {
      for (int z = -8; z < 20; ++z) {
        const int to_face = std::min({x, 19 - x, y, 15 - y, z, 11 - z});
        if (to_face <= 0) maker.set({x, y, z}, to_face < 0 ? kFree : kOccupied);
      }
    }
  }
  return maker.pruned();
}

/// Free, occupied and unknown at random, in lumps of one to sixteen voxels, some of them aligned with the octree's
/// nodes and pruned; about the origin, so that indices of both signs occur.
std::shared_ptr<octomap::OcTree> randomTree(std::uint32_t seed, double resolution_m = kResolution_m) {
  std::mt19937 rng(seed);
  TreeMaker maker(resolution_m);
  const std::array<int, 5> sides{1, 2, 3, 8, 16};
  for (int lump = 0; lump < 300; ++lump) {
    const int side = sides[rng() % sides.size()];
    Voxel low{};
    for (int& i : low) {
      i = static_cast<int>(rng() % 48) - 24;
      if (side >= 8) i -= ((i % 8) + 8) % 8;
    }
    const std::array<double, 5> probabilities{kFree, kOccupied, kFree, 0.3, 0.7};
    maker.fill(low, {low[0] + side, low[1] + side, low[2] + side}, probabilities[rng() % probabilities.size()]);
  }
  return maker.pruned();
}

struct Truth {
  SpaceState state{SpaceState::kUnknown};
  double probability{0.5};
};

/// The tree itself asked, voxel by voxel.
Truth ask(const octomap::OcTree& tree, const Voxel& voxel) {
  const double r = tree.getResolution();
  const octomap::OcTreeNode* node = tree.search((voxel[0] + 0.5) * r, (voxel[1] + 0.5) * r, (voxel[2] + 0.5) * r);
  if (node == nullptr) return {};
  return {tree.isNodeOccupied(node) ? SpaceState::kOccupied : SpaceState::kFree, node->getOccupancy()};
}

Voxel beside(const Voxel& voxel, int dx, int dy, int dz) {
  return {voxel[0] + dx, voxel[1] + dy, voxel[2] + dz};
}

/// Unknown, and below something.
bool isInside(const octomap::OcTree& tree, const Voxel& v) {
  if (ask(tree, v).state != SpaceState::kUnknown) return false;
  for (int dz = 1; dz * tree.getResolution() <= 3.0; ++dz) {
    const Truth above = ask(tree, beside(v, 0, 0, dz));
    if (above.state != SpaceState::kUnknown) return above.state == SpaceState::kOccupied;
  }
  return false;
}

bool hasFreeFace(const octomap::OcTree& tree, const Voxel& v) {
  for (const Voxel& other : {beside(v, 1, 0, 0), beside(v, -1, 0, 0), beside(v, 0, 1, 0), beside(v, 0, -1, 0),
                             beside(v, 0, 0, 1), beside(v, 0, 0, -1)}) {
    if (ask(tree, other).state == SpaceState::kFree) return true;
  }
  return false;
}

Voxel voxelOf(const Eigen::Vector3d& p, double resolution_m) {
  const Eigen::Vector3d v = (p / resolution_m).array().floor();
  return {static_cast<int>(v.x()), static_cast<int>(v.y()), static_cast<int>(v.z())};
}

double angleDeg(const Eigen::Vector3f& a, const Eigen::Vector3f& b) {
  return std::acos(std::min(1.0f, std::max(-1.0f, a.dot(b)))) * 180.0 / M_PI;
}

TEST(VoxelEntropy, IsOneBitWhereNothingIsKnownAndNoneWhereAllIs) {
  EXPECT_DOUBLE_EQ(voxelEntropy(0.5), 1.0);
  EXPECT_DOUBLE_EQ(voxelEntropy(0.0), 0.0);
  EXPECT_DOUBLE_EQ(voxelEntropy(1.0), 0.0);
  EXPECT_NEAR(voxelEntropy(kOccupied), kOccupiedEntropy, 1e-6);  // the digits above
  EXPECT_NEAR(voxelEntropy(kFree), kFreeEntropy, 1e-6);
  EXPECT_DOUBLE_EQ(voxelEntropy(0.25), voxelEntropy(0.75));
  for (const double p : {-0.01, 1.01, kNan}) EXPECT_THROW(voxelEntropy(p), std::invalid_argument) << p;
}

TEST(OctomapSceneConfig, SaysWhatIsImpossible) {
  EXPECT_TRUE(interactive_mapping::problemsOf(OctomapScene::Config()).empty());
  OctomapScene::Config bad;
  bad.gradient_step_m = 0.0;
  bad.surface_band_m = kNan;
  EXPECT_THAT(interactive_mapping::problemsOf(bad),
              testing::ElementsAre("gradient_step_m = 0 m, must be in [0.01, 0.5] m",
                                   "surface_band_m = nan m, must be in [0.005, 0.3] m"));
  EXPECT_THROW(sceneOf(boxTree(), bad), std::invalid_argument);
  EXPECT_THROW(sceneOf(nullptr), std::invalid_argument);
}

TEST(OctomapSceneConfig, MustFitTheVoxelsOfTheTree) {
  TreeMaker coarse(0.05);
  coarse.fill({0, 0, 0}, {8, 8, 1}, kOccupied);
  coarse.fill({0, 0, 1}, {8, 8, 8}, kFree);
  const auto tree = coarse.pruned();
  OctomapScene::Config config;
  config.surface_band_m = 0.03;
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { sceneOf(tree, config); }),
              "impossible scene:\n  surface_band_m = 0.03 m, must be in [0.0433013, 0.8] m for voxels of 0.05 m");
  config.surface_band_m = 0.05;
  EXPECT_EQ(sceneOf(tree, config).surface().points_map.size(), 64u);
  config.gradient_step_m = 0.04;
  EXPECT_THROW(sceneOf(tree, config), std::invalid_argument) << "less than a voxel";
  config.gradient_step_m = 0.5;
  EXPECT_NO_THROW(sceneOf(tree, config));
  EXPECT_THROW(sceneOf(boxTree(), config), std::invalid_argument) << "25 voxels of 2 cm";
}

TEST(OctomapScene, CarriesTheMapsUpdateAndStamp) {
  const MappedSurface surface = sceneOf(boxTree()).surface();
  EXPECT_EQ(surface.update, 7u);
  EXPECT_EQ(surface.stamp_s, 12.5);
  EXPECT_EQ(sceneOf(boxTree()).priorUncertainty(), 1.0);
}

TEST(OctomapSceneSurface, HoldsTheShellOfABoxWithNormalsThatLookOut) {
  const MappedSurface surface = sceneOf(boxTree()).surface();
  ASSERT_EQ(surface.points_map.size(), 20u * 16u * 12u - 18u * 14u * 10u);
  ASSERT_EQ(surface.normals_map.size(), surface.points_map.size());
  ASSERT_EQ(surface.uncertainty.size(), surface.points_map.size());
  int tops = 0;
  int sides = 0;
  int edges = 0;
  for (std::size_t i = 0; i < surface.points_map.size(); ++i) {
    const Eigen::Vector3d& p = surface.points_map[i];
    const Voxel v = voxelOf(p, kResolution_m);
    SCOPED_TRACE(testing::Message() << v[0] << " " << v[1] << " " << v[2]);
    for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(p[axis], (v[axis] + 0.5) * kResolution_m, 1e-12);
    const Eigen::Vector3f& n = surface.normals_map[i];
    EXPECT_NEAR(n.norm(), 1.0f, 1e-5f);
    EXPECT_NEAR(surface.uncertainty[i], kOccupiedEntropy, 1e-5);  // digits above, probabilities are floats
    // Distance to each of the box's faces, in voxels; 0 on it.
    const Eigen::Vector3i low(v[0], v[1], v[2]);
    const Eigen::Vector3i high(19 - v[0], 15 - v[1], 11 - v[2]);
    const Eigen::Vector3i nearest = low.cwiseMin(high);
    const int num_faces = (nearest.array() == 0).count();
    Eigen::Vector3f outward = Eigen::Vector3f::Zero();  // of the faces that the voxel is on
    for (int axis = 0; axis < 3; ++axis) {
      if (nearest[axis] == 0) outward[axis] = low[axis] == 0 ? -1.0f : 1.0f;
    }
    outward.normalize();
    if (num_faces == 1) {
      int to_border = std::numeric_limits<int>::max();
      for (int axis = 0; axis < 3; ++axis) {
        if (nearest[axis] > 0) to_border = std::min(to_border, nearest[axis]);
      }
      // The voxels beside the edge see round it: that is a matter of the neighbourhood's size.
      // The two outer voxels see round the edge, and on the third two edges add up.
      const int to_corner = nearest.sum() - to_border;  // the other border's distance
      EXPECT_LT(angleDeg(n, outward), to_border < 2 ? 40.0 : to_corner < 3 ? 12.0 : 10.0);
      if (to_border >= 2) (outward.z() > 0.5f ? tops : sides) += outward.z() > -0.5f ? 1 : 0;
    } else {
      int to_corner = 0;
      for (int axis = 0; axis < 3; ++axis) to_corner = std::max(to_corner, nearest[axis]);
      EXPECT_LT(angleDeg(n, outward), to_corner == 1 ? 20.0 : 12.0) << "between the faces";
      ++edges;
    }
  }
  EXPECT_EQ(tops, 16 * 12);
  EXPECT_EQ(sides, 2 * 16 * 8 + 2 * 12 * 8);
  EXPECT_EQ(edges, 4 * (18 + 14 + 10) + 8);
}

TEST(OctomapSceneSurface, IsThatOfTheVoxelsOneByOne) {
  for (const std::uint32_t seed : {1u, 2u, 3u}) {
    const auto tree = randomTree(seed);
    std::size_t num_pruned = 0;
    for (auto leaf = tree->begin_leafs(); leaf != tree->end_leafs(); ++leaf) num_pruned += leaf.getDepth() < 16 ? 1 : 0;
    ASSERT_GT(num_pruned, 10u);
    const MappedSurface surface = sceneOf(tree).surface();
    std::set<Voxel> found;
    for (std::size_t i = 0; i < surface.points_map.size(); ++i) {
      const Voxel v = voxelOf(surface.points_map[i], kResolution_m);
      EXPECT_TRUE(found.insert(v).second) << "twice";
      EXPECT_NEAR(surface.uncertainty[i], voxelEntropy(ask(*tree, v).probability), 1e-6);  // a float
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (int dx = -3; dx <= 3; ++dx) {
        for (int dy = -3; dy <= 3; ++dy) {
          for (int dz = -3; dz <= 3; ++dz) {
            const Eigen::Vector3d d(dx, dy, dz);
            if (d.norm() == 0.0 || d.norm() > 3.5) continue;
            if (ask(*tree, beside(v, dx, dy, dz)).state == SpaceState::kFree) sum += d.normalized();
          }
        }
      }
      // Sums of a hundred floats; what is nearly balanced has no direction to compare.
      if (sum.norm() < 0.5) continue;
      EXPECT_LT((surface.normals_map[i].cast<double>() - sum.normalized()).norm(), 1e-4);
    }
    std::size_t expected = 0;
    for (int x = -30; x < 50; ++x) {
      for (int y = -30; y < 50; ++y) {
        for (int z = -30; z < 50; ++z) {
          const Voxel v{x, y, z};
          if (ask(*tree, v).state != SpaceState::kOccupied || !hasFreeFace(*tree, v)) continue;
          ++expected;
          EXPECT_EQ(found.count(v), 1u) << x << " " << y << " " << z;
        }
      }
    }
    EXPECT_EQ(found.size(), expected);
    EXPECT_GT(expected, 500u);
  }
}

TEST(OctomapSceneSurface, IsTheSameWhetherTheTreeIsPrunedOrNot) {
  // A cube of 32 voxels is one node of the tree, larger than what a scene keeps together.
  const auto make = [](bool is_pruned) {
    TreeMaker maker;
    maker.fill({-8, -8, -8}, {48, 48, 48}, kFree);
    maker.fill({0, 0, 0}, {32, 32, 32}, kOccupied);
    maker.fill({40, 0, 0}, {41, 4, 4}, kOccupied);
    return sceneOf(is_pruned ? maker.pruned() : maker.expanded());
  };
  const OctomapScene pruned = make(true);
  const OctomapScene expanded = make(false);
  const MappedSurface a = pruned.surface();
  const MappedSurface b = expanded.surface();
  EXPECT_EQ(a.points_map.size(), 32u * 32u * 32u - 30u * 30u * 30u + 16u);
  EXPECT_EQ(a.points_map, b.points_map);
  EXPECT_EQ(a.normals_map, b.normals_map);
  EXPECT_EQ(a.uncertainty, b.uncertainty);
  std::mt19937 rng(5);
  std::uniform_real_distribution<double> uniform(-0.3, 1.2);
  Points3d points(3, 500);
  for (Eigen::Index i = 0; i < points.size(); ++i) points.data()[i] = uniform(rng);
  EXPECT_EQ(pruned.uncertainty(points).value, expanded.uncertainty(points).value);
  EXPECT_EQ(pruned.uncertainty(points).gradient, expanded.uncertainty(points).gradient);
  EXPECT_EQ(pruned.occupancy(points).probability, expanded.occupancy(points).probability);
}

TEST(OctomapSceneSurface, OfASheetSeenFromBothSidesLooksUp) {
  TreeMaker maker;
  maker.fill({-8, -8, -8}, {8, 8, 8}, kFree);
  maker.fill({-8, -8, 0}, {8, 8, 1}, kOccupied);
  const MappedSurface surface = sceneOf(maker.pruned()).surface();
  int num_inner = 0;
  for (std::size_t i = 0; i < surface.points_map.size(); ++i) {
    EXPECT_NEAR(surface.normals_map[i].norm(), 1.0f, 1e-5f);
    if (surface.points_map[i].head<2>().cwiseAbs().maxCoeff() > 4.0 * kResolution_m) continue;
    EXPECT_EQ(surface.normals_map[i], Eigen::Vector3f::UnitZ());  // not what rounding left of the sum
    ++num_inner;
  }
  EXPECT_EQ(num_inner, 64);
}

TEST(OctomapSceneUncertainty, IsTheMeanOverCellsOfVoxels) {
  // 5, 4 and 1 voxels to a cell; coarser and finer trees.
  const std::vector<std::pair<double, double>> settings{{0.02, 0.1}, {0.025, 0.1}, {0.05, 0.05}, {0.02, 0.15}};
  for (const auto& [resolution_m, step_m] : settings) {
    SCOPED_TRACE(testing::Message() << resolution_m << " " << step_m);
    const auto tree = randomTree(11, resolution_m);
    OctomapScene::Config config;
    config.gradient_step_m = step_m;
    config.surface_band_m = 0.1;
    const OctomapScene scene = sceneOf(tree, config);
    const int n = static_cast<int>(std::lround(step_m / resolution_m - 1e-9));  // 7.5: see below
    const double side_m = (step_m == 0.15 ? 8 : n) * resolution_m;              // rounded to whole voxels
    std::mt19937 rng(6);
    std::uniform_real_distribution<double> uniform(-30.0 * resolution_m, 45.0 * resolution_m);
    Points3d points(3, 60);
    for (Eigen::Index i = 0; i < points.size(); ++i) points.data()[i] = uniform(rng);
    const UncertaintyField field = scene.uncertainty(points);
    int half_seen = 0;
    int one_is_inside = 0;
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      const Eigen::Vector3d p = points.col(i);
      // Mean over the voxels whose middles are in the box.
      const auto mean = [&](const Eigen::Vector3d& low) -> std::optional<double> {
        double sum = 0.0;
        int num = 0;
        const Voxel first = voxelOf(low, resolution_m);
        const int reach = static_cast<int>(side_m / resolution_m) + 2;
        for (int x = first[0] - 1; x < first[0] + reach; ++x) {
          for (int y = first[1] - 1; y < first[1] + reach; ++y) {
            for (int z = first[2] - 1; z < first[2] + reach; ++z) {
              const Eigen::Vector3d middle = (Eigen::Vector3d(x, y, z).array() + 0.5) * resolution_m;
              if ((middle.array() < low.array()).any() || (middle.array() >= low.array() + side_m).any()) continue;
              if (isInside(*tree, {x, y, z})) continue;
              const Truth truth = ask(*tree, {x, y, z});
              sum += truth.state == SpaceState::kUnknown ? 1.0 : voxelEntropy(truth.probability);
              ++num;
            }
          }
        }
        return num == 0 ? std::nullopt : std::optional<double>(sum / num);
      };
      const Eigen::Vector3d about = p - Eigen::Vector3d::Constant(0.5 * side_m);
      EXPECT_NEAR(field.value[i], mean(about).value_or(1.0), 1e-6);  // entropies are floats
      half_seen += field.value[i] < 1.0;
      for (int axis = 0; axis < 3; ++axis) {
        const double border = resolution_m * std::round(p[axis] / resolution_m);
        Eigen::Vector3d low = about;
        low[axis] = border + 1e-9;  // no middle is so near a border
        const std::optional<double> above = mean(low);
        low[axis] -= side_m;
        const std::optional<double> below = mean(low);
        const double expected = above && below ? (*above - *below) / side_m : 0.0;
        EXPECT_NEAR(field.gradient(axis, i), expected, 1e-6 / side_m);
        one_is_inside += above && below ? 0 : 1;
      }
    }
    EXPECT_GT(one_is_inside, 2);
    EXPECT_GT(half_seen, 15);
  }
}

TEST(OctomapSceneUncertainty, GradientPointsIntoTheUnknown) {
  TreeMaker maker;
  maker.fill({-16, -16, -16}, {0, 16, 16}, kFree);
  const OctomapScene scene = sceneOf(maker.pruned());
  Points3d points(3, 4);
  points.col(0) << 0.001, 0.003, 0.001;   // on the border
  points.col(1) << 0.041, 0.003, 0.001;   // two voxels beyond: two of five layers of the lower cell were not seen
  points.col(2) << -0.201, 0.003, 0.001;  // all about it was seen
  points.col(3) << 0.5, 0.003, 0.001;     // nothing was
  const UncertaintyField field = scene.uncertainty(points);
  const double slope = (1.0 - kFreeEntropy) / 0.1;
  EXPECT_NEAR(field.gradient(0, 0), slope, 1e-4);  // digits of the entropy over 0.1 m
  EXPECT_NEAR(field.gradient(0, 1), 0.6 * slope, 1e-4);
  EXPECT_NEAR(field.gradient(0, 2), 0.0, 1e-12);
  EXPECT_NEAR(field.gradient(0, 3), 0.0, 1e-12);
  EXPECT_LT(field.gradient.bottomRows<2>().cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_NEAR(field.value[2], kFreeEntropy, 1e-5);
  EXPECT_EQ(field.value[3], 1.0);
  EXPECT_NEAR(field.value[0], (2.0 * kFreeEntropy + 3.0) / 5.0, 1e-5);  // five layers about voxel 0
}

TEST(OctomapSceneUncertainty, DoesNotLookForWhatIsUnderACoverButForWhatIsFarBelowOne) {
  // Free space up to z = 0, nothing known from there to a plate.
  const auto slope_under_plate_at = [](int layer) {
    TreeMaker maker;
    maker.fill({-16, -16, -16}, {16, 16, 0}, kFree);
    maker.fill({-16, -16, layer}, {16, 16, layer + 1}, kOccupied);
    const UncertaintyField field = sceneOf(maker.pruned()).uncertainty(Points3d(Eigen::Vector3d(0.003, 0.001, 0.001)));
    return field.gradient(2, 0);
  };
  for (const int layer : {6, 7, 8, 9, 30, 125}) EXPECT_EQ(slope_under_plate_at(layer), 0.0) << layer;
  EXPECT_NEAR(slope_under_plate_at(175), (1.0 - kFreeEntropy) / 0.1, 1e-4);  // 3.5 m up; digits of the entropy
}

TEST(OctomapSceneUncertainty, IsThePriorWhereNothingWasSeenAndNoneWherePointsAreNone) {
  const OctomapScene empty = sceneOf(std::make_shared<octomap::OcTree>(kResolution_m));
  EXPECT_TRUE(empty.surface().points_map.empty());
  Points3d points(3, 6);
  points.col(0) << 0.1, 0.2, 0.3;
  points.col(1) << 655.35, -655.35, 655.35;  // the octree's last voxels
  points.col(2) << 1e4, -1e4, 0.0;           // beyond them
  points.col(3) << 1e300, -1e300, 1e308;
  points.col(4) << kNan, 0.0, 0.0;
  points.col(5) << 0.0, kInfinity, 0.0;
  for (const auto& tree : {std::make_shared<octomap::OcTree>(kResolution_m), boxTree()}) {
    const OctomapScene scene = sceneOf(tree);
    const UncertaintyField field = scene.uncertainty(points);
    const OccupancyField occupancy = scene.occupancy(points);
    for (Eigen::Index i = tree->size() == 0 ? 0 : 1; i < 4; ++i) {
      EXPECT_EQ(field.value[i], 1.0) << i;
      EXPECT_EQ(field.gradient.col(i), Eigen::Vector3d::Zero()) << i;
      EXPECT_FALSE(occupancy.is_supported[static_cast<std::size_t>(i)]) << i;
    }
    for (Eigen::Index i = 4; i < 6; ++i) {
      EXPECT_TRUE(std::isnan(field.value[i])) << i;
      EXPECT_TRUE(field.gradient.col(i).array().isNaN().all()) << i;
      EXPECT_FALSE(occupancy.is_supported[static_cast<std::size_t>(i)]) << i;
    }
    EXPECT_EQ(scene.uncertainty(Points3d(3, 0)).value.size(), 0);
  }
}

TEST(OctomapSceneOccupancy, IsTheVoxelsWithTheNormalOfTheNearestSurface) {
  int unknown = 0;
  for (const double band_m : {0.02, 0.03, 0.1}) {
    const auto tree = randomTree(21);
    OctomapScene::Config config;
    config.surface_band_m = band_m;
    const OctomapScene scene = sceneOf(tree, config);
    const MappedSurface surface = scene.surface();
    std::mt19937 rng(8);
    std::uniform_real_distribution<double> uniform(-0.5, 0.8);
    Points3d points(3, 2000);
    for (Eigen::Index i = 0; i < points.size(); ++i) points.data()[i] = uniform(rng);
    const OccupancyField field = scene.occupancy(points);
    ASSERT_EQ(field.is_supported.size(), 2000u);
    int supported = 0;
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      double nearest_m = kInfinity;
      for (const Eigen::Vector3d& s : surface.points_map) nearest_m = std::min(nearest_m, (s - points.col(i)).norm());
      const Truth truth = ask(*tree, voxelOf(points.col(i), kResolution_m));
      unknown += nearest_m <= band_m && truth.state == SpaceState::kUnknown;
      const bool is_supported = nearest_m <= band_m && truth.state != SpaceState::kUnknown;
      ASSERT_EQ(field.is_supported[static_cast<std::size_t>(i)], is_supported) << points.col(i).transpose();
      if (!is_supported) continue;
      ++supported;
      EXPECT_EQ(field.probability[i], truth.probability);
      bool is_of_nearest = false;  // of one of them, if several are as near
      for (std::size_t j = 0; j < surface.points_map.size(); ++j) {
        is_of_nearest |= (surface.points_map[j] - points.col(i)).norm() <= nearest_m + 1e-12 &&
                         surface.normals_map[j].cast<double>() == field.normal.col(i);
      }
      EXPECT_TRUE(is_of_nearest);
    }
    EXPECT_GT(supported, 50);
  }
  EXPECT_GT(unknown, 5) << "near a surface, and never seen";
}

/// A pile on tilted ground, as one camera sees it.
struct PileView {
  double tilt_rad{0.0};
  double height_m{0.0};  // of the ground at the origin
  double heading_max_rad{4.0};
  Eigen::Vector3d camera{-0.6, -2.0, 1.3};

  double groundAt(double x_m) const { return height_m + std::tan(tilt_rad) * x_m; }
  bool isSolid(const Eigen::Vector3d& p) const {
    const double height = p.z() - groundAt(p.x());
    if (height < 0.0) return true;
    const bool is_in_tall = std::abs(p.x()) < 0.4 && std::abs(p.y()) < 0.3 && height < 0.3;
    const bool is_in_low = p.x() > -0.4 && p.x() < 0.0 && p.y() > -0.6 && p.y() < 0.0 && height < 0.2;
    return is_in_tall || is_in_low;
  }
  bool isInView(const Eigen::Vector3d& p) const {
    return std::atan2(p.x() - camera.x(), p.y() - camera.y()) < heading_max_rad;
  }

  /// Whether nothing is between the camera and `p`.
  bool sees(const Eigen::Vector3d& p) const {
    constexpr int kSteps = 500;  // of 5 mm
    for (int k = 1; k <= kSteps; ++k) {
      if (isSolid(camera + (p - camera) * (k / static_cast<double>(kSteps)))) return false;
    }
    return isInView(p);
  }

  /// A voxel is solid if any of it is, as rays that end anywhere in it say. One that is not is seen if the line from
  /// the camera to its middle passes no solid one; a solid one, if one beside it is seen.
  std::shared_ptr<octomap::OcTree> tree() const {
    constexpr int kSide = 80;
    constexpr int kHeight = 32;
    const Voxel low{-40, -40, -10};
    const auto middle = [&](int x, int y, int z) -> Eigen::Vector3d {
      return (Eigen::Vector3d(low[0] + x, low[1] + y, low[2] + z).array() + 0.5) * kResolution_m;
    };
    const auto is_in_region = [](int x, int y, int z) {
      return x >= 0 && y >= 0 && z >= 0 && x < kSide && y < kSide && z < kHeight;
    };
    const auto index = [](int x, int y, int z) { return static_cast<std::size_t>((x * kSide + y) * kHeight + z); };
    std::vector<std::uint8_t> is_solid(kSide * kSide * kHeight, 0);
    std::vector<std::uint8_t> is_seen_free(is_solid.size(), 0);
    const auto each = [](const std::function<void(int, int, int)>& visit) {
      for (int x = 0; x < kSide; ++x) {
        for (int y = 0; y < kSide; ++y) {
          for (int z = 0; z < kHeight; ++z) visit(x, y, z);
        }
      }
    };
    each([&](int x, int y, int z) {
      for (int k = 0; k < 8; ++k) {
        const Eigen::Vector3d corner((k & 1) - 0.5, (k >> 1 & 1) - 0.5, (k >> 2) - 0.5);
        is_solid[index(x, y, z)] |= isSolid(middle(x, y, z) + 0.98 * kResolution_m * corner) ? 1 : 0;
      }
    });
    each([&](int x, int y, int z) {
      const Eigen::Vector3d p = middle(x, y, z);
      if (!isInView(p) || is_solid[index(x, y, z)] != 0) return;
      const Eigen::Vector3d step = 0.5 * kResolution_m * (camera - p).normalized();
      for (Eigen::Vector3d q = p + step;; q += step) {
        const Voxel v = voxelOf(q, kResolution_m);
        const Voxel at{v[0] - low[0], v[1] - low[1], v[2] - low[2]};
        if (!is_in_region(at[0], at[1], at[2])) break;
        if (is_solid[index(at[0], at[1], at[2])] != 0) return;
      }
      is_seen_free[index(x, y, z)] = 1;
    });
    TreeMaker maker;
    each([&](int x, int y, int z) {
      const Voxel voxel{low[0] + x, low[1] + y, low[2] + z};
      if (is_seen_free[index(x, y, z)] != 0) maker.set(voxel, kFree);
      if (is_solid[index(x, y, z)] == 0) return;
      bool is_seen = false;
      for (int side = -1; side <= 1; side += 2) {
        for (const Voxel& v :
             {beside({x, y, z}, side, 0, 0), beside({x, y, z}, 0, side, 0), beside({x, y, z}, 0, 0, side)}) {
          is_seen |= is_in_region(v[0], v[1], v[2]) && is_seen_free[index(v[0], v[1], v[2])] != 0;
        }
      }
      if (is_seen) maker.set(voxel, kOccupied);
    });
    return maker.pruned();
  }
};

TEST(OctomapSceneUncertainty, FrontierOfAHalfSeenPileIsWhereTheSeenPartEnds) {
  for (const auto& [tilt_rad, height_m] : {std::pair{0.0, 0.0}, std::pair{0.1, 0.007}}) {
    SCOPED_TRACE(tilt_rad);
    PileView view;
    view.tilt_rad = tilt_rad;
    view.height_m = height_m;
    view.heading_max_rad = 0.32;  // ends on the face of the tall part at about x = -0.04, and it hides its other sides
    const OctomapScene scene = sceneOf(view.tree());
    // Along the pile's outline on the ground, counter-clockwise, a point every 2 cm. The first corner is in full view.
    const std::vector<Eigen::Vector2d> corners{{-0.4, -0.6}, {0.0, -0.6}, {0.0, -0.3},
                                               {0.4, -0.3},  {0.4, 0.3},  {-0.4, 0.3}};
    std::vector<double> along;  // (grad u . l)^2
    std::vector<double> u;
    std::vector<bool> is_seen;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const Eigen::Vector2d side = corners[(i + 1) % corners.size()] - corners[i];
      const int count = static_cast<int>(std::lround(side.norm() / kResolution_m));
      const Eigen::Vector2d outward = Eigen::Vector2d(side.y(), -side.x()).normalized();
      Points3d points(3, count);
      for (int k = 0; k < count; ++k) {
        const Eigen::Vector2d p = corners[i] + side * (k / static_cast<double>(count));
        points.col(k) << p, view.groundAt(p.x());
        const Eigen::Vector2d beside_it = p + 0.03 * outward;
        is_seen.push_back(view.sees({beside_it.x(), beside_it.y(), view.groundAt(beside_it.x()) + 0.02}));
      }
      const Eigen::Vector3d l = Eigen::Vector3d(side.x(), side.y(), std::tan(tilt_rad) * side.x()).normalized();
      const UncertaintyField field = scene.uncertainty(points);
      for (int k = 0; k < count; ++k) {
        along.push_back(std::pow(field.gradient.col(k).dot(l), 2));
        u.push_back(field.value[k]);
      }
    }
    // How many points on either side of `i` are like it.
    const int num = static_cast<int>(along.size());
    const auto at = [num](int i) { return static_cast<std::size_t>((i + num) % num); };
    const auto to_change = [&](int i) {
      int steps = 1;
      while (steps < num && is_seen[at(i + steps)] == is_seen[at(i)] && is_seen[at(i - steps)] == is_seen[at(i)])
        ++steps;
      return steps;
    };
    int num_seen = 0;
    int num_unseen = 0;
    int num_frontiers = 0;
    for (int i = 0; i < num; ++i) {
      SCOPED_TRACE(i);
      if (is_seen[at(i)] != is_seen[at(i + 1)]) {
        ++num_frontiers;
        double peak = 0.0;
        for (int k = -4; k <= 5; ++k) peak = std::max(peak, along[at(i + k)]);
        // A change from 0.4 to 1 bit between the cells would be 36; the edge of the view is aslant.
        EXPECT_GT(peak, 10.0);
      }
      if (to_change(i) < 8) continue;  // a cell of 0.1 m on either side, and as much again across the outline
      (is_seen[at(i)] ? num_seen : num_unseen) += 1;
      EXPECT_LT(along[at(i)], 1.0) << "corners too: there, cells hold more or less of walls (0.2) and air (0.5 bit)";
      if (is_seen[at(i)]) {
        EXPECT_LT(u[at(i)], 0.55) << "between occupied and free";
      } else {
        EXPECT_GT(u[at(i)], 0.95);
      }
    }
    EXPECT_EQ(num_frontiers, 2);
    EXPECT_GT(num_seen, 20);
    EXPECT_GT(num_unseen, 50);
  }
}

TEST(OctomapSceneSurface, OfATiltedFloorLooksUpInSpiteOfItsSteps) {
  PileView view;
  view.tilt_rad = 0.1;
  const MappedSurface surface = sceneOf(view.tree()).surface();
  const Eigen::Vector3f truth = Eigen::Vector3d(-std::sin(view.tilt_rad), 0.0, std::cos(view.tilt_rad)).cast<float>();
  int num_floor = 0;
  for (std::size_t i = 0; i < surface.points_map.size(); ++i) {
    const Eigen::Vector3d& p = surface.points_map[i];
    // A neighbourhood's radius away from the pile and from the scene's end.
    if (p.y() > -0.68 || p.y() < -0.74 || std::abs(p.x()) > 0.7) continue;
    EXPECT_LT(angleDeg(surface.normals_map[i], truth), 12.0) << p.transpose();
    ++num_floor;
  }
  EXPECT_GE(num_floor, 3 * 70) << "rows and columns of voxels";
}

TEST(OctomapSceneGround, IsFoundWithinHalfAVoxel) {
  for (const double tilt_rad : {0.0, 0.1}) {
    for (const double height_m : {0.0, 0.004, 0.01, 0.0199}) {
      PileView view;
      view.tilt_rad = tilt_rad;
      view.height_m = height_m;
      const MappedSurface surface = sceneOf(view.tree()).surface();
      const auto ground = gpis_mapping::estimateGround(surface.points_map, surface.normals_map, {});
      ASSERT_TRUE(ground);
      for (const double x : {-0.75, 0.0, 0.75}) {
        for (const double y : {-0.75, 0.75}) {
          EXPECT_NEAR(ground->zAt(x, y), view.groundAt(x), 0.5 * kResolution_m + 1e-4)
              << tilt_rad << " " << height_m << ": PCL computes in float";
        }
      }
    }
  }
}

}  // namespace
}  // namespace nbv_selection
