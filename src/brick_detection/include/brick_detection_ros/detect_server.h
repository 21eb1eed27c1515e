// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <limits>
#include <memory>
#include <mutex>
#include <set>
#include <string>

#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_msgs/BrickArray.h>
#include <interactive_mapping_msgs/BrickDetectionUpdate.h>
#include <interactive_mapping_msgs/DetectBricks.h>
#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/service_server.h>
#include <ros/spinner.h>

namespace brick_detection_ros {

struct DetectParams {
  double timeout_s{5.0};
  double clock_stall_s{3.0};

  static void fields(DetectParams& c, interactive_mapping::Fields& f) {
    f("timeout_s", c.timeout_s, 0.01, 600.0, "s", "time limit of a call of ~detect that names none, ROS time");
    f("clock_stall_s", c.clock_stall_s, 0.1, 600.0, "s",
      "a clock that does not advance for longer ends a call, wall time");
  }
};

/// What became of an image or of an update of the map, for the calls that wait for it.
struct DetectLook {
  interactive_mapping_msgs::BrickDetectionUpdate update;
  interactive_mapping_msgs::BrickArray bricks;  ///< those seen in it
};

/// The service ~detect. Each call waits for a look that is newer than the call, in a thread of its own. Thread-safe.
class DetectServer {
 public:
  /// What the answers say of the node's input.
  struct Input {
    std::string map_frame;
    std::string what;                                              ///< it looks at: "image"
    std::string topic;                                             ///< where that comes from
    double max_future_s{std::numeric_limits<double>::infinity()};  ///< a look whose stamp is farther ahead is no answer
  };

  /// Offers the service at once.
  DetectServer(const ros::NodeHandle& private_nh, const DetectParams& params, const Input& input);
  ~DetectServer();
  DetectServer(const DetectServer&) = delete;
  DetectServer& operator=(const DetectServer&) = delete;

  /// Ends the waiting calls and the service, and waits for both.
  void stop();

  /// Whether a call waits that something of this stamp may answer; a zero stamp: whether any call waits.
  bool wants(const ros::Time& stamp) const;
  std::size_t numWaiting() const;

  /// A look is done. `update.look` must be larger than that of each look begun before.
  void conclude(DetectLook look);

 private:
  using Request = interactive_mapping_msgs::DetectBricks::Request;
  using Response = interactive_mapping_msgs::DetectBricks::Response;

  bool onDetect(Request& request, Response& response);
  /// Waits with the lock of mutex_ held, and returns when the response is complete.
  void await(const ros::Time& called, double timeout_s, std::unique_lock<std::mutex>* lock, Response* response);
  /// No look came; `why` says until when.
  void answerNone(const std::shared_ptr<const DetectLook>& refused_before, const std::string& why, Response* response);

  const DetectParams params_;
  const Input input_;

  mutable std::mutex mutex_;  // guards what follows, up to the blank line
  std::condition_variable look_done_;
  bool is_stopping_{false};
  std::multiset<ros::Time> waiting_since_;  // one for each call that waits
  std::shared_ptr<const DetectLook> last_accepted_, last_refused_;

  ros::CallbackQueue queue_;
  ros::AsyncSpinner spinner_;
  ros::ServiceServer server_;
};

}  // namespace brick_detection_ros
