// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/robot_mjcf.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include <Eigen/Geometry>
#include <urdf_parser/urdf_parser.h>

namespace simulated_world {
namespace {

constexpr double kDegreesPerRadian = 180.0 / M_PI;
constexpr const char* kCameraFrame = "camera_depth_optical_frame";

struct Site {
  const char* name;
  const char* frame;
};
constexpr std::array<Site, 3> kSites = {
    {{"magnet_tip", "magnet_tip"}, {"wrist_ft", "ur5e_tool0"}, {"lidar_1_link", "lidar_1_link"}}};

/// Attributes of an element; doubles keep every digit.
class Element {
 public:
  Element(std::ostream& out, int depth, const std::string& tag) : out_(out) {
    out_ << std::string(static_cast<std::size_t>(2 * depth), ' ') << '<' << tag;
  }
  Element& text(const std::string& key, const std::string& value) {
    out_ << ' ' << key << "=\"";
    for (const char c : value) {
      switch (c) {
        case '&':
          out_ << "&amp;";
          break;
        case '<':
          out_ << "&lt;";
          break;
        case '"':
          out_ << "&quot;";
          break;
        default:
          out_ << c;
      }
    }
    out_ << '"';
    return *this;
  }
  Element& numbers(const std::string& key, std::initializer_list<double> values) {
    std::ostringstream list;
    list.precision(17);
    for (const double value : values) list << (list.tellp() > 0 ? " " : "") << value;
    return text(key, list.str());
  }
  Element& pose(const urdf::Pose& pose) {
    numbers("pos", {pose.position.x, pose.position.y, pose.position.z});
    return numbers("quat", {pose.rotation.w, pose.rotation.x, pose.rotation.y, pose.rotation.z});
  }
  void close() { out_ << "/>\n"; }
  void open() { out_ << ">\n"; }

 private:
  std::ostream& out_;
};

class RobotWriter {
 public:
  RobotWriter(const urdf::ModelInterface& model, const RobotMjcfOptions& options) : model_(model), options_(options) {}

  std::string write() {
    writeBody(*model_.getRoot(), 0);
    return out_.str();
  }

 private:
  void writeBody(const urdf::Link& link, int depth) {
    Element body(out_, depth, "body");
    body.text("name", link.name);
    if (link.parent_joint) body.pose(link.parent_joint->parent_to_joint_origin_transform);
    body.open();
    if (link.parent_joint) {
      writeJoint(*link.parent_joint, depth + 1);
    } else {
      writeBaseJoints(depth + 1);
    }
    if (link.inertial) {
      writeInertial(*link.inertial, depth + 1);
    } else {  // left out, MuJoCo would derive one from the shapes
      Element(out_, depth + 1, "inertial")
          .numbers("pos", {0, 0, 0})
          .numbers("mass", {0})
          .numbers("diaginertia", {0, 0, 0})
          .close();
    }
    writeShapes(link, depth + 1);
    writeCameraAndSites(link, depth + 1);
    for (const urdf::LinkSharedPtr& child : link.child_links) writeBody(*child, depth + 1);
    out_ << std::string(static_cast<std::size_t>(2 * depth), ' ') << "</body>\n";
  }

  // Slides before the hinge: they keep the world's directions, whatever the yaw.
  void writeBaseJoints(int depth) {
    writeBaseJoint(depth, "base_x", "slide", {1, 0, 0}, options_.base_linear);
    writeBaseJoint(depth, "base_y", "slide", {0, 1, 0}, options_.base_linear);
    writeBaseJoint(depth, "base_yaw", "hinge", {0, 0, 1}, options_.base_turn);
  }

  void writeBaseJoint(int depth, const char* name, const char* type, std::initializer_list<double> axis,
                      const JointDynamics& dynamics) {
    Element joint(out_, depth, "joint");
    joint.text("name", name).text("type", type).numbers("axis", axis).text("limited", "false");
    joint.numbers("armature", {dynamics.armature}).numbers("damping", {dynamics.damping});
    joint.close();
  }

