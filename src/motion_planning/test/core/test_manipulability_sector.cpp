// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/manipulability_sector.h"

#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>
#include <mp700_ur5e_description/robot_names.h>

#include "motion_planning/collision_checker.h"
#include "support/urdf_text.h"

namespace motion_planning {
namespace {

using mp700_ur5e_description::RobotModel;
using test_support::messageOf;
using testing::AllOf;
using testing::HasSubstr;

constexpr double kDegree = M_PI / 180.0;
const std::string kSectorsFile = MOTION_PLANNING_DIR "/config/manipulability_sectors.yaml";

std::shared_ptr<const RobotModel> shippedRobot() {
  static const auto kRobot = RobotModel::load(kUrdfFile);
  return kRobot;
}

/// Bounds on the grid of the default configuration.
AnnulusSector knownSector() {
  return {0.30, 0.80, -0.40, 0.35, 70.0 * kDegree};
}

Eigen::Vector3d pointAt(double radius_m, double bearing_rad, double height_m) {
  return {radius_m * std::cos(bearing_rad), radius_m * std::sin(bearing_rad), height_m};
}

/// Evenly over a sector; `outside` of it within a larger one.
std::vector<ReachSample> samplesIn(const AnnulusSector& sector, int count, std::mt19937_64& rng,
                                   ApproachKind kind = ApproachKind::kTop) {
  const auto draw = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(rng); };
  std::vector<ReachSample> samples;
  for (int i = 0; i < count; ++i) {
    samples.push_back(
        {pointAt(draw(sector.min_radius_m, sector.max_radius_m), draw(-sector.half_angle_rad, sector.half_angle_rad),
                 draw(sector.min_height_m, sector.max_height_m)),
         0.05, kind});
  }
  return samples;
}

void append(const std::vector<ReachSample>& more, std::vector<ReachSample>* samples) {
  samples->insert(samples->end(), more.begin(), more.end());
}

void expectNear(const AnnulusSector& a, const AnnulusSector& b, double tolerance_m, double tolerance_rad) {
  EXPECT_NEAR(a.min_radius_m, b.min_radius_m, tolerance_m);
  EXPECT_NEAR(a.max_radius_m, b.max_radius_m, tolerance_m);
  EXPECT_NEAR(a.min_height_m, b.min_height_m, tolerance_m);
  EXPECT_NEAR(a.max_height_m, b.max_height_m, tolerance_m);
  EXPECT_NEAR(a.half_angle_rad, b.half_angle_rad, tolerance_rad);
}

// 14 bearings x 10 radii x 15 heights: 2100 cells, 50 samples in each.
constexpr int kMany = 105000;
constexpr double kExact = 1e-9;  // bounds on the grid are found on the grid

TEST(FitSector, FindsAKnownSector) {
  std::mt19937_64 rng(1);
  const SectorFit fit = fitSector(samplesIn(knownSector(), kMany, rng), ApproachKind::kTop, {});
  expectNear(fit.sector, knownSector(), kExact, kExact);
  EXPECT_DOUBLE_EQ(fit.fill, 1.0);
  EXPECT_DOUBLE_EQ(fit.share_of_reach, 1.0);
}

TEST(FitSector, OutliersChangeNothing) {
  std::mt19937_64 rng(2);
  std::vector<ReachSample> samples = samplesIn(knownSector(), kMany, rng);
  append(samplesIn({0.0, 1.5, -1.0, 1.2, M_PI}, kMany / 20, rng), &samples);
  const SectorFit fit = fitSector(samples, ApproachKind::kTop, {});
  expectNear(fit.sector, knownSector(), kExact, kExact);
}

TEST(FitSector, HolesDoNotBreakIt) {
  std::mt19937_64 rng(3);
  std::vector<ReachSample> samples;
  for (const ReachSample& sample : samplesIn(knownSector(), kMany, rng)) {
    const Eigen::Vector3d& p = sample.tip_armbase;
    const bool is_in_hole = std::abs(p.z()) < 0.1 && std::abs(p.head<2>().norm() - 0.55) < 0.1 && p.y() > 0.0;
    if (!is_in_hole) samples.push_back(sample);
  }
  const SectorFit fit = fitSector(samples, ApproachKind::kTop, {});
  expectNear(fit.sector, knownSector(), kExact, kExact);
  // The hole is 4 of 15 heights, 4 of 10 radii about the mean radius, one of two sides.
  EXPECT_NEAR(fit.fill, 1.0 - 4.0 / 15.0 * 4.0 / 10.0 / 2.0, 0.02);
}

TEST(FitSector, ThinlyReachedFringesAreLeftOut) {
  std::mt19937_64 rng(4);
  std::vector<ReachSample> samples = samplesIn(knownSector(), kMany, rng);
  // A fringe outside of which every other bearing is reached, half of min_fill's 0.7 and more short.
  for (const ReachSample& sample : samplesIn({0.8, 1.0, -0.4, 0.35, 70.0 * kDegree}, kMany / 2, rng)) {
    const double bearing_rad = std::atan2(sample.tip_armbase.y(), sample.tip_armbase.x());
    if (static_cast<int>(std::abs(bearing_rad) / (10.0 * kDegree)) % 2 == 0) samples.push_back(sample);
  }
  expectNear(fitSector(samples, ApproachKind::kTop, {}).sector, knownSector(), kExact, kExact);
  ManipulabilityConfig generous;
  generous.min_fill = 0.4;
  EXPECT_NEAR(fitSector(samples, ApproachKind::kTop, generous).sector.max_radius_m, 1.0, kExact);
}

TEST(FitSector, IsAsWideAsBothSidesAre) {
  std::mt19937_64 rng(5);
  std::vector<ReachSample> samples;
  for (const ReachSample& sample : samplesIn(knownSector(), kMany, rng)) {
    if (sample.tip_armbase.y() < 0.0 || std::atan2(sample.tip_armbase.y(), sample.tip_armbase.x()) < 30.0 * kDegree) {
      samples.push_back(sample);
    }
  }
  EXPECT_NEAR(fitSector(samples, ApproachKind::kTop, {}).sector.half_angle_rad, 30.0 * kDegree, kExact);
}

TEST(FitSector, IsNoWiderThanAskedFor) {
  std::mt19937_64 rng(6);
  AnnulusSector around = knownSector();
  around.half_angle_rad = M_PI;
  const std::vector<ReachSample> samples = samplesIn(around, 3 * kMany, rng);
  EXPECT_NEAR(fitSector(samples, ApproachKind::kTop, {}).sector.half_angle_rad, M_PI_2, kExact);
  ManipulabilityConfig config;
  config.max_half_angle_rad = M_PI;
  EXPECT_NEAR(fitSector(samples, ApproachKind::kTop, config).sector.half_angle_rad, M_PI, kExact);
}

TEST(FitSector, KindsAreKeptApart) {
  std::mt19937_64 rng(7);
  AnnulusSector other = knownSector();
  other.min_radius_m = 0.5;
  other.max_height_m = 0.6;
  std::vector<ReachSample> samples = samplesIn(knownSector(), kMany, rng);
  append(samplesIn(other, kMany, rng, ApproachKind::kSide), &samples);
  expectNear(fitSector(samples, ApproachKind::kTop, {}).sector, knownSector(), kExact, kExact);
  expectNear(fitSector(samples, ApproachKind::kSide, {}).sector, other, kExact, kExact);
}

TEST(FitSector, RefusesNothingAndNonsense) {
  EXPECT_THROW(fitSector({}, ApproachKind::kTop, {}), std::runtime_error);
  std::mt19937_64 rng(8);
  EXPECT_THROW(fitSector(samplesIn(knownSector(), 1000, rng), ApproachKind::kSide, {}), std::runtime_error);
  ManipulabilityConfig bad;
  bad.cell_m = 0.0;
  bad.min_fill = 1.0;
  bad.joint_step_rad = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(messageOf<std::invalid_argument>(
                  [&] { fitSector(samplesIn(knownSector(), 1000, rng), ApproachKind::kTop, bad); }),
              AllOf(HasSubstr("cell_m = 0 m"), HasSubstr("min_fill = 1,"), HasSubstr("joint_step_rad")));
}

TEST(AnnulusSector, ContainsItsInside) {
  const AnnulusSector sector = knownSector();
  EXPECT_TRUE(sector.contains(pointAt(0.5, 0.0, 0.0)));
  EXPECT_TRUE(sector.contains(pointAt(0.31, 1.2, 0.34)));
  EXPECT_TRUE(sector.contains(pointAt(0.79, -1.2, -0.39)));
  EXPECT_FALSE(sector.contains(pointAt(0.29, 0.0, 0.0)));
  EXPECT_FALSE(sector.contains(pointAt(0.81, 0.0, 0.0)));
  EXPECT_FALSE(sector.contains(pointAt(0.5, 0.0, 0.36)));
  EXPECT_FALSE(sector.contains(pointAt(0.5, 0.0, -0.41)));
  EXPECT_FALSE(sector.contains(pointAt(0.5, 1.25, 0.0)));
  EXPECT_FALSE(sector.contains(pointAt(0.5, -1.25, 0.0)));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (int axis = 0; axis < 3; ++axis) {
    Eigen::Vector3d p = pointAt(0.5, 0.0, 0.0);
    p[axis] = nan;
    EXPECT_FALSE(sector.contains(p)) << axis;
  }
}

TEST(AnnulusSector, VolumeIsThatCountedByChance) {
  const AnnulusSector sector = knownSector();
  std::mt19937_64 rng(9);
  std::uniform_real_distribution<double> along(-1.0, 1.0);
  int inside = 0;
  constexpr int kDraws = 400000;
  for (int i = 0; i < kDraws; ++i) {
    if (sector.contains({along(rng), along(rng), along(rng)})) ++inside;
  }
  // Of a share p of n draws the standard deviation is sqrt(p (1 - p) / n), here 0.0032 m^3 of 8: four of them.
  EXPECT_NEAR(sector.volume(), 8.0 * inside / kDraws, 0.015);
}

TEST(SampleReach, KeepsWhatTouchesFacesWellAndIsFree) {
  const auto arm = std::make_shared<ArmKinematics>(shippedRobot());
  ManipulabilityConfig config;
  config.joint_step_rad = 30.0 * kDegree;
  // Free: elbow up only, which half of the postures are.
  std::size_t asked = 0;
  const auto samples = sampleReach(*arm, config, [&](const ArmVector& q) {
    ++asked;
    EXPECT_TRUE(arm->isWithinLimits(q));
    EXPECT_GE(arm->manipulability(q), config.min_manipulability_m3 - 1e-12);
    const Eigen::Vector3d tool = arm->tipPose(q).linear().col(2);
    const double from_down_rad = std::acos(std::clamp(-tool.z(), -1.0, 1.0));
    EXPECT_TRUE(from_down_rad <= config.cone_rad + 1e-9 || std::abs(from_down_rad - M_PI_2) <= config.cone_rad + 1e-9);
    return q[2] > 0.0;
  });
  EXPECT_GT(samples.size(), 1000u);
  // The two elbows reach alike but for where the grid of angles falls.
  EXPECT_NEAR(static_cast<double>(samples.size()) / static_cast<double>(asked), 0.5, 0.1);
}

// Brute force over all five joints, with none of the short cuts.
TEST(SampleReach, IsWhatBruteForceFinds) {
  const auto arm = std::make_shared<ArmKinematics>(shippedRobot());
  ManipulabilityConfig config;
  config.joint_step_rad = 36.0 * kDegree;
  const auto samples = sampleReach(*arm, config, [](const ArmVector&) { return true; });
  const Eigen::Isometry3d T_armbase_base = shippedRobot()->poseInBody(mp700_ur5e_description::kArmBaseFrame).inverse();
  std::size_t tops = 0, sides = 0;
  for (int code = 0; code < 100000; ++code) {
    ArmVector q = ArmVector::Zero();
    int digits = code;
    for (int joint = 0; joint < 5; ++joint, digits /= 10) q[joint] = -M_PI + (digits % 10 + 0.5) * M_PI / 5.0;
    if (arm->manipulability(q) < config.min_manipulability_m3) continue;
    const Eigen::Isometry3d T = T_armbase_base * arm->tipPose(q);
    const Eigen::Vector3d tool = T.linear().col(2);
    if (-tool.z() >= std::cos(config.cone_rad)) ++tops;
    const bool is_level = std::abs(tool.z()) <= std::sin(config.cone_rad);
    const Eigen::Vector2d outward = T.translation().head<2>().normalized();
    if (is_level && tool.head<2>().normalized().dot(outward) >= std::cos(config.facing_rad)) ++sides;
  }
  std::size_t found_tops = 0;
  for (const ReachSample& sample : samples) found_tops += sample.kind == ApproachKind::kTop ? 1 : 0;
  EXPECT_GT(tops, 100u);
  EXPECT_GT(sides, 100u);
  EXPECT_EQ(found_tops, tops);
  EXPECT_EQ(samples.size() - found_tops, sides);
}

ManipulabilitySectors shippedSectors() {
  return ManipulabilitySectors::load(kSectorsFile, *shippedRobot());
}

TEST(ShippedSectors, AreOfTheShippedRobotAndDefaults) {
  const ManipulabilitySectors sectors = shippedSectors();  // throws if stale
  const ManipulabilityConfig defaults;
  EXPECT_NEAR(sectors.config.joint_step_rad, defaults.joint_step_rad, 1e-12);
  EXPECT_NEAR(sectors.config.min_manipulability_m3, defaults.min_manipulability_m3, 1e-12);
  EXPECT_NEAR(sectors.config.cone_rad, defaults.cone_rad, 1e-12);
  EXPECT_NEAR(sectors.config.facing_rad, defaults.facing_rad, 1e-12);
  EXPECT_NEAR(sectors.config.max_half_angle_rad, defaults.max_half_angle_rad, 1e-12);
  EXPECT_NEAR(sectors.config.cell_m, defaults.cell_m, 1e-12);
  EXPECT_NEAR(sectors.config.min_density, defaults.min_density, 1e-12);
  EXPECT_NEAR(sectors.config.min_fill, defaults.min_fill, 1e-12);
}

/// As fit_manipulability does it.
std::vector<ReachSample> sampleShipped(const ManipulabilityConfig& config) {
  const auto arm = std::make_shared<ArmKinematics>(shippedRobot());
  const CollisionSceneBuilder scene_builder{CollisionSceneConfig()};
  const CollisionChecker checker(arm, scene_builder.scene(), Eigen::Isometry3d::Identity());
  return sampleReach(*arm, config, [&](const ArmVector& q) { return checker.isFree(q); });
}

TEST(ShippedSectors, CoarserStepsGiveAboutTheSame) {
  ManipulabilityConfig config;
  config.joint_step_rad = 15.0 * kDegree;  // a fifth of the samples
  const std::vector<ReachSample> samples = sampleShipped(config);
  const ManipulabilitySectors shipped = shippedSectors();
  for (const ApproachKind kind : {ApproachKind::kTop, ApproachKind::kSide}) {
    SCOPED_TRACE(toString(kind));
    const SectorFit fit = fitSector(samples, kind, config);
    // A cell: borders fall on one side or the other of it; a bin.
    expectNear(fit.sector, shipped.of(kind), config.cell_m + kExact, 15.0 * kDegree);
    EXPECT_GT(fit.fill, 0.9);
  }
}

// What the sector is for: where it says yes there mostly is a way to touch the face.
TEST(ShippedSectors, InsideThemFacesAreReached) {
  const ManipulabilitySectors sectors = shippedSectors();
  const auto arm = std::make_shared<ArmKinematics>(shippedRobot());
  const Eigen::Isometry3d T_base_armbase = shippedRobot()->poseInBody(mp700_ur5e_description::kArmBaseFrame);
  const CollisionSceneBuilder scene_builder{CollisionSceneConfig()};
  const CollisionChecker checker(arm, scene_builder.scene(), Eigen::Isometry3d::Identity());
  std::mt19937_64 rng(12);
  const auto draw = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(rng); };
  struct Face {
    double tilt_rad;   // of the normal, from up
    double aside_rad;  // of its heading, from towards the arm
    int least_reached;
  };
  constexpr int kFaces = 200;
  // Sectors are where a tool tilted by up to the cone reaches. Its middle alone reaches less: 170, 178. Where both sectors
  // are, 196 and 184.
  for (const Face& face : {Face{0.0, 0.0, 150}, Face{M_PI_2, 0.0, 150}, Face{0.25 * M_PI, 0.0, 180},
                           Face{0.25 * M_PI, 0.5 * M_PI - kExact, 165}}) {
    SCOPED_TRACE(face.tilt_rad);
    const AnnulusSector& sector = face.tilt_rad > 0.0 ? sectors.side : sectors.top;
    int reached = 0;
    for (int faces = 0; faces < kFaces;) {
      const double bearing_rad = draw(-sector.half_angle_rad, sector.half_angle_rad);
      // Even over the volume.
      const double radius_m = std::sqrt(draw(std::pow(sector.min_radius_m, 2), std::pow(sector.max_radius_m, 2)));
      const Eigen::Vector3d point = pointAt(radius_m, bearing_rad, draw(sector.min_height_m, sector.max_height_m));
      const Eigen::Vector3d heading = pointAt(1.0, bearing_rad + M_PI + face.aside_rad, 0.0);
      const Eigen::Vector3d normal(std::sin(face.tilt_rad) * heading +
                                   std::cos(face.tilt_rad) * Eigen::Vector3d::UnitZ());
      const bool is_between = face.tilt_rad > 0.0 && face.tilt_rad < M_PI_2;
      const bool is_admitted = sectors.admits(T_base_armbase * point, normal, T_base_armbase);
      ASSERT_EQ(is_admitted, !is_between || sectors.top.contains(point));
      if (!is_admitted) continue;
      ++faces;
      Eigen::Isometry3d T_base_tip = T_base_armbase * Eigen::Translation3d(point);
      T_base_tip.rotate(Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), -normal));
      for (const ArmVector& q : arm->inverse(T_base_tip, ArmVector::Zero())) {
        if (arm->manipulability(q) < sectors.config.min_manipulability_m3 || !checker.isFree(q)) continue;
        ++reached;
        break;
      }
    }
    EXPECT_GE(reached, face.least_reached) << "of " << kFaces;
  }
}

