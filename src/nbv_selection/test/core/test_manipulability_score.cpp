// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/manipulability_score.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <stdexcept>
#include <tuple>

#include <gmock/gmock.h>

#include "nbv_selection/gpis_scene.h"
#include "support/function_scene.h"
#include "support/sampled_map.h"

namespace nbv_selection {
namespace {

using base_navigation::Pose2d;
using gpis_mapping::GroundPlane;
using interactive_mapping::problemsOf;
using motion_planning::AnnulusSector;
using motion_planning::ManipulabilitySectors;
using nbv_selection_test::FunctionScene;
using nbv_selection_test::MapSamples;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kMinHeight_m = 0.04;

/// About those of the UR5e.
ManipulabilitySectors armSectors() {
  ManipulabilitySectors sectors;
  sectors.top = {0.2, 0.9, -0.5, 0.6, 1.5};
  sectors.side = {0.4, 1.0, -0.4, 0.75, 1.2};
  return sectors;
}

Eigen::Isometry3d armFoot() {
  Eigen::Isometry3d T_base_armbase = Eigen::Isometry3d::Identity();
  T_base_armbase.translation() << 0.186, 0.0, 0.5;
  return T_base_armbase;
}

GroundPlane tilted(double tilt_rad, double towards_rad, double offset_m) {
  GroundPlane ground;
  ground.normal_map << std::sin(tilt_rad) * std::cos(towards_rad), std::sin(tilt_rad) * std::sin(towards_rad),
      std::cos(tilt_rad);
  ground.offset_m = offset_m;
  return ground;
}

MappedSurface surfaceOf(std::vector<Eigen::Vector3d> points) {
  MappedSurface surface;
  surface.normals_map.resize(points.size(), Eigen::Vector3f::UnitZ());
  surface.uncertainty.resize(points.size(), 0.0F);
  surface.points_map = std::move(points);
  return surface;
}

/// Upright boxes with exact distances; a point is supported within 5 cm of a face.
struct BoxScene : FunctionScene {
  explicit BoxScene(const std::vector<Eigen::AlignedBox3d>& boxes) {
    MapSamples samples;
    for (const Eigen::AlignedBox3d& box : boxes) samples.addBox(box);
    std::vector<Eigen::Vector3d> points;
    for (const auto& point : samples.points()) points.push_back(point.position_map);
    mapped = surfaceOf(points);
    occupied = [boxes](const Eigen::Vector3d& p) {
      Occupancy result;
      double nearest_m = std::numeric_limits<double>::max();
      for (const Eigen::AlignedBox3d& box : boxes) {
        const Eigen::Vector3d from_center = p - box.center();
        const Eigen::Vector3d q = from_center.cwiseAbs() - 0.5 * box.sizes();
        Eigen::Index axis = 0;
        const double largest = q.maxCoeff(&axis);
        const double distance_m = q.cwiseMax(0.0).norm() + std::min(0.0, largest);
        if (distance_m >= nearest_m) continue;
        nearest_m = distance_m;
        result.normal = Eigen::Vector3d::Unit(axis) * (from_center[axis] < 0.0 ? -1.0 : 1.0);
      }
      result.is_supported = std::abs(nearest_m) <= 0.05;
      result.probability = nearest_m < 0.0 ? 1.0 : 0.0;
      return result;
    };
  }
};

/// Probability, normal and support that differ from point to point without any sense: nothing comes out right by luck.
FunctionScene senselessScene() {
  FunctionScene scene;
  scene.occupied = [](const Eigen::Vector3d& p) {
    FunctionScene::Occupancy result;
    result.probability = std::max(0.0, 0.5 + 0.6 * std::sin(31.0 * p.x() + 17.0 * p.y() + 23.0 * p.z()));
    result.normal << std::sin(13.0 * p.x() + 1.0), std::sin(11.0 * p.y() + 2.0), std::sin(19.0 * p.z() + 0.5);
    result.normal.normalize();
    result.is_supported = std::sin(29.0 * (p.x() - p.y() + p.z())) > -0.6;
    return result;
  };
  return scene;
}

/// Eq 14 from its words: all lattice points of a box about the surface, each put to every question anew, in the map
/// frame.
struct BruteForce {
  const FunctionScene& scene;
  const MappedSurface& surface;
  const GroundPlane& ground;
  const ManipulabilitySectors& sectors;
  const Eigen::Isometry3d& T_base_armbase;
  const ManipulabilityScoreConfig& config;
  std::vector<Eigen::Vector3d> asked{};

