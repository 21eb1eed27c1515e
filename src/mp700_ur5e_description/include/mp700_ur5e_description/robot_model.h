// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include <Eigen/Geometry>
#include <kdl/chain.hpp>
#include <kdl/tree.hpp>

namespace mp700_ur5e_description {

/// Shapes are centred in their frame; a cylinder's axis is z.
struct Box {
  Eigen::Vector3d size_m;  // full edges
};
struct Cylinder {
  double radius_m;
  double length_m;
};
struct Sphere {
  double radius_m;
};
using Shape = std::variant<Box, Cylinder, Sphere>;

/// A collision shape of the URDF, fixed to a body.
struct BodyShape {
  std::size_t body;  // index, see RobotModel
  std::string link;  // the URDF's name of the link it belongs to
  Shape shape;
  Eigen::Isometry3d T_body_shape;
};

/// The robot as its URDF says: kinematic tree, limits and collision shapes, read once. Links that fixed joints hold
/// together are one *body*; body 0 is the root's. Immutable and safe for any number of threads.
class RobotModel {
 public:
  struct Joint {
    std::string name;
    double lower_rad;  // -inf, +inf: continuous
    double upper_rad;
    double velocity_rad_s;  // limit; +inf: none given
  };

  /// Throws std::invalid_argument that says what is wrong: no URDF, no tree, a moving joint that does not turn, a collision
  /// shape that is a mesh. `name` is what messages call the text.
  static std::shared_ptr<const RobotModel> parse(const std::string& urdf_xml, const std::string& name);
  static std::shared_ptr<const RobotModel> load(const std::string& path);

  const std::string& rootFrame() const { return root_; }
  /// Moving joints; body i + 1 is the one that joint i moves.
  const std::vector<Joint>& joints() const { return joints_; }
  /// Throws std::invalid_argument for a name the URDF does not have.
  std::size_t jointIndex(const std::string& joint) const;
  const std::vector<BodyShape>& shapes() const { return shapes_; }

  std::size_t numBodies() const { return bodies_.size(); }
  std::size_t parentBody(std::size_t body) const { return bodies_[body].parent; }  // of the root's: itself

  bool hasFrame(const std::string& frame) const { return frames_.count(frame) != 0; }
  std::vector<std::string> frameNames() const;  // by name
  /// Body that carries the frame, and where. Throws std::invalid_argument for a name the URDF does not have.
  std::size_t bodyOf(const std::string& frame) const;
  const Eigen::Isometry3d& poseInBody(const std::string& frame) const;  // T_body_frame

  /// T_root_body for all bodies, `positions_rad` in the order of joints(). Throws std::invalid_argument for another size.
  void bodyPoses(const Eigen::VectorXd& positions_rad, std::vector<Eigen::Isometry3d>* T_root_body) const;
  /// T_root_frame. Slower: for one frame at a time.
  Eigen::Isometry3d framePose(const std::string& frame, const Eigen::VectorXd& positions_rad) const;

  const KDL::Tree& tree() const { return tree_; }
  /// Throws std::invalid_argument if there is no chain between the two.
  KDL::Chain chain(const std::string& root, const std::string& tip) const;

  /// 16 hexadecimal digits over what decides where the arm reaches: joints, limits and collision shapes. The camera (all
  /// below `camera_link`) is left out: a calibration moves it by millimetres, and no arm reaches farther for it.
  std::string checksum() const;

 private:
  struct Body {
    std::size_t parent;
    Eigen::Isometry3d T_parent_joint;  // where the joint's frame is at angle zero
    Eigen::Vector3d axis;              // in the joint's frame
  };
  struct Frame {
    std::size_t body;
    Eigen::Isometry3d T_body_frame;
  };

  RobotModel() = default;

  std::string root_;
  std::vector<Joint> joints_;
  std::vector<Body> bodies_;
  std::vector<BodyShape> shapes_;
  std::map<std::string, Frame> frames_;
  std::string canonical_;  // what checksum() sums up
  KDL::Tree tree_;
};

}  // namespace mp700_ur5e_description
