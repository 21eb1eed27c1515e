// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <vector>

namespace interactive_mapping_ros {

/// Parameters as YAML, in the layout that ParamReader reads: "output/rate_hz" goes into the section "output".
class ParamWriter {
 public:
  ParamWriter();
  ~ParamWriter();
  ParamWriter(const ParamWriter&) = delete;
  ParamWriter& operator=(const ParamWriter&) = delete;

  void write(const std::string& key, double value);
  void write(const std::string& key, int value);
  void write(const std::string& key, bool value);
  void write(const std::string& key, const std::string& value);
  void write(const std::string& key, const std::vector<std::string>& value);
  void write(const std::string& key, const std::vector<double>& value);

  std::string text() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace interactive_mapping_ros
