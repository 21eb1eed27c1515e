// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/obstacle_guard.h"
