// SPDX-License-Identifier: BSD-3-Clause
#include "mp700_ur5e_description/arm_calibration.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

#include <tinyxml2.h>
#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/files/yaml_map.h>

#include "mp700_ur5e_description/robot_model.h"
#include "mp700_ur5e_description/robot_names.h"
#include "urdf_origin.h"

namespace mp700_ur5e_description {
namespace {

using interactive_mapping::Interval;
using interactive_mapping::readYaml;
using interactive_mapping::YamlMap;

constexpr std::array<const char*, 6> kLinks = {"shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"};
constexpr int kPostures = 2000;

}  // namespace

ArmCalibration parseArmCalibration(const std::string& text, const std::string& name) {
  const Interval place{-2.0, 2.0, "m"};
  const Interval angle{-2.0 * M_PI, 2.0 * M_PI, "rad"};
  ArmCalibration calibration;
  readYaml(text, name, [&](YamlMap& file, std::vector<std::string>& /*problems*/) {
    YamlMap kinematics = file.map("kinematics");
    for (std::size_t i = 0; i < kLinks.size(); ++i) {
      YamlMap link = kinematics.map(kLinks[i]);
      ArmCalibration::Origin& origin = calibration.origins[i];
      origin.xyz_m = {link.number("x", place), link.number("y", place), link.number("z", place)};
      origin.rpy_rad = {link.number("roll", angle), link.number("pitch", angle), link.number("yaw", angle)};
      link.finish();
    }
    kinematics.word("hash");
    kinematics.finish();
    file.finish();
  });
  return calibration;
}

ArmCalibration loadArmCalibration(const std::string& path) {
  return parseArmCalibration(interactive_mapping::readTextFile(path), path);
}

std::string calibratedUrdf(const std::string& urdf, const ArmCalibration& calibration) {
  tinyxml2::XMLDocument document;
  tinyxml2::XMLElement* robot = parseUrdf(urdf, &document);
  for (std::size_t i = 0; i < kArmJoints.size(); ++i) {
    tinyxml2::XMLElement* joint = robot->FirstChildElement("joint");
    while (joint != nullptr && !joint->Attribute("name", kArmJoints[i])) joint = joint->NextSiblingElement("joint");
    if (joint == nullptr) throw std::invalid_argument(std::string("the URDF has no joint ") + kArmJoints[i]);
    setOrigin(joint, calibration.origins[i].xyz_m, calibration.origins[i].rpy_rad);
  }
  return toText(document);
}

ArmDifference differenceOf(const std::string& urdf, const ArmCalibration& calibration) {
  const auto drawn = RobotModel::parse(urdf, "the URDF");
  const auto measured = RobotModel::parse(calibratedUrdf(urdf, calibration), "the calibrated URDF");
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> angle_rad(-M_PI, M_PI);
  Eigen::VectorXd positions_rad = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(drawn->joints().size()));
  ArmDifference difference;
  for (int i = 0; i < kPostures; ++i) {
    for (const char* joint : kArmJoints) {
      positions_rad[static_cast<Eigen::Index>(drawn->jointIndex(joint))] = angle_rad(random);
    }
    const Eigen::Isometry3d off = measured->framePose(kMagnetTipFrame, positions_rad).inverse() *
                                  drawn->framePose(kMagnetTipFrame, positions_rad);
    difference.mean_m += off.translation().norm() / kPostures;
    difference.worst_m = std::max(difference.worst_m, off.translation().norm());
    difference.worst_rad = std::max(difference.worst_rad, std::abs(Eigen::AngleAxisd(off.linear()).angle()));
  }
  return difference;
}

}  // namespace mp700_ur5e_description
