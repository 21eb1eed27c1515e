// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/robot_mjcf.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>
#include <kdl/tree.hpp>
#include <kdl/treefksolverpos_recursive.hpp>
#include <kdl_parser/kdl_parser.hpp>
#include <urdf_parser/urdf_parser.h>

#include "mp700_ur5e_description/arm_pose.h"
#include "mp700_ur5e_description/robot_names.h"
#include "simulated_world/mujoco_model.h"
#include "synthetic_depth/seeded_random.h"

namespace simulated_world {
namespace {

using test_support::messageOf;
using ::testing::AllOf;
using ::testing::HasSubstr;

const std::string kDescription = MP700_UR5E_DESCRIPTION_DIR;
const std::string kUrdfFile = kDescription + "/urdf/mp700_ur5e.urdf";

std::string document(const std::string& robot) {
  return "<mujoco><compiler angle=\"radian\"/><size nconmax=\"1000\" njmax=\"4000\"/><worldbody>" + robot +
         "</worldbody></mujoco>";
}

class RobotMjcf : public testing::Test {
 protected:
  RobotMjcf()
      : urdf_(urdf::parseURDFFile(kUrdfFile)),
        warnings_before_(mujocoWarnings().count),
        model_(compileModel(document(robotMjcf(*urdf_)))),
        data_(makeData(*model_)) {}

  double& q(const std::string& joint) {
    return data_->qpos[model_->jnt_qposadr[requireId(*model_, mjOBJ_JOINT, joint)]];
  }

  void setArm(const mp700_ur5e_description::ArmPose& pose) {
    for (std::size_t i = 0; i < 6; ++i) q(mp700_ur5e_description::kArmJoints[i]) = pose[static_cast<Eigen::Index>(i)];
  }

