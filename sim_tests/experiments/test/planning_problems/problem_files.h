// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "planning_problems/planning_problems.h"

namespace experiments {

inline ProblemFiles problemFiles() {
  return {SIMULATED_WORLDS, MP700_UR5E_DESCRIPTION_DIR};
}

}  // namespace experiments
