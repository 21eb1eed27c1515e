// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_ROS_GPIS_MAPPING_ROS_H
#define GPIS_MAPPING_ROS_GPIS_MAPPING_ROS_H

#include <deque>
#include <memory>
#include <mutex>
#include <string>

#include <diagnostic_updater/diagnostic_updater.h>
#include <interactive_mapping_common_ros/live_params.h>
#include <interactive_mapping_msgs/AttachedBrick.h>
#include <interactive_mapping_msgs/ClearBox.h>
#include <interactive_mapping_msgs/GetMesh.h>
#include <interactive_mapping_msgs/LoadMap.h>
#include <interactive_mapping_msgs/QueryMap.h>
#include <interactive_mapping_msgs/SaveMap.h>
#include <octomap_msgs/GetOctomap.h>
#include <ros/node_handle.h>
#include <ros/service_server.h>
#include <ros/subscriber.h>
#include <ros/wall_timer.h>
#include <std_srvs/Trigger.h>

#include "gpis_mapping/gpis_map.h"
#include "gpis_mapping_ros/depth_input.h"
#include "gpis_mapping_ros/gpis_mapping_params.h"
#include "gpis_mapping_ros/map_publisher.h"

namespace gpis_mapping_ros {

/// The map as a ROS node: depth images of one or several cameras in; mesh, points, ground, slice, statistics, services and
/// diagnostics out. The README lists them. Callbacks may run concurrently: give it node handles whose queue has several
/// threads, so that a query does not wait for a save. Updates run on the thread of each camera's DepthInput, one at a
/// time, displays on MapPublisher's.
/// Long: each topic, service and diagnostic is a few lines, and the work is in the core.
class GpisMappingRos {
 public:
  /// Throws std::invalid_argument listing every impossible parameter.
  GpisMappingRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  /// Saves a last time, when there is an autosave file and something has changed.
  ~GpisMappingRos();
  GpisMappingRos(const GpisMappingRos&) = delete;
  GpisMappingRos& operator=(const GpisMappingRos&) = delete;

 private:
  using MapUpdate = interactive_mapping_msgs::MapUpdate;

  struct FrameTimes {
    std::size_t camera;
    ros::WallTime done;
    bool is_accepted;
    double update_ms;
    double latency_s;  // from the image's stamp to the end of its update, ROS time
  };

  Refusal consume(std::size_t camera, const DepthInputFrame& frame);
  void refuse(std::size_t camera, const ros::Time& stamp, const Refusal& refusal);
  void noteFrame(std::size_t camera, bool is_accepted, double update_ms, double latency_s);

  bool onQuery(interactive_mapping_msgs::QueryMap::Request& request,
               interactive_mapping_msgs::QueryMap::Response& response);
  bool onGetMesh(interactive_mapping_msgs::GetMesh::Request& request,
                 interactive_mapping_msgs::GetMesh::Response& response);
  bool onGetOctomap(bool binary, octomap_msgs::GetOctomap::Response* response);
  bool onSave(interactive_mapping_msgs::SaveMap::Request& request,
              interactive_mapping_msgs::SaveMap::Response& response);
  bool onLoad(interactive_mapping_msgs::LoadMap::Request& request,
              interactive_mapping_msgs::LoadMap::Response& response);
  bool onClear(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool onClearBox(interactive_mapping_msgs::ClearBox::Request& request,
                  interactive_mapping_msgs::ClearBox::Response& response);

  void onAttached(const interactive_mapping_msgs::AttachedBrickConstPtr& message);
  /// Clears the place of a brick that was taken, as soon as tf knows where that was. Call with map_mutex_ held.
  void clearAttached();
  /// T_map_box of a pose in any frame. Throws std::invalid_argument and what tf throws.
  Eigen::Isometry3d boxInMap(const std_msgs::Header& header, const geometry_msgs::Pose& pose) const;

  /// Throws for what the map cannot use with its present points.
  void onTune(const GpisMappingParamsWithMap& params);
  void onAutosave();

  MapState state() const;
  /// Publishes the map's present snapshot as the state. Call with map_mutex_ held.
  void takeState(const ros::Time& stamp, bool is_new_map, const std::vector<Eigen::Vector3d>& removed,
                 std::shared_ptr<const gpis_mapping::FrameBlanket> blanket = nullptr);
  /// Writes the map to `path`; returns its number of points. Throws gpis_mapping::MapFileError.
  std::size_t save(const std::string& path);
  /// Replaces the map by the file's. Returns what the caller should know, or nothing. Throws MapFileError and
  /// std::invalid_argument; the map is as it was then.
  std::string load(const std::string& path, std::size_t* num_points);
  void restore();
  const tf2_ros::Buffer& tfBuffer() const { return inputs_.front()->tfBuffer(); }
  void resetPoseGuards();

  void diagnoseInput(std::size_t camera, diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseTransforms(std::size_t camera, diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseMap(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseStorage(diagnostic_updater::DiagnosticStatusWrapper& status);

  const GpisMappingParams params_;

  mutable std::mutex map_mutex_;  // guards what follows, up to the blank line: held while an image is taken in
  std::unique_ptr<gpis_mapping::GpisMap> map_;
  interactive_mapping_msgs::AttachedBrickConstPtr taken_;  // a brick whose place is still to be cleared
  gpis_mapping::GpisConfig tuned_;                         // the map's configuration as tuned

  mutable std::mutex state_mutex_;  // guards state_
  MapState state_;

  std::mutex file_mutex_;  // one save or load at a time

  mutable std::mutex report_mutex_;  // guards what follows, up to the blank line
  std::deque<FrameTimes> recent_;
  std::uint64_t saved_revision_{0};
  ros::WallTime saved_at_;
  std::string save_error_;

  ros::Publisher update_publisher_;
  MapPublisher publisher_;
  ros::ServiceServer query_server_, mesh_server_, full_server_, binary_server_, save_server_, load_server_,
      clear_server_, clear_box_server_;
  ros::Subscriber attached_subscriber_;
  diagnostic_updater::Updater diagnostics_;
  ros::WallTimer diagnostics_timer_, autosave_timer_;
  std::vector<std::unique_ptr<DepthInput>> inputs_;  // of each camera; their threads use what is above
  std::unique_ptr<interactive_mapping_ros::LiveParams<GpisMappingParamsWithMap>> live_;
};

}  // namespace gpis_mapping_ros

#endif  // GPIS_MAPPING_ROS_GPIS_MAPPING_ROS_H
