// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/map_messages.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <utility>

#include <interactive_mapping_common_ros/markers.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include "gpis_mapping/cell_gp.h"

namespace gpis_mapping_ros {
namespace {

using gpis_mapping::CellGp;
using gpis_mapping::MapSnapshot;
using gpis_mapping::Points3d;
using gpis_mapping::SpaceState;
using gpis_mapping::TriangleMesh;
using gpis_mapping::VoxelStates;
using interactive_mapping_msgs::QueryMap;
using interactive_mapping_ros::toPoint;

constexpr std::size_t kBatch = 1 << 16;  // points asked at once: their answers take some 10 MB

/// Two triangles, counter-clockwise seen from above.
constexpr std::array<std::pair<int, int>, 6> kSquare = {{{-1, -1}, {1, -1}, {1, 1}, {-1, -1}, {1, 1}, {-1, 1}}};

visualization_msgs::Marker triangleList(const std_msgs::Header& header, const std::string& ns) {
  using visualization_msgs::Marker;
  Marker marker = interactive_mapping_ros::makeMarker(header, ns, 0, Marker::TRIANGLE_LIST);
  marker.scale.x = marker.scale.y = marker.scale.z = 1.0;
  marker.color.a = 1.0f;
  return marker;
}

std::vector<geometry_msgs::Vector3> toVectors(const Points3d& vectors, const Eigen::Matrix3d& R_out_map) {
  std::vector<geometry_msgs::Vector3> out(static_cast<std::size_t>(vectors.cols()));
  for (Eigen::Index i = 0; i < vectors.cols(); ++i) {
    const Eigen::Vector3d v = R_out_map * vectors.col(i);
    geometry_msgs::Vector3& to = out[static_cast<std::size_t>(i)];
    to.x = v.x();
    to.y = v.y();
    to.z = v.z();
  }
  return out;
}

std::vector<double> toNumbers(const Eigen::VectorXd& values) {
  return {values.data(), values.data() + values.size()};
}

/// Cloud of float32 fields, one after the other.
class CloudWriter {
 public:
  CloudWriter(const std_msgs::Header& header, const std::vector<std::string>& fields, std::size_t max_count) {
    cloud_.header = header;
    cloud_.height = 1;
    cloud_.is_dense = true;
    cloud_.point_step = static_cast<std::uint32_t>(fields.size() * sizeof(float));
    for (std::size_t i = 0; i < fields.size(); ++i) {
      sensor_msgs::PointField field;
      field.name = fields[i];
      field.offset = static_cast<std::uint32_t>(i * sizeof(float));
      field.datatype = sensor_msgs::PointField::FLOAT32;
      field.count = 1;
      cloud_.fields.push_back(field);
    }
    cloud_.data.resize(cloud_.point_step * max_count);
  }

  void add(std::initializer_list<double> values) {
    for (const double value : values) {
      const auto number = static_cast<float>(value);
      std::copy_n(reinterpret_cast<const std::uint8_t*>(&number), sizeof(number), cloud_.data.begin() + written_);
      written_ += static_cast<std::ptrdiff_t>(sizeof(number));
    }
  }

  /// Of the points that were added.
  sensor_msgs::PointCloud2 take() {
    cloud_.row_step = static_cast<std::uint32_t>(written_);
    cloud_.width = cloud_.row_step / cloud_.point_step;
    cloud_.data.resize(cloud_.row_step);
    return std::move(cloud_);
  }

