// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common/formatted.h>

#include <gtest/gtest.h>

namespace interactive_mapping {
namespace {

TEST(Formatted, FollowsThePattern) {
  EXPECT_EQ(formatted("%s: %zu of %.*f m", "x", std::size_t{3}, 2, 0.125), "x: 3 of 0.12 m");
  EXPECT_EQ(formatted("nothing"), "nothing");
}

TEST(Formatted, CutsNothingOff) {
  const std::string word(2000, 'x');
  EXPECT_EQ(formatted("%s%d", word.c_str(), 7), word + "7");
}

}  // namespace
}  // namespace interactive_mapping
