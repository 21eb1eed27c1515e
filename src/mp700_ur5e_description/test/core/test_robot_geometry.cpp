// SPDX-License-Identifier: BSD-3-Clause
// What the URDF promises about base, mast, container and frames; and that base_profile.yaml says the same.
#include <algorithm>
#include <cmath>
#include <cstdlib>

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "mp700_ur5e_description/base_profile.h"
#include "mp700_ur5e_description/brick_types.h"
#include "support/solids.h"

namespace mp700_ur5e_description {
namespace {

constexpr double kExact = 1e-9;  // decimal figures of two files, as doubles

BaseProfile profile() {
  return loadBaseProfile(DESCRIPTION_DIR "/config/base_profile.yaml");
}

class RobotGeometry : public testing::Test {
 protected:
  Eigen::Isometry3d pose(const std::string& link) const { return robot_.linkPose(link, ArmPose::Zero()); }
  Eigen::Vector3d position(const std::string& link) const { return pose(link).translation(); }

  UrdfRobot robot_;
};

TEST_F(RobotGeometry, PassesCheckUrdf) {
  EXPECT_EQ(std::system(("check_urdf " + kUrdfFile + " > /dev/null").c_str()), 0);
  EXPECT_NE(std::system("check_urdf " DESCRIPTION_DIR "/package.xml > /dev/null 2>&1"), 0)
      << "check_urdf takes anything";
}

TEST_F(RobotGeometry, HasEveryFramePromised) {
  for (const std::string name :
       {kBaseFrame,           kFootprintFrame,       kScannerFrame,       kArmBaseFrame,       kArmControllerFrame,
        kToolFrame,           kMagnetLink,           kMagnetTipFrame,     kColorFrame,         kDepthFrame,
        kContainerLink,       kContainerPlaces[0],   kContainerPlaces[1], kContainerPlaces[2], "ur5e_base_link_inertia",
        "ur5e_shoulder_link", "ur5e_upper_arm_link", "ur5e_forearm_link", "ur5e_wrist_1_link", "ur5e_wrist_2_link",
        "ur5e_wrist_3_link",  "ur5e_flange",         "camera_mast",       "camera_link"}) {
    EXPECT_TRUE(robot_.urdf().getLink(name)) << name;
  }
  EXPECT_EQ(robot_.urdf().getRoot()->name, kBaseFrame);
  EXPECT_TRUE(pose(kFootprintFrame).isApprox(Eigen::Isometry3d::Identity()));
  for (const char* name : {kLeftWheelJoint, kRightWheelJoint}) {
    ASSERT_TRUE(robot_.urdf().getJoint(name)) << name;
    EXPECT_EQ(robot_.urdf().getJoint(name)->type, urdf::Joint::CONTINUOUS) << name;
  }
}

TEST_F(RobotGeometry, OnlyJointsOfArmAndWheelsMove) {
  std::set<std::string> moving;
  for (const auto& [name, joint] : robot_.urdf().joints_) {
    if (joint->type != urdf::Joint::FIXED) moving.insert(name);
  }
  std::set<std::string> expected(kArmJoints.begin(), kArmJoints.end());
  expected.insert({kLeftWheelJoint, kRightWheelJoint});
  EXPECT_EQ(moving, expected);
}

TEST_F(RobotGeometry, InertiasArePossible) {
  double total_kg = 0.0;
  for (const auto& [name, link] : robot_.urdf().links_) {
    if (!link->inertial) continue;
    const urdf::Inertial& inertial = *link->inertial;
    total_kg += inertial.mass;
    EXPECT_GT(inertial.mass, 0.0) << name;
    Eigen::Matrix3d inertia;
    inertia << inertial.ixx, inertial.ixy, inertial.ixz, inertial.ixy, inertial.iyy, inertial.iyz, inertial.ixz,
        inertial.iyz, inertial.izz;
    const Eigen::Vector3d moments = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(inertia).eigenvalues();
    EXPECT_GT(moments[0], 0.0) << name;
    EXPECT_GE(moments[0] + moments[1], moments[2]) << name << ": no body has these moments";
  }
  // Base 150 + 2 x 3, pedestal 8, arm 21.7, magnet 0.5, mast 1.5, camera 0.072, container 6.5.
  EXPECT_NEAR(total_kg, 156.0 + 8.0 + 21.7 + 0.5 + 1.5 + 0.072 + 6.5, 1e-9);
}

TEST_F(RobotGeometry, EveryBodyIsSolidPrimitive) {
  for (const auto& [name, link] : robot_.urdf().links_) {
    EXPECT_EQ(link->collision_array.empty(), link->visual_array.empty()) << name;
    for (const urdf::CollisionSharedPtr& collision : link->collision_array) {
      EXPECT_NE(collision->geometry->type, urdf::Geometry::MESH) << name;
    }
    for (const urdf::VisualSharedPtr& visual : link->visual_array) {
      EXPECT_NE(visual->geometry->type, urdf::Geometry::MESH) << name;
      EXPECT_TRUE(visual->material) << name << ": a shape without colour";
    }
    EXPECT_TRUE(link->inertial || link->collision_array.empty() || name == "caster_rear_link" || name == kScannerFrame)
        << name << ": a body without mass";
  }
}

TEST_F(RobotGeometry, ArmStandsAtTheFrontEdge) {
  const double front_m = profile().body.footprint_m.front().x();
  EXPECT_GE(front_m - position(kArmBaseFrame).x(), 0.0);
  EXPECT_LE(front_m - position(kArmBaseFrame).x(), 0.12);
  EXPECT_NEAR(position(kArmBaseFrame).z(), 0.5, 0.02);  // "about half a metre"
  EXPECT_TRUE(pose(kArmBaseFrame).linear().isIdentity(kExact));
}

TEST_F(RobotGeometry, DriveIsThatOfTheProfile) {
  const BaseProfile base = profile();
  const Eigen::Vector3d left = position("wheel_front_left_link");
  const Eigen::Vector3d right = position("wheel_front_right_link");
  EXPECT_NEAR(left.y() - right.y(), base.drive.track_m, kExact);
  EXPECT_NEAR(left.x(), 0.0, kExact);
  EXPECT_NEAR(right.x(), 0.0, kExact);
  for (const std::string name : {"wheel_front_left_link", "wheel_front_right_link"}) {
    EXPECT_NEAR(position(name).z(), base.drive.wheel_radius_m, kExact) << name << ": wheels stand on the ground";
    const auto& wheel = static_cast<const urdf::Cylinder&>(*robot_.urdf().getLink(name)->collision->geometry);
    EXPECT_NEAR(wheel.radius, base.drive.wheel_radius_m, kExact) << name;
  }
  // Forward is a positive turn of the wheel.
  EXPECT_NEAR(robot_.urdf().getJoint(kLeftWheelJoint)->axis.y, 1.0, kExact);
  EXPECT_NEAR(robot_.urdf().getJoint(kRightWheelJoint)->axis.y, 1.0, kExact);
}

TEST_F(RobotGeometry, MassIsThatOfTheProfile) {
  double mass_kg = 0.0;
  for (const char* name : {"chassis_link", "wheel_front_left_link", "wheel_front_right_link"}) {
    mass_kg += robot_.urdf().getLink(name)->inertial->mass;
  }
  EXPECT_NEAR(mass_kg, profile().body.mass_kg, kExact);
}

// Tight, too: a footprint larger than the body would cost room between bricks.
TEST_F(RobotGeometry, FootprintIsTheOutlineOfTheBase) {
  const std::vector<Eigen::Vector2d> corners = profile().body.footprint_m;
  Eigen::AlignedBox2d outline, footprint;
  for (const Eigen::Vector2d& corner : corners) footprint.extend(corner);
  for (const Solid& solid : solidsOf(robot_, ArmPose::Zero())) {
    if (rigidRoot(robot_, solid.link) != kBaseFrame && solid.link.rfind("wheel", 0) != 0) continue;
    for (const Eigen::Vector3d& p : solid.points(0.02)) {
      outline.extend(Eigen::Vector2d(p.head<2>()));
      for (std::size_t i = 0; i < corners.size(); ++i) {
        const Eigen::Vector2d edge = corners[(i + 1) % corners.size()] - corners[i];
        const Eigen::Vector2d to_p = p.head<2>() - corners[i];
        ASSERT_GE((edge.x() * to_p.y() - edge.y() * to_p.x()) / edge.norm(), -kExact)
            << solid.link << " stands out at " << p.transpose();
      }
    }
  }
  EXPECT_TRUE(outline.isApprox(footprint, kExact));
}

TEST_F(RobotGeometry, NothingReachesBelowTheGround) {
  for (const Solid& solid : solidsOf(robot_, ArmPose::Zero())) {
    for (const Eigen::Vector3d& p : solid.points(0.01)) ASSERT_GE(p.z(), -kExact) << solid.link;
  }
}

// Every beam of the profile, from its origin outwards in the plane of the frame.
TEST_F(RobotGeometry, ScannerSeesOutOfTheBase) {
  const BaseProfile::Scanner scanner = profile().scanner;
  const long last_beam = std::lround((scanner.max_angle_rad - scanner.min_angle_rad) / scanner.increment_rad);
  EXPECT_EQ(last_beam, 380);  // 190 degrees by half degrees
  const Eigen::Isometry3d T_base_scanner = pose(scanner.frame);
  EXPECT_LT((T_base_scanner.translation() - Eigen::Vector3d(0.244, 0.0, 0.141)).norm(), kExact);
  const std::vector<Solid> solids = solidsOf(robot_, ArmPose::Zero());
  for (long beam = 0; beam <= last_beam; ++beam) {
    const double angle_rad = scanner.min_angle_rad + static_cast<double>(beam) * scanner.increment_rad;
    const Eigen::Vector3d direction =
        T_base_scanner.linear() * Eigen::Vector3d(std::cos(angle_rad), std::sin(angle_rad), 0);
    for (double range_m = 0.0; range_m < 1.0; range_m += 0.002) {
      for (const Solid& solid : solids) {
        ASSERT_FALSE(solid.contains(T_base_scanner.translation() + range_m * direction))
            << "beam " << beam << " hits " << solid.link << " after " << range_m << " m";
      }
    }
  }
}

TEST_F(RobotGeometry, CameraLooksAheadAndDownFromTheMast) {
  for (const char* name : {kColorFrame, kDepthFrame}) {
    const Eigen::Isometry3d T_base_camera = pose(name);
    EXPECT_LT((T_base_camera.translation() - Eigen::Vector3d(0.05, 0.24, 1.60)).norm(), kExact) << name;
    const Eigen::Vector3d view = T_base_camera.linear().col(2);
    EXPECT_NEAR(std::asin(-view.z()), 45.0 * M_PI / 180.0, 1e-6) << name;            // digits of the file
    EXPECT_NEAR(std::atan2(view.y(), view.x()), -5.0 * M_PI / 180.0, 1e-6) << name;  // to the right
    EXPECT_NEAR(T_base_camera.linear().col(0).z(), 0.0, kExact) << name << ": the image's rows are level";
    EXPECT_LT(T_base_camera.linear().col(1).z(), 0.0) << name << ": y of an optical frame points down";
  }
}

TEST_F(RobotGeometry, CameraDoesNotSeeItsOwnMast) {
  const Eigen::Isometry3d T_base_camera = pose(kDepthFrame);
  const std::vector<Solid> solids = solidsOf(robot_, ArmPose::Zero());
  for (const double x : {-1.0, -0.5, 0.0, 0.5, 1.0}) {  // 90 degrees wide, 70 high: more than common cameras see
    for (const double y : {-0.7, -0.35, 0.0, 0.35, 0.7}) {
      for (double depth_m = 0.0; depth_m < 1.5; depth_m += 0.002) {
        for (const Solid& solid : solids) {
          if (solid.link != "camera_mast" && solid.link != "camera_link") continue;
          ASSERT_FALSE(solid.contains(T_base_camera * Eigen::Vector3d(x * depth_m, y * depth_m, depth_m)))
              << solid.link << " at ray " << x << " " << y << ", depth " << depth_m << " m";
        }
      }
    }
  }
}

TEST_F(RobotGeometry, MagnetEndsTenCentimetresBeyondTheFlange) {
  const Eigen::Isometry3d T_tool_tip = pose(kToolFrame).inverse() * pose(kMagnetTipFrame);
  EXPECT_LT((T_tool_tip.translation() - Eigen::Vector3d(0, 0, 0.1)).norm(), kExact);
  EXPECT_TRUE(T_tool_tip.linear().isIdentity(kExact));
}

/// A brick over a place, its longer edge along it, its underside `above_m` over the rim.
Solid brickAt(const Eigen::Isometry3d& T_base_place, double above_m) {
  const Eigen::Vector3d size_m = loadBrickTypes(DESCRIPTION_DIR "/config/bricks.yaml").types.front().size_m;
  Solid brick{"brick", std::make_shared<urdf::Box>(), T_base_place};
  static_cast<urdf::Box&>(*brick.geometry).dim = urdf::Vector3(size_m.x(), size_m.y(), size_m.z());
  brick.T_base_shape.translate(Eigen::Vector3d(0.0, 0.0, above_m + 0.5 * size_m.z()));
  return brick;
}

// As deep as it lies. Pose errors of the pick and the fall move each brick by up to 1.5 cm, two towards each other by 3 cm.
TEST_F(RobotGeometry, EachPlaceTakesABrickBesideTheOthers) {
  constexpr double kBeside_m = 0.0299;
  const std::vector<Solid> solids = solidsOf(robot_, loadArmPose(DESCRIPTION_DIR "/config/arm_poses/stowed.yaml"));
  std::vector<Solid> bricks;
  for (const char* place : kContainerPlaces) bricks.push_back(brickAt(pose(place), -0.2099));
  for (std::size_t i = 0; i < bricks.size(); ++i) {
    for (const double x : {-kBeside_m, 0.0, kBeside_m}) {
      for (const double y : {-kBeside_m, 0.0, kBeside_m}) {
        Solid moved = bricks[i];
        moved.T_base_shape.pretranslate(Eigen::Vector3d(x, y, 0.0));
        for (const Eigen::Vector3d& p : moved.points(0.02)) {
          for (const Solid& solid : solids) ASSERT_FALSE(solid.contains(p)) << solid.link << " at place " << i;
          for (std::size_t k = 0; k < bricks.size(); ++k)
            ASSERT_FALSE(k != i && bricks[k].contains(p)) << i << " " << k;
        }
      }
    }
  }
}

TEST_F(RobotGeometry, ContainerIsDeeperThanABrickOpenAboveAndClosedBelow) {
  const Eigen::Vector3d size_m = loadBrickTypes(DESCRIPTION_DIR "/config/bricks.yaml").types.front().size_m;
  EXPECT_LT(size_m.z(), 0.21) << "the next brick is carried over it, and nobody knows that it is there";
  const std::vector<Solid> solids = solidsOf(robot_, ArmPose::Zero());
  const auto isSolid = [&](const Eigen::Vector3d& p_base) {
    return std::any_of(solids.begin(), solids.end(),
                       [&](const Solid& solid) { return solid.link == kContainerLink && solid.contains(p_base); });
  };
  for (const char* place : kContainerPlaces) {
    const Eigen::Vector3d p_base = pose(place).translation();
    for (double z = -0.205; z < 0.5; z += 0.01) EXPECT_FALSE(isSolid(p_base + Eigen::Vector3d(0.0, 0.0, z))) << z;
    EXPECT_TRUE(isSolid(p_base - Eigen::Vector3d(0.0, 0.0, 0.215)));
  }
  const Eigen::Vector3d rim = pose(kContainerLink).translation() + Eigen::Vector3d(0.0, 0.0, 0.22 - 0.005);
  for (const Eigen::Vector2d& wall :
       {Eigen::Vector2d(0.25, 0), Eigen::Vector2d(-0.25, 0), Eigen::Vector2d(0, 0.305), Eigen::Vector2d(0, -0.305)}) {
    EXPECT_TRUE(isSolid(rim + Eigen::Vector3d(wall.x(), wall.y(), 0.0))) << wall.transpose();
  }
}

}  // namespace
}  // namespace mp700_ur5e_description
