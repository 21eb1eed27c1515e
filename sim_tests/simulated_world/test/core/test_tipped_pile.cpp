// SPDX-License-Identifier: BSD-3-Clause
// Scenes that are no friend: bricks tipped out, walls, stacks that fall, decoys.
#include <algorithm>
#include <cmath>
#include <iostream>
#include <map>
#include <set>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

#include "brick_types.h"
#include "simulated_world/box_separation.h"
#include "simulated_world/pickable.h"
#include "simulated_world/settle.h"

namespace simulated_world {
namespace {

constexpr double kHoldingForce_N = 90.0;
const std::string kHead = "brick_type: brick\nrobot_start: {xy_m: [-5.0, 0.0]}\nmax_shift_m: 1.5\n";
const std::string kTipped = "tipped:\n  - {center_m: [0, 0], extent_m: [1.3, 1.3], bricks: 16}\n";

PileSceneConfig parse(const std::string& text) {
  return parsePileScene(text, "test.yaml", {plainBrick()}, kMaxBricks);
}

std::string refusalOf(const std::string& text) {
  try {
    parse(text);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "(accepted)";
}

testing::AssertionResult says(const std::string& message, const std::string& part) {
  return message.find(part) != std::string::npos
             ? testing::AssertionSuccess()
             : testing::AssertionFailure() << "no \"" << part << "\" in: " << message;
}

/// Of the face that looks up most.
double tiltOf(const BrickPlacement& brick) {
  return std::acos(std::min(1.0, brick.T_map_brick.linear().row(2).cwiseAbs().maxCoeff()));
}

bool isSame(const PileScene& a, const PileScene& b) {
  bool is_same = a.bricks.size() == b.bricks.size();
  for (std::size_t i = 0; is_same && i < a.bricks.size(); ++i) {
    is_same = a.bricks[i].id == b.bricks[i].id && a.bricks[i].decoy == b.bricks[i].decoy &&
              a.bricks[i].type.mass_kg == b.bricks[i].type.mass_kg &&
              a.bricks[i].type.plate_faces == b.bricks[i].type.plate_faces &&
              a.bricks[i].T_map_brick.matrix() == b.bricks[i].T_map_brick.matrix();
  }
  return is_same;
}

/// Bricks that fall when one of a pile at rest is gone: 5 cm or 15 degrees, as the judge counts.
std::set<int> fallenWithout(int id, std::vector<BrickPlacement>* bricks) {
  bricks->erase(std::remove_if(bricks->begin(), bricks->end(), [id](const auto& brick) { return brick.id == id; }),
                bricks->end());
  std::set<int> fallen;
  if (bricks->empty()) return fallen;
  BrickPhysics physics(*bricks, PhysicsOptions());
  physics.run(3.0);
  const std::vector<BrickPlacement> now = physics.bricks();
  for (std::size_t i = 0; i < now.size(); ++i) {
    const Eigen::Isometry3d moved = (*bricks)[i].T_map_brick.inverse() * now[i].T_map_brick;
    const double tilt_rad = Eigen::AngleAxisd(moved.linear()).angle();
    if (moved.translation().norm() > 0.05 || tilt_rad > 15.0 * M_PI / 180.0) fallen.insert(now[i].id);
  }
  *bricks = now;
  return fallen;
}

TEST(TippedPile, TheSameSeedGivesTheSamePileBitForBit) {
  const PileSceneConfig config = parse(kHead + kTipped + "decoys: {share: 0.25}\n");
  const PileScene a = settlePile(config, 4).scene;
  EXPECT_TRUE(isSame(a, settlePile(config, 4).scene));
  const PileScene other = settlePile(config, 5).scene;
  EXPECT_FALSE(isSame(a, other));
  for (std::size_t i = 0; i < a.bricks.size(); ++i) {
    EXPECT_NE(a.bricks[i].T_map_brick.matrix(), other.bricks[i].T_map_brick.matrix());
  }
}

TEST(TippedPile, BricksDropInAnyOrientation) {
  // Of axes spread evenly over the sphere, each third component is in [-1, 1] evenly: mean square 1/3.
  double sum = 0.0;
  int count = 0;
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    for (const BrickPlacement& brick : generateScene(parse(kHead + kTipped), seed).bricks) {
      sum += brick.T_map_brick.linear()(2, 0) * brick.T_map_brick.linear()(2, 0);
      ++count;
    }
  }
  EXPECT_EQ(count, 800);
  EXPECT_NEAR(sum / count, 1.0 / 3.0, 4.0 * 0.298 / std::sqrt(800.0));  // four standard deviations of the mean
}

class TippedWorlds : public testing::TestWithParam<const char*> {};

TEST_P(TippedWorlds, SettleAsAJumbleThatStaysPut) {
  const PileSceneConfig config = world(GetParam());
  const SettledPile pile = settlePile(config, 1);
  ASSERT_EQ(static_cast<int>(pile.scene.bricks.size()), config.numBricks());
  int tilted = 0;
  double highest_m = 0.0;
  for (const BrickPlacement& brick : pile.scene.bricks) {
    tilted += tiltOf(brick) > 10.0 * M_PI / 180.0 ? 1 : 0;
    highest_m = std::max(highest_m, brick.T_map_brick.translation().z());
    for (const Wall& wall : pile.scene.walls) {
      EXPECT_GT(boxSeparation(brick.T_map_brick, brick.type.size_m, wall.pose(), wall.size_m), -0.005);
    }
  }
  std::cout << GetParam() << ": " << pile.attempts << " attempts, " << pile.settle_time_s << " s, " << tilted << " of "
            << pile.scene.bricks.size() << " tilted, the highest at " << highest_m << " m\n";
  for (const std::string& refusal : pile.refusals) std::cout << "  " << refusal << "\n";
  if (pile.scene.bricks.size() >= 20) {
    EXPECT_GE(10 * tilted, static_cast<int>(pile.scene.bricks.size()));  // layers have none
    EXPECT_GT(highest_m, 0.3) << "nothing lies on anything";
  }
  BrickPhysics physics(pile.scene.bricks, PhysicsOptions(), pile.scene.walls);
  physics.run(2.0);
  const std::vector<BrickPlacement> now = physics.bricks();
  for (std::size_t i = 0; i < now.size(); ++i) {
    EXPECT_LT((now[i].T_map_brick.translation() - pile.scene.bricks[i].T_map_brick.translation()).norm(), 0.01)
        << "brick " << i;
  }
}

INSTANTIATE_TEST_SUITE_P(Shipped, TippedWorlds,
                         testing::Values("tipped_20", "tipped_40", "tipped_80", "tipped_stack", "against_wall",
                                         "in_corner", "decoys", "plain_mixed"));

TEST(Stacks, FallWhenTheLowerBrickIsTakenFirstAndNotFromTheTop) {
  const PileSceneConfig config =
      parse(kHead + "stacks:\n  - {center_m: [0, 0], yaw_rad: 0.4, bricks: 3, overhang: 0.28}\n");
  const PileScene scene = settlePile(config, 1).scene;
  std::vector<BrickPlacement> by_height = scene.bricks;
  std::sort(by_height.begin(), by_height.end(), [](const auto& a, const auto& b) {
    return a.T_map_brick.translation().z() < b.T_map_brick.translation().z();
  });
  const int low = by_height[0].id;
  const int middle = by_height[1].id;
  const int high = by_height[2].id;

  std::vector<BrickPlacement> bricks = scene.bricks;
  EXPECT_EQ(fallenWithout(low, &bricks), (std::set<int>{middle, high}));
  bricks = scene.bricks;
  EXPECT_EQ(fallenWithout(middle, &bricks), std::set<int>{high});
  bricks = scene.bricks;
  EXPECT_TRUE(fallenWithout(high, &bricks).empty());
  EXPECT_TRUE(fallenWithout(middle, &bricks).empty());
  EXPECT_TRUE(fallenWithout(low, &bricks).empty());
}

TEST(Stacks, OfTheShippedWorldStandWithSeveralSeedsAndComeDownFromTheTop) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    std::vector<BrickPlacement> bricks = settlePile(world("precarious"), seed).scene.bricks;
    std::vector<BrickPlacement> order = bricks;
    std::sort(order.begin(), order.end(), [](const auto& a, const auto& b) {
      return a.T_map_brick.translation().z() > b.T_map_brick.translation().z();
    });
    for (const BrickPlacement& brick : order) EXPECT_TRUE(fallenWithout(brick.id, &bricks).empty()) << seed;
  }
}