  urdf::ModelInterfaceSharedPtr urdf_;
  int warnings_before_;
  ModelPtr model_;
  DataPtr data_;
};

TEST_F(RobotMjcf, CompilesAndStepsWithoutWarning) {
  setArm(mp700_ur5e_description::loadArmPose(kDescription + "/config/arm_poses/stowed.yaml"));
  for (int i = 0; i < 100; ++i) mj_step(model_.get(), data_.get());
  EXPECT_EQ(mujocoWarnings().count, warnings_before_) << mujocoWarnings().last;
}

TEST_F(RobotMjcf, PutsEveryLinkWhereKdlDoes) {
  KDL::Tree tree;
  ASSERT_TRUE(kdl_parser::treeFromFile(kUrdfFile, tree));
  KDL::TreeFkSolverPos_recursive solver(tree);
  synthetic_depth::SeededRandom random(5);
  for (int sample = 0; sample < 100; ++sample) {
    KDL::JntArray joints(tree.getNrOfJoints());
    for (const auto& [name, element] : tree.getSegments()) {
      const KDL::Joint& joint = element.segment.getJoint();
      if (joint.getType() == KDL::Joint::None) continue;
      joints(element.q_nr) = q(joint.getName()) = random.uniform(-M_PI, M_PI);
    }
    const double x_m = q("base_x") = random.uniform(-5.0, 5.0);
    const double y_m = q("base_y") = random.uniform(-5.0, 5.0);
    const double yaw_rad = q("base_yaw") = random.uniform(-M_PI, M_PI);
    const Eigen::Isometry3d T_world_base =
        Eigen::Translation3d(x_m, y_m, 0.0) * Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ());
    mj_kinematics(model_.get(), data_.get());
    for (const auto& [name, link] : urdf_->links_) {
      KDL::Frame frame;
      ASSERT_GE(solver.JntToCart(joints, frame, name), 0) << name;
      Eigen::Isometry3d T_base_link = Eigen::Isometry3d::Identity();
      for (int row = 0; row < 3; ++row) {
        for (int col = 0; col < 4; ++col) T_base_link(row, col) = frame(row, col);
      }
      const Eigen::Isometry3d pose = bodyPose(*data_, requireId(*model_, mjOBJ_BODY, name));
      // Both work in double; urdfdom normalises quaternions to ten digits or better.
      ASSERT_LT((pose.matrix() - (T_world_base * T_base_link).matrix()).cwiseAbs().maxCoeff(), 1e-6) << name;
    }
  }
}

TEST_F(RobotMjcf, HasMassesAndCentresOfTheUrdf) {
  double total_kg = 0.0;
  for (const auto& [name, link] : urdf_->links_) {
    const int body = requireId(*model_, mjOBJ_BODY, name);
    const double mass_kg = link->inertial ? link->inertial->mass : 0.0;
    EXPECT_NEAR(model_->body_mass[body], mass_kg, 1e-12) << name;
    total_kg += mass_kg;
    if (!link->inertial) continue;
    const urdf::Vector3& center = link->inertial->origin.position;
    EXPECT_NEAR(model_->body_ipos[3 * body], center.x, 1e-12) << name;
    EXPECT_NEAR(model_->body_ipos[3 * body + 1], center.y, 1e-12) << name;
    EXPECT_NEAR(model_->body_ipos[3 * body + 2], center.z, 1e-12) << name;
  }
  EXPECT_NEAR(model_->body_subtreemass[0], total_kg, 1e-9);
}

// Body frame, whatever principal axes MuJoCo chose.
TEST_F(RobotMjcf, HasInertiasOfTheUrdf) {
  for (const auto& [name, link] : urdf_->links_) {
    if (!link->inertial) continue;
    const urdf::Inertial& expected = *link->inertial;
    const int body = requireId(*model_, mjOBJ_BODY, name);
    const Eigen::Matrix3d R = quaternionFrom(model_->body_iquat + 4 * body).toRotationMatrix();
    const Eigen::Matrix3d inertia =
        R * Eigen::Map<const Eigen::Vector3d>(model_->body_inertia + 3 * body).asDiagonal() * R.transpose();
    Eigen::Matrix3d from_urdf;
    from_urdf << expected.ixx, expected.ixy, expected.ixz, expected.ixy, expected.iyy, expected.iyz, expected.ixz,
        expected.iyz, expected.izz;
    // MuJoCo's eigenvalue iteration stops at 1e-12 of the largest.
    EXPECT_LT((inertia - from_urdf).norm(), 1e-9 * from_urdf.norm()) << name;
  }
}

TEST(RobotMjcfOfUrdf, TurnsInertiaIntoTheLinksAxes) {
  std::ifstream file(kUrdfFile);
  std::ostringstream text;
  text << file.rdbuf();
  std::string urdf = text.str();
  // The magnet's inertia, given in axes turned by a quarter about x: y and z change places.
  const std::string magnet = "<link name=\"magnet\">\n    <inertial>\n      <origin xyz=\"0 0 0.05\"";
  const std::size_t at = urdf.find(magnet);
  ASSERT_NE(at, std::string::npos);
  urdf.insert(at + magnet.size(), " rpy=\"1.5707963267948966 0 0\"");
  const urdf::ModelInterfaceSharedPtr robot = urdf::parseURDF(urdf);
  const urdf::Inertial& given = *robot->getLink("magnet")->inertial;
  ASSERT_GT(given.iyy, 1.5 * given.izz);
  const ModelPtr model = compileModel(document(robotMjcf(*robot)));
  const int body = requireId(*model, mjOBJ_BODY, "magnet");
  const Eigen::Matrix3d R = quaternionFrom(model->body_iquat + 4 * body).toRotationMatrix();
  const Eigen::Matrix3d inertia =
      R * Eigen::Map<const Eigen::Vector3d>(model->body_inertia + 3 * body).asDiagonal() * R.transpose();
  EXPECT_NEAR(inertia(1, 1), given.izz, 1e-9 * given.izz);
  EXPECT_NEAR(inertia(2, 2), given.iyy, 1e-9 * given.iyy);
}

TEST_F(RobotMjcf, HasRangesOfTheUrdf) {
  for (const auto& [name, joint] : urdf_->joints_) {
    if (joint->type == urdf::Joint::FIXED) continue;
    const int id = requireId(*model_, mjOBJ_JOINT, name);
    EXPECT_EQ(model_->jnt_type[id], mjJNT_HINGE) << name;
    EXPECT_EQ(model_->jnt_limited[id] != 0, joint->type == urdf::Joint::REVOLUTE) << name;
    if (joint->type != urdf::Joint::REVOLUTE) continue;
    EXPECT_DOUBLE_EQ(model_->jnt_range[2 * id], joint->limits->lower) << name;
    EXPECT_DOUBLE_EQ(model_->jnt_range[2 * id + 1], joint->limits->upper) << name;
  }
  EXPECT_EQ(model_->njnt, 3 + 2 + 6);
}

TEST_F(RobotMjcf, StowedRobotTouchesNeitherItselfNorTheGround) {
  const std::string ground = "<geom name=\"ground\" type=\"plane\" size=\"5 5 0.1\"/>";
  const ModelPtr model = compileModel(document(ground + robotMjcf(*urdf_)));
  const DataPtr data = makeData(*model);
  const mp700_ur5e_description::ArmPose pose =
      mp700_ur5e_description::loadArmPose(kDescription + "/config/arm_poses/stowed.yaml");
  const auto joint = [&](std::size_t i) -> double& {
    return data->qpos[model->jnt_qposadr[requireId(*model, mjOBJ_JOINT, mp700_ur5e_description::kArmJoints[i])]];
  };
  for (std::size_t i = 0; i < 6; ++i) joint(i) = pose[static_cast<Eigen::Index>(i)];
  mj_forward(model.get(), data.get());
  for (int i = 0; i < data->ncon; ++i) {
    ADD_FAILURE() << mj_id2name(model.get(), mjOBJ_GEOM, data->contact[i].geom1) << " touches "
                  << mj_id2name(model.get(), mjOBJ_GEOM, data->contact[i].geom2);
  }
  // That contacts are looked for at all: the arm laid down forwards reaches through the ground.
  joint(0) = 0.0;
  joint(1) = 0.7;
  joint(2) = 0.0;
  mj_forward(model.get(), data.get());
  EXPECT_GT(data->ncon, 0);
}

TEST_F(RobotMjcf, OnlyCollisionShapesCollide) {
  const std::vector<std::string> ghosts = RobotMjcfOptions().links_without_contact;
  int num_shapes = 0;
  for (const auto& [name, link] : urdf_->links_) {
    const bool is_ghost = std::find(ghosts.begin(), ghosts.end(), name) != ghosts.end();
    for (std::size_t i = 0; i < link->collision_array.size(); ++i, ++num_shapes) {
      const int geom = requireId(*model_, mjOBJ_GEOM, name + "/c" + std::to_string(i));
      EXPECT_EQ(model_->geom_group[geom], 3) << name;
      EXPECT_EQ(model_->geom_contype[geom], is_ghost ? 0 : 1) << name;
      EXPECT_EQ(model_->geom_conaffinity[geom], is_ghost ? 0 : 1) << name;
    }
    for (std::size_t i = 0; i < link->visual_array.size(); ++i, ++num_shapes) {
      const int geom = requireId(*model_, mjOBJ_GEOM, name + "/v" + std::to_string(i));
      EXPECT_EQ(model_->geom_group[geom], 2) << name;
      EXPECT_EQ(model_->geom_contype[geom] + model_->geom_conaffinity[geom], 0) << name;
      const urdf::Color& color = link->visual_array[i]->material->color;
      EXPECT_FLOAT_EQ(model_->geom_rgba[4 * geom], color.r) << name;
      EXPECT_FLOAT_EQ(model_->geom_rgba[4 * geom + 2], color.b) << name;
    }
  }
  EXPECT_EQ(model_->ngeom, num_shapes);
}

TEST_F(RobotMjcf, ShapesHaveSizesOfTheUrdf) {
  for (const auto& [name, link] : urdf_->links_) {
    for (std::size_t i = 0; i < link->collision_array.size(); ++i) {
      const int geom = requireId(*model_, mjOBJ_GEOM, name + "/c" + std::to_string(i));
      const mjtNum* size = model_->geom_size + 3 * geom;
      const urdf::Geometry& shape = *link->collision_array[i]->geometry;
      if (shape.type == urdf::Geometry::BOX) {
        const urdf::Vector3& full = static_cast<const urdf::Box&>(shape).dim;
        EXPECT_EQ(Eigen::Vector3d(full.x, full.y, full.z), 2.0 * Eigen::Map<const Eigen::Vector3d>(size)) << name;
      } else if (shape.type == urdf::Geometry::CYLINDER) {
        EXPECT_EQ(static_cast<const urdf::Cylinder&>(shape).radius, size[0]) << name;
        EXPECT_EQ(static_cast<const urdf::Cylinder&>(shape).length, 2.0 * size[1]) << name;
      } else {
        EXPECT_EQ(static_cast<const urdf::Sphere&>(shape).radius, size[0]) << name;
      }
    }
  }
}

TEST_F(RobotMjcf, CameraLooksAlongTheOpticalAxis) {
  mj_forward(model_.get(), data_.get());
  const int camera = requireId(*model_, mjOBJ_CAMERA, "rgbd");
  const Eigen::Isometry3d T_world_optical =
      bodyPose(*data_, requireId(*model_, mjOBJ_BODY, "camera_depth_optical_frame"));
  const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R(data_->cam_xmat + 9 * camera);
  // Exact half turn; rounding only.
  EXPECT_LT((R.col(0) - T_world_optical.linear().col(0)).norm(), 1e-12);
  EXPECT_LT((R.col(1) + T_world_optical.linear().col(1)).norm(), 1e-12);
  EXPECT_LT((R.col(2) + T_world_optical.linear().col(2)).norm(), 1e-12);
  EXPECT_LT((Eigen::Map<const Eigen::Vector3d>(data_->cam_xpos + 3 * camera) - T_world_optical.translation()).norm(),
            1e-12);
  EXPECT_NEAR(model_->cam_fovy[camera], RobotMjcfOptions().camera_fovy_rad * 180.0 / M_PI, 1e-9);
}

TEST_F(RobotMjcf, SitesAreTheirFrames) {
  mj_forward(model_.get(), data_.get());
  const std::map<std::string, std::string> frames = {
      {"magnet_tip", "magnet_tip"}, {"wrist_ft", "ur5e_tool0"}, {"lidar_1_link", "lidar_1_link"}};
  for (const auto& [name, frame] : frames) {
    const int site = requireId(*model_, mjOBJ_SITE, name);
    EXPECT_EQ(model_->site_bodyid[site], requireId(*model_, mjOBJ_BODY, frame));
    const Eigen::Isometry3d pose = bodyPose(*data_, model_->site_bodyid[site]);
    EXPECT_LT((Eigen::Map<const Eigen::Vector3d>(data_->site_xpos + 3 * site) - pose.translation()).norm(), 1e-12)
        << name;
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R(data_->site_xmat + 9 * site);
    EXPECT_LT((R - pose.linear()).norm(), 1e-12) << name;
  }
}

TEST_F(RobotMjcf, OptionsReachTheJoints) {
  RobotMjcfOptions options;
  options.base_linear = {11.0, 12.0};
  options.base_turn = {13.0, 14.0};
  options.arm = {15.0, 16.0};
  options.wheel = {17.0, 18.0};
  const ModelPtr model = compileModel(document(robotMjcf(*urdf_, options)));
  const std::map<std::string, JointDynamics> expected = {{"base_x", options.base_linear},
                                                         {"base_y", options.base_linear},
                                                         {"base_yaw", options.base_turn},
                                                         {"elbow_joint", options.arm},
                                                         {"wheel_front_left_joint", options.wheel}};
  for (const auto& [name, dynamics] : expected) {
    const int dof = model->jnt_dofadr[requireId(*model, mjOBJ_JOINT, name)];
    EXPECT_EQ(model->dof_armature[dof], dynamics.armature) << name;
    EXPECT_EQ(model->dof_damping[dof], dynamics.damping) << name;
  }
}

TEST_F(RobotMjcf, RefusesImpossibleOptionsAllAtOnce) {
  RobotMjcfOptions options;
  options.arm.damping = -1.0;
  options.camera_fovy_rad = 4.0;
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { robotMjcf(*urdf_, options); }),
              AllOf(HasSubstr("arm.damping = -1, must be finite and at least 0"),
                    HasSubstr("camera_fovy_rad = 4, must be in (0, pi) rad")));
}

