// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/collision_scene.h"