TEST(Stacks, AStackThatWasHitIsRefused) {
  const PileScene scene = generateScene(world("precarious"), 1);
  std::vector<BrickPlacement> settled = scene.bricks;
  EXPECT_TRUE(faultsOfSettled(scene, settled, 0.05).empty());
  settled[2].T_map_brick.translation().z() -= 0.2;
  const std::vector<std::string> faults = faultsOfSettled(scene, settled, 0.05);
  ASSERT_EQ(faults.size(), 1U);
  EXPECT_TRUE(says(faults[0], "stacks: brick 2 is 0.2 m from its position, must be within 0.05 m"));
}

TEST(Decoys, AreAsManyAsAskedForAndTheWedgedOneCannotBePicked) {
  const PileSceneConfig config =
      parse(kHead + kTipped + "decoys: {untagged: 1, heavy: 2, two_plates: 1, wedged: 1, heavy_mass_kg: 12}\n");
  std::set<int> heavy_ones;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const PileScene scene = settlePile(config, seed).scene;
    std::map<Decoy, std::vector<BrickPlacement>> kinds;
    for (const BrickPlacement& brick : scene.bricks) kinds[brick.decoy].push_back(brick);
    ASSERT_EQ(kinds[Decoy::kUntagged].size(), 1U);
    ASSERT_EQ(kinds[Decoy::kHeavy].size(), 2U);
    ASSERT_EQ(kinds[Decoy::kTwoPlates].size(), 1U);
    ASSERT_EQ(kinds[Decoy::kWedged].size(), 1U);
    EXPECT_EQ(kinds[Decoy::kNone].size(), 11U);
    EXPECT_TRUE(kinds[Decoy::kUntagged][0].type.plate_faces.empty());
    EXPECT_EQ(kinds[Decoy::kTwoPlates][0].type.plate_faces.size(), 2U);
    for (const BrickPlacement& brick : kinds[Decoy::kHeavy]) {
      EXPECT_EQ(brick.type.mass_kg, 12.0);
      heavy_ones.insert(brick.id);
    }
    const int wedged = kinds[Decoy::kWedged][0].id;
    EXPECT_EQ(carriedBy(wedged, scene.bricks, Decoy::kHeavy).size(), 1U);

    const std::map<int, std::string> reasons = unpickable(scene.bricks, kHoldingForce_N);
    EXPECT_EQ(reasons.at(kinds[Decoy::kUntagged][0].id), "no tags");
    EXPECT_TRUE(says(reasons.at(kinds[Decoy::kHeavy][0].id), "12 kg, the magnet holds 90 N"));
    EXPECT_TRUE(says(reasons.at(wedged), "which stays"));
    EXPECT_GE(reasons.size(), 4U);
    EXPECT_LE(reasons.size(), 9U);  // and what lies under one of them
  }
  EXPECT_GT(heavy_ones.size(), 2U) << "the seed does not draw them";
}

