// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include <Eigen/Geometry>
#include <ros/node_handle.h>
#include <ros/subscriber.h>

#include "motion_planning/collision_scene.h"
#include "motion_planning_ros/motion_planning_params.h"
#include "motion_planning_ros/robot_state.h"

namespace motion_planning_ros {

/// A scene with what it was made from.
struct MapScene {
  std::shared_ptr<const motion_planning::CollisionScene> scene;
  std::shared_ptr<const motion_planning::CollisionScene> watched;  // the same with the path monitor's margins
  Eigen::Isometry3d T_map_base{Eigen::Isometry3d::Identity()};
  ros::Time stamp;              // of the last image in the map
  std::uint64_t map_update{0};  // number of images in the map
  motion_planning::SceneUpdate statistics;
};

/// Makes scenes of the map, on a thread of its own. The thread gets the mesh (`map/get_mesh`) and asks about
/// uncertainty and unknown space (`map/query`). It does so when a scene is asked for, and after each image
/// (`map/update`) while it follows the map.
class SceneKeeper {
 public:
  struct Counters {
    std::uint64_t images{0};  // in the map, heard of
    std::uint64_t scenes{0};
    std::string last_failure;  // empty since the last scene
    ros::WallTime last_image;  // zero: none yet
  };

  /// `on_scene` runs on this keeper's thread after each new scene.
  SceneKeeper(const ros::NodeHandle& nh, const RobotState& robot, const MotionPlanningParams& params,
              std::function<void(const MapScene&)> on_scene);
  ~SceneKeeper();
  SceneKeeper(const SceneKeeper&) = delete;
  SceneKeeper& operator=(const SceneKeeper&) = delete;

  /// Begins to listen. Once.
  void start();
  /// No `on_scene` runs any more when it returns.
  void stop();

  /// Whether each image in the map leads to a scene, from now on; the first one always does. Returns what was before.
  bool follow(bool is_followed);

  /// The scene of the map as it is now, with the robot at `T_map_base`: waits until it is made. Nothing, and why: the map
  /// does not answer, cancelled.
  std::shared_ptr<const MapScene> current(const Eigen::Isometry3d& T_map_base,
                                          const std::function<bool()>& is_cancelled, std::string* why_not);

  /// Of the newest image in the map heard of; zero: none yet.
  ros::Time imageStamp() const;
  std::string updateTopic() const { return update_subscriber_.getTopic(); }

  /// The last one made; null: none yet.
  std::shared_ptr<const MapScene> last() const;
  Counters counters() const;
  /// Why last() may not be the map as it is: the newest try failed, or the map has not answered for seconds of wall time.
  /// Empty: it is, or is being made.
  std::string problem() const;

 private:
  void work();
  bool isNear(const Eigen::Isometry3d& T_map_base, const Eigen::Isometry3d& other) const;

  ros::NodeHandle nh_;
  const RobotState& robot_;
  const MotionPlanningParams& params_;
  const std::function<void(const MapScene&)> on_scene_;

  mutable std::mutex mutex_;  // guards what follows, up to the blank line
  std::condition_variable changed_;
  bool is_stopping_{false};
  ros::Time image_stamp_;
  bool is_followed_{false};
  std::uint64_t asked_number_{0};  // a scene was asked for at asked_pose_; counts such requests
  Eigen::Isometry3d asked_pose_{Eigen::Isometry3d::Identity()};
  ros::SteadyTime trying_since_;  // zero: no try runs
  std::uint64_t done_images_{0};  // counters_.images that were tried
  std::uint64_t done_asked_number_{0};
  std::shared_ptr<const MapScene> last_;
  Counters counters_;

  ros::Subscriber update_subscriber_;
  std::thread worker_;  // last: everything it uses exists before it
};

}  // namespace motion_planning_ros