  void ask() {
    Eigen::AlignedBox3d box;
    for (const Eigen::Vector3d& p : surface.points_map) box.extend(p);
    const Eigen::Vector3d margin = Eigen::Vector3d::Constant(3.0 * config.cell_m + config.band_m);
    for (const Eigen::Vector3d& p : lattice({box.min() - margin, box.max() + margin})) {
      double nearest_m = std::numeric_limits<double>::max();
      for (const Eigen::Vector3d& q : surface.points_map) nearest_m = std::min(nearest_m, (p - q).norm());
      if (nearest_m <= config.band_m && ground.heightOf(p) >= kMinHeight_m) asked.push_back(p);
    }
  }

  std::vector<Eigen::Vector3d> lattice(const Eigen::AlignedBox3d& box) const {
    std::vector<Eigen::Vector3d> points;
    const double c = config.cell_m;
    for (double x = std::floor(box.min().x() / c); x * c < box.max().x(); ++x) {
      for (double y = std::floor(box.min().y() / c); y * c < box.max().y(); ++y) {
        for (double z = std::floor(box.min().z() / c); z * c < box.max().z(); ++z) {
          points.emplace_back((x + 0.5) * c, (y + 0.5) * c, (z + 0.5) * c);
        }
      }
    }
    return points;
  }

  /// Sectors end 1.2 m beside and 1.25 m above the origin; tilted by a tenth, a tenth more.
  double numSamples() const {
    double count = 0.0;
    for (const Eigen::Vector3d& p : lattice({Eigen::Vector3d::Constant(-1.7), Eigen::Vector3d::Constant(1.7)})) {
      const Eigen::Vector3d p_armbase = T_base_armbase.inverse() * p;
      if (sectors.top.contains(p_armbase) || sectors.side.contains(p_armbase)) count += 1.0;
    }
    return count;
  }

