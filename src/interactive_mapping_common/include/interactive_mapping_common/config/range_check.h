// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sstream>
#include <string>
#include <vector>

namespace interactive_mapping {

/// Collects what is out of range as "key = value unit, must be in [lo, hi] unit".
class RangeCheck {
 public:
  explicit RangeCheck(std::string prefix = "") : prefix_(std::move(prefix)) {}

  void operator()(const char* key, double value, double lo, double hi, const char* unit) {
    if (value >= lo && value <= hi) return;  // false for NaN
    const std::string unit_text = *unit == '\0' ? "" : std::string(" ") + unit;
    std::ostringstream text;
    text << prefix_ << key << " = " << value << unit_text << ", must be in [" << lo << ", " << hi << "]" << unit_text;
    problems_.push_back(text.str());
  }

  const std::vector<std::string>& problems() const { return problems_; }

 private:
  std::string prefix_;
  std::vector<std::string> problems_;
};

}  // namespace interactive_mapping
