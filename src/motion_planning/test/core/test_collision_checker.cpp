// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/collision_checker.h"

#include <functional>
#include <limits>
#include <map>
#include <random>
#include <thread>

#include <gmock/gmock.h>
#include <mp700_ur5e_description/robot_names.h>

#include "collision/robot_shapes.h"
#include "support/box_world.h"
#include "support/shape_samples.h"

namespace motion_planning {
namespace {

using mp700_ur5e_description::Box;
using mp700_ur5e_description::Shape;
using ::testing::HasSubstr;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

std::shared_ptr<const ArmKinematics> arm() {
  static const auto kArm = std::make_shared<const ArmKinematics>(
      mp700_ur5e_description::RobotModel::load(DESCRIPTION_DIR "/urdf/mp700_ur5e.urdf"));
  return kArm;
}

/// Folded over the deck, tool down: config/arm_poses/stowed.yaml of the description.
ArmVector stowed() {
  return (ArmVector() << 0.0, -2.0, 2.4, -1.9707963267948966, -1.5707963267948966, 0.0).finished();
}

ArmVector randomJoints(std::mt19937& engine) {
  std::uniform_real_distribution<double> angle(-M_PI, M_PI);
  return ArmVector::NullaryExpr([&] { return angle(engine); });
}

/// With the tip before the robot, where the obstacles are.
ArmVector randomJointsBefore(std::mt19937& engine) {
  for (;;) {
    const ArmVector joints = randomJoints(engine);
    if (arm()->tipPose(joints).translation().x() > 0.4) return joints;
  }
}

/// A base that stands askew in the map, so that no frame can be taken for another.
Eigen::Isometry3d baseAskew() {
  Eigen::Isometry3d T_map_base(Eigen::Translation3d(2.03, -1.01, 0.017));
  T_map_base.rotate(Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitZ()));
  return T_map_base;
}

OrientedBox boxInBase(const Eigen::Isometry3d& T_map_base, const Eigen::Vector3d& middle_base,
                      const Eigen::Vector3d& size_m, double turn_rad = 0.0) {
  OrientedBox box{T_map_base * Eigen::Translation3d(middle_base), size_m};
  box.T_map_box.rotate(Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitZ()));
  return box;
}

std::shared_ptr<const CollisionScene> sceneOf(const BoxWorld& world, const Eigen::Isometry3d& T_map_base,
                                              const CollisionSceneConfig& config = {}) {
  CollisionSceneBuilder builder(config);
  builder.update(world.surface(0.02), world, T_map_base);
  return builder.scene();
}

/// The robot without the code under test: each moving shape with dense points on its surface, in the map.
struct SampledShape {
  std::string link;
  std::size_t body;
  Shape shape;
  Eigen::Isometry3d T_map_shape;
  std::vector<Eigen::Vector3d> points_map;
};
std::vector<SampledShape> sampleRobot(const ArmVector& joints_rad, const Eigen::Isometry3d& T_map_base, bool moving,
                                      double step_m) {
  std::vector<Eigen::Isometry3d> T_base_body;
  arm()->robot().bodyPoses(arm()->robotPositions(joints_rad), &T_base_body);
  const std::size_t shoulder = arm()->jointIndices()[0] + 1;
  std::vector<SampledShape> result;
  for (const auto& part : arm()->robot().shapes()) {
    std::size_t body = part.body;
    while (body != 0 && body != shoulder) body = arm()->robot().parentBody(body);
    if ((body == shoulder) != moving) continue;
    SampledShape sampled{part.link, part.body, part.shape, T_map_base * T_base_body[part.body] * part.T_body_shape, {}};
    for (const Eigen::Vector3d& p : surfacePoints(part.shape, step_m)) {
      sampled.points_map.push_back(sampled.T_map_shape * p);
    }
    result.push_back(std::move(sampled));
  }
  return result;
}

double worldDistance(const BoxWorld& world, const std::vector<SampledShape>& robot) {
  double nearest_m = std::numeric_limits<double>::infinity();
  for (const SampledShape& shape : robot) {
    for (const Eigen::Vector3d& p : shape.points_map) nearest_m = std::min(nearest_m, world.distance(p));
  }
  return nearest_m;
}

/// Joint angles with the tip there, nearest to stowed. Fails the test if there are none that `accept` takes.
ArmVector jointsAt(
    const Eigen::Isometry3d& T_base_tip,
    const std::function<bool(const ArmVector&)>& accept = [](const ArmVector&) { return true; }) {
  for (const ArmVector& joints : arm()->inverse(T_base_tip, stowed())) {
    if (accept(joints)) return joints;
  }
  ADD_FAILURE() << "no posture reaches " << T_base_tip.translation().transpose();
  return stowed();
}

/// The tip at a place, its axis straight down, turned about it.
Eigen::Isometry3d toolDown(const Eigen::Vector3d& tip_base, double turn_rad = 0.0) {
  Eigen::Isometry3d T(Eigen::Translation3d{tip_base});
  T.rotate(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
  T.rotate(Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitZ()));
  return T;
}

/// Six boxes about the arm, none touching another: near the ground, at its height, above.
BoxWorld obstacles(const Eigen::Isometry3d& T_map_base) {
  BoxWorld world;
  world.boxes = {boxInBase(T_map_base, {0.85, 0.0, 0.15}, {0.3, 0.4, 0.3}, 0.3),
                 boxInBase(T_map_base, {0.75, 0.45, 0.5}, {0.2, 0.15, 0.4}, 1.0),
                 boxInBase(T_map_base, {0.7, -0.5, 0.7}, {0.25, 0.2, 0.15}, -0.4),
                 boxInBase(T_map_base, {0.45, 0.1, 1.35}, {0.3, 0.2, 0.2}, 0.8),
                 boxInBase(T_map_base, {0.2, -0.7, 0.4}, {0.2, 0.2, 0.2}, 0.1),
                 boxInBase(T_map_base, {0.95, 0.0, 0.85}, {0.08, 0.5, 0.08}, 0.5)};
  return world;
}