class Admits : public testing::Test {
 protected:
  Admits() : sectors_(shippedSectors()) {
    sectors_.top = knownSector();
    sectors_.side = knownSector();
    sectors_.side.min_radius_m = 0.5;
    T_base_armbase_ = Eigen::Translation3d(0.2, 0.0, 0.5) * Eigen::AngleAxisd(0.0, Eigen::Vector3d::UnitZ());
  }

  std::string reason(const Eigen::Vector3d& point_armbase, const Eigen::Vector3d& normal) const {
    std::string why_not;
    const bool is_admitted = sectors_.admits(T_base_armbase_ * point_armbase, normal, T_base_armbase_, &why_not);
    EXPECT_EQ(is_admitted, why_not.empty());
    EXPECT_EQ(is_admitted, sectors_.admits(T_base_armbase_ * point_armbase, normal, T_base_armbase_)) << "no sentence";
    return why_not;
  }

  static Eigen::Vector3d tilted(double from_up_deg, double heading_deg) {
    const double tilt = from_up_deg * kDegree, heading = heading_deg * kDegree;
    return {std::sin(tilt) * std::cos(heading), std::sin(tilt) * std::sin(heading), std::cos(tilt)};
  }

  ManipulabilitySectors sectors_;
  Eigen::Isometry3d T_base_armbase_;
};

