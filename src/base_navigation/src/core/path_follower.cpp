// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/path_follower.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace base_navigation {
namespace {

// Kanayama et al. 1990, "A stable tracking control method for an autonomous mobile robot": error -> correction.
constexpr double kGainAcross_1_m2 = 121.0;
constexpr double kGainYaw_1_m = 17.5;
// The two gains make an oscillator of sqrt(kGainAcross) * speed. Where that is faster than this, which must be slow
// against the lag of drives and localisation, both are lowered and the damping is kept.
constexpr double kMaxCorrection_1_s = 2.0;
constexpr double kGainTurn_1_s = 2.0;  // of turns on the spot: angle error -> rate
// Of the difference between the pose measured and the pose expected: averages the noise of the localisation.
constexpr double kNoiseShare = 0.2;
constexpr double kAccelerationReserve = 0.8;  // share of the acceleration limits that plans use
constexpr double kWait_rad = 0.2;             // as PathFollowerConfig::wait_m, in turns on the spot

constexpr double kSteepest_rad = 0.25;  // a base beside its path heads for it so steeply at most
constexpr double kSwing = 0.5;          // share of the turning acceleration that such a correction counts on
// Driving a step of curvature as a ramp leaves the path by so much at most, or it is driven more slowly.
constexpr double kRampAcross_m = 0.005;

void requireStep(double dt_s) {
  if (dt_s > 0.0 && dt_s <= 0.5) return;
  throw std::invalid_argument("dt = " + std::to_string(dt_s) + " s, must be above 0 and at most 0.5 s");
}

/// Share of its speed that is left to a reference whose base lags so far.
double waiting(double lag, double wait) {
  return std::clamp(2.0 * (1.0 - lag / wait), 0.0, 1.0);
}

/// Speed at `left` before a place to stand at: braking evenly, and in the end in proportion to what is left, at `gain`: a
/// drive that lags by less than 1 / gain does not overshoot.
double endingSpeed(double left, double deceleration, double gain) {
  const double proportional = deceleration / (gain * gain);
  if (left < proportional) return gain * std::max(0.0, left);
  return std::sqrt(2.0 * deceleration * (left - 0.5 * proportional));
}

}  // namespace

PathFollower::PathFollower(const PathFollowerConfig& config, const MotionLimits& limits)
    : config_(config), limits_(limits) {
  std::vector<std::string> problems = interactive_mapping::problemsOf(config);
  for (const std::string& problem : limits.validate()) problems.push_back(problem);
  interactive_mapping::refuseIfAny("impossible path follower:", problems);
}

void PathFollower::start(const BasePath& path) {
  bool is_finite = std::isfinite(path.start.x_m) && std::isfinite(path.start.y_m) && std::isfinite(path.start.yaw_rad);
  for (const BaseMotion& motion : path.motions) {
    is_finite = is_finite && std::isfinite(motion.length_m) && std::isfinite(motion.turn_rad);
  }
  if (!is_finite) throw std::invalid_argument("the path to follow is not finite");
  path_ = path;
  path_->tidy();
  stretches_ = stretches(*path_);
  starts_map_.clear();
  Pose2d pose_map = path.start;
  for (const BaseMotion& motion : path_->motions) {
    starts_map_.push_back(pose_map);
    pose_map = moveAlongArc(pose_map, motion.length_m, motion.turn_rad);
  }
  stretch_ = 0;
  stretch_at_m_ = 0.0;
  smooth_map_.reset();
  beginStretch();
}

