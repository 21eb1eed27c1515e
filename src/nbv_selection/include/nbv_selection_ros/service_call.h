// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>

#include <ros/service_client.h>

namespace nbv_selection_ros {

enum class CallEnd { kAnswered, kFailed, kTimedOut, kCancelled };

/// Calls a service and waits at most `timeout_s`. roscpp's own call cannot be given up, so it is made in a thread that
/// outlives this function if it must. Wall time.
template <typename Service>
CallEnd callWithin(ros::ServiceClient client, Service* service, double timeout_s,
                   const std::function<bool()>& is_cancelled) {
  struct Shared {
    std::mutex mutex;
    std::condition_variable changed;
    bool is_done{false};
    bool is_answered{false};
    Service service;
  };
  constexpr std::chrono::milliseconds kCancelPeriod(10);  // how soon it is noticed
  const auto shared = std::make_shared<Shared>();
  shared->service.request = service->request;
  std::thread([shared, client]() mutable {
    const bool is_answered = client.call(shared->service);
    {
      const std::lock_guard<std::mutex> lock(shared->mutex);
      shared->is_done = true;
      shared->is_answered = is_answered;
    }
    shared->changed.notify_all();
  }).detach();
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout_s);
  std::unique_lock<std::mutex> lock(shared->mutex);
  while (!shared->is_done) {
    if (is_cancelled && is_cancelled()) return CallEnd::kCancelled;
    if (std::chrono::steady_clock::now() >= deadline) return CallEnd::kTimedOut;
    shared->changed.wait_for(lock, kCancelPeriod);
  }
  if (!shared->is_answered) return CallEnd::kFailed;
  service->response = std::move(shared->service.response);
  return CallEnd::kAnswered;
}

}  // namespace nbv_selection_ros
