// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning_ros/robot_state.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <thread>

#include <interactive_mapping_common/formatted.h>
#include <interactive_mapping_common_ros/poses.h>
#include <mp700_ur5e_description/robot_names.h>
#include <ros/console.h>

#include "motion_planning_ros/conversions.h"

namespace motion_planning_ros {
namespace {

using interactive_mapping::formatted;
using motion_planning::ArmVector;
using motion_planning::LoadedBrick;
using mp700_ur5e_description::kArmJoints;
using mp700_ur5e_description::kMagnetTipFrame;

constexpr double kLongestHeld_m = 1.0;              // nothing longer can be carried between mast and pile
constexpr double kTfWait_s = 0.5;                   // wall time: some periods of the slowest publisher, 10 Hz
constexpr std::chrono::milliseconds kTfPeriod(10);  // how soon a waiting request notices that it was cancelled

}  // namespace

double maxHeldEdge(const mp700_ur5e_description::BrickCatalogue& catalogue) {
  double longest_m = 0.0;
  for (const mp700_ur5e_description::BrickType& type : catalogue.types) {
    longest_m = std::max(longest_m, type.size_m.maxCoeff());
  }
  return std::min(2.0 * longest_m, kLongestHeld_m);
}

void addToLoad(const motion_planning::ArmKinematics& arm, const ArmVector& joints_rad,
               const motion_planning::HeldBrick& held, std::vector<LoadedBrick>* load) {
  const std::optional<LoadedBrick> brick =
      motion_planning::settledInContainer(arm, {arm.tipPose(joints_rad) * held.T_tip_brick, held.size_m});
  if (!brick) return;
  // Two bricks do not lie in one place: the older one was taken out by hand.
  const auto is_there = [&](const LoadedBrick& other) {
    return (other.T_base_brick.translation() - brick->T_base_brick.translation()).norm() < 0.5 * held.size_m.minCoeff();
  };
  load->erase(std::remove_if(load->begin(), load->end(), is_there), load->end());
  load->push_back(*brick);
}

RobotState::RobotState(const ros::NodeHandle& nh, std::shared_ptr<const motion_planning::ArmKinematics> arm,
                       const MotionPlanningParams& params, double max_held_edge_m)
    : kinematics_(std::move(arm)),
      params_(params),
      max_held_edge_m_(max_held_edge_m),
      tf_listener_(tf_, true, ros::TransportHints().tcpNoDelay()) {
  ros::NodeHandle handle(nh);
  joint_subscriber_ =
      handle.subscribe("joint_states", 20, &RobotState::onJointState, this, ros::TransportHints().tcpNoDelay());
  attached_subscriber_ = handle.subscribe("attached_brick", 5, &RobotState::onAttached, this);
}

void RobotState::onJointState(const sensor_msgs::JointStateConstPtr& message) {
  if (message->position.size() != message->name.size()) {
    ROS_WARN_THROTTLE_NAMED(10.0, kLog, "joint_states with %zu names and %zu positions ignored", message->name.size(),
                            message->position.size());
    return;
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  for (std::size_t i = 0; i < message->name.size(); ++i) {
    if (!std::isfinite(message->position[i])) continue;  // too old soon, if nothing better comes
    joints_[message->name[i]] = {message->position[i], message->header.stamp};
  }
}

std::optional<ArmVector> RobotState::arm(std::string* why_not) const {
  return armWithin(params_.state.max_joint_age_s, why_not);
}

std::optional<ArmVector> RobotState::armWithin(double max_age_s, std::string* why_not) const {
  const ros::Time now = ros::Time::now();
  const std::lock_guard<std::mutex> lock(mutex_);
  ArmVector result;
  for (std::size_t i = 0; i < kArmJoints.size(); ++i) {
    const auto found = joints_.find(kArmJoints[i]);
    if (found == joints_.end()) {
      *why_not = std::string("no joint state of ") + kArmJoints[i] + " has come on " + joint_subscriber_.getTopic();
      return std::nullopt;
    }
    const double age_s = (now - found->second.second).toSec();
    if (std::abs(age_s) > max_age_s) {
      *why_not = std::string("the joint state of ") + kArmJoints[i] + " is " + formatted("%.3f s", age_s) +
                 " old, allowed are " + formatted("%.3f s", max_age_s);
      return std::nullopt;
    }
    result[static_cast<Eigen::Index>(i)] = found->second.first;
  }
  return result;
}

std::optional<Eigen::Isometry3d> RobotState::base(std::string* why_not) const {
  const std::string& base_frame = kinematics_->robot().rootFrame();
  try {
    const geometry_msgs::TransformStamped transform = tf_.lookupTransform(params_.map_frame, base_frame, ros::Time(0));
    const double age_s = (ros::Time::now() - transform.header.stamp).toSec();
    // Stamp zero: all static.
    if (!transform.header.stamp.isZero() && std::abs(age_s) > params_.state.max_tf_age_s) {
      *why_not = "tf's pose of " + base_frame + " in " + params_.map_frame + " is " + formatted("%.3f s", age_s) +
                 " old, allowed are " + formatted("%.3f s", params_.state.max_tf_age_s);
      return std::nullopt;
    }
    const std::optional<Eigen::Isometry3d> T = toIsometry(transform.transform);
    if (!T) *why_not = "tf's pose of " + base_frame + " in " + params_.map_frame + " is not finite or no rotation";
    return T;
  } catch (const tf2::TransformException& error) {
    *why_not = "no pose of " + base_frame + " in " + params_.map_frame + ": " + error.what();
    return std::nullopt;
  }
}

std::optional<Eigen::Isometry3d> RobotState::frameInMap(const std::string& name, const ros::Time& stamp,
                                                        const std::function<bool()>& is_cancelled,
                                                        std::string* why_not) const {
  const std::string frame = withoutSlash(name);
  if (frame == params_.map_frame) return Eigen::Isometry3d::Identity();
  // tf2's own wait is by ROS time, and a simulated clock may stand still until there is a plan.
  const ros::WallTime give_up = ros::WallTime::now() + ros::WallDuration(kTfWait_s);
  while (!stamp.isZero() && !tf_.canTransform(params_.map_frame, frame, stamp) && ros::WallTime::now() < give_up) {
    if (is_cancelled && is_cancelled()) {
      *why_not = "cancelled while waiting for tf";
      return std::nullopt;
    }
    std::this_thread::sleep_for(kTfPeriod);
  }
  try {
    const std::optional<Eigen::Isometry3d> T =
        toIsometry(tf_.lookupTransform(params_.map_frame, frame, stamp).transform);
    if (!T) *why_not = "tf's pose of " + frame + " in " + params_.map_frame + " is not finite or no rotation";
    return T;
  } catch (const tf2::TransformException& error) {
    *why_not = "no pose of frame '" + frame + "' in " + params_.map_frame;
    if (!stamp.isZero()) *why_not += " at its stamp, " + formatted("%.3f s", stamp.toSec());
    if (tf_.canTransform(params_.map_frame, frame, ros::Time(0))) {
      const ros::Time newest = tf_.lookupTransform(params_.map_frame, frame, ros::Time(0)).header.stamp;
      *why_not += ", tf has it up to " + formatted("%.3f s", newest.toSec());
    }
    *why_not += std::string(": ") + error.what();
    return std::nullopt;
  }
}

void RobotState::onAttached(const interactive_mapping_msgs::AttachedBrickConstPtr& message) {
  std::optional<Held> held;
  std::string problem;
  if (message->is_attached != 0) {
    const auto& robot = kinematics_->robot();
    const std::string frame = withoutSlash(message->header.frame_id);
    const std::optional<Eigen::Isometry3d> T_frame_brick = toIsometry(message->pose);
    const Eigen::Vector3d size(message->size.x, message->size.y, message->size.z);
    if (!T_frame_brick || !size.allFinite() || size.minCoeff() <= 0.0) {
      problem = "its pose is not finite or no rotation, or an edge of it is not above 0 m";
    } else if (size.maxCoeff() > max_held_edge_m_) {
      problem = "its longest edge is " + formatted("%.3f m", size.maxCoeff()) + ", must be at most " +
                formatted("%.3f m", max_held_edge_m_) + ": twice that of the bricks in bricks_file, and no more than " +
                formatted("%.3f m", kLongestHeld_m);
    } else if (!robot.hasFrame(frame) || robot.bodyOf(frame) != robot.bodyOf(kMagnetTipFrame)) {
      problem = "its frame '" + frame + "' is not fixed to " + kMagnetTipFrame;
    } else {
      held.emplace();
      held->id = message->id;
      held->type = message->type;
      held->brick.size_m = size;
      held->brick.T_tip_brick = robot.poseInBody(kMagnetTipFrame).inverse() * robot.poseInBody(frame) * *T_frame_brick;
    }
  }
  if (!problem.empty()) ROS_ERROR_NAMED(kLog, "attached brick %d: %s", message->id, problem.c_str());
  std::string why_not;
  // However old: the arm stands where it lets go.
  const std::optional<ArmVector> joints_rad = armWithin(std::numeric_limits<double>::infinity(), &why_not);
  const std::lock_guard<std::mutex> lock(mutex_);
  if (held_ && message->is_attached == 0) {
    if (joints_rad) {
      addToLoad(*kinematics_, *joints_rad, held_->brick, &load_);
    } else {
      ROS_WARN_NAMED(kLog, "brick %d is not avoided where it was let go: %s", held_->id, why_not.c_str());
    }
  }
  held_ = std::move(held);
  taken_at_.reset();
  if (held_) taken_at_ = message->header.stamp;
  held_problem_ = std::move(problem);
}

std::optional<RobotState::Held> RobotState::held() {
  const std::lock_guard<std::mutex> lock(mutex_);
  findVacated();
  return held_;
}

/// Where the tip was when the brick was gripped: the arm may have lifted it before the message was heard. What tf does not
/// have yet is looked for once more when it is asked for next.
void RobotState::findVacated() {
  if (!taken_at_) return;
  std::string why_not;
  try {
    const geometry_msgs::TransformStamped newest =
        tf_.lookupTransform(params_.map_frame, kMagnetTipFrame, ros::Time(0));
    if (!newest.header.stamp.isZero() && newest.header.stamp < *taken_at_) return;  // zero: all static
    if (taken_at_->isZero()) throw tf2::ExtrapolationException("attached_brick has no stamp");
    const std::optional<Eigen::Isometry3d> T_map_tip =
        toIsometry(tf_.lookupTransform(params_.map_frame, kMagnetTipFrame, *taken_at_).transform);
    if (T_map_tip) {
      held_->vacated = motion_planning::OrientedBox{*T_map_tip * held_->brick.T_tip_brick, held_->brick.size_m};
    } else {
      why_not = "tf's pose of the tip is not finite or no rotation";
    }
  } catch (const tf2::ExtrapolationException& error) {
    why_not = error.what();  // from before tf's oldest: a latched message, heard after a restart
  } catch (const tf2::TransformException& error) {
    ROS_WARN_THROTTLE_NAMED(10.0, kLog, "where brick %d was taken from is not known yet: %s", held_->id, error.what());
    return;
  }
  if (!why_not.empty()) {
    ROS_WARN_NAMED(kLog, "where brick %d was taken from is not known: %s", held_->id, why_not.c_str());
  }
  taken_at_.reset();
}

std::vector<LoadedBrick> RobotState::load() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return load_;
}

void RobotState::emptied() {
  const std::lock_guard<std::mutex> lock(mutex_);
  load_.clear();
}

std::string RobotState::heldProblem() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return held_problem_;
}

}  // namespace motion_planning_ros
