// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/arm_status.h"

#include <set>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>

namespace ur_driver_bridge {
namespace {

// As interactive_mapping_msgs/ArmOutcome has them: whoever listens to the message reads these numbers.
const std::vector<std::pair<int, std::string>>& messageConstants() {
  static const std::vector<std::pair<int, std::string>> constants = {{0, "SUCCESS"},
                                                                     {1, "CANCELLED"},
                                                                     {2, "BAD_REQUEST"},
                                                                     {3, "BEYOND_LIMITS"},
                                                                     {4, "START_MISMATCH"},
                                                                     {5, "NOT_READY"},
                                                                     {6, "STALE_STATE"},
                                                                     {7, "STALE_MAP"},
                                                                     {8, "MONITOR_GONE"},
                                                                     {9, "PATH_BLOCKED"},
                                                                     {10, "HEARTBEAT_LOST"},
                                                                     {11, "HELD"},
                                                                     {12, "PROTECTIVE_STOP"},
                                                                     {13, "EMERGENCY_STOP"},
                                                                     {14, "PROGRAM_STOPPED"},
                                                                     {15, "DRIVER_GONE"},
                                                                     {16, "TRAJECTORY_REFUSED"},
                                                                     {17, "TRAJECTORY_ABORTED"},
                                                                     {18, "STALLED"},
                                                                     {19, "IO_REFUSED"},
                                                                     {20, "NO_CONTACT"},
                                                                     {21, "CONTACT_TOO_EARLY"},
                                                                     {22, "NOT_ATTACHED"},
                                                                     {23, "LOST_ON_THE_WAY"},
                                                                     {24, "NOT_LET_GO"},
                                                                     {25, "NOTHING_HELD"},
                                                                     {26, "FAULT"},
                                                                     {27, "BUSY"}};
  return constants;
}

TEST(ArmStatus, HasTheMessagesNumbersAndNames) {
  ASSERT_EQ(messageConstants().size(), static_cast<std::size_t>(kNumArmStatus));
  for (const auto& [value, name] : messageConstants()) EXPECT_EQ(toString(static_cast<ArmStatus>(value)), name);
}

TEST(ArmStatus, NumberBeyondTheEnumHasANameThatIsNoneOfTheStatus) {
  EXPECT_STREQ(toString(static_cast<ArmStatus>(kNumArmStatus)), "?");
  for (const auto& [value, name] : messageConstants()) EXPECT_NE(name, "?");
}

TEST(ArmStatus, VerdictIsFineOnlyOnSuccess) {
  EXPECT_TRUE(Verdict{}.isFine());
  for (int value = 1; value < kNumArmStatus; ++value) {
    EXPECT_FALSE((Verdict{static_cast<ArmStatus>(value), ""}.isFine())) << value;
  }
}

}  // namespace
}  // namespace ur_driver_bridge
