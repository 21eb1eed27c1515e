// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace simulated_world {

/// What can be made to go wrong.
enum class FaultKind {
  kProtectiveStop,    ///< the arm's safety system stops it; stays until unlocked through the driver
  kEmergencyStop,     ///< button pressed: arm without power, base halted. With a duration: released after it
  kBaseButton,        ///< the base's own emergency button; the arm goes on. With a duration: released after it
  kBaseScanner,       ///< something in the safety scanner's field halts the base. With a duration: it goes away
  kDriverGone,        ///< the arm's driver loses the robot. With a duration: comes back after it
  kCameraGone,        ///< no images. With a duration: they come back after it
  kMagnetWeak,        ///< value: share of the holding force that is left, [0, 1]
  kWheelSlip,         ///< value and value2: share of the left and right wheel's turning that is lost, [0, 1]
  kDropBrick,         ///< the magnet loses what it holds
  kMoveBrick,         ///< somebody puts brick `brick_id` at T_map_object
  kScannerGone,       ///< no scans
  kOdometryGone,      ///< the base's driver says nothing; it still hears
  kLocalisationGone,  ///< nobody says where `odom` is in the map
  kLocalisationJump,  ///< map -> odom jumps: the base is off by value [m] along x and value2 [rad]
  kObstacle,          ///< somebody stands at T_map_object, see obstacle.h. Each has an end of its own
  kForceNoise,        ///< the tool's force sensor: white noise, value [N] is its standard deviation on each axis
  kIoRefused,         ///< the arm's driver refuses to set outputs
};

struct Fault {
  FaultKind kind{FaultKind::kProtectiveStop};
  double at_s{0.0};        ///< simulated time of its beginning; in the past: at once
  double duration_s{0.0};  ///< 0: for good, or, but for obstacles, until the same kind is given again
  double value{0.0};
  double value2{0.0};
  int brick_id{-1};
  /// Of a brick's middle; of the place on the ground, z up, on which an obstacle stands.
  Eigen::Isometry3d T_map_object{Eigen::Isometry3d::Identity()};

  /// Everything that cannot be, one line each: "value = 3, must be in [0, 1]".
  std::vector<std::string> validate() const;
};

/// "protective_stop", "emergency_stop", "base_button", "base_scanner", "driver_gone", "camera_gone", "magnet_weak",
/// "wheel_slip", "drop_brick", "move_brick", "scanner_gone", "odometry_gone", "localisation_gone", "localisation_jump",
/// "obstacle", "force_noise", "io_refused".
std::string faultName(FaultKind kind);
std::optional<FaultKind> faultKind(const std::string& name);
std::string allFaultNames();  ///< comma separated, for messages

/// Faults waiting for their time, in the order of time and then of arrival.
class FaultSchedule {
 public:
  struct Change {
    Fault fault;
    bool is_beginning;     ///< false: the fault's duration is over
    std::uint64_t number;  ///< of the fault among all that were added: tells whose end it is
  };

  /// Throws std::invalid_argument with what validate() says.
  void add(const Fault& fault);

  /// What begins or ends up to and including `now_s`, taken out.
  std::vector<Change> takeDue(double now_s);

  /// Forgets what has not begun; what has begun keeps its end.
  void clear();

 private:
  struct Entry {
    double at_s;
    Change change;
  };
  void insert(double at_s, const Change& change);

  std::uint64_t num_added_{0};
  std::vector<Entry> entries_;  // sorted by at_s, equal ones in the order of arrival
};

}  // namespace simulated_world
