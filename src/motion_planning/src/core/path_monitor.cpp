// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/path_monitor.h"
