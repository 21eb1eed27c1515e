// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <interactive_mapping_common/testing/process.h>

namespace integration_tests {

using node_tests::Process;

}  // namespace integration_tests
