// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world_ros/simulation_params.h"

#include <cmath>
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

// As the launch file loads them: above simulation.yaml, what the robot is.
TEST(SimulationParams, RealisticFileIsKnownAndIdealIsNot) {
  const std::string path = SIMULATION_YAML;
  const std::string realistic = path.substr(0, path.rfind('/')) + "/realistic.yaml";
  SimulationParams params;
  interactive_mapping::FieldReader shipped(interactive_mapping::readTextFile(path), path);
  SimulationParams::fields(params, shipped);
  const synthetic_depth::SensorModel ideal = params.simulation.camera.sensor;
  interactive_mapping::FieldReader reader(interactive_mapping::readTextFile(realistic), realistic);
  SimulationParams::fields(params, reader);
  EXPECT_EQ(reader.finish(), std::vector<std::string>());

  const simulated_world::SimulationConfig& config = params.simulation;
  EXPECT_EQ(config.localisation_std_m, 0.01);
  EXPECT_NEAR(config.localisation_std_rad, 0.3 * M_PI / 180.0, 1e-4);
  EXPECT_GT(config.localisation_correlation_s, 1.0) << "drift";
  EXPECT_EQ(config.odometry_scale_std, 0.01);
  EXPECT_TRUE(config.world.has_sun);
  EXPECT_GT(config.camera.exposure_std_stops, 0.0);
  EXPECT_GT(config.camera.rgb_blur_px, 0.0);
  const synthetic_depth::SensorModel& sensor = config.camera.sensor;
  EXPECT_GT(sensor.edge_mixing_fraction, 0.0);
  EXPECT_GT(sensor.dropout_probability, 0.0);
  EXPECT_GT(sensor.disparity_step_px, 0.0);
  EXPECT_NE(sensor.axial_noise_c_per_m, ideal.axial_noise_c_per_m) << "the map's own";
  EXPECT_EQ(sensor.max_range_m, ideal.max_range_m) << "not in the file";
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
