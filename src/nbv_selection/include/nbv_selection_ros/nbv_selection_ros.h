// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <base_navigation_ros/ground_input.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <interactive_mapping_common_ros/worker_action_server.h>
#include <interactive_mapping_msgs/ReportFailure.h>
#include <interactive_mapping_msgs/SelectNextBestViewAction.h>
#include <map_msgs/OccupancyGridUpdate.h>
#include <nav_msgs/OccupancyGrid.h>
#include <pluginlib/class_loader.hpp>
#include <ros/node_handle.h>
#include <ros/wall_timer.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include "nbv_selection_ros/nbv_selection_params.h"
#include "nbv_selection_ros/selection_markers.h"
#include "nbv_selection_ros/strategy.h"

namespace nbv_selection_ros {

/// Where to go next, as a ROS node: the README lists topics, services and parameters. Selections run one at a time on a
/// thread of their own; services and topics come on the caller's.
/// Long: the node's inputs, services and action use the same scene and its lock.
class NbvSelectionRos {
 public:
  /// Throws std::invalid_argument listing every impossible parameter, or what is wrong with a file, the URDF or a plugin.
  NbvSelectionRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  ~NbvSelectionRos();
  NbvSelectionRos(const NbvSelectionRos&) = delete;
  NbvSelectionRos& operator=(const NbvSelectionRos&) = delete;

 private:
  using Server = interactive_mapping_ros::WorkerActionServer<interactive_mapping_msgs::SelectNextBestViewAction>;
  using IsCancelled = std::function<bool()>;

  /// A request that cannot be chosen for, with its reason.
  struct Refused {
    std::uint8_t status;
    std::string message;
  };
  struct Loaded {
    std::string name;
    pluginlib::UniquePtr<Strategy> strategy;
  };

  Server::Result select(const Server::Goal& goal, const ros::Time& started, const IsCancelled& is_cancelled,
                        const std::function<void(const Server::Feedback&)>& tell);
  /// The next three throw Refused.
  Loaded& strategyOf(const std::string& name);
  base_navigation::Pose2d whereTheRobotIs();
  nbv_selection::SelectionRequest makeRequest(const Server::Goal& goal);
  void note(const std::string& strategy, const interactive_mapping_msgs::SelectionOutcome& outcome, double wall_ms);

  void onGrid(const nav_msgs::OccupancyGridConstPtr& message);
  void onGridUpdate(const map_msgs::OccupancyGridUpdateConstPtr& message);
  void enterGrid(const base_navigation_ros::GroundInput::Grid& grid, const ros::Time& stamp, std::string problem);
  bool isTooOld(double grid_age_s) const;
  bool onFailure(interactive_mapping_msgs::ReportFailure::Request& request,
                 interactive_mapping_msgs::ReportFailure::Response& response);
  bool onForget(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  /// Returns how many, in a sentence.
  std::string forgetFailures();
  void diagnoseInputs(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseSelections(diagnostic_updater::DiagnosticStatusWrapper& status);

  const NbvSelectionParams params_;
  nbv_selection::RobotBody robot_;
  tf2_ros::Buffer tf_;
  std::optional<tf2_ros::TransformListener> tf_listener_;
  pluginlib::ClassLoader<Strategy> loader_;
  std::vector<Loaded> strategies_;
  SelectionMarkers markers_;
  ros::Publisher selection_publisher_, failure_publisher_;
  base_navigation_ros::GroundInput ground_;  // of the subscribers' thread
  double last_request_s_{0.0};               // of the thread that selects, ROS time

  mutable std::mutex mutex_;  // guards what follows, up to the blank line
  std::shared_ptr<const base_navigation::NavigationGrid> grid_;
  ros::Time grid_stamp_;
  std::string grid_problem_;
  nbv_selection::FailureMemory failures_;
  std::uint64_t num_failures_{0};
  std::map<std::string, std::uint64_t> outcomes_;  // how often each
  std::string last_outcome_;
  double last_ms_{0.0};
  std::uint64_t num_selections_{0};

  ros::Subscriber grid_subscriber_, grid_update_subscriber_;
  ros::ServiceServer failure_server_, forget_server_;
  diagnostic_updater::Updater diagnostics_;
  ros::WallTimer diagnostics_timer_;
  std::unique_ptr<Server> server_;  // last: its thread uses the rest
};

}  // namespace nbv_selection_ros
