// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

namespace mp700_ur5e_description {
namespace test {

/// A shipped file with a piece replaced, which must be in it.
inline std::string changedFile(const std::string& path, const std::string& from, const std::string& to) {
  std::ifstream file(path);
  std::ostringstream out;
  out << file.rdbuf();
  std::string text = out.str();
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

/// The message with which `parse` refuses; empty if it does not.
template <typename Parse>
std::string refusalBy(Parse parse) {
  try {
    parse();
    return "";
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
}

}  // namespace test
}  // namespace mp700_ur5e_description
