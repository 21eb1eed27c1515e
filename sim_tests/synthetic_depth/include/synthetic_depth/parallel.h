// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>

namespace synthetic_depth {

/// Calls work(0) ... work(count - 1), each once, on all processors at the same time, the caller's thread among them, and
/// returns when all are done. What the calls write must not overlap; then the result does not depend on the number of
/// processors. The first exception that a call throws is thrown here; calls not yet begun are left out then.
void forEachInParallel(int count, const std::function<void(int)>& work);

}  // namespace synthetic_depth
