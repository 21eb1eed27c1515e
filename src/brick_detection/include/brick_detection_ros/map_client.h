// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <interactive_mapping_msgs/MapUpdate.h>
#include <interactive_mapping_msgs/QueryMap.h>
#include <ros/node_handle.h>
#include <ros/service_client.h>
#include <ros/time.h>

#include "brick_detection/brick_detector.h"

namespace brick_detection_ros {

/// Asks the map about the bricks: after each of its updates (`map_update`), and when woken, by the service
/// `map/query`. On a thread of its own, one question at a time: a map that hangs keeps only this thread waiting. The
/// next question connects again to a map that was lost.
class MapClient {
 public:
  using MapQuestion = brick_detection::BrickDetector::MapQuestion;
  struct Callbacks {
    std::function<MapQuestion()> ask;
    std::function<void(const MapQuestion& question, const std::vector<brick_detection::SpaceState>& states,
                       const ros::Time& map_stamp)>
        answer;
    std::function<void()> lost;  ///< the map that has answered does so no more
  };
  struct Counters {
    std::uint64_t updates{0};  // of the map
    std::uint64_t questions{0};
    std::uint64_t answers{0};
    ros::WallTime asked_since;  // first question since the last answer; zero: none is open
    std::string last_failure;   // empty since the last answer
  };

  /// `map_frame`: of the questions. Both callbacks run on this client's thread.
  MapClient(const ros::NodeHandle& nh, const std::string& map_frame, Callbacks callbacks);
  ~MapClient();
  MapClient(const MapClient&) = delete;
  MapClient& operator=(const MapClient&) = delete;

  /// There is something to ask.
  void wake();
  Counters counters() const;
  std::string service() const { return service_; }

 private:
  void work();
  void ask();
  void fail(const std::string& why);

  ros::NodeHandle nh_;
  const std::string map_frame_;
  const Callbacks callbacks_;
  const std::string service_;

  mutable std::mutex mutex_;  // guards what follows, up to the blank line
  std::condition_variable changed_;
  bool is_stopping_{false};
  bool has_ended_{false};
  bool has_news_{false};
  ros::ServiceClient client_;
  ros::WallTime next_try_;
  Counters counters_;

  ros::Subscriber update_subscriber_;
  std::thread worker_;  // last: everything it uses exists before it
};

}  // namespace brick_detection_ros
