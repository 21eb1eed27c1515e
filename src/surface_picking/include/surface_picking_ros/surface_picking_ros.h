// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <brick_detection_ros/brick_markers.h>
#include <brick_detection_ros/detect_server.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <interactive_mapping_msgs/AttachedBrick.h>
#include <interactive_mapping_msgs/BrickArray.h>
#include <interactive_mapping_msgs/BrickDetectionUpdate.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <mp700_ur5e_description/brick_types.h>
#include <ros/node_handle.h>
#include <ros/service_server.h>
#include <ros/wall_timer.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include "surface_picking/bodies.h"
#include "surface_picking/patches.h"
#include "surface_picking_ros/map_surface.h"
#include "surface_picking_ros/patch_markers.h"
#include "surface_picking_ros/surface_picking_params.h"

namespace surface_picking_ros {

/// Bodies on the map's surface as a ROS node, with the topics and services of brick_detection. The README lists them.
/// Callbacks may run concurrently. After each update of the map a thread asks for the mesh, finds bodies in it and
/// publishes them. Calls of ~detect wait in threads of their own, so nothing else waits for them.
class SurfacePickingRos {
 public:
  /// Throws std::invalid_argument listing every impossible parameter, or what is wrong with the bricks' file.
  SurfacePickingRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  ~SurfacePickingRos();
  SurfacePickingRos(const SurfacePickingRos&) = delete;
  SurfacePickingRos& operator=(const SurfacePickingRos&) = delete;

 private:
  using Update = interactive_mapping_msgs::BrickDetectionUpdate;
  using BrickArray = interactive_mapping_msgs::BrickArray;
  using MapUpdate = interactive_mapping_msgs::MapUpdate;

  struct Counters {
    std::uint64_t updates{0};  // of the map
    std::uint64_t looks{0};
    std::uint64_t failures{0};
    ros::WallTime last_update;  // zero: none yet
    std::string last_failure;   // empty since the last look without one
    double last_ms{0.0};
    surface_picking::PatchStatistics patches;
    surface_picking::CuboidStatistics cuboids;
  };

  void onMapUpdate(const MapUpdate::ConstPtr& update);
  void onAttached(const interactive_mapping_msgs::AttachedBrickConstPtr& message);
  bool onClear(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);

  /// Where the brick in the hand is now, if tf tells.
  std::optional<Eigen::Vector3d> placeOf(const interactive_mapping_msgs::AttachedBrick& attached) const;

  void work();
  /// Looks for what is in the view [map frame].
  void look(const MapUpdate& update, const Eigen::AlignedBox3d& view_map, brick_detection_ros::DetectLook* done);
  /// Of all bodies, or of those at `indices`; the worker's.
  std::vector<interactive_mapping_msgs::Brick> toBricks(const std::vector<surface_picking::Body>& bodies,
                                                        const std::vector<std::size_t>& indices);
  /// With bodies_mutex_ held.
  void publishBricks();
  void diagnoseMap(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseBodies(diagnostic_updater::DiagnosticStatusWrapper& status);

  const SurfacePickingParams params_;
  const mp700_ur5e_description::BrickCatalogue catalogue_;
  MapSurface map_;
  tf2_ros::Buffer tf_buffer_;
  const tf2_ros::TransformListener tf_listener_{tf_buffer_};
  const ros::NodeHandle private_nh_;
  int kept_next_id_{0};  // the worker's: in kNextIdParam

  mutable std::mutex bodies_mutex_;  // guards what follows, up to the blank line
  surface_picking::BodyTracker tracker_;
  BrickArray bricks_;         // as last published
  std::vector<int> dropped_;  // since the last update
  brick_detection_ros::BrickMarkers markers_;
  std::optional<interactive_mapping_msgs::AttachedBrick> attached_;
  ros::Publisher bricks_publisher_, marker_publisher_;

  mutable std::mutex look_mutex_;  // guards what follows, up to the blank line
  std::condition_variable work_come_;
  bool is_stopping_{false};
  std::optional<MapUpdate> news_;
  Eigen::AlignedBox3d view_;  // of the map's updates since the last look
  Counters counters_;

  PatchMarkers patch_markers_;  // the worker's
  ros::Publisher update_publisher_, patch_publisher_;
  ros::Subscriber map_subscriber_, attached_subscriber_;
  brick_detection_ros::DetectServer detect_;
  ros::ServiceServer clear_server_;
  diagnostic_updater::Updater diagnostics_;
  ros::WallTimer diagnostics_timer_;
  std::thread worker_;
};

}  // namespace surface_picking_ros