 private:
  sensor_msgs::PointCloud2 cloud_;
  std::ptrdiff_t written_{0};
};

/// rviz draws a list with colours per corner without light, and edges would drown in them: the light is mixed in here.
/// Level surfaces keep the scale's own colour; the sides of a box differ from its top and from each other.
float lightOn(const Eigen::Vector3f& normal) {
  const float light = 0.62f + 0.38f * normal.z() + 0.14f * normal.x() - 0.07f * normal.y();
  return std::isfinite(light) ? std::min(1.0f, std::max(0.3f, light)) : 1.0f;
}

}  // namespace

std_msgs::ColorRGBA colorOf(double share) {
  // Nine samples of viridis (Smith and van der Walt, matplotlib 1.5).
  static constexpr std::array<std::array<float, 3>, 9> kStops = {{{0.267f, 0.005f, 0.329f},
                                                                  {0.279f, 0.175f, 0.483f},
                                                                  {0.230f, 0.322f, 0.546f},
                                                                  {0.173f, 0.449f, 0.558f},
                                                                  {0.128f, 0.567f, 0.551f},
                                                                  {0.158f, 0.684f, 0.502f},
                                                                  {0.369f, 0.789f, 0.383f},
                                                                  {0.678f, 0.864f, 0.190f},
                                                                  {0.993f, 0.906f, 0.144f}}};
  const double x = std::isfinite(share) ? std::min(1.0, std::max(0.0, share)) * (kStops.size() - 1) : 0.0;
  const std::size_t i = std::min(kStops.size() - 2, static_cast<std::size_t>(x));
  const auto t = static_cast<float>(x - static_cast<double>(i));
  std_msgs::ColorRGBA color;
  color.r = kStops[i][0] + t * (kStops[i + 1][0] - kStops[i][0]);
  color.g = kStops[i][1] + t * (kStops[i + 1][1] - kStops[i][1]);
  color.b = kStops[i][2] + t * (kStops[i + 1][2] - kStops[i][2]);
  color.a = 1.0f;
  return color;
}

Eigen::AlignedBox3d boxOf(const interactive_mapping_msgs::GetMesh::Request& request) {
  const Eigen::Vector3d min{request.min.x, request.min.y, request.min.z};
  const Eigen::Vector3d max{request.max.x, request.max.y, request.max.z};
  if (min == max) return gpis_mapping::kEverywhere;
  if ((min.array() <= max.array()).all()) return {min, max};
  std::ostringstream text;
  text << "the mesh's box = (" << min.transpose() << ") to (" << max.transpose() << ") m, min must not be above max";
  throw std::invalid_argument(text.str());
}

interactive_mapping_msgs::SurfaceMesh toSurfaceMesh(const TriangleMesh& mesh, const std_msgs::Header& header,
                                                    std::uint64_t update) {
  interactive_mapping_msgs::SurfaceMesh message;
  message.header = header;
  message.update = update;
  message.mesh.vertices.reserve(mesh.vertices_map.size());
  for (const Eigen::Vector3d& v : mesh.vertices_map) message.mesh.vertices.push_back(toPoint(v));
  message.mesh.triangles.resize(mesh.triangles.size());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    std::copy(mesh.triangles[i].begin(), mesh.triangles[i].end(), message.mesh.triangles[i].vertex_indices.begin());
  }
  message.normals.reserve(3 * mesh.normals_map.size());
  for (const Eigen::Vector3f& n : mesh.normals_map)
    message.normals.insert(message.normals.end(), n.data(), n.data() + 3);
  message.variance = mesh.variance_m2;
  return message;
}

visualization_msgs::Marker toMarker(const TriangleMesh& mesh, const std_msgs::Header& header, MeshColor color,
                                    double color_max_std_m) {
  visualization_msgs::Marker marker = triangleList(header, "mesh");
  // rviz refuses a triangle list without triangles.
  if (mesh.triangles.empty()) marker.action = visualization_msgs::Marker::DELETE;
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for (const Eigen::Vector3d& v : mesh.vertices_map) {
    low = std::min(low, v.z());
    high = std::max(high, v.z());
  }
  std::vector<std_msgs::ColorRGBA> colors;
  colors.reserve(mesh.vertices_map.size());
  for (std::size_t i = 0; i < mesh.vertices_map.size(); ++i) {
    const double share = color == MeshColor::kHeight ? (mesh.vertices_map[i].z() - low) / std::max(1e-9, high - low)
                                                     : std::sqrt(mesh.variance_m2[i]) / color_max_std_m;
    std_msgs::ColorRGBA corner = colorOf(share);
    const float light = lightOn(mesh.normals_map[i]);
    corner.r *= light;
    corner.g *= light;
    corner.b *= light;
    colors.push_back(corner);
  }
  marker.points.reserve(3 * mesh.triangles.size());
  marker.colors.reserve(3 * mesh.triangles.size());
  for (const std::array<std::uint32_t, 3>& triangle : mesh.triangles) {
    for (const std::uint32_t vertex : triangle) {
      marker.points.push_back(toPoint(mesh.vertices_map[vertex]));
      marker.colors.push_back(colors[vertex]);
    }
  }
  return marker;
}

sensor_msgs::PointCloud2 toPointCloud(const MapSnapshot& snapshot, const std_msgs::Header& header) {
  CloudWriter cloud(header, {"x", "y", "z", "normal_x", "normal_y", "normal_z", "std"}, snapshot.numPoints());
  for (const auto& entry : snapshot.cells()) {
    const CellGp& cell = *entry.second;
    for (std::size_t i = 0; i < cell.numOwn(); ++i) {
      const Eigen::Vector3d p = cell.position(i);
      const Eigen::Vector3f n = cell.normal(i);
      cloud.add({p.x(), p.y(), p.z(), n.x(), n.y(), n.z(), std::sqrt(cell.noiseVariance(i))});
    }
  }
  return cloud.take();
}

