// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/parallel.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace synthetic_depth {

void forEachInParallel(int count, const std::function<void(int)>& work) {
  std::atomic<int> next{0};
  std::mutex error_mutex;  // guards error
  std::exception_ptr error;
  const auto takeWork = [&] {
    for (int i = next++; i < count; i = next++) {
      try {
        work(i);
      } catch (...) {
        const std::lock_guard<std::mutex> lock(error_mutex);
        error = error ? error : std::current_exception();
        next = count;
      }
    }
  };
  const int num_threads = std::min(count, static_cast<int>(std::thread::hardware_concurrency()));
  std::vector<std::thread> helpers;
  try {
    for (int i = 1; i < num_threads; ++i) helpers.emplace_back(takeWork);
  } catch (const std::system_error&) {
    // No more threads to be had: those that there are do all of it.
  }
  takeWork();
  for (std::thread& helper : helpers) helper.join();
  if (error) std::rethrow_exception(error);
}

}  // namespace synthetic_depth