TEST(CollisionChecker, AgreesWithDenseSamplesOfRobotAndBoxes) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  const BoxWorld world = obstacles(T_map_base);
  const CollisionChecker checker(arm(), sceneOf(world, T_map_base), T_map_base);
  const double margin_m = 2.0 * 0.002 + 0.005;
  const double step_m = 0.012;
  // Faces are displaced by the margin, corners by sqrt(3) of it; between samples the robot may be nearer by a step.
  const double surely_free_m = std::sqrt(3.0) * margin_m + step_m + 1e-6;
  std::mt19937 engine(1);
  std::map<CollisionKind, int> found;
  int num_free = 0;
  int num_hit = 0;
  for (int i = 0; i < 1500; ++i) {
    const ArmVector joints = randomJointsBefore(engine);
    const Contact contact = checker.check(joints);
    ++found[contact.kind];
    const double truth_m = worldDistance(world, sampleRobot(joints, T_map_base, true, step_m));
    if (truth_m < margin_m - 1e-6) {  // directions of displacement are kept to 1e-6
      ++num_hit;
      EXPECT_TRUE(contact) << "free, but " << truth_m << " m from a box at " << joints.transpose();
    } else if (truth_m > surely_free_m) {
      ++num_free;
      EXPECT_THAT(contact.kind, ::testing::AnyOf(CollisionKind::kNone, CollisionKind::kSelf, CollisionKind::kFloor))
          << contact.describe() << ", but " << truth_m << " m from all boxes at " << joints.transpose();
    }
  }
  EXPECT_GT(num_hit, 300);
  EXPECT_GT(num_free, 400);
  EXPECT_GT(found[CollisionKind::kSurface], 100);
  EXPECT_GT(found[CollisionKind::kInside], 100);
  EXPECT_GT(found[CollisionKind::kNone], 100);
}

TEST(CollisionChecker, ClearanceIsTheDistanceToTheMappedSurface) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  const BoxWorld world = obstacles(T_map_base);
  const CollisionChecker checker(arm(), sceneOf(world, T_map_base), T_map_base);
  std::mt19937 engine(2);
  int num_inside = 0;
  int num_outside = 0;
  int num_limited = 0;
  const double step_m = 0.012;
  const double limit_m = 0.25;
  for (int i = 0; i < 400; ++i) {
    const ArmVector joints = randomJointsBefore(engine);
    const double truth_m = worldDistance(world, sampleRobot(joints, T_map_base, true, step_m));
    const double clearance_m = checker.clearance(joints, limit_m);
    EXPECT_LE(clearance_m, limit_m);
    if (truth_m > limit_m + step_m) {
      ++num_limited;
      EXPECT_EQ(clearance_m, limit_m);
    } else if (truth_m > 0.0) {
      ++num_outside;
      EXPECT_LE(clearance_m, truth_m + 1e-6);           // FCL's tolerance
      EXPECT_GE(clearance_m, truth_m - step_m - 1e-6);  // the nearest point of the robot may lie between samples
    } else {
      ++num_inside;
      EXPECT_LE(clearance_m, 0.0);
      // A block's middle or a point of the part's middle is no deeper than the deepest point.
      EXPECT_GE(clearance_m, truth_m - 0.05);
    }
  }
  EXPECT_GT(num_inside, 40);
  EXPECT_GT(num_outside, 50);
  EXPECT_GT(num_limited, 10);
  EXPECT_THROW(checker.clearance(stowed(), kNaN), std::invalid_argument);
  EXPECT_THROW(checker.clearance(ArmVector::Constant(kNaN), 0.1), std::invalid_argument);
}

TEST(CollisionChecker, FindsSelfCollisionsAndNoOthers) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  CollisionCheckerConfig config;
  config.floor_margin_m = -0.1;
  const CollisionChecker checker(arm(), CollisionSceneBuilder{{}}.scene(), T_map_base, config);
  EXPECT_FALSE(checker.check(stowed())) << checker.check(stowed()).describe();
  const mp700_ur5e_description::RobotModel& robot = arm()->robot();
  const double step_m = 0.012;
  // Padded corners stand out by sqrt(3), and the nearest points may lie between samples.
  const double surely_free_m = std::sqrt(3.0) * config.self_padding_m + step_m;
  std::mt19937 engine(3);
  std::map<std::pair<std::string, std::string>, int> found;
  int num_hit = 0;
  int num_free = 0;
  for (int i = 0; i < 600; ++i) {
    const ArmVector joints = randomJoints(engine);
    const Contact contact = checker.check(joints);
    if (contact.kind == CollisionKind::kFloor) continue;
    const std::vector<SampledShape> moving = sampleRobot(joints, T_map_base, true, step_m);
    std::vector<SampledShape> all = sampleRobot(joints, T_map_base, false, step_m);
    all.insert(all.end(), moving.begin(), moving.end());
    std::map<std::pair<std::string, std::string>, double> nearest_m;  // by links
    double nearest_of_all_m = std::numeric_limits<double>::infinity();
    for (const SampledShape& a : moving) {
      for (const SampledShape& b : all) {
        if (a.body == b.body || robot.parentBody(a.body) == b.body || robot.parentBody(b.body) == a.body) continue;
        if ((a.T_map_shape.translation() - b.T_map_shape.translation()).norm() >
            boundingRadius(a.shape) + boundingRadius(b.shape) + 0.1) {
          continue;
        }
        double& pair_m = nearest_m.emplace(std::make_pair(a.link, b.link), 1.0).first->second;
        const Eigen::Isometry3d T_b_map = b.T_map_shape.inverse();
        for (const Eigen::Vector3d& p : a.points_map) pair_m = std::min(pair_m, signedDistance(b.shape, T_b_map * p));
        nearest_of_all_m = std::min(nearest_of_all_m, pair_m);
      }
    }
    if (nearest_of_all_m < config.self_padding_m) {
      ++num_hit;
      EXPECT_EQ(contact.kind, CollisionKind::kSelf) << nearest_of_all_m << " m at " << joints.transpose();
    }
    if (contact) {
      ++found[{contact.first, contact.second}];
      ASSERT_EQ(nearest_m.count({contact.first, contact.second}), 1u) << contact.describe();
      EXPECT_LT(nearest_m.at({contact.first, contact.second}), surely_free_m) << contact.describe();
    } else {
      ++num_free;
    }
  }
  EXPECT_GT(num_hit, 80);
  EXPECT_GT(num_free, 80);
  EXPECT_GT(found.size(), 6u);
}