sensor_msgs::PointCloud2 toPointCloud(const TriangleMesh& mesh, const std_msgs::Header& header) {
  CloudWriter cloud(header, {"x", "y", "z", "normal_x", "normal_y", "normal_z", "variance"}, mesh.vertices_map.size());
  for (std::size_t i = 0; i < mesh.vertices_map.size(); ++i) {
    const Eigen::Vector3d& p = mesh.vertices_map[i];
    const Eigen::Vector3f& n = mesh.normals_map[i];
    cloud.add({p.x(), p.y(), p.z(), n.x(), n.y(), n.z(), mesh.variance_m2[i]});
  }
  return cloud.take();
}

sensor_msgs::PointCloud2 toPointCloud(const std::vector<Eigen::Vector3d>& points_map, const std_msgs::Header& header) {
  CloudWriter cloud(header, {"x", "y", "z"}, points_map.size());
  for (const Eigen::Vector3d& p : points_map) cloud.add({p.x(), p.y(), p.z()});
  return cloud.take();
}

nav_msgs::OccupancyGrid toOccupancyGrid(const gpis_mapping::GroundGrid& grid, const std_msgs::Header& header) {
  nav_msgs::OccupancyGrid message;
  message.header = header;
  message.info.map_load_time = header.stamp;
  message.info.resolution = static_cast<float>(grid.cell_size_m);
  message.info.width = static_cast<std::uint32_t>(grid.width);
  message.info.height = static_cast<std::uint32_t>(grid.height);
  message.info.origin.position.x = grid.origin_x_m;
  message.info.origin.position.y = grid.origin_y_m;
  // The message knows no tilt: at the height of the ground in the middle.
  message.info.origin.position.z = grid.plane.zAt(grid.origin_x_m + 0.5 * grid.width * grid.cell_size_m,
                                                  grid.origin_y_m + 0.5 * grid.height * grid.cell_size_m);
  message.info.origin.orientation.w = 1.0;
  message.data.reserve(grid.state.size());
  for (const SpaceState state : grid.state) {
    message.data.push_back(state == SpaceState::kOccupied ? 100 : state == SpaceState::kFree ? 0 : -1);
  }
  return message;
}

SliceCells makeSlice(const MapSnapshot& snapshot, const GpisMappingParams::Slice& slice, std::size_t max_cells) {
  Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Vector2d high = -low;
  for (const auto& entry : snapshot.cells()) {
    const Eigen::AlignedBox3d box = snapshot.config().cells.box(entry.first);
    low = low.cwiseMin(box.min().head<2>());
    high = high.cwiseMax(box.max().head<2>());
  }
  SliceCells cells;
  cells.cell_size_m = slice.cell_size_m;
  if (snapshot.cells().empty()) return cells;
  low.array() -= slice.margin_m;
  high.array() += slice.margin_m;
  const Eigen::Vector2d extent = high - low;
  const double step = std::max(slice.cell_size_m, std::sqrt(extent.prod() / static_cast<double>(max_cells)));
  const auto columns = static_cast<Eigen::Index>(std::ceil(extent.x() / step));
  const auto rows = static_cast<Eigen::Index>(std::ceil(extent.y() / step));
  Points3d points(3, columns * rows);
  for (Eigen::Index row = 0; row < rows; ++row) {
    for (Eigen::Index column = 0; column < columns; ++column) {
      points.col(row * columns + column) << low.x() + (static_cast<double>(column) + 0.5) * step,
          low.y() + (static_cast<double>(row) + 0.5) * step, slice.height_m;
    }
  }
  const gpis_mapping::QueryResult answers = snapshot.query(points);
  Eigen::Index count = 0;
  for (Eigen::Index i = 0; i < points.cols(); ++i) count += std::isfinite(answers.distance[i]) ? 1 : 0;
  cells.cell_size_m = step;
  cells.centres_map.resize(3, count);
  cells.distance.resize(count);
  cells.std.resize(count);
  for (Eigen::Index i = 0, k = 0; i < points.cols(); ++i) {
    if (!std::isfinite(answers.distance[i])) continue;
    cells.centres_map.col(k) = points.col(i);
    cells.distance[k] = answers.distance[i];
    cells.std[k] = std::sqrt(answers.variance[i]);
    ++k;
  }
  return cells;
}

