// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "planning_problems.h"

namespace planning_problems {

inline ProblemFiles problemFiles() {
  return {SIMULATED_WORLDS, MP700_UR5E_DESCRIPTION_DIR};
}

}  // namespace planning_problems
