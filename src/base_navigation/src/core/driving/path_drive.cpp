// SPDX-License-Identifier: BSD-3-Clause
#include "driving/path_drive.h"

namespace base_navigation {

bool isZero(const Twist2d& twist) {
  return twist.linear_m_s == 0.0 && twist.angular_rad_s == 0.0;
}

void PathDrive::start(const BasePath& path) {
  follower_.start(path);
  is_off_path_ = false;
  at_m_ = 0.0;
}

bool PathDrive::resume(const Pose2d& T_map_base) {
  if (!follower_.resume(T_map_base)) return false;
  is_off_path_ = false;
  return true;
}

FollowCommand PathDrive::follow(const Pose2d& T_map_base, double speed_factor) {
  const FollowCommand command = follower_.update(T_map_base, dt_s_, speed_factor);
  at_m_ = command.at_m;
  return command;
}

void PathDrive::brake(const DriveData& data) {
  if (is_hard_) {
    is_off_path_ = true;
    follower_.stop(dt_s_);
  } else if (follower_.isActive() && !is_off_path_ && data.isPoseFresh(now_s_)) {
    follow(data.T_map_base, 0.0);
  } else {
    is_off_path_ = true;
    follower_.pause(dt_s_);
  }
}

bool PathDrive::comeToStand(const DriveData& data) {
  if (stands(data)) {
    zero_since_s_.reset();
    return true;
  }
  if (!zero_since_s_) zero_since_s_ = now_s_;
  if (!isZero(command())) {
    brake(data);
    if (!isZero(command())) zero_since_s_ = now_s_;
  }
  return false;
}

bool PathDrive::stands(const DriveData& data) const {
  return isZero(command()) && data.isOdometryFresh(now_s_) && data.stands();
}

}  // namespace base_navigation