sensor_msgs::PointCloud2 toPointCloud(const SliceCells& slice, const std_msgs::Header& header) {
  CloudWriter cloud(header, {"x", "y", "z", "distance", "std"}, static_cast<std::size_t>(slice.distance.size()));
  for (Eigen::Index i = 0; i < slice.distance.size(); ++i) {
    const Eigen::Vector3d p = slice.centres_map.col(i);
    cloud.add({p.x(), p.y(), p.z(), slice.distance[i], slice.std[i]});
  }
  return cloud.take();
}

sensor_msgs::PointCloud2 toIntensityCloud(const SliceCells& slice, const std_msgs::Header& header) {
  CloudWriter cloud(header, {"x", "y", "z", "intensity"}, static_cast<std::size_t>(slice.distance.size()));
  for (Eigen::Index i = 0; i < slice.distance.size(); ++i) {
    const Eigen::Vector3d p = slice.centres_map.col(i);
    cloud.add({p.x(), p.y(), p.z(), slice.distance[i]});
  }
  return cloud.take();
}

sensor_msgs::PointCloud2 toIntensityCloud(const MapSnapshot& snapshot, const VoxelStates& voxels,
                                          const std_msgs::Header& header) {
  CloudWriter cloud(header, {"x", "y", "z", "intensity"}, voxels.occupied.size() + voxels.free.size());
  gpis_mapping::QueryOptions options;
  options.variance = false;
  for (const auto* keys : {&voxels.occupied, &voxels.free}) {
    for (std::size_t begin = 0; begin < keys->size(); begin += kBatch) {
      const std::size_t count = std::min(kBatch, keys->size() - begin);
      Points3d centres(3, static_cast<Eigen::Index>(count));
      for (std::size_t i = 0; i < count; ++i) {
        centres.col(static_cast<Eigen::Index>(i)) = (*keys)[begin + i].center(voxels.size_m);
      }
      const gpis_mapping::QueryResult answers = snapshot.query(centres, options);
      for (Eigen::Index i = 0; i < centres.cols(); ++i) {
        const Eigen::Vector3d p = centres.col(i);
        if (std::isfinite(answers.distance[i])) cloud.add({p.x(), p.y(), p.z(), answers.distance[i]});
      }
    }
  }
  return cloud.take();
}

visualization_msgs::Marker toMarker(const SliceCells& slice, const std_msgs::Header& header) {
  visualization_msgs::Marker marker = triangleList(header, "slice");
  if (slice.distance.size() == 0) marker.action = visualization_msgs::Marker::DELETE;
  const Eigen::Vector3f inside(0.70f, 0.09f, 0.17f);  // ends of ColorBrewer's RdBu
  const Eigen::Vector3f outside(0.13f, 0.40f, 0.67f);
  for (Eigen::Index i = 0; i < slice.distance.size(); ++i) {
    const auto share = static_cast<float>(std::min(1.0, std::abs(slice.distance[i]) / kSliceColorRange_m));
    const Eigen::Vector3f rgb =
        (1.0f - share) * Eigen::Vector3f::Ones() + share * (slice.distance[i] < 0.0 ? inside : outside);
    std_msgs::ColorRGBA color;
    color.r = rgb.x();
    color.g = rgb.y();
    color.b = rgb.z();
    color.a = 1.0f;
    marker.colors.insert(marker.colors.end(), 6, color);
    for (const auto& [dx, dy] : kSquare) {
      marker.points.push_back(toPoint(slice.centres_map.col(i) + 0.5 * slice.cell_size_m * Eigen::Vector3d(dx, dy, 0)));
    }
  }
  return marker;
}