TEST_F(Admits, TopFaces) {
  EXPECT_EQ(reason(pointAt(0.4, 0.5, 0.1), tilted(0.0, 0.0)), "");
  EXPECT_EQ(reason(pointAt(0.4, 0.5, 0.1), tilted(29.9, 200.0)), "");
  EXPECT_THAT(reason(pointAt(0.2, 0.5, 0.1), tilted(0.0, 0.0)),
              HasSubstr("top face: radius from the arm's axis = 0.2 m, must be in [0.3, 0.8] m"));
  EXPECT_THAT(reason(pointAt(0.4, 0.5, 0.5), tilted(0.0, 0.0)), HasSubstr("height above the arm's foot = 0.5 m"));
  EXPECT_THAT(reason(pointAt(0.4, -1.4, 0.1), tilted(0.0, 0.0)),
              HasSubstr("bearing = -80.2 deg, must be in [-70, 70]"));
}

TEST_F(Admits, SideFacesTowardsTheArm) {
  EXPECT_EQ(reason(pointAt(0.6, 0.0, 0.1), tilted(90.0, 180.0)), "");
  EXPECT_EQ(reason(pointAt(0.6, 0.0, 0.1), tilted(119.0, 180.0)), "") << "leaning over";
  EXPECT_EQ(reason(pointAt(0.6, 0.0, 0.1), tilted(61.0, 140.0)), "") << "leaning back, 40 deg aside";
  EXPECT_EQ(reason(pointAt(0.6, 1.0, 0.1), tilted(90.0, 180.0 + 1.0 / kDegree)), "") << "on the left";
  EXPECT_THAT(reason(pointAt(0.6, 0.0, 0.1), tilted(90.0, 130.0)),
              HasSubstr("the side face points 50 deg away from the arm, must be within 45 deg"));
  EXPECT_THAT(reason(pointAt(0.6, 0.0, 0.1), tilted(90.0, 0.0)), HasSubstr("points 180 deg away from the arm"));
  EXPECT_THAT(reason(pointAt(0.4, 0.0, 0.1), tilted(90.0, 180.0)), HasSubstr("side face: radius"))
      << "the side's sector, not the top's";
}