  void writeJoint(const urdf::Joint& joint, int depth) {
    if (joint.type == urdf::Joint::FIXED) return;
    const bool is_continuous = joint.type == urdf::Joint::CONTINUOUS;
    const bool is_slide = joint.type == urdf::Joint::PRISMATIC;
    if (!is_continuous && !is_slide && joint.type != urdf::Joint::REVOLUTE) {
      throw std::invalid_argument("URDF: type of joint " + joint.name +
                                  " = floating or planar, must be one of: continuous, fixed, prismatic, revolute");
    }
    const JointDynamics& dynamics = is_continuous ? options_.wheel : options_.arm;
    Element element(out_, depth, "joint");
    element.text("name", joint.name).text("type", is_slide ? "slide" : "hinge");
    element.numbers("axis", {joint.axis.x, joint.axis.y, joint.axis.z});
    if (is_continuous) {
      element.text("limited", "false");
    } else {
      element.text("limited", "true").numbers("range", {joint.limits->lower, joint.limits->upper});
    }
    element.numbers("armature", {dynamics.armature}).numbers("damping", {dynamics.damping}).close();
  }

  void writeInertial(const urdf::Inertial& inertial, int depth) {
    // MJCF takes no rotation beside a full inertia matrix: turn the matrix into the link's axes.
    Eigen::Matrix3d inertia;
    inertia << inertial.ixx, inertial.ixy, inertial.ixz, inertial.ixy, inertial.iyy, inertial.iyz, inertial.ixz,
        inertial.iyz, inertial.izz;
    const urdf::Rotation& q = inertial.origin.rotation;
    const Eigen::Matrix3d R = Eigen::Quaterniond(q.w, q.x, q.y, q.z).toRotationMatrix();
    inertia = R * inertia * R.transpose();
    const urdf::Vector3& center = inertial.origin.position;
    Element(out_, depth, "inertial")
        .numbers("pos", {center.x, center.y, center.z})
        .numbers("mass", {inertial.mass})
        .numbers("fullinertia",
                 {inertia(0, 0), inertia(1, 1), inertia(2, 2), inertia(0, 1), inertia(0, 2), inertia(1, 2)})
        .close();
  }

  void writeShapes(const urdf::Link& link, int depth) {
    const std::vector<std::string>& ghosts = options_.links_without_contact;
    const bool is_wheel = link.parent_joint && link.parent_joint->type == urdf::Joint::CONTINUOUS;
    const bool collides = !is_wheel && std::find(ghosts.begin(), ghosts.end(), link.name) == ghosts.end();
    for (std::size_t i = 0; i < link.collision_array.size(); ++i) {
      Element geom(out_, depth, "geom");
      geom.text("name", link.name + "/c" + std::to_string(i));
      writeShape(geom, link, *link.collision_array[i]->geometry, link.collision_array[i]->origin);
      geom.text("group", "3").numbers("friction", {options_.friction, 0.005, 0.0001});  // the last two are MuJoCo's
      geom.text("contype", collides ? "1" : "0").text("conaffinity", collides ? "1" : "0");
      geom.numbers("rgba", {0.8, 0.3, 0.8, 0.4}).close();
    }
    for (std::size_t i = 0; i < link.visual_array.size(); ++i) {
      const urdf::Visual& visual = *link.visual_array[i];
      Element geom(out_, depth, "geom");
      geom.text("name", link.name + "/v" + std::to_string(i));
      writeShape(geom, link, *visual.geometry, visual.origin);
      geom.text("group", "2").text("contype", "0").text("conaffinity", "0");
      if (visual.material) {
        const urdf::Color& color = visual.material->color;
        geom.numbers("rgba", {color.r, color.g, color.b, color.a});
      }
      geom.close();
    }
  }

