// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics/level.h"

#include <gtest/gtest.h>

namespace system_diagnostics {
namespace {

TEST(Verdict, KeepsTheWorstAndJoinsWhatIsEquallyBad) {
  Verdict verdict;
  verdict.worsen(Level::kOk, "fine");
  verdict.worsen(Level::kOk, "also fine");
  EXPECT_EQ(verdict.message, "fine");
  verdict.worsen(Level::kWarning, "slow");
  verdict.worsen(Level::kWarning, "jumps");
  EXPECT_EQ(verdict.message, "slow; jumps");
  verdict.worsen(Level::kError, "old");
  verdict.worsen(Level::kWarning, "slow");
  verdict.worsen(Level::kOk, "fine");
  EXPECT_EQ(verdict.level, Level::kError);
  EXPECT_EQ(verdict.message, "old");
}

}  // namespace
}  // namespace system_diagnostics