TEST(CollisionChecker, KeepsJointLimitsAndRefusesWhatIsNotFinite) {
  const CollisionChecker checker(arm(), CollisionSceneBuilder{{}}.scene(), baseAskew());
  for (Eigen::Index j = 0; j < 6; ++j) {
    ArmVector joints = stowed();
    joints[j] = arm()->limits().upper_rad[j] + 1e-6;
    EXPECT_EQ(checker.check(joints).kind, CollisionKind::kLimits);
    EXPECT_EQ(checker.check(joints).first, mp700_ur5e_description::kArmJoints[static_cast<std::size_t>(j)]);
    for (const double beyond_rad : {0.0, 5e-10}) {  // a limit that was computed is still within
      joints[j] = arm()->limits().upper_rad[j] + beyond_rad;
      EXPECT_NE(checker.check(joints).kind, CollisionKind::kLimits);
      joints[j] = arm()->limits().lower_rad[j] - beyond_rad;
      EXPECT_NE(checker.check(joints).kind, CollisionKind::kLimits);
    }
    joints[j] = kNaN;
    EXPECT_EQ(checker.check(joints).kind, CollisionKind::kLimits);
    joints[j] = -std::numeric_limits<double>::infinity();
    EXPECT_EQ(checker.check(joints).kind, CollisionKind::kLimits);
  }
}

TEST(CollisionChecker, KeepsTheFloorMarginToAMillimetre) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  const CollisionChecker checker(arm(), CollisionSceneBuilder{{}}.scene(), T_map_base);
  const double margin_m = CollisionCheckerConfig().floor_margin_m;
  for (const double tilt_rad : {0.0, 0.3, 0.6}) {
    for (const double above_m : {-0.001, 0.001}) {
      // A cylinder of radius 0.03 tilted about its end's middle: the rim is 0.03 sin(tilt) lower.
      Eigen::Isometry3d T_base_tip = toolDown({0.75, 0.1, margin_m + above_m + 0.03 * std::sin(tilt_rad)});
      T_base_tip.rotate(Eigen::AngleAxisd(tilt_rad, Eigen::Vector3d::UnitX()));
      const Contact contact = checker.check(jointsAt(T_base_tip));
      EXPECT_EQ(contact.kind, above_m > 0.0 ? CollisionKind::kNone : CollisionKind::kFloor) << contact.describe();
      EXPECT_EQ(contact.first, above_m > 0.0 ? "" : "magnet");
    }
  }
}

/// Triangles that any part of the arm comes near to are left out of the mesh.
Surface withoutTrianglesNear(const Surface& surface, const std::vector<SampledShape>& robot, double distance_m) {
  Surface result = surface;
  result.triangles.clear();
  for (const auto& triangle : surface.triangles) {
    const Eigen::Vector3d p = surface.vertices_map[triangle[0]];
    const bool is_near = std::any_of(robot.begin(), robot.end(), [&](const SampledShape& shape) {
      return signedDistance(shape.shape, shape.T_map_shape.inverse() * p) < distance_m;
    });
    if (!is_near) result.triangles.push_back(triangle);
  }
  return result;
}

TEST(CollisionChecker, NoPartMayBeInsideWhereNoTriangleIsNear) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  std::mt19937 engine(4);
  std::uniform_real_distribution<double> shift(-0.02, 0.02);
  int num_tested = 0;
  for (int i = 0; i < 25; ++i) {
    // About the magnet alone, which is thinner than two blocks.
    const ArmVector joints =
        jointsAt(toolDown({0.7 + shift(engine), shift(engine), 0.5 + shift(engine)}, 10.0 * shift(engine)));
    const Eigen::Isometry3d T_map_tip = T_map_base * arm()->tipPose(joints);
    const std::vector<SampledShape> robot = sampleRobot(joints, T_map_base, true, 0.02);
    BoxWorld world;
    world.boxes = {{T_map_tip * Eigen::Translation3d(0.0, 0.0, -0.02), {0.20, 0.20, 0.16}}};
    CollisionSceneBuilder builder{CollisionSceneConfig()};
    builder.update(withoutTrianglesNear(world.surface(0.02), robot, 0.045), world, T_map_base);
    const CollisionChecker checker(arm(), builder.scene(), T_map_base);
    const Contact contact = checker.check(joints);
    ASSERT_EQ(contact.kind, CollisionKind::kInside) << contact.describe();
    EXPECT_EQ(contact.first, "magnet");
    EXPECT_LT(checker.clearance(joints, 0.5), -0.03);
    ++num_tested;
    // So deep that the map does not know how deep: unseen space under the pile's top.
    world.boxes = {{T_map_tip * Eigen::Translation3d(0.0, 0.0, 0.1), {0.6, 0.6, 0.7}}};
    builder.update(withoutTrianglesNear(world.surface(0.02), robot, 0.1), world, T_map_base);
    EXPECT_THAT(CollisionChecker(arm(), builder.scene(), T_map_base).check(joints).kind,
                ::testing::AnyOf(CollisionKind::kInside, CollisionKind::kUnknown));
  }
  EXPECT_EQ(num_tested, 25);
}

TEST(CollisionChecker, UnknownSpaceNearThePileIsInTheWayUntilTheArmWasThere) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  BoxWorld world;
  world.boxes = {boxInBase(T_map_base, {0.70, 0.0, 0.1}, {0.3, 0.4, 0.2})};
  const Eigen::Isometry3d T_base_map = T_map_base.inverse();
  world.is_unknown = [=](const Eigen::Vector3d& p) { return (T_base_map * p).x() > 0.85; };
  CollisionChecker checker(arm(), sceneOf(world, T_map_base), T_map_base);
  const ArmVector behind = jointsAt(toolDown({0.93, 0.0, 0.15}));
  const ArmVector above = jointsAt(toolDown({0.75, 0.0, 0.3}));
  const ArmVector far = jointsAt(toolDown({0.8, 0.0, 0.75}));
  EXPECT_EQ(checker.check(behind).kind, CollisionKind::kUnknown);
  EXPECT_FALSE(checker.check(above)) << checker.check(above).describe();
  EXPECT_FALSE(checker.check(far)) << checker.check(far).describe();

  CollisionChecker untouched = checker;
  checker.freeUnknownAt(behind);
  EXPECT_FALSE(checker.check(behind)) << checker.check(behind).describe();
  EXPECT_EQ(untouched.check(behind).kind, CollisionKind::kUnknown);
  EXPECT_FALSE(CollisionChecker(checker).check(behind));
  // What the arm did not fill stays unknown.
  EXPECT_EQ(checker.check(jointsAt(toolDown({0.93, 0.15, 0.15}))).kind, CollisionKind::kUnknown);

  // A watched path may come nearer to it by the tolerance, and no more.
  CollisionCheckerConfig watched;
  watched.unknown_tolerance_m = 0.015;
  const CollisionChecker watching(arm(), sceneOf(world, T_map_base), T_map_base, watched);
  double first_m = 1.0, watched_first_m = 1.0;
  for (double x_m = 0.70; x_m < 0.93; x_m += 0.001) {
    const ArmVector joints = jointsAt(toolDown({x_m, 0.0, 0.25}));
    if (untouched.check(joints).kind == CollisionKind::kUnknown) first_m = std::min(first_m, x_m);
    if (watching.check(joints).kind == CollisionKind::kUnknown) watched_first_m = std::min(watched_first_m, x_m);
  }
  EXPECT_NEAR(watched_first_m - first_m, 0.015, 0.005);  // blocks count as balls, and the tool is round

  // Wherever the arm is, it may be.
  std::mt19937 engine(5);
  int num_unknown = 0;
  for (int i = 0; i < 5000; ++i) {
    const ArmVector joints = randomJoints(engine);
    if (untouched.check(joints).kind != CollisionKind::kUnknown) continue;
    ++num_unknown;
    CollisionChecker there = untouched;
    there.freeUnknownAt(joints);
    EXPECT_NE(there.check(joints).kind, CollisionKind::kUnknown);
  }
  EXPECT_GT(num_unknown, 5);
}

