// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include <interactive_mapping_common/config/schema.h>
#include <ros/subscriber.h>
#include <ur_msgs/IOStates.h>

#include "ur_driver_bridge_ros/gripper.h"

namespace ur_driver_bridge_ros {

/// Parameters of MagnetGripper.
struct MagnetParams {
  int digital_output{0};

  static void fields(MagnetParams& c, interactive_mapping::Fields& f) {
    f("digital_output", c.digital_output, 0, 17, "",
      "output of the arm's controller: 0-7 standard, 8-15 configurable, 16 and 17 at the tool");
  }
};

/// Parameters of VacuumGripper.
struct VacuumParams : MagnetParams {
  int analog_input{0};
  double kPa_at_zero{0.0};
  double kPa_per_unit{-20.0};
  double hold_kPa{-40.0};

  static void fields(VacuumParams& c, interactive_mapping::Fields& f) {
    MagnetParams::fields(c, f);
    f("analog_input", c.analog_input, -1, 3, "",
      "input with the pressure sensor: 0 and 1 at the controller, 2 and 3 at the tool; -1: none, the weight alone "
      "tells what is held");
    f("kPa_at_zero", c.kPa_at_zero, -200.0, 200.0, "kPa", "pressure against the air's at 0 V or 0 A");
    f("kPa_per_unit", c.kPa_per_unit, -1e5, 1e5, "kPa", "more pressure per V or A");
    f("hold_kPa", c.hold_kPa, -100.0, -1.0, "kPa", "a brick is held at this pressure and below");
    f.require(c.kPa_per_unit != 0.0, "kPa_per_unit = 0 kPa, must not be 0");
  }
};

/// A magnet that one digital output of the UR's controller switches. It has no sensor.
class MagnetGripper : public Gripper {
 public:
  void start(const ros::NodeHandle& nh, const ros::NodeHandle& own_nh, OnState on_state) override;
  ur_driver_bridge::CallReply set(bool is_on) override;

 protected:
  /// start() with parameters that have been read.
  void begin(const ros::NodeHandle& nh, int digital_output, OnState on_state);
  /// Whether something is held, if that can be told.
  virtual std::optional<bool> isHolding(const ur_msgs::IOStates& /*states*/) const { return std::nullopt; }

 private:
  ros::NodeHandle nh_;
  int digital_output_{0};
  ros::Subscriber subscriber_;
};

/// Suction cups: the output opens the valve, an analog input has the pressure.
class VacuumGripper : public MagnetGripper {
 public:
  void start(const ros::NodeHandle& nh, const ros::NodeHandle& own_nh, OnState on_state) override;

 protected:
  std::optional<bool> isHolding(const ur_msgs::IOStates& states) const override;

 private:
  VacuumParams params_;
};

}  // namespace ur_driver_bridge_ros
