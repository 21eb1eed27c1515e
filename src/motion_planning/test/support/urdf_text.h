// SPDX-License-Identifier: BSD-3-Clause
// The shipped URDF as text, and changes to it.
#pragma once

#include <fstream>
#include <iomanip>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>

#include <Eigen/Core>
#include <mp700_ur5e_description/robot_names.h>

namespace motion_planning {

inline const std::string kUrdfFile = DESCRIPTION_DIR "/urdf/mp700_ur5e.urdf";

inline std::string readFile(const std::string& path) {
  std::ifstream file(path);
  std::ostringstream text;
  if (!file || !(text << file.rdbuf())) throw std::runtime_error("cannot read " + path);
  return text.str();
}

/// Value of an attribute, three numbers if there are as many, of the first `tag` after the head of a joint.
class JointAttribute {
 public:
  JointAttribute(std::string* urdf, const std::string& joint, const std::string& tag, const std::string& attribute)
      : urdf_(urdf) {
    const std::size_t head = find("<joint name=\"" + joint + "\"", 0);
    const std::size_t element = find("<" + tag + " ", head);
    if (element > find("</joint>", head)) throw std::runtime_error(joint + " has no " + tag);
    begin_ = find(attribute + "=\"", element) + attribute.size() + 2;
    end_ = find("\"", begin_);
  }

  std::string get() const { return urdf_->substr(begin_, end_ - begin_); }
  void set(const std::string& value) {
    urdf_->replace(begin_, end_ - begin_, value);
    end_ = begin_ + value.size();
  }
  Eigen::Vector3d vector() const {
    std::istringstream text(get());
    Eigen::Vector3d value;
    if (!(text >> value.x() >> value.y() >> value.z())) throw std::runtime_error("no vector: " + get());
    return value;
  }
  void set(const Eigen::Vector3d& value) {
    std::ostringstream text;
    text << std::setprecision(17) << value.x() << ' ' << value.y() << ' ' << value.z();
    set(text.str());
  }

 private:
  std::size_t find(const std::string& what, std::size_t from) const {
    const std::size_t at = urdf_->find(what, from);
    if (at == std::string::npos) throw std::runtime_error("the URDF has no " + what);
    return at;
  }

  std::string* urdf_;
  std::size_t begin_;
  std::size_t end_;
};

/// As a factory calibration does: every arm joint's origin by up to `position_m` and `angle_rad` along and about each axis.
inline std::string calibrated(std::string urdf, double position_m, double angle_rad, unsigned seed) {
  std::mt19937_64 rng(seed);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  for (const std::string joint : mp700_ur5e_description::kArmJoints) {
    JointAttribute xyz(&urdf, joint, "origin", "xyz");
    xyz.set(xyz.vector() + position_m * Eigen::Vector3d(unit(rng), unit(rng), unit(rng)));
    JointAttribute rpy(&urdf, joint, "origin", "rpy");
    rpy.set(rpy.vector() + angle_rad * Eigen::Vector3d(unit(rng), unit(rng), unit(rng)));
  }
  return urdf;
}

inline std::string withLimits(std::string urdf, const std::string& joint, double lower_rad, double upper_rad) {
  JointAttribute(&urdf, joint, "limit", "lower").set(std::to_string(lower_rad));
  JointAttribute(&urdf, joint, "limit", "upper").set(std::to_string(upper_rad));
  return urdf;
}

}  // namespace motion_planning
