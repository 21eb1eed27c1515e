// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common/threads/thread_pool.h>

#include <algorithm>
#include <exception>
#include <utility>

namespace interactive_mapping {

ThreadPool& ThreadPool::shared() {
  static ThreadPool pool(256);
  return pool;
}

ThreadPool::ThreadPool(std::size_t max_threads, Start start) : max_threads_(max_threads), start_(std::move(start)) {}

ThreadPool::~ThreadPool() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    is_ending_ = true;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

std::size_t ThreadPool::numThreads() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return threads_.size();
}

void ThreadPool::run(std::size_t helpers, const std::function<void()>& work) {
  Job job{&work, helpers};
  if (helpers > 0) {
    const std::lock_guard<std::mutex> lock(mutex_);
    jobs_.push_back(&job);
    num_wanted_ += helpers;
    while (threads_.size() < std::min(max_threads_, num_busy_ + num_wanted_)) {
      try {
        threads_.reserve(threads_.size() + 1);
        threads_.push_back(start_([this] { loop(); }));
      } catch (const std::exception&) {  // too many in the system: those there are, and this one, do it
        break;
      }
    }
  }
  for (std::size_t i = 0; i < helpers; ++i) wake_.notify_one();
  work();
  if (helpers == 0) return;
  std::unique_lock<std::mutex> lock(mutex_);
  if (job.wanted > 0) {  // nothing is left for those who have not come
    num_wanted_ -= job.wanted;
    jobs_.erase(std::find(jobs_.begin(), jobs_.end(), &job));
  }
  job.is_over.wait(lock, [&job] { return job.running == 0; });
}

void ThreadPool::loop() {
  std::unique_lock<std::mutex> lock(mutex_);
  for (;;) {
    wake_.wait(lock, [this] { return is_ending_ || !jobs_.empty(); });
    if (is_ending_) return;
    Job& job = *jobs_.front();
    if (--job.wanted == 0) jobs_.pop_front();
    --num_wanted_;
    ++job.running;
    ++num_busy_;
    lock.unlock();
    (*job.work)();
    lock.lock();
    --num_busy_;
    if (--job.running == 0) job.is_over.notify_one();
  }
}

}  // namespace interactive_mapping
