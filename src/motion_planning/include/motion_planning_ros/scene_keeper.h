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
#include <interactive_mapping_msgs/SurfaceMesh.h>
#include <ros/node_handle.h>

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

/// Makes scenes of the map's meshes (`map/mesh`), on a thread of its own that asks the map (`map/query`) about uncertainty and
/// unknown space: of the newest when one is asked for, of each while it follows the map. Meshes that come meanwhile replace
/// each other.
class SceneKeeper {
 public:
  struct Counters {
    std::uint64_t meshes{0};
    std::uint64_t scenes{0};
    std::string last_failure;  // empty since the last scene
    ros::WallTime last_mesh;   // zero: none yet
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

  /// Whether each mesh becomes a scene, from now on; the first one always does. Returns what was before.
  bool follow(bool is_followed);

  /// The scene of the newest mesh heard of, with the robot at `T_map_base`: waits until it is made. Nothing, and why: no
  /// mesh yet, the map does not answer, cancelled.
  std::shared_ptr<const MapScene> current(const Eigen::Isometry3d& T_map_base,
                                          const std::function<bool()>& is_cancelled, std::string* why_not);

  /// Of the newest mesh heard of; zero: none yet.
  ros::Time meshStamp() const;
  std::string meshTopic() const { return mesh_subscriber_.getTopic(); }

  /// The last one made; null: none yet.
  std::shared_ptr<const MapScene> last() const;
  Counters counters() const;

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
  interactive_mapping_msgs::SurfaceMeshConstPtr mesh_;  // the newest
  std::uint64_t mesh_number_{0};                        // of mesh_, 0: none
  bool is_followed_{false};
  std::uint64_t asked_number_{0};  // a scene was asked for at asked_pose_; counts such requests
  Eigen::Isometry3d asked_pose_{Eigen::Isometry3d::Identity()};
  std::uint64_t done_mesh_number_{0};
  std::uint64_t done_asked_number_{0};
  std::shared_ptr<const MapScene> last_;
  std::uint64_t last_mesh_number_{0};  // that last_ was made from
  Counters counters_;

  ros::Subscriber mesh_subscriber_;
  std::thread worker_;  // last: everything it uses exists before it
};

}  // namespace motion_planning_ros
