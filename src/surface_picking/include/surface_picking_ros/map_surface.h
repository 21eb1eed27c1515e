// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mutex>
#include <string>
#include <vector>

#include <interactive_mapping_msgs/SurfaceMesh.h>
#include <ros/node_handle.h>
#include <ros/service_client.h>

#include "surface_picking/cuboids.h"

namespace surface_picking_ros {

/// The map's services `map/get_mesh` and `map/query`, over connections that stay. mesh() and states() are for one thread;
/// stop() is for any, and ends a call that hangs.
class MapSurface {
 public:
  MapSurface(const ros::NodeHandle& nh, const std::string& map_frame);

  /// The mapped surface, at least what lies in the box. Throws std::runtime_error that says what failed: no service, no
  /// answer, another frame.
  interactive_mapping_msgs::SurfaceMesh mesh(const Eigen::AlignedBox3d& box_map);

  /// Free, occupied or unknown at points [m, map frame]. Throws std::runtime_error as mesh().
  std::vector<surface_picking::SpaceState> states(const Eigen::Matrix3Xd& points_map);

  void stop();

 private:
  template <typename Service>
  void call(ros::ServiceClient* kept, const std::string& name, Service* service);

  ros::NodeHandle nh_;
  const std::string map_frame_;
  std::mutex mutex_;  // guards what follows
  ros::ServiceClient mesh_client_, query_client_;
  bool is_stopping_{false};
};

}  // namespace surface_picking_ros
