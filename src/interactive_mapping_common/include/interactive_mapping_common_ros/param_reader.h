// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <set>
#include <string>
#include <vector>

#include <XmlRpcValue.h>
#include <ros/node_handle.h>

namespace interactive_mapping_ros {

/// Reads a node's private parameters into structs: a missing key keeps its default; wrong types, unknown keys and the
/// problems that `validate()` of the structs found are reported together by finish().
class ParamReader {
 public:
  explicit ParamReader(const ros::NodeHandle& private_nh);

  /// `key` is relative and may have sections: "output/rate_hz". An integer will do for a double, nothing else is
  /// converted.
  void read(const std::string& key, double* value);
  void read(const std::string& key, int* value);
  void read(const std::string& key, bool* value);
  void read(const std::string& key, std::string* value);
  void read(const std::string& key, std::vector<std::string>* value);
  void read(const std::string& key, std::vector<double>* value);

  /// The section as YAML text, empty when there is none: for configurations that have a reader of their own.
  std::string yamlOf(const std::string& section);

  /// Keys (or sections) that belong to libraries: not unknown, and not looked at.
  void ignore(const std::string& key) { known_.insert(key); }

  /// `problems` as sentences that begin with a key; `section` is put before each.
  void report(const std::string& section, const std::vector<std::string>& problems);

  /// Throws one std::invalid_argument that lists every problem, each with the parameter's full name.
  void finish();

 private:
  const XmlRpc::XmlRpcValue* find(const std::string& key);
  void reportType(const std::string& key, const XmlRpc::XmlRpcValue& value, const char* wanted);
  void reportUnknown(const XmlRpc::XmlRpcValue& section, const std::string& prefix);

  std::string name_space_;
  XmlRpc::XmlRpcValue root_;
  std::set<std::string> known_;
  std::vector<std::string> problems_;
};

}  // namespace interactive_mapping_ros
