// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <ctime>
#include <vector>

namespace experiments {

/// Processor time of all threads, which other programs on the machine disturb less than they do the wall's.
inline double processorMs() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

/// Joins and sorts small blocks that were freed. glibc leaves that to the next requests for large blocks: here that would
/// be another map's update, right after OctoMap freed some hundred thousand nodes.
inline void settleHeap() {
  constexpr int kRequests = 128;  // each sorts up to 10000 blocks
  for (int i = 0; i < kRequests; ++i) {
    void* volatile block = std::malloc(1 << 16);  // volatile: the compiler must not drop it
    std::free(block);
  }
}

/// Value below which the share `q` lies, interpolated between values; 0 for none.
inline double quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  const double at = q * static_cast<double>(values.size() - 1);
  const std::size_t low = static_cast<std::size_t>(at);
  const std::size_t high = std::min(low + 1, values.size() - 1);
  return values[low] + (at - static_cast<double>(low)) * (values[high] - values[low]);
}

inline double median(const std::vector<double>& values) {
  return quantile(values, 0.5);
}

}  // namespace experiments