TEST(CollisionChecker, AWatchedBrickMayHaveStoodATolerancesLengthFromWhereItWasPlanned) {
  BoxWorld world;
  world.boxes = {uprightBox({0.70, 0.0, 0.1}, {0.3, 0.4, 0.2})};
  world.is_unknown = [](const Eigen::Vector3d& p) { return p.x() > 0.85; };
  const auto scene = sceneOf(world, Eigen::Isometry3d::Identity());
  // The brick reaches deep into the blocks whose middles are at x = 0.875 m, and no farther.
  const HeldBrick held{Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 0.1)), {0.19, 0.19, 0.2}};
  const ArmVector hanging = jointsAt(toolDown({0.80, 0.0, 0.46}));
  const auto kindBeside = [&](double unknown_tolerance_m, double end_x_m) {
    CollisionCheckerConfig config;
    config.unknown_tolerance_m = unknown_tolerance_m;
    CollisionChecker checker(arm(), scene, Eigen::Isometry3d::Identity(), config);
    const double size_x_m = 0.3;
    checker.setTarget(uprightBox({end_x_m - config.target_padding_m - 0.5 * size_x_m, 0.0, 0.5}, {size_x_m, 0.6, 1.0}),
                      true);
    checker.setHeld(held, false);
    return checker.check(hanging).kind;
  };
  EXPECT_EQ(kindBeside(0.0, 0.876), CollisionKind::kNone);
  EXPECT_EQ(kindBeside(0.0, 0.865), CollisionKind::kUnknown);
  EXPECT_EQ(kindBeside(0.015, 0.865), CollisionKind::kNone);
  EXPECT_EQ(kindBeside(0.015, 0.859), CollisionKind::kUnknown);
}

TEST(CollisionChecker, UnknownSpaceFarFromAnyPileIsNot) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  BoxWorld world;
  world.ground_z_m = T_map_base.translation().z();
  world.ground_half_edge_m = 3.0;
  world.boxes = {boxInBase(T_map_base, {0.70, -0.8, 0.1}, {0.3, 0.2, 0.2})};
  const Eigen::Isometry3d T_base_map = T_map_base.inverse();
  world.is_unknown = [=](const Eigen::Vector3d& p) { return (T_base_map * p).x() > 0.85; };
  const CollisionChecker checker(arm(), sceneOf(world, T_map_base), T_map_base);
  const ArmVector beyond = jointsAt(toolDown({0.93, 0.0, 0.15}));
  EXPECT_FALSE(checker.check(beyond)) << checker.check(beyond).describe();
}

TEST(CollisionChecker, OnlyMagnetAndBrickMayTouchTheTarget) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  BoxWorld world;
  world.ground_z_m = T_map_base.translation().z();
  world.ground_half_edge_m = 3.0;
  const Eigen::Vector3d brick_m(0.3, 0.2, 0.2);
  // Two bricks beside each other, a hand's breadth apart.
  world.boxes = {boxInBase(T_map_base, {0.75, -0.12, 0.1}, brick_m), boxInBase(T_map_base, {0.75, 0.15, 0.1}, brick_m)};
  CollisionChecker checker(arm(), sceneOf(world, T_map_base), T_map_base);
  const ArmVector on_first = jointsAt(toolDown({0.75, -0.12, 0.201}));
  const ArmVector on_second = jointsAt(toolDown({0.75, 0.15, 0.201}));
  EXPECT_EQ(checker.check(on_first).kind, CollisionKind::kSurface);
  EXPECT_EQ(checker.check(on_first).first, "magnet");
  checker.setTarget(world.boxes[0]);
  EXPECT_FALSE(checker.check(on_first)) << checker.check(on_first).describe();
  EXPECT_EQ(checker.check(on_second).kind, CollisionKind::kSurface);
  EXPECT_TRUE(checker.check(jointsAt(toolDown({0.75, 0.02, 0.15}))));    // through the target into its neighbour's side
  EXPECT_FALSE(checker.check(jointsAt(toolDown({0.75, -0.12, 0.15}))));  // within the target: it is not there
  checker.setTarget(world.boxes[1]);
  EXPECT_EQ(checker.check(on_first).kind, CollisionKind::kSurface);
  EXPECT_FALSE(checker.check(on_second));
  EXPECT_LT(checker.clearance(on_first, 0.1), 0.0011);
  checker.setTarget({});
  EXPECT_EQ(checker.check(on_second).kind, CollisionKind::kSurface);

  // Another link: a brick about the forearm's middle.
  const ArmVector reached_out = jointsAt(toolDown({0.8, 0.0, 0.6}));
  Eigen::Isometry3d T_map_forearm;
  for (const SampledShape& shape : sampleRobot(reached_out, T_map_base, true, 0.1)) {
    const auto* cylinder = std::get_if<mp700_ur5e_description::Cylinder>(&shape.shape);
    if (shape.link == "ur5e_forearm_link" && cylinder->length_m > 0.3) T_map_forearm = shape.T_map_shape;
  }
  BoxWorld hanging;
  hanging.boxes = {{T_map_forearm, {0.12, 0.12, 0.2}}};
  CollisionChecker other(arm(), sceneOf(hanging, T_map_base), T_map_base);
  EXPECT_TRUE(other.check(reached_out));
  other.setTarget(hanging.boxes[0]);
  EXPECT_EQ(other.check(reached_out).first, "ur5e_forearm_link");
  other.setTarget(hanging.boxes[0], true);
  EXPECT_FALSE(other.check(reached_out)) << other.check(reached_out).describe();
  EXPECT_GT(other.clearance(reached_out, 0.1), 0.05);
  other.setTarget(hanging.boxes[0], false);
  EXPECT_TRUE(other.check(reached_out));
}

