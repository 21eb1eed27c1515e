// SPDX-License-Identifier: BSD-3-Clause
// The same seed gives the same run, bit for bit, whatever else the machine is doing.
#include <atomic>
#include <cstdint>
#include <cstring>
#include <ostream>
#include <string>
#include <thread>
#include <type_traits>
#include <vector>

#include <gtest/gtest.h>

#include "simulated_world/simulation.h"

namespace simulated_world {
namespace {

class Hash {  // FNV-1a
 public:
  void add(const void* bytes, std::size_t count) {
    const auto* byte = static_cast<const unsigned char*>(bytes);
    for (std::size_t i = 0; i < count; ++i) value_ = (value_ ^ byte[i]) * 0x100000001B3ULL;
  }
  template <typename Number>
  void add(Number number) {
    static_assert(std::is_arithmetic_v<Number>);
    add(&number, sizeof number);
  }
  void add(const std::string& text) { add(text.data(), text.size()); }
  void add(const cv::Mat& image) {
    ASSERT_TRUE(image.isContinuous());
    add(image.data, image.total() * image.elemSize());
  }
  std::uint64_t value() const { return value_; }

 private:
  std::uint64_t value_{0xCBF29CE484222325ULL};
};

/// What half a second of a run brought, each of it as a fingerprint; so that a difference says where it began.
struct HalfSecond {
  std::uint64_t state, images, scans, odometry, incidents, judge;

  bool operator==(const HalfSecond& other) const { return std::memcmp(this, &other, sizeof other) == 0; }
  friend std::ostream& operator<<(std::ostream& out, const HalfSecond& half) {
    return out << std::hex << "state " << half.state << " images " << half.images << " scans " << half.scans
               << " odometry " << half.odometry << " incidents " << half.incidents << " judge " << half.judge
               << std::dec;
  }
};

struct Record {
  std::vector<HalfSecond> halves;
  int images{0};
  int collisions{0};
};

/// Everything that is drawn at random is switched on.
SimulationConfig config(std::uint64_t seed) {
  const std::string description = MP700_UR5E_DESCRIPTION_DIR;
  SimulationConfig config;
  config.description = {description + "/urdf/mp700_ur5e.urdf", description + "/config/base_profile.yaml",
                        description + "/config/bricks.yaml", description + "/config/arm_poses/stowed.yaml"};
  config.scene = std::string(SIMULATED_WORLDS) + "/two_stacked.yaml";
  config.seed = seed;
  config.camera.camera = {160, 120, 130.0, 130.0, 79.5, 59.5};
  config.camera.rgb_noise_std_grey = 2.0;
  synthetic_depth::SensorModel& sensor = config.camera.sensor;
  sensor.max_range_m = 6.0;
  sensor.min_range_m = 0.3;
  sensor.axial_noise_c_per_m = 0.004;
  sensor.baseline_m = 0.05;
  sensor.has_shadows = true;
  sensor.edge_mixing_fraction = 0.2;
  sensor.dropout_probability = 0.01;
  sensor.lateral_jitter_px = 0.3;
  sensor.border_left_px = 5;
  sensor.min_return_per_m2 = 0.03;
  sensor.edge_loss_px = 2.0;
  config.camera_delay_s = 0.05;
  config.camera_drop_probability = 0.1;
  config.scan_noise_std_m = 0.01;
  config.odometry_scale_std = 0.02;
  config.odometry_walk_m_per_sqrt_m = 0.01;
  config.odometry_walk_rad_per_sqrt_m = 0.01;
  config.localisation_std_m = 0.005;
  config.localisation_std_rad = 0.005;
  return config;
}

void moveArm(Simulation& simulation) {
  TrajectoryGoal goal;
  goal.id = "out";
  goal.joint_names.assign(kArmJoints.begin(), kArmJoints.end());
  TrajectoryPoint point;
  for (int i = 0; i < kNumArmJoints; ++i) {
    point.positions_rad.push_back(simulation.world().armPosition()[i] + 0.1 * (i + 1));
  }
  point.velocities_rad_s.assign(kNumArmJoints, 0.0);
  point.time_from_start_s = 2.0;
  goal.points.push_back(point);
  ASSERT_TRUE(simulation.armDriver().acceptGoal(goal).accepted);
}

/// Drives into the bricks with a moving arm: contacts are where small differences grow.
Record drive(std::uint64_t seed, int ticks) {
  Simulation simulation(config(seed));
  Record record;
  Hash images;
  Hash scans;
  Hash odometry;
  Hash incidents;
  moveArm(simulation);
  for (int i = 1; i <= ticks; ++i) {
    simulation.commandBase({0.8, 0.02});
    const Simulation::Tick tick = simulation.tick();
    for (const Simulation::Tick::Image& image : tick.images) {
      ++record.images;
      images.add(image.stamp_ns);
      images.add(image.frame.rgb);
      images.add(image.frame.depth_m);
    }
    if (tick.scan) scans.add(tick.scan->data(), tick.scan->size() * sizeof(float));
    for (const std::string& incident : tick.incidents) incidents.add(incident);
    const Pose2d& pose = simulation.mapToOdom();
    odometry.add(pose.x_m);
    odometry.add(pose.y_m);
    odometry.add(pose.yaw_rad);
    if (i % 50 == 0) {
      Hash judge;
      for (const JudgeEvent& event : simulation.judge().events()) {
        judge.add(static_cast<int>(event.kind));
        judge.add(event.time_s);
        judge.add(event.max_force_N);
        judge.add(event.distance_m);
      }
      record.halves.push_back(
          {simulation.digest(), images.value(), scans.value(), odometry.value(), incidents.value(), judge.value()});
    }
  }
  record.collisions = simulation.judge().report().totals.collisions;
  return record;
}

/// Two busy threads per processor: the simulation's own threads are interrupted all the time.
class BusyMachine {
 public:
  BusyMachine() {
    for (unsigned i = 0; i < 2 * std::thread::hardware_concurrency(); ++i) {
      threads_.emplace_back([this] {
        while (!is_over_) ++turns_;
      });
    }
  }
  ~BusyMachine() {
    is_over_ = true;
    for (std::thread& thread : threads_) thread.join();
  }
  BusyMachine(const BusyMachine&) = delete;
  BusyMachine& operator=(const BusyMachine&) = delete;

