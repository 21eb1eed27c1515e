// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/differential_drive.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>

#include <interactive_mapping_common/config/schema.h>

namespace simulated_world {
namespace {

double rampTowards(double value, double target, double max_step) {
  return value + std::clamp(target - value, -max_step, max_step);
}

}  // namespace

// base_navigation predicts with an arc of its own: with one formula for both, an error in it would not show.
Pose2d moveAlongArc(const Pose2d& pose, const Twist2d& twist, double dt_s) {
  const double turn = twist.angular_rad_s * dt_s;
  const double path = twist.linear_m_s * dt_s;
  // The chord of an arc points along the heading half way; sin(x)/x by its series where the quotient loses digits.
  const double half = 0.5 * turn;
  const double chord = path * (std::abs(half) < 1e-4 ? 1.0 - half * half / 6.0 : std::sin(half) / half);
  return {pose.x_m + chord * std::cos(pose.yaw_rad + half), pose.y_m + chord * std::sin(pose.yaw_rad + half),
          pose.yaw_rad + turn};
}

Pose2d compose(const Pose2d& a, const Pose2d& b) {
  const double c = std::cos(a.yaw_rad);
  const double s = std::sin(a.yaw_rad);
  return {a.x_m + c * b.x_m - s * b.y_m, a.y_m + s * b.x_m + c * b.y_m, a.yaw_rad + b.yaw_rad};
}

Pose2d inverse(const Pose2d& pose) {
  const double c = std::cos(pose.yaw_rad);
  const double s = std::sin(pose.yaw_rad);
  return {-c * pose.x_m - s * pose.y_m, s * pose.x_m - c * pose.y_m, -pose.yaw_rad};
}

std::vector<std::string> DifferentialDriveConfig::validate() const {
  std::vector<std::string> problems;
  const auto require = [&problems](bool holds, const char* key, double value, const char* allowed) {
    if (!holds) {
      std::ostringstream line;
      line << key << " = " << value << ", must be " << allowed;
      problems.push_back(line.str());
    }
  };
  const auto above = [&require](const char* key, double value, double most, const char* allowed) {
    require(value > 0.0 && value <= most, key, value, allowed);
  };
  above("wheel_radius_m", wheel_radius_m, 1.0, "in (0, 1] m");
  above("track_m", track_m, 5.0, "in (0, 5] m");
  above("max_forward_m_s", max_forward_m_s, 10.0, "in (0, 10] m/s");
  require(max_backward_m_s >= 0.0 && max_backward_m_s <= 10.0, "max_backward_m_s", max_backward_m_s, "in [0, 10] m/s");
  above("max_angular_rad_s", max_angular_rad_s, 10.0, "in (0, 10] rad/s");
  above("linear_acceleration_m_s2", linear_acceleration_m_s2, 50.0, "in (0, 50] m/s^2");
  above("angular_acceleration_rad_s2", angular_acceleration_rad_s2, 50.0, "in (0, 50] rad/s^2");
  above("command_timeout_s", command_timeout_s, 60.0, "in (0, 60] s");
  const auto relative = [&require](const char* key, double value, const char* allowed) {
    require(value >= 0.0 && value <= 0.5, key, value, allowed);
  };
  relative("odometry_scale_std", odometry_scale_std, "in [0, 0.5]");
  relative("odometry_walk_m_per_sqrt_m", odometry_walk_m_per_sqrt_m, "in [0, 0.5] m/sqrt(m)");
  relative("odometry_walk_rad_per_sqrt_m", odometry_walk_rad_per_sqrt_m, "in [0, 0.5] rad/sqrt(m)");
  return problems;
}

DifferentialDrive::DifferentialDrive(const DifferentialDriveConfig& config)
    : config_(config), random_(config.seed), command_time_s_(-std::numeric_limits<double>::infinity()) {
  interactive_mapping::refuseIfAny("differential drive:", config.validate());
  double first = 0.0;
  double second = 0.0;
  random_.normalPair(first, second);
  linear_scale_ += config.odometry_scale_std * first;
  angular_scale_ += config.odometry_scale_std * second;
}

bool DifferentialDrive::command(const Twist2d& twist, double now_s) {
  if (!std::isfinite(twist.linear_m_s) || !std::isfinite(twist.angular_rad_s)) {
    return false;
  }
  const double linear_limit = twist.linear_m_s >= 0.0 ? config_.max_forward_m_s : config_.max_backward_m_s;
  double factor = 1.0;
  if (std::abs(twist.linear_m_s) > linear_limit) {
    factor = linear_limit / std::abs(twist.linear_m_s);
  }
  if (std::abs(twist.angular_rad_s) * factor > config_.max_angular_rad_s) {
    factor = config_.max_angular_rad_s / std::abs(twist.angular_rad_s);
  }
  command_ = {factor * twist.linear_m_s, factor * twist.angular_rad_s};
  command_time_s_ = now_s;
  return true;
}

Twist2d DifferentialDrive::update(double now_s, double dt_s) {
  const bool is_stale = now_s - command_time_s_ > config_.command_timeout_s;
  const Twist2d target = is_stale ? Twist2d{} : command_;
  wheel_twist_.linear_m_s =
      rampTowards(wheel_twist_.linear_m_s, target.linear_m_s, config_.linear_acceleration_m_s2 * dt_s);
  wheel_twist_.angular_rad_s =
      rampTowards(wheel_twist_.angular_rad_s, target.angular_rad_s, config_.angular_acceleration_rad_s2 * dt_s);

  left_angle_rad_ += leftWheelSpeed() * dt_s;
  right_angle_rad_ += rightWheelSpeed() * dt_s;

  Twist2d counted{wheel_twist_.linear_m_s * linear_scale_, wheel_twist_.angular_rad_s * angular_scale_};
  const double path_m = std::abs(wheel_twist_.linear_m_s) * dt_s;
  if (path_m > 0.0 && (config_.odometry_walk_m_per_sqrt_m > 0.0 || config_.odometry_walk_rad_per_sqrt_m > 0.0)) {
    double along = 0.0;
    double across = 0.0;
    random_.normalPair(along, across);
    counted.linear_m_s += config_.odometry_walk_m_per_sqrt_m * std::sqrt(path_m) * along / dt_s;
    counted.angular_rad_s += config_.odometry_walk_rad_per_sqrt_m * std::sqrt(path_m) * across / dt_s;
  }
  odometry_ = moveAlongArc(odometry_, counted, dt_s);

  const double left_m_s = leftWheelSpeed() * config_.wheel_radius_m * (1.0 - left_slip_);
  const double right_m_s = rightWheelSpeed() * config_.wheel_radius_m * (1.0 - right_slip_);
  return {0.5 * (left_m_s + right_m_s), (right_m_s - left_m_s) / config_.track_m};
}

void DifferentialDrive::setSlip(double left, double right) {
  if (!(left >= 0.0 && left <= 1.0 && right >= 0.0 && right <= 1.0)) {
    std::ostringstream message;
    message << "wheel slip left = " << left << ", right = " << right << ", must be in [0, 1]";
    throw std::invalid_argument(message.str());
  }
  left_slip_ = left;
  right_slip_ = right;
}

void DifferentialDrive::stop() {
  command_ = Twist2d{};
  wheel_twist_ = Twist2d{};
}

double DifferentialDrive::leftWheelSpeed() const {
  return (wheel_twist_.linear_m_s - 0.5 * config_.track_m * wheel_twist_.angular_rad_s) / config_.wheel_radius_m;
}

double DifferentialDrive::rightWheelSpeed() const {
  return (wheel_twist_.linear_m_s + 0.5 * config_.track_m * wheel_twist_.angular_rad_s) / config_.wheel_radius_m;
}

}  // namespace simulated_world