/// Held by the middle of its top face, its long edge along the tip's x.
HeldBrick heldFromAbove() {
  return {Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 0.1)), {0.3, 0.2, 0.2}};
}

TEST(CollisionChecker, HeldBrickAvoidsRobotSurfaceAndFloor) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  BoxWorld world;
  world.boxes = {boxInBase(T_map_base, {0.75, -0.5, 0.3}, {0.3, 0.2, 0.6})};
  CollisionChecker empty(arm(), sceneOf(world, T_map_base), T_map_base);
  CollisionChecker holding = empty;
  holding.setHeld(heldFromAbove());
  const auto isFreeWithoutBrick = [&](const ArmVector& joints) { return empty.isFree(joints); };
  struct Case {
    const char* what;
    Eigen::Vector3d tip_base;
    double turn_rad;
    CollisionKind kind;
    const char* second;
  };
  // Brick: 0.15 to both sides along the tip's x, 0.10 along y, 0.2 below the tip. Container: x -0.525 ... -0.045, rim at 0.578.
  // Mast: radius 0.02 at (0.02, 0.24).
  for (const Case& c : {Case{"free", {0.75, 0.1, 0.5}, 0.0, CollisionKind::kNone, ""},
                        Case{"container", {-0.30, -0.35, 0.70}, 0.0, CollisionKind::kSelf, "container"},
                        Case{"mast", {0.25, 0.35, 0.90}, 0.0, CollisionKind::kNone, ""},
                        Case{"mast", {0.14, 0.33, 0.90}, 0.0, CollisionKind::kSelf, "camera_mast"},
                        Case{"surface", {0.75, -0.5, 0.79}, 0.0, CollisionKind::kSurface, ""},
                        Case{"beside", {0.75, -0.31, 0.50}, 0.0, CollisionKind::kSurface, ""},
                        Case{"beside", {0.75, -0.27, 0.50}, 0.0, CollisionKind::kNone, ""},
                        Case{"floor", {0.75, 0.2, 0.185}, 0.0, CollisionKind::kFloor, ""}}) {
    const ArmVector joints = jointsAt(toolDown(c.tip_base, c.turn_rad), isFreeWithoutBrick);
    const Contact contact = holding.check(joints);
    EXPECT_EQ(contact.kind, c.kind) << c.what << " " << c.tip_base.transpose() << ": " << contact.describe();
    if (!contact) continue;
    EXPECT_EQ(contact.first, "brick");
    EXPECT_EQ(contact.second, c.second);
  }
  holding.setHeld({});
  EXPECT_FALSE(holding.check(jointsAt(toolDown({0.75, 0.2, 0.185}), isFreeWithoutBrick)));
}

TEST(CollisionChecker, WhatIsHeldKeepsAwayFromTheRobotAndYieldsWhereItIsNearer) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  const CollisionCheckerConfig config;
  CollisionChecker empty(arm(), CollisionSceneBuilder{{}}.scene(), T_map_base, config);
  CollisionChecker holding = empty;
  holding.setHeld(heldFromAbove(), false);
  // The brick's lower half beside the container, so far from its outer face; the same way round each time.
  const auto tipBeside = [](double gap_m) { return toolDown({-0.30, -0.415 - gap_m, 0.62}); };
  const ArmVector first = jointsAt(tipBeside(0.04), [&](const ArmVector& q) { return holding.isFree(q); });
  const auto beside = [&](double gap_m) { return arm()->inverse(tipBeside(gap_m), first).at(0); };
  const auto isMet = [&](const CollisionChecker& checker, double gap_m) {
    const Contact contact = checker.check(beside(gap_m));
    EXPECT_TRUE(!contact || (contact.first == "brick" && contact.second == "container")) << contact.describe();
    return static_cast<bool>(contact);
  };
  EXPECT_FALSE(isMet(holding, config.held_padding_m + 0.002));
  EXPECT_TRUE(isMet(holding, config.held_padding_m - 0.002));
  for (const double gap_m : {0.04, 0.012, 0.002, -0.012, -0.04}) {
    SCOPED_TRACE(gap_m);
    CollisionChecker yielding = holding;
    ASSERT_TRUE(yielding.yieldToRobotAt(beside(gap_m)));
    EXPECT_FALSE(isMet(yielding, gap_m));
    // By no more than it must, in steps of 5 mm, and whoever takes hold again keeps to it.
    EXPECT_TRUE(isMet(yielding, std::min(gap_m, config.held_padding_m) - 0.007));
    yielding.setHeld(heldFromAbove());
    EXPECT_FALSE(isMet(yielding, gap_m));
    EXPECT_TRUE(isMet(yielding, std::min(gap_m, config.held_padding_m) - 0.007));
  }
  CollisionChecker in_vain = holding;
  EXPECT_FALSE(in_vain.yieldToRobotAt(beside(-config.held_release_m - 0.005)));
  EXPECT_TRUE(isMet(in_vain, config.held_padding_m - 0.002));
  EXPECT_THROW(in_vain.yieldToRobotAt(ArmVector::Constant(kNaN)), std::invalid_argument);
  EXPECT_TRUE(empty.yieldToRobotAt(beside(0.04)));
}