TEST(Decoys, OtherBodiesAreAmongBricksOfThreeSizes) {
  const std::vector<BrickType> types = mp700_ur5e_description::loadBrickTypes(kThreeSizes).types;
  const PileScene scene = settlePile(world("plain_mixed"), 1).scene;
  std::map<Decoy, std::vector<BrickPlacement>> kinds;
  std::map<std::string, int> names;
  for (const BrickPlacement& brick : scene.bricks) {
    kinds[brick.decoy].push_back(brick);
    ++names[brick.type.name];
  }
  EXPECT_EQ(names, (std::map<std::string, int>{{"brick", 6}, {"half", 5}, {"slab", 5}}));
  EXPECT_EQ(kinds[Decoy::kNone].size(), 12U);
  EXPECT_EQ(kinds[Decoy::kSphere].size(), 1U);
  EXPECT_EQ(kinds[Decoy::kCylinder].size(), 1U);
  ASSERT_EQ(kinds[Decoy::kCardboard].size(), 2U);
  for (const BrickType& type : types) {  // by more than a detector's tolerance
    EXPECT_GT((kinds[Decoy::kCardboard][0].type.size_m - type.size_m).cwiseAbs().maxCoeff(), 0.03) << type.name;
  }
  const std::map<int, std::string> reasons = unpickable(scene.bricks, kHoldingForce_N);
  for (const Decoy kind : {Decoy::kCardboard, Decoy::kSphere, Decoy::kCylinder}) {
    for (const BrickPlacement& body : kinds[kind]) EXPECT_EQ(reasons.count(body.id), 1U) << toString(kind);
  }
}