void PathFollower::beginStretch() {
  progress_ = 0.0;
  reference_speed_ = 0.0;
  pieces_.clear();
  joints_.clear();
  is_over_ = stretch_ >= stretches_.size();
  if (is_over_) return;
  const Stretch& stretch = stretches_[stretch_];
  if (stretch.is_turn) return;
  double at_m = 0.0;
  for (std::size_t i = stretch.begin; i < stretch.end; ++i) {
    const BaseMotion& motion = path_->motions[i];
    const double length_m = std::abs(motion.length_m);
    const double curvature_1_m = motion.turn_rad / length_m;
    const double speed_m_s = std::min(stretch.is_forward ? limits_.forward_m_s : limits_.backward_m_s,
                                      limits_.turn_rad_s / std::max(1e-9, std::abs(curvature_1_m)));
    pieces_.push_back({at_m, at_m + length_m, curvature_1_m, config_.speed_reserve * speed_m_s});
    at_m += length_m;
  }
  const double turning_rad_s2 = kAccelerationReserve * limits_.turn_rad_s2;
  for (std::size_t i = 1; i < pieces_.size(); ++i) {
    const double step_1_m = pieces_[i].curvature_1_m - pieces_[i - 1].curvature_1_m;
    const double step = std::abs(step_1_m);
    if (step < 1e-6) continue;
    // d(omega) / dt = step v / (2 half / v) <= acceleration, and half a ramp leads step half^2 / 6 aside.
    const double slow_m_s =
        std::pow(24.0 * kRampAcross_m * turning_rad_s2 * turning_rad_s2 / (step * step * step), 0.25);
    const double speed_m_s = std::min({pieces_[i - 1].max_speed_m_s, pieces_[i].max_speed_m_s, slow_m_s});
    joints_.push_back({pieces_[i].begin_m, step_1_m, 0.5 * step * speed_m_s * speed_m_s / turning_rad_s2, speed_m_s});
  }
  // Ramps do not overlap: together they would turn faster than either. Half their length goes with the speed squared.
  constexpr double kSlowest_m_s = 0.05;
  for (std::size_t i = 1; i < joints_.size(); ++i) {
    const double share = (joints_[i].at_m - joints_[i - 1].at_m) / (joints_[i].half_m + joints_[i - 1].half_m);
    if (share >= 1.0) continue;
    for (Joint* joint : {&joints_[i - 1], &joints_[i]}) {
      const double slower_m_s = std::max(std::min(kSlowest_m_s, joint->speed_m_s), joint->speed_m_s * std::sqrt(share));
      joint->half_m *= (slower_m_s / joint->speed_m_s) * (slower_m_s / joint->speed_m_s);
      joint->speed_m_s = slower_m_s;
    }
  }
}

std::size_t PathFollower::pieceAt(double at_m) const {
  std::size_t i = 0;
  while (i + 1 < pieces_.size() && at_m >= pieces_[i].end_m) ++i;
  return i;
}

/// Speed at a place of the stretch from which all that comes can be braked for.
double PathFollower::plannedSpeed(double at_m) const {
  const std::size_t here = pieceAt(at_m);
  const double deceleration = kAccelerationReserve * limits_.linear_m_s2;
  double speed_m_s = std::min(pieces_[here].max_speed_m_s,
                              endingSpeed(pieces_.back().end_m - at_m, deceleration, config_.gain_along_1_s));
  const auto brakeFor = [&](double to_speed_m_s, double left_m) {
    const double squared = to_speed_m_s * to_speed_m_s + 2.0 * deceleration * std::max(0.0, left_m);
    speed_m_s = std::min(speed_m_s, std::sqrt(squared));
  };
  for (std::size_t i = here + 1; i < pieces_.size(); ++i) {
    brakeFor(pieces_[i].max_speed_m_s, pieces_[i].begin_m - at_m);
  }
  for (const Joint& joint : joints_) {
    if (at_m <= joint.at_m + joint.half_m) brakeFor(joint.speed_m_s, joint.at_m - joint.half_m - at_m);
  }
  return speed_m_s;
}

Pose2d PathFollower::referenceAt(double progress) const {
  if (stretch_ >= stretches_.size()) return path_->end();
  const Stretch& stretch = stretches_[stretch_];
  if (stretch.is_turn) {
    return moveAlongArc(starts_map_[stretch.begin], 0.0, std::copysign(progress, stretch.turn_rad));
  }
  const std::size_t i = pieceAt(progress);
  const double length_m = progress - pieces_[i].begin_m;
  return moveAlongArc(starts_map_[stretch.begin + i], stretch.is_forward ? length_m : -length_m,
                      pieces_[i].curvature_1_m * length_m);
}

/// Curvature that is driven, the path's with its steps made ramps.
double PathFollower::curvatureAt(double at_m) const {
  double curvature_1_m = pieces_.front().curvature_1_m;
  for (const Joint& joint : joints_) {
    curvature_1_m += joint.step_1_m * std::clamp(0.5 + 0.5 * (at_m - joint.at_m) / joint.half_m, 0.0, 1.0);
  }
  return curvature_1_m;
}

/// How far the base has turned there beyond the path: the ramps' integral less the steps'.
double PathFollower::yawAheadOf(double at_m) const {
  double yaw_rad = 0.0;
  for (const Joint& joint : joints_) {
    const double within_m = joint.half_m - std::abs(at_m - joint.at_m);
    if (within_m > 0.0) yaw_rad += joint.step_1_m * within_m * within_m / (4.0 * joint.half_m);
  }
  return yaw_rad;
}