// What depends on a brick's size alone is kept from one hold to the next.
TEST(CollisionChecker, HoldingAnewIsAsHoldingForTheFirstTime) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  const BoxWorld world = obstacles(T_map_base);
  const auto scene = sceneOf(world, T_map_base);
  std::mt19937 engine(21);
  std::uniform_real_distribution<double> shift(-0.1, 0.1);
  CollisionChecker again(arm(), scene, T_map_base);
  int num_brick = 0;
  int num_free = 0;
  for (int i = 0; i < 200; ++i) {
    HeldBrick held = heldFromAbove();
    held.T_tip_brick = held.T_tip_brick * Eigen::Translation3d(shift(engine), shift(engine), shift(engine)) *
                       Eigen::AngleAxisd(10.0 * shift(engine), Eigen::Vector3d::UnitZ());
    if (i / 2 % 2 == 1) held.size_m *= 0.5;
    const bool may_touch = i % 3 == 0;
    again.setHeld(held, may_touch);
    CollisionChecker first(arm(), scene, T_map_base);
    first.setHeld(held, may_touch);
    const ArmVector joints = randomJointsBefore(engine);
    const Contact contact = again.check(joints);
    const Contact expected = first.check(joints);
    ASSERT_EQ(contact.kind, expected.kind) << i;
    ASSERT_EQ(contact.first, expected.first) << i;
    ASSERT_EQ(contact.where_map, expected.where_map) << i;
    ASSERT_EQ(again.clearance(joints, 0.5), first.clearance(joints, 0.5)) << i;
    num_brick += contact.first == "brick" ? 1 : 0;
    num_free += contact ? 0 : 1;
  }
  EXPECT_GE(num_brick, 20);
  EXPECT_GE(num_free, 20);
}

// Where a brick was taken from is empty; a block's width beside it nobody may have looked.
TEST(CollisionChecker, OnlyWhileItIsTouchedUnseenSpaceBesideTheTargetIsOpen) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  const OrientedBox brick = boxInBase(T_map_base, {0.70, 0.0, 0.1}, {0.3, 0.2, 0.2});
  BoxWorld world;
  world.boxes = {brick};
  const Eigen::Isometry3d T_base_map = T_map_base.inverse();
  world.is_unknown = [=](const Eigen::Vector3d& p) {
    const Eigen::Vector3d p_base = T_base_map * p;
    return p_base.y() > 0.11 && p_base.z() < 0.2;
  };
  CollisionChecker checker(arm(), sceneOf(world, T_map_base), T_map_base);
  // Held as it lies, and shoved by 3 cm to the unseen side.
  checker.setHeld(HeldBrick{Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 0.1)), brick.size_m}, false);
  const ArmVector shoved = jointsAt(toolDown({0.70, 0.03, 0.21}));
  checker.setTarget(brick);
  EXPECT_FALSE(checker.check(shoved)) << checker.check(shoved).describe();
  checker.setTarget(brick, true);
  EXPECT_EQ(checker.check(shoved).kind, CollisionKind::kUnknown) << checker.check(shoved).describe();
}

TEST(CollisionChecker, ATargetOfAnotherSizeIsAnotherTarget) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  const OrientedBox brick = boxInBase(T_map_base, {0.70, 0.0, 0.1}, {0.3, 0.2, 0.2});
  BoxWorld world;
  world.boxes = {brick};
  CollisionChecker checker(arm(), sceneOf(world, T_map_base), T_map_base);
  OrientedBox small = brick;
  small.size_m *= 0.2;
  const ArmVector touching = jointsAt(toolDown({0.70, 0.0, 0.2}));
  checker.setTarget(small);
  EXPECT_EQ(checker.check(touching).kind, CollisionKind::kSurface);
  checker.setTarget(brick);
  EXPECT_FALSE(checker.check(touching)) << checker.check(touching).describe();
  checker.setTarget(small);
  EXPECT_EQ(checker.check(touching).kind, CollisionKind::kSurface);
}

TEST(CollisionChecker, WhereTheHeldBrickIsNowCannotBeUnseen) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  BoxWorld world;
  world.boxes = {boxInBase(T_map_base, {0.70, 0.0, 0.1}, {0.3, 0.4, 0.2})};
  const Eigen::Isometry3d T_base_map = T_map_base.inverse();
  world.is_unknown = [=](const Eigen::Vector3d& p) { return std::abs((T_base_map * p).z() - 0.29) < 0.06; };
  CollisionChecker checker(arm(), sceneOf(world, T_map_base), T_map_base);
  checker.setHeld(heldFromAbove());
  const ArmVector over = jointsAt(toolDown({0.70, 0.0, 0.46}));
  EXPECT_EQ(checker.check(over).first, "brick") << checker.check(over).describe();
  EXPECT_EQ(checker.check(over).kind, CollisionKind::kUnknown) << checker.check(over).describe();
  checker.freeUnknownAt(over);
  EXPECT_FALSE(checker.check(over)) << checker.check(over).describe();
}

TEST(CollisionChecker, ABrickCanBeLiftedFromBetweenItsNeighboursWithAnUnseenBack) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  const Eigen::Isometry3d T_base_map = T_map_base.inverse();
  const Eigen::Vector3d brick_m(0.3, 0.2, 0.2);
  for (const double offset_m : {0.0, 0.013, 0.025, 0.038}) {  // of the lattice's blocks against the pile
    BoxWorld world;
    world.ground_z_m = T_map_base.translation().z();
    world.ground_half_edge_m = 3.0;
    world.boxes = {boxInBase(T_map_base, {0.7 + offset_m, 0.0, 0.1}, brick_m),
                   boxInBase(T_map_base, {0.7 + offset_m, 0.2, 0.1}, brick_m),
                   boxInBase(T_map_base, {0.7 + offset_m, -0.2, 0.1}, brick_m)};
    const double back_m = 0.85 + offset_m;
    world.is_unknown = [=](const Eigen::Vector3d& p) {
      return (T_base_map * p).x() > back_m && (T_base_map * p).z() < 0.2;
    };
    CollisionChecker checker(arm(), sceneOf(world, T_map_base), T_map_base);
    checker.setHeld(HeldBrick{Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 0.1)), brick_m});
    checker.setTarget(world.boxes[0], true);
    for (double up_m = 0.0; up_m < 0.16; up_m += 0.01) {
      const ArmVector joints = jointsAt(toolDown({0.7 + offset_m, 0.0, 0.2 + up_m}));
      EXPECT_FALSE(checker.check(joints)) << up_m << ": " << checker.check(joints).describe();
    }
    // But not through a neighbour, nor into the unseen.
    EXPECT_EQ(checker.check(jointsAt(toolDown({0.7 + offset_m, 0.06, 0.3}))).first, "brick");
    EXPECT_EQ(checker.check(jointsAt(toolDown({0.78 + offset_m, 0.0, 0.2}))).kind, CollisionKind::kUnknown);
  }
}

