// SPDX-License-Identifier: BSD-3-Clause
#include "mp700_ur5e_description/arm_pose.h"

#include "mp700_ur5e_description/robot_names.h"
#include "yaml_file.h"

namespace mp700_ur5e_description {

ArmPose parseArmPose(const std::string& text, const std::string& name) {
  const Interval angle{-6.2832, 6.2832, "rad"};
  ArmPose pose = ArmPose::Zero();
  readYaml(text, name, [&](YamlMap& joints, std::vector<std::string>&) {
    for (std::size_t i = 0; i < kArmJoints.size(); ++i) {
      pose[static_cast<Eigen::Index>(i)] = joints.number(kArmJoints[i], angle);
    }
    joints.finish();
  });
  return pose;
}

ArmPose loadArmPose(const std::string& path) {
  return parseArmPose(readText(path), path);
}

}  // namespace mp700_ur5e_description
