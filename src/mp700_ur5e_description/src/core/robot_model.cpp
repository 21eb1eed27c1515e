// SPDX-License-Identifier: BSD-3-Clause
#include "mp700_ur5e_description/robot_model.h"

#include <cstdint>
#include <functional>
#include <iomanip>
#include <limits>
#include <sstream>
#include <stdexcept>

#include <interactive_mapping_common/config/schema.h>
#include <kdl_parser/kdl_parser.hpp>
#include <urdf_parser/urdf_parser.h>

namespace mp700_ur5e_description {
namespace {

constexpr const char* kCameraLink = "camera_link";

Eigen::Isometry3d toEigen(const urdf::Pose& pose) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() << pose.position.x, pose.position.y, pose.position.z;
  double x, y, z, w;
  pose.rotation.getQuaternion(x, y, z, w);
  T.linear() = Eigen::Quaterniond(w, x, y, z).normalized().toRotationMatrix();
  return T;
}

Shape toShape(const urdf::Geometry& geometry, const std::string& link) {
  switch (geometry.type) {
    case urdf::Geometry::BOX: {
      const auto& box = static_cast<const urdf::Box&>(geometry);
      return Box{{box.dim.x, box.dim.y, box.dim.z}};
    }
    case urdf::Geometry::CYLINDER: {
      const auto& cylinder = static_cast<const urdf::Cylinder&>(geometry);
      return Cylinder{cylinder.radius, cylinder.length};
    }
    case urdf::Geometry::SPHERE:
      return Sphere{static_cast<const urdf::Sphere&>(geometry).radius};
    default:
      throw std::invalid_argument(
          "link " + link +
          ": a collision shape is a mesh; must be a box, a cylinder or a sphere (adapt_urdf makes them)");
  }
}

std::string describe(const Eigen::Isometry3d& T) {
  std::ostringstream text;
  text << std::setprecision(9) << T.translation().transpose() << ' ' << T.linear().row(0) << ' ' << T.linear().row(1);
  return text.str();
}

std::string describe(const Shape& shape) {
  std::ostringstream text;
  text << std::setprecision(9);
  if (const auto* box = std::get_if<Box>(&shape)) text << "box " << box->size_m.transpose();
  if (const auto* cylinder = std::get_if<Cylinder>(&shape)) {
    text << "cylinder " << cylinder->radius_m << ' ' << cylinder->length_m;
  }
  if (const auto* sphere = std::get_if<Sphere>(&shape)) text << "sphere " << sphere->radius_m;
  return text.str();
}

}  // namespace

std::shared_ptr<const RobotModel> RobotModel::load(const std::string& path) {
  return parse(interactive_mapping::readTextFile(path), path);
}

std::shared_ptr<const RobotModel> RobotModel::parse(const std::string& urdf_xml, const std::string& name) {
  const urdf::ModelInterfaceSharedPtr urdf = urdf::parseURDF(urdf_xml);
  if (!urdf || !urdf->getRoot()) throw std::invalid_argument(name + ": is no URDF");
  const std::shared_ptr<RobotModel> model(new RobotModel);
  if (!kdl_parser::treeFromUrdfModel(*urdf, model->tree_))
    throw std::invalid_argument(name + ": has no kinematic tree");
  model->root_ = urdf->getRoot()->name;
  model->bodies_.push_back({0, Eigen::Isometry3d::Identity(), Eigen::Vector3d::UnitZ()});
  std::ostringstream canonical;
  canonical << std::setprecision(9);

  const std::function<void(const urdf::Link&, std::size_t, const Eigen::Isometry3d&, bool)> add =
      [&](const urdf::Link& link, std::size_t body, const Eigen::Isometry3d& T_body_link, bool counts) {
        counts = counts && link.name != kCameraLink;
        model->frames_[link.name] = {body, T_body_link};
        for (const auto& collision : link.collision_array) {
          const Eigen::Isometry3d T_link_shape = toEigen(collision->origin);
          model->shapes_.push_back(
              {body, link.name, toShape(*collision->geometry, link.name), T_body_link * T_link_shape});
          if (!counts) continue;
          canonical << link.name << ' ' << describe(model->shapes_.back().shape) << ' ' << describe(T_link_shape)
                    << '\n';
        }
        for (const urdf::JointSharedPtr& joint : link.child_joints) {
          const urdf::LinkConstSharedPtr child = urdf->getLink(joint->child_link_name);
          const Eigen::Isometry3d T_link_joint = toEigen(joint->parent_to_joint_origin_transform);
          const bool child_counts = counts && child->name != kCameraLink;
          if (child_counts) canonical << joint->name << ' ' << joint->type << ' ' << describe(T_link_joint) << '\n';
          if (joint->type == urdf::Joint::FIXED) {
            add(*child, body, T_body_link * T_link_joint, counts);
            continue;
          }
          if (joint->type != urdf::Joint::REVOLUTE && joint->type != urdf::Joint::CONTINUOUS) {
            throw std::invalid_argument(name + ": joint " + joint->name + " neither is fixed nor turns");
          }
          const Eigen::Vector3d axis(joint->axis.x, joint->axis.y, joint->axis.z);
          if (!(axis.norm() > 1e-9)) throw std::invalid_argument(name + ": joint " + joint->name + " has no axis");
          constexpr double kInfinity = std::numeric_limits<double>::infinity();
          const bool is_limited = joint->type == urdf::Joint::REVOLUTE && joint->limits;
          model->joints_.push_back(
              {joint->name, is_limited ? joint->limits->lower : -kInfinity,
               is_limited ? joint->limits->upper : kInfinity,
               joint->limits && joint->limits->velocity > 0.0 ? joint->limits->velocity : kInfinity});
          if (child_counts) {
            canonical << axis.transpose() << ' ' << model->joints_.back().lower_rad << ' '
                      << model->joints_.back().upper_rad << '\n';
          }
          model->bodies_.push_back({body, T_body_link * T_link_joint, axis.normalized()});
          add(*child, model->bodies_.size() - 1, Eigen::Isometry3d::Identity(), counts);
        }
      };
  add(*urdf->getRoot(), 0, Eigen::Isometry3d::Identity(), true);
  model->canonical_ = canonical.str();
  return model;
}