TEST(CollisionChecker, ABrickCanBeLiftedFromBesideANeighbourWhoseSurfaceIsDoubtful) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  const Eigen::Vector3d brick_m(0.3, 0.2, 0.2);
  BoxWorld world;
  world.ground_z_m = T_map_base.translation().z();
  world.ground_half_edge_m = 3.0;
  // The neighbour is 40 mm away: beyond the target's padding of 35 mm, and its face is doubted by 2 sigma + 10 mm = 50 mm.
  world.boxes = {boxInBase(T_map_base, {0.7, 0.0, 0.1}, brick_m), boxInBase(T_map_base, {0.7, 0.24, 0.1}, brick_m)};
  world.surface_std_m = [](const Eigen::Vector3d&) { return 0.02; };
  CollisionChecker checker(arm(), sceneOf(world, T_map_base), T_map_base);
  const HeldBrick held{Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 0.1)), brick_m};
  checker.setTarget(world.boxes[0], true);
  const ArmVector at_rest = jointsAt(toolDown({0.7, 0.0, 0.2}));
  checker.setHeld(held);
  EXPECT_FALSE(checker.check(at_rest)) << checker.check(at_rest).describe();
  // But not into it, and what hangs free keeps away from where it may be.
  EXPECT_EQ(checker.check(jointsAt(toolDown({0.7, 0.08, 0.25}))).first, "brick");
  const ArmVector off_the_ground = jointsAt(toolDown({0.7, 0.0, 0.23}));
  EXPECT_FALSE(checker.check(off_the_ground)) << checker.check(off_the_ground).describe();
  checker.setHeld(held, false);
  EXPECT_EQ(checker.check(off_the_ground).kind, CollisionKind::kSurface);
}

TEST(CollisionChecker, ABrickIsSmallerWhereItHangsByWhatTheMapHasTooMuch) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  const Eigen::Vector3d brick_m(0.3, 0.2, 0.2);
  const HeldBrick held{Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 0.1)), brick_m};
  const ArmVector at_rest = jointsAt(toolDown({0.7, 0.0, 0.23}));
  const ArmVector among_others = jointsAt(toolDown({0.7, 0.0, 0.25}));
  const ArmVector into_the_other = jointsAt(toolDown({0.7, 0.06, 0.25}));
  for (const double overlap_m : {0.0, 0.01, 0.02, 0.04, 0.08}) {
    BoxWorld world;
    world.ground_z_m = T_map_base.translation().z();
    world.ground_half_edge_m = 3.0;
    world.boxes = {boxInBase(T_map_base, {0.7, 0.2 - overlap_m, 0.15}, {0.3, 0.2, 0.3})};
    CollisionChecker checker(arm(), sceneOf(world, T_map_base), T_map_base);
    checker.setHeld(held);
    const double clearance_m = checker.clearance(at_rest, 0.2);
    if (overlap_m > CollisionCheckerConfig{}.held_shrink_m) {
      EXPECT_EQ(checker.check(at_rest).first, "brick");
    }
    // Deeper than that only its own place helps, and there the other reaches over it.
    const bool may_be = overlap_m < CollisionCheckerConfig{}.held_release_m;
    EXPECT_EQ(!checker.setHeldAt(held, {at_rest, among_others}), may_be) << overlap_m;
    EXPECT_EQ(checker.isFree(at_rest), may_be) << overlap_m << ": " << checker.check(at_rest).describe();
    EXPECT_EQ(checker.isFree(among_others), may_be) << overlap_m << ": " << checker.check(among_others).describe();
    // Moved by 6 cm more, the magnet itself is in the other where that reaches farthest.
    EXPECT_EQ(checker.check(into_the_other).first, overlap_m < 0.08 ? "brick" : "magnet") << overlap_m;
    // No smaller than it must be, and where nothing helps as large as in a lift.
    if (overlap_m <= CollisionCheckerConfig{}.held_shrink_m || !may_be) {
      EXPECT_EQ(checker.clearance(at_rest, 0.2), clearance_m);
    }
    EXPECT_EQ(checker.held()->size_m, held.size_m);
  }
}

TEST(CollisionChecker, WhereABrickHangsTheMapHasNothingHoweverDeep) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  const Eigen::Vector3d brick_m(0.3, 0.2, 0.2);
  const HeldBrick held{Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 0.1)), brick_m};
  const ArmVector at_rest = jointsAt(toolDown({0.7, 0.0, 0.23}));
  const ArmVector among_others = jointsAt(toolDown({0.7, 0.0, 0.25}));
  const ArmVector aside = jointsAt(toolDown({0.7, -0.12, 0.23}));
  // A sheet through its middle, from the ground to its top and beyond its ends, as of a face seen in a wrong place.
  BoxWorld world;
  world.ground_z_m = T_map_base.translation().z();
  world.ground_half_edge_m = 3.0;
  world.boxes = {boxInBase(T_map_base, {0.7, 0.0, 0.11}, {0.5, 0.03, 0.22})};
  CollisionChecker checker(arm(), sceneOf(world, T_map_base), T_map_base);
  checker.setHeld(held);
  ASSERT_EQ(checker.check(at_rest).first, "brick");
  ASSERT_FALSE(checker.setHeldAt(held, {at_rest, among_others})) << checker.check(at_rest).describe();
  EXPECT_TRUE(checker.isFree(at_rest));
  EXPECT_TRUE(checker.isFree(among_others));
  // What stands beyond its place is still there.
  EXPECT_EQ(checker.check(jointsAt(toolDown({0.95, 0.0, 0.25}))).first, "brick");

  // Where the arm itself is in the way nothing of this helps, and the target stays what it was.
  world.boxes = {boxInBase(T_map_base, {0.7, 0.0, 0.15}, {0.3, 0.2, 0.3})};
  CollisionChecker blocked(arm(), sceneOf(world, T_map_base), T_map_base);
  const OrientedBox elsewhere = boxInBase(T_map_base, {0.7, -0.12, 0.13}, brick_m);
  blocked.setTarget(elsewhere, true);
  blocked.setHeld(held);
  const double clearance_m = blocked.clearance(aside, 0.2);
  EXPECT_EQ(blocked.setHeldAt(held, {at_rest, among_others}).first, "magnet") << "not the brick, whose place is free";
  EXPECT_FALSE(blocked.isFree(at_rest));
  EXPECT_EQ(blocked.clearance(aside, 0.2), clearance_m);
}

