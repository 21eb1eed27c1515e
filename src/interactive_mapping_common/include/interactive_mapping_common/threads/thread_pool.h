// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace interactive_mapping {

/// Threads that are started when they are first needed and kept, for work that is shared out again and again. Any number
/// of threads may run work at once, also from within work.
class ThreadPool {
 public:
  using Start = std::function<std::thread(std::function<void()>)>;

  /// The one that parallelFor() uses.
  static ThreadPool& shared();

  /// Keeps at most `max_threads`. `start` starts one, and throws if it cannot.
  explicit ThreadPool(
      std::size_t max_threads, Start start = [](std::function<void()> loop) { return std::thread(std::move(loop)); });
  /// Not while work runs.
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  /// Calls `work` on this thread and on up to `helpers` others at the same time; returns when all have come back. How many
  /// helpers come is not promised: none where no thread can be started. `work` must do all that is left to do,
  /// however many threads take part, and must not throw.
  void run(std::size_t helpers, const std::function<void()>& work);

  std::size_t numThreads() const;

 private:
  struct Job {
    const std::function<void()>* work;
    std::size_t wanted;      // helpers that have not come yet
    std::size_t running{0};  // helpers at work
    std::condition_variable is_over{};
  };

  void loop();

  const std::size_t max_threads_;
  const Start start_;
  mutable std::mutex mutex_;  // guards all below
  std::condition_variable wake_;
  std::deque<Job*> jobs_;  // with helpers wanted
  std::vector<std::thread> threads_;
  std::size_t num_busy_{0};
  std::size_t num_wanted_{0};  // by all jobs
  bool is_ending_{false};
};

}  // namespace interactive_mapping
