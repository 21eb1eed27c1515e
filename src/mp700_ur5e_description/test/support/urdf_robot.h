// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <kdl/tree.hpp>
#include <kdl/treefksolverpos_recursive.hpp>
#include <kdl_parser/kdl_parser.hpp>
#include <urdf_model/model.h>
#include <urdf_parser/urdf_parser.h>

#include "mp700_ur5e_description/arm_pose.h"
#include "mp700_ur5e_description/robot_names.h"

namespace mp700_ur5e_description {

inline const std::string kUrdfFile = DESCRIPTION_DIR "/urdf/mp700_ur5e.urdf";

inline Eigen::Isometry3d toEigen(const urdf::Pose& pose) {
  Eigen::Isometry3d result = Eigen::Isometry3d::Identity();
  result.translation() = Eigen::Vector3d(pose.position.x, pose.position.y, pose.position.z);
  result.linear() =
      Eigen::Quaterniond(pose.rotation.w, pose.rotation.x, pose.rotation.y, pose.rotation.z).toRotationMatrix();
  return result;
}

inline Eigen::Isometry3d toEigen(const KDL::Frame& frame) {
  Eigen::Isometry3d result;
  for (int row = 0; row < 4; ++row) {
    for (int col = 0; col < 4; ++col) result(row, col) = frame(row, col);
  }
  return result;
}

/// The shipped URDF, and where KDL puts its links.
class UrdfRobot {
 public:
  UrdfRobot() : urdf_(urdf::parseURDFFile(kUrdfFile)) {
    if (!urdf_ || !kdl_parser::treeFromFile(kUrdfFile, tree_)) throw std::runtime_error("cannot read " + kUrdfFile);
  }

  const urdf::ModelInterface& urdf() const { return *urdf_; }
  const KDL::Tree& tree() const { return tree_; }

  KDL::Chain chain(const std::string& from, const std::string& to) const {
    KDL::Chain result;
    if (!tree_.getChain(from, to, result)) throw std::runtime_error("no chain from " + from + " to " + to);
    return result;
  }

  /// Wheels stay where they are.
  Eigen::Isometry3d linkPose(const std::string& link, const ArmPose& arm) const {
    KDL::JntArray q(tree_.getNrOfJoints());
    for (const auto& [name, element] : tree_.getSegments()) {
      for (std::size_t i = 0; i < kArmJoints.size(); ++i) {
        if (element.segment.getJoint().getName() == kArmJoints[i]) q(element.q_nr) = arm[static_cast<Eigen::Index>(i)];
      }
    }
    KDL::Frame frame;
    KDL::TreeFkSolverPos_recursive solver(tree_);
    if (solver.JntToCart(q, frame, link) < 0) throw std::runtime_error("no link " + link);
    return toEigen(frame);
  }

 private:
  urdf::ModelInterfaceSharedPtr urdf_;
  KDL::Tree tree_;
};

}  // namespace mp700_ur5e_description
