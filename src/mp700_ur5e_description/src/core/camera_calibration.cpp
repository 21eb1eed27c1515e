// SPDX-License-Identifier: BSD-3-Clause
#include "mp700_ur5e_description/camera_calibration.h"

#include <cmath>
#include <stdexcept>

#include <tinyxml2.h>
#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/files/yaml_map.h>

#include "urdf_origin.h"

namespace mp700_ur5e_description {
namespace {

using interactive_mapping::Interval;
using interactive_mapping::readYaml;
using interactive_mapping::toText;
using interactive_mapping::YamlMap;

std::string digits(double value) {
  return toDigits(Eigen::VectorXd::Constant(1, value), "");
}

Eigen::Matrix3d fromRpy(const Eigen::Vector3d& rpy) {
  return (Eigen::AngleAxisd(rpy.z(), Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(rpy.y(), Eigen::Vector3d::UnitY()) *
          Eigen::AngleAxisd(rpy.x(), Eigen::Vector3d::UnitX()))
      .toRotationMatrix();
}

std::string attribute(const tinyxml2::XMLElement* joint, const char* element, const char* name) {
  const tinyxml2::XMLElement* child = joint->FirstChildElement(element);
  const char* value = child == nullptr ? nullptr : child->Attribute(name);
  return value == nullptr ? "" : value;
}

}  // namespace

Eigen::Vector3d toRpy(const Eigen::Matrix3d& R) {
  const double across = std::hypot(R(2, 1), R(2, 2));
  if (across < 1e-9) {  // nose straight up or down: roll and yaw turn about the same axis, roll is taken as zero
    return {0.0, std::atan2(-R(2, 0), across), std::atan2(-R(0, 1), R(1, 1))};
  }
  return {std::atan2(R(2, 1), R(2, 2)), std::atan2(-R(2, 0), across), std::atan2(R(1, 0), R(0, 0))};
}

std::string toYaml(const CameraCalibration& calibration) {
  const Eigen::Quaterniond q = Eigen::Quaterniond(calibration.T_parent_child.linear()).normalized();
  const auto list = [](const auto& values) { return "[" + toDigits(values, ", ") + "]\n"; };
  return "# Measured by calibrate_camera. To use it:\n"
         "#   roslaunch mp700_ur5e_description description.launch camera_calibration:=<absolute path of this file>\n"
         "parent_frame: " +
         calibration.parent_frame + "\nchild_frame: " + calibration.child_frame +
         "\ntranslation_m: " + list(calibration.T_parent_child.translation()) +
         "rotation_xyzw: " + list(Eigen::Vector4d(q.coeffs())) +
         "rpy_rad: " + list(toRpy(calibration.T_parent_child.linear())) +
         "# How good it is: standard deviations along and about the parent's axes.\n"
         "std_m: " +
         list(calibration.std_m) + "std_rad: " + list(calibration.std_rad) + "date: \"" + calibration.date +
         "\"\nsamples: " + std::to_string(calibration.samples) + "\noutliers: " + std::to_string(calibration.outliers) +
         "\nrms_m: " + digits(calibration.rms_m) + "\nrms_rad: " + digits(calibration.rms_rad) +
         "\nleave_one_out_rms_m: " + digits(calibration.leave_one_out_rms_m) +
         "\nleave_one_out_rms_rad: " + digits(calibration.leave_one_out_rms_rad) + "\n";
}

CameraCalibration parseCameraCalibration(const std::string& text, const std::string& name) {
  const Interval place{-10.0, 10.0, "m"};
  const Interval angle{-2.0 * M_PI, 2.0 * M_PI, "rad"};
  const Interval error_m{0.0, 1.0, "m"};
  const Interval error_rad{0.0, M_PI, "rad"};
  CameraCalibration calibration;
  readYaml(text, name, [&](YamlMap& file, std::vector<std::string>& problems) {
    calibration.parent_frame = file.word("parent_frame");
    calibration.child_frame = file.word("child_frame");
    if (!calibration.child_frame.empty() && calibration.child_frame == calibration.parent_frame) {
      file.note("child_frame", calibration.child_frame, "another frame than parent_frame");
    }
    calibration.T_parent_child.translation() = file.numbers("translation_m", 3, place);
    const std::size_t num_problems = problems.size();
    const Eigen::Vector4d xyzw = file.numbers("rotation_xyzw", 4, {-1.0, 1.0, ""});
    const bool is_read = problems.size() == num_problems;
    const Eigen::Vector3d rpy = file.numbers("rpy_rad", 3, angle);
    Eigen::Quaterniond q(xyzw);
    // What the file's ten digits leave is 1e-10; more is an error of whoever edited it.
    constexpr double kRounding = 1e-6;
    if (std::abs(q.norm() - 1.0) > kRounding) {
      if (is_read) file.note("rotation_xyzw", "of length " + toText(q.norm()), "of length 1");
      q = Eigen::Quaterniond::Identity();
    } else if (q.angularDistance(Eigen::Quaterniond(fromRpy(rpy))) > kRounding) {
      file.note("rpy_rad", toDigits(rpy, " "),
                "the rotation of rotation_xyzw: " + toDigits(toRpy(q.toRotationMatrix()), " "));
    }
    calibration.T_parent_child.linear() = q.normalized().toRotationMatrix();
    calibration.std_m = file.numbers("std_m", 3, error_m);
    calibration.std_rad = file.numbers("std_rad", 3, error_rad);
    calibration.date = file.word("date");
    calibration.samples = file.integer("samples", {1, 100000, ""});
    calibration.outliers = file.integer("outliers", {0, 100000, ""});
    calibration.rms_m = file.number("rms_m", error_m);
    calibration.rms_rad = file.number("rms_rad", error_rad);
    calibration.leave_one_out_rms_m = file.number("leave_one_out_rms_m", error_m);
    calibration.leave_one_out_rms_rad = file.number("leave_one_out_rms_rad", error_rad);
    file.finish();
  });
  return calibration;
}

CameraCalibration loadCameraCalibration(const std::string& path) {
  return parseCameraCalibration(interactive_mapping::readTextFile(path), path);
}

std::string calibratedUrdf(const std::string& urdf, const CameraCalibration& calibration) {
  tinyxml2::XMLDocument document;
  tinyxml2::XMLElement* robot = parseUrdf(urdf, &document);
  const std::string edge = calibration.parent_frame + " -> " + calibration.child_frame;
  for (tinyxml2::XMLElement* joint = robot->FirstChildElement("joint"); joint != nullptr;
       joint = joint->NextSiblingElement("joint")) {
    if (attribute(joint, "child", "link") != calibration.child_frame) continue;
    const std::string parent = attribute(joint, "parent", "link");
    if (parent != calibration.parent_frame) {
      throw std::invalid_argument("the calibration is of " + edge + ", but in the URDF " + calibration.child_frame +
                                  " is on " + parent);
    }
    const char* type = joint->Attribute("type");
    if (type == nullptr || std::string(type) != "fixed") {
      throw std::invalid_argument("the joint " + edge + " is " + (type == nullptr ? "without type" : type) +
                                  ", must be fixed to be calibrated");
    }
    setOrigin(joint, calibration.T_parent_child.translation(), toRpy(calibration.T_parent_child.linear()));
    return toText(document);
  }
  throw std::invalid_argument("the calibration is of " + edge + ", but no joint in the URDF has the child " +
                              calibration.child_frame);
}

}  // namespace mp700_ur5e_description