TEST(CollisionChecker, MarginGrowsWithSigmaUpToItsLimit) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  BoxWorld world;
  world.boxes = {boxInBase(T_map_base, {0.75, 0.0, 0.15}, {0.4, 0.4, 0.3})};
  struct Case {
    double surface_std_m;
    double sigmas;
    double margin_m;  // expected
  };
  for (const Case& c : {Case{0.002, 2.0, 0.009}, Case{0.010, 2.0, 0.025}, Case{0.010, 0.0, 0.005},
                        Case{0.010, 3.0, 0.035}, Case{0.100, 2.0, 0.050}}) {
    world.surface_std_m = [=](const Eigen::Vector3d&) { return c.surface_std_m; };
    CollisionSceneConfig config;
    config.sigmas = c.sigmas;
    config.margin_m = 0.005;
    const CollisionChecker checker(arm(), sceneOf(world, T_map_base, config), T_map_base);
    const ArmVector within = jointsAt(toolDown({0.75, 0.0, 0.3 + c.margin_m - 1e-4}));
    const ArmVector beyond = jointsAt(toolDown({0.75, 0.0, 0.3 + c.margin_m + 1e-4}));
    EXPECT_EQ(checker.check(within).kind, CollisionKind::kSurface) << c.margin_m;
    EXPECT_FALSE(checker.check(beyond)) << c.margin_m << checker.check(beyond).describe();
    EXPECT_NEAR(checker.clearance(beyond, 0.3), c.margin_m + 1e-4, 1e-5);  // without the margin
  }
}

TEST(CollisionChecker, TwoThreadsShareASceneAndFindTheSame) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  const BoxWorld world = obstacles(T_map_base);
  CollisionChecker checker(arm(), sceneOf(world, T_map_base), T_map_base);
  checker.setHeld(heldFromAbove());
  checker.setTarget(world.boxes[1]);
  std::mt19937 engine(6);
  std::vector<ArmVector> joints(300);
  for (ArmVector& q : joints) q = randomJoints(engine);
  // Clearance builds what it needs when it is first asked: here, by both at once.
  std::vector<std::vector<std::pair<CollisionKind, double>>> found(2);
  const auto work = [&](std::vector<std::pair<CollisionKind, double>>* results) {
    const CollisionChecker mine = checker;
    for (const ArmVector& q : joints) results->emplace_back(mine.check(q).kind, mine.clearance(q, 0.2));
  };
  std::thread other(work, &found[1]);
  work(&found[0]);
  other.join();
  EXPECT_EQ(found[0], found[1]);
}

TEST(CollisionChecker, CopiesAreIndependent) {
  const Eigen::Isometry3d T_map_base = baseAskew();
  const BoxWorld world = obstacles(T_map_base);
  CollisionChecker checker(arm(), sceneOf(world, T_map_base), T_map_base);
  const ArmVector low = jointsAt(toolDown({0.6, 0.35, 0.15}));
  const Contact before = checker.check(low);
  CollisionChecker copy = checker;
  copy.setHeld(heldFromAbove());
  EXPECT_EQ(copy.check(low).kind, CollisionKind::kFloor);
  EXPECT_EQ(checker.check(low).kind, before.kind);
  EXPECT_NE(before.kind, CollisionKind::kFloor);
}

TEST(CollisionChecker, RefusesBadArguments) {
  const auto scene = CollisionSceneBuilder{{}}.scene();
  Eigen::Isometry3d mirrored = Eigen::Isometry3d::Identity();
  mirrored.linear()(2, 2) = -1.0;
  EXPECT_THROW(CollisionChecker(arm(), scene, mirrored), std::invalid_argument);
  EXPECT_THROW(CollisionChecker(nullptr, scene, baseAskew()), std::invalid_argument);
  EXPECT_THROW(CollisionChecker(arm(), nullptr, baseAskew()), std::invalid_argument);
  CollisionCheckerConfig config;
  config.target_padding_m = kNaN;
  EXPECT_THROW(CollisionChecker(arm(), scene, baseAskew(), config), std::invalid_argument);
  CollisionChecker checker(arm(), scene, baseAskew());
  HeldBrick held = heldFromAbove();
  held.size_m.y() = 0.0;
  EXPECT_THROW(checker.setHeld(held), std::invalid_argument);
  held = heldFromAbove();
  held.T_tip_brick = mirrored;
  EXPECT_THROW(checker.setHeld(held), std::invalid_argument);
  EXPECT_THROW(checker.setTarget(OrientedBox{mirrored, {0.1, 0.1, 0.1}}), std::invalid_argument);
  EXPECT_THROW(checker.setTarget(uprightBox({0.0, 0.0, 0.0}, {0.1, kNaN, 0.1})), std::invalid_argument);
  EXPECT_THROW(checker.freeUnknownAt(ArmVector::Constant(kNaN)), std::invalid_argument);
  EXPECT_FALSE(checker.check(stowed()));  // unharmed
}

TEST(Contact, DescribesItselfInASentence) {
  Contact contact{CollisionKind::kSelf, "ur5e_forearm_link", "container", {1.0, 2.0, 3.0}};
  EXPECT_EQ(contact.describe(),
            "ur5e_forearm_link, its middle at (1.000, 2.000, 3.000) m in the map, touches container");
  for (const CollisionKind kind :
       {CollisionKind::kNone, CollisionKind::kLimits, CollisionKind::kSelf, CollisionKind::kSurface,
        CollisionKind::kInside, CollisionKind::kUnknown, CollisionKind::kFloor}) {
    contact.kind = kind;
    EXPECT_THAT(contact.describe(), ::testing::Not(HasSubstr("?")));
    EXPECT_STRNE(toString(kind), "?");
  }
}

TEST(CollisionSceneConfig, RegionHoldsAllThatTheArmReachesWithABrick) {
  std::mt19937 engine(7);
  double farthest_m = 0.0;
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Isometry3d T_base_tip = arm()->tipPose(randomJoints(engine));
    const Eigen::Vector3d far_end = T_base_tip * Eigen::Vector3d(0.0, 0.0, 0.3);  // a brick held by its small face
    farthest_m = std::max(farthest_m, far_end.head<2>().norm());
  }
  EXPECT_LT(farthest_m + std::hypot(0.1, 0.1), CollisionSceneConfig().region_radius_m);
}

}  // namespace
}  // namespace motion_planning
