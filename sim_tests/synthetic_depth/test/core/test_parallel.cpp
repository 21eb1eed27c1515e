// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/parallel.h"

#include <atomic>
#include <stdexcept>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace synthetic_depth {
namespace {

TEST(ForEachInParallel, CallsEveryNumberOnce) {
  for (const int count : {0, 1, 2, 3, 1000}) {
    std::vector<std::atomic<int>> calls(static_cast<std::size_t>(count));
    forEachInParallel(count, [&calls](int i) { ++calls.at(static_cast<std::size_t>(i)); });
    for (const std::atomic<int>& times : calls) EXPECT_EQ(times, 1) << "of " << count;
  }
}

TEST(ForEachInParallel, UsesMoreThanOneThread) {
  if (std::thread::hardware_concurrency() < 2) GTEST_SKIP() << "one processor";
  // Both calls wait for each other: with a single thread neither would come to its end.
  std::atomic<int> begun{0};
  forEachInParallel(2, [&begun](int) {
    ++begun;
    while (begun < 2) std::this_thread::yield();
  });
  EXPECT_EQ(begun, 2);
}

TEST(ForEachInParallel, ThrowsWhatACallThrew) {
  EXPECT_THROW(forEachInParallel(100,
                                 [](int i) {
                                   if (i == 50) throw std::invalid_argument("fifty");
                                 }),
               std::invalid_argument);
}

}  // namespace
}  // namespace synthetic_depth
