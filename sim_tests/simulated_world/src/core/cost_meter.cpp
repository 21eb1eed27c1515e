// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/cost_meter.h"

#include <chrono>
#include <ctime>

namespace simulated_world {

Cost costNow() {
  timespec processor{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &processor);
  return {std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(),
          static_cast<double>(processor.tv_sec) + 1e-9 * static_cast<double>(processor.tv_nsec)};
}

}  // namespace simulated_world
