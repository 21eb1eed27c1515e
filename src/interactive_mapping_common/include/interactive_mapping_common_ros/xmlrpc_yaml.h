// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <XmlRpcValue.h>
#include <yaml-cpp/yaml.h>

namespace interactive_mapping_ros {

/// For a FieldReader, with tags for the types that the value has.
YAML::Node toYaml(XmlRpc::XmlRpcValue value);

}  // namespace interactive_mapping_ros