TEST_F(Admits, FacesBetweenInBothSectors) {
  EXPECT_EQ(reason(pointAt(0.6, 0.0, 0.1), tilted(45.0, 180.0)), "");
  EXPECT_EQ(reason(pointAt(0.6, 0.0, 0.1), tilted(45.0, 91.0)), "") << "nearly across";
  EXPECT_THAT(reason(pointAt(0.6, 0.0, 0.1), tilted(45.0, 89.0)),
              HasSubstr("points 91 deg away from the arm, must be within 90 deg"));
  EXPECT_THAT(reason(pointAt(0.4, 0.0, 0.1), tilted(45.0, 180.0)), HasSubstr("side face: radius"));
  sectors_.top.max_radius_m = 0.55;
  EXPECT_THAT(reason(pointAt(0.6, 0.0, 0.1), tilted(45.0, 180.0)), HasSubstr("top face: radius"));
}

TEST_F(Admits, NoOtherFaces) {
  EXPECT_THAT(reason(pointAt(0.6, 0.0, 0.1), tilted(180.0, 0.0)), HasSubstr("the face points 180 deg away from up"));
  EXPECT_THAT(reason(pointAt(0.6, 0.0, 0.1), tilted(130.0, 180.0)), HasSubstr("away from up"));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(reason(pointAt(nan, 0.0, 0.1), tilted(0.0, 0.0)), HasSubstr("not finite"));
  EXPECT_THAT(reason(pointAt(0.6, 0.0, 0.1), {nan, 0.0, 0.0}), HasSubstr("unit length"));
  EXPECT_THAT(reason(pointAt(0.6, 0.0, 0.1), Eigen::Vector3d::Zero()), HasSubstr("unit length"));
}