  // Sizes are half lengths. Mass is the inertial's alone.
  static void writeShape(Element& geom, const urdf::Link& link, const urdf::Geometry& shape, const urdf::Pose& origin) {
    switch (shape.type) {
      case urdf::Geometry::BOX: {
        const urdf::Vector3& size = static_cast<const urdf::Box&>(shape).dim;
        geom.text("type", "box").numbers("size", {0.5 * size.x, 0.5 * size.y, 0.5 * size.z});
        break;
      }
      case urdf::Geometry::CYLINDER: {
        const auto& cylinder = static_cast<const urdf::Cylinder&>(shape);
        geom.text("type", "cylinder").numbers("size", {cylinder.radius, 0.5 * cylinder.length});
        break;
      }
      case urdf::Geometry::SPHERE:
        geom.text("type", "sphere").numbers("size", {static_cast<const urdf::Sphere&>(shape).radius});
        break;
      default:
        throw std::invalid_argument("URDF: shape of link " + link.name + " = mesh, must be a box, cylinder or sphere");
    }
    geom.pose(origin);
  }

  void writeCameraAndSites(const urdf::Link& link, int depth) {
    if (link.name == kCameraFrame) {
      // Optical frame: z forward, y down. MuJoCo's camera: looks along -z, y up. Between them half a turn about x.
      Element(out_, depth, "camera")
          .text("name", "rgbd")
          .numbers("quat", {0, 1, 0, 0})
          .numbers("fovy", {options_.camera_fovy_rad * kDegreesPerRadian})  // degrees always, unlike ranges
          .close();
    }
    for (const Site& site : kSites) {
      if (link.name == site.frame) {
        Element(out_, depth, "site").text("name", site.name).text("group", "4").numbers("size", {0.005}).close();
      }
    }
  }

  const urdf::ModelInterface& model_;
  const RobotMjcfOptions& options_;
  std::ostringstream out_;
};

}  // namespace

std::vector<std::string> RobotMjcfOptions::validate() const {
  std::vector<std::string> problems;
  const auto check = [&](const std::string& key, double value, bool is_good, const std::string& rule) {
    if (is_good) return;
    std::ostringstream line;
    line << key << " = " << value << ", must be " << rule;
    problems.push_back(line.str());
  };
  const auto checkDynamics = [&](const std::string& key, const JointDynamics& dynamics) {
    for (const auto& [name, value] :
         {std::pair("armature", dynamics.armature), std::pair("damping", dynamics.damping)}) {
      check(key + "." + name, value, value >= 0.0 && std::isfinite(value), "finite and at least 0");
    }
  };
  checkDynamics("base_linear", base_linear);
  checkDynamics("base_turn", base_turn);
  checkDynamics("arm", arm);
  checkDynamics("wheel", wheel);
  check("camera_fovy_rad", camera_fovy_rad, camera_fovy_rad > 0.0 && camera_fovy_rad < M_PI, "in (0, pi) rad");
  check("friction", friction, friction >= 0.0 && std::isfinite(friction), "finite and at least 0");
  return problems;
}

std::string robotMjcf(const urdf::ModelInterface& model, const RobotMjcfOptions& options) {
  std::vector<std::string> problems = options.validate();
  std::vector<std::string> needed{kCameraFrame};
  for (const Site& site : kSites) needed.emplace_back(site.frame);
  for (const std::string& link : needed) {
    if (!model.getLink(link)) problems.push_back("URDF: link " + link + " is missing");
  }
  if (!problems.empty()) {
    std::string message;
    for (const std::string& problem : problems) message += (message.empty() ? "" : "\n") + problem;
    throw std::invalid_argument(message);
  }
  return RobotWriter(model, options).write();
}

std::string robotMjcfFromFile(const std::string& urdf_file, const RobotMjcfOptions& options) {
  const urdf::ModelInterfaceSharedPtr model = urdf::parseURDFFile(urdf_file);
  if (!model) throw std::invalid_argument(urdf_file + ": no URDF that can be read");
  return robotMjcf(*model, options);
}

}  // namespace simulated_world
