// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking_ros/map_surface.h"

#include <stdexcept>
#include <utility>

#include <interactive_mapping_common_ros/markers.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_msgs/GetMesh.h>
#include <interactive_mapping_msgs/QueryMap.h>

namespace surface_picking_ros {

using interactive_mapping_msgs::GetMesh;
using interactive_mapping_msgs::QueryMap;
using surface_picking::SpaceState;

MapSurface::MapSurface(const ros::NodeHandle& nh, const std::string& map_frame) : nh_(nh), map_frame_(map_frame) {}

template <typename Service>
void MapSurface::call(ros::ServiceClient* kept, const std::string& name, Service* service) {
  ros::ServiceClient client;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (is_stopping_) throw std::runtime_error("the node is ending");
    if (!kept->isValid()) *kept = nh_.serviceClient<Service>(name, true);
    client = *kept;
  }
  if (client.isValid() && client.call(*service)) return;
  const bool is_there = client.isValid();
  const std::lock_guard<std::mutex> lock(mutex_);
  *kept = ros::ServiceClient();  // what is left of the connection is in no known state
  throw std::runtime_error((is_there ? "call failed of service " : "no service ") + nh_.resolveName(name));
}

interactive_mapping_msgs::SurfaceMesh MapSurface::mesh(const Eigen::AlignedBox3d& box_map) {
  GetMesh service;
  service.request.min = interactive_mapping_ros::toPoint(box_map.min());
  service.request.max = interactive_mapping_ros::toPoint(box_map.max());
  call(&mesh_client_, "map/get_mesh", &service);
  interactive_mapping_msgs::SurfaceMesh& mesh = service.response.mesh;
  if (!mesh.mesh.vertices.empty() && interactive_mapping_ros::withoutSlash(mesh.header.frame_id) != map_frame_) {
    throw std::runtime_error("the mesh comes in frame '" + mesh.header.frame_id + "', must be '" + map_frame_ + "'");
  }
  return std::move(mesh);
}

std::vector<SpaceState> MapSurface::states(const Eigen::Matrix3Xd& points_map) {
  QueryMap service;
  service.request.frame_id = map_frame_;
  service.request.points.resize(static_cast<std::size_t>(points_map.cols()));
  for (Eigen::Index i = 0; i < points_map.cols(); ++i) {
    geometry_msgs::Point& point = service.request.points[static_cast<std::size_t>(i)];
    point.x = points_map(0, i);
    point.y = points_map(1, i);
    point.z = points_map(2, i);
  }
  call(&query_client_, "map/query", &service);
  const auto& states = service.response.state;
  if (service.response.success == 0 || states.size() != service.request.points.size()) {
    throw std::runtime_error(nh_.resolveName("map/query") + " gave " + std::to_string(states.size()) + " answers to " +
                             std::to_string(points_map.cols()) + " points: " + service.response.message);
  }
  std::vector<SpaceState> result;
  result.reserve(states.size());
  for (const std::uint8_t state : states) {
    result.push_back(state == QueryMap::Response::FREE       ? SpaceState::kFree
                     : state == QueryMap::Response::OCCUPIED ? SpaceState::kOccupied
                                                             : SpaceState::kUnknown);
  }
  return result;
}

void MapSurface::stop() {
  const std::lock_guard<std::mutex> lock(mutex_);
  is_stopping_ = true;
  mesh_client_.shutdown();
  query_client_.shutdown();
}

}  // namespace surface_picking_ros
