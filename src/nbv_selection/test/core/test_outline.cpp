// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/outline.h"

#include <gmock/gmock.h>

#include "support/box_pile.h"

namespace nbv_selection {
namespace {}  // namespace
}  // namespace nbv_selection
