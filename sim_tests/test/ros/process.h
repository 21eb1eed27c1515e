// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "../../../src/gpis_mapping/test/support/process.h"

namespace sim_tests_ros {

using node_tests::Process;

}  // namespace sim_tests_ros
