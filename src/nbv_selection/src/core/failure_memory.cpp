// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/failure_memory.h"
