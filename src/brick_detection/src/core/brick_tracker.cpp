// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/brick_tracker.h"