/// The shipped URDF with the text `from` replaced wherever it stands.
std::string urdfWith(const std::string& from, const std::string& to) {
  std::ifstream file(kUrdfFile);
  std::ostringstream text;
  text << file.rdbuf();
  std::string urdf = text.str();
  std::size_t at = urdf.find(from);
  if (at == std::string::npos) throw std::runtime_error("the URDF has no " + from);
  for (; at != std::string::npos; at = urdf.find(from, at + to.size())) urdf.replace(at, from.size(), to);
  return urdf;
}

TEST(RobotMjcfOfUrdf, AnotherRobotHasOtherWheels) {
  const std::string urdf = urdfWith("\"wheel_front_left_link\"", "\"left_tyre\"");
  const std::string mjcf = robotMjcf(*urdf::parseURDF(urdf));
  const std::size_t tyre = mjcf.find("name=\"left_tyre/c0\"");
  ASSERT_NE(tyre, std::string::npos);
  EXPECT_LT(mjcf.find("contype=\"0\"", tyre), mjcf.find("/>", tyre)) << "it would drag on the ground";
}

TEST(RobotMjcfOfUrdf, MissingFramesAreNamed) {
  EXPECT_THAT(
      messageOf<std::invalid_argument>([] { robotMjcf(*urdf::parseURDF(urdfWith("\"magnet_tip\"", "\"cup_tip\""))); }),
      HasSubstr("URDF: link magnet_tip is missing"));
}

TEST(RobotMjcfOfUrdf, RefusesMeshesAndOddJoints) {
  const auto refusal = [](const std::string& from, const std::string& to) -> std::string {
    const std::string urdf = urdfWith(from, to);
    try {
      robotMjcf(*urdf::parseURDF(urdf));
      return "accepted";
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
  };
  EXPECT_NE(
      refusal("<sphere radius=\"0.06\"/>", "<mesh filename=\"a.stl\"/>").find("link caster_rear_link = mesh, must be"),
      std::string::npos);
  EXPECT_NE(refusal("\"caster_rear_joint\" type=\"fixed\"", "\"caster_rear_joint\" type=\"floating\"")
                .find("joint caster_rear_joint = floating or planar"),
            std::string::npos);
}

TEST(RobotMjcfOfUrdf, NamesTheFileThatIsNotThere) {
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { robotMjcfFromFile("/nowhere/robot.urdf"); }),
              HasSubstr("/nowhere/robot.urdf"));
}

}  // namespace
}  // namespace simulated_world
