// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common_ros/spinner.h"

#include <chrono>
#include <stdexcept>
#include <string>

namespace interactive_mapping_ros {
namespace {

const ros::WallDuration kWait(0.1);               // for a callback; as long may stop() take
constexpr std::chrono::microseconds kPause(200);  // far less than the period of any message

}  // namespace

Spinner::Spinner(int num_threads, ros::CallbackQueue* queue) : queue_(queue) {
  if (num_threads < 1)
    throw std::invalid_argument(std::to_string(num_threads) + " spinner threads, must be at least 1");
  for (int i = 0; i < num_threads; ++i) threads_.emplace_back(&Spinner::spin, this);
}

Spinner::~Spinner() {
  stop();
}

void Spinner::stop() {
  is_stopping_ = true;
  for (std::thread& thread : threads_) {
    if (thread.joinable()) thread.join();
  }
}

void Spinner::spin() {
  while (!is_stopping_) {
    const ros::CallbackQueue::CallOneResult result = queue_->callOne(kWait);
    if (result == ros::CallbackQueue::TryAgain) std::this_thread::sleep_for(kPause);
    if (result == ros::CallbackQueue::Disabled) return;
  }
}

}  // namespace interactive_mapping_ros