visualization_msgs::MarkerArray toMarkers(const gpis_mapping::FrameBlanket& blanket, const std_msgs::Header& header) {
  using Knot = gpis_mapping::FrameBlanket::Knot;
  const Eigen::Vector3f eye_map = blanket.camera_map.cast<float>();
  const auto isSheet = [&](const Knot& a, const Knot& b) {
    const float range_a = (a.seen - eye_map).norm(), range_b = (b.seen - eye_map).norm();
    return std::abs(range_a - range_b) <= kBlanketEdge * std::min(range_a, range_b);  // false for NaN
  };
  struct Layer {
    const char* name;
    const Eigen::Vector3f Knot::*place;
    std::array<float, 3> color;
    float alpha;  // 1 throughout: rviz draws a list with one transparent corner after and over all others
  };
  static constexpr std::array<float, 3> kWallColor{0.25f, 0.25f, 0.3f};
  static const std::array<Layer, 3> kLayers{{{"seen", &Knot::seen, {0.85f, 0.85f, 0.85f}, 1.0f},
                                             {"nearer", &Knot::nearer, {0.95f, 0.6f, 0.1f}, 0.35f},
                                             {"farther", &Knot::farther, {0.2f, 0.45f, 0.9f}, 0.35f}}};
  const auto columns = static_cast<std::size_t>(blanket.columns);
  visualization_msgs::MarkerArray markers;
  for (const Layer& layer : kLayers) {
    visualization_msgs::Marker marker = triangleList(header, layer.name);
    const auto add = [&](const Knot& a, const Knot& b, const Knot& c) {
      if (!isSheet(a, b) || !isSheet(b, c) || !isSheet(c, a)) return;
      const Eigen::Vector3f normal = (b.seen - a.seen).cross(c.seen - a.seen).normalized();
      const float light = lightOn(normal.dot(eye_map - a.seen) < 0.0f ? -normal : normal);
      for (const Knot* knot : {&a, &b, &c}) {
        const auto& [red, green, blue] = knot->is_wall ? kWallColor : layer.color;
        marker.points.push_back(toPoint((knot->*layer.place).cast<double>()));
        marker.colors.emplace_back();
        marker.colors.back().r = light * red;
        marker.colors.back().g = light * green;
        marker.colors.back().b = light * blue;
        marker.colors.back().a = layer.alpha;
      }
    };
    for (std::size_t i = columns; i < blanket.knots.size(); ++i) {
      if (i % columns == 0) continue;
      const Knot &here = blanket.knots[i], &left = blanket.knots[i - 1];
      const Knot &above = blanket.knots[i - columns], &corner = blanket.knots[i - columns - 1];
      add(corner, left, here);
      add(corner, here, above);
    }
    if (marker.points.empty()) marker.action = visualization_msgs::Marker::DELETE;
    markers.markers.push_back(std::move(marker));
  }
  return markers;
}

interactive_mapping_msgs::MapUpdate toMapUpdate(const gpis_mapping::UpdateStatistics& statistics,
                                                const std_msgs::Header& header, std::uint64_t update, double wait_ms) {
  interactive_mapping_msgs::MapUpdate message;
  message.header = header;
  message.status = interactive_mapping_msgs::MapUpdate::ACCEPTED;
  message.update = update;
  message.view_min = interactive_mapping_ros::toPoint(statistics.view_box_map.min());
  message.view_max = interactive_mapping_ros::toPoint(statistics.view_box_map.max());
  message.points_in = static_cast<std::uint32_t>(statistics.points_in);
  message.inserted = static_cast<std::uint32_t>(statistics.inserted);
  message.fused = static_cast<std::uint32_t>(statistics.fused);
  message.deleted = static_cast<std::uint32_t>(statistics.deleted);
  message.occluded = static_cast<std::uint32_t>(statistics.occluded);
  message.map_points = static_cast<std::uint32_t>(statistics.map_points);
  message.cells_retrained = static_cast<std::uint32_t>(statistics.cells_retrained);
  message.total_ms = static_cast<float>(statistics.total_ms);
  message.classify_ms = static_cast<float>(statistics.classify_ms);
  message.regress_ms = static_cast<float>(statistics.regress_ms);
  message.fuse_ms = static_cast<float>(statistics.fuse_ms);
  message.observe_ms = static_cast<float>(statistics.observe_ms);
  message.insert_ms = static_cast<float>(statistics.insert_ms);
  message.train_ms = static_cast<float>(statistics.train_ms);
  message.publish_ms = static_cast<float>(statistics.publish_ms);
  message.wait_ms = static_cast<float>(wait_ms);
  return message;
}

Points3d toPoints(const std::vector<geometry_msgs::Point>& points) {
  Points3d out(3, static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) {
    out.col(static_cast<Eigen::Index>(i)) << points[i].x, points[i].y, points[i].z;
  }
  return out;
}

void fillAnswer(const gpis_mapping::QueryResult& result, const Eigen::Matrix3d& R_out_map, bool with_variance,
                QueryMap::Response* answer) {
  answer->distance = toNumbers(result.distance);
  answer->gradient = toVectors(result.gradient, R_out_map);
  answer->state.clear();
  for (const SpaceState state : result.state) answer->state.push_back(static_cast<std::uint8_t>(state));
  answer->euclidean_distance = toNumbers(result.euclidean_distance);
  answer->euclidean_gradient = toVectors(result.euclidean_gradient, R_out_map);
  answer->surface_std = toNumbers(result.surface_std);
  if (!with_variance) return;
  answer->variance = toNumbers(result.variance);
  answer->occupancy = toNumbers(result.occupancy);
  answer->variance_gradient = toVectors(result.variance_gradient, R_out_map);  // none if it was not asked for
}

}  // namespace gpis_mapping_ros
