// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/recovery.h"
