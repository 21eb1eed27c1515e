// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge_ros/output_grippers.h"

#include <utility>

#include <interactive_mapping_common_ros/params.h>
#include <pluginlib/class_list_macros.hpp>
#include <ur_msgs/SetIO.h>

#include "ur_driver_bridge_ros/driver_call.h"

namespace ur_driver_bridge_ros {

void MagnetGripper::start(const ros::NodeHandle& nh, const ros::NodeHandle& own_nh, OnState on_state) {
  begin(nh, interactive_mapping_ros::loadParams<MagnetParams>(own_nh).digital_output, std::move(on_state));
}

void MagnetGripper::begin(const ros::NodeHandle& nh, int digital_output, OnState on_state) {
  nh_ = nh;
  digital_output_ = digital_output;
  subscriber_ = nh_.subscribe<ur_msgs::IOStates>(
      std::string(kHardware) + "io_states", 5,
      [this, on_state = std::move(on_state)](const ur_msgs::IOStatesConstPtr& states) {
        ur_driver_bridge::GripperState state;
        for (const ur_msgs::Digital& digital : states->digital_out_states) {
          if (digital.pin == digital_output_) state.is_on = digital.state != 0;
        }
        state.is_holding = isHolding(*states);
        on_state(state);
      },
      ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
}

ur_driver_bridge::CallReply MagnetGripper::set(bool is_on) {
  ur_msgs::SetIO::Request request;
  request.fun = ur_msgs::SetIO::Request::FUN_SET_DIGITAL_OUT;
  request.pin = static_cast<std::int8_t>(digital_output_);
  request.state = is_on ? 1.0F : 0.0F;
  // Any MD5 sum: ur_msgs changed SetIO's constants, and with them its sum, after 1.3.4; what is on the wire is the same.
  return callDriver<ur_msgs::SetIO>(nh_, std::string(kHardware) + "set_io", "*", request,
                                    [](const ur_msgs::SetIO::Response&) { return std::string(); });
}

void VacuumGripper::start(const ros::NodeHandle& nh, const ros::NodeHandle& own_nh, OnState on_state) {
  params_ = interactive_mapping_ros::loadParams<VacuumParams>(own_nh);
  begin(nh, params_.digital_output, std::move(on_state));
}

std::optional<bool> VacuumGripper::isHolding(const ur_msgs::IOStates& states) const {
  for (const ur_msgs::Analog& analog : states.analog_in_states) {
    if (analog.pin != params_.analog_input) continue;
    const double pressure_kPa = params_.kPa_at_zero + params_.kPa_per_unit * static_cast<double>(analog.state);
    return pressure_kPa <= params_.hold_kPa;
  }
  return std::nullopt;
}

}  // namespace ur_driver_bridge_ros

PLUGINLIB_EXPORT_CLASS(ur_driver_bridge_ros::MagnetGripper, ur_driver_bridge_ros::Gripper)
PLUGINLIB_EXPORT_CLASS(ur_driver_bridge_ros::VacuumGripper, ur_driver_bridge_ros::Gripper)
