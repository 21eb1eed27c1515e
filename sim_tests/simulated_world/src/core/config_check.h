// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace simulated_world {

/// Collects lines "key = value unit, must be ..." for the validate() of a config.
class ConfigCheck {
 public:
  /// Reports a number for which `is_good` does not hold, and any number that is not finite.
  void require(bool is_good, const std::string& key, double value, const std::string& unit, const std::string& rule) {
    if (is_good && std::isfinite(value)) return;
    std::ostringstream line;
    line << key << " = " << value << (unit.empty() ? "" : " ") << unit << ", must be " << rule;
    problems_.push_back(line.str());
  }

  void positive(const std::string& key, double value, const std::string& unit) {
    require(value > 0.0, key, value, unit, "> 0" + (unit.empty() ? "" : " " + unit));
  }

  void notNegative(const std::string& key, double value, const std::string& unit) {
    require(value >= 0.0, key, value, unit, ">= 0" + (unit.empty() ? "" : " " + unit));
  }

  void notEmpty(const std::string& key, const std::string& value) {
    if (value.empty()) problems_.push_back(key + " = \"\", must be a name");
  }

  void include(const std::string& section, const std::vector<std::string>& problems) {
    for (const std::string& problem : problems) problems_.emplace_back(section + "/").append(problem);
  }

  const std::vector<std::string>& problems() const { return problems_; }

 private:
  std::vector<std::string> problems_;
};

/// Throws std::invalid_argument with every problem on a line of its own, unless there is none.
inline void throwIfAny(const std::string& what, const std::vector<std::string>& problems) {
  if (problems.empty()) return;
  std::string message = what + ":";
  for (const std::string& problem : problems) message += "\n  " + problem;
  throw std::invalid_argument(message);
}

}  // namespace simulated_world
