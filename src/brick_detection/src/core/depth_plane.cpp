// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/depth_plane.h"
