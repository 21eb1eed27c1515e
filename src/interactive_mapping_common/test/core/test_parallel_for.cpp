// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common/threads/parallel_for.h>

#include <atomic>
#include <chrono>
#include <mutex>
#include <set>
#include <stdexcept>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace interactive_mapping {
namespace {

TEST(ParallelFor, CoversEachIndexExactlyOnce) {
  for (const std::size_t count : {1u, 2u, 7u, 64u, 1000u}) {
    for (const std::size_t chunk : {0u, 1u, 3u, 64u, 5000u}) {
      for (const int threads : {-1, 0, 1, 2, 5}) {
        std::vector<std::atomic<int>> visits(count);
        parallelFor(count, threads, chunk, [&](std::size_t begin, std::size_t end) {
          ASSERT_LT(begin, end);
          ASSERT_LE(end, count);
          for (std::size_t i = begin; i < end; ++i) ++visits[i];
        });
        for (std::size_t i = 0; i < count; ++i) {
          ASSERT_EQ(visits[i], 1) << "index " << i << ", " << count << " items, chunk " << chunk << ", " << threads;
        }
      }
    }
  }
}

TEST(ParallelFor, DoesNothingForZeroItems) {
  for (const int threads : {1, 4}) {
    parallelFor(0, threads, 8, [](std::size_t, std::size_t) { FAIL() << "called without items"; });
  }
}

TEST(ParallelFor, RethrowsTheWorkersException) {
  for (const int threads : {1, 2, 4}) {
    for (const std::size_t culprit : {0u, 57u, 99u}) {
      try {
        parallelFor(100, threads, 1, [&](std::size_t begin, std::size_t end) {
          if (begin <= culprit && culprit < end) throw std::runtime_error("item " + std::to_string(culprit));
        });
        FAIL() << "no exception from item " << culprit << " with " << threads << " threads";
      } catch (const std::runtime_error& error) {
        EXPECT_EQ(error.what(), "item " + std::to_string(culprit));
      }
    }
  }
}

TEST(ParallelFor, SkipsRemainingChunksAfterAnException) {
  std::atomic<int> calls{0};
  EXPECT_THROW(parallelFor(100000, 2, 1,
                           [&](std::size_t, std::size_t) {
                             ++calls;
                             throw std::runtime_error("first");
                           }),
               std::runtime_error);
  // Each thread may have started one more before it learned of the other's failure.
  EXPECT_LE(calls, 4);
}

TEST(ParallelFor, UsesAsManyThreadsAsAsked) {
  std::mutex mutex;  // guards ids
  std::set<std::thread::id> ids;
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  parallelFor(64, 3, 1, [&](std::size_t, std::size_t) {
    const auto seen = [&] {
      const std::lock_guard<std::mutex> lock(mutex);
      ids.insert(std::this_thread::get_id());
      return ids.size();
    };
    // Nobody takes a second chunk before all three threads have one.
    while (seen() < 3 && std::chrono::steady_clock::now() < deadline) std::this_thread::yield();
  });
  EXPECT_EQ(ids.size(), 3u);
  ids.clear();
  parallelFor(64, 1, 1, [&](std::size_t, std::size_t) { ids.insert(std::this_thread::get_id()); });
  EXPECT_EQ(ids, std::set<std::thread::id>{std::this_thread::get_id()});
}

TEST(ParallelFor, RunsChunksConcurrently) {
  // Two chunks that wait for each other finish only when two threads run them.
  std::atomic<int> arrived{0};
  std::atomic<bool> both{false};
  parallelFor(2, 2, 1, [&](std::size_t, std::size_t) {
    ++arrived;
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (arrived < 2 && std::chrono::steady_clock::now() < deadline) std::this_thread::yield();
    if (arrived == 2) both = true;
  });
  EXPECT_TRUE(both);
}

TEST(ResolveThreadCount, ZeroMeansAllCores) {
  EXPECT_EQ(resolveThreadCount(3), 3);
  EXPECT_GE(resolveThreadCount(0), 1);
  if (std::thread::hardware_concurrency() > 0) {
    EXPECT_EQ(resolveThreadCount(0), static_cast<int>(std::thread::hardware_concurrency()));
  }
}

}  // namespace
}  // namespace interactive_mapping
