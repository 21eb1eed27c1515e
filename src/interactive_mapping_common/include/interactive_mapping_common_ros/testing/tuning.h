// SPDX-License-Identifier: BSD-3-Clause
// Live parameters as a user sees and sets them, for tests of nodes.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include <dynamic_reconfigure/ConfigDescription.h>
#include <dynamic_reconfigure/Reconfigure.h>
#include <gtest/gtest.h>

#include "interactive_mapping_common/testing/process.h"
#include "interactive_mapping_common/testing/temporary_folder.h"
#include "interactive_mapping_common_ros/testing/waiting.h"

namespace node_tests {

/// Sets values by dynamic_reconfigure's own client and waits for its end. `server`: such as /gpis_mapping/tune; `values`:
/// a YAML map on one line.
inline void tune(const std::string& server, const std::string& values) {
  const test_support::TemporaryFolder folder;
  Process dynparam({"rosrun", "dynamic_reconfigure", "dynparam", "set", server, values}, folder.file("dynparam.log"));
  EXPECT_TRUE(waitUntil([&] { return dynparam.hasEnded(); })) << dynparam.output();
  std::string said = dynparam.output();
  // By rospkg, where rosdep is installed and was never set up.
  if (said.rfind("the rosdep view is empty", 0) == 0) said.erase(0, said.find('\n') + 1);
  // It ends with 0 for a name that it does not know, too.
  EXPECT_EQ(said, "") << server << " " << values;
}

/// Name and range of each live field; texts and flags: 0 and 1.
inline std::map<std::string, std::pair<double, double>> liveFieldsOf(const std::string& server) {
  Latest<dynamic_reconfigure::ConfigDescription> latest(server + "/parameter_descriptions");
  const auto description = latest.await([](const auto&) { return true; });
  std::map<std::string, std::pair<double, double>> ranges;
  const auto add = [&ranges](const auto& low, const auto& high) {
    for (std::size_t i = 0; i < low.size(); ++i) ranges[low[i].name] = {low[i].value, high[i].value};
  };
  add(description.min.doubles, description.max.doubles);
  add(description.min.ints, description.max.ints);
  add(description.min.bools, description.max.bools);
  for (const auto& text : description.min.strs) ranges[text.name] = {0.0, 1.0};
  return ranges;
}

/// Asks for other numbers, more than one if need be; returns all that are in use then.
inline std::map<std::string, double> askForNumbers(const std::string& server,
                                                   const std::map<std::string, double>& numbers) {
  dynamic_reconfigure::Reconfigure reconfigure;
  for (const auto& [name, value] : numbers) {
    reconfigure.request.config.doubles.emplace_back();
    reconfigure.request.config.doubles.back().name = name;
    reconfigure.request.config.doubles.back().value = value;
  }
  EXPECT_TRUE(call(server + "/set_parameters", reconfigure));
  std::map<std::string, double> in_use;
  for (const auto& item : reconfigure.response.config.doubles) in_use[item.name] = item.value;
  return in_use;
}

}  // namespace node_tests
