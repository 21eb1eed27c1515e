// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world_ros/ur_messages.h"

#include <algorithm>
#include <numeric>

namespace simulated_world_ros {

using simulated_world::JointLimits;
using simulated_world::JointMotion;
using simulated_world::TrajectoryGoal;
using simulated_world::TrajectoryTolerance;

namespace {

std::vector<TrajectoryTolerance> fromMessages(const std::vector<control_msgs::JointTolerance>& messages) {
  std::vector<TrajectoryTolerance> tolerances;
  tolerances.reserve(messages.size());
  for (const control_msgs::JointTolerance& message : messages) {
    tolerances.push_back({message.name, message.position, message.velocity, message.acceleration});
  }
  return tolerances;
}

trajectory_msgs::JointTrajectoryPoint toPoint(const JointMotion& motion, double time_s) {
  const auto copy = [](const Eigen::VectorXd& values) {
    return std::vector<double>(values.data(), values.data() + values.size());
  };
  trajectory_msgs::JointTrajectoryPoint point;
  point.positions = copy(motion.position_rad);
  point.velocities = copy(motion.velocity_rad_s);
  point.accelerations = copy(motion.acceleration_rad_s2);
  point.time_from_start = ros::Duration(time_s);
  return point;
}

}  // namespace

TrajectoryGoal fromMessage(const std::string& id, const trajectory_msgs::JointTrajectory& trajectory) {
  TrajectoryGoal goal;
  goal.id = id;
  goal.joint_names = trajectory.joint_names;
  goal.start_s = trajectory.header.stamp.toSec();
  for (const trajectory_msgs::JointTrajectoryPoint& point : trajectory.points) {
    goal.points.push_back({point.positions, point.velocities, point.accelerations, point.time_from_start.toSec()});
  }
  return goal;
}

TrajectoryGoal fromMessage(const std::string& id, const control_msgs::FollowJointTrajectoryGoal& message) {
  TrajectoryGoal goal = fromMessage(id, message.trajectory);
  goal.path_tolerance = fromMessages(message.path_tolerance);
  goal.goal_tolerance = fromMessages(message.goal_tolerance);
  goal.goal_time_tolerance_s = message.goal_time_tolerance.toSec();
  return goal;
}

sensor_msgs::JointState toMessage(const ros::Time& stamp, const std::vector<JointLimits>& joints,
                                  const ArmMeasurement& measured) {
  std::vector<std::size_t> order(joints.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&joints](std::size_t a, std::size_t b) { return joints[a].joint < joints[b].joint; });
  sensor_msgs::JointState state;
  state.header.stamp = stamp;
  for (const std::size_t j : order) {
    const auto row = static_cast<Eigen::Index>(j);
    state.name.push_back(joints[j].joint);
    state.position.push_back(measured.position_rad[row]);
    state.velocity.push_back(measured.velocity_rad_s[row]);
    state.effort.push_back(measured.current_A[row]);
  }
  return state;
}

ur_msgs::IOStates toMessage(const simulated_world::UrIo& io) {
  ur_msgs::IOStates states;
  for (std::size_t pin = 0; pin < simulated_world::UrIo::kDigitalPins; ++pin) {
    ur_msgs::Digital digital;
    digital.pin = static_cast<std::uint8_t>(pin);
    digital.state = io.digital_in[pin] ? 1 : 0;
    states.digital_in_states.push_back(digital);
    digital.state = io.digital_out[pin] ? 1 : 0;
    states.digital_out_states.push_back(digital);
  }
  for (std::size_t pin = 0; pin < simulated_world::UrIo::kAnalogPins; ++pin) {
    ur_msgs::Analog analog;
    analog.pin = static_cast<std::uint8_t>(pin);
    analog.domain = ur_msgs::Analog::VOLTAGE;
    analog.state = static_cast<float>(io.analog_in_V[pin]);
    states.analog_in_states.push_back(analog);
    analog.domain = ur_msgs::Analog::CURRENT;
    analog.state = static_cast<float>(io.analog_out[pin]);
    states.analog_out_states.push_back(analog);
  }
  return states;
}

control_msgs::JointTrajectoryControllerState toMessage(const ros::Time& stamp,
                                                       const simulated_world::TrajectoryFollower& follower) {
  control_msgs::JointTrajectoryControllerState state;
  state.header.stamp = stamp;
  for (const JointLimits& joint : follower.joints()) {
    state.joint_names.push_back(joint.joint);
  }
  const double time_s = follower.trajectoryTime();
  state.desired = toPoint(follower.desired(), time_s);
  state.actual = toPoint(follower.actual(), time_s);
  state.error = toPoint(follower.error(), time_s);
  return state;
}

}  // namespace simulated_world_ros
