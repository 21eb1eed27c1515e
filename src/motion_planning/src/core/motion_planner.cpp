// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/motion_planner.h"