/// Where the base will be when the next command takes effect.
Pose2d PathFollower::expected(const Pose2d& pose_map) const {
  return moveAlongArc(pose_map, config_.lag_s * last_.linear_m_s, config_.lag_s * last_.angular_rad_s);
}

/// Takes in a measured pose. What differs much is no noise.
void PathFollower::observe(const Pose2d& pose_map, double dt_s) {
  if (smooth_map_) {
    const Pose2d predicted = moveAlongArc(*smooth_map_, dt_s * last_.linear_m_s, dt_s * last_.angular_rad_s);
    const Eigen::Vector2d off = pose_map.position() - predicted.position();
    const double off_rad = wrapAngle(pose_map.yaw_rad - predicted.yaw_rad);
    if (off.norm() < 0.5 * kMaxError_m && std::abs(off_rad) < 0.5 * kMaxError_rad) {
      const double share = kNoiseShare;
      smooth_map_ = Pose2d{predicted.x_m + share * off.x(), predicted.y_m + share * off.y(),
                           wrapAngle(predicted.yaw_rad + share * off_rad)};
      return;
    }
  }
  smooth_map_ = pose_map;
}

PathFollower::Error PathFollower::errorOf(const Pose2d& pose_map) const {
  const Pose2d error = compose(inverse(pose_map), referenceAt(progress_));
  const double ahead_rad = pieces_.empty() ? 0.0 : yawAheadOf(progress_);
  return {error.x_m, error.y_m, wrapAngle(error.yaw_rad + ahead_rad)};
}

/// Kanayama's law, with eq. (8) of the paper for backwards too: across error and speed change signs together, the yaw
/// error's gain stays positive. With V = (x^2 + y^2) / 2 + (1 - cos yaw) / gain_across,
/// dV/dt = -gain_along x^2 - |v| gain_yaw / gain_across sin^2 yaw, near the path. `speed` is not negative.
Twist2d PathFollower::law(const Error& error, double speed) const {
  const Stretch& stretch = stretches_[stretch_];
  if (stretch.is_turn) {
    return {0.0, std::copysign(speed, stretch.turn_rad) + kGainTurn_1_s * error.yaw_rad};
  }
  const double direction = stretch.is_forward ? 1.0 : -1.0;
  const double frequency_1_s = speed * std::sqrt(kGainAcross_1_m2);
  const double scale = frequency_1_s > kMaxCorrection_1_s ? kMaxCorrection_1_s / frequency_1_s : 1.0;
  Twist2d twist;
  twist.linear_m_s = direction * speed * std::cos(error.yaw_rad) + config_.gain_along_1_s * error.along_m;
  // The two corrections of the angle as one: the heading to take is the reference's, turned to the path, and never so
  // steep or so fast that the base, whose turning cannot change faster than its limit, would swing over.
  const double gain_yaw_1_s = speed * scale * kGainYaw_1_m;
  const double towards_rad = scale * kGainAcross_1_m2 / kGainYaw_1_m * error.across_m;
  const double off_rad = std::sin(error.yaw_rad) + direction * std::clamp(towards_rad, -kSteepest_rad, kSteepest_rad);
  const double brakeable_rad_s = std::sqrt(2.0 * kSwing * limits_.turn_rad_s2 * std::abs(off_rad));
  twist.angular_rad_s = speed * curvatureAt(progress_) +
                        std::copysign(std::min(gain_yaw_1_s * std::abs(off_rad), brakeable_rad_s), off_rad);
  // Never against the stretch's direction: what is passed is passed.
  if (direction * twist.linear_m_s < 0.0) twist.linear_m_s = 0.0;
  return twist;
}

/// Within the limits of speed, the arc kept, and of acceleration.
Twist2d PathFollower::limited(const Twist2d& wanted, double dt_s) const {
  Twist2d twist = wanted;
  const double over = std::abs(twist.angular_rad_s) / limits_.turn_rad_s;
  if (over > 1.0) {
    twist.linear_m_s /= over;
    twist.angular_rad_s /= over;
  }
  twist.linear_m_s = std::clamp(twist.linear_m_s, -limits_.backward_m_s, limits_.forward_m_s);
  const double linear = limits_.linear_m_s2 * dt_s;
  const double angular = limits_.turn_rad_s2 * dt_s;
  twist.linear_m_s = std::clamp(twist.linear_m_s, last_.linear_m_s - linear, last_.linear_m_s + linear);
  twist.angular_rad_s = std::clamp(twist.angular_rad_s, last_.angular_rad_s - angular, last_.angular_rad_s + angular);
  return twist;
}