TEST(Decoys, RoundOnesLieAtAnyTurn) {
  BrickPlacement sphere = brickAt(0, {0.0, 0.0, 0.1});
  sphere.decoy = Decoy::kSphere;
  sphere.type.size_m.setConstant(0.2);
  sphere.T_map_brick.rotate(Eigen::AngleAxisd(0.5, Eigen::Vector3d(1.0, 1.0, 0.0).normalized()));
  BrickPlacement cylinder = brickAt(1, {1.0, 0.0, 0.08});
  cylinder.decoy = Decoy::kCylinder;
  cylinder.type.size_m = {0.16, 0.16, 0.26};
  cylinder.T_map_brick.rotate(Eigen::AngleAxisd(0.5 * M_PI, Eigen::Vector3d::UnitX()));
  cylinder.T_map_brick.rotate(Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitZ()));
  BrickPhysics physics({sphere, cylinder}, PhysicsOptions());
  physics.run(2.0);
  const std::vector<BrickPlacement> now = physics.bricks();
  EXPECT_TRUE(now[0].T_map_brick.isApprox(sphere.T_map_brick, 0.005));  // boxes of the same sizes fall flat
  EXPECT_TRUE(now[1].T_map_brick.isApprox(cylinder.T_map_brick, 0.005));
}

TEST(Decoys, AShareIsSplitByKind) {
  const DecoyConfig six = DecoyConfig::fromShare(0.15, 40);
  EXPECT_EQ(six.total(), 6);
  EXPECT_EQ(six.untagged, 2);
  EXPECT_EQ(six.heavy, 2);
  EXPECT_EQ(six.two_plates, 1);
  EXPECT_EQ(six.wedged, 1);
  for (int bricks = 0; bricks < 98; ++bricks) {
    const DecoyConfig some = DecoyConfig::fromShare(0.2, bricks);
    EXPECT_EQ(some.total(), std::lround(0.2 * bricks));
    EXPECT_TRUE(some.validate().empty());
  }
}

TEST(Pickable, NeedsAPlateThatDoesNotLookDownAndNothingAboveThatStays) {
  std::vector<BrickPlacement> bricks = {brickAt(0, {0.0, 0.0, 0.1}), brickAt(1, {0.0, 0.0, 0.3}),
                                        brickAt(2, {0.0, 0.0, 0.5}), brickAt(3, {1.0, 0.0, 0.1})};
  EXPECT_TRUE(unpickable(bricks, kHoldingForce_N).empty());
  EXPECT_EQ(carriedBy(0, bricks), std::vector<int>{1});
  bricks[2].type.mass_kg = 9.3;  // 91 N
  std::map<int, std::string> reasons = unpickable(bricks, kHoldingForce_N);
  ASSERT_EQ(reasons.size(), 3U);
  EXPECT_EQ(reasons.at(1), "under brick 2, which stays");
  EXPECT_EQ(reasons.at(0), "under brick 1, which stays");
  bricks[2].type.mass_kg = 9.1;  // 89 N
  EXPECT_TRUE(unpickable(bricks, kHoldingForce_N).empty());

  using mp700_ur5e_description::BrickFace;
  bricks[3].type.plate_faces = {BrickFace::kMinusZ};
  EXPECT_EQ(unpickable(bricks, kHoldingForce_N).at(3), "no plate but below");
  bricks[3].type.plate_faces = {BrickFace::kMinusZ, BrickFace::kPlusX};
  EXPECT_TRUE(unpickable(bricks, kHoldingForce_N).empty());
}

