// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/clock_trace.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include <interactive_mapping_common/testing/temporary_folder.h>

namespace simulated_world {
namespace {

TEST(ClockTrace, AddsUpTheWallTimeOfEachThingThatWasWaitedFor) {
  const test_support::TemporaryFolder folder;
  {
    ClockTrace trace(folder.path());
    trace.reach(10.0, 100.0);  // nothing has been waited for yet
    trace.enter(100.0, "world");
    trace.enter(100.5, "/map");
    trace.enter(102.5, "world");
    trace.reach(10.1, 102.75);  // within the bin
    trace.reach(10.2, 103.0);
    trace.enter(104.0, "/arm");
    trace.enter(104.25, "world");
  }
  std::ifstream file(folder.path() + "/clock.csv");
  std::stringstream text;
  text << file.rdbuf();
  EXPECT_EQ(text.str(),
            "time_s,waited_for,wall_s\n"
            "10.000,/map,2.00000\n10.000,world,1.00000\n"
            "10.200,/arm,0.25000\n10.200,world,1.00000\n");
}

TEST(ClockTrace, RefusesAFolderThatIsNotThere) {
  EXPECT_THROW(ClockTrace("/there/is/none"), std::runtime_error);
}

}  // namespace
}  // namespace simulated_world