std::string refusalOf(const std::string& yaml) {
  return messageOf<std::invalid_argument>([&] { ManipulabilitySectors::parse(yaml, "sectors.yaml", *shippedRobot()); });
}

std::string replaced(std::string text, const std::string& what, const std::string& with) {
  const std::size_t at = text.find(what);
  if (at == std::string::npos) throw std::logic_error("no '" + what + "' in\n" + text);
  return text.replace(at, what.size(), with);
}

TEST(SectorsFile, SurvivesARoundTrip) {
  ManipulabilitySectors sectors = shippedSectors();
  sectors.top.min_radius_m = 0.123456789;
  sectors.side.half_angle_rad = 1.0;
  const ManipulabilitySectors read = ManipulabilitySectors::parse(sectors.toYaml(), "x", *shippedRobot());
  expectNear(read.top, sectors.top, 1e-9, 1e-8);
  expectNear(read.side, sectors.side, 1e-9, 1e-8);
  EXPECT_EQ(read.urdf_checksum, sectors.urdf_checksum);
  EXPECT_EQ(read.toYaml(), sectors.toYaml());
}

TEST(SectorsFile, StaleIsRefusedWithTheCommand) {
  const std::string urdf = readFile(kUrdfFile);
  const auto longer = RobotModel::parse(replaced(urdf, "xyz=\"-0.425 0 0\"", "xyz=\"-0.426 0 0\""), "longer arm");
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { ManipulabilitySectors::load(kSectorsFile, *longer); }),
              AllOf(HasSubstr("urdf_checksum"), HasSubstr(longer->checksum()),
                    HasSubstr("rosparam get -p robot_description > robot.urdf"),
                    HasSubstr("rosrun motion_planning fit_manipulability --urdf robot.urdf --out " +
                              std::string(kSectorsFile))));
}