TEST(SceneLoader, RefusesWithKeyValueAndRange) {
  EXPECT_EQ(refusalOf(kHead + kTipped), "(accepted)");
  const auto with = [](const std::string& more) { return refusalOf(kHead + kTipped + more); };
  EXPECT_TRUE(says(refusalOf(kHead + "tipped:\n  - {center_m: [0, 0], extent_m: [1, 1], bricks: 0}\n"),
                   "tipped[0]/bricks = 0, must be an integer in [1, 10000]"));
  EXPECT_TRUE(says(refusalOf(kHead + "tipped:\n  - {center_m: [0, 0], extent_m: [1, 0.3], bricks: 3}\n"),
                   "tipped[0]/extent_m, must be at least 0.41"));
  EXPECT_TRUE(says(refusalOf(kHead + "tipped:\n  - {center_m: [0, 0], bricks: 3}\n"), "tipped[0]/extent_m"));
  EXPECT_TRUE(
      says(refusalOf(kHead + "tipped:\n  - {center_m: [0, 0], extent_m: [1, 1], bricks: 3, drop_height_m: 9}\n"),
           "tipped[0]/drop_height_m = 9 m, must be in [0.01, 5] m"));
  EXPECT_TRUE(says(refusalOf(kHead + "tipped:\n  - {center_m: [0, 0], extent_m: [9, 9], bricks: 98}\n"),
                   "tipped = 98 bricks, must be at most 97"));
  EXPECT_TRUE(says(refusalOf(kHead + "stacks:\n  - {center_m: [0, 0], bricks: 3, overhang: 0.34}\n"),
                   "stacks[0]/overhang = 0.340000, must be in [0, 1 / bricks)"));
  EXPECT_TRUE(says(refusalOf(kHead + "stacks:\n  - {center_m: [0, 0], bricks: 1}\n"),
                   "stacks[0]/bricks = 1, must be an integer in [2, 10]"));
  EXPECT_TRUE(says(with("walls:\n  - {center_m: [1, 0], size_m: [0.2, 3, -1]}\n"), "walls[0]/size_m"));
  EXPECT_TRUE(says(with("walls:\n  - {center_m: [0.7, 0], size_m: [0.2, 3, 2]}\n"), "walls[0] overlap by"));
  EXPECT_TRUE(
      says(with("walls:\n  - {center_m: [-4.5, 0], size_m: [0.2, 3, 2]}\n"), "from a wall, must be at least 1"));
  EXPECT_TRUE(says(with("decoys: {share: 1.5}\n"), "decoys/share = 1.5, must be in [0, 1]"));
  EXPECT_TRUE(says(with("decoys: {share: 0.1, heavy: 1}\n"), "must be given, or share, but not both"));
  EXPECT_TRUE(says(with("decoys: {heavy: 1, wedged: 2}\n"), "wedged = 2, must be at most heavy = 1"));
  EXPECT_TRUE(says(with("decoys: {untagged: 17}\n"), "decoys = 17, must be at most 16"));
  EXPECT_TRUE(says(with("decoys: {heavy: 9, wedged: 9}\n"), "decoys/wedged = 9, must be at most half"));
  EXPECT_TRUE(says(with("decoys: {ghost: 1}\n"), "decoys/ghost is unknown"));
  EXPECT_TRUE(says(with("decoys: {sphere: -1}\n"), "decoys/sphere = -1, must be an integer in [0, 10000]"));
  EXPECT_TRUE(says(with("decoys: {share: 0.1, cardboard: 1}\n"), "decoys/cardboard = a number beside share"));
  EXPECT_TRUE(says(with("decoys: {cardboard: 9, cylinder: 8}\n"), "decoys = 17, must be at most 16"));
  const auto withTypes = [](const std::string& types) {
    return refusalOf(kHead + "tipped:\n  - {center_m: [0, 0], extent_m: [1, 1], bricks: 3, brick_types: " + types +
                     "}\n");
  };
  EXPECT_EQ(withTypes("[brick, brick]"), "(accepted)");
  EXPECT_TRUE(says(withTypes("[brick, cube]"), "tipped[0]/brick_types = cube, must be a list of: brick"));
  EXPECT_TRUE(says(withTypes("brick"), "tipped[0]/brick_types = brick, must be a list of words"));
  EXPECT_TRUE(says(with("bricks:\n  - {id: 0, xyz_m: [3, 0, 0.1]}\n"), "not both"));
  EXPECT_TRUE(says(refusalOf(kHead + "walls:\n  - {center_m: [0.7, 0], size_m: [0.2, 3, 2]}\n"), "must be given"));
}

}  // namespace
}  // namespace simulated_world
