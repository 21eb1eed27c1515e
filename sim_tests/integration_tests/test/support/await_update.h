// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include <ros/time.h>

namespace integration_tests {

/// What `node` says about the image of this stamp that was published when `updates` had `since` entries. NUM_STATUS, and
/// the test fails: nothing.
template <typename Update>
Update awaitUpdate(const std::vector<Update>& updates, const ros::Time& stamp, std::size_t since,
                   const std::string& node) {
  std::size_t found = 0;
  const bool has_come = node_tests::waitUntil([&] {
    for (found = since; found < updates.size(); ++found) {
      if (updates[found].header.stamp == stamp) return true;
    }
    return false;
  });
  if (has_come) return updates[found];
  ADD_FAILURE() << node << " did not say what became of the image of stamp " << stamp;
  Update none;
  none.status = Update::NUM_STATUS;
  return none;
}

}  // namespace integration_tests
