// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_ROS_MAP_MESSAGES_H
#define GPIS_MAPPING_ROS_MAP_MESSAGES_H

#include <string>
#include <vector>

#include <Eigen/Core>
#include <interactive_mapping_msgs/GetMesh.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <interactive_mapping_msgs/QueryMap.h>
#include <interactive_mapping_msgs/SurfaceMesh.h>
#include <nav_msgs/OccupancyGrid.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/ColorRGBA.h>
#include <std_msgs/Header.h>
#include <visualization_msgs/Marker.h>
#include <visualization_msgs/MarkerArray.h>

#include "gpis_mapping/gpis_map.h"
#include "gpis_mapping/ground_projection.h"
#include "gpis_mapping/map_snapshot.h"
#include "gpis_mapping/mesh_extractor.h"
#include "gpis_mapping/point_update.h"
#include "gpis_mapping/voxel_states.h"
#include "gpis_mapping_ros/gpis_mapping_params.h"

namespace gpis_mapping_ros {

/// Colour scale of what rviz shows: 0 dark blue to 1 yellow (viridis: even to the eye, and to the colour-blind).
std_msgs::ColorRGBA colorOf(double share);

/// What a request asks for; everything unless its corners differ. Throws std::invalid_argument if they are no box.
Eigen::AlignedBox3d boxOf(const interactive_mapping_msgs::GetMesh::Request& request);

interactive_mapping_msgs::SurfaceMesh toSurfaceMesh(const gpis_mapping::TriangleMesh& mesh,
                                                    const std_msgs::Header& header, std::uint64_t update);

/// One triangle list, coloured per vertex, darker where the surface is not level.
visualization_msgs::Marker toMarker(const gpis_mapping::TriangleMesh& mesh, const std_msgs::Header& header,
                                    MeshColor color, double color_max_std_m);

/// Training points: x y z, normal_x normal_y normal_z, std [m].
sensor_msgs::PointCloud2 toPointCloud(const gpis_mapping::MapSnapshot& snapshot, const std_msgs::Header& header);

/// Vertices: x y z, normal_x normal_y normal_z as in pcl::PointNormal, variance of the field [m^2].
sensor_msgs::PointCloud2 toPointCloud(const gpis_mapping::TriangleMesh& mesh, const std_msgs::Header& header);

/// x y z only.
sensor_msgs::PointCloud2 toPointCloud(const std::vector<Eigen::Vector3d>& points_map, const std_msgs::Header& header);

/// Free 0, occupied 100, unknown -1.
nav_msgs::OccupancyGrid toOccupancyGrid(const gpis_mapping::GroundGrid& grid, const std_msgs::Header& header);

/// A horizontal plane of signed distances over the mapped surface, cell by cell; those without an answer are left out.
struct SliceCells {
  double cell_size_m{0.0};
  gpis_mapping::Points3d centres_map;
  Eigen::VectorXd distance;  // signed [m]
  Eigen::VectorXd std;       // of the field [m]
};

/// The cells grow where more than `max_cells` would be needed.
SliceCells makeSlice(const gpis_mapping::MapSnapshot& snapshot, const GpisMappingParams::Slice& slice,
                     std::size_t max_cells);

/// x y z, distance [m], std of the field [m].
sensor_msgs::PointCloud2 toPointCloud(const SliceCells& slice, const std_msgs::Header& header);

/// As voxblox publishes a slice: x y z, intensity = signed distance [m].
sensor_msgs::PointCloud2 toIntensityCloud(const SliceCells& slice, const std_msgs::Header& header);

/// The same at the centres of the known voxels, as far as the distance reaches (query/max_distance_m).
sensor_msgs::PointCloud2 toIntensityCloud(const gpis_mapping::MapSnapshot& snapshot,
                                          const gpis_mapping::VoxelStates& voxels, const std_msgs::Header& header);

/// A square per cell: blue outside, white on the surface, red inside; full at kSliceColorRange_m.
visualization_msgs::Marker toMarker(const SliceCells& slice, const std_msgs::Header& header);
constexpr double kSliceColorRange_m = 0.25;

/// Triangle lists `seen` (the virtual wall dark), `nearer` and `farther`. None spans a depth edge, kBlanketEdge of the range.
visualization_msgs::MarkerArray toMarkers(const gpis_mapping::FrameBlanket& blanket, const std_msgs::Header& header);
constexpr float kBlanketEdge = 0.1f;

interactive_mapping_msgs::MapUpdate toMapUpdate(const gpis_mapping::UpdateStatistics& statistics,
                                                const std_msgs::Header& header, std::uint64_t update, double wait_ms);

/// Points as columns. Never throws.
gpis_mapping::Points3d toPoints(const std::vector<geometry_msgs::Point>& points);

/// Fills the answer's arrays, those of the variance only if `with_variance`, its gradient only if `result` has it;
/// directions are turned by `R_out_map`.
void fillAnswer(const gpis_mapping::QueryResult& result, const Eigen::Matrix3d& R_out_map, bool with_variance,
                interactive_mapping_msgs::QueryMap::Response* answer);

}  // namespace gpis_mapping_ros

#endif  // GPIS_MAPPING_ROS_MAP_MESSAGES_H
