// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_ROS_MAP_PUBLISHER_H
#define GPIS_MAPPING_ROS_MAP_PUBLISHER_H

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <Eigen/Core>
#include <geometry_msgs/Pose.h>
#include <interactive_mapping_msgs/GetMesh.h>
#include <interactive_markers/interactive_marker_server.h>
#include <octomap_msgs/Octomap.h>
#include <octomap_msgs/OctomapWithPose.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>

#include "gpis_mapping/map_snapshot.h"
#include "gpis_mapping/mesh_extractor.h"
#include "gpis_mapping/point_update.h"
#include "gpis_mapping_ros/gpis_mapping_params.h"

namespace gpis_mapping_ros {

/// The map after an update, as all readers see it.
struct MapState {
  std::shared_ptr<const gpis_mapping::MapSnapshot> snapshot;
  // Of the last image; null: nobody asked, or it was no image.
  std::shared_ptr<const gpis_mapping::FrameBlanket> blanket;
  ros::Time stamp;              // of the last image in it
  std::uint64_t generation{0};  // rises when the map is replaced: cleared, loaded
  std::uint64_t revision{0};    // rises with every change
};

/// Publishes the map for rviz, planners and other maps. It does so from a thread of its own, at a bounded rate and only
/// for subscribers. The README lists the topics. A new subscriber gets the current state at once. With `every_image`
/// nothing is left out: setState() returns when its state has been published; outputs made of the mesh may keep a
/// period. All methods may be called from any thread. Long: one output after the other, all under one lock and of one
/// state.
class MapPublisher {
 public:
  MapPublisher(const ros::NodeHandle& private_nh, const GpisMappingParams& params);
  ~MapPublisher();
  MapPublisher(const MapPublisher&) = delete;
  MapPublisher& operator=(const MapPublisher&) = delete;

  /// `removed_points_map`: what the update deleted.
  void setState(const MapState& state, const std::vector<Eigen::Vector3d>& removed_points_map);
  /// Whether somebody subscribes to `~frame_map`, for which a state needs its `blanket`.
  bool wantsBlanket() const;
  void setOutput(const GpisMappingParams::Output& output);
  void setSliceHeight(double height_m);
  /// Called, from a callback thread, when somebody drags the slice in rviz.
  void onSliceDragged(std::function<void(double height_m)> callback);

  /// The surface of the newest state within the request's box. Extracts what changed since the last call; throws if that
  /// fails.
  void getMesh(const interactive_mapping_msgs::GetMesh::Request& request,
               interactive_mapping_msgs::GetMesh::Response* response);

  /// The map as voxels of `octomap/resolution_m`, made at the call; throws if that fails.
  octomap_msgs::Octomap getOctomap(bool binary) const;

  /// Why the last try to publish failed, with the topic; empty when it did not.
  std::string lastError() const;
  /// How many messages were made of each output so far, those of which there are any; by topic.
  std::map<std::string, std::uint64_t> numMade() const;

 private:
  using SteadyTime = std::chrono::steady_clock::time_point;

  /// What a round of publishing shows, and what several outputs are made of, computed when the first one needs it.
  struct Shown;

  struct Output {
    std::string topic;
    std::function<void(const ros::Publisher&, Shown*)> publish;
    bool is_of_mesh{false};  // keeps output/mesh_period_s
    ros::Publisher publisher;
    bool is_stale{true};  // its subscribers have not seen the state yet
    std::uint64_t num_made{0};
  };

  /// `make` turns what is shown into a Message. Call before the worker runs.
  template <typename Message, typename Make>
  void addOutput(ros::NodeHandle* nh, const std::string& topic, bool is_of_mesh, Make make);
  void work();
  /// Returns why an output could not be made; empty: all were.
  std::string publish();
  /// Outputs to publish now; then they count as published. Call with mutex_ held.
  std::vector<Output*> takeWanted();
  /// Call with mutex_ held.
  void markStale(const std::vector<std::string>& topics);
  /// Call with mutex_ held.
  bool removedHaveExpired(const ros::Time& now);
  void placeSliceHandle(const MapState& state, double height_m);
  std_msgs::Header headerOf(const MapState& state) const;
  /// Call with mesh_mutex_ held; valid as long.
  gpis_mapping::MeshExtractor& extractorOf(const MapState& state);
  const gpis_mapping::TriangleMesh& surfaceOf(const MapState& state);

  std::string map_frame_;
  gpis_mapping::GroundOptions ground_options_;
  double octomap_resolution_m_;
  const std::uint64_t first_revision_{ros::WallTime::now().toNSec()};  // no two runs of a node have the same

  mutable std::mutex mutex_;  // guards what follows, up to the blank line
  std::condition_variable changed_;
  bool is_stopping_{false};
  bool has_news_{false};
  std::uint64_t num_states_{0};
  std::uint64_t num_states_published_{0};
  MapState state_;
  ros::Time mesh_stamp_;  // of the last state whose mesh was due
  GpisMappingParams::Output output_;
  GpisMappingParams::Slice slice_;
  std::deque<std::pair<ros::Time, std::vector<Eigen::Vector3d>>> removed_;  // with the time they were removed
  std::function<void(double)> on_slice_dragged_;
  std::string last_error_;
  std::deque<Output> outputs_;

  std::mutex mesh_mutex_;  // guards what follows, up to the blank line
  std::unique_ptr<gpis_mapping::MeshExtractor> extractor_;
  std::uint64_t extractor_generation_{0};
  gpis_mapping::TriangleMesh surface_;
  std::uint64_t surface_revision_{0};  // 0: none

  // Of the worker alone.
  bool has_handle_{false};
  double handle_height_m_{0.0};
  geometry_msgs::Pose handle_pose_;  // as inserted

  interactive_markers::InteractiveMarkerServer slice_handle_;
  std::thread worker_;
};

}  // namespace gpis_mapping_ros

#endif  // GPIS_MAPPING_ROS_MAP_PUBLISHER_H
