// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common/threads/thread_pool.h>

#include <atomic>
#include <chrono>
#include <system_error>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace interactive_mapping {
namespace {

/// Work that comes back only when `count` threads are in it.
std::function<void()> meeting(std::atomic<int>* arrived, int count) {
  return [arrived, count] {
    ++*arrived;
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (*arrived < count && std::chrono::steady_clock::now() < deadline) std::this_thread::yield();
  };
}

TEST(ThreadPool, KeepsItsThreadsFromCallToCall) {
  ThreadPool pool(8);
  EXPECT_EQ(pool.numThreads(), 0u);
  for (int call = 0; call < 100; ++call) {
    std::atomic<int> arrived{0};
    pool.run(2, meeting(&arrived, 3));
    EXPECT_EQ(arrived, 3);
  }
  EXPECT_EQ(pool.numThreads(), 2u);
}

TEST(ThreadPool, ReturnsOnlyWhenAllHelpersHaveComeBack) {
  ThreadPool pool(4);
  for (int call = 0; call < 1000; ++call) {
    std::atomic<int> next{0};
    std::vector<int> done(64, 0);
    pool.run(3, [&] {
      for (int i = next++; i < 64; i = next++) done[static_cast<std::size_t>(i)] = call + 1;
    });
    ASSERT_EQ(done, std::vector<int>(64, call + 1));
  }
}

TEST(ThreadPool, DoesTheWorkAloneWhereNoThreadCanBeStarted) {
  int attempts = 0;
  ThreadPool pool(8, [&](std::function<void()>) -> std::thread {
    ++attempts;
    throw std::system_error(std::make_error_code(std::errc::resource_unavailable_try_again));
  });
  for (int call = 0; call < 3; ++call) {
    int calls = 0;
    std::thread::id id;
    pool.run(3, [&] {
      ++calls;
      id = std::this_thread::get_id();
    });
    EXPECT_EQ(calls, 1);
    EXPECT_EQ(id, std::this_thread::get_id());
  }
  EXPECT_EQ(attempts, 3);  // it may be possible the next time
  EXPECT_EQ(pool.numThreads(), 0u);
}

TEST(ThreadPool, MakesDoWithTheThreadsThatCouldBeStarted) {
  int started = 0;
  ThreadPool pool(8, [&](std::function<void()> loop) {
    if (++started > 1) throw std::system_error(std::make_error_code(std::errc::resource_unavailable_try_again));
    return std::thread(std::move(loop));
  });
  std::atomic<int> arrived{0};
  pool.run(5, meeting(&arrived, 2));
  EXPECT_GE(arrived, 2);
  EXPECT_EQ(pool.numThreads(), 1u);
}

TEST(ThreadPool, ServesWorkWithinWorkAndManyCallers) {
  ThreadPool pool(3);  // fewer than are asked for
  std::atomic<int> sum{0};
  std::vector<std::thread> callers;
  for (int c = 0; c < 4; ++c) {
    callers.emplace_back([&] {
      for (int call = 0; call < 100; ++call) {
        std::atomic<int> next{0};
        pool.run(2, [&] {
          for (int i = next++; i < 8; i = next++) {
            std::atomic<int> inner{0};
            pool.run(2, [&] {
              for (int k = inner++; k < 4; k = inner++) ++sum;
            });
          }
        });
      }
    });
  }
  for (std::thread& caller : callers) caller.join();
  EXPECT_EQ(sum, 4 * 100 * 8 * 4);
  EXPECT_LE(pool.numThreads(), 3u);
}

}  // namespace
}  // namespace interactive_mapping