 private:
  std::atomic<bool> is_over_{false};
  std::atomic<std::uint64_t> turns_{0};
  std::vector<std::thread> threads_;
};

TEST(SimulationDeterminism, TheSameSeedGivesTheSameRunOnABusyMachine) {
  constexpr int kTicks = 450;
  const Record quiet = drive(3, kTicks);
  Record busy;
  {
    const BusyMachine machine;
    busy = drive(3, kTicks);
  }
  // Otherwise there was nothing to differ in.
  ASSERT_GT(quiet.images, 10);
  ASSERT_GT(quiet.collisions, 0) << "the robot did not meet the bricks";
  ASSERT_EQ(quiet.halves.size(), busy.halves.size());
  for (std::size_t i = 0; i < quiet.halves.size(); ++i) {
    ASSERT_EQ(quiet.halves[i], busy.halves[i]) << "after " << 0.5 * static_cast<double>(i + 1) << " s";
  }
}

TEST(SimulationDeterminism, AnotherSeedGivesAnotherRun) {
  const HalfSecond one = drive(3, 50).halves.front();
  const HalfSecond other = drive(4, 50).halves.front();
  EXPECT_EQ(one.state, other.state) << "the scene's bricks have their places, and nobody acts on what the sensors say";
  EXPECT_NE(one.images, other.images);
  EXPECT_NE(one.scans, other.scans);
  EXPECT_NE(one.odometry, other.odometry);
}

}  // namespace
}  // namespace simulated_world
