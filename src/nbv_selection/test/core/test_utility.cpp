// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/utility.h"

#include <gmock/gmock.h>

namespace nbv_selection {
namespace {}  // namespace
}  // namespace nbv_selection
