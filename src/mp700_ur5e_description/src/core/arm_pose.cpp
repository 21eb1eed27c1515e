// SPDX-License-Identifier: BSD-3-Clause
#include "mp700_ur5e_description/arm_pose.h"

#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/files/yaml_map.h>

#include "mp700_ur5e_description/robot_names.h"

namespace mp700_ur5e_description {

using interactive_mapping::Interval;
using interactive_mapping::readYaml;
using interactive_mapping::YamlMap;

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
  return parseArmPose(interactive_mapping::readTextFile(path), path);
}

}  // namespace mp700_ur5e_description
