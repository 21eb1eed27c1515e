// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/joint_planner.h"