void PathFollower::report(const Pose2d& pose_map, FollowCommand* command) const {
  const bool has_stretch = stretch_ < stretches_.size();
  const bool is_turn = has_stretch && stretches_[stretch_].is_turn;
  command->at_m = stretch_at_m_ + (is_turn ? 0.0 : progress_);
  command->motion =
      has_stretch ? stretches_[stretch_].begin + (is_turn ? 0 : pieceAt(progress_)) : path_->motions.size();
  command->reference_map = referenceAt(progress_);
  const Pose2d seen = compose(inverse(command->reference_map), pose_map);
  command->error_along_m = seen.x_m;
  command->error_across_m = seen.y_m;
  command->error_yaw_rad = seen.yaw_rad;
}

Twist2d PathFollower::wanted(const Pose2d& pose_map) const {
  if (!path_) throw std::logic_error("no path is followed");
  if (is_over_) return {};
  const Stretch& stretch = stretches_[stretch_];
  if (stretch.is_turn) return {0.0, std::copysign(config_.speed_reserve * limits_.turn_rad_s, stretch.turn_rad)};
  Error error = errorOf(expected(pose_map));
  error.along_m = 0.0;  // a lag is made up for along the same arc
  // The arc is that of the present speed: corrections bend it more while it is low.
  constexpr double kSlowest_m_s = 0.05;
  const double now_m_s = std::max(reference_speed_, kSlowest_m_s);
  const double max_m_s = pieces_[pieceAt(progress_)].max_speed_m_s;
  const Twist2d twist = law(error, now_m_s);
  const double scale = std::min(max_m_s / now_m_s, limits_.turn_rad_s / std::max(1e-9, std::abs(twist.angular_rad_s)));
  return {scale * twist.linear_m_s, scale * twist.angular_rad_s};
}

std::vector<BaseMotion> PathFollower::ahead() const {
  std::vector<BaseMotion> motions;
  if (!path_ || is_over_) return motions;
  const Stretch& stretch = stretches_[stretch_];
  if (stretch.is_turn) {
    const double left_rad = std::abs(stretch.turn_rad) - progress_;
    if (left_rad > 0.0) motions.push_back({0.0, std::copysign(left_rad, stretch.turn_rad)});
    return motions;
  }
  for (std::size_t i = pieceAt(progress_); i < pieces_.size(); ++i) {
    const double length_m = pieces_[i].end_m - std::max(progress_, pieces_[i].begin_m);
    if (length_m <= 0.0) continue;
    motions.push_back({stretch.is_forward ? length_m : -length_m, pieces_[i].curvature_1_m * length_m});
  }
  return motions;
}