TEST(SectorsFile, EveryKeyIsChecked) {
  const std::string good = shippedSectors().toYaml();
  ASSERT_EQ(refusalOf(good), "");
  for (const std::string key : {"urdf_checksum", "joint_step_rad", "min_manipulability_m3", "cone_rad", "facing_rad",
                                "max_half_angle_rad", "cell_m", "min_density", "min_fill", "min_radius_m",
                                "max_radius_m", "min_height_m", "max_height_m", "half_angle_rad"}) {
    // The key itself, not the end of a longer one.
    const std::string lead = key == "urdf_checksum" ? "\n" : "  ";
    const std::string missing = replaced(good, lead + key + ":", lead + key + "_:");
    EXPECT_THAT(refusalOf(missing), AllOf(HasSubstr(key + " = (missing)"), HasSubstr(key + "_ is unknown")));
    if (key == "urdf_checksum") continue;
    EXPECT_THAT(refusalOf(replaced(good, lead + key + ":", lead + key + ": word #")), HasSubstr("must be a number"));
    EXPECT_THAT(refusalOf(replaced(good, lead + key + ":", lead + key + ": 1e6 #")), HasSubstr(key)) << key;
    EXPECT_THAT(refusalOf(replaced(good, lead + key + ":", lead + key + ": .nan #")), HasSubstr(key)) << key;
  }
  EXPECT_THAT(refusalOf(replaced(good, "\nside:", "\nsides:")),
              AllOf(HasSubstr("side = (missing)"), HasSubstr("sides is unknown")));
  EXPECT_THAT(refusalOf(good + "more: 1\n"), HasSubstr("more is unknown"));
  EXPECT_NE(refusalOf(replaced(good, "  cone_rad:", "  cell_m: 0.05\n  cone_rad:")), "") << "given twice";
  EXPECT_THAT(refusalOf("{"), HasSubstr("not valid YAML"));
  EXPECT_THAT(refusalOf("[1]"), HasSubstr("must be a map"));
  EXPECT_THAT(refusalOf(""), HasSubstr("config = (missing)"));
  EXPECT_THROW(ManipulabilitySectors::load("/nowhere/sectors.yaml", *shippedRobot()), std::invalid_argument);
}

TEST(SectorsFile, BoundsMustBeInOrder) {
  ManipulabilitySectors sectors = shippedSectors();
  std::swap(sectors.top.min_radius_m, sectors.top.max_radius_m);
  std::swap(sectors.side.min_height_m, sectors.side.max_height_m);
  EXPECT_THAT(refusalOf(sectors.toYaml()), AllOf(HasSubstr("top/max_radius_m"), HasSubstr("side/max_height_m")));
}

}  // namespace
}  // namespace motion_planning
