// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <thread>
#include <vector>

#include <ros/callback_queue.h>

namespace interactive_mapping_ros {

/// Serves the callbacks of a queue from several threads, as ros::AsyncSpinner does. There a thread that finds only a callback
/// which must not run twice at once, and runs in another thread, tries again and again without a pause: a whole core, for as
/// long as the callback takes.
class Spinner {
 public:
  /// Throws std::invalid_argument unless `num_threads` is positive. `queue` outlives the spinner.
  Spinner(int num_threads, ros::CallbackQueue* queue);
  Spinner(const Spinner&) = delete;
  Spinner& operator=(const Spinner&) = delete;
  ~Spinner();

  /// Returns when the callbacks that run have ended. Not for one of them to call.
  void stop();

 private:
  void spin();

  ros::CallbackQueue* queue_;
  std::atomic<bool> is_stopping_{false};
  std::vector<std::thread> threads_;
};

}  // namespace interactive_mapping_ros
