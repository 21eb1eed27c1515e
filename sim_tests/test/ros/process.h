// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <interactive_mapping_common/testing/process.h>

namespace sim_tests_ros {

using node_tests::Process;

}  // namespace sim_tests_ros
