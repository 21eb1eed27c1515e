// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <diagnostic_updater/diagnostic_updater.h>
#include <image_transport/image_transport.h>
#include <interactive_mapping_msgs/AttachedBrick.h>
#include <interactive_mapping_msgs/BrickArray.h>
#include <interactive_mapping_msgs/BrickDetectionUpdate.h>
#include <ros/node_handle.h>
#include <ros/service_server.h>
#include <ros/wall_timer.h>
#include <std_srvs/Trigger.h>

#include "brick_detection/brick_detector.h"
#include "brick_detection_ros/brick_detection_params.h"
#include "brick_detection_ros/brick_markers.h"
#include "brick_detection_ros/detect_server.h"
#include "brick_detection_ros/image_input.h"
#include "brick_detection_ros/map_client.h"

namespace brick_detection_ros {

/// Bricks as a ROS node: images in; bricks, markers, pictures, services and diagnostics out. The README lists them.
/// Callbacks may run concurrently. ImageInput's thread works on images, MapClient's asks the map. Calls of ~detect wait
/// in threads of their own, so nothing else waits for them. Long: each topic, service and diagnostic is a few lines,
/// and the work is in the core.
class BrickDetectionRos {
 public:
  /// Throws std::invalid_argument listing every impossible parameter, or what is wrong with the bricks' file.
  BrickDetectionRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  ~BrickDetectionRos();
  BrickDetectionRos(const BrickDetectionRos&) = delete;
  BrickDetectionRos& operator=(const BrickDetectionRos&) = delete;

 private:
  using Update = interactive_mapping_msgs::BrickDetectionUpdate;
  using BrickArray = interactive_mapping_msgs::BrickArray;

  struct LookTimes {
    ros::WallTime done;
    bool is_accepted;
    double total_ms;
    double latency_s;  // from the image's stamp to the end of its work, ROS time
  };

  bool wants(const ros::Time& stamp);
  void consume(const InputFrame& frame);
  void refuse(const ros::Time& stamp, const Refusal& refusal, bool is_restart);
  /// Last of an image's work: publishes the update and wakes those who wait.
  void conclude(DetectLook record);
  void publishPicture(const InputFrame& frame, const brick_detection::BrickPoseEstimator::Result& found);

  void onAttached(const interactive_mapping_msgs::AttachedBrickConstPtr& message);
  /// Where the tool's brick was in the map when it was taken; nothing if tf does not know.
  std::optional<Eigen::Vector3d> placeOf(const interactive_mapping_msgs::AttachedBrick& message) const;
  bool onClear(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  void onMapAnswer(const MapClient::MapQuestion& question, const std::vector<brick_detection::SpaceState>& states,
                   const ros::Time& map_stamp);

  /// The next four with detector_mutex_ held.
  void publishBricks();
  void noteDropped(const std::vector<int>& ids, const std::string& why);
  void forget(const ros::Time& stamp);
  interactive_mapping_msgs::Brick toBrick(std::size_t index) const;

  void diagnoseInput(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseTransforms(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseBricks(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseMap(diagnostic_updater::DiagnosticStatusWrapper& status);

  const BrickDetectionParams params_;

  mutable std::mutex detector_mutex_;  // guards what follows, up to the blank line; held while an image is taken in
  brick_detection::BrickDetector detector_;
  BrickMarkers markers_;
  ros::Time stamp_;           // of the newest image in it
  std::vector<int> dropped_;  // since the last update
  std::string last_drop_;
  std::string depth_contradiction_;  // in the last look; empty: none
  std::uint64_t num_looks_{0};
  std::optional<int> attached_id_;
  ros::Publisher bricks_publisher_, marker_publisher_;

  mutable std::mutex report_mutex_;  // guards recent_
  std::deque<LookTimes> recent_;

  ros::Publisher update_publisher_;
  image_transport::ImageTransport transport_;
  image_transport::Publisher picture_publisher_;
  ros::Subscriber attached_subscriber_;
  ros::ServiceServer clear_server_;
  diagnostic_updater::Updater diagnostics_;
  ros::WallTimer diagnostics_timer_;
  std::unique_ptr<MapClient> map_;
  std::unique_ptr<DetectServer> detect_;
  std::unique_ptr<ImageInput> input_;  // last: its thread uses the rest
};

}  // namespace brick_detection_ros
