// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_msgs/AttachedBrick.h>
#include <mp700_ur5e_description/brick_types.h>
#include <ros/node_handle.h>
#include <sensor_msgs/JointState.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include "motion_planning/motion_planner.h"
#include "motion_planning_ros/motion_planning_params.h"

namespace motion_planning_ros {

constexpr char kLog[] = "motion_planning";  // the logger's name

/// The longest edge that something on the magnet may have and be taken for a brick [m].
double maxHeldEdge(const mp700_ur5e_description::BrickCatalogue& catalogue);

/// Adds what is let go with the arm in this posture, if it falls into the container; it takes the place of what lay there.
void addToLoad(const motion_planning::ArmKinematics& arm, const motion_planning::ArmVector& joints_rad,
               const motion_planning::HeldBrick& held, std::vector<motion_planning::LoadedBrick>* load);

/// What the robot is known to be doing: joint_states, tf and attached_brick. Every method may be called from any thread.
class RobotState {
 public:
  /// `max_held_edge_m`: what hangs on the magnet with a longer edge is no brick.
  RobotState(const ros::NodeHandle& nh, std::shared_ptr<const motion_planning::ArmKinematics> arm,
             const MotionPlanningParams& params, double max_held_edge_m);

  /// The newest joint angles; nothing, and why, if there are none or they are older than allowed.
  std::optional<motion_planning::ArmVector> arm(std::string* why_not) const;

  /// T_map_base, the newest that tf has; nothing, and why, if there is none or it is older than allowed.
  std::optional<Eigen::Isometry3d> base(std::string* why_not) const;

  /// T_map_frame at `stamp` (zero: tf's newest), for goals in other frames. Waits half a second by the wall clock for
  /// what tf does not have yet. Nothing, and why, if it does not come or `is_cancelled`.
  std::optional<Eigen::Isometry3d> frameInMap(const std::string& frame, const ros::Time& stamp,
                                              const std::function<bool()>& is_cancelled, std::string* why_not) const;

  struct Held {
    int id{-1};
    std::string type;
    motion_planning::HeldBrick brick;
    std::optional<motion_planning::OrientedBox> vacated;  // its place at the message's stamp; nothing: not known (yet)
  };
  /// What the magnet holds, if anything.
  std::optional<Held> held();
  /// What lies in the container: every brick that was let go over it since emptied().
  std::vector<motion_planning::LoadedBrick> load() const;
  void emptied();
  /// Why the last message of attached_brick was rejected; empty: it was not. No plan is made then.
  std::string heldProblem() const;

 private:
  std::optional<motion_planning::ArmVector> armWithin(double max_age_s, std::string* why_not) const;
  void onJointState(const sensor_msgs::JointStateConstPtr& message);
  void onAttached(const interactive_mapping_msgs::AttachedBrickConstPtr& message);
  void findVacated();

  const std::shared_ptr<const motion_planning::ArmKinematics> kinematics_;
  const MotionPlanningParams& params_;
  const double max_held_edge_m_;
  tf2_ros::Buffer tf_;
  tf2_ros::TransformListener tf_listener_;

  mutable std::mutex mutex_;                                    // guards what follows, up to the blank line
  std::map<std::string, std::pair<double, ros::Time>> joints_;  // angle and stamp by name: a message may hold some only
  std::optional<Held> held_;
  std::optional<ros::Time> taken_at_;  // what is held, and its place is still to be found
  std::string held_problem_;
  std::vector<motion_planning::LoadedBrick> load_;

  ros::Subscriber joint_subscriber_, attached_subscriber_;
};

}  // namespace motion_planning_ros
