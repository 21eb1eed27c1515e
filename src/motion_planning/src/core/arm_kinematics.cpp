// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/arm_kinematics.h"
