// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <initializer_list>
#include <string>
#include <vector>

#include <interactive_mapping_common/config/schema.h>
#include <ros/node_handle.h>

namespace interactive_mapping_ros {

/// Reads a node's private parameters into one struct, and what is wrong with them into one message.
class ParamsReader {
 public:
  explicit ParamsReader(const ros::NodeHandle& private_nh);

  interactive_mapping::FieldReader& fields() { return reader_; }

  /// Throws one std::invalid_argument with every unknown key, wrong type and of `problems`, each by its full name.
  void finish(const std::vector<std::string>& problems);

 private:
  std::string name_space_;
  interactive_mapping::FieldReader reader_;
};

/// The `~` parameters in a struct with fields(), see interactive_mapping_common/config/schema.h; a missing one keeps its
/// default. `ignored`: keys or sections that others read. `more`: problems beside those of the fields. Throws
/// std::invalid_argument that lists everything wrong.
template <typename Params>
Params loadParams(const ros::NodeHandle& private_nh, std::initializer_list<const char*> ignored = {},
                  const std::function<std::vector<std::string>(const Params&)>& more = nullptr) {
  Params params;
  ParamsReader reader(private_nh);
  Params::fields(params, reader.fields());
  for (const char* key : ignored) reader.fields().ignore(key);
  std::vector<std::string> problems = interactive_mapping::problemsOf(params);
  if (more) {
    for (std::string& problem : more(params)) problems.push_back(std::move(problem));
  }
  reader.finish(problems);
  return params;
}

}  // namespace interactive_mapping_ros
