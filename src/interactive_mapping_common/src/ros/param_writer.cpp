// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common_ros/param_writer.h>

#include <yaml-cpp/yaml.h>

namespace interactive_mapping_ros {
namespace {

template <typename Value>
void put(YAML::Node node, const std::string& key, const Value& value) {
  const std::size_t slash = key.find('/');
  if (slash == std::string::npos) {
    node[key] = value;
  } else {
    put(node[key.substr(0, slash)], key.substr(slash + 1), value);
  }
}

}  // namespace

struct ParamWriter::State {
  YAML::Node root{YAML::NodeType::Map};
};

ParamWriter::ParamWriter() : state_(std::make_unique<State>()) {}
ParamWriter::~ParamWriter() = default;

void ParamWriter::write(const std::string& key, double value) {
  put(state_->root, key, value);
}
void ParamWriter::write(const std::string& key, int value) {
  put(state_->root, key, value);
}
void ParamWriter::write(const std::string& key, bool value) {
  put(state_->root, key, value);
}
void ParamWriter::write(const std::string& key, const std::string& value) {
  put(state_->root, key, value);
}
void ParamWriter::write(const std::string& key, const std::vector<std::string>& value) {
  put(state_->root, key, value);
}
void ParamWriter::write(const std::string& key, const std::vector<double>& value) {
  put(state_->root, key, value);
}

std::string ParamWriter::text() const {
  return YAML::Dump(state_->root);
}

}  // namespace interactive_mapping_ros
