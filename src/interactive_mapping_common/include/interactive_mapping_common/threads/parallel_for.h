// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <thread>

#include <interactive_mapping_common/threads/thread_pool.h>

namespace interactive_mapping {

/// Number of workers for a setting where 0 means "all cores".
inline int resolveThreadCount(int requested) {
  return requested > 0 ? requested : std::max(1u, std::thread::hardware_concurrency());
}

/// Calls fn(begin, end) on disjoint chunks of [0, count) from up to num_threads threads; rethrows the first exception.
/// Where threads cannot be started the calling one does it all. Own threads rather than OpenMP's: ThreadSanitizer
/// understands them.
/// fn must write to its own indices only.
template <typename Function>
void parallelFor(std::size_t count, int num_threads, std::size_t chunk, const Function& fn) {
  chunk = std::max<std::size_t>(1, chunk);
  const std::size_t num_chunks = (count + chunk - 1) / chunk;
  const std::size_t workers = std::min<std::size_t>(static_cast<std::size_t>(std::max(1, num_threads)), num_chunks);
  if (workers <= 1) {
    if (count > 0) fn(std::size_t{0}, count);
    return;
  }
  std::atomic<std::size_t> next{0};
  std::exception_ptr error;
  std::mutex error_mutex;  // guards error
  const auto work = [&] {
    for (std::size_t i = next.fetch_add(1); i < num_chunks; i = next.fetch_add(1)) {
      try {
        fn(i * chunk, std::min(count, (i + 1) * chunk));
      } catch (...) {
        const std::lock_guard<std::mutex> lock(error_mutex);
        if (!error) error = std::current_exception();
        next.store(num_chunks);
      }
    }
  };
  ThreadPool::shared().run(workers - 1, work);
  if (error) std::rethrow_exception(error);
}

}  // namespace interactive_mapping
