// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline_ros/octomap_baseline_ros.h"

#include <algorithm>
#include <filesystem>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <utility>

#include <ros/console.h>

#include <interactive_mapping_common/files/atomic_file.h>
#include "gpis_mapping_ros/gpis_mapping_params.h"
#include "gpis_mapping_ros/map_messages.h"
#include "gpis_mapping_ros/query_service.h"
#include "octomap_baseline/tree_projection.h"
#include "octomap_baseline/voxel_surface.h"
#include "octomap_baseline_ros/octomap_messages.h"

namespace octomap_baseline_ros {
namespace {

using depth_camera_ros::FrameStatus;
using depth_camera_ros::Refusal;
using gpis_mapping_ros::DepthInput;
using gpis_mapping_ros::DepthInputFrame;
using interactive_mapping_msgs::MapUpdate;

constexpr char kLog[] = "octomap_baseline";
constexpr double kWarnPeriod_s = 5.0;  // a message in a callback is repeated no more often

Eigen::Vector3d toVector(const geometry_msgs::Point& point) {
  return {point.x, point.y, point.z};
}

}  // namespace

template <typename Message, typename Convert>
void OctomapBaselineRos::addOutput(ros::NodeHandle* nh, const std::string& topic, Convert convert) {
  const auto publish = [convert](ros::Publisher* publisher, const octomap::OcTree& tree,
                                 const std_msgs::Header& header) {
    publisher->publish(boost::make_shared<const Message>(convert(tree, header)));
  };
  outputs_.push_back({nh->advertise<Message>(topic, 1, true), publish});
}

OctomapBaselineRos::OctomapBaselineRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : params_(loadOctomapBaselineParams(private_nh)), map_(params_.map) {
  ROS_INFO_STREAM_NAMED(kLog, "map configuration:\n" << octomap_baseline::toYaml(params_.map));
  ros::NodeHandle public_nh(nh);
  ros::NodeHandle pnh(private_nh);
  addOutput<octomap_msgs::Octomap>(&public_nh, "octomap_binary", toBinaryMessage);
  addOutput<octomap_msgs::Octomap>(&public_nh, "octomap_full", toFullMessage);
  for (const bool occupied : {true, false}) {
    addOutput<visualization_msgs::MarkerArray>(
        &public_nh, occupied ? "occupied_cells_vis_array" : "free_cells_vis_array",
        [occupied](const auto& tree, const auto& header) { return toMarkers(tree, occupied, header); });
  }
  addOutput<sensor_msgs::PointCloud2>(&public_nh, "octomap_point_cloud_centers", toPointCloud);
  addOutput<nav_msgs::OccupancyGrid>(
      &public_nh, "projected_map", [output = params_.output](const auto& tree, const auto& header) {
        return gpis_mapping_ros::toOccupancyGrid(
            octomap_baseline::projectDown(tree, output.projected_min_z_m, output.projected_max_z_m,
                                          output.filter_speckles),
            header);
      });
  addOutput<interactive_mapping_msgs::SurfaceMesh>(&pnh, "mesh", [this](const auto& tree, const auto& header) {
    return toMessage(tree, gpis_mapping::kEverywhere, header);
  });
  outputs_.back().period_s = params_.output.mesh_period_s;
  update_publisher_ = pnh.advertise<MapUpdate>("update", 50);

  input_ = std::make_unique<DepthInput>(
      nh, private_nh, params_.input, [this](const DepthInputFrame& frame) { return consume(frame); },
      [this](const ros::Time& stamp, const Refusal& refusal) { refuse(stamp, refusal); });

  query_server_ = pnh.advertiseService("query", &OctomapBaselineRos::onQuery, this);
  mesh_server_ = pnh.advertiseService("get_mesh", &OctomapBaselineRos::onGetMesh, this);
  binary_server_ = public_nh.advertiseService("octomap_binary", &OctomapBaselineRos::onGetBinary, this);
  full_server_ = public_nh.advertiseService("octomap_full", &OctomapBaselineRos::onGetFull, this);
  clear_box_server_ = pnh.advertiseService("clear_bbx", &OctomapBaselineRos::onClearBox, this);
  reset_server_ = pnh.advertiseService("reset", &OctomapBaselineRos::onReset, this);
  save_server_ = pnh.advertiseService("save", &OctomapBaselineRos::onSave, this);
  output_timer_ = pnh.createWallTimer(ros::WallDuration(1.0 / params_.output.rate_hz),
                                      [this](const ros::WallTimerEvent&) { publishOutputs(); });
  ROS_INFO_NAMED(kLog, "mapping %s with %s in frame '%s'", input_->imageTopic().c_str(), input_->infoTopic().c_str(),
                 params_.input.map_frame.c_str());
}

OctomapBaselineRos::~OctomapBaselineRos() {
  // Each of these waits for its callback in progress; then nobody uses the input any more.
  output_timer_.stop();
  for (ros::ServiceServer* server : {&query_server_, &mesh_server_, &binary_server_, &full_server_, &clear_box_server_,
                                     &reset_server_, &save_server_}) {
    server->shutdown();
  }
  input_.reset();
}

std_msgs::Header OctomapBaselineRos::headerAt(const ros::Time& stamp) const {
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = params_.input.map_frame;
  return header;
}

Refusal OctomapBaselineRos::consume(const DepthInputFrame& frame) {
  MapUpdate message;
  {
    const std::lock_guard<std::shared_mutex> lock(map_mutex_);
    try {
      const auto statistics = map_.update(frame.image, frame.camera, frame.T_map_camera, frame.stamp.toSec());
      message = toMapUpdate(statistics, headerAt(frame.stamp), map_.numUpdates(), frame.wait_ms);
    } catch (const std::exception& error) {
      return {FrameStatus::kRefusedByMap, error.what()};
    }
    stamp_ = frame.stamp;
    ++revision_;
  }
  ROS_DEBUG_NAMED(kLog, "update %lu: %.1f ms, %u voxels, +%u -%u", static_cast<unsigned long>(message.update),
                  message.total_ms, message.map_points, message.inserted, message.deleted);
  if (params_.output.every_image) publishOutputs();
  // Last: whoever waits for it finds the services' answers up to date.
  update_publisher_.publish(message);
  return {};
}

void OctomapBaselineRos::refuse(const ros::Time& stamp, const Refusal& refusal) {
  ROS_WARN_STREAM_THROTTLE_NAMED(kWarnPeriod_s, kLog,
                                 "image rejected, " << toString(refusal.status) << ": " << refusal.message);
  MapUpdate message;
  message.header = headerAt(stamp);
  message.status = static_cast<std::uint8_t>(refusal.status);
  message.message = refusal.message;
  {
    const std::shared_lock<std::shared_mutex> lock(map_mutex_);
    message.update = map_.numUpdates();
    message.map_points = static_cast<std::uint32_t>(map_.numOccupied());
  }
  update_publisher_.publish(message);
}

void OctomapBaselineRos::publishOutputs() {
  const std::lock_guard<std::mutex> output_lock(output_mutex_);
  const auto wants = [this](const Output& output) {
    if (output.published_revision == revision_ || output.publisher.getNumSubscribers() == 0) return false;
    const double age_s = (stamp_ - output.published).toSec();
    return age_s < 0.0 || age_s >= output.period_s;
  };
  const std::shared_lock<std::shared_mutex> lock(map_mutex_);
  for (Output& output : outputs_) {
    if (!wants(output)) continue;
    output.publish(&output.publisher, map_.tree(), headerAt(stamp_));
    output.published_revision = revision_;
    output.published = stamp_;
  }
}

interactive_mapping_msgs::SurfaceMesh OctomapBaselineRos::toMessage(const octomap::OcTree& tree,
                                                                    const Eigen::AlignedBox3d& box_map,
                                                                    const std_msgs::Header& header) const {
  return gpis_mapping_ros::toSurfaceMesh(octomap_baseline::meshOfSides(tree, params_.output.filter_speckles, box_map),
                                         header, map_.numUpdates());
}

bool OctomapBaselineRos::onGetMesh(interactive_mapping_msgs::GetMesh::Request& request,
                                   interactive_mapping_msgs::GetMesh::Response& response) {
  const std::shared_lock<std::shared_mutex> lock(map_mutex_);
  response.revision = first_revision_ + revision_;
  if (request.revision != response.revision) {
    response.mesh = toMessage(map_.tree(), gpis_mapping_ros::boxOf(request), headerAt(stamp_));
  } else {
    response.mesh.header = headerAt(stamp_);
    response.mesh.update = map_.numUpdates();
  }
  return true;
}

bool OctomapBaselineRos::onQuery(interactive_mapping_msgs::QueryMap::Request& request,
                                 interactive_mapping_msgs::QueryMap::Response& response) {
  const std::shared_lock<std::shared_mutex> lock(map_mutex_);
  const auto map = [this] {
    return gpis_mapping_ros::QueriedMap{
        stamp_, map_.numUpdates(), map_.numOccupied() == 0, std::numeric_limits<double>::quiet_NaN(),
        [this](const gpis_mapping::Points3d& points, const gpis_mapping::QueryOptions& options) {
          return octomap_baseline::querySides(map_.tree(), params_.output.filter_speckles, points, options);
        }};
  };
  gpis_mapping_ros::answerQuery(request, params_.input.map_frame, input_->tfBuffer(), map, &response);
  return true;
}

bool OctomapBaselineRos::onGetBinary(octomap_msgs::GetOctomap::Request&, octomap_msgs::GetOctomap::Response& response) {
  const std::shared_lock<std::shared_mutex> lock(map_mutex_);
  response.map = toBinaryMessage(map_.tree(), headerAt(stamp_));
  return true;
}

bool OctomapBaselineRos::onGetFull(octomap_msgs::GetOctomap::Request&, octomap_msgs::GetOctomap::Response& response) {
  const std::shared_lock<std::shared_mutex> lock(map_mutex_);
  response.map = toFullMessage(map_.tree(), headerAt(stamp_));
  return true;
}

bool OctomapBaselineRos::onClearBox(octomap_msgs::BoundingBoxQuery::Request& request,
                                    octomap_msgs::BoundingBoxQuery::Response&) {
  try {
    const std::lock_guard<std::shared_mutex> lock(map_mutex_);
    const std::size_t freed = map_.clearBox(toVector(request.min), toVector(request.max));
    ++revision_;
    ROS_INFO_NAMED(kLog, "cleared a box: %zu occupied voxels are free now", freed);
    return true;
  } catch (const std::invalid_argument& error) {
    ROS_ERROR_NAMED(kLog, "clear_bbx: %s", error.what());
    return false;  // the service's response has no other way to say so
  }
}

bool OctomapBaselineRos::onReset(std_srvs::Empty::Request&, std_srvs::Empty::Response&) {
  {
    const std::lock_guard<std::shared_mutex> lock(map_mutex_);
    map_.clear();
    ++revision_;
  }
  {
    const std::lock_guard<std::mutex> lock(output_mutex_);
    for (Output& output : outputs_) output.published = ros::Time();  // an empty map is due at once
  }
  input_->resetPoseGuard();
  ROS_INFO_NAMED(kLog, "map cleared");
  return true;
}

bool OctomapBaselineRos::onSave(interactive_mapping_msgs::SaveMap::Request& request,
                                interactive_mapping_msgs::SaveMap::Response& response) {
  response.path = request.path;
  try {
    interactive_mapping::requireUsablePath(request.path);
    const std::string extension = std::filesystem::path(request.path).extension();
    if (extension != ".bt" && extension != ".ot") {
      throw std::invalid_argument("'" + request.path + "', must end in .bt (free and occupied) or .ot (log odds)");
    }
    std::ostringstream stream;
    {
      const std::shared_lock<std::shared_mutex> lock(map_mutex_);
      const bool is_good = extension == ".bt" ? map_.tree().writeBinaryConst(stream) : map_.tree().write(stream);
      if (!is_good) throw std::runtime_error("the octree could not be written");
      response.num_points = map_.numOccupied();
    }
    interactive_mapping::AtomicFile file(request.path);
    file.write(stream.str());
    file.commit();
    response.success = true;
    ROS_INFO_NAMED(kLog, "saved %lu occupied voxels to %s", static_cast<unsigned long>(response.num_points),
                   request.path.c_str());
  } catch (const std::exception& error) {
    response.num_points = 0;
    response.message = error.what();
    ROS_ERROR_NAMED(kLog, "map not saved: %s", error.what());
  }
  return true;
}

}  // namespace octomap_baseline_ros
