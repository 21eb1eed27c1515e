// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <interactive_mapping_common_ros/testing/waiting.h>

namespace integration_tests {

using node_tests::bytesOf;
using node_tests::call;
using node_tests::has;
using node_tests::kDeadline_s;
using node_tests::Latest;
using node_tests::waitUntil;

}  // namespace integration_tests