std::size_t RobotModel::jointIndex(const std::string& joint) const {
  for (std::size_t i = 0; i < joints_.size(); ++i) {
    if (joints_[i].name == joint) return i;
  }
  throw std::invalid_argument("the URDF has no moving joint '" + joint + "'");
}

std::size_t RobotModel::bodyOf(const std::string& frame) const {
  const auto found = frames_.find(frame);
  if (found == frames_.end()) throw std::invalid_argument("the URDF has no link '" + frame + "'");
  return found->second.body;
}

std::vector<std::string> RobotModel::frameNames() const {
  std::vector<std::string> names;
  names.reserve(frames_.size());
  for (const auto& [name, frame] : frames_) names.push_back(name);
  return names;
}

const Eigen::Isometry3d& RobotModel::poseInBody(const std::string& frame) const {
  const auto found = frames_.find(frame);
  if (found == frames_.end()) throw std::invalid_argument("the URDF has no link '" + frame + "'");
  return found->second.T_body_frame;
}

void RobotModel::bodyPoses(const Eigen::VectorXd& positions_rad, std::vector<Eigen::Isometry3d>* T_root_body) const {
  if (static_cast<std::size_t>(positions_rad.size()) != joints_.size()) {
    throw std::invalid_argument(std::to_string(positions_rad.size()) + " joint positions, must be " +
                                std::to_string(joints_.size()));
  }
  T_root_body->resize(bodies_.size());
  (*T_root_body)[0].setIdentity();
  for (std::size_t i = 1; i < bodies_.size(); ++i) {
    const Body& body = bodies_[i];
    (*T_root_body)[i] = (*T_root_body)[body.parent] * body.T_parent_joint *
                        Eigen::AngleAxisd(positions_rad[static_cast<Eigen::Index>(i) - 1], body.axis);
  }
}

Eigen::Isometry3d RobotModel::framePose(const std::string& frame, const Eigen::VectorXd& positions_rad) const {
  const std::size_t body = bodyOf(frame);
  std::vector<Eigen::Isometry3d> poses;
  bodyPoses(positions_rad, &poses);
  return poses[body] * poseInBody(frame);
}

KDL::Chain RobotModel::chain(const std::string& root, const std::string& tip) const {
  KDL::Chain chain;
  if (!tree_.getChain(root, tip, chain)) {
    throw std::invalid_argument("the URDF has no chain from '" + root + "' to '" + tip + "'");
  }
  return chain;
}

std::string RobotModel::checksum() const {
  // FNV-1a: stale files are to be noticed, nobody forges them.
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const char c : canonical_) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3ULL;
  std::ostringstream text;
  text << std::hex << std::setfill('0') << std::setw(16) << hash;
  return text.str();
}

}  // namespace mp700_ur5e_description
