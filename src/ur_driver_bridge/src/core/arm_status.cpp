// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/arm_status.h"