  using Key = std::tuple<double, double, double>;
  /// Shares above 0 by point.
  std::map<Key, double> shares(const Eigen::Isometry3d& T_map_base) const {
    std::map<Key, double> result;
    const Eigen::Isometry3d T_map_armbase = T_map_base * T_base_armbase;
    const Eigen::Vector3d foot = T_map_armbase.translation();
    const Eigen::Vector3d up = T_map_armbase.linear() * Eigen::Vector3d::UnitZ();
    for (const Eigen::Vector3d& p : asked) {
      const FunctionScene::Occupancy at = scene.occupied(p);
      if (!at.is_supported) continue;
      const Eigen::Vector3d p_armbase = T_map_armbase.inverse() * p;
      const bool is_top = sectors.top.contains(p_armbase), is_side = sectors.side.contains(p_armbase);
      if (!is_top && !is_side) continue;
      const Eigen::Vector3d from_foot = p - foot;
      double weight = 0.0;
      if (config.weight == ApproachWeight::kFromArmBase) {
        weight = -at.normal.dot(from_foot.normalized());
      } else {
        const Eigen::Vector3d outward = (from_foot - up.dot(from_foot) * up).normalized();
        weight = std::max(is_top ? at.normal.dot(up) : 0.0, is_side ? -at.normal.dot(outward) : 0.0);
      }
      const double share = std::max(0.0, weight) * at.probability;
      if (share > 0.0) result[{p.x(), p.y(), p.z()}] = share;
    }
    return result;
  }
};

class ManipulabilityScoreWeights : public testing::TestWithParam<ApproachWeight> {};

TEST_P(ManipulabilityScoreWeights, IsEquationFourteenByBruteForce) {
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const FunctionScene scene = senselessScene();
  int num_positive = 0;
  for (int world = 0; world < 8; ++world) {
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 150; ++i) points.emplace_back(0.6 * uniform(rng), 0.5 * uniform(rng), 0.3 + 0.5 * uniform(rng));
    points.emplace_back(kNaN, 0.0, 0.0);  // is passed over
    const MappedSurface surface = surfaceOf(points);
    // The steepest ground that is taken for one: 15 degrees.
    const GroundPlane ground =
        tilted(world == 0 ? 0.0 : 0.26 * std::abs(uniform(rng)), M_PI * uniform(rng), 0.2 * uniform(rng));
    ManipulabilitySectors sectors = armSectors();
    sectors.side.half_angle_rad = 1.2 + 0.3 * uniform(rng);
    if (world == 3) sectors.top.half_angle_rad = M_PI;
    Eigen::Isometry3d T_base_armbase = armFoot();
    T_base_armbase.rotate(Eigen::AngleAxisd(0.1 * uniform(rng), Eigen::Vector3d(1.0, uniform(rng), 2.0).normalized()));
    ManipulabilityScoreConfig config;
    config.weight = GetParam();
    config.cell_m = world < 4 ? 0.05 : 0.07;
    config.band_m = world % 2 == 0 ? 0.05 : 0.09;
    const ManipulabilityScore score(scene, surface, ground, kMinHeight_m, sectors, T_base_armbase, config);
    MappedSurface finite = surface;
    finite.points_map.pop_back();
    BruteForce oracle{scene, finite, ground, sectors, T_base_armbase, config};
    oracle.ask();
    ASSERT_EQ(score.numAsked(), oracle.asked.size());
    const double num_samples = oracle.numSamples();
    ASSERT_EQ(countSamples(sectors, T_base_armbase, config.cell_m), num_samples);
    const auto lost = std::count_if(oracle.asked.begin(), oracle.asked.end(),
                                    [&](const Eigen::Vector3d& p) { return !scene.occupied(p).is_supported; });
    EXPECT_GT(lost, 0);
    for (int i = 0; i < 25; ++i) {
      const Pose2d pose{0.9 * uniform(rng), 0.9 * uniform(rng), 4.0 * uniform(rng)};
      const auto shares = oracle.shares(standOn(ground, pose));
      double sum = 0.0;
      for (const auto& [point, share] : shares) sum += share;
      std::vector<ManipulabilitySample> samples(3);  // are replaced
      const double m = score.at(pose, &samples);
      EXPECT_NEAR(m, sum / num_samples, 1e-12);
      EXPECT_EQ(score.at(pose), m);
      EXPECT_GE(m, 0.0);
      EXPECT_LE(m, 1.0);
      num_positive += m > 0.0 ? 1 : 0;
      ASSERT_EQ(samples.size(), shares.size());
      for (const ManipulabilitySample& sample : samples) {
        const auto found = shares.find({sample.p_map.x(), sample.p_map.y(), sample.p_map.z()});
        ASSERT_NE(found, shares.end());
        EXPECT_NEAR(sample.share, found->second, 1e-6);  // floats
      }
    }
  }
  EXPECT_GT(num_positive, 100);
}

INSTANTIATE_TEST_SUITE_P(Both, ManipulabilityScoreWeights,
                         testing::Values(ApproachWeight::kSector, ApproachWeight::kFromArmBase));

TEST(ManipulabilityScore, AsksEachLatticePointOnceInOneQuestion) {
  const BoxScene scene({Eigen::AlignedBox3d(Eigen::Vector3d(0.5, -0.2, 0.0), Eigen::Vector3d(0.8, 0.2, 0.3))});
  const ManipulabilityScore score(scene, scene.mapped, GroundPlane(), kMinHeight_m, armSectors(), armFoot(),
                                  ManipulabilityScoreConfig());
  EXPECT_EQ(scene.num_questions, 1);
  EXPECT_EQ(static_cast<std::size_t>(scene.num_points), score.numAsked());
  EXPECT_GT(score.numAsked(), 100u);
  score.at({});
  EXPECT_EQ(scene.num_questions, 1);
}

double scoreOf(const std::vector<Eigen::AlignedBox3d>& pile, const Pose2d& pose,
               ApproachWeight weight = ApproachWeight::kSector) {
  const BoxScene scene(pile);
  ManipulabilityScoreConfig config;
  config.weight = weight;
  return ManipulabilityScore(scene, scene.mapped, GroundPlane(), kMinHeight_m, armSectors(), armFoot(), config)
      .at(pose);
}

TEST(ManipulabilityScore, PileInFrontCountsMoreThanBesideBehindOrOutOfReach) {
  const std::vector<Eigen::AlignedBox3d> pile{
      Eigen::AlignedBox3d(Eigen::Vector3d(-0.25, -0.35, 0.0), Eigen::Vector3d(0.25, 0.35, 0.3))};
  for (const ApproachWeight weight : {ApproachWeight::kSector, ApproachWeight::kFromArmBase}) {
    const double front = scoreOf(pile, {-0.85, 0.0, 0.0}, weight);
    // 90 degrees aside of an arm that sees 86 at most to each side; the pile lies at its edge.
    const double beside = scoreOf(pile, {-0.85, 0.0, M_PI_2}, weight);
    const double behind = scoreOf(pile, {-0.85, 0.0, M_PI}, weight);
    const double far = scoreOf(pile, {-1.3, 0.0, 0.0}, weight);
    const double beyond = scoreOf(pile, {-1.6, 0.0, 0.0}, weight);
    // About 7 x 14 columns of the top, of 14000 lattice points in the sectors.
    EXPECT_GT(front, 0.004);
    EXPECT_GT(front, 1.5 * beside);
    EXPECT_EQ(behind, 0.0);
    EXPECT_GT(front, far);
    EXPECT_EQ(beyond, 0.0);
  }
}

TEST(ManipulabilityScore, DoesNotChangeWhenWorldAndRobotMoveTogether) {
  // By whole cells and quarter turns, which the lattice does not notice.
  const std::vector<Eigen::AlignedBox3d> pile{
      Eigen::AlignedBox3d(Eigen::Vector3d(-0.212, -0.307, 0.0), Eigen::Vector3d(0.188, 0.293, 0.29))};
  const std::vector<Eigen::AlignedBox3d> turned{Eigen::AlignedBox3d(Eigen::Vector3d(-0.293 + 2.0, -0.212 - 1.5, 0.0),
                                                                    Eigen::Vector3d(0.307 + 2.0, 0.188 - 1.5, 0.29))};
  const double still = scoreOf(pile, {-0.813, 0.041, 0.123});
  // A quarter turn to the left takes (x, y) to (-y, x).
  EXPECT_NEAR(scoreOf(turned, {2.0 - 0.041, -1.5 - 0.813, 0.123 + M_PI_2}), still, 1e-9);
  EXPECT_GT(still, 0.0);
}

TEST(ManipulabilityScore, FacesThatLookAwayFromEveryApproachCountNothing) {
  // One sheet in reach whose normal is given.
  FunctionScene scene;
  std::vector<Eigen::Vector3d> points;
  for (double y = -0.3; y <= 0.3; y += 0.02) {
    for (double z = 0.2; z <= 0.6; z += 0.02) points.emplace_back(0.85, y, z);
  }
  const MappedSurface surface = surfaceOf(points);
  const auto with = [&](const Eigen::Vector3d& normal, ApproachWeight weight, const AnnulusSector& top) {
    scene.occupied = [=](const Eigen::Vector3d&) { return FunctionScene::Occupancy{1.0, normal, true}; };
    ManipulabilitySectors sectors = armSectors();
    sectors.top = top;
    ManipulabilityScoreConfig config;
    config.weight = weight;
    return ManipulabilityScore(scene, surface, GroundPlane(), kMinHeight_m, sectors, armFoot(), config).at({});
  };
  const AnnulusSector top = armSectors().top, none{};
  const Eigen::Vector3d up(0, 0, 1), down(0, 0, -1), towards(-1, 0, 0), away(1, 0, 0);
  const ApproachWeight sector = ApproachWeight::kSector, paper = ApproachWeight::kFromArmBase;
  EXPECT_GT(with(up, sector, top), 0.0);
  EXPECT_GT(with(towards, sector, top), 0.0);
  EXPECT_EQ(with(down, sector, top), 0.0);
  EXPECT_EQ(with(away, sector, top), 0.0);
  EXPECT_EQ(with(up, sector, none), 0.0);  // only the sides are in reach: nothing comes from above
  EXPECT_GT(with(towards, sector, none), 0.0);
  EXPECT_EQ(with(away, paper, top), 0.0);
  EXPECT_GT(with(towards, paper, top), 0.0);
}

TEST(ManipulabilityScore, PapersWeightDoesNotSeeATopAtTheHeightOfTheArmsFoot) {
  FunctionScene scene;
  // A lattice layer at z = 0.475 and the foot as high.
  std::vector<Eigen::Vector3d> points;
  for (double x = 0.5; x < 0.9; x += 0.02) {
    for (double y = -0.2; y < 0.2; y += 0.02) points.emplace_back(x, y, 0.475);
  }
  scene.occupied = [](const Eigen::Vector3d& p) {
    return FunctionScene::Occupancy{1.0, Eigen::Vector3d::UnitZ(), std::abs(p.z() - 0.475) < 0.01};
  };
  Eigen::Isometry3d T_base_armbase = armFoot();
  T_base_armbase.translation().z() = 0.475;
  ManipulabilityScoreConfig config;
  config.weight = ApproachWeight::kFromArmBase;
  const MappedSurface surface = surfaceOf(points);
  EXPECT_NEAR(
      ManipulabilityScore(scene, surface, GroundPlane(), kMinHeight_m, armSectors(), T_base_armbase, config).at({}),
      0.0, 1e-12);
  config.weight = ApproachWeight::kSector;
  EXPECT_GT(
      ManipulabilityScore(scene, surface, GroundPlane(), kMinHeight_m, armSectors(), T_base_armbase, config).at({}),
      0.005);
}

TEST(ManipulabilityScore, NothingMappedIsNothingToAskAndZero) {
  FunctionScene scene = senselessScene();
  const ManipulabilityScore empty(scene, {}, GroundPlane(), kMinHeight_m, armSectors(), armFoot(),
                                  ManipulabilityScoreConfig());
  EXPECT_EQ(scene.num_questions, 0);
  EXPECT_EQ(empty.numAsked(), 0u);
  std::vector<ManipulabilitySample> samples(2);
  EXPECT_EQ(empty.at({}, &samples), 0.0);
  EXPECT_THAT(samples, IsEmpty());
  // Ground alone: too low.
  std::vector<Eigen::Vector3d> points;
  for (double x = 0.0; x < 1.0; x += 0.02) points.emplace_back(x, 0.0, 0.0);
  const ManipulabilityScore ground(scene, surfaceOf(points), GroundPlane(), 0.06, armSectors(), armFoot(),
                                   ManipulabilityScoreConfig());
  EXPECT_EQ(ground.numAsked(), 0u);
  EXPECT_EQ(ground.at({}), 0.0);
}

TEST(ManipulabilityScore, SectorsWithoutRoomAndPosesWithoutNumbersAreZero) {
  const BoxScene scene({Eigen::AlignedBox3d(Eigen::Vector3d(0.5, -0.2, 0.0), Eigen::Vector3d(0.8, 0.2, 0.3))});
  const ManipulabilityScore none(scene, scene.mapped, GroundPlane(), kMinHeight_m, ManipulabilitySectors(), armFoot(),
                                 ManipulabilityScoreConfig());
  EXPECT_EQ(countSamples(ManipulabilitySectors(), armFoot(), ManipulabilityScoreConfig().cell_m), 0.0);
  EXPECT_EQ(none.at({}), 0.0);
  const ManipulabilityScore score(scene, scene.mapped, GroundPlane(), kMinHeight_m, armSectors(), armFoot(),
                                  ManipulabilityScoreConfig());
  EXPECT_GT(score.at({}), 0.0);
  EXPECT_EQ(score.at({kNaN, 0.0, 0.0}), 0.0);
  EXPECT_EQ(score.at({0.0, 0.0, kNaN}), 0.0);
}

TEST(ManipulabilityScore, NeverMoreThanOne) {
  // All there is, is a good place to pick at, whatever it looks like. Sectors of a few cells hold more of them here
  // than there.
  FunctionScene scene;
  scene.occupied = [](const Eigen::Vector3d&) { return FunctionScene::Occupancy{1.0, Eigen::Vector3d::UnitZ(), true}; };
  std::vector<Eigen::Vector3d> points;
  for (double x = -0.5; x < 0.5; x += 0.04) {
    for (double y = -0.5; y < 0.5; y += 0.04) {
      for (double z = 0.3; z < 0.7; z += 0.04) points.emplace_back(x, y, z);
    }
  }
  const MappedSurface surface = surfaceOf(points);
  int num_more = 0;
  for (const double radius_m : {0.08, 0.1, 0.13, 0.16}) {
    ManipulabilitySectors sectors;
    sectors.top = {0.0, radius_m, -0.06, 0.06, M_PI};
    const ManipulabilityScore score(scene, surface, GroundPlane(), kMinHeight_m, sectors, armFoot(),
                                    ManipulabilityScoreConfig());
    const double num_samples = countSamples(sectors, armFoot(), ManipulabilityScoreConfig().cell_m);
    for (double x = -0.3; x < 0.1; x += 0.013) {
      std::vector<ManipulabilitySample> samples;
      const double m = score.at({x, 0.3 * x, 0.0}, &samples);
      EXPECT_GT(m, 0.5);
      EXPECT_LE(m, 1.0);
      if (static_cast<double>(samples.size()) > num_samples) {
        EXPECT_EQ(m, 1.0);
        ++num_more;
      }
    }
  }
  EXPECT_GT(num_more, 5);
}

TEST(ManipulabilityScore, LosesItsSupportWhenTheMapHasChangedSince) {
  // Meshed, then taken away.
  const Eigen::AlignedBox3d brick(Eigen::Vector3d(0.5, -0.2, 0.0), Eigen::Vector3d(0.8, 0.2, 0.3));
  const BoxScene before({brick});
  const BoxScene after({Eigen::AlignedBox3d(Eigen::Vector3d(5.0, 5.0, 0.0), Eigen::Vector3d(5.3, 5.4, 0.3))});
  const auto score = [&](const SceneModel& scene) {
    return ManipulabilityScore(scene, before.mapped, GroundPlane(), kMinHeight_m, armSectors(), armFoot(),
                               ManipulabilityScoreConfig());
  };
  EXPECT_EQ(score(after).at({}), 0.0);
  EXPECT_GT(score(before).at({}), 0.0);
}

TEST(ManipulabilityScore, OfARealMapIsAboutTheSameWhereverItsSurfaceCutsTheLattice) {
  double least = 1.0, most = 0.0;
  for (const double shift_m : {0.0, 0.005, 0.01, 0.025, 0.03, 0.04}) {
    MapSamples samples;
    samples.addRectangle({-0.3, -0.6, 0.0}, {0.6, 0.0, 0.0}, {0.0, 1.2, 0.0});
    samples.addBox(Eigen::AlignedBox3d(Eigen::Vector3d(0.45 + shift_m, -0.25 + shift_m, 0.0),
                                       Eigen::Vector3d(0.85 + shift_m, 0.25 + shift_m, 0.25 + shift_m)));
    const auto scene = makeGpisScene(samples.snapshot(), GpisScene::Config());
    const ManipulabilityScore score(*scene, scene->surface(), GroundPlane(), kMinHeight_m, armSectors(), armFoot(),
                                    ManipulabilityScoreConfig());
    EXPECT_GT(score.numAsked(), 200u);
    EXPECT_EQ(score.at({0.0, 0.0, M_PI}), 0.0);
    least = std::min(least, score.at({}));
    most = std::max(most, score.at({}));
  }
  // Under a face lie one layer of the lattice at most a cell deep, and two if one is on the face: that counts a half.
  EXPECT_GT(least, most / 3.0);
  // 8 x 10 columns of the top, of 14000 points; not all in reach, and the probability is soft.
  EXPECT_GT(least, 0.002);
}

TEST(StandOn, PutsTheBaseUprightOnThePlaneFacingItsHeading) {
  std::mt19937 rng(2);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (int i = 0; i < 200; ++i) {
    const GroundPlane ground = tilted(0.3 * std::abs(uniform(rng)), M_PI * uniform(rng), uniform(rng));
    const Pose2d pose{3.0 * uniform(rng), 3.0 * uniform(rng), 4.0 * uniform(rng)};
    const Eigen::Isometry3d T_map_base = standOn(ground, pose);
    EXPECT_LT((T_map_base.linear().transpose() * T_map_base.linear() - Eigen::Matrix3d::Identity()).norm(), 1e-12);
    EXPECT_NEAR(T_map_base.linear().determinant(), 1.0, 1e-12);
    EXPECT_LT((T_map_base.linear().col(2) - ground.normal_map).norm(), 1e-12);
    EXPECT_NEAR(ground.heightOf(T_map_base.translation()), 0.0, 1e-12);
    EXPECT_EQ(T_map_base.translation().x(), pose.x_m);
    EXPECT_EQ(T_map_base.translation().y(), pose.y_m);
    const Eigen::Vector3d ahead = T_map_base.linear().col(0);
    EXPECT_NEAR(std::remainder(std::atan2(ahead.y(), ahead.x()) - pose.yaw_rad, 2.0 * M_PI), 0.0, 1e-12);
  }
  const Eigen::Isometry3d level = standOn(GroundPlane(), {1.0, 2.0, M_PI_2});
  EXPECT_LT((level.linear() * Eigen::Vector3d::UnitX() - Eigen::Vector3d::UnitY()).norm(), 1e-12);
}

TEST(ManipulabilityScore, RefusesImpossibleConfigs) {
  EXPECT_THAT(problemsOf(ManipulabilityScoreConfig()), IsEmpty());
  ManipulabilityScoreConfig config;
  config.cell_m = 0.01;
  EXPECT_THAT(problemsOf(config), ElementsAre(HasSubstr("cell_m = 0.01 m, must be in [0.02, 0.2] m")));
  config = {};
  config.band_m = 0.024;
  EXPECT_THAT(problemsOf(config), ElementsAre(HasSubstr("band_m = 0.024 m, must be in [0.025, 0.2] m")));
  config.band_m = kNaN;
  EXPECT_THAT(problemsOf(config), ElementsAre(HasSubstr("band_m = nan m")));
  const FunctionScene scene = senselessScene();
  EXPECT_THROW(ManipulabilityScore(scene, {}, GroundPlane(), kMinHeight_m, armSectors(), armFoot(), config),
               std::invalid_argument);
  EXPECT_THROW(
      ManipulabilityScore(scene, {}, GroundPlane(), kNaN, armSectors(), armFoot(), ManipulabilityScoreConfig()),
      std::invalid_argument);
  Eigen::Isometry3d nowhere = armFoot();
  nowhere.translation().x() = kNaN;
  EXPECT_THROW(
      ManipulabilityScore(scene, {}, GroundPlane(), kMinHeight_m, armSectors(), nowhere, ManipulabilityScoreConfig()),
      std::invalid_argument);
}

}  // namespace
}  // namespace nbv_selection
