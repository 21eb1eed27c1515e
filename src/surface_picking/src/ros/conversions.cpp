// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking_ros/conversions.h"

#include <algorithm>
#include <stdexcept>
#include <string>

#include <brick_detection_ros/conversions.h>

namespace surface_picking_ros {

surface_picking::TriangleMesh toMesh(const interactive_mapping_msgs::SurfaceMesh& message) {
  const std::size_t count = message.mesh.vertices.size();
  if (message.normals.size() != 3 * count || message.variance.size() != count) {
    throw std::invalid_argument("the mesh has " + std::to_string(message.normals.size()) + " numbers in normals and " +
                                std::to_string(message.variance.size()) + " in variance, must be 3 and 1 for each of " +
                                std::to_string(count) + " vertices");
  }
  surface_picking::TriangleMesh mesh;
  mesh.vertices_map.reserve(count);
  mesh.normals_map.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const geometry_msgs::Point& p = message.mesh.vertices[i];
    mesh.vertices_map.emplace_back(p.x, p.y, p.z);
    mesh.normals_map.emplace_back(message.normals[3 * i], message.normals[3 * i + 1], message.normals[3 * i + 2]);
  }
  mesh.variance_m2 = message.variance;
  mesh.triangles.reserve(message.mesh.triangles.size());
  for (const shape_msgs::MeshTriangle& triangle : message.mesh.triangles) {
    const auto& v = triangle.vertex_indices;
    if (v[0] >= count || v[1] >= count || v[2] >= count) {
      throw std::invalid_argument("a triangle of the mesh names a vertex that it does not have: " +
                                  std::to_string(std::max({v[0], v[1], v[2]})) + ", must be below " +
                                  std::to_string(count));
    }
    mesh.triangles.push_back({v[0], v[1], v[2]});
  }
  return mesh;
}

interactive_mapping_msgs::Brick toMessage(const surface_picking::Body& body,
                                          const mp700_ur5e_description::BrickType& type,
                                          const std::vector<brick_detection::FaceAccess>& faces) {
  brick_detection::TrackedBrick brick;
  brick.id = body.id;
  brick.T_map_brick = body.cuboid.T_map_body;
  brick.covariance = body.cuboid.covariance;
  brick.num_looks = body.num_looks;
  brick.first_seen_s = body.first_seen_s;
  brick.last_seen_s = body.last_seen_s;
  for (std::size_t f = 0; f < brick.faces_seen.size(); ++f) brick.faces_seen[f] = body.cuboid.faces[f].patch >= 0;
  return brick_detection_ros::toMessage(brick, type, faces);
}

}  // namespace surface_picking_ros
