// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world_ros/simulation_params.h"

#include <string>

#include <gtest/gtest.h>

#include <interactive_mapping_common/testing/shipped_file.h>

namespace simulated_world_ros {
namespace {

// Its values are those of a real camera, and not the defaults: the comments alone are the fields'.
TEST(SimulationParams, ShippedFileHasEveryKeyWithItsText) {
  const std::string path = SIMULATION_YAML;
  SimulationParams shipped;
  interactive_mapping::FieldReader reader(interactive_mapping::readTextFile(path), path);
  SimulationParams::fields(shipped, reader);
  EXPECT_EQ(reader.finish(), std::vector<std::string>());
  test_support::expectShippedFile(path, shipped);
}

TEST(SimulationParams, FilesAloneAreMissingInTheDefaults) {
  EXPECT_EQ(interactive_mapping::problemsOf(SimulationParams()),
            (std::vector<std::string>{"scene is empty, must be given", "description/urdf is empty, must be given",
                                      "description/base_profile is empty, must be given",
                                      "description/bricks is empty, must be given",
                                      "description/arm_pose is empty, must be given"}));
}

}  // namespace
}  // namespace simulated_world_ros
