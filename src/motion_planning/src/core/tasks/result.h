// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <interactive_mapping_common/result.h>

#include "motion_planning/motion_planner.h"

namespace motion_planning {

template <class T, class Failure = PlanFailure>
using Result = interactive_mapping::Result<T, Failure>;

}  // namespace motion_planning