FollowCommand PathFollower::update(const Pose2d& pose_map, double dt_s, double speed_factor) {
  if (!path_) throw std::logic_error("no path is followed");
  requireStep(dt_s);
  if (!(speed_factor >= 0.0 && speed_factor <= 1.0)) {
    throw std::invalid_argument("speed_factor = " + std::to_string(speed_factor) + ", must be in [0, 1]");
  }
  if (!std::isfinite(pose_map.x_m) || !std::isfinite(pose_map.y_m) || !std::isfinite(pose_map.yaw_rad)) {
    throw std::invalid_argument("pose of the base is not finite");
  }
  FollowCommand command;
  const Error off = errorOf(pose_map);
  if (std::hypot(off.along_m, off.across_m) > kMaxError_m || std::abs(off.yaw_rad) > kMaxError_rad) {
    report(pose_map, &command);
    command.status = FollowStatus::kLost;
    command.twist = brake(dt_s);
    return command;
  }

  if (!is_over_) {
    const Stretch& stretch = stretches_[stretch_];
    const double length = stretch.is_turn ? std::abs(stretch.turn_rad) : stretch.length_m;
    const double sense = stretch.is_turn ? std::copysign(1.0, stretch.turn_rad) : stretch.is_forward ? 1.0 : -1.0;
    // The reference's speed: what is planned here, less for an obstacle, and never faster than it can brake or speed up.
    const double planned_acceleration =
        kAccelerationReserve * (stretch.is_turn ? limits_.turn_rad_s2 : limits_.linear_m_s2);
    const double braking = stretch.is_turn ? limits_.turn_rad_s2 : limits_.linear_m_s2;
    double planned = 0.0;
    double cruise = 0.0;
    if (stretch.is_turn) {
      cruise = config_.speed_reserve * limits_.turn_rad_s;
      planned = std::min(cruise, endingSpeed(length - progress_, planned_acceleration, kGainTurn_1_s));
    } else {
      cruise = pieces_[pieceAt(progress_)].max_speed_m_s;
      planned = plannedSpeed(progress_);
    }
    const double allowed = speed_factor * cruise;
    reference_speed_ = std::clamp(std::min(planned, allowed), reference_speed_ - braking * dt_s,
                                  reference_speed_ + planned_acceleration * dt_s);
    observe(pose_map, dt_s);
    const Pose2d expected_map = expected(*smooth_map_);
    // As measured: a base that is held is not where it is expected.
    const double behind = stretch.is_turn ? sense * off.yaw_rad : sense * off.along_m;
    const double lag = behind - config_.lag_s * reference_speed_;
    const double share = waiting(lag, stretch.is_turn ? kWait_rad : config_.wait_m);
    progress_ = std::min(length, progress_ + share * reference_speed_ * dt_s);
    const Error error = errorOf(expected_map);

    Twist2d twist = law(error, reference_speed_);
    // A correction does not make the base faster than the guard allows, the braking within the limits apart.
    double& along = stretch.is_turn ? twist.angular_rad_s : twist.linear_m_s;
    along = sense * std::min(sense * along, allowed);
    if (allowed <= 0.0 && stretch.is_turn) along = 0.0;
    last_ = limited(twist, dt_s);

    const double left =
        stretch.is_turn ? length - progress_ + sense * error.yaw_rad : length - progress_ + sense * error.along_m;
    const double settle = stretch.is_turn ? kSettle_rad : kSettle_m;
    is_over_ = (!stretch.is_turn && left <= settle) || (std::abs(left) <= settle && progress_ >= length - settle);
  } else {
    observe(pose_map, dt_s);
    last_ = pause(dt_s);
  }

  report(pose_map, &command);
  command.twist = last_;
  if (is_over_ && last_.linear_m_s == 0.0 && last_.angular_rad_s == 0.0) {
    if (stretch_ + 1 < stretches_.size()) {
      stretch_at_m_ += stretches_[stretch_].length_m;
      ++stretch_;
      beginStretch();
    } else {
      command.status = FollowStatus::kReached;
      path_.reset();
    }
  }
  return command;
}

bool PathFollower::resume(const Pose2d& pose_map) {
  if (!path_) return false;
  if (is_over_) return true;
  const double before = progress_;
  const Stretch& stretch = stretches_[stretch_];
  double best = std::numeric_limits<double>::infinity();
  double best_progress = progress_;
  const double length = stretch.is_turn ? std::abs(stretch.turn_rad) : stretch.length_m;
  // Steps of a millimetre or milliradian: below what the localisation tells apart.
  const int steps = std::max(1, static_cast<int>(std::ceil(length / 0.001)));
  for (int i = 0; i <= steps; ++i) {
    progress_ = length * i / steps;
    const Error error = errorOf(pose_map);
    const double off =
        std::hypot(error.along_m, error.across_m) / kMaxError_m + std::abs(error.yaw_rad) / kMaxError_rad;
    if (off >= best) continue;
    best = off;
    best_progress = progress_;
  }
  progress_ = best <= 0.5 ? best_progress : before;
  smooth_map_.reset();
  reference_speed_ = 0.0;
  return best <= 0.5;
}

Twist2d PathFollower::pause(double dt_s) {
  return slowDown(dt_s, 1.0);
}

Twist2d PathFollower::stop(double dt_s) {
  return slowDown(dt_s, limits_.stop_m_s2 / limits_.linear_m_s2);
}

/// Along the arc of the last command, with `share` of the limits of acceleration.
Twist2d PathFollower::slowDown(double dt_s, double share) {
  requireStep(dt_s);
  const double time_s =
      std::max(std::abs(last_.linear_m_s) / limits_.linear_m_s2, std::abs(last_.angular_rad_s) / limits_.turn_rad_s2) /
      share;
  const double left = time_s > dt_s ? 1.0 - dt_s / time_s : 0.0;
  last_ = left > 0.0 ? Twist2d{left * last_.linear_m_s, left * last_.angular_rad_s} : Twist2d{};
  reference_speed_ = 0.0;
  return last_;
}

Twist2d PathFollower::brake(double dt_s) {
  path_.reset();
  return pause(dt_s);
}

void PathFollower::halt() {
  last_ = {};
  reference_speed_ = 0.0;
}

}  // namespace base_navigation
