// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/manipulability_sector.h"
