// SPDX-License-Identifier: BSD-3-Clause
#ifndef OCTOMAP_BASELINE_ROS_OCTOMAP_BASELINE_ROS_H
#define OCTOMAP_BASELINE_ROS_OCTOMAP_BASELINE_ROS_H

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <vector>

#include <interactive_mapping_msgs/GetMesh.h>
#include <interactive_mapping_msgs/QueryMap.h>
#include <interactive_mapping_msgs/SaveMap.h>
#include <octomap_msgs/BoundingBoxQuery.h>
#include <octomap_msgs/GetOctomap.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <ros/service_server.h>
#include <ros/wall_timer.h>
#include <std_msgs/Header.h>
#include <std_srvs/Empty.h>

#include "gpis_mapping_ros/depth_input.h"
#include "octomap_baseline/dynamic_octomap.h"
#include "octomap_baseline_ros/octomap_baseline_params.h"

namespace octomap_baseline_ros {

/// The map as a ROS node: depth images in, what octomap_server publishes out. The README lists topics and services.
/// Callbacks may run concurrently. Updates run on DepthInput's thread.
class OctomapBaselineRos {
 public:
  /// Throws std::invalid_argument listing every impossible parameter.
  OctomapBaselineRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  ~OctomapBaselineRos();
  OctomapBaselineRos(const OctomapBaselineRos&) = delete;
  OctomapBaselineRos& operator=(const OctomapBaselineRos&) = delete;

 private:
  /// A latched topic whose message is made when somebody listens and the map has changed.
  struct Output {
    ros::Publisher publisher;
    std::function<void(ros::Publisher*, const octomap::OcTree&, const std_msgs::Header&)> publish;
    double period_s{0.0};  // between two messages, at least, by the stamps of the images
    std::uint64_t published_revision{0};
    ros::Time published{};
  };

  template <typename Message, typename Convert>
  void addOutput(ros::NodeHandle* nh, const std::string& topic, Convert convert);

  depth_camera_ros::Refusal consume(const gpis_mapping_ros::DepthInputFrame& frame);
  void refuse(const ros::Time& stamp, const depth_camera_ros::Refusal& refusal);
  void publishOutputs();
  std_msgs::Header headerAt(const ros::Time& stamp) const;

  /// The caller holds map_mutex_.
  interactive_mapping_msgs::SurfaceMesh toMessage(const octomap::OcTree& tree, const Eigen::AlignedBox3d& box_map,
                                                  const std_msgs::Header& header) const;

  bool onQuery(interactive_mapping_msgs::QueryMap::Request& request,
               interactive_mapping_msgs::QueryMap::Response& response);
  bool onGetMesh(interactive_mapping_msgs::GetMesh::Request& request,
                 interactive_mapping_msgs::GetMesh::Response& response);
  bool onGetBinary(octomap_msgs::GetOctomap::Request& request, octomap_msgs::GetOctomap::Response& response);
  bool onGetFull(octomap_msgs::GetOctomap::Request& request, octomap_msgs::GetOctomap::Response& response);
  bool onClearBox(octomap_msgs::BoundingBoxQuery::Request& request, octomap_msgs::BoundingBoxQuery::Response& response);
  bool onReset(std_srvs::Empty::Request& request, std_srvs::Empty::Response& response);
  bool onSave(interactive_mapping_msgs::SaveMap::Request& request,
              interactive_mapping_msgs::SaveMap::Response& response);

  const OctomapBaselineParams params_;
  const std::uint64_t first_revision_{ros::WallTime::now().toNSec()};  // no two runs of a node have the same

  // Guards what follows, up to the blank line. A copy of the tree per image would cost more than all else: readers wait.
  mutable std::shared_mutex map_mutex_;
  octomap_baseline::DynamicOctomap map_;
  ros::Time stamp_;            // of the last image
  std::uint64_t revision_{1};  // rises with every change

  std::mutex output_mutex_;  // guards outputs_: a slow conversion may outlast the timer's period
  std::vector<Output> outputs_;
  ros::Publisher update_publisher_;
  ros::ServiceServer query_server_, mesh_server_, binary_server_, full_server_, clear_box_server_, reset_server_,
      save_server_;
  ros::WallTimer output_timer_;
  std::unique_ptr<gpis_mapping_ros::DepthInput> input_;  // last: its thread uses the rest
};

}  // namespace octomap_baseline_ros

#endif  // OCTOMAP_BASELINE_ROS_OCTOMAP_BASELINE_ROS_H
